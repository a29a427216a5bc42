"""Rays: equal angles, nearest first, mirrors alone reflect, and a beam that is cut off says so."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj import optics as rays_of
from physinone_mj.base import Phenomenon, Refusal
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.optics import NO_RAY, NOTHING, Optics, Ray, follow, refract
from physinone_mj.run import Run
from physinone_mj.scene import OPTICAL, Beam, Conic, Dielectric, Mirror, Scene, free_pose
from physinone_mj.simulate import simulate_specimen

BOX, SPHERE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE


def bench(
    *geoms: tuple[str, Any, Any, Any, Any], mirrors: list[Any] | None = None, glass: dict[str, float] | None = None
) -> tuple[Any, Any, Optics]:
    """A model with one geom and one site a body: (name, shape, size, place, quaternion), its data and its optics."""
    spec = mujoco.MjSpec()
    curved = [mirror.geom for mirror in mirrors or [] if isinstance(mirror, Conic)]
    for name, shape, size, place, quaternion in geoms:
        body = spec.worldbody.add_body(name=name, pos=place, quat=quaternion)
        group = OPTICAL if name in curved else 0
        body.add_geom(name=name, type=shape, size=np.resize(size, 3), group=group)
        body.add_site(name=name)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    transparent = [Dielectric(name, index) for name, index in (glass or {}).items()]
    return model, data, Optics(model, Scene(mirrors=mirrors or [], dielectrics=transparent))


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


@pytest.mark.parametrize("thick", [0.1, 0.3, 0.333, 0.7])
def test_a_mesh_does_not_stop_what_it_reflects(thick: float) -> None:
    """Its vertices are of single precision: at grazing incidence light would start below its own face."""
    spec, turn = mujoco.MjSpec(), np.array([0.3, 0.5, -0.7, 0.2])
    corners = np.array([[-thick, 0.1, 0], *([0, y, z] for y in (-1, 1) for z in (-1, 1))], float)
    spec.add_mesh(name="plate", uservert=corners.ravel())
    body = spec.worldbody.add_body(name="plate", pos=(0.3, 7.1, -3.7), quat=turn)
    body.add_geom(name="plate", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="plate")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    optics = Optics(model, Scene(mirrors=[Mirror("plate", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))]))
    axes = data.xmat[1].reshape(3, 3)
    for side in np.linspace(-0.9, 0.9, 40):
        way = axes @ np.array([-1e-3, math.sqrt(1 - 1e-6), 0])
        ray = shine(optics, data, data.xpos[1] + axes @ np.array([0, side, side / 10]) - 0.5 * way, way)
        assert list(ray.geoms) == [0, NOTHING]
        assert axes[:, 0] @ (ray.points[2] - ray.points[1]) > 0


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


# Curved mirrors


def dish(radius: float, aperture: float, conic: float = 0.0, half_length: float = 0.0, spin: float = 0.9) -> Any:
    """A mirror whose axis is not an axis of the world: (data, optics, point or way in the world of one in its axes)."""
    axis = np.array([0.3, -0.8, 0.52])
    quaternion = np.array([math.cos(spin / 2), *(math.sin(spin / 2) * axis / np.linalg.norm(axis))])
    what = ("dish", SPHERE, (0.01,), (0.4, -0.2, 0.7), quaternion)
    _, data, optics = bench(what, mirrors=[Conic("dish", "dish", radius, aperture, conic, half_length)])
    turn, place = data.site_xmat[0].reshape(3, 3), data.site_xpos[0]

    def world(point: Any) -> np.ndarray:
        return np.asarray(place + turn @ np.array(point, float))

    def along(way: Any) -> np.ndarray:
        return np.asarray(turn @ np.array(way, float))

    def own(points: Any) -> np.ndarray:
        return np.asarray((points - place) @ turn)

    return data, optics, world, along, own


def crossing(points: Any) -> float:
    """z at which the straight through two points comes to ρ = 0, in the plane y = 0."""
    (x0, _, z0), (x1, _, z1) = points
    return float(z0 - x0 * (z1 - z0) / (x1 - x0))


@pytest.mark.parametrize("y", [0.02, 0.3, 0.6, 0.7])
def test_a_sphere_throws_parallel_light_where_it_does(y: float) -> None:
    """R/(2 √(1 - y²/R²)) from the centre, not R/2."""
    data, optics, world, along, own = dish(1.0, 0.705)
    ray = shine(optics, data, world((y, 0, 3.0)), along((0, 0, -1)))
    assert list(ray.geoms) == [0, NOTHING]
    assert crossing(own(ray.points)[1:3]) == pytest.approx(1 - 0.5 / math.sqrt(1 - y**2), abs=2e-13)


def test_a_deep_dish_reflects_again_and_again() -> None:
    """Beyond y = R/√2 the light meets the same bowl again; every time at the same angle."""
    data, optics, world, along, own = dish(0.5, 0.49)
    ray = shine(optics, data, world((0.45, 0, 1.0)), along((0, 0, -1)))
    assert list(ray.geoms) == [0, 0, 0, NOTHING]
    points = own(ray.points)
    centre = np.array([0, 0, 0.5])
    for before, here, after in zip(points, points[1:], points[2:], strict=False):
        normal = (centre - here) / 0.5
        assert np.linalg.norm(centre - here) == pytest.approx(0.5, abs=1e-14)
        cosines = [normal @ (p - here) / np.linalg.norm(p - here) for p in (before, after)]
        assert cosines[0] == pytest.approx(cosines[1], abs=1e-13)


@pytest.mark.parametrize("place", [(0.05, 0.0), (0.4, 0.3), (-0.7, 0.6)])
def test_a_paraboloid_has_one_focus(place: tuple[float, float]) -> None:
    data, optics, world, along, own = dish(0.8, 1.0, conic=-1.0)
    ray = shine(optics, data, world((*place, 3.0)), along((0, 0, -1)))
    points = own(ray.points)
    to, way = points[1], points[2] - points[1]
    assert np.linalg.norm(np.cross(way, np.array([0, 0, 0.4]) - to)) / np.linalg.norm(way) < 1e-13


def test_an_ellipsoid_has_two() -> None:
    """K = -e²: from one focus to the other, the way is 2a long for every ray."""
    a, e = 1.0, 0.6
    data, optics, world, along, own = dish(a * (1 - e**2), 0.75, conic=-(e**2))
    for angle in (0.1, 0.25, 0.4):
        ray = shine(optics, data, world((0, 0, a * (1 + e))), along((math.sin(angle), 0, -math.cos(angle))))
        points = own(ray.points)
        assert crossing(points[1:3]) == pytest.approx(a * (1 - e), abs=2e-13)
        to = np.linalg.norm(points[1] - points[0]) + np.linalg.norm(points[1] - [0, 0, a * (1 - e)])
        assert to == pytest.approx(2 * a, abs=2e-13)


@pytest.mark.parametrize("y", [0.1, 0.5, 0.9])
def test_a_convex_mirror_spreads_light_from_behind(y: float) -> None:
    data, optics, world, along, own = dish(-1.0, 0.95)
    ray = shine(optics, data, world((y, 0, 3.0)), along((0, 0, -1)))
    assert crossing(own(ray.points)[1:3]) == pytest.approx(-1 + 0.5 / math.sqrt(1 - y**2), abs=2e-13)


def test_a_trough_gathers_light_to_a_line() -> None:
    data, optics, world, along, own = dish(0.8, 0.6, conic=-1.0, half_length=0.5)
    ray = shine(optics, data, world((0.3, 0.2, 2.0)), along((0, 0.1, -1)))
    points = own(ray.points)
    part = (0.4 - points[1, 2]) / (points[2, 2] - points[1, 2])
    assert points[1, 0] + part * (points[2, 0] - points[1, 0]) == pytest.approx(0, abs=1e-13)


def test_a_dish_ends_at_its_aperture_and_its_back_is_black() -> None:
    data, optics, world, along, _ = dish(1.0, 0.5)
    assert list(shine(optics, data, world((0.5001, 0, 1)), along((0, 0, -1))).geoms) == [NOTHING]
    assert list(shine(optics, data, world((0.4999, 0, 1)), along((0, 0, -1))).geoms) == [0, NOTHING]
    assert list(shine(optics, data, world((0.4, 0, -1)), along((0, 0, 1))).geoms) == [0]
    # the other half of the sphere is not there
    assert list(shine(optics, data, world((0.1, 0, 5)), along((1, 0, 0))).geoms) == [NOTHING]


def test_a_strip_is_there_only_so_far_up() -> None:
    what = ("dish", SPHERE, (0.01,), (0, 0, 0), turned(0.0))
    _, data, optics = bench(what, mirrors=[Conic("dish", "dish", 1.0, 0.5, strip=0.2)])
    for place, met in (((0.4, 0.19), 2), ((0.4, 0.21), 1), ((0.48, 0.15), 1), ((0.0, -0.19), 2), ((0.0, -0.21), 1)):
        ray = shine(optics, data, (*place, 1.0), (0, 0, -1))
        assert len(ray.geoms) == met, place


# Refraction


def degrees_of(a: Any, b: Any) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(np.dot(a, b)))


@pytest.mark.parametrize("index", [1.1, 1.333, 2.4])
@pytest.mark.parametrize("incidence", [0.0, 0.5, 1.3, math.radians(89.9)])
def test_snell_and_fresnel(index: float, incidence: float) -> None:
    """Both ways through a slab: sines, a parallel shift, and what Fresnel's formulae in angles say is left."""
    _, data, optics = bench(("slab", BOX, (5.0, 5.0, 0.1), (0, 0, 0), turned(0)), glass={"slab": index})
    way = np.array([math.sin(incidence), 0, -math.cos(incidence)])
    ray = shine(optics, data, np.array([0, 0.1, 0.1]) - 0.3 * way, way, reach=100.0)
    assert list(ray.geoms) == [0, 0, NOTHING]
    within = ray.points[2] - ray.points[1]
    bent = math.asin(math.sin(incidence) / index)
    assert degrees_of(within, (0, 0, -1)) == pytest.approx(bent, abs=1e-12)
    out = ray.points[3] - ray.points[2]
    assert degrees_of(out, way) < 1e-12
    shift = np.linalg.norm(np.cross(ray.points[2] - ray.points[0], way))
    assert shift == pytest.approx(0.2 * math.sin(incidence - bent) / math.cos(bent), abs=1e-12)
    if incidence:
        across = (math.sin(incidence - bent) / math.sin(incidence + bent)) ** 2
        along = (math.tan(incidence - bent) / math.tan(incidence + bent)) ** 2
    else:
        across = along = ((index - 1) / (index + 1)) ** 2
    passes = 1 - (across + along) / 2
    assert ray.weights == pytest.approx([1.0, passes, passes**2], rel=1e-10)


def test_brewster_and_the_critical_angle() -> None:
    """At Brewster's angle half of what is thrown back is gone; beyond the critical angle everything is thrown back."""
    n, normal = 1.5, np.array([0, 0, 1.0])
    angle = math.atan(n)
    _, back = refract(np.array([math.sin(angle), 0, -math.cos(angle)]), normal, 1 / n)
    assert back == pytest.approx(((n**2 - 1) / (n**2 + 1)) ** 2 / 2, rel=1e-12)
    critical = math.asin(1 / n)
    for side, total in ((-1e-9, False), (1e-9, True)):
        way = np.array([math.sin(critical + side), 0, -math.cos(critical + side)])
        bent, back = refract(way, normal, n)
        assert (back == 1.0) is total
        assert bool(bent[2] > 0) is total
        assert np.linalg.norm(bent) == pytest.approx(1, abs=1e-12)


def test_light_is_led_along_a_rod() -> None:
    """Total reflection again and again, nothing lost, and out at the end as it came in."""
    _, data, optics = bench(("rod", BOX, (1.0, 0.05, 0.05), (0, 0, 0), turned(0)), glass={"rod": 1.5})
    way = np.array([math.cos(0.4), math.sin(0.4), 0.0])
    ray = shine(optics, data, np.array([-1.0, 0, 0]) - 0.1 * way, way)
    assert len(ray.geoms) > 5
    assert ray.geoms[-1] == NOTHING
    assert np.ptp(ray.weights[1:-1]) == 0.0
    out = ray.points[-1] - ray.points[-2]
    assert out[0] / np.linalg.norm(out) == pytest.approx(math.cos(0.4), abs=1e-12)


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.8, 0.999])
def test_a_sphere_turns_light_by_twice_what_one_surface_does(offset: float) -> None:
    _, data, optics = bench(("ball", SPHERE, (0.2,), (0.3, 0.1, 0), turned(0)), glass={"ball": 1.333})
    ray = shine(optics, data, (2.0, 0.1 + 0.2 * offset, 0.0), (-1, 0, 0))
    assert list(ray.geoms) == [0, 0, NOTHING]
    into = math.asin(offset)
    due = 2 * (into - math.asin(offset / 1.333))
    assert degrees_of(ray.points[3] - ray.points[2], (-1, 0, 0)) == pytest.approx(due, abs=1e-12)


def test_apparent_depth() -> None:
    """Two near sight lines down into water meet at d/n."""
    _, data, optics = bench(("water", BOX, (5.0, 5.0, 0.5), (0, 0, -0.5), turned(0)), glass={"water": 4 / 3})
    lines = []
    for angle in (0.0, 1e-4):
        ray = shine(optics, data, (0, 0, -0.4), (math.sin(angle), 0, math.cos(angle)))  # it starts in the water
        lines.append((ray.points[1], ray.points[2] - ray.points[1]))
    (_, _), (surface, way) = lines
    assert surface[0] / way[0] * way[2] == pytest.approx(0.4 / (4 / 3), rel=1e-7)


def test_one_thing_inside_another() -> None:
    """A bubble, and a stone, in water: the bubble is entered from water's index, the stone ends the beam."""
    water, bubble = ("water", BOX, (1.0,), (0, 0, 0), turned(0)), ("bubble", SPHERE, (0.3,), (0, 0, 0), turned(0))
    stone = ("stone", SPHERE, (0.1,), (-0.7, 0.0, 0), turned(0))
    model, data, optics = bench(water, bubble, stone, glass={"water": 1.33, "bubble": 1.0})
    ray = shine(optics, data, (2.0, 0.15, 0.0), (-1, 0, 0))
    assert [model.geom(int(g)).name for g in ray.geoms[:4]] == ["water", "bubble", "bubble", "water"]
    into = math.asin(0.5)
    assert degrees_of(ray.points[4] - ray.points[3], (-1, 0, 0)) == pytest.approx(
        2 * (math.asin(0.5 * 1.33) - into), abs=1e-12
    )
    ray = shine(optics, data, (2.0, 0.0, 0.0), (-1, 0, 0))
    assert [model.geom(int(g)).name for g in ray.geoms] == ["water", "bubble", "bubble", "stone"]
    total = shine(optics, data, (2.0, 0.28, 0.0), (-1, 0, 0))  # beyond the critical angle of the bubble
    assert [model.geom(int(g)).name for g in total.geoms[:2]] == ["water", "bubble"]
    assert total.weights[2] == total.weights[1]


def test_a_laser_under_water_knows_what_it_is_in() -> None:
    """It enters a glass ball from water's index, and leaves a bubble into water: not from air, and not into it."""
    water, ball = ("water", BOX, (1.0,), (0, 0, 0), turned(0)), ("ball", SPHERE, (0.3,), (0, 0, 0), turned(0))
    stone = ("stone", SPHERE, (0.05,), (0.6, 0.0, 0.0), turned(0))  # in the way of whoever only looks straight on
    for index in (1.5, 1.0):
        _, data, optics = bench(water, ball, stone, glass={"water": 1.333, "ball": index})
        ray = shine(optics, data, (0.5, 0.15, 0.0), (-1, 0, 0))
        bent = math.asin(0.5 * 1.333 / index)
        turned_by = degrees_of(ray.points[2] - ray.points[1], (-1, 0, 0))
        assert turned_by == pytest.approx(abs(bent - math.asin(0.5)), abs=1e-12)
        ray = shine(optics, data, (0.0, 0.0, 0.0), (0.8, 0.6, 0.0))  # from the middle of the ball: straight out of it
        assert degrees_of(ray.points[2] - ray.points[1], (0.8, 0.6, 0.0)) < 1e-12
        due = ((index - 1.333) / (index + 1.333)) ** 2
        assert ray.weights[1] == pytest.approx(1 - due, rel=1e-12)


def test_reversed_light_goes_back_the_same_way() -> None:
    _, data, optics = bench(
        plate("mirror", (-1.0, 0, 0), 0.1), ("ball", SPHERE, (0.3,), (0, 0, 0), turned(0)), mirrors=[front("mirror")],
        glass={"ball": 1.5},
    )  # fmt: skip
    ray = shine(optics, data, (1.0, 0.2, 0.05), (-1, 0, 0), reach=4.0)
    assert len(ray.geoms) >= 4
    back = shine(optics, data, ray.points[-1], ray.points[-2] - ray.points[-1], reach=4.0)
    assert back.points[: len(ray.points) - 1] == pytest.approx(ray.points[:0:-1], abs=1e-11)


def test_dielectrics_are_round_or_boxes() -> None:
    with pytest.raises(ValueError, match="allowed: sphere"):
        bench(("sheet", mujoco.mjtGeom.mjGEOM_PLANE, (1.0,), (0, 0, 0), turned(0)), glass={"sheet": 1.5})
    with pytest.raises(KeyError):
        bench(plate("plate", (0, 0, 0), 0.0), glass={"other": 1.5})


# Beams of a run


class Crossing(Phenomenon, domain="optics"):
    """A ball flies through a beam."""

    def build(self, scene: Scene) -> None:
        world = scene.spec.worldbody
        world.add_site(name="mouth", pos=(0, 0, 1.0), quat=(math.sqrt(0.5), 0, math.sqrt(0.5), 0))  # z axis along x
        world.add_geom(name="wall", type=BOX, size=(0.1, 2, 2), pos=(2, 0, 0), contype=0, conaffinity=0)
        ball = world.add_body(name="ball")
        ball.add_freejoint(name="free")
        ball.add_geom(name="ball", type=SPHERE, size=(0.1, 0, 0), contype=0, conaffinity=0)
        scene.start["free"] = free_pose((1.0, -0.537, 1.06))
        scene.speed["free"] = (0, 2.0, 0, 1.0, 2.0, 3.0)
        scene.beams.append(Beam("beam", "mouth"))
        scene.gravity = 0.0
        scene.resolve(time=0.1, length=0.1, duration=0.5)

    def caption(self, run: Run) -> str:
        return ""


def crossed(fidelity: Fidelity = DRAFT) -> Run:
    return simulate_specimen(Crossing(), fidelity=fidelity)


def test_a_beam_is_cut_for_as_long_as_the_chord_takes() -> None:
    run = crossed()
    instants = rays_of.changes(run, "beam")
    assert [(run.model.geom(c.before[0]).name, run.model.geom(c.after[0]).name) for c in instants] == [
        ("wall", "ball"), ("ball", "wall"),
    ]  # fmt: skip
    half = math.sqrt(0.1**2 - 0.06**2)
    assert [c.time for c in instants] == pytest.approx([(0.537 - half) / 2, (0.537 + half) / 2], abs=1e-12)
    with pytest.raises(KeyError, match="there are: beam"):
        rays_of.changes(run, "other")


def test_what_was_traced_is_kept_but_not_for_another_run() -> None:
    run = crossed()
    assert rays_of.trace(run, "beam") is rays_of.trace(run, "beam")
    assert crossed().traced == {}


class Muzzled(Crossing, domain="optics"):
    """The wall is where the laser is."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        scene.spec.geom("wall").pos = (0.05, 0, 1.0)


def test_a_laser_inside_a_thing_is_refused() -> None:
    with pytest.raises(Refusal, match=r"the beam 'beam' starts inside 'wall'; allowed: outside"):
        simulate_specimen(Muzzled(), fidelity=DRAFT)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mirror("a", (0.0, 0.0, 0.0)),
        lambda: Mirror("a", (0.0, 0.0, 0.0), (1.0, 1.0, 0.0)),
        lambda: Beam("a", "b", reach=0.0),
        lambda: Beam("a", "b", radius=math.inf),
        lambda: Beam("a", "b", bounces=-1),
        lambda: Conic("a", "b", 0.0, 0.1),
        lambda: Conic("a", "b", 1.0, 1.0),
        lambda: Conic("a", "b", -1.0, 0.8, conic=1.0),
        lambda: Conic("a", "b", 1.0, 0.1, half_length=-1.0),
        lambda: Conic("a", "b", 1.0, 0.1, strip=0.0),
        lambda: Dielectric("a", 0.9),
        lambda: Dielectric("a", math.nan),
    ],
)
def test_impossible_mirrors_and_beams(make: Any) -> None:
    with pytest.raises(ValueError, match="allowed"):
        make()
