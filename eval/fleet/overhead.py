"""Seconds that the fleet adds to an object, beside a plain shell loop and GNU parallel. For a quiet machine.

    python eval/fleet/overhead.py --out DIR [--program PATH | --fake SECONDS] [--objects 12] [--repeat 3] [--options "..."]

The same command lines (`--print-jobs`: a job without Ray), one job at a time, into an empty folder each. What a call costs once (Ray's start and end) is separated from what
it costs an object by halves: N and N/2 objects. Needs `parallel` (Debian package). Writes overhead.json to DIR.
"""

import argparse
import shlex
import shutil
import statistics
import subprocess
import sys

from common import add_program, fleet, keep, objects, timed, use_program


def lines(args, inputs, out, name):
    """A file with the command lines of all objects."""
    table = args.out / f"{name}.csv"
    table.write_text("name,inputs\n" + "".join(f"{path.stem},{path}\n" for path in inputs))
    command = fleet("--objects", table, "--out", out, "--print-jobs", "--", *shlex.split(args.options))
    printed = subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True).stdout
    file = args.out / f"{name}.txt"
    own = f"{shlex.quote(sys.executable)} -m artitwin.fleet"
    # Degraded (3) and refused (1) are results.
    file.write_text("".join(f"{own}{line[len('artitwin fleet') :]} || [ $? = 3 -o $? = 1 ]\n" for line in printed.splitlines()))
    return table, file


def once(args, inputs, way, k):
    """Seconds of all objects by a way."""
    name = f"{way}_{len(inputs)}_{k}"
    out = args.out / name
    shutil.rmtree(out, ignore_errors=True)
    table, file = lines(args, inputs, out, name)
    command = {
        "shell loop": ["bash", "-c", f'set -e; while read -r line; do eval "$line" >/dev/null; done < {shlex.quote(str(file))}'],
        "GNU parallel": ["bash", "-c", f"parallel -j1 < {shlex.quote(str(file))} >/dev/null"],
        "fleet": fleet(
            "--objects", table, "--out", out, "--cpus", args.cores, "--cores", args.cores, "--", *shlex.split(args.options)
        ),
    }[way]
    seconds, _ = timed(command)
    shutil.rmtree(out, ignore_errors=True)
    return seconds


def main():
    parser = argparse.ArgumentParser()
    add_program(parser)
    parser.add_argument("--objects", type=int, default=12)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--cores", type=int, default=2)
    args = parser.parse_args()
    use_program(args)
    inputs = objects(args, args.out / "inputs", args.objects)
    half = inputs[: len(inputs) // 2]
    ways = ["shell loop", "GNU parallel", "fleet"] if shutil.which("parallel") else ["shell loop", "fleet"]
    # Round by round, so that a slow minute falls on all of them.
    seconds = {way: ([], []) for way in ways}
    for k in range(args.repeat):
        for way in ways:
            seconds[way][0].append(once(args, half, way, k))
            seconds[way][1].append(once(args, inputs, way, k))
    print("| | seconds an object | fixed, s | over the shell loop |\n|---|---|---|---|")
    table = {}
    for way in ways:
        short, long = (statistics.median(times) for times in seconds[way])
        each = (long - short) / (len(inputs) - len(half))
        table[way] = {"each_s": each, "fixed_s": short - each * len(half), "all": seconds[way]}
    plain = table["shell loop"]["each_s"]
    for way, row in table.items():
        print(f"| {way} | {row['each_s']:.3f} | {row['fixed_s']:.2f} | {100 * (row['each_s'] / plain - 1):+.2f} % |")
    keep(args.out / "overhead.json", {"overhead_s": max(0.0, table["fleet"]["each_s"] - plain), "ways": table})


if __name__ == "__main__":
    main()
