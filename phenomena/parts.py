"""Parts that several phenomena share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from physinone_mj.base import Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.scene import Part, Scene, free_pose

Array = NDArray[np.float64]


def court(scene: Scene, half: float, surface: Surface) -> Part:
    """A square of low rails round the origin, of half side `half` [m] inside."""
    part = scene.add("court")
    for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
        rail = part.geom(name)
        rail.pos[:2] = (x * (half + 0.03), y * (half + 0.03))
        rail.size[0 if y else 1] = half + (0.0 if y else 0.06)
    scene.material(part.name("rails"), 700.0, surface)
    return part


def ball(
    scene: Scene, name: str, radius: float, density: float, surface: Surface, colour: tuple[float, float, float]
) -> Part:
    """A solid sphere."""
    part = scene.add("ball", name)
    geom = part.geom("ball")
    geom.size[0], geom.mass, geom.rgba = radius, sphere_mass(radius, density), (*colour, 1.0)
    scene.material(part.name("ball"), density, surface)
    return part


def sphere_mass(radius: float, density: float) -> float:
    """Of a solid sphere [kg]."""
    return density * 4 / 3 * pi * radius**3


@dataclass(frozen=True)
class Rider:
    """What turns with a seesaw: mass [kg], half: of its edge [m], centre (x, z) from the axle, along the plank and out
    of it [m], and inertia about its own centre [kg m²]."""

    mass: float
    half: float
    x: float
    z: float
    inertia: float


@dataclass(frozen=True)
class Seesaw:
    """A plank on an axle. Tilt is positive where the end at +x is up.

    length [m], mass [kg]; height: of the level plank's middle plane over the ground [m];
    pivot: of the axle above that plane [m]; offset: of the axle from the plank's middle, along it [m].
    """

    length: float
    mass: float
    height: float
    pivot: float
    offset: float = 0.0

    half_thickness = 0.02
    half_width = 0.15

    @property
    def axle(self) -> float:
        """Its height over the ground [m]."""
        return self.height + self.pivot

    @property
    def plank(self) -> Rider:
        """The plank as what turns about the axle."""
        inertia = self.mass * (self.length**2 / 12 + self.half_thickness**2 / 3)
        return Rider(self.mass, self.length / 2, -self.offset, -self.pivot, inertia)

    def cube(self, mass: float, density: float, x: float) -> Rider:
        """A cube that lies on the plank; Refusal if it is wider than that."""
        half = (mass / density) ** (1 / 3) / 2
        if half > self.half_width:
            least = mass / (2 * self.half_width) ** 3
            raise Refusal("R1", f"a cube of {mass:.3g} kg at {density:.4g} kg/m³ is wider than the plank; "
                          f"allowed: {least:.4g} kg/m³ or more")  # fmt: skip
        return Rider(mass, half, x, half + self.half_thickness - self.pivot, 2 / 3 * mass * half**2)

    def lying(self, side: int) -> float:
        """Tilt with the end at +x (side 1) or -x (side -1) on the ground [rad].

        Refusal where it is so steep that friction could wedge that end between axle and ground (P. Painlevé, 1895): by
        Newton's law of restitution no impulses exist, if μ times the height of the axle exceeds its distance from it.
        """
        arm, below = self.length / 2 - side * self.offset, self.half_thickness + self.pivot
        highest = 0.74 * hypot(arm, below)
        if self.axle > highest:
            raise Refusal("R12", f"an axle {self.axle:.4g} m over the ground: an end of the plank could be wedged; "
                          f"allowed here: {highest:.4g} m")  # fmt: skip
        return -side * (asin(self.axle / hypot(arm, below)) - atan2(below, arm))

    def moments(self, riders: Sequence[Rider]) -> tuple[float, float, float]:
        """Of plank and riders about the axle: inertia [kg m²], Σ m x and Σ m z [kg m]."""
        bodies = [self.plank, *riders]
        inertia = sum(b.inertia + b.mass * (b.x**2 + b.z**2) for b in bodies)
        return inertia, sum(b.mass * b.x for b in bodies), sum(b.mass * b.z for b in bodies)

    def acceleration(self, tilt: ArrayLike, riders: Sequence[Rider]) -> Array:
        """Angular acceleration with the riders at rest on the plank [rad/s²]: gravity's torque over the inertia."""
        inertia, along, out = self.moments(riders)
        return np.asarray(-g * (along * np.cos(tilt) - out * np.sin(tilt)) / inertia)

    def swing(self, tilt: float, riders: Sequence[Rider], t: Array) -> tuple[Array, Array]:
        """Tilt and its rate at the times t, let go at rest at t = 0 with the riders held by friction."""
        found = solve_ivp(
            lambda _, y: [y[1], float(self.acceleration(y[0], riders))], (0.0, float(t[-1])), (tilt, 0.0),
            method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        return found.y[0], found.y[1]

    def holds(self, tilt: ArrayLike, rate: ArrayLike, riders: Sequence[Rider], friction: float) -> NDArray[np.bool_]:
        """Whether every rider stays where it lies: pressed on, within the friction limit, and not tipping over."""
        theta, omega = np.asarray(tilt, float), np.asarray(rate, float)
        turning = self.acceleration(theta, riders)
        good = np.ones(theta.shape, bool)
        for r in riders:
            press = r.mass * (g * np.cos(theta) + turning * r.x - omega**2 * r.z)
            drag = r.mass * (g * np.sin(theta) - turning * r.z - omega**2 * r.x)
            centre = r.inertia * turning - r.half * drag  # of pressure, times the pressing force
            good &= (press > 0) & (np.abs(drag) < friction * press) & (np.abs(centre) < r.half * press)
        return good

    def place(self, scene: Scene, tilt: float, surface: Surface) -> Part:
        """Support and plank, its axle over the origin."""
        part = scene.add("seesaw")
        base, wide = 0.25 + 0.3 * self.axle, self.half_width + 0.055
        scene.spec.mesh(part.name("wedge")).scale = (0.8 * base, 0.015, self.axle + 0.01)
        part.geom("near").pos[1], part.geom("far").pos[1] = -wide, wide
        part.geom("foot").size[:2] = base, wide + 0.03
        body, hinge = part.body("plank"), part.joint("hinge")
        body.pos[:] = (-self.offset, 0.0, self.height)
        hinge.pos[:] = (self.offset, 0.0, self.pivot)
        board, half = part.geom("board"), self.length / 2
        board.size[:], board.mass = (half, self.half_width, self.half_thickness), self.mass
        for tip, side in (("left_tip", -1), ("right_tip", 1)):
            part.geom(tip).pos[0] = side * (half - 0.03)
        for end, side in (("near", -1), ("far", 1)):
            cheek = part.geom(f"{end}_cheek")
            cheek.pos[:] = (self.offset, side * (self.half_width + 0.018), self.pivot / 2)
            cheek.size[2] = abs(self.pivot) / 2 + 0.035
            part.geom(f"{end}_pin").pos[:] = (self.offset, side * wide, self.pivot)
        density = self.mass / (8 * half * self.half_width * self.half_thickness)
        scene.material(part.name("board"), density, surface)
        scene.material(part.name("plank"), density, surface)
        scene.material(part.name("fulcrum"), 700.0, surface)
        scene.touch(part.name("board"), "stage/floor")
        scene.start[part.name("hinge")] = tilt
        return part

    def over(self, tilt: float, x: float, z: float) -> Array:
        """Place in the scene (3,) of a point that turns with the plank [m]."""
        return np.array([x * cos(tilt) - z * sin(tilt), 0.0, self.axle + x * sin(tilt) + z * cos(tilt)])

    def lay(
        self, scene: Scene, name: str, rider: Rider, tilt: float, surface: Surface, colour: tuple[float, float, float],
        *, above: float = 0.0,
    ) -> Part:  # fmt: skip
        """A loose cube on the plank, or `above` it [m]; it can touch plank and ground."""
        part = scene.add("block", name)
        geom = part.geom("block")
        geom.size[:], geom.mass, geom.rgba = rider.half, rider.mass, (*colour, 1.0)
        lean = (cos(tilt / 2), 0.0, -sin(tilt / 2), 0.0)
        place = self.over(tilt, rider.x, rider.z) + np.array([0.0, 0.0, above])
        scene.start[part.name("free")] = free_pose(place, lean)
        scene.material(part.name("block"), rider.mass / (2 * rider.half) ** 3, surface)
        scene.touch(part.name("block"), "seesaw/board")
        scene.touch(part.name("block"), "stage/floor")
        return part
