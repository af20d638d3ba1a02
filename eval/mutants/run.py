"""Runs the tests of a crate that `schemata.py` wrote against each of its mutants.

    python run.py SCRATCH --crate NAME [--tests PREFIX ...] [--again STATE ...]

builds the unit tests once, runs each alone for its duration and the mutants that it reaches, and then, for
every mutant, the tests that reach it, shortest first, until one fails. Tests longer than `--longest-s` are no
part of the fast suite. States: `caught`, `timeout` (ten times what the tests take, and some seconds),
`survived`, `unreached` by any test. Written to SCRATCH/results.json after each mutant.
"""

import argparse
import json
import math
import os
import resource
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

AREAS = {
    "fusion": "src/surface/",
    "joint estimator": "src/articulate/joints/",
    "part count": "src/articulate/parts/",
    "whitening": "src/gap/fit/",
    "verdict": "src/gap/judge/",
}
# So long are the tests of one process in a mutant's first batch; each further batch takes twice as long.
FIRST_BATCH_S = 0.3
# Allowed to every process beyond ten times its tests' durations.
GRACE_S = 2.0


def binary(scratch: Path, build: str) -> str:
    """Builds the unit tests; the path of their binary."""
    command = [*build.split(), "--message-format=json"]
    built = subprocess.run(command, cwd=scratch, stdout=subprocess.PIPE, text=True, check=True)
    messages = [json.loads(line) for line in built.stdout.splitlines()]
    return next(m["executable"] for m in messages if m.get("executable"))


def run(program: str, scratch: Path, tests: list[str], limit_s: float, **variables: str) -> tuple[str, float]:
    """Runs some tests, one after the other: `passed`, `failed` or `timeout`, and the processor time taken.

    The limit is one of processor time, so that other load on the machine does not matter.
    """
    environment = {**os.environ, "RAYON_NUM_THREADS": "1", **variables}
    command = [program, "--exact", "--test-threads=1", "-q", *tests]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    limit = math.ceil(limit_s)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))

    process = subprocess.Popen(command, cwd=scratch, env=environment, preexec_fn=limited, **quiet)
    _, status, usage = os.wait4(process.pid, 0)
    taken_s = usage.ru_utime + usage.ru_stime
    if status == 0:
        return "passed", taken_s
    return ("timeout" if taken_s >= limit - 0.5 else "failed"), taken_s


def measured(program: str, scratch: Path, test: str, longest_s: float) -> dict | None:
    """Duration of a test and the mutants that it reaches; none where it takes too long or fails."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "reached"
        state, taken_s = run(program, scratch, [test], longest_s, MUTANT_REACHED=str(file))
        if state != "passed":
            print(state, test, flush=True)
            return None
        reached = file.read_text().split() if file.exists() else []
        return {"name": test, "duration_s": taken_s, "reached": [int(n) for n in reached]}


def batches(tests: list[dict], module: str) -> list[list[dict]]:
    """Tests, those beside the code and then shortest first, in batches that double in length."""
    found, limit_s = [[]], FIRST_BATCH_S
    for test in sorted(tests, key=lambda t: (not t["name"].startswith(module), t["duration_s"])):
        if found[-1] and sum(t["duration_s"] for t in found[-1]) + test["duration_s"] > limit_s:
            found.append([])
            limit_s *= 2.0
        found[-1].append(test)
    return [batch for batch in found if batch]


def judged(program: str, scratch: Path, mutant: dict, tests: list[dict]) -> str:
    """What becomes of a mutant."""
    number = mutant["number"]
    _, _, *path = mutant["file"].removesuffix(".rs").split("/")
    module = "::".join(path) + "::"
    reaching = [t for t in tests if number in t["reached"]]
    for batch in batches(reaching, module):
        limit_s = GRACE_S + 10.0 * sum(t["duration_s"] for t in batch)
        result, _ = run(program, scratch, [t["name"] for t in batch], limit_s, MUTANT=str(number))
        if result != "passed":
            return "caught" if result == "failed" else "timeout"
    return "survived" if reaching else "unreached"


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("scratch", type=Path)
    arguments.add_argument("--crate", required=True, help="folder of the crate below src")
    arguments.add_argument("--tests", nargs="*", default=[""], help="prefixes; all")
    arguments.add_argument("--longest-s", type=float, default=10.0)
    arguments.add_argument("--again", nargs="*", help="states that are asked again; others stay")
    arguments.add_argument("--build", help="default: builds the crate's unit tests")
    arguments.add_argument("--program", help="the tests' binary, where it is built")
    options = arguments.parse_args()
    scratch = options.scratch.resolve()
    build = options.build or f"cargo test --release --lib --no-run -p artitwin-{options.crate}"
    program = options.program or binary(scratch, build)
    listed = subprocess.check_output([program, "--list", "--format", "terse"], text=True, cwd=scratch)
    names = [line.removesuffix(": test") for line in listed.splitlines() if line.endswith(": test")]
    names = [n for n in names if n.startswith(tuple(options.tests))]
    mutants = json.loads((scratch / "schemata.json").read_text())
    results_file = scratch / "results.json"
    results = json.loads(results_file.read_text()) if results_file.exists() else {}
    built = [m for m in mutants if m["state"] == "built"]
    wanted = [m for m in built if str(m["number"]) not in results]
    wanted += [m for m in built if results.get(str(m["number"])) in (options.again or [])]
    # Two at a time: limits on time hold while both processors are there.
    with ThreadPoolExecutor(2) as pool:
        tests_file = scratch / "tests.json"
        if tests_file.exists() and tests_file.stat().st_mtime > Path(program).stat().st_mtime:
            tests = json.loads(tests_file.read_text())
        else:
            found = pool.map(lambda n: measured(program, scratch, n, options.longest_s), names)
            tests = [t for t in found if t is not None and t["reached"]]
            tests_file.write_text(json.dumps(tests))
        total_s = sum(t["duration_s"] for t in tests)
        print(f"{len(names)} tests, {len(tests)} reach a mutant, {total_s:.0f} s", flush=True)

        states = pool.map(lambda m: judged(program, scratch, m, tests), wanted)
        for mutant, state in zip(wanted, states):
            results[str(mutant["number"])] = state
            results_file.write_text(json.dumps(results))
    print(table(mutants, results))
    for mutant in mutants:
        if results.get(str(mutant["number"])) in ("survived", "unreached"):
            print(results[str(mutant["number"])], mutant["name"])


def table(mutants: list[dict], results: dict[str, str]) -> str:
    """What became of the mutants of each area, in Markdown."""
    lines = ["| area | mutants | viable | caught | timeout | survived | unreached | caught of viable |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for area, folder in AREAS.items():
        here = [m for m in mutants if m["file"].startswith(folder)]
        if not here:
            continue
        states = [results.get(str(m["number"]), "-") for m in here if m["state"] == "built"]
        counts = [states.count(s) for s in ("caught", "timeout", "survived", "unreached")]
        share = 100.0 * sum(counts[:2]) / max(1, len(states))
        cells = [area, len(here), len(states), *counts, f"{share:.0f} %"]
        lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
