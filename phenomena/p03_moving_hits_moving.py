"""Two balls that meet in the air: what a collision conserves and what it takes."""

from __future__ import annotations

from math import asin, cos, hypot, pi, sin
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from phenomena.parts import ball, court, sphere_mass
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import IMPACT_WINDOW, around, between, fit
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

RISE: Final = 0.45
"""Time from the throw to the meeting at the top of both arcs [s]."""

APART: Final = 0.2
"""Least free way between the balls at the throw [m]."""

FIRST, SECOND = "first/ball", "second/ball"


class MovingHitsMoving(Phenomenon, domain="mechanics"):
    """Moving objects collide with one another: two balls thrown up meet at the top of their arcs."""

    first_speed: Annotated[float, Param("m/s", 0.3, 5.0, "horizontal, of the first ball")] = 2.0
    second_speed: Annotated[float, Param("m/s", 0.3, 5.0, "horizontal, of the second ball")] = 1.5
    crossing: Annotated[float, Param("rad", 0.0, pi, "between their headings: 0 overtaking, π head-on")] = 2.6
    offset: Annotated[float, Param("1", -0.9, 0.9, "impact parameter over the sum of the radii")] = 0.3
    restitution: Annotated[float, Param("1", 0.1, 0.8, "of the two balls together")] = 0.7
    friction: Annotated[float, Param("1", 0.0, 0.9, "of the two balls together")] = 0.3
    first_radius: Annotated[float, Param("m", 0.03, 0.12, "first ball")] = 0.12
    second_radius: Annotated[float, Param("m", 0.03, 0.12, "second ball")] = 0.1
    first_density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "first ball")] = 600.0
    second_density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "second ball")] = 900.0

    @property
    def masses(self) -> tuple[float, float]:
        """Of both balls [kg]."""
        return (
            sphere_mass(self.first_radius, self.first_density),
            sphere_mass(self.second_radius, self.second_density),
        )

    @property
    def headings(self) -> tuple[Array, Array]:
        """Horizontal velocities of both balls (3,) [m/s]; at the meeting they have no others."""
        half = self.crossing / 2
        one = self.first_speed * np.array([cos(half), -sin(half), 0.0])
        two = self.second_speed * np.array([cos(half), sin(half), 0.0])
        return one, two

    @property
    def line(self) -> Array:
        """Line of centres at the meeting, from the first ball to the second (3,)."""
        closing = self.headings[0] - self.headings[1]
        along = closing / np.linalg.norm(closing)
        aside = np.array([-along[1], along[0], 0.0])
        tilt = asin(self.offset)
        return cos(tilt) * along + sin(tilt) * aside

    @property
    def height(self) -> float:
        """Of both centres at the meeting [m]."""
        return max(self.first_radius, self.second_radius) + 0.005 + g * RISE**2 / 2

    @property
    def centres(self) -> tuple[Array, Array]:
        """At the meeting, (3,) each [m]."""
        away = (self.first_radius + self.second_radius) / 2 * self.line
        up = np.array([0.0, 0.0, self.height])
        return up - away, up + away

    def build(self, scene: Scene) -> None:
        """Two balls thrown up from marks on the ground, and rails to keep them in view."""
        closing = float(np.linalg.norm(self.headings[0] - self.headings[1]))
        if closing * RISE < APART:
            raise Refusal("R1", f"{self.label}: closing at {closing:.3g} m/s leaves {closing * RISE:.3g} m between the "
                          f"balls at the throw; allowed: {APART:g} m, closing at {APART / RISE:.3g} m/s")  # fmt: skip
        half = 0.35 + 0.5 * max(self.first_speed, self.second_speed)
        ground = Surface(friction=0.4, restitution=0.3)
        scene.material("stage/floor", 2400.0, ground)
        rails = court(scene, half, ground)
        surface = Surface(friction=self.friction, restitution=self.restitution)
        looks = (
            ("first", self.first_radius, self.first_density, (0.84, 0.27, 0.22)),
            ("second", self.second_radius, self.second_density, (0.23, 0.47, 0.76)),
        )
        for (name, radius, density, colour), centre, heading in zip(looks, self.centres, self.headings, strict=True):
            part = ball(scene, name, radius, density, surface, colour)
            start = centre - heading * RISE - np.array([0.0, 0.0, g * RISE**2 / 2])
            scene.start[part.name("free")] = free_pose(start)
            scene.speed[part.name("free")] = (heading[0], heading[1], g * RISE, 0.0, 0.0, 0.0)
            mark = scene.add("mark", f"{name}_mark")
            mark.body("mark").pos[:2] = start[:2]
            mark.geom("mark").size[0] = 1.3 * radius
            scene.material(mark.name("mark"), 1000.0, ground)
            scene.touch(part.name("ball"), "stage/floor")
            scene.touch(part.name("ball"), rails.name("rails"))
        scene.touch(FIRST, SECOND)
        scene.resolve(time=0.1, length=min(self.first_radius, self.second_radius), duration=3.0)

    @staticmethod
    def meeting(run: Run) -> Impact:
        """The first impact of the two; NotEvaluated if they have touched something else before."""
        if not run.impacts or {run.impacts[0].first, run.impacts[0].second} != {FIRST, SECOND}:
            raise NotEvaluated("the balls have not met in the air")
        return run.impacts[0]

    def sides(self, run: Run) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
        """Velocities (before, after) of both balls, and the measured line of centres (3,)."""
        when = self.meeting(run).time
        both = [around(run, b, when) for b in (FIRST, SECOND)]
        mask = between(run.t, when - IMPACT_WINDOW, when, least=3)
        gap = (run.position(SECOND) - run.position(FIRST))[mask]
        path = fit(run.t[mask], gap, 1)
        line = path[0] + path[1] * (when - run.t[mask][0])
        return both[0], both[1], line / np.linalg.norm(line)

    @observable("m")
    def distance(self, run: Run) -> Array:
        """Between the surfaces of the balls, (T,)."""
        away = np.linalg.norm(run.position(SECOND) - run.position(FIRST), axis=1)
        return np.asarray(away - self.first_radius - self.second_radius)

    @observable("kg m/s")
    def momentum(self, run: Run) -> Array:
        """Of both balls together, (T, 3)."""
        return run.momentum(FIRST) + run.momentum(SECOND)

    @observable("kg m²/s")
    def angular_momentum(self, run: Run) -> Array:
        """Of both balls together about the origin, (T, 3)."""
        return run.angular_momentum(FIRST) + run.angular_momentum(SECOND)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic energy of both balls, spins included, (T,)."""
        return run.kinetic(FIRST) + run.kinetic(SECOND)

    @law("Σ m u = Σ m v", source="Newton, Principia, Axioms, corollary 3; Landau & Lifshitz, Mechanics, §7",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def centre_of_mass_goes_on(self, run: Run) -> Measurement:
        """3a: velocity of the common centre of mass before and after, against that of the throw."""
        one, two, _ = self.sides(run)
        m1, m2 = self.masses
        thrown = (m1 * self.headings[0] + m2 * self.headings[1]) / (m1 + m2)
        fastest = max(self.first_speed, self.second_speed)
        seen = [(m1 * a + m2 * b) / (m1 + m2) for a, b in zip(one, two, strict=True)]
        # relative to the faster ball: head-on, the centre of mass may rest
        return [*seen[0] / fastest + 1, *seen[1] / fastest + 1], [*thrown / fastest + 1] * 2

    @law("n·(u₁ - u₂) = -e n·(v₁ - v₂)", source="Newton, Principia, Axioms, corollary 6, scholium",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def separates_with_restitution(self, run: Run) -> Measurement:
        """3a: parting speed over closing speed along the measured line of centres, and that line itself."""
        (v1, u1), (v2, u2), line = self.sides(run)
        return [-((u1 - u2) @ line) / ((v1 - v2) @ line), *line], [self.restitution, *self.line]

    @law("Σ (r × m u + I ω) = const", source="Landau & Lifshitz, Mechanics, §9",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def angular_momentum_is_kept(self, run: Run) -> Measurement:
        """3b: about a point a metre aside, spins included, against that of the throw."""
        when = self.meeting(run).time
        point = np.array([1.0, -1.0, 0.0])
        total = np.zeros((2, 3))
        thrown = np.zeros(3)
        sizes = (self.first_radius, self.second_radius)
        for b, m, r, c, v in zip((FIRST, SECOND), self.masses, sizes, self.centres, self.headings, strict=True):
            spins = around(run, b, when, spin=True)
            for side, (velocity, spin) in enumerate(zip(around(run, b, when), spins, strict=True)):
                total[side] += m * np.cross(c - point, velocity) + 0.4 * m * r**2 * spin
            thrown += m * np.cross(c - point, v)
        return total, np.tile(thrown, (2, 1))

    @law("ΔE = -½ μ (1 - e²) (n·(v₁ - v₂))²",
         source="Landau & Lifshitz, Mechanics, §17; Stronge, Impact Mechanics, §2.5",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def smooth_balls_lose_what_restitution_says(self, run: Run) -> Measurement:
        """3c: kinetic energy taken by the hit, between frictionless balls (a twin, if these are rough)."""
        smooth = run if self.friction == 0 else run.again(friction=0.0)
        (v1, u1), (v2, u2), _ = self.sides(smooth)
        m1, m2 = self.masses
        taken = 0.5 * m1 * (v1 @ v1 - u1 @ u1) + 0.5 * m2 * (v2 @ v2 - u2 @ u2)
        closing = (self.headings[0] - self.headings[1]) @ self.line
        return taken, 0.5 * m1 * m2 / (m1 + m2) * (1 - self.restitution**2) * closing**2

    @law("r₁ - r₂ is the same from a moving frame", source="Galilei, Dialogo, day 2; Newton, Principia, corollary 5",
         within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def a_moving_frame_sees_the_same(self, run: Run) -> Measurement:
        """3d: relative path of the balls, beside that of a twin with another velocity added to both, in the air."""
        twin = run.again(boost=(0.7, -0.4, 0.0))
        for r in (run, twin):
            self.meeting(r)
        landed = min((r.impacts[1].time if len(r.impacts) > 1 else r.t[-1]) for r in (run, twin))
        mask = between(run.t, -1.0, landed)
        paths = [(r.position(SECOND) - r.position(FIRST))[mask] for r in (twin, run)]
        return paths[0], paths[1]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        m1, m2 = self.masses
        closing = float((self.headings[0] - self.headings[1]) @ self.line)
        flight = run.impacts[0].time
        drift = hypot(*((m1 * self.headings[0] + m2 * self.headings[1]) / (m1 + m2))[:2])
        return (
            f"A red ball of {m1:.2g} kg and a blue one of {m2:.2g} kg are thrown up so that they meet at the top of "
            f"their arcs, {self.height:.1f} m above the ground, with headings {np.degrees(self.crossing):.0f} degrees "
            f"apart. After {flight:.2f} s they collide, closing at {closing:.1f} m/s and parting at "
            f"{self.restitution * closing:.1f} m/s. Their common centre goes on at {drift:.1f} m/s as if nothing had "
            f"happened; both fall to the floor, bounce and roll."
        )
