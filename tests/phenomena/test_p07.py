"""A fan from the front: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p07_wind_push_opp_dir import WindPushOppDir
from physinone_mj.base import Refusal
from physinone_mj.effects import UNIFORM, Drag
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import build, simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

TURN, BACK, FRICTION = (
    "turns_where_its_energy_is_spent",
    "comes_back_as_fast_as_it_came",
    "friction_takes_its_share_twice",
)


class Syrup(WindPushOppDir, domain="mechanics"):
    """A resistance to motion in the place of the wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [Drag(1.0, self.wind.bodies)]


class Even(WindPushOppDir, domain="mechanics"):
    """A wind that does not fade, with the same work in all."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [dataclasses.replace(self.wind, force=self.force / 3, profile=UNIFORM)]


class Calm(WindPushOppDir, domain="mechanics"):
    """No wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = []


def verdict(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def blow(cls: type[WindPushOppDir] = WindPushOppDir, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def specimen_of(run: Run) -> WindPushOppDir:
    assert isinstance(run.specimen, WindPushOppDir)
    return run.specimen


def test_a_scripted_return_is_found_out() -> None:
    """Lazy: it stops where it should, and is then led back at leisure, a hundredth too slowly."""
    run = nominal(7, DRAFT)
    specimen = specimen_of(run)
    when, _ = specimen.turn(run)
    x, v = (run.model.joint("ball/free").qposadr[0], run.model.joint("ball/free").dofadr[0])
    slowed = np.where(run.t < when, run.t, when + (run.t - when) / 1.01)
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    qpos[:, x] = np.interp(slowed, run.t, run.qpos[:, x])
    qvel[:, v] = np.interp(slowed, run.t, run.qvel[:, v]) / np.where(run.t < when, 1.0, 1.01)
    led = dataclasses.replace(run, qpos=qpos, qvel=qvel, impacts=(), _repeats={})
    assert verdict(led, BACK) == "failed"


def test_a_drag_in_the_place_of_the_wind_is_found_out() -> None:
    assert verdict(blow(Syrup), TURN) == "failed"


def test_a_wind_that_does_not_fade_is_found_out() -> None:
    assert verdict(blow(Even), TURN) == "failed"


def test_without_wind_nothing_changes_the_speed() -> None:
    run = blow(Calm)
    specimen = specimen_of(run)
    before = run.t < (run.impacts[0].time if run.impacts else run.t[-1])
    assert np.abs(specimen.velocity(run)[before] / -specimen.speed - 1).max() < 1e-12
    assert verdict(run, TURN) == "failed"


def test_a_start_farther_out_only_delays_the_turn() -> None:
    run = nominal(7, DRAFT)
    farther = run.again(start=1.45)
    delay = 0.1 * specimen_of(run).length / specimen_of(run).speed
    assert specimen_of(farther).turn(farther)[0] - specimen_of(run).turn(run)[0] == pytest.approx(delay, abs=1e-6)


def test_weight_does_not_matter_to_what_rolls() -> None:
    run = nominal(7, DRAFT)
    moon = run.again(gravity=4.9)
    free = run.t < min(run.impacts[0].time, moon.impacts[0].time)
    assert np.abs(moon.position("ball/ball") - run.position("ball/ball"))[free].max() < 1e-8


def test_friction_that_holds_against_the_wind() -> None:
    """It stops in the weak end of the wind and stays there; the law of what comes back has nothing to judge."""
    run = blow(body="puck", friction=0.3, start=0.9, speed=2.0)
    specimen = specimen_of(run)
    s, v = specimen.distance(run), specimen.velocity(run)
    stopped = int(np.argmax(v > -1e-9))
    assert 0 < specimen.push(s[stopped]) < specimen.resistance
    assert run.t[-1] - run.t[stopped] > 0.2
    assert np.ptp(s[stopped:]) < 1e-8


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (TURN, {"force": 20.0, "mass": 0.05, "length": 0.8, "speed": 4.0, "body": "puck", "friction": 0.0}),  # 400 m/s²
        (BACK, {"start": 0.6, "speed": 0.5}),  # starts amid the wind
        (FRICTION, {"body": "puck", "speed": 2.0}),
        (TURN, {"start": 1.0, "speed": 1.0}),
    ],
)
def test_extremes(law: str, values: dict[str, Any]) -> None:
    assert verdict(blow(**values), law) == "passed"


def test_a_ball_blown_off_its_feet_is_not_judged() -> None:
    assert verdict(blow(force=20.0, mass=0.1, length=0.8, speed=4.0), TURN) == "not evaluated"


def test_what_takes_too_long_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R12: .* allowed: "):
        build(WindPushOppDir.make(speed=0.3, start=1.5, length=3.0, body="puck", friction=0.0, mass=5.0, force=0.05))


@pytest.mark.slow
def test_random_specimens() -> None:
    assert judge_random(WindPushOppDir, 4)[TURN] >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(WindPushOppDir, 25, seed=1).values()) >= 5
