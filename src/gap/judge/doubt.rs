//! Tests whether twin and recording use the program's conventions: recorded motion and efforts may agree far
//! better under another one. See docs/method.md 14.14.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    fit::{
        evidence::{Explained, Regression, SeenStretch, independent_share},
        stretch::{RunMotion, Stretch, mean_signal, one_way_stretches},
    },
    judge::{
        convention::{AS_GIVEN, CONVENTIONS, Convention},
        name_weight::NAME_WEIGHT,
    },
    model::effect::LARGEST_RATIO,
    record::{drive::Hold, log::JointLog, tracks::resampled},
    twin_tree::{Motion, TwinTree},
};

/// Tried delays of an effort, seconds.
/// chosen: from none to the bound of the delay at 400 Hz to 100 Hz and more; from one to the next, efforts
/// hardly change over a stretch.
const DELAYS_S: [f64; 8] = [0.0, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15];
/// Prior log odds of another convention against the numbers as given.
/// derived: by chance, each convention may cost one joint in ten thousand its diagnosis.
pub const LOG_PRIOR: f64 = -9.21;
/// Least log odds for a convention to be reported.
/// derived: a weight of 0.95, as for a name.
pub const LOG_ODDS: f64 = 2.944;
/// Least tried factor of the twin's inertia.
/// derived: the bound of the effect `inertia`.
const LEAST_INERTIA: f64 = 0.1;
/// Largest tried factor of the twin's inertia.
/// chosen: the armature of a gear of 1:350 and a small link; the effect has no bound.
const LARGEST_INERTIA: f64 = 1e4;
/// Ratio of neighboring factors of the inertia.
/// chosen: between two of them an inertia is off by 5 %; inertias are not known better.
const INERTIA_RATIO: f64 = 1.1;
/// Largest factor of the effort under another convention; more would be a second change.
/// derived: the root of ten, half-way to the next power of ten.
const LARGEST_GAIN: f64 = 3.162;

/// What an input looks like.
#[derive(Clone, Debug, PartialEq)]
pub enum Looks {
    /// Numbers in another convention.
    Convention(Convention),
    /// The efforts of this joint were recorded as those of another one.
    EffortsOf(String),
}

/// Why a joint is not diagnosed.
#[derive(Clone, Debug, PartialEq)]
pub struct Doubt {
    /// Joint.
    pub joint: String,
    /// What its input looks like, the likeliest first: together they have a weight of 0.95.
    pub looks: Vec<Looks>,
    /// Log odds of the doubt, prior included.
    pub log_odds: f64,
    /// The twin's inertia as a multiple of the inertia shown by motion and effort.
    pub inertia_ratio: f64,
    /// Share of the squared effort left unexplained, under the convention and as given.
    pub left: (f64, f64),
    /// Name of another joint showing the convention; this joint does not contradict it.
    pub by: Option<String>,
}

/// Twin and runs to be tested.
pub struct Scene<'a> {
    /// The twin.
    pub tree: &'a TwinTree,
    /// Fitted runs.
    pub runs: &'a [RunMotion],
    /// Indices of the twin's joints to be diagnosed.
    pub joints: &'a [usize],
    /// How efforts are interpolated between samples; `None`: held, or sampled with the positions.
    pub hold: Option<Hold>,
}

/// A joint of a scene.
pub struct JointScene<'a> {
    scene: &'a Scene<'a>,
    /// Index in the twin.
    pub joint: usize,
    /// Stretches with motion of the joint.
    pub stretches: Vec<Stretch>,
    /// Share of independent stretches.
    share: f64,
}

/// Evidence of both regressions for the numbers as given, over all gains and inertias, each with its best
/// delay.
pub struct Baseline {
    motion: f64,
    effort: f64,
    left: f64,
}

/// Log odds of a convention against the numbers as given.
#[derive(Clone, Copy, Debug)]
pub struct Odds {
    /// Log odds without the prior.
    pub log: f64,
    /// The twin's inertia as a multiple of the estimated one.
    pub inertia_ratio: f64,
    /// Share of the squared effort left unexplained.
    pub left: f64,
}

/// Ranges of gains, equally probable a priori.
pub type Gains = Vec<(f64, f64)>;

/// All gains of the catalogue, for numbers as given.
#[must_use]
pub fn all_gains() -> Gains {
    gains_up_to(LARGEST_RATIO.log2().ceil() as i32)
}

/// Ranges of gains from `2^-power` to `2^power`.
#[must_use]
pub fn gains_up_to(power: i32) -> Gains {
    // Within a range, missing efforts are assumed as large as the acting one.
    (-power..power).step_by(2).map(|i| (f64::from(i).exp2(), f64::from(i + 2).exp2())).collect()
}

/// Range of gains of an effort in another convention.
fn about_one() -> Gains {
    vec![(1.0 / LARGEST_GAIN, LARGEST_GAIN)]
}

/// Tried factors of the inertia, equally probable a priori.
fn inertia_factors(largest: f64) -> Vec<f64> {
    let count = (largest / LEAST_INERTIA).ln() / INERTIA_RATIO.ln();
    (0..=count.ceil() as i32).map(|i| LEAST_INERTIA * INERTIA_RATIO.powi(i)).collect()
}

/// Logarithm of the mean of the exponentials of some values.
fn log_mean(values: &[f64]) -> f64 {
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !top.is_finite() {
        return f64::NEG_INFINITY;
    }
    top + (values.iter().map(|x| (x - top).exp()).sum::<f64>() / values.len() as f64).ln()
}

impl<'a> JointScene<'a> {
    /// Prepares a joint of the scene.
    #[must_use]
    pub fn of_joint(scene: &'a Scene<'a>, joint: usize) -> Self {
        let own = Self { scene, joint, stretches: one_way_stretches(scene.runs, joint), share: 1.0 };
        let all: Vec<&Stretch> = own.stretches.iter().collect();
        let seen = own.seen_stretches(&all, &AS_GIVEN);
        let efforts = own.recorded_efforts(joint, &all, 0.0);
        own.with_share(&all, &seen, &efforts)
    }

    /// The same with the share of independent stretches from the residual efforts over `stretches`.
    #[must_use]
    pub fn with_share(&self, stretches: &[&Stretch], seen: &[SeenStretch], efforts: &[Option<f64>]) -> Self {
        let known: Vec<usize> = (0..seen.len()).filter(|i| efforts[*i].is_some()).collect();
        let rows: Vec<SeenStretch> = known.iter().map(|i| seen[*i]).collect();
        let effort: Vec<f64> = known.iter().filter_map(|i| efforts[*i]).collect();
        let keys: Vec<(usize, usize)> = known.iter().map(|i| stretches[*i].key).collect();
        let follows: Vec<bool> =
            (0..keys.len()).map(|k| k > 0 && keys[k] == (keys[k - 1].0, keys[k - 1].1 + 1)).collect();
        let share = independent_share(&rows, &effort, self.is_turning(), &follows);
        Self { scene: self.scene, joint: self.joint, stretches: self.stretches.clone(), share }
    }

    /// Tried delays of the efforts, seconds.
    fn tried_delays_s(&self) -> Vec<f64> {
        let logs = self.scene.runs.iter().filter_map(|run| run[self.joint].as_ref()?.log.as_ref());
        // Efforts that are sampled with the positions lead held ones by half an interval.
        let lead = logs.filter_map(JointLog::interval_s).next().filter(|_| self.scene.hold.is_none());
        lead.map(|interval_s| -0.5 * interval_s).into_iter().chain(DELAYS_S).collect()
    }

    fn is_turning(&self) -> bool {
        self.scene.tree.joints[self.joint].motion == Motion::Turn
    }

    /// The twin's efforts for each stretch, with positions converted from a convention.
    #[must_use]
    pub fn seen_stretches(&self, stretches: &[&Stretch], convention: &Convention) -> Vec<SeenStretch> {
        let tree = convention.converted_twin(self.scene.tree);
        let n = tree.joints.len();
        let joint = self.joint;
        let factor: Vec<f64> = tree.joints.iter().map(|j| convention.of_position(j.motion)).collect();
        let zero = vec![0.0; n];
        let mut unit = zero.clone();
        unit[joint] = 1.0;
        let spec = &tree.joints[joint];
        let mut seen = Vec::with_capacity(stretches.len());
        for s in stretches {
            let q = scaled_values(&s.position, &factor);
            let v = scaled_values(&s.velocity, &factor);
            let a = scaled_values(&s.acceleration, &factor);
            let inertia = tree.inverse_dynamics(&q, &zero, &unit, false)[joint];
            let whole = tree.inverse_dynamics(&q, &v, &a, true)[joint];
            let inertial = inertia * a[joint];
            let own = spec.damping * v[joint] + spec.friction * v[joint].signum();
            seen.push(SeenStretch {
                position: q[joint],
                velocity: v[joint],
                inertial,
                rest: whole - inertial + own,
                inertia: inertia * factor[joint],
            });
        }
        seen
    }

    /// Recorded efforts of joint `of` over stretches, late by a delay.
    #[must_use]
    pub fn recorded_efforts(&self, of: usize, stretches: &[&Stretch], delay_s: f64) -> Vec<Option<f64>> {
        let hold = self.scene.hold.unwrap_or_default();
        let mut found = Vec::with_capacity(stretches.len());
        // Stretches are ordered by run.
        for part in stretches.chunk_by(|a, b| a.key.0 == b.key.0) {
            let run = &self.scene.runs[part[0].key.0];
            let log = |j: usize| run[j].as_ref().and_then(|m| m.log.as_ref());
            let (Some(own), Some(other)) = (log(self.joint), log(of)) else {
                found.extend(part.iter().map(|_| None));
                continue;
            };
            let brought;
            let values = if own.time_s == other.time_s {
                &other.effort
            } else {
                brought = resampled(&other.time_s, &other.effort, &own.time_s, hold);
                &brought
            };
            let means = mean_signal(own, values, part, hold, delay_s);
            found.extend(means.into_iter().map(|u| u.filter(|u| u.is_finite())));
        }
        found
    }

    /// A regression over the stretches with a recorded effort.
    fn effort_regression_of(&self, seen: &[SeenStretch], efforts: &[Option<f64>]) -> Regression {
        let known: Vec<usize> = (0..seen.len()).filter(|i| efforts[*i].is_some()).collect();
        let rows: Vec<SeenStretch> = known.iter().map(|i| seen[*i]).collect();
        let effort: Vec<f64> = known.iter().filter_map(|i| efforts[*i]).collect();
        let weight = self.share * rows.len() as f64;
        Regression::of_rows(&rows, &effort, self.is_turning(), weight)
    }

    /// Evidence for the numbers as given, over some stretches; `None` if these do not suffice.
    #[must_use]
    pub fn baseline_evidence(&self, stretches: &[&Stretch], gains: &Gains) -> Option<Baseline> {
        let seen = self.seen_stretches(stretches, &AS_GIVEN);
        let inertias = inertia_factors(LARGEST_INERTIA);
        let mut best = Baseline { motion: f64::NEG_INFINITY, effort: f64::NEG_INFINITY, left: 1.0 };
        for delay_s in self.tried_delays_s() {
            let regression =
                self.effort_regression_of(&seen, &self.recorded_efforts(self.joint, stretches, delay_s));
            if !regression.is_telling() {
                return None;
            }
            let motion: Vec<f64> =
                gains.iter().flat_map(|g| regression.of_motion(&inertias, *g)).map(|e| e.evidence).collect();
            let effort: Vec<Explained> =
                gains.iter().flat_map(|g| regression.of_effort(&inertias, *g)).collect();
            best.motion = best.motion.max(log_mean(&motion));
            let evidence = log_mean(&effort.iter().map(|e| e.evidence).collect::<Vec<_>>());
            if evidence > best.effort {
                let top = effort.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence));
                (best.effort, best.left) = (evidence, top.map_or(1.0, |t| t.left));
            }
        }
        Some(best)
    }

    /// Log odds of the numbers in `seen` and `efforts` against those given: the smaller ones of the two
    /// regressions, since the truth lies between errors of the motion alone and of the efforts alone (Frisch
    /// 1934). `prices` are subtracted for each independent measurement: of the motion, and of the efforts.
    #[must_use]
    pub fn log_odds_of(
        &self,
        seen: &[SeenStretch],
        efforts: &dyn Fn(f64) -> Vec<Option<f64>>,
        given: &Baseline,
        gains: &Gains,
        prices: (f64, f64),
    ) -> Option<Odds> {
        // Other units of the twin and an inertia far off would be two changes.
        let inertias = inertia_factors(LARGEST_RATIO);
        let mut best: Option<Odds> = None;
        for delay_s in self.tried_delays_s() {
            let regression = self.effort_regression_of(seen, &efforts(delay_s));
            if !regression.is_telling() {
                return None;
            }
            let of_motion = given.motion + regression.weight() * prices.0;
            let of_effort = given.effort + regression.weight() * prices.1;
            let mut all: Vec<(f64, Odds)> = Vec::new();
            for gain in gains {
                let motion = regression.of_motion(&inertias, *gain);
                let effort = regression.of_effort(&inertias, *gain);
                for ((m, u), inertia) in motion.iter().zip(&effort).zip(&inertias) {
                    let log = (m.evidence - of_motion).min(u.evidence - of_effort);
                    let inertia_ratio = 1.0 / (inertia * u.factor);
                    all.push((log, Odds { log, inertia_ratio, left: u.left }));
                }
            }
            let log = log_mean(&all.iter().map(|a| a.0).collect::<Vec<_>>());
            let top = all.iter().max_by(|a, b| a.0.total_cmp(&b.0))?.1;
            if best.is_none_or(|b| log > b.log) {
                best = Some(Odds { log, ..top });
            }
        }
        best
    }

    /// Log odds of a convention; `None` if it does not concern the joint.
    fn of_convention(&self, convention: &Convention, given: &Baseline) -> Option<Odds> {
        let stretches: Vec<&Stretch> = self.stretches.iter().collect();
        let seen = self.seen_stretches(&stretches, convention);
        let taken = self.seen_stretches(&stretches, &AS_GIVEN);
        if seen == taken && convention.effort == 1.0 {
            // A sliding joint does not depend on lengths.
            return None;
        }
        let efforts = |delay_s: f64| self.scaled_efforts(&stretches, delay_s, convention.effort);
        let odds =
            self.log_odds_of(&seen, &efforts, given, &about_one(), (0.0, -convention.effort.abs().ln()))?;
        let inertia_ratio = odds.inertia_ratio * inertial_size(&taken) / inertial_size(&seen).max(1e-300);
        Some(Odds { inertia_ratio, ..odds })
    }

    /// Recorded efforts of the joint over stretches, late by a delay and times a factor.
    fn scaled_efforts(&self, stretches: &[&Stretch], delay_s: f64, factor: f64) -> Vec<Option<f64>> {
        let own = self.recorded_efforts(self.joint, stretches, delay_s);
        own.into_iter().map(|u| u.map(|u| u * factor)).collect()
    }

    /// The joint without its stretches, with another share of independent ones.
    fn with_new_share(&self, share: f64) -> Self {
        Self { scene: self.scene, joint: self.joint, stretches: Vec::new(), share }
    }

    /// Log odds of another joint's efforts being those of this joint: they must explain its motion better
    /// than its own efforts do, and its motion must explain them better than the other joint's does.
    fn by_efforts_of(&self, other: &Self) -> Option<Odds> {
        let keys: BTreeSet<_> = other.stretches.iter().map(|s| s.key).collect();
        let both: Vec<&Stretch> = self.stretches.iter().filter(|s| keys.contains(&s.key)).collect();
        let keys: BTreeSet<_> = both.iter().map(|s| s.key).collect();
        let theirs: Vec<&Stretch> = other.stretches.iter().filter(|s| keys.contains(&s.key)).collect();
        let seen = self.seen_stretches(&both, &AS_GIVEN);
        let efforts = |delay_s: f64| self.recorded_efforts(other.joint, &both, delay_s);
        // Residuals of wrong efforts are correlated for long: the better explanation determines the share of
        // independent stretches.
        let share = self.share.max(self.with_share(&both, &seen, &efforts(0.0)).share);
        let gains = all_gains();
        let own = self.with_new_share(share).baseline_evidence(&both, &gains)?;
        let their = other.with_new_share(share).baseline_evidence(&theirs, &gains)?;
        let given = Baseline { motion: own.motion, ..their };
        self.with_new_share(share).log_odds_of(&seen, &efforts, &given, &about_one(), (0.0, 0.0))
    }
}

/// Values times factors, element by element.
fn scaled_values(values: &[f64], factors: &[f64]) -> Vec<f64> {
    values.iter().zip(factors).map(|(x, f)| x * f).collect()
}

/// Root of the summed squares of the inertial efforts.
fn inertial_size(seen: &[SeenStretch]) -> f64 {
    seen.iter().map(|s| s.inertial.powi(2)).sum::<f64>().sqrt()
}

/// Doubts about the input, by joint index.
#[must_use]
pub fn doubts_of_scene(scene: &Scene) -> BTreeMap<usize, Doubt> {
    let joints: Vec<JointScene> = scene.joints.iter().map(|j| JointScene::of_joint(scene, *j)).collect();
    let mut found = BTreeMap::new();
    let mut undecided: Vec<(usize, Vec<(Convention, f64)>)> = Vec::new();
    for own in &joints {
        let stretches: Vec<&Stretch> = own.stretches.iter().collect();
        // With another joint's efforts the residuals may be so correlated that these stretches alone
        // determine nothing.
        let given = own.baseline_evidence(&stretches, &all_gains());
        let motion = scene.tree.joints[own.joint].motion;
        let mut all: Vec<(Looks, Odds)> = Vec::new();
        if let Some(given) = &given {
            for convention in CONVENTIONS.iter().filter(|c| c.concerns_motion(motion)) {
                let odds = own.of_convention(convention, given);
                all.extend(odds.map(|odds| (Looks::Convention(*convention), odds)));
            }
        }
        for other in joints.iter().filter(|o| o.joint != own.joint) {
            if let Some(odds) = own.by_efforts_of(other) {
                all.push((Looks::EffortsOf(scene.tree.joints[other.joint].name.clone()), odds));
            }
        }
        if given.is_some() {
            let of_twin = all.iter().filter_map(|(looks, odds)| match looks {
                Looks::Convention(c) if c.is_of_twin() => Some((*c, odds.log)),
                _ => None,
            });
            undecided.push((own.joint, of_twin.collect()));
        }
        let left = given.map_or(1.0, |g| g.left);
        if let Some(doubt) = doubt_of_joint(&scene.tree.joints[own.joint].name, all, left) {
            found.insert(own.joint, doubt);
        }
    }
    share_conventions(scene, &undecided, &mut found);
    found
}

/// The doubt about one joint, if there is one.
fn doubt_of_joint(joint: &str, mut all: Vec<(Looks, Odds)>, left: f64) -> Option<Doubt> {
    all.sort_by(|a, b| b.1.log.total_cmp(&a.1.log));
    let best = all.first()?.1;
    let logs: Vec<f64> = all.iter().map(|a| a.1.log).collect();
    let log_odds = log_mean(&logs) + (logs.len() as f64).ln() + LOG_PRIOR;
    if !(log_odds > LOG_ODDS) {
        return None;
    }
    // The fewest conventions with a weight of `NAME_WEIGHT` together.
    let total: f64 = logs.iter().map(|l| (l - best.log).exp()).sum();
    let mut weight = 0.0;
    let mut looks = Vec::new();
    for (one, odds) in all {
        if weight > NAME_WEIGHT * total {
            break;
        }
        weight += (odds.log - best.log).exp();
        looks.push(one);
    }
    Some(Doubt {
        joint: joint.to_owned(),
        looks,
        log_odds,
        inertia_ratio: best.inertia_ratio,
        left: (best.left.min(1.0), left.min(1.0)),
        by: None,
    })
}

/// Applies a convention of the twin shown by one joint to all joints not contradicting it.
fn share_conventions(
    scene: &Scene,
    all: &[(usize, Vec<(Convention, f64)>)],
    found: &mut BTreeMap<usize, Doubt>,
) {
    let shown = found.values().filter(|d| d.looks.iter().all(is_of_twin));
    let Some(sure) = shown.max_by(|a, b| a.log_odds.total_cmp(&b.log_odds)).cloned() else { return };
    for j in scene.joints.iter().filter(|j| !found.contains_key(j)).copied().collect::<Vec<_>>() {
        let own = all.iter().find(|(joint, _)| *joint == j).map(|(_, odds)| odds.as_slice());
        if !own.is_some_and(|own| sure.looks.iter().all(|looks| contradicts_convention(own, looks))) {
            let joint = scene.tree.joints[j].name.clone();
            found.insert(j, Doubt { joint, by: Some(sure.joint.clone()), ..sure.clone() });
        }
    }
}

/// Whether a joint's log odds contradict a convention, or do not depend on it.
fn contradicts_convention(own: &[(Convention, f64)], looks: &Looks) -> bool {
    let known = own.iter().find(|(c, _)| *looks == Looks::Convention(*c));
    known.is_none_or(|(_, log)| *log < LOG_PRIOR)
}

fn is_of_twin(looks: &Looks) -> bool {
    matches!(looks, Looks::Convention(c) if c.is_of_twin())
}
