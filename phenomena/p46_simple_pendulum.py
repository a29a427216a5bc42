from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson
from scipy.special import ellipk

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import peaks, period
from physinone_mj.run import Run
from physinone_mj.scene import Scene


class SimplePendulum(Phenomenon, domain="mechanics"):
    """Objects swing: the wider the swing, the longer the period."""

    length: Annotated[float, Param("m", 0.2, 2.0, "pivot to the bob's centre")] = 1.0
    radius: Annotated[float, Param("m", 0.02, 0.09, "bob")] = 0.07
    mass: Annotated[float, Param("kg", 0.05, 20.0, "bob")] = 0.5
    angle: Annotated[float, Param("rad", 0.0873, 2.967, "release from the vertical")] = 1.0
    damping: Annotated[float, Param("N m s/rad", 0.0, 0.1, "friction of the pivot")] = 0.0
    swing: Annotated[Literal["planar", "conical"], Choice("to and fro on a hinge, or round on a ball joint")] = "planar"

    @property
    def inertia(self) -> float:
        """About the pivot [kg m²]: a solid sphere on a massless rod."""
        return self.mass * (self.length**2 + 2 / 5 * self.radius**2)

    def build(self, scene: Scene) -> None:
        """A gallows, a massless rod, a bob."""
        part = scene.add("pendulum")
        height = self.length + self.radius + 0.15 if self.angle < pi / 2 else self.length * 1.15 + self.radius + 0.1
        width = 0.12 + 2.2 * self.radius + (self.length * sin(min(self.angle, pi / 2)) if self.swing == "conical" else 0)
        part.body("frame").pos[2] = height
        part.geom("beam").fromto = (0, -width, 0, 0, width, 0)
        part.geom("left").fromto = (0, -width, 0, 0, -width, -height)
        part.geom("right").fromto = (0, width, 0, 0, width, -height)
        part.body("bob").pos[2] = -self.length
        part.geom("rod").fromto = (0, 0, 0, 0, 0, self.length)
        part.geom("ball").size[0], part.geom("ball").mass = self.radius, self.mass
        part.site("pivot").pos[2] = self.length
        hinge = part.joint("hinge")
        hinge.pos[2], hinge.damping = self.length, [self.damping, 0, 0]
        density = self.mass / (4 / 3 * pi * self.radius**3)
        scene.material(part.name("bob"), density, Surface(friction=0.4, restitution=0.5))
        if self.swing == "planar":
            scene.start[part.name("hinge")] = self.angle
        else:
            import mujoco

            hinge.type = mujoco.mjtJoint.mjJNT_BALL
            scene.start[part.name("hinge")] = (cos(self.angle / 2), 0, -sin(self.angle / 2), 0)
            turn = sqrt(g / (self.length * abs(cos(self.angle))))
            # in the bob's axes: the whole body turns about the vertical
            scene.speed[part.name("hinge")] = (turn * sin(self.angle), 0, turn * cos(self.angle))
        time = sqrt(self.length / g)
        scene.resolve(time=time, length=self.radius, duration=max(5.0, 12 * pi * time))

    @observable("rad")
    def swing_angle(self, run: Run) -> NDArray[np.float64]:
        """Angle of the rod from the vertical; signed for a planar swing."""
        if self.swing == "planar":
            return run.joint("pendulum/hinge")
        arm = run.position("pendulum/bob") - self.pivot(run)
        return np.asarray(np.arccos(np.clip(-arm[:, 2] / self.length, -1, 1)))

    @observable("J")
    def energy(self, run: Run) -> NDArray[np.float64]:
        """Kinetic and potential energy together, from the lowest point."""
        height = run.position("pendulum/bob")[:, 2] - self.pivot(run)[2] + self.length
        return run.kinetic("pendulum/bob") + self.mass * g * height

    def pivot(self, run: Run) -> NDArray[np.float64]:
        """Where the rod hangs (3,) [m]."""
        return np.asarray(run.motion.origin[0, run.model.body("pendulum/frame").id])

    def planar(self, *, undamped: bool = False) -> None:
        """Laws of the planar swing are not evaluated elsewhere."""
        if self.swing != "planar":
            raise NotEvaluated("the swing is conical")
        if undamped and self.damping > 0:
            raise NotEvaluated("the pivot has friction")

    @law("T = 4 √(I/(m g ℓ)) K(sin² θ₀/2)", source="Landau & Lifshitz, Mechanics, §11 problem 1", within=(1e-7, 5e-11, 1e-12))
    def period_grows_with_amplitude(self, run: Run) -> Measurement:
        """46a: the exact period, from elliptic integrals."""
        self.planar(undamped=True)
        measured = period(run.t, run.joint("pendulum/hinge"), run.joint_speed("pendulum/hinge"))
        small = sqrt(self.inertia / (self.mass * g * self.length))
        return measured, 4 * small * ellipk(sin(self.angle / 2) ** 2)

    @law("E + c ∫ θ̇² dt = E₀", source="Landau & Lifshitz, Mechanics, §25 eq. 25.13", within=(1e-6, 1e-9, 1e-11))
    def energy_goes_only_into_the_pivot(self, run: Run) -> Measurement:
        """46b: exact at any amplitude; without friction, energy is constant."""
        if self.swing == "conical":
            return self.energy(run) / self.energy(run)[0], np.ones(len(run))
        rate = run.joint_speed("pendulum/hinge")
        lost = np.array([simpson(rate[: i + 1] ** 2, dx=run.t[1]) for i in range(0, len(run), run.stride)])
        kept = self.energy(run)[:: run.stride]
        return (kept + self.damping * lost) / kept[0], np.ones(len(kept))

    @law("ln(θₙ/θₙ₊₁) = c T/(2 I)", source="Landau & Lifshitz, Mechanics, §25 eq. 25.4", within=(5e-3, 1e-3, 1e-3),
         limited_by="the formula is that of small swings: its error is θ²/16")  # fmt: skip
    def friction_shrinks_every_swing_alike(self, run: Run) -> Measurement:
        """46b: logarithmic decrement, on a twin released at 5° with friction enough to lose 3 % a swing."""
        self.planar()
        low = self.declarations()["angle"][0].low  # type: ignore[union-attr]
        damping = min(0.03 * self.inertia / pi * sqrt(self.mass * g * self.length / self.inertia), 0.1)
        twin = run.again(angle=low, damping=damping)
        angle, rate = twin.joint("pendulum/hinge"), twin.joint_speed("pendulum/hinge")
        times, heights = peaks(twin.t, angle, rate)
        return np.log(heights[:-1] / heights[1:]).mean(), damping * np.diff(times).mean() / (2 * self.inertia)

    @law("T(4 m) = T(m)", source="Landau & Lifshitz, Mechanics, §10 eq. 10.3", within=(1e-7, 1e-10, 1e-12))
    def period_ignores_the_mass(self, run: Run) -> Measurement:
        """46c: a bob four times as heavy keeps time with this one."""
        self.planar(undamped=True)
        heavy = run.again(mass=min(4 * self.mass, 20.0) if self.mass < 20 else 5.0)
        both = [period(r.t, r.joint("pendulum/hinge"), r.joint_speed("pendulum/hinge")) for r in (heavy, run)]
        return both[0], both[1]

    @law("N = m g + m ℓ θ̇², θ̇² = 2 m g ℓ (1 - cos θ₀)/I", source="Landau & Lifshitz, Mechanics, §5", within=(1e-6, 1e-8, 1e-10))
    def rod_pulls_hardest_at_the_bottom(self, run: Run) -> Measurement:
        """46d: tension at the lowest point, mg + m ℓ θ̇² with θ̇² = 2 m g ℓ (1 - cos θ₀)/I."""
        self.planar(undamped=True)
        pull = np.linalg.norm(run.sensor("pendulum/tension"), axis=1)
        angle = run.joint("pendulum/hinge")
        # the rod's pull as a function of angle is even; its value at θ = 0 by a parabola through the lowest samples
        low = np.argsort(np.abs(angle))[:9]
        bottom = np.polynomial.Polynomial.fit(angle[low] ** 2, pull[low], 2)(0.0)
        speed2 = 2 * self.mass * g * self.length * (1 - cos(self.angle)) / self.inertia
        return bottom, self.mass * (g + self.length * speed2)

    @law("Ω = √(g/(ℓ cos θ))", source="Landau & Lifshitz, Mechanics, §14 problem 1", within=(1e-6, 1e-9, 1e-11))
    def round_swing_turns_faster_when_wider(self, run: Run) -> Measurement:
        """46e: angular speed of the conical pendulum about the vertical (a twin, if this one swings in a plane)."""
        angle = min(self.angle, 1.2)
        round_ = run if self.swing == "conical" else run.again(swing="conical", angle=angle, damping=0.0)
        if round_.specimen.damping > 0:
            raise NotEvaluated("the pivot has friction")
        arm = round_.position("pendulum/bob") - self.pivot(round_)
        turned = np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
        rate = (turned[-1] - turned[0]) / (round_.t[-1] - round_.t[0])
        return rate, sqrt(g / (self.length * cos(round_.specimen.angle)))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        turns = "swings to and fro" if self.swing == "planar" else "circles steadily below the pivot"
        return (
            f"A red ball of {self.mass:.2g} kg hangs on a {self.length:.2f} m rod from a wooden frame and is released "
            f"{np.degrees(self.angle):.0f} degrees from the vertical. Under gravity alone it {turns}, trading potential "
            f"for kinetic energy: fastest at the lowest point, still for an instant at the ends. The period grows with "
            f"the width of the swing and does not depend on the mass."
        )
