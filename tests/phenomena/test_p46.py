"""The pendulum against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from phenomena.p46_simple_pendulum import WIDEST_ROUND, SimplePendulum
from physinone_mj.base import ParameterError, Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate

from .verdicts import judge_random, verdicts


def verdict(run: Run, law: str) -> str:
    return SimplePendulum.laws()[law].judge(run.specimen, run).verdict


def sine(angle: float) -> Run:
    """The bob keyframed along a sine with the period of small swings."""
    run = simulate(SimplePendulum, fidelity=DRAFT, angle=angle)
    small = run.specimen.small
    path, speed = angle * np.cos(small * run.t), -angle * small * np.sin(small * run.t)
    return dataclasses.replace(run, qpos=path[:, None], qvel=speed[:, None], _repeats={})


class Rusty(SimplePendulum, domain="mechanics"):
    """A pendulum whose pivot has a friction that nobody declared."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint("pendulum/hinge").damping = [1e-5, 0, 0]


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.967])
@pytest.mark.parametrize("law", ["period_grows_with_amplitude", "energy_goes_only_into_the_pivot"])
def test_sine_keyframes_and_the_small_angle_formula_are_caught(angle: float, law: str) -> None:
    assert verdict(sine(angle), law) == "failed"


def test_period_at_170_degrees_is_more_than_twice_that_of_small_swings() -> None:
    run = simulate(SimplePendulum, fidelity=DRAFT, angle=2.967, length=0.5, radius=0.02)
    assert run.specimen.swing_time(run) * run.specimen.small / (2 * pi) == pytest.approx(2.4391, rel=1e-4)


def test_hidden_friction_is_caught() -> None:
    assert verdict(simulate(Rusty, fidelity=DRAFT), "energy_goes_only_into_the_pivot") == "failed"


def test_half_the_gravity_slows_it_by_root_two() -> None:
    run = simulate(SimplePendulum, fidelity=DRAFT)
    slow = run.again(gravity=g / 2)
    assert run.specimen.swing_time(slow) / run.specimen.swing_time(run) == pytest.approx(sqrt(2), rel=1e-8)


def test_a_friction_of_the_ball_joint_takes_the_energy_of_a_round_swing() -> None:
    run = simulate(SimplePendulum, fidelity=DRAFT, swing="conical", damping=0.01)
    assert verdict(run, "energy_goes_only_into_the_pivot") == "passed"
    energy = run.specimen.energy(run)
    assert energy[-1] < 0.9 * energy[0]


@pytest.mark.parametrize("swing", ["conical", "elliptic"])
def test_wide_round_swings_are_refused_with_the_widest_there_is(swing: str) -> None:
    simulate(SimplePendulum, fidelity=DRAFT, swing=swing, angle=WIDEST_ROUND)
    with pytest.raises(Refusal, match=r"1\.396 rad"):
        simulate(SimplePendulum, fidelity=DRAFT, swing=swing, angle=WIDEST_ROUND + 0.01)


def test_179_degrees_is_out_of_range() -> None:
    with pytest.raises(ParameterError, match=r"angle = 3\.124.*0\.0873 to 2\.967 rad"):
        SimplePendulum.make(angle=3.124)


@pytest.mark.parametrize(
    "extreme",
    [
        {"mass": 20.0, "radius": 0.02, "length": 0.2, "angle": 2.967},
        {"mass": 0.05, "radius": 0.09, "length": 0.2, "angle": 2.967},
        {"mass": 0.05, "length": 2.0, "angle": 2.967},
        {"mass": 0.05, "length": 0.2, "damping": 0.1},
        {"mass": 20.0, "length": 0.2, "damping": 0.1, "swing": "elliptic", "angle": WIDEST_ROUND},
    ],
)
def test_extremes_obey_every_law(extreme: dict[str, float | str]) -> None:
    run = simulate(SimplePendulum, fidelity=DRAFT, **extreme)
    assert set(verdicts(run).values()) == {"passed"}


def test_the_ellipse_formula_is_the_narrow_limit_of_the_exact_one() -> None:
    """Both oracles are written apart; they agree up to the square of the width."""
    run = simulate(SimplePendulum, fidelity=DRAFT, swing="elliptic", angle=0.0873)
    laws = SimplePendulum.laws()
    _, advance = laws["widest_points_advance"].measure(run.specimen, run)
    _, rate = laws["small_ellipse_precesses"].measure(run.specimen, run)
    half = pi / run.specimen.small
    assert (advance - pi) / half == pytest.approx(rate, rel=0.0873**2)


def test_a_round_swing_starts_as_a_round_swing() -> None:
    """The height of the bob stays, and its speed is √(g ℓ sin θ tan θ)."""
    run = simulate(SimplePendulum, fidelity=DRAFT, swing="conical", angle=1.3)
    assert np.ptp(run.position("pendulum/bob")[:, 2]) < 1e-9
    speed = np.linalg.norm(run.velocity("pendulum/bob"), axis=1)
    assert speed == pytest.approx(sqrt(g * sin(1.3) ** 2 / cos(1.3)), rel=1e-9)


@pytest.mark.slow
def test_random_specimens_obey_every_law_or_are_refused() -> None:
    assert min(judge_random(SimplePendulum, seed=46).values()) >= 5
