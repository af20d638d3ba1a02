//! Textured boxes of which some slide or turn, as a made recording with its truth.

#![allow(dead_code, reason = "every test binary uses its own part of this")]
#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use std::path::Path;

use geometry::{AxisMotion, Pose};
use io::write_synth_bag;
use model::{ArticulatedModel, JointKind};
use nalgebra::{Point3, Unit, Vector3};
use synth::{Family, Material, Object, Solid, SynthConfig, film_take, generate};

use super::objects::{box_mesh, joint, link, write_truth};

/// A box that moves on the static one.
pub struct MovingBox {
    /// Name in the truth.
    pub name: &'static str,
    /// How it moves.
    pub kind: JointKind,
    /// Direction of the axis.
    pub axis: [f64; 3],
    /// A point of the axis, meters.
    pub origin: [f64; 3],
    /// Lower and upper corner with the joint at 0, meters.
    pub corners: [[f64; 3]; 2],
    /// Position in both states, meters or radians.
    pub positions: [f64; 2],
}

/// A static box, boxes that move on it, and how they are filmed.
pub struct BoxScene<'a> {
    /// Lower and upper corner of the static box, meters.
    pub still: [[f64; 3]; 2],
    /// The boxes that move.
    pub moving: &'a [MovingBox],
    /// Longest wavelength of the textures, meters.
    pub wavelength_m: f64,
    /// Views of each state.
    pub views: usize,
}

/// Size of the images, pixels.
const WIDTH: usize = 160;
const HEIGHT: usize = 120;

impl BoxScene<'_> {
    /// Films both states and writes the recording and its truth into a folder.
    pub fn write(&self, folder: &Path) {
        let synth = SynthConfig {
            seed: 17,
            parts: Some(self.moving.len() + 1),
            family: Some(Family::Cabinet),
            textured: Some(true),
            views: self.views,
            width: WIDTH,
            height: HEIGHT,
            ..SynthConfig::default()
        };
        let object = self.object(&synth);
        for state in 0..2 {
            let bag = folder.join(format!("state{state}"));
            write_synth_bag(&bag, state, &film_take(&object, state, state, &synth)).unwrap();
        }
        write_truth(&self.model(), folder);
    }

    /// A made cabinet whose parts are replaced by the boxes.
    fn object(&self, synth: &SynthConfig) -> Object {
        let mut object = generate(synth).unwrap();
        object.world_from_rest = Pose::identity();
        let [lower, upper] = self.still;
        object.parts[0].solids = vec![Solid::box_between(lower, upper, &self.material(0))];
        for (k, moving) in self.moving.iter().enumerate() {
            let part = &mut object.parts[k + 1];
            let [lower, upper] = moving.corners;
            part.solids = vec![Solid::box_between(lower, upper, &self.material(k + 1))];
            let part_joint = part.joint.as_mut().unwrap();
            part_joint.parent = 0;
            part_joint.kind = match moving.kind {
                JointKind::Prismatic => AxisMotion::Prismatic,
                _ => AxisMotion::Revolute,
            };
            part_joint.axis = Unit::new_normalize(moving.axis.into());
            part_joint.origin = Point3::from(moving.origin);
            part_joint.positions = moving.positions;
        }
        object
    }

    /// A texture of a color of its own for every part.
    fn material(&self, part: usize) -> Material {
        let base = [[0.7, 0.35, 0.25], [0.2, 0.5, 0.75], [0.65, 0.65, 0.2]][part % 3];
        Material {
            base: base.into(),
            second: Vector3::from(base) * 0.25,
            wavelength_m: Some(Vector3::repeat(self.wavelength_m)),
            seed: 40 + part as u32,
            lacquer: None,
            sheen: 0.0,
        }
    }

    /// The boxes as the model that is true.
    fn model(&self) -> ArticulatedModel {
        let [lower, upper] = self.still;
        let mut model = ArticulatedModel {
            name: "boxes".into(),
            links: vec![link("base", box_mesh(lower, upper, [128; 3], 4), 1.0)],
            joints: Vec::new(),
            states: vec![Vec::new(), Vec::new()],
        };
        for (k, moving) in self.moving.iter().enumerate() {
            let [lower, upper] = moving.corners;
            let from = Vector3::from(moving.origin);
            let to_joint = Pose::translation(-from.x, -from.y, -from.z);
            let mesh = box_mesh(lower, upper, [128; 3], 4).transformed(&to_joint);
            model.links.push(link(moving.name, mesh, 1.0));
            let at = Pose::translation(from.x, from.y, from.z);
            let [q0, q1] = moving.positions;
            let range = [q0.min(q1), q0.max(q1)];
            model.joints.push(joint(moving.name, moving.kind, 0, k + 1, at, moving.axis, range));
            model.states[0].push(q0);
            model.states[1].push(q1);
        }
        model
    }
}
