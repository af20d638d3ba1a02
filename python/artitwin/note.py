"""What is said beside a result."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Note:
    """A note or a warning. The sentence may change with a release, the code stays (docs/codes.md)."""

    code: str
    text: str

    def __str__(self) -> str:
        return self.text
