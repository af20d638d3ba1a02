"""The functions of the installed wheel, on a recording that ships here.

usage: functions.py BAG OUT
"""

import inspect
import json
import os
import re
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np

import artitwin

BAG, OUT = Path(sys.argv[1]), Path(sys.argv[2])


def raised(kind, call):
    """The message of the error that a call must end with."""
    try:
        call()
    except kind as error:
        assert type(error) is kind, repr(error)
        return str(error)
    raise AssertionError(f"no {kind.__name__}")


def stand_in(text):
    """Puts a script in the program's place."""
    path = OUT / "stand-in"
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    os.environ["ARTITWIN_PROGRAM"] = str(path)


def the_program_is_that_of_the_wheel():
    assert artitwin.program() == Path(sys.prefix) / "bin/artitwin", artitwin.program()


def options_are_those_of_the_commands():
    """A new option of a command is one of its function, too."""
    other_words = {"accuracy": "accuracy_mm", "set": "settings", "topic": "topics"}
    # Of several objects, and what a function does by itself.
    left_out = {"help", "version", "json", "jobs", "verbose", "estimate"}
    for function in (artitwin.reconstruct, artitwin.diagnose):
        help_text = subprocess.check_output([artitwin.program(), function.__name__, "--help"], text=True)
        words = set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", help_text, re.MULTILINE)) - left_out
        wanted = {other_words.get(word, word.replace("-", "_")) for word in words}
        given = set(inspect.signature(function).parameters) - {"bags", "twin", "runs", "on_event"}
        assert wanted == given, (function, wanted ^ given)


def refusals_have_the_words_of_the_program():
    message = raised(artitwin.FailedError, lambda: artitwin.reconstruct(OUT / "no-bag", OUT))
    assert f"cannot read `{OUT}/no-bag`" in message and not message.startswith("error"), message
    message = raised(artitwin.UsageError, lambda: artitwin.reconstruct(BAG, OUT, preset="prview"))
    assert message.startswith('no preset "prview"; there are:'), message
    message = raised(artitwin.UsageError, lambda: artitwin.reconstruct(BAG, OUT, settings={"surface.node": 9}))
    assert "surface.nodes" in message, message
    message = raised(artitwin.UsageError, lambda: artitwin.reconstruct(BAG, OUT, settings={"export.base": "flying"}))
    assert "export.base" in message and "floating" in message, message
    assert "no-bag" in raised(artitwin.FailedError, lambda: artitwin.check(OUT / "no-bag"))
    assert [path.name for path in OUT.iterdir()] == [], "a refusal writes nothing"


def interrupted_and_resumed():
    """Ctrl-C stops the program, whose finished stages are there for `resume`."""
    seen = []

    def interrupt(event):
        seen.append(event)
        if isinstance(event, artitwin.StageFinished) and event.stage == "surface/state0":
            os.kill(os.getpid(), signal.SIGINT)

    # A shell starts what runs in the background with this signal ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    raised(KeyboardInterrupt, lambda: artitwin.reconstruct(BAG, OUT, preset="preview", name="box", on_event=interrupt))
    assert not any(isinstance(event, artitwin.Artifact) for event in seen), seen
    assert [path.name for path in OUT.iterdir()] == [".artitwin-box.checkpoint"], list(OUT.iterdir())
    seen.clear()
    twin = artitwin.reconstruct(BAG, OUT, preset="preview", name="box", resume=True, on_event=seen.append)
    assert "stage_kept" in [event.code for event in seen if isinstance(event, artitwin.Noted)], seen
    assert [event.path for event in seen if isinstance(event, artitwin.Artifact)] == [str(OUT / "box")]
    finished = [event.stage for event in seen if isinstance(event, artitwin.StageFinished)]
    assert [stage.name for stage in twin.stages][-len(finished) :] == finished, (twin.stages, finished)
    return twin


def numbers_are_those_of_the_report(twin):
    report = json.loads((twin.folder / "report.json").read_text())
    assert (twin.name, twin.seed, len(twin.states)) == ("box", report["seed"], 2)
    assert twin.data == report and twin.warnings == tuple(artitwin.Note(**note) for note in report["warnings"])
    [joint], [said] = twin.joints, report["joints"]
    assert joint is twin.joint("joint_1") and joint.type == said["type"] == "prismatic"
    for key, shape in dict(axis=(3,), origin=(3,), covariance=(7, 7)).items():
        array = getattr(joint, key)
        assert array.shape == shape and np.array_equal(array, said[key]), key
        assert not array.flags.writeable
    for key in ("axis_std_deg", "origin_std_mm", "inliers", "residual_rms_mm", "pitch_m_per_rad", "type_scores"):
        assert getattr(joint, key) == said[key], key
    assert (joint.motion.value, joint.motion_std.value) == (said["motion"]["value"], said["motion_std"]["value"])
    assert [position.value for position in joint.positions] == [state.joints["joint_1"] for state in twin.states]
    for key in ("lower", "upper", "effort", "velocity", "source"):
        assert getattr(joint.limit, key) == said["limit"][key], key
    assert joint.limit.observed.tolist() == said["limit"]["observed"]
    assert joint.dynamics.friction == said["dynamics"]["friction"]
    for link, of in zip(twin.links, report["links"], strict=True):
        assert (link.name, link.mass_kg, link.mass_range_kg.tolist()) == (of["name"], of["mass_kg"], of["mass_range_kg"])
        assert len(twin.collision(link.name)) == link.solids == of["solids"] > 0
        for mesh in (*twin.visual(link.name), *twin.collision(link.name)):
            assert mesh.vertices.shape[1:] == (3,) and mesh.triangles.shape[1:] == (3,)
            assert 0 == mesh.triangles.min() and mesh.triangles.max() == len(mesh.vertices) - 1
        seen = twin.visual(link.name)[0]
        assert seen.uv.shape == (*seen.triangles.shape, 2) and 0 <= seen.uv.min() and seen.uv.max() <= 1
        assert seen.texture.is_file()
    files = ("urdf", "mjcf", "scene", "scene_actuated", "sdf", "usd", "report", "viewer")
    assert all(getattr(twin, file).is_file() for file in files)


def checked(twin):
    assert artitwin.check(twin).findings == ()
    broken = OUT / "broken.urdf"
    broken.write_text(twin.urdf.read_text().replace('xyz="0 0 0"', 'xyz="0 0 oops"', 1))
    found = artitwin.check(broken)
    assert found.errors and found.errors[0].rule == "origin" and "oops" in found.errors[0].text, found


def degraded_results_are_results(twin):
    """Exit code 3; what a package of this version cannot know it refuses or passes over."""
    folder, report = OUT / "degraded", dict(twin.data)
    folder.mkdir()
    write = lambda report: (folder / "report.json").write_text(json.dumps(report))
    write({**report, "warnings": [{"code": "solids_off", "text": "far off"}], "new": 1})
    stand_in(f"""echo '{{"event":"novelty"}}'; echo '{{"event":"artifact","path":"{folder}"}}'; exit 3""")
    assert [str(warning) for warning in artitwin.reconstruct(BAG, OUT).warnings] == ["far off"]
    write({**report, "format": "artitwin-report/3"})
    assert "artitwin-report/3, not artitwin-report/2" in raised(artitwin.ReportError, lambda: artitwin.Twin.read(folder))
    del report["joints"][0]["axis"]
    write(report)
    assert raised(artitwin.ReportError, lambda: artitwin.Twin.read(folder)).endswith("joints[0] has no `axis`")


def other_ends_have_errors_of_their_own():
    call = lambda: artitwin.reconstruct(BAG, OUT)
    stand_in("echo 'warning: x' >&2; echo 'error: stopped on request; a is kept' >&2; exit 130")
    assert raised(artitwin.StoppedError, call) == "stopped on request; a is kept"
    stand_in("echo panicked >&2; exit 101")
    assert "exit code 101: panicked" in raised(artitwin.ProgramError, call)
    stand_in("kill -9 $$")
    assert "-9" in raised(artitwin.ProgramError, call)
    # It hears what the functions were given.
    stand_in('echo "error: $*" >&2; exit 1')
    call = lambda: artitwin.diagnose("t.urdf", ["-r"], OUT, held_out="-r", gravity=np.array([0, 0, -1]), command={"/c": ["a", "b"], "/d": []}, force=True)
    expected = f"diagnose --out={OUT} --force --held-out=-r --gravity=0.0,0.0,-1.0 --command=/c=a,b --command=/d -- t.urdf -r"
    assert raised(artitwin.FailedError, call) == expected, raised(artitwin.FailedError, call)
    os.environ["ARTITWIN_PROGRAM"] = str(OUT / "nowhere")
    assert "nowhere" in raised(artitwin.ProgramError, call)
    del os.environ["ARTITWIN_PROGRAM"]


the_program_is_that_of_the_wheel()
options_are_those_of_the_commands()
refusals_have_the_words_of_the_program()
twin = interrupted_and_resumed()
numbers_are_those_of_the_report(twin)
checked(twin)
message = raised(artitwin.FailedError, lambda: artitwin.diagnose(twin, BAG / "state0", OUT / "diagnosis"))
assert "is not a recording: it holds no sensor_msgs/msg/JointState" in message, message
degraded_results_are_results(twin)
other_ends_have_errors_of_their_own()
