"""Paste against fluids that only look like it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p70_non_newtonian_flow import PLUG, NonNewtonianFluidFall, plastic_heap, plastic_mound
from phenomena.pours import grown
from physinone_mj.base import Refusal
from physinone_mj.continuum import Material, Newtonian, Viscoplastic
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import build

from ..conftest import nominal
from .verdicts import judge_random, seen, verdicts


class Treacle(NonNewtonianFluidFall, domain="fluids"):
    """No yield stress: it creeps on for ever."""

    def paste(self, yield_stress: float, depth: float, squeezed: float = 0.02) -> Any:
        honest = super().paste(yield_stress, depth, squeezed)
        return Newtonian(50 * honest.viscosity, honest.stiffness() / 7, honest.density)


class Stronger(NonNewtonianFluidFall, domain="fluids"):
    """τ_Y is taken for the shear strength."""

    def paste(self, yield_stress: float, depth: float, squeezed: float = 0.02) -> Viscoplastic:
        return super().paste(2**0.5 * yield_stress, depth, squeezed)


class Weaker(NonNewtonianFluidFall, domain="fluids"):
    """Its threshold is another one's without viscosity."""

    @property
    def material(self) -> Material:
        honest = super().material
        if isinstance(honest, Viscoplastic):
            return dataclasses.replace(honest, yield_stress=(2 / 3) ** 0.5 * honest.yield_stress)
        return honest


def test_thin_mounds_and_heaps_are_those_of_the_thin_layer() -> None:
    """L = (9 ρ g A²/8 τ)^⅓ and R = (225 ρ g V²/128 π² τ)^⅕, from which thicker ones fall short."""
    kappa = 1e-7
    assert plastic_mound(kappa)[1] == pytest.approx((9 / (8 * kappa)) ** (1 / 3), rel=1e-3)
    assert plastic_heap(kappa, 1.0) == pytest.approx((225 / (128 * np.pi**2 * kappa)) ** 0.2, rel=1e-3)
    assert plastic_mound(1 / 24)[1] < 0.9 * 3


def test_an_arrested_mound_holds_its_area() -> None:
    kappa = 1 / 24
    high, length = plastic_mound(kappa)
    x = (np.arange(20000) + 0.5) / 20000 * length
    cliff = np.pi * kappa
    profile = cliff / 2 + np.sqrt(cliff**2 / 4 + 2 * kappa * (length - x))
    assert profile.mean() * length == pytest.approx(1.0, rel=1e-5)
    assert profile[0] == pytest.approx(high, rel=1e-3)


def test_what_slides_on_is_not_said_to_stop() -> None:
    """70: a law that judged a stiff lump on a floor without friction, which nothing stops. With the nominal run."""
    made, stops = nominal(70, DRAFT), NonNewtonianFluidFall.laws()["what_has_fallen_stops"]
    smooth, rough = (NonNewtonianFluidFall.make(grip="separate", friction=friction) for friction in (0.0, 0.9))
    assert stops.judge(smooth, made).passed is None
    assert stops.judge(rough, made).passed


@pytest.mark.slow
def test_what_creeps_for_ever_is_found_out() -> None:
    assert verdicts(seen(Treacle, setup="thin layer"))["a_layer_flows_if_it_is_thick_enough"] == "failed"


@pytest.mark.slow
def test_the_root_of_two_is_found_out() -> None:
    assert verdicts(seen(Stronger, setup="thick layer"))["a_layer_flows_if_it_is_thick_enough"] == "failed"


def test_what_yields_otherwise_is_no_plasticine() -> None:
    """70e: √(2/3) τ_Y, as some codes have it, where there is no viscosity. About 4 s."""
    made = seen(Weaker, setup="dry")
    assert np.ptp(made.clouds["matter"].high[:, 2]) > 0.02
    assert verdicts(made)["without_viscosity_it_is_plasticine"] == "failed"


@pytest.mark.slow
def test_the_plug_is_rigid_and_as_thick_as_what_would_stay() -> None:
    """70f: from the mean speed over the plug's, ū/u = 1 - (h - h_c)/3h."""
    made = seen(NonNewtonianFluidFall, setup="plug")
    x, v, _ = grown(made.clouds["layer"], -1)
    depth = made.specimen.plug_depth
    top = v[x[:, 2] > 0.75 * depth, 0]
    assert 1 - 3 * (1 - v[:, 0].mean() / top.mean()) == pytest.approx(1 / PLUG, abs=6e-2)
    assert np.ptp(top) < 5e-3 * top.mean()


@pytest.mark.slow
def test_arrest_knows_the_yield_stress() -> None:
    """Lazy failure (c): a weak paste spreads farther than a strong one of the same size."""
    weak, strong = (seen(NonNewtonianFluidFall, yield_stress=y) for y in (150.0, 600.0))
    assert weak.specimen.reach(weak)[-1] > 1.15 * strong.specimen.reach(strong)[-1]


def test_rubber_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R12: .* yield stress .* allowed: 0\.1, young = 1e\+05 Pa"):
        build(NonNewtonianFluidFall.make(yield_stress=10000.0, young=1e4))


def test_too_soft_for_the_fall_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R9: .*; allowed: 0\.3, young .* times as high"):
        build(NonNewtonianFluidFall.make(young=1e4, yield_stress=100.0, drop=0.6))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(NonNewtonianFluidFall, count=3)
    assert all(decided.values()), decided
