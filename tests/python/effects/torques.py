"""Torques and readings of `artitwin.effects` against those of the program, effect by effect.

usage: torques.py CASES     (written by tests/effects.rs)
"""

import dataclasses
import json
import math
import sys
from pathlib import Path

from artitwin.effects import JointEffects, State, read_laws

# N m; of readings rad.
TOLERANCE = 1e-6


def with_delay(law, delay_s):
    """The law with another delay, where it has one."""
    change = lambda e: dataclasses.replace(e, parameters={"delay_s": delay_s}) if e.name == "delay" else e
    return dataclasses.replace(law, effects=tuple(map(change, law.effects)))


def torque(law, case, row):
    """Effort on the joint with the twin's inertia under which it moves as it does with all effects."""
    run = law.effects[0].run
    effects = JointEffects(with_delay(law, row["delay_s"]), run=run)
    for k, command in enumerate(row["commands"]):
        time_s = row["first_s"] + k * row["step_s"]
        drive = effects.command(time_s, command)
    q, v = row["position"], row["velocity"]
    constant, sine, cosine = case["load"]
    load = drive - case["damping"] * v - constant - sine * math.sin(q) - cosine * math.cos(q)
    state = State(q, v, drive, load, case["drawer"], time_s + 0.5 * row["step_s"], math.copysign(1.0, v))
    return load + effects.added_effort_with_friction(state, case["inertia"], row["step_s"])


def acts_once(law, state):
    """Whether nothing is applied where the file holds all, and all is taken back where the file alone has an effect."""
    whole, none = JointEffects(law, law.effects), JointEffects(dataclasses.replace(law, effects=()), law.effects)
    rest = (whole.effort(state), whole.gain - 1, whole.delay_s, whole.added_inertia, whole.lacks_friction, whole.lacks_stops)
    apart = JointEffects(law)
    taken = apart.effort(state) == -none.effort(state) and apart.added_inertia == -none.added_inertia and apart.delay_s == -none.delay_s
    return not any(rest) and taken and abs(apart.gain * none.gain - 1) < 1e-12


def main():
    worst = {}
    for folder in sorted(p for p in Path(sys.argv[1]).iterdir() if p.is_dir()):
        (law,) = read_laws(folder / "effects.json")
        case = json.loads((folder / "case.json").read_text())
        differences = [abs(torque(law, case, row) - row["torque"]) for row in case["torques"]]
        if law.effects[0].name in ("encoder_scale", "encoder_bias", "backlash"):
            effects = JointEffects(law)
            readings = map(effects.reading, case["twin_reading"])
            differences += [abs(a - b) for a, b in zip(readings, case["reading"], strict=True)]
        assert acts_once(law, State(0.2, 0.5, 1.0, 0.7, case["drawer"], 0.7)), folder.name
        acted = max(abs(a - b) for a, b in zip(case["reading"], case["twin_reading"], strict=True))
        worst[folder.name] = max(differences)
        print(f"{folder.name}: {len(differences)} values, largest difference {max(differences):.1e}; moves {acted:.2f} rad")
        assert acted > 0.01, folder.name
    assert len(worst) == 23 and max(worst.values()) < TOLERANCE, worst


if __name__ == "__main__":
    main()
