"""A fan blows at what stands still: it stays, slides, topples or rolls away, as friction and its shape decide."""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import Box, Wind, fan
from physinone_mj.measure import accelerations, threshold
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Scene, free_pose

from .winds import HARDEST, HEIGHT, LONGEST, Course, course, foam, mover, twin

Array = NDArray[np.float64]

BETA: Final = 2 / 5
"""I/(m r²) of the ball."""

MARGIN: Final = 1.9e-3
"""A wind this much weaker than the critical one must leave the body where it is, this much stronger must not."""

TIPPED: Final = 0.5
"""Tilt from which a tall block falls over [rad]."""


class WindPushStationary(Phenomenon, domain="mechanics"):
    """Wind applied to a stationary object."""

    force: Annotated[float, Param("N", 0.05, 40.0, "of the wind at the fan")] = 6.2
    length: Annotated[float, Param("m", 1.0, 4.0, "of the wind, from the fan to its end")] = 2.4
    start: Annotated[float, Param("1", 0.05, 1.1, "distance of the body from the fan, in lengths of the wind")] = 0.3
    mass: Annotated[float, Param("kg", 0.001, 5.0, "body")] = 0.5
    friction: Annotated[float, Param("1", 0.0, 0.9, "between body and floor")] = 0.4
    base: Annotated[float, Param("m", 0.05, 0.15, "side of the block's square base, diameter of the ball")] = 0.14
    aspect: Annotated[float, Param("1", 0.3, 4.0, "height of the block, against its base")] = 1.0
    body: Annotated[Literal["block", "ball"], Choice("what stands there")] = "block"

    @property
    def name(self) -> str:
        """Of the body in the scene."""
        return f"{self.body}/{self.body}"

    @property
    def inertia(self) -> float:
        """What resists the wind [kg]: m (1 + β) for what rolls."""
        return self.mass * (1 + (BETA if self.body == "ball" else 0.0))

    @property
    def resistance(self) -> float:
        """Of the floor, to what slides [N]."""
        return self.friction * self.mass * g if self.body == "block" else 0.0

    @property
    def place(self) -> float:
        """Where it stands, from the fan [m]."""
        return self.start * self.length

    @property
    def fading(self) -> float:
        """Of the force there: (1 - s₀/L)²."""
        return max(1 - self.start, 0.0) ** 2

    @property
    def wind(self) -> Wind:
        """The effect."""
        return Wind(Box((0.0, 0.0, HEIGHT), (1.0, 0.0, 0.0), self.length, 0.5, 2 * HEIGHT), self.force, (self.name,))

    def push(self, s: float) -> float:
        """Force [N] at distance s from the fan, written out independently of the effect."""
        return self.force * (1 - s / self.length) ** 2 if 0 <= s <= self.length else 0.0

    @property
    def topples(self) -> bool:
        """Whether the wind tips the block over before it can slide (5d)."""
        return self.body == "block" and self.friction * self.aspect > 1 and self.push(self.place) * self.aspect > (
            self.mass * g
        )  # fmt: skip

    def course(self) -> Course:
        """What will come of it if it does not topple, to 1e-6."""
        end = self.length + 1.2 - self.base / 2
        return course(self.push, self.inertia, self.resistance, self.place, 0.0, -inf, max(end, self.place + 0.1))

    def build(self, scene: Scene) -> None:
        """A fan hung in a gate, the body at rest in its wind, and a pad where it would leave the picture."""
        gap = self.place - self.base / 2
        if gap < 0.1:
            raise Refusal("R1", f"start = {self.start:.3g} puts the body {gap:.3g} m from the fan; allowed: "
                          f"{(0.1 + self.base / 2) / self.length:.3g} or more")  # fmt: skip
        hardest = self.push(self.place) / self.inertia
        if hardest > HARDEST:
            raise Refusal("R12", f"force = {self.force:.3g} N accelerates {self.mass:.3g} kg by {hardest:.3g} m/s², "
                          f"out of sight at once; allowed: {self.force * HARDEST / hardest:.3g} N")  # fmt: skip
        way = self.course()
        scene.effects.append(self.wind)
        fan(scene, self.wind.box)
        joint = self.stand(scene)
        scene.start[joint] = free_pose((self.place, 0.0, self.base / 2 * (self.aspect if self.body == "block" else 1)))
        if way.s[-1] > self.length + 0.6:
            foam(scene, "pad", self.length + 1.2, -1, self.name)
        if self.topples:
            time, duration = 0.3, 3.0
        elif way.s[-1] > self.place:
            slope = 2 * sqrt(self.force * self.push(self.place)) / self.length
            time, duration = min(sqrt(self.inertia / slope), 0.5), way.t[-1] + 0.7
        else:
            time, duration = 1.0, LONGEST if self.push(self.place) > 0.9 * self.resistance > 0 else 5.0
        scene.resolve(time=time, length=self.base, duration=float(np.clip(duration, 3.0, LONGEST)))

    def stand(self, scene: Scene) -> str:
        """The body and its surface; returns its joint."""
        if self.body == "ball":
            return mover(scene, "ball", self.base / 2, self.mass, self.friction).name("free")
        part = scene.add("block")
        geom, sizes = part.geom("block"), self.base / 2 * np.array([1.0, 1.0, self.aspect])
        geom.size, geom.mass = sizes, self.mass
        surface = Surface(friction=self.friction, restitution=0.1)
        scene.material(self.name, self.mass / (8 * sizes.prod()), surface)
        scene.material("stage/floor", 2000.0, surface)
        scene.touch(self.name, "stage/floor")
        return part.name("free")

    @observable("m")
    def displacement(self, run: Run) -> Array:
        """Of the centre of mass from where it stood, along the wind."""
        return np.asarray(run.position(self.name)[:, 0] - self.place)

    @observable("rad")
    def tilt(self, run: Run) -> Array:
        """Of the block's axis from the vertical; of the ball, which rolls, none."""
        if self.body == "ball":
            return np.zeros(len(run))
        axis = quaternion_matrix(run.quaternion(self.name))[:, :, 2]
        return np.asarray(np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2]))

    @observable("N")
    def wind_force(self, run: Run) -> Array:
        """At the centre of mass; nothing outside the wind."""
        return np.array([self.push(s) for s in run.position(self.name)[:, 0]])

    def critical(self) -> float:
        """Force at the fan that friction just holds [N]."""
        if self.fading < 0.01 or self.friction < 0.02:
            raise NotEvaluated("without wind or friction there is no threshold")
        return self.friction * self.mass * g / self.fading

    @property
    def low(self) -> dict[str, float | str]:
        """What makes a block of it that does not topple."""
        flat = min(self.aspect, 0.8 / max(self.friction, 0.2))
        return {"body": "block", "aspect": flat}

    def blown(self, run: Run, factor: float, critical: float, **changes: float | str) -> tuple[WindPushStationary, Run]:
        """A twin in a wind so many times as strong as the critical one."""
        return twin(self, run, force=factor * critical, **changes)

    @law("F₀ (1 - s₀/L)² = μ m g", source="Coulomb, Théorie des machines simples (1785)", within=(2e-3, 2e-3, 2e-3),
         limited_by="the bracket: a wind that fades moves a block no farther than it is too strong")  # fmt: skip
    def friction_holds_up_to_its_limit(self, run: Run) -> Measurement:
        """5a: a block stays in a wind a little weaker and goes in one a little stronger, given its fading."""
        critical = self.critical()
        far = MARGIN * (1 - self.start) * self.length  # as far as the stronger wind can move it

        def goes(force: float) -> bool:
            specimen, one = self.blown(run, force / critical, critical, **self.low)
            return bool(np.abs(specimen.displacement(one)).max() > far / 2)

        return threshold(goes, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    @law("s = s₀ for F < μ m g", source="Coulomb, Théorie des machines simples (1785)", unit="m",
         within=(1e-6, 1e-7, 1e-8))  # fmt: skip
    def held_block_does_not_creep(self, run: Run) -> Measurement:
        """5a: displacement within 10 s, friction used to 0.998 of its limit."""
        specimen, one = self.blown(run, 1 - MARGIN, self.critical(), **self.low)
        return np.abs(specimen.displacement(one)).max(), 0.0

    def sliding(self, run: Run) -> tuple[WindPushStationary, Run]:
        """A block that is blown along and stopped by friction before the wind ends: this one or its twin."""
        critical = self.critical()
        if self.body == "block" and self.low["aspect"] == self.aspect and 1.1 < self.force / critical < 2.9:
            return self, run
        return self.blown(run, 1.6, critical, **self.low)

    @law("½ m v² = (F₀ L/3)[(1 - s₀/L)³ - (1 - s/L)³] - μ m g (s - s₀)",
         source="Landau & Lifshitz, Mechanics, §5-6 (work of F₀(1 - s/L)²); Coulomb, Théorie des machines simples "
         "(1785)", within=(2e-4, 2e-5, 2e-6))  # fmt: skip
    def wind_works_against_friction(self, run: Run) -> Measurement:
        """5b: square of the speed of a sliding block at every instant, until friction stops it."""
        specimen, one = self.sliding(run)
        v = one.velocity(specimen.name)[:, 0]
        moving = (v > 0.05 * v.max()) & (one.t > 0)
        if moving.sum() < 20:
            raise NotEvaluated(f"{moving.sum()} samples while it slides; needed: 20")
        gone = specimen.displacement(one)[moving]
        u0, u = 1 - specimen.start, 1 - specimen.start - gone / specimen.length
        work = specimen.force * specimen.length / 3 * (u0**3 - u**3)
        return v[moving] ** 2, 2 * (work / specimen.mass - specimen.friction * g * gone)

    @law("F₀ (u₀² + u₀ u + u²) = 3 μ m g, u = 1 - s/L", source="Landau & Lifshitz, Mechanics, §5-6 (work of F₀(1 - "
         "s/L)²); Coulomb, Théorie des machines simples (1785)", within=(2e-4, 2e-5, 2e-6),
         limited_by="the block stops within a step: the order is less than two")  # fmt: skip
    def friction_stops_it_where_the_work_is_spent(self, run: Run) -> Measurement:
        """5c: how far a sliding block gets: the root of 5b with v = 0."""
        specimen, one = self.sliding(run)
        if abs(one.velocity(specimen.name)[-1, 0]) > 1e-6:
            raise NotEvaluated(f"it still slides after {one.t[-1]:.3g} s")
        u0 = 1 - specimen.start
        u = (-u0 + sqrt(12 * specimen.resistance / specimen.force - 3 * u0**2)) / 2
        return specimen.displacement(one)[-1], specimen.length * (u0 - u)

    @law("F₀ (1 - s₀/L)² H = m g b, μ > b/H", source="Landau & Lifshitz, Mechanics, §38 (equilibrium of a rigid body)",
         within=(2e-3, 2e-3, 2e-3), limited_by="the width of the bracket")  # fmt: skip
    def tall_block_topples_before_it_slides(self, run: Run) -> Measurement:
        """5d: a block of height H and base b stays upright in a wind a little weaker and falls in one stronger."""
        aspect = max(self.aspect, 2.0)
        friction = max(self.friction, 1.4 / aspect)
        if (1 - self.start) * self.length < 3 * self.base:
            raise NotEvaluated("the wind fades within the block's own size")
        critical = self.mass * g / aspect / self.fading

        def falls(force: float) -> bool:
            specimen, one = self.blown(run, force / critical, critical, body="block", aspect=aspect, friction=friction)
            return bool(specimen.tilt(one).max() > TIPPED)

        return threshold(falls, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    @law("z = H/2 for μ < b/H", source="Landau & Lifshitz, Mechanics, §38 (equilibrium of a rigid body)",
         within=(1e-8, 1e-8, 1e-8))  # fmt: skip
    def low_block_slides_upright(self, run: Run) -> Measurement:
        """5d: height of the centre of a block that is no taller than friction allows, on all its way."""
        specimen, one = self.sliding(run)
        height = one.position(specimen.name)[:, 2]
        return height, np.full_like(height, specimen.aspect * specimen.base / 2)

    @law("m (1 + β) a = F₀ (1 - s/L)²", source="Landau & Lifshitz, Mechanics, §38 (rolling)", within=(1e-4, 1e-5, 1e-6))
    def ball_rolls_away(self, run: Run) -> Measurement:
        """5e: acceleration of a ball, differentiated from its record, all the way through the wind."""
        needed = BETA / (1 + BETA) * self.push(self.place) / (self.mass * g)
        if self.fading < 1e-4 or needed > 0.89:
            raise NotEvaluated(f"the ball needs friction of {needed:.3g} to roll" if needed else "no wind reaches it")
        specimen, one = twin(self, run, body="ball", friction=self.friction if needed < 0.99 * self.friction else 0.9)
        s = one.position(specimen.name)[:, 0]
        end = min((i.time for i in one.impacts), default=inf)
        count = int(np.sum((s < specimen.length) & (one.t < end)))
        if count < 20:
            raise NotEvaluated(f"{count} samples in the wind; needed: 20")
        measured = accelerations(one.t[:count], s[:count], one.velocity(specimen.name)[:count, 0])
        return specimen.inertia * measured, [specimen.push(x) for x in s[2 : count - 2]]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        gone, here = self.displacement(run), self.push(self.place)
        what = "A wooden block" if self.body == "block" else "An orange ball"
        if self.tilt(run).max() > TIPPED:
            fate = "Friction holds its foot, so the wind tips it over its edge, and it falls on its side."
        elif self.body == "ball":
            fate = f"Nothing holds it: it rolls away and is {gone[-1]:.2f} m farther at the end."
        elif gone.max() > 1e-3:
            fate = f"Friction is overcome: it slides off, slows as the wind fades, and ends {gone[-1]:.2f} m farther."
        else:
            fate = f"Friction of up to {self.resistance:.2g} N holds it, and it stays where it is."
        return (
            f"{what} of {self.mass:.2g} kg stands at rest on the floor, {self.place:.2f} m before a fan whose wind "
            f"pushes with {self.force:.2g} N at the blades and fades to nothing within {self.length:.1f} m. Where it "
            f"stands the push is {here:.2g} N against a weight of {self.mass * g:.2g} N. {fate}"
        )
