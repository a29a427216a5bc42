"""Where the time of a scene goes, what was left out of it because nothing in it needs that, and what all of it costs.

Clocked is what `physinone run` does, as it stands: while a `Ledger` is open, functions that do the work are replaced by
themselves with a clock around. A call's clock stands still while another clocked one runs within it: no time counts
twice, and what no clock was told of is left as "else". Times are the processor's, after compilers have done their work.

Pictures are drawn in this process, some frames of one standing camera and of the moving one, which stand for all.

"Everything on" advances the same scene with MuJoCo's contact and constraint stages, sensors and the force callback on
whatever is there, with nothing put to sleep, and over all blocks of a continuum's grid. The recorded state is the same,
bit for bit, until something falls asleep: that is then stopped from less than `contact.STILL`, 1e-8 m/s (in a heap of
more than 32 contacts 1e-4). What slides and collides meanwhile has a contact problem of fewer rows, whose solution is
known to 1e-5 m/s (in such a heap 1e-2): where it is chaotic it goes another way.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import os
import statistics
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

import mujoco
import numpy as np
import trimesh

from . import annotate, contact, dataset, optics, run
from .base import Phenomenon, Refusal
from .dataset import Job
from .fidelity import DRAFT, Fidelity
from .run import Run
from .scene import Mirror, Scene
from .simulate import OURS, Compiled, Engine, Film, Stepper, UnstableScene, build, compile, simulate_specimen
from .trade import calibrate

Record: TypeAlias = dict[str, Any]
"""What came of one scene, as JSON values: see `measure`."""
Stage: TypeAlias = str | Callable[..., str]
"""What a call's time is charged to, or a function of the call's arguments that says so."""
Progress: TypeAlias = Callable[[str, float], None]

EVERYTHING: Final = Engine("everything on", frugal=False)
TURNS: Final = 3
FRAMES: Final = 8
"""Frames drawn of each of two cameras: from so many on, standing ones draw what never moves once."""

ELSE: Final = "else"
TWINS: Final = "the laws' other runs"
_SMOOTH, _HOLDING, _EFFECTS, _SLEEPING = "smooth motion", "constraints", "effects", "sleeping"
_OBSTACLES, _SORTING, _GRID = "matter: obstacles", "matter: sorting", "matter: particles and grid"
_RECORDING, _REPLAY, _RAYS, _LAWS, _ANNOTATION = "recording", "replay", "rays of light", "laws", "annotation"
_OPENING, _POSING, _SURFACES = "opening OpenGL", "posing", "surfaces of matter"
_STILL, _COLOUR, _IMAGES = "drawing what stands still", "drawing colour", "drawing what mirrors show"
_DEPTH, _WRITING, _SUMS = "drawing depth and segmentation", "writing", "checksums"
_PICTURES: Final = " of pictures"
_ENCODING: Final = {"write_rgb": "encoding colour", "write_depth": "encoding depth",
                    "write_segmentation": "encoding segmentation"}  # fmt: skip
RESTING: Final = "what has come to rest"
ORDER: Final = (
    "building the scene", "compiling it", "starting", _SMOOTH, "looking for contact", "impacts",
    "sliding and resting contact", _HOLDING, _EFFECTS, _OBSTACLES, _SORTING, _GRID, _SLEEPING, "between the pieces",
    _RECORDING, _REPLAY, _RAYS, _LAWS, TWINS, "observables", _ANNOTATION, "caption", "encoding physics.h5",
    "placing cameras", _OPENING, _POSING, _SURFACES, _STILL, _COLOUR, _IMAGES, _DEPTH, *_ENCODING.values(), _WRITING,
    _WRITING + _PICTURES, _SUMS, _SUMS + _PICTURES, "provenance", ELSE,
)  # fmt: skip
"""The stages there can be, as a scene goes through them."""

_OF_EACH_PICTURE: Final = (_POSING, _SURFACES, _COLOUR, _IMAGES, _DEPTH, *_ENCODING.values(), _WRITING + _PICTURES)
_TRIALS: Final = 200
_DISABLE = mujoco.mjtDisableBit


class Ledger:
    """Processor time by stage, as long as it is open.

    toll: what a clocked call adds to its caller's time and to its own [s], which is taken off again
    spent: seconds by stage, each times the stage's weight of that moment; calls: how often each was begun
    weights: for how many of a scene's one clocked call stands; 1 unless given
    total: seconds of everything, without weights
    """

    def __init__(self, toll: tuple[float, float] = (0.0, 0.0), clock: Callable[[], float] = time.process_time) -> None:
        self.spent: defaultdict[str, float] = defaultdict(float)
        self.calls: Counter[str] = Counter()
        self.weights: dict[str, float] = {}
        self.total = 0.0
        self._clock, (self._around, self._within) = clock, toll
        self._stages, self._whole, self._since = [ELSE], False, 0.0
        self._undo = contextlib.ExitStack()

    def __enter__(self) -> Self:
        self._since = self._clock()
        return self

    def __exit__(self, *_: object) -> None:
        self._charge(0.0)
        self._undo.close()

    def _charge(self, toll: float) -> None:
        now, stage = self._clock(), self._stages[-1]
        seconds = now - self._since - toll
        self.spent[stage] += seconds * self.weights.get(stage, 1.0)
        self.total += seconds
        self._since = now

    def clocked(self, work: Callable[..., Any], stage: Stage, *, whole: bool = False) -> Callable[..., Any]:
        """The same function with a clock around; whole: all that it calls counts as its own."""

        @functools.wraps(work)
        def call(*arguments: Any, **options: Any) -> Any:
            if self._whole:
                return work(*arguments, **options)
            name = stage if isinstance(stage, str) else stage(*arguments, **options)
            self._charge(self._around)
            self._stages.append(name)
            self.calls[name] += 1
            self._whole = whole
            try:
                return work(*arguments, **options)
            finally:
                self._charge(self._within)
                self._stages.pop()
                self._whole = False

        return call

    def watch(self, owner: Any, name: str, stage: Stage, *, whole: bool = False) -> None:
        """Put a clock around a function of a module or a method of a class, until the ledger is closed."""
        self.replace(owner, name, self.clocked(getattr(owner, name), stage, whole=whole))

    def replace(self, owner: Any, name: str, other: Any) -> None:
        """Let a name mean something else until the ledger is closed."""
        if name in vars(owner):
            self._undo.callback(setattr, owner, name, vars(owner)[name])
        else:  # inherited
            self._undo.callback(delattr, owner, name)
        setattr(owner, name, other)


@functools.cache
def toll(clock: Callable[[], float] = time.process_time) -> tuple[float, float]:
    """That of a `Ledger` on this machine: the least of many, as nothing but disturbances adds to it."""
    found = []
    for _ in range(_TRIALS):
        with Ledger(clock=clock) as ledger:
            nothing = ledger.clocked(lambda: None, "within")
            for _ in range(_TRIALS):
                nothing()
        found.append((ledger.spent[ELSE] / _TRIALS, ledger.spent["within"] / _TRIALS))
    return min(found)


@dataclass(frozen=True)
class Economy:
    """What can be left out of a scene: whether it is on, whether the scene needs it, and why or why not."""

    what: str
    on: bool
    needed: bool
    why: str


def economies(stepper: Stepper) -> list[Economy]:
    """What a scene that is under way uses, read from its flags and buffers, beside what is in the scene."""
    compiled, model, scene, solver = stepper.compiled, stepper.model, stepper.compiled.scene, stepper._solver
    flags, pairs = model.opt.disableflags, len(compiled.pairs) + len(compiled.joined.cups)
    holds = {
        "contact": pairs, "motors": len(scene.motors), "joints that close loops, or welds": model.neq,
        "limits": model.jnt_limited.any() or model.tendon_limited.any() or len(scene.cuts),
        "friction in joints": model.dof_frictionloss.any(),
    }  # fmt: skip
    held = ", ".join(name for name, there in holds.items() if there)
    pushing = ", ".join([type(effect).__name__ for effect in scene.effects] + ["matter"] * len(scene.continua))
    idle = "nothing is held, limited or driven"
    found = [
        Economy("MuJoCo's contact stage", not flags & _DISABLE.mjDSBL_CONTACT, pairs > 0,
                f"{pairs} pairs of surfaces" if pairs else "nothing can touch"),
        Economy("MuJoCo's constraint stage", not flags & _DISABLE.mjDSBL_CONSTRAINT, bool(held), held or idle),
        Economy("solver of contacts and constraints", solver is not None, bool(held), held or idle),
        Economy("force callback", mujoco.get_mjcb_passive() is not None, bool(pushing),
                pushing or "nothing pushes that MuJoCo does not know"),
        Economy("sensors at every step", model.nsensordata > 0 and not flags & _DISABLE.mjDSBL_SENSOR, False,
                "they are read from what was recorded" if model.nsensordata else "there are none"),
        Economy("Taichi, particles and a grid", bool(stepper.media), bool(scene.continua),
                f"{len(scene.continua)} continua" if scene.continua else "no matter deforms"),
    ]  # fmt: skip
    for medium in stepper.media:
        grid = medium.solver
        advanced, there = len(grid._active), int(np.prod(grid._shape // 4))
        found.append(Economy("blocks of the grid that no particle can touch", 0 < there == advanced, False,
                             f"{there - advanced} of {there}"))  # fmt: skip
    if solver is not None and len(solver._asleep):
        asleep, free = len(solver._asleep) // 6, len(solver._free_body)
        found.append(Economy(RESTING, False, False, f"{asleep} of {free} bodies sleep at the end"))
    return found


def wasted(found: Sequence[Economy]) -> list[str]:
    """What is on though nothing needs it, or off though something does; a line each."""
    return [f"{e.what}: {'on' if e.on else 'off'}; {e.why}" for e in found if e.on != e.needed]


def measure(job: Job, *, turns: int = TURNS, progress: Progress | None = None) -> Record:
    """What making one scene costs, stage by stage; what was left out; what the same motion costs with everything on.

    turns: how often the scene is advanced either way, one after the other, for their ratio; 0: not at all
    Raises what `dataset.generate` raises.
    """
    tell = progress or (lambda _stage, _done: None)
    specimen, share = job.specimen, 1 / (1 + turns)
    if job.render:
        importlib.import_module("render.film")  # what is imported once is not what a scene costs
    _warm(specimen, job.fidelity)
    before = calibrate()
    compiled = compile(specimen, build(specimen), job.fidelity)
    with tempfile.TemporaryDirectory() as folder, Ledger(toll()) as ledger:
        found = _watch(ledger, job, compiled)
        if job.render:
            _watch_pictures(ledger)
        dataset._write(job, Path(folder), lambda stage, done: tell(stage, share * done))
    unit = (before + calibrate()) / 2
    found += _of_pictures(ledger, job, compiled.scene)
    simulated, frames = (compiled.samples - 1) * compiled.steps * compiled.step, compiled.samples // compiled.stride
    total = sum(ledger.spent.values())
    record: Record = {
        "index": job.index, "label": specimen.label, "values": specimen.values(), "fidelity": job.fidelity.record(),
        "simulated": simulated, "unit": unit, "seconds": total, "clocked": ledger.total,
        "pictures": {"size": job.size, "drawn": 2 * min(FRAMES, frames), "stand_for": frames * (job.views + 1)}
        if job.render else None,
        "stages": [
            {"stage": stage, "calls": ledger.calls[stage], "seconds": ledger.spent[stage],
             "share": ledger.spent[stage] / total, "cost": ledger.spent[stage] / simulated / unit}
            for stage in ORDER if ledger.calls[stage] or stage == ELSE
        ],
        "left_out": [{"what": economy.what, "why": economy.why} for economy in found if not economy.on],
        "problems": wasted(found),
    }  # fmt: skip
    if turns:
        both = compare(specimen, job.fidelity, turns=turns, seed=job.seed,
                       progress=lambda done: tell("with everything on", share + (1 - share) * done))  # fmt: skip
        record["everything_on"] = both
        if both["apart"] and not any(economy.what == RESTING for economy in found):
            record["problems"].append(f"with everything on, another state is recorded, off by {both['apart']}")
    return record


def _warm(specimen: Phenomenon, fidelity: Fidelity) -> None:
    """Let compilers do their work: all of a rigid scene in coarse, or the first sample of one with matter."""
    with contextlib.suppress(Refusal, UnstableScene):
        coarse = min(fidelity, DRAFT, key=lambda f: f.steps)
        compiled = compile(specimen, build(specimen), fidelity if build(specimen).continua else coarse)
        with Stepper(compiled) as stepper:
            for _ in range(1 if compiled.scene.continua else compiled.samples - 1):
                stepper.advance()


def compare(
    specimen: Phenomenon, fidelity: Fidelity, *, turns: int = TURNS, seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Record:  # fmt: skip
    """A scene as it is and with everything on, taking turns: processor seconds of each, median; median of the ratios;
    by how much the recorded states are apart, quantity by quantity, at most, if they are."""
    seconds: dict[str, list[float]] = {OURS.name: [], EVERYTHING.name: []}
    runs: dict[str, Run] = {}
    for turn in range(turns):
        for engine in (OURS, EVERYTHING)[:: 1 if turn % 2 else -1]:
            begun = time.process_time()
            runs[engine.name] = simulate_specimen(specimen, fidelity=fidelity, seed=seed, engine=engine)
            seconds[engine.name].append(time.process_time() - begun)
        if progress:
            progress((turn + 1) / turns)
    ours, everything = seconds.values()
    return {
        "turns": turns, "seconds": statistics.median(ours), "with_everything": statistics.median(everything),
        "ratio": statistics.median(b / a for a, b in zip(ours, everything, strict=True)),
        "apart": apart(*runs.values()),
    }  # fmt: skip


def apart(first: Run, second: Run) -> dict[str, float]:
    """By how much two runs of one scene differ in each recorded quantity at most [SI]; nothing if in no bit.

    The times, MuJoCo's positions and velocities, the sums of matter, and what matter gave to bodies.
    """
    if dataset.state_digest(first) == dataset.state_digest(second):
        return {}
    both = [
        {"t": r.t, "qpos": r.qpos, "qvel": r.qvel}
        | {f"{name}/{key}": getattr(cloud, key) for name, cloud in r.clouds.items() for key in dataset._SUMS}
        | {f"pushed {name}": given for name, given in r.pushed.items()}
        for r in (first, second)
    ]
    most = {name: float(np.abs(both[0][name] - both[1][name]).max(initial=0.0)) for name in both[0]}
    return {name: value for name, value in most.items() if value > 0}


def _watch(ledger: Ledger, job: Job, compiled: Compiled) -> list[Economy]:
    """Put clocks around all that is done for a scene but its pictures; the list is filled when its motion is over."""
    touching = compiled.pairs or compiled.joined.cups
    looking, holding = ("looking for contact", "sliding and resting contact") if touching else (_HOLDING, _HOLDING)
    # `from . import simulate` gives the function of that name
    simulate, solver = importlib.import_module("physinone_mj.simulate"), contact.Solver
    stages: list[tuple[Any, str, Stage]] = [
        (simulate, "build", "building the scene"), (simulate, "compile", "compiling it"),
        (Stepper, "__init__", "starting"), (Stepper, "advance", _SMOOTH), (Stepper, "_step", "between the pieces"),
        (Stepper, "_forward", _SMOOTH), (Stepper, "_push", _EFFECTS), (Stepper, "inspect", _RECORDING),
        (solver, "begin", looking), (solver, "place", looking), (solver, "look", looking), (solver, "fly", _SMOOTH),
        (solver, "impact", "impacts"), (solver, "slide", holding), (solver, "swing", _HOLDING),
        (solver, "rest", _SLEEPING), (solver, "wake", _SLEEPING),
        (Film, "take", _RECORDING), (dataset, "simulate_specimen", _RECORDING),
        (Run, "check", _LAWS), (type(job.specimen), "caption", "caption"),
        (dataset, "write_physics", "encoding physics.h5"), (dataset, "_versions", "provenance"),
        *((annotate, name, _ANNOTATION) for name in
          ("properties", "motion", "mesh", "geom_ids", "particles", "camera_file", "split_files", "frustums")),
        (dataset, "viewable", _ANNOTATION), (trimesh.Trimesh, "export", _ANNOTATION),
        (dataset, "_json", _WRITING), (Path, "write_text", _WRITING),
        (Path, "write_bytes", lambda path, _: _WRITING + _PICTURES * (path.suffix == ".jpg")),
        (dataset, "_digest", lambda path: _SUMS + _PICTURES * (path.parent.name in dataset.MODALITIES)),
    ]  # fmt: skip
    if compiled.scene.continua:
        from mpm_sidecar import collide, medium, transfer

        stages += [
            (medium.Medium, "__init__", "starting"), (medium.Medium, "advance", _GRID),
            (medium.Medium, "_place", _OBSTACLES), (collide.Bearer, "meet", _OBSTACLES),
            (collide.Bearer, "move", _OBSTACLES), (transfer.Solver, "_sort", _SORTING),
        ]  # fmt: skip
    for owner, name, stage in stages:
        ledger.watch(owner, name, stage)
    ledger.watch(Run, "again", TWINS, whole=True)
    # it computes what it yields; all of it at once, so that this is told from its encoding
    recorded = dataset._recorded
    ledger.replace(dataset, "_recorded", ledger.clocked(lambda of: list(recorded(of)), "observables"))

    found: list[Economy] = []
    own: list[Any] = []
    leave = Stepper.__exit__

    def left(stepper: Stepper, *problem: object) -> None:
        if not own:  # the scene's own; all that come later are its laws'
            own.append(stepper.model)
            found.extend(economies(stepper))
        leave(stepper, *problem)

    ledger.replace(Stepper, "__exit__", left)
    ledger.watch(run, "replay", lambda model, *_: _REPLAY if model is own[0] else TWINS)
    ledger.watch(optics, "follow", lambda model, *_: _RAYS if model is own[0] else TWINS)
    return found


def _watch_pictures(ledger: Ledger) -> None:
    """Put clocks around all that is done for pictures, and let few of them, drawn in this process, stand for all."""
    from render import film, raster, surface

    os.environ.setdefault("LP_NUM_THREADS", "1")  # as drawing processes have it, one for each core
    shoot, opened = film.shoot, film.Footage.raster
    stages: list[tuple[Any, str, Stage]] = [
        (dataset, "_film", "placing cameras"), (raster.Raster, "close", _OPENING), (film.Footage, "put", _POSING),
        (raster.Raster, "window", _POSING), (surface.Particles, "_layers", _SURFACES),
        (raster.Raster, "without_images", lambda it, *_: _COLOUR if it._only is None else _STILL),
        (raster.Raster, "depth_and_segmentation", lambda it, *_: _DEPTH if it._only is None else _STILL),
        (raster.Raster, "put_images", lambda it, *_: _IMAGES if it._faces else _COLOUR),
        *((film, name, stage) for name, stage in _ENCODING.items()),
    ]  # fmt: skip
    for owner, name, stage in stages:
        ledger.watch(owner, name, stage)
    for name in ("swept_sphere", "plan_views"):
        ledger.watch(film, name, "placing cameras", whole=True)

    def rehearsed(footage: Any, size: tuple[int, int], **quality: int) -> Any:
        it = opened(footage, size, **quality)
        if footage.views:
            # the driver compiles for the first picture, and would not for all the others that it is to stand for
            footage.put(it, 0)
            first = raster.Still(it, footage.views[0].at(0))
            first.colour()
            first.depth_and_segmentation()
            for piece in footage.matter:
                piece._kept.clear()
        return it

    @contextlib.contextmanager
    def at_once() -> Iterator[Callable[..., None]]:
        yield lambda write, *arguments: write(*arguments)

    def few(footage: Any, folder: Path, **_: object) -> Any:
        total, shots = len(footage.qpos), film._sample(len(footage.qpos), FRAMES)
        standing = tuple(view for view in footage.views if view.poses.ndim == 2)
        moving = tuple(view for view in footage.views if view.poses.ndim == 3)
        for views in (standing, moving):
            ledger.weights = dict.fromkeys(_OF_EACH_PICTURE, total * len(views) / len(shots))
            if footage.matter:  # whose surfaces are made once for all views of a frame
                ledger.weights |= dict.fromkeys((_POSING, _SURFACES), total / len(shots) / 2)
            ledger.weights[_STILL] = len(views)
            info = shoot(dataclasses.replace(footage, views=views[:1]).part(shots), folder, workers=1)
        ledger.weights = {_SUMS + _PICTURES: total * len(footage.views) / (2 * len(shots))}
        return info

    ledger.replace(film, "_run", lambda tasks, _progress: [task(lambda _count: None) for task in tasks])
    ledger.replace(film, "_encoder", at_once)
    ledger.replace(film.Footage, "raster", ledger.clocked(rehearsed, _OPENING, whole=True))
    ledger.replace(film, "shoot", ledger.clocked(few, ELSE))


def _of_pictures(ledger: Ledger, job: Job, scene: Scene) -> list[Economy]:
    """What was done for light and pictures, by what was called, beside what is in the scene."""
    flat = any(isinstance(mirror, Mirror) and mirror.point is not None for mirror in scene.mirrors)
    found = [
        Economy("following rays of light", ledger.calls[_RAYS] > 0, bool(scene.beams),
                f"{len(scene.beams)} beams" if scene.beams else "there is no beam"),
        Economy("OpenGL", ledger.calls[_OPENING] > 0, job.render, "pictures" if job.render else "no pictures"),
    ]  # fmt: skip
    if job.render:
        found += [
            Economy("a second picture, of what mirrors show", ledger.calls[_IMAGES] > 0, flat,
                    "flat mirrors" if flat else "there is no flat mirror"),
            Economy("surfaces and grains", ledger.calls[_SURFACES] > 0, bool(scene.continua),
                    "matter" if scene.continua else "no matter deforms"),
        ]  # fmt: skip
    if ledger.calls[_STILL]:
        found.append(Economy("what never moves, in all but the first picture of a standing camera", False, False,
                             "it stays as it was drawn"))  # fmt: skip
    return found
