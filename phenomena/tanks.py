"""Tanks of water that light passes."""

from __future__ import annotations

from typing import Final

from physinone_mj.scene import Dielectric, Part, Scene

from .lasers import DRY

WATER: Final = 1.333
"""Index of refraction: of water at 20 °C for yellow light (CRC Handbook of Chemistry and Physics, section 10)."""

PANE: Final = 0.002
"""Half the thickness of the glass, which light does not heed [m]."""

SUNK: Final = 0.002
"""How far the water reaches into the floor [m]."""


def tank(
    scene: Scene, place: tuple[float, float, float], half: tuple[float, float], depth: float, *, index: float = WATER
) -> Part:
    """An open tank, the middle of its floor at a place [m], half as wide along x and y as `half` [m] inside.

    depth: of the water [m]; index: of refraction. Defect: its panes have no thickness for light.
    """
    part = scene.add("tank")
    part.body("tank").pos = place
    (x, y), high = half, depth + 0.04
    water, floor = part.geom("water"), part.geom("floor")
    water.pos, water.size = (0, 0, (depth - SUNK) / 2), (x, y, (depth + SUNK) / 2)
    floor.size[:2] = x + 0.04, y + 0.04
    for pane, side in (("west", -1), ("east", 1)):
        part.geom(pane).pos, part.geom(pane).size = (
            (side * (x + 1.5 * PANE), 0, high / 2),
            (PANE, y + 2 * PANE, high / 2),
        )
    for pane, side in (("south", -1), ("north", 1)):
        part.geom(pane).pos, part.geom(pane).size = (0, side * (y + 1.5 * PANE), high / 2), (x, PANE, high / 2)
    scene.material(part.name("tank"), 2500.0, DRY)
    scene.dielectrics.append(Dielectric(part.name("water"), index))
    return part
