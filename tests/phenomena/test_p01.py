"""A ball against a wall: mirrored paths, wrong pair rules and soft friction are told from a true impact."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p01_moving_hits_fixed import MovingHitsFixed
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts


class OneBounceForAll(MovingHitsFixed, domain="mechanics"):
    """The same restitution whatever the surfaces."""

    def build(self, scene: Scene) -> None:
        MovingHitsFixed.make(**(self.values() | {"restitution": 0.7, "wall_restitution": 0.7})).build(scene)


class LivelierWins(MovingHitsFixed, domain="mechanics"):
    """The larger of two coefficients of restitution."""

    def build(self, scene: Scene) -> None:
        most = max(self.restitution, self.wall_restitution)
        MovingHitsFixed.make(**(self.values() | {"restitution": most, "wall_restitution": most})).build(scene)


class NoRestitution(MovingHitsFixed, domain="mechanics"):
    """What a contact without restitution gives."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name, matter in scene.matter.items():
            dead = dataclasses.replace(matter.surface, restitution=0.0)
            scene.matter[name] = dataclasses.replace(matter, surface=dead)


def hit(cls: type[MovingHitsFixed] = MovingHitsFixed, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


@pytest.mark.slow
def test_one_bounce_for_all_is_found_out() -> None:
    assert not failed(hit(OneBounceForAll, restitution=0.8, wall_restitution=0.6))
    assert "bounces_with_restitution" in failed(hit(OneBounceForAll, restitution=0.4, wall_restitution=0.6))


def test_the_wrong_pair_rule_is_found_out() -> None:
    assert "bounces_with_restitution" in failed(hit(LivelierWins, restitution=0.2, wall_restitution=0.8))


def test_no_restitution_is_found_out() -> None:
    assert {"bounces_with_restitution", "energy_is_lost_as_the_surfaces_say"} <= failed(hit(NoRestitution))


def test_a_slipping_contact_pushed_apart_is_found_out() -> None:
    """A convex friction cone adds μ × slip to the normal impulse: graze at 75° with μ = 0.3."""
    run = hit(incidence=1.309, friction=0.3, spin=0.0)
    when = run.impacts[0].time
    after = run.t > when
    start = run.model.joint("ball/free").dofadr[0]
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    extra = 0.3 * abs(qvel[after][0, start + 1])
    qvel[after, start] -= extra
    qpos[after, run.model.joint("ball/free").qposadr[0]] -= extra * (run.t[after] - when)
    lifted = dataclasses.replace(run, qpos=qpos, qvel=qvel, again_with=lambda **_: lifted, _repeats={})
    assert not failed(run)
    assert {"friction_turns_the_ball", "a_grazing_ball_slides"} <= failed(lifted)


def test_the_wall_three_centimetres_further() -> None:
    run = nominal(1, DRAFT)
    further = run.again(distance=run.specimen.distance + 0.03)
    later = further.impacts[0].time - run.impacts[0].time
    assert later == pytest.approx(0.03 / run.specimen.speed, rel=1e-9)


def test_a_path_played_back_is_found_out() -> None:
    run = nominal(1, DRAFT)
    claim = dataclasses.replace(run.specimen, distance=run.specimen.distance + 0.03)
    moved = dataclasses.replace(run, specimen=claim)
    assert "the_wall_stays" in failed(moved)


def test_the_mirrored_scene_mirrors() -> None:
    run = nominal(1, DRAFT)
    mirrored = run.again(spin=-run.specimen.spin)
    there = run.again(incidence=0.0)
    back = run.again(incidence=0.0, spin=-run.specimen.spin)
    y = there.position("ball/ball")[:, 1], back.position("ball/ball")[:, 1]
    assert np.abs(y[0] + y[1]).max() < 1e-9
    assert np.abs(y[0]).max() > 0.05
    assert np.abs(mirrored.position("ball/ball") - run.position("ball/ball")).max() > 0.05


def test_weight_does_not_matter() -> None:
    run = nominal(1, DRAFT)
    heavy = run.again(density=4 * run.specimen.density)
    assert np.abs(heavy.position("ball/ball") - run.position("ball/ball")).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {
            "speed": 6.0,
            "density": 21300.0,
            "restitution": 0.8,
            "wall_restitution": 0.8,
            "radius": 0.03,
            "distance": 3.0,
        },
        {"incidence": 1.309, "friction": 0.9, "spin": 100.0, "radius": 0.15},
        {"incidence": 1.309, "friction": 0.9, "spin": -100.0, "speed": 0.5},
        {"tilt": 1.0472, "friction": 0.1, "speed": 6.0},
        {"friction": 0.0, "spin": 100.0, "incidence": 0.0},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = hit(**values)
    assert not failed(run)
    assert verdicts(run)["bounces_with_restitution"] == "passed"


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(MovingHitsFixed)
    assert decided["bounces_with_restitution"] >= 10
    assert min(decided.values()) >= 4


def test_a_landing_too_slow_for_the_record_is_not_judged() -> None:
    """A wall that leans a little lifts the ball by so little that it has landed again before the next samples."""
    run = hit(
        speed=1.3794, incidence=1.0397, distance=0.6272, spin=35.4886, restitution=0.7537, wall_restitution=0.1798,
        friction=0.8766, tilt=0.0148, radius=0.121, density=162.7466,
    )  # fmt: skip
    assert 0 < run.specimen.back_after() < 0.02
    assert not failed(run)
