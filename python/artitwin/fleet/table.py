"""The objects of a fleet: rows of a table, or what a pattern finds."""

import csv
import fnmatch
import io
import json
import posixpath
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any
from urllib.parse import quote, unquote

from ..errors import ArtitwinError
from .store import as_uri, is_uri, open_store

MOST_ROWS = 300_000
"""measured: eval/fleet/README.md; up to here the head's loop keeps up, and 11 KB a row are 3.2 GB."""
_MOST_BYTES = 256 << 20
"""derived: 0.9 KB a row, at most rows."""
_MOST_CELL = 64 << 10
"""Longest cell, characters."""
_MOST_INPUTS = 1000
"""Most inputs of a row."""
_OWN = ("--out", "--json", "--estimate", "--jobs", "--resume", "--force", "--name")
"""Options that the fleet sets, or that have no sense for a job of it."""
_PATTERN = re.compile(r"[*?\[]")


class TableError(ArtitwinError):
    """A table that cannot be used."""


@dataclass(frozen=True)
class Row:
    """An object, or for `diagnose` a log of a machine."""

    number: int
    """From 0, in the order of the table."""
    name: str | None
    inputs: tuple[str, ...]
    """URIs; for `diagnose` the twin, then its runs."""
    options: tuple[str, ...]
    machine: str | None = None
    time: float | None = None
    """Seconds since 1970 (UTC)."""

    @property
    def label(self) -> str:
        """What it is called on the screen."""
        own = posixpath.basename(unquote(self.inputs[-1])) if self.machine is None else self.machine
        return self.name or own


def read_objects(objects: str, command: str, common: Sequence[str]) -> list[Row]:
    """The rows of a table or pattern; `common` are options of all of them."""
    refuse_own_options(common, "after `--`")
    suffix = posixpath.splitext(objects)[1].lower()
    if _PATTERN.search(objects):
        if command == "diagnose":
            raise TableError("diagnose needs a table: columns twin, runs, machine, time")
        found = matches(as_uri_of_pattern(objects))
        rows = [Row(n, None, (uri,), tuple(common)) for n, uri in enumerate(found)]
    elif suffix in (".csv", ".jsonl", ".parquet"):
        rows = _of_table(objects, suffix, command, common)
    else:
        raise TableError(f"`{objects}` is no table (.csv, .jsonl, .parquet) and no pattern (*, ?, [...])")
    if not rows:
        raise TableError(f"`{objects}` names no object")
    return rows


def refuse_own_options(options: Sequence[str], where: str) -> None:
    """Options of the fleet are none of a job's."""
    own = next((o for o in options if o.partition("=")[0] in _OWN), None)
    if own is not None:
        raise TableError(f"{where}: `{own}` is set by the fleet, or has no sense in it")


def as_uri_of_pattern(pattern: str) -> str:
    """A pattern of local paths or URIs as one of URIs."""
    if is_uri(pattern):
        return pattern
    fixed = posixpath.dirname(_PATTERN.split(pattern)[0])
    base = as_uri(fixed or ".")
    return f"{base}/{quote(pattern[len(fixed) :].lstrip('/'), safe='/*?[]!')}"


def matches(pattern: str) -> list[str]:
    """URIs that a pattern matches, sorted. A star matches inside one part of a path, and no hidden name."""
    fixed = _PATTERN.split(pattern)[0].rpartition("/")[0]
    parts = [unquote(part) for part in pattern[len(fixed) :].strip("/").split("/")]
    store = open_store(fixed)
    found = [""]
    for depth, part in enumerate(parts):
        is_last = depth == len(parts) - 1
        found = [
            posixpath.join(folder, name)
            for folder in found
            for name, is_folder in store.children(MOST_ROWS, folder)
            if fnmatch.fnmatchcase(name, part)
            and (is_last or is_folder)
            and not (name.startswith(".") and not part.startswith("."))
        ]
        if len(found) > MOST_ROWS:
            raise TableError(f"`{pattern}` matches more than {MOST_ROWS} names")
    return [f"{fixed}/{quote(path)}" for path in sorted(found)]


def _of_table(objects: str, suffix: str, command: str, common: Sequence[str]) -> list[Row]:
    uri = as_uri(objects)
    base, _, file = uri.rpartition("/")
    data = open_store(base).read(unquote(file), _MOST_BYTES)
    if data is None:
        raise TableError(f"cannot read `{objects}`: there is no such file")
    try:
        values = {".csv": _csv, ".jsonl": _jsonl, ".parquet": _parquet}[suffix](data)
    except (ValueError, OSError, csv.Error) as error:
        raise TableError(f"cannot read `{objects}`: {error}") from error
    if len(values) > MOST_ROWS:
        raise TableError(f"`{objects}` has more than {MOST_ROWS} rows")
    if not values:
        return []
    needed, more = {
        "reconstruct": ({"inputs"}, {"name", "options"}),
        "diagnose": ({"twin", "runs"}, {"machine", "time", "name", "options"}),
    }[command]
    columns = set().union(*(value.keys() for value in values))
    if not needed <= columns:
        raise TableError(f"`{objects}` has no column {', '.join(sorted(needed - columns))}")
    unknown = sorted(columns - needed - more)
    if unknown:
        known = ", ".join(sorted(needed | more))
        raise TableError(f"`{objects}`: unknown column `{unknown[0]}`; there are {known}")
    return [_row(n, v, command, common, base, f"{objects}, row {n + 1}") for n, v in enumerate(values)]


def _row(
    number: int, value: Mapping[str, Any], command: str, common: Sequence[str], base: str, where: str
) -> Row:
    options = _words(value.get("options"), where)
    refuse_own_options(options, where)
    if command == "reconstruct":
        inputs = _words(value.get("inputs"), where)
    else:
        inputs = [*_words(value.get("twin"), where)[:1], *_words(value.get("runs"), where)]
    if len(inputs) < (1 if command == "reconstruct" else 2):
        raise TableError(f"{where}: no {'inputs' if command == 'reconstruct' else 'twin or runs'}")
    if len(inputs) > _MOST_INPUTS:
        raise TableError(f"{where}: more than {_MOST_INPUTS} inputs")
    name = value.get("name")
    machine = value.get("machine")
    return Row(
        number,
        str(name) if name not in (None, "") else None,
        tuple(as_uri(path, base) for path in inputs),
        (*common, *options),
        str(machine) if machine not in (None, "") else None,
        _time(value.get("time"), where),
    )


def _words(value: Any, where: str) -> list[str]:
    """A list, or a text of words as a shell would read them."""
    if value is None:
        return []
    words = [str(word) for word in value] if isinstance(value, (list, tuple)) else None
    try:
        words = shlex.split(str(value)) if words is None else words
    except ValueError as error:
        raise TableError(f"{where}: {error}") from error
    if any(len(word) > _MOST_CELL for word in words):
        raise TableError(f"{where}: a word of more than {_MOST_CELL} characters")
    return words


def _time(value: Any, where: str) -> float | None:
    """Seconds since 1970 or ISO 8601; without a zone it is UTC."""
    if value in (None, ""):
        return None
    try:
        if isinstance(value, datetime):
            at = value
        elif isinstance(value, (int, float)) or re.fullmatch(r"[0-9.eE+]+", str(value)):
            return float(value)
        else:
            at = datetime.fromisoformat(str(value).strip().replace("Z", "+00:00"))
    except ValueError as error:
        raise TableError(f"{where}: `{value}` is no time: {error}") from error
    return (at if at.tzinfo else at.replace(tzinfo=timezone.utc)).timestamp()


def _csv(data: bytes) -> list[dict[str, Any]]:
    csv.field_size_limit(_MOST_CELL)
    rows = list(csv.DictReader(io.StringIO(data.decode("utf-8-sig")), strict=True))
    if any(None in row for row in rows):
        raise ValueError("a row has more cells than the head")
    return rows


def _jsonl(data: bytes) -> list[dict[str, Any]]:
    rows = [json.loads(line) for line in data.decode("utf-8").splitlines() if line.strip()]
    if not all(isinstance(row, dict) for row in rows):
        raise ValueError("a line is no object")
    return rows


def _parquet(data: bytes) -> list[dict[str, Any]]:
    from pyarrow import BufferReader, parquet  # type: ignore[import-untyped]

    file = parquet.ParquetFile(BufferReader(data))
    if file.metadata.num_rows > MOST_ROWS:
        raise ValueError(f"more than {MOST_ROWS} rows")
    rows: list[dict[str, Any]] = file.read().to_pylist()
    return rows

