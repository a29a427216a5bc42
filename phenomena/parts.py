"""Parts that several phenomena share."""

from __future__ import annotations

from math import pi

from physinone_mj.contact import Surface
from physinone_mj.scene import Part, Scene


def court(scene: Scene, half: float, surface: Surface) -> Part:
    """A square of low rails round the origin, of half side `half` [m] inside."""
    part = scene.add("court")
    for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
        rail = part.geom(name)
        rail.pos[:2] = (x * (half + 0.03), y * (half + 0.03))
        rail.size[0 if y else 1] = half + (0.0 if y else 0.06)
    scene.material(part.name("rails"), 700.0, surface)
    return part


def ball(
    scene: Scene, name: str, radius: float, density: float, surface: Surface, colour: tuple[float, float, float]
) -> Part:
    """A solid sphere."""
    part = scene.add("ball", name)
    geom = part.geom("ball")
    geom.size[0], geom.mass, geom.rgba = radius, sphere_mass(radius, density), (*colour, 1.0)
    scene.material(part.name("ball"), density, surface)
    return part


def sphere_mass(radius: float, density: float) -> float:
    """Of a solid sphere [kg]."""
    return density * 4 / 3 * pi * radius**3
