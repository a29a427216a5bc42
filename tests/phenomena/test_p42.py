"""A rotating bar strikes or pushes: bars of infinite inertia, puppets and frictionless blocks are found out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from phenomena.p42_rot_board_inertia import AXLE, RotBoardInertia
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random

FREE, KEPT, DRIVEN = "a_free_bar_gives_up_speed", "angular_momentum_is_kept", "a_driven_bar_gives_up_none"
SMOOTH, LEAVES, ROUGH = (
    "a_smooth_puck_is_flung_outwards", "it_leaves_with_both_speeds", "friction_on_the_bar_holds_it_back"
)  # fmt: skip


class Unmoved(RotBoardInertia, domain="mechanics"):
    """The free bar keeps its speed whatever it strikes."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.motors[:] = [Motor(AXLE, ((0.0, self.speed),))]


class Slippery(RotBoardInertia, domain="mechanics"):
    """The rough block slides as if it were smooth."""

    def build(self, scene: Scene) -> None:
        RotBoardInertia.make(**(self.values() | {"friction": 0.0})).build(scene)


def spin(cls: type[RotBoardInertia] = RotBoardInertia, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def moved(run: Run, path: Callable[[np.ndarray], np.ndarray]) -> Run:
    """The run with what is pushed moved along a path (T, 2)."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    joint = run.model.joint(run.specimen.body.partition("/")[0] + "/free")
    x, v = joint.qposadr[0], joint.dofadr[0]
    qpos[:, x : x + 2] = path(run.t)
    qvel[:, v : v + 2] = np.gradient(qpos[:, x : x + 2], run.t, axis=0)
    return dataclasses.replace(run, qpos=qpos, qvel=qvel)


def test_a_bar_of_infinite_inertia_is_found_out() -> None:
    run = spin(Unmoved, inertia=0.02)
    assert law(run, FREE) == law(run, KEPT) == "failed"
    assert law(run, DRIVEN) == "passed"


def test_a_puck_that_gets_no_angular_momentum_is_found_out() -> None:
    run = nominal(42, DRAFT)
    still = moved(run, lambda t: np.tile([run.specimen.place, 0.0], (len(t), 1)))
    assert law(still, FREE) == law(still, KEPT) == "failed"


def test_a_puck_slid_along_the_bar_evenly_is_found_out() -> None:
    run = spin(event="smooth")

    def evenly(t: np.ndarray) -> np.ndarray:
        out = run.specimen.place + t / run.specimen.leaves * (run.specimen.length - run.specimen.place)
        return np.asarray(out[:, None] * np.column_stack([np.cos(3 * t), np.sin(3 * t)]))

    assert law(moved(run, evenly), SMOOTH) == law(moved(run, evenly), LEAVES) == "failed"


def test_a_rough_block_without_friction_is_found_out() -> None:
    run = spin(Slippery, event="rough")
    assert law(run, ROUGH) == "failed"
    assert law(run, SMOOTH) == "passed"


def test_gravity_does_not_matter() -> None:
    run = spin(event="rough")
    light = run.again(gravity=9.80665 / 2)
    early = run.t < run.specimen.leaves
    assert np.abs(light.position("sled/sled")[early] - run.position("sled/sled")[early]).max() < 1e-9


def test_the_strike_comes_when_the_bar_comes() -> None:
    run = nominal(42, DRAFT)
    assert run.impacts[0].time == pytest.approx(run.specimen.lead / run.specimen.speed, abs=1e-8)
    early = run.t < run.impacts[0].time
    assert np.abs(run.position("disc/disc")[early] - run.position("disc/disc")[0]).max() < 1e-12
    assert np.abs(run.joint_speed(AXLE)[early] - run.specimen.speed).max() < 1e-12


def test_density_of_the_pushed_does_not_matter() -> None:
    paths = [spin(event="smooth", density=density).position("disc/disc")[:70] for density in (100.0, 21300.0)]
    assert np.abs(paths[0] - paths[1]).max() < 1e-8


def test_a_heavy_puck_throws_the_bar_back() -> None:
    run = spin(density=21300.0, inertia=0.02, restitution=1.0, place=0.5)
    after = run.joint_speed(AXLE)[run.t > run.impacts[0].time][0]
    assert after < 0
    assert law(run, FREE) == law(run, KEPT) == "passed"


@pytest.mark.parametrize(
    "values",
    [
        {"event": "smooth", "place": 0.1, "speed": 10.0, "length": 0.3},
        {"event": "rough", "place": 0.1, "friction": 0.9, "speed": 1.0},
        {"event": "driven", "speed": 10.0, "place": 0.55, "density": 21300.0, "restitution": 0.1},
        {"event": "free", "place": 0.1, "inertia": 0.5, "restitution": 0.1},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = spin(**values)
    names = {"smooth": (SMOOTH, LEAVES), "rough": (ROUGH,), "driven": (DRIVEN,), "free": (FREE, KEPT)}
    assert all(law(run, name) == "passed" for name in names[values["event"]])


@pytest.mark.parametrize(
    ("values", "rule"), [({"length": 0.4, "place": 0.5}, "R12"), ({"inertia": 0.005, "length": 0.8}, "R3")]
)
def test_refusals(values: dict[str, Any], rule: str) -> None:
    with pytest.raises(Refusal, match="allowed: 0") as refusal:
        spin(**values)
    assert refusal.value.rule == rule


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(RotBoardInertia, count=2, seed=1).values()) >= 1


@pytest.mark.slow
def test_many_random_specimens() -> None:
    judge_random(RotBoardInertia, count=25, seed=42)
