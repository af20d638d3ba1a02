"""Pictures of what happened: a GIF, and an MP4 where the package `av` is installed."""
import mujoco
import numpy as np
from PIL import Image

WIDTH, HEIGHT = 480, 360
# Of the recorded moments a GIF shows every how many-th, s each: twice the real speed; a film shows all at that speed.
EVERY, SHOWN = 3, 0.12


def camera_for(model, joints, data):
    """Looks at the twin from the side that its parts open to, and from above."""
    front = np.zeros(3)
    for joint in joints:
        j = model.joint(joint.name).id
        body = model.joint(joint.name).bodyid[0]
        sign = np.sign(joint.open - joint.closed)
        axis, arm = data.xaxis[j], data.xipos[body] - data.xanchor[j]
        way = sign * axis if joint.kind == "slide" else sign * np.cross(axis, arm)
        front += way / max(np.linalg.norm(way), 1e-9)
    front[2] = 0
    angle = np.arctan2(front[1], front[0]) if np.linalg.norm(front) > 0.3 else 0.0
    camera = mujoco.MjvCamera()
    camera.lookat[:] = model.stat.center
    camera.distance = 1.25 * model.stat.extent
    # The camera looks along its azimuth.
    camera.azimuth, camera.elevation = np.degrees(angle) + 180 + 38, -25
    return camera


def pictures(model, moments, camera, solids=False, size=(WIDTH, HEIGHT)):
    """Renders positions of all joints, one after the other."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = [1, 1, not solids, solids, 1, 0]
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, size[1], size[0]) as renderer:
        for qpos in moments:
            data.qpos[:] = qpos
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera, option)
            yield renderer.render().copy()


def film(folder, model, moments, camera):
    """Writes demo.gif, and demo.mp4 where PyAV is there."""
    frames = list(pictures(model, moments, camera))
    write_gif(folder / "demo.gif", frames[::EVERY], SHOWN)
    try:
        import av
    except ImportError:
        return
    with av.open(str(folder / "demo.mp4"), "w") as container:
        stream = container.add_stream("h264", rate=round(EVERY / SHOWN))
        stream.width, stream.height, stream.pix_fmt = frames[0].shape[1], frames[0].shape[0], "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())


def write_gif(path, frames, seconds):
    """Writes a GIF that shows each frame for some seconds, with one palette for all."""
    frames = [Image.fromarray(f) for f in frames]
    # Colors of a few frames side by side.
    some = frames[:: max(1, len(frames) // 4)][:5]
    strip = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for k, frame in enumerate(some):
        strip.paste(frame, (0, k * frame.height))
    palette = strip.quantize(128, dither=Image.Dither.NONE)
    frames = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 * seconds), loop=0, optimize=False)
