//! Dynamics of a twin's tree (recursive Newton-Euler in the world frame), and their effect on single joints.

use nalgebra::{DMatrix, Matrix3, Point3, Unit, Vector3};

use geometry::Pose;
use model::Mimic;

/// Type of a joint's motion in the dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// No motion.
    Fixed,
    /// Rotation; radians and N m.
    Turn,
    /// Translation; meters and N.
    Slide,
}

/// A link's mass properties.
#[derive(Clone, Debug)]
pub struct TwinLink {
    /// Name.
    pub name: String,
    /// Mass, kg; 0 if not given.
    pub mass_kg: f64,
    /// Center of mass, link frame, meters.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the center of mass, axes of the link frame, kg m^2.
    pub inertia: Matrix3<f64>,
    /// By how much the inertia misses that of a body, kg m^2; infinite for an incomplete tensor.
    pub inertia_excess: f64,
}

/// A joint of the twin; its frame is the child's frame.
#[derive(Clone, Debug)]
pub struct TwinJoint {
    /// Name.
    pub name: String,
    /// How it moves its child.
    pub motion: Motion,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Joint frame in the parent's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Coulomb friction, N m or N.
    pub friction: f64,
    /// Lowest and highest position, if the twin has limits.
    pub limit: Option<(f64, f64)>,
    /// The joint that it follows, if any.
    pub mimic: Option<Mimic>,
    /// Whether it floats or is planar; it is then taken as fixed.
    pub is_free: bool,
}

impl TwinJoint {
    /// Whether it moves, and not by following another joint.
    #[must_use]
    pub fn is_independent(&self) -> bool {
        self.motion != Motion::Fixed && self.mimic.is_none()
    }

    /// Pose of the child's frame at a position, relative to its frame at position 0.
    #[must_use]
    pub fn motion_to(&self, position: f64) -> Pose {
        let way = self.axis.into_inner() * position;
        match self.motion {
            Motion::Fixed => Pose::identity(),
            Motion::Turn => Pose::rotation(way),
            Motion::Slide => Pose::translation(way.x, way.y, way.z),
        }
    }
}

/// Links and joints, parents before children.
#[derive(Clone, Debug)]
pub struct TwinTree {
    /// Robot name.
    pub name: String,
    /// Links.
    pub links: Vec<TwinLink>,
    /// Joints in tree order: each after the joint carrying its parent link.
    pub joints: Vec<TwinJoint>,
    /// Index of the root link.
    pub root: usize,
    /// Gravity in the root's frame, m/s^2.
    pub gravity: Vector3<f64>,
}

/// Motion of a link in the world.
#[derive(Clone, Copy, Debug)]
struct LinkMotion {
    pose: Pose,
    /// Angular velocity.
    w: Vector3<f64>,
    /// Angular acceleration.
    dw: Vector3<f64>,
    /// Acceleration of the origin minus gravity, m/s^2.
    acc: Vector3<f64>,
}

impl TwinTree {
    /// Efforts producing the accelerations, N m or N: `M a + h(q, v)`, in the order of `joints`; 0 at fixed
    /// joints.
    #[must_use]
    pub fn inverse_dynamics(
        &self,
        position: &[f64],
        velocity: &[f64],
        acceleration: &[f64],
        with_gravity: bool,
    ) -> Vec<f64> {
        // A root accelerating upwards causes the same efforts as gravity, so no link needs a gravity term.
        let start = if with_gravity { -self.gravity } else { Vector3::zeros() };
        let rest =
            LinkMotion { pose: Pose::identity(), w: Vector3::zeros(), dw: Vector3::zeros(), acc: start };
        let mut motion = vec![rest; self.links.len()];
        // Outward pass: the motion of each link from its parent's.
        for (j, joint) in self.joints.iter().enumerate() {
            motion[joint.child] =
                step_out(&motion[joint.parent], joint, position[j], velocity[j], acceleration[j]);
        }
        // Force and moment required by each link, about the world's origin.
        let mut wrench: Vec<(Vector3<f64>, Vector3<f64>)> =
            self.links.iter().zip(&motion).map(|(l, m)| newton_euler(l, m)).collect();
        let mut effort = vec![0.0; self.joints.len()];
        // Inward pass: a joint carries its child's wrench and passes it on to the parent.
        for (j, joint) in self.joints.iter().enumerate().rev() {
            let (force, moment) = wrench[joint.child];
            let pose = &motion[joint.child].pose;
            let axis = pose.rotation * joint.axis.into_inner();
            // The moment about the hinge's own origin acts on it, not about the world's.
            effort[j] = match joint.motion {
                Motion::Fixed => 0.0,
                Motion::Turn => axis.dot(&(moment - pose.translation.vector.cross(&force))),
                Motion::Slide => axis.dot(&force),
            };
            wrench[joint.parent].0 += force;
            wrench[joint.parent].1 += moment;
        }
        effort
    }

    /// The mass matrix of the joints, kg m^2 and kg; rows of fixed joints are zero.
    #[must_use]
    pub fn mass_matrix(&self, position: &[f64]) -> DMatrix<f64> {
        let n = self.joints.len();
        let zero = vec![0.0; n];
        let mut matrix = DMatrix::zeros(n, n);
        for j in (0..n).filter(|&j| self.joints[j].motion != Motion::Fixed) {
            // At rest and without gravity, a unit acceleration of one joint requires the efforts of its
            // column.
            let mut unit = zero.clone();
            unit[j] = 1.0;
            let column = self.inverse_dynamics(position, &zero, &unit, false);
            matrix.column_mut(j).copy_from_slice(&column);
        }
        matrix
    }

    /// Efforts holding the tree against gravity, N m or N.
    #[must_use]
    pub fn gravity_effort(&self, position: &[f64]) -> Vec<f64> {
        let zero = vec![0.0; self.joints.len()];
        self.inverse_dynamics(position, &zero, &zero, true)
    }

    /// Energy of the links in the gravity field, J.
    #[must_use]
    pub fn gravity_energy(&self, position: &[f64]) -> f64 {
        let links = self.links.iter().zip(self.link_poses(position));
        links.map(|(l, pose)| -l.mass_kg * self.gravity.dot(&(pose * l.center_of_mass).coords)).sum()
    }

    /// `root_from_link` of every link, for joint positions in the order of `joints`.
    #[must_use]
    pub fn link_poses(&self, position: &[f64]) -> Vec<Pose> {
        let mut poses = vec![Pose::identity(); self.links.len()];
        for (joint, q) in self.joints.iter().zip(position) {
            poses[joint.child] = poses[joint.parent] * joint.parent_from_joint * joint.motion_to(*q);
        }
        poses
    }

    /// Effort at a joint, N m or N, from a force and a moment about the joint's origin, in root axes; `poses`
    /// are the links' poses.
    #[must_use]
    pub fn effort_of(
        &self,
        joint: usize,
        poses: &[Pose],
        force: &Vector3<f64>,
        moment: &Vector3<f64>,
    ) -> f64 {
        let joint = &self.joints[joint];
        let axis = poses[joint.child].rotation * joint.axis.into_inner();
        match joint.motion {
            Motion::Fixed => 0.0,
            Motion::Turn => axis.dot(moment),
            Motion::Slide => axis.dot(force),
        }
    }

    /// The link to which a link is fixed: the nearest one moved by a joint, or the root.
    #[must_use]
    pub fn carrying_link(&self, link: usize) -> usize {
        let fixed = self.joints.iter().find(|j| j.child == link && j.motion == Motion::Fixed);
        fixed.map_or(link, |j| self.carrying_link(j.parent))
    }

    /// Whether a link is moved by a joint.
    #[must_use]
    pub fn carries(&self, joint: usize, link: usize) -> bool {
        let above = self.joints.iter().position(|j| j.child == link);
        above.is_some_and(|j| {
            (j == joint && self.joints[j].motion != Motion::Fixed)
                || self.carries(joint, self.joints[j].parent)
        })
    }

    /// The other moving joints between a joint and the root, or beyond the joint.
    #[must_use]
    pub fn chain_joints(&self, joint: usize) -> Vec<usize> {
        let moving = (0..self.joints.len()).filter(|&k| self.joints[k].motion != Motion::Fixed);
        moving.filter(|&k| k != joint && (self.is_above(k, joint) || self.is_above(joint, k))).collect()
    }

    /// Whether joint `follower` follows joint `leader`, perhaps by way of others.
    #[must_use]
    pub fn follows(&self, follower: usize, leader: usize) -> bool {
        let mut at = follower;
        // No more steps than joints: a ring of followers has no leader.
        for _ in 0..self.joints.len() {
            let Some(mimic) = &self.joints[at].mimic else { return false };
            let Some(next) = self.joints.iter().position(|j| j.name == mimic.joint) else { return false };
            if next == leader {
                return true;
            }
            at = next;
        }
        false
    }

    /// Whether joint `upper` lies between the root and joint `lower`.
    fn is_above(&self, upper: usize, lower: usize) -> bool {
        let mut link = self.joints[lower].parent;
        while let Some(j) = self.joints.iter().position(|j| j.child == link) {
            if j == upper {
                return true;
            }
            link = self.joints[j].parent;
        }
        false
    }
}

fn step_out(parent: &LinkMotion, joint: &TwinJoint, q: f64, v: f64, a: f64) -> LinkMotion {
    let frame = parent.pose * joint.parent_from_joint;
    let axis = frame.rotation * joint.axis.into_inner();
    let pose = frame * joint.motion_to(q);
    let arm = pose.translation.vector - parent.pose.translation.vector;
    let w = parent.w;
    let dw = parent.dw;
    // Tangential and centripetal acceleration of the child's origin moving with the parent.
    let carried = parent.acc + dw.cross(&arm) + w.cross(&w.cross(&arm));
    match joint.motion {
        Motion::Fixed => LinkMotion { pose, w, dw, acc: carried },
        Motion::Turn => {
            LinkMotion { pose, w: w + axis * v, dw: dw + axis * a + w.cross(&(axis * v)), acc: carried }
        }
        // The direction of a slide rotates with the parent: Coriolis acceleration.
        Motion::Slide => LinkMotion { pose, w, dw, acc: carried + axis * a + 2.0 * w.cross(&(axis * v)) },
    }
}

fn newton_euler(link: &TwinLink, motion: &LinkMotion) -> (Vector3<f64>, Vector3<f64>) {
    let arm = motion.pose.rotation * link.center_of_mass.coords;
    let acc = motion.acc + motion.dw.cross(&arm) + motion.w.cross(&motion.w.cross(&arm));
    let force = acc * link.mass_kg;
    let r = motion.pose.rotation.to_rotation_matrix();
    let inertia = r.matrix() * link.inertia * r.matrix().transpose();
    // Euler's equation, moved to the world's origin, where the links' wrenches are summed.
    let spin = inertia * motion.dw + motion.w.cross(&(inertia * motion.w));
    (force, spin + (motion.pose.translation.vector + arm).cross(&force))
}
