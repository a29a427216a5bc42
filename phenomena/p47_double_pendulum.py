"""47: a double pendulum, and its equations of motion to compare it with."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from math import cos, log, pi, sin, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import fit, period
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

HORIZON = 1000.0
"""Trajectories are compared until an infinitesimal error has grown by this factor."""

BEYOND = 1e4
"""Twins are followed until their separation has grown by this factor."""

OFFSET = 1e-7
"""Of the twin by which that growth is measured [rad]: still small when it ends."""


@dataclass(frozen=True)
class Lagrangian:
    """Two spheres on massless rods in a plane; angles from the downward vertical.

    L = ½ a θ₁'² + ½ b θ₂'² + c θ₁'θ₂' cos(θ₁ - θ₂) + u cos θ₁ + w cos θ₂ (Landau & Lifshitz, Mechanics, §5 problem 1,
    with the moments of inertia of the bobs added to a and b). a, b, c [kg m²]; u, w [J].
    """

    a: float
    b: float
    c: float
    u: float
    w: float

    def flow(self, _t: float, state: Array) -> list[float]:
        """Rate of (θ₁, θ₂, θ₁', θ₂') and of four vectors tangent to it: (4, 1 + 4), flattened."""
        y = state.tolist()  # floats: a third of the time that arrays of four take
        (q1, *d1s), (q2, *d2s), (v1, *e1s), (v2, *e2s) = y[:5], y[5:10], y[10:15], y[15:]
        s, k = self.c * sin(q1 - q2), self.c * cos(q1 - q2)
        u, w, det = self.u * cos(q1), self.w * cos(q2), self.a * self.b - k * k
        torque1, torque2 = -s * v2 * v2 - self.u * sin(q1), s * v1 * v1 - self.w * sin(q2)
        bend1, bend2 = (self.b * torque1 - k * torque2) / det, (self.a * torque2 - k * torque1) / det
        rate1, rate2 = [bend1], [bend2]
        for d1, d2, e1, e2 in zip(d1s, d2s, e1s, e2s, strict=True):
            torque1 = (s * bend2 - k * v2 * v2) * (d1 - d2) - 2 * s * v2 * e2 - u * d1
            torque2 = (s * bend1 + k * v1 * v1) * (d1 - d2) + 2 * s * v1 * e1 - w * d2
            rate1.append((self.b * torque1 - k * torque2) / det)
            rate2.append((self.a * torque2 - k * torque1) / det)
        return [*y[10:], *rate1, *rate2]

    def solve(self, angle1: float, angle2: float, tau: float, t: Array) -> tuple[Array, Array]:
        """From rest, by an eighth-order Runge-Kutta method: states (4, n) and tangent map (4, 4, n).

        Angular velocities count in units of 1/τ in the map. The solution ends, n < len(t), when it has magnified
        something `BEYOND`-fold.
        """
        unit = np.array([1.0, 1.0, tau, tau])
        start = np.zeros((4, 5))
        start[:2, 0] = angle1, angle2
        start[:, 1:] = np.diag(1 / unit)

        def beyond(_t: float, state: Array) -> float:
            return BEYOND - float(np.linalg.norm(unit[:, None] * state.reshape(4, 5)[:, 1:]))

        beyond.terminal = True  # type: ignore[attr-defined]
        span = (t[0], t[-1])
        found = solve_ivp(self.flow, span, start.ravel(), "DOP853", t, events=beyond, rtol=1e-12, atol=1e-13)
        states = found.y.reshape(4, 5, -1)
        return states[:, 0], states[:, 1:] * unit[:, None, None]

    def modes(self) -> list[tuple[float, Array]]:
        """Small oscillations: (ω² [1/s²], shape (θ₁, θ₂)), slow one first; roots of det(K - ω² M) = 0."""
        det, middle = self.a * self.b - self.c**2, self.a * self.w + self.b * self.u
        root = sqrt(middle**2 - 4 * det * self.u * self.w)
        squares = 2 * self.u * self.w / (middle + root), (middle + root) / (2 * det)
        return [(x, np.array([1.0, (self.u - x * self.a) / (x * self.c)])) for x in squares]


def magnified(tangent: Array) -> Array:
    """The factor (n,) by which the worst small error has grown; tangent: (4, 4, n)."""
    return np.asarray(np.linalg.norm(tangent, ord=2, axis=(0, 1)))


class DoublePendulum(Phenomenon, domain="mechanics"):
    """A double pendulum moves: regular when it swings little, chaotic when it swings high."""

    length1: Annotated[float, Param("m", 0.2, 0.8, "pivot to the first bob's centre")] = 0.5
    length2: Annotated[float, Param("m", 0.2, 0.8, "first bob's centre to the second's")] = 0.4
    mass1: Annotated[float, Param("kg", 0.05, 2.0, "first bob")] = 0.8
    mass2: Annotated[float, Param("kg", 0.05, 2.0, "second bob")] = 0.5
    density: Annotated[float, Param("kg/m³", 1000.0, 12000.0, "of both bobs")] = 2500.0
    angle1: Annotated[float, Param("rad", -pi, pi, "first rod from the downward vertical")] = 2.0
    angle2: Annotated[float, Param("rad", -pi, pi, "second rod from the downward vertical")] = 2.4
    twin: Annotated[Literal["absent", "beside"], Choice("a second one behind, released `offset` further")] = "absent"
    offset: Annotated[float, Param("rad", 1e-7, 1e-2, "of the twin's first rod")] = 1e-3

    @property
    def radii(self) -> tuple[float, float]:
        """Of the bobs [m]."""
        first, second = ((3 * m / (4 * pi * self.density)) ** (1 / 3) for m in (self.mass1, self.mass2))
        return first, second

    @property
    def lagrangian(self) -> Lagrangian:
        """The equations of motion of this specimen, in closed form."""
        (r1, r2), (m1, m2), (l1, l2) = self.radii, (self.mass1, self.mass2), (self.length1, self.length2)
        return Lagrangian(
            a=(m1 + m2) * l1**2 + 2 / 5 * m1 * r1**2, b=m2 * (l2**2 + 2 / 5 * r2**2), c=m2 * l1 * l2,
            u=(m1 + m2) * g * l1, w=m2 * g * l2,
        )  # fmt: skip

    @property
    def tau(self) -> float:
        """√(ℓ/g) of the shorter rod [s]: makes angular velocities comparable with angles."""
        return sqrt(min(self.length1, self.length2) / g)

    def build(self, scene: Scene) -> None:
        """A post, an axle, two rods with bobs; perhaps the same again behind it."""
        upright = max(-cos(self.angle1), -cos(self.angle2)) > 0
        lean = max(abs(sin(self.angle1)), abs(sin(self.angle2)))
        if upright and lean < 1e-3:
            raise Refusal("R12", f"angle1 = {self.angle1:.6g}, angle2 = {self.angle2:.6g} rad: an unstable equilibrium "
                          "that is left by rounding errors; allowed: one of the two 0.001 rad or more off")  # fmt: skip
        pendula = [("double_pendulum", 0.0)]
        if self.twin == "beside":
            pendula.append(("twin", self.offset))
        for row, (name, offset) in enumerate(pendula):
            self._hang(scene, name, row, self.angle1 + offset)
        # a heavy lower bob makes the elbow quick, and quicker under the pull of a wide swing: (3 - 2 cos θ) m g for one
        fast = self.lagrangian.modes()[1][0] * (5 - 2 * cos(self.angle1) - 2 * cos(self.angle2))
        scene.resolve(time=1 / sqrt(fast), length=min(self.radii), duration=10.0)

    def _hang(self, scene: Scene, name: str, row: int, angle1: float) -> None:
        part = scene.add("double_pendulum", name)
        (r1, r2), (l1, l2) = self.radii, (self.length1, self.length2)
        front, back = max(r1, r2) + 0.015, max(r1, 0.03) + 0.05
        height = l1 + l2 + r2 + 0.12
        part.body("stand").pos = (0, row * (front + back + 2 * r2 + 0.12), height)
        part.geom("axle").fromto = (0, -0.015, 0, 0, back, 0)
        part.geom("post").pos, part.geom("post").size[2] = (0, back, 0.02 - height / 2), height / 2 + 0.02
        part.geom("foot").pos = (0, back, 0.015 - height)
        part.body("upper").pos[2] = -l1
        part.joint("shoulder").pos[2] = l1
        part.geom("arm").fromto = (0, 0, 0, 0, 0, l1)
        part.geom("pin").fromto = (0, 0, 0, 0, -front - 0.01, 0)
        part.geom("elbow_bob").size[0], part.geom("elbow_bob").mass = r1, self.mass1
        part.body("lower").pos = (0, -front, -l2)
        part.joint("elbow").pos[2] = l2
        part.geom("forearm").fromto = (0, 0, 0, 0, 0, l2)
        part.geom("end_bob").size[0], part.geom("end_bob").mass = r2, self.mass2
        if row:
            part.geom("elbow_bob").material, part.geom("end_bob").material = part.name("orange"), part.name("teal")
        scene.material(part.name("stand"), 7800.0, Surface(friction=0.4, restitution=0.5))
        for bob in ("upper", "lower"):
            scene.material(part.name(bob), self.density, Surface(friction=0.4, restitution=0.5))
        scene.start[part.name("shoulder")] = angle1
        scene.start[part.name("elbow")] = self.angle2 - angle1

    def state(self, run: Run, name: str = "double_pendulum") -> Array:
        """(θ₁, θ₂, θ₁', θ₂') over time (4, T), angles from the vertical."""
        q1, v1 = run.joint(f"{name}/shoulder"), run.joint_speed(f"{name}/shoulder")
        return np.array([q1, q1 + run.joint(f"{name}/elbow"), v1, v1 + run.joint_speed(f"{name}/elbow")])

    def oracle(self, run: Run) -> tuple[Array, Array]:
        """The motion (4, n) by the equations of Lagrange at the run's first samples, and the tangent map (4, 4, n)."""
        return _solved(self, len(run), float(run.t[1]))

    @observable("rad")
    def angles(self, run: Run) -> Array:
        """Both rods from the downward vertical (T, 2)."""
        return self.state(run)[:2].T

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic and potential energy of both bobs, from their lowest places."""
        upper, lower = run.position("double_pendulum/upper"), run.position("double_pendulum/lower")
        high = 0.12 + self.radii[1]
        potential = g * (self.mass1 * (upper[:, 2] - high - self.length2) + self.mass2 * (lower[:, 2] - high))
        return run.kinetic("double_pendulum/upper") + run.kinetic("double_pendulum/lower") + potential

    @law(
        "Lagrange's equations, L = T - V",
        source="Landau & Lifshitz, Mechanics, §5 problem 1",
        within=(1e-3, 1e-5, 1e-8),
        unit="rad",
    )
    def motion_is_lagranges(self, run: Run) -> Measurement:
        """47a: both angles, until chaos has magnified any error a thousandfold."""
        expected, tangent = self.oracle(run)
        end = int(np.sum(magnified(tangent) <= HORIZON))
        return self.state(run)[:2, :end], expected[:2, :end]

    @law("E = E₀", source="Landau & Lifshitz, Mechanics, §6", within=(5e-5, 2e-7, 1e-9))
    def energy_is_constant(self, run: Run) -> Measurement:
        """47b: over the whole record, chaotic or not; relative to the largest kinetic energy there can be."""
        energy, form = self.energy(run), self.lagrangian
        start = form.u * (1 - cos(self.angle1)) + form.w * (1 - cos(self.angle2))
        return energy / start, np.ones(len(run))

    @law("det(K - ω² M) = 0", source="Landau & Lifshitz, Mechanics, §23 problem 2", within=(2e-8, 5e-9, 5e-9),
         limited_by="amplitude 0.01 mrad: the equations are linear to its square")  # fmt: skip
    def small_swings_have_two_tones(self, run: Run) -> Measurement:
        """47c: angular frequencies of twins released in each normal mode; equal and point-like, ω² = (2 ∓ √2) g/ℓ."""
        measured, expected = [], []
        for square, shape in self.lagrangian.modes():
            first, second = -1e-5 * shape / np.abs(shape).max()
            twin = run.again(angle1=float(first), angle2=float(second), twin="absent")
            q1, _, v1, _ = self.state(twin)
            measured.append((2 * pi / period(twin.t, q1, v1)) / sqrt(square))
            expected.append(1.0)
        return measured, expected

    @law("ln(δ/δ₀) ≈ λ t", source="Strogatz, Nonlinear Dynamics and Chaos, §9.3", within=(1e-2, 5e-3, 5e-3),
         limited_by="the twins' separation is finite: linear only to its own size")  # fmt: skip
    def twins_part_exponentially(self, run: Run) -> Measurement:
        """47d: slope of the logarithm of a tiny separation, against the linearised equations' (λ of finite time)."""
        _, tangent = self.oracle(run)
        linear = np.log(np.linalg.norm(tangent[:, 0], axis=0))
        if linear.max() < log(100):
            raise NotEvaluated(f"a separation grows {np.exp(linear.max()):.3g}-fold in {run.t[-1]:.3g} s: not chaotic")
        end = len(linear)
        both = run.again(twin="beside", offset=OFFSET)
        apart = (self.state(both, "twin") - self.state(both)) / OFFSET * np.array([1, 1, self.tau, self.tau])[:, None]
        grown = np.log(np.linalg.norm(apart[:, :end], axis=0))
        slopes = [float(fit(run.t[:end], x, 1)[1]) for x in (grown, linear)]
        return slopes[0], slopes[1]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        growth = magnified(self.oracle(run)[1])
        fate = (
            f"The motion is chaotic: a slight change of the start grows a thousandfold in "
            f"{run.t[np.argmax(growth > HORIZON)]:.1f} s"
            if growth.max() > HORIZON
            else "The two swing regularly, passing energy to and fro"
        )
        pair = ", with a twin behind it released almost alike" if self.twin == "beside" else ""
        return (
            f"A red ball of {self.mass1:.2g} kg hangs from an axle on a {self.length1:.2f} m rod, and a blue ball of "
            f"{self.mass2:.2g} kg from the red one on a {self.length2:.2f} m rod{pair}. Released at rest "
            f"{abs(np.degrees(self.angle1)):.0f} and {abs(np.degrees(self.angle2)):.0f} degrees from the vertical, "
            f"they fall and whirl under gravity alone. {fate}; their total energy stays the same throughout."
        )


@functools.lru_cache(maxsize=4)
def _solved(specimen: DoublePendulum, count: int, step: float) -> tuple[Array, Array]:
    return specimen.lagrangian.solve(
        specimen.angle1, specimen.angle2, specimen.tau, step * np.arange(count, dtype=float)
    )
