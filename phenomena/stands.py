"""What things hang from."""

from __future__ import annotations

from physinone_mj.contact import Surface
from physinone_mj.scene import Part, Scene

DRY = Surface(friction=0.4, restitution=0.4)
"""Of what stands about and touches nothing."""


def gallows(scene: Scene, height: float, width: float, *, foot: float = 0.2) -> Part:
    """A beam along y at a height [m] on two legs at y = ± width; `foot` is the half length of their feet [m]."""
    part = scene.add("gallows")
    part.body("frame").pos[2] = height
    part.geom("beam").fromto = (0, -width, 0, 0, width, 0)
    for leg, y in (("left", -width), ("right", width)):
        part.geom(leg).fromto = (0, y, 0, 0, y, -height)
        part.geom(f"{leg}_foot").pos, part.geom(f"{leg}_foot").size[0] = (0, y, 0.02 - height), foot
    scene.material(part.name("frame"), 700.0, DRY)
    return part


def hook(scene: Scene, height: float, *, half_width: float = 0.03) -> Part:
    """A steel bar whose underside is at a height [m], bolted under the beam of a gallows 0.045 m higher."""
    part = scene.add("hook")
    part.body("hook").pos[2] = height
    part.geom("bar").size[1] = half_width
    scene.material(part.name("hook"), 7800.0, DRY)
    return part
