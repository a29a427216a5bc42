"""A body crosses the wind of a fan and leaves it in another direction: one component of its velocity changes."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, pi, sin, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import Box, Wind, fan
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .winds import BODIES, GRIP, HARDEST, HEIGHT, LONGEST, foam, mover, twin

Array = NDArray[np.float64]

SAMPLES = 20
"""Recorded at least within the wind, at 240 per second."""

FOOT = 0.12
"""How far the fan's feet reach along the wind [m], and LEGS across it."""

LEGS = 0.28

BEYOND = 0.7
"""From where the body leaves the wind to the pad that stops it [m]."""


@dataclass(frozen=True)
class Passage:
    """Through the wind: times (n,) since the first touch [s], places along the wind (n,) [m] and speeds along it."""

    t: Array
    x: Array
    v: Array


class WindDeflectMotion(Phenomenon, domain="mechanics"):
    """Wind applied to moving objects at an angle changes the direction of their velocity."""

    speed: Annotated[float, Param("m/s", 0.5, 5.0, "before the wind")] = 1.2
    angle: Annotated[float, Param("rad", 0.35, 2.79, "between the motion and the wind")] = pi / 2
    force: Annotated[float, Param("N", 0.02, 20.0, "of the wind at the fan")] = 1.4
    length: Annotated[float, Param("m", 0.8, 3.0, "of the wind, from the fan to its end")] = 1.6
    width: Annotated[float, Param("m", 0.2, 1.0, "of the wind")] = 0.5
    reach: Annotated[float, Param("1", 0.15, 0.7, "where its way, unbent, meets the middle of the wind")] = 0.3
    mass: Annotated[float, Param("kg", 0.05, 5.0, "body")] = 0.3
    radius: Annotated[float, Param("m", 0.03, 0.06, "body")] = 0.05
    body: Annotated[Literal["puck", "ball"], Choice("slides without friction, or rolls")] = "puck"

    @property
    def name(self) -> str:
        """Of the body in the scene."""
        return BODIES[self.body].name

    @property
    def inertia(self) -> float:
        """What resists the wind [kg]: m (1 + β) for what rolls."""
        return self.mass * (1 + BODIES[self.body].beta)

    @property
    def along(self) -> float:
        """Speed along the wind before it [m/s]."""
        return self.speed * cos(self.angle)

    @property
    def across(self) -> float:
        """Speed across the wind [m/s], which stays."""
        return self.speed * sin(self.angle)

    @property
    def side(self) -> float:
        """From the middle of the wind to where a body just touches it [m]."""
        return self.width / 2 + self.radius

    def unbent(self, y: float) -> float:
        """Place along the wind [m] at y across it, on the way without wind."""
        return self.reach * self.length + y * self.along / self.across

    @property
    def wind(self) -> Wind:
        """The effect: a ball or puck enters and leaves it by and by, so its sides have an edge."""
        box = Box((0.0, 0.0, HEIGHT), (1.0, 0.0, 0.0), self.length, self.width, 2 * HEIGHT + 0.2, 2 * self.radius)
        return Wind(box, self.force, (self.name,))

    def push(self, x: Array | float, y: Array | float) -> Array:
        """Force along the wind [N] at places x along and y across it, written out independently of the effect."""
        u = np.asarray(x, float) / self.length
        inside = np.clip((self.side - np.abs(y)) / (2 * self.radius), 0.0, 1.0)
        fading = np.where((u >= 0) & (u <= 1), (1 - u) ** 2, 0.0)
        return np.asarray(self.force * fading * inside**2 * (3 - 2 * inside))

    def passage(self) -> Passage:
        """From the first touch of the wind to the last, by the equation of motion."""
        end = 2 * self.side / self.across

        def moves(t: float, y: Array) -> tuple[float, float]:
            return float(y[1]), float(self.push(float(y[0]), self.across * t - self.side)) / self.inertia

        way = solve_ivp(moves, (0.0, end), (self.unbent(-self.side), self.along), method="DOP853", rtol=1e-10,
                        atol=1e-12, max_step=end / 60)  # fmt: skip
        return Passage(way.t, way.y[0], way.y[1])

    def build(self, scene: Scene) -> None:
        """A fan hung in a gate, the body on its way past it, and a pad across its way when it has been deflected."""
        inside = self.width / self.across
        if inside * 240 < SAMPLES:
            raise Refusal("R12", f"speed = {self.speed:.3g} m/s crosses the wind within {inside * 240:.1f} samples; "
                          f"allowed: {self.speed * inside * 240 / SAMPLES:.3g} m/s, for {SAMPLES}")  # fmt: skip
        way = self.passage()
        y = self.across * way.t - self.side
        legs = max(self.side, LEGS + self.radius)
        nearest = min(float(way.x[np.abs(y) <= legs].min()), self.unbent(-legs))
        if nearest < FOOT + self.radius:
            allowed = self.reach + (FOOT + self.radius - nearest) / self.length
            raise Refusal("R1", f"reach = {self.reach:.3g} leads the body into the fan; allowed: {allowed:.3g} or "
                          "more, or another angle")  # fmt: skip
        hardest = float(self.push(way.x, y).max()) / self.inertia
        if hardest > HARDEST:
            raise Refusal("R12", f"force = {self.force:.3g} N accelerates {self.mass:.3g} kg by {hardest:.3g} m/s², "
                          f"out of sight at once; allowed: {self.force * HARDEST / hardest:.3g} N")  # fmt: skip
        before = min(max(0.6 * self.speed, 0.3), 0.9) / self.speed
        leaving = np.hypot(way.v[-1], self.across)
        duration = before + way.t[-1] + (BEYOND - self.radius) / leaving + 0.6
        if duration > LONGEST:
            raise Refusal("R12", f"speed = {self.speed:.3g} m/s takes {duration:.3g} s to pass; allowed: about "
                          f"{self.speed * duration / LONGEST:.2g} m/s, for {LONGEST:g} s")  # fmt: skip
        scene.effects.append(self.wind)
        fan(scene, self.wind.box)
        turns = BODIES[self.body].beta > 0
        part = mover(scene, self.body, self.radius, self.mass, GRIP if turns else 0.0)
        start = (way.x[0] - self.along * before, -self.side - self.across * before)
        scene.start[part.name("free")] = free_pose((*start, self.radius * BODIES[self.body].half_height))
        spin = (-self.across / self.radius, self.along / self.radius) if turns else (0.0, 0.0)
        scene.speed[part.name("free")] = (self.along, self.across, 0, *spin, 0)
        out = np.array([way.v[-1], self.across]) / leaving
        pad = foam(scene, "pad", 0.0, -1, self.name)
        heading = atan2(out[1], out[0]) / 2
        pad.body("pad").pos[:2] = np.array([way.x[-1], self.side]) + BEYOND * out
        pad.body("pad").quat[:] = (cos(heading), 0.0, 0.0, sin(heading))
        slope = 2 * sqrt(self.force * hardest * self.inertia) / self.length
        time = min(4 * self.radius / self.across, sqrt(self.inertia / slope) / 2)
        scene.resolve(time=time, length=self.radius, duration=max(duration, 2.0))

    @observable("m")
    def path(self, run: Run) -> Array:
        """Of the centre of mass: along the wind from the fan, and across it from its middle, (T, 2)."""
        return run.position(self.name)[:, :2]

    @observable("m/s")
    def components(self, run: Run) -> Array:
        """Of the velocity, along and across the wind (T, 2)."""
        return run.velocity(self.name)[:, :2]

    @observable("N")
    def wind_force(self, run: Run) -> Array:
        """On the body, along the wind; nothing outside it."""
        return self.push(*self.path(run).T)

    def crossing(self, run: Run) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Samples (before or in the wind, behind it) until the pad; NotEvaluated if it slips or too few are behind."""
        beta = BODIES[self.body].beta
        x, y = self.path(run).T
        grip = beta / (1 + beta) * self.push(x, y).max() / (self.mass * g)
        if grip > 0.99 * GRIP:
            raise NotEvaluated(f"the wind makes the ball slip: friction needed: {grip:.3g}, there is {GRIP}")
        free = run.t < min((i.time for i in run.impacts if "pad/foam" in (i.first, i.second)), default=np.inf)
        behind = free & (y > self.side)
        if behind.sum() < 5:
            raise NotEvaluated(f"{behind.sum()} samples behind the wind; needed: 5")
        return free & ~behind, behind

    def at_right_angles(self, run: Run, **changes: float) -> tuple[WindDeflectMotion, Run]:
        """This run, or a twin, in which the wind blows across the way."""
        return twin(self, run, angle=pi / 2, **changes)

    @law("v⊥ = v₀ sin φ", source="Newton, Principia, law 2", within=(1e-9, 1e-10, 1e-11))
    def wind_does_not_change_what_is_across(self, run: Run) -> Measurement:
        """8a: component of the velocity at right angles to the wind, at every instant until the pad."""
        into, behind = self.crossing(run)
        across = self.components(run)[into | behind, 1] / self.across
        return across, np.ones_like(across)

    @law("v = const outside the wind", source="Newton, Principia, law 1", within=(1e-9, 1e-10, 1e-11))
    def way_is_straight_outside(self, run: Run) -> Measurement:
        """8a: both components before the wind, and behind it against their values just behind."""
        _, behind = self.crossing(run)
        v = self.components(run)
        before = v[self.path(run)[:, 1] < -self.side]
        start = np.array([self.along, self.across])
        steady = np.concatenate([before - start, v[behind] - v[behind][0]]) / self.speed
        return 1 + steady, np.ones_like(steady)

    @law("Δv = ∫ F dt/mₑ", source="Newton, Principia, law 2; DOP853", within=(1e-4, 1e-5, 1e-6))
    def wind_adds_its_impulse(self, run: Run) -> Measurement:
        """8b: change of the component along the wind, against the equation of motion solved to 1e-10."""
        _, behind = self.crossing(run)
        gained = self.components(run)[behind, 0] - self.along
        return gained.mean(), self.passage().v[-1] - self.along

    @law("Δv = F₀ (1 - s/L)² w/(mₑ v)", source="Newton, Principia, law 2 (a force that hardly changes)",
         within=(5e-4, 5e-4, 5e-4), limited_by="the formula is that of a weak wind: its error is of order 2 Δs/(L - s)"
         )  # fmt: skip
    def weak_wind_adds_force_times_time(self, run: Run) -> Measurement:
        """8b: for a heavy body that crosses a weak wind at right angles within a quarter of a second."""
        specimen, one = self.at_right_angles(run, force=0.02, mass=5.0, speed=max(4 * self.width, 0.8))
        _, behind = specimen.crossing(one)
        fading = (1 - specimen.reach) ** 2
        expected = specimen.force * fading * specimen.width / (specimen.inertia * specimen.speed)
        return specimen.components(one)[behind, 0].mean(), expected

    @law("tan δ = Δv/v₀", source="Newton, Principia, corollary 1 of the laws (composition of velocities)",
         within=(1e-4, 1e-5, 1e-6))  # fmt: skip
    def way_is_bent_by_both_components(self, run: Run) -> Measurement:
        """8c: angle between the ways before and behind a wind that blows across."""
        specimen, one = self.at_right_angles(run)
        _, behind = specimen.crossing(one)
        path = specimen.path(one)
        first, last = path[path[:, 1] < -specimen.side], path[behind]
        (a, b), (c, d) = first[-1] - first[0], last[-1] - last[0]
        return atan2(c * b - a * d, a * c + b * d), atan2(specimen.passage().v[-1], specimen.speed)

    @law("½ mₑ Δ(v²) = ∫ F dx", source="Landau & Lifshitz, Mechanics, §5-6", within=(1e-4, 1e-5, 1e-6))
    def wind_works_along_the_way(self, run: Run) -> Measurement:
        """8d: gain of kinetic energy less the work of the wind along the recorded way, over all work, given and taken:
        a body that the wind turns back leaves as fast as it came."""
        _, behind = self.crossing(run)
        v, path = self.components(run), self.path(run)
        last = int(np.nonzero(behind)[0][0])
        t = np.linspace(0.0, run.t[last], 40 * last + 1)
        x, y = (CubicHermiteSpline(run.t, path[:, k], v[:, k]) for k in (0, 1))
        power = self.push(x(t), y(t)) * x.derivative()(t)
        gain = self.inertia * ((v[last] ** 2).sum() - self.speed**2) / 2
        return 1 + (gain - np.trapezoid(power, t)) / np.trapezoid(np.abs(power), t), 1.0

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        what = "A blue puck" if self.body == "puck" else "An orange ball"
        does = "slides without friction" if self.body == "puck" else "rolls"
        _, y = self.path(run).T
        v = self.components(run)[min(int(np.argmax(y > self.side)), len(run) - 1)]
        bent = np.degrees(self.angle - atan2(v[1], v[0]))
        return (
            f"{what} of {self.mass:.2g} kg {does} at {self.speed:.2f} m/s past a fan and through its wind, "
            f"{self.width:.1f} m wide, at {np.degrees(self.angle):.0f} degrees to it. The wind, {self.force:.2g} N at "
            f"the blades and nothing {self.length:.1f} m away, changes only the part of the velocity along it, from "
            f"{self.along:.2f} to {v[0]:.2f} m/s; the part across stays {self.across:.2f} m/s. So the way bends by "
            f"{bent:.0f} degrees while the body is in the wind, and is straight before and after."
        )
