"""Files of a store, by URI: a folder of this machine, or what fsspec opens (`remote.py`)."""

import os
import posixpath
import re
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote, urlsplit

from ..errors import ArtitwinError

T = TypeVar("T")


class StoreError(ArtitwinError):
    """A store that cannot be used as it was asked to."""


class MayPassError(StoreError):
    """A store, a disk or another process was in the way; the same may succeed later."""


@dataclass(frozen=True, order=True)
class File:
    """A file at or below a place of a store."""

    path: str
    """Within the place; empty for the place itself."""
    size: int | None
    """Bytes; None where the store does not say."""
    tag: str
    """Changes with the content."""


class Store(ABC):
    """A place whose files are read and written whole."""

    lists = True
    """Whether it says what a folder holds."""

    def __init__(self, uri: str) -> None:
        self.uri = uri.rstrip("/")

    @abstractmethod
    def read(self, path: str, most: int) -> bytes | None:
        """A file of at most so many bytes; None where there is none."""

    @abstractmethod
    def write(self, path: str, data: bytes) -> None:
        """A whole file or none, in place of one of that name."""

    @abstractmethod
    def create(self, path: str, data: bytes) -> bool:
        """A whole file, unless one of that name stands; whether it is new."""

    @abstractmethod
    def children(self, most: int, path: str = "") -> list[tuple[str, bool]]:
        """Names below a folder, sorted, each with whether it is a folder itself."""

    @abstractmethod
    def files(self, most: int) -> list[File]:
        """The file at the place, or all below it, sorted; none where there is nothing."""

    def at(self, path: str) -> str:
        """The URI of a file."""
        return f"{self.uri}/{quote(path)}" if path else self.uri


def open_store(uri: str) -> Store:
    """The store of a URI."""
    if uri.startswith("file://"):
        return Folder(uri)
    from .remote import Remote

    return Remote(uri)


class Folder(Store):
    """A folder or file of this machine, by its `file://` URI."""

    def __init__(self, uri: str) -> None:
        super().__init__(uri)
        self.path = Path(unquote(urlsplit(self.uri).path) or "/")

    def read(self, path: str, most: int) -> bytes | None:
        def once() -> bytes:
            if (self.path / path).stat().st_size > most:
                raise StoreError(f"`{self.at(path)}` has more than {most} bytes")
            return (self.path / path).read_bytes()

        try:
            return self._done("read", path, once)
        except FileNotFoundError:
            return None

    def write(self, path: str, data: bytes) -> None:
        self._done("write", path, lambda: _write_whole(self.path / path, data, os.replace))

    def create(self, path: str, data: bytes) -> bool:
        try:
            self._done("write", path, lambda: _write_whole(self.path / path, data, _link))
        except FileExistsError:
            return False
        return True

    def children(self, most: int, path: str = "") -> list[tuple[str, bool]]:
        def once() -> list[tuple[str, bool]]:
            with os.scandir(self.path / path) as entries:
                return sorted((entry.name, entry.is_dir()) for entry in entries)

        try:
            return few(self._done("list", path, once), most, self.at(path))
        except (FileNotFoundError, NotADirectoryError):
            return []

    def files(self, most: int) -> list[File]:
        def once() -> list[File]:
            if self.path.is_file():
                return [_file(self.path, "")]
            # Links are followed as files only: one to a folder could lead around in circles.
            paths = (Path(folder, name) for folder, _, names in os.walk(self.path) for name in names)
            return sorted(_file(path, path.relative_to(self.path).as_posix()) for path in paths if path.is_file())

        return few(self._done("list", "", once), most, self.uri)

    def _done(self, what: str, path: str, once: Callable[[], T]) -> T:
        try:
            return once()
        except (FileNotFoundError, FileExistsError, NotADirectoryError):
            raise
        except OSError as error:
            raise MayPassError(f"cannot {what} `{self.at(path)}`: {error}") from error


def few(found: list[T], most: int, uri: str) -> list[T]:
    """What was found, unless there is more of it than there may be."""
    if len(found) > most:
        raise StoreError(f"`{uri}` holds more than {most} files")
    return found


def is_uri(text: str) -> bool:
    """Whether a text names a place by a URI."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", text) is not None


def as_uri(text: str, base: str | None = None) -> str:
    """A path as a `file://` URI, a URI as it is. A relative path counts from `base`, a URI, or from here."""
    if is_uri(text):
        return text.rstrip("/")
    if base is not None and not text.startswith("/"):
        scheme, _, rest = base.partition("://")
        whole = posixpath.normpath(posixpath.join("/", unquote(rest), text))
        return f"{scheme}://{quote(whole if rest.startswith('/') else whole.lstrip('/'))}"
    return "file://" + quote(os.path.abspath(text))


def _file(path: Path, name: str) -> File:
    status = path.stat()
    return File(name, status.st_size, str(status.st_mtime_ns))


def _write_whole(at: Path, data: bytes, put: Callable[[Path, Path], Any]) -> None:
    at.parent.mkdir(parents=True, exist_ok=True)
    aside = at.with_name(f".{at.name}.{uuid.uuid4().hex}")
    try:
        with open(aside, "xb") as local:
            local.write(data)
            local.flush()
            os.fsync(local.fileno())
        put(aside, at)
    finally:
        aside.unlink(missing_ok=True)


def _link(aside: Path, at: Path) -> None:
    """Puts a file where nothing stands, in one step."""
    try:
        os.link(aside, at)
    except OSError as error:
        if at.exists():
            raise FileExistsError(at) from error
        # A disk without links: whoever holds the job's lock is the only one to write.
        os.rename(aside, at)
