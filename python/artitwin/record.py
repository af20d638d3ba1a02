"""JSON as frozen dataclasses: names and annotations of the fields are the keys and their types."""

import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .errors import ReportError

# Not NDArray, which newer versions of numpy hide from get_origin.
Array = np.ndarray[Any, np.dtype[np.float64]]
"""Numbers that cannot be written to; `null` is NaN."""

T = TypeVar("T")


def load(path: Path) -> dict[str, Any]:
    """The object in a JSON file."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ReportError(f"cannot read `{path}`: {error}") from error
    if not isinstance(value, dict):
        raise ReportError(f"`{path}` holds no object")
    return value


def record(kind: type[T], value: Mapping[str, Any], where: str) -> T:
    """A dataclass from a JSON object; `where` names it in errors. Keys without a field are passed over."""
    assert dataclasses.is_dataclass(kind)
    hints = typing.get_type_hints(kind)
    known: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        key = field.metadata.get("key", field.name)
        if key in value:
            known[field.name] = _read(hints[field.name], value[key], f"{where}.{key}")
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ReportError(f"{where} has no `{key}`")
    return kind(**known)


def _read(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _read(arguments[0], value, where)
    try:
        if dataclasses.is_dataclass(kind):
            return record(typing.cast("type[Any]", kind), dict(value), where)
        if origin is tuple:
            return tuple(_read(arguments[0], item, f"{where}[{i}]") for i, item in enumerate(value))
        if origin is Mapping:
            items = {key: _read(arguments[1], item, f"{where}.{key}") for key, item in value.items()}
            return types.MappingProxyType(items)
        if origin is np.ndarray:
            array = np.array(value, dtype=np.float64)
            array.flags.writeable = False
            return array
        # The program writes a number that is not finite as null.
        return float("nan") if kind is float and value is None else kind(value)
    except (AttributeError, TypeError, ValueError) as error:
        raise ReportError(f"{where}: {error}") from error
