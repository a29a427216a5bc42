"""The method's own viscosity, by vortices that decay: as it is recorded, beside a fluid's own, and what it refuses."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from mpm_sidecar._ti import ti
from mpm_sidecar.medium import numerical_viscosity
from mpm_sidecar.transfer import Body, longest_step
from physinone_mj.base import Refusal
from physinone_mj.continuum import Box, Continuum, Elastic, Newtonian, Piece
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import Stepper, build, compile, simulate
from tests.bench.bench_viscosity import Vortices, expected, vortices

from .taichi_at import taichi_at
from .test_medium import FLOOR, _still, cube

DX = 1 / 64
RECORDED = 0.007
"""ν Δt/Δx² that is recorded."""


@cache
def measured(across: int, dx: float, **case: Any) -> Vortices:
    taichi_at(ti.f32)
    return vortices(across, dx=dx, **case)


@pytest.mark.parametrize(
    ("across", "dx", "case", "part"),
    [
        (9, DX, {}, expected(9)),
        (9, 2 * DX, {"finer": 4}, expected(9)),
        (16, DX, {"left": 0.8}, expected(16)),
        (16, DX, {"walled": True}, 0.0164),
    ],
    ids=["nine cells", "larger cells, shorter steps", "sixteen cells", "between walls"],
)
def test_vortices_decay_by_what_is_recorded(across: int, dx: float, case: dict[str, Any], part: float) -> None:
    """It goes with Δx²/Δt; larger vortices have less of it, by the square of their size, and smooth walls add some."""
    found = measured(across, dx, **case)
    recorded = numerical_viscosity(found.fluid, dx, found.step)
    assert found.viscosity == pytest.approx(part / RECORDED * recorded, rel=0.05)


def test_what_is_recorded_is_that_of_nine_cells() -> None:
    """Or a little more; large ones have 9/160 κ²."""
    assert 0.9 < expected(9) / RECORDED < 1.0
    assert expected(1000) == pytest.approx(9 / 160 * (np.pi / 1000) ** 2, rel=1e-3)


@pytest.mark.parametrize(("own", "left"), [(2.5, 0.5), (25.0, 0.3)])
def test_it_adds_to_the_fluids_own(own: float, left: float) -> None:
    """2.5 Pa s, about as much, and 25: what is measured is the sum."""
    found = measured(9, DX, viscosity=own, left=left)
    added = expected(9) / RECORDED * numerical_viscosity(found.fluid, DX, found.step)
    assert found.viscosity == pytest.approx(own + added, rel=0.03)
    assert found.viscosity > own + 0.5 * added


def refused(*pieces: Piece) -> str:
    with pytest.raises(Refusal) as told:
        simulate(_still(Continuum(list(pieces), [FLOOR]), duration=0.001), fidelity=DRAFT)
    return str(told.value)


def test_what_is_stiff_beside_a_fluid_adds_to_it() -> None:
    """Its shorter steps are everybody's: by the root of a hundred, in what is recorded and in what is refused."""
    thick, thin = (cube(Newtonian(viscosity=viscosity, bulk=1e4), 0.07) for viscosity in (60.0, 50.0))
    for young, times in ((1e5, 1.0), (1e7, 10.0)):
        solid = Piece("solid", Elastic(young=young, poisson=0.0, density=1000.0), Box((0.05,) * 3), (0.3, 0.0, 0.07))
        specimen = _still(Continuum([thick, solid], [FLOOR])).make()
        (medium,) = Stepper(compile(specimen, build(specimen), DRAFT)).media
        assert medium.viscosities == pytest.approx([0.007 * 1000 * medium.cell * times * math.sqrt(100.0) / 0.3] * 2)
    assert "viscosity of 25 Pa s" in refused(thin, solid)


def test_the_resolution_that_is_told_would_do() -> None:
    """A thin fluid is refused with how many times as many cells it needs; with as many it is not, with fewer it is."""
    thin = Newtonian(viscosity=2.0, bulk=1e4)
    words = refused(cube(thin, 0.07))
    assert words.startswith("R7: 'cube': a dynamic viscosity of 1 Pa s, less than the method's own at cells of ")
    factor = float(words.split(" or ")[1].split()[0])
    cell = float(words.split("cells of ")[1].split()[0])
    assert factor > 1.5
    body = Body(thin, np.zeros((1, 3)), 1e-6)

    def own(dx: float) -> float:
        return numerical_viscosity(body, dx, longest_step([body], dx))

    assert own(cell / (1.01 * factor)) < 1.0 < own(cell / (0.99 * factor))


def test_no_resolution_is_told_where_none_would_do() -> None:
    """Of no viscosity, or beside what is so thick that steps go down with Δx²."""
    thick = Piece("honey", Newtonian(viscosity=2e5, bulk=1e4), Box((0.05,) * 3), (0.3, 0.0, 0.07))
    for words in (refused(cube(Newtonian(viscosity=0.0, bulk=1e4), 0.07)),
                  refused(cube(Newtonian(viscosity=2.0, bulk=1e4), 0.07), thick)):  # fmt: skip
        assert words.startswith("R7: 'cube': a dynamic viscosity of")
        assert "allowed: " in words
        assert words.endswith("Pa s")
