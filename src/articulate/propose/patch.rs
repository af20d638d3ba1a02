//! Flat patches of surface: planes grown over neighboring samples, each with its bounding rectangle.

use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, Unit, Vector3};

use crate::{
    observations::SurfaceSamples, pair::surface_pair::SurfacePair, samples::surface_graph::SAME_NORMAL,
};
use geometry::Pose;

/// Largest distance of a sample from its plane, as a share of the reach.
/// tuned: shared/bags
const SAME_PLANE: f64 = 0.15;

/// A flat patch of surface.
pub(crate) struct Patch {
    /// Indices of its samples.
    pub samples: Vec<usize>,
    /// Center of the rectangle around them.
    pub center: Point3<f64>,
    /// Unit vectors along two edges and the normal.
    pub axes: [Vector3<f64>; 3],
    /// Half sides along the edges, meters.
    pub half_m: [f64; 2],
}

impl Patch {
    /// The patch moved by a motion.
    pub(crate) fn under(&self, motion: &Pose) -> Self {
        Self {
            samples: self.samples.clone(),
            center: motion * self.center,
            axes: self.axes.map(|a| motion * a),
            half_m: self.half_m,
        }
    }

    /// Half its extent along a unit direction, meters.
    pub(crate) fn half_extent_m(&self, direction: &Vector3<f64>) -> f64 {
        self.axes[0].dot(direction).abs() * self.half_m[0]
            + self.axes[1].dot(direction).abs() * self.half_m[1]
    }
}

/// Largest relative difference between the breadths of two patches of one panel.
/// tuned: shared/bags
const SAME_BREADTH: f64 = 0.25;

/// The rectangle between two adjacent patches of one plane.
pub(crate) struct Band {
    center: Point3<f64>,
    /// Unit vectors along it, across it and normal to it.
    axes: [Vector3<f64>; 3],
    half_m: [f64; 2],
    tolerance_m: f64,
}

impl Band {
    /// The band from one patch to the other; `None` if they are in two planes, or not side by side along an
    /// edge.
    pub(crate) fn between(a: &Patch, b: &Patch, tolerance_m: f64) -> Option<Self> {
        let normal = a.axes[2];
        let apart = b.center - a.center;
        if normal.dot(&b.axes[2]) < SAME_NORMAL || normal.dot(&apart).abs() > tolerance_m {
            return None;
        }
        let along =
            if a.axes[0].dot(&apart).abs() > a.axes[1].dot(&apart).abs() { a.axes[0] } else { a.axes[1] };
        let across = normal.cross(&along);
        // A sliding panel uncovers a strip as broad as the one it covers.
        let [breadth_a, breadth_b] = [a, b].map(|p| p.half_extent_m(&across));
        let alike_m = SAME_BREADTH * (breadth_a + breadth_b);
        let beside = across.dot(&apart).abs() < alike_m && (breadth_a - breadth_b).abs() < alike_m;
        // Only the space between the patches: the patches themselves are already open.
        let [half_a, half_b] = [a, b].map(|p| p.half_extent_m(&along));
        let length_m = along.dot(&apart).abs() - half_a - half_b;
        let middle = a.center + along * (along.dot(&apart).signum() * (half_a + 0.5 * length_m));
        (beside && length_m > 0.0).then_some(Self {
            center: middle,
            axes: [along, across, normal],
            half_m: [0.5 * length_m, breadth_a],
            tolerance_m,
        })
    }

    /// Area, square meters.
    pub(crate) fn area_m2(&self) -> f64 {
        4.0 * self.half_m[0] * self.half_m[1]
    }

    /// Whether a point with this normal lies in it.
    pub(crate) fn holds(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let [along, across, off] = self.axes.map(|axis| axis.dot(&(point - self.center)).abs());
        along < self.half_m[0]
            && across < self.half_m[1]
            && off < self.tolerance_m
            && self.axes[2].dot(normal) > SAME_NORMAL
    }
}

/// The plane through the samples taken so far.
struct GrowingPlane {
    points: Vector3<f64>,
    normals: Vector3<f64>,
    count: f64,
}

impl GrowingPlane {
    fn add(&mut self, point: &Point3<f64>, normal: &Vector3<f64>) {
        self.points += point.coords;
        self.normals += normal;
        self.count += 1.0;
    }

    fn holds(&self, point: &Point3<f64>, normal: &Vector3<f64>, tolerance_m: f64) -> bool {
        let length = self.normals.norm().max(1e-12);
        let off_m = self.normals.dot(&(point.coords - self.points / self.count)) / length;
        self.normals.dot(normal) > SAME_NORMAL * length && off_m.abs() < tolerance_m
    }
}

/// Patches of the faces with at least `least` seeds, those with the most seeds first, at most `most`.
pub(crate) fn largest_patches(
    pair: &SurfacePair<'_>,
    state: usize,
    faces: &[Vec<usize>],
    seed: &[bool],
    least: usize,
    most: usize,
) -> Vec<Patch> {
    let samples = pair.samples[state];
    let mut groups: Vec<(usize, &Vec<usize>)> =
        faces.iter().map(|g| (g.iter().filter(|&&i| seed[i]).count(), g)).filter(|g| g.0 >= least).collect();
    // Equal ones are ordered by their first sample, so the order is unique.
    groups.sort_by(|a, b| b.0.cmp(&a.0).then(a.1[0].cmp(&b.1[0])));
    groups.truncate(most);
    groups.into_iter().filter_map(|(_, g)| patch_of_face(samples, g.clone())).collect()
}

/// The open samples grouped by plane; no sample is in two groups.
pub(crate) fn faces_of_open(pair: &SurfacePair<'_>, state: usize, open: &[bool]) -> Vec<Vec<usize>> {
    let mut taken: Vec<bool> = open.iter().map(|o| !o).collect();
    let mut all = Vec::new();
    for first in 0..open.len() {
        if !taken[first] {
            all.push(grown_face(pair, state, first, &mut taken));
        }
    }
    all
}

/// The samples of one plane around `first`, marked as taken.
fn grown_face(pair: &SurfacePair<'_>, state: usize, first: usize, taken: &mut [bool]) -> Vec<usize> {
    let samples = pair.samples[state];
    let mut plane = GrowingPlane { points: Vector3::zeros(), normals: Vector3::zeros(), count: 0.0 };
    let mut group = vec![first];
    taken[first] = true;
    plane.add(&samples.points[first], &samples.normals[first]);
    let mut next = 0;
    while next < group.len() {
        let i = group[next];
        next += 1;
        for j in pair.neighbors_on_surface(state, i) {
            // Compared with the plane so far, not with the neighbor: a bent surface turns little from one
            // sample to the next.
            if !taken[j] && plane.holds(&samples.points[j], &samples.normals[j], SAME_PLANE * pair.reach_m) {
                taken[j] = true;
                plane.add(&samples.points[j], &samples.normals[j]);
                group.push(j);
            }
        }
    }
    group
}

fn patch_of_face(samples: &SurfaceSamples, group: Vec<usize>) -> Option<Patch> {
    let n = group.len() as f64;
    let center = Point3::from(group.iter().map(|&i| samples.points[i].coords).sum::<Vector3<f64>>() / n);
    let mean = group.iter().map(|&i| samples.normals[i]).sum::<Vector3<f64>>().try_normalize(1e-9)?;
    let spread: Matrix3<f64> =
        group.iter().map(|&i| samples.points[i] - center).map(|v| v * v.transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let flat = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    // The fitted plane is more certain than the mean of the normals, unless the points form a line.
    let normal = if flat.dot(&mean).abs() > SAME_NORMAL { flat * flat.dot(&mean).signum() } else { mean };
    let across = Matrix3::identity() - normal * normal.transpose();
    let long = across * eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let long = smallest_box_direction(samples, &group, &center, &normal, long.try_normalize(1e-9)?);
    let short = normal.cross(&long);
    let half_m = [long, short].map(|axis| {
        let mut along: Vec<f64> =
            group.iter().map(|&i| axis.dot(&(samples.points[i] - center)).abs()).collect();
        along.sort_by(f64::total_cmp);
        // A few samples of another surface must not stretch the box.
        along[along.len() * 49 / 50]
    });
    Some(Patch { samples: group, center, axes: [long, short, normal], half_m })
}

/// The direction in the plane along which the bounding rectangle of the patch is smallest: a square has no
/// principal directions.
fn smallest_box_direction(
    samples: &SurfaceSamples,
    group: &[usize],
    center: &Point3<f64>,
    normal: &Vector3<f64>,
    start: Vector3<f64>,
) -> Vector3<f64> {
    const STEPS: usize = 30;
    let mut best = (f64::INFINITY, start);
    // A quarter turn covers all rectangles; beyond it they repeat.
    for k in 0..STEPS {
        let angle = std::f64::consts::FRAC_PI_2 * k as f64 / STEPS as f64;
        let axis = Rotation3::from_axis_angle(&Unit::new_unchecked(*normal), angle) * start;
        let [length, breadth] = [axis, normal.cross(&axis)].map(|d| extent_along(samples, group, center, &d));
        if length * breadth < best.0 {
            best = (length * breadth, axis);
        }
    }
    best.1
}

/// Extent of samples along a unit direction, meters.
fn extent_along(samples: &SurfaceSamples, group: &[usize], center: &Point3<f64>, d: &Vector3<f64>) -> f64 {
    let along = group.iter().map(|&i| d.dot(&(samples.points[i] - center)));
    let [lo, hi] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)]);
    hi - lo
}
