"""Stores by fsspec: `s3://`, `gs://`, `az://`, `http://` and whatever else it opens. The only file that imports it.

Credentials and endpoints come from the environment, as the package of each store reads them (docs/fleet.md).
"""

import posixpath
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

import fsspec  # type: ignore[import-untyped]

from .store import File, MayPassError, Store, StoreError, few

T = TypeVar("T")
_WAITS_S = (0.2, 0.4, 0.8, 1.6, 3.2)
"""derived: with one request in twenty failing, six leave one of 64 million; a package's own come before."""
_TAGS = ("ETag", "etag", "generation", "md5Hash", "Last-Modified", "LastModified", "last_modified", "mtime", "created")
"""What changes with a file, under the names that the packages give it; the surest first."""


class Remote(Store):
    """A file system of fsspec with the path of a URI in it."""

    COUNTED = ("bytes_read", "bytes_written", "requests", "retries", "seconds")

    def __init__(self, uri: str) -> None:
        super().__init__(uri)
        scheme, _, rest = self.uri.partition("://")
        self.lists = scheme not in ("http", "https")
        self.counts = dict.fromkeys(self.COUNTED, 0.0)
        self._lock = threading.Lock()
        try:
            self._files, self._root = fsspec.core.url_to_fs(f"{scheme}://{unquote(rest)}")
        except (OSError, ValueError, ImportError) as error:
            raise StoreError(f"`{uri}` cannot be used: {error}") from error

    def read(self, path: str, most: int) -> bytes | None:
        def once() -> bytes:
            if (self._info(path).get("size") or 0) > most:
                raise StoreError(f"`{self.at(path)}` has more than {most} bytes")
            return bytes(self._files.cat_file(self._at(path)))

        try:
            data = self._again("read", path, once)
        except FileNotFoundError:
            return None
        self._count(bytes_read=len(data))
        return data

    def write(self, path: str, data: bytes) -> None:
        # An object appears when its upload is complete.
        self._again("write", path, lambda: self._files.pipe_file(self._at(path), data))
        self._count(bytes_written=len(data))

    def create(self, path: str, data: bytes) -> bool:
        """A store that cannot do both in one request is asked first, which leaves a gap of one request."""
        try:
            self._again("write", path, lambda: self._files.pipe_file(self._at(path), data, mode="create"))
        except FileExistsError:
            return False
        self._count(bytes_written=len(data))
        return True

    def children(self, most: int, path: str = "") -> list[tuple[str, bool]]:
        def once() -> list[Any]:
            self._files.invalidate_cache()
            return list(self._files.ls(self._at(path), detail=True))

        try:
            found = few(self._again("list", path, once), most, self.at(path))
        except (FileNotFoundError, NotADirectoryError):
            return []
        folder = self._at(path).rstrip("/")
        named = [(info["name"].rstrip("/"), info["type"] == "directory") for info in found]
        return sorted((posixpath.basename(name), is_folder) for name, is_folder in named if name != folder)

    def files(self, most: int) -> list[File]:
        def once() -> list[Any]:
            info = self._info("")
            is_file = info["type"] == "file"
            return [info] if is_file else list(self._files.find(self._root, detail=True).values())

        try:
            found = few(self._again("list", "", once), most, self.uri)
        except FileNotFoundError:
            return []
        # Stores keep empty files in the place of folders.
        return sorted(self._file(info) for info in found if not info["name"].endswith("/"))

    def fetch(self, path: str, to: Path) -> None:
        """Copies a file to this machine."""
        self._again("read", path, lambda: self._files.get_file(self._at(path), str(to)))
        self._count(bytes_read=to.stat().st_size)

    def part(self, path: str, start: int, end: int) -> bytes:
        """Some bytes of a file."""
        data = bytes(self._again("read", path, lambda: self._files.cat_file(self._at(path), start=start, end=end)))
        self._count(bytes_read=len(data))
        return data

    def _at(self, path: str) -> str:
        return f"{self._root}/{path}" if path else str(self._root)

    def _info(self, path: str) -> dict[str, Any]:
        self._files.invalidate_cache()
        return dict(self._files.info(self._at(path)))

    def _file(self, info: dict[str, Any]) -> File:
        size = info.get("size")
        tag = next((str(info[name]) for name in _TAGS if info.get(name)), "")
        return File(info["name"][len(self._root) :].lstrip("/"), None if size is None else int(size), tag)

    def _count(self, **counts: float) -> None:
        with self._lock:
            for name, count in counts.items():
                self.counts[name] += count

    def _again(self, what: str, path: str, once: Callable[[], T], tried: int = 0) -> T:
        """Does what may be done twice, again where the store did not answer as it should."""
        self._count(requests=1)
        start = time.monotonic()
        try:
            return once()
        except (FileNotFoundError, FileExistsError, NotADirectoryError, StoreError):
            raise
        except Exception as error:  # every package has errors of its own
            if tried == len(_WAITS_S):
                why = f"{type(error).__name__}: {error}"
                raise MayPassError(f"cannot {what} `{self.at(path)}`: {why}") from error
        finally:
            self._count(seconds=time.monotonic() - start)
        self._count(retries=1)
        time.sleep(_WAITS_S[tried])
        return self._again(what, path, once, tried + 1)
