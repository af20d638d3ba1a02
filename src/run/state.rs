//! A state in the pipeline: its frames, and what all stages found.

use super::{
    RunError, Stages,
    alignment::{Aligned, Drift},
    fields::{TrainedField, train_field},
    scene::Scene,
    state_surface::{StateSurface, fuse, state_surface},
};
use articulate::{LiftedMatch, ObservedState, SurfaceDraws};
use capture::RgbdFrame;
use field::{ObjectField, Occupancy, TrainInput};
use surface::{SurfaceSource, TsdfVolume};

/// One state, in the world frame of state 0.
pub(super) struct State<'a> {
    pub frames: &'a [RgbdFrame],
    /// Matches with state 0; empty for state 0 itself.
    pub matches: Vec<LiftedMatch>,
    /// How it was brought into the world frame of state 0; none if it was recorded there.
    pub drift: Option<Drift>,
    /// Its field, if one was trained.
    pub field: Option<TrainedField>,
    pub surface: StateSurface,
}

impl State<'_> {
    /// Its field, if one was trained.
    pub(crate) fn field(&self) -> Option<&ObjectField> {
        self.field.as_ref().map(|f| &f.field)
    }

    /// The state in the form that joint estimation uses.
    pub(crate) fn observed<'a>(&'a self, labels: &'a [u8], draws: &'a SurfaceDraws) -> ObservedState<'a> {
        ObservedState {
            frames: self.frames,
            samples: &self.surface.samples,
            labels,
            sdf: &self.surface.sdf,
            visible: &self.surface.visible,
            area_m2: self.surface.mesh.area_m2(),
            draws,
        }
    }
}

/// Surfaces and, if needed, fields of all states, one after the other.
///
/// # Errors
/// A state without a surface, a failed training, a stop request.
pub(super) fn observe<'a>(
    frames: &'a [Vec<RgbdFrame>],
    aligned: Vec<Aligned>,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Vec<State<'a>>, RunError> {
    let occupancy = scene.config.trains_fields().then(|| occupancy(frames, scene));
    let mut states = Vec::with_capacity(frames.len());
    for (state, (frames, Aligned { matches, drift })) in frames.iter().zip(aligned).enumerate() {
        let (field, surface) = observe_state(state, frames, occupancy.as_ref(), scene, stages)?;
        states.push(State { frames, matches, drift, field, surface });
    }
    Ok(states)
}

/// The surface of a state, and its field if occupied cells are given.
fn observe_state(
    state: usize,
    frames: &[RgbdFrame],
    occupancy: Option<&Occupancy>,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<(Option<TrainedField>, StateSurface), RunError> {
    let config = &scene.config.surface;
    let stage = format!("surface/state{state}");
    // The volume is not kept: it is twice as large as its surface, and writing it takes a tenth of the time
    // of its fusion. For a field it is fused again.
    if !scene.config.trains_fields()
        && let Some(kept) = stages.recall::<_, RunError>(&stage)?
    {
        return Ok((None, kept));
    }
    let volume =
        stages.run(&format!("fusion/state{state}"), None, |_| Ok::<_, RunError>(fuse(frames, scene)))?;
    let field = field(state, frames, occupancy, &volume, scene, stages)?;
    // A field trained only for consistency is not the source of the surface.
    let trained = field.as_ref().map(|f| &f.field).filter(|_| config.source == SurfaceSource::Field);
    let surface = stages.kept(&stage, None, |_| state_surface(frames, &volume, trained, scene))?;
    Ok((field, surface))
}

/// The field of a state near the occupied cells, around the fused volume; cells are given if fields are
/// needed.
fn field(
    state: usize,
    frames: &[RgbdFrame],
    occupancy: Option<&Occupancy>,
    volume: &TsdfVolume,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Option<TrainedField>, RunError> {
    let Some(occupancy) = occupancy else { return Ok(None) };
    let fused = volume.distance_grid(scene.band.min_weight);
    let input = TrainInput { frames, scene: scene.bounds, occupancy, fused: Some(&fused) };
    let stage = format!("field/state{state}");
    let checkpoint = stages.checkpoint;
    stages
        .run(&stage, Some(scene.config.train.steps), |monitor| {
            train_field(&stage, &input, scene, checkpoint, monitor)
        })
        .map(Some)
}

/// Cells near the object in any state.
fn occupancy(states: &[Vec<RgbdFrame>], scene: &Scene) -> Occupancy {
    const EVERY: usize = 7;
    let mut points = Vec::new();
    for frame in states.iter().flatten() {
        let pixels = (0..frame.depth_m.len()).step_by(EVERY).filter(|&i| frame.is_object(i));
        points.extend(pixels.filter_map(|i| frame.world_point(i)));
    }
    let cell_m = scene.band.truncation_m.max(0.02 * scene.bounds.extent_m());
    Occupancy::new(&scene.bounds, &points, cell_m, 2)
}
