"""A gas balloon, free or tied: what it weighs, carries and drags along, and how it stands in a scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import acosh, exp, inf, log, nan, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import SPHERE_ADDED_MASS, Float
from physinone_mj.scene import Part, Scene, free_pose

RUBBER: Final = Surface(friction=0.5, restitution=0.5)
"""Of a balloon, and of what it meets."""

KNOT: Final = 1.1
"""Where the string is tied, in radii below the centre."""


@dataclass(frozen=True)
class Balloon:
    """A sphere of gas in a skin, in air.

    radius [m]; skin: its mass [kg]; gas: density [kg/m³]; drag: coefficient; air: density around it [kg/m³]
    """

    radius: float
    skin: float
    gas: float
    drag: float
    air: float

    @property
    def volume(self) -> float:
        """4 π r³/3 [m³]."""
        return 4 / 3 * pi * self.radius**3

    @property
    def mass(self) -> float:
        """What is weighed in a vacuum [kg]: gas and skin."""
        return self.skin + self.gas * self.volume

    @property
    def inertia(self) -> float:
        """What has to be set in motion with it [kg]: the balloon, and half of the air that it displaces."""
        return self.mass + SPHERE_ADDED_MASS * self.air * self.volume

    @property
    def spin_inertia(self) -> float:
        """About the centre [kg m²]: a thin shell, and gas that turns with it."""
        return (2 / 3 * self.skin + 2 / 5 * self.gas * self.volume) * self.radius**2

    @property
    def lift(self) -> float:
        """B = (ρ V - m) g [N], upwards."""
        return (self.air * self.volume - self.mass) * g

    @property
    def drag_area(self) -> float:
        """C π r² [m²]."""
        return self.drag * pi * self.radius**2

    @property
    def resistance(self) -> float:
        """½ ρ C A [kg/m]: drag over speed squared."""
        return self.air * self.drag_area / 2

    def terminal(self, share: float = 1.0) -> float:
        """Speed at which drag balances that share of the lift [m/s]; 0 if there is none."""
        return sqrt(max(share * self.lift, 0.0) / self.resistance)

    def pace(self, share: float = 1.0, rolling: float = 0.0) -> float:
        """Time in which it comes to that speed [s]: m_e v_t/B; `rolling` is what turning adds to the inertia [kg]."""
        push = share * self.lift
        return (self.inertia + rolling) * self.terminal(share) / push if push > 0 else inf

    def time_to(self, way: float, share: float = 1.0, rolling: float = 0.0) -> float:
        """From rest over a distance [m], [s]; infinite if it does not rise."""
        speed, pace = self.terminal(share), self.pace(share, rolling)
        ratio = way / (speed * pace) if speed else inf
        if ratio > 500:
            return pace * (ratio + log(2)) if ratio < inf else inf
        return pace * acosh(exp(ratio))

    @property
    def spring(self) -> tuple[float, float, float]:
        """Of a scale for its lift: moving mass [kg], stiffness [N/m] and damping [N s/m]; it soon comes to rest."""
        rate, mass = 20 / self.pace(), self.inertia
        return mass, 2 * mass * rate**2, 1.2 * mass * rate

    def put(
        self, scene: Scene, name: str, centre: ArrayLike, colour: tuple[float, float, float],
        quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    ) -> tuple[Part, Float]:  # fmt: skip
        """Place one; returns the part, and what `Buoyancy` has to know of it. Its contact is that of its skin."""
        part = scene.add("balloon", name)
        body, r = part.body("balloon"), self.radius
        body.mass, body.inertia = self.inertia, [self.spin_inertia] * 3
        part.geom("skin").size[0] = r
        part.geom("neck").pos[2], part.geom("neck").size = -r, (0.14 * r, 0.14 * r, 0.12 * r)
        part.geom("lip").pos[2], part.geom("lip").size = -KNOT * r, (0.11 * r, 0.11 * r, 0.04 * r)
        part.site("knot").pos[2] = -KNOT * r
        for geom in ("skin", "neck", "lip"):
            part.geom(geom).rgba = (*colour, 1.0)
        scene.start[part.name("free")] = free_pose(centre, quaternion)
        for matter in ("balloon", "skin"):
            scene.material(part.name(matter), self.mass / self.volume, RUBBER)
        return part, Float(part.name("centre"), self.volume, self.drag_area)


def rise(t: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[float, float]:
    """Final speed v_t [m/s] and time constant τ [s] of a rise from rest: the fit of v_t τ ln cosh(t/τ) to heights.

    NaN, which fails any law, if it does not rise.
    """
    if z[-1] <= 0:
        return nan, nan

    def miss(p: NDArray[np.float64]) -> NDArray[np.float64]:
        u = t / p[1]
        return np.asarray((p[0] * p[1] * (u + np.log1p(np.exp(-2 * u)) - log(2)) - z) / z[-1])

    guess = np.array([2 * abs(z[-1] - z[-5]) / (t[-1] - t[-5]), t[-1]])
    found = least_squares(miss, guess, x_scale=guess, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return float(found[0]), float(found[1])


def tie(scene: Scene, name: str, knot: str, eye: str, length: float, owner: str) -> None:
    """A thread between two sites: no longer than its length [m], without mass, slack when they are nearer.

    owner: the body that it belongs to, in pictures.
    """
    import mujoco

    thread = scene.spec.add_tendon(name=name, limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=(0.0, length))
    thread.width, thread.rgba = 0.003, (0.20, 0.22, 0.26, 1.0)
    thread.wrap_site(knot)
    thread.wrap_site(eye)
    scene.cord(name, owner)
