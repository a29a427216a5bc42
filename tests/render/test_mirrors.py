"""What mirrors show: where the image is, whose way round, how far behind, through which opening, and what is in it."""

import dataclasses
import itertools
import math

import cv2
import mujoco
import numpy as np
import pytest

from render import mirrors
from render.film import Footage, View, shoot
from render.mirrors import Eye, Face, Image, Mirror, Share
from render.raster import IMMATERIAL, Beam, Raster, Still
from render.rig import FOV, Sphere, focal, look_at, project

from .sets import staged

SIZE = (480, 480)
SPHERE = Sphere(np.array([0.2, 0.0, 0.5]), 1.1)
RED = '<asset><material name="red" rgba="1 0 0 1" emission="1" specular="0"/></asset>'
GLASS = '<geom name="{0}" type="box" pos="-.005 0 0" size=".005 {1} {2}" rgba=".82 .91 .97 1"/>'
FRONT = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)

ROOM = f"""<mujoco>{RED}<worldbody>
  <body pos="0 0 .6"><freejoint/>{GLASS.format("glass", 0.5, 0.4)}</body>
  <body pos=".5 0 .5"><freejoint/><geom name="ball" type="sphere" size=".05" material="red"/></body>
</worldbody></mujoco>"""


def quaternion(axis, angle):
    axis = np.array(axis, float) / np.linalg.norm(axis)
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])


def matrix(turn):
    found = np.zeros(9)
    mujoco.mju_quat2Mat(found, turn)
    return found.reshape(3, 3)


def red(picture, where=None):
    """How red each pixel is as part of the reddest, which is very red, also where it is red in part; where: a mask."""
    r, g, b = (picture[..., k].astype(float) for k in range(3))
    share = np.maximum(r - np.maximum(g, b) - 8, 0) * (1 if where is None else where)
    return share / max(share.max(), 150)


def centroid(weight):
    """Pixel (x, y) in the middle of a weight (H, W)."""
    rows, columns = np.indices(weight.shape)
    return np.array([(weight * (columns + 0.5)).sum(), (weight * (rows + 0.5)).sum()]) / weight.sum()


def faces(model, *names):
    return [Face(model.geom(name).id, *FRONT) for name in names]


@pytest.fixture(scope="module")
def room():
    model, ids = staged(ROOM)
    with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "glass")) as raster:
        yield raster, int(ids[model.geom("glass").id])


def seen_in(room, pose, glass, turn, ball):
    """How red each pixel of the mirror is, with the mirror and the ball at places (3,) [m]."""
    raster, number = room
    raster.pose([*glass, *turn, *ball, 1, 0, 0, 0])
    _, seg = raster.depth_and_segmentation(pose)
    grown = cv2.dilate((seg == number).astype(np.uint8), np.ones((3, 3), np.uint8))
    direct = np.linalg.norm(project(np.array(ball), pose, FOV, SIZE)[0] - np.indices(SIZE)[::-1].T, axis=2).T
    return red(raster.colour(pose), grown * (direct > 25))


EYES = [look_at([2.2, -0.7, 0.9], [0, 0, 0.5]), look_at([1.9, 0.9, 1.3], [0.1, 0, 0.5])]


def triangulate(pixels, poses):
    """Point (3,) nearest to the lines through a pixel of either camera."""
    normal, shifts = np.zeros((3, 3)), np.zeros(3)
    for pixel, pose in zip(pixels, poses, strict=True):
        way = np.array([*(pixel - np.array(SIZE) / 2) * (1, -1), -focal(FOV, SIZE)])
        way = pose[:3, :3] @ way / np.linalg.norm(way)
        across = np.eye(3) - np.outer(way, way)
        normal, shifts = normal + across, shifts + across @ pose[:3, 3]
    return np.linalg.solve(normal, shifts)


@pytest.mark.parametrize(
    ("place", "turn", "ball"),
    [
        ((0, 0, 0.6), quaternion((0, 0, 1), 0), (0.5, 0.1, 0.5)),
        ((0, 0, 0.6), quaternion((0, 0, 1), 0.2), (0.4, -0.1, 0.7)),
        ((-0.1, 0.05, 0.5), quaternion((0, 1, 0), -0.15), (0.6, 0.1, 0.5)),
        ((0, 0, 0.6), quaternion((0.3, 1, 0.2), 0.2), (0.3, 0.0, 0.45)),
    ],
)
def test_the_image_is_as_far_behind_as_the_thing_is_before(room, place, turn, ball):
    normal, pixels = matrix(turn)[:, 0], []
    for pose in EYES:
        pixels.append(centroid(seen_in(room, pose, place, turn, ball)))
        before = (np.array(ball) - place) @ normal
        due, _ = project(np.array(ball) - 2 * before * normal, pose, FOV, SIZE)
        assert np.linalg.norm(pixels[-1] - due) < 0.34
    image = triangulate(pixels, EYES)
    assert -(image - place) @ normal == pytest.approx((np.array(ball) - place) @ normal, abs=4e-3)
    assert np.linalg.norm(np.cross(image - ball, normal)) < 4e-3


def test_the_image_moves_twice_as_fast_as_the_mirror(room):
    turn = quaternion((0, 0, 1), 0.1)
    normal = matrix(turn)[:, 0]
    images = []
    for s in (-0.1, 0.0, 0.1):
        place = s * normal + (0, 0, 0.6)
        images.append(triangulate([centroid(seen_in(room, e, place, turn, (0.5, 0, 0.5))) for e in EYES], EYES))
    assert np.diff(images, axis=0) == pytest.approx(np.tile(0.2 * normal, (2, 1)), abs=4e-3)


def test_the_image_is_seen_through_the_opening_alone(room):
    """The line from the eye to the image crosses the mirror's edge where half of the ball is seen."""
    pose, turn = EYES[0], quaternion((0, 0, 1), 0)
    eye = pose[:3, 3]
    areas = []
    for over in (-0.12, 0.0, 0.12):
        # from a point of the mirror's plane, beside the edge, back along the reflected line
        edge = np.array([0, 0.5 + over, 0.55])
        out = (edge - eye) * (-1, 1, 1)
        ball = edge + 0.25 * out
        areas.append(seen_in(room, pose, (0, 0, 0.6), turn, ball).sum())
    assert areas[0] > 60
    assert areas[1] == pytest.approx(areas[0] / 2, rel=0.15)
    assert areas[2] == 0


LETTER = [((0.0, 0.0), (0.02, 0.12)), ((0.06, 0.1), (0.06, 0.02)), ((0.045, 0.0), (0.045, 0.02))]
"""An F of boxes: middles and half sizes across and up [m]."""


def letter(flipped, x):
    """An F in the plane of that x that is read from the +x side, or its mirror image."""
    side = -1 if flipped else 1
    boxes = "".join(
        f'<geom type="box" pos="{x} {0.05 + side * y} {0.55 + z}" size=".004 {w} {h}" material="red"/>'
        for (y, z), (w, h) in LETTER
    )
    return f"<mujoco>{RED}<worldbody>{boxes}" + "{}</worldbody></mujoco>"


def test_left_and_right_are_exchanged_and_sizes_kept():
    pose = look_at([2.0, -0.5, 0.8], [-0.3, 0.0, 0.55])
    glass = f'<body name="m" pos="0 0 .6">{GLASS.format("glass", 0.5, 0.4)}</body>'
    model, ids = staged(letter(False, 0.4).format(glass))
    with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "glass")) as raster:
        _, seg = raster.depth_and_segmentation(pose)
        # but for what is beside the F that stands before the mirror
        beside = cv2.dilate((seg != ids[model.geom("glass").id]).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
        shown = red(raster.colour(pose), beside)
    templates = []
    for flipped in (False, True):
        model, ids = staged(letter(flipped, -0.4).format(""))
        with Raster(model, SIZE, ids, sphere=SPHERE) as raster:
            templates.append(red(raster.colour(pose)))
    # across the mirror everything stays at its own height and side: an F that was turned round to get there would not
    alike, turned = (np.corrcoef(shown.ravel(), t.ravel())[0, 1] for t in templates)
    assert alike > 0.97
    assert turned < 0.8
    assert shown.sum() == pytest.approx(templates[0].sum(), rel=0.02)


def test_what_stands_before_the_mirror_hides_the_image(room):
    model, ids = staged(
        ROOM.replace("<worldbody>", '<worldbody><geom type="box" pos=".9 -.2 .6" size=".02 .3 .5"/>', 1)
    )
    pose, still = EYES[0], [0, 0, 0.6, 1, 0, 0, 0, 0.3, 0.2, 0.5, 1, 0, 0, 0]
    with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "glass")) as raster:
        raster.pose(still)
        hidden, (_, seg) = raster.colour(pose), raster.depth_and_segmentation(pose)
        bare = raster.without_images(pose)
    raster, _ = room
    raster.pose(still)
    due, _ = project([-0.3, 0.2, 0.5], pose, FOV, SIZE)
    column, row = due.astype(int)
    assert red(raster.colour(pose))[row, column] > 0.8
    assert red(hidden)[row, column] == 0
    board = cv2.erode((seg == 1).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert np.array_equal(hidden[board], bare[board])


FACING = f"""<mujoco>{RED}<worldbody>
  <body pos="0 0 .6">{GLASS.format("a", 0.5, 0.4)}</body>
  <body pos="1.2 0 .6" euler="0 0 180">{GLASS.format("b", 0.5, 0.4)}</body>
  <body pos=".4 -.1 .3"><freejoint/><geom name="ball" type="sphere" size=".05" material="red"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(("orders", "seen"), [(3, True), (2, True), (1, False)])
def test_a_mirror_in_a_mirror(orders, seen, monkeypatch):
    """Seen over the rim of one of two facing mirrors: the image in it, in the other."""
    monkeypatch.setattr(mirrors, "ORDERS", orders)
    model, ids = staged(FACING)
    pose = look_at([1.7, -0.2, 1.5], [0, 0, 0.6])
    with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "a", "b")) as raster:
        picture = red(raster.colour(pose))
    pixels, _ = project([[-0.4, -0.1, 0.3], [-(2.4 - 0.4), -0.1, 0.3]], pose, FOV, SIZE)
    for pixel, there in zip(pixels, (True, seen), strict=True):
        column, row = pixel.astype(int)
        around = picture[row - 9 : row + 10, column - 9 : column + 10]
        assert (around.max() > 0.6) == there
        if there:
            assert np.linalg.norm(centroid(around) + np.array([column - 9, row - 9]) - pixel) < 0.34


def test_depth_and_segmentation_are_the_mirror_s(room):
    raster, _ = room
    model, ids = staged(ROOM)
    pose = EYES[0]
    with Raster(model, SIZE, ids, sphere=SPHERE) as plain:
        plain.pose(raster_pose := [0, 0, 0.6, 1, 0, 0, 0, 0.4, 0, 0.5, 1, 0, 0, 0])
        raster.pose(raster_pose)
        raster.colour(pose)
        for mine, due in zip(raster.depth_and_segmentation(pose), plain.depth_and_segmentation(pose), strict=True):
            assert np.array_equal(mine, due)
        assert np.array_equal(raster.without_images(pose), plain.colour(pose))
        assert (raster.colour(pose) != plain.colour(pose)).any(axis=2).mean() > 0.02


def test_beams_are_seen_in_mirrors_and_before_them(room):
    raster, _ = room
    path = Beam(np.array([[[0.6, -0.25, 0.4], [0.6, 0.25, 0.7], [0.01, 0.2, 0.5]]]), 0.008, (0.1, 1.0, 0.1, 0.85))
    pose = EYES[0]
    raster.pose([0, 0, 0.6, 1, 0, 0, 0, 3, 3, 0.05, 1, 0, 0, 0], lines=[path.at(0)])
    picture = raster.colour(pose).astype(int)
    green = picture[..., 1] - np.maximum(picture[..., 0], picture[..., 2])
    corners = path.points[0]
    for line in (corners, corners * (-1, 1, 1)):
        along = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(line)])
        pixels, _ = project(along, pose, FOV, SIZE)
        columns, rows = pixels.astype(int).T
        assert (green[rows, columns] > 80).mean() > 0.9


def test_sky_and_shadows_are_in_the_image():
    world = f"""<mujoco>{RED}<worldbody>
      <body pos="0 0 .6" euler="0 -60 0">{GLASS.format("up", 0.2, 0.2)}</body>
      <body pos="0 .9 .5">{GLASS.format("level", 0.4, 0.4)}</body>
      <geom type="box" pos=".5 .9 .5" size=".1 .1 .02" rgba=".3 .6 .4 1"/></worldbody></mujoco>"""
    model, ids = staged(world)
    pose, pictures = look_at([2.4, 0.3, 1.3], [0, 0.5, 0.5]), []
    for shadow in (None, 0):
        with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "up", "level"), shadow=shadow) as raster:
            pictures.append(raster.colour(pose).astype(int))
            _, seg = raster.depth_and_segmentation(pose)
    up, level = (cv2.erode((seg == ids[model.geom(n).id]).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
                 for n in ("up", "level"))  # fmt: skip
    assert (pictures[0][up][:, 2] - pictures[0][up][:, 0] > 15).mean() > 0.95  # the sky is blue, the ground is not
    lost = (pictures[1] - pictures[0]).sum(axis=2)
    # the shadow of the board on the ground, moved to behind the mirror: key light along (-.42, .34, -1)
    shadow = np.array([0.5, 0.9, 0.5]) + 0.5 * np.array([-0.42, 0.34, -1.0])
    column, row = project(shadow * (-1, 1, 1), pose, FOV, SIZE)[0].astype(int)
    assert level[row, column]
    assert lost[row, column] > 60
    assert lost[level].min() > -30


def test_mujoco_s_own_image_is_off():
    shiny = ROOM.replace("<asset>", '<asset><material name="m" rgba=".82 .91 .97 1" reflectance=".9"/>')
    shiny = shiny.replace('rgba=".82 .91 .97 1"/></body>', 'material="m"/></body>')
    assert shiny.count('material="m"') == 1
    pictures = []
    for world in (ROOM, shiny):
        model, ids = staged(world)
        with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "glass")) as raster:
            pictures.append(raster.colour(EYES[0]).astype(int))
            _, seg = raster.depth_and_segmentation(EYES[0])
            assert raster.separable()
    inside = cv2.erode((seg == ids[model.geom("glass").id]).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert np.array_equal(pictures[0][inside], pictures[1][inside])


def test_a_veil_lets_the_image_through_in_part(room):
    model, ids = staged(ROOM.replace(
        "<worldbody>", '<worldbody><geom type="box" pos=".9 -.2 .6" size=".001 .3 .5" rgba="0 0 0 .4"/>', 1
    ))  # fmt: skip
    pose, still = EYES[0], [0, 0, 0.6, 1, 0, 0, 0, 0.3, 0.2, 0.5, 1, 0, 0, 0]
    for group in (0, IMMATERIAL):
        model.geom_group[0] = group
        with Raster(model, SIZE, ids, sphere=SPHERE, faces=faces(model, "glass")) as veiled:
            veiled.pose(still)
            dim = veiled.colour(pose).astype(float)
        raster, _ = room
        raster.pose(still)
        bright = raster.colour(pose).astype(float)
        column, row = project([-0.3, 0.2, 0.5], pose, FOV, SIZE)[0].astype(int)
        assert dim[row, column, 0] == pytest.approx(0.36 * bright[row, column, 0], abs=6)  # the veil has two sides


def test_a_still_camera_shows_what_moves_in_the_mirror(room):
    raster, _ = room
    for pose in EYES:
        still = Still(raster, pose)
        for ball in ([0.5, 0.1, 0.5], [0.3, -0.2, 0.7], [2.6, -0.9, 0.3]):
            raster.pose([0, 0, 0.6, 1, 0, 0, 0, *ball, 1, 0, 0, 0])
            whole, part = raster.colour(pose).astype(int), still.colour().astype(int)
            assert (np.abs(whole - part).max(axis=2) > 4).mean() < 2e-4


def test_a_film_with_a_mirror_is_the_same_from_any_number_of_processes(tmp_path):
    model, ids = staged(ROOM)
    frames = 9
    qpos = np.tile([0, 0, 0.6, 1, 0, 0, 0, 0.5, 0, 0.5, 1, 0, 0, 0], (frames, 1)).astype(float)
    qpos[:, 8] = np.linspace(-0.3, 0.3, frames)
    path = np.stack([look_at([2.2, -0.7 + 0.1 * i, 0.9], [0, 0, 0.5]) for i in range(frames)])
    footage = Footage(
        model, qpos, ids, SPHERE, views=(View("CineCamera_0", EYES[0]), View("CineCamera_Moving", path)),
        faces=tuple(faces(model, "glass")), size=(64, 64), modalities=frozenset({"rgb"}),
    )  # fmt: skip
    shoot(footage, tmp_path / "a", workers=1)
    shoot(footage, tmp_path / "b", workers=2)
    shoot(dataclasses.replace(footage, faces=()), tmp_path / "c", workers=1)
    files = [sorted((tmp_path / name).rglob("*.jpg")) for name in "abc"]
    assert len(files[0]) == 2 * frames
    for a, b, c in zip(*files, strict=True):
        assert a.read_bytes() == b.read_bytes() != c.read_bytes()


def test_what_the_second_eye_sees_belongs_where_the_image_is():
    """To round-off, for eyes and mirrors anywhere: places in the image's picture against the mirrored places."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        mirror = Mirror(rng.normal(size=3), turn[:, 0], (0,))
        there = mirror.point + 0.2 * rng.uniform(-1, 1, (4, 2)) @ turn[:, 1:].T
        eye_place = mirror.point + turn @ [rng.uniform(0.5, 2), *rng.uniform(-1, 1, 2)]
        pose = look_at(eye_place, mirror.point)
        across = 0.02 * 300 / focal(FOV, (600, 600))
        eye = Eye(pose[:3, 3], pose[:3, :3], 0.02, -across, across, -across, across, (600, 600))
        assert eye.project(there)[0] == pytest.approx(project(there, pose, FOV, (600, 600))[0], abs=1e-8)
        window = eye.window(there)
        share = Share(window, np.ones(window[:1:-1], np.float32))
        image = Image.of(mirror, eye, share, mirror.point + rng.normal(size=(50, 3)), (4000, 4000))
        things = mirror.point + np.column_stack([rng.uniform(0.1, 2, 5), rng.uniform(-1, 1, (5, 2))]) @ turn.T
        mirrored = things - 2 * ((things - mirror.point) @ mirror.normal)[:, None] * mirror.normal
        pixels, depth = image.eye.project(things)
        laid = np.column_stack([pixels, np.ones(5)]) @ image.matrix.T
        assert (depth > image.eye.near).all()
        assert laid[:, :2] / laid[:, 2:] == pytest.approx(eye.project(mirrored)[0], abs=1e-6)


def test_faces_in_one_plane_are_one_mirror():
    x, up = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    found = mirrors.coplanar(
        [(0, 0 * x, x), (1, up, x), (2, 1e-3 * x, x), (3, 0 * x, -x), (4, up, np.array([1, 1e-3, 0]))], 1
    )
    assert [mirror.geoms for mirror in found] == [(0, 1), (2,), (3,), (4,)]


@pytest.mark.parametrize("geom", [-1, 3])
def test_a_mirror_that_is_not_there_is_refused(geom):
    model, ids = staged(ROOM)
    with pytest.raises(ValueError, match="mirror"):
        Raster(model, (32, 32), ids, sphere=SPHERE, faces=[Face(geom, *FRONT)])
    with pytest.raises(ValueError, match="unit vector"):
        Face(0, (0, 0, 0), (1, 1, 0))
