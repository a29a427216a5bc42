"""A blocked beam: what shines on behind, or is stopped by what it does not touch, is told from the true beam."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from phenomena.p38_laser_block import BODIES, LaserBlock
from physinone_mj import optics
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen

from .rays import frozen, hold_at_random, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed, verdicts

FIRST = "beam_ends_where_it_first_meets_something"
DARK = "dark_for_as_long_as_the_chord_takes"
PERIOD = "pendulum_cuts_the_beam_twice_a_period"
BESIDE = "what_does_not_touch_the_beam_does_not_block_it"
BLOCKERS = tuple(BODIES)


@functools.cache
def cross(**values: Any) -> Run:
    return simulate_specimen(LaserBlock.make(**values), fidelity=DRAFT)


@pytest.mark.parametrize(
    "values",
    [
        *({"blocker": blocker, "speed": 2.5} for blocker in BLOCKERS[:2]),
        *(pytest.param({"blocker": blocker, "speed": 2.5}, marks=pytest.mark.slow) for blocker in BLOCKERS[2:]),
        pytest.param(
            {"speed": 4.0, "size": 0.03, "graze": 0.9, "yaw": -0.3, "rise": 0.08},
            marks=pytest.mark.slow,  # it crosses the beam in 6 ms, and is watched for 5 s
        ),
        *(
            pytest.param(extreme, marks=pytest.mark.slow)
            for extreme in (
                {"blocker": "cart", "speed": 0.2, "size": 0.1, "graze": 0.0, "yaw": 0.3},
                {"blocker": "block", "speed": 4.0, "size": 0.1, "yaw": 0.3, "rise": 0.08},
                {"blocker": "pendulum", "swing": 1.0, "length": 1.0},
            )
        ),
        pytest.param({"graze": 1.3}, marks=pytest.mark.slow),
    ],
)
def test_true_beam_is_right(values: dict[str, Any]) -> None:
    run = cross(**values)
    assert not failed(run)
    assert set(verdicts(run).values()) == {"passed"}
    assert not in_each_other_s_way(run)


@pytest.mark.parametrize("blocker", BLOCKERS)
def test_the_screen_is_dark_and_lit_again(blocker: str) -> None:
    run = cross(blocker=blocker, speed=2.5 if blocker == "block" else 0.6)
    lit = run.specimen.lit(run)
    assert lit[0] == lit[-1] == 1
    assert (lit == 0).any()
    rays = optics.trace(run, "laser")
    dark = lit == 0
    assert (rays.geoms[dark, 1:] == optics.NO_RAY).all(), "nothing beyond the blocker, not even at the mirror"
    assert (run.model.geom_bodyid[rays.geoms[dark, 0]] == run.model.body(BODIES[blocker]).id).all()
    assert run.specimen.beam_length(run)[dark].max() < run.specimen.beam_length(run)[~dark].min() - 1


def test_a_mirror_that_is_still_lit_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = cross()

    def shines_on(rays: Rays) -> Rays:
        """The first piece ends on the blocker, the others are there all the time."""
        points, geoms = rays.points.copy(), rays.geoms.copy()
        points[:, 2:], geoms[:, 1:] = rays.points[0, 2:], rays.geoms[0, 1:]
        return Rays(points, geoms, rays.weights, rays.truncated)

    pretend(monkeypatch, shines_on)
    assert failed(run) >= {FIRST}


@pytest.mark.parametrize("lie", [frozen, late])
def test_a_drawn_beam_and_one_that_lags_a_frame_are_found_out(monkeypatch: pytest.MonkeyPatch, lie: Any) -> None:
    pretend(monkeypatch, lie)
    assert failed(cross()) >= {FIRST}


def test_a_beam_through_the_blocker_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = cross()
    ignore(monkeypatch, run, "ball/ball")
    assert failed(untraced(run)) >= {FIRST, DARK}


def test_what_is_met_as_its_bounding_box_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._meet

    def boxed(self: Optics, data: Any, start: Any, way: Any, clear: float, body: int) -> Any:
        far, geom, normal = true(self, data, start, way, clear, body)
        ball = self._model.geom("ball/ball").id
        centre, half = data.geom_xpos[ball], self._model.geom_size[ball, 0]
        ends = np.sort([(centre - half - start) / way, (centre + half - start) / way], axis=0)
        into, out = ends[0].max(), ends[1].min()
        return (into, ball, normal) if 0 < into < min(out, far if far > 0 else np.inf) else (far, geom, normal)

    run = cross(graze=0.95)
    monkeypatch.setattr(Optics, "_meet", boxed)
    boxes = untraced(run)
    assert verdicts(boxes)[FIRST] == "failed"
    near = untraced(simulate_specimen(LaserBlock(), fidelity=DRAFT))
    assert verdicts(near)[BESIDE] == verdicts(near)[DARK] == "failed"


def test_of_two_blockers_the_nearer_one_is_met() -> None:
    class Two(LaserBlock, domain="optics"):
        """A column stands in the beam, behind where the ball crosses or before it."""

        where = 0.3

        def build(self, scene: Scene) -> None:
            super().build(scene)
            place = self.crossing + self.where * self.way
            column = scene.spec.worldbody.add_geom(name="column", size=(0.02, 0.0, 0.0))
            column.pos = place

    class Before(Two, domain="optics"):
        """The column is nearer to the laser."""

        where = -0.3

    for cls, seen in ((Two, {"ball/ball", "column"}), (Before, {"column"})):
        run = simulate_specimen(cls(), fidelity=DRAFT)
        assert {run.model.geom(int(geom)).name for geom in optics.trace(run, "laser").geoms[:, 0]} == seen


def test_a_thing_thinner_than_the_beam_is_drawn_blocks_it() -> None:
    class Wire(LaserBlock, domain="optics"):
        """A wire of a tenth of a millimetre stands in the beam."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.spec.worldbody.add_geom(name="wire", size=(5e-5, 0.0, 0.0), pos=self.crossing + 0.4 * self.way)

    run = simulate_specimen(Wire(), fidelity=DRAFT)
    assert run.scene.beams[0].radius > 1e-3
    assert run.model.geom(int(optics.trace(run, "laser").geoms[0, 0])).name == "wire"
    assert failed(run) >= {FIRST}


def test_faster_is_shorter_and_farther_from_the_middle_too() -> None:
    def dark(**values: Any) -> float:
        into, out = cross(**values).specimen.blocked(cross(**values))
        return float(out[0] - into[0])

    assert dark(speed=1.2) == pytest.approx(dark() / 2, rel=1e-6)
    assert dark(graze=0.8) == pytest.approx(dark(graze=0.0) * 0.6, rel=1e-6)


def test_a_block_that_would_hang_in_the_beam_is_refused() -> None:
    with pytest.raises(Refusal, match="allowed"):
        cross(blocker="block", speed=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("blocker", BLOCKERS)
def test_random_specimens(blocker: str) -> None:
    hold_at_random(LaserBlock, 50, 25, blocker=blocker)
