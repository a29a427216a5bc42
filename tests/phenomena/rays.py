"""What the tests of light share: tracers that lie, and whether things stand in each other's way."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj import optics
from physinone_mj.base import Phenomenon, Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.scene import IMMATERIAL
from physinone_mj.simulate import build, compile, simulate_specimen

from .verdicts import failed


def untraced(run: Run) -> Run:
    """The same run, without what was traced before."""
    return dataclasses.replace(run, _repeats={})


def pretend(monkeypatch: pytest.MonkeyPatch, lie: Callable[[Rays], Rays]) -> None:
    """From now on beams are what a lie makes of them."""
    true = optics.trace
    monkeypatch.setattr(optics, "trace", lambda run, name: lie(true(run, name)))


def at_samples(rays: Rays, samples: Any) -> Rays:
    """The beam as it was at other samples: an array of their numbers (T,)."""
    return Rays(rays.points[samples], rays.geoms[samples], rays.weights[samples], rays.truncated[samples])


def frozen(rays: Rays) -> Rays:
    """The beam of the first sample, for ever."""
    return at_samples(rays, np.zeros(len(rays.points), int))


def late(rays: Rays, by: int = 8) -> Rays:
    """The beam as it was some samples (a video frame is eight) before."""
    return at_samples(rays, np.maximum(np.arange(len(rays.points)) - by, 0))


def everything_reflects(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on whatever rays meet is a mirror."""
    monkeypatch.setattr(Optics, "_mirror", lambda _self, _data, _geom, _start, _way, normal: (None, normal.copy()))


def ignore(monkeypatch: pytest.MonkeyPatch, run: Run, *geoms: str) -> None:
    """From now on rays pass through some geoms."""
    numbers, true = {run.model.geom(geom).id for geom in geoms}, Optics._meet

    def meet(self: Optics, data: Any, start: Any, way: Any, clear: float, body: int) -> Any:
        far, geom, normal = true(self, data, start, way, clear, body)
        while geom in numbers:
            far, geom, normal = true(self, data, start, way, far + 1e-6, body)
        return far, geom, normal

    monkeypatch.setattr(Optics, "_meet", meet)


def in_each_other_s_way(run: Run) -> list[str]:
    """Visible geoms of different parts that overlap by a tenth of a millimetre, at the start, half-way or at the end;
    but for the floor, for gallows, which things are bolted to, and for what is declared to touch."""
    model, data, found = run.model, mujoco.MjData(run.model), []
    part = [model.geom(i).name.partition("/")[0] for i in range(model.ngeom)]
    touching = {frozenset(model.geom(g).name for g in (model.pair_geom1[i], model.pair_geom2[i]))
                for i in range(model.npair)}  # fmt: skip
    shown = [i for i in range(model.ngeom) if model.geom_group[i] < IMMATERIAL and part[i] not in ("stage", "gallows")]
    for sample in (0, len(run) // 2, len(run) - 1):
        data.qpos[:] = run.qpos[sample]
        mujoco.mj_kinematics(model, data)
        for a, b in itertools.combinations(shown, 2):
            names = model.geom(a).name, model.geom(b).name
            near = np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) < model.geom_rbound[a] + model.geom_rbound[b]
            if part[a] != part[b] and near and frozenset(names) not in touching:
                gap = mujoco.mj_geomDistance(model, data, a, b, 1.0, None)
                if gap < -1e-4:
                    found.append(f"{names[0]} and {names[1]} by {-gap:.3g} m")
    return found


def first_poses(specimen: Phenomenon) -> Run | None:
    """The run of a specimen, or None if it is refused with its reason."""
    try:
        compile(specimen, build(specimen), DRAFT)
    except Refusal as refusal:
        assert "allowed" in str(refusal), refusal  # noqa: PT017  (a refusal is an answer, not an accident)
        return None
    return simulate_specimen(specimen, fidelity=DRAFT)


def hold_at_random(cls: type[Phenomenon], draws: int, least: int, **fixed: Any) -> list[Run]:
    """The runs of so many random specimens that are not refused, `least` of them at least: no law fails in any, and
    nothing stands in another thing's way."""
    rng, runs = np.random.default_rng(cls.index), []
    for _ in range(draws):
        run = first_poses(cls.sample(rng, **fixed))
        if run is not None:
            runs.append(run)
            assert not failed(run), run.specimen
            assert not in_each_other_s_way(run), run.specimen
    assert len(runs) >= least, len(runs)
    return runs
