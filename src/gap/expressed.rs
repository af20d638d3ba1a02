//! What of a model a file format can hold: the same, the nearest expression, or nothing.

use super::{
    joint_model::{Catalogue, JointModel, Term},
    plant::Plant,
    twin_tree::TwinTree,
};
use crate::geometry::Pose;

/// A file format that effects are written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// URDF.
    Urdf,
    /// MJCF.
    Mjcf,
    /// SDF.
    Sdf,
    /// USD with the attributes of PhysX and Newton.
    Usd,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Urdf, Self::Mjcf, Self::Sdf, Self::Usd];

    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Mjcf => "mjcf",
            Self::Sdf => "sdf",
            Self::Usd => "usd",
        }
    }
}

/// How near a format comes to an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It has the effect.
    Native,
    /// It has something like it.
    Approximated,
    /// It has nothing like it.
    NotExpressible,
}

impl Status {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Approximated => "approximated",
            Self::NotExpressible => "not expressible",
        }
    }
}

/// How a format expresses an effect at a joint of the twin.
#[must_use]
pub fn status(format: Format, effect: &str, p: &[f64], plant: &Plant) -> Status {
    match (format, effect) {
        (_, "viscous_friction") if plant.damping + p[0] >= 0.0 => Status::Native,
        (_, "coulomb_friction") => Status::Native,
        (Format::Mjcf, "inertia") if p[0] < 0.0 => Status::NotExpressible,
        (Format::Mjcf, "delay") if p[0] < 0.0 => Status::NotExpressible,
        (Format::Mjcf, "spring_return" | "hardening_spring" | "inertia" | "constant_bias" | "torque_gain" | "quadratic_drag" | "delay") => {
            Status::Native
        }
        (Format::Mjcf, "encoder_bias" | "end_stop") => Status::Native,
        (Format::Mjcf | Format::Sdf | Format::Usd, "axis_tilt") => Status::Native,
        (Format::Mjcf, "asymmetric_friction" | "stribeck_friction") => Status::Approximated,
        (Format::Sdf | Format::Usd, "spring_return") if p[0] > 0.0 => Status::Native,
        (Format::Usd, "inertia") if p[0] > 0.0 => Status::Native,
        (Format::Sdf | Format::Usd, "asymmetric_friction" | "stribeck_friction" | "end_stop") => Status::Approximated,
        (Format::Sdf | Format::Usd, "hardening_spring") if p[0] > 0.0 => Status::Approximated,
        _ => Status::NotExpressible,
    }
}

/// The model as a format holds it, in effects of the catalogue.
#[must_use]
pub fn expressed(format: Format, model: &JointModel, catalogue: &Catalogue) -> JointModel {
    let of = |name: &str| catalogue.iter().position(|e| e.name() == name);
    let mut held = JointModel { terms: Vec::new(), ..model.clone() };
    for term in &model.terms {
        let name = catalogue[term.effect].name();
        let nearest: Vec<(&str, Vec<f64>)> = match (status(format, name, &term.p, &model.plant), name) {
            (Status::Native, _) => vec![(name, term.p.clone())],
            (Status::Approximated, "asymmetric_friction") if format != Format::Mjcf => {
                vec![("coulomb_friction", vec![0.5 * (term.p[0] + term.p[1])])]
            }
            (Status::Approximated, "asymmetric_friction") => {
                vec![("coulomb_friction", vec![0.5 * (term.p[0] + term.p[1])]), ("constant_bias", vec![0.5 * (term.p[1] - term.p[0])])]
            }
            (Status::Approximated, "stribeck_friction") => vec![("coulomb_friction", vec![term.p[0]])],
            (Status::Approximated, "hardening_spring") => vec![("spring_return", vec![term.p[0], term.p[0] * term.p[2]])],
            (Status::Approximated, "end_stop") => {
                held.terms.push(Term { effect: term.effect, p: nearest_stop(format, &term.p, model.plant.inertia) });
                Vec::new()
            }
            (Status::Approximated, _) => {
                held.terms.push(term.clone());
                Vec::new()
            }
            (Status::NotExpressible, _) => Vec::new(),
        };
        held.terms.extend(nearest.into_iter().filter_map(|(n, p)| of(n).map(|effect| Term { effect, p })));
    }
    held
}

/// A stop as a format has it: SDF without the share of a rigid stop behind the soft one, USD as a limit, which is as stiff as the
/// rollout resolves.
fn nearest_stop(format: Format, p: &[f64], inertia: f64) -> Vec<f64> {
    match format {
        Format::Usd => vec![inertia * STIFF_RATE * STIFF_RATE, inertia * STIFF_RATE, p[2], 0.0],
        _ => vec![p[0], p[1], p[2], 0.0],
    }
}

/// Rate of a stop that counts as rigid, 1/s.
const STIFF_RATE: f64 = 200.0;

/// Pose of a joint, turned as little as possible, at which gravity loads it by `sine sin(q) + cosine cos(q)` less than
/// the twin; `None` where no turn does that.
#[must_use]
pub fn tilted(tree: &TwinTree, joint: usize, sine: f64, cosine: f64) -> Option<Pose> {
    let plant = Plant::of(tree, joint).ok()?;
    let wanted = (plant.load.sine - sine, plant.load.cosine - cosine);
    let scale = wanted.0.hypot(wanted.1).max(plant.load.amplitude());
    let mut tree = tree.clone();
    let given = tree.joints[joint].parent_from_joint;
    let mut turn = nalgebra::Vector3::zeros();
    let mut miss = |turn: &nalgebra::Vector3<f64>| {
        tree.joints[joint].parent_from_joint =
            nalgebra::Isometry3::from_parts(given.translation, nalgebra::UnitQuaternion::from_scaled_axis(*turn) * given.rotation);
        let load = Plant::of(&tree, joint).map(|p| p.load).unwrap_or_default();
        nalgebra::Vector2::new(wanted.0 - load.sine, wanted.1 - load.cosine)
    };
    for _ in 0..30 {
        let now = miss(&turn);
        if now.norm() < 1e-7 * scale {
            return Some(Pose::from_parts(given.translation, nalgebra::UnitQuaternion::from_scaled_axis(turn) * given.rotation));
        }
        let step = 1e-6;
        let column = |axis: usize, miss: &mut dyn FnMut(&nalgebra::Vector3<f64>) -> nalgebra::Vector2<f64>| {
            let mut other = turn;
            other[axis] += step;
            (now - miss(&other)) / step
        };
        let j = nalgebra::Matrix2x3::from_columns(&[column(0, &mut miss), column(1, &mut miss), column(2, &mut miss)]);
        let least = j.transpose() * (j * j.transpose()).try_inverse()? * now;
        turn += least * (0.3 / least.norm().max(0.3));
    }
    None
}
