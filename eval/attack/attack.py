#!/usr/bin/env python3
"""Attacks the program as a careless user, a damaged disk and a hostile neighbor would, and writes a table of what came of it.

    python eval/attack/attack.py target/release/artitwin --inputs 8700 --table eval/attack/results.md
"""
import argparse
import platform
import subprocess
import sys
import time
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

import costly
import files
import inputs
import kills
import node
import outcomes
import twins

FAMILIES = ("inputs", "costly", "twins", "files", "kills", "node")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("--work", type=Path, default=Path("/tmp/artitwin-attack"), help="folder of its own; what was bad is kept in kept/")
    parser.add_argument("--only", nargs="+", choices=FAMILIES, default=FAMILIES)
    parser.add_argument("--inputs", type=int, default=900, help="mutated inputs in all")
    parser.add_argument("--kills", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    binary, work = args.binary.resolve(), args.work.resolve()
    (work / "kept").mkdir(parents=True, exist_ok=True)
    begin, found = time.time(), []
    version = subprocess.run([binary, "--version"], capture_output=True, text=True).stdout.strip()

    def add(*families):
        """What is whole is written, so that a run that is stopped has reported something."""
        found.extend(families)
        heading = (
            f"{version}, {time.strftime('%Y-%m-%d')}, {platform.machine()}, seed {args.seed}, {(time.time() - begin) / 60:.0f} minutes. "
            "Outcomes are exit codes; `held` and `broken` are demands that no process answers by its exit code."
        )
        table = outcomes.markdown(found, heading)
        if args.table:
            args.table.write_text("# Attacks\n\nWritten by `eval/attack/attack.py`.\n\n" + table)
        return table

    if "costly" in args.only:
        add(costly.all_of(binary, work))
    if "twins" in args.only:
        add(twins.refused(binary, work), twins.names(binary, work))
    if "files" in args.only:
        add(files.all_of(binary, work))
    if "kills" in args.only:
        add(kills.all_of(binary, work, args.kills, args.seed))
    if "node" in args.only:
        add(*node.all_of(binary, work))
    if "inputs" in args.only:
        for share, attack in ((0.5, inputs.bags), (0.2, inputs.datasets), (0.15, inputs.urdfs), (0.15, inputs.joint_logs)):
            add(attack(binary, work, round(share * args.inputs), args.seed))
    print(add())
    sys.exit(1 if any(f.bad for f in found) else 0)


if __name__ == "__main__":
    main()
