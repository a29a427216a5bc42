"""The spring board against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p27_springboard_rebound import BALL, NODES, WEIGHTS, SpringboardRebound
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

DEPTH, APEX, PUSH = (
    "sinks_as_deep_as_the_energy_goes",
    "is_thrown_up_by_the_spring_alone",
    "is_pushed_for_most_of_a_swing",
)
TIP, HINGE = "tip_sinks_by_the_load", "a_hinge_is_softer_farther_out"


def bounce(cls: type[SpringboardRebound] = SpringboardRebound, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


class HardBounce(SpringboardRebound, domain="mechanics"):
    """A board that hardly gives way, and a ball that bounces off it."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        if self.kind == "platform":
            scene.spec.tendon("platform/spring").stiffness = [20 * self.stiffness, 0, 0]
            for name in (BALL, "platform/board"):
                scene.matter[name] = dataclasses.replace(scene.matter[name], surface=Surface(restitution=0.9))


class Weightless(SpringboardRebound, domain="mechanics"):
    """Whatever the board is made of, it weighs 50 g."""

    def build(self, scene: Scene) -> None:
        SpringboardRebound(**(self.values() | {"board": 0.05})).build(scene)


class AnyRadius(SpringboardRebound, domain="mechanics"):
    """A hinged board that is as stiff wherever it is hit: the hit is always in its middle."""

    def build(self, scene: Scene) -> None:
        SpringboardRebound(**(self.values() | {"offset": 0.5})).build(scene)


class Stretchy(SpringboardRebound, domain="mechanics"):
    """A bending board of another stiffness in its outer half."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        if self.kind in ("bending", "loaded"):
            hinge = scene.spec.joint("cantilever/hinge2")
            hinge.stiffness = [1.1 * hinge.stiffness[0], 0, 0]


class Loose(SpringboardRebound, domain="mechanics"):
    """The ball passes through the board."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.touching = [pair for pair in scene.touching if "platform/board" not in pair]


def test_a_bounce_with_a_spring_drawn_below_is_found_out() -> None:
    run = bounce(HardBounce)
    assert judge(run, DEPTH) == judge(run, PUSH) == "failed"


def test_a_board_without_mass_is_found_out() -> None:
    run = bounce(Weightless, board=0.3)
    assert judge(run, APEX) == judge(run, DEPTH) == "failed"


def test_a_hinge_that_does_not_know_where_it_is_hit_is_found_out() -> None:
    assert judge(bounce(AnyRadius), HINGE) == "failed"


def test_a_board_that_bends_otherwise_is_found_out() -> None:
    assert judge(bounce(Stretchy), TIP) == "failed"


def test_the_hinges_of_a_bending_board_are_exact_for_its_tip() -> None:
    """∫ (1 - s)² ds = 1/3, and (1 - s)(a - s) up to a load that lies farther out than the last of them."""
    assert WEIGHTS.sum() == pytest.approx(1.0)
    assert float(WEIGHTS @ (1 - NODES) ** 2) == pytest.approx(1 / 3, rel=1e-14)


def test_the_ball_arrives_when_it_should() -> None:
    run = nominal(27, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringboardRebound)
    assert specimen.hit(run) == pytest.approx(sqrt(2 * specimen.drop / g), rel=1e-7)
    light = run.again(gravity=g / 2)
    # under less weight the board is a little higher before the ball is let go, and springs up
    assert specimen.hit(light) / specimen.hit(run) == pytest.approx(sqrt(2), rel=0.02)


def test_the_ball_sticks_to_the_board_till_it_is_back() -> None:
    run = nominal(27, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringboardRebound)
    gap = specimen.height(run) + specimen.deflection(run)
    pressed = (run.t > specimen.hit(run)) & (run.t < specimen.leaves(run))
    assert pressed.sum() > 10
    assert np.abs(gap[pressed]).max() < 1e-6
    assert gap.min() > -1e-6


def test_a_board_that_nothing_touches_stays() -> None:
    run = bounce(Loose)
    assert np.ptp(run.joint("platform/board")) < 1e-9
    falling = run.t < 0.3
    fallen = run.position(BALL)[0, 2] - run.position(BALL)[falling, 2]
    assert fallen == pytest.approx(g * run.t[falling] ** 2 / 2, abs=1e-9)


def test_a_hinged_board_throws_it_off() -> None:
    run = bounce(kind="hinged")
    specimen = run.specimen
    assert isinstance(specimen, SpringboardRebound)
    assert specimen.height(run)[run.t > specimen.hit(run) + 0.2].max() > 0.1
    assert abs(run.position(BALL)[-1, 0] - run.position(BALL)[0, 0]) > 0.05


def test_a_bending_board_throws_it_up() -> None:
    run = bounce(kind="bending", stiffness=600.0, board=1.0, drop=0.3, offset=0.9)
    specimen = run.specimen
    assert isinstance(specimen, SpringboardRebound)
    assert specimen.deflection(run).max() > 0.03
    assert specimen.height(run)[run.t > specimen.hit(run) + 0.2].max() > 0.05
    assert run.position(BALL)[:, 2].min() > 0.049


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"stiffness": 2e4, "board": 0.05, "mass": 0.1, "drop": 1.2}, PUSH),
        ({"stiffness": 5000.0, "board": 1.0, "mass": 0.5, "drop": 1.0}, DEPTH),
        ({"stiffness": 4000.0, "board": 0.05, "mass": 2.0, "length": 1.0, "drop": 0.4}, APEX),
    ],
)
def test_extremes(values: dict[str, Any], law: str) -> None:
    assert judge(bounce(**values), law) == "passed"


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"stiffness": 200.0, "mass": 2.0}, r"R12.*board sinks by .* allowed: 0\.233 m, with a stiffness of some"),
        ({"kind": "hinged", "stiffness": 200.0, "mass": 2.0}, r"R12.*turns down by .* allowed: 0\.35 rad"),
        ({"kind": "bending", "stiffness": 2e4, "board": 0.1}, r"R4.*bends with .* allowed: 5000 rad/s, here a stiff"),
        ({"kind": "bending", "stiffness": 200.0, "mass": 2.0}, r"R12.*bends down by .* allowed: 0\.35 rad"),
    ],
)
def test_refusals(values: dict[str, Any], names: str) -> None:
    with pytest.raises(Refusal, match=names):
        bounce(**values)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert judge_random(SpringboardRebound, count=3, seed=3)[DEPTH] >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(SpringboardRebound, count=25, seed=1).values()) >= 8
