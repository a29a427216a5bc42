"""Repelling magnets: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from phenomena.p14_magnet_repel import LOOSE, SOURCE, MagnetRepel
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import Magnets
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Push, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

TURN, BACK = "turns_back_where_the_energy_ends", "is_thrown_back_as_fast"


@dataclass(frozen=True)
class Padding:
    """No magnets, but bumpers: a stiff spring within 6 cm of centre distance beyond the bars' length."""

    length: float

    def bind(self, model: Any) -> Push:
        loose, source = model.body(LOOSE).id, model.body(SOURCE).id

        def push(data: Any) -> None:
            inside = 0.06 + self.length - (data.xipos[loose, 0] - data.xipos[source, 0])
            data.xfrc_applied[loose, 0] += 100.0 * max(inside, 0.0)

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


@dataclass(frozen=True)
class Lazy:
    """Magnets with something taken away."""

    true: Magnets
    kind: str

    def bind(self, model: Any) -> Push:
        push = self.true.bind(model)
        source = model.body(SOURCE).id

        def lazy(data: Any) -> None:
            push(data)
            if self.kind == "without torque":
                data.xfrc_applied[:, 3:] = 0
            else:
                data.xfrc_applied[source] = 0

        return lazy

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


class Padded(MagnetRepel, domain="magnetism"):
    """A contact offset that imitates repulsion."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [Padding(self.pole_distance)]


class Untwisted(MagnetRepel, domain="magnetism"):
    """No magnet turns: what is in line stays in line."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        (true,) = scene.effects
        assert isinstance(true, Magnets)
        scene.effects = [Lazy(true, "without torque")]


class OneSided(MagnetRepel, domain="magnetism"):
    """The source feels nothing."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        (true,) = scene.effects
        assert isinstance(true, Magnets)
        scene.effects = [Lazy(true, "without reaction")]


class Wood(MagnetRepel, domain="magnetism"):
    """Bars that are no magnets."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = []


def push(cls: type[MagnetRepel] = MagnetRepel, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def test_padding_that_imitates_repulsion_is_found_out() -> None:
    assert judge(push(Padded), TURN) == "failed"


def test_near_poles_the_gap_goes_as_the_speed_to_minus_two() -> None:
    """½ m v² = k/g where the other poles are far away; a bumper would give 1/v from its face."""
    values = {"pole_distance": 0.12, "core": 0.002, "strength": 1e-3, "mass": 0.5, "gap": 0.4}
    gaps = [np.min(MagnetRepel.make(speed=v, **values).pole_gap(push(speed=v, **values))) for v in (0.6, 0.8)]
    assert -2.0 < np.log(gaps[1] / gaps[0]) / np.log(0.8 / 0.6) < -1.7


@pytest.mark.parametrize("law", ["turning_round_costs_nothing", "out_of_line_it_turns_farther"])
def test_magnets_that_float_freely_in_line_are_found_out(law: str) -> None:
    assert judge(push(Untwisted), law) == "failed"


def test_repulsion_without_reaction_is_found_out() -> None:
    assert judge(push(OneSided, place="both on a rail"), "action_is_reaction") == "failed"


def test_a_bounce_that_loses_is_found_out() -> None:
    run = nominal(14, DRAFT)
    later = run.t > run.t[int(np.argmin(run.specimen.pole_gap(run)))]
    slow = dataclasses.replace(run, qvel=run.qvel * np.where(later, 0.99, 1.0)[:, None], _repeats={})
    assert judge(slow, BACK) == "failed"


def test_bars_of_wood_run_into_each_other() -> None:
    run = push(Wood)
    assert run.velocity(LOOSE)[0, 0] == pytest.approx(-0.6)
    before = run.t < run.impacts[0].time
    assert np.ptp(run.velocity(LOOSE)[before, 0]) < 1e-12
    assert run.specimen.laws()[TURN].judge(run.specimen, run).verdict != "passed"
    floats = push(Wood, place="cage")
    fallen = floats.position(LOOSE)[0, 2] - floats.position(LOOSE)[:, 2]
    assert fallen == pytest.approx(g * floats.t**2 / 2, rel=1e-6)


def test_half_the_gravity_floats_it_higher() -> None:
    run = push(place="cage", release=1.002)
    light = run.again(gravity=g / 2)
    specimen = run.specimen
    assert isinstance(specimen, MagnetRepel)
    assert specimen.pole_gap(light).mean() > 1.15 * specimen.pole_gap(run).mean()


def test_in_a_stack_the_lower_gap_is_the_narrower() -> None:
    run = push(place="stack")
    specimen = run.specimen
    assert isinstance(specimen, MagnetRepel)
    lower, upper = specimen.floating()
    assert lower < upper
    for gap, force in ((lower, 2.0), (upper, 1.0)):
        pulled = float(specimen.bars.pull(lower + upper + specimen.pole_distance))
        assert float(specimen.bars.pull(gap)) == pytest.approx(force * specimen.mass * g + pulled, rel=1e-12)


def test_a_fast_one_touches_and_is_thrown_back() -> None:
    run = push(speed=2.0, strength=3e-4)
    specimen = run.specimen
    assert isinstance(specimen, MagnetRepel)
    assert specimen.closest == 2 * specimen.core
    assert specimen.pole_gap(run).min() == pytest.approx(2 * specimen.core, abs=2e-3)
    assert run.velocity(LOOSE)[run.t > run.impacts[0].time + 0.05, 0].max() > 0.2
    assert "touch" in specimen.caption(run)


def test_a_turned_one_on_the_table_turns_round() -> None:
    run = push(place="table", gap=0.08, strength=6e-3)
    specimen = run.specimen
    assert isinstance(specimen, MagnetRepel)
    out = specimen.out_of_line(run)
    assert out[0] == pytest.approx(0.5)
    assert out[-1] > 2.8


def test_the_needle_is_mirrored() -> None:
    class Mirrored(MagnetRepel, domain="magnetism"):
        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.start["loose/motion"] = -np.asarray(scene.start["loose/motion"])

    one, other = push(place="pin"), push(Mirrored, place="pin")
    assert np.abs(one.joint("loose/motion") + other.joint("loose/motion")).max() < 1e-8


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (TURN, {"strength": 1e-2, "core": 0.002, "mass": 0.02, "gap": 0.05, "speed": 2.0}),
        (TURN, {"strength": 1e-2, "core": 0.01, "mass": 0.5, "gap": 0.4, "place": "both on a rail"}),
        ("floats_where_the_force_is_its_weight", {"strength": 1e-2, "mass": 0.02}),
    ],
)
def test_extremes(law: str, values: dict[str, Any]) -> None:
    assert judge(push(**values), law) == "passed"


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"place": "cage", "strength": 1e-4, "mass": 0.5}, "come down to a gap of .* allowed: 0.0132 m"),
        ({"place": "table", "gap": 0.03, "mass": 0.5}, "too narrow to turn in; allowed: .* m or more"),
        ({"pole_distance": 0.012, "core": 0.01}, "pole_distance = 0.012 m .* allowed: 0.02 m or more"),
    ],
)
def test_refusals(values: dict[str, Any], names: str) -> None:
    with pytest.raises(Refusal, match=f"R5.*{names}"):
        push(**values)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(MagnetRepel, count=4).values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(MagnetRepel, count=25, seed=1).values()) >= 10
