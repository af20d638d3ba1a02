"""Made inputs of known answer, as users have them: what `inspect`, `reconstruct` and `diagnose` make of each.

    python eval/inputs/table.py PROGRAM CASES WORK [FILTER...]

CASES holds a folder a script, with a folder a case: recordings of two states with `truth.json` (`c*`), or a twin with
`run_*` and `truth.json` (`d*`). Prints a row a case; the programs' own words stand in WORK.
"""

import json
import math
import subprocess
import sys
import time
from pathlib import Path

MOST_S = 600


def ended(program, *arguments):
    begun = time.time()
    try:
        run = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=MOST_S)
    except subprocess.TimeoutExpired:
        return None, f"longer than {MOST_S} s", time.time() - begun
    return run.returncode, run.stdout + run.stderr, time.time() - begun


def travelled(kind, distance):
    """A motion in degrees or millimeters, with a letter for its type."""
    size = 1e3 * distance if kind == "prismatic" else math.degrees(distance)
    return f"{kind[0]}{abs(size):.2f}"


def true_motions(case):
    parts = json.loads((case / "truth.json").read_text())["parts"]
    return sorted(travelled(p["type"], p["motion"]) for p in parts if p["type"] != "fixed")


def found_motions(folder):
    report = json.loads((folder / "report.json").read_text())
    before, after = (state["joints"] for state in report["states"][:2])
    motions = sorted(travelled(j["type"], after[j["name"]] - before[j["name"]]) for j in report["joints"])
    return motions, sorted({warning["code"] for warning in report.get("warnings", [])})


def recording_row(program, case, work, name):
    states = [case] if (case / "state0").exists() else sorted(case.glob("state*"))
    inspected, said, _ = ended(program, "inspect", *states)
    made, told, seconds = ended(
        program, "reconstruct", *states, "--name", name, "--preset", "preview", "--out", work, "--force"
    )
    (work / f"{name}.txt").write_text(said + "\n" + told)
    agrees = "yes" if (inspected == 0) == (made in (0, 3)) else "NO"
    if made in (0, 3):
        motions, codes = found_motions(work / name)
        what = f"{' '.join(motions)} | {' '.join(true_motions(case))} | {', '.join(codes)}"
    else:
        what = f"refused | {' '.join(true_motions(case))} | {last_sentence(told)}"
    return f"{inspected} | {made} | {agrees} | {what} | {seconds:.0f}"


def last_sentence(told):
    lines = [line for line in told.splitlines() if line.startswith("error")] or [told]
    return lines[-1].replace("|", "/")[:240]


def log_row(program, case, work, name):
    twin = next(p for p in case.iterdir() if p.is_file() and p.name != "truth.json")
    made, told, seconds = ended(
        program, "diagnose", twin, *sorted(case.glob("run_*")), "--out", work / name, "--force"
    )
    (work / f"{name}.txt").write_text(told)
    truth = json.loads((case / "truth.json").read_text())
    hidden = json.dumps(truth.get("hidden", truth))[:80].replace("|", "/")
    report = work / name / "report.json"
    if made not in (0, 3) or not report.exists():
        return f"{made} | refused | {hidden} | {last_sentence(told)} | {seconds:.0f}"
    read = json.loads(report.read_text())
    findings = [
        f"{f['effect']} {', '.join(format(p['value'] or math.nan, '.3g') for p in f['parameters'])} ({f['weight']:.2f})"
        for f in read["findings"]
    ]
    return f"{made} | {read['verdict']} | {hidden} | {'; '.join(findings)} | {seconds:.0f}"


def main():
    program, cases, work, *filters = sys.argv[1:]
    work = Path(work)
    work.mkdir(parents=True, exist_ok=True)
    heads = {
        "c": "| case | inspect | reconstruct | agree | found | true | warnings or reason | s |",
        "d": "| case | diagnose | verdict | hidden | found or reason | s |",
    }
    for kind, head in heads.items():
        print(f"\n{head}\n|{'---|' * (head.count('|') - 1)}")
        for case in sorted(p for p in Path(cases).glob(f"{kind}*/*") if (p / "truth.json").exists()):
            name = f"{case.parent.name}_{case.name}"
            if filters and not any(wanted in name for wanted in filters):
                continue
            row = (recording_row if kind == "c" else log_row)(program, case, work, name)
            print(f"| {case.parent.name}/{case.name} | {row} |", flush=True)


if __name__ == "__main__":
    main()
