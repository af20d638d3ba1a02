"""A page in headless Chromium: what it says, what it shows, and whether all of it can be read. Needs chromium on the PATH."""

import base64
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import websocket
from PIL import Image

PORT_FILE = "DevToolsActivePort"
# Elements whose text or pictures reach beyond their own box or beyond the page; a box that scrolls by itself counts, too.
CUT = """(() => {
  const wide = document.documentElement.clientWidth, found = [];
  if (document.documentElement.scrollWidth > wide) found.push(`page: ${document.documentElement.scrollWidth} of ${wide}`);
  for (const e of document.body.querySelectorAll("*")) {
    if (e.closest("svg") || ["SCRIPT", "OPTION"].includes(e.tagName) || !e.getClientRects().length) continue;
    const box = e.getBoundingClientRect(), where = `${e.tagName.toLowerCase()}.${e.className} '${e.textContent.slice(0, 40)}'`;
    if (box.left < -1 || box.right > wide + 1) found.push(`${where}: ${Math.round(box.left)} to ${Math.round(box.right)} of ${wide}`);
    else if (e.clientWidth && e.scrollWidth > e.clientWidth + 1) found.push(`${where}: ${e.scrollWidth} in ${e.clientWidth}`);
  }
  for (const t of document.querySelectorAll("svg text")) {
    const box = t.getBoundingClientRect(), frame = t.closest("svg").getBoundingClientRect();
    if (box.left < frame.left - 1 || box.right > frame.right + 1) found.push(`label '${t.textContent}'`);
  }
  return found;
})()"""


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

    def resize(self, width, height, touch=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch)
        self.call("Emulation.setTouchEmulationEnabled", enabled=touch, maxTouchPoints=2 if touch else 1)
        time.sleep(0.3)

    def cut(self):
        return self.value(CUT)

    def picture(self):
        time.sleep(0.3)
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(self.call("Page.captureScreenshot")["data"]))).convert("RGB")).astype(int)


@contextmanager
def opened(path):
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        page = Page(Path(path).resolve().as_uri(), profile)
        try:
            yield page
        finally:
            page.process.terminate()
            page.process.wait()
