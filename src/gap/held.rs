//! What SDF and USD hold of a joint's effects: numbers of the joint, taken from the model as the format expresses it.

use super::{
    expressed::{Format, expressed, status},
    joint_model::Catalogue,
    report::{ExportNote, JointReport},
    twin_tree::TwinJoint,
    update::{exported, note},
};

/// A stop as a format without a soft one has it, or a soft one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldStop {
    /// At the high end.
    pub is_upper: bool,
    /// Position, rad or m.
    pub position: f64,
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
}

/// Numbers of one joint with its effects; efforts in N m or N, angles in radians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Held {
    /// Viscous damping.
    pub damping: f64,
    /// Friction while it slides.
    pub friction: f64,
    /// Friction that it breaks loose from.
    pub breakaway: f64,
    /// Stiffness and rest position of a spring, where there is one.
    pub spring: Option<(f64, f64)>,
    /// Inertia beside that of the links.
    pub armature: f64,
    /// Stops.
    pub stops: Vec<HeldStop>,
}

impl Held {
    /// Of a joint in a format; `None` where no effect changes it.
    #[must_use]
    pub fn of(format: Format, spec: &TwinJoint, joint: &JointReport, catalogue: &Catalogue) -> Option<Self> {
        exported(joint).next()?;
        let model = &joint.diagnosis.model;
        let mut held = Self { damping: spec.damping, friction: spec.friction, ..Self::default() };
        for term in &expressed(format, model, catalogue).terms {
            let p = &term.p;
            match catalogue[term.effect].name() {
                "viscous_friction" => held.damping = (held.damping + p[0]).max(0.0),
                "coulomb_friction" => held.friction += p[0],
                "spring_return" => held.spring = Some((p[0], p[1] / p[0])),
                "inertia" => held.armature += p[0],
                "end_stop" => held.stops.push(HeldStop {
                    is_upper: catalogue[term.effect].is_upper(),
                    position: p[2],
                    stiffness: p[0],
                    damping: p[1],
                }),
                _ => {}
            }
        }
        let excess = model.terms.iter().find(|t| catalogue[t.effect].name() == "stribeck_friction").map_or(0.0, |t| t.p[1]);
        held.breakaway = held.friction + excess;
        Some(held)
    }
}

/// What became of every effect of a joint in a format; `missing` says why there is no file.
pub fn notes(format: Format, file: &str, joint: &JointReport, missing: Option<&str>) -> Vec<ExportNote> {
    let one = |finding: &super::verdict::Finding| {
        let model = &joint.diagnosis.model;
        let term = model.terms.iter().find(|t| t.effect == finding.index)?;
        let mut note = note(format.name(), file, joint, &finding.effect, status(format, &finding.effect, &term.p, &model.plant));
        if let Some(why) = missing {
            (note.file, note.status) = (String::new(), format!("not written: {why}"));
        }
        Some(note)
    };
    exported(joint).filter_map(one).collect()
}
