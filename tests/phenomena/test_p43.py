"""A tray and its load: loads tied to it, and endless friction, are found out; stacks and mass ratios behave."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p43_lin_carry_inertia import TRAY, LinCarryInertia
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.measure import acceleration, between
from physinone_mj.run import Run
from physinone_mj.scene import Matter, Scene
from physinone_mj.simulate import Stepper, build, compile, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed, judge_random

RIDES, LEFT, ONE, STOPPED, TOPPLES = LinCarryInertia.laws()


class Endless(LinCarryInertia, domain="mechanics"):
    """Friction without a limit."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for name, matter in scene.matter.items():
            scene.matter[name] = Matter(matter.density, Surface(friction=20.0))


def carry(cls: type[LinCarryInertia] = LinCarryInertia, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def tied(run: Run) -> Run:
    """The run, and every twin of it, with the block moved as a part of the tray."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    tray, block = run.model.joint("tray/glide"), run.model.joint("block1/free")
    qpos[:, block.qposadr[0] :][:, :7] = qpos[0, block.qposadr[0] :][:7]
    qpos[:, block.qposadr[0]] += qpos[:, tray.qposadr[0]] - qpos[0, tray.qposadr[0]]
    qvel[:, block.dofadr[0] :][:, :6] = 0.0
    qvel[:, block.dofadr[0]] = qvel[:, tray.dofadr[0]]
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, again_with=lambda **c: tied(run.again(**c)), _repeats={})


def test_a_load_tied_to_the_tray_is_found_out() -> None:
    assert failed(tied(nominal(43, DRAFT))) == {RIDES, LEFT, STOPPED, TOPPLES}


def test_endless_friction_is_found_out() -> None:
    assert {RIDES, LEFT, STOPPED} <= failed(carry(Endless))


def test_half_the_gravity_halves_the_braking() -> None:
    run = carry(friction=0.4)
    brakes = []
    for r in (run, run.again(gravity=g / 2)):
        when = r.specimen.stop_time(r)
        slides = between(r.t, when, when + 0.2)
        brakes.append(acceleration(r.t[slides], r.position("block1/block")[slides, 0]))
    assert brakes == pytest.approx([-0.4 * g, -0.2 * g], rel=1e-9)


def test_a_smooth_load_stays_where_it_is() -> None:
    run = carry(friction=0.0)
    riding = run.specimen.riding(run)
    place = run.position("block1/block")[:, 0]
    assert np.abs(place - place[0])[riding].max() < 1e-12
    assert np.ptp(run.position(TRAY)[riding, 0]) > 1.0


def test_the_mass_of_the_load_does_not_matter() -> None:
    run = nominal(43, DRAFT)
    light = run.again(mass=0.3)
    assert light.specimen.slip(light)[-1] == pytest.approx(run.specimen.slip(run)[-1], rel=1e-4)


def test_a_nearer_stop_comes_sooner() -> None:
    run = nominal(43, DRAFT)
    near = run.again(way=run.specimen.way / 4)
    assert run.specimen.stop_time(run) / near.specimen.stop_time(near) == pytest.approx(2.0, rel=1e-8)


@pytest.mark.parametrize(("mass", "tray_mass"), [(10.0, 0.05), (0.05, 10.0)])
def test_mass_ratios_of_two_hundred(mass: float, tray_mass: float) -> None:
    run = carry(mass=mass, tray_mass=tray_mass, density=2000.0)
    assert {STOPPED, ONE, LEFT} & failed(run) == set()


HEAVY: dict[str, Any] = {
    "thrust": 10.0, "friction": 0.9, "tray_mass": 0.05, "mass": 10.0, "stack": 1, "slender": 0.5, "density": 21300.0
}  # fmt: skip


def test_how_a_load_of_two_hundred_trays_slips_is_found() -> None:
    """By a series that shrinks by a hundredth at a time: it has to be summed, not waited for."""
    specimen = LinCarryInertia.make(**HEAVY)
    with Stepper(compile(specimen, build(specimen), DRAFT)) as stepper:
        for _ in range(4):
            stepper.advance()
        assert stepper.data.qvel[stepper.model.joint("tray/glide").dofadr[0]] != 0
        assert stepper.eased == {}


def test_a_load_of_two_hundred_trays_slips_without_a_hop() -> None:
    one = carry(**HEAVY)
    specimen = one.specimen
    riding = specimen.riding(one)
    heights = one.position("block1/block")[riding, 2]
    assert np.ptp(heights) < 1e-9
    tray = acceleration(one.t[riding], one.position(TRAY)[riding, 0])
    assert tray == pytest.approx((0.05 + 10.0) * 10.0 / 0.05 - 0.9 * 10.0 * g / 0.05, rel=1e-9)


def test_a_stack_of_four_rides_along() -> None:
    run = carry(stack=4, slender=0.8, friction=0.2, thrust=1.9)
    riding = run.specimen.riding(run)
    tray = run.position(TRAY)[riding, 0]
    for i in range(4):
        gap = run.position(f"block{i + 1}/block")[riding, 0] - tray
        assert np.abs(gap - gap[0]).max() < 1e-9
    assert {ONE, STOPPED, LEFT} & failed(run) == set()


def test_a_tall_load_falls_over_backwards() -> None:
    run = carry(slender=3.0, friction=0.9, thrust=5.0)
    assert run.specimen.uprightness(run)[run.specimen.riding(run)].min() < 0.9
    assert run.specimen.slip(run).min() < -0.05


def test_a_tall_load_falls_over_forwards_at_the_stop() -> None:
    run = carry(slender=3.0, friction=0.6, thrust=3.0)
    upright = run.specimen.uprightness(run)
    assert upright[run.specimen.riding(run)].min() > 1 - 1e-9
    assert upright.min() < 0.5


def test_a_load_heavier_than_two_hundred_trays_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R3: a load of 10.1 kg on a tray of 0.05 kg; allowed: 200 times"):
        carry(mass=5.05, stack=2, tray_mass=0.05)


def test_a_block_wider_than_the_tray_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R1: blocks 0.322 m wide .*allowed: a density of 740.7"):
        carry(mass=10.0, slender=0.5, density=600.0)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(LinCarryInertia, count=2, seed=5).values()) == 2


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(LinCarryInertia, count=25, seed=6).values()) >= 18
