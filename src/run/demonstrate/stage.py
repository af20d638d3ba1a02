"""The world of a demonstration: the twin, a floor, a ball, a robot; and what happens in it."""
import mujoco
import numpy as np

from hold import APPROACH, Scene, candidates, near
from twin import BODIES, FLOOR, below, moved, place, solids, vertices

# Speed of the fingertips along the way, m/s; shortest time for it, s.
SPEED, SHORTEST = 0.15, 1.0
# How far beyond an end the hand goes, m, so that the joint's own limit stops it.
BEYOND = 0.006
# Depth to which fingertips press into a face that they push, m.
PRESS = 0.002
# Seconds between pictures of the motion.
PICTURE_S = 0.08
# Poses along a way at which the hand's room is checked.
CHECKS = 9
# Share of a way that is enough: no other hold is tried then.
ENOUGH = 0.95
# Most holds one after the other in one motion; shares of what is left of it that a hold is looked for; least share of
# a motion that makes another hold worth while.
LEGS, REACHES, HEADWAY = 4, (1.0, 0.5, 0.25), 0.05
# Penetration that counts as being in the way, m.
TOUCH = 0.0005
# Height over which a ball is dropped, m; density of the ball, kg/m^3: wood.
DROP, WOOD = 0.01, 700.0


def build(spec, robot, radius, front):
    """Adds floor, ball (radius in m) and robot to a twin, and the solver settings that hold a grasp."""
    bare = spec.copy().compile()
    data = mujoco.MjData(bare)
    mujoco.mj_forward(bare, data)
    points = np.concatenate([vertices(bare, data, g) for b in range(bare.nbody) for g in solids(bare, b)])
    low, high = points.min(0), points.max(0)
    size = float(np.linalg.norm(high - low))
    option = spec.option
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10
    option.noslip_iterations = 3
    look = spec.visual
    look.global_.offwidth, look.global_.offheight = 960, 720
    look.quality.shadowsize = 2048
    spec.stat.extent, spec.stat.center = size, list((low + high) / 2)
    spec.add_texture(
        name="demo_sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.75, 0.8, 0.85], rgb2=[0.95, 0.95, 0.97], width=64, height=384,
    )
    world = spec.worldbody
    world.add_light(pos=[low[0], low[1], high[2] + 2 * size], dir=[0.3, 0.3, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.35] * 3, castshadow=False)
    floor = world.add_geom(name="demo_floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, low[2] - 0.001])
    floor.rgba, floor.contype, floor.conaffinity = [0.55, 0.56, 0.58, 1], FLOOR, FLOOR
    ball = world.add_body(name="demo_ball", pos=[0, 0, high[2] + 10])
    ball.add_freejoint(name="demo_ball")
    ball.gravcomp = 1
    # It rolls: contacts resist turning.
    ball.add_geom(
        name="demo_ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], density=WOOD, condim=6, friction=[0.6, 0.005, 0.0005],
        rgba=[0.8, 0.1, 0.1, 1], contype=BODIES | FLOOR, conaffinity=BODIES | FLOOR,
    )
    robot.add(spec)
    model = spec.compile()
    robot.bind(model, front)
    return model


class Stage:
    """The running world. `pictures` are positions of all joints and of what is put in place, PICTURE_S apart; `scene` is
    the part that is to be moved, as the last search for holds saw it."""

    def __init__(self, model, joints, robot):
        self.model, self.joints, self.robot = model, joints, robot
        self.data = mujoco.MjData(model)
        self.pictures, self.force = [], 0.0
        self.every = max(1, round(PICTURE_S / model.opt.timestep))
        self.steps = 0
        place(model, self.data, {j.name: j.closed for j in joints})
        robot.away(model, self.data)
        self.pose, self.gap = None, 0.0

    def position(self, joint):
        return float(self.data.joint(joint.name).qpos[0])

    def share(self, joint):
        return joint.share(self.position(joint))

    def kept(self):
        data = mujoco.MjData(self.model)
        mujoco.mj_copyData(data, self.model, self.data)
        return data, list(self.pictures), self.steps, self.pose, self.gap

    def back(self, kept):
        data, pictures, self.steps, self.pose, self.gap = kept
        mujoco.mj_copyData(self.data, self.model, data)
        self.pictures = list(pictures)

    def step(self):
        if self.pose is not None:
            self.robot.drive(self.model, self.data, self.pose, self.gap)
        mujoco.mj_step(self.model, self.data)
        if self.steps % self.every == 0:
            d = self.data
            self.pictures.append((d.qpos.copy(), d.mocap_pos.copy(), d.mocap_quat.copy()))
            self.force = max(self.force, self.contact_force())
        self.steps += 1

    def contact_force(self):
        """The force of the twin on the robot, N."""
        total, wrench = np.zeros(3), np.zeros(6)
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            sides = [int(g) in self.robot.geoms for g in contact.geom]
            if sides[0] != sides[1]:
                mujoco.mj_contactForce(self.model, self.data, k, wrench)
                total += (1 if sides[1] else -1) * contact.frame.reshape(3, 3).T @ wrench[:3]
        return float(np.linalg.norm(total))

    def wait(self, seconds):
        for _ in range(round(seconds / self.model.opt.timestep)):
            self.step()

    def go(self, way, seconds):
        """Follows `way`, poses by a share from 0 to 1, smoothly."""
        count = max(1, round(seconds / self.model.opt.timestep))
        for k in range(count):
            s = (k + 1) / count
            self.pose = way(s * s * (3 - 2 * s))
            self.step()

    def drop(self, middle):
        """Lets the ball go a little above a place."""
        ball = self.data.joint("demo_ball")
        ball.qpos[:] = [*(middle + [0, 0, DROP]), 1, 0, 0, 0]
        ball.qvel[:] = 0
        self.model.body_gravcomp[self.model.body("demo_ball").id] = 0
        self.wait(1.0)

    # What a hold does.

    def way(self, joint, hold, goal):
        """The hand's pose by a share of the way from where the joint is to a little beyond its goal."""
        start = self.position(joint)
        arm = 1.0 if joint.kind == "slide" else max(np.linalg.norm(self.scene.away(hold.tip)), 0.02)
        end = goal + np.sign(goal - start) * BEYOND / arm
        scene = self.scene
        poses = lambda s: hold.carried(moved(joint, scene.axis, scene.anchor, s * (end - start)))
        return poses, abs(end - start) * arm

    def holds(self, joint, goal):
        """Holds that have room all along, best first, made as they are asked for."""
        sign = np.sign(goal - self.position(joint))
        scene, tried = Scene(self.model, self.data, joint, self.robot.geoms), []
        self.scene = scene
        found = candidates(scene, self.robot.hand, sign)
        if sign == np.sign(joint.closed - joint.open):  # what is closed is pushed
            found.sort(key=lambda h: h.kind != "push")
        for hold in found:
            if any(near(hold, other) for other in tried):
                continue
            if self.room(joint, hold, goal):
                tried.append(hold)
                yield hold

    def room(self, joint, hold, goal):
        """Whether the hand comes, goes along and leaves without touching anything but what it moves."""
        start = self.position(joint)
        scratch, robot = mujoco.MjData(self.model), self.robot
        mujoco.mj_copyData(scratch, self.model, self.data)
        way, _ = self.way(joint, hold, goal)
        # Poses, the joint's position, whether the part may be touched.
        stops = [(hold.before(way(0), by), start, False) for by in np.linspace(APPROACH, 0.004 if hold.kind == "push" else 0.0, 5)]
        stops += [(way(s), start + s * (goal - start), True) for s in np.linspace(0, 1, CHECKS)]
        stops += [(hold.before(way(1), by), goal, True) for by in np.linspace(0.02, APPROACH, 4)]
        mine = below(self.model, self.model.body(joint.body).id)
        for stance in robot.stances([pose for pose, _, _ in stops]):
            robot.take(scratch, stance)
            if self.free(scratch, joint, hold, stops, mine):
                hold.stance = stance
                return True
        return False

    def free(self, scratch, joint, hold, stops, mine):
        """Whether nothing is in the way at any stop."""
        for pose, q, touches in stops:
            self.robot.set(self.model, scratch, pose, hold.gap)
            place(self.model, scratch, {joint.name: q})
            if self.in_the_way(scratch, mine if touches else []):
                return False
        return True

    def in_the_way(self, data, but):
        """Whether the robot touches anything of the world but these bodies."""
        for k in range(data.ncon):
            a, b = (int(g) for g in data.contact.geom[k])
            if (a in self.robot.geoms) == (b in self.robot.geoms):
                continue
            other = b if a in self.robot.geoms else a
            if data.contact.dist[k] < -TOUCH and self.model.geom_bodyid[other] not in but:
                return True
        return False

    def touching(self, joint):
        """Contacts of fingertips with the part."""
        mine = below(self.model, self.model.body(joint.body).id)
        pairs = (tuple(int(g) for g in self.data.contact.geom[k]) for k in range(self.data.ncon))
        count = 0
        for a, b in pairs:
            for tip, other in ((a, b), (b, a)):
                count += tip in self.robot.tips and self.model.geom_bodyid[other] in mine
        return count

    def perform(self, joint, hold, goal):
        """Comes, holds, moves the joint to the goal, lets go, leaves. Gives what happened."""
        self.force = 0.0
        way, length = self.way(joint, hold, goal)
        self.gap = hold.gap
        self.robot.take(self.data, hold.stance)
        self.robot.set(self.model, self.data, hold.before(way(0)), hold.gap)
        mujoco.mj_forward(self.model, self.data)
        self.pose = hold.before(way(0))
        self.wait(0.1)
        press = PRESS if hold.kind == "push" else 0.0
        shift = lambda s: hold.before(way(s), -press)
        self.go(lambda s: hold.before(way(0), APPROACH * (1 - s) - press), 0.7)
        if hold.kind == "grasp":
            self.gap = None
            self.wait(0.4)
        seconds = max(SHORTEST, length / SPEED)
        self.go(lambda s: shift(0.5 * s), seconds / 2)
        contacts = self.touching(joint)
        self.go(lambda s: shift(0.5 + 0.5 * s), seconds / 2)
        self.wait(0.2)
        held, reached = self.touching(joint), self.share(joint)
        self.gap = min(hold.gap + 0.01, self.robot.hand.gap) if hold.kind == "grasp" else 0.0
        if hold.kind == "grasp":
            self.wait(0.3)
        last = self.pose
        self.go(lambda s: hold.before(last, APPROACH * s), 0.6)
        self.wait(0.1)
        return {
            "hold": hold.kind, "contacts": contacts, "contacts_at_end": held, "share_held": reached,
            "share": self.share(joint), "force_n": self.force,
        }

    def diverged(self):
        """Whether the solver gave up and started anew."""
        bad = mujoco.mjtWarning
        return any(self.data.warning[int(k)].number for k in (bad.mjWARN_BADQPOS, bad.mjWARN_BADQVEL, bad.mjWARN_BADQACC))

    def move(self, joint, goal, tries):
        """Brings the joint to its goal by one hold, or by several, each from where the last one left it, where none has
        room all along or reaches it. `None`: no hold has room."""
        first, wanted, legs = self.share(joint), joint.share(goal), []
        if abs(wanted - first) < 1 - ENOUGH:
            return {"hold": "none", "share": first, "tries": 0, "legs": []}
        while len(legs) < LEGS:
            before = self.kept()
            leg = self.leg(joint, goal, tries)
            if leg is None:
                break
            if legs and abs(wanted - leg["share"]) >= abs(wanted - leg["from"]):
                self.back(before)
                break
            legs.append(leg)
            whole, left, made = (abs(a - b) for a, b in ((wanted, first), (wanted, leg["share"]), (leg["share"], leg["from"])))
            if left <= (1 - ENOUGH) * whole or made < HEADWAY * whole:
                break
        if not legs:
            return None
        holds = list(dict.fromkeys(leg["hold"] for leg in legs))
        return {"hold": ", ".join(holds), "share": legs[-1]["share"], "tries": sum(leg["tries"] for leg in legs), "legs": legs}

    def leg(self, joint, goal, tries):
        """The motion that one hold makes of the way to a goal: the first that reaches what it was looked for, or else the
        one that comes farthest. `None`: no hold has room for a quarter of the way."""
        begin, best, count = self.kept(), None, 0
        first, start, wanted = self.share(joint), self.position(joint), joint.share(goal)
        ends = [(reach, start + reach * (goal - start)) for reach in REACHES]
        for reach, end, hold in ((reach, end, hold) for reach, end in ends for hold in self.holds(joint, end)):
            done = self.perform(joint, hold, end)
            count += 1
            progress = (done["share"] - first) / (wanted - first)
            if not self.diverged() and (best is None or progress > best[0]):
                best = (progress, {**done, "tip_m": hold.tip.tolist(), "approach": hold.rotation[:, 2].tolist()}, self.kept())
            if best and best[0] >= ENOUGH * reach or count >= tries:
                break
            # The next is looked for from where this began.
            self.back(begin)
        self.back(best[2] if best else begin)
        self.robot.away(self.model, self.data)
        self.pose = None
        return best and {**best[1], "from": first, "tries": count}

    def put(self, joint, share):
        """Sets a joint at rest where the recording showed it."""
        self.data.qvel[:] = 0
        place(self.model, self.data, {joint.name: joint.at(share)})
