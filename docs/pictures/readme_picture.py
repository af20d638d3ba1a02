"""Makes README's picture: frames of a recording, the turntable of its twin, and the twin moved by MuJoCo.

    python docs/pictures/readme_picture.py OUT.gif BAG RUN [BAG RUN ...]

BAG is a folder of state0 and state1 with JPEG color, RUN the run folder that `artitwin reconstruct` made of it. Needs
`tests/python/requirements.txt`; MUJOCO_GL as for `tests/python/mujoco_pictures.py`.
"""

import io
import json
import math
import os
import sys
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "osmesa")  # before the import, which reads it

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageSequence
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

FRAMES, PERIOD_MS, SIZE, CAPTION_PX = 24, 120, (240, 180), 18
CAPTIONS = ["recording (rendered)", "twin", "MuJoCo"]


def photos(bag):
    """Half of the frames from each state, spread over its sweep."""
    store, chosen = get_typestore(Stores.ROS2_JAZZY), []
    for state in sorted(bag.glob("state*"))[:2]:
        with Reader(state) as reader:
            topics = [c for c in reader.connections if c.msgtype.endswith("CompressedImage") and "depth" not in c.topic]
            images = [bytes(store.deserialize_cdr(raw, c.msgtype).data) for c, _, raw in reader.messages(connections=topics)]
        picks = np.linspace(0, len(images) - 1, FRAMES // 2).round().astype(int)
        chosen += [Image.open(io.BytesIO(images[i])).convert("RGB") for i in picks]
    return chosen


def turntable(run):
    frames = [f.convert("RGB") for f in ImageSequence.Iterator(Image.open(run / "preview/turntable.gif"))]
    return [frames[i * len(frames) // FRAMES] for i in range(FRAMES)]


def stage(run):
    """The twin's MJCF on a floor, and a camera that looks from where the recording did."""
    report = json.loads((run / "report.json").read_text())
    spec = mujoco.MjSpec.from_file(str(run / f"{run.name}.xml"))
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 2 * SIZE[0], 2 * SIZE[1]
    bare = spec.compile()
    data = mujoco.MjData(bare)
    mujoco.mj_forward(bare, data)
    corners = np.concatenate([vertices(bare, data, g) for g in range(bare.ngeom)])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    checks = spec.add_texture(name="floor", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER, width=256, height=256)
    checks.rgb1, checks.rgb2 = [0.80, 0.83, 0.86], [0.72, 0.76, 0.80]
    floor = spec.add_material(name="floor", texrepeat=[8, 8])
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    size, middle = np.linalg.norm(upper - lower), (lower + upper) / 2
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3 * size, 3 * size, 0.1], pos=[*middle[:2], lower[2] - 0.002], material="floor", contype=0, conaffinity=0)
    spec.worldbody.add_light(pos=middle + np.array([0.6, -0.8, 2.0]) * size, dir=[-0.3, 0.4, -1.0], diffuse=[0.5, 0.5, 0.5])
    from_object = np.mean([np.array(v["camera"]["world_from_camera"])[:3, 3] for v in report["renderings"]], axis=0) - middle
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance, camera.elevation = middle, 1.75 * size, -25
    camera.azimuth = math.degrees(math.atan2(-from_object[1], -from_object[0])) + 30
    return spec.compile(), camera, [s["joints"] for s in report["states"][:2]]


def vertices(model, data, geom):
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def simulated(run):
    """One period of a swing through the observed interval: a controller's efforts on the joints, not set positions."""
    model, camera, (start, end) = stage(run)
    data, options, pictures = mujoco.MjData(model), mujoco.MjvOption(), []
    options.geomgroup[3] = 0  # collision solids
    steps = round(PERIOD_MS / 1000 / model.opt.timestep)
    with mujoco.Renderer(model, 2 * SIZE[1], 2 * SIZE[0]) as renderer:
        for k in range(2 * FRAMES):  # the first period settles
            for s in range(steps):
                share = 0.5 - 0.5 * math.cos(2 * math.pi * (k + s / steps) / FRAMES)
                for name in start:
                    joint, target = data.joint(name), start[name] + share * (end[name] - start[name])
                    pull = 400 * (target - joint.qpos[0]) - 40 * joint.qvel[0]
                    joint.qfrc_applied[0] = pull * model.dof_M0[model.joint(name).dofadr[0]]
                mujoco.mj_step(model, data)
            if k >= FRAMES:
                renderer.update_scene(data, camera, options)
                pictures.append(Image.fromarray(renderer.render()))
    return pictures


def main():
    out, pairs = Path(sys.argv[1]), [Path(a) for a in sys.argv[2:]]
    rows = [(photos(bag), turntable(run), simulated(run)) for bag, run in zip(pairs[::2], pairs[1::2])]
    frames = []
    for k in range(FRAMES):
        page = Image.new("RGB", (3 * SIZE[0], CAPTION_PX + len(rows) * SIZE[1]), "white")
        for c, caption in enumerate(CAPTIONS):
            ImageDraw.Draw(page).text((c * SIZE[0] + 8, 3), caption, fill="black")
            for r, row in enumerate(rows):
                page.paste(row[c][k].resize(SIZE, Image.Resampling.LANCZOS), (c * SIZE[0], CAPTION_PX + r * SIZE[1]))
        frames.append(page)
    palette = Image.new("RGB", (frames[0].width, 4 * frames[0].height))
    for i in range(4):
        palette.paste(frames[i * FRAMES // 4], (0, i * frames[0].height))
    palette = palette.quantize(80)
    frames = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=PERIOD_MS, loop=0, optimize=False)
    print(out, out.stat().st_size)


if __name__ == "__main__":
    main()
