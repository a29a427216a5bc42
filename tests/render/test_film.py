"""Filming from end to end, in small: files, cameras, failures."""

import dataclasses
import multiprocessing
import os
import signal
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from render import encode, film
from render.egl import NoGL, gl_info
from render.film import Footage, View, WorkerFailed, movable, plan_views, shoot, swept_sphere
from render.rig import FOV, NoClearView, Sphere, fit_distance, orbit, project

from .sets import CROWD, pendulum, staged


def two_views(footage):
    far = fit_distance(footage.sphere.radius)
    still = orbit(footage.sphere, 0.5, 0.6, far)
    path = np.stack([orbit(footage.sphere, 1 + 0.1 * i, 0.4, far) for i in range(len(footage.qpos))])
    return dataclasses.replace(footage, views=(View("CineCamera_0", still), View("CineCamera_Moving", path)))


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*.*"))}


def test_the_files_of_a_film(tmp_path):
    footage = two_views(pendulum())
    counts = []
    info = shoot(footage, tmp_path / "a", workers=1, progress=counts.append)
    assert counts == list(range(1, 19))
    assert info == gl_info()
    written = files(tmp_path / "a")
    assert sorted(written) == sorted(
        f"{view}/{kind}/{frame:04d}.{ending}"
        for view in ("CineCamera_0", "CineCamera_Moving")
        for kind, ending in (("rgb", "jpg"), ("depth", "npz"), ("seg", "npz"))
        for frame in range(9)
    )
    place = tmp_path / "a" / "CineCamera_Moving"
    rgb = encode.read_rgb(place / "rgb" / "0003.jpg")
    depth, seg = encode.read_depth(place / "depth" / "0003.npz"), encode.read_segmentation(place / "seg" / "0003.npz")
    assert rgb.shape == (64, 64, 3)
    assert depth.shape == seg.shape == (64, 64)
    angle = footage.qpos[3, 0]
    ball = [-0.6 * np.sin(angle), 0, 1 - 0.6 * np.cos(angle)]
    pixel, far = project(ball, footage.views[1].at(3), FOV, footage.size)
    column, row = pixel.astype(int)
    assert seg[row, column] == footage.ids[footage.model.geom("bob").id]
    assert depth[row, column] == pytest.approx(far - 0.1, abs=0.01)
    assert rgb[row, column, 0] > 1.5 * rgb[row, column, 1]

    shoot(footage, tmp_path / "b", workers=2)
    assert files(tmp_path / "b") == written

    shoot(dataclasses.replace(footage, modalities=frozenset({"seg"})), tmp_path / "c", workers=2)
    only = {name: data for name, data in written.items() if "/seg/" in name}
    assert files(tmp_path / "c") == only


def test_planned_cameras_see_the_subject_and_are_the_same_again():
    footage = pendulum(frames=9)
    views = plan_views(footage, np.random.default_rng(2))
    assert [view.name for view in views] == [*(f"CineCamera_{i}" for i in range(12)), "CineCamera_Moving"]
    assert [view.poses.shape for view in views] == [(4, 4)] * 12 + [(9, 4, 4)]
    generator = np.random.default_rng(2)
    again = plan_views(footage, generator)
    assert all(np.array_equal(a.poses, b.poses) for a, b in zip(views, again, strict=True))
    other = plan_views(footage, generator, count=1)
    assert not np.array_equal(other[0].poses, views[0].poses)


WALLED = """<mujoco><worldbody>
  <geom name="wall" type="box" pos=".7 0 1" size=".05 3 1"/>
  <body pos="0 0 .3"><joint type="slide" axis="0 0 1"/><geom name="ball" type="sphere" size=".1"/></body>
</worldbody></mujoco>"""


def test_cameras_behind_a_wall_are_drawn_again():
    model, ids = staged(WALLED)
    qpos = np.linspace(0, 0.3, 4)[:, None]
    footage = Footage(
        model, qpos, ids, swept_sphere(model, qpos, ids, subject=movable(model, ids), margin=5), size=(64, 64)
    )
    ball = int(ids[model.geom("ball").id])
    assert movable(model, ids) == {ball}
    free, behind = (orbit(footage.sphere, azimuth, 0.6, fit_distance(footage.sphere.radius)) for azimuth in (np.pi, 0))
    with footage.raster((160, 160), samples=0, shadow=0) as raster:
        assert film.subject_visible(raster, footage, free, {ball}, [0, 3])
        assert not film.subject_visible(raster, footage, behind, {ball}, [0, 3])
        aside = free.copy()
        aside[:3, 3] += 3 * free[:3, 0]
        assert not film.subject_visible(raster, footage, aside, {ball}, [0, 3])
    views = plan_views(footage, np.random.default_rng(0), count=6)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[0]
    mujoco.mj_kinematics(model, data)
    hit = np.zeros(1, np.int32)
    for view in views[:6]:
        way = data.geom("ball").xpos - view.poses[:3, 3]
        mujoco.mj_ray(model, data, view.poses[:3, 3], way, None, 1, -1, hit, None)
        assert hit[0] == model.geom("ball").id


def test_an_event_in_a_box_has_no_clear_view():
    model, ids = staged(
        '<mujoco><worldbody><geom type="box" size=".5 .5 .5"/>'
        '<body><freejoint/><geom type="sphere" size=".1"/></body></worldbody></mujoco>'
    )
    qpos = np.tile([0, 0, 0, 1.0, 0, 0, 0], (3, 1))
    footage = Footage(model, qpos, ids, Sphere(np.zeros(3), 0.6), size=(64, 64))
    with pytest.raises(NoClearView, match="only 0 of 12"):
        plan_views(footage, np.random.default_rng(0))
    assert not multiprocessing.active_children()


def test_the_swept_sphere_holds_the_whole_motion():
    footage = pendulum(frames=40)
    sphere = swept_sphere(footage.model, footage.qpos, footage.ids, margin=0)
    for (angle,) in footage.qpos:
        ball = np.array([-0.6 * np.sin(angle), 0, 1 - 0.6 * np.cos(angle)])
        assert np.linalg.norm(ball - sphere.centre) + 0.1 <= sphere.radius + 1e-9
    assert sphere.radius < 0.75
    only = swept_sphere(footage.model, footage.qpos, footage.ids, subject=movable(footage.model, footage.ids), margin=0)
    assert only.radius < 0.97 * sphere.radius
    with pytest.raises(ValueError, match="no geom"):
        swept_sphere(footage.model, footage.qpos, footage.ids, subject={77})


def test_mocap_bodies_move_and_are_movable(tmp_path):
    model, ids = staged(
        '<mujoco><worldbody><body mocap="true"><geom name="ball" type="sphere" size=".1"/></body></worldbody></mujoco>'
    )
    track = np.stack([np.linspace(-0.5, 0.5, 3), np.zeros(3), np.full(3, 0.3)], axis=1)[:, None]
    ball = int(ids[model.geom("ball").id])
    assert movable(model, ids) == {ball}
    sphere = swept_sphere(model, np.zeros((3, 0)), ids, mocap_pos=track)
    assert sphere.radius == pytest.approx(0.63, abs=0.05)
    footage = Footage(model, np.zeros((3, 0)), ids, sphere, mocap_pos=track, size=(64, 64))
    footage = two_views(footage)
    shoot(footage, tmp_path, workers=1)
    for frame in range(3):
        seg = encode.read_segmentation(tmp_path / "CineCamera_0" / "seg" / f"{frame:04d}.npz")
        (column, row), _ = project(track[frame, 0], footage.views[0].poses, FOV, (64, 64))
        assert seg[int(row), int(column)] == ball


def test_a_worker_that_fails_says_why_and_leaves_no_process(tmp_path):
    footage = two_views(pendulum())
    (tmp_path / "CineCamera_0" / "rgb" / "0002.jpg").mkdir(parents=True)
    with pytest.raises(WorkerFailed, match=r"drawing process \d of 2 failed: IsADirectoryError") as error:
        shoot(footage, tmp_path, workers=2)
    assert "write_rgb" in error.value.__notes__[0]
    assert not multiprocessing.active_children()


def test_a_worker_that_is_killed_is_one_clear_error(tmp_path):
    footage = two_views(pendulum(frames=200))

    def kill(done):
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    with pytest.raises(WorkerFailed, match="died: signal SIGKILL"):
        shoot(footage, tmp_path, workers=2, progress=kill)
    assert not multiprocessing.active_children()


def test_without_a_driver_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "none.json"))
    with pytest.raises(NoGL, match="sudo apt-get install -y") as error:
        shoot(two_views(pendulum()), tmp_path, workers=2)
    assert "\n" not in str(error.value)
    assert str(error.value).count("apt-get") == 1
    code = "import render.egl as e\ntry: e.gl_info()\nexcept e.NoGL as error: print(error)"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert told.startswith("no headless OpenGL: ")
    assert told.strip().endswith("libgl1-mesa-dri")


def test_another_platform_is_refused(monkeypatch):
    monkeypatch.setenv("PYOPENGL_PLATFORM", "glx")
    with pytest.raises(NoGL, match="PYOPENGL_PLATFORM='glx'"):
        gl_info()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"qpos": np.zeros((9, 3))}, "qpos must be"),
        ({"mocap_pos": np.zeros((4, 0, 3))}, "mocap_pos must be"),
        ({"views": (View("a", np.zeros((3, 4, 4))),)}, "view 'a' must be"),
        ({"views": (View("a", np.eye(4)), View("a", np.eye(4)))}, "share a name"),
        ({"modalities": frozenset({"flow"})}, "modalities must be"),
        ({"modalities": frozenset()}, "modalities must be"),
    ],
)
def test_a_footage_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(pendulum(), **changes)


def test_nothing_to_film_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="nothing to film"):
        shoot(pendulum(), tmp_path)
    with pytest.raises(ValueError, match="workers"):
        shoot(two_views(pendulum()), tmp_path, workers=0)


def test_modalities_of_one_frame_differ_but_agree(tmp_path):
    model, ids = staged(CROWD)
    sphere = Sphere(np.array([0, 0, 0.3]), 1.2)
    footage = Footage(model, model.qpos0[None], ids, sphere, size=(96, 96))
    pose = orbit(sphere, 0.5, 0.7, fit_distance(sphere.radius))
    shoot(dataclasses.replace(footage, views=(View("CineCamera_0", pose),)), tmp_path, workers=1)
    place = tmp_path / "CineCamera_0"
    rgb = encode.read_rgb(place / "rgb" / "0000.jpg").astype(int)
    seg = encode.read_segmentation(place / "seg" / "0000.npz")
    ball = seg == ids[model.geom("ball").id]
    assert ball.any()
    assert (rgb[ball][:, 2] - rgb[ball][:, 0]).mean() > 30
    assert (rgb[seg == 0][:, 2] - rgb[seg == 0][:, 0]).mean() < 10
