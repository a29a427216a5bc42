"""Things before a mirror: wrong mirrors are told from the true one, and pictures show what the tracer sees."""

from __future__ import annotations

import copy
import dataclasses
import functools
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p39_mirror_reflect import EYES, GLASS, MIRROR, THING, MirrorReflect, meeting, sight_lines
from physinone_mj import annotate
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import Optics, Ray
from physinone_mj.run import Run
from physinone_mj.scene import Mirror
from physinone_mj.simulate import simulate_specimen
from render.film import Footage, swept_sphere
from render.mirrors import Face
from render.rig import FOV, look_at, project

from .verdicts import failed, judge_random


@functools.cache
def look(**values: Any) -> Run:
    return simulate_specimen(MirrorReflect.make(**values), fidelity=DRAFT)


def bent(monkeypatch: pytest.MonkeyPatch, change: Any) -> None:
    """Change what every ray does that is thrown back: change(run's data, ray) is the new ray."""
    true = Optics.follow

    def follow(self: Optics, data: Any, *ray: Any, **how: Any) -> Ray:
        found = true(self, data, *ray, **how)
        return found if len(found.points) < 3 else change(data, found)

    monkeypatch.setattr(Optics, "follow", follow)


def test_the_true_mirror_is_right() -> None:
    assert not failed(look())


def test_too_little_parallax_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of the surroundings is looked up by direction, as if every ray came from the mirror's middle; here only
    by a fifth of the way there."""
    run = look()
    body = run.model.body(MIRROR).id

    def shifted(data: Any, ray: Ray) -> Ray:
        points = ray.points.copy()
        points[1:] += (data.xpos[body] - points[1]) / 5
        return dataclasses.replace(ray, points=points)

    bent(monkeypatch, shifted)
    laws = {"image_is_behind_the_mirror", "image_is_as_far_behind_as_the_thing_before"}
    assert failed(run) >= laws


def test_images_that_are_copies_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """As far behind as the thing is before, but moved and turned there: left and right stay what they are."""

    def copied(self: MirrorReflect, run: Run) -> Any:
        samples = np.linspace(0, len(run) - 1, 24).astype(int)
        points, middle = self.points(run)[samples], np.array([1.0, 0.0, 0.0])
        return samples, (points - middle) * (-1, -1, 1) - middle

    monkeypatch.setattr(MirrorReflect, "looked", copied)
    assert "left_and_right_are_exchanged_and_sizes_kept" in failed(look())


def test_light_that_is_thrown_back_sideways_too_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def turned(_data: Any, ray: Ray) -> Ray:
        points = ray.points.copy()
        points[2:, 1] = 2 * points[1, 1] - points[2:, 1]
        return dataclasses.replace(ray, points=points)

    bent(monkeypatch, turned)
    assert failed(look()) >= {"image_is_behind_the_mirror", "image_is_seen_through_the_glass_alone"}


def test_a_mirror_that_stays_where_it_was_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run, true = look(), Optics.follow
    start = mujoco.MjData(run.model)
    start.qpos[:] = run.qpos[0]
    mujoco.mj_kinematics(run.model, start)
    monkeypatch.setattr(Optics, "follow", lambda self, _data, *ray, **how: true(self, start, *ray, **how))
    assert failed(run) >= {"image_is_behind_the_mirror", "image_turns_back_and_runs_twice_as_fast"}


def test_a_mirror_without_an_edge_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = look()
    glass = run.model.geom(GLASS).id
    true = Optics.follow

    def endless(self: Optics, data: Any, start: Any, direction: Any, **how: Any) -> Ray:
        ray = true(self, data, start, direction, **how)
        if ray.geoms[0] == glass:
            return ray
        turn, middle = data.xmat[run.model.body(MIRROR).id].reshape(3, 3), data.xpos[run.model.body(MIRROR).id]
        normal = turn[:, 0]
        far = (middle + 0.004 * normal - start) @ normal / (np.asarray(direction) @ normal)
        hit = start + far * direction
        out = direction - 2 * (direction @ normal) * normal
        return dataclasses.replace(ray, points=np.array([start, hit, hit + out]), geoms=np.array([glass, -1], np.int32))

    monkeypatch.setattr(Optics, "follow", endless)
    assert "image_is_seen_through_the_glass_alone" in failed(run)


def test_two_other_eyes_see_the_image_in_the_same_place() -> None:
    run = look()
    samples = np.array([500, 600, 700])
    places = run.position(THING)[samples, None]
    images = []
    for eyes in (EYES, EYES + np.array([[-0.3, 0.2, 0.0], [0.4, -0.1, 0.1]])):
        sights = np.stack([sight_lines(run, samples, eye, places) for eye in eyes], axis=2)
        images.append(meeting(eyes, sights)[:, 0])
    assert images[0] == pytest.approx(images[1], abs=1e-9)


@pytest.mark.parametrize("values", [{}, {"tilt": -0.12, "travel": 0.2}])
def test_pictures_show_the_image_where_rays_find_it(values: dict[str, float]) -> None:
    run = look(**values)
    ids, qpos = annotate.geom_ids(run), run.qpos[:: run.stride]
    faces = tuple(
        Face(run.model.geom(m.geom).id, m.point, m.normal)
        for m in run.scene.mirrors
        if isinstance(m, Mirror) and m.point is not None and m.normal is not None
    )
    assert len(faces) == 1
    width = 480
    glowing = copy.copy(run.model)  # the same green all round, lest its dark side be overlooked
    glowing.mat_emission[run.model.geom_matid[run.model.geom(THING).id]] = 1.0
    footage = Footage(
        glowing, qpos, ids, swept_sphere(glowing, qpos, ids), faces=faces, size=(width, width),
        tendon_ids=np.zeros(run.model.ntendon, int),
    )  # fmt: skip
    mirror = ids[run.model.geom(GLASS).id]
    pose, seen = look_at(EYES[0], [0.1, -0.1, 0.45]), 0
    images = run.specimen.ball_image(run)[:: run.stride]
    with footage.raster(footage.size) as raster:
        for frame in (45, 60, 75):
            footage.put(raster, frame)
            picture = raster.colour(pose).astype(float)
            _, seg = raster.depth_and_segmentation(pose)
            green = picture[..., 1] - np.maximum(picture[..., 0], picture[..., 2])
            there = (green > 12) & (seg == mirror)
            rows, columns = np.nonzero(there)
            if not np.isfinite(images[frame]).all():
                continue
            pixel, _ = project(images[frame], pose, FOV, (width, width))
            assert len(rows) > 60
            assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 1.5e-3 * width
            seen += 1
    assert seen >= 2


@pytest.mark.parametrize(
    "values",
    [
        {"width": 0.3, "tilt": 0.15, "letter": 0.15, "travel": 0.05, "turn": 0.3},
        {"width": 0.6, "tilt": -0.15, "letter": 0.3, "travel": 0.2, "height": 0.6, "radius": 0.08},
    ],
)
def test_extremes(values: dict[str, float]) -> None:
    assert not failed(look(**values))


@pytest.mark.slow
def test_random_specimens() -> None:
    assert min(judge_random(MirrorReflect, 12).values()) >= 8
