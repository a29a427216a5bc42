"""Only what a scene requires: for every phenomenon, in every variant, nothing is on that it does not need, and with
everything on it moves just as it does."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj.base import Choice, Phenomenon, Refusal
from physinone_mj.cost import EVERYTHING, economies, wasted
from physinone_mj.fidelity import DRAFT, STANDARD, Fidelity
from physinone_mj.registry import Entry, entries, phenomenon
from physinone_mj.scene import Scene
from physinone_mj.simulate import OURS, Compiled, Engine, Stepper, build, compile
from render import film, raster
from render.rig import fit_distance, orbit

from .render.sets import pendulum

HOME = Path(__file__).resolve().parents[1]
COARSE = Fidelity("coarse", 16, 8, 1)
DISABLE = mujoco.mjtDisableBit
MATTER = range(67, 72)
BODIES = [entry for entry in entries() if entry.index not in MATTER]


def numbered(entries_: Any) -> Any:
    return pytest.mark.parametrize("entry", entries_, ids=lambda entry: f"{entry.index}")


def ready(specimen: Phenomenon, engine: Engine = OURS) -> Compiled:
    """Compiled at the coarsest setting that resolves it."""
    for fidelity in (COARSE, DRAFT):
        try:
            return compile(specimen, build(specimen), fidelity, engine)
        except Refusal:
            continue
    return compile(specimen, build(specimen), STANDARD, engine)


def variants(cls: type[Phenomenon]) -> Iterator[Compiled]:
    """The nominal specimen, and one for every other word of every choice, if that goes with the rest."""
    nominal = cls.make()
    yield ready(nominal)
    for name, (param, _) in cls.declarations().items():
        for word in param.words if isinstance(param, Choice) else ():
            if word != getattr(nominal, name):
                try:
                    yield ready(nominal.altered(**{name: word}))
                except Refusal:
                    continue


def content(scene: Scene, model: Any) -> dict[str, bool]:
    """What the scene needs, from what is in it."""
    touching = bool(scene.touching or scene.bowls)
    joined = scene.motors or scene.cuts or list(scene.spec.equalities)
    limited = model.jnt_limited.any() or model.tendon_limited.any() or model.dof_frictionloss.any()
    held = bool(touching or joined or limited)
    return {
        "contact": touching, "constraints": held, "solver": held, "callback": bool(scene.effects or scene.continua),
        "sensors": False, "matter": bool(scene.continua),
    }  # fmt: skip


def active(stepper: Stepper) -> dict[str, bool]:
    """What is on in a scene that is under way."""
    flags = stepper.model.opt.disableflags
    return {
        "contact": not flags & DISABLE.mjDSBL_CONTACT, "constraints": not flags & DISABLE.mjDSBL_CONSTRAINT,
        "solver": stepper._solver is not None, "callback": mujoco.get_mjcb_passive() is not None,
        "sensors": bool(stepper.model.nsensor) and not flags & DISABLE.mjDSBL_SENSOR, "matter": bool(stepper.media),
    }  # fmt: skip


def amiss(stepper: Stepper) -> list[str]:
    """What is on without need, or off in spite of it."""
    on, needed = active(stepper), content(stepper.compiled.scene, stepper.model)
    return [name for name in needed if on[name] != needed[name]]


def unread(compiled: Compiled) -> list[str]:
    """Sensors of the model that nothing in its phenomenon's file reads."""
    model, source = compiled.model, inspect.getsource(sys.modules[type(compiled.specimen).__module__])
    sensors = (model.sensor(i).name for i in range(model.nsensor))
    return [name for name in sensors if f'.sensor("{name}")' not in source]


@numbered(entries())
def test_what_is_on_follows_from_what_is_there(entry: Entry) -> None:
    for compiled in variants(phenomenon(entry.index)):
        what = str(compiled.specimen.values())
        assert unread(compiled) == [], what
        assert bool(compiled.scene.continua) == (entry.index in MATTER)
        if entry.index in MATTER:
            continue  # begun below, in small: particles take their time
        with Stepper(compiled) as stepper:
            assert amiss(stepper) == [], what
            assert wasted(economies(stepper)) == [], what
        assert mujoco.get_mjcb_passive() is None


def test_what_is_on_without_need_is_seen() -> None:
    with Stepper(ready(phenomenon(46).make(), EVERYTHING)) as stepper:
        assert amiss(stepper) == ["contact", "constraints", "callback", "sensors"]
        assert len(wasted(economies(stepper))) == 4


@pytest.mark.parametrize(("flag", "what"), [("CONTACT", "contact"), ("CONSTRAINT", "constraints")])
def test_what_is_off_in_spite_of_need_is_seen(flag: str, what: str) -> None:
    with Stepper(ready(phenomenon(1).make())) as stepper:
        stepper.model.opt.disableflags |= getattr(DISABLE, f"mjDSBL_{flag}")
        assert amiss(stepper) == [what]
        assert len(wasted(economies(stepper))) == 1


def test_what_nobody_reads_is_seen() -> None:
    specimen = phenomenon(1).make()
    scene = build(specimen)
    scene.add("pendulum", "useless")
    assert unread(compile(specimen, scene, DRAFT)) == ["useless/tension"]


WATCH = """
import importlib, json, sys

import mujoco, numba, numpy, scipy.linalg

def tell(index):
    packages = {{name.partition(".")[0] for name in sys.modules}} - {{*sys.stdlib_module_names}}
    packages = sorted(name for name in packages if not name.startswith("_"))  # parts of extension modules
    with open("/proc/self/maps") as maps:
        libraries = sorted({{line.split("/")[-1].strip() for line in maps if "/" in line}})
    print(json.dumps([index, packages, libraries]), flush=True)

tell(0)

from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.registry import phenomenon
{waste}
simulate = importlib.import_module("physinone_mj.simulate")
build = simulate.build

def brief(specimen):
    scene = build(specimen)
    scene.duration = min(scene.duration, 0.1)
    return scene

simulate.build = brief
for index in {indices}:
    specimen = phenomenon(index).make()
    try:
        run = simulate.simulate_specimen(specimen, fidelity=Fidelity("coarse", 16, 8, 1))
    except Refusal:
        run = simulate.simulate_specimen(specimen, fidelity=DRAFT)
    run.motion
    tell(index)
"""
OWN = {"physinone_mj", "phenomena", "mjcf_templates"}
BREAKING = {24, 25, 50}
GRAPHICS = ("libEGL", "libGL", "libOSMesa", "libgallium", "swrast", "libX11")


def loaded(indices: list[int], waste: str = "") -> dict[int, set[str]]:
    """What a process that simulates one phenomenon after the other has loaded, after each: packages that are neither
    ours nor come with mujoco, numba, numpy and scipy, and libraries that draw."""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-c", WATCH.format(indices=indices, waste=waste)],
        cwd=HOME, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    foundation = {*rows[0][1], *OWN}
    return {index: {*packages} - foundation | {library for library in libraries if library.startswith(GRAPHICS)}
            for index, packages, libraries in rows[1:]}  # fmt: skip


def test_nothing_is_loaded_that_bodies_do_not_need() -> None:
    indices = sorted((entry.index for entry in BODIES), key=lambda index: (index in BREAKING, index))
    seen = loaded(indices)
    assert list(seen) == indices
    for index, more in seen.items():
        assert more == ({"manifold3d"} if index in BREAKING else set()), index


def test_nothing_is_loaded_that_matter_does_not_need() -> None:
    seen = loaded([*MATTER])
    assert list(seen) == [*MATTER]
    for index, more in seen.items():
        assert "taichi" in more, index
        # libX11 is Taichi's own, and trimesh loads manifold3d
        drawn = {name for name in more if name.startswith(GRAPHICS)} - {n for n in more if n.startswith("libX11")}
        assert not drawn | more & {"render", "cv2", "h5py", "mitsuba"}, index


def test_what_is_loaded_without_need_is_seen() -> None:
    modules = ("cv2", "h5py", "render.film", "mpm_sidecar.medium", "OpenGL.EGL")
    waste = f"import os; os.environ['PYOPENGL_PLATFORM'] = 'egl'; import {', '.join(modules)}"
    more = loaded([46], waste)[46]
    assert {*(module.partition(".")[0] for module in modules), "taichi"} <= more
    assert any(name.startswith(GRAPHICS) for name in more)


SAMPLES, AFTER = 240, 60
"""Recorded samples that are compared: a second, or, of those that come to rest later, some more after they have."""
SLEEPERS = {2, 10, 12, 18, 20, 21, 24, 25, 41, 42, 48, 49, 50}
STOPPED = 1e-6
"""What falls asleep is slower than `contact.STILL`, 1e-8 m/s, and is stopped: by less than this in any coordinate."""
CROWDS = {24, 25, 49}
"""There it is slower than 1e-4 m/s. When that is, if it is before the scene ends, depends on the last digit of all that
was before, and so on the machine."""
LIVELY = {20, *CROWDS}
"""Where others slide and collide meanwhile, whose contact problem has then fewer rows: its solution is known to 1e-5
m/s, to 1e-2 in a crowd, and they go another way; so does a box (2) at which a ball pushes time and again, where an
impact comes or does not. Elsewhere it is the same one to `STOPPED`, of nominal specimens to ten times less."""


def motion(specimen: Phenomenon, engine: Engine, samples: int | None) -> tuple[np.ndarray[Any, Any], int]:
    """The recorded state (samples, nq + nv), and in which sample something first falls asleep; samples, if in none.

    Without a number: until AFTER more than that, and SAMPLES at least.
    """
    compiled = ready(specimen, engine)
    states, first = [], compiled.samples
    with Stepper(compiled) as stepper:
        for sample in range(compiled.samples - 1):
            if sample == (max(SAMPLES, first + AFTER) if samples is None else samples):
                break
            stepper.advance()
            states.append(np.concatenate([stepper.data.qpos, stepper.data.qvel]))
            if stepper._solver is not None and len(stepper._solver._asleep):
                first = min(first, sample)
    return np.array(states), min(first, len(states))


@numbered(BODIES)
def test_with_everything_on_it_moves_just_as_it_does(entry: Entry) -> None:
    sleeps, crowd = entry.index in SLEEPERS, entry.index in CROWDS
    plain, asleep = motion(phenomenon(entry.index).make(), OURS, None if sleeps else SAMPLES)
    assert (asleep < len(plain)) == sleeps or crowd
    same(phenomenon(entry.index).make(), plain, asleep, None if entry.index in LIVELY else STOPPED / 10)


@pytest.mark.slow
@numbered(BODIES)
def test_with_everything_on_it_moves_so_to_the_end(entry: Entry) -> None:
    """In every variant."""
    for compiled in variants(phenomenon(entry.index)):
        lively = entry.index in LIVELY or compiled.specimen.values().get("target") == "box"
        plain, asleep = motion(compiled.specimen, OURS, compiled.samples)
        same(compiled.specimen, plain, asleep, None if lively else STOPPED)


def same(specimen: Phenomenon, plain: np.ndarray[Any, Any], asleep: int, bound: float | None) -> None:
    """That it moves alike with everything on: to the bit until something falls asleep, then to a bound, if any."""
    everything, awake = motion(specimen, EVERYTHING, len(plain))
    assert awake == len(everything) == len(plain), "nothing sleeps with everything on"
    assert plain[:asleep].tobytes() == everything[:asleep].tobytes()
    if asleep < len(plain):
        off = np.abs(plain - everything).max(axis=1)
        assert 0 < off[asleep] <= (100 if specimen.index in CROWDS else 1) * STOPPED
        assert bound is None or off.max() <= bound


@pytest.mark.parametrize("index", MATTER)
def test_matter_passes_over_what_is_empty_and_moves_just_as_it_does(index: int) -> None:
    moved = []
    for engine in (OURS, EVERYTHING):
        compiled = compile(specimen := phenomenon(index).make(), build(specimen), DRAFT, engine)
        with Stepper(compiled) as stepper:
            for _ in range(4):
                stepper.advance()
            (medium,) = stepper.media
            advanced, there = len(medium.solver._active), np.prod(medium.solver._shape // 4)
            moved.append([array.tobytes() for piece in medium.particles() for array in piece])
            if engine is OURS:
                assert amiss(stepper) == wasted(economies(stepper)) == []
                assert advanced < there / 2
            else:
                assert advanced == there
                assert "blocks of the grid that no particle can touch" in "".join(wasted(economies(stepper)))
    assert moved[0] == moved[1]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """What is drawn and written from now on."""
    calls: Counter[str] = Counter()

    def note(owner: Any, name: str) -> None:
        plain = getattr(owner, name)

        def noted(*arguments: Any, **options: Any) -> Any:
            calls[name] += 1
            return plain(*arguments, **options)

        monkeypatch.setattr(owner, name, noted)

    for name in ("_render", "_buffers", "without_images", "depth_and_segmentation"):
        note(raster.Raster, name)
    for name in ("write_rgb", "write_depth", "write_segmentation"):
        note(film, name)
    return calls


@pytest.mark.parametrize(
    ("wanted", "passes"),
    [
        ("rgb", {"_buffers": 1, "without_images": 6, "write_rgb": 6}),
        ("depth", {"_buffers": 1, "depth_and_segmentation": 6, "write_depth": 6}),
        ("seg", {"_buffers": 1, "depth_and_segmentation": 6, "write_segmentation": 6}),
        ("depth seg", {"_buffers": 1, "depth_and_segmentation": 6, "write_depth": 6, "write_segmentation": 6}),
    ],
)
def test_no_pass_is_drawn_and_no_buffer_made_for_what_nobody_asked_for(
    wanted: str, passes: dict[str, int], drawn: Counter[str], tmp_path: Path
) -> None:
    footage = pendulum(frames=3, modalities=frozenset(wanted.split()))
    far = fit_distance(footage.sphere.radius)
    views = tuple(film.View(f"CineCamera_{i}", orbit(footage.sphere, 0.5 + i, 0.6, far)) for i in range(2))
    for view, kind in itertools.product(views, footage.modalities):
        (tmp_path / view.name / kind).mkdir(parents=True)
    shots = list(itertools.product(range(2), range(3)))
    film._draw(dataclasses.replace(footage, views=views), range(3), shots, tmp_path, False, lambda _count: None)
    assert drawn == {"_render": 6} | passes
