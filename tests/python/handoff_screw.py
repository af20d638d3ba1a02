"""Lets every screw of a model run under gravity, from each observed state, in every reader that holds it; prints JSON of what happened.

    python handoff_screw.py DIR NAME

The last line is JSON: {reader: {"slip_m", "beyond_rad"}}. `slip_m`: the most by which a part's height on its thread differs from its turn in 5 s;
`beyond_rad`: the most by which the turn passes its limits.
"""

import json
import logging
import sys
from pathlib import Path

import numpy as np

SECONDS = 5.0


def mujoco(path, states, screws):
    import mujoco

    model, worst = mujoco.MjModel.from_xml_path(str(path)), {"slip_m": 0.0, "beyond_rad": 0.0}
    for state in states:
        data = mujoco.MjData(model)
        for name, q in state.items():
            data.joint(name).qpos[0] = q
        for _ in range(round(SECONDS / model.opt.timestep)):
            mujoco.mj_step(model, data)
            for name, pitch in screws.items():
                noted(worst, data.joint(name).qpos[0], data.joint(f"{name}_advance").qpos[0], pitch, model.jnt_range[model.joint(name).id])
    return worst


def drake(path, states, screws):
    from pydrake.all import AddMultibodyPlantSceneGraph, DiagramBuilder, Parser, Simulator

    logging.getLogger("drake").setLevel(logging.ERROR)
    worst = {"slip_m": 0.0, "beyond_rad": 0.0}
    for state in states:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
        [instance] = Parser(plant).AddModels(str(path))
        root = next(plant.get_body(b) for b in plant.GetBodyIndices(instance) if not parents(plant, instance, b))
        if path.suffix == ".urdf":  # it says nothing of the root
            plant.WeldFrames(plant.world_frame(), root.body_frame())
        plant.Finalize()
        simulator = Simulator(builder.Build())
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        joints = {plant.get_joint(j).name(): plant.get_joint(j) for j in plant.GetJointIndices(instance)}
        positions = plant.GetPositions(context).copy()
        for name, q in state.items():
            positions[joints[name].position_start()] = q
        plant.SetPositions(context, positions)
        for step in range(1, round(SECONDS * 100) + 1):
            simulator.AdvanceTo(step / 100)
            q = plant.GetPositions(context)
            for name, pitch in screws.items():
                joint = joints[name]
                limits = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
                noted(worst, q[joint.position_start()], q[joints[f"{name}_advance"].position_start()], pitch, limits)
    return worst


def parents(plant, instance, body):
    joints = [plant.get_joint(j) for j in plant.GetJointIndices(instance)]
    return [j for j in joints if j.child_body().index() == body and j.parent_body().name() != "world"]


def noted(worst, turn, advance, pitch, limits):
    assert np.isfinite([turn, advance]).all() and np.isfinite(limits).all(), (turn, advance, limits)
    worst["slip_m"] = max(worst["slip_m"], float(abs(advance - pitch * turn)))
    worst["beyond_rad"] = max(worst["beyond_rad"], float(max(limits[0] - turn, turn - limits[1])))


def main():
    folder, name = Path(sys.argv[1]).resolve(), sys.argv[2]
    states = [state["joints"] for state in json.loads((folder / "report.json").read_text())["states"]]
    moved = max(states, key=lambda s: max(abs(q) for q in s.values()))
    # Both positions of a screw stand in a state: their ratio is the pitch.
    screws = {n: moved[f"{n}_advance"] / q for n, q in moved.items() if f"{n}_advance" in moved}
    assert screws, states
    found = {
        "mujoco mjcf": mujoco(folder / f"{name}.xml", states, screws),
        "mujoco urdf": mujoco(folder / f"{name}.urdf", states, screws),
        "drake sdf": drake(folder / "model.sdf", states, screws),
        "drake urdf": drake(folder / f"{name}.urdf", states, screws),
        "drake mjcf": drake(folder / f"{name}.xml", states, screws),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
