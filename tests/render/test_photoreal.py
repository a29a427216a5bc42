"""Path-traced pictures, in small: outlines, light, mirrors, glass and caustics where geometry says that they are."""

import dataclasses
import math
import sys

import cv2
import mujoco
import numpy as np
import pytest

from physinone_mj.__main__ import main
from physinone_mj.scene import Conic, Dielectric, Lamp, Mirror
from render import encode, film, photoreal
from render.photoreal import Look, Studio, decoded
from render.raster import Coil, Cord, Line, Raster
from render.rig import FOV, Sphere, fit_distance, orbit, project

from .sets import pendulum, staged

SEEDED = (3, 1)


@pytest.fixture
def mitsuba():
    return pytest.importorskip("mitsuba", reason="the extra photoreal is not installed")


def bare(xml):
    """A model without sun, ground and sky: an even grey light."""
    model = mujoco.MjModel.from_xml_string(xml)
    return model, np.arange(1, model.ngeom + 1)


def studio(raster, samples=4, **look):
    return Studio(raster, Look(samples, SEEDED, **look))


def light(picture):
    """Linear light of a picture; wrong from photoreal.SHOULDER on."""
    return decoded(picture / 255)


def centroid(mask):
    """Of a mask's pixels (x, y) [pixel]."""
    rows, columns = np.nonzero(mask)
    assert len(rows) > 3
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


def red(picture):
    seen = light(picture)
    return (seen[..., 0] > 2 * seen[..., 1]) & (seen[..., 0] > 2 * seen[..., 2])


# Without the library.


def test_without_the_library_the_remedy_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    code = main(["run", "46", "--renderer", "photoreal", "--size", "16", "-o", str(tmp_path / "out")])
    said = capsys.readouterr().err.strip()
    assert code == 2
    assert "pip install 'physinone-mj[photoreal]'" in said
    assert "\n" not in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--renderer", "magic"], "allowed: raster, photoreal"),
        (["--samples", "4"], "allowed: with --renderer photoreal"),
        (["--renderer", "photoreal", "--samples", "0"], "allowed: 1 to 65536"),
        (["--renderer", "photoreal", "--samples", "65537"], "from 0 to 65536"),
    ],
)
def test_what_cannot_be_is_refused(words, told, tmp_path, capsys):
    assert main(["run", "46", *words, "-o", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_colours_survive_encoding():
    seen = np.arange(0, 230, dtype=np.uint8)
    assert np.array_equal(photoreal.encoded(decoded(seen / 255)), seen)
    bright = photoreal.encoded(np.linspace(0.7, 6, 50))
    assert (np.diff(bright.astype(int)) >= 0).all()
    assert bright[-1] == 255
    assert bright[3] < 255


# Shapes.

SHAPES = """<mujoco><asset>
  <mesh name="wedge" vertex="0 0 0 .3 0 0 0 .3 0 .3 .3 0 0 0 .3 0 .3 .3"/>
  <texture name="dice" type="cube" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="32" height="32"/>
  <texture name="stripes" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="32" height="32"/>
  <material name="dice" texture="dice"/><material name="stripes" texture="stripes"/></asset>
<worldbody>
  <geom type="box" pos="-.6 -.5 .2" size=".2 .15 .1" euler="0 20 30" material="stripes"/>
  <geom type="sphere" pos="0 -.5 .3" size=".2"/>
  <geom type="sphere" pos="0 .5 .2" size=".15" material="dice"/>
  <geom type="cylinder" pos=".6 -.5 .3" size=".15 .2" euler="20 0 0" material="stripes"/>
  <geom type="capsule" pos="-.6 .5 .3" size=".1 .15" euler="0 50 0" material="dice"/>
  <geom type="ellipsoid" pos=".6 .5 .3" size=".1 .25 .15" euler="0 20 0"/>
  <geom type="mesh" mesh="wedge" pos="-.15 -.15 .1"/>
  <geom type="plane" pos="0 0 .01" size=".8 .9 .1"/>
  <geom type="sphere" pos="0 0 .9" size=".1" group="3"/>
  <geom type="sphere" pos=".3 0 .9" size=".1" group="4"/>
  <site name="a" pos="-.8 0 .9"/><site name="b" pos="-.3 0 .7"/>
  <site name="c" pos=".8 0 .6"/><site name="d" pos=".4 0 .5"/>
</worldbody><tendon>
  <spatial width=".02"><site site="a"/><site site="b"/></spatial>
  <spatial width=".02"><site site="a"/><site site="c"/></spatial>
  <spatial width=".01"><site site="c"/><site site="d"/></spatial>
</tendon></mujoco>"""


def test_outlines_are_the_rasterisers_to_a_pixel(mitsuba):
    model, ids = staged(SHAPES)
    sphere = Sphere(np.array([0, 0, 0.4]), 1.0)
    coil = Coil(1, 8, 0.06, 0.01, (0.5, 0.5, 0.5, 1), segmentation=101)
    cord = Cord(2, 0.8, 0.015, (0.5, 0.5, 0.5, 1), segmentation=102)
    with Raster(model, (200, 160), ids, sphere=sphere, tendon_ids=[100, 101, 102], coils=[coil, cord]) as raster:
        shots = studio(raster)
        names = shots.matter()
        mi = shots._mi
        scene = mi.load_dict({"type": "scene", **names})
        integrator = mi.load_dict({"type": "aov", "aovs": "shape:shape_index"})
        known = {f"geom{geom}": number for geom, number in enumerate(ids)}
        known |= {"tendon0": 100, "wire0": 101, "wire1": 102}
        number = np.zeros(len(scene.shapes()) + 1, int)
        for i, shape in enumerate(scene.shapes()):
            number[i + 1] = known[shape.id().partition("/")[0]]
        for azimuth, elevation in ((-1.9, 0.5), (0.4, 1.1)):
            pose = orbit(sphere, azimuth, elevation, fit_distance(1.0))
            _, seg = raster.depth_and_segmentation(pose)
            traced = mi.render(scene, sensor=shots._camera(pose), integrator=integrator, spp=1, seed=1)
            mine = number[np.round(np.array(traced)[..., 0]).astype(int)]
            assert set(np.unique(mine)) == set(np.unique(seg))
            assert {100, 101, 102} <= set(np.unique(mine))
            for here, there in ((mine, seg), (seg, mine)):
                padded = np.pad(there, 1, mode="edge")
                around = np.stack([padded[i : i + 160, j : j + 200] for i in range(3) for j in range(3)])
                assert np.mean((around != here).all(axis=0)) < 1e-4
                assert np.mean(here != there) < 0.03


def test_a_pattern_lies_as_the_rasteriser_lays_it(mitsuba):
    model, ids = staged(SHAPES)
    sphere = Sphere(np.array([0, 0, 0.3]), 0.8)
    with Raster(model, (160, 160), ids, sphere=sphere) as raster:
        pose = orbit(sphere, -1.1, 0.7, fit_distance(0.8))
        drawn, traced = raster.colour(pose), studio(raster, 16).colour(pose)
        _, seg = raster.depth_and_segmentation(pose)
    patterned = np.isin(seg, [ids[geom] for geom in range(model.ngeom) if model.geom_matid[geom] >= 0 and ids[geom]])
    patterned = cv2.erode(patterned.astype(np.uint8), np.ones((3, 3))) > 0
    reds, blues = (light(picture)[..., 0] > light(picture)[..., 2] for picture in (drawn, traced))
    assert patterned.sum() > 800
    assert 0.2 < reds[patterned].mean() < 0.8
    assert np.mean((reds == blues)[patterned]) > 0.9


# Light.

CARD = """<mujoco><asset><material name="matt" specular="0" shininess="0" rgba="{grey} {grey} {grey} 1"/></asset>
<worldbody>
  <geom type="box" size=".6 .8 .01" pos="0 0 -.01" material="matt"/>
  <site name="lamp" pos="0 0 {height}" zaxis="0 {aside} -1"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize(("height", "aside", "half"), [(1.0, 0.0, 0.3), (0.8, 0.6, 0.2)])
def test_a_lamps_light_falls_as_much_and_where_it_should(mitsuba, height, aside, half):
    """Irradiance falls as the cosine, whatever the opening's size and distance: E cos i ρ/π (Lambert)."""
    grey, strength = 0.6, 0.5
    model, ids = bare(CARD.format(grey=grey, height=height, aside=aside))
    lamp = Lamp("lamp", (half, half / 2), strength, (1.0, 1.0, 1.0))
    pose = orbit(Sphere(np.zeros(3), 0.8), 0.0, 1.2, 1.4)
    with Raster(model, (80, 80), ids, sphere=Sphere(np.zeros(3), 0.8)) as raster:
        lit, dark = (light(studio(raster, 64, lamps=lamps).colour(pose)) for lamps in ((lamp,), ()))
    gain = (lit - dark).mean(axis=2)
    centre, _ = project(np.array([0, aside * height, 0]), pose, FOV, (80, 80))
    column, row = (int(value) for value in centre)
    cosine = 1 / math.hypot(1, aside)
    due = photoreal.SUN[1] * strength * cosine * decoded(grey) / math.pi
    assert due < 0.5
    assert gain[row - 1 : row + 2, column - 1 : column + 2].mean() == pytest.approx(due, rel=0.06)
    assert np.linalg.norm(centroid(gain > due / 2) - centre) < 1.5
    assert abs(gain[:5]).max() < 0.05 * due


def test_the_sun_makes_shadows_where_it_should(mitsuba):
    model, ids = staged('<mujoco><worldbody><geom type="sphere" size=".1" pos="0 0 .5"/></worldbody></mujoco>')
    sphere = Sphere(np.array([0, 0, 0.3]), 0.6)
    with Raster(model, (120, 120), ids, sphere=sphere) as raster:
        pose = orbit(sphere, -1.2, 0.9, fit_distance(0.6))
        seen = light(studio(raster, 8).colour(pose)).mean(axis=2)
        way = raster.data.light_xdir[np.flatnonzero(model.light_castshadow)[0]]
    where, _ = project(np.array([0, 0, 0.5]) - 0.5 / way[2] * way, pose, FOV, (120, 120))
    column, row = where.astype(int)
    beside = seen[row, column - 30 : column - 20].mean()
    assert seen[row - 1 : row + 2, column - 1 : column + 2].mean() < 0.55 * beside
    assert 0.25 < beside < 0.8


def test_a_mirror_throws_the_sun_where_the_law_of_reflection_says(mitsuba):
    way = np.array([-0.42, 0.34, -1.0]) / np.linalg.norm([-0.42, 0.34, -1.0])  # of the stage's key light
    normal = np.array([0.42, -0.34, 0.0]) / math.hypot(0.42, 0.34)
    turn = math.degrees(math.atan2(normal[1], normal[0]))
    model, ids = staged(f"""<mujoco><worldbody>
      <geom name="glass" type="box" size=".01 .15 .1" pos="0 0 .3" euler="0 0 {turn}"/></worldbody></mujoco>""")
    on = np.array([0, 0, 0.3]) + 0.01 * normal
    mirror = Mirror("glass", tuple(on.tolist()), tuple(normal.tolist()))
    back = way - 2 * (way @ normal) * normal
    patch, behind = (on + on[2] / -ray[2] * ray for ray in (back, way))
    sphere = Sphere(np.array([0, 0, 0.1]), 0.5)
    pose = orbit(sphere, 0.9, 1.0, fit_distance(0.5))
    with Raster(model, (120, 120), ids, sphere=sphere) as raster:
        lit, plain = (light(studio(raster, 16, mirrors=m).colour(pose)).mean(axis=2) for m in ((mirror,), ()))
    (column, row), (column_behind, row_behind) = (
        project(p, pose, FOV, (120, 120))[0].astype(int) for p in (patch, behind)
    )
    assert lit[row, column] > 1.15 * plain[row, column]
    assert lit[row_behind, column_behind] == pytest.approx(plain[row_behind, column_behind], rel=0.1)


BALL = """<mujoco><worldbody><geom type="sphere" size=".1" pos="0 .3 .2" rgba=".2 .4 .8 1"/></worldbody></mujoco>"""


def test_a_beam_is_seen_but_casts_no_shadow_and_no_light(mitsuba):
    model, ids = staged(BALL)
    sphere = Sphere(np.array([0, 0, 0.2]), 0.6)
    path = np.array([(-0.5, 0, 0.3), (0.5, 0, 0.3)])
    beam = Line(path, 0.006, (1.0, 0.1, 0.1, 1.0))
    with Raster(model, (120, 120), ids, sphere=sphere) as raster:
        pose = orbit(sphere, -1.4, 0.6, fit_distance(0.6))
        shots = studio(raster, 2)
        without = shots.colour(pose, (1,))
        raster.pose([], lines=[beam])
        assert set(shots.matter()) == set(shots.matter(black=True))
        with_ = shots.colour(pose, (1,))
    pixels, _ = project(path, pose, FOV, (120, 120))
    near = np.zeros((120, 120), np.uint8)
    cv2.line(near, *(tuple(int(v) for v in pixel) for pixel in pixels), 1, 9)
    changed = np.abs(with_.astype(int) - without).max(axis=2) > 0
    # the denoiser sees the beam in its guide, and may change what is near by a shade
    assert np.abs(with_.astype(int) - without).max(axis=2)[near == 0].max() < 12
    assert changed[near > 0].mean() > 0.2
    middle = ((pixels[0] + pixels[1]) / 2).astype(int)
    assert red(with_)[middle[1] - 1 : middle[1] + 2, middle[0]].any()
    assert not red(without).any()


# Mirrors and glass.

IMAGED = """<mujoco><worldbody>
  <geom name="glass" type="box" size=".01 .4 .4" pos=".4 0 .4" euler="0 0 {turn}"/>
  <geom type="sphere" size=".05" pos="-.1 .1 .45" rgba=".9 .05 .05 1"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize("turn", [0, -12])
def test_a_flat_mirror_shows_the_image_behind_it(mitsuba, turn):
    model, ids = bare(IMAGED.format(turn=turn))
    normal = -np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn)), 0])
    on = np.array([0.4, 0, 0.4]) + 0.01 * normal
    mirror = Mirror("glass", tuple(on.tolist()), tuple(normal.tolist()))
    thing = np.array([-0.1, 0.1, 0.45])
    image = thing - 2 * ((thing - on) @ normal) * normal
    pose = orbit(Sphere(np.array([0.2, 0, 0.4]), 0.5), math.pi - 0.5, 0.1, 1.3)
    with Raster(model, (160, 160), ids, sphere=Sphere(np.array([0.2, 0, 0.4]), 0.5)) as raster:
        seen = red(studio(raster, 16, mirrors=(mirror,)).colour(pose))
        plain = red(studio(raster, 16).colour(pose))
    _, parts = cv2.connectedComponents(seen.astype(np.uint8))
    where, _ = project(image, pose, FOV, (160, 160))
    column, row = where.astype(int)
    assert parts[row, column] > 0
    assert np.linalg.norm(centroid(parts == parts[row, column]) - where) < 0.7
    assert not plain[row, column]


def test_a_mirror_ball_shows_things_where_the_law_of_reflection_says(mitsuba):
    """The place on the ball is found by halving the angle between the ways to eye and thing, not by rays."""
    model, ids = bare("""<mujoco><worldbody>
      <geom name="ball" type="sphere" size=".3" pos="0 0 .3"/>
      <geom type="sphere" size=".08" pos="-.6 -.4 .5" rgba=".9 .05 .05 1"/></worldbody></mujoco>""")
    centre, thing = np.array([0, 0, 0.3]), np.array([-0.6, -0.4, 0.5])
    pose = orbit(Sphere(centre, 0.5), -0.6, 0.3, 1.6)
    with Raster(model, (200, 200), ids, sphere=Sphere(centre, 0.7)) as raster:
        seen = red(studio(raster, 16, mirrors=(Mirror("ball"),)).colour(pose))
        _, seg = raster.depth_and_segmentation(pose)
    eye, normal = pose[:3, 3], np.array([0.0, 0.0, 1.0])
    for _ in range(200):
        place = centre + 0.3 * normal
        ways = [(end - place) / np.linalg.norm(end - place) for end in (eye, thing)]
        normal = sum(ways) / np.linalg.norm(sum(ways))
    where, _ = project(place, pose, FOV, (200, 200))
    assert np.linalg.norm(centroid(seen & (seg == 1)) - where) < 1.0


def test_a_glass_slab_shifts_what_is_behind_it(mitsuba):
    """d = t sin i (1 - cos i/√(n² - sin² i)) (Born & Wolf, Principles of Optics, §1.5, twice Snell's law)."""
    thick, n, incidence = 0.2, 1.5, math.radians(40)
    model, ids = bare(f"""<mujoco><worldbody>
      <geom name="slab" type="box" size="2 2 {thick / 2}"/>
      <geom type="sphere" size=".03" pos="0 0 -.6" rgba=".9 .05 .05 1"/></worldbody></mujoco>""")
    thing, way = np.array([0, 0, -0.6]), np.array([math.sin(incidence), 0, -math.cos(incidence)])
    eye = thing - 1.6 * way
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 2], pose[:3, 3] = (0, 1, 0), -way, eye
    pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
    with Raster(model, (160, 160), ids, sphere=Sphere(np.zeros(3), 0.8)) as raster:
        seen = red(studio(raster, 32, dielectrics=(Dielectric("slab", n),)).colour(pose))
    deep, aside = 1.6 * math.cos(incidence), 1.6 * math.sin(incidence)

    def miss(angle):
        """By how much light that comes to the eye at an angle would have passed the thing."""
        return (deep - thick) * math.tan(angle) + thick * math.tan(math.asin(math.sin(angle) / n)) - aside

    low, high = 0.0, 1.4
    for _ in range(60):
        low, high = ((low + high) / 2, high) if miss((low + high) / 2) < 0 else (low, (low + high) / 2)
    toward = eye + np.array([math.sin(low), 0, -math.cos(low)])
    where, _ = project(toward, pose, FOV, (160, 160))
    straight, _ = project(thing, pose, FOV, (160, 160))
    assert np.linalg.norm(where - straight) > 3
    assert np.linalg.norm(centroid(seen) - where) < 0.7


R, HALF = 0.5, 0.6
DISH = f"""<mujoco><worldbody>
  <geom type="box" pos=".18 0 .398" size=".15 .1 .001" rgba=".35 .35 .35 1"/>
  <geom name="dish" type="sphere" size=".01" pos="{R} 0 .4" group="5"/>
  <site name="vertex" pos="{R} 0 .4" xyaxes="0 -1 0 0 0 1"/>
  <site name="lamp" pos="-.4 0 .56" xyaxes="0 1 0 0 0 1"/>
</worldbody></mujoco>"""


def caustic(conic):
    """Ends [m] of the bright line on the axis, from the mirror's centre, and how far a pixel reaches [m]."""
    model, ids = bare(DISH)
    look = Look(32, SEEDED, (conic,), (), (Lamp("lamp", (HALF * R, 0.16), 0.02, (1.0, 1.0, 1.0)),))
    sphere, size = Sphere(np.array([0.25, 0, 0.4]), 0.3), (120, 120)
    pose = orbit(sphere, -np.pi / 2, np.pi / 2 - 1e-4, 0.35)
    with Raster(model, size, ids, sphere=sphere) as raster:
        shots = Studio(raster, look)
        lit, dark = (light(s.colour(pose)) for s in (shots, Studio(raster, dataclasses.replace(look, lamps=()))))
    along = np.linspace(0.05, 0.33, 400)
    pixels, _ = project(np.stack([along, 0 * along, 0 * along + 0.399], 1), pose, FOV, size)
    columns, row = pixels[:, 0].astype(int), int(pixels[0, 1])
    bright = (lit - dark).mean(axis=2)[row - 2 : row + 3].max(axis=0)[columns]
    on = along[bright > bright.max() / 2]
    return on.min(), on.max(), (along[-1] - along[0]) / np.ptp(pixels[:, 0])


def test_the_caustic_of_a_sphere_lies_on_its_axis_from_the_focus_to_the_marginal_rays_crossing(mitsuba):
    first, last, pixel = caustic(Conic("dish", "vertex", R, HALF * R))
    assert first == pytest.approx(R / 2, abs=2 * pixel)
    assert last == pytest.approx(R / (2 * math.sqrt(1 - HALF**2)), abs=2.5 * pixel)
    assert last - first > 15 * pixel


def test_the_caustic_of_a_paraboloid_is_a_point(mitsuba):
    first, last, pixel = caustic(Conic("dish", "vertex", R, HALF * R, conic=-1.0))
    assert first == pytest.approx(R / 2, abs=3 * pixel)
    assert last == pytest.approx(R / 2, abs=3 * pixel)


# The same again.


def test_the_same_seed_gives_the_same_bytes_whatever_was_drawn_before(mitsuba):
    model, ids = staged(BALL)
    sphere = Sphere(np.array([0, 0, 0.2]), 0.6)
    pose = orbit(sphere, -1.4, 0.6, fit_distance(0.6))
    with Raster(model, (48, 48), ids, sphere=sphere) as raster:
        one, two = studio(raster, 2), studio(raster, 2)
        first = one.colour(pose, (0, 7))
        two.colour(orbit(sphere, 1.0, 0.6, fit_distance(0.6)), (1, 7))
        again, other = two.colour(pose, (0, 7)), two.colour(pose, (0, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_film_has_the_same_files_and_the_same_bytes_for_any_number_of_workers(mitsuba, tmp_path):
    footage = pendulum(frames=2, size=(16, 16))
    far = fit_distance(footage.sphere.radius)
    path = np.stack([orbit(footage.sphere, 1 + 0.1 * i, 0.4, far) for i in range(2)])
    views = (film.View("CineCamera_0", orbit(footage.sphere, 0.5, 0.6, far)), film.View("CineCamera_Moving", path))
    traced = dataclasses.replace(footage, views=views, look=Look(1, SEEDED))
    info = film.shoot(traced, tmp_path / "one", workers=1)
    film.shoot(traced, tmp_path / "two", workers=2)
    assert "Mitsuba" in info["photoreal"]
    one, two = (
        {str(path.relative_to(tmp_path / name)): path.read_bytes() for path in (tmp_path / name).rglob("*.*")}
        for name in ("one", "two")
    )
    assert one == two
    assert sorted(one) == sorted(
        f"{view.name}/{kind}/000{frame}.{ending}"
        for view in views
        for kind, ending in (("rgb", "jpg"), ("depth", "npz"), ("seg", "npz"))
        for frame in range(2)
    )
    with traced.raster(traced.size) as raster:
        traced.put(raster, 1)
        depth, seg = raster.depth_and_segmentation(path[1])
    place = tmp_path / "one" / "CineCamera_Moving"
    assert np.array_equal(encode.read_segmentation(place / "seg" / "0001.npz"), seg)
    assert encode.read_depth(place / "depth" / "0001.npz") == pytest.approx(depth, rel=1e-4)
