//! Columns of a score test over one window.

/// Columns over one window, scored together.
pub struct Columns {
    /// Efforts, by column and sample.
    pub effort: Vec<Vec<f64>>,
    /// Direct changes of the measurement, by column and sample; empty if there are none.
    pub direct: Vec<Vec<f64>>,
    /// Whether a column holds any nonzero value.
    pub active: Vec<bool>,
}

impl Columns {
    /// `count` empty columns.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { effort: vec![Vec::new(); count], direct: Vec::new(), active: vec![false; count] }
    }

    /// Sets all columns to zero over a window of `len` samples.
    pub fn clear(&mut self, len: usize) {
        for (effort, active) in self.effort.iter_mut().zip(&mut self.active) {
            // Only written columns are cleared: most local shapes act in few windows.
            if *active || effort.len() != len {
                effort.clear();
                effort.resize(len, 0.0);
            }
            *active = false;
        }
    }
}
