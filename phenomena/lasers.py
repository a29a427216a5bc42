"""Lasers, mirrors to send their light on, and what it falls on; and the formulas of plane mirrors."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from physinone_mj import optics
from physinone_mj.contact import Surface
from physinone_mj.optics import NO_RAY, Ray
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Beam, Mirror, Part, Scene

Array = NDArray[np.float64]

DRY = Surface(friction=0.4, restitution=0.4)
"""Of what stands about."""

MOUTH: Final = 0.002
"""From the middle of a laser's mouth to where its beam starts [m]."""

GLASS: Final = 0.004
"""Half the thickness of a mirror's glass [m]."""

BAR: Final = 0.015
"""Width of its frame [m]."""

HAZY: Final = 0.03
"""Nearer than this to an edge of the glass, a beam may meet the frame, which stands out by two millimetres [m]."""

EXACT: Final = "round-off: nothing here depends on the step"
"""Why a law of rays does not improve with the fidelity."""

DRIVEN: Final = "round-off: the motor's course is met at every step"
"""Why one of rays and of a driven mirror does not."""


def laser(
    scene: Scene, place: tuple[float, float, float], heading: float, *, rise: float = 0.0, name: str = "laser",
    bounces: int = 40, reach: float = 10.0, radius: float = 0.004,
) -> Part:  # fmt: skip
    """A laser on its stand, the mouth at `place` [m], shining in a direction [rad] from x towards y.

    rise: of the beam above the level [rad]; bounces, reach, radius [m]: of the beam, which has the name of the part
    """
    part = scene.add("laser", name)
    body = part.body("laser")
    body.pos, body.quat = place, turned(heading, rise)
    down = -quaternion_matrix(turned(heading, rise)[None])[0][2]  # in the axes of the barrel
    stem = np.array([-0.1, 0.0, 0.0])
    height = place[2] - 0.1 * sin(rise)
    part.geom("stem").fromto = (*(stem + 0.02 * down), *(stem + (height - 0.01) * down))
    part.geom("foot").fromto = (*(stem + height * down), *(stem + (height - 0.02) * down))
    scene.material(part.name("laser"), 2700.0, DRY)
    scene.beams.append(Beam(name, part.name("aperture"), reach, bounces, radius))
    return part


def shine(scene: Scene, mouth: ArrayLike, way: ArrayLike, *, bounces: int = 40, reach: float = 10.0) -> Part:
    """A laser whose beam starts at a point (3,) [m] and leaves along a unit vector (3,)."""
    d = np.asarray(way, float)
    x, y, z = (np.asarray(mouth, float) - MOUTH * d).tolist()
    heading, rise = atan2(d[1], d[0]), float(np.arcsin(d[2]))
    return laser(scene, (x, y, z), heading, rise=rise, bounces=bounces, reach=reach, radius=0.005)


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


def turned(heading: float, rise: float = 0.0) -> Array:
    """Quaternion (4,), w first, of axes whose x points along a heading [rad] and rises above the level [rad]."""
    c, s, a, b = cos(heading / 2), sin(heading / 2), cos(rise / 2), sin(rise / 2)
    return np.array([c * a, s * b, -c * b, s * a])


def standing_mirror(
    scene: Scene, name: str, middle: ArrayLike, facing: ArrayLike, size: tuple[float, float], *, ground: float = 0.0
) -> Part:
    """A framed mirror on a post: `middle` (3,) of its silvered face [m], which looks along a unit vector (3,).

    size: half width and half height of the glass [m]; ground: height of what its foot stands on [m]
    It stands still: `slide` and `swivel` set it moving.
    """
    part, n = scene.add("mirror", name), np.asarray(facing, float)
    heading, rise = atan2(n[1], n[0]), float(np.arcsin(n[2]))
    place = np.asarray(middle, float) - GLASS * n
    body, (wide, high) = part.body("mirror"), size
    body.pos, body.quat = place, turned(heading, rise)
    frame_glass(part, size)
    down = -quaternion_matrix(turned(heading, rise)[None])[0][2]
    hold = np.array([-0.01, 0.0, -high - BAR / 2])
    height = float(place[2] - hold @ down) - ground
    part.geom("post").fromto = (*hold, *(hold + height * down))
    part.geom("foot").fromto = (*(hold + (height - 0.012) * down), *(hold + height * down))
    part.geom("foot").size[0] = min(0.1, 0.05 + 0.1 * wide)
    scene.material(part.name("mirror"), 2500.0, DRY)
    scene.mirrors.append(Mirror(part.name("glass"), (GLASS, 0.0, 0.0), (1.0, 0.0, 0.0)))
    return part


def frame_glass(part: Part, size: tuple[float, float]) -> None:
    """Set glass, back and the four bars of a mirror's frame to a half width and half height [m]."""
    wide, high = size
    part.geom("glass").size = (GLASS, wide, high)
    part.geom("back").size[1:] = size
    for bar, side in (("left", -1), ("right", 1)):
        part.geom(bar).pos[1], part.geom(bar).size[1:] = side * (wide + BAR / 2), (BAR / 2, high + BAR)
    for bar, side in (("bottom", -1), ("top", 1)):
        part.geom(bar).pos[2], part.geom(bar).size[1:] = side * (high + BAR / 2), (wide, BAR / 2)


def slide(part: Part, along: ArrayLike) -> str:
    """Let a standing mirror slide along a unit vector (3,) of the world; returns the name of the joint."""
    body = part.body("mirror")
    axis = quaternion_matrix(np.array(body.quat)[None])[0].T @ np.asarray(along, float)
    return _move(part, mujoco.mjtJoint.mjJNT_SLIDE, axis, np.zeros(3))


def swivel(part: Part) -> str:
    """Let a standing mirror turn about its post, anticlockwise seen from above; returns the name of the joint."""
    body = part.body("mirror")
    up = quaternion_matrix(np.array(body.quat)[None])[0][2]
    return _move(part, mujoco.mjtJoint.mjJNT_HINGE, up, np.array(part.geom("post").fromto[:3]))


def _move(part: Part, kind: Any, axis: Array, pivot: Array) -> str:
    joint = part.body("mirror").add_joint(name=part.name("joint"), type=kind)
    joint.axis, joint.pos = axis, pivot
    return part.name("joint")


@dataclass(frozen=True)
class Glide:
    """A slow move from rest to rest: `way` [m or rad] in all, between two times [s], evenly but for its ends."""

    way: float
    start: float = 0.5
    stop: float = 4.5

    ramp = 0.25

    @property
    def speed(self) -> float:
        """In between [m/s or rad/s]."""
        return self.way / (self.stop - self.start - self.ramp)

    @property
    def course(self) -> tuple[tuple[float, float], ...]:
        """As a `Motor` has it."""
        even = self.start + self.ramp, self.stop - self.ramp
        return (self.start, 0.0), (even[0], self.speed), (even[1], self.speed), (self.stop, 0.0)

    def place(self, t: ArrayLike) -> Array:
        """How far it has got [m or rad]."""

        def ramped(s: Array) -> Array:
            return np.asarray(np.clip(s, 0, self.ramp) ** 2 / (2 * self.ramp) + np.maximum(s - self.ramp, 0))

        when = np.asarray(t, float)
        return self.speed * (ramped(when - self.start) - ramped(when - self.stop + self.ramp))


def reflected(way: ArrayLike, normal: ArrayLike) -> Array:
    """Directions (..., 3) after a mirror, d - 2 (d·n) n; normal: unit vectors (..., 3)."""
    d, n = np.asarray(way, float), np.asarray(normal, float)
    return np.asarray(d - 2 * np.sum(d * n, axis=-1, keepdims=True) * n)


def on_plane(start: ArrayLike, way: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Array:
    """Where rays (..., 3) from points along unit vectors meet the plane through a point with a normal [m].

    r + d (p - r)·n/(d·n)
    """
    r, d, p, n = (np.asarray(x, float) for x in (start, way, point, normal))
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along the plane meets it nowhere
        far = np.sum((p - r) * n, axis=-1, keepdims=True) / np.sum(d * n, axis=-1, keepdims=True)
        return np.asarray(r + far * d)


def enter(start: Array, way: Array, normals: Array, offsets: Array) -> tuple[Array, NDArray[np.int64]]:
    """Distances (T,) [m] at which rays (T, 3) enter a convex body n·r <= offset, infinite if not; by which plane."""
    height, slope = offsets - start @ normals.T, way @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = height / slope
    going_in = np.where(slope < 0, far, np.where((slope == 0) & (height < 0), np.inf, -np.inf))
    going_out = np.where(slope > 0, far, np.inf).min(axis=1)
    plane = going_in.argmax(axis=1)
    distance = going_in.max(axis=1)
    return np.where((distance < going_out) & (distance > 0), distance, np.inf), plane


def silvered_faces(run: Run, body: str) -> tuple[Array, Array]:
    """Middle (T, 3) [m] and normal (T, 3) of the silvered face of a standing mirror, from its recorded pose."""
    normal = quaternion_matrix(run.quaternion(body))[:, :, 0]
    return run.position(body) + GLASS * normal, normal


def met(run: Run, rays: optics.Rays) -> NDArray[np.int64]:
    """Numbers of the bodies (T, K) at the ends of a beam's pieces: 0 the world's, -1 none, NO_RAY after its end."""
    return np.where(rays.geoms < 0, rays.geoms, run.model.geom_bodyid[rays.geoms])


def first_corners(rays: optics.Rays, count: int) -> tuple[Array, NDArray[np.int32]]:
    """The first corners (T, count + 1, 3) of a beam [m], NaN beyond its end, and the geoms (T, count) it meets there,
    NO_RAY beyond its end; however many there are."""
    have = min(rays.geoms.shape[1], count)
    points = np.full((len(rays.points), count + 1, 3), np.nan)
    geoms = np.full((len(rays.points), count), NO_RAY, np.int32)
    points[:, : have + 1], geoms[:, :have] = rays.points[:, : have + 1], rays.geoms[:, :have]
    return points, geoms


def path(rays: optics.Rays) -> Array:
    """Corners (T, K, 3) of a beam [m]; its end again where it has fewer."""
    points = rays.points.copy()
    for k in range(1, points.shape[1]):
        ended = np.isnan(points[:, k, 0])
        points[ended, k] = points[ended, k - 1]
    return points


def pieces(rays: optics.Rays) -> Array:
    """How many straight pieces a beam has (T,)."""
    return np.asarray((rays.geoms != NO_RAY).sum(axis=1), float)


def probe(run: Run, sample: int, start: ArrayLike, way: ArrayLike, *, bounces: int = 40) -> Ray:
    """Another ray in the run's scene as it is at a sample, from a point (3,) [m] along a unit vector (3,)."""
    data = mujoco.MjData(run.model)
    data.qpos[:] = run.qpos[sample]
    mujoco.mj_kinematics(run.model, data)
    return optics.Optics(run.model, run.scene).follow(data, start, np.asarray(way, float), reach=10.0, bounces=bounces)
