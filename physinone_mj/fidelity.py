"""How finely a scene is computed: dimensionless, so that one preset means the same for every phenomenon."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from dataclasses import asdict, dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from .base import Phenomenon


@dataclass(frozen=True)
class Fidelity:
    """How finely, and nothing else: what is there belongs to the scene.

    steps: time steps per shortest time of the scene (`Scene.resolve(time=...)`): dt = T / steps
    cells: grid cells per shortest length of a continuum: dx = L / cells
    samples: rays per pixel of a physically based picture
    tolerance: largest error of every law, instead of what each allows at the presets
    """

    name: str
    steps: int
    cells: int
    samples: int
    tolerance: float | None = None

    def __post_init__(self) -> None:
        for field in ("steps", "cells", "samples"):
            if getattr(self, field) < 1:
                raise ValueError(f"fidelity {self.name}: {field} = {getattr(self, field)}; allowed: 1 or more")
        if self.tolerance is not None and not 0 < self.tolerance < math.inf:
            raise ValueError(f"fidelity {self.name}: tolerance = {self.tolerance}; allowed: positive, finite")

    def record(self) -> dict[str, Any]:
        """As JSON values; a tolerance only if there is one."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @classmethod
    def named(cls, name: str) -> Fidelity:
        """The preset of that name; ValueError names the three there are."""
        for preset in PRESETS:
            if preset.name == name.lower():
                return preset
        raise ValueError(f"fidelity = {name!r}; allowed: {', '.join(preset.name for preset in PRESETS)}")

    @classmethod
    def for_tolerance(cls, which: type[Phenomenon], tolerance: float) -> Fidelity:
        """The cheapest setting at which every law of the phenomenon is known to err by less than a tolerance, over all
        of its parameters' ranges; ValueError with the best there is if there is none. See `cheapest`."""
        return cheapest(which.index, tolerance).fidelity

    @property
    def rank(self) -> int:
        """The column of a law's three tolerances that this fidelity is held to: that of the coarsest preset not finer
        than it."""
        return max((i for i, preset in enumerate(PRESETS) if preset.steps <= self.steps), default=0)


@dataclass(frozen=True)
class Expected:
    """What the measured tables expect of a setting: the largest error of any law over the parameters' ranges, which
    law's it is, and the cost [processor time for a simulated second, over that of `trade.calibrate`]."""

    fidelity: Fidelity
    error: float
    law: str
    cost: float


SAFETY: Final = 2.0
"""By which an error may exceed the largest one that was measured."""


@functools.cache
def measured(what: Literal["trade", "stability"]) -> Any:
    """A table that ships with the package, by index."""
    return json.loads((resources.files("physinone_mj") / "measured" / f"{what}.json").read_text(encoding="utf-8"))


def expectations(index: int) -> list[Expected]:
    """Of every measured setting at which all specimens could be simulated, in the order of cost."""
    found = []
    for row in measured("trade").get(str(index), {"settings": []})["settings"]:
        errors = {law: error for law, error in row["laws"].items() if error is not None}
        if row["broken"] == 0 and errors:
            law = max(errors, key=lambda name: errors[name])
            steps, cells = row["steps"], row["cells"]
            setting = Fidelity(f"{steps} steps, {cells} cells", steps, cells, STANDARD.samples)
            found.append(Expected(setting, errors[law], law, row["cost"]))
    return sorted(found, key=lambda expected: expected.cost)


def cheapest(index: int, tolerance: float) -> Expected:
    """The cheapest setting whose measured error, `SAFETY` times over, is below a tolerance: relative, or of a law in
    absolute units in those. ValueError if there is none, or the phenomenon has not been measured."""
    if not 0 < tolerance < math.inf:
        raise ValueError(f"tolerance = {tolerance}; allowed: positive, finite")
    known = expectations(index)
    if not known:
        raise ValueError(f"tolerance = {tolerance}: phenomenon {index} has not been measured; allowed: --fidelity")
    for expected in known:
        if SAFETY * expected.error <= tolerance:
            return dataclasses.replace(expected, fidelity=dataclasses.replace(expected.fidelity, tolerance=tolerance))
    best = min(known, key=lambda expected: expected.error)
    raise ValueError(f"tolerance = {tolerance} of phenomenon {index}; allowed: {SAFETY * best.error:.2g} or more, as "
                     f"{best.law} errs by up to {best.error:.2g} at {best.fidelity.name}")  # fmt: skip


DRAFT: Final = Fidelity("draft", steps=64, cells=8, samples=4)
STANDARD: Final = Fidelity("standard", steps=256, cells=16, samples=16)
REFERENCE: Final = Fidelity("reference", steps=1024, cells=32, samples=64)
PRESETS: Final = (DRAFT, STANDARD, REFERENCE)
