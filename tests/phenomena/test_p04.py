"""Balance of wind and weight: programs that only look right are told from the true one, and the extremes hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p04_wind_gravity_balance import GRILLE, WindGravityBalance, fastest
from physinone_mj.base import ParameterError, Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import UNIFORM, Wind
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import build, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts

HEIGHT, PERIOD, ENERGY, ABOVE, LEAN = WindGravityBalance.laws()


class Constant(WindGravityBalance, domain="mechanics"):
    """A wind that does not fade and just bears the weight."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects[0] = dataclasses.replace(self.wind, force=self.weight * self.force, profile=UNIFORM)


class Servo(WindGravityBalance, domain="mechanics"):
    """It bobs about the same height, whatever it weighs."""

    def build(self, scene: Scene) -> None:
        WindGravityBalance.make(**(self.values() | {"weight": 0.35})).build(scene)


class Endless(WindGravityBalance, domain="mechanics"):
    """A thousandth of the force stays, beyond the end too."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        box = dataclasses.replace(self.wind.box, length=10.0)
        scene.effects.append(Wind(box, 1e-3 * self.force, self.wind.bodies, UNIFORM))


class Beside(WindGravityBalance, domain="mechanics"):
    """The ball starts a millimetre outside the side of the wind."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        aside = self.wind.box.width / 2 + 1e-3
        scene.start["ball/free"] = free_pose((aside, 0, GRILLE + self.height + self.offset * self.length))


def verdict(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def blow(cls: type[WindGravityBalance] = WindGravityBalance, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def specimen_of(run: Run) -> WindGravityBalance:
    assert isinstance(run.specimen, WindGravityBalance)
    return run.specimen


def test_a_constant_wind_is_found_out() -> None:
    assert {HEIGHT, PERIOD, LEAN} <= failed(blow(Constant))


def test_a_height_that_does_not_know_the_weight_is_found_out() -> None:
    run = blow(Servo)
    assert verdict(run, HEIGHT) == "failed"
    assert verdict(run, PERIOD) == "passed"


def test_a_wind_without_an_end_is_found_out() -> None:
    assert verdict(blow(Endless), ABOVE) == "failed"


def test_a_millimetre_beside_the_wind_it_falls_freely() -> None:
    run = blow(Beside, drag=0.0)
    specimen = specimen_of(run)
    falls = specimen.distance(run) > 0.1
    z = specimen.height + specimen.offset * specimen.length - g / 2 * run.t**2
    assert falls[:60].all()
    assert np.abs(specimen.distance(run) - z)[:60].max() < 1e-12


def test_half_the_gravity_needs_half_the_wind() -> None:
    specimen, run = specimen_of(nominal(4, DRAFT)).afloat(nominal(4, DRAFT), 0.1)
    moon = run.again(gravity=g / 2)
    height = specimen.length * (1 - np.sqrt(specimen.weight / 2))
    assert fastest(moon.t, specimen.distance(moon), specimen.rise(moon)) == pytest.approx(height, rel=1e-7)


def test_drag_brings_it_to_rest_at_the_balance() -> None:
    for values in ({"drag": 0.1}, {"drag": 0.2, "setup": "hanging ball"}, {"drag": 0.3, "setup": "hanging plate"}):
        run = blow(**values)
        specimen = specimen_of(run)
        late = run.t > run.t[-1] - 0.2
        here, there = (
            (specimen.distance(run), specimen.height) if specimen.hovers else (specimen.tilt(run), specimen.lean)
        )
        assert np.abs(here[late] - there).max() < 1e-3
        assert np.abs(here[0] - there) > 0.25


def test_overshoot_out_of_the_wind_and_back() -> None:
    """A light ball from above the wind: no force out there, energy kept over each fall back in."""
    run = blow(weight=0.05, offset=0.3, drag=0.0, length=0.8)
    specimen = specimen_of(run)
    z = specimen.distance(run)
    assert len(np.nonzero(np.diff(np.sign(z - specimen.length)))[0]) >= 6
    stored = np.maximum(1 - z / specimen.length, 0) ** 3 * specimen.length / 3 / specimen.weight
    energy = specimen.rise(run) ** 2 / 2 + g * (z + stored)
    assert np.abs(energy / energy[0] - 1).max() < 1e-6


def test_too_heavy_it_rests_on_the_grille() -> None:
    run = blow(weight=0.9, length=0.5, radius=0.08, offset=0.3, drag=0.01)
    assert verdicts(run)[HEIGHT] == "not evaluated"
    assert specimen_of(run).distance(run)[-1] == pytest.approx(0.08, abs=1e-6)


def test_no_wind_can_bear_more_than_its_force() -> None:
    with pytest.raises(ParameterError, match=r"weight = 1.1 is out of range; allowed: 0.05 to 0.9"):
        WindGravityBalance.make(weight=1.1)


@pytest.mark.parametrize(
    ("rule", "values"),
    [
        ("R1", {"weight": 0.8, "offset": -0.3}),
        ("R4", {"drag": 0.5, "force": 0.2}),
        ("R12", {"setup": "hanging plate", "weight": 0.05}),
    ],
)
def test_refusals(rule: str, values: dict[str, Any]) -> None:
    with pytest.raises(Refusal, match=rf"{rule}: .* allowed: "):
        build(WindGravityBalance.make(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    assert judge_random(WindGravityBalance, 4)[PERIOD] >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(WindGravityBalance, 25, seed=1).values()) >= 5
