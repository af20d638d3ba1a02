//! The competing families of motion of a part, and their scores.

use serde::{Deserialize, Serialize};

/// A family of motions that is fitted to a part's motions: a possible type of its joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointFamily {
    /// The part does not move relative to its parent.
    Fixed,
    /// Any rigid motion, a different one in every state.
    Free,
    /// Slides along an axis.
    Prismatic,
    /// Turns about an axis.
    Revolute,
    /// Turns about an axis and advances along it.
    Screw,
}

impl JointFamily {
    /// All families, in the order of their names.
    pub const ALL: [Self; 5] = [Self::Fixed, Self::Free, Self::Prismatic, Self::Revolute, Self::Screw];

    /// One word: `fixed`, `free`, `prismatic`, `revolute`, `screw`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Free => "free",
            Self::Prismatic => "prismatic",
            Self::Revolute => "revolute",
            Self::Screw => "screw",
        }
    }
}

/// Score of every fitted family: Bayesian information criterion, lower is better.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TypeScores([Option<f64>; JointFamily::ALL.len()]);

impl TypeScores {
    /// Score of a family; infinite where it was not fitted.
    pub fn score_of(&self, joint: JointFamily) -> f64 {
        self.0[joint as usize].unwrap_or(f64::INFINITY)
    }

    /// The fitted families with their scores.
    pub fn iter(&self) -> impl Iterator<Item = (JointFamily, f64)> {
        // `ALL` and the scores are in the order of the variants.
        JointFamily::ALL.into_iter().zip(self.0).filter_map(|(joint, score)| Some((joint, score?)))
    }
}

impl FromIterator<(JointFamily, f64)> for TypeScores {
    fn from_iter<I: IntoIterator<Item = (JointFamily, f64)>>(scores: I) -> Self {
        let mut all = Self::default();
        scores.into_iter().for_each(|(joint, score)| all.0[joint as usize] = Some(score));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_family_that_was_not_fitted_never_wins() {
        let scores: TypeScores =
            [(JointFamily::Revolute, 3.0), (JointFamily::Fixed, 9.0)].into_iter().collect();
        assert_eq!(scores.score_of(JointFamily::Revolute), 3.0);
        assert!(scores.score_of(JointFamily::Screw).is_infinite());
        let named: Vec<_> = scores.iter().map(|(joint, score)| (joint.name(), score)).collect();
        assert_eq!(named, [("fixed", 9.0), ("revolute", 3.0)]);
        assert!(JointFamily::ALL.iter().enumerate().all(|(k, joint)| *joint as usize == k));
    }
}
