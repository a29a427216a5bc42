"""A concave mirror: fakes that only look right near the axis are told from the sphere."""

from __future__ import annotations

import functools
from dataclasses import replace
from math import pi, radians, sqrt
from typing import Any

import mujoco
import numpy as np
import pytest

from phenomena.dishes import BEHIND
from phenomena.p35_fixed_concave_redirect import FixedConcaveRedirect, vertex_of
from physinone_mj import optics
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import NO_RAY, NOTHING, Optics, Ray, Rays
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Conic, Scene
from physinone_mj.simulate import simulate_specimen

from .rays import frozen, ignore, in_each_other_s_way, late, pretend, untraced
from .verdicts import failed, judge_random, verdicts

FAN = {
    "every_parallel_beam_crosses_the_axis_at_its_own_place",
    "beams_are_reflected_until_there_is_no_silver",
    "reflected_beams_touch_a_nephroid",
}
LAMP = {
    "light_through_the_centre_returns_on_itself",
    "image_distance_obeys_the_mirror_equation",
    "wide_beams_are_turned_by_the_exact_law",
}


class Brief(FixedConcaveRedirect, domain="optics"):
    """Watched just long enough."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.duration = min(scene.duration, 1.0) if self.light == "fan" else scene.duration


@functools.cache
def shone(**values: Any) -> Run:
    return simulate_specimen(Brief.make(**({"count": 5, "pace": 1.0} | values)), fidelity=DRAFT)


def probe(run: Run, start: Any, way: Any, sample: int = 0) -> Ray:
    """A ray in the scene as it is at a sample, from a point in the light's plane [m], along a way there."""
    data = mujoco.MjData(run.model)
    data.qpos[:] = run.qpos[sample]
    mujoco.mj_kinematics(run.model, data)
    direction = np.array([*way, 0.0]) / np.linalg.norm(way)
    begin = np.array([*start, run.specimen.bench.plane])
    return Optics(run.model, run.scene).follow(data, begin, direction, reach=10.0, bounces=40)


def test_true_light_is_right() -> None:
    assert not failed(shone())
    assert set(verdicts(shone()).values()) == {"passed"}


def test_the_beam_at_six_tenths_of_the_radius_crosses_a_quarter_nearer_the_mirror_than_the_focus() -> None:
    """R = 0.5 m, y = 0.3 m: 0.1875 m from the mirror, where a paraxial fake has 0.25 m."""
    run = shone(radius=0.5, tilt=0.0)
    ray = probe(run, (-0.4, 0.3), (1, 0))
    (x0, y0, _), (x1, y1, _) = ray.points[1:3]
    assert 0.5 - (x0 - y0 * (x1 - x0) / (y1 - y0)) == pytest.approx(0.1875, abs=1e-14)


def through_the_focus(rays: Rays, focus: float) -> Rays:
    """Every reflected beam turned so that it crosses the axis at a place [m] beyond the centre."""
    points = rays.points.copy()
    there = np.array([focus, 0.0, 0.0]) + points[:, 1] * (0, 0, 1)
    points[:, 2] = there + (there - points[:, 1])
    return replace(rays, points=points)


def test_a_paraxial_fake_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = shone()
    pretend(monkeypatch, lambda rays: through_the_focus(rays, run.specimen.radius / 2))
    assert failed(run) >= FAN - {"beams_are_reflected_until_there_is_no_silver"}


def test_a_paraxial_lamp_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its image is where the mirror equation says for beams of every width."""
    run = shone(light="lamp")
    s = vertex_of(run) - run.joint("lamp_slide/slide")
    image = vertex_of(run) - 1 / (2 / run.specimen.radius - 1 / s)

    def fake(rays: Rays) -> Rays:
        points = rays.points.copy()
        way = np.column_stack([image, 0 * image, points[:, 1, 2]]) - points[:, 1]
        points[:, 2] = points[:, 1] + way * np.sign(-way[:, :1])
        return replace(rays, points=points)

    pretend(monkeypatch, fake)
    assert failed(run) & LAMP == {"wide_beams_are_turned_by_the_exact_law"}


@pytest.mark.parametrize("facets", [64, 1024])
def test_faceted_normals_are_found_out(monkeypatch: pytest.MonkeyPatch, facets: int) -> None:
    true = optics._meet_conic

    def flat(shape: Any, place: Any, turn: Any, start: Any, way: Any, normal: Any) -> float:
        far = float(true(shape, place, turn, start, way, normal))
        angle = np.round(np.arctan2(normal[1], normal[0]) * facets / (2 * pi)) * 2 * pi / facets
        normal[:2] = np.cos(angle), np.sin(angle)
        return far

    monkeypatch.setattr(optics, "_meet_conic", flat)
    assert failed(untraced(shone())) >= FAN - {"beams_are_reflected_until_there_is_no_silver"} | LAMP - {
        "image_distance_obeys_the_mirror_equation"
    }


def test_a_single_reflection_hard_coded_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = shone()

    def once(rays: Rays) -> Rays:
        geoms = rays.geoms.copy()
        geoms[:, 2:] = NO_RAY
        return replace(rays, geoms=geoms)

    assert run.specimen.reflections(run).max() >= 2
    pretend(monkeypatch, once)
    assert "beams_are_reflected_until_there_is_no_silver" in failed(run)


class Whole(Brief, domain="optics"):
    """Silvered beyond its rim."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        (mirror,) = scene.mirrors
        assert isinstance(mirror, Conic)
        scene.mirrors[:] = [replace(mirror, aperture=0.99 * self.radius)]


def test_beams_beside_the_mirror_are_not_reflected() -> None:
    values: dict[str, Any] = {"aperture": 0.55, "fan": 0.8, "tilt": 0.0}
    run = shone(**values)
    count, _ = run.specimen.due(run.specimen.heights(run))
    assert 0 < np.mean(count == 0) < 1
    assert not failed(run)
    wide = simulate_specimen(Whole.make(count=5, **values), fidelity=DRAFT)
    assert "beams_are_reflected_until_there_is_no_silver" in failed(wide)


@pytest.mark.parametrize("lie", [frozen, late])
def test_beams_that_do_not_follow_the_bar_are_found_out(monkeypatch: pytest.MonkeyPatch, lie: Any) -> None:
    run = shone()
    pretend(monkeypatch, lie)
    assert failed(run) >= {"every_parallel_beam_crosses_the_axis_at_its_own_place"}


def test_light_through_the_mirror_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = untraced(shone())
    ignore(monkeypatch, run, "bent_mirror/silver", "bent_mirror/shell")
    assert failed(run) >= {"beams_are_reflected_until_there_is_no_silver"}


@pytest.mark.parametrize("height", [0.69, 0.72, 0.8, 0.9, 0.94])
def test_a_second_reflection_begins_beyond_the_root_of_a_half(height: float) -> None:
    """Chords that span equal arcs, walked along by steps instead of by a formula."""
    run = shone(aperture=height + 0.005, tilt=0.0)
    r = run.specimen.radius
    ray = probe(run, (-0.5 * r, height * r), (1, 0))
    corners = ray.points[1:-1, :2] / r
    assert np.linalg.norm(corners, axis=1) == pytest.approx(np.ones(len(corners)), abs=1e-14)
    chords = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert chords == pytest.approx(np.full(len(chords), 2 * sqrt(1 - height**2)), abs=1e-13)
    assert (len(corners) > 1) is (height > sqrt(0.5))
    exit_ = ray.points[-1, :2] / r - corners[-1]
    along = -2 * (exit_ @ corners[-1]) / (exit_ @ exit_)
    left = corners[-1] + along * exit_  # where it leaves the circle there is no silver
    assert left[0] < 0 or abs(left[1]) > height + 0.005


@pytest.mark.parametrize("side", [-1, 1])
def test_rim_and_back(side: int) -> None:
    run = shone(tilt=0.0)
    r, silver = run.specimen.radius, run.model.geom("bent_mirror/silver").id
    for just, met in ((1 - 1e-9, True), (1 + 1e-9, False)):
        ray = probe(run, (0.0, side * run.specimen.aperture * r * just), (1, 0))
        assert bool(ray.geoms[0] == silver) is met
    behind = probe(run, (1.08 * r, side * 0.3 * r), (-1, 0))
    assert run.model.geom(int(behind.geoms[0])).name == "bent_mirror/shell"
    assert len(behind.geoms) == 1


def test_a_tilt_about_the_centre_changes_nothing_but_what_the_rim_cuts_off() -> None:
    straight, tilted = (shone(tilt=tilt, fan=0.4) for tilt in (0.0, 0.25))
    for k in range(5):
        a, b = (optics.trace(run, f"beam{k:02d}") for run in (straight, tilted))
        assert np.allclose(a.points[:, :2], b.points[:, :2], rtol=0, atol=1e-12)
        assert np.allclose(a.directions(1), b.directions(1), rtol=0, atol=1e-11)


def test_a_lamp_in_the_focus_sends_parallel_light() -> None:
    run = shone(light="lamp")
    s, way = vertex_of(run) - run.joint("lamp_slide/slide"), optics.trace(run, "beam06").directions(1)
    i = int(np.flatnonzero(way[:-1, 1] * way[1:, 1] < 0)[-1])  # first, in the centre, it is the image that turns over
    there = s[i] - way[i, 1] * (s[i + 1] - s[i]) / (way[i + 1, 1] - way[i, 1])
    assert there == pytest.approx(run.specimen.radius / 2, rel=1e-4)


def test_light_from_the_centre_ends_on_the_lamp() -> None:
    run = shone(light="lamp")
    at = int(np.abs(run.joint("lamp_slide/slide")).argmin())
    bulb = run.model.geom("lamp_slide/bulb").id
    for k in range(5):
        assert list(optics.trace(run, f"beam{k:02d}").geoms[at, 1:2]) == [bulb]


def test_the_picture_is_the_mirror() -> None:
    """Vertices on the declared sphere, normals to its centre, and the shell behind it wherever light looks."""
    run = shone(tilt=0.3)
    model, data = run.model, mujoco.MjData(run.model)
    mujoco.mj_kinematics(model, data)
    r, centre = run.specimen.radius, np.array([0, 0, run.specimen.bench.plane])

    def of(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        geom = model.geom(name)
        mesh = model.mesh(int(geom.dataid[0]))
        turn = data.geom_xmat[geom.id].reshape(3, 3)
        verts = model.mesh_vert[int(mesh.vertadr[0]) : int(mesh.vertadr[0] + mesh.vertnum[0])]
        first, count = model.mesh_normaladr[mesh.id], model.mesh_normalnum[mesh.id]
        normals = model.mesh_normal[first : first + count]
        faces = model.mesh_face[int(mesh.faceadr[0]) : int(mesh.faceadr[0] + mesh.facenum[0])]
        return verts @ turn.T + data.geom_xpos[geom.id] - centre, normals @ turn.T, faces

    points, normals, faces = of("bent_mirror/silver")
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), r), rel=1e-6)
    assert normals == pytest.approx(-points / r, abs=2e-6)
    across = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    assert (np.einsum("fi,fi->f", across, points[faces[:, 0]]) < 0).all()  # seen from the centre
    sag = 1 - np.linalg.norm(points[faces].mean(axis=1), axis=1).min() / r
    assert sag < BEHIND[0] / 4
    shell, _, faces = of("bent_mirror/shell")
    assert np.linalg.norm(shell, axis=1).min() > r * (1 + 0.98 * BEHIND[0])  # at its edges it stays level
    assert np.linalg.norm(shell[faces].mean(axis=1), axis=1).min() > r
    # closed: every edge is shared by two faces, once in either direction
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len({tuple(e) for e in edges}) == len(edges)
    assert {tuple(e) for e in edges} == {tuple(e[::-1]) for e in edges}


def test_the_light_of_path_traced_pictures_has_its_focus_on_the_table() -> None:
    """Rays from the opening, close to its middle line: by way of the mirror to the board, half a radius from it."""
    run = shone(tilt=0.0)
    model, data, r = run.model, mujoco.MjData(run.model), run.specimen.radius
    mujoco.mj_kinematics(model, data)
    (lamp,) = run.scene.lamps
    place, turn = data.site(lamp.site).xpos, data.site(lamp.site).xmat.reshape(3, 3)
    for aside in (-0.05, 0.0, 0.05):
        for up in (-0.9, 0.0, 0.9):
            start = place + turn @ np.array([aside * r, up * lamp.half[1], 0.0])
            ray = Optics(model, run.scene).follow(data, start, turn[:, 2], reach=10 * r, bounces=9)
            assert [model.geom(int(g)).name for g in ray.geoms] == ["bent_mirror/silver", "light_table/board"]
            assert np.linalg.norm(ray.points[-1][:2] - (r / 2, 0)) < 0.06 * r


def test_the_mirror_stands_on_the_table_and_its_back_looks_away() -> None:
    run = shone(tilt=0.2)
    mirror = run.model.body("bent_mirror/mirror")
    assert np.linalg.norm(mirror.pos[:2]) == pytest.approx(run.specimen.radius, rel=1e-12)
    assert quaternion_matrix(mirror.quat[None])[0][:, 0] == pytest.approx([np.cos(0.2), np.sin(0.2), 0], abs=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"radius": 0.2, "aperture": 0.95, "fan": 0.9, "offset": 0.3, "count": 15, "pace": 1.0, "tilt": 0.4},
        {"light": "lamp", "far": 3.5, "near": 0.15, "pace": 1.0, "count": 15, "aperture": 0.95},
        *(
            pytest.param(extreme, marks=pytest.mark.slow)
            for extreme in (
                {"radius": 2.0, "aperture": 0.5, "fan": 0.05, "offset": 0.02, "count": 3, "pace": 0.1, "tilt": -0.4},
                {"light": "lamp", "far": 1.5, "near": 0.45, "pace": 0.1, "tilt": radians(20)},
            )
        ),
    ],
)
def test_extremes(values: dict[str, Any]) -> None:
    run = shone(**values)
    assert not failed(run)
    # distances to the bent shell are those to its hull, in which the lamp's rail ends: 5 cm in a metre from the silver
    assert not [pair for pair in in_each_other_s_way(run) if "shell" not in pair or "board" in pair]
    assert all((optics.trace(run, beam.name).geoms[:, 0] != NOTHING).all() for beam in run.scene.beams)


@pytest.mark.slow
def test_many_random_specimens() -> None:
    assert min(judge_random(FixedConcaveRedirect, 30).values()) >= 5
