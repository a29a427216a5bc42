"""Sand against what only looks like it."""

from __future__ import annotations

import dataclasses
from math import atan, degrees, pi, radians, sin, sqrt
from typing import Any

import pytest

from phenomena.p71_granular_disperse import WIDTH, GranularFall
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Granular, Plasticine
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import build

from ..conftest import nominal
from .verdicts import judge_random, seen, verdicts

ANGLE = "a_slope_stands_up_to_an_angle"
STEEP = "a_deposit_is_no_steeper_than_a_slope"
CLOCK = "weight_sets_the_clock_and_nothing_else"


class Naive(GranularFall, domain="fluids"):
    """Slopes are expected to fail at φ."""

    @property
    def steepest(self) -> float:
        return self.internal


class Porridge(GranularFall, domain="fluids"):
    """What holds it together is no friction: a paste's strength."""

    def sand(self, *asked: Any) -> Any:
        honest = super().sand(*asked)
        return Plasticine(honest.young, honest.poisson, honest.density, self.density * g * WIDTH / 20)


class Upright(GranularFall, domain="fluids"):
    """Sand of 60 degrees, whatever is asked for."""

    def sand(self, *asked: Any) -> Granular:
        return dataclasses.replace(super().sand(*asked), friction=pi / 3)


@pytest.mark.parametrize(("phi", "theta"), [(15, 18.1), (30, 34.7), (45, 46.9), (60, 54.6)])
def test_the_steepest_slope(phi: float, theta: float) -> None:
    assert degrees(GranularFall.make(internal=radians(phi)).steepest) == pytest.approx(theta, abs=0.06)


@pytest.mark.parametrize("phi", [15, 30, 45, 60])
def test_the_plane_cone_is_coulomb_s(phi: float) -> None:
    """In plane strain, without dilation, τ = p sin φ: α = √2/3 sin φ, and a slope stands up to tan θ = sin φ."""
    specimen = GranularFall.make(internal=radians(phi), cone="plane")
    assert specimen.sand().cone == pytest.approx(sqrt(2) / 3 * sin(radians(phi)), rel=1e-12)
    assert specimen.steepest == pytest.approx(atan(sin(radians(phi))), rel=1e-12)


@pytest.mark.slow
def test_the_naive_angle_is_found_out() -> None:
    assert verdicts(seen(Naive, setup="steep slope"))[ANGLE] == "failed"


@pytest.mark.slow
@pytest.mark.parametrize("phi", [15, 41])
def test_slopes_of_all_sands(phi: float) -> None:
    assert verdicts(seen(GranularFall, internal=radians(phi), setup="steep slope"))[ANGLE] == "passed"


def test_what_shear_pulls_apart_is_not_judged() -> None:
    """71a, c: from φ = 42.2° on, where tan θ_c = 1; of heaps from 36.3° on. With the nominal run."""
    made = nominal(71, DRAFT)
    for law, phi, limit in ((ANGLE, 42.3, 1), (ANGLE, 60.0, 1), (STEEP, 36.3, 0.85), (STEEP, 60.0, 0.85)):
        steep = dataclasses.replace(made, specimen=GranularFall.make(internal=radians(phi)))
        assert f"needed: less than {limit:g}" in str(GranularFall.laws()[law].judge(steep.specimen, steep).reason)


@pytest.mark.slow
def test_paste_is_found_out() -> None:
    """71c, d: a strength knows no angle and sets a scale: friction has no effect, and weight has. About half a
    minute."""
    found = verdicts(seen(Porridge, setup="collapse"))
    assert (found[STEEP], found[CLOCK]) == ("failed", "failed")


@pytest.mark.slow
def test_cliffs_are_found_out() -> None:
    """71c: a column that stands. About a quarter of a minute."""
    assert verdicts(seen(Upright, setup="collapse"))[STEEP] == "failed"


def test_soft_sand_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R9: .*; allowed: 0\.03, young .* times as high"):
        build(GranularFall.make(young=1e5, drop=0.6))


def test_laboratories_are_built() -> None:
    for setup in ("gentle slope", "steep slope", "collapse", "loose collapse", "heavy collapse", "spray"):
        scene = build(GranularFall.make(setup=setup, internal=pi / 4))
        assert scene.length > 0
        assert len(scene.continua) == 1


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(GranularFall, count=3)
    assert all(decided.values()), decided
