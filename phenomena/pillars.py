"""A pillar that turns, with paddles that strike balls or with seats that hang from its arms."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import asin, cos, inf, pi, sin, sqrt
from typing import Annotated, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from phenomena.parts import ball, court, sphere_mass
from physinone_mj.base import NotEvaluated, Param, Phenomenon, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import around
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]

AXLE: Final = "pillar/axle"
SEATS: Final = 4
COLUMN: Final = 0.03
"""Radius of the pillar [m]."""

THICKNESS: Final = 0.01
"""Half of a paddle's [m]."""

CROWN: Final = 0.015
"""Half the height of the crown, which holds the pillar's mass [m]."""

WIDEST: Final = 1.75
"""Angle at which a stop holds the seats [rad]."""

SEAT: Final = 0.05
"""Radius of a seat's rider [m]."""


@dataclass(frozen=True)
class Carousel:
    """Seats that hang from arms on radial hinges; each weighs what its rider does, a ball.

    arm: from the axle to the hinge [m]; hanger: from there to the rider's centre [m]; mass: of each [kg];
    settling: rate at which the hinge's damping c lets small swings die away, c/(2 m ℓ²) [1/s].
    """

    arm: float
    hanger: float
    mass: float
    settling: float

    @property
    def damping(self) -> float:
        """Of each hinge [N m s/rad]."""
        return 2 * self.settling * self.mass * self.hanger**2

    @property
    def inward(self) -> float:
        """Angle at which a stop keeps the seats from the pillar [rad]."""
        return -asin(min(1.0, (self.arm - COLUMN - SEAT) / self.hanger))

    def steady(self, omega: float) -> float:
        """Angle of the seats in steady rotation [rad]: tan θ = Ω² (a + ℓ sin θ)/g."""

        def pull(theta: float) -> float:
            return omega**2 * (self.arm + self.hanger * sin(theta)) * cos(theta) - g * sin(theta)

        return float(brentq(pull, 0.0, pi / 2, xtol=1e-15)) if omega else 0.0

    def rate(self, omega: float) -> float:
        """Angular frequency of small swings about steady rotation, undamped [1/s]."""
        theta = self.steady(omega)
        sine, cosine = sin(theta), cos(theta)
        return sqrt(g * cosine / self.hanger + omega**2 * ((self.arm / self.hanger + sine) * sine - cosine**2))

    def swing(self, theta: ArrayLike, rate: ArrayLike, omega: ArrayLike) -> Array:
        """Angular acceleration of the seats [rad/s²]: those of a ball, whose inertia is the same about every axis."""
        sine, cosine = np.sin(theta), np.cos(theta)
        push = np.asarray(omega) ** 2 * (self.arm + self.hanger * sine) * cosine - g * sine
        resists = self.damping * np.asarray(rate) / (self.mass * self.hanger)
        return np.asarray((push - resists) / (self.hanger * (1 + 0.4 * (SEAT / self.hanger) ** 2)))

    def inertia(self, theta: ArrayLike) -> Array:
        """Of all seats about the pillar's axis [kg m²]."""
        return np.asarray(SEATS * self.mass * ((self.arm + self.hanger * np.sin(theta)) ** 2 + 0.4 * SEAT**2))

    def spun(self, pillar: float, torque: float, theta: float, omega: float, t: Array) -> tuple[Array, Array]:
        """Angle of the seats and angular velocity of a pillar that a torque turns, at the times t.

        pillar: its own moment of inertia [kg m²]; from seats at rest on the pillar at an angle theta.
        """
        start = (pillar + float(self.inertia(theta))) * omega

        def turns(when: float, angle: float) -> float:
            return (start + torque * when) / (pillar + float(self.inertia(angle)))

        found = solve_ivp(
            lambda when, y: (y[1], float(self.swing(y[0], y[1], turns(when, y[0])))), (0.0, float(t[-1])),
            (theta, 0.0), method="DOP853", t_eval=t, rtol=1e-11, atol=1e-12,
        )  # fmt: skip
        return found.y[0], np.array([turns(when, angle) for when, angle in zip(t, found.y[0], strict=True)])


class NearPillar(Phenomenon, domain="mechanics"):
    """Objects near a rotating pillar: balls that its paddles strike, or seats that hang from it."""

    near: str
    paddle: Annotated[float, Param("m", 0.1, 0.6, "end of the paddles from the axle")] = 0.4
    paddles: Annotated[int, Param("1", 1, 4, "number of paddles")] = 2
    place: Annotated[float, Param("1", 0.0, 1.0, "of the balls along the paddles: at the pillar, at their ends")] = 0.6
    radius: Annotated[float, Param("m", 0.03, 0.06, "balls")] = 0.05
    density: Annotated[float, Param("kg/m³", 100.0, 21300.0, "balls")] = 700.0
    restitution: Annotated[float, Param("1", 0.1, 0.8, "of paddles and balls")] = 0.6
    floor_friction: Annotated[float, Param("1", 0.0, 0.9, "of floor and balls; paddles are smooth")] = 0.3
    arm: Annotated[float, Param("m", 0.1, 0.5, "from the axle to the hinges of the seats")] = 0.35
    hanger: Annotated[float, Param("m", 0.3, 1.0, "from the hinge of a seat to its rider")] = 0.6
    seat_mass: Annotated[float, Param("kg", 0.2, 3.0, "of each seat")] = 1.0
    settling: Annotated[float, Param("1/s", 0.0, 3.0, "rate at which small swings of a seat die away")] = 0.0
    inertia: Annotated[float, Param("kg m²", 0.3, 2.0, "of the pillar about its axis, without seats")] = 0.8

    @abstractmethod
    def omega(self, t: ArrayLike) -> Array:
        """Angular velocity that the pillar is to have [rad/s]."""

    @abstractmethod
    def phase(self, t: ArrayLike) -> Array:
        """Angle that it is to have turned by [rad]."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Highest angular velocity in a scene [rad/s]."""

    @property
    def carousel(self) -> Carousel:
        """The seats."""
        return Carousel(self.arm, self.hanger, self.seat_mass, self.settling)

    @property
    def mass(self) -> float:
        """Of a ball [kg]."""
        return sphere_mass(self.radius, self.density)

    @property
    def distance(self) -> float:
        """Of the balls' centres from the axle [m]: clear of the pillar, and no farther than a paddle's face goes."""
        least, most = COLUMN + self.radius + 0.01, sqrt(self.paddle**2 + (THICKNESS + self.radius) ** 2)
        return least + self.place * (most - least)

    @property
    def ahead(self) -> float:
        """Angle of a ball before a paddle that touches it [rad]."""
        return asin((THICKNESS + self.radius) / self.distance)

    @property
    def lever(self) -> float:
        """Distance from the axle, along the paddle, at which it strikes a ball at rest [m]."""
        return sqrt(self.distance**2 - (THICKNESS + self.radius) ** 2)

    @property
    def azimuths(self) -> tuple[float, float]:
        """Of the two balls [rad]; the first is struck by the first paddle, sooner than the other by the second one."""
        gap = 2 * pi / self.paddles
        if self.paddles == 1:
            return 1.9, 4.4
        stagger = min(0.2, max(0.0, gap / 2 - self.ahead - 0.05))
        return gap / 2 - stagger, 3 * gap / 2 + stagger

    @property
    def turns(self) -> tuple[float, float]:
        """Angle that the pillar has to turn by until each ball is struck [rad]."""
        first, second = self.azimuths
        return first - self.ahead, second - self.ahead - (2 * pi / self.paddles if self.paddles > 1 else 0.0)

    def raise_pillar(self, scene: Scene, height: float, crown: float) -> Part:
        """A pillar with its crown at a height [m], of that radius [m], with paddles and arms still on it."""
        part = scene.add("pillar")
        part.body("pillar").pos[2] = height
        part.geom("crown").size[0], part.geom("crown").mass = crown, 2 * self.inertia / crown**2
        column = (height - 0.01) / 2
        part.geom("column").pos[2], part.geom("column").size[1] = -column, column
        part.geom("stripe").size[0] = 0.95 * crown
        # the pair of paddle and ball is to have the ball's own restitution, and no friction
        surface = Surface(restitution=self.restitution)
        scene.material(part.name("pillar"), 2 * self.inertia / crown**4 / (2 * pi * CROWN), surface)
        scene.material(part.name("column"), 700.0, surface)
        scene.material(part.name("foot"), 700.0, surface)
        return part

    def raise_paddles(self, scene: Scene) -> tuple[Part, list[str]]:
        """The pillar with its paddles; returns them by name."""
        height = 0.34
        part = self.raise_pillar(scene, height, 0.22)
        names = []
        for k in range(4):
            scene.spec.delete(part.body(f"seat{k}"))
            scene.spec.delete(part.geom(f"arm{k}"))
            if k >= self.paddles:
                scene.spec.delete(part.geom(f"paddle{k}"))
                continue
            angle = 2 * pi * k / self.paddles
            board = part.geom(f"paddle{k}")
            board.pos = (self.paddle / 2 * cos(angle), self.paddle / 2 * sin(angle), 0.06 - height)
            board.quat, board.size[0] = (cos(angle / 2), 0, 0, sin(angle / 2)), self.paddle / 2
            names.append(part.name(f"paddle{k}"))
            scene.material(names[-1], 700.0, Surface(restitution=self.restitution))
        return part, names

    def balls(self, scene: Scene, *, count: int = 2, rubbing: float = 0.0) -> list[Part]:
        """Pillar, court and balls at rest in reach of the paddles. rubbing: friction of paddles and balls."""
        pillar, paddles = self.raise_paddles(scene)
        scene.material("stage/floor", 2400.0, Surface(friction=2 * self.floor_friction, restitution=0.4))
        for name in (*paddles, pillar.name("column")):
            scene.material(name, 700.0, Surface(friction=2 * rubbing, restitution=self.restitution))
        # so wide that paddles cannot press two balls in a row against a rail
        rails = court(scene, self.paddle + 5 * self.radius + 0.1, Surface(restitution=0.4))
        found = []
        for k, (azimuth, colour) in enumerate(zip(self.azimuths[:count], COLOURS, strict=False)):
            part = ball(scene, f"ball{k}", self.radius, self.density, Surface(restitution=self.restitution), colour)
            place = (self.distance * cos(azimuth), self.distance * sin(azimuth), self.radius)
            scene.start[part.name("free")] = free_pose(place)
            for other in ("stage/floor", rails.name("rails"), pillar.name("column"), *paddles):
                scene.touch(part.name("ball"), other)
            found.append(part)
        scene.touch(*(part.name("ball") for part in found))
        return found

    def strike_time(self, omega: float) -> float:
        """Shortest time of a strike at an angular velocity [s].

        Strikes are resolved exactly, whatever the step; but rebounds slower than what gravity gives in a step count as
        none.
        """
        return min(1.2, max(0.05, 32 * self.restitution * omega * self.lever / g))

    def too_gentle(self, run: Run, speed: float) -> bool:
        """Whether a strike at that closing speed [m/s] counts as one without rebound at the run's step."""
        return self.restitution * speed < 1.1 * g * run.step

    def seats(self, scene: Scene, angle: float) -> Part:
        """The pillar with four seats at rest on it, at an angle from the vertical [rad]."""
        carousel = self.carousel
        height = self.hanger + 0.35
        crown = max(0.3, self.arm + 0.06)
        part = self.raise_pillar(scene, height, crown)
        for k in range(4):
            azimuth = k * pi / 2
            out = np.array([cos(azimuth), sin(azimuth), 0.0])
            scene.spec.delete(part.geom(f"paddle{k}"))
            part.geom(f"arm{k}").fromto = (0, 0, -0.03, *(self.arm * out + [0, 0, -0.03]))
            seat, hinge = part.body(f"seat{k}"), part.joint(f"hang{k}")
            seat.pos[:] = self.arm * out - [0, 0, 0.03 + self.hanger]
            hinge.pos[2], hinge.range = self.hanger, np.degrees([carousel.inward, WIDEST])
            hinge.damping = [carousel.damping, 0, 0]
            part.geom(f"rod{k}").fromto = (0, 0, 0, 0, 0, self.hanger)
            part.geom(f"rider{k}").mass = self.seat_mass
            scene.start[part.name(f"hang{k}")] = angle
            scene.material(part.name(f"seat{k}"), self.seat_mass / sphere_mass(SEAT, 1.0), Surface(0.4, 0.4))
        return part

    def bodies(self, run: Run) -> list[str]:
        """What is near the pillar, by its names in the scene."""
        return [b for b in run.bodies() if b.startswith(("ball", "clapper/ball", "pillar/seat"))]

    @observable("rad/s")
    def pillar_speed(self, run: Run) -> Array:
        """Angular velocity of the pillar (T,)."""
        return run.joint_speed(AXLE)

    @observable("m/s")
    def speeds(self, run: Run) -> Array:
        """Of the balls or the seats (T, n)."""
        return np.column_stack([np.linalg.norm(run.velocity(b), axis=1) for b in self.bodies(run)])

    @observable("rad")
    def swing_angle(self, run: Run) -> Array:
        """Of the first seat from the vertical, outwards, or of the hanging ball (T,); zero where nothing hangs."""
        joint = {"seats": "pillar/hang0", "clapper": "clapper/swing"}.get(self.near)
        return run.joint(joint) if joint else np.zeros(len(run.t))

    def strikes(self, run: Run) -> list[Impact]:
        """Impacts of paddles with balls, in order."""
        return [i for i in run.impacts if {i.first[:11], i.second[:11]} & {"pillar/padd"}]

    def struck(self, run: Run, *, most: int = 6) -> tuple[Array, Array]:
        """Velocities of balls after strikes by a paddle's face, measured and expected: v + (1+e) [(Ω × r_c) - v]·n n.

        The point of contact r_c is that of the log; n is the face's normal where the pillar is to be at that time.
        Strikes that follow one another too quickly for velocities to be measured between them are left out, and on a
        floor with friction those of balls that move already.
        """
        measured, expected = [], []
        for impact in self.strikes(run)[:most]:
            paddle, other = sorted((impact.first, impact.second), reverse=True)
            angle = float(self.phase(impact.time)) + 2 * pi * int(paddle[-1]) / self.paddles
            along, across = np.array([cos(angle), sin(angle), 0]), np.array([-sin(angle), cos(angle), 0])
            where = np.array(impact.position)
            if where @ along > self.paddle - 1e-6:
                continue  # the paddle's edge
            normal = across * np.sign(where @ across)
            try:
                before, after = around(run, other.rpartition("/")[0] + "/ball", impact.time)
            except NotEvaluated:
                continue
            if self.floor_friction > 0 and np.linalg.norm(before) > 1e-9:
                continue  # the floor bends a rolling ball's velocity within the window of measurement
            face = float(self.omega(impact.time)) * np.cross([0, 0, 1], where)
            if self.too_gentle(run, abs(float((face - before) @ normal))):
                continue
            measured.append(after)
            expected.append(before + (1 + self.restitution) * ((face - before) @ normal) * normal)
        if not measured:
            raise NotEvaluated("no ball is struck by a paddle's face, clear of other impacts")
        return np.array(measured), np.array(expected)

    def clear(self, speed: float) -> bool:
        """Whether a ball struck to that speed [m/s] slides on for longer than its velocity is measured."""
        return self.floor_friction == 0 or 2 * speed / (7 * self.floor_friction * g) > 0.03


COLOURS: Final = ((0.84, 0.27, 0.22), (0.23, 0.47, 0.76))


def integral(t: Array, x: Array) -> Array:
    """∫ x dt from the first sample on (T,), of a smooth record."""
    whole = make_interp_spline(t, x, k=5).antiderivative()
    return np.asarray(whole(t) - whole(t[0]))


def angular_momentum(run: Run) -> Array:
    """Of all that moves, about the pillar's axis (T,) [kg m²/s]."""
    return np.asarray(sum(run.angular_momentum(b)[:, 2] for b in run.bodies() if not b.startswith("stage")))


def first_impact(run: Run, body: str) -> float:
    """When a geom first collides with anything that is not the ground [s]."""
    found = [i.time for i in run.impacts if body in (i.first, i.second) and "stage/floor" not in (i.first, i.second)]
    return min(found, default=inf)
