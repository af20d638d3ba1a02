"""Scores diagnoses of the blind suite: OUT/<case>/report.json against DATA/truth/<case>.json; or judges the records of a suite
(suite.py) again, one line a case: kind, name, result.

usage: score.py DATA OUT
       score.py WORK/results
"""

import json
import math
import sys
from collections import defaultdict
from pathlib import Path

LIBRARY = {
    "viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction", "quadratic_drag", "load_dependent_friction",
    "local_friction", "spring_return", "hardening_spring", "constant_bias", "axis_tilt", "inertia", "torque_gain", "backlash", "end_stop",
    "detent", "cogging", "coupling", "delay", "encoder_bias", "encoder_scale", "disturbance",
}  # fmt: skip


def names(report, joint):
    """Names at a joint; an ambiguous report counts with its whole class."""
    own = [f for f in report["findings"] if f["joint"] == joint]
    first = {f["effect"] for f in own}
    more = {a["effect"] for f in own for a in f["alternatives"]} if report["verdict"] == "ambiguous" else set()
    return first, more


def is_explained(truth, finding):
    """Whether a machine's floor is the cause of a finding: an effect that is not hidden, no further from neutral than the floor takes it."""
    if any(finding["effect"] in effects for part, effects in truth["hidden"].items() if finding["joint"] == f"{part}_joint"):
        return False
    limits = truth.get("explained", {}).get(finding["joint"].removesuffix("_joint"), {}).get(finding["effect"])
    neutral = {"gain": 1.0, "scale": 1.0}
    return limits is not None and all(abs(p["value"] - neutral.get(p["name"], 0.0)) <= limits.get(p["name"], 0.0) for p in finding["parameters"])


def without_floor(truth, report):
    """The report without the findings that a machine's floor explains."""
    left = [f for f in report["findings"] if not is_explained(truth, f)]
    return report | dict(findings=left)


def first_name(truth, report):
    """Whether the effect that is named first, alternatives and further names aside, is a hidden one at its joint (a coupling acts
    on both of its joints)."""
    hidden = {(f"{part}_joint", e) for part, effects in truth["hidden"].items() for e in effects}
    couples = any(e == "coupling" for _, e in hidden)
    return any((f["joint"], f["effect"]) in hidden or (couples and f["effect"] == "coupling") for f in report["findings"][:1])


def judge(truth, report):
    hidden = truth["hidden"]
    if not hidden:
        return "right" if not report["findings"] else "false name"
    (part, effects), = hidden.items()
    wanted = set(effects)
    # A coupling acts on both of its joints.
    if any(f["joint"] != f"{part}_joint" and f["effect"] != "coupling" for f in report["findings"]):
        return "wrong joint"
    first, more = names(report, f"{part}_joint")
    if not wanted <= LIBRARY:
        return "right" if report["verdict"] == "unknown" else ("no name" if not first else "wrong name")
    if not first:
        return report["verdict"]
    if first == wanted:
        return "right"
    if wanted <= first | more and len(first) == len(wanted):
        return "right"
    return "one too many" if wanted < first else "wrong name"


def judge_record(record):
    """The result of a finished case of the suite, from what its record says was hidden and found."""
    if record["verdict"] == "failed":
        return "failed"
    truth = {"hidden": record["truth"], "explained": record.get("explained", {})}
    report = {"verdict": record["verdict"], "findings": record["findings"]}
    return judge(truth, without_floor(truth, report) if record["kind"].startswith("machine") else report)


# Parameters that mean the same in the generator and in the reports; where the shapes differ there is none.
SAME = {
    "viscous_friction": {"b": "damping"}, "coulomb_friction": {"F": "friction"}, "quadratic_drag": {"c": "drag"},
    "asymmetric_friction": {"plus": "friction_positive", "minus": "friction_negative"}, "load_dependent_friction": {"mu": "coefficient"},
    "spring_return": {"k": "stiffness", "q": "rest_position"}, "hardening_spring": {"k": "stiffness", "h": "hardening", "q": "rest_position"},
    "constant_bias": {"e": "effort"}, "inertia": {"I": "added_inertia"}, "torque_gain": {"g": "gain"}, "backlash": {"g": "half_gap"},
    "delay": {"d": "delay"}, "encoder_bias": {"o": "offset"}, "encoder_scale": {"s": "scale"}, "detent": {"q": "position"},
    "local_friction": {"q": "position"}, "end_stop": {"q": "position"},
}  # fmt: skip


def coverage(truth, report):
    """Truth and interval of every parameter that can be compared."""
    rows = []
    for part, effects in truth["hidden"].items():
        for f in report["findings"]:
            hidden = effects.get(f["effect"]) if f["joint"] == f"{part}_joint" else None
            own = {p["name"]: p for p in f["parameters"]}
            for key, name in ((k, n) for k, n in SAME.get(f["effect"], {}).items() if k in (hidden or {})):
                low, high = own[name]["interval"]
                rows.append(dict(effect=f["effect"], name=name, truth=hidden[key], value=own[name]["value"], inside=low <= hidden[key] <= high, half=(high - low) / 2))
    return rows


def region(effect, p):
    """Variables that an effect outside the library depends on, and the positions (or speeds) that it fills; None: all."""
    return {
        "one_way_band_damper": (("position", "velocity", "direction"), (p.get("lo"), p.get("hi"))),
        "sticky_band": (("position",), (p.get("q", 0), p.get("q", 0) + 3 * p.get("w", 0))),
        "staircase": (("position",), None),
        "heating_friction": (("velocity", "direction", "time"), None),
        "speed_limiter": (("velocity",), None),
        "effort_deadband": (("effort",), None),
    }.get(effect, (None, None))


def place(truth, report):
    """Whether the first place reported (three at most) names a variable of the hidden effect, and a region that meets it."""
    for part, effects in truth["hidden"].items():
        for effect, p in effects.items():
            variables, at = region(effect, p)
            for w in [w for w in report["where"] if w["joint"] == f"{part}_joint"][:3]:
                if variables and w["variable"].split(",")[0] in variables:
                    if at is None or not w["variable"].startswith("position") or (w["region"][0] < at[1] and w["region"][1] > at[0]):
                        return True
    return False


def judge_again(results):
    for file in sorted(results.glob("*.json")):
        record = json.loads(file.read_text())
        print(f"{record['kind']}\t{record['name']}\t{judge_record(record)}")


def main():
    if len(sys.argv) == 2:
        judge_again(Path(sys.argv[1]))
        return
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    table, wrong, shrink = defaultdict(lambda: [0, 0]), [], []
    for file in sorted((data / "truth").glob("*.json")):
        report_file = out / file.stem / "report.json"
        if not report_file.exists():
            continue
        truth, report = json.loads(file.read_text()), json.loads(report_file.read_text())
        result = judge(truth, report)
        family = " + ".join(k for e in truth["hidden"].values() for k in e) or "nothing"
        for key in (family, "noise " + truth["noise"], "object " + truth["object"], "all"):
            table[key][0] += result == "right"
            table[key][1] += 1
        if result != "right":
            found = " + ".join(f["effect"] for f in report["findings"])
            wrong.append(f"{file.stem}: {result} ({report['verdict']}) {found}")
        gap = report["gap"]
        if report["verdict"] in ("named", "ambiguous") and truth["hidden"] and family != "disturbance" and gap["before"] and gap["before"] > 1.5 * gap["noise_floor"]:
            shrink.append((gap["after"] - gap["noise_floor"]) / (gap["before"] - gap["noise_floor"]))
    for key, (right, n) in sorted(table.items()):
        print(f"{key:45s} {right:4d} / {n:<4d} {100 * right / n:5.1f} %")
    if shrink:
        shrink.sort()
        at = lambda share: shrink[min(len(shrink) - 1, math.floor(share * len(shrink)))]
        print(f"gap left on held-out runs: median {at(0.5):.3f}, 95th percentile {at(0.95):.3f}, n {len(shrink)}")
    print("\n".join(wrong))


if __name__ == "__main__":
    main()
