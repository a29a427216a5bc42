"""Chains: curves that only look hung, links that stretch, springs and other loads are told from statics."""

from __future__ import annotations

import dataclasses
from math import cosh, sinh, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from phenomena.p45_chain_suspend import ChainSuspend
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import UnstableScene, simulate_specimen
from tests.conftest import nominal

from .verdicts import failed


def law(run: Run, name: str) -> str:
    return run.specimen.laws()[name].judge(run.specimen, run).verdict


def chain(cls: type[ChainSuspend] = ChainSuspend, **values: Any) -> Run:
    return simulate_specimen(cls.make(**({"links": 8} | values)), fidelity=DRAFT)


def with_angles(run: Run, angles: Any) -> Run:
    """A chain that stands still with its links at these angles from +x, and so do its twins."""
    qpos = run.qpos.copy()
    for i, turn in enumerate(np.diff(angles, prepend=0.0)):
        qpos[:, run.model.joint(f"link{i}/hinge").qposadr[0]] = turn
    there = dataclasses.replace(run, qpos=qpos, qvel=0 * run.qvel, _repeats={})
    return dataclasses.replace(there, again_with=lambda **_: there)


def test_an_arc_of_a_circle_is_no_chain() -> None:
    run = chain(load=0.0)
    one: ChainSuspend = run.specimen
    x = np.arange(one.links) + 0.5 - one.links / 2
    bend = brentq(lambda b: np.cos(b * x).mean() - one.span, 0.01, 0.7)
    drawn = with_angles(run, bend * x)
    assert law(drawn, "joints_stay_closed") == "passed"
    assert law(drawn, "links_lie_along_their_pull") == law(drawn, "hooks_are_pulled_by_weight_and_sag") == "failed"


def test_the_unloaded_shape_under_a_load_is_found_out() -> None:
    run = chain(load=3.0)
    _, joints = run.specimen.make(**(run.specimen.values() | {"load": 0.0})).rest(0.0)
    along, down = np.diff(joints, axis=0).T
    assert law(with_angles(run, np.arctan2(-down, along)), "links_lie_along_their_pull") == "failed"


def test_many_links_hang_in_a_catenary() -> None:
    one = ChainSuspend.make(links=60, pitch=0.02, load=0.0)
    span, length = one.gap, one.length
    c = brentq(lambda c: 2 * c * sinh(span / (2 * c)) - length, 0.1 * span, 10 * span)
    assert one.rest(0.0)[1][:, 1].max() == pytest.approx(c * (cosh(span / (2 * c)) - 1), rel=1e-3)
    hook = ChainSuspend.make(links=60, pitch=0.02, load=0.0, mount="hook")
    assert hook.modes()[0] == pytest.approx(1.2024 * sqrt(g / length), rel=1e-3)


class Rubber(ChainSuspend, domain="mechanics"):
    """The middle link is drawn out by its load."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.body("link4/link").pos[0] += 0.02 * self.pitch


def test_a_link_that_stretches_is_found_out() -> None:
    run = chain(Rubber, load=20.0, push=0.0)
    assert law(run, "joints_stay_closed") == "failed"
    assert law(chain(load=20.0, push=0.0), "joints_stay_closed") == "passed"


class Heavier(ChainSuspend, domain="mechanics"):
    """The lantern weighs more than it says."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.geom("lantern/globe").mass = 1.01 * self.globe


def test_a_false_weight_is_found_out() -> None:
    run = chain(Heavier, load=3.0)
    assert law(run, "links_lie_along_their_pull") == "failed"


def test_a_rod_is_no_chain() -> None:
    run = chain(mount="hook", load=0.0)
    one: ChainSuspend = run.specimen
    stiff = np.cos(sqrt(1.5 * g / one.length) * run.t) * 0.004

    def swinging(**_: Any) -> Run:
        twin = run.again(mount="hook", load=0.0, damping=0.0, push=0.004)
        qpos, qvel = 0 * twin.qpos, 0 * twin.qvel
        t, omega = twin.t, sqrt(1.5 * g / one.length)
        qpos[:, 0], qvel[:, 0] = 0.004 * np.cos(omega * t) - np.pi / 2, -0.004 * omega * np.sin(omega * t)
        return dataclasses.replace(twin, qpos=qpos, qvel=qvel)

    assert len(stiff) == len(run)
    fake = dataclasses.replace(run, again_with=swinging, _repeats={})
    assert law(fake, "a_hanging_chain_swings") == "failed"
    assert law(run, "a_hanging_chain_swings") == "passed"


def test_a_chain_that_never_rests_is_not_judged_at_rest() -> None:
    run = nominal(45, DRAFT)
    moving = dataclasses.replace(run, qvel=run.qvel + 1e-3, _repeats={})
    still = dataclasses.replace(moving, again_with=lambda **_: moving)
    assert law(still, "links_lie_along_their_pull") == "not evaluated"


def test_half_the_gravity_keeps_the_shape_and_slows_the_swing() -> None:
    full = chain(push=0.3, damping=0.0)
    half = full.again(gravity=g / 2)
    x = [run.position("lantern/lantern")[:, 0] for run in (full, half)]
    slowed = np.interp(half.t / sqrt(2), full.t, x[0])
    assert np.abs(slowed - x[1])[half.t < 2].max() < 2e-3 * np.ptp(x[0])


def test_a_mirrored_push_mirrors_the_swing() -> None:
    run = chain(push=0.3, damping=0.0, links=8)
    places = run.specimen.joints(run)
    start, mirrored = places[0], run.specimen.rest(-0.3)[1]
    assert np.abs(start[::-1] * (-1, 1) + (run.specimen.gap, 0) - mirrored).max() < 1e-9


@pytest.mark.slow
def test_extremes() -> None:
    heavy = chain(load=20.0, span=0.95, push=0.5, mass=0.005)
    assert law(heavy, "joints_stay_closed") == law(heavy, "links_lie_along_their_pull") == "passed"
    assert not failed(chain(load=0.0, span=0.3, push=0.5))


def test_without_a_load_there_is_no_lantern() -> None:
    run = chain(load=0.005, mount="hook")
    assert "lantern/lantern" not in run.bodies()
    assert "nothing but itself" in run.specimen.caption(run)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    rng = np.random.default_rng(45)
    for _ in range(12):
        specimen = ChainSuspend.sample(rng)
        assert not failed(simulate_specimen(specimen, fidelity=DRAFT)), specimen


@pytest.mark.slow
def test_random_specimens() -> None:
    rng = np.random.default_rng(4)
    for links in (9, 12):
        specimen = ChainSuspend.sample(rng, links=links)
        assert not failed(simulate_specimen(specimen, fidelity=DRAFT)), specimen


class Brief(ChainSuspend, domain="mechanics"):
    """Watched for a second."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.duration = 1.0


@pytest.mark.parametrize(("pitch", "mass", "load"), [(0.05, 0.05, 4.3), (0.039, 0.045, 17.0)])
def test_a_whipping_chain_gains_no_energy(pitch: float, mass: float, load: float) -> None:
    """Hardly damped and pushed hard, its links crack like whips; at DRAFT, too, they only lose."""
    values = {"links": 22, "pitch": pitch, "mass": mass, "span": 0.4, "load": load, "push": 0.349, "damping": 0.43}
    run = chain(Brief, **values)
    energy = run.motion.kinetic + run.motion.potential
    assert run.motion.kinetic.max() > 0.02
    assert (energy - np.minimum.accumulate(energy)).max() < 5e-3 * run.motion.kinetic.max()


def test_one_that_whips_beyond_all_numbers_says_so(capfd: pytest.CaptureFixture[str]) -> None:
    """Steps far too coarse for its 45 links: no exception of a linear algebra, and no word of LAPACK's."""
    values = {"mount": "hooks", "links": 45, "pitch": 0.038, "mass": 0.071, "span": 0.373, "load": 5.13}
    wild = ChainSuspend.make(**values, push=0.445, damping=4.61)
    with pytest.raises(UnstableScene, match="not finite"):
        simulate_specimen(wild, fidelity=Fidelity("coarse", 16, 8, 4))
    assert capfd.readouterr() == ("", "")


def test_what_goes_slack_without_drag_is_refused() -> None:
    """It would come taut with a jerk that nothing limits; and laws do not ask for such a twin."""
    slack = {"span": 0.3, "push": 0.5, "damping": 0.0}
    with pytest.raises(Refusal, match=r"push = 0\.5 rad, damping = 0 /s: .*; allowed: a push of 0\.259 rad or less"):
        chain(**slack)
    chain(**slack | {"push": 0.25})
    run = chain(**slack | {"mount": "hook"})
    assert law(run, "links_lie_along_their_pull") == law(run, "every_joint_bears_what_hangs_below") == "passed"
