"""Closed triangle meshes from outside: what is accepted, what is inside, how far it is to the surface.

A mesh is accepted if it is the boundary of a solid: each edge joins two triangles that run along it in opposite
senses, no triangle touches one that it has no corner in common with, and every shell is turned the right way for where
it lies (outwards in the open or in the cavity of another, inwards as the wall of a cavity). Nothing is repaired.

Sources: C. Ericson, Real-Time Collision Detection (2005), §5.1.5 (the nearest point of a triangle); A. Van Oosterom,
J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125 (solid angle); J. O'Rourke, Computational Geometry in C (1998),
§7.4 (parity of crossings).

Defects: two triangles folded flat onto each other over a common edge pass (they enclose nothing); corners are one if
their coordinates are the same bits, so meshes whose seams are only close are refused as open; fans of some 15 000
triangles about one corner are refused as too tangled to be checked.
"""

from __future__ import annotations

import io
import math
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from physinone_mj.base import Refusal

Array = NDArray[np.float64]

FORMATS: Final = ("stl", "obj", "ply", "off")
MOST_BYTES: Final = 64 * 2**20
MOST_TRIANGLES: Final = 200_000
MOST_SHELLS: Final = 1000
MOST_NODES: Final = 2**26
"""Of a distance field."""
_LEAST_VOLUME: Final = 1e-9
_MOST_PAIRS: Final = 300_000_000
"""Of triangles compared in the search for crossings."""
_BLUR: Final = 1e-10
"""Part of its size by which a mesh is shaken in that search, so that no edge meets another edge exactly."""
_BAND: Final = 3
"""How far from the surface every triangle is asked for its distance [spacing]."""


@dataclass(frozen=True)
class DistanceField:
    """Signed distance to a surface, negative inside, at the nodes of a grid.

    values: (nx, ny, nz) single precision [m]; origin: (3,), the place of values[0, 0, 0] [m]; spacing: of the nodes [m]
    """

    values: NDArray[np.float32]
    origin: Array
    spacing: float

    def at(self, points: Array) -> tuple[Array, Array]:
        """Distance (n,) [m] and its gradient (n, 3), trilinear between nodes; beyond the grid, that of its margin."""
        return _interpolate(self.values, self.origin, self.spacing, np.ascontiguousarray(points, float))


def read(path: Path) -> trimesh.Trimesh:
    """The closed mesh in a file, as it is there: geometry only, nothing that the file points at is opened.

    ValueError if the file is missing, not a plain file, too large, of a format not allowed or not readable; or if what
    it holds is not sound, see `sound`.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(f"mesh {path}: format {kind!r}; allowed: {', '.join(FORMATS)}")
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise ValueError(f"mesh {path}: not a plain file")
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1) if status.st_size <= MOST_BYTES else b""
    except OSError as why:
        raise ValueError(f"mesh {path}: {why.strerror or why}") from None
    if status.st_size > MOST_BYTES or len(data) > MOST_BYTES:
        raise ValueError(f"mesh {path}: {status.st_size / 2**20:.1f} MiB; allowed: {MOST_BYTES // 2**20} MiB")
    try:
        loaded: Any = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)
        corners, faces = np.asarray(loaded.vertices, float), np.asarray(loaded.faces, np.int64)
    except Exception as why:  # whatever a parser makes of bytes that are not what they claim to be
        said = " ".join(str(why).split())[:100]
        raise ValueError(f"mesh {path}: not readable as {kind} ({type(why).__name__}: {said})") from None
    if not np.isfinite(corners).all():
        raise ValueError(f"mesh {path}: {np.count_nonzero(~np.isfinite(corners).all(axis=1))} corners are not finite")
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(corners)):
        raise ValueError(f"mesh {path}: a triangle names corner {faces.max()}; allowed: 0 to {len(corners) - 1}")
    mesh = _welded(corners, faces)
    sound(mesh, str(path))
    return mesh


def _welded(corners: Array, faces: NDArray[np.int64]) -> trimesh.Trimesh:
    """Corners of the same coordinates made one, triangles with a corner twice and corners of none left out."""
    used, where = np.unique(corners[faces.ravel()].reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    faces = where.reshape(-1, 3)
    a, b, c = faces.T
    return trimesh.Trimesh(used, faces[(a != b) & (b != c) & (c != a)], process=False)


def sound(mesh: trimesh.Trimesh, name: str) -> None:
    """ValueError, which names the mesh and what is wrong, unless it is the boundary of a solid."""
    corners, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    if not len(faces):
        raise ValueError(f"mesh {name}: has no triangles")
    if len(faces) > MOST_TRIANGLES:
        raise ValueError(f"mesh {name}: {len(faces)} triangles; allowed: {MOST_TRIANGLES}")
    if not np.isfinite(corners).all():
        raise ValueError(f"mesh {name}: a corner is not finite")
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    if (count == 1).any():
        raise ValueError(f"mesh {name}: is open, {np.count_nonzero(count == 1)} of its edges bound one triangle only")
    if (count != 2).any():
        raise ValueError(f"mesh {name}: {np.count_nonzero(count != 2)} of its edges join more than two triangles")
    if np.bincount(edge.ravel(), np.where(ends[:, 0] < ends[:, 1], 1, -1)).any():
        raise ValueError(f"mesh {name}: its triangles are not turned alike (some outwards, some inwards)")
    first = np.argsort(edge.ravel(), kind="stable").reshape(-1, 2) // 3
    size = float(np.ptp(corners[np.unique(faces)], axis=0).max())
    if size == 0:
        raise ValueError(f"mesh {name}: encloses no volume, all its corners are one")
    shells, shell = connected_components(coo_array((np.ones(len(first)), first.T), (len(faces), len(faces))))
    if shells > MOST_SHELLS:
        raise ValueError(f"mesh {name}: {shells} separate shells; allowed: {MOST_SHELLS}")
    shaken = np.random.default_rng(0).uniform(-_BLUR, _BLUR, corners.shape) * size
    one, other, pairs = _crossing(corners + shaken, faces)
    if one >= 0:
        at = corners[faces[one]].mean(axis=0)
        raise ValueError(f"mesh {name}: touches or crosses itself, triangle {one} and {other}, near {_place(at)} m")
    if pairs > _MOST_PAIRS:
        raise ValueError(f"mesh {name}: too tangled to be checked; allowed: {_MOST_PAIRS:.0e} neighbouring triangles")
    triangles = (corners - corners.min(axis=0))[faces] / size
    volumes = np.bincount(shell, np.linalg.det(triangles) / 6)
    if (np.abs(volumes) < _LEAST_VOLUME).any():
        raise ValueError(f"mesh {name}: encloses no volume (a shell of less than {_LEAST_VOLUME} of its size cubed)")
    for i, enclosed in enumerate(volumes):
        mine = shell == i
        around = round(float(_winding(triangles[~mine], triangles[mine][0].mean(axis=0)))) if shells > 1 else 0
        if around != (0 if enclosed > 0 else 1):
            wrong = "inside out" if around in (0, -1) else "inside another one that is solid there"
            raise ValueError(f"mesh {name}: the shell near {_place(corners[faces[mine][0, 0]])} m is {wrong}")


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in point) + ")"


@njit(cache=True)
def _winding(triangles: Array, point: Array) -> float:
    """How many times the triangles (n, 3, 3) go around a point."""
    total = 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0] - point, triangles[t, 1] - point, triangles[t, 2] - point
        la, lb, lc = np.sqrt((a * a).sum()), np.sqrt((b * b).sum()), np.sqrt((c * c).sum())
        up = (a * np.cross(b, c)).sum()
        total += np.arctan2(up, la * lb * lc + (a * b).sum() * lc + (b * c).sum() * la + (c * a).sum() * lb)
    return float(total / (2 * np.pi))


@njit(cache=True)
def _pierces(x: Array, p: int, q: int, a: int, b: int, c: int) -> bool:
    """Whether the edge p-q goes through the inside of the triangle a, b, c."""
    if p in (a, b, c) or q in (a, b, c):
        return False
    ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    vx, vy, vz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    px, py, pz = x[p, 0] - x[a, 0], x[p, 1] - x[a, 1], x[p, 2] - x[a, 2]
    qx, qy, qz = x[q, 0] - x[a, 0], x[q, 1] - x[a, 1], x[q, 2] - x[a, 2]
    above, below = nx * px + ny * py + nz * pz, nx * qx + ny * qy + nz * qz
    if not (above < 0 < below or below < 0 < above):
        return False
    t = above / (above - below)
    mx, my, mz = px + t * (qx - px), py + t * (qy - py), pz + t * (qz - pz)
    along = nx * (my * vz - mz * vy) + ny * (mz * vx - mx * vz) + nz * (mx * vy - my * vx)
    across = nx * (uy * mz - uz * my) + ny * (uz * mx - ux * mz) + nz * (ux * my - uy * mx)
    return bool(along > 0 and across > 0 and along + across < nx * nx + ny * ny + nz * nz)


@njit(cache=True)
def _crossing(x: Array, faces: NDArray[np.int64]) -> tuple[int, int, int]:
    """(a triangle, another that it crosses, pairs compared); (-1, -1, .) if there is none."""
    count = len(faces)
    low, high = np.empty((count, 3)), np.empty((count, 3))
    for t in range(count):
        for k in range(3):
            a, b, c = x[faces[t, 0], k], x[faces[t, 1], k], x[faces[t, 2], k]
            low[t, k], high[t, k] = min(a, b, c), max(a, b, c)
    origin, reach = np.empty(3), np.empty(3)
    begin, end = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        origin[k] = low[:, k].min()
        reach[k] = high[:, k].max() - origin[k]
    size = max((high - low).sum() / (3 * count), reach.max() / 256)
    while True:  # cells large enough that all triangles together lie in few
        places = 0.0
        for t in range(count):
            here = 1.0
            for k in range(3):
                here *= 2 + (high[t, k] - low[t, k]) / size
            places += here
        if places < 64 * count + 1000:
            break
        size *= 1.3
    n = (reach / size).astype(np.int64) + 1
    start = np.zeros(n[0] * n[1] * n[2] + 1, np.int64)
    listed = np.empty(0, np.int64)
    for turn in range(2):
        for t in range(count):
            for k in range(3):
                begin[k], end[k] = int((low[t, k] - origin[k]) / size), int((high[t, k] - origin[k]) / size)
            for i in range(begin[0], end[0] + 1):
                for j in range(begin[1], end[1] + 1):
                    for k in range(begin[2], end[2] + 1):
                        cell = (i * n[1] + j) * n[2] + k
                        if turn == 0:
                            start[cell + 1] += 1
                        else:
                            start[cell] -= 1
                            listed[start[cell]] = t
        if turn == 0:
            for cell in range(len(start) - 1):
                start[cell + 1] += start[cell]
            listed = np.empty(start[-1], np.int64)
            start[:-1] = start[1:]
    pairs = 0
    for cell in range(len(start) - 1):
        here = start[cell + 1] - start[cell]
        pairs += here * (here - 1) // 2
        if pairs > _MOST_PAIRS:
            return -1, -1, pairs
        for m in range(start[cell], start[cell + 1]):
            s = listed[m]
            for o in range(m + 1, start[cell + 1]):
                t = listed[o]
                if (
                    low[s, 0] > high[t, 0] or low[t, 0] > high[s, 0] or low[s, 1] > high[t, 1]
                    or low[t, 1] > high[s, 1] or low[s, 2] > high[t, 2] or low[t, 2] > high[s, 2]
                ):  # fmt: skip
                    continue
                for e in range(3):
                    f = (e + 1) % 3
                    if _pierces(x, faces[s, e], faces[s, f], faces[t, 0], faces[t, 1], faces[t, 2]) or _pierces(
                        x, faces[t, e], faces[t, f], faces[s, 0], faces[s, 1], faces[s, 2]
                    ):
                        return s, t, pairs
    return -1, -1, pairs


@njit(cache=True)
def _over(x: Array, a: int, b: int, c: int, px: float, py: float) -> tuple[bool, float]:
    """Whether the upright line through (px, py) meets the triangle, and at what height.

    An edge's two triangles reckon with it in the same order of its ends, so that the line meets just one of them.
    """
    odd = False
    for e in range(3):
        p, q = (a, b) if e == 0 else ((b, c) if e == 1 else (c, a))
        if (x[p, 1] > py) != (x[q, 1] > py):
            if p > q:
                p, q = q, p
            if px < x[p, 0] + (x[q, 0] - x[p, 0]) * ((py - x[p, 1]) / (x[q, 1] - x[p, 1])):
                odd = not odd
    if not odd:
        return False, 0.0
    ux, uy, vx, vy = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[c, 0] - x[a, 0], x[c, 1] - x[a, 1]
    area = ux * vy - uy * vx
    lowest = min(x[a, 2], x[b, 2], x[c, 2])
    highest = max(x[a, 2], x[b, 2], x[c, 2])
    if area == 0.0:
        return True, 0.5 * (lowest + highest)
    s = ((px - x[a, 0]) * vy - (py - x[a, 1]) * vx) / area
    t = (ux * (py - x[a, 1]) - uy * (px - x[a, 0])) / area
    height = x[a, 2] + s * (x[b, 2] - x[a, 2]) + t * (x[c, 2] - x[a, 2])
    return True, min(max(height, lowest), highest)


@njit(cache=True)
def _inside(x: Array, faces: NDArray[np.int64], points: Array) -> NDArray[np.bool_]:
    """Parity of the crossings above each point; triangles are listed by squares of the floor that they lie over."""
    count = len(faces)
    side = max(1, min(1024, int(np.sqrt(count))))
    ox, oy = x[:, 0].min(), x[:, 1].min()
    wx, wy = (x[:, 0].max() - ox) / side, (x[:, 1].max() - oy) / side
    start = np.zeros(side * side + 1, np.int64)
    listed = np.empty(0, np.int64)
    for turn in range(2):
        for t in range(count):
            a, b, c = faces[t]
            i0 = min(max(int((min(x[a, 0], x[b, 0], x[c, 0]) - ox) / wx - 1e-9), 0), side - 1)
            i1 = min(max(int((max(x[a, 0], x[b, 0], x[c, 0]) - ox) / wx + 1e-9), 0), side - 1)
            j0 = min(max(int((min(x[a, 1], x[b, 1], x[c, 1]) - oy) / wy - 1e-9), 0), side - 1)
            j1 = min(max(int((max(x[a, 1], x[b, 1], x[c, 1]) - oy) / wy + 1e-9), 0), side - 1)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    if turn == 0:
                        start[i * side + j + 1] += 1
                    else:
                        start[i * side + j] -= 1
                        listed[start[i * side + j]] = t
        if turn == 0:
            for cell in range(side * side):
                start[cell + 1] += start[cell]
            listed = np.empty(start[-1], np.int64)
            start[:-1] = start[1:]
    result = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        px, py, pz = points[p]
        i, j = int(np.floor((px - ox) / wx)), int(np.floor((py - oy) / wy))
        if i < 0 or j < 0 or i > side or j > side:
            continue
        cell = min(i, side - 1) * side + min(j, side - 1)
        for m in range(start[cell], start[cell + 1]):
            a, b, c = faces[listed[m]]
            meets, height = _over(x, a, b, c, px, py)
            if meets and height > pz:
                result[p] = not result[p]
    return result


def contains(mesh: trimesh.Trimesh, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 3) [m] a sound mesh encloses; one within round-off of the surface may count as either."""
    corners, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    inner: NDArray[np.bool_] = _inside(corners, faces, np.ascontiguousarray(points, float))
    return inner


@njit(cache=True)
def _square_distance(x: Array, a: int, b: int, c: int, px: float, py: float, pz: float) -> float:
    """Of a point to a triangle, squared: by the region of the triangle that it lies over."""
    ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    vx, vy, vz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    wx, wy, wz = px - x[a, 0], py - x[a, 1], pz - x[a, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d1, d2 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    d3, d4 = d1 - uu, d2 - uv  # seen from b
    d5, d6 = d1 - uv, d2 - vv  # seen from c
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        s, t = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        s, t = d1 / (d1 - d3), 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1 - t
    else:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    gx, gy, gz = wx - s * ux - t * vx, wy - s * uy - t * vy, wz - s * uz - t * vz
    return float(gx * gx + gy * gy + gz * gz)


@njit(cache=True)
def _band(
    x: Array, faces: NDArray[np.int64], origin: Array, spacing: float, n: NDArray[np.int64], reach: float
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.bool_]]:
    """Within `reach` of the surface: distance squared, and the nearest triangle (-1 beyond); everywhere: inside?"""
    square = np.full((n[0], n[1], n[2]), np.float32(np.inf))
    nearest = np.full((n[0], n[1], n[2]), np.int32(-1))
    odd = np.zeros((n[0], n[1], n[2]), np.bool_)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in range(len(faces)):
        a, b, c = faces[t]
        for k in range(3):
            least, most = min(x[a, k], x[b, k], x[c, k]), max(x[a, k], x[b, k], x[c, k])
            low[k] = max(int(np.floor((least - reach - origin[k]) / spacing)), 0)
            high[k] = min(int(np.ceil((most + reach - origin[k]) / spacing)), n[k] - 1)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                px, py = origin[0] + i * spacing, origin[1] + j * spacing
                for k in range(low[2], high[2] + 1):
                    d = _square_distance(x, a, b, c, px, py, origin[2] + k * spacing)
                    if d <= reach * reach and d < square[i, j, k]:
                        square[i, j, k], nearest[i, j, k] = d, t
                meets, height = _over(x, a, b, c, px, py)
                if meets:
                    top = min(int(np.ceil((height - origin[2]) / spacing)) - 1, n[2] - 1)
                    if top >= 0:
                        odd[i, j, top] = not odd[i, j, top]
    for i in range(n[0]):
        for j in range(n[1]):
            for k in range(n[2] - 2, -1, -1):
                odd[i, j, k] = odd[i, j, k] != odd[i, j, k + 1]
    return square, nearest, odd


@njit(cache=True)
def _far(
    x: Array, faces: NDArray[np.int64], origin: Array, spacing: float, square: NDArray[np.float32],
    nearest: NDArray[np.int32], source: NDArray[np.int32],
) -> None:  # fmt: skip
    """Beyond the band: the distance to the triangle that is nearest to the nearest node of the band."""
    for i in range(square.shape[0]):
        for j in range(square.shape[1]):
            for k in range(square.shape[2]):
                if nearest[i, j, k] < 0:
                    a, b, c = faces[nearest[source[0, i, j, k], source[1, i, j, k], source[2, i, j, k]]]
                    square[i, j, k] = _square_distance(
                        x, a, b, c, origin[0] + i * spacing, origin[1] + j * spacing, origin[2] + k * spacing
                    )


def signed_distance_grid(mesh: trimesh.Trimesh, spacing: float, margin: int = 4, name: str = "given") -> DistanceField:
    """The signed distance [m] around a closed mesh, on nodes `spacing` [m] apart, `margin` of them beyond its box.

    Exact (to single precision) within three spacings of the surface; further away its size is never too small, and too
    large by about a spacing at most (0.8 at the middle of a box). Sign: parity of the crossings of upright lines.
    Refusal R10 if that makes too many nodes, ValueError if the mesh is not sound.
    """
    if not 0 < spacing < np.inf:
        raise ValueError(f"spacing = {spacing} m of a distance field; allowed: positive")
    sound(mesh, name)
    corners, faces = np.ascontiguousarray(mesh.vertices, float), np.ascontiguousarray(mesh.faces, np.int64)
    low, high = corners.min(axis=0), corners.max(axis=0)
    n = np.ceil((high - low) / spacing) + 2 * margin + 1
    if np.prod(n) > MOST_NODES:
        coarse = spacing * (np.prod(n) / MOST_NODES) ** (1 / 3)
        raise Refusal("R10", f"mesh {name}: a distance field of {np.prod(n):.3g} nodes; allowed: {MOST_NODES:.3g}, "
                             f"as of a spacing of some {coarse:.3g} m")  # fmt: skip
    whole = n.astype(np.int64)
    origin = (low + high - (whole - 1) * spacing) / 2
    square, nearest, odd = _band(corners, faces, origin, spacing, whole, _BAND * spacing)
    if (nearest < 0).any():
        _, source = distance_transform_edt(nearest < 0, return_indices=True)
        _far(corners, faces, origin, spacing, square, nearest, np.asarray(source, np.int32))
    values = np.sqrt(square)
    return DistanceField(np.where(odd, -values, values), origin, spacing)


@njit(cache=True)
def _interpolate(values: NDArray[np.float32], origin: Array, spacing: float, points: Array) -> tuple[Array, Array]:
    distance, slope = np.empty(len(points)), np.empty((len(points), 3))
    base, f = np.empty(3, np.int64), np.empty(3)
    for p in range(len(points)):
        for k in range(3):
            at = min(max((points[p, k] - origin[k]) / spacing, 0.0), values.shape[k] - 1.0)
            base[k] = min(int(at), values.shape[k] - 2)
            f[k] = at - base[k]
        total, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
        for i in range(2):
            for j in range(2):
                for k in range(2):
                    v = values[base[0] + i, base[1] + j, base[2] + k]
                    wx = f[0] if i else 1 - f[0]
                    wy = f[1] if j else 1 - f[1]
                    wz = f[2] if k else 1 - f[2]
                    total += wx * wy * wz * v
                    gx += (2 * i - 1) * wy * wz * v
                    gy += wx * (2 * j - 1) * wz * v
                    gz += wx * wy * (2 * k - 1) * v
        distance[p], slope[p, 0], slope[p, 1], slope[p, 2] = total, gx / spacing, gy / spacing, gz / spacing
    return distance, slope


@njit(cache=True)
def _through(x: Array, faces: NDArray[np.int64], start: Array, along: Array) -> tuple[Array, Array]:
    """How far each ray goes before it leaves the solid (infinite if it does not), and the cosine at which it does."""
    result, straight = np.full(len(start), np.inf), np.zeros(len(start))
    for t in range(len(faces)):
        a, b, c = x[faces[t, 0]], x[faces[t, 1]], x[faces[t, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for r in range(len(start)):
            dx, dy, dz = along[r]
            facing = dx * nx + dy * ny + dz * nz
            if facing <= 0:  # it leaves the solid
                continue
            px, py, pz = a[0] - start[r, 0], a[1] - start[r, 1], a[2] - start[r, 2]
            height = px * nx + py * ny + pz * nz
            if height < 0 or height >= result[r] * facing:
                continue
            mx, my, mz = py * dz - pz * dy, pz * dx - px * dz, px * dy - py * dx
            s, t_ = vx * mx + vy * my + vz * mz, -(ux * mx + uy * my + uz * mz)
            if s >= -1e-9 * facing and t_ >= -1e-9 * facing and s + t_ <= (1 + 2e-9) * facing:
                result[r] = height / facing
                straight[r] = facing / np.sqrt(nx * nx + ny * ny + nz * nz)
    return result, straight


def thickness(mesh: trimesh.Trimesh, rays: int = 1000) -> float:
    """How thick a sound mesh is [m]: straight through, from a face to the next, all but its thinnest 5 % of surface.

    Only what lies between faces within 45 degrees of parallel is thin; what is thin elsewhere is an edge or a tip, and
    every cube has those. Of a mesh that is nothing but edges (a tetrahedron) the median. By rays from places spread
    evenly over the surface; so a thin part of less than 5 % of the surface is not seen.
    """
    corners, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    rng = np.random.default_rng(0)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    edge = np.cumsum(area) / area.sum()
    chosen = np.minimum(np.searchsorted(edge, (np.arange(rays) + rng.random()) / rays), len(faces) - 1)
    s, t = rng.random((2, rays, 1))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    start = a[chosen] + s * (b - a)[chosen] + t * (c - a)[chosen]
    through, straight = _through(corners, faces, start, -normal[chosen] / area[chosen, None])
    least = float(np.quantile(np.where(straight > math.sqrt(0.5), through, np.inf), 0.05, method="lower"))
    return least if least < np.inf else float(np.median(through))
