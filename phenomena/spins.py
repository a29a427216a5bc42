"""Motors that speed up: the course of a spin, and what it does to bodies that ride along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physinone_mj.run import Run
from physinone_mj.scene import Motor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """A spin about the vertical that goes evenly from a first value to a last one and stays there.

    first, last [rad/s]; rate: of the change, positive whichever way it goes [rad/s²]
    """

    first: float
    last: float
    rate: float = 1.0

    @property
    def ramp(self) -> float:
        """How long the change takes [s]."""
        return abs(self.last - self.first) / self.rate

    @property
    def slope(self) -> float:
        """Angular acceleration during the change [rad/s²]."""
        return float(np.sign(self.last - self.first)) * self.rate

    def motor(self, joint: str) -> Motor:
        """That holds a joint to the course."""
        begin = (0.0, self.first)
        return Motor(joint, (begin, (self.ramp, self.last)) if self.ramp > 0 else (begin,))

    def spin(self, t: ArrayLike) -> Array:
        """At the times t [rad/s]."""
        return np.asarray(self.first + self.slope * np.minimum(t, self.ramp))

    def acceleration(self, t: ArrayLike) -> Array:
        """Angular acceleration at the times t [rad/s²]."""
        return np.where(np.asarray(t) < self.ramp, self.slope, 0.0)

    def angle(self, t: ArrayLike) -> Array:
        """Turned since t = 0 [rad]."""
        early = np.minimum(t, self.ramp)
        return np.asarray(self.first * early + self.slope * early**2 / 2 + self.last * (np.asarray(t) - early))


def across(plan: Array) -> Array:
    """ẑ × x for vectors in the plan (..., 2)."""
    return np.stack([-plan[..., 1], plan[..., 0]], axis=-1)


def plan(run: Run, body: str) -> Array:
    """Position of a centre of mass seen from above, from the axis (T, 2) [m]."""
    return run.position(body)[:, :2]


def distance(run: Run, body: str) -> Array:
    """Of a centre of mass from the axis (T,) [m]."""
    return np.asarray(np.linalg.norm(plan(run, body), axis=1))


def azimuth(run: Run, body: str) -> Array:
    """Of a centre of mass about the axis, without jumps (T,) [rad]."""
    x = plan(run, body)
    return np.unwrap(np.arctan2(x[:, 1], x[:, 0]))


def drift(run: Run, body: str, hinge: str) -> Array:
    """Horizontal velocity of a centre of mass relative to what turns beneath it (T, 2) [m/s]."""
    return np.asarray(run.velocity(body)[:, :2] - run.joint_speed(hinge)[:, None] * across(plan(run, body)))
