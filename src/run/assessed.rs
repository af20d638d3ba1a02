//! The assessment of all joints of a twin, with efforts as they were given or as the runs show them: held
//! between samples, or sampled with the positions.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{
    DiagnoseRequest, Event, Monitor, RunError,
    diagnose::Recorded,
    doubts::input_doubts,
    joint_runs::{Split, moving_joints, plant_and_runs},
    recorded_twin::recorded_twin,
};
use common::note::{Note, NoteCode};
use gap::{
    judge::{
        assess::{Examined, Runs, examined_joint, proven_report},
        doubt::Doubt,
        imposed::imposed_report,
        multibody::fit_chains,
        refused::refused_report,
        report::JointReport,
        sampled::{acts_early, is_sampled, promised_gain},
        verdict::Verdict,
    },
    model::{joint_model::Catalogue, plant::Plant},
    record::{drive::Hold, off_axis::OffAxis, recording::Recording},
    twin_tree::{Motion, TwinTree},
};
use numeric::random::{StageRng, stage_rng};

/// How recorded efforts were read.
#[derive(Debug, Serialize)]
pub(super) struct EffortHold {
    /// `zero`, held until the next sample, or `linear`, sampled with the positions.
    taken: Hold,
    /// By how much twice the log likelihood of all joints is higher with sampled efforts, prices of effects
    /// subtracted; `None` if the user said how efforts run.
    gain_if_sampled: Option<f64>,
}

/// The assessment of all joints.
pub(super) struct Assessed {
    pub joints: Vec<JointReport>,
    /// Names of the joints that move in the runs.
    pub moving: Vec<String>,
    /// Why other joints were not assessed.
    pub left_out: Vec<String>,
    pub effort_hold: EffortHold,
    pub warnings: Vec<Note>,
}

/// Twin and runs, ready to be examined.
struct Bench<'a> {
    request: &'a DiagnoseRequest,
    tree: &'a TwinTree,
    recordings: &'a [(Recording, bool)],
    effects: &'a Catalogue,
    /// Joints to examine.
    moving: Vec<usize>,
    /// Their names.
    names: Vec<String>,
    /// Effects to fit instead of a search.
    wanted: Vec<usize>,
    /// Why joints cannot be examined.
    unusable: BTreeMap<usize, String>,
    doubts: BTreeMap<usize, Doubt>,
}

/// What an examination found.
#[derive(Default)]
struct Examination<'c> {
    examined: Vec<(usize, Examined<'c>, StageRng)>,
    /// Reports of joints in doubt, and of those whose motion was imposed.
    concluded: BTreeMap<usize, JointReport>,
    left_out: Vec<String>,
    /// Warnings about the logs.
    warnings: Vec<Note>,
}

impl Examination<'_> {
    /// The joints that both examinations know.
    fn joints_beside(&self, other: &Self) -> Vec<&Examined<'_>> {
        let is_known = |j: &usize| other.examined.iter().any(|(o, _, _)| o == j);
        self.examined.iter().filter(|(j, _, _)| is_known(j)).map(|(_, e, _)| e).collect()
    }
}

/// Assesses the joints of a twin from their recordings.
pub(super) fn assessed(
    request: &DiagnoseRequest,
    tree: &TwinTree,
    recorded: Recorded,
    effects: &Catalogue,
    wanted: Vec<usize>,
    monitor: &Monitor,
) -> Result<Assessed, RunError> {
    let Recorded { mut recordings, off_axis, mut warnings } = recorded;
    let (tree, notes) = recorded_twin(tree, &mut recordings);
    warnings.extend(notes);
    let moving = moving_joints(&tree);
    let (unusable, doubts) =
        input_doubts(&mut recordings, &tree, &moving, request.hold, &request.told, &mut warnings);
    let names = moving.iter().map(|&j| tree.joints[j].name.clone()).collect();
    let recordings = &recordings;
    let bench = Bench { request, tree: &tree, recordings, effects, moving, names, wanted, unusable, doubts };
    let (Examination { mut examined, concluded, left_out, warnings: of_logs }, effort_hold) =
        bench.likelier_examination(monitor)?;
    warnings.extend(of_logs);
    warnings.extend(effort_hold.note());
    let mut joints = concluded;
    let mut own: Vec<(usize, &mut Examined)> = examined.iter_mut().map(|(j, e, _)| (*j, e)).collect();
    fit_chains(&tree, &mut own);
    for (j, examined, mut rng) in examined {
        monitor.check()?;
        joints.insert(j, proven_report(examined, &mut rng));
    }
    let joints = joints.into_iter().map(|(j, report)| beside_axis(report, &off_axis, j)).collect();
    Ok(Assessed { joints, moving: bench.names, left_out, effort_hold, warnings })
}

impl<'a> Bench<'a> {
    /// The examination with efforts as given, or under the reading that makes the runs more likely. Without
    /// clear evidence efforts are held.
    fn likelier_examination(&self, monitor: &Monitor) -> Result<(Examination<'a>, EffortHold), RunError> {
        if let Some(hold) = self.request.hold {
            return Ok((
                self.examination(hold, monitor, true)?,
                EffortHold { taken: hold, gain_if_sampled: None },
            ));
        }
        let held = self.examination(Hold::Zero, monitor, true)?;
        let mut promised = 0.0;
        for (j, examined, _) in &held.examined {
            monitor.check()?;
            promised += self.promised_gain(*j, examined);
        }
        if !(promised > 0.0) && !held.examined.iter().any(|(_, examined, _)| acts_early(examined)) {
            return Ok((held, EffortHold { taken: Hold::Zero, gain_if_sampled: Some(promised) }));
        }
        let sampled = self.examination(Hold::Sampled, monitor, false)?;
        let own = sampled.joints_beside(&held);
        let other = held.joints_beside(&sampled);
        let gain = own.iter().map(|e| e.score).sum::<f64>() - other.iter().map(|e| e.score).sum::<f64>();
        if is_sampled(gain, &own, &other) {
            let warnings = held.warnings;
            let hold = EffortHold { taken: Hold::Sampled, gain_if_sampled: Some(gain) };
            return Ok((Examination { warnings, ..sampled }, hold));
        }
        Ok((held, EffortHold { taken: Hold::Zero, gain_if_sampled: Some(gain) }))
    }

    /// Gain of score of a joint that was examined with held efforts, if they were sampled; 0 where this
    /// examination says nothing.
    fn promised_gain(&self, joint: usize, held: &Examined) -> f64 {
        if held.diagnosis.verdict == Verdict::Insufficient {
            return 0.0;
        }
        match self.plant_and_runs(joint, Hold::Sampled, &mut Vec::new()) {
            Ok((plant, split)) if !split.is_commanded() => promised_gain(held, &plant, split.fitted),
            _ => 0.0,
        }
    }

    /// Examines all joints with efforts read as `hold` says; `is_reported`: each shows as a stage.
    fn examination(
        &self,
        hold: Hold,
        monitor: &Monitor,
        is_reported: bool,
    ) -> Result<Examination<'a>, RunError> {
        let mut found = Examination::default();
        for &j in &self.moving {
            let name = &self.tree.joints[j].name;
            let stage = format!("diagnose/{name}");
            monitor.check()?;
            if is_reported {
                monitor.report(Event::StageStarted { stage: stage.clone(), steps: None });
            }
            let ready = match self.unusable.get(&j) {
                Some(why) => Err(why.clone()),
                None => self.plant_and_runs(j, hold, &mut found.warnings),
            };
            let (plant, split) = match ready {
                Ok(ready) => ready,
                Err(why) => {
                    found.left_out.push(why);
                    continue;
                }
            };
            // Commands hold until the next one, however efforts are measured.
            let hold = if split.is_commanded() { self.request.hold.unwrap_or_default() } else { hold };
            let runs = Runs {
                fitted: split.fitted,
                held_out: split.held_out,
                turns: self.tree.joints[j].motion == Motion::Turn,
                hold,
                effects: self.wanted.clone(),
            };
            if let Some(doubt) = self.doubts.get(&j) {
                found.concluded.insert(j, refused_report(self.effects, &plant, doubt, runs));
                continue;
            }
            if let Some(report) = imposed_report(self.effects, &plant, name, &runs) {
                found.concluded.insert(j, report);
                continue;
            }
            let mut rng = stage_rng(self.request.seed, &stage, 0);
            let examined = examined_joint(self.effects, &plant, name, runs, &mut rng);
            found.examined.push((j, examined, rng));
        }
        Ok(found)
    }

    fn plant_and_runs(
        &self,
        joint: usize,
        hold: Hold,
        warnings: &mut Vec<Note>,
    ) -> Result<(Plant, Split), String> {
        plant_and_runs(self.request, self.recordings, self.tree, joint, &self.names, hold, warnings)
    }
}

impl EffortHold {
    /// Says that the runs show sampled efforts.
    fn note(&self) -> Option<Note> {
        let gain = self.gain_if_sampled.filter(|_| self.taken == Hold::Sampled)?;
        let text = format!(
            "the efforts are sampled with the positions, not held until the next sample: twice the log \
             likelihood is {gain:.1} higher so (--effort-hold says otherwise)"
        );
        Some(Note::new(NoteCode::EffortsSampled, text))
    }
}

/// A report with the largest motion, over all runs, that poses show beside the joint's.
fn beside_axis(report: JointReport, off_axis: &[BTreeMap<usize, OffAxis>], joint: usize) -> JointReport {
    let measured = off_axis.iter().filter_map(|e| e.get(&joint).copied());
    JointReport {
        off_axis: measured.max_by(|a, b| a.largest_excess().total_cmp(&b.largest_excess())),
        ..report
    }
}
