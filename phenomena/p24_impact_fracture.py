"""Things that break: cut beforehand into chunks which bonds hold, until a load is too much."""

from __future__ import annotations

from functools import cached_property
from math import cos, pi, sin, sqrt
from typing import Annotated, Final, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from physinone_mj import fracture
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import CONTACT_TIME, Surface
from physinone_mj.fracture import Fracture, Solid, box, place, revolved, shatter
from physinone_mj.measure import threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .parts import ball
from .stands import gallows

SIDES: Final = 6
BOTTOM: Final = ((0.0, 0.0), (0.12, 0.0), (0.12, 0.022), (0.0, 0.022))
WALL: Final = ((0.098, 0.022), (0.12, 0.022), (0.165, 0.3), (0.143, 0.3))
"""Sections of the pot: radius and height [m]."""

BRICK: Final = (0.15, 0.075, 0.05)
PLATE: Final = (0.2, 0.15, 0.012)
BLOCK: Final = (0.06, 0.06, 0.12)
"""Half sizes [m]; of a brick, of a plate, and of each of the two blocks of a column."""

COLOURS: Final = {
    "pot": (0.80, 0.42, 0.28),
    "brick": (0.72, 0.33, 0.26),
    "plate": (0.93, 0.90, 0.84),
    "column": (0.72, 0.70, 0.66),
}
TILT: Final = {"pot": (0.4, 0.25), "brick": (0.5, 0.3), "plate": (0.3, 0.35), "column": (0.0, 0.0)}
"""How it is turned when let go: about x, then about y [rad]."""

SHOT_RADIUS: Final = 0.05
SHOT_DENSITY: Final = 7800.0
CLASH: Final = 0.6
"""Where in its fall the thing is hit, as a fraction of the time of fall."""

MARGIN: Final = 1e-4


class ImpactFracture(Phenomenon, domain="mechanics"):
    """Breakable things shatter when they land or are hit."""

    shape: Annotated[Literal["pot", "brick", "plate", "column"], Choice("a column is two blocks, glued")] = "pot"
    event: Annotated[Literal["drop", "clash", "hang"], Choice("lands; is hit in the air; hangs from its top")] = "drop"
    chunks: Annotated[int, Param("1", 8, 60, "pieces that do not break any more")] = 10
    strength: Annotated[float, Param("Pa", 1e2, 1e9, "tension that breaks a bond")] = 2e7
    height: Annotated[float, Param("m", 0.2, 2.0, "its lowest point above the floor")] = 0.8
    speed: Annotated[float, Param("m/s", 2.0, 10.0, "of the ball that hits it in the air")] = 6.0
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "thing")] = 2000.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "everything against everything")] = 0.5
    restitution: Annotated[float, Param("1", 0.1, 0.8, "everything against everything")] = 0.2
    pattern: Annotated[int, Param("1", 0, 9999, "seed of the cracks")] = 1

    @property
    def fall(self) -> float:
        """Time to the floor [s]."""
        return sqrt(2 * self.height / g)

    @property
    def volume(self) -> float:
        """Of the thing [m³]: boxes; for the pot, frusta of pyramids."""
        if self.shape in ("brick", "plate"):
            x, y, z = BRICK if self.shape == "brick" else PLATE
            return 8 * x * y * z
        if self.shape == "column":
            return 16 * BLOCK[0] * BLOCK[1] * BLOCK[2]
        circle = SIDES / 2 * sin(2 * pi / SIDES)  # area of the polygon in the unit circle
        (inner, low), (outer, _), (outer_top, top), (inner_top, _) = WALL

        def frustum(r: float, s: float) -> float:
            return circle * (top - low) / 3 * (r * r + r * s + s * s)

        return circle * BOTTOM[1][0] ** 2 * low + frustum(outer, outer_top) - frustum(inner, inner_top)

    @cached_property
    def broken(self) -> Fracture:
        """The thing in chunks, in its own axes."""
        if self.shape == "column":
            half = box(*BLOCK)
            shift = np.array([0.0, 0.0, BLOCK[2]])
            stack = tuple(Solid(half.vertices + side * shift, half.faces) for side in (-1, 1))
            return shatter(stack, (2,), self.pattern)
        if self.shape == "pot":
            return shatter(revolved((BOTTOM, WALL), SIDES), (self.chunks,), self.pattern)
        if self.shape == "plate":
            return shatter(box(*PLATE), (self.chunks,), self.pattern, grain=(0.0, 0.0, 1.0))
        return shatter(box(*BRICK), (self.chunks,), self.pattern)

    def build(self, scene: Scene) -> None:
        """The thing in the air; a ball beside it, or a beam above it."""
        if self.event == "hang" and self.shape != "column":
            raise Refusal("R12", f"event = hang with shape = {self.shape}: a thing held by its top breaks where nobody "
                          "knows; allowed: shape = column")  # fmt: skip
        surface = Surface(friction=self.friction, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, surface)
        a, b = (angle / 2 for angle in TILT[self.shape])
        turn = np.array([cos(b) * cos(a), cos(b) * sin(a), sin(b) * cos(a), -sin(b) * sin(a)])
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, turn)
        corners = np.concatenate([chunk.shape.vertices for chunk in self.broken.chunks]) @ matrix.reshape(3, 3).T
        up = self.height - corners[:, 2].min()
        thing = place(
            scene, "thing", self.broken, density=self.density, surface=surface, stress=self.strength,
            position=(0.0, 0.0, up), quaternion=turn, colour=COLOURS[self.shape],
        )  # fmt: skip
        for body in thing:
            scene.touch(body, "stage/floor")
        watched = self.fall + 0.3 if self.shape == "column" else max(2.0, self.fall + 1.4)
        scene.resolve(time=2 * self.fall, length=0.05, duration=watched)
        if self.event == "clash":
            self._shoot(scene, thing, surface)
        elif self.event == "hang":
            self._hang(scene, thing)

    def _shoot(self, scene: Scene, thing: list[str], surface: Surface) -> None:
        """A ball that falls as the thing does and so meets it, whatever gravity; a little off the middle."""
        shot = ball(scene, "shot", SHOT_RADIUS, SHOT_DENSITY, surface, (0.33, 0.36, 0.41))
        middle = np.average([scene.spec.body(body).pos for body in thing], axis=0,
                            weights=[scene.spec.body(body).mass for body in thing])  # fmt: skip
        away = self.speed * CLASH * self.fall + 0.1
        scene.start[shot.name("free")] = free_pose(middle + np.array([-away, 0.02, 0.03]))
        scene.speed[shot.name("free")] = (self.speed, 0, 0, 0, 0, 0)
        scene.touch(shot.name("ball"), "stage/floor")
        for body in thing:
            scene.touch(shot.name("ball"), body)

    def _hang(self, scene: Scene, thing: list[str]) -> None:
        """The upper block is held by a beam."""
        top = scene.spec.body(thing[-1]).pos[2] + BLOCK[2]
        beam = gallows(scene, top + 0.02, 0.4)
        fracture.bond(scene, "thing/held", beam.name("frame"), thing[-1])

    @observable("1")
    def bonds_left(self, run: Run) -> NDArray[np.float64]:
        """Bonds that still hold."""
        return np.asarray(fracture.holding(run, self.welds).sum(axis=1), float)

    @observable("1")
    def fragments(self, run: Run) -> NDArray[np.float64]:
        """Pieces that bonds hold together; a lone chunk is one."""
        holds = fracture.holding(run, self.welds)
        return np.array([fracture.fragments(self.broken, row).max() + 1.0 for row in holds])

    @observable("J")
    def energy(self, run: Run) -> NDArray[np.float64]:
        """Of everything that moves, above the floor."""
        return np.asarray(run.motion.kinetic + run.motion.potential)

    @property
    def bodies(self) -> list[str]:
        """Names of the chunks."""
        return fracture.bodies("thing", self.broken)

    @property
    def welds(self) -> list[str]:
        """Names of the bonds."""
        return fracture.welds("thing", self.broken)

    def clash(self, run: Run) -> tuple[Run, list[str], NDArray[np.bool_]]:
        """A run in which it is hit in the air, what moves in it, and the samples before anything meets the floor."""
        run = run if run.specimen.event == "clash" else run.again(event="clash")
        moving = [*run.specimen.bodies, "shot/ball"]
        landed = min((i.time for i in run.impacts if "stage/floor" in (i.first, i.second)), default=run.t[-1])
        if not any(broken.time < landed for broken in run.breaks):
            raise NotEvaluated("it does not break in the air")
        return run, moving, run.t < landed

    @law("Σ mᵢ = ρ V", source="by definition: density; the volume is that of boxes and of frusta of pyramids",
         within=(1e-12, 1e-12, 1e-12), limited_by="round-off: nothing here depends on the step")  # fmt: skip
    def chunks_weigh_what_the_thing_does(self, run: Run) -> Measurement:
        """24a: nothing is lost in the cuts; and every chunk is there until the end."""
        there = np.isfinite(np.array([run.position(body)[-1] for body in self.bodies])).all(axis=1)
        return np.sum([run.mass(body) for body in self.bodies] * there), self.density * self.volume

    @law("P = P₀ + M g t", source="Newton, Principia, Axioms, corollary 3", within=(1e-9, 1e-10, 1e-11))
    def breaking_does_not_change_the_momentum(self, run: Run) -> Measurement:
        """24a: in a clash in the air, of thing and ball together, until something meets the floor."""
        run, moving, aloft = self.clash(run)
        momentum = np.sum([run.momentum(body) for body in moving], axis=0)[aloft]
        mass = sum(run.mass(body) for body in moving)
        due = momentum[0] - np.outer(run.t[aloft], (0, 0, mass * g))
        return momentum, due

    @law("L = L₀ about the centre of mass", source="Landau & Lifshitz, Mechanics, §9 eq. 9.3",
         within=(1e-2, 3e-3, 1e-3), limited_by="exact at the break, then pieces turn in coarse steps")  # fmt: skip
    def breaking_does_not_change_the_angular_momentum(self, run: Run) -> Measurement:
        """24a: in a clash of a ball with a column, whose two blocks part; in the sample after it as in the first."""
        run, moving, _ = self.clash(run.again(shape="column", event="clash", strength=1e4))
        momentum = np.sum([run.momentum(body) for body in moving], axis=0)
        middle = np.average([run.position(body) for body in moving], axis=0, weights=[run.mass(b) for b in moving])
        about = np.sum([run.angular_momentum(body) for body in moving], axis=0) - np.cross(middle, momentum)
        return about[int(np.searchsorted(run.t, run.breaks[0].time))], about[0]

    @law("x = x₀ + v₀ t + ½ g t² of the centre of mass", source="Newton, Principia, Axioms, corollary 4",
         within=(1e-7, 1e-9, 1e-10), unit="m")  # fmt: skip
    def fragments_together_stay_on_the_parabola(self, run: Run) -> Measurement:
        """24e: the centre of mass of all fragments and of the ball that broke it, until one of them meets the floor."""
        run, moving, aloft = self.clash(run)
        masses = [run.mass(body) for body in moving]
        middle = np.average([run.position(body)[aloft] for body in moving], axis=0, weights=masses)
        start = np.average([run.velocity(body)[0] for body in moving], axis=0, weights=masses)
        t = run.t[aloft, None]
        return middle, middle[0] + start * t - 0.5 * t**2 * (0, 0, g)

    @law("E = E₀ in flight; Ė ≤ 0 after", source="Landau & Lifshitz, Mechanics, §6; rigid bonds store nothing",
         within=(1e-2, 3e-3, 1e-3), limited_by="restitution with friction at the corners of a heap")  # fmt: skip
    def breaking_sets_no_energy_free(self, run: Run) -> Measurement:
        """24b: energy of everything; the greatest rise above what it was once anything touched."""
        energy = self.energy(run) / self.energy(run)[0]
        first = min((i.time for i in run.impacts), default=run.t[-1])
        flying = energy[run.t < first]
        risen = np.maximum(energy - np.minimum.accumulate(energy), 0).max()
        return [*flying, 1 + risen], np.ones(len(flying) + 1)

    @law("F = σ A", source="by definition: the strength of a bond", within=(2 * MARGIN,) * 3,
         limited_by="the bracket's width")  # fmt: skip
    def hanging_block_falls_when_too_heavy(self, run: Run) -> Measurement:
        """24c: the strength at which the lower block of a hanging column drops is m g/A."""
        area = 4 * BLOCK[0] * BLOCK[1]
        needed = self.density * 2 * BLOCK[2] * area * g / area

        def holds(strength: float) -> bool:
            return not run.again(shape="column", event="hang", strength=strength).breaks

        return threshold(holds, needed, spread=MARGIN, resolution=2 * MARGIN), needed

    @law("h = (σ A τ/((1 + e) m))²/(2 g)", source="Newton, Principia, Axioms, corollary 6, scholium (e); Galilei, "
         "Discorsi, day 3, prop. 3", within=(2 * MARGIN,) * 3, limited_by="the bracket's width")  # fmt: skip
    def column_breaks_from_a_certain_height_on(self, run: Run) -> Measurement:
        """24d: dropped on its end, the joint has to stop the upper block: its momentum m (1 + e) v in the time τ.

        On columns as strong as that the critical height is about that of this specimen.
        """
        high = min(max(self.height, 0.21), 1.98)
        area, mass = 4 * BLOCK[0] * BLOCK[1], self.density * 8 * BLOCK[0] * BLOCK[1] * BLOCK[2]
        strength = round((1 + self.restitution) * mass * sqrt(2 * g * high) / (area * CONTACT_TIME), -3)
        critical = (strength * area * CONTACT_TIME / ((1 + self.restitution) * mass)) ** 2 / (2 * g)

        def breaks(height: float) -> bool:
            return bool(run.again(shape="column", event="drop", strength=strength, height=height).breaks)

        return threshold(breaks, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        what = {"pot": "A terracotta pot", "brick": "A brick", "plate": "A ceramic plate", "column": "A column of two "
                "glued blocks"}[self.shape]  # fmt: skip
        left = int(self.fragments(run)[-1])
        broken = len(run.breaks)
        outcome = (
            f"{broken} of its {len(self.welds)} bonds break and {left} pieces are left, which scatter, slide and settle"
            if broken
            else "all its bonds hold and it stays whole"
        )
        if self.event == "hang":
            return (
                f"{what} hangs from a beam by its upper block. The joint between the blocks has to carry the lower "
                f"one, {run.mass(self.bodies[0]):.2f} kg; it can carry {self.strength / 1e3:.3g} kN per square metre. "
                f"A bond breaks when the load on it is more than its strength times its area: {outcome}."
            )
        before = (
            f"In the air, a steel ball hits it at {self.speed:.1f} m/s. The momentum of all together is what it was: "
            "their common centre of mass goes on along its parabola"
            if self.event == "clash"
            else f"It lands after {self.fall:.2f} s at {sqrt(2 * g * self.height):.1f} m/s. Stopping its upper parts "
            "loads the bonds inside; those that cannot bear it break, and no energy is set free"
        )
        return (
            f"{what} of {self.density * self.volume:.2f} kg falls from {self.height:.2f} m. {before}: {outcome}. "
            "Chunks that come apart collide with each other and with the floor until friction brings them to rest."
        )
