"""Things that break: programs that only look right are told from the true one, and the corners of the range hold."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest

from phenomena import p24_impact_fracture
from phenomena.p24_impact_fracture import ImpactFracture
from physinone_mj import fracture
from physinone_mj.base import Refusal
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT, STANDARD
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen
from physinone_mj.stress import deepest
from tests.conftest import nominal

from .verdicts import failed, judge_random, verdicts

WEAK, STRONG = {"strength": 1e6}, {"strength": 1e9}


class Brief(ImpactFracture, domain="mechanics"):
    """Watched until shortly after it lands."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.duration = self.fall + 0.12


@functools.cache
def drop(cls: type[ImpactFracture] = Brief, **values: Any) -> Run:
    return simulate_specimen(cls.make(**({"shape": "brick", "chunks": 8} | values)), fidelity=DRAFT)


def laws(run: Run, *names: str) -> dict[str, str]:
    return {name: run.specimen.laws()[name].judge(run.specimen, run).verdict for name in names}


def altered(run: Run, from_: float, kick: Any) -> Run:
    """The run with the chunks' velocities changed by `kick(place from the middle)` from a time on."""
    qpos, qvel = run.qpos.copy(), run.qvel.copy()
    late = run.t >= from_
    first = int(np.argmax(late))
    middle = np.mean([run.position(body)[first] for body in run.specimen.bodies], axis=0)
    for body in run.specimen.bodies:
        joint = run.model.joint(f"{body}.free")
        dv = kick(run.position(body)[first] - middle)
        qvel[late, joint.dofadr[0] : joint.dofadr[0] + 3] += dv
        qpos[late, joint.qposadr[0] : joint.qposadr[0] + 3] += np.outer(run.t[late] - from_, dv)
    return dataclasses.replace(run, qpos=qpos, qvel=qvel, _repeats={})


def test_an_outward_kick_is_found_out() -> None:
    run = drop(event="clash", **WEAK)
    hit = run.breaks[0].time
    exploding = altered(run, hit, lambda away: 3.0 * away / np.linalg.norm(away))
    names = "breaking_does_not_change_the_momentum", "breaking_sets_no_energy_free"
    assert set(laws(run, *names).values()) == {"passed"}
    assert set(laws(exploding, *names).values()) == {"failed"}


def test_a_push_of_all_fragments_is_found_out() -> None:
    run = drop(event="clash", **WEAK)
    pushed = altered(run, run.breaks[0].time, lambda _: np.array([0.05, 0.0, 0.0]))
    names = "fragments_together_stay_on_the_parabola", "breaking_does_not_change_the_momentum"
    assert set(laws(run, *names).values()) == {"passed"}
    assert set(laws(pushed, *names).values()) == {"failed"}


class AtATimer(Brief, domain="mechanics"):
    """Comes apart when the time has come, whatever the load."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.bonds.clear()
        scene.cuts |= dict.fromkeys(self.welds, 0.95 * self.fall)


class HeldByNothing(Brief, domain="mechanics"):
    """Breaks at half the load."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.bonds[:] = [dataclasses.replace(bond, strength=bond.strength / 2) for bond in scene.bonds]


class Lighter(Brief, domain="mechanics"):
    """Loses two chunks on the way."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for body in self.bodies[:2]:
            scene.spec.body(body).mass = 1e-3
            scene.spec.body(body).fullinertia = (1e-6, 1e-6, 1e-6, 0, 0, 0)


def test_a_timer_is_found_out() -> None:
    run = drop(AtATimer, shape="column", height=0.3, **STRONG)
    names = "column_breaks_from_a_certain_height_on", "hanging_block_falls_when_too_heavy"
    assert set(laws(run, *names).values()) == {"failed"}
    assert not drop(shape="column", height=0.3, **STRONG).breaks


def test_bonds_of_half_the_strength_are_found_out() -> None:
    names = "column_breaks_from_a_certain_height_on", "hanging_block_falls_when_too_heavy"
    assert set(laws(drop(HeldByNothing, shape="column"), *names).values()) == {"failed"}
    assert set(laws(drop(shape="column"), *names).values()) == {"passed"}


def test_fragments_that_vanish_are_found_out() -> None:
    assert laws(drop(Lighter, height=0.2, **STRONG), "chunks_weigh_what_the_thing_does") == {
        "chunks_weigh_what_the_thing_does": "failed"
    }


def test_what_breaks_depends_on_where_it_is_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = []
    for turn in ((0.3, 0.35), (-0.3, -0.35), (0.6, 0.0)):
        monkeypatch.setitem(p24_impact_fracture.TILT, "plate", turn)
        run = simulate_specimen(Brief.make(shape="plate", chunks=14, strength=1e7, height=0.5), fidelity=DRAFT)
        gone.append(frozenset(b.weld for b in run.breaks if b.time < run.breaks[0].time + 1e-6))
    assert len(set(gone)) == 3


def test_the_faster_the_more_bonds_go() -> None:
    counts = []
    for height in (0.2, 0.5, 2.0):
        run = drop(height=height, strength=3e6)
        counts.append(sum(b.time < run.breaks[0].time + 1e-9 for b in run.breaks))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_below_the_threshold_it_falls_as_one() -> None:
    run = drop(height=0.2, **STRONG)
    assert not run.breaks
    assert run.specimen.fragments(run).max() == 1
    places = [run.position(body) for body in run.specimen.bodies]
    apart = [np.linalg.norm(p - q, axis=1) for i, p in enumerate(places) for q in places[:i]]
    assert max(np.ptp(a) / a[0] for a in apart) < 5e-3


def test_half_the_gravity_takes_root_two_as_long() -> None:
    run = drop(ImpactFracture, shape="column", height=0.5, strength=1e3)
    low = run.again(gravity=9.80665 / 2)
    assert low.breaks[0].time / run.breaks[0].time == pytest.approx(np.sqrt(2), rel=1e-7)


def test_unbroken_it_lands_when_a_point_does() -> None:
    for height in (0.3, 0.6):
        run = drop(height=height, **WEAK)
        assert run.impacts[0].time == pytest.approx(np.sqrt(2 * height / 9.80665), rel=1e-6)


def test_what_never_breaks_stays_whole() -> None:
    class Eternal(Brief, domain="mechanics"):
        """σ = ∞."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.bonds.clear()

    assert drop(Eternal, height=2.0, density=21300.0).specimen.fragments(drop(height=0.2, **STRONG)).max() == 1


def test_it_comes_to_rest() -> None:
    run = nominal(24, DRAFT)
    assert run.motion.kinetic[-1] < 1e-6 * run.motion.kinetic.max()
    assert run.specimen.fragments(run)[-1] > 4


@pytest.mark.parametrize(
    "values",
    [
        {"height": 2.0, "density": 21300.0, "restitution": 0.8, "strength": 1e2},
        {"height": 0.2, "friction": 0.9, "restitution": 0.1, "strength": 1e7},
        {"event": "clash", "speed": 10.0, "density": 100.0, "strength": 1e3},
        {"shape": "column", "event": "hang", "density": 100.0, "strength": 1e2},
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = drop(**values)
    assert "failed" not in verdicts(run).values()


def test_hanging_is_for_columns() -> None:
    with pytest.raises(Refusal, match=r"R12.*allowed: shape = column"):
        drop(shape="pot", event="hang")


def test_two_in_one_scene_bump_into_each_other() -> None:
    scene, broken = Scene(), fracture.shatter(fracture.box(0.1, 0.06, 0.03), (8,), 0)
    for name, x in (("one", -0.3), ("two", 0.3)):
        fracture.place(scene, name, broken, density=21300.0, surface=Surface(), stress=1e3, position=(x, 0, 1.0))
    assert len({body.name for body in scene.spec.bodies}) == len(list(scene.spec.bodies))
    scene.spec.compile()


def test_pieces_do_not_sink_into_the_floor() -> None:
    """A weak plate goes to pieces as it lands: a crowd of impacts, some of them at 6 m/s in a step of 4 ms."""
    heavy = {"density": 21300.0, "friction": 0.9, "restitution": 0.1}
    overlap, crowded = deepest(drop(shape="plate", strength=100.0, height=2.0, **heavy))
    assert max(overlap[0], crowded[0]) < 0.05


def test_random_specimens() -> None:
    rng = np.random.default_rng(3)
    for _ in range(3):
        specimen = Brief.sample(rng, chunks=8, event="drop")
        assert not failed(simulate_specimen(specimen, fidelity=DRAFT)), specimen


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(ImpactFracture, 25).values()) >= 5


@pytest.mark.slow
def test_sixty_chunks() -> None:
    run = simulate_specimen(ImpactFracture.make(chunks=60), fidelity=STANDARD)
    assert not failed(run)
