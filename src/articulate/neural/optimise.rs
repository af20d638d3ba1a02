//! The optimiser of stage 2: part segmentation of both states and the rigid motions between them, by
//! consistency (docs/method.md 12.8).

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    neural::{
        adam::{FieldMoments, rate_at},
        config::ArticulationConfig,
        label_fit::LabelSet,
        motion_params::{MotionGradient, Motions, Way},
        objective::{ArticulationLosses, Objective, StateBatch},
        ray_batch::RayBatch,
        segmentation::{GumbelNoise, SegmentationField, SegmentationGradient},
        state_model::{StateModel, Volume},
        trainer_error::TrainerError,
        trainer_input::{
            LabelledPoints, check_labels, check_matches, check_motions, check_scale, check_state,
        },
        uniform_batch::{OccupiedState, OccupiedVoxels, UniformBatch},
    },
    observations::LiftedMatch,
};
use geometry::{Pose, SceneBox};
use numeric::random::{index_below, stage_rng};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// Names of the random streams of the two states.
const STREAMS: [&str; 2] = ["articulate/state0", "articulate/state1"];

/// First and last learning rate of the segmentation fields; it falls exponentially.
/// derived: the published ones
const FIELD_RATE: [f64; 2] = [0.01, 0.001];
/// First and last learning rate of motions started from the identity, in radians and half sides of the scene
/// cube. derived: the published ones
const IDENTITY_MOTION_RATE: [f64; 2] = [0.01, 1e-5];
/// The same for motions started from a registration. chosen: a tenth, as they are close to the solution
const REFINE_MOTION_RATE: [f64; 2] = [1e-3, 1e-5];
/// Share of the steps after which occupancy and collision count.
/// derived: the published 500 of 2000 steps (docs/method.md 12.8)
const LATE_START: f64 = 0.25;

/// Where the search starts.
#[derive(Clone, Copy, Default)]
pub struct ArticulationStart<'a> {
    /// `state1_from_state0` of every part in the world, the first the identity; `None` starts all of them
    /// from the identity, as published.
    pub motions: Option<&'a [Pose]>,
    /// Labelled surface points of both states for a first fit of the segmentation.
    pub labels: Option<[&'a LabelledPoints; 2]>,
}

/// The inputs of both states together.
#[derive(Clone, Copy)]
pub struct ArticulationProblem<'a> {
    /// The frozen reconstructions.
    pub states: [StateModel<'a>; 2],
    /// Surface points seen in both states.
    pub matches: &'a [LiftedMatch],
    /// The cube around the object in both states.
    pub scene: SceneBox,
    /// Truncation distance of the fields, meters.
    pub truncation_m: f64,
    /// Number of parts with the static one.
    pub parts: usize,
}

/// The changing state of the search: a resumed run gives bit for bit the same result as an uninterrupted one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArticulationCheckpoint {
    seed: u64,
    total: usize,
    steps: usize,
    motions: Motions,
    fields: [SegmentationField; 2],
    moments: [FieldMoments; 2],
}

/// Optimises part segmentation and motions. One [`Self::step`] covers both states: each segmentation gets its
/// own gradient, the motions get the sum of both.
pub struct ArticulationTrainer<'a> {
    volumes: [Volume<'a>; 2],
    occupied: [OccupiedVoxels; 2],
    matches: Vec<LiftedMatch>,
    labels: Option<[LabelSet; 2]>,
    scene: SceneBox,
    config: ArticulationConfig,
    label_steps: usize,
    motion_rate: [f64; 2],
    state: ArticulationCheckpoint,
    gradients: [SegmentationGradient; 2],
}

impl<'a> ArticulationTrainer<'a> {
    /// Prepares the search. Equal inputs and seed give equal results for any number of threads.
    ///
    /// # Errors
    /// [`TrainerError`] for settings out of range and for empty, not finite or inconsistent inputs.
    pub fn new(
        problem: &ArticulationProblem<'a>,
        start: ArticulationStart<'_>,
        config: &ArticulationConfig,
        seed: u64,
    ) -> Result<Self, TrainerError> {
        let parts = problem.parts;
        check_scale(parts, problem.truncation_m)?;
        config.check()?;
        check_state(0, &problem.states[0])?;
        check_state(1, &problem.states[1])?;
        check_matches(&problem.states, problem.matches)?;
        check_motions(start.motions, parts)?;
        check_labels(start.labels, parts)?;

        // A registration is close to the solution: fewer and smaller steps.
        let (main_steps, motion_rate) = match start.motions {
            None => (config.identity_steps, IDENTITY_MOTION_RATE),
            Some(_) => (config.refine_steps, REFINE_MOTION_RATE),
        };
        let volumes = problem.states.map(|model| Volume {
            model,
            scene: problem.scene,
            truncation_m: problem.truncation_m,
            ramp_m: model.sdf.spacing_m,
        });
        let identity = vec![Pose::identity(); parts];
        let motions = Motions::from_world(start.motions.unwrap_or(&identity), &problem.scene);
        let label_steps = if start.labels.is_some() { config.label_steps } else { 0 };
        let labels = start.labels.map(|both| {
            both.map(|(points, labels)| LabelSet {
                points: points.iter().map(|p| problem.scene.normalise(p)).collect(),
                labels: labels.clone(),
            })
        });
        let fields = STREAMS.map(|name| {
            // The number of a step that is never taken: initial values use a random stream of their own.
            SegmentationField::random_field(parts, config.grid_nodes, &mut stage_rng(seed, name, u64::MAX))
        });
        let moments = [FieldMoments::new(&fields[0]), FieldMoments::new(&fields[1])];
        Ok(Self {
            occupied: [OccupiedVoxels::of(&volumes[0]), OccupiedVoxels::of(&volumes[1])],
            matches: problem.matches.to_vec(),
            labels,
            scene: problem.scene,
            config: config.clone(),
            label_steps,
            motion_rate,
            gradients: [fields[0].zero_gradient(), fields[1].zero_gradient()],
            state: ArticulationCheckpoint {
                seed,
                total: label_steps + main_steps,
                steps: 0,
                motions,
                fields,
                moments,
            },
            volumes,
        })
    }

    /// Total number of steps, including those of the label fit.
    pub fn total_steps(&self) -> usize {
        self.state.total
    }

    /// Number of steps taken.
    pub fn steps(&self) -> usize {
        self.state.steps
    }

    /// Whether all steps were taken.
    pub fn is_done(&self) -> bool {
        self.state.steps >= self.state.total
    }

    /// Takes one optimiser step; returns the losses before it.
    pub fn step(&mut self) -> ArticulationLosses {
        let losses = if self.state.steps < self.label_steps { self.label_step() } else { self.motion_step() };
        self.state.steps += 1;
        losses
    }

    /// `state1_from_state0` of every part in the world, meters; the first is the identity.
    pub fn motions(&self) -> Vec<Pose> {
        self.state.motions.world(&self.scene)
    }

    /// Part probabilities at world points of a state, `parts` values a point.
    pub fn probabilities(&self, state: usize, points: &[Point3<f64>]) -> Vec<f32> {
        let normalised: Vec<[f32; 3]> =
            points.iter().map(|p| self.scene.normalise(p).coords.cast::<f32>().into()).collect();
        self.state.fields[state].probabilities(&normalised)
    }

    /// The most probable part at world points of a state; of equals the first.
    pub fn labels(&self, state: usize, points: &[Point3<f64>]) -> Vec<u8> {
        let probabilities = self.probabilities(state, points);
        let rows = probabilities.chunks_exact(self.state.fields[state].parts);
        rows.map(|row| (1..row.len()).fold(0, |best, k| if row[k] > row[best] { k } else { best }) as u8)
            .collect()
    }

    /// Everything needed to continue.
    pub fn checkpoint(&self) -> &ArticulationCheckpoint {
        &self.state
    }

    /// Continues from a checkpoint of a trainer with the same inputs, settings and seed.
    ///
    /// # Errors
    /// [`TrainerError::Checkpoint`] if seed, steps or shapes differ.
    pub fn restore(&mut self, checkpoint: ArticulationCheckpoint) -> Result<(), TrainerError> {
        let differs = |what| Err(TrainerError::Checkpoint { what });
        if checkpoint.seed != self.state.seed {
            return differs("the seed");
        }
        if checkpoint.total != self.state.total || checkpoint.steps > checkpoint.total {
            return differs("the number of steps");
        }
        let fits = self.state.fields.iter().enumerate().all(|(s, field)| {
            checkpoint.fields[s].same_shape(field) && checkpoint.moments[s].has_shape_of(field)
        });
        if checkpoint.motions.parts.len() != self.state.motions.parts.len() || !fits {
            return differs("the shape of the fields");
        }
        self.state = checkpoint;
        Ok(())
    }

    fn label_step(&mut self) -> ArticulationLosses {
        let Some(labels) = &self.labels else { return ArticulationLosses::default() };
        let seed = self.state.seed;
        let step = self.state.steps as u64;
        let fields = &self.state.fields;
        let count = self.config.label_points;
        // Half a cell of the grid.
        let reach = 1.0 / (self.config.grid_nodes - 1) as f64;
        let [g0, g1] = &mut self.gradients;
        let (a, b) = rayon::join(
            || labels[0].loss(&fields[0], count, reach, g0, &mut stage_rng(seed, STREAMS[0], step)),
            || labels[1].loss(&fields[1], count, reach, g1, &mut stage_rng(seed, STREAMS[1], step)),
        );
        // Labels are only a start, so their learning rate does not fall.
        self.step_fields(FIELD_RATE[0]);
        let mean = 0.5 * (a + b);
        ArticulationLosses { labels: mean, total: mean, ..ArticulationLosses::default() }
    }

    fn motion_step(&mut self) -> ArticulationLosses {
        let done = self.state.steps - self.label_steps;
        let main = self.state.total - self.label_steps;
        let (losses, by_motions) = self.losses_and_gradients(done as f64 >= LATE_START * main as f64);
        self.step_fields(rate_at(FIELD_RATE, done, main));
        self.state.motions.step(&by_motions, rate_at(self.motion_rate, done, main));
        losses
    }

    /// Losses and gradients of both states at fresh samples.
    fn losses_and_gradients(&mut self, volumes_active: bool) -> (ArticulationLosses, MotionGradient) {
        let Self { volumes, occupied, matches, config, state, gradients, .. } = self;
        // Seeded by the step number, so a resumed run draws the same as an uninterrupted one.
        let mut rngs = STREAMS.map(|name| stage_rng(state.seed, name, state.steps as u64));
        let [r0, r1] = &mut rngs;
        let (a, b) = rayon::join(
            || RayBatch::draw(&volumes[0], config, r0),
            || RayBatch::draw(&volumes[1], config, r1),
        );
        // The rays of both states serve the losses of both: as a state's own samples and as collision points
        // of the other.
        let step = StepInputs { volumes, occupied, matches, config, state, rays: [a, b], volumes_active };
        let [g0, g1] = gradients;
        let [r0, r1] = &mut rngs;
        let ((l0, mut m0), (l1, m1)) =
            rayon::join(|| step.state_losses(0, g0, r0), || step.state_losses(1, g1, r1));
        // Motions are shared by both states, segmentations are not.
        m0.merge(&m1);
        (ArticulationLosses::mean(&l0, &l1), m0)
    }

    fn step_fields(&mut self, rate: f64) {
        let [f0, f1] = &mut self.state.fields;
        let [m0, m1] = &mut self.state.moments;
        let [g0, g1] = &mut self.gradients;
        rayon::join(|| m0.step(f0, g0, rate), || m1.step(f1, g1, rate));
    }
}

/// The inputs of one step, common to the losses of both states.
struct StepInputs<'s, 'a> {
    volumes: &'s [Volume<'a>; 2],
    occupied: &'s [OccupiedVoxels; 2],
    matches: &'s [LiftedMatch],
    config: &'s ArticulationConfig,
    state: &'s ArticulationCheckpoint,
    rays: [RayBatch; 2],
    /// Whether the occupancy and collision losses are active.
    volumes_active: bool,
}

impl StepInputs<'_, '_> {
    /// Losses of the segmentation of state `source` at fresh samples, and their gradient by the motions. Adds
    /// the gradient by the field.
    fn state_losses(
        &self,
        source: usize,
        gradient: &mut SegmentationGradient,
        rng: &mut Pcg64Mcg,
    ) -> (ArticulationLosses, MotionGradient) {
        let Self { volumes, occupied, config, state, rays, .. } = self;
        let target = 1 - source;
        let way = Way::from_state(source);
        let chosen = choose_matches(self.matches, config.matches, rng);
        let uniform = self.volumes_active.then(|| {
            let [here, other] =
                [target, source].map(|s| OccupiedState { volume: &volumes[s], voxels: &occupied[s] });
            UniformBatch::draw(config.uniform_points, here, other, &state.motions, way.reverse(), rng)
        });
        let batch = StateBatch {
            rays: &rays[source],
            matches: &chosen,
            uniform: uniform.as_ref(),
            collision: self.volumes_active.then_some(&rays[target].points[..]),
            noise: GumbelNoise { key: Some(rng.next_u64()) },
        };
        let objective = Objective {
            source: &volumes[source],
            target: &volumes[target],
            way,
            motions: &state.motions,
            config,
        };
        objective.evaluate(&state.fields[source], &batch, gradient)
    }
}

/// Up to `count` matches: all of them, or as many drawn at random with replacement.
fn choose_matches(matches: &[LiftedMatch], count: usize, rng: &mut impl Rng) -> Vec<LiftedMatch> {
    if matches.len() <= count {
        matches.to_vec()
    } else {
        (0..count).map(|_| matches[index_below(rng, matches.len())]).collect()
    }
}
