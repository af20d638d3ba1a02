"""10,000 objects on 500 cores, event by event, with measured times.

    python eval/fleet/simulate.py [--objects 10000] [--cores 500] [--seconds FILE] [--measured FILE] [--seeds 20]

FILE of --seconds is `seconds.json` beside this (a list `seconds`), or a `fleet.parquet`, whose `cpu_seconds` and `seconds` are taken. --measured is what
`head.py` wrote; what was not measured is left out of the model, and the output says so. Deterministic.

Model: a queue in one order; the head hands out one task after another (`task_s` each); a job holds `--cores-each` cores for its seconds and the
overhead of a job; where workers are lost, a share of all slots vanishes for good at a moment, their jobs start again from the beginning
after the fleet's backoff.
"""

import argparse
import heapq
import json
import random
import statistics
import sys
from collections import deque
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "python"))
from artitwin.fleet.retries import retry


def simulate(seconds, slots, task_s, overhead_s, lost_share=0.0, lost_at=0.0):
    """Makespan, work that was done twice, starts by second; `seconds` in the order of the queue."""
    free = [(0.0, slot) for slot in range(slots)]
    heapq.heapify(free)
    dead = set(range(int(slots * lost_share)))
    queue, later = deque((k, 0) for k in range(len(seconds))), []
    head, end, again, starts = 0.0, 0.0, 0.0, []
    while queue or later:
        at, slot = heapq.heappop(free)
        if lost_share and slot in dead and at >= lost_at:
            continue
        # What was lost goes before the rest as soon as its wait is over.
        if later and (later[0][0] <= at or not queue):
            ready, k, lost = heapq.heappop(later)
        else:
            (k, lost), ready = queue.popleft(), 0.0
        begin = max(at, ready, head) + task_s
        head = begin
        took = seconds[k] + overhead_s
        starts.append(begin)
        if lost_share and slot in dead and begin + took > lost_at:
            again += max(0.0, lost_at - begin)
            heapq.heappush(later, (lost_at + retry(f"object{k}", lost + 1, 0).after_s, k, lost + 1))
            continue
        end = max(end, begin + took)
        heapq.heappush(free, (begin + took, slot))
    return end, again, starts


def peak(starts, window_s=10.0):
    """Most starts a second over a window, after the first fill of all slots."""
    starts = sorted(starts)
    best, first = 0, 0
    for last, at in enumerate(starts):
        while starts[first] < at - window_s:
            first += 1
        best = max(best, last - first + 1)
    return best / window_s


def read_seconds(path):
    if path.suffix == ".parquet":
        from pyarrow import parquet

        rows = parquet.read_table(path, columns=["status", "seconds"]).to_pylist()
        return [row["seconds"] for row in rows if row["status"] in ("done", "degraded")], str(path)
    value = json.loads(path.read_text())
    return value["seconds"], f"{value['what']}; {value['measured']}"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--objects", type=int, default=10_000)
    parser.add_argument("--cores", type=int, default=500)
    parser.add_argument("--cores-each", type=int, default=2)
    parser.add_argument("--seconds", type=Path, default=HERE / "seconds.json")
    parser.add_argument("--measured", type=Path, default=HERE / "measured.json")
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args()
    pool, source = read_seconds(args.seconds)
    measured = json.loads(args.measured.read_text()) if args.measured.exists() else {}
    task_s = 1.0 / measured["tasks_per_s"] if "tasks_per_s" in measured else 0.0
    overhead_s = measured.get("overhead_s", 0.0)
    slots = args.cores // args.cores_each
    mean = statistics.mean(pool)
    print(
        f"Times: {len(pool)} measured, mean {mean:.1f} s, median {statistics.median(pool):.1f}, longest {max(pool):.1f} ({source}).\n"
    )
    left_out = [name for name in ("tasks_per_s", "overhead_s") if name not in measured]
    print(
        f"Head: {1e3 * task_s:.2f} ms a task; overhead of a job {overhead_s:.2f} s. Not measured, so 0: {', '.join(left_out) or 'nothing'}.\n"
    )
    print(
        f"{args.objects} objects on {args.cores} cores, {args.cores_each} a job, {args.seeds} draws; efficiency is work over cores x makespan.\n"
    )
    print("| | makespan, min | efficiency | range | done twice | starts a second, peak |\n|---|---|---|---|---|---|")
    for name, longest_first, share in (
        ("in the table's order", False, 0.0),
        ("longest first", True, 0.0),
        ("longest first, a tenth of the workers lost at half time", True, 0.1),
        ("longest first, a tenth lost near the end (0.95)", True, 0.1001),
    ):
        spans, efficiencies, twice, peaks = [], [], [], []
        for seed in range(args.seeds):
            draw = random.Random(seed)
            seconds = [draw.choice(pool) for _ in range(args.objects)]
            if longest_first:
                seconds.sort(reverse=True)
            ideal = sum(seconds) / slots
            moment = ideal * (0.95 if share > 0.1 else 0.5) if share else 0.0
            span, again, starts = simulate(seconds, slots, task_s, overhead_s, round(share, 2), moment)
            had = slots * span - (int(slots * share) * (span - moment) if share else 0.0)
            spans.append(span / 60.0)
            efficiencies.append(sum(seconds) / had)
            twice.append(again / sum(seconds))
            peaks.append(peak([start for start in starts if start > mean / 2.0]))
        print(
            f"| {name} | {statistics.mean(spans):.1f} | {statistics.mean(efficiencies):.3f} | "
            f"{min(efficiencies):.3f} to {max(efficiencies):.3f} | {100 * statistics.mean(twice):.2f} % | {statistics.mean(peaks):.0f} |"
        )
    print("\nWhere it would stop:\n")
    rate = slots / mean
    print(f"- {slots} slots end {rate:.1f} objects a second.")
    if task_s:
        cores = args.cores_each * mean / task_s
        print(
            f"- Empty tasks: {1 / task_s:.0f} a second on the measuring machine alone, as many as {cores:,.0f} cores end with objects of {mean:.0f} s. A cluster's"
        )
        print("  leases go over the network and its nodes report to the head, so this is a bound from above.")
    if "requests_per_object" in measured:
        requests = measured["requests_per_object"]
        print(
            f"- The store sees {requests * rate:.0f} requests a second ({requests:.0f} an object); S3 takes 3,500 writes and 5,500 reads a second below a"
        )
        print(
            f"  prefix (its makers' number): reached at {3500 / requests * mean * args.cores_each:,.0f} cores, if all were writes of one prefix. Keys are spread by their digest."
        )
    if "turn_ms_per_10000_rows" in measured:
        turn = measured["turn_ms_per_10000_rows"] / 1e3
        print(
            f"- A turn of the command's loop takes {1e3 * turn:.0f} ms at 10,000 rows; it looks every second, so above {1.0 / turn * 10_000:,.0f} rows in a table it falls behind."
        )
    if "head_bytes_per_object" in measured:
        print(
            f"- The command holds {measured['head_bytes_per_object'] / 1e3:.1f} KB an object: {measured['head_bytes_per_object'] * 3e5 / 1e9:.1f} GB for 300,000 rows, its limit."
        )


if __name__ == "__main__":
    main()
