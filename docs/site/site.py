"""Builds the site: all pages that README leads to, and a gallery of twins with their viewers.

    python docs/site/site.py OUT [--artitwin PATH] [--runs DIR --about TEXT]

Needs docs/site/requirements.txt. Without --runs the gallery is of eight objects that anybody can make: the shipped
recordings, and made ones, reconstructed by the preset `preview`; with it, of the results in DIR, whose recordings
are what TEXT says. OUT is replaced if this wrote it.
"""

import argparse
import html
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# Written into a site, so that a later build knows that it may replace it.
MARK = "made_by_site_py"
# Not real_box, in which nothing moves: the preset finds no motion for its noise, and refuses.
SHIPPED = {"drawer": "rendered", "laptop": "rendered", "drawer_raw": "rendered"}
# Name: options of `artitwin synth`.
MADE = {
    "cabinet": "--seed 12 --family cabinet --parts 3 --handles bar",
    "lamp": "--seed 7 --family lamp --parts 3",
    "folding_door": "--seed 4105 --family folding_door --parts 3",
    "capped_box": "--seed 3 --family capped_box --parts 2",
    "clamshell": "--seed 4 --family clamshell --parts 2",
}
# As few and as small as the shipped recordings: seconds for each object.
VIEWS = "--views 16 --width 320 --height 240"
LINK = re.compile(r"\]\(([^)\s#]+)")
UNIT = {"rad": lambda value: f"{math.degrees(value):.1f} deg", "m": lambda value: f"{1000 * value:.1f} mm"}


def lay_out(pages):
    """Copies README, the pages of docs, and every file that a link leads to, as they lie in the repository."""
    todo, seen = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], set()
    while todo:
        file = todo.pop()
        if file in seen:
            continue
        seen.add(file)
        copy = pages / file.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, copy)
        if file.suffix == ".md":
            links = (link for link in LINK.findall(file.read_text()) if not urlsplit(link).scheme)
            targets = [(file.parent / unquote(link)).resolve() for link in links]
            missing = [str(target) for target in targets if not target.is_file()]
            if missing:
                sys.exit(f"{file}: leads to what is no file: {', '.join(missing)}")
            todo += targets


def make_runs(artitwin, work):
    """The twins of the eight objects; (folder, what was recorded, the commands that make it) of each."""
    runs = work / "runs"

    def call(*arguments):
        ended = subprocess.run([artitwin, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True)
        if ended.returncode not in (0, 3):  # 3: with warnings, which the report shows
            sys.exit(f"artitwin {' '.join(map(str, arguments))}: {ended.stderr}")

    for name in SHIPPED:
        call("reconstruct", ROOT / "bags" / name, "--preset", "preview", "--out", runs)
        command = f"artitwin reconstruct bags/{name} --preset preview --out runs"
        yield runs / name, SHIPPED[name], command
    for name, options in MADE.items():
        call("synth", "--out", work / name, *options.split(), *VIEWS.split())
        call("reconstruct", work / name, "--preset", "preview", "--out", runs)
        command = f"artitwin synth --out {name} {options} {VIEWS}\nartitwin reconstruct {name} --preset preview --out runs"
        yield runs / name, "made, rendered", command


def gallery(runs, folder):
    """Writes the gallery's page and copies what it shows of each result."""
    cards, commands = [], []
    for run, kind, command in runs:
        report = json.loads((run / "report.json").read_text())
        (folder / run.name).mkdir(parents=True)
        for file in ["viewer.html", "report.html", "preview/thumbnail.png"]:
            shutil.copy(run / file, folder / run.name)
        name = html.escape(run.name)
        joints = [f"{j['type']}, {UNIT[j['motion']['unit']](j['motion']['value'])}" for j in report["joints"]]
        found = "<br>".join(joints) or "one part, no joint"
        warnings = len(report["warnings"])
        said = f"<br>{warnings} warning{'s' * (warnings != 1)} in the report" if warnings else ""
        cards.append(
            f'<div class="twin"><a href="{name}/viewer.html"><img src="{name}/thumbnail.png" alt="{name}" loading="lazy"></a>'
            f'<p><b>{name}</b> ({kind})</p><p>{found}{said}</p>'
            f'<p><a href="{name}/viewer.html">viewer</a> · <a href="{name}/report.html">report</a></p></div>'
        )
        commands.append(command)
    first = runs[0][0].name
    text = f"""# Gallery

Twins of {len(cards)} objects as the program left them; surfaces that no view saw are missing. The viewer moves the joints.

<iframe class="viewer" src="{first}/viewer.html" title="{first}"></iframe>

<div class="twins">
{chr(10).join(cards)}
</div>

## To repeat

```sh
{chr(10).join(commands)}
```
"""
    (folder / "index.md").write_text(text)
    shutil.copy(HERE / "gallery.css", folder)


class Page(HTMLParser):
    """What a page names, and what it leads to."""

    def __init__(self, file):
        super().__init__()
        self.ids, self.links = set(), set()
        self.feed(file.read_text())

    def handle_starttag(self, tag, attributes):
        for key, value in attributes:
            if key in ("id", "name") and value:
                self.ids.add(value)
            elif key in ("href", "src") and value:
                self.links.add(value)


def broken_links(site):
    """Links of the site that lead nowhere in it."""
    twins = {page for page in site.glob("gallery/*/*.html")}  # pages of the program, whose scripts set their links
    pages = {page: Page(page) for page in site.rglob("*.html") if page not in twins}
    for file, page in pages.items():
        for link in sorted(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or file.name == "404.html":
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment)
            if not target.is_file() or (target in pages and anchor and anchor not in pages[target].ids):
                yield f"{file.relative_to(site)}: {link}"


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("out", type=Path, metavar="OUT")
    options.add_argument("--artitwin", default="artitwin", metavar="PATH")
    options.add_argument("--runs", type=Path, metavar="DIR")
    options.add_argument("--about", metavar="TEXT", help="what the recordings of --runs are, e.g. rendered")
    chosen = options.parse_args()
    if bool(chosen.runs) != bool(chosen.about):
        options.error("--runs and --about go together")
    out = chosen.out
    if out.exists() and not (out / MARK).exists():
        sys.exit(f"{out} is there and no site: give another folder")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        lay_out(work / "pages")
        if chosen.runs:
            found = sorted(report.parent for report in chosen.runs.glob("*/viewer.html"))
            runs = [(run, chosen.about, f"artitwin reconstruct {run.name} --out runs") for run in found]
        else:
            runs = list(make_runs(shutil.which(chosen.artitwin) or sys.exit("artitwin is not there"), work))
        gallery(runs, work / "pages/gallery")
        shutil.copy(HERE / "zensical.toml", work)
        built = subprocess.run([sys.executable, "-m", "zensical", "build", "--strict", "-f", str(work / "zensical.toml")])
        if built.returncode:
            sys.exit(built.returncode)
        site = (work / "site").resolve()
        broken = list(broken_links(site))
        if broken:
            sys.exit("links that lead nowhere:\n" + "\n".join(broken))
        (site / MARK).touch()
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(site, out)
    print(f"{out}/index.html: {len(list(out.rglob('*.html')))} pages")


if __name__ == "__main__":
    main()
