//! The accelerometer readings of a recording, from an instrument fixed to its camera.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::ros2msg::imu::Imu;
use capture::{Accelerometer, TfBuffer};
use common::note::{Note, NoteCode};

/// Type of the messages.
pub const IMU_TYPE: &str = "sensor_msgs/msg/Imu";

/// The accelerations of a topic.
#[derive(Clone, Debug, Default)]
pub struct ImuTopic {
    /// Frame of the first message.
    pub frame: String,
    /// Stamp, nanoseconds, and reading, m/s², in that frame.
    pub readings: Vec<(i64, Vector3<f64>)>,
}

impl ImuTopic {
    /// Takes a message with frame and acceleration; returns whether it had both.
    pub fn add(&mut self, stamp_nanos: i64, frame: String, message: &Imu) -> bool {
        if self.readings.is_empty() {
            self.frame = frame;
        } else if self.frame != frame {
            return false;
        }
        let read = message.acceleration();
        self.readings.extend(read.map(|a| (stamp_nanos, a)));
        read.is_some()
    }
}

/// The accelerometer for the up direction in the color images' frame: of the topics whose frame is fixed to
/// that frame, the one with most readings. Also returns notes, or the reason why there is none.
pub(super) fn accelerometer(
    topics: &BTreeMap<String, ImuTopic>,
    tf: &TfBuffer,
    optical: &str,
) -> (Option<Accelerometer>, Option<Note>) {
    let mut refused = None;
    let mut best: Option<(&String, Accelerometer)> = None;
    for (name, topic) in topics.iter().filter(|(_, t)| !t.readings.is_empty()) {
        // Stamp 0 and no gap: only a static transform can answer.
        let optical_from_imu = match tf.lookup(optical, &topic.frame, 0, 0) {
            Ok(pose) => pose,
            Err(_) => {
                let text = format!(
                    "accelerations on {name} are not used: /tf_static does not say how their frame `{}` \
                     stands to `{optical}`; record /tf_static",
                    topic.frame
                );
                refused.get_or_insert(Note::new(NoteCode::ImuUnusable, text));
                continue;
            }
        };
        if best.as_ref().is_some_and(|(_, b)| b.readings.len() >= topic.readings.len()) {
            continue;
        }
        let turned = topic.readings.iter().map(|(t, a)| (*t, optical_from_imu.rotation * a));
        let mut readings: Vec<(i64, Vector3<f64>)> = turned.collect();
        readings.sort_by_key(|r| r.0);
        readings.dedup_by_key(|r| r.0);
        best = Some((name, Accelerometer { readings, place_m: optical_from_imu.translation.vector }));
    }
    match best {
        None => (None, refused),
        Some((name, found)) => {
            let seconds = match (found.readings.first(), found.readings.last()) {
                (Some(first), Some(last)) => (last.0 - first.0) as f64 * 1e-9,
                _ => 0.0,
            };
            let text = format!(
                "which way is up comes from the accelerations on {name} ({} in {seconds:.1} s), and from \
                 what the object stands on",
                found.readings.len()
            );
            (Some(found), Some(Note::new(NoteCode::GravityMeasured, text)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2msg::{Header, Time};
    use geometry::Pose;

    fn found(with_frame: bool) -> (Option<Accelerometer>, Option<Note>) {
        let (mut tf, mut topics) = (TfBuffer::default(), BTreeMap::<String, ImuTopic>::new());
        tf.add_static("link", "optical", Pose::new(Vector3::zeros(), Vector3::z() * 0.5));
        if with_frame {
            tf.add_static("link", "imu", Pose::translation(0.1, 0.0, 0.0));
        }
        for (name, count) in [("/accel", 3), ("/few", 1), ("/gyro", 0)] {
            let topic = topics.entry(name.into()).or_default();
            for k in 0..4 {
                let mut message = Imu {
                    header: Header { stamp: Time::from_nanos(10 - k), frame_id: "imu".into() },
                    ..Imu::default()
                };
                if k < count {
                    message.linear_acceleration = [0.0, 9.8, 0.0].into();
                }
                assert_eq!(topic.add(10 - k, "imu".into(), &message), k < count);
            }
        }
        accelerometer(&topics, &tf, "optical")
    }

    #[test]
    fn readings_are_turned_into_the_cameras_axes_in_the_order_of_time() {
        let (found, note) = found(true);
        let found = found.unwrap();
        assert_eq!(found.readings.iter().map(|r| r.0).collect::<Vec<_>>(), [8, 9, 10]);
        let expected = Vector3::new(9.8 * 0.5f64.sin(), 9.8 * 0.5f64.cos(), 0.0);
        assert!((found.readings[0].1 - expected).norm() < 1e-9, "{found:?}");
        assert!((found.place_m - Vector3::new(0.1 * 0.5f64.cos(), -0.1 * 0.5f64.sin(), 0.0)).norm() < 1e-9);
        let note = note.unwrap();
        assert!(note.code == NoteCode::GravityMeasured && note.text.contains("/accel"), "{note}");
    }

    #[test]
    fn a_frame_that_nothing_ties_to_the_camera_is_refused_with_a_note() {
        let (found, note) = found(false);
        let note = note.unwrap();
        assert!(found.is_none() && note.code == NoteCode::ImuUnusable, "{note}");
        assert!(note.text.contains("/tf_static") && note.text.contains("`imu`"), "{note}");
        assert_eq!(accelerometer(&BTreeMap::new(), &TfBuffer::default(), "optical").1, None);
    }

    #[test]
    fn what_is_no_acceleration_is_left_out() {
        let message = |x: f64, covariance: f64| {
            let mut message = Imu { linear_acceleration: [x, 0.0, 0.0].into(), ..Imu::default() };
            message.linear_acceleration_covariance[0] = covariance;
            message.acceleration()
        };
        assert_eq!(message(9.8, 0.01), Some(Vector3::new(9.8, 0.0, 0.0)));
        for (x, covariance) in [(9.8, -1.0), (0.0, 0.0), (f64::NAN, 0.0), (1e3, 0.0)] {
            assert_eq!(message(x, covariance), None, "{x} {covariance}");
        }
    }
}
