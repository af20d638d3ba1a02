"""The table of a fleet: Parquet, a row an object, whole at any time."""

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
from pyarrow import parquet

from ..errors import ArtitwinError
from .schedule import Item
from .store import Store, StoreError

MARK = b"artitwin.fleet"
"""Key of the metadata by which a later run knows that it may replace a table; its value names the command."""
PAGE_MARK = "<!-- artitwin fleet -->"
"""Stands in every page of a fleet, for the same."""
_MOST_TABLE = 2 << 30
"""derived: 7 KB a row, at most rows; the command itself writes a tenth of that."""
_PARAMETER = pa.struct(
    [
        ("name", pa.string()),
        ("value", pa.float64()),
        ("unit", pa.string()),
        ("lower", pa.float64()),
        ("upper", pa.float64()),
    ]
)
_JOINT = pa.struct(
    [
        ("name", pa.string()),
        ("type", pa.string()),
        ("axis", pa.list_(pa.float64())),
        ("origin", pa.list_(pa.float64())),
        ("motion", pa.float64()),
        ("unit", pa.string()),
        ("axis_std_deg", pa.float64()),
        ("origin_std_mm", pa.float64()),
        ("motion_std", pa.float64()),
    ]
)
_FINDING = pa.struct(
    [
        ("joint", pa.string()),
        ("effect", pa.string()),
        ("weight", pa.float64()),
        ("parameters", pa.list_(_PARAMETER)),
    ]
)
_JOB = [
    ("row", pa.int64()),
    ("name", pa.string()),
    ("key", pa.string()),
    ("status", pa.string()),
    ("exit_code", pa.int32()),
    ("message", pa.string()),
    ("warnings", pa.list_(pa.string())),
    ("seconds", pa.float64()),
    ("cpu_seconds", pa.float64()),
    ("peak_memory_bytes", pa.int64()),
    ("estimated_seconds", pa.float64()),
    ("estimated_memory_bytes", pa.int64()),
    ("bytes_stored", pa.int64()),
    ("bytes_read", pa.int64()),
    ("bytes_written", pa.int64()),
    ("requests", pa.int64()),
    ("request_retries", pa.int64()),
    ("attempts", pa.int32()),
    ("retries", pa.int32()),
    ("lost", pa.list_(pa.string())),
    ("standing", pa.bool_()),
    ("started", pa.string()),
    ("version", pa.string()),
    ("inputs", pa.list_(pa.string())),
    ("options", pa.list_(pa.string())),
    ("manifest", pa.string()),
    ("result", pa.string()),
]
_TWIN = [("parts", pa.int32()), ("overall", pa.string()), ("joints", pa.list_(_JOINT))]
_LOG = [
    ("machine", pa.string()),
    ("time", pa.float64()),
    ("verdict", pa.string()),
    ("findings", pa.list_(_FINDING)),
    ("doubts", pa.list_(pa.string())),
    ("gap_before", pa.float64()),
    ("gap_after", pa.float64()),
    ("noise_floor", pa.float64()),
]


def schema(command: str) -> Any:
    """Columns of the table of a command."""
    own = _TWIN if command == "reconstruct" else _LOG
    return pa.schema([*_JOB, *own]).with_metadata({MARK: command.encode()})


def row(item: Item, out: str) -> dict[str, Any]:
    """An object's row."""
    outcome, estimate, of = item.outcome, item.estimate, item.job.row
    manifest = outcome.manifest if outcome is not None else None
    value: dict[str, Any] = {
        "row": of.number,
        "name": (manifest.name if manifest is not None else "") or of.label,
        "key": manifest.key if manifest is not None else estimate.key if estimate is not None else None,
        "status": item.status,
        "exit_code": outcome.exit_code if outcome is not None else None,
        "message": outcome.message or None if outcome is not None else None,
        "attempts": item.attempts,
        "retries": max(0, item.attempts - 1),
        "lost": item.lost,
        "standing": item.standing,
        "inputs": list(of.inputs),
        "options": list(of.options),
        "machine": of.machine,
        "time": of.time,
    }
    if estimate is not None:
        value |= {"estimated_seconds": estimate.seconds, "estimated_memory_bytes": estimate.memory_bytes}
    if manifest is not None:
        value |= {
            "warnings": sorted({warning.code for warning in manifest.warnings}),
            "seconds": manifest.seconds,
            "cpu_seconds": manifest.cpu_seconds,
            "peak_memory_bytes": manifest.peak_memory_bytes,
            "bytes_stored": manifest.transfer.bytes_stored,
            "bytes_read": manifest.transfer.bytes_read,
            "bytes_written": manifest.transfer.bytes_written,
            "requests": manifest.transfer.requests,
            "request_retries": manifest.transfer.retries,
            "started": manifest.started,
            "version": manifest.version,
            "manifest": f"{out}/{manifest.key}.json",
            "result": f"{out}/{manifest.folder}" if manifest.folder else None,
        }
    if outcome is not None and outcome.summary is not None:
        value |= asdict(outcome.summary)
    return value


def table_bytes(rows: Iterable[Mapping[str, Any]], columns: Any) -> bytes:
    """A Parquet file."""
    names = columns.names
    kept = [{name: row.get(name) for name in names} for row in rows]
    file = io.BytesIO()
    parquet.write_table(pa.Table.from_pylist(kept, schema=columns), file, compression="zstd")
    return file.getvalue()


def may_write(store: Store, path: str, command: str) -> bool:
    """Whether a table's or page's place is free or holds one of the same command."""
    data = store.read(path, _MOST_TABLE)
    if data is None:
        return True
    if path.endswith(".html"):
        return PAGE_MARK.encode() in data[:4096]
    try:
        metadata = parquet.read_schema(pa.BufferReader(data)).metadata or {}
    except (pa.ArrowInvalid, OSError):
        return False
    return bool(metadata.get(MARK) == command.encode())


def refuse_taken(store: Store, paths: Iterable[str], command: str) -> None:
    """Nothing that this command did not write is replaced."""
    for path in paths:
        try:
            free = may_write(store, path, command)
        except StoreError as error:
            raise ArtitwinError(str(error)) from error
        if not free:
            raise ArtitwinError(f"`{store.uri}/{path}` is there and no table or page of `fleet {command}`")


def as_json(rows: Iterable[Mapping[str, Any]]) -> str:
    """The same as JSON lines, for a terminal."""
    return "".join(json.dumps(row, sort_keys=True) + "\n" for row in rows)
