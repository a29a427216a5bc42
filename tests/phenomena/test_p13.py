"""Attracting magnets: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from phenomena.p13_magnet_attract import LOOSE, SOURCE, MagnetAttract
from physinone_mj.base import Refusal, Verdict
from physinone_mj.effects import Magnets
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Push, Scene
from physinone_mj.simulate import simulate_specimen
from tests.conftest import nominal

from .verdicts import judge_random


@dataclass(frozen=True)
class Lazy:
    """Magnets, with something taken away or added."""

    true: Magnets
    kind: str

    def bind(self, model: Any) -> Push:
        push = self.true.bind(model)
        sites = [model.site(name).id for m in self.true.magnets for name in (m.north, m.south)]
        loose = model.body(LOOSE).id
        strength = self.true.magnets[0].strength

        def lazy(data: Any) -> None:
            if self.kind == "without reaction":
                push(data)
                data.xfrc_applied[model.body(SOURCE).id] = 0
            elif self.kind == "without torque":
                push(data)
                data.xfrc_applied[:, 3:] = 0
            else:
                for i, mine in enumerate(sites[2:]):
                    for j, other in enumerate(sites[:2]):
                        arm = data.site_xpos[mine] - data.site_xpos[other]
                        r = np.linalg.norm(arm)
                        if self.kind == "1/r":
                            force = (-1) ** (i + j) * strength * arm / r**2
                        else:  # every pole attracts every other
                            force = -strength * arm / r**3
                        data.xfrc_applied[loose, :3] += force
                        data.xfrc_applied[model.body(SOURCE).id, :3] -= force

        return lazy

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


class Tampered(MagnetAttract, domain="magnetism"):
    """Built with lazy magnets."""

    kind = ""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        (true,) = scene.effects
        assert isinstance(true, Magnets)
        scene.effects = [Lazy(true, self.kind)]


class InverseDistance(Tampered, domain="magnetism"):
    """F = k/r."""

    kind = "1/r"


class OneSided(Tampered, domain="magnetism"):
    """The source feels nothing."""

    kind = "without reaction"


class Untwisted(Tampered, domain="magnetism"):
    """No magnet turns."""

    kind = "without torque"


class Greedy(Tampered, domain="magnetism"):
    """Like poles attract each other too."""

    kind = "all attract"


class TurnedRound(MagnetAttract, domain="magnetism"):
    """The same bars, like poles facing."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        north, south = scene.spec.site("loose/N"), scene.spec.site("loose/S")
        north.pos, south.pos = np.array(south.pos), np.array(north.pos)


def pull(cls: type[MagnetAttract] = MagnetAttract, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def judge(run: Run, law: str) -> Verdict:
    return run.specimen.laws()[law].judge(run.specimen, run)


@pytest.mark.slow
def test_a_pull_of_one_over_r_is_found_out() -> None:
    run = pull(InverseDistance, place="one on a rail", gap=0.01, pole_distance=0.12, mass=0.5, core=0.003)
    for law in ("far_dipoles_and_near_poles", "falls_down_the_well"):
        assert judge(run, law).verdict == "failed", law


def test_a_pull_without_reaction_is_found_out() -> None:
    assert judge(pull(OneSided), "action_is_reaction").verdict == "failed"


def test_magnets_that_do_not_turn_are_found_out() -> None:
    assert judge(pull(Untwisted), "needle_swings_in_the_field").verdict == "failed"


@pytest.mark.slow
def test_attraction_of_like_poles_is_found_out() -> None:
    assert judge(pull(Greedy), "four_pairs_of_poles_pull").verdict == "failed"


def test_like_poles_repel_as_strongly() -> None:
    near, turned = pull(gap=0.1), pull(TurnedRound, gap=0.1)
    assert turned.position(LOOSE)[-1, 0] > turned.position(LOOSE)[0, 0]
    moved = [r.position(LOOSE)[1, 0] - r.position(LOOSE)[0, 0] for r in (near, turned)]
    assert moved[1] == pytest.approx(-moved[0], rel=0.01)


@pytest.mark.slow
def test_exponents_are_those_of_dipoles_and_of_poles() -> None:
    run = nominal(13, DRAFT)
    law = run.specimen.laws()["far_dipoles_and_near_poles"]
    far, near = law.measure(run.specimen, run)[0]  # type: ignore[misc]
    assert far == pytest.approx(-4.0, abs=0.03)
    assert near == pytest.approx(-2.0, abs=0.03)


def test_they_meet_when_the_energy_says() -> None:
    run = nominal(13, DRAFT)
    assert isinstance(run.specimen, MagnetAttract)
    assert run.impacts[0].time == pytest.approx(run.specimen.meeting(), rel=1e-5)
    assert run.specimen.pole_gap(run).min() == pytest.approx(2 * run.specimen.core, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("values", [{}, {"place": "one on a rail"}, {"place": "table", "gap": 0.06, "strength": 6e-3}])
def test_snapping_gains_no_energy_and_they_stay(values: dict[str, Any]) -> None:
    run = pull(**values)
    specimen = run.specimen
    assert isinstance(specimen, MagnetAttract)
    energy = specimen.energy(run)
    scale = float(specimen.well(2 * specimen.core))
    after = run.t > run.impacts[0].time
    assert energy[~after][1:] == pytest.approx(energy[0], abs=1e-5 * scale) or specimen.place == "table"
    assert np.all(energy[after] <= energy[0] + 1e-5 * scale)
    assert np.all(np.diff(energy[after]) <= 1e-3 * scale)
    last = run.t > run.t[-1] - 0.5
    assert np.abs(run.velocity(LOOSE)[last]).max() < 1e-5
    assert specimen.pole_gap(run)[-1] == pytest.approx(2 * specimen.core, rel=0.05)


def test_a_turned_magnet_falls_into_line() -> None:
    run = pull(place="table", gap=0.06, strength=6e-3, angle=0.6)
    assert 2 * np.arcsin(abs(run.quaternion(LOOSE)[0, 3])) == pytest.approx(0.6)
    assert 2 * np.arcsin(abs(run.quaternion(LOOSE)[-1, 3])) < 0.02


def test_half_the_gravity_lets_go() -> None:
    """8 cm are too far to overcome friction under g, not under half of it."""
    run = pull(place="table", angle=0.0, gap=0.08)
    light = run.again(gravity=9.80665 / 2)
    assert np.abs(run.position(LOOSE)[-1] - run.position(LOOSE)[0]).max() < 1e-6
    assert light.position(LOOSE)[0, 0] - light.position(LOOSE)[-1, 0] > 0.01


def test_equal_ones_mirror_each_other() -> None:
    run = pull(source_mass=0.15)
    assert np.abs(run.position(LOOSE)[:, 0] + run.position(SOURCE)[:, 0]).max() < 1e-9


def test_without_magnetism_nothing_moves() -> None:
    class Wood(MagnetAttract, domain="magnetism"):
        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.effects = []

    run = pull(Wood)
    assert not run.qvel.any()
    assert judge(run, "falls_down_the_well").verdict == "failed"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("falls_down_the_well", {"strength": 1e-2, "core": 0.002, "mass": 0.02, "gap": 0.05}),
        ("falls_down_the_well", {"strength": 1e-2, "core": 0.01, "gap": 0.4, "place": "one on a rail", "mass": 0.5}),
        ("four_pairs_of_poles_pull", {"strength": 1e-4, "gap": 0.4}),  # hardly moves in ten seconds
    ],
)
def test_extremes(law: str, values: dict[str, Any]) -> None:
    assert judge(pull(**values), law).verdict == "passed"


def test_poles_too_close_at_the_start_are_refused() -> None:
    with pytest.raises(Refusal, match=r"R5.*gap = 0.01 m .* allowed: 0.0132 m or more"):
        pull(gap=0.01)


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(MagnetAttract).values()) >= 5
