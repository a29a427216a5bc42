"""A convex mirror: what turns with it, fakes of its shape and beams that lag are told from the true ones."""

from __future__ import annotations

import copy
import functools
from dataclasses import replace
from math import acos, pi
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.p36_fixed_convex_redirect import FixedConvexRedirect
from physinone_mj import optics
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import NO_RAY, Optics, Rays
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate_specimen

from .rays import everything_reflects, frozen, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed, judge_random, verdicts

SEEM = "beams_seem_to_come_from_behind_the_surface"
TURNED = "deviation_knows_only_how_far_off_the_middle"
STRAIGHT = "beams_that_pass_beside_go_straight_on"
SPOTS = "spots_run_as_the_map_of_the_sphere_says"
KINDS = pytest.mark.parametrize("mirror", ["ball", "column"])


@functools.cache
def passed(**values: Any) -> Run:
    return simulate_specimen(FixedConvexRedirect.make(**({"count": 5, "pace": 1.5} | values)), fidelity=DRAFT)


@KINDS
def test_true_light_is_right(mirror: str) -> None:
    run = passed(mirror=mirror)
    assert set(verdicts(run).values()) == {"passed"}
    assert not in_each_other_s_way(run)


def test_it_is_a_true_ball_and_it_truly_rolls() -> None:
    run = passed()
    speed, r = run.specimen.speed, run.specimen.radius
    assert run.velocity("mirror_ball/ball")[:, 1] == pytest.approx(np.full(len(run), speed), rel=1e-9)
    assert run.spin("mirror_ball/ball")[:, 0] == pytest.approx(np.full(len(run), -speed / r), rel=1e-9)
    turned = quaternion_matrix(run.quaternion("mirror_ball/ball"))
    assert np.ptp(turned[:, 2, 2]) > 1.9  # more than half a turn


@KINDS
def test_rotation_moves_no_beam_and_translation_does(mirror: str) -> None:
    """The same place with the mirror turned at random about its middle (a column: about its axis)."""
    run = passed(mirror=mirror)
    rng = np.random.default_rng(0)
    samples = run.qpos[len(run) // 4 : 3 * len(run) // 4 : 97]
    other = samples.copy()
    if mirror == "ball":
        free = int(run.model.joint("mirror_ball/free").qposadr[0])
        quaternions = rng.normal(size=(len(samples), 4))
        other[:, free + 3 : free + 7] = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
        moved = other + 0.05 * run.specimen.radius * (np.arange(other.shape[1]) == free + 1)
    else:
        other[:, run.model.joint("mirror_column/hinge").qposadr[0]] = rng.uniform(-9, 9, len(samples))
        moved = other + 0.05 * run.specimen.radius * (
            np.arange(other.shape[1]) == run.model.joint("mirror_column/slide").qposadr[0]
        )
    differs = 0
    for beam in run.scene.beams:
        here, turned, away = (optics.follow(run.model, run.scene, beam, poses) for poses in (samples, other, moved))
        assert (here.geoms == turned.geoms).all()
        assert np.allclose(here.points, turned.points, rtol=0, atol=1e-10, equal_nan=True)
        differs += here.points.shape != away.points.shape or not np.allclose(here.ends, away.ends, atol=1e-3)
    assert differs > 2


def test_a_ball_that_slides_without_turning_throws_the_same_light() -> None:
    class Slides(FixedConvexRedirect, domain="optics"):
        """It does not turn, and nothing makes it."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.touching.clear()
            scene.gravity = 0.0
            scene.speed["mirror_ball/free"] = (0, self.speed, 0, 0, 0, 0)

    run, slid = passed(), simulate_specimen(Slides.make(count=5, pace=1.5), fidelity=DRAFT)
    assert np.ptp(slid.quaternion("mirror_ball/ball"), axis=0).max() < 1e-12
    gap = np.abs(optics.trace(run, "beam01").ends - optics.trace(slid, "beam01").ends).max(axis=1)
    assert np.median(gap) < 1e-7
    assert not failed(slid)


@pytest.mark.parametrize("facets", [64, 512])
def test_facets_that_turn_with_the_ball_are_found_out(monkeypatch: pytest.MonkeyPatch, facets: int) -> None:
    true = Optics._mirror

    def flat(self: Optics, data: Any, geom: int, start: Any, way: Any, normal: Any) -> Any:
        far, facing = true(self, data, geom, start, way, normal)
        if facing is None:
            return far, None
        turn = data.geom_xmat[geom].reshape(3, 3)
        x, y, z = turn.T @ facing
        angle = np.round(np.arctan2(z, y) * facets / (2 * pi)) * 2 * pi / facets
        across = np.hypot(y, z)
        return far, turn @ np.array([x, across * np.cos(angle), across * np.sin(angle)])

    monkeypatch.setattr(Optics, "_mirror", flat)
    assert SEEM in failed(untraced(passed()))


def as_box(run: Run, geom: str) -> Run:
    """The same motion of a mirror that is the box around the true one."""
    model = copy.copy(run.model)
    number = model.geom(geom).id
    model.geom_type[number] = mujoco.mjtGeom.mjGEOM_BOX
    model.geom_size[number] = run.specimen.radius
    model.geom_rbound[number] = 2 * run.specimen.radius
    model.geom_aabb[number] = [0, 0, 0, *(3 * [run.specimen.radius])]
    return replace(run, model=model, _repeats={})


@KINDS
def test_the_box_around_it_is_found_out(mirror: str) -> None:
    run = passed(mirror=mirror)
    boxed = as_box(run, {"ball": "mirror_ball/ball", "column": "mirror_column/column"}[mirror])
    assert failed(boxed) >= {SEEM, TURNED, STRAIGHT}


def test_a_paraxial_fake_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reflected beams that all come from R/2 behind the surface."""
    run = passed()
    middle = run.specimen.middle(run)

    def fake(rays: Rays) -> Rays:
        points = rays.points.copy()
        if points.shape[1] > 2:
            focus = middle - (run.specimen.radius / 2, 0, 0)
            hit = rays.geoms[:, 1] > NO_RAY
            points[hit, 2] = (2 * points[:, 1] - focus)[hit]
        return replace(rays, points=points)

    pretend(monkeypatch, fake)
    assert failed(run) >= {SEEM, TURNED}


@pytest.mark.parametrize("lie", [frozen, late])
def test_beams_that_do_not_follow_the_ball_are_found_out(monkeypatch: pytest.MonkeyPatch, lie: Any) -> None:
    pretend(monkeypatch, lie)
    assert failed(passed()) >= {TURNED, STRAIGHT}


def test_beams_through_the_mirror_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = untraced(passed())
    ignore(monkeypatch, run, "mirror_ball/ball")
    assert STRAIGHT in failed(run)


def test_walls_that_reflect_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = untraced(passed())
    everything_reflects(monkeypatch)
    assert STRAIGHT in failed(run)


def test_spots_at_half_speed_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beams that turn by half the angle, as if the normal alone turned: spots too slow."""
    run = passed()
    straight = np.array([-1.0, 0.0, 0.0])

    def half(rays: Rays) -> Rays:
        points = rays.points.copy()
        if points.shape[1] > 2:
            points[:, 2] = points[:, 1] + (points[:, 2] - points[:, 1]) / 2 + straight
        return replace(rays, points=points)

    pretend(monkeypatch, half)
    assert failed(run) >= {SPOTS, TURNED}


@KINDS
@pytest.mark.parametrize("off", [0.0, 0.3, 0.7071, 0.95, 1 - 1e-9, 1 + 1e-9, 1.01, 1.4])
def test_single_rays(mirror: str, off: float) -> None:
    """Deviation by the cosine of the normal, from the Pythagorean theorem; at the rim it goes to nothing."""
    run = passed(mirror=mirror)
    data = mujoco.MjData(run.model)
    data.qpos[:] = run.qpos[len(run) // 2]
    mujoco.mj_kinematics(run.model, data)
    x, y, z = run.specimen.middle(run)[len(run) // 2]
    r = run.specimen.radius
    ray = Optics(run.model, run.scene).follow(data, (x - 1.5 * r, y + off * r, z), (1, 0, 0), reach=20.0, bounces=9)
    if off > 1:
        assert [run.model.geom(int(g)).name for g in ray.geoms] == ["light_table/east"]
        assert ray.points[-1] == pytest.approx([run.specimen.bench.east, y + off * r, z], abs=1e-12)
        return
    assert len(ray.geoms) == 2
    out = ray.points[2] - ray.points[1]
    cosine = 2 * off**2 - 1  # of twice the angle of incidence, against the way it came
    assert out[0] / np.linalg.norm(out) == pytest.approx(cosine, abs=1e-8)
    if off > 1 - 1e-8:
        assert acos(min(1.0, out[0] / np.linalg.norm(out))) < 2e-4  # grazing: as good as straight on


@KINDS
@pytest.mark.parametrize(
    "values",
    [
        {"radius": 0.05, "count": 15, "fan": 0.95, "pace": 2.0},
        {"radius": 1.0, "count": 3, "fan": 0.1, "pace": 0.3},
        {"radius": 1.0, "count": 15, "fan": 0.1, "pace": 2.0, "friction": 0.1},
    ],
)
def test_extremes(mirror: str, values: dict[str, Any]) -> None:
    run = passed(mirror=mirror, **values)
    assert not failed(run)
    assert not in_each_other_s_way(run)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(FixedConvexRedirect, 30).values()) >= 5
