//! Which work of the stages a GPU takes.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use super::{device::Gpu, error::GpuError};

/// Work that a GPU can take from the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Fusion of a state's depth.
    Fusion,
    /// Image features: found and compared.
    Features,
    /// The nearest triangles of a distance field.
    Distances,
    /// Where samples of the surface go under a motion, from which their labels follow.
    Labels,
}

impl Work {
    /// All of it.
    pub const ALL: [Self; 4] = [Self::Fusion, Self::Features, Self::Distances, Self::Labels];

    /// Its name, as a report has it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fusion => "fusion",
            Self::Features => "features",
            Self::Distances => "distances",
            Self::Labels => "labels",
        }
    }
}

/// A GPU, and the work that it does. A copy shares what is known of failures.
#[derive(Clone, Debug, Default)]
pub struct Offload(Option<Arc<Offloaded>>);

#[derive(Debug)]
struct Offloaded {
    gpu: Gpu,
    takes: [AtomicBool; Work::ALL.len()],
    failures: Mutex<Vec<GpuError>>,
}

impl Offload {
    /// The processor does everything.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// A GPU does the work for which `takes` holds.
    #[must_use]
    pub fn on(gpu: Gpu, takes: impl Fn(Work) -> bool) -> Self {
        let takes = Work::ALL.map(|work| AtomicBool::new(takes(work)));
        Self(Some(Arc::new(Offloaded { gpu, takes, failures: Mutex::default() })))
    }

    /// The work that the GPU does and has not failed at, and its adapter, as a report has it; `None` where
    /// that is none.
    #[must_use]
    pub fn describe(&self) -> Option<String> {
        let offloaded = self.0.as_ref()?;
        let takes = |work: &Work| offloaded.takes[*work as usize].load(Ordering::Relaxed);
        let names: Vec<&str> = Work::ALL.into_iter().filter(takes).map(Work::name).collect();
        let adapter = &offloaded.gpu.adapter().description;
        (!names.is_empty()).then(|| format!("{} on {adapter}", names.join(", ")))
    }

    /// What work gives on the GPU; `None` where it is the processor's, or becomes it because the GPU fails.
    pub fn attempt<T>(&self, work: Work, run: impl FnOnce(&Gpu) -> Result<T, GpuError>) -> Option<T> {
        let offloaded = self.0.as_ref()?;
        let takes = &offloaded.takes[work as usize];
        if !takes.load(Ordering::Relaxed) {
            return None;
        }
        let failed = |error| {
            takes.store(false, Ordering::Relaxed);
            offloaded.failures.lock().unwrap_or_else(PoisonError::into_inner).push(error);
        };
        run(&offloaded.gpu).map_err(failed).ok()
    }

    /// Why the processor took over, where it did.
    #[must_use]
    pub fn failures(&self) -> Vec<GpuError> {
        let offloaded = self.0.as_ref();
        offloaded.map_or_else(Vec::new, |p| p.failures.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }
}
