"""A mirror that sweeps a beam: beams that lag, turn too little or shine through things are told from the true one."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from phenomena.p37_dyn_mirror_redirect import DynMirrorRedirect
from physinone_mj import optics
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Rays
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen

from .rays import frozen, hold_at_random, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed, verdicts

TWICE = "beam_turns_twice_as_far_as_the_mirror"
SPEED = "spot_runs_faster_the_farther_aside"
PLACE = "spot_is_where_geometry_says"
SWEEPS = "every_facet_makes_one_sweep"


@functools.cache
def sweep(**values: Any) -> Run:
    return simulate_specimen(DynMirrorRedirect.make(**values), fidelity=DRAFT)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"carrier": "pendulum"},
        {"carrier": "pendulum", "swing": 0.2, "wall": 4.0, "length": 0.3},
        {"facets": 8, "offset": 0.12, "omega": 6.0},
        {"facets": 3, "offset": 0.05, "omega": 0.1},
        {"facets": 2, "offset": 0.02, "omega": 2.0, "wall": 0.5},
        {"offset": 0.2, "omega": 1.0, "wall": 4.0, "rise": 0.08},
    ],
)
def test_true_beam_is_right(values: dict[str, Any]) -> None:
    run = sweep(**values)
    assert not failed(run)
    assert verdicts(run)[TWICE] == verdicts(run)[SPEED] == verdicts(run)[SWEEPS] == "passed"
    assert not in_each_other_s_way(run)


@pytest.mark.parametrize("by", [1, 8])
def test_a_beam_that_lags_by_a_sample_is_found_out(monkeypatch: pytest.MonkeyPatch, by: int) -> None:
    pretend(monkeypatch, functools.partial(late, by=by))
    for values in ({}, {"carrier": "pendulum"}):
        assert failed(sweep(**values)) >= {TWICE, PLACE}


def test_the_beam_fits_no_other_instant() -> None:
    run = sweep()
    due, sure = run.specimen.sure(run.t)
    found = optics.trace(run, "laser").directions(1)[:, :2] * -1
    miss = [np.abs(np.roll(found, -lag, axis=0) - due.out[:, :2])[sure][10:-10].max() for lag in (-2, -1, 0, 1, 2)]
    assert int(np.argmin(miss)) == 2
    assert miss[2] < 1e-9 < 1e-4 < min(miss[1], miss[3])


def test_a_drawn_beam_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, frozen)
    assert failed(sweep()) >= {TWICE, SPEED, PLACE}


def test_a_beam_that_turns_by_the_angle_and_not_by_twice_it_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = sweep(offset=0.0)

    def once(rays: Rays) -> Rays:
        points = rays.points.copy()
        first = rays.directions(1)[0]
        for i, angle in enumerate(run.joint("drum/hinge")[: len(points)]):
            c, s = np.cos(angle), np.sin(angle)
            turned = np.array([c * first[0] - s * first[1], s * first[0] + c * first[1], first[2]])
            points[i, 2] = points[i, 1] + 1.3 * turned
        return Rays(points, rays.geoms, rays.weights, rays.truncated)

    pretend(monkeypatch, once)
    assert failed(run) >= {TWICE, SPEED, PLACE}


def test_a_beam_through_what_stands_before_the_wall_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = sweep()
    rays = optics.trace(run, "laser")
    for name in ("obstacles/column", "obstacles/ball"):
        assert (rays.geoms == run.model.geom(name).id).any(), "it stands in the beam's way"
        with monkeypatch.context() as patch:
            ignore(patch, run, name)
            assert failed(untraced(run)) == {PLACE}


def test_what_is_met_as_its_bounding_box_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._meet
    run = sweep()
    ball, (place, radius) = run.model.geom("obstacles/ball").id, run.specimen.ball

    def boxed(self: Optics, data: Any, start: Any, way: Any, clear: float, body: int) -> Any:
        far, geom, normal = true(self, data, start, way, clear, body)
        centre = place * (-1, -1, 1)
        with np.errstate(divide="ignore"):
            ends = np.sort([(centre - radius - start) / way, (centre + radius - start) / way], axis=0)
        into, out = ends[0].max(), ends[1].min()
        return (into, ball, normal) if 0 < into < min(out, far if far > 0 else np.inf) else (far, geom, normal)

    monkeypatch.setattr(Optics, "_meet", boxed)
    assert failed(untraced(run)) >= {PLACE}


def test_a_back_that_reflects_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Optics._mirror
    run = sweep(omega=2.0)

    def both_sides(self: Optics, data: Any, geom: int, start: Any, way: Any, normal: Any) -> Any:
        named = self._model.geom(geom).name
        return (None, normal.copy()) if named == "drum/back" else true(self, data, geom, start, way, normal)

    back = run.model.geom("drum/back").id
    assert (optics.trace(run, "laser").geoms[:, 0] == back).any()
    assert (optics.trace(run, "laser").geoms[optics.trace(run, "laser").geoms[:, 0] == back, 1:] == optics.NO_RAY).all()
    monkeypatch.setattr(Optics, "_mirror", both_sides)
    shone = optics.trace(untraced(run), "laser")
    assert (shone.geoms[shone.geoms[:, 0] == back, 1] != optics.NO_RAY).any()


def test_with_an_offset_the_spot_is_elsewhere() -> None:
    near, far = (sweep(offset=offset) for offset in (0.0, 0.1))
    i = 300
    assert near.specimen.due(near.t).facet[i] == far.specimen.due(far.t).facet[i] == 0
    assert np.linalg.norm(near.specimen.spot(near)[i] - far.specimen.spot(far)[i]) > 0.05
    assert near.specimen.direction_out(near)[i] == pytest.approx(far.specimen.direction_out(far)[i], abs=1e-9)


def test_what_does_not_fit_is_refused() -> None:
    narrow, wide, thin = ({"facets": 8, "offset": 0.01}, {"facets": 3, "offset": 0.2, "wall": 0.5},
                          {"facets": 2, "offset": 0.0})  # fmt: skip
    for values in (narrow, wide, thin):
        with pytest.raises(Refusal, match="allowed"):
            sweep(**values)


@pytest.mark.slow
def test_random_specimens() -> None:
    hold_at_random(DynMirrorRedirect, 200, 100)
