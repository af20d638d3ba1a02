#!/usr/bin/env python3
"""In the program's place: a command of the contract in a few hundred milliseconds, that does as its input says.

An input is a JSON file. Its keys: `seconds` that the run takes, `estimate` (seconds) where it differs, `memory_bytes`,
`refuse` (a message), `degraded`, `lose` (so many first attempts end with exit code 75), `crash` (so many first attempts
kill themselves by SIGKILL), `hang` (so many first attempts never end), `no_estimate` (so many first estimates end with exit
code 75), `verdict`, `findings`.

Where `FAKE_LOG` names a folder, it gets a line in `log` for each of: look, start, work, write, end. Attempts are counted from it.
"""

import hashlib
import json
import os
import re
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


def attempts(what, key):
    folder = os.environ.get("FAKE_LOG")
    if not folder:
        return 1
    lines = (Path(folder) / "log").read_text(encoding="utf-8").splitlines()
    return sum(line.split()[:2] == [what, key] for line in lines)


def parsed(arguments):
    place = arguments.index("--")
    options = {"command": arguments[0], "inputs": [Path(path) for path in arguments[place + 1 :]], "more": []}
    for argument in arguments[1:place]:
        name, _, value = argument.partition("=")
        if name in ("--out", "--name"):
            options[name[2:]] = value
        elif name in ("--json", "--estimate", "--resume"):
            options[name[2:]] = True
        elif name == "--unknown":
            end(2, "unexpected argument '--unknown' found")
        else:
            options["more"].append(argument)
    return options


def end(code, message):
    print(f"error: {message}", file=sys.stderr)
    sys.exit(code)


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


def look(options, wanted):
    """What `--estimate` prints."""
    place = hashlib.sha256(str(options["inputs"][-1]).encode()).hexdigest()[:8]
    say("look", place)
    if attempts("look", place) <= wanted.get("no_estimate", 0):
        end(75, "no estimate of this")
    settings = hashlib.sha256(repr((options["command"], options["more"], VERSION)).encode()).hexdigest()
    estimate = {
        "format": "artitwin-estimate/2",
        "version": VERSION,
        "name": options.get("name") or options["inputs"][-1].stem,
        "settings": settings,
        "cores": 1,
        "memory_bytes": wanted.get("memory_bytes", 100 << 20),
        "scratch_bytes": 0,
        "seconds": wanted.get("estimate", wanted.get("seconds", 0.2)),
    }
    print(json.dumps(estimate))


def work(wanted, key):
    """What an attempt does before it writes."""
    attempt = attempts("start", key)
    seconds = wanted.get("seconds", 0.2)
    if attempt <= wanted.get("crash", 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if attempt <= wanted.get("hang", 0):
        seconds = 1e9
    if attempt <= wanted.get("lose", 0):
        end(75, "the disk did not answer")
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        say("work", key)
        time.sleep(min(0.05, seconds))


def run(options, wanted):
    """A result in OUT/NAME, which appears when it is whole."""
    out, name = Path(options["out"]), options["name"]
    key = re.search(r"[0-9a-f]{32}", options["out"])[0]
    result, aside = out / name, out / f".{name}.{os.getpid()}"
    if (out / "foreign").exists():
        end(1, "what stands there is of another run")
    if options.get("resume") and result.is_dir():
        return 0
    signal.signal(signal.SIGINT, lambda *_: sys.exit(130))
    say("start", key)
    if wanted.get("refuse"):
        end(1, wanted["refuse"])
    work(wanted, key)
    say("write", key)
    aside.mkdir(parents=True)
    warnings = [{"code": "twin_differs", "text": "as asked"}] if wanted.get("degraded") else []
    value = {**report(options["command"], wanted, name), "warnings": warnings, "at": time.time()}
    (aside / "report.json").write_text(json.dumps(value))
    (aside / "twin.urdf").write_bytes(b"".join(path.read_bytes() for path in options["inputs"]))
    aside.rename(result)
    say("end", key)
    return 3 if warnings else 0


def main():
    if sys.argv[1:] == ["--version"]:
        print(f"artitwin {VERSION}")
        return 0
    options = parsed(sys.argv[1:])
    last = options["inputs"][-1]
    if not last.is_file():
        end(1, f"cannot read `{last}`: there is no such file")
    wanted = json.loads(last.read_text())
    if options.get("estimate"):
        look(options, wanted)
        return 0
    return run(options, wanted)


if __name__ == "__main__":
    sys.exit(main())
