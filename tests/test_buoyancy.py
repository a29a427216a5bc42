"""Buoyancy: pointwise against its formula, the derivative of its energy, and added mass that is inertia alone."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj.effects import Buoyancy, Float

GRAVITY = 9.0
VOLUME, AREA, DENSITY = 0.02, 0.03, 1.3

MODEL = f"""
<mujoco>
  <option gravity="0 0 -{GRAVITY}" integrator="RK4" timestep="1e-3"/>
  <worldbody>
    <body name="other" pos="2 0 0"><freejoint/><geom size=".1" mass="1"/></body>
    <body name="bag" pos="0 0 1"><freejoint/>
      <geom type="box" size=".1 .05 .03" pos=".02 0 .01" mass="{{mass}}"/>
      <geom type="sphere" size="1e-4" pos="-.03 .01 .08" mass="{{added}}"/>
      <site name="centre" pos="-.03 .01 .08"/>
    </body>
  </worldbody>
</mujoco>
"""


def bag(mass: float = 0.01, added: float = 0.013) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(MODEL.format(mass=mass, added=added))
    return model, mujoco.MjData(model)


def stir(data: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data.qpos[:] = rng.normal(size=14)
    data.qvel[:] = rng.normal(size=12)


def settle(model: Any, data: Any) -> None:
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)


EFFECT = Buoyancy((Float("centre", VOLUME, AREA),), DENSITY)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_its_formula(seed: int) -> None:
    model, data = bag()
    stir(data, seed)
    settle(model, data)
    EFFECT.bind(model)(data)
    spatial = np.empty(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, 0, spatial, 0)
    v = spatial[3:]
    force = np.array([0, 0, 1.5 * DENSITY * VOLUME * GRAVITY]) - DENSITY * AREA / 2 * np.linalg.norm(v) * v
    np.testing.assert_allclose(data.xfrc_applied[2, :3], force, rtol=1e-12)
    torque = np.cross(data.site_xpos[0] - data.xipos[2], force)
    np.testing.assert_allclose(data.xfrc_applied[2, 3:], torque, rtol=1e-11, atol=1e-14)
    assert not data.xfrc_applied[:2].any()


@pytest.mark.parametrize("seed", range(3))
def test_without_drag_it_is_minus_the_gradient_of_its_potential(seed: int) -> None:
    model, data = bag()
    effect = Buoyancy((Float("centre", VOLUME),), DENSITY)
    stir(data, seed)
    settle(model, data)
    effect.bind(model)(data)
    found, step, start = np.zeros(model.nv), 1e-5, data.qpos.copy()
    mujoco.mj_applyFT(model, data, data.xfrc_applied[2, :3], data.xfrc_applied[2, 3:], data.xipos[2], 2, found)
    for dof in range(model.nv):
        energy = []
        for side in (-1, 1):
            data.qpos[:] = start
            mujoco.mj_integratePos(model, data.qpos, np.eye(model.nv)[dof] * side * step, 1.0)
            mujoco.mj_fwdPosition(model, data)
            energy.append(effect.potential(model, data))
        assert -(energy[1] - energy[0]) / (2 * step) == pytest.approx(found[dof], abs=1e-9)


def test_added_mass_is_inertia_without_weight() -> None:
    """A body as heavy as its air hangs still; let go lighter, it starts with (ρV - m) g/(m + C_m ρV)."""
    displaced = DENSITY * VOLUME
    for mass, expected in ((displaced, 0.0), (0.01, (displaced - 0.01) * GRAVITY / (0.01 + 0.5 * displaced))):
        added = EFFECT.added_mass(EFFECT.floats[0])
        assert added == pytest.approx(0.5 * displaced)
        model, data = bag(mass, added)
        # the centre of volume above the centre of mass: no torque
        model.body_ipos[2] = model.site_pos[0] - np.array([0, 0, 0.01])
        model.body_iquat[2] = (1, 0, 0, 0)
        settle(model, data)
        EFFECT.bind(model)(data)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qacc[6:], [0, 0, expected, 0, 0, 0], atol=1e-10)


def test_with_gravity_its_energy_is_that_of_weight_less_lift() -> None:
    """½ (m + C_m ρV) v² + (m - ρV) g z is kept by whatever turns and tumbles, drag apart."""
    effect = Buoyancy((Float("centre", VOLUME),), DENSITY)
    model, data = bag()
    stir(data, 7)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    push = effect.bind(model)

    def passive(_model: Any, state: Any) -> None:
        state.xfrc_applied[:] = 0
        push(state)

    energies = []
    mujoco.set_mjcb_passive(passive)
    try:
        for _ in range(200):
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
            energies.append(data.energy.sum() + effect.potential(model, data))
    finally:
        mujoco.set_mjcb_passive(None)
    assert np.ptp(energies) < 1e-8


@pytest.mark.parametrize("field", ["volume", "drag_area", "added"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_what_floats_is_possible(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        Float(**{"centre": "c", "volume": 1.0, field: value})  # type: ignore[arg-type]


def test_air_has_a_density() -> None:
    with pytest.raises(ValueError, match="density"):
        Buoyancy((), 0.0)


def test_what_is_missing_is_named() -> None:
    with pytest.raises(KeyError, match="no site 'nobody'"):
        Buoyancy((Float("nobody", 1.0),)).bind(bag()[0])
