"""Every effect: pointwise against the equation it states, as the derivative of its energy, and as nothing outside."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physinone_mj.base import Refusal
from physinone_mj.effects import (
    BLUNT,
    FADING,
    LINEAR,
    UNIFORM,
    AirStream,
    Box,
    Drag,
    Magnet,
    Magnets,
    Profile,
    TooClose,
    Wind,
    fan,
)  # fmt: skip
from physinone_mj.scene import Effect, Scene

Array = NDArray[np.float64]

FREE = """
<mujoco>
  <worldbody>
    {bodies}
  </worldbody>
</mujoco>
"""
BALL = '<body name="{name}"><freejoint/><geom type="box" size=".1 .05 .03" pos=".02 0 .01" mass="0.7"/></body>'
BOX = Box(origin=(0.3, -0.2, 1.0), axis=(1.0, 2.0, 0.5), length=1.7, width=0.6, height=0.4)
PROFILES: dict[str, tuple[Profile, Callable[[float], float]]] = {
    "fading": (FADING, lambda u: (1 - u) ** 2),
    "blunt": (BLUNT, lambda u: 1 - u**2),
    "linear": (LINEAR, lambda u: 1 - u),
    "uniform": (UNIFORM, lambda u: 1.0),
}


def free(*names: str) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(FREE.format(bodies="".join(BALL.format(name=n) for n in names)))
    return model, mujoco.MjData(model)


def settle(model: Any, data: Any) -> None:
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)


def pushed(effect: Effect, model: Any, data: Any) -> Array:
    """What the effect adds (nbody, 6) in the present state."""
    settle(model, data)
    data.xfrc_applied[:] = 0
    effect.bind(model)(data)
    return np.array(data.xfrc_applied)


def put(data: Any, body: int, centre: Array, offset: Array) -> None:
    """Place a free body, axes along the world's, by its centre of mass."""
    data.qpos[7 * (body - 1) : 7 * body] = np.concatenate([centre - offset, [1, 0, 0, 0]])


CENTRE = np.array([0.02, 0, 0.01])
AXES = BOX.frame


@pytest.mark.parametrize("name", PROFILES)
def test_wind_is_its_formula(name: str) -> None:
    profile, shape = PROFILES[name]
    model, data = free("leaf")
    wind = Wind(BOX, 3.0, ("leaf",), profile)
    rng = np.random.default_rng(1)
    for _ in range(20):
        u, y, z = rng.uniform((0, -0.3, -0.2), (1, 0.3, 0.2))
        put(data, 1, BOX.origin + np.array([u * BOX.length, y, z]) @ AXES, CENTRE)
        force = pushed(wind, model, data)[1]
        np.testing.assert_allclose(force[:3], 3.0 * shape(u) * np.array([1, 2, 0.5]) / np.sqrt(5.25), rtol=1e-12)
        assert not force[3:].any()
        assert wind.at(u * BOX.length) == pytest.approx(3.0 * shape(u), rel=1e-12)


@pytest.mark.parametrize("name", PROFILES)
def test_wind_force_is_minus_the_gradient_of_its_potential(name: str) -> None:
    model, data = free("leaf")
    wind = Wind(BOX, 3.0, ("leaf",), PROFILES[name][0])
    middle, step = BOX.origin + np.array([0.6, 0.1, -0.1]) @ AXES, 1e-4
    put(data, 1, middle, CENTRE)
    force = pushed(wind, model, data)[1, :3]
    for k, axis in enumerate(np.eye(3)):
        energy = []
        for side in (-step, step):
            put(data, 1, middle + side * axis, CENTRE)
            settle(model, data)
            energy.append(wind.potential(model, data))
        assert -(energy[1] - energy[0]) / (2 * step) == pytest.approx(force[k], abs=1e-8)


@pytest.mark.parametrize("name", PROFILES)
def test_wind_work_is_the_integral_of_its_force(name: str) -> None:
    wind = Wind(BOX, 3.0, (), PROFILES[name][0])
    s = np.linspace(0.2, 1.5, 2001)
    assert wind.work(0.2, 1.5) == pytest.approx(np.trapezoid(wind.at(s), s), rel=1e-6)


FACES = [(face, side) for face in range(3) for side in (-1, 1)]


@pytest.mark.parametrize("effect", [Wind(BOX, 3.0, ("leaf",), UNIFORM), AirStream(BOX, 9.0, 0.1, ("leaf",), UNIFORM)])
@pytest.mark.parametrize(("face", "side"), FACES)
def test_no_wind_a_millimetre_outside(effect: Effect, face: int, side: int) -> None:
    model, data = free("leaf")
    half = np.array([BOX.length, BOX.width, BOX.height]) / 2
    local = np.zeros(3)
    for beyond, blows in ((1e-3, False), (-1e-3, True)):
        local[face] = side * (half[face] + beyond)
        put(data, 1, BOX.origin + (local + np.array([half[0], 0, 0])) @ AXES, CENTRE)
        assert pushed(effect, model, data)[1].any() == blows


def test_a_wind_with_an_edge_counts_the_immersed_part_of_a_ball() -> None:
    """Against the cap's volume π h² (3 R - h)/3, on both sides of every lateral face."""
    edge = 0.12
    box = dataclasses.replace(BOX, edge=edge)
    model, data = free("leaf")
    wind = Wind(box, 3.0, ("leaf",), UNIFORM)
    half = np.array([box.length, box.width, box.height]) / 2
    for face, side in itertools.product((1, 2), (-1, 1)):
        local = np.zeros(3)
        for deep in np.linspace(-0.08, 0.08, 17):
            local[face] = side * (half[face] - deep)
            put(data, 1, box.origin + (local + np.array([half[0], 0, 0])) @ AXES, CENTRE)
            cap = np.clip(edge / 2 + deep, 0, edge)
            part = cap**2 * (3 * edge / 2 - cap) / (4 * (edge / 2) ** 3)
            assert pushed(wind, model, data)[1, :3] @ AXES[0] == pytest.approx(3.0 * part, abs=1e-12)


@pytest.mark.parametrize("edge", [-0.01, 0.41, np.nan])
def test_an_edge_fits_into_its_box(edge: float) -> None:
    with pytest.raises(ValueError, match="edge"):
        dataclasses.replace(BOX, edge=edge)


def test_drag_is_its_formula() -> None:
    model, data = free("other", "leaf")
    rng = np.random.default_rng(5)
    for _ in range(5):
        put(data, 2, rng.normal(size=3), CENTRE)
        data.qvel[6:] = rng.normal(size=6)
        force = pushed(Drag(0.3, ("leaf",)), model, data)
        centre_speed = data.qvel[6:9] + np.cross(data.qvel[9:], CENTRE)  # axes along the world's
        np.testing.assert_allclose(force[2, :3], -0.3 * centre_speed, rtol=1e-12)
        assert not force[1].any()
        assert not force[2, 3:].any()
    with pytest.raises(ValueError, match="coefficient"):
        Drag(-0.1, ("leaf",))


def test_box_axes_and_distances() -> None:
    np.testing.assert_allclose(AXES @ AXES.T, np.eye(3), atol=1e-15)
    assert AXES[1, 2] == 0  # the width is horizontal
    up = Box((0, 0, 0), (0, 0, 2), 1, 1, 1)
    np.testing.assert_allclose(up.frame, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(up.distance([[0, 0, 0.3], [0.6, 0, 0.3], [0, 0, -0.1]]), [0.3, np.nan, np.nan])


@pytest.mark.parametrize("field", ["length", "width", "height"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_box_has_a_size(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        Box(**{"origin": (0, 0, 0), "axis": (1, 0, 0), "length": 1, "width": 1, "height": 1, field: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", PROFILES)
def test_stream_is_its_formula(name: str) -> None:
    profile, shape = PROFILES[name]
    model, data = free("other", "leaf")
    stream = AirStream(BOX, 8.0, 0.03, ("leaf",), profile, density=1.2)
    rng = np.random.default_rng(2)
    for _ in range(10):
        u = rng.uniform()
        put(data, 2, BOX.origin + u * BOX.length * AXES[0], CENTRE)
        data.qvel[6:9], data.qvel[9:] = rng.normal(size=3) * 5, rng.normal(size=3) * 9
        force = pushed(stream, model, data)
        centre_speed = data.qvel[6:9] + np.cross(data.qvel[9:], CENTRE)  # axes along the world's
        relative = 8.0 * shape(u) * AXES[0] - centre_speed
        expected = 0.5 * 1.2 * 0.03 * np.linalg.norm(relative) * relative
        np.testing.assert_allclose(force[2, :3], expected, rtol=1e-12)
        assert not force[1].any()
        assert not force[2, 3:].any()


def test_stream_pushes_a_body_at_rest_as_the_fading_force_does() -> None:
    model, data = free("leaf")
    stream = AirStream(BOX, 8.0, 0.03, ("leaf",))
    wind = Wind(BOX, stream.drag * 64, ("leaf",))
    put(data, 1, BOX.origin + 0.4 * AXES[0], CENTRE)
    np.testing.assert_allclose(pushed(stream, model, data), pushed(wind, model, data), rtol=1e-13)


BAR = """
<body name="{name}" pos="{x} 0 1">{joint}
  <geom name="{name}/bar" type="box" size=".05 .012 .012" mass="0.1"/>
  <site name="{name}/N" pos=".04 0 0"/><site name="{name}/S" pos="-.04 0 0"/>
</body>
"""


def bars(count: int, *, fixed: int = 0, pairs: str = "") -> tuple[Any, Any]:
    bodies = "".join(
        BAR.format(name="abcd"[i], x=0.3 * i, joint="" if i < fixed else "<freejoint/>") for i in range(count)
    )
    model = mujoco.MjModel.from_xml_string(FREE.format(bodies=bodies).replace("</mujoco>", pairs + "</mujoco>"))
    return model, mujoco.MjData(model)


def magnets(*strengths: float, core: float = 0.01) -> Magnets:
    return Magnets(tuple(Magnet(f"{n}/N", f"{n}/S", k) for n, k in zip("abcd", strengths, strict=False)), core)


def scatter(data: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for i in range(len(data.qpos) // 7):
        turn = rng.normal(size=4)
        data.qpos[7 * i : 7 * i + 7] = [*(rng.normal(size=3) * 0.05 + [0.25 * i, 0, 1]), *turn / np.linalg.norm(turn)]


def test_magnets_are_their_formula() -> None:
    model, data = bars(3)
    effect = magnets(1e-3, 4e-3, 2e-3)
    scatter(data, 3)
    found = pushed(effect, model, data)
    expected = np.zeros((4, 6))
    poles = [(body, sign, data.site(f"{'abc'[body - 1]}/{'N' if sign > 0 else 'S'}").xpos, k)
             for body, k in ((1, 1e-3), (2, 4e-3), (3, 2e-3)) for sign in (1, -1)]  # fmt: skip
    for (a, qa, xa, ka), (b, qb, xb, kb) in itertools.permutations(poles, 2):
        if a != b:
            force = qa * qb * np.sqrt(ka * kb) * (xa - xb) / np.linalg.norm(xa - xb) ** 3
            expected[a] += np.concatenate([force, np.cross(xa - data.xipos[a], force)])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


def test_coaxial_magnets() -> None:
    """Catalogue 13a: k [1/g² + 1/(g + 2ℓ)² - 2/(g + ℓ)²], g between the facing poles."""
    model, data = bars(2)
    force = pushed(magnets(2e-3, 2e-3), model, data)
    g, pole = 0.3 - 0.08, 0.08
    attraction = 2e-3 * (1 / g**2 + 1 / (g + 2 * pole) ** 2 - 2 / (g + pole) ** 2)
    assert force[1, 0] == pytest.approx(attraction, rel=1e-12)
    assert force[2, 0] == pytest.approx(-attraction, rel=1e-12)
    # turned round, it is repelled by as much
    data.qpos[10:14] = [0, 0, 0, 1]
    assert pushed(magnets(2e-3, 2e-3), model, data)[1, 0] == pytest.approx(-attraction, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_magnets_keep_momentum_and_angular_momentum(seed: int) -> None:
    model, data = bars(4)
    scatter(data, seed)
    found = pushed(magnets(1e-3, 4e-3, 2e-3, 5e-4), model, data)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found[1:, :3].sum(axis=0), 0, atol=1e-14 * scale)
    moments = found[1:, 3:] + np.cross(data.xipos[1:], found[1:, :3])
    np.testing.assert_allclose(moments.sum(axis=0), 0, atol=1e-13 * scale)


@pytest.mark.parametrize("seed", range(3))
def test_magnetic_force_and_torque_are_minus_the_gradient_of_the_potential(seed: int) -> None:
    model, data = bars(3)
    scatter(data, seed)
    effect = magnets(1e-3, 4e-3, 2e-3)
    generalised = np.zeros(model.nv)
    found = pushed(effect, model, data)
    for body in range(1, 4):
        mujoco.mj_applyFT(model, data, found[body, :3], found[body, 3:], data.xipos[body], body, generalised)
    start, step = data.qpos.copy(), 1e-5
    for dof in range(model.nv):
        energy = []
        for side in (-1, 1):
            data.qpos[:] = start
            mujoco.mj_integratePos(model, data.qpos, np.eye(model.nv)[dof] * side * step, 1.0)
            mujoco.mj_fwdPosition(model, data)
            energy.append(effect.potential(model, data))
        assert -(energy[1] - energy[0]) / (2 * step) == pytest.approx(generalised[dof], rel=1e-6, abs=1e-8)


def test_a_fixed_magnet_feels_the_reaction_too() -> None:
    model, data = bars(2, fixed=1)
    found = pushed(magnets(1e-3, 1e-3), model, data)
    np.testing.assert_allclose(found[1, :3], -found[2, :3])
    assert found[1].any()


def test_poles_of_one_body_do_not_feel_each_other() -> None:
    model, data = bars(1)
    both = Magnets((Magnet("a/N", "a/S", 1.0), Magnet("a/S", "a/N", 1.0)), 0.001)
    assert not pushed(both, model, data).any()
    assert both.potential(model, data) == 0


TOUCHING = '<contact><pair geom1="a/bar" geom2="b/bar"/></contact>'


def test_poles_within_the_core_are_refused() -> None:
    """The poles are 1 cm deep: two of them come as near as 2 cm when the bars touch."""
    model, _ = bars(2, pairs=TOUCHING)
    magnets(1e-3, 1e-3, core=0.02).bind(model)
    with pytest.raises(Refusal, match=r"R5: poles a/N and b/N lie 0.02 m apart .* allowed: 0.021 m"):
        magnets(1e-3, 1e-3, core=0.021).bind(model)


def test_poles_that_reach_the_core_break_the_run_off() -> None:
    model, data = bars(2)
    effect = magnets(1e-3, 1e-3, core=0.01)
    data.qpos[7] = 0.0855
    assert pushed(effect, model, data).any()
    data.qpos[7] = 0.0845
    with pytest.raises(TooClose, match=r"within 0\.0045 m, less than half of 0\.01 m"):
        pushed(effect, model, data)


@pytest.mark.parametrize(
    ("effect", "missing"),
    [
        (Wind(BOX, 1.0, ("leaf", "nobody")), "no body 'nobody'"),
        (AirStream(BOX, 1.0, 0.1, ("nobody",)), "no body 'nobody'"),
        (Magnets((Magnet("leaf", "x", 1.0),), 0.1), "no site 'leaf'"),
    ],
)
def test_what_is_missing_is_named(effect: Effect, missing: str) -> None:
    with pytest.raises(KeyError, match=missing):
        effect.bind(free("leaf")[0])


def test_a_bound_effect_keeps_no_state() -> None:
    """The same state gives the same force to the last bit, whatever was asked before."""
    model, data = bars(2)
    push = magnets(1e-3, 1e-3).bind(model)
    once = []
    for x in (0.3, 0.2, 0.3):
        data.qpos[7] = x
        settle(model, data)
        data.xfrc_applied[:] = 0
        push(data)
        once.append(data.xfrc_applied.copy())
    assert np.array_equal(once[0], once[2])
    assert not np.array_equal(once[0], once[1])


def test_a_fan_stands_on_the_ground_and_shows_its_air() -> None:
    scene = Scene()
    box = Box((0.5, 1.0, 0.4), (0.0, -1.0, 0.0), 2.0, 0.5, 0.8)
    fan(scene, box)
    model = scene.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("fan/fan").xpos, box.origin)
    air = model.geom("fan/air")
    assert air.group[0] == 4
    np.testing.assert_allclose(data.geom("fan/air").xpos, [0.5, 0.0, 0.4], atol=1e-12)
    np.testing.assert_allclose(air.size, [1.0, 0.25, 0.4])
    for i in range(9):
        assert np.isfinite(box.distance(data.geom(f"fan/streak{i}").xpos))
    lowest = min(data.geom(f"fan/{s}_foot").xpos[2] - model.geom(f"fan/{s}_foot").size[2] for s in ("left", "right"))
    assert lowest == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="horizontal"):
        fan(Scene(), Box((0, 0, 0), (0, 0, 1), 1, 1, 1))
