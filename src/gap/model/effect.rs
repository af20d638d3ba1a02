//! Effects: their equation, its derivatives, the searched shapes, and their place in the formats.

use super::{
    format::{Expression, Format, JointNumbers},
    plant::Plant,
};
use crate::record::{carried::Carried, log::JointLog};

/// Most parameters of one effect.
pub const MAX_PARAMETERS: usize = 5;

/// Dimension of a parameter; the text depends on the kind of joint.
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
    /// cycles/rad, cycles/m times 2 pi.
    WaveNumber,
    /// 1.
    Ratio,
}

impl Dimension {
    /// Unit of the dimension at a turning or sliding joint.
    #[must_use]
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
    /// Value of an absent effect; `None` for a shape parameter.
    pub neutral: Option<f64>,
    /// Whether it may be below zero.
    pub signed: bool,
}

/// Where an effect enters the equation of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A smooth effort.
    Effort,
    /// The push of a contact; it may take a share of the other efforts off.
    Contact,
    /// A bound on the set-valued friction.
    Friction,
    /// Added to the inertia.
    Inertia,
    /// Factor of the measured effort.
    Gain,
    /// Time by which the effort acts later.
    Delay,
    /// Added to the measured position.
    Bias,
    /// Factor of the measured position.
    Scale,
    /// Half of the gap between the joint and its sensor.
    Play,
}

/// State of a joint, for the evaluation of an effect.
#[derive(Clone, Copy, Debug, Default)]
pub struct At<'a> {
    /// rad or m.
    pub q: f64,
    /// rad/s or m/s.
    pub v: f64,
    /// Acting effort, N m or N.
    pub u: f64,
    /// Its derivatives by position and velocity, by a servo's feedback.
    pub feedback: [f64; 2],
    /// Seconds; runs lie apart, see [`run_time_s`].
    pub t: f64,
    /// Direction of motion against the friction: the sign of the velocity to stop.
    pub direction: f64,
    /// Positions of the other moving joints.
    pub others: &'a [f64],
    /// Sum of the smooth efforts with the acting one; only for [`Place::Contact`].
    pub load: f64,
    /// Effects of a chain's other joints on this one.
    pub carried: Option<&'a Carried>,
}

/// Value of an effect and its derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub struct Response {
    /// Effort, or bound of the friction.
    pub value: f64,
    /// Derivative by position.
    pub q: f64,
    /// Derivative by velocity.
    pub v: f64,
    /// Derivative by the measured effort.
    pub u: f64,
    /// Derivative by the sum of the smooth efforts.
    pub load: f64,
    /// Derivatives by the parameters.
    pub p: [f64; MAX_PARAMETERS],
}

/// Range of the recorded motion; shapes are laid over it.
#[derive(Clone, Debug, Default)]
pub struct Coverage {
    /// Lowest and highest position.
    pub position: (f64, f64),
    /// Largest range of positions within a run.
    pub travel: f64,
    /// Speeds: median and highest of the moving samples.
    pub speed: (f64, f64),
    /// Root mean square of the effort.
    pub effort_rms: f64,
    /// Sample interval, seconds.
    pub interval_s: f64,
    /// Inertia of the twin.
    pub inertia: f64,
    /// Viscous damping of the twin.
    pub damping: f64,
    /// Standard deviation of the positions' noise.
    pub position_noise: f64,
    /// Duration of each run.
    pub durations_s: Vec<f64>,
    /// Number of other moving joints.
    pub others: usize,
    /// The joint turns.
    pub turns: bool,
    /// The twin's load depends on the position.
    pub has_load_slope: bool,
    /// The joint shares a chain with other moving joints.
    pub in_chain: bool,
}

/// Distance between the runs on the common time axis, seconds.
/// chosen: longer than any run, and times keep nanoseconds.
pub const RUN_SPACING_S: f64 = 1e5;

/// Time of a sample on an axis without overlap of the runs.
#[must_use]
pub fn run_time_s(log_index: usize, log: &JointLog, sample: usize) -> f64 {
    RUN_SPACING_S * log_index as f64 + log.time_s[sample]
}

/// Fixed facts of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// Name in reports.
    pub name: &'static str,
    /// Where it enters.
    pub place: Place,
    /// Its parameters, those with a neutral value first.
    pub parameters: &'static [Parameter],
    /// Its special cases; they are preferred where they do as well.
    pub contains: &'static [&'static str],
    /// The recording to distinguish it from similar effects.
    pub experiment: &'static str,
}

impl Spec {
    /// Whether two effects are one, or one of them contains the other: beside each other they explain nothing
    /// more.
    #[must_use]
    pub fn overlaps_with(&self, other: &Self) -> bool {
        self.name == other.name || self.contains.contains(&other.name) || other.contains.contains(&self.name)
    }
}

/// Positions and times of a stretch of motion; bounds are those of [`At::q`] and [`At::t`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Lowest and highest position.
    pub position: (f64, f64),
    /// First and last time, seconds on the common axis.
    pub time_s: (f64, f64),
}

impl Extent {
    /// Whether an interval about a center meets these bounds.
    #[must_use]
    pub fn meets_interval(bounds: (f64, f64), center: f64, half_width: f64) -> bool {
        center + half_width >= bounds.0 && center - half_width <= bounds.1
    }
}

/// A candidate. One file in `effects/` each.
pub trait Effect: Sync + Send + std::fmt::Debug {
    /// Its fixed facts.
    fn effect_spec(&self) -> &'static Spec;
    /// Name in reports.
    fn name(&self) -> &'static str {
        self.effect_spec().name
    }
    /// Where it enters.
    fn place(&self) -> Place {
        self.effect_spec().place
    }
    /// Its parameters.
    fn parameters(&self) -> &'static [Parameter] {
        self.effect_spec().parameters
    }
    /// Value and derivatives; only for [`Place::Effort`], [`Place::Contact`] and [`Place::Friction`].
    fn write_response(&self, _at: &At, _p: &[f64], _out: &mut Response) {}
    /// Starting points: full parameter vectors with the neutral ones at their neutral value. Empty where the
    /// motion cannot show the effect. A single neutral one, unless there are parameters of a shape.
    fn start_shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        // One parameter without a neutral value empties the list: such an effect must bring its own grid.
        self.parameters().iter().map(|p| p.neutral).collect::<Option<_>>().into_iter().collect()
    }
    /// Whether an effect of this shape acts at all on a stretch of motion; only a matter of speed.
    fn reaches_extent(&self, _shape: &[f64], _extent: &Extent) -> bool {
        true
    }
    /// Bounds of a parameter for this motion.
    fn parameter_bounds(&self, index: usize, _coverage: &Coverage) -> (f64, f64) {
        let p = &self.parameters()[index];
        if p.signed { (-1e9, 1e9) } else { (0.0, 1e9) }
    }
    /// Further starting points of a fit beginning at `p`.
    fn restart_points(&self, p: &[f64], _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![p.to_vec()]
    }
    /// Whether it stands at the high end of the range, for an effect with two ends.
    fn is_upper(&self) -> bool {
        false
    }
    /// Index of the parameter with the position of a contact's begin.
    fn contact_parameter(&self) -> Option<usize> {
        None
    }
    /// The partner without distinction from this one by any recording of such a joint.
    fn indistinguishable_partner(&self, _coverage: &Coverage) -> Option<&'static str> {
        None
    }
    /// Whether it happened in one run and is no property of the joint: it is never exported.
    fn is_of_one_run(&self) -> bool {
        false
    }
    /// Whether its effort depends on the velocity alone.
    fn is_of_velocity(&self) -> bool {
        false
    }
    /// Whether it is a damping, and nothing else.
    fn is_of_damping(&self) -> bool {
        false
    }
    /// Whether its effort depends on the position alone, by a shape of its own.
    fn is_of_position(&self) -> bool {
        false
    }
    /// Friction lost from rest to speed, for one falling with speed.
    fn friction_fall(&self, _p: &[f64]) -> f64 {
        0.0
    }
    /// The twin's own amount of an amplitude; the updated twin has both, their product of a factor.
    fn in_twin(&self, index: usize, _plant: &Plant) -> f64 {
        self.parameters()[index].neutral.unwrap_or_default()
    }
    /// Its expression in a format at a joint of the twin.
    fn in_format(&self, _format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::NotExpressible
    }
    /// Adds it to the numbers of the joint for files.
    fn add_to_numbers(&self, _p: &[f64], _joint: &mut JointNumbers) {}
    /// Parameters as a report names them, each with its gradient by the internal parameters.
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

/// A parameter as a report gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reported {
    /// Name.
    pub name: &'static str,
    /// Its dimension.
    pub dimension: Dimension,
    /// Value.
    pub value: f64,
    /// Gradient by the internal parameters.
    pub gradient: [f64; MAX_PARAMETERS],
}

/// Shorthand for a parameter with a neutral value of zero.
#[must_use]
pub const fn amplitude_parameter(name: &'static str, dimension: Dimension, signed: bool) -> Parameter {
    Parameter { name, dimension, neutral: Some(0.0), signed }
}

/// Largest ratio of two numbers of the same unit.
/// derived: degrees for radians; a larger ratio is one of units.
pub const LARGEST_RATIO: f64 = 180.0 / std::f64::consts::PI;

/// Shorthand for a factor, with a neutral value of one.
#[must_use]
pub const fn ratio_parameter(name: &'static str) -> Parameter {
    Parameter { name, dimension: Dimension::Ratio, neutral: Some(1.0), signed: false }
}

/// Shorthand for a parameter of the shape.
#[must_use]
pub const fn shape_parameter(name: &'static str, dimension: Dimension, signed: bool) -> Parameter {
    Parameter { name, dimension, neutral: None, signed }
}
