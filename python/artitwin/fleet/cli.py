"""`artitwin fleet`."""

import argparse
import os
import shlex
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType
from typing import TYPE_CHECKING, Any

from ..errors import ArtitwinError

if TYPE_CHECKING:
    from .schedule import Schedule

DONE, FAILED, USAGE, PARTLY, STOPPED = 0, 1, 2, 3, 130
"""Exit codes."""
_TABLE_S = 60.0
"""How often the table is written while jobs run: what a lost head loses of it."""
_METRICS_S = 2.0
"""derived: Prometheus asks every 10 s or so."""
NEEDS = "artitwin fleet needs ray, pyarrow and fsspec: pip install 'artitwin[fleet]'"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and gives its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    common: list[str] = []
    if "--" in given:
        place = given.index("--")
        given, common = given[:place], given[place + 1 :]
    options = _parser().parse_args(given)
    options.given = [word for word in given if word != "--print-jobs"]
    signal.signal(signal.SIGTERM, _interrupt)
    # A shell starts what runs in the background with this signal ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return _fleet(options, common)
    except ArtitwinError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("ray", "pyarrow", "fsspec"):
            raise
        print(f"error: {NEEDS}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("stopped; the same call goes on from what stands", file=sys.stderr)
        return STOPPED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="artitwin fleet",
        description="Runs reconstruct or diagnose on many objects with Ray.",
        epilog="What follows `--` are options of every job, e.g. `-- --preset preview`. See docs/fleet.md.",
        allow_abbrev=False,
    )
    add = parser.add_argument
    add(
        "--objects",
        required=True,
        metavar="TABLE|GLOB",
        help=".csv, .jsonl or .parquet, or a quoted pattern of paths",
    )
    add("--out", required=True, metavar="URI", help="store of all results: a folder, s3://, gs://, az://, ...")
    add(
        "--command",
        choices=("reconstruct", "diagnose"),
        default="reconstruct",
        help="what a job is [reconstruct]",
    )
    add("--address", metavar="ADDRESS", help="a Ray cluster, or auto [this machine]")
    add("--estimate", action="store_true", help="says what it would take, and runs nothing")
    add("--print-jobs", action="store_true", help="prints a command line a row, for another scheduler")
    add("--row", type=_positive, metavar="N", help="runs row N alone, in this process and without Ray")
    add("--cpus", type=_positive, metavar="N", help="cores of this machine to use [all]; not with --address")
    add("--cores", type=_positive, metavar="N", help="cores of a job [its estimate]")
    add("--retries", type=int, metavar="N", help="how often a lost job is tried again [5]")
    add(
        "--limit",
        type=float,
        metavar="SECONDS",
        help="a job that takes longer is stopped and tried again [none]",
    )
    add("--scratch", metavar="DIR", help="folder on the nodes for what jobs fetch [that for temporary files]")
    add("--dashboard", action="store_true", help="starts Ray's dashboard on this machine")
    return parser


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return number


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _fleet(options: argparse.Namespace, common: Sequence[str]) -> int:
    from .job import Job
    from .outputs import Outputs
    from .progress import Progress
    from .store import as_uri
    from .table import read_objects

    rows = read_objects(options.objects, options.command, common)
    out = as_uri(options.out)
    named = os.environ.get("ARTITWIN_PROGRAM")
    if named is None and options.address is None:
        # The program that was called as `artitwin fleet`; nodes of a cluster have their own.
        named = os.environ.get("ARTITWIN")
    scratch = os.path.abspath(options.scratch) if options.scratch else None
    jobs = [
        Job(
            options.command,
            row,
            out,
            os.path.abspath(named) if named else None,
            os.getcwd(),
            scratch,
            options.limit,
        )
        for row in rows
    ]
    if options.print_jobs:
        behind = ["--", *common] if common else []
        for job in jobs:
            print(shlex.join(["artitwin", "fleet", f"--row={job.row.number + 1}", *options.given, *behind]))
        return DONE
    if options.row is not None:
        return _one(jobs, options.row, options.cores)
    outputs = Outputs(out, options.command)
    outputs.refuse_taken()
    progress = Progress()
    try:
        return _with_cluster(options, jobs, outputs, progress)
    finally:
        progress.close()


def _one(jobs: Any, number: int, cores: int | None) -> int:
    """Does one job, and prints its manifest's place; what may pass ends with the program's code for that."""
    from .perform import work

    if number > len(jobs):
        raise ArtitwinError(f"--row {number}: there are {len(jobs)} rows")
    job = jobs[number - 1]
    outcome = work(job, None, cores or os.cpu_count() or 1)
    if outcome.manifest is not None:
        print(f"{job.out}/{outcome.manifest.key}.json")
    if outcome.message:
        print(f"error: {outcome.message}", file=sys.stderr)
    return outcome.exit_code if outcome.exit_code >= 0 else 128 - outcome.exit_code


def _with_cluster(options: argparse.Namespace, jobs: Any, outputs: Any, progress: Any) -> int:
    from .cluster import Cluster
    from .metrics import Metrics
    from .retries import MOST_RETRIES
    from .schedule import Schedule
    from .store import Folder, StoreError

    cluster = Cluster(options.address, options.cpus, options.dashboard)
    # Ray puts a handler of its own in its place.
    signal.signal(signal.SIGTERM, _interrupt)
    metrics = Metrics(options.command)
    due = {"table": time.monotonic() + _TABLE_S, "metrics": 0.0}

    def change(schedule: "Schedule") -> None:
        progress.change(schedule)
        now = time.monotonic()
        if now >= due["metrics"]:
            metrics.change(schedule)
            due["metrics"] = now + _METRICS_S
        if now >= due["table"] and schedule.has_begun and not options.estimate:
            try:
                outputs.write_table(schedule.items)
            except StoreError as error:
                # The next one may succeed; jobs go on.
                progress.say(f"warning: {error}")
            due["table"] = time.monotonic() + _TABLE_S

    retries = MOST_RETRIES if options.retries is None else options.retries
    schedule = Schedule(
        cluster, jobs, cores=options.cores, most_retries=retries, on_change=change, on_end=progress.end
    )
    try:
        schedule.look()
        progress.say(forecast(schedule))
        if options.estimate:
            return DONE
        if isinstance(outputs.store, Folder) and schedule.size.nodes > 1:
            progress.say(f"note: all {schedule.size.nodes} nodes must share the folder of --out")
        try:
            schedule.run()
        finally:
            outputs.write_all(schedule.items)
            metrics.change(schedule)
    finally:
        cluster.close()
    return _end(schedule, outputs, progress)


def forecast(schedule: "Schedule") -> str:
    """What the estimates say before anything runs."""
    from .progress import duration

    rows = schedule.items
    ahead = [item for item in rows if item.status == "waiting" and item.twin_of is None]
    known = [item.estimate for item in ahead if item.estimate is not None]
    work = sum(e.seconds * (schedule.cores or e.cores) for e in known)
    parts = [f"{len(rows)} objects, {sum(item.standing for item in rows)} stand, {len(ahead)} to do"]
    if known:
        read, stored = sum(e.bytes_read for e in known), sum(e.bytes_stored for e in known)
        parts.append(f"{work / 3600.0:.2f} core hours")
        parts.append(f"up to {max(e.memory_bytes for e in known) / 2**30:.1f} GB a job")
        parts.append(f"{read / 2**30:.2f} of {stored / 2**30:.2f} GB to read")
        left = schedule.seconds_left()
        if left:
            parts.append(f"about {duration(left)} on {schedule.size.cpus:.0f} cores")
    if len(known) < len(ahead):
        parts.append(f"{len(ahead) - len(known)} without an estimate")
    return ", ".join(parts)


def _end(schedule: "Schedule", outputs: Any, progress: Any) -> int:
    counts = schedule.counts()
    said = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    progress.say(f"{len(schedule.items)} objects: {said}; retried {schedule.retried}")
    versions = sorted(
        {i.outcome.manifest.version for i in schedule.items if i.outcome and i.outcome.manifest} - {""}
    )
    if len(versions) > 1:
        progress.say(f"warning: nodes have different programs: {', '.join(versions)}")
    for place in outputs.written:
        print(place)
    if counts["failed"]:
        return FAILED
    return PARTLY if counts["degraded"] or counts["refused"] else DONE
