"""Several mirrors: beams that take the wrong way are told from the true one."""

from __future__ import annotations

import functools
from typing import Annotated, Any

import numpy as np
import pytest

from phenomena.lasers import standing_mirror
from phenomena.p34_fixed_array_redirect import MOST, FixedArrayRedirect
from physinone_mj import optics
from physinone_mj.base import Param, Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen

from .rays import everything_reflects, frozen, hold_at_random, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed, verdicts

PAIR = "pair_turns_the_beam_by_twice_its_angle"
CORNER = "corner_sends_the_beam_back"
PARALLEL = "parallel_mirrors_hand_the_beam_along"
TURNS = "every_mirror_reflects_in_its_turn"
CORNERS = "corners_lie_on_the_mirrors"
ARRANGEMENTS = ("route", "zigzag", "pair", "corner")


@functools.cache
def shine(**values: Any) -> Run:
    return simulate_specimen(FixedArrayRedirect.make(**values), fidelity=DRAFT)


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_true_beam_is_right(arrangement: str) -> None:
    run = shine(arrangement=arrangement)
    assert not failed(run)
    assert verdicts(run)[TURNS] == verdicts(run)[CORNERS] == "passed"
    assert not in_each_other_s_way(run)


@pytest.mark.parametrize("mirrors", [2, 8])
def test_every_mirror_of_a_route_is_met_once(mirrors: int) -> None:
    run = shine(mirrors=mirrors, pattern=11)
    names = [run.model.geom(int(g)).name for g in optics.trace(run, "laser").geoms[0]]
    assert names == [*(f"mirror{k}/glass" for k in range(mirrors)), "screen/board"]


@pytest.mark.parametrize("most", [1, 2])
def test_one_or_two_bounces_and_no_more_are_found_out(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    true = Optics.follow

    def few(self: Optics, *ray: Any, bounces: int, **how: Any) -> Any:
        return true(self, *ray, bounces=min(bounces, most), **how)

    run = untraced(shine())
    monkeypatch.setattr(Optics, "follow", few)
    assert failed(run) >= {TURNS, CORNERS, PARALLEL, CORNER}


def test_mirrors_met_in_the_order_of_a_list_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._meet

    def last_listed(self: Optics, data: Any, start: Any, way: Any, clear: float, body: int) -> Any:
        """Of all mirrors on the ray, the one that was declared last."""
        far, geom, normal = true(self, data, start, way, clear, body)
        behind = far, geom, normal
        while behind[1] >= 0:
            if behind[1] in self._faces and (geom not in self._faces or list(self._faces).index(behind[1])
                                             > list(self._faces).index(geom)):  # fmt: skip
                far, geom, normal = behind
            behind = true(self, data, start, way, behind[0] + 1e-6, body)
        return far, geom, normal

    class Behind(FixedArrayRedirect, domain="optics"):
        """Another mirror stands behind the first one."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            if self.arrangement == "route":
                place = self.layout.middles[0] + 0.3 * self.layout.way
                standing_mirror(scene, "behind", place, self.layout.normals[0], (0.1, 0.1))

    run = simulate_specimen(Behind(), fidelity=DRAFT)
    assert not failed(untraced(run))
    monkeypatch.setattr(Optics, "_meet", last_listed)
    assert failed(untraced(run)) >= {TURNS, CORNERS}


def test_a_drawn_beam_and_one_that_lags_a_frame_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    for lie in (frozen, late):
        with monkeypatch.context() as patch:
            pretend(patch, lie)
            assert failed(shine()) >= {TURNS}


def test_reflection_off_frames_and_backs_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = untraced(shine())
    everything_reflects(monkeypatch)
    rays = optics.trace(run, "laser")
    assert (rays.geoms[:, -1] != run.model.geom("screen/board").id).any()
    assert failed(run) >= {TURNS}


def test_a_mirror_that_lets_the_beam_through_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = shine()
    ignore(monkeypatch, run, "mirror2/glass", "mirror2/back")
    assert failed(untraced(run)) >= {TURNS, CORNERS}


def test_a_beam_that_turns_by_the_angle_and_not_by_twice_it_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = shine(arrangement="pair")

    def half(rays: Rays) -> Rays:
        points = rays.points.copy()
        points[:, -1] = points[:, -2] + rays.directions(0) + rays.directions(points.shape[1] - 2)
        return Rays(points, rays.geoms, rays.weights, rays.truncated)

    pretend(monkeypatch, half)
    assert failed(run) >= {PAIR, TURNS}


def test_a_beam_that_finds_no_end_is_cut_off_and_says_so() -> None:
    class Long(FixedArrayRedirect, domain="optics"):
        """Parallel mirrors longer than a room."""

        length: Annotated[float, Param("m", 0.4, 20.0, "of the parallel mirrors")] = 9.0

    run = simulate_specimen(Long(arrangement="zigzag", gap=0.3, angle=0.35), fidelity=DRAFT)
    assert run.specimen.reflections > MOST >= 64
    rays = optics.trace(run, "laser")
    assert rays.truncated[0]
    assert verdicts(run)[PARALLEL] == "passed"
    assert "followed no further" in run.specimen.caption(run)
    assert run.specimen.cut_off(run)[0] == 1
    assert not shine(arrangement="zigzag").specimen.cut_off(shine(arrangement="zigzag")).any()


def test_corner_returns_the_beam_whatever_its_descent() -> None:
    for angle in (0.3, 0.6, 0.9):
        run = shine(arrangement="corner", angle=angle, turn=0.1)
        assert verdicts(run)[CORNER] == "passed"
        assert np.ptp(run.joint("corner/axle")) > 0.09


def test_what_does_not_fit_is_refused() -> None:
    for values in (
        {"arrangement": "zigzag", "gap": 0.1, "angle": 0.3},
        {"arrangement": "pair", "dihedral": 2.2, "angle": 0.3},
        {"arrangement": "pair", "dihedral": 1.2},
    ):
        with pytest.raises(Refusal, match="allowed"):
            shine(**values)


@pytest.mark.slow
@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_random_specimens(arrangement: str) -> None:
    for run in hold_at_random(FixedArrayRedirect, 50, 20, arrangement=arrangement):
        assert verdicts(run)[TURNS] == "passed"
