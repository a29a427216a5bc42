"""A compressed spring: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p22_spring_compress import PLATE, SpringCompress
from physinone_mj.base import Verdict
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts


class HardBounce(SpringCompress, domain="mechanics"):
    """Bounces off a plate that hardly gives way, the spring is an ornament."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.tendon("spring/spring").stiffness = [25 * self.stiffness, 0, 0]


class OtherSpring(SpringCompress, domain="mechanics"):
    """The same spring whatever stiffness is asked for."""

    def build(self, scene: Scene) -> None:
        SpringCompress(**(self.values() | {"stiffness": 80.0})).build(scene)


class Rebound(SpringCompress, domain="mechanics"):
    """The plate bounces off the glider instead of going along."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name in ("spring/plate", "glider/nose"):
            scene.matter[name] = dataclasses.replace(scene.matter[name], surface=Surface(restitution=1.0))


class Loose(SpringCompress, domain="mechanics"):
    """The glider passes through the plate."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.touching = [pair for pair in scene.touching if "glider/nose" not in pair]


def push(cls: type[SpringCompress] = SpringCompress, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> Verdict:
    return run.specimen.laws()[law].judge(run.specimen, run)


def test_a_bounce_with_a_spring_drawn_on_top_is_found_out() -> None:
    assert {"stays_for_half_a_period", "compresses_by_its_speed"} <= failed(push(HardBounce))


def test_a_spring_that_ignores_its_stiffness_is_found_out() -> None:
    assert {"stays_for_half_a_period", "compresses_by_its_speed", "weight_presses_deeper"} <= failed(push(OtherSpring))


def test_a_plate_that_bounces_off_is_found_out() -> None:
    assert judge(push(Rebound), "compresses_by_its_speed").verdict == "failed"


def test_a_scripted_squash_is_found_out() -> None:
    """The coil shortens by nine tenths of what the glider moves."""
    run = nominal(22, DRAFT)
    qpos = run.qpos.copy()
    qpos[:, run.model.joint("spring/plate").qposadr[0]] *= 0.9
    squashed = dataclasses.replace(run, qpos=qpos, _repeats={})
    assert {"coil_is_drawn_as_long_as_it_is", "compresses_by_its_speed"} <= failed(squashed)


def test_a_plate_that_nothing_touches_stays() -> None:
    run = push(Loose)
    specimen = run.specimen
    assert isinstance(specimen, SpringCompress)
    assert np.abs(specimen.compression(run)).max() < 1e-12
    assert np.abs(specimen.velocity(run) + specimen.speed).max() < 1e-12


def test_the_glider_arrives_when_it_should() -> None:
    run = nominal(22, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringCompress)
    assert specimen.met(run) == pytest.approx(specimen.way_to_go / specimen.speed, rel=1e-9)


def test_contact_is_one_sided() -> None:
    """The plate pushes and never pulls: behind the glider it stays at the nuts."""
    run = nominal(22, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringCompress)
    gone = run.t > specimen.released(run) + 0.05
    assert np.abs(specimen.compression(run)[gone]).max() < 1e-6
    assert specimen.compression(run).min() > -1e-8


def test_half_the_gravity_leaves_the_glider_alone_and_the_ball_less_deep() -> None:
    run = nominal(22, DRAFT)
    light = run.again(gravity=9.80665 / 2)
    assert np.abs(light.position("glider/glider") - run.position("glider/glider")).max() < 1e-6
    ball = push(way="vertical", stiffness=300.0)
    assert isinstance(ball.specimen, SpringCompress)
    deep, less = (ball.specimen.compression(r).max() for r in (ball, ball.again(gravity=9.80665 / 2)))
    assert less < 0.8 * deep


def test_the_coil_hangs_between_wall_and_plate() -> None:
    run = nominal(22, DRAFT)
    specimen = run.specimen
    assert isinstance(specimen, SpringCompress)
    (coil,) = run.scene.coils
    assert coil.tendon == "spring/spring"
    assert specimen.drawn_length(run) == pytest.approx(specimen.length - specimen.compression(run), abs=1e-12)
    plate = run.position("spring/plate")[:, 0]
    assert specimen.drawn_length(run) == pytest.approx(plate - PLATE / 2, abs=1e-12)


@pytest.mark.parametrize("way", ["horizontal", "vertical"])
def test_windings_that_touch_stop_it(way: str) -> None:
    run = push(way=way, stiffness=20.0, mass=5.0, speed=4.0, drop=1.0, length=0.2)
    specimen = run.specimen
    assert isinstance(specimen, SpringCompress)
    assert any("stop" in i.first + i.second for i in run.impacts)
    assert specimen.compression(run).max() == pytest.approx(specimen.travel, rel=1e-3)
    assert "windings touch" in specimen.caption(run)
    assert judge(run, "compresses_by_its_speed").verdict != "failed"


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"stiffness": 5000.0, "mass": 0.05, "speed": 2.0},
        {"mass": 5.0, "plate": 0.005, "stiffness": 400.0},
        {"way": "vertical", "mass": 0.05, "plate": 0.5, "stiffness": 500.0, "drop": 0.3},
        {"way": "vertical", "damping": 0.2, "stiffness": 500.0, "drop": 0.0},
    ],
)  # fmt: skip
def test_extremes(values: dict[str, Any]) -> None:
    assert "failed" not in verdicts(push(**values)).values()


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(SpringCompress).values()) >= 10
