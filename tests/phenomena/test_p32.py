"""Balloons and a basket: programs that only look right are told from the true one; the corners of the range hold."""

from __future__ import annotations

import dataclasses
from math import sqrt
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p32_balloon_lift import BalloonLift
from physinone_mj.base import Refusal
from physinone_mj.effects import Buoyancy
from physinone_mj.fidelity import DRAFT
from physinone_mj.measure import accelerations
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

LIFTS, NUMBER = "lifts_what_weighs_less_than_all_lift", "takes_a_certain_number"
STARTS, ENDS = "starts_with_what_is_to_spare", "ends_with_the_speed_of_balance"
CARRY = "threads_carry_the_load"


class AlwaysUp(BalloonLift, domain="mechanics"):
    """As many newtons to spare, however many balloons there are and whatever the load."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.body(self.load).gravcomp = 1.0 + 0.15 / (self.payload * 9.80665)
        scene.effects = [
            Buoyancy(tuple(dataclasses.replace(f, volume=f.volume * self._weightless) for f in e.floats), e.density)
            for e in scene.effects
            if isinstance(e, Buoyancy)
        ]

    @property
    def _weightless(self) -> float:
        """Factor of volume at which a balloon floats without lift."""
        air = 1.225 * self.balloon.volume
        return (self.balloon.inertia) / (1.5 * air)


class WeightlessAir(BalloonLift, domain="mechanics"):
    """The air makes way at no cost."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name in self.balloons():
            scene.spec.body(name).mass = self.balloon.mass
        (air,) = scene.effects
        assert isinstance(air, Buoyancy)
        scene.effects = [Buoyancy(tuple(dataclasses.replace(f, added=0.0) for f in air.floats), air.density)]


class NoDrag(BalloonLift, domain="mechanics"):
    """Rises faster and faster."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        (air,) = scene.effects
        assert isinstance(air, Buoyancy)
        scene.effects = [Buoyancy(tuple(dataclasses.replace(f, drag_area=0.0) for f in air.floats), air.density)]


def judge(run: Run, *laws: str) -> set[str]:
    return {run.specimen.laws()[law].judge(run.specimen, run).verdict for law in laws}


def lift(cls: type[BalloonLift] = BalloonLift, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def hoisted(run: Run) -> Run:
    """The picture of the start, moved upwards as a whole at a steady half metre per second squared."""
    qpos, qvel = np.tile(run.qpos[0], (len(run), 1)), np.zeros_like(run.qvel)
    for j in range(run.model.njnt):
        if run.model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
            qpos[:, run.model.jnt_qposadr[j] + 2] += 0.25 * run.t**2
            qvel[:, run.model.jnt_dofadr[j] + 2] = 0.5 * run.t
    return dataclasses.replace(
        run, qpos=qpos, qvel=qvel, impacts=(), again_with=lambda **changes: hoisted(run.again(**changes)), _repeats={}
    )


def test_a_group_that_is_moved_upwards_is_found_out() -> None:
    assert judge(hoisted(nominal(32, DRAFT)), LIFTS, NUMBER, STARTS, ENDS, CARRY) == {"failed"}


def test_a_lift_that_does_not_count_is_found_out() -> None:
    assert judge(lift(AlwaysUp), LIFTS, NUMBER, STARTS, CARRY) == {"failed"}


def test_air_that_does_not_resist_is_found_out() -> None:
    run = lift(WeightlessAir, threads="parallel", slack=0.0)
    assert judge(run, STARTS) == {"failed"}
    assert judge(run, ENDS, LIFTS) == {"passed"}


def test_rising_without_drag_is_found_out() -> None:
    assert judge(lift(NoDrag), ENDS, CARRY) == {"failed"}


def test_half_the_gravity_takes_root_two_as_long() -> None:
    """Side by side and taut from the start, nothing but gravity sets the pace."""
    run = lift(threads="parallel", slack=0.0)
    slow = run.again(gravity=9.80665 / 2)
    climbed = [np.interp(0.2, run.specimen.height(one), one.t) for one in (run, slow)]
    assert climbed[1] / climbed[0] == pytest.approx(sqrt(2), rel=1e-3)


def test_every_thread_pulls_along_itself_with_its_share() -> None:
    """Σ Tᵢ ûᵢ = M (a + g), each tension from its own balloon's motion."""
    run = lift(threads="parallel", slack=0.0)
    specimen = run.specimen
    balloon, part = specimen.balloon, slice(24, 400)
    total = 0.0
    for body in specimen.balloons():
        z, v = run.position(body)[part, 2], run.velocity(body)[part, 2]
        own = balloon.lift - balloon.resistance * v[2:-2] ** 2
        total = total + own - balloon.inertia * accelerations(run.t[part], z, v)
    z, v = run.position(specimen.load)[part, 2], run.velocity(specimen.load)[part, 2]
    carried = specimen.payload * (accelerations(run.t[part], z, v) + 9.80665)
    assert np.abs(total / carried - 1).max() < 1e-4


def test_threads_are_never_longer_than_they_are() -> None:
    run = nominal(32, DRAFT)
    spans = run.specimen.spans(run) / run.specimen.length
    assert spans.max() < 1.001
    assert (spans.max(axis=0) > 1 - 1e-6).all(), "every one was taut once"
    assert spans[0].max() < 0.7


def test_balloons_do_not_overlap() -> None:
    run = nominal(32, DRAFT)
    places = np.stack([run.position(body) for body in run.specimen.balloons()])
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)[~np.eye(7, dtype=bool)]
    assert apart.min() > 2 * run.specimen.radius * (1 - 1e-3)


def test_collisions_do_not_give_energy() -> None:
    """Energy, work against drag aside, falls: kinetic, weight and lift together."""
    run = nominal(32, DRAFT)
    energy = run.motion.kinetic + run.motion.potential
    assert np.diff(energy).max() < 1e-3 * np.ptp(energy)


def test_too_few_stay_on_the_ground() -> None:
    run = lift(count=4, payload=0.06)
    assert abs(run.specimen.height(run)[-1]) < 1e-3
    assert 0.05 < run.specimen.height(run).max() < 0.3, "the tug of the threads makes it hop"
    assert "comes back to the ground" in run.specimen.caption(run)
    calm = lift(count=4, payload=0.06, threads="parallel", slack=0.0)
    assert np.abs(calm.specimen.height(calm)).max() < 1e-8
    assert "stays on the ground" in calm.specimen.caption(calm)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"radius": 0.12, "gas": 0.4, "skin": 0.006}, "allowed: a fifth of their weight"),
        ({"count": 12, "radius": 0.18, "length": 0.5, "slack": 0.4}, "no room above the basket; allowed: less of it"),
    ],
)
def test_refusals(values: dict[str, Any], reason: str) -> None:
    with pytest.raises(Refusal, match=reason):
        lift(**values)


@pytest.mark.parametrize(
    "values",
    [
        {"count": 12, "radius": 0.18, "length": 1.2, "slack": 0.4, "payload": 0.1, "gas": 0.09, "drag": 0.2},
        {"count": 2, "payload": 0.01, "slack": 0.4},
        {"count": 12, "radius": 0.13, "payload": 0.05, "slack": 0.0},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = lift(**values)
    assert judge(run, CARRY) == {"passed"}
    assert run.specimen.spans(run).max() < 1.02 * run.specimen.length


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(BalloonLift, 4, seed=1).values()) >= 1


@pytest.mark.slow
def test_more_random_specimens() -> None:
    assert min(judge_random(BalloonLift, 25).values()) >= 8
