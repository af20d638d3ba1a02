"""A free two-finger hand that is moved by a bounded force and torque on its own body, as an arm would move it."""
import mujoco
import numpy as np

from hold import Hand
from twin import BODIES, FLOOR, quaternion_of, rotation_vector

# Box of a finger as it is held apart: hand-sized, m.
HAND = Hand(gap=0.08, thick=0.008, wide=0.02, long=0.045, palm=(0.055, 0.02, 0.02))
# Mass, kg, and inertia, kg m^2, of the whole.
MASS, INERTIA = 1.5, 0.01
# Stiffness that a pose is held with, N/m and N m/rad; the most force and torque, N and N m.
STIFF, STIFF_TURN, MOST, MOST_TURN = 6000.0, 150.0, 120.0, 15.0
# Force of a finger, N: a Franka hand's lasting 70 N.
SQUEEZE = 70.0
RUBBER = [1.0, 0.02, 0.0005]


def pad(body, name, size, pos, rgba=(0.85, 0.35, 0.1, 1)):
    """A finger's box: rubber, whose friction decides, whatever it touches."""
    return body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos, friction=RUBBER, condim=4, priority=1, rgba=list(rgba),
        solref=[0.006, 1], solimp=[0.95, 0.99, 0.001, 0.5, 2], mass=0.05, contype=BODIES | FLOOR, conaffinity=BODIES | FLOOR,
    )


def couple(spec, first, second):
    """Keeps both fingers equally far from the middle."""
    tie = spec.add_equality(name="demo_couple", type=mujoco.mjtEq.mjEQ_JOINT, name1=first, name2=second)
    tie.objtype = mujoco.mjtObj.mjOBJ_JOINT
    tie.data[:5] = [0, 1, 0, 0, 0]
    tie.solref, tie.solimp = [0.005, 1], [0.95, 0.99, 0.001, 0.5, 2]


class Gripper:
    """The hand in a scene. A pose is a rotation, whose columns are closing direction, across and approach, and the
    place between the fingertips."""

    name, hand, fingers = "gripper", HAND, ("demo_left", "demo_right")
    # How far away it is filmed from, by the twin's size.
    near = 1.1

    def add(self, spec):
        h = HAND
        body = spec.worldbody.add_body(name="demo_hand", pos=[0, 0, 5])
        body.add_freejoint(name="demo_hand")
        body.gravcomp = 1
        back = -h.long - h.palm[2]
        body.mass, body.ipos, body.inertia, body.explicitinertial = MASS, [0, 0, back], [INERTIA] * 3, True
        body.add_geom(
            name="demo_palm", type=mujoco.mjtGeom.mjGEOM_BOX, size=list(h.palm), pos=[0, 0, back], mass=0, rgba=[0.2, 0.2, 0.25, 1],
            contype=BODIES | FLOOR, conaffinity=BODIES | FLOOR,
        )
        for name, side in zip(self.fingers, (1, -1)):
            finger = body.add_body(name=name)
            finger.gravcomp = 1
            finger.add_joint(
                name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[side, 0, 0], range=[0, h.gap / 2], limited=True, damping=20, armature=0.2
            )
            pad(finger, name, [h.thick / 2, h.wide / 2, h.long / 2], [side * h.thick / 2, 0, -h.long / 2])
            motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_motor()
            motor.ctrllimited, motor.ctrlrange = True, [-SQUEEZE, SQUEEZE]
        couple(spec, *self.fingers)

    def bind(self, model, front):
        self.body = model.body("demo_hand").id
        self.free = int(model.joint("demo_hand").qposadr[0])
        self.dof = int(model.joint("demo_hand").dofadr[0])
        self.back = model.body_ipos[self.body].copy()
        bodies = [self.body, *(model.body(n).id for n in self.fingers)]
        self.geoms = {g for g in range(model.ngeom) if model.geom_bodyid[g] in bodies}
        self.tips = {model.geom(n).id for n in self.fingers}

    def stances(self, poses):
        """Ways to stand for the poses: it hangs free."""
        yield None

    def take(self, data, stance):
        """Takes a stance."""

    def set(self, model, data, pose, gap):
        """Puts it at a pose, at rest."""
        rotation, tip = pose
        data.qpos[self.free : self.free + 7] = [*tip, *quaternion_of(rotation)]
        data.qvel[self.dof : self.dof + 6] = 0
        for name in self.fingers:
            data.joint(name).qpos[0], data.joint(name).qvel[0] = gap / 2, 0

    def drive(self, model, data, pose, gap):
        """Force and torque toward a pose for one step; fingers to a gap, or `None`: closed with all their force."""
        rotation, tip = pose
        now, speed = data.xmat[self.body].reshape(3, 3), np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, self.body, speed, 0)
        force = STIFF * (tip + rotation @ self.back - data.xipos[self.body]) - 2 * np.sqrt(STIFF * MASS) * speed[3:]
        torque = STIFF_TURN * rotation_vector(rotation @ now.T) - 2 * np.sqrt(STIFF_TURN * INERTIA) * speed[:3]
        force, torque = clipped(force, MOST), clipped(torque, MOST_TURN)
        data.xfrc_applied[self.body] = [*force, *torque]
        for name in self.fingers:
            x = data.joint(name)
            data.actuator(name).ctrl[0] = -SQUEEZE if gap is None else 2000 * (gap / 2 - x.qpos[0]) - 60 * x.qvel[0]

    def away(self, model, data):
        """Out of sight."""
        self.set(model, data, (np.eye(3), np.array([0.0, 0, 5])), 0.0)


def clipped(vector, most):
    length = np.linalg.norm(vector)
    return vector if length <= most else vector * (most / length)
