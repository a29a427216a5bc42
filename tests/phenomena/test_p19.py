"""Even turntable: things glued to the disc are found out, and what has no grip ignores it."""

from __future__ import annotations

import dataclasses
from math import sqrt
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p19_uniform_surface_spin import HEIGHT, WIDE, UniformSurfaceSpin
from phenomena.spins import azimuth, distance, plan
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random


class AlwaysRough(UniformSurfaceSpin, domain="mechanics"):
    """Grips as well with any material."""

    def build(self, scene: Scene) -> None:
        UniformSurfaceSpin.make(**(self.values() | {"friction": 0.5})).build(scene)


def law(run: Run, name: str) -> str:
    return str(run.specimen.laws()[name].judge(run.specimen, run).verdict)


def turn(**values: Any) -> Run:
    return simulate_specimen(UniformSurfaceSpin.make(**values), fidelity=DRAFT)


def glued(run: Run, body: str) -> Run:
    """The run with one body carried round by the disc."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    joint = run.model.joint(f"{body.split('/')[0]}/free")
    q, v, spin = joint.qposadr[0], joint.dofadr[0], run.specimen.omega
    x = qpos[0, q] + 1j * qpos[0, q + 1]
    turned = np.exp(1j * spin * run.t)
    qpos[:, q], qpos[:, q + 1] = (x * turned).real, (x * turned).imag
    qvel[:, v], qvel[:, v + 1] = (1j * spin * x * turned).real, (1j * spin * x * turned).imag
    return dataclasses.replace(run, qpos=qpos, qvel=qvel)


def test_a_puck_glued_to_the_disc_is_found_out() -> None:
    run = nominal(19, DRAFT)
    assert law(run, "smooth_puck_ignores_the_disc") == "passed"
    assert law(glued(run, "puck/puck"), "smooth_puck_ignores_the_disc") == "failed"


def test_a_ball_carried_round_like_a_block_is_found_out() -> None:
    run = nominal(19, DRAFT)
    assert law(run, "ball_rolls_in_circles") == "passed"
    assert law(glued(run, "ball/ball"), "ball_rolls_in_circles") == "failed"


def test_creep_is_found_out() -> None:
    run = nominal(19, DRAFT)

    def creeping(**changes: Any) -> Run:
        twin = run.again(**changes)
        qpos, q = twin.qpos.copy(), twin.model.joint("outer/free").qposadr[0]
        qpos[:, q : q + 2] *= 1 + 2.4e-3 * twin.t[:, None]  # 7.7 mm in 6 s
        return dataclasses.replace(twin, qpos=qpos)

    soft = dataclasses.replace(run, again_with=creeping, _repeats={})
    assert law(soft, "riding_block_does_not_creep") == law(soft, "block_stays_up_to_the_critical_spin") == "failed"


def test_a_disc_that_grips_everything_alike_is_found_out() -> None:
    run = simulate_specimen(AlwaysRough.make(cargo="block", friction=0.6), fidelity=DRAFT)
    assert law(run, "block_stays_up_to_the_critical_spin") == "failed"


def test_blocks_that_never_leave_are_found_out() -> None:
    run = nominal(19, DRAFT)

    def glue(**changes: Any) -> Run:
        return glued(run.again(**changes), "outer/block")

    stuck = dataclasses.replace(run, again_with=glue, _repeats={})
    assert law(stuck, "block_stays_up_to_the_critical_spin") == "failed"


def test_without_friction_nothing_turns_with_the_disc() -> None:
    run = turn(friction=0.0, cargo="block")
    on = np.logical_and.accumulate(distance(run, "outer/block") < run.specimen.disc - 2 * WIDE)
    way = plan(run, "outer/block")[0] + np.outer(run.t, run.velocity("outer/block")[0, :2])
    assert on.sum() > 20
    assert np.abs(plan(run, "outer/block") - way)[on].max() < 1e-12
    ball = turn(friction=0.0, cargo="ball", ball_speed=0.02)
    straight = ball.specimen.ball_start + np.outer(ball.t, (0.0, 0.02))
    assert np.abs(plan(ball, "ball/ball") - straight).max() < 1e-12


def test_weaker_gravity_lowers_the_critical_spin() -> None:
    run = nominal(19, DRAFT)
    spin = sqrt(run.specimen.friction * g / 2 / run.specimen.radius)
    stays, goes = (
        distance(run.again(cargo="block", spin=spin * part, gravity=g / 2), "outer/block")[-1] for part in (0.99, 1.01)
    )
    assert abs(stays - 0.55) < 1e-5
    assert goes > 0.6


def test_mass_does_not_matter_and_the_other_way_is_the_mirror_image() -> None:
    run = nominal(19, DRAFT).again(cargo="block", spin=3.0)
    heavy, right = run.again(density=2400.0), run.again(turning="right")
    assert np.abs(plan(heavy, "outer/block") - plan(run, "outer/block")).max() < 1e-9
    turned = [azimuth(r, "outer/block") - 0.6 for r in (run, right)]
    assert np.abs(turned[0] + turned[1]).max() < 1e-9


def test_a_tall_block_topples_before_it_slips() -> None:
    critical = sqrt(g / 3 / 0.55)
    for part, falls in ((0.995, False), (1.005, True)):
        run = turn(cargo="block", tall=3.0, friction=0.9, spin=critical * part)
        upright = 1 - 2 * (run.quaternion("outer/block")[:, 1:3] ** 2).sum(axis=1)
        assert (upright.min() < 0.9) == falls


def test_a_fast_disc_throws_its_blocks_off() -> None:
    run = turn(spin=8.0, radius=1.0, friction=0.9, ball_speed=0.3)
    assert run.position("outer/block")[-1, 2] < HEIGHT / 2
    assert not np.isnan(run.qpos).any()


@pytest.mark.parametrize("values", [{"radius": 0.2}, {"ball_speed": 0.5, "spin": 1.0}, {"radius": 0.3}])
def test_refuses_what_does_not_fit(values: dict[str, float]) -> None:
    with pytest.raises(Refusal, match=r"R1.*allowed"):
        turn(**values)


def test_the_texture_turns_with_the_disc() -> None:
    run = nominal(19, DRAFT)
    model, data = run.model, mujoco.MjData(run.model)
    data.qpos[:] = run.qpos[240]
    mujoco.mj_forward(model, data)
    stripe = data.geom("turntable/stripe").xpos
    assert np.arctan2(stripe[1], stripe[0]) == pytest.approx((2.5 + np.pi) % (2 * np.pi) - np.pi, abs=1e-9)


@pytest.mark.slow
def test_random_specimens() -> None:
    judge_random(UniformSurfaceSpin, count=3, seed=3)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    decided = judge_random(UniformSurfaceSpin, count=25, seed=4)
    assert min(decided.values()) >= 1
