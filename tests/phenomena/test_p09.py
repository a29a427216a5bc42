"""The throw against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import sin, sqrt
from typing import cast

import numpy as np
import pytest

from phenomena.p09_oblique_projectile import ObliqueProjectile
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate

from .verdicts import failed, judge_random, verdicts

TUMBLING = {"tumbling_keeps_its_angular_momentum", "tumbling_is_eulers"}
PARABOLA = {"path_is_a_parabola", "the_fall_is_that_of_gravity"}


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(ObliqueProjectile, fidelity=DRAFT)


@pytest.fixture(scope="module")
def box() -> Run:
    return simulate(ObliqueProjectile, fidelity=DRAFT, thrown="box", spin=20.0)


class Damped(ObliqueProjectile, domain="mechanics"):
    """A throw with the linear damping that game engines apply by default."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint(self.body.split("/")[0] + "/free").damping = [0.001, 0, 0]


class Bottomless(ObliqueProjectile, domain="mechanics"):
    """A throw over no floor."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.touching.clear()


def test_a_bezier_path_is_caught(run: Run) -> None:
    """A cubic curve with the right ends, directions and landing time, drawn at an even pace of its parameter."""
    landing = run.impacts[0].time
    n = int(np.sum(run.t < landing))
    first, last = run.qpos[0, :3], run.qpos[n - 1, :3]
    u = (run.t[:n] / run.t[n - 1])[:, None]
    way, end = 0.9 * run.qvel[0, :3] * landing / 3, 0.9 * run.qvel[n - 1, :3] * landing / 3
    corners = first, first + way, last - end, last
    weights = (1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    qpos[:n, :3] = sum(w * c for w, c in zip(weights, corners, strict=True))
    qvel[:n, :3] = np.gradient(qpos[:n, :3], run.t[:n], axis=0)
    curve = dataclasses.replace(run, qpos=qpos, qvel=qvel, again_with=run.again, _repeats={})
    assert PARABOLA | {"nothing_slows_it_sideways"} <= failed(curve)


def test_hidden_damping_is_caught() -> None:
    assert PARABOLA | {"nothing_slows_it_sideways", "range_and_apex"} <= failed(simulate(Damped, fidelity=DRAFT))


def test_a_rotation_about_a_fixed_axis_is_caught(box: Run) -> None:
    spin = box.qvel[0, 3:6]
    rate = np.linalg.norm(spin)
    half = rate * box.t / 2
    qpos, qvel = box.qpos.copy(), box.qvel.copy()
    qpos[:, 3], qpos[:, 4:7] = np.cos(half), np.outer(np.sin(half), spin / rate)
    qvel[:, 3:6] = spin
    scripted = dataclasses.replace(box, qpos=qpos, qvel=qvel, _repeats={})
    assert failed(scripted) == TUMBLING


@pytest.mark.slow
def test_the_box_flips_over_in_flight(box: Run) -> None:
    """Dzhanibekov's flip: the spin about the middle axis, seen from the box, turns round."""
    flight = box.t < box.impacts[0].time
    axes = quaternion_matrix(box.quaternion("die/die")[flight])
    middle = np.einsum("tij,ti->tj", axes, box.spin("die/die")[flight])[:, 1]
    assert middle[0] == pytest.approx(-20, rel=0.01)
    assert middle.max() == pytest.approx(20, rel=0.01)
    assert set(verdicts(box).values()) == {"passed"}


def test_half_the_gravity_doubles_the_apex(run: Run) -> None:
    specimen = cast(ObliqueProjectile, run.specimen)
    high = run.again(gravity=g / 2).position("ball/ball")[:, 2].max() - specimen.start[2]
    assert high == pytest.approx(2 * specimen.apex(), rel=1e-4)


def test_a_higher_table_delays_the_landing_as_kinematics_predicts(run: Run) -> None:
    higher = run.again(height=run.specimen.height + 0.5)  # type: ignore[attr-defined]
    for r in (run, higher):
        specimen = cast(ObliqueProjectile, r.specimen)
        up = specimen.speed * sin(specimen.angle)
        assert r.impacts[0].time == pytest.approx((up + sqrt(up**2 + 2 * g * specimen.fall)) / g, rel=1e-8)


def test_without_the_floor_it_falls_on() -> None:
    run = simulate(Bottomless, fidelity=DRAFT)
    specimen = cast(ObliqueProjectile, run.specimen)
    expected = specimen.start[2] + specimen.speed * sin(specimen.angle) * run.t - g * run.t**2 / 2
    assert run.position("ball/ball")[:, 2] == pytest.approx(expected, abs=1e-9)
    assert verdicts(run)["path_is_a_parabola"] == "not evaluated"


@pytest.mark.parametrize("thrown", ["ball", "box"])
def test_the_wall_of_foam_brings_it_to_rest_or_nearly(thrown: str) -> None:
    run = simulate(ObliqueProjectile, fidelity=DRAFT, thrown=thrown)
    body = cast(ObliqueProjectile, run.specimen).body
    assert np.linalg.norm(run.velocity(body)[-1]) < {"ball": 0.2, "box": 1e-6}[thrown]


def test_what_is_too_small_to_be_seen_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R12: size = 0\.03 m.*allowed: 0\.0\d+ m"):
        simulate(ObliqueProjectile, fidelity=DRAFT, size=0.03, speed=7.0, angle=0.8)


@pytest.mark.slow
@pytest.mark.parametrize(
    "extreme",
    [
        {"speed": 7.0, "angle": 1.4835, "height": 1.5, "size": 0.08},
        {"speed": 7.0, "angle": 0.2618, "height": 1.5, "size": 0.1, "thrown": "box", "spin": 20.0, "density": 21300.0},
        {"speed": 1.0, "angle": 0.2618, "height": 0.0, "size": 0.03, "density": 100.0, "spin": 0.0},
        {"speed": 1.0, "angle": 1.4835, "height": 0.0, "size": 0.1, "thrown": "box", "spin": 0.0},
    ],
)
def test_extremes_break_no_law(extreme: dict[str, float | str]) -> None:
    assert failed(simulate(ObliqueProjectile, fidelity=DRAFT, **extreme)) == set()


@pytest.mark.slow
def test_random_specimens_obey_every_law_or_are_refused() -> None:
    assert min(judge_random(ObliqueProjectile, seed=9).values()) >= 8
