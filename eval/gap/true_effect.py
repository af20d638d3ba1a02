"""What the true effect leaves of a machine's error in MuJoCo: the bound of any diagnosis above this floor.

For cases of `machine.write_case` (CASES/<case>, CASES/truth/<case>.json) the hidden effect is written into the MJCF that
`artitwin diagnose` made of the case, with its true parameters in place of what was found, and judged by `mjcf_error.py` on the runs
that nobody was shown. Effects that MuJoCo has no attribute for are left out.

usage: true_effect.py CASES DIAGNOSES   (DIAGNOSES/<case>/twin.xml)
"""

import json
import statistics
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mjcf_error


def write(effect, p, joint, actuator, own):
    """Writes a true effect beside the twin's damping and friction; False where MuJoCo has no place for it."""
    damping, friction = own
    values = {"damping": str(damping), "frictionloss": str(friction)}
    bias = 0.0
    if effect == "viscous_friction":
        values["damping"] = str(damping + p["b"])
    elif effect == "quadratic_drag":
        values["damping"] = f"{damping} {p['c']}"
    elif effect == "coulomb_friction":
        values["frictionloss"] = str(friction + p["F"])
    elif effect == "asymmetric_friction":
        values["frictionloss"] = str(friction + (p["plus"] + p["minus"]) / 2)
        bias = (p["minus"] - p["plus"]) / 2
    elif effect == "constant_bias":
        bias = p["e"]
    elif effect == "torque_gain":
        actuator.set("gear", str(p["g"]))
    elif effect == "inertia":
        values["armature"] = str(p["I"])
    elif effect in ("spring_return", "hardening_spring"):
        values |= {"stiffness": f"{p['k']} 0 {p['h']}" if "h" in p else str(p["k"]), "springref": str(p["q"])}
    else:
        return False
    actuator.set("biasprm", f"{bias} 0 0")
    for name, value in values.items():
        joint.set(name, value)
    return True


def twin_numbers(urdf, name):
    """Damping and friction of a joint of the twin."""
    dynamics = next(j for j in ElementTree.parse(urdf).getroot().iter("joint") if j.get("name") == name).find("dynamics")
    return tuple(0.0 if dynamics is None else float(dynamics.get(key, 0)) for key in ("damping", "friction"))


def main():
    cases, diagnoses = Path(sys.argv[1]), Path(sys.argv[2])
    bounds = []
    for file in sorted((cases / "truth").glob("*.json")):
        hidden, case = json.loads(file.read_text())["hidden"], cases / file.stem
        if not hidden:
            continue
        ((part, effects),) = hidden.items()
        ((effect, p),) = effects.items()
        exported = next(diagnoses.glob(f"*{file.stem}/twin.xml"))
        tree = ElementTree.parse(exported)
        is_held = False
        for name in [j.get("name") for j in tree.getroot().iter("joint")]:
            joint = next(j for j in tree.getroot().iter("joint") if j.get("name") == name)
            actuator = next(a for a in tree.getroot().iter("general") if a.get("joint") == name)
            own = twin_numbers(case / "twin.urdf", name)
            for key in ("armature", "stiffness", "springref", "ref", "range", "limited", "solreflimit", "solimplimit"):
                joint.attrib.pop(key, None)
            for key in ("delay", "nsample", "interp"):
                actuator.attrib.pop(key, None)
            joint.set("damping", str(own[0]))
            joint.set("frictionloss", str(own[1]))
            actuator.set("gear", "1")
            actuator.set("biasprm", "0 0 0")
            if name == f"{part}_joint":
                is_held = write(effect, p, joint, actuator, own)
        if is_held:
            with tempfile.NamedTemporaryFile(suffix=".xml") as out:
                tree.write(out.name)
                left = mjcf_error.errors(case / "twin.urdf", out.name, sorted(case.glob("unseen_*")))[f"{part}_joint"][2]
            found = mjcf_error.errors(case / "twin.urdf", exported, sorted(case.glob("unseen_*")))[f"{part}_joint"][2]
            bounds.append((left, found))
            print(f"{file.stem}: true effect {left:.2f}, diagnosis {found:.2f}", flush=True)
    print(f"median of {len(bounds)}: true effect {statistics.median(b for b, _ in bounds):.2f}, diagnosis {statistics.median(f for _, f in bounds):.2f}")


if __name__ == "__main__":
    main()
