"""The stretched spring against programs that only look like one."""

from __future__ import annotations

import dataclasses
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p23_spring_stretch import SpringStretch
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random

PERIOD = "period_knows_mass_and_stiffness_only"


def bob(cls: type[SpringStretch] = SpringStretch, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> str:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict


def keyframed(run: Run, path: np.ndarray, speed: np.ndarray) -> Run:
    """The weight moved along a path whatever is asked for."""
    return dataclasses.replace(
        run, qpos=path[:, None], qvel=speed[:, None], again_with=lambda **_: keyframed(run, path, speed), _repeats={}
    )


class ManyAsOne(SpringStretch, domain="mechanics"):
    """However many springs there are, they act as the first alone."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        first = scene.spec.tendon("spring0")
        count = len(self.stiffnesses)
        for i in range(count):
            factor = count if self.hung == "series" else 1 / count
            scene.spec.tendon(f"spring{i}").stiffness = [factor * first.stiffness[0], 0, 0] if i else first.stiffness


class Hardening(SpringStretch, domain="mechanics"):
    """A spring whose force grows with the cube of its stretch too."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for i, k in enumerate(self.stiffnesses):
            scene.spec.tendon(f"spring{i}").stiffness = [float(k), 0, 2.0 * float(k)]


class Rusty(SpringStretch, domain="mechanics"):
    """Friction that nobody declared."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.joint("weight/stretch").damping = [1e-3, 0, 0]


def test_a_rope_that_does_not_stretch_is_found_out() -> None:
    run = nominal(23, DRAFT)
    still = keyframed(run, np.zeros(len(run)), np.zeros(len(run)))
    assert {PERIOD, "hangs_lower_by_its_weight_over_the_stiffness"} <= failed(still)


def test_a_cosine_animation_is_found_out() -> None:
    """It is the nominal motion to the last digit, but the same for every mass."""
    run = nominal(23, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringStretch)
    rate, amplitude, middle = specimen.rate, specimen.amplitude, specimen.sags[-1]
    path = -middle - amplitude * np.cos(rate * run.t)
    cosine = keyframed(run, path, amplitude * rate * np.sin(rate * run.t))
    assert np.abs(cosine.qpos - run.qpos).max() < 1e-6
    assert judge(cosine, PERIOD) == "failed"


def test_springs_that_do_not_add_up_are_found_out() -> None:
    assert judge(bob(ManyAsOne), "in_a_row_they_soften_and_abreast_they_stiffen") == "failed"


def test_a_spring_that_is_not_linear_is_found_out() -> None:
    assert {PERIOD, "hangs_lower_by_its_weight_over_the_stiffness"} <= failed(bob(Hardening))


def test_hidden_friction_is_found_out() -> None:
    run = bob(Rusty)
    assert judge(run, "swing_and_stretch_share_their_energy") == "failed"
    assert judge(run, "swings_shrink_alike") == "failed"


def test_half_the_gravity_halves_the_sag_and_leaves_the_period() -> None:
    run = nominal(23, DRAFT)
    light = run.again(gravity=g / 2)
    specimen = run.specimen
    assert isinstance(specimen, SpringStretch)
    middles = [np.ptp(specimen.elongation(r)) / 2 + specimen.elongation(r).min() for r in (run, light)]
    assert middles[1] == pytest.approx(middles[0] / 2, rel=1e-3)


def test_in_resonance_the_bob_becomes_a_swing() -> None:
    """Two to one: a spring stretched to 4/3 of its length swings half as fast as it bobs, and hands its energy over."""
    mass, length = 0.5, 0.4
    arm = SpringStretch.make(mass=mass).arm
    stiffness = 3 * mass * g / (length + arm)
    run = bob(hung="swinging", mass=mass, length=length, stiffness=stiffness, amplitude=0.12, angle=0.05)
    assert np.abs(run.joint("weight/swing")).max() > 0.25
    off = bob(hung="swinging", mass=mass, length=length, stiffness=2.5 * stiffness, amplitude=0.12, angle=0.05)
    assert np.abs(off.joint("weight/swing")).max() < 0.1


def test_a_swing_is_mirrored() -> None:
    class Mirrored(SpringStretch, domain="mechanics"):
        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.start["weight/swing"] = -self.angle

    one, other = bob(hung="swinging"), bob(Mirrored, hung="swinging")
    assert np.abs(one.joint("weight/swing") + other.joint("weight/swing")).max() < 1e-9
    assert np.abs(one.joint("weight/stretch") - other.joint("weight/stretch")).max() < 1e-9


@pytest.mark.parametrize("hung", ["one", "series", "parallel", "swinging"])
def test_coils_hang_between_what_they_join(hung: str) -> None:
    run = bob(hung=hung, amplitude=0.04)
    specimen = run.specimen
    assert isinstance(specimen, SpringStretch)
    assert len(run.scene.coils) == len(specimen.stiffnesses) == run.model.ntendon
    stretch = specimen.elongation(run)
    assert stretch[0] == pytest.approx(specimen.sags[-1] + specimen.amplitude, rel=1e-9)
    if hung == "series":
        links = [run.position(f"link{i}/link")[0, 2] for i in range(len(specimen.stiffnesses) - 1)]
        assert links == sorted(links, reverse=True)


def test_the_continued_fraction_is_the_slowest_mode() -> None:
    specimen = SpringStretch.make(hung="series", springs=4, ratio=0.7)
    assert specimen.slowest() == pytest.approx(specimen.rate**2, rel=1e-12)
    light = specimen.mass * specimen.slowest() * np.sum(1 / specimen.stiffnesses)
    assert light == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"stiffness": 1000.0, "mass": 0.05, "amplitude": 0.2, "length": 0.5}, "swings_shrink_alike"),
        ({"stiffness": 40.0, "mass": 3.0, "amplitude": 0.2}, PERIOD),
        (
            {"hung": "series", "springs": 4, "stiffness": 200.0, "damping": 0.1, "ratio": 1.6},
            "in_a_row_they_soften_and_abreast_they_stiffen",
        ),
    ],
)
def test_extremes(values: dict[str, Any], law: str) -> None:
    assert judge(bob(**values), law) == "passed"


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"stiffness": 5.0, "mass": 3.0}, r"sag of 5\.88 m .*allowed: 0\.85 m, .*34\.6 N/m"),
        ({"stiffness": 900.0, "mass": 0.1, "amplitude": 0.2}, r"windings touch .*allowed: 0\.16"),
        ({"hung": "swinging", "stiffness": 900.0, "amplitude": 0.1}, r"throw the weight up .*allowed"),
        ({"hung": "series", "springs": 4, "length": 0.5}, r"hangs .* deep; allowed: 2\.2 m"),
    ],
)
def test_refusals(values: dict[str, Any], names: str) -> None:
    with pytest.raises(Refusal, match=f"R12.*{names}"):
        bob(**values)


def test_period_is_that_of_the_books() -> None:
    run = nominal(23, DRAFT)
    assert isinstance(run.specimen, SpringStretch)
    assert run.specimen.swing_time(run) == pytest.approx(2 * pi * sqrt(0.5 / 25.0), rel=1e-8)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(SpringStretch, count=3).values()) >= 2


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(SpringStretch, count=25, seed=1).values()) >= 10
