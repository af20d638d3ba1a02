//! How far the stages of a run are from what the processor could do at best. Where a stage's work can be
//! counted beforehand, its time is held against the bytes, the sums and the readings of that work alone, done
//! plainly, by what the processor was measured to reach of each; other stages are listed with their time.
//!
//! `cargo bench --bench floors -- RUN_FOLDER [PIXELS]`: a run of the preset `default`, of images of so many
//! pixels (307200); prints Markdown.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench prints what it measured")]

mod machine;

use std::{error::Error, fs, path::PathBuf};

use config::Config;
use serde_json::Value;

/// Amounts of work: of a stage, or what the processor was measured to do in a second.
#[derive(Default)]
struct Work {
    /// Read from memory or written to it.
    gbytes: f64,
    /// Multiplications and additions, in 1e9.
    gflops: f64,
    /// Readings of four bytes out of order, in 1e9.
    readings: f64,
}

impl Work {
    /// Seconds of the kind of work that takes longest, and its name: the others could be done meanwhile.
    fn floor(&self, in_a_second: &Work) -> (f64, &'static str) {
        let all = [
            (self.gbytes / in_a_second.gbytes, "bytes"),
            (self.gflops / in_a_second.gflops, "flops"),
            (self.readings / in_a_second.readings, "readings"),
        ];
        all.into_iter().fold((0.0, ""), |most, kind| if kind.0 > most.0 { kind } else { most })
    }
}

/// Sizes of a run.
struct Sizes {
    /// Frames of each state.
    frames: Vec<f64>,
    /// Pixels of a frame.
    pixels: f64,
    config: Config,
}

impl Sizes {
    fn work(&self, stage: &str) -> Option<(Work, &'static str)> {
        let all: f64 = self.frames.iter().sum();
        let of_state = || self.frames.get(stage.rsplit("state").next()?.parse::<usize>().ok()?);
        let giga = |work: f64| 1e-9 * work;
        let nodes = |side: usize| (side as f64).powi(3);
        let surface = &self.config.surface;
        match stage.split('/').next()? {
            "capture" => {
                // Decoded depth, color and mask are written, read and written denoised. Features: six blurs
                // of an image of four times the pixels and its halves are written and read once each.
                let frame = (4.0 + 3.0 + 1.0) * 3.0 + 6.0 * 8.0 * 4.0 * 4.0 / 3.0;
                // Rows, then columns of the six Gaussians, which have 102 taps together.
                let taps = 2.0 * 2.0 * 102.0 * 4.0 * 4.0 / 3.0;
                let pixels = all * self.pixels;
                let work = Work { gbytes: giga(pixels * frame), gflops: giga(pixels * taps), readings: 0.0 };
                Some((work, "frames decoded, denoised and blurred"))
            }
            "match" => {
                // Each frame with its neighbors, all features that a frame may have with all, 128 numbers.
                let pairs = self.frames.first()? * self.config.matching.neighbors as f64;
                let features = self.config.matching.features.limit as f64;
                let gflops = giga(pairs * features * features * 2.0 * 128.0);
                Some((Work { gflops, ..Work::default() }, "products of descriptors"))
            }
            "fusion" => {
                // A node holds two sums and a color with its weight. Each view is read once at each node.
                let (nodes, views) = (nodes(surface.nodes), *of_state()?);
                let work = Work {
                    gbytes: giga(nodes * 24.0),
                    // A matrix by a point, two quotients, the distance and its sums.
                    gflops: giga(nodes * views * 28.0),
                    readings: giga(nodes * views),
                };
                Some((work, "each view read at each node"))
            }
            "surface" => {
                // Visible and free space read each view at each node of the distance field, one after the
                // other; the fused field is read, divided and copied.
                let (fused, nodes, views) =
                    (nodes(surface.nodes), nodes(surface.distance_nodes), *of_state()?);
                let work = Work {
                    gbytes: giga(fused * 20.0 + nodes * 8.0),
                    gflops: giga(nodes * views * 2.0 * 20.0),
                    readings: giga(nodes * views * 2.0),
                };
                Some((work, "visible and free: each view read at each node"))
            }
            _ => None,
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).filter(|a| !a.starts_with("--"));
    let Some(run) = arguments.next().map(PathBuf::from) else {
        eprintln!("floors: no run folder given, nothing measured");
        return Ok(());
    };
    let pixels = arguments.next().map_or(Ok(307_200.0), |p| p.parse())?;
    let report: Value = serde_json::from_str(&fs::read_to_string(run.join("report.json"))?)?;
    let frames = report["input"]["frames"].as_array().into_iter().flatten().filter_map(Value::as_f64);
    let sizes = Sizes { frames: frames.collect(), pixels, config: Config::default() };
    let peaks = Work {
        gbytes: machine::read_gbytes_per_s(),
        gflops: machine::peak_gflops(),
        readings: machine::readings_per_ns(pixels as usize),
    };
    println!(
        "{} threads: {:.1} GB/s, {:.0} Gflop/s, {:.2} readings out of order a nanosecond.\n",
        rayon::current_num_threads(),
        peaks.gbytes,
        peaks.gflops,
        peaks.readings
    );
    println!("| stage | took | counted | floor | by | times the floor |\n|---|---|---|---|---|---|");
    for stage in report["stages"].as_array().into_iter().flatten() {
        let (Some(name), Some(seconds)) = (stage["name"].as_str(), stage["seconds"].as_f64()) else {
            continue;
        };
        match sizes.work(name) {
            Some((work, counted)) => {
                let (floor, by) = work.floor(&peaks);
                let times = seconds / floor;
                println!("| {name} | {seconds:.2} s | {counted} | {floor:.2} s | {by} | {times:.1} |");
            }
            None => println!("| {name} | {seconds:.2} s | | | | |"),
        }
    }
    Ok(())
}
