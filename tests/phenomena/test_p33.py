"""A flat mirror: beams that only look right are told from the true one."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from phenomena.p33_fixed_planar_redirect import FixedPlanarRedirect
from physinone_mj import optics
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen

from .rays import everything_reflects, frozen, hold_at_random, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed

REFLECTION = "beam_leaves_at_the_angle_at_which_it_came"
SPOT = "spot_is_where_the_planes_say"
SHIFT = "beam_shifts_by_twice_the_mirror_s_way"
ONLY = "nothing_but_the_glass_reflects"
BACK = "light_sent_back_returns_to_the_laser"


@functools.cache
def shine(**values: Any) -> Run:
    return simulate_specimen(FixedPlanarRedirect.make(**values), fidelity=DRAFT)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"incidence": np.radians(80), "travel": 0.05},
        {"incidence": np.radians(5), "wall": 3.0, "travel": 0.15},
        {"slant": -0.15, "distance": 3.0, "wall": 3.0},
        {"slant": 0.0, "distance": 0.5, "wall": 0.6, "size": 0.1, "travel": 0.02},
    ],
)
def test_true_beam_is_right(values: dict[str, Any]) -> None:
    run = shine(**values)
    assert not failed(run)
    assert not in_each_other_s_way(run)
    assert run.scene.fps == 60


@pytest.mark.parametrize("lie", [frozen, late])
def test_a_drawn_beam_and_one_that_lags_a_frame_are_found_out(monkeypatch: pytest.MonkeyPatch, lie: Any) -> None:
    run = shine()
    pretend(monkeypatch, lie)
    assert failed(run) >= {SPOT, SHIFT, ONLY}


def test_a_screen_that_reflects_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = untraced(shine())
    everything_reflects(monkeypatch)
    assert ONLY in failed(run)


def test_a_back_that_reflects_or_lets_light_through_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._mirror

    def both_sides(self: Optics, data: Any, geom: int, start: Any, way: Any, normal: Any) -> Any:
        named = self._model.geom(geom).name
        return (None, normal.copy()) if named == "mirror/back" else true(self, data, geom, start, way, normal)

    with monkeypatch.context() as patch:
        patch.setattr(Optics, "_mirror", both_sides)
        assert ONLY in failed(untraced(shine()))
    ignore(monkeypatch, shine(), "mirror/back")
    assert ONLY in failed(untraced(shine()))


def test_a_beam_through_the_mirror_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    ignore(monkeypatch, shine(), "mirror/glass", "mirror/back")
    assert failed(untraced(shine())) == {REFLECTION, SPOT, SHIFT, ONLY, BACK}


def test_a_beam_that_turns_by_the_angle_and_not_by_twice_it_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = shine()

    def half(rays: Rays) -> Rays:
        points = rays.points.copy()
        along = rays.directions(1) - rays.directions(0)
        points[:, 2] = points[:, 1] + along
        return Rays(points, rays.geoms, rays.weights, rays.truncated)

    pretend(monkeypatch, half)
    assert failed(run) >= {REFLECTION, SPOT}


def test_a_beam_past_the_mirror_goes_on() -> None:
    class Aside(FixedPlanarRedirect, domain="optics"):
        """The mirror begins a metre further back than it says."""

        def build(self, scene: Any) -> None:
            super().build(scene)
            scene.start["mirror/joint"] = -1.0

    run = simulate_specimen(Aside(), fidelity=DRAFT)
    rays = optics.trace(run, "laser")
    assert set(rays.geoms[:, 0]) == {optics.NOTHING}
    assert failed(run) >= {ONLY}


def test_what_does_not_fit_is_refused() -> None:
    for values in (
        {"incidence": np.radians(80), "travel": 0.15, "size": 0.1},
        {"incidence": np.radians(5), "distance": 0.3},
        {"incidence": np.radians(5), "wall": 0.3},
        {"incidence": np.radians(80), "wall": 0.3, "size": 0.6, "travel": 0.05},
    ):
        with pytest.raises(Refusal, match="allowed"):
            shine(**values)


@pytest.mark.slow
def test_random_specimens() -> None:
    hold_at_random(FixedPlanarRedirect, 200, 100)
