"""The tables of peers.py from its records."""

import datetime
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import mjcf_error
import numpy as np

TOOLS = ("artitwin", "regression", "sysid", "sysid, states", "sysid, offset", "sysid, offset, states")
PROVED = "artitwin, proof"
# Of the made machines: what the peers' parameters hold, and what they do not.
HELD = ("viscous_friction", "coulomb_friction", "inertia", "torque_gain")
NOT_HELD = ("asymmetric_friction", "load_dependent_friction", "spring_return", "delay")


def ratio(record, tool):
    return record["error"][tool] / record["error"]["twin"]


def shares(record, tools):
    """Cells with the shares of the twin's error, the least in bold, ties too."""
    return " | ".join(f"**{ratio(record, t):.2f}**" if is_least(record, t) else f"{ratio(record, t):.2f}" for t in tools)


def is_least(record, tool):
    """Whether no tool's share is less by two digits."""
    return round(ratio(record, tool), 2) == min(round(ratio(record, t), 2) for t in TOOLS)


def said(record, tool="artitwin"):
    found = record["found"][tool]
    names = ", ".join(sorted({e.replace("_", " ") for _, e in found["findings"]}))
    return f"{found['verdict']}: {names}" if names else found["verdict"]


def twins(record):
    error = record["error"]["twin"]
    return f"{error:.3f} of its motion" if record["unit"] == "of its motion" else f"{1e3 * error:.1f} m{record['unit']}"


def times(records):
    text = head("case", "shown, s", "joints", *TOOLS, PROVED)
    for r in records:
        cells = (f"{r['cpu_s'][t]:.1f}" if t in r["cpu_s"] else "" for t in (*TOOLS, PROVED))
        text += f"| {r['name']} | {r['shown_s']:.0f} | {len(r['joints'])} | {' | '.join(cells)} |\n"
    return text


def head(*cells):
    return f"| {' | '.join(cells)} |\n|{'---|' * len(cells)}\n"


def measured_rows(records):
    text = head("machine, judged run", "twin's error", *TOOLS, "the program says", "with the judged run as its proof", "it then says")
    for r in records:
        text += f"| {r['name']} | {twins(r)} | {shares(r, TOOLS)} | {said(r)} | {ratio(r, PROVED):.2f} | {said(r, PROVED)} |\n"
    text += "\nWhat the peers found, N m and s.\n\n" + head("judged run", "joint", "tool", "damping", "frictionloss", "armature", "offset", "gear")
    for r in records:
        for joint in r["joints"]:
            for tool in TOOLS[1:]:
                own = r["found"][tool][joint]
                cells = (f"{own[n]:.4f}" if n in own else "" for n in ("damping", "frictionloss", "armature", "offset", "gear"))
                text += f"| {r['name']} | {joint} | {tool} | {' | '.join(cells)} |\n"
    return text


def made_rows(records):
    text = head("case", "hidden", "twin's error", *TOOLS, "the program says")
    for r in records:
        hidden = r["hidden"][1].replace("_", " ") if r["hidden"] else "nothing"
        text += f"| {r['name']} | {hidden} | {twins(r)} | {shares(r, TOOLS)} | {said(r)} |\n"
    return text


def summary(groups):
    text = head("cases", "", *TOOLS)
    for title, records in groups.items():
        own = {t: [ratio(r, t) for r in records] for t in TOOLS}
        lines = {
            "share of the twin's error, median": [f"{np.median(own[t]):.2f}" for t in TOOLS],
            "largest": [f"{max(own[t]):.2f}" for t in TOOLS],
            "least of the six, ties counted, cases": [str(sum(is_least(r, t) for r in records)) for t in TOOLS],
            "worse than the twin, cases": [str(sum(x > mjcf_error.WORSE for x in own[t])) for t in TOOLS],
            "CPU, median, s": [f"{np.median([r['cpu_s'][t] for r in records]):.1f}" for t in TOOLS],
        }
        for i, (line, cells) in enumerate(lines.items()):
            text += f"| {f'{title} ({len(records)})' if i == 0 else ''} | {line} | {' | '.join(cells)} |\n"
    return text


def document(records, program, seed):
    """All tables."""
    cpu = next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "")
    says = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    tools = ", ".join(f"{n} {version(n)}" for n in ("mujoco", "numpy", "scipy"))
    text = f"{datetime.date.today().isoformat()}, {os.cpu_count()} cores, {cpu}, {says}, {tools}, Python {platform.python_version()}. "
    text += f"Seed of the made machines: {seed}. Errors are shares of the twin's error, the least in bold, ties too.\n\n"
    of = lambda *kinds: [r for r in records if r["kind"] in kinds]
    groups = {
        "measured": of("measured"), "floor, effect that their parameters hold": [r for r in of("machine") if r["hidden"][1] in HELD],
        "floor, another effect": [r for r in of("machine") if r["hidden"][1] not in HELD], "floor, nothing hidden": of("machine_null"), "no floor": of("single"),
    }  # fmt: skip
    text += "### All\n\n" + summary({k: v for k, v in groups.items() if v})
    if of("measured"):
        text += "\n### Measured machines\n\n" + measured_rows(of("measured"))
    text += "\n### Made machines\n\n" + made_rows(of("machine", "machine_null")) + "\n### Made, without a floor\n\n" + made_rows(of("single"))
    return text + "\n### CPU, s\n\n" + times(records)
