"""How finely a scene is computed: dimensionless, so that one preset means the same for every phenomenon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Fidelity:
    """How finely, and nothing else: what is there belongs to the scene.

    steps: time steps per shortest time of the scene (`Scene.resolve(time=...)`): dt = T / steps
    cells: grid cells per shortest length of a continuum: dx = L / cells
    samples: rays per pixel of a physically based picture
    """

    name: str
    steps: int
    cells: int
    samples: int

    def __post_init__(self) -> None:
        for field in ("steps", "cells", "samples"):
            if getattr(self, field) < 1:
                raise ValueError(f"fidelity {self.name}: {field} = {getattr(self, field)}; allowed: 1 or more")

    @classmethod
    def named(cls, name: str) -> Fidelity:
        """The preset of that name; ValueError names the three there are."""
        for preset in PRESETS:
            if preset.name == name.lower():
                return preset
        raise ValueError(f"fidelity = {name!r}; allowed: {', '.join(preset.name for preset in PRESETS)}")

    @property
    def rank(self) -> int:
        """The column of a law's three tolerances that this fidelity is held to: that of the coarsest preset not finer
        than it."""
        return max((i for i, preset in enumerate(PRESETS) if preset.steps <= self.steps), default=0)


DRAFT: Final = Fidelity("draft", steps=64, cells=8, samples=4)
STANDARD: Final = Fidelity("standard", steps=256, cells=16, samples=16)
REFERENCE: Final = Fidelity("reference", steps=1024, cells=32, samples=64)
PRESETS: Final = (DRAFT, STANDARD, REFERENCE)
