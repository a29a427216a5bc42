"""A dry wall of wooden blocks: it stands by itself, and falls when a ball strikes it or a block is pulled out."""

from __future__ import annotations

from math import atan, cos, hypot, pi, sin, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

from .parts import ball, court, sphere_mass

GAP: Final = 1e-4
"""Between neighbours of one row [m]: blocks whose sides touch would bear on each other."""

MOST: Final = 110
SLENDER: Final = 3.0
"""Height over width of the single block that the laws of toppling are held against."""

MARGIN: Final = 0.002
"""What must hold is this much below its threshold, what must go this much above (of the threshold)."""

Array = NDArray[np.float64]


class BlockWallCollapse(Phenomenon, domain="mechanics"):
    """Wall composed of square blocks collapses."""

    layout: Annotated[
        Literal["wall", "tower", "block", "slope"],
        Choice("wall in bond; tower whose blocks stick out; one block that a ball strikes; one block on a slope"),
    ] = "wall"
    trigger: Annotated[Literal["ball", "pull", "none"], Choice("what brings the wall down")] = "ball"
    rows: Annotated[int, Param("1", 3, 10, "of the wall; at most 6 blocks of the tower")] = 4
    columns: Annotated[int, Param("1", 3, 10, "blocks in a row of the wall")] = 3
    bond: Annotated[Literal["running", "stacked"], Choice("rows shifted by half a block, or columns")] = "running"
    size: Annotated[float, Param("m", 0.06, 0.20, "edge of a block")] = 0.12
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "blocks")] = 700.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "of every surface")] = 0.6
    restitution: Annotated[float, Param("1", 0.0, 0.5, "of every surface")] = 0.2
    radius: Annotated[float, Param("m", 0.05, 0.12, "ball")] = 0.09
    weight: Annotated[float, Param("1", 0.3, 20.0, "mass of the ball over that of a block")] = 5.0
    speed: Annotated[float, Param("m/s", 0.5, 6.0, "of the ball at the wall, or of the block that is pulled out")] = 5.0
    overhang: Annotated[float, Param("m", 0.0, 0.25, "of the tower's top block over its lowest one")] = 0.11
    tilt: Annotated[float, Param("rad", 0.05, 0.8, "of the slope")] = 0.25
    slenderness: Annotated[float, Param("1", 1.0, 4.0, "height over width of the single block")] = 3.0

    @property
    def mass(self) -> float:
        """Of a whole block [kg]."""
        return self.density * self.size**3

    @property
    def yard(self) -> float:
        """Half the side of the square of rails that keeps ball and blocks [m]."""
        return max(1.2, 0.8 * self.columns * self.size)

    @property
    def surface(self) -> Surface:
        """Of blocks, ball and ground alike."""
        return Surface(friction=self.friction, restitution=self.restitution)

    @property
    def tall(self) -> tuple[float, float, float]:
        """Of the single block: mass [kg], height [m], and inertia about the edge over which it topples [kg m²]."""
        height = self.slenderness * self.size
        mass = self.mass * self.slenderness
        return mass, height, mass * (self.size**2 + height**2) / 3

    @property
    def widest(self) -> float:
        """Overhang at which the tower falls [m]: half an edge times 1 + 1/2 + 1/3 ..."""
        return self.size / 2 * sum(1 / k for k in range(1, min(self.rows, 6)))

    @property
    def percussion(self) -> float:
        """Height at which a blow on the single block asks nothing of the friction at its foot [m]."""
        mass, height, inertia = self.tall
        return 2 * inertia / (mass * height)

    @property
    def toppling_speed(self) -> float:
        """Of the ball, with which the single block just stands on its edge [m/s]."""
        mass, height, inertia = self.tall
        rate = sqrt(mass * g * (hypot(self.size, height) - height) / inertia)
        blow = (1 + self.restitution) / (1 / (self.weight * self.mass) + self.percussion**2 / inertia)
        return rate * inertia / (blow * self.percussion)

    def block(self, scene: Scene, name: str, half: Array, place: Array, shade: float, turn: float = 0.0) -> None:
        """One loose block, turned about the y axis."""
        part = scene.add("brick", name)
        geom = part.geom("block")
        geom.size[:], geom.mass = half, self.density * 8 * float(np.prod(half))
        geom.rgba = (0.86 - 0.25 * shade, 0.63 - 0.27 * shade, 0.40 - 0.24 * shade, 1.0)
        scene.start[part.name("free")] = free_pose(place, (cos(turn / 2), 0.0, sin(turn / 2), 0.0))
        scene.material(part.name("block"), self.density, self.surface)

    def build(self, scene: Scene) -> None:
        """Blocks, and the ball if there is one."""
        scene.material("stage/floor", 2000.0, self.surface)
        bodies = {"wall": self.wall, "tower": self.tower, "block": self.single, "slope": self.slope}[self.layout](scene)
        scene.touch("stage/floor", *bodies)
        calm = self.layout != "wall" or self.trigger == "none"
        scene.resolve(time=2 * sqrt(self.size / g), length=self.size, duration=10.0 if self.layout == "wall" and calm
                      else 3.0 if calm else 4.0)  # fmt: skip

    def wall(self, scene: Scene) -> list[str]:
        """Rows on rows; in running bond every other row begins and ends with half a block."""
        if self.rows * self.columns > MOST:
            raise Refusal("R10", f"{self.rows * self.columns} blocks; allowed: {MOST}")
        half, bodies = self.size / 2, []
        for name, place, width in self.plan():
            shade = (int(1e4 * (place[0] + 3 * place[2])) % 7) / 6
            self.block(scene, name, np.array([width / 2, half, half]), place, shade)
            bodies.append(f"{name}/block")
        if self.trigger == "pull":
            scene.speed["row0_0/free"] = (-self.speed, 0, 0, 0, 0, 0)
        elif self.trigger == "ball":
            high = max(0.62 * self.rows * self.size, 1.2 * self.radius)
            bodies.append(self.throw(scene, high, -half, self.yard - 0.35))
        if self.trigger != "none":
            rails = court(scene, self.yard, self.surface)
            for body in bodies:
                scene.touch(body, rails.name("rails"))
        return bodies

    def plan(self) -> list[tuple[str, Array, float]]:
        """Name, centre [m] and width [m] of every block of the wall."""
        pitch, half, blocks = self.size + GAP, self.size / 2, []
        for row in range(self.rows):
            shifted = self.bond == "running" and row % 2 == 1
            widths = [half, *[self.size] * (self.columns - 1), half] if shifted else [self.size] * self.columns
            left = -self.columns * pitch / 2
            for column, width in enumerate(widths):
                room = width + (GAP / 2 if width < self.size else GAP)
                place = np.array([left + room / 2, 0.0, half + row * self.size])
                blocks.append((f"row{row}_{column}", place, width))
                left += room
        return blocks

    def throw(self, scene: Scene, height: float, face: float, distance: float) -> str:
        """The ball, thrown so that it flies level when it meets the face at y = `face` [m] at a height [m]."""
        fall = height - self.radius
        time = min(distance / self.speed, sqrt(1.9 * max(fall, 1e-6) / g))
        body = ball(scene, "ball", self.radius, self.weight * self.mass / sphere_mass(self.radius, 1.0), self.surface,
                    (0.25, 0.33, 0.62))  # fmt: skip
        place = (0.0, face - self.radius - self.speed * time, height - g * time**2 / 2)
        scene.start[body.name("free")] = free_pose(place)
        scene.speed[body.name("free")] = (0.0, self.speed, g * time, 0, 0, 0)
        return body.name("ball")

    def tower(self, scene: Scene) -> list[str]:
        """Each block sticks out over the one below in proportion to what would just be too much: half its edge over
        the number of blocks that it bears and itself."""
        count, x, bodies = min(self.rows, 6), 0.0, []
        harmonic = self.widest / (self.size / 2)
        for row in range(count):
            name, half = f"row{row}_0", self.size / 2
            self.block(scene, name, np.full(3, half), np.array([x, 0.0, half + row * self.size]), row / (count - 1))
            if row < count - 1:
                x += self.overhang / (count - 1 - row) / harmonic
            bodies.append(f"{name}/block")
        return bodies

    def single(self, scene: Scene) -> list[str]:
        """One upright block, struck at the height of percussion."""
        _, height, _ = self.tall
        if self.percussion + 0.2 * self.size > height:
            raise Refusal("R12", f"slenderness = {self.slenderness:.3g}: the blow would pass over the block; allowed: "
                          f"{2.0:.3g} or more")  # fmt: skip
        half = self.size / 2
        self.block(scene, "row0_0", np.array([half, half, height / 2]), np.array([0.0, 0.0, height / 2]), 0.2)
        return ["row0_0/block", self.throw(scene, self.percussion, -half, 0.3)]

    def slope(self, scene: Scene) -> list[str]:
        """One upright block on a tilted plank."""
        _, height, _ = self.tall
        plank = scene.add("plank")
        reach = 1.0
        up, normal = np.array([cos(self.tilt), 0, sin(self.tilt)]), np.array([-sin(self.tilt), 0, cos(self.tilt)])
        plank.body("plank").pos[:2] = (-reach / 2, 0.0)
        plank.body("plank").quat[:] = (cos(self.tilt / 2), 0.0, -sin(self.tilt / 2), 0.0)
        top = 0.03 + 0.9 * reach * sin(self.tilt) - 0.04 / cos(self.tilt)
        plank.body("post").pos[:] = (-reach / 2 + 0.9 * reach * cos(self.tilt), 0.0, top / 2)
        plank.geom("post").size[2] = top / 2
        scene.material(plank.name("plank"), 700.0, self.surface)
        scene.material(plank.name("post"), 700.0, self.surface)
        place = np.array([-reach / 2, 0.0, 0.03]) + 0.6 * reach * up + height / 2 * normal
        self.block(scene, "row0_0", np.array([self.size / 2, self.size / 2, height / 2]), place, 0.2, -self.tilt)
        scene.touch("row0_0/block", plank.name("plank"))
        return ["row0_0/block"]

    @staticmethod
    def blocks(run: Run) -> list[str]:
        """Names of the blocks."""
        return [name for name in run.bodies() if name.startswith("row")]

    def moved(self, run: Run) -> Array:
        """How far each block is from where it was put (T, n) [m]."""
        paths = [run.position(name) for name in self.blocks(run)]
        return np.stack([np.linalg.norm(path - path[0], axis=1) for path in paths], axis=1)

    @staticmethod
    def upright(run: Run, name: str) -> float:
        """Cosine of a block's lean against how it stood, at the end."""
        q, p = run.quaternion(name)[-1], run.quaternion(name)[0]
        turn = 2 * np.arccos(min(abs(float(q @ p)), 1.0))
        return float(cos(turn))

    @observable("m")
    def displacements(self, run: Run) -> Array:
        """How far each block is from where it was put, (T, n)."""
        return self.moved(run)

    @observable("1")
    def fallen(self, run: Run) -> Array:
        """Share of the blocks that have sunk by half a block or more, (T,)."""
        heights = np.stack([run.position(name)[:, 2] for name in self.blocks(run)], axis=1)
        return np.asarray((heights < heights[0] - self.size / 2).mean(axis=1))

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic and potential, of all, (T,)."""
        return run.motion.kinetic + run.motion.potential

    @law("x(t) = x(0)", source="J. Heyman, The Stone Skeleton (1966), §2: thrust within the wall",
         within=(1e-6, 1e-6, 1e-6), unit="m", limited_by="corners settle within nanometres")  # fmt: skip
    def a_wall_stands(self, run: Run) -> Measurement:
        """49a: left alone, no block moves in ten seconds."""
        calm = run if (self.layout, self.trigger) == ("wall", "none") else run.again(layout="wall", trigger="none")
        plan = self.plan()
        where = np.stack([calm.position(f"{name}/block") for name, _, _ in plan], axis=1)
        return where, np.broadcast_to(np.array([place for _, place, _ in plan]), where.shape)

    @law("E(t) ≤ E(t') for t > t'", source="Landau & Lifshitz, Mechanics, §6 (energy), with dissipative contacts",
         within=(1e-3, 5e-4, 2e-4), limited_by="a heap that collides is solved to a centimetre per second")  # fmt: skip
    def energy_only_falls(self, run: Run) -> Measurement:
        """49b: friction and impacts take energy, nothing gives any; relative to the energy at the start."""
        energy = self.energy(run)
        return 1 + (energy - np.minimum.accumulate(energy)).max() / energy[0], 1.0

    @law("Σ m v = const, horizontally", source="Landau & Lifshitz, Mechanics, §7 eq. 7.2",
         within=(1e-9, 1e-9, 1e-9), limited_by="round-off")  # fmt: skip
    def slippery_ground_takes_no_momentum(self, run: Run) -> Measurement:
        """49c: without friction the ball's momentum is shared by all that it strikes, and none is lost."""
        smooth = run.again(layout="wall", trigger="ball", friction=0.0, rows=3, columns=3)
        bodies = [*self.blocks(smooth), "ball/ball"]
        struck = [i.time for i in smooth.impacts if "ball/ball" in (i.first, i.second) and "row" in i.first + i.second]
        if not struck:
            raise NotEvaluated("the ball does not reach the wall")
        rails = [i.time for i in smooth.impacts if "court" in i.first + i.second]
        free = between(smooth.t, struck[0], min(rails, default=float(smooth.t[-1])))
        total = np.sum([smooth.momentum(name)[:, :2] for name in bodies], axis=0)[free]
        thrown = self.weight * self.mass * self.speed
        return total / thrown + [1.0, 0.0], np.ones_like(total)

    @law("½ I ω² > m g (√(b² + H²) - H)/2", source="E. J. Routh, Dynamics of a System of Rigid Bodies I, §171",
         within=(5e-3, 5e-3, 5e-3), limited_by="a bracket of a fifth of a per cent")  # fmt: skip
    def a_block_topples_if_struck_hard_enough(self, run: Run) -> Measurement:
        """49d: one block, struck at its centre of percussion by a light ball that bounces off.

        What the blow leaves goes with the square of the ball's speed, so one run tells which speed is the critical one.
        """
        changes = {"layout": "block", "slenderness": SLENDER, "friction": 0.9, "restitution": 0.4, "weight": 0.3,
                   "size": max(self.size, 1.2 * self.radius)}  # fmt: skip
        probe = BlockWallCollapse.make(**(self.values() | changes))
        mass, height, _ = probe.tall
        struck = run.again(**changes, speed=probe.toppling_speed)
        hits = [i.time for i in struck.impacts if "ball/ball" in (i.first, i.second)]
        after = between(struck.t, hits[0], hits[0] + 0.1)
        rise = struck.position("row0_0/block")[:, 2] - height / 2
        left = (struck.kinetic("row0_0/block") + mass * g * rise)[after].mean()
        critical = probe.toppling_speed * sqrt(mass * g * (hypot(probe.size, height) - height) / 2 / left)

        def topples(speed: float) -> bool:
            return self.upright(run.again(**changes, speed=speed), "row0_0/block") < 0.5

        return threshold(topples, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    @law("Σ d ≤ (b/2) Σ 1/k", source="M. Paterson & U. Zwick, Overhang, Amer. Math. Monthly 116 (2009) 19, eq. 1",
         within=(5e-3, 5e-3, 5e-3), limited_by="a bracket of a fifth of a per cent")  # fmt: skip
    def a_tower_leans_as_far_as_the_harmonic_sum(self, run: Run) -> Measurement:
        """49e: blocks that stick out stand up to half an edge over their number from the top."""

        def falls(overhang: float) -> bool:
            tower = run.again(layout="tower", overhang=overhang, friction=0.9)
            return bool(self.moved(tower).max() > 0.05 * self.size)

        return threshold(falls, self.widest, spread=MARGIN, resolution=2 * MARGIN), self.widest

    @law("tan α = b/H", source="J. L. Meriam & L. G. Kraige, Statics, 7th ed., §6/3 (tipping)",
         within=(5e-3, 5e-3, 5e-3), limited_by="a bracket of a fifth of a per cent")  # fmt: skip
    def a_slope_topples_a_tall_block(self, run: Run) -> Measurement:
        """49f: on a slope that is rough enough."""
        if self.slenderness < 1.3:
            raise NotEvaluated(f"a block {self.slenderness:.3g} times as high as wide slides first; needed: 1.3")

        def topples(tilt: float) -> bool:
            leaning = run.again(layout="slope", friction=0.9, tilt=tilt)
            return self.upright(leaning, "row0_0/block") < 0.5

        critical = atan(1 / self.slenderness)
        return threshold(topples, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    @law("tan α = μ", source="J. L. Meriam & L. G. Kraige, Statics, 7th ed., §6/3 (angle of repose)",
         within=(5e-3, 5e-3, 5e-3), limited_by="a bracket of a fifth of a per cent")  # fmt: skip
    def a_slope_lets_a_cube_slide(self, run: Run) -> Measurement:
        """49f: a cube slides before it topples."""
        if not 0.06 < self.friction < 0.8:
            raise NotEvaluated(f"friction = {self.friction:.3g}; needed: 0.06 to 0.8, the range of the slope")

        def slides(tilt: float) -> bool:
            lying = run.again(layout="slope", slenderness=1.0, tilt=tilt)
            return bool(self.moved(lying).max() > 1e-3)

        critical = atan(self.friction)
        return threshold(slides, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        fell = 100 * self.fallen(run)[-1]
        if self.layout == "tower":
            ends = "falls" if fell > 0 else "stands"
            return (
                f"{min(self.rows, 6)} blocks of {100 * self.size:.0f} cm are put on each other, every one sticking out "
                f"over the one below, {100 * self.overhang:.0f} cm in all, where the harmonic sum allows "
                f"{100 * self.widest:.0f}. Each block bears those above it only while their common centre of mass lies "
                f"over its edge. The tower {ends}."
            )
        if self.layout == "slope":
            gone = "leaves its place" if self.moved(run).max() > 1e-3 else "stays where it is"
            return (
                f"A wooden block {self.slenderness:.1f} times as high as wide stands on a plank tilted by "
                f"{180 / pi * self.tilt:.0f} degrees, with a coefficient of friction of {self.friction:.2f}. It "
                f"topples once the tangent of the tilt exceeds width over height, and slides once it exceeds the "
                f"friction, whichever comes first. This one {gone}."
            )
        ball_ = f"a ball of {self.weight * self.mass:.2g} kg at {self.speed:.1f} m/s"
        if self.layout == "block":
            over = "topples over its far edge" if self.upright(run, "row0_0/block") < 0.5 else "rocks and falls back"
            return (
                f"A single upright block of {self.tall[0]:.2g} kg, {self.slenderness:.1f} times as high as wide, is "
                f"struck by {ball_} at its centre of percussion, where the blow asks nothing of the friction at its "
                f"foot. It turns about its far edge, and must raise its centre of mass over it with the energy of the "
                f"blow. It {over}."
            )
        cause = {"ball": f"is struck by {ball_}", "none": "is left alone",
                 "pull": f"loses a corner block, pulled out at {self.speed:.1f} m/s"}[self.trigger]  # fmt: skip
        return (
            f"A dry wall of {self.rows} rows of {self.columns} wooden blocks, {100 * self.size:.0f} cm wide, in "
            f"{self.bond} bond and held by nothing but weight and a friction of {self.friction:.2f}, {cause}. The blow "
            f"spreads from block to block, energy only falls, and what has lost its support comes down. In the end "
            f"{fell:.0f} per cent of the blocks have fallen by half their height or more."
        )
