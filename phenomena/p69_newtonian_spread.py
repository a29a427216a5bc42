"""69: something viscous falls and spreads like honey."""

from __future__ import annotations

from math import pi, sin, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.pours import (
    POUR,
    STEEP,
    THIN,
    Poured,
    article,
    block,
    frames,
    ground,
    grown,
    layer,
    layered,
    plates,
    upright,
    viscous_length,
    watch,
)  # fmt: skip
from physinone_mj.base import Choice, Measurement, Param, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Continuum, Newtonian
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

SOFT: Final = 0.019
"""Compression of a laboratory's matter under its own weight: as soft as rule R9 lets it, since no law of theirs but the
hydrostatic one knows κ, and soft matter takes long steps."""
SETTLED: Final = 0.7
"""Of the film, in H²/ν: how long it is watched."""
AFTER: Final = (0.7, 1.4)
"""Of the shear wave, in 1/(ν k²): between which its rate is read off; the next mode has died away."""
SPREAD: Final = 2.8
"""Of the current: length of the similarity solution at the end, in √A."""
LATE: Final = 0.4
"""Of the current: when its laws are held, in the end's time."""
CENTRE: Final = 0.44571
"""Centre of mass of the similarity solution h ∝ (1 - s²)^⅓, 0 < s < 1."""


def late_growth(t: Array, x: Array) -> float:
    """Growth of the fifth power of a length x (T,) [m] at late times t (T,) [s]: [m⁵/s]."""
    late = t > LATE * t[-1]
    return float(np.polyfit(t[late], x[late] ** 5, 1)[0])


class NewtonianFluidFall(Poured, domain="fluids"):
    """Newtonian fluid falls and spreads across a surface: the thicker, the slower."""

    setup: Annotated[
        Literal["drop", "pour", "film", "current", "quick current", "wave", "column", "slump"],
        Choice("something falls; a jet is poured on it; laboratories: a film on a slope, gravity currents, layers that "
               "slide on each other, a column at rest, a column that slumps in a tank"),
    ] = "drop"  # fmt: skip
    viscosity: Annotated[float, Param("Pa s", 25.0, 200.0, "μ; the dynamic viscosity is half of it")] = 120.0
    bulk: Annotated[float, Param("Pa", 1e4, 1e6, "κ; the bulk modulus is sevenfold")] = 4.5e4
    density: Annotated[float, Param("kg/m³", 800.0, 2000.0, "at rest")] = 1000.0

    @property
    def material(self) -> Newtonian:
        """As declared."""
        return Newtonian(self.viscosity, self.bulk, self.density)

    @property
    def watched(self) -> float:
        """Of a scene [s]."""
        return 2.0

    @property
    def nu(self) -> float:
        """Kinematic viscosity η/ρ, η = μ/2 [m²/s]."""
        return self.viscosity / 2 / self.density

    def soft(self, depth: float) -> Newtonian:
        """The fluid, as soft as a depth [m] allows."""
        return Newtonian(self.viscosity, self.density * g * depth / (7 * SOFT), self.density)

    @property
    def depth(self) -> float:
        """Of the film, and of the column [m]."""
        return viscous_length(1.0 if self.setup == "film" else 3.0, self.nu)

    @property
    def wavelength(self) -> float:
        """Of the shear wave [m]."""
        return 4 * viscous_length(1.0, self.nu)

    @property
    def number(self) -> float:
        """√(g L) L/ν of the currents, L² the area of a half of one."""
        return 20.0 if self.setup == "quick current" else 12.0

    def build(self, scene: Scene) -> None:
        """What is below and what falls; or a laboratory."""
        if self.setup in ("drop", "pour"):
            self.refuse_squashed(7 * self.bulk, 0.02, "bulk")
        super().build(scene)

    def laboratory(self, scene: Scene) -> None:
        """The set-up of that name."""
        {
            "film": self.film, "current": self.current, "quick current": self.current, "wave": self.wave,
            "column": self.column, "slump": self.slump,
        }[self.setup](scene)  # fmt: skip

    def film(self, scene: Scene) -> None:
        """A layer on a rough slope without end, from rest."""
        depth = self.depth
        scene.continua.append(layer(self.soft(1.4 * depth), depth, depth, STEEP))
        watch(scene, depth, SETTLED * depth**2 / self.nu)

    def current(self, scene: Scene) -> None:
        """Half a gravity current between plates: a box of 2 L x L/2 let go on a sticky floor."""
        size = viscous_length(self.number, self.nu)
        width = THIN * 2 / 3 * size
        piece = block("current", self.soft(size / 2), (0, -width / 2, 0), (2 * size, width / 2, size / 2))
        scene.continua.append(Continuum([piece], walls=[*plates(width), ground(), upright(0.0, 1)]))
        watch(scene, 2 / 3 * size, self.arrival(size))

    def arrival(self, size: float) -> float:
        """When the similarity solution of a current of area L² is at its end [s]."""
        return float((SPREAD * size / (1.411 * (g * size**6 / (3 * self.nu)) ** 0.2)) ** 5)

    def wave(self, scene: Scene) -> None:
        """Two layers that slide on each other, in a world that repeats itself upwards and along."""
        high = self.wavelength
        length, rate = high / 4, self.nu * (2 * pi / high) ** 2
        sound = 200 * self.nu / high
        fluid = Newtonian(self.viscosity, self.density * sound**2 / 7, self.density)
        width, speed = THIN * length, 0.01 * sound
        pieces = [
            block(name, fluid, (0, -width / 2, low), (length, width / 2, low + high / 2), (side * speed, 0, 0))
            for name, low, side in (("lower", 0.0, -1), ("upper", high / 2, 1))
        ]
        period = (length, float("inf"), high)
        scene.continua.append(Continuum(pieces, walls=plates(width), gravity=(0.0, 0.0, 0.0), period=period))
        watch(scene, length, 1.05 * AFTER[1] / rate)

    def column(self, scene: Scene) -> None:
        """A column in a smooth well, under gravity that grows slowly."""
        depth, fluid = self.depth, self.soft(self.depth)
        width, sound = THIN * depth, sqrt(7 * fluid.bulk / self.density)
        piece = block("column", fluid, (0, -width / 2, 0), (width, width / 2, depth))
        walls = [*plates(width), ground("slip"), upright(0.0, 1), upright(width, -1)]
        scene.continua.append(Continuum([piece], walls=walls, ramp=8 * depth / sound))
        watch(scene, depth, 16 * depth / sound)

    def slump(self, scene: Scene) -> None:
        """A column of 2 L x L in a smooth tank twice as wide."""
        size = viscous_length(3.0, self.nu)
        width = THIN * size
        piece = block("column", self.soft(2 * size), (0, -width / 2, 0), (size, width / 2, 2 * size))
        walls = [*plates(width), ground("slip"), upright(0.0, 1), upright(2 * size, -1)]
        scene.continua.append(Continuum([piece], walls=walls))
        watch(scene, size, 10 * self.nu / (g * size))

    @observable("m")
    def front(self, run: Run) -> Array:
        """Farthest that any of it is along x (T,)."""
        return np.asarray(np.max([cloud.high[:, 0] for cloud in run.clouds.values()], axis=0))

    @law("u = Σ modes → ρ g sin θ (2 H z - z²)/(2 η), η = μ/2", within=(2e-2, 1e-2, 5e-3),
         source="Bird, Stewart & Lightfoot, Transport Phenomena, §2.2 eq. 2.2-18 and problem 4D.2",
         limited_by="affine transfers add a viscosity of their own")  # fmt: skip
    def film_flows_as_a_parabola(self, run: Run) -> Measurement:
        """69a: velocities in eight layers, at the last picture; from rest, so with what is left of the transient."""
        lab, film = self.at_lab(run, "film")
        x, v, _ = grown(film.clouds["layer"], -1)
        z, u = layered(x[:, 2], v[:, 0])
        depth, when = lab.depth, frames(film)[-1]
        pull = g * sin(STEEP)
        due = pull / (2 * self.nu) * (2 * depth * z - z**2)
        for m in range(1, 40, 2):
            decay = np.exp(-((m * pi / (2 * depth)) ** 2) * self.nu * when)
            due = due - 16 * pull * depth**2 / (self.nu * (pi * m) ** 3) * np.sin(m * pi * z / (2 * depth)) * decay
        return u, due

    @law("x_N = 1.411 (g A³/3ν)^⅕ t^⅕, ν = μ/2ρ", source="H. E. Huppert, J. Fluid Mech. 121 (1982) 43, eq. 2.22",
         within=(8e-2, 8e-2, 8e-2), limited_by="that of a thin layer, which a front is not")  # fmt: skip
    def current_spreads_as_the_fifth_root_of_time(self, run: Run) -> Measurement:
        """69b, in the plane: growth of the fifth power of front and centre of mass at late times, as prefactors of the
        front; the current's own beginning of time does not matter to it."""
        lab, current = self.at_lab(run, "current")
        scale = (g * viscous_length(lab.number, lab.nu) ** 6 / (3 * self.nu)) ** 0.2
        cloud = current.clouds["current"]
        reach = (cloud.high[:, 0], cloud.centre[:, 0] / CENTRE)
        return [late_growth(current.t, x) ** 0.2 / scale for x in reach], [1.411, 1.411]

    @law("x̄ ∝ (g L⁶ t/ν)^⅕", source="H. E. Huppert, J. Fluid Mech. 121 (1982) 43, §2: no time scale but ν/(g L)",
         within=(5e-2, 3e-2, 3e-2), limited_by="inertia is small, not nothing")  # fmt: skip
    def viscosity_sets_the_clock(self, run: Run) -> Measurement:
        """69c: growth of the fifth power of the centres of mass of two currents, in the second of which √(g L) L/ν is
        5/3 as great, in the measure of each one's own viscosity, size and weight: both as one front's prefactor."""
        found = []
        for setup in ("current", "quick current"):
            lab, current = self.at_lab(run, setup)
            scale = (g * viscous_length(lab.number, lab.nu) ** 6 / (3 * lab.nu)) ** 0.2
            reach = current.clouds["current"].centre[:, 0] / CENTRE
            found.append(late_growth(current.t, reach) ** 0.2 / scale)
        return found, [1.411, 1.411]

    @law("κ (J⁻⁷ - 1) = ρ g (H - Z)", source="PhysInOne supplement, eq. 7; Landau & Lifshitz, Fluid Mechanics, §3",
         within=(5e-2, 2e-2, 2e-2), limited_by="matter near a wall is known to a cell")  # fmt: skip
    def pressure_is_the_weight_above(self, run: Run) -> Measurement:
        """69d: from the compression of layers of a column at rest, the lowest eighth left out; Z: height before there
        was gravity."""
        lab, column = self.at_lab(run, "column")
        cloud = column.clouds["column"]
        bulk = lab.soft(lab.depth).bulk
        z, p = layered(grown(cloud, 0)[0][:, 2], bulk * (grown(cloud, -1)[2] ** -7 - 1))
        return p[1:], self.density * g * (lab.depth - z[1:])

    @law("ΣJV₀ = V₀", source="by definition: it is hardly compressed", within=(2e-2, 1e-2, 5e-3),
         limited_by="J is added up from the divergence of the velocity")  # fmt: skip
    def volume_stays(self, run: Run) -> Measurement:
        """69e: at the end, of what falls, over what its mass takes at rest."""
        _, cloud = self.scenic(run)
        return cloud.volume[-1] / (cloud.mass[-1] / self.density), 1.0

    @law("z̄ = D/2 (1 - 2 ρ g D/(3·7κ)), D = A/W", source="Landau & Lifshitz, Fluid Mechanics, §3 eq. 3.1",
         within=(3e-2, 3e-2, 2e-2), limited_by="matter near a wall is known to a cell")  # fmt: skip
    def it_fills_what_it_is_in(self, run: Run) -> Measurement:
        """69e, as seen: height of the centre of mass of what has slumped in a tank twice its width, a level pool."""
        _, tank = self.at_lab(run, "slump")
        depth = viscous_length(3.0, self.nu)
        squeezed = 2 * SOFT / 2 / 3
        return tank.clouds["column"].centre[-1, 2], depth / 2 * (1 - squeezed)

    @law("U ∝ exp(-ν k² t), ν = μ/2ρ", source="Landau & Lifshitz, Fluid Mechanics, §24 eq. 24.4",
         within=(3e-2, 1e-2, 5e-3), limited_by="affine transfers add k² Δx⁴/40Δt to ν")  # fmt: skip
    def shear_dies_away(self, run: Run) -> Measurement:
        """69f: rate at which the mean velocity of one layer along the other dies away, in a world without end."""
        lab, wave = self.at_lab(run, "wave")
        rate = lab.nu * (2 * pi / lab.wavelength) ** 2
        slide = wave.clouds["upper"].momentum[:, 0] - wave.clouds["lower"].momentum[:, 0]
        first, last = (int(np.searchsorted(wave.t, when / rate)) for when in AFTER)
        found = np.log(slide[first] / slide[last]) / (wave.t[last] - wave.t[first])
        return found, self.nu * (2 * pi / lab.wavelength) ** 2

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        cloud = self.cloud(run)
        across, high = 2 * self.reach(run)[-1], self.height(run)[-1]
        start = {
            "drop": f"{article(self.shape)} of a honey-like fluid, {self.size:.2g} m high, falls {self.drop:.2g} m",
            "pour": f"A jet of a honey-like fluid is poured for {POUR:.2g} s",
        }.get(self.setup)
        fluid = f"Its viscosity is {self.viscosity / 2:.3g} Pa s"
        if start is None:
            return (
                f"In a laboratory of viscous flow ({self.setup}) {cloud.mass[-1]:.2g} kg of a honey-like fluid moves "
                f"between smooth plates under its own weight. {fluid}, and that alone sets the pace: in "
                f"{run.t[-1]:.2g} s it comes to reach {across:.2g} m across and {high:.2g} m up, as the equations of "
                f"creeping flow say to a few hundredths."
            )
        return (
            f"{start} onto {self.ground}. It piles up for a moment, sinks and spreads, quickly at first and ever more "
            f"slowly: viscous forces carry the weight, so that its width grows only as a small power of time. {fluid}; "
            f"were it twice as thick, it would take twice as long. After {run.t[-1]:.1f} s it is {across:.2g} m across "
            f"and {high:.2g} m high, and it still creeps."
        )
