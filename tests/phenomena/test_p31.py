"""The tethered balloon: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from math import sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p31_balloon_tether import BODY, BalloonTether
from physinone_mj.base import Refusal
from physinone_mj.effects import AirStream, Buoyancy
from physinone_mj.fidelity import DRAFT
from physinone_mj.measure import accelerations
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

TENSION, LONGEST = "pulls_with_all_its_lift", "thread_is_never_longer_than_it_is"
SWAY, LEAN = "sways_like_a_pendulum_upside_down", "leans_in_the_wind"
CARRIES = "carries_what_weighs_less_than_its_lift"


class Unheld(BalloonTether, domain="mechanics"):
    """A thread that is drawn, and holds nothing."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("thread").range = (0.0, 50.0)


class Rubber(BalloonTether, domain="mechanics"):
    """A spring for a thread."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        thread = scene.spec.tendon("thread")
        thread.range = (0.0, 50.0)
        thread.springlength, thread.stiffness = (0.0, self.length), [8.0, 0, 0]


class WeightlessAir(BalloonTether, domain="mechanics"):
    """The air makes way at no cost."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.body(BODY).mass = self.balloon.mass
        scene.effects = [
            Buoyancy((dataclasses.replace(e.floats[0], added=0.0),), e.density) if isinstance(e, Buoyancy) else e
            for e in scene.effects
        ]


class HalfLift(BalloonTether, domain="mechanics"):
    """A lift that is not that of the volume."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [dataclasses.replace(e, density=0.9 * e.density) for e in scene.effects]  # type: ignore[type-var]


class Linear(BalloonTether, domain="mechanics"):
    """A wind whose force does not know the size of the balloon."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects = [
            dataclasses.replace(e, drag_area=0.02) if isinstance(e, AirStream) else e for e in scene.effects
        ]


class Cut(BalloonTether, domain="mechanics"):
    """The thread is cut after two seconds."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.cuts["thread"] = 2.0


def judge(run: Run, *laws: str) -> set[str]:
    return {run.specimen.laws()[law].judge(run.specimen, run).verdict for law in laws}


def tether(cls: type[BalloonTether] = BalloonTether, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def pinned(run: Run) -> Run:
    """The picture of the run's start, all the time, and the same of its twins."""
    still = np.tile(run.qpos[0], (len(run), 1))
    return dataclasses.replace(
        run, qpos=still, qvel=np.zeros_like(run.qvel), again_with=lambda **changes: pinned(run.again(**changes)),
        _repeats={},
    )  # fmt: skip


def test_a_pinned_balloon_is_found_out() -> None:
    assert judge(pinned(nominal(31, DRAFT)), TENSION, LONGEST, SWAY, LEAN) == {"failed"}


def test_a_thread_that_holds_nothing_is_found_out() -> None:
    assert judge(tether(Unheld), LONGEST, TENSION, CARRIES) == {"failed"}


def test_a_rubber_thread_is_found_out() -> None:
    assert judge(tether(Rubber), LONGEST) == {"failed"}


def test_air_that_does_not_resist_is_found_out() -> None:
    run = tether(WeightlessAir, slack=0.0, push=0.0)
    assert judge(run, SWAY) == {"failed"}
    assert judge(run, TENSION) == {"passed"}


def test_a_lift_of_another_volume_is_found_out() -> None:
    assert judge(tether(HalfLift, slack=0.0, push=0.0), TENSION, CARRIES, SWAY) == {"failed"}


def test_a_wind_that_does_not_know_the_size_is_found_out() -> None:
    assert judge(tether(Linear, slack=0.0, push=0.0), LEAN) == {"failed"}


def test_half_the_gravity_sways_root_two_slower() -> None:
    run = tether(slack=0.0, push=0.01, weight=0.24)
    slow = run.again(gravity=9.80665 / 2)
    quarter = [one.t[np.argmax(one.velocity(BODY)[:, 0] < 0)] for one in (run, slow)]
    assert quarter[1] / quarter[0] == pytest.approx(sqrt(2), rel=0.01)


def test_pushed_the_other_way_it_moves_as_in_a_mirror() -> None:
    """The wind's axis apart, nothing tells left from right: the motion stays in its plane."""
    run = nominal(31, DRAFT)
    assert np.abs(run.position(BODY)[:, 1]).max() < 1e-9
    assert np.abs(run.position("parcel/parcel")[:, 1]).max() < 1e-9


def test_it_rises_freely_until_the_thread_is_taut() -> None:
    run, free = nominal(31, DRAFT), tether(Unheld)
    taut = int(np.argmax(run.specimen.span(run) > 0.9 * 0.999))
    assert 50 < taut < 200
    assert np.abs(run.position(BODY)[:taut] - free.position(BODY)[:taut]).max() < 1e-9


def test_the_thread_only_pulls_and_along_itself() -> None:
    run = nominal(31, DRAFT)
    specimen = run.specimen
    late = run.t > 3.0
    eye, knot = specimen.ends(run)
    along = ((eye - knot) / specimen.span(run)[:, None])[late]
    pull = specimen.pull(run)[late]
    inward = (pull * along).sum(axis=1)
    assert inward.min() > 0.3 * specimen.balloon.lift
    # the accelerations are differences between samples
    assert np.abs(pull - inward[:, None] * along).max() < 1e-2 * specimen.balloon.lift


def test_a_heavy_parcel_stays_where_it_is() -> None:
    run = tether(weight=0.24, push=0.1, slack=0.0)
    assert np.abs(run.position("parcel/parcel") - run.position("parcel/parcel")[0]).max() < 1e-6


def test_cut_loose_it_rises() -> None:
    run = tether(Cut, push=0.0, slack=0.2)
    balloon = run.specimen.balloon
    at = slice(int(2.0 * 240), int(2.1 * 240))
    z, v = run.position(BODY)[at, 2], run.velocity(BODY)[at, 2]
    assert accelerations(run.t[at], z, v)[0] == pytest.approx(balloon.lift / balloon.inertia, rel=0.01)
    assert run.velocity(BODY)[-1, 2] == pytest.approx(balloon.terminal(), rel=0.01)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"radius": 0.12, "gas": 0.4, "skin": 0.006}, r"lift of -?0\.0\d+ N; allowed: a fifth"),
        ({"radius": 0.25, "skin": 0.003, "weight": 0.008}, r"weight = 0.008 kg is carried away; allowed here: 0.06"),
        ({"weather": "windy", "wind": 3.0}, r"lays the balloon flat; allowed here: 2\.\d+ m/s"),
        ({"weather": "windy", "weight": 0.012, "wind": 1.5}, r"takes the parcel along; allowed here"),
    ],
)
def test_refusals(values: dict[str, Any], reason: str) -> None:
    with pytest.raises(Refusal, match=reason):
        tether(**values)


@pytest.mark.parametrize(
    "values",
    [
        # an all but slack, long thread and the strongest pull
        {"radius": 0.25, "gas": 0.09, "skin": 0.003, "length": 1.5, "slack": 0.9, "push": 0.8, "drag": 0.2,
         "weight": 0.2},
        {"radius": 0.13, "skin": 0.003, "length": 0.2, "slack": 0.9, "push": 0.8, "weight": 0.008},
        {"radius": 0.25, "gas": 0.09, "skin": 0.003, "weight": 0.073, "slack": 0.9, "push": 0.0},
        {"weather": "windy", "slack": 0.0, "length": 0.2, "push": 0.8, "wind": 1.0},
    ],
)  # fmt: skip
def test_extremes(values: dict[str, Any]) -> None:
    run = tether(**values)
    assert run.specimen.span(run).max() / run.specimen.length == pytest.approx(1.0, abs=5e-3)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(BalloonTether, 4, seed=1).values()) >= 2


@pytest.mark.slow
def test_more_random_specimens() -> None:
    assert min(judge_random(BalloonTether, 25).values()) >= 10
