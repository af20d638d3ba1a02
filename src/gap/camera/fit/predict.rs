//! The twin as the true camera of a frame would see it.

use crate::camera::{
    model::{hypothesis::CameraErrors, small_motion::twist_motion, twin::SeenTwin},
    record::frames::FrameRun,
};
use geometry::Pose;
use surface::{Paint, RenderItem, Rendered, render};

/// Pose of the true camera of a frame, given the assumed camera errors.
pub fn true_camera(run: &FrameRun, frame: usize, camera: &CameraErrors) -> Pose {
    let reported = run.frames[frame].world_from_camera;
    let moved =
        run.velocities.get(frame).map_or_else(Pose::identity, |twist| twist_motion(twist, camera.delay_s));
    // Velocities are those of the reported poses, so the delay applies before the camera's offset.
    reported * moved * camera.reported_from_true
}

/// Renders the twin as a frame's camera would see it.
pub fn rendered_twin(
    twin: &SeenTwin,
    poses: &[Pose],
    intrinsics: &geometry::Intrinsics,
    camera: &Pose,
    shading: bool,
) -> Rendered {
    let items: Vec<RenderItem> = twin
        .parts
        .iter()
        .zip(poses)
        .map(|(p, pose)| RenderItem { mesh: &p.mesh, world_from_mesh: *pose, paint: Paint::Vertices })
        .collect();
    render(&items, intrinsics, camera, shading)
}
