//! Pixel matches (docs/method.md 12.8, the form with one sample): the blended image of a lifted match must
//! project onto its pixel in the other state.

use nalgebra::{Point3, Vector3};

use crate::{
    neural::{
        loss_term::LossTerm,
        motion_params::{Motions, Way},
        state_model::Volume,
    },
    observations::LiftedMatch,
};

/// Some matches, the state they are moved to, and the motions.
pub(crate) struct Matching<'a> {
    pub matches: &'a [LiftedMatch],
    /// The state the points are moved to.
    pub target: &'a Volume<'a>,
    pub motions: &'a Motions,
    pub way: Way,
}

impl Matching<'_> {
    /// World point of a match in the state it is moved from.
    pub(crate) fn start(pair: &LiftedMatch, way: Way) -> Point3<f64> {
        if way == Way::Forward { pair.point0 } else { pair.point1 }
    }

    /// Index of the state the points are moved to.
    fn end(&self) -> usize {
        usize::from(self.way == Way::Forward)
    }

    /// Normalised image of a match's start under each part, and their blend.
    fn images(&self, pair: &LiftedMatch, p: &[f32]) -> (Point3<f64>, Vec<Point3<f64>>, Point3<f64>) {
        let start = self.target.scene.normalise(&Self::start(pair, self.way));
        let images: Vec<_> = (0..p.len()).map(|i| self.motions.apply(i, self.way, &start)).collect();
        let blend: Vector3<f64> = images.iter().zip(p).map(|(y, p)| y.coords * f64::from(*p)).sum();
        (start, images, Point3::from(blend))
    }

    /// Mean L1 distance in pixels between projection and matched pixel, in image heights. Points behind the
    /// camera, or within a truncation distance of it, are left out.
    pub(crate) fn pixel_loss(&self, probabilities: &[f32]) -> LossTerm {
        let parts = self.motions.parts.len();
        let mut valid = 0usize;
        let mut term = self.sum(probabilities, |pair, blend| {
            let end = self.end();
            let (camera, world_from_camera) = &self.target.model.cameras[pair.frames[end]];
            let point = world_from_camera.inverse_transform_point(&self.target.scene.to_world(blend));
            // Close to the camera the slope of the projection has no bound.
            let (u, v) = camera.project(&point).filter(|_| point.z > self.target.truncation_m)?;
            valid += 1;
            let height = camera.height as f64;
            let residual = [u - f64::from(pair.pixels[end][0]), v - f64::from(pair.pixels[end][1])];
            // The L1 norm: one wrong match pulls no harder than a right one.
            let su = residual[0].signum() * camera.fx / point.z / height;
            let sv = residual[1].signum() * camera.fy / point.z / height;
            // The slope of the projection docs/method.md (1.1).
            let by_camera = Vector3::new(su, sv, -(su * point.x + sv * point.y) / point.z);
            let by_blend = (world_from_camera.rotation * by_camera) / self.target.scene.scale;
            // docs/method.md (12.18).
            Some(((residual[0].abs() + residual[1].abs()) / height, by_blend))
        });
        // The count is known only now: matches whose image is behind the camera do not count.
        let factor = 1.0 / valid.max(1) as f64;
        term.value *= factor;
        term.by_probabilities.iter_mut().for_each(|g| *g *= factor as f32);
        term.by_motions = std::mem::replace(
            &mut term.by_motions,
            crate::neural::motion_params::MotionGradient::zero(parts),
        )
        .scaled(factor);
        term
    }

    /// Sums a loss of the blended image, given together with its gradient by the image.
    fn sum(
        &self,
        probabilities: &[f32],
        mut loss: impl FnMut(&LiftedMatch, &Point3<f64>) -> Option<(f64, Vector3<f64>)>,
    ) -> LossTerm {
        let parts = self.motions.parts.len();
        let mut term = LossTerm::zero(self.matches.len(), parts);
        for (k, (pair, p)) in self.matches.iter().zip(probabilities.chunks_exact(parts)).enumerate() {
            let (start, images, blend) = self.images(pair, p);
            let Some((value, by_blend)) = loss(pair, &blend) else { continue };
            term.value += value;
            for (i, image) in images.iter().enumerate() {
                term.by_probabilities[k * parts + i] = by_blend.dot(&image.coords) as f32;
                term.by_motions.add(self.motions, i, self.way, &start, &(by_blend * f64::from(p[i])));
            }
        }
        term
    }
}
