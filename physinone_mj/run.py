"""What happened: recorded arrays, time leading, SI units, read by the names of the templates."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .base import Verdict
    from .fidelity import Fidelity
    from .scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Impact:
    """One collision, resolved at its own instant. Names are those of geoms; the normal points from the first to the
    second; `approach` is the closing speed before [m/s], `impulse` acts on the second body, in world axes [N s]."""

    time: float
    first: str
    second: str
    position: tuple[float, float, float]
    normal: tuple[float, float, float]
    approach: float
    impulse: tuple[float, float, float]


@dataclass(frozen=True)
class Break:
    """One bond that broke: when [s], which weld, and under what load [N]."""

    time: float
    weld: str
    load: float


@dataclass(frozen=True)
class Cloud:
    """A piece of a continuum over time: sums at every sample (T leading), its particles at every frame (F leading).

    mass (T,) [kg]; centre (T, 3) of mass [m]; momentum (T, 3) [kg m/s]; turning (T, 3): angular momentum about the
    world's origin [kg m²/s]; kinetic, elastic (T,) [J]; dissipated (T,): work of flow of what yields [J]; volume (T,):
    Σ J V₀ [m³]; low, high (T, 3): corners of the box around it [m]
    particles: position, velocity (F, n, 3) single precision [m, m/s], stretch (F, n): J; present (F,): how many of the
    n are there yet (an inlet adds to them); bulk: volume of one particle at rest [m³]
    numerical_viscosity: dynamic viscosity that the method adds to its own, in vortices nine cells across [Pa s]
    """

    mass: Array
    centre: Array
    momentum: Array
    turning: Array
    kinetic: Array
    elastic: Array
    dissipated: Array
    volume: Array
    low: Array
    high: Array
    position: NDArray[np.float32]
    velocity: NDArray[np.float32]
    stretch: NDArray[np.float32]
    present: NDArray[np.int64]
    bulk: float
    numerical_viscosity: float


@dataclass(frozen=True)
class Motion:
    """Bodies over time, derived from the recorded state. Shapes (T, nbody, 3) or (T, nbody, 4) or (T,)."""

    position: Array  # centre of mass [m]
    origin: Array  # the body frame's origin [m]
    quaternion: Array  # w first
    velocity: Array  # of the centre of mass, world axes [m/s]
    spin: Array  # angular velocity, world axes [rad/s]
    kinetic: Array  # [J]
    potential: Array  # gravity, springs and conservative effects [J]
    sensors: Array  # (T, nsensordata)


@dataclass(frozen=True)
class Run:
    """A simulated specimen.

    t: (T,) [s], uniform, starting at 0; qpos: (T, nq); qvel: (T, nv), in MuJoCo's order
    stride: recorded samples per video frame; worked: (T,), what the motors have done so far [J]
    eased: how many contact problems could not be solved as they were, by how they were eased (`contact.CONVEX`, ...)
    cell: side of a cell of a continuum's grid [m]; clouds: its pieces, by name; pushed: by body of the scene that its
    matter meets, (T, 6), the impulse and the angular impulse about the world's origin given to it so far [N s, N m s]
    """

    specimen: Any  # a Phenomenon; its laws read the parameters of their own class
    fidelity: Fidelity
    seed: int
    scene: Scene
    model: Any
    t: Array
    qpos: Array
    qvel: Array
    stride: int
    impacts: tuple[Impact, ...]
    step: float
    seconds: float
    worked: Array
    again_with: Callable[..., Run] = field(repr=False)
    breaks: tuple[Break, ...] = ()
    eased: Mapping[str, int] = field(default_factory=dict)
    cell: float = math.nan
    clouds: Mapping[str, Cloud] = field(default_factory=dict)
    pushed: Mapping[str, Array] = field(default_factory=dict)
    _repeats: dict[tuple[tuple[str, Any], ...], Run] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.t)

    def again(self, **changes: Any) -> Run:
        """The same specimen with some parameters changed, at the same fidelity and seed; simulated once, kept.

        `gravity=` [m/s²] and `boost=` (a velocity added to every free body [m/s], (3,)) change the scene itself.
        """
        key = tuple(sorted(changes.items()))
        if key not in self._repeats:
            self._repeats[key] = self.again_with(**changes)
        return self._repeats[key]

    def check(self) -> list[Verdict]:
        """Every law of the phenomenon, judged on this run."""
        return [law.judge(self.specimen, self) for law in self.specimen.laws().values()]

    @functools.cached_property
    def motion(self) -> Motion:
        """Poses, velocities and energies of all bodies at every sample."""
        return replay(self.model, self.scene, self.t, self.qpos, self.qvel)

    @functools.cached_property
    def traced(self) -> dict[str, Any]:
        """The beams that `optics.trace` has followed already, by name."""
        return {}

    def _body(self, name: str) -> int:
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
        if found < 0:
            raise KeyError(f"no body {name!r}; there are: {', '.join(self.bodies())}")
        return int(found)

    def _joint(self, name: str) -> Any:
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if found < 0:
            there = [self.model.joint(i).name for i in range(self.model.njnt)]
            raise KeyError(f"no joint {name!r}; there are: {', '.join(there)}")
        return self.model.joint(found)

    def bodies(self) -> list[str]:
        """Names of all bodies but the world."""
        return [self.model.body(i).name for i in range(1, self.model.nbody)]

    def joint(self, name: str) -> Array:
        """Joint coordinate over time: (T,) [m or rad], or (T, 7) for a free joint, (T, 4) for a ball."""
        j = self._joint(name)
        return _squeeze(self.qpos[:, j.qposadr[0] : j.qposadr[0] + len(j.qpos0)])

    def joint_speed(self, name: str) -> Array:
        """Joint velocity over time: (T,) [m/s or rad/s], or (T, 6) for a free joint (spin in body axes)."""
        j = self._joint(name)
        width = {7: 6, 4: 3, 1: 1}[len(j.qpos0)]
        return _squeeze(self.qvel[:, j.dofadr[0] : j.dofadr[0] + width])

    def position(self, body: str) -> Array:
        """Centre of mass (T, 3) [m]."""
        return self.motion.position[:, self._body(body)]

    def quaternion(self, body: str) -> Array:
        """Orientation (T, 4), w first."""
        return self.motion.quaternion[:, self._body(body)]

    def velocity(self, body: str) -> Array:
        """Velocity of the centre of mass (T, 3), world axes [m/s]."""
        return self.motion.velocity[:, self._body(body)]

    def spin(self, body: str) -> Array:
        """Angular velocity (T, 3), world axes [rad/s]."""
        return self.motion.spin[:, self._body(body)]

    def mass(self, body: str) -> float:
        """Mass [kg]."""
        return float(self.model.body_mass[self._body(body)])

    def inertia(self, body: str) -> Array:
        """Inertia about the centre of mass, world axes, over time (T, 3, 3) [kg m²]."""
        i = self._body(body)
        rotation = quaternion_matrix(self.motion.quaternion[:, i])
        local = quaternion_matrix(self.model.body_iquat[i][None])[0]
        axes = rotation @ local
        return np.asarray(axes * self.model.body_inertia[i] @ axes.swapaxes(1, 2))

    def momentum(self, body: str) -> Array:
        """m v (T, 3) [kg m/s]."""
        return self.mass(body) * self.velocity(body)

    def angular_momentum(self, body: str) -> Array:
        """r × m v + I ω about the world's origin (T, 3) [kg m²/s]."""
        orbital = np.cross(self.position(body), self.momentum(body))
        return np.asarray(orbital + np.einsum("tij,tj->ti", self.inertia(body), self.spin(body)))

    def kinetic(self, body: str) -> Array:
        """½ m v² + ½ ω I ω of one body (T,) [J]."""
        spin = self.spin(body)
        turning = np.einsum("ti,tij,tj->t", spin, self.inertia(body), spin)
        return np.asarray(0.5 * self.mass(body) * np.sum(self.velocity(body) ** 2, axis=1) + 0.5 * turning)

    def sensor(self, name: str) -> Array:
        """A sensor of the template over time, (T,) or (T, n)."""
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SENSOR, name)
        if found < 0:
            raise KeyError(f"no sensor {name!r}")
        s = self.model.sensor(found)
        return _squeeze(self.motion.sensors[:, s.adr[0] : s.adr[0] + s.dim[0]])


def _squeeze(columns: Array) -> Array:
    return columns[:, 0] if columns.shape[1] == 1 else columns


def quaternion_matrix(q: Array) -> Array:
    """Rotation matrices (T, 3, 3) of unit quaternions (T, 4), w first."""
    w, x, y, z = q.T
    return np.moveaxis(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ),
        -1,
        0,
    )


def replay(model: Any, scene: Scene, t: Array, qpos: Array, qvel: Array) -> Motion:
    """Derive everything else from the recorded state; sensors (accelerations, forces) only if the model has any.

    Sensors see MuJoCo's own constraint forces, so templates whose bodies collide have none.
    """
    data = mujoco.MjData(model)
    count, nbody = len(t), model.nbody
    out = Motion(
        position=np.empty((count, nbody, 3)), origin=np.empty((count, nbody, 3)),
        quaternion=np.empty((count, nbody, 4)), velocity=np.empty((count, nbody, 3)), spin=np.empty((count, nbody, 3)),
        kinetic=np.empty(count), potential=np.empty(count), sensors=np.empty((count, model.nsensordata)),
    )  # fmt: skip
    pushes = [effect.bind(model) for effect in scene.effects] if model.nsensordata else []
    root, arms = model.body_rootid, np.empty((count, nbody, 3))
    for i in range(count):
        data.time, data.qpos[:], data.qvel[:] = t[i], qpos[i], qvel[i]
        mujoco.mj_fwdKinematics(model, data)
        mujoco.mj_comVel(model, data)
        if model.nsensordata:
            data.xfrc_applied[:] = 0
            for push in pushes:
                push(data)
            mujoco.mj_forward(model, data)
            out.sensors[i] = data.sensordata
        mujoco.mj_makeM(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        out.position[i], out.origin[i], out.quaternion[i] = data.xipos, data.xpos, data.xquat
        out.spin[i] = data.cvel[:, :3]
        out.velocity[i], arms[i] = data.cvel[:, 3:], data.xipos - data.subtree_com[root]
        out.potential[i] = data.energy[0] + sum(effect.potential(model, data) for effect in scene.effects)
        out.kinetic[i] = data.energy[1]
    out.velocity[:] += np.cross(out.spin, arms)
    return out
