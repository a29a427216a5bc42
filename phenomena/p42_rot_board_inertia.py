"""42: a bar turning about a post strikes a puck, or pushes it outwards along its side."""

from __future__ import annotations

from math import acosh, inf, pi, sqrt
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from phenomena.parts import court
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import IMPACT_WINDOW, between
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Motor, Part, Scene, free_pose

Array = NDArray[np.float64]

AXLE: Final = "rotor/axle"
RADIUS: Final = 0.04
"""Of the puck, and distance of the bar's leading face behind the axle [m]."""

HALF: Final = (0.02, 0.025)
"""Half width and half height of the bar [m]."""

STUB: Final = 0.02
"""The bar starts this far behind the axle [m]."""

STUD: Final = 0.04
"""Of the block that rubs along the bar: distance of its studs from its middle [m]."""

LIGHTEST, HEAVIEST = 15.0, 21300.0
"""Densities of a bar: foam, platinum [kg/m³]."""


class RotBoardInertia(Phenomenon, domain="mechanics"):
    """Rotating block pushes other objects: a bar on a post strikes a puck, or sends it outwards along its side."""

    event: Annotated[
        Literal["free", "driven", "smooth", "rough"],
        Choice("the bar strikes a puck, turning freely or driven by a motor; or, driven, pushes a smooth puck or a "
               "rough block along its side"),
    ] = "free"  # fmt: skip
    speed: Annotated[float, Param("rad/s", 1.0, 10.0, "of the bar")] = 3.0
    length: Annotated[float, Param("m", 0.3, 0.8, "of the bar, from the axle to its end")] = 0.6
    place: Annotated[float, Param("m", 0.1, 0.6, "of what it strikes or pushes, from the axle")] = 0.4
    inertia: Annotated[float, Param("kg m²", 0.005, 0.5, "of the bar about the axle")] = 0.1
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "puck or block")] = 1500.0
    restitution: Annotated[float, Param("1", 0.1, 1.0, "of bar and puck")] = 0.6
    friction: Annotated[float, Param("1", 0.0, 0.9, "of bar and rough block")] = 0.3

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen: the puck anywhere along the bar, unless its place is given."""
        drawn = super().sample(rng, **fixed)
        if "place" in fixed or drawn.place < drawn.farthest:
            return drawn
        return super().sample(rng, **(drawn.values() | {"place": rng.uniform(0.1, drawn.farthest)}))

    @property
    def farthest(self) -> float:
        """Place at which the bar still meets the puck well inside its end [m]."""
        return self.length - RADIUS

    @property
    def strikes(self) -> bool:
        """Whether the bar strikes; else it pushes."""
        return self.event in ("free", "driven")

    @property
    def body(self) -> str:
        """What is struck or pushed, by its name in the scene."""
        return "sled/sled" if self.event == "rough" else "disc/disc"

    @property
    def mass(self) -> float:
        """Of the puck, or of the block [kg]."""
        return self.density * (0.1 * 0.06 * 0.04 if self.event == "rough" else pi * RADIUS**2 * 0.04)

    @property
    def bar(self) -> tuple[float, float, float]:
        """Half length of the bar, and its middle (x, y) as seen from the axle [m]."""
        return (self.length + STUB) / 2, (self.length - STUB) / 2, -RADIUS - HALF[0]

    @property
    def bar_mass(self) -> float:
        """That gives the bar its moment of inertia [kg]."""
        half, x, y = self.bar
        return self.inertia / ((half**2 + HALF[0] ** 2) / 3 + x**2 + y**2)

    @property
    def lead(self) -> float:
        """Angle by which the bar is behind the puck at the start [rad]: not so much that it ends before it."""
        return min(1.2 * self.speed, 3.6) if self.strikes else 0.0

    @property
    def leaves(self) -> float:
        """When what is pushed comes to the end of the bar [s]: the puck's middle, or the block's front stud."""
        if self.event == "smooth":
            return acosh(self.length / self.place) / self.speed
        end = self.length - STUD
        return float(brentq(lambda t: float(self.path(np.array(t))) - end, 0.0, 50 / self.speed))

    def path(self, t: Array) -> Array:
        """Distance of what is pushed from the axle, r̈ + 2 μ Ω ṙ - Ω² r = 0 from rest on the bar [m]."""
        mu = self.friction if self.event == "rough" else 0.0
        root = sqrt(mu**2 + 1)
        out, back = self.speed * (root - mu), -self.speed * (root + mu)
        return np.asarray(self.place * (out * np.exp(back * t) - back * np.exp(out * t)) / (out - back))

    def build(self, scene: Scene) -> None:
        """A smooth court, a bar on its post, and what it strikes or pushes."""
        if self.place > self.farthest:
            raise Refusal("R12", f"place = {self.place:.4g} m: the bar of {self.length:.4g} m meets the puck with its "
                          f"end; allowed: {self.farthest:.4g} m")  # fmt: skip
        half, x, y = self.bar
        density = self.bar_mass / (8 * half * HALF[0] * HALF[1])
        if not LIGHTEST <= density <= HEAVIEST:
            nearest = self.inertia * min(max(density, LIGHTEST), HEAVIEST) / density
            raise Refusal("R3", f"inertia = {self.inertia:.4g} kg m² needs a bar of {density:.3g} kg/m³; "
                          f"allowed: {nearest:.4g} kg m²")  # fmt: skip
        scene.material("stage/floor", 2400.0, Surface(restitution=0.4))
        rails = court(scene, self.length + 4 * RADIUS + 0.1, Surface(restitution=0.6))
        rotor = scene.add("rotor")
        rotor.body("rotor").pos[:2], rotor.joint("axle").pos[:2] = (x, y), (-x, -y)
        rotor.geom("bar").size[0], rotor.geom("bar").mass = half, self.bar_mass
        rotor.geom("bracket").pos[0] = rotor.geom("cap").pos[0] = -x
        self._materials(scene, rotor, density)
        pushed = self._pushed(scene)
        side = [pushed.name("front"), pushed.name("rear")] if self.event == "rough" else [pushed.name("bumper")]
        ground = pushed.name("block" if self.event == "rough" else "slab")
        scene.touch(ground, "stage/floor")
        for part in side:
            scene.touch(part, rotor.name("bar"))
            scene.touch(part, rotor.name("post"))
        scene.touch(ground if self.event == "rough" else side[0], rails.name("rails"))
        scene.start[AXLE], scene.speed[AXLE] = -self.lead, self.speed
        if self.event != "free":
            scene.motors.append(Motor(AXLE, ((0.0, self.speed),)))
        if self.strikes:
            # strikes are resolved exactly, and between them all motion is uniform: what sets the step is that rebounds
            # slower than what gravity gives in a step count as none
            rebound = self.restitution * self.speed * self.place
            scene.resolve(time=min(1.2, 32 * rebound / g), length=RADIUS, duration=5.0)
        else:
            scene.resolve(time=0.5 / self.speed, length=RADIUS, duration=min(max(2.5, self.leaves + 2.0), 10.0))

    def _materials(self, scene: Scene, rotor: Part, density: float) -> None:
        # bar and puck are one surface each: the pair's mean is theirs
        surface = Surface(restitution=self.restitution)
        if self.event == "rough":
            surface = Surface(friction=self.friction, restitution=self.restitution)
        for name in ("bar", "rotor"):
            scene.material(rotor.name(name), density, surface)
        scene.material(rotor.name("post"), 7800.0, Surface(restitution=0.4))

    def _pushed(self, scene: Scene) -> Part:
        """The puck, or the block with studs, in its place; it moves with the bar if pushed (the block turns, too)."""
        rough = self.event == "rough"
        part = scene.add("sled" if rough else "disc")
        part.geom("block" if rough else "slab").mass = self.mass
        for name in ("sled", "block") if rough else ("disc", "slab", "bumper"):
            scene.material(part.name(name), self.density, Surface(restitution=self.restitution))
        for name in ("front", "rear") if rough else ():
            surface = Surface(friction=self.friction, restitution=self.restitution)
            scene.material(part.name(name), self.density, surface)
        scene.start[part.name("free")] = free_pose((self.place, 0.0, 0.02))
        if not self.strikes:
            scene.speed[part.name("free")] = (0.0, self.speed * self.place, 0.0, 0.0, 0.0, self.speed * rough)
        return part

    @observable("rad/s")
    def bar_speed(self, run: Run) -> Array:
        """Angular velocity of the bar (T,)."""
        return run.joint_speed(AXLE)

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of what is struck or pushed (T, 3)."""
        return run.velocity(self.body)

    @observable("m")
    def distance(self, run: Run) -> Array:
        """Of what is struck or pushed from the axle (T,)."""
        return np.asarray(np.hypot(*run.position(self.body)[:, :2].T))

    @observable("kg m²/s")
    def angular_momentum(self, run: Run) -> Array:
        """Of the bar and of what it strikes or pushes, about the axle (T,)."""
        return np.asarray(self.inertia * run.joint_speed(AXLE) + run.angular_momentum(self.body)[:, 2])

    def staged(self, run: Run, event: str, **changes: Any) -> tuple[RotBoardInertia, Run]:
        """The specimen with another event, and its run: this one, or a twin."""
        there = self.make(**(self.values() | {"event": event} | changes))
        return there, run if there == self else run.again(event=event, **changes)

    def hit(self, run: Run) -> Impact:
        """The first impact; NotEvaluated if it is not that of bar and puck."""
        if not run.impacts or {run.impacts[0].first, run.impacts[0].second} != {"rotor/bar", "disc/bumper"}:
            raise NotEvaluated("the bar has not struck the puck")
        return run.impacts[0]

    def after(self, run: Run, x: Array) -> Array:
        """A quantity that does not change between impacts, right after the first: mean over up to 20 ms."""
        when = self.hit(run).time
        stop = min([i.time for i in run.impacts[1:]], default=inf)
        return np.asarray(x[between(run.t, when, min(when + IMPACT_WINDOW, stop), least=2)].mean(axis=0))

    @law("J = (1+e) Ω₀ r/(1/m + r²/I), Ω' = Ω₀ - J r/I, v = J/m",
         source="Routh, Dynamics of a System of Rigid Bodies I, §§169-171", within=(1e-8, 1e-8, 1e-8),
         limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def a_free_bar_gives_up_speed(self, run: Run) -> Measurement:
        """42a: angular velocity of the bar and velocity of the puck after the strike."""
        there, twin = self.staged(run, "free")
        push = (1 + self.restitution) * self.speed * self.place / (1 / there.mass + self.place**2 / self.inertia)
        turns = there.after(twin, twin.joint_speed(AXLE))
        goes = there.after(twin, twin.velocity(there.body))
        top = self.speed * self.place
        return (
            [turns / self.speed, *goes / top],
            [1 - push * self.place / self.inertia / self.speed, 0.0, push / there.mass / top, 0.0],
        )

    @law("I Ω + m (r × v)·ẑ = I Ω₀", source="Landau & Lifshitz, Mechanics, §9", within=(1e-8, 1e-8, 1e-8),
         limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def angular_momentum_is_kept(self, run: Run) -> Measurement:
        """42a: of a free bar and the puck about the axle, at every sample until anything else is struck."""
        there, twin = self.staged(run, "free")
        there.hit(twin)
        ends = [i.time for i in twin.impacts if {i.first, i.second} != {"rotor/bar", "disc/bumper"}]
        seen = there.angular_momentum(twin)[between(twin.t, -1.0, min(ends, default=inf))]
        return seen, np.full(seen.shape, self.inertia * self.speed)

    @law("v = (1+e) Ω r", source="Newton, Principia, Axioms, corollaries 3 and 6, for one body of infinite mass",
         within=(1e-8, 1e-8, 1e-8), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def a_driven_bar_gives_up_none(self, run: Run) -> Measurement:
        """42b: velocity of the puck, and of the bar, after the strike of a bar that a motor drives."""
        there, twin = self.staged(run, "driven")
        goes = there.after(twin, twin.velocity(there.body)) / (self.speed * self.place)
        return [*goes, there.after(twin, twin.joint_speed(AXLE)) / self.speed], [0.0, 1 + self.restitution, 0.0, 1.0]

    def pushed(self, run: Run) -> Measurement:
        """Places of what is pushed until it comes to the bar's end, over the bar's length: measured and expected."""
        still = between(run.t, -1.0, self.leaves)
        t = run.t[still]
        turned = np.column_stack([np.cos(self.speed * t), np.sin(self.speed * t)])
        return run.position(self.body)[still, :2] / self.length, turned * self.path(t)[:, None] / self.length

    @law("r = r₀ cosh Ω t", within=(1e-3, 1e-4, 2e-5),
         source="Landau & Lifshitz, Mechanics, §39 eq. 39.9: the centrifugal force along a rotating bar")  # fmt: skip
    def a_smooth_puck_is_flung_outwards(self, run: Run) -> Measurement:
        """42c: place of the puck on the turning bar (twin, unless this is that run)."""
        there, twin = self.staged(run, "smooth")
        return there.pushed(twin)

    @law("v_r = Ω √(r_e² - r₀²), v_t = Ω r_e", source="Landau & Lifshitz, Mechanics, §39 eq. 39.11: energy in a "
         "rotating frame", within=(2e-2, 5e-3, 5e-4),
         limited_by="the step in which the puck slips off the end of the bar is not cut in two")  # fmt: skip
    def it_leaves_with_both_speeds(self, run: Run) -> Measurement:
        """42c: velocity of the smooth puck after it has left the bar's end, along and across the bar as it was then."""
        there, twin = self.staged(run, "smooth")
        outward = sqrt(self.length**2 - self.place**2)
        if outward < 2 * RADIUS:
            raise NotEvaluated("the puck comes to the end of the bar too slowly: it rolls round the edge")
        when = last = there.leaves
        for impact in twin.impacts:  # its edge may graze the puck once more
            if {impact.first, impact.second} != {"rotor/bar", "disc/bumper"} or impact.time > last + IMPACT_WINDOW:
                break
            last = max(last, impact.time)
        stop = min([i.time for i in twin.impacts if i.time > last], default=inf)
        goes = twin.velocity(there.body)[between(twin.t, last, stop, least=3), :2].mean(axis=0)
        angle = self.speed * when
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        top = self.speed * self.length
        return [goes @ along / top, goes @ across / top], [outward / self.length, 1.0]

    @law("r̈ + 2 μ Ω ṙ - Ω² r = 0", source="Landau & Lifshitz, Mechanics, §39 eq. 39.9, with Coulomb's friction on the "
         "force 2 m Ω ṙ of the bar", within=(1e-2, 1e-3, 1e-4))  # fmt: skip
    def friction_on_the_bar_holds_it_back(self, run: Run) -> Measurement:
        """42d: place of the rough block on the turning bar (twin, unless this is that run)."""
        there, twin = self.staged(run, "rough")
        return there.pushed(twin)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        where = f"{self.place:.2f} m from its axle"
        if self.strikes:
            when = self.hit(run).time
            bar, puck = float(self.after(run, run.joint_speed(AXLE))), float(self.after(run, self.velocity(run)[:, 1]))
            turns = "is driven on by a motor" if self.event == "driven" else "turns back" if bar < 0 else "turns on"
            return (
                f"A red bar {self.length:.1f} m long turns about a post at {self.speed:.1f} rad/s, over a smooth "
                f"floor, and after {when:.2f} s strikes a blue puck of {self.mass:.2g} kg at rest, {where}. The puck "
                f"shoots off at {puck:.2f} m/s, at a right angle to the bar, which {turns} at {abs(bar):.2f} rad/s"
                + (", what it gave up being the puck's angular momentum." if self.event == "free" else ".")
            )
        thing = "smooth puck" if self.event == "smooth" else "rough block"
        holds = " against friction" if self.event == "rough" else ""
        return (
            f"A red bar {self.length:.1f} m long is driven round a post at {self.speed:.1f} rad/s and pushes a {thing} "
            f"before it over a smooth floor, at first {where}. Nothing holds the {thing} on its circle: it glides "
            f"outwards along the bar{holds}, ever faster, comes to the bar's end after {self.leaves:.2f} s, and flies "
            f"off slantwise, until the rails stop it."
        )
