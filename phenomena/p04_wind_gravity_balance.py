"""A ball hovers over a blower, or hangs and leans before a fan: where wind and weight balance, and the way there."""

from __future__ import annotations

from math import asin, atan, cos, nan, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly, make_interp_spline
from scipy.optimize import brentq

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import BLUNT, FADING, Box, Drag, Wind, fan
from physinone_mj.measure import accelerations, crossings
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .winds import LONGEST, twin

Array = NDArray[np.float64]

GRILLE: Final = 0.2
"""Height of the blower's grille above the floor [m]."""

AIM: Final = 0.5
"""Height above the floor at which the fan blows at what hangs [m]."""

WIDEST: Final = 1.0
"""Lean of what hangs at most [rad]: more carries it out of the wind of one fan."""

LIGHT: Final = 0.05
"""Weight, against the wind, of the ball that starts above the wind."""


class WindGravityBalance(Phenomenon, domain="mechanics"):
    """Objects in equilibrium of wind and gravity."""

    force: Annotated[float, Param("N", 0.2, 30.0, "of the wind at its source")] = 0.6
    length: Annotated[float, Param("m", 0.5, 3.0, "of the wind, from its source to its end")] = 1.2
    weight: Annotated[float, Param("1", 0.05, 0.9, "of the body, against the force at the source")] = 0.35
    offset: Annotated[float, Param("1", -0.3, 0.3, "of the start from the balance: lengths of the wind, or rad")] = 0.28
    drag: Annotated[float, Param("kg/s", 0.0, 0.5, "of the air, force per speed")] = 0.02
    radius: Annotated[float, Param("m", 0.03, 0.08, "body; the plate is four times as wide")] = 0.05
    rod: Annotated[float, Param("m", 0.3, 0.8, "from the pivot to the middle of what hangs")] = 0.5
    profile: Annotated[Literal["fading", "blunt"], Choice("how the wind fades: (1 - s/L)², or 1 - (s/L)²")] = "fading"
    setup: Annotated[
        Literal["hovering ball", "hanging ball", "hanging plate"],
        Choice("free above a blower, or on a rod before a fan"),
    ] = "hovering ball"

    @property
    def hovers(self) -> bool:
        """Whether the body is free."""
        return self.setup == "hovering ball"

    @property
    def mass(self) -> float:
        """Of the body [kg]."""
        return self.weight * self.force / g

    @property
    def body(self) -> str:
        """Its name."""
        return "ball/ball" if self.hovers else "pendulum/bob"

    @property
    def before(self) -> float:
        """Distance of the pivot from the fan [m]."""
        return 0.3 * max(self.length, 1.0)

    @property
    def wind(self) -> Wind:
        """The effect."""
        profile = FADING if self.profile == "fading" else BLUNT
        if self.hovers:
            box = Box((0.0, 0.0, GRILLE), (0.0, 0.0, 1.0), self.length, 0.4, 0.4)
        else:
            box = Box((0.0, 0.0, AIM), (1.0, 0.0, 0.0), self.length, 0.5, 0.9)
        return Wind(box, self.force, (self.body,), profile)

    def push(self, s: float) -> float:
        """Force [N] at distance s from the source, written out independently of the effect."""
        u = s / self.length
        return self.force * ((1 - u) ** 2 if self.profile == "fading" else 1 - u * u) if 0 <= u <= 1 else 0.0

    @property
    def height(self) -> float:
        """At which the wind bears the weight, above the grille (4a) [m]."""
        return self.length * (1 - sqrt(self.weight) if self.profile == "fading" else sqrt(1 - self.weight))

    @property
    def stiffness(self) -> float:
        """-dF/ds there [N/m]."""
        root = sqrt(self.weight) if self.profile == "fading" else sqrt(1 - self.weight)
        return 2 * self.force / self.length * root

    @property
    def lean(self) -> float:
        """At which tan θ = F(s₀ + ℓ sin θ)/(m g) (4d) [rad]."""

        def torque(theta: float) -> float:
            wind = self.push(self.before + self.rod * sin(theta))
            return wind * cos(theta) - self.mass * g * sin(theta)

        return float(brentq(torque, 0.0, pi / 2, xtol=1e-14))

    @property
    def bobbing(self) -> float:
        """Period of small motions about the balance [s] (4b); what hangs: without the wind's fading."""
        return 2 * pi * sqrt(self.mass / self.stiffness if self.hovers else self.rod / g)

    def build(self, scene: Scene) -> None:
        """A blower and a ball above it, or a fan and a ball or plate on a rod in its wind."""
        most = 4 * self.mass * 2 * pi / self.bobbing
        if self.drag > most:
            raise Refusal("R4", f"drag = {self.drag:.3g} kg/s lets {self.mass:.3g} kg creep to the balance; allowed: "
                          f"{most:.3g} kg/s")  # fmt: skip
        scene.effects.append(self.wind)
        scene.effects.append(Drag(self.drag, (self.body,)))
        (self.hover if self.hovers else self.hang)(scene)
        fade = 6 * self.mass / self.drag if self.drag else 0.0
        duration = float(np.clip(max(5.5 * self.bobbing, fade), 5.0, LONGEST))
        scene.resolve(time=self.bobbing / 2, length=self.radius, duration=duration)

    def hover(self, scene: Scene) -> None:
        """The blower, its air, and a ball in it."""
        start = self.height + self.offset * self.length
        if start < self.radius:
            raise Refusal("R1", f"offset = {self.offset:.3g} starts the ball inside the grille; allowed: "
                          f"{(self.radius - self.height) / self.length:.3g} or more")  # fmt: skip
        part = scene.add("blower")
        scene.speed[part.name("rotor")] = 14.0
        air = part.geom("air")
        air.pos[2], air.size[1] = GRILLE + self.length / 2, self.length / 2
        for i in range(9):
            # a lattice that looks irregular: low-discrepancy multiples of irrational numbers
            turn, out = 2 * pi * 0.618 * i, 0.14 * sqrt((i + 0.5) / 9)
            low = GRILLE + self.length * (0.06 + 0.1 * (i % 4))
            x, y, up = out * cos(turn), out * sin(turn), low + self.length * (0.35 - 0.02 * i)
            part.geom(f"streak{i}").fromto = (x, y, low, x, y, up)
        plastic = Surface(friction=0.3, restitution=0.3)
        for name in ("blower", "rotor", "rest"):
            scene.material(part.name(name), 1100.0, plastic)
        ball = scene.add("ball")
        geom = ball.geom("ball")
        geom.size[0], geom.mass = self.radius, self.mass
        scene.start[ball.name("free")] = free_pose((0.0, 0.0, GRILLE + start))
        scene.material(self.body, self.mass / (4 / 3 * pi * self.radius**3), plastic)
        scene.touch(self.body, part.name("rest"))

    def hang(self, scene: Scene) -> None:
        """A fan, and what hangs in its wind from a frame."""
        lean = self.lean
        if lean > WIDEST:
            there = self.before + self.rod * sin(WIDEST)
            least = self.push(there) / self.force / tan(WIDEST)
            raise Refusal("R12", f"weight = {self.weight:.3g} lets the {self.setup} lean by {lean:.3g} rad; allowed: "
                          f"{least:.3g} or more, for {WIDEST:g} rad")  # fmt: skip
        fan(scene, self.wind.box)
        part = scene.add("pendulum")
        scene.spec.delete(scene.spec.sensor(part.name("tension")))  # nobody reads it
        pivot = AIM + self.rod * cos(lean)
        frame = part.body("frame")
        frame.pos[:] = (self.before, 0.0, pivot)
        wide = max(0.3, 2 * self.radius + 0.1)
        part.geom("beam").fromto = (0, -wide, 0, 0, wide, 0)
        for post, foot, side in (("left", "left_foot", -wide), ("right", "right_foot", wide)):
            part.geom(post).fromto = (0, side, 0, 0, side, 0.02 - pivot)
            part.geom(foot).pos = (0, side, 0.02 - pivot)
        part.body("bob").pos[2] = -self.rod
        part.geom("rod").fromto = (0, 0, 0, 0, 0, self.rod)
        geom = part.geom("ball")
        volume = 4 / 3 * pi * self.radius**3
        if self.setup == "hanging plate":
            sizes = (0.004, 2 * self.radius, 1.5 * self.radius)
            geom.type, geom.size, volume = mujoco.mjtGeom.mjGEOM_BOX, sizes, 8 * sizes[0] * sizes[1] * sizes[2]
        else:
            geom.size[0] = self.radius
        geom.mass = self.mass
        part.site("pivot").pos[2] = part.joint("hinge").pos[2] = self.rod
        scene.start[part.name("hinge")] = lean + self.offset
        scene.material(self.body, self.mass / volume, Surface(friction=0.4, restitution=0.5))
        scene.material(part.name("frame"), 700.0, Surface(friction=0.4, restitution=0.4))

    @observable("m")
    def distance(self, run: Run) -> Array:
        """Of the centre of mass from the source of the wind, along the wind."""
        place = run.position(self.body)
        return np.asarray(place[:, 2] - GRILLE if self.hovers else place[:, 0])

    @observable("rad")
    def tilt(self, run: Run) -> Array:
        """Of the rod from the vertical, away from the fan; 0 of what hovers."""
        return np.zeros(len(run)) if self.hovers else run.joint("pendulum/hinge")

    @observable("N")
    def wind_force(self, run: Run) -> Array:
        """On the body; nothing outside the wind."""
        return np.array([self.push(s) for s in self.distance(run)])

    def rise(self, run: Run) -> Array:
        """Vertical velocity (T,) [m/s]."""
        return run.velocity(self.body)[:, 2]

    def afloat(self, run: Run, offset: float, **changes: float) -> tuple[WindGravityBalance, Run]:
        """A twin that hovers without drag, started so far (in lengths of the wind) from its balance."""
        specimen, one = twin(self, run, setup="hovering ball", drag=0.0, offset=offset, **changes)
        if one.impacts:
            raise NotEvaluated("the ball meets the grille")
        return specimen, one

    def room(self) -> float:
        """How far above its balance a ball can start [lengths of the wind]: it must neither fall into the grille nor
        leave the wind, whose fading is smooth within it only."""
        above = (self.height - self.radius) / self.length
        if above < 0.02:
            raise NotEvaluated(f"the balance lies {self.height:.2g} m above the grille, where the ball rests on it")
        return min(0.1, above / 2, 0.8 * (1 - self.height / self.length))

    @law("F(z) = m g: z = L (1 - √(m g/F₀)), or L √(1 - m g/F₀)", source="Newton, Principia, law 2; Landau & Lifshitz, "
         "Mechanics, §21 (motion about a balance is fastest there)", within=(1e-8, 5e-10, 5e-11))  # fmt: skip
    def wind_bears_the_weight_at_one_height(self, run: Run) -> Measurement:
        """4a: where a ball that bobs without drag is fastest; the same with a fifth of the weight taken off (or on)."""
        lighter = self.weight * (0.8 if self.weight > 0.0625 else 1.2)
        heights, expected = [], []
        for weight in (self.weight, lighter):
            other = type(self).make(**(self.values() | {"weight": weight}))
            specimen, one = self.afloat(run, other.room(), weight=weight)
            heights.append(fastest(one.t, specimen.distance(one), specimen.rise(one)))
            expected.append(specimen.height)
        return heights, expected

    @law("T = 2π √(m/|F'(z)|)", source="Landau & Lifshitz, Mechanics, §21 eq. 21.6", within=(5e-5, 5e-5, 5e-5),
         limited_by="the formula is that of small motions: its error is of order (A/L)²")  # fmt: skip
    def bobs_in_its_own_time(self, run: Run) -> Measurement:
        """4b: period of a ball that starts 0.002 L above its balance, without drag."""
        self.room()
        specimen, one = self.afloat(run, 0.002)
        if specimen.bobbing > one.t[-1] / 2.2:
            raise NotEvaluated(f"a period of {specimen.bobbing:.3g} s in {one.t[-1]:.3g} s; needed: two periods")
        times = crossings(one.t, specimen.distance(one), specimen.rise(one), specimen.height)
        return np.diff(times).mean() if len(times) > 1 else nan, specimen.bobbing

    @law("½ v² + g z + U(z)/m = const, U = F₀ L (1 - z/L)³/3, or -F₀ (z - z³/3L²)",
         source="Landau & Lifshitz, Mechanics, §6", within=(1e-8, 1e-10, 1e-11))  # fmt: skip
    def wind_takes_back_what_it_gives(self, run: Run) -> Measurement:
        """4c: energy of a ball that bobs without drag, at every instant."""
        specimen, one = self.afloat(run, self.room())
        u = specimen.distance(one) / specimen.length
        stored = (1 - u) ** 3 / 3 if specimen.profile == "fading" else 2 / 3 - u + u**3 / 3
        energy = specimen.rise(one) ** 2 / 2 + g * specimen.length * (u + stored / specimen.weight)
        return energy / energy[0], np.ones(len(one))

    @law("z̈ = -g for z > L", source="Newton, Principia, law 2", within=(1e-9, 1e-9, 1e-9),
         limited_by="rounding, magnified by differencing twice")  # fmt: skip
    def nothing_pushes_above_the_wind(self, run: Run) -> Measurement:
        """4a, 4c: acceleration of a light ball that starts above the end of the wind, until it falls into it."""
        specimen, one = twin(self, run, setup="hovering ball", drag=0.0, offset=0.3, weight=LIGHT)
        z = specimen.distance(one)
        above = int(np.argmax(z < specimen.length))
        if above < 8:
            raise NotEvaluated(f"{above} samples above the wind; needed: 8")
        return accelerations(one.t[:above], z[:above], specimen.rise(one)[:above]) / g, -np.ones(above - 4)

    @law("tan θ = F(s₀ + ℓ sin θ)/(m g)", source="Landau & Lifshitz, Mechanics, §5 (balance of torques), §21",
         within=(2e-7, 2e-9, 1e-10))  # fmt: skip
    def rod_points_along_the_sum_of_the_forces(self, run: Run) -> Measurement:
        """4d: angle at which what hangs swings fastest, without drag."""
        hanging = "hanging ball" if self.hovers else self.setup
        there = (self.before + self.rod * sin(WIDEST)) / self.length
        steepest = ((1 - there) ** 2 if self.profile == "fading" else 1 - there**2) / tan(WIDEST) if there < 1 else 0.0
        weight = min(max(self.weight, 1.01 * steepest), 0.9)
        plumb = type(self).make(**(self.values() | {"setup": hanging, "weight": weight}))
        edge = asin(min(1.0, (self.length - self.before) / self.rod))  # beyond it what hangs would leave the wind
        offset = min(0.15, 0.8 * (edge - plumb.lean))
        specimen, one = twin(self, run, setup=hanging, drag=0.0, offset=offset, weight=weight)
        theta = fastest(one.t, specimen.tilt(one), one.joint_speed("pendulum/hinge"))
        wind = specimen.push(specimen.before + specimen.rod * sin(theta))
        return theta, atan(wind / (specimen.mass * g))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        source = f"{self.force:.2g} N at its source and fades to nothing within {self.length:.1f} m"
        late = run.t > run.t[-1] - self.bobbing
        if self.hovers:
            z = self.distance(run)
            still = np.ptp(z[late]) < 0.01
            fate = (
                f"hovers {z[-1]:.2f} m above the grille" if still
                else f"still bobs, between {z[late].min():.2f} and {z[late].max():.2f} m above the grille"
            )  # fmt: skip
            return (
                f"An orange ball of {1000 * self.mass:.3g} g is let go {z[0]:.2f} m above the grille of a blower, "
                f"whose wind pushes upwards with {source}. Where the wind is stronger than the weight, the ball is "
                f"lifted, where it is weaker, it sinks; so it bobs about the height at which the two balance. After "
                f"{run.t[-1]:.0f} s it {fate}."
            )
        angle = np.degrees(self.tilt(run))
        still = np.ptp(angle[late]) < 1
        fate = (
            f"it rests at {angle[-1]:.0f} degrees" if still
            else f"it still swings between {angle[late].min():.0f} and {angle[late].max():.0f} degrees"
        )  # fmt: skip
        return (
            f"A red {self.setup.split()[1]} of {1000 * self.mass:.3g} g hangs on a {self.rod:.2f} m rod before a fan, "
            f"whose wind pushes with {source}. Let go at {angle[0]:.0f} degrees from the vertical, it swings about the "
            f"angle at which the rod points along the sum of wind and weight. After {run.t[-1]:.0f} s {fate}."
        )


def fastest(t: Array, x: Array, v: Array) -> float:
    """Mean of x where |v| is greatest: of a conservative motion, where no force is left. NaN if it does not bob."""
    slope = make_interp_spline(t, v, k=7).derivative()
    times = PPoly.from_spline((slope.t, slope.c, slope.k)).roots(extrapolate=False)
    return float(np.mean(make_interp_spline(t, x, k=7)(times))) if len(times) > 3 else nan
