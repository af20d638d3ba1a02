"""Blind suite for `artitwin diagnose`: MuJoCo recordings of objects that hide effects, as rosbag2 MCAP bags.

Shares no code with the program. Every case is a folder with `twin.urdf` (the nominal model) and `run_*` bags; what is
hidden goes to `truth/<case>.json` beside the case folders, which only the scorer opens.

Kinds: `single`, `pair`, `null` and `outside` here; `machine` in machine.py, `servo` in servo.py, `bullet` and `drake`, which are other
simulators, in second.py; each of the four has a `_null`, too.

usage: generate.py OUT --kind KIND --seeds A:B [--objects ...] [--effects ...] [--noise ...]
"""

import argparse
import functools
import importlib
import json
import math
import zlib
from pathlib import Path

import mujoco
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STEP_S = 0.0005
RATE_HZ = 200
SUBSTEPS = round(1 / RATE_HZ / STEP_S)
TYPES = get_typestore(Stores.ROS2_JAZZY)

# name: (type, axis, origin of the mass, size of the box, range, damping, top effort, PD gains, pos in the world)
PARTS = {
    "door": dict(kind="hinge", axis=(0, 0, 1), com=(0.4, 0, 0), box=(0.8, 0.04, 2.0), mass=10.0, range=(-0.5, 2.0), damping=0.3, top=12.0, kp=60.0, kd=9.0),
    "drawer": dict(kind="slide", axis=(1, 0, 0), com=(0, 0, 0), box=(0.4, 0.4, 0.2), mass=4.0, range=(-0.2, 0.65), damping=2.0, top=25.0, kp=250.0, kd=26.0),
    "lid": dict(kind="hinge", axis=(0, -1, 0), com=(0.2, 0, 0), box=(0.4, 0.5, 0.02), mass=2.0, range=(-0.5, 1.9), damping=0.05, top=9.0, kp=14.0, kd=1.6),
}
OBJECTS = {"door": ["door"], "drawer": ["drawer"], "lid": ["lid"], "cabinet": ["door", "drawer"]}
NOISE = {"low": (1e-4, 0.003), "mid": (1e-3, 0.01), "high": (5e-3, 0.03)}
GRAVITY = 9.81


def inertia(part):
    """Box inertia about its center, kg m^2."""
    x, y, z = part["box"]
    return [part["mass"] / 12 * s for s in (y * y + z * z, x * x + z * z, x * x + y * y)]


def inertia_at_joint(part):
    if part["kind"] == "slide":
        return part["mass"]
    axis, com = np.array(part["axis"], float), np.array(part["com"])
    arm = np.linalg.norm(np.cross(axis, com))
    return float(axis**2 @ np.array(inertia(part)) + part["mass"] * arm**2)


def urdf(parts, friction=None):
    """The twin; `friction` {part: N m or N} is that of a machine."""
    text = ['<?xml version="1.0"?>', '<robot name="twin">', '  <link name="base"/>']
    for index, name in enumerate(parts):
        p = PARTS[name]
        i, vec = inertia(p), lambda v: " ".join(f"{x:g}" for x in v)
        joint = "revolute" if p["kind"] == "hinge" else "prismatic"
        text += [
            f'  <link name="{name}"><inertial><origin xyz="{vec(p["com"])}"/><mass value="{p["mass"]}"/>'
            f'<inertia ixx="{i[0]:.9g}" ixy="0" ixz="0" iyy="{i[1]:.9g}" iyz="0" izz="{i[2]:.9g}"/></inertial></link>',
            f'  <joint name="{name}_joint" type="{joint}"><parent link="base"/><child link="{name}"/><origin xyz="0 {3 * index} 0"/>'
            f'<axis xyz="{vec(p["axis"])}"/><limit lower="{p["range"][0]}" upper="{p["range"][1]}" effort="100" velocity="20"/>'
            f'<dynamics damping="{p["damping"]}" friction="{(friction or {}).get(name, 0):g}"/></joint>',
        ]
    return "\n".join(text + ["</robot>", ""])


def mjcf(parts, hidden, is_machine=False):
    """The plant; effects that MuJoCo has go in here, the others act in `Plant.step`."""
    bodies, extra = [], []
    for index, name in enumerate(parts):
        p, h = PARTS[name], hidden.get(name, {})
        vec = lambda v: " ".join(f"{x:.9g}" for x in v)
        attributes = f'damping="{p["damping"] + h.get("viscous_friction", {}).get("b", 0)}"'
        if "coulomb_friction" in h:
            attributes += f' frictionloss="{h["coulomb_friction"]["F"]}"'
        elif is_machine or any(k in h for k in ("asymmetric_friction", "local_friction", "load_dependent_friction", "stribeck_friction", "heating_friction")):
            attributes += ' frictionloss="1e-9"'
        if "inertia" in h:
            attributes += f' armature="{h["inertia"]["I"]}"'
        if "spring_return" in h:
            attributes += f' stiffness="{h["spring_return"]["k"]}" springref="{h["spring_return"]["q"]}"'
        if "end_stop" in h:
            e = h["end_stop"]
            low, high = (-9, e["q"]) if e["side"] > 0 else (e["q"], 9)
            attributes += f' limited="true" range="{low} {high}" solreflimit="{e["tc"]} {e["dr"]}"'
        tilt = ""
        if "axis_tilt" in h and p["kind"] == "hinge":
            # The whole mechanism stands tilted about an axis across the joint's.
            tilt = f' axisangle="{vec(h["axis_tilt"]["about"])} {h["axis_tilt"]["angle"]}"'
        bodies.append(
            f'<body name="{name}" pos="0 {3 * index} 0"{tilt}><joint name="{name}" type="{p["kind"]}" axis="{vec(p["axis"])}" {attributes}/>'
            f'<inertial pos="{vec(p["com"])}" mass="{p["mass"]}" diaginertia="{vec(inertia(p))}"/></body>'
        )
        if "coupling" in h:
            c = h["coupling"]
            other = next(o for o in parts if o != name)
            extra.append(
                f'<tendon><fixed name="t" stiffness="{c["k"]}" springlength="{c["rest"]}"><joint joint="{name}" coef="1"/>'
                f'<joint joint="{other}" coef="{-c["ratio"]}"/></fixed></tendon>'
            )
    return (
        f'<mujoco><compiler angle="radian" autolimits="false"/><option timestep="{STEP_S}" gravity="0 0 -{GRAVITY}" integrator="implicitfast"/>'
        f'<worldbody>{"".join(bodies)}</worldbody>{"".join(extra)}</mujoco>'
    )


def smoothstep(x):
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


class Signals:
    """What lies between a simulator's joints and a recording: delay and gain of the drive, play before the encoder, its errors. A
    simulator adds `place`, `position`, `velocity` and `hold`."""

    def __init__(self, parts, hidden):
        self.parts, self.hidden = parts, hidden
        self.queue, self.gauge = {}, {}

    def driven(self, name, u):
        """Effort that the drive gives in a step in which `u` is commanded."""
        h = self.hidden.get(name, {})
        if "delay" in h:
            queue = self.queue.setdefault(name, [u] * round(h["delay"]["d"] / STEP_S))
            queue.append(u)
            u = queue.pop(0)
        return u * h.get("torque_gain", {}).get("g", 1.0)

    def measure(self):
        """True positions as the encoders see them."""
        seen = {}
        for i, name in enumerate(self.parts):
            h, q = self.hidden.get(name, {}), self.position(i)
            if "backlash" in h:
                g = h["backlash"]["g"]
                q = min(max(self.gauge.get(name, q), q - g), q + g)
                self.gauge[name] = q
            seen[name] = q * h.get("encoder_scale", {}).get("s", 1.0) + h.get("encoder_bias", {}).get("o", 0.0)
        return seen


class Plant(Signals):
    """MuJoCo with the effects that it does not have, and the floors {part: Floor} of a machine."""

    def __init__(self, parts, hidden, run, floors=None):
        super().__init__(parts, hidden)
        self.run, self.floors = run, floors or {}
        self.model = mujoco.MjModel.from_xml_string(mjcf(parts, hidden, bool(floors)))
        for name, floor in self.floors.items():
            # What sits behind the spring loads the joint through it alone.
            self.model.dof_armature[parts.index(name)] -= floor.flexible_inertia
        self.data = mujoco.MjData(self.model)
        if self.floors:
            mujoco.mj_setConst(self.model, self.data)
        self.heat = dict.fromkeys(parts, 0.0)

    def place(self, positions):
        self.data.qpos[:] = positions

    def position(self, i):
        return self.data.qpos[i]

    def velocity(self, i):
        return self.data.qvel[i]

    def own_effort(self, name, q, v, u, t):
        """Efforts of hidden effects, and the friction bound to set (None leaves it)."""
        h, f, bound = self.hidden.get(name, {}), 0.0, None
        if "quadratic_drag" in h:
            f -= h["quadratic_drag"]["c"] * v * abs(v)
        if "constant_bias" in h:
            f += h["constant_bias"]["e"]
        if "hardening_spring" in h:
            e = h["hardening_spring"]
            f -= e["k"] * (q - e["q"]) + e["h"] * (q - e["q"]) ** 3
        if "asymmetric_friction" in h:
            e = h["asymmetric_friction"]
            bound = e["plus"] if (v if abs(v) > 1e-4 else u) > 0 else e["minus"]
        if "load_dependent_friction" in h:
            bound = h["load_dependent_friction"]["mu"] * abs(u)
        if "local_friction" in h:
            e = h["local_friction"]
            bound = max(1e-9, e["F"] * 0.5 * (1 + math.cos(math.pi * min(1.0, abs(q - e["q"]) / (1.8 * e["w"])))))
        if "stribeck_friction" in h:
            e = h["stribeck_friction"]
            bound = e["F"] + e["D"] / (1 + (v / e["vs"]) ** 2)
        if "detent" in h:
            e = h["detent"]
            x = (q - e["q"]) / (2.2 * e["w"])
            f -= e["A"] * math.sin(math.pi * x) * (0.5 + 0.5 * math.cos(math.pi * x)) * 1.54 if abs(x) < 1 else 0.0
        if "cogging" in h:
            e = h["cogging"]
            f += e["A"] * (math.sin(e["n"] * q + e["phase"]) + 0.1 * math.sin(2 * e["n"] * q))
        if "disturbance" in h and h["disturbance"]["run"] == self.run:
            e = h["disturbance"]
            x = (t - e["t"]) / e["w"]
            f += e["D"] * math.cos(0.5 * math.pi * x) ** 2 if abs(x) < 1 else 0.0
        # Outside the library.
        if "one_way_band_damper" in h:
            e = h["one_way_band_damper"]
            f -= e["b"] * v if v > 0 and e["lo"] < q < e["hi"] else 0.0
        if "sticky_band" in h:  # a magnet: pulls to the closed end only, with its own range
            e = h["sticky_band"]
            d = q - e["q"]
            f -= e["A"] / (1 + (d / e["w"]) ** 2) if d > 0 else 0.0
        if "heating_friction" in h:  # friction that wears off with the way travelled
            self.heat[name] += abs(v) * STEP_S
            e = h["heating_friction"]
            bound = e["F"] * math.exp(-self.heat[name] / e["way"])
        if "speed_limiter" in h:  # a centrifugal brake: nothing below a speed, steep above
            e = h["speed_limiter"]
            f -= e["b"] * math.copysign(max(0.0, abs(v) - e["v"]), v)
        if "staircase" in h:  # load that changes at a position: a counterweight that sets down
            e = h["staircase"]
            f += e["A"] * (smoothstep((q - e["q"]) / e["w"]) - 0.5)
        if "effort_deadband" in h:  # the drive swallows small efforts
            e = h["effort_deadband"]
            f += -u if abs(u) < e["u"] else -math.copysign(e["u"], u)
        return f, bound

    def step(self, efforts):
        d, m, before = self.data, self.model, {}
        for i, name in enumerate(self.parts):
            h = self.hidden.get(name, {})
            u = self.driven(name, efforts[name])
            # Plain numbers: sums with numpy's own take twice the time.
            q, v = float(d.qpos[i]), float(d.qvel[i])
            floor = self.floors.get(name)
            if floor:
                before[name] = (v, u)
                floor.at(q)
                u *= floor.gain()
            f, bound = self.own_effort(name, q, v, u, d.time)
            if floor:
                bound = (h.get("coulomb_friction", {}).get("F", 0.0) if bound is None else bound) + floor.friction()
                f += floor.effort()
            if bound is not None:
                m.dof_frictionloss[i] = max(bound, 1e-9)
            d.qfrc_applied[i] = u + f
        mujoco.mj_step(m, d)
        for name, (v, u) in before.items():
            self.floors[name].advance(v, float(d.qacc[self.parts.index(name)]), u, STEP_S)

    def hold(self, efforts):
        """To the next sample."""
        for _ in range(SUBSTEPS):
            self.step(efforts)


class Operator:
    """Moves a joint by PD towards changing goals: steps, slow sweeps, shakes, holds, releases."""

    def __init__(self, part, rng, duration_s, rich):
        self.part, self.rng = part, rng
        low, high = part["range"]
        self.low, self.high = low + 0.22 * (high - low), low + 0.8 * (high - low)
        self.plan, t, at = [], 0.0, rng.uniform(self.low, self.high)
        self.start = at
        while t < duration_s:
            kind = rng.choice(["step", "sweep", "shake", "release", "noise"], p=[0.3, 0.25, 0.2, 0.1, 0.15]) if rich else "sweep"
            length = rng.uniform(0.6, 1.6)
            goal = rng.uniform(self.low, self.high)
            # Some goals lie far out, so that stops are reached.
            if rng.random() < 0.2:
                goal = rng.choice([low + 0.08 * (high - low), low + 0.93 * (high - low)])
            self.plan.append((t, kind, length, at, goal, rng.uniform(1.0, 4.0), rng.uniform(0.3, 1.0)))
            t += length
            at = goal
        self.knock, self.knock_until = 0.0, -1.0

    def effort(self, t, q, v):
        entry = next(e for e in reversed(self.plan) if e[0] <= t)
        t0, kind, length, at, goal, rate, share = entry
        top, p = self.part["top"], self.part
        if kind == "release":
            return 0.0
        if kind == "noise":
            if t > self.knock_until:
                self.knock, self.knock_until = self.rng.uniform(-1, 1) * top * 0.6, t + self.rng.uniform(0.04, 0.2)
            pull = p["kp"] * (0.5 * (self.low + self.high) - q) * 0.3
            return float(np.clip(self.knock + pull - 0.2 * p["kd"] * v, -top, top))
        ref, speed = goal, 0.0
        if kind == "sweep":
            x = min(1.0, (t - t0) / length)
            ref, speed = at + (goal - at) * x, (goal - at) / length
        if kind == "shake":
            amplitude = 0.06 * share * (self.high - self.low)
            ref = at + amplitude * math.sin(2 * math.pi * rate * (t - t0))
            speed = amplitude * 2 * math.pi * rate * math.cos(2 * math.pi * rate * (t - t0))
        return float(np.clip(p["kp"] * (ref - q) + p["kd"] * (speed - v), -top, top))


def load_effort(part, q):
    """What holds the nominal part against gravity; the operator carries it."""
    if part["kind"] == "slide" or part["axis"][2]:
        return 0.0
    return GRAVITY * part["mass"] * part["com"][0] * math.cos(q)


def record(parts, hidden, rng, duration_s, noise, rich=True, run=0, floors=None, simulator=Plant):
    """One run: stamps, measured positions, recorded efforts; of a machine with the errors of its signals."""
    plant = simulator(parts, hidden, run, floors)
    operators = {n: Operator(PARTS[n], rng, duration_s, rich) for n in parts}
    plant.place([operators[n].start for n in parts])
    times, seen, efforts = [], [], []
    for k in range(round(duration_s * RATE_HZ)):
        t = k / RATE_HZ
        effort = {}
        for i, n in enumerate(parts):
            carried = load_effort(PARTS[n], plant.position(i))
            effort[n] = operators[n].effort(t, plant.position(i), plant.velocity(i)) + carried
        times.append(t)
        measured = plant.measure()
        seen.append([measured[n] for n in parts])
        efforts.append([floors[n].report(effort[n]) if floors else effort[n] for n in parts])
        plant.hold(effort)
    seen, efforts = np.array(seen), np.array(efforts)
    sigma, share = NOISE[noise] if noise else (0.0, 0.0)
    position = seen + sigma * rng.standard_normal(seen.shape)
    effort = efforts + share * np.sqrt((efforts**2).mean(0)) * rng.standard_normal(efforts.shape)
    times = np.array(times)
    for i, n in enumerate(parts if floors else []):
        position[:, i], effort[:, i] = floors[n].quantised(position[:, i], effort[:, i])
    if floors:
        times = times + floors[parts[0]].stamp_errors(rng, len(times))
    return times, position, effort


def write_bag(folder, parts, times, position, effort):
    write_joint_states(folder, [f"{n}_joint" for n in parts], times, position, effort)


def write_joint_states(folder, names, times, position, effort):
    start = 1_760_000_000_000_000_000
    Header, JointState, Time = (TYPES.types[n] for n in ("std_msgs/msg/Header", "sensor_msgs/msg/JointState", "builtin_interfaces/msg/Time"))
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", JointState.__msgtype__, typestore=TYPES)
        for t, q, u in zip(times, position, effort):
            nanos = start + round(t * 1e9)
            header = Header(stamp=Time(sec=nanos // 10**9, nanosec=nanos % 10**9), frame_id="")
            message = JointState(header=header, name=names, position=q, velocity=np.array([]), effort=u)
            writer.write(connection, nanos + 150_000, TYPES.serialize_cdr(message, JointState.__msgtype__))


def draw(effect, part, rng):
    """Parameters of a hidden effect, of a size that matters: several per cent of the usual effort."""
    hinge = part["kind"] == "hinge"
    low, high = part["range"]
    span, top = high - low, part["top"]
    at = lambda a, b: float(low + span * rng.uniform(a, b))
    effort = lambda a, b: float(top * rng.uniform(a, b))
    sign = float(rng.choice([-1, 1]))
    speed = span * 0.6
    return {
        "viscous_friction": lambda: dict(b=effort(0.06, 0.2) / speed),
        "coulomb_friction": lambda: dict(F=effort(0.03, 0.12)),
        "asymmetric_friction": lambda: dict(zip(("plus", "minus"), (effort(0.03, 0.05), effort(0.09, 0.15))[:: int(sign)])),
        "stribeck_friction": lambda: dict(F=effort(0.03, 0.07), D=effort(0.06, 0.12), vs=speed * float(rng.uniform(0.03, 0.1))),
        "quadratic_drag": lambda: dict(c=effort(0.1, 0.3) / speed**2),
        "load_dependent_friction": lambda: dict(mu=float(rng.uniform(0.1, 0.3))),
        "local_friction": lambda: dict(F=effort(0.1, 0.25), q=at(0.4, 0.6), w=span * float(rng.uniform(0.03, 0.07))),
        "spring_return": lambda: dict(k=effort(0.15, 0.4) / span, q=at(0.2, 0.6)),
        "hardening_spring": lambda: dict(k=effort(0.1, 0.2) / span, h=effort(2.0, 5.0) / span**3, q=at(0.4, 0.6)),
        "constant_bias": lambda: dict(e=sign * effort(0.03, 0.12)),
        "axis_tilt": lambda: dict(angle=float(rng.uniform(0.03, 0.09)), about=[float(np.cos(a := rng.uniform(0, 6.28))), float(np.sin(a)), 0.0] if part["axis"][2] else [0.0, 1.0, 0.0]),
        "inertia": lambda: dict(I=inertia_at_joint(part) * float(rng.uniform(0.06, 0.3))),
        "torque_gain": lambda: dict(g=1 + sign * float(rng.uniform(0.05, 0.2))),
        "backlash": lambda: dict(g=span * float(rng.uniform(0.006, 0.02))),
        "end_stop": lambda: dict(q=at(0.72, 0.8) if sign > 0 else at(0.22, 0.28), side=int(sign), tc=0.02 * float(rng.uniform(1, 2)), dr=float(rng.uniform(0.5, 1.2))),
        "detent": lambda: dict(A=effort(0.1, 0.25), q=at(0.4, 0.6), w=span * float(rng.uniform(0.02, 0.05))),
        "cogging": lambda: dict(A=effort(0.04, 0.1), n=2 * math.pi / span * float(rng.uniform(8, 25)), phase=float(rng.uniform(0, 6.28))),
        "coupling": lambda: dict(k=effort(0.2, 0.4) / span, ratio=float(rng.uniform(0.5, 1.5)) * sign, rest=0.0),
        "delay": lambda: dict(d=round(float(rng.uniform(0.01, 0.04)) / STEP_S) * STEP_S),
        "encoder_bias": lambda: dict(o=sign * float(rng.uniform(0.04, 0.12))),
        "encoder_scale": lambda: dict(s=1 + sign * float(rng.uniform(0.05, 0.15))),
        "disturbance": lambda: dict(run=int(rng.integers(0, 2)), t=float(rng.uniform(2, 8)), w=float(rng.uniform(0.1, 0.3)), D=sign * effort(0.3, 0.7)),
        "one_way_band_damper": lambda: dict(lo=at(0.3, 0.35), hi=at(0.5, 0.55), b=effort(0.3, 0.9) / speed),
        "sticky_band": lambda: dict(q=at(0.3, 0.45), A=effort(0.15, 0.4), w=span * float(rng.uniform(0.05, 0.1))),
        "heating_friction": lambda: dict(F=effort(0.15, 0.35), way=span * float(rng.uniform(2, 5))),
        "speed_limiter": lambda: dict(v=speed * float(rng.uniform(0.5, 0.8)), b=effort(0.5, 1.2) / speed),
        "staircase": lambda: dict(A=effort(0.1, 0.3), q=at(0.4, 0.55), w=span * float(rng.uniform(0.03, 0.08))),
        "effort_deadband": lambda: dict(u=effort(0.05, 0.15)),
    }[effect]()


OUTSIDE = ["one_way_band_damper", "sticky_band", "heating_friction", "speed_limiter", "staircase", "effort_deadband"]
SINGLE = [
    "viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction", "quadratic_drag", "load_dependent_friction",
    "local_friction", "spring_return", "hardening_spring", "constant_bias", "axis_tilt", "inertia", "torque_gain", "backlash",
    "end_stop", "detent", "cogging", "coupling", "delay", "encoder_bias", "encoder_scale", "disturbance",
]  # fmt: skip
SERVO = ["coulomb_friction", "stribeck_friction", "constant_bias", "spring_return", "load_dependent_friction"]
BULLET = [
    "viscous_friction", "coulomb_friction", "quadratic_drag", "spring_return", "constant_bias", "axis_tilt", "inertia", "torque_gain",
    "end_stop", "delay", "encoder_bias", "encoder_scale",
]  # fmt: skip
DRAKE = ["viscous_friction", "coulomb_friction", "spring_return", "inertia", "end_stop"]
CATALOGUES = {"single": SINGLE, "machine": SINGLE, "outside": OUTSIDE, "servo": SERVO, "bullet": BULLET, "drake": DRAKE}
KINDS = ["single", "null", "pair", "outside", *(name + end for name in ("machine", "servo", "bullet", "drake") for end in ("", "_null"))]
# Objects of the kinds, and of their nulls, that do not take all: Drake's friction is one of hinges.
OBJECTS_OF = {"servo": ["door", "drawer", "lid"], "drake": ["door", "lid"]}
PAIRS = [
    ("coulomb_friction", "detent"), ("spring_return", "end_stop"), ("inertia", "coulomb_friction"), ("viscous_friction", "delay"),
    ("stribeck_friction", "axis_tilt"), ("cogging", "constant_bias"), ("coulomb_friction", "spring_return"), ("delay", "coulomb_friction"),
    ("detent", "viscous_friction"), ("end_stop", "quadratic_drag"), ("local_friction", "constant_bias"), ("backlash", "viscous_friction"),
]  # fmt: skip


def applies(effect, obj):
    only = {"coupling": ("cabinet",), "encoder_bias": ("lid",), "axis_tilt": ("door", "lid")}
    return obj in only.get(effect, OBJECTS)


def shows_its_stop(hidden, positions):
    """Whether two runs at least touch the stop that is hidden, if one is: one that no motion touches is not there to be found."""
    stops = [effects["end_stop"] for effects in hidden.values() if "end_stop" in effects]
    touched = lambda stop: sum(np.any(stop["side"] * (position - stop["q"]) > 0) for position in positions)
    return all(touched(stop) >= 2 for stop in stops)


def write_case(out, name, obj, effects, noise, seed, runs, duration_s, simulator=Plant):
    """Without a floor; machine.py writes those with one."""
    rng = np.random.default_rng(zlib.crc32(f"{name}/{seed}".encode()))
    parts = OBJECTS[obj]
    where = str(rng.choice(parts))
    if any(not applies_to(e, where) for e in effects):
        where = parts[0]
    while True:
        hidden = {where: {e: draw(e, PARTS[where], rng) for e in effects}} if effects else {}
        recorded = [record(parts, hidden, rng, duration_s, noise, run=r, simulator=simulator) for r in range(runs)]
        if shows_its_stop(hidden, [position[:, parts.index(where)] for _, position, _ in recorded]):
            break
    folder = out / name
    folder.mkdir(parents=True)
    (folder / "twin.urdf").write_text(urdf(parts))
    for r, run in enumerate(recorded):
        write_bag(folder / f"run_{r}", parts, *run)
    truth = dict(object=obj, hidden=hidden, noise=noise, position_sigma=NOISE[noise][0], seed=seed)
    (out / "truth").mkdir(exist_ok=True)
    (out / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1))


def applies_to(effect, part):
    return not (effect == "axis_tilt" and PARTS[part]["kind"] == "slide")


def cases(kind, objects, effects, noises, seeds):
    objects = [o for o in objects if o in OBJECTS_OF.get(kind.removesuffix("_null"), objects)]
    for seed in seeds:
        for obj in objects:
            for noise in noises:
                if kind.endswith("null"):
                    yield obj, (), noise, seed
                for e in CATALOGUES.get(kind, []):
                    if (not effects or e in effects) and applies(e, obj):
                        yield obj, (e,), noise, seed
                if kind == "pair":
                    for pair in PAIRS:
                        if all(applies(e, obj) for e in pair) and (not effects or set(effects) & set(pair)):
                            yield obj, pair, noise, seed


def writer(kind):
    """What writes a case of a kind, with the arguments of `write_case`. The other files import this one."""
    family = kind.removesuffix("_null")
    if family in ("machine", "servo"):
        return importlib.import_module(family).write_case
    if family in ("bullet", "drake"):
        return functools.partial(write_case, simulator=importlib.import_module("second").SIMULATORS[family])
    return write_case


def main():
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("out", type=Path)
    a.add_argument("--kind", required=True, choices=KINDS)
    a.add_argument("--seeds", default="0:1")
    a.add_argument("--objects", nargs="*", default=list(OBJECTS))
    a.add_argument("--effects", nargs="*", default=[])
    a.add_argument("--noise", nargs="*", default=list(NOISE))
    a.add_argument("--runs", type=int, default=5)
    a.add_argument("--duration", type=float, default=10.0)
    a.add_argument("--draw", type=int, default=0, help="write this many cases, drawn evenly from the list")
    o = a.parse_args()
    write = writer(o.kind)
    first, last = (int(x) for x in o.seeds.split(":"))
    todo = list(cases(o.kind, o.objects, o.effects, o.noise, range(first, last)))
    if o.draw and o.draw < len(todo):
        todo = [todo[i * len(todo) // o.draw] for i in range(o.draw)]
    for obj, effects, noise, seed in todo:
        name = "_".join([obj, *(effects or ["nothing"]), noise, str(seed)])
        if not (o.out / "truth" / f"{name}.json").exists():
            write(o.out, name, obj, effects, noise, seed, o.runs, o.duration)
            print(name, flush=True)


if __name__ == "__main__":
    main()
