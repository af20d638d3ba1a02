//! How long after their stamps messages were recorded: what relates two clocks where stamps are of both.

/// Most lags that are kept of a topic. chosen: enough for a median
const MOST: usize = 1000;

/// Times from the stamps of messages to their recording, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lags {
    lags: Vec<i64>,
    /// Number of messages without a stamp.
    pub unstamped: usize,
}

impl Lags {
    /// Takes the stamp of a message, 0 where it has none, and the time of its recording, nanoseconds.
    pub fn add(&mut self, stamp_nanos: i64, log_nanos: i64) {
        if stamp_nanos == 0 {
            self.unstamped += 1;
        } else if self.lags.len() < MOST {
            self.lags.push(log_nanos.saturating_sub(stamp_nanos));
        }
    }

    /// The median of the lags; `None` where no message has a stamp.
    #[must_use]
    pub fn median_nanos(&self) -> Option<i64> {
        let mut lags = self.lags.clone();
        lags.sort_unstable();
        lags.get(lags.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lag_is_that_of_the_stamped_messages() {
        let mut lags = Lags::default();
        assert_eq!(lags.median_nanos(), None);
        [(0, 5), (10, 15), (20, 26), (30, 90)].iter().for_each(|(stamp, log)| lags.add(*stamp, *log));
        assert_eq!((lags.median_nanos(), lags.unstamped), (Some(6), 1));
    }
}
