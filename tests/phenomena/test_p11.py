"""The race down the plank against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import cos, sin, sqrt, tan

import numpy as np
import pytest
from numpy.typing import ArrayLike

from phenomena.p11_roll_down_slope import BETA, RACERS, RollDownSlope
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Matter, Scene
from physinone_mj.simulate import simulate

from .verdicts import failed, judge_random, verdicts

ACCELERATION = "each_shape_accelerates_by_its_own_rule"


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(RollDownSlope, fidelity=DRAFT)


def keyframed(run: Run, accelerations: ArrayLike, turning: float = 1.0) -> Run:
    """Racers moved down the slope along parabolas, spun by `turning` times what rolling needs."""
    specimen: RollDownSlope = run.specimen  # type: ignore[assignment]
    along, _ = specimen.axes()
    qpos, qvel = run.qpos.copy(), np.zeros_like(run.qvel)
    for racer, acceleration in zip(RACERS, np.broadcast_to(accelerations, 4), strict=True):
        joint = run.model.joint(f"{racer.template}/free")
        q, v = joint.qposadr[0], joint.dofadr[0]
        way, pace = 0.5 * acceleration * run.t**2, acceleration * run.t
        turn = turning * way / specimen.radius
        qpos[:, q : q + 3] = run.qpos[0, q : q + 3] + way[:, None] * along
        qpos[:, q + 3 : q + 7] = np.column_stack([np.cos(turn / 2), 0 * turn, np.sin(turn / 2), 0 * turn])
        qvel[:, v : v + 3] = pace[:, None] * along
        qvel[:, v + 4] = turning * pace / specimen.radius
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, impacts=(), again_with=run.again, _repeats={})


class Sticky(RollDownSlope, domain="mechanics"):
    """A race in which the coefficient of friction is ignored."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name, matter in scene.matter.items():
            scene.matter[name] = Matter(matter.density, Surface(friction=0.9))


class Solid(RollDownSlope, domain="mechanics"):
    """A race of look-alikes: everything has the moment of inertia of a solid ball."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for racer in RACERS:
            body = scene.spec.body(racer.body)
            body.inertia = body.mass * self.radius**2 * np.full(3, 2 / 5)


class Afloat(RollDownSlope, domain="mechanics"):
    """A race with the plank taken away."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.touching.clear()


@pytest.mark.slow
def test_the_fabricated_truth_is_not_told_from_the_truth(run: Run) -> None:
    """So the failures below are those of the physics, not of the fabrication."""
    true = keyframed(run, run.specimen.accelerations())  # type: ignore[attr-defined]
    assert failed(true) == set()


def test_blocks_with_a_spinning_texture_are_caught(run: Run) -> None:
    sliding = keyframed(run, g * sin(run.specimen.angle))  # type: ignore[attr-defined]
    assert {ACCELERATION, "balls_arrive_first_and_hoops_last", "height_becomes_motion"} <= failed(sliding)


def test_a_texture_that_spins_at_another_pace_is_caught(run: Run) -> None:
    true = run.specimen.accelerations()  # type: ignore[attr-defined]
    assert "rolling_does_not_slip" in failed(keyframed(run, true, turning=1.001))


def test_one_shape_for_all_is_caught() -> None:
    assert {ACCELERATION, "balls_arrive_first_and_hoops_last"} <= failed(simulate(Solid, fidelity=DRAFT))


def test_friction_that_is_ignored_is_caught() -> None:
    slippery = simulate(Sticky, fidelity=DRAFT, friction=0.05)
    assert {ACCELERATION, "slipping_spins_up_slowly", "friction_needed_to_roll"} <= failed(slippery)


def test_hoop_and_ball_accelerate_as_seven_to_ten(run: Run) -> None:
    measured, _ = RollDownSlope.laws()[ACCELERATION].measure(run.specimen, run)
    assert measured[3] / measured[0] == pytest.approx(0.7, rel=1e-9)  # type: ignore[index]


def test_half_the_gravity_slows_it_by_root_two(run: Run) -> None:
    specimen: RollDownSlope = run.specimen  # type: ignore[assignment]
    slow = run.again(gravity=g / 2)
    i, j = round(0.6 / run.t[1]), round(0.6 * sqrt(2) / run.t[1])
    ratio = specimen.way(slow)[:, j] / specimen.way(run)[:, i]
    assert ratio == pytest.approx(0.5 * (slow.t[j] / run.t[i]) ** 2, rel=1e-9)


def test_without_the_plank_they_fall() -> None:
    afloat = simulate(Afloat, fidelity=DRAFT)
    for racer in RACERS:
        fall = afloat.position(racer.body)[0] - afloat.position(racer.body)
        assert fall == pytest.approx(np.outer(0.5 * g * afloat.t**2, [0, 0, 1]), abs=1e-9)
    assert ACCELERATION in failed(afloat)


def test_racers_stay_in_their_lanes(run: Run) -> None:
    for racer in RACERS:
        assert np.ptp(run.position(racer.body)[:, 1]) < 1e-9


def test_without_friction_nothing_turns() -> None:
    run = simulate(RollDownSlope, fidelity=DRAFT, friction=0.0, angle=0.7854)
    assert failed(run) == set()
    specimen: RollDownSlope = run.specimen  # type: ignore[assignment]
    for window, turned in zip(specimen.on_the_plank(run), specimen.tread_pace(run), strict=True):
        assert np.abs(turned[window]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    "extreme",
    [
        {"radius": 0.01, "length": 3.0, "angle": 0.7854, "friction": 0.9, "density": 21300.0},
        {"angle": 0.0524, "length": 3.0, "density": 100.0},
        {"friction": tan(0.3) / 3.0, "angle": 0.3},
        {"length": 0.5, "radius": 0.08, "angle": 0.7854},
    ],
)
def test_extremes_obey_every_law(extreme: dict[str, float]) -> None:
    assert set(verdicts(simulate(RollDownSlope, fidelity=DRAFT, **extreme)).values()) == {"passed"}


def test_between_the_thresholds_some_roll_and_some_slip() -> None:
    specimen = RollDownSlope.make(friction=tan(0.3) / 3.0, angle=0.3)
    assert specimen.grips().tolist() == [True, True, False, False]
    slipping = g * (sin(0.3) - tan(0.3) / 3.0 * cos(0.3))
    assert specimen.accelerations()[2:] == pytest.approx([slipping, slipping])
    assert sorted(BETA) == list(BETA)


@pytest.mark.slow
def test_random_specimens_obey_every_law() -> None:
    assert min(judge_random(RollDownSlope, seed=11).values()) == 12
