"""Sand against what only looks like it."""

from __future__ import annotations

from math import atan, degrees, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest

from phenomena.p71_granular_disperse import WIDTH, GranularFall
from phenomena.pours import grown, spacing
from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Granular
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.simulate import build, simulate_specimen

from .verdicts import judge_random


def run(cls: type[GranularFall] = GranularFall, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def verdict(made: Run, law: str) -> str:
    return made.specimen.laws()[law].judge(made.specimen, made).verdict


class Naive(GranularFall, domain="fluids"):
    """Slopes are expected to fail at φ."""

    @property
    def steepest(self) -> float:
        return self.internal


def steepness(made: Run) -> float:
    """Steepest slope of a collapse's deposit over four cells [rad]."""
    points, cell = grown(made.clouds["column"], -1)[0], made.cell
    strip = (points[:, 0] / cell).astype(int)
    top = np.zeros(strip.max() + 1)
    np.maximum.at(top, strip, points[:, 2] + spacing(made.clouds["column"]) / 2)
    return float(np.arctan(np.max(top[:-4] - top[4:]) / (4 * cell)))


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
    assert verdict(run(Naive, setup="steep slope"), "a_slope_stands_up_to_an_angle") == "failed"


@pytest.mark.slow
@pytest.mark.parametrize("phi", [15, 45, 60])
def test_slopes_of_all_sands(phi: float) -> None:
    assert verdict(run(internal=radians(phi), setup="steep slope"), "a_slope_stands_up_to_an_angle") == "passed"


@pytest.mark.slow
def test_a_deposit_is_no_steeper_than_a_slope_and_runs_farther_the_looser_it_is() -> None:
    """71c, with a cell's worth of doubt."""
    first, loose = run(setup="collapse"), run(setup="loose collapse")
    specimen = first.specimen
    assert steepness(first) <= specimen.steepest + 0.08
    sine = 0.7 * specimen.sine
    assert steepness(loose) <= atan(2 * sqrt(3) * sine / (3 - sine)) + 0.08
    assert specimen.edge(loose) > specimen.edge(first) + first.cell
    assert first.clouds["column"].high[-1, 2] > 0.5 * WIDTH  # no puddle


@pytest.mark.slow
def test_neither_weight_nor_gravity_changes_a_deposit() -> None:
    """71d: twice the density and modulus: the same; four times the gravity and modulus: the same in half the time."""
    first, heavy = run(setup="collapse"), run(setup="heavy collapse")
    a, b = first.clouds["column"], heavy.clouds["column"]
    assert b.centre == pytest.approx(a.centre, abs=2e-3 * WIDTH)

    class Strong(GranularFall, domain="fluids"):
        def sand(self, depth: float | None = None, sine: float | None = None, heavy: float = 1.0) -> Granular:
            honest = super().sand(depth, sine, heavy)
            return Granular(4 * honest.young, honest.poisson, honest.density, honest.friction)

    strong = simulate_specimen(Strong.make(setup="collapse"), fidelity=DRAFT, gravity=4 * g)
    c = strong.clouds["column"]
    half = np.searchsorted(strong.t, strong.t[-1] / 2)
    assert c.centre[half, 0] == pytest.approx(a.centre[-1, 0], rel=2e-2)


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
    assert min(judge_random(GranularFall, count=3).values()) >= 0
