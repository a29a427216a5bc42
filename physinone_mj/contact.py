"""Contact: restitution and dry friction as the rows that MuJoCo's solver satisfies, exactly.

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

Defects, stated: one coefficient of restitution per pair, whatever the speed, and impulses that are resolved together
when contacts close at the same instant (a cradle needs gaps). Newton's restitution together with friction can create
energy where a corner strikes obliquely (T. R. Kane, 1984); in heaps of boxes up to 3e-3 of the whole was seen, with
balls none. Static friction passes to kinetic at a slip of `CREEP` m/s, a step and not Stribeck's curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .run import Impact

Array = NDArray[np.float64]

CREEP: Final = 1e-3
"""Slip below which a contact is held by static friction, above by kinetic friction [m/s]."""

TOUCH: Final = 1e-9
"""Surfaces closer than this have met [m]."""

IMPEDANCE: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""MuJoCo's solimp at its stiffest; what softness is left is taken out by `_shift`."""

_MAX_SHIFTS: Final = 2000
_SETTLED: Final = 1e-12
"""The references have settled when none moves a velocity by more than this [m/s]."""

_CLOSE: Final = 1e-5
_PATIENCE: Final = 10
"""Several contacts of one face can share a load in many ways, and their targets disagree by what the face turns in a
step: then the references drift on along a direction in which nothing moves. They count as settled, too, when they are
this close [m/s] and no nearer by half after this many solutions."""

_OPEN: Final = -1e15
"""Target of a row that must not act: no motion is that slow."""

PUSH_OUT: Final = 0.1
"""Fraction of a penetration taken back in one whole step; what is taken back becomes speed, so it stays small."""

_LEAST_RELAX: Final = 1 / 8

NEAR: Final = 1e-7
"""Gaps up to this [m] are closed at the pace at which penetrations are taken back: the corners of a resting face, some
of them a hair above and some below, then agree on how it moves."""


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


class NotSettled(ArithmeticError):
    """The fixed point on Coulomb's law did not converge."""


@njit(cache=True)
def _reach(
    body_of: NDArray[np.int32], root_of: NDArray[np.int32], radius: Array, where: Array, cvel: Array, com: Array
) -> float:
    """Fastest that any two surfaces of the scene can approach each other [m/s]."""
    fastest = 0.0
    for g in range(body_of.shape[0]):
        v, centre = cvel[body_of[g]], com[root_of[body_of[g]]]
        spin = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        arm = radius[g] + np.sqrt(np.sum((where[g] - centre) ** 2))
        if spin > 0.0 or radius[g] > 0.0:
            fastest = max(fastest, np.sqrt(v[3] ** 2 + v[4] ** 2 + v[5] ** 2) + spin * arm)
    return 2.0 * fastest


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
    return soonest, gap, engaged


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
    velocity: Array,
    target: Array,
    cut: float,
    dt: float,
    step: float,
    impact: bool,
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
            target[row] = _OPEN if dist[i] > TOUCH else -normal - e * min(normal, 0.0)
        elif speed[i] < -cut:
            target[row] = _OPEN  # about to collide: the impact's business, not this step's
        else:
            # dist is that of the middle of the piece, half of its motion is left to close the gap
            open_, shut = max(dist[i] - NEAR, 0.0), min(dist[i], NEAR)
            target[row] = -normal / dt - 2.0 * (open_ / dt + PUSH_OUT * shut / step) / dt
        slip = 0.0
        for j in range(1, dim[i]):
            relative = velocity[row + j] - (drive[i, j - 1] if j < 4 else 0.0)
            slip += relative**2 if j < 3 else 0.0
            target[row + j] = -relative if impact else -relative / dt
        if dim[i] > 1:
            mu[i] = friction[i, 0] = friction[i, 1] = static[pair] if slip < CREEP**2 else kinetic[pair]


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
) -> float:
    """Move the reference (by a fraction `relax`) to target + R f - μ|c_t| n̂; returns how far the furthest row is."""
    moved = 0.0
    slipping = np.zeros(reference.shape[0])
    for i in range(address.shape[0]):
        row = address[i]
        if row >= 0:
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
    """The contact problem of one model: looks for impacts, resolves them, and advances what touches.

    pairs: the surface of each of the model's predefined contact pairs, in order.
    """

    def __init__(self, model: Any, pairs: Sequence[Surface]) -> None:
        self._model = model
        self._pair_of = np.zeros((model.ngeom, model.ngeom), np.int32)
        for i, (a, b) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True)):
            self._pair_of[a, b] = self._pair_of[b, a] = i
        self._restitution = np.array([s.restitution for s in pairs])
        self._kinetic = np.array([s.friction for s in pairs])
        self._static = np.array([s.static_friction for s in pairs])
        self._cut = self._step = 0.0
        self._speed = np.empty(0)
        self._shifts = self._trend = np.empty(0)

    def begin(self, data: Any, dt: float, gravity: float) -> None:
        """Set how far ahead contacts are detected: as far as anything can move in the step."""
        self._cut, self._step = gravity * dt, dt
        m = self._model
        reach = _reach(m.geom_bodyid, m.body_rootid, m.geom_rbound, data.geom_xpos, data.cvel, data.subtree_com)
        self._model.pair_margin[:] = max(4 * self._cut * dt, 2 * TOUCH)
        self._model.pair_gap[:] = 2 * dt * (reach + self._cut)

    def look(self, data: Any, dt: float) -> tuple[float, float, bool]:
        """(time to the soonest impact [s], its gap [m], whether anything touches or comes to rest within dt)."""
        c, m = data.contact, self._model
        self._speed = np.empty(data.ncon)
        return _look(
            c.dist, c.pos, c.frame, c.geom, m.geom_bodyid, m.body_rootid, data.cvel, data.subtree_com,
            self._cut, dt, self._speed,
        )  # fmt: skip

    def impact(self, data: Any) -> list[Impact]:
        """Resolve the impacts of this instant: velocities jump, nothing else changes."""
        data.qacc_smooth[:] = 0.0
        data.qfrc_smooth[:] = 0.0
        warm = data.qacc_warmstart.copy()
        data.qacc_warmstart[:] = 0.0
        self._shifts = np.empty(0)
        self._solve(data, 1.0, impact=True)
        self._shifts = self._trend = np.empty(0)
        data.qvel += data.qacc
        data.qacc_warmstart[:] = warm
        return self._report(data)

    def _report(self, data: Any) -> list[Impact]:
        found = []
        for i in range(data.ncon):
            c = data.contact[i]
            if c.efc_address < 0 or self._speed[i] >= -self._cut or c.dist > TOUCH:
                continue
            force = np.zeros(3)
            force[: c.dim] = data.efc_force[c.efc_address : c.efc_address + min(c.dim, 3)]
            frame = c.frame.reshape(3, 3)
            found.append(
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
        return found

    def slide(self, data: Any, dt: float) -> None:
        """Drift half a step, solve for the accelerations that contact allows, kick, drift the other half."""
        model = self._model
        mujoco.mj_integratePos(model, data.qpos, data.qvel, dt / 2)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        self.look(data, dt)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        self._solve(data, dt, impact=False)
        data.qvel += dt * data.qacc
        mujoco.mj_integratePos(model, data.qpos, data.qvel, dt / 2)
        data.time += dt

    def _solve(self, data: Any, dt: float, *, impact: bool) -> None:
        """Solve and shift until the constraint problem is Coulomb's; its solution is left in data.qacc."""
        model, c = self._model, data.contact
        address, dim, friction = c.efc_address, c.dim, c.friction
        reference, force, regulariser = data.efc_aref, data.efc_force, data.efc_R
        target = -data.efc_vel if impact else reference.copy()
        _aim(
            c.dist, c.geom, address, dim, friction, c.mu, self._speed, c.surfacevel, self._pair_of,
            self._restitution, self._kinetic, self._static, data.efc_vel, target, self._cut, dt, self._step, impact,
        )  # fmt: skip
        reference[:] = target
        if self._shifts.shape == target.shape:
            # slip changes evenly under constant forces: what the shift was going to be is mostly known
            ahead = self._shifts + self._trend if self._trend.shape == target.shape else self._shifts
            reference += ahead * (target > _OPEN)
        reached = np.empty(len(target))
        nearest, waited, relax = np.inf, 0, 1.0
        for _ in range(_MAX_SHIFTS):
            mujoco.mj_fwdConstraint(model, data)
            data.qacc_warmstart[:] = data.qacc
            mujoco.mj_mulJacVec(model, data, reached, data.qacc)
            moved = _shift(address, dim, friction, regulariser, force, reached, target, reference, relax) * dt
            if moved < _SETTLED:
                break
            if moved < nearest / 2:
                nearest, waited = moved, 0
            waited += 1
            if waited > _PATIENCE:
                if nearest < _CLOSE:
                    break
                waited, relax = 0, relax / 2 if relax > _LEAST_RELAX else 1.0  # it may go round in circles
        else:
            raise NotSettled(f"contact forces did not settle in {_MAX_SHIFTS} solutions")
        shifts = reference - target
        self._trend = shifts - self._shifts if self._shifts.shape == shifts.shape else np.empty(0)
        self._shifts = shifts
