//! What a format holds of a joint's effects, as numbers of the joint, and the notes on what became of each.

use crate::gap::{
    judge::{
        report::{ExportNote, JointReport},
        verdict::Finding,
    },
    model::{
        effect::Effect,
        format::{Expression, Format, JointNumbers},
        joint_model::Catalogue,
    },
    twin_tree::TwinJoint,
};

/// A named effect as a format has it.
pub struct Exported<'a> {
    /// What was found.
    pub finding: &'a Finding,
    /// The effect.
    pub effect: &'a dyn Effect,
    /// Its parameters.
    pub p: &'a [f64],
    /// What the format holds of it.
    pub expression: Expression,
}

/// The effects of a joint that leave the recording with the twin.
pub fn exported<'a>(
    format: Format,
    joint: &'a JointReport,
    catalogue: &'a Catalogue,
) -> impl Iterator<Item = Exported<'a>> {
    let model = &joint.diagnosis.model;
    joint.diagnosis.findings.iter().filter_map(move |finding| {
        let effect = catalogue[finding.index].as_ref();
        // What happened in one run is no property of the joint.
        let term = model.terms.iter().find(|t| t.effect == finding.index && !effect.is_of_one_run())?;
        let expression = effect.in_format(format, &term.p, &model.plant);
        Some(Exported { finding, effect, p: &term.p, expression })
    })
}

/// The numbers of a joint in a format; `None` where no effect was named.
#[must_use]
pub fn joint_numbers(
    format: Format,
    spec: &TwinJoint,
    joint: &JointReport,
    catalogue: &Catalogue,
) -> Option<JointNumbers> {
    let mut numbers = JointNumbers::of(spec.damping, spec.friction);
    let mut effects = exported(format, joint, catalogue).peekable();
    effects.peek()?;
    for e in effects.filter(|e| e.expression != Expression::NotExpressible) {
        e.effect.write(e.p, &mut numbers);
    }
    Some(numbers)
}

/// What became of every effect of a joint in a file.
#[must_use]
pub fn notes(format: Format, file: &str, joint: &JointReport, catalogue: &Catalogue) -> Vec<ExportNote> {
    exported(format, joint, catalogue).map(|e| note(format, file, joint, &e)).collect()
}

/// The same where there is no file, and why.
#[must_use]
pub fn missing(format: Format, joint: &JointReport, catalogue: &Catalogue, why: &str) -> Vec<ExportNote> {
    let not_written = |note| ExportNote { status: format!("not written: {why}"), ..note };
    notes(format, "", joint, catalogue).into_iter().map(not_written).collect()
}

/// What became of an effect in a file; the RMSE is that of the joint's whole model in the format.
#[must_use]
pub fn note(format: Format, file: &str, joint: &JointReport, effect: &Exported) -> ExportNote {
    ExportNote {
        format: format.name().into(),
        file: file.into(),
        joint: joint.joint.clone(),
        effect: effect.finding.effect.clone(),
        status: effect.expression.name().into(),
        rmse: joint.in_format.iter().find(|(f, _)| *f == format.name()).map(|(_, rmse)| *rmse),
    }
}
