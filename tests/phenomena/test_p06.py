"""A fan from behind: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p06_wind_push_same_dir import WindPushSameDir
from physinone_mj.base import Verdict
from physinone_mj.effects import UNIFORM, Wind
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

WORK = {"wind_does_work_on_the_way", "leaves_with_a_third_of_the_greatest_work"}


class Frozen(WindPushSameDir, domain="mechanics"):
    """The force that there is at the start, all the way."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [dataclasses.replace(self.wind, profile=UNIFORM)]


class Endless(WindPushSameDir, domain="mechanics"):
    """A thousandth of the force stays, beyond the end too."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        box = dataclasses.replace(self.wind.box, length=10.0)
        scene.effects.append(Wind(box, 1e-3 * self.force, self.wind.bodies, UNIFORM))


class Calm(WindPushSameDir, domain="mechanics"):
    """No wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = []


def judge(run: Run, law: str) -> Verdict:
    return run.specimen.laws()[law].judge(run.specimen, run)


def blow(cls: type[WindPushSameDir] = WindPushSameDir, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def test_a_kick_at_the_fan_is_found_out() -> None:
    """Lazy: the wind adds its whole Δv at once."""
    run = nominal(6, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, WindPushSameDir)
    speed = float(specimen.gained(specimen.length))
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    x = run.model.joint("ball/free").qposadr[0]
    entry = -qpos[0, x] / specimen.speed
    qpos[:, x] = np.where(run.t < entry, qpos[0, x] + specimen.speed * run.t, speed * (run.t - entry))
    qvel[:, run.model.joint("ball/free").dofadr[0]] = np.where(run.t < entry, specimen.speed, speed)
    kicked = dataclasses.replace(run, qpos=qpos, qvel=qvel, impacts=(), _repeats={})
    assert judge(kicked, "wind_does_work_on_the_way").verdict == "failed"


def test_a_force_frozen_at_its_first_value_is_found_out() -> None:
    run = blow(Frozen)
    assert {judge(run, law).verdict for law in WORK} == {"failed"}


def test_a_wind_without_an_end_is_found_out() -> None:
    assert judge(blow(Endless), "nothing_pushes_beyond_the_wind").verdict == "failed"


def test_without_wind_nothing_changes_the_speed() -> None:
    run = blow(Calm)
    assert judge(run, "wind_does_work_on_the_way").verdict == "failed"
    specimen = run.specimen
    assert isinstance(specimen, WindPushSameDir)
    before = run.t < (run.impacts[0].time if run.impacts else run.t[-1])
    assert np.abs(specimen.velocity(run)[before] / specimen.speed - 1).max() < 1e-12


@pytest.mark.slow
def test_twice_the_mass_and_force_move_alike() -> None:
    run = nominal(6, DRAFT)
    twin = run.again(mass=2 * run.specimen.mass, force=2 * run.specimen.force)  # type: ignore[attr-defined]
    assert np.abs(twin.position("ball/ball") - run.position("ball/ball"))[run.t < 3].max() < 1e-9


def test_the_recorded_force_is_mass_times_acceleration() -> None:
    run = blow(body="puck")
    specimen = run.specimen
    assert isinstance(specimen, WindPushSameDir)
    s = specimen.distance(run)
    inside = (s > 0.02) & (s < specimen.length - 0.02)
    acceleration = np.gradient(specimen.velocity(run), run.t, edge_order=2)
    assert np.abs(specimen.mass * acceleration - specimen.wind_force(run))[inside].max() < 1e-3 * specimen.force


def test_the_ball_rolls_and_the_puck_does_not_turn() -> None:
    run = nominal(6, DRAFT)
    before = run.t < run.impacts[0].time
    rolling = run.spin("ball/ball")[before, 1] * 0.05 / run.velocity("ball/ball")[before, 0]
    assert np.abs(rolling - 1).max() < 1e-9
    puck = blow(body="puck")
    assert np.abs(puck.spin("puck/puck")[puck.t < puck.impacts[0].time]).max() < 1e-9


def test_a_uniform_stream_is_never_overtaken() -> None:
    run = blow(air="uniform stream", wind_speed=2.0, drag_area=0.05, mass=0.05, length=3.0)
    specimen = run.specimen
    assert isinstance(specimen, WindPushSameDir)
    assert 1.4 < specimen.velocity(run).max() < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "values"),
    [
        # through the wind in eight frames
        ("leaves_with_a_third_of_the_greatest_work", {"speed": 3.0, "length": 0.8}),
        # 160 m/s²
        ("wind_does_work_on_the_way", {"force": 8.0, "mass": 0.05, "body": "puck", "length": 1.0}),
        # hardly pushed, never arrives
        ("wind_does_work_on_the_way", {"speed": 0.2, "force": 0.02, "mass": 5.0, "length": 3.0}),
        ("uniform_stream_is_never_overtaken",
         {"air": "uniform stream", "wind_speed": 15.0, "drag_area": 0.05, "mass": 0.05, "body": "puck"}),
    ],
)  # fmt: skip
def test_extremes(law: str, values: dict[str, Any]) -> None:
    assert judge(blow(**values), law).verdict == "passed"


def test_a_ball_blown_off_its_feet_is_not_judged() -> None:
    run = blow(force=8.0, mass=0.2, length=0.8)
    for law in WORK:
        verdict = judge(run, law)
        assert verdict.verdict == "not evaluated"
        assert verdict.reason is not None
        assert "friction needed: 1.17" in verdict.reason


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(WindPushSameDir).values()) >= 6
