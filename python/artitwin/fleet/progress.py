"""What is shown while a fleet runs: one line in a terminal that is drawn again, else lines as things happen."""

import sys
import time
from typing import TextIO

from .schedule import ENDS, Item, Schedule

_DRAW_S = 0.25
"""How often the line is drawn; faster cannot be read."""
_LINE_S = 30.0
"""How often a log gets a line of counts: a thousand lines in eight hours."""
_BAR = 20
"""Characters of the bar."""
_WHY = 300
"""Most characters of a reason; the table has all."""


def counted(schedule: Schedule) -> str:
    """The counts in one line."""
    counts = schedule.counts()
    parts = [f"{name} {counts[name]}" for name in ("done", "degraded", "refused", "failed") if counts[name]]
    parts += [f"running {counts['running']}", f"waiting {counts['new'] + counts['waiting']}"]
    if schedule.retried:
        parts.append(f"retried {schedule.retried}")
    late = schedule.stragglers()
    if late:
        more = f" and {len(late) - 2} more" if len(late) > 2 else ""
        parts.append(f"stragglers {len(late)}: {', '.join(item.label for item in late[:2])}{more}")
    left = schedule.seconds_left()
    if left:
        parts.append(f"{duration(left)} left")
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """For a person."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


class Progress:
    """Writes to standard error."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._is_terminal = self._stream.isatty()
        self._at = 0.0
        self._line = ""
        self._late: set[int] = set()

    def say(self, text: str) -> None:
        """A line that stays."""
        self._clear()
        print(text, file=self._stream, flush=True)

    def change(self, schedule: Schedule) -> None:
        """Draws the line where it is time, and names new stragglers."""
        for item in schedule.stragglers():
            if item.job.row.number not in self._late:
                self._late.add(item.job.row.number)
                ran = time.time() - (item.began or time.time())
                self.say(f"{item.label}: straggler, {ran:.0f} s of {item.seconds:.0f} s estimated")
        now = time.monotonic()
        if now < self._at:
            return
        self._at = now + (_DRAW_S if self._is_terminal else _LINE_S)
        total = len(schedule.items)
        ended = sum(n for name, n in schedule.counts().items() if name in ENDS)
        if self._is_terminal:
            full = _BAR * ended // max(total, 1)
            line = f"[{'#' * full}{'-' * (_BAR - full)}] {ended}/{total} {counted(schedule)}"
            if line != self._line:
                self._clear()
                self._line = line
                # Cut to the terminal by its own rule: no wrapped lines that cannot be cleared.
                self._stream.write(f"\x1b[?7l{line}\x1b[?7h")
                self._stream.flush()
        else:
            print(f"{ended}/{total} {counted(schedule)}", file=self._stream, flush=True)

    def end(self, item: Item) -> None:
        """Says how a row ended; one that stood says nothing, for its run was quick."""
        if item.standing or self._is_terminal and item.status == "done":
            return
        took = (
            f" in {item.outcome.seconds:.1f} s" if item.outcome is not None and item.outcome.seconds else ""
        )
        again = f" after {len(item.lost)} lost attempts" if item.lost else ""
        why = (
            item.outcome.message if item.outcome is not None and item.status in ("refused", "failed") else ""
        )
        line = next(iter(why.splitlines()), "")[:_WHY]
        self.say(f"{item.label}: {item.status}{took}{again}{': ' + line if line else ''}")

    def close(self) -> None:
        """Leaves the terminal's line empty."""
        self._clear()

    def _clear(self) -> None:
        if self._line:
            self._stream.write("\r\x1b[2K")
            self._line = ""
