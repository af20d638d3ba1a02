//! The field engine on burn: any device, gradients by automatic differentiation.
//!
//! On a CPU it is slower than the CPU engine; it exists for GPUs, and to verify gradients.

use std::sync::{Mutex, OnceLock};

use burn::tensor::{Device, Tensor};

use super::burn_batch::batch_pieces;
use super::burn_device::{EngineError, guarded};
use super::burn_model::{FieldShape, piece_losses, upload_tensors};
use super::{
    ADAM_BETAS, ADAM_EPSILON, EngineState, FEATURES, FieldEngine, FieldLosses, FieldParams, GEOMETRY_OUTPUTS,
    SampleBatch,
};
use super::{Layer, VIEW_COEFFICIENTS};

/// Trains a field on a burn device.
///
/// A GPU sums table gradients with atomics, so repeated runs differ in the last bits; the CPU device is
/// exact. If the device fails in a method of [`FieldEngine`], all later losses are NaN and
/// [`FieldEngine::failure`] returns the error. [`FieldEngine::training_state`] then returns the last state
/// read, and another engine can continue from its `steps`.
pub struct BurnEngine {
    device: Device,
    shape: FieldShape,
    /// One tensor per level and two per layer, on the device without autodiff, like the moments.
    params: Vec<Tensor<1>>,
    first: Vec<Tensor<1>>,
    second: Vec<Tensor<1>>,
    steps: u64,
    failure: OnceLock<EngineError>,
    last_read: Mutex<EngineState>,
}

impl BurnEngine {
    /// Starts with zero moments on a device.
    ///
    /// # Errors
    /// [`EngineError::Shape`] if the parameters are inconsistent, [`EngineError::Failed`] if the device
    /// fails.
    pub fn new(params: FieldParams, device: Device) -> Result<Self, EngineError> {
        Self::resume(EngineState::untrained(params), device)
    }

    /// Continues from a checkpoint, of this engine or another, on a device.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn resume(state: EngineState, device: Device) -> Result<Self, EngineError> {
        check_shape(&state)?;
        guarded("received the parameters", || {
            let device = device.without_autodiff();
            let shape = FieldShape::of_params(&state.params);
            let params = upload_tensors(&shape, &state.params.flatten(), &device);
            let first = upload_tensors(&shape, &state.first, &device);
            let second = upload_tensors(&shape, &state.second, &device);
            let steps = state.steps;
            let engine = Self {
                device,
                shape,
                params,
                first,
                second,
                steps,
                failure: OnceLock::new(),
                last_read: Mutex::new(state),
            };
            // Devices work from a queue: without waiting, a failed upload would only show in a later step.
            engine.device.sync().map_err(|e| device_failure("received the parameters", e))?;
            Ok(engine)
        })
    }

    /// Continues from a checkpoint on burn's CPU device.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn flex(state: EngineState) -> Result<Self, EngineError> {
        Self::resume(state, Device::flex())
    }

    /// Continues from a checkpoint on the best GPU, once a trial gradient agrees with the CPU engine. The
    /// environment variable `CUBECL_WGPU_DEFAULT_DEVICE` (e.g. `DiscreteGpu(1)`, `Cpu`) selects another
    /// adapter.
    ///
    /// # Errors
    /// [`EngineError::NotBuilt`] without the `gpu` feature, [`EngineError::Unavailable`] without a usable
    /// adapter, and those of [`Self::new`].
    #[cfg(feature = "gpu")]
    pub fn wgpu(state: EngineState) -> Result<Self, EngineError> {
        let mut engine = Self::resume(state.clone(), super::burn_device::wgpu_device()?)?;
        engine.check(state).map(|()| engine)
    }

    /// Continues from a checkpoint on the best GPU: this binary has no GPU support.
    ///
    /// # Errors
    /// Always [`EngineError::NotBuilt`].
    #[cfg(not(feature = "gpu"))]
    pub fn wgpu(_state: EngineState) -> Result<Self, EngineError> {
        Err(EngineError::NotBuilt)
    }

    /// Compares a trial gradient with that of the CPU engine at the same state.
    ///
    /// # Errors
    /// [`EngineError::Failed`] if the device fails, [`EngineError::Unavailable`] if it gives other values.
    #[cfg(any(test, feature = "gpu"))]
    pub(super) fn check(&mut self, state: EngineState) -> Result<(), EngineError> {
        use super::burn_trial::{agree, trial_batch};
        let batch = trial_batch();
        let found = self.try_gradient(&batch)?;
        let expected = super::CpuEngine::resume(state).loss_gradient(&batch);
        agree(&found, &expected).map_err(|e| EngineError::Unavailable { message: e.to_string() })
    }

    /// As [`FieldEngine::train_step`].
    ///
    /// # Errors
    /// [`EngineError::Failed`]; the engine is unusable afterwards.
    pub fn try_step(&mut self, batch: &SampleBatch, learning_rate: f32) -> Result<FieldLosses, EngineError> {
        guarded("took a training step", || {
            let (losses, gradients) = self.losses_and_gradients(batch)?;
            self.steps += 1;
            let update = AdamUpdate::new(self.steps, learning_rate);
            for (k, gradient) in gradients.into_iter().enumerate() {
                (self.params[k], self.first[k], self.second[k]) = update.stepped_parameter(
                    self.params[k].clone(),
                    self.first[k].clone(),
                    self.second[k].clone(),
                    gradient,
                );
            }
            Ok(losses)
        })
    }

    /// As [`FieldEngine::loss_gradient`].
    ///
    /// # Errors
    /// [`EngineError::Failed`].
    pub fn try_gradient(&mut self, batch: &SampleBatch) -> Result<(FieldLosses, Vec<f32>), EngineError> {
        guarded("computed a gradient", || {
            let (losses, gradients) = self.losses_and_gradients(batch)?;
            Ok((losses, read_tensors(&gradients)?))
        })
    }

    /// As [`FieldEngine::training_state`].
    ///
    /// # Errors
    /// [`EngineError::Failed`].
    pub fn try_state(&self) -> Result<EngineState, EngineError> {
        guarded("returned the parameters", || {
            let first = read_tensors(&self.first)?;
            let second = read_tensors(&self.second)?;
            let flat = read_tensors(&self.params)?;
            let mut last = self.last_read.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            last.params.assign_values(&flat);
            (last.first, last.second, last.steps) = (first, second, self.steps);
            Ok(last.clone())
        })
    }

    /// Losses and their gradient by every parameter tensor.
    fn losses_and_gradients(
        &self,
        batch: &SampleBatch,
    ) -> Result<(FieldLosses, Vec<Tensor<1>>), EngineError> {
        let mut sums = FieldLosses::default();
        let mut gradients: Vec<Option<Tensor<1>>> = vec![None; self.params.len()];
        // One graph per piece bounds the memory of a step.
        for piece in batch_pieces(batch) {
            let params: Vec<Tensor<1>> =
                self.params.iter().map(|p| p.clone().autodiff().require_grad()).collect();
            let (sdf, color) = piece_losses(&self.shape, &params, batch, &piece);
            let mut backward = (sdf.clone() + color.clone()).backward();
            // One transfer, since each waits for the device.
            let values = Tensor::cat(vec![sdf, color], 0)
                .without_autodiff()
                .try_into_vec_as::<f32>()
                .map_err(|e| device_failure("read the losses", e))?;
            sums.sdf += f64::from(values[0]);
            sums.color += f64::from(values[1]);
            for (sum, param) in gradients.iter_mut().zip(&params) {
                if let Some(g) = param.grad_remove(&mut backward) {
                    *sum = Some(sum.take().map_or(g.clone(), |s| s + g));
                }
            }
        }
        let filled =
            gradients.into_iter().zip(&self.params).map(|(g, p)| g.unwrap_or_else(|| p.zeros_like()));
        Ok((sums, filled.collect()))
    }

    /// Stores the failure and returns NaN losses.
    fn record_failure(&self, error: EngineError) -> FieldLosses {
        self.failure.get_or_init(|| error);
        FieldLosses { sdf: f64::NAN, color: f64::NAN }
    }

    /// Returns the failure, if there was one.
    fn ensure_working(&self) -> Result<(), EngineError> {
        self.failure.get().cloned().map_or(Ok(()), Err)
    }
}

impl FieldEngine for BurnEngine {
    fn train_step(&mut self, batch: &SampleBatch, learning_rate: f32) -> FieldLosses {
        self.ensure_working()
            .and_then(|()| self.try_step(batch, learning_rate))
            .unwrap_or_else(|error| self.record_failure(error))
    }

    fn loss_gradient(&mut self, batch: &SampleBatch) -> (FieldLosses, Vec<f32>) {
        let parameters = self.params.iter().map(|p| p.dims()[0]).sum();
        let result = self.ensure_working().and_then(|()| self.try_gradient(batch));
        result.unwrap_or_else(|error| (self.record_failure(error), vec![f32::NAN; parameters]))
    }

    fn training_state(&self) -> EngineState {
        self.ensure_working().and_then(|()| self.try_state()).unwrap_or_else(|error| {
            self.record_failure(error);
            self.last_read.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()
        })
    }

    fn failure(&self) -> Option<&EngineError> {
        self.failure.get()
    }
}

impl Drop for BurnEngine {
    /// A lost device may panic as its memory is freed.
    fn drop(&mut self) {
        let tensors = [&mut self.params, &mut self.first, &mut self.second].map(std::mem::take);
        guarded("gave its memory back", || {
            drop(tensors);
            Ok(())
        })
        .ok();
    }
}

/// One step of Adam (Kingma and Ba 2015, algorithm 1), with the constants of `engine.rs`.
struct AdamUpdate {
    /// `learning_rate / (1 - beta1^t)`.
    rate: f32,
    /// `1 / sqrt(1 - beta2^t)`.
    root_scale: f32,
}

impl AdamUpdate {
    /// For step `t`, counted from 1.
    fn new(t: u64, learning_rate: f32) -> Self {
        let unbiased = |beta: f32| 1.0 - f64::from(beta).powf(t as f64);
        Self {
            rate: (f64::from(learning_rate) / unbiased(ADAM_BETAS.0)) as f32,
            root_scale: (1.0 / unbiased(ADAM_BETAS.1).sqrt()) as f32,
        }
    }

    /// The parameter and its moments after the step.
    fn stepped_parameter(
        &self,
        param: Tensor<1>,
        first: Tensor<1>,
        second: Tensor<1>,
        gradient: Tensor<1>,
    ) -> (Tensor<1>, Tensor<1>, Tensor<1>) {
        let (b1, b2) = ADAM_BETAS;
        let first = first * b1 + gradient.clone() * (1.0 - b1);
        let second = second * b2 + gradient.square() * (1.0 - b2);
        // docs/method.md (12.9): epsilon stands outside the root.
        let root = second.clone().sqrt() * self.root_scale + ADAM_EPSILON;
        (param - first.clone() * self.rate / root, first, second)
    }
}

/// Values of tensors, concatenated.
fn read_tensors(tensors: &[Tensor<1>]) -> Result<Vec<f32>, EngineError> {
    let mut all = Vec::new();
    for t in tensors {
        all.extend(t.try_to_vec_as::<f32>().map_err(|e| device_failure("was read", e))?);
    }
    Ok(all)
}

fn device_failure(doing: &'static str, error: impl std::fmt::Display) -> EngineError {
    EngineError::Failed { doing, message: error.to_string() }
}

/// Checks what the tensors assume: contiguous levels, hashed levels of 2^k entries, matching layers, and as
/// many moments as parameters.
fn check_shape(state: &EngineState) -> Result<(), EngineError> {
    let params = &state.params;
    let err = |text: String| Err(EngineError::Shape(text));
    let mut offset = 0;
    for (k, l) in params.levels.iter().enumerate() {
        let addressable = if l.hashed {
            // The low bits of a hash address the table.
            l.entries.is_power_of_two()
        } else {
            l.resolution.checked_pow(3).is_some_and(|n| n <= l.entries)
        };
        // Floats of a level are indexed by signed 32-bit integers.
        if l.offset != offset || !addressable || l.entries > 1 << 29 {
            return err(format!("level {k} is {l:?}"));
        }
        offset += l.entries * FEATURES;
    }
    if params.levels.is_empty() || params.table.len() != offset {
        return err(format!("the table holds {} floats, its levels ask for {offset}", params.table.len()));
    }
    let inputs = [FEATURES * params.levels.len(), VIEW_COEFFICIENTS + GEOMETRY_OUTPUTS - 1];
    for ((name, layers), (inputs, outputs)) in [("geometry", &params.geometry), ("color", &params.color)]
        .into_iter()
        .zip(inputs.into_iter().zip([GEOMETRY_OUTPUTS, 3]))
    {
        let mut width = inputs;
        for Layer { inputs, outputs, weights, biases } in layers {
            if *inputs != width || weights.len() != inputs * outputs || biases.len() != *outputs {
                return err(format!(
                    "a {name} layer is {inputs} to {outputs} with {} weights, {width} inputs expected",
                    weights.len()
                ));
            }
            width = *outputs;
        }
        if layers.is_empty() || width != outputs {
            return err(format!("the {name} network ends with {width} outputs instead of {outputs}"));
        }
    }
    let n = params.parameter_count();
    if state.first.len() != n || state.second.len() != n {
        return err(format!("{n} parameters with {} and {} moments", state.first.len(), state.second.len()));
    }
    Ok(())
}
