"""A plank with lanes, round things that race on it, and a padded stop."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from physinone_mj.scene import Part, Scene, free_pose

RUN_OUT = 0.8
"""From the foot of the plank to the stop [m]."""

LANE = 2.9
"""Width of a lane, in radii."""


@dataclass(frozen=True)
class Racer:
    """One shape: moments of inertia / (m r²) about its axis (beta) and across it; volume of its matter / r³."""

    template: str
    tread: str
    beta: float
    across: float
    volume: float

    @property
    def body(self) -> str:
        """Its name in the scene."""
        return f"{self.template}/{self.template.split('_')[-1]}"

    @property
    def contact(self) -> str:
        """The geom that touches."""
        return f"{self.template}/{self.tread}"


SHELL, WIDTH, RIM = 0.05, 1.2, 0.8
"""Thickness of the hollow shapes and half widths of cylinder and hoop, in radii (RIM is the hoop's whole width)."""

RACERS = (
    Racer("ball", "ball", 2 / 5, 2 / 5, 4 / 3 * pi),
    Racer("cylinder", "tread", 1 / 2, 1 / 4 + WIDTH**2 / 12, pi * WIDTH),
    Racer("hollow_ball", "shell", 2 / 3, 2 / 3, 4 * pi * SHELL),
    Racer("hoop", "tread", 1.0, 1 / 2 + RIM**2 / 12, 2 * pi * SHELL * RIM),
)
"""In the order of their inertia. The hollow ones have the moments of infinitely thin shells: I = 2/3 m r² and m r²."""

BETA = np.array([racer.beta for racer in RACERS])


def plank(scene: Scene, angle: float, long: float, line: float, radius: float) -> Part:
    """A plank on legs that falls along +x by an angle [rad] to its foot at the origin; lanes for things of a radius.

    long: its length [m]; line: distance of the line across it from its foot [m]
    """
    part, wide = scene.add("ramp"), 2 * LANE * radius
    part.body("ramp").quat = (cos(angle / 2), 0, sin(angle / 2), 0)
    part.geom("slope").pos[0], part.geom("slope").size[:2] = -long / 2, (long / 2, wide)
    part.geom("plank").pos[0], part.geom("plank").size[:2] = -long / 2, (long / 2, wide)
    top = long - 0.08
    down = top * sin(angle) - 0.03 * cos(angle)
    for leg, side in (("left_leg", -0.9 * wide), ("right_leg", 0.9 * wide)):
        foot = (-top + down * sin(angle), side, -0.03 - down * cos(angle))
        part.geom(leg).fromto = (-top, side, -0.03, *foot)
    part.geom("start_line").pos[0], part.geom("start_line").size[1] = -line, wide
    for i, across in enumerate((-wide / 2, 0, wide / 2)):
        part.geom(f"lane{i}").pos, part.geom(f"lane{i}").size[0] = (-long / 2, across, 0), long / 2
    return part


def padded_stop(scene: Scene, radius: float) -> Part:
    """Across all lanes, at the end of the run-out."""
    stop, high, wide = scene.add("pad"), 0.05 + 2.5 * radius, 2 * LANE * radius
    stop.body("pad").pos = (RUN_OUT, 0, 0)
    for block, more in (("foam", 0.0), ("back", 0.02)):
        stop.geom(block).pos[2], stop.geom(block).size[1:] = high / 2 + more, (wide + more, high / 2 + more)
    return stop


def place(scene: Scene, lane: int, radius: float, density: float, centre: ArrayLike) -> Part:
    """One of the racers in its lane; `centre` (3,) [m] is that of a racer in the middle between the lanes."""
    racer = RACERS[lane]
    r, part = radius, scene.add(racer.template)
    mass = density * racer.volume * r**3
    body = part.body(racer.template.split("_")[-1])
    body.mass, body.explicitinertial, body.ipos, body.iquat = mass, True, (0, 0, 0), (1, 0, 0, 0)
    body.inertia = mass * r**2 * np.array([racer.across, racer.beta, racer.across])
    part.geom(racer.tread).size[0] = r
    if racer.template == "cylinder":
        part.geom("tread").size[1] = WIDTH * r / 2
        part.geom("spoke").size = (0.93 * r, WIDTH * r / 2 + 0.0005, 0.15 * r)
        part.geom("stripe").pos[2], part.geom("stripe").size = 0.93 * r, (0.15 * r, 0.49 * WIDTH * r, 0.065 * r)
    elif racer.template == "hoop":
        part.geom("tread").size[1] = RIM * r / 2
        scene.spec.mesh("hoop/ring").scale = (r / 1.06, r / 1.06, RIM * r / 2 / 0.06)
        part.geom("mark").pos[2], part.geom("mark").size = 0.94 * r, (0.1 * r, RIM * r / 2 + 0.0005, 0.058 * r)
    across = (lane - (len(RACERS) - 1) / 2) * LANE * r
    scene.start[part.name("free")] = free_pose(np.add(centre, (0.0, across, 0.0)))
    return part
