#!/usr/bin/env python3
"""In the program's place: a job of the contract in a few hundred milliseconds, that does as its input says.

An input is a JSON file. Its keys: `seconds` that the job takes, `estimate` (seconds) where it differs, `memory_bytes`,
`refuse` (a message), `degraded`, `lose` (so many first attempts end with exit code 75), `crash` (so many first attempts
kill themselves by SIGKILL), `hang` (so many first attempts never end), `no_estimate`, `verdict`, `findings`.

Where `FAKE_LOG` names a folder, it gets a line in `log` for each of: start, work, write. Attempts are counted from it.
Needs pyarrow for stores that are no folder.
"""

import hashlib
import json
import os
import signal
import sys
import time
from pathlib import Path

VERSION = "fake-1"


def say(what, key):
    folder = os.environ.get("FAKE_LOG")
    if folder:
        with open(Path(folder) / "log", "a", encoding="utf-8") as file:
            file.write(f"{what} {key} {os.getpid()} {time.time():.3f}\n")


def attempts(key):
    folder = os.environ.get("FAKE_LOG")
    if not folder:
        return 1
    lines = (Path(folder) / "log").read_text(encoding="utf-8").splitlines()
    return sum(line.split()[:2] == ["start", key] for line in lines)


class Store:
    """Puts and gets; an object appears whole."""

    def __init__(self, uri):
        self.local = uri.startswith("file://")
        self.root = Path(uri[len("file://") :]) if self.local else uri.partition("://")[2]
        if not self.local:
            from pyarrow import fs

            self.files = fs.S3FileSystem(
                endpoint_override=os.environ["AWS_ENDPOINT"], scheme="http", region="us-east-1", allow_bucket_creation=False
            )

    def get(self, path):
        try:
            if self.local:
                return (self.root / path).read_bytes()
            with self.files.open_input_file(f"{self.root}/{path}") as file:
                return file.read()
        except FileNotFoundError:
            return None

    def put(self, path, data):
        if not self.local:
            with self.files.open_output_stream(f"{self.root}/{path}") as file:
                file.write(data)
            return
        at = self.root / path
        at.parent.mkdir(parents=True, exist_ok=True)
        aside = at.with_name(f".{at.name}.{os.getpid()}")
        aside.write_bytes(data)
        aside.replace(at)


def parsed(arguments):
    options = {"command": arguments[0], "inputs": arguments[arguments.index("--") + 1 :], "more": []}
    for argument in arguments[1 : arguments.index("--")]:
        name, _, value = argument.partition("=")
        if name in ("--out", "--name", "--scratch"):
            options[name[2:]] = value
        elif name in ("--json", "--estimate"):
            options[name[2:]] = True
        elif name == "--unknown":
            print("error: unexpected argument '--unknown' found", file=sys.stderr)
            sys.exit(2)
        else:
            options["more"].append(argument)
    return options


def report(command, wanted, name):
    if command == "diagnose":
        return {"verdict": wanted.get("verdict", "none"), "findings": wanted.get("findings", []), "gap": {"before": 0.1}}
    joint = {
        "name": "joint_1",
        "type": "revolute",
        "axis": [0, 0, 1],
        "origin": [0.1, 0, 0],
        "motion": {"value": 1.5, "unit": "rad"},
        "axis_std_deg": 0.3,
        "origin_std_mm": None,
        "motion_std": {"value": 0.01, "unit": "rad"},
    }
    return {"format": "artitwin-report/2", "name": name, "links": [{}, {}], "joints": [joint], "overall": {"word": "usable"}}


def work(wanted, key):
    """What an attempt does before it writes."""
    attempt = attempts(key)
    seconds = wanted.get("seconds", 0.2)
    if attempt <= wanted.get("crash", 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if attempt <= wanted.get("hang", 0):
        seconds = 1e9
    if attempt <= wanted.get("lose", 0):
        print("error: the store did not answer", file=sys.stderr)
        sys.exit(75)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        say("work", key)
        time.sleep(min(0.05, seconds))


def main():
    options = parsed(sys.argv[1:])
    command, out = options["command"], Store(options["out"])
    inputs = [Path(path) for path in options["inputs"]]
    if not inputs[-1].is_file():
        print(f"error: cannot read `{inputs[-1]}`: there is no such file", file=sys.stderr)
        sys.exit(1)
    text = b"".join(path.read_bytes() for path in inputs)
    wanted = json.loads(inputs[-1].read_text())
    name = options.get("name") or inputs[-1].stem
    key = hashlib.sha256(repr((command, name, text, options["more"], VERSION)).encode()).hexdigest()[:32]
    standing = out.get(f"{key}.json")
    estimate = {
        "format": "artitwin-estimate/1",
        "key": key,
        "done": json.loads(standing)["status"] if standing else None,
        "cores": 1,
        "memory_bytes": wanted.get("memory_bytes", 100 << 20),
        "scratch_bytes": 0,
        "seconds": wanted.get("estimate", wanted.get("seconds", 0.2)),
        "bytes_stored": 1000,
        "bytes_read": 400,
    }
    if options.get("estimate"):
        if wanted.get("no_estimate"):
            print("error: no estimate of this", file=sys.stderr)
            sys.exit(1)
        print(json.dumps(estimate))
        return
    if standing:
        print(json.dumps({"event": "job", **json.loads(standing)}))
        sys.exit(json.loads(standing)["exit_code"])
    signal.signal(signal.SIGINT, lambda *_: sys.exit(130))
    started = time.time()
    say("start", key)
    folder, files = None, []
    status, code = ("degraded", 3) if wanted.get("degraded") else ("done", 0)
    if wanted.get("refuse"):
        status, code = "refused", 1
    else:
        work(wanted, key)
        folder = f"{key}/{name}"
        say("write", key)
        for path, data in (("report.json", json.dumps(report(command, wanted, name)).encode()), ("twin.urdf", text)):
            out.put(f"{folder}/{path}", data)
            files.append({"path": path, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()})
    manifest = {
        "format": "artitwin-job/1",
        "key": key,
        "command": command,
        "name": name,
        "status": status,
        "exit_code": code,
        "message": wanted.get("refuse"),
        "folder": folder,
        "files": files,
        "warnings": [{"code": "twin_differs", "text": "as asked"}] if status == "degraded" else [],
        "version": VERSION,
        "inputs": [],
        "transfer": {
            "bytes_stored": 1000,
            "bytes_read": 400,
            "bytes_written": len(text),
            "requests": 3,
            "retries": 0,
            "seconds": 0.0,
        },
        "seconds": time.time() - started,
        "cpu_seconds": time.process_time(),
        "peak_memory_bytes": 20 << 20,
        "started": "2026-01-01T00:00:00Z",
        "estimate": estimate,
    }
    say("manifest", key)
    out.put(f"{key}.json", json.dumps(manifest).encode())
    print(json.dumps({"event": "job", **manifest}))
    sys.exit(code)


if __name__ == "__main__":
    main()
