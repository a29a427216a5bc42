"""70: a paste falls, flows while it is pushed hard enough, and stops."""

from __future__ import annotations

from math import hypot, pi, sin, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from phenomena.pours import (
    POUR,
    SLOW,
    STEEP,
    THIN,
    Poured,
    article,
    block,
    ground,
    grown,
    layer,
    layered,
    plates,
    upright,
    viscous_length,
    watch,
)  # fmt: skip
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Continuum, Cylinder, Material, Meeting, Piece, Plasticine, Viscoplastic
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

SQUEEZED: Final = 0.02
"""Compression of a laboratory's matter under its own weight: none of their laws knows E, and soft matter takes long
steps."""
HARD: Final = 0.006
"""The same where a layer's thickness counts twice."""
BRACKET: Final = 0.05
"""By which a layer is thinner or thicker than that which begins to flow."""
CREEPS: Final = 2e-3
"""What flows is faster than this, in √(g h)."""
ASPECT: Final = 3.0
"""Length of half the mound by the thin-layer formula, in √A."""
FLAT: Final = 6.0
"""Radius of the heap by the thin-layer formula, in its height."""
START: Final = 0.65
"""Radius of the cylinder that becomes the heap, in that radius."""
PLUG: Final = 2.0
"""Thickness of the layer with a plug, in the plug's."""
STILL: Final = 0.02
"""Speed of what has stopped, in √(g size)."""


def plastic_mound(kappa: float) -> tuple[float, float]:
    """(height, half length) of an arrested mound in the plane whose half area is 1; κ = τ_s/(ρ g).

    The thrust of a layer that spreads is ρ g h²/2 - π τ_s h/2, not ρ g h²/2: where shear takes all of the strength at
    the floor, it leaves √(1 - (τ/τ_s)²) of it to tension, π/4 in the mean (J. F. Nye, Proc. R. Soc. A 207 (1951) 554).
    So (h² - π κ h)/2 = κ (L - x), down to a cliff of π κ.
    """
    cliff = pi * kappa

    def area(high: float) -> float:
        return (high**3 - cliff**3) / (3 * kappa) - pi * (high**2 - cliff**2) / 4 - 1

    high = float(brentq(area, cliff, 10.0))
    return high, (high**2 - cliff * high) / (2 * kappa)


def plastic_heap(kappa: float, volume: float) -> float:
    """Radius of an arrested round heap [m]; κ = τ_s/(ρ g) [m], its volume [m³]. As `plastic_mound`."""
    cliff = pi * kappa
    u = (np.arange(400) + 0.5) / 400

    def excess(radius: float) -> float:
        high = cliff / 2 + np.sqrt(cliff**2 / 4 + 2 * kappa * radius * (1 - u))
        return float(2 * pi * radius**2 * np.mean(u * high) - volume)

    return float(brentq(excess, 0.0, 10 * volume ** (1 / 3) + (volume**2 / kappa) ** 0.2))


class NonNewtonianFluidFall(Poured, domain="fluids"):
    """Non-Newtonian fluid falls and flows with variable resistance: a paste that stops."""

    setup: Annotated[
        Literal["drop", "pour", "thin layer", "thick layer", "plug", "film", "mound", "heap", "dry", "plasticine"],
        Choice("something falls; a jet is poured on it; laboratories: layers on a slope, a little thinner and thicker "
               "than those that flow, one with a plug and one without a yield stress; a mound between plates and a "
               "round heap that come to rest; what falls without its viscosity, and as plasticine"),
    ] = "drop"  # fmt: skip
    yield_stress: Annotated[float, Param("Pa", 100.0, 10000.0, "τ_Y; the shear strength is τ_Y/√2")] = 400.0
    viscosity: Annotated[float, Param("Pa s", 3.0, 10.0, "η; half of it resists beyond the yield stress")] = 6.0
    young: Annotated[float, Param("Pa", 1e4, 1e6, "modulus of what does not flow")] = 2.2e4
    poisson: Annotated[float, Param("1", 0.2, 0.4, "Poisson's ratio")] = 0.3
    density: Annotated[float, Param("kg/m³", 800.0, 2000.0, "at rest")] = 1000.0

    @property
    def material(self) -> Material:
        """As declared; without its viscosity, or as plasticine, where that is asked for."""
        solid = (self.young, self.poisson, self.density, self.yield_stress)
        return Plasticine(*solid) if self.setup == "plasticine" else Viscoplastic(
            *solid, 0.0 if self.setup == "dry" else self.viscosity
        )  # fmt: skip

    @property
    def colour(self) -> tuple[float, float, float, float]:
        """Of tooth paste."""
        return (0.62, 0.83, 0.86, 1.0)

    @property
    def watched(self) -> float:
        """Of a scene [s]."""
        return 2.0 if self.setup == "drop" else 2.5

    @property
    def strength(self) -> float:
        """In shear: τ_s = τ_Y/√2 [Pa]."""
        return self.yield_stress / sqrt(2)

    @property
    def nu(self) -> float:
        """η/2ρ [m²/s]."""
        return self.viscosity / 2 / self.density

    @property
    def critical(self) -> float:
        """Thickness of a layer that begins to flow on the laboratory's slope [m]."""
        return self.strength / (self.density * g * sin(STEEP))

    @property
    def mound_size(self) -> float:
        """√A of half the mound [m]."""
        return 8 * ASPECT**3 / 9 * self.strength / (self.density * g)

    @property
    def heap_radius(self) -> float:
        """Of the heap by the thin-layer formula [m]."""
        return 2 * FLAT**2 * self.strength / (self.density * g)

    def paste(self, yield_stress: float, depth: float, squeezed: float = SQUEEZED) -> Viscoplastic:
        """A paste of a yield stress [Pa] and this viscosity, as soft as a depth [m] allows."""
        modulus = self.density * g * depth / squeezed
        young = modulus * (1 + self.poisson) * (1 - 2 * self.poisson) / (1 - self.poisson)
        return Viscoplastic(young, self.poisson, self.density, yield_stress, self.viscosity)

    def build(self, scene: Scene) -> None:
        """What is below and what falls; or a laboratory."""
        if self.setup in ("drop", "pour", "dry", "plasticine") and self.yield_stress > 0.1 * self.young:
            share = self.yield_stress / self.young
            raise Refusal("R12", f"{self.label}: a yield stress of {share:.2g} of Young's modulus: it would bounce "
                          f"like rubber; allowed: 0.1, young = {10 * self.yield_stress:.3g} Pa")  # fmt: skip
        if self.setup in ("drop", "pour"):
            self.refuse_squashed(self.young, 0.3, "young")
        super().build(scene)

    def laboratory(self, scene: Scene) -> None:
        """The set-up of that name."""
        {
            "thin layer": self.bracket, "thick layer": self.bracket, "plug": self.plug, "film": self.film,
            "mound": self.mound, "heap": self.heap, "dry": self.lump, "plasticine": self.lump,
        }[self.setup](scene)  # fmt: skip

    def bracket(self, scene: Scene) -> None:
        """A layer that hardly stays, or hardly flows, on a slope that grows slowly."""
        depth = self.critical * (1 - BRACKET if self.setup == "thin layer" else 1 + BRACKET)
        fall = sqrt(depth / g)
        scene.continua.append(layer(self.paste(self.yield_stress, depth), depth, depth, STEEP, ramp=4 * fall))
        watch(scene, depth, 8 * fall)

    @property
    def plug_depth(self) -> float:
        """Of the layer with a plug [m]."""
        return viscous_length(2.5, self.nu)

    def plug(self, scene: Scene) -> None:
        """A layer that flows under a plug, of a paste that is as strong as it has to be for that."""
        depth = self.plug_depth
        strength = self.density * g * sin(STEEP) * depth / PLUG
        scene.continua.append(layer(self.paste(sqrt(2) * strength, depth, HARD), depth, depth, STEEP))
        watch(scene, depth, 6 * (depth * (1 - 1 / PLUG)) ** 2 / self.nu)

    def film(self, scene: Scene) -> None:
        """A layer without a yield stress."""
        depth = viscous_length(2.0, self.nu)
        scene.continua.append(layer(self.paste(0.0, depth, HARD), depth, depth, STEEP))
        watch(scene, depth, 2 * depth**2 / self.nu)

    def mound(self, scene: Scene) -> None:
        """Half a mound between plates, under gravity that grows slowly."""
        size = self.mound_size
        width, fall = THIN * size, sqrt(size / g)
        paste = self.paste(self.yield_stress, size / 2)
        piece = block("mound", paste, (0, -width / 2, 0), (2 * size, width / 2, size / 2))
        walls = [*plates(width), ground(), upright(0.0, 1)]
        scene.continua.append(Continuum([piece], walls=walls, ramp=8 * fall))
        watch(scene, size, 10 * fall)

    def heap(self, scene: Scene) -> None:
        """A round cake that becomes a heap, under gravity that grows slowly."""
        radius = self.heap_radius
        volume = 8 * pi / 15 * radius**3 / FLAT
        wide = START * radius
        high, fall = volume / (pi * wide**2), sqrt(radius / g)
        piece = Piece("heap", self.paste(self.yield_stress, high), Cylinder(wide, high / 2), (0, 0, high / 2))
        scene.continua.append(Continuum([piece], walls=[ground()], ramp=5 * fall))
        watch(scene, 2.5 * radius / FLAT, 7 * fall)

    def lump(self, scene: Scene) -> None:
        """What falls, from a tenth of its height, onto the floor."""
        made = self.form
        piece = Piece("matter", self.material, made.shape, (0, 0, 0.1 * self.size + made.half), velocity=(0, 0, -1.0))
        scene.continua.append(Continuum([piece], [Meeting("stage/floor", "stick")]))
        scene.resolve(time=SLOW, length=min(self.size, 4 * made.thin), duration=0.3)

    @observable("m/s")
    def fastest(self, run: Run) -> Array:
        """Root mean square speed of the matter (T,)."""
        clouds = run.clouds.values()
        return np.asarray(np.sqrt(2 * sum(c.kinetic for c in clouds) / sum(c.mass for c in clouds)))

    @law("h_c = τ_Y/(√2 ρ g sin θ)", source="Liu & Mei, J. Fluid Mech. 207 (1989) 505, eq. 2.16, with τ_s = τ_Y/√2",
         within=(6e-2, 6e-2, 6e-2), limited_by="a bracket of 5 % is all that is asked")  # fmt: skip
    def a_layer_flows_if_it_is_thick_enough(self, run: Run) -> Measurement:
        """70b: thicknesses of a layer that stays and of one that flows; NaN if they do not."""
        found = []
        for setup, flows in (("thin layer", False), ("thick layer", True)):
            lab, slope = self.at_lab(run, setup)
            depth = lab.critical * (1 + BRACKET if flows else 1 - BRACKET)
            cloud = slope.clouds["layer"]
            speed = cloud.momentum[-1, 0] / cloud.mass[-1] / sqrt(g * depth)
            found.append(depth if (speed > CREEPS) == flows else np.nan)
        return found, np.full(2, self.critical)

    @law("u = ρ g sin θ (h - h_c)²/(2 η/2), below it less", source="Liu & Mei, J. Fluid Mech. 207 (1989) 505, eq. 2.20",
         within=(6e-2, 6e-2, 5e-2), limited_by="affine transfers add a viscosity of their own")  # fmt: skip
    def a_rigid_plug_rides_on_what_flows(self, run: Run) -> Measurement:
        """70b and f: speeds in eight layers, of which those in the plug, half the depth, are all alike."""
        lab, slope = self.at_lab(run, "plug")
        x, v, _ = grown(slope.clouds["layer"], -1)
        z, u = layered(x[:, 2], v[:, 0])
        sheared = lab.plug_depth * (1 - 1 / PLUG)
        return u, g * sin(STEEP) / (2 * self.nu) * (sheared**2 - np.maximum(sheared - z, 0.0) ** 2)

    @law("(h² - π κ h)/2 = κ (L - x), κ = τ_Y/(√2 ρ g)", source="J. F. Nye, Proc. R. Soc. A 207 (1951) 554, eq. 32",
         within=(8e-2, 6e-2, 5e-2), limited_by="it comes to rest with momentum; a front is known to a cell",
    )  # fmt: skip
    def a_mound_stops_where_it_is_thin_enough(self, run: Run) -> Measurement:
        """70c: where the front of half a mound stops."""
        lab, mound = self.at_lab(run, "mound")
        size = lab.mound_size
        kappa = self.strength / (self.density * g * size)
        return mound.clouds["mound"].high[-1, 0], size * plastic_mound(kappa)[1]

    @law("(h² - π κ h)/2 = κ (R - r), 2π ∫ h r dr = V", within=(1.5e-1, 1.5e-1, 1.5e-1),
         source="J. F. Nye, Proc. R. Soc. A 207 (1951) 554, eq. 32; its thin limit R⁵ = 225 ρ g V²/(128 π² τ_s)",
         limited_by="that the plane's thrust is also a round heap's")  # fmt: skip
    def a_heap_stops_round(self, run: Run) -> Measurement:
        """70d: where it ends along the four axes, in the mean; its fifth power over the due one's, which goes as the
        inverse of the strength that it tells of."""
        _, heap = self.at_lab(run, "heap")
        cloud = heap.clouds["heap"]
        radius = np.mean([cloud.high[-1, :2], -cloud.low[-1, :2]])
        kappa = self.strength / (self.density * g)
        return (radius / plastic_heap(kappa, cloud.mass[0] / self.density)) ** 5, 1.0

    @law("τ_Y → 0: u = ρ g sin θ (2 H z - z²)/(2 η/2)",
         source="Bird, Stewart & Lightfoot, Transport Phenomena, §2.2 eq. 2.2-18",
         within=(8e-2, 3e-2, 2e-2), limited_by="affine transfers add a viscosity of their own")  # fmt: skip
    def without_a_yield_stress_it_is_viscous(self, run: Run) -> Measurement:
        """70e: speeds in eight layers of a film at the end."""
        lab, film = self.at_lab(run, "film")
        x, v, _ = grown(film.clouds["layer"], -1)
        z, u = layered(x[:, 2], v[:, 0])
        depth = viscous_length(2.0, lab.nu)
        return u, g * sin(STEEP) / (2 * self.nu) * (2 * depth * z - z**2)

    @law("η = 0: ‖dev τ‖ <= τ_Y", source="PhysInOne supplement, eq. 8 with η = 0, beside eq. 5: plasticine's",
         within=(1e-3, 1e-3, 1e-3), limited_by="single precision, but at reference")  # fmt: skip
    def without_viscosity_it_is_plasticine(self, run: Run) -> Measurement:
        """70e: how far and high a lump of it reaches that lands and flattens, at all times, over its size; beside one
        of plasticine."""
        lab, dry = self.at_lab(run, "dry")
        _, clay = self.at_lab(run, "plasticine")
        return dry.clouds["matter"].high / lab.size, clay.clouds["matter"].high / self.size

    @law("v = √(2 g d), then v → 0", source="by definition: below the yield stress nothing flows",
         within=(2e-2, 2e-2, 2e-2), limited_by="matter begins to be stopped a cell above the floor")  # fmt: skip
    def what_has_fallen_stops(self, run: Run) -> Measurement:
        """70, lazy failure (a): speed of the centre of mass when it has fallen by half of the drop, and root mean
        square speed at the end, over that at the end of the drop."""
        other = run if self.setup == "drop" else run.again(setup="drop")
        if self.drop < self.size / 2 or self.onto == "slope":
            raise NotEvaluated("it falls by less than half of its size, or on a slope")
        cloud, speed = other.clouds["matter"], sqrt(2 * g * self.drop)
        left = other.t[-1] - sqrt(2 * self.drop / g)
        if self.grip != "stick" and self.friction * g * left < hypot(self.speed, speed):
            raise NotEvaluated("what is below may be too smooth to stop it before the end")
        falling = -cloud.momentum[:, 2] / cloud.mass
        fallen = np.interp(sqrt(self.drop / g), other.t, falling) * sqrt(2)
        return [fallen / speed, self.fastest(other)[-8:].mean() / speed], [1.0, 0.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        across, high = 2 * self.reach(run)[-1], self.height(run)[-1]
        beyond = self.viscosity / 2
        paste = f"It yields at {self.strength:.3g} Pa in shear, and beyond it resists with {beyond:.2g} Pa s"
        start = {
            "drop": f"{article(self.shape)} of paste, {self.size:.2g} m high, falls {self.drop:.2g} m",
            "pour": f"A jet of paste is poured for {POUR:.2g} s",
        }.get(self.setup)
        if start is None:
            return (
                f"In a laboratory of pastes ({self.setup}) matter as stiff as tooth paste is left to its own weight. "
                f"{paste}. Where the weight of a layer is too little to overcome that, nothing moves, however long one "
                f"waits; where it is enough, a plug rides on a sheared layer. After {run.t[-1]:.2g} s it reaches "
                f"{across:.2g} m across and {high:.2g} m up."
            )
        speed = self.fastest(run)[-1]
        fate = "has come to rest" if speed < STILL * sqrt(g * self.size) else "still moves"
        return (
            f"{start} onto {self.ground}. {paste}: it flows where its weight and its fall push hard enough, and stays "
            f"where they do not. So it flattens, its edge slows down, and it keeps a height that a honey would lose. "
            f"After {run.t[-1]:.1f} s it is {across:.2g} m across and {high:.2g} m high, and it {fate}."
        )
