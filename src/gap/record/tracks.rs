//! Recorded poses and wrenches of links, and their effect on the twin's joints.

use nalgebra::Vector3;

use crate::{
    record::{drive::Hold, log::GAP_INTERVALS},
    twin_tree::TwinTree,
};
use geometry::Pose;
use numeric::statistics::median;

/// Poses of a link.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseTrack {
    /// Topic.
    pub topic: String,
    /// Frame in which the poses are given.
    pub frame: String,
    /// Link.
    pub link: String,
    /// Whether it was requested; then it takes precedence over positions in joint states.
    pub asked: bool,
    /// Stamps, seconds from the first of the recording.
    pub time_s: Vec<f64>,
    /// `frame_from_link` at each stamp.
    pub pose: Vec<Pose>,
}

/// Wrenches on a link.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WrenchTrack {
    /// Topic.
    pub topic: String,
    /// Frame in which the wrenches are given.
    pub frame: String,
    /// Link they act on.
    pub link: String,
    /// Stamps, seconds from the first of the recording.
    pub time_s: Vec<f64>,
    /// Forces, N.
    pub force: Vec<Vector3<f64>>,
    /// Moments, N m.
    pub moment: Vec<Vector3<f64>>,
}

/// Topics in addition to the joint states, each with its link or joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Streams {
    /// Wrench topics with their links.
    pub wrenches: Vec<(String, String)>,
    /// Pose topics with their links.
    pub poses: Vec<(String, String)>,
    /// Command topics, each with its joints in order if the messages do not name them.
    pub commands: Vec<(String, Vec<String>)>,
    /// Links with transforms (child frames) to be read as poses.
    pub links: Vec<String>,
    /// Joints of the twin that were recorded under another name: the twin's name and the recorded one.
    pub joints: Vec<(String, String)>,
}

/// Why a track cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// The frame is not in the twin.
    #[error(
        "topic '{topic}' is given in frame '{frame}', which is neither a link of the twin nor 'world'; its \
         links are {links}: name the frame in header.frame_id as the twin does"
    )]
    NoFrame {
        /// Topic.
        topic: String,
        /// Frame.
        frame: String,
        /// Names of the twin's links.
        links: String,
    },
    /// The link is not in the twin.
    #[error(
        "topic '{topic}' is said to be about link '{link}', which the twin does not have; its links are \
         {links}"
    )]
    NoLink {
        /// Topic.
        topic: String,
        /// Link.
        link: String,
        /// Names of the twin's links.
        links: String,
    },
    /// No moving joint lies between the root and the link.
    #[error(
        "topic '{topic}': link '{link}' does not move with any joint of the twin; name a link behind a joint"
    )]
    Still {
        /// Topic.
        topic: String,
        /// Link.
        link: String,
    },
}

/// Name of the twin's root, unless a link has this name.
pub const WORLD: &str = "world";

/// Index of a frame's link; `None` for the world.
///
/// # Errors
/// [`TrackError::NoFrame`].
pub fn frame_link(tree: &TwinTree, topic: &str, frame: &str) -> Result<Option<usize>, TrackError> {
    let link = tree.links.iter().position(|l| l.name == frame);
    match link {
        None if frame != WORLD => {
            Err(TrackError::NoFrame { topic: topic.to_owned(), frame: frame.to_owned(), links: names(tree) })
        }
        link => Ok(link),
    }
}

/// Index of a link moved by a joint.
///
/// # Errors
/// [`TrackError::NoLink`], [`TrackError::Still`].
pub fn moved_link(tree: &TwinTree, topic: &str, link: &str) -> Result<usize, TrackError> {
    let (topic, name) = (|| topic.to_owned(), || link.to_owned());
    let index = tree.links.iter().position(|l| l.name == link);
    let index =
        index.ok_or_else(|| TrackError::NoLink { topic: topic(), link: name(), links: names(tree) })?;
    if tree.carrying_link(index) == tree.carrying_link(tree.root) {
        Err(TrackError::Still { topic: topic(), link: name() })
    } else {
        Ok(index)
    }
}

fn names(tree: &TwinTree) -> String {
    tree.links.iter().map(|l| format!("'{}'", l.name)).collect::<Vec<_>>().join(", ")
}

/// A signal resampled to other stamps, NaN where it has no value: under [`Hold::Zero`] its mean until the
/// next stamp, each value holding until the next one; under [`Hold::Sampled`] its value at the stamp.
#[must_use]
pub fn resampled(time_s: &[f64], values: &[f64], stamps: &[f64], hold: Hold) -> Vec<f64> {
    let usual = median(time_s.windows(2).map(|w| w[1] - w[0]).collect());
    // A value held across a gap would be an effort never recorded.
    let widest = GAP_INTERVALS * usual.unwrap_or(0.0);
    let mut first = 0;
    let mut all = Vec::with_capacity(stamps.len());
    for (k, t) in stamps.iter().enumerate() {
        while first + 1 < time_s.len() && time_s[first + 1] <= t + 1e-9 {
            first += 1;
        }
        let ends = time_s.get(first + 1).copied();
        if time_s.get(first).is_none_or(|s| *s > t + 1e-9 || t - s > widest)
            || ends.is_some_and(|e| e - time_s[first] > widest)
        {
            all.push(f64::NAN);
            continue;
        }
        all.push(match (hold, ends) {
            (Hold::Sampled, Some(end)) => {
                let share = (t - time_s[first]) / (end - time_s[first]);
                values[first] * (1.0 - share) + values[first + 1] * share
            }
            (Hold::Sampled, None) => values[first],
            (Hold::Zero, _) => held_mean(time_s, values, first, *t, stamps.get(k + 1).copied().unwrap_or(*t)),
        });
    }
    all
}

/// Mean of a held signal from `from` to `to`; sample `first` is the last one at or before `from`.
fn held_mean(time_s: &[f64], values: &[f64], first: usize, from: f64, to: f64) -> f64 {
    let mut sum = 0.0;
    let mut at = from;
    let mut k = first;
    while let Some(next) = time_s.get(k + 1).copied().filter(|next| *next < to - 1e-9) {
        sum += values[k] * (next - at).max(0.0);
        (at, k) = (next.max(at), k + 1);
    }
    if to - from > 1e-9 { (sum + values[k] * (to - at)) / (to - from) } else { values[first] }
}

/// Effort of a wrench at every joint, N m or N, for each stamp, with joints at `position(joint, time)`.
/// `None` at joints not carrying the link. A wrench in the frame of a link acts at the origin of this frame;
/// one in the frame of the root or the world acts at the origin of its link.
///
/// # Errors
/// [`TrackError`] for links and frames missing in the twin.
pub fn joint_efforts(
    tree: &TwinTree,
    track: &WrenchTrack,
    position: &dyn Fn(usize, f64) -> f64,
) -> Result<Vec<Option<Vec<f64>>>, TrackError> {
    let link = moved_link(tree, &track.topic, &track.link)?;
    let frame = frame_link(tree, &track.topic, &track.frame)?.unwrap_or(tree.root);
    let at = if frame == tree.root { link } else { frame };
    let carries: Vec<bool> = (0..tree.joints.len()).map(|j| tree.carries(j, link)).collect();
    let mut efforts: Vec<Option<Vec<f64>>> =
        carries.iter().map(|c| c.then(|| Vec::with_capacity(track.time_s.len()))).collect();
    for (k, t) in track.time_s.iter().enumerate() {
        let q: Vec<f64> = (0..tree.joints.len()).map(|j| position(j, *t)).collect();
        let poses = tree.link_poses(&q);
        let force = poses[frame].rotation * track.force[k];
        let moment = poses[frame].rotation * track.moment[k];
        for (j, own) in efforts.iter_mut().enumerate() {
            if let Some(own) = own {
                // The moment about the joint's own origin acts on it.
                let lever = poses[at].translation.vector - poses[tree.joints[j].child].translation.vector;
                own.push(tree.effort_of(j, &poses, &force, &(moment + lever.cross(&force))));
            }
        }
    }
    Ok(efforts)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::twin_tree::{Motion, TwinJoint, TwinLink};

    /// A door with a handle 0.8 m from its hinge, and a drawer that slides along y.
    fn tree() -> TwinTree {
        let link = |name: &&str| TwinLink {
            name: (*name).into(),
            mass_kg: 0.0,
            center_of_mass: Point3::origin(),
            inertia: Matrix3::zeros(),
            inertia_excess: 0.0,
        };
        let joint = |name: &str, motion, parent, child, at: f64, axis: Vector3<f64>| TwinJoint {
            name: name.into(),
            motion,
            parent,
            child,
            parent_from_joint: Pose::translation(at, 0.0, 0.0),
            axis: nalgebra::Unit::new_normalize(axis),
            damping: 0.0,
            friction: 0.0,
            limit: None,
            mimic: None,
            is_free: false,
        };
        let joints = vec![
            joint("hinge", Motion::Turn, 0, 1, 1.0, Vector3::z()),
            joint("grip", Motion::Fixed, 1, 2, 0.8, Vector3::x()),
            joint("rail", Motion::Slide, 0, 3, 0.0, Vector3::y()),
        ];
        let links = ["base", "door", "handle", "drawer"].iter().map(link).collect();
        TwinTree { name: "r".into(), links, joints, root: 0, gravity: Vector3::new(0.0, 0.0, -9.81) }
    }

    #[test]
    fn a_held_signal_has_its_mean_and_a_straight_one_its_value() {
        let time_s = [0.0, 0.1, 0.2, 0.3];
        let values = [1.0, 3.0, 5.0, 7.0];
        let near = |a: &[f64], b: &[f64]| {
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 || (a.is_nan() && b.is_nan()))
        };
        let held = resampled(&time_s, &values, &[-0.1, 0.0, 0.1, 0.15, 0.25], Hold::Zero);
        assert!(near(&held, &[f64::NAN, 1.0, 3.0, 4.0, 5.0]), "{held:?}");
        let straight = resampled(&time_s, &values, &[0.0, 0.05, 0.3, 0.9], Hold::Sampled);
        assert!(near(&straight, &[1.0, 2.0, 7.0, f64::NAN]), "{straight:?}");
        let with_gap = resampled(&[0.0, 0.1, 0.2, 0.3, 2.0, 2.1], &[1.0; 6], &[0.2, 1.0, 2.05], Hold::Zero);
        assert!(near(&with_gap, &[1.0, f64::NAN, 1.0]), "{with_gap:?}");
    }

    #[test]
    fn a_pull_at_a_handle_turns_the_door_and_slides_nothing_across() {
        let tree = tree();
        let index = |name: &str| tree.joints.iter().position(|j| j.name == name).unwrap();
        let track = |link: &str, frame: &str| WrenchTrack {
            link: link.into(),
            frame: frame.into(),
            time_s: vec![0.0],
            force: vec![Vector3::new(2.0, 5.0, 1.0)],
            moment: vec![Vector3::new(0.1, 0.2, 0.3)],
            ..WrenchTrack::default()
        };
        let quarter = |_: usize, _: f64| std::f64::consts::FRAC_PI_2;
        // In the handle's own axes only y has a lever; in the world's, at a quarter turn, only x.
        for (frame, effort) in [
            ("handle", 0.8 * 5.0 + 0.3),
            ("world", -0.8 * 2.0 + 0.3),
            ("base", -0.8 * 2.0 + 0.3),
            ("door", 0.3),
        ] {
            let efforts = joint_efforts(&tree, &track("handle", frame), &quarter).unwrap();
            assert!(
                (efforts[index("hinge")].as_ref().unwrap()[0] - effort).abs() < 1e-12,
                "{frame}: {efforts:?}"
            );
            assert_eq!(efforts[index("rail")], None);
        }
        let efforts = joint_efforts(&tree, &track("drawer", "world"), &quarter).unwrap();
        assert!((efforts[index("rail")].as_ref().unwrap()[0] - 5.0).abs() < 1e-12);
        assert!(matches!(
            joint_efforts(&tree, &track("handle", "sensor"), &quarter),
            Err(TrackError::NoFrame { .. })
        ));
        assert!(matches!(
            joint_efforts(&tree, &track("lid", "world"), &quarter),
            Err(TrackError::NoLink { .. })
        ));
        assert!(matches!(
            joint_efforts(&tree, &track("base", "world"), &quarter),
            Err(TrackError::Still { .. })
        ));
    }
}
