"""44: a catapult: a spring or a counterweight turns an arm up to a stop, and the ball flies on."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from math import atan2, cos, degrees, inf, pi, sin, sqrt
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from phenomena.parts import ball
from phenomena.stands import DRY
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Part, Scene, free_pose

Array = NDArray[np.float64]

HOLD: Final = 0.8
"""When the arm is let go [s]."""

GAP: Final = 0.006
"""Between the ball and the inner wall of its tray, which it touches not while it flies out [m]."""

BEAM: Final = 0.015
"""Half thickness of the arm [m]."""

IRON: Final = 7800.0
FARTHEST: Final = 9.0
"""Range beyond which a throw is not watched [m]."""


@dataclass(frozen=True)
class Throw:
    """What the balance of energy says: rate of the arm at the stop [rad/s], how long it takes [s], where the ball is
    let go (along, up) [m], its velocity (along, up) [m/s], and where it lands [m]; rides: whether the ball stays in
    its tray till then."""

    rate: float
    time: float
    place: tuple[float, float]
    velocity: tuple[float, float]
    landing: float
    rides: bool


class CatapultLaunch(Phenomenon, domain="mechanics"):
    """A catapult launches a ball: the arm is stopped, the ball is not."""

    drive: Annotated[Literal["spring", "weight"], Choice("a twisted spring or a counterweight")] = "spring"
    stiffness: Annotated[float, Param("N m/rad", 5.0, 200.0, "spring")] = 10.0
    preload: Annotated[float, Param("rad", 0.05, 1.0, "twist of the spring that is left at the stop")] = 0.4
    weight: Annotated[float, Param("kg", 1.0, 30.0, "counterweight")] = 14.0
    long: Annotated[float, Param("m", 0.3, 0.8, "axle to the ball's centre")] = 0.6
    short: Annotated[float, Param("m", 0.1, 0.3, "axle to the counterweight's centre")] = 0.2
    arm: Annotated[float, Param("kg", 0.3, 3.0, "beam")] = 1.0
    mass: Annotated[float, Param("kg", 0.05, 2.0, "ball")] = 0.3
    radius: Annotated[float, Param("m", 0.02, 0.05, "ball")] = 0.04
    cocked: Annotated[float, Param("rad", 0.0, 0.6, "of the arm under the level at the start")] = 0.4
    stop: Annotated[float, Param("rad", 0.5, 1.4, "of the arm over the level at the stop")] = 0.9
    friction: Annotated[float, Param("1", 0.3, 0.9, "of all surfaces")] = 0.6

    @property
    def ends(self) -> tuple[float, float]:
        """Of the beam: its tip at the tray and the other one, from the axle [m]."""
        return -(self.long - self.radius - GAP - 0.01), self.short

    @property
    def bodies(self) -> list[tuple[float, float, float]]:
        """What turns with the arm: mass [kg], place from the axle [m], own moment of inertia [kg m²]; the ball last."""
        (low, high), m = self.ends, self.arm
        parts = [(m, (low + high) / 2, m * ((high - low) ** 2 + (2 * BEAM) ** 2) / 12)]
        if self.drive == "weight":
            parts.append((self.weight, self.short, self.weight * self.edge**2 / 6))
        return [*parts, (self.mass, -self.long, 2 / 5 * self.mass * self.radius**2)]

    @property
    def edge(self) -> float:
        """Of the counterweight, an iron cube [m]."""
        return float((self.weight / IRON) ** (1 / 3))

    @property
    def centre(self) -> float:
        """Of mass of the arm without the ball, from the axle [m]."""
        arm = self.bodies[:-1]
        return sum(m * x for m, x, _ in arm) / sum(m for m, _, _ in arm)

    @property
    def height(self) -> float:
        """Of the axle [m]."""
        behind = self.short * sin(self.stop) + (self.edge if self.drive == "weight" else 0.0)
        return max(self.long * sin(self.cocked) + self.radius + 0.06, behind + 0.06, 0.25)

    @property
    def torque(self) -> float:
        """Stiffness of the spring, if there is one [N m/rad]."""
        return self.stiffness if self.drive == "spring" else 0.0

    @property
    def throw(self) -> Throw:
        """By the balance of energy."""
        return _thrown(self)

    def work(self, low: float, high: float) -> float:
        """Of spring and gravity on arm and ball between two angles of the arm [J]."""
        twist = (self.stop + self.preload - low) ** 2 - (self.stop + self.preload - high) ** 2
        return self.torque * twist / 2 + g * sum(m * x for m, x, _ in self.bodies) * (sin(high) - sin(low))

    def build(self, scene: Scene) -> None:
        """The frame with its stop, the arm held back until it is let go, the ball in its tray, and a target."""
        throw = self.throw
        if not throw.rate > 0:
            raise Refusal("R12", f"{self.drive} too weak: the arm does not come up to its stop; {self._fitting()}")
        if throw.landing > FARTHEST:
            raise Refusal("R12", f"the ball flies {throw.landing:.3g} m, {FARTHEST:g} m are watched; {self._fitting()}")
        part, rough = scene.add("catapult"), Surface(friction=self.friction)
        self._frame(part)
        self._arm(part)
        if self.drive == "spring":
            hinge = part.joint("hinge")
            hinge.stiffness[0], hinge.springref = self.stiffness, degrees(self.stop + self.preload)
        else:
            part.geom("left_spring").size[0] = part.geom("right_spring").size[0] = 0.02
        scene.start[part.name("hinge")] = -self.cocked
        scene.motors.append(Motor(part.name("hinge"), ((0.0, 0.0),), off=HOLD))
        scene.material(part.name("frame"), 700.0, DRY)
        for name in ("arm", "tray", "outer", "inner"):
            scene.material(part.name(name), 700.0, rough)
        scene.material("stage/floor", 2400.0, rough)
        density = self.mass / (4 / 3 * pi * self.radius**3)
        stone = ball(scene, "ball", self.radius, density, Surface(friction=self.friction, restitution=0.4),
                     (0.84, 0.27, 0.22))  # fmt: skip
        stone.geom("ball").mass = self.mass
        lean = (cos(self.cocked / 2), 0.0, -sin(self.cocked / 2), 0.0)
        seat = (-self.long * cos(self.cocked), 0.0, self.height - self.long * sin(self.cocked))
        scene.start[stone.name("free")] = free_pose(seat, lean)
        wall = scene.add("wall")
        wall.body("wall").pos[0] = throw.landing + 0.7
        wall.body("buttress").pos[0] = throw.landing + 0.86
        wall.geom("wall").pos[2], wall.geom("wall").size[1:] = 0.25, (0.5, 0.25)
        for name in (wall.name("wall"), wall.name("buttress")):
            scene.material(name, 1800.0, Surface(friction=self.friction))
        for other in (part.name("tray"), part.name("outer"), part.name("inner"), "stage/floor", wall.name("wall")):
            scene.touch(stone.name("ball"), other)
        target = scene.add("mark")
        target.body("mark").pos[0], target.geom("mark").size[0] = throw.landing, 0.18
        scene.material(target.name("mark"), 700.0, DRY)
        flight = (throw.landing - throw.place[0]) / throw.velocity[0]
        scene.resolve(
            time=2.5 * (self.cocked + self.stop) / throw.rate, length=self.radius,
            duration=min(max(HOLD + throw.time + flight + 1.5, 4.0), 10.0),
        )  # fmt: skip

    def _fitting(self) -> str:
        """The nearest value of what drives it with which it throws, and not too far."""
        name = "stiffness" if self.drive == "spring" else "weight"
        param, value = self.declarations()[name][0], getattr(self, name)
        assert isinstance(param, Param)
        grid = np.geomspace(param.low * 1.001, param.high * 0.999, 60)
        throws = {x: self.make(**(self.values() | {name: float(x)})).throw for x in grid}
        fit = [x for x, there in throws.items() if there.rate > 0 and there.landing < FARTHEST]
        if not fit:
            return f"allowed: none of {name} {param.low:g} to {param.high:g} {param.unit}, but another ball or arm"
        return f"{name} = {value:.3g} {param.unit}; allowed: {min(fit, key=lambda x: abs(x - value)):.3g}"

    def _frame(self, part: Part) -> None:
        high, half = self.height, max(0.55 * self.height + 0.1, 0.25)
        wide = 0.06 + max(self.radius + 0.04, self.edge / 2 + 0.02 if self.drive == "weight" else 0.0)
        for side, y in (("left", wide), ("right", -wide)):
            sill, upright = part.geom(f"{side}_sill"), part.geom(f"{side}_upright")
            sill.pos[1], sill.size[0] = y, half
            for end, x in (("front", half - 0.05), ("rear", 0.05 - half)):
                part.geom(f"{side}_{end}_leg").fromto = (x, y, 0.03, 0, y, high)
            inside = y * (0.03 / wide + 0.1)
            part.geom(f"{side}_spring").fromto = (0, inside, high, 0, 0.85 * y, high)
            upright.fromto = (0, y, high, *self._bar(y))
        for end, x in (("front", half - 0.05), ("rear", 0.05 - half)):
            part.geom(f"{end}_sill").pos[0], part.geom(f"{end}_sill").size[1] = x, wide
        part.geom("axle").fromto = (0, -wide - 0.03, high, 0, wide + 0.03, high)
        part.geom("stop").fromto = (*self._bar(-wide), *self._bar(wide))

    def _bar(self, y: float) -> tuple[float, float, float]:
        """A point of the stop, in front of the arm where that is to end."""
        out, ahead = 0.45 * self.long, BEAM + 0.02
        return (-out * cos(self.stop) + ahead * sin(self.stop), y,
                self.height + out * sin(self.stop) + ahead * cos(self.stop))  # fmt: skip

    def _arm(self, part: Part) -> None:
        """The arm in its own frame, the centre of mass of beam and counterweight."""
        at, r, (low, high) = self.centre, self.radius, self.ends
        part.body("arm").pos[:] = (at, 0, self.height)
        hinge = part.joint("hinge")
        hinge.pos[0], hinge.range = -at, (degrees(-self.cocked) - 30, degrees(self.stop))
        beam, seat = part.geom("beam"), -self.long - at
        beam.pos[0], beam.size[0], beam.mass = (low + high) / 2 - at, (high - low) / 2, self.arm
        beam.size[2] = BEAM
        part.geom("hub").fromto = (-at, -0.025, 0, -at, 0.025, 0)
        wall = r + 0.005
        part.geom("tray").pos[:] = (seat + GAP / 2, 0, -r - 0.005)
        part.geom("tray").size[:] = (r + GAP / 2 + 0.01, r + 0.012, 0.005)
        for name, x in (("outer", -wall), ("inner", wall + GAP)):
            part.geom(name).pos[:], part.geom(name).size[:] = (seat + x, 0, -0.25 * r - 0.005), (0.005, wall, 0.75 * r)
        for name, y in (("left_side", wall + 0.003), ("right_side", -wall - 0.003)):
            part.geom(name).pos[:] = (seat + GAP / 2, y, -0.7 * r)
            part.geom(name).size[:] = (r + GAP / 2 + 0.01, 0.004, 0.3 * r + 0.005)
        load = part.geom("weight")
        if self.drive == "weight":
            load.pos[0], load.size[:], load.mass = self.short - at, self.edge / 2, self.weight
        else:  # the beam's end cap
            load.pos[0], load.size[:], load.mass = self.short - at, (0.012, 0.026, BEAM + 0.006), 0.0

    @observable("rad")
    def arm_angle(self, run: Run) -> Array:
        """Of the arm over the level (T,)."""
        return run.joint("catapult/hinge")

    @observable("rad/s")
    def arm_rate(self, run: Run) -> Array:
        """Of the arm, upwards (T,)."""
        return run.joint_speed("catapult/hinge")

    @observable("m")
    def ball_place(self, run: Run) -> Array:
        """Of the ball (T, 3)."""
        return run.position("ball/ball")

    @observable("m/s")
    def ball_velocity(self, run: Run) -> Array:
        """Of the ball (T, 3)."""
        return run.velocity("ball/ball")

    @observable("J")
    def ball_energy(self, run: Run) -> Array:
        """Kinetic and potential energy of the ball, from the ground (T,)."""
        return run.kinetic("ball/ball") + self.mass * g * self.ball_place(run)[:, 2]

    def seat(self, run: Run) -> Array:
        """Of the ball from the axle in the arm's own axes: along the arm and ahead of it (T, 2)."""
        out = self.ball_place(run) - (0.0, 0.0, self.height)
        s, c = np.sin(self.arm_angle(run)), np.cos(self.arm_angle(run))
        return np.column_stack([-out[:, 0] * c + out[:, 2] * s, out[:, 0] * s + out[:, 2] * c])

    def stopped(self, run: Run) -> NDArray[np.bool_]:
        """Samples since the arm met its stop (T,): it may have fallen back when the next one is taken."""
        rate = self.arm_rate(run)
        turning = np.logical_or.accumulate(rate > 0.1 * rate.max())
        return np.logical_or.accumulate(turning & (rate < 1e-6 * rate.max()))

    def flight(self, run: Run) -> NDArray[np.bool_]:
        """Samples from when the arm has stopped and the ball is clear of its tray until that meets anything."""
        away = np.linalg.norm(self.seat(run) - (self.long, 0.0), axis=1) > 2 * self.radius
        clear = np.flatnonzero(self.stopped(run) & away)
        if not len(clear):
            raise NotEvaluated("the arm has not come up to its stop and thrown the ball out of its tray")
        start = run.t[clear[0]] - run.step / 2
        return between(run.t, start, min([i.time for i in run.impacts if i.time > start], default=inf))

    def released(self, run: Run) -> tuple[Array, Array]:
        """Place (2,) and velocity (2,) of the ball at the stop, along and up: those at the first sample of its flight
        taken back to the height of the release."""
        first = int(np.argmax(self.flight(run)))
        place, v = self.ball_place(run)[first, ::2], self.ball_velocity(run)[first, ::2]
        rise = place[1] - self.throw.place[1]
        up = sqrt(max(v[1] ** 2 + 2 * g * rise, 0.0))
        return np.array([place[0] - v[0] * (up - v[1]) / g, self.throw.place[1]]), np.array([v[0], up])

    def staged(self, run: Run, **changes: Any) -> tuple[CatapultLaunch, Run]:
        """The specimen with these changes and its run, this one or a twin; NotEvaluated if the ball does not ride."""
        there = self.make(**(self.values() | changes))
        if not there.throw.rides or there.throw.landing > FARTHEST:
            raise NotEvaluated("the arm does not come up, or the ball leaves its tray before, touching it or too fast")
        return there, run if there == self else run.again(**changes)

    @law("½ (I + m b² + I_b) Ω² = ½ k (φ₀² - φ₁²) - g Δ(M_a z_a + m z_b)", source="Landau & Lifshitz, Mechanics, §6 "
         "and §32 eq. 32.8", within=(2e-2, 5e-3, 2e-3))  # fmt: skip
    def spring_throws(self, run: Run) -> Measurement:
        """44a: speed of the ball when the arm is stopped, against Ω b (a twin with a spring if this has a weight)."""
        there, twin = self.staged(run, drive="spring")
        return np.linalg.norm(there.released(twin)[1]), self._as("spring").throw.rate * self.long

    def _as(self, drive: str) -> CatapultLaunch:
        return self.make(**(self.values() | {"drive": drive}))

    @law("½ I Ω² = M_c g |Δz_c| - g Δ(M_a z_a + m z_b), ½ m v² < M_c g |Δz_c|", source="Landau & Lifshitz, Mechanics, "
         "§6; Denny, Eur. J. Phys. 26 (2005) 561, §2", within=(2e-2, 5e-3, 2e-3))  # fmt: skip
    def counterweight_throws(self, run: Run) -> Measurement:
        """44b: speed of the ball as above, and the part of the counterweight's work that it takes along (a twin with a
        counterweight if this has a spring)."""
        there, twin = self.staged(run, drive="weight")
        speed = float(np.linalg.norm(there.released(twin)[1]))
        height = there.short * (sin(there.stop) + sin(there.cocked))
        taken = self.mass * speed**2 / 2 / (self.weight * g * height)
        expected = self._as("weight").throw.rate * self.long
        if taken >= 1:
            return [speed, np.nan], [expected, np.nan]
        return [speed, taken], [expected, self.mass * expected**2 / 2 / (self.weight * g * height)]

    @law("x = x_r + v_x (v_z + √(v_z² + 2 g (z_r - R)))/g", source="Galilei, Discorsi (1638), fourth day; Landau & "
         "Lifshitz, Mechanics, §11", within=(5e-3, 1e-3, 1e-4))  # fmt: skip
    def ball_flies_a_parabola(self, run: Run) -> Measurement:
        """44c: where the ball lands, from its place and velocity just after the stop; and heights on the way."""
        free = np.flatnonzero(self.flight(run))
        landed = [i for i in run.impacts if i.time > run.t[free[0]] and "stage/floor" in (i.first, i.second)]
        if not landed:
            raise NotEvaluated("the ball has not landed")
        place, v = self.ball_place(run)[free], self.ball_velocity(run)[free]
        fall = (v[0, 2] + sqrt(v[0, 2] ** 2 + 2 * g * (place[0, 2] - self.radius))) / g
        s = run.t[free] - run.t[free[0]]
        expected = place[0, 2] + v[0, 2] * s - g * s**2 / 2
        return [landed[0].position[0], *place[:, 2]], [place[0, 0] + v[0, 0] * fall, *expected]

    @law("v ⟂ arm", source="Landau & Lifshitz, Mechanics, §31 eq. 31.2: v = Ω × r", unit="rad",
         within=(2e-2, 1e-2, 5e-3))  # fmt: skip
    def ball_leaves_at_right_angles(self, run: Run) -> Measurement:
        """44d: direction of the ball's velocity at the stop, over the level."""
        there, twin = self.staged(run)
        v = there.released(twin)[1]
        return atan2(v[1], v[0]), pi / 2 - there.stop

    @law("r = const in the arm's axes", source="by definition: what rides in a tray moves with it", unit="m",
         within=(1e-3, 1e-4, 1e-5))  # fmt: skip
    def ball_rides_in_its_tray(self, run: Run) -> Measurement:
        """Way of the ball in the axes of the arm until that is stopped."""
        there, twin = self.staged(run)
        riding = ~there.stopped(twin)
        return np.linalg.norm(there.seat(twin)[riding] - (there.long, 0.0), axis=1).max(), 0.0

    @law("θ ≤ θ_s", source="by definition: a stop", unit="rad", within=(1e-6, 1e-6, 1e-6))
    def the_stop_holds_the_arm(self, run: Run) -> Measurement:
        """Way of the arm beyond its stop, and its angle at the end if spring or counterweight press it to the stop."""
        angle = self.arm_angle(run)
        pressing = self.torque * self.preload + g * cos(self.stop) * sum(m * x for m, x, _ in self.bodies[:-1])
        # otherwise the arm falls back when it has thrown
        return [max(angle.max(), self.stop), angle[-1] if pressing > 0 else self.stop], [self.stop, self.stop]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        drive = {
            "spring": f"A twisted spring of {self.stiffness:.3g} N m/rad",
            "weight": f"A counterweight of {self.weight:.3g} kg",
        }[self.drive]
        landed = [i for i in run.impacts if "stage/floor" in (i.first, i.second)]
        speed = np.linalg.norm(self.ball_velocity(run)[self.flight(run)][0])
        end = f"lands {landed[0].position[0]:.2f} m away" if landed else "flies on"
        return (
            f"{drive} turns the arm of a catapult, with a red ball of {self.mass:.2g} kg in the tray at its end, from "
            f"{degrees(self.cocked):.0f} degrees under the level to {degrees(self.stop):.0f} over it, where a bar "
            f"stops the arm. The ball goes on at {speed:.1f} m/s, at right angles to the arm: part of the work "
            f"went into turning the beam. It flies along a parabola and {end}."
        )


@functools.lru_cache(maxsize=64)
def _thrown(one: CatapultLaunch) -> Throw:
    inertia = sum(own + m * x * x for m, x, own in one.bodies)
    moment = sum(m * x for m, x, _ in one.bodies)
    angles = np.linspace(-one.cocked, one.stop, 200)
    work = np.array([one.work(-one.cocked, a) for a in angles])
    if not (work[1:] > 0).all():
        return Throw(0.0, inf, (0.0, 0.0), (0.0, 0.0), 0.0, False)
    squares = 2 * work / inertia
    turning = (one.torque * (one.stop + one.preload - angles) + g * moment * np.cos(angles)) / inertia
    pressed = (one.long * turning + g * np.cos(angles) > 0) & (one.long * squares - g * np.sin(angles) > 0)
    rate = float(sqrt(squares[-1]))
    place = (-one.long * cos(one.stop), one.height + one.long * sin(one.stop))
    velocity = (rate * one.long * sin(one.stop), rate * one.long * cos(one.stop))
    fall = (velocity[1] + sqrt(velocity[1] ** 2 + 2 * g * (place[1] - one.radius))) / g
    # gravity draws the ball back to the inner wall, while it must come out of the tray
    fallen = sqrt(2 * GAP / (g * sin(one.stop)))
    out = rate * one.long * fallen - g * cos(one.stop) * fallen**2 / 2
    motion = solve_ivp(
        lambda _, y: (y[1], (one.torque * (one.stop + one.preload - y[0]) + g * moment * cos(y[0])) / inertia),
        (0.0, 20.0), (-one.cocked, 0.0), events=_stopped(one.stop), rtol=1e-6,
    )  # fmt: skip
    rides = bool(pressed.all() and out > one.radius)
    return Throw(rate, float(motion.t[-1]), place, velocity, place[0] + velocity[0] * fall, rides)


def _stopped(angle: float) -> Any:
    def passes(_: float, state: Array) -> float:
        return float(state[0] - angle)

    passes.terminal = True  # type: ignore[attr-defined]
    return passes
