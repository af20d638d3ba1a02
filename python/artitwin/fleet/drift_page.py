"""The page and the table of the machines that drift."""

import html
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timezone
from typing import Any
from urllib.parse import quote

import pyarrow as pa  # type: ignore[import-untyped]

from .drift import Drift, Point, main_points
from .page import head
from .results import MARK

_MOST_ROWS = 1000
"""Rows of the page; the table has all."""
_MOST_PLOTS = 24
"""Plots of single machines; as many as a screen or two."""
_COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2")
_POINT = pa.struct(
    [
        ("time", pa.float64()),
        ("log", pa.int64()),
        ("parameter", pa.string()),
        ("value", pa.float64()),
        ("lower", pa.float64()),
        ("upper", pa.float64()),
        ("unit", pa.string()),
    ]
)


def drift_schema() -> Any:
    """Columns of the table: a row a machine, joint and effect."""
    columns = [
        ("machine", pa.string()),
        ("joint", pa.string()),
        ("effect", pa.string()),
        ("since", pa.float64()),
        ("after", pa.float64()),
        ("named", pa.int32()),
        ("silent", pa.int32()),
        ("open", pa.int32()),
        ("earlier", pa.int32()),
        ("share", pa.float64()),
        ("is_of_twin", pa.bool_()),
        ("apart", pa.float64()),
        ("is_apart", pa.bool_()),
        ("has_grown", pa.bool_()),
        ("doubts", pa.list_(pa.string())),
        ("points", pa.list_(_POINT)),
    ]
    return pa.schema(columns).with_metadata({MARK: b"diagnose"})


def drift_rows(found: Iterable[Drift]) -> list[dict[str, Any]]:
    """The same as rows."""
    return [{**vars(d), "points": [vars(p) for p in d.points], "doubts": list(d.doubts)} for d in found]


def drift_page(found: Sequence[Drift], rows: Sequence[Mapping[str, Any]], out: str) -> str:
    """The page."""
    machines = {str(row.get("machine") or row["name"]) for row in rows}
    counts: dict[str, int] = {}
    for row in rows:
        word = str(row.get("verdict") or row["status"])
        counts[word] = counts.get(word, 0) + 1
    said = ", ".join(f"{word} {count}" for word, count in sorted(counts.items()))
    drifting = {d.machine for d in found}
    timed = all(row.get("time") is not None for row in rows)
    facts = (
        f"{len(machines)} machines, {len(rows)} logs ({said}); {len(drifting)} machines differ from the twin"
    )
    ordered = sorted(
        found, key=lambda d: (d.is_of_twin and not d.is_apart, not d.is_apart, d.since, d.machine)
    )
    reports = {row["row"]: str(row["result"])[len(out) :].strip("/") for row in rows if row.get("result")}
    return (
        f'{head("Machines")}<p class="soft">{html.escape(facts)}</p>\n{_effects(found)}{_over_time(found, rows, timed)}'
        f"{_table(ordered, timed, reports)}{_plots(ordered, timed)}{_uncertain(len(machines))}</body>\n</html>\n"
    )


def _effects(found: Sequence[Drift]) -> str:
    groups: dict[tuple[str, str], list[Drift]] = {}
    for drift in found:
        groups.setdefault((drift.joint, drift.effect), []).append(drift)
    lines = ""
    for (joint, effect), group in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0])):
        whose = (
            "most machines have it: the twin lacks it" if group[0].is_of_twin else "these machines drifted"
        )
        apart = ", ".join(sorted(d.machine for d in group if d.is_apart)) or "none"
        cells = (
            joint,
            effect.replace("_", " "),
            f"{len(group)} ({100 * group[0].share:.0f} %)",
            whose,
            apart,
        )
        lines += "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>\n"
    heads = ("joint", "effect", "machines", "whose", "apart from the others by value")
    return _section("Effects", heads, lines)


def _table(found: Sequence[Drift], timed: bool, reports: Mapping[int, str]) -> str:
    lines = "".join(_line(drift, timed, reports) for drift in found[:_MOST_ROWS])
    heads = ("machine", "joint", "effect", "since", "absent until", "now", "change", "what is not certain")
    more = f"<p>{len(found) - _MOST_ROWS} more in the table.</p>\n" if len(found) > _MOST_ROWS else ""
    return _section("Machines", heads, lines) + more


def _line(drift: Drift, timed: bool, reports: Mapping[int, str]) -> str:
    own = main_points(drift) if drift.points else []
    grown = {None: "", True: "changes", False: "none seen"}[drift.has_grown]
    cells = [html.escape(cell) for cell in (drift.machine, drift.joint, drift.effect.replace("_", " "))]
    at = reports.get(own[-1].log) if own else None
    if at:
        cells[0] = f'<a href="{html.escape(quote(at))}/report.html">{cells[0]}</a>'
    cells += [_when(drift.since, timed), "" if drift.after is None else _when(drift.after, timed)]
    cells += [html.escape(_value(own[-1])) if own else "", grown, html.escape("; ".join(drift.doubts))]
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>\n"


def _value(point: Point) -> str:
    interval = (
        "" if point.lower is None or point.upper is None else f" [{point.lower:.3g}, {point.upper:.3g}]"
    )
    return f"{point.parameter} {point.value:.3g}{interval} {point.unit}".replace("-", "\u2212")


def _when(time: float, timed: bool) -> str:
    return f"{datetime.fromtimestamp(time, timezone.utc):%Y-%m-%d %H:%M}" if timed else f"log {time:.0f}"


def _section(title: str, heads: Sequence[str], lines: str) -> str:
    if not lines:
        return ""
    head_cells = "".join(f"<th>{cell}</th>" for cell in heads)
    return f'<h2>{title}</h2>\n<div class="scroll"><table>\n<tr>{head_cells}</tr>\n{lines}</table></div>\n'


def _over_time(found: Sequence[Drift], rows: Sequence[Mapping[str, Any]], timed: bool) -> str:
    """How many machines have each effect, over time."""
    if not found:
        return ""
    times = [d.since for d in found] + [
        float(row["time"]) for row in rows if row.get("time") is not None and timed
    ]
    begin, end = min(times), max(times)
    names = sorted({d.effect for d in found})
    most = max(sum(d.effect == name for d in found) for name in names)
    frame = _Frame(760, 240, (begin, end), (0.0, float(most)))
    drawn = ""
    for k, name in enumerate(names):
        steps, count = [(begin, 0.0)], 0
        for since in sorted(d.since for d in found if d.effect == name):
            steps += [(since, float(count)), (since, float(count + 1))]
            count += 1
        steps.append((end, float(count)))
        color = _COLORS[k % len(_COLORS)]
        drawn += frame.line(steps, color) + frame.text(
            8 + 130 * (k % 5), 14 + 14 * (k // 5), name.replace("_", " "), color
        )
    title = "<h2>Machines with an effect, over time</h2>\n"
    return title + frame.svg(drawn, _when(begin, timed), _when(end, timed), f"{most}", "0")


def _plots(found: Sequence[Drift], timed: bool) -> str:
    """The parameter of single machines with its interval."""
    shown = [d for d in found if len(main_points(d) if d.points else []) > 1][:_MOST_PLOTS]
    if not shown:
        return ""
    return (
        '<h2>Parameters over time</h2>\n<div class="cards">\n'
        + "".join(_plot(d, timed) for d in shown)
        + "</div>\n"
    )


def _plot(drift: Drift, timed: bool) -> str:
    own = main_points(drift)
    low = min(p.value if p.lower is None else p.lower for p in own)
    high = max(p.value if p.upper is None else p.upper for p in own)
    frame = _Frame(250, 150, (own[0].time, own[-1].time), (low, high))
    drawn = frame.line([(p.time, p.value) for p in own], _COLORS[0])
    for p in own:
        if p.lower is not None and p.upper is not None:
            drawn += frame.line([(p.time, p.lower), (p.time, p.upper)], _COLORS[0], 1.0)
        drawn += frame.dot(p.time, p.value, _COLORS[0])
    name = html.escape(f"{drift.machine}, {drift.joint}: {drift.effect.replace('_', ' ')}")
    what = html.escape(f"{own[0].parameter} ({own[0].unit})")
    # The day: an hour has no room.
    ends = (*(_when(p.time, timed)[:10] for p in (own[0], own[-1])), f"{high:.3g}", f"{low:.3g}")
    return f'<section class="card"><h3>{name}</h3><div class="soft">{what}</div>{frame.svg(drawn, *ends)}</section>\n'


def _uncertain(machines: int) -> str:
    # Two 95 % intervals of equal width that do not overlap: 2 * 1.96 / sqrt(2) = 2.77 deviations, p = 0.0056.
    by_chance = 0.0056 * machines
    return (
        "<h2>What is not certain</h2>\n<ul>\n"
        "<li>An effect began between the log in which it is absent and the one that names it, not at either.</li>\n"
        "<li>An effect too small for a name is absent here: the date is when it could be named, not when it began.</li>\n"
        "<li>A name rests on one log; what the later logs repeat is surer than what one says.</li>\n"
        f"<li>A change is said where the first and last 95 % intervals do not overlap: of {machines} machines without "
        f"any change, about {by_chance:.1f} would show one.</li>\n"
        "<li>A log is a machine in one load and temperature; the diagnosis does not know them.</li>\n</ul>\n"
    )


class _Frame:
    """A plot's axes, px."""

    def __init__(self, width: int, height: int, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.width, self.height = width, height
        self.x = x if x[1] > x[0] else (x[0] - 0.5, x[0] + 0.5)
        self.y = y if y[1] > y[0] else (y[0] - 0.5, y[0] + 0.5)

    def at(self, x: float, y: float) -> tuple[float, float]:
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return 50.0 + across * (self.width - 60.0), self.height - 24.0 - up * (self.height - 44.0)

    def line(self, points: Sequence[tuple[float, float]], color: str, width: float = 2.0) -> str:
        text = " ".join("{:.1f},{:.1f}".format(*self.at(x, y)) for x, y in points)
        return f'<polyline points="{text}" fill="none" stroke="{color}" stroke-width="{width}"/>\n'

    def dot(self, x: float, y: float, color: str) -> str:
        cx, cy = self.at(x, y)
        return f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="2.5" fill="{color}"/>\n'

    def text(self, x: float, y: float, text: str, color: str = "currentColor", anchor: str = "start") -> str:
        return f'<text x="{x:.0f}" y="{y:.0f}" fill="{color}" font-size="11" text-anchor="{anchor}">{html.escape(text)}</text>\n'

    def svg(self, drawn: str, left: str, right: str, top: str, bottom: str) -> str:
        (x0, y0), (x1, y1) = self.at(self.x[0], self.y[0]), self.at(self.x[1], self.y[1])
        axes = f'<path d="M{x0:.1f},{y1:.1f}V{y0:.1f}H{x1:.1f}" fill="none" stroke="currentColor"/>\n'
        labels = self.text(x0, y0 + 14, left) + self.text(x1, y0 + 14, right, anchor="end")
        labels += self.text(x0 - 4, y1 + 4, top, anchor="end") + self.text(
            x0 - 4, y0 + 4, bottom, anchor="end"
        )
        size = f'viewBox="0 0 {self.width} {self.height}" style="max-width:{self.width}px;width:100%"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img">\n{axes}{labels}{drawn}</svg>\n'
