//! The diagnosis by motion as one self-contained page: found effects, the evidence and proof for them, and
//! the next recording to make.

mod chart;
mod exports;
mod joint_picture;
mod law_chart;
mod motion;
mod next;
mod solids;
#[cfg(test)]
mod tests;
mod ticks;
mod values;
mod view;
mod words;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use joint_picture::DrawnJoint;
use motion::Names;
use solids::{Solid, visual_solids};
use words::{decimal_places, effort_unit, escaped_words, fixed_text, position_text, residual_text};

use super::page::{TAIL, counted_noun, page_head, push_list};
use common::note::Note;
use gap::{
    judge::{
        report::{ExportNote, JointReport, overall_verdict},
        verdict::Verdict,
    },
    model::joint_model::Catalogue,
    twin_tree::{Motion, TwinTree},
};
use model::escape_xml;

const STYLE: &str = include_str!("diagnosis.css");
/// Largest number of joints shown in full.
const MAX_JOINTS: usize = 12;

/// Largest number of laws shown of a joint.
const MAX_LAWS: usize = 7;

/// What a page is made from.
pub struct DiagnosisFacts<'a> {
    /// Joints with their findings.
    pub joints: &'a [JointReport],
    /// The catalog of effects.
    pub effects: &'a Catalogue,
    /// The twin.
    pub tree: &'a TwinTree,
    /// Its URDF.
    pub urdf: &'a str,
    /// What became of each effect in each format.
    pub exports: &'a [ExportNote],
    /// Warnings about the input.
    pub warnings: &'a [Note],
}

/// The page of a diagnosis.
pub fn diagnosis_page(facts: &DiagnosisFacts) -> String {
    let name = escape_xml(&facts.tree.name);
    let mut out = page_head(&format!("{name}: diagnosis"), STYLE);
    push_header(&mut out, facts);
    let warnings: Vec<String> = facts.warnings.iter().map(ToString::to_string).collect();
    push_list(&mut out, "warnings", "Warnings", &warnings);
    let shapes = visual_solids(facts.urdf);
    let middles = range_middles(facts);
    // Joints with findings come first, otherwise in the order of the twin.
    let mut order: Vec<&JointReport> = facts.joints.iter().collect();
    order.sort_by_key(|j| matches!(j.diagnosis.verdict, Verdict::None | Verdict::Insufficient));
    for joint in order.iter().take(MAX_JOINTS) {
        push_joint(&mut out, joint, facts, &shapes, &middles);
    }
    if order.len() > MAX_JOINTS {
        let more = order.len() - MAX_JOINTS;
        writeln!(out, "<p>{more} more joints are in report.json.</p>").ok();
    }
    out.push_str(&exports::exports_table(facts.joints, facts.exports));
    out.push_str(TAIL);
    out
}

// Writing to a string cannot fail: the results below are dropped.

fn push_header(out: &mut String, facts: &DiagnosisFacts) {
    let verdict = overall_verdict(facts.joints);
    let class = match verdict {
        Verdict::None | Verdict::Named => "pill",
        Verdict::Ambiguous | Verdict::Insufficient => "pill check",
        Verdict::Unknown => "pill unknown",
    };
    writeln!(out, "<header>\n<h1>Diagnosis of {}</h1>", escape_xml(&facts.tree.name)).ok();
    let sentences: Vec<String> = facts.joints.iter().map(|j| verdict_sentence(j, facts.effects)).collect();
    writeln!(
        out,
        "<p class=\"verdict\"><span class=\"{class}\">{}</span>{}.</p>",
        verdict.name(),
        sentences.join("; ")
    )
    .ok();
    let mut runs: BTreeMap<&str, [bool; 2]> = BTreeMap::new();
    for track in facts.joints.iter().flat_map(|j| &j.tracks) {
        runs.entry(&track.run).or_default()[usize::from(track.is_held_out)] = true;
    }
    let [fitted, held_out] = [0, 1].map(|i| runs.values().filter(|r| r[i]).count());
    writeln!(
        out,
        "<p class=\"facts\">{} \u{b7} fitted to {} \u{b7} proven on {} held out</p>\n</header>",
        counted_noun(facts.joints.len(), "joint"),
        counted_noun(fitted, "run"),
        counted_noun(held_out, "run")
    )
    .ok();
}

/// The verdict on a joint in a sentence.
fn verdict_sentence(joint: &JointReport, effects: &Catalogue) -> String {
    let d = &joint.diagnosis;
    let found: Vec<String> = d.sure_findings().map(|f| values::values_sentence(joint, f, effects)).collect();
    let name = escape_xml(&joint.joint);
    if let Some(doubt) = &joint.doubt {
        return format!("{name}: {}", escape_xml(&doubt.looks_text()));
    }
    match d.verdict {
        Verdict::None => format!("{name}: the twin agrees with the runs"),
        Verdict::Unknown => format!("{name}: something that no effect of the catalog explains well enough"),
        Verdict::Insufficient => format!("{name}: the runs lack what a diagnosis needs"),
        Verdict::Named => format!("{name}: {}", found.join(", ")),
        Verdict::Ambiguous => format!("{name}: {}, or another of its class", found.join(", ")),
    }
}

/// Middles of the joints' recorded ranges, in the order of the tree; zero for joints without a recording.
fn range_middles(facts: &DiagnosisFacts) -> Vec<f64> {
    let mut middles = Vec::with_capacity(facts.tree.joints.len());
    for joint in &facts.tree.joints {
        let report = facts.joints.iter().find(|j| j.joint == joint.name);
        let (low, high) = report.map_or((0.0, 0.0), recorded_range);
        middles.push(0.5 * (low + high));
    }
    middles
}

/// Least and largest position over all runs.
fn recorded_range(joint: &JointReport) -> (f64, f64) {
    chart::finite_extent(joint.tracks.iter().flat_map(|t| &t.position))
}

fn push_joint(
    out: &mut String,
    joint: &JointReport,
    facts: &DiagnosisFacts,
    shapes: &BTreeMap<String, Vec<Solid>>,
    middles: &[f64],
) {
    let d = &joint.diagnosis;
    writeln!(
        out,
        "<h2 class=\"joint\">{}: {}</h2>\n{}",
        escape_xml(&joint.joint),
        d.verdict.name(),
        remarks(joint)
    )
    .ok();
    let spec = facts.tree.joints.iter().position(|j| j.name == joint.joint);
    let text = next::next_experiment(joint, spec.map(|j| &facts.tree.joints[j]), recorded_range(joint));
    writeln!(out, "<p class=\"next\"><b>Next experiment:</b> {text}</p>").ok();
    let (names, title) = if joint.nearest.is_some() {
        (
            Names { updated: Some("twin with what comes nearest") },
            "What comes nearest; it explains too little for a name",
        )
    } else {
        (
            Names { updated: (!d.model.terms.is_empty()).then_some("updated twin") },
            "Values: twin + found = updated",
        )
    };
    let nearest = d.nearest.as_ref().map(|n| n.findings.as_slice());
    let is_named = nearest.is_none();
    out.push_str(&values::values_table(joint, nearest.unwrap_or(&d.findings), title, facts.effects));
    let mut cards: Vec<String> = Vec::new();
    if let Some(index) = spec {
        let visuals = shapes;
        let range = recorded_range(joint);
        let drawn = DrawnJoint { tree: facts.tree, joint: index, visuals, range, others: middles };
        cards.push(joint_figure(&drawn, facts.tree, index, shapes));
    }
    cards.extend(joint.laws.iter().take(MAX_LAWS).map(|law| law_chart::law_chart(joint, law, is_named)));
    let gap = joint.nearest.as_ref().or(joint.gap.as_ref());
    let gap = gap.map_or(String::new(), |gap| values::gap_table(joint, gap, names.updated));
    // Two cards a row: with an odd number, the gap takes the free place.
    let (beside, below) = if cards.len() % 2 == 1 { (gap, String::new()) } else { (String::new(), gap) };
    writeln!(out, "<div class=\"pair\">\n{}{beside}</div>\n{below}", cards.concat()).ok();
    out.push_str(&motion::motion_sections(joint, &names));
}

fn joint_figure(
    drawn: &DrawnJoint,
    tree: &TwinTree,
    index: usize,
    shapes: &BTreeMap<String, Vec<Solid>>,
) -> String {
    let joint = &tree.joints[index];
    let kind = if joint.motion == Motion::Turn { "turns" } else { "slides" };
    let turns = joint.motion == Motion::Turn;
    let limit = joint.limit.map_or(String::new(), |(low, high)| {
        format!(" The twin's limits: {} to {}.", position_text(low, turns), position_text(high, turns))
    });
    let source = if shapes.get(&tree.links[joint.child].name).is_some_and(|s| !s.is_empty()) {
        "Shapes are those of the URDF."
    } else {
        "Boxes have the mass and inertia of their links."
    };
    format!(
        "<section>\n<h3>{} {kind} on {}</h3>\n{}\n<p class=\"soft\">Red: the axis, pointing in its positive \
         sense. Blue: the recorded range; dashed: its ends. {source}{limit}</p>\n</section>\n",
        escape_xml(&tree.links[joint.child].name),
        escape_xml(&tree.links[joint.parent].name),
        drawn.svg_drawing()
    )
}

/// Remarks below the values: alternatives, the unexplained rest, failures of the twin, the range of the runs.
fn remarks(joint: &JointReport) -> String {
    let d = &joint.diagnosis;
    let mut said = Vec::new();
    for f in d.sure_findings().filter(|f| !f.alternatives.is_empty()) {
        let others: Vec<String> = f
            .alternatives
            .iter()
            .map(|(n, w)| format!("{} ({})", escaped_words(n), fixed_text(*w, 2)))
            .collect();
        said.push(format!(
            "{} (weight {}), or {}.",
            escaped_words(&f.effect),
            fixed_text(f.weight, 2),
            others.join(", ")
        ));
    }
    for f in d.unsure_findings() {
        said.push(format!(
            "{} may be absent: its interval holds that. Runs that were not fitted are better with it.",
            escaped_words(&f.effect)
        ));
    }
    if let Some(doubt) = &joint.doubt {
        said.push(format!("Not diagnosed: {}.", escape_xml(&doubt.in_words())));
    } else if d.verdict == Verdict::Unknown && joint.nearest.is_none() {
        said.push("No effect of the catalog comes near.".into());
    }
    if let (Some(near), Some(gap)) = (&d.nearest, &joint.nearest) {
        let names: Vec<String> = near.findings.iter().map(|f| escaped_words(&f.effect)).collect();
        said.push(format!(
            "Nearest, not enough for a name: {}; held-out residual {} \u{2192} {}.",
            names.join(" + "),
            residual_text(gap.before, joint.gap_unit()),
            residual_text(gap.after, joint.gap_unit())
        ));
    }
    if d.verdict != Verdict::Insufficient && joint.doubt.is_none() {
        said.push(next::disagreement(joint));
    }
    if let Some((share, noises)) = joint.remainder_of_gap() {
        said.push(format!(
            "Beside it something unknown is left: {}\u{a0}% of the gap, {} times the noise.",
            fixed_text(100.0 * share, 0),
            fixed_text(noises, 0)
        ));
    }
    if let Some(e) = &joint.off_axis {
        said.push(escape_xml(&e.in_words()) + ".");
    }
    let (low, high) = recorded_range(joint);
    let velocity = if joint.turns { "rad/s" } else { "m/s" };
    let c = &joint.coverage;
    said.push(format!(
        "The runs cover {} to {}, speeds up to {}\u{a0}{velocity}, efforts of {}\u{a0}{} (root mean square).",
        position_text(low, joint.turns),
        position_text(high, joint.turns),
        fixed_text(c.speed.1, 2),
        fixed_text(c.effort_rms, decimal_places(c.effort_rms, 0.0)),
        effort_unit(joint.turns)
    ));
    said.retain(|s| !s.is_empty());
    format!("<p>{}</p>", said.join(" "))
}
