"""The double pendulum against programs that only look like one, and its equations against themselves."""

from __future__ import annotations

import dataclasses
from math import pi, sqrt

import numpy as np
import pytest

from phenomena.p47_double_pendulum import DoublePendulum
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.measure import value
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate

from .verdicts import failed, judge_random


def verdict(run: Run, law: str) -> str:
    return DoublePendulum.laws()[law].judge(run.specimen, run).verdict


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(DoublePendulum, fidelity=DRAFT)


def keyframed(run: Run, qpos: np.ndarray) -> Run:
    qvel = np.gradient(qpos, run.t, axis=0, edge_order=2)
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, again_with=lambda **_: run, _repeats={})


class Damped(DoublePendulum, domain="mechanics"):
    """A double pendulum whose hinges hide a little friction."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint("double_pendulum/elbow").damping = [1e-5, 0, 0]


def test_a_loop_played_again_is_caught(run: Run) -> None:
    """Two seconds of true motion, then the same forwards and backwards: smooth, and energy nearly kept."""
    back_and_forth = np.abs((np.arange(len(run)) + 480) % 960 - 480)
    loop = keyframed(run, run.qpos[back_and_forth])
    assert verdict(loop, "motion_is_lagranges") == "failed"


def test_one_recording_for_every_release_is_caught(run: Run) -> None:
    other = dataclasses.replace(run, specimen=DoublePendulum.make(angle1=2.02), _repeats={})
    assert verdict(other, "motion_is_lagranges") == "failed"


def test_a_twin_that_follows_the_first_is_caught(run: Run) -> None:
    """The separation of two recordings set side by side does not grow."""
    pair = run.again(twin="beside", offset=1e-7)
    qpos = pair.qpos.copy()
    qpos[:, 2:] = qpos[:, :2] + [1e-7, -1e-7]
    lazy = dataclasses.replace(pair, qpos=qpos, qvel=np.tile(pair.qvel[:, :2], 2))
    twins = dataclasses.replace(run, again_with=lambda **_: lazy, _repeats={})
    assert verdict(twins, "twins_part_exponentially") == "failed"


def test_hidden_friction_is_caught() -> None:
    damped = simulate(Damped, fidelity=DRAFT)
    assert verdict(damped, "energy_is_constant") == "failed"


def test_energy_drift_is_caught(run: Run) -> None:
    """An integrator that gains a ten-thousandth of the speed in ten seconds."""
    drifting = dataclasses.replace(run, qvel=run.qvel * (1 + 1e-4 * run.t / run.t[-1])[:, None], _repeats={})
    assert verdict(drifting, "energy_is_constant") == "failed"


def test_half_the_gravity_slows_it_by_root_two(run: Run) -> None:
    slow = run.again(gravity=g / 2)
    (q, _, v, _), (slow_q, _, slow_v, _) = run.specimen.state(run), run.specimen.state(slow)
    for when in (0.5, 1.0, 1.5, 2.0):
        assert value(slow.t, slow_q, slow_v, sqrt(2) * when) == pytest.approx(value(run.t, q, v, when), abs=1e-6)


def test_the_mirrored_release_is_the_mirrored_motion(run: Run) -> None:
    mirrored = run.again(angle1=-run.specimen.angle1, angle2=-run.specimen.angle2)
    assert np.abs(mirrored.qpos + run.qpos)[:480].max() < 1e-9


def test_equal_point_like_bobs_have_the_textbook_tones() -> None:
    twin = DoublePendulum.make(length1=0.8, length2=0.8, mass1=0.05, mass2=0.05, density=12000.0)
    squares = [square * 0.8 / g for square, _ in twin.lagrangian.modes()]
    assert squares == pytest.approx([2 - sqrt(2), 2 + sqrt(2)], rel=3e-4)


def test_the_tangent_map_is_the_derivative_of_the_motion() -> None:
    form, t, h = DoublePendulum.make().lagrangian, np.linspace(0, 1, 5), 1e-6
    _, tangent = form.solve(2.0, 2.4, 0.2, t)
    for column, (d1, d2) in enumerate(((h, 0.0), (0.0, h))):
        ahead, behind = (form.solve(2.0 + s * d1, 2.4 + s * d2, 0.2, t)[0] for s in (1, -1))
        difference = (ahead - behind) / (2 * h) * np.array([1, 1, 0.2, 0.2])[:, None]
        assert np.abs(difference - tangent[:, column]).max() < 1e-5


@pytest.mark.parametrize("angles", [(pi, pi), (pi, 0.0), (0.0, -pi)])
def test_unstable_equilibria_are_refused(angles: tuple[float, float]) -> None:
    with pytest.raises(Refusal, match=r"R12.*0\.001 rad"):
        simulate(DoublePendulum, fidelity=DRAFT, angle1=angles[0], angle2=angles[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    "extreme",
    [
        {"angle1": pi - 0.002, "angle2": pi},
        {"mass1": 0.05, "mass2": 2.0, "length1": 0.2, "length2": 0.8, "angle1": 3.0, "angle2": -3.0},
        {"mass1": 2.0, "mass2": 0.05, "length1": 0.8, "length2": 0.2, "density": 1000.0},
        {"angle1": 0.02, "angle2": 0.03, "twin": "beside", "offset": 1e-2},
    ],
)
def test_extremes_break_no_law(extreme: dict[str, float | str]) -> None:
    run = simulate(DoublePendulum, fidelity=DRAFT, **extreme)
    assert failed(run) == set()


@pytest.mark.slow
def test_random_specimens_break_no_law() -> None:
    decided = judge_random(DoublePendulum, seed=47)
    assert decided["motion_is_lagranges"] == 12
    assert decided["twins_part_exponentially"] >= 4
