"""Constraints: contact, limits, welds and motors as the rows that MuJoCo's solver satisfies, exactly.

MuJoCo solves a convex problem, which differs from rigid bodies with Coulomb friction in two ways: its contacts are
slightly soft (the regularisation R), and a slipping contact is pushed apart by μ × slip (the dual of the friction cone
is wider than the half space). Both are cured here by moving the rows' reference and solving again until it stays:

    reference = target + R f - μ |c_t| n̂

f: row forces; c: how far the last solution missed its target, c_t its tangential part; n̂: the contact's normal row.
At the fixed point c_n ≥ 0, f_n ≥ 0, c_n f_n = 0, |f_t| ≤ μ f_n, f_t = -μ f_n c_t/|c_t|: Signorini's condition and
Coulomb's law. The term μ|c_t| is De Saxcé's (G. De Saxcé & Z.-Q. Feng, Math. Comput. Modelling 28 (1998) 225, eq. 12),
the fixed point on it that of V. Acary & F. Cadoux (2013); R f is one step of the proximal point method.

The targets are velocities, at the end of a step or of an instantaneous impact:

    step     v_n' ≥ -(gap left), v_t' = 0 until the friction limit is met
    impact   v_n' = -e v_n (I. Newton's law of restitution), v_t' = 0 within the same cone of impulses

A limit of a joint or a tendon (a taut string) is a contact without friction and restitution; an equality holds
v' = -(part of the gap); a motor v' = its speed, as long as its greatest force suffices; friction in a joint v' = 0
likewise. Rows are written for the middle of a step and v' for its end. Between the two the directions of a turning
contact turn: what this changes, J̇v h/2, is observed from step to step and taken off the targets of contacts and
joints, so that what rides on a turntable stays there (half the centripetal acceleration).

Defects, stated: one coefficient of restitution per pair, whatever the speed, and impulses that are resolved together
when contacts close at the same instant (a cradle needs gaps). Newton's restitution together with friction can create
energy where a corner strikes obliquely (T. R. Kane, 1984): an impact that adds more than `CREATED` of what moves is
resolved with half of the restitution, or none, as `eased` counts; what adds less stays. Static friction passes to
kinetic at a slip of `CREEP` m/s, a step and not Stribeck's curve.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .collision import Collider
from .run import Break, Impact

if TYPE_CHECKING:
    from .scene import Bond, Bowl, Motor

Array = NDArray[np.float64]

CREEP: Final = 1e-3
"""Slip below which a contact is held by static friction, above by kinetic friction [m/s]."""

TOUCH: Final = 1e-9
"""Surfaces closer than this have met [m]."""

_MAX_SHIFTS: Final = 2000
_SETTLED: Final = 1e-12
"""The references have settled when none moves a velocity by more than this [m/s]."""

_CLOSE: Final = 1e-5
_PATIENCE: Final = 10
"""Several contacts of one face can share a load in many ways, and their targets disagree by what the face turns in a
step: then the references drift on along a direction in which nothing moves. They count as settled, too, when they are
this close [m/s] and no nearer by half after this many solutions."""

_STEADY: Final = 0.8
_ENDLESS: Final = 0.9999
"""Fractions between which steps that shrink evenly are added up at once; closer to 1 there is nowhere to go."""

_LONG: Final = 200
_NEARLY: Final = 1e-4
"""Chunks wedged between others approach their solution ever more slowly: after this many solutions, this fraction of
the greatest speed of approach (or of 1 m/s) is near enough."""

_MANY: Final = 32
_AT_FIRST: Final = 1e-7
_EASED: Final = 10
_WEARY: Final = 150
_COARSELY: Final = 0.01
"""Where more contacts than this bear on each other, what is asked of them is eased with every solution, tenfold every
second, from this [m/s] on and so many times: colliding in a heap, at metres per second, they settle to a centimetre per
second within ten solutions; at rest, from step to step, to the last digit. What goes on longer, hundreds of contacts at
once, is let be at this part of the greatest speed of approach."""

_ROUNDS: Final = 100
_FEW_ROUNDS: Final = 8
_LIVELY: Final = 1e-3
"""Rounds of Newton's method in one solution. In such a heap, as long as any of it meets faster than this [m/s], the
references move on before the solution is found exactly."""

_MISSING: Final = 1e-3
"""And by how much forces and accelerations may then still miss each other, over the greatest force."""

_OPEN: Final = -1e15
"""Target of a row that must not act: no motion is that slow."""

PUSH_OUT: Final = 0.1
"""Fraction of a penetration taken back in one whole step; what is taken back becomes speed, so it stays small."""

_LEAST_RELAX: Final = 1 / 8

CREATED: Final = 1e-4
PUSHED: Final = 1e-3
"""Part of the kinetic energy that the contacts of an impact may add to it; and part of what is there that those of a
step may add in which overlaps are taken back, where what is jammed might fly apart."""

OVERLAPPING: Final = "overlaps left as they are"
DULLED: Final = "with less restitution"
INELASTIC: Final = "without restitution"
CONVEX: Final = "convex contact"
"""How a contact problem is eased that cannot be solved as it is."""

_DISABLE = mujoco.mjtDisableBit
_KIND = mujoco.mjtConstraint
_EQUALITY: Final = int(_KIND.mjCNSTR_EQUALITY)
_FRICTION_DOF: Final = int(_KIND.mjCNSTR_FRICTION_DOF)
_FRICTION_TENDON: Final = int(_KIND.mjCNSTR_FRICTION_TENDON)
_LIMIT_JOINT: Final = int(_KIND.mjCNSTR_LIMIT_JOINT)
_LIMIT_TENDON: Final = int(_KIND.mjCNSTR_LIMIT_TENDON)
_PRESCRIBED: Final = 1e12
"""The force of a motor that prescribes a motion: more than any scene's [N]."""

CONTACT_TIME: Final = 1e-3
"""How long an impact lasts as far as bonds are concerned: its impulse over this is the force that may break them [s].
Rigid bodies have no such time; a millisecond is that of fist-sized hard things at metres per second."""

ADJOINING: Final = 5e-5
"""Bodies that were one until this instant touch, in it, if they are nearer than this [m]: what breaks off still pushes
against what it breaks from."""

CLOSURE: Final = 0.5
"""Fraction of an equality's gap closed in one whole step; all of it would ring."""

_TOGETHER: Final = 0.9
_AT_ONCE: Final = 1 / 8
"""Bonds loaded to within the first of the worst break together, and so does the second, at least, of those that are
overloaded, the worst of them; then the load is shared anew."""

_TINY: Final = 1e-6
"""By how much at most the positions are moved to see how the equalities' rows turn [m, rad]."""

STILL: Final = 1e-8
"""A free body slower than this [m/s] for `_STILL_STEPS` steps, with all that it touches, is put to sleep."""
_STILL_STEPS: Final = 10
_CROWD_STILL: Final = 1e-4
_CROWD_STILL_TIME: Final = 0.1
"""The same in a heap of more than `_MANY` contacts [m/s, s], whose solution is no more exact than that."""

NEAR: Final = 1e-7
"""Gaps up to this [m] are closed at the pace at which penetrations are taken back: the corners of a resting face, some
of them a hair above and some below, then agree on how it moves."""


BLUR: Final = 2.0**-23
"""Vertices of meshes are known to single precision: gaps up to this fraction of their size are none."""


@dataclass(frozen=True)
class Surface:
    """What a material brings to a contact; the pair takes the mean of the two (Unreal Engine's default rule).

    friction: coefficient of kinetic friction; static: of static friction (the kinetic one when not given);
    restitution: speed after / before a normal impact.
    """

    friction: float = 0.0
    restitution: float = 0.0
    static: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.friction < float("inf"):
            raise ValueError(f"friction = {self.friction}; allowed: 0 or more")
        if not self.friction <= self.static_friction < float("inf"):
            raise ValueError(f"static friction = {self.static}; allowed: the kinetic {self.friction} or more")
        if not 0 <= self.restitution <= 1:
            raise ValueError(f"restitution = {self.restitution}; allowed: 0 to 1")

    @property
    def static_friction(self) -> float:
        """Coefficient of static friction."""
        return self.friction if self.static is None else self.static

    def against(self, other: Surface) -> Surface:
        """The pair's surface: the mean of both, property by property."""
        return Surface(
            friction=(self.friction + other.friction) / 2,
            restitution=(self.restitution + other.restitution) / 2,
            static=(self.static_friction + other.static_friction) / 2,
        )


_SPIN_ROUNDS: Final = 20
_MOST_TURN: Final = 0.25
"""Turned by more than this in a step [rad], what flies is advanced by shorter steps."""


@njit(cache=True)
def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _solve3(columns: Array, right: Array) -> Array:
    """x of x₀ columns₀ + x₁ columns₁ + x₂ columns₂ = right (G. Cramer's rule); not finite if they lie in a plane."""
    a, b, c = columns
    volume = np.sum(a * _cross(b, c))
    if volume == 0.0:
        return np.full(3, np.inf)
    x = np.array([np.sum(right * _cross(b, c)), np.sum(right * _cross(c, a)), np.sum(right * _cross(a, b))])
    return np.asarray(x / volume)


@njit(cache=True)
def _mean_spins(dof: NDArray[np.int32], inertia: Array, velocity: Array, dt: float) -> None:
    """Replace the spins of free bodies by those of the middle of a step that has no torques but the gyroscopic.

    ω̄ = ω - (dt/2) I⁻¹ (ω̄ × I ω̄): the implicit midpoint rule, which keeps ω·Iω and |Iω| whatever the step; an explicit
    one winds up what spins fast. What turns so far in a step that Newton's method does not find ω̄ keeps its axis.
    inertia: (n, 3, 3) about the axes of the body, in which its spin velocity[dof + 3 : dof + 6] is given, too
    """
    slope = np.empty((3, 3))
    for i in range(dof.shape[0]):
        d, tensor = dof[i] + 3, inertia[i]
        first = velocity[d : d + 3].copy()
        size = np.sum(np.abs(first))
        mean, found = first.copy(), size == 0.0
        for _ in range(_SPIN_ROUNDS):
            if found:
                break
            angular = tensor @ mean
            missing = tensor @ (mean - first) + 0.5 * dt * _cross(mean, angular)
            for k in range(3):  # the derivative by each component
                axis = np.zeros(3)
                axis[k] = 1.0
                slope[k] = tensor[k] + 0.5 * dt * (_cross(axis, angular) + _cross(mean, tensor[k]))
            change = _solve3(slope, missing)
            mean -= change
            found = np.sum(np.abs(change)) <= 1e-13 * size
        if not found:
            mean[:] = 0.0
        velocity[d : d + 3] = mean


@njit(cache=True)
def _leave_out_gyroscopic(dof: NDArray[np.int32], inertia: Array, velocity: Array, acceleration: Array) -> None:
    """Take from the accelerations of free bodies what their own turning at these velocities causes."""
    for i in range(dof.shape[0]):
        d = dof[i] + 3
        spin = velocity[d : d + 3].copy()
        acceleration[d : d + 3] += _solve3(inertia[i], _cross(spin, inertia[i] @ spin))


@njit(cache=True)
def _doze(
    body: NDArray[np.int32],
    dof: NDArray[np.int32],
    radius: Array,
    velocity: Array,
    applied: Array,
    geom: NDArray[np.int32],
    body_of: NDArray[np.int32],
    static: NDArray[np.bool_],
    held: NDArray[np.bool_],
    still: NDArray[np.int32],
    heap: NDArray[np.int32],
    slow: float,
    steps: int,
) -> bool:
    """Count for how many steps every free body has been slow; put to sleep the heaps that have been so long enough.

    heap: (nbody,) 0 for who is awake, otherwise the number of the heap that wakes together. True if any fell asleep.
    """
    candidates = False
    for i in range(body.shape[0]):
        b, d = body[i], dof[i]
        v = np.sqrt(velocity[d] ** 2 + velocity[d + 1] ** 2 + velocity[d + 2] ** 2)
        w = np.sqrt(velocity[d + 3] ** 2 + velocity[d + 4] ** 2 + velocity[d + 5] ** 2)
        pushed = held[b]
        for k in range(6):
            pushed = pushed or applied[b, k] != 0.0
        still[b] = 0 if pushed or v + w * radius[i] > slow else still[b] + 1
        candidates = candidates or (still[b] >= steps and heap[b] == 0)
    if not candidates:
        return False
    ripe = (still >= steps) & (heap == 0)
    label = np.arange(ripe.shape[0])
    changed = True
    while changed:
        changed = False
        for c in range(geom.shape[0]):
            first, second = body_of[geom[c, 0]], body_of[geom[c, 1]]
            for side in range(2):
                a, b = (first, second) if side == 0 else (second, first)
                if ripe[a] and not ripe[b] and not static[b]:
                    ripe[a] = False
                    changed = True
            if ripe[first] and ripe[second] and label[first] != label[second]:
                label[first] = label[second] = min(label[first], label[second])
                changed = True
    for b in range(ripe.shape[0]):
        if ripe[b]:
            heap[b] = label[b]
    return bool(ripe.any())


@dataclass(frozen=True)
class Joined:
    """What else than pairs of surfaces holds the bodies of a compiled model, by the numbers of the model.

    motors: (degree of freedom, motor); bonds: (equality, bond); cups: (bowl, geom that may lie in it, their surface)
    """

    motors: tuple[tuple[int, Motor], ...] = ()
    bonds: tuple[tuple[int, Bond], ...] = ()
    cups: tuple[tuple[Bowl, int, Surface], ...] = ()


_NOTHING_ELSE: Final = Joined()


@njit(cache=True)
def _leap(first: Array, second: Array, third: Array, reference: Array) -> bool:
    """Aitken's extrapolation to where three references in a row are heading, if each step is the same fraction of the
    one before. A heavy load that slips on what is light comes to its reference so slowly: the fraction is κ/(1 + κ),
    κ = μ² times the ratio of the masses."""
    before, last = second - first, third - second
    square = np.sum(before**2)
    if not 0.0 < square < np.inf:
        return False
    fraction = np.sum(before * last) / square
    astray = np.sum((last - fraction * before) ** 2)
    if not (_STEADY < fraction < _ENDLESS and astray < 1e-2 * np.sum(last**2)):
        return False
    reference[:] = third + last * (fraction / (1.0 - fraction))
    return True


class NotSettled(ArithmeticError):
    """The fixed point on Coulomb's law did not converge."""


@njit(cache=True)
def _reach(
    body_of: NDArray[np.int32], root_of: NDArray[np.int32], radius: Array, where: Array, cvel: Array, com: Array
) -> tuple[float, float]:
    """Fastest that any two surfaces of the scene can approach each other [m/s], and that any turns [rad/s]."""
    fastest = quickest = 0.0
    for g in range(body_of.shape[0]):
        v, centre = cvel[body_of[g]], com[root_of[body_of[g]]]
        spin = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        arm = radius[g] + np.sqrt(np.sum((where[g] - centre) ** 2))
        if spin > 0.0 or radius[g] > 0.0:
            fastest = max(fastest, np.sqrt(v[3] ** 2 + v[4] ** 2 + v[5] ** 2) + spin * arm)
            quickest = max(quickest, spin)
    return 2.0 * fastest, quickest


@njit(cache=True)
def _look(
    dist: Array,
    pos: Array,
    frame: Array,
    geom: NDArray[np.int32],
    body_of: NDArray[np.int32],
    root_of: NDArray[np.int32],
    cvel: Array,
    com: Array,
    kind: NDArray[np.int32],
    row_gap: Array,
    row_speed: Array,
    cut: float,
    dt: float,
    speed: Array,
) -> tuple[float, float, bool]:
    """Normal speeds of all contacts; the soonest impact (time until it, gap left) and whether anything touches.

    An impact that lies back in time has a negative gap: surfaces that approach faster than `cut` and overlap.
    """
    soonest, gap, engaged = np.inf, np.inf, False
    for i in range(dist.shape[0]):
        normal = 0.0
        for side in range(2):
            body = body_of[geom[i, side]]
            root = root_of[body]
            sign = 1.0 if side == 1 else -1.0
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                arm_a, arm_b = pos[i, a] - com[root, a], pos[i, b] - com[root, b]
                # cvel holds (ω, velocity of the point that coincides with the tree's centre of mass)
                normal += sign * frame[i, k] * (cvel[body, 3 + k] + cvel[body, a] * arm_b - cvel[body, b] * arm_a)
        speed[i] = normal
        if normal < -cut:
            if dist[i] / -normal < soonest:
                soonest, gap = dist[i] / -normal, dist[i]
        elif dist[i] + (normal - cut) * dt < 0.0:
            engaged = True
    for row in range(kind.shape[0]):
        if kind[row] < _LIMIT_JOINT:
            engaged = True
        elif kind[row] <= _LIMIT_TENDON:
            if row_speed[row] < -cut:
                if row_gap[row] / -row_speed[row] < soonest:
                    soonest, gap = row_gap[row] / -row_speed[row], row_gap[row]
            elif row_gap[row] + (row_speed[row] - cut) * dt < 0.0:
                engaged = True
    return soonest, gap, engaged


@njit(cache=True)
def _drift(
    geom: NDArray[np.int32],
    address: NDArray[np.int32],
    dim: NDArray[np.int32],
    frame: Array,
    velocity: Array,
    before_geom: NDArray[np.int32],
    before_address: NDArray[np.int32],
    before_dim: NDArray[np.int32],
    before_frame: Array,
    before: Array,
    drift: Array,
) -> None:
    """What the turning of the rows has made of the same velocities since the last step: J v - J_before v.

    Of the contacts of two geoms the mean is taken, as a vector of the world: a shift of one against the other, which
    all of them can follow together; what is left is of the next order, and would set them against each other. Geoms
    that touched otherwise before are left out; the rest does not mind them.
    """
    n, m = geom.shape[0], before_geom.shape[0]
    mean = np.zeros(3)
    i = 0
    while i < n:
        stop = i
        while stop < n and geom[stop, 0] == geom[i, 0] and geom[stop, 1] == geom[i, 1]:
            stop += 1
        then = 0
        while then < m and (before_geom[then, 0] != geom[i, 0] or before_geom[then, 1] != geom[i, 1]):
            then += 1
        last = then
        while last < m and before_geom[last, 0] == geom[i, 0] and before_geom[last, 1] == geom[i, 1]:
            last += 1
        same = last - then == stop - i
        count = 0
        mean[:] = 0.0
        for c in range(i, stop):
            if not same:
                break
            b = then + c - i
            along = 0.0
            for k in range(3):
                along += frame[c, k] * before_frame[b, k]
            same = dim[c] == before_dim[b] and (address[c] < 0) == (before_address[b] < 0) and along >= 0.9
            if same and address[c] >= 0:
                count += 1
                for j in range(min(dim[c], 3)):
                    v, v_before = velocity[address[c] + j], before[before_address[b] + j]
                    for k in range(3):
                        mean[k] += v * frame[c, 3 * j + k] - v_before * before_frame[b, 3 * j + k]
        if same and count:
            for c in range(i, stop):
                if address[c] >= 0:
                    for j in range(min(dim[c], 3)):
                        for k in range(3):
                            drift[address[c] + j] += mean[k] / count * frame[c, 3 * j + k]
        i = stop


@njit(cache=True)
def _aim(
    dist: Array,
    geom: NDArray[np.int32],
    address: NDArray[np.int32],
    dim: NDArray[np.int32],
    friction: Array,
    mu: Array,
    speed: Array,
    drive: Array,
    law: NDArray[np.int32],
    restitution: Array,
    kinetic: Array,
    static: Array,
    touch: Array,
    blur: Array,
    velocity: Array,
    drift: Array,
    target: Array,
    cut: float,
    dt: float,
    step: float,
    impact: bool,
    crowded: bool,
) -> None:
    """Every contact row's target: a change of velocity (impact) or an acceleration over the step dt."""
    for i in range(dist.shape[0]):
        row = address[i]
        if row < 0:
            continue
        pair = law[geom[i, 0], geom[i, 1]]
        normal = velocity[row]
        if impact:
            e = restitution[pair] if -normal * restitution[pair] > cut else 0.0
            target[row] = _OPEN if dist[i] > touch[pair] else -normal - e * min(normal, 0.0)
        elif speed[i] - 0.5 * drift[row] < -cut:  # the turning of what touches already is no impact
            # about to collide: the impact's business, not this step's, unless there is no time for each of them
            e = restitution[pair] if -normal * restitution[pair] > cut else 0.0
            meets = crowded and dist[i] + 0.5 * normal * dt < 0.0
            target[row] = -(1.0 + e) * normal / dt if meets else _OPEN
        else:
            # the gap of the middle of the piece, from which a straight way strays where surfaces curve or turn; half of
            # the motion is left to close it
            gap = dist[i] - drift[row] * dt / 8
            gap -= min(max(gap, -blur[pair]), blur[pair])
            open_, shut = max(gap - NEAR, 0.0), max(min(gap, NEAR) * PUSH_OUT / step, -cut)
            turned = 0.5 * drift[row] if gap < NEAR else 0.0
            target[row] = -(normal + turned) / dt - 2.0 * (open_ / dt + shut) / dt
        slip = 0.0
        for j in range(1, dim[i]):
            relative = velocity[row + j] - (drive[i, j - 1] if j < 4 else 0.0)
            slip += relative**2 if j < 3 else 0.0
            target[row + j] = -relative if impact else -(relative + 0.5 * drift[row + j]) / dt
        if dim[i] > 1:
            mu[i] = friction[i, 0] = friction[i, 1] = static[pair] if slip < CREEP**2 else kinetic[pair]


@njit(cache=True)
def _aim_joints(
    kind: NDArray[np.int32],
    number: NDArray[np.int32],
    gap: Array,
    velocity: Array,
    drift: Array,
    course: Array,
    bound: Array,
    prescribed: Array,
    target: Array,
    cut: float,
    dt: float,
    step: float,
    impact: bool,
) -> None:
    """The targets of all rows that are not contacts. course: speed that each degree of freedom's motor holds."""
    for row in range(kind.shape[0]):
        v = velocity[row]
        if kind[row] == _EQUALITY:
            target[row] = -v if impact else -(v + 0.5 * drift[row]) / dt - 2.0 * CLOSURE * gap[row] / (step * dt)
        elif kind[row] <= _FRICTION_TENDON:
            wanted = course[number[row]] if kind[row] == _FRICTION_DOF else 0.0
            target[row] = (wanted - v) / (1.0 if impact else dt)
            if impact and not (kind[row] == _FRICTION_DOF and prescribed[number[row]] > 0.0):
                bound[row] = 1e-12  # what is finite does nothing in no time
        elif kind[row] <= _LIMIT_TENDON:
            if impact:
                target[row] = _OPEN if gap[row] > TOUCH else -v
            elif v - 0.5 * drift[row] < -cut:
                target[row] = _OPEN
            else:
                # a string that swings is taut at mid-step: to a shorter piece it seems slack by what it turns in a step
                near = NEAR + (abs(drift[row]) * step / (8.0 * dt) * step if drift[row] else 0.0)
                open_, shut = max(gap[row] - near, 0.0), max(min(gap[row], near) * PUSH_OUT / step, -cut)
                turned = 0.5 * drift[row] if gap[row] < near else 0.0
                target[row] = -(v + turned) / dt - 2.0 * (open_ / dt + shut) / dt


@njit(cache=True)
def _shift(
    address: NDArray[np.int32],
    dim: NDArray[np.int32],
    friction: Array,
    regulariser: Array,
    force: Array,
    reached: Array,
    target: Array,
    reference: Array,
    relax: float,
    dilate: bool,
) -> float:
    """Move the reference (by a fraction `relax`) to target + R f - μ|c_t| n̂; returns how far the furthest row is.

    dilate: leave the last term out, and with it the problem convex; what slips then moves apart.
    """
    moved = 0.0
    slipping = np.zeros(reference.shape[0])
    for i in range(address.shape[0]):
        row = address[i]
        if row >= 0 and not dilate:
            slip = 0.0
            for j in range(1, dim[i]):
                slip += (friction[i, j - 1] * (reached[row + j] - target[row + j])) ** 2
            slipping[row] = np.sqrt(slip)
    for row in range(reference.shape[0]):
        if target[row] > _OPEN:
            shifted = target[row] + regulariser[row] * force[row] - slipping[row]
            moved = max(moved, abs(shifted - reference[row]))
            reference[row] += relax * (shifted - reference[row])
    return moved


class Solver:
    """The constraint problem of one model: looks for impacts, resolves them, and advances what touches.

    pairs: the surface of each of the model's predefined contact pairs, in order.
    """

    def __init__(self, model: Any, pairs: Sequence[Surface], joined: Joined = _NOTHING_ELSE) -> None:
        self._model = model
        surfaces = [*pairs, *(surface for _, _, surface in joined.cups)]
        self._size = np.where(model.geom_rbound > 0, model.geom_rbound, math.inf)  # a plane has none
        moves = model.body_weldid != 0
        sizes = self._size[moves[model.geom_bodyid]]
        self._heft = float(sizes.min() * model.body_mass[moves].sum()) if len(sizes) else 0.0
        self._pair_of = np.zeros((model.ngeom, model.ngeom), np.int32)
        for i, (a, b) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True)):
            self._pair_of[a, b] = self._pair_of[b, a] = i
        for i, (bowl, b, _) in enumerate(joined.cups, start=len(pairs)):
            a = model.geom(bowl.geom).id
            self._pair_of[a, b] = self._pair_of[b, a] = i
        self._collider = Collider(model, pairs, joined.cups)
        self._restitution = np.array([s.restitution for s in surfaces])
        self._kinetic = np.array([s.friction for s in surfaces])
        self._sticking = np.array([s.static_friction for s in surfaces])
        self._touch = np.full(len(surfaces), TOUCH)
        self._blur = np.zeros(len(surfaces))
        for geoms in (model.pair_geom1, model.pair_geom2):
            meshes = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH
            self._blur[: model.npair] += BLUR * model.geom_rbound[geoms] * meshes
        self._motors = joined.motors
        self._course = np.zeros(model.nv)
        self._prescribed = np.zeros(model.nv)
        for dof, motor in joined.motors:
            self._prescribed[dof] = not math.isfinite(motor.force)
            model.dof_frictionloss[dof] = min(motor.force, _PRESCRIBED)
        self._bonds = joined.bonds
        self._bonded = np.array([equality for equality, _ in joined.bonds], int)
        self._strength = np.array([bond.strength for _, bond in joined.bonds])
        self._lever = np.array([bond.lever for _, bond in joined.bonds])
        self._ends = np.column_stack([model.eq_obj1id, model.eq_obj2id])[self._bonded].reshape(-1, 2)
        self._pair_bodies = model.geom_bodyid[np.column_stack([model.pair_geom1, model.pair_geom2])].reshape(-1, 2)
        self._one = np.zeros(model.npair, bool)
        connects = np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_CONNECT)
        self._turns = np.isin(np.arange(max(model.neq, model.nv, model.ntendon)), connects)
        self._limited = bool(model.jnt_limited.any() or model.tendon_limited.any())
        others = surfaces or joined.motors or joined.bonds or self._limited or model.dof_frictionloss.any()
        self.only_held = not others
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        alone = np.bincount(model.body_rootid, minlength=model.nbody)[model.jnt_bodyid[free]] == 1
        free = free[alone]
        top = free[np.abs(model.body_ipos[model.jnt_bodyid[free]]).max(axis=1) < 1e-12]
        self._tops, turn = model.jnt_dofadr[top], np.empty(9)
        self._inertia = np.empty((len(top), 3, 3))
        for i, body in enumerate(model.jnt_bodyid[top]):
            mujoco.mju_quat2Mat(turn, model.body_iquat[body])
            axes = turn.reshape(3, 3)
            self._inertia[i] = axes @ np.diag(model.body_inertia[body]) @ axes.T
        free = free if not (model.ntendon or model.nu) else free[:0]
        self._free_body, self._free_dof = model.jnt_bodyid[free], model.jnt_dofadr[free]
        self._free_place = model.jnt_qposadr[free]
        of = [model.geom_rbound[model.geom_bodyid == b] for b in self._free_body]
        self._free_radius = np.array([radii.max(initial=0.0) for radii in of])
        self._static = model.body_weldid == 0
        self._still, self._heap = np.zeros(model.nbody, np.int32), np.zeros(model.nbody, np.int32)
        self._asleep = np.empty(0, int)
        self._cut = self._step = self._spin = self._ahead = 0.0
        self._speed = np.empty(0)
        self._shifts = self._trend = np.empty(0)
        self._before: _Before | None = None
        self._borne: Array | None = None
        self._acceleration: Array | None = None
        self.impacts: list[Impact] = []
        self.breaks: list[Break] = []
        self.eased: Counter[str] = Counter()
        self.worked = 0.0
        self._motored = np.zeros(model.nv, bool)
        self._motored[[dof for dof, _ in joined.motors]] = True
        self._find_wholes(np.ones(len(self._bonds), bool))

    def _find_wholes(self, alive: NDArray[np.bool_]) -> None:
        """Which pairs of geoms belong to bodies that bonds make one: they do not collide."""
        if self._bonds:
            n, ends = self._model.nbody, self._ends[alive]
            graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
            whole = connected_components(graph, directed=False)[1]
            self._one = whole[self._pair_bodies[:, 0]] == whole[self._pair_bodies[:, 1]]

    def begin(self, data: Any, dt: float, gravity: float) -> None:
        """Set how far ahead contacts are detected: as far as anything can move in the step."""
        self._cut, self._step = max(gravity, self._collider.bend(data)) * dt, dt
        m = self._model
        reach, self._spin = _reach(
            m.geom_bodyid, m.body_rootid, m.geom_rbound, data.geom_xpos, data.cvel, data.subtree_com
        )
        self._ahead = ahead = 2 * dt * (reach + self._cut)
        unseen = self._one
        if len(self._asleep):
            unseen = unseen | ((self._heap > 0) | self._static)[self._pair_bodies].all(axis=1)
        self._collider.reach(max(4 * self._cut * dt, 2 * TOUCH), ahead, unseen)
        if self._limited:
            m.jnt_margin[:] = m.tendon_margin[:] = ahead + 2 * dt * np.abs(data.qvel).max()

    def rest(self, data: Any) -> bool:
        """Put to sleep what has come to rest; True if nothing is awake any more.

        Who sleeps keeps its place without being solved for, until something comes near. Only free bodies do, whose
        forces cannot change: nothing but gravity pushes them, and they touch only their like and what is fixed.
        """
        if not len(self._free_body) or self._acceleration is None:
            return False
        m, active = self._model, data.eq_active.astype(bool)
        held = np.zeros(m.nbody, bool)
        held[m.eq_obj1id[active]] = held[m.eq_obj2id[active]] = True
        slow, steps = STILL, _STILL_STEPS
        if self.crowd(data):
            slow, steps = _CROWD_STILL, math.ceil(_CROWD_STILL_TIME / self._step)
        if _doze(
            self._free_body, self._free_dof, self._free_radius, data.qvel, data.xfrc_applied, data.contact.geom,
            m.geom_bodyid, self._static, held, self._still, self._heap, slow, steps,
        ):  # fmt: skip
            self._count()
            data.qvel[self._asleep] = 0.0
        return self.idle

    @property
    def idle(self) -> bool:
        """Whether nothing is awake."""
        return bool(0 < len(self._asleep) == self._model.nv)

    def _count(self) -> None:
        dofs = self._free_dof[self._heap[self._free_body] > 0]
        self._asleep = (dofs[:, None] + np.arange(6)).ravel()

    def wake(self, data: Any) -> bool:
        """Wake the heaps that something has come near to; True if any."""
        if not len(self._asleep):
            return False
        near = self._heap[self._model.geom_bodyid[data.contact.geom]]
        pushed = self._heap * data.xfrc_applied.any(axis=1)
        heaps = set(near.ravel().tolist()) | set(pushed.tolist()) - {0}
        heaps.discard(0)
        if not heaps:
            return False
        woken = np.isin(self._heap, list(heaps))
        self._heap[woken] = self._still[woken] = 0
        self._count()
        return True

    def place(self, data: Any) -> None:
        """Everything that follows from the positions: poses, contacts, rows."""
        self._collider.place(data)

    def look(self, data: Any, dt: float) -> tuple[float, float, bool]:
        """(time to the soonest impact [s], its gap [m], whether anything touches or comes to rest within dt)."""
        c, m = data.contact, self._model
        self._speed = np.empty(data.ncon)
        return _look(
            c.dist, c.pos, c.frame, c.geom, m.geom_bodyid, m.body_rootid, data.cvel, data.subtree_com,
            data.efc_type, data.efc_pos, data.efc_vel, self._cut, dt, self._speed,
        )  # fmt: skip

    def impact(self, data: Any) -> None:
        """Resolve the impacts of this instant: velocities jump, nothing else changes."""
        data.qacc_smooth[:] = 0.0
        data.qfrc_smooth[:] = 0.0
        warm = data.qacc_warmstart.copy()
        data.qacc_warmstart[:] = 0.0
        self._shifts = np.empty(0)
        self._solve(data, 1.0, impact=True)
        while self._break(data, CONTACT_TIME):
            self.look(data, self._step)
            self._solve(data, 1.0, impact=True)
        self._shifts = self._trend = np.empty(0)
        self._acceleration = None
        self._work(data, 1.0)
        data.qvel += data.qacc
        data.qacc_warmstart[:] = warm
        pair = self._pair_of[data.contact.geom[:, 0], data.contact.geom[:, 1]]
        self._report(data, 1.0, data.contact.dist <= self._touch[pair])
        self._touch[:] = TOUCH

    def _work(self, data: Any, dt: float) -> None:
        """Add what the motors are about to do, their impulses times the mean of their joints' speeds before and after:
        by that, and what the other forces' come to, the kinetic energy changes exactly."""
        if self._motors:
            rows = np.flatnonzero(data.efc_type == _FRICTION_DOF)
            dofs = data.efc_id[rows]
            speed = data.qvel[dofs] + 0.5 * dt * data.qacc[dofs]
            self.worked += dt * float((data.efc_force[rows] * speed)[self._motored[dofs]].sum())

    def _report(self, data: Any, dt: float, met: NDArray[np.bool_]) -> None:
        for i in np.flatnonzero(met & (self._speed < -self._cut)):
            c = data.contact[i]
            if c.efc_address < 0:
                continue
            force = np.zeros(3)
            force[: c.dim] = dt * data.efc_force[c.efc_address : c.efc_address + min(c.dim, 3)]
            frame = c.frame.reshape(3, 3)
            self.impacts.append(
                Impact(
                    time=float(data.time),
                    first=self._model.geom(c.geom[0]).name,
                    second=self._model.geom(c.geom[1]).name,
                    position=tuple(c.pos.tolist()),
                    normal=tuple(frame[0].tolist()),
                    approach=float(-self._speed[i]),
                    impulse=tuple((force @ frame).tolist()),
                )
            )

    def _load(self, force: Array) -> Array:
        """|F| + |M|/lever of the bonds' rows (n, 6)."""
        moment = np.linalg.norm(force[:, 3:], axis=1) / 2  # a weld's rows of rotation measure half the angle
        return np.asarray(np.linalg.norm(force[:, :3], axis=1) + moment / self._lever)

    def _break(self, data: Any, time: float) -> bool:
        """Break the worst loaded of the bonds, if any is beyond its strength; contacts and rows are then made anew.

        time: what the rows' forces are divided by to be newtons. Of a step's force and its mean with that of the step
        before the smaller counts: a weld that begins to turn bears 5/8 of its load in the first step and 11/8 in the
        second. Impacts that a crowded step takes at its middle load bonds with their impulse over the step, not over
        `CONTACT_TIME`.
        """
        alive = data.eq_active[self._bonded].astype(bool)
        if not alive.any():
            return False
        rows = np.searchsorted(data.efc_id[: data.ne], self._bonded)
        force = data.efc_force[np.minimum(rows, max(data.nefc - 6, 0))[:, None] + np.arange(6)]
        last, self._borne = self._borne, force if time == 1.0 else None
        load = self._load(force)
        if last is not None and self._borne is not None:
            load = np.minimum(load, self._load((force + last) / 2))
        load = np.where(alive, load / (time * self._strength), 0.0)
        worst = np.sort(load[load > 1.0])[::-1]
        if not len(worst):
            return False
        for i in np.flatnonzero(load >= max(1.0, min(_TOGETHER * worst[0], worst[int(_AT_ONCE * len(worst))]))):
            data.eq_active[self._bonded[i]] = 0
            alive[i] = False
            self.breaks.append(Break(float(data.time), self._bonds[i][1].weld, float(load[i] * self._strength[i])))
        before = self._one
        self._find_wholes(alive)
        apart = np.flatnonzero(before & ~self._one)
        self._touch[apart] = ADJOINING
        self._model.pair_margin[apart] = max(4 * self._cut * self._step, 2 * ADJOINING)
        self._model.pair_gap[apart] = self._ahead
        self.place(data)
        if data.nefc:
            mujoco.mj_mulJacVec(self._model, data, data.efc_vel, data.qvel)
        self._shifts = self._trend = np.empty(0)
        self._before = self._borne = None
        return True

    def fly(self, data: Any, dt: float) -> None:
        """What touches nothing moves by Runge-Kutta."""
        option = self._model.opt
        pieces = math.ceil(max(self._spin * dt / _MOST_TURN, 1.0))
        flags, option.timestep = option.disableflags, dt / pieces
        option.disableflags = flags | _DISABLE.mjDSBL_CONTACT | _DISABLE.mjDSBL_CONSTRAINT
        asleep = len(self._asleep) > 0
        before = data.qpos.copy() if asleep else data.qpos
        mujoco.mj_step(self._model, data, pieces)
        option.disableflags = flags
        if asleep:
            data.qvel[self._asleep] = 0.0
            for place in self._free_place[self._heap[self._free_body] > 0]:
                data.qpos[place : place + 7] = before[place : place + 7]
        self._acceleration = self._before = None

    def slide(self, data: Any, dt: float, *, crowded: bool = False, deepest: float = math.inf) -> bool:
        """Drift half a step, solve for the accelerations that contact allows, kick, drift the other half.

        crowded: impacts that fall into the step are taken at its middle, all at once (J. J. Moreau, Lecture Notes in
        Applied and Computational Mechanics 2 (1999) 1), instead of one after the other. False, and the step is to be
        undone, if there two surfaces overlap by more than `deepest`, over the smaller's radius, as they meet in it.
        """
        model = self._model
        if self._before is None:
            self._look_back(data, dt)
        mujoco.mj_integratePos(model, data.qpos, data.qvel, dt / 2)
        self.place(data)
        velocity = data.qvel.copy()
        if self._acceleration is not None:  # forces that depend on velocity are those of the middle, too
            data.qvel += dt / 2 * self._acceleration
        _mean_spins(self._tops, self._inertia, data.qvel, dt)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        middle = data.qvel.copy()
        data.qvel[:] = velocity
        mujoco.mj_comVel(model, data)
        if data.nefc:
            mujoco.mj_mulJacVec(model, data, data.efc_vel, data.qvel)
        self.look(data, dt)
        met = data.contact.dist < 0.5 * self._speed * -dt
        if crowded and deepest < math.inf:
            coming, gap = 0.5 * dt * -self._speed, data.contact.dist
            overlap = np.where(gap < 0, np.minimum(-gap, coming), coming - gap)
            if (overlap > deepest * self._size[data.contact.geom].min(axis=1)).any():
                return False
        self._solve(data, dt, crowded=crowded)
        while self._break(data, 1.0):
            self.look(data, dt)
            met = data.contact.dist < 0.5 * self._speed * -dt
            self._solve(data, dt, crowded=crowded)
        self._touch[:] = TOUCH
        if crowded:
            self._report(data, dt, met)
        data.qacc[self._asleep] = 0.0
        self._work(data, dt)
        data.qvel += dt * data.qacc
        self._acceleration = None
        if dt > self._step / 2 and not crowded:
            self._acceleration = data.qacc.copy()
            _leave_out_gyroscopic(self._tops, self._inertia, middle, self._acceleration)
        mujoco.mj_integratePos(model, data.qpos, data.qvel, dt / 2)
        data.time += dt
        return True

    def swing(self, data: Any, dt: float) -> None:
        """What equalities alone hold together moves by Runge-Kutta, with the forces that leave their gaps as they are;
        what gap the step has left is closed after it, and J v made zero, with the least of kinetic energy."""
        model, begun = self._model, data.time
        start, velocity = data.qpos.copy(), data.qvel.copy()
        ways: list[Array] = []
        kicks: list[Array] = []
        for part in (0.0, 0.5, 0.5, 1.0):
            if part:
                data.qpos[:], data.time = start, begun + part * dt
                mujoco.mj_integratePos(model, data.qpos, ways[-1], part * dt)
                data.qvel[:] = velocity + part * dt * kicks[-1]
            ways.append(data.qvel.copy())
            kicks.append(self._held(data))
        way, kick = ((x[0] + 2 * x[1] + 2 * x[2] + x[3]) / 6 for x in (ways, kicks))
        data.qpos[:], data.qvel[:], data.time = start, velocity + dt * kick, begun + dt
        mujoco.mj_integratePos(model, data.qpos, way, dt)
        for _ in range(2):
            self.place(data)
            mujoco.mj_integratePos(model, data.qpos, -self._across(data, data.efc_pos[: data.ne]), 1.0)
        self.place(data)
        data.qvel -= self._across(data, self._rows(data) @ data.qvel)

    def _held(self, data: Any) -> Array:
        """Acceleration (nv,) under which J a + J̇ v = 0 for the equalities' rows J; positions are done after it."""
        model, here, speed = self._model, data.qpos.copy(), data.qvel.copy()
        tiny = _TINY / max(1.0, float(np.abs(speed).max()))
        ahead = []
        for side in (tiny, -tiny):
            data.qpos[:] = here
            mujoco.mj_integratePos(model, data.qpos, speed, side)
            for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeConstraint):
                stage(model, data)
            ahead.append(self._rows(data) @ speed)
        data.qpos[:] = here
        self.place(data)
        for stage in (mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation, mujoco.mj_fwdAcceleration):
            stage(model, data)
        free = data.qacc_smooth.copy()
        return np.asarray(free - self._across(data, self._rows(data) @ free + (ahead[0] - ahead[1]) / (2 * tiny)))

    def _rows(self, data: Any) -> Array:
        """J (ne, nv) of the equalities."""
        model, rows = self._model, data.ne
        if not mujoco.mj_isSparse(model):
            return np.array(data.efc_J).reshape(-1, model.nv)[:rows]
        dense = np.zeros((rows, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.efc_J, data.efc_J_rownnz[:rows], data.efc_J_rowadr[:rows], data.efc_J_colind
        )
        return dense

    def _across(self, data: Any, missing: Array) -> Array:
        """M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ x (nv,): the least that changes the equalities' rows by x; of redundant ones any."""
        if not len(missing):
            return np.zeros(self._model.nv)
        rows = self._rows(data)
        eased = np.empty_like(rows)
        mujoco.mj_solveM(self._model, data, eased, rows)
        if not math.isfinite(float(np.sum(rows) + np.sum(eased) + np.sum(missing))):  # LAPACK would say it out loud
            raise ArithmeticError("what the equalities ask for is not finite")
        return np.asarray(np.linalg.lstsq(rows @ eased.T, missing, rcond=1e-10)[0] @ eased)

    def _look_back(self, data: Any, dt: float) -> None:
        """Take the rows of half a step ago for those of the last step, so that the first step knows how they turn."""
        model, place = self._model, data.qpos.copy()
        mujoco.mj_integratePos(model, data.qpos, data.qvel, -dt / 2)
        self.place(data)
        mujoco.mj_fwdVelocity(model, data)
        c = data.contact
        self._before = _Before(c.geom.copy(), c.efc_address.copy(), c.dim.copy(), c.frame.copy(), data.efc_type.copy(),
                               data.efc_id.copy(), data.efc_vel.copy(), dt)  # fmt: skip
        data.qpos[:] = place

    def crowd(self, data: Any) -> bool:
        """Whether more contacts bear on each other than are solved to the last digit."""
        return bool(np.count_nonzero(data.contact.efc_address >= 0) > _MANY)

    def remember(self) -> tuple[Any, ...]:
        """What the last step left for the next; to be recalled if that is tried again."""
        last = self._before, self._borne, self._acceleration, self._shifts, self._trend
        return *last, self.worked, len(self.impacts), len(self.breaks)

    def recall(self, memory: tuple[Any, ...]) -> None:
        """As it was when `remember` was called; bonds that have broken since stay broken."""
        self._before, self._borne, self._acceleration, self._shifts, self._trend, self.worked, impacts, _ = memory
        del self.impacts[impacts:]

    def _solve(self, data: Any, dt: float, *, impact: bool = False, crowded: bool = False) -> None:
        """Solve and shift until the constraint problem is Coulomb's; its solution is left in data.qacc.

        What is jammed between things that do not yield cannot be pushed out of them: then overlaps stay as they are.
        Nor can it bounce off all of them: then it does not; and less, if its bouncing would create energy. What still
        has no solution, or hides it, takes the step that MuJoCo's convex contact would: what slips moves apart. All
        this is counted, in `eased`.
        """
        tries = [("", math.inf, 1.0, _MAX_SHIFTS, False), (INELASTIC, math.inf, 0.0, 2 * _LONG, False)]
        tries += [(CONVEX, math.inf, 0.0, _PATIENCE, True)]
        if not impact:
            tries = [("", self._step, 1.0, _LONG, False), (OVERLAPPING, math.inf, 1.0, 2 * _LONG, False), *tries[1:]]
        while tries:
            how, step, bounce, most, dilate = tries.pop(0)
            if self._settle(data, dt, step, most, bounce=bounce, dilate=dilate, impact=impact, crowded=crowded):
                final = not bounce or (step == math.inf and not (impact or crowded))
                if final or not self._creates(data, dt, impact=impact):
                    if how:
                        self.eased[how] += 1
                    return
                if step == math.inf:
                    tries = [(DULLED, math.inf, 0.5, 2 * _LONG, False)] * (bounce == 1.0) + tries[-2:]
            self._shifts = self._trend = np.empty(0)
        raise NotSettled("contact forces did not settle")

    def _balanced(self, data: Any) -> bool:
        """Whether these forces are those of these accelerations, M a = f, which in the midst of a solution they are
        not."""
        force = np.empty(self._model.nv)
        mujoco.mj_mulM(self._model, data, force, data.qacc)
        missing = np.abs(force - data.qfrc_smooth - data.qfrc_constraint).max()
        return bool(missing <= _MISSING * np.abs(data.qfrc_constraint).max())

    def _creates(self, data: Any, dt: float, *, impact: bool) -> bool:
        """Whether contacts that nothing drives have done more work in this solution than a part of what is there: the
        kinetic energy and, in a step, what would lift all that moves by the smallest radius."""
        if self._motors or data.contact.surfacevel.any():
            return False
        work = dt * data.qfrc_constraint @ (data.qvel + 0.5 * dt * data.qacc)
        if not work > 0.0:
            return False
        momentum = np.empty(self._model.nv)
        mujoco.mj_mulM(self._model, data, momentum, data.qvel)
        kinetic, lift = 0.5 * momentum @ data.qvel, self._heft * self._cut / self._step
        return bool(work > (CREATED * kinetic if impact else PUSHED * (kinetic + lift)))

    def _settle(
        self,
        data: Any,
        dt: float,
        step: float,
        most: int,
        *,
        bounce: float,
        dilate: bool,
        impact: bool,
        crowded: bool,
    ) -> bool:
        """Whether the solution was found in so many; gaps are closed at the pace of one `step`, never if that is
        infinite; bounce: fraction of every pair's restitution; dilate: see `_shift`."""
        model, c = self._model, data.contact
        address, dim, friction = c.efc_address, c.dim, c.friction
        reference, force, regulariser, velocity = data.efc_aref, data.efc_force, data.efc_R, data.efc_vel
        target, drift = np.empty(data.nefc), np.zeros(data.nefc)
        now = _Before(c.geom.copy(), address.copy(), dim.copy(), c.frame.copy(), data.efc_type.copy(),
                      data.efc_id.copy(), velocity, 0.0 if impact else dt)  # fmt: skip
        if step < math.inf and self._before is not None:
            now.drift(self._before, self._turns, drift)
        _aim(
            c.dist, c.geom, address, dim, friction, c.mu, self._speed, c.surfacevel, self._pair_of,
            bounce * self._restitution, self._kinetic, self._sticking, self._touch, self._blur, velocity, drift, target,
            self._cut, dt, step, impact, crowded,
        )  # fmt: skip
        if len(target):
            for dof, motor in self._motors:
                self._course[dof] = motor.speed(data.time + (0.0 if impact else dt))
            _aim_joints(
                data.efc_type, data.efc_id, data.efc_pos, velocity, drift, self._course, data.efc_frictionloss,
                self._prescribed, target, self._cut, dt, step, impact,
            )  # fmt: skip
        reference[:] = target
        if self._shifts.shape == target.shape and not crowded:
            # slip changes evenly under constant forces: what the shift was going to be is mostly known
            ahead = self._shifts + self._trend if self._trend.shape == target.shape else self._shifts
            reference += ahead * (target > _OPEN)
        reached = np.empty(len(target))
        nearest, waited, relax = np.inf, 0, 1.0
        trail: list[Array] = []
        many = self.crowd(data)
        model.opt.iterations = _FEW_ROUNDS if many and self._speed.min() < -_LIVELY else _ROUNDS
        fastest = -float(self._speed.min(initial=0.0))
        nearly, coarsely = _NEARLY * max(1.0, fastest), _COARSELY * fastest
        for solutions in range(1, most + 1):
            mujoco.mj_fwdConstraint(model, data)
            data.qacc_warmstart[:] = data.qacc
            mujoco.mj_mulJacVec(model, data, reached, data.qacc)
            moved = _shift(address, dim, friction, regulariser, force, reached, target, reference, relax, dilate) * dt
            if moved < _SETTLED or (solutions >= _LONG and moved < nearly) or (dilate and solutions == most):
                break
            if many and moved < max(_AT_FIRST * 10 ** (min(solutions, _EASED) / 2), coarsely * (solutions > _WEARY)):
                if self._balanced(data):
                    break
                model.opt.iterations = _ROUNDS
            if moved < nearest / 2:
                nearest, waited = moved, 0
            waited += 1
            if waited > _PATIENCE:
                if nearest < _CLOSE:
                    break
                waited, relax, trail = 0, relax / 2 if relax > _LEAST_RELAX else 1.0, []  # it may go round in circles
            if solutions >= _PATIENCE and not many:
                trail = [*trail[-2:], reference.copy()]
                if len(trail) == 3 and _leap(trail[0], trail[1], trail[2], reference):
                    waited, trail = 0, []
        else:
            return False
        shifts = reference - target
        self._trend = shifts - self._shifts if self._shifts.shape == shifts.shape else np.empty(0)
        self._shifts = shifts
        now.velocity = velocity + dt * reached
        self._before = now
        return True


@dataclass
class _Before:
    """The rows of the middle of a step (of no length: an impact) and the velocity along each at its end."""

    geom: NDArray[np.int32]
    address: NDArray[np.int32]
    dim: NDArray[np.int32]
    frame: Array
    kind: NDArray[np.int32]
    number: NDArray[np.int32]
    velocity: Array
    dt: float

    def drift(self, before: _Before, turns: NDArray[np.bool_], drift: Array) -> None:
        """J̇ v × the step of every row: what the turning of the rows has made of unchanged velocities."""
        if len(self.geom) and len(before.geom):
            _drift(
                self.geom, self.address, self.dim, self.frame, self.velocity,
                before.geom, before.address, before.dim, before.frame, before.velocity, drift,
            )  # fmt: skip
        mine, its = np.flatnonzero(self.kind <= _LIMIT_TENDON), np.flatnonzero(before.kind <= _LIMIT_TENDON)
        if len(mine) and np.array_equal(self.number[mine], before.number[its]):
            held = (self.kind[mine] >= _LIMIT_JOINT) | ((self.kind[mine] == _EQUALITY) & turns[self.number[mine]])
            drift[mine[held]] = self.velocity[mine[held]] - before.velocity[its[held]]
        # the rows are those of the middles of two pieces, which may differ in length
        drift *= 2 * self.dt / (self.dt + before.dt)
