"""The geoms of a MuJoCo model as triangles with normals and texture coordinates; pure numpy.

A sphere, an ellipsoid, a capsule and a cylinder are faceted so finely that their outline is off by less than a
thousandth of their radius, and carry the normals of the surface itself, not those of the facets.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

SLICES: Final = 96
"""Facets round a turn: the outline is off by 1 - cos(π/96), 5e-4 of the radius."""

WIRE_SLICES: Final = 16
"""Round a wire, a rope or a beam, which is thin."""

PATCH: Final = 24
"""Squares along an edge of each of the six patches of a sphere."""

_CUBE: Final = (
    # of each side of a cube map: axis, its sign, and the (axis, sign) of the texture's s and t
    (0, 1, (2, -1), (1, -1)), (0, -1, (2, 1), (1, -1)), (1, 1, (0, 1), (2, 1)),
    (1, -1, (0, 1), (2, -1)), (2, 1, (0, 1), (1, -1)), (2, -1, (0, -1), (1, -1)),
)  # fmt: skip
"""OpenGL's order and orientation (OpenGL 4.6, core profile, table 8.19)."""


@dataclass(frozen=True)
class Mesh:
    """Points (N, 3) [m], triangles (M, 3) of their numbers, outward normals (N, 3), texture coordinates (N, 2) or None.
    """

    points: Array
    triangles: NDArray[np.int64]
    normals: Array
    uv: Array | None = None

    def placed(self, position: ArrayLike, turn: ArrayLike) -> Mesh:
        """Moved rigidly: the matrix (3, 3) first, then the shift (3,) [m]."""
        matrix = np.asarray(turn, float).reshape(3, 3)
        points = self.points @ matrix.T + np.asarray(position, float)
        return replace(self, points=points, normals=self.normals @ matrix.T)

    def only(self, chosen: NDArray[np.bool_]) -> Mesh:
        """Its triangles for which `chosen` (M,) holds."""
        return replace(self, triangles=self.triangles[chosen])

    def apart(self) -> Mesh:
        """The same triangles without common points."""
        corners = self.triangles.ravel()
        return Mesh(
            self.points[corners], np.arange(len(corners)).reshape(-1, 3), self.normals[corners],
            None if self.uv is None else self.uv[corners],
        )  # fmt: skip

    def faces(self) -> tuple[Array, Array]:
        """Centre (M, 3) [m] and unit normal (M, 3) of every triangle; of one without area, a normal of 0."""
        corners = self.points[self.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return corners.mean(axis=1), across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)


def together(meshes: list[Mesh]) -> Mesh:
    """Several meshes, none of them textured, as one."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate([mesh.normals for mesh in meshes]),
    )


def of_geom(model: Any, geom: int) -> Mesh:
    """A geom in its own axes, textured if its material is; ValueError for height fields and signed distances."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            mesh = ellipsoid(np.full(3, size[0]))
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            mesh = ellipsoid(size)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            mesh = capsule(size[0], size[1])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            mesh = cylinder(size[0], size[1])
        case mujoco.mjtGeom.mjGEOM_BOX:
            mesh = box(size)
        case mujoco.mjtGeom.mjGEOM_PLANE:
            x, y = size[:2]
            points = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], float)
            mesh = Mesh(points, np.array([(0, 1, 2), (0, 2, 3)]), np.tile((0.0, 0.0, 1.0), (4, 1)))
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = _of_mesh(model, int(model.geom_dataid[geom]))
        case _:
            raise ValueError(f"geom {model.geom(geom).name!r} is a {kind.name}, which cannot be drawn as triangles")
    return _textured(model, geom, mesh)


def ellipsoid(size: ArrayLike) -> Mesh:
    """An ellipsoid with half axes (3,) [m], in six patches as a cube blown up."""
    grid = np.tan(np.linspace(-math.pi / 4, math.pi / 4, PATCH + 1))
    i, j = (part.ravel() for part in np.meshgrid(np.arange(PATCH), np.arange(PATCH), indexing="ij"))
    low, right, up, both = (a * (PATCH + 1) + b for a, b in ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)))
    squares = np.concatenate([np.stack([low, right, both], 1), np.stack([low, both, up], 1)])
    points: list[Array] = []
    triangles = []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        side = np.empty((PATCH + 1, PATCH + 1, 3))
        side[..., axis] = sign
        side[..., (axis + 1) % 3], side[..., (axis + 2) % 3] = grid[:, None], grid[None, :]
        triangles.append((squares if sign > 0 else squares[:, ::-1]) + len(points) * (PATCH + 1) ** 2)
        points.append(side.reshape(-1, 3))
    unit = np.concatenate(points)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    normals = unit / np.asarray(size)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(unit * np.asarray(size), np.concatenate(triangles), normals)


def capsule(radius: float, half: float, slices: int = SLICES) -> Mesh:
    """Along z, its cylindrical part from -half to half [m]."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, slices // 2 + 2 - slices // 2 % 2)
    outline = np.stack([np.cos(angles), np.sin(angles)], 1)
    ends = np.where(angles < 0, -half, half)
    middle = len(angles) // 2  # the equator is there twice, at either end of the cylindrical part
    around = np.insert(radius * outline + np.stack([0 * ends, ends], 1), middle, (radius, -half), axis=0)
    return revolved(around, np.insert(outline, middle, (1.0, 0.0), axis=0), slices)


def cylinder(radius: float, half: float) -> Mesh:
    """Along z, from -half to half [m]."""
    outline = np.array([(0, -half), (radius, -half), (radius, -half), (radius, half), (radius, half), (0, half)], float)
    return revolved(outline, np.array([(0, -1), (0, -1), (1, 0), (1, 0), (0, 1), (0, 1)], float), SLICES)


def box(size: ArrayLike) -> Mesh:
    """A box with half edges (3,) [m]."""
    points, normals = [], []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))[::sign]:
            corner = np.empty(3)
            corner[[axis, (axis + 1) % 3, (axis + 2) % 3]] = sign, a, b
            points.append(corner * np.asarray(size))
            normals.append(sign * np.eye(3)[axis])
    triangles = np.array([(4 * k, 4 * k + i, 4 * k + i + 1) for k in range(6) for i in (1, 2)])
    return Mesh(np.array(points), triangles, np.array(normals))


def revolved(outline: Array, normals: Array, slices: int) -> Mesh:
    """What an outline (K, 2) [m], distance from the z axis and height, sweeps out; with its normals (K, 2).

    The outline runs upwards on the right, so that its outside is on its right.
    """
    angles = np.linspace(0, 2 * math.pi, slices, endpoint=False)
    way = np.stack([np.cos(angles), np.sin(angles)], 1)

    def swept(flat: Array) -> Array:
        wide = flat[:, None, :1] * way[None]
        return np.concatenate([wide, np.broadcast_to(flat[:, None, 1:], (len(flat), slices, 1))], 2).reshape(-1, 3)

    k, s = (part.ravel() for part in np.meshgrid(np.arange(len(outline) - 1), np.arange(slices), indexing="ij"))
    here, there = k * slices + s, k * slices + (s + 1) % slices
    lower, upper = np.stack([here, there, there + slices], 1), np.stack([here, there + slices, here + slices], 1)
    # a ring of radius 0 makes one of the two flat
    triangles = np.concatenate([lower[outline[k, 0] > 0], upper[outline[k + 1, 0] > 0]])
    return Mesh(swept(outline), triangles, swept(normals))


def ring(inner: float, outer: float, middle: Array) -> Mesh:
    """A flat ring between two radii [m] round a point (2,) [m], facing z; the first half of its points is inside."""
    angles = np.linspace(0, 2 * math.pi, SLICES, endpoint=False)
    way = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    points = np.concatenate([inner * way, outer * way])
    points[:, :2] += middle
    k, after = np.arange(SLICES), (np.arange(SLICES) + 1) % SLICES
    triangles = [np.stack([k, k + SLICES, after + SLICES], 1)]
    triangles += [np.stack([k, after + SLICES, after], 1)] if inner > 0 else []
    return Mesh(points, np.concatenate(triangles), np.tile((0.0, 0.0, 1.0), (len(points), 1)))


def tube(path: Array, radius: float) -> Mesh:
    """A wire round a path (N, 3) [m], N > 1, with round ends and corners."""
    pieces = []
    for start, end in itertools.pairwise(path):
        span = end - start
        length = float(np.linalg.norm(span))
        along = span / length if length > 0 else np.array([0.0, 0.0, 1.0])
        side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        side /= np.linalg.norm(side)
        turn = np.stack([side, np.cross(along, side), along], 1)
        pieces.append(capsule(radius, length / 2, WIRE_SLICES).placed((start + end) / 2, turn))
    return together(pieces)


def outline(mesh: Mesh, way: Array) -> Mesh:
    """The convex outline of a mesh as seen along a unit vector (3,), as a flat patch before it that faces that way."""
    points = mesh.points[np.unique(mesh.triangles)]
    side = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(way, side)], 1)
    flat = points @ axes
    rim = flat[ConvexHull(flat).vertices]  # counter-clockwise
    before = (points @ way).min() - 1e-3 * float(np.ptp(flat, axis=0).max())
    corners = rim @ axes.T + before * way
    fan = np.array([(0, k, k + 1) for k in range(1, len(corners) - 1)])
    return Mesh(corners, fan, np.tile(way, (len(corners), 1)))


def _of_mesh(model: Any, number: int) -> Mesh:
    def rows(name: str, kind: str) -> NDArray[Any]:
        start, count = getattr(model, f"mesh_{kind}adr")[number], getattr(model, f"mesh_{kind}num")[number]
        return np.asarray(getattr(model, f"mesh_{name}")[start : start + count])

    corners, facing = rows("face", "face").ravel(), rows("facenormal", "face").ravel()
    points = rows("vert", "vert").astype(float)[corners]
    normals = rows("normal", "normal").astype(float)[facing]
    uv = None
    if model.mesh_texcoordnum[number]:
        uv = rows("texcoord", "texcoord").astype(float)[rows("facetexcoord", "face").ravel()]
    return Mesh(points, np.arange(len(corners)).reshape(-1, 3), normals, uv)


def texture_of(model: Any, geom: int) -> int:
    """Number of the texture that a geom's material shows, or -1."""
    material = int(model.geom_matid[geom])
    return -1 if material < 0 else int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB.value])


def _textured(model: Any, geom: int, mesh: Mesh) -> Mesh:
    """With the texture coordinates that MuJoCo gives a geom; (0, 0) is the first texel of the texture's data.

    A cube map is looked up from the middle, in the geom's own proportions unless `texuniform`; a flat texture lies on a
    plane as it is, on each side of a box from its upper left seen from outside, round a cylinder in rings, and on all
    else as seen from above.
    """
    texture = texture_of(model, geom)
    if texture < 0:
        return mesh
    material, kind = int(model.geom_matid[geom]), int(model.geom_type[geom])
    size = np.maximum(_half_sizes(model, geom), 1e-9)
    uniform = bool(model.mat_texuniform[material])
    if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_CUBE.value:
        return _on_cube(mesh.apart(), np.ones(3) if uniform else size, int(model.tex_width[texture]))
    if mesh.uv is not None:
        return replace(mesh, uv=mesh.uv * model.mat_texrepeat[material])
    mesh = mesh.apart()
    facing = np.round(mesh.faces()[1], 6)
    axis = np.repeat(np.argmax(np.abs(facing), axis=1), 3)
    first, second = np.zeros(len(axis), int), np.ones(len(axis), int)
    ways = np.ones(len(axis)), np.ones(len(axis))
    if kind == mujoco.mjtGeom.mjGEOM_BOX.value:
        first, second = np.where(axis == 0, 1, 0), np.where(axis == 2, 1, 2)
        outward = np.repeat(np.sign(facing).sum(axis=1), 3)
        ways = np.where(axis == 0, outward, np.where(axis == 1, -outward, 1)), np.where(axis == 2, -outward, -1)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER.value:
        second = np.where(axis == 2, 1, 2)
    repeat = model.mat_texrepeat[material]
    flat = []
    for along, way, times in zip((first, second), ways, repeat, strict=True):
        place, half = way * np.take_along_axis(mesh.points, along[:, None], 1)[:, 0], size[along]
        flat.append((place + half) * times / 2 if uniform else (place + half) / (2 * half) * times)
    return replace(mesh, uv=np.stack(flat, 1))


def _half_sizes(model: Any, geom: int) -> Array:
    """Half the edges of the box round a geom (3,) [m], in its own axes."""
    return np.asarray(model.geom_aabb[geom, 3:], float)


def _on_cube(mesh: Mesh, scale: Array, width: int) -> Mesh:
    """Coordinates in the six sides of a cube map, one below the other."""
    middle = mesh.faces()[0] / scale
    axis = np.argmax(np.abs(middle), axis=1)
    side = 2 * axis + (np.take_along_axis(middle, axis[:, None], 1)[:, 0] < 0)
    uv = np.empty((len(mesh.points), 2))
    for number, (along, _, across, down) in enumerate(_CUBE):
        here = np.repeat(side == number, 3)
        points = mesh.points[here] / scale
        far = np.maximum(np.abs(points[:, along]), 1e-9)
        st = [(sign * points[:, k] / far + 1) / 2 for k, sign in (across, down)]
        s, t = np.clip(st, 0.5 / width, 1 - 0.5 / width)
        uv[here] = np.stack([s, (number + t) / 6], 1)
    return replace(mesh, uv=uv)
