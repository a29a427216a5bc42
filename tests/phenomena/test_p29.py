"""A seesaw out of balance: even turning, torques without heights and endless grip are found out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p29_seesaw_offset_pivot import HINGE, SeesawOffsetPivot
from physinone_mj.base import Refusal
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Matter, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random

SWINGS, ENERGY, SLIDES, ROLLS = SeesawOffsetPivot.laws()


class LevelOnly(SeesawOffsetPivot, domain="mechanics"):
    """Torques as if all weights were at the axle's height."""

    def build(self, scene: Scene) -> None:
        _, _, out = self.seesaw.moments(self.riders)
        mass = self.plank_mass + sum(r.mass for r in self.riders)
        SeesawOffsetPivot.make(**(self.values() | {"pivot": self.pivot + out / mass})).build(scene)


def slippery(friction: float) -> type[SeesawOffsetPivot]:
    """Friction that is not that of the surfaces."""

    class Slippery(SeesawOffsetPivot, domain="mechanics"):
        """One coefficient for all."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            for name, matter in scene.matter.items():
                scene.matter[name] = Matter(matter.density, Surface(friction=friction))

    return Slippery


def tip(cls: type[SeesawOffsetPivot] = SeesawOffsetPivot, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def test_turning_at_a_constant_rate_is_found_out() -> None:
    run = tip(start=0.0, friction=0.9)
    address, dof = run.model.joint(HINGE).qposadr[0], run.model.joint(HINGE).dofadr[0]
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    rate = (qpos[100, address] - qpos[0, address]) / run.t[100]
    qpos[:, address], qvel[:, dof] = qpos[0, address] + rate * run.t, rate
    even = dataclasses.replace(run, qpos=qpos, qvel=qvel)
    assert law(even, SWINGS) == law(even, ENERGY) == "failed"
    assert law(run, SWINGS) == law(run, ENERGY) == "passed"


def test_torques_of_a_level_plank_alone_are_found_out() -> None:
    run = tip(LevelOnly)
    assert law(run, SWINGS) == law(run, ENERGY) == "failed"


def test_endless_grip_is_found_out() -> None:
    assert law(tip(slippery(3.0)), SLIDES) == "failed"


def test_a_ball_that_glides_is_found_out() -> None:
    assert law(tip(slippery(0.0), rider="ball", start=0.3), ROLLS) == "failed"
    assert law(tip(rider="ball", start=0.3), ROLLS) == "passed"


def test_half_the_gravity_swings_it_down_more_slowly() -> None:
    run = nominal(29, DRAFT)
    low = run.again(gravity=9.80665 / 2)
    end = min(i.time for i in run.impacts)
    there = min(i.time for i in low.impacts)
    assert there / end == pytest.approx(np.sqrt(2), rel=1e-4)


def test_the_mirrored_seesaw_mirrors() -> None:
    run = nominal(29, DRAFT)
    s = run.specimen
    there = run.again(
        offset=-s.offset, start=-s.start, left=s.right, right=s.left, left_arm=s.right_arm, right_arm=s.left_arm
    )
    early = run.t < min(i.time for i in run.impacts)
    assert np.abs(there.joint(HINGE) + run.joint(HINGE))[early].max() < 1e-9
    gap = there.position("right/block") * [-1, 1, 1] - run.position("left/block")
    assert np.abs(gap[early]).max() < 1e-9


def test_the_light_side_is_thrown_up() -> None:
    run = nominal(29, DRAFT)
    gaps = run.specimen.gaps(run)
    end = min(i.time for i in run.impacts)
    assert np.abs(gaps[run.t < end]).max() < 1e-5
    assert gaps[:, 1].max() > 0.05
    assert gaps[:, 0].max() < 0.02


@pytest.mark.parametrize(
    "values",
    [
        {"restitution": 0.8, "left": 10.0, "right": 0.5},
        {"rider": "block", "length": 3.0, "left": 10.0, "offset": -0.4, "start": 0.0},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = tip(**values)
    assert not failed(run)
    low = min(run.position(body)[:, 2].min() for body in run.specimen.bodies)
    assert low > min(r.half for r in run.specimen.riders) - 1e-6


def test_balance_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R12: moments of ratio 1 .*allowed: 1.05 or more"):
        tip(offset=0.0, left=2.0, right=2.0, left_arm=0.6, right_arm=0.6)


def test_a_load_beyond_the_end_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R1: arm = 0.85: .*allowed: 0\.\d+"):
        tip(length=0.8, offset=0.4, right=10.0, right_arm=0.85)


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(SeesawOffsetPivot, count=2, seed=1)
    assert min(decided.values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(SeesawOffsetPivot, count=25, seed=4).values()) >= 12
