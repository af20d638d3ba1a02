//! Time of the node: system time, or simulated time from `/clock`.

use std::{
    sync::atomic::{AtomicI64, Ordering},
    time::{SystemTime, UNIX_EPOCH},
};

use ros2_client::builtin_interfaces;

use io::ros2msg::Time;

/// Least backward step of simulated time that counts as a jump, nanoseconds.
const JUMP_NANOS: i64 = 100_000_000;
/// No simulated time was received yet.
const UNKNOWN: i64 = i64::MIN;

/// Time of the node.
#[derive(Debug)]
pub(crate) struct NodeClock {
    simulated: Option<AtomicI64>,
}

impl NodeClock {
    /// Uses system time, or `/clock` if `simulated`.
    #[must_use]
    pub(crate) fn new(simulated: bool) -> Self {
        Self { simulated: simulated.then(|| AtomicI64::new(UNKNOWN)) }
    }

    /// Nanoseconds since the epoch; 0 before the first simulated time, as in ROS.
    #[must_use]
    pub(crate) fn now_nanos(&self) -> i64 {
        match &self.simulated {
            Some(time) => match time.load(Ordering::Relaxed) {
                UNKNOWN => 0,
                nanos => nanos,
            },
            None => SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .map_or(0, |d| i64::try_from(d.as_nanos()).unwrap_or(0)),
        }
    }

    /// The current time as a stamp.
    #[must_use]
    pub(crate) fn stamp_now(&self) -> Time {
        Time::from_nanos(self.now_nanos())
    }

    /// The current time as a stamp of ros2-client's messages.
    #[must_use]
    pub(crate) fn message_stamp_now(&self) -> builtin_interfaces::Time {
        builtin_interfaces::Time::from_nanos(self.now_nanos())
    }

    /// Sets the simulated time; returns whether it jumped back.
    pub(crate) fn set_time(&self, time: Time) -> bool {
        let (Some(simulated), Some(nanos)) = (&self.simulated, time.nanos()) else { return false };
        let before = simulated.swap(nanos, Ordering::Relaxed);
        before != UNKNOWN && nanos < before.saturating_sub(JUMP_NANOS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_may_jump_back() {
        let clock = NodeClock::new(true);
        assert_eq!(clock.now_nanos(), 0);
        let set = |sec| clock.set_time(Time { sec, nanosec: 0 });
        assert_eq!([set(5), set(6), set(6), set(2), set(3)], [false, false, false, true, false]);
        assert_eq!(clock.stamp_now(), Time { sec: 3, nanosec: 0 });
        assert!(!clock.set_time(Time { sec: -1, nanosec: 0 }));
        assert!(!NodeClock::new(false).set_time(Time { sec: 5, nanosec: 0 }));
    }
}
