//! The QoS profile with which a topic is offered.

/// The QoS profile of a publisher, as bags record it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfferedQos {
    /// Whether it is reliable, not best effort.
    pub reliable: bool,
    /// Whether it is transient local, not volatile.
    pub latched: bool,
    /// Number of samples kept.
    pub depth: u32,
}
