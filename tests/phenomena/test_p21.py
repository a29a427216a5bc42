"""Coarse ground: wrong laws of friction are told from Coulomb's, and the ends of the range behave."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p21_friction_stop import BRICK, FrictionStop
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random


class Viscous(FrictionStop, domain="mechanics"):
    """Slows down in proportion to the speed."""

    def build(self, scene: Scene) -> None:
        FrictionStop.make(**(self.values() | {"friction": 0.0, "rough": 0.0, "smooth": 0.0})).build(scene)
        for joint in scene.spec.joints:
            joint.damping = [0.5, 0, 0]


class HeavyStopsSooner(FrictionStop, domain="mechanics"):
    """Friction that grows with the mass."""

    def build(self, scene: Scene) -> None:
        rough = min(self.rough * (self.density / 1900.0) ** 0.1, 0.9)
        FrictionStop.make(**(self.values() | {"rough": rough})).build(scene)


class RougherWins(FrictionStop, domain="mechanics"):
    """The rule of the larger coefficient."""

    def build(self, scene: Scene) -> None:
        most = max(self.friction, self.rough)
        FrictionStop.make(**(self.values() | {"friction": most, "rough": most, "smooth": most})).build(scene)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def lane(cls: type[FrictionStop] = FrictionStop, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def test_a_viscous_ground_is_found_out() -> None:
    run = lane(Viscous)
    assert law(run, "speed_falls_evenly") == law(run, "bricks_stop_where_friction_says") == "failed"


def test_a_stop_that_depends_on_the_mass_is_found_out() -> None:
    run = lane(HeavyStopsSooner)
    assert law(run, "bricks_stop_where_friction_says") == "passed"
    assert law(run, "weight_and_face_do_not_matter") == "failed"


def test_the_rule_of_the_larger_coefficient_is_found_out() -> None:
    run = lane(RougherWins)
    assert law(run, "both_surfaces_count_alike") == law(run, "bricks_stop_where_friction_says") == "failed"


def test_a_hop_is_found_out() -> None:
    run = nominal(21, DRAFT)
    qpos = run.qpos.copy()
    height = run.model.joint("first/free").qposadr[0] + 2
    qpos[5:15, height] += 1e-3 * np.sin(np.linspace(0, np.pi, 10))
    hopped = dataclasses.replace(run, qpos=qpos)
    assert law(hopped, "nothing_hops") == "failed"
    assert law(run, "nothing_hops") == "passed"


def test_creep_is_found_out() -> None:
    run = nominal(21, DRAFT)

    def creeping(**changes: Any) -> Run:
        twin = run.again(**changes)
        qpos = twin.qpos.copy()
        qpos[:, twin.model.joint("resting/free").qposadr[0]] += 0.011 * twin.t / 5
        return dataclasses.replace(twin, qpos=qpos)

    soft = dataclasses.replace(run, again_with=creeping, _repeats={})
    assert law(soft, "held_brick_does_not_creep") == law(soft, "plank_lets_go_at_the_angle_of_repose") == "failed"


def test_half_the_gravity_doubles_the_way() -> None:
    run = nominal(21, DRAFT)
    low = run.again(gravity=9.80665 / 2, speed=1.0)
    full = run.again(speed=1.0)
    ways = [r.specimen.slid(r, "first/block")[-1] for r in (low, full)]
    assert ways[0] / ways[1] == pytest.approx(2.0, rel=1e-4)


def test_without_friction_it_slides_for_ever() -> None:
    run = lane(friction=0.0, rough=0.0, smooth=0.0, speed=0.5, tilt=0.05)
    first = min(i.time for i in run.impacts)
    free = run.t < first
    assert free.sum() > 200
    assert np.abs(run.velocity("first/block")[free, 0] - 0.5).max() < 1e-12
    assert np.abs(run.spin("ball/ball")[free]).max() < 1e-12


def test_a_tall_brick_topples_and_does_not_hop() -> None:
    run = lane(stance="end", friction=0.9, rough=0.9, speed=1.5, tilt=0.05)
    height = run.position("first/block")[:, 2] - 0.001
    tallest = np.hypot(BRICK[0], BRICK[2])
    assert height.max() < tallest + 1e-5
    axis = 1 - 2 * (run.quaternion("first/block")[:, 1] ** 2 + run.quaternion("first/block")[:, 2] ** 2)
    assert axis.min() < 0.99


def test_the_brick_on_a_steep_plank_slides_to_its_foot() -> None:
    run = lane(tilt=0.8)
    way = run.position("resting/block")
    assert 0.4 < np.linalg.norm(way[-1] - way[0]) < 0.8
    assert np.linalg.norm(run.velocity("resting/block")[-1]) < 1e-6


@pytest.mark.slow
def test_extremes() -> None:
    assert not failed(lane(speed=4.0, friction=0.9, rough=0.9, smooth=0.9, density=21300.0))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(FrictionStop, count=3, seed=14)
    assert min(decided.values()) >= 1
