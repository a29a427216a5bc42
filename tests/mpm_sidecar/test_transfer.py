"""Particles and grid: what transfers keep, walls, one body's period, the same bits whatever the threads."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mpm_sidecar import transfer
from mpm_sidecar._ti import ti
from mpm_sidecar.collide import Bearer, Obstacle
from mpm_sidecar.materials import energy
from mpm_sidecar.transfer import Body, Solver, longest_step
from physinone_mj.continuum import Elastic, Granular, Newtonian, Plasticine, Viscoplastic, Wall, lame

from .taichi_at import taichi_at

Array = NDArray[np.float64]
ALL = [Elastic(young=1e4), Plasticine(young=1e4), Viscoplastic(young=1e4), Granular(young=1e4), Newtonian(bulk=1e3)]
HOME = Path(__file__).resolve().parents[2]
INNER = (0.25, 0.75)
"""Places in a cell of two particles on a line [cell]: eight in each are as Gauss's points of equal weight."""

named = pytest.mark.parametrize("material", ALL, ids=lambda m: type(m).__name__)


def standing(*walls: Wall) -> list[Bearer]:
    return [Bearer([Obstacle.wall(wall) for wall in walls])]


def cube(cells: tuple[int, int, int], dx: float, corner: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """Eight particles in each of some cells."""
    lines = [dx * np.add.outer(np.arange(n), INNER).ravel() + c for n, c in zip(cells, corner, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


def body(material: Any, points: Array, dx: float, velocity: Any = (0, 0, 0)) -> Body:
    return Body(material, points, dx**3 / 8, velocity)


@named
def test_what_moves_evenly_moves_on_and_turns_on(material: Any) -> None:
    """Momentum to round-off; a scattered cloud that flies keeps its shape."""
    taichi_at(ti.f64)
    rng, dx = np.random.default_rng(0), 1 / 32
    points = rng.random((3000, 3)) * 0.2 + (0.4, -0.3, 0.6)
    velocity = np.array([0.3, -0.2, 0.5])
    solver = Solver([body(material, points, dx, velocity)], dx, double=True)
    steps = solver.advance(0.02)
    assert steps >= 2
    mass = 3000 * dx**3 / 8 * material.density
    assert solver.momentum() == pytest.approx(mass * velocity, rel=1e-13)
    assert solver.positions() == pytest.approx(points + 0.02 * velocity, abs=1e-14)
    assert np.abs(solver.states()).max() < 1e-12


@named
def test_forces_inside_change_no_momentum(material: Any) -> None:
    """Linear and angular, of a body that is stretched, turned and let go, beside another."""
    taichi_at(ti.f64)
    dx = 1 / 32
    one, two = cube((6, 6, 6), dx, (0.01, 0.02, 0.03)), cube((4, 4, 4), dx, (7 * dx, 0.02, 0.03))
    spin = np.cross([0.0, 0.5, 1.0], one - one.mean(axis=0)) - 0.5 * (one - one.mean(axis=0))
    other = Elastic(young=2e4, density=500.0)
    solver = Solver([body(material, one, dx, spin), body(other, two, dx, (-0.4, 0, 0))], dx, double=True)
    before = solver.momentum()
    solver.advance(0.05)
    assert solver.momentum() == pytest.approx(before, abs=1e-13)


MOTIONS = {
    "flies": (np.zeros((3, 3)), (1.0, 0.5, -0.3)),
    "is squeezed": (-np.eye(3), (0.1, 0.05, 0.0)),
    "is stretched": (np.eye(3), (0.1, 0.05, 0.0)),
    "is pulled along": (np.diag([-0.5, -0.5, 1.0]), (0.1, 0.05, 0.0)),
    "is sheared": (np.array([[0.0, 0.0, 1.0], [0.0] * 3, [0.0] * 3]), (0.1, 0.05, 0.0)),
    "turns": (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0] * 3]), (0.1, 0.05, 0.0)),
}  # fmt: skip
"""Of a block that is let go: gradient of its velocity, and velocity, at its edge in 0.3 times that of sound."""


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("material", [*ALL, Newtonian(viscosity=0.0, bulk=1e3)], ids=lambda m: type(m).__name__)
def test_energy_is_never_created(material: Any, motion: str) -> None:
    """Kinetic on the grid and elastic of a free block: at no step more than at the one before, to round-off, 1e-12 of
    what there was.

    Velocities are those of a step's middle, and so the elastic energy is the mean of that at its two ends; where steps
    are as long as stability allows that is off by the square of their length, so they are a quarter of it.
    """
    taichi_at(ti.f64)
    dx, (gradient, drift) = 1 / 32, MOTIONS[motion]
    points = cube((4, 4, 4), dx)
    sound = math.sqrt(material.stiffness() / material.density)
    rate = 0.3 * sound / (2 * dx) * gradient
    spin = (rate - rate.T)[[2, 0, 1], [1, 2, 0]] / 2
    velocity = (points - points.mean(axis=0)) @ rate.T + 0.3 * sound * np.array(drift)
    solver = Solver([Body(material, points, dx**3 / 8, velocity, spin)], dx, double=True)
    dt = 0.25 * longest_step(solver.bodies, dx, 0.6 * sound)
    stored, found = 0.0, []
    for _ in range(160):
        solver.step(dt)
        grid, before = solver._grid, stored
        stored = dx**3 / 8 * float(energy(material, solver.states()).sum())
        found.append(0.5 * float(grid[:, 3] @ (grid[:, :3] ** 2).sum(axis=1)) + (before + stored) / 2)
    assert (np.diff(found) < 1e-12 * found[0]).all()
    if motion == "flies":
        assert found[-1] == pytest.approx(found[0], rel=1e-12)


def test_angular_momentum_is_kept() -> None:
    """With the part that is in the affine velocities, to round-off."""
    taichi_at(ti.f64)
    dx, rate = 1 / 32, np.array([0.4, -0.7, 2.0])
    points = cube((6, 5, 4), dx)
    arms = points - points.mean(axis=0)
    solver = Solver([body(Elastic(young=1e4), points, dx, np.cross(rate, arms))], dx, double=True)
    solver.step(1e-4)  # from here on affine velocities go with the particles' own

    def angular() -> Array:
        cloud = solver._clouds[0]
        x, v = solver.positions(), solver.velocities()
        columns = np.empty((len(x), 3, 4))
        columns[cloud.order] = cloud.records[:, 8:20].reshape(-1, 3, 4)
        # A = m C - Δt V (4/Δx²) τ is m C's and a symmetric part's, times Δx; C's antisymmetric part is a spin
        a = columns[:, :, :3].transpose(0, 2, 1) / dx * dx**2 / 4 * (1 / dx) * dx
        own = np.stack([a[:, 2, 1] - a[:, 1, 2], a[:, 0, 2] - a[:, 2, 0], a[:, 1, 0] - a[:, 0, 1]], axis=1).sum(axis=0)
        return np.asarray(cloud.mass * np.cross(x, v).sum(axis=0) + own)

    before = angular()
    for _ in range(200):
        solver.step(1e-4)
    assert angular() == pytest.approx(before, rel=1e-11)


def test_what_spins_at_the_start_spins_on() -> None:
    """A particle is not a point: what is told its spin loses none of it at the first step, and else it would."""
    taichi_at(ti.f64)
    dx, rate = 1 / 32, np.array([0.4, -0.7, 2.0])
    points = cube((6, 5, 4), dx)
    turning = np.cross(rate, points - points.mean(axis=0))
    lost = []
    for spin in (rate, (0.0, 0.0, 0.0)):
        solver = Solver([Body(Elastic(young=1e4), points, dx**3 / 8, turning, spin)], dx, double=True)
        solver.step(1e-6)
        lost.append(np.abs(solver.velocities() - turning).max() / np.abs(turning).max())
    assert lost[0] < 1e-12 < 1e-2 < lost[1]


def test_what_falls_falls() -> None:
    """g t and g t²/2, whatever the steps were."""
    taichi_at(ti.f64)
    dx = 1 / 32
    points = cube((3, 3, 3), dx)
    solver = Solver([body(Elastic(young=1e4), points, dx)], dx, gravity=(0, 0, -9.8), double=True)
    for part in (0.03, 0.05, 0.02):
        solver.advance(part)
    assert solver.velocities() == pytest.approx(np.tile([0, 0, -0.98], (len(points), 1)), abs=1e-12)
    fallen = np.tile([0, 0, -9.8 * 0.1**2 / 2], (len(points), 1))
    assert solver.positions() - points == pytest.approx(fallen, abs=1e-12)


@pytest.mark.parametrize(("cells", "within"), [(8, 4e-2), (16, 1.5e-2), pytest.param(32, 7e-3, marks=pytest.mark.slow)])
def test_a_column_sounds_at_its_own_pitch(cells: int, within: float) -> None:
    """67c: held below, between smooth walls, T = 4 L/c with c = √((λ + 2 μ)/ρ)."""
    taichi_at(ti.f64)
    length, material = 0.4, Elastic(young=1e5, poisson=0.3)
    dx = length / cells
    width = 2 * dx
    points = cube((2, 2, cells), dx)
    start = np.zeros_like(points)
    start[:, 2] = 1e-3 * np.sin(math.pi * points[:, 2] / (2 * length))
    walls = [Wall((0, 0, 0), (0, 0, 1), "stick")]
    for axis in (0, 1):
        for at, side in ((0.0, 1.0), (width, -1.0)):
            place, normal = np.zeros(3), np.zeros(3)
            place[axis], normal[axis] = at, side
            walls.append(Wall(tuple(place), tuple(normal), "slip"))
    solver = Solver([body(material, points, dx, start)], dx, bearers=standing(*walls), double=True)
    mu, lam = lame(material.young, material.poisson)
    period = 4 * length / math.sqrt((lam + 2 * mu) / material.density)
    dt = 0.5 * longest_step(solver.bodies, dx)
    times, heights = [0.0], [points[:, 2].mean()]
    while solver.time < 1.6 * period:
        solver.step(dt)
        times.append(solver.time)
        heights.append(solver.positions()[:, 2].mean())
    rise = np.array(heights) - heights[0]
    crossings = [
        t0 + (t1 - t0) * r0 / (r0 - r1)
        for t0, t1, r0, r1 in zip(times[1:], times[2:], rise[1:], rise[2:], strict=False)
        if (r0 > 0) != (r1 > 0)
    ]
    assert crossings[0] == pytest.approx(period / 2, rel=within)


@pytest.mark.parametrize(("friction", "left"), [(0.0, 1.0), (0.3, 0.7), (1.5, 0.0)])
def test_walls_hold_by_friction(friction: float, left: float) -> None:
    """A layer pressed into a wall at 1 m/s and along it at 1 m/s loses what Coulomb's law takes."""
    taichi_at(ti.f64)
    dx = 1 / 16
    points = cube((1, 1, 1), dx, (0.0, 0.0, -3 * dx))
    wall = Wall((0, 0, 0), (0, 0, 1), friction=friction)
    solver = Solver([body(Elastic(), points, dx, (1.0, 0.0, -1.0))], dx, bearers=standing(wall), double=True)
    solver.step(1e-6)
    assert solver.velocities() == pytest.approx(np.tile([left, 0, 0], (8, 1)), abs=1e-12)


THREADS = """
import hashlib, sys
import numpy as np
from mpm_sidecar._ti import start
start(False, cpu_max_num_threads=int(sys.argv[1]), offline_cache=False)
from mpm_sidecar.collide import Bearer, Obstacle
from mpm_sidecar.transfer import Body, Solver
from physinone_mj.continuum import *
rng = np.random.default_rng(0)
cube, velocity = rng.random((2001, 3)), rng.normal(size=(2001, 3)) * 0.1 + (1.0, 0.5, -2.0)
given = np.arange(2001)
for material in (Elastic(young=1e4), Plasticine(1e4, yield_stress=10.0), Viscoplastic(1e4, yield_stress=10.0),
                 Granular(), Newtonian(bulk=1e4)):
    said, places = [], []
    # columns, whole numbers twice, slabs
    for side, atomic, order in ((0.3, False, given), (0.3, True, given), (0.3, True, rng.permutation(given)),
                                (0.9, False, given)):
        body = Body(material, side * cube[order] + (0, 0, 0.01), side**3 / 2000, velocity[order])
        solver = Solver([body], 1 / 32, gravity=(0, 0, -9.8), atomic=atomic,
                        bearers=[Bearer([Obstacle.wall(Wall((0, 0, 0), (0, 0, 1), friction=0.5))])])
        solver.advance(0.02)
        back = np.argsort(order)
        places.append(solver.positions()[back])
        said.append(hashlib.sha256(places[-1].tobytes() + solver.states()[back].tobytes()).hexdigest())
    print("bits", type(material).__name__, *said, np.abs(places[1] - places[0]).max())
"""


@cache
def said_with_threads(number: int) -> dict[str, list[str]]:
    """Material: digests as coloured columns, in whole numbers, in whole numbers of shuffled particles, as coloured
    slabs; how far apart the first two are."""
    text = subprocess.run(
        [sys.executable, "-c", THREADS, str(number)], cwd=HOME, capture_output=True, text=True, check=True
    ).stdout
    lines = [line.split()[1:] for line in text.splitlines() if line.startswith("bits ")]
    return {name: rest for name, *rest in lines}


def test_the_same_bits_for_any_number_of_threads() -> None:
    """All five materials, thrown on a rough floor, in single precision; added up by colours and in whole numbers."""
    assert len(said_with_threads(1)) == 5
    assert said_with_threads(1) == said_with_threads(3)


@named
def test_whole_numbers_add_up_alike_in_any_order(material: Any) -> None:
    """To the bit, whatever the order of the particles; and to what the coloured blocks say within rounding."""
    coloured, whole, shuffled, _, apart = said_with_threads(3)[type(material).__name__]
    assert whole == shuffled
    assert coloured != whole  # or it was not tried
    assert float(apart) < 2e-6


def test_whole_numbers_keep_momentum() -> None:
    """To the quantum, in double precision: a body stretched and let go."""
    taichi_at(ti.f64)
    dx = 1 / 32
    points = cube((6, 6, 6), dx, (0.01, 0.02, 0.03))
    spin = np.cross([0.0, 0.5, 1.0], points - points.mean(axis=0)) - 0.5 * (points - points.mean(axis=0)) + (1, 0, 0)
    solver = Solver([body(Elastic(young=1e4), points, dx, spin)], dx, double=True, atomic=True)
    before = solver.momentum()
    solver.advance(0.05)
    assert solver.momentum() == pytest.approx(before, rel=1e-12, abs=1e-12 * np.abs(before).max())


def test_the_grid_grows_with_the_motion() -> None:
    """A ball thrown a metre away is where it should be, and the grid is not a metre wide."""
    taichi_at(ti.f32)
    dx = 1 / 32
    points = cube((3, 3, 3), dx)
    solver = Solver([body(Elastic(young=1e3, density=1000), points, dx, (20.0, 0, 0))], dx)
    solver.advance(0.05)
    assert solver.positions()[:, 0] - points[:, 0] == pytest.approx(np.full(len(points), 1.0), abs=1e-5)
    assert len(solver._grid) < 64**3


def test_steps_follow_from_sound_and_viscosity() -> None:
    dx, points = 0.01, np.zeros((1, 3))
    rubber, honey = Elastic(young=1e5, poisson=0.3), Newtonian(viscosity=200.0, bulk=1e5)
    sound = math.sqrt(1e5 * 0.7 / (1.3 * 0.4) / 1000)
    assert longest_step([Body(rubber, points, 1e-6)], dx) == pytest.approx(0.3 * dx / sound)
    assert longest_step([Body(rubber, points, 1e-6)], dx, 5.0) == pytest.approx(0.3 * dx / (sound + 5))
    assert longest_step([Body(honey, points, 1e-6)], dx) == pytest.approx(0.1 * dx**2 * 1000 / 100)
    water = Newtonian(viscosity=0.0, bulk=1e5)
    bodies, sound = [Body(rubber, points, 1e-6), Body(water, points, 1e-6)], math.sqrt(7e5 / 1000)
    assert longest_step(bodies, dx, least=[1.0, 0.9]) == pytest.approx(0.3 * dx / sound)
    squeezed = math.sqrt((0.5 + 6 * 0.5**-6) / 7) * sound
    assert longest_step(bodies, dx, least=[0.5, 0.5]) == pytest.approx(0.6 * dx / squeezed)


def test_a_fluid_squeezed_slowly_stays_calm() -> None:
    """Pressed to a third of its volume in a smooth well, its sound is thirty times as fast, and the steps follow."""
    taichi_at(ti.f64)
    dx, fluid = 1 / 32, Newtonian(viscosity=0.0, bulk=1e3)
    sound, side = math.sqrt(7 * fluid.bulk / fluid.density), 4 * dx
    walls = [Wall((0, 0, 0), (0, 0, 1), "slip")]
    for axis in (0, 1):
        for at, way in ((0.0, 1.0), (side, -1.0)):
            place, normal = np.zeros(3), np.zeros(3)
            place[axis], normal[axis] = at, way
            walls.append(Wall(tuple(place), tuple(normal), "slip"))
    (well,) = standing(*walls)
    (lid,) = standing(Wall((0, 0, side), (0, 0, -1), "slip"))
    lid.velocity = np.array([0, 0, -0.1 * sound])
    lid.pivot = np.array([0, 0, side])
    solver = Solver([body(fluid, cube((4, 4, 4), dx), dx)], dx, bearers=[well, lid], double=True)
    fastest = 0.0
    for _ in range(14):
        solver.advance(0.5 * side / sound)
        fastest = max(fastest, float(np.abs(solver.velocities()).max()))
    assert lid.pivot[2] == pytest.approx(0.3 * side)
    assert solver.states().mean() < -0.55
    assert fastest < 0.2 * sound


@pytest.mark.parametrize(
    "make",
    [
        lambda: Body(Elastic(), np.zeros((0, 3)), 1.0),
        lambda: Body(Elastic(), np.full((1, 3), math.nan), 1.0),
        lambda: Body(Elastic(), np.zeros((1, 3)), 0.0),
        lambda: Wall((0, 0, 0), (0, 0, 2.0)),
        lambda: Wall((0, 0, 0), (0, 0, 1.0), friction=-1.0),
        lambda: Solver([], 0.1),
        lambda: Solver([Body(Elastic(), np.zeros((1, 3)), 1.0)], 0.0),
    ],
)
def test_impossible_scenes(make: Any) -> None:
    with pytest.raises(ValueError, match="allowed"):
        make()


def test_more_particles_than_can_be_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their numbers are masked in the kernels: one too many would be taken for another."""
    taichi_at(ti.f32)
    monkeypatch.setattr(transfer, "_MOST_PARTICLES", 8)
    points = cube((1, 1, 1), 1 / 32)
    with pytest.raises(ValueError, match="9 particles of a body; allowed: 8"):
        Solver([Body(Elastic(), np.vstack([points, points[:1]]), 1e-6)], 1 / 32)
    solver = Solver([Body(Elastic(), points, 1e-6)], 1 / 32)
    with pytest.raises(ValueError, match="9 particles"):
        solver.add(0, points[:1], (0, 0, 0))


@pytest.mark.parametrize("double", [False, True])
def test_precisions_are_not_mixed(double: bool) -> None:
    """A solver is not made while Taichi runs at another precision, nor goes on when that was started meanwhile; when
    its own is back, it does."""
    one, other = (ti.f64, ti.f32) if double else (ti.f32, ti.f64)
    names = ("single", "double") if double else ("double", "single")
    told = f"Taichi runs in {names[0]} precision; allowed: {names[1]}, the solver's"
    dx = 1 / 32
    matter = body(Elastic(), cube((2, 2, 2), dx), dx)
    taichi_at(other)
    with pytest.raises(RuntimeError, match=told):
        Solver([matter], dx, double=double)
    taichi_at(one)
    solver = Solver([matter], dx, double=double)
    solver.step(1e-4)
    taichi_at(other)
    with pytest.raises(RuntimeError, match=told):
        solver.advance(1e-4)
    assert solver.steps == 1
    taichi_at(one)
    solver.step(1e-4)


def test_what_runs_away_is_not_followed() -> None:
    """At 10⁷ m/s a millisecond would be millions of steps; told before the first of them, with the speed."""
    taichi_at(ti.f32)
    dx = 1 / 32
    solver = Solver([body(Elastic(), cube((2, 2, 2), dx), dx, (1e7, 0, 0))], dx)
    with pytest.raises(ArithmeticError, match=r"2\d{6} steps in 0.001 s from t = 0 s on, at 1e\+07 m/s .*: 100000"):
        solver.advance(1e-3)
    assert solver.steps == 0


def test_what_breaks_says_so() -> None:
    taichi_at(ti.f32)
    dx = 1 / 32
    solver = Solver([body(Elastic(), cube((2, 2, 2), dx), dx, (math.inf, 0, 0))], dx)
    with pytest.raises(ArithmeticError, match="finite"):
        solver.advance(0.01)


def test_what_flies_apart_says_so() -> None:
    """Before a grid is made that no memory holds: its blocks of four cells, and eight more along each axis."""
    taichi_at(ti.f32)
    points = np.array([[0.0, 0.0, 0.0], [1e4, 0.0, 0.0]])
    nodes = (4 * (80_001 + 8)) * (4 * (1 + 8)) ** 2
    with pytest.raises(ArithmeticError, match=rf"^the particles spread over {nodes} nodes; allowed: {2**28}$"):
        Solver([Body(Elastic(), points, 1e-6)], 1 / 32).step(1e-5)


@pytest.mark.parametrize("component", [0, 1, 2])
def test_one_velocity_that_is_not_a_number_is_seen(component: int) -> None:
    """After the step in which it comes, whichever it is, of whichever of eight particles."""
    taichi_at(ti.f32)
    dx = 1 / 32
    solver = Solver([body(Elastic(), cube((4, 4, 4), dx), dx)], dx)
    solver.step(1e-4)
    solver._clouds[0].records[-3, 4 + component] = math.nan
    solver.step(1e-4)
    with pytest.raises(ArithmeticError, match="finite"):
        solver.advance(1e-4)
