//! Costs of places that a motion takes a sample to, which labels know, too. See docs/method.md (6.5).

/// Cost of a place that was not seen: weaker than any agreement, hardly evidence against.
/// tuned: shared/bags
pub(crate) const HIDDEN: f32 = 0.9;
/// Cost of a place seen to be empty all around, as far as errors of depth and motion take it.
/// chosen: above that of a place seen to be empty by what decides no label, so that it can be recognized
pub(crate) const ALL_FREE: f32 = 1.61;
