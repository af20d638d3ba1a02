//! Settings of earlier versions, with what took their place. A file that still has one is refused with that.

/// Key of each removed setting or group of settings, and its replacement.
///
/// A constant is as the default was; its comment gives the reason of its value.
const REMOVED: &[(&str, &str)] = &[
    ("run.gpu", "the CPU does it"),
    ("capture.isolate.plane_in_workspace", "the support plane is always removed"),
    ("capture.isolate.plane_clearance_m", "a constant in src/capture/isolate/background.rs"),
    ("capture.isolate.plane_sigmas", "a constant in src/capture/isolate/background.rs"),
    ("capture.isolate.link_distance_m", "a constant in src/capture/isolate/mod.rs"),
    ("train.background_share", "a constant in src/field/sample.rs"),
    ("train.background_ring_px", "a constant in src/field/pool.rs"),
    ("train.learning_rate_decay", "a constant in src/field/trainer.rs"),
    ("train.color_weight", "a constant in src/field/sample.rs"),
    ("train.color_sharpness", "a constant in src/field/sample.rs"),
    ("train.initial_tsdf", "a constant in src/field/trainer.rs"),
    ("train.distance", "it is always measured along the ray"),
    ("train.outlier_from", "a constant in src/field/trainer.rs"),
    ("radiance.mask_weight", "a constant in src/field/radiance/loss.rs"),
    ("radiance.color_threshold", "a constant in src/field/radiance/config.rs"),
    ("radiance.keep_fields", "the second phase always starts with new fields"),
    ("surface.truncation_m", "surface.truncation_normalized, in units of half the scene's cube"),
    ("surface.min_readings", "a constant in src/run/band.rs"),
    ("matching.ratio", "a constant in src/capture/features/matcher.rs"),
    ("matching.features.scales", "a constant in src/capture/features/feature.rs"),
    ("matching.features.sigma_px", "a constant in src/capture/features/feature.rs"),
    ("matching.features.contrast", "a constant in src/capture/features/feature.rs"),
    ("matching.features.edge_ratio", "a constant in src/capture/features/feature.rs"),
    ("matching.features.mask_erosion_px", "a constant in src/capture/features/feature.rs"),
    ("matching.features.limit", "a constant in src/capture/features/feature.rs"),
    ("register.ransac", "constants in src/articulate/propose/ransac.rs"),
    ("register.first_reach", "a constant in src/articulate/parts/registrar.rs"),
    ("register.last_reach", "a constant in src/articulate/parts/registrar.rs"),
    ("register.least_score", "a constant in src/articulate/parts/score.rs"),
    ("register.least_static_share", "a constant in src/articulate/parts/part_count.rs"),
    ("articulation.samples_per_ray", "a constant in src/articulate/neural/ray_batch.rs"),
    ("articulation.field_rate", "a constant in src/articulate/neural/optimise.rs"),
    ("articulation.identity_motion_rate", "a constant in src/articulate/neural/optimise.rs"),
    ("articulation.refine_motion_rate", "a constant in src/articulate/neural/optimise.rs"),
    ("articulation.late_start", "a constant in src/articulate/neural/optimise.rs"),
    ("articulation.occupancy_ramp_m", "the spacing of the distance grid"),
    ("articulation.sdf_residual", "the absolute difference, as published"),
    ("articulation.noise_weights", "all rays weigh the same"),
    ("articulation.visibility_gradient", "visibility has no gradient"),
    ("articulation.weights.matching_3d", "matches count in the images alone (articulation.weights.matching)"),
    ("articulation.compatibility", "the published text counts everywhere"),
    (
        "joint.refine",
        "constants in src/articulate/joints/motion_evidence.rs, pair_evidence.rs and free_motion.rs",
    ),
    ("joint.texture", "constants in src/articulate/joints/texture.rs"),
    ("joint.square.tolerance_deg", "a constant in src/articulate/joints/square_axes.rs"),
    ("model.collision.min_thickness_m", "a constant in src/surface/convex/settings.rs"),
];

/// What took the place of a removed setting, as advice.
pub(crate) fn replacement_hint(key: &str) -> Option<String> {
    let (_, replacement) = REMOVED.iter().find(|(removed, _)| *removed == key)?;
    Some(format!("the setting is gone; in its place: {replacement}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, Layers};

    #[test]
    fn a_removed_setting_is_refused_with_its_replacement() {
        for (key, replacement) in REMOVED {
            let mut layers = Layers::new(&Config::default()).unwrap();
            let message = layers.add_setting(&format!("{key}=1")).unwrap_err().to_string();
            assert!(message.contains("is gone") && message.contains(replacement), "{message}");
        }
        let mut layers = Layers::new(&Config::default()).unwrap();
        let file = "register:\n  ransac:\n    cell: 0.03\n";
        let message = layers.add_text("mine.yaml", file).unwrap_err().to_string();
        assert!(message.starts_with("mine.yaml:2: unknown key register.ransac"), "{message}");
        // One key of a group that went as a whole.
        let message = layers.add_setting("joint.refine.reach=0.02").unwrap_err().to_string();
        assert!(message.contains("motion_evidence.rs"), "{message}");
    }

    #[test]
    fn places_of_constants_are_files() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for (key, replacement) in REMOVED {
            let places =
                replacement.split(' ').map(|w| w.trim_end_matches(',')).filter(|w| w.starts_with("src/"));
            for place in places {
                assert!(root.join(place).is_file(), "{key}: {place}");
            }
        }
    }
}
