"""68: a lump of plasticine falls, is flattened and stays flat."""

from __future__ import annotations

from math import log, pi, sin, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.optimize import brentq

from phenomena.lumps import CLEAR, NEAR, Lump
from phenomena.pours import STEEP, layer, spacing, watch
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Box, Plasticine
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

STIFF: Final = 5.0
"""Least E/τ_Y: with less it is rubber that hardly yields."""
SQUASHED: Final = 0.3
"""Largest ρ g h/E (rule R9)."""
FIRM: Final = 100.0
"""E/τ_Y of a laboratory's matter: no law of theirs knows E, and soft matter takes long steps."""
DEAD: Final = 0.02
"""v'²/v² up to which what falls is asked not to jump, nor to shake, v' = σ_y/√(ρ E)."""
LATE: Final = 1.0
"""Of a scene, how long what has fallen is asked to stay as it is [s]."""
SLENDER: Final = 2.5
"""Height of a column over its width."""
FELL: Final = 0.4
"""ρ v²/2σ_y of the rod that hits the floor."""
LONG: Final = 4.0
"""Length of the rod over its width."""
COLUMNS: Final = {"low column": 0.9, "tall column": 1.3}
"""ρ g H/σ_y."""
LAYERS: Final = {"thin layer": 0.9, "thick layer": 2.0}
"""Depth over the least one that flows."""
RAMPS: Final = {"thin layer": (8.0, 14.0), "thick layer": (24.0, 16.0)}
"""How long their weight grows and how long they are watched, in the time that shear waves take across them."""
CREEP: Final = (0.015, 0.025)
"""Speeds of a layer between which it is said to creep, in √(g h)."""

GRID = "the grid: what is sudden is lost, and edges are a cell wide"
HASTE = "a column that sinks goes past its rest: its weight grows in six times √(H/g), not slowly without end"


class PlasticineFall(Lump, domain="fluids"):
    """Plasticine falls and is flattened: it keeps the shape that the impact gave it, and hardly jumps."""

    setup: Annotated[
        Literal["drop", "rod", "low column", "tall column", "thin layer", "thick layer"],
        Choice("something falls; laboratories: a rod hits the floor end first; columns, and layers on a slope, the "
               "first of which hold and the second of which do not"),
    ] = "drop"  # fmt: skip
    young: Annotated[float, Param("Pa", 1e4, 1e6, "Young's modulus")] = 1.5e5
    poisson: Annotated[float, Param("1", 0.2, 0.4, "Poisson's ratio")] = 0.3
    density: Annotated[float, Param("kg/m³", 500.0, 3000.0, "at rest")] = 1200.0
    yield_stress: Annotated[float, Param("Pa", 100.0, 1e4, "τ_Y; the shear strength times √2")] = 2500.0
    drop: Annotated[float, Param("m", 0.1, 1.0, "from the lowest point of it to what is below")] = 0.2

    @property
    def material(self) -> Plasticine:
        """As declared."""
        return Plasticine(self.young, self.poisson, self.density, self.yield_stress)

    @property
    def firm(self) -> Plasticine:
        """As strong and as dense, and as soft as laboratories allow."""
        return Plasticine(FIRM * self.yield_stress, self.poisson, self.density, self.yield_stress)

    @property
    def strength(self) -> float:
        """σ_y = √(3/2) τ_Y, of a bar pulled or pressed [Pa]."""
        return sqrt(1.5) * self.yield_stress

    @property
    def springs(self) -> float:
        """Share of the fall's energy that what it stores until it yields may give back: v'²/v²."""
        return self.strength**2 / (self.density * self.young * 2 * g * self.drop)

    @property
    def stands(self) -> float:
        """Height of the highest column that keeps it [m]."""
        return self.strength / (self.density * g)

    @property
    def clings(self) -> float:
        """Depth of the deepest layer that stays on the slope [m]: ρ g h sin θ = τ_Y/√2."""
        return self.yield_stress / (sqrt(2) * self.density * g * sin(STEEP))

    @property
    def tall(self) -> float:
        """Height of the column, or depth of the layer, of this set-up [m]."""
        if self.setup in COLUMNS:
            return COLUMNS[self.setup] * self.stands
        return LAYERS[self.setup] * self.clings

    @property
    def speed_of_fall(self) -> float:
        """Of the rod [m/s]."""
        return sqrt(2 * FELL * self.strength / self.density)

    def build(self, scene: Scene) -> None:
        """Floor or obstacle, and what falls; or a laboratory."""
        if self.setup == "drop":
            self.refuse_soft(SQUASHED)
            if self.young < STIFF * self.yield_stress:
                raise Refusal("R12", f"{self.label}: E/τ_Y = {self.young / self.yield_stress:.3g} is rubber's, not "
                              f"plasticine's; allowed: {STIFF:g} or more")  # fmt: skip
        super().build(scene)

    def laboratory(self, scene: Scene) -> None:
        """The set-up of that name."""
        {"rod": self.rod, "low column": self.column, "tall column": self.column, "thin layer": self.sheet,
         "thick layer": self.sheet}[self.setup](scene)  # fmt: skip

    def rod(self, scene: Scene) -> None:
        """A square rod, end first, on a smooth floor, without weight."""
        half = self.size
        thin, gap, fall = half / LONG, 2 * CLEAR * self.size, self.speed_of_fall
        self.stand(scene, self.firm, Box((thin, thin, half)), half, fall=fall, gap=gap)
        watch(scene, self.size, (gap + 5 * half) / fall)

    def column(self, scene: Scene) -> None:
        """A square column on a smooth floor, whose weight grows slowly."""
        high = self.tall
        thin = high / SLENDER / 2
        self.stand(scene, self.firm, Box((thin, thin, high / 2)), high / 2, gravity=(0.0, 0.0, -g), ramp=self.slowly,
                   grip="slip")  # fmt: skip
        watch(scene, 0.8 * high, 8 / 6 * self.slowly)

    @property
    def slowly(self) -> float:
        """In which a column's weight grows [s]."""
        return 6 * sqrt(self.tall / g)

    def sheet(self, scene: Scene) -> None:
        """A layer on a rough slope without end, whose weight grows slowly."""
        time, ramp, until = self.ramp
        scene.continua.append(layer(self.firm, self.tall, self.tall, STEEP, ramp=ramp * time))
        watch(scene, self.tall, until * time)

    @property
    def ramp(self) -> tuple[float, float, float]:
        """Of a layer's weight: the time that shear waves take across [s]; in it how long it grows and is watched."""
        return self.tall / sqrt(self.firm.parameters()[0] / self.density), *RAMPS[self.setup]

    @observable("m")
    def centre_height(self, run: Run) -> Array:
        """Of the centre of mass (T,)."""
        return self.cloud(run).centre[:, 2]

    @observable("m")
    def width(self, run: Run) -> Array:
        """Of the box around it, the wider side (T,)."""
        cloud = self.cloud(run)
        return np.asarray((cloud.high - cloud.low)[:, :2].max(axis=1) + spacing(cloud))

    @law("ρ g H < σ_y stands; ρ g H/σ_y = X > 1 sinks by H (1 - (1 + ln X)/X)", within=(8e-2, 8e-2, 8e-2),
         source="N. Pashias et al., J. Rheol. 40 (1996) 1179, eq. 8; σ_y = √(3/2) τ_Y", limited_by=HASTE)  # fmt: skip
    def a_column_stands_if_it_can_bear_its_own_weight(self, run: Run) -> Measurement:
        """68b: X of two columns, read off the way that their tops have come down for good; 1 for one that keeps its
        height, but for the elastic part."""
        found, due = [], []
        for name in COLUMNS:
            own, twin = self.at_lab(run, name)
            bar = twin.clouds["bar"]
            high, last = own.tall, len(twin) // 8
            number = self.density * g * high / self.strength
            yielded = max(0.0, 1 - 1 / number)
            elastic = own.strength / own.firm.young * (yielded + (1 - yielded) ** 2 * number / 2)
            lost = (bar.high[0, 2] - bar.high[-last:, 2].mean()) / high - elastic
            found.append(brentq(lambda x, lost=lost: 1 - (1 + log(x)) / x - max(lost, 0.0), 1.0, 100.0))
            due.append(max(number, 1.0))
        return found, due

    @law("L/L₀ = (1 - e)(1 - ln(1 - e)), -ln(1 - e) - e = ρ v²/2σ_y", within=(1e-1, 7e-2, 5e-2), limited_by=GRID,
         source="J. B. Hawkyard, Int. J. Mech. Sci. 11 (1969) 313: a flat-ended rod mushrooms")  # fmt: skip
    def a_rod_is_shortened_as_by_taylor_s_impact(self, run: Run) -> Measurement:
        """68c: its length afterwards; e is the strain at its foot. What is often quoted, exp(-ρ v²/2σ_y), takes the
        strain to be the same everywhere, and is too short."""
        own, rod = self.at_lab(run, "rod")
        bar, last = rod.clouds["bar"], len(rod) // 8
        number = self.density * own.speed_of_fall**2 / (2 * self.strength)
        strain = brentq(lambda e: -log(1 - e) - e - number, 1e-9, 1 - 1e-9)
        long = (bar.high - bar.low)[-last:, 2].mean() + spacing(bar)
        return long, 2 * self.size * (1 - strain) * (1 - log(1 - strain))

    @law("Σ J V₀ = m/ρ", source="PhysInOne supplement, eq. 3-6: only the deviator flows", within=(2e-2, 1e-2, 5e-3),
         limited_by=GRID)  # fmt: skip
    def it_keeps_its_volume(self, run: Run) -> Measurement:
        """68d: in the end."""
        cloud = self.scenic(run)[1]
        return cloud.volume[-1], cloud.mass[0] / self.density

    @law("½ m v² = m g Δz, and none of it comes back", within=(2e-2, 1e-2, 1e-2), limited_by=GRID,
         source="K. L. Johnson, Contact mechanics, §11.4 eq. 11.46-11.48: v' of the order of σ_y/√(ρ E)")  # fmt: skip
    def it_hardly_jumps(self, run: Run) -> Measurement:
        """68e: energy of the fall up to the floor, less that of the centre of mass when it moves up the fastest."""
        if self.springs > DEAD:
            raise NotEvaluated(f"what it stores until it yields may bring back {self.springs:.2g} of the energy")
        other, cloud = self.on_floor(run)
        before = int(np.minimum.accumulate(cloud.low[:, 2] > 1.2 * NEAR * other.cell).sum()) - 1
        if before < 1 or before + 10 > len(other):
            raise NotEvaluated("it is not seen to land")
        up = cloud.momentum[before:, 2].max()
        lost = cloud.momentum[before, 2] ** 2 - max(up, 0.0) ** 2
        fallen = cloud.centre[0, 2] - cloud.centre[before, 2]
        return lost / (2 * cloud.mass[0]), cloud.mass[0] * g * fallen

    @law(
        "a(t) = a(T), h(T) <= (1 + σ_y/E) min h",
        within=(5e-3, 2.5e-3, 2.5e-3),
        limited_by=GRID,
        source="R. Hill, The mathematical theory of plasticity (1950), ch. 2: below the yield stress only E gives way",
    )
    def it_stays_as_it_is(self, run: Run) -> Measurement:
        """68f: sides of the box around it all through the last second; and by how much it is higher than it was once,
        beyond what its stress may give back."""
        if self.springs > DEAD:
            raise NotEvaluated(f"what it stores until it yields may bring back {self.springs:.2g} of the energy")
        other, cloud = self.on_floor(run)
        left, fast = other.t[-1] - LATE - sqrt(2 * self.drop / g), sqrt(2 * g * self.drop)
        if self.grip == "slip" or (self.grip == "separate" and self.friction * g * left < fast):
            raise NotEvaluated("what is below may be too smooth to stop it in time")
        size, sides = other.specimen.size, cloud.high - cloud.low
        risen = sides[-1, 2] - (1 + self.strength / self.young) * sides[:, 2].min()
        late = sides[other.t >= other.t[-1] - LATE]
        found, due = late / size, np.tile(sides[-1] / self.size, (len(late), 1))
        return np.append(found, max(risen, 0.0) / size), np.append(due, 0.0)

    @law("∫ m g ż dt = W_p + W_el + m v²/2", within=(5e-2, 3e-2, 1e-2), limited_by=GRID,
         source="R. Hill, The mathematical theory of plasticity (1950), ch. 2: work of flow, ∫ σ : dε_p")  # fmt: skip
    def weight_works_on_flow(self, run: Run) -> Measurement:
        """68f: what a column that sinks slowly has stored, moves with and has spent on its flow, against the work of
        its weight. Of a fall the grid itself takes a good part: that is not asked."""
        own, twin = self.at_lab(run, "tall column")
        bar = twin.clouds["bar"]
        pull = g * np.sin(np.minimum(twin.t / own.slowly, 1.0) * pi / 2) ** 2
        return (bar.dissipated + bar.elastic + bar.kinetic)[-1], trapezoid(-pull * bar.momentum[:, 2], twin.t)

    @law("τ = τ_Y/√2 where it slides; less where it clings", within=(8e-2, 3e-2, 2e-2), limited_by=GRID,
         source="C. C. Mei & M. Yuhi, J. Fluid Mech. 431 (2001) 135, §2: ρ g h sin θ > τ_Y")  # fmt: skip
    def a_layer_clings_to_a_slope_if_it_is_thin(self, run: Run) -> Measurement:
        """68g: shear stress at the foot of a layer, over τ_Y/√2: of one that is too thin to slide, at rest, and of one
        twice as deep as clings, once it creeps at √(g h)/50 (the faster, the more the grid resists)."""
        found, due = [], []
        for name in LAYERS:
            own, twin = self.at_lab(run, name)
            down = twin.clouds["layer"]
            time, ramp, _ = own.ramp
            grown = np.sin(np.minimum(twin.t / (ramp * time), 1.0) * pi / 2) ** 2
            pull = g * sin(STEEP) * cumulative_trapezoid(grown, twin.t, initial=0)
            speed = down.momentum[:, 0] / down.mass
            share = speed / sqrt(g * own.tall)
            if name == "thick layer":
                first, last = (int(np.argmax(share > level)) for level in CREEP)
            else:
                first, last = int(0.8 * len(twin)), len(twin) - 1
            if last <= first or (name == "thin layer" and share.max() > CREEP[0]):
                found.append(np.nan)
            else:
                carried = ((pull - speed)[last] - (pull - speed)[first]) / (twin.t[last] - twin.t[first])
                found.append(carried * self.density * own.tall / (self.yield_stress / sqrt(2)))
            due.append(min(1.0, own.tall / self.clings))
        return found, due

    def caption(self, run: Run) -> str:
        """What falls on what, how flat it is in the end."""
        cloud = self.cloud(run)
        high = cloud.high[-1, 2] - cloud.low[-1, 2]
        return (
            f"A {self.shape} of plasticine, {100 * self.size:.0f} cm high, falls {100 * self.drop:.0f} cm onto "
            f"{self.ground}. Its yield stress is {self.yield_stress:.2g} Pa: where it lands it flows under a greater "
            f"stress and spreads, until what presses it is less than it can bear. It hardly jumps up again, as the "
            f"energy of the fall went into changing its shape, and in the end it stays as it is, "
            f"{100 * high:.1f} cm high and {100 * self.width(run)[-1]:.1f} cm wide, with the volume it had."
        )
