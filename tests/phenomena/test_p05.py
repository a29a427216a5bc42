"""A fan before what stands still: programs that only look right are told from the true one, and the extremes hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p05_wind_push_stationary import WindPushStationary
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import UNIFORM
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import build, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random

THRESHOLD, CREEP, WORK, STOP, TOPPLE, UPRIGHT, ROLL = WindPushStationary.laws()


class Unfading(WindPushStationary, domain="mechanics"):
    """The force of the fan, wherever the body stands."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [dataclasses.replace(self.wind, profile=UNIFORM)]


class Icy(WindPushStationary, domain="mechanics"):
    """No friction: everything moves, however weak the wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name, matter in scene.matter.items():
            scene.matter[name] = dataclasses.replace(matter, surface=dataclasses.replace(matter.surface, friction=0.0))


def verdict(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def blow(cls: type[WindPushStationary] = WindPushStationary, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def specimen_of(run: Run) -> WindPushStationary:
    assert isinstance(run.specimen, WindPushStationary)
    return run.specimen


def test_a_kick_is_found_out() -> None:
    """Lazy: the wind gives its greatest speed at once, and friction does the rest."""
    run = nominal(5, DRAFT)
    specimen = specimen_of(run)
    x, v = run.model.joint("block/free").qposadr[0], run.model.joint("block/free").dofadr[0]
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    qvel[:, v] = np.maximum(1.0 - specimen.friction * g * run.t, 0.0)
    qpos[1:, x] = qpos[0, x] + np.cumsum((qvel[1:, v] + qvel[:-1, v]) / 2) * run.t[1]
    kicked = dataclasses.replace(run, qpos=qpos, qvel=qvel, _repeats={})
    assert verdict(kicked, WORK) == verdict(kicked, STOP) == "failed"


def test_without_a_threshold_it_is_found_out() -> None:
    run = blow(Icy)
    assert {THRESHOLD, CREEP, WORK, TOPPLE} <= failed(run)


def test_creep_is_found_out() -> None:
    """A fifth of a millimetre in ten seconds is too much."""
    run = nominal(5, DRAFT)

    def creeping(**changes: Any) -> Run:
        twin = run.again(**changes)
        qpos = twin.qpos.copy()
        qpos[:, twin.model.joint("block/free").qposadr[0]] += 2e-4 * twin.t / 10
        return dataclasses.replace(twin, qpos=qpos)

    assert verdict(dataclasses.replace(run, again_with=creeping, _repeats={}), CREEP) == "failed"


def test_a_wind_that_does_not_fade_is_found_out() -> None:
    run = blow(Unfading)
    assert {THRESHOLD, WORK, TOPPLE, ROLL} <= failed(run)


@pytest.mark.slow
def test_ten_seconds_at_99_percent_of_the_threshold() -> None:
    specimen = specimen_of(nominal(5, DRAFT))
    run = blow(force=0.99 * specimen.critical())
    assert run.t[-1] > 9.9
    assert np.abs(specimen.displacement(run)).max() < 1e-9


@pytest.mark.slow
def test_farther_from_the_fan_it_takes_more_wind() -> None:
    """The critical forces at two distances are as 1/(1 - s₀/L)²."""
    for start in (0.3, 0.6):
        critical = WindPushStationary.make(start=start).critical()
        assert critical == pytest.approx(0.4 * 0.5 * g / (1 - start) ** 2)
        for factor, goes in ((0.995, False), (1.005, True)):
            run = blow(start=start, force=factor * critical)
            assert (specimen_of(run).displacement(run).max() > 1e-3) == goes


def test_beyond_the_wind_nothing_moves() -> None:
    for body in ("block", "ball"):
        run = blow(start=1.05, force=40.0, mass=0.01, body=body)
        specimen = specimen_of(run)
        assert np.abs(specimen.displacement(run)).max() < 1e-12
        assert verdict(run, THRESHOLD) == verdict(run, ROLL) == "not evaluated"


def test_half_the_gravity_halves_the_threshold() -> None:
    run = nominal(5, DRAFT)
    specimen = specimen_of(run)
    for factor, goes in ((0.495, False), (0.505, True)):
        twin = run.again(gravity=g / 2, force=factor * specimen.critical())
        assert (specimen.displacement(twin).max() > 1e-3) == goes


def test_a_tall_block_falls_on_its_side_and_a_low_one_slides() -> None:
    tall, low = blow(aspect=3.0, friction=0.7), nominal(5, DRAFT)
    assert specimen_of(tall).tilt(tall)[-1] == pytest.approx(np.pi / 2, abs=1e-3)
    assert tall.position("block/block")[-1, 2] == pytest.approx(specimen_of(tall).base / 2, abs=1e-5)
    assert specimen_of(low).tilt(low).max() < 1e-7
    assert specimen_of(low).displacement(low)[-1] > 0.3


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (WORK, {"mass": 0.001, "force": 0.1, "aspect": 0.3, "friction": 0.9, "start": 0.6}),  # a tile of a gram
        (ROLL, {"body": "ball", "mass": 0.02, "force": 1.0, "friction": 0.9, "length": 1.0}),
        (CREEP, {"mass": 5.0, "friction": 0.3, "aspect": 0.3}),
    ],
)
def test_extremes(law: str, values: dict[str, Any]) -> None:
    assert verdict(blow(**values), law) == "passed"


@pytest.mark.parametrize(
    ("rule", "values"), [("R1", {"start": 0.05, "length": 1.0}), ("R12", {"mass": 0.001, "force": 40.0})]
)
def test_refusals(rule: str, values: dict[str, Any]) -> None:
    with pytest.raises(Refusal, match=rf"{rule}: .* allowed: "):
        build(WindPushStationary.make(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    judge_random(WindPushStationary, 3)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(WindPushStationary, 25, seed=1).values()) >= 5
