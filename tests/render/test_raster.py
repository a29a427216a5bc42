"""Pictures agree with geometry: where things are, how far, whose pixels they are."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from render.encode import SKY
from render.raster import Beam, Coil, Cord, Raster, Still
from render.rig import FOV, Sphere, back_project, fit_distance, look_at, orbit, project

from .sets import BALL, CROWD, SPRING, staged

SIZE = (320, 320)
SPHERE = Sphere(np.array([0, 0, 0.3]), 1.2)


@pytest.fixture(scope="module")
def crowd():
    model, ids = staged(CROWD)
    with Raster(model, SIZE, ids, sphere=SPHERE) as raster:
        yield model, ids, raster


def view(azimuth=0.7, latitude=0.6, sphere=SPHERE):
    return orbit(sphere, azimuth, latitude, fit_distance(sphere.radius))


@pytest.mark.parametrize("size", [(320, 320), (321, 201), (200, 322)])
def test_a_ball_is_where_the_projection_says(size):
    model, ids = staged(BALL)
    rng = np.random.default_rng(4)
    with Raster(model, size, ids, sphere=SPHERE) as raster:
        for _ in range(12):
            centre = rng.uniform([-0.4, -0.4, 0.2], [0.4, 0.4, 0.6])
            aside = Sphere(SPHERE.centre + rng.uniform(-0.2, 0.2, 3), 1)
            pose = orbit(aside, rng.uniform(0, 7), rng.uniform(0, 1.4), rng.uniform(2.5, 4))
            roll = rng.uniform(-1, 1)
            turn = np.eye(4)
            turn[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
            pose = pose @ turn
            raster.pose([*centre, 1, 0, 0, 0])
            depth, seg = raster.depth_and_segmentation(pose)
            pixel, far = project(centre, pose, FOV, size)
            rows, columns = np.nonzero(seg)
            assert len(rows) > 10
            # pixel centres lie at i + 1/2; away from the axis the disc becomes an ellipse, hardly off-centre here
            assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 0.6
            column, row = pixel.astype(int)
            ray = back_project(np.ones(size[::-1]), pose, FOV)[row, column] - pose[:3, 3]
            out = centre - pose[:3, 3]
            # |t ray - out| = radius, nearer root; t is the planar depth since the ray's is 1
            a, b, c = ray @ ray, ray @ out, out @ out - 0.05**2
            assert far - 0.05 < depth[row, column]
            assert depth[row, column] == pytest.approx((b - math.sqrt(b * b - a * c)) / a, abs=5e-4)


def test_the_floor_is_flat_to_a_micrometre_per_metre(crowd):
    _model, _ids, raster = crowd
    for azimuth, latitude in ((0.3, 0.3), (2.0, 0.6), (4.0, 1.0)):
        pose = orbit(SPHERE, azimuth, latitude, 5.0)
        depth, seg = raster.depth_and_segmentation(pose)
        points = back_project(depth, pose, FOV)[(seg == 0) & (depth < 8)]
        assert len(points) > 10_000
        assert np.abs(points[:, 2]).max() < 1e-4


def test_depth_is_that_of_a_ray_caster(crowd):
    model, ids, raster = crowd
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pose = view(2.2, 0.7)
    raster.pose(data.qpos)
    depth, seg = raster.depth_and_segmentation(pose)
    groups = np.array([1, 1, 1, 0, 0, 1], np.uint8)
    hit = np.zeros(1, np.int32)
    rng = np.random.default_rng(0)
    off = []
    for row, column in rng.integers(0, 320, (400, 2)):
        point = back_project(np.ones((320, 320)), pose, FOV)[row, column]
        way = point - pose[:3, 3]
        far = mujoco.mj_ray(model, data, pose[:3, 3], way, groups, 1, -1, hit, None)
        assert far > 0
        off.append((abs(far - depth[row, column]), ids[hit[0]] != seg[row, column]))
    metres, other = np.array(off).T
    assert np.median(metres) < 3e-5
    assert (metres > 5e-3).mean() < 0.02  # silhouettes
    assert other.mean() < 0.02


def test_segmentation_ids_are_exactly_those_given():
    model, _ = staged(CROWD)
    ids = np.zeros(model.ngeom, int)
    ids[model.geom("ball").id], ids[model.geom("box").id] = 254, 7
    with Raster(model, SIZE, ids, sphere=SPHERE) as raster:
        _, seg = raster.depth_and_segmentation(view())
    assert set(np.unique(seg)) == {0, 7, 254}


def test_many_geoms_keep_their_ids():
    side = 18
    balls = "".join(
        f'<geom type="box" size=".02 .02 .02" pos="{x * 0.1} {y * 0.1} .02"/>'
        for x, y in itertools.product(range(side), repeat=2)
    )
    model, _ = staged(f"<mujoco><worldbody>{balls}</worldbody></mujoco>")
    ids = np.append(np.arange(side * side) % 254 + 1, 0)
    assert model.geom("stage/floor").id == side * side
    sphere = Sphere(np.array([0.85, 0.85, 0]), 1.3)
    pose = orbit(sphere, 0.4, 1.2, fit_distance(1.3))
    with Raster(model, SIZE, ids, sphere=sphere) as raster:
        _, seg = raster.depth_and_segmentation(pose)
    pixels, _ = project(np.append(model.geom_pos[:-1, :2], np.full((side * side, 1), 0.03), axis=1), pose, FOV, SIZE)
    columns, rows = pixels.astype(int).T
    assert np.array_equal(seg[rows, columns], ids[:-1])


def test_what_is_not_matter_is_seen_but_has_no_depth_and_no_id(crowd):
    model, ids, raster = crowd
    raster.pose(model.qpos0)
    pose = look_at([-2.5, 0.2, 1.0], [-0.8, 0, 0.4])
    picture, (depth, seg) = raster.colour(pose), raster.depth_and_segmentation(pose)
    pixel, far = project([-0.8, 0.0, 0.4], pose, FOV, SIZE)
    column, row = pixel.astype(int)
    red, green, blue = picture[row, column].astype(int)
    assert min(red, blue) - green > 60
    assert depth[row, column] > far + 0.3
    assert ids[model.geom("beam").id] not in seg


def test_proxies_and_sites_are_never_drawn(crowd):
    model, ids, raster = crowd
    raster.pose(model.qpos0)
    pose = view()
    picture, (depth, seg) = raster.colour(pose), raster.depth_and_segmentation(pose)
    assert ids[model.geom("proxy").id] not in seg
    bare, bare_ids = staged(
        "\n".join(line for line in CROWD.splitlines() if "site" not in line and '"proxy"' not in line)
    )
    with Raster(bare, SIZE, bare_ids, sphere=SPHERE) as raster:
        assert np.array_equal(raster.colour(pose), picture)
        assert np.array_equal(raster.depth_and_segmentation(pose)[0], depth)


def test_the_sky_is_at_the_largest_half(crowd):
    _model, _ids, raster = crowd
    depth, seg = raster.depth_and_segmentation(look_at([3, 0, 1], [0, 0, 1.5]))
    assert depth[0, 0] == SKY == 65504
    assert np.all(seg[depth == SKY] == 0)
    assert depth[-1, 160] < 5


def test_showing_only_some_hides_the_rest(crowd):
    model, ids, raster = crowd
    ball = int(ids[model.geom("ball").id])
    raster.pose(model.qpos0)
    before = raster.depth_and_segmentation(view())
    raster.show_only([ball])
    depth, seg = raster.depth_and_segmentation(view())
    assert set(np.unique(seg)) == {0, ball}
    assert np.all((depth == SKY) == (seg == 0))
    raster.show_only(None)
    assert all(np.array_equal(a, b) for a, b in zip(before, raster.depth_and_segmentation(view()), strict=True))


def test_the_picture_is_lit_and_shadowed(crowd):
    model, ids, raster = crowd
    raster.pose(model.qpos0)
    pose = view(1.0, 1.0)
    with Raster(model, SIZE, ids, sphere=SPHERE, shadow=0) as flat:
        lost = flat.colour(pose).astype(int).sum(axis=2) - raster.colour(pose).astype(int).sum(axis=2)
    _, seg = raster.depth_and_segmentation(pose)
    assert 0.005 < (lost[seg == 0] > 60).mean() < 0.3


@pytest.mark.parametrize("scale", [0.15, 8.0])
def test_shadows_and_clipping_scale_with_the_event(scale):
    """The same world twice as large from twice as far is the same picture, but for the floor's tiles and light."""
    pictures = []
    for size in (1.0, scale):
        model, ids = staged(
            f'<mujoco><worldbody><geom type="box" pos="0 0 {0.3 * size}" '
            f'size="{0.2 * size} {0.1 * size} {0.3 * size}"/></worldbody></mujoco>'
        )
        sphere = Sphere(np.array([0, 0, 0.3 * size]), 0.6 * size)
        pose = orbit(sphere, 1.0, 0.8, fit_distance(sphere.radius))
        with Raster(model, SIZE, ids, sphere=sphere) as raster:
            depth, seg = raster.depth_and_segmentation(pose)
            with Raster(model, SIZE, ids, sphere=sphere, shadow=0) as flat:
                lost = flat.colour(pose).astype(int).sum(axis=2) - raster.colour(pose).astype(int).sum(axis=2)
        pictures.append((np.where(depth < SKY, depth / size, SKY), seg, lost > 60))
    (near, near_seg, near_dark), (far, far_seg, far_dark) = pictures
    assert np.median(np.abs(near - far)) < 1e-5
    assert (near_seg != far_seg).mean() < 1e-3
    assert near_dark.mean() > 0.01
    assert (near_dark != far_dark).mean() < 5e-3


def test_a_coil_spans_its_tendon_and_has_its_id():
    model, ids = staged(SPRING)
    sphere = Sphere(np.array([0, 0, 0.6]), 0.6)
    pose = orbit(sphere, 0.5, 0.2, fit_distance(0.6))
    coil = Coil(0, 8, 0.06, 0.008, (0.6, 0.6, 0.7, 1), 42)
    with Raster(model, SIZE, ids, sphere=sphere, coils=[coil]) as raster:
        for extension in (0.0, 0.25, -0.3):
            raster.pose([extension])
            depth, seg = raster.depth_and_segmentation(pose)
            rows, columns = np.nonzero(seg == 42)
            (top, bottom), far = project([[0, 0, 1], [0, 0, 0.55 + extension]], pose, FOV, SIZE)
            assert rows.min() == pytest.approx(top[1], abs=6)
            assert rows.max() == pytest.approx(bottom[1], abs=9)
            wide = 2 * 0.068 * 0.5 * SIZE[0] / math.tan(FOV / 2) / far.mean()
            assert np.ptp(columns) == pytest.approx(wide, abs=4)
            assert np.abs(depth[rows, columns] - far.mean()).max() < 0.25
            picture = raster.colour(pose).astype(int)
            green = picture[..., 1] - np.maximum(picture[..., 0], picture[..., 2])
            assert green.max() < 60  # the tendon itself is green, and not drawn


def test_a_tendon_is_matter_if_it_has_an_id():
    model, ids = staged(SPRING)
    sphere = Sphere(np.array([0, 0, 0.6]), 0.6)
    pose = orbit(sphere, 0.5, 0.2, fit_distance(0.6))
    for tendon_ids, seen in ((None, False), (np.array([9]), True)):
        with Raster(model, SIZE, ids, sphere=sphere, tendon_ids=tendon_ids) as raster:
            assert (9 in raster.depth_and_segmentation(pose)[1]) == seen
            picture = raster.colour(pose).astype(int)
            assert (picture[..., 1] - np.maximum(picture[..., 0], picture[..., 2])).max() > 60


def test_pictures_do_not_depend_on_what_was_drawn_before(crowd):
    model, _ids, raster = crowd
    raster.pose(model.qpos0)
    first = raster.colour(view()), *raster.depth_and_segmentation(view())
    raster.pose([0, 0.7, 0.5, 1, 0, 0, 0])
    raster.depth_and_segmentation(view(3, 0.3))
    raster.colour(view(3, 0.3))
    raster.pose(model.qpos0)
    again = raster.colour(view()), *raster.depth_and_segmentation(view())
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_the_callers_model_is_not_changed():
    model, ids = staged(SPRING)
    size = mujoco.mj_sizeModel(model)
    before, after = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    mujoco.mj_saveModel(model, None, before)
    with Raster(model, (32, 32), ids, sphere=SPHERE, coils=[Coil(0, 4, 0.05, 0.01, (1, 1, 1, 1), 3)]) as raster:
        raster.show_only([3])
        raster.colour(view())
    mujoco.mj_saveModel(model, None, after)
    assert np.array_equal(before, after)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ids": np.zeros(1, int)}, "ids must be"),
        ({"ids": np.array([1, 255])}, "0 to 254"),
        ({"ids": np.array([1.0, 0.0])}, "integers"),
        ({"tendon_ids": np.zeros(3, int)}, "tendon_ids must be"),
        ({"coils": [Coil(1, 4, 0.05, 0.01, (1, 1, 1, 1), 3)]}, "names tendon 1"),
    ],
)
def test_wrong_ids_are_refused(changes, message):
    model, ids = staged(SPRING)
    arguments = {"ids": ids, "sphere": SPHERE, **changes}
    with pytest.raises(ValueError, match=message):
        Raster(model, (32, 32), **arguments)


@pytest.mark.parametrize("changes", [{"turns": 0}, {"wire": 0.2}, {"segmentation": 0}, {"segmentation": 255}])
def test_an_impossible_coil_is_refused(changes):
    fine = {"tendon": 0, "turns": 5, "radius": 0.1, "wire": 0.01, "rgba": (1, 1, 1, 1), "segmentation": 2}
    with pytest.raises(ValueError, match="coil"):
        Coil(**{**fine, **changes})


def test_the_stage_opens_alone_and_says_nothing_of_physics():
    from importlib import resources

    text = (resources.files("mjcf_templates") / "stage.xml").read_text(encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    assert "<option" not in text
    floor = model.geom("floor")
    assert (floor.contype, floor.conaffinity, floor.group) == (0, 0, 0)
    assert model.light("key").castshadow


def test_a_still_camera_gives_the_pictures_of_the_raster():
    model, ids = staged(CROWD)
    with Raster(model, SIZE, ids, sphere=SPHERE) as raster:
        assert raster.separable()
        for azimuth, latitude in ((0.4, 0.6), (2.4, 0.2), (4.4, 1.0)):
            still = Still(raster, view(azimuth, latitude))
            for place in ([0, -0.6, 0.15], [0.5, 0.5, 0.9], [-0.6, 0.1, 0.3], [0, 30, 0.2]):
                raster.pose([*place, 1, 0, 0, 0])
                left, top, width, height = raster.window(still.pose) or (0, 0, *SIZE)
                assert width * height < 0.5 * SIZE[0] * SIZE[1]
                assert 0 <= left < left + width <= SIZE[0]
                assert 0 <= top < top + height <= SIZE[1]
                whole = raster.colour(still.pose).astype(int), *raster.depth_and_segmentation(still.pose)
                part = still.colour().astype(int), *still.depth_and_segmentation()
                assert (np.abs(whole[0] - part[0]).max(axis=2) > 1).mean() < 1e-4
                assert (np.abs(whole[1] - part[1]) > 1e-5 * whole[1]).mean() < 1e-4
                assert (whole[2] != part[2]).mean() < 1e-4


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ('<body><freejoint/><light dir="0 0 -1"/><geom size=".1"/></body>', "a light that moves"),
        ('<light type="spot" pos="0 0 3" dir="0 0 -1"/>', "a lamp"),
        ('<light type="directional" dir="1 0 -.1"/>', "a light that grazes"),
        ('<geom type="plane" size="1 1 1" euler="0 30 0"/>', "a tilted plane"),
        ('<geom type="plane" size="1 1 1" material="mirror"/>', "a mirror"),
    ],
)
def test_what_changes_the_whole_picture_is_not_separated(world, message):
    model, ids = staged(
        f'<mujoco><asset><material name="mirror" reflectance=".5"/></asset><worldbody>{world}</worldbody></mujoco>'
        if "mirror" in world
        else f"<mujoco><worldbody>{world}</worldbody></mujoco>"
    )
    with Raster(model, (16, 16), ids, sphere=SPHERE) as raster:
        assert not raster.separable(), message


@pytest.mark.parametrize("end", [(0.3, 0.1, 1.4), (0.0, 0.0, 1.1), (0.7, 0.0, 1.0), (0.0, 0.0, 1.0)])
def test_a_slack_cord_hangs_in_its_own_length(end):
    cord, start = Cord(0, 0.8, 0.005, (1, 1, 1, 1), 3), np.array([0.0, 0.0, 1.0])
    points = cord.wind(start, np.array(end))
    assert points[[0, -1]] == pytest.approx(np.array([start, end]), abs=1e-12)
    pieces = np.diff(points, axis=0)
    assert np.linalg.norm(pieces, axis=1).sum() == pytest.approx(0.8, rel=1e-9)
    assert points[:, 2].min() < min(1.0, end[2]) - 0.03
    assert np.ptp(points[:, :2], axis=0).max() > 0.03


def test_a_taut_cord_is_straight():
    points = Cord(0, 0.8, 0.005, (1, 1, 1, 1), 3).wind(np.zeros(3), np.array([0.0, 0.6, -0.7]))
    assert np.abs(np.cross(points, [0.0, 0.6, -0.7])).max() < 1e-12


def test_a_cord_has_its_id():
    model, ids = staged(SPRING)
    sphere = Sphere(np.array([0, 0, 0.6]), 0.6)
    pose = orbit(sphere, 0.5, 0.2, fit_distance(0.6))
    with Raster(model, SIZE, ids, sphere=sphere, coils=[Cord(0, 0.8, 0.01, (1, 0, 0, 1), 42)]) as raster:
        assert 42 in raster.depth_and_segmentation(pose)[1]


@pytest.mark.parametrize("changes", [{"length": 0.0}, {"wire": 0.0}, {"segmentation": 255}])
def test_an_impossible_cord_is_refused(changes):
    fine = {"tendon": 0, "length": 0.5, "wire": 0.01, "rgba": (1, 1, 1, 1), "segmentation": 2}
    with pytest.raises(ValueError, match="cord"):
        Cord(**(fine | changes))


def beam(*points):
    ended = [points[0], *[[np.nan] * 3] * (len(points) - 1)]
    return Beam(np.array([points, ended], float), 0.01, (1.0, 0.1, 0.1, 0.85))


def test_a_beam_is_seen_but_is_no_matter():
    model, ids = staged(BALL)
    path = beam([-0.5, -0.3, 0.4], [0.5, -0.3, 0.4], [0.5, 0.4, 0.4])
    pose = view()
    with Raster(model, SIZE, ids, sphere=SPHERE) as raster:
        still = [0, 0, 0.5, 1, 0, 0, 0]
        raster.pose(still)
        dark, matter = raster.colour(pose), raster.depth_and_segmentation(pose)
        raster.pose(still, lines=[path.at(0)])
        lit, unchanged = raster.colour(pose), raster.depth_and_segmentation(pose)
        windowed = Still(raster, pose).colour()
        raster.pose(still, lines=[path.at(1)])
        gone = raster.colour(pose)
    for before, after in zip(matter, unchanged, strict=True):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(dark, gone)
    rows, columns = np.nonzero(np.abs(lit.astype(int) - dark).max(axis=2) > 40)
    pixels, _ = project(np.linspace(path.points[0, 0], path.points[0, 1], 30), pose, FOV, SIZE)
    seen = np.stack([columns, rows], axis=1) + 0.5
    assert np.linalg.norm(pixels[:, None] - seen, axis=2).min(axis=1).max() < 2
    assert np.count_nonzero(np.abs(windowed.astype(int) - lit).max(axis=2) > 8) < 20


@pytest.mark.parametrize("changes", [{"radius": 0.0}, {"points": np.zeros((4, 3))}, {"points": np.zeros((2, 4, 2))}])
def test_an_impossible_beam_is_refused(changes):
    with pytest.raises(ValueError, match="beam"):
        Beam(**({"points": np.zeros((1, 2, 3)), "radius": 0.01, "rgba": (1.0, 0.0, 0.0, 1.0)} | changes))
