"""Two balls in the air: bounces off invisible walls and lost spin are told from a collision."""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p03_moving_hits_moving import FIRST, SECOND, MovingHitsMoving
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts


class SameBounce(MovingHitsMoving, domain="mechanics"):
    """The same restitution whatever is asked for."""

    def build(self, scene: Scene) -> None:
        MovingHitsMoving.make(**(self.values() | {"restitution": 0.5})).build(scene)


def meet(cls: type[MovingHitsMoving] = MovingHitsMoving, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def replayed(run: Run, kick: Any) -> Run:
    """The run with velocities of both balls changed by `kick` from the meeting on, in free flight."""
    when = run.impacts[0].time
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    after = run.t > when
    for body in (FIRST, SECOND):
        joint = run.model.joint(body.replace("/ball", "/free"))
        change = kick(body)
        v, x = joint.dofadr[0], joint.qposadr[0]
        qvel[after, v : v + len(change)] += change
        qpos[after, x : x + 3] += change[:3] * (run.t[after, None] - when)
    return dataclasses.replace(run, qpos=qpos, qvel=qvel)


def test_balls_that_reflect_off_an_invisible_wall_are_found_out() -> None:
    """Each turns round as if the other were a wall: right relative speed, wrong momentum."""
    run = meet(crossing=np.pi, offset=0.0, friction=0.0, restitution=0.8, second_density=5000.0)
    there = run.specimen
    (_, u1), (_, u2), _ = there.sides(run)
    walls = {FIRST: -0.8 * there.headings[0] - u1, SECOND: -0.8 * there.headings[1] - u2}
    fake = replayed(run, walls.get)
    assert not failed(run)
    assert "centre_of_mass_goes_on" in failed(fake)
    assert verdicts(fake)["separates_with_restitution"] == "passed"


def test_spin_lost_at_a_rough_hit_is_found_out() -> None:
    run = nominal(3, DRAFT)
    spin = {b: np.array([0, 0, 0, *(-run.qvel[run.t > run.impacts[0].time][0][slice(*s)])]) for b, s in
            ((FIRST, (3, 6)), (SECOND, (9, 12)))}  # fmt: skip
    assert mujoco.mj_id2name(run.model, mujoco.mjtObj.mjOBJ_JOINT, 0) == "first/free"
    fake = replayed(run, spin.get)
    assert "angular_momentum_is_kept" in failed(fake)
    assert verdicts(fake)["centre_of_mass_goes_on"] == "passed"


@pytest.mark.slow
def test_one_bounce_for_all_is_found_out() -> None:
    assert "separates_with_restitution" in failed(meet(SameBounce, restitution=0.7))
    assert not failed(meet(SameBounce, restitution=0.5))


def test_they_meet_when_and_where_they_were_aimed() -> None:
    run = nominal(3, DRAFT)
    hit = run.impacts[0]
    one, _ = run.specimen.centres
    assert hit.time == pytest.approx(0.45, rel=1e-8)
    assert np.array(hit.position) == pytest.approx(one + run.specimen.first_radius * run.specimen.line, abs=1e-8)


def test_without_the_second_ball_the_first_flies_on() -> None:
    run = nominal(3, DRAFT)
    miss = run.again(boost=(0.0, 0.0, 0.0), second_radius=0.03, offset=0.9, friction=0.0, second_density=100.0)
    before = miss.t < miss.impacts[0].time
    t = miss.t[before]
    start = miss.position(FIRST)[0]
    free = start + miss.velocity(FIRST)[0] * t[:, None] - [0, 0, 9.80665 / 2] * t[:, None] ** 2
    assert np.abs(miss.position(FIRST)[before] - free).max() < 1e-12


def test_the_mirrored_scene_mirrors() -> None:
    one = meet(first_speed=2.0, second_speed=2.0, offset=0.3, first_radius=0.08, second_radius=0.08,
               first_density=900.0, second_density=900.0)  # fmt: skip
    two = one.again(offset=-0.3)
    early = one.t < 0.9
    mirror = np.array([1.0, -1.0, 1.0])
    assert np.abs(one.position(FIRST)[early] - mirror * two.position(SECOND)[early]).max() < 1e-9


def test_equal_and_opposite_and_dull_they_stop() -> None:
    run = meet(first_speed=5.0, second_speed=5.0, crossing=np.pi, offset=0.0, restitution=0.1, friction=0.0,
               first_radius=0.08, second_radius=0.08, first_density=900.0, second_density=900.0)  # fmt: skip
    just = np.searchsorted(run.t, run.impacts[0].time) + 1
    assert np.abs(run.velocity(FIRST)[just, 1]) == pytest.approx(0.5, rel=1e-8)
    assert np.abs(run.momentum(FIRST) + run.momentum(SECOND))[just, :2].max() < 1e-9


def test_too_slow_to_start_apart_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R1.*allowed"):
        meet(first_speed=2.0, second_speed=2.0, crossing=0.1)


def test_a_mass_ratio_beyond_ten_thousand_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R3.*allowed"):
        meet(first_density=21300.0, first_radius=0.12, second_density=100.0, second_radius=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"first_speed": 5.0, "second_speed": 5.0, "crossing": np.pi, "first_radius": 0.03, "second_radius": 0.03},
        {"crossing": 0.0, "first_speed": 5.0, "second_speed": 0.3, "offset": 0.9, "friction": 0.9},
        {"first_density": 21300.0, "first_radius": 0.12, "second_density": 100.0, "second_radius": 0.04},
        {"first_speed": 0.3, "second_speed": 0.8, "crossing": 0.0, "restitution": 0.8},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    assert set(verdicts(meet(**values)).values()) == {"passed"}


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(MovingHitsMoving).values()) >= 8
