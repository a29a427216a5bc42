"""Block on a turntable: it leaves along the tangent, not along the radius; nothing kicks it, and a lip stops it."""

from __future__ import annotations

import dataclasses
from math import hypot, sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p41_rot_turntable_inertia import BODY, RELEASE, SIZE, RotTurntableInertia
from phenomena.spins import distance, plan
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random


def law(run: Run, name: str) -> str:
    return str(run.specimen.laws()[name].judge(run.specimen, run).verdict)


def fly(**values: Any) -> Run:
    return simulate_specimen(RotTurntableInertia.make(**values), fidelity=DRAFT)


def moved(run: Run, since: float, place: Any, velocity: Any) -> Run:
    """The run with another way of the block from a moment on: places and velocities (T, 2) in the plan."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    joint, late = run.model.joint("rider/free"), run.t > since
    q, v = joint.qposadr[0], joint.dofadr[0]
    qpos[late, q : q + 2], qvel[late, v : v + 2] = place[late], velocity[late]
    return dataclasses.replace(run, qpos=qpos, qvel=qvel)


def test_the_label_is_the_released_one() -> None:
    assert RotTurntableInertia.label == "RotTurnableInertia"


def test_an_ejection_along_the_radius_is_found_out() -> None:
    run = nominal(41, DRAFT)
    assert law(run, "released_puck_leaves_along_the_tangent") == "passed"

    def radially(**changes: Any) -> Run:
        twin = run.again(**changes)
        start, fast = twin.specimen.slide.start, np.linalg.norm(twin.specimen.slide.velocity)
        out = fast * start / np.linalg.norm(start)
        return moved(twin, RELEASE, start + np.outer(twin.t - RELEASE, out), np.tile(out, (len(twin), 1)))

    pseudo = dataclasses.replace(run, again_with=radially, _repeats={})
    assert law(pseudo, "released_puck_leaves_along_the_tangent") == "failed"


def test_a_kick_is_found_out() -> None:
    run = nominal(41, DRAFT)
    since = run.specimen.since
    i = int(np.argmax(run.t > since + 0.1))
    x, v = plan(run, BODY), run.velocity(BODY)[:, :2]
    kick = 0.2 * v[i]
    kicked = moved(run, run.t[i], x + np.outer(run.t - run.t[i], kick), v + kick)
    assert law(run, "slides_out_as_friction_says") == "passed"
    assert law(kicked, "slides_out_as_friction_says") == "failed"


def test_a_curved_flight_is_found_out() -> None:
    run = nominal(41, DRAFT)
    start = run.t[run.specimen.flight(run)][0]
    late = np.maximum(run.t - start, 0)[:, None]
    side = np.array([0.0, 0.5])
    curved = moved(run, start, plan(run, BODY) + late**2 / 2 * side, run.velocity(BODY)[:, :2] + late * side)
    assert law(run, "falls_on_a_parabola") == "passed"
    assert law(curved, "falls_on_a_parabola") == "failed"


def test_a_block_that_leaves_at_any_spin_is_found_out() -> None:
    run = nominal(41, DRAFT)

    def early(**changes: Any) -> Run:
        return run.again(**(changes | {"friction": 0.25}))

    loose = dataclasses.replace(run, again_with=early, _repeats={})
    assert law(loose, "block_slips_at_the_critical_spin") == "failed"


def test_the_table_drags_it_no_faster_than_itself_and_it_hits_the_box() -> None:
    run = nominal(41, DRAFT)
    air = run.specimen.flight(run)
    rim = run.joint_speed("turntable/hinge")[air][0] * run.specimen.rim
    assert hypot(*run.velocity(BODY)[air][0, :2]) < rim
    assert np.abs(run.velocity(BODY)[air][0, 1]) < 0.2 * run.velocity(BODY)[air][0, 0]
    shifted = run.position("target/block")
    assert np.linalg.norm(shifted[-1] - shifted[0]) > 0.05
    alone = run.again(target="none")
    same = run.t < min(
        i.time for i in run.impacts if "target/block" in (i.first, i.second) and BODY in (i.first, i.second)
    )
    assert np.abs(alone.position(BODY)[same] - run.position(BODY)[same]).max() < 1e-3


def test_a_lip_stops_the_block() -> None:
    run = fly(edge="raised", target="none", height=0.2, friction=0.25)
    r = distance(run, BODY)
    assert r.max() > run.specimen.radius + 0.02
    assert r[-1] < run.specimen.rim
    assert r[-1] == pytest.approx(r[-100], abs=1e-3)


def test_without_friction_a_speeding_table_does_not_move_the_block() -> None:
    run = fly(friction=0.0, first=0.0, rate=8.0, target="none")
    assert np.abs(run.position(BODY) - run.position(BODY)[0]).max() < 1e-12


def test_with_friction_enough_it_rides_on() -> None:
    run = fly(friction=0.9, top=3.0)
    assert np.ptp(distance(run, BODY)) < 1e-4
    assert "stays" in run.specimen.caption(run)


def test_half_the_gravity_lets_go_at_a_smaller_spin() -> None:
    spin = sqrt(0.3 * g / 2 / 0.36)
    for part, goes in ((0.98, False), (1.02, True)):
        run = fly(target="none", first=0.9 * spin, rate=0.3, top=spin * part).again(gravity=g / 2)
        assert (distance(run, BODY).max() > 1.001 * run.specimen.radius) == goes


def test_refuses_a_block_over_the_rim() -> None:
    with pytest.raises(Refusal, match=r"R1.*allowed: 0\.43"):
        fly(radius=0.45)


@pytest.mark.slow
def test_extremes() -> None:
    fast = fly(top=12.0, rate=8.0, first=8.0, radius=0.9, rim=1.0, height=1.0)
    assert not failed(fast)
    low = fly(height=0.05)
    assert low.position(BODY)[-1, 2] < 0.05 + SIZE[2]


@pytest.mark.slow
def test_random_specimens() -> None:
    judge_random(RotTurntableInertia, count=2, seed=3)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    decided = judge_random(RotTurntableInertia, count=25, seed=4)
    assert min(decided.values()) >= 1
