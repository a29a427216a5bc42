"""15: a pillar in uniform rotation: its paddles strike balls or a clapper, or seats swing out from it."""

from __future__ import annotations

from math import asin, ceil, cos, floor, log10, pi, sin, sqrt
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phenomena.parts import sphere_mass
from phenomena.pillars import AXLE, COLUMN, SEATS, THICKNESS, NearPillar, angular_momentum, first_impact, integral
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, fit
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene

Array = NDArray[np.float64]

SWING: Final = "clapper/swing"
ROD: Final = 0.38
"""From the clapper's pivot to its ball's centre [m]."""

RUBBING: Final = 0.9
"""Friction of a ball that is to be wedged."""


class UniformPanelSpin(NearPillar, domain="mechanics"):
    """Objects near a uniformly rotating pillar: paddles strike balls, seats of a carousel swing out."""

    near: Annotated[
        Literal["balls", "clapper", "seats", "wedge"],
        Choice("what is near: balls on the floor; a ball on a rod that comes back; seats; a ball before a wall"),
    ] = "balls"
    speed: Annotated[float, Param("rad/s", 0.5, 8.0, "of the pillar")] = 2.0
    drive: Annotated[
        Literal["prescribed", "limited"], Choice("the motor holds its speed at any torque, or has a greatest one")
    ] = "prescribed"
    torque: Annotated[float, Param("N m", 0.01, 50.0, "greatest torque of a limited motor")] = 5.0
    release: Annotated[float, Param("1", 0.0, 1.2, "first angle of the seats, over that of steady rotation")] = 0.5

    @property
    def fastest(self) -> float:
        """Highest angular velocity in a scene [rad/s]."""
        return self.speed

    def omega(self, t: ArrayLike) -> Array:
        """Angular velocity that the pillar is to have [rad/s]."""
        return np.full(np.shape(t), self.speed)

    def phase(self, t: ArrayLike) -> Array:
        """Angle that it is to have turned by [rad]."""
        return self.speed * np.asarray(t)

    @property
    def interval(self) -> float:
        """Between two paddles [s]."""
        return 2 * pi / (self.paddles * self.speed)

    def build(self, scene: Scene) -> None:
        """A pillar on a motor, and what is near it."""
        {"balls": self._balls, "clapper": self._clapper, "seats": self._seats, "wedge": self._wedge}[self.near](scene)
        scene.start[AXLE], scene.speed[AXLE] = 0.0, self.speed
        force = {"force": self.torque} if self.drive == "limited" else {}
        scene.motors.append(Motor(AXLE, ((0.0, self.speed),), **force))

    def _balls(self, scene: Scene) -> None:
        self.balls(scene)
        watch = self.turns[1] / self.speed + 2.0
        scene.resolve(time=self.strike_time(self.speed), length=self.radius, duration=min(max(5.0, watch), 10.0))

    def _clapper(self, scene: Scene) -> None:
        _, paddles = self.raise_paddles(scene)
        scene.material("stage/floor", 2400.0, Surface(friction=0.4, restitution=0.4))
        part = scene.add("clapper")
        reach = self.reach
        azimuth = self.azimuths[0]
        part.body("post").pos = (reach * cos(azimuth), reach * sin(azimuth), 0.0)
        part.body("post").quat = (cos(azimuth / 2), 0, 0, sin(azimuth / 2))
        away = self.paddle + 0.12 - reach + 2 * self.radius  # of the post, clear of the paddles' ends
        for name in ("upright", "arm"):
            ends = part.geom(name).fromto
            ends[3] = away
            if name == "upright":
                ends[0] = away
        part.geom("foot").pos[0] = away
        geom = part.geom("ball")
        geom.size[0], geom.mass = self.radius, self.mass
        surface = Surface(restitution=self.restitution)
        scene.material(part.name("ball"), self.density, surface)
        scene.material(part.name("post"), 700.0, surface)
        for paddle in paddles:
            scene.touch(part.name("ball"), paddle)
        scene.resolve(time=0.4, length=self.radius, duration=min(max(5.0, 3.5 * self.interval), 10.0))

    @property
    def reach(self) -> float:
        """Distance of the clapper from the axle [m]: almost at the paddles' ends, which soon have passed."""
        return 0.99 * sqrt(self.paddle**2 + (THICKNESS + self.radius) ** 2)

    def _seats(self, scene: Scene) -> None:
        self.seats(scene, self.release * self.carousel.steady(self.speed))
        time = min(sqrt(self.hanger / g), 1 / self.speed)
        scene.resolve(time=time, length=self.arm, duration=6.0)

    def _wedge(self, scene: Scene) -> None:
        if self.drive == "prescribed":
            raise Refusal("R12", "drive = 'prescribed': a motor that nothing stops would crush the wedged ball; "
                          "allowed: 'limited'")  # fmt: skip
        leans = self.azimuths[0] + asin(self.radius / self.distance) + 1e-3 / self.distance  # direction of the wall
        inner, outer, half = max(self.distance - self.radius, COLUMN + 0.02), self.paddle + 0.1, 0.02
        if leans + 2 * half / inner > 2 * pi / self.paddles - THICKNESS / inner:
            raise Refusal("R1", f"paddles = {self.paddles}: no room for ball and wall between two of them; "
                          f"allowed: {self.paddles - 1}")  # fmt: skip
        (part,) = self.balls(scene, count=1, rubbing=RUBBING)
        wall = scene.add("block", "wall")
        scene.spec.delete(wall.joint("free"))
        wall.geom("block").size[:], middle = ((outer - inner) / 2, half, 0.06), (outer + inner) / 2
        wall.geom("block").rgba = (0.78, 0.47, 0.38, 1.0)
        wall.body("block").pos = (
            middle * cos(leans) - half * sin(leans), middle * sin(leans) + half * cos(leans), 0.06
        )  # fmt: skip
        wall.body("block").quat = (cos(leans / 2), 0, 0, sin(leans / 2))
        scene.material(wall.name("block"), 1900.0, Surface(friction=2 * RUBBING, restitution=self.restitution))
        scene.touch(wall.name("block"), part.name("ball"))
        for k in range(self.paddles):
            scene.touch(wall.name("block"), f"pillar/paddle{k}")
        watch = self.turns[0] / self.speed + 2.0
        # the ball is knocked to and fro ever faster, until its impacts are taken together: that takes fine steps
        time = min(0.2, 0.4 / self.speed)
        scene.resolve(time=time, length=self.radius, duration=min(max(4.0, watch), 10.0))

    @observable("rad")
    def turned(self, run: Run) -> Array:
        """Angle that the pillar has turned by (T,)."""
        return run.joint(AXLE)

    def staged(self, run: Run, **changes: Any) -> tuple[UniformPanelSpin, Run]:
        """The specimen with these changes, and its run: this one, or a twin."""
        there = self.make(**(self.values() | changes))
        return there, run if there == self else run.again(**changes)

    @law("v' = v + (1+e) [(Ω × r_c) - v]·n n", within=(1e-8, 1e-8, 1e-8),
         source="Newton, Principia, Axioms, corollaries 3 and 6; Routh, Dynamics of a System of Rigid Bodies I, §179",
         limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def paddles_strike_with_their_speed(self, run: Run) -> Measurement:
        """15a: velocities of balls after the strikes of a paddle that nothing slows down (a twin, if need be)."""
        smooth = {} if self.clear((1 + self.restitution) * self.speed * self.lever) else {"floor_friction": 0.0}
        there, twin = self.staged(run, near="balls", drive="prescribed", **smooth)
        return there.struck(twin)

    @law("Ω t = φ - asin((d + r)/R)", source="by definition: when the face of a paddle has come to the ball's surface",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def balls_are_struck_when_a_paddle_comes(self, run: Run) -> Measurement:
        """15a: times at which the two balls are first struck (the second, if nothing else has struck it before)."""
        there, twin = self.staged(run, near="balls", drive="prescribed")
        seen = [first_impact(twin, f"ball{k}/ball") for k in range(2)]
        due = [turn / self.speed for turn in there.turns]
        whole = 2 if seen[1] > due[1] - 1e-3 and due[1] < twin.t[-1] else 1
        return np.array(seen[:whole]) / due[0], np.array(due[:whole]) / due[0]

    @law("tan θ = Ω² (a + ℓ sin θ)/g", source="Huygens, Horologium oscillatorium (1673) part V, theorems VII-XI: the "
         "conical pendulum", within=(1e-5, 1e-5, 1e-5), limited_by="what is left of the swing")  # fmt: skip
    def seats_swing_out(self, run: Run) -> Measurement:
        """15b: angle at which seats come to rest on the pillar, mean over the last half second."""
        _, twin = self.settled(run)
        last = between(twin.t, twin.t[-1] - 0.5, np.inf)
        angle, rate = np.abs(twin.joint("pillar/hang0")[last]), np.abs(twin.joint_speed("pillar/hang0")[last])
        if rate.max() > 1e-5 * angle.max():
            raise NotEvaluated(f"the seats still swing at {rate.max():.2g} rad/s")
        theta = np.array([twin.joint(f"pillar/hang{k}")[last].mean() for k in range(SEATS)])
        return np.tan(theta), self.speed**2 * (self.arm + self.hanger * np.sin(theta)) / g

    def settled(self, run: Run) -> tuple[UniformPanelSpin, Run]:
        """Seats that are let go away from steady rotation and come to it, damped so that they soon do (a twin, if need
        be)."""
        best = min(3.0, 0.9 * self.carousel.rate(self.speed))
        slow = {} if 0.7 * best < self.settling <= best else {"settling": max(floor(5 * best) / 5, 0.2)}
        away = {} if self.release < 0.8 else {"release": 0.5}
        return self.staged(run, near="seats", drive="prescribed", **slow, **away)

    @law("Δt = 2π/(n Ω)", source="by definition: n paddles, Ω/2π turns a second",
         within=(1e-8, 1e-8, 1e-8), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def paddles_come_at_even_intervals(self, run: Run) -> Measurement:
        """15c: times between strikes of the clapper, which has come to rest at its place before each (a twin, if the
        paddles are too quick or too slow for that)."""
        due = self.paddles * self.speed < 2 * pi / 1.3 and self.speed > 1.7
        suited = {} if due else {"paddles": 2, "speed": min(max(self.speed, 1.8), 2.4)}
        there, twin = self.staged(run, near="clapper", drive="prescribed", **suited)
        angle, rate = twin.joint(SWING), twin.joint_speed(SWING)
        times: list[float] = []
        for impact in there.strikes(twin):
            before = int(np.searchsorted(twin.t, impact.time)) - 1
            rests = abs(angle[before]) < 1e-6 and abs(rate[before]) < 1e-6
            if rests and (not times or impact.time > times[-1] + 0.1 * there.interval):
                times.append(impact.time)
        if len(times) < 2:
            raise NotEvaluated(f"the clapper was struck {len(times)} times at rest; needed: 2")
        return np.diff(times), np.full(len(times) - 1, there.interval)

    @law("∫ τ Ω dt = Ω ΔL = ΔE + ∫ Σ c θ̇² dt", source="Landau & Lifshitz, Mechanics, §39 eq. 39.13: E - L·Ω in a "
         "rotating frame", within=(4e-4, 4e-5, 1e-5))  # fmt: skip
    def the_motor_pays_for_the_swing(self, run: Run) -> Measurement:
        """15d: work of the motor, torque being what changes the angular momentum, at every sample; over the whole."""
        there, twin = self.settled(run)
        work = self.speed * (angular_momentum(twin) - angular_momentum(twin)[0])
        energy = twin.motion.kinetic + twin.motion.potential
        rates = np.sum([twin.joint_speed(f"pillar/hang{k}") ** 2 for k in range(SEATS)], axis=0)
        return work, energy - energy[0] + integral(twin.t, there.carousel.damping * rates)

    @law("Ω = const", source="by definition: a motor that nothing slows down", within=(1e-10, 1e-10, 1e-10))
    def a_strong_motor_holds_the_speed(self, run: Run) -> Measurement:
        """15d: angular velocity at every sample, with balls or seats for a load."""
        _, twin = self.staged(run, near="balls" if self.near == "wedge" else self.near, drive="prescribed")
        seen = twin.joint_speed(AXLE)
        return seen, np.full(seen.shape, self.speed)

    @law("Ω' = Ω - J r/I, J = (1+e) Ω r/(1/m + r²/I); then I Ω̇ = τ", within=(1e-6, 1e-6, 1e-6),
         source="Routh, Dynamics of a System of Rigid Bodies I, §§169-171",
         limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def a_limited_motor_gives_way_and_recovers(self, run: Run) -> Measurement:
        """15d: angular velocity lost to the first ball (or to two at once), and the rate at which the motor makes up
        for it, over what they should be (a twin with heavy balls and a torque that takes about a fifth of a second)."""
        heavy = sphere_mass(self.radius, max(self.density, 7800.0))

        def loses(balls: int) -> float:
            arms = balls * self.lever**2
            return (1 + self.restitution) * self.speed * arms / (self.inertia / heavy + arms)

        lost = loses(1)
        torque = min(max(10 ** round(log10(self.inertia * lost / 0.2), 1), 0.01), 50.0)
        there, twin = self.staged(
            run, near="balls", drive="limited", torque=torque, density=max(self.density, 7800.0), floor_friction=0.0
        )
        if there.too_gentle(twin, self.speed * self.lever):
            raise NotEvaluated("so gentle a strike counts as one without rebound")
        when = first_impact(twin, "ball0/ball")
        lost = loses(sum(first_impact(twin, f"ball{k}/ball") < when + 1e-6 for k in range(2)))
        recovers = when + self.inertia * lost / torque
        others = min([i.time for i in twin.impacts if i.time > when + 1e-9], default=np.inf)
        part = between(twin.t, when, min(recovers, others), least=4)
        start, rate = fit(twin.t[part], twin.joint_speed(AXLE)[part], 1)
        after = start - rate * (twin.t[part][0] - when)
        return [(self.speed - after) / lost, rate * self.inertia / torque], [1.0, 1.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        turns = f"A striped pillar turns at {self.speed:.1f} rad/s"
        if self.near == "seats":
            theta = self.carousel.steady(self.speed)
            return (
                f"{turns}, a carousel with four seats on hangers of {self.hanger:.2f} m. Let go at "
                f"{np.degrees(self.release * theta):.0f} degrees from the vertical, they swing outwards until gravity "
                f"can just turn their motion inwards: the faster the pillar, the wider. "
                f"{'They settle at' if self.settling > 0.8 else 'They swing about'} {np.degrees(theta):.0f} degrees, "
                f"whatever the riders weigh, and the motor supplies the energy."
            )
        n = f"{self.paddles} paddle{'s' if self.paddles > 1 else ''} of {self.paddle:.2f} m"
        if self.near == "clapper":
            return (
                f"{turns} with {n} past a red ball that hangs on a rod. Every {self.interval:.2f} s a paddle knocks "
                f"the ball away, by (1+e) times the paddle's own speed there; it swings up, falls back against its pad "
                f"and waits for the next. The motor keeps the pillar's speed through every one of the "
                f"{ceil(run.t[-1] / self.interval - 0.5)} passages."
            )
        if self.near == "wedge":
            return (
                f"{turns} with {n}, driven by a motor of no more than {self.torque:.3g} N m. A paddle catches a red "
                f"ball of {self.mass:.2g} kg and drives it against a wall. Neither ball nor wall gives way, and after "
                f"a few blows to and fro the torque is balanced: the pillar "
                f"{'stalls' if abs(run.joint_speed(AXLE)[-1]) < 1e-3 else 'is held back'}, and nothing is crushed."
            )
        hits = len(self.strikes(run))
        return (
            f"{turns} with {n} over a floor on which a red and a blue ball of {self.mass:.2g} kg lie in reach. A "
            f"paddle comes up behind each and knocks it away at (1+e) times its own speed there, "
            f"{(1 + self.restitution) * self.speed * self.lever:.2f} m/s, whatever the ball weighs. Balls that the "
            f"rails send back are struck again: {hits} strikes in {run.t[-1]:.0f} s."
        )
