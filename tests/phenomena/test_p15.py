"""A uniformly turning pillar: paddles without surface speed, puppets on strings and weak motors are found out."""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p15_uniform_panel_spin import UniformPanelSpin
from phenomena.pillars import AXLE
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

STRIKE, SEATS, EVEN = "paddles_strike_with_their_speed", "seats_swing_out", "paddles_come_at_even_intervals"
WORK, HOLDS, YIELDS = (
    "the_motor_pays_for_the_swing", "a_strong_motor_holds_the_speed", "a_limited_motor_gives_way_and_recovers"
)  # fmt: skip


class Weak(UniformPanelSpin, domain="mechanics"):
    """A motor that every strike slows down, whatever is asked for."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[:] = [Motor(AXLE, ((0.0, self.speed),), force=0.05)]


class Unyielding(UniformPanelSpin, domain="mechanics"):
    """A motor that nothing slows down, whatever is asked for."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[:] = [Motor(AXLE, ((0.0, self.speed),))]


def turn(cls: type[UniformPanelSpin] = UniformPanelSpin, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def test_a_paddle_without_surface_speed_is_found_out() -> None:
    """A pillar put from pose to pose pushes a ball out at a speed of its own."""
    run = nominal(15, DRAFT)
    v = run.model.joint("ball0/free").dofadr[0]
    qvel = run.qvel.copy()
    after = run.t > run.impacts[0].time
    qvel[after, v : v + 3] *= 0.5 / np.linalg.norm(qvel[after, v : v + 3], axis=1)[:, None].clip(1e-9)
    assert law(dataclasses.replace(run, qvel=qvel), STRIKE) == "failed"
    assert law(run, STRIKE) == "passed"


def test_strikes_on_moving_balls_count_their_speed() -> None:
    run = turn(floor_friction=0.0, speed=3.0)
    measured, expected = run.specimen.struck(run)
    assert len(measured) >= 4
    assert np.abs(measured - expected).max() < 1e-9


def test_keyframed_seats_are_found_out() -> None:
    short = turn(near="seats", settling=2.8)
    long = turn(near="seats", settling=2.2, hanger=0.9)
    assert law(short, SEATS) == law(long, SEATS) == "passed"
    puppet = dataclasses.replace(long, qpos=short.qpos, qvel=short.qvel)
    assert law(puppet, SEATS) == law(puppet, WORK) == "failed"


def test_half_the_gravity_lets_seats_swing_wider() -> None:
    run = turn(near="seats", settling=1.8)
    theta = run.again(gravity=9.80665 / 2).joint("pillar/hang0")[-1]
    assert np.tan(theta) == pytest.approx(4.0 * (0.35 + 0.6 * np.sin(theta)) / (9.80665 / 2), rel=1e-3)


def test_weak_and_unyielding_motors_are_found_out() -> None:
    assert law(turn(Weak), HOLDS) == "failed"
    assert law(turn(Unyielding), YIELDS) == "failed"


@pytest.mark.parametrize("values", [{"paddles": 1, "speed": 2.4}, {"paddles": 3, "speed": 1.6}])
def test_the_clapper_counts_the_paddles(values: dict[str, Any]) -> None:
    run = turn(near="clapper", **values)
    assert law(run, EVEN) == "passed"


@pytest.mark.parametrize(
    "values", [{}, {"torque": 50.0, "speed": 8.0}, {"torque": 1.0, "speed": 1.0, "density": 21300.0}]
)
def test_a_wedged_ball_stalls_a_limited_motor(values: dict[str, Any]) -> None:
    run = turn(near="wedge", drive="limited", **values)
    assert abs(run.joint_speed(AXLE)[-1]) < 1e-9
    assert np.abs(run.joint_speed(AXLE)).max() <= run.specimen.speed * (1 + 1e-9)
    data = mujoco.MjData(run.model)
    deepest = 0.0
    for q in run.qpos[::8]:
        data.qpos[:] = q
        mujoco.mj_forward(run.model, data)
        deepest = min([deepest, *data.contact.dist])
    # what is squeezed, impact upon impact, overlaps by no more than the paddle's way in a step
    assert deepest > -run.specimen.speed * run.specimen.paddle * run.step
    assert min(data.contact.dist, default=0.0) > -1e-6


def test_refusals() -> None:
    with pytest.raises(Refusal, match="allowed: 'limited'") as refusal:
        turn(near="wedge")
    assert refusal.value.rule == "R12"
    with pytest.raises(Refusal, match="allowed: 3") as refusal:
        turn(near="wedge", drive="limited", paddles=4, paddle=0.1, radius=0.06)
    assert refusal.value.rule == "R1"


@pytest.mark.parametrize(
    "values",
    [
        {"speed": 8.0, "paddle": 0.6, "density": 21300.0, "place": 1.0, "floor_friction": 0.0},
        {"paddles": 4, "paddle": 0.1, "radius": 0.06, "speed": 4.0, "density": 100.0},
    ],
)
def test_extreme_strikes(values: dict[str, Any]) -> None:
    run = turn(**values)
    assert law(run, STRIKE) == law(run, HOLDS) == "passed"


def test_extreme_seats() -> None:
    run = turn(near="seats", speed=8.0, arm=0.5, hanger=1.0, settling=2.9)
    assert law(run, SEATS) == law(run, WORK) == "passed"
    assert run.joint("pillar/hang0")[-1] > 1.4


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(UniformPanelSpin, count=2, seed=15).values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(UniformPanelSpin, count=25, seed=150)
