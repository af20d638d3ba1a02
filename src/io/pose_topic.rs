//! Poses on topics of their own, of all types that hold one.

use std::collections::BTreeMap;

use super::{
    bag_index::MessageError,
    lags::Lags,
    ros2msg::{Header, Odometry, PoseStamped, Transform, TransformStamped, decode},
};
use geometry::Pose;
use serde::Deserialize;

/// Types of messages that hold poses.
pub const POSE_TYPES: [&str; 5] = [
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Path",
];

/// `nav_msgs/msg/Path`.
#[derive(Deserialize)]
struct PathMessage {
    header: Header,
    poses: Vec<PoseStamped>,
}

/// The poses of a topic.
#[derive(Clone, Debug, Default)]
pub struct PoseTopic {
    /// Frame of the poses.
    pub parent: String,
    /// The frame whose pose is given, if the message names it.
    pub child: Option<String>,
    /// Poses by header stamp, nanoseconds; by the time of recording where there is no stamp.
    pub samples: BTreeMap<i64, Pose>,
    /// Number of dropped messages: NaN, no unit quaternion, other frames.
    pub invalid: usize,
    /// How long after their stamps the messages were recorded.
    pub lags: Lags,
}

impl PoseTopic {
    /// Takes a message of one of [`POSE_TYPES`]; returns the number of new poses.
    ///
    /// # Errors
    /// [`MessageError`].
    pub fn add(&mut self, type_name: &str, data: &[u8], log_nanos: i64) -> Result<usize, MessageError> {
        let before = self.samples.len();
        match type_name {
            "nav_msgs/msg/Odometry" => {
                let m: Odometry = decode(data)?;
                self.add_pose(&m.header, Some(&m.child_frame_id), &m.pose, log_nanos)?;
            }
            "geometry_msgs/msg/TransformStamped" => {
                let m: TransformStamped = decode(data)?;
                self.add_pose(&m.header, Some(&m.child_frame_id), &m.transform, log_nanos)?;
            }
            "nav_msgs/msg/Path" => {
                let m: PathMessage = decode(data)?;
                self.add_path(&m, log_nanos)?;
            }
            // The covariance behind a pose is not read.
            _ => {
                let m: PoseStamped = decode(data)?;
                self.add_pose(&m.header, None, &m.pose, log_nanos)?;
            }
        }
        Ok(self.samples.len() - before)
    }

    /// Takes the whole path so far; poses that it gives anew replace the earlier ones.
    fn add_path(&mut self, path: &PathMessage, log_nanos: i64) -> Result<(), MessageError> {
        for pose in &path.poses {
            let mut header = pose.header.clone();
            // Publishers often leave the headers of a path's poses empty: the last one is then the newest.
            if header.frame_id.is_empty() {
                header.frame_id.clone_from(&path.header.frame_id);
            }
            if header.stamp.nanos() != Some(0) {
                self.add_pose(&header, None, &pose.pose, log_nanos)?;
            }
        }
        match path.poses.last().filter(|last| last.header.stamp.nanos() == Some(0)) {
            Some(last) => self.add_pose(&path.header, None, &last.pose, log_nanos),
            None => Ok(()),
        }
    }

    fn add_pose(
        &mut self,
        header: &Header,
        child: Option<&str>,
        pose: &Transform,
        log_nanos: i64,
    ) -> Result<(), MessageError> {
        let (stamp, parent) = header.checked().ok_or(MessageError::Header)?;
        let child = child.map(|c| c.trim_start_matches('/').to_owned());
        // The first message names the frames, also where its pose is invalid.
        if self.samples.is_empty() && self.invalid == 0 {
            self.parent.clone_from(&parent);
            self.child.clone_from(&child);
        }
        match pose.checked() {
            Some(pose) if self.parent == parent && self.child == child => {
                self.lags.add(stamp, log_nanos);
                self.samples.insert(if stamp == 0 { log_nanos } else { stamp }, pose);
            }
            _ => self.invalid += 1,
        }
        Ok(())
    }

    /// Whether the poses differ by more than the jitter of a thing at rest.
    #[must_use]
    pub fn moves(&self) -> bool {
        let Some(first) = self.samples.values().next() else { return false };
        self.samples.values().any(|pose| {
            (pose.translation.vector - first.translation.vector).norm() > MOVED_M
                || pose.rotation.angle_to(&first.rotation) > MOVED_RAD
        })
    }
}

/// Poses that stay within this distance and angle are those of a thing at rest, meters and radians.
/// chosen: beyond the jitter of any localization, and within that of a hand
const MOVED_M: f64 = 0.01;
const MOVED_RAD: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2msg::{Time, Vector3, encode};
    use serde::Serialize;

    #[derive(Serialize)]
    struct Sent {
        header: Header,
        poses: Vec<PoseStamped>,
    }

    fn header(sec: i32) -> Header {
        Header { stamp: Time { sec, nanosec: 0 }, frame_id: "/map".into() }
    }

    fn pose(x: f64) -> Transform {
        Transform { translation: Vector3 { x, y: 0.0, z: 0.0 }, ..Transform::default() }
    }

    #[test]
    fn poses_of_all_types_are_read() {
        let stamped = |sec, x| PoseStamped { header: header(sec), pose: pose(x) };
        let with_covariance = encode(&(stamped(3, 1.0), [[0.0f64; 6]; 6])).unwrap();
        let named =
            TransformStamped { header: header(3), child_frame_id: "/cam".into(), transform: pose(1.0) };
        let path = Sent { header: header(3), poses: vec![stamped(2, 0.5), stamped(3, 1.0)] };
        for (name, data, child) in [
            (POSE_TYPES[0], encode(&stamped(3, 1.0)).unwrap(), None),
            (POSE_TYPES[2], with_covariance, None),
            (POSE_TYPES[3], encode(&named).unwrap(), Some("cam")),
            (POSE_TYPES[4], encode(&path).unwrap(), None),
        ] {
            let mut topic = PoseTopic::default();
            topic.add(name, &data, 5).unwrap();
            assert_eq!((topic.parent.as_str(), topic.child.as_deref()), ("map", child), "{name}");
            assert_eq!(topic.samples[&3_000_000_000].translation.x, 1.0, "{name}");
        }
    }

    #[test]
    fn poses_without_stamps_have_the_time_of_their_recording() {
        let mut topic = PoseTopic::default();
        let unstamped = |x| PoseStamped { header: header(0), pose: pose(x) };
        topic.add(POSE_TYPES[0], &encode(&unstamped(1.0)).unwrap(), 7).unwrap();
        assert!(!topic.moves());
        let path = Sent { header: header(0), poses: vec![unstamped(1.0), unstamped(2.0)] };
        topic.add(POSE_TYPES[4], &encode(&path).unwrap(), 9).unwrap();
        assert_eq!(topic.samples.keys().copied().collect::<Vec<_>>(), [7, 9]);
        assert!(topic.moves());
    }
}
