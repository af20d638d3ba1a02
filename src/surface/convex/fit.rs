//! Fits one solid around pieces of a surface, and measures its distance before the seen surface.

use nalgebra::{Point3, Vector3};

use super::{
    ConvexSolid, Plane,
    pieces::{ALONG, Piece, SeenSurface},
    sample_columns::{GRAZING, SampleColumns, Slopes},
};
use numeric::vectorized;

/// Largest number of surface faces that give directions to a solid's faces.
const OWN_FACES: usize = 20;
/// Cosine above which two directions are one: of two seen faces, and of an unseen and any other face. chosen:
/// 0.5 and 8 degrees
const SAME_SEEN: f64 = 0.999_96;
const SAME_ASSUMED: f64 = 0.99;
/// Shares of the surface along a face that may lie behind it; each gives an offset to try. chosen: from a
/// third to all
const OFFSET_SHARES: [f64; 5] = [0.3, 0.5, 0.7, 0.9, 1.0];
/// Offsets closer together than this share of the tolerance are one. chosen: too little to matter
const NEXT_SHARE: f64 = 0.1;

/// The error per area of a distance between a solid and the surface: about the base-two logarithm of one plus
/// its square in tolerances. So a place that fits counts more than many that almost fit, and a place far off
/// still has a gradient. It is `rho` of docs/method.md (10.2).
#[inline(always)]
pub(super) fn distance_error(distance_m: f64, tolerance_m: f64) -> f64 {
    let x = 1.0 + (distance_m / tolerance_m).powi(2);
    // Linear between powers of two: this is the innermost function, evaluated a hundred times as often as any
    // other.
    let bits = x.to_bits();
    let exponent = (bits >> 52) as f64 - 1023.0;
    exponent + (bits & ((1 << 52) - 1)) as f64 / (1u64 << 52) as f64
}

/// The half spaces of a solid.
#[derive(Clone, Debug, Default)]
pub(super) struct Fit {
    pub planes: Vec<Plane>,
}

impl Fit {
    /// A solid around pieces, with faces along those of its samples, along their opposites and along `frame`.
    /// A seen face lies where the error is least, of surface outside the solid and of solid in front of the
    /// surface; other faces lie behind all pieces.
    pub(super) fn new<'a>(
        seen: &SeenSurface,
        pieces: impl Iterator<Item = &'a Piece> + Clone,
        samples: &SampleColumns,
        frame: &[Vector3<f64>],
        [tolerance_m, thin_m]: [f64; 2],
    ) -> Self {
        let (own, closing) = face_directions(seen, samples, frame);
        let mut planes: Vec<Plane> = own
            .iter()
            .chain(&closing)
            .map(|normal| Plane { normal: *normal, offset_m: f64::NEG_INFINITY })
            .collect();
        let normals: [Vec<f64>; 3] = [0, 1, 2].map(|k| planes.iter().map(|p| p.normal[k]).collect());
        let mut fronts = vec![0.0; planes.len()];
        let mut depths = vec![0.0; planes.len()];
        for piece in pieces {
            fronts.fill(f64::NEG_INFINITY);
            piece.front.iter().for_each(|p| raise(&normals, p, &mut fronts));
            depths.fill(0.0);
            raise(&normals, &piece.back, &mut depths);
            for ((plane, front), depth) in planes.iter_mut().zip(&fronts).zip(&depths) {
                plane.offset_m = plane.offset_m.max(front + depth);
            }
        }
        settle_planes(&mut planes, own.len(), samples, tolerance_m);
        thicken_behind(&mut planes, own.len(), thin_m);
        Self { planes }
    }

    /// Whether a place lies behind all planes.
    pub(super) fn holds(&self, place: &Vector3<f64>) -> bool {
        self.planes.iter().all(|p| p.normal.dot(place) < p.offset_m)
    }

    /// Errors of samples against the solid by a tolerance, weighted by their areas.
    pub(super) fn weighed_errors(&self, samples: &SampleColumns, tolerance_m: f64) -> Vec<f64> {
        let mut errors = samples.distances_m(&self.planes);
        weigh(&mut errors, &samples.areas_m2, tolerance_m);
        errors
    }

    /// The solid, at least `thin_m` thick, without the faces that cut off less than `least_m`; `None` where
    /// it has no volume.
    pub(super) fn solid(&self, least_m: f64, thin_m: f64) -> Option<ConvexSolid> {
        // Oblique faces may leave a sliver or nothing: the planes move out until there is a solid.
        let grown =
            (0..6).map(|k| self.grown_by(0.5 * thin_m * f64::from((1 << k) - 1)).bounded_solid(least_m));
        grown.flatten().find(|s| s.thickness_m() >= 0.99 * thin_m)
    }

    fn grown_by(&self, by_m: f64) -> Self {
        let planes = self.planes.iter().map(|p| Plane { offset_m: p.offset_m + by_m, ..*p });
        Self { planes: planes.collect() }
    }

    /// The solid behind all planes.
    fn bounded_solid(&self, least_m: f64) -> Option<ConvexSolid> {
        // A box around it, along its own first directions, which all faces then cut.
        let axes = axes_along_first(&self.planes);
        let size = self.planes.iter().map(|p| p.offset_m.abs()).fold(0.0, f64::max);
        let span = 4.0 * size + 1.0;
        let at = |x: f64, y: f64| Point3::from(axes[0] * x + axes[1] * y);
        let square = [at(-span, -span), at(span, -span), at(span, span), at(-span, span)];
        let mut solid = ConvexSolid::prism(&square, &axes[2], -span, span);
        // The faces with the deepest cuts come first; those with only shallow cuts left are dropped.
        let mut left = self.planes.clone();
        loop {
            let cuts = left.iter().enumerate().map(|(i, plane)| {
                (solid.vertices.iter().map(|v| plane.distance_m(v)).fold(0.0, f64::max), i)
            });
            let most = cuts.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            let Some((_, i)) = most.filter(|(cut, _)| *cut > least_m) else { break };
            solid = solid.clipped_at(&left.remove(i))?;
        }
        (solid.volume_m3() > 0.0).then_some(solid)
    }
}

/// Right-handed axes, the first along the first plane's normal.
fn axes_along_first(planes: &[Plane]) -> [Vector3<f64>; 3] {
    let z = planes.first().map_or_else(Vector3::z, |p| p.normal);
    let x = z.cross(&if z.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
    [x, z.cross(&x), z]
}

/// Moves faces back until the solid is `thin_m` thick behind each of the first `own` (seen) ones: an unseen
/// face moves by all that is missing, two seen ones by half each.
fn thicken_behind(planes: &mut [Plane], own: usize, thin_m: f64) {
    for k in 0..own {
        for i in 0..planes.len() {
            let lack_m = thin_m - planes[k].offset_m - planes[i].offset_m;
            if lack_m > 0.0 && planes[i].normal.dot(&planes[k].normal) < -SAME_ASSUMED {
                let share = if i < own { 0.5 } else { 1.0 };
                planes[i].offset_m += share * lack_m;
                planes[k].offset_m += (1.0 - share) * lack_m;
            }
        }
    }
}

vectorized! {
    /// Turns distances, meters, into weighted errors.
    fn weigh(distances: &mut [f64], areas_m2: &[f64], tolerance_m: f64) = weigh_all
}

#[inline(always)]
fn weigh_all(distances: &mut [f64], areas_m2: &[f64], tolerance_m: f64) {
    for (distance, area_m2) in distances.iter_mut().zip(areas_m2) {
        *distance = area_m2 * distance_error(*distance, tolerance_m);
    }
}

/// The samples' distances to the planes added so far.
struct States {
    /// The two nearest planes along each sample's normal: distances, meters, and the index of the nearest.
    first: Vec<f64>,
    second: Vec<f64>,
    by: Vec<u64>,
    /// How far each sample lies outside the solid, meters.
    outside_m: Vec<f64>,
}

/// No plane.
const NONE: u64 = u64::MAX;

impl States {
    fn of_planes(planes: &[Plane], samples: &SampleColumns) -> Self {
        let n = samples.len();
        let far = vec![f64::INFINITY; n];
        let mut states = Self { first: far.clone(), second: far, by: vec![NONE; n], outside_m: vec![0.0; n] };
        let mut slopes = Slopes::default();
        for (k, plane) in planes.iter().enumerate() {
            samples.write_slopes(&plane.normal, &mut slopes);
            meet(&slopes, plane.offset_m, k as u64, &mut states);
        }
        states
    }

    /// Distance of a sample to the nearest of all planes but one, meters.
    fn nearest_without(&self, sample: usize, plane: usize) -> f64 {
        if self.by[sample] == plane as u64 { self.second[sample] } else { self.first[sample] }
    }
}

vectorized! {
    /// Updates the nearest planes with one at an offset, meters; it may have been farther away before.
    fn meet(slopes: &Slopes, offset_m: f64, plane: u64, states: &mut States) = meet_all
}

#[inline(always)]
fn meet_all(slopes: &Slopes, offset_m: f64, plane: u64, states: &mut States) {
    let Slopes { heights, speeds } = slopes;
    let States { first, second, by, .. } = states;
    for ((((height, speed), first), second), by) in heights.iter().zip(speeds).zip(first).zip(second).zip(by)
    {
        let depth = offset_m - height;
        let depth = if depth > 0.0 { depth } else { 0.0 };
        let met = if *speed > GRAZING { depth / speed } else { f64::INFINITY };
        let is_own = *by == plane;
        let is_nearer = met < *first;
        let behind = if met < *second { met } else { *second };
        let pushed = if is_nearer { *first } else { behind };
        *second = if is_own { *second } else { pushed };
        *first = if is_nearer { met } else { *first };
        *by = if is_nearer { plane } else { *by };
    }
}

vectorized! {
    /// Raises each of `highest` to the height of a place along the normals.
    fn raise(normals: &[Vec<f64>; 3], place: &Vector3<f64>, highest: &mut [f64]) = raise_all
}

#[inline(always)]
fn raise_all(normals: &[Vec<f64>; 3], place: &Vector3<f64>, highest: &mut [f64]) {
    let [x, y, z] = normals;
    for (((x, y), z), highest) in x.iter().zip(y).zip(z).zip(highest) {
        let height = x * place.x + y * place.y + z * place.z;
        *highest = if height > *highest { height } else { *highest };
    }
}

/// Samples whose error depends on a plane: their heights along it, meters, the cosines of their normals to
/// it, distances to the nearest of the other planes, distances outside these, meters, and areas.
#[derive(Default)]
struct Felt {
    /// Indices of the samples, ascending.
    of: Vec<u32>,
    heights: Vec<f64>,
    speeds: Vec<f64>,
    without: Vec<f64>,
    outside: Vec<f64>,
    areas: Vec<f64>,
}

impl Felt {
    /// Takes the samples whose error depends on plane `k` where it lies at a height of `lowest_m` or more.
    fn take(&mut self, k: usize, lowest_m: f64, slopes: &Slopes, states: &States, areas_m2: &[f64]) {
        let Slopes { heights, speeds } = slopes;
        let Self { of, heights: high, speeds: fast, without, outside, areas } = self;
        of.clear();
        let all = heights.iter().zip(speeds).zip(0..);
        of.extend(all.filter(|((h, s), _)| **s > GRAZING || **h > lowest_m).map(|(_, i)| i));
        gather_column(high, of, |i| heights[i]);
        gather_column(fast, of, |i| speeds[i]);
        gather_column(without, of, |i| states.nearest_without(i, k));
        gather_column(outside, of, |i| states.outside_m[i]);
        gather_column(areas, of, |i| areas_m2[i]);
    }
}

/// Gathers a column of the samples with these indices.
fn gather_column(column: &mut Vec<f64>, of: &[u32], value: impl Fn(usize) -> f64) {
    column.clear();
    column.extend(of.iter().map(|&i| value(i as usize)));
}

vectorized! {
    /// Errors of samples with a plane at an offset; offset and tolerance in meters.
    fn errors_at(felt: &Felt, offset_and_tolerance: [f64; 2], errors: &mut [f64]) = errors_of
}

#[inline(always)]
fn errors_of(felt: &Felt, [offset_m, tolerance_m]: [f64; 2], errors: &mut [f64]) {
    let Felt { heights, speeds, without, outside, areas, .. } = felt;
    let all = heights.iter().zip(speeds).zip(without).zip(outside).zip(areas).zip(errors);
    for (((((height, speed), without), outside), area), sum) in all {
        let depth = offset_m - height;
        let met = if *speed > GRAZING { depth / speed } else { f64::INFINITY };
        let before = if met < *without { met } else { *without };
        let outside = if -depth > *outside { -depth } else { *outside };
        *sum = area * distance_error(if outside > 0.0 { outside } else { before }, tolerance_m);
    }
}

/// Moves the first `own` planes, one after the other, from behind all pieces to the offset with the least
/// error.
fn settle_planes(planes: &mut [Plane], own: usize, samples: &SampleColumns, tolerance_m: f64) {
    let mut states = States::of_planes(planes, samples);
    let mut slopes = Slopes::default();
    let mut felt = Felt::default();
    for (k, plane) in planes.iter_mut().enumerate().take(own) {
        let offset_m = plane.offset_m;
        samples.write_slopes(&plane.normal, &mut slopes);
        let Slopes { heights, speeds } = &slopes;
        let along = (0..samples.len()).filter(|&i| speeds[i] > ALONG);
        let along = along.map(|i| (heights[i], samples.areas_m2[i])).collect();
        let tried = tried_offsets(along, offset_m, tolerance_m);
        let (Some(lowest), true) = (tried.last().copied(), tried.len() > 1) else { continue };
        // The other samples do not depend on any of the offsets.
        felt.take(k, lowest, &slopes, &states, &samples.areas_m2);
        let mut errors = vec![0.0; felt.heights.len()];
        let mut costs = Vec::with_capacity(tried.len());
        for tried_m in tried {
            errors_at(&felt, [tried_m, tolerance_m], &mut errors);
            costs.push((errors.iter().sum::<f64>(), tried_m));
        }
        // Of equals the outermost.
        let best = costs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(offset_m, |c| c.1);
        if best < offset_m {
            plane.offset_m = best;
            for (outside_m, height) in states.outside_m.iter_mut().zip(heights) {
                *outside_m = outside_m.max(height - best);
            }
            meet(&slopes, best, k as u64, &mut states);
        }
    }
}

/// Offsets to try for a face, the outermost first: behind all pieces, and at shares of the surface along it
/// (given as heights with areas).
fn tried_offsets(mut along: Vec<(f64, f64)>, offset_m: f64, tolerance_m: f64) -> Vec<f64> {
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = along.iter().map(|h| h.1).sum();
    let mut below = 0.0;
    let mut tried = vec![offset_m];
    let mut shares = OFFSET_SHARES.iter().peekable();
    for (height, area) in &along {
        below += area;
        while shares.next_if(|share| below >= **share * total).is_some() {
            tried.push(*height);
        }
    }
    tried.sort_by(|a, b| b.total_cmp(a));
    tried.dedup_by(|a, b| (*a - *b).abs() < NEXT_SHARE * tolerance_m);
    tried
}

/// Directions of the seen faces, and of the faces that close the solid.
fn face_directions(
    seen: &SeenSurface,
    samples: &SampleColumns,
    frame: &[Vector3<f64>],
) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
    let mut areas: Vec<(u32, f64)> = Vec::new();
    let mut slot = vec![u32::MAX; seen.faces.len()];
    for (&face, area_m2) in samples.faces.iter().zip(&samples.areas_m2) {
        let k = &mut slot[face as usize];
        if *k == u32::MAX {
            *k = areas.len() as u32;
            areas.push((face, 0.0));
        }
        areas[*k as usize].1 += area_m2;
    }
    areas.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let is_new = |found: &[Vector3<f64>], d: &Vector3<f64>, same: f64| found.iter().all(|f| f.dot(d) < same);
    let mut own: Vec<Vector3<f64>> = Vec::with_capacity(OWN_FACES);
    for (face, _) in areas.iter().take(OWN_FACES) {
        let d = seen.faces[*face as usize];
        if is_new(&own, &d, SAME_SEEN) {
            own.push(d);
        }
    }
    let mut closing: Vec<Vector3<f64>> = Vec::with_capacity(OWN_FACES + frame.len());
    for d in own.iter().map(|d| -d).chain(frame.iter().copied()) {
        if is_new(&own, &d, SAME_ASSUMED) && is_new(&closing, &d, SAME_ASSUMED) {
            closing.push(d);
        }
    }
    (own, closing)
}
