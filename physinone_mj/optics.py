"""Light as rays: straight on to what they first meet, thrown back by mirrors, bent by what is transparent.

    mirror       d' = d - 2 (d·n) n                                        (Euclid, Catoptrics, prop. 1)
    dielectric   n₁ sin θ₁ = n₂ sin θ₂, d' = η d + (η cos θ₁ - cos θ₂) n, η = n₁/n₂; all is thrown back where
                 η sin θ₁ > 1; of unpolarised light, R = (r_s² + r_p²)/2 is thrown back at either side
                                                  (M. Born & E. Wolf, Principles of Optics, §1.5.2 eq. 8 and 21, §1.5.4)

n is the surface's normal at its pose of the same instant. What is met first, and where, is MuJoCo's answer (`mj_ray`)
for spheres, ellipsoids, boxes, cylinders and capsules, which it solves in double precision from outside and from
inside; a plane mirror on a mesh, whose vertices are only known to seven digits, is met where its plane is; and the
curved mirrors that MuJoCo has no shape for are solved here.

A beam is one path: through a dielectric it follows the light that passes, as long as any does, and `weights` tells how
much of it is left. Defects: what is thrown back at a dielectric is not followed; no absorption, colour, polarisation or
diffraction; a beam has no width but that it is drawn with, and mirrors lose nothing; light never acts on what it meets.
Dielectrics may lie one inside the other, but must not share a face or overlap; the air's index is 1.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from .run import Run
from .scene import IMMATERIAL, OPTICAL, Beam, Conic, Scene

Array = NDArray[np.float64]

CLEAR: Final = 1e-6
"""A ray goes on this far from where it was thrown back or bent, lest it meet the same face again [m]."""

NOTHING: Final = -1
"""In place of a geom: the beam met none within its reach."""
NO_RAY: Final = -2
"""In place of a geom: the beam had ended before."""

_HIDDEN: Final = 3
_FACING: Final = 0.999
"""Cosine between the normal of the face that was met and that of the mirror, above which they are the same face."""

_BRIEF: Final = 2.0**-40
"""Fraction of a sample to which the instant of a change is found."""

_SOLVED: Final = {
    int(kind)
    for kind in (
        mujoco.mjtGeom.mjGEOM_SPHERE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
    )
}
"""Shapes that MuJoCo meets with rays to the last digits."""


@dataclass(frozen=True)
class Ray:
    """A beam at one instant.

    points: (n + 1, 3) [m], where it starts, where it is reflected or refracted, where it ends
    geoms: (n,) what it met at the end of each piece: numbers of geoms, or NOTHING
    weights: (n,) fraction of its power that each piece carries
    truncated: cut off after its greatest number of reflections and refractions
    """

    points: Array
    geoms: NDArray[np.int32]
    weights: Array
    truncated: bool


@dataclass(frozen=True)
class Rays:
    """A beam over time; shapes (T, K + 1, 3), NaN beyond its end, (T, K), NO_RAY beyond its end, (T, K), 0 beyond its
    end, and (T,)."""

    points: Array
    geoms: NDArray[np.int32]
    weights: Array
    truncated: NDArray[np.bool_]

    @property
    def ends(self) -> Array:
        """Where the beam ends (T, 3) [m]."""
        last = np.isfinite(self.points[:, :, 0]).sum(axis=1) - 1
        return np.asarray(self.points[np.arange(len(last)), last])

    def directions(self, piece: int) -> Array:
        """Unit vector (T, 3) of a piece of the beam, 0 being the first; NaN where it has no such piece."""
        if piece >= self.points.shape[1] - 1:
            return np.full((len(self.points), 3), np.nan)
        along = self.points[:, piece + 1] - self.points[:, piece]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


@dataclass(frozen=True)
class Change:
    """A beam begins to meet other things, in another order: when [s], and the geoms before and after."""

    time: float
    before: tuple[int, ...]
    after: tuple[int, ...]


@njit(cache=True)
def _meet_conic(shape: Array, place: Array, turn: Array, start: Array, way: Array, normal: Array) -> float:
    """Distance at which a ray meets a conic mirror, infinite if not; the normal there, towards its silvered side.

    F = c (x² + y² + (1 + K) z²) - 2 z = 0 in the mirror's axes, without y² for a trough; of its two sheets the one
    through the vertex, 1 - c (1 + K) z > 0. shape: c, K, aperture, greatest |y|, 1 of revolution or 0 a trough
    """
    c, flat, aperture, half, round_ = shape[0], 1.0 + shape[1], shape[2], shape[3], shape[4]
    p, d = np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            p[i] += turn[3 * j + i] * (start[j] - place[j])
            d[i] += turn[3 * j + i] * way[j]
    square = c * (d[0] ** 2 + round_ * d[1] ** 2 + flat * d[2] ** 2)
    cross = c * (p[0] * d[0] + round_ * p[1] * d[1] + flat * p[2] * d[2]) - d[2]
    rest = c * (p[0] ** 2 + round_ * p[1] ** 2 + flat * p[2] ** 2) - 2.0 * p[2]
    under = cross * cross - square * rest
    if under < 0.0:
        return np.inf
    sum_ = -cross - np.sqrt(under) if cross > 0.0 else -cross + np.sqrt(under)
    found = np.inf
    for root in range(2):
        over, below = (sum_, square) if root == 0 else (rest, sum_)
        if below == 0.0:
            continue
        far = over / below
        if not 0.0 < far < found:
            continue
        x, y, z = p[0] + far * d[0], p[1] + far * d[1], p[2] + far * d[2]
        inside = x * x + round_ * y * y <= aperture * aperture and abs(y) <= half
        upright = 1.0 - c * flat * z
        if inside and upright > 0.0:
            found = far
            n0, n1 = -c * x, -c * round_ * y
            size = np.sqrt(n0 * n0 + n1 * n1 + upright * upright)
            for i in range(3):
                normal[i] = (turn[3 * i] * n0 + turn[3 * i + 1] * n1 + turn[3 * i + 2] * upright) / size
    return found


@njit(cache=True)
def refract(way: Array, normal: Array, ratio: float) -> tuple[Array, float]:
    """Direction (3,) after a surface, and the fraction of unpolarised light's power thrown back there.

    way, normal: unit vectors, normal against the way; ratio: n₁/n₂. Total reflection: the reflected way, and 1.
    Source: M. Born & E. Wolf, Principles of Optics, §1.5.2 eq. 8 (Snell), 21 (Fresnel).
    """
    cosine = -np.sum(way * normal)
    under = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    if under < 0.0:
        return way + 2.0 * cosine * normal, 1.0
    after = np.sqrt(under)
    across = (ratio * cosine - after) / (ratio * cosine + after)
    along = (cosine - ratio * after) / (cosine + ratio * after)
    return ratio * way + (ratio * cosine - after) * normal, (across**2 + along**2) / 2.0


class Optics:
    """The mirrors and the transparent things of one compiled model.

    KeyError names a geom or site that is missing; ValueError a dielectric of a shape that rays do not meet exactly.
    """

    def __init__(self, model: Any, scene: Scene) -> None:
        self._model = model
        self._faces: dict[int, list[tuple[Array, Array] | None]] = {}
        self._conics: list[tuple[int, int, Array]] = []
        self._index: dict[int, float] = {}
        for mirror in scene.mirrors:
            geom = int(model.geom(mirror.geom).id)
            if isinstance(mirror, Conic):
                half, whole = mirror.half_length or mirror.strip, mirror.half_length == 0
                shape = (1 / mirror.radius, mirror.conic, mirror.aperture, half, float(whole))
                self._conics.append((geom, int(model.site(mirror.site).id), np.array(shape)))
            else:
                plane = mirror.point is not None and (np.array(mirror.point), np.array(mirror.normal))
                self._faces.setdefault(geom, []).append(plane or None)
        for dielectric in scene.dielectrics:
            geom = int(model.geom(dielectric.geom).id)
            if model.geom_type[geom] not in _SOLVED:
                kind = mujoco.mjtGeom(int(model.geom_type[geom])).name
                raise ValueError(f"dielectric {dielectric.geom!r} is a {kind}; allowed: sphere, ellipsoid, box, "
                                 f"cylinder, capsule")  # fmt: skip
            self._index[geom] = dielectric.index
        self._groups = np.ones(6, np.uint8)
        self._groups[[_HIDDEN, IMMATERIAL, OPTICAL]] = 0

    def follow(
        self, data: Any, start: ArrayLike, direction: ArrayLike, *, reach: float, bounces: int, body: int = -1
    ) -> Ray:
        """A ray at the data's pose (kinematics done) from a point along a unit vector; `body` is one it starts in."""
        points, weights, way = [np.array(start, float)], [1.0], np.array(direction, float)
        geoms: list[int] = []
        inside = self._around(data, points[0], way, body) if self._index else []
        left, clear = reach, 0.0
        while True:
            far, geom, normal = self._meet(data, points[-1], way, clear, body)
            while geoms and geom == geoms[-1] and geom in self._faces and normal @ way > 0:
                # out through the face that threw it back: of a mesh, it lies a rounding error above its plane
                far, geom, normal = self._meet(data, points[-1], way, far + CLEAR, body)
            if geom < 0 or far > left:
                return _ray([*points, points[-1] + left * way], [*geoms, NOTHING], weights, False)
            exact, mirror = self._mirror(data, geom, points[-1], way, normal)
            far = far if exact is None else exact
            points.append(points[-1] + far * way)
            geoms.append(geom)
            if mirror is None and geom not in self._index:
                return _ray(points, geoms, weights, False)
            if len(geoms) > bounces:
                return _ray(points, geoms, weights, True)
            left -= far
            if mirror is not None:
                way = way - 2 * (way @ mirror) * mirror
                weights.append(weights[-1])
            else:
                way, back = self._bend(geom, way, normal, inside)
                weights.append(weights[-1] * (1 - back if back < 1 else 1.0))
            way /= np.linalg.norm(way)
            body, clear = -1, CLEAR

    def begins_inside(self, data: Any, start: ArrayLike, direction: ArrayLike, *, body: int = -1) -> int:
        """The geom that a ray starts inside of, if that is not transparent; else NOTHING."""
        _, geom, normal = self._meet(data, np.array(start, float), np.array(direction, float), 0.0, body)
        inside = geom >= 0 and geom not in self._index and float(normal @ np.asarray(direction)) > 0
        curved = any(geom == conic for conic, _, _ in self._conics)
        return geom if inside and not curved else NOTHING

    def _around(self, data: Any, start: Array, way: Array, body: int) -> list[int]:
        """The dielectrics that a point is inside of, outermost first: those that a ray from it leaves unentered."""
        entered: set[int] = set()
        left: list[int] = []
        clear = 0.0
        while True:
            far, geom, normal = self._meet(data, start, way, clear, body)
            if geom < 0:
                return left[::-1]
            if geom in self._index and geom not in entered:
                if normal @ way > 0:
                    left.append(geom)
                entered.add(geom)
            body, clear = -1, far + CLEAR

    def _meet(self, data: Any, start: Array, way: Array, clear: float, body: int) -> tuple[float, int, Array]:
        """(distance, geom or a negative number, outward normal there) of what is nearest beyond `clear`."""
        met, normal = np.zeros(1, np.int32), np.zeros(3)
        origin = start + clear * way
        far = mujoco.mj_ray(self._model, data, origin, way, self._groups, True, body, met, normal)
        geom = int(met[0])
        nearest = far if geom >= 0 else math.inf
        for number, site, shape in self._conics:
            facing = np.zeros(3)
            curved = _meet_conic(shape, data.site_xpos[site], data.site_xmat[site], origin, way, facing)
            if curved < nearest:
                nearest, geom, normal = curved, number, facing
        return nearest + clear, geom, normal

    def _mirror(
        self, data: Any, geom: int, start: Array, way: Array, normal: Array
    ) -> tuple[float | None, Array | None]:
        """(distance, normal) of the mirror that was met; None for the distance if that to the geom is exact, for the
        normal if what was met is no mirror."""
        for number, _, _ in self._conics:
            if number == geom:
                return None, normal if normal @ way < 0 else None
        body = self._model.geom_bodyid[geom]
        for plane in self._faces.get(geom, ()):
            if plane is None:
                return None, normal if normal @ way < 0 else None
            turn = data.xmat[body].reshape(3, 3)
            outward = turn @ plane[1]
            if outward @ normal > _FACING and outward @ way < 0:
                point = data.xpos[body] + turn @ plane[0]
                return float((point - start) @ outward / (way @ outward)), outward
        return None, None

    def _bend(self, geom: int, way: Array, normal: Array, inside: list[int]) -> tuple[Array, float]:
        """Direction and fraction thrown back at a dielectric's surface; `inside` becomes what the ray is then in."""
        entering = bool(normal @ way < 0)
        around = [other for other in inside if other != geom]
        outer = self._index[around[-1]] if around else 1.0
        before, after = (outer, self._index[geom]) if entering else (self._index[geom], outer)
        bent, back = refract(way, normal if entering else -normal, before / after)
        if back < 1.0:
            inside[:] = [*around, geom] if entering else around
        return bent, back


def _ray(points: list[Array], geoms: list[int], weights: list[float], truncated: bool) -> Ray:
    return Ray(np.array(points), np.array(geoms, np.int32), np.array(weights), truncated)


def trace(run: Run, name: str) -> Rays:
    """A beam of the run's scene at every sample, from the poses recorded there; KeyError if there is no such beam."""
    if name not in run.traced:
        run.traced[name] = follow(run.model, run.scene, _beam(run, name), run.qpos)
    return run.traced[name]  # type: ignore[no-any-return]


def follow(model: Any, scene: Scene, beam: Beam, qpos: Array) -> Rays:
    """A beam of a scene at every one of some poses (T, nq)."""
    trace_at = _tracer(model, scene, beam)
    found = [trace_at(pose) for pose in qpos]
    most = max(len(ray.geoms) for ray in found)
    points, geoms = np.full((len(found), most + 1, 3), np.nan), np.full((len(found), most), NO_RAY, np.int32)
    weights = np.zeros((len(found), most))
    for i, ray in enumerate(found):
        n = len(ray.geoms)
        points[i, : n + 1], geoms[i, :n], weights[i, :n] = ray.points, ray.geoms, ray.weights
    return Rays(points, geoms, weights, np.array([ray.truncated for ray in found]))


def changes(run: Run, name: str) -> list[Change]:
    """When, between samples, a beam begins to meet other things or in another order, soonest first.

    Between two samples the pose is that of the cubic through both positions and velocities; what begins and ends
    between the same two samples is not seen, and an impact between them bends the cubic. KeyError as of `trace`.
    """
    trace_at = _tracer(run.model, run.scene, _beam(run, name))

    def meets(pose: Callable[[float], Array], part: float) -> tuple[int, ...]:
        return tuple(trace_at(pose(part)).geoms.tolist())

    seen = [tuple(row[row != NO_RAY].tolist()) for row in trace(run, name).geoms]
    found = []
    for i in np.flatnonzero([a != b for a, b in itertools.pairwise(seen)]):
        within = functools.partial(meets, _between(run, int(i)))
        for part, before, after in _split(within, 0.0, 1.0, seen[i], seen[i + 1]):
            found.append(Change(float(run.t[i] + part * (run.t[i + 1] - run.t[i])), before, after))
    return found


def _split(
    seen: Callable[[float], tuple[int, ...]], low: float, high: float, first: tuple[int, ...], last: tuple[int, ...]
) -> Iterator[tuple[float, tuple[int, ...], tuple[int, ...]]]:
    """Where a function of a fraction changes its value, by halving: (fraction, value before, value after)."""
    if first == last:
        return
    if high - low < _BRIEF:
        yield (low + high) / 2, first, last
        return
    middle = (low + high) / 2
    half = seen(middle)
    yield from _split(seen, low, middle, first, half)
    yield from _split(seen, middle, high, half, last)


def _between(run: Run, i: int) -> Callable[[float], Array]:
    """The pose (nq,) at a fraction of the way from sample i to the next."""
    dt, model = float(run.t[i + 1] - run.t[i]), run.model
    whole = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, whole, 1.0, run.qpos[i], run.qpos[i + 1])
    start, end = dt * run.qvel[i], dt * run.qvel[i + 1]

    def pose(s: float) -> Array:
        shift = (3 - 2 * s) * s**2 * whole + s * (1 - s) * ((1 - s) * start - s * end)
        there: Array = run.qpos[i].copy()
        mujoco.mj_integratePos(model, there, shift, 1.0)
        return there

    return pose


def _beam(run: Run, name: str) -> Beam:
    beam = {beam.name: beam for beam in run.scene.beams}.get(name)
    if beam is None:
        raise KeyError(f"no beam {name!r}; there are: {', '.join(beam.name for beam in run.scene.beams)}")
    return beam


def _tracer(model: Any, scene: Scene, beam: Beam) -> Callable[[Array], Ray]:
    """A beam as a function of the pose (nq,)."""
    optics, data, site = Optics(model, scene), mujoco.MjData(model), model.site(beam.site).id
    body = int(model.site_bodyid[site]) or -1

    def trace_at(pose: Array) -> Ray:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        way = data.site_xmat[site].reshape(3, 3)[:, 2]
        return optics.follow(data, data.site_xpos[site], way, reach=beam.reach, bounces=beam.bounces, body=body)

    return trace_at


def blocked_mouths(model: Any, data: Any, scene: Scene) -> list[tuple[str, str]]:
    """Beams that start inside something opaque, and the geom that is; kinematics done."""
    optics, found = Optics(model, scene), []
    for beam in scene.beams:
        site = model.site(beam.site).id
        way = data.site_xmat[site].reshape(3, 3)[:, 2]
        geom = optics.begins_inside(data, data.site_xpos[site], way, body=int(model.site_bodyid[site]) or -1)
        if geom >= 0:
            found.append((beam.name, model.geom(geom).name))
    return found
