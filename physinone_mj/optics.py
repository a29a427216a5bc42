"""Light as rays: straight on to what they first meet, thrown back where that is a mirror.

d' = d - 2 (d·n) n, n the mirror's normal at its pose of the same instant (Euclid, Catoptrics, prop. 1; M. Born & E.
Wolf, Principles of Optics, §3.2.2). What is met first is MuJoCo's answer (`mj_ray`); where exactly, on a plane mirror,
and in which direction on from there follow from the plane itself in double precision: the vertices of a mesh are only
known to seven digits.

Defects: no refraction, no colour, no diffraction; a beam has no width but that it is drawn with; light never acts on
what it meets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .run import Run
from .scene import IMMATERIAL, Beam, Mirror, Scene

Array = NDArray[np.float64]

CLEAR: Final = 1e-6
"""A reflected ray starts this far from the mirror, lest it meet the same face again [m]."""

NOTHING: Final = -1
"""In place of a geom: the beam met none within its reach."""
NO_RAY: Final = -2
"""In place of a geom: the beam had ended before."""

_HIDDEN: Final = 3
_FACING: Final = 0.999
"""Cosine between the normal of the face that was met and that of the mirror, above which they are the same face."""


@dataclass(frozen=True)
class Ray:
    """A beam at one instant.

    points: (n + 1, 3) [m], where it starts, where it is reflected, where it ends
    geoms: (n,) what it met at the end of each piece, the last one not a mirror: numbers of geoms, or NOTHING
    truncated: cut off after its greatest number of reflections
    """

    points: Array
    geoms: NDArray[np.int32]
    truncated: bool


@dataclass(frozen=True)
class Rays:
    """A beam over time; shapes (T, K + 1, 3), NaN beyond its end, (T, K), NO_RAY beyond its end, and (T,)."""

    points: Array
    geoms: NDArray[np.int32]
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


class Optics:
    """The mirrors of one compiled model. KeyError names a geom that is missing."""

    def __init__(self, model: Any, mirrors: list[Mirror]) -> None:
        self._model = model
        self._faces: dict[int, list[tuple[Array, Array] | None]] = {}
        for mirror in mirrors:
            plane = mirror.point is not None and (np.array(mirror.point), np.array(mirror.normal))
            self._faces.setdefault(int(model.geom(mirror.geom).id), []).append(plane or None)
        self._groups = np.ones(6, np.uint8)
        self._groups[[_HIDDEN, IMMATERIAL]] = 0

    def follow(
        self, data: Any, start: ArrayLike, direction: ArrayLike, *, reach: float, bounces: int, body: int = -1
    ) -> Ray:
        """A ray at the data's pose (kinematics done) from a point along a unit vector; `body` is one it starts in."""
        points, geoms = [np.array(start, float)], []
        way = np.array(direction, float)
        met, normal = np.zeros(1, np.int32), np.zeros(3)
        left, clear = reach, 0.0
        while True:
            origin = points[-1] + clear * way
            far = mujoco.mj_ray(self._model, data, origin, way, self._groups, True, body, met, normal) + clear
            geom = int(met[0])
            if geom < 0 or far > left:
                points.append(points[-1] + left * way)
                geoms.append(NOTHING)
                return Ray(np.array(points), np.array(geoms, np.int32), False)
            exact, normal_there = self._mirror(data, geom, points[-1], way, normal)
            points.append(points[-1] + (far if exact is None else exact) * way)
            geoms.append(geom)
            if normal_there is None:
                return Ray(np.array(points), np.array(geoms, np.int32), False)
            if len(geoms) > bounces:
                return Ray(np.array(points), np.array(geoms, np.int32), True)
            left -= float(np.linalg.norm(points[-1] - points[-2]))
            way = way - 2 * (way @ normal_there) * normal_there
            way /= np.linalg.norm(way)
            body, clear = -1, CLEAR

    def _mirror(
        self, data: Any, geom: int, start: Array, way: Array, normal: Array
    ) -> tuple[float | None, Array | None]:
        """(distance, normal) of the mirror that was met; None for the distance if MuJoCo's is exact, for the normal
        if what was met is no mirror."""
        body = self._model.geom_bodyid[geom]
        for plane in self._faces.get(geom, ()):
            if plane is None:
                return None, normal.copy()
            turn = data.xmat[body].reshape(3, 3)
            outward = turn @ plane[1]
            if outward @ normal > _FACING and outward @ way < 0:
                point = data.xpos[body] + turn @ plane[0]
                return float((point - start) @ outward / (way @ outward)), outward
        return None, None


def trace(run: Run, name: str) -> Rays:
    """A beam of the run's scene at every sample, from the poses recorded there; KeyError if there is no such beam."""
    beam = {beam.name: beam for beam in run.scene.beams}.get(name)
    if beam is None:
        raise KeyError(f"no beam {name!r}; there are: {', '.join(beam.name for beam in run.scene.beams)}")
    return follow(run.model, run.scene, beam, run.qpos)


def follow(model: Any, scene: Scene, beam: Beam, qpos: Array) -> Rays:
    """A beam of a scene at every one of some poses (T, nq)."""
    optics, data, site = Optics(model, scene.mirrors), mujoco.MjData(model), model.site(beam.site).id
    found = []
    for pose in qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        way = data.site_xmat[site].reshape(3, 3)[:, 2]
        found.append(
            optics.follow(data, data.site_xpos[site], way, reach=beam.reach, bounces=beam.bounces,
                          body=int(model.site_bodyid[site]) or -1)
        )  # fmt: skip
    most = max(len(ray.geoms) for ray in found)
    points, geoms = np.full((len(found), most + 1, 3), np.nan), np.full((len(found), most), NO_RAY, np.int32)
    for i, ray in enumerate(found):
        points[i, : len(ray.points)], geoms[i, : len(ray.geoms)] = ray.points, ray.geoms
    return Rays(points, geoms, np.array([ray.truncated for ray in found]))
