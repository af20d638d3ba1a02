"""Writes the ONNX matchers of tests/golden, and what ONNX Runtime makes of them.

Nothing here is learned. `pip install onnx==1.23.2 onnxruntime==1.31.1`, then
`python tests/python/make_matchers.py tests/golden`; the tests need neither package.

matcher_beacons.onnx        the 4 brightest pixels of each image, matched by rank; images of any size
matcher_beacons_fixed.onnx  the same, for color images of 48 x 32 (rank by the red channel), no confidence
matcher_corners.onnx        corners with gradient histograms, matched where each is the other's best; any size
matcher_corners.json        a texture, and the matches that ONNX Runtime finds between two cuts of it with
                            matcher_corners.onnx
"""

import json
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper


class Graph:
    """Collects nodes and constants; every method returns the name of what it made."""

    def __init__(self):
        self.nodes, self.constants = [], []

    def constant(self, value, dtype):
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def ints(self, *values):
        return self.constant(list(values), np.int64)

    def float(self, value):
        return self.constant(value, np.float32)

    def op(self, kind, *inputs, outputs=1, **attributes):
        names = [f"n{len(self.nodes)}_{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(kind, list(inputs), names, **attributes))
        return names[0] if outputs == 1 else names

    def named(self, value, name):
        self.nodes.append(helper.make_node("Identity", [value], [name]))

    def save(self, path, channels, height, width, with_confidence):
        image = lambda name: helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, height, width])
        points = lambda name: helper.make_tensor_value_info(name, TensorProto.FLOAT, ["matches", 2])
        outputs = [points("keypoints0"), points("keypoints1")]
        if with_confidence:
            outputs.append(helper.make_tensor_value_info("confidence", TensorProto.FLOAT, ["matches"]))
        graph = helper.make_graph(self.nodes, path.stem, [image("image0"), image("image1")], outputs, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model, full_check=True)
        path.write_bytes(model.SerializeToString())

    def width(self, image):
        """Width of an image, a tensor of shape [1]."""
        return self.op("Slice", self.op("Shape", image), self.ints(3), self.ints(4), self.ints(0))

    def pixels(self, indices, width):
        """Row-major indices [n] to float pixels [n, 2], u before v."""
        column = lambda i: self.op("Unsqueeze", i, self.ints(1))
        u, v = self.op("Mod", indices, width), self.op("Div", indices, width)
        return self.op("Cast", self.op("Concat", column(u), column(v), axis=1), to=TensorProto.FLOAT)


def beacons(path, channels, height, width, with_confidence):
    g = Graph()
    values = []
    for k in (0, 1):
        first = g.op("Slice", f"image{k}", g.ints(0), g.ints(1), g.ints(1))
        flat = g.op("Reshape", first, g.ints(-1))
        top, at = g.op("TopK", flat, g.ints(4), outputs=2)
        values.append(top)
        g.named(g.pixels(at, g.width(f"image{k}")), f"keypoints{k}")
    if with_confidence:
        difference = g.op("Abs", g.op("Sub", *values))
        g.named(g.op("Sub", g.float(1.0), difference), "confidence")
    g.save(path, channels, height, width, with_confidence)


CORNERS = 400  # of an image
ORIENTATIONS = 8
GRID = 4  # cells of a descriptor along a side
CELL = 5  # pixels of a cell along a side


def derivative_filters():
    """Directional derivatives of a Gaussian, [orientations, 1, 5, 5]."""
    y, x = np.mgrid[-2:3, -2:3].astype(np.float64)
    bell = np.exp(-(x * x + y * y) / 2.0)
    angles = np.arange(ORIENTATIONS) * (2 * np.pi / ORIENTATIONS)
    filters = np.stack([bell * (x * np.cos(a) + y * np.sin(a)) for a in angles])
    return (filters / np.abs(filters[0]).sum())[:, None]


def cell_filters():
    """One-hot filters that put the 4 x 4 cells around a pixel into channels, [channels, 1, 4, 4]."""
    channels = ORIENTATIONS * GRID * GRID
    filters = np.zeros((channels, 1, GRID, GRID))
    for channel in range(channels):
        filters[channel, 0, channel % (GRID * GRID) // GRID, channel % GRID] = 1.0
    return filters


def corners_of(g, image, derivatives, cells_to_channels):
    """Indices [n], presence [n] and descriptors [n, 128] of unit length, of corners."""
    slopes = g.op("Conv", image, derivatives, pads=[2] * 4)
    rectified = g.op("Relu", slopes)
    # Structure tensor from the derivatives along u and v.
    du = g.op("Slice", slopes, g.ints(0), g.ints(1), g.ints(1))
    dv = g.op("Slice", slopes, g.ints(ORIENTATIONS // 4), g.ints(ORIENTATIONS // 4 + 1), g.ints(1))
    pooled = lambda t: g.op("AveragePool", t, kernel_shape=[7, 7], pads=[3] * 4, count_include_pad=1)
    uu, vv, uv = (pooled(g.op("Mul", a, b)) for a, b in ((du, du), (dv, dv), (du, dv)))
    determinant = g.op("Sub", g.op("Mul", uu, vv), g.op("Mul", uv, uv))
    response = g.op("Div", determinant, g.op("Add", g.op("Add", uu, vv), g.float(1e-8)))
    highest = g.op("MaxPool", response, kernel_shape=[5, 5], pads=[2] * 4)
    kept = g.op("Where", g.op("Equal", response, highest), response, g.float(0.0))
    strength, at = g.op("TopK", g.op("Reshape", kept, g.ints(-1)), g.ints(CORNERS), outputs=2)
    present = g.op("Greater", strength, g.float(1e-6))
    # Histograms of cells around every pixel, one channel a cell and orientation.
    cells = g.op("AveragePool", rectified, kernel_shape=[CELL] * 2, pads=[CELL // 2] * 4, count_include_pad=1)
    reach = CELL * (GRID - 1)
    pads = [reach // 2, reach // 2, reach - reach // 2, reach - reach // 2]
    dense = g.op("Conv", cells, cells_to_channels, group=ORIENTATIONS, dilations=[CELL] * 2, pads=pads)
    dense = g.op("Reshape", dense, g.ints(ORIENTATIONS * GRID * GRID, -1))
    descriptors = g.op("Transpose", g.op("Gather", dense, at, axis=1), perm=[1, 0])
    length = g.op("Sqrt", g.op("ReduceSum", g.op("Mul", descriptors, descriptors), g.ints(1), keepdims=1))
    return at, present, g.op("Div", descriptors, g.op("Add", length, g.float(1e-8)))


def corners(path):
    g = Graph()
    filters = g.constant(derivative_filters(), np.float32), g.constant(cell_filters(), np.float32)
    (at0, present0, d0), (at1, present1, d1) = (corners_of(g, image, *filters) for image in ("image0", "image1"))
    cosines = g.op("MatMul", d0, g.op("Transpose", d1, perm=[1, 0]))
    forward = g.op("ArgMax", cosines, axis=1, keepdims=0)
    backward = g.op("ArgMax", cosines, axis=0, keepdims=0)
    there_and_back = g.op("Gather", backward, forward, axis=0)
    own = g.constant(np.arange(CORNERS), np.int64)
    mutual = g.op("Equal", there_and_back, own)
    mutual = g.op("And", mutual, g.op("And", present0, g.op("Gather", present1, forward, axis=0)))
    best = g.op("ReduceMax", cosines, axes=[1], keepdims=0)
    chosen = g.op("Reshape", g.op("NonZero", mutual), g.ints(-1))
    partners = g.op("Gather", forward, chosen, axis=0)
    g.named(g.pixels(g.op("Gather", at0, chosen, axis=0), g.width("image0")), "keypoints0")
    g.named(g.pixels(g.op("Gather", at1, partners, axis=0), g.width("image1")), "keypoints1")
    g.named(g.op("Gather", best, chosen, axis=0), "confidence")
    g.save(path, 1, "height", "width", True)


def example(model, path):
    """A texture of 4 x 4 squares, two cuts of 64 x 48 from it, and their matches, the surest first."""
    squares = np.random.default_rng(1).integers(0, 256, (20, 24)).astype(np.uint8)
    texture = squares.repeat(4, 0).repeat(4, 1)
    corners = [[8, 8], [5, 10]]
    images = [texture[v : v + 48, u : u + 64] for u, v in corners]
    session = onnxruntime.InferenceSession(model)
    feed = {f"image{k}": (image.astype(np.float32) / 255.0)[None, None] for k, image in enumerate(images)}
    points0, points1, confidence = session.run(["keypoints0", "keypoints1", "confidence"], feed)
    order = np.argsort(-confidence, kind="stable")
    matches = [[*points0[i].tolist(), *points1[i].tolist(), round(float(confidence[i]), 5)] for i in order]
    example = {"squares": squares.tolist(), "cut_corners": corners, "cut_size": [64, 48], "matches": matches}
    path.write_text(json.dumps(example, separators=(",", ":")) + "\n")
    moved = (points1 - points0 == [3, -2]).all(1)
    print(f"{path.name}: {len(matches)} matches, {moved.mean():.0%} moved by (3, -2)")


def main():
    folder = Path(sys.argv[1])
    beacons(folder / "matcher_beacons.onnx", 1, "height", "width", True)
    beacons(folder / "matcher_beacons_fixed.onnx", 3, 32, 48, False)
    corners(folder / "matcher_corners.onnx")
    example(folder / "matcher_corners.onnx", folder / "matcher_corners.json")


if __name__ == "__main__":
    main()
