"""Solids in chunks: nothing lost, nothing doubled, and orders that cannot be carried out are refused in one line."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from physinone_mj import fracture
from physinone_mj.contact import Surface
from physinone_mj.fracture import Solid, Uncuttable, box, convex_parts, place, revolved, shatter
from physinone_mj.scene import Scene

BOTTOM = ((0.0, 0.0), (0.08, 0.0), (0.08, 0.015), (0.0, 0.015))
WALL = ((0.065, 0.015), (0.08, 0.015), (0.11, 0.2), (0.095, 0.2))
CASES: list[tuple[Any, tuple[int, ...], dict[str, Any]]] = [
    (box(0.1, 0.06, 0.03), (12,), {}),
    (box(0.15, 0.01, 0.2), (16,), {"grain": (0.0, 1.0, 0.0), "focus": (0.0, 0.0, 0.05)}),
    (box(0.1, 0.1, 0.1), (4, 3), {}),
    (revolved((BOTTOM, WALL), 6), (12,), {}),
]
each_case = pytest.mark.parametrize(("solid", "counts", "how"), CASES, ids=["brick", "plate", "clusters", "pot"])


def hexagon(radius: float) -> float:
    """Area of a regular hexagon of that outer radius [m²]."""
    return 1.5 * math.sqrt(3) * radius**2


@each_case
def test_chunks_fill_the_solid(solid: Any, counts: tuple[int, ...], how: dict[str, Any]) -> None:
    broken = shatter(solid, counts, 3, **how)
    assert len(broken.chunks) == math.prod(counts)
    assert math.fsum(c.whole.volume for c in broken.chunks) == pytest.approx(broken.volume, rel=1e-12)
    pairs = [(a, b) for i, a in enumerate(broken.chunks) for b in broken.chunks[:i]]
    assert max((a.whole.manifold ^ b.whole.manifold).volume() for a, b in pairs) < 1e-12 * broken.volume


@each_case
def test_chunks_are_convex_and_start_apart(solid: Any, counts: tuple[int, ...], how: dict[str, Any]) -> None:
    broken = shatter(solid, counts, 3, **how)
    for chunk in broken.chunks:
        shape = chunk.shape
        assert shape.manifold.hull().volume() == pytest.approx(shape.volume, rel=1e-9)
        assert 0.99 * chunk.whole.volume < shape.volume < chunk.whole.volume
    for meeting in broken.interfaces:
        first, second = (broken.chunks[n].shape.manifold for n in (meeting.first, meeting.second))
        assert first.min_gap(second, 1.0) == pytest.approx(fracture.GAP, rel=1e-6)


@each_case
def test_mass_properties_are_those_of_another_program(
    solid: Any, counts: tuple[int, ...], how: dict[str, Any]
) -> None:
    for chunk in shatter(solid, counts, 3, **how).chunks:
        other = trimesh.Trimesh(chunk.whole.vertices, chunk.whole.faces, process=False)
        assert other.is_watertight
        assert chunk.whole.volume == pytest.approx(other.volume, rel=1e-10)
        assert chunk.whole.centre == pytest.approx(other.center_mass, abs=1e-12)
        inertia = other.moment_inertia
        assert chunk.whole.inertia == pytest.approx(inertia, abs=1e-10 * np.abs(inertia).max())


def test_inertia_of_a_box_is_the_textbook_s() -> None:
    solid = box(0.1, 0.2, 0.3)
    expected = solid.volume / 3 * np.diag([0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04])
    assert solid.inertia == pytest.approx(expected, abs=1e-15)


def test_interfaces_are_all_of_the_inner_surface() -> None:
    # what the chunks' surfaces have beyond the solid's is inside, and counted twice
    for solid, counts, how, outside in (
        (*CASES[0], 8 * (0.1 * 0.06 + 0.06 * 0.03 + 0.03 * 0.1)),
        (*CASES[2], 24 * 0.01),
    ):
        broken = shatter(solid, counts, 1, **how)
        surfaces = sum(trimesh.Trimesh(c.whole.vertices, c.whole.faces, process=False).area for c in broken.chunks)
        assert 2 * sum(i.area for i in broken.interfaces) == pytest.approx(surfaces - outside, rel=1e-5)


def test_pot_is_glued_along_its_corners_and_to_its_bottom() -> None:
    broken = shatter(revolved((BOTTOM, WALL), 6), (7,), 0)
    assert len(broken.chunks) == 7
    ring = hexagon(0.08) - hexagon(0.065)
    upright = [i for i in broken.interfaces if abs(i.normal[2]) > 0.5]
    assert sum(i.area for i in upright) == pytest.approx(ring, rel=1e-9)
    assert len(broken.interfaces) == 12
    # each mitre is a parallelogram, as wide as the wall between its corners
    assert min(i.area for i in broken.interfaces if i not in upright) == pytest.approx(0.015 * 0.185, rel=1e-9)


def test_lever_is_that_of_a_rectangle() -> None:
    half = box(0.05, 0.02, 0.1)
    shift = np.array([0.0, 0.0, 0.1])
    stack = tuple(Solid(half.vertices + side * shift, half.faces) for side in (-1, 1))
    (joint,) = shatter(stack, (2,), 0).interfaces
    assert joint.area == pytest.approx(0.1 * 0.04)
    assert joint.lever == pytest.approx(0.04 / 6)  # section modulus b h²/6, h the shorter side
    assert np.abs(joint.normal) == pytest.approx([0, 0, 1])


def test_clusters_know_when_they_were_parted() -> None:
    broken = shatter(box(0.1, 0.1, 0.1), (4, 3), 0)
    for meeting in broken.interfaces:
        one, two = broken.chunks[meeting.first].path, broken.chunks[meeting.second].path
        assert meeting.depth == (1 if one[1] != two[1] else 2)
    assert {i.depth for i in broken.interfaces} == {1, 2}


def test_cuts_are_finer_towards_the_focus() -> None:
    near, far = [], []
    for seed in range(5):
        chunks = shatter(box(0.2, 0.2, 0.01), (24,), seed, focus=(0.15, 0.15, 0.0), grain=(0.0, 0.0, 1.0)).chunks
        away = [np.hypot(*(c.whole.centre[:2] - 0.15)) for c in chunks]
        near += [c.whole.volume for c, d in zip(chunks, away, strict=True) if d < 0.1]
        far += [c.whole.volume for c, d in zip(chunks, away, strict=True) if d > 0.25]
    assert np.mean(near) < 0.5 * np.mean(far)


def test_cuts_run_through_the_plate() -> None:
    for meeting in shatter(box(0.2, 0.15, 0.01), (12,), 0, grain=(0.0, 0.0, 1.0)).interfaces:
        assert abs(meeting.normal[2]) < 1e-12


def test_same_seed_same_chunks() -> None:
    solids = [Solid(box(0.1, 0.06, 0.03).vertices, box(0.1, 0.06, 0.03).faces) for _ in range(2)]
    one, two = (shatter(solid, (9,), 5) for solid in solids)
    assert all(np.array_equal(a.whole.vertices, b.whole.vertices) for a, b in zip(one.chunks, two.chunks, strict=True))
    other = shatter(solids[0], (9,), 6)
    assert not np.isclose(one.chunks[0].whole.volume, other.chunks[0].whole.volume)


def test_a_solid_that_is_not_convex_is_cut_at_its_inward_edges() -> None:
    large, small = box(0.1, 0.1, 0.1).manifold, box(0.1, 0.1, 0.1).manifold.translate((0.1, 0.1, 0))
    mesh = (large - small).to_mesh64()
    corner = Solid(mesh.vert_properties[:, :3], mesh.tri_verts)
    parts = convex_parts(corner)
    assert len(parts) == 2
    assert sum(p.volume for p in parts) == pytest.approx(0.75 * 8e-3, rel=1e-12)
    broken = shatter(corner, (10,), 0)
    assert math.fsum(c.whole.volume for c in broken.chunks) == pytest.approx(6e-3, rel=1e-12)


def tetrahedron() -> tuple[Any, Any]:
    return np.concatenate([np.zeros((1, 3)), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize(
    ("vertices", "faces", "told"),
    [
        (tetrahedron()[0], tetrahedron()[1][:3], "4 to"),
        (tetrahedron()[0], np.vstack([tetrahedron()[1][:3], [[1, 2, 2]]]), "watertight"),
        (tetrahedron()[0], tetrahedron()[1][:, ::-1], "inside out"),
        (tetrahedron()[0] * np.nan, tetrahedron()[1], "finite"),
        (tetrahedron()[0] * 1e6, tetrahedron()[1], "1000 m"),
        (tetrahedron()[0], tetrahedron()[1] + 1, "vertices other"),
        (tetrahedron()[0], tetrahedron()[1].astype(float), "vertices other"),
        (tetrahedron()[0][:, :2], tetrahedron()[1], "allowed"),
        ("what", "is this", "vertices"),
        (tetrahedron()[0], np.tile(tetrahedron()[1], (6000, 1)), "faces"),
    ],
)
def test_what_is_no_solid_is_refused(vertices: Any, faces: Any, told: str) -> None:
    with pytest.raises(Uncuttable, match=told) as refused:
        Solid(vertices, faces)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("counts", "how"),
    [
        ((), {}), ((1,), {}), ((201,), {}), ((20, 20), {}), ((0, 5), {}), ((-3, -3), {}),
        ((5,), {"seed": -1}), ((5,), {"focus": (math.nan, 0.0, 0.0)}), ((5,), {"grain": (0.0, 0.0, 0.0)}),
        ((5,), {"grain": (1.0, 0.0)}),
    ],
)  # fmt: skip
def test_impossible_orders_are_refused(counts: tuple[int, ...], how: dict[str, Any]) -> None:
    with pytest.raises(Uncuttable, match="allowed"):
        shatter(box(0.1, 0.1, 0.1), counts, **({"seed": 0} | how))


def test_parts_that_overlap_are_refused() -> None:
    with pytest.raises(Uncuttable, match="in common"):
        shatter((box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.11)), (4,), 0)


@pytest.mark.parametrize("sizes", [(0.0, 1.0, 1.0), (math.inf, 1.0, 1.0), (-1.0, 1.0, 1.0)])
def test_boxes_without_size_are_refused(sizes: tuple[float, float, float]) -> None:
    with pytest.raises(Uncuttable, match="allowed"):
        box(*sizes)


@given(
    st.tuples(*[st.floats(0.01, 0.5)] * 3), st.integers(2, 20), st.integers(0, 2**40),
    st.none() | st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.booleans(),
)  # fmt: skip
@settings(max_examples=15, deadline=None)
def test_any_box(sizes: Any, count: int, seed: int, focus: Any, grained: bool) -> None:
    broken = shatter(box(*sizes), (count,), seed, focus=focus, grain=(0.0, 0.0, 1.0) if grained else None)
    assert len(broken.chunks) == count
    assert math.fsum(c.whole.volume for c in broken.chunks) == pytest.approx(broken.volume, rel=1e-11)
    assert len(set(fracture.fragments(broken, np.ones(len(broken.interfaces))))) == 1


def test_in_a_scene_they_stand_as_one() -> None:
    scene, broken = Scene(), shatter(box(0.1, 0.06, 0.03), (8,), 0)
    turn = np.array([0.9, 0.3, -0.2, 0.1]) / np.linalg.norm([0.9, 0.3, -0.2, 0.1])
    labels = place(scene, "brick", broken, density=2000.0, surface=Surface(), stress=1e6, position=(1.0, 2.0, 3.0),
                   quaternion=turn)  # fmt: skip
    assert labels[0] == "brick/chunk00"
    assert len(scene.bonds) == len(broken.interfaces)
    assert len(scene.touching) == 8 * 7 / 2
    model = scene.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-12
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, turn)
    for label, chunk in zip(labels, broken.chunks, strict=True):
        body = model.body(label).id
        assert data.xipos[body] == pytest.approx((1, 2, 3) + matrix.reshape(3, 3) @ chunk.whole.centre, abs=1e-12)
        own = data.ximat[body].reshape(3, 3) @ np.diag(model.body_inertia[body]) @ data.ximat[body].reshape(3, 3).T
        due = 2000 * matrix.reshape(3, 3) @ chunk.whole.inertia @ matrix.reshape(3, 3).T
        assert own == pytest.approx(due, abs=1e-9 * np.abs(due).max())
    assert model.body_mass.sum() == pytest.approx(2000 * broken.volume, rel=1e-12)


def test_what_nothing_breaks_has_no_bonds() -> None:
    scene, broken = Scene(), shatter(box(0.1, 0.06, 0.03), (8,), 0)
    place(scene, "brick", broken, density=2000.0, surface=Surface(), stress=math.inf)
    assert not scene.bonds
    assert len(scene.spec.equalities) == len(broken.interfaces)
    with pytest.raises(Uncuttable, match="allowed"):
        place(scene, "other", broken, density=-1.0, surface=Surface(), stress=1.0)
