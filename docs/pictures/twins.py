"""Makes a picture of twins: for each the photo, the twin in MuJoCo from the same camera, and its collision solids.

    python docs/pictures/twins.py OUT.png RUN [RUN ...]

RUN is a folder that `artitwin reconstruct` made. Needs `tests/python/requirements.txt`; MUJOCO_GL as for
`tests/python/mujoco_pictures.py`, which renders the twin.
"""

import json
import os
import sys
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "osmesa")  # before the import, which reads it
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests/python"))

import mujoco
import numpy as np
from mujoco_pictures import rendered
from PIL import Image, ImageDraw

SIZE, TITLE_PX, TWINS_A_ROW = (232, 174), 16, 2


def solids(folder, name, state, camera):
    """RGB of the collision solids, each in a color of its own."""
    spec = mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))
    colors = np.random.default_rng(1)
    for geom in list(spec.geoms):
        if geom.contype:
            geom.rgba, geom.group, geom.material = [*colors.uniform(0.35, 1, 3), 1], 0, ""
            geom.contype = geom.conaffinity = 0
        else:
            spec.delete(geom)
    return rendered(folder, name, state, camera, spec)


def cropped(rgb, box):
    picture = Image.fromarray(rgb).crop(box)
    picture.thumbnail(SIZE, Image.LANCZOS)
    out = Image.new("RGB", SIZE, "white")
    out.paste(picture, ((SIZE[0] - picture.width) // 2, (SIZE[1] - picture.height) // 2))
    return out


def row(folder):
    name = folder.name
    report = json.loads((folder / "report.json").read_text())
    # The last state, where parts are open, in the view that shows most.
    view = next(v for v in report["renderings"] if v["state"] == len(report["states"]) - 1)
    state, camera = report["states"][view["state"]], view["camera"]
    photo = np.array(Image.open(folder / view["photo"]))
    seen = photo[..., 3] > 0
    rows, columns = np.nonzero(seen)
    # Borders of the picture that hold the object and a little more.
    box = [max(int(columns.min()) - 12, 0), max(int(rows.min()) - 12, 0)]
    box += [min(int(columns.max()) + 12, seen.shape[1]), min(int(rows.max()) + 12, seen.shape[0])]
    pictures = [np.where(seen[..., None], photo[..., :3], 255).astype(np.uint8)]
    for picture in (rendered(folder, name, state, camera), solids(folder, name, state, camera)):
        # MuJoCo draws nothing as black.
        pictures.append(np.where(picture.any(-1, keepdims=True), picture, 255).astype(np.uint8))
    out = Image.new("RGB", (3 * SIZE[0], SIZE[1] + TITLE_PX), "white")
    ImageDraw.Draw(out).text((4, 2), f"{name}: recording (rendered), twin in MuJoCo, its solids", fill="black")
    for k, picture in enumerate(pictures):
        out.paste(cropped(picture, box), (k * SIZE[0], TITLE_PX))
    return out


def main():
    target, folders = Path(sys.argv[1]), [Path(f) for f in sys.argv[2:]]
    rows = [row(folder) for folder in folders]
    width, height = rows[0].size
    sheet = Image.new("RGB", (TWINS_A_ROW * width, -(-len(rows) // TWINS_A_ROW) * height), "white")
    for k, picture in enumerate(rows):
        sheet.paste(picture, ((k % TWINS_A_ROW) * width, (k // TWINS_A_ROW) * height))
    sheet.quantize(128).save(target, optimize=True)


if __name__ == "__main__":
    main()
