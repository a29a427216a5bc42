"""Rays: equal angles, nearest first, mirrors alone reflect, and a beam that is cut off says so."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj.optics import NO_RAY, NOTHING, Optics, Ray, follow
from physinone_mj.scene import Beam, Mirror, Scene

BOX, SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE


def bench(*geoms: tuple[str, Any, Any, Any, Any], mirrors: list[Mirror]) -> tuple[Any, Any, Optics]:
    """A model with one geom a body: (name, shape, size, place, quaternion), its data and its optics."""
    spec = mujoco.MjSpec()
    for name, shape, size, place, quaternion in geoms:
        body = spec.worldbody.add_body(name=name, pos=place, quat=quaternion)
        body.add_geom(name=name, type=shape, size=np.resize(size, 3))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data, Optics(model, mirrors)


def turned(angle: float) -> tuple[float, float, float, float]:
    """About z."""
    return math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)


def plate(name: str, place: Any, angle: float) -> tuple[str, Any, Any, Any, Any]:
    """A square plate whose front face looks along an angle in the plane z = 0."""
    return name, BOX, (0.01, 1.0, 1.0), place, turned(angle)


def front(name: str) -> Mirror:
    return Mirror(name, (0.01, 0.0, 0.0), (1.0, 0.0, 0.0))


def shine(optics: Optics, data: Any, start: Any, way: Any, **how: Any) -> Ray:
    return optics.follow(data, start, np.array(way) / np.linalg.norm(way), **({"reach": 10.0, "bounces": 40} | how))


@pytest.mark.parametrize("incidence", [0.0, 0.3, 1.0, 1.5, math.radians(89.9)])
def test_equal_angles(incidence: float) -> None:
    _, data, optics = bench(plate("mirror", (-0.01, 0, 0), 0.0), mirrors=[front("mirror")])
    way = np.array([-math.cos(incidence), math.sin(incidence), 0.0])
    ray = shine(optics, data, -0.5 * way, way)
    assert ray.points[1] == pytest.approx(np.zeros(3), abs=1e-12)
    out = (ray.points[2] - ray.points[1]) / np.linalg.norm(ray.points[2] - ray.points[1])
    assert out == pytest.approx([math.cos(incidence), math.sin(incidence), 0], abs=1e-12)
    assert list(ray.geoms) == [0, NOTHING]
    assert np.linalg.norm(np.diff(ray.points, axis=0), axis=1).sum() == pytest.approx(10.0)


@pytest.mark.parametrize("angle", [0.2, 0.7, 1.2])
def test_two_mirrors_turn_by_twice_their_angle(angle: float) -> None:
    # the first sends the beam along 0.6 rad, the second stands in its way with this angle of incidence
    facing = 0.6 + math.pi + angle
    place = np.array([math.cos(0.6), math.sin(0.6), 0]) - 0.01 * np.array([math.cos(facing), math.sin(facing), 0])
    geoms = plate("a", (-0.01, 0, 0), 0.0), plate("b", place, facing)
    model, data, optics = bench(*geoms, mirrors=[front("a"), front("b")])
    way = np.array([-math.cos(0.6), math.sin(0.6), 0])
    ray = shine(optics, data, -0.3 * way, way)
    assert [model.geom(int(g)).name for g in ray.geoms[:2]] == ["a", "b"]
    out = (ray.points[3] - ray.points[2]) / np.linalg.norm(ray.points[3] - ray.points[2])
    turn = 2 * facing  # about z, by twice the angle from one normal to the other
    due = (way[0] * math.cos(turn) - way[1] * math.sin(turn), way[0] * math.sin(turn) + way[1] * math.cos(turn), 0)
    assert out == pytest.approx(due, abs=1e-12)


def test_only_mirrors_reflect_and_only_with_their_face() -> None:
    for mirrors, way, met in (([], -1.0, 1), ([front("plate")], -1.0, 2), ([front("plate")], 1.0, 1)):
        _, data, optics = bench(plate("plate", (0, 0, 0), 0.0), mirrors=mirrors)
        ray = shine(optics, data, (-way, 0.1, 0.2), (way, 0.0, 0.0))
        assert len(ray.geoms) == met
    with pytest.raises(KeyError):
        bench(plate("plate", (0, 0, 0), 0.0), mirrors=[front("other")])


def test_the_nearest_is_met_whatever_the_order() -> None:
    far, near = plate("far", (-1.0, 0, 0), 0.0), ("near", SPHERE, (0.1,), (-0.5, 0, 0), turned(0.0))
    for geoms in ((far, near), (near, far)):
        model, data, optics = bench(*geoms, mirrors=[])
        ray = shine(optics, data, (1.0, 0.06, 0.0), (-1, 0, 0))
        assert model.geom(int(ray.geoms[0])).name == "near"
        assert ray.points[1, 0] == pytest.approx(-0.5 + 0.08, abs=1e-12)  # √(0.1² - 0.06²)
        assert model.geom(int(shine(optics, data, (1.0, 0.1001, 0.0), (-1, 0, 0)).geoms[0])).name == "far"


def test_a_ball_reflects_as_a_sphere_not_as_its_box() -> None:
    for height in (0.02, 0.05, 0.09):
        _, data, optics = bench(("ball", SPHERE, (0.1,), (0, 0, 0), turned(1.0)), mirrors=[Mirror("ball")])
        ray = shine(optics, data, (1.0, height, 0.0), (-1, 0, 0))
        out = ray.points[2] - ray.points[1]
        deviation = math.acos(-out[0] / np.linalg.norm(out))
        assert deviation == pytest.approx(math.pi - 2 * math.asin(height / 0.1), abs=1e-9)


def test_parallel_mirrors_and_the_cap() -> None:
    geoms = plate("a", (-0.11, 0, 0), 0.0), plate("b", (0.11, 0, 0), math.pi)
    _, data, optics = bench(*geoms, mirrors=[front("a"), front("b")])
    ray = shine(optics, data, (0.0, -0.95, 0), (1.0, 0.2, 0.0), reach=100.0, bounces=100)
    assert np.diff(ray.points[1:-1, 1]) == pytest.approx(np.full(48, 0.2 * 0.2), abs=1e-11)
    assert not ray.truncated
    straight = shine(optics, data, (0, 0, 0), (1.0, 0.0, 0.0), reach=1e3)
    assert straight.truncated
    assert len(straight.geoms) == 41


def test_a_beam_of_a_scene() -> None:
    scene = Scene()
    scene.spec.worldbody.add_site(name="mouth", pos=(0, 0, 1.0), quat=(0, 1, 0, 0))  # z axis down
    scene.beams.append(Beam("beam", "mouth"))
    wall = scene.spec.worldbody.add_geom(name="haze", type=BOX, size=(1, 1, 0.1), pos=(0, 0, 0.5))
    wall.group = 4
    model = scene.spec.compile()
    rays = follow(model, scene, scene.beams[0], np.zeros((3, 0)))
    assert rays.points == pytest.approx(np.tile([[0, 0, 1.0], [0, 0, 0]], (3, 1, 1)))
    assert [model.geom(int(g)).name for g in rays.geoms[:, 0]] == ["stage/floor"] * 3
    assert rays.ends == pytest.approx(np.zeros((3, 3)))
    assert rays.directions(0) == pytest.approx(np.tile([0, 0, -1.0], (3, 1)))
    assert np.isnan(rays.directions(1)).all()
    assert not rays.truncated.any()
    assert NO_RAY not in rays.geoms


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mirror("a", (0.0, 0.0, 0.0)),
        lambda: Mirror("a", (0.0, 0.0, 0.0), (1.0, 1.0, 0.0)),
        lambda: Beam("a", "b", reach=0.0),
        lambda: Beam("a", "b", radius=math.inf),
        lambda: Beam("a", "b", bounces=-1),
    ],
)
def test_impossible_mirrors_and_beams(make: Any) -> None:
    with pytest.raises(ValueError, match="allowed"):
        make()
