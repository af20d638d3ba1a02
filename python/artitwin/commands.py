"""The commands as functions. Options are passed on; none has a default here."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from .check import Check, CheckFinding
from .diagnosis import Diagnosis
from .errors import ProgramError, ended
from .events import Artifact, Event, event
from .process import StrPath, commas, option, options, paths, run, run_whatever
from .twin import Twin

Setting = str | int | float | bool | Sequence[float] | None


def reconstruct(
    bags: StrPath | Iterable[StrPath],
    out: StrPath,
    *,
    preset: str | None = None,
    config: StrPath | None = None,
    settings: Mapping[str, Setting] = {},
    parts: int | None = None,
    name: str | None = None,
    seed: int | None = None,
    split: Iterable[float] | None = None,
    workspace: Iterable[float] | None = None,
    at: str | Iterable[float] | None = None,
    topics: Mapping[str, str] = {},
    matcher: StrPath | None = None,
    rerun: StrPath | None = None,
    resume: bool = False,
    stages: StrPath | None = None,
    follow: bool = False,
    force: bool = False,
    on_event: Callable[[Event], object] | None = None,
) -> Twin:
    """Makes the twin of one object in the folder `out`/NAME.

    The options are those of the command (`artitwin reconstruct --help`); what is not given has the program's
    default. `settings` are its `--set`, `topics` maps a kind (`color`, `depth`, ...) to a topic. `on_event`
    is called with every event; what it raises stops the run. Ctrl-C stops it after its current step, and
    `resume=True` goes on from there.

    Raises an `ArtitwinError` with the program's message. A degraded result is a result: see its `warnings`.
    """
    arguments = [
        "reconstruct",
        "--json",
        *options("out", paths(out)),
        *option("preset", preset),
        *options("config", paths(config or [])),
        *options("set", (f"{key}={_written(value)}" for key, value in settings.items())),
        *option("parts", parts),
        *option("name", name),
        *option("seed", seed),
        *option("split", commas(split)),
        *option("workspace", commas(workspace)),
        *option("at", at if isinstance(at, str) else commas(at)),
        *options("topic", (f"{kind}={topic}" for kind, topic in topics.items())),
        *options("matcher", paths(matcher or [])),
        *options("rerun", paths(rerun or [])),
        *option("resume", resume),
        *options("stages", paths(stages or [])),
        *option("follow", follow),
        *option("force", force),
        "--",
        *paths(bags),
    ]
    folders: list[str] = []

    def on_line(line: str) -> None:
        happened = event(line)
        if isinstance(happened, Artifact):
            folders.append(happened.path)
        if happened is not None and on_event is not None:
            on_event(happened)

    run(arguments, on_line)
    if not folders:
        raise ProgramError("artitwin ended well and named no result")
    return Twin.read(folders[-1])


def diagnose(
    twin: StrPath,
    runs: StrPath | Iterable[StrPath],
    out: StrPath,
    *,
    frames: StrPath | Iterable[StrPath] = (),
    held_out: StrPath | Iterable[StrPath] = (),
    effects: Iterable[str] = (),
    gravity: Iterable[float] | None = None,
    effort_unit: float | Literal["unknown"] | None = None,
    effort_hold: Literal["zero", "sampled"] | None = None,
    servo: Iterable[str] = (),
    command: Mapping[str, Iterable[str]] = {},
    wrench: Mapping[str, str] = {},
    pose: Mapping[str, str] = {},
    joint: Mapping[str, str] = {},
    accuracy_mm: float | None = None,
    seed: int | None = None,
    name: str | None = None,
    force: bool = False,
) -> Diagnosis:
    """Compares a twin (a `Twin`, a run folder or a URDF) with recorded motion, and writes what was found to
    `out`, or to `out`/`name`.

    The options are those of the command (`artitwin diagnose --help`); what is not given has the program's
    default. `wrench` and `pose` map a topic to a link, `command` a topic to the joints of its values, none
    where it names them, `joint` a joint of the twin to its recorded name.

    Raises an `ArtitwinError` with the program's message. `insufficient` is a result: see `verdict` and
    `warnings`.
    """
    arguments = [
        "diagnose",
        *options("out", paths(out)),
        *option("name", name),
        *option("force", force),
        *options("frames", paths(frames)),
        *options("held-out", paths(held_out)),
        *options("effects", effects),
        *option("gravity", commas(gravity)),
        *option("effort-unit", effort_unit),
        *option("effort-hold", effort_hold),
        *options("servo", servo),
        *options("command", (_command(topic, list(joints)) for topic, joints in command.items())),
        *options("wrench", (f"{topic}={link}" for topic, link in wrench.items())),
        *options("pose", (f"{topic}={link}" for topic, link in pose.items())),
        *options("joint", (f"{joint}={recorded}" for joint, recorded in joint.items())),
        *option("accuracy", accuracy_mm),
        *option("seed", seed),
        "--",
        *paths(twin),
        *paths(runs),
    ]
    run(arguments)
    return Diagnosis.read(Path(out) / (name or ""))


def check(model: StrPath) -> Check:
    """Checks a URDF, or those of a folder, ours or not. Findings are a result; what cannot be read raises."""
    exit_code, output, message = run_whatever(["check", "--", *paths(model)])
    # The count ends a check. One that failed has none.
    if not re.search(r"^\d+ errors, \d+ warnings$", output, re.MULTILINE):
        raise ended(exit_code, message)
    lines = re.finditer(r"^(error|warning) (\w+): (.*)$", output, re.MULTILINE)
    return Check(tuple(CheckFinding(*line.groups()) for line in lines))


def joint(tracks: StrPath | Iterable[StrPath], *, of: str | None = None, urdf: StrPath | None = None) -> dict[str, Any]:
    """The joint behind recorded paths of a point of its part (`artitwin joint --help`), as the program's JSON.

    A type of `undecided` or `fixed` is a result, with its reason in `warnings`; what cannot be read raises.
    """
    arguments = ["joint", "--json", *option("of", of), *options("urdf", paths(urdf or [])), "--", *paths(tracks)]
    exit_code, output, message = run_whatever(arguments)
    if exit_code not in (0, 3):
        raise ended(exit_code, message)
    found: dict[str, Any] = json.loads(output)
    return found


def _command(topic: str, joints: list[str]) -> str:
    return "=".join([topic, ",".join(joints)]) if joints else topic


def _written(value: Setting) -> str:
    """A setting as YAML."""
    return value if isinstance(value, str) else json.dumps(value)
