"""Opens viewer.html in headless Chromium, moves a slider and says how much of the picture changed.

    python handoff_viewer.py PAGE JOINT [--pictures DIR]

The last line is JSON: {"meshes": drawn, "shown": share of the picture that is not background, "changed": share that the slider changed,
"errors": [console errors]}. Needs chromium on the PATH.
"""

import argparse
import base64
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np
import websocket
from PIL import Image

PORT_FILE = "DevToolsActivePort"


class Page:
    def __init__(self, url, profile):
        program = shutil.which("chromium") or shutil.which("chromium-browser") or sys.exit("no chromium on the PATH")
        flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--remote-allow-origins=*", "--window-size=960,720", "--hide-scrollbars"]
        self.process = subprocess.Popen([program, *flags, f"--user-data-dir={profile}", url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port = self.wait(lambda: (Path(profile) / PORT_FILE).read_text().split()[0] if (Path(profile) / PORT_FILE).exists() else None)
        tabs = self.wait(lambda: [t for t in json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json")) if t["type"] == "page"] or None)
        self.socket = websocket.create_connection(tabs[0]["webSocketDebuggerUrl"], timeout=120)
        self.count, self.errors = 0, []
        self.call("Runtime.enable")
        self.call("Log.enable")

    @staticmethod
    def wait(ask, seconds=90):
        for _ in range(int(seconds / 0.2)):
            found = ask()
            if found:
                return found
            time.sleep(0.2)
        raise TimeoutError("chromium did not answer")

    def call(self, method, **parameters):
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv())
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(answer["params"]["exceptionDetails"]["text"])
            if answer.get("method") == "Log.entryAdded" and answer["params"]["entry"]["level"] == "error":
                self.errors.append(answer["params"]["entry"]["text"])
            if answer.get("id") == self.count:
                return answer["result"]

    def value(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def picture(self):
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(self.call("Page.captureScreenshot")["data"]))).convert("RGB")).astype(int)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("page", type=Path)
    arguments.add_argument("joint")
    arguments.add_argument("--pictures", type=Path)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        page = Page(options.page.resolve().as_uri(), profile)
        try:
            count = page.wait(lambda: page.value("twin.meshes.length"))
            page.wait(lambda: page.value("Number(document.body.dataset.drawn)") == count)
            before = page.picture()
            move = f"(() => {{ const s = document.getElementById('{options.joint}'); const far = Math.abs(s.max - s.value) > Math.abs(s.min - s.value) ? s.max : s.min; s.value = far; s.dispatchEvent(new Event('input')); return Number(s.value); }})()"
            page.value(move)
            time.sleep(0.5)
            after = page.picture()
            errors = page.errors
        finally:
            page.process.terminate()
            page.process.wait()
    # The panel with the sliders is left out.
    view = (slice(200, None), slice(None))
    background = np.abs(before[view] - [243, 244, 246]).max(axis=2) <= 3
    changed = np.abs(before[view] - after[view]).max(axis=2) > 12
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for name, image in (("before", before), ("after", after)):
            Image.fromarray(image.astype(np.uint8)).save(options.pictures / f"viewer_{name}.png")
    print(json.dumps({"meshes": count, "shown": float((~background).mean()), "changed": float(changed.mean()), "errors": errors}))


if __name__ == "__main__":
    main()
