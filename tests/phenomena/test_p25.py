"""A mirror that shatters: beams that only look right are told from the true one."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p25_mirror_fragment_reflect import BACK, GLASS, MIDDLE, STEEP, MirrorFragmentReflect
from physinone_mj import contact, fracture, optics, stress
from physinone_mj.fidelity import DRAFT, STANDARD
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import Stepper, build, simulate_specimen
from physinone_mj.simulate import compile as compile_scene

from .verdicts import failed, judge_random

BEAM = {
    "whole_mirror_reflects_at_equal_angles",
    "every_shard_reflects_with_its_own_normal",
    "beam_goes_on_where_no_shard_is",
}


class Brief(MirrorFragmentReflect, domain="optics"):
    """Watched until the first shards have left the frame."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.duration = self.hit + 0.4


@functools.cache
def throw(**values: Any) -> Run:
    return simulate_specimen(Brief.make(**values), fidelity=DRAFT)


def test_true_beam_is_right() -> None:
    assert not failed(throw())
    assert len(throw().breaks) > 10


def test_a_beam_that_is_switched_off_at_the_break_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run, true = throw(), optics.trace

    def off(run: Run, name: str) -> Rays:
        rays = true(run, name)
        late = run.t > run.breaks[0].time
        points, geoms = rays.points.copy(), rays.geoms.copy()
        points[late, 1:], geoms[late] = np.nan, optics.NO_RAY
        return replace(rays, points=points, geoms=geoms)

    monkeypatch.setattr(optics, "trace", off)
    assert failed(run) >= BEAM - {"whole_mirror_reflects_at_equal_angles"}


def test_reflection_off_the_plane_where_the_mirror_was_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run, true = throw(), optics.trace

    def frozen(run: Run, name: str) -> Rays:
        rays = true(run, name)
        late = run.t > 0
        points, geoms, cut = rays.points.copy(), rays.geoms.copy(), rays.truncated.copy()
        points[late], geoms[late], cut[late] = points[0], geoms[0], cut[0]
        return replace(rays, points=points, geoms=geoms, truncated=cut)

    monkeypatch.setattr(optics, "trace", frozen)
    assert failed(run) == BEAM - {"whole_mirror_reflects_at_equal_angles"}


def test_shards_with_the_mirror_s_old_normal_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._mirror

    def parent(self: Optics, data: Any, geom: int, *ray: Any) -> Any:
        far, normal = true(self, data, geom, *ray)
        return far, None if normal is None else np.array([1.0, 0.0, 0.0])

    monkeypatch.setattr(Optics, "_mirror", parent)
    assert failed(replace(throw())) == {"every_shard_reflects_with_its_own_normal"}  # a run not traced before


def test_shards_that_shine_on_their_backs_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = replace(throw())
    shards = {run.model.geom(shard).id for shard in run.specimen.shards}

    def anything(self: Optics, data: Any, geom: int, start: Any, way: Any, normal: Any) -> Any:
        return (None, normal.copy()) if geom in shards or self._model.geom(geom).name == "ball/ball" else (None, None)

    monkeypatch.setattr(Optics, "_mirror", anything)
    rays = optics.trace(run, "laser")
    by_ball = rays.geoms[:, 0] == run.model.geom("ball/ball").id
    if by_ball.any():
        assert "beam_goes_on_where_no_shard_is" in failed(run)


@pytest.mark.parametrize(("slope", "known"), [(0.95, True), (1.05, False)])
def test_where_the_beam_grazes_a_face_nothing_is_said(
    slope: float, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A face that is met sooner by so many times as much as it is nearer, about the greatest that is judged."""
    run, phenomenon = throw(), Brief.make()

    def drawn_out(_self: Any, _run: Run, margin: float = 0.0) -> tuple[Any, Any, Any]:
        return np.zeros(len(run), int), np.ones(len(run), bool), np.full(len(run), 1.0 - STEEP * slope * margin)

    monkeypatch.setattr(Brief, "should_meet", drawn_out)
    who, silvered = phenomenon.certain(run)
    assert (who == (0 if known else -2)).all()
    assert (silvered == known).all()


def test_tilt_turns_the_beam_twice_as_far() -> None:
    run = throw()
    rays, normals = optics.trace(run, "laser"), run.specimen.shard_normals(run)
    _, way = run.specimen.source
    who, silvered = run.specimen.certain(run)
    compared = 0
    for k, shard in enumerate(run.specimen.shards):
        for i in np.flatnonzero(silvered & (who == run.model.body(shard).id)):
            n = normals[i, k]
            turn = np.arccos(np.clip(rays.directions(1)[i] @ way, -1, 1))
            assert turn == pytest.approx(np.pi - 2 * np.arccos(-n @ way), abs=1e-7)
            compared += 1
    assert compared > 20


def test_without_a_ball_nothing_happens() -> None:
    class Calm(Brief, domain="optics"):
        """The ball flies the other way."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.speed["ball/free"] = (2.0, 0, 0, 0, 0, 0)

    run = simulate_specimen(Calm(), fidelity=DRAFT)
    assert not run.breaks
    rays = optics.trace(run, "laser")
    assert np.ptp(rays.ends, axis=0).max() < 1e-6
    screen = run.model.body("screen/screen").id
    assert (run.model.geom_bodyid[rays.geoms[:, 1]] == screen).all()


def test_through_the_gap_it_falls_on_the_wall_behind() -> None:
    run = throw()
    rays = optics.trace(run, "laser")
    through = run.specimen.meets(run) == run.model.body("back/screen").id
    assert through.any()
    start, way = run.specimen.source
    due = start + way * (BACK - start[0]) / way[0]
    assert rays.ends[through] == pytest.approx(np.tile(due, (through.sum(), 1)), abs=1e-7)


def test_the_laser_s_image_is_as_far_behind_the_whole_mirror() -> None:
    run = throw()
    start, _ = run.specimen.source
    image = run.specimen.image_of_the_laser(run)[0]
    assert image == pytest.approx(start * (-1, 1, 1) + (2 * GLASS[0], 0, 0), abs=1e-9)


def test_damage_is_where_the_ball_hits() -> None:
    for aside, above in ((0.2, 0.25), (-0.2, -0.25)):
        run = throw(aside=aside, above=above, strength=5e7, chunks=20)
        specimen = run.specimen
        gone = {b.weld for b in run.breaks if b.time < run.breaks[0].time + 1e-6}
        welds = fracture.welds("mirror", specimen.broken)
        places = np.array([i.centre for i in specimen.broken.interfaces])
        away = np.linalg.norm(places - (0, aside, above), axis=1)
        broken = np.array([weld in gone for weld in welds])
        assert broken.any()
        assert away[broken].mean() < away[~broken].mean()
        assert run.impacts[0].position == pytest.approx((GLASS[0], aside, MIDDLE + above), abs=0.01)


def test_glass_that_is_strong_enough_stays() -> None:
    run = throw(strength=1e9, speed=2.0, mass=0.05)
    assert not run.breaks
    assert not failed(run)


@pytest.mark.parametrize(
    "values",
    [
        {"incidence": np.radians(10), "speed": 8.0, "mass": 2.0, "strength": 1e6},
        {"incidence": np.radians(70), "friction": 0.9, "restitution": 0.8, "radius": 0.02},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    assert not failed(throw(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        specimen = Brief.sample(rng, chunks=10)
        assert not failed(simulate_specimen(specimen, fidelity=DRAFT)), specimen


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(MirrorFragmentReflect, 25).values()) >= 5


def test_forces_in_a_crowd_are_those_of_its_accelerations(monkeypatch: pytest.MonkeyPatch) -> None:
    """M a = f in all that is accepted as solved: a solution that is cut short creates energy."""
    settle, missing = contact.Solver._settle, []

    def checked(solver: Any, data: Any, *rest: Any, **how: Any) -> bool:
        found = settle(solver, data, *rest, **how)
        if found and solver.crowd(data):
            force = np.empty(len(data.qvel))
            mujoco.mj_mulM(solver._model, data, force, data.qacc)
            lost = np.abs(force - data.qfrc_smooth - data.qfrc_constraint).max()
            missing.append(lost / np.abs(data.qfrc_constraint).max())
        return found

    monkeypatch.setattr(contact.Solver, "_settle", checked)
    mirror = MirrorFragmentReflect.make(
        chunks=12, strength=1e6, density=4e3, mass=0.05, radius=0.06, speed=8.0, aside=-0.2, above=-0.25, friction=0.9,
        restitution=0.8,
    )  # fmt: skip
    with Stepper(compile_scene(mirror, build(mirror), STANDARD)) as stepper:
        while stepper.data.time < mirror.hit + 2e-3:
            stepper.advance()
    assert len(missing) > 2
    assert max(missing) < 1e-3


def test_shards_that_are_jammed_do_not_fly_apart() -> None:
    """Overlaps are taken back, but not where two that do not yield would shoot a third away."""
    runs = [throw(radius=0.03, pattern=pattern) for pattern in (1, 2, 7, 11)]
    assert max(map(stress.gained, runs)) < 1e-3
    # which of them jam depends on the last digit, and so on the machine
    assert any(contact.OVERLAPPING in run.eased for run in runs)
