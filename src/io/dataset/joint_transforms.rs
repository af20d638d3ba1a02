//! `trans.json`, the form in which published articulated-object datasets say how their joints move between
//! the start and the end state. Written and read here.

use serde::{Deserialize, Serialize};

/// Contents of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointTransforms {
    /// The object's source.
    #[serde(default)]
    pub input: serde_json::Value,
    trans_info: OneOrMany,
}

/// Objects of two parts may have a single joint instead of a list.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum OneOrMany {
    One(Box<JointTransform>),
    Many(Vec<JointTransform>),
}

/// A joint on the static part.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointTransform {
    /// Its line.
    pub axis: TransformAxis,
    /// `rotate` or `translate`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Angles, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotate: Option<Ends>,
    /// Lengths, meters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translate: Option<Ends>,
}

/// A line in the world of the cameras.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct TransformAxis {
    /// A point on it, meters.
    pub o: [f64; 3],
    /// Direction.
    pub d: [f64; 3],
}

/// Positions in the start and the end state.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Ends {
    /// In the form of most files.
    Named {
        /// In the start state.
        l: f64,
        /// In the end state.
        r: f64,
    },
    /// In the form of some files: start and end.
    Pair([f64; 2]),
}

impl Ends {
    /// Motion from the start to the end state.
    #[must_use]
    pub fn motion(self) -> f64 {
        match self {
            Self::Named { l, r } | Self::Pair([l, r]) => r - l,
        }
    }
}

impl JointTransforms {
    /// The file's contents for some joints.
    #[must_use]
    pub fn of(input: String, joints: Vec<JointTransform>) -> Self {
        Self { input: input.into(), trans_info: OneOrMany::Many(joints) }
    }

    /// The joints, in the order of the moving parts.
    #[must_use]
    pub fn joints(self) -> Vec<JointTransform> {
        match self.trans_info {
            OneOrMany::One(one) => vec![*one],
            OneOrMany::Many(many) => many,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_joint_a_list_and_both_forms_of_ends_are_read() {
        let one = r#"{"input": 7, "trans_info": {"axis": {"o": [0, 0, 1], "d": [1, 0, 0]},
            "type": "rotate", "rotate": {"l": 10, "r": 40.5}}}"#;
        let many = r#"{"trans_info": [{"axis": {"o": [0, 0, 1], "d": [1, 0, 0]}, "type": "translate",
            "rotate": null, "translate": [0.1, 0.35]}]}"#;
        let read = |text: &str| serde_json::from_str::<JointTransforms>(text).unwrap().joints();
        let one = read(one);
        let many = read(many);
        assert!((one[0].rotate.unwrap().motion() - 30.5).abs() < 1e-12);
        assert!(many[0].rotate.is_none() && (many[0].translate.unwrap().motion() - 0.25).abs() < 1e-12);
        let text = serde_json::to_string(&JointTransforms::of("made".into(), many)).unwrap();
        assert_eq!(read(&text).len(), 1);
    }
}
