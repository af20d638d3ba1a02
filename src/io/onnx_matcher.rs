//! Runs a matching model; see `onnx.rs` for its contract.

use std::{
    io::Read as _,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use tract_onnx::{prelude::*, tract_hir::infer::Factoid as _};

use super::onnx::{MAX_MODEL_BYTES, MAX_PAIR_MATCHES, OnnxError};
use articulate::{ImageFormat, ModelImage};
use capture::{Correspondence, RgbdFrame};

const INPUTS: [&str; 2] = ["image0", "image1"];
const POINTS: [&str; 2] = ["keypoints0", "keypoints1"];
const CONFIDENCE: &str = "confidence";
/// Number of pairs of image sizes whose plan is kept.
const KEPT_PLANS: usize = 8;

type Plan = Arc<TypedRunnableModel>;
/// Width and height of both images.
type Sizes = [[usize; 2]; 2];

/// A model from a file, ready to match frames.
pub struct OnnxMatcher {
    path: PathBuf,
    model: InferenceModel,
    formats: [ImageFormat; 2],
    max_side_px: usize,
    has_confidence: bool,
    /// The model optimized for the image sizes met last.
    plans: Mutex<Vec<(Sizes, Plan)>>,
}

impl std::fmt::Debug for OnnxMatcher {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxMatcher")
            .field("path", &self.path)
            .field("formats", &self.formats)
            .finish_non_exhaustive()
    }
}

impl OnnxMatcher {
    /// Reads a model. If it leaves the images' size open, they get at most `max_side_px` pixels along a side.
    ///
    /// # Errors
    /// If the file cannot be read, is too large, is not a model, or its inputs or outputs do not fit the
    /// contract.
    pub fn open(path: &Path, max_side_px: usize) -> Result<Self, OnnxError> {
        let bytes = read(path)?;
        let refused = |reason: String| OnnxError::Model { path: path.to_owned(), reason };
        let read = caught(|| onnx().model_for_read(&mut bytes.as_slice()));
        let mut model = read.map_err(|e| refused(e.to_string()))?;
        let outputs = output_names(&model);
        let formats = INPUTS.map(|name| format(&model, name));
        let has = || OnnxError::Contract { path: path.to_owned(), has: description(&model, &outputs) };
        let [Some(format0), Some(format1)] = formats else { return Err(has()) };
        let outlet = |name: &str| outputs.iter().find(|(n, _)| n == name).map(|(_, outlet)| *outlet);
        let (Some(points0), Some(points1)) = (outlet(POINTS[0]), outlet(POINTS[1])) else {
            return Err(has());
        };
        if model.inputs.len() != INPUTS.len() {
            return Err(has());
        }
        let confidence = outlet(CONFIDENCE);
        let wanted: Vec<OutletId> = [points0, points1].into_iter().chain(confidence).collect();
        // Nodes needed only for other outputs are then not computed.
        model.select_output_outlets(&wanted).map_err(|e| refused(chain(&e)))?;
        let formats = [format0, format1];
        let has_confidence = confidence.is_some();
        Ok(Self {
            path: path.to_owned(),
            model,
            formats,
            max_side_px,
            has_confidence,
            plans: Mutex::default(),
        })
    }

    /// Matches of two frames, in their pixels; those outside the frames or without a finite confidence are
    /// left out.
    ///
    /// # Errors
    /// [`OnnxError::Run`] if the model fails, or returns something else than matches.
    pub fn correspondences(&self, frames: [&RgbdFrame; 2]) -> Result<Vec<Correspondence>, OnnxError> {
        let images = [0, 1].map(|k| ModelImage::from_frame(frames[k], self.formats[k], self.max_side_px));
        let sizes = [0, 1].map(|k| [images[k].width, images[k].height]);
        let failed = |reason: String| OnnxError::Run { path: self.path.clone(), sizes, reason };
        let inputs = [0, 1].map(|k| {
            let shape = [1, self.formats[k].channels, images[k].height, images[k].width];
            Tensor::from_shape(&shape, &images[k].values)
        });
        let outputs = caught(|| {
            let plan = self.plan(sizes)?;
            let [image0, image1] = inputs;
            plan.run(self.in_order(image0?.into(), image1?.into()))
        });
        let outputs = outputs.map_err(|e| failed(e.to_string()))?;
        let points0 = numbers(&outputs[0], 2).map_err(|e| failed(format!("keypoints0 {e}")))?;
        let points1 = numbers(&outputs[1], 2).map_err(|e| failed(format!("keypoints1 {e}")))?;
        let n = points0.len() / 2;
        let confidence = match outputs.get(2) {
            Some(tensor) if self.has_confidence => {
                numbers(tensor, 1).map_err(|e| failed(format!("confidence {e}")))?
            }
            _ => vec![1.0; n],
        };
        if points1.len() != 2 * n || confidence.len() != n || n > MAX_PAIR_MATCHES {
            let lengths =
                format!("{n} keypoints0, {} keypoints1, {} confidences", points1.len() / 2, confidence.len());
            return Err(failed(format!("{lengths}; they must be as many, {MAX_PAIR_MATCHES} at most")));
        }
        let found = (0..n).filter_map(|i| {
            let pixel0 = images[0].frame_pixel([points0[2 * i], points0[2 * i + 1]])?;
            let pixel1 = images[1].frame_pixel([points1[2 * i], points1[2 * i + 1]])?;
            let confidence = confidence[i];
            confidence.is_finite().then_some(Correspondence { pixels: [pixel0, pixel1], confidence })
        });
        Ok(found.collect())
    }

    /// Both images in the order of the model's inputs.
    fn in_order(&self, image0: TValue, image1: TValue) -> TVec<TValue> {
        if self.input(0) < self.input(1) { tvec!(image0, image1) } else { tvec!(image1, image0) }
    }

    /// Index of `image0` or `image1` among the model's inputs.
    fn input(&self, k: usize) -> usize {
        input_place(&self.model, INPUTS[k]).unwrap_or(k)
    }

    /// The model for images of these sizes.
    fn plan(&self, sizes: Sizes) -> TractResult<Plan> {
        // A panic inside the runtime (`caught`) poisons the lock, but the plans are intact: one is added only
        // when it is finished.
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, plan)) = plans.iter().find(|(s, _)| *s == sizes) {
            return Ok(plan.clone());
        }
        // The runtime optimizes for fixed sizes. Frames of a recording share them, so few plans will do.
        let mut model = self.model.clone();
        for k in [0, 1] {
            let [width, height] = sizes[k];
            model.set_input_fact(
                self.input(k),
                f32::fact([1, self.formats[k].channels, height, width]).into(),
            )?;
        }
        let plan = model.into_optimized()?.into_runnable()?;
        plans.truncate(KEPT_PLANS - 1);
        plans.insert(0, (sizes, plan.clone()));
        Ok(plan)
    }
}

/// The file, if it is not too large.
fn read(path: &Path) -> Result<Vec<u8>, OnnxError> {
    let fails = |source| OnnxError::Read { path: path.to_owned(), source };
    let file = common::files::open_regular(path).map_err(fails)?;
    let stated_bytes = file.metadata().map_err(fails)?.len();
    let mut bytes = Vec::new();
    // A file that is too large is not read; one that grows meanwhile is cut a byte beyond the limit.
    file.take(if stated_bytes > MAX_MODEL_BYTES { 0 } else { MAX_MODEL_BYTES + 1 })
        .read_to_end(&mut bytes)
        .map_err(fails)?;
    if stated_bytes.max(bytes.len() as u64) > MAX_MODEL_BYTES {
        Err(OnnxError::TooLarge { path: path.to_owned() })
    } else {
        Ok(bytes)
    }
}

/// Why the runtime gives no result.
#[derive(Debug, thiserror::Error)]
enum RuntimeError {
    #[error("the runtime panicked")]
    Panic,
    #[error("{}", chain(.0))]
    Refusal(TractError),
    #[error("has the shape {0:?}")]
    Shape(Vec<usize>),
}

/// The runtime's result, with panics turned into errors.
fn caught<T>(work: impl FnOnce() -> TractResult<T>) -> Result<T, RuntimeError> {
    // The model is a file of the user: a panic of the runtime must not end a run of an hour.
    let result = catch_unwind(AssertUnwindSafe(work)).map_err(|_panic| RuntimeError::Panic)?;
    result.map_err(RuntimeError::Refusal)
}

/// An error and its causes in one line.
fn chain(error: &TractError) -> String {
    error.chain().map(|cause| cause.to_string().replace('\n', " ")).collect::<Vec<_>>().join(": ")
}

fn input_place(model: &InferenceModel, name: &str) -> Option<usize> {
    model.inputs.iter().position(|outlet| model.node(outlet.node).name == name)
}

/// Outputs by their names in the file.
fn output_names(model: &InferenceModel) -> Vec<(String, OutletId)> {
    let name =
        |outlet: &OutletId| model.outlet_label(*outlet).unwrap_or(&model.node(outlet.node).name).to_owned();
    model.outputs.iter().map(|outlet| (name(outlet), *outlet)).collect()
}

/// Format of a float32 `[1, 1 or 3, height, width]` input.
fn format(model: &InferenceModel, name: &str) -> Option<ImageFormat> {
    let fact = model.input_fact(input_place(model, name)?).ok()?;
    if fact.datum_type.concretize() != Some(DatumType::F32) {
        return None;
    }
    let dims = dims(fact);
    let [batch, Some(channels @ (1 | 3)), height, width] = dims[..] else { return None };
    let usable = [height, width].iter().flatten().all(|side| (1..=8192).contains(side));
    let valid = batch.is_none_or(|b| b == 1) && usable;
    valid.then_some(ImageFormat { channels, height, width })
}

/// Sizes of all dimensions, `None` where the model leaves them open.
fn dims(fact: &InferenceFact) -> Vec<Option<usize>> {
    fact.shape.dims().map(|d| d.concretize().and_then(|d| usize::try_from(d.as_i64()?).ok())).collect()
}

fn input_description(model: &InferenceModel, outlet: &OutletId) -> String {
    let name = &model.node(outlet.node).name;
    let Ok(fact) = model.outlet_fact(*outlet) else { return name.clone() };
    let dims: Vec<String> =
        dims(fact).into_iter().map(|d| d.map_or("?".to_owned(), |d| d.to_string())).collect();
    let kind = fact.datum_type.concretize().map_or("?".to_owned(), |t| format!("{t:?}").to_lowercase());
    format!("{name} {kind} [{}]", dims.join(", "))
}

/// Inputs and outputs in words.
fn description(model: &InferenceModel, outputs: &[(String, OutletId)]) -> String {
    let inputs: Vec<String> = model.inputs.iter().map(|outlet| input_description(model, outlet)).collect();
    let outputs: Vec<&str> = outputs.iter().map(|(name, _)| name.as_str()).collect();
    format!("inputs {} and outputs {}", inputs.join(", "), outputs.join(", "))
}

/// Values of a `[n, width]`, `[1, n, width]` tensor (of `[n]`, `[1, n]` where the width is 1) as floats.
fn numbers(tensor: &TValue, width: usize) -> Result<Vec<f32>, RuntimeError> {
    let shape = tensor.shape();
    let inner =
        shape.strip_prefix(&[1]).filter(|rest| rest.len() == if width == 1 { 1 } else { 2 }).unwrap_or(shape);
    let fits = if width == 1 { inner.len() == 1 } else { inner.len() == 2 && inner[1] == width };
    if !fits {
        return Err(RuntimeError::Shape(shape.to_vec()));
    }
    let floats = tensor.cast_to::<f32>().map_err(RuntimeError::Refusal)?;
    floats
        .try_as_plain_ram()
        .and_then(|view| view.as_slice::<f32>().map(<[f32]>::to_vec))
        .map_err(RuntimeError::Refusal)
}
