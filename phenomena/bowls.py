"""Spinning glass bowls, and what rolls, rides and slips in them.

Angles are polar: from the bottom of the bowl, at the centre of its sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, cos, pi, sin, sqrt
from typing import Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from phenomena.parts import ball
from phenomena.spins import Course
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.run import Run
from physinone_mj.scene import Bowl, Part, Scene, free_pose

Array = NDArray[np.float64]

HINGE: Final = "bowl/hinge"
SHELL: Final = "bowl/shell"

LIFT: Final = 0.12
"""Height of the bowl's bottom over the ground [m]."""

THICK: Final = 0.004
"""Thickness of the glass [m]."""

GLASS: Final = 2500.0
"""Density of the bowl [kg/m³]."""

SOLID: Final = 2 / 5
"""Moment of inertia of a solid ball, in units of m r²."""

_ROUND, _UP = 64, 24
"""Facets of the picture of a bowl, round and up."""


def revolve(profile: ArrayLike, sectors: ArrayLike = ((0.0, 2 * pi),)) -> tuple[Array, NDArray[np.int32]]:
    """Vertices (n, 3) and faces (m, 3) of a closed outline (k, 2) of (distance, height) turned about the z axis.

    The outline goes round anticlockwise; sectors: azimuths between which it is turned [rad], whole or not.
    """
    outline = np.asarray(profile, float)
    k = len(outline)
    vertices: list[Array] = []
    faces: list[tuple[int, int, int]] = []
    for begin, end in np.asarray(sectors, float):
        whole = end - begin > 2 * pi - 1e-9
        count = max(2, round(_ROUND * (end - begin) / (2 * pi)))
        angles = np.linspace(begin, end, count + 1)[: count if whole else None]
        first = sum(map(len, vertices))
        for angle in angles:
            vertices.append(np.column_stack([outline[:, 0] * cos(angle), outline[:, 0] * sin(angle), outline[:, 1]]))
        for i in range(count):
            a, b = first + i * k, first + (i + 1) % len(angles) * k
            for j in range(k):
                n = (j + 1) % k
                faces += [(a + j, b + j, b + n), (a + j, b + n, a + n)]
        if not whole:
            last = first + count * k
            for j in range(k // 2 - 1):
                quad = (j, j + 1, k - 2 - j, k - 1 - j)
                for cap, turned in ((first, False), (last, True)):
                    p, q, r, s = (cap + v for v in quad)
                    faces += [(p, r, q), (p, s, r)] if turned else [(p, q, r), (p, r, s)]
    return np.concatenate(vertices), np.array(faces, np.int32)


def _arc(inner: float, outer: float, low: float, high: float) -> Array:
    """Outline of a spherical shell between two radii and two polar angles, its sphere's centre at the origin."""
    angles = np.linspace(low, high, _UP)
    out = np.column_stack([np.sin(angles), -np.cos(angles)])
    return np.concatenate([outer * out, inner * out[::-1]])


def _mesh(scene: Scene, part: Part, geom: str, made: tuple[Array, NDArray[np.int32]]) -> None:
    vertices, faces = made
    scene.spec.add_mesh(
        name=part.name(geom + "_mesh"), uservert=vertices.ravel(), userface=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    part.geom(geom).meshname = part.name(geom + "_mesh")


def bowl(scene: Scene, radius: float, rim: float, course: Course, surface: Surface) -> Part:
    """A glass bowl turned by a motor: inner radius [m], polar angle of its rim [rad]."""
    part = scene.add("bowl")
    body, middle = part.body("bowl"), radius * (1 + cos(rim)) / 2  # of a thin cap, below the centre of its sphere
    body.pos[2] = LIFT + radius - middle
    mass = GLASS * 2 * pi * radius**2 * (1 - cos(rim)) * THICK
    body.mass, body.inertia[:] = mass, mass * radius**2 / 3
    part.site("centre").pos[2] = middle
    outside = radius + THICK
    _mesh(scene, part, "shell", revolve(_arc(radius, outside, 1e-3, rim)))
    quarters = np.arange(4) * pi / 2
    bands = np.column_stack([quarters - 0.05, quarters + 0.05])
    _mesh(scene, part, "bands", revolve(_arc(outside - 0.001, outside + 0.001, 0.3, rim), bands))
    thin = np.linspace(0, 2 * pi, 12, endpoint=False)
    edge = (radius + THICK / 2) * np.array([sin(rim), -cos(rim)])
    _mesh(scene, part, "rim", revolve(edge + 0.8 * THICK * np.column_stack([np.cos(thin), np.sin(thin)])))
    for geom in ("shell", "bands", "rim"):
        part.geom(geom).pos[2] = middle
    shaft, motor = part.geom("shaft"), part.geom("motor")
    motor.pos[2], motor.size[:2] = 0.04, (0.06, 0.04)
    shaft.size[1] = (LIFT - THICK - 0.08) / 2
    shaft.pos[2] = middle - radius - THICK - shaft.size[1]
    for name, density in ((SHELL, GLASS), (part.name("bowl"), GLASS), (part.name("stand"), 7800.0)):
        scene.material(name, density, surface)
    scene.bowls.append(Bowl(SHELL, part.name("centre"), radius, -radius * cos(rim)))
    scene.motors.append(course.motor(HINGE))
    scene.speed[HINGE] = course.first
    return part


def centre(radius: float) -> Array:
    """Of the bowl's sphere (3,) [m]."""
    return np.array([0.0, 0.0, LIFT + radius])


def outwards(angle: float, azimuth: float) -> Array:
    """Unit vector (3,) from the centre to a place in the bowl."""
    return np.array([sin(angle) * cos(azimuth), sin(angle) * sin(azimuth), -cos(angle)])


def polar(run: Run, body: str, radius: float) -> Array:
    """Polar angle of a centre of mass in the bowl (T,) [rad]."""
    x = run.position(body) - centre(radius)
    return np.arctan2(np.hypot(x[:, 0], x[:, 1]), -x[:, 2])


def place_ball(
    scene: Scene, name: str, size: float, density: float, surface: Surface, colour: tuple[float, float, float]
) -> Part:
    """A ball of radius `size` [m] that can touch the bowl, the ground and the rails."""
    part = ball(scene, name, size, density, surface, colour)
    for other in (SHELL, "stage/floor", "court/rails"):
        scene.touch(part.name("ball"), other)
    return part


def place_cube(
    scene: Scene, name: str, half: float, density: float, surface: Surface, colour: tuple[float, float, float]
) -> Part:
    """A loose cube of half edge `half` [m] that can touch the bowl, the ground and the rails."""
    part = scene.add("block", name)
    geom = part.geom("block")
    geom.size[:], geom.mass, geom.rgba = half, density * 8 * half**3, (*colour, 1.0)
    scene.material(part.name("block"), density, surface)
    for other in (SHELL, "stage/floor", "court/rails"):
        scene.touch(part.name("block"), other)
    return part


def start_ball(
    scene: Scene, joint: str, radius: float, size: float, where: tuple[float, float], spin: float, *, riding: bool
) -> None:
    """Put a ball of radius `size` into a bowl that turns with `spin`, at (polar angle, azimuth) [rad].

    riding: it turns with the bowl; otherwise its centre is at rest and it rolls on the spot
    """
    n = outwards(*where)
    reach = radius - size
    axis = np.array([0.0, 0.0, 1.0])
    scene.start[joint] = free_pose(centre(radius) + reach * n)
    if riding:
        scene.speed[joint] = (*(spin * reach * np.cross(axis, n)), 0.0, 0.0, spin)
    else:
        scene.speed[joint] = (0.0, 0.0, 0.0, *(spin * radius / size * (axis - n[2] * n)))


def start_cube(scene: Scene, joint: str, radius: float, half: float, where: tuple[float, float], spin: float) -> None:
    """Put a cube of half edge `half` into the bowl on its four corners, turning with it."""
    angle, azimuth = where
    n = outwards(angle, azimuth)
    turn = (cos(azimuth / 2), 0.0, 0.0, sin(azimuth / 2))
    lean = (cos(angle / 2), 0.0, -sin(angle / 2), 0.0)
    q = np.zeros(4)
    mujoco.mju_mulQuat(q, np.array(turn), np.array(lean))
    scene.start[joint] = free_pose(centre(radius) + Cube(radius, half).reach * n, q)
    inside = np.zeros(3)
    mujoco.mju_rotVecQuat(inside, np.array([0.0, 0.0, spin]), q * [1, -1, -1, -1])
    v = spin * Cube(radius, half).reach * np.cross((0.0, 0.0, 1.0), n)
    scene.speed[joint] = (*v, *inside)


def ridden_angle(radius: float, size: float, spin: float) -> float:
    """Polar angle at which a ball turns with the bowl without friction [rad]: cos θ = g/(Ω² R_e), or 0."""
    pull = spin**2 * (radius - size) / g
    return acos(1 / pull) if pull > 1 else 0.0


@dataclass(frozen=True)
class Cube:
    """A cube on its four corners inside a sphere: radius of the sphere and half edge [m]."""

    radius: float
    half: float

    @property
    def depth(self) -> float:
        """From the centre of the sphere to the face on which it stands [m]."""
        return sqrt(self.radius**2 - 2 * self.half**2)

    @property
    def reach(self) -> float:
        """From the centre of the sphere to that of the cube [m]."""
        return self.depth - self.half

    @property
    def arm(self) -> float:
        """Of the friction at a corner about the line through the sphere's centre, across the way it slips [m]."""
        return sqrt(self.radius**2 - self.half**2)

    def tips(self, friction: float) -> float:
        """Difference of the pressures on the corners before and behind over their sum when it slips: at 1 it tips."""
        h, d, s = self.half, self.depth, self.arm
        return friction * self.radius * (h + d) / (self.reach * s)

    def grip(self, friction: float) -> float:
        """Force along the wall that it stands, over the force into it: more than μ, for its corners stand askew.

        Statics of a cube about to slide along a meridian: forces along and into the wall, and the moment about the
        sphere's centre, in which the pressures have no part.
        """
        h, d, s = self.half, self.depth, self.arm
        pressed = d / self.radius - friction**2 * h * self.radius * (h + d) / (self.reach * s**2)
        return friction * s / (self.reach * pressed)

    def dragged(self, angle: float, rate: float) -> float:
        """Round the axis, on what turns with a bowl that speeds up, over its mass [m/s²]; it slips as if by so much.

        What lags behind turns about the bowl's axis: m (ρ² + 2 h²/3) α against friction at corners whose mean distance
        from it is ρ (1 + h²/2ρ²), where ρ is the centre's; hence α √(ρ² + h²/3), to second order in h/ρ. A bound from
        above, as any one way to slip gives: cubes with h up to .66 ρ were seen to slip at -0.1 to +0.6 % of it.
        """
        return rate * sqrt((self.reach * sin(angle)) ** 2 + self.half**2 / 3)

    def along(self, angle: float, spin: float) -> float:
        """Down the wall, on what turns with the bowl [m/s²]: gravity less the centrifugal force."""
        return g * sin(angle) - spin**2 * self.reach * sin(angle) * cos(angle)

    def into(self, angle: float, spin: float) -> float:
        """Into the wall, likewise [m/s²]."""
        return g * cos(angle) + spin**2 * self.reach * sin(angle) ** 2


@dataclass(frozen=True)
class Rolling:
    """The motion of a solid ball that rolls without slipping in a turning bowl.

    n: unit vector from the bowl's centre to the ball, w: the ball's angular velocity, k = 2/5, R_e = R - r:
    (1 + 1/k) F/m = P [Ω̇ R ẑ×n + Ω R ẑ×ṅ - r w×ṅ - g], R_e n̈ = F/m + P g - R_e |ṅ|² n, ẇ = n × F/(k m r),
    P = 1 - n n. Source: the rolling condition R_e ṅ + r w×n = Ω R ẑ×n, differentiated, with Newton's and Euler's laws.
    """

    course: Course
    radius: float
    size: float

    def friction(self, when: float, y: Array) -> tuple[Array, float]:
        """Force of friction and pressure on the ball, over its mass (3,) and scalar [m/s²]; y = (n, ṅ, w)."""
        n, rate, w = y[:3], y[3:6], y[6:]
        axis, down = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -g])
        pull = self.radius * (
            float(self.course.acceleration(when)) * np.cross(axis, n)
            + float(self.course.spin(when)) * np.cross(axis, rate)
        )
        pull = pull - self.size * np.cross(w, rate) - down
        force = (pull - (pull @ n) * n) / (1 + 1 / SOLID)
        return force, float((self.radius - self.size) * (rate @ rate) + down @ n)

    def rate(self, when: float, y: Array) -> Array:
        """ẏ of y = (n, ṅ, w)."""
        n, rate = y[:3], y[3:6]
        force, _ = self.friction(when, y)
        down = np.array([0.0, 0.0, -g])
        bend = (force + down - (down @ n) * n) / (self.radius - self.size) - (rate @ rate) * n
        return np.concatenate([rate, bend, np.cross(n, force) / (SOLID * self.size)])

    def way(self, start: Array, t: Array) -> tuple[Array, float]:
        """Unit vectors to the ball (T, 3) from a start y, and the greatest part of its pressure needed as friction."""
        found = solve_ivp(self.rate, (0.0, float(t[-1])), start, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-12)
        loads = [self.friction(when, y) for when, y in zip(found.t, found.y.T, strict=True)]
        needed = max(float(np.linalg.norm(force)) / max(press, 1e-9) for force, press in loads)
        return found.y[:3].T, needed


def rolling_state(run: Run, body: str, radius: float, size: float) -> Array:
    """y = (n, ṅ, w) of a ball at the start of a run."""
    n = (run.position(body)[0] - centre(radius)) / (radius - size)
    return np.concatenate([n, run.velocity(body)[0] / (radius - size), run.spin(body)[0]])
