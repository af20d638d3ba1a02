"""Jobs of the program: in a folder, on a store in memory, and on an S3 server of whose requests some fail.

usage: jobs.py PROGRAM OUT
"""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from support import as_plain, until, whole

from artitwin.fleet.job import Job
from artitwin.fleet.perform import look, work
from artitwin.fleet.store import as_uri, open_store
from artitwin.fleet.table import Row

PROGRAM, OUT = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
SCRATCH = OUT / "scratch"
ROOT = Path(__file__).parents[3]
SERVER = ROOT / "eval/fleet/s3_server.py"
DRAWER = ROOT / "bags/drawer"
PREVIEW = ["--preset", "preview", "--parts", "2"]
# Coarse, so that a run takes seconds; what the twin is worth is no matter here.
OPTIONS = [*PREVIEW, "--set", "surface.nodes=56", "--set", "model.collision.max_solids=8"]
LAMP = OUT / "lamp"


def made():
    size = ["--views", "6", "--width", "160", "--height", "120"]
    command = [PROGRAM, "synth", "--out", LAMP, "--seed", "4", "--parts", "2", "--family", "lamp", *size]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def plain(path, options):
    """The files of the plain command."""
    command = [PROGRAM, "reconstruct", "--out", OUT / "plain", *options, path]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return OUT / "plain" / path.name


def job(uri, out, *more, options=OPTIONS):
    row = Row(0, None, (uri,), (*options, *more))
    return Job("reconstruct", row, out, str(PROGRAM), str(OUT), str(SCRATCH), None)


def done(of):
    """The manifest of a job that must end with a result, as it stands."""
    outcome = work(of, None, 2)
    assert outcome.manifest is not None and outcome.exit_code in (0, 3), outcome
    return whole(of.out)[outcome.manifest.key]


def in_a_folder_once_as_the_plain_command():
    out = as_uri(str(OUT / "folder"))
    of = job(as_uri(str(DRAWER)), out, options=PREVIEW)
    known = look(of)
    assert known.outcome is None and known.estimate.memory_bytes > 50 << 20 and not (OUT / "folder").exists()
    manifest = done(of)
    assert (manifest["key"], manifest["name"]) == (known.estimate.key, "drawer")
    assert manifest["peak_memory_bytes"] <= known.estimate.memory_bytes
    as_plain(manifest, plain(DRAWER, PREVIEW))
    # Nothing is left but the result and its manifest.
    names = sorted(path.name for path in (OUT / "folder").iterdir())
    assert names == [manifest["key"], f"{manifest['key']}.json"] and not any(SCRATCH.iterdir())
    start, report = time.monotonic(), (OUT / "folder" / manifest["folder"] / "report.json").read_bytes()
    again = look(of)
    assert again.outcome is not None and again.outcome.manifest.key == manifest["key"]
    assert work(of, again, 2).manifest == again.outcome.manifest and time.monotonic() - start < 5.0
    assert (OUT / "folder" / manifest["folder"] / "report.json").read_bytes() == report
    # A recording elsewhere with the same content is the same job.
    shutil.copytree(DRAWER, OUT / "copy/drawer")
    assert look(job(as_uri(str(OUT / "copy/drawer")), out, options=PREVIEW)).outcome.manifest.key == manifest["key"]


def a_refusal_has_its_reason():
    of = job(as_uri(str(LAMP)), as_uri(str(OUT / "refused")), "--topic", "depth=/none")
    first, second = work(of, None, 2), look(of).outcome
    assert first.manifest == second.manifest and (first.exit_code, first.manifest.status) == (1, "refused")
    assert "/none" in first.message and len(list((OUT / "refused").iterdir())) == 1
    wrong = look(job(as_uri(str(LAMP)), of.out, "--set", "surface.node=9")).outcome
    assert wrong.exit_code == 2 and "surface.nodes" in wrong.message and wrong.manifest is None, wrong


def one_that_was_killed_is_gone_on_with():
    out = OUT / "killed"
    (OUT / "objects.jsonl").write_text(json.dumps({"inputs": str(DRAWER)}) + "\n")
    call = [sys.executable, "-m", "artitwin.fleet", "--row", "1", "--objects", OUT / "objects.jsonl", "--out", out]
    environment = {**os.environ, "ARTITWIN_PROGRAM": str(PROGRAM)}
    command = [str(word) for word in [*call, "--", *PREVIEW]]
    first = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # In the middle: the capture is kept, the rest is not.
    until(lambda: list(out.glob("*/.artitwin-drawer.checkpoint/capture*")) or first.poll() is not None, 60)
    # Held there, however long the next one takes to begin.
    running = Path(f"/proc/{first.pid}/task/{first.pid}/children").read_text().split()
    for pid in (*map(int, running), first.pid):
        os.kill(pid, signal.SIGSTOP)
    busy = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert busy.returncode == 75 and "another process" in busy.stderr, (busy, first.poll())
    first.kill()
    first.wait()
    assert not list(out.glob("*.json"))
    second = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert second.returncode in (0, 3), second
    ((key, manifest),) = whole(as_uri(str(out))).items()
    assert second.stdout.strip() == f"file://{out}/{key}.json"
    as_plain(manifest, OUT / "plain/drawer")


def stages_serve_another_setting():
    import fsspec

    fsspec.filesystem("memory").put(str(LAMP), "/lab/lamp", recursive=True)
    stages = ["--stages", "kept"]
    first = done(job("memory://lab/lamp", "memory://out", *stages))
    count = len(list((OUT / "kept").rglob("*")))
    second = done(job("memory://lab/lamp", "memory://out", *stages, "--set", "export.prefix=a_"))
    added = len(list((OUT / "kept").rglob("*"))) - count
    # The last stages alone.
    assert first["key"] != second["key"] and 0 < added <= 2, (count, added)
    as_plain(first, plain(LAMP, OPTIONS))
    report = open_store("memory://out").read(f"{second['folder']}/report.json", 1 << 24).decode()
    # The truth beside the states is not read; the place in the store is what the report names.
    assert first["transfer"]["bytes_read"] < first["transfer"]["bytes_stored"], first["transfer"]
    assert "memory/lab/lamp" in report and str(SCRATCH) not in report


def on_a_server_that_fails():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ |= {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    command = [sys.executable, SERVER, str(port), "--fail", "0.05", "--slow-s", "2"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        until(lambda: socket.socket().connect_ex(("127.0.0.1", port)) == 0)
        import s3fs

        s3 = s3fs.S3FileSystem()
        s3.mkdir("lab")
        for path in sorted(LAMP.rglob("*")):
            if path.is_file():
                open_store("s3://lab").write(f"day/{path.relative_to(OUT).as_posix()}", path.read_bytes())
        of = job("s3://lab/day/lamp", "s3://lab/out")
        manifest = done(of)
        as_plain(manifest, OUT / "plain/lamp")
        transfer = manifest["transfer"]
        assert transfer["requests"] > 50 and transfer["bytes_written"] > 500_000, transfer
        assert look(of).outcome.manifest.key == manifest["key"] and not any(SCRATCH.iterdir())
        # What stands is not replaced.
        assert not open_store("s3://lab/out").create(f"{manifest['key']}.json", b"{}")
        assert work(job("s3://lab/day/nope", "s3://lab/out"), None, 2).exit_code == 1
        print(f"S3: {transfer['requests']} requests, {transfer['retries']} sent again beside those of s3fs")
    finally:
        server.terminate()
        print("server:", server.communicate(timeout=30)[0].strip())


def main():
    made()
    in_a_folder_once_as_the_plain_command()
    a_refusal_has_its_reason()
    one_that_was_killed_is_gone_on_with()
    stages_serve_another_setting()
    on_a_server_that_fails()


if __name__ == "__main__":
    main()
