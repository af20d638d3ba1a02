"""Opens a page of a report in headless Chromium at the widths of a phone, a tablet and a desktop, and says what of it does not fit.

    python handoff_report.py PAGE [--pictures DIR]

The last line is JSON: {"cut": {width: [what does not fit]}, "errors": [console errors]}. Needs chromium on the PATH.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from browser import opened
from PIL import Image

WIDTHS = (390, 768, 1280)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("page", type=Path)
    arguments.add_argument("--pictures", type=Path)
    options = arguments.parse_args()
    cut = {}
    with opened(options.page) as page:
        page.wait(lambda: page.value("document.readyState") == "complete")
        for width in WIDTHS:
            page.resize(width, 844)
            cut[width] = page.cut()
            if options.pictures:
                options.pictures.mkdir(parents=True, exist_ok=True)
                page.resize(width, page.value("document.documentElement.scrollHeight"))
                Image.fromarray(page.picture().astype(np.uint8)).save(options.pictures / f"report_{width}.png")
    print(json.dumps({"cut": cut, "errors": page.errors}))


if __name__ == "__main__":
    main()
