"""Mutated files of every kind that the program reads."""
import random
import shutil
import zipfile
from io import BytesIO
from pathlib import Path

import mcap_file
import mutate
from outcomes import Family
from program import run

ROOT = Path(__file__).resolve().parents[2]
# What a small input may take: the largest sound one takes 30 MB and 0.1 s.
MEMORY_MB, SECONDS = 600, 10
ACCEPTED = (0, 1, 2, 3)


def judged(family, ended, about, keep):
    """No accident, an exit code of the program's own, a message with a failure, no raw escapes, and what it took."""
    wrong = ""
    if ended.code not in ACCEPTED:
        wrong = f"exit code {ended.code}"
    elif ended.code != 0 and not ended.text.strip():
        wrong = "failed without a word"
    elif "\x1b" in ended.text:
        wrong = "an escape of the input reached the terminal"
    elif ended.memory_mb > MEMORY_MB:
        wrong = f"took {ended.memory_mb:.0f} MB"
    elif ended.seconds > SECONDS:
        wrong = f"took {ended.seconds:.0f} s"
    family.add(ended, wrong, about)
    if ended.accident() or wrong:
        keep()


def bags(binary, work, count, seed):
    """Recordings: bytes of the file, messages, metadata."""
    family = Family("mutated recordings, `inspect`")
    rng = random.Random(seed)
    names = ["drawer", "drawer_raw", "laptop"]
    raw = {(n, s): (ROOT / f"bags/{n}/state{s}/state{s}.mcap").read_bytes() for n in names for s in (0, 1)}
    sound = {key: mcap_file.read(ROOT / f"bags/{key[0]}/state{key[1]}/state{key[1]}.mcap") for key in raw}
    for number in range(count):
        folder = work / "bag"
        shutil.rmtree(folder, ignore_errors=True)
        name, wrong = rng.choice(names), rng.randrange(2)
        for state in (0, 1):
            shutil.copytree(ROOT / f"bags/{name}/state{state}", folder / f"state{state}")
        file = folder / f"state{wrong}/state{wrong}.mcap"
        kind = rng.random()
        if kind < 0.5:
            file.write_bytes(mutate.file_bytes(rng, raw[name, wrong]))
        elif kind < 0.93:
            mcap_file.write(file, mutate.messages(rng, sound[name, wrong]))
        else:
            metadata = file.with_name("metadata.yaml")
            metadata.write_bytes(mutate.file_bytes(rng, metadata.read_bytes()))
        ended = run([binary, "inspect", folder])
        judged(family, ended, f"bag {number}", lambda: shutil.copytree(folder, work / f"kept/bag_{number}", dirs_exist_ok=True))
    return family


def dataset(folder):
    """A small sound dataset of the keyframe layout."""
    import numpy
    from PIL import Image

    shutil.rmtree(folder, ignore_errors=True)
    rng = numpy.random.default_rng(1)
    for part in ("color_segmented", "depth_filtered", "mask", "correspondence_loftr/no_filter"):
        (folder / part).mkdir(parents=True)
    (folder / "cam_K.txt").write_text("30 0 16\n0 30 12\n0 0 1\n")
    frames = ""
    for state in (0, 1):
        for view in range(3):
            name = f"{state}_{view:02d}"
            Image.fromarray(rng.integers(0, 255, (24, 32, 3), dtype=numpy.uint8)).save(folder / f"color_segmented/{name}.png")
            depth = (1000 + rng.integers(0, 50, (24, 32))).astype(numpy.uint16)
            Image.fromarray(depth).save(folder / f"depth_filtered/{name}.png")
            Image.fromarray(numpy.full((24, 32), 255, numpy.uint8)).save(folder / f"mask/{name}.png")
            pose = numpy.eye(4)
            pose[0, 3] = 0.1 * view
            frames += f"frame_{name}:\n  cam_in_ob: {pose.flatten().tolist()}\n  time: {float(state)}\n"
    (folder / "init_keyframes.yml").write_text(frames)
    return folder


def datasets(binary, work, count, seed):
    """Dataset folders: frames, images, matches."""
    family = Family("mutated datasets, `inspect`")
    rng = random.Random(seed)
    folder = dataset(work / "dataset")
    matches = [(ROOT / f"tests/golden/{name}.npz").read_bytes() for name in ("matches", "matches_deflated")]
    inner = zipfile.ZipFile(BytesIO(matches[0]))
    member = inner.namelist()[0]
    array = inner.read(member)
    npz = folder / "correspondence_loftr/no_filter/src_0_00_tgt_all_top30.npz"
    npz.write_bytes(matches[0])
    files = [folder / "init_keyframes.yml", folder / "cam_K.txt", *sorted(folder.rglob("*.png")), npz, npz, npz, npz]
    sound = {f: f.read_bytes() for f in files}
    for number in range(count):
        file = rng.choice(files)
        if file == npz and rng.random() < 0.7:
            packed = BytesIO()
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as z:
                z.writestr(member, array[:128] + mutate.file_bytes(rng, array[128:]))
            file.write_bytes(packed.getvalue())
        else:
            file.write_bytes(mutate.file_bytes(rng, sound[file]))
        ended = run([binary, "inspect", folder])
        judged(family, ended, f"dataset {number}, {file.name}", lambda: shutil.copy(file, work / f"kept/{number}_{file.name}"))
        file.write_bytes(sound[file])
    return family


def urdfs(binary, work, count, seed):
    """URDFs: bytes, and numbers alone."""
    import re

    from joint_logs import TWIN

    family = Family("mutated URDFs, `check`")
    rng = random.Random(seed)
    # The cabinet's meshes are not there, the other has none.
    both = [(ROOT / "tests/golden/cabinet.urdf").read_bytes(), TWIN.encode()]
    odd = [b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", b"0", b"-0", b"-1", b"99999999999999999999"]
    folder = work / "urdf"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    file = folder / "t.urdf"
    for number in range(count):
        sound = rng.choice(both)
        if number % 2:
            at = rng.choice(list(re.finditer(rb"-?\d+(\.\d+)?", sound)))
            file.write_bytes(sound[: at.start()] + rng.choice(odd) + sound[at.end() :])
        else:
            file.write_bytes(mutate.file_bytes(rng, sound))
        ended = run([binary, "check", folder])
        judged(family, ended, f"urdf {number}", lambda: shutil.copy(file, work / f"kept/{number}.urdf"))
    return family


def joint_logs(binary, work, count, seed):
    """Joint logs under a sound twin, with the effect given so that a run takes a fraction of a second."""
    from joint_logs import TWIN, log

    family = Family("mutated joint logs, `diagnose`")
    rng = random.Random(seed)
    twin = work / "twin.urdf"
    twin.write_text(TWIN)
    sound = log()
    good = [mcap_file.write(work / f"log{k}/log{k}.mcap", sound) for k in range(2)]
    bad = work / "log_bad/log_bad.mcap"
    for number in range(count):
        if number % 2:
            mcap_file.write(bad, mutate.messages(rng, sound))
        else:
            mcap_file.write(bad, sound)
            bad.write_bytes(mutate.file_bytes(rng, bad.read_bytes()))
        out = work / "diagnosis"
        shutil.rmtree(out, ignore_errors=True)
        runs = [good[0].parent, bad.parent, good[1].parent]
        ended = run([binary, "diagnose", twin, *runs, "--out", out, "--effects", "viscous_friction"])
        judged(family, ended, f"log {number}", lambda: shutil.copy(bad, work / f"kept/log_{number}.mcap"))
    return family
