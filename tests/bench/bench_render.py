"""How much faster `shoot` is than three `mujoco.Renderer` calls per view that write PNG files.

Run by hand: `python -m tests.bench.bench_render [frames] [width] [rounds]`. Both sides draw 13 views (12 standing, one
moving) of the same scenes, in the same run on the same cores, in turns. The plain side draws colour, depth and ids with
`mujoco.Renderer` at its default quality, in one process in which the software rasteriser uses all cores, and writes
PNG files with OpenCV: depth as 16-bit millimetres. Start-up is counted on neither side.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import cv2
import mujoco
import numpy as np

from render.film import Footage, View, shoot
from render.rig import Sphere, fit_distance, moving_view, orbit

from ..render.sets import pendulum, staged


def falling(count: int, frames: int) -> Footage:
    """Balls and boxes above the floor, moved without dynamics."""
    rng = np.random.default_rng(0)
    colours = [".84 .27 .22", ".93 .55 .20", ".94 .76 .28", ".30 .62 .42", ".23 .47 .76", ".50 .38 .68"]
    shapes = "".join(
        f'<body><freejoint/><geom type="{("sphere", "box")[i % 2]}" size=".06 .06 .06" rgba="{colours[i % 6]} 1"/>'
        "</body>"
        for i in range(count)
    )
    model, ids = staged(f"<mujoco><worldbody>{shapes}</worldbody></mujoco>")
    start = rng.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 1.2], (count, 3))
    qpos = np.zeros((frames, count, 7))
    qpos[..., 3] = 1
    qpos[..., :3] = start + np.linspace(0, 0.1, frames)[:, None, None] * rng.normal(size=(count, 3))
    ids = np.minimum(ids, 250)
    return Footage(model, qpos.reshape(frames, -1), ids, Sphere(np.array([0, 0, 0.6]), 1.1))


def film(footage: Footage, width: int) -> Footage:
    """The footage with 12 standing views and a moving one."""
    sphere, frames = footage.sphere, len(footage.qpos)
    far = fit_distance(sphere.radius)
    still = [View(f"CineCamera_{i}", orbit(sphere, i * 0.52, 0.55 + 0.03 * i, far)) for i in range(12)]
    path = moving_view(np.random.default_rng(1), sphere, frames)
    return dataclasses.replace(footage, views=(*still, View("CineCamera_Moving", path)), size=(width, width))


def plain(footage: Footage, folder: Path, outbox: object) -> None:
    """The straightforward way; sends the seconds it took."""
    os.environ["MUJOCO_GL"] = "egl"
    from mujoco.egl import GLContext
    from mujoco.rendering.classic import gl_context, renderer

    gl_context.GLContext = GLContext
    model, data = footage.model, mujoco.MjData(footage.model)
    width, height = footage.size
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.global_.fovy = 2 * np.degrees(np.arctan(np.tan(footage.fov / 2) * height / width))
    for view in footage.views:
        for kind in ("rgb", "depth", "seg"):
            (folder / view.name / kind).mkdir(parents=True)
    draw = renderer.Renderer(model, height, width)
    camera = mujoco.MjvCamera()
    start = time.perf_counter()
    for frame, qpos in enumerate(footage.qpos):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        for view in footage.views:
            pose = view.at(frame)
            back = pose[:3, 2]
            camera.lookat[:] = footage.sphere.centre
            camera.distance = np.linalg.norm(pose[:3, 3] - footage.sphere.centre)
            camera.azimuth = np.degrees(np.arctan2(-back[1], -back[0]))
            camera.elevation = -np.degrees(np.arcsin(back[2]))
            draw.update_scene(data, camera)
            place, stem = folder / view.name, f"{frame:04d}.png"
            cv2.imwrite(str(place / "rgb" / stem), draw.render()[..., ::-1])
            draw.enable_depth_rendering()
            cv2.imwrite(str(place / "depth" / stem), np.minimum(draw.render() * 1000, 65535).astype(np.uint16))
            draw.disable_depth_rendering()
            draw.enable_segmentation_rendering()
            seg = draw.render()[..., 0]
            cv2.imwrite(str(place / "seg" / stem), np.where(seg < 0, 0, footage.ids[seg]).astype(np.uint8))
            draw.disable_segmentation_rendering()
    outbox.send(time.perf_counter() - start)  # type: ignore[attr-defined]


def processor() -> float:
    """Seconds of processor time of all processes that this one has waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def timed_plain(footage: Footage, folder: Path) -> tuple[float, float]:
    """Seconds of wall and of processor time; the latter includes start-up, about 1 s."""
    context = multiprocessing.get_context("spawn")
    inbox, outbox = context.Pipe(duplex=False)
    process = context.Process(target=plain, args=(footage, folder, outbox))
    before = processor()
    process.start()
    seconds = float(inbox.recv())
    process.join()
    return seconds, processor() - before


def timed_shoot(footage: Footage, folder: Path) -> tuple[float, float]:
    """Seconds of wall time, less those of filming two tiny frames (start-up), and of processor time with start-up."""
    first = dataclasses.replace(footage, qpos=footage.qpos[:2], size=(16, 16), views=footage.views[:1])
    start = time.perf_counter()
    shoot(first, folder / "start")
    middle, before = time.perf_counter(), processor()
    shoot(footage, folder / "film")
    return time.perf_counter() - middle - (middle - start), processor() - before


def main() -> None:
    frames, width, rounds = (int(given) for given in [*sys.argv[1:], *("8", "1120", "2")[len(sys.argv) - 1 :]])
    print(
        f"{len(os.sched_getaffinity(0))} cores, {frames} frames x 13 views at {width} px; ms per view: wall (processor)"
    )
    for name, footage in {"pendulum": pendulum(frames), "100 bodies": falling(100, frames)}.items():
        footage = film(footage, width)
        per = 1000 / (frames * len(footage.views))
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as folder:
                ours, our_work = timed_shoot(footage, Path(folder))
                theirs, their_work = timed_plain(footage, Path(folder) / "plain")
            print(
                f"{name:12} shoot {ours * per:5.0f} ({our_work * per:5.0f})   plain {theirs * per:5.0f} "
                f"({their_work * per:5.0f})   ratio {theirs / ours:.2f} ({their_work / our_work:.2f})",
                flush=True,
            )


if __name__ == "__main__":
    main()
