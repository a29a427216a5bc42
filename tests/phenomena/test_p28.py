"""A seesaw in balance: locked axles, level-only torques and hidden dampers are found out; extremes behave."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p28_seesaw_center_pivot import HINGE, SeesawCenterPivot
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

LEVEL, HEIGHTS, THIRD, SWINGS, TILTS, LAUNCH = SeesawCenterPivot.laws()


class LevelOnly(SeesawCenterPivot, domain="mechanics"):
    """Torques as if all weights were at the axle's height."""

    def build(self, scene: Scene) -> None:
        _, _, out = self.seesaw.moments(self.riders)
        mass = self.plank_mass + sum(r.mass for r in self.riders)
        SeesawCenterPivot.make(**(self.values() | {"pivot": self.pivot + out / mass})).build(scene)


class Locked(SeesawCenterPivot, domain="mechanics"):
    """The axle is stuck where the loads balance, or nearly."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint(HINGE).armature = 1e6


class Damped(SeesawCenterPivot, domain="mechanics"):
    """A hidden damper helps it to stay level."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint(HINGE).damping = [0.5, 0, 0]


def tip(cls: type[SeesawCenterPivot] = SeesawCenterPivot, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def test_torques_of_a_level_plank_alone_are_found_out() -> None:
    assert law(tip(LevelOnly, event="tilted", friction=0.9), HEIGHTS) == "failed"


def test_a_locked_axle_is_found_out() -> None:
    run = tip(Locked, event="added", weight=0.05)
    assert law(run, THIRD) == "failed"


def test_one_percent_more_tips_it() -> None:
    run = tip(event="added", weight=0.05, heavy=5.0)
    assert run.joint(HINGE).max() > 0.1
    assert law(run, THIRD) == "passed"


def test_a_hidden_damper_is_found_out() -> None:
    run = tip(Damped, event="added", pivot=0.3, friction=0.9, weight=0.1)
    assert law(run, THIRD) == law(run, SWINGS) == "failed"


def test_a_launch_that_forgets_the_planks_inertia_is_found_out() -> None:
    run = nominal(28, DRAFT)
    light, third = run.specimen.loads[0], run.specimen.third
    whole, _, _ = run.specimen.seesaw.moments([light, third])
    factor = whole / (whole - run.specimen.seesaw.plank.inertia)
    after = run.t > next(i.time for i in run.impacts)
    qvel = run.qvel.copy()
    qvel[after] *= factor
    fake = dataclasses.replace(run, qvel=qvel)
    assert law(fake, LAUNCH) == "failed"
    assert law(run, LAUNCH) == "passed"


def test_half_the_gravity_tips_it_more_slowly() -> None:
    run = tip(event="added", weight=0.5, friction=0.9)
    low = run.again(gravity=9.80665 / 2)
    t = run.t[run.t < 0.4]
    there = np.interp(t * np.sqrt(2), low.t, low.joint(HINGE))
    assert np.abs(there - run.joint(HINGE)[: len(t)]).max() < 1e-4


def test_without_a_third_weight_nothing_moves() -> None:
    run = tip(event="balance")
    assert np.abs(run.joint(HINGE)).max() < 1e-9
    assert np.abs(run.position("light/block") - run.position("light/block")[0]).max() < 1e-8


def test_loads_slide_where_the_slope_exceeds_friction() -> None:
    run = tip(event="tilted", friction=0.05)
    way = run.position("light/block")[:, 0]
    assert np.abs(way - way[0]).max() > 0.1


@pytest.mark.parametrize("pivot", [-0.05, 0.3])
def test_a_hundredfold_load_at_a_hundredth_of_the_arm(pivot: float) -> None:
    run = tip(event="balance", ratio=100.0, heavy=10.0, pivot=pivot)
    assert np.abs(run.joint(HINGE)).max() < 1e-6


def test_a_load_beyond_the_end_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R1: arm = 0.9: the lighter load .*allowed: 0\.\d+"):
        tip(length=0.8, arm=0.9, heavy=10.0, ratio=1.0, density=2000.0)


def test_a_load_without_room_is_refused() -> None:
    with pytest.raises(Refusal, match=r"no room for the third weight .*allowed: 0\.\d+"):
        tip(length=1.0, arm=0.6, heavy=8.0, ratio=1.0, weight=8.0, density=900.0)


def test_a_load_wider_than_the_plank_is_refused() -> None:
    with pytest.raises(Refusal, match=r"wider than the plank; allowed: \d+"):
        SeesawCenterPivot.make(heavy=10.0).seesaw.cube(20.0, 600.0, 0.5)


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(SeesawCenterPivot, count=3, seed=2)
    assert min(n for name, n in decided.items() if name != LAUNCH) == 3


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(SeesawCenterPivot, count=25, seed=3).values()) >= 4
