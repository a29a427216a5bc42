"""Bowl that speeds up: a ball that knows no history and a cube that knows no start are found out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.bowls import centre, polar, ridden_angle
from phenomena.p18_accel_concave_spin import BALL, CUBE, AccelConcaveSpin
from phenomena.spins import azimuth
from physinone_mj.base import NotEvaluated, Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random


def law(run: Run, name: str) -> str:
    return str(run.specimen.laws()[name].judge(run.specimen, run).verdict)


def spin(**values: Any) -> Run:
    return simulate_specimen(AccelConcaveSpin.make(**values), fidelity=DRAFT)


def steady(run: Run) -> Run:
    """The run with the ball always where it would ride if the spin of the moment were for ever."""
    qpos, q = run.qpos.copy(), run.model.joint("ball/free").qposadr[0]
    own = run.specimen
    theta = np.array([ridden_angle(own.radius, own.size, w) for w in run.joint_speed("bowl/hinge")])
    turned = run.joint("bowl/hinge")
    n = np.column_stack([np.sin(theta) * np.cos(turned), np.sin(theta) * np.sin(turned), -np.cos(theta)])
    qpos[:, q : q + 3] = centre(own.radius) + own.reach * n
    return dataclasses.replace(run, qpos=qpos)


def test_a_ball_without_history_is_found_out() -> None:
    run = nominal(18, DRAFT)
    fake = dataclasses.replace(run, again_with=lambda **changes: steady(run.again(**changes)), _repeats={})
    assert law(run, "ball_rolls_as_the_bowl_drags_it") == "passed"
    assert law(fake, "ball_rolls_as_the_bowl_drags_it") == "failed"


@pytest.mark.slow
def test_a_cube_that_knows_the_spin_alone_is_found_out() -> None:
    run = nominal(18, DRAFT)

    def unhurried(**changes: Any) -> Run:
        changes["rate"] = min(changes["rate"], 1.0)
        twin = run.again(**changes)
        return dataclasses.replace(twin, specimen=twin.specimen)

    fake = dataclasses.replace(run, again_with=unhurried, _repeats={})
    assert law(run, "too_quick_a_start_leaves_it_behind") == "passed"
    assert law(fake, "too_quick_a_start_leaves_it_behind") == "failed"


def test_another_friction_is_found_out() -> None:
    run = nominal(18, DRAFT)
    other = dataclasses.replace(run, again_with=lambda **c: run.again(**({"friction": 0.37} | c)), _repeats={})
    assert law(run, "cube_slips_up_at_the_critical_spin") == "passed"
    assert law(other, "cube_slips_up_at_the_critical_spin") == "failed"


def test_a_kick_at_the_rim_is_found_out() -> None:
    run = nominal(18, DRAFT)

    def kicked(**changes: Any) -> Run:
        twin = run.again(**changes)
        qvel, v = twin.qvel.copy(), twin.model.joint("ball/free").dofadr[0]
        qvel[polar(twin, BALL, 0.3) > twin.specimen.rim, v : v + 3] *= 1.2
        return dataclasses.replace(twin, qvel=qvel)

    fake = dataclasses.replace(run, again_with=kicked, _repeats={})
    assert law(run, "leaves_along_the_wall_and_falls") == "passed"
    assert law(fake, "leaves_along_the_wall_and_falls") == "failed"


def test_the_cube_sits_slips_and_leaves() -> None:
    run = nominal(18, DRAFT)
    theta = polar(run, CUBE, 0.3)
    assert np.ptp(theta[run.t < run.specimen.slips - 0.05]) < 1e-2
    assert theta.max() > run.specimen.rim
    assert run.position(CUBE)[-1, 2] < 0.05
    assert np.hypot(*run.position(CUBE)[-1, :2]) > 0.35


def test_an_abrupt_start_leaves_the_cube_behind() -> None:
    run = spin(cargo="cube", rate=100.0)
    soon = run.t < 0.1
    turned = run.joint("bowl/hinge")[soon][-1]
    assert (azimuth(run, CUBE) - azimuth(run, CUBE)[0])[soon][-1] < 0.75 * turned


def test_a_cube_that_its_weight_all_but_moves_is_not_judged() -> None:
    """It would slip down, and stay behind by nothing; the law is that of one that stays behind."""
    law = AccelConcaveSpin.laws()["too_quick_a_start_leaves_it_behind"]
    with pytest.raises(NotEvaluated, match="its weight alone all but moves the cube"):
        law.measure(AccelConcaveSpin.make(friction=0.1395, angle=0.1329), nominal(18, DRAFT))


@pytest.mark.parametrize(("edge", "angle", "friction"), [(0.1, 0.08, 0.15), (0.1, 0.12, 0.3)])
def test_a_cube_beside_the_axis_has_to_turn_itself(edge: float, angle: float, friction: float) -> None:
    """Where h is .66 and .44 of ρ: as a point it would hold up to 7 and 3 % more."""
    run = spin(cargo="cube", edge=edge, angle=angle, friction=friction)
    assert law(run, "too_quick_a_start_leaves_it_behind") == "passed"


def test_a_cube_on_the_axis_is_not_judged() -> None:
    law = AccelConcaveSpin.laws()["too_quick_a_start_leaves_it_behind"]
    with pytest.raises(NotEvaluated, match="stands on the axis"):
        law.measure(AccelConcaveSpin.make(friction=0.1, angle=0.06), nominal(18, DRAFT))


def test_a_bowl_that_stops_lets_the_cube_slide_back_and_rest() -> None:
    run = spin(cargo="all", first=14.0, top=0.0, rate=6.0, angle=0.8, friction=0.3, rim=1.5)
    theta = polar(run, CUBE, 0.3)
    assert theta[-1] < 0.5
    assert np.linalg.norm(run.velocity(CUBE)[-1]) < 0.05


def test_without_friction_ball_and_cube_ignore_the_bowl() -> None:
    run = spin(cargo="ball", friction=0.0)
    assert np.abs(run.position(BALL)[:, 1]).max() < 1e-9


def test_refuses_what_overlaps() -> None:
    with pytest.raises(Refusal, match=r"R1.*allowed"):
        spin(size=0.05, angle=0.05, radius=0.2)


@pytest.mark.slow
def test_random_specimens() -> None:
    judge_random(AccelConcaveSpin, count=3, seed=3)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    decided = judge_random(AccelConcaveSpin, count=25, seed=4)
    assert min(decided.values()) >= 1
