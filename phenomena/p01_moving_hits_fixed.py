"""A ball against a wall: Newton's restitution and Coulomb's friction in one blow."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, inf, sin
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from phenomena.parts import ball, court
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import IMPACT_WINDOW, around, between, fit
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Blow:
    """What the closed formulas say of a sphere that strikes a wall, per unit of mass."""

    velocity: Array
    spin: Array
    loss: float
    slides: bool


class MovingHitsFixed(Phenomenon, domain="mechanics"):
    """Moving objects collide with fixed ones: a ball bounces off a wall."""

    speed: Annotated[float, Param("m/s", 0.5, 6.0, "of the ball")] = 2.0
    incidence: Annotated[float, Param("rad", 0.0, 1.309, "the ball's way against the wall's normal, from above")] = 0.6
    distance: Annotated[float, Param("m", 0.3, 3.0, "way of the ball until it hits")] = 1.5
    spin: Annotated[float, Param("rad/s", -100.0, 100.0, "of the ball about the vertical at the start")] = 25.0
    restitution: Annotated[float, Param("1", 0.1, 0.8, "of the ball; the pair has the mean")] = 0.8
    wall_restitution: Annotated[float, Param("1", 0.1, 0.8, "of the wall; the pair has the mean")] = 0.6
    friction: Annotated[float, Param("1", 0.0, 0.9, "of ball and wall together; the floor is smooth")] = 0.2
    tilt: Annotated[float, Param("rad", 0.0, 1.0472, "of the wall, backwards from the vertical")] = 0.0
    radius: Annotated[float, Param("m", 0.03, 0.15, "ball")] = 0.08
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "ball")] = 1100.0

    @property
    def normal(self) -> Array:
        """Of the wall, towards the ball (3,)."""
        return np.array([-cos(self.tilt), 0.0, sin(self.tilt)])

    @property
    def pair_restitution(self) -> float:
        """Of ball and wall: the mean."""
        return (self.restitution + self.wall_restitution) / 2

    @property
    def launch(self) -> Array:
        """Velocity at the start (3,) [m/s]."""
        return self.speed * np.array([cos(self.incidence), sin(self.incidence), 0.0])

    @property
    def half(self) -> float:
        """Half side of the court [m]; the wall's face is there."""
        return max(0.6, self.distance / 2 + 2 * self.radius + 0.2)

    def build(self, scene: Scene) -> None:
        """A court with low rails and a smooth floor, a wall on one side of it, a ball on its way."""
        rails = court(scene, self.half, Surface(restitution=0.2))
        orange = (0.93, 0.55, 0.20)
        thrown = ball(scene, "ball", self.radius, self.density, Surface(restitution=self.restitution), orange)
        wall = scene.add("wall")
        scene.spec.delete(rails.geom("east"))  # the wall stands there
        lean = (cos(self.tilt / 2), 0.0, sin(self.tilt / 2), 0.0)
        wall.body("wall").pos[0], wall.body("wall").quat[:] = self.half, lean
        wall.geom("wall").size[1] = self.half
        for side, y in (("left", -0.6), ("right", 0.6)):
            prop = wall.geom(side)
            prop.size[2] = 0.2 * cos(self.tilt) + 0.02
            prop.pos[:] = (0.0, y * self.half, prop.size[2])
        wall.body("buttress").pos[0] = self.half + 0.12 + 0.4 * sin(self.tilt)
        wall.body("buttress").pos[2] = 0.0
        hit = self.half - self.radius * (1 - sin(self.tilt)) / cos(self.tilt)
        way = self.distance * self.launch / self.speed
        scene.start[thrown.name("free")] = free_pose((hit - way[0], -way[1] / 2, self.radius))
        scene.speed[thrown.name("free")] = (*self.launch, 0.0, 0.0, self.spin)
        scene.material("stage/floor", 2400.0, Surface(restitution=0.4))
        # the ball is smooth, so that the floor is: the wall alone brings the pair's friction
        rough = Surface(friction=2 * self.friction, restitution=self.wall_restitution)
        scene.material(wall.name("wall"), 1800.0, rough)
        scene.material(wall.name("buttress"), 2400.0, rough)
        for other in ("stage/floor", wall.name("wall"), rails.name("rails")):
            scene.touch(thrown.name("ball"), other)
        # a blow that throws back slower than gravity pulls in a step counts as inelastic
        back = self.pair_restitution * -float(self.launch @ self.normal)
        scene.resolve(
            time=min(0.1, 32 * back / scene.gravity), length=self.radius,
            duration=min(self.distance / self.speed + 2.5, 10.0),
        )  # fmt: skip

    def blow(self) -> Blow:
        """The impact by closed formulas: a solid sphere, Newton's e along the normal, Coulomb's μ along the wall."""
        n, e, k = self.normal, self.pair_restitution, 3.5
        v, w = self.launch, np.array([0.0, 0.0, self.spin])
        arm = -self.radius * n
        normal = float(v @ n)
        slip = v - normal * n + np.cross(w, arm)
        size = float(np.linalg.norm(slip))
        limit = self.friction * (1 + e) * abs(normal) * k
        change = min(limit, size)
        kick = -change / k * slip / size if size > 0 else np.zeros(3)
        loss = 0.5 * (1 - e**2) * normal**2 + 0.5 / k * (size**2 - (size - change) ** 2)
        after = v - (1 + e) * normal * n + kick
        return Blow(after, w + np.cross(arm, kick) / (0.4 * self.radius**2), loss, limit < size)

    def isolated(self) -> Blow:
        """The blow, if the wall alone gives it; NotEvaluated if it presses the ball onto the floor."""
        blow = self.blow()
        if blow.velocity[2] < -1e-12:
            raise NotEvaluated("the wall presses the ball onto the floor, which strikes back")
        return blow

    def back_after(self) -> float:
        """Time until the ball, thrown up by the blow, meets the floor or the wall again [s]."""
        leaves, fall = self.blow().velocity, 0.5 * g
        times = [leaves[2] / fall, *([float(leaves @ self.normal) / (fall * self.normal[2])] if self.tilt > 0 else [])]
        return min((when for when in times if when > 1e-12), default=inf)

    @staticmethod
    def hits(run: Run) -> list[Impact]:
        """Impacts of ball and wall; NotEvaluated if there is none."""
        found = [i for i in run.impacts if {i.first, i.second} == {"ball/ball", "wall/wall"}]
        if not found:
            raise NotEvaluated("the ball has not reached the wall")
        return found

    def sides(self, run: Run) -> tuple[Array, Array, Array, Array]:
        """Velocity before and after the first hit, spin before and after, each (3,).

        NotEvaluated if another impact follows too soon, be it too slow for a record of impacts.
        """
        when, soon = self.hits(run)[0].time, run.specimen.back_after()
        if soon < IMPACT_WINDOW:
            raise NotEvaluated(f"the ball meets floor or wall again after {soon:.2g} s; needed: {IMPACT_WINDOW} s")
        return (*around(run, "ball/ball", when), *around(run, "ball/ball", when, spin=True))

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the ball's centre, (T, 3)."""
        return run.velocity("ball/ball")

    @observable("rad/s")
    def turning(self, run: Run) -> Array:
        """Angular velocity of the ball, (T, 3)."""
        return run.spin("ball/ball")

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic energy of the ball, spin included, (T,)."""
        return run.kinetic("ball/ball")

    @law("vₙ′ = -e vₙ, e = (e₁ + e₂)/2", source="Newton, Principia, Axioms, corollary 6, scholium",
         within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def bounces_with_restitution(self, run: Run) -> Measurement:
        """1a: normal speed after the hit over normal speed before it."""
        before, after, _, _ = self.sides(run)
        return -(after @ self.normal) / (before @ self.normal), self.pair_restitution

    @law("Δu = -min(μ (1+e) |vₙ| 7/2, |u|) û", source="Routh, Dynamics of a System of Rigid Bodies I, §§186-187",
         within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def friction_turns_the_ball(self, run: Run) -> Measurement:
        """1b: velocity and rim speed after the hit, whether it grips or slides."""
        blow = self.isolated()
        _, after, _, spin = self.sides(run)
        return [*after, *(self.radius * spin)], [*blow.velocity, *(self.radius * blow.spin)]

    @law("v_t′ = v_t - μ (1+e) |vₙ| û", source="Routh, Dynamics of a System of Rigid Bodies I, §187",
         within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def a_grazing_ball_slides(self, run: Run) -> Measurement:
        """1b: speed along the wall after a hit at 75° with μ = 0.3 at most (a twin without spin)."""
        twin = run.again(incidence=1.309, spin=0.0, friction=min(max(self.friction, 0.05), 0.3), tilt=0.0)
        there = twin.specimen
        if not there.blow().slides:
            raise NotEvaluated("the ball grips")
        _, after, _, _ = self.sides(twin)
        mu, e = min(max(self.friction, 0.05), 0.3), self.pair_restitution
        along = self.speed * (sin(1.309) - mu * (1 + e) * cos(1.309))
        return [after[0], after[1]], [-e * self.speed * cos(1.309), along]

    @law("v_t′ = 5/7 v_t", source="Routh, Dynamics of a System of Rigid Bodies I, §186; Garwin, Am. J. Phys. 37, 88",
         within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def a_gripping_ball_rolls_off(self, run: Run) -> Measurement:
        """1b: speed along the wall and spin after a hit at 30° with μ = 0.9 (a twin without spin)."""
        twin = run.again(incidence=0.5236, spin=0.0, friction=0.9, tilt=0.0)
        _, after, _, spin = self.sides(twin)
        along = 5 / 7 * self.speed * sin(0.5236)
        return [after[1], self.radius * spin[2]], [along, -along]

    @law("ΔE = -½ m (1-e²) vₙ² - friction's work", source="Routh, Dynamics of a System of Rigid Bodies I, §187; "
         "Stronge, Impact Mechanics, §3.3", within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def energy_is_lost_as_the_surfaces_say(self, run: Run) -> Measurement:
        """1c: kinetic energy that the hit takes, over what there was."""
        blow = self.isolated()
        v, v_, w, w_ = self.sides(run)
        k = 0.4 * self.radius**2
        had = 0.5 * (self.speed**2 + k * self.spin**2)
        return 0.5 * (v @ v + k * w @ w - v_ @ v_ - k * w_ @ w_) / had, blow.loss / had

    @law("Δx = 0", source="by definition: what is fixed does not move", unit="m", within=(1e-6, 1e-6, 1e-6))
    def the_wall_stays(self, run: Run) -> Measurement:
        """1d: displacement of the wall, and the ball's surface from where its face was built, at every hit."""
        places = run.position("wall/wall")
        gaps = [float(np.abs(places - places[0]).max())]
        others = np.array([-1.0, *(i.time for i in run.impacts)])
        for hit in self.hits(run):
            since = others[others < hit.time - 1e-9].max()
            mask = (run.t > max(since, hit.time - 0.05)) & (run.t < hit.time)
            if mask.sum() < 4 or abs(np.dot(hit.normal, self.normal)) < 0.9999:
                continue  # too soon after another impact, or on the wall's edge
            path = fit(run.t[mask], run.position("ball/ball")[mask], 2)
            s = hit.time - run.t[mask][0]
            centre = path[0] + path[1] * s + path[2] * s**2
            gaps.append(float((centre - [self.half, 0.0, 0.0]) @ self.normal) - self.radius)
        between(run.t, -1.0, self.hits(run)[0].time)
        return gaps, np.zeros(len(gaps))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        blow = self.blow()
        leaves = np.degrees(abs(atan2(blow.velocity[1], -blow.velocity[0])))
        return (
            f"A ball of {self.radius * 200:.0f} cm diameter crosses a smooth floor at {self.speed:.1f} m/s, turning at "
            f"{abs(self.spin):.0f} rad/s, and strikes a fixed wall at {np.degrees(self.incidence):.0f} degrees from "
            f"its normal after {self.hits(run)[0].time:.2f} s. The wall does not move. It throws the ball back with "
            f"{self.pair_restitution:.0%} of its normal speed; friction {'brakes' if blow.slides else 'stops'} the "
            f"sliding of its surface, so that it leaves at {leaves:.0f} degrees, turning at "
            f"{abs(blow.spin[2]):.0f} rad/s."
        )
