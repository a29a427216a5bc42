"""What matter may be declared to be: each number out of its range is named, with its value and what is allowed."""

from __future__ import annotations

import math
from typing import Any

import pytest

from physinone_mj.continuum import (
    Ball,
    Box,
    Continuum,
    Elastic,
    Granular,
    Inlet,
    Meeting,
    Newtonian,
    Piece,
    Plasticine,
    Viscoplastic,
    Wall,
)

NAN = math.nan


@pytest.mark.parametrize("material", [Elastic, Plasticine, Viscoplastic, Granular])
@pytest.mark.parametrize("poisson", [-0.01, 0.491, 0.5, NAN])
def test_what_cannot_be_compressed_is_refused(material: Any, poisson: float) -> None:
    """λ is 2 μ ν/(1 - 2 ν), endless at a half; at 0.49 it is 49 times μ, which is allowed, and so is 0."""
    with pytest.raises(ValueError, match=rf"^{material.__name__}: poisson = {poisson}; allowed: 0 to 0\.49$"):
        material(poisson=poisson)
    mu, lam = material(poisson=0.49).parameters()[:2]
    assert lam == pytest.approx(49 * mu)
    assert material(poisson=0.0).parameters()[1] == 0.0


@pytest.mark.parametrize(
    ("material", "name", "allowed", "wrong"),
    [
        *((each, "young", "1 to 1e+12", (0.9, 1.1e12)) for each in (Elastic, Plasticine, Viscoplastic, Granular)),
        *((each, "density", "0.001 to 100000", (0.0, 1.1e5)) for each in (Elastic, Newtonian, Granular)),
        *((each, "yield_stress", "0 to 1e+12", (-1.0, math.inf)) for each in (Plasticine, Viscoplastic)),
        *((each, "viscosity", "0 to 1e+09", (-1.0, 1.1e9)) for each in (Viscoplastic, Newtonian)),
        (Newtonian, "bulk", "1 to 1e+12", (0.9, 1.1e12)),
        (Granular, "friction", "0 to 1.39626", (-0.01, 1.4)),
    ],
)
def test_each_number_has_its_range(material: Any, name: str, allowed: str, wrong: tuple[float, float]) -> None:
    for value in (*wrong, NAN):
        with pytest.raises(ValueError, match="allowed") as told:
            material(**{name: value})
        assert str(told.value) == f"{material.__name__}: {name} = {value}; allowed: {allowed}"


def piece(**more: Any) -> Piece:
    return Piece("it", Elastic(), Ball(0.1), **{"position": (0.0, 0.0, 0.0), **more})


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: Box((0.1, 0.0, 0.1)), "Box: half = (0.1, 0.0, 0.1) m; allowed: positive and finite"),
        (lambda: Ball(math.inf), "Ball: radius = inf m; allowed: positive and finite"),
        (lambda: piece(position=(0.0, NAN, 0.0)), "position = (0.0, nan, 0.0) of 'it'; allowed: finite numbers"),
        (lambda: piece(velocity=(math.inf, 0.0, 0.0)), "velocity = (inf, 0.0, 0.0) of 'it'; allowed: finite numbers"),
        (lambda: piece(spin=(0.0, 0.0, NAN)), "spin = (0.0, 0.0, nan) of 'it'; allowed: finite numbers"),
        (lambda: piece(quaternion=(1.0, 1.0, 0.0, 0.0)),
         "quaternion = (1.0, 1.0, 0.0, 0.0) of 'it'; allowed: of length 1"),
        (lambda: Meeting("floor", "separate", -0.1), "friction = -0.1 against 'floor'; allowed: 0 or more"),
        (lambda: Meeting("floor", "separate", math.inf), "friction = inf against 'floor'; allowed: 0 or more"),
        (lambda: Wall((0, 0, 0), (0, 1, 1)),
         "normal = (0, 1, 1), friction = 0.0 of a wall; allowed: a unit vector, 0 or more"),
        (lambda: Inlet("it", (0, 0, 1), (0, 0, -1), 0.0),
         "radius = 0.0 m, velocity = (0, 0, -1) of an inlet; allowed: positive"),
        (lambda: Inlet("it", (0, 0, 1), (0, 0, 0), 0.1),
         "radius = 0.1 m, velocity = (0, 0, 0) of an inlet; allowed: positive"),
        (lambda: Inlet("it", (0, 0, 1), (0, 0, -1), 0.1, 2.0, 1.0),
         "start = 2.0 s, stop = 1.0 s of an inlet; allowed: 0 <= start < stop"),
        (lambda: Inlet("it", (0, NAN, 1), (0, 0, -1), 0.1),
         "Inlet: position = (0, nan, 1); allowed: three finite numbers"),
        (lambda: Continuum(ramp=-1.0), "ramp = -1.0 s of a continuum; allowed: 0 or more, finite"),
        (lambda: Continuum(ramp=NAN), "ramp = nan s of a continuum; allowed: 0 or more, finite"),
        (lambda: Continuum(ramp=math.inf), "ramp = inf s of a continuum; allowed: 0 or more, finite"),
        (lambda: Continuum(gravity=(0, 0, NAN)), "Continuum: gravity = (0, 0, nan); allowed: three finite numbers"),
        (lambda: Continuum(gravity=(0.0, -9.8)),  # type: ignore[arg-type]
         "Continuum: gravity = (0.0, -9.8); allowed: three finite numbers"),
        (lambda: Wall((0, NAN, 0), (0, 0, 1)), "Wall: point = (0, nan, 0); allowed: three finite numbers"),
        (lambda: Continuum(period=(NAN, 1.0, 1.0)),
         "period = (nan, 1.0, 1.0) m of a continuum; allowed: positive, or infinite"),
        (lambda: Continuum(period=(0.0, 1.0, 1.0)),
         "period = (0.0, 1.0, 1.0) m of a continuum; allowed: positive, or infinite"),
    ],
)  # fmt: skip
def test_impossible_declarations(wrong: Any, told: str) -> None:
    with pytest.raises(ValueError, match="allowed") as raised:
        wrong()
    assert str(raised.value) == told
