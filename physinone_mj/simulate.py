"""Scene + Fidelity -> Run: the only place with a time step, an integrator, a flag.

Without contact a scene is advanced by the classical fourth-order Runge-Kutta method, effects evaluated at every stage;
what equalities hold together (a closed chain), likewise, with their forces.

With contact, a step is made of pieces. Between events a body in flight moves by Runge-Kutta; what touches moves by the
leapfrog "drift, kick, drift" with the contact problem of `contact` solved at mid-step: x += h v/2; v' = v + h a;
x += h v'/2, second order, exact under constant forces, no half-step offset. An impact is an event: the piece ends where
the surfaces meet (found by Newton's method on the gap, to a nanometre), velocities jump by Newton's law of restitution,
and the rest of the step goes on. So restitution, impact times and normals do not depend on the step, and nothing
tunnels however fast.

Impacts too gentle to lift off for a whole step (e |v| < g h) are taken as inelastic: Zeno's bounces end.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from . import contact, optics
from .base import Phenomenon, Refusal, Verdict
from .collision import IMPEDANCE
from .constants import STANDARD_GRAVITY
from .contact import Surface
from .continuum import Continuum
from .fidelity import REFERENCE, STANDARD, Fidelity
from .registry import phenomenon
from .run import Break, Cloud, Impact, Run
from .scene import IMMATERIAL, Bowl, Scene

if TYPE_CHECKING:
    from mpm_sidecar.medium import Medium

Array = NDArray[np.float64]
Progress = Callable[[float], None]

OVERSAMPLING: Final = 8
"""Recorded samples per video frame, at least."""

_MAX_EVENTS: Final = 1000
_CROWD: Final = 4
"""Impacts in one step after which the rest of it, and the steps that follow, take theirs all at once; in a heap of many
contacts the first one is enough."""
_STUCK: Final = 32
"""Events in one step of a heap after which impacts are left to the step: what is wedged has been given up by those."""
_RETRIES: Final = 3
"""Times that the instant of an impact is looked for in such a heap."""
_QUIET: Final = 2
"""Impacts in such a step at which they are taken one by one again."""
_DEEPEST: Final = 0.02
"""What meets in a crowded step may overlap by this part of the smaller's bounding radius before it counts as met; else
the step is halved, _HALVINGS times at most."""
_HALVINGS: Final = 5
_MAX_STEPS: Final = 20_000_000
_MAX_MASS_RATIO: Final = 1e4
_MAX_RATE: Final = 0.5
"""Largest ω h of a spring, or decay rate × h of a damper, that the step resolves."""

_DISABLE = mujoco.mjtDisableBit


class UnstableScene(RuntimeError):
    """A run that broke: phenomenon, parameters, time [s] and the quantity that went wrong. Never data."""

    def __init__(self, specimen: Phenomenon, time: float, quantity: str) -> None:
        super().__init__(specimen, time, quantity)
        self.specimen, self.time, self.quantity = specimen, time, quantity

    def __str__(self) -> str:
        given = json.dumps(self.specimen.values())[1:-1]
        return f"{self.specimen.label}({given}) broke at t = {self.time:.6g} s: {self.quantity}"


@dataclass(frozen=True)
class Engine:
    """How a scene is advanced where a study asks for another way than ours; nothing else may.

    stock: by MuJoCo's steps alone, with contacts and equalities as its own constraints have them
    integrator: of MuJoCo: with stock, and of a scene that nothing constrains
    cone, solver: of MuJoCo, with stock
    row: with stock: contacts whose reference is met within a step; else as MuJoCo has them by default
    double: precision of a continuum; None: double from REFERENCE's cells on
    frugal: leave out what the scene does not need; False to show that it changes nothing
    """

    name: str = "ours"
    stock: bool = False
    integrator: Literal["RK4", "Euler", "implicit", "implicitfast"] = "RK4"
    cone: Literal["elliptic", "pyramidal"] = "elliptic"
    solver: Literal["Newton", "CG", "PGS"] = "Newton"
    row: bool = True
    double: bool | None = None
    frugal: bool = True


OURS: Final = Engine()
_STOCK: Final = tuple(
    Engine(f"stock {name}", stock=True, **({"integrator": "implicitfast"} | changes))
    for name, changes in (
        ("implicitfast", {}), ("Euler", {"integrator": "Euler"}), ("RK4", {"integrator": "RK4"}),
        ("pyramidal", {"cone": "pyramidal"}), ("CG", {"solver": "CG"}), ("PGS", {"solver": "PGS"}),
        ("soft", {"row": False}),
    )
)  # fmt: skip
_INTEGRATORS: Final = (
    Engine("Euler", integrator="Euler"), Engine("implicit", integrator="implicit"),
    Engine("implicitfast", integrator="implicitfast"),
)  # fmt: skip
_PRECISIONS: Final = Engine("single precision", double=False), Engine("double precision", double=True)


@dataclass(frozen=True)
class Compiled:
    """A scene ready to be stepped. steps: time steps per recorded sample; stride: samples per video frame."""

    specimen: Phenomenon
    scene: Scene
    fidelity: Fidelity
    engine: Engine
    model: Any
    pairs: tuple[Surface, ...]
    joined: contact.Joined
    constrained: bool
    step: float
    steps: int
    stride: int
    samples: int

    @property
    def cell(self) -> float:
        """Side of a cell of a continuum's grid [m]."""
        return self.scene.length / self.fidelity.cells

    @property
    def double(self) -> bool:
        """Whether its continua are computed in double precision."""
        asked = self.engine.double
        return self._usually_double if asked is None else asked

    @property
    def _usually_double(self) -> bool:
        return self.fidelity.cells >= REFERENCE.cells

    @property
    def alternatives(self) -> tuple[Engine, ...]:
        """Other ways to advance it, for study. MuJoCo's own steps know no motors, bonds, bowls and cuts of ours."""
        others = [e for e in _PRECISIONS if self.scene.continua and e.double != self._usually_double]
        if not self.constrained:
            return (*(_INTEGRATORS if self.model.nv else ()), *others)
        joined, touching = self.joined, bool(self.pairs)
        if joined.motors or joined.bonds or joined.cups or self.scene.cuts or self.scene.continua:
            return tuple(others)
        about_contact = ("stock pyramidal", "stock soft")
        return tuple(engine for engine in _STOCK if touching or engine.name not in about_contact)


def build(specimen: Phenomenon) -> Scene:
    """The specimen's scene; Refusal if its parameters do not go together, or lie where there is no such scene."""
    scene = Scene()
    try:
        specimen.build(scene)
    except (ArithmeticError, LookupError, TypeError, ValueError) as why:
        if specimen.checked or isinstance(why, Refusal):
            raise
        raise Refusal("model", f"{specimen.label}: values outside of their ranges make no scene: {why}") from why
    if not math.isfinite(scene.time):
        raise ValueError(f"{specimen.label}.build did not call scene.resolve")
    return scene


def compile(specimen: Phenomenon, scene: Scene, fidelity: Fidelity, engine: Engine = OURS) -> Compiled:
    """Derive from what is in the scene what it needs: steps, contacts, flags; refuse what cannot be resolved."""
    spec = scene.spec
    pieces = [piece.name for continuum in scene.continua for piece in continuum.pieces]
    if len(set(pieces)) < len(pieces):
        raise ValueError(f"pieces {pieces} of a scene; allowed: each of its own name")
    frames = max(2, round(scene.duration * scene.fps))
    stride = max(OVERSAMPLING, math.ceil(8 / (scene.time * scene.fps)))
    sample = 1 / (scene.fps * stride)
    steps = max(1, math.ceil(sample * fidelity.steps / scene.time))
    if frames * stride * steps > _MAX_STEPS:
        raise Refusal("R10", f"{frames * stride * steps} steps; allowed: {_MAX_STEPS}; shortest time {scene.time:g} s, "
                      f"duration {scene.duration:g} s")  # fmt: skip
    named, cups = _contact_pairs(scene, sample / steps)
    spec.option.gravity = (0.0, 0.0, -scene.gravity)
    spec.option.timestep = sample / steps
    spec.option.cone = getattr(mujoco.mjtCone, f"mjCONE_{engine.cone.upper()}")
    integrators = mujoco.mjtIntegrator
    spec.option.integrator = integrators.mjINT_IMPLICITFAST if named else integrators.mjINT_RK4  # the viewer's
    model = spec.compile()
    surfaces = tuple(named[model.pair(i).name] for i in range(model.npair))  # the compiler sorts the pairs
    joined = _join(scene, model, cups)
    constrained = bool(
        surfaces or cups or joined.motors or model.neq or model.jnt_limited.any() or model.tendon_limited.any()
        or model.dof_frictionloss.any()
    )  # fmt: skip
    model.opt.integrator = getattr(integrators, f"mjINT_{engine.integrator.upper()}")
    model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{engine.solver.upper()}")
    model.opt.disableflags |= _DISABLE.mjDSBL_AUTORESET
    if engine.stock:
        if not engine.row:
            unset = mujoco.MjSpec().add_pair(name="unset", geomname1="a", geomname2="b")
            model.pair_solref[:], model.pair_solimp[:] = unset.solref, unset.solimp
            model.pair_solreffriction[:] = unset.solreffriction
    elif constrained:
        model.opt.tolerance = 1e-15
        model.opt.disableflags |= _DISABLE.mjDSBL_ISLAND
        for rows in (model.eq_solimp, model.jnt_solimp, model.tendon_solimp_lim, model.dof_solimp):
            rows[:] = IMPEDANCE
    elif engine.frugal:
        model.opt.disableflags |= _DISABLE.mjDSBL_CONSTRAINT
    if not (surfaces or cups) and engine.frugal:
        model.opt.disableflags |= _DISABLE.mjDSBL_CONTACT
    _refuse(specimen, model, scene)
    compiled = Compiled(specimen, scene, fidelity, engine, model, surfaces, joined, constrained, sample / steps, steps,
                        stride, frames * stride)  # fmt: skip
    if engine.name != OURS.name and engine.frugal and engine not in compiled.alternatives:
        offered = ", ".join(other.name for other in compiled.alternatives) or "none"
        raise ValueError(f"engine = {engine.name!r} of {specimen.label}; allowed: {OURS.name}, {offered}")
    return compiled


def _join(scene: Scene, model: Any, cups: list[tuple[Bowl, str, Surface]]) -> contact.Joined:
    """The scene's motors, bonds and bowls by the numbers of the model; KeyError names what is missing."""
    return contact.Joined(
        motors=tuple((int(model.joint(motor.joint).dofadr[0]), motor) for motor in scene.motors),
        bonds=tuple(sorted(((int(model.equality(bond.weld).id), bond) for bond in scene.bonds), key=lambda b: b[0])),
        cups=tuple((bowl, int(model.geom(other).id), surface) for bowl, other, surface in cups),
    )


def _geoms(scene: Scene, name: str) -> list[Any]:
    body = scene.spec.body(name)
    if body is not None:
        return [g for g in body.geoms if g.group < IMMATERIAL]
    geom = scene.spec.geom(name)
    if geom is None:
        raise KeyError(f"no body or geom {name!r} in the scene")
    return [geom]


def _contact_pairs(scene: Scene, step: float) -> tuple[dict[str, Surface], list[tuple[Bowl, str, Surface]]]:
    """Declare the pairs. Their solref serves who opens the scene in the viewer; our own steps write the references.

    What lies in a bowl is returned by itself: MuJoCo has no such pair.
    """
    surfaces, cups = {}, []
    bowls = {bowl.geom: bowl for bowl in scene.bowls}
    for first, second in dict.fromkeys(scene.touching):
        surface = scene.matter[first].surface.against(scene.matter[second].surface)
        for a in _geoms(scene, first):
            for b in _geoms(scene, second):
                if a.name in bowls or b.name in bowls:
                    bowl, other = (bowls[a.name], b.name) if a.name in bowls else (bowls[b.name], a.name)
                    cups.append((bowl, other, surface))
                    continue
                name = f"{a.name} {b.name}"
                pair = scene.spec.add_pair(name=name, geomname1=a.name, geomname2=b.name)
                pair.condim = 3 if surface.static_friction > 0 else 1
                friction = max(surface.static_friction, mujoco.mjMINMU)
                pair.friction = [friction, friction, 0, 0, 0]
                pair.solref = (0.0, -(1 + surface.restitution) / step)
                pair.solreffriction = (0.0, -1 / step)
                pair.solimp = IMPEDANCE
                surfaces[name] = surface
    return surfaces, cups


def _refuse(specimen: Phenomenon, model: Any, scene: Scene) -> None:
    for name in ("body_mass", "body_inertia", "geom_size", "body_pos", "jnt_stiffness", "dof_damping"):
        if not np.isfinite(getattr(model, name)).all():
            raise Refusal("R11", f"{specimen.label}: the compiled model's {name} is not finite")
    free = np.array([m for i, m in enumerate(model.body_mass) if m > 0 and model.body_weldid[i] != 0])
    if model.npair and len(free) > 1 and free.max() / free.min() > _MAX_MASS_RATIO:
        ratio = free.max() / free.min()
        raise Refusal("R3", f"{specimen.label}: mass ratio {ratio:.3g} of moving bodies; allowed: {_MAX_MASS_RATIO:g}")
    data = mujoco.MjData(model)
    _start(model, data, scene)
    mujoco.mj_fwdPosition(model, data)
    for i in range(data.ncon):
        found = data.contact[i]
        size = min(r for g in found.geom if (r := model.geom_rbound[g]) > 0)
        if found.dist < -1e-4 * size:
            names = " and ".join(model.geom(g).name for g in found.geom)
            raise Refusal("R1", f"{specimen.label}: {names} overlap by {-found.dist:.3g} m at the start; "
                          f"allowed: {1e-4 * size:.1g} m")  # fmt: skip
    for beam, geom in optics.blocked_mouths(model, data, scene):
        raise Refusal("R1", f"{specimen.label}: the beam {beam!r} starts inside {geom!r}; allowed: outside of all that "
                      f"is opaque")  # fmt: skip
    stiffest, fastest = _rates(model, data)
    for rate, what in ((stiffest, "springs"), (fastest, "dampers")):
        if rate * model.opt.timestep > _MAX_RATE:
            needed = math.ceil(scene.time * rate / _MAX_RATE)
            step = model.opt.timestep
            raise Refusal("R4", f"{specimen.label}: {what} of rate {rate:.3g} /s at a step of {step:.3g} s; "
                          f"allowed: {_MAX_RATE / step:.3g} /s, or a fidelity of {needed} steps")  # fmt: skip


def _rates(model: Any, data: Any) -> tuple[float, float]:
    """Highest natural frequency of the springs and decay rate of the dampers at the start [1/s]."""
    if not (model.jnt_stiffness.any() or model.tendon_stiffness.any() or model.dof_damping.any()
            or model.tendon_damping.any()):  # fmt: skip
        return 0.0, 0.0
    mujoco.mj_fwdVelocity(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    along = np.zeros((model.ntendon, model.nv))
    for i in range(model.ntendon):
        row = slice(model.ten_J_rowadr[i], model.ten_J_rowadr[i] + model.ten_J_rownnz[i])
        along[i, model.ten_J_colind[row]] = data.ten_J[row]
    joint = np.zeros(model.nv)
    joint[model.jnt_dofadr] = model.jnt_stiffness

    def largest(dof: Array, tendon: Array) -> float:
        matrix = np.diag(dof) + along.T @ np.diag(tendon) @ along
        return float(max(eigh(matrix, mass, eigvals_only=True).max(), 0.0))

    return math.sqrt(largest(joint, model.tendon_stiffness)), largest(model.dof_damping, model.tendon_damping)


def _start(model: Any, data: Any, scene: Scene) -> None:
    for name, value in scene.start.items():
        address, width = model.joint(name).qposadr[0], len(model.joint(name).qpos0)
        data.qpos[address : address + width] = value
    for name, value in scene.speed.items():
        address, width = model.joint(name).dofadr[0], {7: 6, 4: 3, 1: 1}[len(model.joint(name).qpos0)]
        data.qvel[address : address + width] = value


class Stepper:
    """Advances one compiled scene by one recorded sample at a time. Use as a context: the force callback is global."""

    def __init__(
        self, compiled: Compiled, boost: ArrayLike = (0.0, 0.0, 0.0), data: Any = None, seed: int = 0
    ) -> None:  # fmt: skip
        self.compiled, self.model = compiled, compiled.model
        self.data = mujoco.MjData(self.model) if data is None else data
        _start(self.model, self.data, compiled.scene)
        for j in range(self.model.njnt):
            if self.model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
                address = self.model.jnt_dofadr[j]
                self.data.qvel[address : address + 3] += boost
        self._pushes = [effect.bind(self.model) for effect in compiled.scene.effects]
        for name, value in compiled.scene.control.items():
            self.data.ctrl[self.model.actuator(name).id] = value
        self._switch_on()
        ours = compiled.constrained and not compiled.engine.stock
        self._solver = contact.Solver(self.model, compiled.pairs, compiled.joined) if ours else None
        self._sample, self._clock = 0, self.data.time
        self._steps, self._rate = compiled.steps, compiled.scene.fps * compiled.stride
        self._warned: list[str] = []
        self._state = self.data.qpos, self.data.qvel, self.data.warning.number
        self._clear = self.data.xfrc_applied.fill
        self._crowded = False
        self._forward()
        self.media = [self._medium(continuum, seed) for continuum in compiled.scene.continua]
        self._pushes += [medium.push for medium in self.media]

    def _medium(self, continuum: Continuum, seed: int) -> Medium:
        from mpm_sidecar.medium import Medium

        compiled = self.compiled
        driven = [dof for dof, motor in compiled.joined.motors if motor.force == motor.off == math.inf]
        return Medium(
            continuum, self.model, self.data, cell=compiled.cell, gravity=compiled.scene.gravity,
            duration=compiled.samples / self._rate, driven=driven, seed=seed,
            double=compiled.double, sparse=compiled.engine.frugal,
        )  # fmt: skip

    def __enter__(self) -> Stepper:
        # without a listener MuJoCo writes MUJOCO_LOG.TXT wherever it runs
        mujoco.set_mju_user_warning(self._warned.append)
        if self.compiled.engine.frugal:
            self.model.opt.disableflags |= _DISABLE.mjDSBL_SENSOR  # they are read from what is recorded
        if self._pushes or not self.compiled.engine.frugal:
            mujoco.set_mjcb_passive(self._push)
        return self

    def __exit__(self, *_: object) -> None:
        self.model.opt.disableflags &= ~int(_DISABLE.mjDSBL_SENSOR)
        mujoco.set_mjcb_passive(None)
        mujoco.set_mju_user_warning(None)

    def _push(self, _model: Any, data: Any) -> None:
        self._clear(0.0)
        for push in self._pushes:
            push(data)

    def advance(self) -> None:
        """One sample further; the state is left exactly at its time. UnstableScene if it cannot be taken."""
        data = self.data
        self._sample += 1
        try:
            if self._solver is None and not self.media:
                mujoco.mj_step(self.model, data, self._steps)
            else:
                for _ in range(self._steps):
                    for medium in self.media:
                        medium.advance(data, self.compiled.step)
                    if self._solver is None:
                        mujoco.mj_step(self.model, data)
                    else:
                        self._step()
        except ArithmeticError as why:  # contact that does not settle, or an effect beyond its validity
            raise UnstableScene(self.compiled.specimen, data.time, str(why)) from None
        # counted, not summed: the clock of sample n is the same double whatever the steps were
        self._clock, data.time = data.time, self._sample / self._rate

    def inspect(self) -> None:
        """UnstableScene if the state is not finite, MuJoCo warned, or its clock is not that of the samples."""
        qpos, qvel, warned = self._state
        clocks = math.isclose(self._clock, self.data.time, rel_tol=1e-9, abs_tol=1e-9)
        if clocks and not warned.dot(warned) and math.isfinite(qpos.dot(qpos) + qvel.dot(qvel)):
            return
        wrong = [f"{name} is not finite" for name, x in (("qpos", qpos), ("qvel", qvel)) if not np.isfinite(x).all()]
        if warned.any():
            kinds = [mujoco.mjtWarning(i).name for i in np.nonzero(warned)[0]]
            wrong.append(f"MuJoCo warned: {', '.join(kinds)}: {''.join(self._warned[:1]).strip()}")
        if not clocks:
            wrong.append(f"MuJoCo's clock stands at {self._clock} s")
        raise UnstableScene(self.compiled.specimen, self.data.time, "; ".join(wrong) or "the state is beyond 1e150")

    @property
    def impacts(self) -> list[Impact]:
        """Collisions so far."""
        return self._solver.impacts if self._solver else []

    @property
    def breaks(self) -> list[Break]:
        """Bonds that broke so far."""
        return self._solver.breaks if self._solver else []

    @property
    def worked(self) -> float:
        """Work of the motors so far [J]."""
        return self._solver.worked if self._solver else 0.0

    @property
    def eased(self) -> dict[str, int]:
        """Contact problems so far that could not be solved as they were, by how they were eased."""
        return dict(self._solver.eased) if self._solver else {}

    def _switch_on(self) -> None:
        """Everything that will be cut holds; what is to happen when, soonest last."""
        model, data, scene = self.model, self.data, self.compiled.scene
        self._switches: list[tuple[float, Callable[[], None]]] = []
        for name, when in scene.cuts.items():
            if (number := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_EQUALITY, name)) >= 0:
                self._switches.append((when, functools.partial(data.eq_active.__setitem__, number, 0)))
            else:
                number = model.tendon(name).id
                model.tendon_limited[number] = 1
                self._switches.append((when, functools.partial(model.tendon_limited.__setitem__, number, 0)))
        for dof, motor in self.compiled.joined.motors:
            self._switches.append((motor.off, functools.partial(model.dof_frictionloss.__setitem__, dof, 0.0)))
        self._switches = sorted((s for s in self._switches if s[0] < math.inf), key=lambda s: -s[0])

    def _step(self) -> None:
        solver, model, data = self._solver, self.model, self.data
        assert solver is not None
        may_sleep = self.compiled.engine.frugal
        if solver.idle and not (self._switches or self._pushes):  # what sleeps and is left alone sleeps on
            data.time += self.compiled.step
            return
        solver.begin(data, self.compiled.step, self.compiled.scene.gravity or STANDARD_GRAVITY)
        left = self.compiled.step
        self._forward()
        if solver.wake(data):
            solver.begin(data, self.compiled.step, self.compiled.scene.gravity or STANDARD_GRAVITY)
            self._forward()
        if may_sleep and not self._switches and solver.rest(data):
            data.time += left
            return
        if self._crowded:
            before = len(solver.impacts)
            self._slide_at_once(left)
            self._crowded = len(solver.impacts) > before + _QUIET
            return
        for events in range(_MAX_EVENTS):
            due = self._switches[-1][0] - data.time if self._switches else math.inf
            if due <= 1e-12:
                self._switches.pop()[1]()
                self._forward()
                continue
            if solver.only_held:
                solver.swing(data, min(left, due))
                self._forward()
                left -= min(left, due)
                if left <= 1e-12 * self.compiled.step:
                    return
                continue
            soonest, gap, engaged = solver.look(data, left)
            if gap <= contact.TOUCH and not (self._crowded and events > _STUCK):
                solver.impact(data)
                mujoco.mj_fwdVelocity(model, data)
                self._crowded = events > _CROWD or solver.crowd(data)
                continue
            if self._crowded:
                self._slide_at_once(left)
                return
            piece = min(left, soonest, due)
            state = data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy(), data.time
            memory = solver.remember()
            for tries in itertools.count():
                (solver.slide if engaged else solver.fly)(data, piece)
                self._forward()
                back, gap, _ = solver.look(data, left)
                if gap >= -contact.TOUCH or piece + back <= 1e-9 * self.compiled.step:
                    break  # or MuJoCo has only now reported the corner that met first: it has to do here
                # the surfaces met within the piece: it shall end where they do
                piece += back
                data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.time = state
                solver.recall(memory)
                if tries >= _RETRIES and solver.crowd(data):  # another two of its many surfaces meet first, each time
                    self._crowded, piece = True, 0.0
                    self._forward()
                    break
            left -= piece
            if left <= 1e-12 * self.compiled.step:
                return
        raise UnstableScene(self.compiled.specimen, data.time, f"{_MAX_EVENTS} impacts within one step")

    def _slide_at_once(self, dt: float, halvings: int = _HALVINGS) -> None:
        """A crowded step; in two, if things would otherwise meet deep within each other."""
        solver, data = self._solver, self.data
        assert solver is not None
        state = data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy(), data.time
        memory = solver.remember()
        if solver.slide(data, dt, crowded=True, deepest=_DEEPEST if halvings else math.inf):
            self._forward()
            return
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.time = state
        solver.recall(memory)
        self._forward()
        for _ in range(2):
            self._slide_at_once(dt / 2, halvings - 1)

    def _forward(self) -> None:
        (self._solver.place if self._solver else functools.partial(mujoco.mj_fwdPosition, self.model))(self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)


def simulate(
    which: int | str | type[Phenomenon],
    *,
    fidelity: Fidelity = STANDARD,
    seed: int = 0,
    progress: Progress | None = None,
    engine: Engine = OURS,
    **parameters: Any,
) -> Run:
    """Simulate a phenomenon, by index, label or class, with some of its parameters set.

    progress: called now and then with the fraction done; engine: for study.
    Raises LookupError (unknown index or label), ParameterError, Refusal (before the first step) and UnstableScene.
    """
    cls = which if isinstance(which, type) else phenomenon(which)
    return simulate_specimen(cls.make(**parameters), fidelity=fidelity, seed=seed, progress=progress, engine=engine)


def check(which: int | str | type[Phenomenon], *, fidelity: Fidelity = STANDARD, **parameters: Any) -> list[Verdict]:
    """Simulate a phenomenon and hold every one of its laws against the run; raises what `simulate` raises."""
    return simulate(which, fidelity=fidelity, **parameters).check()


def simulate_specimen(
    specimen: Phenomenon,
    *,
    fidelity: Fidelity = STANDARD,
    seed: int = 0,
    progress: Progress | None = None,
    gravity: float | None = None,
    boost: ArrayLike = (0.0, 0.0, 0.0),
    engine: Engine = OURS,
) -> Run:
    """Simulate one specimen; `gravity` [m/s²] and `boost` (3,) [m/s] change the scene for symmetry checks."""
    scene = build(specimen)
    if gravity is not None:
        scene.gravity = gravity
    compiled = compile(specimen, scene, fidelity, engine)
    model, count = compiled.model, compiled.samples
    qpos, qvel, t = np.empty((count, model.nq)), np.empty((count, model.nv)), np.empty(count)
    worked = np.empty(count)
    begun = clock.process_time()
    with Stepper(compiled, boost, seed=seed) as stepper:
        data = stepper.data
        film = Film(scene.continua, stepper.media, count, compiled.stride)
        for i in range(count):
            if i:
                stepper.advance()
            t[i], qpos[i], qvel[i], worked[i] = data.time, data.qpos, data.qvel, stepper.worked
            film.take(i)
            if i % compiled.stride == 0 or i == count - 1:
                stepper.inspect()
                if progress:
                    progress((i + 1) / count)
    return Run(
        specimen=specimen, fidelity=fidelity, seed=seed, scene=scene, model=model, t=t, qpos=qpos, qvel=qvel,
        stride=compiled.stride, impacts=tuple(stepper.impacts), breaks=tuple(stepper.breaks), step=compiled.step,
        seconds=clock.process_time() - begun, again_with=repeater(specimen, fidelity, seed, engine),
        worked=worked, eased=stepper.eased, cell=compiled.cell, clouds=film.clouds(), pushed=film.pushed(),
    )  # fmt: skip


class Film:
    """The record of a scene's matter while it is made: sums at every sample, particles at every frame."""

    def __init__(self, continua: Sequence[Continuum], media: Sequence[Medium], samples: int, stride: int) -> None:
        self._pieces = [(m, i, piece) for m, c in zip(media, continua, strict=True) for i, piece in enumerate(c.pieces)]
        self._media, self._stride = media, stride
        self._sums = [
            {key: np.empty((samples, *np.shape(value))) for key, value in sums.items()}
            for medium in media for sums in medium.sums()
        ]  # fmt: skip
        self._pushed = {name: np.empty((samples, 6)) for medium in media for name in medium.pushed()}
        frames = len(range(0, samples, stride))
        self._seen = [np.full((frames, m.most[i], 7), np.nan, np.float32) for m, i, _ in self._pieces]
        self._present = np.zeros((len(self._pieces), frames), np.int64)

    def take(self, sample: int) -> None:
        """Write down a sample."""
        found = [sums for medium in self._media for sums in medium.sums()]
        for kept, sums in zip(self._sums, found, strict=True):
            for key, value in sums.items():
                kept[key][sample] = value
        taken: dict[str, Array] = {}
        for medium in self._media:
            for name, given in medium.pushed().items():
                taken[name] = taken[name] + given if name in taken else given
        for name, given in taken.items():
            self._pushed[name][sample] = given
        if sample % self._stride == 0:
            frame = sample // self._stride
            seen = [particles for medium in self._media for particles in medium.particles()]
            for number, (x, v, j) in enumerate(seen):
                self._seen[number][frame, : len(x)] = np.column_stack([x, v, j])
                self._present[number, frame] = len(x)

    def clouds(self) -> dict[str, Cloud]:
        """The pieces, by name."""
        return {
            piece.name: Cloud(
                **self._sums[number], position=self._seen[number][..., :3], velocity=self._seen[number][..., 3:6],
                stretch=self._seen[number][..., 6], present=self._present[number],
                bulk=medium.solver.bodies[i].volume, numerical_viscosity=medium.viscosities[i],
            )
            for number, (medium, i, piece) in enumerate(self._pieces)
        }  # fmt: skip

    def pushed(self) -> dict[str, Array]:
        """What was given to what the matter meets (samples, 6), by name."""
        return self._pushed


def repeater(specimen: Phenomenon, fidelity: Fidelity, seed: int, engine: Engine = OURS) -> Callable[..., Run]:
    """What `Run.again` calls: the same specimen with parameters, gravity or a boost changed."""

    def again(gravity: float | None = None, boost: ArrayLike = (0.0, 0.0, 0.0), **changes: Any) -> Run:
        other = specimen.altered(**changes)
        return simulate_specimen(other, fidelity=fidelity, seed=seed, gravity=gravity, boost=boost, engine=engine)

    return again
