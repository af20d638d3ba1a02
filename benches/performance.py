#!/usr/bin/env python3
"""Measures everything of the performance tables in docs/figures.md in one run and prints them as Markdown.

    benches/performance.py [--objects FOLDER:PARTS ...] [--preset NAME ...] [--seeds N] [--peers PYTHON] [--out DIR]

An object is a folder with state0, state1 and, for accuracy, truth.json and truth/. Without objects two of `bags/`.
`--peers` is a Python with torch, open3d, rosbags, scipy and pillow; peers that cannot be imported are left
out, and said to be. Run it with nothing else on the machine: times are wall times.
"""

import argparse
import datetime
import json
import os
import platform
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "artitwin"


def run(command, **options):
    return subprocess.run([str(c) for c in command], cwd=ROOT, capture_output=True, text=True, **options)


def machine():
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    commit = run(["git", "describe", "--always", "--dirty"]).stdout.strip()
    load = os.getloadavg()[0]
    return (f"{cpu[1] if cpu else platform.processor()}, {os.cpu_count()} threads, {datetime.date.today()}, commit {commit}, "
            f"load {load:.1f} at the start")


def peer(python, script, *arguments):
    """The JSON line of a peer, or why there is none."""
    if not python:
        return None, "no --peers given"
    ended = run([python, ROOT / "benches" / "peers" / script, *arguments])
    if ended.returncode:
        return None, ended.stderr.strip().splitlines()[-1]
    return json.loads(ended.stdout.strip().splitlines()[-1]), None


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(str(c) for c in row) + " |" for row in rows])


def steps(python):
    ended = run(["cargo", "bench", "--bench", "step"])
    if ended.returncode:
        sys.exit(ended.stderr)
    found = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
    head, engines = found[0], found[1:]
    torch, missing = peer(python, "torch_step.py")
    engines += [torch] if torch else []
    ours = engines[0]["step_ms"]
    rows = [(e["engine"], f"{e['step_ms']:.0f}", f"{e['median_ms']:.0f}", f"{head['points'] / e['step_ms'] / 1000:.2f}",
             f"{e['step_ms'] / ours:.1f}", f"{100 * e['networks_share_of_peak']:.0f} %" if "networks_share_of_peak" in e else "")
            for e in engines]
    print(f"One training step of {head['points']} points, 16 levels of 2^17 entries; measured peak of the processor "
          f"{head['peak_gflops']:.0f} Gflop/s in f32.\n")
    print(table(["engine", "best, ms", "median, ms", "Mpoint/s", "ratio", "networks, share of peak"], rows) + "\n")
    if missing:
        print(f"PyTorch: not measured ({missing}).\n")


def reconstruct(folder, parts, preset, seed, out):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    command = [PROGRAM, "reconstruct", folder, "--preset", preset, "--seed", seed, "--out", out]
    ended = run(["/usr/bin/env", "time", "-f", "%M", *command, *(["--parts", parts] if parts else [])])
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if ended.returncode not in (0, 3):
        return {"error": ended.stderr.strip().splitlines()[-2]}
    memory = int(ended.stderr.strip().splitlines()[-1]) / 1e6
    report = json.loads((out / folder.name / "report.json").read_text())
    return {"wall": wall, "cpu": cpu, "memory": memory, "stages": {s["name"]: s["seconds"] for s in report["stages"]}}


def accuracy(folder, result):
    """Joint errors and surface figures, both states' mean."""
    if not (folder / "truth.json").is_file():
        return ["", "", ""]
    ended = run([PROGRAM, "evaluate", result, "--truth", folder, "--json"])
    if ended.returncode:
        return [ended.stderr.strip().splitlines()[-1], "", ""]
    found = json.loads(ended.stdout)
    of = lambda j, k, unit: f"{j[k]:.3f} {unit}" if k in j and j[k] is not None else ""
    joints = ["; ".join(filter(None, [("" if j["type_right"] else "WRONG TYPE"), of(j, "axis_deg", "deg"), of(j, "axis_mm", "mm"),
                                      of(j, "motion_deg", "deg"), of(j, "motion_mm", "mm")])) for j in found["trials"][0]["joints"]]
    mean = lambda key: sum(found["trials"][0]["mesh"][f"state{s}/whole"][key] for s in (0, 1)) / 2
    return ["<br>".join(joints), f"{mean('seen_mm'):.2f}", f"{mean('accuracy_mm'):.2f}"]


def objects(arguments):
    rows, stages = [], []
    for text in arguments.objects:
        path, _, parts = text.partition(":")
        folder = Path(path).resolve()
        fused, missing = peer(arguments.peers, "open3d_fusion.py", folder, arguments.out / "open3d" / folder.name)
        for preset in arguments.preset:
            runs = [reconstruct(folder, parts, preset, seed, arguments.out / f"{preset}-{seed}") for seed in range(arguments.seeds)]
            if "error" in runs[0]:
                rows.append((folder.name, preset, runs[0]["error"], "", "", "", "", "", ""))
                continue
            best = min(runs, key=lambda r: r["wall"])
            ours = sum(v for k, v in best["stages"].items() if k.startswith(("fusion", "surface")))
            ratio = f"{ours / fused['fuse_s']:.2f}" if fused else ""
            rows.append((folder.name, preset, f"{best['wall']:.1f}", f"{best['cpu']:.1f}", f"{max(r['memory'] for r in runs):.2f}",
                         *accuracy(folder, arguments.out / f"{preset}-0" / folder.name), ratio))
            stages.append(f"{folder.name}, {preset}: " + ", ".join(f"{k} {v:.1f}" for k, v in best["stages"].items()))
        if missing:
            print(f"Open3D on {folder.name}: not measured ({missing}).\n")
    header = ["object", "preset", "wall, s", "processor, s", "memory, GB", "axis; line; motion", "seen, mm", "accuracy, mm",
              "fuse and mesh / Open3D"]
    print(table(header, rows) + "\n\nStages, seconds:\n\n" + "\n".join(f"- {s}" for s in stages))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=[f"{ROOT}/bags/drawer:2", f"{ROOT}/bags/laptop:2"])
    parser.add_argument("--preset", nargs="+", default=["default", "preview"])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--peers")
    parser.add_argument("--out", type=Path, default=Path("/tmp/artitwin-performance"))
    parser.add_argument("--no-steps", action="store_true", help="leave out the training steps")
    arguments = parser.parse_args()
    if run(["cargo", "build", "--release"]).returncode:
        sys.exit("the program does not build")
    print(machine() + "\n")
    if not arguments.no_steps:
        steps(arguments.peers)
    objects(arguments)


if __name__ == "__main__":
    main()
