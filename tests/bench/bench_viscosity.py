"""Viscosity that the continuum solver adds to matter's own, by Taylor-Green vortices: `python -m
tests.bench.bench_viscosity`.

    u = U sin(k x) cos(k y),  v = -U cos(k x) sin(k y),  k = π/(N Δx)

is a flow of vortices N cells across, of opposite turns beside each other, that keeps its form while its amplitude goes
down as exp(-2 ν k² t), and its energy as the square of that. Its world repeats itself along x and y, or is one vortex
between smooth walls; along z it is two cells, between smooth walls, which it does not press against. The amplitude is
the particles' velocities' part in the form of the beginning: so sound, of which there is some as the pressure begins at
zero, does not count.

A step over the grid alone leaves a wave of wave number κ [1/cell], of particles without number, ŵ² + 4 ŵ'² of itself,
ŵ = (sin(κ/2)/(κ/2))³ a spline's transform: what particles pass on, and what their affine velocities do; and of the
product of two such waves g = ŵ⁴ + 8 ŵ² ŵ'², as nothing passes on what is bilinear. So ν Δt/Δx² = -log g/2κ², κ = π/N,
and near 9/160 κ² = 0.555/N².

Found: that, within 12 %, be the vortices fast or slow, stirred or not, thick or thin, whatever the step. A single one
has more from smooth walls, some 0.27/N in all. What every scene records, and less than which no fluid may have, is
0.007 ρ Δx²/Δt, of the longest step of what is in it: that of vortices nine cells across, or of one of 38 between walls.

Source: G. I. Taylor, Phil. Mag. 46 (1923) 671.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mpm_sidecar._ti import start
from mpm_sidecar.collide import Bearer, Obstacle
from mpm_sidecar.transfer import Body, Solver, longest_step
from physinone_mj.continuum import Newtonian, Wall

Array = NDArray[np.float64]

SOUND: Final = 6.0
"""Of the fluid [m/s]."""
DENSITY: Final = 1000.0
"""Of the fluid [kg/m³]."""
LAYER: Final = 2
"""Cells along z."""
SHAKEN: Final = 0.4
"""How far particles are from a lattice at the start, at most, along each axis [spacings]."""
MACH: Final = 0.05
"""U over the speed of sound, unless another is named."""
MOST: Final = 10_000
"""Steps, whatever is left by then."""
EVERY: Final = 16
"""Steps from one look at the amplitude to the next."""
SETTLED: Final = 0.15
"""Part of the time that is not looked at: particles off a lattice lose some motion at once."""


@dataclass(frozen=True)
class Vortices:
    """What was measured: dynamic viscosity [Pa s], its own not taken off; step [s]; how often it was turned over."""

    fluid: Body
    viscosity: float
    step: float
    turned: float


def vortices(
    across: int, *, dx: float = 1 / 64, viscosity: float = 0.0, mach: float = MACH, finer: float = 1.0,
    left: float = 0.5, walled: bool = False,
) -> Vortices:  # fmt: skip
    """Let vortices decay; Taichi has to run in single precision.

    Args:
        across: cells that a vortex is wide.
        dx: side of a cell [m].
        viscosity: the fluid's own dynamic viscosity [Pa s].
        mach: U over the speed of sound.
        finer: how often the step goes into the longest.
        left: part of the amplitude at which it ends.
        walled: one vortex between smooth walls, not many.
    """
    side, cells, speed = across * dx, across if walled else 2 * across, mach * SOUND
    k = math.pi / side
    fluid = Newtonian(2 * viscosity, DENSITY * SOUND**2 / 7, DENSITY)
    lattice = np.indices((2 * cells, 2 * cells, 2 * LAYER)).reshape(3, -1).T + 0.5
    points = (lattice + np.random.default_rng(0).uniform(-SHAKEN, SHAKEN, lattice.shape)) * dx / 2

    def form(x: Array) -> Array:
        p, q = k * x[:, 0], k * x[:, 1]
        return np.stack([np.sin(p) * np.cos(q), -np.cos(p) * np.sin(q), 0 * p], axis=1)

    ends = [(2, LAYER * dx)] + [(axis, side) for axis in (0, 1) if walled]
    walls = [
        Wall(tuple(at * np.eye(3)[axis]), tuple(sign * np.eye(3)[axis]), "slip")
        for axis, end in ends for at, sign in ((0.0, 1.0), (end, -1.0))
    ]  # fmt: skip
    period: Any = math.inf if walled else (2 * side, 2 * side, math.inf)
    body = Body(fluid, points, dx**3 / 8, speed * form(points))
    solver = Solver([body], dx, period=period, bearers=[Bearer([Obstacle.wall(wall)]) for wall in walls])
    step = longest_step([body], dx, 2 * speed) / finer
    seen = [(0.0, 1.0)]
    while seen[-1][1] > left and solver.steps < MOST:
        for _ in range(EVERY):
            solver.step(step)
        now = form(solver.positions())
        seen.append((solver.time, float((solver.velocities() * now).sum() / (now**2).sum()) / speed))
    t, amplitude = np.array(seen)[int(SETTLED * len(seen)) :].T
    rate = -np.polyfit(t, np.log(amplitude), 1)[0]
    return Vortices(body, DENSITY * rate / (2 * k**2), step, solver.time * speed / (2 * side))


def expected(across: int) -> float:
    """ν Δt/Δx² of vortices so many cells across, by the grid alone."""
    wave = math.pi / across
    sine = math.sin(wave / 2) / (wave / 2)
    slope = (math.cos(wave / 2) - sine) / wave
    kept = sine**12 + 8 * sine**6 * (3 * sine**2 * slope) ** 2
    return -math.log(kept) / (2 * wave**2)


CASES: Final[list[tuple[str, dict[str, Any]]]] = [
    ("many", {"across": 8}),
    ("many", {"across": 9}),
    ("many", {"across": 12}),
    ("many", {"across": 16}),
    ("many", {"across": 24, "left": 0.8}),
    ("many, four times as fast", {"across": 16, "mach": 0.2}),
    ("many, a quarter of the step", {"across": 9, "finer": 4}),
    ("many, of 2.5 Pa s", {"across": 9, "viscosity": 2.5}),
    ("many, of 25 Pa s", {"across": 9, "viscosity": 25.0, "left": 0.3}),
    ("one between smooth walls", {"across": 16, "walled": True}),
    ("one between smooth walls", {"across": 32, "walled": True, "left": 0.7}),
]


def table() -> list[str]:
    """The lines of docs/mpm.md."""
    start(False)
    lines = ["| vortices | N | speed over sound's | times turned over | ν Δt/Δx² added | by the grid alone |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    dx = 1 / 64
    for name, case in CASES:
        found = vortices(dx=dx, **case)
        across, added = case["across"], found.viscosity - case.get("viscosity", 0.0)
        part = added * found.step / (DENSITY * dx**2)
        lines.append(f"| {name} | {across} | {case.get('mach', MACH):g} | {found.turned:.2f} | {part:.5f} | "
                     f"{expected(across):.5f} |")  # fmt: skip
    return lines


def main() -> None:
    """Print the table."""
    print(*table(), sep="\n")


if __name__ == "__main__":
    main()
