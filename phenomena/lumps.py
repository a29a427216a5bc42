"""Lumps of a solid, elastic or plastic, that fall on something; and bars and columns of the same stuff."""

from __future__ import annotations

import dataclasses
from math import cos, sin, sqrt
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

from phenomena.pours import SLOW, Poured
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Refusal, law
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.continuum import Continuum, Grip, Material, Meeting, Piece, Shape, Vector
from physinone_mj.run import Cloud, Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

FLOOR: Final = "stage/floor"
NEAR: Final = 1.25
"""Of a floor or a wall, where matter begins to feel it: its particles share nodes of the grid with it [cell]."""
CLEAR: Final = 0.1
"""From the lower end of a bar or a ball to the floor at the start of a laboratory, in the shortest length."""
LEAST_ACROSS: Final = 4
"""Cells across the thinnest part of what falls, at draft (rule R7)."""


class Lump(Poured, domain="fluids"):
    """What both have in common: a solid lump, thrown perhaps, falls on a floor, a slope or an obstacle."""

    young: Annotated[float, Param("Pa", 1e4, 1e6, "Young's modulus")] = 5e4
    poisson: Annotated[float, Param("1", 0.05, 0.45, "Poisson's ratio")] = 0.3
    density: Annotated[float, Param("kg/m³", 500.0, 3000.0, "at rest")] = 1000.0
    size: Annotated[float, Param("m", 0.06, 0.25, "height of what falls")] = 0.2
    drop: Annotated[float, Param("m", 0.1, 1.0, "from the lowest point of it to what is below")] = 0.25
    lean: Annotated[float, Param("rad", 0.0, 1.2, "by which it is tipped over at the start")] = 0.0
    spin: Annotated[float, Param("rad/s", -10.0, 10.0, "about a level axis, at the start")] = 0.0
    grip: Annotated[
        Literal["stick", "slip", "separate"],
        Choice("of what is below: matter sticks to it, slides but stays on it, or lifts off and slides with friction"),
    ] = "separate"  # type: ignore[assignment]  # matter that flows has but two of them

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: object) -> Self:
        """A random specimen that falls; laboratories are asked for by name."""
        fixed.setdefault("setup", "drop")
        return super().sample(rng, **fixed)

    @property
    def watched(self) -> float:
        """How long a scene lasts [s]."""
        return 2.0

    @property
    def sound(self) -> float:
        """√(E/ρ), in a thin bar [m/s]."""
        return sqrt(self.young / self.density)

    def build(self, scene: Scene) -> None:
        """What is below and what falls on it, tipped and spinning; or a laboratory."""
        super().build(scene)
        if self.setup != "drop":
            return
        (continuum,) = scene.continua
        (piece,) = continuum.pieces
        turned = _after((cos(self.lean / 2), 0.0, sin(self.lean / 2), 0.0), piece.quaternion)
        continuum.pieces[0] = dataclasses.replace(piece, quaternion=turned, spin=(0.0, self.spin, 0.0))
        scene.resolve(time=SLOW, length=min(self.size, 8 / LEAST_ACROSS * self.form.thin), duration=self.watched)

    @property
    def middle(self) -> float:
        """Height of what falls, at the start [m]; higher where it is tipped over, so that it touches nothing."""
        higher = self.form.half * (cos(self.lean) - 1) + sqrt(2) * self.form.wide * sin(self.lean)
        return super().middle + max(higher, 0.0)

    def stand(
        self, scene: Scene, material: Material, shape: Shape, half: float, *, fall: float = 0.0, gap: float = 0.0,
        gravity: Vector = (0.0, 0.0, 0.0), ramp: float = 0.0, grip: Grip = "separate",
    ) -> Continuum:  # fmt: skip
        """A laboratory's piece, "bar": half its height [m], the gap below it [m], how fast it falls [m/s]."""
        piece = Piece("bar", material, shape, (0.0, 0.0, gap + half), velocity=(0.0, 0.0, -fall))
        continuum = Continuum([piece], [Meeting(FLOOR, grip)], gravity=gravity, ramp=ramp)
        scene.continua.append(continuum)
        return continuum

    def pressed(self, run: Run) -> float:
        """How long the floor pushed a bar with more than half its usual force [s].

        The force is the slope of the momentum; the usual one the median of those of a quarter of the greatest or more.
        NotEvaluated unless the bar left the floor while it was watched.
        """
        up = run.clouds["bar"].momentum[:, 2]
        push = np.gradient(up, run.t)
        half = np.median(push[push > push.max() / 4]) / 2
        on = np.flatnonzero(push > half)
        if up[-1] < 0.3 * abs(up[0]) or on[-1] + 1 >= len(push) or on[0] == 0:
            raise NotEvaluated("the bar does not leave the floor while it is watched")
        begun, ended = (
            np.interp(half, push[[off, at]], run.t[[off, at]]) for off, at in ((on[0] - 1, on[0]), (on[-1] + 1, on[-1]))
        )
        return float(ended - begun)

    def on_floor(self, run: Run) -> tuple[Run, Cloud]:
        """The run, if something falls upright on a level floor in it, or a twin; what falls."""
        level = self.setup == "drop" and self.onto == "floor" and self.lean == self.spin == self.speed == 0
        other = run if level else run.again(setup="drop", onto="floor", lean=0.0, spin=0.0, speed=0.0)
        return other, other.clouds["matter"]

    def refuse_soft(self, limit: float) -> None:
        """R9: an impact that squashes it by more than a limit."""
        squashed = self.density * g * (self.drop + self.size) / self.young
        if squashed > limit:
            raise Refusal("R9", f"{self.label}: ρ g h/E = {squashed:.3g} of a fall by {self.drop + self.size:.3g} m; "
                          f"allowed: {limit:g}, young {squashed / limit:.3g} times as high")  # fmt: skip

    @law("m = ρ V₀", source="by definition: nothing comes or goes", within=(1e-9, 1e-9, 1e-9))
    def mass_is_what_came(self, run: Run) -> Measurement:
        """67e: at all samples; V₀ by the shape's formula."""
        volume = self.form.volume
        if volume is None:
            raise NotEvaluated("the volume of letters has no formula")
        return self.scenic(run)[1].mass, self.density * volume * np.ones(len(self.scenic(run)[0]))

    @law("E₀ = m g z + m v²/2 + I ω²/2, dE <= 0", source="by definition: the second law; nothing moves but matter",
         within=(1e-2, 5e-3, 2e-3), limited_by="the particles' centre of mass is a little off")  # fmt: skip
    def energy_only_goes_away(self, run: Run) -> Measurement:
        """67d: kinetic, elastic and potential energy at the start, and the start's with the greatest rise after any
        earlier moment, over what was put in; that of its own rotation is taken from the particles."""
        other, cloud = self.scenic(run)
        energy, mass = self.energy(other), cloud.mass[0]
        rise = (energy - np.minimum.accumulate(energy)).max()
        turning = cloud.kinetic[0] - (cloud.momentum[0] ** 2).sum() / (2 * mass)
        put = mass * (g * self.middle + self.speed**2 / 2) + turning
        return [energy[0] / put, 1 + rise / put], [1.0, 1.0]

    @law("z = z₀ - g t²/2", source="Landau & Lifshitz, Mechanics, §5: a uniform field", within=(1e-4, 1e-5, 1e-8),
         limited_by="single precision, but at reference")  # fmt: skip
    def it_falls_freely(self, run: Run) -> Measurement:
        """How far the centre of mass has come, until the floor is two cells away."""
        other, cloud = self.on_floor(run)
        flying = np.minimum.accumulate(cloud.low[:, 2] > 2 * other.cell)
        if flying.sum() < 5:
            raise NotEvaluated(f"it touches the floor after {flying.sum()} samples; needed: 5")
        return (cloud.centre[0, 2] - cloud.centre[:, 2])[flying], g * other.t[flying] ** 2 / 2


def _after(second: tuple[float, ...], first: tuple[float, ...]) -> tuple[float, float, float, float]:
    """The quaternion of one turn after another, w first."""
    (a, b, c, d), (w, x, y, z) = second, first
    return (
        a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
    )  # fmt: skip


def within_walls(half: float) -> list[tuple[Vector, Vector]]:
    """Points and normals of four walls around x, y = -half ... half [m]."""
    return [
        ((-half, 0, 0), (1, 0, 0)), ((half, 0, 0), (-1, 0, 0)), ((0, -half, 0), (0, 1, 0)), ((0, half, 0), (0, -1, 0)),
    ]  # fmt: skip
