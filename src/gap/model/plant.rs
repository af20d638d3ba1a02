//! One joint of the twin as a single degree of freedom: its inertia and the efforts on it.

use super::actuator::Actuator;
use crate::{
    record::carried::Carried,
    trig::sin_cos,
    twin_tree::{Motion, TwinTree},
};

/// `inertia * acceleration = effort - damping * velocity - friction * Sgn(velocity) - load(position)`.
/// See docs/method.md (14.3).
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    /// Inertia, kg m^2 or kg.
    pub inertia: f64,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Coulomb friction, N m or N.
    pub friction: f64,
    /// Gravity load `constant + sine * sin(q) + cosine * cos(q)`, N m or N.
    pub load: Load,
    /// Amplitude of the load with a horizontal axis: the largest gravity load at any tilt, N m or N.
    pub most_load: f64,
    /// The path from the recorded signal to the effort.
    pub actuator: Actuator,
}

/// A load depending on position, N m or N.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Constant part.
    pub constant: f64,
    /// Factor of sin(q).
    pub sine: f64,
    /// Factor of cos(q).
    pub cosine: f64,
}

impl Load {
    /// Load and its slope at a position.
    pub fn load_and_slope(&self, position: f64) -> (f64, f64) {
        // Sliding joints and upright hinges; rollouts spend most of their time in sine and cosine.
        if self.sine == 0.0 && self.cosine == 0.0 {
            return (self.constant, 0.0);
        }
        let (s, c) = sin_cos(position);
        (self.constant + self.sine * s + self.cosine * c, self.sine * c - self.cosine * s)
    }

    /// Largest load at any position.
    pub fn amplitude(&self) -> f64 {
        self.constant.abs() + self.sine.hypot(self.cosine)
    }
}

/// Least credible relative change of a gain, a scale or an inertia.
/// chosen: a smaller one may be a discretization error.
pub const LEAST_CHANGE: f64 = 0.004;

/// Why a joint cannot be modelled this way.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// No mass moves with the joint.
    #[error("joint '{0}' moves no mass: give the links below it an <inertial> with mass and inertia")]
    NoMass(String),
    /// Its effort also moves a joint that follows it.
    #[error(
        "joint '{0}' moves '{1}' along (<mimic>), which has no place in its equation; such a joint is not \
         diagnosed"
    )]
    Coupled(String, String),
    /// A link that it moves has an inertia that no body has.
    #[error(
        "joint '{joint}' moves link '{link}', whose inertia no body can have: correct the <inertia> of that \
         link"
    )]
    NoBody {
        /// The joint.
        joint: String,
        /// The link.
        link: String,
    },
    /// A number of the twin is not usable.
    #[error("joint '{0}': damping and friction must be finite and not negative")]
    BadDynamics(String),
}

impl Plant {
    /// Load and its slope at a position; in a chain, with the motion of the others.
    pub fn load_at(&self, carried: Option<&Carried>, position: f64) -> (f64, f64) {
        carried.map_or_else(|| self.load.load_and_slope(position), |c| c.load_and_slope(position))
    }

    /// Inertia and its rate of change.
    pub fn inertia_at(&self, carried: Option<&Carried>) -> (f64, f64) {
        carried.map_or((self.inertia, 0.0), |c| (c.inertia, c.inertia_rate))
    }

    /// An effort minus damping and load at a state, N m or N, without friction.
    pub fn net_effort(&self, carried: Option<&Carried>, position: f64, velocity: f64, effort: f64) -> f64 {
        // A change of inertia due to the motion of a chain acts as damping.
        let rate = self.inertia_at(carried).1;
        effort - (self.damping + rate) * velocity - self.load_at(carried, position).0
    }

    /// The plant of the joint with this index in `tree.joints`; in a chain, with the others at 0.
    ///
    /// # Errors
    /// [`PlantError`] if the joint moves no mass or an impossible one, is followed by another joint of its
    /// chain, or its dynamics are not finite.
    pub fn of_joint(tree: &TwinTree, joint: usize) -> Result<Self, PlantError> {
        let spec = &tree.joints[joint];
        let chain = tree.chain_joints(joint);
        if let Some(follower) = chain.iter().find(|&&j| tree.follows(j, joint)) {
            return Err(PlantError::Coupled(spec.name.clone(), tree.joints[*follower].name.clone()));
        }
        if ![spec.damping, spec.friction].iter().all(|x| x.is_finite() && *x >= 0.0) {
            return Err(PlantError::BadDynamics(spec.name.clone()));
        }
        let position = vec![0.0; tree.joints.len()];
        let inertia = tree.mass_matrix(&position)[(joint, joint)];
        // Negated, so a NaN inertia is refused as well.
        if !(inertia > 1e-12) {
            return Err(PlantError::NoMass(spec.name.clone()));
        }
        // A slide does not turn the inertias that it moves.
        let mut moved = (0..tree.links.len()).filter(|&l| tree.carries(joint, l));
        let matters = |l: &usize| tree.links[*l].inertia_excess > LEAST_CHANGE * inertia;
        if let Some(link) = moved.find(matters).filter(|_| spec.motion == Motion::Turn) {
            let link = tree.links[link].name.clone();
            return Err(PlantError::NoBody { joint: spec.name.clone(), link });
        }
        let load = gravity_load(tree, joint);
        // Along three axes the squared amplitudes of a revolute joint's load add up to twice that with a
        // horizontal axis.
        let mut along = tree.clone();
        let squares = (0..3).map(|axis| {
            along.gravity = nalgebra::Vector3::zeros();
            along.gravity[axis] = tree.gravity.norm();
            let load = self::gravity_load(&along, joint);
            load.sine.powi(2) + load.cosine.powi(2)
        });
        let most_load = (0.5 * squares.sum::<f64>()).sqrt();
        Ok(Self {
            inertia,
            damping: spec.damping,
            friction: spec.friction,
            load,
            most_load,
            actuator: Actuator::default(),
        })
    }
}

/// Gravity load of a joint, the others at 0.
fn gravity_load(tree: &TwinTree, joint: usize) -> Load {
    match tree.joints[joint].motion {
        Motion::Turn => {
            let quarter = std::f64::consts::FRAC_PI_2;
            // Three positions determine a constant, a sine and a cosine (14.3).
            let a = gravity_effort_at(tree, joint, 0.0);
            let b = gravity_effort_at(tree, joint, quarter);
            let c = gravity_effort_at(tree, joint, 2.0 * quarter);
            let constant = 0.5 * (a + c);
            Load {
                constant: without_rounding(constant),
                sine: without_rounding(b - constant),
                cosine: without_rounding(a - constant),
            }
        }
        // On a straight axis gravity is the same at every position.
        Motion::Slide | Motion::Fixed => {
            Load { constant: without_rounding(gravity_effort_at(tree, joint, 0.0)), sine: 0.0, cosine: 0.0 }
        }
    }
}

/// Gravity effort on a joint at a position, the others at 0, N m or N.
fn gravity_effort_at(tree: &TwinTree, joint: usize, q: f64) -> f64 {
    let mut position = vec![0.0; tree.joints.len()];
    position[joint] = q;
    tree.gravity_effort(&position)[joint]
}

/// Sets a load within rounding errors to zero.
fn without_rounding(x: f64) -> f64 {
    if x.abs() < 1e-9 { 0.0 } else { x }
}
