"""38: something crosses a laser's beam, and all that the beam lit beyond goes dark."""

from __future__ import annotations

from math import cos, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipk

from phenomena import lasers
from phenomena.lasers import EXACT, enter, first_corners, on_plane, reflected, screen, shine, standing_mirror
from phenomena.parts import ball, sphere_mass
from phenomena.stands import gallows, hook
from physinone_mj import optics
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Motor, Scene, free_pose

Array = NDArray[np.float64]

BEFORE, AFTER, ON = 0.9, 1.0, 1.0
"""Laser to where things cross, that to the mirror, the mirror to the screen [m]."""

DENSITY: Final = 700.0
"""Of what crosses [kg/m³]."""

TABLE: Final = 0.4
"""Height of the table that the ball rolls on [m]."""

TRACK: Final = 0.11
"""Height of the cart's underside [m]."""

BEAM: Final = 0.5
"""Height of the beam where the bob swings or the block falls through it [m]."""

LONG: Final = 1.5
"""Half the length of the cart, over half its height [1]."""

RELEASE: Final = 1.0
"""When the block is let go [s]."""

SURE: Final = 1e-6
"""A beam that passes an edge within this may or may not meet it [m]."""

BODIES: Final = {"ball": "ball/ball", "pendulum": "bob/bob", "block": "block/block", "cart": "cart/glider"}

ROLLING: Final = Surface(friction=0.6, restitution=0.3)
SMOOTH: Final = Surface(friction=0.0, restitution=0.3)


class LaserBlock(Phenomenon, domain="optics"):
    """Laser is blocked by an object that crosses its beam: mirror and screen beyond it go dark until it has passed."""

    blocker: Annotated[
        Literal["ball", "pendulum", "block", "cart"], Choice("what crosses: it rolls, swings, falls or is driven")
    ] = "ball"
    speed: Annotated[float, Param("m/s", 0.2, 4.0, "of ball or cart; of the block, in the beam")] = 0.6
    size: Annotated[float, Param("m", 0.03, 0.1, "radius of ball or bob, half the height of block or cart")] = 0.07
    graze: Annotated[float, Param("1", 0.0, 1.3, "distance of the beam from the middle's way, over the size; but "
                                                 "for the block")] = 0.4  # fmt: skip
    yaw: Annotated[float, Param("rad", -0.3, 0.3, "of the beam, from straight across")] = 0.15
    rise: Annotated[float, Param("rad", 0.0, 0.08, "of the beam")] = 0.04
    length: Annotated[float, Param("m", 0.4, 1.0, "of the pendulum")] = 0.7
    swing: Annotated[float, Param("rad", 0.2, 1.0, "of the pendulum, to either side")] = 0.5

    @property
    def way(self) -> Array:
        """Direction (3,) of the beam."""
        return np.array([sin(self.yaw) * cos(self.rise), cos(self.yaw) * cos(self.rise), sin(self.rise)])

    @property
    def out(self) -> Array:
        """Direction (3,) of the beam beyond the mirror."""
        return np.array([-cos(self.yaw) * cos(self.rise), sin(self.yaw) * cos(self.rise), sin(self.rise)])

    @property
    def crossing(self) -> Array:
        """Point (3,) of the beam that is nearest to the way of the blocker's middle [m]."""
        if self.blocker == "ball":
            across = np.cross([1.0, 0.0, 0.0], self.way)
            return np.array([0.0, 0.0, TABLE + self.size]) + self.graze * self.size * across / np.linalg.norm(across)
        if self.blocker == "cart":
            return np.array([0.0, 0.0, TRACK + (1 + self.graze) * self.size])
        return np.array([0.0, 0.0, BEAM])

    @property
    def mouth(self) -> Array:
        """Where the beam starts (3,) [m]."""
        return self.crossing - BEFORE * self.way

    @property
    def glass(self) -> tuple[Array, Array]:
        """Middle (3,) [m] and normal (3,) of the mirror."""
        normal = self.out - self.way
        return self.crossing + AFTER * self.way, normal / np.linalg.norm(normal)

    @property
    def fall(self) -> float:
        """How far the block's middle falls as far as the beam, v²/2g [m]."""
        return self.speed**2 / (2 * g)

    @property
    def uneven(self) -> float:
        """How much higher the beam is at a face of block or cart than in the middle [m]."""
        return self.size / cos(self.yaw) * tan(self.rise)

    @property
    def run_up(self) -> float:
        """Of ball or cart, before the beam [m]."""
        return min(max(0.8 * self.speed, 0.35), 1.3)

    def build(self, scene: Scene) -> None:
        """Laser, mirror, screen, and what crosses between the first two."""
        scene.fps = 60
        place = {"ball": self.roll, "pendulum": self.hang, "block": self.drop, "cart": self.drive}
        time = place[self.blocker](scene)
        shine(scene, self.mouth, self.way)
        middle, normal = self.glass
        standing_mirror(scene, "mirror", middle, normal, (0.12, 0.1))
        x, y, z = (middle + ON * self.out).tolist()
        screen(scene, (x, y), (-self.out[0], -self.out[1]), (0.25, z + 0.2), name="screen")
        scene.resolve(time=time, length=self.size, duration=5.0)

    def roll(self, scene: Scene) -> float:
        """A ball that rolls along a table, already rolling when it starts; returns the time that matters [s]."""
        table, half = scene.add("table"), self.run_up + self.size + 0.15
        table.geom("top").size[0] = half
        for leg, side in (("left", -1), ("right", 1)):
            table.geom(f"{leg}_leg").pos[0] = side * (half - 0.2)
            table.geom(leg).pos[0], table.geom(leg).pos[2] = side * (half - 0.02), TABLE + self.size
            table.geom(leg).size[2] = self.size
        for body, surface in (("table", ROLLING), ("stops", SMOOTH)):
            scene.material(table.name(body), DENSITY, surface)
        part = ball(scene, "ball", self.size, DENSITY, ROLLING, (0.93, 0.55, 0.20))
        scene.start[part.name("free")] = free_pose((-self.run_up, 0, TABLE + self.size))
        scene.speed[part.name("free")] = (self.speed, 0, 0, 0, self.speed / self.size, 0)
        scene.touch(part.name("ball"), table.name("top"))
        for stop in ("left", "right"):
            scene.material(table.name(stop), DENSITY, SMOOTH)
            scene.touch(part.name("ball"), table.name(stop))
        scene.material(table.name("top"), DENSITY, ROLLING)
        return min(0.5, self.size / self.speed)

    def hang(self, scene: Scene) -> float:
        """A bob that swings under a gallows whose legs stand where it cannot get to."""
        lowest = BEAM + self.graze * self.size
        frame = gallows(scene, lowest + self.length, self.length * sin(self.swing) + self.size + 0.15)
        frame.body("frame").quat = lasers.turned(pi / 2)
        part = scene.add("bob")
        part.body("bob").pos[2] = lowest
        part.joint("hinge").pos[2] = self.length
        part.geom("rod").fromto = (0, 0, 0, 0, 0, self.length)
        part.geom("ball").size[0], part.geom("ball").mass = self.size, sphere_mass(self.size, DENSITY)
        scene.material(part.name("bob"), DENSITY, ROLLING)
        scene.start[part.name("hinge")] = -self.swing
        return sqrt(self.length / g)

    def drop(self, scene: Scene) -> float:
        """A block that hangs from a hook until it is let go."""
        least = self.size + self.uneven + 0.03
        if self.fall < least:
            raise Refusal("R12", f"speed = {self.speed:.3g} m/s: the block would hang in the beam; "
                          f"allowed here: {sqrt(2 * g * least):.3g} m/s or more")  # fmt: skip
        top = BEAM + self.fall + self.size
        frame = gallows(scene, top + 0.045, 0.35)
        frame.body("frame").quat = lasers.turned(pi / 2)
        above = hook(scene, top)
        part = scene.add("block")
        part.geom("block").size[:] = self.size
        part.geom("block").mass = DENSITY * (2 * self.size) ** 3
        part.geom("block").rgba = (0.84, 0.27, 0.22, 1.0)
        part.body("block").add_site(name=part.name("top"), pos=(0, 0, self.size))
        scene.start[part.name("free")] = free_pose((0, 0, BEAM + self.fall))
        scene.material(part.name("block"), DENSITY, ROLLING)
        scene.material("stage/floor", 2400.0, ROLLING)
        scene.touch(part.name("block"), "stage/floor")
        scene.connect("hold", part.name("top"), above.name("hook"))
        scene.cuts["hold"] = RELEASE
        return self.size / self.speed

    def drive(self, scene: Scene) -> float:
        """A cart that is driven along a track at even speed, and stopped before its end."""
        part, half = scene.add("glider", "cart"), LONG * self.size
        end = self.run_up + half + 0.1
        part.geom("beam").pos[0], part.geom("beam").size[0] = 0.0, end
        for foot, side in (("left_foot", -1), ("right_foot", 1)):
            part.geom(foot).pos[0] = side * (end - 0.1)
        part.body("glider").pos[:] = (0, 0, TRACK + self.size)
        part.geom("block").size[:], part.geom("block").mass = (half, self.size, self.size), 1.0
        for trim in ("stripe", "nose"):
            scene.spec.delete(part.geom(trim))
        scene.material(part.name("track"), DENSITY, ROLLING)
        scene.material(part.name("glider"), DENSITY, ROLLING)
        joint = part.name("glider")
        clear = half + self.size * tan(abs(self.yaw)) + 0.03  # past the beam, it is stopped within a decimetre
        brake = (self.run_up + clear) / self.speed
        scene.start[joint], scene.speed[joint] = -self.run_up, self.speed
        scene.motors.append(Motor(joint, ((0.0, self.speed), (brake, self.speed), (brake + 0.2 / self.speed, 0.0))))
        return min(0.5, self.size / self.speed)

    def reach(self, run: Run, margin: float = 0.0) -> Array:
        """Distance (T,) along the beam at which it enters the blocker, from its recorded pose; infinite if it does not.

        A ball: t = -b - √(b² - c); a box: the last of the planes that it passes inwards. margin: both are larger [m]
        """
        body = BODIES[self.blocker]
        out = self.mouth - run.position(body)
        if self.blocker in ("ball", "pendulum"):
            along, gap = out @ self.way, (out**2).sum(axis=1) - (self.size + margin) ** 2
            under = along**2 - gap
            return np.where((under > 0) & (along < 0), -along - np.sqrt(np.maximum(under, 0)), np.inf)
        half = self.size * np.array([LONG if self.blocker == "cart" else 1.0, 1.0, 1.0]) + margin
        turn = quaternion_matrix(run.quaternion(body))
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        return enter(np.einsum("tji,tj->ti", turn, out), self.way @ turn, axes, np.tile(half, 2))[0]

    def blocked(self, run: Run) -> tuple[list[float], list[float]]:
        """When the blocker enters the beam, and when it leaves it [s], both found between the samples."""
        number = run.model.body(BODIES[self.blocker]).id
        into, out = [], []
        for change in optics.changes(run, "laser"):
            before, after = (bool(met) and met[0] >= 0 and run.model.geom_bodyid[met[0]] == number
                             for met in (change.before, change.after))  # fmt: skip
            if after and not before:
                into.append(change.time)
            elif before and not after:
                out.append(change.time)
        return into, out

    def due_duration(self) -> float:
        """How long the beam ought to be blocked by what crosses it once [s]."""
        if self.blocker == "ball":
            slanted = sqrt(1 - self.way[0] ** 2)  # sine of the angle between the beam and the ball's way
            return 2 * self.size * sqrt(max(0.0, 1 - self.graze**2)) / (self.speed * slanted)
        if self.blocker == "cart":
            if self.graze * self.size + self.uneven >= self.size:
                raise NotEvaluated("the beam passes over an edge of the cart, or over it")
            return 2 * self.size * (LONG + tan(abs(self.yaw))) / self.speed
        near, far = self.fall - self.size - self.uneven, self.fall + self.size + self.uneven
        return sqrt(2 * far / g) - sqrt(2 * near / g)

    @observable("m")
    def beam_path(self, run: Run) -> Array:
        """Where the beam starts, is reflected and ends (T, 3, 3)."""
        return lasers.path(optics.trace(run, "laser"))

    @observable("m")
    def beam_length(self, run: Run) -> Array:
        """Length of the whole beam (T,)."""
        return np.asarray(np.nansum(np.linalg.norm(np.diff(optics.trace(run, "laser").points, axis=1), axis=2), axis=1))

    @observable("1")
    def met(self, run: Run) -> Array:
        """Number of the body that the beam meets first (T,)."""
        return lasers.met(run, optics.trace(run, "laser"))[:, 0].astype(float)

    @observable("1")
    def lit(self, run: Run) -> Array:
        """1 while the beam gets to the screen (T,)."""
        board = run.model.body("screen/screen").id
        return np.asarray((lasers.met(run, optics.trace(run, "laser")) == board).any(axis=1), float)

    @law("t = -b - √(b² - c)", source="Born & Wolf, Principles of Optics, §3.2.1; a line and a sphere, or planes",
         within=(1e-9, 1e-9, 1e-9), unit="m", limited_by=EXACT)  # fmt: skip
    def beam_ends_where_it_first_meets_something(self, run: Run) -> Measurement:
        """38a: corners of the beam, with the blocker where it is recorded: blocked, it ends there, and there is no more
        of it; free, it meets the mirror and the screen. NaN if it meets anything else, or more, or less."""
        rays = optics.trace(run, "laser")
        corners, geoms = first_corners(rays, 2)
        middle, normal = self.glass
        far = float((on_plane(self.mouth, self.way, middle, normal) - self.mouth) @ self.way)
        reach = self.reach(run)
        hides = reach < far
        sure = np.all([(self.reach(run, side * SURE) < far) == hides for side in (-1, 1)], axis=0)
        glass, board = (run.model.geom(name).id for name in ("mirror/glass", "screen/board"))
        body = run.model.body(BODIES[self.blocker]).id
        pieces = lasers.pieces(rays)
        stopped = (pieces == 1) & (geoms[:, 0] >= 0) & (run.model.geom_bodyid[geoms[:, 0]] == body)
        free = (pieces == 2) & (geoms == (glass, board)).all(axis=1)
        right = np.where(hides, stopped, free)
        mirror = self.mouth + far * self.way
        end = on_plane(mirror, reflected(self.way, normal), mirror + ON * self.out, self.out * (1, 1, 0))
        first = np.where(hides[:, None], self.mouth + np.where(hides, reach, 0.0)[:, None] * self.way, mirror)
        second = np.where(hides[:, None], first, end)
        found = np.where(hides[:, None, None], corners[:, [1, 1]], corners[:, 1:])
        return np.where(right[:, None, None], found, np.nan)[sure], np.stack([first, second], axis=1)[sure]

    @law("Δt = 2 √(r² - d²)/v", source="Euclid, Elements, book III, prop. 3: a chord and its distance from the centre",
         within=(1e-5, 1e-6, 1e-7), limited_by="instants between samples follow a cubic")  # fmt: skip
    def dark_for_as_long_as_the_chord_takes(self, run: Run) -> Measurement:
        """38b: how long it is dark when the blocker crosses for the first time; with v sin γ if it crosses aslant; of a
        cart its length, of a falling block its height. A twin with a ball, or with the beam nearer to the middle, if
        the pendulum swings or if the beam is not blocked."""
        twin = run
        if self.blocker == "pendulum" or self.graze > 0.9:
            other = "ball" if self.blocker == "pendulum" else self.blocker
            twin = run.again(blocker=other, graze=min(self.graze, 0.5))
        into, out = twin.specimen.blocked(twin)
        if not out:
            return np.nan, twin.specimen.due_duration()
        same = twin is run
        return out[0] - into[0], (self if same else twin.specimen).due_duration()

    @law("T = 4 √(I/(m g ℓ)) K(sin² θ₀/2)", source="Landau & Lifshitz, Mechanics, §11 problem 1",
         within=(1e-6, 1e-7, 1e-7), limited_by="instants between samples follow a cubic")  # fmt: skip
    def pendulum_cuts_the_beam_twice_a_period(self, run: Run) -> Measurement:
        """38c: time from every cut to the second next one (a twin, if no pendulum swings or it misses the beam)."""
        good = self.blocker == "pendulum" and self.graze < 0.9
        twin = run if good else run.again(blocker="pendulum", graze=min(self.graze, 0.5))
        into, _ = twin.specimen.blocked(twin)
        if len(into) < 3:
            raise NotEvaluated(f"{len(into)} cuts recorded; needed: 3")
        reduced = self.length + 2 / 5 * self.size**2 / self.length
        period = 4 * sqrt(reduced / g) * ellipk(sin(self.swing / 2) ** 2)
        return np.subtract(into[2:], into[:-2]), np.full(len(into) - 2, period)

    @law("d > r: Δt = 0", source="by definition: a ball; beyond its radius there is none of it",
         within=(1e-4, 1e-5, 1e-5), limited_by="instants between samples follow a cubic")  # fmt: skip
    def what_does_not_touch_the_beam_does_not_block_it(self, run: Run) -> Measurement:
        """38d: how long a ball whose middle passes at 0.99 of its radius blocks it, over what is due; and how often
        and in how many samples one at 1.01 does."""
        near, beside = (run.again(blocker="ball", graze=graze) for graze in (0.99, 1.01))
        into, out = near.specimen.blocked(near)
        slanted = sqrt(1 - self.way[0] ** 2)
        due = 2 * self.size * sqrt(1 - 0.99**2) / (self.speed * slanted)
        first = (out[0] - into[0]) / due if out else np.nan
        cut, dark = len(beside.specimen.blocked(beside)[0]), float(np.sum(beside.specimen.lit(beside) == 0))
        return [first, cut, dark], [1.0, 0.0, 0.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        dark = 1 - float(self.lit(run).mean())
        what = {
            "ball": f"an orange ball rolls along a table at {self.speed:.2g} m/s",
            "pendulum": f"a violet bob swings to and fro on a rod of {self.length:.2g} m",
            "block": f"a red block, let go after {RELEASE:.0f} s, falls from its hook",
            "cart": f"a blue cart is driven along a track at {self.speed:.2g} m/s",
        }[self.blocker]
        into = len(self.blocked(run)[0])
        outcome = (
            f"Whenever it is in the beam, the beam ends on it, and the mirror and the screen beyond are dark: "
            f"{into} time{'s' if into > 1 else ''}, for {dark * run.t[-1]:.2f} s in all. As soon as it has passed, "
            "light falls on them again"
            if into
            else "It passes close by without touching the beam, and nothing goes dark"
        )
        return (
            f"A laser shines past the middle of the scene at a small framed mirror, which sends the beam on to a white "
            f"screen. Between laser and mirror {what}. {outcome}."
        )
