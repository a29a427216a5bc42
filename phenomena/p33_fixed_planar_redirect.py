"""33: a laser on a flat mirror, which slides slowly along its normal."""

from __future__ import annotations

from math import cos, inf, pi, sin, tan
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from phenomena import lasers
from phenomena.lasers import (
    DRIVEN,
    EXACT,
    GLASS,
    HAZY,
    Glide,
    first_corners,
    on_plane,
    reflected,
    screen,
    shine,
    silvered_faces,
    standing_mirror,
)
from physinone_mj import optics
from physinone_mj.base import Measurement, Param, Phenomenon, Refusal, law, observable
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene

Array = NDArray[np.float64]

MIDDLE: Final = np.array([0.0, 0.0, 0.6])
"""Of the mirror's face when it is half-way, where the beam then meets it [m]."""

NORMAL: Final = np.array([-1.0, 0.0, 0.0])
"""Of the mirror."""

ABOVE: Final = 0.3
"""How far the screen's board rises over the spot [m]."""

PASSING: Final = 0.06
"""A beam keeps at least this far from the axis of the laser and from the edge of the screen [m]."""

MIRROR, SCREEN = "mirror/mirror", "screen/screen"


class FixedPlanarRedirect(Phenomenon, domain="optics"):
    """Laser hits a flat mirror and is reflected at the angle at which it came; the spot moves with the mirror."""

    incidence: Annotated[float, Param("rad", 5 * pi / 180, 80 * pi / 180, "of the beam, from the normal")] = 0.7
    slant: Annotated[float, Param("rad", -0.15, 0.15, "of the plane of incidence, from the level")] = 0.12
    distance: Annotated[float, Param("m", 0.3, 3.0, "from the laser to the mirror")] = 1.1
    wall: Annotated[float, Param("m", 0.3, 3.0, "from the mirror to the screen, along the beam")] = 1.4
    size: Annotated[float, Param("m", 0.1, 0.6, "half the mirror's width; it is at most 0.6 m high")] = 0.22
    travel: Annotated[float, Param("m", 0.02, 0.15, "of the mirror, along its normal")] = 0.12

    @property
    def glide(self) -> Glide:
        """Of the mirror, to and fro about its middle position."""
        return Glide(self.travel)

    @property
    def high(self) -> float:
        """Half its height [m]."""
        return min(self.size, 0.3)

    @property
    def way(self) -> Array:
        """Direction (3,) of the laser's beam."""
        across = np.array([0.0, cos(self.slant), sin(self.slant)])
        return -cos(self.incidence) * NORMAL + sin(self.incidence) * across

    @property
    def out(self) -> Array:
        """Direction (3,) in which the beam ought to leave the mirror: equal angles, in one plane."""
        return self.way * (-1.0, 1.0, 1.0)

    @property
    def mouth(self) -> Array:
        """Where the beam starts (3,) [m]."""
        return MIDDLE - self.distance * self.way

    @property
    def board(self) -> tuple[Array, Array]:
        """Where the beam falls on the screen half-way (3,) [m], and the screen's normal (3,), which is level."""
        level = self.out * (1.0, 1.0, 0.0)
        return MIDDLE + self.wall * self.out, -level / np.linalg.norm(level)

    def build(self, scene: Scene) -> None:
        """Laser, mirror on its track, screen."""
        scene.fps = 60
        self.refuse()
        start = MIDDLE - self.travel / 2 * NORMAL
        part = standing_mirror(scene, "mirror", start, NORMAL, (self.size, self.high), ground=0.02)
        scene.motors.append(Motor(lasers.slide(part, NORMAL), self.glide.course))
        track = scene.add("track")
        track.body("track").pos[0] = GLASS + 0.01
        half = self.travel / 2 + 0.15
        for rail in ("left", "right"):
            track.geom(rail).size[0] = half
        for sleeper, side in (("front", 1), ("rear", -1)):
            track.geom(sleeper).pos[0] = side * (half - 0.03)
        scene.material(track.name("track"), 7800.0, lasers.DRY)
        shine(scene, self.mouth, self.way)
        spot, facing = self.board
        inner, outer = self.room
        along = np.array([facing[1], -facing[0], 0.0])  # towards the laser's side
        middle = spot + (inner - outer) / 2 * along
        size = (inner + outer) / 2, float(spot[2]) + ABOVE
        screen(scene, (middle[0], middle[1]), (facing[0], facing[1]), size, name="screen")
        scene.resolve(time=0.5, length=self.size, duration=5.0)

    @property
    def needed(self) -> float:
        """How far the screen has to extend from the middle of the spot's way [m]."""
        return self.travel * sin(self.incidence) + PASSING

    @property
    def room(self) -> tuple[float, float]:
        """How far it may, as a comfortable half width, towards the laser's side and away [m]."""
        i, usual = self.incidence, max(self.needed, 0.35)
        to_laser = self.wall * tan(2 * i) - self.needed if i < pi / 4 else inf
        # on the other side it must stop before the plane of the mirror, unless it gets there beside the mirror
        to_mirror = (self.wall * cos(i) - self.travel / 2 - PASSING) / sin(i)
        beside = self.wall * sin(i) + to_mirror * cos(i) > self.size + 2 * PASSING
        return min(to_laser, usual), usual if beside else min(to_mirror, usual)

    def refuse(self) -> None:
        """What would not fit: a beam past the glass, or laser, mirror and screen in each other's way."""
        i, stray = self.incidence, self.travel / 2 * tan(self.incidence)
        if stray > self.size - HAZY:
            raise Refusal("R12", f"travel = {self.travel:.3g} m takes the spot {stray:.3g} m from the mirror's middle; "
                          f"allowed here: {2 * (self.size - HAZY) / tan(i):.3g} m")  # fmt: skip
        between = sin(2 * i) * self.distance - self.travel * sin(i)
        before = self.distance * cos(i) - self.travel / 2
        if between < PASSING or (before < PASSING and self.distance * sin(i) < self.size + PASSING):
            least = max((PASSING + self.travel * sin(i)) / sin(2 * i), (PASSING + self.travel / 2) / cos(i))
            raise Refusal("R12", f"distance = {self.distance:.3g} m: the laser stands in the way of the mirror or its "
                          f"beam; allowed here: {least:.3g} m or more")  # fmt: skip
        if min(self.room) < self.needed:
            least = max(2 * self.needed / sin(2 * i), (self.needed * sin(i) + self.travel / 2 + PASSING) / cos(i))
            raise Refusal("R12", f"wall = {self.wall:.3g} m: the screen stands in the way of the laser or the mirror; "
                          f"allowed here: {least:.3g} m or more")  # fmt: skip

    @observable("m")
    def beam_path(self, run: Run) -> Array:
        """Where the beam starts, is reflected and ends (T, 3, 3)."""
        return lasers.path(optics.trace(run, "laser"))

    @observable("m")
    def spot(self, run: Run) -> Array:
        """Where the beam ends (T, 3)."""
        return optics.trace(run, "laser").ends

    @observable("1")
    def met(self, run: Run) -> Array:
        """Numbers of the bodies that the beam meets, in order (T, 2)."""
        return lasers.met(run, optics.trace(run, "laser")).astype(float)

    def pushed(self, run: Run) -> Array:
        """How far the motor ought to have moved the mirror along its normal from its middle position (T,) [m]."""
        return self.glide.place(run.t) - self.travel / 2

    @law("d' = d - 2 (d·n) n", source="Euclid, Catoptrics, prop. 1; Born & Wolf, Principles of Optics, §3.2.2",
         within=(1e-9, 1e-9, 1e-9), unit="rad", limited_by=EXACT)  # fmt: skip
    def beam_leaves_at_the_angle_at_which_it_came(self, run: Run) -> Measurement:
        """33a: direction from the mirror, against the mirror's recorded normal and against the angle of incidence."""
        _, normal = silvered_faces(run, MIRROR)
        found = optics.trace(run, "laser").directions(1)
        plane = np.cross(self.way, normal[0])
        flat = found @ plane / np.linalg.norm(plane)  # nothing sticks out of the plane of incidence
        due = [reflected(self.way, normal), np.broadcast_to(self.out, found.shape), np.zeros((len(run), 1))]
        return np.concatenate([found, found, flat[:, None]], axis=1), np.concatenate(due, axis=1)

    @law("r = r₀ + d s, s = (p - r₀)·n/(d·n)", source="Born & Wolf, Principles of Optics, §3.2.1; geometry of planes",
         within=(1e-7, 1e-9, 1e-10), unit="m", limited_by=DRIVEN)  # fmt: skip
    def spot_is_where_the_planes_say(self, run: Run) -> Measurement:
        """33b: corners of the beam, from the planes of mirror and screen where they ought to be at each instant."""
        n = NORMAL
        moved = MIDDLE + self.pushed(run)[:, None] * n
        hit = on_plane(self.mouth, self.way, moved, n)
        spot, facing = self.board
        corners, _ = first_corners(optics.trace(run, "laser"), 2)
        return corners[:, 1:], np.stack([hit, on_plane(hit, reflected(self.way, n), spot, facing)], axis=1)

    @law("Δ = 2 δ sin i", source="Born & Wolf, Principles of Optics, §3.2.2; two parallel reflected rays",
         within=(1e-6, 1e-8, 1e-9), limited_by=DRIVEN)  # fmt: skip
    def beam_shifts_by_twice_the_mirror_s_way(self, run: Run) -> Measurement:
        """33c: distance between the beam and what it was at the start, perpendicular to itself (T,)."""
        rays = optics.trace(run, "laser")
        away, along = rays.points[:, 1] - rays.points[0, 1], rays.directions(1)
        aside = away - np.einsum("ti,ti->t", away, along)[:, None] * along
        return np.linalg.norm(aside, axis=1), 2 * self.glide.place(run.t) * sin(self.incidence)

    @law("only silver reflects", source="by definition: a mirror; frame, back, screen and floor are none",
         within=(1e-7, 1e-9, 1e-10), unit="m", limited_by=DRIVEN)  # fmt: skip
    def nothing_but_the_glass_reflects(self, run: Run) -> Measurement:
        """33d: lengths of the beam's two pieces, NaN unless it meets glass and screen and nothing else; and of rays
        sent at the mirror's back, at its frame, the screen and the floor, NaN unless they end there."""
        rays = optics.trace(run, "laser")
        glass, board = (run.model.geom(name).id for name in ("mirror/glass", "screen/board"))
        corners, geoms = first_corners(rays, 2)
        right = (lasers.pieces(rays) == 2) & (geoms == (glass, board)).all(axis=1)
        ways = np.linalg.norm(np.diff(corners, axis=1), axis=2)
        found = [np.where(right[:, None], ways, np.nan).ravel()]
        spot, facing = self.board
        n = NORMAL
        moved = MIDDLE + self.pushed(run)[:, None] * n
        hit = on_plane(self.mouth, self.way, moved, n)
        end = on_plane(hit, self.out, spot, facing)
        due = [np.stack([np.linalg.norm(hit - self.mouth, axis=1), np.linalg.norm(end - hit, axis=1)], axis=1).ravel()]
        bar = np.array([0.0, 0.0, self.high + lasers.BAR / 2])
        for i in (0, len(run) - 1):
            face = moved[i]
            sent = {
                "mirror/back": (face - n, n, 1.0 - 0.018),  # the glass and what backs it
                "mirror/top": (face + bar + 0.1 * n, -n, 0.1 - 0.002),
                "screen/board": (spot + 0.2 * facing, -facing, 0.2),
                "stage/floor": (face + 0.05 * n + 0.2 * np.array([0, 1, 0]), np.array([0, 0, -1.0]), MIDDLE[2]),
            }
            for geom, (start, way, far) in sent.items():
                ray = lasers.probe(run, i, start, way)
                ended = list(ray.geoms) == [run.model.geom(geom).id]
                found.append(np.array([np.linalg.norm(ray.points[1] - ray.points[0]) if ended else np.nan]))
                due.append(np.array([far]))
        return np.concatenate(found), np.concatenate(due)

    @law("the way back is the way there", source="Born & Wolf, Principles of Optics, §3.2.2",
         within=(1e-7, 1e-9, 1e-9), unit="rad", limited_by=EXACT)  # fmt: skip
    def light_sent_back_returns_to_the_laser(self, run: Run) -> Measurement:
        """33e: direction from the mirror to where a ray from the spot ends up, against the laser's place."""
        found, due = [], []
        for i in np.linspace(0, len(run) - 1, 9).astype(int):
            back = lasers.probe(run, int(i), self.spot(run)[i] - 1e-3 * self.out, -self.out)
            at_laser = len(back.geoms) == 2 and run.model.geom(int(back.geoms[1])).name.startswith("laser/")
            seen = back.points[-1] - back.points[1] if at_laser else np.full(3, np.nan)
            found.append(seen / np.linalg.norm(seen))
            towards = self.mouth - back.points[1]
            due.append(towards / np.linalg.norm(towards))
        return np.array(found), np.array(due)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        spot = self.spot(run)
        degrees = np.degrees(self.incidence)
        level = "level" if abs(self.slant) < 0.02 else f"a little {'upwards' if self.slant > 0 else 'downwards'}"
        return (
            f"A laser shines, {level}, at a flat mirror in a golden frame, {degrees:.0f}° from its normal. The beam "
            f"leaves the mirror at the same angle on the other side and falls on a white screen {self.wall:.1f} m off. "
            f"The mirror then slides {100 * self.travel:.0f} cm on its track towards the laser's side; at every moment "
            f"the beam meets it where it is, so the reflected beam shifts, parallel to itself, by twice that times the "
            f"sine of the angle, and its spot moves {100 * np.linalg.norm(spot[-1] - spot[0]):.0f} cm on the screen."
        )
