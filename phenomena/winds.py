"""What the phenomena of wind share: what rolls or slides before a fan, its course, and the twins of a specimen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from physinone_mj.base import NotEvaluated, Phenomenon, Refusal
from physinone_mj.contact import Surface
from physinone_mj.run import Run
from physinone_mj.scene import Part, Scene

Array = NDArray[np.float64]
Specimen = TypeVar("Specimen", bound=Phenomenon)

HEIGHT: Final = 0.34
"""Of the fan's centre above the floor [m]: what rolls passes below its guard."""

GRIP: Final = 0.6
"""Coefficient of friction between ball and floor."""

LONGEST: Final = 10.0
"""Duration of a video at most [s]."""

HARDEST: Final = 200.0
"""Acceleration by a wind at most [m/s²]: more, and the body is gone within two frames."""


@dataclass(frozen=True)
class Body:
    """What the wind pushes: its name, half height in radii, roundness β = I/(m r²) of what rolls, and grip."""

    name: str
    half_height: float
    beta: float
    friction: float


BODIES: Final = {"ball": Body("ball/ball", 1.0, 2 / 5, GRIP), "puck": Body("puck/puck", 1 / 3, 0.0, 0.0)}


def mover(scene: Scene, kind: str, radius: float, mass: float, friction: float) -> Part:
    """A ball or a puck that touches the floor; `friction` is that of the two together."""
    part, half = scene.add(kind), radius * BODIES[kind].half_height
    geom = part.geom(kind)
    geom.size[:2] = (radius, half)
    geom.mass = mass
    if kind == "puck":
        part.geom("mark").pos[2], part.geom("mark").size[0] = half, 0.85 * radius
    volume = {"ball": 4 / 3 * pi * radius**3, "puck": 2 * pi * radius**2 * half}[kind]
    scene.material(BODIES[kind].name, mass / volume, Surface(friction=friction, restitution=0.1))
    scene.material("stage/floor", 2000.0, Surface(friction=friction, restitution=0.1))
    scene.touch(BODIES[kind].name, "stage/floor")
    return part


def foam(scene: Scene, name: str, x: float, faces: int, *stopped: str) -> Part:
    """A pad that ends the way of what it stops; its face is at x [m] and looks towards +x (1) or -x (-1)."""
    pad = scene.add("pad", name)
    pad.body("pad").pos[0] = x
    if faces > 0:
        pad.body("pad").quat[:] = (0.0, 0.0, 0.0, 1.0)
    scene.material(pad.name("pad"), 100.0, Surface(restitution=0.1))
    for body in stopped:
        scene.touch(body, pad.name("pad"))
    return pad


def twin(specimen: Specimen, run: Run, **changes: Any) -> tuple[Specimen, Run]:
    """The same specimen with some parameters changed, and its run; this one if nothing changes.

    NotEvaluated if there is no such specimen.
    """
    if all(getattr(specimen, name) == value for name, value in changes.items()):
        return specimen, run
    try:
        return type(specimen).make(**(specimen.values() | changes)), run.again(**changes)
    except (Refusal, ValueError) as why:
        raise NotEvaluated(f"the twin that this law needs is refused: {why}") from None


@dataclass(frozen=True)
class Course:
    """A motion along the wind: times (n,) [s], distances from the fan (n,) [m] and speeds (n,) [m/s]."""

    t: Array
    s: Array
    v: Array


def course(
    push: Callable[[float], float], inertia: float, resistance: float, start: float, speed: float,
    low: float, high: float,
) -> Course:  # fmt: skip
    """What a force and dry friction of `resistance` [N] make of a start: until it rests, leaves [low, high], or 10 s.

    For planning a scene: relative accuracy 1e-6.
    """
    t, s, v = [np.array([0.0])], [np.array([start])], [np.array([speed])]
    out = False
    while t[-1][-1] < LONGEST and not out:
        force = push(s[-1][-1])
        way = np.sign(v[-1][-1]) or np.sign(force)
        if not v[-1][-1] and abs(force) <= resistance:
            break

        def rests(_t: float, y: Array, way: float = way) -> float:
            return float(y[1] * way)

        def leaves(_t: float, y: Array) -> float:
            return float(min(y[0] - low, high - y[0]))

        rests.terminal = leaves.terminal = True  # type: ignore[attr-defined]
        rests.direction = leaves.direction = -1.0  # type: ignore[attr-defined]

        def moves(_t: float, y: Array, way: float = way) -> tuple[float, float]:
            return float(y[1]), (push(float(y[0])) - way * resistance) / inertia

        leg = solve_ivp(moves, (t[-1][-1], LONGEST), (s[-1][-1], v[-1][-1]), events=(rests, leaves), rtol=1e-6,
                        atol=1e-9, max_step=0.1)  # fmt: skip
        assert leg.t_events is not None
        out = not len(leg.t_events[0])
        t.append(leg.t)
        s.append(leg.y[0])
        v.append(np.append(leg.y[1][:-1], leg.y[1, -1] if out else 0.0))
    return Course(np.concatenate(t), np.concatenate(s), np.concatenate(v))
