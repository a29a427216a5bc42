"""Catapults: throws by decree, arms without inertia, stops that yield and crooked flights are found out."""

from __future__ import annotations

import dataclasses
from math import cos, degrees, sin, sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p44_catapult_launch import HOLD, CatapultLaunch
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT, STANDARD
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import build, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def catapult(cls: type[CatapultLaunch] = CatapultLaunch, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


class Weightless(CatapultLaunch, domain="mechanics"):
    """All the work goes into the ball: a beam of hardly any mass that is said to have one."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.geom("catapult/beam").mass = 0.3


class Softer(CatapultLaunch, domain="mechanics"):
    """The bar gives way."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint("catapult/hinge").range = (-60.0, degrees(self.stop) + 3.0)


class Glued(CatapultLaunch, domain="mechanics"):
    """The ball is the arm's end: it stops with it."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.touching = [pair for pair in scene.touching if "catapult/tray" not in pair]


def test_an_arm_without_inertia_is_found_out() -> None:
    run = catapult(Weightless)
    assert law(run, "spring_throws") == law(run, "counterweight_throws") == "failed"


def test_a_speed_that_is_given_is_found_out() -> None:
    run = nominal(44, DRAFT)
    stiffer = run.again(stiffness=12.0)
    squares = [float(np.sum(r.specimen.released(r)[1] ** 2)) for r in (run, stiffer)]
    works = [r.specimen.work(-0.4, 0.9) for r in (run, stiffer)]
    assert squares[1] / squares[0] == pytest.approx(works[1] / works[0], rel=5e-3)
    given = dataclasses.replace(run, specimen=stiffer.specimen)
    assert given.specimen.laws()["spring_throws"].judge(given.specimen, given).verdict == "failed"


def test_a_stop_that_gives_way_is_found_out() -> None:
    run = catapult(Softer)
    assert law(run, "the_stop_holds_the_arm") == "failed"


def test_an_arm_that_passes_through_the_ball_is_found_out() -> None:
    run = catapult(Glued)
    assert law(run, "ball_rides_in_its_tray") in ("failed", "not evaluated")
    assert run.specimen.ball_place(run)[-1, 0] < 0
    assert law(run, "spring_throws") in ("failed", "not evaluated")


def test_a_crooked_flight_is_found_out() -> None:
    run = nominal(44, DRAFT)
    qpos = run.qpos.copy()
    flying = run.specimen.flight(run)
    x, z = (run.model.joint("ball/free").qposadr[0] + i for i in (0, 2))
    qpos[flying, z] += 0.05 * np.sin(np.linspace(0, np.pi, flying.sum()))
    assert law(dataclasses.replace(run, qpos=qpos), "ball_flies_a_parabola") == "failed"
    qpos = run.qpos.copy()
    qpos[:, x] -= 0.02 * (run.t > HOLD + 0.1)
    assert law(dataclasses.replace(run, qpos=qpos), "ball_rides_in_its_tray") == "failed"


def test_a_throw_askew_is_found_out() -> None:
    run = nominal(44, DRAFT)
    qvel = run.qvel.copy()
    dof = run.model.joint("ball/free").dofadr[0]
    turn = 0.05
    vx, vz = qvel[:, dof].copy(), qvel[:, dof + 2].copy()
    qvel[:, dof], qvel[:, dof + 2] = vx * cos(turn) - vz * sin(turn), vx * sin(turn) + vz * cos(turn)
    assert law(dataclasses.replace(run, qvel=qvel), "ball_leaves_at_right_angles") == "failed"


def test_more_of_the_work_goes_into_a_heavier_ball() -> None:
    shares = []
    for mass in (0.1, 1.0):
        one = CatapultLaunch.make(drive="weight", mass=mass)
        height = one.short * (sin(one.stop) + sin(one.cocked))
        shares.append(mass * (one.throw.rate * one.long) ** 2 / 2 / (one.weight * g * height))
    assert shares[0] < shares[1] < 1


def test_a_counterweight_on_the_moon_throws_as_far() -> None:
    run = catapult(drive="weight")
    light = run.again(gravity=g / 2)
    landings = [next(i for i in r.impacts if "stage/floor" in (i.first, i.second)) for r in (run, light)]
    assert landings[0].position[0] == pytest.approx(landings[1].position[0], rel=1e-3)
    assert (landings[1].time - HOLD) / (landings[0].time - HOLD) == pytest.approx(sqrt(2), rel=1e-3)


def test_it_waits_until_it_is_let_go() -> None:
    run = nominal(44, DRAFT)
    held = run.t < HOLD - 0.01
    assert np.abs(run.specimen.arm_rate(run)[held]).max() < 1e-9
    assert np.ptp(run.specimen.ball_place(run)[held], axis=0).max() < 1e-8


def test_it_hits_its_target() -> None:
    run = nominal(44, DRAFT)
    landed = next(i for i in run.impacts if "stage/floor" in (i.first, i.second))
    assert landed.position[0] == pytest.approx(run.model.body("mark/mark").pos[0], rel=1e-3)


def test_refusals_name_what_is_allowed() -> None:
    with pytest.raises(Refusal, match=r"flies .* m, 9 m are watched; stiffness = 200 N m/rad; allowed: "):
        build(CatapultLaunch.make(stiffness=200.0))
    with pytest.raises(Refusal, match=r"too weak: .* weight = 1 kg; allowed: "):
        build(CatapultLaunch.make(drive="weight", weight=1.0))


def test_an_arm_that_falls_back_is_no_accident() -> None:
    run = catapult(stiffness=9.85, preload=0.11, long=0.68, short=0.26, arm=2.27, mass=0.076, cocked=0.48, stop=1.29)
    assert not failed(run)
    assert run.specimen.arm_angle(run)[-1] < run.specimen.stop - 0.005


def test_an_arm_that_falls_back_at_once_has_been_stopped() -> None:
    """It is below its stop again at every sample, until it has swung up to it much later."""
    run = simulate_specimen(CatapultLaunch.make(preload=0.05), fidelity=STANDARD)
    up = run.specimen.arm_angle(run) > run.specimen.stop - 1e-6
    assert run.t[np.argmax(run.specimen.stopped(run))] < 1.1 < 1.5 < run.t[np.argmax(up)]
    assert not failed(run)


def test_extremes() -> None:
    assert not failed(catapult(drive="weight", weight=30.0, mass=0.05, short=0.1, long=0.4, arm=0.3))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(CatapultLaunch, count=4, seed=3)
    assert decided["ball_flies_a_parabola"] >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(CatapultLaunch, count=25, seed=44)
