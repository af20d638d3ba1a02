"""How a call can fail. Every message is the program's own."""


class ArtitwinError(Exception):
    """What all errors of this package are."""


class FailedError(ArtitwinError):
    """The program refused or failed, and wrote no result (exit code 1; 75: the same call may succeed later)."""


class UsageError(ArtitwinError):
    """The options or the settings are wrong (exit code 2)."""


class StoppedError(ArtitwinError):
    """Somebody stopped the program (exit code 130); finished stages are kept for `resume`."""


class ProgramError(ArtitwinError):
    """There is no program, or it ended as it never should."""


class ReportError(ArtitwinError):
    """A folder holds no result that this package can read."""


def ended(exit_code: int, message: str) -> ArtitwinError:
    """The error of a program that ended with a code other than 0 and 3."""
    kinds: dict[int, type[ArtitwinError]] = {
        1: FailedError,
        2: UsageError,
        75: FailedError,
        130: StoppedError,
    }
    if exit_code in kinds:
        return kinds[exit_code](message)
    return ProgramError(f"artitwin ended with exit code {exit_code}: {message}")
