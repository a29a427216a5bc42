"""Job -> one scene folder, whole or absent; its verification and its reproduction.

The layout is the released dataset's. Beside it, under names its readers ignore: `physics.h5`, `laws.json`,
`properties.json`, `provenance.json`, `scene.xml` and `meshes/`.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
import signal
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import h5py
import mujoco
import numpy as np
from numpy.typing import NDArray

from . import annotate, optics
from .base import Phenomenon, Refusal, Verdict
from .fidelity import Fidelity
from .registry import phenomenon
from .run import Break, Cloud, Impact, Run
from .scene import Mirror
from .simulate import Compiled, build, compile, repeater, simulate_specimen

if TYPE_CHECKING:
    from render.film import Footage

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

FORMAT: Final = 1
"""Version of what this package adds to the release's layout; a folder of another one is refused."""

MODALITIES: Final = ("rgb", "depth", "seg")
_MAX_JSON: Final = 64 << 20
_PACKAGES: Final = ("physinone-mj", "mujoco", "numpy", "scipy", "numba", "h5py", "opencv-python-headless", "trimesh")
_LETTERS: Final = "0123456789ABCDEFGHJKLMNPQRSTUVWXYZ"


class SceneExists(FileExistsError):
    """There is a whole scene of that name already; it was left alone."""


class NotAScene(ValueError):
    """A folder that is not a scene of this package; the message says what is missing or wrong."""


@dataclass(frozen=True)
class Job:
    """One scene to be made. parameters: only those that are set, the others have their nominal values.

    views: static cameras (the moving one comes on top); size: pixels per side; photoreal: paths of light per pixel of
    the colour pictures, 0 for the rasteriser's; particles: whether those of a continuum are kept, frame by frame.
    ValueError if out of range.
    """

    index: int
    parameters: Mapping[str, float | int | str]
    fidelity: Fidelity
    seed: int = 0
    views: int = 12
    size: int = 1120
    modalities: tuple[str, ...] = MODALITIES
    render: bool = True
    photoreal: int = 0
    particles: bool = True

    def __post_init__(self) -> None:
        ranges = (("views", 1, 64), ("size", 16, 4096), ("seed", 0, 2**63 - 1), ("photoreal", 0, 65536))
        for name, low, high in ranges:
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not low <= value <= high:
                raise ValueError(f"{name} = {value!r}; allowed: whole numbers from {low} to {high}")
        unknown = [m for m in self.modalities if m not in MODALITIES]
        if unknown or not self.modalities:
            raise ValueError(f"modalities = {','.join(self.modalities) or '(none)'}; allowed: some of rgb,depth,seg")
        self.specimen  # noqa: B018  an impossible parameter shall fail here, before any work

    @functools.cached_property
    def specimen(self) -> Phenomenon:
        """The phenomenon with the job's parameters."""
        return phenomenon(self.index).make(**self.parameters)

    @functools.cached_property
    def case(self) -> str:
        """The release's case id: label, background, six letters that follow from everything in the job."""
        told = {
            "index": self.index, "parameters": self.specimen.values(), "fidelity": self.fidelity.record(),
            "seed": self.seed, "views": self.views, "size": self.size, "modalities": sorted(self.modalities),
            "render": self.render, "photoreal": self.photoreal,
        } | ({} if self.particles else {"particles": False})  # fmt: skip
        number = int.from_bytes(hashlib.sha256(json.dumps(told, sort_keys=True).encode()).digest()[:8])
        letters = ""
        for _ in range(6):
            number, letter = divmod(number, len(_LETTERS))
            letters += _LETTERS[letter]
        return f"{self.specimen.label}__bg000__{letters}"

    @property
    def folder(self) -> str:
        """Name of the scene folder."""
        return f"{self.case}_trajectory"

    def rng(self, purpose: int) -> np.random.Generator:
        """A stream of its own for every purpose (1: cameras), whatever else was drawn."""
        return np.random.default_rng([self.seed, self.index, purpose])


@dataclass
class Report:
    """What `verify` and `reproduce` found. problems: one line each; ok if there are none and no law failed."""

    folder: Path
    problems: list[str] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Nothing is wrong."""
        return not self.problems and all(v.verdict != "failed" for v in self.verdicts)


def generate(job: Job, out: Path, *, force: bool = False, progress: Progress | None = None) -> Path:
    """Simulate, check, render and annotate one scene into `out/<case>_trajectory`.

    progress: called with the name of the stage and the fraction of the whole job done.
    Raises SceneExists (unless `force`, which replaces it), OSError if `out` cannot be written, and what simulating
    (Refusal, UnstableScene) and rendering (NoGL, NoMitsuba, NoClearView, WorkerFailed) raise. Nothing half-written
    stays behind; what an earlier process left when it was killed is removed.
    """
    if job.photoreal and job.render:
        from render import photoreal

        photoreal.require()
    out = Path(out)
    final = out / job.folder
    out.mkdir(parents=True, exist_ok=True)
    _sweep(out, job)
    if final.exists() and not force:
        raise SceneExists(f"{final} exists and was kept; --force replaces it")
    partial = out / f".{job.folder}.partial-{os.getpid()}"
    old = out / f".{job.folder}.replaced-{os.getpid()}"
    with _ended_in_order():
        partial.mkdir()
        try:
            _write(job, partial, progress or (lambda _stage, _done: None))
            if final.exists():
                if not force:
                    raise SceneExists(f"{final} was made by another process meanwhile and was kept")
                final.rename(old)
            partial.rename(final)
        finally:
            _remove(partial)
            _put_back(old, final)
    return final


@contextlib.contextmanager
def _ended_in_order() -> Iterator[None]:
    """SIGTERM and SIGHUP, unless somebody handles them already, end the program by SystemExit, so that it tidies up."""

    def end(number: int, _frame: Any) -> None:
        raise SystemExit(128 + number)

    mine = []
    if threading.current_thread() is threading.main_thread():
        mine = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) == signal.SIG_DFL]
    for number in mine:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)


def _sweep(out: Path, job: Job) -> None:
    for kind in ("replaced", "partial"):
        for left in out.glob(f".{job.folder}.{kind}-*"):
            owner = left.name.rpartition("-")[2]
            if not owner.isdigit() or (int(owner) != os.getpid() and Path(f"/proc/{owner}").exists()):
                continue
            if kind == "replaced":
                _put_back(left, out / job.folder)
            else:
                # drawing processes may outlive their killed parent by a frame: under another name nothing is added
                doomed = out / f".{job.folder}.partial-{os.getpid()}"
                with contextlib.suppress(OSError):
                    left.rename(doomed)
                _remove(doomed)


def _put_back(old: Path, final: Path) -> None:
    """What was to be replaced: gone if something took its place, otherwise back there."""
    if not final.exists():
        with contextlib.suppress(FileNotFoundError):
            old.rename(final)
    else:
        _remove(old)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _write(job: Job, folder: Path, progress: Progress) -> None:
    begun = clock.perf_counter()
    share = 0.05 if job.render else 0.8
    run = simulate_specimen(
        job.specimen, fidelity=job.fidelity, seed=job.seed, progress=lambda done: progress("simulating", share * done)
    )
    simulated = clock.perf_counter()
    progress("checking the laws", share)
    verdicts = run.check()
    _json(folder / "laws.json", [v.record() for v in verdicts])
    fps = run.scene.fps
    write_physics(run, folder / "physics.h5", particles=job.particles)
    _json(folder / "properties.json", annotate.properties(run))
    _json(folder / f"{job.folder}.json", annotate.motion(run, fps))
    (folder / "caption.txt").write_text(job.specimen.caption(run) + "\n", encoding="utf-8")
    (folder / "scene.xml").write_text(viewable(run), encoding="utf-8")
    (folder / "meshes").mkdir()
    for thing in annotate.things(run):
        mesh = annotate.mesh(run, thing)
        if len(mesh.vertices):
            (folder / "meshes" / f"{thing.id:03d}_{thing.name}.obj").write_text(
                str(mesh.export(file_type="obj", include_normals=False, header=None)), encoding="utf-8"
            )
    checked = clock.perf_counter()
    gl: dict[str, Any] | None = None
    if job.render:
        gl = _film(job, run, folder, lambda stage, done: progress(stage, share + (0.98 - share) * done))
    rendered = clock.perf_counter()
    progress("sealing", 0.98)
    frames = len(range(0, len(run), run.stride))
    _json(folder / "recorder_stats.json", {"frames": frames, "fps": fps, "samples": len(run), "step": run.step})
    provenance = {
        "format": FORMAT,
        "job": {
            "index": job.index, "label": job.specimen.label, "parameters": job.specimen.values(),
            "fidelity": job.fidelity.record(), "seed": job.seed, "views": job.views, "size": job.size,
            "modalities": list(job.modalities), "render": job.render, "photoreal": job.photoreal,
            "particles": job.particles,
        },
        "state_sha256": state_digest(run),
        "versions": _versions(run),
        "gl": gl,
        "seconds": {
            "simulate": simulated - begun, "check_and_annotate": checked - simulated, "render": rendered - checked,
        },
        "files": {str(p.relative_to(folder)): _digest(p) for p in sorted(folder.rglob("*")) if p.is_file()},
    }  # fmt: skip
    _json(folder / "provenance.json", provenance)
    progress("done", 1.0)


def footage_of(job: Job, run: Run) -> Footage:
    """What there is to film of a run, as a job asks for it; without views yet."""
    from render import film, mirrors, photoreal, raster

    things = {t.body: t.id for t in annotate.things(run)}
    tendons = np.zeros(run.model.ntendon, np.int32)
    coils: list[raster.Wire] = []
    for name, body in run.scene.cords.items():
        model, rope = run.model, run.model.tendon(name).id
        tendons[rope] = things[body]
        longest = max(model.tendon_lengthspring[rope, 1], model.tendon_range[rope, 1])
        width, colour = model.tendon_width[rope], tuple(model.tendon_rgba[rope])
        coils.append(raster.Cord(rope, longest, width, colour, segmentation=things[body]))
    for coil in run.scene.coils:
        wound = run.model.tendon(coil.tendon).id
        tendons[wound] = things[coil.body]
        coils.append(raster.Coil(wound, coil.turns, coil.radius, coil.wire, coil.rgba, segmentation=things[coil.body]))
    ids = annotate.geom_ids(run)
    qpos, matter = run.qpos[:: run.stride], annotate.particles(run)
    beams = tuple(
        raster.Beam(optics.trace(run, beam.name).points[:: run.stride], beam.radius, beam.rgba)
        for beam in run.scene.beams
    )
    # curved mirrors have no plane: they are drawn as they are, polished
    faces = tuple(
        mirrors.Face(run.model.geom(mirror.geom).id, mirror.point, mirror.normal)
        for mirror in run.scene.mirrors
        if isinstance(mirror, Mirror) and mirror.point is not None and mirror.normal is not None
    )
    look = photoreal.Look(
        job.photoreal, (job.seed, job.index), tuple(run.scene.mirrors), tuple(run.scene.dielectrics),
        tuple(run.scene.lamps),
    ) if job.photoreal else None  # fmt: skip
    return film.Footage(
        model=run.model, qpos=qpos, ids=ids, sphere=film.swept_sphere(run.model, qpos, ids, matter=matter),
        tendon_ids=tendons, coils=tuple(coils), beams=beams, faces=faces, matter=matter, look=look,
        size=(job.size, job.size),
        modalities=frozenset(job.modalities),
    )  # fmt: skip


def _film(job: Job, run: Run, folder: Path, progress: Progress) -> dict[str, Any]:
    from render import film

    progress("placing cameras", 0.0)
    blank = footage_of(job, run)
    views = film.plan_views(blank, job.rng(1), count=job.views)
    footage = replace(blank, views=views)
    frames = len(footage.qpos)
    total = len(views) * frames
    info = film.shoot(footage, folder, progress=lambda done: progress("rendering", 0.05 + 0.95 * done / total))
    statics = []
    for number, view in enumerate(views):
        poses = np.broadcast_to(view.poses, (frames, 4, 4))
        camera = annotate.camera_file(
            view.name, poses, fov=footage.fov, size=job.size, fps=run.scene.fps, trajectory=job.folder, number=number
        )
        _json(folder / f"blender_{view.name}.json", camera)
        if view.poses.ndim == 2:
            statics.append((view.name, camera))
    (folder / "static_camera_list.txt").write_text("".join(f"{name}\n" for name, _ in statics), encoding="utf-8")
    for name, part in annotate.split_files([camera for _, camera in statics]).items():
        _json(folder / f"transforms_{name}.json", part, indent=2)
    shown = [(v.poses, False) for v in views if v.poses.ndim == 2]
    shown += [(p, True) for v in views if v.poses.ndim == 3 for p in v.poses[:: max(1, len(v.poses) // 30)]]
    (folder / "cameras.ply").write_text(annotate.frustums(shown, footage.fov, footage.sphere.radius / 5))
    return dict(info)


def viewable(run: Run) -> str:
    """The scene as MJCF for the MuJoCo viewer, with a keyframe at the start.

    The viewer steps with MuJoCo's own contacts, and without effects and events: a look, not the data.
    """
    spec = run.scene.spec.copy()
    spec.modelname = run.specimen.label
    spec.add_key(name="start", qpos=run.qpos[0], qvel=run.qvel[0])
    spec.compile()
    return str(spec.to_xml())


def state_digest(run: Run) -> str:
    """SHA-256 of the recorded state: times, positions and velocities, sums of continua, as little-endian doubles.

    The sums of millions of particles do not come out the same if one of them went another way.
    """
    digest = hashlib.sha256()
    sums = [getattr(cloud, name) for cloud in run.clouds.values() for name in _SUMS]
    for array in (run.t, run.qpos, run.qvel, *sums, *run.pushed.values()):
        digest.update(np.ascontiguousarray(array, "<f8").tobytes())
    return digest.hexdigest()


_SUMS: Final = {
    "mass": ("kg", ""), "centre": ("m", "of mass"), "momentum": ("kg m/s", ""),
    "turning": ("kg m2/s", "angular momentum about the world's origin"), "kinetic": ("J", ""), "elastic": ("J", ""),
    "dissipated": ("J", "work of flow of what yields"), "volume": ("m3", ""),
    "low": ("m", "lowest corner of the box around it"), "high": ("m", "highest"),
}  # fmt: skip
"""What a piece of a continuum has at every sample."""

_PARTICLES: Final = {
    "position": ("m", "of particles, by frame; NaN before they are there"), "velocity": ("m/s", ""),
    "stretch": ("1", "volume by volume at rest, J"), "present": ("1", "how many are there, by frame"),
}  # fmt: skip
"""What its particles have at every frame."""


_CONSTANTS: Final = {
    "bulk": ("m3", "volume of a particle at rest"),
    "numerical_viscosity": ("Pa s", "that the method adds to its own, in vortices nine cells across"),
}  # fmt: skip


def _recorded(run: Run) -> Iterator[tuple[str, Any, str, str]]:
    """What `physics.h5` holds: (name, values, unit, about) of every dataset."""
    yield "time", run.t, "s", ""
    yield "state/qpos", run.qpos, "m, rad or 1", "MuJoCo's generalised positions"
    yield "state/qvel", run.qvel, "m/s or rad/s", "MuJoCo's generalised velocities"
    for body, name in annotate.names(run.model).items():
        origin = run.motion.origin[:, run.model.body(body).id]
        yield f"bodies/{name}/position", run.position(body), "m", "centre of mass, world axes"
        yield f"bodies/{name}/origin", origin, "m", "origin of the body's axes"
        yield f"bodies/{name}/quaternion", run.quaternion(body), "1", "body to world, w first"
        yield f"bodies/{name}/linear_velocity", run.velocity(body), "m/s", "of the centre of mass, world axes"
        yield f"bodies/{name}/angular_velocity", run.spin(body), "rad/s", "world axes"
    for name, cloud in run.clouds.items():
        for key, (unit, about) in (_SUMS | _CONSTANTS | _PARTICLES).items():
            yield f"continua/{name}/{key}", getattr(cloud, key), unit, about
    for number, (name, given) in enumerate(run.pushed.items()):
        yield f"pushed/{number}", given, "N s, N m s", f"impulse and its moment that matter gave to {name} so far"
    yield "energy/kinetic", run.motion.kinetic, "J", ""
    yield "energy/potential", run.motion.potential, "J", "gravity, springs and conservative effects"
    yield "energy/motors", run.worked, "J", "work of the motors so far"
    for name, seen in run.specimen.observables().items():
        yield f"observables/{name}", seen.measure(run.specimen, run), seen.unit, seen.about
    for beam in run.scene.beams:
        rays = optics.trace(run, beam.name)
        yield f"beams/{beam.name}/points", rays.points, "m", "start, corners and end of the beam; NaN beyond its end"
        yield f"beams/{beam.name}/geoms", rays.geoms, "1", "met at each piece's end; -1 nothing, -2 beyond the end"
        yield f"beams/{beam.name}/weights", rays.weights, "1", "fraction of its power in each piece"
        yield f"beams/{beam.name}/truncated", rays.truncated, "1", "whether cut off after its most reflections"
    hits = run.impacts
    yield "contacts/time", np.array([i.time for i in hits]), "s", "instant of each impact"
    for key in ("first", "second"):
        yield f"contacts/{key}", np.array([getattr(i, key).encode() for i in hits], dtype="S64"), "1", "geom"
    yield "contacts/position", np.array([i.position for i in hits]).reshape(-1, 3), "m", ""
    yield "contacts/normal", np.array([i.normal for i in hits]).reshape(-1, 3), "1", "from the first to the second"
    yield "contacts/approach", np.array([i.approach for i in hits]), "m/s", "normal closing speed before"
    yield "contacts/impulse", np.array([i.impulse for i in hits]).reshape(-1, 3), "N s", "on the second body"
    yield "breaks/time", np.array([b.time for b in run.breaks]), "s", "instant at which each bond broke"
    yield "breaks/weld", np.array([b.weld.encode() for b in run.breaks], dtype="S64"), "1", "bond"
    yield "breaks/load", np.array([b.load for b in run.breaks]), "N", "that broke it"
    kinds = [name for name in mujoco.mjtWarning.__members__ if name != "mjNWARNING"]
    yield "warnings", np.zeros(len(kinds), np.int64), "1", "counts of " + ", ".join(kinds)


def write_physics(run: Run, path: Path, *, particles: bool = True) -> None:
    """`physics.h5`: every recorded quantity, SI, each dataset with its `unit`. The same run gives the same bytes.

    particles: also those of continua, frame by frame, each frame a chunk of its own
    """
    # in memory first: when a write fails, as on a full disk, HDF5 ends the process by a segmentation fault
    with h5py.File(path.name, "w", libver="latest", driver="core", backing_store=False) as file:
        file.attrs["label"] = run.specimen.label
        file.attrs["samples_per_frame"] = run.stride
        if run.clouds:
            file.attrs["cell"] = run.cell
        for name, values, unit, about in _recorded(run):
            data = np.asarray(values)
            packed: dict[str, Any] = {}
            if data.size > 64:
                packed = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
            if name.startswith("continua/") and name.rpartition("/")[2] in _PARTICLES:
                if not particles:
                    continue
                packed["chunks"] = (1, *data.shape[1:])
            entry = file.create_dataset(name, data=data, track_times=False, **packed)
            entry.attrs["unit"] = unit
            if about:
                entry.attrs["about"] = about
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def read_run(folder: Path) -> tuple[Run, dict[str, Any]]:
    """The run as it was recorded, and the provenance; NotAScene says what is missing or wrong."""
    provenance, job = _read_provenance(folder)
    return _read_run(folder, job, _compiled(folder, job)), provenance


def _compiled(folder: Path, job: Job) -> Compiled:
    try:
        return compile(job.specimen, build(job.specimen), job.fidelity)
    except (ValueError, OverflowError) as why:
        raise NotAScene(f"{folder}/provenance.json: {why}") from None


def _read_run(folder: Path, job: Job, compiled: Compiled) -> Run:
    path, samples, model = folder / "physics.h5", compiled.samples, compiled.model
    try:
        with h5py.File(path, "r") as file:

            def get(name: str, *shape: int | None) -> Any:
                there = file[name].shape
                if len(there) != len(shape) or any(n not in (None, m) for n, m in zip(shape, there, strict=True)):
                    raise NotAScene(f"{path}: {name} of shape {there}; expected: {shape}")
                return file[name][...]

            t = np.asarray(get("time", samples), float)
            qpos = np.asarray(get("state/qpos", samples, model.nq), float)
            qvel = np.asarray(get("state/qvel", samples, model.nv), float)
            worked = np.asarray(get("energy/motors", samples), float)
            c = {"time": get("contacts/time", None)}
            hits = len(c["time"])
            c |= {key: get(f"contacts/{key}", hits) for key in ("first", "second", "approach")}
            c |= {key: get(f"contacts/{key}", hits, 3) for key in ("position", "normal", "impulse")}
            frames = len(range(0, samples, compiled.stride))
            clouds = {
                piece.name: _read_cloud(get, piece.name, samples, frames if job.particles else 0)
                for continuum in compiled.scene.continua for piece in continuum.pieces
            }  # fmt: skip
            met = dict.fromkeys(m.with_ for continuum in compiled.scene.continua for m in continuum.meetings)
            pushed = {name: np.asarray(get(f"pushed/{i}", samples, 6), float) for i, name in enumerate(met)}
            times = get("breaks/time", None)
            welds, loads = (get(f"breaks/{key}", len(times)) for key in ("weld", "load"))
        impacts = tuple(
            Impact(
                time=float(c["time"][i]), first=c["first"][i].decode(), second=c["second"][i].decode(),
                position=tuple(c["position"][i].tolist()), normal=tuple(c["normal"][i].tolist()),
                approach=float(c["approach"][i]), impulse=tuple(c["impulse"][i].tolist()),
            )
            for i in range(hits)
        )  # fmt: skip
        breaks = tuple(
            Break(time=float(when), weld=weld.decode(), load=float(load))
            for when, weld, load in zip(times, welds, loads, strict=True)
        )
    except NotAScene:
        raise
    except (OSError, KeyError, TypeError, ValueError, AttributeError, RuntimeError) as why:
        raise NotAScene(f"{path}: {why}") from None  # what h5py raises depends on where the file is broken
    return Run(
        specimen=job.specimen, fidelity=job.fidelity, seed=job.seed, scene=compiled.scene, model=model, t=t,
        qpos=qpos, qvel=qvel, stride=compiled.stride, impacts=impacts, step=compiled.step, seconds=0.0, worked=worked,
        again_with=repeater(job.specimen, job.fidelity, job.seed), breaks=breaks, cell=compiled.cell, clouds=clouds,
        pushed=pushed,
    )  # fmt: skip


def _read_cloud(get: Callable[..., Any], name: str, samples: int, frames: int) -> Cloud:
    """A piece of a continuum as it was recorded; without particles if its frames are none."""

    def read(key: str, *shape: int | None) -> Any:
        return get(f"continua/{name}/{key}", *shape)

    sums = {key: read(key, samples) for key in ("mass", "kinetic", "elastic", "dissipated", "volume")}
    sums |= {key: read(key, samples, 3) for key in ("centre", "momentum", "turning", "low", "high")}
    sums |= {key: float(read(key)) for key in _CONSTANTS}
    if not frames:
        nothing = np.zeros((0, 0, 3), np.float32)
        return Cloud(**sums, position=nothing, velocity=nothing, stretch=nothing[..., 0],
                     present=np.zeros(0, np.int64))  # fmt: skip
    position = read("position", frames, None, 3)
    count = position.shape[1]
    return Cloud(**sums, position=position, velocity=read("velocity", frames, count, 3),
                 stretch=read("stretch", frames, count), present=read("present", frames))  # fmt: skip


def verify(folder: Path) -> Report:
    """Checksums, layout, whether everything follows from the recorded state, and the laws judged anew from it.

    Laws are not judged, nor observables derived, of a continuum whose particles were not kept. NotAScene if it is no
    scene at all. No file outside the folder is opened.
    """
    folder = Path(folder)
    report = Report(folder)
    provenance, job = _read_provenance(folder)
    listed: dict[str, str] = provenance["files"]
    present = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file() and not p.is_symlink()}
    present.discard("provenance.json")
    report.problems += [f"{name}: missing" for name in sorted(set(listed) - present)]
    report.problems += [f"{name}: not in provenance.json" for name in sorted(present - set(listed))]
    for name in sorted(present & set(listed)):
        if _digest(folder / name) != listed[name]:
            report.problems.append(f"{name}: its SHA-256 is not the one in provenance.json")
    motion = next((name for name in listed if "/" not in name and name.endswith("_trajectory.json")), "")
    if motion != f"{job.folder}.json":
        report.problems.append(f"provenance.json: its job makes {job.folder}, but this is {motion or 'nothing'}")
    try:
        compiled = _compiled(folder, job)
        report.problems += _layout(folder, job, motion, compiled.samples // compiled.stride)
        run = _read_run(folder, job, compiled)
    except NotAScene as why:
        report.problems.append(str(why))
        return report
    if state_digest(run) != provenance.get("state_sha256"):
        report.problems.append("physics.h5: the recorded state is not the one that provenance.json names")
    try:
        report.problems += _consistent(run, folder / "physics.h5", particles=job.particles)
        if job.particles:
            report.problems += _moved_matter(run)
            report.verdicts = run.check()
        report.problems += _annotated(run, folder, motion, report.verdicts)
    except Exception as why:
        if not report.problems:
            raise
        report.problems.append(f"nothing more can be derived from this: {type(why).__name__}: {why}")
    return report


def _moved_matter(run: Run) -> list[str]:
    """The sums of continua against their particles, at every frame."""
    wrong = []
    for name, cloud in run.clouds.items():
        here = slice(None, None, run.stride)
        x = np.nanmean(cloud.position, axis=1, dtype=float)
        v = cloud.mass[here, None] * np.nanmean(cloud.velocity, axis=1, dtype=float)
        for key, told, found in (("centre", cloud.centre[here], x), ("momentum", cloud.momentum[here], v)):
            if not np.allclose(told, found, rtol=1e-5, atol=1e-5 * max(1e-3, float(np.abs(told).max()))):
                wrong.append(f"physics.h5: continua/{name}/{key} is not that of its particles")
    return wrong


def _consistent(run: Run, path: Path, *, particles: bool) -> list[str]:
    """Everything recorded against the recorded state: whoever edits one has to edit both."""
    wrong = []
    try:
        with h5py.File(path, "r") as file:
            for name, values, unit, _ in _recorded(run):
                if not particles and (name.rpartition("/")[2] in _PARTICLES or name.startswith("observables/")):
                    continue
                if name not in file:
                    wrong += [] if name.startswith("observables/") else [f"physics.h5: {name} is missing"]
                elif not _same(file[name], np.asarray(values)):
                    wrong.append(f"physics.h5: {name} does not follow from the recorded state")
                elif file[name].attrs.get("unit") != unit:
                    wrong.append(f"physics.h5: {name} is not in {unit}")
    except (OSError, KeyError, RuntimeError) as why:
        wrong.append(f"physics.h5: {why}")
    return wrong


def _same(entry: Any, values: NDArray[Any]) -> bool:
    if not isinstance(entry, h5py.Dataset) or entry.shape != values.shape or entry.dtype.kind != values.dtype.kind:
        return False
    if values.dtype.kind != "f":
        return bool((entry[...] == values).all())
    scale = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
    return np.allclose(entry[...], values, rtol=1e-9, atol=1e-9 * max(scale, 1e-3), equal_nan=True)


def _annotated(run: Run, folder: Path, motion: str, verdicts: Sequence[Verdict]) -> list[str]:
    """Motion file, properties and verdicts as written against those that follow from the recorded state."""
    wrong = []
    try:
        poses, expected = _poses(_read_json(folder / motion)), _poses(annotate.motion(run, run.scene.fps))
        if poses.keys() != expected.keys() or not all(
            poses[k].shape == expected[k].shape and np.allclose(poses[k], expected[k], atol=1e-7) for k in poses
        ):
            wrong.append(f"{motion}: does not follow from the recorded state")
        if _read_json(folder / "properties.json") != annotate.properties(run):
            wrong.append("properties.json: not what the scene is made of")
        now = {v.law: v.verdict for v in verdicts}
        for law in _read_json(folder / "laws.json"):
            if law["verdict"] != now.get(law["law"], law["verdict"]):
                wrong.append(f"laws.json: {law['law']}: {law['verdict']}; judged anew: {now[law['law']]}")
    except NotAScene as why:
        wrong.append(str(why))
    except (KeyError, TypeError, ValueError, AttributeError) as why:
        wrong.append(f"{motion} or laws.json: not as this package writes it: {why!r}")
    return wrong


def _poses(motion: Any) -> dict[str, Array]:
    return {
        name: np.array(
            [[*t["transform"]["location"].values(), *t["transform"]["quaternion"].values()]
             for t in actor["transform_data"]], float,
        )
        for name, actor in motion["actors"].items()
    }  # fmt: skip


def _layout(folder: Path, job: Job, motion: str, frames: int) -> list[str]:
    wrong: list[str] = []

    def count(name: str, *keys: str) -> None:
        """How many frames a JSON file speaks of."""
        try:
            found = _read_json(folder / name)
            told = functools.reduce(lambda value, key: value[key], keys, found)
            listed = len(found.get("frames", ())) if name.startswith("blender_") else frames
            if told != frames or listed != frames:
                wrong.append(f"{name}: {told} frames, {listed} of them listed; expected: {frames}")
        except NotAScene as why:
            wrong.append(str(why).removeprefix(f"{folder}/"))
        except (KeyError, TypeError, AttributeError) as why:
            wrong.append(f"{name}: not as this package writes it: {why!r}")

    needed = ["caption.txt", "laws.json", "properties.json", "scene.xml", "physics.h5"]
    names = ["static_camera_list.txt", "cameras.ply", *(f"transforms_{part}.json" for part in ("train", "val", "test"))]
    wrong += [f"{name}: missing" for name in needed + names * job.render if not (folder / name).is_file()]
    count(motion, "sequence_info", "total_frames")
    count("recorder_stats.json", "frames")
    if not job.render:
        return wrong
    cameras = [f"CineCamera_{i}" for i in range(job.views)]
    try:
        statics = (folder / "static_camera_list.txt").read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError):
        statics = []
    if statics != cameras:
        wrong.append(f"static_camera_list.txt: {len(statics)} cameras; expected: CineCamera_0 to _{job.views - 1}")
    endings = {"rgb": "jpg", "depth": "npz", "seg": "npz"}
    for view in [*cameras, "CineCamera_Moving"]:
        count(f"blender_{view}.json", "total_frames")
        for kind in job.modalities:
            expected = {f"{i:04d}.{endings[kind]}" for i in range(frames)}
            there = {p.name for p in (folder / view / kind).glob("*")}
            if expected != there:
                wrong.append(f"{view}/{kind}: {len(there & expected)} of {frames} frames")
    return wrong


def reproduce(folder: Path, *, progress: Progress | None = None) -> Report:
    """Simulate again from `provenance.json` alone and compare the states bit for bit."""
    folder = Path(folder)
    report = Report(folder)
    provenance, job = _read_provenance(folder)
    show = progress or (lambda _stage, _done: None)
    try:
        run = simulate_specimen(
            job.specimen, fidelity=job.fidelity, seed=job.seed, progress=lambda f: show("simulating", f)
        )
    except (Refusal, OverflowError) as why:
        raise NotAScene(f"{folder}/provenance.json: {why}") from None
    if state_digest(run) != provenance.get("state_sha256"):
        recorded, here = provenance.get("versions"), _versions(run)
        recorded = recorded if isinstance(recorded, dict) else {}
        other = [f"{k} {recorded.get(k)} here {v}" for k, v in here.items() if recorded.get(k) != v]
        reason = f" (made with other versions: {'; '.join(other)})" if other else ""
        report.problems.append(f"the states differ from the recorded ones{reason}")
    return report


def _read_provenance(folder: Path) -> tuple[dict[str, Any], Job]:
    path = Path(folder) / "provenance.json"
    if not path.is_file():
        raise NotAScene(f"{folder}: no provenance.json, so not a whole scene")
    found = _read_json(path)
    form = found.get("format") if isinstance(found, dict) else None
    if form != FORMAT:
        raise NotAScene(f"{path}: format = {form!r:.40}; allowed: {FORMAT}")
    told = found.get("job")
    keys = {
        "index", "parameters", "fidelity", "seed", "views", "size", "modalities", "render", "photoreal", "particles",
    }  # fmt: skip
    if not isinstance(told, dict) or not keys <= set(told) or not isinstance(found.get("files"), dict):
        raise NotAScene(f"{path}: incomplete; expected a job with {', '.join(sorted(keys))} and files")
    try:
        given = {key: told[key] for key in keys}
        given |= {"fidelity": Fidelity(**told["fidelity"]), "modalities": tuple(told["modalities"])}
        return found, Job(**given)
    except (LookupError, TypeError, ValueError, OverflowError) as why:
        raise NotAScene(f"{path}: {why}") from None


def _read_json(path: Path) -> Any:
    try:
        if not path.is_file() or path.is_symlink():
            raise NotAScene(f"{path}: missing")
        if path.stat().st_size > _MAX_JSON:
            raise NotAScene(f"{path}: {path.stat().st_size} bytes; allowed: {_MAX_JSON}")
        return json.loads(path.read_text(encoding="utf-8"))
    except NotAScene:
        raise
    except (OSError, ValueError, RecursionError) as why:
        raise NotAScene(f"{path}: {why}") from None


def _json(path: Path, value: Any, indent: int | None = 1) -> None:
    path.write_text(json.dumps(value, indent=indent, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _versions(run: Run) -> dict[str, str]:
    """Of what made a run: by name, and of its matter, if there is any, what computed that and on what."""
    of_matter = {}
    if run.clouds:
        from mpm_sidecar._ti import version

        of_matter["matter"] = version()
    return {
        "python": platform.python_version(), "machine": platform.machine(), "system": platform.system(),
        **{name: importlib.metadata.version(name) for name in _PACKAGES}, **of_matter,
    }  # fmt: skip
