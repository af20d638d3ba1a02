//! Options on the reading of a recording, of every verb with recordings.

use clap::Args;
use serde_norway::Value;

use super::wanted::{Wanted, vector};
use capture::At;
use config::{ConfigError, Layers};

/// How a recording is read.
#[derive(Args, Clone, Debug)]
pub(super) struct RecordingArgs {
    /// Where one recording changes state: T, or T0,T1 to leave out what lies between; seconds from its start
    #[arg(long, value_name = "T[,T1]", value_delimiter = ',', num_args = 1)]
    pub split: Vec<f64>,
    /// Box around the object in the world frame, meters: x0,y0,z0,x1,y1,z1
    #[arg(long, value_name = "BOX", value_parser = workspace, allow_hyphen_values = true)]
    pub workspace: Option<[[f64; 3]; 2]>,
    /// The object, where masks are missing and it is not what changed: a place on it, x,y,z in meters in the
    /// world, or a pixel of a frame, e.g. 0_0007,320,240
    #[arg(long, value_name = "X,Y,Z", value_parser = at, allow_hyphen_values = true)]
    #[arg(conflicts_with = "workspace")]
    pub at: Option<At>,
    /// Topic to read: color, depth, color_info, depth_info, mask or pose, or marker, whose messages separate
    /// the states of one recording; may be repeated
    #[arg(long, value_name = "KIND=TOPIC", value_parser = topic)]
    pub topic: Vec<(String, String)>,
}

impl RecordingArgs {
    /// The settings of the options, as the last layer: an option wins over the same key by `--set`.
    ///
    /// # Errors
    /// If a value does not fit its key.
    pub(super) fn assign_settings(&self, layers: &mut Layers) -> Result<(), ConfigError> {
        let numbers = |n: &[f64]| Value::Sequence(n.iter().map(|v| Value::from(*v)).collect());
        let options = [
            ("--split", "capture.split_secs", (!self.split.is_empty()).then(|| numbers(&self.split))),
            (
                "--workspace",
                "capture.isolate.workspace",
                self.workspace.map(|b| Value::Sequence(b.iter().map(|c| numbers(c)).collect())),
            ),
            ("--at", "capture.isolate.at", self.at.as_ref().map(place_value)),
        ];
        for (option, key, value) in options {
            value.into_iter().try_for_each(|value| layers.add_option(option, key, value))?;
        }
        for (kind, topic) in &self.topic {
            layers.add_option("--topic", &format!("capture.topics.{kind}"), Value::from(topic.as_str()))?;
        }
        Ok(())
    }
}

fn place_value(at: &At) -> Value {
    match at {
        At::Point(point) => Value::Sequence(point.iter().map(|v| Value::from(*v)).collect()),
        At::Pixel { frame, pixel } => {
            let pixel = Value::Sequence(pixel.iter().map(|v| Value::from(*v as u64)).collect());
            let entries = [("frame", Value::from(frame.as_str())), ("pixel", pixel)];
            Value::Mapping(entries.into_iter().map(|(key, value)| (Value::from(key), value)).collect())
        }
    }
}

fn workspace(text: &str) -> Result<[[f64; 3]; 2], Wanted> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x0, y0, z0, x1, y1, z1]) => Ok([[x0, y0, z0], [x1, y1, z1]]),
        _ => Err(Wanted("six numbers x0,y0,z0,x1,y1,z1")),
    }
}

fn at(text: &str) -> Result<At, Wanted> {
    let wanted = Wanted("three numbers x,y,z, or FRAME,COLUMN,ROW, e.g. 0_0007,320,240");
    let words: Vec<&str> = text.split(',').map(str::trim).collect();
    let [first, second, third] = words[..] else { return Err(wanted) };
    if first.contains('_') {
        let pixel = [second.parse(), third.parse()];
        let [Ok(u), Ok(v)] = pixel else { return Err(wanted) };
        return Ok(At::Pixel { frame: first.to_owned(), pixel: [u, v] });
    }
    vector(text).map(At::Point).or(Err(wanted))
}

fn topic(text: &str) -> Result<(String, String), Wanted> {
    match text.split_once('=') {
        Some((kind, topic)) if !kind.is_empty() && !topic.is_empty() => {
            Ok((kind.to_owned(), topic.to_owned()))
        }
        _ => Err(Wanted("KIND=TOPIC, e.g. color=/camera/color/image_raw")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_point_or_a_pixel_of_a_frame() {
        assert_eq!(at("0.1, -2,3").unwrap(), At::Point([0.1, -2.0, 3.0]));
        let pixel = At::Pixel { frame: "0_0007".into(), pixel: [320, 240] };
        assert_eq!(at("0_0007,320,240").unwrap(), pixel);
        for wrong in ["", "1,2", "1,2,nan", "0_0007,3.5,2", "0_0007,-3,2", "1,2,3,4", "a,b,c"] {
            assert!(at(wrong).is_err(), "{wrong}");
        }
        let mut layers = Layers::new(&config::Config::default()).unwrap();
        layers.add_option("--at", "capture.isolate.at", place_value(&pixel)).unwrap();
        let resolved: config::Resolved<config::Config> = layers.resolve().unwrap();
        assert_eq!(resolved.config.capture.isolate.at, Some(pixel));
    }
}
