"""Carts: boxes that slide with painted wheels, wheels without mass and grips of the wrong strength are found out."""

from __future__ import annotations

import dataclasses
from math import cos, sin, sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p40_cart_move import START, WHEELS, CartMove
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def cart(cls: type[CartMove] = CartMove, **values: Any) -> Run:
    return simulate_specimen(cls.make(**({"watch": 1.5} | values)), fidelity=DRAFT)


class Weightless(CartMove, domain="mechanics"):
    """A sliding box with painted wheels: they have hardly any inertia."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for wheel in WHEELS:
            body, geom = scene.spec.body(f"cart/{wheel}"), scene.spec.geom(f"cart/{wheel}")
            geom.mass = 0.0
            body.explicitinertial, body.mass, body.ipos, body.iquat = True, self.wheel, (0, 0, 0), (1, 0, 0, 0)
            body.inertia = 0.05 * self.wheel * self.radius**2 * np.ones(3)


class Slippery(CartMove, domain="mechanics"):
    """Wheels that grip less than they say."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.material("stage/floor", 2400.0, Surface(friction=0.99 * self.friction))


class Level(CartMove, domain="mechanics"):
    """Grip without load transfer: a third of the mass moved down to the axles."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.geom("cart/chassis").pos[2] = -0.3 * self.radius


def test_a_box_with_painted_wheels_is_found_out() -> None:
    run = cart(Weightless, drive="slope")
    assert law(run, "wheels_share_the_slopes_work") == law(run, "motor_drives_the_cart") == "failed"


def test_heavier_wheels_slow_the_cart_and_heavier_matter_does_not() -> None:
    for values in ({}, {"wheel": 0.5}, {"wheel": 0.15, "mass": 1.0}):
        run = cart(drive="slope", watch=1.0, **values)
        assert law(run, "wheels_share_the_slopes_work") == "passed"
    light, heavy = (CartMove.make(wheel=w).downhill for w in (0.3, 0.5))
    assert heavy < 0.99 * light
    assert CartMove.make(wheel=0.15, mass=1.0).downhill == pytest.approx(light)


def test_wheels_turned_by_the_clock_are_found_out() -> None:
    run = nominal(40, DRAFT)
    qvel = run.qvel.copy()
    for wheel in WHEELS:
        qvel[:, run.model.joint(f"cart/{wheel}").dofadr[0]] = 20.0
    assert law(dataclasses.replace(run, qvel=qvel), "every_wheel_rolls") == "failed"


@pytest.mark.parametrize("cls", [Slippery, Level])
def test_a_false_grip_is_found_out(cls: type[CartMove]) -> None:
    assert law(cart(cls, watch=1.0), "wheels_spin_beyond_their_grip") == "failed"


def test_a_wheel_off_its_axle_is_found_out() -> None:
    run = cart(watch=1.0)
    off = dataclasses.replace(run.specimen, radius=1.002 * run.specimen.radius)
    verdict = run.specimen.laws()["axles_stay_at_their_mounts"].judge(off, run)
    assert verdict.verdict == "failed"


def test_a_brake_is_found_out() -> None:
    run = nominal(40, DRAFT)
    qvel = run.qvel.copy()
    qvel[:, 0] *= 1 - 2e-3 * run.t
    assert law(dataclasses.replace(run, qvel=qvel, _repeats={}), "it_coasts") == "failed"


def test_half_the_gravity_takes_longer_down() -> None:
    full = cart(drive="slope", watch=1.0)
    half = full.again(gravity=g / 2)
    way = [run.position("cart/cart")[:, 0] - run.position("cart/cart")[0, 0] for run in (full, half)]
    assert np.interp(0.5, full.t, way[0]) == pytest.approx(np.interp(0.5 * sqrt(2), half.t, way[1]), rel=1e-4)


def test_without_a_ram_it_stays() -> None:
    run = cart(drive="motor", torque=0.01, watch=1.0)
    still = run.t < START
    assert np.abs(run.position("cart/cart")[still] - run.position("cart/cart")[0]).max() < 1e-9


def test_both_sides_are_alike() -> None:
    run = cart(drive="motor", watch=2.0)
    turning = run.specimen.turning(run)
    assert np.abs(turning[:, ::2] - turning[:, 1::2]).max() < 1e-9
    assert np.abs(run.position("cart/cart")[:, 1]).max() < 1e-9


def test_it_leaves_the_slope_at_the_speed_of_its_fall() -> None:
    run = cart(drive="slope", slope=0.3, watch=2.5)
    one: CartMove = run.specimen
    free = one.alone(run, -1.0)
    v = one.velocity(run)[free][-1]
    way = (run.position("cart/cart")[free][-1] - run.position("cart/cart")[0]) @ (cos(0.3), 0, -sin(0.3))
    assert v**2 / 2 == pytest.approx(one.downhill * way, rel=1e-6)


def test_a_strong_motor_spins_the_wheels_and_says_so() -> None:
    run = cart(drive="motor", torque=5.0)
    assert run.specimen.slip(run)[:, 2:].max() > 1.0
    assert "spin" in run.specimen.caption(run)


def test_extremes() -> None:
    assert not failed(cart(radius=0.02, mass=5.0, wheel=0.02, friction=0.9, drive="slope", slope=0.35))
    assert not failed(cart(radius=0.1, mass=0.3, wheel=0.5, friction=0.2, speed=2.0))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(CartMove, count=2, seed=40)
    assert min(decided.values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(CartMove, count=25, seed=41)
