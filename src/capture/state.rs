//! Assignment of messages to states, where one recording holds several.

use super::CaptureError;

/// Larger times count from the epoch, smaller ones from the start of the recording, seconds.
/// chosen: about 1973; recordings are shorter, and clocks later
const ABSOLUTE_FROM_SECS: f64 = 1e8;

/// End of state 0 and beginning of state 1, nanoseconds of recording time; in between the object is being
/// moved, and messages belong to neither state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Split {
    /// State 0 is recorded before this.
    pub end0_nanos: i64,
    /// State 1 is recorded from this on.
    pub begin1_nanos: i64,
}

impl Split {
    /// From one or two times, seconds since the epoch or from the start of the recording.
    ///
    /// # Errors
    /// [`CaptureError::Split`] where a time lies outside the recording.
    pub fn at_times(times_secs: &[f64], first_nanos: i64, last_nanos: i64) -> Result<Self, CaptureError> {
        let (Some(first), Some(last)) = (times_secs.first(), times_secs.last()) else {
            return Err(CaptureError::Split { reason: "no time was given".into() });
        };
        let [end0_nanos, begin1_nanos] = [first, last].map(|secs| nanos_since_epoch(*secs, first_nanos));
        let split = Self { end0_nanos, begin1_nanos };
        if split.end0_nanos <= first_nanos || split.begin1_nanos > last_nanos {
            let length = (last_nanos - first_nanos) as f64 * 1e-9;
            return Err(CaptureError::Split {
                reason: format!("the time {times_secs:?} s lies outside the recording of {length:.3} s"),
            });
        }
        Ok(split)
    }

    /// From the times of marker messages: state 0 ends at the first, state 1 begins at the last.
    ///
    /// # Errors
    /// [`CaptureError::Split`] without markers.
    pub fn at_markers(topic: &str, marker_nanos: &[i64]) -> Result<Self, CaptureError> {
        match (marker_nanos.iter().min(), marker_nanos.iter().max()) {
            (Some(first), Some(last)) => Ok(Self { end0_nanos: *first, begin1_nanos: *last }),
            _ => Err(CaptureError::Split { reason: format!("the marker topic `{topic}` has no message") }),
        }
    }

    /// Whether a time lies between the states, further than `margin_nanos` from both.
    #[must_use]
    pub fn is_between(&self, nanos: i64, margin_nanos: i64) -> bool {
        let after = self.end0_nanos.saturating_add(margin_nanos);
        let before = self.begin1_nanos.saturating_sub(margin_nanos);
        nanos >= after && nanos < before
    }

    /// State of a message by its recording time; `None` between the states.
    #[must_use]
    pub fn state_at(&self, nanos: i64) -> Option<usize> {
        if nanos < self.end0_nanos {
            Some(0)
        } else if nanos >= self.begin1_nanos {
            Some(1)
        } else {
            // Between the states the joints were being moved.
            None
        }
    }
}

/// Nanoseconds since the epoch, of a time in seconds since the epoch or from the start of the recording.
fn nanos_since_epoch(secs: f64, first_nanos: i64) -> i64 {
    let nanos = (secs * 1e9).round() as i64;
    if nanos as f64 > ABSOLUTE_FROM_SECS * 1e9 { nanos } else { first_nanos + nanos }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn a_time_from_the_start_or_since_the_epoch() {
        let begin = 1_760_000_000 * S;
        let split = Split::at_times(&[5.0], begin, begin + 10 * S).unwrap();
        assert_eq!(split, Split::at_times(&[1_760_000_005.0], begin, begin + 10 * S).unwrap());
        assert_eq!(
            [begin, begin + 5 * S - 1, begin + 5 * S].map(|t| split.state_at(t)),
            [Some(0), Some(0), Some(1)]
        );
        assert!(
            Split::at_times(&[11.0], begin, begin + 10 * S).unwrap_err().to_string().contains("10.000 s")
        );
        assert!(Split::at_times(&[], begin, begin + 10 * S).is_err());
    }

    #[test]
    fn what_lies_between_belongs_to_neither() {
        let split = Split::at_times(&[2.0, 4.0], 0, 10 * S).unwrap();
        assert_eq!([S, 3 * S, 4 * S].map(|t| split.state_at(t)), [Some(0), None, Some(1)]);
        assert_eq!(split, Split::at_markers("/m", &[4 * S, 2 * S, 3 * S]).unwrap());
        assert!(Split::at_markers("/m", &[]).is_err());
    }
}
