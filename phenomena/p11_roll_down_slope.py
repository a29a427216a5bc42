"""11: a solid ball, a solid cylinder, a hollow ball and a hoop race down a plank."""

from __future__ import annotations

from math import cos, sin, sqrt, tan
from typing import Annotated, cast

import numpy as np
from numpy.typing import NDArray

from phenomena.slope import BETA, RACERS, padded_stop, place, plank
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, crossings, fit, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

RESTITUTION = 0.2
"""Of every pair: what little the racers bounce at the foot of the plank and at the stop."""


class RollDownSlope(Phenomenon, domain="mechanics"):
    """Objects roll down a straight slope: the less inertia they turn, the sooner they arrive."""

    angle: Annotated[float, Param("rad", 0.0524, 0.7854, "slope of the plank")] = 0.2618
    length: Annotated[float, Param("m", 0.5, 3.0, "way down the plank")] = 2.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "coefficient between racers and plank")] = 0.5
    radius: Annotated[float, Param("m", 0.01, 0.08, "of all racers")] = 0.07
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "of all racers' material")] = 700.0

    def build(self, scene: Scene) -> None:
        """A plank on legs with four lanes, four racers at its top, a padded stop on the floor."""
        plank(scene, self.angle, self.length + 3 * self.radius, self.length, self.radius)
        padded_stop(scene, self.radius)
        surface = Surface(friction=self.friction, restitution=RESTITUTION)
        for ground in ("ramp/slope", "stage/floor", "pad/foam"):
            scene.material(ground, 700.0, surface)
        scene.material("ramp/ramp", 700.0, surface)
        scene.material("pad/pad", 50.0, surface)
        for lane, racer in enumerate(RACERS):
            place(scene, lane, self.radius, self.density, self.start())
            scene.material(racer.contact, self.density, surface)
            scene.material(racer.body, self.density, surface)
            for ground in ("ramp/slope", "stage/floor", "pad/foam"):
                scene.touch(racer.contact, ground)
        last = sqrt(2 * self.length / self.accelerations().min())
        scene.resolve(time=0.2, length=self.radius, duration=min(10.0, max(2.0, last + 1.5)))

    def start(self) -> Array:
        """Of a racer's centre (3,) [m], without its lane."""
        along, normal = self.axes()
        return np.asarray(self.radius * normal - self.length * along)

    def axes(self) -> tuple[Array, Array]:
        """Unit vectors down the slope and out of it (3,)."""
        return np.array([cos(self.angle), 0, -sin(self.angle)]), np.array([sin(self.angle), 0, cos(self.angle)])

    def grips(self) -> NDArray[np.bool_]:
        """Which of the racers roll without slipping (4,)."""
        return np.asarray(tan(self.angle) <= self.friction * (1 + 1 / BETA))

    def accelerations(self) -> Array:
        """Of the four centres down the slope [m/s²]: rolling or slipping, as friction allows."""
        rolling = g * sin(self.angle) / (1 + BETA)
        slipping = g * (sin(self.angle) - self.friction * cos(self.angle))
        return np.where(self.grips(), rolling, slipping)

    def way(self, run: Run) -> Array:
        """Rolled down the slope by each racer since the start (4, T) [m]."""
        along, _ = self.axes()
        return np.array([(run.position(racer.body) - run.position(racer.body)[0]) @ along for racer in RACERS])

    def pace(self, run: Run) -> Array:
        """Speed of each centre down the slope (4, T) [m/s]."""
        return np.array([run.velocity(racer.body) @ self.axes()[0] for racer in RACERS])

    def tread_pace(self, run: Run) -> Array:
        """ω r of each racer (4, T) [m/s]: its pace, if it rolls without slipping."""
        return np.array([self.radius * run.spin(racer.body)[:, 1] for racer in RACERS])

    def last_way(self) -> float:
        """Rolled when the floor is met at the foot of the plank, less a twentieth [m]."""
        return 0.95 * (self.length - self.radius * tan(self.angle / 2))

    @observable("m")
    def distances(self, run: Run) -> Array:
        """Rolled down the slope since the start, one column per racer (T, 4)."""
        return self.way(run).T

    @observable("m/s")
    def speeds(self, run: Run) -> Array:
        """Of the centres down the slope (T, 4)."""
        return self.pace(run).T

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """v - ω r, with which the treads slide over the plank (T, 4)."""
        return (self.pace(run) - self.tread_pace(run)).T

    def on_the_plank(self, run: Run) -> list[NDArray[np.bool_]]:
        """Of each racer, the samples (T,) after the start and before the foot of the plank."""
        ends = [run.t[int(np.argmax(way > self.last_way()))] or run.t[-1] for way in self.way(run)]
        return [between(run.t, 0.0, end) for end in ends]

    def rolling(self, run: Run) -> Run:
        """The run, or a twin with friction enough for all to roll."""
        return run if self.grips().all() else run.again(friction=0.9)

    @law("a = g sin α/(1 + β) if tan α ≤ μ (1 + 1/β), else g (sin α - μ cos α)", within=(1e-10, 1e-11, 1e-11),
         source="Goldstein, Classical Mechanics, 3rd ed., §2.4; Coulomb's law")  # fmt: skip
    def each_shape_accelerates_by_its_own_rule(self, run: Run) -> Measurement:
        """11a, 11b: the four accelerations down the slope, gripping or not."""
        windows = self.on_the_plank(run)
        return [acceleration(run.t[w], x[w]) for w, x in zip(windows, self.way(run), strict=True)], self.accelerations()

    @law("v = ω r", source="Goldstein, Classical Mechanics, 3rd ed., §1.3", within=(1e-10, 1e-11, 1e-11))
    def rolling_does_not_slip(self, run: Run) -> Measurement:
        """11a: at every moment on the plank (a twin with more friction, if this one slips)."""
        twin = self.rolling(run)
        windows = self.on_the_plank(twin)
        pairs = zip(windows, self.tread_pace(twin), self.pace(twin), strict=True)
        turned, moved = zip(*((x[w], v[w]) for w, x, v in pairs), strict=True)
        return np.concatenate(turned), np.concatenate(moved)

    @law(
        "a = g (sin α - μ cos α), ω̇ r = μ g cos α/β",
        source="Coulomb's law; Landau & Lifshitz, Mechanics, §34 eq. 34.3",
        within=(1e-10, 1e-11, 1e-11),
    )
    def slipping_spins_up_slowly(self, run: Run) -> Measurement:
        """11b: on this run if all slip, or on a twin with half the friction that the ball needs to roll."""
        slides = run if not self.grips().any() else run.again(friction=0.5 * tan(self.angle) / (1 + 1 / BETA.min()))
        friction = self.friction if slides is run else 0.5 * tan(self.angle) / (1 + 1 / BETA.min())
        windows = self.on_the_plank(slides)
        moved = [acceleration(slides.t[w], x[w]) for w, x in zip(windows, self.way(slides), strict=True)]
        turned = [float(fit(slides.t[w], x[w], 1)[1]) for w, x in zip(windows, self.tread_pace(slides), strict=True)]
        spun = friction * g * cos(self.angle) / BETA
        return [*moved, *turned], [*[g * (sin(self.angle) - friction * cos(self.angle))] * 4, *spun]

    @law(
        "t = √(2 s (1 + β)/(g sin α))",
        source="Galilei, Discorsi, third day, theorem 2; Goldstein §2.4",
        within=(1e-10, 1e-11, 1e-11),
    )
    def balls_arrive_first_and_hoops_last(self, run: Run) -> Measurement:
        """11c: times at which the four pass a mark, here and for racers of other size and density."""
        grown = 0.05 if self.radius < 0.03 else self.radius / 2
        first = self.rolling(run)
        other = first.again(radius=grown, density=3000.0 if self.density < 1500 else 500.0)
        mark = 0.9 * (self.length - max(self.radius, grown) * tan(self.angle / 2))
        times = []
        for r in (first, other):
            for way, pace in zip(self.way(r), self.pace(r), strict=True):
                passed = crossings(r.t, way, pace, mark)
                if not len(passed):
                    raise NotEvaluated(f"a racer did not come {mark:.3g} m far in {r.t[-1]:.3g} s")
                times.append(passed[0])
        expected = np.sqrt(2 * mark * (1 + BETA) / (g * sin(self.angle)))
        return np.array(times) / np.tile(expected, 2), np.ones(8)

    @law("½ (1 + β) v² = g h", source="Landau & Lifshitz, Mechanics, §32 eq. 32.1", within=(1e-10, 1e-11, 1e-11))
    def height_becomes_motion(self, run: Run) -> Measurement:
        """11d: v² at the bottom against 2 g h/(1 + β), h being the height come down."""
        twin = self.rolling(run)
        last = [int(np.nonzero(w)[0][-1]) for w in self.on_the_plank(twin)]
        fallen = [twin.position(r.body)[0, 2] - twin.position(r.body)[i, 2] for r, i in zip(RACERS, last, strict=True)]
        speed = [np.linalg.norm(twin.velocity(r.body)[i]) for r, i in zip(RACERS, last, strict=True)]
        return np.square(speed) * (1 + BETA), 2 * g * np.array(fallen)

    @law("tan α = μ (1 + 1/β)", source="Goldstein §2.4 with Coulomb's law: F = m g sin α β/(1 + β) ≤ μ m g cos α",
         within=(1e-3, 1e-3, 1e-3), limited_by="a bracket: it rolls at +0.02 %, slips at -0.02 %")  # fmt: skip
    def friction_needed_to_roll(self, run: Run) -> Measurement:
        """11e: the least coefficient with which the ball rolls (3.5 μ = tan α), and the hoop (2 μ = tan α)."""
        found, needed = [], []
        for i in (0, 3):
            critical = tan(self.angle) / (1 + 1 / BETA[i])

            def rolls(friction: float, i: int = i) -> bool:
                twin = run.again(friction=friction, length=0.5)
                same = cast(RollDownSlope, twin.specimen)
                w = same.on_the_plank(twin)[i]
                moved, turned = same.pace(twin)[i][w], same.tread_pace(twin)[i][w]
                return bool(np.abs(moved - turned).max() < 1e-6 * moved.max())

            found.append(threshold(rolls, critical, spread=2e-4, resolution=5e-4))
            needed.append(critical)
        return found, needed

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        foot = [
            crossings(run.t, way, pace, self.last_way())
            for way, pace in zip(self.way(run), self.pace(run), strict=True)
        ]
        first, last = (f"{foot[i][0]:.2f} s" if len(foot[i]) else "longer than this scene" for i in (0, 3))
        grip = self.grips()
        if grip.all():
            manner = "roll without slipping: what each keeps for turning it lacks in speed"
        elif grip.any():
            manner = "start to roll, but those hardest to turn slip"
        else:
            manner = "slip, for friction is too weak to turn them as fast as they move"
        return (
            f"A solid ball, a solid cylinder, a hollow ball and a hoop, all {100 * self.radius:.1f} cm in radius, are "
            f"let go side by side on a plank sloping {np.degrees(self.angle):.0f} degrees. Pulled down by gravity they "
            f"{manner}. The ball takes {first} to the foot, the hoop {last}. "
            "They run out over the floor into a padded stop."
        )
