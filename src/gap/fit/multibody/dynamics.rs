//! A time step of several joints of a tree under their models.

use nalgebra::{DMatrix, DVector};

use crate::{
    fit::{
        acting::{Acting, MAX_COLUMNS, bound_at_turn},
        rollout::LEAST_INERTIA,
    },
    model::{
        effect::At,
        effect::Place,
        joint_model::{Catalogue, JointModel, Sensor, Settling},
    },
    record::carried::Carried,
    twin_tree::TwinTree,
};

/// Most sweeps over the joints to settle their friction.
const MAX_SWEEPS: usize = 50;
/// The sweeps end at this change of a velocity, as a share of the largest.
/// chosen: well above the rounding of a double.
const SETTLED: f64 = 1e-12;

/// One joint with its terms looked up once for many steps.
struct Driven<'a> {
    model: &'a JointModel,
    acting: Acting<'a>,
    sensor: Sensor,
    gain: f64,
    /// Added inertia.
    added: f64,
}

impl<'a> Driven<'a> {
    fn of_model(model: &'a JointModel, catalogue: &'a Catalogue) -> Self {
        Self {
            model,
            acting: Acting::of_model(model, catalogue),
            sensor: model.position_sensor(catalogue),
            gain: model.scalar_of(catalogue, Place::Gain).map_or(1.0, |(x, _)| x),
            added: model.scalar_of(catalogue, Place::Inertia).map_or(0.0, |(x, _)| x),
        }
    }
}

/// Joints of a tree under their models.
pub struct Dynamics<'a> {
    tree: &'a TwinTree,
    /// Index of each in the tree.
    joints: &'a [usize],
    driven: Vec<Driven<'a>>,
}

/// Inputs of a step, by joint.
pub struct Inputs<'a> {
    /// Mean signal of each joint over the step.
    pub signal: &'a [f64],
    /// Middle of the step on the common axis, seconds.
    pub time_s: f64,
    /// For each joint, the recorded positions of other moving joints.
    pub others: &'a [[f64; 8]],
}

impl<'a> Dynamics<'a> {
    /// Dynamics of models in the order of `joints`.
    pub fn of_models(
        tree: &'a TwinTree,
        joints: &'a [usize],
        models: &'a [JointModel],
        catalogue: &'a Catalogue,
    ) -> Self {
        Self { tree, joints, driven: models.iter().map(|m| Driven::of_model(m, catalogue)).collect() }
    }

    /// How the position of each joint is measured.
    pub fn sensors(&self) -> impl Iterator<Item = &Sensor> {
        self.driven.iter().map(|d| &d.sensor)
    }

    /// Advances positions and velocities by `h` seconds: half a step, the change of velocity at the middle,
    /// half a step.
    pub fn step_by(&self, q: &mut [f64], v: &mut [f64], h: f64, inputs: &Inputs) {
        let drift = |q: &mut [f64], v: &[f64]| q.iter_mut().zip(v).for_each(|(q, v)| *q += 0.5 * h * v);
        drift(q, v);
        self.kick_velocities(q, v, h, inputs);
        drift(q, v);
    }

    /// Vector over all joints of the tree holding the values `own` of these joints.
    fn tree_vector(&self, own: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.tree.joints.len()];
        self.joints.iter().zip(own).for_each(|(j, x)| all[*j] = *x);
        all
    }

    /// Mass matrix of the joints, added inertias included.
    fn joint_mass_matrix(&self, position: &[f64]) -> DMatrix<f64> {
        let n = self.joints.len();
        let zero = vec![0.0; position.len()];
        let mut mass = DMatrix::zeros(n, n);
        for (column, j) in self.joints.iter().enumerate() {
            let mut unit = zero.clone();
            unit[*j] = 1.0;
            let efforts = self.tree.inverse_dynamics(position, &zero, &unit, false);
            self.joints.iter().enumerate().for_each(|(row, i)| mass[(row, column)] = efforts[*i]);
        }
        for (i, driven) in self.driven.iter().enumerate() {
            // As for a single joint: the sum stays positive.
            let own: f64 = mass[(i, i)];
            mass[(i, i)] = (own + driven.added).max(LEAST_INERTIA * own);
        }
        mass
    }

    /// (14.7) for several joints: the step is implicit in the damping, and friction brings each joint to its
    /// settled velocity, or acts at its bound. Coriolis efforts are taken at the mean velocity from a first
    /// pass: at the velocity before the step they would add or remove energy.
    fn kick_velocities(&self, q: &[f64], v: &mut [f64], h: f64, inputs: &Inputs) {
        let position = self.tree_vector(q);
        let mass = self.joint_mass_matrix(&position);
        let mut after = v.to_vec();
        for _ in 0..2 {
            let mean: Vec<f64> = v.iter().zip(&after).map(|(a, b)| 0.5 * (a + b)).collect();
            let rest = self.tree.inverse_dynamics(
                &position,
                &self.tree_vector(&mean),
                &vec![0.0; position.len()],
                true,
            );
            after.copy_from_slice(v);
            self.kick_under_efforts(q, &mut after, h, &rest, &mass, inputs);
        }
        v.copy_from_slice(&after);
    }

    /// Changes velocities over `h` seconds; `rest` are the tree's efforts at zero acceleration.
    fn kick_under_efforts(
        &self,
        q: &[f64],
        v: &mut [f64],
        h: f64,
        rest: &[f64],
        mass: &DMatrix<f64>,
        inputs: &Inputs,
    ) {
        let n = v.len();
        let mut matrix = mass.clone();
        let mut total = DVector::zeros(n);
        let mut bound = DVector::zeros(n);
        let mut acted = Vec::with_capacity(n);
        for (i, driven) in self.driven.iter().enumerate() {
            let joint = self.joints[i];
            // Gravity and Coriolis efforts come from the whole tree.
            let carried = Carried { load: [rest[joint], 0.0, 0.0, 0.0, 0.0, 0.0], ..Carried::default() };
            let sensor = &driven.sensor;
            let own = driven.model.plant.actuator.effort_under(
                inputs.signal[i],
                q[i],
                v[i],
                (sensor.scale, sensor.bias),
            );
            let direction = if v[i] == 0.0 { 1.0 } else { v[i].signum() };
            let at = At {
                q: q[i],
                v: v[i],
                u: driven.gain * own.effort,
                feedback: [driven.gain * own.q, driven.gain * own.v],
                t: inputs.time_s,
                direction,
                others: &inputs.others[i],
                load: 0.0,
                carried: Some(&carried),
            };
            let sum = driven.acting.efforts_at(&at);
            total[i] = at.u + sum.effort;
            bound[i] = sum.friction;
            let mass: f64 = matrix[(i, i)];
            matrix[(i, i)] += (-0.5 * h * sum.v).max(-0.5 * mass);
            acted.push((own.effort, carried, direction));
        }
        let Some(inverse) = matrix.try_inverse() else { return };
        let kicks = &inverse * &total * h;
        for (i, driven) in self.driven.iter().enumerate() {
            let (effort, carried, direction) = &acted[i];
            // The joint would reverse within the step, where another bound may hold it.
            if (v[i] + kicks[i]) * direction < 0.0 {
                let at = At {
                    q: q[i],
                    v: v[i],
                    u: driven.gain * effort,
                    t: inputs.time_s,
                    direction: *direction,
                    others: &inputs.others[i],
                    carried: Some(carried),
                    ..At::default()
                };
                bound[i] = bound_at_turn(&driven.acting, &at, bound[i], &mut [0.0; MAX_COLUMNS]);
            }
        }
        self.settle_friction(v, &kicks, &inverse, &(bound * h), h);
    }

    /// Velocities after the changes `kicks` by the efforts, with friction of at most `bound`, N m s or N s,
    /// by Gauss-Seidel sweeps over the joints (Jean 1999).
    fn settle_friction(
        &self,
        v: &mut [f64],
        kicks: &DVector<f64>,
        inverse: &DMatrix<f64>,
        bound: &DVector<f64>,
        h: f64,
    ) {
        let n = v.len();
        let targets: Vec<f64> = (0..n)
            .map(|i| {
                let settling = Settling::over_step(self.driven[i].model.settle_s, h);
                settling.keep * v[i] + settling.creep * kicks[i]
            })
            .collect();
        let mut after: Vec<f64> = v.iter().zip(kicks.iter()).map(|(v, k)| v + k).collect();
        let mut taken = vec![0.0; n];
        let largest = after.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for _ in 0..MAX_SWEEPS {
            let mut moved = 0.0f64;
            for i in 0..n {
                let wanted: f64 = taken[i] + (after[i] - targets[i]) / inverse[(i, i)];
                let change = wanted.max(-bound[i]).min(bound[i]) - taken[i];
                taken[i] += change;
                for (k, after) in after.iter_mut().enumerate() {
                    *after -= inverse[(k, i)] * change;
                }
                moved = moved.max((inverse[(i, i)] * change).abs());
            }
            if moved <= SETTLED * largest {
                break;
            }
        }
        v.copy_from_slice(&after);
    }
}
