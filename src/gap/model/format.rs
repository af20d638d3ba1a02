//! File formats, and their numbers of a joint: effects are written into them.

/// A file format for effects.
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
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Urdf, Self::Mjcf, Self::Sdf, Self::Usd];

    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Mjcf => "mjcf",
            Self::Sdf => "sdf",
            Self::Usd => "usd",
        }
    }
}

/// Expression of an effect in a format.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// The effect.
    Native,
    /// The nearest effects of the catalogue.
    Approximated(Vec<NearestEffect>),
    /// Nothing like it.
    NotExpressible,
}

impl Expression {
    /// The effect, where `can` holds.
    #[must_use]
    pub fn native_if(can: bool) -> Self {
        if can { Self::Native } else { Self::NotExpressible }
    }
}

/// An effect in place of another.
#[derive(Clone, Debug, PartialEq)]
pub struct NearestEffect {
    /// Its name; `None` for the same effect with other parameters.
    pub effect: Option<&'static str>,
    /// Its parameters.
    pub p: Vec<f64>,
}

impl NearestEffect {
    /// Another effect.
    #[must_use]
    pub fn other_effect(name: &'static str, p: Vec<f64>) -> Self {
        Self { effect: Some(name), p }
    }

    /// The same effect with other parameters.
    #[must_use]
    pub fn same_effect(p: Vec<f64>) -> Self {
        Self { effect: None, p }
    }
}

/// A spring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spring {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// Stiffness growing with the square of the way, N m/rad^3 or N/m^3.
    pub cubic: f64,
    /// Position at rest, rad or m.
    pub rest: f64,
}

/// A stop at one end of a joint's range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// At the high end.
    pub is_upper: bool,
    /// Position, rad or m.
    pub position: f64,
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
    /// Share of the other efforts taken off.
    pub impedance: f64,
}

/// Numbers of one joint with its effects; efforts in N m or N, angles in radians. A format writes those with
/// a place in it.
#[derive(Clone, Debug, PartialEq)]
pub struct JointNumbers {
    /// Viscous damping.
    pub damping: f64,
    /// Drag by the square of the speed.
    pub drag: f64,
    /// Friction while it slides.
    pub friction: f64,
    /// Further friction of a joint at rest, until it breaks loose.
    pub breakaway_excess: f64,
    /// A spring, where there is one.
    pub spring: Option<Spring>,
    /// Inertia beside the links'.
    pub armature: f64,
    /// Position of the sensor where the joint is at 0.
    pub position_offset: f64,
    /// Constant effort.
    pub bias: f64,
    /// Factor of the effort.
    pub gear: f64,
    /// Time by which the effort acts late, seconds.
    pub delay_s: f64,
    /// Stops.
    pub stops: Vec<Stop>,
    /// Load taken off by a tilt of the joint: factors of sin q and cos q.
    pub tilt: Option<[f64; 2]>,
}

impl JointNumbers {
    /// A joint without effects.
    #[must_use]
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
