"""Curved mirrors, and the bench on which their light is shown: a table with low walls, a bar of lasers.

All of it grows with the mirror: lengths are fractions of a `unit`, its radius of curvature.
"""

from __future__ import annotations

from colorsys import hsv_to_rgb
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from physinone_mj import optics
from physinone_mj.optics import Rays
from physinone_mj.run import Run
from physinone_mj.scene import Beam, Conic, Motor, Part, Scene

from .lasers import DRY

Array = NDArray[np.float64]

BOARD: Final = 0.02
"""Thickness of the table, in units."""

WALL: Final = 0.015
"""Half the thickness of its walls, in units."""

OVER: Final = 0.04
"""How far the walls stand out above the light's plane, in units."""

BARREL: Final = (0.12, 0.016)
"""Length and radius of a laser, in units."""

CUT: Final = 0.1
"""Half the height of a mirror's strip, in units; its edge is as far again below it as LIP."""

LIP: Final = 0.012
"""Border of a mirror's strip, above and below, in units."""

BEHIND: Final = (0.004, 0.02)
"""Front and back of the shell behind the silver, in units: chords of the silver are nearer to it than this."""

RAMP: Final = 0.1
"""How long a slide takes to turn round or to stop [s]."""

_COLUMNS, _ROWS = 160, 6
"""Facets of a strip's picture, along and up."""


def _grid(mirror: Conic, lip: float = 0.0) -> tuple[Array, Array]:
    """Points (n, 3) [m] and normals (n, 3) of a strip of a sphere, row by row, with a border above and below [m]."""
    y = np.linspace(-mirror.strip - lip, mirror.strip + lip, _ROWS + 1)[:, None]
    widest = np.arcsin(np.sqrt(mirror.aperture**2 - y**2) / mirror.radius)
    points, normals = mirror.surface(mirror.radius * np.sin(widest * np.linspace(-1, 1, _COLUMNS + 1)), y)
    return points.reshape(-1, 3), normals.reshape(-1, 3)


def _sheet(first: int = 0, *, turned: bool = False) -> NDArray[np.int32]:
    """Faces (m, 3) over a strip's points, anticlockwise seen from z, or from behind."""
    row, column = np.meshgrid(np.arange(_ROWS), np.arange(_COLUMNS), indexing="ij")
    a = (first + row * (_COLUMNS + 1) + column).ravel()
    b, c, d = a + 1, a + _COLUMNS + 2, a + _COLUMNS + 1
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.asarray(faces[:, ::-1] if turned else faces, np.int32)


def _border(count: int) -> NDArray[np.int32]:
    """Faces (m, 3) that join the edges of two sheets of `count` points, the first in front."""
    wide = _COLUMNS + 1
    low, right = np.arange(_COLUMNS), np.arange(_ROWS) * wide + _COLUMNS
    high, left = np.arange(_COLUMNS, 0, -1) + _ROWS * wide, np.arange(_ROWS, 0, -1) * wide
    ring = np.concatenate([low, right, high, left])
    after = np.roll(ring, -1)
    return np.asarray(
        np.concatenate([np.column_stack([ring, ring + count, after + count]),
                        np.column_stack([ring, after + count, after])]), np.int32
    )  # fmt: skip


def bent_mirror(scene: Scene, vertex: ArrayLike, heading: float, radius: float, aperture: float, half: float) -> Part:
    """A strip of a concave spherical mirror on its edge: its vertex at a place (3,) [m], its back towards a heading
    [rad], from x towards y; its radius of curvature, half its length along the chord, half its height [m]."""
    part = scene.add("bent_mirror")
    body = part.body("mirror")
    body.pos, body.quat = np.asarray(vertex, float), (cos(heading / 2), 0, 0, sin(heading / 2))
    mirror = Conic(part.name("silver"), part.name("vertex"), radius, aperture, strip=half)
    scene.mirrors.append(mirror)
    points, normals = _grid(mirror)
    scene.spec.add_mesh(
        name=part.name("silver_mesh"), uservert=points.ravel(), usernormal=normals.ravel(),
        userface=_sheet().ravel(), userfacenormal=_sheet().ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    points, normals = _grid(mirror, LIP * radius)
    level = normals * (1.0, 0.0, 1.0)  # so that its edges stay level
    both = np.concatenate([points - depth * radius * level for depth in BEHIND])
    faces = np.concatenate([_sheet(), _sheet(len(points), turned=True), _border(len(points))])
    scene.spec.add_mesh(
        name=part.name("shell_mesh"), uservert=both.ravel(), userface=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    for geom in ("silver", "shell"):
        part.geom(geom).meshname = part.name(geom + "_mesh")
    scene.material(part.name("mirror"), 2500.0, DRY)
    return part


@dataclass(frozen=True)
class Bench:
    """A table with walls round it: inner faces of the walls (x from west to east, |y| <= half) [m]; plane: height of
    the light's plane over the ground [m]; unit: the mirror's radius of curvature [m]."""

    west: float
    east: float
    half: float
    plane: float
    unit: float

    @property
    def board(self) -> float:
        """Height of the table's top over the ground [m]."""
        return BOARD * self.unit

    def table(self, scene: Scene) -> Part:
        """Put the table into the scene."""
        part = scene.add("light_table")
        thick, top = WALL * self.unit, self.plane + OVER * self.unit
        middle, long = (self.west + self.east) / 2, (self.east - self.west) / 2
        part.geom("board").pos, part.geom("board").size = (middle, 0, self.board / 2), (long, self.half, self.board / 2)
        for name, x in (("west", self.west - thick), ("east", self.east + thick)):
            part.geom(name).pos, part.geom(name).size = (x, 0, top / 2), (thick, self.half + 2 * thick, top / 2)
        for name, y in (("south", -self.half - thick), ("north", self.half + thick)):
            part.geom(name).pos, part.geom(name).size = (middle, y, top / 2), (long, thick, top / 2)
        scene.material(part.name("table"), 700.0, DRY)
        return part

    def lasers(self, scene: Scene, x: float, places: ArrayLike, motion: Shuttle | None = None) -> Part:
        """A bar of lasers that shine along x from x [m], at places (n,) beside its middle [m], in the light's plane.

        motion: of the bar, along y, if it moves: on the joint "slide". The beams are named `beam00`, `beam01` ... from
        -y to +y, each with a colour.
        """
        part = scene.add("laser_bar")
        places = np.sort(np.asarray(places, float))
        length, thick = (size * self.unit for size in BARREL)
        radius = min(thick, 0.4 * float(np.diff(places).min()))
        reach, back = float(np.abs(places).max()) + 2 * radius, -0.55 * length
        below, rail = 0.03 * self.unit, 0.01 * self.unit
        part.body("bar").pos = (x, 0, self.plane)
        bar = part.geom("bar")
        bar.pos, bar.size = (back, 0, -radius - below / 2), (0.4 * length, reach, below / 2)
        deep = self.plane - self.board
        stand = (deep - radius - below - rail) / 2
        for name, side in (("left", -1), ("right", 1)):
            leg = part.geom(name)
            leg.pos, leg.size = (back, side * 0.7 * reach, rail - deep + stand), (0.3 * length, radius, stand)
        rails = part.geom("rail")
        rails.pos = (x + back, 0, self.board + rail / 2)
        rails.size = (0.35 * length, 0.7 * reach + 2 * radius + (motion.reach if motion else 0.0), rail / 2)
        for k, y in enumerate(places):
            diode = scene.add("diode", f"diode{k:02d}", on=part.name("bar"))
            diode.body("diode").pos[1] = y
            barrel, ring = diode.geom("barrel"), diode.geom("ring")
            barrel.fromto, barrel.size[0] = (-length, 0, 0, 0, 0, 0), radius
            ring.fromto, ring.size[0] = (-0.15 * length, 0, 0, -0.05 * length, 0, 0), 1.1 * radius
            ring.rgba = spectral(k, len(places))
            self.shine(scene, f"beam{k:02d}", diode.name("aperture"), spectral(k, len(places)))
            scene.material(diode.name("diode"), 2700.0, DRY)
        for body in ("bar", "rail"):
            scene.material(part.name(body), 2700.0, DRY)
        if motion:
            slide = part.body("bar").add_joint(
                name=part.name("slide"), type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0)
            )
            motion.drive(scene, slide.name)
        return part

    def shine(self, scene: Scene, name: str, site: str, tint: tuple[float, float, float, float]) -> None:
        """A beam that ends on the walls at the latest."""
        across = hypot(self.east - self.west, 2 * self.half)
        scene.beams.append(Beam(name, site, reach=5 * across, radius=0.002 * across, rgba=(*tint[:3], 0.85)))


@dataclass(frozen=True)
class Shuttle:
    """A slide that a motor moves to and fro: from -half to half [m] and back at a speed [m/s], for a duration [s]."""

    half: float
    speed: float
    duration: float

    @property
    def reach(self) -> float:
        """Farthest from the middle [m]."""
        return self.half + self.speed * RAMP / 4

    def course(self) -> tuple[tuple[float, float], ...]:
        """(time [s], speed [m/s]) of the motor."""
        way, found, time = self.speed, [(0.0, self.speed)], 0.0
        while time < self.duration:
            time += 2 * self.half / self.speed
            found += [(time, way), (time + RAMP, -way)]
            time, way = time + RAMP, -way
        return tuple(found)

    def steady(self, t: Array) -> NDArray[np.bool_]:
        """Samples (T,) at which it does not turn round, nor do the two before and after them."""
        course = np.array(self.course())
        step = 2.5 * (t[1] - t[0])
        turning = [(t > a - step) & (t < b + step) for a, b in course[1:, 0].reshape(-1, 2)]
        inside = (t > t[0] + step) & (t < t[-1] - step)
        return np.asarray(inside & ~np.any(turning, axis=0))

    def drive(self, scene: Scene, joint: str) -> None:
        """Let it move a joint of a scene."""
        scene.motors.append(Motor(joint, self.course()))
        scene.start[joint], scene.speed[joint] = -self.half, self.speed


def spectral(k: int, count: int) -> tuple[float, float, float, float]:
    """Colour of one of some beams, from red to violet; a mirror throws all colours alike."""
    return (*hsv_to_rgb(0.78 * k / max(count - 1, 1), 0.85, 1.0), 1.0)


def traced(run: Run) -> list[Rays]:
    """All beams of a run, in their order."""
    return [optics.trace(run, beam.name) for beam in run.scene.beams]


def ends(run: Run) -> Array:
    """Where each beam ends (T, n, 3) [m]."""
    return np.stack([rays.ends for rays in traced(run)], axis=1)


def slope(values: Array, i: NDArray[np.int64], step: Array) -> Array:
    """Derivative (n, k) of values (T, k) at samples i (n,), by those two before and after, a step (n,) apart."""
    rise = 8 * (values[i + 1] - values[i - 1]) - (values[i + 2] - values[i - 2])
    return np.asarray(rise / (12 * step[:, None]))


def spread(half: float, count: int) -> Array:
    """Places (n,) of some beams, evenly from -half to half [m]."""
    return np.linspace(-half, half, count)
