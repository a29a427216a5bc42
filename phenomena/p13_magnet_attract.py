"""Bar magnets whose unlike poles face each other: pulled together on a rail or a table, or turning like a compass."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import Magnet, Magnets
from physinone_mj.measure import accelerations, crossings, threshold
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Part, Scene, free_pose

DENSITY = 7500.0
"""Of sintered neodymium-iron-boron [kg/m³] (typical of makers' data sheets)."""

HEIGHT = 0.12
"""Of the rail, the pin and the shelf [m]."""

SOURCE, LOOSE = "source/magnet", "loose/magnet"


class MagnetAttract(Phenomenon, domain="magnetism"):
    """Magnetic attraction."""

    strength: Annotated[float, Param("N m²", 1e-4, 1e-2, "force of two poles 1 m apart")] = 2e-3
    pole_distance: Annotated[float, Param("m", 0.012, 0.12, "between the poles of a magnet")] = 0.08
    gap: Annotated[float, Param("m", 0.01, 0.4, "between the poles that face each other, at the start")] = 0.3
    mass: Annotated[float, Param("kg", 0.02, 0.5, "of the loose magnet")] = 0.15
    source_mass: Annotated[float, Param("kg", 0.02, 0.5, "of the other, which is fixed in most places")] = 0.25
    core: Annotated[float, Param("m", 0.002, 0.01, "depth of a pole below the surface")] = 0.006
    angle: Annotated[float, Param("rad", 0.0, pi, "by which the magnet on the table or the needle is turned")] = 0.6
    friction: Annotated[float, Param("1", 0.0, 0.5, "between magnet and table")] = 0.2
    place: Annotated[
        Literal["both on a rail", "one on a rail", "table", "compass"],
        Choice("both slide; one slides, the other is held; one lies on a table; one turns on a pin"),
    ] = "both on a rail"

    @property
    def half_length(self) -> float:
        """Of a bar [m]."""
        return self.pole_distance / 2 + self.core

    @property
    def half_height(self) -> float:
        """Of both bars [m]: the lighter is of square section, if its poles lie deep enough in it."""
        return max(sqrt(min(self.mass, self.source_mass) / (DENSITY * 8 * self.half_length)), 1.01 * self.core)

    def half_width(self, mass: float) -> float:
        """Of a bar [m], from its mass; that of a light one has a case as thick as its poles lie deep."""
        return max(mass / (DENSITY * 8 * self.half_length * self.half_height), 1.01 * self.core)

    @property
    def reduced_mass(self) -> float:
        """What the gap's motion weighs [kg]."""
        other = self.source_mass if self.place == "both on a rail" else float("inf")
        return 1 / (1 / self.mass + 1 / other)

    def pull(self, gap: ArrayLike) -> NDArray[np.float64]:
        """Force [N] between magnets in line: four pairs of poles (13a)."""
        x, pole = np.asarray(gap, float), self.pole_distance
        return self.strength * (1 / x**2 + 1 / (x + 2 * pole) ** 2 - 2 / (x + pole) ** 2)

    def well(self, gap: ArrayLike) -> NDArray[np.float64]:
        """Minus the potential energy [J] of magnets in line."""
        x, pole = np.asarray(gap, float), self.pole_distance
        return self.strength * (1 / x + 1 / (x + 2 * pole) - 2 / (x + pole))

    def meeting(self) -> float:
        """Time [s] until magnets in line touch; infinite if friction holds them."""
        least, span = 2 * self.core, self.gap - 2 * self.core
        drag = self.friction * self.mass * g if self.place == "table" else 0.0
        if 0.98 * self.pull(self.gap) <= drag:
            return float("inf")

        def slowness(u: float) -> float:
            # gap = start - span u²: the singular 1/√ of the start from rest drops out
            gained = self.well(self.gap - span * u**2) - self.well(self.gap) - drag * span * u**2
            return float(2 * span * u / np.sqrt(2 * gained / self.reduced_mass))

        return float(quad(slowness, 1e-6, 1.0)[0]) if least < self.gap else 0.0

    def magnet(self, scene: Scene, name: str, mass: float) -> Part:
        """A bar of this specimen's length; its density counts the case."""
        part, half, width = scene.add("magnet", name), self.half_length / 2, self.half_width(mass)
        for pole, side in (("north", 1), ("south", -1)):
            bar = part.geom(pole)
            bar.pos[0], bar.size, bar.mass = side * half, (half, width, self.half_height), mass / 2
            part.site(pole[0].upper()).pos[0] = side * self.pole_distance / 2
        density = mass / (8 * self.half_length * width * self.half_height)
        scene.material(part.name("magnet"), density, Surface(friction=self.friction, restitution=0.2))
        return part

    def build(self, scene: Scene) -> None:
        """Two bars in line, unlike poles facing, on what carries them."""
        if self.gap < 2.2 * self.core:
            raise Refusal("R5", f"{self.label}: gap = {self.gap:.4g} m between poles that lie {self.core:.4g} m below "
                          f"their surfaces; allowed: {2.2 * self.core:.4g} m or more")  # fmt: skip
        if self.pole_distance < 2 * self.core:
            raise Refusal("R5", f"{self.label}: pole_distance = {self.pole_distance:.4g} m of poles that lie "
                          f"{self.core:.4g} m deep; allowed: {2 * self.core:.4g} m or more")  # fmt: skip
        source, loose = self.magnet(scene, "source", self.source_mass), self.magnet(scene, "loose", self.mass)
        apart = self.gap / 2 + self.pole_distance / 2
        {"both on a rail": self.rail, "one on a rail": self.rail, "table": self.table, "compass": self.compass}[
            self.place
        ](scene, source, loose, apart)
        poles = (source, loose)
        scene.effects.append(
            Magnets(tuple(Magnet(p.name("N"), p.name("S"), self.strength) for p in poles), 2 * self.core)
        )
        deepest, pole = 2 * self.core, self.pole_distance
        snap = 8 * deepest / sqrt(2 * (self.well(deepest) - self.well(self.gap)) / self.reduced_mass)
        if self.place == "compass":
            field = 1 / (self.gap + pole / 2) ** 2 - 1 / (self.gap + 1.5 * pole) ** 2
            swing = sqrt(self.turning_inertia / (self.strength * pole * field))
            scene.resolve(time=swing, length=self.core, duration=float(np.clip(6 * 2 * pi * swing, 4.0, 10.0)))
            return
        scene.touch(source.name("magnet"), loose.name("magnet"))
        meeting = self.meeting()
        duration = float(np.clip(2 * meeting + 0.5, 2.0, 10.0)) if np.isfinite(meeting) else 2.0
        scene.resolve(time=snap, length=self.core, duration=duration)

    def rail(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """On two smooth rods; a block holds the source, if one is held."""
        rail, z, reach = scene.add("rail"), HEIGHT + self.half_height, apart + 1.5 * self.half_length
        scene.material(rail.name("rail"), 7800.0, Surface())
        scene.material(rail.name("clamp"), 700.0, Surface())
        for rod, side in (("near", -1), ("far", 1)):
            y = side * 0.6 * self.half_width(min(self.mass, self.source_mass))
            rail.geom(rod).fromto = (-reach, y, HEIGHT - 0.004, reach, y, HEIGHT - 0.004)
        rail.geom("left").pos[0], rail.geom("right").pos[0] = -reach + 0.01, reach - 0.01
        source.body("magnet").pos, loose.body("magnet").pos = (-apart, 0, z), (apart, 0, z)
        if self.place == "one on a rail":
            scene.spec.delete(source.joint("motion"))
            rail.body("clamp").pos[0] = -apart - self.half_length
            rail.geom("clamp").size = (0.012, self.half_width(self.source_mass) + 0.012, 0.05 + self.half_height)
        else:
            scene.spec.delete(rail.body("clamp"))

    def table(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """On the floor: the source is fixed to it, the other lies there with friction."""
        scene.spec.delete(source.joint("motion"))
        loose.joint("motion").type = mujoco.mjtJoint.mjJNT_FREE
        source.body("magnet").pos = (-apart, 0, self.half_height)
        turned = (cos(self.angle / 2), 0, 0, sin(self.angle / 2))
        scene.start[loose.name("motion")] = free_pose((apart, 0, self.half_height), turned)
        scene.material("stage/floor", 2000.0, Surface(friction=self.friction, restitution=0.2))
        scene.touch(loose.name("magnet"), "stage/floor")

    def compass(self, scene: Scene, source: Part, loose: Part, apart: float) -> None:
        """The source on a shelf, the other balanced on a pin."""
        stand, z = scene.add("compass"), HEIGHT + self.half_height
        for body in ("stand", "shelf"):
            scene.material(stand.name(body), 700.0, Surface())
        scene.spec.delete(source.joint("motion"))
        loose.joint("motion").type, loose.joint("motion").axis = mujoco.mjtJoint.mjJNT_HINGE, (0, 0, 1)
        source.body("magnet").pos, loose.body("magnet").pos = (-2 * apart, 0, z), (0, 0, z)
        stand.body("shelf").pos[0] = -2 * apart
        stand.geom("shelf").size[:2] = (0.8 * self.half_length, 1.5 * self.half_width(self.source_mass))
        scene.start[loose.name("motion")] = self.angle

    @property
    def turning_inertia(self) -> float:
        """Of a bar about the vertical through its centre [kg m²]."""
        return self.mass * (self.half_length**2 + self.half_width(self.mass) ** 2) / 3

    def poles(self, run: Run, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the north and the south pole of a bar are (T, 3) [m]."""
        arm = quaternion_matrix(run.quaternion(body))[:, :, 0] * self.pole_distance / 2
        return run.position(body) + arm, run.position(body) - arm

    @observable("m")
    def pole_gap(self, run: Run) -> NDArray[np.float64]:
        """Between the source's north pole and the other's south pole."""
        return np.asarray(np.linalg.norm(self.poles(run, LOOSE)[1] - self.poles(run, SOURCE)[0], axis=1))

    @observable("m/s")
    def approach(self, run: Run) -> NDArray[np.float64]:
        """Of the two centres, along the line that they start on."""
        return run.velocity(SOURCE)[:, 0] - run.velocity(LOOSE)[:, 0]

    @observable("N")
    def force(self, run: Run) -> NDArray[np.float64]:
        """Magnetic force on the loose magnet (T, 3), summed over the poles."""
        total = np.zeros((len(run), 3))
        for i, mine in enumerate(self.poles(run, LOOSE)):
            for j, other in enumerate(self.poles(run, SOURCE)):
                arm = mine - other
                total += (-1) ** (i + j) * self.strength * arm / np.linalg.norm(arm, axis=1)[:, None] ** 3
        return total

    @observable("J")
    def energy(self, run: Run) -> NDArray[np.float64]:
        """Kinetic, magnetic and, on the table, where magnets may hop, that of gravity, together."""
        total = self.mass * g * (run.position(LOOSE)[:, 2] - self.half_height) if self.place == "table" else 0.0
        total = total + run.kinetic(LOOSE) + (run.kinetic(SOURCE) if self.place == "both on a rail" else 0.0)
        for i, mine in enumerate(self.poles(run, LOOSE)):
            for j, other in enumerate(self.poles(run, SOURCE)):
                total = total + (-1) ** (i + j) * self.strength / np.linalg.norm(mine - other, axis=1)
        return np.asarray(total)

    def twin(self, run: Run, **changes: float | str) -> tuple[MagnetAttract, Run]:
        """The same specimen with some parameters changed, and its run; this one if nothing changes."""
        if all(getattr(self, name) == value for name, value in changes.items()):
            return self, run
        try:
            return MagnetAttract.make(**(self.values() | changes)), run.again(**changes)
        except Refusal as refusal:
            raise NotEvaluated(f"the twin that this law needs is refused: {refusal}") from None

    def in_line(self, run: Run) -> tuple[MagnetAttract, Run, int]:
        """(specimen, run, samples before contact) of magnets on a rail: this run, or its twin with both free."""
        place = self.place if "rail" in self.place else "both on a rail"
        specimen, one = self.twin(run, place=place)
        contact = next((i.time for i in one.impacts), np.inf)
        count = int(np.sum(one.t < contact))
        if count < 12:
            raise NotEvaluated(f"{count} samples before contact; needed: 12")
        return specimen, one, count

    @law("m_r g̈ = -k [1/g² + 1/(g + 2ℓ)² - 2/(g + ℓ)²]", source="Jackson, Classical Electrodynamics, §5.9 C",
         within=(1e-5, 1e-5, 1e-5), limited_by="rounding, magnified by differencing twice")  # fmt: skip
    def four_pairs_of_poles_pull(self, run: Run) -> Measurement:
        """13a: acceleration of the gap, differentiated from its record, on the first half of the way."""
        specimen, one, count = self.in_line(run)
        gap = specimen.pole_gap(one)[:count]
        measured = accelerations(one.t[:count], gap, -specimen.approach(one)[:count])
        far = gap[2:-2] > (self.gap + 2 * self.core) / 2
        if count < 60:
            raise NotEvaluated(f"{count} samples before contact are too few to be differentiated; needed: 60")
        return -specimen.reduced_mass * measured[far], specimen.pull(gap[2:-2][far])

    @law("½ m_r ġ² = k [1/g + 1/(g + 2ℓ) - 2/(g + ℓ)] - the same at g₀", source="Landau & Lifshitz, Mechanics, §11",
         within=(1e-4, 2e-6, 2e-7))  # fmt: skip
    def falls_down_the_well(self, run: Run) -> Measurement:
        """13b: kinetic energy of the approach at every gap until contact."""
        specimen, one, count = self.in_line(run)
        gap, speed = specimen.pole_gap(one)[:count], specimen.approach(one)[:count]
        return specimen.reduced_mass * speed**2 / 2, specimen.well(gap) - specimen.well(self.gap)

    @law("m₁ v₁ + m₂ v₂ = 0", source="Newton, Principia, law 3", within=(1e-11, 1e-11, 1e-12))
    def action_is_reaction(self, run: Run) -> Measurement:
        """13c: momentum of the two, both free, contact included: that of one against that of the other."""
        _, one = self.twin(run, place="both on a rail")
        return self.mass * one.velocity(LOOSE)[:, 0], -self.source_mass * one.velocity(SOURCE)[:, 0]

    @law("d ln F/d ln s: -4 for s ≫ ℓ, -2 for g ≪ ℓ, and between them as 13a has it",
         source="Jackson, Classical Electrodynamics, §5.9 C: four poles", within=(5e-4, 1e-5, 1e-6))  # fmt: skip
    def far_dipoles_and_near_poles(self, run: Run) -> Measurement:
        """13d: exponent of the pull over centre distance, far, and over the gap, near.

        The mean pull over a stretch is the kinetic energy gained there over its length; two stretches make an exponent.
        """
        exponents = []
        far, near = self.strength, min(self.strength, 2e-3)
        for values, stop, to_centre in (
            ({"strength": far, "pole_distance": 0.02, "gap": 0.25, "mass": 0.1, "core": 0.008}, 0.22, 1.0),
            ({"strength": near, "pole_distance": 0.12, "gap": 0.01, "mass": 0.5, "core": 0.003}, 0.0065, 0.0),
        ):
            specimen, one = self.twin(run, place="one on a rail", **values)
            gap = specimen.pole_gap(one)
            count = int(np.argmax(gap < stop)) if gap.min() < stop else len(gap)
            if count < 3:
                raise NotEvaluated(f"{count} samples before the gap is {stop} m; needed: 3")
            stations = np.array([0, np.argmin(np.abs(gap[:count] - (gap[0] + gap[count - 1]) / 2)), count - 1])
            away = gap[stations] + to_centre * specimen.pole_distance
            means = np.sqrt(away[1:] * away[:-1])
            for gained in (specimen.mass * specimen.approach(one)[stations] ** 2 / 2, specimen.well(gap[stations])):
                pulls = np.diff(gained) / -np.diff(away)
                exponents.append(np.log(pulls[1] / pulls[0]) / np.log(means[1] / means[0]))
        return exponents[::2], exponents[1::2]

    @law("ω² = k ℓ |B|/I, B = r_N/r_N³ - r_S/r_S³", source="Landau & Lifshitz, Mechanics, §21 eq. 21.6",
         within=(5e-3, 5e-3, 5e-3), limited_by="the field is taken at the pin: an error of order (ℓ/r)²")  # fmt: skip
    def needle_swings_in_the_field(self, run: Run) -> Measurement:
        """13e: small swings of a needle that is much shorter than its distance."""
        short = {"pole_distance": 0.012, "gap": 0.39, "mass": 0.02, "core": 0.004, "angle": 0.03}
        specimen, one = self.twin(run, place="compass", strength=max(self.strength, 2e-3), **short)
        near = specimen.gap + specimen.pole_distance / 2
        field = 1 / near**2 - 1 / (near + specimen.pole_distance) ** 2
        expected = specimen.strength * specimen.pole_distance * field / specimen.turning_inertia
        once = 2 * pi / sqrt(expected)
        if one.t[-1] < 2.5 * once:
            raise NotEvaluated(f"{one.t[-1]:.3g} s are too short for a needle that takes {once:.3g} s to swing")
        turns, rates = one.joint("loose/motion"), one.joint_speed("loose/motion")
        crossed = crossings(one.t, turns, rates)
        # a needle that does not swing has no period: its ω is 0
        swings = (len(crossed) - 1) / (crossed[-1] - crossed[0]) if len(crossed) > 1 else 0.0
        return (2 * pi * swings) ** 2, expected

    @law("pulled in iff F(g) > μ m g", source="Coulomb (1785), static friction; F from 13a", within=(1e-3, 1e-3, 1e-3),
         limited_by="the threshold is bracketed, to 0.1 %")  # fmt: skip
    def friction_holds_beyond_a_gap(self, run: Run) -> Measurement:
        """13f: the widest gap from which a magnet on a table is pulled in, bracketed by twins."""
        # on a smoother table the last per mille of the pull needs minutes to show
        friction = self.friction if self.friction > 0.1 else 0.2

        def surplus(gap: float) -> float:
            return float(self.pull(gap)) - friction * self.mass * g

        core = max(self.core, 0.006)
        low, high = 2.5 * core, 0.38
        if surplus(low) < 0 or surplus(high) > 0:
            raise NotEvaluated(f"the widest gap lies outside {low:.3g} ... {high} m")
        widest = float(brentq(surplus, low, high, xtol=1e-14))

        def goes(nearness: float) -> bool:
            _, one = self.twin(run, place="table", angle=0.0, core=core, friction=friction, gap=1 / nearness)
            moved = one.position(LOOSE)[:, 0]
            return bool(moved[0] - moved.min() > 1e-3)

        return 1 / threshold(goes, 1 / widest, spread=0.0017, resolution=1e-3), widest

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        bars = f"bar magnets ({self.source_mass:.2g} and {self.mass:.2g} kg), north poles red, south poles blue,"
        if self.place == "compass":
            return (
                f"Two {bars} stand {self.gap:.2f} m apart, one fixed on a shelf, the other balanced on a pin like a "
                f"compass needle and turned by {np.degrees(self.angle):.0f} degrees. The fixed magnet's field turns "
                f"the needle into line, unlike poles facing; with no friction it swings past and back, faster in a "
                f"stronger field."
            )
        where = {
            "both on a rail": "lie on a smooth rail, both free to slide,",
            "one on a rail": "lie on a smooth rail, one clamped and one free,",
            "table": f"lie on the floor, one fixed, the other free with friction {self.friction:.2g},",
        }[self.place]
        ends = (
            f"They snap together after {run.impacts[0].time:.1f} s and stay in contact."
            if any({i.first.split("/")[0], i.second.split("/")[0]} == {"source", "loose"} for i in run.impacts)
            else "Within the time of the film they do not meet."
        )
        return (
            f"Two {bars} {where} unlike poles {self.gap:.2g} m apart. They attract each other: the pull is weak at a "
            f"distance, where it falls with the fourth power, and grows with the inverse square as the poles come "
            f"close, so that the approach is ever faster. {ends}"
        )
