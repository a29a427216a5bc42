"""A rolling ball strikes a ball or a box at rest: velocities after a collision, and what the floor makes of them."""

from __future__ import annotations

from math import acos, asin, cos, pi, sin, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.parts import ball, court, sphere_mass
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import IMPACT_WINDOW, around, between, fit
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

CUE = "cue/ball"


class MovingHitsStationary(Phenomenon, domain="mechanics"):
    """Moving objects collide with stationary ones that can move: a ball strikes a ball or a box at rest."""

    speed: Annotated[float, Param("m/s", 0.5, 6.0, "of the rolling ball")] = 2.0
    offset: Annotated[float, Param("1", -0.9, 0.9, "impact parameter, over the largest that still hits the front")] = (
        0.4
    )
    target: Annotated[Literal["ball", "box"], Choice("what lies there")] = "ball"
    restitution: Annotated[float, Param("1", 0.1, 1.0, "of the rolling ball; the pair has the mean")] = 0.8
    target_restitution: Annotated[float, Param("1", 0.1, 1.0, "of what it strikes; the pair has the mean")] = 0.6
    floor_friction: Annotated[float, Param("1", 0.0, 0.3, "of floor and bodies together; the bodies are smooth")] = 0.2
    radius: Annotated[float, Param("m", 0.03, 0.1, "ball, and half the height of what it strikes")] = 0.1
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "rolling ball")] = 1700.0
    target_density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "what it strikes")] = 700.0

    @property
    def body(self) -> str:
        """What is struck, by its name in the scene."""
        return "target/ball" if self.target == "ball" else "target/block"

    @property
    def masses(self) -> tuple[float, float]:
        """Of the rolling ball and of what it strikes [kg]."""
        struck = sphere_mass(1.0, 1.0) if self.target == "ball" else 8.0
        return sphere_mass(self.radius, self.density), struck * self.target_density * self.radius**3

    @property
    def lever(self) -> float:
        """Distance of the rolling ball's way from the other's centre [m]."""
        return self.offset * self.radius * (2 if self.target == "ball" else 1)

    @property
    def line(self) -> Array:
        """Normal of the hit, from the rolling ball to the other body (3,)."""
        tilt = asin(self.offset) if self.target == "ball" else 0.0
        return np.array([cos(tilt), -sin(tilt), 0.0])

    @property
    def way(self) -> float:
        """Of the rolling ball until it hits [m]."""
        return min(max(0.35 * self.speed, 0.3), 1.5)

    @property
    def pair_restitution(self) -> float:
        """Of the two bodies: the mean."""
        return (self.restitution + self.target_restitution) / 2

    @property
    def outcome(self) -> tuple[Array, Array, float]:
        """Velocities after the hit (3,) of both, and the other's spin about the vertical, by closed formulas."""
        m1, m2 = self.masses
        arm = self.lever if self.target == "box" else 0.0
        inertia = 2 / 3 * m2 * self.radius**2  # of a cube
        closing = self.speed * self.line[0]
        push = (1 + self.pair_restitution) * closing / (1 / m1 + 1 / m2 + arm**2 / inertia)
        start = np.array([self.speed, 0.0, 0.0])
        return start - push / m1 * self.line, push / m2 * self.line, -push * arm / inertia

    def build(self, scene: Scene) -> None:
        """A court with rails, a ball rolling, and in its middle what it strikes."""
        half = self.way + 3 * self.radius + 0.1
        # the bodies are smooth, so that they do not rub on one another: the floor alone brings the friction
        scene.material("stage/floor", 2400.0, Surface(friction=2 * self.floor_friction, restitution=0.4))
        rails = court(scene, half, Surface(restitution=0.4))
        cue = ball(scene, "cue", self.radius, self.density, Surface(restitution=self.restitution), (0.93, 0.90, 0.84))
        reach = 2 * self.radius * (self.line[0] if self.target == "ball" else 1.0)
        scene.start[cue.name("free")] = free_pose((-reach - self.way, self.lever, self.radius))
        scene.speed[cue.name("free")] = (self.speed, 0.0, 0.0, 0.0, self.speed / self.radius, 0.0)
        surface = Surface(restitution=self.target_restitution)
        if self.target == "ball":
            struck = ball(scene, "target", self.radius, self.target_density, surface, (0.84, 0.27, 0.22))
        else:
            struck = scene.add("block", "target")
            geom = struck.geom("block")
            geom.size[:] = self.radius
            geom.mass = self.masses[1]
            scene.material(struck.name("block"), self.target_density, surface)
        scene.start[struck.name("free")] = free_pose((0.0, 0.0, self.radius))
        for other in ("stage/floor", rails.name("rails")):
            scene.touch(CUE, other)
            scene.touch(self.body, other)
        scene.touch(CUE, self.body)
        scene.resolve(time=0.1, length=self.radius, duration=max(3.0, self.way / self.speed + 2.0))

    def hit(self, run: Run) -> Impact:
        """The first impact; NotEvaluated if it is not that of the two bodies."""
        if not run.impacts or {run.impacts[0].first, run.impacts[0].second} != {CUE, self.body}:
            raise NotEvaluated("the rolling ball has not struck the other body")
        return run.impacts[0]

    def clear(self, run: Run) -> Run:
        """The run, or a twin on a smooth floor where this one bends velocities within the window of measurement."""
        if self.floor_friction == 0:
            return run
        u1, u2, turning = self.outcome
        slips = [float(np.linalg.norm(u1 - [self.speed, 0.0, 0.0])), float(np.linalg.norm(u2))]
        shortest = min(slips) * 2 / (7 * self.floor_friction * g)
        return run if shortest > 1.5 * IMPACT_WINDOW and turning == 0 else run.again(floor_friction=0.0)

    def sides(self, run: Run) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Velocities (before, after) the hit of both bodies."""
        when = self.hit(run).time
        return around(run, CUE, when), around(run, self.body, when)

    @observable("m/s")
    def rolling_velocity(self, run: Run) -> Array:
        """Of the rolling ball, (T, 3)."""
        return run.velocity(CUE)

    @observable("m/s")
    def struck_velocity(self, run: Run) -> Array:
        """Of what it strikes, (T, 3)."""
        return run.velocity(self.body)

    @observable("kg m/s")
    def momentum(self, run: Run) -> Array:
        """Of both, (T, 3)."""
        return run.momentum(CUE) + run.momentum(self.body)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic energy of both, (T,)."""
        return run.kinetic(CUE) + run.kinetic(self.body)

    @law("u₁ = v - m₂ (1+e) v·n n/(m₁+m₂), u₂ = m₁ (1+e) v·n n/(m₁+m₂)",
         source="Newton, Principia, Axioms, corollaries 3 and 6; Landau & Lifshitz, Mechanics, §17",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def velocities_after_the_hit(self, run: Run) -> Measurement:
        """2a: both velocity vectors after the hit of two balls (a twin, if a box is struck), over the speed before."""
        run = run if self.target == "ball" else run.again(target="ball")
        there = self.make(**(self.values() | {"target": "ball"}))
        seen = there.sides(there.clear(run))
        u1, u2, _ = there.outcome
        return [*seen[0][1] / self.speed, *seen[1][1] / self.speed], [*u1 / self.speed, *u2 / self.speed]

    @law("Σ m u = Σ m v", source="Newton, Principia, Axioms, corollary 3", within=(1e-8, 1e-9, 1e-10))
    def momentum_is_kept(self, run: Run) -> Measurement:
        """2b: vector sum before and after the hit, against that of the start."""
        one, two = self.sides(self.clear(run))
        m1, m2 = self.masses
        start = np.array([m1 * self.speed, 0.0, 0.0])
        return [m1 * a + m2 * b for a, b in zip(one, two, strict=True)], [start, start]

    @law("J = (1+e) v/(1/m₁ + 1/m₂ + b²/I₂), ω₂ = J b/I₂",
         source="Routh, Dynamics of a System of Rigid Bodies I, §§169-171",
         within=(3e-7, 3e-7, 3e-7), limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def a_box_struck_off_centre_turns(self, run: Run) -> Measurement:
        """2c: velocity and spin of a free box (a twin, if a ball is struck)."""
        offset = self.offset if abs(self.offset) > 0.2 else 0.5
        there = self.make(**(self.values() | {"target": "box", "offset": offset, "floor_friction": 0.0}))
        same = there == self
        twin = run if same else run.again(target="box", offset=offset, floor_friction=0.0)
        when = there.hit(twin).time
        _, spin = around(twin, there.body, when, spin=True)
        _, velocity = around(twin, there.body, when)
        _, u2, turning = there.outcome
        r = self.radius
        return [*velocity / self.speed, *r * spin / self.speed], [*u2 / self.speed, 0.0, 0.0, r * turning / self.speed]

    @law("cos ψ = u₁·u₂/(u₁ u₂); 90° for equal masses and e = 1",
         source="Landau & Lifshitz, Mechanics, §17 eq. 17.9",
         unit="rad", within=(1e-6, 1e-6, 1e-6),
         limited_by="the instant of an impact is located to a nanometre")  # fmt: skip
    def balls_part_at_the_right_angle(self, run: Run) -> Measurement:
        """2d: angle between the ways of the balls after an oblique hit, and between equal lossless ones (twins)."""
        offset = self.offset if abs(self.offset) > 0.2 else 0.5
        same = {"target": "ball", "offset": offset, "floor_friction": 0.0}
        equal = same | {"restitution": 1.0, "target_restitution": 1.0, "target_density": self.density}
        angles, expected = [], []
        for changes in (same, equal):
            there = self.make(**(self.values() | changes))
            (_, u1), (_, u2) = there.sides(run.again(**changes))
            w1, w2, _ = there.outcome
            angles.append(acos(u1 @ u2 / sqrt(u1 @ u1) / sqrt(u2 @ u2)))
            expected.append(acos(w1 @ w2 / sqrt(w1 @ w1) / sqrt(w2 @ w2)))
        return angles, [expected[0], pi / 2]

    @law("v̇ = -μ g, then v = 5/7 u₂ (a ball rolls) or v = 0 (a box rests)",
         source="Coriolis, Jeu de billard (1835), ch. I; Coulomb, Théorie des machines simples (1785)",
         within=(1e-6, 1e-7, 1e-8))  # fmt: skip
    def the_floor_brakes_what_was_struck(self, run: Run) -> Measurement:
        """2e: deceleration after a central hit over μ g, and speed in the end over that after the hit (a twin)."""
        mu = max(self.floor_friction, 0.1)
        m1, m2 = self.masses
        gain = (1 + self.pair_restitution) * m1 / (m1 + m2)
        speed = min(max(0.8 / gain, 0.5), 6.0)
        changes = {"offset": 0.0, "floor_friction": mu, "speed": speed}
        there = self.make(**(self.values() | changes))
        twin = run.again(**changes)
        when, u2 = there.hit(twin).time, gain * speed
        brakes = u2 / (mu * g) * (2 / 7 if self.target == "ball" else 1.0)
        others = min([i.time for i in twin.impacts[1:]], default=float(twin.t[-1]))
        pace = twin.velocity(self.body)[:, 0]
        slides = between(twin.t, when, min(when + brakes, others), least=4)
        rate = fit(twin.t[slides], pace[slides], 1)[1]
        after = (twin.t > when + brakes + twin.step) & (twin.t < others)
        if not after.any():  # it is struck again before that
            return -rate / (mu * g), 1.0
        return [-rate / (mu * g), pace[after][0] / u2], [1.0, 5 / 7 if self.target == "ball" else 0.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        m1, m2 = self.masses
        u1, u2, turning = self.outcome
        thing = "red ball" if self.target == "ball" else "wooden box"
        turned = f", turning at {abs(turning):.1f} rad/s," if turning else ""
        return (
            f"A white ball of {m1:.2g} kg rolls over the floor at {self.speed:.1f} m/s towards a {thing} of {m2:.2g} "
            f"kg at rest and strikes it after {self.hit(run).time:.2f} s{' off centre' if self.offset else ''}. The "
            f"push sends the {thing} off{turned} at {np.linalg.norm(u2):.1f} m/s, while the white ball keeps "
            f"{np.linalg.norm(u1):.1f} m/s: together they have the momentum there was. Friction and rails slow them."
        )
