"""The order of things: estimates, then jobs, longest first; lost ones again; until every row has its end."""

import heapq
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from .engine import Engine, Size
from .job import Estimate, Job, Look, Outcome
from .retries import MOST_RETRIES, demand, retry
from .stragglers import bound, is_straggler

_POLL_S = 1.0
"""measured: what ends meanwhile is seen so late, and Ray starts what is queued by itself; with 0.25 the command and its board
took 1.6 % of a core from the jobs."""
_SHORT_POLL_S = 0.25
"""derived: estimates take less than a second, and so should the end after Ctrl-C."""
_SIZE_S = 5.0
"""How often the cluster is asked for its size: nodes come and go in minutes."""
_AHEAD = 4.0
"""derived: Ray's autoscaler doubles a cluster at most (upscaling_speed 1): twice its cores are demand enough;
and again as much, so that no worker waits for the head."""
_LEAST_AHEAD = 64
"""Queued jobs while a cluster has no nodes yet."""
_STOP_S = 90.0
"""derived: a job that does not stop is ended after 60 s (`child.py`)."""

ENDS = ("done", "degraded", "refused", "failed", "stopped")


@dataclass(eq=False)
class Item:
    """A row and what has become of it."""

    job: Job
    status: str = "new"
    """`new`, `waiting`, `running`, then one of `ENDS`."""
    look: Look | None = None
    outcome: Outcome | None = None
    attempts: int = 0
    lost: list[str] = field(default_factory=list)
    """Why attempts were lost."""
    of_memory: int = 0
    memory_factor: float = 1.0
    began: float | None = None
    """When the running attempt began, by the clock."""
    node: str = ""
    straggler: bool = False
    standing: bool = False
    """It was there before."""
    twin_of: "Item | None" = None
    """The row with the same key that is run in its place."""

    @property
    def label(self) -> str:
        return self.job.row.label

    @property
    def estimate(self) -> Estimate | None:
        return self.look.estimate if self.look is not None else None

    @property
    def seconds(self) -> float:
        """Estimated; 0 where there is no estimate."""
        return self.estimate.seconds if self.estimate is not None else 0.0


class Schedule:
    """All rows of a fleet. `on_change` is called every second at least, `on_end` with every row that ends."""

    def __init__(
        self,
        engine: Engine,
        jobs: Iterable[Job],
        *,
        cores: float | None = None,
        most_retries: int = MOST_RETRIES,
        on_change: Callable[["Schedule"], None] = lambda schedule: None,
        on_end: Callable[[Item], None] = lambda item: None,
    ) -> None:
        self.engine = engine
        self.items = [Item(job) for job in jobs]
        self.cores = cores
        self.most_retries = most_retries
        self.on_change = on_change
        self.on_end = on_end
        self.retried = 0
        self.has_begun = False
        """Jobs run; before, there are estimates alone."""
        self.ratios: list[float] = []
        self.size = Size(0.0, 0, 0.0, 0)
        self._size_at = 0.0
        self._running: dict[Any, Item] = {}
        self._queue: deque[Item] = deque()
        self._later: list[tuple[float, int, Item]] = []

    def look(self) -> None:
        """Estimates every row; ends those whose manifest stands, or that are refused."""
        new = deque(self.items)
        pending: dict[Any, Item] = {}
        while new or pending:
            self._measure()
            while new and len(pending) < self._window():
                item = new.popleft()
                pending[self.engine.look(item.job)] = item
            for handle, result in self.engine.wait(list(pending), _SHORT_POLL_S):
                item = pending.pop(handle)
                item.look = result if isinstance(result, Look) else Look(None, result.message)
                item.status = "waiting"
                if item.look.outcome is not None:
                    item.standing = item.look.outcome.manifest is not None
                    self._end(item, item.look.outcome)
            self.on_change(self)
        first: dict[str, Item] = {}
        for item in self.items:
            key = item.estimate.key if item.estimate is not None else None
            if item.status == "waiting" and key is not None and first.setdefault(key, item) is not item:
                item.twin_of = first[key]

    def run(self) -> None:
        """Runs what `look` left over. Ctrl-C is raised again after all jobs stopped."""
        self.has_begun = True
        waiting = [item for item in self.items if item.status == "waiting" and item.twin_of is None]
        # The longest first: what ends last is short.
        self._queue = deque(sorted(waiting, key=lambda item: (-item.seconds, item.job.row.number)))
        try:
            while self._queue or self._later or self._running:
                self._measure()
                self._submit()
                for handle, result in self.engine.wait(list(self._running), _POLL_S):
                    self._ended(self._running.pop(handle), result)
                self._starts()
                self.on_change(self)
        except BaseException:
            self._stop()
            raise
        finally:
            self._copy_twins()

    def counts(self) -> dict[str, int]:
        """Rows by status."""
        counts = dict.fromkeys(("new", "waiting", "running", *ENDS), 0)
        for item in self.items:
            counts[item.status] += 1
        return counts

    def stragglers(self) -> list[Item]:
        """Running rows that take longer than the others let expect, by their place in the table."""
        return [item for item in self._running.values() if item.straggler]

    def seconds_left(self) -> float | None:
        """By the estimates, corrected by the median of what came of them; None where nothing is known."""
        if self.size.cpus <= 0.0:
            return None
        ratio = sorted(self.ratios)[len(self.ratios) // 2] if self.ratios else 1.0
        now, work, longest = time.time(), 0.0, 0.0
        for item in self.items:
            if item.status in ("waiting", "running") and item.twin_of is None:
                ran = now - item.began if item.status == "running" and item.began else 0.0
                rest = max(0.0, ratio * item.seconds - ran)
                work += rest * self._cores(item)
                longest = max(longest, rest)
        return max(work / self.size.cpus, longest)

    def _window(self) -> int:
        return max(_LEAST_AHEAD, int(_AHEAD * self.size.cpus))

    def _measure(self) -> None:
        if time.monotonic() >= self._size_at:
            self.size = self.engine.size()
            self._size_at = time.monotonic() + _SIZE_S

    def _cores(self, item: Item) -> float:
        asked = self.cores or (item.estimate.cores if item.estimate is not None else 1.0)
        # Whole ones: Ray takes parts of a core only below one.
        whole = float(max(1, round(asked)))
        return min(whole, self.size.largest_cpus) if self.size.largest_cpus >= 1.0 else whole

    def _submit(self) -> None:
        now = time.monotonic()
        while self._later and self._later[0][0] <= now:
            self._queue.appendleft(heapq.heappop(self._later)[2])
        while self._queue and len(self._running) < self._window():
            item = self._queue.popleft()
            bytes_ = item.estimate.memory_bytes if item.estimate is not None else 0
            memory = demand(bytes_, item.memory_factor, self.size.largest_memory)
            item.attempts += 1
            item.began = None
            handle = self.engine.submit(item.job, item.look, item.attempts, self._cores(item), memory)
            self._running[handle] = item

    def _starts(self) -> None:
        running = {item.job.row.number: item for item in self._running.values()}
        for start in self.engine.starts():
            item = running.get(start.number)
            if item is not None and start.attempt == item.attempts:
                item.status, item.began, item.node = "running", start.at, start.node
        limit, now = bound(self.ratios, len(self.items)), time.time()
        for item in self._running.values():
            if item.began is not None:
                item.straggler = is_straggler(now - item.began, item.seconds, limit)

    def _ended(self, item: Item, result: Look | Outcome) -> None:
        assert isinstance(result, Outcome)
        item.status, item.straggler = "waiting", False
        if not result.lost:
            self._end(item, result)
            return
        item.lost.append(result.message)
        item.of_memory += result.out_of_memory
        again = retry(item.label, len(item.lost), item.of_memory, self.most_retries)
        if again is None:
            self._end(item, result)
            return
        self.retried += 1
        item.memory_factor = again.memory_factor
        heapq.heappush(self._later, (time.monotonic() + again.after_s, item.job.row.number, item))

    def _end(self, item: Item, outcome: Outcome) -> None:
        item.outcome = outcome
        if outcome.manifest is not None:
            item.status = outcome.manifest.status if outcome.manifest.status in ENDS else "failed"
        else:
            item.status = "failed" if outcome.lost or outcome.exit_code not in (1, 2) else "refused"
        took = outcome.manifest.seconds if outcome.manifest is not None else 0.0
        if not item.standing and item.status in ("done", "degraded") and item.seconds > 0.0 and took > 0.0:
            self.ratios.append(took / item.seconds)
        self.on_end(item)

    def _copy_twins(self) -> None:
        for item in self.items:
            if item.twin_of is not None and item.twin_of.outcome is not None:
                item.outcome, item.status = item.twin_of.outcome, item.twin_of.status

    def _stop(self) -> None:
        """Cancels all and waits until the jobs left a usable state; a second Ctrl-C waits no more."""
        end = time.monotonic() + _STOP_S
        try:
            for handle in self._running:
                self.engine.cancel(handle)
            while self._running and time.monotonic() < end:
                for handle, result in self.engine.wait(list(self._running), _SHORT_POLL_S):
                    item = self._running.pop(handle)
                    if isinstance(result, Outcome) and result.manifest is not None:
                        self._end(item, result)
        finally:
            for item in self.items:
                if item.status in ("new", "waiting", "running"):
                    item.status = "stopped"
