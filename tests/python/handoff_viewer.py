"""Opens viewer.html in headless Chromium, does everything that its panel offers, and says how much of the picture each step changed.

    python handoff_viewer.py PAGE JOINT [--pictures DIR]

The last line is JSON: {"meshes": drawn, "shown": share of the picture that is not background, "changed": {step: share of the picture}, "cut":
{size: [what does not fit]}, "errors": [console errors]}. Needs chromium on the PATH.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from browser import opened
from PIL import Image

SIZES = {"desktop": (1280, 900), "phone": (390, 844), "landscape": (844, 390), "tablet": (768, 1024)}


class Viewer:
    def __init__(self, page, folder):
        self.page, self.folder, self.changed = page, folder, {}
        self.last = self.canvas("start")

    def canvas(self, name):
        image = self.page.picture()
        if self.folder:
            self.folder.mkdir(parents=True, exist_ok=True)
            Image.fromarray(image.astype(np.uint8)).save(self.folder / f"viewer_{name}.png")
        x, y, width, height = (round(v) for v in self.page.value("(() => { const b = canvas.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()"))
        return image[y : y + height, x : x + width]

    def step(self, name, action):
        action()
        now = self.canvas(name)
        same_size = now.shape == self.last.shape
        self.changed[name] = float((np.abs(now - self.last).max(axis=2) > 12).mean()) if same_size else None
        self.last = now

    def click(self, selector):
        self.page.value(f"document.querySelector({json.dumps(selector)}).click()")

    def key(self, key, modifiers=0):
        for kind in ("keyDown", "keyUp"):
            self.page.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers)

    def touch(self, paths):
        for k in range(len(paths[0])):
            points = [{"x": p[k][0], "y": p[k][1], "id": i} for i, p in enumerate(paths)]
            self.page.call("Input.dispatchTouchEvent", type="touchMove" if k else "touchStart", touchPoints=points)
        self.page.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def steps(viewer, joint):
    page = viewer.page
    slider = f"document.querySelector('[data-joint=\"{joint}\"]')"
    far = f"(() => {{ const s = {slider}; s.value = Math.abs(s.max - s.value) > Math.abs(s.min - s.value) ? s.max : s.min; s.dispatchEvent(new Event('input')); }})()"
    viewer.step("slider", lambda: page.value(far))
    viewer.step("play", lambda: (viewer.click("#play"), time.sleep(1.2)))
    viewer.step("pause", lambda: viewer.click("#play"))
    viewer.step("paused", lambda: time.sleep(0.5))
    for name, at in (("axes", "axes"), ("solids", "collision solids"), ("surface", "surface")):
        viewer.step(name, lambda at=at: viewer.click(f"[data-shows='{at}']"))
    # Of what is left each part goes by itself.
    for k in range(page.value("twin.links.length")):
        viewer.step(f"part_{k}", lambda k=k: viewer.click(f"#parts label:nth-of-type({k + 1}) input"))
    page.value("document.querySelectorAll('#parts input, [data-shows=surface]').forEach((e) => { if (!e.checked) e.click(); })")
    viewer.last = viewer.canvas("all")
    page.value("canvas.focus()")
    viewer.step("key_turn", lambda: viewer.key("ArrowLeft"))
    viewer.step("key_move", lambda: viewer.key("ArrowUp", modifiers=8))
    viewer.step("key_zoom", lambda: viewer.key("+"))
    viewer.step("reset", lambda: viewer.click("#reset"))
    page.resize(*SIZES["phone"], touch=True)
    viewer.last = viewer.canvas("phone")
    viewer.step("finger", lambda: viewer.touch([[(150 + 8 * k, 200) for k in range(8)]]))
    viewer.step("pinch", lambda: viewer.touch([[(150 - 2 * k, 200) for k in range(8)], [(210 + 2 * k, 200) for k in range(8)]]))
    viewer.step("two_fingers", lambda: viewer.touch([[(150 + 6 * k, 200) for k in range(8)], [(200 + 6 * k, 200) for k in range(8)]]))
    viewer.step("dark", lambda: page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}]))
    page.call("Emulation.setEmulatedMedia", features=[])


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("page", type=Path)
    arguments.add_argument("joint")
    arguments.add_argument("--pictures", type=Path)
    options = arguments.parse_args()
    with opened(options.page) as page:
        count = page.wait(lambda: page.value("twin.meshes.length"))
        page.wait(lambda: page.value("Number(document.body.dataset.drawn)") == count)
        viewer = Viewer(page, options.pictures)
        shown = float((np.abs(viewer.last - [243, 244, 246]).max(axis=2) > 3).mean())
        steps(viewer, options.joint)
        viewer.click("#reset")
        cut = {}
        for name, size in SIZES.items():
            page.resize(*size)
            cut[name] = page.cut()
            viewer.canvas(name)
    print(json.dumps({"meshes": count, "shown": shown, "changed": viewer.changed, "cut": cut, "errors": page.errors}))


if __name__ == "__main__":
    main()
