"""Forces that MuJoCo lacks: each a frozen dataclass that states its equation, its source and its own defect.

An effect is a function of the current state alone and is evaluated at every stage of a step, so it never costs the
integrator its order. Forces act at the centre of mass, with a torque about it, in world axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .base import Refusal
from .constants import AIR_DENSITY
from .contact import Surface
from .scene import Part, Push, Scene

Array = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Profile: TypeAlias = tuple[float, float, float]
"""Coefficients (c₀, c₁, c₂) of c₀ + c₁ u + c₂ u², u = s/L: how a wind fades with the distance s from its source."""

FADING: Final[Profile] = (1.0, -2.0, 1.0)
"""(1 - s/L)²: steep at the source, without an edge at the far end."""

BLUNT: Final[Profile] = (1.0, 0.0, -1.0)
"""1 - (s/L)²: flat at the source."""

LINEAR: Final[Profile] = (1.0, -1.0, 0.0)
"""1 - s/L. As the speed of an `AirStream` it pushes a body at rest as a `FADING` force does."""

UNIFORM: Final[Profile] = (1.0, 0.0, 0.0)
"""The same everywhere."""

SPHERE_ADDED_MASS: Final = 0.5
"""C_m of a sphere in an ideal fluid: half of what it displaces (Landau & Lifshitz, Fluid Mechanics, §11 problem 1)."""


def _ids(model: Any, kind: Any, names: Sequence[str]) -> NDArray[np.int64]:
    found = [mujoco.mj_name2id(model, kind, name) for name in names]
    for name, number in zip(names, found, strict=True):
        if number < 0:
            raise KeyError(f"no {kind.name[6:].lower()} {name!r} in the scene")
    return np.array(found, np.int64)


def _on(kernel: Callable[..., Any], constants: tuple[Any, ...], *fields: str) -> Callable[[Any], Any]:
    """The kernel as a function of the data. Its fields are looked up once: they stay where they are for its life."""
    known, arrays = None, constants

    def call(data: Any) -> Any:
        nonlocal known, arrays
        if data is not known:
            known, arrays = data, (*constants, *(getattr(data, field) for field in fields))
        return kernel(*arrays)

    return call


@dataclass(frozen=True)
class Box:
    """Where a wind blows: a box of air whose source is one of its faces.

    origin: centre of the source face [m]; axis: where the wind blows to; length: along it [m]; width: across, and
    horizontal [m]; height: across both [m]; edge [m]: diameter of the ball that passes the four sides of the box: it
    feels the wind by the part of its volume that is inside, 3 u² - 2 u³ for u from 0 to 1 (0: all or nothing, by its
    centre). A side that is passed needs an edge, or a step that straddles it errs by its own length.
    """

    origin: Vector
    axis: Vector
    length: float
    width: float
    height: float
    edge: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.edge <= min(self.width, self.height):
            raise ValueError(f"edge = {self.edge} m of a wind; allowed: 0 to its width and height")
        for name in ("length", "width", "height"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)} m of a wind; allowed: positive and finite")
        if not 0 < float(np.linalg.norm(self.axis)) < math.inf:
            raise ValueError(f"axis = {self.axis} of a wind; allowed: a direction")

    @property
    def frame(self) -> Array:
        """Unit vectors (3, 3), one a row: along the wind, along the width, along the height."""
        along = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        across = np.cross((0.0, 0.0, 1.0), along)
        across = across / size if (size := float(np.linalg.norm(across))) > 1e-9 else np.array([0.0, 1.0, 0.0])
        return np.array([along, across, np.cross(along, across)])

    def distance(self, point: Any) -> Array:
        """Distances s (...) [m] from the source face, of points (..., 3); NaN outside the box."""
        local = (np.asarray(point, float) - self.origin) @ self.frame.T
        inside = (local[..., 0] >= 0) & (local[..., 0] <= self.length)
        inside &= (np.abs(local[..., 1]) <= self.width / 2) & (np.abs(local[..., 2]) <= self.height / 2)
        return np.where(inside, local[..., 0], np.nan)

    def _packed(self, profile: Profile, *scale: float) -> Array:
        """Everything a compiled wind needs: origin, frame, extents and edge, profile and scale factors, (19 + n,)."""
        extents = (self.length, self.width / 2, self.height / 2, self.edge)
        return np.concatenate([self.origin, self.frame.ravel(), extents, profile, scale])


@njit(cache=True)
def _immersed(depth: float, edge: float) -> float:
    """Part of a ball's volume that is inside a face, its centre `depth` inside and its diameter `edge`."""
    if 2.0 * depth >= edge:
        return 1.0
    if 2.0 * depth < -edge:
        return 0.0
    u = 0.5 + depth / edge
    return u * u * (3.0 - 2.0 * u)


@njit(cache=True)
def _fraction(field: Array, x: float, y: float, z: float) -> float:
    """The profile at a point; 0 outside the box."""
    x, y, z = x - field[0], y - field[1], z - field[2]
    s = x * field[3] + y * field[4] + z * field[5]
    if s < 0.0 or s > field[12]:
        return 0.0
    across = _immersed(field[13] - abs(x * field[6] + y * field[7] + z * field[8]), field[15])
    up = _immersed(field[14] - abs(x * field[9] + y * field[10] + z * field[11]), field[15])
    u = s / field[12]
    return float(across * up * (field[16] + u * (field[17] + u * field[18])))


@njit(cache=True)
def _push(bodies: NDArray[np.int64], field: Array, centre: Array, applied: Array) -> None:
    for body in bodies:
        force = field[19] * _fraction(field, centre[body, 0], centre[body, 1], centre[body, 2])
        if force != 0.0:
            for k in range(3):
                applied[body, k] += force * field[3 + k]


@njit(cache=True)
def _drag(
    bodies: NDArray[np.int64],
    root: NDArray[np.int32],
    field: Array,
    centre: Array,
    velocity: Array,
    tree: Array,
    applied: Array,
) -> None:
    relative = np.empty(3)
    for body in bodies:
        fraction = _fraction(field, centre[body, 0], centre[body, 1], centre[body, 2])
        if fraction == 0.0:
            continue
        size = 0.0
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            # cvel holds (ω, velocity of the point that coincides with the tree's centre of mass)
            arm_a, arm_b = centre[body, a] - tree[root[body], a], centre[body, b] - tree[root[body], b]
            moving = velocity[body, 3 + k] + velocity[body, a] * arm_b - velocity[body, b] * arm_a
            relative[k] = field[19] * fraction * field[3 + k] - moving
            size += relative[k] ** 2
        size = np.sqrt(size)
        for k in range(3):
            applied[body, k] += field[20] * size * relative[k]


@dataclass(frozen=True)
class Wind:
    """A wind as a field of force that fades away from its source.

    F = F₀ (c₀ + c₁ u + c₂ u²) â, u = s/L, inside the box; exactly 0 outside it

    F₀ [N]: force at the source; s [m]: distance of the centre of mass from the source face; L [m]: length of the box;
    â: its axis. Profiles: `FADING` (1 - s/L)², `BLUNT` 1 - (s/L)².
    Source: PhysInOne, appendix 5.4.1, "Wind Force": a box of force of constant direction whose magnitude "decays
    quadratically with the distance from the wind source" and "approaches zero" at the far end.
    Defects: the force is sampled at the centre of mass, whatever the size and shape of the body, so there is no torque,
    and without an edge (see `Box`) a body is wholly inside or wholly outside; it does not depend on the body's velocity
    (`AirStream` does).
    """

    box: Box
    force: float
    bodies: tuple[str, ...]
    profile: Profile = FADING

    def at(self, distance: Any) -> Array:
        """Force along the axis [N] at distances from the source [m] inside the box."""
        u = np.asarray(distance, float) / self.box.length
        return np.asarray(self.force * (self.profile[0] + u * (self.profile[1] + u * self.profile[2])))

    def work(self, start: Any, stop: Any) -> Array:
        """∫ F ds [J] between two distances from the source [m] inside the box."""
        c0, c1, c2 = self.profile

        def primitive(s: Any) -> Array:
            u = np.asarray(s, float) / self.box.length
            return np.asarray(self.force * self.box.length * u * (c0 + u * (c1 / 2 + u * c2 / 3)))

        return primitive(stop) - primitive(start)

    def bind(self, model: Any) -> Push:
        """Compiled for one model."""
        bodies = _ids(model, mujoco.mjtObj.mjOBJ_BODY, self.bodies)
        return _on(_push, (bodies, self.box._packed(self.profile, self.force)), "xipos", "xfrc_applied")

    def potential(self, model: Any, data: Any) -> float:
        """-∫ F ds from the source [J], constant before and beyond the box.

        It is a potential along every path that passes the end faces only: a box of force has a curl on its sides.
        """
        found = 0.0
        frame, box = self.box.frame, self.box
        for body in _ids(model, mujoco.mjtObj.mjOBJ_BODY, self.bodies):
            s, y, z = frame @ (data.xipos[body] - box.origin)
            if abs(y) <= box.width / 2 and abs(z) <= box.height / 2:
                found -= float(self.work(0.0, min(max(s, 0.0), box.length)))
        return found


@dataclass(frozen=True)
class AirStream:
    """Moving air that drags bodies along.

    F = ½ ρ C A |U - v| (U - v), U = U₀ (c₀ + c₁ u + c₂ u²) â, u = s/L, inside the box; exactly 0 outside it

    ρ [kg/m³]: density of air; C A [m²]: drag coefficient times frontal area; U [m/s]: velocity of the air; v [m/s]: of
    the centre of mass; s [m]: distance from the source face; L [m]: length of the box; â: its axis.
    Source: L. D. Landau & E. M. Lifshitz, Fluid Mechanics, §45 (the drag coefficient).
    Defects: C is constant (no drag crisis, no Stokes' law for the slow); the air is sampled at the centre of mass;
    outside the box there is no air at all, not air at rest.
    """

    box: Box
    speed: float
    drag_area: float
    bodies: tuple[str, ...]
    profile: Profile = LINEAR
    density: float = AIR_DENSITY

    @property
    def drag(self) -> float:
        """½ ρ C A [kg/m]."""
        return self.density * self.drag_area / 2

    def bind(self, model: Any) -> Push:
        """Compiled for one model."""
        bodies = _ids(model, mujoco.mjtObj.mjOBJ_BODY, self.bodies)
        constants = (bodies, model.body_rootid, self.box._packed(self.profile, self.speed, self.drag))
        return _on(_drag, constants, "xipos", "cvel", "subtree_com", "xfrc_applied")

    def potential(self, _model: Any, _data: Any) -> float:
        """None: drag dissipates."""
        return 0.0


@njit(cache=True)
def _resist(
    bodies: NDArray[np.int64],
    root: NDArray[np.int32],
    coefficient: float,
    centre: Array,
    velocity: Array,
    tree: Array,
    applied: Array,
) -> None:
    for body in bodies:
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            # cvel holds (ω, velocity of the point that coincides with the tree's centre of mass)
            arm_a, arm_b = centre[body, a] - tree[root[body], a], centre[body, b] - tree[root[body], b]
            moving = velocity[body, 3 + k] + velocity[body, a] * arm_b - velocity[body, b] * arm_a
            applied[body, k] -= coefficient * moving


@dataclass(frozen=True)
class Drag:
    """Still air, or any medium, that resists slow motion.

    F = -c v

    c [kg/s]: 6 π η R for a small sphere; v [m/s]: of the centre of mass.
    Source: L. D. Landau & E. M. Lifshitz, Fluid Mechanics, §20 eq. 20.14 (Stokes' law).
    Defects: linear at every speed; everywhere alike; turning is not resisted.
    """

    coefficient: float
    bodies: tuple[str, ...]

    def __post_init__(self) -> None:
        if not 0 <= self.coefficient < math.inf:
            raise ValueError(f"coefficient = {self.coefficient} kg/s of drag; allowed: 0 or more")

    def bind(self, model: Any) -> Push:
        """Compiled for one model."""
        bodies = _ids(model, mujoco.mjtObj.mjOBJ_BODY, self.bodies)
        constants = (bodies, model.body_rootid, self.coefficient)
        return _on(_resist, constants, "xipos", "cvel", "subtree_com", "xfrc_applied")

    def potential(self, _model: Any, _data: Any) -> float:
        """None: drag dissipates."""
        return 0.0


@dataclass(frozen=True)
class Float:
    """What displaces air: its centre of volume is where a site of its body is.

    volume [m³]; drag_area: drag coefficient times frontal area [m²]; added: added mass coefficient C_m
    """

    centre: str
    volume: float
    drag_area: float = 0.0
    added: float = SPHERE_ADDED_MASS

    def __post_init__(self) -> None:
        for name in ("volume", "drag_area", "added"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)} of what floats in air; allowed: 0 or more")


@njit(cache=True)
def _float(
    sites: NDArray[np.int64],
    owner: NDArray[np.int64],
    root: NDArray[np.int32],
    lift: Array,
    drag: Array,
    where: Array,
    centre: Array,
    velocity: Array,
    tree: Array,
    applied: Array,
) -> None:
    moving, force, arm = np.empty(3), np.empty(3), np.empty(3)
    for i in range(sites.shape[0]):
        body, site = owner[i], sites[i]
        speed = 0.0
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            # cvel holds (ω, velocity of the point that coincides with the tree's centre of mass)
            arm_a, arm_b = where[site, a] - tree[root[body], a], where[site, b] - tree[root[body], b]
            moving[k] = velocity[body, 3 + k] + velocity[body, a] * arm_b - velocity[body, b] * arm_a
            speed += moving[k] ** 2
            arm[k] = where[site, k] - centre[body, k]
        speed = np.sqrt(speed)
        for k in range(3):
            force[k] = lift[i, k] - drag[i] * speed * moving[k]
            applied[body, k] += force[k]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            applied[body, 3 + k] += arm[a] * force[b] - arm[b] * force[a]


@dataclass(frozen=True)
class Buoyancy:
    """Air at rest that carries and resists what is in it: Archimedes' force, drag, and the weight of added mass.

    F = -ρ V g - ½ ρ C A |v| v (- C_m ρ V g), at the centre of volume; U = ρ V (1 + C_m) g · x

    ρ [kg/m³]: density of the air; V [m³]: volume; g [m/s²]: gravity, a vector downwards; C A [m²]: drag coefficient
    times frontal area; v [m/s]: velocity of the centre of volume; C_m: added mass coefficient, ½ for a sphere.
    Added mass: a body that speeds up has to speed up the air around it, which adds C_m ρ V to its inertia and nothing
    to its weight. The inertia is not a force of the present state and cannot be an effect's: whoever builds the body
    gives it `added_mass` on top of its own mass, as a point at the centre of volume (which is exact: a sphere turns
    without moving the air). MuJoCo then lets it weigh too much, by C_m ρ V g, and the term in brackets takes just
    that weight, and its torque, away. Hence `Run.mass`, `Run.momentum` and `Run.kinetic` of such a body are those of
    the body and of the air that it carries along (Kelvin's impulse of the fluid), and its weight is not `Run.mass` g.
    What it is said to be made of, `Scene.material`, remains its own density.
    Source: Archimedes, On Floating Bodies I, prop. 5-7; L. D. Landau & E. M. Lifshitz, Fluid Mechanics, §11 problem 1
    (½ of the displaced mass, for a sphere) and §45 (the drag coefficient).
    Defects: C and C_m are constant (no drag crisis, no Stokes' law for the slow, no wake that remembers, no zigzag);
    the air is unbounded (near a wall C_m would grow), at rest, of one density at every height; neighbours do not
    shield each other; a turning body feels no resistance.
    """

    floats: tuple[Float, ...]
    density: float = AIR_DENSITY

    def __post_init__(self) -> None:
        if not 0 < self.density < math.inf:
            raise ValueError(f"density = {self.density} kg/m³ of air; allowed: positive and finite")

    def added_mass(self, one: Float) -> float:
        """C_m ρ V [kg]: what the body's inertia has to hold beside its own mass."""
        return one.added * self.density * one.volume

    def _sites(self, model: Any) -> tuple[NDArray[np.int64], Array]:
        """Centres of volume, and ρ V (1 + C_m) of each [kg]."""
        sites = _ids(model, mujoco.mjtObj.mjOBJ_SITE, [one.centre for one in self.floats])
        return sites, np.array([self.density * one.volume + self.added_mass(one) for one in self.floats])

    def bind(self, model: Any) -> Push:
        """Compiled for one model and its gravity."""
        sites, displaced = self._sites(model)
        drag = np.array([self.density * one.drag_area / 2 for one in self.floats])
        lift = -displaced[:, None] * model.opt.gravity
        constants = (sites, model.site_bodyid[sites].astype(np.int64), model.body_rootid, lift, drag)
        return _on(_float, constants, "site_xpos", "xipos", "cvel", "subtree_com", "xfrc_applied")

    def potential(self, model: Any, data: Any) -> float:
        """ρ V (1 + C_m) g · x [J]; MuJoCo counts the weight of the added mass, this takes it away. Drag has none."""
        sites, displaced = self._sites(model)
        return float(displaced @ (data.site_xpos[sites] @ model.opt.gravity))


class TooClose(ArithmeticError):
    """Two magnetic poles came within half the core, where a point pole is no magnet any more."""


@dataclass(frozen=True)
class Magnet:
    """A bar magnet: a north and a south pole where two sites of its body are.

    strength: the force [N] between two such poles 1 m apart, as N m²; two magnets have √(k₁ k₂) between them
    """

    north: str
    south: str
    strength: float

    def __post_init__(self) -> None:
        if not 0 <= self.strength < math.inf:
            raise ValueError(f"strength = {self.strength} N m² of a magnet; allowed: 0 or more")


@njit(cache=True)
def _attract(
    sites: NDArray[np.int64],
    owner: NDArray[np.int64],
    charge: Array,
    where: Array,
    centre: Array,
    applied: Array,
) -> float:
    """Every pole on every pole of another body, with equal and opposite forces; returns the nearest distance [m]."""
    nearest = np.inf
    for i in range(sites.shape[0]):
        a, p = owner[i], sites[i]
        for j in range(i):
            b, q = owner[j], sites[j]
            if a == b:
                continue
            dx, dy, dz = where[p, 0] - where[q, 0], where[p, 1] - where[q, 1], where[p, 2] - where[q, 2]
            r2 = dx * dx + dy * dy + dz * dz
            r = np.sqrt(r2)
            nearest = min(nearest, r)
            scale = charge[i] * charge[j] / (r2 * r)
            fx, fy, fz = scale * dx, scale * dy, scale * dz
            for side in range(2):
                body, site, sign = (a, p, 1.0) if side == 0 else (b, q, -1.0)
                x = where[site, 0] - centre[body, 0]
                y = where[site, 1] - centre[body, 1]
                z = where[site, 2] - centre[body, 2]
                applied[body, 0] += sign * fx
                applied[body, 1] += sign * fy
                applied[body, 2] += sign * fz
                applied[body, 3] += sign * (y * fz - z * fy)
                applied[body, 4] += sign * (z * fx - x * fz)
                applied[body, 5] += sign * (x * fy - y * fx)
    return nearest


@dataclass(frozen=True)
class Magnets:
    """Bar magnets that attract, repel and turn each other, any number of them on any bodies.

    F = ± √(kᵢ kⱼ)/r² between every two poles of different bodies, along the line between them: like poles repel,
    unlike ones attract; U = ± √(kᵢ kⱼ)/r

    k [N m²]: strength of a magnet (μ₀ q²/4π for a pole of q ampere metres); r [m]: distance of the two poles.
    Each pole's force acts where the pole is, so a magnet also feels a torque, and every force has its reaction.
    core [m]: poles never come nearer than this, since they lie inside their magnets. A scene whose surfaces would let
    them is refused (R5) when it is bound; if a pole gets there all the same, the run is broken off.
    Source: J. D. Jackson, Classical Electrodynamics, 3rd ed., §5.9 C eq. 5.99 (the magnet as charge on its end faces);
    PhysInOne, appendix 5.4.1, "Magnetic Force" (the field r_N/r_N³ - r_S/r_S³, sampled at the target's poles).
    Defects: each end's charge is drawn together in one point, good at distances beyond the magnet's thickness; the
    magnetization is rigid; poles on one body do not feel each other; iron, eddy currents and the earth's field are
    absent.
    """

    magnets: tuple[Magnet, ...]
    core: float

    def __post_init__(self) -> None:
        if not 0 < self.core < math.inf:
            raise ValueError(f"core = {self.core} m of magnets; allowed: positive and finite")

    def _poles(self, model: Any) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """Sites, bodies and charges (2 n,) [√(N m²)] of all poles."""
        names = [name for magnet in self.magnets for name in (magnet.north, magnet.south)]
        sites = _ids(model, mujoco.mjtObj.mjOBJ_SITE, names)
        charge = np.array([sign * math.sqrt(m.strength) for m in self.magnets for sign in (1.0, -1.0)])
        return sites, model.site_bodyid[sites].astype(np.int64), charge

    def bind(self, model: Any) -> Push:
        """Compiled for one model; Refusal R5 if touching surfaces would let two poles within the core."""
        sites, owner, charge = self._poles(model)
        depth = [_depth(model, int(site)) for site in sites]
        pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
        touching = {frozenset(pair) for pair in model.geom_bodyid[pairs].tolist()}
        for i in range(len(sites)):
            for j in range(i):
                nearest = depth[i] + depth[j]
                if frozenset((int(owner[i]), int(owner[j]))) in touching and nearest < self.core * (1 - 1e-9):
                    names = " and ".join(model.site(sites[n]).name for n in (j, i))
                    raise Refusal("R5", f"poles {names} lie {nearest:.3g} m apart when their bodies touch; allowed: "
                                  f"{self.core:.3g} m or more, the core of the magnets")  # fmt: skip
        core = self.core
        attract = _on(_attract, (sites, owner, charge), "site_xpos", "xipos", "xfrc_applied")

        def push(data: Any) -> None:
            nearest = attract(data)
            # a trial step may pass through the surfaces before the instant of contact is found
            if nearest < core / 2:
                raise TooClose(f"two magnetic poles came within {nearest:.3g} m, less than half of {core:.3g} m")

        return push

    def potential(self, model: Any, data: Any) -> float:
        """Σ ± √(kᵢ kⱼ)/r over every two poles of different bodies [J]."""
        sites, owner, charge = self._poles(model)
        where = data.site_xpos[sites]
        found = 0.0
        for i in range(len(sites)):
            for j in range(i):
                if owner[i] != owner[j]:
                    found += charge[i] * charge[j] / float(np.linalg.norm(where[i] - where[j]))
        return float(found)


def _depth(model: Any, site: int) -> float:
    """How deep a site lies inside the solids of its own body [m]; 0 outside, and for shapes it does not know."""
    body, deepest = model.site_bodyid[site], 0.0
    shape = mujoco.mjtGeom
    for geom in np.nonzero(model.geom_bodyid == body)[0]:
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        x, y, z = np.abs(turn.reshape(3, 3).T @ (model.site_pos[site] - model.geom_pos[geom]))
        size = model.geom_size[geom]
        inside = {
            shape.mjGEOM_SPHERE: size[0] - math.hypot(x, y, z),
            shape.mjGEOM_CAPSULE: size[0] - math.hypot(x, y, max(z - size[1], 0.0)),
            shape.mjGEOM_CYLINDER: min(size[0] - math.hypot(x, y), size[1] - z),
            shape.mjGEOM_BOX: min(size[0] - x, size[1] - y, size[2] - z),
        }
        deepest = max(deepest, inside.get(shape(model.geom_type[geom]), 0.0))
    return float(deepest)


def fan(scene: Scene, box: Box, name: str = "fan", turning: float = 14.0) -> Part:
    """Stand a fan at the source of a wind that blows horizontally, and show its air.

    turning: speed of its blades [rad/s]. They are there to be seen: the wind is the effect's, not theirs.
    """
    part = scene.add("fan", name)
    along, _, _ = box.frame
    if abs(along[2]) > 1e-9:
        raise ValueError(f"axis = {box.axis} of a standing fan; allowed: horizontal")
    heading = math.atan2(along[1], along[0]) / 2
    stand, height = part.body("fan"), box.origin[2]
    stand.pos, stand.quat = box.origin, (math.cos(heading), 0, 0, math.sin(heading))
    for side, sign in (("left", 1), ("right", -1)):
        part.geom(side).fromto = (0, sign * 0.25, 0, 0, sign * 0.25, 0.015 - height)
        part.geom(f"{side}_foot").pos[2] = 0.01 - height
    scene.material(part.name("fan"), 2700.0, Surface(friction=0.3, restitution=0.3))
    scene.material(part.name("rotor"), 1100.0, Surface(friction=0.3, restitution=0.3))
    scene.speed[part.name("rotor")] = turning
    air = part.geom("air")
    air.size, air.pos = (box.length / 2, box.width / 2, box.height / 2), (box.length / 2, 0, 0)
    for i in range(9):
        # a lattice that looks irregular: low-discrepancy multiples of two irrational numbers
        start, across, up = 0.08 + 0.1 * (i % 4), (i * 0.618) % 1 - 0.5, (i * 0.755) % 1 - 0.5
        y, z = 0.8 * across * box.width, 0.8 * up * box.height
        x, end = start * box.length, (start + 0.35 - 0.02 * i) * box.length
        part.geom(f"streak{i}").fromto = (x, y, z, end, y, z)
    return part
