"""The elastic rope against programs that only look like one."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p26_elastic_couple import BALL, LEFT, RIGHT, ElasticCouple
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random

SLACK = "a_slack_rope_does_nothing"


def fall(cls: type[ElasticCouple] = ElasticCouple, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


class Spring(ElasticCouple, domain="mechanics"):
    """A spring, which pushes when it is shorter than at rest."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("rope").springlength = [self.length, self.length]


class Stiff(ElasticCouple, domain="mechanics"):
    """A rope that hardly stretches, and throws the ball back."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("rope").stiffness = [40 * self.stiffness, 0, 0]


class Shorter(ElasticCouple, domain="mechanics"):
    """A rope that pulls a little before it is taut."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("rope").springlength = [0, 0.98 * self.length]


class Sticky(ElasticCouple, domain="mechanics"):
    """A rope with the hysteresis of a damper, slack or not."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("rope").damping = [0.01, 0, 0]


class Cut(ElasticCouple, domain="mechanics"):
    """The rope is an ornament."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("rope").stiffness = [1e-9, 0, 0]


class Anchored(ElasticCouple, domain="mechanics"):
    """The glider at rest is nailed to the track: the rope's pull has no reaction."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        if self.tied == "glider":
            scene.spec.joint("left/glider").damping = [50.0, 0, 0]


@pytest.mark.parametrize("lazy", [Spring, Shorter, Sticky])
def test_a_rope_that_acts_while_it_is_slack_is_found_out(lazy: type[ElasticCouple]) -> None:
    assert judge(fall(lazy), SLACK) == "failed"


def test_a_rope_that_does_not_stretch_is_found_out() -> None:
    assert {"falls_as_deep_as_the_energy_goes", "is_lowest_when_it_should"} <= failed(fall(Stiff))


def test_a_rope_that_pulls_one_of_two_is_found_out() -> None:
    assert judge(fall(Anchored), "together_they_keep_their_momentum") == "failed"


def test_without_the_rope_the_ball_falls_on() -> None:
    run = fall(Cut)
    drop = run.position(BALL)[0, 2] - run.position(BALL)[:, 2]
    assert drop == pytest.approx(g * run.t**2 / 2, abs=1e-5)
    assert run.specimen.laws()["falls_as_deep_as_the_energy_goes"].judge(run.specimen, run).verdict != "passed"


def test_without_the_rope_the_glider_runs_on() -> None:
    run = fall(Cut, tied="glider")
    assert run.velocity(RIGHT)[:, 0] == pytest.approx(np.full(len(run), 0.8), abs=1e-8)
    assert np.abs(run.velocity(LEFT)).max() < 1e-8


def test_half_the_gravity_tightens_it_later_by_root_two() -> None:
    run = nominal(26, DRAFT)
    light = run.again(gravity=g / 2)
    specimen = run.specimen
    assert isinstance(specimen, ElasticCouple)
    taut = [r.t[int(np.argmax(specimen.taut(r)))] for r in (run, light)]
    assert taut[1] / taut[0] == pytest.approx(sqrt(2), rel=0.01)


def test_the_ball_comes_back_to_where_it_was_let_go() -> None:
    """Nothing is lost, and above the rope's length the ball flies by itself."""
    run = nominal(26, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, ElasticCouple)
    late = run.t > specimen.lowest
    assert specimen.distance(run)[late].min() < 0.01
    assert specimen.tension(run).min() == 0.0
    assert len(specimen.flights(run)) >= 3


def test_the_gliders_keep_their_momentum_when_they_bump() -> None:
    run = fall(tied="glider")
    assert run.impacts
    assert judge(run, "together_they_keep_their_momentum") == "passed"
    specimen = run.specimen
    assert isinstance(specimen, ElasticCouple)
    assert specimen.distance(run).min() >= 0.135 - 1e-8


@pytest.mark.parametrize("tied", ["hook", "glider"])
def test_the_rope_that_is_seen_is_the_rope_that_pulls(tied: str) -> None:
    run = fall(tied=tied)
    specimen = run.specimen
    assert isinstance(specimen, ElasticCouple)
    assert run.scene.cords == {"rope": "hook/hook" if tied == "hook" else LEFT}
    assert run.model.tendon_lengthspring[0].tolist() == [0.0, specimen.length]
    slack = specimen.distance(run) < specimen.length
    assert slack.any()
    assert not slack.all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"length": 1.5, "stiffness": 500.0, "mass": 3.0},
        {"length": 0.3, "stiffness": 500.0, "mass": 0.1},
        {"tied": "glider", "mass": 3.0, "other": 0.1, "speed": 1.5, "length": 0.3, "start": 0.95},
        {"tied": "glider", "mass": 0.1, "other": 0.1, "speed": 0.2, "length": 1.5, "stiffness": 500.0},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    assert failed(fall(**values)) == set()


def test_too_deep_a_drop_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R12.*drops by 8\.62 m; allowed: 3\.0 m, .* 78\.5 N/m or more"):
        fall(length=1.5, stiffness=10.0, mass=3.0)
    fall(length=1.5, stiffness=79.0, mass=3.0)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(ElasticCouple, count=4).values()) >= 2


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(ElasticCouple, count=25, seed=1).values()) >= 15
