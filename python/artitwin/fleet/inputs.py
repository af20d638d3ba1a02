"""What a job reads: which files, what its key holds of them, and how they come to this machine."""

import hashlib
import json
import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from .remote import Remote
from .store import File, Folder, MayPassError, Store, StoreError, open_store

RECORDING, TWIN, TWIN_WITH_MESHES = "recording", "twin", "twin with meshes"
"""What is read of an input."""
_MOST_FILES = 100_000
"""A bag of 10,000 files, or the images of a dataset."""
_HEAD, _TAIL = 8 << 20, 1 << 20
"""Bytes of the ends of a recording that an estimate reads: the first chunks of the images, and the summary."""
_AT_ONCE = 4
"""Requests of a job at a time."""
_PIECE = 1 << 20


@dataclass(frozen=True)
class Input:
    """An input that was found."""

    uri: str
    store: Store
    """Of what holds all that is read: for the file of a twin, its folder."""
    name: str
    """Within the store: what the program is given."""
    files: tuple[File, ...]
    """What is read."""
    bytes_stored: int
    """Of all files there, read or not."""

    @property
    def bytes_read(self) -> int:
        """Bytes of what is read."""
        return sum(file.size or 0 for file in self.files)

    def listed(self) -> str:
        """A digest of names, sizes and tags: it changes when a file does."""
        return digest([self.uri, *([file.path, file.size, file.tag] for file in self.files)])

    def identity(self) -> str:
        """What the key holds: of a folder the content, wherever it lies; of a store what it says of its files."""
        if not isinstance(self.store, Folder):
            return self.listed()
        return digest([[file.path, sha256(self.store.path / file.path)] for file in self.files])


def digest(value: object) -> str:
    """Of anything that is JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def sha256(path: Path) -> str:
    """Of a file."""
    found = hashlib.sha256()
    try:
        with open(path, "rb") as file:
            while piece := file.read(_PIECE):
                found.update(piece)
    except OSError as error:
        raise MayPassError(f"cannot read `{path}`: {error}") from error
    return found.hexdigest()


def find(uri: str, reads: str) -> Input:
    """Looks for an input."""
    store, name = open_store(uri), ""
    files = store.files(_MOST_FILES)
    if not files:
        raise StoreError(f"`{uri}` is not there: no file and no folder of files")
    if reads != RECORDING and not files[0].path and store.lists:
        # A twin is its URDF and what stands beside it.
        folder, _, last = store.uri.rpartition("/")
        store, name = open_store(folder), unquote(last)
        files = store.files(_MOST_FILES)
    stored = sum(file.size or 0 for file in files)
    return Input(uri, store, name, tuple(_read(files, reads, isinstance(store, Folder))), stored)


def _read(files: Sequence[File], reads: str, is_here: bool) -> list[File]:
    """The files that are read."""
    if reads == TWIN:
        ends = (".urdf", ".usda", "model.sdf")
        return [file for file in files if "/" not in file.path and (not file.path or file.path.endswith(ends))]
    if reads == RECORDING and not is_here:
        # Without a bag it is a dataset.
        bags = [file for file in files if file.path.lower().endswith((".mcap", ".mcap.zstd"))]
        return [*bags, *(file for file in files if _is_metadata(file.path))] if bags else list(files)
    return list(files)


def _is_metadata(path: str) -> bool:
    return PurePosixPath(path).name == "metadata.yaml"


def place(found: Input, folder: Path) -> Path:
    """Where an input is, or will be, on this machine: below a folder, by its URI, as reports name it."""
    if isinstance(found.store, Folder):
        return found.store.path / found.name
    scheme, _, rest = unquote(found.store.uri).partition("://")
    return _below(folder / scheme, rest.strip("/")) / found.name


def _below(folder: Path, path: str) -> Path:
    """A path of a store below a folder, and nowhere else."""
    parts = path.split("/")
    if any(part in ("", ".", "..") or len(part.encode()) > 255 or "\\" in part or "\0" in part for part in parts):
        raise StoreError(f"`{path[:200]}` is no path of a file")
    return folder.joinpath(*parts)


def _target(found: Input, file: File, folder: Path) -> Path:
    at = place(found, folder)
    root = at.parent if found.name else at
    return _below(root, file.path) if file.path else root


def outline(found: Input, folder: Path) -> None:
    """Makes files of the same names and sizes, with what an estimate reads of them."""
    assert isinstance(found.store, Remote)
    for file in found.files:
        to, size = _target(found, file, folder), file.size or 0
        to.parent.mkdir(parents=True, exist_ok=True)
        with open(to, "wb") as made:
            made.truncate(size)
            # A web server may give all of a file where a part is asked for.
            if size and found.store.lists and (to.suffix.lower() == ".mcap" or _is_metadata(to.name)):
                made.write(found.store.part(file.path, 0, min(size, _HEAD)))
                if size > _HEAD:
                    start = max(_HEAD, size - _TAIL)
                    made.seek(start)
                    made.write(found.store.part(file.path, start, size))


def fetch(found: Input, folder: Path) -> None:
    """Copies the files of an input. One that is there already is whole, and is left."""
    missing = [(file, to) for file in found.files if not (to := _target(found, file, folder)).is_file()]
    needed = sum(file.size or 0 for file, _ in missing)
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise MayPassError(f"`{folder}` has {free} bytes free, and {needed} are needed; give another --scratch")

    def one(number: int, file: File, to: Path) -> None:
        assert isinstance(found.store, Remote)
        to.parent.mkdir(parents=True, exist_ok=True)
        part = folder / f"{number}.part"
        found.store.fetch(file.path, part)
        came = part.stat().st_size
        if file.size not in (None, came):
            raise MayPassError(f"{came} bytes of `{found.store.at(file.path)}` came in place of {file.size}")
        os.replace(part, to)

    try:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(one, range(len(missing)), *zip(*missing, strict=True)))
    except OSError as error:
        raise MayPassError(f"cannot use `{folder}`: {error}") from error
