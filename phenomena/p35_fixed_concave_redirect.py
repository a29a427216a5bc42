"""35: a fan of parallel beams, or a lamp that comes near, before a concave mirror."""

from __future__ import annotations

from math import asin, atan2, cos, sin, tan
from typing import Annotated, Final, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from physinone_mj import optics
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.run import Run
from physinone_mj.scene import Lamp, Motor, Part, Scene

from . import dishes
from .dishes import BARREL, BOARD, CUT, LIP, RAMP, Bench, Shuttle, bent_mirror, slope, spectral, spread, traced
from .lasers import DRY, EXACT

Array = NDArray[np.float64]

BAR: Final = 1.1
"""The lasers' mouths before the mirror's centre of curvature, in its radii."""

ROOM: Final = 1.12
"""From the centre of curvature to the walls behind the mirror, in its radii."""

SLOPE: Final = 2 * (CUT + LIP)
"""Of the parallel light of path-traced pictures, downwards [rad]: after the mirror, which gathers it in height too, its
focus is half a radius away and lies on the table."""

SHEET: Final = (-0.04, 0.055)
"""Middle and half the height of this light where it meets the mirror, from the beams' plane, in radii."""

BRIGHT: Final = 4.0
"""Its strength, in suns: it falls on the table at its slope, so with less than a quarter of that."""

CLOSE: Final = 0.004
"""Angle of the two beams close to the axis [rad]: they meet the mirror within a fiftieth of its radius."""

STEEP: Final = 0.9
"""Where a beam farther off the axis than this, in radii, touches the caustic five samples are too far apart to tell."""

BULB: Final = 0.025
"""Radius of the lamp, in radii of the mirror."""

SURE: Final = 1e-6
"""A beam that passes the mirror's rim within this angle [rad] may or may not be reflected."""

OFF_AXIS: Final = 0.02
"""Where a beam nearer to the axis than this, in radii, crosses it is only known to fewer digits."""


class FixedConcaveRedirect(Phenomenon, domain="optics"):
    """A concave mirror gathers light: parallel beams along a caustic, a lamp's light in its image."""

    light: Annotated[
        Literal["fan", "lamp"], Choice("parallel beams from a bar that slides aside, or a lamp that comes near")
    ] = "fan"
    radius: Annotated[float, Param("m", 0.2, 2.0, "of curvature")] = 0.6
    aperture: Annotated[float, Param("1", 0.5, 0.95, "half the mirror's width, in radii")] = 0.85
    tilt: Annotated[float, Param("rad", -0.4, 0.4, "of the mirror, turned about its centre of curvature")] = 0.1
    count: Annotated[int, Param("1", 3, 15, "beams")] = 9
    fan: Annotated[float, Param("1", 0.05, 0.9, "half the width of the fan, in radii")] = 0.64
    offset: Annotated[float, Param("1", 0.02, 0.3, "how far the bar slides to either side, in radii")] = 0.15
    pace: Annotated[float, Param("1/s", 0.1, 1.0, "speed of the bar or the lamp, in radii a second")] = 0.4
    far: Annotated[float, Param("1", 1.5, 3.5, "from the mirror to the lamp at first, in radii")] = 2.6
    near: Annotated[float, Param("1", 0.15, 0.45, "from the mirror to the lamp in the end, in radii")] = 0.3

    @property
    def bench(self) -> Bench:
        """The table; its origin is under the mirror's centre of curvature, which is in the light's plane."""
        back, half = BAR + BARREL[0] + 0.1, max(ROOM, self.fan + self.offset + 0.15)
        if self.light == "lamp":
            back, half = max(self.far - 1 + 0.2, ROOM), ROOM
        r = self.radius
        return Bench(-back * r, ROOM * r, half * r, (BOARD + LIP + CUT) * r, r)

    @property
    def watch(self) -> float:
        """How long it is watched [s]."""
        way = 4 * self.offset if self.light == "fan" else self.far - self.near
        return min(max(2.0, way / self.pace + 2 * RAMP), 8.0)

    @property
    def motion(self) -> Shuttle:
        """Of the bar."""
        return Shuttle(self.offset * self.radius, self.pace * self.radius, self.watch)

    @property
    def angles(self) -> Array:
        """Of the lamp's beams from the axis (n + 2,) [rad]: the widest meet the mirror well within its rim at first,
        the last two meet it close to the axis."""
        polar = min(0.85 * (asin(self.aperture) - abs(self.tilt)), 0.8)
        widest = atan2(sin(polar), self.far - 1 + cos(polar))
        return np.concatenate([spread(widest, self.count), [-CLOSE, CLOSE]])

    def build(self, scene: Scene) -> None:
        """Table, mirror, and the bar of lasers or the lamp on its rail."""
        scene.fps = 60
        r, bench = self.radius, self.bench
        scene.material("stage/floor", 2400.0, DRY)
        bench.table(scene)
        vertex = (r * cos(self.tilt), r * sin(self.tilt), bench.plane)
        bent_mirror(scene, vertex, self.tilt, r, self.aperture * r, CUT * r)
        if self.light == "fan":
            self.place_sheet(scene, bench.lasers(scene, -BAR * r, spread(self.fan * r, self.count), self.motion))
        else:
            self.place_lamp(scene)
        scene.resolve(time=0.5, length=BULB * r, duration=self.watch)

    def place_sheet(self, scene: Scene, bar: Part) -> None:
        """Light as wide as the fan, whose caustic path-traced pictures show on the table."""
        low, half = SHEET
        quat = np.zeros(4)
        mujoco.mju_mulQuat(quat, np.array([cos(SLOPE / 2), 0, sin(SLOPE / 2), 0]), np.full(4, 0.5))
        place = (0, 0, (low + (1 + BAR) * tan(SLOPE)) * self.radius)
        bar.body("bar").add_site(name=bar.name("sheet"), pos=place, quat=quat, size=(1e-3, 0, 0), rgba=(0, 0, 0, 0))
        scene.lamps.append(Lamp(bar.name("sheet"), (self.fan * self.radius, half * self.radius), BRIGHT))

    def place_lamp(self, scene: Scene) -> None:
        """A lamp on its rail along the x axis, on its way towards the mirror."""
        r, bench, part = self.radius, self.bench, scene.add("lamp_slide")
        first, last, rail, shoe = (1 - self.far) * r, (1 - self.near) * r, 0.01 * r, 0.008 * r
        part.geom("rail").pos = ((first + last) / 2, 0, bench.board + rail / 2)
        part.geom("rail").size = ((last - first) / 2 + 0.1 * r, 0.02 * r, rail / 2)
        part.body("lamp").pos = (0, 0, bench.plane)
        low = bench.board + rail - bench.plane
        part.geom("bulb").size[0] = BULB * r
        part.geom("post").fromto, part.geom("post").size[0] = (0, 0, low + shoe, 0, 0, -0.9 * BULB * r), 0.006 * r
        part.geom("shoe").pos, part.geom("shoe").size = (0, 0, low + shoe), (0.04 * r, 0.03 * r, shoe)
        for k, angle in enumerate(self.angles):
            quat = np.zeros(4)
            mujoco.mju_mulQuat(quat, np.array([cos(angle / 2), 0, 0, sin(angle / 2)]), np.full(4, 0.5))
            part.body("lamp").add_site(name=part.name(f"beam{k:02d}"), quat=quat, size=(1e-3, 0, 0), rgba=(0, 0, 0, 0))
            bench.shine(scene, f"beam{k:02d}", part.name(f"beam{k:02d}"), spectral(k % self.count, self.count))
        for body in ("lamp", "rail"):
            scene.material(part.name(body), 2700.0, DRY)
        arrival = (last - first) / (self.pace * r)
        scene.motors.append(Motor(part.name("slide"), ((arrival, self.pace * r), (arrival + RAMP, 0.0))))
        scene.start[part.name("slide")], scene.speed[part.name("slide")] = first, self.pace * r

    def heights(self, run: Run) -> Array:
        """Of the fan's beams beside the centre of curvature (T, n) [m], from the recorded place of the bar."""
        return np.asarray(run.joint("laser_bar/slide")[:, None] + spread(self.fan * self.radius, self.count))

    def fanned(self, run: Run) -> Run:
        """The run, or its twin with the fan."""
        return run if self.light == "fan" else run.again(light="fan")

    def lit(self, run: Run) -> Run:
        """The run, or its twin with the lamp."""
        return run if self.light == "lamp" else run.again(light="lamp")

    def on_mirror(self, polar: Array, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether places on the circle of the mirror's section, by their polar angles from the x axis, are silvered."""
        return np.asarray(np.abs(polar - self.tilt) < asin(self.aperture) - margin)

    def due(self, heights: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """How often parallel beams ought to be reflected, and whether that is sure.

        Every chord of a circle that reflects spans the same angle: a beam that comes at the polar angle θ is met again
        at θ - (π - 2 θ), and so on, until there is no silver.
        """
        polar = np.arcsin(np.clip(heights / self.radius, -1, 1))
        outside = np.where(polar < 0, -np.pi, np.pi) - polar  # where it comes into the circle
        within = np.abs(heights) < self.radius
        sure = np.abs(np.abs(heights) / self.radius - 1) > SURE
        for rim in (-1, 1):
            edge = self.tilt + rim * asin(self.aperture)
            sure &= np.abs(outside - edge) > SURE
        count, going, here = np.zeros(heights.shape, np.int64), within & ~self.on_mirror(outside), polar
        while going.any():
            sure &= ~going | (np.abs(np.abs(here - self.tilt) - asin(self.aperture)) > SURE)
            going = going & self.on_mirror(here)
            count += going
            here = here + 2 * polar - np.where(polar < 0, -np.pi, np.pi)
        return count, sure

    @observable("m")
    def source(self, run: Run) -> Array:
        """Of the bar beside the mirror's centre of curvature, or of the lamp beyond it, towards the mirror (T,)."""
        return run.joint("laser_bar/slide" if self.light == "fan" else "lamp_slide/slide")

    @observable("1")
    def reflections(self, run: Run) -> Array:
        """How often each beam is reflected (T, n)."""
        return np.stack([(rays.geoms > optics.NO_RAY).sum(axis=1) - 1.0 for rays in traced(run)], axis=1)

    @observable("m")
    def ends(self, run: Run) -> Array:
        """Where each beam ends (T, n, 3)."""
        return dishes.ends(run)

    @law("x = R/(2 √(1 - y²/R²))", within=(1e-10, 1e-10, 1e-10), limited_by=EXACT,
         source="E. Hecht, Optics, §5.4.3, but exactly: a triangle of equal sides on the radius")  # fmt: skip
    def every_parallel_beam_crosses_the_axis_at_its_own_place(self, run: Run) -> Measurement:
        """35a: from the centre of curvature to where the beams, first reflected, cross the axis parallel to them; NaN
        for one that ought to be reflected and is not."""
        twin = self.fanned(run)
        found, due = [], []
        for rays, y in zip(traced(twin), self.heights(twin).T, strict=True):
            count, sure = self.due(y)
            i = np.flatnonzero(sure & (count > 0) & (np.abs(y) > OFF_AXIS * self.radius))
            if len(i):
                way = rays.directions(1)[i]
                found.append(rays.points[i, 1, 0] - rays.points[i, 1, 1] * way[:, 0] / way[:, 1])
                due.append(self.radius / (2 * np.sqrt(1 - (y[i] / self.radius) ** 2)))
        if not found:
            raise NotEvaluated("no beam meets the mirror off its axis")
        return np.concatenate(found), np.concatenate(due)

    @law("θₖ = θ₀ - k (π - 2 θ₀)", source="Euclid, Elements, book III, prop. 28: equal chords span equal arcs",
         within=(1e-9, 1e-9, 1e-9), limited_by=EXACT)  # fmt: skip
    def beams_are_reflected_until_there_is_no_silver(self, run: Run) -> Measurement:
        """35, extremes: how often every beam of the fan is reflected, plus one: not at all beside the mirror, twice or
        more from beyond R/√2."""
        twin = self.fanned(run)
        count, sure = self.due(self.heights(twin))
        return 1 + self.reflections(twin)[sure], 1 + count[sure]

    @law("x = R (3 cos θ - cos 3θ)/4, y = R sin³ θ", source="C. Huygens, Traité de la lumière, ch. 6: the nephroid",
         within=(1e-6, 1e-6, 1e-6), limited_by="five neighbouring samples stand for a derivative")  # fmt: skip
    def reflected_beams_touch_a_nephroid(self, run: Run) -> Measurement:
        """35d: place (x, y) from the centre of curvature at which a beam, once reflected, meets its neighbour of an
        instant later; sin θ is its height over R, and the cusp, θ = 0, is at R/2."""
        twin = self.fanned(run)
        y = twin.joint("laser_bar/slide")
        found, due = [], []
        for k, rays in enumerate(traced(twin)):
            count, sure = self.due(self.heights(twin)[:, k])
            seen = sure & (count > 0) & (np.abs(self.heights(twin)[:, k]) < STEEP * self.radius)
            i = np.flatnonzero(np.convolve(seen, np.ones(5), "same") == 5)
            i = i[self.motion.steady(twin.t)[i]]
            way = rays.directions(1)[:, :2]
            normal = np.column_stack([-way[:, 1], way[:, 0]])
            far = np.einsum("ti,ti->t", normal, rays.points[:, 1, :2])
            step = (y[i + 1] - y[i - 1]) / 2
            turn, shift = slope(normal, i, step), slope(far[:, None], i, step)
            # n·p = c and n'·p = c', with n' across n: p = c n + c' n'/n'²
            with np.errstate(divide="ignore", invalid="ignore"):
                touched = far[i, None] * normal[i] + shift * turn / (turn**2).sum(axis=1, keepdims=True)
            theta = np.arcsin(self.heights(twin)[i, k] / self.radius)
            curve = np.column_stack([(3 * np.cos(theta) - np.cos(3 * theta)) / 4, np.sin(theta) ** 3])
            found.append(touched.ravel())
            due.append(self.radius * curve.ravel())
        if not sum(map(len, found)):
            raise NotEvaluated("no beam meets the mirror while the bar moves evenly")
        return np.concatenate(found), np.concatenate(due)

    @law("s = R", source="E. Hecht, Optics, §5.4.3: a ray through the centre of curvature returns on itself",
         within=(1e-8, 1e-8, 1e-8), limited_by="seven neighbouring samples stand for the instant")  # fmt: skip
    def light_through_the_centre_returns_on_itself(self, run: Run) -> Measurement:
        """35b: from the lamp to the mirror's vertex on its axis, where its widest beams return on themselves."""
        twin = self.lit(run)
        x, beams = twin.joint("lamp_slide/slide"), traced(twin)
        vertex = vertex_of(twin)
        found = []
        for rays in (beams[0], beams[self.count - 1]):
            there, back = rays.directions(0), rays.directions(1)
            astray = there[:, 0] * back[:, 1] - there[:, 1] * back[:, 0]
            turns = np.flatnonzero(astray[:-1] * astray[1:] <= 0)
            turns = turns[(there[turns] * back[turns]).sum(axis=1) < 0]
            if not len(turns):
                raise NotEvaluated("the lamp does not come to the centre of curvature while it is watched")
            near = slice(max(turns[0] - 3, 0), turns[0] + 4)
            middle = x[turns[0]]
            line = np.polynomial.Polynomial.fit(x[near] - middle, astray[near], len(x[near]) - 1)
            roots = line.roots()
            root = roots[np.abs(roots).argmin()].real
            found.append(vertex - middle - root)
        return found, [self.radius, self.radius]

    @law("1/s + 1/s' = 2/R", source="E. Hecht, Optics, §5.4.3 eq. 5.48; paraxial", within=(2e-3, 1e-3, 1e-3),
         limited_by="spherical aberration: the beams meet the mirror up to R/70 off the axis")  # fmt: skip
    def image_distance_obeys_the_mirror_equation(self, run: Run) -> Measurement:
        """35c: 1/s of lamp and image, the latter where the beams close to the axis cross it, before the mirror or
        behind; relative to the mirror's vertex on the axis."""
        twin = self.lit(run)
        vertex, beams = vertex_of(twin), traced(twin)
        found = []
        for rays in beams[self.count :]:
            hit, way = rays.points[:, 1], rays.directions(1)
            image = way[:, 1] / ((vertex - hit[:, 0]) * way[:, 1] + hit[:, 1] * way[:, 0])
            found.append(1 / (vertex - twin.joint("lamp_slide/slide")) + image)
        return np.concatenate(found), np.full(2 * len(twin), 2 / self.radius)

    @law("α' = α + 2 asin(q sin α/R)", within=(1e-10, 1e-10, 1e-10), unit="rad", limited_by=EXACT,
         source="Euclid, Elements, book I, prop. 32, and the law of sines: lamp, centre, spot")  # fmt: skip
    def wide_beams_are_turned_by_the_exact_law(self, run: Run) -> Measurement:
        """35c, exactly: angle of every reflected beam with the axis; q: of the lamp beyond the centre."""
        twin = self.lit(run)
        q = -twin.joint("lamp_slide/slide")
        found, due = [], []
        for rays, angle in zip(traced(twin), self.angles, strict=True):
            way = rays.directions(1)
            found.append(np.arctan2(-way[:, 1], -way[:, 0]))
            due.append(angle + 2 * np.arcsin(q * sin(angle) / self.radius))
        return np.concatenate(found), np.concatenate(due)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        mirror = (
            f"A strip of a concave mirror of {self.radius:.2g} m radius, {2 * self.aperture * self.radius:.2g} m wide, "
            f"stands on its edge on a light table. "
        )
        if self.light == "lamp":
            last = 1 - self.source(run)[-1] / self.radius
            past = [
                "out from the focus, half a radius from the mirror",
                "to meet the lamp in the centre of curvature" if last < 1 else "",
                "on without end while the lamp comes to the focus, and behind the mirror after" if last < 0.5 else "",
            ]
            return mirror + (
                f"A lamp on a rail sends {self.count} beams at it and comes near, from {self.far:.2g} radii to "
                f"{last:.2g}. Where the beams meet again is the lamp's image. It moves as 1/s + 1/s' = 2/R says: "
                f"{', '.join(filter(None, past))}. The outer beams miss it a little: a sphere is no paraboloid."
            )
        twice = int((self.reflections(run).max(axis=0) > 1).sum())
        outcome = f"{twice} of them meet the mirror twice or more" if twice else "none of them meets the mirror twice"
        return mirror + (
            f"{self.count} parallel beams of different colours fall on it from a bar that slides to and fro. Those "
            f"close to the axis cross it half a radius from the mirror, the outer ones ever nearer to it, as the law "
            f"of equal angles demands of a sphere; all of them touch a caustic with a cusp in the focus. On their way "
            f"{outcome}."
        )


def vertex_of(run: Run) -> float:
    """Where the x axis meets the mirror's sphere, from the model [m]."""
    return float(np.hypot(*run.model.body("bent_mirror/mirror").pos[:2]))
