"""26: a ball falls on an elastic rope, or two gliders are tied together by one: it pulls, and never pushes."""

from __future__ import annotations

from itertools import pairwise
from math import atan, pi, sqrt
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from phenomena.stands import DRY, gallows, hook
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import peaks
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]

RUBBER = 900.0
"""Density of the ball [kg/m³]."""

ASIDE = -0.046
"""Where the gliders' knobs are [m across]: the rope hangs beside the track, not through it."""

NEAREST = 0.075 + 0.06
"""Between the centres of gliders whose nose and back touch [m]."""

BUMP = 0.6
"""Restitution of nose and back."""

DEEPEST = 3.0
"""Greatest drop [m]: more does not fit into a hall."""

LONGEST = 6.0
"""Greatest length of the track [m]."""

TAUT = "the rope goes taut within a step: second order"

BALL, LEFT, RIGHT = "ball/ball", "left/glider", "right/glider"


class ElasticCouple(Phenomenon, domain="mechanics"):
    """Elastic rope connection: slack it does nothing, stretched it pulls back."""

    length: Annotated[float, Param("m", 0.3, 1.5, "of the rope at rest")] = 0.6
    stiffness: Annotated[float, Param("N/m", 10.0, 500.0, "of the rope")] = 40.0
    mass: Annotated[float, Param("kg", 0.1, 3.0, "of the ball, or of the glider that is launched")] = 0.8
    other: Annotated[float, Param("kg", 0.1, 3.0, "of the glider at rest")] = 0.6
    speed: Annotated[float, Param("m/s", 0.2, 1.5, "of the launched glider")] = 0.8
    start: Annotated[float, Param("1", 0.5, 0.95, "distance of the gliders at the start over the rope's length")] = 0.6
    tied: Annotated[Literal["hook", "glider"], Choice("a ball to a hook above, or a glider to a glider")] = "hook"

    @property
    def reduced_mass(self) -> float:
        """What the rope's stretching moves [kg]."""
        return self.mass if self.tied == "hook" else self.mass * self.other / (self.mass + self.other)

    @property
    def rate(self) -> float:
        """ω = √(k/m) on the stretched rope [rad/s]."""
        return sqrt(self.stiffness / self.reduced_mass)

    @property
    def arrival(self) -> float:
        """Speed with which the rope becomes taut [m/s]."""
        return sqrt(2 * g * self.length) if self.tied == "hook" else self.speed

    @property
    def stretch(self) -> float:
        """Greatest elongation of the rope [m]."""
        if self.tied == "glider":
            return self.speed / self.rate
        weight = self.mass * g
        return (weight + sqrt(weight**2 + 2 * self.stiffness * weight * self.length)) / self.stiffness

    @property
    def lowest(self) -> float:
        """When the ball is lowest, or the gliders farthest apart, for the first time [s]."""
        if self.tied == "glider":
            return self.length * (1 - self.apart) / self.speed + pi / 2 / self.rate
        return sqrt(2 * self.length / g) + (pi / 2 + atan(g / (self.rate * self.arrival))) / self.rate

    @property
    def apart(self) -> float:
        """Distance of the gliders at the start, over the rope's length; enough for them not to touch."""
        return max(self.start, 1.1 * NEAREST / self.length)

    @property
    def radius(self) -> float:
        """Of the ball [m]."""
        return float((3 * self.mass / (4 * pi * RUBBER)) ** (1 / 3))

    @property
    def duration(self) -> float:
        """Of the film [s]."""
        if self.tied == "hook":
            return float(np.clip(2.5 * 2 * self.lowest, 5.0, 10.0))
        back = pi / 2 / self.rate + (self.length - NEAREST) / self.speed
        return float(np.clip(self.lowest + back + 0.8, 2.0, 10.0))

    def build(self, scene: Scene) -> None:
        """A ball under a gallows or two gliders on an air track, and the rope."""
        first, second = {"hook": self.hang, "glider": self.lay}[self.tied](scene)
        rope = scene.spec.add_tendon(name="rope", width=0.005, rgba=(0.94, 0.55, 0.2, 1))
        rope.stiffness, rope.springlength = [self.stiffness, 0, 0], [0, self.length]
        rope.wrap_site(first)
        rope.wrap_site(second)
        scene.cord("rope", "hook/hook" if self.tied == "hook" else LEFT)
        scene.resolve(time=1.5 / self.rate, length=0.01, duration=self.duration)

    def hang(self, scene: Scene) -> tuple[str, str]:
        """The ball right below the hook, where it is let go; the two ends of the rope."""
        drop = self.length + self.stretch
        if drop > DEEPEST:
            raise Refusal("R12", f"{self.label}: the ball of {self.mass:.3g} kg drops by {drop:.3g} m; allowed: "
                          f"{DEEPEST} m, here a stiffness of {self.needed():.3g} N/m or more")  # fmt: skip
        height = drop + 2 * self.radius + 0.12
        gallows(scene, height + 0.045, self.radius + 0.25, foot=0.2 + 0.05 * height)
        top, ball = hook(scene, height), scene.add("ball")
        geom = ball.geom("ball")
        geom.size[0], geom.mass, geom.rgba = self.radius, self.mass, (0.84, 0.27, 0.22, 1)
        eye = ball.body("ball").add_site(name="ball/eye", pos=(0, 0, self.radius))
        scene.start[ball.name("free")] = free_pose((0, 0, height - self.radius))
        scene.material(ball.name("ball"), RUBBER, DRY)
        return top.name("hook"), eye.name

    def needed(self) -> float:
        """Least stiffness with which the ball does not drop too deep [N/m]: m g D = ½ k (D - L₀)²."""
        return 2 * self.mass * g * DEEPEST / (DEEPEST - self.length) ** 2

    def lay(self, scene: Scene) -> tuple[str, str]:
        """Two gliders, the right one about to leave; the two ends of the rope."""
        drift = self.speed * self.mass / (self.mass + self.other) * self.duration
        end = drift + max(self.length + self.stretch, self.apart * self.length) + 0.3
        if end > LONGEST:
            raise Refusal("R12", f"{self.label}: the gliders need a track of {end:.3g} m at {self.speed:.3g} m/s; "
                          f"allowed: {LONGEST} m, here at {self.speed * (LONGEST - 1.8) / end:.3g} m/s")  # fmt: skip
        lift = max(self.length / 2 - 0.08, 0.0)
        left, right = scene.add("glider", "left"), scene.add("glider", "right")
        scene.spec.delete(right.body("track"))
        beam = left.geom("beam")
        beam.pos[0], beam.size[0], beam.pos[2] = (end - 0.15) / 2, (end + 0.15) / 2, 0.0925 + lift
        for foot, x in (("left_foot", -0.1), ("right_foot", end - 0.05)):
            part = left.geom(foot)
            part.pos[0], part.pos[2], part.size[2] = x, (0.08 + lift) / 2, (0.08 + lift) / 2
        scene.material(left.name("track"), 2700.0, DRY)
        ends = [self.glider(scene, left, self.other, 0.0, lift)]
        ends.append(self.glider(scene, right, self.mass, self.apart * self.length, lift))
        right.geom("block").rgba = (0.17, 0.58, 0.62, 1)
        scene.speed[right.name("glider")] = self.speed
        scene.touch("right/nose", "left/block")
        return ends[0], ends[1]

    def glider(self, scene: Scene, part: Part, mass: float, x: float, lift: float) -> str:
        """One glider with a knob at its side; the name of the site there."""
        body = part.body("glider")
        body.pos = (x, 0, 0.15 + lift)
        part.geom("block").mass = mass
        body.add_geom(
            name=part.name("knob"), type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.01, 0, 0), pos=(0, ASIDE, 0), mass=0,
            contype=0, conaffinity=0, rgba=(0.93, 0.9, 0.84, 1),
        )  # fmt: skip
        surface = Surface(friction=0.4, restitution=BUMP)
        for name in ("glider", "nose", "block"):
            scene.material(part.name(name), mass / (8 * 0.06 * 0.034 * 0.04), surface)
        return str(body.add_site(name=part.name("eye"), pos=(0, ASIDE, 0)).name)

    @observable("m")
    def distance(self, run: Run) -> Array:
        """Between the ends of the rope."""
        if self.tied == "glider":
            return np.asarray(run.position(RIGHT)[:, 0] - run.position(LEFT)[:, 0])
        eye = run.position(BALL) + quaternion_matrix(run.quaternion(BALL)) @ np.array([0, 0, self.radius])
        return np.asarray(np.linalg.norm(eye - run.motion.origin[:, run.model.body("hook/hook").id], axis=1))

    @observable("m/s")
    def parting(self, run: Run) -> Array:
        """Speed with which the ends move apart."""
        return -run.velocity(BALL)[:, 2] if self.tied == "hook" else self.pace(run, RIGHT) - self.pace(run, LEFT)

    @observable("1")
    def taut(self, run: Run) -> Array:
        """1 while the rope is stretched, 0 while it is slack."""
        return np.asarray(self.distance(run) > self.length, float)

    @observable("N")
    def tension(self, run: Run) -> Array:
        """Of the rope: stiffness times stretch, if it is stretched."""
        return np.asarray(self.stiffness * np.maximum(self.distance(run) - self.length, 0.0))

    @staticmethod
    def pace(run: Run, body: str) -> Array:
        """Of a glider along the track (T,) [m/s]."""
        return run.velocity(body)[:, 0]

    def twin(self, run: Run, tied: str) -> tuple[ElasticCouple, Run]:
        """This specimen and its run, or a twin that is tied so."""
        if self.tied == tied:
            return self, run
        changes: dict[str, float | str] = {"tied": tied}
        if tied == "hook":
            changes["stiffness"] = min(max(self.stiffness, 1.1 * self.needed()), 500.0)
        else:
            changes["speed"] = min(self.speed, 0.8)
        try:
            return ElasticCouple.make(**(self.values() | changes)), run.again(**changes)
        except Refusal as refusal:
            raise NotEvaluated(f"the twin that this law needs is refused: {refusal}") from None

    def flights(self, run: Run) -> list[slice]:
        """Stretches of at least six samples with a slack rope and without a collision."""
        free = self.distance(run) < self.length * (1 - 1e-9)
        edges = np.flatnonzero(np.diff(free.astype(int))) + 1
        hits = np.searchsorted(run.t, [i.time for i in run.impacts])
        bounds = np.unique(np.concatenate([[0], edges, hits, [len(run)]]))
        parts = [slice(int(a), int(b)) for a, b in pairwise(bounds)]
        return [part for part in parts if free[part].all() and part.stop - part.start >= 6]

    def farthest(self, run: Run) -> tuple[float, float]:
        """When [s] and how far [m] apart the ends are for the first time."""
        times, distances = peaks(run.t, self.distance(run), self.parting(run))
        if not len(times):
            raise NotEvaluated("the run ends before the rope is stretched farthest")
        return float(times[0]), float(distances[0])

    @law("D = L₀ + x, x = (m g + √((m g)² + 2 k m g L₀))/k", source="Landau & Lifshitz, Mechanics, §6 (energy)",
         within=(2e-4, 1e-5, 1e-6), limited_by=TAUT)  # fmt: skip
    def falls_as_deep_as_the_energy_goes(self, run: Run) -> Measurement:
        """26a: the lowest point of the ball below where it is let go."""
        specimen, one = self.twin(run, "hook")
        return specimen.farthest(one)[1], specimen.length + specimen.stretch

    @law("a = g while slack; N ≥ 0 always", source="Galilei, Discorsi, third day (free fall); Hooke (1678)",
         within=(1e-8, 1e-10, 1e-11))  # fmt: skip
    def a_slack_rope_does_nothing(self, run: Run) -> Measurement:
        """26b: velocity of the ball on every flight; impulses of the rope over its mass, none of them downwards."""
        specimen, one = self.twin(run, "hook")
        speed = one.velocity(BALL)[:, 2]
        found, expected = [], []
        for flight in specimen.flights(one):
            found.append(speed[flight])
            expected.append(speed[flight][0] - g * (one.t[flight] - one.t[flight][0]))
        if not found:
            raise NotEvaluated("the rope is never slack for six samples")
        pushes = np.minimum(np.diff(speed) + g * np.diff(one.t), 0.0)
        return np.concatenate([*found, pushes]), np.concatenate([*expected, np.zeros_like(pushes)])

    @law("x = v₀ √(m_r/k), t = π √(m_r/k), m_r = m₁ m₂/(m₁ + m₂)", within=(5e-4, 5e-5, 5e-6),
         source="Landau & Lifshitz, Mechanics, §13 eq. 13.4 and §21 eq. 21.6", limited_by=TAUT)  # fmt: skip
    def two_tied_bodies_swing_half_a_period(self, run: Run) -> Measurement:
        """26c: greatest stretch, and the time from the rope's tightening to its slackening."""
        specimen, one = self.twin(run, "glider")
        _, farthest = specimen.farthest(one)
        distance, parting = specimen.distance(one), specimen.parting(one)
        turns = np.flatnonzero(np.diff(specimen.taut(one)))
        if len(turns) < 2:
            raise NotEvaluated("the rope is not taut and slack again before the run ends")
        # while it is slack they part and meet evenly: the last sample before and the first after tell when it was taut
        ends = [one.t[i] + (specimen.length - distance[i]) / parting[i] for i in (turns[0], turns[1] + 1)]
        stretch, time = specimen.speed / specimen.rate, pi / specimen.rate
        return [(farthest - specimen.length) / stretch, (ends[1] - ends[0]) / time], [1.0, 1.0]

    @law("m₁ v₁ + m₂ v₂ = m₁ v₀", source="Newton, Principia, corollary 3 of the laws", within=(1e-11, 1e-11, 1e-12))
    def together_they_keep_their_momentum(self, run: Run) -> Measurement:
        """26c: of both gliders at every sample, collisions included."""
        specimen, one = self.twin(run, "glider")
        total = specimen.mass * specimen.pace(one, RIGHT) + specimen.other * specimen.pace(one, LEFT)
        return total, np.full_like(total, specimen.mass * specimen.speed)

    @law("t = √(2 L₀/g) + (π/2 + atan(g/(ω v)))/ω, v = √(2 g L₀), ω = √(k/m)", within=(2e-4, 1e-5, 1e-6),
         source="Landau & Lifshitz, Mechanics, §21 eq. 21.8", limited_by=TAUT)  # fmt: skip
    def is_lowest_when_it_should(self, run: Run) -> Measurement:
        """26d: time from the release to the lowest point."""
        specimen, one = self.twin(run, "hook")
        return specimen.farthest(one)[0], specimen.lowest

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        rope = f"a slack elastic rope, {self.length:.2f} m long and of {self.stiffness:.0f} N/m"
        if self.tied == "hook":
            return (
                f"A red ball of {self.mass:.2g} kg hangs on {rope}, and is let go right below the hook that it is "
                f"tied to. It falls freely until the rope is taut; then the rope stretches by {self.stretch:.2f} m "
                f"and stops it {self.lowest:.2f} s after the start, {self.length + self.stretch:.2f} m deep. The rope "
                "pulls it up again and goes slack: it pulls but never pushes, so the ball flies on by itself."
            )
        bumps = (
            "Its pull throws them together and they bump into each other."
            if run.impacts
            else "Its pull draws them together again, and it goes slack."
        )
        return (
            f"Two gliders of {self.other:.2g} and {self.mass:.2g} kg on an air track are tied together by {rope}. The "
            f"right one leaves at {self.speed:.2g} m/s while the left one rests, until the rope is taut. It stretches "
            f"by {100 * self.stretch:.0f} cm, stops the one and draws the other along. {bumps} The momentum of both "
            "together stays the same."
        )
