"""Pictures of what happened: a GIF, and an MP4 where the package `av` is installed."""
import mujoco
import numpy as np
from PIL import Image

WIDTH, HEIGHT = 480, 360
# Of the recorded moments a GIF shows every how many-th, s each: twice the real speed; a film shows all at that speed.
EVERY, SHOWN = 3, 0.12


def camera_for(model, front, near):
    """Looks at the twin from above and beside a direction that it opens to. `near`: distance by the twin's size."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = model.stat.center
    # A hand's length more, for small things.
    camera.distance = near * model.stat.extent + 0.25
    # The camera looks along its azimuth.
    camera.azimuth, camera.elevation = np.degrees(np.arctan2(front[1], front[0])) + 180 + 38, -36
    return camera


def pictures(model, moments, camera, solids=False, size=(WIDTH, HEIGHT)):
    """Renders positions of all joints, one after the other."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = [1, 1, not solids, solids, 1, 0]
    data = mujoco.MjData(model)
    with mujoco.Renderer(model, size[1], size[0]) as renderer:
        for qpos, places, turns in moments:
            data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, places, turns
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera, option)
            yield renderer.render().copy()


def film(folder, model, moments, camera):
    """Writes demo.gif, and demo.mp4 where PyAV is there."""
    try:
        import av
    except ImportError:
        return write_gif(folder / "demo.gif", list(pictures(model, moments[::EVERY], camera)), SHOWN)
    frames = list(pictures(model, moments, camera))
    write_gif(folder / "demo.gif", frames[::EVERY], SHOWN)
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
    some = frames[:: max(1, len(frames) // 12)]
    strip = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for k, frame in enumerate(some):
        strip.paste(frame, (0, k * frame.height))
    palette = strip.quantize(128, dither=Image.Dither.NONE)
    frames = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 * seconds), loop=0, optimize=False)
