"""Renders a twin in MuJoCo from the recorded cameras of its report, beside the recorded photos.

    python mujoco_pictures.py DIR NAME [--add]

Prints a JSON list of state, view and PSNR over the object's pixels, the background of the rendering included. `--add` puts the
pictures into DIR/report.html; DIR then counts as edited, and `reconstruct` does not replace it without `--force`. Set
MUJOCO_GL=egl where there is a GPU; the default is osmesa (Debian: libosmesa6). Light is even (the textures hold the light of
the recording).
"""

import argparse
import base64
import html
import io
import json
import math
import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "osmesa")  # before the import, which reads it

import mujoco
import numpy as np
from PIL import Image

MARK = '<section id="mujoco">'


def rendered(folder, name, state, camera, spec=None):
    """RGB of the twin in an observed state; of `spec` in place of the file's, if given. What collides is not drawn."""
    k = camera["intrinsics"]
    spec = spec or mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))
    spec.visual.global_.offwidth, spec.visual.global_.offheight = k["width"], k["height"]
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse, spec.visual.headlight.specular = [1] * 3, [0] * 3, [0] * 3
    spec.visual.map.znear = 0.001
    for light in list(spec.lights):
        spec.delete(light)
    model = spec.compile()
    data = mujoco.MjData(model)
    for joint, position in state["joints"].items():
        data.joint(joint).qpos[0] = position
    mujoco.mj_forward(model, data)
    options = mujoco.MjvOption()
    collide = {int(g) for g, c in zip(model.geom_group, model.geom_contype) if c}
    for group in collide:
        options.geomgroup[group] = 0
    with mujoco.Renderer(model, k["height"], k["width"]) as renderer:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        renderer.update_scene(data, scene_option=options)
        pose = np.array(camera["world_from_camera"])
        for view in renderer.scene.camera:
            view.pos, view.forward, view.up = pose[:3, 3], pose[:3, 2], -pose[:3, 1]
            near = view.frustum_near
            # Edges of the image at the near plane; integer pixel coordinates are pixel centers, v points down.
            left, right = (-0.5 - k["cx"]) / k["fx"], (k["width"] - 0.5 - k["cx"]) / k["fx"]
            top, bottom = (k["cy"] + 0.5) / k["fy"], (k["cy"] + 0.5 - k["height"]) / k["fy"]
            view.frustum_center, view.frustum_width = near * (left + right) / 2, near * (right - left) / 2
            view.frustum_top, view.frustum_bottom = near * top, near * bottom
            view.orthographic = 0
        return renderer.render()


def uri(rgb, box):
    out = io.BytesIO()
    Image.fromarray(rgb).crop(box).save(out, "PNG")
    return "data:image/png;base64," + base64.b64encode(out.getvalue()).decode()


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("name")
    arguments.add_argument("--add", action="store_true")
    options = arguments.parse_args()
    report = json.loads((options.folder / "report.json").read_text())
    found, figures = [], []
    for view in report["renderings"]:
        photo = np.array(Image.open(options.folder / view["photo"]))
        seen = photo[..., 3] > 0
        twin = rendered(options.folder, options.name, report["states"][view["state"]], view["camera"])
        squared = np.mean((photo[seen][:, :3].astype(float) - twin[seen].astype(float)) ** 2)
        psnr_db = 10 * math.log10(255**2 / max(squared, 1e-9))
        found.append({"state": view["state"], "view": view["view"], "psnr_db": psnr_db})
        rows, columns = np.nonzero(seen)
        box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        caption = f"state {view['state']}, view {html.escape(view['view'])}"
        pair = ((photo[..., :3], f"{caption}, photo"), (twin, f"{caption}, MuJoCo, {psnr_db:.1f} dB"))
        figures += [f'<figure><img src="{uri(rgb, box)}" alt=""><figcaption>{text}</figcaption></figure>' for rgb, text in pair]
    if options.add:
        page = options.folder / "report.html"
        text = page.read_text().split(MARK)[0].removesuffix("</body></html>").rstrip()
        page.write_text(f'{text}{MARK}<h2>In MuJoCo</h2><div class="pictures">{"".join(figures)}</div></section></body></html>\n')
    print(json.dumps(found))


if __name__ == "__main__":
    main()
