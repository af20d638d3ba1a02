//! Finds the places of border vertices: on lines between corners, else on a smooth curve.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

/// A closed rim with positions along it.
pub(super) struct Rim<'a> {
    points: &'a [Point3<f64>],
    /// Whether each point counts in fits; the others follow.
    counts: Vec<bool>,
    /// Length along the rim up to each point, meters, and the total length at the end.
    length_m: Vec<f64>,
    voxel_m: f64,
}

/// Half the length of the fitted rim about a vertex, voxels.
/// tuned: made and recorded objects (docs/method.md 16); three teeth of two voxels
const WINDOW: f64 = 6.0;
/// At a corner the cosine of the change of direction is smaller than this. tuned: made and recorded objects
/// (docs/method.md 16); 40 degrees
const CORNER_COSINE: f64 = 0.77;
/// A piece is a line if no point is farther from the fitted one, voxels. tuned: made and recorded objects
/// (docs/method.md 16); teeth of one voxel and the error of a corner
const LINE: f64 = 1.25;

impl<'a> Rim<'a> {
    /// A rim of points; `counts` says which count in fits.
    pub(super) fn new(points: &'a [Point3<f64>], counts: Vec<bool>, voxel_m: f64) -> Self {
        let mut length_m = vec![0.0];
        let mut sum = 0.0;
        for k in 0..points.len() {
            sum += (points[(k + 1) % points.len()] - points[k]).norm();
            length_m.push(sum);
        }
        Self { points, counts, length_m, voxel_m }
    }

    fn whole_m(&self) -> f64 {
        self.length_m[self.points.len()]
    }

    /// The new place of every point; `None` for a rim too short to have a direction.
    pub(super) fn places_of_points(&self) -> Option<Vec<Point3<f64>>> {
        let n = self.points.len();
        if self.whole_m() < 4.0 * WINDOW * self.voxel_m {
            return None;
        }
        let corners = self.corner_points();
        if corners.is_empty() {
            return Some((0..n).map(|k| self.place_on_curve(k, None)).collect());
        }
        let mut places = self.points.to_vec();
        let mut lines = Vec::with_capacity(corners.len());
        for (i, &from) in corners.iter().enumerate() {
            let to = corners[(i + 1) % corners.len()];
            // With a single corner, the piece goes all the way round.
            let count = (to + n - from - 1) % n + 1;
            let line = self.line_of_piece(from, count);
            for k in (1..count).map(|k| (from + k) % n) {
                places[k] = match &line {
                    Some(line) => line.nearest_point(&self.points[k]),
                    None => self.place_on_curve(k, Some((from, count))),
                };
            }
            lines.push(line);
        }
        for (i, &corner) in corners.iter().enumerate() {
            let before = &lines[(i + lines.len() - 1) % lines.len()];
            if let (Some(a), Some(b)) = (before, &lines[i]) {
                places[corner] = a.meeting_point(b).unwrap_or(places[corner]);
            }
        }
        Some(places)
    }

    /// Points where the rim's direction changes enough, and most, from the window before to the window
    /// behind.
    fn corner_points(&self) -> Vec<usize> {
        let n = self.points.len();
        let cosines: Vec<f64> = (0..n).map(|k| self.turn_cosine(k)).collect();
        (0..n).filter(|&k| self.is_corner(&cosines, k)).collect()
    }

    /// Cosine of the change of direction at a point; 1 where it is unknown.
    fn turn_cosine(&self, k: usize) -> f64 {
        match (self.direction_at(k, false), self.direction_at(k, true)) {
            (Some(a), Some(b)) => a.dot(&b),
            _ => 1.0,
        }
    }

    /// Whether the direction changes enough at a point, and nowhere more within its windows.
    fn is_corner(&self, cosines: &[f64], k: usize) -> bool {
        let rivals = self.points_in_window(k, false).chain(self.points_in_window(k, true));
        cosines[k] < CORNER_COSINE && rivals.filter(|&j| j != k).all(|j| (cosines[k], k) < (cosines[j], j))
    }

    /// The points within the window before or behind a point, from the point on.
    fn points_in_window(&self, k: usize, forward: bool) -> impl Iterator<Item = usize> {
        let n = self.points.len();
        let points = (0..n).map(move |i| if forward { (k + i) % n } else { (k + n - i) % n });
        points.take_while(move |&j| {
            let length_m = if forward { self.length_between_m(k, j) } else { self.length_between_m(j, k) };
            length_m <= WINDOW * self.voxel_m
        })
    }

    /// Length of the rim from one point forward to another, less than a full round, meters.
    fn length_between_m(&self, from: usize, to: usize) -> f64 {
        let d = self.length_m[to] - self.length_m[from];
        if d < 0.0 { d + self.whole_m() } else { d }
    }

    /// Direction of the rim before or behind a point: the slope of a line fitted over its length.
    fn direction_at(&self, k: usize, forward: bool) -> Option<Vector3<f64>> {
        let mut sums = [0.0; 2];
        let mut weight = 0.0;
        let mut mean = Vector3::zeros();
        let mut product = Vector3::zeros();
        if !self.is_known(self.points_in_window(k, forward)) {
            return None;
        }
        for j in self.points_in_window(k, forward) {
            let s = if forward { self.length_between_m(k, j) } else { -self.length_between_m(j, k) };
            let w = self.share_m(j);
            let p = self.points[j].coords - self.points[k].coords;
            weight += w;
            sums[0] += w * s;
            sums[1] += w * s * s;
            mean += w * p;
            product += w * s * p;
        }
        let spread = sums[1] * weight - sums[0] * sums[0];
        (spread > 0.0).then(|| product * weight - mean * sums[0])?.try_normalize(0.0)
    }

    /// Whether most of some points count.
    fn is_known(&self, points: impl Iterator<Item = usize>) -> bool {
        let (known, all) = points.fold((0, 0), |(n, all), j| (n + usize::from(self.counts[j]), all + 1));
        2 * known > all
    }

    /// Weight of a point: half the length of its two sides, meters; 0 where it does not count.
    fn share_m(&self, k: usize) -> f64 {
        let n = self.points.len();
        if !self.counts[k] {
            return 0.0;
        }
        let before = (self.points[k] - self.points[(k + n - 1) % n]).norm();
        0.5 * (before + (self.points[(k + 1) % n] - self.points[k]).norm())
    }

    /// The line fitted to a piece of `count` sides from a corner; `None` if it is not straight.
    fn line_of_piece(&self, from: usize, count: usize) -> Option<RimLine> {
        let n = self.points.len();
        let inner = || (1..count).map(|k| (from + k) % n).filter(|&k| self.counts[k]);
        let weight: f64 = inner().map(|k| self.share_m(k)).sum();
        if inner().count() < 2 || weight <= 0.0 || !self.is_known((1..count).map(|k| (from + k) % n)) {
            return None;
        }
        let middle = inner().map(|k| self.points[k].coords * self.share_m(k)).sum::<Vector3<f64>>() / weight;
        let scatter = inner().fold(Matrix3::zeros(), |m, k| {
            let d = self.points[k].coords - middle;
            m + d * d.transpose() * self.share_m(k)
        });
        let eigen = scatter.symmetric_eigen();
        let direction: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
        let line = RimLine { middle: middle.into(), direction };
        let limit_m = LINE * self.voxel_m;
        let is_line =
            inner().all(|k| (line.nearest_point(&self.points[k]) - self.points[k]).norm() <= limit_m);
        is_line.then_some(line)
    }

    /// The place of a point on a parabola fitted to the window around it; the window ends at the ends of its
    /// piece (first corner and number of sides).
    fn place_on_curve(&self, k: usize, piece: Option<(usize, usize)>) -> Point3<f64> {
        let n = self.points.len();
        let mut normal = SMatrix::<f64, 3, 3>::zeros();
        let mut right = SMatrix::<f64, 3, 3>::zeros();
        let reach = WINDOW * self.voxel_m;
        if !self.is_known(self.points_in_window(k, false).chain(self.points_in_window(k, true))) {
            return self.points[k];
        }
        let ends = |j: usize| piece.is_some_and(|(from, count)| j == from || j == (from + count) % n);
        for forward in [false, true] {
            for j in self.points_in_window(k, forward).skip(usize::from(forward)) {
                let s =
                    if forward { self.length_between_m(k, j) } else { -self.length_between_m(j, k) } / reach;
                // Tricube (Cleveland 1979): no step where a point enters the window.
                let w = self.share_m(j) * (1.0 - s.abs().powi(3)).powi(3);
                let row = SVector::<f64, 3>::new(1.0, s, s * s);
                normal += row * row.transpose() * w;
                right += row * (self.points[j] - self.points[k]).transpose() * w;
                if j != k && ends(j) {
                    break;
                }
            }
        }
        let fitted = normal.cholesky().map(|c| c.solve(&right));
        fitted.map_or(self.points[k], |f| self.points[k] + f.row(0).transpose())
    }
}

/// A line in space.
struct RimLine {
    middle: Point3<f64>,
    direction: Vector3<f64>,
}

impl RimLine {
    fn nearest_point(&self, p: &Point3<f64>) -> Point3<f64> {
        self.middle + self.direction * self.direction.dot(&(p - self.middle))
    }

    /// The midpoint between two lines where they are nearest; `None` for almost parallel lines.
    fn meeting_point(&self, other: &Self) -> Option<Point3<f64>> {
        let u = self.direction;
        let v = other.direction;
        let d = other.middle - self.middle;
        let cosine = u.dot(&v);
        let sine2 = 1.0 - cosine * cosine;
        let on_self = (d.dot(&u) - cosine * d.dot(&v)) / sine2;
        let on_other = (cosine * d.dot(&u) - d.dot(&v)) / sine2;
        let p = self.middle + u * on_self;
        (sine2 > 0.1).then(|| p + (other.middle + v * on_other - p) * 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 40 voxels' side with teeth of one voxel, a point every quarter of a voxel.
    fn toothed_square() -> Vec<Point3<f64>> {
        let side = |k: usize| {
            let turn = nalgebra::Rotation3::from_axis_angle(
                &Vector3::z_axis(),
                k as f64 * std::f64::consts::FRAC_PI_2,
            );
            (0..160).map(move |i| {
                let s = f64::from(i) * 0.25;
                turn * Point3::new(s - 20.0, -20.0 + 0.5 - (s.rem_euclid(2.0) - 1.0).abs(), 0.0)
            })
        };
        (0..4).flat_map(side).collect()
    }

    #[test]
    fn a_toothed_square_has_four_corners_and_four_lines() {
        let points = toothed_square();
        let rim = Rim::new(&points, vec![true; points.len()], 1.0);
        assert_eq!(rim.corner_points().len(), 4);
        for p in rim.places_of_points().unwrap() {
            assert!((p.x.abs().max(p.y.abs()) - 20.0).abs() < 0.1, "{p}");
            assert!(p.z.abs() < 1e-9);
        }
    }

    #[test]
    fn a_toothed_circle_becomes_round_and_keeps_its_radius() {
        let angle = |k: usize| k as f64 * std::f64::consts::TAU / 720.0;
        let radius = |k: usize| 30.0 + 0.5 * (angle(k) * 94.0).sin();
        let points: Vec<_> = (0..720)
            .map(|k| Point3::new(radius(k) * angle(k).cos(), radius(k) * angle(k).sin(), 1.0))
            .collect();
        let rim = Rim::new(&points, vec![true; points.len()], 1.0);
        assert!(rim.corner_points().is_empty());
        for p in rim.places_of_points().unwrap() {
            assert!((p.coords.xy().norm() - 30.0).abs() < 0.15, "{}", p.coords.xy().norm());
        }
    }

    #[test]
    fn a_short_rim_has_no_direction() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        assert_eq!(Rim::new(&points, vec![true; points.len()], 1.0).places_of_points(), None);
    }
}
