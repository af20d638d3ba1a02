"""What a typed user writes: checked by mypy --strict, not run."""

import numpy as np
import numpy.typing as npt

import artitwin


def deviations(twin: artitwin.Twin) -> dict[str, npt.NDArray[np.float64]]:
    return {joint.name: np.sqrt(np.diag(joint.covariance)) for joint in twin.joints}


def progress(event: artitwin.Event) -> None:
    if isinstance(event, artitwin.Step):
        print(event.stage, event.done / event.total)
    elif isinstance(event, (artitwin.Warned, artitwin.Noted)):
        print(event.code, event.message)


def main() -> int:
    try:
        twin = artitwin.reconstruct(["state0", "state1"], "runs", parts=3, settings={"surface.nodes": 96}, on_event=progress)
        diagnosis = artitwin.diagnose(twin, ["run_0", "run_1"], "diagnosis", held_out="run_1", gravity=(0, 0, -9.81))
    except artitwin.StoppedError:
        return 130
    except artitwin.ArtitwinError as error:
        print(error)
        return 1
    mass_kg: float = sum(link.mass_kg for link in twin.links)
    triangles: npt.NDArray[np.int64] = twin.visual("base")[0].triangles
    values: dict[str, float] = {p.name: p.value for finding in diagnosis.findings for p in finding.parameters}
    print(mass_kg, len(triangles), values, deviations(twin), artitwin.check(twin).errors)
    return 0 if diagnosis.mjcf is None else 3
