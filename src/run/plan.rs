//! The coming stages of a run, and about how long each takes relative to the others.

use super::{Event, Planned, ReconstructRequest, outcome::CHECK_STAGE, stage::stage_of};
use config::{Config, Init, Method};

/// Weight of a second on the machine of the weights below. derived: hundredths of a run of 25 s
pub(super) const WEIGHT_OF_SECOND: f64 = 4.0;
// Measured on two cores: hundredths of a default run of two states, as the mean over a laptop, a drawer and a
// fridge. measured: those three runs
const CAPTURE: f64 = 22.0;
const MATCH: f64 = 4.0;
const ALIGN: f64 = 0.2;
const FUSION: f64 = 8.0;
const SURFACE: f64 = 9.0;
const REGISTER: f64 = 10.0;
const JOINTS: f64 = 4.0;
const ASSEMBLE: f64 = 17.0;
const PICTURES: f64 = 5.0;
const EXPORT: f64 = 3.0;
const CHECK: f64 = 1.0;
/// Weight of a sample in a field's training step and of a step of consistency, with presets `fields` and
/// `paper`. measured: the runs of these presets
const FIELD_SAMPLE: f64 = 2.5e-6;
const CONSISTENCY_STEP: f64 = 0.12;
/// Weight of a step of radiance fields, with presets `paris` and `paris-depth`.
/// measured: the runs of these presets
const RADIANCE_STEP: f64 = 0.25;

/// The stages of a run with `states` states, in order.
pub(super) fn plan(config: &Config, states: usize) -> Vec<Planned> {
    let mut stages = Vec::new();
    let mut add = |stage: &str, weight| stages.push(Planned { stage: stage.to_owned(), weight });
    add("capture", CAPTURE);
    for state in 1..states {
        add(&stage_of("match", state, states), MATCH);
        add(&stage_of("align", state, states), ALIGN);
    }
    let radiance = config.run.method == Method::Radiance;
    // Radiance fields with the published starts do not use surfaces.
    if !radiance || config.run.init == Init::Registration {
        for state in 0..states {
            add(&format!("fusion/state{state}"), FUSION);
            if config.trains_fields() {
                let samples = config.train.rays * (config.train.free_samples + config.train.band_samples);
                let steps = config.train.steps * samples;
                add(&format!("field/state{state}"), FIELD_SAMPLE * steps as f64);
            }
            add(&format!("surface/state{state}"), SURFACE);
        }
        (1..states).for_each(|state| add(&stage_of("register", state, states), REGISTER));
        if states > 2 {
            add("unite", REGISTER);
        }
    }
    if radiance {
        let fitted = RADIANCE_STEP * config.radiance.steps as f64;
        ["radiance/free", "radiance/typed"].iter().for_each(|stage| add(stage, fitted));
    } else {
        if config.seeks_consistency() {
            let steps = match config.run.init {
                Init::Registration => config.articulation.refine_steps,
                Init::Identity => config.articulation.identity_steps,
            };
            add("articulate", CONSISTENCY_STEP * steps as f64);
        }
        add("joints", JOINTS);
    }
    add("assemble", ASSEMBLE);
    add("pictures", PICTURES);
    add("export", EXPORT);
    add(CHECK_STAGE, CHECK);
    stages
}

/// Expected number of states of a recording.
fn states(request: &ReconstructRequest) -> usize {
    // A marker topic can divide one recording into any number of states: two are usual.
    let divided = request.config.capture.split_secs.len() + 1;
    io::state_count(&request.sources).unwrap_or_default().max(divided).max(2)
}

/// The event that a run reports before it begins.
pub(super) fn foreseen(request: &ReconstructRequest) -> Event {
    Event::Planned { stages: plan(&request.config, states(request)) }
}

/// The event that a finished run reports: no more stages are to come.
pub(super) fn settled(request: &ReconstructRequest) -> Event {
    let planned = plan(&request.config, states(request)).into_iter();
    Event::Planned { stages: planned.map(|p| Planned { weight: 0.0, ..p }).collect() }
}
