"""39: things before a flat mirror, and their images behind it."""

from __future__ import annotations

from math import cos, sin
from typing import Annotated, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from phenomena.lasers import DRIVEN, Glide, slide, standing_mirror
from phenomena.parts import ball
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.contact import Surface
from physinone_mj.optics import Optics
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Motor, Scene, free_pose

Array = NDArray[np.float64]

HIGH: Final = 0.45
"""Half the height of the glass [m]."""

MIDDLE: Final = np.array([0.0, 0.0, 0.56])
"""Of the silvered face at the start [m]."""

PROUD: Final = 0.002
"""How far the bars of the frame stand out over the glass: a beam also has to pass between them [m]."""

EYES: Final = np.array([[2.2, -0.7, 1.25], [2.1, 0.5, 1.2]])
"""From where the images are looked at [m]."""

LETTER: Final = np.array([1.0, 0.0, 0.0])
"""Where the letter turns [m]."""

DISC: Final = 0.07, 0.01
"""Height of the middle of the letter's disc, and half its thickness [m]."""

STARTS: Final = np.array([0.5, -0.9])
"""Where the ball starts, x and y [m]."""

INSTANTS: Final = 24
"""At which images are looked for."""

TIPS: Final = "foot", "top", "end", "peg"
"""Sites of the letter: four points that are in no plane."""

MIRROR, GLASS, THING = "mirror/mirror", "mirror/glass", "ball/ball"


class MirrorReflect(Phenomenon, domain="optics"):
    """Things move before a flat mirror: their images are as far behind it, left and right exchanged."""

    width: Annotated[float, Param("m", 0.3, 0.6, "half the mirror's; it is 0.9 m high")] = 0.5
    tilt: Annotated[float, Param("rad", -0.15, 0.15, "of the mirror, leaning back")] = 0.06
    travel: Annotated[float, Param("m", 0.05, 0.2, "of the mirror, towards the things before it")] = 0.15
    letter: Annotated[float, Param("m", 0.15, 0.3, "height of the letter")] = 0.28
    turn: Annotated[float, Param("rad/s", 0.3, 3.0, "of the letter, anticlockwise seen from above")] = 1.3
    radius: Annotated[float, Param("m", 0.03, 0.08, "ball")] = 0.06
    height: Annotated[float, Param("m", 0.2, 0.6, "from which the ball drops")] = 0.42
    across: Annotated[float, Param("m/s", 0.3, 0.45, "speed of the ball past the mirror")] = 0.36
    restitution: Annotated[float, Param("1", 0.3, 0.95, "ball and floor")] = 0.86

    @property
    def glide(self) -> Glide:
        """Of the mirror."""
        return Glide(self.travel)

    @property
    def normal(self) -> Array:
        """Of the mirror (3,)."""
        return np.array([cos(self.tilt), 0.0, sin(self.tilt)])

    def faces(self, t: ArrayLike) -> Array:
        """Middle of the mirror's face at some times, as the motor ought to have moved it (n, 3) [m]."""
        return MIDDLE + self.glide.place(t)[:, None] * (1.0, 0.0, 0.0)

    @property
    def tips(self) -> Array:
        """Where the four `TIPS` of the letter are, in its body's axes (4, 3) [m]."""
        return self.letter * np.array([[0, -0.2, 0], [0, -0.2, 1], [0, 0.4, 1], [0.3, -0.2, 0.3]]) + (0, 0, DISC[1])

    def build(self, scene: Scene) -> None:
        """Mirror on its track, letter on its motor, ball above the floor."""
        surface = Surface(friction=0.3, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, surface)
        mirror = standing_mirror(scene, "mirror", MIDDLE, self.normal, (self.width, HIGH), ground=0.02)
        scene.motors.append(Motor(slide(mirror, (1.0, 0.0, 0.0)), self.glide.course))
        track = scene.add("track")
        track.body("track").pos[0] = self.travel / 2
        half = self.travel / 2 + 0.15
        for rail in ("left", "right"):
            track.geom(rail).size[0] = half
        for sleeper, side in (("front", 1), ("rear", -1)):
            track.geom(sleeper).pos[0] = side * (half - 0.03)
        scene.material(track.name("track"), 7800.0, surface)
        self.stand_letter(scene, surface)
        thrown = ball(scene, "ball", self.radius, 900.0, surface, (0.30, 0.62, 0.42))
        scene.start[thrown.name("free")] = free_pose((*STARTS, self.height + self.radius))
        scene.speed[thrown.name("free")] = (0.05, self.across, 0, 0, 0, 0)
        scene.touch(thrown.name("ball"), "stage/floor")
        scene.resolve(time=(2 * self.height / 9.8) ** 0.5, length=self.radius, duration=5.0)

    def stand_letter(self, scene: Scene, surface: Surface) -> None:
        """The letter, of its height, on a disc that turns."""
        part, h = scene.add("letter"), self.letter
        for body in ("stand", "letter"):
            part.body(body).pos[:2] = LETTER[:2]
            scene.material(part.name(body), 700.0, surface)
        thick, level = 0.03 * h, DISC[1]
        strokes = (("stem", -0.2, 0.5, 0.1, 0.5), ("arm", 0.15, 0.9, 0.25, 0.1), ("bar", 0.08, 0.52, 0.18, 0.09))
        for name, y, z, wide, high in strokes:
            for suffix, side in (("", 1), ("_back", -1)):
                geom = part.geom(name + suffix)
                geom.pos, geom.size = (side * thick, h * y, h * z + level), (thick, h * wide, h * high)
        peg = part.geom("peg")
        peg.fromto, peg.size[0] = (2 * thick, *self.tips[3, 1:], *self.tips[3]), 0.03 * h
        for name, place in zip(TIPS, self.tips, strict=True):
            part.site(name).pos = place
        joint = part.name("hinge")
        scene.speed[joint] = self.turn
        scene.motors.append(Motor(joint, ((0.0, self.turn),)))

    def points(self, run: Run) -> Array:
        """What is looked at: the ball's centre and the letter's four tips, (T, 5, 3) [m]."""
        tips = np.array([run.model.site(f"letter/{name}").pos for name in TIPS])
        turned = np.einsum("tij,kj->tki", quaternion_matrix(run.quaternion("letter/letter")), tips)
        return np.concatenate([run.position(THING)[:, None], run.position("letter/letter")[:, None] + turned], axis=1)

    def looked(self, run: Run) -> tuple[NDArray[np.int64], Array]:
        """Samples (n,), and the images (n, 5, 3) [m] of `points` there: where the sight lines of both eyes meet.

        NaN for what is not seen by both.
        """
        samples = np.linspace(0, len(run) - 1, INSTANTS).astype(int)
        points = self.points(run)[samples]
        sights = np.stack([sight_lines(run, samples, eye, points) for eye in EYES], axis=2)
        return samples, meeting(EYES, sights)

    @observable("m")
    def ball_image(self, run: Run) -> Array:
        """Image of the ball's centre (T, 3), as two eyes see it; NaN where it is not in the mirror for both."""
        centre = run.position(THING)[:, None]
        sights = np.stack([sight_lines(run, np.arange(len(run)), eye, centre) for eye in EYES], axis=2)
        return meeting(EYES, sights)[:, 0]

    @observable("m")
    def mirror_face(self, run: Run) -> Array:
        """Middle of the silvered face (T, 3)."""
        return run.position(MIRROR) + 0.004 * quaternion_matrix(run.quaternion(MIRROR))[:, :, 0]

    def mirrored(self, points: Array, t: Array) -> Array:
        """Points (n, k, 3) [m] as far behind the mirror as they are before it, where it ought to be at times (n,)."""
        before = (points - self.faces(t)[:, None]) @ self.normal
        return points - 2 * before[..., None] * self.normal

    @law("P' = P - 2 ((P - M)·n) n", source="Euclid, Catoptrics, prop. 16-19; Born & Wolf, Principles of Optics, "
         "§4.2.1", within=(1e-9, 1e-9, 1e-9), unit="m", limited_by=DRIVEN)  # fmt: skip
    def image_is_behind_the_mirror(self, run: Run) -> Measurement:
        """39a: where the traced sight lines of two eyes meet, for the ball and four points of the letter."""
        samples, images = self.looked(run)
        seen = enough(np.isfinite(images[..., 0]))
        return images[seen], self.mirrored(self.points(run)[samples], run.t[samples])[seen]

    @law("v' = v - 2 (v·n) n + 2 (V·n) n", source="the time derivative of Euclid's prop. 19; V the mirror's velocity",
         within=(1e-9, 1e-9, 1e-9), unit="m/s", limited_by=DRIVEN)  # fmt: skip
    def image_turns_back_and_runs_twice_as_fast(self, run: Run) -> Measurement:
        """39b: mean velocities of the images between instants, while the mirror slides evenly."""
        samples, images = self.looked(run)
        t, glide = run.t[samples], self.glide
        even = (t > glide.start + glide.ramp) & (t < glide.stop - glide.ramp)
        pair = even[1:] & even[:-1]
        apart = np.diff(t)[pair, None, None]
        found = np.diff(images, axis=0)[pair] / apart
        own = np.diff(self.points(run)[samples], axis=0)[pair] / apart
        n, pushed = self.normal, glide.speed * self.normal[0]
        due = own - 2 * (own @ n)[..., None] * n + 2 * pushed * n
        seen = enough(np.isfinite(found[..., 0]))
        return found[seen], due[seen]

    @law("a·(b × c) changes its sign, |a - b| does not", source="Euclid, Catoptrics, prop. 19; a reflection is an "
         "improper isometry", within=(1e-8, 1e-8, 1e-8), limited_by="round-off of the sight lines")  # fmt: skip
    def left_and_right_are_exchanged_and_sizes_kept(self, run: Run) -> Measurement:
        """39c: edges of the letter's image, and the volume of the tetrahedron of its four points, with its sign; in
        units of what the letter was built with."""
        _, images = self.looked(run)
        image = images[enough(np.isfinite(images[:, 1:]).all(axis=(1, 2))), 1:]

        def shape(corners: Array) -> tuple[Array, Array]:
            first, second = np.triu_indices(4, 1)
            edges = np.linalg.norm(corners[:, first] - corners[:, second], axis=2)
            return edges, np.linalg.det(corners[:, 1:] - corners[:, :1])[:, None] / 6

        (edges, volume), (due_edges, due_volume) = shape(image), shape(self.tips[None])
        found = np.concatenate([edges / due_edges, volume / due_volume], axis=1)
        return found, np.broadcast_to([1.0] * 6 + [-1.0], found.shape)

    @law("seen only where the line to the image crosses the glass", source="Born & Wolf, Principles of Optics, §3.2.1; "
         "geometry of planes", within=(1e-9, 1e-9, 1e-9), unit="m", limited_by=DRIVEN)  # fmt: skip
    def image_is_seen_through_the_glass_alone(self, run: Run) -> Measurement:
        """39d: how long a ray, sent along an eye's line to the ball's image, is until it passes the ball; nothing where
        that line passes beside the glass. NaN where the ray does something else."""
        centre = run.position(THING)
        image = self.mirrored(centre[:, None], run.t)[:, 0]
        tracer, data, glass = Optics(run.model, run.scene), mujoco.MjData(run.model), run.model.geom(GLASS).id
        mirror = run.model.body(MIRROR).id
        found: list[float] = []
        due: list[float] = []
        for eye in EYES:
            room = self.room(eye, image, run.t)
            for k in np.flatnonzero(np.abs(room) > 1e-6)[::3]:
                put(run, data, int(k))
                line = image[k] - eye
                ray = tracer.follow(data, eye, line / np.linalg.norm(line), reach=10.0, bounces=1)
                met = [-1 if geom < 0 else int(run.model.geom_bodyid[geom]) for geom in ray.geoms]
                if met[0] not in (-1, 0, mirror):
                    continue  # something stands before the mirror
                back = ray.geoms[0] == glass and met[-1] != mirror  # not held up by the frame, either way
                due.append(float(np.linalg.norm(line)) if room[k] > 0 else 0.0)
                if back != (room[k] > 0):
                    found.append(np.nan)
                elif not back:
                    found.append(0.0)
                else:
                    aside, past = passing(ray.points[1], ray.points[2] - ray.points[1], centre[k])
                    there = float(np.linalg.norm(ray.points[1] - eye)) + past
                    found.append(there if np.linalg.norm(aside) < self.radius / 10 else np.nan)
        if not 10 < due.count(0.0) < len(due) - 10:
            raise NotEvaluated("the ball is always in the mirror, or never")
        return found, due

    def room(self, eye: Array, image: Array, t: Array) -> Array:
        """How far inside the frame the line from an eye (3,) to an image (T, 3) crosses the mirror (T,) [m]; negative
        outside. It crosses twice: light passes between the bars on its way to the glass and on its way back."""
        n = self.normal
        sides = np.array([[0.0, 1.0, 0.0], [-n[2], 0.0, n[0]]])
        face = self.faces(t)
        start, end = (eye - face) @ n, (image - face) @ n
        inside = []
        for over in (PROUD, -PROUD):
            part = (start - over) / (start - end)
            at = eye + part[:, None] * (image - eye) - face
            inside.append((self.width, HIGH) - np.abs(at @ sides.T))
        return np.asarray(np.min(inside, axis=(0, 2)))

    @law("(M - P')·n = (P - M)·n", source="Euclid, Catoptrics, prop. 19", within=(1e-9, 1e-9, 1e-9), unit="m",
         limited_by=DRIVEN)  # fmt: skip
    def image_is_as_far_behind_as_the_thing_before(self, run: Run) -> Measurement:
        """39e: distances of the triangulated images from the mirror's plane, where it ought to be; and how far the line
        from thing to image leans over from the normal."""
        samples, images = self.looked(run)
        seen = enough(np.isfinite(images[..., 0]))
        points, face = self.points(run)[samples], self.faces(run.t[samples])[:, None]
        behind, before = (face - images) @ self.normal, (points - face) @ self.normal
        lean = np.linalg.norm(np.cross(images - points, self.normal), axis=2)
        return np.concatenate([behind[seen], lean[seen]]), np.concatenate([before[seen], 0 * lean[seen]])

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        leaning = "upright" if abs(self.tilt) < 0.02 else "leaning back" if self.tilt > 0 else "leaning forward"
        gone = np.isnan(self.ball_image(run)[-1, 0])
        end = "In the end the ball is past the mirror's edge, and its image gone" if gone else "All stay in the mirror"
        return (
            f"Before a framed mirror, {leaning}, a letter F turns on its stand at {self.turn:.1f} rad/s and a ball "
            f"hops past, dropped from {100 * self.height:.0f} cm. Each is seen a second time in the mirror, as far "
            f"behind the glass as it is before it, with left and right exchanged: the F can only be read the wrong way "
            f"round. The mirror slides {100 * self.travel:.0f} cm towards them, and the images come twice as far to "
            f"meet it. {end}."
        )


def enough(seen: Any) -> Any:
    """What is seen, an array of booleans; NotEvaluated if that is less than ten times in all."""
    if np.count_nonzero(seen) < 10:
        raise NotEvaluated("the things are hardly ever in the mirror for both eyes")
    return seen


def put(run: Run, data: mujoco.MjData, sample: int) -> None:
    """Pose the model as it was recorded at a sample."""
    data.qpos[:] = run.qpos[sample]
    mujoco.mj_kinematics(run.model, data)


def passing(start: Array, way: Array, place: Array) -> tuple[Array, float]:
    """Vector (3,) from a ray, from a point along a direction, to a place where it is nearest, and how far on [m]."""
    unit = way / np.linalg.norm(way)
    out = place - start
    return out - (out @ unit) * unit, float(out @ unit)


def sight_lines(run: Run, samples: NDArray[np.int64], eye: Array, places: Array) -> Array:
    """Directions (n, k, 3) in which an eye (3,) sees places (n, k, 3) [m] in the mirror at some samples; NaN where not.

    By trial, with no formula for images: a ray is traced from the eye to the glass and on, and aimed anew by Newton's
    method, the slopes from two more rays, until it passes the place within a picometre.
    """
    tracer, data, glass = Optics(run.model, run.scene), mujoco.MjData(run.model), run.model.geom(GLASS).id
    body, found = run.model.body(MIRROR).id, np.full(places.shape, np.nan)
    for i, sample in enumerate(samples):
        put(run, data, int(sample))
        middle, sides = data.xpos[body], data.xmat[body].reshape(3, 3)[:, 1:].T

        def look(aim: Array, place: Array) -> tuple[Array, Array] | None:
            """By how much the ray to a spot of the glass misses a place (3,), and its direction; None beside it."""
            way = middle + aim @ sides - eye  # noqa: B023  (called within the turn of the loop)
            ray = tracer.follow(data, eye, way / np.linalg.norm(way), reach=10.0, bounces=1)
            if ray.geoms[0] != glass or len(ray.points) < 3:
                return None
            return passing(ray.points[1], ray.points[2] - ray.points[1], place)[0], ray.points[1] - eye

        for k, place in enumerate(places[i]):
            aim, seen = np.zeros(2), look(np.zeros(2), place)
            for _ in range(12):
                if seen is None:
                    break
                miss, way = seen
                if np.linalg.norm(miss) < 1e-12:
                    found[i, k] = way / np.linalg.norm(way)
                    break
                nudge = -1e-4 * np.where(aim < 0, -1.0, 1.0)
                aside = [other for one in np.eye(2) if (other := look(aim + nudge * one, place))]
                if len(aside) < 2:
                    break
                slopes = np.column_stack([(other[0] - miss) / by for other, by in zip(aside, nudge, strict=True)])
                step = -np.linalg.lstsq(slopes, miss)[0]
                for part in (1.0, 0.7, 0.4, 0.1):
                    seen = look(aim + part * step, place)
                    if seen is not None:
                        aim = aim + part * step
                        break
    return found


def meeting(eyes: Array, ways: Array) -> Array:
    """Points (..., 3) [m] nearest to all lines from places (m, 3) along unit vectors (..., m, 3)."""
    across = np.eye(3) - ways[..., :, None] * ways[..., None, :]
    matrix, shift = across.sum(axis=-3), np.einsum("...mij,mj->...i", across, eyes)
    seen = np.isfinite(shift[..., 0])
    found = np.full(shift.shape, np.nan)
    found[seen] = np.linalg.solve(matrix[seen], shift[seen][..., None])[..., 0]
    return found
