"""Cameras stand where they should: on the band, apart, fitting the sphere, moving without a jump."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from render import rig
from render.rig import FOV, NoClearView, Sphere

SPHERE = Sphere(np.array([0.3, -0.2, 0.5]), 0.8)
seeds = st.integers(0, 2**32 - 1)


def is_rotation(pose):
    turn = pose[..., :3, :3]
    unit = np.allclose(np.swapaxes(turn, -1, -2) @ turn, np.eye(3), atol=1e-12)
    return unit and np.allclose(np.linalg.det(turn), 1) and np.all(pose[..., 3, :] == [0, 0, 0, 1])


def latitude(pose, sphere=SPHERE):
    out = pose[..., :3, 3] - sphere.centre
    return np.arcsin(out[..., 2] / np.linalg.norm(out, axis=-1))


def test_the_field_of_view_is_that_of_the_release():
    assert pytest.approx(1.166746013987712, abs=1e-15) == FOV
    assert rig.focal(FOV, (1120, 1120)) == pytest.approx(848.4848484848485, abs=1e-9)


@given(arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-50, 50)))
@settings(max_examples=60, deadline=None)
def test_the_event_sphere_holds_all_points(points):
    sphere = rig.event_sphere(points, margin=0)
    assert np.linalg.norm(points - sphere.centre, axis=1).max() <= sphere.radius * (1 + 1e-9)


def test_the_event_sphere_is_small():
    rng = np.random.default_rng(3)
    out = rng.normal(size=(500, 3))
    out *= 2 / np.linalg.norm(out, axis=1)[:, None]
    assert rig.event_sphere(out + 7, margin=0).radius == pytest.approx(2, rel=5e-3)
    assert rig.event_sphere([[0, 0, 0], [2, 0, 0]], margin=0).radius == pytest.approx(1, rel=5e-3)
    assert rig.event_sphere([[0, 0, 0], [2, 0, 0]], margin=0.5).radius == pytest.approx(1.5, rel=5e-3)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((1, 3), np.nan)])
def test_an_event_sphere_of_nonsense_is_refused(points):
    with pytest.raises(ValueError, match="finite points"):
        rig.event_sphere(points)


@pytest.mark.parametrize(
    ("centre", "radius"), [([0, 0], 1), ([0, 0, 0], 0), ([0, 0, 0], math.inf), ([0, 0, math.nan], 1)]
)
def test_a_sphere_of_nonsense_is_refused(centre, radius):
    with pytest.raises(ValueError, match="sphere"):
        Sphere(centre, radius)


def rim(pose, sphere, fov, size):
    """Image coordinates of many points on the sphere."""
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points = sphere.centre + sphere.radius * points / np.linalg.norm(points, axis=1)[:, None]
    return rig.project(points, pose, fov, size)


@pytest.mark.parametrize("size", [(1120, 1120), (640, 360), (300, 500)])
@given(seed=seeds)
@settings(max_examples=8, deadline=None)
def test_static_views_see_the_whole_sphere_from_the_band(size, seed):
    poses = np.stack(rig.static_views(np.random.default_rng(seed), SPHERE, 12, clear=lambda pose: True, size=size))
    assert poses.shape == (12, 4, 4)
    assert is_rotation(poses)
    assert np.all((latitude(poses) >= math.radians(30) - 1e-9) & (latitude(poses) <= math.radians(60) + 1e-9))
    for pose in poses:
        pixels, depth = rim(pose, SPHERE, FOV, size)
        assert depth.min() > 0
        assert pixels.min() > 0
        assert np.all(pixels.max(axis=0) < size)


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_static_views_are_spread(seed):
    poses = np.stack(rig.static_views(np.random.default_rng(seed), SPHERE, 12, clear=lambda pose: True))
    out = poses[:, :3, 3] - SPHERE.centre
    azimuth = np.sort(np.arctan2(out[:, 1], out[:, 0]))
    gaps = np.diff(np.append(azimuth, azimuth[0] + 2 * math.pi))
    assert gaps.min() > math.radians(30) * 0.29
    assert gaps.max() < math.radians(30) * 1.71
    # equal areas: one camera in each twelfth of sin(latitude)
    low, high = math.sin(math.radians(30)), math.sin(math.radians(60))
    band = (np.sin(latitude(poses)) - low) / (high - low) * 12
    assert sorted(np.floor(band).astype(int)) == list(range(12))


def test_refused_views_are_drawn_again():
    refused = []

    def clear(pose):
        fine = pose[0, 3] > SPHERE.centre[0]
        refused.append(not fine)
        return fine

    poses = np.stack(rig.static_views(np.random.default_rng(5), SPHERE, 12, clear=clear))
    assert any(refused)
    assert np.all(poses[:, 0, 3] > SPHERE.centre[0])
    out = poses[:, :3, 3] - SPHERE.centre
    out /= np.linalg.norm(out, axis=1)[:, None]
    angles = np.arccos(np.clip(out @ out.T - 2 * np.eye(12), -1, 1))
    assert angles.min() >= rig.SEPARATION * 0.4


def test_a_scene_nobody_can_see_is_a_clear_error():
    with pytest.raises(NoClearView, match=r"only 0 of 12 static cameras see the event: .* 64 tries") as error:
        rig.static_views(np.random.default_rng(5), SPHERE, 12, clear=lambda pose: False)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", rig.STRATEGIES)
@given(seed=seeds)
@settings(max_examples=25, deadline=None)
def test_the_moving_view_is_smooth_and_above_ground(name, seed):
    frames = 150
    poses = rig.moving_view(np.random.default_rng(seed), SPHERE, frames, strategy=rig.STRATEGIES[name])
    assert poses.shape == (frames, 4, 4)
    assert is_rotation(poses)
    low, high = rig.MOVING_LATITUDE
    assert np.all((latitude(poses) >= low - 1e-9) & (latitude(poses) <= high + 1e-9))
    distance = np.linalg.norm(poses[:, :3, 3] - SPHERE.centre, axis=1)
    assert distance.min() >= rig.fit_distance(SPHERE.radius) * (1 - 1e-9)
    step = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / distance[1:]
    assert step.max() < math.radians(4)
    assert np.abs(np.diff(poses[:, :3, 3], n=2, axis=0)).max() / distance.max() < math.radians(1)
    assert step.sum() > math.radians(10)
    looks, _ = rig.project(SPHERE.centre, poses[seed % frames], FOV, (100, 100))
    assert looks == pytest.approx([50, 50], abs=1e-6)


def test_a_loop_closes():
    poses = rig.moving_view(np.random.default_rng(1), SPHERE, 200, strategy=rig.circular_loop)
    step = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert np.linalg.norm(poses[0, :3, 3] - poses[-1, :3, 3]) < 1.5 * step.max()


def test_every_strategy_is_drawn(monkeypatch):
    drawn = set()

    def spy(name, path):
        def called(*arguments):
            drawn.add(name)
            return path(*arguments)

        return called

    monkeypatch.setattr(rig, "STRATEGIES", {name: spy(name, path) for name, path in rig.STRATEGIES.items()})
    for seed in range(30):
        rig.moving_view(np.random.default_rng(seed), SPHERE, 3)
    assert len(drawn) == 3


def test_the_same_seed_gives_the_same_cameras():
    one, two = (rig.static_views(np.random.default_rng(9), SPHERE, clear=lambda pose: True) for _ in range(2))
    assert np.array_equal(one, two)
    one, two = (rig.moving_view(np.random.default_rng(9), SPHERE, 30) for _ in range(2))
    assert np.array_equal(one, two)


def test_projection_and_back_projection_are_inverse():
    pose = rig.orbit(SPHERE, 1.0, 0.7, 3.0)
    depth = np.random.default_rng(0).uniform(1, 9, (40, 60))
    points = rig.back_project(depth, pose, FOV)
    pixels, planar = rig.project(points, pose, FOV, (60, 40))
    x, y = np.meshgrid(np.arange(60) + 0.5, np.arange(40) + 0.5)
    assert np.allclose(pixels, np.stack([x, y], axis=-1), atol=1e-9)
    assert np.allclose(planar, depth, atol=1e-12)


def test_no_camera_looks_straight_down():
    with pytest.raises(ValueError, match="horizontal right vector"):
        rig.look_at([0, 0, 3], [0, 0, 0])


def test_importing_the_rig_loads_no_opengl():
    code = (
        "import sys, render, render.rig, render.egl, render.film;"
        "sys.exit(any(m.split('.')[0] == 'OpenGL' for m in sys.modules))"
    )
    fresh = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    assert subprocess.run([sys.executable, "-c", code], env=fresh, check=False).returncode == 0
