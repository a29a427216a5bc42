"""67: something elastic falls, is squashed and jumps up again."""

from __future__ import annotations

from math import pi, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from phenomena.lumps import CLEAR, Lump, within_walls
from phenomena.pours import watch
from physinone_mj.base import Choice, Measurement, NotEvaluated, law, observable
from physinone_mj.continuum import Ball, Box, Elastic, Wall, lame
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

SQUASHED: Final = 0.3
"""Largest ρ g h/E (rule R9): more turns matter inside out where it lands."""
FAST: Final = 0.1
"""Speed of a bar that hits the floor, in that of sound: slower ones yield by less than a cell."""
LONG: Final = 2.0
"""Length of a bar or a column, in the scene's shortest length: 16 cells at draft."""
THIN: Final = 1 / 4
"""Half their width, in the shortest length."""
GENTLE: Final = 0.02
"""Speed of the ball, in that of sound in a thin bar."""
SAG: Final = 5e-3
"""By which the column's weight compresses it at its foot."""
SWINGS: Final = 3
"""Periods of the column that are watched."""

GRID = "the grid: a floor is felt a cell before it is touched, and what is sudden is lost"


class ElasticFall(Lump, domain="fluids"):
    """Elastic object falls and bounces: squashed where it lands, it jumps up and wobbles on."""

    setup: Annotated[
        Literal["drop", "bar", "ball", "column"],
        Choice("something falls; laboratories: a bar hits the floor end first, a ball hits it gently, a column in a "
               "smooth well sags and swings when its weight is switched on"),
    ] = "drop"  # fmt: skip

    @property
    def material(self) -> Elastic:
        """As declared."""
        return Elastic(self.young, self.poisson, self.density)

    @property
    def length(self) -> float:
        """Of a bar or a column [m]."""
        return LONG * self.size

    @property
    def modulus(self) -> float:
        """M = λ + 2 μ, of what cannot get wider [Pa]."""
        mu, lam = lame(self.young, self.poisson)
        return lam + 2 * mu

    @property
    def pitch(self) -> float:
        """Period of a column held at its foot [s]: 4 L/c, c = √(M/ρ)."""
        return 4 * self.length * sqrt(self.density / self.modulus)

    @property
    def weight(self) -> float:
        """The column's gravity [m/s²]."""
        return SAG * self.modulus / (self.density * self.length)

    def build(self, scene: Scene) -> None:
        """Floor or obstacle, and what falls; or a laboratory."""
        if self.setup == "drop":
            self.refuse_soft(SQUASHED)
        super().build(scene)

    def laboratory(self, scene: Scene) -> None:
        """The set-up of that name."""
        {"bar": self.bar, "ball": self.ball, "column": self.column}[self.setup](scene)

    def bar(self, scene: Scene) -> None:
        """A square bar of the same E and density, but ν = 0: as it does not get wider, it is a line."""
        half, thin = self.length / 2, THIN * self.size
        self.stand(scene, Elastic(self.young, 0.0, self.density), Box((thin, thin, half)), half,
                   fall=FAST * self.sound, gap=1.7 * CLEAR * self.size)  # fmt: skip
        watch(scene, self.size, (1.7 * CLEAR / FAST + 2.9 * LONG) * self.size / self.sound)

    def ball(self, scene: Scene) -> None:
        """A ball, a gentle throw above the floor, without weight."""
        speed = GENTLE * self.sound
        self.stand(scene, self.material, Ball(self.size), self.size, fall=speed, gap=1.6 * CLEAR * self.size)
        watch(scene, self.size, 1.6 * CLEAR * self.size / speed + 1.35 * self.hertz())

    def column(self, scene: Scene) -> None:
        """A column that fills a smooth well and sticks to its bottom; at the start its weight is switched on."""
        half, thin = self.length / 2, THIN * self.size
        made = self.stand(scene, self.material, Box((thin, thin, half)), half, gravity=(0.0, 0.0, -self.weight),
                          grip="stick")  # fmt: skip
        made.walls += [Wall(point, normal, "slip") for point, normal in within_walls(thin)]
        watch(scene, self.size, 1.05 * SWINGS * self.pitch)

    def hertz(self) -> float:
        """Time that the ball touches the floor [s]: 2.868 (m²/(R E*² v))^⅕, E* = E/(1 - ν²)."""
        radius, mass = self.size, self.density * 4 / 3 * pi * self.size**3
        star = self.young / (1 - self.poisson**2)
        return float(2.868 * (mass**2 / (radius * star**2 * GENTLE * self.sound)) ** 0.2)

    @observable("m")
    def centre_height(self, run: Run) -> Array:
        """Of the centre of mass (T,)."""
        return self.cloud(run).centre[:, 2]

    @observable("J")
    def strain_energy(self, run: Run) -> Array:
        """Elastic energy (T,)."""
        return self.cloud(run).elastic

    @observable("m")
    def squeeze(self, run: Run) -> Array:
        """Its height over the floor plan's mean width, less that at the start, times its size (T,)."""
        cloud = self.cloud(run)
        sides = cloud.high - cloud.low
        ratio = sides[:, 2] / sides[:, :2].mean(axis=1)
        return np.asarray(self.size * (ratio - ratio[0]))

    @law("t = L/U + L/c(F), U² = μ (1 + 1/F)/ρ, v = U (1 - F)", within=(2.5e-2, 1.5e-2, 1.5e-2), limited_by=GRID,
         source="J. D. Achenbach, Wave propagation in elastic solids, §1.4, and the speed of shocks")  # fmt: skip
    def a_bar_touches_for_as_long_as_sound_takes_there_and_back(self, run: Run) -> Measurement:
        """67a: times that the floor pushes a bar of ν = 0 that hits it end first.

        At a tenth of the speed of sound it is not quite 2 L/c. The floor's push runs up the bar as a shock, behind
        which it is compressed to F; what comes back from the free end spreads, and when a quarter of it has come the
        push is down to a half.
        """
        _, bar = self.at_lab(run, "bar")
        return self.pressed(bar), self.there_and_back()

    def there_and_back(self) -> float:
        """Time that a bar's floor pushes with more than half its force [s]."""
        mu, speed = self.young / 2, FAST * self.sound
        low = float(brentq(lambda f: (1 - f) ** 2 * (1 + 1 / f) - self.density * speed**2 / mu, 0.2, 1.0))
        stress = 0.75 * (low - 1 / low)  # in μ; F - 1/F = s has the root F = s/2 + √(s²/4 + 1)
        later = stress / 2 + sqrt(stress**2 / 4 + 1)
        shock, back = (sqrt(mu / self.density * (1 + x)) for x in (1 / low, 1 / later**2))
        return self.length * (1 / shock + 1 / back)

    @law("t ∝ L √(ρ/E)", within=(2.5e-2, 1.5e-2, 1.5e-2), limited_by=GRID,
         source="J. D. Achenbach, Wave propagation in elastic solids, §1.4: 2 L/c")  # fmt: skip
    def a_stiffer_bar_touches_for_less(self, run: Run) -> Measurement:
        """67f: for bars four times as stiff, twice as dense and two thirds as long (or their inverse), in the time that
        the first one ought to take."""
        found, due = [], []
        for name, factor in (("young", 4.0), ("density", 2.0), ("size", 2 / 3)):
            param, _ = self.declarations()[name]
            value = getattr(self, name)
            other = value * factor if param.check(value * factor, float) is None else value / factor
            twin = run.again(**{"setup": "bar", name: other})
            found.append(self.pressed(twin) / self.there_and_back())
            due.append((other / value) ** {"young": -0.5, "density": 0.5, "size": 1.0}[name])
        return found, due

    @law("v' = v", source="J. D. Achenbach, Wave propagation in elastic solids, §1.4: no wave is left in the bar",
         within=(8e-2, 4e-2, 2e-2), limited_by=GRID)  # fmt: skip
    def a_bar_jumps_up_as_fast_as_it_came(self, run: Run) -> Measurement:
        """67a: speed of the centre of mass afterwards."""
        _, bar = self.at_lab(run, "bar")
        return np.gradient(bar.clouds["bar"].centre[:, 2], bar.t)[-2], FAST * self.sound

    @law("t = 2.868 (m²/(R E*² v))^⅕", source="K. L. Johnson, Contact mechanics, §11.4 eq. 11.23-11.24",
         within=(9e-2, 7e-2, 7e-2), limited_by=GRID + "; and Hertz's theory is that of small flats")  # fmt: skip
    def a_ball_touches_as_hertz_says(self, run: Run) -> Measurement:
        """67b: from the time between half the speed down and half the speed up, of which Hertz's law of force makes a
        known part of the whole."""
        _, ball = self.at_lab(run, "ball")
        up = ball.clouds["bar"].momentum[:, 2]
        if up[-1] <= 0:
            raise NotEvaluated("the ball does not leave the floor while it is watched")
        share = np.where(up < 0, up / -up[0], up / up[-1])
        turn = int(np.argmax(share > 0))
        first, last = (np.interp(level, share[part], ball.t[part]) for level, part in
                       ((-0.5, slice(0, turn)), (0.5, slice(turn, None))))  # fmt: skip
        whole, middle = (quad(lambda u: 1 / sqrt(1 - u**2.5), low, 1)[0] for low in (0.0, 0.75**0.4))
        return (last - first) * whole / middle, self.hertz()

    @law("v' <= v", source="by definition: nothing drives it; and its waves take next to nothing of so gentle a touch",
         within=(5e-2, 2e-2, 1e-2), limited_by=GRID)  # fmt: skip
    def a_ball_jumps_up_hardly_slower(self, run: Run) -> Measurement:
        """67d: its speed afterwards, over that before; NaN if it is the greater."""
        _, ball = self.at_lab(run, "ball")
        up = ball.clouds["bar"].momentum[:, 2] / ball.clouds["bar"].mass
        return up[-1] if up[-1] <= -up[0] else np.nan, GENTLE * self.sound

    @law("T = 4 L/c, c² = (λ + 2 μ)/ρ", source="J. D. Achenbach, Wave propagation in elastic solids, §1.6",
         within=(2.5e-2, 1e-2, 5e-3), limited_by=GRID)  # fmt: skip
    def a_column_swings_at_its_own_pitch(self, run: Run) -> Measurement:
        """67c: time from one lowest place of the centre of mass to the next."""
        times, _, _ = self.swing(run)
        return (times[-1] - times[0]) / (len(times) - 1), self.pitch

    @law("Δz = ρ g L²/(3 M)", source="Landau & Lifshitz, Theory of elasticity, §5: its own weight",
         within=(4e-2, 1e-2, 5e-3), limited_by=GRID)  # fmt: skip
    def a_column_sags_under_its_weight(self, run: Run) -> Measurement:
        """67c: mean depth of the centre of mass below its place at rest, over whole periods; by M and by density."""
        own, column = self.at_lab(run, "column")
        times, _, height = self.swing(run)
        whole = (column.t >= times[0]) & (column.t <= times[-1])
        sag = column.clouds["bar"].centre[0, 2] - np.trapezoid(height[whole], column.t[whole]) / np.ptp(column.t[whole])
        return sag, self.density * own.weight * self.length**2 / (3 * self.modulus)

    @law("A = ρ g L²/(3 M)", source="Landau & Lifshitz, Mechanics, §25: without friction", within=(4e-2, 2.5e-2, 1e-2),
         limited_by=GRID)  # fmt: skip
    def a_column_goes_on_swinging(self, run: Run) -> Measurement:
        """67c: half the way from the last highest place to the last lowest one, from rest at the start."""
        own, column = self.at_lab(run, "column")
        times, lows, height = self.swing(run)
        between = (column.t > times[-2]) & (column.t < times[-1])
        return (height[between].max() - lows[-1]) / 2, self.density * own.weight * self.length**2 / (3 * self.modulus)

    def swing(self, run: Run) -> tuple[Array, Array, Array]:
        """When the column's centre of mass is lowest (n,) [s], its heights then (n,), and at all times (T,) [m]."""
        _, column = self.at_lab(run, "column")
        height = column.clouds["bar"].centre[:, 2]
        slope = np.gradient(height, column.t)
        smooth = np.convolve(slope, np.ones(9) / 9, "same")
        turns = np.flatnonzero((smooth[4:-5] < 0) & (smooth[5:-4] >= 0)) + 4
        times = column.t[turns] - smooth[turns] * np.diff(column.t)[turns] / (smooth[turns + 1] - smooth[turns])
        if len(times) < 2:
            raise NotEvaluated(f"{len(times)} lowest places recorded; needed: 2")
        return times, np.interp(times, column.t, height), height

    def caption(self, run: Run) -> str:
        """What falls on what, how high it jumps, and how it ends."""
        cloud = self.cloud(run)
        height = cloud.centre[:, 2]
        lowest = int(np.argmin(height[: len(height) // 2]))
        jump = height[lowest:].max() - height[lowest]
        return (
            f"An elastic {self.shape} {100 * self.size:.0f} cm high, with a Young's modulus of {self.young:.2g} Pa, "
            f"falls {100 * self.drop:.0f} cm onto {self.ground}. Where it lands it is squashed, and its energy of "
            f"motion becomes one of strain; it pushes itself off again, and its centre rises by {100 * jump:.1f} cm. "
            f"In the air it wobbles, stretched and squeezed in turn. Every further bounce is lower than the one "
            f"before, as waves within it and friction at the ground keep a part of the energy."
        )
