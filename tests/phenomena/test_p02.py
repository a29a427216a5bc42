"""A ball strikes what lies at rest: triggers, wrong pair rules and boxes that do not turn are found out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p02_moving_hits_stationary import CUE, MovingHitsStationary
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts


class LivelierWins(MovingHitsStationary, domain="mechanics"):
    """The larger of the two coefficients of restitution."""

    def build(self, scene: Scene) -> None:
        most = max(self.restitution, self.target_restitution)
        MovingHitsStationary.make(**(self.values() | {"restitution": most, "target_restitution": most})).build(scene)


class RougherWins(MovingHitsStationary, domain="mechanics"):
    """The larger coefficient of friction: the floor's own, twice the pair's."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        rough = dataclasses.replace(scene.matter["stage/floor"].surface, friction=4 * self.floor_friction)
        scene.matter["stage/floor"] = dataclasses.replace(scene.matter["stage/floor"], surface=rough)


def strike(cls: type[MovingHitsStationary] = MovingHitsStationary, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def altered(run: Run, change: Any) -> Run:
    """The run, and every twin of it, with what `change` makes of the motion after the first hit."""

    def one(r: Run) -> Run:
        qpos, qvel = r.qpos.copy(), r.qvel.copy()
        change(r, r.t > r.impacts[0].time, qpos, qvel)
        return dataclasses.replace(r, qpos=qpos, qvel=qvel, again_with=lambda **c: one(r.again(**c)), _repeats={})

    return one(run)


def test_a_target_set_off_by_a_trigger_is_found_out() -> None:
    """The struck ball goes as it should; the rolling one does not feel it."""

    def trigger(run: Run, after: Any, qpos: Any, qvel: Any) -> None:
        v, x = run.model.joint("cue/free").dofadr[0], run.model.joint("cue/free").qposadr[0]
        start = qvel[0, v : v + 3]
        qpos[after, x : x + 3] = qpos[0, x : x + 3] + start * run.t[after, None]
        qvel[after, v : v + 3] = start

    fake = altered(strike(floor_friction=0.0), trigger)
    assert {"momentum_is_kept", "velocities_after_the_hit"} <= failed(fake)


@pytest.mark.slow
def test_a_box_that_does_not_turn_is_found_out() -> None:
    def stiff(run: Run, after: Any, qpos: Any, qvel: Any) -> None:
        v, x = run.model.joint("target/free").dofadr[0], run.model.joint("target/free").qposadr[0]
        qpos[after, x + 3 : x + 7] = [1, 0, 0, 0]
        qvel[after, v + 3 : v + 6] = 0.0

    fake = altered(strike(target="box", floor_friction=0.0), stiff)
    assert failed(fake) == {"a_box_struck_off_centre_turns"}


def test_the_wrong_rule_for_restitution_is_found_out() -> None:
    run = strike(LivelierWins, restitution=0.9, target_restitution=0.3)
    assert {"velocities_after_the_hit", "a_box_struck_off_centre_turns"} <= failed(run)
    assert verdicts(run)["momentum_is_kept"] == "passed"


@pytest.mark.slow
def test_the_wrong_rule_for_friction_is_found_out() -> None:
    assert failed(strike(RougherWins)) == {"the_floor_brakes_what_was_struck"}


def test_momentum_of_every_frame_until_the_next_hit() -> None:
    run = strike(floor_friction=0.0, target_density=1700.0)
    end = run.impacts[1].time if len(run.impacts) > 1 else run.t[-1]
    total = run.specimen.momentum(run)[run.t < end]
    assert np.abs(total - total[0]).max() < 1e-12 * np.abs(total[0]).max()


def test_without_the_target_the_ball_rolls_on() -> None:
    run = nominal(2, DRAFT)
    before = run.t < run.impacts[0].time
    expected = run.position(CUE)[0, 0] + run.specimen.speed * run.t[before]
    assert np.abs(run.position(CUE)[before, 0] - expected).max() < 1e-10


def test_the_mirrored_scene_mirrors() -> None:
    run = nominal(2, DRAFT)
    there = run.again(offset=-run.specimen.offset)
    early = run.t < run.impacts[0].time + 0.3
    for body in (CUE, "target/ball"):
        gap = there.position(body)[early] - run.position(body)[early] * [1, -1, 1]
        assert np.abs(gap).max() < 1e-9


def test_density_of_both_does_not_matter() -> None:
    run = nominal(2, DRAFT)
    dense = run.again(density=2 * run.specimen.density, target_density=2 * run.specimen.target_density)
    early = run.t < run.impacts[0].time + 0.3
    assert np.abs(dense.position("target/ball")[early] - run.position("target/ball")[early]).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"density": 21300.0, "target_density": 100.0, "speed": 6.0},
        {"density": 100.0, "target_density": 21300.0, "target": "box", "offset": 0.9},
        {"target": "box", "offset": -0.9, "floor_friction": 0.3, "speed": 6.0, "radius": 0.03},
        {"offset": 0.9, "speed": 0.5, "restitution": 0.1, "target_restitution": 0.1, "floor_friction": 0.3},
        {"offset": 0.0, "restitution": 1.0, "target_restitution": 1.0, "target_density": 1700.0},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    assert not failed(strike(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(MovingHitsStationary, count=8).values()) >= 6
