"""20: blocks on a turntable that speeds up: they slip one after the other, the outermost first."""

from __future__ import annotations

from math import atan2, inf, pi, sqrt
from typing import Annotated, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from phenomena.spins import Course, across, azimuth, distance, drift, plan
from phenomena.turntables import (
    HINGE,
    TURNING,
    Slide,
    ahead,
    arena,
    block,
    carry,
    critical_spin,
    onset,
    slip_spin,
    slip_time,
    taken_along,
    turntable,
)
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import CREEP, Surface
from physinone_mj.measure import between, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

SIZE: Final = (0.035, 0.035, 0.02)
"""Half sizes of a block [m]."""

CIRCLES: Final = (1.0, 0.7, 0.45, 0.25)
"""Radii of the blocks' circles, in units of the outermost."""

NEAREST: Final = 0.06
"""Least distance of one of several blocks from the axis [m]."""

RIM: Final = 0.09
"""From the outermost block's centre to the rim [m]."""

HEIGHT: Final = 0.24
"""Of the table's upper side over the ground [m]."""

COLOURS: Final = ((0.84, 0.27, 0.22), (0.94, 0.76, 0.28), (0.30, 0.62, 0.42), (0.23, 0.47, 0.76))

AFTER: Final = 0.3
"""How long a way is followed after the first slip [s]."""

START: Final = 0.25
"""When it is decided whether a block slipped at once, in units of √(r/(μ g)): one that held at first slips at 0.3."""

EDGE: Final = 5e-3
"""A block must hold at the start if the table speeds up this much less than friction can follow, and slip if this much
more (of the angular acceleration)."""


class AccelSurfaceSpin(Phenomenon, domain="mechanics"):
    """Objects on a plane that turns faster and faster: the outermost is the first that friction cannot hold."""

    blocks: Annotated[int, Param("1", 1, 4, "how many")] = 3
    first: Annotated[float, Param("rad/s", 0.0, 8.0, "spin of the table at the start")] = 1.2
    rate: Annotated[float, Param("rad/s²", 0.1, 8.0, "at which it speeds up")] = 1.0
    top: Annotated[float, Param("rad/s", 0.5, 12.0, "spin that it keeps at last")] = 5.0
    radius: Annotated[float, Param("m", 0.06, 1.0, "of the outermost block's circle")] = 0.6
    friction: Annotated[float, Param("1", 0.0, 0.9, "of blocks and table")] = 0.4
    density: Annotated[float, Param("kg/m³", 300.0, 8000.0, "of the blocks")] = 1200.0

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen whose outermost block rides at first, on a table that speeds up."""
        drawn = super().sample(rng, **fixed)
        first = min(drawn.first / 8.0 * sqrt(drawn.friction * g / drawn.radius), 8.0)
        return cls.make(**(drawn.values() | {"first": first, "top": max(drawn.top, first + 0.5)} | fixed))

    @property
    def course(self) -> Course:
        """Of the table's spin."""
        return Course(self.first, self.top, self.rate)

    @property
    def circles(self) -> list[float]:
        """Radii, from the outermost inwards [m]."""
        return [self.radius * part for part in CIRCLES[: self.blocks]]

    @property
    def slips(self) -> list[float]:
        """When each block slips [s]; 0 if at once, infinite if never."""
        return [slip_time(self.course, self.friction, r, SIZE[0]) for r in self.circles]

    def body(self, i: int) -> str:
        """Name of a block, counted inwards."""
        return f"block{i}/block"

    def start(self, i: int) -> float:
        """Azimuth of a block at the start [rad]."""
        return 2 * pi * i / self.blocks

    def build(self, scene: Scene) -> None:
        """The table in its court, and blocks at several distances from the axis, turning with it."""
        if self.blocks > len(CIRCLES):
            raise Refusal("R12", f"blocks = {self.blocks}; allowed: {len(CIRCLES)}, a circle for each")
        if self.blocks > 1 and self.circles[-1] < NEAREST:
            raise Refusal("R1", f"radius = {self.radius:.4g} m: {self.blocks} blocks stand too near to the axis; "
                          f"allowed: {NEAREST / CIRCLES[self.blocks - 1]:.4g} m")  # fmt: skip
        surface = Surface(friction=self.friction, restitution=0.1)
        rim = self.radius + RIM
        arena(scene, rim + 0.3, 0.12)
        turntable(scene, rim, HEIGHT, self.course, surface)
        for i, r in enumerate(self.circles):
            part = block(scene, f"block{i}", SIZE, self.density, surface, COLOURS[i])
            carry(scene, part.name("free"), r, self.start(i), HEIGHT + SIZE[2], self.first)
        if self.blocks > 1:
            scene.touch(*(self.body(i) for i in range(self.blocks)))
        last = max([t for t in self.slips if t < inf], default=1.5)
        fastest = max(self.first, float(self.course.spin(min(last + 0.5, 8.5))))
        scene.resolve(time=min(0.4, 1 / fastest), length=SIZE[2], duration=min(10.0, max(3.0, last + 1.5)))

    @observable("m")
    def distances(self, run: Run) -> Array:
        """Of the blocks from the axis, the outermost first (T, n)."""
        return np.column_stack([distance(run, self.body(i)) for i in range(self.blocks)])

    @observable("rad/s")
    def table_spin(self, run: Run) -> Array:
        """Of the table (T,)."""
        return run.joint_speed(HINGE)

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """Horizontal velocities of the blocks relative to the table beneath them (T, n, 2)."""
        return np.stack([drift(run, self.body(i), HINGE) for i in range(self.blocks)], axis=1)

    def slippers(self, run: Run) -> list[int]:
        """Blocks that ride for a while and slip while the table speeds up; NotEvaluated if none does."""
        late = min(run.t[-1], self.course.ramp) - AFTER
        found = [i for i, when in enumerate(self.slips) if 0.1 < when < late and when * self.rate > 0.02 * self.top]
        if not found:
            raise NotEvaluated("no block first rides and then slips while the table speeds up")
        if SIZE[0] * self.rate > TURNING * self.friction * g:
            raise NotEvaluated("friction all but fails to turn the blocks themselves")
        return found

    @law("Ω_s = ((μ g/r)² - α²)^(1/4)", source="Goldstein, Classical Mechanics, 3rd ed., §4.10 with Coulomb's law",
         within=(2.1e-3, 2.1e-3, 2.1e-3), limited_by="a bracket: it stays at -0.2 %, goes at +0.2 %")  # fmt: skip
    def block_slips_at_the_critical_spin(self, run: Run) -> Measurement:
        """20a: on tables that speed up slowly, a little less and a little more than friction can follow."""
        return critical_spin(run, self.body(0), self.friction, self.radius, blocks=1)

    @law("r² Ω_s⁴ = (μ g)² - α² (r² + (2h/3)²)", source="Goldstein, Classical Mechanics, 3rd ed., §4.10 with Coulomb's "
         "law; a block of half side h: turntables.taken_along",
         within=(5e-3, 2e-3, 1e-3), limited_by="slip is read backwards to zero")  # fmt: skip
    def every_block_slips_at_its_own_spin(self, run: Run) -> Measurement:
        """20a: spin of the table at the moment at which the slip of each block began."""
        found = self.slippers(run)
        spins = [float(self.course.spin(onset(run, self.body(i)))) for i in found]
        expected = [slip_spin(self.friction, self.circles[i], self.rate, SIZE[0]) for i in found]
        return np.divide(spins, expected), np.ones(len(found))

    @law("α √(r² + (2h/3)²) = μ g", source="Goldstein, Classical Mechanics, 3rd ed., §4.10 with Coulomb's law; a "
         "block of half side h: turntables.taken_along",
         within=(5.1e-3, 5.1e-3, 5.1e-3), limited_by="a bracket: it holds at -0.5 %, slips at +0.5 %")  # fmt: skip
    def too_quick_a_start_leaves_it_behind(self, run: Run) -> Measurement:
        """20a: a table speeding up from rest takes the block along unless α r > μ g, about: then it slips at once."""
        critical = self.friction * g / taken_along(self.radius, 1.0, SIZE[0])
        if SIZE[0] > TURNING * self.radius:
            raise NotEvaluated(f"the block stands {self.radius:.3g} m from the axis, which it all but covers")
        low, high = (getattr(self.declarations()["rate"][0], end) for end in ("low", "high"))
        if not low < critical * (1 - EDGE) < critical * (1 + EDGE) < high:
            raise NotEvaluated(f"α = {critical:.3g} rad/s² would be needed; allowed: {low:g} to {high:g} rad/s²")

        start = START / sqrt(critical)

        def slips(rate: float) -> bool:
            twin = run.again(blocks=1, first=0.0, rate=rate, top=max(0.5, rate * start * 2))
            speed = np.linalg.norm(drift(twin, self.body(0), HINGE), axis=1)
            return bool(speed[twin.t < start].max() > EDGE * self.friction * g * start / 2)

        return threshold(slips, critical, spread=EDGE, resolution=2 * EDGE), critical

    @law("rᵢ² Ωᵢ⁴ + α² (rᵢ² + (2h/3)²) = (μ g)²", source="Coulomb, Théorie des machines simples (1785)",
         within=(5e-3, 2e-3, 1e-3), limited_by="slip is read backwards to zero")  # fmt: skip
    def outer_blocks_slip_first(self, run: Run) -> Measurement:
        """20b: in the order of their distances, and with one friction for all."""
        found = self.slippers(run)
        if len(found) < 2:
            raise NotEvaluated("fewer than two blocks ride and slip")
        times = [onset(run, self.body(i)) for i in found]
        if sorted(times) != times:
            return np.nan, 1.0
        spins, r = self.course.spin(times), np.array([self.circles[i] for i in found])
        needed = np.hypot(r * spins**2, [taken_along(x, self.rate, SIZE[0]) for x in r])
        return needed / g / self.friction, np.ones(len(found))

    @law("Ω_s ∝ √μ for α r ≪ μ g", source="Coulomb, Théorie des machines simples (1785)",
         within=(5e-3, 2e-3, 1e-3), limited_by="slip is read backwards to zero")  # fmt: skip
    def less_friction_lets_go_earlier(self, run: Run) -> Measurement:
        """20a: spins at which the outermost block slips with this friction and with four fifths of it."""
        if 0 not in self.slippers(run):
            raise NotEvaluated("the outermost block does not first ride and then slip")
        twin = run.again(blocks=1, friction=0.8 * self.friction)
        if 0 not in twin.specimen.slippers(twin):
            raise NotEvaluated("with less friction the outermost block does not first ride and then slip")
        spins = [float(self.course.spin(onset(r, self.body(0)))) for r in (twin, run)]
        expected = [slip_spin(part * self.friction, self.radius, self.rate, SIZE[0]) for part in (0.8, 1.0)]
        return spins[0] / spins[1], expected[0] / expected[1]

    @law("tan φ = α/Ω²", source="Goldstein, Classical Mechanics, 3rd ed., §4.10", unit="rad",
         within=(1e-1, 3e-2, 2e-2), limited_by="slip is read backwards to zero")  # fmt: skip
    def first_slip_is_outwards_and_trailing(self, run: Run) -> Measurement:
        """20c: direction of the first slip in axes that turn with the table, from the radius backwards."""
        measured, expected = [], []
        for i in self.slippers(run):
            began = self.slips[i]
            spin = float(self.course.spin(began))
            soon = min(0.03, 0.1 / spin)  # the quicker the table, the sooner the way bends
            slip = drift(run, self.body(i), HINGE)
            speed, some = np.linalg.norm(slip, axis=1), between(run.t, began + soon, began + 5 * soon)
            if speed[some].max() < 10 * CREEP:
                continue
            some &= speed > np.maximum(3 * CREEP, 50 * ahead(run, self.body(i)))
            if some.sum() < 5:
                continue
            out = plan(run, self.body(i))[some] / distance(run, self.body(i))[some, None]
            slip = slip[some]
            angle = np.arctan2(-np.sum(slip * across(out), axis=1), np.sum(slip * out, axis=1))
            measured.append(np.polyfit(run.t[some] - began, angle, 2)[-1])
            expected.append(atan2(self.rate, spin**2))
        if not measured:
            raise NotEvaluated(f"no block that slips is as fast as {10 * CREEP:g} m/s before its way bends, or as "
                               "50 times what these steps carry it ahead")  # fmt: skip
        return measured, expected

    @law("ẍ = -μ g û, û = w/|w|, w = ẋ - Ω ẑ × x", source="Coulomb, Théorie des machines simples (1785)",
         within=(2e-3, 5e-4, 5e-4), limited_by="the block turns, too, which the equation leaves out")  # fmt: skip
    def slides_as_friction_says(self, run: Run) -> Measurement:
        """20d: place of the outermost block over 0.3 s from its first slip, against the equation of motion."""
        if 0 not in self.slippers(run):
            raise NotEvaluated("the outermost block does not first ride and then slip")
        slide = Slide.riding(self.course, self.friction, self.radius, self.start(0), self.slips[0])
        over = distance(run, self.body(0)) > self.radius + RIM - SIZE[0]
        end = min(self.slips[0] + AFTER, float(run.t[np.argmax(over)]) if over.any() else inf)
        some = between(run.t, self.slips[0], end)
        return plan(run, self.body(0))[some] / self.radius, slide.way(run.t[some])[0] / self.radius

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        names = ("red", "yellow", "green", "blue")[: self.blocks]
        gone = [when for when in self.slips if when < run.t[-1]]
        many = f"{self.blocks} blocks stand" if self.blocks > 1 else "A block stands"
        turned = (azimuth(run, self.body(0))[-1] - self.start(0)) / (2 * pi)
        fate = (
            f"{len(gone)} of {self.blocks} slip, the {names[0]} one first at {gone[0]:.1f} s, sliding outwards and "
            "falling behind the table until they fly off its rim."
            if gone
            else f"Friction holds them all, and the outermost has gone round {turned:.1f} times at the end."
        )
        return (
            f"{many} on a round table up to {self.radius:.2f} m from its axis. The table's spin changes from "
            f"{self.first:.1f} to {self.top:.1f} rad/s by {self.rate:.1f} rad/s every second. What rides farther out "
            f"needs a greater force to turn with it, and friction of {self.friction:.2f} gives no more than that part "
            f"of the weight. {fate}"
        )
