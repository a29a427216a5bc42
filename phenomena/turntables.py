"""Turntables, and blocks that ride on them, slip and slide."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, pi, sin, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from phenomena.parts import court
from phenomena.spins import Course, across, distance, drift
from physinone_mj.base import NotEvaluated
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]

HINGE: Final = "turntable/hinge"
TOP: Final = "turntable/top"

HALF: Final = 0.012
"""Half thickness of a disc on a shaft [m]."""

LOW: Final = 0.2
"""A table no higher than this is a drum [m]: what falls off a low disc would be jammed under it."""

BOARD: Final = 300.0
"""Density of the disc: light wood [kg/m³]."""

FLOOR: Final = Surface(friction=0.4, restitution=0.2)
"""Of the ground and the rails round it."""

SEEN: Final = 2e-4
"""Slip that is more than a creep [m/s]."""

SLOW: Final = 0.05
"""Tangential acceleration at which the slip is bracketed, in units of the greatest that friction gives."""

TURNING: Final = 0.3
"""Part of the friction on a block, with half its side as arm, that may be needed to turn it: h α/(μ g)."""

MARGIN: Final = 2e-3
"""A block must stay on a table speeding up slowly to a spin this much below the critical one, and leave it on one
speeding up to as much above (of the spin)."""

_STILL: Final = 1e-7
"""Slip at which friction takes the direction that it is going to have [m/s]."""


def turntable(scene: Scene, radius: float, height: float, course: Course, surface: Surface) -> Part:
    """A disc whose upper side is at a height [m], turned by a motor, on the ground."""
    part = scene.add("turntable")
    half = HALF if height > LOW else height / 2 - 0.005
    part.body("turntable").pos[2] = height - half
    top, shaft, motor, foot = (part.geom(name) for name in ("top", "shaft", "motor", "foot"))
    top.size[:2], top.mass = (radius, half), BOARD * pi * radius**2 * 2 * half
    below = height - 2 * half
    housing = min(0.7 * below, 0.10)
    width = min(0.07, 0.25 * radius)
    motor.pos[2], motor.size[:2] = housing / 2, (width, housing / 2)
    shaft.pos[2], shaft.size[:2] = -half - (below - housing) / 2, (0.4 * width, (below - housing) / 2)
    foot.pos[2], foot.size[:2] = 0.004, (min(0.16, 0.6 * radius), 0.004)
    stripe, cap = part.geom("stripe"), part.geom("cap")
    stripe.pos[0], stripe.size[0] = radius / 2, radius / 2
    stripe.pos[2] = cap.pos[2] = half
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


def taken_along(radius: float, rate: float, half: float = 0.0) -> float:
    """Friction that a block on a table speeding up needs for that, over its mass [m/s²]: α √(r² + (2h/3)²).

    half: h, of the sides of a square block that stands on its corners and has to be turned, too. Limit load of four
    corners, to second order in h α/(μ g), which has to stay below `TURNING`. Source: S. Goyal, A. Ruina and J.
    Papadopoulos, Wear 143 (1991) 307: limit surfaces.
    """
    return rate * hypot(radius, 2 / 3 * half)


def slip_spin(friction: float, radius: float, rate: float, half: float = 0.0) -> float:
    """Spin that a block on a table speeding up stands [rad/s]: r Ω² = ((μ g)² - a²)^(1/2), where a is what it needs to
    be `taken_along`; 0 if it slips at once."""
    return float(max((friction * g) ** 2 - taken_along(radius, rate, half) ** 2, 0.0) ** 0.25 / sqrt(radius))


def slip_time(course: Course, friction: float, radius: float, half: float = 0.0) -> float:
    """When a block that rides from the start first slips [s]; infinite if it never does."""
    begins = course.slope if course.ramp > 0 else 0.0
    if hypot(radius * course.first**2, taken_along(radius, begins, half)) > friction * g:
        return 0.0
    spin = slip_spin(friction, radius, course.rate, half)
    return (spin - course.first) / course.rate if course.first <= spin < course.last else inf


@dataclass(frozen=True)
class Slide:
    """A flat block's way over a turntable and off it, seen from above, from the moment `since` [s] when it slides.

    start, velocity: in the plan (2,); towards: unit vector (2,) of the first slip
    """

    course: Course
    friction: float
    since: float
    start: Array
    velocity: Array
    towards: Array

    @classmethod
    def riding(cls, course: Course, friction: float, radius: float, azimuth: float, since: float) -> Slide:
        """Of a block that rode with the disc till then; azimuth: where it was at t = 0 [rad]."""
        turned = azimuth + float(course.angle(since))
        out = np.array([cos(turned), sin(turned)])
        spin, speeding = float(course.spin(since)), float(course.acceleration(since))
        pull = spin**2 * out - speeding * across(out)
        return cls(course, friction, since, radius * out, radius * spin * across(out), pull / np.linalg.norm(pull))

    def way(self, t: Array) -> tuple[Array, Array]:
        """Places and velocities (T, 2) at later times: ẍ = -μ g û, û = w/|w|, w = ẋ - Ω ẑ × x."""

        def rate(when: float, y: Array) -> Array:
            slip = y[2:] - self.course.spin(when) * across(y[:2]) + _STILL * self.towards
            return np.concatenate([y[2:], -self.friction * g * slip / np.linalg.norm(slip)])

        span = (self.since, max(float(t[-1]), self.since + 1e-6))
        begin = np.concatenate([self.start, self.velocity])
        found = solve_ivp(rate, span, begin, method="Radau", t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.02)
        return found.y[:2].T, found.y[2:].T

    def reach(self, distance: float, within: float) -> tuple[float, Array, Array] | None:
        """When it comes to a distance from the axis, its place and velocity then; None if not in so many seconds."""
        t = np.arange(self.since, self.since + within, 1 / 240)
        x, v = self.way(t)
        far = np.linalg.norm(x, axis=1)
        i = int(np.argmax(far >= distance))
        if i == 0:
            return None
        part = (distance - far[i - 1]) / (far[i] - far[i - 1])
        return tuple(a[i - 1] + part * (a[i] - a[i - 1]) for a in (t, x, v))


def ahead(run: Run, body: str) -> Array:
    """By how much what rides along is recorded faster than the table beneath it (T,) [m/s]: Ω³ r Δt²/2.

    A contact holds what lies on it along where the table goes in the middle of a step, not at its end.
    """
    return np.asarray(np.abs(run.joint_speed(HINGE)) ** 3 * distance(run, body) * run.model.opt.timestep**2 / 2)


def onset(run: Run, body: str, *, reach: float = 0.15) -> float:
    """When a block begins to slip [s]: its slip grows with the square of time, so its root is a line, read backwards
    to zero over so many seconds. NotEvaluated if it does not slip, or does so from the start."""
    speed = np.linalg.norm(drift(run, body, HINGE), axis=1)
    first = int(np.argmax(speed > SEEN + 2 * ahead(run, body)))
    if first < 5 or first + 10 > len(speed):
        raise NotEvaluated("the block does not begin to slip while it is watched")
    some = between(run.t, run.t[first], run.t[first] + reach)
    t = run.t[some]
    roots = np.roots(np.polyfit(t - t[0], np.sqrt(speed[some]), 2))
    return float(t[0] + roots[np.argmin(np.abs(roots))].real)


def critical_spin(run: Run, body: str, friction: float, radius: float, **alone: Any) -> tuple[float, float]:
    """Spin up to which a block stays on a table that speeds up slowly: measured between two twins, `MARGIN` of the
    spin below and above, and expected [rad/s]. The phenomenon has parameters first, rate and top.

    alone: parameters of twins that carry nothing else. NotEvaluated if the twins are out of the phenomenon's range.
    """
    declared = run.specimen.declarations()
    holds = friction * g / radius
    rate = min(max(SLOW * holds, declared["rate"][0].low), declared["rate"][0].high)
    spin = slip_spin(friction, radius, rate)
    low, high = declared["top"][0].low, declared["first"][0].high
    if rate > 0.08 * holds or not low * 1.01 < spin < high:
        raise NotEvaluated(f"the critical spin is {spin:.3g} rad/s; slowly the table reaches {low:g} to {high:g} rad/s")

    def goes(top: float) -> bool:
        r = distance(run.again(first=0.95 * spin, rate=rate, top=top, **alone), body)
        return bool(r.max() > r[0] * 1.001)

    return threshold(goes, spin, spread=MARGIN, resolution=2 * MARGIN), spin
