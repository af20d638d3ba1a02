"""Files of a store: local folders and object stores, by URI.

Credentials and endpoints come from the environment, under the names that the program reads (docs/fleet.md).
"""

import os
import posixpath
import re
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote, urlsplit

from pyarrow import fs  # type: ignore[import-untyped]

from ..errors import ArtitwinError

T = TypeVar("T")
_WAITS_S = (0.2, 0.4, 0.8, 1.6, 3.2)
"""derived: with one request in twenty failing, six leave one of 64 million; pyarrow's own come before."""


class StoreError(ArtitwinError):
    """A store that cannot be used as it was asked to."""


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


def as_input(uri: str) -> str:
    """An input as the program takes it: a local file by its path."""
    return unquote(urlsplit(uri).path) if uri.startswith("file://") else uri


class Store:
    """A file system with the path of a URI in it."""

    def __init__(self, uri: str) -> None:
        self.uri = uri.rstrip("/")
        scheme, _, rest = self.uri.partition("://")
        self.is_local = scheme == "file"
        try:
            self._files, self._root = _open(scheme, unquote(rest))
        except (OSError, ValueError, ImportError) as error:
            raise StoreError(f"`{uri}` cannot be used: {error}") from error

    def _at(self, path: str) -> str:
        return f"{self._root}/{path}" if path else self._root

    def read(self, path: str, most: int) -> bytes | None:
        """A file of at most so many bytes; None where there is none."""

        def once() -> bytes:
            with self._files.open_input_file(self._at(path)) as file:
                if file.size() > most:
                    raise StoreError(f"`{self.uri}/{path}` has more than {most} bytes")
                return bytes(file.read())

        try:
            return self._again(once)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StoreError(f"cannot read `{self.uri}/{path}`: {error}") from error

    def write(self, path: str, data: bytes) -> None:
        """A whole file or none, in place of one of that name."""

        def once() -> None:
            # An object appears when its upload is complete.
            with self._files.open_output_stream(self._at(path)) as file:
                file.write(data)

        try:
            self._again((lambda: _write_whole(Path(self._at(path)), data)) if self.is_local else once)
        except OSError as error:
            raise StoreError(f"cannot write `{self.uri}/{path}`: {error}") from error

    def children(self, most: int, path: str = "") -> list[tuple[str, bool]]:
        """Names below a folder, sorted, each with whether it is a folder itself."""
        selected = fs.FileSelector(self._at(path), recursive=False)
        try:
            found = self._again(lambda: self._files.get_file_info(selected))
        except FileNotFoundError:
            return []
        except OSError as error:
            raise StoreError(f"cannot list `{self.uri}/{path}`: {error}") from error
        if len(found) > most:
            raise StoreError(f"`{self.uri}/{path}` holds more than {most} entries")
        return sorted((info.base_name, info.type == fs.FileType.Directory) for info in found)

    def _again(self, once: Callable[[], T]) -> T:
        """Does what may be done twice, again where a store did not answer as it should."""
        for wait_s in () if self.is_local else _WAITS_S:
            try:
                return once()
            except FileNotFoundError:
                raise
            except OSError:
                time.sleep(wait_s)
        return once()


def _write_whole(at: Path, data: bytes) -> None:
    at.parent.mkdir(parents=True, exist_ok=True)
    aside = at.with_name(f".{at.name}.{uuid.uuid4().hex}")
    try:
        with open(aside, "xb") as local:
            local.write(data)
            local.flush()
            os.fsync(local.fileno())
        os.replace(aside, at)
    finally:
        aside.unlink(missing_ok=True)


def _open(scheme: str, rest: str) -> tuple[Any, str]:
    environment = os.environ.get
    if scheme == "file":
        return fs.LocalFileSystem(), "/" + rest.strip("/")
    if scheme == "s3":
        endpoint = environment("AWS_ENDPOINT") or environment("AWS_ENDPOINT_URL")
        is_plain = endpoint is not None and endpoint.startswith("http://")
        given: dict[str, Any] = {"region": environment("AWS_REGION") or environment("AWS_DEFAULT_REGION")}
        if endpoint:
            given |= {"endpoint_override": endpoint, "scheme": "http" if is_plain else "https"}
            given["region"] = given["region"] or "us-east-1"
        if environment("AWS_SKIP_SIGNATURE") == "true":
            given["anonymous"] = True
        return fs.S3FileSystem(**{key: value for key, value in given.items() if value}), rest
    if scheme == "gs":
        return fs.GcsFileSystem(), rest
    if scheme in ("az", "azure", "abfs", "abfss"):
        account = environment("AZURE_STORAGE_ACCOUNT_NAME")
        if not account:
            raise ValueError("AZURE_STORAGE_ACCOUNT_NAME is not set")
        key = environment("AZURE_STORAGE_ACCOUNT_KEY")
        return fs.AzureFileSystem(account_name=account, account_key=key), rest
    raise ValueError(f"no store has the scheme `{scheme}`: file, s3, gs and az have one")
