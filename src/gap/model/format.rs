//! File formats, and the numbers of a joint written to them.

/// A file format effects are written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// URDF.
    Urdf,
    /// MJCF.
    Mjcf,
    /// SDF.
    Sdf,
    /// USD with the attributes of PhysX and Newton.
    Usd,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Urdf, Self::Mjcf, Self::Sdf, Self::Usd];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Mjcf => "mjcf",
            Self::Sdf => "sdf",
            Self::Usd => "usd",
        }
    }
}

/// How a format expresses an effect.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// Exactly.
    Native,
    /// By the nearest effects of the catalogue.
    Approximated(Vec<NearestEffect>),
    /// Not at all.
    NotExpressible,
}

impl Expression {
    /// Native if `can` holds, else not expressible.
    pub fn native_if(can: bool) -> Self {
        if can { Self::Native } else { Self::NotExpressible }
    }
}

/// An effect standing in for another.
#[derive(Clone, Debug, PartialEq)]
pub struct NearestEffect {
    /// Its name; `None` for the same effect with other parameters.
    pub effect: Option<&'static str>,
    /// Its parameters.
    pub p: Vec<f64>,
}

impl NearestEffect {
    /// Stands in by another effect.
    pub fn other_effect(name: &'static str, p: Vec<f64>) -> Self {
        Self { effect: Some(name), p }
    }

    /// Stands in by the same effect with other parameters.
    pub fn same_effect(p: Vec<f64>) -> Self {
        Self { effect: None, p }
    }
}

/// A spring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spring {
    /// Stiffness, N m/rad or N/m.
    pub stiffness: f64,
    /// Stiffness growing with the square of the deflection, N m/rad^3 or N/m^3.
    pub cubic: f64,
    /// Position at rest, rad or m.
    pub rest: f64,
}

/// A stop at one end of a joint's range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Whether it is at the upper end.
    pub is_upper: bool,
    /// Position, rad or m.
    pub position: f64,
    /// Stiffness, N m/rad or N/m.
    pub stiffness: f64,
    /// Damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Share of the other efforts absorbed by the stop.
    pub impedance: f64,
}

/// Numbers of one joint with its effects; efforts in N m or N, angles in radians. A format writes those it
/// has a place for.
#[derive(Clone, Debug, PartialEq)]
pub struct JointNumbers {
    /// Viscous damping.
    pub damping: f64,
    /// Drag, proportional to the square of the speed.
    pub drag: f64,
    /// Sliding friction.
    pub friction: f64,
    /// Additional friction at rest, until the joint breaks loose.
    pub breakaway_excess: f64,
    /// A spring, if there is one.
    pub spring: Option<Spring>,
    /// Inertia in addition to the links'.
    pub armature: f64,
    /// Position shown by the sensor with the joint at 0.
    pub position_offset: f64,
    /// Constant effort.
    pub bias: f64,
    /// Factor of the effort.
    pub gear: f64,
    /// Delay of the effort, seconds.
    pub delay_s: f64,
    /// Stops.
    pub stops: Vec<Stop>,
    /// Load removed by a tilt of the joint: factors of sin q and cos q.
    pub tilt: Option<[f64; 2]>,
}

impl JointNumbers {
    /// A joint without effects.
    pub fn without_effects(damping: f64, friction: f64) -> Self {
        Self {
            damping,
            drag: 0.0,
            friction,
            breakaway_excess: 0.0,
            spring: None,
            armature: 0.0,
            position_offset: 0.0,
            bias: 0.0,
            gear: 1.0,
            delay_s: 0.0,
            stops: Vec::new(),
            tilt: None,
        }
    }
}
