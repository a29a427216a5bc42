"""71: sand falls, runs out and comes to rest as a heap."""

from __future__ import annotations

from math import asin, atan, cos, degrees, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.pours import (
    POUR,
    THIN,
    Poured,
    article,
    block,
    frames,
    ground,
    grown,
    layer,
    plates,
    spacing,
    upright,
    watch,
)  # fmt: skip
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Ball, Continuum, Granular, Piece
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

FIRM: Final = 0.0095
"""Compression of a laboratory's sand under its own weight: as soft as rule R9 lets it."""
STEEPER: Final = 0.05
"""By which a slope is steeper than the steepest that stands: little, as what slides fast shears the grid."""
GENTLER: Final = 0.15
"""By which one is gentler: nearer to the steepest, the grid lets some layers creep."""
SLIDES: Final = 0.02
"""What slides is faster than this, in √(g h)."""
CLIFFS: Final = 0.85
"""tan θ_c of sand whose heaps may be steeper here and there: in plane strain it bears up to arcsin tan θ_c."""
OVER: Final = 4
"""Cells along over which a deposit's slope is read off."""
DEEP: Final = 5.0
"""Mean height [cells] of a deposit whose area is judged: of thinner ones the lowest grains are a good part."""
LAYER: Final = 0.1
"""Depth of the layer on a slope [m]."""
WIDTH: Final = 0.1
"""Half that of a column [m]."""
SPRAY: Final = 0.06
"""Radius of the ball that flies apart [m]."""
SPIN: Final = 12.0
"""Its angular velocity [rad/s]."""
FLIGHT: Final = 0.12
"""How long it is watched [s]."""
STRAYS: Final = 0.02
"""Of a deposit, what has rolled farthest and does not count as its edge."""
COLLAPSES: Final = ("collapse", "loose collapse", "heavy collapse")
LOOSE: Final = 0.7
"""sin φ of the loose collapse's sand, over that of the others'."""
HEAVY: Final = (2.0, 4.0)
"""Density and gravity of the heavy collapse, over those of the others; its sand is as much stiffer."""


def stands(sine: float) -> float:
    """Slope that just stands [rad], by sin φ: plane shear of a Drucker-Prager cone without dilation."""
    return atan(2 * sqrt(3) * sine / (3 - sine))


class GranularFall(Poured, domain="fluids"):
    """Granular substance falls and disperses across a surface: it runs out and leaves a heap."""

    setup: Annotated[
        Literal["drop", "pour", "gentle slope", "steep slope", "collapse", "loose collapse", "heavy collapse", "spray"],
        Choice("something falls; a jet is poured on it; laboratories: layers on slopes that are gentler, or a "
               "little steeper, than what just stands; columns that collapse, with less friction, or twice as dense "
               "under four times the gravity; a ball that spins and flies apart"),
    ] = "drop"  # fmt: skip
    internal: Annotated[float, Param("rad", pi / 12, pi / 3, "φ, angle of internal friction")] = pi / 6
    cone: Annotated[
        Literal["triaxial", "plane"],
        Choice("in which strain φ is what Mohr and Coulomb call it: that of the source document, or plane"),
    ] = "triaxial"
    aspect: Annotated[float, Param("1", 0.5, 3.0, "height of a laboratory's column over half its width")] = 1.0
    young: Annotated[float, Param("Pa", 1e5, 1e6, "modulus of the sand at rest")] = 4e5
    poisson: Annotated[float, Param("1", 0.2, 0.35, "Poisson's ratio")] = 0.3
    density: Annotated[float, Param("kg/m³", 1200.0, 2500.0, "as it lies")] = 1600.0

    @property
    def sine(self) -> float:
        """sin φ of the cone as the source document writes it (triaxial compression).

        A plane-strain cone α = √2/3 sin φ is that of another, smaller φ.
        """
        if self.cone == "triaxial":
            return sin(self.internal)
        third = sin(self.internal) / sqrt(3)
        return 3 * third / (2 + third)

    def sand(
        self, depth: float | None = None, sine: float | None = None, heavy: tuple[float, float] = (1.0, 1.0)
    ) -> Granular:
        """As declared, or, for laboratories, as soft as a depth [m] allows; with another cone, or denser and under more
        gravity by factors."""
        density = heavy[0] * self.density
        young = self.young if depth is None else density * heavy[1] * g * depth / FIRM
        return Granular(young, self.poisson, density, asin(self.sine if sine is None else sine))

    @property
    def material(self) -> Granular:
        """As declared."""
        return self.sand()

    @property
    def colour(self) -> tuple[float, float, float, float]:
        """Of sand."""
        return (0.85, 0.70, 0.44, 1.0)

    @property
    def watched(self) -> float:
        """Of a scene [s]."""
        return 2.0

    @property
    def steepest(self) -> float:
        """Slope that just stands [rad]."""
        return stands(self.sine)

    @property
    def loose(self) -> float:
        """Slope that just stands of the loose collapse's sand [rad]."""
        return stands(LOOSE * self.sine)

    @property
    def height_of_column(self) -> float:
        """Of a laboratory's column [m]."""
        return self.aspect * WIDTH

    def build(self, scene: Scene) -> None:
        """What is below and what falls; or a laboratory."""
        if self.setup in ("drop", "pour"):
            self.refuse_squashed(self.young, 0.03, "young")  # of what lies still the solver allows 0.01
        super().build(scene)

    def laboratory(self, scene: Scene) -> None:
        """The set-up of that name."""
        {
            "gentle slope": self.slope, "steep slope": self.slope, "spray": self.spray,
            **dict.fromkeys(COLLAPSES, self.collapse),
        }[self.setup](scene)  # fmt: skip

    @property
    def angle(self) -> float:
        """Of the laboratory's slope [rad]."""
        return self.steepest * (1 + STEEPER if self.setup == "steep slope" else 1 - GENTLER)

    def slope(self, scene: Scene) -> None:
        """A layer on a rough slope without end, under gravity that grows."""
        fall = sqrt(LAYER / g)
        scene.continua.append(layer(self.sand(2 * LAYER), LAYER, LAYER, self.angle, ramp=3 * fall))
        watch(scene, LAYER, 7 * fall)

    def collapse(self, scene: Scene) -> None:
        """Half a column between smooth plates, let go on a rough floor."""
        high = self.height_of_column
        width = THIN * 2 / 3 * WIDTH
        less = LOOSE * self.sine if self.setup == "loose collapse" else self.sine
        heavy = HEAVY if self.setup == "heavy collapse" else (1.0, 1.0)
        pull = heavy[1] * g
        piece = block("column", self.sand(high, less, heavy), (0, -width / 2, 0), (WIDTH, width / 2, high))
        walls = [*plates(width), ground(), upright(0.0, 1)]
        scene.continua.append(Continuum([piece], walls=walls, gravity=(0.0, 0.0, -pull)))
        watch(scene, 2 / 3 * WIDTH, 5 * sqrt(high / pull))

    def spray(self, scene: Scene) -> None:
        """A ball thrown up, spinning, that nothing holds together."""
        up = g * FLIGHT / 2
        piece = Piece("spray", self.sand(2 * SPRAY), Ball(SPRAY), (0, 0, 0.5), velocity=(0, 0, up), spin=(0, 0, SPIN))
        scene.continua.append(Continuum([piece]))
        watch(scene, SPRAY, FLIGHT)

    @observable("m/s")
    def fastest(self, run: Run) -> Array:
        """Root mean square speed of the sand (T,)."""
        cloud = self.cloud(run)
        return np.asarray(np.sqrt(2 * cloud.kinetic / cloud.mass))

    def refuse_steeper_than(self, most: float, why: str) -> None:
        """NotEvaluated of sand whose tan θ_c is as great as that."""
        slope = tan(self.steepest)
        if slope >= most:
            raise NotEvaluated(f"tan θ_c = {slope:.3g}: {why}; needed: less than {most:g}")

    @law("tan θ_c = 2√3 sin φ/(3 - sin φ)", source="D. C. Drucker & W. Prager, Q. Appl. Math. 10 (1952) 157, eq. 3, in "
         "simple shear", within=(4e-2, 3e-2, 2e-2), limited_by="the grid: what slides shears it")  # fmt: skip
    def a_slope_stands_up_to_an_angle(self, run: Run) -> Measurement:
        """71a: angles at which friction would hold two slopes as it does, as they gain speed by g cos θ times what it
        lacks: of one that slides, and of a gentler one; where that stands, no more is asked of it."""
        self.refuse_steeper_than(1.0, "shear by so much of the pressure pulls sand apart across some plane")
        found = []
        for setup in ("gentle slope", "steep slope"):
            lab, slid = self.at_lab(run, setup)
            cloud, late = slid.clouds["layer"], slid.t > slid.t[-1] / 2
            speed = cloud.momentum[:, 0] / cloud.mass
            gain = np.polyfit(slid.t[late], speed[late], 1)[0]
            still = setup == "gentle slope" and abs(speed[-1]) < SLIDES * sqrt(g * LAYER)
            found.append(lab.steepest if still else atan(tan(lab.angle) - gain / (g * cos(lab.angle))))
        return found, np.full(2, self.steepest)

    def edge(self, run: Run) -> float:
        """Of a collapse's deposit, strays apart, from the middle [m]."""
        cloud = run.clouds["column"]
        return float(np.quantile(grown(cloud, -1)[0][:, 0], 1 - STRAYS) + spacing(cloud) / 2)

    @law("(R - R₀)/R₀ = 1.2 a (a < 1.8), 1.9 a^⅔ (a > 2.8)",
         source="G. Lube et al., Phys. Rev. E 72 (2005) 041301, eq. 1", within=(3e-1, 2e-1, 2e-1),
         limited_by="a fit to experiments with sands of 30°; a cone without dilation")  # fmt: skip
    def a_column_runs_out(self, run: Run) -> Measurement:
        """71b: of sand whose φ is 30° in plane strain, as it is between plates; a = 1 and 3."""
        found, due = [], []
        for aspect in (1.0, 3.0):
            _, column = self.at_lab(run, "collapse", aspect=aspect, internal=pi / 6, cone="plane")
            found.append(self.edge(column) / WIDTH - 1)
            due.append(1.2 * aspect if aspect < 1.8 else 1.9 * aspect ** (2 / 3))
        return np.array(found) / due, np.ones(2)

    def steepness(self, run: Run) -> float:
        """Of a collapse's deposit, where it is steepest [rad]: tops of strips of a cell, `OVER` cells apart."""
        cloud = run.clouds["column"]
        x, high = grown(cloud, -1)[0][:, [0, 2]].T
        strip = (x / run.cell).astype(int)
        top = np.zeros(strip.max() + 1)
        np.maximum.at(top, strip, high + spacing(cloud) / 2)
        return float(np.arctan(np.max(top[:-OVER] - top[OVER:]) / (OVER * run.cell)))

    @law("tan θ <= 2√3 sin φ/(3 - sin φ); the smaller φ, the farther it runs", within=(8e-2, 5e-2, 3e-2),
         source="D. C. Drucker & W. Prager, Q. Appl. Math. 10 (1952) 157, eq. 3, in simple shear",
         limited_by="a surface is known to a particle")  # fmt: skip
    def a_deposit_is_no_steeper_than_a_slope(self, run: Run) -> Measurement:
        """71c: steepest slopes of two deposits, or those that just stand, where these are steeper; NaN if the sand of
        less friction does not run out farther."""
        self.refuse_steeper_than(CLIFFS, "cliffs of such sand may stand")
        lab, column = self.at_lab(run, "collapse")
        _, loose = self.at_lab(run, "loose collapse")
        if self.edge(loose) <= self.edge(column):
            return np.full(2, np.nan), [self.steepest, self.loose]
        found = [max(self.steepness(column), lab.steepest), max(self.steepness(loose), lab.loose)]
        return found, [self.steepest, self.loose]

    @law("x/H = f(t √(g/H))", source="by definition: sand has no scale of stress, so ρ and g, with E ∝ ρ g H, set none",
         within=(1e-2, 1e-2, 1e-2), limited_by="a picture is taken a little sooner or later")  # fmt: skip
    def weight_sets_the_clock_and_nothing_else(self, run: Run) -> Measurement:
        """71d: path of a column's centre of mass and its edge at the end, in its own height and time: of one of twice
        the density under four times the gravity, beside the first."""
        self.refuse_steeper_than(1.0, "what is pulled apart goes another way each time")
        _, column = self.at_lab(run, "collapse")
        lab, heavy = self.at_lab(run, "heavy collapse")
        due, path = (made.clouds["column"].centre[:, [0, 2]] for made in (column, heavy))
        when = column.t / sqrt(HEAVY[1])
        found = np.append([np.interp(when, heavy.t, x) for x in path.T], self.edge(heavy))
        return found / lab.height_of_column, np.append(due.T, self.edge(column)) / self.height_of_column

    @law("x = (1 + ω t ×) x₀, z = z₀ + v t - g t²/2", within=(2e-2, 1e-2, 1e-2),
         source="G. Klár et al., ACM Trans. Graph. 35 (2016) 103, §4.3: sand that expands is free of stress",
         limited_by="the grid: what shares a cell shares a motion")  # fmt: skip
    def spray_falls_ballistically(self, run: Run) -> Measurement:
        """71e: of a ball that spins and is thrown up: mean square distance from its axis, over the first, at every
        picture, and how far its centre rose and fell, beside its flight."""
        _, spray = self.at_lab(run, "spray")
        cloud, t = spray.clouds["spray"], frames(spray)
        x = cloud.position[:, :, :2].astype(float)
        square = ((x - x.mean(axis=1, keepdims=True)) ** 2).sum(axis=2).mean(axis=1)
        rise, up = cloud.centre[:, 2] - cloud.centre[0, 2], g * FLIGHT / 2
        scale = up**2 / (2 * g)
        flight = up * spray.t - g * spray.t**2 / 2
        return np.concatenate([square / square[0], 1 + rise / scale]), np.concatenate(
            [1 + (SPIN * t) ** 2, 1 + flight / scale]
        )

    @law("Σ 2 (z̄ - z₀) Δx = A", source="by definition: at rest its grains are as dense as before",
         within=(8e-2, 6e-2, 4e-2), limited_by="what flew apart lies as it fell")  # fmt: skip
    def a_heap_is_as_big_as_its_sand(self, run: Run) -> Measurement:
        """71f: area of a collapse's deposit, of strips of a cell, each twice as high as its centre of mass above where
        its lowest grain ends, over the column's. What has run out lies up to half a cell above the floor, which it
        feels that far off: that gap is not sand."""
        self.refuse_steeper_than(1.0, "what is pulled apart lies loose")
        _, column = self.at_lab(run, "collapse")
        cloud = column.clouds["column"]
        x, high = grown(cloud, -1)[0][:, [0, 2]].T
        mean = WIDTH * self.height_of_column / (np.ptp(x) * column.cell)
        if mean < DEEP:
            raise NotEvaluated(f"the deposit is {mean:.3g} cells high on the average; needed: {DEEP:g}")
        strip = (x / column.cell).astype(int)
        count = np.bincount(strip)
        least = np.full(len(count), np.inf)
        np.minimum.at(least, strip, high - spacing(cloud) / 2)
        there = count > 0
        up = np.bincount(strip, high)[there] / count[there] - least[there]
        return 2 * up.sum() * column.cell / (WIDTH * self.height_of_column), 1.0

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        across, high = 2 * self.reach(run)[-1], self.height(run)[-1]
        sand = f"Its grains hold each other by an internal friction of {degrees(self.internal):.0f} degrees"
        start = {
            "drop": f"{article(self.shape)} of dry sand, {self.size:.2g} m high, falls {self.drop:.2g} m",
            "pour": f"A jet of dry sand is poured for {POUR:.2g} s",
        }.get(self.setup)
        if start is None:
            return (
                f"In a laboratory of granular matter ({self.setup}) dry sand is left to gravity. {sand}, so that it "
                f"bears shear only as far as it is pressed together: a slope stands up to one angle and slides beyond "
                f"it, whatever its weight. After {run.t[-1]:.2g} s it reaches {across:.2g} m across and {high:.2g} m "
                f"up."
            )
        return (
            f"{start} onto {self.ground}. {sand} and nothing else: it bursts when it lands, runs out, and stops once "
            f"no part of its surface is steeper than they can bear, about {degrees(self.steepest):.0f} degrees. What "
            f"flies off falls like single stones. After {run.t[-1]:.1f} s a heap is left, {across:.2g} m across and "
            f"{high:.2g} m high."
        )
