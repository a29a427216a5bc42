"""Honey against fluids that only look like it."""

from __future__ import annotations

import dataclasses
from math import gamma, pi, sqrt

import numpy as np
import pytest

from mpm_sidecar import sample
from phenomena.p69_newtonian_spread import CENTRE, NewtonianFluidFall
from phenomena.pours import STROKE, WORD, form
from physinone_mj.base import Refusal
from physinone_mj.continuum import Letters, Newtonian
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import build

from ..conftest import nominal
from .verdicts import failed, judge_random, seen, verdicts

MASS = "mass_is_what_came"
SHAPES = ("cube", "ball", "cylinder", "torus", "letters")


class TwiceAsThick(NewtonianFluidFall, domain="fluids"):
    """μ is taken for the dynamic viscosity."""

    def soft(self, depth: float) -> Newtonian:
        honest = super().soft(depth)
        return Newtonian(2 * honest.viscosity, honest.bulk, honest.density)


class Water(NewtonianFluidFall, domain="fluids"):
    """Only the grid damps it."""

    share = 0.0

    def soft(self, depth: float) -> Newtonian:
        honest = super().soft(depth)
        return Newtonian(self.share * honest.viscosity, honest.bulk, honest.density)


class Oil(Water, domain="fluids"):
    """Four times too thin."""

    share = 0.25


def test_the_factor_two_is_found_out() -> None:
    assert verdicts(seen(TwiceAsThick, setup="film"))["film_flows_as_a_parabola"] == "failed"


def test_a_fluid_without_viscosity_is_refused() -> None:
    """The grid would lend it its own, and nobody would know."""
    with pytest.raises(Refusal, match=r"R7: 'layer': a dynamic viscosity of 0 Pa s, less than the method's own"):
        seen(Water, setup="film")


def test_a_fluid_too_thin_is_found_out() -> None:
    assert verdicts(seen(Oil, setup="film"))["film_flows_as_a_parabola"] == "failed"


@pytest.mark.slow
def test_currents_too_thin_are_found_out() -> None:
    made = seen(Oil, setup="current")
    assert verdicts(made)["current_spreads_as_the_fifth_root_of_time"] == "failed"
    assert verdicts(made)["viscosity_sets_the_clock"] == "failed"


@pytest.mark.parametrize("word", SHAPES)
def test_forms_are_as_large_as_they_say(word: str) -> None:
    made = form(word, 0.1)
    assert made.thin == pytest.approx(sample.thickness(made.shape), rel=2e-2)
    if made.volume is None:
        assert isinstance(made.shape, Letters)
        assert made.shape.text == WORD
        assert pytest.approx(0.22 / 1.22, abs=2e-3) == STROKE
    else:
        assert made.volume == pytest.approx(sample.volume(made.shape), rel=1e-9)


@pytest.mark.parametrize("onto", ["floor", "slope", "dome", "block"])
@pytest.mark.parametrize("shape", SHAPES)
def test_all_can_fall_on_all(onto: str, shape: str) -> None:
    """The lowest point is a drop above what is below, or more where that slopes."""
    specimen = NewtonianFluidFall.make(onto=onto, shape=shape)
    scene = build(specimen)
    (piece,) = scene.continua[0].pieces
    assert piece.position[2] - specimen.form.half - specimen.top >= specimen.drop - 1e-12
    assert 2 <= scene.duration <= 15
    assert scene.spec.compile().ngeom >= 1


def test_the_centre_of_the_similarity_solution() -> None:
    s = (np.arange(100000) + 0.5) / 100000
    shape = (1 - s**2) ** (1 / 3)
    assert (s * shape).mean() / shape.mean() == pytest.approx(CENTRE, rel=1e-4)
    # Huppert's eq. 2.22 from his eq. 2.13
    front = (0.2 * 0.3 ** (1 / 3) * sqrt(pi) * gamma(1 / 3) / gamma(5 / 6)) ** -0.6
    assert front == pytest.approx(1.411, abs=5e-4)


def test_laboratories_are_one_shape_for_all_fluids() -> None:
    """All numbers without dimension are the same, so errors and costs are, too."""
    thin, thick = (NewtonianFluidFall.make(viscosity=mu, setup="current") for mu in (25.0, 200.0))
    ratio = build(thick).length / build(thin).length
    assert ratio == pytest.approx(8 ** (2 / 3), rel=1e-9)
    assert build(thick).duration / build(thin).duration == pytest.approx(sqrt(ratio), rel=1e-9)


def test_soft_honey_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R9: .* squashes it by .*; allowed: 0\.02, bulk .* times as high"):
        build(NewtonianFluidFall.make(bulk=1e4, drop=0.6))


def test_random_specimens_are_scenes() -> None:
    rng = np.random.default_rng(0)
    assert {NewtonianFluidFall.sample(rng).setup for _ in range(20)} == {"drop", "pour"}
    assert NewtonianFluidFall.sample(rng, setup="film").setup == "film"


@pytest.mark.slow
def test_it_spreads_more_slowly_the_thicker_it_is() -> None:
    reach = [
        made.specimen.reach(made)[-1] for made in (seen(NewtonianFluidFall, viscosity=mu) for mu in (25.0, 70.0, 200.0))
    ]
    assert reach[0] > 1.05 * reach[1] > 1.05**2 * reach[2]


def test_what_is_lost_is_found_out() -> None:
    """69e: a thousandth of the mass, on the way. With the nominal run."""
    run = nominal(69, DRAFT)
    cloud = run.clouds["matter"]
    mass = cloud.mass * np.linspace(1.0, 0.999, len(run))
    lossy = dataclasses.replace(run, clouds={"matter": dataclasses.replace(cloud, mass=mass)})
    assert MASS not in failed(run)
    assert MASS in failed(lossy)


@pytest.mark.slow
def test_a_jet_brings_what_it_says() -> None:
    """To a particle: two of them more are found out."""
    made = seen(NewtonianFluidFall, setup="pour", bulk=5e4)
    assert verdicts(made)[MASS] == "passed"
    specimen, cloud = made.specimen, made.clouds["matter"]
    whole = specimen.density * (specimen.size**3 + 1.2 * specimen.jet * pi * (0.3 * specimen.size) ** 2)
    particle = specimen.density * cloud.bulk
    assert cloud.mass[-1] == pytest.approx(whole, abs=particle)
    more = dataclasses.replace(cloud, mass=cloud.mass + 2 * particle)
    assert MASS in failed(dataclasses.replace(made, clouds={"matter": more}))


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(NewtonianFluidFall, count=3)
    assert all(decided.values()), decided
