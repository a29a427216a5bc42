"""Lasers and what their light falls on."""

from __future__ import annotations

from math import atan2, cos, sin

from physinone_mj.contact import Surface
from physinone_mj.scene import Beam, Part, Scene

DRY = Surface(friction=0.4, restitution=0.4)
"""Of what stands about."""


def laser(scene: Scene, place: tuple[float, float, float], heading: float, *, name: str = "laser") -> Part:
    """A laser on its stand, the mouth at `place` [m], shining level in a direction [rad] from x towards y.

    Its beam has the name of the part.
    """
    part = scene.add("laser", name)
    body = part.body("laser")
    body.pos, body.quat = place, (cos(heading / 2), 0, 0, sin(heading / 2))
    part.geom("stem").fromto = (-0.1, 0, -0.02, -0.1, 0, 0.01 - place[2])
    part.geom("foot").fromto = (-0.1, 0, -place[2], -0.1, 0, 0.02 - place[2])
    scene.material(part.name("laser"), 2700.0, DRY)
    scene.beams.append(Beam(name, part.name("aperture")))
    return part


def screen(
    scene: Scene, place: tuple[float, float], facing: tuple[float, float], size: tuple[float, float], *, name: str
) -> Part:
    """A board that stands at a place (x, y) [m] and faces a direction (x, y); size: half width and height [m]."""
    part = scene.add("screen", name)
    turn = atan2(facing[1], facing[0]) / 2
    body, (half, height) = part.body("screen"), size
    body.pos, body.quat = (*place, 0), (cos(turn), 0, 0, sin(turn))
    part.geom("board").pos, part.geom("board").size = (-0.01, 0, height / 2 + 0.06), (0.01, half, height / 2)
    for foot, side in (("left", -1), ("right", 1)):
        part.geom(foot).pos[1] = side * 0.8 * half
    scene.material(part.name("screen"), 700.0, DRY)
    return part
