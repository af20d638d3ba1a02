//! The catalogue: one file per effect. To add one, write its file and add a line here.

mod asymmetric_friction;
mod axis_tilt;
mod backlash;
mod cogging;
mod constant_bias;
mod coulomb_friction;
mod coupling;
mod delay;
mod detent;
mod disturbance;
mod encoder_bias;
mod encoder_scale;
pub mod end_stop;
mod hardening_spring;
mod inertia;
mod load_dependent_friction;
mod local_friction;
mod quadratic_drag;
mod spring_return;
mod stribeck_friction;
mod torque_gain;
mod viscous_friction;

use super::effect::Effect;

/// All effects searched at a joint recorded with `others` other moving joints.
pub fn catalogue(others: usize) -> Vec<Box<dyn Effect>> {
    let mut effects: Vec<Box<dyn Effect>> = vec![
        Box::new(coulomb_friction::CoulombFriction),
        Box::new(viscous_friction::ViscousFriction),
        Box::new(constant_bias::ConstantBias),
        Box::new(inertia::Inertia),
        Box::new(torque_gain::TorqueGain),
        Box::new(encoder_scale::EncoderScale),
        Box::new(encoder_bias::EncoderBias),
        Box::new(delay::Delay),
        Box::new(quadratic_drag::QuadraticDrag),
        Box::new(load_dependent_friction::LoadDependentFriction),
        Box::new(spring_return::SpringReturn),
        Box::new(axis_tilt::AxisTilt),
        Box::new(asymmetric_friction::AsymmetricFriction),
        Box::new(stribeck_friction::StribeckFriction),
        Box::new(hardening_spring::HardeningSpring),
        Box::new(local_friction::LocalFriction),
        Box::new(detent::Detent),
        Box::new(backlash::Backlash),
        Box::new(cogging::Cogging),
        Box::new(disturbance::Disturbance),
        Box::new(end_stop::EndStop { upper: true }),
        Box::new(end_stop::EndStop { upper: false }),
    ];
    effects.extend((0..others).map(|other| Box::new(coupling::Coupling { other }) as Box<dyn Effect>));
    effects
}
