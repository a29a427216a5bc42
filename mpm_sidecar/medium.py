"""The matter of a scene beside its bodies: from a `Continuum` to particles on a grid, both ways coupled, and its sums.

Within a step of the bodies, of a length h, the matter takes its own steps. The bodies that it meets move through them
as they did at the step's begin, changed by what the matter gives them (`collide`); and all that it gave them in h acts
on them in the same step as a constant force. So both sides begin from one state, and what one loses the other gains:
the matter's momentum lost is Σ F h exactly.

Defect: what else accelerates a body within h (gravity, contact) is not seen by the matter before the next step.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from physinone_mj.base import Refusal
from physinone_mj.continuum import Continuum, Elastic, Granular, Inlet, Meeting, Newtonian, Plasticine, Viscoplastic
from physinone_mj.scene import IMMATERIAL

from . import meshes, sample
from ._ti import compiles, start
from .collide import Bearer, Obstacle
from .materials import dissipated, energy, stretch
from .transfer import Body, Solver, longest_step

Array = NDArray[np.float64]

PER_CELL: Final = 8
"""Particles of a cell of matter at rest."""
_MESH_CELLS: Final = 0.5
"""Spacing of a mesh's field of distances [cell]."""
_MOST_UPDATES: Final = 2e10
"""Particles times steps that a scene may take."""
_LEAST_COST: Final = 1e4
"""What a step costs before it moves anything [particles]."""
_DEEPEST: Final = 0.25
"""How deep a particle may lie in a body at the start [cell]."""
_VORTEX: Final = 0.007
"""ν Δt/Δx² of the method's own viscosity in vortices nine cells across, rounded up. Of N cells across it is near
0.555/N², reckoned and measured, whatever their speed, the step and how often they are turned over; one vortex between
smooth walls, which take some motion, has 0.27/N (docs/mpm.md)."""
_FINEST: Final = 1e6
"""Times as many cells as there are that somebody may be told to take. No number of them would do where steps are short
because of what is thick beside a thin fluid: that shortens them with Δx², and the method's own stays what it is."""
_OPENING: Final = 4096
"""Particles of a jet that show where its opening is."""
_SHUFFLED: Final = 48
"""Particles of a jet of which any may come first."""
_SQUASHED: Final = {Elastic: 0.3, Plasticine: 0.3, Viscoplastic: 0.3, Granular: 0.01, Newtonian: 0.02}
"""Largest ρ g H/M of a piece at rest, M Young's modulus or 7 κ: beyond it its own weight squashes it (rule R9)."""

_PRIMITIVES: Final = {
    mujoco.mjtGeom.mjGEOM_PLANE: ("plane", 0), mujoco.mjtGeom.mjGEOM_SPHERE: ("ball", 1),
    mujoco.mjtGeom.mjGEOM_CAPSULE: ("capsule", 2), mujoco.mjtGeom.mjGEOM_ELLIPSOID: ("ellipsoid", 3),
    mujoco.mjtGeom.mjGEOM_CYLINDER: ("cylinder", 2), mujoco.mjtGeom.mjGEOM_BOX: ("box", 3),
}  # fmt: skip
"""Shape, and how many of MuJoCo's sizes it has."""


@dataclass
class _Carried:
    """A bearer, the body whose it is, and the geoms that its obstacles are."""

    bearer: Bearer
    body: int
    geoms: list[int]


@dataclass
class _Pouring:
    """An inlet's particles still to come, in the order of their times; they stream in as a rigid jet."""

    piece: int
    times: Array
    points: Array
    velocity: Array
    done: int = 0

    def due(self, time: float) -> Array:
        """Those that have come through by a time, where they then are."""
        upto = int(np.searchsorted(self.times, time, side="right"))
        new = slice(self.done, upto)
        self.done = upto
        return np.asarray(self.points[new] + (time - self.times[new])[:, None] * self.velocity)


class Medium:
    """One scene's matter. Taichi is started, if it does not run yet.

    Args:
        continuum: what there is.
        model, data: MuJoCo's, at the start.
        cell: side of a cell [m].
        gravity: downwards [m/s²], unless the continuum has its own.
        duration: how long it will be watched [s].
        driven: degrees of freedom that a motor moves whatever stands in their way.
        seed: of where the particles are.
        double: in double precision.
        sparse: as of `Solver`.

    Raises:
        Refusal: what cannot be computed faithfully at this cell: R1 matter within a body or other matter, R7 too thin
            a shape, a jet or a fluid, R9 squashed by its own weight, R10 too many particles or too much work.
        KeyError: no such body or geom.
        ValueError: no piece, two of one name, an inlet of none, two meetings with one body, a body of no solid geom.
    """

    def __init__(
        self, continuum: Continuum, model: Any, data: Any, *, cell: float, gravity: float, duration: float,
        driven: ArrayLike = (), seed: int = 0, double: bool = False, sparse: bool = True,
    ) -> None:  # fmt: skip
        names = [piece.name for piece in continuum.pieces]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"pieces {names} of a continuum; allowed: at least one, each of its own name")
        others = [meeting.with_ for meeting in continuum.meetings]
        if len(set(others)) < len(others):
            raise ValueError(f"meetings with {others} of a continuum; allowed: one with each")
        self.cell, self.continuum, self._model = cell, continuum, model
        self._gravity = np.array((0, 0, -gravity) if continuum.gravity is None else continuum.gravity, float)
        self._driven = np.asarray(driven, int)
        self._carried = [_carried(model, meeting, cell) for meeting in continuum.meetings]
        self.bearers = [carried.bearer for carried in self._carried]
        walls = [Bearer([Obstacle.wall(wall)]) for wall in continuum.walls]
        filled = [
            sample.fill(piece, cell, PER_CELL, np.random.default_rng([seed, number]))
            for number, piece in enumerate(continuum.pieces)
        ]
        sample.overlapping({name: points for name, (points, _, _) in zip(names, filled, strict=True)}, cell)
        bodies = [
            Body(piece.material, points, volume, velocity, piece.spin)
            for piece, (points, velocity, volume) in zip(continuum.pieces, filled, strict=True)
        ]
        start(double)
        for material in sorted({type(body.material).__name__ for body in bodies}):
            if compiles(material):
                print(f"compiling the kernels for {material} (once on this machine)", file=sys.stderr)
        self._place(data)
        for name, body in zip(names, bodies, strict=True):
            self._refuse_within(repr(name), body.points, walls)
        met = [*self.bearers, *walls]
        falling = np.where(np.isfinite(continuum.period), 0.0, self._gravity)
        most = [len(body.points) for body in bodies]
        for inlet in continuum.inlets:
            _refuse_thin(inlet, cell)
            number, count = _poured(inlet, names, bodies, duration)
            most[number] += count
        _refuse(names, bodies, most, falling, cell, duration,
                _quickest(bodies, continuum.inlets, met, falling, duration))  # fmt: skip
        self._pourings = [
            _pouring(inlet, names, bodies, duration, np.random.default_rng([seed, len(names) + number]))
            for number, inlet in enumerate(continuum.inlets)
        ]
        for inlet, pouring in zip(continuum.inlets, self._pourings, strict=True):
            if len(pouring.points):
                self._refuse_within(f"a jet of {inlet.piece!r}", pouring.points[:_OPENING], walls)
        self.solver = Solver(bodies, cell, gravity=self._gravity, bearers=met,
                             period=continuum.period, double=double, sparse=sparse)  # fmt: skip
        self.viscosities = [numerical_viscosity(body, cell, longest_step(bodies, cell)) for body in bodies]
        self.most, self.forces = most, np.zeros((model.nbody, 6))

    def _refuse_within(self, name: str, points: Array, walls: Sequence[Bearer]) -> None:
        """R1 if any of the points (n, 3) [m] lies in what matter meets."""
        for what, bearer in [*((m.with_, b) for m, b in zip(self.continuum.meetings, self.bearers, strict=True)),
                             *(("a wall", wall) for wall in walls)]:  # fmt: skip
            deepest = min(float(obstacle.depth(points).min()) for obstacle in bearer.obstacles)
            if deepest < -_DEEPEST * self.cell:
                raise Refusal("R1", f"{name} lies {-deepest:.3g} m deep in {what} at the start; allowed: "
                              f"{_DEEPEST * self.cell:.1g} m")  # fmt: skip

    def _place(self, data: Any) -> None:
        """Put the obstacles where their bodies are."""
        model = self._model
        mass = np.zeros((model.nv, model.nv))
        if model.nv:
            mujoco.mj_fullM(model, data, mass)
        free = np.setdiff1d(np.arange(model.nv), self._driven)
        for carried in self._carried:
            bearer, body = carried.bearer, carried.body
            bearer.pivot = data.xipos[body].copy()
            for obstacle, geom in zip(bearer.obstacles, carried.geoms, strict=True):
                obstacle.centre, obstacle.turn = data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3).copy()
            if model.body_weldid[body] == 0:
                continue
            along = np.zeros((6, model.nv))
            mujoco.mj_jacBodyCom(model, data, along[:3], along[3:], body)
            bearer.velocity, bearer.spin = along[:3] @ data.qvel, along[3:] @ data.qvel
            part = along[:, free]
            bearer.yields = part @ np.linalg.solve(mass[np.ix_(free, free)], part.T) if part.any() else None

    def advance(self, data: Any, h: float) -> None:
        """Take the matter from the data's time to h [s] later; `forces` is what the bodies feel meanwhile.

        ArithmeticError if it breaks.
        """
        self._place(data)
        before = [(bearer.impulse, bearer.twist) for bearer in self.bearers]
        ramp = self.continuum.ramp
        grown = math.sin(min(1.0, (data.time + h / 2) / ramp) * math.pi / 2) ** 2 if ramp else 1.0
        self.solver.gravity = grown * self._gravity
        self.solver.advance(h)
        for pouring in self._pourings:
            new = pouring.due(data.time + h)
            if len(new):
                self.solver.add(pouring.piece, new, pouring.velocity)
        self.forces[:] = 0
        for carried, (impulse, twist) in zip(self._carried, before, strict=True):
            force, moment = (carried.bearer.impulse - impulse) / h, (carried.bearer.twist - twist) / h
            self.forces[carried.body, :3] += force
            self.forces[carried.body, 3:] += moment - np.cross(data.xipos[carried.body], force)

    def push(self, data: Any) -> None:
        """The force of the last `advance` on the bodies."""
        data.xfrc_applied += self.forces

    def pushed(self) -> dict[str, Array]:
        """By meeting, the impulse and its moment about the world's origin given so far (6,) [N s, N m s].

        Until now, as velocities are: the half of a step that the solver is behind is taken to be as the last one.
        """
        return {
            meeting.with_: np.concatenate([bearer.impulse, bearer.twist]) + bearer.latest / 2
            for meeting, bearer in zip(self.continuum.meetings, self.bearers, strict=True)
        }

    def sums(self) -> list[dict[str, Any]]:
        """Of each piece what `run.Cloud` has of every sample, by its names."""
        out = []
        for number, body in enumerate(self.solver.bodies):
            x, v, s = (read(number) for read in (self.solver.positions, self.solver.velocities, self.solver.states))
            m = body.volume * body.material.density
            out.append({
                "mass": m * len(x), "centre": x.mean(axis=0), "momentum": m * v.sum(axis=0),
                "turning": m * np.cross(x, v).sum(axis=0), "kinetic": 0.5 * m * (v**2).sum(),
                "elastic": body.volume * energy(body.material, s).sum(),
                "dissipated": body.volume * dissipated(body.material, s).sum(),
                "volume": body.volume * stretch(body.material, s).sum(), "low": x.min(axis=0), "high": x.max(axis=0),
            })  # fmt: skip
        return out

    def particles(self) -> list[tuple[Array, Array, Array]]:
        """Of each piece: positions (n, 3), velocities (n, 3), J (n,)."""
        return [
            (self.solver.positions(n), self.solver.velocities(n), stretch(piece.material, self.solver.states(n)))
            for n, piece in enumerate(self.continuum.pieces)
        ]


def _carried(model: Any, meeting: Meeting, cell: float) -> _Carried:
    """The bearer of a meeting's body or geom.

    KeyError if there is none, ValueError if the body has no solid geom, Refusal if it has no shape to meet.
    """
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, meeting.with_)
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, meeting.with_)
    if body >= 0:
        first = model.body_geomadr[body]
        geoms = [g for g in range(first, first + model.body_geomnum[body]) if model.geom_group[g] < IMMATERIAL]
    elif geom >= 0:
        body, geoms = int(model.geom_bodyid[geom]), [geom]
    else:
        raise KeyError(f"no body or geom {meeting.with_!r} in the scene")
    if not geoms:
        raise ValueError(f"the body {meeting.with_!r} has no geom of a group below {IMMATERIAL}; allowed: a body that "
                         f"has one, or a geom by its name")  # fmt: skip
    return _Carried(Bearer([_obstacle(model, g, meeting, cell) for g in geoms]), body, geoms)


def _obstacle(model: Any, geom: int, meeting: Meeting, cell: float) -> Obstacle:
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind in _PRIMITIVES:
        shape, sizes = _PRIMITIVES[kind]
        return Obstacle(shape, tuple(model.geom_size[geom][:sizes].tolist()), meeting.grip, meeting.friction)
    if kind != mujoco.mjtGeom.mjGEOM_MESH:
        raise Refusal("R7", f"{model.geom(geom).name}: matter cannot meet a geom of type {kind.name}; allowed: plane, "
                      f"sphere, capsule, ellipsoid, cylinder, box, mesh")  # fmt: skip
    mesh = model.geom_dataid[geom]
    points = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
    faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
    solid = trimesh.Trimesh(points.astype(float), faces, process=True)
    found = meshes.signed_distance_grid(solid, _MESH_CELLS * cell, name=model.mesh(mesh).name)
    return Obstacle("mesh", (), meeting.grip, meeting.friction, values=found.values,
                    corner=tuple(found.origin.tolist()), spacing=found.spacing)  # fmt: skip


def _refuse_thin(inlet: Inlet, cell: float) -> None:
    """R7 if a jet is thinner than a shape may be."""
    wide = 2 * inlet.radius
    if wide < sample.LEAST_CELLS * cell * (1 - 1e-9):
        raise Refusal("R7", f"a jet of {inlet.piece!r} is {wide:.4g} m wide, {wide / cell:.3g} cells of {cell:.4g} m; "
                      f"allowed: {sample.LEAST_CELLS} cells, a fidelity of {sample.LEAST_CELLS * cell / wide:.3g} "
                      f"times as many would do")  # fmt: skip


def _poured(inlet: Inlet, names: Sequence[str], bodies: Sequence[Body], duration: float) -> tuple[int, int]:
    """To which piece an inlet adds, and how many particles; ValueError if to none."""
    if inlet.piece not in names:
        raise ValueError(f"piece = {inlet.piece!r} of an inlet; allowed: {', '.join(names)}")
    number, speed = names.index(inlet.piece), float(np.linalg.norm(inlet.velocity))
    lasts = max(min(inlet.stop, duration) - inlet.start, 0.0)
    return number, round(math.pi * inlet.radius**2 * speed * lasts / bodies[number].volume)


def _pouring(
    inlet: Inlet, names: Sequence[str], bodies: Sequence[Body], duration: float, rng: np.random.Generator
) -> _Pouring:
    """The jet of an inlet: a cylinder of matter, cut by the times at which its particles come through."""
    number, count = _poured(inlet, names, bodies, duration)
    velocity = np.array(inlet.velocity, float)
    speed, lasts = float(np.linalg.norm(velocity)), min(inlet.stop, duration) - inlet.start
    # one after the other, and the additive recurrence of the plastic number's powers (M. Roberts, 2018) spreads any
    # that follow each other evenly over the round: however long and thin the jet is, a short piece of it is full
    phi = 1.324717957244746
    u = (rng.random(2) + np.arange(1, count + 1)[:, None] * phi ** -np.arange(1.0, 3.0)) % 1.0
    along = velocity / speed
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    r, angle = inlet.radius * np.sqrt(u[:, :1]), 2 * math.pi * u[:, 1:2]
    points = inlet.position + r * (np.cos(angle) * side + np.sin(angle) * np.cross(along, side))
    order = np.lexsort([rng.random(count), np.arange(count) // _SHUFFLED])
    return _Pouring(number, inlet.start + lasts * (np.arange(count) + 0.5) / count, points[order], velocity)


def numerical_viscosity(body: Body, cell: float, step: float) -> float:
    """Dynamic viscosity that matter seems to have beside its own in vortices nine cells across [Pa s].

    cell: side of a cell [m]; step: of all matter on the grid [s], as what is stiff beside it shortens that
    """
    return _VORTEX * body.material.density * cell**2 / step


def _quickest(
    bodies: Sequence[Body], inlets: Sequence[Inlet], met: Sequence[Bearer], gravity: Array, duration: float
) -> float:
    """Greatest speed that the start tells of [m/s]: of matter and jets at the end of their fall, to the first plane
    below or as long as they are watched, and of what they meet."""
    g = float(np.linalg.norm(gravity))
    down = gravity / g if g else gravity
    floors = [o for bearer in met for o in bearer.obstacles if o.shape == "plane" and o.turn[:, 2] @ down < 0]
    begun = [(np.atleast_2d(body.velocity), body.points) for body in bodies]
    begun += [(np.array([inlet.velocity], float), np.array([inlet.position], float)) for inlet in inlets]
    found = []
    for velocity, points in begun:
        speed = float(np.linalg.norm(velocity, axis=1).max())
        drops = [float(((points - o.centre) @ o.turn[:, 2]).max()) / -float(o.turn[:, 2] @ down) for o in floors]
        drop = max(min(drops), 0.0) if drops else math.inf
        found.append(min(math.sqrt(speed**2 + 2 * g * drop), speed + g * duration) if g else speed)
    low = np.min([points.min(axis=0) for _, points in begun], axis=0)
    high = np.max([points.max(axis=0) for _, points in begun], axis=0)
    return max([*found, *(bearer.speed(low, high) for bearer in met)])


def _refuse(
    names: Sequence[str], bodies: Sequence[Body], most: Sequence[int], gravity: Array, cell: float, duration: float,
    speed: float,
) -> None:  # fmt: skip
    """R9, R7 of a fluid and R10; most: particles that each will have; speed: the greatest that is expected [m/s]."""
    g = float(np.linalg.norm(gravity))
    for name, body in zip(names, bodies, strict=True):
        material = body.material
        heights = body.points @ gravity / g if g else np.zeros(1)
        modulus = getattr(material, "young", material.stiffness())
        squashed = material.density * g * float(np.ptp(heights)) / modulus
        limit = _SQUASHED[type(material)]
        if squashed > limit:
            raise Refusal("R9", f"{name!r}: its own weight squashes it by {squashed:.3g}; allowed: {limit:g}, a "
                          f"modulus {squashed / limit:.3g} times as high")  # fmt: skip
    for name, body in zip(names, bodies, strict=True):
        own, due = numerical_viscosity(body, cell, longest_step(bodies, cell)), body.material.thickness()
        if isinstance(body.material, Newtonian) and due < own:
            finer = min(own / due, _FINEST) if due else _FINEST
            left = numerical_viscosity(body, cell / finer, longest_step(bodies, cell / finer))
            would = f", or {finer:.3g} times as many cells" if left < 1.001 * due else ""
            raise Refusal("R7", f"{name!r}: a dynamic viscosity of {due:.3g} Pa s, less than the method's own at "
                          f"cells of {cell:.3g} m; allowed: {own:.3g} Pa s{would}")  # fmt: skip
    for name, count in zip(names, most, strict=True):
        if count > sample.MOST_PARTICLES:
            raise Refusal("R10", f"{name!r} takes {count:.3g} particles, with what is poured; allowed: "
                          f"{sample.MOST_PARTICLES:.3g}")  # fmt: skip
    work = (sum(most) + _LEAST_COST) * duration / longest_step(bodies, cell, speed)
    if work > _MOST_UPDATES:
        raise Refusal("R10", f"{work:.3g} particle updates at cells of {cell:.3g} m and {speed:.3g} m/s; allowed: "
                      f"{_MOST_UPDATES:.0e}, cells {(work / _MOST_UPDATES) ** 0.25:.3g} times as large")  # fmt: skip
