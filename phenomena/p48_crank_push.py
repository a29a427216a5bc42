"""48: a crank, a rod and a slider that pushes a block over a table."""

from __future__ import annotations

from math import pi, sqrt
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Part, Scene, free_pose

Array = NDArray[np.float64]

BLOCK: Final = 0.05
"""Half edge of the block [m]."""

STEEL: Final = 7800.0
STANDSTILL: Final = 0.5
"""How long the motor stands still at first [s]."""

STRONGEST: Final = 500.0
NEAR: Final = 1e-4
"""Gap below which plate and block are said to meet [m]."""

LEAST: Final = 0.02
"""Part of the motor's work that friction has to take, to be told from what remains of work and energy."""

JAM: Final = 0.5
"""Part of the stroke that is left to the block before it jams against the stop."""


class CrankPush(Phenomenon, domain="mechanics"):
    """A crank turns and its slider pushes a block; the block leaves the slider where that brakes too hard."""

    radius: Annotated[float, Param("m", 0.03, 0.2, "crank")] = 0.1
    ratio: Annotated[float, Param("1", 2.0, 6.0, "length of the rod over the crank's")] = 3.0
    speed: Annotated[float, Param("rad/s", 1.0, 10.0, "at which the motor turns the crank")] = 6.0
    torque: Annotated[float, Param("N m", 0.01, STRONGEST, "greatest of the motor")] = 40.0
    slider: Annotated[float, Param("kg", 0.2, 3.0, "crosshead with its plate")] = 0.8
    guide: Annotated[float, Param("N", 0.0, 20.0, "friction of the guide bars")] = 4.0
    block: Annotated[float, Param("kg", 0.1, 5.0, "pushed block")] = 1.0
    friction: Annotated[float, Param("1", 0.05, 0.9, "between block and table")] = 0.25
    place: Annotated[float, Param("1", 0.0, 0.4, "way of the plate to the block, in strokes")] = 0.0
    stop: Annotated[Literal["absent", "ahead"], Choice("a stone on the table that jams the block in mid-stroke")] = (
        "absent"
    )
    turns: Annotated[int, Param("1", 1, 6, "of the crank to be watched, if ten seconds suffice")] = 4

    @property
    def rod(self) -> float:
        """Length between its pins [m]."""
        return self.ratio * self.radius

    @property
    def axle(self) -> float:
        """Height of the axle, the slider and the middle of the block [m]."""
        return self.radius + 0.15

    @property
    def reach(self) -> float:
        """From the wrist pin to the plate's face [m]."""
        return 2 * self.radius + 0.12

    @property
    def rest(self) -> float:
        """Middle of the block at the start [m]."""
        return self.rod - self.radius + 2 * self.radius * self.place + self.reach + BLOCK

    @property
    def disc(self) -> tuple[float, float]:
        """Of the crank: mass [kg] and moment of inertia [kg m²]."""
        outer = self.radius + 0.04
        mass = STEEL * pi * outer**2 * 0.02
        return mass, mass * outer**2 / 2

    @property
    def bar(self) -> tuple[float, float]:
        """Of the rod, a flat bar: mass [kg] and moment of inertia about its middle [kg m²]."""
        half = self.rod / 2 + 0.015
        mass = STEEL * 8 * half * 0.006 * 0.011
        return mass, mass * (half**2 + 0.011**2) / 3

    @property
    def rise(self) -> float:
        """How long the motor takes to come to speed, within one radian [s]."""
        return 2 / self.speed

    @property
    def edge(self) -> float:
        """Right edge of the table [m]."""
        longest = (1.3 * self.radius * self.speed) ** 2 / (2 * self.friction * g)
        return self.rod + self.radius + self.reach + 2 * BLOCK + min(longest, 0.7) + 0.15

    def course(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Crank angle that the motor is set to at times t, its rate and its acceleration."""
        s = np.clip(np.asarray(t, float) - STANDSTILL, 0.0, None)
        up = np.minimum(s, self.rise)
        rate = self.speed * up / self.rise
        angle = pi + rate * up / 2 + self.speed * (s - up)
        return angle, rate, np.where((s > 0) & (s < self.rise), self.speed / self.rise, 0.0)

    def when(self, angle: float) -> float:
        """Time at which the motor brings the crank to an angle of π or more [s]."""
        way = angle - pi
        return STANDSTILL + (self.rise * sqrt(way) if way < 1 else self.rise + (way - 1) / self.speed)

    def wrist(self, angle: ArrayLike) -> tuple[Array, Array, Array]:
        """Distance x of the wrist pin from the axle [m], and x' and x'' by the crank angle."""
        s, c = np.sin(angle), np.cos(angle)
        r, root = self.radius, np.sqrt(self.rod**2 - (self.radius * np.sin(angle)) ** 2)
        first = -r * s - r * r * s * c / root
        return r * c + root, first, -r * c - r * r * (c * c - s * s) / root - r**4 * s * s * c * c / root**3

    def inertia(self, angle: ArrayLike) -> Array:
        """Moment J at the crank of all that it moves but the block: its kinetic energy is ½ J θ̇² [kg m²]."""
        r, l = self.radius, self.rod  # noqa: E741  (as in the equation)
        _, along, _ = self.wrist(angle)
        s, c = np.sin(angle), np.cos(angle)
        tilt = r * c / np.sqrt(l**2 - (r * s) ** 2)
        mass, moment = self.bar
        middle = (along - r * s) ** 2 / 4 + (r * c) ** 2 / 4
        return np.asarray(self.disc[1] + mass * middle + moment * tilt**2 + self.slider * along**2)

    def needed(self) -> float:
        """Greatest torque that the course asks of the motor, the block against the plate from the start [N m].

        By Lagrange's equation J θ̈ + ½ J' θ̇² + V' = τ + forces of friction and of the block.
        """
        t = np.linspace(STANDSTILL, self.when(3 * pi + 1), 4000)
        angle, rate, turning = self.course(t)
        _, along, bend = self.wrist(angle)
        slope = (self.inertia(angle + 1e-5) - self.inertia(angle - 1e-5)) / 2e-5
        torque = self.inertia(angle) * turning + slope * rate**2 / 2 + self.guide * np.abs(along)
        torque += self.bar[0] * g * self.radius * np.cos(angle) / 2
        push = bend * rate**2 + along * turning + self.friction * g
        torque += np.where((push > 0) & (along > 0) & (angle < 2 * pi), self.block * push * along, 0.0)
        return float(np.abs(torque).max())

    def build(self, scene: Scene) -> None:
        """The mechanism on its posts, the table with the block, and perhaps a stop."""
        part = scene.add("crank")
        self.set_up(part)
        scene.start[part.name("axle")] = pi
        scene.start[part.name("pin")] = -pi
        scene.start[part.name("guide")] = -2 * self.radius
        course = ((0.0, 0.0), (STANDSTILL, 0.0), (STANDSTILL + self.rise, self.speed))
        scene.motors.append(Motor(part.name("axle"), course, force=self.torque))
        wood = Surface(friction=self.friction)
        for name, density in (("base", STEEL), ("table", 700.0), ("crank", STEEL), ("rod", STEEL), ("slider", STEEL)):
            scene.material(part.name(name), density, wood)
        scene.material(part.name("plate"), STEEL, wood)
        scene.material(part.name("top"), 700.0, wood)
        scene.material("stage/floor", 2400.0, wood)
        block = scene.add("block")
        geom = block.geom("block")
        geom.size[:], geom.mass, geom.rgba = BLOCK, self.block, (0.84, 0.27, 0.22, 1.0)
        scene.start[block.name("free")] = free_pose((self.rest, 0.0, self.axle))
        scene.material(block.name("block"), self.block / (2 * BLOCK) ** 3, wood)
        for other in (part.name("top"), part.name("plate"), "stage/floor"):
            scene.touch(block.name("block"), other)
        if self.stop == "ahead":
            stone = scene.add("stop")
            left = 2 * self.radius * (1 - self.place) * JAM
            stone.body("stop").pos[:] = (self.rest + BLOCK + left, 0.0, self.axle - BLOCK)
            scene.material(stone.name("stop"), 2700.0, wood)
            scene.touch(block.name("block"), stone.name("stop"))
        watched = min(max(self.when(pi + 1 + 2 * pi * self.turns), 2.0), 10.0)
        scene.resolve(time=3 / self.speed, length=BLOCK, duration=watched)

    def set_up(self, part: Part) -> None:
        """Give the mechanism its sizes and masses."""
        r, rod, high = self.radius, self.rod, self.axle
        disc, bar = part.geom("disc"), part.geom("bar")
        part.body("crank").pos[2] = part.body("slider").pos[2] = high
        disc.size[0], disc.mass = r + 0.04, self.disc[0]
        part.geom("web").pos[0], part.geom("web").size[0] = r / 2, r / 2 + 0.015
        part.geom("pin").fromto = (r, -0.072, 0, r, -0.01, 0)
        part.body("rod").pos[0], part.joint("pin").pos[0] = r + rod / 2, -rod / 2
        bar.size[0], bar.mass = rod / 2 + 0.015, self.bar[0]
        for end, x in (("big_end", -rod / 2), ("small_end", rod / 2)):
            part.geom(end).fromto = (x, -0.009, 0, x, 0.009, 0)
        part.site("wrist").pos[0] = rod / 2
        part.body("slider").pos[0] = rod + r
        part.geom("crosshead").mass = self.slider
        part.joint("guide").frictionloss = self.guide
        part.geom("push_bar").fromto = (0.02, 0, 0, self.reach - 0.02, 0, 0)
        part.geom("plate").pos[0] = self.reach - 0.01
        part.geom("pedestal").pos[2] = part.geom("pedestal").size[2] = high / 2
        part.geom("plinth").size[0] = r + 0.05
        part.geom("motor").fromto = (0, 0.09, high, 0, 0.22, high)
        rear, front = rod - r - 0.05, rod + r + 0.05
        for side, y in (("near", -0.035), ("far", 0.035)):
            part.geom(f"{side}_guide").fromto = (rear, y, high, front, y, high)
            for end, x in (("rear", rear), ("front", front)):
                post = part.geom(f"{side}_{end}_post")
                post.pos[:], post.size[2] = (x, y, (high + 0.012) / 2), (high + 0.012) / 2
        left, level = front + 0.02, high - BLOCK
        part.geom("top").pos[:] = ((left + self.edge) / 2, 0.0, level - 0.015)
        part.geom("top").size[0] = (self.edge - left) / 2
        for side, y in (("near", -0.12), ("far", 0.12)):
            for end, x in (("left", left + 0.03), ("right", self.edge - 0.03)):
                leg = part.geom(f"{side}_{end}_leg")
                leg.pos[:], leg.size[2] = (x, y, (level - 0.03) / 2), (level - 0.03) / 2

    def twin(self, run: Run, **changes: Any) -> tuple[CrankPush, Run]:
        """This run, or one with these changes, with a motor strong enough for its course."""
        there = self.make(**(self.values() | changes))
        if there.needed() * 1.1 > there.torque:
            there = self.make(**(there.values() | {"torque": STRONGEST}))
        return there, run if there == self else run.again(
            **{k: v for k, v in there.values().items() if v != getattr(run.specimen, k)}
        )

    @observable("rad")
    def crank_angle(self, run: Run) -> Array:
        """0 where the slider is farthest out (T,)."""
        return run.joint("crank/axle")

    @observable("rad/s")
    def crank_speed(self, run: Run) -> Array:
        """Of the crank (T,)."""
        return run.joint_speed("crank/axle")

    @observable("m")
    def slider_place(self, run: Run) -> Array:
        """Distance of the wrist pin from the axle (T,)."""
        return run.position("crank/slider")[:, 0]

    @observable("m/s")
    def slider_speed(self, run: Run) -> Array:
        """Of the slider, outwards (T,)."""
        return run.joint_speed("crank/guide")

    @observable("m")
    def block_place(self, run: Run) -> Array:
        """Of the block's middle along the table (T,)."""
        return run.position("block/block")[:, 0]

    @observable("m")
    def closure(self, run: Run) -> Array:
        """Distance of the rod's end from the slider's wrist pin (T,)."""
        q = run.quaternion("crank/rod")
        along = np.column_stack([1 - 2 * q[:, 2] ** 2, 2 * q[:, 1] * q[:, 2], -2 * q[:, 0] * q[:, 2]])
        end = run.position("crank/rod") + self.rod / 2 * along
        return np.asarray(np.linalg.norm(end - run.position("crank/slider"), axis=1))

    @observable("N m")
    def motor_torque(self, run: Run) -> Array:
        """By the balance of power of the recorded motion, (Ė + friction's power)/θ̇; 0 where the crank rests (T,)."""
        rate = self.crank_speed(run)
        power = np.gradient(self.energy(run), run.t) + self.guide * np.abs(self.slider_speed(run))
        power += self.friction * self.block * g * np.abs(run.velocity("block/block")[:, 0])
        turning = np.abs(rate) > 1e-3 * self.speed
        return np.where(turning, power / np.where(turning, rate, 1.0), 0.0)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic and potential energy of mechanism and block (T,)."""
        bodies = ("crank/crank", "crank/rod", "crank/slider", "block/block")
        return np.asarray(sum(run.kinetic(b) + run.mass(b) * g * run.position(b)[:, 2] for b in bodies))

    @law("x = r cos θ + √(l² - r² sin² θ)", source="Norton, Design of Machinery, 5th ed., §13.2 eq. 13.1d",
         within=(1e-3, 1e-4, 1e-5))  # fmt: skip
    def slider_follows_the_crank(self, run: Run) -> Measurement:
        """48a: place of the slider against crank angle, from mid-stroke, in strokes."""
        middle, stroke = self.rod, 2 * self.radius
        expected = (self.wrist(self.crank_angle(run))[0] - middle) / stroke
        return (self.slider_place(run) - middle) / stroke, expected

    @law("ẋ = -r θ̇ [sin θ + r sin θ cos θ/√(l² - r² sin² θ)]", within=(1e-2, 5e-4, 5e-5),
         source="Norton, Design of Machinery, 5th ed., §13.2 eq. 13.1e")  # fmt: skip
    def slider_is_as_fast_as_the_crank_makes_it(self, run: Run) -> Measurement:
        """48b: speed of the slider, but for four steps after plate and block meet, however gently: the solver knows
        from the step before how the rod turns its rows, and takes so long to forget a jump of the force."""
        gap = self.block_place(run) - BLOCK - self.slider_place(run) - self.reach
        met = run.t[np.flatnonzero((gap < NEAR) & (np.roll(gap, 1) >= NEAR))]
        calm = np.ones(len(run), bool)
        for when in (*met, *(impact.time for impact in run.impacts)):
            calm &= (run.t < when) | (run.t > when + 4 * run.step)
        along = self.wrist(self.crank_angle(run))[1]
        return self.slider_speed(run)[calm], (along * self.crank_speed(run))[calm]

    @law("θ = θ₀ + ½ α t², then + Ω t", source="Landau & Lifshitz, Mechanics, §1: motion is what is given",
         within=(5e-5, 5e-6, 5e-7))  # fmt: skip
    def motor_keeps_its_course(self, run: Run) -> Measurement:
        """Crank angle of a motor that is strong enough, while the block is only pushed (twin with the plate on it)."""
        there, twin = self.twin(run, place=0.0, stop="absent")
        return twin.joint("crank/axle"), there.course(twin.t)[0]

    def parting(self) -> tuple[float, float, float]:
        """Where plate and block part, touching from the start: time [s], way of the block [m] and its speed [m/s]."""

        def braking(angle: float) -> float:
            _, along, bend = self.wrist(angle)
            _, rate, turning = self.course(self.when(angle))
            return float(-bend * rate**2 - along * turning - self.friction * g)

        angles = np.linspace(pi + 1.0 + 1e-9, 2 * pi, 400)
        hard = [a for a in angles if braking(a) > 0]
        angle = 2 * pi
        if hard:
            before = max(hard[0] - (angles[1] - angles[0]), angles[0])
            angle = brentq(braking, before, hard[0], xtol=1e-14) if braking(before) < 0 else hard[0]
        x, along, _ = self.wrist(angle)
        way = float(x) - self.rod + self.radius
        return self.when(angle), way, float(along) * float(self.course(self.when(angle))[1])

    @law("pushed until -ẍ > μ g, then d = v²/(2 μ g)", source="Coulomb, Théorie des machines simples (1785); Landau & "
         "Lifshitz, Mechanics, §25", within=(2e-3, 2e-4, 2e-5))  # fmt: skip
    def block_slides_on(self, run: Run) -> Measurement:
        """48c: way of the block, with the plate and without it, until it rests or leaves the table (twin as above)."""
        there, twin = self.twin(run, place=0.0, stop="absent")
        when, way, speed = there.parting()
        decay = there.friction * g
        s = np.clip(twin.t - when, 0.0, speed / decay)
        pushed = there.wrist(there.course(np.minimum(twin.t, when))[0])[0] - there.rod + there.radius
        expected = np.where(twin.t < when, pushed, way + speed * s - decay * s * s / 2)
        place = there.block_place(twin)
        on = np.cumsum(place > there.edge - 0.005) == 0
        return place[on] - there.rest, expected[on]

    @law("∮ τ dθ = ∮ F |dx| + ΔE", source="Landau & Lifshitz, Mechanics, §6 and §25; Norton, Design of Machinery, "
         "5th ed., §11.11", within=(1e-2, 1e-3, 1e-4))  # fmt: skip
    def work_of_the_motor_goes_into_friction(self, run: Run) -> Measurement:
        """48d: work of a motor that gives a constant torque (a weak twin that lags behind its course) less the gain of
        energy, against what the guide takes, over a turn that begins when the block has been pushed away, or as much of
        it as the motor lags."""
        torque = self.steady_torque()
        twin = run.again(speed=10.0, torque=torque, place=0.0, stop="absent", turns=2)
        there = twin.specimen
        angle, rate = there.crank_angle(twin), there.crank_speed(twin)
        gone = (angle > 2 * pi) & (twin.t > twin.t[np.argmax(there.block_place(twin))])
        lag = gone & (there.course(twin.t)[1] - rate > 1e-3)
        start = int(np.argmax(lag))
        behind = np.flatnonzero(~lag[start:] | (angle[start:] > angle[start] + 2 * pi))
        stop = start + int(behind[0]) - 1 if len(behind) else len(twin) - 1
        if not lag.any() or angle[stop] - angle[start] < pi / 2:
            raise NotEvaluated(f"the weak motor lags for {angle[stop] - angle[start]:.2g} rad; needed: π/2")
        window = slice(start, stop + 1)
        turned, gained, way = (x[window] - x[start] for x in (angle, there.energy(twin), there.path(twin)))
        part = there.guide * way[-1] / (torque * turned[-1])
        if part < LEAST:
            raise NotEvaluated(f"friction takes {part:.2g} of the motor's work; needed: {LEAST:g} or more")
        return torque * turned - gained, there.guide * way

    def steady_torque(self) -> float:
        """A constant torque that turns the crank, and not too fast in its first turn [N m]."""
        angle = np.linspace(pi, 3 * pi, 400)
        _, along, _ = self.wrist(angle)
        sliding = self.friction * self.block * g
        holding = self.bar[0] * g * self.radius * np.cos(angle) / 2
        holding += (self.guide + sliding * (along > 0)) * np.abs(along)
        loss = (6 * self.guide + 2 * sliding) * self.radius
        return max(1.3 * float(holding.max()), (loss + 10 * float(self.inertia(angle).min())) / (3 * pi))

    def path(self, run: Run) -> Array:
        """Way of the slider to and fro since the start, from crank angles and places (T,)."""
        angle = self.crank_angle(run)
        strokes = np.floor((angle - pi) / pi + 1e-12)
        dead = self.rod + np.where(strokes % 2 == 0, -self.radius, self.radius)
        return np.asarray(2 * self.radius * strokes + np.abs(self.slider_place(run) - dead))

    @law("x(θ) = x_stop, θ̇ = 0", source="Norton, Design of Machinery, 5th ed., §13.2 eq. 13.1d; Poinsot, Éléments de "
         "statique (1803): a force on what cannot move", unit="rad", within=(1e-8, 1e-8, 1e-8))  # fmt: skip
    def a_jammed_crank_stands_still(self, run: Run) -> Measurement:
        """Crank angle and speed · 1 s at the end, the block jammed against a stop (twin)."""
        there, twin = self.twin(run, place=0.0, stop="ahead", turns=1)
        gap = 2 * self.radius * JAM
        expected = brentq(lambda a: float(there.wrist(a)[0]) - self.rod + self.radius - gap, pi, 2 * pi, xtol=1e-14)
        if not twin.impacts:
            raise NotEvaluated("the block has not reached the stop")
        return [there.crank_angle(twin)[-1], there.crank_speed(twin)[-1]], [expected, 0.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        way = self.block_place(run)[-1] - self.rest
        turned = (self.crank_angle(run)[-1] - pi) / (2 * pi)
        start = (
            f"A motor starts and turns a crank of {100 * self.radius:.0f} cm up to {self.speed:.1f} rad/s. A rod of "
            f"{100 * self.rod:.0f} cm makes a slider go to and fro, and its plate pushes a red block of "
            f"{self.block:.2g} kg along a table. "
        )
        if self.stop == "ahead":
            return start + (
                f"But a stone stands in the way: the block jams between plate and stone after {100 * way:.0f} cm, the "
                f"motor's {self.torque:.3g} N m cannot move it on, and the crank stalls and stands still."
            )
        if turned < 0.6:
            return start + f"The motor's {self.torque:.2g} N m are too weak: it stops after {turned:.2f} turns."
        fate = "falls off the table" if run.position("block/block")[-1, 2] < self.axle - 0.02 else "stops"
        return start + (
            f"Where the slider brakes harder than friction does, the block leaves it and slides on, and {fate} "
            f"{100 * way:.0f} cm from its place, out of reach of the slider, which turns {turned:.1f} times in all."
        )
