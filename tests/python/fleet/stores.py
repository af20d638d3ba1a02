"""Jobs of the fake program on a store in memory that fails, changes and lies.

usage: stores.py OUT
"""

import functools
import hashlib
import http.server
import json
import os
import random
import sys
import threading
from pathlib import Path

import fsspec
from fsspec.implementations.memory import MemoryFileSystem
from support import FAKE, log, whole

from artitwin.fleet import remote
from artitwin.fleet.inputs import TWIN, TWIN_WITH_MESHES, fetch, find, outline, place
from artitwin.fleet.job import Job
from artitwin.fleet.perform import look, work
from artitwin.fleet.scratch import held
from artitwin.fleet.store import MayPassError, StoreError, as_uri, open_store
from artitwin.fleet.table import Row

OUT = Path(sys.argv[1]).resolve()
os.environ["FAKE_LOG"] = str(OUT)
(OUT / "log").touch()
remote._WAITS_S = (0.0,) * 12


class Lab(MemoryFileSystem):
    """A store in memory with faults, seeded."""

    protocol = "lab"
    share, random = 0.0, random.Random(1)
    at_fetch = None
    """What happens, once, when a file is fetched: gets the file's path and where it goes."""
    fetched = 0

    @classmethod
    def _strip_protocol(cls, path):
        return super()._strip_protocol(path.removeprefix("lab://"))

    def fail(self):
        if Lab.random.random() < Lab.share:
            raise TimeoutError("the store is slow")

    def info(self, path, **kwargs):
        self.fail()
        return super().info(path, **kwargs)

    def cat_file(self, path, start=None, end=None, **kwargs):
        self.fail()
        return super().cat_file(path, start, end, **kwargs)

    def pipe_file(self, path, value, mode="overwrite", **kwargs):
        self.fail()
        return super().pipe_file(path, value, mode, **kwargs)

    def get_file(self, rpath, lpath, **kwargs):
        self.fail()
        super().get_file(rpath, lpath, **kwargs)
        Lab.fetched += 1
        act, Lab.at_fetch = Lab.at_fetch, None
        if act is not None:
            act(rpath, Path(lpath))


fsspec.register_implementation("lab", Lab)


def put(path, **wanted):
    """An input of the fake program."""
    Lab().pipe_file(path, json.dumps(wanted).encode())


def job(*inputs, options=(), out="lab://out", command="reconstruct", name=None):
    row = Row(0, name, tuple(inputs), tuple(options))
    return Job(command, row, out, str(FAKE), str(OUT), str(OUT / "scratch"), None)


def is_clean():
    return not any((OUT / "scratch").iterdir())


def done(of, known=None):
    """The manifest of a job that must end with one."""
    outcome = work(of, known, 1)
    assert outcome.manifest is not None, outcome
    return outcome.manifest, json.loads(open_store(of.out).read(f"{outcome.manifest.key}.json", 1 << 20))


def a_job_is_done_once_past_a_store_that_fails():
    put("/in/day 1/box.mcap", text="it")
    Lab.share = 0.5
    of = job("lab://in/day%201/box.mcap")
    known = look(of)
    assert known.outcome is None and known.estimate.name == "box" and known.estimate.bytes_read > 10
    manifest, value = done(of, known)
    assert (manifest.status, manifest.key, manifest.folder) == ("done", known.estimate.key, f"{manifest.key}/box")
    transfer = manifest.transfer
    assert transfer.retries > 0 and transfer.requests > 5 and transfer.bytes_written > 100, transfer
    assert transfer.bytes_stored == transfer.bytes_read == value["inputs"][0]["bytes_read"], (transfer, value)
    assert value["inputs"][0]["uri"] == of.row.inputs[0] and value["version"] == "fake-1"
    Lab.share = 0.0
    assert list(whole("lab://out")) == [manifest.key] and is_clean()
    # Again, with a look and without one: no work.
    before = log(OUT)
    assert look(of).outcome.manifest == manifest and work(of, None, 1).manifest == manifest and log(OUT) == before
    # The fetched recording is named by its place in the store.
    twin = Lab().cat_file(f"/out/{manifest.key}/box/twin.urdf")
    assert twin == Lab().cat_file("/in/day 1/box.mcap")


def what_determines_the_result_is_in_the_key():
    put("/in/a.mcap", text="a")
    put("/in/b.mcap", text="a")
    folder = OUT / "here"
    for name in ("one", "two"):
        (folder / name).mkdir(parents=True)
        (folder / name / "a.json").write_text('{"text": "a"}')
    key = lambda *inputs, **more: look(job(*inputs, **more)).estimate.key
    local = as_uri(str(folder / "one/a.json"))
    # Of a folder the content counts, of a store the place and what it says of its files.
    assert key(local) == key(as_uri(str(folder / "two/a.json")))
    keys = [key(local), key("lab://in/a.mcap"), key("lab://in/b.mcap"), key(local, options=["--set", "a=1"]), key(local, name="x")]
    assert len(set(keys)) == 5 and all(len(k) == 32 for k in keys)
    put("/in/a.mcap", text="b")
    assert key("lab://in/a.mcap") != keys[1]


def a_changed_input_is_another_job():
    put("/in/changes.mcap", text="first")
    of = job("lab://in/changes.mcap")
    known = look(of)
    put("/in/changes.mcap", text="second")
    manifest, _ = done(of, known)
    assert manifest.key != known.estimate.key and manifest.key == look(of).estimate.key
    assert b"second" in Lab().cat_file(f"/out/{manifest.key}/changes/twin.urdf")


def what_comes_damaged_is_fetched_again():
    put("/in/cut.mcap", text="x" * 1000)
    of = job("lab://in/cut.mcap")
    Lab.at_fetch = lambda path, to: os.truncate(to, 500)
    first = work(of, None, 1)
    assert first.lost and first.exit_code == 75 and "500 bytes of" in first.message, first
    # Between the listing and the end.
    Lab.at_fetch = lambda path, to: put(path, text="y" * 1000)
    known = look(of)
    second = work(of, known, 1)
    assert second.lost and "have changed while they were fetched" in second.message, second
    manifest, _ = done(of, known)
    assert b"yyy" in Lab().cat_file(f"/out/{manifest.key}/cut/twin.urdf") and manifest.key != known.estimate.key


def a_lost_attempt_is_gone_on_with():
    put("/in/lost.mcap", text="lost", crash=1)
    of = job("lab://in/lost.mcap")
    before = Lab.fetched
    first = work(of, None, 1)
    assert first.lost and first.out_of_memory and Lab.fetched == before + 1, first
    manifest, _ = done(of)
    # The recording was on this machine already.
    assert manifest.status == "done" and Lab.fetched == before + 1
    # Killed between the result and its manifest: what stands is put.
    local = job(as_uri(str(OUT / "here/one/a.json")), out=as_uri(str(OUT / "put")))
    key = look(local).estimate.key
    result = OUT / "put" / key / "a"
    result.mkdir(parents=True)
    (result / "report.json").write_text('{"joints": [], "warnings": [{"code": "twin_differs", "text": ""}]}')
    before = log(OUT)
    manifest, _ = done(local)
    assert log(OUT) == before and (manifest.status, manifest.exit_code) == ("degraded", 3)
    assert sorted(path.name for path in (OUT / "put").iterdir()) == [key, f"{key}.json"]


def of_two_that_do_the_same_the_first_has_it():
    put("/in/twice.mcap", text="twice")
    of = job("lab://in/twice.mcap")
    key = look(of).estimate.key
    other = json.dumps({"warnings": [], "joints": [], "links": []}).encode()
    Lab().pipe_file(f"/out/{key}/twice/report.json", other)
    manifest, value = done(of)
    report = next(file for file in value["files"] if file["path"] == "report.json")
    assert report["sha256"] == hashlib.sha256(other).hexdigest() and key in whole("lab://out")
    assert not open_store("lab://out").create(f"{key}.json", b"{}")
    with held(OUT / "scratch" / f"artitwin-{key}.lock"):
        busy = work(of, None, 1)
        assert busy.lost and busy.exit_code == 75 and "another process" in busy.message, busy
    assert is_clean()


def refusals_are_kept_where_they_are_of_the_inputs():
    put("/in/refused.mcap", refuse="no depth topic")
    of = job("lab://in/refused.mcap")
    manifest, value = done(of)
    assert (manifest.status, manifest.exit_code, manifest.message) == ("refused", 1, "no depth topic") and value["files"] == []
    before = log(OUT)
    assert work(of, None, 1).manifest == manifest and log(OUT) == before and is_clean()
    for inputs, options, code, word in (
        (("lab://in/nope",), (), 1, "is not there"),
        (("lab://in/refused.mcap",), ("--unknown",), 2, "--unknown"),
        (("nope://in/x",), (), 1, "cannot be used"),
    ):
        outcome = work(job(*inputs, options=options), None, 1)
        assert (outcome.exit_code, outcome.manifest, outcome.lost) == (code, None, False) and word in outcome.message, outcome
    key = look(job("lab://in/a.mcap")).estimate.key
    Lab().pipe_file(f"/out/{key}.json", b"half")
    damaged = look(job("lab://in/a.mcap")).outcome
    assert damaged.exit_code == 1 and "is no manifest of a job; remove it" in damaged.message, damaged
    # What a lost attempt left is no reason to refuse.
    local = job(as_uri(str(OUT / "here/one/a.json")), options=["--set", "b=1"], out=as_uri(str(OUT / "left")))
    (OUT / "left" / look(local).estimate.key / "foreign").mkdir(parents=True)
    assert done(local)[0].status == "done"


def a_store_that_is_away_says_nothing_of_the_inputs():
    put("/in/away.mcap", text="away")
    of = job("lab://in/away.mcap")
    Lab.share = 1.0
    known = look(of)
    assert known.estimate is None and known.outcome is None and "the store is slow" in known.message
    outcome = work(of, known, 1)
    Lab.share = 0.0
    assert outcome.lost and outcome.exit_code == 75 and "cannot list `lab://in/away.mcap`" in outcome.message, outcome


def recordings_are_fetched_to_where_their_names_are_kept():
    size = 10 << 20
    for path in ("state0/a_0.mcap", "state0/metadata.yaml", "state0/old.bin", "state1/a_0.mcap", "truth.json", "empty/"):
        Lab().pipe_file(f"/rec/box/{path}", b"" if path == "empty/" else path.encode() + bytes(size if path.endswith("0.mcap") else 0))
    found = find("lab://rec/box", "recording")
    names = [file.path for file in found.files]
    assert names == ["state0/a_0.mcap", "state1/a_0.mcap", "state0/metadata.yaml"] and found.bytes_stored > found.bytes_read
    folder = OUT / "fetched"
    (folder / "outline").mkdir(parents=True)
    outline(found, folder / "outline")
    fetch(found, folder)
    assert place(found, folder) == folder / "lab/rec/box" and sorted(p.name for p in folder.iterdir()) == ["lab", "outline"]
    for name in names:
        whole_, part = folder / "lab/rec/box" / name, folder / "outline/lab/rec/box" / name
        assert whole_.read_bytes() == Lab().cat_file(f"/rec/box/{name}") and part.stat().st_size == whole_.stat().st_size
        assert part.read_bytes()[:20] == whole_.read_bytes()[:20]
    # A dataset is read whole; a twin is its URDF and what stands beside it.
    Lab().pipe_file("/rec/data/cam_K.txt", b"1")
    Lab().pipe_file("/rec/data/rgb/0.png", b"2")
    assert len(find("lab://rec/data", "recording").files) == 2
    for path in ("x.urdf", "x.usda", "model.sdf", "report.json", "meshes/a.obj"):
        Lab().pipe_file(f"/rec/twin/{path}", b"1")
    for uri, name in (("lab://rec/twin", ""), ("lab://rec/twin/x.urdf", "x.urdf")):
        twin = find(uri, TWIN)
        assert (twin.name, [file.path for file in twin.files]) == (name, ["model.sdf", "x.urdf", "x.usda"])
        assert len(find(uri, TWIN_WITH_MESHES).files) == 5 and place(twin, Path("in")) == Path("in/lab/rec/twin", name)
    # Names that lead elsewhere.
    Lab.store["/rec/evil/..\\x.mcap"] = Lab.store["/rec/twin/x.urdf"]
    try:
        fetch(find("lab://rec/evil", "recording"), folder)
        raise AssertionError("no error")
    except StoreError as error:
        assert "is no path of a file" in str(error) and not isinstance(error, MayPassError), error


def a_web_server_gives_single_files():
    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Handler, directory=str(OUT / "here"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        uri = f"http://127.0.0.1:{server.server_port}/one/a.json"
        found = find(uri, "recording")
        assert [(file.path, file.size) for file in found.files] == [("", 13)] and "GMT" in found.files[0].tag, found.files
        outline(found, OUT / "web_outline")
        (OUT / "web").mkdir()
        fetch(found, OUT / "web")
        at = place(found, OUT / "web")
        assert at == OUT / "web/http" / f"127.0.0.1:{server.server_port}/one/a.json" and at.read_text() == '{"text": "a"}'
        assert find(uri, TWIN).name == ""
        try:
            find(f"{uri}x", "recording")
            raise AssertionError("no error")
        except StoreError as error:
            assert "is not there" in str(error), error
        server.shutdown()


def a_diagnosis_reads_the_recordings_of_its_options():
    put("/gap/x.urdf")
    put("/gap/run.mcap", verdict="named")
    put("/gap/frames.mcap")
    options = ["--frames", "lab://gap/frames.mcap", "--held-out=lab://gap/run.mcap", "--set", "a=1", "--config", "mine.yaml"]
    of = job("lab://gap/x.urdf", "lab://gap/run.mcap", options=options, command="diagnose")
    assert [reads for _, reads in of.inputs()] == ["twin with meshes", "recording", "recording", "recording"]
    expected = ["--frames=f", "--held-out=h", "--set", "a=1", f"--config={OUT}/mine.yaml", "--", "t", "r"]
    assert of.arguments(["t", "r", "f", "h"]) == expected
    manifest, value = done(of)
    assert (manifest.status, manifest.name, len(value["inputs"])) == ("done", "run", 4)


def main():
    a_job_is_done_once_past_a_store_that_fails()
    what_determines_the_result_is_in_the_key()
    a_changed_input_is_another_job()
    what_comes_damaged_is_fetched_again()
    a_lost_attempt_is_gone_on_with()
    of_two_that_do_the_same_the_first_has_it()
    refusals_are_kept_where_they_are_of_the_inputs()
    a_store_that_is_away_says_nothing_of_the_inputs()
    recordings_are_fetched_to_where_their_names_are_kept()
    a_web_server_gives_single_files()
    a_diagnosis_reads_the_recordings_of_its_options()


if __name__ == "__main__":
    main()
