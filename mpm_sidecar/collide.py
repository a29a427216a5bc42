"""What stands in the way of matter: half spaces, balls, boxes, capsules, cylinders, meshes; how it moves them.

At every node of the grid that lies in an obstacle the velocity v of the matter there becomes, relative to the
obstacle's own v₀ + ω × r,

    stick     0
    slip      v - (v·n) n
    separate  v if v·n >= 0, else the slip with Coulomb's friction: shortened by μ |v·n|

Source: A. Stomakhin et al., ACM Trans. Graph. 32 (2013) 102, §8.

What the matter loses, Σ m (v - v'), the obstacle gains. One that can move is met as what it is: were its velocity held
for the step, a light one would be thrown by the whole of the matter's momentum, and more by the next step. So its
velocity at the step's end is sought first: with A the mass that meets it (6 x 6, about its centre of mass, along what
the grip holds) and Λ how it yields to an impulse (6 x 6, through its joints),

    Δ = Λ (1 + A Λ)⁻¹ Σ m (v - v')

and the nodes then meet v₀ + Δ. Whatever Δ is, what one side loses the other gains, to the last bit of the sum. For what
sticks this is the inelastic impact itself, and so stable for any ratio of masses.

Defects: a surface is known to a cell: matter begins to be stopped when its particles' kernels reach the first node that
is in the obstacle; what is thinner than a cell may miss all nodes. An ellipsoid's distance is the first-order one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from physinone_mj.continuum import Grip, Wall

from ._ti import kernels, ti

Array = NDArray[np.float64]

TASK: Final = 512
"""Turns of a loop that Taichi gives to a thread at once on a CPU, whatever `block_dim` says (1.7.4): what is to be done
by several threads takes so many turns, of which the first one works."""

TOUCH: Final = 1e-4
"""Part of a cell by which a node may be off a surface and still be on it."""
_MIDDLE: Final = 1e-15
"""Distance from an ellipsoid's centre, in its radii, up to which it has no normal."""
_TURNS: Final = TASK // 16
"""Of a block: sixteen of them are a thread's task."""


@ti.func
def begin(block, ny, nz):
    """Index of a block's first node along each axis."""
    across, row = nz // 4, (nz // 4) * (ny // 4)
    return 4 * (block // row), 4 * (block % row // across), 4 * (block % across)


def _plane(real: Any) -> Any:
    @ti.func
    def distance(x, _size, _field: ti.template(), _counts, _corner, _spacing):
        return x[2], ti.Vector([0.0, 0.0, 1.0], real)

    return distance


@ti.func
def _length(x, least):
    """Length of a vector, with a least one beside it, and its direction; where it has none any will do: the first
    axis, as zero would stop nothing."""
    square = x.dot(x)
    far = ti.sqrt(square) + least
    way = x / far
    if square == 0:
        for i in ti.static(range(3)):
            way[i] = 1.0 if ti.static(i == 0) else 0.0
    return far, way


def _ball(real: Any) -> Any:
    @ti.func
    def distance(x, size, _field: ti.template(), _counts, _corner, _spacing):
        far, way = _length(x, ti.cast(1e-30, real))
        return far - size[0], way

    return distance


def _ellipsoid(real: Any) -> Any:
    @ti.func
    def distance(x, size, _field: ti.template(), _counts, _corner, _spacing):
        near, steep = x / size, x / (size * size)
        far, slope = ti.sqrt(near.dot(near)), ti.sqrt(steep.dot(steep)) + ti.cast(1e-30, real)
        d, way = far * (far - 1) / slope, steep / slope
        if far < ti.static(_MIDDLE):  # its distance is that along the axis on which one lies: the shortest leads out
            least, found = ti.min(size[0], size[1], size[2]), 0
            d = -least
            for i in ti.static(range(3)):
                way[i] = 0.0
                if found == 0 and size[i] == least:
                    way[i] = 1.0
                    found = 1
        return d, way

    return distance


def _capsule(real: Any) -> Any:
    @ti.func
    def distance(x, size, _field: ti.template(), _counts, _corner, _spacing):
        r = x
        r[2] -= ti.min(ti.max(x[2], -size[1]), size[1])
        far, way = _length(r, ti.cast(1e-30, real))
        return far - size[0], way

    return distance


@ti.func
def _corner_of(out, inner):
    """Distance from where each of two or three distances is at most 0, and which way each counts."""
    beyond = ti.max(out, 0.0)
    far = ti.sqrt(beyond.dot(beyond))
    way = beyond / ti.max(far, 1e-30)
    d = far
    if far == 0.0:
        d = inner
        found = 0
        for i in ti.static(range(3)):
            way[i] = 0.0
            if found == 0 and out[i] == inner:
                way[i] = 1.0
                found = 1
    return d, way


def _box(real: Any) -> Any:
    @ti.func
    def distance(x, size, _field: ti.template(), _counts, _corner, _spacing):
        out = ti.abs(x) - size
        d, way = _corner_of(out, ti.max(out[0], out[1], out[2]))
        for i in ti.static(range(3)):
            if x[i] < 0:
                way[i] = -way[i]
        return d, ti.cast(way, real)

    return distance


def _cylinder(real: Any) -> Any:
    @ti.func
    def distance(x, size, _field: ti.template(), _counts, _corner, _spacing):
        square = x[0] ** 2 + x[1] ** 2
        across = ti.sqrt(square) + ti.cast(1e-30, real)
        out = ti.Vector([across - size[0], ti.abs(x[2]) - size[1], -1e30])
        d, way = _corner_of(out, ti.max(out[0], out[1]))
        up = way[1]
        if x[2] < 0:
            up = -up
        side = way[0] * x[0] / across
        if square == 0:
            side = way[0]
        return d, ti.Vector([side, way[0] * x[1] / across, up], real)

    return distance


def _mesh(real: Any) -> Any:
    @ti.func
    def value(at, field: ti.template(), counts):
        p = ti.Vector.zero(ti.i32, 3)
        f = ti.Vector.zero(real, 3)
        for i in ti.static(range(3)):
            p[i] = ti.min(ti.max(ti.cast(ti.floor(at[i]), ti.i32), 0), counts[i] - 2)
            f[i] = ti.min(ti.max(at[i] - p[i], 0.0), 1.0)
        total = ti.cast(0.0, real)
        for i in ti.static(range(2)):
            for j in ti.static(range(2)):
                for k in ti.static(range(2)):
                    w = (f[0] if i else 1 - f[0]) * (f[1] if j else 1 - f[1]) * (f[2] if k else 1 - f[2])
                    total += w * field[((p[0] + i) * counts[1] + p[1] + j) * counts[2] + p[2] + k]
        return total

    @ti.func
    def distance(x, _size, field: ti.template(), counts, corner, spacing):
        at = (x - corner) / spacing
        d, n = value(at, field, counts), ti.Vector.zero(real, 3)
        for i in ti.static(range(3)):
            if at[i] < 0 or at[i] > counts[i] - 1:  # away from the field
                d = ti.max(d, spacing)
            step = ti.Vector.zero(real, 3)
            step[i] = 0.5
            n[i] = value(at + step, field, counts) - value(at - step, field, counts)
        _, way = _length(n, ti.cast(1e-30, real))
        return d, way

    return distance


_DISTANCES: Final[dict[str, Callable[[Any], Any]]] = {
    "plane": _plane, "ball": _ball, "ellipsoid": _ellipsoid, "capsule": _capsule, "box": _box, "cylinder": _cylinder,
    "mesh": _mesh,
}  # fmt: skip
"""ti.func (place in the obstacle's axes, size, field...) -> (signed distance [m], normal) of each shape."""


def _stick(real: Any) -> Any:
    @ti.func
    def answer(_v, _n, _friction):
        return ti.Vector.zero(real, 3), ti.Matrix.identity(real, 3)

    return answer


def _slip(_real: Any) -> Any:
    @ti.func
    def answer(v, n, _friction):
        return v - v.dot(n) * n, n.outer_product(n)

    return answer


def _separate(real: Any) -> Any:
    @ti.func
    def answer(v, n, friction):
        into = v.dot(n)
        after, held = v, ti.Matrix.zero(real, 3, 3)
        if into < 0:
            along = v - into * n
            speed = ti.sqrt(along.dot(along))
            left, push = ti.cast(0.0, real), n
            if speed > -friction * into:
                left = 1 + friction * into / speed
                push = n - friction * along / speed
                held = push.outer_product(n)
            else:
                held = ti.Matrix.identity(real, 3)
            after = left * along
        return after, held

    return answer


_ANSWERS: Final[dict[Grip, Callable[[Any], Any]]] = {"stick": _stick, "slip": _slip, "separate": _separate}
"""ti.func (relative velocity, normal, friction) -> (that afterwards, ∂(v - v')/∂v) of each grip."""


@kernels
def _kernel(shape: str, grip: Grip, weighs: bool, real: Any) -> Any:
    """What a shape does to the nodes in it, or would if it weighs them alone, at a precision; the sums by block."""
    distance, answer = _DISTANCES[shape](real), _ANSWERS[grip](real)
    exact = shape != "ellipsoid"
    node = ti.types.vector(4, real)
    whole, nodes = ti.types.ndarray(dtype=ti.i32, ndim=1), ti.types.ndarray(dtype=node, ndim=1)
    numbers, sums = ti.types.ndarray(dtype=real, ndim=1), ti.types.ndarray(dtype=real, ndim=2)

    @ti.func
    def three(given: ti.template(), i):
        return ti.Vector([given[i], given[i + 1], given[i + 2]])

    @ti.func
    def weight(m, r):
        """What a mass (3, 3) at an arm takes of a velocity V and a spin W, (6, 6): m (V + W × r), and its moment."""
        turn = ti.Matrix([[0.0, r[2], -r[1]], [-r[2], 0.0, r[0]], [r[1], -r[0], 0.0]])
        across, along = m @ turn, turn.transpose() @ m
        both = along @ turn
        out = ti.Matrix.zero(real, 6, 6)
        for s in ti.static(range(3)):
            for t in ti.static(range(3)):
                out[s, t], out[s, 3 + t] = m[s, t], across[s, t]
                out[3 + s, t], out[3 + s, 3 + t] = along[s, t], both[s, t]
        return out

    @ti.kernel
    def meet(grid: nodes, blocks: whole, given: numbers, field: numbers, out: sums):
        for go in range(out.shape[0] * ti.static(_TURNS)):
            if go % ti.static(_TURNS) != 0:
                continue
            a = go // ti.static(_TURNS)
            # one array instead of a dozen arguments: each costs more to hand over than its numbers to read
            origin, centre, size, pivot = three(given, 0), three(given, 3), three(given, 6), three(given, 9)
            velocity, spin, corner = three(given, 12), three(given, 15), three(given, 18)
            turn = ti.Matrix.rows([three(given, 21), three(given, 24), three(given, 27)])
            counts, dx, reach = ti.cast(three(given, 30), ti.i32), given[33], given[34]
            friction, spacing = given[35], given[36]
            ny, nz = ti.cast(given[37], ti.i32), ti.cast(given[38], ti.i32)
            x, y, z = begin(blocks[a], ny, nz)
            push, moment = ti.Vector.zero(real, 3), ti.Vector.zero(real, 3)
            mass = ti.Matrix.zero(real, 6, 6 if ti.static(weighs) else 1)
            middle = origin + dx * ti.Vector([x + 1.5, y + 1.5, z + 1.5]) - centre
            far, _ = distance(turn.transpose() @ middle, size, field, counts, corner, spacing)
            if ti.sqrt(middle.dot(middle)) < reach + 3 * dx and (far < 3 * dx or not ti.static(exact)):
                for i in range(4):
                    for j in range(4):
                        for k in range(4):
                            here = ((x + i) * ny + y + j) * nz + z + k
                            g = grid[here]
                            at = origin + dx * ti.Vector([x + i, y + j, z + k])
                            if g[3] > 0:
                                inner = turn.transpose() @ (at - centre)
                                d, local = distance(inner, size, field, counts, corner, spacing)
                                if d <= ti.static(TOUCH) * dx:
                                    v, arm = ti.Vector([g[0], g[1], g[2]]), at - pivot
                                    surface = velocity + spin.cross(arm)
                                    after, held = answer(v - surface, turn @ local, friction)
                                    after += surface
                                    lost = g[3] * (v - after)
                                    push += lost
                                    moment += arm.cross(lost)
                                    if ti.static(weighs):
                                        mass += weight(g[3] * held, arm)
                                    else:
                                        grid[here] = ti.Vector([after[0], after[1], after[2], g[3]])
            for s in ti.static(range(3)):
                out[a, s] = push[s]
                out[a, 3 + s] = moment[s]
            if ti.static(weighs):
                for s in ti.static(range(6)):
                    for t in ti.static(range(6)):
                        out[a, 6 + 6 * s + t] = mass[s, t]

    return meet


@kernels
def _probe(shape: str) -> Any:
    """Signed distances of places in a shape's own axes."""
    distance = _DISTANCES[shape](ti.f64)
    place, numbers = ti.types.vector(3, ti.f64), ti.types.ndarray(dtype=ti.f64, ndim=1)
    places, three = ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=1), ti.types.vector(3, ti.i32)

    @ti.kernel
    def probe(
        points: places, size: place, field: numbers, counts: three, corner: place, spacing: ti.f64, out: numbers
    ):  # fmt: skip
        for p in points:
            d, _ = distance(points[p], size, field, counts, corner, spacing)
            out[p] = d

    return probe


@dataclass
class Obstacle:
    """A shape that matter meets.

    shape: "plane" (z <= 0 is in it), "ball", "ellipsoid", "capsule", "box", "cylinder" or "mesh"
    size: as MuJoCo's: radius; radii; radius, half; halves; radius, half [m]
    centre (3,) [m], turn (3, 3): where its axes are
    values, corner, spacing: of a mesh, its signed distances (nx, ny, nz) in its axes, the first one's place, their
    spacing [m]
    """

    shape: str
    size: tuple[float, ...] = ()
    grip: Grip = "separate"
    friction: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    turn: Array = field(default_factory=lambda: np.eye(3))
    values: NDArray[np.float32] | None = None
    corner: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spacing: float = 1.0

    def __post_init__(self) -> None:
        if self.shape not in _DISTANCES:
            raise ValueError(f"shape = {self.shape!r} of an obstacle; allowed: {', '.join(_DISTANCES)}")
        if (self.values is None) == (self.shape == "mesh"):
            raise ValueError(f"an obstacle {self.shape!r}; allowed: a field of distances for a mesh, and for it alone")
        if self.grip not in _ANSWERS or not 0 <= self.friction < math.inf:
            raise ValueError(f"grip = {self.grip!r}, friction = {self.friction}; allowed: {', '.join(_ANSWERS)}, "
                             f"0 or more")  # fmt: skip

    def depth(self, points: Array) -> Array:
        """Signed distance of places (n, 3) [m] from its surface, below 0 inside (n,) [m]; in double precision."""
        out, (field, counts) = np.empty(len(points)), self.field(np.float64)
        _probe(self.shape)(
            np.ascontiguousarray((points - self.centre) @ self.turn),
            ti.Vector((*self.size, 0.0, 0.0, 0.0)[:3], ti.f64), field, ti.Vector(counts, ti.i32),
            ti.Vector(self.corner, ti.f64), self.spacing, out,
        )  # fmt: skip
        return out

    def field(self, dtype: Any) -> tuple[NDArray[Any], tuple[int, ...]]:
        """Its distances in a row and how many there are along each axis; one, of nothing, if it is no mesh."""
        if self.values is None:
            return np.zeros(1, dtype), (1, 1, 1)
        return self.values.astype(dtype, copy=False).ravel(), self.values.shape

    @property
    def reach(self) -> float:
        """Radius around its centre outside of which it is not [m]."""
        if self.values is not None:
            corners = np.array([self.corner, np.add(self.corner, np.multiply(self.spacing, self.values.shape))])
            return float(np.linalg.norm(np.abs(corners).max(axis=0)))
        if self.shape in ("ball", "capsule"):
            return sum(self.size)
        return 1e30 if self.shape == "plane" else math.hypot(*self.size)

    @classmethod
    def wall(cls, wall: Wall) -> "Obstacle":
        """A half space."""
        return cls("plane", grip=wall.grip, friction=wall.friction, centre=np.array(wall.point, float),
                   turn=_axes(np.array(wall.normal, float)))  # fmt: skip


def _axes(normal: Array) -> Array:
    """A rotation (3, 3) that takes z to a direction."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across), normal], axis=1)


@dataclass
class Bearer:
    """A rigid body as matter meets it: its obstacles, how it moves, how it yields, and what it has been given.

    pivot: its centre of mass (3,) [m]; velocity of that (3,) [m/s]; spin (3,) [rad/s]
    yields: Λ (6, 6), change of (velocity, spin) by an impulse and its moment about the pivot; None: fixed or driven
    impulse, twist: given to it so far, and its moment about the world's origin [N s, N m s]; latest: (6,) what the last
    step gave of both
    """

    obstacles: list[Obstacle]
    pivot: Array = field(default_factory=lambda: np.zeros(3))
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    spin: Array = field(default_factory=lambda: np.zeros(3))
    yields: Array | None = None
    impulse: Array = field(default_factory=lambda: np.zeros(3))
    twist: Array = field(default_factory=lambda: np.zeros(3))
    latest: Array = field(default_factory=lambda: np.zeros(6))

    def speed(self, low: Array, high: Array) -> float:
        """That nothing of it exceeds within a box from corner to corner (3,) [m]; [m/s]."""
        if not (self.velocity.any() or self.spin.any()):
            return 0.0
        away = float(np.linalg.norm(np.maximum(np.abs(low - self.pivot), np.abs(high - self.pivot))))
        reach = max((float(np.linalg.norm(o.centre - self.pivot)) + o.reach for o in self.obstacles), default=0.0)
        return float(np.linalg.norm(self.velocity)) + float(np.linalg.norm(self.spin)) * min(reach, away)

    def move(self, dt: float) -> None:
        """Go on for a time [s] as it moves now."""
        angle = float(np.linalg.norm(self.spin)) * dt
        turn = np.eye(3)
        if angle > 0:
            x, y, z = self.spin * dt / angle
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            turn = turn + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        before = self.pivot
        self.pivot = before + dt * self.velocity
        for obstacle in self.obstacles:
            obstacle.centre = self.pivot + turn @ (obstacle.centre - before)
            obstacle.turn = turn @ obstacle.turn

    def meet(self, grid: Any, blocks: Any, shape: Any, origin: Any, dx: float, real: Any) -> None:
        """Change the velocities of the grid's nodes (nodes, 4) that are in it; it gains what they lose.

        blocks: active ones; shape: of the grid [nodes]; origin: place of its first node (3,) [m]
        """
        velocity, spin = self.velocity, self.spin
        if self.yields is not None:
            met = self._sums(grid, blocks, shape, origin, dx, real, velocity, spin, weighs=True)
            if not met[:6].any():
                self.latest = np.zeros(6)
                return
            weight = met[6:].reshape(6, 6)
            change = np.linalg.solve(np.eye(6) + self.yields @ weight, self.yields @ met[:6])
            velocity, spin = velocity + change[:3], spin + change[3:]
        given = self._sums(grid, blocks, shape, origin, dx, real, velocity, spin, weighs=False)
        if self.yields is not None:
            change = self.yields @ given
            self.velocity, self.spin = self.velocity + change[:3], self.spin + change[3:]
        self.latest = np.concatenate([given[:3], given[3:] + np.cross(self.pivot, given[:3])])
        self.impulse, self.twist = self.impulse + self.latest[:3], self.twist + self.latest[3:]

    def _sums(
        self, grid: Any, blocks: Any, shape: Any, origin: Any, dx: float, real: Any, velocity: Array, spin: Array, *,
        weighs: bool,
    ) -> Array:  # fmt: skip
        total = np.zeros(42 if weighs else 6)
        out = np.zeros((len(blocks), len(total)), grid.dtype)
        for obstacle in self.obstacles:
            field, counts = obstacle.field(grid.dtype)
            given = np.concatenate([
                origin, obstacle.centre, (*obstacle.size, 0.0, 0.0, 0.0)[:3], self.pivot, velocity, spin,
                obstacle.corner, obstacle.turn.ravel(), counts,
                (dx, obstacle.reach, obstacle.friction, obstacle.spacing, shape[1], shape[2]),
            ]).astype(grid.dtype)  # fmt: skip
            _kernel(obstacle.shape, obstacle.grip, weighs, real)(grid, blocks, given, field, out)
            total += out.sum(axis=0, dtype=float)
        return total
