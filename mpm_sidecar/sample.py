"""Shapes filled with particles: evenly, without a lattice, a layer half a spacing inside the surface.

`fill` shakes a lattice by a whole spacing either way, keeps what is inside, and lets the particles push each other and
be pushed by their mirror images in the walls, 20 times. Chosen by measurement; a box of 16 x 13.4 x 14.7 cells, 8
particles a cell (25 000); h is the spacing. Density: standard deviation of the mass on the nodes of the grid (quadratic
B-splines, over random places of the grid) in the interior, and its root mean square error in the layer of nodes that
feel the surface. Depth: of the outermost layer. Peak: the highest value of the structure factor near its first ring,
along the axes (uniform random places have 1 and a liquid about 3 on average, of which single values scatter as
exponentials do).

                                density    surface    depth          peak
    uniform random               14.5 %     9.5 %      0 to 0.95 h      8
    lattice                       0.003 %   0.7 %      0.50 h        7300
    lattice, jittered by h/2      4.6 %     3.0 %      0 to 0.95 h      4
    R3 sequence                   1.1 %     3.2 %      0 to 0.95 h   2400
    R3 sequence, relaxed          0.3 %     2.4 %      0.53 ± 0.19 h 1500
    jittered by h/2, relaxed      0.7 %     0.8 %      0.48 ± 0.07 h  230
    uniform random, relaxed       2.4 %     2.4 %      0.48 ± 0.08 h    8
    jittered by h, relaxed: taken 0.8 %     0.9 %      0.48 ± 0.08 h   14

(The peaks of the R3 sequence were looked for in some more directions too; its relaxed row is after 10 rounds of a
smaller step.) 300 000 particles take 3 to 5 s of one core.

The R3 sequence is locally a lattice, and what has once been one remembers it: only a shake that is uniform over two
spacings wipes out its peaks, and leaves few enough lumps to be relaxed away.

Defects: the second moments are those of points, about 1e-3 too small for 24 spacings across, as any rule of midpoints
has them; flat walls order the first layers; at a sharp edge of a mesh the layer is only as good as a distance field of
0.7 h.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, singledispatch
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import manifold3d
import numpy as np
import trimesh
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from physinone_mj.base import Refusal
from physinone_mj.continuum import Ball, Box, Cylinder, Letters, Model, Piece, Shape, Torus
from physinone_mj.run import quaternion_matrix

from . import meshes
from ._glyphs import ALPHABET, GAP, SPACE, STROKE, glyph

Array = NDArray[np.float64]

LEAST_CELLS: Final = 2
"""Across the thinnest part of a shape."""
MOST_PARTICLES: Final = 4_000_000
"""Of one piece."""
LONGEST_WORD: Final = 64
_MOST_PLACES: Final = 64_000_000
"""Of the lattice in the box around a shape."""
_SHARE: Final = 2_000_000
"""Of them, looked at together."""
_ROUNDS: Final = 20
_REACH: Final = 1.5
"""Of the push between particles [spacing]."""
_GAIN: Final = 0.8
_FARTHEST: Final = 0.3
"""That a particle goes in a round along an axis [spacing]."""
_SKIN: Final = 0.2
"""Least depth of a particle [spacing]."""
_CIRCLE: Final = 128
"""Sides of a circle in a mesh."""


@dataclass(frozen=True)
class _Solid:
    """A shape about the middle of its box.

    thickness [m]; volume [m³]; half: of the box's sides (3,) [m]; surface: its mesh; inside: (n, 3) -> (n,);
    walls: given the points and their spacing, how deep they lie under each of the m walls (n, m) [m] and the unit
    vectors away from these (n, m, 3)
    """

    thickness: float
    volume: float
    half: Array
    surface: Callable[[], trimesh.Trimesh]
    inside: Callable[[Array], NDArray[np.bool_]]
    walls: Callable[[float], Callable[[Array], tuple[Array, Array]]]


def closed(shape: Shape) -> trimesh.Trimesh:
    """The shape's closed surface in its own axes [m], corners on the surface proper; ValueError as for `volume`."""
    return _solid(shape).surface()


def volume(shape: Shape) -> float:
    """[m³], by formula where there is one, else of the mesh. ValueError if a word or a file is not allowed."""
    return _solid(shape).volume


def thickness(shape: Shape) -> float:
    """The smallest distance from side to side [m]; of a word that of its stroke or depth, of a mesh see `meshes`."""
    return _solid(shape).thickness


def inside(shape: Shape, points: ArrayLike) -> NDArray[np.bool_]:
    """Which of the points (n, 3) [m], in the shape's own axes, are in it."""
    return _solid(shape).inside(np.asarray(points, float).reshape(-1, 3))


def fill(piece: Piece, dx: float, per_cell: int, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """(places (n, 3) [m], velocities (n, 3) [m/s], volume of each [m³]) of a piece's particles in the world.

    About `per_cell` in dx³, of equal volumes that add up to the shape's. The velocities are those of a rigid body about
    the particles' own centre of mass. The same for the same state of `rng`.
    Refusal R7 if the shape is thinner than two cells, R10 if there are too many particles; ValueError for a word or a
    file that is not allowed.
    """
    if not 0 < dx < math.inf or per_cell < 1:
        raise ValueError(f"dx = {dx} m, {per_cell} particles in a cell of {piece.name!r}; allowed: positive")
    solid = _solid(piece.shape)
    if solid.thickness < LEAST_CELLS * dx * (1 - 1e-9):
        raise Refusal("R7", f"{piece.name!r} is {solid.thickness:.4g} m thick, {solid.thickness / dx:.3g} cells of "
                            f"{dx:.4g} m; allowed: {LEAST_CELLS} cells, a fidelity of "
                            f"{LEAST_CELLS * dx / solid.thickness:.3g} times as many would do")  # fmt: skip
    expected = solid.volume * per_cell / dx**3
    spacing = dx / per_cell ** (1 / 3)
    places = float(np.prod(2 * solid.half / spacing))
    if expected > MOST_PARTICLES or places > _MOST_PLACES:
        raise Refusal("R10", f"{piece.name!r} takes {expected:.3g} particles in a box with room for {places:.3g}; "
                             f"allowed: {MOST_PARTICLES:.3g} and {_MOST_PLACES:.3g}")  # fmt: skip
    start = _shaken(solid, spacing, rng)
    if not len(start):
        raise ValueError(f"{piece.name!r} holds no particle")
    own = _relaxed(solid, start, (solid.volume / len(start)) ** (1 / 3))
    points = own @ quaternion_matrix(np.array([piece.quaternion]))[0].T + piece.position
    velocities = np.cross(piece.spin, points - points.mean(axis=0)) + piece.velocity
    return points, velocities, solid.volume / len(points)


def _shaken(solid: _Solid, spacing: float, rng: np.random.Generator) -> Array:
    """A lattice that fits the box, each place moved by up to a spacing along each axis; those inside."""
    count = np.maximum(np.rint(2 * solid.half / spacing), 1).astype(np.int64)
    pitch = 2 * solid.half / count
    layers = max(1, _SHARE // int(count[1] * count[2]))
    found = []
    for first in range(0, int(count[0]), layers):
        cells = np.indices((min(layers, int(count[0]) - first), count[1], count[2])).reshape(3, -1).T + 0.5
        cells[:, 0] += first
        at = np.abs((cells + rng.uniform(-1, 1, cells.shape)) * pitch)
        at = solid.half - np.abs(2 * solid.half - at)  # mirrored at both ends of the box
        found.append(at[solid.inside(at)])
    return np.concatenate(found)


def _relaxed(solid: _Solid, start: Array, spacing: float) -> Array:
    """Particles at most 3/10 of a spacing further, round by round, pushed by (1 - r/1.5 h)² from each other."""
    walls, points = solid.walls(spacing), start
    for _ in range(_ROUNDS):
        points = _pushed(points, *walls(points), spacing)
    depth, away = walls(points)
    points = points + (np.maximum(_SKIN * spacing - depth, 0)[..., None] * away).sum(axis=1)
    return np.where(solid.inside(points)[:, None], points, start)


@njit(cache=True)
def _pushed(x: Array, depth: Array, away: Array, spacing: float) -> Array:
    """One round: sorted by cells as wide as the push reaches, so that only neighbours are asked."""
    reach = _REACH * spacing
    low = np.array([x[:, 0].min(), x[:, 1].min(), x[:, 2].min()])
    high = np.array([x[:, 0].max(), x[:, 1].max(), x[:, 2].max()])
    n0, n1, n2 = [int((high[k] - low[k]) / reach) + 1 for k in range(3)]
    cell = np.empty(len(x), np.int64)
    start = np.zeros(n0 * n1 * n2 + 1, np.int64)
    for p in range(len(x)):
        i, j, k = int((x[p, 0] - low[0]) / reach), int((x[p, 1] - low[1]) / reach), int((x[p, 2] - low[2]) / reach)
        cell[p] = (i * n1 + j) * n2 + k
        start[cell[p] + 1] += 1
    for c in range(len(start) - 1):
        start[c + 1] += start[c]
    free, order, y = start.copy(), np.empty(len(x), np.int64), np.empty_like(x)
    for p in range(len(x)):
        q = free[cell[p]]
        free[cell[p]] += 1
        order[q] = p
        y[q] = x[p]
    force = np.zeros_like(x)  # in the order of the cells, as y
    for p in range(len(x)):
        a, b, c = y[p]
        i, j, k = int((a - low[0]) / reach), int((b - low[1]) / reach), int((c - low[2]) / reach)
        fx, fy, fz = 0.0, 0.0, 0.0
        for ahead in range(5):  # each pair once: what follows in this row of cells, and the four rows ahead of it
            ii, jj = (i, j + ahead) if ahead < 2 else (i + 1, j + ahead - 3)
            if ii >= n0 or jj < 0 or jj >= n1:
                continue
            row = (ii * n1 + jj) * n2
            begin = p + 1 if ahead == 0 else start[row + max(k - 1, 0)]
            for q in range(begin, start[row + min(k + 1, n2 - 1) + 1]):
                u, v, w = a - y[q, 0], b - y[q, 1], c - y[q, 2]
                square = u * u + v * v + w * w
                if 0 < square < reach * reach:
                    r = math.sqrt(square)
                    push = (1 - r / reach) ** 2 / r
                    fx += push * u
                    fy += push * v
                    fz += push * w
                    force[q, 0] -= push * u
                    force[q, 1] -= push * v
                    force[q, 2] -= push * w
        force[p, 0] += fx
        force[p, 1] += fy
        force[p, 2] += fz
    result = np.empty_like(x)
    for p in range(len(x)):
        o = order[p]
        for m in range(depth.shape[1]):
            if 2 * depth[o, m] < reach:  # its image is as far behind the wall as it is before it
                push = (1 - max(2 * depth[o, m], 0.0) / reach) ** 2 + max(_SKIN - depth[o, m] / spacing, 0.0) / _GAIN
                for k in range(3):
                    force[p, k] += push * away[o, m, k]
        for k in range(3):
            result[o, k] = y[p, k] + min(max(_GAIN * force[p, k], -_FARTHEST), _FARTHEST) * spacing
    return result


def overlapping(clouds: Mapping[str, Array], dx: float) -> None:
    """Refusal R1 if two pieces, particles (n, 3) [m] by name, lie in each other; ValueError if one has none.

    They do where a particle of the one is closer to one of the other than half of what particles of a piece keep
    between themselves; pieces that touch keep two thirds of it and more. Shallower than a fifth of a spacing passes.
    """
    trees, spacing = {}, {}
    for name, points in clouds.items():
        if not len(points):
            raise ValueError(f"{name!r} holds no particle")
        trees[name] = cKDTree(points)
        few = points[:: max(1, len(points) // 1000)]
        gap = np.asarray(trees[name].query(few, k=2)[0])[:, 1]
        spacing[name] = min(float(np.median(gap)), dx) if len(points) > 1 else dx
    names = list(clouds)
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            limit = min(spacing[one], spacing[other]) / 2
            mine = clouds[one]
            low, high = clouds[other].min(axis=0) - limit, clouds[other].max(axis=0) + limit
            mine = mine[((mine > low) & (mine < high)).all(axis=1)]
            inner = np.isfinite(trees[other].query(mine, distance_upper_bound=limit)[0])
            if inner.any():
                deep = np.ptp(mine[inner], axis=0).min() + limit
                raise Refusal("R1", f"{one!r} and {other!r} lie in each other, about {deep:.3g} m deep "
                                    f"({100 * inner.sum() / len(clouds[one]):.2g} % of the particles of {one!r}); "
                                    f"allowed: to touch")  # fmt: skip


def _made(points: Array, faces: Any) -> trimesh.Trimesh:
    return trimesh.Trimesh(points, faces, process=False)


@singledispatch
def _solid(shape: Any) -> _Solid:
    raise ValueError(f"shape = {shape!r}; allowed: Box, Ball, Cylinder, Torus, Letters, Model")


@_solid.register
def _(shape: Box) -> _Solid:
    half = np.array(shape.half)

    def walls(points: Array) -> tuple[Array, Array]:
        return half - np.abs(points), -np.sign(points)[:, :, None] * np.eye(3)

    return _Solid(
        thickness=2 * half.min(), volume=float(8 * np.prod(half)), half=half,
        surface=lambda: trimesh.creation.box(2 * half),
        inside=lambda points: np.asarray((np.abs(points) <= half).all(axis=1)), walls=lambda _: walls,
    )  # fmt: skip


@_solid.register
def _(shape: Ball) -> _Solid:
    radius = shape.radius

    def walls(points: Array) -> tuple[Array, Array]:
        far = np.linalg.norm(points, axis=1)
        return (radius - far)[:, None], -(points / np.maximum(far, 1e-300)[:, None])[:, None]

    return _Solid(
        thickness=2 * radius, volume=4 / 3 * math.pi * radius**3, half=np.full(3, radius),
        surface=lambda: trimesh.creation.icosphere(subdivisions=5, radius=radius),
        inside=lambda points: np.asarray(np.linalg.norm(points, axis=1) <= radius), walls=lambda _: walls,
    )  # fmt: skip


@_solid.register
def _(shape: Cylinder) -> _Solid:
    radius, half = shape.radius, shape.half

    def walls(points: Array) -> tuple[Array, Array]:
        far = np.hypot(points[:, 0], points[:, 1])
        away = np.zeros((len(points), 2, 3))
        away[:, 0, :2] = -points[:, :2] / np.maximum(far, 1e-300)[:, None]
        away[:, 1, 2] = -np.sign(points[:, 2])
        return np.stack([radius - far, half - np.abs(points[:, 2])], axis=1), away

    return _Solid(
        thickness=2 * min(radius, half), volume=2 * math.pi * radius**2 * half, half=np.array([radius, radius, half]),
        surface=lambda: trimesh.creation.cylinder(radius, 2 * half, sections=_CIRCLE),
        inside=lambda points: np.asarray((walls(points)[0] >= 0).all(axis=1)), walls=lambda _: walls,
    )  # fmt: skip


@_solid.register
def _(shape: Torus) -> _Solid:
    ring, tube = shape.ring, shape.tube
    if tube >= ring:
        raise ValueError(f"tube = {tube} m of a torus; allowed: less than its ring, {ring} m")

    def walls(points: Array) -> tuple[Array, Array]:
        axis = np.hypot(points[:, 0], points[:, 1])
        middle = np.zeros_like(points)
        middle[:, :2] = ring * points[:, :2] / np.maximum(axis, 1e-300)[:, None]
        inward = middle - points
        far = np.linalg.norm(inward, axis=1)
        return (tube - far)[:, None], (inward / np.maximum(far, 1e-300)[:, None])[:, None]

    return _Solid(
        thickness=2 * tube, volume=2 * math.pi**2 * ring * tube**2, half=np.array([ring + tube, ring + tube, tube]),
        surface=lambda: trimesh.creation.torus(ring, tube, major_sections=_CIRCLE, minor_sections=_CIRCLE // 2),
        inside=lambda points: np.asarray(walls(points)[0][:, 0] >= 0), walls=lambda _: walls,
    )  # fmt: skip


@_solid.register
def _(shape: Letters) -> _Solid:
    wrong = sorted(set(shape.text) - set(ALPHABET) - {" "})
    if wrong:
        raise ValueError(f"text = {shape.text[:80]!r}: no letters {wrong[:10]}; allowed: A to Z, 0 to 9 and blanks")
    if not shape.text.strip() or len(shape.text) > LONGEST_WORD:
        raise ValueError(f"text = {shape.text[:80]!r}; allowed: 1 to {LONGEST_WORD} letters, not blanks alone")
    return _word(shape)


@lru_cache(maxsize=16)
def _word(shape: Letters) -> _Solid:
    unit = shape.height / (1 + STROKE)
    radius, flat = STROKE / 2 * unit, shape.depth / 2
    letters, cursor = [], 0.0
    for letter in shape.text.strip():
        if letter == " ":
            cursor += SPACE
            continue
        lines = [line + np.array([cursor, 0.0]) for line in glyph(letter)]
        letters.append(lines)
        cursor = max(line[:, 0].max() for line in lines) + STROKE + GAP
    wide = cursor - STROKE - GAP
    letters = [[(line - (wide / 2, 0.5)) * unit for line in lines] for lines in letters]
    half = np.array([wide / 2 * unit + radius, flat, shape.height / 2])
    segments = np.concatenate([np.concatenate([line[:-1], line[1:]], axis=1) for lines in letters for line in lines])
    first = np.cumsum([0, *(sum(len(line) - 1 for line in lines) for lines in letters)])
    ends = [(min(line[:, 0].min() for line in lines), max(line[:, 0].max() for line in lines)) for lines in letters]
    cuts = np.array([(a[1] + b[0]) / 2 for a, b in pairwise(ends)])

    def walls(points: Array) -> tuple[Array, Array]:
        depth, away = np.empty((len(points), 2)), np.zeros((len(points), 2, 3))
        flat_points = np.ascontiguousarray(points[:, ::2])
        depth[:, 0], away[:, 0, 0], away[:, 0, 2] = _under(flat_points, segments, first, cuts, radius)
        depth[:, 1], away[:, 1, 1] = flat - np.abs(points[:, 1]), -np.sign(points[:, 1])
        return depth, away

    outline = _outline(segments, radius)
    return _Solid(
        thickness=min(2 * radius, shape.depth), volume=outline.area() * shape.depth, half=half,
        surface=lambda: _standing(outline, shape.depth),
        inside=lambda points: np.asarray((walls(points)[0] >= 0).all(axis=1)), walls=lambda _: walls,
    )  # fmt: skip


def _outline(segments: Array, radius: float) -> Any:
    """The union of all that is within a radius of one of the segments."""
    dot = manifold3d.CrossSection.circle(radius, _CIRCLE)
    bars = [manifold3d.CrossSection.batch_hull([dot.translate(s[:2]), dot.translate(s[2:])]) for s in segments]
    return manifold3d.CrossSection.batch_boolean(bars, manifold3d.OpType.Add)


def _standing(outline: Any, depth: float) -> trimesh.Trimesh:
    """An outline (x, z) made as deep as that along y."""
    block = outline.extrude(depth).to_mesh64()
    x, z, y = np.asarray(block.vert_properties, float)[:, :3].T
    return _made(np.stack([x, depth / 2 - y, z], axis=1), np.asarray(block.tri_verts, np.int64))


@njit(cache=True)
def _under(
    points: Array, segments: Array, first: NDArray[np.int64], cuts: Array, radius: float
) -> tuple[Array, Array, Array]:
    """How deep each point (n, 2) is under the outline of its letter, and the direction inwards."""
    depth, ax, az = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    for p in range(len(points)):
        x, z = points[p]
        letter = np.searchsorted(cuts, x)
        best, bx, bz = np.inf, 0.0, 0.0
        for s in range(first[letter], first[letter + 1]):
            x0, z0, x1, z1 = segments[s]
            ux, uz = x1 - x0, z1 - z0
            t = min(max(((x - x0) * ux + (z - z0) * uz) / (ux * ux + uz * uz), 0.0), 1.0)
            gx, gz = x0 + t * ux - x, z0 + t * uz - z
            square = gx * gx + gz * gz
            if square < best:
                best, bx, bz = square, gx, gz
        far = math.sqrt(best)
        depth[p] = radius - far
        ax[p], az[p] = (bx / far, bz / far) if far > 0 else (0.0, 0.0)
    return depth, ax, az


@_solid.register
def _(shape: Model) -> _Solid:
    path = Path(shape.path)
    try:
        now = path.stat()
    except OSError as why:
        raise ValueError(f"mesh {path}: {why.strerror or why}") from None
    return _model(Model(path.resolve(), shape.size), now.st_mtime_ns, now.st_size)


@lru_cache(maxsize=8)
def _model(shape: Model, _changed: int, _bytes: int) -> _Solid:
    mesh = meshes.read(shape.path)
    low, high = mesh.bounds
    scale = shape.size / float((high - low).max())
    mesh = _made((mesh.vertices - (low + high) / 2) * scale, mesh.faces)

    def walls(spacing: float) -> Callable[[Array], tuple[Array, Array]]:
        field = meshes.signed_distance_grid(mesh, 0.7 * spacing, name=str(shape.path))

        def at(points: Array) -> tuple[Array, Array]:
            distance, slope = field.at(points)
            steep = np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
            return -distance[:, None], -(slope / steep[:, None])[:, None]

        return at

    return _Solid(
        thickness=meshes.thickness(mesh), volume=float(mesh.volume), half=(high - low) / 2 * scale,
        surface=mesh.copy, inside=lambda points: meshes.contains(mesh, points), walls=walls,
    )  # fmt: skip
