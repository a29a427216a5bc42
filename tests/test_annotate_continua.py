"""What a scene folder says of matter that deforms, against what is known of its particles."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from physinone_mj import annotate
from physinone_mj.continuum import Box, Continuum, Granular, Newtonian, Piece
from physinone_mj.run import Cloud, Run
from physinone_mj.scene import Scene
from tests.test_annotate import FOV, FPS, GEOM, add, look_at, run_of

Floats = NDArray[np.float64]

SPACING = 0.02
HALF = np.array([0.2, 0.12, 0.08])


def brick() -> Floats:
    """Particles that fill a box about the origin."""
    lines = [np.arange(-half + SPACING / 2, half, SPACING) for half in HALF]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


def cloud(position: Floats, velocity: Floats, stride: int, present: list[int] | None = None) -> Cloud:
    """Of particles at every frame (F, n, 3); only what annotations read is told."""
    frames, count = position.shape[:2]
    there = present or [count] * frames
    centre = np.full((frames * stride, 3), math.nan)
    for frame, many in enumerate(there):
        if many:
            centre[frame * stride : (frame + 1) * stride] = position[frame, :many].mean(axis=0)
    nothing, none = np.zeros(frames * stride), np.zeros((frames * stride, 3))
    return Cloud(
        mass=np.full(frames * stride, 7.5), centre=centre, momentum=none, turning=none, kinetic=nothing,
        elastic=nothing, dissipated=nothing, volume=nothing, low=none, high=none, position=position.astype(np.float32),
        velocity=velocity.astype(np.float32), stretch=np.ones((frames, count), np.float32), present=np.array(there),
        bulk=SPACING**3, numerical_viscosity=2.5,
    )  # fmt: skip


def run_with(*clouds: Cloud, stride: int = 1, names: tuple[str, ...] = ("lump", "heap")) -> Run:
    scene = Scene()
    add(scene, "ball", {"type": GEOM.mjGEOM_SPHERE, "size": [0.1, 0, 0]})
    materials: list[Any] = [Newtonian(viscosity=20.0, density=1400.0), Granular(friction=0.6)]
    shape = Box((0.2, 0.12, 0.08))
    pieces = [Piece(n, m, shape, (0, 0, 0)) for n, m, _ in zip(names, materials, clouds, strict=False)]
    scene.continua.append(Continuum(pieces))
    qpos = np.tile((3.0, 0, 0, 1, 0, 0, 0), (len(clouds[0].mass), 1))
    run = run_of(scene, qpos, stride=stride)
    object.__setattr__(run, "clouds", dict(zip(names, clouds, strict=False)))
    object.__setattr__(run, "cell", 0.04)
    return run


def still(frames: int = 3, **changes: Any) -> Cloud:
    position = np.tile(brick(), (frames, 1, 1))
    return cloud(position, 0 * position, 1, **changes)


def test_pieces_come_after_bodies_and_are_told_by_their_law() -> None:
    run = run_with(still(), still())
    things = [(t.id, t.name, t.body) for t in annotate.things(run)]
    assert things == [(1, "ball", "ball"), (2, "lump", ""), (3, "heap", "")]
    told = annotate.properties(run)
    assert told["1"] == {
        "name": "ball", "dynamic_friction": 0.3, "static_friction": 0.3, "density": 1000.0, "restitution": 0.5,
    }  # fmt: skip
    assert told["2"] == {
        "name": "lump", "material": "Newtonian", "viscosity": 20.0, "bulk": 1e5, "density": 1400.0, "mass": 7.5,
        "cell": 0.04, "numerical_viscosity": 2.5,
    }  # fmt: skip
    assert told["3"]["material"] == "Granular"
    assert told["3"]["friction"] == 0.6
    json.dumps(told, allow_nan=False)
    assert set(np.unique(annotate.geom_ids(run))) == {0, 1}
    drawn = annotate.particles(run)
    assert [(p.segmentation, p.look) for p in drawn] == [(2, "honey"), (3, "sand")]


def test_a_piece_is_where_its_centre_of_mass_is_from_when_it_is_there() -> None:
    position = brick() + np.array([[[0.1 * frame, 0, 0.5]] for frame in range(4)])
    run = run_with(cloud(position, 0 * position, 2, present=[0, 0, 30, 1000]), stride=2)
    actor = annotate.motion(run, FPS)["actors"]["lump"]
    assert actor["segmentation_id"] == 2
    assert [entry["frame"] for entry in actor["transform_data"]] == [2, 3]
    last = actor["transform_data"][-1]["transform"]
    expected = 100 * position[3, :1000].mean(axis=0)
    assert list(last["location"].values()) == pytest.approx(expected.tolist())
    assert list(last["quaternion"].values()) == [1, 0, 0, 0]
    json.dumps(annotate.motion(run, FPS), allow_nan=False)


def test_the_mesh_of_a_piece_is_its_first_surface() -> None:
    shift = np.array([1.0, -2.0, 0.5])
    position = brick() + shift + np.zeros((2, 1, 1))
    run = run_with(cloud(position, 0 * position, 1))
    mesh = annotate.mesh(run, annotate.things(run)[1])
    assert mesh.volume == pytest.approx(8 * HALF.prod(), rel=5e-3)
    np.testing.assert_allclose(mesh.bounds, [-HALF, HALF], atol=0.15 * SPACING)
    empty = run_with(still(present=[0, 5, 5]))
    assert not len(annotate.mesh(empty, annotate.things(empty)[1]).vertices)


@pytest.mark.parametrize("stride", [1, 4])
def test_dense_flow_follows_the_particles(stride: int) -> None:
    """A brick that turns and shears at once; between frames it goes on as it went."""
    rate = np.array([[0.0, -4.0, 1.0], [4.0, 0, 0], [0.7, 0, 0]])
    start = brick()
    position = np.stack([start, start + start @ rate.T / FPS])
    velocity = np.tile(start @ rate.T, (2, 1, 1))
    run = run_with(cloud(position, velocity, stride), stride=stride)
    samples = (0, 1 if stride == 1 else 3)
    late = samples[1] / (FPS * stride)
    eye = look_at(np.array([0.6, -0.5, 0.7]), np.zeros(3))
    size = 96
    focal = size / 2 / math.tan(FOV / 2)
    # the plane of its top, in the picture
    across = (np.arange(size) + 0.5 - size / 2) / focal
    ways = np.stack([*np.meshgrid(across, -across), -np.ones((size, size))], axis=-1) @ eye[:3, :3].T
    depth = (HALF[2] - eye[2, 3]) / ways[..., 2]
    points = eye[:3, 3] + depth[..., None] * ways
    top = (np.abs(points[..., :2]) < HALF[:2] - 1.5 * SPACING).all(axis=-1)
    segmentation = np.where(top, 2, 0).astype(np.uint8)
    assert top.sum() > 100
    flow = annotate.dense_flow(run, depth.astype(np.float32), segmentation, (eye, eye), samples, FOV)
    moved = points + late * points @ rate.T
    local = (moved - eye[:3, 3]) @ eye[:3, :3]
    u, v = size / 2 - focal * local[..., 0] / local[..., 2], size / 2 + focal * local[..., 1] / local[..., 2]
    expected = np.stack([u - np.arange(size) - 0.5, v - np.arange(size)[:, None] - 0.5], axis=-1)
    assert np.abs(expected[top]).max() > 1
    assert np.abs(flow - expected)[top].max() < 0.1
    assert np.abs(flow[~top]).max() < 1e-3
