"""Other simulators than MuJoCo for the blind suite: PyBullet and Drake, which read the object from a URDF of their own.

Friction is theirs. PyBullet's is a motor of target speed zero with a bounded impulse: a constraint that holds a joint to the last
digit. Drake's is a `DoorHinge`: a smooth law of the speed, under which a joint creeps and never sticks. Neither is MuJoCo's
constraint, which gives way. Stops are theirs as well, stiffer than any of MuJoCo's. Motors, encoders, goals and bags are generate.py's.
"""

import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import generate
import numpy as np
import pybullet
from generate import GRAVITY, PARTS, STEP_S, SUBSTEPS
from pybullet_utils.bullet_client import BulletClient
from scipy.spatial.transform import Rotation

# Where a joint has no stop, rad or m: further than any motion goes.
FAR = 100.0


def plant_urdf(parts, hidden):
    """The twin with what is hidden in its numbers: damping, mass, how it stands, stops."""
    robot = ElementTree.fromstring(generate.urdf(parts))
    links = {link.get("name"): link for link in robot.iter("link")}
    # Without one PyBullet warns; the base is fixed.
    base = ElementTree.SubElement(links["base"], "inertial")
    ElementTree.SubElement(base, "mass", value="1")
    ElementTree.SubElement(base, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    for joint in robot.iter("joint"):
        name = joint.get("name").removesuffix("_joint")
        part, h = PARTS[name], hidden.get(name, {})
        joint.find("dynamics").set("damping", str(part["damping"] + h.get("viscous_friction", {}).get("b", 0.0)))
        low, high = -FAR, FAR
        if "end_stop" in h:
            stop = h["end_stop"]
            low, high = (low, stop["q"]) if stop["side"] > 0 else (stop["q"], high)
        joint.find("limit").set("lower", str(low))
        joint.find("limit").set("upper", str(high))
        if "axis_tilt" in h:
            turn = Rotation.from_rotvec(h["axis_tilt"]["angle"] * np.array(h["axis_tilt"]["about"]))
            joint.find("origin").set("rpy", " ".join(map(str, turn.as_euler("xyz"))))
        if "inertia" in h:
            add_inertia(links[name], part, h["inertia"]["I"])
    return ElementTree.tostring(robot, encoding="unicode")


def add_inertia(link, part, added):
    """Of a slide mass, of a hinge inertia about its axis alone, so that gravity's load stays."""
    if part["kind"] == "slide":
        link.find("inertial/mass").set("value", str(part["mass"] + added))
        return
    inertia = link.find("inertial/inertia")
    for key, along in zip(("ixx", "iyy", "izz"), part["axis"]):
        inertia.set(key, str(float(inertia.get(key)) + added * along**2))


class Bullet(generate.Signals):
    """PyBullet: reduced coordinates, constraints solved by sequential impulses."""

    def __init__(self, parts, hidden, run, floors=None):
        super().__init__(parts, hidden)
        self.world = BulletClient(pybullet.DIRECT)
        self.world.setGravity(0, 0, -GRAVITY)
        self.world.setTimeStep(STEP_S)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "plant.urdf"
            file.write_text(plant_urdf(parts, hidden))
            self.body = self.world.loadURDF(str(file), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        self.joints = list(range(len(parts)))
        for i, name in enumerate(parts):
            # The library's own damping of every link is 0.04.
            self.world.changeDynamics(self.body, i, linearDamping=0, angularDamping=0)
            friction = hidden.get(name, {}).get("coulomb_friction", {}).get("F", 0.0)
            self.world.setJointMotorControl2(self.body, i, pybullet.VELOCITY_CONTROL, targetVelocity=0, force=friction)

    def place(self, positions):
        for i, q in zip(self.joints, positions):
            self.world.resetJointState(self.body, i, q, 0.0)

    def position(self, i):
        return self.world.getJointState(self.body, i)[0]

    def velocity(self, i):
        return self.world.getJointState(self.body, i)[1]

    def hold(self, efforts):
        for _ in range(SUBSTEPS):
            for i, name in enumerate(self.parts):
                q, v = self.world.getJointState(self.body, i)[:2]
                own = self.driven(name, efforts[name]) + smooth_effort(self.hidden.get(name, {}), q, v)
                self.world.setJointMotorControl2(self.body, i, pybullet.TORQUE_CONTROL, force=own)
            self.world.stepSimulation()


def smooth_effort(h, q, v):
    """Springs, a bias, drag: PyBullet has none for a joint."""
    spring, drag = h.get("spring_return"), h.get("quadratic_drag")
    effort = h.get("constant_bias", {}).get("e", 0.0)
    if spring:
        effort -= spring["k"] * (q - spring["q"])
    if drag:
        effort -= drag["c"] * v * abs(v)
    return effort


class Drake(generate.Signals):
    """Drake's multibody plant in discrete time: springs and hinges are its force elements."""

    def __init__(self, parts, hidden, run, floors=None):
        # Imported here: it takes a second, which cases of other kinds need not wait.
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.systems.analysis import Simulator

        super().__init__(parts, hidden)
        self.plant = MultibodyPlant(STEP_S)
        Parser(self.plant).AddModelsFromString(plant_urdf(parts, hidden), "urdf")
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("base"))
        for name in parts:
            joint = self.plant.GetJointByName(f"{name}_joint")
            self.plant.AddJointActuator(name, joint)
            self.add_elements(joint, hidden.get(name, {}))
        self.plant.Finalize()
        self.simulator = Simulator(self.plant)
        self.simulator.Initialize()
        self.context = self.simulator.get_mutable_context()
        self.samples = 0

    def add_elements(self, joint, h):
        from pydrake.multibody.tree import DoorHinge, DoorHingeConfig, RevoluteSpring

        if "spring_return" in h:
            self.plant.AddForceElement(RevoluteSpring(joint, h["spring_return"]["q"], h["spring_return"]["k"]))
        if "coulomb_friction" in h:
            law = DoorHingeConfig()
            law.dynamic_friction_torque = h["coulomb_friction"]["F"]
            law.spring_zero_angle_rad = law.spring_constant = law.static_friction_torque = law.viscous_friction = law.catch_torque = 0.0
            self.plant.AddForceElement(DoorHinge(joint, law))

    def place(self, positions):
        self.plant.SetPositions(self.context, positions)

    def position(self, i):
        return self.plant.GetPositions(self.context)[i]

    def velocity(self, i):
        return self.plant.GetVelocities(self.context)[i]

    def hold(self, efforts):
        self.plant.get_actuation_input_port().FixValue(self.context, [self.driven(name, efforts[name]) for name in self.parts])
        self.samples += 1
        self.simulator.AdvanceTo(self.samples / generate.RATE_HZ)


SIMULATORS = {"bullet": Bullet, "drake": Drake}
