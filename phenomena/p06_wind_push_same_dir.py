"""A fan blows from behind on what already rolls or slides: the work of a fading wind, and the drag of a stream."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import LINEAR, UNIFORM, AirStream, Box, Wind, fan
from physinone_mj.measure import between
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .winds import BODIES, GRIP, HEIGHT, foam, mover


class WindPushSameDir(Phenomenon, domain="mechanics"):
    """Wind applied to objects moving in the same direction."""

    speed: Annotated[float, Param("m/s", 0.2, 3.0, "before the wind")] = 0.35
    force: Annotated[float, Param("N", 0.02, 8.0, "of the wind at the fan")] = 0.4
    length: Annotated[float, Param("m", 0.8, 3.0, "of the wind, from the fan to its end")] = 1.6
    mass: Annotated[float, Param("kg", 0.05, 5.0, "body")] = 0.5
    radius: Annotated[float, Param("m", 0.03, 0.06, "body")] = 0.05
    wind_speed: Annotated[float, Param("m/s", 2.0, 15.0, "of the air at the fan, where it is a stream")] = 6.0
    drag_area: Annotated[float, Param("m²", 1e-3, 0.05, "drag coefficient times frontal area")] = 0.02
    body: Annotated[Literal["ball", "puck"], Choice("rolls on the floor, or slides without friction")] = "ball"
    air: Annotated[
        Literal["fading force", "fading stream", "uniform stream"],
        Choice("a field of force, or air that drags and fades, or air that drags and ends abruptly"),
    ] = "fading force"

    @property
    def inertia(self) -> float:
        """What resists the wind [kg]: m (1 + β) for what rolls."""
        return self.mass * (1 + BODIES[self.body].beta)

    @property
    def wind(self) -> Wind | AirStream:
        """The effect."""
        box, names = Box((0.0, 0.0, HEIGHT), (1.0, 0.0, 0.0), self.length, 0.5, 2 * HEIGHT), (BODIES[self.body].name,)
        if self.air == "fading force":
            return Wind(box, self.force, names)
        profile = LINEAR if self.air == "fading stream" else UNIFORM
        return AirStream(box, self.wind_speed, self.drag_area, names, profile)

    def push(self, s: float, v: float) -> float:
        """Force [N] at distance s from the fan and speed v, written out independently of the effect."""
        fading = 1 - s / self.length
        if self.air == "fading force":
            return self.force * fading**2
        relative = self.wind_speed * (fading if self.air == "fading stream" else 1.0) - v
        return 1.225 / 2 * self.drag_area * abs(relative) * relative

    def passage(self) -> tuple[float, float, float]:
        """(time to cross the wind [s], speed at its end, greatest speed [m/s]), at most 10 s."""

        def end(_t: float, y: NDArray[np.float64]) -> float:
            return float(y[0] - self.length)

        end.terminal = True  # type: ignore[attr-defined]
        way = solve_ivp(lambda _, y: (y[1], self.push(y[0], y[1]) / self.inertia), (0, 10), (0, self.speed),
                        events=end, rtol=1e-6)  # fmt: skip
        return float(way.t[-1]), float(way.y[1, -1]), float(way.y[1].max())

    def build(self, scene: Scene) -> None:
        """A fan hung in a gate, the body on its way below it, a pad far beyond the end of the wind."""
        body, wind = BODIES[self.body], self.wind
        scene.effects.append(wind)
        fan(scene, wind.box)
        part = mover(scene, self.body, self.radius, self.mass, body.friction)
        # the step in the force at the fan falls on the edge of a frame, so on that of a time step
        frames = max(4, min(15, int(0.5 / self.speed * scene.fps)))
        scene.start[part.name("free")] = free_pose(
            (-self.speed * frames / scene.fps, 0.0, self.radius * body.half_height)
        )
        turning = self.speed / self.radius if body.beta else 0.0
        scene.speed[part.name("free")] = (self.speed, 0, 0, 0, turning, 0)
        crossing, exit_speed, fastest = self.passage()
        beyond = min(1.2, 2.0 * exit_speed)
        foam(scene, "pad", self.length + beyond, -1, body.name)
        duration = frames / scene.fps + crossing + beyond / exit_speed + 0.5
        scene.resolve(time=2 * self.radius / fastest, length=self.radius, duration=float(np.clip(duration, 2.0, 10.0)))

    @observable("m")
    def distance(self, run: Run) -> NDArray[np.float64]:
        """From the fan to the centre of mass, along the wind."""
        return run.position(BODIES[self.body].name)[:, 0]

    @observable("m/s")
    def velocity(self, run: Run) -> NDArray[np.float64]:
        """Of the centre of mass, along the wind."""
        return run.velocity(BODIES[self.body].name)[:, 0]

    @observable("N")
    def wind_force(self, run: Run) -> NDArray[np.float64]:
        """On the body; nothing outside the wind."""
        s, v = self.distance(run), self.velocity(run)
        return np.array([self.push(a, b) if 0 <= a <= self.length else 0.0 for a, b in zip(s, v, strict=True)])

    def within(self, run: Run, air: str) -> tuple[WindPushSameDir, Run, NDArray[np.bool_], float]:
        """(specimen, run, samples in the wind, time of entry) of this run or, in another air, of its twin."""
        one = run if self.air == air else run.again(air=air)
        specimen = self if self.air == air else WindPushSameDir.make(**(self.values() | {"air": air}))
        s = specimen.distance(one)
        specimen.rolls()
        inside = between(np.where(one.t < specimen.stopped(one), s, -1.0), 1e-9, self.length, least=20)
        return specimen, one, inside, -s[0] / self.speed

    def stopped(self, run: Run) -> float:
        """When the body meets the pad, or the run ends [s]."""
        return min((i.time for i in run.impacts if "pad/foam" in (i.first, i.second)), default=run.t[-1])

    def rolls(self) -> None:
        """A ball that slips obeys other laws."""
        beta = BODIES[self.body].beta
        needed = beta / (1 + beta) * abs(self.push(0.0, self.speed)) / (self.mass * g)
        if needed > BODIES[self.body].friction * 0.99:
            raise NotEvaluated(f"the wind makes the ball slip: friction needed: {needed:.3g}, there is {GRIP}")

    def gained(self, s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Speed at s that the work of the wind explains (6a)."""
        work = self.force * self.length / 3 * (1 - (1 - np.asarray(s) / self.length) ** 3)
        return np.sqrt(self.speed**2 + 2 * work / self.inertia)

    def beyond(self, run: Run) -> NDArray[np.float64]:
        """Speeds after the wind and before the pad, of what does not slip."""
        self.rolls()
        s = self.distance(run)
        mask = (s > self.length) & (run.t < self.stopped(run))
        if mask.sum() < 5:
            raise NotEvaluated(f"the run ends {self.length - s.max():.3g} m before the end of the wind")
        return self.velocity(run)[mask]

    @law("v² = v₀² + (2 F₀ L/3 mₑ)[1 - (1 - s/L)³]", source="Landau & Lifshitz, Mechanics, §5-6 (work of F₀(1 - s/L)²)",
         within=(5e-6, 5e-7, 5e-8))  # fmt: skip
    def wind_does_work_on_the_way(self, run: Run) -> Measurement:
        """6a: speed at twenty stations in the wind; mₑ = m, or m (1 + β) for what rolls."""
        specimen, one, inside, _ = self.within(run, "fading force")
        picked = np.linspace(0, inside.sum() - 1, 20).astype(int)
        return specimen.velocity(one)[inside][picked], specimen.gained(specimen.distance(one)[inside][picked])

    @law("v_L² = v₀² + 2 F₀ L/(3 mₑ)", source="Landau & Lifshitz, Mechanics, §5-6 (work of F₀(1 - s/L)²)",
         within=(5e-6, 5e-7, 5e-8))  # fmt: skip
    def leaves_with_a_third_of_the_greatest_work(self, run: Run) -> Measurement:
        """6b: speed at every instant between the end of the wind and the pad."""
        specimen, one, _, _ = self.within(run, "fading force")
        speeds = specimen.beyond(one)
        return speeds, np.full_like(speeds, specimen.gained(self.length))

    @law("v = const for s > L", source="Newton, Principia, law 1", within=(1e-9, 1e-10, 1e-11))
    def nothing_pushes_beyond_the_wind(self, run: Run) -> Measurement:
        """6b: speed after the wind, against its value just after the end."""
        speeds = self.beyond(run)
        return speeds / speeds[0], np.ones_like(speeds)

    @law("v = U - (U - v₀)/(1 + k |U - v₀| t/mₑ), k = ρ C A/2", source="Landau & Lifshitz, Fluid Mechanics, §45",
         within=(2e-3, 5e-4, 1e-4))  # fmt: skip
    def uniform_stream_is_never_overtaken(self, run: Run) -> Measurement:
        """6c: speed in air that moves alike everywhere; it approaches that of the air and never passes it."""
        specimen, one, inside, entry = self.within(run, "uniform stream")
        relative, k = self.wind_speed - self.speed, 1.225 / 2 * self.drag_area
        t = one.t[inside] - entry
        expected = self.wind_speed - relative / (1 + k * abs(relative) * t / self.inertia)
        return specimen.velocity(one)[inside], expected

    @law("mₑ v dv/ds = k |U - v|(U - v), U = U₀(1 - s/L)", source="Landau & Lifshitz, Fluid Mechanics, §45; DOP853",
         within=(2e-3, 5e-4, 1e-4))  # fmt: skip
    def fading_stream_carries_along(self, run: Run) -> Measurement:
        """6d: distance from the fan over time, against the equation of motion solved to 1e-10."""
        specimen, one, inside, entry = self.within(run, "fading stream")
        t = one.t[inside]
        way = solve_ivp(lambda _, y: (y[1], specimen.push(y[0], y[1]) / self.inertia), (entry, t[-1]), (0, self.speed),
                        method="DOP853", t_eval=t, rtol=1e-10, atol=1e-12)  # fmt: skip
        return specimen.distance(one)[inside], way.y[0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        rolls = "rolls" if self.body == "ball" else "slides without friction"
        colour = "An orange ball" if self.body == "ball" else "A blue puck"
        if self.air == "fading force":
            pushes = f"whose push of {self.force:.2g} N fades to nothing within {self.length:.1f} m"
        else:
            pushes = f"whose air moves at {self.wind_speed:.1f} m/s and drags it along over {self.length:.1f} m"
        s, v = self.distance(run), self.velocity(run)
        leaves = np.nonzero(s > self.length)[0]
        ends = (
            f"It leaves the wind at {v[leaves[0]]:.2f} m/s, keeps that speed, and is stopped by a foam pad."
            if len(leaves)
            else f"After {run.t[-1]:.0f} s it is still in the wind, at {v[-1]:.2f} m/s."
        )
        return (
            f"{colour} of {self.mass:.2g} kg {rolls} at {self.speed:.2f} m/s below a standing fan and into its wind, "
            f"{pushes}. Blown from behind, it gains speed in the direction it already has, most of it close to the "
            f"fan, as the work of the wind becomes kinetic energy. {ends}"
        )
