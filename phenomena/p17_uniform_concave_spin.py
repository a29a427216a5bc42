"""17: balls and a cube in a glass bowl that turns evenly."""

from __future__ import annotations

from math import cos, inf, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipk

from phenomena.bowls import (
    HINGE,
    SOLID,
    Cube,
    Rolling,
    bowl,
    centre,
    place_ball,
    place_cube,
    polar,
    ridden_angle,
    rolling_state,
    start_ball,
    start_cube,
)
from phenomena.spins import Course, azimuth, drift
from phenomena.turntables import arena
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import crossings, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

BALL: Final = "ball/ball"
CUBE: Final = "cube/block"
LOW: Final = "bottom/ball"

RATIOS: Final = (1.2, 1.5, 1.9, 2.3, 2.8)
"""Spins at which the riding ball's place is measured, in units of √(g/R_e)."""

FOLLOWED: Final = 1.5
"""How long a rolling ball is followed [s]."""

HELD: Final = 0.8
"""How long a ball or cube alone that rides is watched [s]."""

MARGINS: Final = (1e-2, 5e-3, 3e-3)
"""The cube must hold at a spin this much within the critical one and slip at one as much beyond (of the spin), at the
three fidelities."""

SLIPPED: Final = (3e-3, 1e-3, 5e-4)
"""Change of the cube's polar angle that is no creep, at the three fidelities [rad]."""

WIDEST: Final = 1.05
"""A ball let go higher than this may slip at first [rad]."""


class UniformConcaveSpin(Phenomenon, domain="mechanics"):
    """Objects in an evenly turning bowl: they ride round where the wall is as steep as they need it, roll or slip."""

    cargo: Annotated[
        Literal["all", "rider", "ball", "cube"],
        Choice("what is in the bowl: all; one ball turning with it; one let go at rest; a cube turning with it"),
    ] = "all"
    radius: Annotated[float, Param("m", 0.15, 0.5, "of the bowl, inside")] = 0.3
    size: Annotated[float, Param("m", 0.01, 0.05, "radius of the balls")] = 0.03
    edge: Annotated[float, Param("1", 0.05, 0.1, "of the cube, in radii of the bowl")] = 0.1
    ratio: Annotated[float, Param("1", 0.0, 3.0, "spin of the bowl in units of √(g/R_e)")] = 1.5
    friction: Annotated[float, Param("1", 0.0, 0.9, "of bowl, balls and cube")] = 0.6
    angle: Annotated[float, Param("rad", 0.0, 1.396, "of the cube, or the ball let go, from the bottom")] = 0.7
    density: Annotated[float, Param("kg/m³", 300.0, 8000.0, "of balls and cube")] = 1200.0

    @property
    def reach(self) -> float:
        """R_e: from the bowl's centre to a ball's [m]."""
        return self.radius - self.size

    @property
    def unit(self) -> float:
        """√(g/R_e) [rad/s]."""
        return sqrt(g / self.reach)

    @property
    def spin(self) -> float:
        """Of the bowl [rad/s]."""
        return self.ratio * self.unit

    @property
    def cube(self) -> Cube:
        """On its corners."""
        return Cube(self.radius, self.edge * self.radius / 2)

    @property
    def rides_at(self) -> float:
        """Polar angle of the riding ball [rad]."""
        return ridden_angle(self.radius, self.size, self.spin)

    @property
    def lonely(self) -> bool:
        """Whether the bottom is free for a third ball."""
        ball, cube = self.reach * sin(self.rides_at), self.cube.reach * sin(self.angle)
        return ball > 2.5 * self.size and cube > 1.5 * self.size + 2 * self.cube.half

    def build(self, scene: Scene) -> None:
        """The bowl in its court and what is in it."""
        surface = Surface(friction=self.friction, restitution=0.3)
        arena(scene, self.radius + 0.25, 0.1)
        bowl(scene, self.radius, pi / 2, Course(self.spin, self.spin), surface)
        if self.cargo in ("all", "rider", "ball"):
            part = place_ball(scene, "ball", self.size, self.density, surface, (0.93, 0.55, 0.20))
            riding = self.cargo != "ball"
            where = (self.rides_at if riding else self.angle, 0.0)
            start_ball(scene, part.name("free"), self.radius, self.size, where, self.spin, riding=riding)
        if self.cargo in ("all", "cube"):
            part = place_cube(scene, "cube", self.cube.half, self.density, surface, (0.84, 0.27, 0.22))
            start_cube(scene, part.name("free"), self.radius, self.cube.half, (self.angle, pi), self.spin)
        if self.cargo == "all":
            self._check_room()
            if self.lonely:
                part = place_ball(scene, "bottom", self.size, self.density, surface, (0.17, 0.58, 0.62))
                start_ball(scene, part.name("free"), self.radius, self.size, (0.0, 0.0), 0.0, riding=False)
                scene.touch(BALL, CUBE, LOW)
            else:
                scene.touch(BALL, CUBE)
        watched = {"all": 5.0, "ball": 3.0}.get(self.cargo, HELD)
        # a cube holds by its corners, which turn with the bowl
        turns = {"cube": 0.75, "ball": 2.0}.get(self.cargo, 4.0)
        scene.resolve(time=min(2.2 / self.unit, turns / max(self.spin, 1e-3)), length=self.size, duration=watched)

    def _check_room(self) -> None:
        apart = self.reach * sin(self.rides_at) + self.cube.reach * sin(self.angle)
        needed = self.size + 2 * self.cube.half
        if apart < needed:
            raise Refusal("R1", f"angle = {self.angle:.4g} rad: cube and ball overlap near the bottom; allowed with "
                          f"cargo = all: {np.arcsin(min(needed / self.cube.reach, 1.0)):.3g} rad or more")  # fmt: skip

    @observable("rad")
    def polar_angles(self, run: Run) -> Array:
        """Of what is in the bowl, from the bottom (T, n)."""
        return np.column_stack([polar(run, body, self.radius) for body in self.bodies(run)])

    @observable("rad")
    def azimuths(self, run: Run) -> Array:
        """Of what is in the bowl, about its axis (T, n)."""
        return np.column_stack([azimuth(run, body) for body in self.bodies(run)])

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """Horizontal velocities of the centres relative to axes that turn with the bowl (T, n, 2)."""
        return np.stack([drift(run, body, HINGE) for body in self.bodies(run)], axis=1)

    def bodies(self, run: Run) -> list[str]:
        """What is in the bowl."""
        return [body for body in (BALL, CUBE, LOW) if body in run.bodies()]

    @law("cos θ = g/(Ω² R_e), or θ = 0", source="Goldstein, Classical Mechanics, 3rd ed., §2 problem 18",
         within=(1e-3, 1e-4, 1e-5))  # fmt: skip
    def ball_rides_where_the_wall_carries_it(self, run: Run) -> Measurement:
        """17a: polar angle of a ball that turns with the bowl, at five spins and mean over each run."""
        twins = [run.again(cargo="rider", ratio=ratio) for ratio in RATIOS]
        measured = [polar(twin, BALL, self.radius).mean() for twin in twins]
        return measured, [ridden_angle(self.radius, self.size, ratio * self.unit) for ratio in RATIOS]

    def critical(self, sign: int) -> float:
        """Spin at which the cube is about to slip down (sign 1) or up (-1), in units of √(g/R_e)."""
        grip = sign * self.cube.grip(self.friction)
        if self.cube.tips(self.friction) > 0.98:
            raise NotEvaluated("the cube tips over before it slips")
        down, into = sin(self.angle) - grip * cos(self.angle), cos(self.angle) + grip * sin(self.angle)
        square = down / into * g / (self.cube.reach * sin(self.angle)) if self.angle > 0 and into > 0 else -1.0
        low, high = (getattr(self.declarations()["ratio"][0], end) for end in ("low", "high"))
        ratio = sqrt(square) / self.unit if square > 0 else 0.0
        if not low + 0.02 < ratio < high * (1 - MARGINS[0]):
            raise NotEvaluated(f"the cube does not begin to slip {'down' if sign > 0 else 'up'} at any spin up to "
                               f"{high:g} √(g/R_e)")  # fmt: skip
        return ratio

    def slides(self, sign: int, margin: float) -> float:
        """How far the cube slides at a spin beyond the critical one by this fraction before it holds again [rad].

        Its friction is constant: it swings once through the angle at which the forces would balance.
        """
        spin = self.critical(sign) * self.unit * (1 - sign * margin)
        at, ahead = (
            sign * self.cube.along(angle, spin) - self.cube.grip(self.friction) * self.cube.into(angle, spin)
            for angle in (self.angle, self.angle - sign * 1e-6)
        )
        return 2 * at * 1e-6 / (at - ahead) if at > ahead else inf

    @law("|g sin θ - Ω² ρ cos θ| ≤ μ' (g cos θ + Ω² ρ sin θ)", source="Coulomb's law; Goldstein, Classical Mechanics, "
         "3rd ed., §4.10; μ' → μ for a small cube: statics on four corners, bowls.Cube.grip",
         within=(1.01e-2, 5.1e-3, 3.1e-3), limited_by="a bracket: it holds within, slips as far beyond")  # fmt: skip
    def cube_holds_between_two_spins(self, run: Run) -> Measurement:
        """17b: the least spin, below which it slips down, and the greatest, above which it slips up."""

        def moves(ratio: float, sign: int) -> bool:
            theta = polar(run.again(cargo="cube", ratio=ratio), CUBE, self.radius)
            return bool((sign * (theta[0] - theta)).max() > SLIPPED[run.fidelity.rank])

        margin, enough = MARGINS[run.fidelity.rank], 1.5 * SLIPPED[run.fidelity.rank]
        found: list[float] = []
        expected: list[float] = []
        for sign in (1, -1):
            try:
                ratio = self.critical(sign)
                if self.slides(sign, margin) < enough:
                    raise NotEvaluated(f"beyond that spin by {margin:g} of it the cube slides by "
                                       f"{self.slides(sign, margin):.2g} rad; needed: {enough:g} rad")  # fmt: skip
            except NotEvaluated:
                if sign == -1 and not found:
                    raise
                continue
            goes = (lambda x: not moves(x, 1)) if sign == 1 else (lambda x: moves(x, -1))
            found.append(threshold(goes, ratio, spread=margin, resolution=2 * margin))
            expected.append(ratio)
        return np.divide(found, expected), np.ones(len(found))

    def swing_time(self, run: Run) -> float:
        """Period of a ball to and fro through the bottom [s]: twice the mean time between passages."""
        x, v = run.position(BALL)[:, 0], run.velocity(BALL)[:, 0]
        times = np.sort(np.concatenate([crossings(run.t, x, v, rising=up) for up in (True, False)]))
        if len(times) < 3:
            raise NotEvaluated(f"{len(times)} passages of the bottom recorded; needed: 3")
        return float(2 * (times[-1] - times[0]) / (len(times) - 1))

    def pendulum_time(self, angle: float) -> float:
        """Period of a ball that slides to and fro without friction [s]."""
        return float(4 / self.unit * ellipk(sin(angle / 2) ** 2))

    @property
    def swing(self) -> float:
        """From where the ball is let go in the twins that swing [rad]."""
        return min(max(self.angle, 0.2), WIDEST)

    @law("T = √(7/5) 4 √(R_e/g) K(sin² θ₀/2)", source="Landau & Lifshitz, Mechanics, §11 problem 1 and §32 problem 6",
         within=(2e-4, 2e-5, 3e-6))  # fmt: skip
    def ball_rolls_to_and_fro_in_a_bowl_at_rest(self, run: Run) -> Measurement:
        """17c: a rolling ball takes √(7/5) of a sliding one's time."""
        friction = max(self.friction, 1.2 * tan(self.swing) / (1 + 1 / SOLID))
        twin = run.again(cargo="ball", ratio=0.0, angle=self.swing, friction=min(friction, 0.9))
        return self.swing_time(twin), sqrt(1 + SOLID) * self.pendulum_time(self.swing)

    @law("T = 4 √(R_e/g) K(sin² θ₀/2), y = 0 whatever Ω", source="Landau & Lifshitz, Mechanics, §11 problem 1",
         within=(2e-4, 2e-5, 3e-6))  # fmt: skip
    def smooth_ball_ignores_the_spin(self, run: Run) -> Measurement:
        """17c: without friction the ball swings in its plane as in a bowl at rest."""
        twin = run.again(cargo="ball", friction=0.0, angle=self.swing)
        aside = np.abs(twin.position(BALL)[:, 1]).max() / self.reach
        return [self.swing_time(twin) / self.pendulum_time(self.swing), aside], [1.0, 0.0]

    @law("(1 + 1/k) F/m = P [Ω R ẑ×ṅ - r ω×ṅ - g], R_e n̈ = F/m + P g - R_e |ṅ|² n, ω̇ = n × F/(k m r)",
         source="Neimark & Fufaev, Dynamics of Nonholonomic Systems (1972), ch. 1: rolling condition with Euler's laws",
         within=(4e-3, 4e-4, 4e-5))  # fmt: skip
    def ball_rolls_as_the_bowl_drags_it(self, run: Run) -> Measurement:
        """17d: way of a ball that rolls without slipping, over 1.5 s, against the integrated equations."""
        twin = run.again(cargo="ball", angle=self.swing, friction=0.9)
        some = twin.t <= FOLLOWED
        course = Course(self.spin, self.spin)
        rolling = Rolling(course, self.radius, self.size)
        n, needed = rolling.way(rolling_state(twin, BALL, self.radius, self.size), twin.t[some])
        if needed > 0.88:
            raise NotEvaluated(f"the ball would need friction of {needed:.2g}")
        return (twin.position(BALL)[some] - centre(self.radius)) / self.reach, n

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        said = [f"A glass bowl of {self.radius:.2f} m radius turns evenly about its axis at {self.spin:.1f} rad/s."]
        if self.cargo in ("all", "rider"):
            said.append(
                f"An orange ball rides round with it {np.degrees(self.rides_at):.0f} degrees up the wall, where the "
                "wall's push alone can carry and turn it."
                if self.rides_at > 0
                else "An orange ball turns on the spot at the bottom, for the spin is too slow to drive it up the wall."
            )
        if self.cargo == "ball":
            said.append(
                f"An orange ball is let go {np.degrees(self.angle):.0f} degrees up the wall. Gravity pulls it down and "
                f"friction of {self.friction:.2f} drags it round, so that it loops about the bottom."
            )
        if self.cargo in ("all", "cube"):
            moved = np.degrees(np.ptp(polar(run, CUBE, self.radius)))
            said.append(
                f"A red cube {np.degrees(self.angle):.0f} degrees up {'is held' if moved < 0.1 else 'is not held'} by "
                f"friction of {self.friction:.2f}{'' if moved < 0.1 else f' and slips through {moved:.0f} degrees'}."
            )
        if LOW in run.bodies():
            said.append("A teal ball stays at the bottom, where the turning glass slides away under it.")
        said.append(
            f"So it goes on for {run.t[-1]:.0f} s, the balance of weight, wall and friction deciding who stays."
        )
        return " ".join(said)
