"""The climb up the plank against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import cos, sin, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from phenomena.p12_roll_up_slope import BETA, RACERS, RollUpSlope
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Matter, Scene
from physinone_mj.simulate import simulate_specimen

from .verdicts import judge_random

CLIMB, BACK, FOOT = "climbs_higher_the_more_it_turns", "comes_back_as_fast", "the_foot_of_the_plank_takes_its_share"


def climb(cls: type[RollUpSlope] = RollUpSlope, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


@pytest.fixture(scope="module")
def floor() -> Run:
    return climb()


@pytest.fixture(scope="module")
def rolling() -> Run:
    return climb(start="plank")


def keyframed(run: Run, slowing: ArrayLike, speeding: ArrayLike) -> Run:
    """Racers moved up the slope with one deceleration and down it with another acceleration, always rolling."""
    specimen: RollUpSlope = run.specimen  # type: ignore[assignment]
    up, _ = specimen.axes()
    qpos, qvel = run.qpos.copy(), np.zeros_like(run.qvel)
    for racer, down, back in zip(RACERS, np.broadcast_to(slowing, 4), np.broadcast_to(speeding, 4), strict=True):
        joint = run.model.joint(f"{racer.template}/free")
        q, v = joint.qposadr[0], joint.dofadr[0]
        top = specimen.speed / down
        rest = np.where(run.t < top, down, back) * (run.t - top)
        pace, way = -rest, specimen.speed * top / 2 - rest * (run.t - top) / 2
        qpos[:, q : q + 3] = run.qpos[0, q : q + 3] + way[:, None] * up
        qvel[:, v : v + 3] = pace[:, None] * up
        qvel[:, v + 4] = -pace / specimen.radius
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, again_with=run.again, _repeats={})


class Smooth(RollUpSlope, domain="mechanics"):
    """The plank, not the floor, is without friction whatever is asked for."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name in ("ramp/slope", *(racer.contact for racer in RACERS)):
            scene.matter[name] = Matter(scene.matter[name].density, Surface())
        scene.matter["stage/floor"] = Matter(2000.0, Surface(friction=2 * self.friction))


class Springy(RollUpSlope, domain="mechanics"):
    """Racers that bounce off the plank's foot."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.matter["ramp/slope"] = Matter(700.0, Surface(friction=self.friction, restitution=0.5))


class Unturned(RollUpSlope, domain="mechanics"):
    """All racers have the moment of inertia of a solid ball."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for racer in RACERS:
            body = scene.spec.body(racer.body)
            body.inertia = body.mass * self.radius**2 * np.full(3, 2 / 5)


def test_the_fabricated_truth_is_not_told_from_the_truth(rolling: Run) -> None:
    true = g * sin(rolling.specimen.angle) / (1 + BETA)
    assert [judge(keyframed(rolling, true, true), law) for law in (CLIMB, BACK)] == ["passed"] * 2


def test_friction_against_the_motion_is_found_out(rolling: Run) -> None:
    """On the way up it would shorten the climb, and the return would be slower."""
    pull, drag = g * sin(rolling.specimen.angle), 0.1 * g * cos(rolling.specimen.angle)
    braked = keyframed(rolling, pull + drag, pull - drag)
    assert judge(braked, CLIMB) == judge(braked, BACK) == "failed"


def test_climbing_as_if_nothing_turned_is_found_out(rolling: Run) -> None:
    point = keyframed(rolling, g * sin(rolling.specimen.angle), g * sin(rolling.specimen.angle))
    assert judge(point, CLIMB) == "failed"


def test_one_shape_for_all_is_found_out() -> None:
    assert judge(climb(Unturned, start="plank"), CLIMB) == "failed"


def test_a_foot_that_takes_nothing_is_found_out(floor: Run) -> None:
    gentle = dataclasses.replace(floor, qvel=floor.qvel.copy(), _repeats={})
    specimen: RollUpSlope = floor.specimen  # type: ignore[assignment]
    after = floor.t > specimen.begins(floor).max()
    gentle.qvel[after] *= 1.01
    assert judge(gentle, FOOT) == "failed"


@pytest.mark.parametrize("lazy", [Smooth, Springy])
def test_a_foot_that_takes_something_else_is_found_out(lazy: type[RollUpSlope]) -> None:
    assert judge(climb(lazy), FOOT) != "passed"


def test_friction_points_up_the_slope_while_they_climb(rolling: Run) -> None:
    """m a + m g sin α is what friction adds: β/(1 + β) m g sin α, upwards, on the way up and on the way down."""
    specimen: RollUpSlope = rolling.specimen  # type: ignore[assignment]
    pull = g * sin(specimen.angle)
    for pace, beta in zip(specimen.pace(rolling), BETA, strict=True):
        early = slice(0, 60)
        friction = np.gradient(pace, rolling.t)[early] + pull
        assert friction == pytest.approx(np.full(60, beta / (1 + beta) * pull), rel=1e-6)


def test_half_the_gravity_doubles_the_way_up(rolling: Run) -> None:
    specimen: RollUpSlope = rolling.specimen  # type: ignore[assignment]
    light = rolling.again(gravity=g / 2)
    early = light.t < rolling.t[-1] / 2.2
    there, here = specimen.way(light)[:, early], specimen.way(rolling)
    index = np.searchsorted(rolling.t, light.t[early] / 2)
    assert there[:, ::2] - there[:, :1] == pytest.approx(2 * (here[:, index[::2]] - here[:, :1]), abs=0.02)


def test_the_foot_is_met_when_it_should(floor: Run) -> None:
    specimen: RollUpSlope = floor.specimen  # type: ignore[assignment]
    assert specimen.begins(floor) == pytest.approx((0.5 - specimen.foot) / specimen.speed, rel=1e-8)


def test_racers_stay_in_their_lanes_and_on_the_plank(floor: Run) -> None:
    specimen: RollUpSlope = floor.specimen  # type: ignore[assignment]
    _, normal = specimen.axes()
    climbing = (floor.t > specimen.begins(floor).max()) & (floor.t < specimen.begins(floor).min() + 1.0)
    for racer in RACERS:
        assert np.ptp(floor.position(racer.body)[:, 1]) < 1e-9
        assert floor.position(racer.body)[climbing] @ normal == pytest.approx(specimen.radius, abs=1e-7)


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"angle": 0.6981, "speed": 4.0, "friction": 0.9}, FOOT),
        ({"angle": 0.0873, "speed": 1.0, "start": "plank", "radius": 0.02}, CLIMB),
        ({"angle": 0.6981, "speed": 1.0, "start": "plank", "spin": 0.0}, "without_spin_friction_brakes_first"),
        ({"angle": 0.6981, "speed": 4.0, "friction": 0.0, "start": "plank"}, "without_friction_all_climb_alike"),
    ],
)
def test_extremes(values: dict[str, Any], law: str) -> None:
    assert judge(climb(**values), law) == "passed"


def test_too_far_up_is_refused() -> None:
    highest = 1.6 * sqrt(3.0 / float(RollUpSlope.make(speed=1.6).climbs()[0].max()))
    with pytest.raises(Refusal, match=rf"R12.*hoop climbs .* m; allowed: 3\.0 m, here at {highest:.3g} m/s"):
        climb(speed=3.5)
    climb(speed=0.999 * highest)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(RollUpSlope, count=2, seed=12).values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(RollUpSlope, count=25, seed=1).values()) >= 15
