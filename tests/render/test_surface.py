"""Surfaces of particles where their matter is, however it is cut up, and pictures of them."""

import dataclasses
import math
import time

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree

from render import film
from render.film import Footage, shoot, swept_sphere
from render.photoreal import Look, Studio
from render.raster import Raster, Still
from render.rig import FOV, Sphere, back_project, fit_distance, orbit, project
from render.surface import FINISHES, Field, Particles

from .sets import CROWD, pendulum, staged
from .test_film import files, two_views

S = 0.01
TURN = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
TURN *= np.linalg.det(TURN)
PLACE = np.array([0.0123, -0.0456, 0.3])


def lattice(*counts):
    """Particles (n, 3) [spacing] that fill a box from 0 to its counts."""
    lines = [np.arange(count) + 0.5 for count in counts]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


def scattered(count, seed=0):
    """Particles (n, 3) [spacing] in a cube with `count` along each edge, one somewhere in each cell."""
    return lattice(count, count, count) + np.random.default_rng(seed).uniform(-0.3, 0.3, (count**3, 3))


def surface(cells, gradient=None):
    """Of particles (n, 3) [spacing], turned and put somewhere, seen in their own axes: points and normals (N, 3)
    [spacing], triangles."""
    turned = None if gradient is None else TURN @ gradient
    field = Field.of(S * cells @ TURN.T + PLACE, np.full(len(cells), S**3), S, turned)
    mesh = field.surface()
    return (mesh.points - PLACE) @ TURN / S, mesh.normals @ TURN, mesh.triangles


def volume(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def euler(points, triangles):
    """2 for each ball."""
    edges = {tuple(sorted(pair)) for t in triangles.tolist() for pair in zip(t, t[1:] + t[:1], strict=True)}
    return len(points) - len(edges) + len(triangles)


def piece(position, look="clay", rgba=(0.8, 0.3, 0.2, 1.0), **changes):
    position = np.asarray(position, np.float32)
    frames, count = position.shape[:2]
    given = {"stretch": np.ones((frames, count), np.float32), "present": np.full(frames, count), "bulk": S**3}
    return Particles(position, **{**given, "look": look, "rgba": rgba, "segmentation": 7, **changes})


def ball(cells=9.0, *shift):
    """Particles (n, 3) [m] that fill a ball of so many spacings, about PLACE or elsewhere."""
    inside = lattice(24, 24, 24) - 12
    return S * inside[np.linalg.norm(inside, axis=1) < cells] + PLACE + np.array(shift or (0.0, 0.0, 0.0))


# where it is


def test_a_cube_has_its_faces_its_edges_and_its_volume():
    count = 24
    points, normals, triangles = surface(lattice(count, count, count))
    assert volume(points, triangles) == pytest.approx(count**3, rel=2e-3)
    off = points - np.clip(points, 0, count)
    aside = np.sort(np.abs(points - count / 2), axis=1)  # the farthest axis is that of the face
    middle = aside[:, 1] < count / 2 - 4
    assert middle.sum() > 2000
    assert np.abs(aside[middle, 2] - count / 2).max() < 0.1
    assert np.ptp(aside[middle, 2]) < 0.02  # flat
    assert np.abs(normals[middle]).max(axis=1).min() > math.cos(math.radians(2))
    assert np.linalg.norm(off, axis=1).max() < 0.1
    lacking = count / 2 - aside
    assert np.linalg.norm(lacking[:, 1:], axis=1).min() < 0.7  # edges
    assert np.linalg.norm(lacking, axis=1).min() < 1.3  # corners


def test_it_is_closed_and_faces_outwards():
    points, normals, triangles = surface(scattered(8))
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = (np.unique(e @ [1 << 32, 1], return_counts=True) for e in (edges, edges[:, ::-1]))
    assert all(np.array_equal(a, b) for a, b in zip(there, back, strict=True))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    across = np.cross(b - a, c - a)
    large = np.linalg.norm(across, axis=1) > 0.05
    facing = np.einsum("ij,ij->i", across, normals[triangles].mean(axis=1)) / np.linalg.norm(across, axis=1)
    assert facing[large].min() > 0.7
    assert volume(points, triangles) > 0


def test_particles_out_of_order_do_not_make_it_bumpy():
    """No face of a cube whose particles lie anywhere in their cells is off by more than a third of a spacing."""
    count = 16
    points, normals, _ = surface(scattered(count))
    aside = np.sort(np.abs(points - count / 2), axis=1)
    middle = aside[:, 1] < count / 2 - 3
    assert np.abs(aside[middle, 2] - count / 2).max() < 0.35
    assert np.sqrt(np.mean((aside[middle, 2] - aside[middle, 2].mean()) ** 2)) < 0.1
    assert np.median(np.abs(normals[middle]).max(axis=1)) > math.cos(math.radians(10))


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_a_film_is_whole_and_as_thick_as_it_is(layers):
    points, _, triangles = surface(lattice(30, 30, layers))
    assert euler(points, triangles) == 2  # no hole, nothing apart
    middle = (np.abs(points[:, :2] - 15) < 11).all(axis=1)
    assert np.ptp(points[middle, 2]) == pytest.approx(layers, rel=0.2)
    assert points[middle, 2].mean() == pytest.approx(layers / 2, abs=0.02)


@pytest.mark.parametrize(("counts", "rel"), [((30, 1, 1), 0.05), ((30, 3, 3), 0.05), ((1, 1, 1), 0.05)])
def test_threads_and_drops_do_not_vanish(counts, rel):
    points, _, triangles = surface(lattice(*counts))
    assert euler(points, triangles) == 2
    assert volume(points, triangles) == pytest.approx(math.prod(counts), rel=rel)


def test_what_is_drawn_out_stays_smooth():
    """A slab flattened to a ninth, so that its columns of particles are three spacings apart."""
    flattened = np.diag([3.0, 3.0, 1 / 9])
    cells = lattice(16, 16, 27) @ flattened
    gradient = np.tile(flattened, (len(cells), 1, 1))

    def bumps(given):
        points, _, triangles = surface(cells, given)
        top = (np.abs(points[:, :2] - 24) < 12).all(axis=1) & (points[:, 2] > 1.5)
        return np.ptp(points[top, 2]), points[top, 2].mean(), volume(points, triangles)

    rough, smooth = bumps(None), bumps(gradient)
    assert smooth[0] < 0.1 < rough[0]
    assert smooth[1] == pytest.approx(3, abs=0.15)
    assert smooth[2] == pytest.approx(len(cells), rel=0.02)


def test_neighbours_at_the_start_tell_how_matter_is_drawn_out():
    """Turned, sheared and stretched at once; what is torn off does not drag the others along."""
    rest = S * lattice(8, 8, 8)
    strain = np.array([[1.6, 0.4, 0], [0, 0.9, 0], [0, 0.2, 0.7]])
    moved = rest @ (TURN @ strain).T
    moved[:256] += 5.0
    own = piece([rest, moved])
    gradient = own._field(1)[1]
    assert np.abs(gradient - TURN @ strain).max() < 0.06
    whole = lattice(8, 8, 8).min(axis=1) > 2
    assert np.abs(gradient[whole] - TURN @ strain).max() < 0.05


def test_the_same_particles_elsewhere_have_the_same_surface():
    """Of all places on the grid, none is better: what moves does not flicker."""
    cells = scattered(10)
    shapes = []
    for shift in np.random.default_rng(1).uniform(0, 1, (3, 3)):
        mesh = Field.of(S * (cells + shift), np.full(1000, S**3), S).surface()
        shapes.append((mesh.points / S - shift, mesh.normals))
    (first, _), *others = shapes
    for points, normals in others:
        _, near = cKDTree(points).query(first)
        apart = np.einsum("ij,ij->i", first - points[near], normals[near])
        assert np.sqrt(np.mean(apart**2)) < 0.03
        assert np.abs(apart).max() < 0.2


def test_it_is_always_the_same_to_the_bit():
    rest = S * scattered(8)
    own = piece(np.stack([rest, rest * 1.1, rest @ TURN.T]))
    for frame in range(3):
        mesh, again = own.surface(frame), own.part([frame]).surface(0)
        for name in ("points", "triangles", "normals"):
            assert np.array_equal(getattr(mesh, name), getattr(again, name))


def test_time_is_in_proportion_to_the_particles():
    def seconds(count):
        cells, best = S * lattice(count, count, count), math.inf
        for _ in range(3):
            begun = time.process_time()
            Field.of(cells, np.full(len(cells), S**3), S).surface()
            best = min(best, time.process_time() - begun)
        return best

    seconds(4)
    assert seconds(24) < 20 * seconds(12)  # eight times the particles


def test_matter_far_apart_takes_no_room_between():
    far = np.concatenate([ball(4), ball(4) + 1e3])
    mesh = Field.of(far, np.full(len(far), S**3), S).surface()
    assert (mesh.points[:, 0] > 500).mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("position", "spacing"), [([[np.nan, 0, 0]], S), ([[0.0, 0, 0]], 0.0), ([[1e9, 0, 0]], S)]
)  # fmt: skip
def test_nonsense_is_refused(position, spacing):
    with pytest.raises(ValueError, match="allowed"):
        Field.of(np.array(position), np.array([S**3]), spacing)


@pytest.mark.parametrize(
    "changes", [{"look": "jam"}, {"stretch": np.ones((2, 3), np.float32)}, {"present": np.zeros(5, int)}]
)
def test_particles_that_do_not_fit_are_refused(changes):
    with pytest.raises(ValueError, match="allowed"):
        piece(np.zeros((2, 4, 3)), **changes)


# what is drawn


def test_nothing_is_drawn_before_something_is_there():
    position = np.full((3, 8, 3), np.nan)
    position[1, :3], position[2] = S * lattice(1, 1, 3), S * lattice(2, 2, 2)
    own = piece(position, present=np.array([0, 3, 8]))
    assert own.at(0) == ()
    assert not len(own.surface(0).triangles)
    assert np.isfinite(own.surface(1).points).all()
    assert own.extremes(0).shape == (0, 3)
    assert np.array_equal(own.began, [1, 1, 1, 2, 2, 2, 2, 2])


def test_grains_go_with_their_particles():
    """Of many colours and shapes, which stay; none is drawn deep inside."""
    rest = S * lattice(14, 14, 14)
    shift = np.array([0.3, -0.2, 0.1234])
    own = piece(np.stack([rest, rest + shift]), "sand", segmentation=9)
    before, after = own.at(0), own.at(1)
    assert len({layer.rgba for layer in before}) == len(before) >= 6
    assert {layer.segmentation for layer in before} == {9}
    for a, b in zip(before[1:], after[1:], strict=True):
        assert a.rgba == b.rgba
        np.testing.assert_allclose(b.mesh.points, a.mesh.points + shift, atol=1e-5)
    grains = np.concatenate([layer.mesh.points for layer in before[1:]]) / S
    assert np.abs(grains - 7).max() < 8.2
    assert np.abs(grains - 7).max(axis=1).min() > 4.5
    sizes = np.ptp(before[1].mesh.points.reshape(-1, 18, 3), axis=1).max(axis=1) / S
    assert 0.3 < np.median(sizes) < 1.2
    assert sizes.std() > 0.1 * sizes.mean()
    a, b, c = np.moveaxis(before[1].mesh.points.reshape(-1, 3, 3), 1, 0)
    normals = np.cross(b - a, c - a)
    outwards = (a + b + c) / 3 - np.repeat(before[1].mesh.points.reshape(-1, 18, 3).mean(axis=1), 6, axis=0)
    assert (np.einsum("ij,ij->i", normals, outwards) > 0).mean() > 0.99
    assert (np.einsum("ij,ij->i", normals, before[1].mesh.normals[::3]) > 0).all()


def test_translucent_matter_has_a_core_where_it_is_deep():
    deep, film = (piece([S * lattice(*counts)], "honey").at(0) for counts in ((10, 10, 10), (20, 20, 1)))
    core, mantle = deep
    assert core.inside
    assert not mantle.inside
    assert mantle.rgba[3] < 1 == core.rgba[3]
    assert 0.3 < volume(core.mesh.points, core.mesh.triangles) / volume(mantle.mesh.points, mantle.mesh.triangles) < 0.8
    assert not len(film[0].mesh.triangles)


SPHERE = Sphere(PLACE, 0.2)
POSE = orbit(SPHERE, 0.8, 0.5, 0.6)


@pytest.fixture(scope="module")
def stage():
    model, ids = staged("<mujoco/>")
    with Raster(model, (240, 240), ids, sphere=SPHERE) as raster:
        yield raster


def test_a_ball_of_particles_has_a_balls_depth_outline_and_colour(stage):
    own = piece([ball()])
    stage.pose([], layers=own.at(0))
    depth, seg = stage.depth_and_segmentation(POSE)
    assert set(np.unique(seg)) == {0, 7}
    radius = (3 * len(ball()) / (4 * math.pi)) ** (1 / 3) * S
    ways = back_project(np.ones(depth.shape), POSE, FOV) - POSE[:3, 3]
    out = PLACE - POSE[:3, 3]
    along, square = ways @ out, np.einsum("...i,...i->...", ways, ways)
    inside = along**2 - square * (out @ out - radius**2)
    hit = inside > 0
    assert np.count_nonzero((seg == 7) != hit) < 0.05 * np.count_nonzero(hit)
    expected = (along - np.sqrt(np.maximum(inside, 0))) / square
    middle = inside > 0.3 * inside.max()
    off = depth[middle] - expected[middle]
    assert abs(np.median(off)) < 0.1 * S
    assert np.abs(off).max() < 0.5 * S
    picture = stage.colour(POSE).astype(float)
    assert picture[seg == 7].mean(axis=0)[0] > 1.5 * picture[seg == 7].mean(axis=0)[1:].max()
    stage.pose([])
    without = stage.colour(POSE).astype(float)
    shadow = (seg == 0) & (without.mean(axis=2) - picture.mean(axis=2) > 20)
    assert shadow.sum() > 0.2 * (seg == 7).sum()


def test_depth_and_ids_of_several_pieces_are_their_own(stage):
    """The nearer one hides the other, whatever the order; alone, each is seen whole; a frame without any is empty."""
    way = POSE[:3, 2]
    near, far = piece([ball(5) + 0.08 * way]), piece([ball(7) - 0.08 * way], "rubber", segmentation=3)
    seen = []
    for pieces in ((near, far), (far, near)):
        stage.pose([], layers=[layer for own in pieces for layer in own.at(0)])
        seen.append(stage.depth_and_segmentation(POSE))
    assert np.array_equal(seen[0][0], seen[1][0])
    assert np.array_equal(seen[0][1], seen[1][1])
    seg = seen[0][1]
    assert set(np.unique(seg)) == {0, 3, 7}
    assert seg[120, 120] == 7
    stage.show_only([3])
    alone = stage.depth_and_segmentation(POSE)[1]
    stage.show_only(None)
    assert set(np.unique(alone)) == {0, 3}
    assert (alone == 3).sum() > (seg == 3).sum()
    stage.pose([], layers=())
    assert not stage.depth_and_segmentation(POSE)[1].any()


@pytest.mark.parametrize("look", sorted(FINISHES))
def test_every_look_is_seen_with_one_id(stage, look):
    own = piece([ball(5)], look, (0.3, 0.5, 0.6, 1.0))
    stage.pose([], layers=own.at(0))
    seg = stage.depth_and_segmentation(POSE)[1]
    assert set(np.unique(seg)) == {0, 7}
    picture = stage.colour(POSE)[seg == 7].astype(float)
    assert picture[:, 2].mean() > picture[:, 0].mean()
    assert picture.std(axis=0).max() > 8  # light and shade


def test_many_triangles_then_few_then_many_again(stage):
    few, many = (piece([ball(cells)]).at(0) for cells in (2, 9))
    areas = []
    for layers in (few, many, few, many):
        stage.pose([], layers=layers)
        areas.append(np.count_nonzero(stage.depth_and_segmentation(POSE)[1]))
    assert areas[:2] == areas[2:]
    assert areas[1] > 10 * areas[0]


def test_nothing_is_drawn_that_is_not_there(stage):
    """Matter is drawn on a canvas of MuJoCo's, whose memory may hold anything."""
    stage.pose([], layers=piece([ball(5)]).at(0))
    alike = []
    for size in (0.0, 0.2):
        for scene in (stage._colour_scene, stage._matter_scene):
            scene.flexfaceused[:] = 0
            scene.flexvert[:9] = (PLACE + size * (np.eye(3) - 1 / 3)).ravel()
        alike.append((stage.colour(POSE), *stage.depth_and_segmentation(POSE)))
        assert len(np.unique(alike[-1][2])) == 2
    assert all(np.array_equal(a, b) for a, b in zip(*alike, strict=True))


def test_matter_beside_deformables_is_refused():
    size = 'count="3 3 1" spacing=".1 .1 .1" radius=".01"'
    flex = f'<flexcomp name="cloth" type="grid" dim="2" rigid="true" {size}/>'
    model, ids = staged(f"<mujoco><worldbody>{flex}</worldbody></mujoco>")
    with Raster(model, (32, 32), ids, sphere=SPHERE) as raster:
        raster.pose(mujoco.MjData(model).qpos)
        with pytest.raises(ValueError, match="matter beside 1 deformables"):
            raster.pose(mujoco.MjData(model).qpos, layers=piece([ball(5)]).at(0))


def test_a_still_camera_sees_matter_move_as_a_free_one_does():
    model, ids = staged(CROWD)
    data = mujoco.MjData(model)
    own = piece(np.stack([ball(4, 0.4, 0, 0), ball(4, 0.2, -0.4, 0.1)]), segmentation=200)
    sphere = Sphere(np.array([0, 0, 0.3]), 1.2)
    pose = orbit(sphere, 0.7, 0.6, fit_distance(1.2))
    with Raster(model, (160, 160), ids, sphere=sphere) as raster:
        raster.pose(data.qpos, layers=own.at(0))
        still = Still(raster, pose)
        for frame in (0, 1):
            raster.pose(data.qpos, layers=own.at(frame))
            assert raster.window(pose) is not None
            depth, seg = still.depth_and_segmentation()
            whole, ids_whole = raster.depth_and_segmentation(pose)
            assert 200 in seg
            assert (seg != ids_whole).mean() < 1e-3
            assert (np.abs(depth - whole) > 1e-3).mean() < 1e-3
            assert (np.abs(still.colour().astype(int) - raster.colour(pose)).max(axis=2) > 20).mean() < 2e-3


@pytest.mark.parametrize("look", ["honey", "sand"])
def test_path_traced_matter_is_where_the_raster_has_it(look):
    pytest.importorskip("mitsuba", reason="the extra photoreal is not installed")
    model, ids = staged("<mujoco/>")
    own = piece([ball(6)], look, (0.2, 0.35, 0.8, 1.0))
    with Raster(model, (64, 64), ids, sphere=SPHERE) as raster:
        raster.pose([], layers=own.at(0))
        seg = raster.depth_and_segmentation(POSE)[1]
        studio = Studio(raster, Look(4, (3, 1)))
        shown = {name for name in studio.matter() if name.startswith("layer")}
        picture = studio.colour(POSE).astype(float)
    assert len(shown) == sum(not layer.inside for layer in own.at(0)) >= 1
    blue = picture[..., 2] > 1.25 * picture[..., 0]
    assert np.count_nonzero(blue & (seg == 7)) > 0.8 * np.count_nonzero(seg == 7)
    assert np.count_nonzero(blue & (seg == 0)) < 0.2 * np.count_nonzero(seg == 7)


# filming


def falling(frames=9):
    """A footage of a pendulum and a ball of matter that falls beside it."""
    drops = np.stack([ball(4, 0.3, 0.2, 0.9 - 0.01 * frame**2) for frame in range(frames)])
    return pendulum(frames, matter=(piece(drops, segmentation=200),))


def test_the_event_sphere_holds_matter():
    footage = falling()
    sphere = swept_sphere(footage.model, footage.qpos, footage.ids, matter=footage.matter)
    ends = footage.matter[0].position[[0, -1]].reshape(-1, 3)
    assert np.linalg.norm(ends - sphere.centre, axis=1).max() < sphere.radius
    lone = swept_sphere(footage.model, footage.qpos, 0 * footage.ids, matter=footage.matter)
    assert lone.radius < 0.45
    assert np.linalg.norm(ends - lone.centre, axis=1).max() > 0.85 * lone.radius
    with pytest.raises(ValueError, match="nothing to film"):
        swept_sphere(footage.model, footage.qpos, 0 * footage.ids)


def test_a_film_of_matter(tmp_path):
    """Views see it; the number of processes changes no byte; each frame shows its own particles."""
    footage = falling()
    footage = dataclasses.replace(
        footage, sphere=swept_sphere(footage.model, footage.qpos, footage.ids, matter=footage.matter)
    )
    some, rng = [0, 4, 8], np.random.default_rng(0)
    views = film._plan(footage.part(some), some, 9, rng, 2, frozenset({200}), lambda _: None)
    assert [view.poses.shape for view in views] == [(4, 4), (4, 4), (9, 4, 4)]
    footage = two_views(footage)
    for view in footage.views:
        for kind in footage.modalities:
            (tmp_path / "a" / view.name / kind).mkdir(parents=True)
    film._draw(*film._share(footage, 0, 1), tmp_path / "a", True, lambda _: None)
    shoot(footage, tmp_path / "b", workers=2)
    written = files(tmp_path / "a")
    assert len(written) == 54
    again = files(tmp_path / "b")
    assert again.keys() == written.keys()
    assert [name for name in written if again[name] != written[name]] == []
    for view in footage.views:
        for frame in (0, 5, 8):
            with np.load(tmp_path / "a" / view.name / "seg" / f"{frame:04d}.npz") as file:
                rows, columns = np.nonzero(file["seg"] == 200)
            middle = footage.matter[0].position[frame].mean(axis=0)
            pixel, _ = project(middle, view.at(frame), FOV, footage.size)
            assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 1


def test_a_footage_of_too_few_particles_is_refused():
    with pytest.raises(ValueError, match="9 frames"):
        Footage(**{**falling().__dict__, "matter": (piece([ball(3)]),)})
