//! How a topic is offered.

/// How a publisher offers a topic, as bags hold it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfferedQos {
    /// Reliable, else best effort.
    pub reliable: bool,
    /// Transient local, else volatile.
    pub latched: bool,
    /// Samples kept.
    pub depth: u32,
}
