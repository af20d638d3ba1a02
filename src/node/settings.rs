//! Settings of a run and of the collector, from the node's parameters.

use serde_norway::Value;

use super::{
    collector::CollectorSettings, keyframes::KeyframeRule, live_tracking::TrackSettings,
    motion_watch::WatchRule, parameters::Parameters, state_bag::Topics,
};
use config::{Config, ConfigError, Layers, Resolved};
use surface::LiveSettings;

/// Views held back in automatic states, as motion is detected a few views late.
const HELD_VIEWS: usize = 4;
/// Frame of published tracked poses: named as in REP 105, and RViz's default.
const MAP_FRAME: &str = "map";

/// Merges preset, file and single settings of the parameters.
///
/// # Errors
/// If the file cannot be read, or a setting is unknown.
pub(crate) fn base_layers(p: &Parameters) -> Result<Layers, ConfigError> {
    let mut layers = Layers::new(&Config::default())?;
    if !p.preset.is_empty() {
        layers.add_preset(&p.preset)?;
    }
    if !p.config_file.is_empty() {
        layers.add_file(p.config_file.as_ref())?;
    }
    p.settings.iter().try_for_each(|assignment| layers.add_setting(assignment))?;
    Ok(layers)
}

/// Adds the topics, frames and other settings of the parameters to layers.
///
/// # Errors
/// If a setting is invalid.
pub(crate) fn run_settings(
    mut layers: Layers,
    p: &Parameters,
    topics: &Topics,
) -> Result<Resolved<Config>, ConfigError> {
    let text = |s: &String| (!s.is_empty()).then(|| Value::from(s.as_str()));
    // Topics after remapping, as in the bags.
    let assigned = [
        ("color_topic", "capture.topics.color", text(&topics.color)),
        ("depth_topic", "capture.topics.depth", text(&topics.depth)),
        ("camera_info_topic", "capture.topics.color_info", text(&topics.color_info)),
        ("mask_topic", "capture.topics.mask", topics.mask.as_ref().and_then(text)),
        ("pose_topic", "capture.topics.pose", topics.pose.as_ref().and_then(|(name, _)| text(name))),
        ("world_frame", "capture.world_frame", text(&p.world_frame)),
        ("tracking", "capture.tracking", text(&p.tracking)),
        ("pose_frame", "capture.pose_frame", text(&p.pose_frame)),
        ("parts", "run.parts", (p.parts > 0).then(|| Value::from(p.parts))),
    ];
    for (parameter, key, value) in assigned {
        value.into_iter().try_for_each(|v| layers.add_option(&format!("parameter {parameter}"), key, v))?;
    }
    Config::from_layers(layers)
}

/// Settings of the collector; synchronization and gaps are those of the run.
#[must_use]
pub(crate) fn collector_settings(p: &Parameters, topics: Topics, config: &Config) -> CollectorSettings {
    let count = |n: i64| usize::try_from(n).unwrap_or(1);
    let capture = &config.capture;
    CollectorSettings {
        capture: capture.clone(),
        poses_asked: capture.world_frame.is_some() || capture.pose_frame.is_some() || topics.pose.is_some(),
        tracking: capture.tracking,
        map_frame: capture.world_frame.clone().unwrap_or_else(|| MAP_FRAME.to_owned()),
        topics,
        world_frame: config.capture.world_frame.clone(),
        pose_frame: (!p.pose_frame.is_empty()).then(|| p.pose_frame.clone()),
        slop_nanos: (config.capture.sync_slop_secs * 1e9) as i64,
        max_gap_nanos: (config.capture.tf_max_gap_secs * 1e9) as i64,
        queue: count(p.sync_queue),
        rule: KeyframeRule {
            translation_m: p.keyframe_translation_m,
            rotation_rad: p.keyframe_rotation_deg.to_radians(),
            most: count(p.max_keyframes),
        },
        // If people finish a state themselves, its views show no motion.
        hold: if p.automatic_states { HELD_VIEWS } else { 0 },
    }
}

/// Settings of live tracking, as in the pipeline.
#[must_use]
pub(crate) fn track_settings(p: &Parameters, topics: Topics, config: &Config) -> TrackSettings {
    TrackSettings {
        config: config.capture.clone(),
        topics,
        seed: config.run.seed,
        most: usize::try_from(p.max_keyframes).unwrap_or(1),
    }
}

/// Settings of the live map.
#[must_use]
pub(crate) fn live_settings(p: &Parameters, config: &Config) -> LiveSettings {
    let megabytes = usize::try_from(p.live_map_megabytes).unwrap_or(0);
    LiveSettings { noise: config.capture.noise, most_bytes: megabytes << 20 }
}

/// Settings of automatic states, if enabled.
#[must_use]
pub(crate) fn watch_rule(p: &Parameters) -> Option<WatchRule> {
    let count = |n: i64| usize::try_from(n).unwrap_or(1);
    p.automatic_states.then(|| WatchRule {
        still_nanos: (p.still_secs * 1e9) as i64,
        least: count(p.min_keyframes),
        enough: count(p.enough_keyframes),
    })
}
