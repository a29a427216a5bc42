"""Balls that fall and bounce: Galilei's law of fall, Newton's law of restitution."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, fit
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

COLOURS: Final = ((0.84, 0.27, 0.22), (0.94, 0.76, 0.28), (0.17, 0.58, 0.62), (0.50, 0.38, 0.68), (0.93, 0.90, 0.84))

LEAST_APEX: Final = 0.01
"""Bounces after the first count if they rise higher than this [m]: a nanometre is then 5e-8 of e."""


class VerticalFall(Phenomenon, domain="mechanics"):
    """Objects falling straight down: all alike, whatever they weigh."""

    height: Annotated[float, Param("m", 0.2, 2.5, "lowest point of every ball above the floor")] = 1.5
    restitution: Annotated[float, Param("1", 0.1, 0.8, "ball against floor")] = 0.7
    count: Annotated[int, Param("1", 1, 5, "balls, each smaller and of half the density of the last")] = 3
    radius: Annotated[float, Param("m", 0.03, 0.12, "largest ball")] = 0.1
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "densest ball")] = 2700.0

    @property
    def fall(self) -> float:
        """Time to the floor [s]."""
        return sqrt(2 * self.height / g)

    @property
    def rest(self) -> float:
        """Time until the last bounce [s]."""
        return self.fall * (1 + self.restitution) / (1 - self.restitution)

    def build(self, scene: Scene) -> None:
        """Balls side by side at one height above the floor."""
        bouncy = Surface(friction=0.4, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, bouncy)
        for i in range(self.count):
            ball = scene.add("ball", f"ball{i}")
            radius = self.radius * (1 - 0.12 * i)
            density = max(self.density / 2**i, 100.0)
            geom = ball.geom("ball")
            geom.size[0], geom.mass, geom.rgba = radius, density * 4 / 3 * pi * radius**3, (*COLOURS[i], 1.0)
            place = (0.0, (i - (self.count - 1) / 2) * 2.6 * self.radius, self.height + radius)
            scene.start[ball.name("free")] = free_pose(place)
            scene.material(ball.name("ball"), density, bouncy)
            scene.touch(ball.name("ball"), "stage/floor")
        scene.resolve(time=self.fall / 2, length=self.radius, duration=min(max(3.0, self.rest + 0.5), 10.0))

    def balls(self) -> list[str]:
        """Names of the bodies."""
        return [f"ball{i}/ball" for i in range(self.count)]

    def clearance(self, run: Run, ball: str) -> NDArray[np.float64]:
        """Lowest point of a ball above the floor (T,) [m]."""
        return np.asarray(run.position(ball)[:, 2] - run.model.geom(ball).size[0])

    @observable("m")
    def heights(self, run: Run) -> NDArray[np.float64]:
        """Centre of each ball above the floor, (T, count)."""
        return np.column_stack([run.position(ball)[:, 2] for ball in self.balls()])

    @observable("m/s")
    def falling_speeds(self, run: Run) -> NDArray[np.float64]:
        """Upward velocity of each ball, (T, count)."""
        return np.column_stack([run.velocity(ball)[:, 2] for ball in self.balls()])

    @staticmethod
    def landings(run: Run, ball: str) -> NDArray[np.float64]:
        """Times of a ball's impacts [s]; NotEvaluated if there is none."""
        times = np.array([i.time for i in run.impacts if ball in (i.first, i.second)])
        if len(times) == 0:
            raise NotEvaluated(f"{ball} has not landed")
        return times

    @law("z = h - ½ g t²", source="Galilei, Discorsi, day 3, prop. 2; Newton, Principia, Axioms, scholium",
         within=(1e-9, 1e-10, 1e-11))  # fmt: skip
    def falls_with_g(self, run: Run) -> Measurement:
        """10a: height lost by every ball in units of g t²/2, from its path alone, until it lands."""
        mask = between(run.t, 0.2 * self.fall, self.fall)
        drops = [self.height - self.clearance(run, ball)[mask] for ball in self.balls()]
        return np.array(drops) / self.height, np.tile((run.t[mask] / self.fall) ** 2, (self.count, 1))

    @law("g = 2 h/t²", source="Galilei, Discorsi, day 3, prop. 2", within=(1e-9, 1e-10, 1e-11))
    def acceleration_is_g(self, run: Run) -> Measurement:
        """10a: acceleration of every ball before it lands, by least squares."""
        mask = between(run.t, -1.0, self.fall)
        return [-acceleration(run.t[mask], h) for h in self.heights(run)[mask].T], np.full(self.count, g)

    @law("v = √(2 g h)", source="Galilei, Discorsi, day 3, prop. 3; Landau & Lifshitz, Mechanics, §11",
         within=(1e-7, 1e-8, 1e-9), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def lands_with_torricellis_speed(self, run: Run) -> Measurement:
        """10a: speed just before the first impact, extrapolated from the velocities recorded before it."""
        speeds = []
        for ball in self.balls():
            landed = self.landings(run, ball)[0]
            mask = between(run.t, -1.0, landed)
            start, rate = fit(run.t[mask], run.velocity(ball)[mask, 2], 1)
            speeds.append(-start - rate * (landed - run.t[mask][0]))
        return speeds, np.full(self.count, sqrt(2 * g * self.height))

    @law("hₙ = e²ⁿ h", source="Newton, Principia, Axioms, corollary 6, scholium; Stronge, Impact Mechanics, §2.5",
         within=(1e-6, 1e-6, 1e-6), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def bounces_to_the_same_fraction(self, run: Run) -> Measurement:
        """10b: the coefficient of restitution from up to three apexes of every ball."""
        found = []
        for ball in self.balls():
            times, apexes = self.landings(run, ball), [self.height]
            for start, stop in list(pairwise(times))[:3]:
                mask = (run.t > start) & (run.t < stop)
                if mask.sum() < 5:
                    break
                a, b, c = fit(run.t[mask], self.clearance(run, ball)[mask], 2)
                apex = a - b**2 / (4 * c)
                if apex < LEAST_APEX and len(apexes) > 1:
                    break
                apexes.append(apex)
            if len(apexes) < 2:
                raise NotEvaluated(f"{ball}: the first bounce is too short to be measured")
            found += list(np.sqrt(np.array(apexes[1:]) / apexes[:-1]))
        return found, np.full(len(found), self.restitution)

    @law("t = √(2 h/g) (1 + e)/(1 - e)", source="Falcon et al., Eur. Phys. J. B 3 (1998) 45, eq. 4",
         within=(2e-2, 5e-3, 2e-3), limited_by="bounces shorter than a time step are left out")  # fmt: skip
    def comes_to_rest_after_infinitely_many_bounces(self, run: Run) -> Measurement:
        """10c: when every ball is last found moving; the bounces too short for a time step are the error."""
        lasts = [self.landings(run, ball)[-1] for ball in self.balls()]
        if max(lasts) > run.t[-1] - 0.1:
            raise NotEvaluated("the record ends before the balls rest")
        return lasts, np.full(self.count, self.rest)

    @law("t = √(2 h/g), whatever the mass", source="Galilei, Discorsi, day 1; Newton, Principia, Book III, prop. 6",
         within=(1e-7, 1e-8, 1e-9), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def all_land_together(self, run: Run) -> Measurement:
        """10d: first impact of every ball here and, alone, of one eight times as heavy (or as light)."""
        low, high = 1000.0, 8000.0
        times = [self.landings(run, ball)[0] for ball in self.balls()]
        twin = run.again(count=1, density=high if self.density < 4000.0 else low)
        return [*times, self.landings(twin, "ball0/ball")[0]], np.full(self.count + 1, self.fall)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        several = self.count > 1
        what = f"{self.count} balls of different size and mass are" if several else "A ball is"
        bounces = int(np.sum(np.diff(self.landings(run, "ball0/ball")) > 0.1))
        return (
            f"{what} released from rest {self.height:.2f} m above the floor. {'They fall' if several else 'It falls'} "
            f"straight down with the acceleration of gravity, whatever the mass, and "
            f"{'land together' if several else 'lands'} after {self.fall:.2f} s at {sqrt(2 * g * self.height):.1f} "
            f"m/s. Every bounce returns {self.restitution**2:.0%} of the height; after {bounces} bounces that can be "
            f"seen, the motion dies out {self.rest:.1f} s after the release."
        )
