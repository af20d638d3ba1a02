"""How often, when and with how much memory a lost job is tried again."""

import random
from dataclasses import dataclass

MOST_RETRIES = 5
"""derived: where every attempt is lost with probability 0.1, six attempts leave one of a million objects."""
_FIRST_S = 1.0
"""derived: a node that starts a worker again needs about a second."""
_LONGEST_S = 60.0
"""derived: a store that throttles asks for less than a minute (S3's own clients: 20 s)."""
_MORE_MEMORY = 1.5
"""derived: five times half as much more is 7.6 times the estimate."""
MEMORY_STEP = 256 << 20
"""derived: Ray queues every demand of resources by itself; under 16 GB these steps make 64 queues at most."""


@dataclass(frozen=True)
class Retry:
    """When a job is tried again, and with what factor on its memory."""

    after_s: float
    memory_factor: float


def retry(label: str, lost: int, of_memory: int, most: int = MOST_RETRIES) -> Retry | None:
    """After so many lost attempts, `of_memory` of which may have had too little; None: no more.

    The wait is uniform up to a length that doubles, so that the jobs of a lost node do not come back at once.
    It is the same in every run.
    """
    if lost > most:
        return None
    longest = min(_LONGEST_S, _FIRST_S * 2.0 ** (lost - 1))
    wait = random.Random(f"{label}:{lost}").uniform(0.0, longest)
    return Retry(wait, _MORE_MEMORY**of_memory)


def demand(estimate: int, factor: float, largest: int) -> int:
    """Memory that is asked for, bytes: in steps, and no more than the largest node has (0: not known)."""
    asked = -(-int(estimate * factor) // MEMORY_STEP) * MEMORY_STEP
    return min(asked, largest) if largest > 0 else asked
