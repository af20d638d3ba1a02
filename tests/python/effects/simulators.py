"""A lid under the same commands in MuJoCo, PyBullet and Drake, with an effect that its URDF lacks, against the program's roll-out.

usage: simulators.py CASES     (written by tests/effects.rs)
"""

import json
import math
import sys
from pathlib import Path

import mujoco
import numpy as np
import pybullet
from artitwin.effects.drake import DrakeEffects
from artitwin.effects.mujoco import MujocoEffects
from artitwin.effects.pybullet import PybulletEffects
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pybullet_utils.bullet_client import BulletClient

STEP_S = 5e-4
LID, DRAWER = "lid_joint", "drawer_joint"


def in_mujoco(urdf, folder, case, substeps):
    model = mujoco.MjModel.from_xml_path(str(urdf))
    model.opt.timestep, model.opt.integrator = STEP_S, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    readings = []
    with MujocoEffects(model, folder) as effects:
        data.joint(LID).qpos, data.joint(DRAWER).qpos = case["true_position"], case["drawer"]
        for command in case["commands"]:
            readings.append(effects.reading(LID, data))
            for _ in range(substeps):
                data.joint(LID).qfrc_applied = effects.command(LID, data.time, command)
                mujoco.mj_step(model, data)
    assert mujoco.get_mjcb_passive() is None
    return readings


def in_pybullet(urdf, folder, case, substeps):
    world = BulletClient(pybullet.DIRECT)
    world.setGravity(0, 0, -9.81)
    world.setTimeStep(STEP_S)
    body = world.loadURDF(str(urdf), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    for index in range(world.getNumJoints(body)):
        # The library's own damping of every link is 0.04, and its motors hold every joint.
        world.changeDynamics(body, index, linearDamping=0, angularDamping=0)
        world.setJointMotorControl2(body, index, pybullet.VELOCITY_CONTROL, force=0)
        is_lid = world.getJointInfo(body, index)[1].decode() == LID
        world.resetJointState(body, index, case["true_position"] if is_lid else case["drawer"])
    effects, readings = PybulletEffects(body, folder, client=world), []
    for command in case["commands"]:
        readings.append(effects.reading(LID))
        for _ in range(substeps):
            effects.apply({LID: command})
            world.stepSimulation()
    world.disconnect()
    return readings


def in_drake(urdf, folder, case, substeps):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, STEP_S)
    Parser(plant).AddModels(str(urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    effects = builder.AddSystem(DrakeEffects(plant, folder))
    builder.Connect(plant.get_state_output_port(), effects.GetInputPort("state"))
    builder.Connect(effects.GetOutputPort("generalized_force"), plant.get_applied_generalized_force_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    own, mine = plant.GetMyContextFromRoot(context), effects.GetMyContextFromRoot(context)
    plant.GetJointByName(LID).set_angle(own, case["true_position"])
    plant.GetJointByName(DRAWER).set_translation(own, case["drawer"])
    lid = plant.GetJointByName(LID).velocity_start()
    readings = []
    for k, command in enumerate(case["commands"]):
        efforts = np.zeros(plant.num_velocities())
        efforts[lid] = command
        effects.GetInputPort("command").FixValue(mine, efforts)
        readings.append(effects.GetOutputPort("reading").Eval(mine)[plant.GetJointByName(LID).position_start()])
        simulator.AdvanceTo((k + 1) * substeps * STEP_S)
    return readings


# What a simulator may be off, of what the effect changes.
SIMULATORS = {in_mujoco: 0.02, in_pybullet: 0.03, in_drake: 0.04}


def rms(x):
    return math.sqrt(np.mean(np.square(x)))


def main():
    cases, off = Path(sys.argv[1]), []
    for folder in sorted(p for p in cases.iterdir() if p.is_dir()):
        case = json.loads((folder / "case.json").read_text())
        substeps = round(case["sample_s"] / STEP_S)
        own, twin = np.array(case["reading"]), np.array(case["twin_reading"])
        shares = []
        for simulator, most in SIMULATORS.items():
            readings = np.array(simulator(cases / "twin.urdf", folder, case, substeps))
            shares.append(rms(readings - own) / rms(twin - own))
            if not shares[-1] < most:
                off.append(f"{folder.name} {simulator.__name__}")
        print(folder.name, " ".join(f"{share:.4f}" for share in shares), flush=True)
    assert not off, off


if __name__ == "__main__":
    main()
