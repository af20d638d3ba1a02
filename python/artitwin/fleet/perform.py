"""From a job to its manifest: looked at, fetched, run on paths of this machine, put; the manifest last."""

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ..errors import ReportError
from ..process import program
from ..record import record
from . import child
from .inputs import Input, digest, fetch, find, outline, place
from .job import Estimate, Job, Look, Manifest, Outcome, Transfer
from .leash import NOT_STARTED
from .remote import Remote
from .scratch import base, held, made
from .store import Folder, MayPassError, Store, StoreError, open_store
from .summary import summary

JOB = "artitwin-job/1"
ESTIMATE = "artitwin-estimate/2"
TEMPORARY = 75
"""Exit code of what may pass (EX_TEMPFAIL of sysexits.h)."""
STOPPED = 130
_REFUSED = (1, 2)
"""Exit codes of what the same inputs and settings would meet again."""
_DEGRADED = 3
_MOST_MANIFEST = 16 << 20
"""A manifest of 1000 files has under 1 MB."""
_MOST_FILE = 5 << 30
"""What stores take in one request."""
_AT_ONCE = 4
"""Requests of a job at a time."""


def look(job: Job) -> Look:
    """Estimates a job; where its manifest stands, reads that."""
    try:
        return _look(job, _found(job))
    except (MayPassError, OSError) as error:
        return Look(None, str(error))
    except StoreError as error:
        return Look(None, str(error), Outcome(1, str(error), 0.0))


def work(job: Job, known: Look | None, cores: int) -> Outcome:
    """Does a job, unless its manifest stands. `known` is what a look found before."""
    begun = time.monotonic()
    try:
        inputs = _found(job)
        estimate = known.estimate if known is not None else None
        if estimate is None or (estimate.listed, estimate.version) != (_listed(inputs), _version(job)):
            known = _look(job, inputs)
            estimate = known.estimate
            if estimate is None:
                return known.outcome or Outcome(TEMPORARY, known.message, time.monotonic() - begun, lost=True)
        return Work(job, inputs, estimate, cores).outcome()
    except (MayPassError, OSError) as error:
        return Outcome(TEMPORARY, str(error), time.monotonic() - begun, lost=True)
    except StoreError as error:
        return Outcome(1, str(error), time.monotonic() - begun)


def _found(job: Job) -> list[Input]:
    return [find(uri, reads) for uri, reads in job.inputs()]


def _listed(inputs: Sequence[Input]) -> str:
    return digest([found.listed() for found in inputs])


def _version(job: Job) -> str:
    """What the program calls itself: its nodes may have others."""
    return child.run([_program(job), "--version"], {}, None, job.limit_s).last_line.rpartition(" ")[2]


def _program(job: Job) -> str:
    return os.path.abspath(job.program or program())


def _look(job: Job, inputs: Sequence[Input]) -> Look:
    base(job.scratch).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="artitwin-look-", dir=base(job.scratch)) as folder:
        for found in inputs:
            if isinstance(found.store, Remote):
                outline(found, Path(folder))
        name = [f"--name={job.row.name}"] if job.row.name else []
        ended = _run(job, ["--estimate", f"--out={folder}", *name], inputs, Path(folder), {})
    if ended.exit_code in (*_REFUSED, NOT_STARTED):
        return Look(None, _why(ended), Outcome(ended.exit_code, _why(ended), 0.0))
    if ended.exit_code != 0:
        return Look(None, _why(ended))
    try:
        estimate = _estimate(json.loads(ended.last_line), inputs)
    except (ValueError, AttributeError, ReportError) as error:
        message = f"no estimate that this package reads: {error}"
        return Look(None, message, Outcome(1, message, 0.0))
    return Look(estimate, "", _standing(open_store(job.out), estimate.key, job))


def _estimate(value: Any, inputs: Sequence[Input]) -> Estimate:
    if value.get("format") != ESTIMATE:
        raise ReportError(f"its format is {value.get('format')}, not {ESTIMATE}")
    identities = [found.identity() for found in inputs]
    # The digest of the settings holds command, options and version, too.
    key = digest(["artitwin-key/2", value.get("settings"), value.get("name"), identities])[:32]
    own = {
        "key": key,
        "identities": identities,
        "listed": _listed(inputs),
        "bytes_stored": sum(found.bytes_stored for found in inputs),
        "bytes_read": sum(found.bytes_read for found in inputs),
    }
    return record(Estimate, {**value, **own}, "estimate")


def _run(
    job: Job, words: Sequence[str], inputs: Sequence[Input], inside: Path, environment: dict[str, str]
) -> child.Ended:
    """Runs the command. What was fetched is named by its place in the folder `inside`: reports do not hold that."""
    is_fetched = any(isinstance(found.store, Remote) for found in inputs)
    folder = str(inside) if is_fetched else job.folder if os.path.isdir(job.folder) else None
    arguments = job.arguments(str(place(found, Path())) for found in inputs)
    return child.run([_program(job), job.command, *words, *arguments], environment, folder, job.limit_s)


def _why(ended: child.Ended) -> str:
    return ended.message.rpartition("error: ")[2] or f"exit code {ended.exit_code}"


def _standing(store: Store, key: str, job: Job) -> Outcome | None:
    """What the manifest of a key says."""
    data = store.read(f"{key}.json", _MOST_MANIFEST)
    if data is None:
        return None
    try:
        return _finished(json.loads(data), store, job)
    except (ValueError, ReportError) as error:
        raise StoreError(f"`{store.at(f'{key}.json')}` is no manifest of a job; remove it: {error}") from error


def _finished(value: Any, store: Store, job: Job) -> Outcome:
    if not isinstance(value, dict) or value.get("format") != JOB:
        raise ReportError(f"its format is not {JOB}")
    manifest = record(Manifest, value, "manifest")
    read = summary(store, manifest.folder, job.command) if manifest.folder else None
    return Outcome(manifest.exit_code, manifest.message or "", manifest.seconds, manifest, read)


class Work:
    """An attempt at a job whose key is known."""

    def __init__(self, job: Job, inputs: Sequence[Input], estimate: Estimate, cores: int) -> None:
        self.job, self.inputs, self.estimate = job, inputs, estimate
        self.key, self.name = estimate.key, estimate.name
        # The program uses all cores that it sees; its results do not depend on their number.
        self.environment = {"RAYON_NUM_THREADS": str(max(1, cores))}
        self.store = open_store(job.out)
        self.scratch = base(job.scratch) / f"artitwin-{self.key}"
        is_here = isinstance(self.store, Folder)
        self.out = self.store.path / self.key if isinstance(self.store, Folder) else self.scratch / "out"
        self.needs_scratch = not is_here or any(isinstance(found.store, Remote) for found in inputs)
        # All nodes share a folder; of another store each has what it fetched.
        self.lock = self.out.with_name(f".{self.key}.lock") if is_here else self.scratch.with_suffix(".lock")
        self.begun = time.monotonic()
        self.started = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")

    def outcome(self) -> Outcome:
        """Of the manifest that stands, or of the work."""
        with held(self.lock):
            return _standing(self.store, self.key, self.job) or self._worked()

    def _worked(self) -> Outcome:
        try:
            ended, is_resumed = self._ran()
            code = ended.exit_code
            if ended.overtime:
                return self._lost(code, f"stopped after {ended.seconds:.0f} s")
            if code in _REFUSED:
                outcome = self._put(self._manifest(ended, code, _why(ended)))
            elif code in (0, _DEGRADED):
                outcome = self._put(self._made(ended, is_resumed))
            elif code == NOT_STARTED:
                return Outcome(code, _why(ended), self._seconds())
            elif code == STOPPED:
                return self._lost(code, "stopped", stopped=True)
            elif code < 0 or code > 128:
                number = -code if code < 0 else code - 128
                return self._lost(code, f"ended by signal {number}", out_of_memory=number == 9)
            else:
                return self._lost(code, _why(ended))
        except MayPassError:
            raise
        except StoreError:
            self._clear()
            raise
        self._clear()
        return outcome

    def _ran(self) -> tuple[child.Ended, bool]:
        """Fetches and runs; goes on from what an earlier attempt left."""
        inside = self.scratch / "in"
        if self.needs_scratch:
            made(made(self.scratch) / "in")
        for found in self.inputs:
            if isinstance(found.store, Remote):
                fetch(found, inside)
        if _listed(_found(self.job)) != self.estimate.listed:
            # What came may be of two states of them.
            self._clear()
            raise MayPassError("the inputs have changed while they were fetched")
        words = ["--json", f"--out={self.out}", f"--name={self.name}"]
        has_left = self.out.is_dir()
        resume = ["--resume"] if has_left and self.job.command == "reconstruct" else []
        ended = _run(self.job, [*words, *resume], self.inputs, inside, self.environment)
        if has_left and ended.exit_code in _REFUSED:
            # Perhaps for what was left; a refusal must be one of the inputs.
            shutil.rmtree(self.out)
            resume = []
            ended = _run(self.job, words, self.inputs, inside, self.environment)
        return ended, bool(resume)

    def _made(self, ended: child.Ended, is_resumed: bool) -> dict[str, Any]:
        """The manifest of a result, whose files are put."""
        folder = self.out / self.name
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            files = list(pool.map(self._put_file, paths, (path.relative_to(folder).as_posix() for path in paths)))
        warnings = json.loads((folder / "report.json").read_bytes()).get("warnings", [])
        # Of a result that stood the command says only that.
        code = _DEGRADED if is_resumed and warnings else ended.exit_code
        return self._manifest(ended, code, None, files, warnings)

    def _put_file(self, path: Path, name: str) -> dict[str, Any]:
        data = path.read_bytes()
        at = f"{self.key}/{self.name}/{name}"
        if isinstance(self.store, Remote) and not self.store.create(at, data):
            # Of an attempt that was lost, or that goes on beside this one: what stands is listed.
            data = self.store.read(at, _MOST_FILE) or b""
        return {"path": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}

    def _manifest(
        self,
        ended: child.Ended,
        code: int,
        message: str | None,
        files: Sequence[dict[str, Any]] = (),
        warnings: Sequence[Any] = (),
    ) -> dict[str, Any]:
        given = zip(self.inputs, self.estimate.identities, strict=True)
        return {
            "format": JOB,
            "key": self.key,
            "command": self.job.command,
            "name": self.name,
            "status": "refused" if message is not None else "degraded" if code == _DEGRADED else "done",
            "exit_code": code,
            "message": message,
            "folder": None if message is not None else f"{self.key}/{self.name}",
            "files": files,
            "warnings": warnings,
            "version": self.estimate.version,
            "inputs": [
                {"uri": i.uri, "identity": of, "bytes_stored": i.bytes_stored, "bytes_read": i.bytes_read}
                for i, of in given
            ],
            "transfer": asdict(self._transfer()),
            "seconds": self._seconds(),
            "cpu_seconds": ended.cpu_seconds,
            "peak_memory_bytes": ended.peak_memory_bytes,
            "started": self.started,
            "estimate": asdict(self.estimate),
        }

    def _transfer(self) -> Transfer:
        remote = [found for found in self.inputs if isinstance(found.store, Remote)]
        every = (self.store, *(found.store for found in remote))
        stores = [store for store in every if isinstance(store, Remote)]
        counts = {name: sum(store.counts[name] for store in stores) for name in Remote.COUNTED}
        return record(Transfer, {"bytes_stored": sum(found.bytes_stored for found in remote), **counts}, "transfer")

    def _put(self, manifest: dict[str, Any]) -> Outcome:
        """Puts a manifest where none stands: of two that do the same job at once, the first has it."""
        text = json.dumps(manifest, indent=1) + "\n"
        if self.store.create(f"{self.key}.json", text.encode()):
            return _finished(manifest, self.store, self.job)
        return _standing(self.store, self.key, self.job) or self._lost(TEMPORARY, "its manifest came and went")

    def _lost(self, code: int, message: str, stopped: bool = False, out_of_memory: bool = False) -> Outcome:
        seconds = self._seconds()
        return Outcome(code, message, seconds, lost=True, stopped=stopped, out_of_memory=out_of_memory)

    def _clear(self) -> None:
        """Leaves nothing but what the manifest names."""
        shutil.rmtree(self.scratch, ignore_errors=True)
        if self.out.is_dir() and not any(self.out.iterdir()):
            self.out.rmdir()

    def _seconds(self) -> float:
        return time.monotonic() - self.begun
