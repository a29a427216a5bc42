"""12: a solid ball, a solid cylinder, a hollow ball and a hoop roll up a plank, stop and come back."""

from __future__ import annotations

from math import cos, sin, sqrt, tan
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.slope import BETA, RACERS, RUN_OUT, padded_stop, place, plank
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, crossings, fit, peaks
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

HIGHEST = 3.0
"""Longest way up [m]: a longer plank does not fit into the picture."""

FLAT_START = 0.5
"""From the foot of the plank to where the racers start on the floor [m]."""


class RollUpSlope(Phenomenon, domain="mechanics"):
    """Objects roll up a slope: what turns with more inertia climbs higher."""

    angle: Annotated[float, Param("rad", 0.0873, 0.6981, "slope of the plank")] = 0.2618
    speed: Annotated[float, Param("m/s", 0.5, 4.0, "of all racers at the start")] = 1.6
    friction: Annotated[float, Param("1", 0.0, 0.9, "coefficient between racers and plank or floor")] = 0.6
    spin: Annotated[float, Param("1", 0.0, 1.0, "ω r/v at a start on the plank; on the floor all roll")] = 1.0
    radius: Annotated[float, Param("m", 0.02, 0.08, "of all racers")] = 0.07
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "of all racers' material")] = 700.0
    start: Annotated[Literal["floor", "plank"], Choice("from the floor against the plank, or on it")] = "floor"

    @property
    def turning(self) -> float:
        """ω r/v at the start."""
        return 1.0 if self.start == "floor" else self.spin

    @property
    def entry(self) -> Array:
        """Speeds (4,) with which the climb begins [m/s].

        A rolling racer that hits the plank keeps its angular momentum about the line where it hits it:
        m v r cos α + I ω = (m r² + I) v'/r.
        """
        if self.start == "plank":
            return np.full(4, self.speed)
        return np.asarray(self.speed * (cos(self.angle) + BETA) / (1 + BETA))

    def slip_ends(self) -> tuple[Array, Array]:
        """When the racers begin to roll (4,) [s] and how fast they are then [m/s]; at a start on the plank."""
        drag = self.friction * g * cos(self.angle)
        with np.errstate(divide="ignore"):
            times = self.speed * (1 - self.turning) / (g * sin(self.angle) + drag * (1 + 1 / BETA))
        return times, self.speed - (g * sin(self.angle) + drag) * times

    def climbs(self) -> tuple[Array, Array]:
        """Ways up from where the climb begins (4,) [m] and times that they take [s]: slipping, then rolling."""
        pull, drag = g * sin(self.angle), self.friction * g * cos(self.angle)
        times, speeds = self.slip_ends() if self.start == "plank" else (np.zeros(4), self.entry)
        first = (self.entry + speeds) / 2 * times
        slowing = np.where(self.grips(), pull / (1 + BETA), pull - drag)
        return first + speeds**2 / (2 * slowing), times + speeds / slowing

    def grips(self) -> NDArray[np.bool_]:
        """Which of the racers can roll on the plank without slipping (4,)."""
        return np.asarray(tan(self.angle) <= self.friction * (1 + 1 / BETA))

    def build(self, scene: Scene) -> None:
        """A plank on legs with four lanes, four racers on their way up, a padded stop for their return."""
        ways, times = self.climbs()
        way = float(ways.max())
        if way > HIGHEST:
            raise Refusal("R12", f"{self.label}: at {self.speed:.3g} m/s the hoop climbs {way:.3g} m; allowed: "
                          f"{HIGHEST} m, here at {self.speed * sqrt(HIGHEST / way):.3g} m/s")  # fmt: skip
        line = self.line if self.start == "plank" else 0.0
        part = plank(scene, self.angle, line + 1.05 * way + 3 * self.radius, line, self.radius)
        if self.start == "floor":
            scene.spec.delete(part.geom("start_line"))
        padded_stop(scene, self.radius)
        surface = Surface(friction=self.friction)
        for name, density in (("ramp/slope", 700.0), ("ramp/ramp", 700.0), ("stage/floor", 2000.0)):
            scene.material(name, density, surface)
        for name in ("pad/foam", "pad/pad"):
            scene.material(name, 50.0, Surface(friction=self.friction, restitution=0.3))
        up, normal = self.axes()
        centre = self.line * up + self.radius * normal
        velocity = self.speed * up
        if self.start == "floor":
            centre, velocity = np.array([FLAT_START, 0, self.radius]), np.array([-self.speed, 0, 0])
        for lane, racer in enumerate(RACERS):
            free = place(scene, lane, self.radius, self.density, centre).name("free")
            scene.speed[free] = (*velocity, 0, -self.turning * self.speed / self.radius, 0)
            for name in (racer.contact, racer.body):
                scene.material(name, self.density, surface)
            for ground in ("ramp/slope", "stage/floor", "pad/foam"):
                scene.touch(racer.contact, ground)
        slips = self.slip_ends()[0] if self.start == "plank" and self.turning < 1 else np.array([0.3])
        back = FLAT_START / self.speed + float(2.2 * times.max()) + 2 * RUN_OUT / self.speed + 0.3
        scene.resolve(time=float(np.clip(2 * slips.min(), 0.05, 0.6)), length=self.radius,
                      duration=float(np.clip(back, 2.0, 10.0)))  # fmt: skip

    @property
    def line(self) -> float:
        """Where on the plank the racers start [m from its foot]; clear of the floor."""
        return self.radius * (1 + tan(self.angle / 2)) + 0.05

    def axes(self) -> tuple[Array, Array]:
        """Unit vectors up the slope and out of it (3,)."""
        return np.array([-cos(self.angle), 0, sin(self.angle)]), np.array([sin(self.angle), 0, cos(self.angle)])

    def way(self, run: Run) -> Array:
        """Up the slope from its foot, of the point below each centre (4, T) [m]."""
        return np.array([run.position(racer.body) @ self.axes()[0] for racer in RACERS])

    def pace(self, run: Run) -> Array:
        """Of each centre up the slope (4, T) [m/s]."""
        return np.array([run.velocity(racer.body) @ self.axes()[0] for racer in RACERS])

    def tread_pace(self, run: Run) -> Array:
        """ω r of each racer (4, T) [m/s]: its pace, if it rolls without slipping."""
        return np.array([-self.radius * run.spin(racer.body)[:, 1] for racer in RACERS])

    @observable("m")
    def distances(self, run: Run) -> Array:
        """Up the slope from its foot, one column per racer (T, 4)."""
        return self.way(run).T

    @observable("m/s")
    def speeds(self, run: Run) -> Array:
        """Of the centres up the slope (T, 4)."""
        return self.pace(run).T

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """v - ω r, with which the treads slide over the plank (T, 4)."""
        return (self.pace(run) - self.tread_pace(run)).T

    def twin(self, run: Run, **changes: float | str) -> tuple[RollUpSlope, Run]:
        """The same specimen with some parameters changed, and its run; slower, if it climbed too high."""
        specimen = RollUpSlope.make(**(self.values() | changes))
        highest = float(specimen.climbs()[0].max())
        if highest > HIGHEST:
            changes["speed"] = max(0.5, 0.99 * specimen.speed * sqrt(HIGHEST / highest))
            specimen = RollUpSlope.make(**(self.values() | changes))
        return (self, run) if specimen == self else (specimen, run.again(**changes))

    @property
    def enough(self) -> float:
        """Friction with which all roll, and the plank's foot does not make them slip either."""
        return float(max(self.friction, min(1.2 * tan(self.angle) / (1 + 1 / BETA.max()) + 0.1, 0.9)))

    def begins(self, run: Run) -> Array:
        """When each racer's climb begins (4,) [s]: at the start, or when it hits the plank."""
        if self.start == "plank":
            return np.zeros(4)
        found = []
        for racer in RACERS:
            names = {racer.contact, "ramp/slope"}
            times = [i.time for i in run.impacts if {i.first, i.second} == names]
            if not times:
                raise NotEvaluated(f"the {racer.template} does not reach the plank")
            found.append(times[0])
        return np.array(found)

    def summits(self, run: Run) -> tuple[Array, Array]:
        """Times (4,) [s] and ways up from the beginning of the climb (4,) [m] of the first summits."""
        times, heights = [], []
        for way, pace, start in zip(self.way(run), self.pace(run), self.begins(run), strict=True):
            on = run.t >= start
            when, where = peaks(run.t[on], way[on], pace[on])
            if not len(when):
                raise NotEvaluated(f"a racer still climbs when the run ends after {run.t[-1]:.3g} s")
            times.append(when[0] - start)
            heights.append(where[0] - self.foot)
        return np.array(times), np.array(heights)

    @property
    def foot(self) -> float:
        """`way` where the climb begins [m]: on the plank's line, or where a racer touches both floor and plank."""
        return float(self.line if self.start == "plank" else self.radius * tan(self.angle / 2))

    @law("d = (1 + β) v²/(2 g sin α), t = (1 + β) v/(g sin α)", within=(1e-9, 1e-10, 1e-11),
         source="Goldstein, Classical Mechanics, 3rd ed., §2.4")  # fmt: skip
    def climbs_higher_the_more_it_turns(self, run: Run) -> Measurement:
        """12a: way and time of the four to the summit, from a rolling start on the plank."""
        specimen, one = self.twin(run, start="plank", spin=1.0, friction=self.enough)
        times, ways = specimen.summits(one)
        d = (1 + BETA) * specimen.speed**2 / (2 * g * sin(self.angle))
        return np.concatenate([ways / d, times * specimen.speed / (2 * d)]), np.ones(8)

    @law("v' = v (cos α + β)/(1 + β), d = (1 + β) v'²/(2 g sin α)", within=(1e-9, 1e-10, 1e-11),
         source="Landau & Lifshitz, Mechanics, §9 (angular momentum about the line hit); Goldstein §2.4")  # fmt: skip
    def the_foot_of_the_plank_takes_its_share(self, run: Run) -> Measurement:
        """12a from the floor: speed just after the sharp foot, and the way up from there."""
        specimen, one = self.twin(run, start="floor", friction=self.enough)
        begins, after = specimen.begins(one), []
        for pace, begin in zip(specimen.pace(one), begins, strict=True):
            window = between(one.t, begin, begin + 0.5 * float(specimen.climbs()[1].min()), least=3)
            line = fit(one.t[window], pace[window], 1)
            after.append(line[0] + line[1] * (begin - one.t[window][0]))
        kept = specimen.speed * (cos(self.angle) + BETA) / (1 + BETA)
        ways = specimen.summits(one)[1] / ((1 + BETA) * kept**2 / (2 * g * sin(self.angle)))
        return np.concatenate([after / kept, ways]), np.ones(8)

    @law("v_back = v", source="Goldstein, Classical Mechanics, 3rd ed., §2.4 (rolling friction does no work)",
         within=(1e-10, 1e-11, 1e-11))  # fmt: skip
    def comes_back_as_fast(self, run: Run) -> Measurement:
        """12b: speeds of the four at a tenth of the way, down over up."""
        specimen, one = self.twin(run, start="plank", spin=1.0, friction=self.enough)
        ratios = []
        for way, pace in zip(specimen.way(one), specimen.pace(one), strict=True):
            mark = way[0] + 0.1 * (way.max() - way[0])
            up, down = (crossings(one.t, way, pace, mark, rising=rising) for rising in (True, False))
            if not len(down):
                raise NotEvaluated(f"a racer is not back when the run ends after {one.t[-1]:.3g} s")
            ratios.append(-np.interp(down[0], one.t, pace) / np.interp(up[0], one.t, pace))
        return ratios, np.ones(4)

    @law("a = -g (sin α + μ cos α) till v = ω r, then as rolling", within=(1e-3, 3e-4, 1e-4),
         source="Coulomb's law; Goldstein, Classical Mechanics, 3rd ed., §2.4")  # fmt: skip
    def without_spin_friction_brakes_first(self, run: Run) -> Measurement:
        """12c: slowing while it slips, and summit, of racers that start on the plank with little spin."""
        specimen, one = self.twin(run, start="plank", spin=min(self.spin, 0.4), friction=self.enough)
        slowing = []
        for way, end in zip(specimen.way(one), specimen.slip_ends()[0], strict=True):
            window = between(one.t, -1e-9, 0.95 * end)
            slowing.append(-acceleration(one.t[window], way[window]))
        expected = g * (sin(self.angle) + specimen.friction * cos(self.angle))
        ways, times = specimen.climbs()
        when, where = specimen.summits(one)
        return np.concatenate([np.array(slowing) / expected, where / ways, when / times]), np.ones(12)

    @law("d = v²/(2 g sin α), ω = const. without friction", source="Galilei, Discorsi (1638), third day, theorem II",
         within=(1e-9, 1e-10, 1e-11))  # fmt: skip
    def without_friction_all_climb_alike(self, run: Run) -> Measurement:
        """12d: way up of the four, and their spin at the summit over that of the start."""
        specimen, one = self.twin(run, start="plank", friction=0.0, spin=max(self.spin, 0.2))
        times, ways = specimen.summits(one)
        spins = [np.interp(when, one.t, turning) for when, turning in zip(times, specimen.tread_pace(one), strict=True)]
        d = specimen.speed**2 / (2 * g * sin(self.angle))
        return np.concatenate([ways / d, np.array(spins) / (specimen.spin * specimen.speed)]), np.ones(8)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        try:
            first, last = (f"{self.summits(run)[1][i]:.2f} m" for i in (0, 3))
        except NotEvaluated:
            first, last = (f"{self.climbs()[0][i]:.2f} m" for i in (0, 3))
        where = (
            "roll over the floor towards a plank"
            if self.start == "floor"
            else f"start on a plank, turning {self.spin:.0%} as fast as rolling needs,"
        )
        law_ = (
            "What turns with more inertia brings more energy along and climbs higher"
            if self.grips().all()
            else "Friction is too weak to make all of them roll, and what slips gets nothing from its spin"
        )
        return (
            f"A solid ball, a solid cylinder, a hollow ball and a hoop, {100 * self.radius:.0f} cm in radius, {where} "
            f"that slopes by {np.degrees(self.angle):.0f} degrees, all at {self.speed:.2g} m/s. Gravity slows them on "
            f"the way up. {law_}: the ball gets {first} up the slope, the hoop {last}. There they stop, roll back down "
            "and run out over the floor into a padded stop."
        )
