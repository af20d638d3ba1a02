//! A joint's effects as the numbers of a format, and notes on what became of each effect.

use gap::{
    judge::{
        format_model::{FormatModel, HeldEffect},
        report::{ExportNote, ExportStatus, Held, HeldParameter, JointReport},
        verdict::Verdict,
    },
    model::{
        format::{Format, JointNumbers},
        joint_model::{Catalogue, Term},
    },
    twin_tree::TwinJoint,
};

/// Why the links of a joint, and with them the twin's values, stay as they are.
pub(super) const UNTURNED: &str = "the links of this joint cannot be turned as was found";

/// The model of a joint in a format; `None` if no effect was named.
pub fn held(format: Format, joint: &JointReport) -> Option<&FormatModel> {
    joint.in_format.iter().find(|m| m.format == format)
}

/// The numbers of a joint in a format; `None` if it keeps those of the twin.
pub fn joint_numbers(
    format: Format,
    spec: &TwinJoint,
    joint: &JointReport,
    catalogue: &Catalogue,
) -> Option<JointNumbers> {
    let terms = &held(format, joint).filter(|h| !h.model.terms.is_empty())?.model.terms;
    let mut numbers = JointNumbers::without_effects(spec.damping, spec.friction);
    terms.iter().for_each(|t| catalogue[t.effect].add_to_numbers(&t.p, &mut numbers));
    Some(numbers)
}

/// Name of the file that represents a joint in a format; `None` if there is none.
pub fn exported_file<'a>(
    joint: &JointReport,
    held: &FormatModel,
    exports: &'a [ExportNote],
) -> Option<&'a str> {
    let mut notes = exports.iter().filter(|e| e.joint == joint.joint && e.format == held.format.name());
    notes.find(|e| !e.file.is_empty()).map(|e| e.file.as_str())
}

/// What became of every effect of a joint in a file.
pub fn notes(format: Format, file: &str, joint: &JointReport, catalogue: &Catalogue) -> Vec<ExportNote> {
    let effects = held(format, joint).into_iter().flat_map(|m| m.effects.iter().map(move |e| (m, e)));
    effects.map(|(m, e)| note(m, e, file, joint, catalogue)).collect()
}

/// The same if there is no file, or the file leaves the joint as it was; `why` gives the reason.
pub fn missing(format: Format, joint: &JointReport, catalogue: &Catalogue, why: &str) -> Vec<ExportNote> {
    let not_written =
        |note| ExportNote { status: ExportStatus::NotWritten(why.to_owned()), by: Vec::new(), ..note };
    notes(format, "", joint, catalogue).into_iter().map(not_written).collect()
}

/// Parameters of a term under the names and units of a report.
fn held_term(term: &Term, turns: bool, catalogue: &Catalogue) -> Held {
    let effect = &catalogue[term.effect];
    let reported = effect.reported_parameters(&term.p).into_iter();
    let parameters = reported
        .map(|r| HeldParameter {
            name: r.name.into(),
            value: r.value,
            unit: r.dimension.unit_name(turns).into(),
        })
        .collect();
    Held { effect: effect.name().into(), parameters }
}

/// What became of an effect in a file; the residuals are those of the joint with all effects in the file.
fn note(
    held: &FormatModel,
    effect: &HeldEffect,
    file: &str,
    joint: &JointReport,
    catalogue: &Catalogue,
) -> ExportNote {
    ExportNote {
        format: held.format.name().into(),
        file: file.into(),
        joint: joint.joint.clone(),
        effect: effect.effect.map_or(Verdict::Unknown.name(), |e| catalogue[e].name()).into(),
        status: ExportStatus::InFile(effect.fate.name()),
        by: effect.by.iter().map(|term| held_term(term, joint.turns, catalogue)).collect(),
        rmse: Some(held.rmse),
        before: Some(held.twin_rmse),
    }
}
