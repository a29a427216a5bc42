"""Solids that break: cut beforehand along Voronoi cells into chunks which bonds hold together.

A solid is cut by the planes half-way between seed points (G. Voronoi, J. reine angew. Math. 134 (1908) 198), so chunks
fill it exactly; where two of them meet is an interface, and a bond across it is as strong as its area. Chunks may be
cut again, any number of times: clusters that first come apart as wholes, then crumble.

All chunks are convex, since contact knows convex shapes only: a solid that is not, as a hollow vase, is first cut along
its inward edges, or given in convex parts. What collides is set back from each interface by half of `GAP`, so that
neighbours start apart; masses and interfaces are those of the chunks that fill the solid.

Defects: where it will break is decided before it is hit; cracks are plane; a bond is rigid until it goes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any, Final

import mujoco
import numpy as np
from manifold3d import Error, Manifold, Mesh64
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .contact import Surface
from .run import Run, quaternion_matrix
from .scene import Bond, Scene

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GAP: Final = 2e-5
"""Between the colliding shapes of two neighbours before anything breaks [m]."""

MOST_CHUNKS: Final = 200
MOST_FACES: Final = 20_000
MOST_PARTS: Final = 64
"""Convex parts of a solid that is not convex."""

_FLAT: Final = 1e-6
"""A solid whose convex hull is larger by less than this fraction is convex."""

_CANDIDATES: Final = 10
_SLIVER: Final = 1e-4
"""Interfaces smaller than this fraction of a chunk's face are not bonded."""


class Uncuttable(ValueError):
    """A solid, or an order to cut it, that cannot be carried out: one line says what is wrong and what is allowed."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A watertight solid: vertices (n, 3) [m] and triangles (m, 3), counter-clockwise seen from outside.

    Uncuttable if it is not closed, too large to cut, or has no volume.
    """

    vertices: Array
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        try:
            vertices, faces = np.array(self.vertices, np.float64), np.array(self.faces)
        except (TypeError, ValueError) as why:
            raise Uncuttable(f"a solid needs (n, 3) vertices and (m, 3) faces: {why}") from None
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1:] != (3,):
            raise Uncuttable(f"a solid of vertices {vertices.shape}, faces {faces.shape}; allowed: (n, 3), (m, 3)")
        if not 4 <= len(faces) <= MOST_FACES:
            raise Uncuttable(f"a solid of {len(faces)} faces; allowed: 4 to {MOST_FACES}")
        if not np.isfinite(vertices).all() or np.abs(vertices).max(initial=0) > 1e3:
            raise Uncuttable("a solid with vertices that are not finite or farther than 1000 m from the origin")
        if faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices):
            raise Uncuttable(f"a solid whose faces name vertices other than 0 to {len(vertices) - 1}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces.astype(np.int64))
        manifold = self.manifold
        fault = manifold.status()
        if fault != Error.NoError or manifold.is_empty():
            raise Uncuttable(f"a solid that is not watertight (manifold3d: {fault.name})")
        if not self.volume > 1e-9 * np.ptp(vertices, axis=0).max() ** 3:
            raise Uncuttable(f"a solid of volume {self.volume:.3g} m³; allowed: positive (are its faces inside out?)")

    @property
    def manifold(self) -> Any:
        """As manifold3d has it; made anew every time, since it complains of those that outlive the interpreter."""
        return Manifold(Mesh64(self.vertices, self.faces.astype(np.uint64)))

    @functools.cached_property
    def _moments(self) -> tuple[float, Array, Array]:
        return _moments(self.vertices, self.faces)

    @property
    def volume(self) -> float:
        """[m³]."""
        return self._moments[0]

    @property
    def centre(self) -> Array:
        """Centroid (3,) [m]."""
        return self._moments[1]

    @property
    def inertia(self) -> Array:
        """∫ (r² 1 - r rᵀ) dV about the centroid (3, 3) [m⁵]: the inertia of one kilogram per cubic metre."""
        return self._moments[2]

    def holds(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which of the points (n, 3) lie inside: those round which the surface winds once.

        A. van Oosterom & J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125, eq. 8 (the solid angle of a triangle).
        """
        a, b, c = (self.vertices[self.faces[:, k]] - np.asarray(points, float)[:, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        across = np.einsum("...i,...i", a, np.cross(b, c))
        along = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        return np.asarray(np.arctan2(across, along).sum(axis=-1) > math.pi)


@dataclass(frozen=True, eq=False)
class Chunk:
    """What does not break any more; convex. Coordinates are those of the whole solid.

    whole: the chunk as it fills the solid (mass, inertia); shape: set back from its neighbours (contact, pictures)
    path: the convex part that it comes from, then which cell it is of, at every depth of cutting
    """

    whole: Solid
    shape: Solid
    path: tuple[int, ...]


@dataclass(frozen=True)
class Interface:
    """Where two chunks meet.

    depth: at which cut they were parted: 0 between convex parts of the solid, 1 by the first count, and so on
    area [m²]; centre; normal: from the first to the second
    lever: section modulus / area [m]: a moment M strains the edge of the bond as much as a pull M/lever strains all of
        it (S. Timoshenko, Strength of Materials, part I, §23 eq. 57), about the axis in which it is weakest
    """

    first: int
    second: int
    depth: int
    area: float
    centre: Vector
    normal: Vector
    lever: float


@dataclass(frozen=True, eq=False)
class Fracture:
    """A solid in chunks; parts: the solid, in convex parts."""

    parts: tuple[Solid, ...]
    chunks: tuple[Chunk, ...]
    interfaces: tuple[Interface, ...]

    @property
    def volume(self) -> float:
        """Of the solid [m³]."""
        return math.fsum(part.volume for part in self.parts)


@functools.lru_cache(maxsize=64)
def box(x: float, y: float, z: float) -> Solid:
    """A block or plate of these half sides [m], its centre at the origin."""
    if not all(0 < side < math.inf for side in (x, y, z)):
        raise Uncuttable(f"a box of half sides {x}, {y}, {z} m; allowed: positive and finite")
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * (x, y, z)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Solid(corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]))


@functools.lru_cache(maxsize=64)
def revolved(sections: tuple[tuple[tuple[float, float], ...], ...], sides: int) -> tuple[Solid, ...]:
    """A vase in convex parts: sections of its wall, turned about the z axis in flat `sides`.

    Each section is a convex polygon of (radius, height) [m], counter-clockwise. One that touches the axis, as a bottom,
    becomes one part; another one becomes a stave on every side. Corners of the `sides`-gon lie on the circle.
    """
    if not 3 <= sides <= 64:
        raise Uncuttable(f"a vase of {sides} sides; allowed: 3 to 64")
    turns = 2 * math.pi * np.arange(sides + 1) / sides
    parts = []
    for section in sections:
        if len(section) < 3 or not np.isfinite(section).all() or min(radius for radius, _ in section) < 0:
            raise Uncuttable("a section of a vase needs 3 points or more, with radii of 0 or more")
        around = [(turns[:-1],)] if min(r for r, _ in section) == 0 else [(turns[k : k + 2],) for k in range(sides)]
        for (angles,) in around:
            corners = [(r * math.cos(a), r * math.sin(a), z) for r, z in section for a in angles]
            part = _solid(Manifold.hull_points(np.array(corners)))
            parts.append(part)
    _refuse_overlap(parts)
    return tuple(parts)


def convex_parts(solid: Solid) -> tuple[Solid, ...]:
    """A solid as convex ones, by cuts that halve its inward edges, deepest first; Uncuttable if it takes too many."""
    done, todo = [], list(solid.manifold.decompose())
    while todo:
        part = todo.pop()
        hull = part.hull()
        if hull.volume() - part.volume() < _FLAT * part.volume():
            done.append(_solid(part))
            continue
        for normal, offset in _inward(_solid(part)):
            halves = part.split_by_plane(tuple(normal), offset)
            if min(half.volume() for half in halves) > 1e-9 * part.volume():
                break
        else:
            raise Uncuttable("a solid that cannot be cut into convex parts")
        todo += [p for half in halves for p in half.decompose()]
        if len(done) + len(todo) > MOST_PARTS:
            raise Uncuttable(f"a solid of more than {MOST_PARTS} convex parts; allowed: a simpler one")
    return tuple(done)


@functools.lru_cache(maxsize=64)
def shatter(
    solid: Solid | tuple[Solid, ...],
    counts: tuple[int, ...],
    seed: int,
    *,
    focus: Vector | None = None,
    grain: Vector | None = None,
) -> Fracture:
    """Cut a solid into `counts[0]` chunks, each of them into `counts[1]`, and so on: the product of the counts.

    solid: if it comes in several parts, or has to be cut into them to be convex, the first count is shared among these
        in proportion to their volume, but each is at least one chunk.
    seed: of the random cells; focus: a point towards which cells become smaller, in proportion to the distance;
    grain: a direction along which all cuts run, as through the thickness of a plate.
    Uncuttable if that makes too many chunks, or the solid cannot be cut so.
    """
    if not counts or any(count < 1 for count in counts) or not 2 <= math.prod(counts) <= MOST_CHUNKS:
        raise Uncuttable(f"cutting into {' x '.join(map(str, counts))} chunks; allowed: 2 to {MOST_CHUNKS} in all")
    if seed < 0:
        raise Uncuttable(f"seed = {seed}; allowed: 0 or more")
    for name, vector in (("focus", focus), ("grain", grain)):
        if vector is not None and (len(vector) != 3 or not np.isfinite(vector).all()):
            raise Uncuttable(f"{name} = {vector}; allowed: three finite numbers")
    if grain is not None and not np.any(grain):
        raise Uncuttable(f"grain = {grain}; allowed: a direction")
    parts = solid if isinstance(solid, tuple) else convex_parts(solid)
    _refuse_overlap(parts)
    cells: list[tuple[tuple[int, ...], Any]] = [((k,), part.manifold) for k, part in enumerate(parts)]
    for depth, count in enumerate(counts):
        shares = _shares([part.volume for part in parts], count) if depth == 0 else [count] * len(cells)
        finer: list[tuple[tuple[int, ...], Any]] = []
        for (path, cell), share in zip(cells, shares, strict=True):
            points = _scatter(_solid(cell), share, np.random.default_rng([seed, *path]), focus, grain)
            finer += [((*path, k), _cell(cell, points, k)) for k in range(share)]
        cells = finer
    if len(cells) > MOST_CHUNKS:
        raise Uncuttable(f"the solid falls into {len(cells)} chunks; allowed: {MOST_CHUNKS}")
    wholes = [_solid(cell) for _, cell in cells]
    total, volume = math.fsum(w.volume for w in wholes), math.fsum(part.volume for part in parts)
    if not math.isclose(total, volume, rel_tol=1e-9):
        raise Uncuttable(f"a solid that intersects itself: chunks of {total:.9g} m³ in {volume:.9g} m³")
    paths = [path for path, _ in cells]
    interfaces, planes = _interfaces(wholes, paths)
    shapes = [_set_back(whole, plane) for whole, plane in zip(wholes, planes, strict=True)]
    chunks = tuple(Chunk(*chunk) for chunk in zip(wholes, shapes, paths, strict=True))
    return Fracture(parts, chunks, interfaces)


def _refuse_overlap(parts: Sequence[Solid]) -> None:
    for one, two in combinations(parts, 2):
        common = (one.manifold ^ two.manifold).volume()
        if common > 1e-9 * min(one.volume, two.volume):
            raise Uncuttable(f"parts of a solid that have {common:.3g} m³ in common; allowed: none")


def _shares(volumes: Sequence[float], count: int) -> list[int]:
    """How many chunks each part becomes: at least one, the next always where they are largest."""
    shares = [1] * len(volumes)
    while sum(shares) < count:
        shares[int(np.argmax([v / n for v, n in zip(volumes, shares, strict=True)]))] += 1
    return shares


def _cell(cell: Any, points: Array, k: int) -> Any:
    """The part of a cell that is nearest to the k-th point."""
    distance = np.linalg.norm(points - points[k], axis=1)
    for j in np.argsort(distance):
        if j == k:
            continue
        low, high = np.reshape(cell.bounding_box(), (2, 3))
        if distance[j] > 2 * np.linalg.norm(np.maximum(np.abs(low - points[k]), np.abs(high - points[k]))):
            break  # this cut, and those of seeds still farther off, pass by
        normal = (points[k] - points[j]) / distance[j]
        cell = cell.trim_by_plane(tuple(normal), float(normal @ (points[j] + points[k]) / 2))
    if cell.is_empty():
        raise Uncuttable("a cell of the cut holds nothing; allowed: fewer chunks")
    return cell


def _set_back(whole: Solid, planes: Sequence[tuple[Array, float]]) -> Solid:
    """A convex chunk without what is within half the gap of its neighbours."""
    shape = whole.manifold
    for normal, offset in planes:
        shape = shape.trim_by_plane(tuple(-normal), GAP / 2 - offset)
    if shape.volume() < whole.volume / 2:
        raise Uncuttable(f"a chunk of {whole.volume:.2g} m³, thinner than the gap to the next; allowed: fewer chunks")
    return _solid(shape)


def _scatter(
    solid: Solid, count: int, rng: np.random.Generator, focus: Vector | None, grain: Vector | None
) -> Array:
    """Seeds (count, 3) inside a solid, evenly but not regularly spaced.

    Each is the best of some candidates: that which is farthest from all others (D. P. Mitchell, Computer Graphics 25
    (1991) 157), in units of its distance from the focus if there is one.
    """
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    inside = np.empty((0, 3))
    for _ in range(200):
        if len(inside) >= _CANDIDATES * count:
            break
        some = rng.uniform(low, high, size=(200, 3))
        inside = np.concatenate([inside, some[solid.holds(some)]])
    else:
        raise Uncuttable("a solid too thin to find points inside it")
    size = float(np.linalg.norm(high - low))
    spacing = np.ones(len(inside))
    if focus is not None:
        spacing = 0.3 * size + np.linalg.norm(inside - focus, axis=1)
    if grain is not None:
        axis = np.asarray(grain, float) / np.linalg.norm(grain)
        inside = inside - np.outer((inside - solid.centre) @ axis, axis)
    chosen = [inside[0]]
    for k in range(1, count):
        among = slice(k * _CANDIDATES, (k + 1) * _CANDIDATES)
        apart = np.linalg.norm(inside[among, None] - np.array(chosen), axis=2).min(axis=1)
        chosen.append(inside[among][np.argmax(apart / spacing[among])])
    return np.array(chosen)


def _solid(manifold: Any) -> Solid:
    mesh = manifold.to_mesh64()
    return Solid(mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int64))


def _inward(solid: Solid) -> Iterator[tuple[Array, float]]:
    """The planes (normal, offset) that halve the inward edges of a solid, deepest first."""
    v, f = solid.vertices, solid.faces
    sides = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    normals = sides / np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-300)
    face_of = {(int(a), int(b)): n for n, t in enumerate(f) for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}
    # of the other face's corners two are on the edge
    depth = {(a, b): float(((v[f[face_of[b, a]]] - v[a]) @ normals[n]).sum()) for (a, b), n in face_of.items()}
    for a, b in sorted(depth, key=lambda edge: -depth[edge]):
        if depth[a, b] <= 0:
            return
        normal = np.cross(v[b] - v[a], normals[face_of[a, b]] + normals[face_of[b, a]])
        if np.linalg.norm(normal) > 0:
            normal = normal / np.linalg.norm(normal)
            yield normal, float(normal @ v[a])


def _moments(vertices: Array, faces: NDArray[np.int64]) -> tuple[float, Array, Array]:
    """Volume, centroid and inertia per density, from the tetrahedra that the faces make with the middle."""
    middle = vertices.mean(axis=0)
    a, b, c = (vertices[faces[:, k]] - middle for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    total = math.fsum(volume)
    corners = np.stack([a, b, c])
    centre = np.einsum("i,kij->j", volume, corners) / 4 / total
    # ∫ r rᵀ over a tetrahedron with one corner at the origin
    outer = np.einsum("i,kip,lij->pj", volume, corners, corners) + np.einsum("i,kip,kij->pj", volume, corners, corners)
    second = outer / 20 - total * np.outer(centre, centre)
    return total, middle + centre, np.trace(second) * np.eye(3) - second


def _interfaces(
    wholes: Sequence[Solid], paths: Sequence[tuple[int, ...]]
) -> tuple[tuple[Interface, ...], list[list[tuple[Array, float]]]]:
    """Where chunks meet, and the planes (outward normal, offset) of the faces with which each meets others."""
    found = []
    surfaces = [faces(whole) for whole in wholes]
    met: list[set[int]] = [set() for _ in wholes]
    boxes = [(whole.vertices.min(axis=0) - GAP, whole.vertices.max(axis=0) + GAP) for whole in wholes]
    for i, j in combinations(range(len(wholes)), 2):
        if (boxes[i][0] > boxes[j][1]).any() or (boxes[j][0] > boxes[i][1]).any():
            continue
        (normals, offsets, mine), (others, their_offsets, theirs) = surfaces[i], surfaces[j]
        size = max(1e-3, float(np.ptp(wholes[i].vertices, axis=0).max()))
        facing = (normals @ others.T < -1 + 1e-9) & (np.abs(offsets[:, None] + their_offsets) < 1e-7 * size)
        for a, b in np.argwhere(facing):
            axes = _axes(normals[a])
            area, centre, modulus = _section(_clip(mine[a] @ axes.T, theirs[b][::-1] @ axes.T))
            if area > _SLIVER * wholes[i].volume ** (2 / 3):
                met[i].add(int(a))
                met[j].add(int(b))
                place = centre @ axes + offsets[a] * normals[a]
                depth = next(k for k, (p, q) in enumerate(zip(paths[i], paths[j], strict=True)) if p != q)
                found.append(Interface(i, j, depth, area, _vector(place), _vector(normals[a]), modulus / area))
    planes = [[(surfaces[i][0][a], float(surfaces[i][1][a])) for a in sorted(met[i])] for i in range(len(wholes))]
    return tuple(found), planes


def _vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def faces(solid: Solid) -> tuple[Array, Array, list[Array]]:
    """The plane faces of a convex solid: outward normals (n, 3), offsets (n,), and corners (k, 3), counter-clockwise
    seen from outside."""
    corners = solid.vertices[solid.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    normals, offsets, polygons = [], [], []
    left = area > 1e-12 * area.max()  # needles that the cuts leave have no direction
    while left.any():
        n = int(np.argmax(area * left))
        normal = across[n] / area[n]
        offset = float(normal @ corners[n, 0])
        flat = np.abs(corners @ normal - offset).max(axis=1) < 1e-8
        points = solid.vertices[np.unique(solid.faces[flat & left])]
        around = (points - points.mean(axis=0)) @ _axes(normal).T
        normals.append(normal)
        offsets.append(offset)
        polygons.append(points[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
        left &= ~flat
    return np.array(normals), np.array(offsets), polygons


def _axes(normal: Array) -> Array:
    """Two unit vectors (2, 3) that span the plane of that normal; counter-clockwise seen against it."""
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(normal, side)])


def _clip(polygon: Array, window: Array) -> Array:
    """What two convex polygons (n, 2), counter-clockwise, have in common (I. Sutherland & G. Hodgman, 1974)."""
    for a, b in pairwise([*window, window[0]]):
        height = (b[0] - a[0]) * (polygon[:, 1] - a[1]) - (b[1] - a[1]) * (polygon[:, 0] - a[0])
        if (height >= 0).all():
            continue
        kept = []
        for k, point in enumerate(polygon):
            if (height[k] > 0) != (height[k - 1] > 0):
                kept.append(polygon[k - 1] + (point - polygon[k - 1]) * (height[k - 1] / (height[k - 1] - height[k])))
            if height[k] > 0:
                kept.append(point)
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def _section(polygon: Array) -> tuple[float, Array, float]:
    """Area [m²], centroid (2,) and least section modulus [m³] of a convex polygon (n, 2)."""
    if len(polygon) < 3:
        return 0.0, np.zeros(2), 0.0
    local = polygon - polygon.mean(axis=0)
    corners = np.stack([np.broadcast_to(local[0], local[2:].shape), local[1:-1], local[2:]], axis=1)
    sides = corners[:, 1:] - corners[:, :1]
    area = (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    total, summed = float(area.sum()), corners.sum(axis=1)
    if not total > 0:
        return 0.0, np.zeros(2), 0.0
    centre = area @ summed / 3 / total
    second = np.einsum("i,ikp,ikq->pq", area, corners, corners) + np.einsum("i,ip,iq->pq", area, summed, summed)
    moments, axes = np.linalg.eigh(second / 12 - total * np.outer(centre, centre))
    reach = np.abs((local - centre) @ axes).max(axis=0)
    return total, centre + polygon.mean(axis=0), float((moments / reach).min())


def bodies(name: str, fracture: Fracture) -> list[str]:
    """What the chunks of a solid are called in a scene: "name/chunk00" ..."""
    return [f"{name}/chunk{_number(fracture, i)}" for i in range(len(fracture.chunks))]


def welds(name: str, fracture: Fracture) -> list[str]:
    """What the bonds across the interfaces of a solid are called: "name/bond00-01" ..."""
    return [f"{name}/bond{_number(fracture, i.first)}-{_number(fracture, i.second)}" for i in fracture.interfaces]


def _number(fracture: Fracture, i: int) -> str:
    return f"{i:0{max(2, len(str(len(fracture.chunks) - 1)))}d}"


def rim(fracture: Fracture, normal: Vector, offset: float) -> list[Interface]:
    """Where chunks meet the plane n·r = offset, their solid's edge, with what is beyond it; `second` is -1.

    normal: outward unit vector; in the solid's axes [m].
    """
    found = []
    for i, chunk in enumerate(fracture.chunks):
        normals, offsets, polygons = faces(chunk.whole)
        for n, here, polygon in zip(normals, offsets, polygons, strict=True):
            if n @ normal > 1 - 1e-9 and abs(here - offset) < 1e-7:
                area, centre, modulus = _section(polygon @ _axes(n).T)
                place = _vector(centre @ _axes(n) + here * n)
                found.append(Interface(i, -1, 0, area, place, _vector(n), modulus / area))
    return found


def holding(run: Run, names: Sequence[str]) -> NDArray[np.bool_]:
    """Which bonds hold at every sample, (T, n)."""
    gone = {broken.weld: broken.time for broken in run.breaks}
    return np.asarray(run.t[:, None] <= [gone.get(name, math.inf) for name in names])


def fragments(fracture: Fracture, holds: ArrayLike) -> NDArray[np.int32]:
    """Which fragment every chunk (n,) belongs to, numbered from 0, when of the interfaces' bonds those (m,) hold."""
    ends = np.array([(i.first, i.second) for i in fracture.interfaces])[np.asarray(holds, bool)].reshape(-1, 2)
    n = len(fracture.chunks)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def place(
    scene: Scene,
    name: str,
    fracture: Fracture,
    *,
    density: float,
    surface: Surface,
    stress: float,
    position: ArrayLike = (0.0, 0.0, 0.0),
    quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    colour: ArrayLike = (0.93, 0.90, 0.84),
    polish: float = 0.3,
) -> list[str]:
    """Put a solid's chunks into a scene as free bodies, bonded where they meet; returns the names of `bodies`.

    position, quaternion: of the solid's axes in the world; density [kg/m³]; polish: how it shines, 0 to 1
    stress: the tension that breaks it [Pa]; a bond's strength is stress x area. Infinite: nothing breaks.
    Every chunk can touch every other one; what else it touches is for the caller to say.
    """
    if not 0 < density < math.inf or not stress > 0:
        raise Uncuttable(f"density = {density} kg/m³, stress = {stress} Pa of a solid; allowed: positive")
    rotation = quaternion_matrix(np.asarray(quaternion, float)[None])[0]
    shiny = scene.spec.add_material(name=f"{name}/material", specular=polish, shininess=polish)
    shiny.rgba = (*np.asarray(colour, float), 1.0)
    labels = bodies(name, fracture)
    for label, chunk in zip(labels, fracture.chunks, strict=True):
        whole = chunk.whole
        body = scene.spec.worldbody.add_body(name=label)
        body.pos, body.quat = np.asarray(position, float) + rotation @ whole.centre, quaternion
        body.mass, body.explicitinertial, inertia = density * whole.volume, True, density * whole.inertia
        body.ipos, body.iquat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        body.fullinertia = (*inertia.diagonal(), inertia[0, 1], inertia[0, 2], inertia[1, 2])
        body.add_freejoint(name=f"{label}.free")
        vertices = (chunk.shape.vertices - whole.centre).ravel()
        scene.spec.add_mesh(name=label, uservert=vertices, userface=chunk.shape.faces.ravel())
        geom = body.add_geom(name=label, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=label, material=shiny.name)
        geom.contype = geom.conaffinity = 0
        scene.material(label, density, surface)
    scene.touch(*labels)
    for weld, meeting in zip(welds(name, fracture), fracture.interfaces, strict=True):
        first, second = labels[meeting.first], labels[meeting.second]
        anchor = np.asarray(meeting.centre) - fracture.chunks[meeting.second].whole.centre
        bond(scene, weld, first, second, anchor=anchor)
        if stress < math.inf:
            scene.bonds.append(Bond(weld, stress * meeting.area, meeting.lever))
    return labels


def bond(scene: Scene, name: str, first: str, second: str, *, anchor: ArrayLike = (0.0, 0.0, 0.0)) -> None:
    """Weld two bodies as they stand in the specification; it holds for good unless the scene has a `Bond` of it.

    anchor: where its force acts, in the second body's axes, from its origin [m].
    """
    weld = scene.spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
    weld.name1, weld.name2 = first, second
    # relative place and orientation left at zero: the compiler takes those of the specification
    weld.data[:11] = (*np.asarray(anchor, float), *np.zeros(7), 1.0)
