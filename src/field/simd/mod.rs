//! Vector kernels of the field networks, selected at run time: AVX-512, AVX2 with FMA, or portable code (NEON
//! on aarch64, by the compiler).
//!
//! Every kernel is written once, generic over [`Lanes`], and compiled for each instruction set. This folder
//! holds most of the crate's `unsafe` code: kernels check the lengths of their slices once and then work on
//! pointers.

mod adam;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod hash;
mod lanes;
mod matmul;
mod portable;
mod sigmoid;

pub(super) use adam::AdamStep;
pub(super) use hash::{LevelGeometry, LevelJacobian, PointColumns};
pub(super) use lanes::COLUMN_ALIGN;
pub(super) use matmul::{Columns, Epilogue};

/// An instruction set of this processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionSet(Kind);

/// Constructed only after detection: `InstructionSet(Kind::Avx512)` proves that the processor has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

impl InstructionSet {
    /// The fastest instruction set of this processor.
    pub fn detect() -> Self {
        Self::available_sets()[0]
    }

    /// All instruction sets of this processor, fastest first; never empty.
    pub fn available_sets() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            // The AVX-512 kernels use `avx2::add_pair` as well.
            if avx2 && is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
                sets.push(Self(Kind::Avx512));
            }
            if avx2 {
                sets.push(Self(Kind::Avx2));
            }
        }
        sets.push(Self(Kind::Portable));
        sets
    }

    /// Name of the instruction set for reports.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "AVX2",
            Kind::Portable => "portable",
        }
    }
}

/// Compiles a generic kernel for every instruction set and makes it a method of [`InstructionSet`].
macro_rules! dispatch {
    ($(#[$doc:meta])* $name:ident($($arg:ident: $ty:ty),* $(,)?) = $kernel:path) => {
        impl InstructionSet {
            $(#[$doc])*
            pub(super) fn $name(self, $($arg: $ty),*) {
                match self.0 {
                    #[cfg(target_arch = "x86_64")]
                    Kind::Avx512 => {
                        #[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
                        fn run($($arg: $ty),*) {
                            // SAFETY: this function is compiled with the features of the token.
                            $kernel(unsafe { avx512::Avx512::assume() }, $($arg),*);
                        }
                        // SAFETY: `Kind::Avx512` exists only once these features were detected.
                        unsafe { run($($arg),*) }
                    }
                    #[cfg(target_arch = "x86_64")]
                    Kind::Avx2 => {
                        #[target_feature(enable = "avx2,fma")]
                        fn run($($arg: $ty),*) {
                            // SAFETY: this function is compiled with the features of the token.
                            $kernel(unsafe { avx2::Avx2::assume() }, $($arg),*);
                        }
                        // SAFETY: `Kind::Avx2` exists only once these features were detected.
                        unsafe { run($($arg),*) }
                    }
                    Kind::Portable => $kernel(portable::Portable, $($arg),*),
                }
            }
        }
    };
}

dispatch! {
    /// `y = epilogue(W x + b)`; see [`matmul::forward`].
    matmul(
        weights: &[f32],
        biases: Option<&[f32]>,
        x: Columns<'_>,
        y: &mut [f32],
        cols: usize,
        epilogue: Epilogue<'_>,
    ) = matmul::forward
}
dispatch! {
    /// `dW += dy x^T`, `db += sum dy`; see [`matmul::weight_gradient`].
    weight_gradient(
        dy: Columns<'_>,
        x: Columns<'_>,
        cols: usize,
        d_weights: &mut [f32],
        d_biases: &mut [f32],
    ) = matmul::weight_gradient
}
dispatch! {
    /// Features of one level at many points; see [`hash::encode`].
    encode(
        level: LevelGeometry,
        table: &[f32],
        points: PointColumns<'_>,
        first: &mut [f32],
        second: &mut [f32],
    ) = hash::encode
}
dispatch! {
    /// Features of one level and their derivatives; see [`hash::encode_jacobian`].
    encode_jacobian(
        level: LevelGeometry,
        table: &[f32],
        points: PointColumns<'_>,
        out: LevelJacobian<'_>,
    ) = hash::encode_jacobian
}
dispatch! {
    /// Adds the gradient of a level's features to the gradient of its table; see [`hash::scatter`].
    scatter(
        level: LevelGeometry,
        gradient: &mut [f32],
        points: PointColumns<'_>,
        first: &[f32],
        second: &[f32],
    ) = hash::scatter
}
dispatch! {
    /// One Adam step; see [`adam::update`].
    adam(
        step: AdamStep,
        params: &mut [f32],
        first: &mut [f32],
        second: &mut [f32],
        gradient: &mut [f32],
    ) = adam::update
}
dispatch! {
    /// Logistic function in place; see [`sigmoid::sigmoid`].
    sigmoid(values: &mut [f32]) = sigmoid::sigmoid
}

#[cfg(test)]
mod tests;
