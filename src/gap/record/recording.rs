//! Joints of a bag before the selection of single joints; checks name whatever is missing.

use crate::record::{
    command::{Command, Told},
    jitter::reading_noise,
    log::JointLog,
    motion::SmoothMotion,
    tracks::{PoseTrack, WrenchTrack},
};

use common::note::{Note, NoteCode};

/// Stamps closer than this count as equal, seconds.
/// chosen: above the rounding of seconds since the epoch, below any sample interval.
const SAME_TIME_S: f64 = 1e-7;

/// Recorded samples of one joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointSamples {
    /// Name of the joint.
    pub name: String,
    /// Stamps, seconds from the start of the recording.
    pub time_s: Vec<f64>,
    /// Positions, rad or m; NaN if not recorded.
    pub position: Vec<f64>,
    /// Efforts, N m or N; NaN if not recorded.
    pub effort: Vec<f64>,
    /// Velocities, rad/s or m/s; NaN if not recorded.
    pub velocity: Vec<f64>,
}

/// One recorded run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name of the run.
    pub name: String,
    /// Joints, sorted by name.
    pub joints: Vec<JointSamples>,
    /// Poses of links.
    pub poses: Vec<PoseTrack>,
    /// Wrenches on links.
    pub wrenches: Vec<WrenchTrack>,
    /// Commands of joints.
    pub commands: Vec<Command>,
    /// Notes on irregularities.
    pub warnings: Vec<Note>,
}

/// Why a run cannot be used for a joint.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecordingError {
    /// The joint is not in the run.
    #[error(
        "run '{run}' has no joint '{joint}'; it has {has}: say under which name it was recorded with --joint \
         {joint}={nearest}"
    )]
    NoJoint {
        /// Run.
        run: String,
        /// Joint.
        joint: String,
        /// Names of the joints in the run.
        has: String,
        /// The one that is likely meant.
        nearest: String,
    },
    /// No efforts and no commands of the joint.
    #[error(
        "run '{run}' has no effort of joint '{joint}' and nothing that it was commanded to: record the \
         effort (motor current times torque constant, or a force gauge as a wrench on its link), the \
         positions that its controller followed, or release the joint and record an effort of 0"
    )]
    NoEffort {
        /// Run.
        run: String,
        /// Joint.
        joint: String,
    },
    /// No positions of the joint.
    #[error("run '{run}' has no position of joint '{joint}'")]
    NoPosition {
        /// Run.
        run: String,
        /// Joint.
        joint: String,
    },
    /// Too few samples.
    #[error(
        "run '{run}' has {samples} usable samples of joint '{joint}' over {seconds:.1} s; record 10 s or \
         more at 50 Hz or more"
    )]
    Short {
        /// Run.
        run: String,
        /// Joint.
        joint: String,
        /// Number of usable samples.
        samples: usize,
        /// Their duration, seconds.
        seconds: f64,
    },
}

/// Fewest samples of a run.
const MIN_SAMPLES: usize = 100;
/// Positions of other joints are averaged over this many samples on either side.
const OTHERS_HALF_WIDTH: usize = 4;

impl JointSamples {
    /// Whether any position is recorded.
    #[must_use]
    pub fn has_positions(&self) -> bool {
        self.position.iter().any(|q| q.is_finite())
    }

    /// Integrates the velocities of a joint without positions, from 0; returns whether it did.
    pub fn integrate(&mut self) -> bool {
        let has = |values: &[f64]| values.iter().any(|x| x.is_finite());
        if has(&self.position) || !has(&self.velocity) {
            return false;
        }
        let (mut at, mut last) = (0.0, None::<(f64, f64)>);
        self.position = vec![f64::NAN; self.time_s.len()];
        for k in 0..self.time_s.len() {
            let t = self.time_s[k];
            let v = self.velocity[k];
            if !v.is_finite() || last.is_some_and(|l| t <= l.0) {
                continue;
            }
            at += last.map_or(0.0, |l| 0.5 * (v + l.1) * (t - l.0));
            (self.position[k], last) = (at, Some((t, v)));
        }
        true
    }
}

impl Recording {
    /// Motion of a joint from its positions; repeated and decreasing stamps and NaN positions are left out.
    ///
    /// # Errors
    /// [`RecordingError`] if the run has no position of the joint.
    pub fn motion(&self, name: &str) -> Result<SmoothMotion, RecordingError> {
        let run = self.name.clone();
        let joint = name.to_owned();
        let Some(samples) = self.samples(name) else { return Err(self.no_joint(name)) };
        let mut log = JointLog::default();
        for (t, q) in samples.time_s.iter().zip(&samples.position) {
            if q.is_finite() && log.time_s.last().is_none_or(|last| *t > last + SAME_TIME_S) {
                log.time_s.push(*t);
                log.position.push(*q);
            }
        }
        if log.time_s.len() < MIN_SAMPLES {
            return Err(RecordingError::NoPosition { run, joint });
        }
        let logs = [log];
        let noise = reading_noise(&logs);
        Ok(SmoothMotion::of_positions(&logs[0].time_s, &logs[0].position, &noise, &[]))
    }

    /// Recorded samples of a joint.
    #[must_use]
    pub fn samples(&self, joint: &str) -> Option<&JointSamples> {
        self.joints.iter().find(|j| j.name == joint)
    }

    /// Whether it has commands of a joint.
    #[must_use]
    pub fn is_commanded(&self, joint: &str) -> bool {
        self.commands.iter().any(|c| c.joint == joint)
    }

    /// Removes the efforts of a joint, so that nothing uses them, not even the other joints of a chain.
    pub fn drop_efforts(&mut self, joint: &str) {
        let samples = self.joints.iter_mut().filter(|s| s.name == joint);
        samples.for_each(|s| s.effort.fill(f64::NAN));
    }

    /// The error for a joint that the run lacks.
    fn no_joint(&self, joint: &str) -> RecordingError {
        let run = self.name.clone();
        // A prefix or a namespace is the usual difference.
        let is_alike = |name: &&str| name.ends_with(joint) || joint.ends_with(*name);
        let names: Vec<&str> = self.joints.iter().map(|j| j.name.as_str()).collect();
        let nearest = names.iter().find(|n| is_alike(n)).or(names.first()).copied().unwrap_or("RECORDED");
        let has = names.iter().map(|n| format!("'{n}'")).collect::<Vec<_>>().join(", ");
        RecordingError::NoJoint { run, joint: joint.to_owned(), has, nearest: nearest.to_owned() }
    }

    /// Gives joints the twin's names; each pair is the twin's name and the recorded one.
    pub fn rename_joints(&mut self, pairs: &[(String, String)]) {
        let twins = |recorded: &str| pairs.iter().find(|(_, r)| r == recorded).map(|(twin, _)| twin.clone());
        // A recorded name that a twin's joint of another name takes over.
        let is_taken = |name: &str| pairs.iter().any(|(twin, _)| twin == name);
        self.joints.retain(|s| twins(&s.name).is_some() || !is_taken(&s.name));
        self.commands.retain(|c| twins(&c.joint).is_some() || !is_taken(&c.joint));
        self.joints.iter_mut().for_each(|s| s.name = twins(&s.name).unwrap_or_else(|| s.name.clone()));
        self.commands.iter_mut().for_each(|c| c.joint = twins(&c.joint).unwrap_or_else(|| c.joint.clone()));
        self.joints.sort_by(|a, b| a.name.cmp(&b.name));
    }

    /// The log of one joint; positions of `others` are resampled to its stamps. Repeated and decreasing
    /// stamps and samples with NaN are left out, each with a warning.
    ///
    /// # Errors
    /// [`RecordingError`] if the run does not contain enough of the joint.
    pub fn joint(
        &self,
        name: &str,
        others: &[String],
        told: &Told,
        warnings: &mut Vec<Note>,
    ) -> Result<JointLog, RecordingError> {
        let (run, joint) = (|| self.name.clone(), || name.to_owned());
        let samples = self.samples(name).ok_or_else(|| self.no_joint(name))?;
        if !samples.has_positions() {
            return Err(RecordingError::NoPosition { run: run(), joint: joint() });
        }
        let has_effort = samples.effort.iter().any(|u| u.is_finite());
        // Efforts take precedence, unless a servo is given.
        let is_servo = told.servo_of(name).is_some() || !has_effort;
        let command = self.commands.iter().find(|c| c.joint == name).filter(|_| is_servo);
        if !has_effort && command.is_none() {
            return Err(RecordingError::NoEffort { run: run(), joint: joint() });
        }
        let factor = if command.is_none() { told.effort_factor() } else { 1.0 };
        let signal = command
            .map_or_else(|| samples.effort.clone(), |c| c.at_samples(&samples.time_s, &samples.position));
        let mut log = JointLog { run: run(), ..JointLog::default() };
        let mut backward = 0;
        let mut not_numbers = 0;
        for k in 0..samples.time_s.len() {
            let t = samples.time_s[k];
            let q = samples.position[k];
            let u = signal[k];
            if log.time_s.last().is_some_and(|last| t <= *last + SAME_TIME_S) {
                backward += 1;
            } else if !q.is_finite() || !u.is_finite() {
                not_numbers += 1;
            } else {
                log.time_s.push(t);
                log.position.push(q);
                log.effort.push(factor * u);
            }
        }
        if backward > 0 {
            warnings.push(Note::new(NoteCode::SamplesBackward, format!(
                "run '{}', joint '{name}': {backward} samples left out, their stamps repeat or run backward",
                self.name
            )));
        }
        if not_numbers > 0 {
            warnings.push(Note::new(NoteCode::SamplesNotNumbers, format!(
                "run '{}', joint '{name}': {not_numbers} samples left out, their position, effort or command \
                 is not a number",
                self.name
            )));
        }
        if log.time_s.len() < MIN_SAMPLES {
            return Err(RecordingError::Short {
                run: run(),
                joint: joint(),
                samples: log.time_s.len(),
                seconds: log.duration_s(),
            });
        }
        if command.is_some() {
            // The servo's effort follows once its stiffness is known.
            log.commanded = std::mem::replace(&mut log.effort, vec![0.0; log.time_s.len()]);
        }
        let beside = others.iter().filter(|o| o.as_str() != name);
        // A joint without samples is assumed at 0.
        log.others = beside
            .map(|o| {
                self.joints
                    .iter()
                    .find(|j| j.name == *o)
                    .map_or_else(|| vec![0.0; log.time_s.len()], |j| at_stamps(j, &log.time_s))
            })
            .collect();
        Ok(log)
    }
}

/// Positions of a joint at given stamps, averaged over neighbors.
fn at_stamps(joint: &JointSamples, stamps: &[f64]) -> Vec<f64> {
    let usable: Vec<(f64, f64)> = joint
        .time_s
        .iter()
        .copied()
        .zip(joint.position.iter().copied())
        .filter(|(_, q)| q.is_finite())
        .collect();
    if usable.is_empty() {
        return vec![0.0; stamps.len()];
    }
    let mut k = 0;
    stamps
        .iter()
        .map(|t| {
            while k + 1 < usable.len() && usable[k + 1].0 <= *t {
                k += 1;
            }
            let next = (k + 1).min(usable.len() - 1);
            let width = usable[next].0 - usable[k].0;
            let share = if width > 0.0 { ((t - usable[k].0) / width).clamp(0.0, 1.0) } else { 0.0 };
            mean_about(&usable, k) * (1.0 - share) + mean_about(&usable, next) * share
        })
        .collect()
}

/// Mean position over the neighbors of a sample; samples are (time, position).
fn mean_about(samples: &[(f64, f64)], k: usize) -> f64 {
    // Equally wide on both sides, also at the ends: an asymmetric mean would lag.
    let half = OTHERS_HALF_WIDTH.min(k).min(samples.len() - 1 - k);
    samples[k - half..=k + half].iter().map(|(_, q)| q).sum::<f64>() / (2 * half + 1) as f64
}
