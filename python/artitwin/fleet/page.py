"""A page of all twins of a fleet: a card each, with its picture and what there is to open.

`artitwin gallery` makes one of local folders. This one is made of the table's rows, so that it needs none of
the results' bytes: pictures and pages are linked, relative to the page, and load when they come into view.
"""

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from .results import PAGE_MARK

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1200px; padding: 16px; color: #1a1d21 }
h1 { font-size: 24px } h2 { font-size: 19px; margin-top: 28px } .soft { color: #5b6470 }
table { border-collapse: collapse } td, th { padding: 3px 10px 3px 0; text-align: left; vertical-align: top }
td.n { text-align: right; font-variant-numeric: tabular-nums }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(250px, 1fr)); gap: 14px }
.card { border: 1px solid #d5dae0; border-radius: 8px; overflow: hidden; padding-bottom: 10px }
.card > * { margin: 6px 12px 0; overflow-wrap: anywhere } .card > img { margin: 0; width: 100%; display: block;
aspect-ratio: 4 / 3; object-fit: contain; background: #fff } .card h3 { font-size: 16px } .card a { margin-right: 12px }
.pill { background: #dff0e2; border-radius: 9px; padding: 1px 8px } .pill.check { background: #f8e7c8 }
.pill.bad { background: #f6d5d2 }
.scroll { overflow-x: auto }
@media (prefers-color-scheme: dark) { body { background: #16191d; color: #e4e7eb } .soft { color: #9aa4af }
.card { border-color: #353c44 } .pill { background: #24492b } .pill.check { background: #5a4212 }
.pill.bad { background: #5e2320 } a { color: #8ab8ff } }
"""
_POLICY = "default-src 'none'; img-src 'self' file: data: http: https:; style-src 'unsafe-inline'"
"""Nothing that runs: no name out of a recording can make the page do something."""


def head(title: str) -> str:
    """A page up to its first section."""
    return (
        f'<!DOCTYPE html>\n{PAGE_MARK}\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{html.escape(title)}</h1>\n"
    )


def gallery(rows: Sequence[Mapping[str, Any]], out: str) -> str:
    """The page of reconstructions; `rows` are those of the table, `out` the place of the page."""
    counts: dict[str, int] = {}
    for row in rows:
        counts[row["status"]] = counts.get(row["status"], 0) + 1
    said = ", ".join(f"{status} {count}" for status, count in sorted(counts.items()))
    without = [row for row in rows if not row.get("result")]
    cards = "".join(_card(row, out) for row in rows if row.get("result"))
    return f'{head("Fleet")}<p class="soft">{said}</p>\n{_list(without)}<div class="cards">\n{cards}</div>\n</body>\n</html>\n'


def _list(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return ""
    lines = "".join(
        f"<tr><td>{html.escape(str(row['name']))}</td><td>{row['status']}</td>"
        f"<td>{html.escape(row.get('message') or '')}</td></tr>\n"
        for row in rows
    )
    return (
        '<h2>Without a twin</h2>\n<div class="scroll"><table>\n<tr><th>name</th><th>status</th><th>why</th></tr>\n'
        f"{lines}</table></div>\n<h2>Twins</h2>\n"
    )


def _card(row: Mapping[str, Any], out: str) -> str:
    folder = str(row["result"])[len(out) :].strip("/")
    name = html.escape(str(row["name"]))
    at = html.escape(quote(folder))
    degraded = row["status"] != "done"
    warnings = ", ".join(row.get("warnings") or ())
    pill = f'<span class="pill{" check" if degraded else ""}">{row.get("parts") or 0} parts, {row["status"]}</span>'
    joints = "".join(f"<div>{html.escape(motion(joint))}</div>\n" for joint in row.get("joints") or ())
    return (
        f'<section class="card">\n<img loading="lazy" alt="" src="{at}/preview/thumbnail.png">\n<h3>{name}</h3>\n'
        f'<div>{pill}</div>\n{joints}<div class="soft">{html.escape(warnings)}</div>\n'
        f'<div><a href="{at}/report.html">report</a><a href="{at}/viewer.html">viewer</a></div>\n</section>\n'
    )


def motion(joint: Mapping[str, Any]) -> str:
    """A joint in a line."""
    value = joint.get("motion")
    if value is None:
        return f"{joint['name']}: {joint['type']}"
    if joint.get("unit") == "rad":
        return f"{joint['name']}: {joint['type']}, {math.degrees(value):.1f}\N{DEGREE SIGN}"
    return f"{joint['name']}: {joint['type']}, {1e3 * value:.1f} mm"
