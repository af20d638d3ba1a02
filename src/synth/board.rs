//! A printed tag board on the floor in front of an object.

use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};

use super::{BoundingSphere, Material, Object, Solid, SynthConfig, workspace::whole_way};
use capture::{BoardLayout, Paper};
use geometry::Pose;

/// Thickness of the plate below the sheet, meters. chosen: a usual panel
const THICK_M: f64 = 0.003;
/// Gap between the sheet and the space the object can reach, meters. chosen: nothing touches the sheet
const GAP_M: f64 = 0.02;
/// Reflectance of paper and of ink. chosen: white office paper, and its black print
const PAPER: f64 = 0.8;
const INK: f64 = 0.04;

/// A tag board and its pose.
#[derive(Clone, Debug)]
pub struct Board {
    /// Print on the board.
    pub layout: BoardLayout,
    /// Pose of the board's frame in the true world.
    pub world_from_board: Pose,
    pub(super) solid: Solid,
}

impl Board {
    /// The board of a configuration: level, in front of an object, with its upper edge towards the object.
    pub fn of_config(object: &Object, config: &SynthConfig) -> Option<Self> {
        config.board.map(|paper| Self::before_object(object, paper))
    }

    fn before_object(object: &Object, paper: Paper) -> Self {
        let layout = BoardLayout::of_paper(paper);
        let [low, high] = layout.sheet_corners();
        let [lower, upper] = whole_way(object);
        let foot = object.world_from_rest.translation.vector;
        let front = object.world_from_rest.rotation * Vector3::x();
        let front = Vector3::new(front.x, front.y, 0.0).normalize();
        // Beyond the front plane of the box around the object's reach.
        let half = (upper - lower) * 0.5;
        let away_m = half.x * front.x.abs() + half.y * front.y.abs() + GAP_M + high.y;
        let center = nalgebra::center(&lower, &upper);
        let at = Vector3::new(center.x, center.y, foot.z + THICK_M) + front * away_m;
        let axes = Matrix3::from_columns(&[(-front).cross(&Vector3::z()), -front, Vector3::z()]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let world_from_board = Pose::from_parts(at.into(), turn);
        let paper = Material::plain(Vector3::repeat(PAPER));
        let plate = Solid::box_between([low.x, low.y, -THICK_M], [high.x, high.y, 0.0], &paper);
        let solid = Solid { part_from_solid: world_from_board * plate.part_from_solid, ..plate };
        Self { layout, world_from_board, solid }
    }

    /// Linear color of the sheet at a world point.
    pub(super) fn color_at(&self, point: &Point3<f64>) -> Vector3<f64> {
        let at = self.world_from_board.inverse_transform_point(point);
        Vector3::repeat(if self.layout.is_black(&Point2::new(at.x, at.y)) { INK } else { PAPER })
    }

    /// Corners of the sheet in the world.
    pub(super) fn sheet_corners(&self) -> [Point3<f64>; 4] {
        let [low, high] = self.layout.sheet_corners();
        [[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]]
            .map(|[x, y]| self.world_from_board * Point3::new(x, y, 0.0))
    }

    /// A sphere around another sphere and the board.
    pub(super) fn sphere_with(&self, mut sphere: BoundingSphere) -> BoundingSphere {
        for corner in self.sheet_corners() {
            let away = corner - sphere.center;
            let over_m = 0.5 * (away.norm() - sphere.radius_m);
            if over_m > 0.0 {
                sphere.center += away.normalize() * over_m;
                sphere.radius_m += over_m;
            }
        }
        sphere
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate;

    #[test]
    fn the_board_lies_on_the_floor_beside_all_that_moves() {
        for seed in 0..6 {
            let config = SynthConfig { seed, board: Some(Paper::A3), ..SynthConfig::default() };
            let object = generate(&config).unwrap();
            let board = Board::of_config(&object, &config).unwrap();
            let [lower, upper] = whole_way(&object);
            let floor_m = object.world_from_rest.translation.vector.z;
            let front = object.world_from_rest.rotation * Vector3::x();
            let reach = |p: &Point3<f64>| p.coords.dot(&front);
            let box_m = [lower.x, upper.x]
                .iter()
                .flat_map(|x| [lower.y, upper.y].map(|y| reach(&Point3::new(*x, y, 0.0))))
                .fold(f64::MIN, f64::max);
            for corner in board.sheet_corners() {
                assert!((corner.z - floor_m - THICK_M).abs() < 1e-12);
                assert!(reach(&corner) > box_m);
            }
            let BoundingSphere { center, radius_m } = board.sphere_with(object.bounding_sphere());
            assert!(board.sheet_corners().iter().all(|c| (c - center).norm() < radius_m + 1e-9));
            assert_eq!(Board::of_config(&object, &SynthConfig::default()).map(|_| ()), None);
        }
    }
}
