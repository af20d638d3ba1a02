"""Runs docs/effects.md: its commands, then its code with a viewer that shows nothing, until the door rests.

usage: page.py PROGRAM WORK
"""

import os
import re
import shlex
import subprocess
import sys
import types
from pathlib import Path

import mujoco
from artitwin.effects import read_laws

ROOT = Path(__file__).resolve().parents[3]
SECONDS = 6.0


class Viewer:
    """In place of `mujoco.viewer.launch_passive(model, data)`."""

    def __init__(self, model, data):
        self.data, self.opt = data, mujoco.MjvOption()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def is_running(self):
        return self.data.time < SECONDS

    def sync(self):
        pass


def main():
    program, work = sys.argv[1:]
    os.chdir(work)
    page = (ROOT / "docs/effects.md").read_text()
    for line in re.search(r"```sh\n(python tests.*?)```", page, re.S)[1].splitlines():
        line = line.replace("python tests", f"{shlex.quote(sys.executable)} {shlex.quote(str(ROOT))}/tests").replace("artitwin ", f"{shlex.quote(program)} ", 1)
        done = subprocess.run(line, shell=True, check=False, capture_output=True, text=True)
        # 3: a file keeps the twin's values.
        assert done.returncode in (0, 3), done.stderr
    code = re.search(r"```python\n(import mujoco.*?)```", page, re.S)[1]
    viewer = types.ModuleType("mujoco.viewer")
    viewer.launch_passive = Viewer
    sys.modules["mujoco.viewer"] = mujoco.viewer = viewer
    shown = {}
    exec(code, shown)
    (law,) = read_laws("diagnosis/effects.json")
    catch = next(e.numbers for e in law.effects if e.name == "detent")
    joint = shown["data"].joint("door_joint")
    # The same push without the effects.
    plain = mujoco.MjData(shown["model"])
    plain.joint("door_joint").qpos, plain.joint("door_joint").qvel = (float(x) for x in re.search(r"qvel = ([\d.]+), ([\d.]+)", code).groups())
    while plain.time < SECONDS:
        mujoco.mj_step(shown["model"], plain)
    off, off_plain = (abs(float(at.qpos[0]) - catch["position"]) / catch["width"] for at in (joint, plain.joint("door_joint")))
    print(f"catch at {catch['position']:.3f} rad; door {off:.2f} widths from it, at {float(joint.qvel[0]):.1e} rad/s; without the effects {off_plain:.2f}")
    assert off < 0.5 and abs(float(joint.qvel[0])) < 0.01 and off_plain > 1.5


if __name__ == "__main__":
    main()
