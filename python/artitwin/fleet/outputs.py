"""What a fleet writes beside its jobs' results."""

from collections.abc import Sequence

from .drift import drifts
from .drift_page import drift_page, drift_rows, drift_schema
from .page import gallery
from .results import refuse_taken, row, schema, table_bytes
from .schedule import Item
from .store import open_store

TABLE = {"reconstruct": "fleet.parquet", "diagnose": "logs.parquet"}
PAGE = {"reconstruct": "fleet.html", "diagnose": "machines.html"}
DRIFTS = "machines.parquet"


class Outputs:
    """Tables and a page in the store, each written whole."""

    def __init__(self, out: str, command: str) -> None:
        self.store = open_store(out)
        self.command = command
        self.written: list[str] = []

    def refuse_taken(self) -> None:
        """Before the work: raises where something else has the place of an output."""
        more = [DRIFTS] if self.command == "diagnose" else []
        refuse_taken(self.store, [TABLE[self.command], PAGE[self.command], *more], self.command)

    def write_table(self, items: Sequence[Item]) -> None:
        """What is known so far."""
        rows = [row(item, self.store.uri) for item in items]
        self._write(TABLE[self.command], table_bytes(rows, schema(self.command)))

    def write_all(self, items: Sequence[Item]) -> None:
        """Tables and page."""
        rows = [row(item, self.store.uri) for item in items]
        self._write(TABLE[self.command], table_bytes(rows, schema(self.command)))
        if self.command == "reconstruct":
            self._write(PAGE[self.command], gallery(rows, self.store.uri).encode())
            return
        found = drifts(rows)
        self._write(DRIFTS, table_bytes(drift_rows(found), drift_schema()))
        self._write(PAGE[self.command], drift_page(found, rows, self.store.uri).encode())

    def _write(self, path: str, data: bytes) -> None:
        self.store.write(path, data)
        place = f"{self.store.uri}/{path}"
        if place not in self.written:
            self.written.append(place)
