"""Solids that break: cut beforehand along Voronoi cells into chunks which bonds hold together.

A solid is cut by the planes half-way between seed points (G. Voronoi, J. reine angew. Math. 134 (1908) 198), so chunks
fill it exactly; where two of them meet is an interface, and a bond across it is as strong as its area. Chunks may be
cut again, any number of times: clusters that first come apart as wholes, then crumble.

A chunk that is not convex, as one of a hollow vase, is made of convex pieces that move as one body: contact takes the
convex hull of every geom. What collides is set back from each cut by half of `GAP`, so that neighbours start apart;
masses and interfaces are those of the chunks that fill the solid.

Defects: where it will break is decided before it is hit; cracks are plane; a bond is rigid until it goes.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any, Final

import mujoco
import numpy as np
from manifold3d import Error, Manifold, Mesh64
from numpy.typing import ArrayLike, NDArray

from .contact import Surface
from .run import quaternion_matrix
from .scene import Bond, Scene

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GAP: Final = 2e-5
"""Between the colliding shapes of two neighbours before anything breaks [m]."""

MOST_CHUNKS: Final = 200
MOST_FACES: Final = 20_000
MOST_PIECES: Final = 64
"""Convex pieces of one chunk."""

_FLAT: Final = 1e-6
"""A chunk whose convex hull is larger by less than this fraction is convex."""

_CANDIDATES: Final = 10
_SLIVER: Final = 1e-4
"""Pieces and interfaces smaller than this fraction of the mean are left out of contact and bonding."""


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
        fault = self.manifold.status()
        if fault != Error.NoError or self.manifold.is_empty():
            raise Uncuttable(f"a solid that is not watertight (manifold3d: {fault.name})")
        if not self.volume > 1e-9 * np.ptp(vertices, axis=0).max() ** 3:
            raise Uncuttable(f"a solid of volume {self.volume:.3g} m³; allowed: positive (are its faces inside out?)")

    @functools.cached_property
    def manifold(self) -> Any:
        """As manifold3d has it."""
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
    """What does not break any more. Coordinates are those of the whole solid.

    whole: the chunk as it fills the solid (mass, inertia); pieces: convex, set back from the cuts (contact, pictures)
    path: which cell it is of, at every depth of cutting
    """

    whole: Solid
    pieces: tuple[Solid, ...]
    path: tuple[int, ...]


@dataclass(frozen=True)
class Interface:
    """Where two chunks meet.

    depth: at which cut they were parted (0 is the first); area [m²]; centre; normal, from the first to the second
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
    """A solid in chunks. seeds: of the cells, by path."""

    solid: Solid
    chunks: tuple[Chunk, ...]
    interfaces: tuple[Interface, ...]
    seeds: dict[tuple[int, ...], Vector]


@functools.lru_cache(maxsize=64)
def box(x: float, y: float, z: float) -> Solid:
    """A block or plate of these half sides [m], its centre at the origin."""
    if not all(0 < side < math.inf for side in (x, y, z)):
        raise Uncuttable(f"a box of half sides {x}, {y}, {z} m; allowed: positive and finite")
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * (x, y, z)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Solid(corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]))


@functools.lru_cache(maxsize=64)
def revolved(profile: tuple[tuple[float, float], ...], sides: int) -> Solid:
    """A vase: a closed polygon of (radius, height) [m], counter-clockwise, turned about the z axis in flat `sides`.

    The corners of the `sides`-gon lie on the circle. An inside makes it hollow.
    """
    if not 3 <= sides <= 64 or not 3 <= len(profile) <= 64:
        raise Uncuttable(f"a profile of {len(profile)} points and {sides} sides; allowed: 3 to 64 of both")
    if not np.isfinite(profile).all() or min(r for r, _ in profile) < 0:
        raise Uncuttable("a profile with radii that are negative or not finite; allowed: 0 or more")
    loop = list(pairwise([*profile, profile[0]]))
    if any(_cross(a, b, c, d) for (a, b), (c, d) in combinations(loop, 2)):
        raise Uncuttable("a profile that crosses itself")
    turns = 2 * math.pi * np.arange(sides) / sides
    vertices: list[Vector] = []
    ring: list[list[int]] = []
    for radius, height in profile:
        around = turns if radius > 0 else turns[:1]
        ring.append([len(vertices) + j for j in range(len(around))] * (1 if radius > 0 else sides))
        vertices += [(radius * math.cos(a), radius * math.sin(a), height) for a in around]
    faces = []
    for i, j in pairwise([*range(len(profile)), 0]):
        for k in range(sides):
            n = (k + 1) % sides
            quad = [(ring[i][k], ring[i][n], ring[j][n]), (ring[i][k], ring[j][n], ring[j][k])]
            faces += [t for t in quad if len(set(t)) == 3]
    return Solid(np.array(vertices), np.array(faces))


def _cross(a: Sequence[float], b: Sequence[float], c: Sequence[float], d: Sequence[float]) -> bool:
    """Whether two segments of the plane cross properly."""

    def side(p: Sequence[float], q: Sequence[float], r: Sequence[float]) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


@functools.lru_cache(maxsize=64)
def shatter(
    solid: Solid,
    counts: tuple[int, ...],
    seed: int,
    *,
    focus: Vector | None = None,
    grain: Vector | None = None,
) -> Fracture:
    """Cut a solid into `counts[0]` chunks, each of them into `counts[1]`, and so on: the product of the counts.

    A cell of a solid that is not convex may fall apart in several chunks, then there are more.
    seed: of the random cells; focus: a point towards which cells become smaller, in proportion to the distance;
    grain: a direction along which all cuts run, as through the thickness of a plate.
    Uncuttable if that makes too many chunks or pieces, or the solid cannot be cut so.
    """
    if not counts or any(count < 1 for count in counts) or not 2 <= math.prod(counts) <= MOST_CHUNKS:
        raise Uncuttable(f"cutting into {' x '.join(map(str, counts))} chunks; allowed: 2 to {MOST_CHUNKS} in all")
    for name, vector in (("focus", focus), ("grain", grain)):
        if vector is not None and (len(vector) != 3 or not np.isfinite(vector).all()):
            raise Uncuttable(f"{name} = {vector}; allowed: three finite numbers")
    if grain is not None and not np.linalg.norm(grain) > 0:
        raise Uncuttable(f"grain = {grain}; allowed: a direction")
    cells = [_Cell((), solid.manifold, solid.manifold)]
    seeds: dict[tuple[int, ...], Vector] = {}
    for count in counts:
        finer: list[_Cell] = []
        for cell in cells:
            rng = np.random.default_rng([seed, *cell.path])
            points = _scatter(_solid(cell.exact), count, rng, focus, grain)
            seeds |= {(*cell.path, k): (float(x), float(y), float(z)) for k, (x, y, z) in enumerate(points)}
            finer += [part for k in range(count) for part in _cell(cell, points, k)]
        cells = finer
    if len(cells) > MOST_CHUNKS:
        raise Uncuttable(f"the solid falls into {len(cells)} chunks; allowed: {MOST_CHUNKS}")
    chunks = tuple(Chunk(_solid(c.exact), _pieces(c.apart), c.path) for c in cells)
    total = math.fsum(c.whole.volume for c in chunks)
    if not math.isclose(total, solid.volume, rel_tol=1e-9):
        raise Uncuttable(f"a solid that intersects itself: chunks of {total:.9g} m³ in {solid.volume:.9g} m³")
    return Fracture(solid, chunks, _interfaces(chunks, seeds), seeds)


@dataclass(frozen=True)
class _Cell:
    """One connected part of a cell, in full and set back from all cuts so far."""

    path: tuple[int, ...]
    exact: Any
    apart: Any


def _cell(parent: _Cell, points: Array, k: int) -> list[_Cell]:
    """The part of the parent that is nearest to the k-th point."""
    exact, apart = parent.exact, parent.apart
    distance = np.linalg.norm(points - points[k], axis=1)
    for j in np.argsort(distance)[1:]:
        low, high = np.reshape(exact.bounding_box(), (2, 3))
        if distance[j] > 2 * np.linalg.norm(np.maximum(np.abs(low - points[k]), np.abs(high - points[k]))):
            break  # this cut, and those of seeds still farther off, pass by
        normal, offset = _bisector(points[j], points[k])
        exact = exact.trim_by_plane(tuple(normal), offset)
        apart = apart.trim_by_plane(tuple(normal), offset + GAP / 2)
    if exact.is_empty() or apart.is_empty():
        raise Uncuttable("a cell of the cut holds nothing: the chunks would be thinner than the gap between them")
    path = (*parent.path, k)
    parts = exact.decompose()
    if len(parts) == 1:
        return [_Cell(path, exact, apart)]
    # what was set back belongs to the part that it was cut from
    return [_Cell(path, part, part ^ apart) for part in parts]


def _bisector(a: ArrayLike, b: ArrayLike) -> tuple[Array, float]:
    """Unit normal, towards b, and offset of the plane half-way between two points."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    normal = (b - a) / np.linalg.norm(b - a)
    return normal, float(normal @ (a + b) / 2)


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
        spacing = 0.1 * size + np.linalg.norm(inside - focus, axis=1)
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


def _pieces(manifold: Any) -> tuple[Solid, ...]:
    """A solid as convex ones, by cuts that halve its inward edges, deepest first."""
    done, todo = [], list(manifold.decompose())
    least = _SLIVER * manifold.volume() / MOST_PIECES
    while todo:
        part = todo.pop()
        if part.volume() < least:
            continue
        hull = part.hull()
        if hull.volume() - part.volume() < _FLAT * part.volume():
            done.append(_solid(hull))
            continue
        for normal, offset in _inward(_solid(part)):
            halves = part.split_by_plane(tuple(normal), offset)
            if min(half.volume() for half in halves) > 1e-9 * part.volume():
                break
        else:
            raise Uncuttable("a chunk that cannot be cut into convex pieces")
        todo += [p for half in halves for p in half.decompose()]
        if len(done) + len(todo) > MOST_PIECES:
            raise Uncuttable(f"a chunk of more than {MOST_PIECES} convex pieces; allowed: a simpler solid, more chunks")
    return tuple(done)


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


def _interfaces(chunks: Sequence[Chunk], seeds: dict[tuple[int, ...], Vector]) -> tuple[Interface, ...]:
    mean = sum(c.whole.volume for c in chunks) / len(chunks)
    parts = Counter(c.path for c in chunks)
    found = []
    boxes = [(c.whole.vertices.min(axis=0) - GAP, c.whole.vertices.max(axis=0) + GAP) for c in chunks]
    for i, j in combinations(range(len(chunks)), 2):
        if (boxes[i][0] > boxes[j][1]).any() or (boxes[j][0] > boxes[i][1]).any():
            continue
        one, two = chunks[i].path, chunks[j].path
        depth = next((k for k, (a, b) in enumerate(zip(one, two, strict=True)) if a != b), None)
        if depth is None:
            continue  # parts of one cell: they lie apart
        normal, offset = _bisector(seeds[one[: depth + 1]], seeds[two[: depth + 1]])
        first, second = (_on(chunks[n].whole, normal, offset, sign) for n, sign in ((i, 1), (j, -1)))
        polygons = first
        if depth < len(one) - 1 or parts[one] + parts[two] > 2:
            # of one face, only what faces the other chunk
            polygons = [p for a in first for b in second if len(p := _clip(a, b)) > 2]
        area, centre, modulus = _section(polygons)
        if area > _SLIVER * mean ** (2 / 3):
            across = _axes(normal)
            place = tuple(float(x) for x in centre @ across + offset * normal)
            found.append(Interface(i, j, depth, area, place, tuple(normal.tolist()), modulus / area))
    return tuple(found)


def _axes(normal: Array) -> Array:
    """Two unit vectors (2, 3) that span the plane of that normal; counter-clockwise seen against it."""
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(normal, side)])


def _on(solid: Solid, normal: Array, offset: float, sign: int) -> list[Array]:
    """The triangles (3, 2) of a solid's surface that lie in a plane and face along (or against) its normal."""
    corners = solid.vertices[solid.faces]
    size = float(np.ptp(solid.vertices, axis=0).max())
    flat = np.abs(corners @ normal - offset).max(axis=1) < 1e-8 * max(size, 1e-3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal
    inside = corners[flat & (sign * across > 0)] @ _axes(normal).T
    return list(inside if sign > 0 else inside[:, ::-1])


def _clip(polygon: Array, window: Array) -> Array:
    """What two convex polygons (n, 2), counter-clockwise, have in common (I. Sutherland & G. Hodgman, 1974)."""
    points = [np.asarray(p) for p in polygon]
    for a, b in pairwise([*window, window[0]]):
        inward = np.array([a[1] - b[1], b[0] - a[0]])
        height = [float((p - a) @ inward) for p in points]
        kept = []
        for k, p in enumerate(points):
            h, before, q = height[k], height[k - 1], points[k - 1]
            if (h > 0) != (before > 0):
                kept.append(q + (p - q) * (before / (before - h)))
            if h > 0:
                kept.append(p)
        points = kept
    return np.array(points).reshape(-1, 2)


def _section(polygons: Sequence[Array]) -> tuple[float, Array, float]:
    """Area [m²], centroid (2,) and least section modulus [m³] of some polygons of a plane together."""
    total, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for polygon in polygons:
        a = polygon[0]
        for b, c in pairwise(polygon[1:]):
            area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
            corners = np.array([a, b, c])
            total += area
            first += area * corners.mean(axis=0)
            summed = corners.sum(axis=0)
            second += area / 12 * (corners.T @ corners + np.outer(summed, summed))
    if not total > 0:
        return 0.0, np.zeros(2), 0.0
    centre = first / total
    moments, axes = np.linalg.eigh(second - total * np.outer(centre, centre))
    reach = [max(abs((polygon - centre) @ axis).max() for polygon in polygons) for axis in axes.T]
    return total, centre, min(m / r for m, r in zip(moments, reach, strict=True))


@dataclass(frozen=True)
class Placed:
    """A broken solid in a scene: its bodies' names, chunk by chunk, and its bonds' weld names, one per interface."""

    fracture: Fracture
    bodies: tuple[str, ...]
    welds: tuple[str, ...]


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
) -> Placed:
    """Put a solid's chunks into a scene as free bodies "name/chunk00" ..., bonded where they meet.

    position, quaternion: of the solid's axes in the world; density [kg/m³]; polish: how it shines, 0 to 1
    stress: the tension that breaks it [Pa]; a bond's strength is stress x area. Infinite: nothing breaks.
    Every chunk can touch every other one; what else it touches is for the caller to say.
    """
    if not 0 < density < math.inf or not stress > 0:
        raise Uncuttable(f"density = {density} kg/m³, stress = {stress} Pa of a solid; allowed: positive")
    rotation = quaternion_matrix(np.asarray(quaternion, float)[None])[0]
    shiny = scene.spec.add_material(name=f"{name}/material", specular=polish, shininess=polish)
    shiny.rgba = (*np.asarray(colour, float), 1.0)
    digits = max(2, len(str(len(fracture.chunks) - 1)))
    bodies = []
    for i, chunk in enumerate(fracture.chunks):
        label = f"{name}/chunk{i:0{digits}d}"
        whole = chunk.whole
        body = scene.spec.worldbody.add_body(name=label)
        body.pos, body.quat = np.asarray(position, float) + rotation @ whole.centre, quaternion
        body.mass, body.explicitinertial, inertia = density * whole.volume, True, density * whole.inertia
        body.ipos, body.iquat = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        body.fullinertia = (*inertia.diagonal(), inertia[0, 1], inertia[0, 2], inertia[1, 2])
        body.add_freejoint(name=f"{label}.free")
        for k, piece in enumerate(chunk.pieces):
            mesh = f"{label}.{k}"
            vertices = (piece.vertices - whole.centre).ravel()
            scene.spec.add_mesh(name=mesh, uservert=vertices, userface=piece.faces.ravel())
            geom = body.add_geom(name=mesh, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, material=shiny.name)
            geom.contype = geom.conaffinity = 0
        scene.material(label, density, surface)
        bodies.append(label)
    scene.touch(*bodies)
    welds = []
    for meeting in fracture.interfaces:
        first, second = bodies[meeting.first], bodies[meeting.second]
        anchor = np.asarray(meeting.centre) - fracture.chunks[meeting.second].whole.centre
        label = f"{name}/bond{meeting.first:0{digits}d}-{meeting.second:0{digits}d}"
        welds.append(bond(scene, label, first, second, anchor=anchor))
        if stress < math.inf:
            scene.bonds.append(Bond(label, stress * meeting.area, meeting.lever))
    return Placed(fracture, tuple(bodies), tuple(welds))


def bond(scene: Scene, name: str, first: str, second: str, *, anchor: ArrayLike) -> str:
    """Weld two bodies as they stand in the specification; returns the weld's name.

    anchor: where its force acts, in the second body's axes, from its origin [m].
    """
    weld = scene.spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
    weld.name1, weld.name2 = first, second
    # relative place and orientation left at zero: the compiler takes those of the specification
    weld.data[:11] = (*np.asarray(anchor, float), *np.zeros(7), 1.0)
    return name
