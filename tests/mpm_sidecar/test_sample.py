"""Shapes and what fills them: volumes, inertias, evenness, spin, distances, and everything that is refused."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mpm_sidecar import meshes
from mpm_sidecar.sample import closed, fill, inside, overlapping, thickness, volume
from physinone_mj.base import Refusal
from physinone_mj.continuum import Ball, Box, Cylinder, Elastic, Letters, Model, Piece, Shape, Torus
from physinone_mj.run import quaternion_matrix

Array = NDArray[np.float64]
Mesh = trimesh.Trimesh
TURN = (0.8, 0.0, 0.6, 0.0)


def piece(shape: Shape, **more: Any) -> Piece:
    return Piece(**({"name": "it", "material": Elastic(), "shape": shape, "position": (0.0, 0.0, 0.0)} | more))


def filled(shape: Shape, dx: float, per_cell: int = 8, seed: int = 0, **more: Any) -> tuple[Array, Array, float]:
    return fill(piece(shape, **more), dx, per_cell, np.random.default_rng(seed))


def bent(path: Path) -> Model:
    """A mesh that is not convex, not about the origin, and in units of its own: an L, 3 by 1 by 4."""
    floor = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 4), (0, 4)]
    corners = [(x + 7, y, z) for y in (0.0, 1.0) for x, z in floor]
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = caps + [(a + 6, c + 6, b + 6) for a, b, c in caps]
    for i in range(6):
        j = (i + 1) % 6
        faces += [(i, i + 6, j), (j, i + 6, j + 6)]
    mesh = Mesh(corners, faces, process=False)
    mesh.export(path)
    return Model(path, 0.4)


# volume [m³] and moments of inertia of unit density about the middle [m⁵], by formula
BOX, BALL, CYLINDER, TORUS = Box((0.2, 0.15, 0.1)), Ball(0.2), Cylinder(0.2, 0.15), Torus(0.2, 0.08)
SHAPES: list[tuple[Shape, float, tuple[float, float, float]]] = [
    (BOX, 8 * 0.2 * 0.15 * 0.1, ((0.15**2 + 0.1**2) / 3, (0.2**2 + 0.1**2) / 3, (0.2**2 + 0.15**2) / 3)),
    (BALL, 4 / 3 * math.pi * 0.2**3, (0.4 * 0.2**2,) * 3),
    (CYLINDER, math.pi * 0.2**2 * 0.3, ((3 * 0.2**2 + 0.3**2) / 12,) * 2 + (0.2**2 / 2,)),
    (TORUS, 2 * math.pi**2 * 0.2 * 0.08**2, (0.2**2 / 2 + 5 / 8 * 0.08**2,) * 2 + (0.2**2 + 0.75 * 0.08**2,)),
]
"""Moments per mass [m²]."""
by_shape = pytest.mark.parametrize(("shape", "amount", "moments"), SHAPES, ids=lambda s: type(s).__name__)


@by_shape
def test_volumes_and_inertias_are_those_of_the_formulas(
    shape: Shape, amount: float, moments: tuple[float, float, float]
) -> None:
    assert volume(shape) == pytest.approx(amount, rel=1e-12)
    surface = closed(shape)
    meshes.sound(surface, "closed")
    assert surface.volume == pytest.approx(amount, rel=3e-3)
    assert np.diag(surface.moment_inertia) / surface.volume == pytest.approx(moments, rel=4e-3)
    points, _, each = filled(shape, 0.025)
    assert len(points) * each == pytest.approx(amount, rel=1e-12)
    assert len(points) == pytest.approx(8 * amount / 0.025**3, rel=0.04)
    assert points.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-3)
    square = (points**2).mean(axis=0)
    assert square.sum() - square == pytest.approx(moments, rel=8e-3)


@by_shape
def test_inside_is_within_the_surface(shape: Shape, amount: float, moments: tuple[float, float, float]) -> None:
    surface, rng = closed(shape), np.random.default_rng(1)
    points = rng.uniform(*surface.bounds, (40_000, 3))
    mine = inside(shape, points)
    box = np.prod(np.ptp(surface.bounds, axis=0))
    assert mine.mean() * box == pytest.approx(amount, abs=4 * box * 0.5 / math.sqrt(40_000))
    assert (mine != meshes.contains(surface, points)).mean() < 4e-3
    assert inside(shape, surface.vertices * 0.999).mean() > (0.5 if shape is TORUS else 0.99)
    assert not inside(shape, surface.vertices * 1.001 + (0, 0, 1)).any()


@pytest.mark.parametrize("shape", [*(s[0] for s in SHAPES), Letters("R8", 0.4, 0.1)])
def test_a_layer_lies_half_a_spacing_under_the_surface(shape: Shape) -> None:
    points, _, each = filled(shape, thickness(shape) / 5)
    field = meshes.signed_distance_grid(closed(shape), thickness(shape) / 20)
    depth = -field.at(points)[0] / each ** (1 / 3)
    outer = depth[depth < 0.9]
    assert inside(shape, points).all()
    assert depth.min() > 0.15
    assert outer.mean() == pytest.approx(0.48, abs=0.05)
    assert outer.std() < 0.13
    assert np.quantile(outer, 0.99) < 0.85


def weights(offset: Array) -> Array:
    """Quadratic B-spline."""
    far = np.abs(offset)
    return np.where(far < 0.5, 0.75 - far**2, np.where(far < 1.5, 0.5 * (1.5 - far) ** 2, 0.0))


def unevenness(points: Array, each: float, half: float, dx: float, rng: np.random.Generator) -> float:
    """Standard deviation of the density at places two cells and more inside a cube."""
    nodes = rng.uniform(2 * dx - half, half - 2 * dx, (150, 3))
    factors = [weights((nodes[:, k, None] - points[None, :, k]) / dx) for k in range(3)]
    return float((factors[0] * factors[1] * factors[2]).sum(axis=1).std() * each / dx**3)


def peak(points: Array, each: float, half: float) -> float:
    """Of the structure factor about its first ring, along axes and diagonals."""
    window = np.prod(np.cos(np.pi * points / (2 * half)) ** 2, axis=1)
    along = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)], float)
    along /= np.linalg.norm(along, axis=1)[:, None]
    best = 0.0
    for k in np.arange(0.94, 1.2, 0.03):
        wave = (window[:, None] * np.exp(2j * np.pi * k / each ** (1 / 3) * points @ along.T)).sum(axis=0)
        best = max(best, float((np.abs(wave) ** 2).max() / (window**2).sum()))
    return best


@pytest.mark.parametrize("per_cell", [4, 8])
def test_particles_are_even_but_no_lattice(per_cell: int) -> None:
    """A lattice has the evenness and a peak of thousands; random places have no peak and 15 %, jittered ones 4.6 %."""
    half, dx, rng = 0.5, 0.1, np.random.default_rng(5)
    points, _, each = filled(Box((half,) * 3), dx, per_cell)
    assert unevenness(points, each, half, dx, rng) < 0.02 * (8 / per_cell) ** 0.5
    assert peak(points, each, half) < 60
    # the same measures see what is wrong with the others
    line = (np.arange(20) - 9.5) / 20
    lattice = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    assert peak(lattice, 1 / 8000, half) > 1000
    assert unevenness(rng.uniform(-half, half, (8000, 3)), 1 / 8000, half, dx, rng) > 0.1


def test_no_two_particles_are_close() -> None:
    points, _, each = filled(BALL, 0.03)
    gap = np.asarray(cKDTree(points).query(points, k=2)[0])[:, 1]
    assert gap.min() > 0.55 * each ** (1 / 3)


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    one, two, other = filled(BALL, 0.04), filled(BALL, 0.04), filled(BALL, 0.04, seed=1)
    assert (one[0] == two[0]).all() and (one[1] == two[1]).all()  # noqa: PT018
    assert len(one[0]) != len(other[0]) or (one[0] != other[0]).all()


def test_a_piece_moves_and_turns_as_a_rigid_body_where_it_is_put(tmp_path: Path) -> None:
    """An L: its centre of mass is not the middle of its box, about which it is turned and placed."""
    spin, drift, place = np.array([0.3, -1.0, 2.0]), np.array([1.0, 2.0, -0.5]), np.array([3.0, -1.0, 2.0])
    shape = bent(tmp_path / "bent.stl")
    x, v, each = filled(shape, 0.02, position=tuple(place), quaternion=TURN, velocity=tuple(drift), spin=tuple(spin))
    surface = closed(shape)
    turn = quaternion_matrix(np.array([TURN]))[0]
    centre = place + turn @ surface.center_mass
    assert np.linalg.norm(turn @ surface.center_mass) > 0.05
    assert x.mean(axis=0) == pytest.approx(centre, abs=1e-3)
    assert v.mean(axis=0) == pytest.approx(drift, rel=1e-12)
    inertia = turn @ surface.moment_inertia @ turn.T
    turning = each * np.cross(x - x.mean(axis=0), v).sum(axis=0)
    assert turning == pytest.approx(inertia @ spin, rel=0.01, abs=0.01 * np.linalg.norm(inertia @ spin))
    own = (x - place) @ turn
    assert inside(shape, own).all()
    assert own.max(axis=0) == pytest.approx(surface.bounds[1], abs=0.01)


def test_letters_stand_upright_and_read_along_x() -> None:
    """L: its foot is at the bottom, to the right of its stem; b would be a wrong capital."""
    word = Letters("L", 0.2, 0.05)
    surface = closed(word)
    assert surface.bounds[1, 2] == pytest.approx(0.1)
    assert surface.bounds[0, 1:] == pytest.approx([-0.025, -0.1])
    wide = surface.bounds[1, 0]
    probes = [(-wide + 0.018, 0, 0.08), (wide - 0.018, 0, -0.08), (wide - 0.018, 0, 0.08), (0, 0.026, -0.08)]
    assert inside(word, probes).tolist() == [True, True, False, False]
    assert thickness(word) == pytest.approx(0.2 * 0.22 / 1.22)


def test_every_letter_is_a_sound_solid_of_one_piece_and_its_own() -> None:
    seen = {}
    grid = np.stack(
        np.meshgrid(np.linspace(-0.7, 0.7, 200), [0.0], np.linspace(-0.5, 0.5, 100), indexing="ij"), axis=-1
    )
    for letter in "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789":
        shape = Letters(letter, 1.0, 0.2)
        surface = closed(shape)
        meshes.sound(surface, letter)
        holes = 1 - surface.euler_number / 2
        assert holes == {"B": 2, "8": 2}.get(letter, int(letter in "ADOPQR0469")), letter
        assert np.ptp(surface.bounds, axis=0)[1:] == pytest.approx([0.2, 1.0]), letter
        assert surface.volume == pytest.approx(volume(shape), rel=1e-9)
        seen[letter] = inside(shape, grid.reshape(-1, 3))
        assert seen[letter].mean() * 1.4 * 0.2 == pytest.approx(volume(shape), rel=0.06), letter
    drawn = list(seen.values())
    assert all((a != b).mean() > 0.02 for i, a in enumerate(drawn) for b in drawn[:i])


def test_a_word_is_its_letters_apart() -> None:
    word = closed(Letters("NO 1", 1.0, 0.2))
    assert word.volume == pytest.approx(sum(closed(Letters(c, 1.0, 0.2)).volume for c in "NO1"), rel=1e-9)


@pytest.mark.parametrize("kind", meshes.FORMATS)
def test_a_mesh_file_gives_the_solid_in_the_size_asked_for(tmp_path: Path, kind: str) -> None:
    shape = bent(tmp_path / f"bent.{kind}")
    surface = closed(shape)
    assert surface.bounds == pytest.approx(np.array([[-0.15, -0.05, -0.2], [0.15, 0.05, 0.2]]))
    assert volume(shape) == pytest.approx(6 * 0.1**3)
    assert thickness(shape) == pytest.approx(0.1)
    probes = np.array([(-0.1, 0, 0.15), (0.1, 0, -0.15), (0.1, 0, 0.15), (-0.1, 0.06, 0), (0, 0, 0)])
    assert inside(shape, probes).tolist() == [True, True, False, False, False]


def test_a_mesh_that_changed_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "it.stl"
    trimesh.creation.box((1, 1, 1)).export(path)
    assert volume(Model(path, 1.0)) == pytest.approx(1.0)
    trimesh.creation.icosphere(radius=0.5).export(path)
    assert volume(Model(path, 1.0)) < 0.6


def test_a_shell_with_a_cavity_is_a_solid() -> None:
    hollow = trimesh.util.concatenate([trimesh.creation.icosphere(radius=1.0), cavity()])
    meshes.sound(hollow, "hollow")
    assert meshes.contains(hollow, np.array([(0.0, 0, 0), (0, 0.75, 0), (0, 0, 1.5)])).tolist() == [False, True, False]
    assert meshes.thickness(hollow) == pytest.approx(0.5, rel=0.05)


def cavity() -> Mesh:
    inner = trimesh.creation.icosphere(radius=0.5)
    inner.invert()
    return inner


def test_a_mesh_contains_what_lies_over_the_edges_of_its_triangles() -> None:
    """Lines that run through edges and corners count once."""
    line = np.linspace(-1.25, 1.25, 11)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    inner = meshes.contains(trimesh.creation.box((2, 2, 2)), points)
    far = np.abs(points).max(axis=1)
    assert inner[far < 0.99].all()
    assert not inner[far > 1.01].any()
    ball_ = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    inner = meshes.contains(ball_, points)
    far = np.linalg.norm(points, axis=1)
    assert inner[far < 0.95].all()
    assert not inner[far > 1.0].any()


def to_box(p: Array) -> Array:
    q = np.abs(p) - (0.2, 0.3, 0.5)
    return np.asarray(np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0))


def to_ball(p: Array) -> Array:
    return np.asarray(np.linalg.norm(p, axis=-1) - 0.5)


def to_torus(p: Array) -> Array:
    return np.asarray(np.hypot(np.hypot(p[..., 0], p[..., 1]) - 0.4, p[..., 2]) - 0.15)


@pytest.mark.parametrize(
    ("mesh", "distance", "sag"),
    [
        (trimesh.creation.box((0.4, 0.6, 1.0)), to_box, 1e-7),
        (trimesh.creation.icosphere(subdivisions=4, radius=0.5), to_ball, 1e-3),
        (trimesh.creation.torus(0.4, 0.15, major_sections=96, minor_sections=48), to_torus, 8e-4),
    ],
    ids=["box", "ball", "torus"],
)
def test_distances_are_those_of_the_formulas(mesh: Mesh, distance: Callable[[Array], Array], sag: float) -> None:
    """sag: how far the facets lie under the curved surface."""
    place = np.array([0.3, -2.0, 1.0])
    mesh = mesh.copy()
    mesh.apply_translation(place)
    spacing = 1 / 40
    field = meshes.signed_distance_grid(mesh, spacing)
    axes = [field.origin[k] + spacing * np.arange(n) for k, n in enumerate(field.values.shape)]
    truth = distance(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) - place)
    error = field.values - truth
    near = np.abs(truth) < 2.9 * spacing
    assert field.values.dtype == np.float32
    assert field.values.min() < -2 * spacing
    assert np.abs(error[near]).max() < sag
    assert (np.sign(field.values) == np.sign(truth))[np.abs(truth) > sag].all()
    size = np.abs(field.values) - np.abs(truth)
    assert size.min() > -sag
    assert size.max() < spacing
    assert (truth[[0, -1]].min(), truth[:, :, [0, -1]].min()) >= (3.9 * spacing, 3.9 * spacing)
    points = place + np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 3))
    value, slope = field.at(points)
    smooth = np.abs(distance(points - place)) < spacing
    assert value[smooth] == pytest.approx(distance(points - place)[smooth], abs=0.15 * spacing)
    step = 1e-6 * slope[smooth] / np.linalg.norm(slope[smooth], axis=1)[:, None]
    assert np.median(field.at(points[smooth] + step)[0] - value[smooth]) == pytest.approx(1e-6, rel=0.02)


def test_a_field_too_fine_is_refused() -> None:
    with pytest.raises(Refusal, match=r"R10: mesh given: a distance field of .* allowed"):
        meshes.signed_distance_grid(trimesh.creation.box((1, 1, 1)), 1e-3)
    with pytest.raises(ValueError, match="spacing = 0"):
        meshes.signed_distance_grid(trimesh.creation.box((1, 1, 1)), 0.0)


def lidless() -> Mesh:
    box = trimesh.creation.box((1, 1, 1))
    return Mesh(box.vertices, box.faces[box.face_normals[:, 2] < 0.5], process=False)


def bow_tie() -> Mesh:
    """An extruded square of which two corners are swapped: closed, turned alike, and crossing itself."""
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1.3, 1.2), (1, 0), (0, 1))]
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, i + 4), (j, j + 4, i + 4)]
    return Mesh(corners, faces, process=False)


def moebius() -> Mesh:
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    wide = np.array([-0.3, 0.3])[:, None]
    x, y = (1 + wide * np.cos(turn / 2)) * np.cos(turn), (1 + wide * np.cos(turn / 2)) * np.sin(turn)
    corners = np.stack([x, y, wide * np.sin(turn / 2)], axis=-1).transpose(1, 0, 2).reshape(-1, 3)
    faces = []
    for i in range(40):
        a, b = 2 * i, 2 * i + 1
        c, d = (a + 2, b + 2) if i < 39 else (1, 0)
        faces += [(a, c, b), (b, c, d)]
    return Mesh(corners, faces, process=False)


def klein() -> Mesh:
    """A torus whose seam is closed the wrong way round: no edge open, no outside."""
    n = 24
    turn = 2 * np.pi * np.arange(n) / n
    u, v = np.meshgrid(turn, turn, indexing="ij")
    r = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    corners = np.stack([r * np.cos(u), r * np.sin(u), np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)], -1)

    def at(i: int, j: int) -> int:
        return (i % n) * n + (j if i < n else -j) % n

    faces = []
    for i in range(n):
        for j in range(n):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            faces += [(a, b, c), (a, c, d)]
    return Mesh(corners.reshape(-1, 3), faces, process=False)


def inverted() -> Mesh:
    box = trimesh.creation.box((1, 1, 1))
    box.invert()
    return box


def one_turned() -> Mesh:
    box = trimesh.creation.box((1, 1, 1))
    faces = box.faces.copy()
    faces[3] = faces[3][::-1]
    return Mesh(box.vertices, faces, process=False)


def two(first: Mesh, second: Mesh, shift: tuple[float, float, float]) -> Mesh:
    second.apply_translation(shift)
    return trimesh.util.concatenate([first, second])


def ball(radius: float = 1.0) -> Mesh:
    return trimesh.creation.icosphere(subdivisions=2, radius=radius)


def cube() -> Mesh:
    return trimesh.creation.box((1, 1, 1))


def spiked() -> Mesh:
    """One corner of a ball pulled through its other side."""
    it = ball()
    it.vertices[7] = -1.3 * it.vertices[7]
    return it


def flat() -> Mesh:
    return Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2), (2, 1, 0)], process=False)


def not_finite() -> Mesh:
    it = cube()
    it.vertices[2, 1] = np.nan
    return it


WRONG: list[tuple[Callable[[], Mesh], str]] = [
    (lidless, r"is open, 4 of its edges"),
    (moebius, r"is open"),
    (klein, r"not turned alike|crosses itself"),
    (bow_tie, r"crosses itself"),
    (spiked, r"crosses itself"),
    (lambda: two(cube(), ball(0.7), (0.31, 0.2, 0.4)), r"crosses itself"),
    (lambda: two(cube(), cube(), (0.5, 0.5, 0.5)), r"crosses itself"),
    (lambda: two(ball(), ball(0.5), (0, 0, 0)), r"inside another one"),
    (lambda: two(ball(), cavity(), (3, 0, 0)), r"inside out"),
    (inverted, r"inside out"),
    (one_turned, r"not turned alike"),
    (flat, r"no volume"),
    (lambda: Mesh([(0, 0, 0)], np.zeros((0, 3), int), process=False), r"no triangles"),
    (not_finite, r"not finite"),
]


@pytest.mark.parametrize(("mesh", "said"), WRONG, ids=[said[:14] + str(i) for i, (_, said) in enumerate(WRONG)])
def test_what_bounds_no_solid_is_refused(mesh: Callable[[], Mesh], said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=said) as raised:
        meshes.sound(mesh(), "it")
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith("mesh it: ")
    path = tmp_path / "it.obj"
    it = mesh()
    rows = ["v {} {} {}".format(*v) for v in it.vertices] + ["f {} {} {}".format(*(f + 1)) for f in it.faces]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(ValueError, match=r"mesh .*it\.obj: "):
        filled(Model(path, 1.0), 0.1)


def test_two_cubes_along_an_edge_are_refused() -> None:
    """Four triangles at one edge: no telling which belong together."""
    it = two(cube(), cube(), (1, 1, 0))
    it = meshes._welded(np.asarray(it.vertices, float), np.asarray(it.faces, np.int64))
    with pytest.raises(ValueError, match="join more than two"):
        meshes.sound(it, "it")


def stl_that_claims(count: int) -> bytes:
    return b" " * 80 + struct.pack("<I", count) + b"\0" * 50


PLY = b"""ply
format binary_little_endian 1.0
element vertex 10000000000
property float x
property float y
property float z
element face 10000000
property list uchar int vertex_indices
end_header
"""
FILES: list[tuple[str, bytes, str]] = [
    ("claims.stl", stl_that_claims(10_000_000), "not readable|no triangles"),
    ("empty.stl", b"", "not readable|no triangles"),
    ("noise.stl", bytes(range(256)) * 10, "not readable|no triangles"),
    ("claims.ply", PLY, "not readable|no triangles"),
    ("noise.ply", b"ply\nnot so", "not readable|no triangles"),
    ("noise.off", b"OFF\n3 1 0\n0 0 0\n", "not readable|no triangles"),
    ("huge.off", b"OFF\n99999999999 1 0\n0 0 0\n", "not readable|no triangles"),
    ("points.obj", b"v 0 0 0\nv 1 0 0\n", "not readable|no triangles"),
    ("stray.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "not readable|names corner"),
    ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not readable|not finite"),
    ("mesh.pkl", b"", "format 'pkl'; allowed: stl, obj, ply, off"),
    ("mesh.glb", b"glTF", "format 'glb'; allowed"),
    ("mesh", b"solid", "format ''; allowed"),
]


@pytest.mark.parametrize(("name", "data", "said"), FILES, ids=[name for name, _, _ in FILES])
def test_files_that_are_no_mesh_are_refused(tmp_path: Path, name: str, data: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ValueError, match=said) as raised:
        volume(Model(tmp_path / name, 1.0))
    assert "\n" not in str(raised.value)
    assert name in str(raised.value)


def test_files_that_are_not_there_or_too_large_or_no_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="No such file"):
        volume(Model(tmp_path / "none.stl", 1.0))
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(meshes.MOST_BYTES + 1)  # of holes: it takes no room, and no time unless it is read
    with pytest.raises(ValueError, match=r"64\.0 MiB; allowed: 64 MiB"):
        volume(Model(tmp_path / "large.stl", 1.0))
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(ValueError, match="not a plain file"):
        volume(Model(tmp_path / "folder.stl", 1.0))
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    with pytest.raises(ValueError, match="not a plain file"):
        meshes.read(tmp_path / "zero.stl")


def test_nothing_that_a_mesh_points_at_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shape = bent(tmp_path / "it.obj")
    text = shape.path.read_text()
    (tmp_path / "secret.mtl").write_text("newmtl a\nmap_Kd ../secret.png\n")
    shape.path.write_text("mtllib secret.mtl\nmtllib ../../etc/passwd\nusemtl a\n" + text)
    opened: list[str] = []
    genuine = Path.open

    def watched(path: Path, *args: Any, **more: Any) -> Any:
        opened.append(path.name)
        return genuine(path, *args, **more)

    monkeypatch.setattr(Path, "open", watched)
    monkeypatch.setattr("builtins.open", lambda path, *args, **more: opened.append(str(path)))
    assert volume(shape) == pytest.approx(6 * 0.1**3)
    assert opened == ["it.obj"]


def test_a_tangle_is_given_up_before_it_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "_crossing", lambda *_: (-1, -1, meshes._MOST_PAIRS + 1))
    with pytest.raises(ValueError, match="too tangled"):
        meshes.sound(cube(), "it")


def test_too_many_triangles_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 300)
    meshes.sound(trimesh.creation.icosphere(subdivisions=1), "it")
    with pytest.raises(ValueError, match="320 triangles; allowed: 300"):
        meshes.sound(ball(), "it")


def test_too_many_shells_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MOST_SHELLS", 1)
    meshes.sound(cube(), "it")
    with pytest.raises(ValueError, match=r"^mesh it: 2 separate shells; allowed: 1$"):
        meshes.sound(two(cube(), cube(), (3, 0, 0)), "it")


THIN: list[tuple[Shape, float]] = [
    (Box((0.2, 0.2, 0.019)), 0.038),
    (Ball(0.019), 0.038),
    (Cylinder(0.2, 0.019), 0.038),
    (Cylinder(0.019, 0.2), 0.038),
    (Torus(0.2, 0.019), 0.038),
    (Letters("I", 0.2, 0.1), 0.2 * 0.22 / 1.22),
    (Letters("I", 0.4, 0.038), 0.038),
]


@pytest.mark.parametrize(("shape", "thick"), THIN, ids=lambda s: type(s).__name__)
def test_what_is_thinner_than_two_cells_is_refused(shape: Shape, thick: float) -> None:
    assert thickness(shape) == pytest.approx(thick)
    times = f"{2 * 0.02 / thick:.3g}"
    with pytest.raises(Refusal, match=rf"R7: 'it' is {thick:.4g} m thick, .* allowed: 2 cells, .* {times} times"):
        filled(shape, 0.02)
    assert len(filled(shape, thick / 2)[0]) > 20


def test_a_mesh_thin_in_part_is_refused_and_one_with_a_tip_is_not(tmp_path: Path) -> None:
    trimesh.creation.box((1, 1, 0.03)).export(tmp_path / "sheet.stl")
    with pytest.raises(Refusal, match="R7"):
        filled(Model(tmp_path / "sheet.stl", 1.0), 0.02)
    trimesh.creation.cone(0.5, 1.0).export(tmp_path / "cone.stl")
    points, _, each = filled(Model(tmp_path / "cone.stl", 1.0), 0.05)
    assert len(points) * each == pytest.approx(math.pi * 0.25 / 3, rel=0.02)


def test_too_many_particles_are_refused_before_any_is_made() -> None:
    with pytest.raises(Refusal, match=r"R10: 'it' takes 8e\+06 particles"):
        filled(Box((0.5, 0.5, 0.5)), 0.01)
    with pytest.raises(Refusal, match=r"R10"):
        filled(Torus(1000.0, 0.1), 0.1)


@pytest.mark.parametrize("text", ["", "  ", "lower", "A-B", "Ä", "A\n", "X" * 65])
def test_words_that_cannot_be_written_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"text = .*; allowed: "):
        volume(Letters(text, 0.2, 0.1))


def test_other_nonsense_is_refused() -> None:
    with pytest.raises(ValueError, match=r"tube = 0\.2 m of a torus"):
        volume(Torus(0.2, 0.2))
    with pytest.raises(ValueError, match=r"dx = 0"):
        filled(BALL, 0.0)
    with pytest.raises(ValueError, match=r"0 particles in a cell"):
        filled(BALL, 0.1, 0)
    with pytest.raises(ValueError, match=r"allowed: Box"):
        volume("cube")  # type: ignore[arg-type]


def test_pieces_in_each_other_are_refused_and_those_that_touch_are_not() -> None:
    dx = 0.02
    one, two_, above = (filled(Box((0.1, 0.1, 0.1)), dx, seed=s)[0] for s in (0, 1, 2))
    up, away = np.array([0.0, 0.0, 0.2]), np.array([5.0, 0.0, 0.0])
    overlapping({"one": one, "above": above + up, "far": two_ + away}, dx)
    with pytest.raises(Refusal, match=r"R1: 'one' and 'two' lie in each other, about 0\.0[23]\d* m deep"):
        overlapping({"far": above + away, "one": one, "two": two_ + 0.9 * up}, dx)
    inner = filled(Ball(0.05), dx)[0]
    with pytest.raises(Refusal, match=r"'one' and 'inner'"):
        overlapping({"one": one, "inner": inner}, dx)
    with pytest.raises(ValueError, match=r"'none' holds no particle"):
        overlapping({"one": one, "none": np.zeros((0, 3))}, dx)
