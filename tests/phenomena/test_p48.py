"""A crank that pushes: sliders that only look driven, blocks that stick and wrong motors are found out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phenomena.p48_crank_push import BLOCK, CrankPush
from physinone_mj.base import ParameterError
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def crank(cls: type[CrankPush] = CrankPush, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def with_slider(run: Run, place: NDArray[np.float64], speed: NDArray[np.float64]) -> Run:
    """The run with the slider somewhere else: the wrist's distance from the axle, and its rate."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    joint = run.model.joint("crank/guide")
    qpos[:, joint.qposadr[0]] = place - run.specimen.rod - run.specimen.radius
    qvel[:, joint.dofadr[0]] = speed
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, _repeats={})


def with_block(run: Run, place: NDArray[np.float64]) -> Run:
    qpos = run.qpos.copy()
    qpos[:, run.model.joint("block/free").qposadr[0]] = place
    there = dataclasses.replace(run, qpos=qpos, _repeats={})
    return dataclasses.replace(there, again_with=lambda **_: there)


def test_a_cosine_is_no_crank() -> None:
    run = nominal(48, DRAFT)
    one: CrankPush = run.specimen
    angle, rate = one.crank_angle(run), one.crank_speed(run)
    fake = with_slider(run, one.rod + one.radius * np.cos(angle), -one.radius * np.sin(angle) * rate)
    assert law(fake, "slider_follows_the_crank") == law(fake, "slider_is_as_fast_as_the_crank_makes_it") == "failed"


def test_the_second_harmonic_is_there() -> None:
    run = nominal(48, DRAFT)
    one: CrankPush = run.specimen
    angle = one.crank_angle(run)
    turn = (angle > 3 * np.pi) & (angle <= 5 * np.pi)
    x, a = one.slider_place(run)[turn], angle[turn]
    second = np.linalg.lstsq(np.column_stack([np.cos(k * a) for k in range(8)]), x, rcond=None)[0][2]
    assert second == pytest.approx(one.radius / (4 * one.ratio), rel=0.05)


def test_a_rod_that_stretches_is_found_out() -> None:
    run = nominal(48, DRAFT)
    one: CrankPush = run.specimen
    x, along, _ = one.wrist(one.crank_angle(run))
    longer = with_slider(run, x + 1e-3 * np.sin(3 * run.t), along * one.crank_speed(run))
    assert law(longer, "slider_follows_the_crank") == "failed"
    assert one.closure(run).max() < 1e-4 < one.closure(longer).max()


def test_a_block_glued_to_the_plate_is_found_out() -> None:
    run = nominal(48, DRAFT)
    one: CrankPush = run.specimen
    assert law(with_block(run, one.slider_place(run) + one.reach + BLOCK), "block_slides_on") == "failed"


def test_a_block_that_stops_where_the_plate_turns_is_found_out() -> None:
    run = nominal(48, DRAFT)
    one: CrankPush = run.specimen
    place = np.maximum.accumulate(one.slider_place(run)) + one.reach + BLOCK
    assert law(with_block(run, place), "block_slides_on") == "failed"


def test_a_plate_that_passes_through_the_block_is_found_out() -> None:
    run = nominal(48, DRAFT)
    assert law(with_block(run, np.full(len(run), run.specimen.rest)), "block_slides_on") == "failed"


class Oiled(CrankPush, domain="mechanics"):
    """Guide bars with less friction than they say."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint("crank/guide").frictionloss = 0.9 * self.guide


class Stronger(CrankPush, domain="mechanics"):
    """A motor that gives more than it says."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[0] = dataclasses.replace(scene.motors[0], force=1.02 * self.torque)


@pytest.mark.parametrize("cls", [Oiled, Stronger])
def test_a_wrong_balance_of_work_is_found_out(cls: type[CrankPush]) -> None:
    run = crank(cls, turns=1)
    assert law(run, "slider_follows_the_crank") == "passed"
    assert law(run, "work_of_the_motor_goes_into_friction") == "failed"


def test_a_block_on_the_moon_slides_as_on_less_friction() -> None:
    light = crank(turns=1).again(gravity=g / 2)
    slippery = crank(turns=1, friction=0.125)
    ways = [r.specimen.block_place(r) for r in (light, slippery)]
    assert np.abs(ways[0] - ways[1]).max() < 1e-4


def test_a_block_farther_off_is_met_when_the_plate_is_there() -> None:
    run = crank(turns=1, place=0.3, torque=500.0)
    one: CrankPush = run.specimen
    angles = np.linspace(np.pi, 2 * np.pi, 20001)
    meeting = one.when(float(np.interp(0.3, (one.wrist(angles)[0] - one.rod + one.radius) / (2 * one.radius), angles)))
    assert next(i.time for i in run.impacts if "block/block" in (i.first, i.second)) == pytest.approx(meeting, abs=2e-4)


def test_the_load_does_not_change_a_strong_motors_course() -> None:
    light, heavy = crank(turns=1, block=0.1, torque=500.0), crank(turns=1, block=5.0, torque=500.0)
    assert np.abs(light.joint("crank/axle") - heavy.joint("crank/axle")).max() < 1e-9


def test_a_motor_too_weak_to_start_stalls() -> None:
    run = crank(torque=0.05, guide=20.0, turns=1)
    assert run.joint("crank/axle")[-1] - np.pi < 0.5
    assert abs(run.joint_speed("crank/axle")[-1]) < 1e-9
    assert "too weak" in run.specimen.caption(run)


def test_a_jammed_crank_says_so() -> None:
    run = crank(stop="ahead", turns=1)
    assert "stalls" in run.specimen.caption(run)
    assert run.specimen.block_place(run)[-1] - run.specimen.rest == pytest.approx(run.specimen.radius, abs=1e-7)


def test_a_fast_block_falls_off_the_table() -> None:
    run = crank(speed=10.0, radius=0.2, friction=0.05, turns=3, torque=500.0)
    assert run.position("block/block")[-1, 2] < run.specimen.axle - 0.1
    assert law(run, "block_slides_on") == "passed"


GENTLE = {"torque": 0.073, "radius": 0.044, "ratio": 4.17, "slider": 1.5, "guide": 5.3, "block": 2.9, "friction": 0.84}


def test_a_gentle_meeting_is_no_failure_but_a_slow_slider_is() -> None:
    run = crank(**GENTLE, speed=3.1, place=0.05, turns=1)
    one: CrankPush = run.specimen
    assert not run.impacts
    found = one.laws()["slider_is_as_fast_as_the_crank_makes_it"]
    assert found.error(*found.measure(one, run))[0] < 5e-4
    slow = with_slider(run, one.slider_place(run), 0.98 * one.slider_speed(run))
    assert law(slow, "slider_is_as_fast_as_the_crank_makes_it") == "failed"


def test_friction_that_takes_next_to_nothing_is_not_measured() -> None:
    assert law(crank(guide=0.1, turns=1), "work_of_the_motor_goes_into_friction") == "not evaluated"
    assert law(crank(guide=1.0, turns=1), "work_of_the_motor_goes_into_friction") == "passed"


def test_a_rod_shorter_than_twice_the_crank_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"ratio = 1\.04 is out of range; allowed: 2 to 6"):
        CrankPush.make(ratio=1.04)


def test_extremes() -> None:
    assert not failed(crank(radius=0.2, ratio=2.0, speed=10.0, torque=500.0, slider=3.0, block=5.0, turns=1))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(CrankPush, count=2, seed=5)
    assert min(decided.values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(CrankPush, count=25, seed=48)
