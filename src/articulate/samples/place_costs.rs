//! Costs of the end points of moved samples, for registration and labels. See docs/method.md (6.5).

/// Cost of an unseen place: weaker than any agreement, hardly evidence against.
/// tuned: shared/bags
pub(crate) const HIDDEN: f32 = 0.9;
/// Cost of a place seen to be empty all around, as far as errors of depth and motion take it.
/// chosen: above the cost of a place seen to be empty, to be recognized, by too little to decide a label
pub(crate) const ALL_FREE: f32 = 1.61;
