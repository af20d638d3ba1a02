//! Estimates a run's time and memory beforehand.

use std::path::PathBuf;

use serde::Serialize;

use super::DiagnoseRequest;
use capture::CaptureConfig;
use config::Config;
use io::{Glimpse, count_joint_messages, glimpse_views};

/// Time, memory and disk space for a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Processor cores that the run keeps busy.
    pub cores: u32,
    /// Largest memory use, bytes: an upper bound.
    pub memory_bytes: u64,
    /// Largest disk use by the result and the checkpoint, bytes.
    pub scratch_bytes: u64,
    /// Wall time on that many cores, seconds.
    pub seconds: f64,
}

impl Estimate {
    /// For a reconstruction; only summaries and a few messages of its recordings are read.
    pub fn of_reconstruction(sources: &[PathBuf], config: &Config) -> Self {
        // The command itself refuses unreadable recordings.
        let bags = glimpse_views(sources, &config.capture).unwrap_or_default();
        reconstruction(&bags, &config.capture, config.surface.nodes)
    }

    /// For a diagnosis; `frames` are RGB-D recordings.
    pub fn of_diagnosis(request: &DiagnoseRequest, frames: &[PathBuf]) -> Self {
        let recordings = request.runs.iter().chain(&request.held_out).chain(frames);
        let samples: f64 = recordings
            .map(|path| count_joint_messages(path, &request.streams).unwrap_or_default() as f64)
            .sum();
        Self {
            cores: CORES,
            memory_bytes: (DIAGNOSIS_MARGIN * (DIAGNOSIS_BYTES + BYTES_PER_SAMPLE * samples)) as u64,
            scratch_bytes: RESULT_BYTES as u64,
            seconds: DIAGNOSIS_SECONDS + SECONDS_PER_SAMPLE * samples,
        }
    }
}

/// Cores a run keeps busy: single-threaded and parallel stages alternate.
const CORES: u32 = 2;
/// Columns and rows of frames of unknown size.
const SIZE: (u32, u32) = (640, 480);

// Most memory of a run, by pixels of kept frames and nodes of the grid. Fitted to the eight bags of the
// README (640 x 480, 30 views a state) and `synth` objects of 320 x 240 with 8 views and 640 x 480 with 40,
// presets `default` and `preview`, two threads: `eval/estimate.md`. measured: eval/estimate.md
const BASE_BYTES: f64 = 52e6;
const BYTES_PER_PIXEL: f64 = 19.0;
const BYTES_PER_NODE: f64 = 45.0;
const BYTES_PER_NODE_AND_STATE: f64 = 12.5;
/// Factor on the fit that makes the estimate a bound: objects of many parts used up to 1.15 times the fit.
/// chosen: that, and a margin
const MEMORY_MARGIN: f64 = 1.35;
// Processor time, in the same units. Fitted to five of these bags (docs/figures.md); the share of a pixel is
// half that of a fit to all of the objects above, made when the program took twice as long.
// measured: docs/figures.md, eval/estimate.md
const BASE_SECONDS: f64 = 4.7;
const SECONDS_PER_PIXEL: f64 = 0.25e-6;
const SECONDS_PER_NODE: f64 = 1.15e-6;
/// Wall time per second of processor time on two cores, from ten runs on a quiet machine.
/// measured: those ten runs
const WALL: f64 = 0.57;
/// Bytes of the checkpoint and the result: per node of one state, and per pixel.
/// chosen: the approximate size of such files
const KEPT_PER_NODE: f64 = 14.0;
const KEPT_PER_PIXEL: f64 = 13.0;
const RESULT_BYTES: f64 = 40e6;

// A diagnosis by messages about joints: 3, 12 and 24 runs of one joint, 1,600 messages each, held 27, 42 and
// 63 MB and took 3, 15 and 40 s of one thread. measured: those runs; the margin is chosen
const DIAGNOSIS_BYTES: f64 = 22e6;
const BYTES_PER_SAMPLE: f64 = 1.1e3;
const DIAGNOSIS_MARGIN: f64 = 1.5;
const DIAGNOSIS_SECONDS: f64 = 1.0;
const SECONDS_PER_SAMPLE: f64 = 1e-3;

/// Number of pixels in the kept frames of a recording, `most_frames` at most.
fn kept_pixels(bag: &Glimpse, most_frames: f64) -> f64 {
    let (width, height) = bag.size.unwrap_or(SIZE);
    let frames = bag.frames.map_or(most_frames, |n| (n as f64).min(most_frames));
    frames * f64::from(width) * f64::from(height)
}

/// Estimate of a reconstruction with `nodes` of the grid along its longest side.
fn reconstruction(bags: &[Glimpse], capture: &CaptureConfig, nodes: usize) -> Estimate {
    // One recording holds two states.
    let states = bags.len().max(2) as f64;
    let most = capture.frames_per_state as f64 * states / bags.len().max(1) as f64;
    let unknown = most * f64::from(SIZE.0) * f64::from(SIZE.1);
    let kept: f64 =
        if bags.is_empty() { unknown } else { bags.iter().map(|bag| kept_pixels(bag, most)).sum() };
    let nodes = (nodes as f64).powi(3);
    let per_node = BYTES_PER_NODE + BYTES_PER_NODE_AND_STATE * states;
    // State 0 is compared with each other state.
    let pairs = states - 1.0;
    Estimate {
        cores: CORES,
        memory_bytes: (MEMORY_MARGIN * (BASE_BYTES + BYTES_PER_PIXEL * kept + per_node * nodes)) as u64,
        scratch_bytes: (KEPT_PER_NODE * nodes * states + KEPT_PER_PIXEL * kept + RESULT_BYTES) as u64,
        seconds: WALL * pairs * (BASE_SECONDS + SECONDS_PER_PIXEL * kept + SECONDS_PER_NODE * nodes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of a state that a preset keeps, and nodes of its grid.
    const DEFAULT: (usize, usize) = (40, 224);
    const PREVIEW: (usize, usize) = (20, 128);

    fn estimated(states: usize, frames: u64, size: (u32, u32), preset: (usize, usize)) -> Estimate {
        let capture = CaptureConfig { frames_per_state: preset.0, ..CaptureConfig::default() };
        let bag = Glimpse { frames: Some(frames), size: Some(size) };
        reconstruction(&vec![bag; states], &capture, preset.1)
    }

    #[test]
    fn memory_is_a_bound_within_a_factor_of_two() {
        // Most memory as it was measured, MB: `eval/estimate.md`. The last four had no part in the fit.
        for (states, frames, size, preset, measured) in [
            (2, 30, (640, 480), PREVIEW, 390.0..496.0),
            (2, 30, (640, 480), DEFAULT, 920.0..1242.0),
            (2, 8, (320, 240), PREVIEW, 222.0..222.0),
            (2, 8, (320, 240), DEFAULT, 857.0..857.0),
            (2, 40, (640, 480), DEFAULT, 1209.0..1209.0),
            (3, 20, (640, 480), PREVIEW, 652.0..652.0),
            (3, 20, (640, 480), DEFAULT, 1538.0..1538.0),
            (2, 12, (1280, 720), PREVIEW, 618.0..618.0),
            (2, 12, (1280, 720), DEFAULT, 1075.0..1075.0),
            (2, 60, (848, 480), DEFAULT, 1294.0..1294.0),
            (2, 16, (960, 540), PREVIEW, 563.0..563.0),
        ] {
            let bound = estimated(states, frames, size, preset).memory_bytes as f64 * 1e-6;
            assert!(bound > measured.end && bound < 2.0 * measured.start, "{size:?} {measured:?} {bound}");
        }
    }

    #[test]
    fn a_recording_of_both_states_costs_what_two_do() {
        let two = estimated(2, 30, (640, 480), DEFAULT);
        let one = estimated(1, 60, (640, 480), DEFAULT);
        assert_eq!((one.memory_bytes, one.seconds), (two.memory_bytes, two.seconds));
        assert!(two.scratch_bytes > 300 << 20 && two.cores == 2);
    }
}
