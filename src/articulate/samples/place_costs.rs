//! Costs of the places to which samples are moved, for registration and labels. See docs/method.md (6.5).

/// Cost of an unseen place: worse than any agreement, but hardly evidence against it.
/// tuned: shared/bags
pub(crate) const HIDDEN: f32 = 0.9;
/// Cost of a place seen empty all around, within the errors of depth and motion.
/// chosen: above the cost of a place seen empty, so it can be recognized, by too little to decide a
/// label
pub(crate) const ALL_FREE: f32 = 1.61;
