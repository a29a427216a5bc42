"""A scene made here, read by the independent reader of the released format and compared with what physics says."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import physinone_mj.scene
from physinone_mj.dataset import Job, generate
from physinone_mj.fidelity import DRAFT
from tests.release_reader import (
    MOVING,
    SKY,
    Camera,
    Scene,
    back_project,
    foreground,
    load_scene,
    load_split,
    load_view,
    motion_file,
    motion_file_by_elimination,
    novel_views,
    parse_case_id,
    project,
)

Floats = NDArray[np.float64]

SIZE = 112
VIEWS = 3
SECONDS = 0.3
"""Cut short, since a frame of one view takes a tenth of a second however small it is."""

DEPTH_STEP = 2.0**-15
"""Largest rounding of a depth, relative."""

pytestmark = pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:invalid value encountered")
"""A law of the pendulum's that needs a longer record is judged all the same."""

CASES: dict[int, dict[str, float]] = {
    46: {"length": 0.3, "angle": 1.2, "radius": 0.06},
    10: {"height": 0.3, "restitution": 0.5, "count": 2},
}


@dataclass(frozen=True)
class Made:
    """A scene as its reader sees it, and the recorded physics."""

    index: int
    scene: Scene
    physics: dict[str, Any]
    units: dict[str, str]
    attributes: dict[str, Any]

    @property
    def stride(self) -> int:
        return int(self.attributes["samples_per_frame"])

    @property
    def frames(self) -> int:
        return int(self.scene.motion_info["total_frames"])

    def actors(self) -> dict[int, str]:
        """Segmentation id -> name."""
        told = json.loads((self.scene.root / "properties.json").read_text())
        return {int(key): value["name"] for key, value in told.items()}

    def pose(self, actor: str, frame: int) -> tuple[Floats, Floats]:
        """Origin and rotation matrix of a body at a video frame."""
        at = frame * self.stride
        w, x, y, z = self.physics[f"bodies/{actor}/quaternion"][at]
        turn = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return self.physics[f"bodies/{actor}/origin"][at], np.array(turn)

    def mesh(self, number: int) -> tuple[Floats, NDArray[np.int64]]:
        """Vertices in the body's axes, and triangles."""
        (path,) = (self.scene.root / "meshes").glob(f"{number:03d}_*.obj")
        words = [line.split() for line in path.read_text().splitlines()]
        vertices = np.array([[float(w) for w in line[1:4]] for line in words if line and line[0] == "v"])
        faces = [[int(w.split("/")[0]) - 1 for w in line[1:4]] for line in words if line and line[0] == "f"]
        return vertices, np.array(faces)


def read_physics(path: Path) -> tuple[dict[str, Any], dict[str, str], dict[str, Any]]:
    values: dict[str, Any] = {}
    units: dict[str, str] = {}
    with h5py.File(path, "r") as file:

        def take(name: str, entry: Any) -> None:
            if isinstance(entry, h5py.Dataset):
                values[name] = entry[()]
                units[name] = entry.attrs["unit"]

        file.visititems(take)
        return values, units, dict(file.attrs)


@pytest.fixture(scope="module", params=sorted(CASES))
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    whole = physinone_mj.scene.Scene.resolve

    def short(self: physinone_mj.scene.Scene, *, time: float, length: float, duration: float) -> None:
        whole(self, time=time, length=length, duration=min(duration, SECONDS))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physinone_mj.scene.Scene, "resolve", short)
        job = Job(request.param, CASES[request.param], DRAFT, seed=1, views=VIEWS, size=SIZE)
        folder = generate(job, tmp_path_factory.mktemp("scenes"))
    return Made(request.param, load_scene(folder), *read_physics(folder / "physics.h5"))


def chosen(made: Made) -> list[tuple[Camera, int]]:
    """Some cameras and frames: first, middle and last of all, the moving one included."""
    return [(c, f) for c in made.scene.cameras.values() for f in (0, made.frames // 2, made.frames - 1)]


# --- what there is ---------------------------------------------------------------------------------------------------


def test_names(made: Made) -> None:
    scene = made.scene
    assert scene.root.name == scene.label == f"{scene.case_id}_trajectory"
    phenomena, _, code = parse_case_id(scene.case_id)
    assert len(phenomena) == 1
    assert code == code.upper()
    assert {camera.trajectory_name for camera in scene.cameras.values()} == {scene.label}
    assert "rgb" not in scene.label, "loaders replace it in the whole path"


def test_every_file(made: Made) -> None:
    scene = made.scene
    names = [f"CineCamera_{i}" for i in range(VIEWS)]
    assert scene.listed == names
    assert set(scene.cameras) == {*names, MOVING}
    assert made.frames == round(SECONDS * 30)
    for name in scene.cameras:
        for kind, ending in (("rgb", "jpg"), ("depth", "npz"), ("seg", "npz")):
            there = sorted(path.name for path in (scene.root / name / kind).iterdir())
            assert there == [f"{i:04d}.{ending}" for i in range(made.frames)]
    assert len(scene.caption.split()) > 20
    assert scene.caption.count("\n") == 1
    stats = json.loads((scene.root / "recorder_stats.json").read_text())
    assert isinstance(stats, dict)


def test_readers_find_the_motion_file(made: Made) -> None:
    root = made.scene.root
    assert motion_file(root).name == f"{made.scene.label}.json"
    # those that take the first JSON file that is not another they know
    assert motion_file_by_elimination(root)[0] == motion_file(root)


def test_camera_files(made: Made) -> None:
    for name, camera in made.scene.cameras.items():
        data = json.loads((made.scene.root / f"blender_{name}.json").read_text())
        assert set(data) == {"camera_angle_x", "img_h", "img_w", "trajectory_name", "total_frames", "fps", "frames"}
        assert camera.fov == pytest.approx(1.166746013987712, abs=1e-12)
        assert (camera.width, camera.height, camera.fps, camera.total_frames) == (SIZE, SIZE, 30, made.frames)
        assert len(camera.frames) == made.frames
        for i, frame in enumerate(camera.frames):
            assert set(data["frames"][i]) <= {"frame", "transform_matrix", "file_path", "time", "time_abs", "view"}
            assert (frame.index, frame.file_path) == (i, f"{name}/rgb/{i:04d}")
            assert frame.time == pytest.approx(i / (made.frames - 1), abs=1e-15)
            assert frame.time_abs == pytest.approx(i / 30, abs=1e-15)
            turn = frame.c2w[:3, :3]
            np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
            assert np.linalg.det(turn) == pytest.approx(1.0)
            np.testing.assert_array_equal(frame.c2w[3], [0, 0, 0, 1])
            assert turn[2, 1] > 0, "the picture is upright"
            assert frame.c2w[2, 3] > 0, "above the floor"
        moves = max(float(np.abs(frame.c2w - camera.frames[0].c2w).max()) for frame in camera.frames)
        assert (moves > 1e-3) == (name == MOVING)


def test_pictures(made: Made) -> None:
    for name, camera in made.scene.cameras.items():
        for i in range(made.frames):
            view = made.scene.view(name, i)
            assert view.rgb.shape == (camera.height, camera.width, 3)
            assert view.rgb.std() > 2, "something can be seen"
            with np.load(made.scene.root / name / "depth" / f"{i:04d}.npz") as archive:
                assert archive.files == ["depth"]
                depth = archive["depth"]
            assert (depth.shape, depth.dtype) == ((SIZE, SIZE), np.float32)
            assert np.isfinite(depth).all()
            assert (depth > 0).all()
            hit = depth < SKY
            assert (depth[~hit] == SKY).all()
            assert depth[hit].max() < 1000
            with np.load(made.scene.root / name / "seg" / f"{i:04d}.npz") as archive:
                assert archive.files == ["seg"]
                seg = archive["seg"]
            assert seg.shape == (SIZE, SIZE)
            assert (depth[foreground(view.seg)] < SKY).all()
            np.testing.assert_array_equal(seg, np.round(seg))


def test_ids_are_those_of_the_properties(made: Made) -> None:
    told = json.loads((made.scene.root / "properties.json").read_text())
    assert list(told) == [str(i + 1) for i in range(len(told))]
    assert set(made.scene.motion) == set(made.actors().values())
    for entry in told.values():
        assert 0 <= entry["dynamic_friction"] <= entry["static_friction"] <= 1
        assert 0 <= entry["restitution"] <= 1
        assert 1 < entry["density"] < 25000
    ids: set[int] = set()
    for name in made.scene.cameras:
        for i in range(made.frames):
            found = set(np.unique(made.scene.view(name, i).seg).tolist())
            assert found <= {0, *map(int, told)}
            assert 0 in found
            ids |= found
    assert ids == {0, *map(int, told)}


def test_frustums(made: Made) -> None:
    moving = (made.scene.frustums[:, 0, 3:] == (255, 0, 0)).all(axis=1)
    assert moving.any()
    still = made.scene.frustums[~moving]
    assert len(still) == VIEWS
    for vertices, camera in zip(still, made.scene.statics, strict=True):
        c2w = camera.frames[0].c2w
        np.testing.assert_allclose(vertices[0, :3], c2w[:3, 3], atol=1e-5)
        for place, direction in ((6, c2w[:3, 0]), (7, c2w[:3, 1]), (8, -c2w[:3, 2])):
            tip = vertices[place, :3] - vertices[0, :3]
            np.testing.assert_allclose(tip / np.linalg.norm(tip), direction, atol=1e-3)
    path = np.array([frame.c2w[:3, 3] for frame in made.scene.cameras[MOVING].frames])
    distance, _ = cKDTree(path).query(made.scene.frustums[moving][:, 0, :3])
    assert distance.max() < 1e-5


def test_split(made: Made) -> None:
    scene = made.scene
    parts = {name: load_split(scene.root, name) for name in ("train", "val", "test")}
    view_of = {camera.name: camera.frames[0].view for camera in scene.statics}
    novel = set(novel_views(scene.statics, len(parts["val"].views)))
    assert len(novel) == 1, "two of twelve; of three views, one"
    for name, part in parts.items():
        cameras = {"train": set(view_of) - novel, "val": novel, "test": set(view_of)}[name]
        times = [i for i in range(made.frames) if (i / (made.frames - 1) <= 0.5) == (name != "test")]
        expected = sorted((camera, i) for camera in cameras for i in times)
        assert sorted((f.file_path.split("/")[0], f.index) for f in part.frames) == expected
        for frame in part.frames:
            camera = frame.file_path.split("/")[0]
            assert frame.view == view_of[camera]
            np.testing.assert_array_equal(frame.c2w, scene.cameras[camera].frames[frame.index].c2w)
        data = json.loads((scene.root / f"transforms_{name}.json").read_text())
        assert data["camera_angle_x"] == part.fov == scene.statics[0].fov
        assert load_view(scene.root, part.frames[0].file_path).rgb.shape == (SIZE, SIZE, 3)
    assert len(parts["train"].initial) == VIEWS - 1


# --- where things are ------------------------------------------------------------------------------------------------


def test_motion_agrees_with_the_physics(made: Made) -> None:
    info = made.scene.motion_info
    assert info["start_frame"] == 0
    assert info["end_frame"] == made.frames - 1
    assert info["frame_rate"] == 30
    for actor, path in made.scene.motion.items():
        np.testing.assert_allclose(path, made.physics[f"bodies/{actor}/origin"][:: made.stride], atol=1e-12)


def test_back_projected_masks_lie_on_the_recorded_bodies(made: Made) -> None:
    """The mesh, put where physics.h5 has the body, passes through every pixel of its mask, in all views."""
    rng = np.random.default_rng(4)
    checked = 0
    for number, actor in made.actors().items():
        vertices, faces = made.mesh(number)
        corners = vertices[faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        count = 60_000
        picked = corners[rng.choice(len(corners), count, p=area / area.sum())]
        weights = rng.dirichlet(np.ones(3), count)
        surface = cKDTree(np.einsum("nk,nkd->nd", weights, picked))
        spacing = 3 * math.sqrt(area.sum() / 2 / count)
        for camera, frame in chosen(made):
            view = made.scene.view(camera.name, frame)
            mask = view.seg == number
            origin, turn = made.pose(actor, frame)
            if not mask.any():
                continue
            checked += 1
            z = view.depth[mask].astype(float)
            authors = back_project(view.depth, camera, frame)[mask]
            # the authors' code takes the pixel's corner for its centre: half a pixel to the left and up
            c2w = camera.frames[frame].c2w
            centres = authors + (0.5 * z / camera.focal)[:, None] * (c2w[:3, 0] - c2w[:3, 1])
            for points, pixels in ((authors, 0.75), (centres, 0.0)):
                gap, _ = surface.query((points - origin) @ turn)
                assert (gap <= pixels * z / camera.focal + 4 * DEPTH_STEP * z + spacing).all()
    assert checked >= 3 * VIEWS


def test_the_mask_is_where_the_body_is_seen(made: Made) -> None:
    """Every surface point that nothing hides is seen at its projection, with its depth and its id."""
    for number, actor in made.actors().items():
        vertices, _ = made.mesh(number)
        for camera, frame in chosen(made):
            view = made.scene.view(camera.name, frame)
            origin, turn = made.pose(actor, frame)
            image, z = project(vertices @ turn.T + origin, camera, frame)
            column, row = np.floor(image).astype(int).T
            inside = (column >= 0) & (column < SIZE) & (row >= 0) & (row < SIZE)
            column, row, z = column[inside], row[inside], z[inside]
            depth = view.depth[row, column].astype(float)
            nearest = z <= depth * (1 + 4 * DEPTH_STEP)
            mine = view.seg == number
            around = np.zeros_like(mine)
            for shift in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                around |= np.roll(mine, shift, axis=(0, 1))
            # a corner that peeps out from behind something by less than a pixel belongs to no pixel
            assert around[row[nearest], column[nearest]].mean() > 0.99, "not within a pixel of the mask"


def test_views_agree_with_each_other(made: Made) -> None:
    """A point seen by one static camera is, for every other, either what it sees there or hidden behind that."""
    statics = made.scene.statics
    for frame in (0, made.frames - 1):
        views = {camera.name: made.scene.view(camera.name, frame) for camera in statics}
        for first in statics:
            seen = views[first.name].depth < 20
            points = back_project(views[first.name].depth, first, frame)[seen]
            ids = views[first.name].seg[seen]
            size = views[first.name].depth[seen] / first.focal
            for second in statics:
                if second is first:
                    continue
                image, z = project(points, second, frame)
                column, row = np.floor(image).astype(int).T
                inside = (z > 0) & (column >= 1) & (column < SIZE - 1) & (row >= 1) & (row < SIZE - 1)
                column, row, z = column[inside], row[inside], z[inside]
                there = views[second.name]
                patch = np.stack([there.depth[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
                same = np.stack([there.seg[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
                slack = 3 * (size[inside] + z / second.focal)
                assert (z < patch.min(axis=0) - slack).mean() < 2e-3, "seen through"
                met = np.abs(patch - z) < slack
                agree = (met & (same == ids[inside])).any(axis=0)[met.any(axis=0)]
                assert agree.mean() > 0.97


@pytest.mark.parametrize("made", [10], indirect=True)
def test_spheres_are_drawn_to_the_pixel(made: Made) -> None:
    """Depth, ids and silhouettes against rays through the pixels' centres, from the recorded centres alone."""
    actors = made.actors()
    radius = {number: float(np.linalg.norm(made.mesh(number)[0], axis=1).max()) for number in actors}
    for camera, frame in chosen(made):
        view = made.scene.view(camera.name, frame)
        c2w = camera.frames[frame].c2w
        u = (np.arange(SIZE) + 0.5 - SIZE / 2) / camera.focal
        rays = np.stack(np.broadcast_arrays(u[None], -u[:, None], -1.0), axis=-1) @ c2w[:3, :3].T
        depth = np.full((SIZE, SIZE), np.inf)
        ids = np.zeros((SIZE, SIZE), int)
        for number, actor in actors.items():
            centre = made.physics[f"bodies/{actor}/position"][frame * made.stride]
            offset = c2w[:3, 3] - centre
            a, b, c = (rays**2).sum(-1), rays @ offset, offset @ offset - radius[number] ** 2
            t = np.where(b**2 > a * c, (-b - np.sqrt(np.maximum(b**2 - a * c, 0))) / a, np.inf)
            ids[t < depth] = number
            depth = np.minimum(depth, t)
            # the silhouette's centre, allowing for perspective by construction, within a tenth of a pixel
            mine, drawn = ids == number, view.seg == number
            if mine.sum() > 30 and len(actors) == number:
                np.testing.assert_allclose(
                    np.argwhere(drawn).mean(axis=0), np.argwhere(mine).mean(axis=0), atol=0.1, err_msg=camera.name
                )
        differ = ids != view.seg
        edge = np.zeros_like(differ)
        for axis in (0, 1):
            for step in (-1, 1):
                edge |= np.roll(ids, step, axis) != ids
        assert not (differ & ~edge).any()
        assert differ.sum() <= 0.1 * edge.sum() + 1
        inner = (ids > 0) & ~edge & ~differ
        assert inner.sum() > 20
        # a drawn sphere has facets: at normal incidence, its depth is off by the sagitta of one
        hit = c2w[:3, 3] + rays[inner] * depth[inner][:, None]
        normal = np.zeros_like(hit)
        for number, actor in actors.items():
            mine = ids[inner] == number
            centre = made.physics[f"bodies/{actor}/position"][frame * made.stride]
            normal[mine] = (hit[mine] - centre) / radius[number]
        along = np.abs((normal * rays[inner]).sum(axis=1))
        off = np.abs(view.depth[inner] - depth[inner]) - 4 * DEPTH_STEP * depth[inner]
        assert (off * along).max() < 3e-3 * max(radius.values())
        # the released reader's own back-projection: at the radius from the recorded centre, within half a pixel
        points = back_project(view.depth, camera, frame)
        for number, actor in actors.items():
            mine = inner & (ids == number)
            centre = made.physics[f"bodies/{actor}/position"][frame * made.stride]
            off = np.abs(np.linalg.norm(points[mine] - centre, axis=1) - radius[number])
            assert (off < 0.75 * depth[mine] / camera.focal + 5e-3 * radius[number]).all()


# --- physics.h5 ------------------------------------------------------------------------------------------------------


def test_every_dataset_of_the_physics(made: Made) -> None:
    physics = made.physics
    count = len(physics["time"])
    assert count == made.frames * made.stride
    expected = {
        "position": (3, "m"),
        "quaternion": (4, "1"),
        "linear_velocity": (3, "m/s"),
        "angular_velocity": (3, "rad/s"),
    }
    for actor in made.actors().values():
        for key, (width, unit) in expected.items():
            assert physics[f"bodies/{actor}/{key}"].shape == (count, width)
            assert made.units[f"bodies/{actor}/{key}"] == unit
        np.testing.assert_allclose(np.linalg.norm(physics[f"bodies/{actor}/quaternion"], axis=1), 1, atol=1e-12)
    for key in ("energy/kinetic", "energy/potential"):
        assert physics[key].shape == (count,)
        assert made.units[key] == "J"
    observables = [name for name in physics if name.startswith("observables/")]
    assert observables
    assert all(len(physics[name]) == count for name in observables)
    hits = len(physics["contacts/time"])
    assert {len(value) for name, value in physics.items() if name.startswith("contacts/")} == {hits}
    assert (hits > 0) == (made.index == 10)
    assert not physics["warnings"].any()
    assert all(isinstance(unit, str) and unit for unit in made.units.values())
    for name, value in physics.items():
        assert value.dtype.kind != "f" or np.isfinite(value).all(), name


def test_samples_per_frame(made: Made) -> None:
    time = made.physics["time"]
    assert made.stride >= 8
    np.testing.assert_allclose(time, np.arange(len(time)) / (30 * made.stride), atol=1e-12)


def derivative(values: Floats, step: float) -> Floats:
    """Fourth order, of all but the two first and last."""
    return np.asarray((values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * step))


def undisturbed(made: Made) -> NDArray[np.bool_]:
    """Which of `derivative`'s values have no impact within their stencil."""
    time = made.physics["time"]
    step = time[1]
    quiet = np.ones(len(time) - 4, bool)
    for impact in made.physics["contacts/time"]:
        quiet &= np.abs(time[2:-2] - impact) > 2 * step
    return quiet


def test_velocities_are_derivatives(made: Made) -> None:
    step = made.physics["time"][1]
    quiet = undisturbed(made)
    assert quiet.mean() > 0.5
    for actor in made.actors().values():
        found = derivative(made.physics[f"bodies/{actor}/position"], step)
        told = made.physics[f"bodies/{actor}/linear_velocity"][2:-2]
        np.testing.assert_allclose(found[quiet], told[quiet], atol=1e-5 * max(1e-3, np.abs(told).max()))
        w, x, y, z = made.physics[f"bodies/{actor}/quaternion"][2:-2].T
        rate = derivative(made.physics[f"bodies/{actor}/quaternion"], step)
        conjugate = np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
        spin = 2 * np.einsum("abt,tb->ta", conjugate, rate)
        told = made.physics[f"bodies/{actor}/angular_velocity"][2:-2]
        np.testing.assert_allclose(spin[quiet], told[quiet], atol=1e-5 * max(1e-3, np.abs(told).max()))


def test_energies_are_those_of_the_bodies(made: Made) -> None:
    physics = made.physics
    kinetic, potential = physics["energy/kinetic"], physics["energy/potential"]
    total = kinetic + potential
    scale = kinetic.max()
    if made.index == 46:
        np.testing.assert_allclose(total, total[0], atol=1e-6 * scale)
        return
    told = json.loads((made.scene.root / "properties.json").read_text())
    own, height = np.zeros(len(kinetic)), np.zeros(len(kinetic))
    for number, actor in made.actors().items():
        radius = float(np.linalg.norm(made.mesh(number)[0], axis=1).max())
        mass = told[str(number)]["density"] * 4 / 3 * math.pi * radius**3
        speed = (physics[f"bodies/{actor}/linear_velocity"] ** 2).sum(axis=1)
        spin = (physics[f"bodies/{actor}/angular_velocity"] ** 2).sum(axis=1)
        own += 0.5 * mass * speed + 0.2 * mass * radius**2 * spin
        height += mass * 9.80665 * physics[f"bodies/{actor}/position"][:, 2]
    np.testing.assert_allclose(kinetic, own, atol=1e-6 * scale)
    np.testing.assert_allclose(potential - potential[0], height - height[0], atol=1e-6 * scale)
    first = float(physics["contacts/time"].min())
    assert np.abs(total[physics["time"] < first] - total[0]).max() < 1e-9 * scale
    assert (np.diff(total) < 1e-9 * scale).all(), "energy is only lost"


def test_contacts(made: Made) -> None:
    physics = made.physics
    if made.index != 10:
        assert len(physics["contacts/time"]) == 0
        return
    told = json.loads((made.scene.root / "properties.json").read_text())
    numbers = {actor: number for number, actor in made.actors().items()}
    for k, when in enumerate(physics["contacts/time"]):
        names = {physics["contacts/first"][k].decode(), physics["contacts/second"][k].decode()}
        (ball,) = names - {"stage/floor"}
        number = numbers[ball.partition("/")[0]]
        radius = float(np.linalg.norm(made.mesh(number)[0], axis=1).max())
        entry = told[str(number)]
        mass = entry["density"] * 4 / 3 * math.pi * radius**3
        assert 0 < when < physics["time"][-1]
        assert abs(physics["contacts/position"][k][2]) < 1e-6
        approach = physics["contacts/approach"][k]
        impulse = physics["contacts/impulse"][k] * (1 if physics["contacts/second"][k].decode() == ball else -1)
        if approach > 0.5:
            np.testing.assert_allclose(
                impulse, [0, 0, mass * (1 + CASES[10]["restitution"]) * approach], rtol=1e-6, atol=1e-9
            )
    first = physics["contacts/time"].min()
    assert first == pytest.approx(math.sqrt(2 * CASES[10]["height"] / 9.80665), abs=1e-6)
