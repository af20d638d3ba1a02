"""TSDF fusion and meshing of a recording by Open3D, from the bag to two PLY files: `open3d_fusion.py BAG OUT`.

Reads what artitwin reads (JPEG color, compressedDepth PNG, /tf interpolated, masks) with the rosbags package; voxel = extent / 160.
Prints one JSON line: seconds of decoding and of fusion and meshing.
"""

import io
import json
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d
from PIL import Image
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation, Slerp

TRUNCATION_VOXELS = 4.0


def matrix(t):
    pose = np.eye(4)
    q, p = t.rotation, t.translation
    pose[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    pose[:3, 3] = [p.x, p.y, p.z]
    return pose


def stamp(header):
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


def frames(bag):
    """Posed frames: camera matrix, world_from_camera, color, depth in meters (0 outside the mask)."""
    color, depth, mask, moving, fixed, info = {}, {}, {}, {}, {}, None
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            topic = connection.topic
            if topic.endswith("/compressedDepth"):
                depth[stamp(message.header)] = np.array(Image.open(io.BytesIO(bytes(message.data[12:]))), np.float32) / 1000
            elif topic.endswith("/compressed"):
                color[stamp(message.header)] = np.array(Image.open(io.BytesIO(bytes(message.data))).convert("RGB"))
            elif topic.endswith("mask"):
                mask[stamp(message.header)] = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width) > 0
            elif topic == "/tf":
                for t in message.transforms:
                    moving.setdefault((t.header.frame_id, t.child_frame_id), {})[stamp(t.header)] = matrix(t.transform)
            elif topic == "/tf_static":
                for t in message.transforms:
                    fixed[t.child_frame_id] = (t.header.frame_id, matrix(t.transform))
            elif topic.endswith("camera_info"):
                info = message
    ((_, body), poses), = moving.items()
    chain, frame = np.eye(4), info.header.frame_id
    while frame != body:
        frame, step = fixed[frame]
        chain = step @ chain
    times = sorted(poses)
    turn = Slerp(times, Rotation.from_matrix([poses[t][:3, :3] for t in times]))
    places = np.array([poses[t][:3, 3] for t in times])
    for t in sorted(set(color) & set(depth)):
        pose = np.eye(4)
        pose[:3, :3] = turn(t).as_matrix()
        pose[:3, 3] = [np.interp(t, times, places[:, k]) for k in range(3)]
        seen = np.where(mask[t], depth[t], 0) if t in mask else depth[t]
        yield np.array(info.k).reshape(3, 3), pose @ chain, color[t], seen


def main():
    bag, out = Path(sys.argv[1]), Path(sys.argv[2])
    begin = time.perf_counter()
    states = [list(frames(bag / f"state{s}")) for s in (0, 1)]
    decoded = time.perf_counter()
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for k, pose, _, depth in (f for state in states for f in state):
        v, u = np.nonzero(depth)
        points = np.linalg.inv(k) @ np.stack([u, v, np.ones_like(u)]) * depth[v, u]
        points = pose[:3, :3] @ points + pose[:3, 3:]
        low, high = np.minimum(low, np.percentile(points, 1, axis=1)), np.maximum(high, np.percentile(points, 99, axis=1))
    voxel = (high - low).max() / 160
    out.mkdir(parents=True, exist_ok=True)
    for s, state in enumerate(states):
        # The legacy ScalableTSDFVolume of the 0.20.0 wheel gives no vertices here; this is the API that followed it.
        grid = o3d.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight", "color"), attr_dtypes=(o3d.core.float32,) * 3, attr_channels=((1), (1), (3)),
            voxel_size=voxel, block_resolution=16, block_count=20000)
        for k, pose, color, depth in state:
            k, pose = o3d.core.Tensor(k), o3d.core.Tensor(np.linalg.inv(pose))
            depth = o3d.t.geometry.Image(o3d.core.Tensor(depth))
            color = o3d.t.geometry.Image(o3d.core.Tensor(color.astype(np.float32) / 255))
            blocks = grid.compute_unique_block_coordinates(depth, k, pose, 1.0, 10.0, TRUNCATION_VOXELS)
            grid.integrate(blocks, depth, color, k, k, pose, 1.0, 10.0, TRUNCATION_VOXELS)
        o3d.io.write_triangle_mesh(str(out / f"state{s}.ply"), grid.extract_triangle_mesh(weight_threshold=2.0).to_legacy())
    fused = time.perf_counter()
    print(json.dumps({"decode_s": decoded - begin, "fuse_s": fused - decoded, "voxel_m": voxel}))


if __name__ == "__main__":
    main()
