"""Across the wind of a fan: programs that only look right are told from the true one, and the extremes hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p08_wind_deflect_motion import WindDeflectMotion
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import build, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts

ACROSS, STRAIGHT, IMPULSE, WEAK, BENT, WORK = WindDeflectMotion.laws()


class Endless(WindDeflectMotion, domain="mechanics"):
    """A wind as wide as the world."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [dataclasses.replace(self.wind, box=dataclasses.replace(self.wind.box, width=20.0))]


class Calm(WindDeflectMotion, domain="mechanics"):
    """No wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = []


def verdict(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def blow(cls: type[WindDeflectMotion] = WindDeflectMotion, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def specimen_of(run: Run) -> WindDeflectMotion:
    assert isinstance(run.specimen, WindDeflectMotion)
    return run.specimen


def jerked(run: Run, y: float, velocity: tuple[float, float]) -> Run:
    """The run as a program would have it that knows no forces: straight to y, then straight with another velocity."""
    specimen = specimen_of(run)
    x, v = run.model.joint("puck/free").qposadr[0], run.model.joint("puck/free").dofadr[0]
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    when = (y - qpos[0, x + 1]) / specimen.across
    after = run.t > when
    qvel[:, v : v + 2] = np.where(after[:, None], velocity, (specimen.along, specimen.across))
    for k, speed in enumerate((specimen.along, specimen.across)):
        qpos[:, x + k] = run.qpos[0, x + k] + np.where(
            after, speed * when + velocity[k] * (run.t - when), speed * run.t
        )
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, impacts=(), _repeats={})


def test_a_velocity_that_is_only_turned_is_found_out() -> None:
    """Lazy: a fixed angle, and the speed stays."""
    run = nominal(8, DRAFT)
    specimen = specimen_of(run)
    turn = np.arctan2(specimen.passage().v[-1], specimen.speed)
    turned = jerked(run, 0.0, (specimen.speed * np.sin(turn), specimen.speed * np.cos(turn)))
    assert {ACROSS, IMPULSE, WORK} <= failed(turned)


def test_a_kick_at_the_edge_of_the_wind_is_found_out() -> None:
    run = nominal(8, DRAFT)
    specimen = specimen_of(run)
    kicked = jerked(run, -specimen.width / 2, (specimen.passage().v[-1], specimen.across))
    assert verdict(kicked, IMPULSE) == "passed"
    assert verdict(kicked, WORK) == "failed"


def test_a_wind_without_sides_is_found_out() -> None:
    assert {STRAIGHT, IMPULSE, BENT, WORK} <= failed(blow(Endless))


def test_without_wind_the_way_is_straight() -> None:
    run = blow(Calm, angle=1.0)
    assert verdicts(run) == {
        law: "passed" if law in (ACROSS, STRAIGHT) else "failed" for law in WindDeflectMotion.laws()
    }
    path = specimen_of(run).path(run)[run.t < 1.0]
    gone = path - path[0]
    assert np.abs(gone[:, 0] * np.sin(1.0) - gone[:, 1] * np.cos(1.0)).max() < 1e-12


def test_outside_the_wind_the_way_is_straight_to_a_micrometre() -> None:
    run = nominal(8, DRAFT)
    specimen = specimen_of(run)
    path = specimen.path(run)
    _, behind = specimen.crossing(run)
    for stretch in (path[path[:, 1] < -specimen.side], path[behind]):
        line = np.polyfit(stretch[:, 1], stretch[:, 0], 1)
        assert np.abs(np.polyval(line, stretch[:, 1]) - stretch[:, 0]).max() < 1e-9


def test_twice_the_mass_and_force_move_alike() -> None:
    run = nominal(8, DRAFT)
    specimen = specimen_of(run)
    double = run.again(mass=2 * specimen.mass, force=2 * specimen.force)
    before = run.t < run.impacts[0].time
    assert np.abs(double.position("puck/puck") - run.position("puck/puck"))[before].max() < 1e-9


def test_half_the_gravity_changes_nothing() -> None:
    run = nominal(8, DRAFT)
    moon = run.again(gravity=4.9)
    before = run.t < run.impacts[0].time
    assert np.abs(moon.position("puck/puck") - run.position("puck/puck"))[before, :2].max() < 1e-9


def test_a_ball_rolls_through_with_more_inertia() -> None:
    run = blow(body="ball")
    specimen = specimen_of(run)
    assert set(verdicts(run).values()) == {"passed"}
    _, behind = specimen.crossing(run)
    v, spin = run.velocity("ball/ball")[behind], run.spin("ball/ball")[behind]
    assert np.abs(spin[:, 1] * specimen.radius - v[:, 0]).max() < 1e-9
    assert np.abs(spin[:, 0] * specimen.radius + v[:, 1]).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"angle": 0.35, "width": 0.2, "reach": 0.6, "length": 3.0},  # nearly along the wind
        {"angle": 2.6, "width": 0.3, "reach": 0.7, "length": 3.0, "force": 1.0},  # nearly against it
        {"force": 20.0, "mass": 0.1, "length": 0.8, "width": 1.0},  # out of the end of the wind
        {"speed": 5.0, "width": 0.45, "radius": 0.03},  # just twenty samples
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = blow(**values)
    assert {verdict(run, law) for law in (ACROSS, STRAIGHT, IMPULSE, WORK)} == {"passed"}


@pytest.mark.parametrize(
    ("rule", "values"),
    [
        ("R1", {"angle": 0.4, "reach": 0.15}),
        ("R12", {"speed": 5.0, "width": 0.2}),
        ("R12", {"force": 20.0, "mass": 0.05, "reach": 0.2, "speed": 3.0, "length": 3.0}),
        ("R12", {"speed": 0.5, "angle": 2.79, "width": 1.0, "reach": 0.7, "length": 3.0, "force": 0.4, "mass": 1.0}),
    ],
)
def test_refusals(rule: str, values: dict[str, Any]) -> None:
    with pytest.raises(Refusal, match=rf"{rule}: .* allowed: "):
        build(WindDeflectMotion.make(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    assert judge_random(WindDeflectMotion, 4)[ACROSS] >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(WindDeflectMotion, 25, seed=1).values()) >= 5
