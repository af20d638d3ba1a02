"""Digital twins of articulated objects, made and diagnosed by the program `artitwin` (docs/python.md).

Words and units are those of `report.json`: meters, radians, seconds and kilograms unless a name says
otherwise.
"""

from .check import Check, CheckFinding
from .commands import check, diagnose, joint, reconstruct
from .diagnosis import Diagnosis, Export, Finding, Gap, Parameter
from .errors import ArtitwinError, FailedError, ProgramError, ReportError, StoppedError, UsageError
from .events import (
    Artifact,
    Count,
    Event,
    Failed,
    Noted,
    Planned,
    PlannedStage,
    StageFinished,
    StageStarted,
    Step,
    Warned,
)
from .joint import Joint, Limit
from .mesh import Mesh
from .note import Note
from .process import program
from .twin import Grasp, Link, Twin

__all__ = [
    "Artifact",
    "ArtitwinError",
    "Check",
    "CheckFinding",
    "Count",
    "Diagnosis",
    "Event",
    "Export",
    "Failed",
    "FailedError",
    "Finding",
    "Gap",
    "Grasp",
    "Joint",
    "Limit",
    "Link",
    "Mesh",
    "Note",
    "Noted",
    "Parameter",
    "Planned",
    "PlannedStage",
    "ProgramError",
    "ReportError",
    "StageFinished",
    "StageStarted",
    "Step",
    "StoppedError",
    "Twin",
    "UsageError",
    "Warned",
    "check",
    "diagnose",
    "joint",
    "program",
    "reconstruct",
]
