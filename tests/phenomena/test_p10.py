"""Falling balls: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from phenomena.p10_vertical_fall import VerticalFall
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts


class Drag(VerticalFall, domain="mechanics"):
    """Falls towards a terminal speed."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for joint in scene.spec.joints:
            joint.damping = [0.05, 0, 0]


class SameBounce(VerticalFall, domain="mechanics"):
    """Bounces with e = 0.5 whatever is asked for."""

    def build(self, scene: Scene) -> None:
        VerticalFall(**(self.values() | {"restitution": 0.5})).build(scene)


@dataclasses.dataclass(frozen=True)
class Heaviness:
    """Pulls every body down with 1 % of its weight more per kilogram."""

    def bind(self, model: Any) -> Callable[[Any], None]:
        extra = 0.01 * model.body_mass**2 * 9.80665

        def push(data: Any) -> None:
            data.xfrc_applied[:, 2] -= extra

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


class HeavierIsFaster(VerticalFall, domain="mechanics"):
    """Aristotle's fall."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.effects.append(Heaviness())


def fall(cls: type[VerticalFall] = VerticalFall, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def test_drag_is_found_out() -> None:
    assert {"falls_with_g", "acceleration_is_g", "lands_with_torricellis_speed"} <= failed(fall(Drag))


def test_one_bounce_for_all_is_found_out() -> None:
    assert "bounces_to_the_same_fraction" in failed(fall(SameBounce, restitution=0.7))
    assert not failed(fall(SameBounce, restitution=0.5))


def test_aristotle_is_found_out() -> None:
    assert "all_land_together" in failed(fall(HeavierIsFaster))


def test_half_the_gravity_takes_root_two_as_long() -> None:
    run = nominal(10, DRAFT)
    low = run.again(gravity=9.80665 / 2)
    assert low.impacts[0].time / run.impacts[0].time == pytest.approx(np.sqrt(2), rel=1e-8)


def test_a_ball_alone_falls_as_in_company() -> None:
    run = nominal(10, DRAFT)
    alone = run.again(count=1)
    n = np.searchsorted(run.t, run.specimen.fall)
    assert np.abs(alone.position("ball0/ball")[:n, 2] - run.position("ball0/ball")[:n, 2]).max() < 1e-12


def test_density_of_all_changes_nothing() -> None:
    run = nominal(10, DRAFT)
    dense = run.again(density=2 * run.specimen.density)
    assert np.abs(dense.specimen.heights(dense) - run.specimen.heights(run)).max() < 1e-9


def test_straight_down_and_at_rest_in_the_end() -> None:
    run = nominal(10, DRAFT)
    for ball in run.specimen.balls():
        assert np.abs(run.position(ball)[:, :2] - run.position(ball)[0, :2]).max() < 1e-12
        assert np.abs(run.velocity(ball)[run.t > run.specimen.rest + 0.1]).max() < 1e-6
        assert np.abs(run.specimen.clearance(run, ball)[-1]) < 2e-9


@pytest.mark.parametrize(
    "values",
    [
        {"height": 2.5, "density": 21300.0, "radius": 0.03, "restitution": 0.8},
        {"height": 2.5, "density": 100.0, "restitution": 0.8, "count": 5},
        {"height": 0.2, "restitution": 0.1, "count": 5},
        {"height": 0.2, "restitution": 0.8, "radius": 0.12},
    ],
)  # fmt: skip
def test_extremes(values: dict[str, Any]) -> None:
    run = fall(**values)
    assert set(verdicts(run).values()) == {"passed"}
    assert len(run.impacts) < 500


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(VerticalFall).values()) >= 6
