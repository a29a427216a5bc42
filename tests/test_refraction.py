"""The rays of 64: through the flat surface of a tank from above, from its side and from below, and through a ball.

Expected are the textbooks' formulae in angles (M. Born & E. Wolf, Principles of Optics, §1.5; E. Hecht, Optics, §4.4,
§5.2), never the vectors by which light is traced. The indices are those of liquids: 1.3 to 1.5.
"""

from __future__ import annotations

import functools
from math import acos, asin, atan2, cos, degrees, hypot, pi, radians, sin, sqrt, tan
from typing import Annotated, Any

import mujoco
import numpy as np
import pytest

from phenomena.lasers import shine, standing_mirror
from phenomena.tanks import WATER, tank
from physinone_mj.base import Param, Phenomenon
from physinone_mj.fidelity import DRAFT
from physinone_mj.optics import NOTHING, Optics, Ray, trace
from physinone_mj.run import Run
from physinone_mj.scene import Beam, Dielectric, Motor, Scene
from physinone_mj.simulate import build, compile, simulate_specimen

INDICES = pytest.mark.parametrize("index", [1.30, WATER, 1.42, 1.50])

DEPTH, HALF = 0.3, (0.5, 0.25)
"""Of the water, and half the tank's inside [m]."""

FLOOR = 0.03
"""Height of the tank's floor [m]."""

SURFACE = FLOOR + DEPTH
"""Of the water's surface [m]."""


class FishTank(Phenomenon, domain="optics"):
    """A tank of water with a laser that shines down on it, or from its side."""

    refraction: Annotated[float, Param("1", 1.0, 1.6, "index of the liquid")] = WATER
    incidence: Annotated[float, Param("rad", 0.0, 1.4, "of the beam from above, on the surface")] = 0.8
    rise: Annotated[float, Param("rad", -1.2, 1.2, "of the beam from the side, above the level")] = 0.5
    entry: Annotated[float, Param("m", 0.01, 0.29, "height over the floor at which it comes in from the side")] = 0.1

    def build(self, scene: Scene) -> None:
        scene.fps = 60
        tank(scene, (0, 0, FLOOR), HALF, DEPTH, index=self.refraction)
        down = np.array([sin(self.incidence), 0, -cos(self.incidence)])
        shine(scene, np.array([-0.2, 0.1, SURFACE]) - 0.5 * down, down)
        up = np.array([cos(self.rise), 0, sin(self.rise)])
        side = scene.spec.worldbody.add_site(name="side", pos=np.array([-HALF[0], -0.1, FLOOR + self.entry]) - 0.1 * up,
                                             quat=(cos(self.slant / 2), 0, sin(self.slant / 2), 0))  # fmt: skip
        scene.beams.append(Beam("side", side.name, reach=6.0))
        scene.resolve(time=1.0, length=0.1, duration=0.05)

    @property
    def slant(self) -> float:
        """Of the beam from the side, from the vertical [rad]."""
        return pi / 2 - self.rise

    def caption(self, run: Run) -> str:
        return ""


@functools.cache
def lit(**values: float) -> Run:
    return simulate_specimen(FishTank.make(**values), fidelity=DRAFT)


def names(run: Run, name: str) -> list[str]:
    """What a beam meets, in order."""
    met = trace(run, name).geoms[0]
    return ["" if g == NOTHING else run.model.geom(int(g)).name for g in met if g >= NOTHING]


def pieces(run: Run, name: str) -> np.ndarray:
    """Unit vectors (n, 3) along the pieces of a beam."""
    points = trace(run, name).points[0]
    along = np.diff(points[np.isfinite(points[:, 0])], axis=0)
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def from_vertical(way: Any) -> float:
    """Angle of a direction from the vertical, up or down [rad]."""
    return atan2(hypot(way[0], way[1]), abs(way[2]))


@INDICES
@pytest.mark.parametrize("incidence", [0.0, 0.2, radians(45), radians(80)])
def test_from_above(index: float, incidence: float) -> None:
    """64a: sines, in one plane; the spot on the floor is where the bent beam comes to."""
    run = lit(refraction=index, incidence=incidence)
    assert names(run, "laser") == ["tank/water", "tank/floor"]
    into, within = pieces(run, "laser")
    assert sin(from_vertical(into)) == pytest.approx(index * sin(from_vertical(within)), abs=1e-12)
    assert within[1] == pytest.approx(0.0, abs=1e-13)
    spot = -0.2 + DEPTH * tan(asin(sin(incidence) / index))
    assert trace(run, "laser").ends == pytest.approx(np.tile([spot, 0.1, FLOOR], (len(run), 1)), abs=1e-12)


def test_without_an_index_there_is_no_deviation() -> None:
    run = lit(refraction=1.0, incidence=1.1)
    into, within = pieces(run, "laser")
    assert within == pytest.approx(into, abs=1e-15)
    assert (trace(run, "laser").weights[0] == 1.0).all()


@INDICES
def test_from_the_side_the_surface_is_a_mirror_up_to_an_angle(index: float) -> None:
    """64b: what comes in at the side meets the surface from below beyond the critical angle, if sin² i < n² - 1."""
    critical = asin(sqrt(index**2 - 1)) if index**2 < 2 else pi / 2
    for rise, total in ((critical - 1e-6, True), (critical + 1e-6, False)) if critical < 1.2 else ((1.2, True),):
        run = lit(refraction=index, rise=rise, entry=0.25)
        assert names(run, "side")[:2] == ["tank/water", "tank/water"]
        below, after = pieces(run, "side")[1:3]
        assert from_vertical(below) == pytest.approx(pi / 2 - asin(sin(rise) / index), abs=1e-12)
        assert bool(after[2] < 0) is total
        weights = trace(run, "side").weights[0]
        if total:
            assert weights[2] == weights[1]
            assert from_vertical(after) == pytest.approx(from_vertical(below), abs=1e-12)
            assert after[:2] == pytest.approx(below[:2], abs=1e-12)
        else:
            assert sin(from_vertical(after)) == pytest.approx(index * sin(from_vertical(below)), abs=1e-12)
            assert weights[2] < 0.05 * weights[1]  # so close to it nearly everything is thrown back all the same


@INDICES
@pytest.mark.parametrize("rise", [0.1, -0.15, 0.05])
def test_across_the_tank_the_beam_is_shifted_not_turned(index: float, rise: float) -> None:
    """64c: t sin θ (1 - cos θ/√(n² - sin² θ)), through two parallel panes."""
    run = lit(refraction=index, rise=rise, entry=0.15)
    assert names(run, "side")[:2] == ["tank/water", "tank/water"]
    first, _, last = pieces(run, "side")
    assert last == pytest.approx(first, abs=1e-13)
    points = trace(run, "side").points[0]
    shift = np.linalg.norm(np.cross(points[2] - points[0], first))
    thick = 2 * HALF[0]
    due = thick * abs(sin(rise)) * (1 - cos(rise) / sqrt(index**2 - sin(rise) ** 2))
    assert shift == pytest.approx(due, abs=1e-12)


@INDICES
@pytest.mark.parametrize("incidence", [0.1, 0.7, 1.2])
def test_weights_of_the_beam_into_the_tank(index: float, incidence: float) -> None:
    """Fresnel's amplitudes: what passes is 1 - (r_s² + r_p²)/2, and nothing more is lost in the water."""
    run = lit(refraction=index, incidence=incidence)
    bent = asin(sin(incidence) / index)
    r_s = (cos(incidence) - index * cos(bent)) / (cos(incidence) + index * cos(bent))
    r_p = (index * cos(incidence) - cos(bent)) / (index * cos(incidence) + cos(bent))
    assert trace(run, "laser").weights[0] == pytest.approx([1.0, 1 - (r_s**2 + r_p**2) / 2], rel=1e-12)


def model_of(specimen: Phenomenon) -> tuple[Any, Any, Optics]:
    compiled = compile(specimen, build(specimen), DRAFT)
    data = mujoco.MjData(compiled.model)
    mujoco.mj_kinematics(compiled.model, data)
    return compiled.model, data, Optics(compiled.model, compiled.scene)


def sent(data: Any, optics: Optics, start: Any, way: Any) -> Ray:
    return optics.follow(data, start, np.array(way) / np.linalg.norm(way), reach=10.0, bounces=40)


def test_water_s_critical_angle_is_that_of_the_books() -> None:
    """48.61°, by halving between a ray that gets out and one that does not."""
    _, data, optics = model_of(FishTank.make())
    low, high = 0.7, 1.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        ray = sent(data, optics, (0, 0, FLOOR + 0.1), (sin(middle), 0, cos(middle)))
        low, high = (middle, high) if ray.points[2, 2] > SURFACE else (low, middle)
    assert degrees(low) == pytest.approx(48.61, abs=0.005)


def nearest(a: tuple[Any, Any], b: tuple[Any, Any]) -> np.ndarray:
    """Point of the first straight (place, way) where it is nearest to the second."""
    (p, u), (q, v) = a, b
    across = np.cross(u, v)
    return np.asarray(p + np.cross(q - p, v) @ across / (across @ across) * u)


@INDICES
@pytest.mark.parametrize("seen", [0.0, radians(30), radians(60)])
def test_apparent_depth_of_what_lies_in_water(index: float, seen: float) -> None:
    """64d: bundles from a point under water, drawn back from the air; seen: angle of sight from the vertical.

    Straight down d/n; aslant d tan r/tan i for a bundle that fans aside, d cos³ i/(n cos³ r) for one that fans in the
    plane of incidence. The paraxial d/n would be wrong by a quarter and more at 60°.
    """
    _, data, optics = model_of(FishTank.make(refraction=index))
    place, below = np.array([0.1, 0.0, FLOOR + 0.05]), DEPTH - 0.05
    small, wet = 1e-4, asin(sin(seen) / index)

    def out(polar: float, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
        way = (sin(polar) * cos(azimuth), sin(polar) * sin(azimuth), cos(polar))
        ray = sent(data, optics, place, way)
        return ray.points[1], ray.points[2] - ray.points[1]

    def depth(a: tuple[Any, Any], b: tuple[Any, Any]) -> float:
        return SURFACE - float(nearest(a, b)[2])

    meridional = depth(out(wet - small, 0.0), out(wet + small, 0.0))
    assert meridional == pytest.approx(below * cos(seen) ** 3 / (index * cos(wet) ** 3), rel=1e-6)
    if seen:
        sagittal = depth(out(wet, -small), out(wet, small))
        assert sagittal == pytest.approx(below * tan(wet) / tan(seen), rel=1e-6)
        assert sagittal > meridional
    else:
        assert meridional == pytest.approx(below / index, rel=1e-6)


class Rocking(FishTank, domain="optics"):
    """The water's surface tilts, evenly, as that of a swell would; a beam from straight above."""

    def build(self, scene: Scene) -> None:
        scene.fps = 60
        world = scene.spec.worldbody
        swell = world.add_body(name="swell", pos=(0, 0, 0.5))
        swell.add_joint(name="tilt", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
        swell.add_geom(name="swell", type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.5, 0.3, 0.2), contype=0, conaffinity=0)
        scene.dielectrics.append(Dielectric("swell", self.refraction))
        scene.motors.append(Motor("tilt", ((0.0, 0.4),)))
        scene.speed["tilt"] = 0.4
        shine(scene, (0.02, 0.0, 1.2), (0, 0, -1.0))
        scene.resolve(time=0.5, length=0.1, duration=2.0)


@INDICES
def test_a_slope_of_the_surface_turns_a_beam_from_above(index: float) -> None:
    """64e: by ε - asin(sin ε/n), with the slope of the same sample; a lag of one of them would be seen."""
    run = simulate_specimen(Rocking.make(refraction=index), fidelity=DRAFT)
    slope = run.joint("tilt")
    way = trace(run, "laser").directions(1)
    turned = np.arctan2(way[:, 0], -way[:, 2])
    due = slope - np.arcsin(np.sin(slope) / index)
    assert np.ptp(slope) > 0.7
    assert np.abs(turned) == pytest.approx(due, abs=1e-12)
    assert np.abs(np.abs(turned[1:]) - due[:-1]).max() > 1e-5
    assert (turned[1:] < 0).all()  # towards the normal, which leans to +x: down and to -x


class Sunken(FishTank, domain="optics"):
    """A mirror stands in the tank, facing the side from which the beam comes."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        face = np.array([0.2, -0.1, FLOOR + 0.12])
        standing_mirror(scene, "mirror", face, np.array([-1.0, 0, 0]), (0.05, 0.05), ground=FLOOR)


@INDICES
def test_refracted_reflected_and_refracted_in_this_order(index: float) -> None:
    """In by the pane, off the middle of a mirror under water, and out by the pane, as steep as it came."""
    rise = 0.15
    climb = tan(asin(sin(rise) / index)) * (0.2 + HALF[0])
    run = simulate_specimen(Sunken.make(refraction=index, rise=rise, entry=0.12 - climb), fidelity=DRAFT)
    assert names(run, "side")[:3] == ["tank/water", "mirror/glass", "tank/water"]
    points = trace(run, "side").points[0]
    assert points[2] == pytest.approx([0.2, -0.1, FLOOR + 0.12], abs=1e-12)
    assert points[3] == pytest.approx([-HALF[0], -0.1, FLOOR + 0.12 + climb], abs=1e-12)
    assert pieces(run, "side")[3] == pytest.approx([-cos(rise), 0, sin(rise)], abs=1e-12)


def test_every_way_through_the_tank_can_be_gone_back() -> None:
    """64f: from the end of the beam, reversed, to its beginning, and with as much lost at every surface."""
    _, data, optics = model_of(FishTank.make())
    gone = 0
    for rise, entry in ((0.05, 0.2), (0.3, 0.05), (-0.1, 0.25), (1.15, 0.25)):
        way = np.array([cos(rise), 0.3, sin(rise)])
        there = sent(data, optics, np.array([-HALF[0], -0.1, FLOOR + entry]) - 0.1 * way, way)
        if len(there.points) < 4:
            continue  # it ends in the water
        back = sent(data, optics, there.points[-2] + 0.1 * (there.points[-1] - there.points[-2]),
                    there.points[-2] - there.points[-1])  # fmt: skip
        inner = there.points[1:-1]
        assert back.points[1 : len(inner) + 1] == pytest.approx(inner[::-1], abs=1e-11)
        assert back.weights[len(inner)] == pytest.approx(there.weights[-1], rel=1e-9)
        gone += 1
    assert gone >= 3


@INDICES
def test_a_ball_s_focus_and_how_near_light_comes_to_its_middle(index: float) -> None:
    """Bouguer's invariant, n b' = b; and of light close to the axis the back focus, n R/(2 (n - 1)) from the middle."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.2, 0, 0), pos=(0.1, -0.2, 0.5))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    optics = Optics(model, Scene(dielectrics=[Dielectric("ball", index)]))
    middle = np.array([0.1, -0.2, 0.5])
    for off in (0.02, 0.1, 0.19):
        ray = sent(data, optics, middle + np.array([-1.0, 0.0, off]), (1, 0, 0))
        chord = ray.points[2] - ray.points[1]
        near = np.linalg.norm(np.cross(ray.points[1] - middle, chord)) / np.linalg.norm(chord)
        assert index * near == pytest.approx(off, abs=1e-13)
        assert acos(chord[0] / np.linalg.norm(chord)) == pytest.approx(
            asin(off / 0.2) - asin(off / 0.2 / index), abs=1e-8
        )
    ray = sent(data, optics, middle + np.array([-1.0, 0.0, 1e-5]), (1, 0, 0))
    place, way = ray.points[2] - middle, ray.points[3] - ray.points[2]
    assert place[0] - place[2] / way[2] * way[0] == pytest.approx(index * 0.2 / (2 * (index - 1)), rel=1e-6)
