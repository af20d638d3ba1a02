//! Boxes with analytic distance and color in two states, seen by a ring of cameras.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::{
    neural::{
        optimise::ArticulationProblem,
        state_model::{StateModel, SurfaceRay, Volume},
    },
    observations::LiftedMatch,
};
use geometry::{Grid3, Intrinsics, Pose, SceneBox};
use numeric::random::{stage_rng, unit_uniform};
use surface::{ColorField, ColorSample};

pub const TRUNCATION_M: f64 = 0.03;

/// A box in its own frame and its pose in the world.
#[derive(Clone, Copy)]
pub struct Block {
    pub half: Vector3<f64>,
    pub pose: Pose,
}

impl Block {
    fn sdf(&self, world: &Point3<f64>) -> f64 {
        let q = self.pose.inverse_transform_point(world).coords.abs() - self.half;
        q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
    }
}

/// Blocks of one state; block `i` is part `i`.
pub struct Shape {
    pub blocks: Vec<Block>,
}

impl Shape {
    pub fn nearest(&self, world: &Point3<f64>) -> (usize, f64) {
        let all = self.blocks.iter().map(|b| b.sdf(world)).enumerate();
        all.fold((0, f64::INFINITY), |best, x| if x.1 < best.1 { x } else { best })
    }

    /// Depth along a ray whose direction has the given length per unit of depth.
    fn hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let mut t = 0.0;
        for _ in 0..200 {
            let d = self.nearest(&(origin + direction * t)).1;
            if d < 1e-6 {
                return Some(t);
            }
            t += d / direction.norm();
            if t > 5.0 {
                return None;
            }
        }
        None
    }
}

impl ColorField for Shape {
    fn colors(&self, points: &[Point3<f64>], _: &[Vector3<f64>]) -> Vec<ColorSample> {
        let sample = |p: &Point3<f64>| {
            let block = &self.blocks[self.nearest(p).0];
            let local = block.pose.inverse_transform_point(p).coords * 20.0;
            let rgb = local.map(|v| 0.5 + 0.3 * v.sin()).cast();
            let slope = Matrix3::from_diagonal(&local.map(|v| 6.0 * v.cos()));
            let jacobian = (slope * block.pose.rotation.to_rotation_matrix().matrix().transpose()).cast();
            ColorSample { rgb, jacobian }
        };
        points.iter().map(sample).collect()
    }
}

/// Everything that a problem borrows.
pub struct TestScene {
    pub shapes: [Shape; 2],
    pub motions: Vec<Pose>,
    pub scene: SceneBox,
    sdf: [Grid3<f32>; 2],
    visible: [Grid3<bool>; 2],
    rays: [Vec<SurfaceRay>; 2],
    cameras: Vec<(Intrinsics, Pose)>,
    pub matches: Vec<LiftedMatch>,
}

fn ring() -> Vec<(Intrinsics, Pose)> {
    let k = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };
    let camera = |i: usize| {
        let angle = i as f64 * std::f64::consts::TAU / 10.0;
        let eye =
            Point3::new(1.0 * angle.cos(), 1.0 * angle.sin(), if i.is_multiple_of(2) { 0.7 } else { 0.25 });
        let z = (Point3::new(0.0, 0.0, 0.05) - eye).normalize();
        let x = z.cross(&Vector3::z()).normalize();
        let rotation = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let rotation = nalgebra::UnitQuaternion::from_matrix(&rotation);
        (k, Pose::from_parts(eye.coords.into(), rotation))
    };
    (0..10).map(camera).collect()
}

impl TestScene {
    /// `blocks` in state 0 and how each moves (`state1_from_state0`).
    pub fn new(blocks: Vec<Block>, motions: Vec<Pose>, nodes: usize) -> Self {
        let moved = blocks.iter().zip(&motions).map(|(b, m)| Block { pose: m * b.pose, ..*b }).collect();
        let shapes = [Shape { blocks }, Shape { blocks: moved }];
        let scene = SceneBox::around_box(&Point3::new(-0.28, -0.28, -0.12), &Point3::new(0.28, 0.28, 0.35));
        let cameras = ring();
        let sdf = shapes.each_ref().map(|shape| {
            let mut grid = Grid3::over_scene(&scene, nodes, 0.0f32);
            for i in 0..grid.values.len() {
                grid.values[i] = shape.nearest(&grid.position_of_index(i)).1 as f32;
            }
            grid
        });
        let sees = |shape: &Shape, camera: &(Intrinsics, Pose), x: &Point3<f64>| {
            let offset = x - camera.1.translation.vector;
            let local = camera.1.inverse_transform_point(x);
            camera.0.pixel_of(&local).is_some()
                && shape
                    .hit(&camera.1.translation.vector.into(), &(offset.coords / local.z))
                    .is_none_or(|d| local.z <= d + TRUNCATION_M)
        };
        let visible = shapes.each_ref().map(|shape| {
            let mut grid = Grid3::over_scene(&scene, 29, false);
            for i in 0..grid.values.len() {
                let x = grid.position_of_index(i);
                grid.values[i] = cameras.iter().any(|c| sees(shape, c, &x));
            }
            grid
        });
        let rays = shapes.each_ref().map(|shape| cast(shape, &cameras));
        let mut all = Self { shapes, motions, scene, sdf, visible, rays, cameras, matches: Vec::new() };
        all.matches = all.true_matches();
        all
    }

    /// Points seen in both states, with pixels of the cameras that see them.
    fn true_matches(&self) -> Vec<LiftedMatch> {
        let mut found = Vec::new();
        for ray in self.rays[0].iter().step_by(7) {
            let point0 = ray.origin + ray.direction * ray.depth_m;
            let point1 = self.motions[self.shapes[0].nearest(&point0).0] * point0;
            let other = self.cameras.iter().enumerate().find_map(|(frame, (k, pose))| {
                let local = pose.inverse_transform_point(&point1);
                let pixel = k.pixel_of(&local).and(k.project(&local))?;
                let origin = Point3::from(pose.translation.vector);
                let depth = self.shapes[1].hit(&origin, &((point1 - origin) / local.z))?;
                ((depth - local.z).abs() < 1e-4).then_some((frame, pixel))
            });
            let Some((frame1, (u, v))) = other else { continue };
            let (k, pose) = &self.cameras[ray.frame];
            let Some((u0, v0)) = k.project(&pose.inverse_transform_point(&point0)) else { continue };
            let pixels = [[u0 as f32, v0 as f32], [u as f32, v as f32]];
            found.push(LiftedMatch { point0, point1, sigma_m: 0.001, frames: [ray.frame, frame1], pixels });
        }
        found
    }

    pub fn model(&self, state: usize) -> StateModel<'_> {
        StateModel {
            sdf: &self.sdf[state],
            visible: &self.visible[state],
            color: &self.shapes[state],
            rays: &self.rays[state],
            cameras: &self.cameras,
        }
    }

    pub fn problem<'a>(&'a self, matches: &'a [LiftedMatch]) -> ArticulationProblem<'a> {
        ArticulationProblem {
            states: [self.model(0), self.model(1)],
            matches,
            scene: self.scene,
            truncation_m: TRUNCATION_M,
            parts: self.motions.len(),
        }
    }

    pub fn volume(&self, state: usize) -> Volume<'_> {
        Volume {
            model: self.model(state),
            scene: self.scene,
            truncation_m: TRUNCATION_M,
            ramp_m: self.sdf[state].spacing_m,
        }
    }

    /// Surface points of a state with their true part.
    pub fn labelled(&self, state: usize) -> (Vec<Point3<f64>>, Vec<u8>) {
        let points: Vec<Point3<f64>> =
            self.rays[state].iter().map(|r| r.origin + r.direction * r.depth_m).collect();
        let labels = points.iter().map(|p| self.shapes[state].nearest(p).0 as u8).collect();
        (points, labels)
    }
}

fn cast(shape: &Shape, cameras: &[(Intrinsics, Pose)]) -> Vec<SurfaceRay> {
    let mut rays = Vec::new();
    let mut rng = stage_rng(11, "test/rays", 0);
    for (frame, (k, pose)) in cameras.iter().enumerate() {
        for _ in 0..3000 {
            let u = unit_uniform(&mut rng) * k.width as f64;
            let v = unit_uniform(&mut rng) * k.height as f64;
            let origin = Point3::from(pose.translation.vector);
            let direction = pose.rotation * k.ray_at(u, v);
            if let Some(depth_m) = shape.hit(&origin, &direction) {
                rays.push(SurfaceRay { origin, direction, depth_m, frame, rgb: [0.5; 3] });
            }
        }
    }
    rays
}

/// A static block and one that stands on it, turned or shifted.
pub fn two_blocks(motion: Pose, nodes: usize) -> TestScene {
    let base = Block { half: Vector3::new(0.2, 0.15, 0.05), pose: Pose::translation(-0.04, 0.0, -0.05) };
    let lid = Block { half: Vector3::new(0.07, 0.1, 0.06), pose: Pose::translation(0.05, 0.02, 0.075) };
    TestScene::new(vec![base, lid], vec![Pose::identity(), motion], nodes)
}
