"""Objects an hour: one and two workers on this machine, two and three raylets. For a quiet machine.

    python eval/fleet/throughput.py --out DIR [--program PATH | --fake SECONDS] [--objects 12] [--options "..."]

A worker has one core. Three raylets share the cores of the machine, so three are no faster than two here: it is the cost of more
nodes that is seen. Bytes are of the last run. Writes throughput.json to DIR.
"""

import argparse
import shlex
import shutil

from common import add_program, fleet, keep, objects, timed, use_program


def main():
    parser = argparse.ArgumentParser()
    add_program(parser)
    parser.add_argument("--objects", type=int, default=12)
    args = parser.parse_args()
    use_program(args)
    inputs = objects(args, args.out / "inputs", args.objects)
    from support import raylets, rows

    def run(*more):
        out = args.out / "throughput"
        shutil.rmtree(out, ignore_errors=True)
        table = args.out / "throughput.csv"
        table.write_text("name,inputs\n" + "".join(f"{path.stem},{path}\n" for path in inputs))
        call = fleet("--objects", table, "--out", out, "--cores", 1, *more, "--", *shlex.split(args.options))
        return timed(call)[0], list(rows(out).values())

    print(
        "| | seconds | objects an hour | of the jobs' own seconds | peak memory a job, MB | read / stored, MB |\n|---|---|---|---|---|---|"
    )
    kept = {}
    for name, count, workers in (("1 worker", 0, 1), ("2 workers", 0, 2), ("2 raylets", 2, 2), ("3 raylets", 3, 3)):
        if count:
            with raylets(count) as cluster:
                seconds, found = run("--address", cluster.address)
        else:
            seconds, found = run("--cpus", workers)
        own = sum(row["seconds"] or 0.0 for row in found)
        memory = max(row["peak_memory_bytes"] or 0 for row in found) / 1e6
        read, stored = (sum(row[key] or 0 for row in found) / 1e6 for key in ("bytes_read", "bytes_stored"))
        share = own / workers / seconds
        print(
            f"| {name} | {seconds:.1f} | {3600 * len(found) / seconds:.0f} | {100 * share:.1f} % | {memory:.0f} | {read:.1f} / {stored:.1f} |",
            flush=True,
        )
        kept[name] = {
            "seconds": seconds,
            "objects": len(found),
            "job_seconds": own,
            "peak_memory_mb": memory,
            "read_mb": read,
            "stored_mb": stored,
        }
    keep(args.out / "throughput.json", kept)


if __name__ == "__main__":
    main()
