"""The parts of the fleet that need no cluster.

usage: units.py OUT
"""

import contextlib
import io
import math
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from artitwin import ArtitwinError
from artitwin.fleet import child
from artitwin.fleet.cli import main
from artitwin.fleet.engine import Size
from artitwin.fleet.job import Estimate, Job, Look, Manifest, Outcome
from artitwin.fleet.outputs import Outputs
from artitwin.fleet.retries import MEMORY_STEP, demand, retry
from artitwin.fleet.schedule import Schedule
from artitwin.fleet.store import as_uri
from artitwin.fleet.stragglers import bound, is_straggler, student
from artitwin.fleet.table import Row, read_objects

OUT = Path(sys.argv[1]).resolve()


def refused(call, *words):
    """The words of an error that a call must raise."""
    try:
        call()
    except ArtitwinError as error:
        assert all(word in str(error) for word in words), error
        return
    raise AssertionError("no error")


def tables_are_read():
    (OUT / "a b").mkdir()
    (OUT / "t.csv").write_text("name,inputs,options\nbox,\"x/state0 'a b/y'\",--parts 3\n,s3://bucket/lamp,\n")
    rows = read_objects(str(OUT / "t.csv"), "reconstruct", ["--preset", "preview"])
    assert rows[0].inputs == (f"file://{OUT}/x/state0", f"file://{OUT}/a%20b/y"), rows
    assert rows[0].options == ("--preset", "preview", "--parts", "3") and rows[0].name == "box"
    assert rows[1].inputs == ("s3://bucket/lamp",) and rows[1].label == "lamp" and rows[1].name is None
    columns = {"inputs": [["p", "q"]], "options": [None]}
    parquet.write_table(pa.table(columns), OUT / "t.parquet")
    assert read_objects(str(OUT / "t.parquet"), "reconstruct", [])[0].inputs == (f"file://{OUT}/p", f"file://{OUT}/q")
    for time_ in ("1767225600", '"2026-01-01"', '"2026-01-01T01:00:00+01:00"', '"2026-01-01T00:00:00Z"'):
        (OUT / "t.jsonl").write_text(f'{{"twin": "t.urdf", "runs": ["r 0", "r1"], "machine": "m", "time": {time_}}}\n')
        (log,) = read_objects(str(OUT / "t.jsonl"), "diagnose", [])
        assert log.time == 1767225600.0 and len(log.inputs) == 3 and log.label == "m", log
    assert as_uri("../x", "s3://bucket/a/b") == "s3://bucket/a/x" and as_uri("x", "file:///a") == "file:///a/x"


def tables_are_refused():
    def table(text, command="reconstruct", suffix="csv"):
        path = OUT / f"bad.{suffix}"
        path.write_text(text)
        return lambda: read_objects(str(path), command, [])

    refused(table("name\nbox\n"), "no column inputs")
    refused(table("inputs,nmae\nbox,x\n"), "unknown column `nmae`")
    refused(table("inputs,options\nx,--out=y\n"), "row 1", "`--out=y` is set by the fleet")
    refused(table('inputs\n"\'x"\n'), "row 1", "No closing quotation")
    refused(table("inputs\nx,y\n"), "more cells than the head")
    refused(table("inputs\n"), "names no object")
    refused(table('{"inputs": "x"', suffix="jsonl"), "cannot read")
    refused(table("no parquet", suffix="parquet"), "cannot read")
    refused(table('{"twin": "t", "runs": "r", "time": "yesterday"}', "diagnose", "jsonl"), "is no time")
    refused(lambda: read_objects(str(OUT / "none.csv"), "reconstruct", []), "there is no such file")
    refused(lambda: read_objects("bags", "reconstruct", []), "is no table")
    refused(lambda: read_objects("nope://host/*", "reconstruct", []), "`nope://host` cannot be used", "nope")


def patterns_find_what_a_shell_does():
    for name in ("lab/one/state0", "lab/two/state0", "lab/.hidden/state0", "lab/a b/state0"):
        (OUT / name).mkdir(parents=True)
    found = [row.inputs[0] for row in read_objects(f"{OUT}/lab/*", "reconstruct", [])]
    assert found == [f"file://{OUT}/lab/{name}" for name in ("a%20b", "one", "two")], found
    assert len(read_objects(f"file://{OUT}/lab/*/state[01]", "reconstruct", [])) == 3
    here = Path.cwd()
    os.chdir(OUT)
    assert [row.label for row in read_objects("lab/t*", "reconstruct", [])] == ["two"]
    os.chdir(here)


def nothing_foreign_is_replaced():
    for name, data in (("fleet.html", b"<html>mine</html>"), ("fleet.parquet", b"mine")):
        folder = OUT / f"taken_{name}"
        folder.mkdir()
        (folder / name).write_bytes(data)
        refused(Outputs(as_uri(str(folder)), "reconstruct").refuse_taken, name, "is there")
    folder = OUT / "own"
    outputs = Outputs(as_uri(str(folder)), "reconstruct")
    outputs.refuse_taken()
    outputs.write_all([])
    outputs.refuse_taken()
    assert sorted(path.name for path in folder.iterdir()) == ["fleet.html", "fleet.parquet"]
    parquet.write_table(pa.table({"x": [1]}), folder / "fleet.parquet")
    refused(outputs.refuse_taken, "fleet.parquet")


def retries_end_and_wait():
    waits = [retry("box", lost, 0) for lost in range(1, 7)]
    assert waits[5] is None and all(w and w.memory_factor == 1.0 and 0.0 <= w.after_s <= 2.0**k for k, w in enumerate(waits[:5]))
    assert waits[:5] == [retry("box", lost, 0) for lost in range(1, 6)] and retry("lamp", 1, 0) != waits[0]
    assert retry("box", 2, 2).memory_factor == 2.25
    assert demand(1, 1.0, 0) == MEMORY_STEP and demand(10 << 30, 1.5, 12 << 30) == 12 << 30


def stragglers_are_what_the_sample_allows():
    for p, freedom, known in ((0.975, 1, 12.706), (0.975, 3, 3.182), (0.9995, 10, 4.587), (0.95, 30, 1.697)):
        assert abs(student(p, freedom) - known) < 1e-3
    assert bound([1.0, 1.1], 10) is None and not is_straggler(1e9, 1.0, None)
    # Of lognormal ratios one fleet in twenty has a false name, less by the order statistic.
    draw = random.Random(0)
    false = 0
    for _ in range(400):
        ratios = [math.exp(draw.gauss(0.3, 0.4)) for _ in range(100)]
        limit = bound(ratios[:50], 100)
        false += any(is_straggler(1000.0 * ratio, 1000.0, limit) for ratio in ratios[50:])
    assert false / 400 < 0.10, false
    limit = bound([math.exp(draw.gauss(0.3, 0.4)) for _ in range(50)], 100)
    assert is_straggler(1000.0 * math.exp(0.3 + 6 * 0.4), 1000.0, limit)


class Bench:
    """An engine without a cluster: every job of 1 GB ends as a list of outcomes says."""

    def __init__(self, ends):
        self.ends, self.asked = ends, []

    def look(self, job):
        return ("look", job.row.number)

    def submit(self, job, known, attempt, cores, memory):
        self.asked.append((job.row.number, attempt, cores, memory >> 20))
        return ("work", job.row.number, attempt)

    def wait(self, handles, timeout_s):
        time.sleep(0.01)
        return [(handle, self.end(handle)) for handle in handles]

    def end(self, handle):
        if handle[0] == "look":
            return Look(Estimate(f"key{handle[1]}", 2.0, 1 << 30, 10.0 + handle[1]), "")
        return self.ends[handle[1]][handle[2] - 1]

    def starts(self):
        return []

    def cancel(self, handle):
        pass

    def size(self):
        return Size(4.0, 1, 4.0, 2 << 30)


def lost_jobs_ask_for_more_memory():
    done = Outcome(0, "", 1.0, Manifest("key", "done", 0, None, None, seconds=1.0))
    starved, lost = Outcome(137, "killed", 1.0, lost=True, out_of_memory=True), Outcome(75, "store", 1.0, lost=True)
    refused = Outcome(2, "no such option", 0.0)
    bench = Bench([[done], [starved, starved, lost, done], [refused], [lost, lost]])
    jobs = [Job("reconstruct", Row(n, f"o{n}", ("file:///x",), ()), "file:///out", None, "/", None, None) for n in range(4)]
    schedule = Schedule(bench, jobs, most_retries=3)
    schedule.items[3].lost = ["before", "before"]
    schedule.look()
    schedule.run()
    assert [item.status for item in schedule.items] == ["done", "done", "refused", "failed"]
    # The longest first; memory in steps, half as much more for each that may have starved, and no more than a node has.
    assert [number for number, attempt, *_ in bench.asked if attempt == 1] == [3, 2, 1, 0], bench.asked
    assert [ask[3] for ask in bench.asked if ask[0] == 1] == [1024, 1536, 2048, 2048], bench.asked
    assert all(ask[2] == 2.0 for ask in bench.asked) and schedule.retried == 4


def each_row_has_a_command_line():
    (OUT / "jobs.csv").write_text("inputs\nx\ny\n")
    call = ["--objects", str(OUT / "jobs.csv"), "--out", "s3://lab/twins"]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main([*call, "--print-jobs", "--", "--set", "a=b c"]) == 0
    lines = [shlex.split(line) for line in printed.getvalue().splitlines()]
    assert lines == [["artitwin", "fleet", f"--row={n}", *call, "--", "--set", "a=b c"] for n in (1, 2)], lines
    with contextlib.redirect_stderr(printed):
        assert main([*call, "--row", "3"]) == 1 and "there are 2 rows" in printed.getvalue()


def a_child_dies_with_its_parent():
    code = "from artitwin.fleet import child; child.run(['/bin/sleep', '60.25'], {}, None, None)"
    parent = subprocess.Popen([sys.executable, "-c", code])

    def sleeps():
        found = []
        for entry in Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and (entry / "cmdline").read_bytes() == b"/bin/sleep\x0060.25\x00":
                    found.append(entry.name)
            except OSError:
                continue
        return found

    end = time.monotonic() + 20
    while not sleeps() and time.monotonic() < end:
        time.sleep(0.05)
    assert len(sleeps()) == 1
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    end = time.monotonic() + 5
    while sleeps() and time.monotonic() < end:
        time.sleep(0.05)
    assert not sleeps(), "the child lives"


def what_a_child_did_is_known():
    script = "echo one; echo last; echo 'error: why' >&2; exit 7"
    ended = child.run(["/bin/sh", "-c", script], {}, None, None)
    assert (ended.exit_code, ended.last_line, ended.message) == (7, "last", "error: why"), ended
    assert ended.peak_memory_bytes > 0 and not ended.overtime
    ended = child.run(["/bin/sleep", "60"], {}, None, 0.3)
    assert ended.overtime and ended.exit_code == -signal.SIGINT and ended.seconds < 5.0, ended
    assert child.run(["/no/such/program"], {}, None, None).exit_code == 127
    assert child.run(["/bin/sh", "-c", "kill -9 $$"], {}, None, None).exit_code == -9


def all_parts():
    assert "ray" not in sys.modules, "ray is imported where a cluster is used"
    tables_are_read()
    tables_are_refused()
    patterns_find_what_a_shell_does()
    nothing_foreign_is_replaced()
    retries_end_and_wait()
    stragglers_are_what_the_sample_allows()
    lost_jobs_ask_for_more_memory()
    each_row_has_a_command_line()
    a_child_dies_with_its_parent()
    what_a_child_did_is_known()


if __name__ == "__main__":
    all_parts()
