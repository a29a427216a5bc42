"""A balloon on a thread: it pulls it taut with all its lift, sways like a pendulum upside down, leans in the wind."""

from __future__ import annotations

from dataclasses import replace
from math import atan, degrees, expm1, hypot, log, pi, sqrt, tan
from typing import Annotated, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import AIR_DENSITY
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import UNIFORM, AirStream, Box, Buoyancy, fan
from physinone_mj.measure import between, crossings, threshold
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Coil, Scene, free_pose

from .balloons import KNOT, Balloon, tie

Array = NDArray[np.float64]

BODY: Final = "balloon/balloon"

HALF: Final = 0.06
"""Half edge of the parcel [m]."""

GRIP: Final = Surface(friction=0.6, restitution=0.1)
"""Of parcel and floor."""

EYE: Final = {"parcel": ("parcel/parcel", 0.066), "scale": ("pull_scale/rod", 0.11)}
"""What the thread is tied to: body, and height of its eye above the body's frame [m]."""

SMALL: Final = 0.005
"""Width of a small swing [rad]."""

MARGIN: Final = 9e-4
"""Half width of the bracket round the weight that is just carried, as a fraction."""


class BalloonTether(Phenomenon, domain="mechanics"):
    """Tethered balloon pulls string taut: lift is balanced by tension, upright in still air, aslant in the wind."""

    radius: Annotated[float, Param("m", 0.12, 0.25, "balloon")] = 0.15
    gas: Annotated[float, Param("kg/m³", 0.09, 0.4, "density of the gas: hydrogen 0.09, helium 0.18")] = 0.18
    skin: Annotated[float, Param("kg", 0.003, 0.006, "mass of the skin")] = 0.004
    drag: Annotated[float, Param("1", 0.2, 0.8, "drag coefficient")] = 0.47
    length: Annotated[float, Param("m", 0.2, 1.5, "of the thread")] = 0.9
    slack: Annotated[float, Param("1", 0.0, 0.9, "part of the thread that hangs loose at the start")] = 0.6
    push: Annotated[float, Param("m/s", 0.0, 0.8, "sideways, at the start")] = 0.6
    weight: Annotated[float, Param("kg", 0.008, 0.24, "mass of the parcel")] = 0.08
    wind: Annotated[float, Param("m/s", 0.5, 3.0, "where it blows")] = 1.8
    weather: Annotated[Literal["still", "windy"], Choice("air at rest, or a uniform wind from a fan")] = "still"
    anchor: Annotated[Literal["parcel", "scale"], Choice("what holds it: a parcel, or a spring scale")] = "parcel"

    @property
    def balloon(self) -> Balloon:
        """What pulls."""
        return Balloon(self.radius, self.skin, self.gas, self.drag, AIR_DENSITY)

    @property
    def arm(self) -> float:
        """From the eye to the balloon's centre when all is in line [m]."""
        return self.length + KNOT * self.radius

    def sway(self) -> tuple[float, float, float]:
        """Slow and fast angular frequency of small swings [rad/s], and in the slow one the balloon's tilt over the
        displacement of its centre [rad/m].

        Thread φ, balloon ψ: m_e (ℓ φ̈ + d ψ̈) = -B φ; I ψ̈ = -B d (ψ - φ), d from the centre to the knot.
        """
        balloon, d = self.balloon, KNOT * self.radius
        mass = np.array([[balloon.inertia * self.length, balloon.inertia * d], [0.0, balloon.spin_inertia]])
        pull = balloon.lift * np.array([[1.0, 0.0], [-d, d]])
        squares, shapes = np.linalg.eig(np.linalg.solve(mass, pull))
        slow = int(np.argmin(squares.real))
        phi, psi = shapes[:, slow].real
        low, high = np.sqrt(np.sort(squares.real))
        return float(low), float(high), float(psi / (self.length * phi + d * psi))

    def jerk(self) -> float:
        """Angular velocity that the thread may give the balloon when it becomes taut [rad/s]: an impulse aslant, at the
        knot, on a body of inertia I/m_e = k² is worst at an arm k: ω = v/(2 k)."""
        loose = self.slack * self.length
        speed, scale = self.balloon.terminal(), self.balloon.terminal() * self.balloon.pace()
        arrival = hypot(self.push, speed * sqrt(-expm1(-2 * loose / scale)))
        return arrival / (2 * sqrt(self.balloon.spin_inertia / self.balloon.inertia)) + 1e-9

    @property
    def lean(self) -> float:
        """Angle of the thread from the vertical in the wind [rad]."""
        return atan(self.balloon.resistance * self.wind**2 / self.balloon.lift)

    def build(self, scene: Scene) -> None:
        """A parcel or a scale on the floor, a thread, a balloon over it; in the wind, a fan."""
        balloon, r, windy = self.balloon, self.radius, self.weather == "windy"
        if balloon.lift < 0.2 * balloon.mass * g:
            raise Refusal("R12", f"radius = {r:.3g} m: a lift of {balloon.lift:.2g} N; allowed: a fifth of its weight, "
                          f"{0.2 * balloon.mass * g:.2g} N, or more")  # fmt: skip
        held = self.weight * g if self.anchor == "parcel" else np.inf
        if held < balloon.lift * (1 - 2 * MARGIN):
            raise Refusal("R12", f"weight = {self.weight:.3g} kg is carried away; allowed here: "
                          f"{balloon.lift / g:.4g} kg or more")  # fmt: skip
        if windy:
            self._check_wind(held)
        eye = self._anchor(scene)
        start = eye + (1 - self.slack) * self.length + KNOT * r
        part, buoyant = balloon.put(scene, "balloon", (0.0, 0.0, start), (0.84, 0.27, 0.22))
        scene.touch(part.name("skin"), "stage/floor")
        owner, _ = EYE[self.anchor]
        tie(scene, "thread", part.name("knot"), f"{owner.partition('/')[0]}/eye", self.length, BODY)
        slow, _, shape = self.sway()
        # a taut thread and its balloon are pushed so that they swing as one
        scene.speed[part.name("free")] = (self.push, 0, 0, 0, self.push * shape if self.slack == 0 else 0.0, 0)
        if windy:
            top = eye + self.arm + r
            box = Box((-1.1, 0.0, top / 2 + 0.05), (1.0, 0.0, 0.0), 1.6 + self.arm + r, 2 * r + 0.5, top + 0.1)
            fan(scene, box)
            scene.effects.append(Buoyancy((replace(buoyant, drag_area=0.0),), AIR_DENSITY))
            scene.effects.append(AirStream(box, self.wind, buoyant.drag_area, (BODY,), UNIFORM, AIR_DENSITY))
        else:
            scene.effects.append(Buoyancy((buoyant,), AIR_DENSITY))
        quick = min(1 / slow, 5 / self.jerk(), balloon.pace() / 2 if self.anchor == "scale" else np.inf)
        scene.resolve(time=quick, length=r, duration=self.watch())

    def watch(self) -> float:
        """How long [s]: until it is still, or has swung to and fro."""
        balloon = self.balloon
        slow, _, _ = self.sway()
        rise = balloon.time_to(self.slack * self.length)
        if self.weather == "windy":
            # drag damps a swing in the wind at a steady rate
            calm = rise + log(5e3) * 2 * balloon.inertia / (balloon.resistance * self.wind)
        elif self.push:
            calm = rise + (2 * pi if self.slack else pi * 1.2) / slow
        else:
            calm = rise + (4 * balloon.pace() + 1.0 if self.slack or self.anchor == "scale" else 2.0)
        return float(np.clip(calm, 2.0 if self.slack == 0 else 4.0, 10.0))

    def _check_wind(self, held: float) -> None:
        """Refuse a wind that blows the balloon to the ground, or takes the parcel along."""
        balloon = self.balloon
        steepest = 1.0
        grip = (held - balloon.lift) * GRIP.friction
        strongest = min(balloon.lift * tan(steepest), 0.8 * grip)
        allowed = sqrt(strongest / balloon.resistance)
        if self.wind > allowed:
            what = "takes the parcel along" if 0.8 * grip < balloon.lift * tan(steepest) else "lays the balloon flat"
            raise Refusal("R12", f"wind = {self.wind:.3g} m/s {what}; allowed here: {allowed:.3g} m/s")

    def _anchor(self, scene: Scene) -> float:
        """What holds the thread; returns the height of its eye [m]."""
        scene.material("stage/floor", 2400.0, GRIP)
        if self.anchor == "parcel":
            part = scene.add("parcel")
            body = part.body("parcel")
            body.mass, body.inertia = self.weight, [2 / 3 * self.weight * HALF**2] * 3
            scene.start[part.name("free")] = free_pose((0, 0, HALF))
            for matter in ("parcel", "block"):
                scene.material(part.name(matter), self.weight / (2 * HALF) ** 3, GRIP)
            scene.touch(part.name("block"), "stage/floor")
            return HALF + EYE["parcel"][1]
        part = scene.add("pull_scale")
        mass, stiffness, damping = self.balloon.spring
        part.geom("shaft").mass = mass
        pull = part.joint("pull")
        pull.stiffness, pull.damping, pull.springref = [stiffness, 0, 0], [damping, 0, 0], mass * g / stiffness
        for matter in ("housing", "rod"):
            scene.material(part.name(matter), 7800.0, GRIP)
        scene.coil(Coil(part.name("coil"), part.name("housing"), turns=8, radius=0.018, wire=0.002))
        return 0.1 + EYE["scale"][1]

    def ends(self, run: Run) -> tuple[Array, Array]:
        """Of the thread (T, 3) [m]: at the eye and at the knot."""
        found = []
        for body, height in (EYE[self.anchor], (BODY, -KNOT * self.radius)):
            turn = quaternion_matrix(run.quaternion(body))
            found.append(run.motion.origin[:, run.model.body(body).id] + height * turn[:, :, 2])
        return found[0], found[1]

    @observable("m")
    def span(self, run: Run) -> Array:
        """Distance of the thread's ends; its length when it is taut."""
        eye, knot = self.ends(run)
        return np.asarray(np.linalg.norm(knot - eye, axis=1))

    @observable("rad")
    def angle(self, run: Run) -> Array:
        """Of the line from the eye to the balloon's centre from the vertical, positive along x."""
        line = run.position(BODY) - self.ends(run)[0]
        return np.asarray(np.arctan2(line[:, 0], line[:, 2]))

    @observable("N")
    def pull(self, run: Run) -> Array:
        """Of the thread on the balloon (T, 3), from its change of velocity: what lift and drag do not explain."""
        v, balloon = run.velocity(BODY), self.balloon
        relative = v - np.array([self.wind if self.weather == "windy" else 0.0, 0.0, 0.0])
        drag = -balloon.resistance * np.linalg.norm(relative, axis=1, keepdims=True) * relative
        return np.asarray(balloon.inertia * np.gradient(v, run.t, axis=0) - drag - np.array([0, 0, balloon.lift]))

    def beside(self, run: Run, **changes: float | str) -> Run:
        """A twin in still air, taut and at rest at the start unless said otherwise; NotEvaluated if refused."""
        wanted = {"weather": "still", "anchor": "parcel", "push": 0.0, "slack": 0.0} | changes
        if all(getattr(self, name) == value for name, value in wanted.items()):
            return run
        try:
            return run.again(**wanted)
        except Refusal as why:
            raise NotEvaluated(f"the twin that the law needs is refused ({why})") from None

    @law("T = B", source="Archimedes, On Floating Bodies I, prop. 6", within=(1e-8, 1e-9, 1e-10))
    def pulls_with_all_its_lift(self, run: Run) -> Measurement:
        """31a: what a spring scale reads that holds the thread, k Δx, once a balloon that rose to its end is still."""
        one = self.beside(run, anchor="scale", slack=self.slack)
        pull, speed = one.joint("pull_scale/pull"), one.joint_speed("pull_scale/pull")
        late = between(one.t, one.t[-1] - 0.3, np.inf)
        if np.abs(speed[late]).max() > 1e-3:
            raise NotEvaluated(f"the scale still moves at {np.abs(speed[late]).max():.2g} m/s; needed: 1e-3 m/s")
        return self.balloon.spring[1] * pull[late].mean(), self.balloon.lift

    @law("max |r| = ℓ", source="Goldstein, Classical Mechanics, 3rd ed., §1.3 (a one-sided constraint)",
         within=(5e-3, 1e-3, 2e-4))  # fmt: skip
    def thread_is_never_longer_than_it_is(self, run: Run) -> Measurement:
        """31b: greatest distance of its ends, here and on a twin in still air: it comes to the length, no farther."""
        longest = []
        for one in (run, self.beside(run, push=self.push, slack=self.slack)):
            specimen = cast(BalloonTether, one.specimen)
            longest.append(specimen.span(one).max() / self.length)
        return longest, [1.0, 1.0]

    @law("T = 2π/ω₁, |K - ω₁² M| = 0 (≈ 2π √(m_e (ℓ + d)/B))", source="Landau & Lifshitz, Mechanics, §23 eq. 23.9",
         within=(1e-4, 5e-5, 5e-5), limited_by="a swing of 0.005 rad is not infinitely small")  # fmt: skip
    def sways_like_a_pendulum_upside_down(self, run: Run) -> Measurement:
        """31c: period of a twin's small swings; thread and balloon as two links, with the air that moves along."""
        slow, _, _ = self.sway()
        heaviest = cast(Param, self.declarations()["weight"][0]).high
        twin = self.beside(run, push=SMALL * slow * self.arm, weight=heaviest)
        x, v = twin.position(BODY)[:, 0], twin.velocity(BODY)[:, 0]
        passes = np.sort(np.concatenate([crossings(twin.t[1:], x[1:], v[1:], rising=up) for up in (True, False)]))
        if not len(passes) and twin.t[-1] < 1.1 * pi / slow:
            raise NotEvaluated(f"no half swing within {twin.t[-1]:.3g} s; needed: {pi / slow:.3g} s")
        if not len(passes):
            return np.nan, 2 * pi / slow  # it does not come back
        return 2 * passes[-1] / len(passes), 2 * pi / slow

    @law("tan θ = F/B, F = ½ ρ C A U²", source="Landau & Lifshitz, Fluid Mechanics, §45", within=(1e-2, 3e-3, 5e-4),
         limited_by="drag leaves a last, slow sway")  # fmt: skip
    def leans_in_the_wind(self, run: Run) -> Measurement:
        """31d: angle of thread and balloon in a uniform wind, once they are still (a twin, if this is not windy)."""
        heaviest = cast(Param, self.declarations()["weight"][0]).high
        one = self.beside(run, weather="windy", weight=heaviest)
        specimen = cast(BalloonTether, one.specimen)
        late = between(one.t, one.t[-1] - 0.5, np.inf)
        fastest = np.abs(specimen.velocity(one)[late]).max()
        still = min(0.005, 2e-3 * specimen.sway()[0] * specimen.arm * tan(self.lean))
        if fastest > still:
            raise NotEvaluated(f"after {one.t[-1]:.3g} s it still moves at {fastest:.2g} m/s; needed: {still:.2g} m/s")
        return np.tan(specimen.angle(one)[late].mean()), tan(self.lean)

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the balloon's centre (T, 3)."""
        return run.velocity(BODY)

    @law("W = B", source="Archimedes, On Floating Bodies I, prop. 6", within=(1e-3, 1e-3, 1e-3),
         limited_by="the width of the bracket")  # fmt: skip
    def carries_what_weighs_less_than_its_lift(self, run: Run) -> Measurement:
        """31e: the mass of the parcel that is just not carried off: a little lighter goes, a little heavier stays."""
        critical, masses = self.balloon.lift / g, cast(Param, self.declarations()["weight"][0])
        if not masses.low <= critical * (1 - MARGIN) < critical * (1 + MARGIN) <= masses.high:
            raise NotEvaluated(f"a parcel of {critical:.3g} kg is out of range")

        def stays(weight: float) -> bool:
            height = self.beside(run, weight=weight).position("parcel/parcel")[:, 2]
            return bool(height[-1] - height[0] < 1e-5)

        return threshold(stays, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        balloon = self.balloon
        held = f"a parcel of {1e3 * self.weight:.0f} g" if self.anchor == "parcel" else "a spring scale on the floor"
        start = (
            f"A balloon of {200 * self.radius:.0f} cm hangs on a thread {self.length:.2f} m long, tied to {held}. It "
            f"starts with {self.slack:.0%} of the thread slack"
        )
        pushed = f", pushed sideways at {self.push:.2f} m/s." if self.push else "."
        taut = np.nonzero(self.span(run) > self.length * (1 - 1e-6))[0]
        when = f"After {run.t[taut[0]]:.1f} s" if len(taut) and taut[0] else "From the start"
        pulls = f"{when} the thread is taut, and its tension holds the lift of {balloon.lift:.3f} N."
        if self.weather == "windy":
            ends = (
                f"In a wind of {self.wind:.1f} m/s it leans over, until drag and lift together pull along the thread, "
                f"at {degrees(self.lean):.0f}° from the vertical."
            )
        elif self.push:
            ends = (
                f"Then it sways about the vertical like a pendulum upside down, once in {2 * pi / self.sway()[0]:.1f} "
                f"s, ever less as the air resists."
            )
        else:
            ends = "There it stays, upright and still, as nothing pushes it aside and the parcel weighs more than that."
        return f"{start}{pushed} {pulls} {ends}"
