//! Motions that the shape of a part allows beside its own: a bar or a panel may as well have been turned end for end. Its
//! hinge tells them apart. (Round parts: `swivel.rs`.)

use nalgebra::{Matrix3, Point3, SymmetricEigen, UnitQuaternion, Vector3};

use super::{
    hinge::{axis_off_m, touch_m},
    part_count::CHANCE,
    register::Run,
    residual::{EXPLAINED, HINGE, PARALLEL},
    slip::round_axis,
};
use crate::geometry::{Pose, Screw};

/// Rounds in which a turned motion settles.
const ROUNDS: usize = 3;
/// Turn at which half of what speaks for a hinge is lost, radians: few joints turn farther, and a part turned end for end does by
/// as much as half a turn exceeds its own.
const FAR_TURN: f64 = 2.1;

impl Run<'_> {
    /// The motions, each part's turned end for end where that explains more, weighed by what speaks for a hinge.
    /// Matches tell one from the other, so that only parts without them are looked at.
    pub fn hinged(&self, mut motions: Vec<Pose>) -> Vec<Pose> {
        for k in 1..motions.len() {
            if self.matched(&motions, k) {
                continue;
            }
            let (labels, _) = self.labels(&motions);
            let Some(turned) = self.turned(&motions, &labels, k) else { continue };
            let mut others = motions.clone();
            others[k] = turned;
            if self.hinge(&others, &labels[0], k) <= self.hinge(&motions, &labels[0], k) {
                continue;
            }
            (0..ROUNDS).for_each(|_| self.round(&mut others));
            let worth = |motions: &[Pose]| self.hinge(motions, &self.labels(motions).0[0], k) * self.weighed(motions).0[k];
            if worth(&others) > worth(&motions) {
                motions = others;
            }
        }
        motions
    }

    /// Whether matches tell the motion of part `k` from others that its shape allows.
    pub fn matched(&self, motions: &[Pose], k: usize) -> bool {
        self.match_cells(motions)[k] - CHANCE >= self.config.least_score
    }

    /// How well the motion of part `k` could be that of a hinge on another part, from 0 to 1: its axis runs by the surfaces of
    /// both, and it does not turn too far. A slide along another part has no axis; both touch.
    fn hinge(&self, motions: &[Pose], labels: &[u8], k: usize) -> f64 {
        let of = |part: usize| -> Vec<Point3<f64>> {
            let points = self.evidence.samples[0].points.iter().zip(labels);
            points.filter(|(_, l)| usize::from(**l) == part).map(|(p, _)| *p).collect()
        };
        let own = of(k);
        let on = |parent: usize| {
            let relative = motions[parent].inverse() * motions[k];
            let (off_m, angle_rad) = match Screw::of(&relative).filter(|s| s.angle_rad > PARALLEL) {
                Some(axis) => (axis_off_m((&axis.point, &axis.direction), &own, &of(parent)), axis.angle_rad),
                None => (touch_m(&own, &of(parent)), 0.0),
            };
            1.0 / (1.0 + (off_m / (HINGE * self.extent_m)).powi(2)) / (1.0 + (angle_rad / FAR_TURN).powi(4))
        };
        (0..motions.len()).filter(|p| *p != k).map(on).fold(0.0, f64::max)
    }

    /// The motion of part `k` after half a turn of the part about its middle and the direction of its axis; `None` for a slide.
    fn turned(&self, motions: &[Pose], labels: &[Vec<u8>; 2], k: usize) -> Option<Pose> {
        let axis = Screw::of(&motions[k]).filter(|s| s.angle_rad > PARALLEL)?.direction;
        let costs = self.evidence.shape_costs(0, motions, Some(&labels[1]));
        let lands = |i: &usize| usize::from(labels[0][*i]) == k && costs[i * motions.len() + k] < EXPLAINED;
        let surface = self.evidence.samples[0];
        let (points, normals): (Vec<Point3<f64>>, Vec<Vector3<f64>>) =
            (0..labels[0].len()).filter(lands).map(|i| (surface.points[i], surface.normals[i])).unzip();
        if round_axis(&points, &normals).is_some() {
            return None;
        }
        let center = middle(&points)?;
        let turn = UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
        Some(motions[k] * Pose::from_parts((center.coords - turn * center.coords).into(), turn))
    }
}

/// Middle of the box around points along their principal directions; `None` for too few.
fn middle(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    const LEAST: usize = 12;
    if points.len() < LEAST {
        return None;
    }
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum();
    let axes = SymmetricEigen::new(spread).eigenvectors;
    let center = axes.column_iter().map(|axis| {
        let mut along: Vec<f64> = points.iter().map(|p| axis.dot(&p.coords)).collect();
        along.sort_by(f64::total_cmp);
        let cut = along.len() / 50;
        axis * (0.5 * (along[cut] + along[along.len() - 1 - cut]))
    });
    Some(center.sum::<Vector3<f64>>().into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::articulate::{RegisterConfig, synthetic::Scene};

    #[test]
    fn a_plain_arm_turned_end_for_end_goes_back_to_its_hinges() {
        let scene = Scene { texture: 0.0, ..Scene::lamp() };
        let middle = Vector3::new(0.0, 0.0, 0.18);
        let half = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
        let turned = scene.truth(1) * Pose::from_parts((middle - half * middle).into(), half);
        scene.seen(0.006, 0.012, |evidence, _| {
            let config = RegisterConfig::default();
            let run = Run::new(&[], 0.4, &config, evidence);
            for start in [scene.truth(1), turned] {
                let found = run.hinged(vec![Pose::identity(), start, scene.truth(2)])[1];
                for z in [0.05, 0.31] {
                    let end = Point3::new(0.0, 0.0, z);
                    let off_m = (found * end - scene.truth(1) * end).norm();
                    assert!(off_m < 0.01, "{off_m}");
                }
            }
        });
    }
}
