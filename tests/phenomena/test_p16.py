"""An accelerated pillar: seats without inertia and axles without a load are found out; slowing down works, too."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p16_accel_panel_spin import AccelPanelSpin
from phenomena.pillars import AXLE, WIDEST
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

RISE, EVENLY, MOMENTUM = "seats_rise_and_overshoot", "speed_grows_evenly", "torque_becomes_angular_momentum"
SHARE, STRIKE = "seats_that_rise_hold_the_pillar_back", "paddles_strike_harder_and_harder"


class Scripted(AccelPanelSpin, domain="mechanics"):
    """The torque turns the pillar as if no seats hung from it."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        if self.drive == "torque":
            scene.control.clear()
            last = self.initial + self.pull / self.inertia * self.watch
            scene.motors[:] = [Motor(AXLE, ((0.0, self.initial), (self.watch, last)))]


class Constant(AccelPanelSpin, domain="mechanics"):
    """The motor keeps the first speed."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[:] = [Motor(AXLE, ((0.0, self.initial),))]


def turn(cls: type[AccelPanelSpin] = AccelPanelSpin, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def test_seats_that_follow_the_steady_formula_are_found_out() -> None:
    run = nominal(16, DRAFT)
    steady = np.array([run.specimen.carousel.steady(float(w)) for w in run.specimen.omega(run.t)])
    qpos = run.qpos.copy()
    for k in range(4):
        qpos[:, run.model.joint(f"pillar/hang{k}").qposadr[0]] = steady
    assert law(dataclasses.replace(run, qpos=qpos), RISE) == "failed"
    assert law(run, RISE) == "passed"
    assert (run.joint("pillar/hang0") - steady).max() > 0.03  # they overshoot


def test_an_axle_that_does_not_feel_its_seats_is_found_out() -> None:
    run = turn(Scripted, drive="torque")
    assert law(run, MOMENTUM) == law(run, SHARE) == "failed"


def test_a_constant_speed_is_found_out() -> None:
    run = turn(Constant, near="balls", initial=1.0)
    assert law(run, EVENLY) == law(run, STRIKE) == "failed"


def test_the_second_strike_is_the_harder_one() -> None:
    run = turn(near="balls", alpha=3.0)
    _, _, whole = run.specimen.hits(run)
    assert whole == 2
    assert law(run, STRIKE) == "passed"
    speeds = run.specimen.speeds(run)
    first, second = (run.specimen.when(turn) for turn in run.specimen.turns)
    assert speeds[run.t > second][0, 1] > 1.05 * speeds[run.t > first][0, 0]


@pytest.mark.parametrize("drive", ["prescribed", "torque"])
def test_slowing_down(drive: str) -> None:
    run = turn(drive=drive, initial=5.0, alpha=-1.5, settling=1.0)
    assert law(run, RISE) == law(run, MOMENTUM) == law(run, SHARE) == law(run, EVENLY) == "passed"
    if drive == "prescribed":
        assert abs(run.joint_speed(AXLE)[-1]) < 1e-12
        assert run.joint("pillar/hang0")[-1] < 0.1 < run.joint("pillar/hang0")[0]


def test_slowing_paddles_strike_more_gently() -> None:
    run = turn(near="balls", initial=4.0, alpha=-2.0)
    assert law(run, STRIKE) == law(run, EVENLY) == "passed"


def test_stops_hold_the_seats() -> None:
    run = turn(alpha=6.0, hanger=1.0, arm=0.5, initial=0.0)
    theta = run.joint("pillar/hang0")
    assert theta.max() < WIDEST + 1e-6
    assert law(run, RISE) == law(run, EVENLY) == "passed"


def test_half_the_gravity_lets_seats_rise_faster() -> None:
    run = nominal(16, DRAFT)
    early = run.t < 2.0
    light = run.again(gravity=9.80665 / 2)
    assert light.joint("pillar/hang0")[early].max() > 1.5 * run.joint("pillar/hang0")[early].max()


@pytest.mark.parametrize(
    ("values", "nearest"), [({"alpha": 0.1}, "0.2 rad"), ({"alpha": -0.1}, "-0.2 rad"), ({"alpha": -1.0}, "")]
)
def test_refusals(values: dict[str, Any], nearest: str) -> None:
    with pytest.raises(Refusal, match=f"allowed: {nearest}") as refusal:
        turn(**({"initial": 0.4} | values))
    assert refusal.value.rule == "R12"


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(AccelPanelSpin, count=2, seed=17).values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(AccelPanelSpin, count=25, seed=160)
