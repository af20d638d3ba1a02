//! Resampling of logs to fewer samples.

use crate::record::{carried::Carried, drive::Hold, log::JointLog};

impl JointLog {
    /// Number of recorded samples per interval of this length, at least 1.
    #[must_use]
    pub fn samples_in(&self, interval_s: f64) -> usize {
        self.interval_s().map_or(1, |own| ((interval_s / own) as usize).max(1))
    }

    /// The log resampled to about `interval_s`, if recorded more densely: positions are picked, efforts and
    /// the other joints' effects are averaged over each interval, so the new efforts hold from sample to
    /// sample.
    #[must_use]
    pub fn with_interval(&self, interval_s: f64, hold: Hold) -> Self {
        let every = self.samples_in(interval_s);
        if every == 1 && hold == Hold::Zero {
            return self.clone();
        }
        let mut coarse =
            Self { run: self.run.clone(), others: vec![Vec::new(); self.others.len()], ..Self::default() };
        for segment in self.gapless_segments(0) {
            let end = segment.start + segment.len;
            for k in (segment.start..end).step_by(every) {
                // The last interval of a segment may be shorter; its last sample ends it.
                let to = (k + every).min(end);
                coarse.time_s.push(self.time_s[k]);
                coarse.position.push(self.position[k]);
                coarse.effort.push(mean_over(&self.time_s, &self.effort, hold, k, to));
                if !self.commanded.is_empty() {
                    coarse.commanded.push(mean_over(&self.time_s, &self.commanded, hold, k, to));
                }
                for (own, other) in coarse.others.iter_mut().zip(&self.others) {
                    own.push(other[k]);
                }
                if let Some(carried) = self.carried.get(k..to) {
                    coarse.carried.push(Carried::mean_of(carried));
                }
            }
        }
        coarse
    }
}

/// Time average of values from sample `from` to sample `to`.
fn mean_over(time_s: &[f64], values: &[f64], hold: Hold, from: usize, to: usize) -> f64 {
    let mut widths = Vec::with_capacity(to - from);
    let mut areas = Vec::with_capacity(to - from);
    for k in from..to {
        let width = time_s.get(k + 1).map_or(0.0, |next| next - time_s[k]);
        let value = match hold {
            Hold::Zero => values[k],
            Hold::Sampled => 0.5 * (values[k] + values.get(k + 1).unwrap_or(&values[k])),
        };
        widths.push(width);
        areas.push(width * value);
    }
    let total: f64 = widths.iter().sum();
    if total > 0.0 { areas.iter().sum::<f64>() / total } else { values[from] }
}
