"""What the figures of the fleet share."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests/python/fleet"
sys.path[:0] = [str(ROOT / "python"), str(TESTS)]
os.environ["PYTHONPATH"] = f"{ROOT / 'python'}"
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"


def timed(command, **environment):
    """Seconds of a command, which must end with 0 or 3; its standard error."""
    start = time.monotonic()
    env = {**os.environ, **{key: str(value) for key, value in environment.items()}}
    ended = subprocess.run([str(part) for part in command], env=env, capture_output=True, text=True, check=False)
    seconds = time.monotonic() - start
    assert ended.returncode in (0, 3), f"{command}: exit code {ended.returncode}\n{ended.stdout}{ended.stderr}"
    return seconds, ended.stderr


def fleet(*arguments):
    """The command line of a fleet."""
    return [sys.executable, "-m", "artitwin.fleet", *arguments]


def objects(args, folder, count):
    """Inputs of so many objects: synth's by seed, or those of the fake program."""
    folder.mkdir(parents=True, exist_ok=True)
    inputs = []
    for seed in range(count):
        path = folder / (f"object_{seed:04}.json" if args.fake else f"object_{seed:04}")
        if args.fake and not path.exists():
            path.write_text(json.dumps({"name": path.stem, "seconds": args.fake}))
        elif not args.fake and not path.exists():
            size = ["--views", args.views, "--width", "320", "--height", "240"]
            timed([args.program, "synth", "--out", path, "--seed", seed, *size])
        inputs.append(path)
    return inputs


def add_program(parser):
    """Options of every script."""
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--program", type=Path, default=Path("target/release/artitwin"))
    parser.add_argument("--fake", type=float, metavar="SECONDS", help="the fake program, with jobs of so many seconds")
    parser.add_argument("--views", default="8")
    parser.add_argument("--options", default="--preset preview", help="of every job")


def use_program(args):
    """Names the program for this process and all that it starts."""
    program = TESTS / "fake.py" if args.fake else args.program.resolve()
    os.environ["ARTITWIN_PROGRAM"] = str(program)
    args.out = args.out.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    return program


def keep(path, values):
    """Adds numbers to a JSON file."""
    known = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps({**known, **values}, indent=1, sort_keys=True) + "\n")
