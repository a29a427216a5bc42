"""37: a turning or swinging mirror sweeps a laser's beam over a wall and what stands before it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import cos, hypot, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipj, ellipk

from phenomena import lasers
from phenomena.lasers import DRIVEN, DRY, GLASS, HAZY, first_corners, reflected, screen, shine
from phenomena.stands import gallows
from physinone_mj import optics
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.run import Run
from physinone_mj.scene import Mirror, Motor, Scene

Array = NDArray[np.float64]

HEIGHT: Final = 0.7
"""Of the mirror's middle [m]."""

HIGH, WIDE, HUNG = 0.12, 0.2, 0.14
"""Half the height of all mirrors, half the width of one or two on an axle, and of the one that swings [m]."""

AWAY: Final = 1.2
"""Laser from the mirror [m]."""

FIRST: Final = -pi / 3
"""Azimuth of the first facet's normal at the start; -π/4 sends the beam straight to the wall [rad]."""

OBLIQUE: Final = 0.5
"""Incidence on the swinging mirror where it hangs at rest, across its plane of swing [rad]."""

TALLEST: Final = 2.2
"""Height of the wall at most [m]."""

SURE: Final = 2e-3
"""A beam that passes an edge within this may or may not meet it [m]."""

BACKWARDS: Final = np.array([-1.0, -1.0, 1.0])
"""The scene's axes are the mirror's turned by half a turn, so that the light falls on the wall."""

TURNING: Final = 2.6
"""Of a drum that is to turn round at least twice [rad/s]."""


@dataclass(frozen=True)
class Due:
    """What ought to be, in the mirror's axes, from the parameters and the time alone: which facet reflects (T,), -1 for
    none; where (T, 3) and in which direction (T, 3); what the beam then meets (T,), "" for nothing known; and where."""

    facet: NDArray[np.int64]
    hit: Array
    out: Array
    who: NDArray[np.str_]
    end: Array


class DynMirrorRedirect(Phenomenon, domain="optics"):
    """Moving mirror sweeps a laser's beam: it turns twice as fast as the mirror, over a wall and what is before it."""

    carrier: Annotated[
        Literal["motor", "pendulum"], Choice("one or more mirrors on the axle of a motor; one that hangs and swings")
    ] = "motor"
    omega: Annotated[float, Param("rad/s", 0.1, 6.0, "of the motor")] = 0.35
    wall: Annotated[float, Param("m", 0.5, 4.0, "distance of the wall from the axle or the hanging mirror")] = 1.3
    offset: Annotated[float, Param("m", 0.0, 0.2, "of the mirrors' faces from the axle")] = 0.04
    facets: Annotated[int, Param("1", 1, 8, "mirrors on the axle")] = 1
    rise: Annotated[float, Param("rad", 0.0, 0.08, "of the laser's beam")] = 0.04
    swing: Annotated[float, Param("rad", 0.03, 0.2, "of the hanging mirror to either side")] = 0.12
    length: Annotated[float, Param("m", 0.3, 1.0, "from its pivot to its middle")] = 0.6

    @property
    def half_width(self) -> float:
        """Of one facet [m]."""
        return WIDE if self.facets < 3 else self.offset * tan(pi / self.facets)

    @property
    def radius(self) -> float:
        """Of the cylinder that the drum sweeps [m]."""
        return hypot(self.offset, self.half_width)

    @property
    def beside(self) -> float:
        """How far beside the axle the laser is aimed [m]: at many facets where one of them is at 45°."""
        return 0.0 if self.facets < 3 else self.offset / sqrt(2)

    @property
    def source(self) -> tuple[Array, Array]:
        """Where the beam starts (3,) [m] and its direction (3,), in the mirror's axes."""
        c, s = cos(self.rise), sin(self.rise)
        if self.carrier == "motor":
            way, aim = np.array([0.0, c, s]), np.array([self.beside, 0.0, HEIGHT])
        else:
            way, aim = np.array([-cos(OBLIQUE) * c, sin(OBLIQUE) * c, s]), np.array([GLASS, 0.0, HEIGHT])
        return aim - AWAY * way, way

    @property
    def board(self) -> tuple[float, float, float]:
        """Middle of the wall along y, its half width, its height [m]."""
        if self.carrier == "motor":
            return 0.0, 1.2 * self.wall, min(TALLEST, HEIGHT + 0.25 + 1.8 * self.wall * tan(self.rise))
        top = HEIGHT + 0.2 + self.wall / cos(OBLIQUE) * tan(2 * self.swing + self.rise)
        return self.wall * tan(OBLIQUE), 0.3, min(TALLEST, top)

    @property
    def column(self) -> tuple[float, float, float, float]:
        """x, y, radius and height [m]."""
        return 0.7 * self.wall, 0.25 * self.wall, 0.015 + 0.01 * self.wall, self.board[2]

    @property
    def ball(self) -> tuple[Array, float]:
        """Middle (3,) and radius [m]."""
        r, x = 0.02 + 0.015 * self.wall, 0.6 * self.wall
        if self.carrier == "motor":
            return np.array([x, -0.3 * self.wall, HEIGHT + 0.67 * self.wall * tan(self.rise)]), r
        return np.array([x, x * tan(OBLIQUE) + 0.7 * r, HEIGHT + x / cos(OBLIQUE) * tan(self.rise + self.swing / 2)]), r

    def build(self, scene: Scene) -> None:
        """Laser, moving mirror, the wall, and what stands before it."""
        scene.fps = 60
        if self.carrier == "motor":
            self.place_drum(scene)
            time = min(0.5, 0.5 / self.omega)
        else:
            self.place_pendulum(scene)
            time = sqrt(self.length / g)
        mouth, way = self.source
        shine(scene, mouth * BACKWARDS, way * BACKWARDS)
        middle, half, top = self.board
        screen(scene, (-self.wall, -middle), (1.0, 0.0), (half, top), name="wall")
        things = scene.add("obstacles")
        (x, y, wide, high), (place, radius) = self.column, self.ball
        things.body("column").pos = (-x, -y, 0)
        things.geom("column").fromto, things.geom("column").size[0] = (0, 0, 0, 0, 0, high), wide
        things.body("ball").pos = (-place[0], -place[1], 0)
        things.geom("ball").pos[2], things.geom("ball").size[0] = place[2], radius
        things.geom("stem").fromto = (0, 0, 0, 0, 0, place[2])
        for body in ("column", "ball"):
            scene.material(things.name(body), 700.0, DRY)
        if self.carrier == "pendulum":
            scene.spec.delete(things.body("column"))
        scene.resolve(time=time, length=HIGH, duration=5.0)

    def place_drum(self, scene: Scene) -> None:
        """Facets round the axle; Refusal where they are too narrow, or too wide for what stands about."""
        n, q = self.facets, self.offset
        if n > 1 and (q < 2 * GLASS or self.half_width < 0.02):
            least = max(2 * GLASS, 0.02 / tan(pi / n) if n > 2 else 0.0)
            raise Refusal("R12", f"offset = {q:.3g} m leaves no room for {n} facets; allowed: {least:.3g} m or more")
        if self.wall < (self.radius + 0.08) / 0.6:
            raise Refusal("R1", f"wall = {self.wall:.3g} m: the mirrors would strike what stands before it; "
                          f"allowed here: {(self.radius + 0.08) / 0.6:.3g} m or more")  # fmt: skip
        part = scene.add("mirror_drum", "drum")
        part.body("drum").quat = lasers.turned(pi)
        cap = q if n > 2 else 0.08
        scene.spec.mesh(part.name("wedge")).scale = (max(q, 0.01), max(self.half_width, 0.01), HIGH)
        for end in ("top", "bottom"):
            part.geom(end).size[0] = cap
        for k in range(8):
            facet = part.geom(f"facet{k}")
            if k >= n:
                scene.spec.delete(facet)
                continue
            a = FIRST + 2 * pi * k / n
            normal = (cos(a), sin(a), 0.0)
            facet.quat = lasers.turned(a)
            if n < 3:
                facet.pos, facet.size = (q - GLASS) * np.array(normal), (GLASS, self.half_width, HIGH)
            else:
                facet.type, facet.meshname = mujoco.mjtGeom.mjGEOM_MESH, part.name("wedge")
            scene.mirrors.append(Mirror(part.name(f"facet{k}"), (q * normal[0], q * normal[1], 0.0), normal))
        back = part.geom("back")
        if n > 1:
            scene.spec.delete(back)
        else:
            back.pos, back.quat = (q - 0.013) * np.array([cos(FIRST), sin(FIRST), 0.0]), lasers.turned(FIRST)
        for body in ("stand", "drum"):
            part.body(body).pos[2] = HEIGHT
            scene.material(part.name(body), 2500.0, DRY)
        scene.motors.append(Motor(part.name("hinge"), ((0.0, self.omega),)))
        scene.speed[part.name("hinge")] = self.omega

    def place_pendulum(self, scene: Scene) -> None:
        """The mirror under its gallows, let go aside."""
        frame = gallows(scene, HEIGHT + self.length, 0.26, foot=0.25)
        scene.material(frame.name("frame"), 700.0, DRY)
        part = scene.add("hanging_mirror", "pendulum")
        body = part.body("mirror")
        body.pos, body.quat = (0, 0, HEIGHT), lasers.turned(pi)
        part.joint("hinge").pos[2] = self.length
        part.geom("glass").size = (GLASS, HUNG, HIGH)
        for rod, side in (("left_rod", -1), ("right_rod", 1)):
            part.geom(rod).fromto = (-0.004, side * 0.12, HIGH + 0.01, -0.004, side * 0.12, self.length - 0.025)
        scene.material(part.name("mirror"), 2500.0, DRY)
        scene.mirrors.append(Mirror(part.name("glass"), (GLASS, 0.0, 0.0), (1.0, 0.0, 0.0)))
        scene.start[part.name("hinge")] = self.swing

    def turned(self, t: ArrayLike) -> Array:
        """Angle by which the mirror ought to have turned (T,) [rad]: evenly, or as a pendulum of any width swings.

        Source: L. D. Landau & E. M. Lifshitz, Mechanics, §11 problem 1; sin(θ/2) = k cd(ω₀ t, k), k = sin(θ₀/2).
        """
        when = np.asarray(t, float)
        if self.carrier == "motor":
            return np.asarray(self.omega * when)
        reduced = self.length + (GLASS**2 + HIGH**2) / 3 / self.length
        k = sin(self.swing / 2)
        _, cn, dn, _ = ellipj(np.mod(when * sqrt(g / reduced), 4 * ellipk(k**2)), k**2)
        return np.asarray(2 * np.arcsin(k * cn / dn))

    def due(self, t: ArrayLike, margin: float = 0.0) -> Due:
        """The beam at the times t; margin: by which everything that stands about is wider [m]."""
        angle = self.turned(t)
        start, way = self.source
        count = len(angle)
        nearest, facet = np.full(count, np.inf), np.full(count, -1)
        hit, out = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        for k in range(self.facets if self.carrier == "motor" else 1):
            if self.carrier == "motor":
                a = FIRST + angle + 2 * pi * k / self.facets
                zero = np.zeros(count)
                normal, across = np.stack([np.cos(a), np.sin(a), zero], 1), np.stack([-np.sin(a), np.cos(a), zero], 1)
                middle = np.array([0.0, 0.0, HEIGHT]) + self.offset * normal
                half = self.half_width + (0.0 if self.facets > 2 else margin - HAZY)
            else:
                normal = np.stack([np.cos(angle), np.zeros(count), np.sin(angle)], 1)
                across = np.tile([0.0, 1.0, 0.0], (count, 1))
                up = np.stack([-np.sin(angle), np.zeros(count), np.cos(angle)], 1)
                middle = np.array([0.0, 0.0, HEIGHT + self.length]) - self.length * up + GLASS * normal
                half = HUNG - HAZY
            there = lasers.on_plane(start, way, middle, normal)
            far = (there - start) @ way
            aside = there - middle
            upwards = np.linalg.norm(aside - np.einsum("ti,ti->t", aside, across)[:, None] * across, axis=1)
            inside = (np.abs(np.einsum("ti,ti->t", aside, across)) < half) & (upwards < HIGH - HAZY)
            found = inside & (normal @ way < 0) & (far > 0) & (far < nearest)
            nearest[found], facet[found], hit[found] = far[found], k, there[found]
            out[found] = reflected(way, normal)[found]
        who, end = self.meets(hit, out, margin)
        return Due(facet, hit, out, who, end)

    def meets(self, hit: Array, out: Array, margin: float) -> tuple[NDArray[np.str_], Array]:
        """Which body reflected beams (T, 3) meet (T,), of those before the wall and that itself; and where (T, 3)."""
        middle, half, top = self.board
        with np.errstate(invalid="ignore", divide="ignore"):
            far = np.where(out[:, 0] > 0, (self.wall - hit[:, 0]) / out[:, 0], np.inf)
            spot = hit + far[:, None] * out
            low, high = 0.07, 0.06 + top - margin
            on_board = (np.abs(spot[:, 1] - middle) < half - margin) & (spot[:, 2] > low) & (spot[:, 2] < high)
            nearest = np.where(on_board, far, np.inf)
            who = np.where(on_board, "wall/screen", "")
            place, radius = self.ball
            uprights = [("obstacles/ball", place[:2], 0.006, place[2])]
            if self.carrier == "motor":
                x, y, wide, high = self.column
                uprights.append(("obstacles/column", np.array([x, y]), wide, high))
            found = [(name, sphere(hit[:, :2] - centre, out[:, :2], wide + margin), high)
                     for name, centre, wide, high in uprights]  # fmt: skip
            found.append(("obstacles/ball", sphere(hit - place, out, radius + margin), np.inf))
            for name, reach, high in found:
                closer = (reach < nearest) & (hit[:, 2] + reach * out[:, 2] < high + margin)
                nearest, who = np.where(closer, reach, nearest), np.where(closer, name, who)
            return who, hit + nearest[:, None] * out

    def sure(self, t: ArrayLike) -> tuple[Due, NDArray[np.bool_]]:
        """What ought to be, and whether it passes no edge too closely to say (T,)."""
        due, others = self.due(t), [self.due(t, side * SURE) for side in (-1, 1)]
        same = np.all([(o.who == due.who) & (o.facet == due.facet) for o in others], axis=0)
        return due, same & (due.facet >= 0)

    def angle_of(self, ways: Array) -> Array:
        """Angle of directions (T, 3) about the mirror's axle, in its axes [rad]."""
        return np.arctan2(ways[:, 1 if self.carrier == "motor" else 2], ways[:, 0])

    @property
    def hinge(self) -> str:
        """The joint that the mirror turns on."""
        return "drum/hinge" if self.carrier == "motor" else "pendulum/hinge"

    @observable("rad")
    def mirror_angle(self, run: Run) -> Array:
        """By which the mirror has turned (T,)."""
        return run.joint(self.hinge)

    @observable("m")
    def beam_path(self, run: Run) -> Array:
        """Where the beam starts, is reflected and ends (T, K, 3)."""
        return lasers.path(optics.trace(run, "laser"))

    @observable("1")
    def direction_out(self, run: Run) -> Array:
        """Direction (T, 3) of the last piece of the beam."""
        rays = optics.trace(run, "laser")
        rows, last = np.arange(len(run)), lasers.pieces(rays).astype(int)
        along = rays.points[rows, last] - rays.points[rows, last - 1]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))

    @observable("m")
    def spot(self, run: Run) -> Array:
        """Where the beam ends (T, 3)."""
        return optics.trace(run, "laser").ends

    @law("φ' - φ = 2 (θ' - θ)", source="Euclid, Catoptrics, prop. 1; Born & Wolf, Principles of Optics, §3.2.2",
         within=(2e-6, 1e-8, 1e-9), unit="rad", limited_by=DRIVEN)  # fmt: skip
    def beam_turns_twice_as_far_as_the_mirror(self, run: Run) -> Measurement:
        """37a: angle of the beam about the axle, less what it is by twice the mirror's angle of the same instant, as
        recorded and as it ought to be; on the circle, where a facet ought to reflect; NaN if it does not."""
        due, sure = self.sure(run.t)
        if not sure.any():
            raise NotEvaluated("no facet is clear of its edge in the beam")
        _, way = self.source
        rays = optics.trace(run, "laser")
        own = FIRST + 2 * pi * due.facet / self.facets if self.carrier == "motor" else np.zeros(len(run))
        came = float(self.angle_of(way[None])[0])
        found = self.angle_of(rays.directions(1) * BACKWARDS)
        off = [found - (2 * (own + angle) - came + pi) for angle in (self.mirror_angle(run), self.turned(run.t))]
        wrapped = np.angle(np.exp(1j * np.stack(off, axis=1)))[sure]
        return wrapped, np.zeros_like(wrapped)

    @law("v = 2 ω D/cos² φ", source="Euclid, Catoptrics, prop. 1; derivative of y = D tan φ with φ' = 2 ω",
         within=(1e-5, 1e-5, 1e-5), limited_by="differences of the sixth order over the recorded samples")  # fmt: skip
    def spot_runs_faster_the_farther_aside(self, run: Run) -> Measurement:
        """37b: speed of the spot along the wall, by differences of its place, with a single mirror whose face the axle
        lies in (a twin, if this one is not); φ: of the beam from the wall's normal, seen from above."""
        plain = self.carrier == "motor" and self.facets == 1 and self.offset == 0
        twin = run if plain else run.again(carrier="motor", facets=1, offset=0.0)
        due, sure = twin.specimen.sure(twin.t)
        on_wall = sure & (due.who == "wall/screen")
        seven = np.convolve(on_wall, np.ones(7), "same") == 7
        if not seven.any():
            raise NotEvaluated("the spot is never on the wall for seven samples")
        ends = optics.trace(twin, "laser").ends * BACKWARDS
        weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
        speed = np.convolve(ends[:, 1], weights[::-1], "same") / (twin.t[1] - twin.t[0])
        phi = 2 * (FIRST + self.omega * twin.t) + pi / 2
        return speed[seven], (2 * self.omega * self.wall / np.cos(phi) ** 2)[seven]

    @law("r = p + d' s", source="Born & Wolf, Principles of Optics, §3.2.1; geometry of planes, cylinders and a sphere",
         within=(1e-5, 1e-7, 1e-8), unit="m", limited_by=DRIVEN)  # fmt: skip
    def spot_is_where_geometry_says(self, run: Run) -> Measurement:
        """37c: where the beam meets the mirror, beside its axle by the offset, and then wall, column or ball, whichever
        is nearest; NaN if it meets anything else."""
        due, sure = self.sure(run.t)
        sure &= due.who != ""
        if not sure.any():
            raise NotEvaluated("the beam never falls on wall, column or ball")
        rays = optics.trace(run, "laser")
        corners, geoms = first_corners(rays, 2)
        bodies = np.array([run.model.body(name).id if name else optics.NO_RAY for name in due.who])
        met = np.where(geoms[:, 1] < 0, geoms[:, 1], run.model.geom_bodyid[geoms[:, 1]])
        right = (met == bodies) & (lasers.pieces(rays) == 2)
        found = np.where(right[:, None, None], corners[:, 1:] * BACKWARDS, np.nan)
        return found[sure], np.stack([due.hit, due.end], axis=1)[sure]

    @law("N = n per turn, each of 4π/n", source="Euclid, Catoptrics, prop. 1; each of n facets serves 2π/n of a turn",
         within=(1e-5, 1e-6, 1e-6), limited_by="the facets' edges are known to seven digits")  # fmt: skip
    def every_facet_makes_one_sweep(self, run: Run) -> Measurement:
        """37d: sweeps per turn, and the angle of each, of three or more facets that turn fast enough (a twin, if these
        are fewer or slower): from the instants at which the beam passes from one facet to the next."""
        good = self.carrier == "motor" and self.facets > 2 and self.omega > 2.52
        many = self.facets if self.facets > 2 else 5
        wide = {} if good else {"offset": max(0.05, 0.02 / tan(pi / many)), "wall": max(self.wall, 1.0)}
        speed = self.omega if good else TURNING
        twin = run if good else run.again(carrier="motor", facets=many, omega=TURNING, **wide)
        times = np.array([c.time for c in optics.changes(twin, "laser") if c.before[0] != c.after[0]])
        passes = times[np.diff(times, prepend=-1.0) > 1e-6]  # in the very edge, rounding may see both facets in turn
        if len(passes) < many + 1:
            raise NotEvaluated(f"{len(passes)} passages from facet to facet; needed: {many + 1}")
        found = twin.specimen.angle_of(optics.trace(twin, "laser").directions(1) * BACKWARDS)
        ranges = []
        for first, last in itertools.pairwise(passes):
            within = (twin.t > first) & (twin.t < last)
            slope = np.polyfit(twin.t[within] - first, np.unwrap(found[within]), 1)[0]
            ranges.append(abs(slope) * (last - first))
        per_turn = (len(passes) - 1) / (passes[-1] - passes[0]) * 2 * pi / speed
        return [per_turn / many, *(np.array(ranges) * many / (4 * pi))], np.ones(len(passes))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        met = lasers.met(run, optics.trace(run, "laser"))
        share = {name: float(np.mean((met == run.model.body(body).id).any(axis=1))) for name, body in (
            ("wall", "wall/screen"), ("ball", "obstacles/ball"))}  # fmt: skip
        mirror = {
            "motor": f"{'a mirror' if self.facets == 1 else f'a drum of {self.facets} mirrors'} on an upright axle, "
            f"which a motor turns at {self.omega:.2g} rad/s",
            "pendulum": "a mirror that hangs under a wooden frame and swings by "
            f"{np.degrees(self.swing):.0f} degrees to either side",
        }[self.carrier]
        return (
            f"A laser shines at {mirror}. The reflected beam turns twice as fast as the mirror, because both angles, "
            f"of incidence and of reflection, change alike; its spot runs over a wall {self.wall:.1f} m away, the "
            f"faster the farther aside. It is on the wall for {share['wall']:.0%} of the time, is cut off by a "
            f"yellow ball for {share['ball']:.0%}, and goes elsewhere or ends on a mirror's edge or back for the rest."
        )


def sphere(start: Array, way: Array, radius: float) -> Array:
    """Distances (T,) along rays at which they enter a sphere (or, of plane vectors, a cylinder) about the origin [m].

    t = (-b - √(b² - a c))/a; infinite for those that miss it.
    """
    a, b, c = (way**2).sum(axis=1), (start * way).sum(axis=1), (start**2).sum(axis=1) - radius**2
    under = b**2 - a * c
    far = (-b - np.sqrt(np.maximum(under, 0))) / a
    return np.where((under > 0) & (far > 0), far, np.inf)
