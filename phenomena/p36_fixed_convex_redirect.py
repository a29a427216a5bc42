"""36: a fan of parallel beams on a mirror ball that rolls by, or on a mirror column that slides by and turns."""

from __future__ import annotations

from math import pi
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from physinone_mj import optics
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.contact import Surface
from physinone_mj.run import Run
from physinone_mj.scene import Mirror, Motor, Scene, free_pose

from . import dishes
from .dishes import BARREL, BOARD, Bench, slope, spread, traced
from .lasers import DRY, EXACT
from .parts import sphere_mass

Array = NDArray[np.float64]

BAR: Final = 1.9
"""The lasers' mouths before the mirror's path, in its radii."""

ROOM: Final = 2.6
"""From the mirror's path to the wall behind it, in its radii."""

START: Final = 1.3
"""The mirror's middle beside the outermost beam at the start, in its radii, or more if it is fast."""

COLUMN: Final = 0.7
"""Half the height of the column, in its radii; the beams meet it half-way up."""

RAIL: Final = 0.03
"""Height of the column's rail and half that of its carriage, in its radii."""

SILVER: Final = 2500.0
"""Density of ball and column: glass [kg/m³]."""

SURE: Final = 1e-9
"""A beam that passes the mirror within this, in radii, may or may not touch it."""

OFF_AXIS: Final = 0.02
"""Where a beam nearer to the axis than this, in radii, would have crossed it is only known to fewer digits."""

RIM: Final = 1e-3
"""So it is of a beam as near to the rim as this, in radii."""

SLANTING: Final = 0.9
"""Of a beam that passes the mirror's middle farther off than this, in radii, the spot is too fast for its samples."""


class FixedConvexRedirect(Phenomenon, domain="optics"):
    """A convex mirror spreads light: the beams of a fan leave as if they came from behind its surface."""

    mirror: Annotated[
        Literal["ball", "column"], Choice("a ball that rolls by, or a column that slides by and turns")
    ] = "ball"
    radius: Annotated[float, Param("m", 0.05, 1.0, "of the mirror")] = 0.3
    count: Annotated[int, Param("1", 3, 15, "beams")] = 7
    fan: Annotated[float, Param("1", 0.1, 0.95, "half the width of the fan, in radii")] = 0.8
    pace: Annotated[float, Param("1/s", 0.3, 2.0, "speed of the mirror, in radii a second")] = 0.9
    friction: Annotated[float, Param("1", 0.1, 0.9, "between ball and table")] = 0.5

    @property
    def bench(self) -> Bench:
        """The table; the mirror's path is the line x = 0, and the light's plane is that of its middle."""
        r = self.radius
        high = 1.0 if self.mirror == "ball" else 3 * RAIL + COLUMN
        return Bench(-(BAR + BARREL[0] + 0.2) * r, ROOM * r, 1.2 * r - self.first, (BOARD + high) * r, r)

    @property
    def speed(self) -> float:
        """Of the mirror [m/s]."""
        return self.pace * self.radius

    @property
    def first(self) -> float:
        """Where the mirror's middle is at the start, along y [m]; as far beyond, it is two seconds later at least."""
        return -max(self.fan + START, self.pace) * self.radius

    @property
    def watch(self) -> float:
        """How long it is watched [s]: until the mirror has passed all beams, at most 8 s."""
        return min(-2 * self.first / self.speed, 8.0)

    @property
    def beside(self) -> Array:
        """Where the beams run, along y (n,) [m]."""
        return spread(self.fan * self.radius, self.count)

    def build(self, scene: Scene) -> None:
        """Table, lasers, and the mirror on its way."""
        scene.fps = 60
        r, bench = self.radius, self.bench
        scene.material("stage/floor", 2400.0, DRY)
        bench.table(scene)
        bench.lasers(scene, -BAR * r, self.beside)
        if self.mirror == "ball":
            self.place_ball(scene)
        else:
            self.place_column(scene)
        scene.resolve(time=0.3, length=r, duration=self.watch)

    def place_ball(self, scene: Scene) -> None:
        """A ball that rolls over the table."""
        part, r = scene.add("mirror_ball"), self.radius
        geom = part.geom("ball")
        geom.size[0], geom.mass = r, sphere_mass(r, SILVER)
        scene.mirrors.append(Mirror(part.name("ball")))
        scene.material(part.name("ball"), SILVER, Surface(friction=self.friction))
        scene.material("light_table/board", 700.0, Surface(friction=self.friction))
        scene.touch(part.name("ball"), "light_table/board")
        scene.start[part.name("free")] = free_pose((0, self.first, self.bench.plane))
        scene.speed[part.name("free")] = (0, self.speed, 0, -self.pace, 0, 0)

    def place_column(self, scene: Scene) -> None:
        """A column on its carriage, turning as fast as the ball would."""
        part, r, bench = scene.add("mirror_column"), self.radius, self.bench
        part.body("carriage").pos = (0, self.first, bench.plane)
        part.geom("column").size[:2] = r, COLUMN * r
        plate = part.geom("carriage")
        plate.pos, plate.size[:2] = (0, 0, -(COLUMN + RAIL) * r), (1.05 * r, RAIL * r)
        rail = part.geom("rail")
        rail.pos, rail.size = (0, 0, bench.board + RAIL * r / 2), (0.1 * r, bench.half - 0.02 * r, RAIL * r / 2)
        scene.mirrors.append(Mirror(part.name("column")))
        for body, density in (("column", SILVER), ("carriage", 2700.0), ("rail", 7800.0)):
            scene.material(part.name(body), density, DRY)
        for joint, speed in (("slide", self.speed), ("hinge", self.pace)):
            scene.motors.append(Motor(part.name(joint), ((0.0, speed),)))
            scene.speed[part.name(joint)] = speed

    def middle(self, run: Run) -> Array:
        """Of the mirror (T, 3) [m], as recorded."""
        return np.asarray(run.position("mirror_ball/ball" if self.mirror == "ball" else "mirror_column/column"))

    def passes(self, run: Run) -> Array:
        """How far each beam passes beside the mirror's middle, towards +y (T, n) [m]."""
        return np.asarray(self.beside - self.middle(run)[:, 1, None])

    def struck(self, run: Run) -> Array:
        """Distance from the mirror's middle, or the column's axis, at which each beam passes (T, n) [m]."""
        rise = (self.bench.plane - self.middle(run)[:, 2, None]) * (self.mirror == "ball")
        return np.asarray(np.hypot(self.passes(run), rise))

    def spot_speed(self, wall: str, y: Array, beam: float) -> Array:
        """Of the spot on a wall (T,) [m/s], of a beam at a place [m] that passes y (T,) [m] beside the mirror's middle.

        It is met at x = -R cos θ, sin θ = y/R, and leaves along (-cos 2θ, sin 2θ); all that moves is θ.
        """
        theta, r = np.arcsin(y / self.radius), self.radius
        rate = -self.speed / (r * np.cos(theta))
        hit, moves = -r * np.cos(theta), r * np.sin(theta) * rate
        if wall in ("west", "east"):
            far = (self.bench.west if wall == "west" else self.bench.east) - hit
            return np.asarray(moves * np.tan(2 * theta) - far * 2 * rate / np.cos(2 * theta) ** 2)
        far = np.full_like(hit, (self.bench.half if wall == "north" else -self.bench.half) - beam)
        return np.asarray(moves + far * 2 * rate / np.sin(2 * theta) ** 2)

    @observable("m")
    def offsets(self, run: Run) -> Array:
        """Of the beams from the mirror's middle, across them (T, n)."""
        return self.passes(run)

    @observable("rad")
    def deviations(self, run: Run) -> Array:
        """Angle by which each beam is turned (T, n); 0 where it misses the mirror."""
        ways = [(rays.directions(0), rays.directions(1)) for rays in traced(run)]
        angles = [np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)) for a, b in ways]
        return np.asarray(np.nan_to_num(np.stack(angles, axis=1)))

    @observable("m")
    def ends(self, run: Run) -> Array:
        """Where each beam ends (T, n, 3)."""
        return dishes.ends(run)

    @law("x = R/(2 √(1 - y²/R²))", within=(1e-9, 1e-9, 1e-9), limited_by=EXACT,
         source="E. Hecht, Optics, §5.4.3, but exactly: a triangle of equal sides on the radius")  # fmt: skip
    def beams_seem_to_come_from_behind_the_surface(self, run: Run) -> Measurement:
        """36a: from the mirror's middle to where the reflected beams, drawn back, cross the axis parallel to the beams,
        over what it ought to be; NaN for one that ought to be reflected and is not."""
        found, due = [], []
        middle = self.middle(run)
        for rays, off, y in zip(traced(run), self.struck(run).T, self.passes(run).T, strict=True):
            i = np.flatnonzero((off < (1 - RIM) * self.radius) & (np.abs(y) > OFF_AXIS * self.radius))
            if len(i):
                start, way = rays.points[i, 1] - middle[i], rays.directions(1)[i]
                with np.errstate(divide="ignore"):
                    found.append(start[:, 1] / way[:, 1] * way[:, 0] - start[:, 0])
                due.append(self.radius / (2 * np.sqrt(1 - (off[i] / self.radius) ** 2)))
        if not found:
            raise NotEvaluated("no beam meets the mirror off its middle")
        ratio = np.concatenate(found) / np.concatenate(due)
        return ratio, np.ones_like(ratio)

    @law("δ = π - 2 asin(y/R)", source="Euclid, Catoptrics, prop. 1; Newton, Opticks, book I, part I, axiom 2",
         within=(1e-8, 1e-8, 1e-8), unit="rad", limited_by=EXACT)  # fmt: skip
    def deviation_knows_only_how_far_off_the_middle(self, run: Run) -> Measurement:
        """36b: angle between the beam before and after the mirror, whichever way that has turned meanwhile."""
        off = self.struck(run)
        hit = off < (1 - SURE) * self.radius
        if not hit.any():
            raise NotEvaluated("no beam meets the mirror while it is watched")
        return self.deviations(run)[hit], pi - 2 * np.arcsin(off[hit] / self.radius)

    @law("reflected if y < R; else straight on", source="by definition: a sphere or cylinder of radius R",
         within=(1e-9, 1e-9, 1e-9), limited_by=EXACT)  # fmt: skip
    def beams_that_pass_beside_go_straight_on(self, run: Run) -> Measurement:
        """36c: whether each beam is reflected, 1 or 2, at every sample; and where those end that are not, over the
        distance of the wall."""
        off = self.struck(run)
        sure = np.abs(off - self.radius) > SURE * self.radius
        met = np.stack([(rays.geoms > optics.NO_RAY).sum(axis=1) for rays in traced(run)], axis=1)
        hit = off < self.radius
        free = sure & ~hit
        wall = np.stack([np.full_like(off, self.bench.east), np.broadcast_to(self.beside, off.shape)], axis=-1)
        ends = self.ends(run)[..., :2]
        found = np.concatenate([met[sure], ends[free].ravel() / self.bench.east])
        return found, np.concatenate([1 + hit[sure], wall[free].ravel() / self.bench.east])

    @law("ds/dt = v ∂s/∂y of s(y)", source="Euclid, Catoptrics, prop. 1, differentiated; E. Hecht, Optics, §5.4.3",
         within=(1e-4, 1e-4, 1e-4), limited_by="five neighbouring samples stand for a derivative")  # fmt: skip
    def spots_run_as_the_map_of_the_sphere_says(self, run: Run) -> Measurement:
        """36d: speed of each beam's spot along the walls, while the mirror goes by."""
        table = {run.model.geom(f"light_table/{name}").id: name for name in ("west", "east", "south", "north")}
        found, due = [], []
        for rays, y, beam in zip(traced(run), self.passes(run).T, self.beside, strict=True):
            if rays.geoms.shape[1] < 2:
                continue
            wall = np.where(rays.geoms[:, 1] > optics.NO_RAY, rays.geoms[:, 1], optics.NO_RAY)
            same = np.array([wall[2:-2] == wall[i : len(wall) - 4 + i] for i in range(5)]).all(axis=0)
            slow = np.abs(y[2:-2]) < SLANTING * self.radius
            for number, name in table.items():
                i = 2 + np.flatnonzero(same & slow & (wall[2:-2] == number))
                along = 1 if name in ("west", "east") else 0
                found.append(slope(rays.points[:, 2, along, None], i, np.diff(run.t)[i])[:, 0])
                due.append(self.spot_speed(name, y[i], beam))
        if not sum(map(len, found)):
            raise NotEvaluated("no spot stays on one wall for five samples")
        expected = np.concatenate(due)
        size = np.maximum(np.abs(expected), self.speed)  # each by its own: near the rim they are far faster
        return np.concatenate(found) / size, expected / size

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        turned = np.degrees(self.deviations(run))
        what = "mirror ball rolls" if self.mirror == "ball" else "mirror column slides by and turns"
        return (
            f"{self.count} parallel laser beams of different colours cross a table. A {what} through them, "
            f"{100 * self.radius:.0f} cm in radius, at {self.speed:.2g} m/s. Each beam that meets it is turned by π - "
            f"2 asin(y/R), as far as it passes off the middle: by {turned.max():.0f}° at most, back towards its laser, "
            f"and ever less towards the rim, where it grazes the mirror and goes straight on. The reflected beams "
            f"spread as if they came from behind the surface, and their spots run along the walls; that the mirror "
            f"turns while it passes changes nothing."
        )
