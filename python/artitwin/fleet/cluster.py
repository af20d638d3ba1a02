"""Ray: this machine or a cluster, and the tasks on it. The only files that import ray are this and
`metrics.py`."""

import os
import time
import warnings
from collections.abc import Sequence
from typing import Any

# Nothing is reported to Ray's makers but where the user says so.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")

import ray
import ray.exceptions
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from ..errors import ArtitwinError
from .engine import Size, Start
from .job import Job, Look, Outcome
from .perform import look, work

_OBJECT_STORE = 100 << 20
"""derived: a result that goes through it has a few KB; Ray takes no less than 75 MB."""
_LOOK_RETRIES = 5
"""An estimate reads only; as many as of a job (`retries.py`)."""


class _Board:
    """Where workers say what they began: Ray itself does not say when a task leaves its queue."""

    def __init__(self) -> None:
        self._new: list[Start] = []

    def began(self, number: int, attempt: int, node: str, pid: int) -> None:
        self._new.append(Start(number, attempt, time.time(), node, pid))

    def read(self) -> list[Start]:
        new, self._new = self._new, []
        return new


def _work(job: Job, known: Look | None, attempt: int, cores: int, board: Any) -> Outcome:
    board.began.remote(job.row.number, attempt, ray.get_runtime_context().get_node_id(), os.getpid())
    return work(job, known, cores)


class Cluster:
    """A connection. Handles of tasks are opaque and hashable."""

    def __init__(self, address: str | None, cpus: int | None = None, dashboard: bool = False) -> None:
        warnings.filterwarnings("ignore", category=FutureWarning, module="ray")
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
        try:
            if address is None:
                # Not RAY_ADDRESS: this machine is what was asked for.
                ray.init(
                    address="local",
                    num_cpus=cpus,
                    include_dashboard=dashboard,
                    object_store_memory=_OBJECT_STORE,
                    **quiet,
                )
            else:
                ray.init(address=address, **quiet)
        except (ConnectionError, ValueError, RuntimeError) as error:
            where = "this machine" if address is None else f"`{address}`"
            raise ArtitwinError(f"no Ray cluster at {where}: {error}") from error
        here = ray.get_runtime_context().get_node_id()
        stay = NodeAffinitySchedulingStrategy(here, soft=False)
        board: Any = ray.remote(_Board)
        self._board = board.options(num_cpus=0, max_restarts=-1, scheduling_strategy=stay).remote()
        # Retries are the fleet's: it knows refusals, and waits.
        self._work: Any = ray.remote(max_retries=0, max_calls=0)(_work)
        self._look: Any = ray.remote(max_retries=_LOOK_RETRIES)(look)

    def look(self, job: Job) -> Any:
        """Estimates a job on some worker."""
        return self._look.remote(job)

    def submit(self, job: Job, known: Look | None, attempt: int, cores: float, memory: int) -> Any:
        """Queues a job for a worker with these cores and bytes free."""
        needs = {"num_cpus": cores, "memory": memory} if memory else {"num_cpus": cores}
        return self._work.options(**needs).remote(job, known, attempt, int(cores), self._board)

    def wait(self, handles: Sequence[Any], timeout_s: float) -> list[tuple[Any, Look | Outcome]]:
        """Those that ended, after all did or the time is over."""
        if not handles:
            time.sleep(timeout_s)
            return []
        ready, _ = ray.wait(list(handles), num_returns=len(handles), timeout=timeout_s, fetch_local=False)
        return [(handle, _result(handle)) for handle in ready]

    def starts(self) -> list[Start]:
        """What began since the last call."""
        try:
            new: list[Start] = ray.get(self._board.read.remote(), timeout=10.0)
            return new
        except (ray.exceptions.RayError, TimeoutError):
            return []

    def cancel(self, handle: Any) -> None:
        """Asks a job to stop; one that waits does not begin."""
        ray.cancel(handle, force=False)

    def size(self) -> Size:
        """Nodes that live, and what they have in all."""
        listed: Any = ray.nodes
        nodes = [node["Resources"] for node in listed() if node["Alive"]]
        cpus = [float(node.get("CPU", 0.0)) for node in nodes]
        memory = [int(node.get("memory", 0)) for node in nodes if node.get("CPU", 0.0) > 0.0]
        return Size(sum(cpus), len(nodes), max(cpus, default=0.0), max(memory, default=0))

    def close(self) -> None:
        """Leaves the cluster; ends what runs for this fleet."""
        ray.shutdown()


def _result(handle: Any) -> Look | Outcome:
    try:
        value: Look | Outcome = ray.get(handle)
        return value
    except ray.exceptions.TaskCancelledError:
        return Outcome(130, "stopped", 0.0, lost=True, stopped=True)
    except ray.exceptions.OutOfMemoryError as error:
        return Outcome(137, _first_line(error), 0.0, lost=True, out_of_memory=True)
    except ray.exceptions.RayTaskError as error:
        # A full disk under a worker's temporary folder may pass; the rest would happen again.
        return Outcome(1, _last_line(error), 0.0, lost=isinstance(error.cause, OSError))
    except ray.exceptions.RayError as error:
        return Outcome(137, f"{type(error).__name__}: {_first_line(error)}", 0.0, lost=True)


def _first_line(error: Exception) -> str:
    return next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)


def _last_line(error: Exception) -> str:
    return next((line for line in reversed(str(error).splitlines()) if line.strip()), type(error).__name__)
