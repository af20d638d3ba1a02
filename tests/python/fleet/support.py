"""What the tests of the fleet share: a small Ray cluster, calls of the command, kills, and what a log of the fake program
shows."""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
# Of what the workers print the tests read nothing.
os.environ["RAY_DEDUP_LOGS"] = "0"

FAKE = Path(__file__).with_name("fake.py")
STORE_BYTES = 80 << 20


@contextmanager
def raylets(count, cpus=1):
    """A cluster of so many raylets of some cores on this machine; the first is its head."""
    from ray.cluster_utils import Cluster

    given = {"num_cpus": cpus, "object_store_memory": STORE_BYTES}
    cluster = Cluster(initialize_head=True, head_node_args={**given, "include_dashboard": False})
    try:
        cluster.others = [cluster.add_node(**given) for _ in range(count - 1)]
        yield cluster
    finally:
        cluster.shutdown()


def started(*arguments, **environment):
    """The command, started."""
    command = [sys.executable, "-m", "artitwin.fleet", *map(str, arguments)]
    env = {**os.environ, **{key: str(value) for key, value in environment.items()}}
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def fleet(*arguments, code, **environment):
    """Runs the command, which must end with an exit code; gives what it said."""
    process = started(*arguments, **environment)
    printed, said = process.communicate(timeout=300)
    assert process.returncode == code, f"exit code {process.returncode}, not {code}:\n{printed}{said}"
    return said


def rows(out, name="fleet.parquet"):
    """A table, by name of the rows."""
    from pyarrow import parquet

    return {row["name"]: row for row in parquet.read_table(Path(out) / name).to_pylist()}


def write_rows(path, values):
    """A table as JSON lines."""
    Path(path).write_text("".join(json.dumps(value) + "\n" for value in values))


def log(folder):
    """What the fake program did, but for estimates: what, key, process, time."""
    path = Path(folder) / "log"
    lines = [line.split() for line in path.read_text().splitlines()] if path.exists() else []
    return [(what, key, int(pid), float(at)) for what, key, pid, at in lines if what != "look"]


def once_each(lines):
    """Every job was done once, and no attempt worked after the next one of the same key had begun."""
    keys = {key for _, key, _, _ in lines}
    for key in keys:
        own = [line for line in lines if line[1] == key]
        assert sum(what == "end" for what, *_ in own) <= 1, own
        begun = [(at, pid) for what, _, pid, at in own if what == "start"]
        for (_, pid), (at, _) in pairwise(begun):
            late = [line for line in own if line[2] == pid and line[3] > at]
            assert not late, f"two writers of {key}: {late}"
    return keys


def workers(of):
    """Processes that run a job of a cluster, by what Ray calls them; `of` are pids of its raylets."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and b"ray::_work" in (folder / "cmdline").read_bytes():
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                if parent in of:
                    found.append(int(folder.name))
        except OSError:
            continue
    return sorted(found)


def raylet_pids(cluster):
    """Of the raylets that live."""
    return {info.process.pid for node in cluster.list_all_nodes() for info in node.all_processes.get("raylet", [])}


class Killer(threading.Thread):
    """Kills one worker at a time, at seeded moments, while a command runs."""

    def __init__(self, cluster, kills, mean_s, seed=0):
        super().__init__(daemon=True)
        self.cluster, self.kills, self.mean_s = cluster, kills, mean_s
        self.random = random.Random(seed)
        self.killed = 0
        self.over = threading.Event()

    def run(self):
        while self.killed < self.kills and not self.over.wait(self.random.uniform(0.2, 1.8) * self.mean_s):
            found = workers(raylet_pids(self.cluster))
            if found:
                try:
                    os.kill(self.random.choice(found), signal.SIGKILL)
                    self.killed += 1
                except ProcessLookupError:
                    pass


def until(condition, seconds=60.0):
    """Waits for something to be true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.05)


def files_below(store, path=""):
    """All files of a store, by path."""
    for name, is_folder in store.children(1_000_000, path):
        at = f"{path}/{name}" if path else name
        if is_folder:
            yield from files_below(store, at)
        else:
            yield at


def whole(out):
    """Manifests of a store by key. Every file that one lists is there with its bytes, and there is no other file but the
    tables: nothing is half-written."""
    from artitwin.fleet.store import open_store

    store = open_store(out)
    paths = set(files_below(store))
    manifests, listed = {}, set()
    for path in sorted(path for path in paths if "/" not in path and path.endswith(".json")):
        manifest = json.loads(store.read(path, 1 << 30))
        manifests[manifest["key"]] = manifest
        listed.add(path)
        for file in manifest["files"]:
            at = f"{manifest['folder']}/{file['path']}"
            data = store.read(at, 1 << 30)
            assert data is not None and hashlib.sha256(data).hexdigest() == file["sha256"], at
            listed.add(at)
    left = paths - listed - {"fleet.parquet", "fleet.html"}
    unfinished = sorted(path for path in left if path.split("/")[0] in manifests or "/" not in path)
    assert not unfinished, unfinished
    return manifests


HOLD_TIMES = ("report.json", "report.html", "manifest.json")
"""Files of a result that hold the seconds of its stages, which no two runs share."""


def as_plain(manifest, folder):
    """Whether the files of a job are those of the plain command in a folder, but for `HOLD_TIMES`."""
    of_job = {file["path"]: file["sha256"] for file in manifest["files"] if file["path"] not in HOLD_TIMES}
    found = {}
    for path in Path(folder).rglob("*"):
        name = str(path.relative_to(folder))
        if path.is_file() and name not in HOLD_TIMES:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    assert of_job == found, sorted(set(of_job.items()) ^ set(found.items()))[:6]


def whole_keys(out):
    """Keys of the manifests that stand, by the listing alone."""
    from artitwin.fleet.store import StoreError, open_store

    try:
        names = [name for name, is_folder in open_store(out).children(1_000_000) if not is_folder]
    except StoreError:
        return []
    return [name[:-5] for name in names if name.endswith(".json")]


def rows_of(out):
    """The table in a store, by name of the rows."""
    from artitwin.fleet.store import open_store
    from pyarrow import BufferReader, parquet

    data = open_store(out).read("fleet.parquet", 1 << 30)
    return {row["name"]: row for row in parquet.read_table(BufferReader(data)).to_pylist()}
