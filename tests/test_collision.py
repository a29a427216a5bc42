"""What the collision stage reports of two polyhedra, against MuJoCo's distance of the two alone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physinone_mj.collision import Collider
from physinone_mj.contact import Surface

NEVER = np.zeros(1, bool)


def two(*shapes: NDArray[np.float64]) -> tuple[mujoco.MjModel, mujoco.MjData, Collider]:
    """Two free bodies, each the hull of points (n, 3)."""
    spec = mujoco.MjSpec()
    for i, points in enumerate(shapes):
        spec.add_mesh(name=f"m{i}", uservert=points.ravel())
        body = spec.worldbody.add_body(name=f"b{i}")
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"m{i}", name=f"g{i}", density=1e3)
    spec.add_pair(geomname1="g0", geomname2="g1")
    spec.option.gravity = (0.0, 0.0, 0.0)
    model = spec.compile()
    return model, mujoco.MjData(model), Collider(model, [Surface()], ())


def gaps(model: mujoco.MjModel, data: mujoco.MjData, collider: Collider, ahead: float) -> tuple[float, float]:
    """Smallest gap of all contacts, and the distance of the two shapes [m]; both negative where they overlap."""
    collider.reach(1e-3, ahead, NEVER)
    collider.place(data)
    assert data.ncon
    return float(data.contact.dist.min()), mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)


def ball(rng: np.random.Generator) -> NDArray[np.float64]:
    points = rng.normal(size=(12, 3))
    return np.asarray(0.03 * points / np.linalg.norm(points, axis=1, keepdims=True) * rng.uniform(0.5, 1, (12, 1)))


@pytest.mark.parametrize("ahead", [0.01, 0.3, 2.0])
def test_how_far_it_looks_does_not_change_what_it_sees(ahead: float) -> None:
    """MuJoCo makes both shapes larger by that, and its own 35 iterations then see them millimetres away."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        model, data, collider = two(ball(rng), ball(rng))
        data.qpos[3:7], data.qpos[10:14] = (q / np.linalg.norm(q) for q in rng.normal(size=(2, 4)))
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        data.qpos[7:10], wanted = 0.1 * way, rng.uniform(-2e-4, 1e-3)
        for _ in range(6):
            mujoco.mj_kinematics(model, data)
            data.qpos[7:10] += (wanted - mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)) * way
        seen, true = gaps(model, data, collider, ahead)
        assert seen == pytest.approx(true, abs=5e-6)


@pytest.mark.parametrize("tilt", [0.002, 0.01, 0.03])
def test_the_deepest_of_many_contacts_is_seen(tilt: float) -> None:
    """Octagons that lie on each other meet in sixteen points; MuJoCo leaves the four that span the most."""
    angle = np.arange(8) * np.pi / 4
    ring = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    prism = np.vstack([np.column_stack([ring, np.full(8, z)]) for z in (-0.01, 0.01)])
    rng = np.random.default_rng(5)
    lost = 0
    for _ in range(40):
        model, data, collider = two(prism, prism)
        about = rng.uniform(0, 2 * np.pi)
        turn, lean = np.empty(4), np.empty(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0, 1]), rng.uniform(0, 2 * np.pi))
        mujoco.mju_axisAngle2Quat(lean, np.array([np.cos(about), np.sin(about), 0]), tilt)
        mujoco.mju_mulQuat(data.qpos[10:14], lean, turn)
        data.qpos[7:10] = (*rng.uniform(-0.08, 0.08, 2), 0.02 + rng.uniform(-0.5, 0.5) * 0.1 * tilt)
        seen, true = gaps(model, data, collider, 0.05)
        assert seen == pytest.approx(true, abs=5e-6)
        mujoco.mj_collision(model, data)
        lost += data.contact.dist.min() > true + 1e-4
    assert lost or tilt < 0.01, "MuJoCo finds them by itself now"


def test_edges_that_meet_are_not_taken_for_faces() -> None:
    """Thin plates that touch at their rims overlap by less along the plates than across the faces MuJoCo takes."""
    angle = np.arange(5) * 2 * np.pi / 5
    ring = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    plate = np.vstack([np.column_stack([ring, np.full(5, z)]) for z in (-0.003, 0.003)])
    rng = np.random.default_rng(6)
    wrong = turned = 0
    for _ in range(250):
        model, data, collider = two(plate, plate)
        about, way = rng.uniform(0, 2 * np.pi, 2)
        turn, lean = np.empty(4), np.empty(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0, 1]), rng.uniform(0, 2 * np.pi))
        mujoco.mju_axisAngle2Quat(lean, np.array([np.cos(about), np.sin(about), 0]), rng.uniform(0.02, 0.1))
        mujoco.mju_mulQuat(data.qpos[10:14], lean, turn)
        along = np.array([np.cos(way), np.sin(way), 0])
        data.qpos[7:10], wanted = 0.2 * along, rng.uniform(-1e-3, 0)
        for _ in range(6):
            mujoco.mj_kinematics(model, data)
            data.qpos[7:10] += (wanted - mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)) * along
        seen, true = gaps(model, data, collider, 0.01)
        assert true - 1.1e-3 * 0.1 < seen < true + 5e-6
        ends = np.empty(6)
        mujoco.mj_geomDistance(model, data, 0, 1, 1.0, ends)
        normal = data.contact.frame[data.contact.dist.argmin(), :3]
        turned += abs(normal @ (ends[3:] - ends[:3])) < 0.99 * abs(true)
        mujoco.mj_collision(model, data)
        wrong += data.contact.dist.min() < true - 2e-4
    assert not turned
    assert wrong, "MuJoCo takes the right faces by itself now"
