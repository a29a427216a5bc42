"""Matter that falls or is poured and spreads: its shapes, what it falls on, and the laboratories of its laws.

A laboratory is a set-up in which a law can be held against a formula: an infinite layer on a slope (the world repeats
itself), a current or a column between two smooth plates (plane strain), a quarter of a heap between two. Its size
follows from the material, so that it costs the same and errs by the same whatever the material is.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import ceil, cos, inf, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.continuum import (
    Ball,
    Box,
    Continuum,
    Cylinder,
    Grip,
    Inlet,
    Letters,
    Material,
    Meeting,
    Piece,
    Shape,
    Torus,
    Vector,
    Wall,
)  # fmt: skip
from physinone_mj.run import Cloud, Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

WORD: Final = "GO"
"""What the letters say."""
STROKE: Final = 0.18
"""Width of a letter's stroke, in its height."""
BOARD: Final = 0.02
"""Half the thickness of a slope's board [m]."""
JET: Final = 0.3
"""Radius of a poured jet, in the size of what falls."""
POUR: Final = 1.2
"""How long is poured [s]."""
SLOW: Final = 5.0
"""Nothing but matter moves, and that finds its own steps [s]."""
LEAST_FRAMES: Final = 24
"""Of a laboratory, which a fast camera watches."""
THIN: Final = 1 / 4
"""Between the smooth plates of plane strain, in the shortest length: two cells at draft."""
STEEP: Final = 30 * pi / 180
"""Of the slope in laboratories [rad]."""

SURFACE = Surface(friction=0.5, restitution=0.2)


@dataclass(frozen=True)
class Form:
    """A shape of a size: half its height, the least thickness and half the greatest width [m]; its volume [m³], None
    where there is no formula."""

    shape: Shape
    half: float
    thin: float
    wide: float
    volume: float | None


def form(word: str, size: float) -> Form:
    """What falls: `size` is its height (a torus is 0.4 of that high) [m]."""
    half = size / 2
    return {
        "cube": Form(Box((half, half, half)), half, size, half, size**3),
        "ball": Form(Ball(half), half, size, half, 4 / 3 * pi * half**3),
        "cylinder": Form(Cylinder(0.8 * half, half), half, 0.8 * size, 0.8 * half, 2 * pi * 0.64 * half**3),
        "torus": Form(Torus(0.8 * half, 0.4 * half), 0.4 * half, 0.8 * half, 1.2 * half, 2 * pi**2 * 0.128 * half**3),
        "letters": Form(Letters(WORD, size, 0.4 * size), half, STROKE * size, 0.8 * size, None),
    }[word]


def article(word: str) -> str:
    """What falls, in words, at the beginning of a sentence."""
    return f'The word "{WORD}"' if word == "letters" else f"A {word}"


def plates(thickness: float) -> list[Wall]:
    """Two smooth plates across y, a thickness apart: strain is plane between them."""
    return [Wall((0, -thickness / 2, 0), (0, 1, 0), "slip"), Wall((0, thickness / 2, 0), (0, -1, 0), "slip")]


def ground(grip: Grip = "stick") -> Wall:
    """The plane z = 0."""
    return Wall((0, 0, 0), (0, 0, 1), grip)


def upright(place: float, side: int) -> Wall:
    """A smooth wall at x = place [m], matter on that side of it."""
    return Wall((place, 0, 0), (side, 0, 0), "slip")


def block(name: str, material: Material, low: Vector, high: Vector, velocity: Vector = (0, 0, 0)) -> Piece:
    """A box from corner to corner [m]."""
    half = tuple((b - a) / 2 for a, b in zip(low, high, strict=True))
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    return Piece(name, material, Box(half), middle, velocity=velocity)  # type: ignore[arg-type]


def layer(material: Material, depth: float, cell8: float, angle: float, *, ramp: float = 0.0) -> Continuum:
    """A layer on a rough slope without end, as a level one under tilted gravity. cell8: eight cells [m]."""
    width = THIN * cell8
    return Continuum(
        [block("layer", material, (0, -width / 2, 0), (cell8, width / 2, depth))],
        walls=[*plates(width), ground()], gravity=(g * sin(angle), 0.0, -g * cos(angle)), ramp=ramp,
        period=(cell8, inf, inf),
    )  # fmt: skip


def watch(scene: Scene, length: float, duration: float) -> None:
    """Resolve a laboratory: a fast camera takes two dozen pictures of what is over in less than a second."""
    scene.fps = max(scene.fps, ceil(LEAST_FRAMES / duration))
    scene.resolve(time=SLOW * max(1.0, duration), length=length, duration=duration)


def frames(run: Run) -> Array:
    """Times of the particles' pictures (F,) [s]."""
    return run.t[:: run.stride]


def grown(cloud: Cloud, frame: int) -> tuple[Array, Array, Array]:
    """Positions (n, 3) [m], velocities (n, 3) [m/s] and J (n,) of what is there in a frame."""
    there = slice(0, int(cloud.present[frame]))
    return tuple(x[frame, there].astype(float) for x in (cloud.position, cloud.velocity, cloud.stretch))  # type: ignore[return-value]


def layered(place: Array, *values: Array, count: int = 8) -> tuple[Array, ...]:
    """Means of values in layers of equally many particles, by place: (places, value, ...), each (count,)."""
    parts = np.array_split(np.argsort(place, kind="stable"), count)
    return tuple(np.array([x[part].mean() for part in parts]) for x in (place, *values))


def viscous_length(number: float, nu: float) -> float:
    """Length L at which √(g L) L/ν is a number [m]; ν [m²/s]."""
    return float((number**2 * nu**2 / g) ** (1 / 3))


def spacing(cloud: Cloud) -> float:
    """Between particles at rest [m]."""
    return float(cloud.bulk ** (1 / 3))


class Poured(Phenomenon, domain="fluids"):
    """What the five have in common: something falls or is poured on a floor, a slope or an obstacle."""

    views = 15
    setup: str
    shape: Annotated[
        Literal["cube", "ball", "cylinder", "torus", "letters"], Choice("of what falls; a jet is round")
    ] = "cube"
    size: Annotated[float, Param("m", 0.06, 0.3, "height of what falls")] = 0.2
    drop: Annotated[float, Param("m", 0.0, 0.6, "from the lowest point of it to what is below")] = 0.1
    speed: Annotated[float, Param("m/s", -0.6, 0.6, "sideways, at the start")] = 0.0
    turn: Annotated[float, Param("rad", 0.0, 1.57, "by which it is turned about the vertical")] = 0.3
    onto: Annotated[
        Literal["floor", "slope", "dome", "block"], Choice("a level floor, a board on legs, an obstacle on the floor")
    ] = "floor"
    tilt: Annotated[float, Param("rad", 0.1, 0.7, "of the board, where there is one")] = 0.35
    grip: Annotated[
        Literal["stick", "separate"], Choice("of what is below: matter sticks to it, or slides with friction")
    ] = "stick"
    friction: Annotated[float, Param("1", 0.0, 0.9, "of what is below, where matter slides")] = 0.4

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: object) -> Self:
        """A random specimen: dropped or poured; laboratories are asked for by name."""
        scenes = ("drop", "pour")
        fixed.setdefault("setup", scenes[int(rng.integers(len(scenes)))])
        return super().sample(rng, **fixed)

    @property
    @abstractmethod
    def material(self) -> Material:
        """What it is made of."""

    @property
    @abstractmethod
    def watched(self) -> float:
        """How long a scene lasts [s]."""

    @abstractmethod
    def laboratory(self, scene: Scene) -> None:
        """Build the set-up of that name."""

    @property
    def form(self) -> Form:
        """Of what falls."""
        return form(self.shape, self.size)

    @property
    def ground(self) -> str:
        """What is below, in words."""
        return {
            "floor": "a level floor", "slope": f"a board that slopes by {self.tilt * 180 / pi:.0f} degrees",
            "dome": "a dome on the floor", "block": "a block on the floor",
        }[self.onto]  # fmt: skip

    @property
    def top(self) -> float:
        """Of what lies below, where matter falls on it [m]."""
        lean = self.size * (0.5 + 1.5 * sin(self.tilt))
        return {"floor": 0.0, "slope": 0.12 + lean, "dome": 0.4 * self.size, "block": 0.5 * self.size}[self.onto]

    @property
    def middle(self) -> float:
        """Height of what falls, at the start [m]."""
        lean = self.form.wide * sqrt(2) * tan(self.tilt) if self.onto == "slope" else 0.0
        return self.top + self.drop + self.form.half + lean

    @property
    def jet(self) -> float:
        """Speed of a jet where it is poured [m/s]: as after a fall by the size."""
        return sqrt(2 * g * self.size)

    def build(self, scene: Scene) -> None:
        """What is below, and what falls on it; or a laboratory."""
        scene.material("stage/floor", 2400.0, SURFACE)
        if self.setup not in ("drop", "pour"):
            self.laboratory(scene)
            return
        below, made, middle = self.below(scene), self.form, self.middle
        place = (0.0, 0.0, middle)
        quaternion = (cos(self.turn / 2), 0.0, 0.0, sin(self.turn / 2))
        piece = Piece("matter", self.material, made.shape, place, quaternion, (self.speed, 0.0, 0.0), rgba=self.colour)
        inlets = []
        if self.setup == "pour":
            above = (0.0, 0.0, middle + made.half + 1.5 * JET * self.size)
            inlets.append(Inlet("matter", above, (0.0, 0.0, -self.jet), JET * self.size, 0.0, POUR))
        meetings = [Meeting(name, self.grip, self.friction) for name in below]
        scene.continua.append(Continuum([piece], meetings, inlets=inlets))
        scene.resolve(time=SLOW, length=min(self.size, 4 * made.thin), duration=self.watched)

    @property
    def colour(self) -> tuple[float, float, float, float]:
        """As pictures show it."""
        return (0.86, 0.55, 0.16, 1.0)

    def below(self, scene: Scene) -> list[str]:
        """Put there what is below; names of what matter meets."""
        if self.onto == "floor":
            return ["stage/floor"]
        if self.onto == "slope":
            part, angle, high = scene.add("wedge"), self.tilt, self.top
            long, wide = 3.2 * self.size, 1.8 * self.size
            body = part.body("wedge")
            body.pos, body.quat = (0, 0, high), (cos(angle / 2), 0, sin(angle / 2), 0)
            part.geom("board").size, part.geom("board").pos = (long, wide, BOARD), (0, 0, -BOARD)
            for name, side in (("left_leg", -1), ("right_leg", 1)):
                foot = -0.8 * long
                # straight down in the world, from the board's lower face to the ground
                down = (high + 0.8 * long * sin(angle)) - 2 * BOARD * cos(angle) - 0.012
                start = np.array([foot, side * 0.8 * wide, -2 * BOARD])
                end = start + down * np.array([sin(angle), 0, -cos(angle)])
                part.geom(name).fromto = (*start, *end)
            scene.material(part.name("wedge"), 700.0, SURFACE)
            return [part.name("board"), "stage/floor"]
        part = scene.add("hurdle")
        scene.spec.delete(part.geom("block" if self.onto == "dome" else "dome"))
        if self.onto == "dome":
            part.geom("dome").size[0] = self.top
        else:
            half = self.top / 2
            part.geom("block").size, part.geom("block").pos = (half, half, half), (0, 0, half)
        scene.material(part.name("hurdle"), 1200.0, SURFACE)
        return [part.name("hurdle"), "stage/floor"]

    def cloud(self, run: Run) -> Cloud:
        """What falls, or the laboratory's first piece."""
        return next(iter(run.clouds.values()))

    def at_lab(self, run: Run, setup: str, **changes: float | str) -> tuple[Self, Run]:
        """The run, if it is of that set-up with those parameters, or a twin; its specimen first."""
        changes["setup"] = setup
        same = all(getattr(self, name) == value for name, value in changes.items())
        other = run if same else run.again(**changes)
        return other.specimen, other

    def scenic(self, run: Run) -> tuple[Run, Cloud]:
        """The run if something falls or is poured in it, or a twin."""
        other = run if self.setup in ("drop", "pour") else run.again(setup="drop")
        return other, other.clouds["matter"]

    @observable("m")
    def height(self, run: Run) -> Array:
        """Of the highest particle (T,)."""
        return np.asarray(np.max([cloud.high[:, 2] for cloud in run.clouds.values()], axis=0))

    @observable("m")
    def reach(self, run: Run) -> Array:
        """Half the greater side of the box around it, seen from above (T,)."""
        low = np.min([cloud.low[:, :2] for cloud in run.clouds.values()], axis=0)
        high = np.max([cloud.high[:, :2] for cloud in run.clouds.values()], axis=0)
        return np.asarray((high - low).max(axis=1) / 2)

    @observable("1")
    def mean_stretch(self, run: Run) -> Array:
        """Mean of J, volume over that at rest (T,)."""
        clouds = run.clouds.values()
        whole = np.sum([cloud.mass for cloud in clouds], axis=0) / self.material.density
        return np.asarray(np.sum([cloud.volume for cloud in clouds], axis=0) / whole)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Kinetic, elastic, and of height above the floor in the scene's gravity (T,)."""
        down = np.array(run.scene.continua[0].gravity or (0, 0, -run.scene.gravity))
        parts = [c.kinetic + c.elastic - c.mass * (c.centre @ down) for c in run.clouds.values()]
        return np.asarray(np.sum(parts, axis=0))

    @law("m = ρ (V₀ + π r² v t)", source="by definition: nothing is lost, an inlet adds what comes through it",
         within=(1e-9, 1e-9, 1e-9))  # fmt: skip
    def mass_is_what_came(self, run: Run) -> Measurement:
        """Of the matter at all samples; V₀ by the shape's formula. A jet comes in whole particles: less than one of
        them too much or too little is none."""
        other, cloud = self.scenic(run)
        volume, density, particle = self.form.volume, self.material.density, 0.0
        if volume is None:
            raise NotEvaluated("the volume of letters has no formula")
        due = np.full(len(other), density * volume)
        if self.setup == "pour":
            due += density * np.minimum(other.t, POUR) * self.jet * pi * (JET * self.size) ** 2
            particle = density * cloud.bulk
        gap = cloud.mass - due
        return due + np.sign(gap) * np.maximum(np.abs(gap) - particle, 0.0), due

    @law("E₀ = m g z + m v²/2, dE <= 0", source="by definition: the second law; nothing moves but matter",
         within=(1e-2, 5e-3, 2e-3), limited_by="the particles' centre of mass is a little off")  # fmt: skip
    def energy_only_goes_away(self, run: Run) -> Measurement:
        """Kinetic, elastic and potential energy at the start, and the start's with the greatest rise after any earlier
        moment, over what was put in; a jet brings some, so it is asked of what falls alone."""
        other = run if self.setup == "drop" else run.again(setup="drop")
        energy = self.energy(other)
        rise = (energy - np.minimum.accumulate(energy)).max()
        put = other.clouds["matter"].mass[0] * (g * self.middle + self.speed**2 / 2)
        return [energy[0] / put, 1 + rise / put], [1.0, 1.0]

    def fallen(self) -> float:
        """Height from which the highest of it falls [m]."""
        return self.drop + 2 * self.form.half + (2 * JET * self.size + self.size if self.setup == "pour" else 0.0)

    def refuse_squashed(self, modulus: float, limit: float, name: str) -> None:
        """R9: an impact that compresses it by more than a limit."""
        squashed = self.material.density * g * self.fallen() / modulus
        if squashed > limit:
            raise Refusal("R9", f"{self.label}: a fall by {self.fallen():.3g} m squashes it by {squashed:.3g}; "
                          f"allowed: {limit:g}, {name} {squashed / limit:.3g} times as high")  # fmt: skip
