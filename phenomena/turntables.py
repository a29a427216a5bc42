"""Turntables, and blocks that ride on them, slip and slide."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from phenomena.parts import court
from phenomena.spins import Course, across
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]

HINGE: Final = "turntable/hinge"
TOP: Final = "turntable/top"

HALF: Final = 0.012
"""Half thickness of the disc [m]."""

BOARD: Final = 300.0
"""Density of the disc: light wood [kg/m³]."""

FLOOR: Final = Surface(friction=0.4, restitution=0.2)
"""Of the ground and the rails round it."""

_STILL: Final = 1e-7
"""Slip at which friction takes the direction that it is going to have [m/s]."""


def turntable(scene: Scene, radius: float, height: float, course: Course, surface: Surface) -> Part:
    """A disc whose upper side is at a height [m], turned by a motor, on the ground."""
    part = scene.add("turntable")
    part.body("turntable").pos[2] = height - HALF
    top, shaft, motor, foot = (part.geom(name) for name in ("top", "shaft", "motor", "foot"))
    top.size[:2], top.mass = (radius, HALF), BOARD * pi * radius**2 * 2 * HALF
    below = height - 2 * HALF
    housing = min(0.7 * below, 0.10)
    width = min(0.07, 0.25 * radius)
    motor.pos[2], motor.size[:2] = housing / 2, (width, housing / 2)
    shaft.pos[2], shaft.size[:2] = -HALF - (below - housing) / 2, (0.4 * width, (below - housing) / 2)
    foot.pos[2], foot.size[:2] = 0.005, (min(0.16, 0.6 * radius), 0.005)
    stripe, cap = part.geom("stripe"), part.geom("cap")
    stripe.pos[0], stripe.size[0] = radius / 2, radius / 2
    stripe.pos[2] = cap.pos[2] = HALF
    scene.material(TOP, BOARD, surface)
    scene.material(part.name("turntable"), BOARD, surface)
    scene.material(part.name("stand"), 7800.0, FLOOR)
    scene.motors.append(course.motor(HINGE))
    scene.speed[HINGE] = course.first
    return part


def arena(scene: Scene, half: float, height: float) -> Part:
    """Ground and rails of a height [m] that keep what flies off in view."""
    scene.material("stage/floor", 2400.0, FLOOR)
    part = court(scene, half, FLOOR)
    for name in ("east", "west", "north", "south"):
        rail = part.geom(name)
        rail.pos[2] = rail.size[2] = height / 2
    return part


def block(
    scene: Scene, name: str, half: tuple[float, float, float], density: float, surface: Surface,
    colour: tuple[float, float, float],
) -> Part:  # fmt: skip
    """A loose block that the turntable, the ground and the rails can touch."""
    part = scene.add("block", name)
    geom = part.geom("block")
    geom.size[:], geom.mass, geom.rgba = half, density * 8 * float(np.prod(half)), (*colour, 1.0)
    scene.material(part.name("block"), density, surface)
    for other in (TOP, "stage/floor", "court/rails"):
        scene.touch(part.name("block"), other)
    return part


def carry(scene: Scene, joint: str, radius: float, azimuth: float, height: float, spin: float) -> None:
    """Start a free body at a place on a turntable [m, rad, m], turning with it."""
    out = np.array([cos(azimuth), sin(azimuth)])
    lean = (cos(azimuth / 2), 0.0, 0.0, sin(azimuth / 2))
    scene.start[joint] = free_pose((*(radius * out), height), lean)
    scene.speed[joint] = (*(radius * spin * across(out)), 0.0, 0.0, 0.0, spin)


def slide(
    course: Course, friction: float, since: float, start: tuple[Array, Array], towards: Array, t: Array
) -> tuple[Array, Array]:
    """Places and velocities in the plan (T, 2) of a flat block that slides on a turntable: ẍ = -μ g û, û = w/|w|,
    w = ẋ - Ω ẑ × x.

    since: time [s] from which it slides, and `start` its place and velocity then; towards: unit vector (2,), of the
    first slip; t: later times (T,) [s]
    """

    def rate(when: float, y: Array) -> Array:
        slip = y[2:] - course.spin(when) * across(y[:2]) + _STILL * towards
        return np.concatenate([y[2:], -friction * g * slip / np.linalg.norm(slip)])

    found = solve_ivp(
        rate, (since, float(t[-1])), np.concatenate(start), method="Radau", t_eval=t, rtol=1e-9, atol=1e-11,
        max_step=0.02,
    )  # fmt: skip
    return found.y[:2].T, found.y[2:].T
