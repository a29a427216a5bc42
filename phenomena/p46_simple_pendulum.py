"""46: a pendulum, swinging in a plane, round a cone or round an ellipse."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Annotated, Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.special import ellipk

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import crossings, peaks, value
from physinone_mj.run import Run
from physinone_mj.scene import Scene

WIDEST_ROUND = 80 * pi / 180
"""A round swing is slower to resolve the wider it is, and at 90° it would be infinitely fast [rad]."""

SIDEWAYS = 0.5
"""Speed of an elliptic swing where it starts, as a fraction of a round one's."""


class SimplePendulum(Phenomenon, domain="mechanics"):
    """Objects swing: the wider the swing, the longer the period."""

    length: Annotated[float, Param("m", 0.2, 2.0, "pivot to the bob's centre")] = 1.0
    radius: Annotated[float, Param("m", 0.02, 0.09, "bob")] = 0.07
    mass: Annotated[float, Param("kg", 0.05, 20.0, "bob")] = 0.5
    angle: Annotated[float, Param("rad", 0.0873, 2.967, "release from the vertical")] = 1.0
    damping: Annotated[float, Param("N m s/rad", 0.0, 0.1, "friction of the pivot")] = 0.0
    swing: Annotated[Literal["planar", "conical", "elliptic"], Choice("on a hinge, or on a ball joint")] = "planar"

    @property
    def inertia(self) -> float:
        """About the pivot [kg m²]: a solid sphere on a massless rod."""
        return self.mass * (self.length**2 + 2 / 5 * self.radius**2)

    @property
    def small(self) -> float:
        """Angular frequency of small swings [rad/s]."""
        return sqrt(self.mass * g * self.length / self.inertia)

    @property
    def turn(self) -> float:
        """Angular velocity of the round swing about the vertical [rad/s].

        The bob turns with its rod, and being a sphere has one moment of inertia about the rod and across it: its own
        rotation adds nothing to the torque that the turning needs, which is that of a point mass.
        """
        return sqrt(g / (self.length * cos(self.angle)))

    def build(self, scene: Scene) -> None:
        """A gallows, a massless rod, a bob."""
        if self.swing != "planar" and self.angle > WIDEST_ROUND:
            raise Refusal("R12", f"angle = {self.angle:.4g} rad: going round ({self.swing}) is infinitely fast at 90°; "
                          f"allowed: up to {WIDEST_ROUND:.4g} rad (80°)")  # fmt: skip
        part = scene.add("pendulum")
        height = self.length + self.radius + 0.15
        width = 0.12 + 2.2 * self.radius + (self.length * sin(self.angle) if self.swing != "planar" else 0)
        part.body("frame").pos[2] = height
        part.geom("beam").fromto = (0, -width, 0, 0, width, 0)
        part.geom("left").fromto = (0, -width, 0, 0, -width, -height)
        part.geom("right").fromto = (0, width, 0, 0, width, -height)
        for foot, side in (("left_foot", -width), ("right_foot", width)):
            part.geom(foot).pos, part.geom(foot).size[0] = (0, side, 0.02 - height), 0.12 + 0.15 * self.length
        part.body("bob").pos[2] = -self.length
        part.geom("rod").fromto = (0, 0, 0, 0, 0, self.length)
        part.geom("ball").size[0], part.geom("ball").mass = self.radius, self.mass
        part.site("pivot").pos[2] = self.length
        hinge = part.joint("hinge")
        hinge.pos[2], hinge.damping = self.length, [self.damping, 0, 0]
        density = self.mass / (4 / 3 * pi * self.radius**3)
        scene.material(part.name("bob"), density, Surface(friction=0.4, restitution=0.5))
        scene.material(part.name("frame"), 700.0, Surface(friction=0.4, restitution=0.4))
        if self.swing == "planar":
            scene.start[part.name("hinge")] = self.angle
        else:
            import mujoco

            hinge.type = mujoco.mjtJoint.mjJNT_BALL
            scene.start[part.name("hinge")] = (cos(self.angle / 2), 0, -sin(self.angle / 2), 0)
            # in the bob's axes: the round swing turns as a whole about the vertical; the elliptic one, for which the
            # spherical pendulum's equations hold if it has no spin about its rod, starts across
            across = self.turn * sin(self.angle)
            round_, elliptic = (across, 0, self.turn * cos(self.angle)), (SIDEWAYS * across, 0, 0)
            scene.speed[part.name("hinge")] = round_ if self.swing == "conical" else elliptic
        time = sqrt(self.length / g)
        quick = min([time, *self._fast_times()])
        if quick < time / 100:
            raise Refusal("R4", f"damping = {self.damping:.3g} N m s/rad stops the bob's spin in {quick:.2g} s; "
                          f"allowed here: {self.damping * quick / (time / 100):.2g}")  # fmt: skip
        scene.resolve(time=quick, length=self.radius, duration=min(10.0, max(5.0, 12 * pi * time)))

    def _fast_times(self) -> list[float]:
        """In which a round swing turns by a radian, and in which friction stops the slightest rotation [s]."""
        least = self.inertia if self.swing == "planar" else 2 / 5 * self.mass * self.radius**2
        turning = [] if self.swing == "planar" else [1 / self.turn]
        return turning + ([least / self.damping] if self.damping else [])

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
        return np.asarray(run.kinetic("pendulum/bob") + self.mass * g * height)

    def pivot(self, run: Run) -> NDArray[np.float64]:
        """Where the rod hangs (3,) [m]."""
        return np.asarray(run.motion.origin[0, run.model.body("pendulum/frame").id])

    def as_swing(self, run: Run, swing: str) -> Run:
        """The run, if it swings so and without friction, or a twin that does (up to 1.2 rad wide if round)."""
        if self.swing == swing and not self.damping:
            return run
        return run.again(swing=swing, damping=0.0, angle=self.angle if swing == "planar" else min(self.angle, 1.2))

    def swing_time(self, run: Run) -> float:
        """The period [s]: twice the mean time between passages of the lowest point."""
        angle, rate = run.joint("pendulum/hinge"), run.joint_speed("pendulum/hinge")
        times = np.sort(np.concatenate([crossings(run.t, angle, rate, rising=up) for up in (True, False)]))
        if len(times) < 2:
            raise NotEvaluated(f"{len(times)} passages of the lowest point recorded; needed: 2")
        return float(2 * (times[-1] - times[0]) / (len(times) - 1))

    @law(
        "T = 4 √(I/(m g ℓ)) K(sin² θ₀/2)",
        source="Landau & Lifshitz, Mechanics, §11 problem 1",
        within=(2e-8, 1e-10, 1e-12),
    )
    def period_grows_with_amplitude(self, run: Run) -> Measurement:
        """46a: the exact period, from elliptic integrals."""
        return self.swing_time(self.as_swing(run, "planar")), 4 / self.small * ellipk(sin(self.angle / 2) ** 2)

    @law("E + c ∫ ω² dt = E₀", source="Landau & Lifshitz, Mechanics, §25 eq. 25.13", within=(1e-7, 2e-9, 2e-11))
    def energy_goes_only_into_the_pivot(self, run: Run) -> Measurement:
        """46b: exact at any amplitude; without friction, energy is constant."""
        rate = run.joint_speed("pendulum/hinge").reshape(len(run), -1)
        lost = make_interp_spline(run.t, np.sum(rate**2, axis=1), k=7).antiderivative()(run.t)
        energy = self.energy(run)
        return (energy + self.damping * lost) / energy[0], np.ones(len(run))

    @law("ln(θₙ/θₙ₊₁) = c T/(2 I)", source="Landau & Lifshitz, Mechanics, §25 eq. 25.4", within=(2e-3, 1e-3, 1e-3),
         limited_by="the formula is that of small swings: its error is θ²/16")  # fmt: skip
    def friction_shrinks_every_swing_alike(self, run: Run) -> Measurement:
        """46b: logarithmic decrement, on a twin released at 5° with friction enough to lose 3 % a swing."""
        low = self.declarations()["angle"][0].low  # type: ignore[union-attr]
        damping = min(0.03 * self.inertia / pi * self.small, 0.1)
        twin = run.again(swing="planar", angle=low, damping=damping)
        angle, rate = twin.joint("pendulum/hinge"), twin.joint_speed("pendulum/hinge")
        times, heights = peaks(twin.t, angle, rate)
        if len(times) < 2:
            raise NotEvaluated(f"{len(times)} widest points recorded; needed: 2")
        return np.log(heights[:-1] / heights[1:]).mean(), damping * np.diff(times).mean() / (2 * self.inertia)

    @law("T ∝ m⁰ √(I/(m ℓ))", source="Landau & Lifshitz, Mechanics, §10 eq. 10.3", within=(2e-8, 1e-10, 1e-12))
    def period_knows_length_not_mass(self, run: Run) -> Measurement:
        """46c: beside a bob four times as heavy, and one on a rod half or twice as long."""
        plain = self.as_swing(run, "planar")
        heavy = plain.again(mass=4 * self.mass if self.mass <= 5.0 else self.mass / 4)
        other = plain.again(length=2 * self.length if self.length <= 1.0 else self.length / 2)
        longer = cast(SimplePendulum, other.specimen)
        own = self.swing_time(plain)
        return [self.swing_time(heavy) / own, self.swing_time(other) / own], [1.0, self.small / longer.small]

    @law(
        "N = m g + m ℓ θ̇², θ̇² = 2 m g ℓ (1 - cos θ₀)/I",
        source="Landau & Lifshitz, Mechanics, §5",
        within=(1e-8, 1e-10, 1e-11),
    )
    def rod_pulls_hardest_at_the_bottom(self, run: Run) -> Measurement:
        """46d: tension at the lowest point, mg + m ℓ θ̇² with θ̇² = 2 m g ℓ (1 - cos θ₀)/I."""
        plain = self.as_swing(run, "planar")
        pull, angle = np.linalg.norm(plain.sensor("pendulum/tension"), axis=1), plain.joint("pendulum/hinge")
        # the rod's pull as a function of angle is even; its value at θ = 0 by a parabola through the lowest samples
        low = np.argsort(np.abs(angle))[:9]
        bottom = np.polynomial.Polynomial.fit(angle[low] ** 2, pull[low], 2)(0.0)
        speed2 = 2 * self.mass * g * self.length * (1 - cos(self.angle)) / self.inertia
        return bottom, self.mass * (g + self.length * speed2)

    @law("Ω = √(g/(ℓ cos θ))", source="Landau & Lifshitz, Mechanics, §14 problem 1", within=(1e-9, 1e-11, 1e-12))
    def round_swing_turns_faster_when_wider(self, run: Run) -> Measurement:
        """46e: angular speed of the conical pendulum about the vertical (a twin, if this one swings otherwise)."""
        round_ = self.as_swing(run, "conical")
        azimuth, _ = self.azimuth(round_)
        angle = self.angle if round_ is run else min(self.angle, 1.2)
        return (azimuth[-1] - azimuth[0]) / (round_.t[-1] - round_.t[0]), sqrt(g / (self.length * cos(angle)))

    @law(
        "ΔΦ = 2 ∫ (L_z/I)/((1 - u²) |u̇|) du",
        source="Landau & Lifshitz, Mechanics, §14 problem 1",
        within=(1e-9, 1e-11, 1e-12),
    )
    def widest_points_advance(self, run: Run) -> Measurement:
        """46e: angle between successive widest points of an elliptic swing, exact at any width (u = cos θ)."""
        ellipse = self.as_swing(run, "elliptic")
        _, advance = self.apsides(ellipse)
        start = cos(self.angle if ellipse is run else min(self.angle, 1.2))
        speed = SIDEWAYS * sqrt(g / (self.length * start)) / self.small  # of the azimuth, at the start
        energy = 0.5 * (1 - start**2) * speed**2 - start
        total, product = -energy - start, -1 + start * (energy + start)  # of the other two roots of u̇ = 0
        root = sqrt(total**2 - 4 * product)
        nearest, beyond = (total + root) / 2, (total - root) / 2
        # u = middle + half cos ψ takes the square roots out; the trapezoidal rule is exact for a periodic integrand
        psi = (np.arange(256) + 0.5) * pi / 256
        u = (nearest + start) / 2 + (nearest - start) / 2 * np.cos(psi)
        integrand = (1 - start**2) * speed / (1 - u**2) / np.sqrt(2 * (u - beyond))
        return advance, 2 * pi * integrand.mean()

    @law("Ω = (3/8) (a b/ℓ²) √(g/ℓ)", source="Olsson, Am. J. Phys. 46 (1978) 1118", within=(5e-3, 2e-3, 2e-3),
         limited_by="the formula is that of small ellipses: its error is of order (a/ℓ)²")  # fmt: skip
    def small_ellipse_precesses(self, run: Run) -> Measurement:
        """46e: on a twin 5° wide; ℓ is the reduced length I/(m ℓ) under the root, a/ℓ and b/ℓ are angles."""
        wide = self.declarations()["angle"][0].low  # type: ignore[union-attr]
        twin = run.again(swing="elliptic", angle=wide, damping=0.0)
        time, advance = self.apsides(twin)
        narrow = SIDEWAYS * sqrt(g / (self.length * cos(wide))) * sin(wide) / self.small
        return (advance - pi) / time, 3 / 8 * wide * narrow * self.small

    def azimuth(self, run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of the bob about the vertical through the pivot (T,) [rad], and its rate [rad/s]."""
        arm, speed = run.position("pendulum/bob") - self.pivot(run), run.velocity("pendulum/bob")
        swept = arm[:, 0] * speed[:, 1] - arm[:, 1] * speed[:, 0]
        return np.unwrap(np.arctan2(arm[:, 1], arm[:, 0])), swept / (arm[:, 0] ** 2 + arm[:, 1] ** 2)

    def apsides(self, run: Run) -> tuple[float, float]:
        """Mean time [s] and angle [rad] from one widest point of the swing to the next."""
        arm, speed = run.position("pendulum/bob") - self.pivot(run), run.velocity("pendulum/bob")
        flat = (arm[:, :2] ** 2).sum(axis=1), 2 * (arm[:, :2] * speed[:, :2]).sum(axis=1)
        times, _ = peaks(run.t, *flat)
        if len(times) < 2:
            raise NotEvaluated(f"{len(times)} widest points recorded; needed: 2")
        azimuth, rate = self.azimuth(run)
        first, last = (value(run.t, azimuth, rate, when) for when in (times[0], times[-1]))
        return float(times[-1] - times[0]) / (len(times) - 1), (last - first) / (len(times) - 1)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        release, motion = {
            "planar": (
                "is released",
                "swings to and fro: fastest at the lowest point, still for an instant at the ends. The wider the "
                "swing, the longer its period",
            ),
            "conical": ("is sent round", "circles steadily below its pivot. The wider the circle, the faster it turns"),
            "elliptic": (
                "is pushed sideways",
                "runs round an ellipse, fastest where it passes nearest to the middle. The ellipse itself slowly turns",
            ),
        }[self.swing]
        energy = self.energy(run)
        fate = (
            f"Friction in the pivot takes {1 - energy[-1] / energy[0]:.0%} of its energy in {run.t[-1]:.0f} s."
            if self.damping
            else "Its energy stays the same."
        )
        return (
            f"A red ball of {self.mass:.2g} kg hangs on a {self.length:.2f} m rod from a wooden frame and {release} "
            f"{np.degrees(self.angle):.0f} degrees from the vertical. Under gravity it {motion}, whatever the mass. "
            f"{fate}"
        )
