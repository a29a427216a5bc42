"""A board on sticks: it rests on them as statics says, and comes down when one is knocked out, drawn out or crushed."""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, Final, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from physinone_mj import fracture
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fracture import Chunk, Fracture, Interface, Solid
from physinone_mj.measure import acceleration, between, crossings, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Bond, Motor, Scene, free_pose

from .parts import ball, court, sphere_mass

THICK: Final = 0.015
"""Half the thickness of a stick [m]."""

HEAD: Final = 0.006
"""Radius of the round head of a stick [m]."""

BOARD: Final = 0.012
"""Half the thickness of the board [m]."""

WIDE: Final = 0.10
"""Half the width of the board [m]."""

SCALE: Final = 1e4
"""Stiffness of the springs under sticks that are weighed [N/m]."""

PULL: Final = 5.0
"""Speed at which a stick is drawn out [m/s]."""

WHEN: Final = 1.0
"""When it is drawn out, and when the ball comes [s]."""

LEAN: Final = 0.005
"""Of a board on springs, beyond which friction at their heads, too, bears some of the moment [rad]."""
MARGIN: Final = 0.002

Array = NDArray[np.float64]


class StickSupportFail(Phenomenon, domain="mechanics"):
    """Wooden board supported by sticks collapses."""

    trigger: Annotated[
        Literal["ball", "pull", "overload", "none"],
        Choice("a ball knocks out a stick; one is drawn out; one is crushed by the load; or nothing happens"),
    ] = "ball"
    length: Annotated[float, Param("m", 0.5, 1.6, "of the board")] = 1.0
    height: Annotated[float, Param("m", 0.3, 0.8, "of the sticks")] = 0.5
    sticks: Annotated[int, Param("1", 2, 4, "evenly spread")] = 2
    inset: Annotated[float, Param("1", 0.0, 0.2, "of the outer sticks from the ends, over the board's length")] = 0.05
    density: Annotated[float, Param("kg/m³", 200.0, 2000.0, "board and sticks")] = 650.0
    load: Annotated[float, Param("kg", 0.0, 8.0, "cube on the board; none if 0")] = 2.0
    place: Annotated[float, Param("1", -0.8, 0.8, "of the cube, over half the board's length")] = 0.3
    friction: Annotated[float, Param("1", 0.2, 0.9, "of every surface")] = 0.5
    strength: Annotated[float, Param("N", 1.0, 200.0, "load that crushes the first stick")] = 10.0
    speed: Annotated[float, Param("m/s", 1.0, 6.0, "of the ball")] = 4.0

    @property
    def board(self) -> float:
        """Mass of the board [kg]."""
        return self.density * 4 * self.length * WIDE * BOARD

    @property
    def stands(self) -> Array:
        """Where the sticks stand, along the board (n,) [m]."""
        end = self.length / 2 - THICK - self.inset * self.length
        return np.linspace(-end, end, self.sticks)

    @property
    def cube(self) -> float:
        """Half the edge of the load [m]."""
        return float((self.load / 2500.0) ** (1 / 3) / 2)

    @property
    def load_at(self) -> float:
        """Where the load lies, along the board [m]."""
        return self.place * (self.length / 2 - self.cube)

    @property
    def shares(self) -> tuple[float, float]:
        """Forces that two sticks bear [N]: the moments about each of them vanish."""
        left, right = float(self.stands[0]), float(self.stands[-1])
        first = (self.board * right + self.load * (right - self.load_at)) * g / (right - left)
        return first, (self.board + self.load) * g - first

    @property
    def weighed_shares(self) -> Array:
        """The same on springs (2,) [N]: the board leans to where they give more, and what lies high leans over."""
        first, second = self.shares
        high = self.board * BOARD + self.load * (2 * BOARD + self.cube)
        more = (second - first) / (1 - high * g / (2 * SCALE * float(self.stands[-1]) ** 2))
        return np.array([first + second - more, first + second + more]) / 2

    @property
    def surface(self) -> Surface:
        """Of everything."""
        return Surface(friction=self.friction, restitution=0.1)

    def build(self, scene: Scene) -> None:
        """Sticks, the board on them, the load on the board."""
        if self.sticks == 2 and min(self.shares) <= 0:
            end = float(self.stands[-1])
            allowed = end * (1 + self.board / self.load) / (self.length / 2 - self.cube)
            raise Refusal("R12", f"place = {self.place:.3g}: the board tips over its outer stick; allowed: "
                          f"{-allowed:.3g} to {allowed:.3g}")  # fmt: skip
        if self.cube > WIDE:
            raise Refusal("R12", f"load = {self.load:.3g} kg is wider than the board; "
                          f"allowed: {2500 * 8 * WIDE**3:.3g} kg")  # fmt: skip
        scene.material("stage/floor", 2000.0, self.surface)
        sticks = [body for i, x in enumerate(self.stands) for body in self.stick(scene, i, float(x))]
        sunk = -min(self.bears(0), self.bears(self.sticks - 1)) / SCALE if self.trigger == "none" else 0.0
        lying = self.height + sunk
        flat = (self.length / 2, WIDE, BOARD)
        falling = [self.lay(scene, "board", (0.0, lying), flat, self.density, (0.85, 0.68, 0.45))]
        if self.load > 0:
            half = (self.cube, self.cube, self.cube)
            falling.append(self.lay(scene, "load", (self.load_at, lying + 2 * BOARD), half, 2500.0, (0.72, 0.24, 0.20)))
        if self.trigger == "ball":
            falling.append(self.throw(scene))
            rails = court(scene, self.length / 2 + 0.5, Surface(friction=self.friction, restitution=0.2))
            for body in falling:
                scene.touch(body, rails.name("rails"))
        scene.touch("stage/floor", *falling)
        for body in falling:
            for stick in sticks:
                scene.touch(body, stick)
        short = self.trigger == "overload"
        scene.resolve(time=0.8 * sqrt(self.length / g), length=THICK, duration=2.0 if short else 4.0)

    def lay(
        self, scene: Scene, name: str, at: tuple[float, float], half: tuple[float, float, float], density: float,
        colour: tuple[float, float, float],
    ) -> str:  # fmt: skip
        """A loose block, its underside at a height; at: along the board and up [m]."""
        part = scene.add("brick", name)
        geom = part.geom("block")
        geom.size[:], geom.mass, geom.rgba = half, density * 8 * float(np.prod(half)), (*colour, 1.0)
        scene.start[part.name("free")] = free_pose((at[0], 0.0, at[1] + half[2]))
        scene.material(part.name("block"), density, self.surface)
        return part.name("block")

    def stick(self, scene: Scene, i: int, x: float) -> list[str]:
        """One stick; returns the bodies that may be touched."""
        shaft = (self.height - HEAD) / 2
        mass = self.density * 8 * THICK**2 * shaft
        if i == 0 and self.trigger == "overload":
            return self.cracked(scene, x)
        loose = i == 0 and self.trigger == "ball"
        part = scene.add("stick" if loose else "prop", f"stick{i}")
        part.geom("stick").size[:], part.geom("stick").mass = (THICK, THICK, shaft), mass
        part.geom("head").pos[2] = shaft
        scene.material(part.name("stick"), self.density, self.surface)
        if loose:
            scene.start[part.name("free")] = free_pose((x, 0.0, shaft))
            scene.touch(part.name("stick"), "stage/floor")
            return [part.name("stick")]
        part.body("stick").pos[:] = (x, 0.0, shaft)
        drawn = i == 0 and self.trigger == "pull"
        course = ((0.0, 0.0), (WHEN, 0.0), (WHEN + 1e-3, -PULL), (WHEN + 0.08, -PULL), (WHEN + 0.2, 0.0))
        scene.motors.append(Motor(part.name("out"), course if drawn else ((0.0, 0.0),)))
        if self.trigger != "none":
            scene.motors.append(Motor(part.name("sink"), ((0.0, 0.0),)))
            return [part.name("stick")]
        sink = part.joint("sink")
        sink.stiffness[0], sink.damping[0] = SCALE, 0.7 * sqrt(SCALE * (self.board + self.load))
        sink.springref = mass * g / SCALE  # it is what the stick bears that is weighed
        scene.start[part.name("sink")] = -self.bears(i) / SCALE
        return [part.name("stick")]

    def bears(self, i: int) -> float:
        """What stick i bears [N]; of more than two, statics does not say: about alike."""
        return self.shares[i] if self.sticks == 2 else (self.board + self.load) * g / self.sticks

    def cracked(self, scene: Scene, x: float) -> list[str]:
        """A stick with a slanting crack that holds up to its strength; then the upper half slides off the lower."""
        shaft = self.height - HEAD
        corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
        halves = []
        for side, gap in ((-1, 0.0), (-1, fracture.GAP), (1, 0.0), (1, fracture.GAP)):
            crack = corners[:, 0] * THICK + side * gap / 2
            z = np.where(corners[:, 2] == side, side * shaft / 2, crack)
            points = np.column_stack([corners[:, 0] * THICK, corners[:, 1] * THICK, z])
            halves.append(Solid(points, fracture.box(1.0, 1.0, 1.0).faces))
        chunks = (Chunk(halves[0], halves[1], (0,)), Chunk(halves[2], halves[3], (1,)))
        slant = 1 / sqrt(2)
        meeting = Interface(0, 1, 1, 4 * THICK**2 / slant, (0.0, 0.0, 0.0), (-slant, 0.0, slant), THICK / 3)
        whole = Fracture((fracture.box(THICK, THICK, shaft / 2),), chunks, (meeting,))
        bodies = fracture.place(
            scene, "stick0", whole, density=self.density, surface=self.surface, stress=inf,
            position=(x, 0.0, shaft / 2), colour=(0.55, 0.36, 0.20), polish=0.15,
        )  # fmt: skip
        # crushed, not bent: only what presses on it counts
        scene.bonds.append(Bond(fracture.welds("stick0", whole)[0], self.strength, 1e6))
        head = scene.spec.body(bodies[1]).add_geom(
            name="stick0/head", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(HEAD, THICK, 0.0), mass=0.0,
            pos=(0.0, 0.0, shaft / 2 - chunks[1].whole.centre[2]), quat=(sqrt(0.5), sqrt(0.5), 0.0, 0.0),
            rgba=(0.45, 0.29, 0.16, 1.0),
        )  # fmt: skip
        head.contype = head.conaffinity = 0
        for body in bodies:
            scene.touch(body, "stage/floor")
        return bodies

    @property
    def upper(self) -> float:
        """Mass of the upper half of a cracked stick [kg]."""
        return self.density * 2 * THICK**2 * (self.height - HEAD)

    def throw(self, scene: Scene) -> str:
        """A ball that flies level when it strikes the first stick, at half its height."""
        radius = 0.06
        body = ball(scene, "ball", radius, 2500.0, self.surface, (0.25, 0.33, 0.62))
        time = min(0.7 / self.speed, sqrt(1.9 * (self.height / 2 - radius) / g))
        place = (float(self.stands[0]), -THICK - radius - self.speed * time, self.height / 2 - g * time**2 / 2)
        scene.start[body.name("free")] = free_pose(place)
        scene.speed[body.name("free")] = (0.0, self.speed, g * time, 0, 0, 0)
        return body.name("ball")

    @observable("rad")
    def tilt(self, run: Run) -> Array:
        """Of the board: positive where its end at the first stick is down (T,)."""
        q = run.quaternion("board/block")
        return np.asarray(-np.arcsin(np.clip(2 * (q[:, 0] * q[:, 2] - q[:, 3] * q[:, 1]), -1, 1)))

    @observable("N")
    def weighed(self, run: Run) -> Array:
        """What the springs under the sticks say, (T, n); 0 where the sticks stand fast and none is there."""
        if self.trigger != "none":
            return np.zeros((len(run), self.sticks))
        return np.column_stack([-SCALE * run.joint(f"stick{i}/sink") for i in range(self.sticks)])

    @observable("m")
    def heights(self, run: Run) -> Array:
        """Of the centres of the board and, if there is one, the load, (T, n)."""
        names = ["board/block", "load/block"] if self.load > 0 else ["board/block"]
        return np.column_stack([run.position(name)[:, 2] for name in names])

    def released(self, run: Run) -> float:
        """When the stick that is drawn out has left the end of the board [s]: its head's axis is beyond it."""
        way = self.stands[0] + self.length / 2
        return float(crossings(run.t, -run.joint("stick0/out"), -run.joint_speed("stick0/out"), way)[0])

    def pivot(self) -> tuple[float, float]:
        """Distance of the board's centre from the stick that is left, and its squared radius of gyration [m, m²]."""
        return float(self.stands[-1]), (self.length**2 + 4 * BOARD**2) / 12

    def bare(self, run: Run) -> tuple[StickSupportFail, Run]:
        """The board alone, on two sticks under its ends, from which one is drawn out."""
        changes = {"trigger": "pull", "sticks": 2, "inset": 0.0, "load": 0.0, "friction": 0.9}
        return StickSupportFail.make(**(self.values() | changes)), run.again(**changes)

    def just_after(self, run: Run) -> tuple[StickSupportFail, Run, NDArray[np.bool_]]:
        """The same, and the samples of the first 40 ms without the stick."""
        specimen, one = self.bare(run)
        start = specimen.released(one)
        return specimen, one, between(one.t, start, start + 0.04)

    @law("N₁ + N₂ = (M + m) g, Σ N x = M g x_M + m g x_m",
         source="J. L. Meriam & L. G. Kraige, Statics, 7th ed., §3/3",
         within=(1e-3, 1e-3, 1e-3), limited_by="the springs come to rest")  # fmt: skip
    def two_sticks_share_the_weight(self, run: Run) -> Measurement:
        """50a: at rest, by what the springs under the sticks say."""
        weighing = run.again(trigger="none", sticks=2)
        specimen = StickSupportFail.make(**(self.values() | {"trigger": "none", "sticks": 2}))
        shares = specimen.weighed_shares
        lean = abs(float(np.diff(shares)[0])) / (2 * SCALE * float(specimen.stands[-1]))
        if lean > LEAN:
            raise NotEvaluated(f"on its springs the board leans by {lean:.2g} rad; needed: {LEAN:g} rad or less")
        return self.weighed_at_rest(weighing), shares

    @law("Σ N = (M + m) g", source="J. L. Meriam & L. G. Kraige, Statics, 7th ed., §3/3", within=(1e-6, 1e-6, 1e-6),
         limited_by="the springs come to rest")  # fmt: skip
    def any_number_of_sticks_bears_the_weight(self, run: Run) -> Measurement:
        """50a: of three sticks and more, statics tells the sum alone."""
        weighing = run.again(trigger="none", sticks=max(self.sticks, 3))
        return self.weighed_at_rest(weighing).sum(), (self.board + self.load) * g

    @staticmethod
    def weighed_at_rest(run: Run) -> Array:
        """Mean readings over the last half second (n,) [N]; NotEvaluated if they have not come to rest."""
        readings = run.specimen.weighed(run)[run.t > run.t[-1] - 0.5]
        if np.ptp(readings, axis=0).max() > 1e-4 * readings.sum(axis=1).max():
            raise NotEvaluated("the springs have not come to rest")
        return np.asarray(readings.mean(axis=0))

    @law("θ̈ = g d/(k² + d² + b²), about 3 g/(2 L)", source="Landau & Lifshitz, Mechanics, §32 (a body about an axis)",
         within=(1e-2, 5e-3, 3e-3), limited_by="fitted over the first 40 ms, in which the torque changes")  # fmt: skip
    def an_end_without_support_falls_faster_than_free(self, run: Run) -> Measurement:
        """50b: angular acceleration just after a stick is gone; the end falls with up to 1.5 g."""
        specimen, one, mask = self.just_after(run)
        d, k2 = specimen.pivot()
        return acceleration(one.t[mask], specimen.tilt(one)[mask]), g * d / (k2 + d**2 + BOARD**2)

    @law("N = M g (1 - d²/(k² + d² + b²)), about M g/4", source="J. L. Meriam & L. G. Kraige, Dynamics, 7th ed., §6/4",
         within=(2e-2, 1e-2, 3e-3), limited_by="fitted over the first 40 ms, in which the torque changes")  # fmt: skip
    def the_stick_that_is_left_bears_a_quarter(self, run: Run) -> Measurement:
        """50b: its reaction, from the acceleration of the board's centre, over M g."""
        specimen, one, mask = self.just_after(run)
        d, k2 = specimen.pivot()
        falls = acceleration(one.t[mask], one.position("board/block")[mask, 2])
        return 1 + falls / g, 1 - d**2 / (k2 + d**2 + BOARD**2)

    @law("½ (k² + s² + b²) θ̇² = g (s sin θ + (b + r)(1 - cos θ)), s = d - r θ",
         source="Landau & Lifshitz, Mechanics, §32, with a board that rolls on a round head of radius r",
         within=(1e-3, 5e-4, 3e-4), limited_by="what speed the stick leaves in the board")  # fmt: skip
    def turns_by_the_height_it_loses(self, run: Run) -> Measurement:
        """50c: until the board slips on the head of the stick that is left, at tan θ = μ/10."""
        specimen, one = self.bare(run)
        start, tilt = specimen.released(one), specimen.tilt(one)
        mask = (one.t > start) & (tilt > 0.005) & (tilt < 0.07) & (one.t < start + 0.5)
        if mask.sum() < 5:
            raise NotEvaluated(f"{mask.sum()} samples between 0.005 and 0.07 rad; needed: 5")
        d, k2 = specimen.pivot()
        angle = tilt[mask]
        arm = d - HEAD * angle
        height = (HEAD + BOARD) * np.cos(angle) - arm * np.sin(angle)
        rate = np.sqrt(2 * g * (HEAD + BOARD - height) / (k2 + arm**2 + BOARD**2))
        return -one.spin("board/block")[mask, 1], rate

    @law("z̈ = -g", source="Landau & Lifshitz, Mechanics, §6: nothing else acts", within=(1e-3, 1e-3, 1e-3),
         limited_by="what speed the stick leaves in the board")  # fmt: skip
    def a_load_at_the_end_is_left_behind(self, run: Run) -> Measurement:
        """50d: the end falls faster than the load on it, which falls freely from the first moment."""
        one = run.again(trigger="pull", sticks=2, inset=0.0, load=0.5, place=-0.8, friction=0.2)
        start = one.specimen.released(one)
        mask = between(one.t, start + 0.01, start + 0.12)
        return acceleration(one.t[mask], one.position("load/block")[mask, 2]), -g

    @law("N₁ + m_top g > F_c", source="J. L. Meriam & L. G. Kraige, Statics, 7th ed., §3/3 (what it bears)",
         within=(5e-3, 5e-3, 3e-3), limited_by="a bracket of a fifth of a per cent")  # fmt: skip
    def an_overloaded_stick_gives_way(self, run: Run) -> Measurement:
        """50e: a cracked stick stands up to its strength, and not above."""
        specimen = StickSupportFail.make(**(self.values() | {"trigger": "overload", "sticks": 2}))
        critical = specimen.bears(0) + specimen.upper * g

        def gives_way(load: float) -> bool:
            one = run.again(trigger="overload", sticks=2, strength=critical / load)
            # rough halves may wedge and hold the board up again, as little as a twentieth of a millimetre lower
            return bool(one.position("board/block")[-1, 2] < one.position("board/block")[0, 2] - 1e-5)

        return threshold(gives_way, 1.0, spread=MARGIN, resolution=2 * MARGIN), 1.0

    @law("E(t) ≤ E(t') for t > t'", source="Landau & Lifshitz, Mechanics, §6 (energy), with dissipative contacts",
         within=(1e-3, 5e-4, 2e-4), limited_by="corners that strike obliquely, see physinone_mj.contact")  # fmt: skip
    def energy_only_falls(self, run: Run) -> Measurement:
        """50f: with a stick that is knocked out, friction and impacts take energy and nothing gives any."""
        one = run.again(trigger="ball")
        rails = one.mass("court/rails") * g * one.position("court/rails")[0, 2]
        energy = one.motion.kinetic + one.motion.potential - rails
        mass = sphere_mass(0.06, 2500.0)
        shaft = (self.height - HEAD) / 2
        weights = self.board * (self.height + BOARD) + self.load * (self.height + 2 * BOARD + self.cube)
        weights += self.sticks * self.density * 8 * THICK**2 * shaft**2 + mass * self.height / 2
        start = g * weights + mass * self.speed**2 / 2
        rise = (energy - np.minimum.accumulate(energy)).max() / energy[0]
        return np.array([1 + rise, energy[0] / start]), np.ones(2)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        cause = {
            "ball": f"a ball at {self.speed:.1f} m/s knocks the first stick away",
            "pull": "the first stick is drawn out from under it in an instant",
            "overload": f"the first stick has a crack that holds up to {self.strength:.0f} N",
            "none": "nothing disturbs them, and the springs under the sticks tell what each of them bears",
        }[self.trigger]
        drop = self.heights(run)[0, 0] - self.heights(run)[-1, 0]
        ends = "comes down and its load slides off" if drop > 0.05 else "stays where it is"
        return (
            f"A wooden board of {self.board:.2g} kg and {self.length:.2f} m lies on {self.sticks} sticks "
            f"{100 * self.height:.0f} cm high, with a cube of {self.load:.2g} kg on it; {cause}. The sticks share "
            f"the weight so that its moments balance. Where one is missing, the board turns about the next, and its "
            f"free end falls faster than a stone would. In the end the board {ends}."
        )
