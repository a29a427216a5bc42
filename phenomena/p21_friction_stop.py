"""Bricks and a ball on coarse ground: Coulomb's friction, from the first slip to the last."""

from __future__ import annotations

from math import atan, cos, inf, pi, sin
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, fit, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Part, Scene, free_pose

BRICK: Final = (0.10, 0.06, 0.04)
"""Half sizes of a brick lying flat [m]."""

STANCES: Final = {"flat": (0, 1, 2), "edge": (0, 2, 1), "end": (2, 1, 0)}
"""Which of a brick's sizes point forwards, sideways and up."""

LONGEST: Final = 3.5
PLANK: Final = 1.0
MARGIN: Final = 1e-4
"""A plank this much flatter than the angle of repose must hold, this much steeper let go (of the angle)."""


class FrictionStop(Phenomenon, domain="mechanics"):
    """Objects on coarse ground: friction slows them evenly, stops the bricks and sets the ball rolling."""

    speed: Annotated[float, Param("m/s", 0.5, 4.0, "of both bricks and the ball at the start")] = 2.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "of the bricks' and the ball's material")] = 0.5
    rough: Annotated[float, Param("1", 0.0, 0.9, "of the rough strip and the plank")] = 0.7
    smooth: Annotated[float, Param("1", 0.0, 0.9, "of the other strip")] = 0.1
    stance: Annotated[Literal["flat", "edge", "end"], Choice("the face on which the bricks stand")] = "flat"
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "bricks and ball")] = 1900.0
    radius: Annotated[float, Param("m", 0.03, 0.09, "ball")] = 0.07
    tilt: Annotated[float, Param("rad", 0.05, 0.8, "of the plank, with a brick at rest on it")] = 0.4

    @property
    def half(self) -> tuple[float, ...]:
        """Half sizes of a brick as it stands (forwards, sideways, up) [m]."""
        return tuple(BRICK[i] for i in STANCES[self.stance])

    @property
    def pairs(self) -> dict[str, float]:
        """Friction between each sliding body and its strip: the mean of the two."""
        on_rough = (self.friction + self.rough) / 2
        return {"first/block": on_rough, "second/block": (self.friction + self.smooth) / 2, "ball/ball": on_rough}

    def distance(self, body: str) -> float:
        """Where a brick must stop [m]; infinite without friction."""
        mu = self.pairs[body]
        return self.speed**2 / (2 * mu * g) if mu > 0 else inf

    @property
    def lane(self) -> float:
        """Free length of the strips [m]."""
        furthest = max(self.distance("first/block"), self.distance("second/block"))
        return min(max(furthest + 0.3, 1.2), LONGEST)

    def brick(self, scene: Scene, name: str, colour: tuple[float, float, float]) -> Part:
        """A brick as it stands."""
        part = scene.add("block", name)
        geom = part.geom("block")
        geom.size[:] = self.half
        geom.mass, geom.rgba = self.density * 8 * BRICK[0] * BRICK[1] * BRICK[2], (*colour, 1.0)
        scene.material(part.name("block"), self.density, Surface(friction=self.friction, restitution=0.1))
        return part

    def build(self, scene: Scene) -> None:
        """Two strips for the bricks, one for the ball, and beside them a plank with a brick on it."""
        lanes = (("first", self.rough, 0.75), ("second", self.smooth, 0.25), ("third", self.rough, -0.25))
        for name, mu, y in lanes:
            strip = scene.add("strip", f"{name}_strip")
            strip.body("strip").pos[:2] = (-self.lane / 2, y)
            surface = strip.geom("surface")
            surface.pos[0], surface.size[0] = self.lane / 2 - 0.1, self.lane / 2 + 0.1
            surface.rgba = (0.60 - 0.25 * mu, 0.64 - 0.35 * mu, 0.68 - 0.50 * mu, 1.0)
            strip.geom("stop").pos[0] = self.lane + 0.03
            scene.material(strip.name("strip"), 1500.0, Surface(friction=mu, restitution=0.1))
        start = -self.lane / 2
        for name, y, colour in (("first", 0.75, (0.84, 0.27, 0.22)), ("second", 0.25, (0.94, 0.76, 0.28))):
            part = self.brick(scene, name, colour)
            scene.start[part.name("free")] = free_pose((start, y, 0.001 + self.half[2]))
            scene.speed[part.name("free")] = (self.speed, 0, 0, 0, 0, 0)
            scene.touch(part.name("block"), f"{name}_strip/strip")
        ball = scene.add("ball")
        geom = ball.geom("ball")
        geom.size[0], geom.mass = self.radius, self.density * 4 / 3 * pi * self.radius**3
        scene.start[ball.name("free")] = free_pose((start, -0.25, 0.001 + self.radius))
        scene.speed[ball.name("free")] = (self.speed, 0, 0, 0, 0, 0)
        scene.material(ball.name("ball"), self.density, Surface(friction=self.friction, restitution=0.1))
        scene.touch(ball.name("ball"), "third_strip/strip")
        self.lay_plank(scene)
        slowest = max(max(self.pairs.values()), 0.1)
        scene.resolve(time=min(max(self.speed / (4 * slowest * g), 0.035), 0.2), length=BRICK[2], duration=5.0)

    def lay_plank(self, scene: Scene) -> None:
        """The plank on its post, and a brick at rest on it."""
        plank = scene.add("plank")
        foot, y = -PLANK / 2, -0.8
        up = np.array([cos(self.tilt), 0.0, sin(self.tilt)])
        lean = (cos(self.tilt / 2), 0.0, -sin(self.tilt / 2), 0.0)
        plank.body("plank").pos[:2] = (foot, y)
        plank.body("plank").quat[:] = lean
        top = 0.03 + 0.9 * PLANK * sin(self.tilt) - 0.04 / cos(self.tilt)
        plank.body("post").pos[:] = (foot + 0.9 * PLANK * cos(self.tilt), y, top / 2)
        plank.geom("post").size[2] = top / 2
        plank.geom("surface").rgba = (0.60 - 0.25 * self.rough, 0.64 - 0.35 * self.rough, 0.68 - 0.50 * self.rough, 1.0)
        scene.material(plank.name("plank"), 1500.0, Surface(friction=self.rough, restitution=0.1))
        scene.material(plank.name("post"), 600.0, Surface(friction=0.4, restitution=0.4))
        part = self.brick(scene, "resting", (0.17, 0.58, 0.62))
        normal = np.array([-sin(self.tilt), 0.0, cos(self.tilt)])
        place = np.array([foot, y, 0.03]) + 0.7 * PLANK * up + self.half[2] * normal
        scene.start[part.name("free")] = free_pose(place, lean)
        scene.touch(part.name("block"), plank.name("plank"))

    def slid(self, run: Run, body: str) -> NDArray[np.float64]:
        """Way from the start along the strip (T,) [m]."""
        return np.asarray(run.position(body)[:, 0] - run.position(body)[0, 0])

    @observable("m")
    def ways(self, run: Run) -> NDArray[np.float64]:
        """Ways of the first and second brick, the ball and the resting brick from where they started, (T, 4)."""
        rest = run.position("resting/block")
        return np.column_stack([*(self.slid(run, body) for body in self.pairs), np.linalg.norm(rest - rest[0], axis=1)])

    @observable("m/s")
    def speeds(self, run: Run) -> NDArray[np.float64]:
        """Forward velocities of the first and second brick and the ball, (T, 3)."""
        return np.column_stack([run.velocity(body)[:, 0] for body in self.pairs])

    def sliders(self) -> list[str]:
        """Bricks that stop by friction alone; NotEvaluated if there is none."""
        topple = self.half[0] / self.half[2]
        bodies = ["first/block", "second/block"]
        found = [b for b in bodies if 0 < self.pairs[b] < topple and self.distance(b) + self.half[0] < self.lane]
        if not found:
            raise NotEvaluated("both bricks topple or reach the end of their strips")
        return found

    @law("d = v²/(2 μ g)", source="Coulomb, Théorie des machines simples (1785); Feynman, Lectures I, §12-2",
         within=(1e-4, 2e-6, 2e-7))  # fmt: skip
    def bricks_stop_where_friction_says(self, run: Run) -> Measurement:
        """21a: way of each brick until it rests."""
        bodies = self.sliders()
        return [self.slid(run, b)[-1] for b in bodies], [self.distance(b) for b in bodies]

    @law("v = v₀ - μ g t", source="Coulomb, Théorie des machines simples (1785); Feynman, Lectures I, §12-2",
         within=(1e-9, 1e-10, 1e-10))  # fmt: skip
    def speed_falls_evenly(self, run: Run) -> Measurement:
        """21a: speed of each brick until it rests: a straight line down to zero at t = v₀/(μ g), and no curve."""
        measured, expected = [], []
        for body in self.sliders():
            rate = self.pairs[body] * g
            mask = between(run.t, -1.0, self.speed / rate - run.step)
            measured.append(run.velocity(body)[mask, 0])
            expected.append(self.speed - rate * run.t[mask])
        return np.concatenate(measured) / self.speed, np.concatenate(expected) / self.speed

    @law("t = 2 v₀/(7 μ g), x = 12 v₀²/(49 μ g), v = 5 v₀/7", source="Coriolis, Jeu de billard (1835), ch. I; "
         "Landau & Lifshitz, Mechanics, §38", within=(1e-4, 1e-5, 1e-6))  # fmt: skip
    def ball_slides_until_it_rolls(self, run: Run) -> Measurement:
        """21b: when and where slipping ends, and how fast it then rolls."""
        mu = self.pairs["ball/ball"]
        if mu == 0:
            raise NotEvaluated("without friction the ball never rolls")
        when, where, fast = 2 * self.speed / (7 * mu * g), 12 * self.speed**2 / (49 * mu * g), 5 * self.speed / 7
        end = when + (self.lane - self.radius - where) / fast
        slides, rolls = between(run.t, -1.0, when, least=4), between(run.t, when + 0.02, end - 0.01, least=4)
        speed = run.velocity("ball/ball")[:, 0]
        slip, brake = fit(run.t[slides], (speed - run.spin("ball/ball")[:, 1] * self.radius)[slides], 1)
        path = fit(run.t[slides], self.slid(run, "ball/ball")[slides], 2)
        stopped = -slip / brake
        return (
            [stopped / when, (path[0] + path[1] * stopped + path[2] * stopped**2) / where, speed[rolls].mean() / fast],
            [1.0, 1.0, 1.0],
        )

    def repose(self) -> float:
        """Steepest tilt at which the brick on the plank holds [rad]; NotEvaluated if it topples or cannot be set."""
        low, high = (self.declarations()["tilt"][0].low, self.declarations()["tilt"][0].high)  # type: ignore[union-attr]
        mu = (self.friction + self.rough) / 2
        if mu >= self.half[0] / self.half[2]:
            raise NotEvaluated("the brick topples before it slips")
        if not low * 1.01 < atan(mu) < high * 0.99:
            raise NotEvaluated(f"angle of repose {atan(mu):.3g} rad: the plank tilts from {low:g} to {high:g} rad")
        return atan(mu)

    @law("tan α = μ", source="Coulomb, Théorie des machines simples (1785); Euler, Mém. Acad. Berlin 4 (1748) 122",
         within=(1e-3, 1e-3, 1e-3), limited_by="the width of the bracket")  # fmt: skip
    def plank_lets_go_at_the_angle_of_repose(self, run: Run) -> Measurement:
        """21c: the brick holds on a plank a little flatter and goes on one a little steeper."""
        angle = self.repose()

        def goes(tilt: float) -> bool:
            place = run.again(tilt=tilt).position("resting/block")
            return bool(np.linalg.norm(place[-1] - place[0]) > 2e-4)

        return threshold(goes, angle, spread=MARGIN, resolution=2 * MARGIN), angle

    @law("x = 0 for tan α < μ", source="Coulomb, Théorie des machines simples (1785)", unit="m",
         within=(1e-8, 1e-8, 1e-8))  # fmt: skip
    def held_brick_does_not_creep(self, run: Run) -> Measurement:
        """21c: motion in 5 s on a plank at 0.9999 of the angle of repose."""
        place = run.again(tilt=self.repose() * (1 - MARGIN)).position("resting/block")
        return np.linalg.norm(place - place[0], axis=1).max(), 0.0

    @law("d(m, A) = v²/(2 μ g)", source="Amontons, Mém. Acad. R. Sci. (1699) 206", within=(1e-4, 2e-6, 2e-7))
    def weight_and_face_do_not_matter(self, run: Run) -> Measurement:
        """21d: ways of bricks four times as heavy (or light), and on another face."""
        heavy = self.density * 4 if self.density < 5000.0 else self.density / 4
        twins = [run.again(density=heavy), run.again(stance="edge" if self.stance != "edge" else "flat")]
        bodies = [b for b in self.sliders() if self.distance(b) + max(BRICK) < self.lane and self.pairs[b] < 1]
        if not bodies:
            raise NotEvaluated("the strips are too short")
        return [[self.slid(twin, b)[-1] for b in bodies] for twin in twins], [[self.distance(b) for b in bodies]] * 2

    @law("z = const", source="Coulomb, Théorie des machines simples (1785): friction has no normal part", unit="m",
         within=(1e-8, 1e-8, 1e-8))  # fmt: skip
    def nothing_hops(self, run: Run) -> Measurement:
        """21e: heights of the sliding bricks and the ball above their strips, until a stop is met."""
        first = min([i.time for i in run.impacts], default=inf)
        mask = run.t < first
        heights = {"ball/ball": self.radius}
        heights |= {
            b: self.half[2] for b in ("first/block", "second/block") if self.pairs[b] < self.half[0] / self.half[2]
        }
        seen = np.array([run.position(b)[mask, 2] for b in heights])
        return seen - 0.001, np.array(list(heights.values()))[:, None] + np.zeros_like(seen)

    @law("μ = (μ₁ + μ₂)/2", source="by definition: the pair rule of contact.Surface",
         within=(1e-4, 2e-6, 2e-7))  # fmt: skip
    def both_surfaces_count_alike(self, run: Run) -> Measurement:
        """21f: friction from the stopping ways on both strips, and with brick and rough strip swapped."""
        bodies = self.sliders()
        swapped = run.again(friction=self.rough, rough=self.friction)
        ways = [self.slid(run, b)[-1] for b in bodies]
        means = [self.pairs[b] for b in bodies]
        if "first/block" in bodies and self.distance("first/block") + self.half[0] < swapped.specimen.lane:
            ways.append(self.slid(swapped, "first/block")[-1])
            means.append(self.pairs["first/block"])
        return self.speed**2 / (2 * g * np.array(ways)), means

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        stops = [self.slid(run, b)[-1] for b in ("first/block", "second/block")]
        held = float(np.linalg.norm(run.position("resting/block")[-1] - run.position("resting/block")[0])) < 1e-3
        return (
            f"A red and a yellow brick and a ball are sent along coarse strips at {self.speed:.1f} m/s. Friction slows "
            f"them evenly, whatever their mass: the red brick stops after {stops[0]:.2f} m on the rougher strip, the "
            f"yellow one after {stops[1]:.2f} m, while the ball slips at first, then rolls on at five sevenths of its "
            f"speed. A third brick {'stays' if held else 'slides down'} on a plank tilted by "
            f"{np.degrees(self.tilt):.0f} degrees."
        )
