"""Numbers for Ray's dashboard and for Prometheus (docs/fleet.md)."""

from ray.util.metrics import Counter, Gauge

from .schedule import Schedule


class Metrics:
    """Gauges and counters of a fleet, labeled with its command."""

    def __init__(self, command: str) -> None:
        tags = {"command": command}
        self._objects = Gauge("artitwin_fleet_objects", "rows by status", ("command", "status"))
        self._stragglers = Gauge("artitwin_fleet_stragglers", "running rows that take too long", ("command",))
        self._left = Gauge("artitwin_fleet_seconds_left", "by the estimates", ("command",))
        self._retries = Counter("artitwin_fleet_retries_total", "lost attempts tried again", ("command",))
        self._read = Counter("artitwin_fleet_read_bytes_total", "bytes read of inputs", ("command",))
        self._stored = Counter("artitwin_fleet_stored_bytes_total", "bytes of inputs in all", ("command",))
        for metric in (self._objects, self._stragglers, self._left, self._retries, self._read, self._stored):
            metric.set_default_tags(tags)
        self._seen = (0, 0, 0)

    def change(self, schedule: Schedule) -> None:
        """Sets all to what they are now."""
        for status, count in schedule.counts().items():
            self._objects.set(count, {"status": status})
        self._stragglers.set(len(schedule.stragglers()))
        self._left.set(schedule.seconds_left() or 0.0)
        moved = [i.outcome.manifest.transfer for i in schedule.items if i.outcome and i.outcome.manifest]
        now = (schedule.retried, sum(t.bytes_read for t in moved), sum(t.bytes_stored for t in moved))
        for counter, new, old in zip((self._retries, self._read, self._stored), now, self._seen, strict=True):
            if new > old:
                counter.inc(new - old)
        self._seen = now
