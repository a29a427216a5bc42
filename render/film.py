"""Filming: plan the cameras of an event, then draw and write every frame of every view, on all cores.

OpenGL is opened in spawned processes only, one per core, each software rasteriser single-threaded: two processes of
one thread draw faster than one process of two, and the caller's environment stays untouched. OpenGL calls release
the interpreter's lock, so each process encodes in a thread beside. Which process draws a frame changes no byte of it.

Since workers are spawned, a script that calls :func:`shoot` or :func:`plan_views` needs the usual
`if __name__ == "__main__"` guard.
"""

from __future__ import annotations

import functools
import itertools
import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.egl import NoGL
from render.encode import write_depth, write_rgb, write_segmentation
from render.mirrors import Face
from render.raster import Beam, Free, Raster, Still, Wire, geom_corners, moving_geoms
from render.rig import FOV, NoClearView, Sphere, event_sphere, moving_view, static_views
from render.surface import Particles

if TYPE_CHECKING:
    from render.photoreal import Look, Studio

Array = NDArray[np.float64]
Info = dict[str, str | bool]
T = TypeVar("T")

MODALITIES = frozenset({"rgb", "depth", "seg"})
SIZE = (1120, 1120)

TRIAL = 160
"""Width of the trial pictures that decide whether a view is clear [pixel]."""
TRIAL_FRAMES = 8
CUT = 0.02
"""A subject is cut off when this fraction of its pixels lies on the picture's border."""
OCCLUDED = 0.5
"""A subject is occluded when less than this fraction of its pixels is seen."""
FEW = 6
"""A subject of fewer trial pixels than this is judged over all frames together, not in each."""

FEWEST_FOR_STILLS = 8
"""From this many frames on, standing cameras draw what never moves once."""

BACKLOG = 6
"""Pictures that may wait for their encoder in one process; 10 MB each at most at full size."""


class WorkerFailed(RuntimeError):
    """A drawing process died; the message says which and of what."""


@dataclass(frozen=True)
class View:
    """A camera: folder name and camera-to-world pose, (4, 4) if it stands, (T, 4, 4) if it moves."""

    name: str
    poses: Array

    def at(self, frame: int) -> Array:
        """Pose (4, 4) at a frame."""
        return self.poses if self.poses.ndim == 2 else np.asarray(self.poses[frame])


@dataclass(frozen=True)
class Footage:
    """What to film.

    Args:
        model: compiled model; it is pickled to the workers.
        qpos: (T, nq) positions, one row per frame.
        ids: (ngeom,) segmentation ids, 0 is the background.
        sphere: event sphere; see :func:`swept_sphere`.
        views: cameras; may be empty until :func:`plan_views` gave them.
        mocap_pos: (T, nmocap, 3), or None for the model's own.
        mocap_quat: (T, nmocap, 4), or None for the model's own.
        tendon_ids: (ntendon,) segmentation ids, or None for no tendon.
        coils: springs and ropes drawn in place of their tendons.
        beams: of light, each with a path for every frame.
        faces: that are flat mirrors, and show the scene.
        matter: pieces of continua, with particles for every frame.
        look: how paths are traced for the colour pictures; None: they are the rasteriser's.
        size: (W, H) [pixel].
        fov: horizontal field of view [rad].
        modalities: of "rgb", "depth", "seg", those to write.

    Raises:
        ValueError: shapes that do not fit each other, unknown modalities, or two views of one name.
    """

    model: mujoco.MjModel
    qpos: Array
    ids: NDArray[np.integer[Any]]
    sphere: Sphere
    views: tuple[View, ...] = ()
    mocap_pos: Array | None = None
    mocap_quat: Array | None = None
    tendon_ids: NDArray[np.integer[Any]] | None = None
    coils: tuple[Wire, ...] = ()
    beams: tuple[Beam, ...] = ()
    faces: tuple[Face, ...] = ()
    matter: tuple[Particles, ...] = ()
    look: Look | None = None
    size: tuple[int, int] = SIZE
    fov: float = FOV
    modalities: frozenset[str] = field(default=MODALITIES)

    def __post_init__(self) -> None:
        frames = len(self.qpos)
        wanted = {
            "qpos": (self.qpos, (frames, self.model.nq)),
            "mocap_pos": (self.mocap_pos, (frames, self.model.nmocap, 3)),
            "mocap_quat": (self.mocap_quat, (frames, self.model.nmocap, 4)),
        }
        for name, (array, shape) in wanted.items():
            if array is not None and array.shape != shape:
                raise ValueError(f"{name} must be {shape}, got {array.shape}")
        for beam in self.beams:
            if len(beam.points) != frames:
                raise ValueError(f"a beam must have {frames} paths, got {len(beam.points)}")
        for piece in self.matter:
            if len(piece) != frames:
                raise ValueError(f"a piece of matter must have particles for {frames} frames, got {len(piece)}")
        for view in self.views:
            if view.poses.shape not in ((4, 4), (frames, 4, 4)):
                raise ValueError(f"view {view.name!r} must be (4, 4) or ({frames}, 4, 4), got {view.poses.shape}")
        if len({view.name for view in self.views}) < len(self.views):
            raise ValueError(f"two views share a name: {[view.name for view in self.views]}")
        if not self.modalities or not self.modalities <= MODALITIES:
            raise ValueError(f"modalities must be some of {sorted(MODALITIES)}, got {sorted(self.modalities)}")

    def put(self, raster: Raster, frame: int) -> None:
        """Pose the raster's model as it is at a frame."""
        raster.pose(
            self.qpos[frame],
            None if self.mocap_pos is None else self.mocap_pos[frame],
            None if self.mocap_quat is None else self.mocap_quat[frame],
            [beam.at(frame) for beam in self.beams],
            [layer for piece in self.matter for layer in piece.at(frame)],
        )

    def part(self, frames: Sequence[int]) -> Footage:
        """Some of its frames, renumbered from 0, with poses of moving views to match."""
        some = list(frames)
        views = tuple(v if v.poses.ndim == 2 else View(v.name, v.poses[some]) for v in self.views)
        return replace(
            self, qpos=self.qpos[some], views=views,
            mocap_pos=None if self.mocap_pos is None else self.mocap_pos[some],
            mocap_quat=None if self.mocap_quat is None else self.mocap_quat[some],
            beams=tuple(replace(beam, points=beam.points[some]) for beam in self.beams),
            matter=tuple(piece.part(some) for piece in self.matter),
        )  # fmt: skip

    def raster(self, size: tuple[int, int], **quality: int) -> Raster:
        """A raster of this model at another size; see :class:`render.raster.Raster` for `quality`."""
        return Raster(
            self.model,
            size,
            self.ids,
            sphere=self.sphere,
            fov=self.fov,
            tendon_ids=self.tendon_ids,
            coils=self.coils,
            faces=self.faces,
            **quality,
        )


def movable(model: mujoco.MjModel, ids: ArrayLike) -> frozenset[int]:
    """Segmentation ids above 0 of the geoms that can move."""
    return frozenset(int(i) for i in np.unique(np.asarray(ids)[moving_geoms(model)]) if i > 0)


def swept_sphere(
    model: mujoco.MjModel,
    qpos: Array,
    ids: ArrayLike,
    *,
    mocap_pos: Array | None = None,
    mocap_quat: Array | None = None,
    matter: Collection[Particles] = (),
    subject: Collection[int] | None = None,
    margin: float = 0.05,
) -> Sphere:
    """Event sphere of a motion: holds the bounding box of every geom of the subject at up to 128 frames, and matter.

    Args:
        model: compiled model.
        qpos: (T, nq) positions.
        ids: (ngeom,) segmentation ids.
        mocap_pos: (T, nmocap, 3) or None.
        mocap_quat: (T, nmocap, 4) or None.
        matter: pieces of continua, with particles for T frames.
        subject: segmentation ids to hold; None is all above 0, whether they move or stand. Planes have no box.
        margin: fraction added to the radius.

    Raises:
        ValueError: the subject has no geom and no matter.
    """
    wanted = np.asarray(ids) > 0 if subject is None else np.isin(ids, list(subject))
    chosen = np.flatnonzero(wanted & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE.value))
    pieces = [piece for piece in matter if subject is None or piece.segmentation in subject]
    if len(chosen) == 0 and not pieces:
        raise ValueError("no geom has an id of the subject: nothing to film")
    data = mujoco.MjData(model)
    points = []
    for frame in _sample(len(qpos), 128):
        points += [piece.extremes(frame) for piece in pieces]
        data.qpos[:] = qpos[frame]
        if mocap_pos is not None:
            data.mocap_pos[:] = mocap_pos[frame]
        if mocap_quat is not None:
            data.mocap_quat[:] = mocap_quat[frame]
        mujoco.mj_kinematics(model, data)
        points.append(geom_corners(model, data, chosen))
    return event_sphere(np.concatenate(points), margin=margin)


def plan_views(
    footage: Footage, rng: np.random.Generator, *, count: int = 12, subject: Collection[int] | None = None
) -> tuple[View, ...]:
    """Cameras for a footage without views: `CineCamera_0` ... and `CineCamera_Moving`, all with a clear view.

    A view is clear when the subject, at up to 8 times, is not cut off by the border and at least half of it is seen.

    Args:
        footage: what will be filmed; its `views` are not read.
        rng: source of randomness; one child is spawned from it.
        count: number of static cameras.
        subject: segmentation ids that have to be seen; None is what can move, and all matter.

    Raises:
        NoClearView: the subject cannot be seen from enough places.
        NoGL: there is no driver.
        WorkerFailed: the drawing process died.
    """
    own = frozenset(piece.segmentation for piece in footage.matter)
    seen = movable(footage.model, footage.ids) | own if subject is None else frozenset(subject)
    frames = _sample(len(footage.qpos), TRIAL_FRAMES)
    task = functools.partial(_plan, footage.part(frames), frames, len(footage.qpos), rng.spawn(1)[0], count, seen)
    return _run([task], None)[0]


def subject_visible(
    raster: Raster, footage: Footage, pose: Array, subject: Collection[int], frames: Sequence[int]
) -> bool:
    """Whether the subject is seen from a pose (4, 4) at all given frames: inside the image and mostly unoccluded.

    Args:
        raster: of the footage, at a small size; its pose is changed.
        footage: the motion.
        pose: camera.
        subject: segmentation ids.
        frames: indices into the motion.
    """
    total = np.zeros(2)
    for frame in frames:
        footage.put(raster, frame)
        seen = np.isin(raster.depth_and_segmentation(pose)[1], list(subject))
        raster.show_only(subject)
        alone = raster.depth_and_segmentation(pose)[1] > 0
        raster.show_only(None)
        whole = np.count_nonzero(alone)
        border = whole - np.count_nonzero(alone[1:-1, 1:-1])
        if border > CUT * whole or (whole >= FEW and np.count_nonzero(seen) < OCCLUDED * whole):
            return False
        total += np.count_nonzero(seen), whole
    return bool(total[1] > 0 and total[0] >= OCCLUDED * total[1])


def shoot(
    footage: Footage, folder: Path, *, workers: int | None = None, progress: Callable[[int], None] | None = None
) -> Info:
    """Write `folder/<view>/{rgb,depth,seg}/%04d.{jpg,npz,npz}` for every view and frame.

    Args:
        footage: what to film; has views.
        folder: made if need be.
        workers: number of processes; None is one per core that this process may use.
        progress: called in this process with the number of views of frames written so far.

    Returns:
        vendor, renderer and version of the driver, and whether it is software.

    Raises:
        NoGL: there is no driver.
        WorkerFailed: a drawing process died or failed; all others are ended.
        ValueError: there are no views or no frames, or `workers` is not positive.
    """
    frames = len(footage.qpos)
    if not footage.views or not frames:
        raise ValueError(f"nothing to film: {len(footage.views)} views of {frames} frames")
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    for view, kind in itertools.product(footage.views, footage.modalities):
        (folder / view.name / kind).mkdir(parents=True, exist_ok=True)
    parts = min(workers or len(os.sched_getaffinity(0)), frames)
    # decided by the whole footage, not by a part of it: else pictures would depend on the number of workers
    stills = frames >= FEWEST_FOR_STILLS
    tasks = [functools.partial(_draw, *_share(footage, part, parts), folder, stills) for part in range(parts)]
    return _run(tasks, progress)[0]


def _sample(frames: int, most: int) -> list[int]:
    return sorted({int(i) for i in np.linspace(0, frames - 1, min(frames, most)).round()})


def _plan(
    footage: Footage, frames: Sequence[int], total: int, rng: np.random.Generator, count: int, subject: frozenset[int],
    report: Callable[[int], None],
) -> tuple[View, ...]:  # fmt: skip
    """Views of a footage of so many frames in total, of which some are given, and their numbers."""
    given = range(len(frames))
    width, height = footage.size
    with footage.raster((TRIAL, max(1, round(TRIAL * height / width))), samples=0, shadow=0) as raster:

        def clear(pose: Array) -> bool:
            return subject_visible(raster, footage, pose, subject, given)

        statics = static_views(rng, footage.sphere, count, clear=clear, fov=footage.fov, size=footage.size)
        for _ in range(32):
            poses = moving_view(rng, footage.sphere, total, fov=footage.fov, size=footage.size)
            if all(subject_visible(raster, footage, poses[frames[i]], subject, [i]) for i in given):
                break
        else:
            raise NoClearView("no moving camera keeps the event in view: 32 trajectories tried")
    report(count + 1)
    named = [View(f"CineCamera_{index}", pose) for index, pose in enumerate(statics)]
    return (*named, View("CineCamera_Moving", poses))


def _share(footage: Footage, part: int, parts: int) -> tuple[Footage, Sequence[int], list[tuple[int, int]]]:
    """What falls to one of several processes: a footage, the numbers of its frames, its views and frames to be drawn.

    Standing views are cut into contiguous pieces, so that few processes draw the same view's background; moving ones,
    which cost more, are dealt out frame by frame. Of matter, whose surface costs as much as some views of it, each
    process has frames of its own, in all views.
    """
    total, views = range(len(footage.qpos)), range(len(footage.views))
    if footage.matter:
        frames = total[part::parts]
        return footage.part(frames), frames, [(view, i) for i in range(len(frames)) for view in views]
    moving = [footage.views[view].poses.ndim == 3 for view in views]
    stand = [(view, frame) for view in views if not moving[view] for frame in total]
    move = [(view, frame) for view in views if moving[view] for frame in total]
    own = stand[len(stand) * part // parts : len(stand) * (part + 1) // parts] + move[part::parts]
    return footage, total, own


def _draw(
    footage: Footage, frames: Sequence[int], shots: list[tuple[int, int]], folder: Path, stills: bool,
    report: Callable[[int], None],
) -> Info:  # fmt: skip
    with footage.raster(footage.size) as raster, _encoder() as encode:
        kind = Still if stills and raster.separable() else Free
        studio = _studio(raster, footage.look) if footage.look else None
        last = {number: shot for shot, (number, _) in enumerate(shots)}
        cameras: dict[int, Free] = {}
        posed = -1
        for shot, (number, i) in enumerate(shots):
            view, frame = footage.views[number], frames[i]
            if i != posed:
                footage.put(raster, i)
                posed = i
            if view.poses.ndim == 3:
                cameras[number] = Free(raster, view.at(i))
            elif number not in cameras:
                cameras[number] = kind(raster, view.poses)
            camera, place = cameras[number], folder / view.name
            if "rgb" in footage.modalities:
                picture = studio.colour(view.at(i), (number, frame)) if studio else camera.colour()
                encode(write_rgb, place / "rgb" / f"{frame:04d}.jpg", picture)
            if footage.modalities & {"depth", "seg"}:
                depth, seg = camera.depth_and_segmentation()
                if "depth" in footage.modalities:
                    encode(write_depth, place / "depth" / f"{frame:04d}.npz", depth)
                if "seg" in footage.modalities:
                    encode(write_segmentation, place / "seg" / f"{frame:04d}.npz", seg)
            if shot == last[number]:
                del cameras[number]  # and its backgrounds
            report(1)
        return raster.info() | ({"photoreal": studio.info()} if studio else {})


def _studio(raster: Raster, look: Look) -> Studio:
    from render.photoreal import Studio  # what it needs of the physics takes each process as long as ten frames

    return Studio(raster, look)


@contextmanager
def _encoder() -> Iterator[Callable[..., None]]:
    """A function that calls another in a thread beside; waits for the oldest call when too many are pending."""
    pending: list[Future[None]] = []
    with ThreadPoolExecutor(1) as pool:

        def encode(write: Callable[..., None], *arguments: Any) -> None:
            pending.append(pool.submit(write, *arguments))
            if len(pending) > BACKLOG:
                pending.pop(0).result()

        yield encode
        for call in pending:
            call.result()


def _run(tasks: Sequence[Callable[[Callable[[int], None]], T]], progress: Callable[[int], None] | None) -> list[T]:
    """Results of the tasks, each called in a spawned process with a function that reports counts of work done."""
    context = multiprocessing.get_context("spawn")
    threads = max(1, len(os.sched_getaffinity(0)) // len(tasks))
    results: dict[int, T] = {}
    done = 0
    processes = []
    inboxes: dict[Connection, int] = {}
    try:
        for index, task in enumerate(tasks):
            inbox, outbox = context.Pipe(duplex=False)
            process = context.Process(target=_serve, args=(task, outbox, threads), daemon=True)
            process.start()
            outbox.close()
            processes.append(process)
            inboxes[inbox] = index
        while inboxes:
            for inbox in [box for box in wait(list(inboxes)) if isinstance(box, Connection)]:
                index = inboxes[inbox]
                try:
                    kind, content = inbox.recv()
                except EOFError:
                    processes[index].join()
                    death = _death(processes[index].exitcode)
                    raise WorkerFailed(f"drawing process {index} of {len(tasks)} died: {death}") from None
                if kind == "done":
                    done += content
                    if progress is not None:
                        progress(done)
                elif kind == "result":
                    results[index] = content
                    del inboxes[inbox]
                elif isinstance(content, (NoGL, NoClearView)):
                    raise content
                else:
                    failure = WorkerFailed(f"drawing process {index} of {len(tasks)} failed: {content[0]}")
                    failure.add_note(content[1])
                    raise failure
    finally:
        for process in processes:
            if len(results) < len(tasks):
                process.terminate()
            process.join()
        for inbox in inboxes:
            inbox.close()
    return [results[index] for index in range(len(tasks))]


def _death(code: int | None) -> str:
    return f"signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit code {code}"


def _serve(task: Callable[[Callable[[int], None]], object], outbox: Connection, threads: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("LP_NUM_THREADS", str(threads))
    try:
        outbox.send(("result", task(lambda count: outbox.send(("done", count)))))
    except (NoGL, NoClearView) as failure:
        outbox.send(("failure", failure))
    except Exception as failure:
        outbox.send(("failure", (f"{type(failure).__name__}: {failure}", traceback.format_exc())))
