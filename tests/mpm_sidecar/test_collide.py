"""Obstacles: how far their surfaces are, what each grip leaves of a velocity, and what they are given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mpm_sidecar._ti import ti
from mpm_sidecar.collide import TOUCH, Bearer, Obstacle
from mpm_sidecar.transfer import Body, Solver
from physinone_mj.continuum import Elastic, Grip, Newtonian, Wall

from .taichi_at import taichi_at

Array = NDArray[np.float64]
DX = 1 / 16


def block(cells: tuple[int, int, int], corner: Any, velocity: Any = (0, 0, 0), material: Any = None) -> Body:
    """A box of whole cells, eight particles each."""
    axes = [(np.arange(2 * n) + 0.5) * DX / 2 for n in cells]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) + corner
    return Body(material or Elastic(), points, DX**3 / 8, velocity)


def _box(x: Array) -> Array:
    out = np.abs(x) - (0.3, 0.2, 0.1)
    return np.asarray(np.linalg.norm(np.maximum(out, 0), axis=1) + np.minimum(out.max(axis=1), 0))


def _cylinder(x: Array) -> Array:
    out = np.stack([np.hypot(x[:, 0], x[:, 1]) - 0.3, np.abs(x[:, 2]) - 0.2], axis=1)
    return np.asarray(np.linalg.norm(np.maximum(out, 0), axis=1) + np.minimum(out.max(axis=1), 0))


def _capsule(x: Array) -> Array:
    return np.asarray(np.linalg.norm(x - np.clip(x[:, 2:], -0.2, 0.2) * (0, 0, 1), axis=1) - 0.3)


@pytest.mark.parametrize(
    ("shape", "size", "exact"),
    [
        ("plane", (), lambda x: x[:, 2]),
        ("ball", (0.3,), lambda x: np.linalg.norm(x, axis=1) - 0.3),
        ("box", (0.3, 0.2, 0.1), _box),
        ("capsule", (0.3, 0.2), _capsule),
        ("cylinder", (0.3, 0.2), _cylinder),
    ],
)
def test_distances(shape: str, size: tuple[float, ...], exact: Callable[[Array], Array]) -> None:
    """Inside and outside, of a turned and moved shape."""
    taichi_at(ti.f64)
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    obstacle = Obstacle(shape, size, centre=np.array([0.1, -0.2, 0.3]), turn=turn)
    local = rng.uniform(-0.6, 0.6, (500, 3))
    assert obstacle.depth(local @ turn.T + obstacle.centre) == pytest.approx(exact(local), abs=1e-12)


def test_distance_of_an_ellipsoid() -> None:
    """It is that of a ball where the radii are one, zero on the surface, and right to first order near it."""
    taichi_at(ti.f64)
    rng = np.random.default_rng(2)
    way = rng.normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    radii = np.array([0.3, 0.2, 0.1])
    on, normal = way * radii, way / radii
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    obstacle = Obstacle("ellipsoid", (0.3, 0.2, 0.1))
    assert obstacle.depth(on) == pytest.approx(np.zeros(200), abs=1e-12)
    for off in (1e-4, -1e-4):
        assert obstacle.depth(on + off * normal) == pytest.approx(np.full(200, off), rel=2e-2)
    assert Obstacle("ellipsoid", (0.3,) * 3).depth(0.5 * way) == pytest.approx(np.full(200, 0.2), rel=1e-12)


def _field(size: tuple[float, float]) -> Obstacle:
    """A capsule as a mesh: its distances."""
    ticks = np.arange(-0.6, 0.61, 0.04)
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    inner = np.clip(grid[..., 2:], -size[1], size[1]) * (0, 0, 1)
    values = (np.linalg.norm(grid - inner, axis=-1) - size[0]).astype(np.float32)
    return Obstacle("mesh", (), "slip", values=values, corner=(-0.6,) * 3, spacing=0.04)


SHAPES = [
    Obstacle("ball", (0.5,), "slip"), Obstacle("ellipsoid", (0.5, 0.3, 0.2), "slip"),
    Obstacle("capsule", (0.3, 0.2), "slip"), Obstacle("capsule", (0.05, 0.5), "slip"),
    Obstacle("box", (0.3, 0.35, 0.4), "slip"), Obstacle("cylinder", (0.3, 0.4), "slip"),
    Obstacle("cylinder", (0.5, 0.1), "slip"), _field((0.3, 0.2)),
]  # fmt: skip
shaped = pytest.mark.parametrize("obstacle", SHAPES, ids=lambda o: f"{o.shape} {o.size}")


ASKEW = np.sqrt([1.0, 2.0, 3.0])
"""At right angles to no direction from node to node."""


def met(obstacle: Obstacle, nodes: int, dx: float) -> tuple[Array, Array]:
    """Nodes of a cube of that many a side about the origin (n, 3), which all hold matter that moves askew, and what is
    left of its velocity (n, 3)."""
    axis = dx * np.arange(-nodes // 2, nodes // 2)
    places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    grid = np.tile([*ASKEW, 1.0], (len(places), 1))
    blocks = np.arange((nodes // 4) ** 3, dtype=np.int32)
    Bearer([obstacle]).meet(grid, blocks, (nodes,) * 3, places[0], dx, ti.f64)
    return places, grid[:, :3]


@shaped
def test_all_that_lies_in_a_shape_meets_it(obstacle: Obstacle) -> None:
    """Every node in it, as far out as it goes in any direction, and no other."""
    taichi_at(ti.f64)
    dx = 1 / 48
    places, after = met(obstacle, 64, dx)
    within = obstacle.depth(places) <= TOUCH * dx
    assert within.any()
    assert ((after != ASKEW).any(axis=1) == within).all()


@shaped
def test_there_is_a_way_out_of_the_very_middle(obstacle: Obstacle) -> None:
    """Where all normals are alike, or none is nearest, matter is still stopped along one of them."""
    taichi_at(ti.f64)
    places, after = met(obstacle, 8, 0.01)
    left = after[(places == 0).all(axis=1)][0]
    lost = ASKEW - left
    assert np.linalg.norm(lost) > 0.99
    assert lost @ left == pytest.approx(0.0, abs=1e-12)
    if obstacle.shape != "mesh":
        nearest = obstacle.size[0] if obstacle.shape == "capsule" else min(obstacle.size)
        assert obstacle.depth(np.zeros((1, 3))) == pytest.approx(-nearest)


def test_distance_of_a_field() -> None:
    """A mesh is met by its field of distances, whose slope is the normal; away from it, it is not there."""
    taichi_at(ti.f64)
    ticks = np.arange(-0.5, 0.51, 0.02)
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    values = (np.linalg.norm(grid, axis=-1) - 0.3).astype(np.float32)
    obstacle = Obstacle("mesh", values=values, corner=(-0.5,) * 3, spacing=0.02)
    x = np.random.default_rng(3).uniform(-0.45, 0.45, (500, 3))
    assert obstacle.depth(x) == pytest.approx(np.linalg.norm(x, axis=1) - 0.3, abs=2e-3)
    assert (obstacle.depth(10 * x + 3.0) > 0).all()


GRIPS: list[tuple[Grip, float, Any, Any]] = [
    ("stick", 0.0, (1.0, 0.0, -1.0), (0.0, 0.0, 0.0)),
    ("stick", 0.0, (1.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    ("slip", 0.0, (1.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    ("slip", 0.0, (1.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    ("separate", 0.0, (1.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    ("separate", 0.3, (1.0, 0.0, -1.0), (0.7, 0.0, 0.0)),
    ("separate", 1.5, (1.0, 0.0, -1.0), (0.0, 0.0, 0.0)),
    ("separate", 0.3, (1.0, 0.0, 1.0), (1.0, 0.0, 1.0)),
]


@pytest.mark.parametrize(("grip", "friction", "before", "after"), GRIPS)
@pytest.mark.parametrize("moving", [False, True])
def test_grips(grip: Grip, friction: float, before: Any, after: Any, moving: bool) -> None:
    """What each grip leaves of a velocity, relative to the surface's own; what is lost is given to it."""
    taichi_at(ti.f64)
    own = np.array([0.4, -0.3, 0.2]) if moving else np.zeros(3)
    body = block((2, 2, 1), (0.0, 0.0, -3 * DX), own + before)
    bearer = Bearer([Obstacle.wall(Wall((0, 0, 0), (0, 0, 1), grip, friction))], velocity=own)
    solver = Solver([body], DX, bearers=[bearer], double=True)
    solver.step(1e-6)
    assert solver.velocities() == pytest.approx(np.tile(own + after, (len(body.points), 1)), abs=1e-9)
    mass = 1000.0 * 4 * DX**3
    assert bearer.impulse == pytest.approx(mass * np.subtract(before, after), abs=1e-9)


def test_a_turning_body_takes_what_sticks_with_it() -> None:
    """Matter within a turning ball gets ω × r, and its angular momentum is what the ball lost."""
    taichi_at(ti.f64)
    spin = np.array([0.0, 3.0, 4.0])
    bearer = Bearer([Obstacle("ball", (1.0,), "stick", centre=np.array([0.1, 0.0, 0.0]))],
                    pivot=np.array([0.1, 0.0, 0.0]), spin=spin)  # fmt: skip
    body = block((3, 3, 3), (0.2, -0.1, 0.1))
    solver = Solver([body], DX, bearers=[bearer], double=True)
    solver.step(1e-7)
    expected = np.cross(spin, body.points - bearer.pivot)
    assert solver.velocities() == pytest.approx(expected, abs=1e-6)
    assert bearer.impulse == pytest.approx(-solver.momentum(), rel=1e-9)


@pytest.mark.parametrize("mass", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("grip", ["stick", "separate"])
def test_what_one_side_loses_the_other_gains(mass: float, grip: Grip) -> None:
    """A free ball in the way of a block of 8 kg, light or heavy: momentum to round-off, every step, and no more energy
    than there was. Held for the step, a ball of a gram would be thrown at kilometres per second."""
    taichi_at(ti.f64)
    body = block((4, 4, 4), (0.0, 0.0, 0.0), (-2.0, 0.0, 0.0))
    inertia = 0.4 * mass * 0.1**2
    bearer = Bearer([Obstacle("ball", (0.1,), grip, 0.4, centre=np.array([-0.15, 0.2, 0.1]))],
                    pivot=np.array([-0.15, 0.2, 0.1]), yields=np.diag([1 / mass] * 3 + [1 / inertia] * 3))  # fmt: skip
    solver = Solver([body], DX, bearers=[bearer], double=True)
    start, heavy = solver.momentum(), solver.momentum()[0] ** 2 / (2 * 1000 * 64 * DX**3)
    for _ in range(60):
        solver.advance(1e-3)
        whole = solver.momentum() + mass * bearer.velocity
        assert whole == pytest.approx(start, abs=1e-12 * abs(start[0]))
        assert bearer.impulse == pytest.approx(mass * bearer.velocity, rel=1e-12)
        turning = inertia * bearer.spin + np.cross(bearer.pivot, mass * bearer.velocity)
        assert bearer.twist == pytest.approx(turning, abs=1e-12 * abs(start[0]))
        moving = 0.5 * mass * bearer.velocity @ bearer.velocity + 0.5 * inertia * bearer.spin @ bearer.spin
        assert moving <= heavy
    assert bearer.velocity[0] < -0.1 * 8 / (8 + mass)
    if mass < 1:
        assert -4.5 < bearer.velocity[0] < -1.5  # taken along, or thrown off elastically at most at twice the speed


@pytest.mark.parametrize("speed", [30.0, 100.0])
@pytest.mark.parametrize("turns", [False, True])
def test_steps_are_short_enough_for_what_strikes(speed: float, turns: bool) -> None:
    """A plate, or its end as it turns, that takes matter at rest along at many times the speed of sound: no step lets
    it pass through."""
    taichi_at(ti.f64)
    dx = 0.01
    points = block((6, 6, 6), (0.0, 0.0, 0.0)).points * dx / DX
    arm = 0.3 if turns else 0.0
    pivot = np.array([0.03 - arm, 0.03, -0.03])
    plate = Bearer([Obstacle("box", (arm + 0.05, 0.05, 0.005), "stick", centre=pivot.copy())], pivot=pivot)
    if turns:
        plate.spin = np.array([0.0, -speed / arm, 0.0])
    else:
        plate.velocity = np.array([0.0, 0.0, speed])
    solver = Solver([Body(Elastic(young=1e4), points, dx**3 / 8)], dx, bearers=[plate], double=True)
    for _ in range(4):
        solver.advance(0.02 / speed)
    (box,) = plate.obstacles
    assert ((solver.positions() - box.centre) @ box.turn)[:, 2].min() > -dx  # none of it has got behind it
    assert solver.velocities()[:, 2].mean() > 0.8 * speed
    assert np.abs(solver.velocities()).max() < 1.5 * speed


def test_what_stands_still_or_does_not_reach_is_not_fast() -> None:
    """The greatest speed within a box of a surface: a half space that turns has none without it."""
    ball = Bearer([Obstacle("ball", (0.1,), centre=np.array([1.0, 0.0, 0.0]))], pivot=np.array([0.5, 0.0, 0.0]))
    low, high = np.array([-1.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0])
    assert ball.speed(low, high) == 0.0
    ball.velocity, ball.spin = np.array([3.0, 4.0, 0.0]), np.array([0.0, 0.0, 2.0])
    assert ball.speed(low, high) == pytest.approx(5.0 + 2 * 0.6)
    wall = Bearer([Obstacle("plane")], spin=np.array([0.0, 0.0, 2.0]))
    assert wall.speed(low, high) == pytest.approx(18.0)


@pytest.mark.parametrize("slope", [0.2, 0.5])
def test_a_block_slides_down_by_coulombs_law(slope: float) -> None:
    """a = g (sin θ - μ cos θ) where tan θ > μ, else it stands."""
    taichi_at(ti.f64)
    friction, g = 0.35, 9.8
    gravity = g * np.array([math.sin(slope), 0.0, -math.cos(slope)])
    bearer = Bearer([Obstacle.wall(Wall((0, 0, 0), (0, 0, 1), "separate", friction))])
    solver = Solver([block((6, 6, 3), (0.0, 0.0, 0.0), material=Elastic(young=1e6))], DX, gravity=gravity,
                    bearers=[bearer], double=True)  # fmt: skip
    solver.advance(0.1)
    begin = solver.positions()[:, 0].mean()
    speed = solver.velocities()[:, 0].mean()
    solver.advance(0.2)
    expected = max(0.0, g * (math.sin(slope) - friction * math.cos(slope)))
    gained = (solver.velocities()[:, 0].mean() - speed) / 0.2
    assert gained == pytest.approx(expected, abs=0.03 * g * math.sin(slope))
    if not expected:
        assert abs(solver.positions()[:, 0].mean() - begin) < 2e-3


def test_the_floor_bears_the_weight() -> None:
    """What rests presses with m g: the impulse that the floor got, of a fluid at rest between smooth walls."""
    taichi_at(ti.f64)
    body = block((4, 4, 4), (0.0, 0.0, 0.0), material=Newtonian(viscosity=200.0, bulk=2e4))
    normals = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]
    places = [(0, 0, 0), (4 * DX, 0, 0), (0, 0, 0), (0, 4 * DX, 0)]
    sides = Bearer([Obstacle.wall(Wall(p, n, "slip")) for p, n in zip(places, normals, strict=True)])
    floor = Bearer([Obstacle.wall(Wall((0, 0, 0), (0, 0, 1)))])
    solver = Solver([body], DX, gravity=(0, 0, -9.8), bearers=[floor, sides], double=True)
    solver.advance(0.3)
    before = floor.impulse
    solver.advance(0.3)
    assert (floor.impulse - before) / 0.3 == pytest.approx([0, 0, -9.8 * 1000 * 64 * DX**3], rel=1e-2, abs=1e-2)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: Obstacle("cone"), "shape = 'cone'"),
        (lambda: Obstacle("mesh"), "a field of distances for a mesh"),
        (lambda: Obstacle("ball", (1.0,), "glue"), "grip = 'glue'"),  # type: ignore[arg-type]
        (lambda: Obstacle("ball", (1.0,), "stick", -1.0), "friction = -1"),
        (lambda: Solver([block((2, 2, 2), (0, 0, 0))], DX, period=(0.33, math.inf, math.inf)), "whole cells"),
    ],
)
def test_what_cannot_be_is_refused(wrong: Callable[[], object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        wrong()


def test_a_world_that_repeats_itself() -> None:
    """A block that leaves on one side comes in on the other: its momentum, its speed and its shape stay."""
    taichi_at(ti.f64)
    solver = Solver([block((4, 4, 4), (0.0, 0.0, 0.0), (3.0, 1.0, -2.0))], DX, period=12 * DX, double=True)
    start = solver.momentum()
    solver.advance(0.5)
    assert solver.momentum() == pytest.approx(start, rel=1e-12)
    assert np.abs(solver.velocities() - (3.0, 1.0, -2.0)).max() < 1e-9  # nothing was torn apart
    x = solver.positions()
    assert x.min() > -DX
    assert x.max() < 13 * DX
