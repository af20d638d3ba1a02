//! Text of results.

use std::fmt::Write as _;

use capture::quoted;
use export::counted_noun;
use model::JointKind;
use run::{JointSummary, Outcome};

/// Path of the result, its joints, whether it is degraded, and the files to open next. Warnings were shown at
/// the end of the run.
pub(super) fn outcome_text(outcome: &Outcome) -> String {
    let mut text = format!("{}\n", outcome.folder.display());
    if outcome.stood {
        text += "  finished already by the same inputs, settings and version; nothing was done\n";
    }
    // Writing to a String cannot fail.
    outcome.joints.iter().for_each(|j| writeln!(text, "  {}", joint_text(j)).unwrap_or_default());
    if outcome.degraded {
        let warnings = counted_noun(outcome.warnings.len(), "warning");
        writeln!(text, "  degraded: {warnings}, listed above and in report.json").unwrap_or_default();
    }
    let [report, scene] = ["report.html", "scene.xml"].map(|f| quoted(&outcome.folder.join(f)));
    writeln!(text, "  next: open {report}, or python -m mujoco.viewer --mjcf={scene}").unwrap_or_default();
    text
}

fn joint_text(joint: &JointSummary) -> String {
    // Adding 0 takes the sign off a minus zero.
    let triple = |v: [f64; 3], digits: usize| v.map(|x| format!("{:.digits$}", x + 0.0)).join(", ");
    let axis = triple(joint.axis_in_world, 4);
    match joint.kind {
        JointKind::Prismatic => {
            format!(
                "{}: prismatic, {:.1} mm along ({axis}){}",
                joint.name,
                joint.motion * 1000.0,
                positions_text(joint, 1000.0)
            )
        }
        kind => {
            let point = triple(joint.point_in_world_m, 4);
            let turn = format!(
                "{}: {}, {:.2} deg about ({axis}) through ({point}) m",
                joint.name,
                kind.name(),
                joint.motion.to_degrees()
            );
            let pitch = kind.pitch_m_per_rad().map(|p| format!(", advancing {:.2} mm a radian", 1e3 * p));
            turn + &pitch.unwrap_or_default() + &positions_text(joint, 1f64.to_degrees())
        }
    }
}

/// Positions in all states, where the motion alone does not give them.
fn positions_text(joint: &JointSummary, scale: f64) -> String {
    let all: Vec<String> = joint.positions.iter().map(|q| format!("{:.1}", q * scale + 0.0)).collect();
    if all.len() > 2 { format!("; in the states at {}", all.join(", ")) } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::note::{Note, NoteCode};

    #[test]
    fn joints_are_one_line_each() {
        let joint = |kind, motion| JointSummary {
            name: "lid".to_owned(),
            kind,
            axis_in_world: [0.0, -0.0, 1.0],
            point_in_world_m: [0.25, 0.5, 0.0],
            motion,
            positions: vec![0.0, motion],
        };
        let outcome = Outcome {
            folder: "runs/box".into(),
            joints: vec![joint(JointKind::Revolute, -0.5), joint(JointKind::Prismatic, 0.1234)],
            warnings: vec![Note::new(NoteCode::PosesMissing, "12 frames lost")],
            stood: false,
            degraded: true,
        };
        let expected = "runs/box\n  lid: revolute, -28.65 deg about (0.0000, 0.0000, 1.0000) through \
            (0.2500, 0.5000, 0.0000) m\n  \
                        lid: prismatic, 123.4 mm along (0.0000, 0.0000, 1.0000)\n  degraded: 1 warning, \
                        listed above and in report.json\n  next: open runs/box/report.html, or python -m \
                        mujoco.viewer --mjcf=runs/box/scene.xml\n";
        assert_eq!(super::outcome_text(&outcome), expected);
        assert_eq!(quoted("it's a/b".as_ref()), r"'it'\''s a/b'");
        let three =
            JointSummary { positions: vec![0.0, 0.02, -0.1234], ..joint(JointKind::Prismatic, -0.1234) };
        assert!(
            super::joint_text(&three).ends_with("; in the states at 0.0, 20.0, -123.4"),
            "{}",
            super::joint_text(&three)
        );
    }
}
