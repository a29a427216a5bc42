"""Particles to grid and back: MLS-MPM with quadratic B-splines and affine velocities, on the CPU.

    grid      p_i = Σ w_ip (m v_p + A_p (x_i - x_p)),  m_i = Σ w_ip m,  A_p = m C_p - Δt V₀ (4/Δx²) τ_p
    velocity  v_i = p_i/m_i + Δt g, then what it meets
    particle  v_p = Σ w_ip v_i,  C_p = (4/Δx²) Σ w_ip v_i ⊗ (x_i - x_p),  x_p += Δt v_p

where velocities are those of a step's middle, as a leapfrog's: the first step has half of g.

Source: Y. Hu et al., ACM Trans. Graph. 37 (2018) 150, eq. 16-29 (MLS-MPM); C. Jiang et al., J. Comput. Phys. 338 (2017)
137 (affine velocities, which keep linear and angular momentum).

Particles lie sorted by blocks of 4³ cells. Blocks of one of eight colours are at least 8 cells apart, and a particle
may drift by a cell before they are sorted again: so blocks of one colour scatter side by side with plain additions, in
an order that no number of threads changes. Only blocks that particles can touch are cleared and advanced. The grid's
nodes are multiples of Δx from the world's origin, wherever it begins and however far it reaches; it grows with the
motion.

Defects: explicit, stable below `longest_step` only; affine velocities damp shear as if by a viscosity, some 10 Pa s at
Δx = 1/64 m and 1000 kg/m³; what is more than two cells apart has separated; bodies that share a node stick together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from physinone_mj.continuum import Material

from ._ti import kernels, ti
from .collide import Bearer, begin
from .materials import law

Array = NDArray[np.float64]

_SIDE: Final = 4
"""Of a block [cell]."""
_MARGIN: Final = 2
"""Blocks of the grid around those that hold particles, at least."""
_ROOM: Final = 4
"""Blocks around them when it is made anew."""
_COURANT: Final = 0.3
"""Part of a cell that sound and motion together may cross in a step."""
_VISCOUS: Final = 0.1
"""Part of ρ Δx²/η that a step may be."""
_MOST_NODES: Final = 2**28


@kernels
def _particle_kernels(law: Any, real: Any, state: int) -> Any:
    """(scatter, gather) for one material's law at a precision."""
    width = 15 + state
    record, node = ti.types.vector(width, real), ti.types.vector(4, real)
    whole = ti.types.ndarray(dtype=ti.i32, ndim=1)
    records = ti.types.ndarray(dtype=record, ndim=1)
    nodes = ti.types.ndarray(dtype=node, ndim=1)
    place, numbers = ti.types.vector(3, real), ti.types.vector(4, real)
    inner = ti.types.vector(state, real)

    @ti.kernel
    def scatter(
        rec: records, grid: nodes, first: whole, blocks: whole, low: ti.i32, high: ti.i32, ny: ti.i32, nz: ti.i32,
        origin: place, cells: real, mass: real,
    ):  # fmt: skip
        for a in range(low, high):
            b = blocks[a]
            for p in range(first[b], first[b + 1]):
                r = rec[p]
                x = (ti.Vector([r[0], r[1], r[2]]) - origin) * cells
                base = ti.cast(x - 0.5, ti.i32)
                f = x - ti.cast(base, real)
                wy = ti.Vector([0.5 * (1.5 - f[1]) ** 2, 0.75 - (f[1] - 1) ** 2, 0.5 * (f[1] - 0.5) ** 2])
                wz = ti.Vector([0.5 * (1.5 - f[2]) ** 2, 0.75 - (f[2] - 1) ** 2, 0.5 * (f[2] - 0.5) ** 2])
                ax = ti.Vector([r[6], r[9], r[12], 0.0])
                ay = ti.Vector([r[7], r[10], r[13], 0.0])
                az = ti.Vector([r[8], r[11], r[14], 0.0])
                q = ti.Vector([mass * r[3], mass * r[4], mass * r[5], mass]) - f[0] * ax - f[1] * ay - f[2] * az
                here = (base[0] * ny + base[1]) * nz + base[2]
                for i in range(3):
                    wx = 0.5 * (1.5 - f[0]) ** 2
                    if i == 1:
                        wx = 0.75 - (f[0] - 1) ** 2
                    if i == 2:
                        wx = 0.5 * (f[0] - 0.5) ** 2
                    qx = q + ti.cast(i, real) * ax
                    row = here + i * ny * nz
                    for j in ti.static(range(3)):
                        qy = qx + j * ay
                        w = wx * wy[j]
                        for k in ti.static(range(3)):
                            n = row + j * nz + k
                            grid[n] = grid[n] + (w * wz[k]) * (qy + k * az)

    @ti.kernel
    def gather(
        rec: records, grid: nodes, count: ti.i32, ny: ti.i32, nz: ti.i32, origin: place, cells: real, dt: real,
        mass: real, volume: real, k: numbers,
    ) -> real:  # fmt: skip
        fastest = ti.cast(0.0, real)
        for p in range(count):
            r = rec[p]
            x = (ti.Vector([r[0], r[1], r[2]]) - origin) * cells
            base = ti.cast(x - 0.5, ti.i32)
            f = x - ti.cast(base, real)
            wy = ti.Vector([0.5 * (1.5 - f[1]) ** 2, 0.75 - (f[1] - 1) ** 2, 0.5 * (f[1] - 0.5) ** 2])
            wz = ti.Vector([0.5 * (1.5 - f[2]) ** 2, 0.75 - (f[2] - 1) ** 2, 0.5 * (f[2] - 0.5) ** 2])
            here = (base[0] * ny + base[1]) * nz + base[2]
            v = ti.Vector.zero(real, 4)
            bx = ti.Vector.zero(real, 4)
            by = ti.Vector.zero(real, 4)
            bz = ti.Vector.zero(real, 4)
            for i in range(3):
                wx = 0.5 * (1.5 - f[0]) ** 2
                if i == 1:
                    wx = 0.75 - (f[0] - 1) ** 2
                if i == 2:
                    wx = 0.5 * (f[0] - 0.5) ** 2
                row = here + i * ny * nz
                sum_ = ti.Vector.zero(real, 4)
                for j in ti.static(range(3)):
                    line = wz[0] * grid[row + j * nz]
                    one = wz[1] * grid[row + j * nz + 1]
                    two = wz[2] * grid[row + j * nz + 2]
                    line += one + two
                    line *= wy[j]
                    sum_ += line
                    by += (wx * j) * line
                    bz += (wx * wy[j]) * (one + 2 * two)
                v += wx * sum_
                bx += (ti.cast(i, real) * wx) * sum_
            bx -= f[0] * v
            by -= f[1] * v
            bz -= f[2] * v
            spread = 4.0 * cells
            c = spread * ti.Matrix([[bx[0], by[0], bz[0]], [bx[1], by[1], bz[1]], [bx[2], by[2], bz[2]]])
            s = inner(0.0)
            for i in ti.static(range(state)):
                s[i] = r[15 + i]
            s, tau = law(s, dt * c, dt, k)
            a = (mass / cells) * c - (dt * volume * spread) * tau
            speed = ti.cast(0.0, real)
            for i in ti.static(range(3)):
                r[i] = r[i] + dt * v[i]
                r[3 + i] = v[i]
                speed = ti.max(speed, ti.abs(v[i]))
                for j in ti.static(range(3)):
                    r[6 + 3 * i + j] = a[i, j]
            for i in ti.static(range(state)):
                r[15 + i] = s[i]
            rec[p] = r
            ti.atomic_max(fastest, speed)
        return fastest

    return scatter, gather


@kernels
def _grid_kernels(real: Any) -> Any:
    """(clear, advance) of the grid's active blocks."""
    node = ti.types.vector(4, real)
    whole, nodes = ti.types.ndarray(dtype=ti.i32, ndim=1), ti.types.ndarray(dtype=node, ndim=1)

    @ti.kernel
    def clear(grid: nodes, blocks: whole, count: ti.i32, ny: ti.i32, nz: ti.i32):
        for a in range(count):
            x, y, z = begin(blocks[a], ny, nz)
            for i in range(4):
                for j in range(4):
                    here = ((x + i) * ny + y + j) * nz + z
                    for k in ti.static(range(4)):
                        grid[here + k] = node(0.0)

    @ti.kernel
    def advance(grid: nodes, blocks: whole, count: ti.i32, ny: ti.i32, nz: ti.i32, kick: ti.types.vector(3, real)):
        for a in range(count):
            x, y, z = begin(blocks[a], ny, nz)
            for i in range(4):
                for j in range(4):
                    here = ((x + i) * ny + y + j) * nz + z
                    for k in ti.static(range(4)):
                        g = grid[here + k]
                        if g[3] > 0:
                            inverse = 1 / g[3]
                            grid[here + k] = ti.Vector([
                                g[0] * inverse + kick[0], g[1] * inverse + kick[1], g[2] * inverse + kick[2], g[3],
                            ])  # fmt: skip

    return clear, advance


@njit(cache=True)
def _sort(rec: Any, spare: Any, order: Any, first: Any, origin: Any, cells: float, by: int, bz: int) -> None:
    """Stable counting sort of records (n, k) by block into spare; first (blocks + 1,): where those of each begin.

    order: (n,) which of the given particles each record is; sorted with them
    """
    count = rec.shape[0]
    key = np.empty(count, np.int32)
    first[:] = 0
    for p in range(count):
        x = int((rec[p, 0] - origin[0]) * cells - 0.5) // 4
        y = int((rec[p, 1] - origin[1]) * cells - 0.5) // 4
        z = int((rec[p, 2] - origin[2]) * cells - 0.5) // 4
        key[p] = (x * by + y) * bz + z
        first[key[p] + 1] += 1
    for b in range(len(first) - 1):
        first[b + 1] += first[b]
    next_, sorted_ = first[:-1].copy(), np.empty_like(order)
    for p in range(count):
        to = next_[key[p]]
        next_[key[p]] = to + 1
        spare[to] = rec[p]
        sorted_[to] = order[p]
    order[:] = sorted_


@dataclass(frozen=True)
class Body:
    """A piece of matter: its particles (n, 3) [m], each of a volume [m³], and their velocity, (3,) or (n, 3) [m/s]."""

    material: Material
    points: Array
    volume: float
    velocity: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        points = np.asarray(self.points)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise ValueError(f"points = {points.shape} of a body; allowed: (n, 3), finite, n at least 1")
        if not 0 < self.volume < math.inf:
            raise ValueError(f"volume = {self.volume} m³ of a particle; allowed: positive")


def longest_step(bodies: Sequence[Body], dx: float, speed: float = 0.0) -> float:
    """Longest stable step [s] while nothing is faster than a speed [m/s] and little compressed."""
    steps = [math.inf]
    for body in bodies:
        material = body.material
        sound = math.sqrt(material.stiffness() / material.density)
        steps.append(_COURANT * dx / (sound + speed))
        if material.thickness() > 0:
            steps.append(_VISCOUS * dx**2 * material.density / material.thickness())
    return min(steps)


class _Cloud:
    """The particles of one body as the kernels have them, sorted by block."""

    def __init__(self, body: Body, dtype: Any) -> None:
        self.material, self.volume = body.material, body.volume
        self.mass = body.volume * body.material.density
        self.records = np.zeros((len(body.points), 15 + body.material.state), dtype)
        self.records[:, :3] = body.points
        self.records[:, 3:6] = body.velocity
        self.spare = np.empty_like(self.records)
        self.order = np.arange(len(body.points))
        self.first = np.zeros(1, np.int32)
        self.blocks = np.zeros(0, np.int32)
        self.starts: list[int] = []
        self.ahead = np.zeros(3)  # half a step's change of velocity, from the last one's middle to its end

    def momentum(self) -> Array:
        """Σ m v of the velocities that there are (3,) [kg m/s]."""
        return np.asarray(self.mass * self.records[:, 3:6].sum(axis=0, dtype=float))


class Solver:
    """Several bodies on one grid. Taichi has to be started, with `default_fp` that of the precision.

    Args:
        bodies: what there is.
        dx: side of a cell [m].
        gravity: (3,) [m/s²]; may be set anew at any time.
        bearers: what stands in the way; after each step they are where they then are.
        period: length after which the world repeats itself along each axis [m], whole cells, 8 at least, or infinite.
        double: in double precision.

    Raises:
        ValueError: no body, a cell that is not positive, a period that is not of whole cells.
    """

    def __init__(
        self, bodies: Sequence[Body], dx: float, *, gravity: ArrayLike = (0.0, 0.0, 0.0),
        bearers: Sequence[Bearer] = (), period: ArrayLike = math.inf, double: bool = False,
    ) -> None:  # fmt: skip
        if not bodies or not 0 < dx < math.inf:
            raise ValueError(f"{len(bodies)} bodies, dx = {dx} m; allowed: at least one body, a positive dx")
        self.dx, self.bodies, self.bearers, self.time, self.steps = dx, list(bodies), tuple(bearers), 0.0, 0
        self._real = ti.f64 if double else ti.f32
        self._type: Any = np.float64 if double else np.float32
        self.gravity = np.asarray(gravity, float)
        self._period = np.broadcast_to(np.asarray(period, float), 3)
        cycle = np.where(np.isfinite(self._period), self._period / dx, 0.0)
        self._cycle = np.round(cycle).astype(int)
        if not np.allclose(cycle, self._cycle, rtol=0, atol=1e-6) or (self._cycle[self._cycle != 0] < 2 * _SIDE).any():
            raise ValueError(f"period = {self._period} m of cells of {dx} m; allowed: whole cells, {2 * _SIDE} or more")
        self._clouds = [_Cloud(body, self._type) for body in bodies]
        self._clear, self._advance = _grid_kernels(self._real)
        self._corner, self._shape = np.zeros(3, int), np.zeros(3, int)
        self._grid = np.zeros((0, 4), self._type)
        self._active = np.zeros(0, np.int32)
        self._drift, self._last = math.inf, 0.0
        self._fastest = max(float(np.abs(c.records[:, 3:6]).max()) for c in self._clouds)

    def positions(self, body: int = 0) -> Array:
        """(n, 3) [m], in the order in which they were given."""
        return self._given(body, slice(0, 3))

    def velocities(self, body: int = 0) -> Array:
        """(n, 3) [m/s], in the order in which they were given; now, if `advance` came last."""
        return self._given(body, slice(3, 6)) + self._clouds[body].ahead

    def states(self, body: int = 0) -> Array:
        """(n, state) of the material's law, in the order in which they were given."""
        return self._given(body, slice(15, None))

    def _given(self, body: int, columns: slice) -> Array:
        cloud = self._clouds[body]
        out = np.empty((len(cloud.records), cloud.records[:, columns].shape[1]))
        out[cloud.order] = cloud.records[:, columns]
        return out

    def add(self, body: int, points: Array, velocity: ArrayLike) -> None:
        """Give a body more particles: (n, 3) [m], at rest within and of a velocity [m/s]. They come last."""
        cloud = self._clouds[body]
        new = np.zeros((len(points), cloud.records.shape[1]), self._type)
        new[:, :3], new[:, 3:6] = points, velocity
        cloud.order = np.concatenate([cloud.order, len(cloud.order) + np.arange(len(points))])
        cloud.records = np.concatenate([cloud.records, new])
        cloud.spare = np.empty_like(cloud.records)
        self._fastest = max(self._fastest, float(np.abs(new[:, 3:6]).max(initial=0.0)))
        self._drift = math.inf

    def momentum(self) -> Array:
        """Σ m v (3,) [kg m/s], of the middle of the last step: what bearers lost and gained until then."""
        return np.sum([c.momentum() for c in self._clouds], axis=0)

    def advance(self, duration: float) -> int:
        """Go on for so long [s], in as many steps as stability needs; returns how many.

        ArithmeticError if anything is not finite, before the next step.
        """
        left, taken = duration, 0
        while left > 1e-9 * duration:
            if not math.isfinite(self._fastest):
                raise ArithmeticError(f"particles are not finite at t = {self.time:.6g} s")
            longest = longest_step(self.bodies, self.dx, 2 * self._fastest + 1e-3)
            parts = max(1, math.ceil(left / longest))
            dt = left / parts
            before = [cloud.momentum() for cloud in self._clouds] if parts == 1 else []
            self.step(dt)
            for cloud, momentum in zip(self._clouds, before, strict=False):
                cloud.ahead = (cloud.momentum() - momentum) / (2 * cloud.mass * len(cloud.records))
            left -= dt
            taken += 1
        return taken

    def step(self, dt: float) -> None:
        """One step of a length [s]."""
        if self._drift + 2 * self._fastest * dt > 0.9 * self.dx:
            self._sort()
        ny, nz = (int(n) for n in self._shape[1:])
        origin = self._vector(self._corner * self.dx)
        cells = 1 / self.dx
        grid, active, count = self._grid, self._active, len(self._active)
        self._clear(grid, active, count, ny, nz)
        for cloud in self._clouds:
            scatter, _ = _particle_kernels(law(cloud.material, self._real), self._real, cloud.material.state)
            for colour in range(8):
                low, high = cloud.starts[colour], cloud.starts[colour + 1]
                if high > low:
                    scatter(cloud.records, grid, cloud.first, cloud.blocks, low, high, ny, nz, origin, cells,
                            cloud.mass)  # fmt: skip
        self._fold()
        # velocities are those of the middle of a step, so that what falls freely falls exactly
        self._advance(grid, active, count, ny, nz, self._vector((self._last + dt) / 2 * self.gravity))
        self._last = dt
        for bearer in self.bearers:
            bearer.meet(grid, active, self._shape, self._corner * self.dx, self.dx, self._real)
        fastest = 0.0
        for cloud in self._clouds:
            _, gather = _particle_kernels(law(cloud.material, self._real), self._real, cloud.material.state)
            numbers = ti.Vector([*cloud.material.parameters(), 0.0, 0.0, 0.0][:4], self._real)
            speed = gather(cloud.records, grid, len(cloud.records), ny, nz, origin, cells, dt, cloud.mass, cloud.volume,
                           numbers)  # fmt: skip
            fastest = speed if not speed <= fastest else fastest
        self._fastest = float(fastest)
        for bearer in self.bearers:
            bearer.move(dt)
        self._drift += self._fastest * dt
        self.time += dt
        self.steps += 1

    def _vector(self, values: ArrayLike) -> Any:
        return ti.Vector(np.asarray(values, float).tolist(), self._real)

    def _fold(self) -> None:
        """Where the world repeats itself, nodes that are one have the sum of what both got."""
        whole = self._grid.reshape(*self._shape, 4)
        for axis in np.flatnonzero(self._cycle):
            here = np.moveaxis(whole, axis, 0)[-self._corner[axis] - _SIDE : -self._corner[axis] + _SIDE]
            there = np.moveaxis(whole, axis, 0)[self._cycle[axis] - self._corner[axis] - _SIDE :][: 2 * _SIDE]
            here += there
            there[:] = here

    def _sort(self) -> None:
        """Sort all particles by block, on a grid that holds them, and list the blocks that they can touch."""
        for axis in np.flatnonzero(self._cycle):
            for cloud in self._clouds:
                x = cloud.records[:, axis]
                x -= np.floor(x / self._period[axis]).astype(x.dtype) * x.dtype.type(self._period[axis])
        spans = [np.stack([c.records[:, :3].min(axis=0), c.records[:, :3].max(axis=0)]) for c in self._clouds]
        low, high = np.min([s[0] for s in spans], axis=0), np.max([s[1] for s in spans], axis=0)
        if not np.isfinite([low, high]).all():
            raise ArithmeticError(f"particles are not finite at t = {self.time:.6g} s")
        side = _SIDE * self.dx
        first, last = np.floor(low / side).astype(int), np.floor(high / side).astype(int)
        first, last = np.where(self._cycle, -1, first), np.where(self._cycle, self._cycle // _SIDE + 1, last)
        inside = self._corner // _SIDE + _MARGIN <= first
        beyond = last < (self._corner + self._shape) // _SIDE - _MARGIN
        if not (inside.all() and beyond.all()):
            self._corner = (first - _ROOM) * _SIDE
            self._shape = (last - first + 1 + 2 * _ROOM) * _SIDE
            nodes = int(np.prod(self._shape.astype(float)))
            if nodes > _MOST_NODES:
                raise ArithmeticError(f"the particles spread over {nodes} nodes; allowed: {_MOST_NODES}")
            self._grid = np.zeros((nodes, 4), self._type)
        blocks = self._shape // _SIDE
        near = np.zeros(blocks, bool)
        origin = (self._corner * self.dx).astype(self._type)
        for cloud in self._clouds:
            bins = np.zeros(int(np.prod(blocks)) + 1, np.int32)
            _sort(cloud.records, cloud.spare, cloud.order, bins, origin, self._type(1 / self.dx), blocks[1], blocks[2])
            cloud.records, cloud.spare, cloud.first = cloud.spare, cloud.records, bins
            full = np.flatnonzero(np.diff(bins))
            x, y, z = np.unravel_index(full, blocks)
            colour = (x % 2) * 4 + (y % 2) * 2 + z % 2
            by_colour = np.argsort(colour, kind="stable")
            cloud.blocks = full[by_colour].astype(np.int32)
            cloud.starts = np.searchsorted(colour[by_colour], np.arange(9)).tolist()
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    for dz in (-1, 0, 1):
                        near[x + dx, y + dy, z + dz] = True
        for axis in np.flatnonzero(self._cycle):
            along = np.moveaxis(near, axis, 0)
            zero, cycle = -self._corner[axis] // _SIDE, self._cycle[axis]
            ends = [zero + s for s in (-1, 0)] + [zero + (cycle + s) // _SIDE for s in (-_SIDE, -1, 0, _SIDE - 1)]
            along[ends] = along[ends].any(axis=0)
        self._active = np.flatnonzero(near.ravel()).astype(np.int32)
        self._drift = 0.0
