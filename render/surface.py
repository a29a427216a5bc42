"""Particles of a continuum -> what is drawn of it: a closed surface with smooth normals, or grains.

The surface is where half of the room is filled with matter. With s = V₀^(1/3) the particles' spacing at rest,

    φ(x) = Σ J V₀ k W(x - x_p),    φ = 1/2 on the surface,

W ∝ (1 - |G (x - x_p)|²)³. At rest G = I/(RADIUS s): so wide that particles on a lattice make no bumps, and edges are
rounded by about a spacing. Where matter is drawn out, G follows it (J. Yu & G. Turk, ACM Trans. Graph. 32 (2013) 5),
as a particle's neighbours at the start tell: G⁻² ∝ F Fᵀ, F the deformation gradient that fits them best.

On a flat face φ = 1/2 where the matter ends. What is thinner than W is lower than that everywhere: of a film of a
thickness t smoothed by a Gaussian of width σ, with M = φ in its middle, φ = ½ erf(2 erf⁻¹ M) where it ends. So a
particle near which φ is no higher than M counts k = ½/(½ erf(2 erf⁻¹ M)) times, and films and threads keep their
thickness instead of vanishing. Last, all of it is moved outwards so far that it holds Σ J V₀.

Vertices lie in the cells of a grid through which the surface passes, in the mean of the places where it crosses the
cell's edges (S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998); normals are those of φ. The grid is
that of the world, kept only near matter. Each picture follows from its own particles and where they began.

Defect: two sheets nearer than a spacing grow together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import erf, erfinv

from render.shapes import Mesh

Array = NDArray[np.float64]

RADIUS: Final = 2.5
"""Of the kernel at rest [spacing]; its standard deviation along each axis is that over √11."""
CELL: Final = 0.6
"""Of the grid [spacing]."""
_DRAWN: Final = (0.5, 3.8)
"""Least and greatest stretch that a kernel follows: it is no narrower than the grid resolves, no wider than a block."""
_TORN: Final = (2.5, 4.5)
"""Distance of former neighbours from which they count less, and not at all [spacing]."""
_STIFF: Final = 0.02
"""ε of the fit of F: what no neighbour tells is as at rest."""
_SIDE: Final = 16
"""Of a block of the grid [cell]: at least as long as the widest kernel."""
_SHIFT: Final = 4
_MASK: Final = 15
_REACH: Final = 3.0
"""Of the neighbourhood in which φ is highest [spacing]; within half of it, it counts in full."""
_CREST: Final = 0.8
"""φ on a surface is at most this much of its highest value: where a film of one layer, a thread of one row and a drop
of one particle have their volume within a third, and noise tears no holes."""
KEPT: Final = 8
"""Frames whose layers are remembered."""
_SWELL: Final = 0.3
"""By how much a surface is moved at most, to hold the volume that its rounded edges lack [spacing]."""
_FARTHEST: Final = 2**20
"""Blocks from the world's origin."""


@njit(cache=True)
def _splat(places: Any, amounts: Any, shapes: Any, own: Any, blocks: Any, near: Any, phi: Any) -> None:
    """Add Σ amount (1 - |G (x - x_p)|²)³ to phi (blocks, _SIDE, _SIDE, _SIDE).

    places (n, 3) [cell]; shapes (n, 9): G² (xx, xy, xz, yy, yz, zz) [1/cell²] and the half sides of the box round the
    kernel [cell]; own (n,): the block each is in
    """
    for p in range(len(places)):
        b, amount, g = own[p], np.float32(amounts[p]), shapes[p]
        low = np.empty(3, np.int64)
        high = np.empty(3, np.int64)
        corner = np.empty(3, np.int64)
        for a in range(3):
            low[a] = math.ceil(places[p, a] - g[6 + a])
            high[a] = math.floor(places[p, a] + g[6 + a])
            corner[a] = _SIDE * (blocks[b, a] - 1)
        for i in range(low[0], high[0] + 1):
            x, at = i - corner[0], i - places[p, 0]
            for j in range(low[1], high[1] + 1):
                y, aside = j - corner[1], j - places[p, 1]
                rest = 1 - g[0] * at * at - 2 * g[1] * at * aside - g[3] * aside * aside
                slope, bend = 2 * (g[2] * at + g[4] * aside), g[5]
                # where the row leaves the kernel
                middle = -slope / (2 * bend)
                root = rest + slope * slope / (4 * bend)
                if root <= 0:
                    continue
                half = math.sqrt(root / bend)
                first = max(math.ceil(places[p, 2] + middle - half), low[2])
                last = min(math.floor(places[p, 2] + middle + half), high[2])
                row = (x >> _SHIFT) * 9 + (y >> _SHIFT) * 3
                while first <= last:
                    z = first - corner[2]
                    many = min(_SIDE - (z & _MASK), last + 1 - first)
                    line = phi[near[b, row + (z >> _SHIFT)], x & _MASK, y & _MASK]
                    up = np.float32(first - places[p, 2])
                    r, s, c = np.float32(rest), np.float32(slope), np.float32(bend)
                    for m in range(many):
                        h = up + np.float32(m)
                        v = max(r - h * (s + c * h), np.float32(0))
                        line[(z & _MASK) + m] += amount * v * v * v
                    first += many


@njit(cache=True)
def _sampled(places: Any, own: Any, blocks: Any, near: Any, phi: Any) -> Any:
    """φ at places (n, 3) [cell], linear between nodes."""
    out = np.zeros(len(places))
    for p in range(len(places)):
        b = own[p]
        low = np.floor(places[p])
        for corner in range(8):
            w = 1.0
            where = 0
            index = np.empty(3, np.int64)
            for a in range(3):
                bit = (corner >> a) & 1
                f = places[p, a] - low[a]
                w *= f if bit else 1 - f
                n = int(low[a]) + bit - _SIDE * (blocks[b, a] - 1)
                where = where * 3 + (n >> _SHIFT)
                index[a] = n & _MASK
            out[p] += w * phi[near[b, where], index[0], index[1], index[2]]
    return out


@njit(cache=True)
def _crests(places: Any, fullness: Any, first: Any, own: Any, near: Any, reach: float) -> Any:
    """Greatest fullness round each place (n, 3) [cell], sorted by block; less and less of it beyond half the reach."""
    out = fullness.copy()
    for p in range(len(places)):
        for n in range(27):
            b = near[own[p], n]
            if b < 0 or out[p] > 0.98:
                continue
            for q in range(first[b], first[b + 1]):
                if fullness[q] > out[p]:
                    x, y, z = places[p, 0] - places[q, 0], places[p, 1] - places[q, 1], places[p, 2] - places[q, 2]
                    u = math.sqrt(x * x + y * y + z * z) / reach
                    if u < 1:
                        fade = 1.0 if u < 0.5 else 1 - (2 * u - 1) ** 2
                        out[p] = max(out[p], fade * fullness[q])
    return out


@njit(cache=True)
def _nets(phi: Any, blocks: Any, near: Any, level: float) -> Any:
    """Points (N, 3) [cell], their outward normals, and triangles (M, 3) of φ = level."""
    count = len(phi)
    number = np.full((count, _SIDE, _SIDE, _SIDE), -1, np.int32)
    local = np.zeros((count, _SIDE + 1, _SIDE + 1, _SIDE + 1), phi.dtype)
    vertices = quads = 0
    for b in range(count):
        for i in range(_SIDE + 1):
            for j in range(_SIDE + 1):
                for k in range(_SIDE + 1):
                    n = near[b, (1 + (i >> _SHIFT)) * 9 + (1 + (j >> _SHIFT)) * 3 + 1 + (k >> _SHIFT)]
                    local[b, i, j, k] = phi[n, i & _MASK, j & _MASK, k & _MASK] if n >= 0 else 0
        here = local[b]
        for i in range(_SIDE):
            for j in range(_SIDE):
                for k in range(_SIDE):
                    inside = 0
                    for c in range(8):
                        inside += here[i + (c >> 2), j + ((c >> 1) & 1), k + (c & 1)] >= level
                    if 0 < inside < 8:
                        number[b, i, j, k] = vertices
                        vertices += 1
                    one = here[i, j, k] >= level
                    quads += one != (here[i + 1, j, k] >= level)
                    quads += one != (here[i, j + 1, k] >= level)
                    quads += one != (here[i, j, k + 1] >= level)
    points, normals = np.empty((vertices, 3)), np.empty((vertices, 3))
    triangles = np.empty((2 * quads, 3), np.int64)
    f = np.empty(8)
    for b in range(count):
        for i in range(_SIDE):
            for j in range(_SIDE):
                for k in range(_SIDE):
                    v = number[b, i, j, k]
                    if v < 0:
                        continue
                    for c in range(8):
                        f[c] = local[b, i + (c >> 2), j + ((c >> 1) & 1), k + (c & 1)]
                    x = y = z = 0.0
                    crossings = 0
                    for c in range(8):
                        for a in range(3):
                            step = 4 >> a
                            if c & step or (f[c] >= level) == (f[c + step] >= level):
                                continue
                            t = (level - f[c]) / (f[c + step] - f[c])
                            x += (c >> 2) + (t if a == 0 else 0.0)
                            y += ((c >> 1) & 1) + (t if a == 1 else 0.0)
                            z += (c & 1) + (t if a == 2 else 0.0)
                            crossings += 1
                    x, y, z = x / crossings, y / crossings, z / crossings
                    points[v, 0] = _SIDE * blocks[b, 0] + i + x
                    points[v, 1] = _SIDE * blocks[b, 1] + j + y
                    points[v, 2] = _SIDE * blocks[b, 2] + k + z
                    gx = ((f[4] - f[0]) * (1 - y) * (1 - z) + (f[5] - f[1]) * (1 - y) * z
                          + (f[6] - f[2]) * y * (1 - z) + (f[7] - f[3]) * y * z)  # fmt: skip
                    gy = ((f[2] - f[0]) * (1 - x) * (1 - z) + (f[3] - f[1]) * (1 - x) * z
                          + (f[6] - f[4]) * x * (1 - z) + (f[7] - f[5]) * x * z)  # fmt: skip
                    gz = ((f[1] - f[0]) * (1 - x) * (1 - y) + (f[3] - f[2]) * (1 - x) * y
                          + (f[5] - f[4]) * x * (1 - y) + (f[7] - f[6]) * x * y)  # fmt: skip
                    steep = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-30)
                    normals[v, 0], normals[v, 1], normals[v, 2] = -gx / steep, -gy / steep, -gz / steep
    made = 0
    corner = np.empty(4, np.int64)
    for b in range(count):
        for i in range(_SIDE):
            for j in range(_SIDE):
                for k in range(_SIDE):
                    one = local[b, i, j, k] >= level
                    for a in range(3):
                        other = local[b, i + (a == 0), j + (a == 1), k + (a == 2)] >= level
                        if one == other:
                            continue
                        # the four cells round the edge, counter-clockwise as seen from its end
                        for c in range(4):
                            u, w = (c == 1) or (c == 2), c >= 2
                            x = i + _SIDE - (u if a == 2 else w if a == 1 else 0)
                            y = j + _SIDE - (u if a == 0 else w if a == 2 else 0)
                            z = k + _SIDE - (u if a == 1 else w if a == 0 else 0)
                            n = near[b, (x >> _SHIFT) * 9 + (y >> _SHIFT) * 3 + (z >> _SHIFT)]
                            corner[c] = number[n, x & _MASK, y & _MASK, z & _MASK]
                        if not one:
                            corner[1], corner[3] = corner[3], corner[1]
                        d02 = d13 = 0.0
                        for e in range(3):
                            d02 += (points[corner[0], e] - points[corner[2], e]) ** 2
                            d13 += (points[corner[1], e] - points[corner[3], e]) ** 2
                        s = 0 if d02 <= d13 else 1
                        for e in range(2):
                            triangles[made + e, 0] = corner[s]
                            triangles[made + e, 1] = corner[(s + e + 1) % 4]
                            triangles[made + e, 2] = corner[(s + e + 2) % 4]
                        made += 2
    return points, normals, triangles


@dataclass(frozen=True)
class _Lattice:
    """Blocks of the grid round particles: their corners (B, 3) [block], and of each its 27 neighbours, -1 for none.

    order: (n,) particles by block; places (n, 3) [cell] and own (n,) their blocks, both in that order; first (B + 1,):
    where those of each block begin
    """

    blocks: NDArray[np.int64]
    near: NDArray[np.int64]
    order: NDArray[np.int64]
    places: Array
    own: NDArray[np.int64]
    first: NDArray[np.int64]


_AROUND: Final = np.array(list(product((-1, 0, 1), repeat=3)))


def _lattice(places: Array) -> _Lattice:
    corners = np.floor(places / _SIDE).astype(np.int64)
    if np.abs(corners).max(initial=0) >= _FARTHEST:
        raise ValueError(f"matter at {np.abs(places).max():.3g} cells from the origin; allowed: {_SIDE * _FARTHEST}")
    digits = np.array([1 << 42, 1 << 21, 1])
    key = (corners + _FARTHEST) @ digits
    order = np.argsort(key, kind="stable")
    keys = np.unique(np.add.outer(np.unique(key), _AROUND @ digits))
    wanted = np.add.outer(keys, _AROUND @ digits)
    found = np.searchsorted(keys, wanted).clip(max=len(keys) - 1)
    near = np.where(keys[found] == wanted, found, -1)
    blocks = np.stack([keys >> 42, keys >> 21 & (1 << 21) - 1, keys & (1 << 21) - 1], axis=1) - _FARTHEST
    own = np.searchsorted(keys, key[order])
    return _Lattice(blocks, near, order, places[order], own, np.searchsorted(own, np.arange(len(keys) + 1)))


def _kernels(gradient: Array | None, count: int) -> tuple[Array, Array]:
    """For `_splat`: shapes (n, 9) of kernels, and the heights (n,) that make their integrals 1 [1/cell³].

    gradient: F (n, 3, 3), None for I
    """
    wide = RADIUS / CELL
    peak = 315 / (64 * math.pi)  # of (1 - r²)³ in a ball of radius 1
    if gradient is None:
        shape = np.array([1, 0, 0, 1, 0, 1, wide**3, wide**3, wide**3]) / wide**2
        return np.tile(shape, (count, 1)), np.full(count, peak / wide**3)
    squares, axes = np.linalg.eigh(gradient @ gradient.swapaxes(1, 2))
    squares = np.clip(squares, _DRAWN[0] ** 2, _DRAWN[1] ** 2) * wide**2
    inverse = np.einsum("nik,nk,njk->nij", axes, 1 / squares, axes)
    sides = np.sqrt(np.einsum("nik,nk->ni", axes**2, squares))
    shapes = np.concatenate([inverse[:, *np.triu_indices(3)], sides], axis=1)
    return shapes, peak / np.sqrt(squares.prod(axis=1))


@dataclass(frozen=True)
class Field:
    """φ round particles, on its blocks of the grid.

    spacing: of particles at rest [m]; fullness: φ (n,) where they are; volume: Σ J V₀ [m³]
    """

    phi: NDArray[np.float32]
    blocks: NDArray[np.int64]
    near: NDArray[np.int64]
    spacing: float
    fullness: Array
    volume: float

    @classmethod
    def of(cls, points: Array, volumes: Array, spacing: float, gradient: Array | None = None) -> Field:
        """Of particles at (n, 3) [m] that fill volumes (n,) [m³]; n may be 0.

        spacing: of particles at rest [m]; gradient: F (n, 3, 3) of each, None for I. ValueError if the spacing is not
        positive, or values are not finite.
        """
        points, volumes = np.asarray(points, float), np.asarray(volumes, float)
        if not 0 < spacing < math.inf or not np.isfinite(points).all() or not np.isfinite(volumes).all():
            raise ValueError(f"spacing = {spacing} m of {len(points)} particles; allowed: positive, and finite places")
        cell = CELL * spacing
        lattice = _lattice(points / cell)
        blocks, near, places, own = lattice.blocks, lattice.near, lattice.places, lattice.own
        shapes, heights = _kernels(None if gradient is None else gradient[lattice.order], len(points))
        heights *= volumes[lattice.order] / cell**3
        phi = np.zeros((len(blocks), _SIDE, _SIDE, _SIDE), np.float32)
        _splat(places, heights, shapes, own, blocks, near, phi)
        fullness = _sampled(places, own, blocks, near, phi)
        crests = np.clip(_crests(places, fullness, lattice.first, own, near, _REACH / CELL), 1e-3, 1 - 1e-9)
        rim = np.minimum(erf(2 * erfinv(crests)) / 2, _CREST * crests)
        thin = rim < 0.499
        _splat(places[thin], (heights * (0.5 / rim - 1))[thin], shapes[thin], own[thin], blocks, near, phi)
        given = np.empty(len(points))
        given[lattice.order] = fullness
        return cls(phi, blocks, near, spacing, given, float(volumes.sum()))

    def surface(self) -> Mesh:
        """Where φ = 1/2, moved outwards so far that it holds the volume."""
        return _filled(self.level(0.5), self.volume, _SWELL * self.spacing)

    def level(self, height: float) -> Mesh:
        """Where φ has a height: a closed surface round what is higher, or nothing."""
        points, normals, triangles = _nets(self.phi, self.blocks, self.near, height)
        return Mesh(points * CELL * self.spacing, triangles, normals)


def _filled(mesh: Mesh, volume: float, most: float) -> Mesh:
    """A closed mesh moved outwards evenly, by so much [m] at most, that it holds a volume [m³]."""
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    across = np.cross(b - a, c - a)
    lacking = volume - np.einsum("ij,ij->", a, across) / 6
    shift = np.clip(lacking / max(np.linalg.norm(across, axis=1).sum() / 2, 1e-300), -most, most)
    return replace(mesh, points=mesh.points + shift * mesh.normals)


@dataclass(frozen=True)
class _Bonds:
    """Neighbours of particles where they began: pairs (B, 2) of their numbers, and the vectors (B, 3) between [m]."""

    pairs: NDArray[np.int64]
    spans: Array

    @classmethod
    def of(cls, rest: Array, began: NDArray[np.integer[Any]], spacing: float) -> _Bonds:
        """Of particles at rest (n, 3) [m], those which began together (n,) only."""
        apart = 100 * spacing * (1 + np.ptp(rest, axis=0).max() / spacing)
        pairs = cKDTree(np.column_stack([rest, apart * began])).query_pairs(1.3 * spacing, output_type="ndarray")
        return cls(pairs, rest[pairs[:, 1]] - rest[pairs[:, 0]])

    def gradient(self, points: Array, spacing: float) -> Array:
        """F (n, 3, 3) of particles at (n, 3) [m]; I of one without neighbours.

        F minimises Σ w |Δx - F ΔX|² + ε s² |F - I|², w falling to 0 where neighbours are torn apart.
        """
        count = len(points)
        here = (self.pairs < count).all(axis=1)
        pairs, spans = self.pairs[here], self.spans[here]
        now = points[pairs[:, 1]] - points[pairs[:, 0]]
        low, high = (spacing * reach for reach in _TORN)
        weight = np.clip((high - np.linalg.norm(now, axis=1)) / (high - low), 0, 1)
        sums = []
        for left in (now, spans):
            terms = (weight[:, None, None] * left[:, :, None] * spans[:, None, :]).reshape(-1, 9)
            total = [np.bincount(pairs.T.ravel(), np.tile(column, 2), count) for column in terms.T]
            sums.append(np.stack(total, axis=1).reshape(-1, 3, 3) + _STIFF * spacing**2 * np.eye(3))
        return np.asarray(sums[0] @ np.linalg.inv(sums[1]))


@dataclass(frozen=True)
class Finish:
    """How light meets a surface, all from 0 to 1, and whether it is grains that are seen.

    specular, shininess, opacity: as MuJoCo's materials say it; roughness, coat: of a microfacet, and of a clear layer
    over it, in path-traced pictures; brightness: by which a colour is multiplied, so that white keeps its shades
    """

    specular: float
    shininess: float
    roughness: float
    coat: float = 0.0
    opacity: float = 1.0
    brightness: float = 1.0
    grains: bool = False


FINISHES: Final = MappingProxyType({
    "rubber": Finish(0.35, 0.35, roughness=0.35, coat=0.2),
    "clay": Finish(0.08, 0.1, roughness=0.7),
    "honey": Finish(0.9, 0.9, roughness=0.15, coat=1.0, opacity=0.5),
    "paste": Finish(0.3, 0.3, roughness=0.4, coat=0.3, brightness=0.92),
    "sand": Finish(0.05, 0.05, roughness=0.9, grains=True),
})  # fmt: skip
"""By the looks of materials."""

_CORE: Final = 0.75
"""φ inside which translucent matter is so deep that it is opaque: films have no such core."""
_DEEP: Final = (0.92, 0.8, 0.6)
_SHALLOW: Final = (1.08, 1.15, 1.35)
"""Tints of that, and of what is above it."""
TINTS: Final = (
    (1.0, 1.0, 1.0), (1.1, 1.09, 1.06), (0.88, 0.86, 0.83), (0.95, 0.84, 0.74), (1.14, 1.16, 1.22), (0.7, 0.66, 0.62),
)  # fmt: skip
"""Of grains, in their matter's colour: as it is, pale, dim, reddish, quartz, dark."""
_SHARES: Final = (0.3, 0.22, 0.2, 0.13, 0.07, 0.08)
_SHADED: Final = (0.78, 0.76, 0.73)
"""Tint of what is seen between grains."""
_SUNK: Final = 0.25
"""How far below the surface that is [spacing]."""
_BURIED: Final = 0.9
"""φ from which particles have no grains: those are below what is seen between the others."""
_GRAINS: Final = (1, 8, 120_000)
"""Fewest and most to a particle, and about how many there are, were none buried."""
_SHAPES: Final = 64
"""Of grains."""


@dataclass(frozen=True)
class _Grains:
    """The grains that go with particles: offset (n, m, 3) and radius (n, m) [spacing], shape and tint (n, m).

    They follow from a particle's number, so they stay the same ones from picture to picture.
    """

    offset: Array
    radius: Array
    shape: NDArray[np.int64]
    tint: NDArray[np.int64]
    corners: Array
    normals: Array

    @classmethod
    def of(cls, count: int) -> _Grains:
        """Of so many particles."""
        rng = np.random.default_rng(20)
        few, most, total = _GRAINS
        each = int(np.clip(total // max(count, 1), few, most))
        solid = (0.6 / each * 3 / (4 * math.pi)) ** (1 / 3)  # six tenths of the room
        # bipyramids with corners drawn out or in, each turned its own way
        turn = 2 * math.pi / 3 * np.arange(3)
        axes = np.concatenate([np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1), [(0, 0, 1), (0, 0, -1)]])
        faces = np.array([(0, 1, 3), (1, 2, 3), (2, 0, 3), (1, 0, 4), (2, 1, 4), (0, 2, 4)])
        corners = axes * rng.uniform(0.8, 1.6, (_SHAPES, 5, 1)) + rng.uniform(-0.2, 0.2, (_SHAPES, 5, 3))
        corners = np.einsum("sij,skj->ski", Rotation.random(_SHAPES, rng=rng).as_matrix(), corners)[:, faces]
        normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        size = (count, each)
        return cls(
            rng.uniform(-0.45, 0.45, (*size, 3)), solid * rng.lognormal(0, 0.2, size), rng.integers(_SHAPES, size=size),
            rng.choice(len(TINTS), size, p=_SHARES), corners.reshape(_SHAPES, -1, 3),
            np.repeat(normals, 3, axis=1),
        )  # fmt: skip

    def at(self, places: Array, which: NDArray[np.int64], spacing: float, gradient: Array) -> list[Mesh]:
        """Those of some particles, by their numbers (k,), at (k, 3) [m] with F (k, 3, 3): a mesh for each of TINTS."""
        centres = places[:, None] + spacing * np.einsum("kij,kmj->kmi", gradient, self.offset[which])
        shape, tint, radius = self.shape[which], self.tint[which], spacing * self.radius[which]
        found = []
        for number in range(len(TINTS)):
            own = tint == number
            points = centres[own][:, None] + radius[own][:, None, None] * self.corners[shape[own]]
            normals = self.normals[shape[own]].reshape(-1, 3)
            found.append(Mesh(points.reshape(-1, 3), np.arange(len(normals)).reshape(-1, 3), normals))
        return found


@dataclass(frozen=True)
class Layer:
    """What is drawn of a piece of matter in one picture, of one colour: its mesh [m], rgba, finish, segmentation id;
    and whether it lies inside another one, which lets it show through."""

    mesh: Mesh
    rgba: tuple[float, float, float, float]
    finish: Finish
    segmentation: int
    inside: bool = False


@dataclass(frozen=True)
class Particles:
    """A piece of a continuum over time, as it is drawn.

    Args:
        position: (F, n, 3) of its particles at every frame [m].
        stretch: (F, n) their volume, in that at rest.
        present: (F,) how many of the n are there yet.
        bulk: volume of a particle at rest [m³].
        look: one of FINISHES.
        rgba: colour, four numbers from 0 to 1.
        segmentation: id, 1 to 254.
        rest: (n, 3) where each was when it came to be [m], and began: (n,) in which frame; None: as `position` has it.

    Raises:
        ValueError: shapes that do not fit each other, or a look that is not known.
    """

    position: NDArray[np.float32]
    stretch: NDArray[np.float32]
    present: NDArray[np.integer[Any]]
    bulk: float
    look: str
    rgba: tuple[float, float, float, float]
    segmentation: int
    rest: NDArray[np.float32] | None = None
    began: NDArray[np.integer[Any]] | None = None
    _kept: dict[int, tuple[Layer, ...]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        frames, count = self.position.shape[:2]
        if self.position.ndim != 3 or self.position.shape[2] != 3:
            raise ValueError(f"particles at {self.position.shape}; allowed: (F, n, 3)")
        if self.stretch.shape != (frames, count) or self.present.shape != (frames,):
            raise ValueError(
                f"stretch {self.stretch.shape}, present {self.present.shape} of particles; allowed: "
                f"{(frames, count)} and {(frames,)}"
            )
        if self.look not in FINISHES:
            raise ValueError(f"look = {self.look!r}; allowed: {', '.join(FINISHES)}")
        if self.rest is None or self.began is None:
            began = np.searchsorted(self.present, np.arange(count), side="right").clip(max=max(frames - 1, 0))
            object.__setattr__(self, "began", began)
            object.__setattr__(self, "rest", self.position[began, np.arange(count)] if frames else np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.position)

    def part(self, frames: Sequence[int]) -> Particles:
        """Some of its frames, renumbered from 0."""
        some = list(frames)
        return replace(
            self, position=self.position[some], stretch=self.stretch[some], present=self.present[some], rest=self.rest,
            began=self.began,
        )  # fmt: skip

    def extremes(self, frame: int) -> Array:
        """The farthest particles (N, 3) [m] in each of some directions, half a spacing beyond them."""
        points = self.position[frame, : int(self.present[frame])].astype(float)
        if not len(points):
            return np.empty((0, 3))
        ways = _AROUND[_AROUND.any(axis=1)] / np.linalg.norm(_AROUND[_AROUND.any(axis=1)], axis=1, keepdims=True)
        return np.asarray(points[np.argmax(points @ ways.T, axis=0)] + self.bulk ** (1 / 3) / 2 * ways)

    @cached_property
    def _bonds(self) -> _Bonds:
        return _Bonds.of(np.asarray(self.rest, float), np.asarray(self.began), self.bulk ** (1 / 3))

    def at(self, frame: int) -> tuple[Layer, ...]:
        """What of it is drawn at a frame; none if nothing is there yet."""
        if frame not in self._kept:
            while len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[frame] = self._layers(frame)
        return self._kept[frame]

    def surface(self, frame: int) -> Mesh:
        """Its surface at a frame, whatever its look; without triangles if nothing is there yet."""
        return self._field(frame)[0].surface()

    def _field(self, frame: int) -> tuple[Field, Array]:
        """φ, and F (n, 3, 3) of the particles that are there."""
        there = slice(int(self.present[frame]))
        points, spacing = self.position[frame, there].astype(float), self.bulk ** (1 / 3)
        gradient = self._bonds.gradient(points, spacing)
        volumes = self.bulk * self.stretch[frame, there].astype(float)
        return Field.of(points, volumes, spacing, gradient), gradient

    def _layers(self, frame: int) -> tuple[Layer, ...]:
        if not self.present[frame]:
            return ()
        matter, gradient = self._field(frame)
        finish, mesh = FINISHES[self.look], matter.surface()
        if finish.grains:
            ground = replace(mesh, points=mesh.points - _SUNK * matter.spacing * mesh.normals)
            seen = np.flatnonzero(matter.fullness < _BURIED)
            places = self.position[frame, seen].astype(float)
            grains = self._grains.at(places, seen, matter.spacing, gradient[seen])
            tinted = (self._layer(some, tint) for some, tint in zip(grains, TINTS, strict=True))
            return self._layer(ground, _SHADED), *tinted
        if finish.opacity < 1:
            core = replace(self._layer(matter.level(_CORE), _DEEP), inside=True)
            return core, self._layer(mesh, _SHALLOW, finish.opacity)
        return (self._layer(mesh),)

    def _layer(self, mesh: Mesh, tint: tuple[float, float, float] = (1.0, 1.0, 1.0), opacity: float = 1.0) -> Layer:
        finish = FINISHES[self.look]
        red, green, blue = (
            min(part * finish.brightness * own, 1.0) for part, own in zip(tint, self.rgba, strict=False)
        )
        return Layer(mesh, (red, green, blue, opacity * self.rgba[3]), finish, self.segmentation)

    @cached_property
    def _grains(self) -> _Grains:
        return _Grains.of(self.position.shape[1])
