"""A Franka Panda on a stand that is set up anew for every hold: the model of the package dm-robotics-panda (Apache-2.0)."""
import importlib.metadata

import mujoco
import numpy as np

from gripper import couple, pad
from hold import Hand
from twin import BODIES, FLOOR, Refused, quaternion_of, rotation_vector

# The hand's fingers, m; the box stands for the part of a finger that holds.
HAND = Hand(gap=0.08, thick=0.012, wide=0.02, long=0.044, palm=(0.1, 0.03, 0.03))
# Hand frame to the place between the fingertips, m.
TIP = 0.1034
# Stiffness (N m/rad) and damping of the joints as Franka's joint impedance has them, torque limits of its data sheet, N m.
STIFF = [600, 600, 600, 600, 250, 150, 50]
DAMP = [50, 50, 50, 50, 30, 25, 15]
TORQUE = [87, 87, 87, 87, 12, 12, 12]
SQUEEZE = 70.0
HOME = np.array([0, -0.3, 0, -2.2, 0, 2.0, np.pi / 4])
# Where the stand is tried, about the middle of the way: distances and heights of the arm's foot below it, m.
DISTANCES, HEIGHTS = (0.5, 0.4, 0.6), (0.3, 0.1, 0.5, -0.1)
STANCES = 3


def assets():
    try:
        files = importlib.metadata.files("dm-robotics-panda") or []
    except importlib.metadata.PackageNotFoundError:
        raise Refused("this Python has no model of the arm: pip install --no-deps dm-robotics-panda") from None
    found = {f.name: str(f.locate()) for f in files if f.name in ("panda.xml", "panda_hand.xml")}
    if len(found) != 2:
        raise Refused("dm-robotics-panda holds no panda.xml and panda_hand.xml: install version 0.4.8")
    return found["panda.xml"], found["panda_hand.xml"]


def arm_spec():
    """Arm and hand, without sensors and drives."""
    arm, hand = (mujoco.MjSpec.from_file(path) for path in assets())
    for spec in (arm, hand):
        for thing in [*spec.sensors, *spec.actuators, *spec.tendons, *spec.equalities]:
            spec.delete(thing)
    for geom in list(hand.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_BOX:
            hand.delete(geom)
    for joint in arm.joints:
        joint.damping = np.maximum(joint.damping, 0)
    turn = [np.cos(np.pi / 8), 0, 0, -np.sin(np.pi / 8)]
    arm.attach(hand, frame=arm.body("panda_link8").add_frame(quat=turn), prefix="hand_")
    for name in ("hand_panda_leftfinger", "hand_panda_rightfinger"):
        h = HAND
        pad(arm.body(name), name, [h.wide / 2, h.thick / 2, h.long / 2], [0, h.thick / 2, h.long / 2 + 0.001], rgba=(0.85, 0.35, 0.1, 1))
    return arm


class Panda:
    """The arm in a scene; poses as those of the free gripper."""

    name, hand, near = "panda", HAND, 1.8
    fingers = ("demo_arm_hand_panda_finger_joint1", "demo_arm_hand_panda_finger_joint2")

    def __init__(self):
        self.alone = arm_spec().compile()
        self.data = mujoco.MjData(self.alone)
        self.hand_body = self.alone.body("hand_panda_hand").id
        self.low, self.high = self.alone.jnt_range[:7].T
        self.goal = HOME.copy()

    def add(self, spec):
        stand = spec.worldbody.add_body(name="demo_arm_stand", mocap=True, pos=[0, 0, -20])
        stand.add_geom(
            name="demo_arm_stand", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.08, 0.08, 2], pos=[0, 0, -2], rgba=[0.3, 0.32, 0.35, 1],
            contype=BODIES, conaffinity=BODIES,
        )
        spec.attach(arm_spec(), frame=stand.add_frame(), prefix="demo_arm_")
        for k in range(7):
            name = f"demo_arm_panda_joint{k + 1}"
            drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            drive.set_to_position(kp=STIFF[k], kv=DAMP[k])
            drive.forcelimited, drive.forcerange = True, [-TORQUE[k], TORQUE[k]]
        for name in self.fingers:
            motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_motor()
            motor.ctrllimited, motor.ctrlrange = True, [-SQUEEZE, SQUEEZE]
        couple(spec, *self.fingers)

    def bind(self, model, front):
        self.front = front[:2]
        bodies = {b for b in range(model.nbody) if model.body(b).name.startswith("demo_arm_")}
        self.geoms = {g for g in range(model.ngeom) if model.geom_bodyid[g] in bodies}
        for g in self.geoms:
            if model.geom(g).name != "demo_arm_stand" and model.geom_contype[g]:
                model.geom_contype[g] = model.geom_conaffinity[g] = BODIES | FLOOR
        self.tips = {model.geom(f"demo_arm_hand_panda_{side}finger").id for side in ("left", "right")}
        self.joints = [f"demo_arm_panda_joint{k + 1}" for k in range(7)]
        self.floor = float(model.geom("demo_floor").pos[2])

    def stances(self, poses):
        """Places of the stand from which the arm takes all poses, one after the other: place, turn, positions."""
        middle = np.mean([tip for _, tip in poses], axis=0)
        back = -np.mean([r[:, 2] for r, _ in poses], axis=0)[:2]
        if np.linalg.norm(back) < 0.3:
            back = self.front
        heading, found = np.arctan2(back[1], back[0]), 0
        for away in np.radians([0, 35, -35, 70, -70, 110, -110, 180]):
            for distance in DISTANCES:
                for height in HEIGHTS:
                    a = heading + away
                    foot = middle + [distance * np.cos(a), distance * np.sin(a), -height]
                    foot[2] = max(foot[2], self.floor)
                    turn = a + np.pi
                    positions = self._all(poses, foot, turn)
                    if positions is not None:
                        yield foot, turn, list(zip(poses, positions))
                        found += 1
                        if found == STANCES:
                            return

    def _all(self, poses, foot, turn):
        q, found = HOME.copy(), []
        for k, pose in enumerate(poses):
            reached = self._solve(q, self._local(pose, foot, turn), 60 if k == 0 else 25)
            if reached is None or (k and np.abs(reached - q).max() > 0.9):
                return None
            q = reached
            found.append(q)
        return found

    @staticmethod
    def _local(pose, foot, turn):
        c, s = np.cos(turn), np.sin(turn)
        world = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return world.T @ pose[0], world.T @ (pose[1] - foot)

    def _step(self, q, pose):
        """One step of damped least squares toward a pose of the tip in the arm's frame: positions, error."""
        rotation, tip = pose
        data = self.data
        data.qpos[:7] = q
        mujoco.mj_kinematics(self.alone, data)
        mujoco.mj_comPos(self.alone, data)
        hand = data.xmat[self.hand_body].reshape(3, 3)
        # The hand closes along its y.
        now = np.stack([hand[:, 1], -hand[:, 0], hand[:, 2]], 1)
        place = data.xpos[self.hand_body] + TIP * hand[:, 2]
        error = np.concatenate([tip - place, rotation_vector(rotation @ now.T)])
        jacobian = np.zeros((6, self.alone.nv))
        mujoco.mj_jac(self.alone, data, jacobian[:3], jacobian[3:], place, self.hand_body)
        j = jacobian[:, :7]
        inner = np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), np.column_stack([error, j]))
        rest = 0.05 * (HOME - q)
        step = j.T @ inner[:, 0] + rest - j.T @ (inner[:, 1:] @ rest)
        return np.clip(q + np.clip(step, -0.3, 0.3), self.low + 0.02, self.high - 0.02), error

    def _solve(self, q, pose, most):
        if np.linalg.norm(pose[1] - [0, 0, 0.333]) > 0.9:
            return None
        for _ in range(most):
            q, error = self._step(q, pose)
            if np.linalg.norm(error[:3]) < 0.0015 and np.linalg.norm(error[3:]) < 0.01:
                return q
        return None

    def take(self, data, stance):
        self.foot, self.turned, self.known = stance
        data.mocap_pos[0] = self.foot
        data.mocap_quat[0] = [np.cos(self.turned / 2), 0, 0, np.sin(self.turned / 2)]

    def set(self, model, data, pose, gap):
        """Puts the hand at one of the poses that the stance was found for, at rest."""
        apart = [np.linalg.norm(p[1] - pose[1]) + np.abs(p[0] - pose[0]).max() for p, _ in self.known]
        self.goal = self.known[int(np.argmin(apart))][1].copy()
        for name, q in zip(self.joints, self.goal):
            data.joint(name).qpos[0], data.joint(name).qvel[0] = q, 0
        for name in self.fingers:
            data.joint(name).qpos[0], data.joint(name).qvel[0] = gap / 2, 0

    def drive(self, model, data, pose, gap):
        """Goals of the joints for one step; fingers to a gap, or `None`: closed with all their force."""
        self.goal, _ = self._step(self.goal, self._local(pose, self.foot, self.turned))
        for name, q in zip(self.joints, self.goal):
            data.actuator(name).ctrl[0] = q
        for name in self.fingers:
            x = data.joint(name)
            data.actuator(name).ctrl[0] = -SQUEEZE if gap is None else 2000 * (gap / 2 - x.qpos[0]) - 60 * x.qvel[0]

    def away(self, model, data):
        """It stays where it is; before its first hold it is out of sight."""
