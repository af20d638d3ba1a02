//! `effects.json`: the found effects of every joint as laws with their numbers, and those that the file of
//! each format holds (docs/effects.md). Beside a file the found laws are applied, and what the file holds in
//! their place is taken back.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::diagnosed::numbers::exported_file;
use gap::{
    judge::report::{ExportNote, JointReport},
    model::{
        effect::{Dimension, RUN_SPACING_S},
        joint_model::{CREEP, Catalogue, Term},
    },
    twin_tree::{Motion, TwinTree},
};

/// Name and version of the layout. Another version means other keys or other equations.
pub const LAYOUT: &str = "artitwin-effects/1";

/// Content of `effects.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectsFile {
    /// [`LAYOUT`].
    pub format: String,
    /// Joints with effects, in the order of the report.
    pub joints: Vec<JointLaw>,
}

/// The effects of one joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLaw {
    /// Name of the joint in all files.
    pub joint: String,
    /// Whether it turns or slides.
    #[serde(rename = "type")]
    pub kind: LawKind,
    /// Time in which friction brings the joint to rest, seconds; 0 is exact sticking.
    pub settle_time_s: f64,
    /// Share of the other efforts that still moves a joint held by friction with a settle time.
    pub creep_share: f64,
    /// Damping and friction of the twin, which every file holds beside the effects.
    pub twin: Vec<EffectLaw>,
    /// The found effects.
    pub effects: Vec<EffectLaw>,
    /// What files hold; a file that is not listed holds none of the effects.
    pub files: Vec<HeldLaws>,
}

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    /// It turns: positions in radians, efforts in N m.
    Revolute,
    /// It slides: positions in meters, efforts in N.
    Prismatic,
}

/// An end of a joint's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawEnd {
    /// The lowest position.
    Lower,
    /// The highest position.
    Upper,
}

/// An effect with its numbers. Its equation is that of its file in `src/gap/model/effects`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectLaw {
    /// Name of the effect.
    pub effect: String,
    /// The end of the range at which a stop stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<LawEnd>,
    /// The other joint of a coupling.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_joint: Option<String>,
    /// The only run in which it acted, for an effect that is no property of the joint; times are then
    /// seconds from the start of that run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Value of each parameter by its name with its unit, such as `damping_Nms_per_rad`.
    pub parameters: BTreeMap<String, f64>,
}

/// The effects in the file of one format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldLaws {
    /// `urdf`, `mjcf`, `sdf` or `usd`.
    pub format: String,
    /// Name of the file beside `effects.json`.
    pub file: String,
    /// Its effects at the joint: those found, nearest ones, or others in their place.
    pub holds: Vec<EffectLaw>,
}

/// What names the joints and effects of a diagnosis.
#[derive(Clone, Copy, Debug)]
pub struct LawNames<'a> {
    /// The twin.
    pub tree: &'a TwinTree,
    /// Names of the joints that move in the runs, in the twin's order.
    pub moving: &'a [String],
    /// The effects.
    pub catalogue: &'a Catalogue,
}

/// The laws of all joints with effects; `exports` are the notes on the files that were written.
pub fn effects_file(names: &LawNames, joints: &[JointReport], exports: &[ExportNote]) -> EffectsFile {
    let with_effects = joints.iter().filter(|j| !j.diagnosis.findings.is_empty());
    let joints = with_effects.map(|joint| names.joint_law(joint, exports)).collect();
    EffectsFile { format: LAYOUT.to_owned(), joints }
}

impl LawNames<'_> {
    fn joint_law(&self, joint: &JointReport, exports: &[ExportNote]) -> JointLaw {
        let model = &joint.diagnosis.model;
        let mut effects = self.laws_of_terms(joint, &model.terms);
        for (law, term) in effects.iter_mut().zip(&model.terms) {
            if self.catalogue[term.effect].is_of_one_run() {
                with_run(law, joint);
            }
        }
        let mut files = Vec::new();
        for held in &joint.in_format {
            if let Some(file) = exported_file(joint, held, exports) {
                let holds = self.laws_of_terms(joint, &held.model.terms);
                files.push(HeldLaws { format: held.format.name().to_owned(), file: file.to_owned(), holds });
            }
        }
        let own = [("viscous_friction", model.plant.damping), ("coulomb_friction", model.plant.friction)];
        let mut twin = Vec::with_capacity(own.len());
        for (name, value) in own {
            let index = self.catalogue.iter().position(|e| e.name() == name);
            let terms = index.map(|effect| Term { effect, p: vec![value] });
            twin.extend(self.laws_of_terms(joint, terms.as_slice()));
        }
        JointLaw {
            joint: joint.joint.clone(),
            kind: if joint.turns { LawKind::Revolute } else { LawKind::Prismatic },
            settle_time_s: model.settle_s,
            creep_share: CREEP,
            twin,
            effects,
            files,
        }
    }

    fn is_turning(&self, joint: &str) -> bool {
        self.tree.joints.iter().any(|j| j.name == joint && j.motion == Motion::Turn)
    }

    fn laws_of_terms(&self, joint: &JointReport, terms: &[Term]) -> Vec<EffectLaw> {
        let mut laws = Vec::with_capacity(terms.len());
        for term in terms {
            let mut others = self.moving.iter().filter(|name| **name != joint.joint);
            let other = self.catalogue[term.effect].other_joint().and_then(|index| others.nth(index));
            let other = other.map(|name| (name.as_str(), self.is_turning(name)));
            laws.push(EffectLaw::of_term(self.catalogue, term, joint.turns, other));
        }
        laws
    }
}

impl EffectLaw {
    /// A term at a turning or sliding joint; `other` is the joint that it couples to, and whether that turns.
    pub fn of_term(catalogue: &Catalogue, term: &Term, turns: bool, other: Option<(&str, bool)>) -> Self {
        let effect = &catalogue[term.effect];
        let mut parameters = BTreeMap::new();
        for (parameter, value) in effect.parameters().iter().zip(&term.p) {
            let mut key = parameter.name.to_owned() + &unit_suffix(parameter.dimension.unit_name(turns));
            // An effort for each unit of the other joint's position.
            if let Some((_, other_turns)) = other.filter(|_| parameter.name.starts_with("other_")) {
                key = key + "_per_" + Dimension::Position.unit_name(other_turns);
            }
            parameters.insert(key, *value);
        }
        let other_joint = other.map(|(name, _)| name.to_owned());
        let end = if effect.is_upper() { LawEnd::Upper } else { LawEnd::Lower };
        let end = effect.contact_parameter().map(|_| end);
        Self { effect: effect.name().to_owned(), end, other_joint, run: None, parameters }
    }
}

/// Names the run of a push, and counts its time from the start of that run.
fn with_run(law: &mut EffectLaw, joint: &JointReport) {
    if let Some(time_s) = law.parameters.get_mut("time_s") {
        let run = (*time_s / RUN_SPACING_S).round();
        *time_s -= run * RUN_SPACING_S;
        // The fitted runs come first among the tracks.
        law.run = joint.tracks.get(run as usize).map(|track| track.run.clone());
    }
}

/// A unit as the end of a name: `N m s/rad` is `_Nms_per_rad`; a pure number has none.
fn unit_suffix(unit: &str) -> String {
    if unit == "1" {
        return String::new();
    }
    format!("_{}", unit.replace([' ', '^'], "").replace('/', "_per_"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gap::model::effects::catalogue;

    fn law(name: &str, p: &[f64], turns: bool, other: Option<(&str, bool)>) -> EffectLaw {
        let all = catalogue(1);
        let effect = all.iter().position(|e| e.name() == name).unwrap();
        EffectLaw::of_term(&all, &Term { effect, p: p.to_vec() }, turns, other)
    }

    fn keys(law: &EffectLaw) -> Vec<&str> {
        law.parameters.keys().map(String::as_str).collect()
    }

    #[test]
    fn parameters_carry_their_units() {
        assert_eq!(keys(&law("viscous_friction", &[0.5], true, None)), ["damping_Nms_per_rad"]);
        assert_eq!(keys(&law("viscous_friction", &[0.5], false, None)), ["damping_Ns_per_m"]);
        assert_eq!(keys(&law("quadratic_drag", &[0.5], true, None)), ["drag_Nms2_per_rad2"]);
        assert_eq!(keys(&law("torque_gain", &[1.5], true, None)), ["gain"]);
        let coupling = law("coupling", &[3.0, 2.0, 1.0], true, Some(("drawer_joint", false)));
        assert_eq!(keys(&coupling), ["offset_Nm", "other_stiffness_Nm_per_m", "stiffness_Nm_per_rad"]);
        assert_eq!(coupling.parameters["other_stiffness_Nm_per_m"], 2.0);
    }

    #[test]
    fn a_file_is_read_as_it_was_written() {
        let effects = vec![law("detent", &[1.0, 0.4, 0.05], true, None)];
        let holds = vec![law("coulomb_friction", &[0.1], true, None)];
        let written = EffectsFile {
            format: LAYOUT.to_owned(),
            joints: vec![JointLaw {
                joint: "hinge".to_owned(),
                kind: LawKind::Revolute,
                settle_time_s: 0.005,
                creep_share: CREEP,
                twin: vec![law("coulomb_friction", &[0.0], true, None)],
                effects,
                files: vec![HeldLaws { format: "mjcf".to_owned(), file: "twin.xml".to_owned(), holds }],
            }],
        };
        let text = serde_json::to_string(&written).unwrap();
        assert_eq!(serde_json::from_str::<EffectsFile>(&text).unwrap(), written);
        assert!(text.contains("\"type\":\"revolute\"") && !text.contains("null"), "{text}");
    }
}
