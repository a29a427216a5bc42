"""A reader of scenes of the released data set, written as its users write theirs.

It knows the published format and nothing of this project: what it reads of a scene made here, the loaders that people
already have read as well.
"""

from __future__ import annotations

import json
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SKY = 65504.0  # the largest half-precision number: the ray hit nothing
MOVING = "CineCamera_Moving"


@dataclass(frozen=True)
class Frame:
    """One entry of a camera's `frames`."""

    index: int
    c2w: Floats  # 4 x 4, camera to world; x right, y up, looks along -z
    file_path: str  # without extension
    time: float
    time_abs: float
    view: int | None


@dataclass(frozen=True)
class Camera:
    """One camera file."""

    name: str
    fov: float
    width: int
    height: int
    fps: float
    total_frames: int
    trajectory_name: str
    frames: list[Frame]

    @property
    def focal(self) -> float:
        return float(0.5 * self.width / np.tan(0.5 * self.fov))


@dataclass(frozen=True)
class View:
    """What one camera sees at one frame."""

    rgb: NDArray[np.uint8]  # red, green, blue
    depth: NDArray[np.float32]
    seg: NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """One scene folder."""

    root: Path
    caption: str
    listed: list[str]  # the lines of static_camera_list.txt
    cameras: dict[str, Camera]
    motion: dict[str, Floats]  # actor (or actor/component) -> (frames, 3) in metres, NaN where a frame is missing
    motion_info: dict[str, Any]
    frustums: Floats  # (cameras, 9, 6): x y z r g b
    case_id: str
    label: str

    @property
    def statics(self) -> list[Camera]:
        """In ascending camera id; ids are strings that must be sorted as numbers."""
        found = [camera for name, camera in self.cameras.items() if name != MOVING]
        return sorted(found, key=lambda camera: int(camera.name.rsplit("_", 1)[1]))

    def view(self, camera: str, frame: int) -> View:
        return load_view(self.root, self.cameras[camera].frames[frame].file_path)


def load_view(root: Path, file_path: str) -> View:
    """The official image loaders: `.jpg` appended, the other two by replacing "rgb" in the whole path."""
    stem = str(root / file_path)
    image = cv2.imread(stem + ".jpg", cv2.IMREAD_COLOR)
    assert image is not None, stem
    with np.load(stem.replace("rgb", "depth") + ".npz") as archive:
        depth = archive["depth"]
    with np.load(stem.replace("rgb", "seg") + ".npz") as archive:
        seg = archive["seg"]
    return View(np.ascontiguousarray(image[..., ::-1], np.uint8), depth.astype(np.float32), seg.astype(np.uint8))


def load_camera(path: Path) -> Camera:
    data = json.loads(path.read_text())
    frames = [
        Frame(
            int(entry["frame"]),
            np.array(entry["transform_matrix"], dtype=np.float64),
            entry["file_path"],
            float(entry["time"]),
            float(entry["time_abs"]),
            entry.get("view"),
        )
        for entry in data["frames"]
    ]
    return Camera(
        path.stem.removeprefix("blender_"),
        float(data["camera_angle_x"]),
        int(data["img_w"]),
        int(data["img_h"]),
        float(data["fps"]),
        int(data["total_frames"]),
        data["trajectory_name"],
        frames,
    )


def camera_files(root: Path) -> list[Path]:
    return sorted(root.glob("blender_CineCamera_*.json"))


def motion_file(root: Path) -> Path:
    """The one file of the root that ends in `_trajectory.json`."""
    found = list(root.glob("*_trajectory.json"))
    assert len(found) == 1, found
    return found[0]


def motion_file_by_elimination(root: Path) -> list[Path]:
    """What readers consider that take any JSON file which is not something else they know."""
    return sorted(
        path
        for path in root.glob("*.json")
        if not path.name.startswith(("blender_", "transforms_")) and path.name != "recorder_stats.json"
    )


def load_motion(path: Path) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Locations in metres: the recorded ones are centimetres."""
    data = json.loads(path.read_text())
    info = data["sequence_info"]
    count = int(info["total_frames"])

    def locations(samples: list[dict[str, Any]]) -> Floats:
        out = np.full((count, 3), np.nan)
        for sample in samples:
            location = sample["transform"]["location"]
            out[int(sample["frame"]) - int(info["start_frame"])] = [0.01 * float(location[axis]) for axis in "xyz"]
        return out

    motion: dict[str, Floats] = {}
    for actor, record in data["actors"].items():
        if record.get("transform_data"):
            motion[actor] = locations(record["transform_data"])
        for part, component in record.get("components", {}).items():
            motion[f"{actor}/{part}"] = locations(component["transform_data"])
    return info, motion


def load_frustums(path: Path) -> Floats:
    """The vertices of `cameras.ply`, nine for each camera."""
    lines = path.read_text().splitlines()
    assert lines[0] == "ply"
    assert lines[1].split()[:2] == ["format", "ascii"]
    end = lines.index("end_header")
    count = next(int(line.split()[2]) for line in lines[:end] if line.startswith("element vertex"))
    vertices = np.array([[float(word) for word in line.split()[:6]] for line in lines[end + 1 : end + 1 + count]])
    assert len(vertices) == count
    assert count % 9 == 0
    return vertices.reshape(-1, 9, 6)


def load_scene(root: Path) -> Scene:
    path = motion_file(root)
    label = path.name.removesuffix(".json")
    cameras = {camera.name: camera for camera in map(load_camera, camera_files(root))}
    info, motion = load_motion(path)
    return Scene(
        root,
        (root / "caption.txt").read_text(encoding="utf-8"),
        (root / "static_camera_list.txt").read_text().split(),
        cameras,
        motion,
        info,
        load_frustums(root / "cameras.ply"),
        label.removesuffix("_trajectory"),
        label,
    )


def parse_case_id(case_id: str) -> tuple[list[str], str, str]:
    """The phenomena, the background and the hash: `_` within a part, `__` between parts."""
    phenomena, background, code = case_id.split("__")
    assert background.startswith("bg")
    assert background[2:].isdigit()
    assert len(code) == 6
    assert code.isalnum()
    return phenomena.split("_"), background, code


def foreground(seg: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((seg != 0) & (seg != 255))


def back_project(depth: NDArray[np.float32], camera: Camera, frame: int) -> Floats:
    """World points (h, w, 3) of a depth image, as the authors compute them: integer pixel indices, planar depth."""
    height, width = depth.shape
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    z = depth.astype(np.float64)
    x = (column - width / 2) * z / camera.focal
    y = (row - height / 2) * z / camera.focal
    points = np.stack([x, -y, -z, np.ones_like(z)], axis=-1)
    return np.asarray((points @ camera.frames[frame].c2w.T)[..., :3], dtype=np.float64)


def project(points: Floats, camera: Camera, frame: int) -> tuple[Floats, Floats]:
    """Image coordinates (n, 2) whose origin is the image's top left corner, and depths, of world points (n, 3)."""
    c2w = camera.frames[frame].c2w
    local = (np.atleast_2d(points) - c2w[:3, 3]) @ c2w[:3, :3]
    z = -local[:, 2]
    u = camera.focal * local[:, 0] / z + camera.width / 2
    v = -camera.focal * local[:, 1] / z + camera.height / 2
    return np.stack([u, v], axis=-1), z


@dataclass(frozen=True)
class Split:
    """One `transforms_*.json` as the official readers of the radiance-field baselines load it."""

    frames: list[Frame]
    fov: float
    initial: list[Frame]  # those of time exactly 0, which initialise the model
    views: set[int]


def load_split(root: Path, name: str) -> Split:
    data = json.loads((root / f"transforms_{name}.json").read_text())
    frames, fov = data["frames"], data["camera_angle_x"]
    if frames:
        _ = frames[0]["view"]  # their reader binds a variable here and fails without
    out = [
        Frame(
            int(f["frame"]), np.array(f["transform_matrix"]), f["file_path"], f["time"], f["time_abs"], int(f["view"])
        )
        for f in frames
    ]
    return Split(out, float(fov), [f for f in out if f.time == 0.0], {int(f["view"]) for f in frames})


def novel_views(cameras: list[Camera], count: int = 2) -> list[str]:
    """The held-out cameras: again and again the one whose nearest remaining neighbour is closest."""
    random.seed(666)
    remaining = list(cameras)
    chosen: list[str] = []
    for _ in range(count):
        centres = np.array([camera.frames[0].c2w[:3, 3] for camera in remaining])
        distance = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
        np.fill_diagonal(distance, np.inf)
        chosen.append(remaining.pop(int(np.argmin(distance.min(axis=1)))).name)
    return chosen
