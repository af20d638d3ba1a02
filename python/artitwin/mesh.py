"""Part meshes, as the run folder holds them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .errors import ReportError
from .record import Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the frame of its link, m."""

    path: Path
    vertices: Array
    """Shape (V, 3)."""
    triangles: npt.NDArray[np.int64]
    """Indices of vertices, shape (T, 3)."""
    uv: Array | None
    """Texture coordinates of the corners of the triangles, from the picture's lower left, shape (T, 3, 2)."""
    texture: Path | None
    """The picture."""

    @classmethod
    def read(cls, path: Path) -> "Mesh":
        """Reads an OBJ file of triangles, as artitwin writes it."""
        rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "f": [], "mtllib": []}
        try:
            for line in path.read_text(encoding="utf-8").splitlines():
                key, _, rest = line.partition(" ")
                if key in rows:
                    rows[key].append(rest.split())
            # A corner is vertex, vertex/texture/normal or vertex//normal. Indices count from 1.
            faces = ([corner.replace("//", "/0/").split("/") for corner in row] for row in rows["f"])
            corners = np.array(list(faces), dtype=np.int64)
            corners = corners.reshape(len(rows["f"]), 3, -1) - 1
            vertices = np.array(rows["v"], dtype=np.float64).reshape(-1, 3)
            uv = np.array(rows["vt"], dtype=np.float64)[corners[:, :, 1]] if rows["vt"] else None
            texture = next((_texture(path.parent / " ".join(row)) for row in rows["mtllib"]), None)
        except (OSError, ValueError, IndexError) as error:
            raise ReportError(f"cannot read `{path}`: {error}") from error
        return cls(path=path, vertices=vertices, triangles=corners[:, :, 0], uv=uv, texture=texture)


def _texture(materials: Path) -> Path | None:
    for line in materials.read_text(encoding="utf-8").splitlines():
        key, _, name = line.strip().partition(" ")
        if key == "map_Kd":
            return materials.parent / name
    return None
