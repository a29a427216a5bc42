"""What a scene folder says of a run, against what is known of the run without it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from physinone_mj import annotate
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import IMMATERIAL, Scene
from tests.release_reader import Camera, Frame, load_camera, load_frustums, load_split, novel_views

Floats = NDArray[np.float64]

FOV = 2 * math.atan(0.66)
FPS = 30
GEOM = mujoco.mjtGeom

BOX_SIZE = np.array([0.30, 0.20, 0.12])
BALL_RADIUS = 0.18


def quaternion(axis: Floats, angle: float) -> Floats:
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis])


def look_at(eye: Floats, target: Floats) -> Floats:
    """Camera to world, OpenGL axes."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.column_stack([right, np.cross(back, right), back, eye])
    return pose


def run_of(scene: Scene, qpos: Floats, *, stride: int = 1) -> Run:
    """A run whose states are given; its specimen has a label only."""

    def again(**_: Any) -> Run:
        raise AssertionError

    model = scene.spec.compile()
    t = np.arange(len(qpos)) / (FPS * stride)
    return Run(
        specimen=SimpleNamespace(label="Made"), fidelity=DRAFT, seed=0, scene=scene, model=model, t=t, qpos=qpos,
        qvel=np.zeros((len(qpos), model.nv)), stride=stride, impacts=(), step=0.001, seconds=0.0,
        worked=np.zeros(len(qpos)), again_with=again,
    )  # fmt: skip


def add(scene: Scene, name: str, *geoms: dict[str, Any], free: bool = True) -> None:
    body = scene.spec.worldbody.add_body(name=name)
    if free:
        body.add_freejoint()
    for geom in geoms:
        body.add_geom(**({"mass": 1.0} | geom))
    scene.material(name, 1000.0, Surface(friction=0.3, restitution=0.5))


def box_and_ball(poses: list[Floats]) -> Run:
    """A box that goes through the poses (7,) beside a ball that rests."""
    scene = Scene()
    add(scene, "box", {"type": GEOM.mjGEOM_BOX, "size": BOX_SIZE})
    add(scene, "ball", {"type": GEOM.mjGEOM_SPHERE, "size": [BALL_RADIUS, 0, 0]})
    return run_of(scene, np.array([np.concatenate([pose, [-0.7, 0.5, BALL_RADIUS], [1, 0, 0, 0]]) for pose in poses]))


def cast(pose: Floats, box: Floats, size: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Planar depth and ids of the floor z = 0, the box (1) at a pose (7,) and the ball (2), ray by ray."""
    focal = 0.5 * size / math.tan(FOV / 2)
    u = (np.arange(size) + 0.5 - size / 2) / focal
    rays = np.stack(np.broadcast_arrays(u[None], -u[:, None], -1.0), axis=-1) @ pose[:3, :3].T
    eye = pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        hits = [np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)]
        turn = quaternion_matrix(box[None, 3:])[0]
        near = (np.array([-1, 1])[:, None, None, None] * BOX_SIZE - (eye - box[:3]) @ turn) / (rays @ turn)
        enter, leave = near.min(axis=0).max(axis=-1), near.max(axis=0).min(axis=-1)
        hits.append(np.where((enter < leave) & (enter > 0), enter, np.inf))
        offset = eye - np.array([-0.7, 0.5, BALL_RADIUS])
        a, b, c = (rays**2).sum(-1), rays @ offset, offset @ offset - BALL_RADIUS**2
        hits.append(np.where(b**2 > a * c, (-b - np.sqrt(b**2 - a * c)) / a, np.inf))
    depth = np.min(hits, axis=0)
    ids = np.argmin(hits, axis=0).astype(np.uint8)
    return np.where(np.isfinite(depth), depth, 65504.0).astype(np.float32), np.where(np.isfinite(depth), ids, 0)


def test_turns_go_round() -> None:
    rng = np.random.default_rng(5)
    poses = rng.normal(size=(500, 4))
    # straight up and down, where yaw and roll are about one axis, and close to it
    upright = [
        quaternion(np.array([0, 1, 0]), sign * (math.pi / 2 - off)) for sign in (1, -1) for off in (0, 1e-9, 1e-4)
    ]
    turned = [quaternion(np.array([1, 0, 0]), angle) for angle in (0.0, 0.4, 3.0)]
    product = np.zeros(4)
    for q in upright:
        for r in turned:
            mujoco.mju_mulQuat(product, q, r)
            poses = np.vstack([poses, product])
    poses /= np.linalg.norm(poses, axis=1)[:, None]
    scene = Scene()
    add(scene, "box", {"type": GEOM.mjGEOM_BOX, "size": BOX_SIZE})
    told = annotate.motion(run_of(scene, np.column_stack([np.zeros((len(poses), 3)), poses])), FPS)
    for entry, q in zip(told["actors"]["box"]["transform_data"], poses, strict=True):
        turn = entry["transform"]["rotation"]
        matrix = np.eye(3)
        for axis, name in ((np.eye(3)[0], "roll"), (np.eye(3)[1], "pitch"), (np.eye(3)[2], "yaw")):
            matrix = quaternion_matrix(quaternion(axis, math.radians(turn[name]))[None])[0] @ matrix
        np.testing.assert_allclose(matrix, quaternion_matrix(q[None])[0], atol=1e-13)
        told_quaternion = np.array([entry["transform"]["quaternion"][k] for k in "wxyz"])
        np.testing.assert_allclose(told_quaternion, q, atol=1e-14)
        assert -90 <= turn["pitch"] <= 90


def test_motion_is_told_per_video_frame_in_centimetres() -> None:
    qpos = np.column_stack([np.linspace(0, 1, 24), np.zeros(24), np.full(24, 0.5), np.tile([1, 0, 0, 0], (24, 1))])
    scene = Scene()
    add(scene, "box", {"type": GEOM.mjGEOM_BOX, "size": BOX_SIZE, "pos": [0, 0, 0.3]})
    told = annotate.motion(run_of(scene, qpos, stride=8), FPS)
    assert told["sequence_info"] == {"total_frames": 3, "start_frame": 0, "end_frame": 2, "frame_rate": 30.0}
    found = told["actors"]["box"]["transform_data"]
    assert [entry["frame"] for entry in found] == [0, 1, 2]
    # the local origin, not the centre of mass
    assert [entry["transform"]["location"] for entry in found] == [
        {"x": pytest.approx(100 * k * 8 / 23), "y": 0.0, "z": pytest.approx(50.0)} for k in range(3)
    ]
    json.dumps(told, allow_nan=False)


def test_flow_of_a_moved_and_turned_box_seen_by_a_moving_camera() -> None:
    size = 320
    start = np.concatenate([[0.1, -0.2, 0.4], quaternion(np.array([1.0, 2.0, 3.0]), 0.7)])
    end = np.concatenate([[0.3, -0.1, 0.5], quaternion(np.array([1.0, 1.9, 3.2]), 1.0)])
    cameras = look_at(np.array([1.2, 2.1, 0.7]), np.zeros(3)), look_at(np.array([1.0, 2.3, 0.8]), np.zeros(3))
    run = box_and_ball([start, end])
    first, second = cast(cameras[0], start, size), cast(cameras[1], end, size)
    assert {0, 1, 2} == set(np.unique(first[1]))
    flow = annotate.dense_flow(run, *first, cameras, (0, 1), FOV)
    assert flow.shape == (size, size, 2)
    sky = first[0] >= 65504
    assert sky.any()
    assert np.isnan(flow[sky]).all()
    assert np.isfinite(flow[~sky]).all()

    row, column = np.nonzero(~sky)
    to_column = np.floor(column + 0.5 + flow[row, column, 0]).astype(int)
    to_row = np.floor(row + 0.5 + flow[row, column, 1]).astype(int)
    inside = (to_column >= 0) & (to_column < size) & (to_row >= 0) & (to_row < size)
    for thing in (0, 1, 2):
        mine = inside & (first[1][row, column] == thing)
        # where a point is in the second picture and how far; it is visible there if nothing is nearer
        points = carried(first[0], cameras[0], size)[row[mine], column[mine]]
        if thing == 1:
            turns = [quaternion_matrix(pose[None, 3:])[0] for pose in (start, end)]
            points = (points - start[:3]) @ turns[0] @ turns[1].T + end[:3]
        depth = -((points - cameras[1][:3, 3]) @ cameras[1][:3, 2])
        seen = second[0][to_row[mine], to_column[mine]]
        visible = depth < seen * 1.01
        same = second[1][to_row[mine], to_column[mine]] == thing
        assert visible.sum() > 300
        assert same[visible].mean() >= 0.98

    # a point of the box by hand
    k = int(np.flatnonzero(first[1][row, column] == 1)[200])
    r, c = row[k], column[k]
    point = carried(first[0], cameras[0], size)[r, c]
    turns = [quaternion_matrix(pose[None, 3:])[0] for pose in (start, end)]
    local = (turns[1] @ (turns[0].T @ (point - start[:3])) + end[:3] - cameras[1][:3, 3]) @ cameras[1][:3, :3]
    focal = 0.5 * size / math.tan(FOV / 2)
    expected = [size / 2 + focal * local[0] / -local[2] - c - 0.5, size / 2 - focal * local[1] / -local[2] - r - 0.5]
    np.testing.assert_allclose(flow[r, c], expected, atol=1e-4)


def carried(depth: NDArray[np.float32], pose: Floats, size: int) -> Floats:
    """World points (size, size, 3) of the pixels' centres."""
    focal = 0.5 * size / math.tan(FOV / 2)
    u = (np.arange(size) + 0.5 - size / 2) / focal
    rays = np.stack(np.broadcast_arrays(u[None], -u[:, None], -1.0), axis=-1) @ pose[:3, :3].T
    return np.asarray(pose[:3, 3] + rays * depth[..., None].astype(float))


def test_nothing_moves_where_nothing_moves() -> None:
    pose = np.concatenate([[0.1, -0.2, 0.4], quaternion(np.array([1.0, 2.0, 3.0]), 0.7)])
    camera = look_at(np.array([2.0, -1.6, 1.7]), np.zeros(3))
    depth, ids = cast(camera, pose, 64)
    flow = annotate.dense_flow(box_and_ball([pose, pose]), depth, ids, (camera, camera), (0, 1), FOV)
    assert np.nanmax(np.abs(flow)) < 1e-9


@pytest.mark.parametrize(
    ("shape", "volume", "extents", "off"),
    [
        ({"type": GEOM.mjGEOM_SPHERE, "size": [0.2, 0, 0]}, 4 / 3 * math.pi * 0.008, (0.4, 0.4, 0.4), 5e-3),
        (
            {"type": GEOM.mjGEOM_ELLIPSOID, "size": [0.1, 0.2, 0.3]},
            4 / 3 * math.pi * 0.006,
            (0.2, 0.4, 0.6),
            5e-3,
        ),
        ({"type": GEOM.mjGEOM_BOX, "size": [0.1, 0.2, 0.3]}, 0.048, (0.2, 0.4, 0.6), 1e-12),
        ({"type": GEOM.mjGEOM_CYLINDER, "size": [0.1, 0.2, 0]}, math.pi * 0.004, (0.2, 0.2, 0.4), 2e-3),
        (
            {"type": GEOM.mjGEOM_CAPSULE, "size": [0.1, 0.2, 0]},
            math.pi * (0.004 + 4 / 3 * 0.001),
            (0.2, 0.2, 0.6),
            2e-2,
        ),
    ],
    ids=["sphere", "ellipsoid", "box", "cylinder", "capsule"],
)
def test_meshes_of_the_primitives(
    shape: dict[str, Any], volume: float, extents: tuple[float, float, float], off: float
) -> None:
    scene = Scene()
    add(scene, "thing", shape)
    run = run_of(scene, np.array([[0, 0, 0, 1.0, 0, 0, 0]]))
    (thing,) = annotate.things(run)
    mesh = annotate.mesh(run, thing)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=off)
    np.testing.assert_allclose(mesh.bounds, np.array([[-0.5], [0.5]]) * extents, atol=6e-3 * max(extents))
    np.testing.assert_allclose(mesh.center_mass, 0, atol=1e-6)


def test_a_mesh_stands_where_its_geoms_do() -> None:
    turn = quaternion(np.array([0.0, 0.0, 1.0]), math.pi / 2)
    corners = np.array(trimesh.creation.box(extents=(0.1, 0.2, 0.4)).vertices) + 0.3
    scene = Scene()
    scene.spec.add_mesh(name="brick", uservert=corners.ravel().tolist())
    add(
        scene,
        "thing",
        {"type": GEOM.mjGEOM_BOX, "size": [0.1, 0.2, 0.3], "pos": [1.0, 0, 0], "quat": turn},
        {"type": GEOM.mjGEOM_MESH, "meshname": "brick", "pos": [0, 1.0, 0]},
        {"type": GEOM.mjGEOM_SPHERE, "size": [0.5, 0, 0], "group": annotate.HIDDEN},
        {"type": GEOM.mjGEOM_SPHERE, "size": [0.5, 0, 0], "group": IMMATERIAL},
    )
    run = run_of(scene, np.array([[5.0, 5, 5, 0.5, 0.5, 0.5, 0.5]]))  # the body's own pose does not matter
    parts = annotate.mesh(run, annotate.things(run)[0]).split()
    assert len(parts) == 2
    box, brick = sorted(parts, key=lambda part: -part.volume)
    np.testing.assert_allclose(box.bounds, [[0.8, -0.1, -0.3], [1.2, 0.1, 0.3]], atol=1e-7)
    np.testing.assert_allclose(brick.bounds, [[0.25, 1.2, 0.1], [0.35, 1.4, 0.5]], atol=1e-6)
    assert brick.volume == pytest.approx(0.008, rel=1e-6)


def test_ids_and_properties() -> None:
    scene = Scene()
    ball = {"type": GEOM.mjGEOM_SPHERE, "size": [0.1, 0, 0]}
    add(scene, "first", ball, ball)
    add(scene, "proxy", ball | {"group": annotate.HIDDEN})
    add(scene, "second", ball)
    scene.material("second", 7800.0, Surface(friction=0.2, static=0.35, restitution=0.6))
    run = run_of(scene, np.tile(np.array([0, 0, 0, 1.0, 0, 0, 0]), 3)[None])
    told = annotate.properties(run)
    assert list(told) == ["1", "2"]
    assert told["2"] == {
        "name": "second", "dynamic_friction": 0.2, "static_friction": 0.35, "density": 7800.0, "restitution": 0.6,
    }  # fmt: skip
    ids = annotate.geom_ids(run)
    bodies = [run.model.body(int(body)).name for body in run.model.geom_bodyid]
    assert {(body, int(i)) for body, i in zip(bodies, ids, strict=True) if i} == {("first", 1), ("second", 2)}
    assert [body for body, i in zip(bodies, ids, strict=True) if i].count("first") == 2


def test_a_body_of_unknown_matter_is_told() -> None:
    scene = Scene()
    add(scene, "first", {"type": GEOM.mjGEOM_SPHERE, "size": [0.1, 0, 0]})
    scene.matter.clear()
    with pytest.raises(KeyError, match="first"):
        annotate.things(run_of(scene, np.array([[0, 0, 0, 1.0, 0, 0, 0]])))


def around(count: int, seed: int) -> list[Floats]:
    rng = np.random.default_rng(seed)
    return [look_at(3 * np.array([math.cos(a), math.sin(a), h]), np.zeros(3))
            for a, h in zip(rng.uniform(0, 2 * math.pi, count), rng.uniform(0.5, 1.2, count), strict=True)]  # fmt: skip


@pytest.mark.parametrize("count", [12, 15])
@pytest.mark.parametrize("frames", [150, 91])
def test_split(tmp_path: Path, count: int, frames: int) -> None:
    files = []
    for number, pose in enumerate(around(count, 3 * count + frames)):
        files.append(
            annotate.camera_file(
                f"CineCamera_{number}", np.broadcast_to(pose, (frames, 4, 4)), fov=FOV, size=96, fps=FPS,
                trajectory="X_trajectory", number=number,
            )
        )  # fmt: skip
        (tmp_path / f"blender_CineCamera_{number}.json").write_text(json.dumps(files[-1]))
    for name, part in annotate.split_files(files).items():
        (tmp_path / f"transforms_{name}.json").write_text(json.dumps(part))
    cameras = [load_camera(tmp_path / f"blender_CineCamera_{i}.json") for i in range(count)]
    split = {name: load_split(tmp_path, name) for name in ("train", "val", "test")}
    novel = {int(name.rsplit("_", 1)[1]) for name in novel_views(cameras)}
    assert split["val"].views == novel
    assert split["train"].views == set(range(count)) - novel
    assert split["test"].views == set(range(count))
    half = (frames + 1) // 2  # 75 of 150, 46 of 91: time is f/(N - 1)
    assert len(split["val"].frames) == 2 * half
    assert len(split["train"].frames) == (count - 2) * half
    assert len(split["test"].frames) == count * (frames - half)
    assert {f.index for f in split["train"].frames} == set(range(half))
    assert len(split["train"].initial) == count - 2


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_split_of_few_views(count: int) -> None:
    files = [
        annotate.camera_file(
            f"CineCamera_{number}", np.broadcast_to(pose, (4, 4, 4)), fov=FOV, size=96, fps=FPS, trajectory="X",
            number=number,
        )
        for number, pose in enumerate(around(count, count))
    ]  # fmt: skip
    parts = annotate.split_files(files)
    assert len(parts["train"]["frames"]) + len(parts["val"]["frames"]) == 2 * count
    assert len(parts["test"]["frames"]) == 2 * count
    assert len(parts["val"]["frames"]) == (2 if count > 2 else 0)


def test_one_frame_has_time_zero() -> None:
    (frame,) = annotate.camera_file(
        "CineCamera_0", np.eye(4)[None], fov=FOV, size=96, fps=FPS, trajectory="X", number=0
    )["frames"]
    assert (frame["time"], frame["time_abs"]) == (0.0, 0.0)


def test_frustums(tmp_path: Path) -> None:
    poses = around(3, 8)
    path = tmp_path / "cameras.ply"
    path.write_text(annotate.frustums([(pose, i == 2) for i, pose in enumerate(poses)], FOV, 0.25))
    found = load_frustums(path)
    assert found.shape == (3, 9, 6)
    for vertices, pose, moving in zip(found, poses, (False, False, True), strict=True):
        np.testing.assert_allclose(vertices[0, :3], pose[:3, 3], atol=1e-6)
        for place, direction in ((6, pose[:3, 0]), (7, pose[:3, 1]), (8, -pose[:3, 2])):
            np.testing.assert_allclose(vertices[place, :3], pose[:3, 3] + 0.25 * direction, atol=1e-6)
        assert ((vertices[:, 3:] == (255, 0, 0)).all(axis=1) == moving).all()
    # the picture's corners: seen from the camera, they are half the field of view away
    camera = Camera("X", FOV, 96, 96, FPS, 1, "X", [Frame(0, poses[0], "", 0.0, 0.0, None)])
    local = (found[0, 1:5, :3] - poses[0][:3, 3]) @ poses[0][:3, :3]
    np.testing.assert_allclose(np.abs(local[:, :2] / local[:, 2:]), 48 / camera.focal, atol=1e-4)
