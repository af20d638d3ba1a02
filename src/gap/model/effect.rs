//! Effects: equation, derivatives, searched shapes, and expression in file formats.

use super::{
    format::{Expression, Format, JointNumbers},
    plant::Plant,
};
use crate::record::{carried::Carried, log::JointLog};

/// Most parameters of one effect.
pub const MAX_PARAMETERS: usize = 5;

/// Physical dimension of a parameter; its unit depends on the kind of joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// rad, m.
    Position,
    /// rad/s, m/s.
    Velocity,
    /// N m, N.
    Effort,
    /// N m s/rad, N s/m.
    Damping,
    /// N m s^2/rad^2, N s^2/m^2.
    Drag,
    /// N m/rad, N/m.
    Stiffness,
    /// N m/rad^3, N/m^3.
    CubicStiffness,
    /// kg m^2, kg.
    Inertia,
    /// s.
    Time,
    /// cycles/rad or cycles/m, times 2 pi.
    WaveNumber,
    /// 1.
    Ratio,
}

impl Dimension {
    /// Unit for a turning or a sliding joint.
    pub fn unit_name(self, turns: bool) -> &'static str {
        let (turning, sliding) = match self {
            Self::Position => ("rad", "m"),
            Self::Velocity => ("rad/s", "m/s"),
            Self::Effort => ("N m", "N"),
            Self::Damping => ("N m s/rad", "N s/m"),
            Self::Drag => ("N m s^2/rad^2", "N s^2/m^2"),
            Self::Stiffness => ("N m/rad", "N/m"),
            Self::CubicStiffness => ("N m/rad^3", "N/m^3"),
            Self::Inertia => ("kg m^2", "kg"),
            Self::Time => ("s", "s"),
            Self::WaveNumber => ("rad/rad", "rad/m"),
            Self::Ratio => ("1", "1"),
        };
        if turns { turning } else { sliding }
    }
}

/// One parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name in reports.
    pub name: &'static str,
    /// Its dimension.
    pub dimension: Dimension,
    /// Value at which the effect vanishes; `None` for a shape parameter.
    pub neutral: Option<f64>,
    /// Whether it may be negative.
    pub signed: bool,
}

/// Where an effect enters the equation of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A smooth effort.
    Effort,
    /// The push of a contact; it may absorb a share of the other efforts.
    Contact,
    /// A bound on the set-valued friction.
    Friction,
    /// An addition to the inertia.
    Inertia,
    /// A factor of the measured effort.
    Gain,
    /// A delay of the effort.
    Delay,
    /// An addition to the measured position.
    Bias,
    /// A factor of the measured position.
    Scale,
    /// Half the gap between the joint and its sensor.
    Play,
}

/// State of a joint, for evaluating an effect.
#[derive(Clone, Copy, Debug, Default)]
pub struct At<'a> {
    /// Position, rad or m.
    pub q: f64,
    /// Velocity, rad/s or m/s.
    pub v: f64,
    /// Acting effort, N m or N.
    pub u: f64,
    /// Its derivatives with respect to position and velocity, from a servo's feedback.
    pub feedback: [f64; 2],
    /// Time, seconds; runs are placed apart, see [`run_time_s`].
    pub t: f64,
    /// Direction opposed by friction: the sign of the velocity, or at rest of the impending motion.
    pub direction: f64,
    /// Positions of the other moving joints, rad or m.
    pub others: &'a [f64],
    /// Sum of the smooth efforts, the acting one included; only for [`Place::Contact`].
    pub load: f64,
    /// Inertia and load from the other joints of the chain.
    pub carried: Option<&'a Carried>,
}

/// Value of an effect and its derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub struct Response {
    /// Effort, or bound of the friction.
    pub value: f64,
    /// Derivative with respect to position.
    pub q: f64,
    /// Derivative with respect to velocity.
    pub v: f64,
    /// Derivative with respect to the measured effort.
    pub u: f64,
    /// Derivative with respect to the sum of the smooth efforts.
    pub load: f64,
    /// Derivatives with respect to the parameters.
    pub p: [f64; MAX_PARAMETERS],
}

/// Range of the recorded motion; the searched shapes are scaled to it.
#[derive(Clone, Debug, Default)]
pub struct Coverage {
    /// Lowest and highest position, rad or m.
    pub position: (f64, f64),
    /// Largest range of positions within a run, rad or m.
    pub travel: f64,
    /// Median and top speed of the moving samples.
    pub speed: (f64, f64),
    /// Root mean square effort, N m or N.
    pub effort_rms: f64,
    /// Sample interval, seconds.
    pub interval_s: f64,
    /// The twin's inertia, kg m^2 or kg.
    pub inertia: f64,
    /// The twin's viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Standard deviation of the position noise, rad or m.
    pub position_noise: f64,
    /// Duration of each run, seconds.
    pub durations_s: Vec<f64>,
    /// Number of other moving joints.
    pub others: usize,
    /// Whether the joint is revolute.
    pub turns: bool,
    /// Whether the twin's load depends on the position.
    pub has_load_slope: bool,
    /// Whether the joint is in a chain with other moving joints.
    pub in_chain: bool,
}

/// Spacing of the runs on the common time axis, seconds.
/// chosen: longer than any run, while times keep nanosecond resolution.
pub const RUN_SPACING_S: f64 = 1e5;

/// Time of a sample, seconds, on an axis where runs do not overlap.
pub fn run_time_s(log_index: usize, log: &JointLog, sample: usize) -> f64 {
    RUN_SPACING_S * log_index as f64 + log.time_s[sample]
}

/// Constant properties of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// Name in reports.
    pub name: &'static str,
    /// Where it enters the equation of motion.
    pub place: Place,
    /// Its parameters, those with a neutral value first.
    pub parameters: &'static [Parameter],
    /// Names of its special cases, preferred if they do as well.
    pub contains: &'static [&'static str],
    /// The recording to distinguish it from similar effects.
    pub experiment: &'static str,
}

impl Spec {
    /// Whether two effects are the same or one contains the other: together they explain no more.
    pub fn overlaps_with(&self, other: &Self) -> bool {
        self.name == other.name || self.contains.contains(&other.name) || other.contains.contains(&self.name)
    }
}

/// Ranges of position and time of a stretch of motion, in terms of [`At::q`] and [`At::t`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Lowest and highest position.
    pub position: (f64, f64),
    /// First and last time, seconds on the common axis.
    pub time_s: (f64, f64),
}

impl Extent {
    /// Whether an interval about a center overlaps these bounds.
    pub fn meets_interval(bounds: (f64, f64), center: f64, half_width: f64) -> bool {
        center + half_width >= bounds.0 && center - half_width <= bounds.1
    }
}

/// A candidate effect. Each has one file in `effects/`.
pub trait Effect: Sync + Send + std::fmt::Debug {
    /// Its constant properties.
    fn effect_spec(&self) -> &'static Spec;
    /// Name in reports.
    fn name(&self) -> &'static str {
        self.effect_spec().name
    }
    /// Where it enters the equation of motion.
    fn place(&self) -> Place {
        self.effect_spec().place
    }
    /// Its parameters.
    fn parameters(&self) -> &'static [Parameter] {
        self.effect_spec().parameters
    }
    /// Writes value and derivatives; only for [`Place::Effort`], [`Place::Contact`] and [`Place::Friction`].
    fn write_response(&self, _at: &At, _p: &[f64], _out: &mut Response) {}
    /// Start values for the search: full parameter vectors, amplitudes at their neutral values. Empty if the
    /// motion cannot show the effect; a single vector if there are no shape parameters.
    fn start_shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        // A shape parameter has no neutral value, and the list becomes empty: such effects define their own
        // grid.
        self.parameters().iter().map(|p| p.neutral).collect::<Option<_>>().into_iter().collect()
    }
    /// Whether an effect with this shape acts on a stretch of motion at all; used only for speed.
    fn reaches_extent(&self, _shape: &[f64], _extent: &Extent) -> bool {
        true
    }
    /// Bounds of a parameter for a motion.
    fn parameter_bounds(&self, index: usize, _coverage: &Coverage) -> (f64, f64) {
        let p = &self.parameters()[index];
        if p.signed { (-1e9, 1e9) } else { (0.0, 1e9) }
    }
    /// Further start values of a fit starting at `p`.
    fn restart_points(&self, p: &[f64], _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![p.to_vec()]
    }
    /// Whether it is at the upper end of the range, for an effect with two ends.
    fn is_upper(&self) -> bool {
        false
    }
    /// Index of the parameter for the position where a contact begins.
    fn contact_parameter(&self) -> Option<usize> {
        None
    }
    /// Name of an effect no recording of such a joint can distinguish from this one.
    fn indistinguishable_partner(&self, _coverage: &Coverage) -> Option<&'static str> {
        None
    }
    /// Whether it occurred in one run only and is no property of the joint: it is never exported.
    fn is_of_one_run(&self) -> bool {
        false
    }
    /// Whether its effort depends on the velocity alone.
    fn is_of_velocity(&self) -> bool {
        false
    }
    /// Whether it is a pure damping.
    fn is_of_damping(&self) -> bool {
        false
    }
    /// Whether its effort depends on the position alone, with a shape of its own.
    fn is_of_position(&self) -> bool {
        false
    }
    /// Index in [`At::others`] of the joint that it couples to.
    fn other_joint(&self) -> Option<usize> {
        None
    }
    /// Decrease of the friction from rest to speed, for a friction falling with speed.
    fn friction_fall(&self, _p: &[f64]) -> f64 {
        0.0
    }
    /// Value of an amplitude already present in the twin; the updated twin has the sum of both, or the
    /// product for a factor.
    fn in_twin(&self, index: usize, _plant: &Plant) -> f64 {
        self.parameters()[index].neutral.unwrap_or_default()
    }
    /// How a format expresses it at a joint of the twin.
    fn in_format(&self, _format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::NotExpressible
    }
    /// Adds it to the joint's numbers written to files.
    fn add_to_numbers(&self, _p: &[f64], _joint: &mut JointNumbers) {}
    /// Parameters as reported, each with its gradient with respect to the internal parameters.
    fn reported_parameters(&self, p: &[f64]) -> Vec<Reported> {
        let mut all = Vec::new();
        for (i, spec) in self.parameters().iter().enumerate() {
            let mut gradient = [0.0; MAX_PARAMETERS];
            gradient[i] = 1.0;
            all.push(Reported { name: spec.name, dimension: spec.dimension, value: p[i], gradient });
        }
        all
    }
}

/// A parameter as reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reported {
    /// Name.
    pub name: &'static str,
    /// Its dimension.
    pub dimension: Dimension,
    /// Value.
    pub value: f64,
    /// Gradient with respect to the internal parameters.
    pub gradient: [f64; MAX_PARAMETERS],
}

/// Shorthand for a parameter with the neutral value zero.
pub const fn amplitude_parameter(name: &'static str, dimension: Dimension, signed: bool) -> Parameter {
    Parameter { name, dimension, neutral: Some(0.0), signed }
}

/// Largest ratio of two numbers of the same unit.
/// derived: degrees instead of radians; a larger ratio means another unit.
pub const LARGEST_RATIO: f64 = 180.0 / std::f64::consts::PI;

/// Shorthand for a factor, with the neutral value one.
pub const fn ratio_parameter(name: &'static str) -> Parameter {
    Parameter { name, dimension: Dimension::Ratio, neutral: Some(1.0), signed: false }
}

/// Shorthand for a shape parameter.
pub const fn shape_parameter(name: &'static str, dimension: Dimension, signed: bool) -> Parameter {
    Parameter { name, dimension, neutral: None, signed }
}
