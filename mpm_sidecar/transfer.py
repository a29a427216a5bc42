"""Particles to grid and back: MLS-MPM with quadratic B-splines and affine velocities.

    grid      p_i = Σ w_ip (m v_p + A_p (x_i - x_p)),  m_i = Σ w_ip m,  A_p = m C_p - Δt V₀ (4/Δx²) τ_p
    velocity  v_i = p_i/m_i + Δt g, then what it meets
    particle  v_p = Σ w_ip v_i,  C_p = (4/Δx²) Σ w_ip v_i ⊗ (x_i - x_p),  x_p += Δt v_p

where velocities are those of a step's middle, as a leapfrog's: the first step has half of g.

Source: Y. Hu et al., ACM Trans. Graph. 37 (2018) 150, eq. 16-29 (MLS-MPM); C. Jiang et al., J. Comput. Phys. 338 (2017)
137 (affine velocities, which keep linear and angular momentum).

Particles lie sorted by blocks of 4³ cells, and so by slabs of blocks along x. Slabs of one of two colours are a slab
apart, and a particle may drift by a cell before they are sorted again: so slabs of one colour scatter side by side with
plain additions, in an order that no number of threads changes; columns along z of four colours, where slabs are few.
Only blocks that particles can touch are cleared and advanced. The grid's nodes are multiples of Δx from the world's
origin, wherever it begins and however far it reaches; it grows with the motion.

Particles and grid are the CPU's. Where Taichi runs on a GPU it copies them there and back for every kernel, and what is
between kernels (sorting, the grid's own step) stays on the CPU; nobody has tried that, and it is not meant to be fast.

Defects: explicit, stable below `longest_step` only; affine velocities damp what is few cells wide as if by a
viscosity (`medium.numerical_viscosity`); smooth walls take some of what flows past them, too; what is more than two
cells apart has separated; bodies that share a node stick together; what is squashed ten times faster than sound goes to
nothing within a cell, and may gain energy.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from physinone_mj.continuum import Material, Newtonian

from ._ti import kernels, ti
from .collide import TASK, Bearer, begin
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
_SQUEEZED: Final = 0.6
"""Part that sound may cross where a fluid is squeezed most: 0.75 is seen to break."""
_VISCOUS: Final = 0.1
"""Part of ρ Δx²/η that a step may be."""
_MOST_STEPS: Final = 100_000
"""Of an `advance`, fifty times as many as the finest of the scenes needs: what needs more has run away."""
_ENDLESS: Final = 1e30
"""A speed [m/s] that stands for what is infinite or not a number."""
_MOST_NODES: Final = 2**28
_MOST_PARTICLES: Final = 2**26
_SLABS: Final = 4
"""Of a multiple of so many slabs along x, of about as many particles each, two threads get as much to do in either of
two colours; where there are fewer blocks along x than that, columns of four colours are shared."""
_REGISTER: Final = 32
"""Bytes of numbers that are reckoned with at once: of so many particles, while they are still at hand."""
_RUN: Final = 32
"""Particles of a turn of the loop, a few chunks of them."""
_TURNS: Final = 16
"""Of the loop for each run, all but the first idle: Taichi hands a thread 512 turns, then 1024 particles."""
_STATE: Final = 20
"""Where in a record the state begins: x (3), 0, v (3), 1, the columns of A (3) and 0 each."""
_VELOCITY: Final = slice(4, 7)

# Where in the one array of numbers that each kernel is given each begins: to hand an argument over takes longer than to
# read a hundred numbers.
_NY, _NZ, _CELLS, _ORIGIN, _KICK, _STRIDE, _PARTS = 0, 1, 2, 3, 6, 9, 13
_MASS, _PUSH, _LAW = 17, 18, 19
_NOTHING, _LEAST = 23, 24


def _chunk(real: Any) -> int:
    """How many particles are at once reckoned with."""
    return _REGISTER // (8 if real is ti.f64 else 4)


def _width(state: int) -> int:
    """Of a record with a state of so many numbers, in whole fours."""
    return _STATE + (state + 3) // 4 * 4


@ti.func
def _weights(f):
    """Of the three nodes along an axis, f [cell] after the first of which a particle is."""
    return ti.Vector([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2])


@ti.func
def _node(x, y, z, ny, nz):
    """Number of a node, or of nodes between two; the mask changes nothing, but tells that no address overflows."""
    return ((x * ny + y) * nz + z) & ti.static(_MOST_NODES - 1)


@ti.func
def _locate(rec: ti.template(), first, last, chunk: ti.template(), origin, cells, ny, nz,
            place: ti.template(), offset: ti.template(), weight: ti.template()):  # fmt: skip
    """Of a chunk of particles, all at once: number of the first node, offset from it [cell] (3, chunk), and the three
    nodes' weights along each axis (9, chunk). After the last, the last again.

    One by one, with what follows waiting for each, both ways over the grid take some 15 % longer.
    """
    for q in range(chunk):
        p = ti.min(first + q, last - 1) & ti.static(_MOST_PARTICLES - 1)
        x = (ti.Vector([rec[p][0], rec[p][1], rec[p][2]]) - origin) * cells
        base = ti.cast(x - 0.5, ti.i32)
        for k in ti.static(range(3)):
            offset[k, q] = x[k] - base[k]
            w = _weights(x[k] - base[k])
            for node in ti.static(range(3)):
                weight[3 * k + node, q] = w[node]
        place[q] = _node(base[0], base[1], base[2], ny, nz)


@ti.func
def _three(table: ti.template(), row: ti.template(), q):
    return ti.Vector([table[row + k, q] for k in ti.static(range(3))])


@ti.func
def _some(given: ti.template(), at: ti.template(), count: ti.template()):
    return ti.Vector([given[at + i] for i in range(count)])


@kernels
def _scatter_kernel(real: Any, width: int, fixed: bool) -> Any:
    """Particles of columns, from and up to, onto the grid; fixed: as `_count_kernel` has it.

    The compiler makes one instruction of the four numbers of a node, if nothing tells them apart: hence a record of
    whole fours, and loops that are unrolled, the outermost by itself: it then keeps more at hand.
    """
    pairs, numbers = ti.types.ndarray(dtype=ti.i32, ndim=2), ti.types.ndarray(dtype=real, ndim=1)
    records = ti.types.ndarray(dtype=ti.types.vector(width, real), ndim=1)
    nodes = ti.types.ndarray(dtype=ti.types.vector(4, ti.i64 if fixed else real), ndim=1)

    @ti.func
    def add(grid: ti.template(), n, part, _parts):
        grid[n] = grid[n] + part

    @ti.func
    def add_whole(grid: ti.template(), n, part, parts):
        for c in ti.static(range(4)):
            ti.atomic_add(grid[n][c], ti.cast(ti.round(parts[c] * part[c]), ti.i64))

    put = add_whole if fixed else add

    size = _chunk(real)

    @ti.kernel
    def scatter(rec: records, grid: nodes, columns: pairs, given: numbers):
        for turn in range(columns.shape[0] * ti.static(TASK)):
            if turn % ti.static(TASK) != 0:
                continue
            a = turn // ti.static(TASK)
            ny, nz, cells = ti.cast(given[_NY], ti.i32), ti.cast(given[_NZ], ti.i32), given[_CELLS]
            origin, parts, mass = _some(given, _ORIGIN, 3), _some(given, _PARTS, 4), given[_MASS]
            place, offset = ti.Vector.zero(ti.i32, size), ti.Matrix.zero(real, 3, size)
            weight = ti.Matrix.zero(real, 9, size)
            for chunk in range((columns[a, 1] - columns[a, 0] + size - 1) // size):
                first = columns[a, 0] + chunk * size
                _locate(rec, first, columns[a, 1], size, origin, cells, ny, nz, place, offset, weight)
                for particle in range(first, ti.min(first + size, columns[a, 1])):
                    q = particle - first
                    r = rec[particle & ti.static(_MOST_PARTICLES - 1)]
                    f, here = _three(offset, 0, q), place[q] & ti.static(_MOST_NODES - 1)
                    wx, wy, wz = _three(weight, 0, q), _three(weight, 3, q), _three(weight, 6, q)
                    ax = ti.Vector([r[8], r[9], r[10], r[11]])
                    ay = ti.Vector([r[12], r[13], r[14], r[15]])
                    az = ti.Vector([r[16], r[17], r[18], r[19]])
                    u = mass * ti.Vector([r[4], r[5], r[6], r[7]]) - f[0] * ax - f[1] * ay - f[2] * az
                    for i in range(3):
                        level = u + ti.cast(i, real) * ax
                        for j in ti.static(range(3)):
                            n = here + _node(i, j, 0, ny, nz)
                            w = wx[i] * wy[j]
                            line = w * level
                            rise = w * az
                            put(grid, n, wz[0] * line, parts)
                            line += rise
                            put(grid, n + 1, wz[1] * line, parts)
                            line += rise
                            put(grid, n + 2, wz[2] * line, parts)
                            level += ay

    return scatter


@kernels
def _count_kernel(real: Any) -> Any:
    """What was added up in whole numbers becomes what it stands for, and is cleared."""
    whole, numbers = ti.types.ndarray(dtype=ti.i32, ndim=1), ti.types.ndarray(dtype=real, ndim=1)
    counts = ti.types.ndarray(dtype=ti.types.vector(4, ti.i64), ndim=1)
    nodes = ti.types.ndarray(dtype=ti.types.vector(4, real), ndim=1)

    @ti.kernel
    def count(fixed: counts, grid: nodes, blocks: whole, given: numbers):
        for line in range(16 * blocks.shape[0]):
            ny, nz, parts = ti.cast(given[_NY], ti.i32), ti.cast(given[_NZ], ti.i32), _some(given, _PARTS, 4)
            x, y, z = begin(blocks[line // 16], ny, nz)
            for k in range(4):
                n = ((x + line // 4 % 4) * ny + y + line % 4) * nz + z + k
                for c in ti.static(range(4)):
                    grid[n][c] = ti.cast(fixed[n][c], real) / parts[c]
                    fixed[n][c] = ti.cast(0, ti.i64)

    return count


@kernels
def _gather_kernel(law: Any, real: Any, state: int, fluid: bool) -> Any:
    """The grid's velocities to particles, and one material's law; returns the greatest component of a velocity.

    fluid: its state is J - 1; the least of it, and of what is given already, goes where that was given

    In single precision the law's loop has no branch and no call, and its numbers are local: eight particles at once.
    These lie in fours, as in records, which the compiler turns into eights and back where all of each are used: so the
    fourths are, though worth nothing. Loops over particles must not become ones of eights: it cannot tell what p is.
    """
    records = ti.types.ndarray(dtype=ti.types.vector(_width(state), real), ndim=1)
    nodes = ti.types.ndarray(dtype=ti.types.vector(4, real), ndim=1)
    numbers, inner = ti.types.ndarray(dtype=real, ndim=1), ti.types.vector(state, real)
    fours, size = (_width(state) - _STATE) // 4, _chunk(real)

    @ti.kernel
    def gather(rec: records, grid: nodes, given: numbers) -> real:
        fastest = ti.cast(0.0, real)
        for part in range((rec.shape[0] + _RUN - 1) // _RUN * ti.static(_TURNS)):
            if part % ti.static(_TURNS) != 0:
                continue
            ny, nz, cells = ti.cast(given[_NY], ti.i32), ti.cast(given[_NZ], ti.i32), given[_CELLS]
            origin, stride, k = _some(given, _ORIGIN, 3), _some(given, _STRIDE, 4), _some(given, _LAW, 4)
            dt, keep, push, nothing = stride[0], 4 * given[_MASS], given[_PUSH], ti.cast(given[_NOTHING], ti.i32)
            velocity = ti.Matrix.zero(real, size, 4)
            column = [ti.Matrix.zero(real, size, 4) for _ in ti.static(range(3))]
            kept = [ti.Matrix.zero(real, size, 4) for _ in ti.static(range(fours))]
            place, offset = ti.Vector.zero(ti.i32, size), ti.Matrix.zero(real, 3, size)
            weight = ti.Matrix.zero(real, 9, size)
            fast = ti.Vector.zero(real, size)  # of fewer than eight, the rest are others' or nobody's
            top, least = ti.cast(0.0, real), ti.cast(0.0, real)
            for chunk in range(ti.static(_RUN // size)):
                first = part // ti.static(_TURNS) * _RUN + chunk * size
                last = ti.min(first + size, rec.shape[0])
                _locate(rec, first, last, size, origin, cells, ny, nz, place, offset, weight)
                for particle in range(first, last):
                    p, q = (particle ^ nothing) & ti.static(_MOST_PARTICLES - 1), particle - first
                    r = rec[p]
                    f, here = _three(offset, 0, q), place[q] & ti.static(_MOST_NODES - 1)
                    wx, wy, wz = _three(weight, 0, q), _three(weight, 3, q), _three(weight, 6, q)
                    v = ti.Vector.zero(real, 4)
                    bx = ti.Vector.zero(real, 4)
                    by = ti.Vector.zero(real, 4)
                    bz = ti.Vector.zero(real, 4)
                    for i in range(3):
                        w = wx[i]
                        plane = ti.Vector.zero(real, 4)
                        turn = ti.Vector.zero(real, 4)
                        rise = ti.Vector.zero(real, 4)
                        for j in ti.static((1, 2, 0)):
                            n = here + _node(i, j, 0, ny, nz)
                            two = wz[2] * grid[n + 2]
                            both = wz[1] * grid[n + 1] + two
                            line = wy[j] * (wz[0] * grid[n] + both)
                            climb = wy[j] * (both + two)
                            if ti.static(j == 1):
                                plane = line
                                rise = climb
                            else:
                                plane += line
                                rise += climb
                            if ti.static(j == 2):
                                turn = plane + line  # Σ j line
                        plane *= w
                        v += plane
                        by += w * turn
                        bz += w * rise
                        bx += ti.cast(i, real) * plane
                    for c in ti.static(range(4)):
                        r[c] += stride[c] * v[c]
                        velocity[q, c] = v[c]
                        column[0][q, c] = bx[c] - f[0] * v[c]
                        column[1][q, c] = by[c] - f[1] * v[c]
                        column[2][q, c] = bz[c] - f[2] * v[c]
                        for four in ti.static(range(fours)):
                            kept[four][q, c] = r[_STATE + 4 * four + c]
                    rec[p] = r
                for q in range(size):
                    s = inner(0.0)
                    for i in ti.static(range(state)):
                        s[i] = kept[i // 4][q, i % 4]
                    grad = ti.Matrix.zero(real, 3, 3)
                    for i, j in ti.static(ti.ndrange(3, 3)):
                        grad[i, j] = (4.0 * cells * dt) * column[j][q, i]
                    s, tau = law(s, grad, dt, k)
                    for i in ti.static(range(state)):
                        kept[i // 4][q, i % 4] = s[i]
                    for i, j in ti.static(ti.ndrange(3, 3)):
                        column[j][q, i] = keep * column[j][q, i] - push * tau[i, j]
                    for j in ti.static(range(3)):
                        column[j][q, 3] *= 0.0
                    vx, vy, vz = ti.abs(velocity[q, 0]), ti.abs(velocity[q, 1]), ti.abs(velocity[q, 2])
                    more = ti.select(vx > vy, vx, vy)
                    fast[q] = ti.select(vz > more, vz, more) + 0.0 * (vx + vy + vz)  # not a number, if any is not
                    velocity[q, 3] = 1.0 + 0.0 * velocity[q, 3]
                for particle in range(first, last):
                    p, q = (particle ^ nothing) & ti.static(_MOST_PARTICLES - 1), particle - first
                    r = rec[p]
                    for c in ti.static(range(4)):
                        r[4 + c] = velocity[q, c]
                        for j in ti.static(range(3)):
                            r[8 + 4 * j + c] = column[j][q, c]
                        for four in ti.static(range(fours)):
                            r[_STATE + 4 * four + c] = kept[four][q, c]
                    rec[p] = r
                    if ti.static(fluid):
                        least = ti.min(least, kept[0][q, 0])
                for q in ti.static(range(size)):
                    if not fast[q] <= top:
                        top = ti.min(fast[q], ti.static(_ENDLESS))
            if top > fastest:
                ti.atomic_max(fastest, top)
            if ti.static(fluid):
                ti.atomic_min(given[_LEAST], least)
        return fastest

    return gather


@njit(cache=True)
def _begin(block: int, ny: int, nz: int) -> tuple[int, int, int]:
    """Index of a block's first node along each axis."""
    across, row = nz // _SIDE, (nz // _SIDE) * (ny // _SIDE)
    return _SIDE * (block // row), _SIDE * (block % row // across), _SIDE * (block % across)


@njit(cache=True)
def _clear(grid: Any, blocks: Any, ny: int, nz: int) -> None:
    """Clear the grid's active blocks.

    This and the next take less than it takes to wake other threads for them.
    """
    for block in blocks:
        x, y, z = _begin(block, ny, nz)
        for i in range(_SIDE):
            for j in range(_SIDE):
                here = ((x + i) * ny + y + j) * nz + z
                grid[here : here + _SIDE] = 0


@njit(cache=True)
def _advance(grid: Any, blocks: Any, ny: int, nz: int, kick: Any) -> None:
    """Velocities of the active blocks' nodes from their momenta, and what gravity adds (3,)."""
    for block in blocks:
        x, y, z = _begin(block, ny, nz)
        for i in range(_SIDE):
            for j in range(_SIDE):
                here = ((x + i) * ny + y + j) * nz + z
                for n in range(here, here + _SIDE):
                    mass = grid[n, 3]
                    if mass > 0:
                        for c in range(3):
                            grid[n, c] = grid[n, c] / mass + kick[c]


@njit(cache=True)
def _span(rec: Any) -> Any:
    """Least and greatest coordinates (2, 3) of records; not a number if any is not."""
    out = np.empty((2, 3))
    for i in range(3):
        low = high = rec[0, i]
        for p in range(rec.shape[0]):
            x = rec[p, i]
            low = x if not x >= low else low
            high = x if not x <= high else high
        out[0, i], out[1, i] = low, high
    return out


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
        for i in range(rec.shape[1]):
            spare[to, i] = rec[p, i]
        sorted_[to] = order[p]
    order[:] = sorted_


def _even(first: NDArray[np.int32]) -> NDArray[np.int32]:
    """Slabs (n, 2), from which particle and up to which, of blocks that begin at first (blocks + 1,); none of few."""
    inner = np.flatnonzero(np.diff(first, prepend=-1))  # where what is before each block that holds any ends
    count = (len(inner) - 1) // _SLABS * _SLABS
    ends = first[inner]
    cuts = [0]
    for k in range(1, count):
        near = int(np.abs(ends - ends[-1] * k / count).argmin())
        cuts.append(min(max(near, cuts[-1] + 1), len(ends) - 1 - count + k))
    return np.stack([ends[cuts], ends[[*cuts[1:], -1]]], axis=1) if count else np.zeros((0, 2), np.int32)


@dataclass(frozen=True)
class Body:
    """A piece of matter: its particles (n, 3) [m], each of a volume [m³], and their velocity, (3,) or (n, 3) [m/s].

    spin: at which it turns, as the velocities have it, too [rad/s]: a particle is not a point
    """

    material: Material
    points: Array
    volume: float
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    spin: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        points = np.asarray(self.points)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise ValueError(f"points = {points.shape} of a body; allowed: (n, 3), finite, n at least 1")
        if not 0 < self.volume < math.inf:
            raise ValueError(f"volume = {self.volume} m³ of a particle; allowed: positive")


def _count(particles: int) -> None:
    if particles > _MOST_PARTICLES:
        raise ValueError(f"{particles} particles of a body; allowed: {_MOST_PARTICLES}")


def longest_step(bodies: Sequence[Body], dx: float, speed: float = 0.0, least: Sequence[float] = ()) -> float:
    """Longest stable step [s] while nothing is faster than a speed [m/s]; least: J of each where it is squeezed most.

    What is at rest is seen to break at steps 2.5 (a fluid) to 4 times as long (rubber that does not keep its volume).
    That leaves room for all that solids stiffen by: flow softens them, a Hencky strain's moduli do not change, and
    rubber's sound grows at most as its stretch does, which beyond 3 to 4 has parted its particles. A fluid's grows as
    J⁻³, and so is followed.
    """
    steps = [math.inf]
    for body, stretch in zip(bodies, least or [1.0] * len(bodies), strict=True):
        material = body.material
        sound = math.sqrt(material.stiffness() / material.density)
        steps.append(_COURANT * dx / (sound + speed))
        steps.append(_SQUEEZED * dx / math.sqrt(material.stiffness(stretch) / material.density))
        if material.thickness() > 0:
            steps.append(_VISCOUS * dx**2 * material.density / material.thickness())
    return min(steps)


class _Cloud:
    """The particles of one body as the kernels have them, sorted by block."""

    def __init__(self, body: Body, dx: float, dtype: Any) -> None:
        self.material, self.volume = body.material, body.volume
        self.mass = body.volume * body.material.density
        self.records = np.zeros((len(body.points), _width(body.material.state)), dtype)
        self.records[:, :3] = body.points
        self.records[:, _VELOCITY] = body.velocity
        self.records[:, 7] = 1.0
        for column, axis in enumerate(np.eye(3)):
            of = _STATE - 12 + 4 * column
            self.records[:, of : of + 3] = self.mass * dx * np.cross(np.asarray(body.spin, float), axis)
        self.spare = np.empty_like(self.records)
        self.order = np.arange(len(body.points))
        self.columns = np.zeros((0, 2), np.int32)  # of blocks along z that hold some: first record, and past the last
        self.starts: list[int] = []
        self.fullest = 0
        self.least = 1.0  # J of a fluid where it is squeezed most
        self.ahead = np.zeros(3)  # half a step's change of velocity, from the last one's middle to its end

    def momentum(self) -> Array:
        """Σ m v of the velocities that there are (3,) [kg m/s]."""
        return np.asarray(self.mass * self.records[:, _VELOCITY].sum(axis=0, dtype=float))


class Solver:
    """Several bodies on one grid. Taichi has to be started, with `default_fp` that of the precision.

    Args:
        bodies: what there is.
        dx: side of a cell [m].
        gravity: (3,) [m/s²]; may be set anew at any time.
        bearers: what stands in the way; after each step they are where they then are.
        period: length after which the world repeats itself along each axis [m], whole cells, 8 at least, or infinite.
        double: in double precision.
        atomic: add up on the grid in whole numbers of a quantum, in any order, as a GPU has to; the same bits for any
            order of particles, too, and slower on a CPU. Unless said, as what Taichi runs on needs it.
        sparse: pass over blocks that no particle can touch; False to show that it changes nothing.

    Raises:
        ValueError: no body, more particles than 2²⁶ of one, a cell that is not positive, a period that is not of whole
            cells.
        RuntimeError: Taichi runs at the other precision; from any step, too, as it may be started anew meanwhile.
    """

    def __init__(
        self, bodies: Sequence[Body], dx: float, *, gravity: ArrayLike = (0.0, 0.0, 0.0),
        bearers: Sequence[Bearer] = (), period: ArrayLike = math.inf, double: bool = False,
        atomic: bool | None = None, sparse: bool = True,
    ) -> None:  # fmt: skip
        if not bodies or not 0 < dx < math.inf:
            raise ValueError(f"{len(bodies)} bodies, dx = {dx} m; allowed: at least one body, a positive dx")
        for body in bodies:
            _count(len(body.points))
        self.dx, self.bodies, self.bearers, self.time, self.steps = dx, list(bodies), tuple(bearers), 0.0, 0
        self._real = ti.f64 if double else ti.f32
        self._type: Any = np.float64 if double else np.float32
        self.gravity = np.asarray(gravity, float)
        self._period = np.broadcast_to(np.asarray(period, float), 3)
        cycle = np.where(np.isfinite(self._period), self._period / dx, 0.0)
        self._cycle = np.round(cycle).astype(int)
        if not np.allclose(cycle, self._cycle, rtol=0, atol=1e-6) or (self._cycle[self._cycle != 0] < 2 * _SIDE).any():
            raise ValueError(f"period = {self._period} m of cells of {dx} m; allowed: whole cells, {2 * _SIDE} or more")
        self._clouds = [_Cloud(body, dx, self._type) for body in bodies]
        self._corner, self._shape = np.zeros(3, int), np.zeros(3, int)
        self._grid = np.zeros((0, 4), self._type)
        self._same_precision()
        config = ti.lang.impl.current_cfg()
        self._threads = config.cpu_max_num_threads
        if atomic is None:
            atomic = config.arch not in (ti.x64, ti.arm64)
        self._fixed = np.zeros((0, 4), np.int64) if atomic else None
        self._active, self._sparse = np.zeros(0, np.int32), sparse
        self._drift, self._last = math.inf, 0.0
        self._fastest = max(float(np.abs(c.records[:, _VELOCITY]).max()) for c in self._clouds)
        self._low = np.min([np.min(body.points, axis=0) for body in bodies], axis=0)
        self._high = np.max([np.max(body.points, axis=0) for body in bodies], axis=0)

    def positions(self, body: int = 0) -> Array:
        """(n, 3) [m], in the order in which they were given."""
        return self._given(body, slice(0, 3))

    def velocities(self, body: int = 0) -> Array:
        """(n, 3) [m/s], in the order in which they were given; now, if `advance` came last."""
        return self._given(body, _VELOCITY) + self._clouds[body].ahead

    def states(self, body: int = 0) -> Array:
        """(n, state) of the material's law, in the order in which they were given."""
        return self._given(body, slice(_STATE, _STATE + self.bodies[body].material.state))

    def _given(self, body: int, columns: slice) -> Array:
        cloud = self._clouds[body]
        out = np.empty((len(cloud.records), cloud.records[:, columns].shape[1]))
        out[cloud.order] = cloud.records[:, columns]
        return out

    def add(self, body: int, points: Array, velocity: ArrayLike) -> None:
        """Give a body more particles: (n, 3) [m], at rest within and of a velocity [m/s]. They come last."""
        cloud = self._clouds[body]
        _count(len(cloud.order) + len(points))
        new = np.zeros((len(points), cloud.records.shape[1]), self._type)
        new[:, :3], new[:, _VELOCITY], new[:, 7] = points, velocity, 1.0
        cloud.order = np.concatenate([cloud.order, len(cloud.order) + np.arange(len(points))])
        cloud.records = np.concatenate([cloud.records, new])
        cloud.spare = np.empty_like(cloud.records)
        self._fastest = max(self._fastest, float(np.abs(new[:, _VELOCITY]).max(initial=0.0)))
        self._low = np.minimum(self._low, np.min(points, axis=0, initial=math.inf))
        self._high = np.maximum(self._high, np.max(points, axis=0, initial=-math.inf))
        self._drift = math.inf

    def momentum(self) -> Array:
        """Σ m v (3,) [kg m/s], of the middle of the last step: what bearers lost and gained until then."""
        return np.sum([c.momentum() for c in self._clouds], axis=0)

    def advance(self, duration: float) -> int:
        """Go on for so long [s], in as many steps as stability needs; returns how many.

        ArithmeticError before the next step if anything is not finite, or so fast, or so squeezed, that it would be one
        of more than 100 000.
        """
        left, taken = duration, 0
        while left > 1e-9 * duration:
            if not self._fastest < _ENDLESS:
                raise ArithmeticError(f"particles are not finite at t = {self.time:.6g} s")
            speed, least = self._speed(), [cloud.least for cloud in self._clouds]
            longest = longest_step(self.bodies, self.dx, 2 * speed + 1e-3, least)
            parts = max(1, math.ceil(left / longest))
            if taken + parts > _MOST_STEPS:
                raise ArithmeticError(f"{taken + parts} steps in {duration:.3g} s from t = {self.time:.6g} s on, at "
                                      f"{speed:.3g} m/s and J = {min(least):.3g}; allowed: {_MOST_STEPS}")  # fmt: skip
            dt = left / parts
            before = [cloud.momentum() for cloud in self._clouds] if parts == 1 else []
            share = dt / (self._last + dt)  # of the change from the middle of the step before, what is still to come
            self.step(dt)
            for cloud, momentum in zip(self._clouds, before, strict=False):
                cloud.ahead = share * (cloud.momentum() - momentum) / (cloud.mass * len(cloud.records))
            left -= dt
            taken += 1
        return taken

    def _speed(self) -> float:
        """That of what is fastest, of matter and of what may drag it along [m/s]."""
        low, high = self._low - 2 * self.dx, self._high + 2 * self.dx  # particles drift before they are sorted again
        return max([self._fastest, *(bearer.speed(low, high) for bearer in self.bearers)])

    def _same_precision(self) -> None:
        """RuntimeError unless the literals of kernels that are made now are of this precision."""
        runs = ti.lang.impl.current_cfg().default_fp
        if runs != self._real:
            names = {ti.f32: "single", ti.f64: "double"}
            raise RuntimeError(f"Taichi runs in {names[runs]} precision; allowed: {names[self._real]}, the solver's")

    def step(self, dt: float) -> None:
        """One step of a length [s]."""
        self._same_precision()
        if self._drift + 2 * self._speed() * dt > 0.9 * self.dx:
            self._sort()
        grid, active = self._grid, self._active
        given, (ny, nz) = self._numbers(dt), self._shape[1:]
        if self._fixed is None:
            _clear(grid, active, ny, nz)
        for cloud, numbers in zip(self._clouds, given, strict=True):
            scatter = _scatter_kernel(self._real, cloud.records.shape[1], self._fixed is not None)
            # one thread goes through all colours in order, and where whole numbers are added order is nothing
            ends = cloud.starts if self._threads > 1 and self._fixed is None else [0, cloud.starts[-1]]
            for low, high in pairwise(ends):
                if high > low:
                    scatter(cloud.records, grid if self._fixed is None else self._fixed, cloud.columns[low:high],
                            numbers)  # fmt: skip
        if self._fixed is not None:
            _count_kernel(self._real)(self._fixed, grid, active, given[0])
        self._fold()
        _advance(grid, active, ny, nz, given[0, _KICK : _KICK + 3])
        self._last = dt
        for bearer in self.bearers:
            bearer.meet(grid, active, self._shape, self._corner * self.dx, self.dx, self._real)
        fastest = 0.0
        for cloud, numbers in zip(self._clouds, given, strict=True):
            fluid = isinstance(cloud.material, Newtonian)
            gather = _gather_kernel(law(cloud.material, self._real), self._real, cloud.material.state, fluid)
            speed = gather(cloud.records, grid, numbers)
            cloud.least = 1.0 + float(numbers[_LEAST])
            fastest = speed if not speed <= fastest else fastest
        self._fastest = float(fastest)
        for bearer in self.bearers:
            bearer.move(dt)
        self._drift += self._fastest * dt
        self.time += dt
        self.steps += 1

    def _numbers(self, dt: float) -> NDArray[Any]:
        """Of each cloud, what the kernels of a step are given (clouds, 25)."""
        given = np.zeros((len(self._clouds), _LEAST + 1), self._type)
        given[:, [_NY, _NZ, _CELLS]] = *self._shape[1:], 1 / self.dx
        given[:, _ORIGIN : _ORIGIN + 3] = self._corner * self.dx
        # velocities are those of the middle of a step, so that what falls freely falls exactly
        given[:, _KICK : _KICK + 3] = (self._last + dt) / 2 * self.gravity
        given[:, _STRIDE : _STRIDE + 3] = dt
        if self._fixed is not None:
            given[:, _PARTS : _PARTS + 4] = self._parts(dt)
        for numbers, cloud in zip(given, self._clouds, strict=True):
            parameters = cloud.material.parameters()
            numbers[[_MASS, _PUSH]] = cloud.mass, dt * cloud.volume * 4 / self.dx
            numbers[_LAW : _LAW + len(parameters)] = parameters
        return given

    def _parts(self, dt: float) -> Array:
        """Quanta in a unit of momentum (3) and of mass, powers of two: 2⁶² are more than any node can get.

        No node has more mass than 27 times what is in the fullest block, and nothing stable crosses a cell in a step.
        """
        mass = 27 * max(cloud.mass * cloud.fullest for cloud in self._clouds) * len(self._clouds)
        most = np.array([4 * mass * self.dx / dt] * 3 + [mass])
        return np.exp2(62 - np.ceil(np.log2(most)))

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
        spans = [_span(c.records) for c in self._clouds]
        low, high = np.min([s[0] for s in spans], axis=0), np.max([s[1] for s in spans], axis=0)
        if not np.isfinite([low, high]).all():
            raise ArithmeticError(f"particles are not finite at t = {self.time:.6g} s")
        self._low, self._high = low, high
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
            if self._fixed is not None:
                self._fixed = np.zeros((nodes, 4), np.int64)
        blocks = self._shape // _SIDE
        near = np.zeros(blocks, bool)
        origin = (self._corner * self.dx).astype(self._type)
        for cloud in self._clouds:
            bins = np.zeros(int(np.prod(blocks)) + 1, np.int32)
            _sort(cloud.records, cloud.spare, cloud.order, bins, origin, self._type(1 / self.dx), blocks[1], blocks[2])
            cloud.records, cloud.spare = cloud.spare, cloud.records
            held = np.diff(bins)
            cloud.fullest = int(held.max())
            x, y, z = np.unravel_index(np.flatnonzero(held), blocks)
            slabs = _even(bins[:: blocks[1] * blocks[2]])
            if len(slabs):
                cloud.columns, colour = slabs, np.arange(len(slabs)) % 2
            else:
                begin = bins[:: blocks[2]]
                full = np.flatnonzero(np.diff(begin))
                cloud.columns = np.stack([begin[full], begin[full + 1]], axis=1)
                colour = full // blocks[1] % 2 * 2 + full % blocks[1] % 2
            # the longest first, that none is waited for at the end
            cloud.columns = cloud.columns[np.lexsort([cloud.columns[:, 0] - cloud.columns[:, 1], colour])]
            cloud.starts = np.searchsorted(np.sort(colour), np.arange(5)).tolist()
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    for dz in (-1, 0, 1):
                        near[x + dx, y + dy, z + dz] = True
        for axis in np.flatnonzero(self._cycle):
            along = np.moveaxis(near, axis, 0)
            zero, cycle = -self._corner[axis] // _SIDE, self._cycle[axis]
            ends = [zero + s for s in (-1, 0)] + [zero + (cycle + s) // _SIDE for s in (-_SIDE, -1, 0, _SIDE - 1)]
            along[ends] = along[ends].any(axis=0)
        if not self._sparse:
            near[:] = True
        self._active = np.flatnonzero(near.ravel()).astype(np.int32)
        self._drift = 0.0
