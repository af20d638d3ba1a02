"""What `check` finds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CheckFinding:
    """What would keep a simulator from loading a model as it is meant."""

    level: str
    """`error` or `warning`."""
    rule: str
    """See docs/codes.md."""
    text: str
    """File, subject and what is wrong."""


@dataclass(frozen=True)
class Check:
    """All findings of a model."""

    findings: tuple[CheckFinding, ...]

    @property
    def errors(self) -> tuple[CheckFinding, ...]:
        """What a simulator refuses."""
        return tuple(finding for finding in self.findings if finding.level == "error")

    @property
    def warnings(self) -> tuple[CheckFinding, ...]:
        """What some importer reads otherwise."""
        return tuple(finding for finding in self.findings if finding.level == "warning")
