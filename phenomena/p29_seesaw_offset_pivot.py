"""29: a seesaw out of balance swings down; what lies on it is held, slides, rolls or is thrown."""

from __future__ import annotations

from math import inf, sqrt, tan
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from phenomena.parts import Rider, Seesaw, ball
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

HINGE: Final = "seesaw/hinge"
LEAST: Final = 1.05
"""Moments of the two sides less apart than this make a balanced seesaw, which is another phenomenon."""

ROUGH: Final = 0.9
MARGIN: Final = 2e-4
"""Friction this much less than the slope must let a load go, this much more must hold it (of the slope)."""

SAMPLES: Final = 24
LEAST_WAY: Final = 0.01
"""Least samples of a window, and least way of the ball in it [m]."""


class SeesawOffsetPivot(Phenomenon, domain="mechanics"):
    """Objects on an unbalanced seesaw: the side with the greater moment swings down and throws what is on the other."""

    rider: Annotated[Literal["blocks", "block", "ball"], Choice("a block on each side, one on the left, or a ball")] = (
        "blocks"
    )
    length: Annotated[float, Param("m", 0.8, 3.0, "plank")] = 2.4
    plank_mass: Annotated[float, Param("kg", 0.5, 5.0, "plank")] = 2.0
    offset: Annotated[float, Param("1", -0.4, 0.4, "axle to the right of the plank's middle, in half lengths")] = 0.25
    height: Annotated[float, Param("1", 0.2, 0.4, "of the level plank over the ground, in half lengths of it")] = 0.3
    pivot: Annotated[float, Param("m", -0.05, 0.3, "height of the axle over the plank's middle plane")] = -0.02
    left: Annotated[float, Param("kg", 0.5, 10.0, "load on the left")] = 4.0
    right: Annotated[float, Param("kg", 0.5, 10.0, "load on the right")] = 2.0
    left_arm: Annotated[float, Param("1", 0.3, 0.85, "of the left load, over the way from the axle to that end")] = 0.6
    right_arm: Annotated[float, Param("1", 0.3, 0.85, "of the right load, over the way from the axle to that end")] = (
        0.75
    )
    start: Annotated[float, Param("1", -1.0, 1.0, "tilt: left end on the ground 1, level 0, right end -1")] = -0.9
    density: Annotated[float, Param("kg/m³", 600.0, 21300.0, "loads")] = 700.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "of all surfaces")] = 0.6
    restitution: Annotated[float, Param("1", 0.0, 0.8, "of the plank's ends on the ground")] = 0.3

    @property
    def seesaw(self) -> Seesaw:
        """The plank on its axle."""
        half = self.length / 2
        return Seesaw(self.length, self.plank_mass, self.height * half, self.pivot, self.offset * half)

    @property
    def radius(self) -> float:
        """Of the ball [m]."""
        return float((3 * self.left / (4 * np.pi * self.density)) ** (1 / 3))

    @property
    def riders(self) -> list[Rider]:
        """What is on the plank at the start: the ball, or the blocks."""
        half, seesaw = self.length / 2, self.seesaw
        place = -self.left_arm * half * (1 + self.offset)
        if self.rider == "ball":
            z = self.radius + seesaw.half_thickness - self.pivot
            return [Rider(self.left, self.radius, place, z, 2 / 5 * self.left * self.radius**2)]
        loads = [seesaw.cube(self.left, self.density, place)]
        if self.rider == "blocks":
            loads.append(seesaw.cube(self.right, self.density, self.right_arm * half * (1 - self.offset)))
        return loads

    @property
    def bodies(self) -> list[str]:
        """Their names in the scene."""
        return {"ball": ["ball/ball"], "block": ["left/block"], "blocks": ["left/block", "right/block"]}[self.rider]

    @property
    def tilt(self) -> float:
        """At the start [rad]."""
        return abs(self.start) * self.seesaw.lying(-1 if self.start > 0 else 1)

    @property
    def moments(self) -> tuple[float, float]:
        """Of the weights left and right of the axle when level, over g [kg m]."""
        shares = [b.mass * b.x for b in (self.seesaw.plank, *self.riders)]
        return -sum(s for s in shares if s < 0), sum(s for s in shares if s > 0)

    @property
    def ratio(self) -> float:
        """Of the greater moment to the smaller one."""
        return max(self.moments) / min(self.moments) if min(self.moments) > 0 else inf

    def build(self, scene: Scene) -> None:
        """The seesaw, tilted, and what lies on it."""
        if self.ratio < LEAST:
            raise Refusal("R12", f"moments of ratio {self.ratio:.4g} make a balanced seesaw (SeesawCenterPivot); "
                          f"allowed: {LEAST:g} or more")  # fmt: skip
        loads, half = self.riders, self.length / 2
        for load, end in zip(loads, (half * (1 + self.offset), half * (1 - self.offset)), strict=False):
            if abs(load.x) + load.half > end:
                raise Refusal("R1", f"arm = {abs(load.x) / end:.3g}: the load stands out over the end of the plank; "
                              f"allowed: {1 - load.half / end:.3g}")  # fmt: skip
        gap = loads[-1].x - loads[-1].half - loads[0].x - loads[0].half
        if len(loads) > 1 and gap < 0:
            raise Refusal("R1", f"the loads overlap by {-gap:.3g} m; allowed: a density of "
                          f"{self.density * ((loads[0].half + loads[1].half) / (loads[1].x - loads[0].x)) ** 3:.4g} "
                          "kg/m³ or more")  # fmt: skip
        for side in (1, -1):
            self.seesaw.lying(side)
        surface = Surface(friction=self.friction)
        ground = Surface(friction=self.friction, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, ground)
        self.seesaw.place(scene, self.tilt, ground)
        if self.rider == "ball":
            self._lay_ball(scene, loads[0], surface)
        colours = ((0.17, 0.58, 0.62), (0.94, 0.76, 0.28))
        for body, load, colour in zip(self.bodies, loads, colours, strict=False):
            if self.rider != "ball":
                self.seesaw.lay(scene, body.partition("/")[0], load, self.tilt, surface, colour)
        scene.touch(*self.bodies)
        lies = abs(self.start) == 1.0 and self.start * self.seesaw.acceleration(self.tilt, loads) > 0
        watch = 2.0 if lies else 3.0 if self.rider == "ball" else 5.0
        scene.resolve(time=0.8 * sqrt(self.length / g), length=loads[0].half, duration=watch)

    def _lay_ball(self, scene: Scene, rider: Rider, surface: Surface) -> None:
        part = ball(scene, "ball", self.radius, self.density, surface, (0.93, 0.55, 0.20))
        scene.start[part.name("free")] = free_pose(self.seesaw.over(self.tilt, rider.x, rider.z))
        scene.touch("ball/ball", "seesaw/board")
        scene.touch("ball/ball", "stage/floor")

    @observable("rad")
    def tilting(self, run: Run) -> Array:
        """Tilt of the plank, positive with the right end up (T,)."""
        return run.joint(HINGE)

    @observable("rad/s")
    def turning(self, run: Run) -> Array:
        """Angular velocity of the plank (T,)."""
        return run.joint_speed(HINGE)

    @observable("m")
    def places(self, run: Run) -> Array:
        """Of the loads along the plank, from the axle (T, n)."""
        return np.column_stack([self.on_plank(run, body)[0] for body in self.bodies])

    @observable("m")
    def gaps(self, run: Run) -> Array:
        """By which the loads' centres are farther from the plank than at the start (T, n): they have left it."""
        return np.column_stack(
            [self.on_plank(run, body)[1] - r.z for body, r in zip(self.bodies, self.riders, strict=True)]
        )

    def on_plank(self, run: Run, body: str) -> tuple[Array, Array]:
        """Place (x, z) of a load's centre from the axle, along the plank and out of it [m]."""
        tilt, place = run.joint(HINGE), run.position(body)
        x, z = place[:, 0], place[:, 2] - self.seesaw.axle
        return x * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - x * np.sin(tilt)

    def staged(self, run: Run, **changes: Any) -> tuple[SeesawOffsetPivot, Run]:
        """The specimen with these changes, and its run: this one, or a twin."""
        there = self.make(**(self.values() | changes))
        return there, run if there == self else run.again(**changes)

    def held(self, run: Run) -> tuple[Array, NDArray[np.bool_]]:
        """Tilt (T,) that the equation of motion gives, and the samples up to the first slip or impact."""
        tilt, rate = self.seesaw.swing(self.tilt, self.riders, run.t)
        slips = ~self.seesaw.holds(tilt, rate, self.riders, self.friction)
        end = min([run.t[np.argmax(slips)] if slips.any() else inf, *(i.time for i in run.impacts)])
        return tilt, run.t < end

    def falling(self, run: Run) -> tuple[SeesawOffsetPivot, Run, Array, NDArray[np.bool_]]:
        """This specimen, or a twin with blocks, rough, and let go level, whose loads are held while it swings down."""
        tries: list[dict[str, Any]] = [{}, {"friction": ROUGH}, {"friction": ROUGH, "start": 0.0}]
        for changes in tries:
            if self.rider == "ball":
                changes["rider"] = "block"
            there = self.make(**(self.values() | changes))
            if there.ratio < LEAST or not there.falls():
                continue
            there, twin = self.staged(run, **changes)
            expected, window = there.held(twin)
            if window.sum() >= SAMPLES:
                return there, twin, expected, window
        raise NotEvaluated("no load is held for long enough")

    def falls(self) -> bool:
        """Whether it moves when let go, with its loads held."""
        turning = float(self.seesaw.acceleration(self.tilt, self.riders))
        holds = bool(self.seesaw.holds(self.tilt, 0.0, self.riders, self.friction))
        return holds and (abs(self.start) < 1.0 or turning * self.start < 0)

    @law("I θ̈ = -g [Σ mᵢ xᵢ cos θ - Σ mᵢ zᵢ sin θ], I = I₀ + Σ mᵢ (xᵢ² + zᵢ² + kᵢ²)", within=(5e-4, 5e-5, 5e-6),
         source="Landau & Lifshitz, Mechanics, §34 eq. 34.3; Goldstein, Classical Mechanics, §1.2")  # fmt: skip
    def swings_down_as_gravity_turns_it(self, run: Run) -> Measurement:
        """29a: tilt, at every sample until a load slips or an end touches the ground."""
        _, twin, expected, window = self.falling(run)
        return twin.joint(HINGE)[window], expected[window]

    @law("½ I ω² = g [Σ mᵢ xᵢ (sin θ₀ - sin θ) + Σ mᵢ zᵢ (cos θ₀ - cos θ)]", within=(2e-3, 2e-4, 2e-5),
         source="Huygens, Horologium oscillatorium (1673), part IV; Landau & Lifshitz, Mechanics, §32")  # fmt: skip
    def height_becomes_rotation(self, run: Run) -> Measurement:
        """29b: kinetic energy from the recorded angular velocity against that from the recorded tilt."""
        there, twin, _, window = self.falling(run)
        inertia, along, out = there.seesaw.moments(there.riders)
        tilt = twin.joint(HINGE)[window]
        fallen = along * (np.sin(there.tilt) - np.sin(tilt)) + out * (np.cos(there.tilt) - np.cos(tilt))
        return 0.5 * inertia * twin.joint_speed(HINGE)[window] ** 2, g * fallen

    @law("tan θ = μ", source="Coulomb, Théorie des machines simples (1785); Euler, Mém. Acad. Berlin 4 (1748) 122",
         within=(1e-3, 1e-3, 1e-3), limited_by="the width of the bracket")  # fmt: skip
    def a_load_slides_when_the_slope_exceeds_friction(self, run: Run) -> Measurement:
        """29c: friction with which the left block just holds on the plank that lies with its heavier end down."""
        for side in (1.0, -1.0):
            changes = {"rider": "block" if self.rider == "ball" else self.rider, "start": side}
            there = self.make(**(self.values() | changes))
            turning = float(there.seesaw.acceleration(there.tilt, there.riders)) if there.ratio > LEAST else 0.0
            if turning * side > 0:
                break
        else:
            raise NotEvaluated("neither end stays down")
        slope = tan(abs(there.tilt))
        if slope > ROUGH / (1 + MARGIN):
            raise NotEvaluated(f"the plank lies at a slope of {slope:.3g}; friction goes up to {ROUGH:g}")

        def holds(friction: float) -> bool:
            there, twin = self.staged(run, **changes, friction=friction)
            way = there.on_plank(twin, "left/block")[0]
            return bool(abs(way[-1] - way[0]) < 1e-4)

        return threshold(holds, slope, spread=MARGIN, resolution=2.1 * MARGIN), slope

    @law("(1+β) ẍ - (z + β r) θ̈ = x θ̇² - g sin θ, d/dt[(I + m (x² + z²) + β m r²) θ̇ - m (z + β r) ẋ] = -∂V/∂θ",
         source="Landau & Lifshitz, Mechanics, §2: Lagrange's equations, with β = 2/5 and ω = θ̇ - ẋ/r of a ball that "
         "rolls", within=(5e-3, 5e-4, 5e-5))  # fmt: skip
    def a_ball_rolls_along_the_turning_plank(self, run: Run) -> Measurement:
        """29d: way of a ball along the plank (a twin, if blocks lie on it), at every sample until it slips, comes to
        the end, or the plank meets the ground."""
        for changes in ({}, {"friction": ROUGH}, {"friction": ROUGH, "start": 0.0}):
            there = self.make(**(self.values() | {"rider": "ball"} | changes))
            if there.ratio < LEAST or (abs(there.start) == 1.0 and not there.falls()):
                continue
            there, twin = self.staged(run, rider="ball", **changes)
            expected, window = there.rolling(twin)
            if window.sum() >= SAMPLES and np.ptp(expected[window]) > LEAST_WAY:
                way = there.on_plank(twin, "ball/ball")[0]
                return (way - way[0])[window], (expected - expected[0])[window]
        raise NotEvaluated("the ball does not roll for long enough")

    def rolling(self, run: Run) -> tuple[Array, NDArray[np.bool_]]:
        """Place (T,) of the rolling ball along the plank, by Lagrange's equations, and the samples where it rolls."""
        body, radius = self.riders[0], self.radius
        m, z = body.mass, body.z
        inertia, along, out = self.seesaw.moments([])
        coupling = -m * z - 2 / 5 * m * radius

        def accelerations(y: Array) -> Array:
            x, dx, theta, omega = y
            matrix = [[7 / 5 * m, coupling], [coupling, inertia + m * (x**2 + z**2) + body.inertia]]
            torque = (along + m * x) * np.cos(theta) - (out + m * z) * np.sin(theta)
            forces = [m * (x * omega**2 - g * np.sin(theta)), -g * torque - 2 * m * x * dx * omega]
            return np.asarray(np.linalg.solve(matrix, forces))

        def motion(_: float, y: Array) -> list[float]:
            ddx, alpha = accelerations(y)
            return [y[1], float(ddx), y[3], float(alpha)]

        start = (body.x, 0.0, self.tilt, 0.0)
        end = min([1.5 * sqrt(self.length / g), *(i.time for i in run.impacts)])
        t = run.t[run.t <= end]
        y = solve_ivp(motion, (0.0, float(t[-1])), start, method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13).y
        ddx, alpha = np.array([accelerations(state) for state in y.T]).T
        x, dx, theta, omega = y
        press = g * np.cos(theta) + x * alpha + 2 * dx * omega - z * omega**2
        drag = g * np.sin(theta) + ddx - z * alpha - x * omega**2
        half = self.length / 2
        bad = (press <= 0) | (np.abs(drag) >= self.friction * press) | (np.abs(x + self.offset * half) > half)
        place = np.full(len(run.t), np.nan)
        place[: len(t)] = x
        good = np.zeros(len(run.t), bool)
        good[: int(np.argmax(bad)) if bad.any() else len(t)] = True
        return place, good

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        left, right = self.moments
        side = "left" if left > right else "right"
        things = {
            "blocks": f"a teal block of {self.left:.2g} kg on the left and a yellow one of {self.right:.2g} kg on the "
            "right",
            "block": f"a teal block of {self.left:.2g} kg on its left arm",
            "ball": f"an orange ball of {self.left:.2g} kg on its left arm",
        }[self.rider]
        tilt = np.degrees(abs(self.tilt))
        slid = np.abs(self.places(run) - self.places(run)[0]).max()
        left_it = float(self.gaps(run).max())
        fate = "rolls" if self.rider == "ball" else "slides" if slid > 0.01 else "rests"
        return (
            f"A seesaw {self.length:.1f} m long, its axle off the middle, carries {things}. It is let go at a tilt of "
            f"{tilt:.0f} degrees. The weights' moments differ by a factor of {min(self.ratio, 99):.2g}, so the {side} "
            f"side is drawn down, ever faster, until it meets the ground or swings back. What lies on the plank {fate}"
            f"{f' and is thrown {left_it:.2f} m clear of it' if left_it > 0.01 else ''}."
        )
