"""14: bar magnets whose like poles face each other: stopped and thrown back, floating, or turning round."""

from __future__ import annotations

from math import cosh, pi, sqrt
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.interpolate import KroghInterpolator
from scipy.optimize import brentq

from phenomena.p13_magnet_attract import LOOSE, SOURCE, MagnetAttract
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import Magnet, Magnets
from physinone_mj.measure import crossings, peaks
from physinone_mj.run import Run
from physinone_mj.scene import Part, Scene

Array = NDArray[np.float64]

BEYOND = 0.25
"""From where the magnets on a rail start to the stops at its ends [m]."""

SNAP = 6.0
"""Distance of unlike poles, in softening lengths, from where on they are no longer followed to a millionth."""

FOOT = 0.03
"""Height of the cage's foot [m]."""

UP, DOWN = (sqrt(0.5), 0, -sqrt(0.5), 0), (sqrt(0.5), 0, sqrt(0.5), 0)
"""Orientations of a bar whose north pole points up, or down."""

TOP = "top/magnet"


class MagnetRepel(Phenomenon, domain="magnetism"):
    """Magnetic repulsion."""

    strength: Annotated[float, Param("N m²", 1e-4, 1e-2, "force of two poles 1 m apart")] = 2e-3
    pole_distance: Annotated[float, Param("m", 0.012, 0.12, "between the poles of a magnet")] = 0.08
    gap: Annotated[
        float, Param("m", 0.03, 0.4, "between the poles that face each other at the start, if side by side")
    ] = 0.3
    mass: Annotated[float, Param("kg", 0.02, 0.5, "of a loose magnet")] = 0.15
    source_mass: Annotated[float, Param("kg", 0.02, 0.5, "of the other, which is fixed in most places")] = 0.25
    core: Annotated[float, Param("m", 0.002, 0.01, "depth of a pole below the surface")] = 0.006
    speed: Annotated[float, Param("m/s", 0.1, 2.0, "of the loose magnet on a rail towards the other")] = 0.6
    release: Annotated[float, Param("1", 0.7, 1.4, "gaps of floating magnets at the start over those at rest")] = 1.3
    friction: Annotated[float, Param("1", 0.0, 0.5, "between magnet and table")] = 0.2
    turned: Annotated[float, Param("rad", 0.001, 1.2, "out of line at the start, on the table or the pin")] = 0.5
    place: Annotated[
        Literal["one on a rail", "both on a rail", "cage", "stack", "table", "pin"],
        Choice("launched on a rail at a held or a free one; one floats in a cage, or two; one lies loose on a table, "
               "or turns on a pin"),
    ] = "one on a rail"  # fmt: skip

    @property
    def bars(self) -> MagnetAttract:
        """The same bars with unlike poles facing: their forces have the other sign."""
        place = {"pin": "compass", "cage": "table", "stack": "table"}.get(self.place, self.place)
        return MagnetAttract.make(
            strength=self.strength, pole_distance=self.pole_distance, gap=self.gap, mass=self.mass,
            source_mass=self.source_mass, core=self.core, angle=pi - self.turned, friction=self.friction, place=place,
        )  # fmt: skip

    @property
    def rail(self) -> bool:
        """Whether one is launched at the other."""
        return "rail" in self.place

    @property
    def closest(self) -> float:
        """Gap [m] at which a launched magnet turns back, or that of magnets that touch."""
        bars = self.bars
        energy = bars.reduced_mass * self.speed**2 / 2 + float(bars.well(self.gap))
        if bars.well(2 * self.core) <= energy:
            return 2 * self.core
        return float(brentq(lambda gap: float(bars.well(gap)) - energy, 2 * self.core, self.gap, xtol=1e-15))

    def approach_time(self) -> float:
        """From the start to the closest point [s]."""
        bars, least = self.bars, self.closest
        span, start = self.gap - least, float(bars.well(self.gap))

        def slowness(u: float) -> float:
            # gap = closest + span u²: the singular 1/√ of the turning point drops out
            left = self.speed**2 - 2 * (float(bars.well(least + span * u**2)) - start) / bars.reduced_mass
            return 2 * span * u / sqrt(max(left, 1e-300))

        return float(quad(slowness, 1e-6, 1.0)[0])

    def floating(self) -> tuple[float, float]:
        """Gaps [m] of rest in a cage, lower and upper (0 if only one floats): all poles of all magnets."""
        bars, weight = self.bars, self.mass * g

        def under(force: float) -> float:
            return float(brentq(lambda gap: float(bars.pull(gap)) - force, 1e-4, 10.0, xtol=1e-15))

        if self.place != "stack":
            return under(weight), 0.0
        pulled, lower, upper = 0.0, 0.0, 0.0
        for _ in range(200):  # the lowest pulls the highest, weakly: a contraction
            lower, upper = under(2 * weight + pulled), under(weight + pulled)
            before, pulled = pulled, float(bars.pull(lower + upper + self.pole_distance))
            if abs(pulled - before) < 1e-16 * weight:
                break
        return lower, upper

    @property
    def light(self) -> float:
        """This mass, or the heaviest that two magnets of could float clear of their cores [kg]."""
        return max(0.02, min(self.mass, float(self.bars.pull(3 * self.core)) / (2.5 * g)))

    def stiffness(self, gap: float) -> float:
        """-dF/dg of two in line [N/m]."""
        pole = self.pole_distance
        return 2 * self.strength * (1 / gap**3 + 1 / (gap + 2 * pole) ** 3 - 2 / (gap + pole) ** 3)

    def build(self, scene: Scene) -> None:
        """Bars on a rail, in a cage, on the floor or on a pin, like poles facing."""
        bars = self.bars
        if self.pole_distance < 2 * self.core:
            raise Refusal("R5", f"{self.label}: pole_distance = {self.pole_distance:.4g} m of poles that lie "
                          f"{self.core:.4g} m deep; allowed: {2 * self.core:.4g} m or more")  # fmt: skip
        parts = [bars.magnet(scene, "source", self.source_mass), bars.magnet(scene, "loose", self.mass)]
        if self.place in ("cage", "stack"):
            if self.place == "stack":
                parts.append(bars.magnet(scene, "top", self.mass))
            self.hover(scene, parts)
        else:
            apart = self.gap / 2 + self.pole_distance / 2
            {"table": self.lie, "pin": self.pin}.get(self.place, self.launch)(scene, parts[0], parts[1], apart)
        poles = tuple(Magnet(p.name("N"), p.name("S"), self.strength) for p in parts)
        scene.effects.append(Magnets(poles, 2 * self.core))

    def launch(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """On the rail, turned round, with stops at its ends."""
        bars = self.bars
        bars.rail(scene, source, loose, apart)
        for element in (loose.geom("north"), loose.geom("south"), loose.site("N"), loose.site("S")):
            element.pos[0] *= -1
        rail, reach = scene.spec.body("rail/rail"), apart + bars.half_length + BEYOND
        for rod in ("near", "far"):
            geom = scene.spec.geom(f"rail/{rod}")
            y = geom.fromto[1]
            geom.fromto = (-reach, y, 0.116, reach, y, 0.116)
        scene.spec.geom("rail/left").pos[0], scene.spec.geom("rail/right").pos[0] = -reach + 0.01, reach - 0.01
        for side, x, part in (("left_stop", -reach, source), ("right_stop", reach, loose)):
            rail.add_geom(
                name=f"rail/{side}", type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.01, 0.03, bars.half_height + 0.01),
                pos=(x, 0, 0.12 + bars.half_height), contype=0, conaffinity=0, rgba=(0.72, 0.55, 0.38, 1),
            )  # fmt: skip
            scene.material(f"rail/{side}", 700.0, Surface())
            if part is loose or self.place == "both on a rail":
                scene.touch(f"rail/{side}", part.name("magnet"))
        scene.touch(source.name("magnet"), loose.name("magnet"))
        scene.speed[loose.name("motion")] = -self.speed
        least, turns = self.closest, self.approach_time()
        quick = 3 * sqrt(bars.reduced_mass / self.stiffness(least))
        if least <= 2 * self.core:
            quick = min(quick, 8 * least / self.speed)
        scene.resolve(time=quick, length=self.core, duration=float(np.clip(2.3 * turns + 0.8, 2.0, 10.0)))

    def hover(self, scene: Scene, parts: list[Part]) -> None:
        """Upright in the cage, the lowest held, like poles facing."""
        bars, gaps = self.bars, self.floating()
        least = min(gap for gap in gaps if gap) * min(self.release, 1 / self.release)
        if least < 2.2 * self.core:
            raise Refusal("R5", f"{self.label}: {self.mass:.3g} kg would come down to a gap of {least:.4g} m between "
                          f"poles; allowed: {2.2 * self.core:.4g} m, with a greater strength or a core of "
                          f"{least / 2.2:.2g} m")  # fmt: skip
        scene.spec.delete(parts[0].joint("motion"))
        centre = FOOT + bars.half_length
        for i, (part, turn, gap) in enumerate(zip(parts, (UP, DOWN, UP), (0.0, *gaps), strict=False)):
            centre += (self.release * gap + self.pole_distance) if i else 0.0
            part.body("magnet").pos, part.body("magnet").quat = (0, 0, centre), turn
        cage = scene.add("cage")
        top = centre + bars.half_length + 0.5 * sum(gaps) + 0.03
        # clear of the bars: x is their height when they lie, y their width
        x, y = bars.half_height + 0.003, max(bars.half_width(self.mass), bars.half_width(self.source_mass)) + 0.003
        for i, (right, far) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            cage.geom(f"rod{i}").fromto = (right * x, far * y, FOOT, right * x, far * y, top)
        cage.geom("cap").pos[2], cage.geom("cap").size[:2] = top, (x + 0.006, y + 0.006)
        cage.geom("foot").size[:2] = (x + 0.04, y + 0.04)
        scene.material(cage.name("cage"), 700.0, Surface())
        bob = sqrt(self.mass / self.stiffness(gaps[0]))
        scene.resolve(time=bob, length=self.core, duration=float(np.clip(12 * 2 * pi * bob, 3.0, 10.0)))

    def lie(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """On the floor, where the loose one may turn."""
        bars = self.bars
        if self.gap < 2.2 * self.core + 2 * bars.half_width(self.mass):
            raise Refusal("R5", f"{self.label}: gap = {self.gap:.4g} m is too narrow to turn in; allowed: "
                          f"{2.2 * self.core + 2 * bars.half_width(self.mass):.4g} m or more")  # fmt: skip
        bars.table(scene, source, loose, apart)
        scene.touch(source.name("magnet"), loose.name("magnet"))
        # the end of a bar that turns as it comes is as easy to move as a quarter of the bar
        snap = 12 * 2 * self.core / sqrt(2 * float(bars.well(2 * self.core)) / (self.mass / 4))
        scene.resolve(time=snap, length=self.core, duration=2.5)

    def pin(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """On a pin, where it can only turn."""
        self.bars.compass(scene, source, loose, apart)
        grow = 1 / sqrt(self.turning_rate_squared)
        scene.resolve(time=grow, length=self.core, duration=float(np.clip(20 * grow, 3.0, 10.0)))

    @property
    def turning_rate_squared(self) -> float:
        """λ² = k ℓ B/I of a short needle out of line, on a pin [1/s²]."""
        near = self.gap + self.pole_distance / 2
        field = 1 / near**2 - 1 / (near + self.pole_distance) ** 2
        return self.strength * self.pole_distance * field / self.bars.turning_inertia

    @observable("m")
    def pole_gap(self, run: Run) -> Array:
        """Between the poles that face each other, along the line (T,), or both gaps of a stack (T, 2)."""
        axis = 2 if self.place in ("cage", "stack") else 0
        bodies = [SOURCE, LOOSE, TOP] if self.place == "stack" else [SOURCE, LOOSE]
        places = np.array([run.position(body)[:, axis] for body in bodies])
        gaps = np.diff(places, axis=0) - self.pole_distance
        return np.asarray(gaps[0] if len(gaps) == 1 else gaps.T)

    @observable("m/s")
    def parting(self, run: Run) -> Array:
        """Speed with which the two centres move apart, along their line."""
        axis = 2 if self.place in ("cage", "stack") else 0
        return run.velocity(LOOSE)[:, axis] - run.velocity(SOURCE)[:, axis]

    @observable("rad")
    def out_of_line(self, run: Run) -> Array:
        """Angle by which the loose magnet has turned away from where like poles face each other."""
        w, _, _, z = run.quaternion(LOOSE).T
        return np.asarray(pi - np.abs(np.unwrap(2 * np.arctan2(z, w)))) if self.place in ("table", "pin") else 0 * w

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic, magnetic and that of height, all together."""
        return np.asarray(run.motion.kinetic + run.motion.potential)

    def twin(self, run: Run, **changes: float | str) -> tuple[MagnetRepel, Run]:
        """The same specimen with some parameters changed, and its run; this one if nothing changes."""
        if all(getattr(self, name) == value for name, value in changes.items()):
            return self, run
        try:
            return MagnetRepel.make(**(self.values() | changes)), run.again(**changes)
        except Refusal as refusal:
            raise NotEvaluated(f"the twin that this law needs is refused: {refusal}") from None

    def rebound(self, run: Run) -> tuple[MagnetRepel, Run, Array, Array, Array]:
        """A run on a rail that does not touch: specimen, run, and till the first stop times, gaps and their rates."""
        place = self.place if self.rail else "one on a rail"
        probe = MagnetRepel.make(**(self.values() | {"place": place}))
        nearest = min(3 * self.core, 0.9 * self.gap)
        room = float(probe.bars.well(nearest) - probe.bars.well(self.gap))
        slowest = sqrt(2 * room / probe.bars.reduced_mass)
        if slowest < 0.1:
            raise NotEvaluated(f"too weak: faster than {slowest:.3g} m/s they touch")
        specimen, one = self.twin(run, place=place, speed=min(self.speed, slowest))
        first = min((i.time for i in one.impacts), default=np.inf)
        till = one.t < first
        return specimen, one, one.t[till], specimen.pole_gap(one)[till], specimen.parting(one)[till]

    @law("½ m_r v₀² = k {[1/g + 1/(g + 2ℓ) - 2/(g + ℓ)] at g_min - the same at g₀}", within=(1e-5, 1e-7, 1e-8),
         source="Jackson, Classical Electrodynamics, §5.9 C; Landau & Lifshitz, Mechanics, §11")  # fmt: skip
    def turns_back_where_the_energy_ends(self, run: Run) -> Measurement:
        """14a: least gap of a launched magnet, and of one launched at three quarters of its speed."""
        specimen, one, *_ = self.rebound(run)
        slower = {"speed": max(0.75 * specimen.speed, 0.1), "place": specimen.place}
        found, expected = [], []
        for each, r in ((specimen, one), self.twin(run, **slower)):
            gaps = peaks(r.t, -each.pole_gap(r), -each.parting(r))[1]
            if not len(gaps):
                raise NotEvaluated("it is still approaching when the run ends")
            found.append(-gaps[0])
            expected.append(each.closest)
        return found, expected

    @law(
        "|ġ| after = |ġ| before, at the same gap", source="Landau & Lifshitz, Mechanics, §11", within=(1e-5, 1e-7, 1e-8)
    )
    def is_thrown_back_as_fast(self, run: Run) -> Measurement:
        """14b: at the middle between the start and the turning point."""
        specimen, _, t, gap, rate = self.rebound(run)
        mark = (specimen.gap + specimen.closest) / 2
        there, back = crossings(t, gap, rate, mark, rising=False), crossings(t, gap, rate, mark)
        if not len(there) or not len(back):
            raise NotEvaluated("it is not back when the run ends or the stop is reached")
        speeds = []
        for when in (there[0], back[0]):
            near = np.sort(np.argsort(np.abs(t - when))[:6])
            both = np.column_stack([gap[near], rate[near]]).ravel()
            speeds.append(abs(KroghInterpolator(np.repeat(t[near] - when, 2), both).derivative(0.0)))
        return speeds[1] / speeds[0], 1.0

    @law("m₁ v₁ + m₂ v₂ = const.", source="Newton, Principia, law 3", within=(1e-10, 1e-11, 1e-12))
    def action_is_reaction(self, run: Run) -> Measurement:
        """Momentum of two that are both free on the rail, till the first reaches a stop."""
        specimen, one = self.twin(run, place="both on a rail")
        stopped = [i.time for i in one.impacts if "stop" in i.first + i.second]
        till = one.t < min(stopped, default=np.inf)
        total = self.mass * one.velocity(LOOSE)[till, 0] + self.source_mass * one.velocity(SOURCE)[till, 0]
        return total, np.full_like(total, -self.mass * specimen.speed)

    @law("m g = F(g*), ω² = (2 k/m) [1/g³ + 1/(g + 2ℓ)³ - 2/(g + ℓ)³] at g*", within=(2e-5, 1e-5, 1e-5),
         source="Jackson, Classical Electrodynamics, §5.9 C; Landau & Lifshitz, Mechanics, §21 eq. 21.6",
         limited_by="small swings: it is let go 0.2 % off, and the error is of the square of that")  # fmt: skip
    def floats_where_the_force_is_its_weight(self, run: Run) -> Measurement:
        """14c: the middle of small swings in the cage over g*, and their ω over that of the formula."""
        specimen, one = self.twin(run, place="cage", release=1.002, mass=self.light)
        gap, rate = specimen.pole_gap(one), specimen.parting(one)
        (high_times, high), (_, low) = peaks(one.t, gap, rate), peaks(one.t, -gap, -rate)
        if len(high) < 5:
            raise NotEvaluated(f"{len(high)} swings recorded; needed: 5")
        rest = specimen.floating()[0]
        bobbing = 2 * pi * (len(high) - 1) / (high_times[-1] - high_times[0])
        expected = sqrt(specimen.stiffness(rest) / specimen.mass)
        return [(high.mean() - low.mean()) / 2 / rest, bobbing / expected], [1.0, 1.0]

    @law("F(g₁) = 2 m g + F(g₁ + g₂ + ℓ), F(g₂) = m g + F(g₁ + g₂ + ℓ)", within=(2e-5, 1e-5, 1e-5),
         source="Jackson, Classical Electrodynamics, §5.9 C: all poles of three magnets",
         limited_by="small swings: they are let go 0.2 % off, and the error is of the square of that")  # fmt: skip
    def the_lower_gap_bears_both(self, run: Run) -> Measurement:
        """14d: mean gaps of two that float, one above the other, over those of the equations."""
        specimen, one = self.twin(run, place="stack", release=1.002, mass=self.light)
        smooth = np.sin(pi * one.t / one.t[-1]) ** 4  # a window that no swing of the record gets through
        return smooth @ specimen.pole_gap(one) / smooth.sum() / specimen.floating(), np.ones(2)

    @law("E = const. till they snap", source="Landau & Lifshitz, Mechanics, §6 (energy)", within=(2e-3, 1e-4, 1e-5))
    def turning_round_costs_nothing(self, run: Run) -> Measurement:
        """14e: energy of one that lies loose on a smooth table, over the magnetic energy of the start or the most that
        it moves with, and it turns; till unlike poles are within six softening lengths."""
        specimen, one = self.twin(run, place="table", friction=0.0, turned=max(self.turned, 0.3))
        if cosh(sqrt(specimen.turning_rate_squared) * one.t[-1]) < 3:
            raise NotEvaluated(f"strength = {self.strength:.2g} N m² hardly turns it in {one.t[-1]:.2g} s")
        first = min((i.time for i in one.impacts if "floor" not in i.first + i.second), default=np.inf)
        ends = [specimen.bars.poles(one, body) for body in (LOOSE, SOURCE)]
        near = np.min([np.linalg.norm(mine - other, axis=1) for mine in ends[0] for other in ends[1]], axis=0)
        snaps = np.flatnonzero(near < SNAP * self.core)
        apart = (one.t < first) & (np.arange(len(one)) < (snaps[0] if len(snaps) else len(one)))
        energy, turned = specimen.bars.energy(one)[apart], specimen.out_of_line(one)[apart]
        if len(turned) < 5 or turned.max() < 1.2 * specimen.turned:
            return np.nan, 1.0  # frozen: no free magnet stays as it is
        # from far away they fall into a well that is far deeper than where they began
        scale = max(float(specimen.bars.well(self.gap)), float(one.motion.kinetic[apart].max()))
        return 1 + (energy - energy[0]) / scale, np.ones(len(energy))

    @law("φ = φ₀ cosh λ t, λ² = k ℓ |B|/I", source="Earnshaw, Trans. Camb. Phil. Soc. 7 (1842) 97: nothing stays",
         within=(5e-3, 5e-3, 5e-3), limited_by="the field is taken at the pin: an error of order (ℓ/r)²")  # fmt: skip
    def out_of_line_it_turns_farther(self, run: Run) -> Measurement:
        """14e: growth of a small misalignment on a pin, of a needle that is much shorter than its distance."""
        short = {"pole_distance": 0.012, "gap": 0.39, "mass": 0.02, "core": 0.004, "turned": 0.001}
        specimen, one = self.twin(run, place="pin", strength=max(self.strength, 2e-3), **short)
        out = specimen.out_of_line(one)
        window = np.flatnonzero((out > 0.01) & (out < 0.05) & (one.t < one.t[int(np.argmax(out))]))
        if len(window) < 3:
            return 0.0, sqrt(specimen.turning_rate_squared)  # it stays in line
        rates = np.arccosh(out[window] / out[0]) / one.t[window]
        return rates, np.full_like(rates, sqrt(specimen.turning_rate_squared))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        bars = "bar magnets, north poles red, south poles blue,"
        if self.rail:
            other = "clamped" if self.place == "one on a rail" else f"free to slide, too ({self.source_mass:.2g} kg)"
            least = self.pole_gap(run).min()
            ends = (
                "It is fast enough to touch the other, and is thrown back from there."
                if any("stop" not in i.first + i.second for i in run.impacts)
                else f"At a gap of {100 * least:.1f} cm all its energy of motion is used up, and it is thrown back."
            )
            return (
                f"Two {bars} lie on a rail with like poles facing, {self.gap:.2g} m apart. One of {self.mass:.2g} kg "
                f"is launched at {self.speed:.2g} m/s towards the other, which is {other}. They repel each other, ever "
                f"more strongly the nearer they come. {ends} It comes back as fast as it went, up to the stop."
            )
        if self.place in ("cage", "stack"):
            many = "Two more of" if self.place == "stack" else "Another of"
            gaps = " and ".join(f"{100 * gap:.1f} cm" for gap in self.floating() if gap)
            return (
                f"Of {bars} one stands on the foot of a cage of thin rods. {many} {self.mass:.2g} kg above it, like "
                f"poles facing, {'are' if self.place == 'stack' else 'is'} let go off balance. Repulsion carries the "
                f"weight: it grows as the gap closes, so that what floats bobs up and down about a gap of {gaps}, "
                "where force and weight are equal, and never lands."
            )
        where = "lies loose on the floor" if self.place == "table" else "is balanced on a pin"
        fate = (
            "It is pushed off, turns round, and then unlike poles face each other, which attract."
            if self.place == "table"
            else "It turns right round, swings past the position in line and comes back."
        )
        return (
            f"Two {bars} have like poles facing, {self.gap:.2g} m apart. One is fixed, the other {where}, turned "
            f"{np.degrees(self.turned):.1f} degrees out of line. Like poles repel each other, and no magnet stays "
            f"in line with another that repels it: the slightest turn grows. {fate}"
        )
