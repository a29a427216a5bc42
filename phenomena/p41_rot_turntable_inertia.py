"""41: a block that a turntable cannot hold slides out, leaves the rim along the tangent and falls."""

from __future__ import annotations

import functools
from math import atan2, cos, hypot, inf, pi, sin, sqrt
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

from phenomena.spins import Course, across, distance, drift, plan
from phenomena.turntables import HINGE, TOP, Slide, arena, block, carry, critical_spin, slip_time, turntable
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between
from physinone_mj.run import Run
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]

BODY: Final = "rider/block"
SIZE: Final = (0.045, 0.045, 0.025)
"""Half sizes of the block [m]."""

REACH: Final = hypot(*SIZE)
"""From its centre to a corner [m]."""

TARGET: Final = (0.06, 0.06, 0.14)
"""Half sizes of the box that stands in its way [m]."""

RELEASE: Final = 1.0
"""When the latch lets go [s]."""

LIP: Final = 0.012
LIP_PARTS: Final = 24
"""Height of a raised rim [m], and the straight pieces of which it is made."""

HELD_OVER: Final = 2e-5
"""How far over the table the latch holds the block [m]; both held and lying on it, its load could be shared anyhow."""


class RotTurntableInertia(Phenomenon, domain="mechanics", label="RotTurnableInertia"):
    """Objects on a rotating turntable fly off: straight on along the tangent, as soon as nothing turns them."""

    release: Annotated[Literal["speeding", "latch"], Choice("the table speeds up, or a latch on it lets go")] = (
        "speeding"
    )
    target: Annotated[Literal["box", "none"], Choice("what stands in the block's way on the ground")] = "box"
    edge: Annotated[Literal["plain", "raised"], Choice("the rim, flush or with a lip on it")] = "plain"
    first: Annotated[float, Param("rad/s", 0.0, 8.0, "spin of the table at the start")] = 1.6
    rate: Annotated[float, Param("rad/s²", 0.1, 8.0, "at which it speeds up")] = 0.8
    top: Annotated[float, Param("rad/s", 0.5, 12.0, "spin that it keeps at last")] = 4.0
    radius: Annotated[float, Param("m", 0.07, 0.9, "of the block's circle")] = 0.36
    rim: Annotated[float, Param("m", 0.2, 1.0, "radius of the table")] = 0.5
    height: Annotated[float, Param("m", 0.05, 1.0, "of the table over the ground")] = 0.45
    friction: Annotated[float, Param("1", 0.0, 0.9, "of block and table")] = 0.3
    density: Annotated[float, Param("kg/m³", 300.0, 8000.0, "of the block")] = 1200.0

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen whose block stands within the rim."""
        low, high = (getattr(cls.declarations()["radius"][0], end) for end in ("low", "high"))
        radius = fixed.get("radius", rng.uniform(low, high))
        rim = rng.uniform(max(0.2, radius + REACH), 1.0)
        return super().sample(rng, **({"radius": radius, "rim": rim} | fixed))

    @property
    def course(self) -> Course:
        """Of the table's spin."""
        return Course(self.top, self.top) if self.release == "latch" else Course(self.first, self.top, self.rate)

    @property
    def since(self) -> float:
        """From when on the block slides [s]; infinite if it rides for ever."""
        if self.release == "speeding":
            return slip_time(self.course, self.friction, self.radius)
        return RELEASE if self.top**2 * self.radius > self.friction * g else inf

    @functools.cached_property
    def leaving(self) -> tuple[float, Array, Array] | None:
        """When, where and how fast the centre crosses the rim if the block starts at azimuth 0; None if it does not."""
        if self.since == inf or self.since > 9.0 or self.edge == "raised":
            return None
        return Slide.riding(self.course, self.friction, self.radius, 0.0, self.since).reach(self.rim, 4.0)

    @property
    def azimuth(self) -> float:
        """Of the block at the start, such that it flies off along x [rad]."""
        return -atan2(self.leaving[2][1], self.leaving[2][0]) if self.leaving else 0.0

    @property
    def slide(self) -> Slide:
        """Its way from where it begins to slide."""
        return Slide.riding(self.course, self.friction, self.radius, self.azimuth, self.since)

    def build(self, scene: Scene) -> None:
        """The table, the block on it, and a box where the block will come down."""
        if self.radius + REACH > self.rim:
            raise Refusal("R1", f"radius = {self.radius:.4g} m: the block stands out over a rim of {self.rim:.4g} m; "
                          f"allowed: {self.rim - REACH:.4g} m")  # fmt: skip
        surface = Surface(friction=self.friction, restitution=0.1)
        table = turntable(scene, self.rim, self.height, self.course, surface)
        part = block(scene, "rider", SIZE, self.density, surface, (0.84, 0.27, 0.22))
        top = self.height + SIZE[2]
        if self.release == "latch":
            top += HELD_OVER
        carry(scene, part.name("free"), self.radius, self.azimuth, top, self.course.first)
        if self.release == "latch":
            self._latch(scene, table)
        if self.edge == "raised":
            self._raise_rim(scene, table, surface)
        lands, far = self._landing()
        arena(scene, max(lands + 0.7, self.rim + 0.4), 0.12)
        if self.target == "box" and self.leaving:
            self._place_target(scene, lands, far)
        late = self.leaving[0] if self.leaving else (self.since if self.since < inf else 1.4)
        falls = sqrt(2 * self.height / g)
        quickest = max(self.course.first, float(self.course.spin(late + 0.2)))
        scene.resolve(time=min(0.4, 1 / max(quickest, 1e-3)), length=SIZE[2],
                      duration=min(10.0, max(3.0, late + falls + 1.6)))  # fmt: skip

    def _landing(self) -> tuple[float, float]:
        """x of the place where the block would come down, and y of its way [m]."""
        if not self.leaving:
            return 0.0, 0.0
        _, x, v = self.leaving
        turned = complex(cos(self.azimuth), sin(self.azimuth)) * complex(*x)
        return turned.real + hypot(*v) * sqrt(2 * self.height / g), turned.imag

    def _latch(self, scene: Scene, table: Part) -> None:
        """A fork behind the block, open outwards, and the weld that it stands for."""
        import mujoco

        out = np.array([cos(self.azimuth), sin(self.azimuth)])
        lean = (cos(self.azimuth / 2), 0.0, 0.0, sin(self.azimuth / 2))
        disc, top, wide = table.body("turntable"), table.geom("top").size[1], SIZE[1] + 0.006
        for name, along, side, half in (
            ("fork_back", -SIZE[0] - 0.008, 0.0, (0.005, wide + 0.004, 0.015)),
            ("fork_left", -0.01, wide, (0.03, 0.004, 0.015)),
            ("fork_right", -0.01, -wide, (0.03, 0.004, 0.015)),
        ):
            where = (self.radius + along) * out + side * across(out)
            disc.add_geom(
                name=table.name(name), type=mujoco.mjtGeom.mjGEOM_BOX, pos=(*where, top + half[2]), quat=lean,
                size=half, mass=0.0, rgba=(0.33, 0.36, 0.41, 1.0), contype=0, conaffinity=0,
            )  # fmt: skip
        weld = scene.spec.add_equality(
            name="latch", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=table.name("turntable"), name2=BODY,
        )  # fmt: skip
        weld.data[:11] = (0, 0, 0, *(self.radius * out), top + SIZE[2] + HELD_OVER, *lean, 1.0)
        scene.cuts["latch"] = RELEASE

    def _raise_rim(self, scene: Scene, table: Part, surface: Surface) -> None:
        """A lip round the table, of straight pieces."""
        import mujoco

        half, top = pi / LIP_PARTS, table.geom("top").size[1]
        for i in range(LIP_PARTS):
            turn = 2 * pi * i / LIP_PARTS
            table.body("turntable").add_geom(
                name=table.name(f"lip{i}"), type=mujoco.mjtGeom.mjGEOM_BOX, mass=0.0, rgba=(0.62, 0.65, 0.69, 1.0),
                pos=((self.rim - 0.004) * cos(turn), (self.rim - 0.004) * sin(turn), top + LIP / 2),
                quat=(cos(turn / 2), 0.0, 0.0, sin(turn / 2)), size=(0.004, self.rim * np.tan(half), LIP / 2),
                contype=0, conaffinity=0,
            )  # fmt: skip
            scene.material(table.name(f"lip{i}"), 7800.0, surface)
            scene.touch(BODY, table.name(f"lip{i}"))

    def _place_target(self, scene: Scene, lands: float, aside: float) -> None:
        part = block(scene, "target", TARGET, 120.0, Surface(friction=0.5, restitution=0.2), (0.30, 0.62, 0.42))
        x = max(lands - 0.1, self.rim + TARGET[0] + 0.05)
        scene.start[part.name("free")] = free_pose((x, aside, TARGET[2]))
        scene.touch(part.name("block"), BODY)

    @observable("m")
    def distances(self, run: Run) -> Array:
        """Of the block's centre from the axis, seen from above (T,)."""
        return distance(run, BODY)

    @observable("rad/s")
    def table_spin(self, run: Run) -> Array:
        """Of the table (T,)."""
        return run.joint_speed(HINGE)

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """Horizontal velocity of the block's centre relative to the table, or to where it would be (T, 2)."""
        return drift(run, BODY, HINGE)

    def flight(self, run: Run) -> NDArray[np.bool_]:
        """Samples (T,) between rim and ground; NotEvaluated if the block does not fly."""
        clear = distance(run, BODY) > self.rim + REACH
        if not clear.any():
            raise NotEvaluated("the block does not leave the table")
        start = float(run.t[int(np.argmax(clear))])
        met = [i.time for i in run.impacts if BODY in (i.first, i.second) and TOP not in (i.first, i.second)]
        if any(time < start for time in met):
            raise NotEvaluated("the block meets something before it is clear of the rim")
        return between(run.t, start - 1e-6, min([*met, run.t[-1]]))

    def sliding(self, run: Run) -> NDArray[np.bool_]:
        """Samples (T,) from the first slip till a corner reaches the rim; NotEvaluated if it never slides."""
        if self.since > run.t[-1] or self.edge == "raised" or (self.friction == 0 and self.release == "speeding"):
            raise NotEvaluated("the block does not slide from riding to the rim")
        over = distance(run, BODY) > self.rim - REACH
        if not over.any():
            raise NotEvaluated("the block does not reach the rim while it is watched")
        begin = self.since + (2 * sqrt(2 * HELD_OVER / g) if self.release == "latch" else 0.0)
        return between(run.t, begin, float(run.t[int(np.argmax(over))]))

    @law("Ω_s = ((μ g/r)² - α²)^(1/4)", source="Goldstein, Classical Mechanics, 3rd ed., §4.10 with Coulomb's law",
         within=(2.1e-3, 2.1e-3, 2.1e-3), limited_by="a bracket: it stays at -0.2 %, goes at +0.2 %")  # fmt: skip
    def block_slips_at_the_critical_spin(self, run: Run) -> Measurement:
        """41a: on twins that speed up slowly, a little less and a little more than friction can follow."""
        return critical_spin(run, BODY, self.friction, self.radius, release="speeding", target="none", edge="plain")

    @law("ẍ = -g ẑ", source="Galilei, Discorsi (1638), fourth day, theorem 1", within=(1e-10, 1e-11, 1e-11))
    def falls_on_a_parabola(self, run: Run) -> Measurement:
        """41b: from the rim to the ground: straight on at constant speed as seen from above."""
        air = self.flight(run)
        x, v, t = run.position(BODY)[air], run.velocity(BODY)[air], run.t[air] - run.t[air][0]
        return x, x[0] + np.outer(t, v[0]) - np.outer(t**2, (0.0, 0.0, g / 2))

    @law("x = x₀ + Ω ẑ × x₀ t, r(t) = r √(1 + Ω² t²)", source="Newton, Principia (1687), law I",
         within=(3e-4, 4e-5, 1e-5), limited_by="steps carry it ahead, and the latch lets go within one")  # fmt: skip
    def released_puck_leaves_along_the_tangent(self, run: Run) -> Measurement:
        """41c: where the latch lets go of a block without friction, till it reaches the rim."""
        twin = run.again(release="latch", friction=0.0, target="none", edge="plain")
        free = twin.specimen.sliding(twin)
        slide, t = twin.specimen.slide, twin.t[free] - RELEASE
        return plan(twin, BODY)[free], slide.start + np.outer(t, slide.velocity)

    @law("ẍ = -μ g û, û = w/|w|, w = ẋ - Ω ẑ × x", source="Coulomb, Théorie des machines simples (1785)",
         within=(5e-3, 2.5e-3, 2e-3), limited_by="the block turns, too, which the equation leaves out")  # fmt: skip
    def slides_out_as_friction_says(self, run: Run) -> Measurement:
        """41d: place and velocity from the first slip till a corner reaches the rim, against the equation of motion."""
        slides = self.sliding(run)
        x, v = self.slide.way(run.t[slides])
        fast = np.linalg.norm(v[-1])
        measured = np.column_stack([plan(run, BODY)[slides] / self.rim, run.velocity(BODY)[slides, :2] / fast])
        return measured, np.column_stack([x / self.rim, v / fast])

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        begin = f"A red block rides on a round table, {self.radius:.2f} m from its axis. " + (
            f"The table turns at {self.top:.1f} rad/s until a latch lets go of the block."
            if self.release == "latch"
            else f"The table speeds up by {self.rate:.2g} rad/s every second."
        )
        if self.since > run.t[-1]:
            return (
                f"{begin} Friction of {self.friction:.2f} is enough to turn the block with the table all the time: it "
                "stays where it stands on the disc, going round and round, and does not fly off however long we watch."
            )
        gone = distance(run, BODY) > self.rim
        fate = (
            f"leaves the rim at {run.t[int(np.argmax(gone))]:.1f} s with "
            f"{np.linalg.norm(run.velocity(BODY)[int(np.argmax(gone)), :2]):.1f} m/s and falls {self.height:.2f} m "
            f"to the ground{' into a green box' if self.target == 'box' else ''}."
            if gone.any()
            else "does not come over the rim."
        )
        return (
            f"{begin} From {self.since:.1f} s on friction of {self.friction:.2f} cannot turn it fast enough any more. "
            f"It slides outwards; seen from the room, inertia carries it straight on along the tangent. It {fate}"
        )
