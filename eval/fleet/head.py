"""What the head does: tasks a second by empty tasks, and memory of it and of the command for many rows.

    python eval/fleet/head.py --out DIR [--tasks 2000] [--rows 10000]

Writes tasks_per_s and head_bytes_per_object to DIR/measured.json, which `simulate.py --measured` reads.
"""

import argparse
import os
import resource
import time
from pathlib import Path

from common import keep


def memory_mb(word):
    """Resident memory of the processes of this user whose command line holds a word."""
    total = 0
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and word.encode() in (folder / "cmdline").read_bytes():
                total += int((folder / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        except OSError:
            continue
    return total / 1e6


def rows_memory(count):
    """Bytes that the command holds a row of joints and warnings, by its own classes."""
    from artitwin.fleet.job import Estimate, Job, Look, Manifest, Outcome
    from artitwin.fleet.results import row, schema, table_bytes
    from artitwin.fleet.schedule import Item
    from artitwin.fleet.summary import Joint, Summary
    from artitwin.fleet.table import Row

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    items = []
    for k in range(count):
        item = Item(
            Job("reconstruct", Row(k, f"object_{k}", (f"s3://bucket/object_{k}",), ()), "s3://bucket/out", None, "/", None, None)
        )
        joints = tuple(
            Joint(f"joint_{j}", "revolute", (0.0, 0.0, 1.0 + k), (k + 0.1, 0.2, 0.3), k + 1.5, "rad", k + 0.3, 0.2, 0.01)
            for j in range(2)
        )
        manifest = Manifest(f"{k:032x}", "done", 0, None, f"{k:032x}/object_{k}", f"object_{k}")
        item.look = Look(Estimate(f"{k:032x}", 2.0, k, 40.0 + k), "")
        item.outcome, item.status = Outcome(0, "", 40.0 + k, manifest, Summary(3, joints, "usable")), "done"
        items.append(item)
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.monotonic()
    data = table_bytes([row(item, item.job.out) for item in items], schema("reconstruct"))
    wrote = time.monotonic() - start
    return (
        (held - before) * 1024 / count,
        (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 / count,
        len(data) / count,
        wrote,
    )


def turn_ms(count):
    """Milliseconds of a turn of the command's loop over so many rows, of which half have ended."""
    from artitwin.fleet.engine import Size
    from artitwin.fleet.job import Estimate, Job, Look
    from artitwin.fleet.progress import counted
    from artitwin.fleet.schedule import Schedule
    from artitwin.fleet.table import Row

    jobs = [
        Job("reconstruct", Row(k, None, ("s3://bucket/x",), ()), "s3://bucket/out", None, "/", None, None) for k in range(count)
    ]
    schedule = Schedule(None, jobs)
    schedule.size = Size(500.0, 63, 8.0, 16 << 30)
    schedule.ratios = [0.9 + k / count for k in range(count // 2)]
    for k, item in enumerate(schedule.items):
        item.look, item.status = Look(Estimate(f"{k:032x}", 2.0, 1 << 30, 40.0), ""), "done" if k % 2 else "waiting"
    start = time.monotonic()
    for _ in range(5):
        counted(schedule)
    return (time.monotonic() - start) / 5 * 1e3


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", type=int, default=2000)
    parser.add_argument("--rows", type=int, default=10_000)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    held, peak, in_table, wrote = rows_memory(args.rows)
    print(
        f"{args.rows} rows: {held / 1e3:.1f} KB each held, {peak / 1e3:.1f} KB at the peak of writing the table ({in_table:.0f} bytes each there, {wrote:.1f} s)"
    )
    turns = {rows: turn_ms(rows) for rows in (1000, 10_000, 100_000)}
    print("a turn of the loop: " + ", ".join(f"{turn:.1f} ms at {rows} rows" for rows, turn in turns.items()))
    import ray

    ray.init(address="local", include_dashboard=False, object_store_memory=100 << 20, log_to_driver=False, logging_level="ERROR")
    empty = ray.remote(max_retries=0)(lambda: None)
    ray.get([empty.remote() for _ in range(50)])
    before = memory_mb("gcs_server"), memory_mb("raylet/raylet")
    start = time.monotonic()
    ray.get([empty.remote() for _ in range(args.tasks)])
    rate = args.tasks / (time.monotonic() - start)
    after = memory_mb("gcs_server"), memory_mb("raylet/raylet")
    print(f"{args.tasks} empty tasks: {rate:.0f} a second on {os.cpu_count()} cores")
    print(f"gcs_server {before[0]:.0f} -> {after[0]:.0f} MB, raylet {before[1]:.0f} -> {after[1]:.0f} MB")
    ray.shutdown()
    keep(
        args.out / "measured.json",
        {
            "tasks_per_s": rate,
            "head_bytes_per_object": peak,
            "turn_ms_per_10000_rows": turns[10_000],
            "gcs_mb": after[0],
            "raylet_mb": after[1],
        },
    )


if __name__ == "__main__":
    main()
