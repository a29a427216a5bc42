"""Even bowl: things glued to the glass, facets and a bowl that turns only in the picture are found out."""

from __future__ import annotations

import dataclasses
from math import acos, pi
from typing import Any

import numpy as np
import pytest

from phenomena.bowls import Cube, centre, polar, revolve
from phenomena.p17_uniform_concave_spin import BALL, CUBE, LOW, RATIOS, UniformConcaveSpin
from phenomena.spins import azimuth
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random


class Painted(UniformConcaveSpin, domain="mechanics"):
    """A bowl whose surface stands still while its picture would turn."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[:] = [Motor("bowl/hinge", ((0.0, 0.0),))]
        scene.speed["bowl/hinge"] = 0.0


def law(run: Run, name: str) -> str:
    return str(run.specimen.laws()[name].judge(run.specimen, run).verdict)


def spin(**values: Any) -> Run:
    return simulate_specimen(UniformConcaveSpin.make(**values), fidelity=DRAFT)


@pytest.mark.parametrize("part", [0.05, 0.5])
def test_a_cube_that_slips_a_little_holds_again_lower_down(part: float) -> None:
    """Where its spin all but does not count, the law has nothing to see: it says so, and by how much."""
    bowl = {"radius": 0.484, "edge": 0.0886, "friction": 0.827, "angle": 0.7405}
    ratio = UniformConcaveSpin.make(**bowl).critical(1) * (1 - part)
    run = spin(cargo="cube", ratio=ratio, **bowl)
    slid = np.ptp(polar(run, CUBE, run.specimen.radius))
    assert slid == pytest.approx(run.specimen.slides(1, part), rel=5e-3)
    assert law(run, "cube_holds_between_two_spins") == "not evaluated"


def with_twins(run: Run, change: Any) -> Run:
    return dataclasses.replace(run, again_with=lambda **changes: change(run.again(**changes)), _repeats={})


def glued(run: Run) -> Run:
    """The run with the ball carried round by the bowl from its first place on."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    joint = run.model.joint("ball/free")
    q, v, turn = joint.qposadr[0], joint.dofadr[0], run.specimen.spin
    x = (qpos[0, q] + 1j * qpos[0, q + 1]) * np.exp(1j * turn * run.t)
    qpos[:, q], qpos[:, q + 1], qpos[:, q + 2] = x.real, x.imag, qpos[0, q + 2]
    qvel[:, v], qvel[:, v + 1], qvel[:, v + 2] = (1j * turn * x).real, (1j * turn * x).imag, 0.0
    return dataclasses.replace(run, qpos=qpos, qvel=qvel)


def faceted(run: Run) -> Run:
    """The run with the ball in the middle of the nearest of twelve facets."""
    qpos = run.qpos.copy()
    q = run.model.joint("ball/free").qposadr[0]
    r = run.specimen.radius
    theta = polar(run, BALL, r)
    flat = (np.round(theta / (pi / 24) - 0.5) + 0.5) * pi / 24
    x = qpos[:, q : q + 2] / np.sin(theta)[:, None]
    qpos[:, q : q + 2] = x * np.sin(flat)[:, None]
    qpos[:, q + 2] = centre(r)[2] - run.specimen.reach * np.cos(flat)
    return dataclasses.replace(run, qpos=qpos)


@pytest.mark.slow
def test_a_ball_glued_to_the_bowl_is_found_out() -> None:
    run = with_twins(nominal(17, DRAFT), glued)
    assert law(run, "smooth_ball_ignores_the_spin") in ("failed", "not evaluated")
    assert law(run, "ball_rolls_as_the_bowl_drags_it") == "failed"


@pytest.mark.slow
def test_without_friction_a_ball_at_the_bottom_stays() -> None:
    run = spin(cargo="ball", friction=0.0, angle=0.0, ratio=2.5)
    assert np.abs(run.position(BALL) - run.position(BALL)[0]).max() < 1e-9


def test_facets_are_found_out() -> None:
    run = nominal(17, DRAFT)
    assert law(run, "ball_rides_where_the_wall_carries_it") == "passed"
    assert law(with_twins(run, faceted), "ball_rides_where_the_wall_carries_it") == "failed"


@pytest.mark.slow
def test_a_bowl_that_turns_only_in_the_picture_is_found_out() -> None:
    run = simulate_specimen(Painted(), fidelity=DRAFT)
    assert law(run, "cube_holds_between_two_spins") == "failed"
    assert law(run, "ball_rolls_as_the_bowl_drags_it") == "failed"


def test_the_three_stay_where_they_should() -> None:
    run = nominal(17, DRAFT)
    turned = run.joint("bowl/hinge")
    for body in (BALL, CUBE):
        assert np.abs(azimuth(run, body) - azimuth(run, body)[0] - turned).max() < 0.05
        assert np.ptp(polar(run, body, 0.3)) < 2e-3
    assert np.abs(run.position(LOW)[:, :2]).max() < 1e-9


def test_over_the_critical_friction_the_small_cube_is_a_point() -> None:
    assert Cube(0.3, 1e-6).grip(0.6) == pytest.approx(0.6, rel=1e-5)
    assert Cube(0.3, 0.015).grip(0.6) > 0.62


def test_weaker_gravity_and_heavier_balls() -> None:
    run = nominal(17, DRAFT)
    ball = run.again(cargo="ball", ratio=0.0)
    slow = run.again(cargo="ball", ratio=0.0, gravity=g / 2)
    times = [r.specimen.swing_time(r) for r in (ball, slow)]
    assert times[1] / times[0] == pytest.approx(2**0.5, rel=1e-4)
    heavy = run.again(cargo="ball", ratio=0.0, density=2400.0)
    assert np.abs(heavy.position(BALL) - ball.position(BALL)).max() < 1e-9


def test_the_fastest_ball_rides_just_below_the_rim() -> None:
    run = spin(cargo="rider", ratio=3.0)
    assert polar(run, BALL, 0.3).mean() == pytest.approx(acos(1 / 9), abs=1e-3)
    assert max(RATIOS) < 3.0


def test_a_slow_bowl_leaves_the_ball_at_the_bottom() -> None:
    run = spin(ratio=0.9)
    assert polar(run, BALL, 0.3).max() < 1e-6
    assert "too slow" in run.specimen.caption(run)


def test_refuses_what_overlaps() -> None:
    with pytest.raises(Refusal, match=r"R1.*allowed"):
        spin(ratio=0.5, angle=0.05)


def test_a_turned_outline_is_closed_and_looks_outwards() -> None:
    square = ((1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0))
    for sectors, volume in ((((0.0, 2 * pi),), 3 * pi), (((0.0, 1.0), (2.0, 3.0)), 3.0)):
        x, faces = revolve(square, sectors)
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        assert sorted(map(tuple, edges)) == sorted(map(tuple, edges[:, ::-1]))
        inside = np.einsum("ij,ij->i", x[faces[:, 0]], np.cross(x[faces[:, 1]], x[faces[:, 2]])).sum() / 6
        assert inside == pytest.approx(volume, rel=0.02)


@pytest.mark.slow
def test_random_specimens() -> None:
    judge_random(UniformConcaveSpin, count=2, seed=3)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    decided = judge_random(UniformConcaveSpin, count=25, seed=4)
    assert min(decided.values()) >= 1


def test_a_cube_holds_up_to_its_spin_in_a_quick_bowl() -> None:
    """At DRAFT, too: steps follow the turning of its corners."""
    run = spin(cargo="ball", radius=0.3979, size=0.0235, edge=0.094, ratio=1.16, friction=0.6201, angle=0.8311)
    assert law(run, "cube_holds_between_two_spins") == "passed"
