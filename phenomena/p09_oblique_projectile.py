"""9: a ball or a tumbling box, thrown from a tube."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Annotated, Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, peaks, value
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

SIDES = np.array([1.0, 0.6, 0.25])
"""Half sides of the box, in sizes: a book's. Its middle axis of inertia is y."""

WOBBLE = 0.05
"""Sine of the angles by which the box's spin misses its middle axis: from it the flip grows."""

SMALLEST = 1 / 120
"""Size of the projectile against the width of the scene: less is a few pixels."""


class ObliqueProjectile(Phenomenon, domain="mechanics"):
    """Objects are thrown up at an angle and fly along a parabola."""

    speed: Annotated[float, Param("m/s", 1.0, 7.0, "at the mouth of the tube")] = 4.5
    angle: Annotated[float, Param("rad", 0.2618, 1.4835, "of the tube above the horizontal")] = 0.96
    height: Annotated[float, Param("m", 0.0, 1.5, "of the table that the tube stands on")] = 0.4
    size: Annotated[float, Param("m", 0.03, 0.1, "radius of the ball, half the longest side of the box")] = 0.07
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "of the projectile")] = 600.0
    spin: Annotated[float, Param("rad/s", 0.0, 20.0, "backwards, about the horizontal axis across the flight")] = 12.0
    thrown: Annotated[Literal["ball", "box"], Choice("what is thrown; the box tumbles")] = "ball"

    @property
    def body(self) -> str:
        """The projectile's name in the scene."""
        return "ball/ball" if self.thrown == "ball" else "die/die"

    @property
    def reach(self) -> float:
        """From the projectile's centre to its outermost point [m]."""
        return self.size if self.thrown == "ball" else self.size * float(np.linalg.norm(SIDES))

    @property
    def start(self) -> Array:
        """Of the projectile's centre (3,) [m]: just out of the tube."""
        breech = self.height + 0.06 + 1.2 * self.reach * cos(self.angle)
        return np.array([0.0, 0.0, breech + 5 * self.reach * sin(self.angle)])

    @property
    def fall(self) -> float:
        """From the start to where the ball touches the floor [m]."""
        return float(self.start[2]) - self.size

    def apex(self) -> float:
        """Of the flight, above the start [m]."""
        return (self.speed * sin(self.angle)) ** 2 / (2 * g)

    def range(self, fall: float) -> float:
        """How far it flies until it is `fall` below the start [m]."""
        up = self.speed * sin(self.angle)
        return self.speed * cos(self.angle) / g * (up + sqrt(up**2 + 2 * g * fall))

    def build(self, scene: Scene) -> None:
        """A table, a tube on it, the projectile at its mouth, and a wall of foam that stops what rolls on."""
        wide = max(self.range(self.fall) + 0.8, self.fall + self.apex())
        if self.size < SMALLEST * wide:
            raise Refusal("R12", f"size = {self.size:.3g} m in a scene {wide:.2g} m wide is too small to be seen; "
                          f"allowed: {SMALLEST * wide:.3g} m or more, or a lower speed")  # fmt: skip
        self._aim(scene)
        floor = Surface(friction=0.5, restitution=0.35)
        scene.material("stage/floor", 2000.0, floor)
        for name in ("pad/foam", "pad/pad"):
            scene.material(name, 50.0, Surface(friction=0.1, restitution=0.05))
        scene.material("launcher/table", 600.0, floor)
        scene.material("launcher/tube", 7800.0, floor)
        geom = self._load(scene)
        for name in (geom, self.body):
            scene.material(name, self.density, floor)
        scene.touch(geom, "stage/floor")
        scene.touch(geom, "pad/foam")
        stop = scene.add("pad")
        stop.body("pad").pos[0] = self.range(self.fall) + 0.8
        for block, more in (("foam", 0.0), ("back", 0.02)):
            stop.geom(block).pos[2], stop.geom(block).size[1:] = 0.25 + more, (0.5 + more, 0.25 + more)
        flight = self.range(self.fall) / (self.speed * cos(self.angle))
        scene.resolve(time=0.05, length=self.size, duration=min(10.0, max(4.0, flight + 3.0)))

    def _aim(self, scene: Scene) -> None:
        part = scene.add("launcher")
        long, bore = 4 * self.reach, 1.1 * self.reach
        along = np.array([cos(self.angle), 0.0, sin(self.angle)])
        mouth = self.start - self.reach * along
        breech = mouth - long * along
        part.body("tube").pos, part.body("tube").quat = mouth, (cos(self.angle / 2), 0, -sin(self.angle / 2), 0)
        for i in range(12):
            turn, stave = i * pi / 6, part.geom(f"stave{i}")
            stave.pos = (-long / 2, bore * cos(turn), bore * sin(turn))
            stave.size = (long / 2, 0.004, 0.28 * bore)
        part.geom("breech").pos[0], part.geom("breech").size[0] = -long, bore
        top = self.height + 0.04
        part.body("table").pos = (breech[0] + 0.3 * long * along[0], 0, top / 2)
        part.geom("top").size = (0.1 + 2 * self.reach, 0.05 + 1.5 * self.reach, top / 2)
        cheek = breech[2] - self.height + bore
        for name, side in (("left_cheek", -1), ("right_cheek", 1)):
            across = side * (bore + 0.014)
            part.geom(name).pos = (
                breech[0] + 0.15 * long * along[0] - part.body("table").pos[0],
                across,
                (top + cheek) / 2,
            )
            part.geom(name).size = (0.5 * self.reach, 0.008, cheek / 2)

    def _load(self, scene: Scene) -> str:
        velocity = self.speed * np.array([cos(self.angle), 0.0, sin(self.angle)])
        if self.thrown == "ball":
            part, axis = scene.add("ball"), np.array([0.0, -1.0, 0.0])
            part.geom("ball").size[0] = self.size
            part.geom("ball").mass, geom = self.density * 4 / 3 * pi * self.size**3, "ball"
        else:
            part, axis = scene.add("die"), np.array([WOBBLE, -sqrt(1 - 2 * WOBBLE**2), WOBBLE])
            part.geom("box").size = self.size * SIDES
            part.geom("box").mass, geom = self.density * 8 * self.size**3 * SIDES.prod(), "box"
            part.geom("badge").pos[0], part.geom("badge").size[:2] = (
                0.5 * self.size,
                (0.25 * self.size, 0.256 * self.size),
            )
        scene.start[part.name("free")] = free_pose(self.start)
        scene.speed[part.name("free")] = np.concatenate([velocity, self.spin * axis])
        return part.name(geom)

    @observable("m")
    def path(self, run: Run) -> Array:
        """Centre of mass (T, 3)."""
        return run.position(self.body)

    @observable("rad/s")
    def rotation(self, run: Run) -> Array:
        """Angular velocity in world axes (T, 3)."""
        return run.spin(self.body)

    def landing(self, run: Run) -> float:
        """Time of the first touch [s]; NotEvaluated if there is none."""
        if not run.impacts:
            raise NotEvaluated(f"still in flight after {run.t[-1]:.3g} s")
        return run.impacts[0].time

    def in_flight(self, run: Run) -> NDArray[np.bool_]:
        """Samples before the first touch (T,)."""
        return between(run.t, -1.0, self.landing(run), least=10)

    def as_thrown(self, run: Run, thrown: str) -> Run:
        """The run, if that is what it throws, or a twin."""
        return run if self.thrown == thrown else run.again(thrown=thrown)

    @law("z = z₀ + v₀ sin θ t - ½ g t², x = v₀ cos θ t", within=(1e-11, 1e-11, 1e-11),
         source="Landau & Lifshitz, Mechanics, §5; Galilei, Discorsi, fourth day")  # fmt: skip
    def path_is_a_parabola(self, run: Run) -> Measurement:
        """9a: every sample of the flight; relative to the largest coordinate."""
        flight = self.in_flight(run)
        t = run.t[flight]
        up, along = self.speed * sin(self.angle), self.speed * cos(self.angle)
        expected = np.column_stack([along * t, 0 * t, up * t - g * t**2 / 2])
        return run.position(self.body)[flight] - self.start, expected

    @law("z̈ = -g", source="CGPM 1901: g = 9.80665 m/s²", within=(1e-10, 1e-10, 1e-10))
    def the_fall_is_that_of_gravity(self, run: Run) -> Measurement:
        """9a: the quadratic coefficient, by least squares on the heights of the flight."""
        flight = self.in_flight(run)
        return -acceleration(run.t[flight], run.position(self.body)[flight, 2]), g

    @law(
        "v_x = v₀ cos θ",
        source="Newton, Principia, law I; Landau & Lifshitz, Mechanics, §3",
        within=(1e-12, 1e-12, 1e-12),
    )
    def nothing_slows_it_sideways(self, run: Run) -> Measurement:
        """9a: the horizontal velocity, which hidden damping would shrink."""
        flight = self.in_flight(run)
        forward = run.velocity(self.body)[flight, 0]
        return forward, np.full(len(forward), self.speed * cos(self.angle))

    @law("R = (v₀ cos θ/g)(v₀ sin θ + √(v₀² sin² θ + 2 g h)), H = v₀² sin² θ/2g", within=(1e-8, 1e-8, 1e-8),
         source="Landau & Lifshitz, Mechanics, §5", limited_by="an impact is located to a nanometre")  # fmt: skip
    def range_and_apex(self, run: Run) -> Measurement:
        """9b: of the ball: where its centre is at the first touch of the floor, and its highest point."""
        ball = self.as_thrown(run, "ball")
        same = cast(ObliqueProjectile, ball.specimen)
        x, v = ball.position("ball/ball") - same.start, ball.velocity("ball/ball")
        n = int(np.sum(self.in_flight(ball)))
        landed = value(ball.t[:n], x[:n, 0], v[:n, 0], self.landing(ball))
        _, heights = peaks(ball.t[:n], x[:n, 2], v[:n, 2])
        if not len(heights):
            raise NotEvaluated("the apex is within the first sample")
        fall = same.fall if ball is not run else self.fall
        return [landed, heights[0]], [self.range(fall), self.apex()]

    @law(
        "x(t; ρ, size, spin, shape) = x(t)", source="Galilei, Discorsi (1638), first day", within=(1e-11, 1e-11, 1e-12)
    )
    def matter_size_and_spin_do_not_matter(self, run: Run) -> Measurement:
        """9c: displacements of this projectile and of another, heavier or lighter, larger, and turning otherwise."""
        other = run.again(
            density=4000.0 if self.density < 1500 else 300.0, size=0.1 if self.size < 0.085 else 0.08,
            spin=20.0 - self.spin, thrown="box" if self.thrown == "ball" else "ball",
        )  # fmt: skip
        twin = cast(ObliqueProjectile, other.specimen)
        n = min(int(np.sum(self.in_flight(r))) for r in (run, other))
        both = [r.position(s.body)[:n] - r.position(s.body)[0] for r, s in ((other, twin), (run, self))]
        return both[0], both[1]

    def tumbling(self, run: Run) -> Run:
        """The run, if it throws a box that turns, or a twin that throws one at 20 rad/s."""
        return run if self.thrown == "box" and self.spin >= 1 else run.again(thrown="box", spin=20.0)

    @law("dL/dt = 0, dE/dt = 0", source="Landau & Lifshitz, Mechanics, §33, §36", within=(1e-8, 1e-10, 1e-11))
    def tumbling_keeps_its_angular_momentum(self, run: Run) -> Measurement:
        """9d: angular momentum about the centre of mass, as a vector, and energy of rotation, of the box in flight."""
        box = self.tumbling(run)
        flight = self.in_flight(box)
        spin, inertia = box.spin("die/die")[flight], box.inertia("die/die")[flight]
        momentum = np.einsum("tij,tj->ti", inertia, spin)
        energy = np.sum(spin * momentum, axis=1)
        scale = np.linalg.norm(momentum[0])
        measured = np.column_stack([momentum / scale, energy / energy[0]])
        return measured, np.tile(measured[0], (len(measured), 1))

    @law(
        "I₁ ω̇₁ = (I₂ - I₃) ω₂ ω₃, ...", source="Landau & Lifshitz, Mechanics, §36 eq. 36.5", within=(1e-8, 1e-10, 1e-11)
    )
    def tumbling_is_eulers(self, run: Run) -> Measurement:
        """9d: angular velocity in the box's own axes, against Euler's equations: the box flips over."""
        box = self.tumbling(run)
        flight = self.in_flight(box)
        axes = quaternion_matrix(box.quaternion("die/die")[flight])
        spin = np.einsum("tij,ti->tj", axes, box.spin("die/die")[flight])
        squares = SIDES**2
        moments = squares.sum() - squares

        def euler(_t: float, w: Array) -> Array:
            return np.asarray(np.cross(moments * w, w) / moments)

        start = np.array([WOBBLE, -sqrt(1 - 2 * WOBBLE**2), WOBBLE]) * (self.spin if box is run else 20.0)
        t = box.t[flight]
        found = solve_ivp(euler, (0.0, t[-1]), start, "DOP853", t, rtol=1e-13, atol=1e-13)
        return spin, found.y.T

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        thing = "A ball" if self.thrown == "ball" else "A flat box, tumbling about its middle axis,"
        landing = run.impacts[0].time if run.impacts else run.t[-1]
        return (
            f"{thing} leaves a tube at {self.speed:.1f} m/s, {np.degrees(self.angle):.0f} degrees above the horizontal "
            f"and {self.start[2]:.2f} m above the floor. Only gravity acts: its pace along the ground stays the same "
            f"while it rises {self.apex():.2f} m and falls, drawing a parabola, whatever its mass. It lands after "
            f"{landing:.2f} s, {self.range(self.fall):.1f} m away, bounces, and a wall of foam stops it."
        )
