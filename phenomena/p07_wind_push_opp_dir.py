"""A fan blows at what comes rolling or sliding towards it: slowed, stopped, blown back, or through to the fan."""

from __future__ import annotations

from math import nan, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import Box, Wind, fan
from physinone_mj.measure import crossings, fit, peaks, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .winds import BODIES, GRIP, HEIGHT, LONGEST, Course, course, foam, mover, twin

Array = NDArray[np.float64]

BEHIND: Final = -0.8
"""Where the pad behind the fan stands [m]."""

MARGIN: Final = 1e-4
"""A body this much slower than it takes must not reach the fan, this much faster must (of the speed)."""


class WindPushOppDir(Phenomenon, domain="mechanics"):
    """Wind applied to objects moving in the opposite direction."""

    speed: Annotated[float, Param("m/s", 0.3, 4.0, "at the start, towards the fan")] = 1.5
    force: Annotated[float, Param("N", 0.05, 20.0, "of the wind at the fan")] = 3.4
    length: Annotated[float, Param("m", 0.8, 3.0, "of the wind, from the fan to its end")] = 1.6
    start: Annotated[float, Param("1", 0.6, 1.5, "distance of the start from the fan, in lengths of the wind")] = 1.35
    mass: Annotated[float, Param("kg", 0.05, 5.0, "body")] = 0.5
    radius: Annotated[float, Param("m", 0.03, 0.06, "body")] = 0.05
    friction: Annotated[float, Param("1", 0.0, 0.3, "of the puck on the floor; the ball rolls without loss")] = 0.02
    body: Annotated[Literal["ball", "puck"], Choice("rolls, or slides with friction")] = "ball"

    @property
    def inertia(self) -> float:
        """What resists the wind [kg]: m (1 + β) for what rolls."""
        return self.mass * (1 + BODIES[self.body].beta)

    @property
    def resistance(self) -> float:
        """Of the floor [N]."""
        return self.friction * self.mass * g if self.body == "puck" else 0.0

    @property
    def enters(self) -> float:
        """Where the wind begins to push it, from the fan [m]."""
        return min(self.start, 1.0) * self.length

    @property
    def far(self) -> float:
        """Where the pad behind the start stands, from the fan [m]."""
        return max(self.start, 1.0) * self.length + 0.6

    @property
    def wind(self) -> Wind:
        """The effect."""
        box = Box((0.0, 0.0, HEIGHT), (1.0, 0.0, 0.0), self.length, 0.5, 2 * HEIGHT)
        return Wind(box, self.force, (BODIES[self.body].name,))

    def push(self, s: float) -> float:
        """Force [N] at distance s from the fan, written out independently of the effect."""
        return self.force * (1 - s / self.length) ** 2 if 0 <= s <= self.length else 0.0

    def course(self) -> Course:
        """What will come of it, to 1e-6."""
        low, high = BEHIND + self.radius, self.far - self.radius
        return course(self.push, self.inertia, self.resistance, self.start * self.length, -self.speed, low, high)

    def build(self, scene: Scene) -> None:
        """A fan hung in a gate, the body on its way towards it, a pad behind the fan and one behind the start."""
        way, body = self.course(), BODIES[self.body]
        meets = way.t[np.nonzero((way.s <= 0) | (way.v >= 0))[0][:1]]
        if not len(meets) or meets[0] > 0.9 * LONGEST:
            raise Refusal("R12", f"speed = {self.speed:.3g} m/s takes the body neither to the fan nor back within 9 s; "
                          f"allowed: {self.speed * way.t[-1] / 6:.3g} m/s, or a shorter wind")  # fmt: skip
        scene.effects.append(self.wind)
        fan(scene, self.wind.box)
        part = mover(scene, self.body, self.radius, self.mass, GRIP if body.beta else self.friction)
        place = (self.start * self.length, 0.0, self.radius * body.half_height)
        scene.start[part.name("free")] = free_pose(place)
        scene.speed[part.name("free")] = (-self.speed, 0, 0, 0, -self.speed / self.radius if body.beta else 0.0, 0)
        if way.s.min() < self.radius:
            foam(scene, "near_pad", BEHIND, 1, body.name)
        foam(scene, "far_pad", self.far, -1, body.name)
        fastest = float(np.abs(way.v).max())
        duration = float(np.clip(way.t[-1] + 0.7, 2.0, LONGEST))
        hardest = max(self.push(float(x)) for x in way.s)
        time = min(self.length / fastest, self.inertia * fastest / hardest) / 2 if hardest else self.length / fastest
        scene.resolve(time=time, length=self.radius, duration=duration)

    @observable("m")
    def distance(self, run: Run) -> Array:
        """From the fan to the centre of mass, along the wind."""
        return run.position(BODIES[self.body].name)[:, 0]

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the centre of mass, away from the fan."""
        return run.velocity(BODIES[self.body].name)[:, 0]

    @observable("N")
    def wind_force(self, run: Run) -> Array:
        """On the body; nothing outside the wind."""
        return np.array([self.push(s) for s in self.distance(run)])

    def needed(self) -> float:
        """Least speed at the entry that carries it to the fan against the wind alone [m/s]."""
        into = 1 - (1 - self.enters / self.length) ** 3
        return sqrt(2 * self.force * self.length / (3 * self.inertia) * into)

    def rolls(self, s: float) -> None:
        """A ball that slips, where the wind is strongest on its way, obeys other laws."""
        beta = BODIES[self.body].beta
        grip = beta / (1 + beta) * self.push(s) / (self.mass * g)
        if grip > 0.99 * GRIP:
            raise NotEvaluated(f"the wind makes the ball slip: friction needed: {grip:.3g}, there is {GRIP}")

    def free(self, run: Run) -> tuple[WindPushOppDir, Run]:
        """This run, or a twin, without friction."""
        return twin(self, run, friction=0.0) if self.resistance else (self, run)

    def turning(self, run: Run) -> tuple[WindPushOppDir, Run]:
        """This run, or a twin, in which the body turns, without friction."""
        enough = self.needed()
        slower = {"speed": 0.8 * enough} if self.speed > 0.99 * enough else {}
        without = {"friction": 0.0} if self.resistance else {}
        specimen, one = twin(self, run, **slower, **without)
        specimen.rolls(specimen.turns_at())
        return specimen, one

    def turns_at(self) -> float:
        """Distance from the fan at which a body without friction turns (7a) [m]."""
        spent = 3 * self.inertia * self.speed**2 / (2 * self.force * self.length)
        return float(self.length * (1 - ((1 - self.enters / self.length) ** 3 + spent) ** (1 / 3)))

    def turn(self, run: Run) -> tuple[float, float]:
        """(time [s], distance from the fan [m]) of the turn; NaN if there should be one and is not."""
        if self.velocity(run).max() < 1e-6:
            if not (self.course().v > 0).any():
                raise NotEvaluated("friction holds it where it stops")
            return nan, nan
        times, heights = peaks(run.t, -self.distance(run), -self.velocity(run))
        return float(times[0]), -float(heights[0])

    def speeds_at_entry(self, run: Run) -> tuple[float, float]:
        """On the way in and on the way back, where the wind begins to push [m/s]."""
        s, v = self.distance(run), self.velocity(run)
        back, into = (crossings(run.t, s, v, self.enters, rising=up) for up in (True, False))
        if not len(back):
            raise NotEvaluated("the run ends before it is back")
        return -self.speed_at(run, into[0]) if len(into) else self.speed, self.speed_at(run, back[0])

    def speed_at(self, run: Run, when: float) -> float:
        """At the moment of passing the entry [m/s]: where the wind ends, from the even motion outside it."""
        v = self.velocity(run)
        if self.start < 1:
            return float(make_interp_spline(run.t, v, k=5)(when))
        end = min((i.time for i in run.impacts if "far_pad/foam" in (i.first, i.second)), default=np.inf)
        outside = (self.distance(run) >= self.enters) & (np.abs(run.t - when) < 0.1) & (run.t < end)
        if outside.sum() < 4:
            raise NotEvaluated(f"{outside.sum()} samples beside the entry; needed: 4")
        line = fit(run.t[outside], v[outside], 1)
        return float(line[0] + line[1] * (when - run.t[outside][0]))

    @law("s = L [1 - ((1 - s₀/L)³ + 3 mₑ v₀²/(2 F₀ L))^⅓]",
         source="Landau & Lifshitz, Mechanics, §11 (turning points; work of F₀(1 - s/L)²)", unit="L",
         within=(2e-5, 2e-6, 2e-7))  # fmt: skip
    def turns_where_its_energy_is_spent(self, run: Run) -> Measurement:
        """7a: distance from the fan at the turn, in lengths of the wind; mₑ = m, or m (1 + β) for what rolls."""
        specimen, one = self.turning(run)
        return specimen.turn(one)[1] / specimen.length, specimen.turns_at() / specimen.length

    @law("v(s₀) = v₀ on the way back", source="Landau & Lifshitz, Mechanics, §5-6 (time reversed)",
         within=(1e-7, 5e-9, 5e-10))  # fmt: skip
    def comes_back_as_fast_as_it_came(self, run: Run) -> Measurement:
        """7b: speed where the wind begins to push."""
        specimen, one = self.turning(run)
        return specimen.speeds_at_entry(one)[1] / specimen.speed, 1.0

    @law("v₀² > (2 F₀ L/3 mₑ)[1 - (1 - s₀/L)³]",
         source="Landau & Lifshitz, Mechanics, §11 (turning points; work of F₀(1 - s/L)²)", within=(5e-4, 5e-4, 5e-4),
         limited_by="the width of the bracket")  # fmt: skip
    def reaches_the_fan_if_fast_enough(self, run: Run) -> Measurement:
        """7c: a body a little slower turns, a little faster one passes below the fan; squares of the two speeds."""
        self.rolls(0.0)
        enough = self.needed()
        without = {"friction": 0.0} if self.resistance else {}

        def reaches(speed: float) -> bool:
            specimen, one = twin(self, run, speed=speed, **without)
            s = specimen.distance(one)
            if s.min() > 0 and not (specimen.velocity(one) > 0).any():
                raise NotEvaluated(f"it neither turns nor arrives within {one.t[-1]:.3g} s")
            return bool(s.min() < 0)

        return threshold(reaches, enough, spread=MARGIN, resolution=2 * MARGIN) ** 2, enough**2

    @law("v² = v₀² - 4 μ g |s₀ - s|", source="Coulomb, Théorie des machines simples (1785); Landau & Lifshitz, "
         "Mechanics, §5-6", within=(1e-3, 1e-4, 1e-5),
         limited_by="the turn is read off between samples, where the force of friction jumps")  # fmt: skip
    def friction_takes_its_share_twice(self, run: Run) -> Measurement:
        """7d: square of the speed of a puck with friction when it is back where the wind begins to push."""
        needed = self.needed() * sqrt(self.inertia / self.mass)
        speed = min(self.speed, 0.9 * needed)
        bearable = 0.6 * speed**2 / (4 * g * self.start * self.length)  # so that it does come back
        specimen, one = twin(self, run, body="puck", speed=speed, friction=min(self.friction or 0.02, bearable))
        _, turn = specimen.turn(one)
        into, back = specimen.speeds_at_entry(one)
        return back**2, into**2 - 4 * specimen.friction * g * (specimen.enters - turn)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        s, v = self.distance(run), self.velocity(run)
        ball = self.body == "ball"
        if s.min() < 0:
            fate = f"It is fast enough to reach the fan, passes below it at {-v[np.argmax(s < 0)]:.2f} m/s and goes on."
        elif v.max() > 1e-6:
            fate = (
                f"It stops for an instant {s.min():.2f} m from the fan, is blown back and leaves at up to "
                f"{v.max():.2f} m/s."
            )
        else:
            fate = f"It comes to rest {s.min():.2f} m from the fan, where friction holds it against the wind."
        return (
            f"{'An orange ball' if ball else 'A blue puck'} of {self.mass:.2g} kg {'rolls' if ball else 'slides'} at "
            f"{self.speed:.2f} m/s towards a fan, into a wind whose push grows from nothing, {self.length:.1f} m away, "
            f"to {self.force:.2g} N at the blades. Blown from the front, it slows down as its kinetic energy is spent "
            f"on work against the wind. {fate}"
        )
