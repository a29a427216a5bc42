"""34: several mirrors send a laser's beam on from one to the next."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import atan2, cos, floor, hypot, pi, sin, tan
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phenomena import lasers
from phenomena.lasers import BAR, DRIVEN, DRY, EXACT, HAZY, Glide, first_corners, screen, shine, standing_mirror
from physinone_mj import optics
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Mirror, Motor, Scene

Array = NDArray[np.float64]

HEIGHT: Final = 0.6
"""Of the mirrors' middles [m]."""

SMALL: Final = (0.1, 0.1)
"""Half width and half height of a single mirror [m]."""

ABOVE: Final = 0.3
"""How far a screen's board rises over the spot [m]."""

MOST: Final = 64
"""Reflections after which a beam is cut off."""

REACH: Final = 40.0
"""Of the beam [m]."""

RISE: Final = 0.05
"""Of the beam that meets a pair [rad]."""

AWAY, BETWEEN, BEYOND = 1.0, 0.8, 1.9
"""Of a pair: laser to the first mirror, that to the second, that to the screen [m]."""

TIP: Final = np.array([0.0, 0.0, 0.023])
"""Of the corner, in the axes of its table [m]."""

EDGE: Final = 0.3
"""Of the corner's mirrors [m]."""

TABLE: Final = 0.35
"""Height of the corner's table [m]."""

ASIDE: Final = 0.06
"""How far beside the corner's tip the beam is aimed [m]."""

LEFT_OF_LIGHT: Final = -1.0
"""Azimuth of the laser from the corner [rad]."""

FACES: Final = {"left": (0, 1, 2), "right": (1, 2, 0), "bottom": (2, 0, 1)}
"""Of the corner: which of its axes is the normal of each face; the two others lie in it."""


@dataclass(frozen=True)
class Layout:
    """Where things stand: the beam's start (3,) [m] and direction (3,); middle and normal of each mirror's face, their
    half widths and heights [m]; where the screen is to catch the beam (3,) and half its width [m]."""

    mouth: Array
    way: Array
    middles: Array
    normals: Array
    size: tuple[float, float]
    target: Array
    half: float


class FixedArrayRedirect(Phenomenon, domain="optics"):
    """Laser is reflected by several mirrors in turn, which route it to a screen; one of them is slowly turned."""

    arrangement: Annotated[
        Literal["route", "zigzag", "pair", "corner"],
        Choice("mirrors in two rows; two long parallel ones; two at an angle; three at right angles"),
    ] = "route"
    mirrors: Annotated[int, Param("1", 2, 8, "on the route")] = 5
    spread: Annotated[float, Param("m", 0.3, 0.8, "half the distance between the rows of the route")] = 0.45
    step: Annotated[float, Param("m", 0.25, 0.5, "of the route along the rows, from one mirror to the next")] = 0.35
    pattern: Annotated[int, Param("1", 0, 9999, "seed of the mirrors' places on the route")] = 3
    angle: Annotated[float, Param("rad", 0.3, 0.9, "of the beam, from the normal of the first of two; or its descent "
                                                   "into the corner")] = 0.7  # fmt: skip
    dihedral: Annotated[float, Param("rad", 0.6, 2.2, "between the mirrors of the pair")] = 1.0
    gap: Annotated[float, Param("m", 0.1, 0.5, "between the parallel mirrors")] = 0.25
    length: Annotated[float, Param("m", 0.4, 1.2, "of the parallel mirrors")] = 1.0
    turn: Annotated[float, Param("rad", 0.01, 0.1, "of the last mirror, or of the corner; of parallel ones, divided by "
                                                   "how often the beam meets it")] = 0.05  # fmt: skip

    @property
    def advance(self) -> float:
        """Of the beam along the parallel mirrors, from one reflection to the next [m]."""
        return self.gap * tan(self.angle)

    @property
    def reflections(self) -> int:
        """Between the parallel mirrors, entering half an advance behind their edge."""
        return floor(self.length / self.advance + 0.5)

    @property
    def glide(self) -> Glide:
        """Of the mirror that is turned."""
        parts = max(1, self.reflections // 2) if self.arrangement == "zigzag" else 1
        return Glide(self.turn / parts)

    @cached_property
    def layout(self) -> Layout:
        """Where everything stands at the start."""
        arrange = {"route": self.route, "zigzag": self.zigzag, "pair": self.pair, "corner": self.corner}
        return arrange[self.arrangement]()

    def route(self) -> Layout:
        """Mirrors in two rows along x, each facing half-way between the one before and the one after."""
        n = self.mirrors
        if n < 1:
            raise Refusal("R12", f"mirrors = {n}: nothing to reflect the beam; allowed: 1 or more")
        k = np.arange(n + 2)
        places = np.stack([k * self.step, np.where(k % 2, 0.0, -2 * self.spread), np.full(n + 2, HEIGHT)], axis=1)
        places[1 : n + 1] += np.random.default_rng(self.pattern).uniform(-0.05, 0.05, (n, 3))
        legs = np.diff(places, axis=0)
        ways = legs / np.linalg.norm(legs, axis=1, keepdims=True)
        bisect = np.diff(ways, axis=0)
        normals = bisect / np.linalg.norm(bisect, axis=1, keepdims=True)
        far = 1.6 * float(np.linalg.norm(legs[-1]))
        target = places[n] + far * about_z(ways[-1], self.turn)
        return Layout(places[0], ways[0], places[1 : n + 1], normals, SMALL, target, 0.12 + 1.3 * self.turn * far)

    def zigzag(self) -> Layout:
        """Two long mirrors that face each other across y; the beam runs along x."""
        i, n = self.angle, self.reflections
        last = (n - 0.5) * self.advance
        self.refuse_edges(last)
        leg = self.gap / cos(i)
        rise = 0.06 / (n * leg)
        level = np.array([sin(i), cos(i), 0.0])
        way = np.array([*(cos(rise) * level[:2]), sin(rise)])
        before = (self.gap + 0.6) / cos(i)
        first = np.array([self.advance / 2, 0.0, HEIGHT - 0.03])
        out = level * (1.0, -1.0, 0.0) if n % 2 else level
        end = np.array([last, 0.0 if n % 2 else -self.gap, HEIGHT + 0.03])
        after = (self.gap + 0.7) / cos(i)
        middles = np.array([[self.length / 2, 0.0, HEIGHT], [self.length / 2, -self.gap, HEIGHT]])
        normals = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
        return Layout(first - before * way, way, middles, normals, (self.length / 2, 0.1), end + after * out, 0.3)

    def refuse_edges(self, last: float) -> None:
        """A beam that enters, is last reflected, or leaves too near an edge would meet the frame."""
        in_time = last <= self.length - 0.02 and last + self.advance >= self.length + BAR + 0.02
        if self.reflections >= 2 and (in_time or self.reflections > MOST) and self.advance / 2 > BAR + 0.01:
            return
        fits = max(2, self.reflections) * self.advance
        raise Refusal("R12", f"length = {self.length:.3g} m, gap = {self.gap:.3g} m: the beam meets the frame of a "
                      f"mirror; allowed here: a length of {fits:.3g} m, and a gap of "
                      f"{2 * (BAR + 0.01) / tan(self.angle):.3g} m or more")  # fmt: skip

    def pair(self) -> Layout:
        """Two mirrors at an angle, one behind the other: n₂ is n₁ turned by the dihedral less half a turn."""
        i, a = self.angle, self.dihedral
        if abs(a - i) > 1.2:
            raise Refusal("R12", f"dihedral = {a:.3g} rad: the beam would graze the second mirror; "
                          f"allowed here: {max(i - 1.2, 0.6):.3g} to {i + 1.2:.3g} rad")  # fmt: skip
        way = level_way(pi / 2 - i, RISE)
        first = np.array([0.0, 0.0, HEIGHT])
        second = first + BETWEEN * level_way(i - pi / 2, RISE)
        normals = np.array([level_way(-pi / 2), level_way(a + pi / 2)])
        target = second + BEYOND * level_way(pi / 2 - i + 2 * a + self.turn, RISE)
        layout = Layout(first - AWAY * way, way, np.array([first, second]), normals, SMALL, target,
                        0.12 + 1.3 * self.turn * BEYOND)  # fmt: skip
        self.refuse_crowding(layout)
        return layout

    def refuse_crowding(self, layout: Layout) -> None:
        """Where laser, mirrors and screen would be in one another's light."""
        first, second = layout.middles
        rear = layout.mouth - 0.2 * layout.way
        wide, half = SMALL[0] + 0.06, layout.half + 0.1
        out = layout.target - second
        swung = [second + about_z(out, side * self.turn) for side in (-1, 1)]
        crowded = any(
            apart(point, a, b) < room
            for a, b, blockers in (
                (layout.mouth, first, ((second, wide), (layout.target, half))),
                (first, second, ((layout.target, half), (layout.mouth, 0.12), (rear, 0.12))),
                *((second, end, ((first, wide), (layout.mouth, 0.12), (rear, 0.12))) for end in swung),
                (layout.mouth, rear, ((layout.target, half), (second, wide))),
            )
            for point, room in blockers
        )
        if crowded:
            raise Refusal("R12", f"dihedral = {self.dihedral:.3g} rad, angle = {self.angle:.3g} rad: laser, mirrors, "
                          f"screen are in each other's light; allowed: a dihedral near 1 rad")  # fmt: skip

    def corner(self) -> Layout:
        """The corner on its table; the beam comes down into it, beside its tip, and goes back beside itself."""
        towards = level_way(LEFT_OF_LIGHT)
        across = np.array([-towards[1], towards[0], 0.0])
        way = -cos(self.angle) * towards - np.array([0.0, 0.0, sin(self.angle)])
        tip = np.array([0.0, 0.0, TABLE]) + TIP
        mouth = tip + ASIDE * across - 1.3 * way
        back = (1.3 * cos(self.angle) + 0.45) / cos(self.angle)
        nothing = np.zeros((0, 3))
        return Layout(mouth, way, nothing, nothing, SMALL, tip - ASIDE * across - back * way, 0.3)

    def build(self, scene: Scene) -> None:
        """Laser, mirrors, one of them on a motor, and the screen."""
        scene.fps = 60
        layout = self.layout
        if self.arrangement == "corner":
            turning = self.place_corner(scene)
        else:
            for k, (middle, normal) in enumerate(zip(layout.middles, layout.normals, strict=True)):
                part = standing_mirror(scene, f"mirror{k}", middle, normal, layout.size)
                foot = part.geom("foot")
                foot.size[0] = min(foot.size[0], self.gap / 2) if self.arrangement == "zigzag" else foot.size[0]
            turning = lasers.swivel(part)
        scene.motors.append(Motor(turning, self.glide.course))
        shine(scene, layout.mouth, layout.way, bounces=MOST, reach=REACH)
        x, y, z = layout.target.tolist()
        from_ = layout.middles[-1] if len(layout.middles) else layout.mouth
        facing = (from_[0] - x, from_[1] - y)
        if self.arrangement == "zigzag":
            facing = (-sin(self.angle), cos(self.angle) * (1 if self.reflections % 2 else -1))
        elif self.arrangement == "corner":
            facing = (-cos(LEFT_OF_LIGHT), -sin(LEFT_OF_LIGHT))
        screen(scene, (x, y), facing, (layout.half, z + ABOVE), name="screen")
        scene.resolve(time=0.5, length=0.1, duration=5.0)

    def place_corner(self, scene: Scene) -> str:
        """The corner's diagonal towards the laser; returns the name of its joint."""
        part = scene.add("corner_mirror", "corner")
        heading = LEFT_OF_LIGHT - pi / 4
        part.body("corner").quat = lasers.turned(heading)
        for body in ("stand", "corner"):
            part.body(body).pos[2] = TABLE
            scene.material(part.name(body), 2500.0, DRY)
        for face, (axis, _, _) in FACES.items():
            x, y, z = np.eye(3)[axis].tolist()
            scene.mirrors.append(Mirror(part.name(face), (0.0, 0.0, float(TIP[2])), (x, y, z)))
        return part.name("axle")

    def faces(self, run: Run) -> list[tuple[str, Array, Array, tuple[float, float]]]:
        """Of every mirror, from the recorded poses: its geom, middle of the silvered face (T, 3) [m], axes (T, 3, 3)
        with the normal as the first column, half sizes along the others [m]."""
        if self.arrangement == "corner":
            turn = quaternion_matrix(run.quaternion("corner/corner"))
            half, found = EDGE / 2, []
            for face, axes in FACES.items():
                middle = TIP + half * (np.arange(3) != axes[0])
                found.append((f"corner/{face}", run.position("corner/corner") + turn @ middle, turn[:, :, axes],
                              (half, half)))  # fmt: skip
            return found
        found = []
        for k in range(len(self.layout.middles)):
            middle, _ = lasers.silvered_faces(run, f"mirror{k}/mirror")
            axes_of = quaternion_matrix(run.quaternion(f"mirror{k}/mirror"))
            found.append((f"mirror{k}/glass", middle, axes_of, self.layout.size))
        return found

    def due(self, run: Run) -> tuple[Array, NDArray[np.int32], Array, NDArray[np.bool_]]:
        """What the planes of the mirrors say: corners (T, K, 3) of the beam on them, NaN after the last [m]; their
        geoms (T, K), NO_RAY after the last; the direction (T, 3) in which it leaves; whether it keeps off every edge.
        """
        faces, count = self.faces(run), len(run)
        place, way = np.tile(self.layout.mouth, (count, 1)), np.tile(self.layout.way, (count, 1))
        sure, alive = np.ones(count, bool), np.ones(count, bool)
        corners: list[Array] = []
        order: list[NDArray[np.int32]] = []
        while alive.any() and len(corners) <= MOST:
            nearest, who = np.full(count, np.inf), np.full(count, optics.NO_RAY, np.int32)
            hazy = np.full(count, np.inf)
            normal = np.zeros((count, 3))
            for geom, middle, axes, half in faces:
                slope = np.einsum("ti,ti->t", way, axes[:, :, 0])
                with np.errstate(divide="ignore", invalid="ignore"):
                    far = np.einsum("ti,ti->t", middle - place, axes[:, :, 0]) / slope
                    aside = np.einsum("tij,ti->tj", axes[:, :, 1:], place + far[:, None] * way - middle)
                over = (np.abs(aside) - half).max(axis=1)  # beyond the edge
                ahead = alive & (far > 1e-7)
                closer = ahead & (over < 0) & (far < nearest)
                nearest[closer], normal[closer] = far[closer], axes[closer, :, 0]
                who[closer] = np.where(slope[closer] < 0, run.model.geom(geom).id, optics.NOTHING)
                if self.arrangement != "corner":
                    near_edge = ahead & (np.abs(over) < HAZY)
                    hazy[near_edge] = np.minimum(hazy, far)[near_edge]
            sure &= ~(np.isfinite(hazy) & (hazy <= nearest))
            alive &= who >= 0
            if alive.any():
                place = np.where(alive[:, None], place + np.where(alive, nearest, 0.0)[:, None] * way, place)
                way = np.where(alive[:, None], lasers.reflected(way, normal), way)
                corners.append(np.where(alive[:, None], place, np.nan))
                order.append(np.where(alive, who, optics.NO_RAY))
        return np.stack(corners, axis=1), np.stack(order, axis=1), way, sure

    def on_mirrors(self, run: Run) -> tuple[Array, NDArray[np.int32], Array]:
        """Of the traced beam: its corners on silver (T, K, 3), their geoms (T, K), and its last direction (T, 3)."""
        rays = optics.trace(run, "laser")
        silver = np.isin(rays.geoms, [run.model.geom(geom).id for geom, *_ in self.faces(run)])
        corners = np.where(silver[:, :, None], rays.points[:, 1:], np.nan)
        pieces = lasers.pieces(rays).astype(int)
        rows = np.arange(len(run))
        last = rays.points[rows, pieces] - rays.points[rows, pieces - 1]
        return corners, np.where(silver, rays.geoms, optics.NO_RAY), last / np.linalg.norm(last, axis=1, keepdims=True)

    @observable("m")
    def beam_path(self, run: Run) -> Array:
        """Where the beam starts, is reflected and ends (T, K, 3)."""
        return lasers.path(optics.trace(run, "laser"))

    @observable("1")
    def reflected_times(self, run: Run) -> Array:
        """How many mirrors the beam has met (T,)."""
        return np.asarray((self.on_mirrors(run)[1] >= 0).sum(axis=1), float)

    @observable("1")
    def direction_out(self, run: Run) -> Array:
        """Direction (T, 3) of the last piece of the beam."""
        return self.on_mirrors(run)[2]

    @observable("1")
    def cut_off(self, run: Run) -> Array:
        """1 where the beam was followed no further after its greatest number of reflections (T,)."""
        return optics.trace(run, "laser").truncated.astype(float)

    def arranged(self, run: Run, arrangement: str) -> Run:
        """The run, or a twin with the mirrors arranged so; NotEvaluated if its parameters are refused."""
        if self.arrangement == arrangement:
            return run
        try:
            return run.again(arrangement=arrangement)
        except Refusal as why:
            raise NotEvaluated(str(why)) from None

    @law("δ = 2 A", source="Euclid, Catoptrics, prop. 1; two reflections are a rotation by twice the angle",
         within=(1e-7, 1e-9, 1e-9), unit="rad", limited_by=DRIVEN)  # fmt: skip
    def pair_turns_the_beam_by_twice_its_angle(self, run: Run) -> Measurement:
        """34a: change of the beam's azimuth by two mirrors at an angle that is slowly opened; and of rays that meet the
        first of them at other angles. Differences from the angle due, on the circle."""
        twin = self.arranged(run, "pair")
        opened = self.dihedral + twin.specimen.glide.place(twin.t)
        corners, order, out = twin.specimen.on_mirrors(twin)
        twice = (order >= 0).sum(axis=1) == 2
        start = pi / 2 - self.angle
        turned = [np.where(twice, np.arctan2(out[:, 1], out[:, 0]) - start, np.nan)]
        due = [2 * opened]
        for aside in (-0.03, 0.02, 0.03):
            way = level_way(start - aside, RISE)
            for i in (0, len(twin) - 1):
                ray = lasers.probe(twin, i, corners[i, 0] - 0.5 * way, way)
                end = ray.points[-1] - ray.points[-2]
                right = len(ray.geoms) == 3
                turned.append(np.array([atan2(end[1], end[0]) - start + aside if right else np.nan]))
                due.append(2 * opened[i : i + 1])
        off = np.concatenate(turned) - np.concatenate(due)
        return np.angle(np.exp(1j * off)), np.zeros(len(off))

    @law("d' = -d", source="Born & Wolf, Principles of Optics, §3.2.2; three reflections in orthogonal planes are -1",
         within=(1e-9, 1e-9, 1e-9), unit="rad", limited_by=EXACT)  # fmt: skip
    def corner_sends_the_beam_back(self, run: Run) -> Measurement:
        """34b: direction after three mirrors at right angles, however they are turned together."""
        twin = self.arranged(run, "corner")
        _, order, out = twin.specimen.on_mirrors(twin)
        all_three = np.array([len(set(row[row >= 0])) == 3 for row in order]) & ((order >= 0).sum(axis=1) == 3)
        back = np.array([cos(self.angle) * cos(LEFT_OF_LIGHT), cos(self.angle) * sin(LEFT_OF_LIGHT), sin(self.angle)])
        return np.where(all_three[:, None], out, np.nan), np.broadcast_to(back, out.shape)

    @law("Δx = g tan i, N = ⌊L/(g tan i) + ½⌋", source="Euclid, Catoptrics, prop. 1; similar triangles",
         within=(1e-9, 1e-9, 1e-9), limited_by=EXACT)  # fmt: skip
    def parallel_mirrors_hand_the_beam_along(self, run: Run) -> Measurement:
        """34c: how often two parallel mirrors reflect it (all of that, until it is cut off), and its advance from each
        reflection to the next in units of what is due, at the start."""
        twin = self.arranged(run, "zigzag")
        rays = optics.trace(twin, "laser")
        _, order, _ = twin.specimen.on_mirrors(twin)
        corners, _ = first_corners(rays, rays.geoms.shape[1])
        most = min(self.reflections, MOST + 1)
        met = int((order[0] >= 0).sum())
        along = np.diff(corners[0, 1 : most + 1, 0])
        found = [met, rays.truncated[0], *(along / self.advance), *np.full(most - 1 - len(along), np.nan)]
        return found, [most, self.reflections > MOST, *np.ones(most - 1)]

    @law("d' = Π (I - 2 n_k n_kᵀ) d", source="Euclid, Catoptrics, prop. 1; Born & Wolf, Principles of Optics, §3.2.2",
         within=(1e-9, 1e-9, 1e-9), unit="rad", limited_by=EXACT)  # fmt: skip
    def every_mirror_reflects_in_its_turn(self, run: Run) -> Measurement:
        """34d: direction in which the beam leaves the last mirror, from the mirrors' recorded poses; NaN unless it has
        met the right ones in the right order. Where it ought to come near an edge, it is not asked."""
        _, order, way, sure = self.due(run)
        _, met, out = self.on_mirrors(run)
        right = same_rows(order, met)
        if not sure.any():
            raise NotEvaluated("the beam is never clear of the mirrors' edges")
        return np.where(right[:, None], out, np.nan)[sure], way[sure]

    @law("r_k = r + d (p_k - r)·n_k/(d·n_k)", source="Born & Wolf, Principles of Optics, §3.2.1; geometry of planes",
         within=(1e-8, 1e-8, 1e-8), unit="m", limited_by=EXACT)  # fmt: skip
    def corners_lie_on_the_mirrors(self, run: Run) -> Measurement:
        """34d: where the beam is reflected, from the mirrors' recorded poses; nearest first."""
        corners, order, _, sure = self.due(run)
        found, met, _ = self.on_mirrors(run)
        right = same_rows(order, met)
        if not sure.any():
            raise NotEvaluated("the beam is never clear of the mirrors' edges")
        count = min(corners.shape[1], found.shape[1])
        there = (order[:, :count] >= 0)[:, :, None]
        right_ones = np.where(right[:, None, None], found[:, :count], np.nan)
        return np.where(there, right_ones, 0.0)[sure], np.where(there, corners[:, :count], 0.0)[sure]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        rays = optics.trace(run, "laser")
        times = self.reflected_times(run).astype(int)
        shift = np.linalg.norm(rays.ends[-1] - rays.ends[0])
        what = {
            "route": f"{self.mirrors} framed mirrors in two rows, each facing half-way between its neighbours",
            "zigzag": f"two long parallel mirrors {100 * self.gap:.0f} cm apart, between which it runs to and fro",
            "pair": f"two mirrors that stand at {np.degrees(self.dihedral):.0f}° to each other, which turn it by twice "
            "that angle whatever the direction it comes from",
            "corner": "three mirrors at right angles, the inside of a cube's corner, which send it back whence it came",
        }[self.arrangement]
        turned = (
            "the corner is slowly turned, yet the beam goes back as before"
            if self.arrangement == "corner"
            else f"the last mirror is slowly turned, and the beam's end moves {100 * shift:.0f} cm"
        )
        cut = " It is followed no further than that." if rays.truncated[0] else ""
        return (
            f"A laser shines on {what}. At every mirror the beam leaves at the angle at which it came, so that it is "
            f"reflected {times[0]} times, nearest mirror first, before it falls on a white screen.{cut} From "
            f"{self.glide.start:.1f} to {self.glide.stop:.1f} s {turned}."
        )


def level_way(azimuth: float, rise: float = 0.0) -> Array:
    """Unit vector (3,) along an azimuth and above the level [rad]."""
    return np.array([cos(azimuth) * cos(rise), sin(azimuth) * cos(rise), sin(rise)])


def about_z(vector: ArrayLike, angle: float) -> Array:
    """A vector (3,) turned about the vertical [rad]."""
    x, y, z = np.asarray(vector, float)
    return np.array([x * cos(angle) - y * sin(angle), x * sin(angle) + y * cos(angle), z])


def apart(point: Array, start: Array, end: Array) -> float:
    """Distance of a point from a line between two others, seen from above [m]."""
    along, out = (end - start)[:2], (point - start)[:2]
    part = np.clip(out @ along / (along @ along), 0, 1)
    return hypot(*(out - part * along))


def same_rows(first: NDArray[np.int32], second: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether two sequences (T, any) are the same but for what comes after their ends."""
    wide = max(first.shape[1], second.shape[1])
    padded = [np.pad(x, ((0, 0), (0, wide - x.shape[1])), constant_values=optics.NO_RAY) for x in (first, second)]
    return np.asarray((padded[0] == padded[1]).all(axis=1))
