"""Run -> what a scene folder says of it: objects and their properties, motion, caption, camera files, dense flow.

Files follow the released PhysInOne dataset, so that readers of it read ours; where the release's key names are not
public (rotation and scale of the motion file, the property file), ours are stated here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .continuum import Piece
from .run import Run, quaternion_matrix
from .scene import IMMATERIAL, Matter

if TYPE_CHECKING:
    from render.surface import Particles

Array = NDArray[np.float64]

HIDDEN = 3
"""Geom group that is never drawn (stand-ins for collision)."""


@dataclass(frozen=True)
class Thing:
    """A foreground object: its segmentation id (from 1), its name in all files, the body it is, what it is made of.

    matter: of a body its surface and density; a piece of a continuum, which is no body: body is ""
    """

    id: int
    name: str
    body: str
    matter: Matter | Piece


def names(model: Any) -> dict[str, str]:
    """Bodies of the model -> their names in the files, without slashes: "ball0/ball" is "ball0", as long as it is the
    only body of its part, "pendulum/bob" is "pendulum_bob". The stage's are left out."""
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    parts = [body.partition("/")[0] for body in bodies]
    return {
        body: part if parts.count(part) == 1 else body.replace("/", "_")
        for body, part in zip(bodies, parts, strict=True)
        if part != "stage"
    }


def things(run: Run) -> list[Thing]:
    """Every body with visible matter, in the order of the model, then every piece of a continuum: ids are the same
    in all views, frames and seeds.

    KeyError if a body was built without saying what it is made of.
    """
    model = run.model
    found: list[Thing] = []
    coiled = {coil.body for coil in run.scene.coils}
    for body, name in names(model).items():
        groups = model.geom_group[model.geom_bodyid == model.body(body).id]
        if (np.isin(groups, [HIDDEN, IMMATERIAL], invert=True)).any() or body in coiled:
            if body not in run.scene.matter:
                raise KeyError(f"{run.specimen.label}.build says nothing of what body {body!r} is made of")
            found.append(Thing(len(found) + 1, name, body, run.scene.matter[body]))
    for continuum in run.scene.continua:
        for piece in continuum.pieces:
            found.append(Thing(len(found) + 1, piece.name.replace("/", "_"), "", piece))
    return found


def geom_ids(run: Run) -> NDArray[np.int32]:
    """Segmentation id of every geom, (ngeom,); 0 is background."""
    ids = {run.model.body(t.body).id: t.id for t in things(run) if isinstance(t.matter, Matter)}
    return np.array([ids.get(int(body), 0) for body in run.model.geom_bodyid], np.int32)


def particles(run: Run) -> tuple[Particles, ...]:
    """The pieces of continua as they are drawn, with the ids of `things`."""
    from render.surface import Particles

    return tuple(
        Particles(
            cloud.position, cloud.stretch, cloud.present, cloud.bulk, t.matter.material.look, t.matter.rgba, t.id
        )
        for t in things(run)
        if isinstance(t.matter, Piece)
        for cloud in [run.clouds[t.matter.name]]
    )


def properties(run: Run) -> dict[str, dict[str, float | str]]:
    """Segmentation id -> what an object is made of, SI.

    Of a body, the release's four: dynamic and static friction, density [kg/m³], restitution. Of a piece of a continuum
    the name of its law and the law's parameters (`physinone_mj.continuum`), its mass [kg], the side of a cell of the
    grid [m] that it was computed on, and the viscosity that this adds [Pa s].
    """
    return {str(t.id): {"name": t.name, **_told(run, t.matter)} for t in things(run)}


def _told(run: Run, matter: Matter | Piece) -> dict[str, float | str]:
    if isinstance(matter, Matter):
        return {
            "dynamic_friction": matter.surface.friction,
            "static_friction": matter.surface.static_friction,
            "density": matter.density,
            "restitution": matter.surface.restitution,
        }
    law, cloud = matter.material, run.clouds[matter.name]
    return {
        "material": type(law).__name__, **vars(law), "mass": float(cloud.mass[-1]), "cell": run.cell,
        "numerical_viscosity": cloud.numerical_viscosity,
    }  # fmt: skip


def motion(run: Run, fps: int) -> dict[str, Any]:
    """The release's motion file: every object's local origin, per video frame.

    Locations are centimetres in the world of the camera files (z up, right-handed, no axis flipped). The release's key
    names for rotation and scale are not public; ours: `rotation` (roll, pitch, yaw about x, y, z in degrees, applied in
    that order), `quaternion` (w first), `scale` (1). A piece of a continuum has its centre of mass for an origin, is
    never turned, and has no entry for frames before any of it is there.
    """
    frames = range(0, len(run), run.stride)
    actors = {}
    for t in things(run):
        if isinstance(t.matter, Piece):
            origin, quaternion = run.clouds[t.matter.name].centre, np.tile((1.0, 0.0, 0.0, 0.0), (len(run), 1))
        else:
            body = run.model.body(t.body).id
            origin, quaternion = run.motion.origin[:, body], run.motion.quaternion[:, body]
        turns = np.degrees(_roll_pitch_yaw(quaternion[:: run.stride]))
        actors[t.name] = {
            "segmentation_id": t.id,
            "transform_data": [
                {
                    "frame": i,
                    "transform": {
                        "location": dict(zip("xyz", (100 * origin[k]).tolist(), strict=True)),
                        "rotation": dict(zip(("roll", "pitch", "yaw"), turns[i].tolist(), strict=True)),
                        "quaternion": dict(zip("wxyz", quaternion[k].tolist(), strict=True)),
                        "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
                    },
                }
                for i, k in enumerate(frames)
                if np.isfinite(origin[k]).all()
            ],
        }
    count = len(frames)
    info = {"total_frames": count, "start_frame": 0, "end_frame": count - 1, "frame_rate": float(fps)}
    return {"sequence_info": info, "actors": actors}


def _roll_pitch_yaw(quaternion: Array) -> Array:
    r = quaternion_matrix(quaternion)
    pitch = np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0]))
    yaw = np.arctan2(r[:, 1, 0], r[:, 0, 0])
    # what is left when the yaw is undone: exact also where, at a pitch of 90°, only their difference is determined
    c, s = np.cos(yaw), np.sin(yaw)
    roll = np.arctan2(s * r[:, 0, 2] - c * r[:, 1, 2], c * r[:, 1, 1] - s * r[:, 0, 1])
    return np.column_stack([roll, pitch, yaw])


def camera_file(
    view: str, poses: Array, *, fov: float, size: int, fps: int, trajectory: str, number: int
) -> dict[str, Any]:
    """`blender_<view>.json`: camera-to-world matrices (OpenGL axes) and the time of each of the frames.

    poses: (N, 4, 4); number: the `view` id that the split files need.
    """
    count = len(poses)
    return {
        "camera_angle_x": fov,
        "img_h": size,
        "img_w": size,
        "trajectory_name": trajectory,
        "total_frames": count,
        "fps": fps,
        "frames": [
            {
                "frame": i,
                "transform_matrix": pose.tolist(),
                "file_path": f"{view}/rgb/{i:04d}",
                "time": i / max(count - 1, 1),
                "time_abs": i / fps,
                "view": number,
            }
            for i, pose in enumerate(poses)
        ],
    }


def split_files(cameras: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """`transforms_{train,val,test}.json` of the future-prediction task, from the static cameras' files.

    Two novel views (a sixth of them, at least one, if there are fewer than twelve): the cameras whose nearest remaining
    neighbour is closest, taken one after the other. Train: seen views, first half; val: novel views, first half; test:
    all views, second half.
    """
    places = {i: np.array(c["frames"][0]["transform_matrix"])[:3, 3] for i, c in enumerate(cameras)}
    novel: list[int] = []
    while len(places) > 2 and len(novel) < max(1, min(2, len(cameras) // 6)):
        nearest = {
            i: min(np.linalg.norm(place - other) for j, other in places.items() if j != i)
            for i, place in places.items()
        }
        chosen = min(nearest, key=lambda i: (nearest[i], i))
        novel.append(chosen)
        del places[chosen]
    frames = [(i in novel, frame) for i, camera in enumerate(cameras) for frame in camera["frames"]]
    parts = {
        "train": [f for unseen, f in frames if not unseen and f["time"] <= 0.5],
        "val": [f for unseen, f in frames if unseen and f["time"] <= 0.5],
        "test": [f for _, f in frames if f["time"] > 0.5],
    }
    return {name: {**cameras[0], "frames": part} for name, part in parts.items()}


def frustums(cameras: Sequence[tuple[Array, bool]], fov: float, length: float) -> str:
    """`cameras.ply`: nine coloured points per camera pose, ASCII.

    cameras: ((4, 4) pose, whether it is a sample of the moving camera). Points: the centre, the four corners of the
    picture, its middle, and the tips of the x axis, the y axis and the viewing direction; `length` [m] is theirs.
    """
    rows = []
    half = np.tan(fov / 2)
    local = np.array(
        [
            [0, 0, 0], [-half, -half, -1], [half, -half, -1], [half, half, -1], [-half, half, -1], [0, 0, -1],
            [1, 0, 0], [0, 1, 0], [0, 0, -1],
        ]
    )  # fmt: skip
    for i, (pose, moving) in enumerate(cameras):
        colour = "255 0 0" if moving else f"0 {(60 + 37 * i) % 196 + 60} 255"
        for point in length * local @ pose[:3, :3].T + pose[:3, 3]:
            rows.append(f"{point[0]:.6f} {point[1]:.6f} {point[2]:.6f} {colour}")
    header = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    header += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    return "\n".join([*header, "end_header", *rows, ""])


def mesh(run: Run, thing: Thing) -> trimesh.Trimesh:
    """The object's visible geometry as one triangle mesh, in the axes of its body [m].

    Of a piece of a continuum, its surface in the first frame, about its centre of mass; empty if nothing is there yet.
    """
    if isinstance(thing.matter, Piece):
        own = next(piece for piece in particles(run) if piece.segmentation == thing.id)
        skin = own.surface(0)
        return trimesh.Trimesh(skin.points - run.clouds[thing.matter.name].centre[0], skin.triangles, process=False)
    model = run.model
    vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), int)], 0
    for g in np.flatnonzero(model.geom_bodyid == model.body(thing.body).id):
        if model.geom_group[g] in (HIDDEN, IMMATERIAL):
            continue
        points, triangles = _geom_mesh(model, int(g))
        vertices.append(points @ quaternion_matrix(model.geom_quat[g][None])[0].T + model.geom_pos[g])
        faces.append(triangles + count)
        count += len(points)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def _geom_mesh(model: Any, g: int) -> tuple[Array, NDArray[np.int64]]:
    kind, size = mujoco.mjtGeom(model.geom_type[g]), model.geom_size[g]
    make = trimesh.creation
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        m = model.mesh(model.geom_dataid[g])
        return (
            model.mesh_vert[m.vertadr[0] : m.vertadr[0] + m.vertnum[0]].astype(float),
            model.mesh_face[m.faceadr[0] : m.faceadr[0] + m.facenum[0]].astype(np.int64),
        )
    shapes: dict[Any, Callable[[], trimesh.Trimesh]] = {
        mujoco.mjtGeom.mjGEOM_SPHERE: lambda: make.icosphere(subdivisions=4, radius=size[0]),
        mujoco.mjtGeom.mjGEOM_ELLIPSOID: lambda: make.icosphere(subdivisions=4).apply_scale(size),
        mujoco.mjtGeom.mjGEOM_BOX: lambda: make.box(extents=2 * size),
        mujoco.mjtGeom.mjGEOM_CYLINDER: lambda: make.cylinder(radius=size[0], height=2 * size[1], sections=96),
        mujoco.mjtGeom.mjGEOM_CAPSULE: lambda: make.capsule(radius=size[0], height=2 * size[1], count=(32, 32)),
    }
    if kind == mujoco.mjtGeom.mjGEOM_PLANE and size[:2].all():  # a rectangle; without sides it has no end
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return corners * (*size[:2], 0.0), np.array([[0, 1, 2], [0, 2, 3]])
    if kind not in shapes:
        raise ValueError(f"geom {model.geom(g).name!r} is a {kind.name}: an object of that shape has no mesh")
    shape = shapes[kind]()
    return np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64)


def dense_flow(
    run: Run, depth: NDArray[np.float32], segmentation: NDArray[np.uint8], poses: tuple[Array, Array],
    samples: tuple[int, int], fov: float,
) -> Array:  # fmt: skip
    """Optical flow (H, W, 2) [pixel] of objects, matter and background, from one recorded sample to another.

    depth (H, W) [m] and segmentation (H, W) belong to the first; poses: the camera (4, 4) at both. A pixel is carried
    by the motion of the body it shows, or by that of the particles next to it, then seen by the second camera. NaN
    where nothing is hit; what gets hidden on the way keeps the flow it would have.
    """
    height, width = depth.shape
    focal = 0.5 * width / np.tan(fov / 2)
    across = (np.arange(width) + 0.5 - width / 2) / focal
    down = (np.arange(height) + 0.5 - height / 2) / focal
    z = np.where(depth < 65504, depth, np.nan).astype(float)
    local = np.stack([across[None] * z, -down[:, None] * z, -z], axis=-1)
    world = local @ poses[0][:3, :3].T + poses[0][:3, 3]
    for t in things(run):
        here = segmentation == t.id
        if isinstance(t.matter, Piece):
            world[here] = _carried(run, t.matter.name, world[here], samples)
            continue
        body = run.model.body(t.body).id
        first, second = (quaternion_matrix(run.motion.quaternion[k, body][None])[0] for k in samples)
        start, end = (run.motion.origin[k, body] for k in samples)
        world[here] = (world[here] - start) @ first @ second.T + end
    seen = (world - poses[1][:3, 3]) @ poses[1][:3, :3]
    u = width / 2 - focal * seen[..., 0] / seen[..., 2]
    v = height / 2 + focal * seen[..., 1] / seen[..., 2]
    return np.stack([u - np.arange(width) - 0.5, v - np.arange(height)[:, None] - 0.5], axis=-1)


NEIGHBOURS = 8


def _carried(run: Run, piece: str, points: Array, samples: tuple[int, int]) -> Array:
    """Where particles near points (N, 3) [m] of a piece's surface at one sample take them by another.

    Between frames a particle goes on as it went at the last one. Of the nearest NEIGHBOURS, a particle at a distance d
    counts (1 - (d/d₊)²)³, d₊ a tenth beyond the farthest of them.
    """
    cloud = run.clouds[piece]
    there = slice(int(cloud.present[samples[0] // run.stride]))

    def at(sample: int) -> Array:
        frame = sample // run.stride
        late = run.t[sample] - run.t[frame * run.stride]
        return np.asarray(cloud.position[frame, there] + late * cloud.velocity[frame, there], float)

    start, end = (at(sample) for sample in samples)
    if not len(start) or not len(points):
        return points
    distance, near = cKDTree(start).query(points, k=min(NEIGHBOURS, len(start)))
    distance, near = (np.asarray(found).reshape(len(points), -1) for found in (distance, near))
    weight = (1 - (distance / (1.1 * distance[:, -1:] + 1e-12)) ** 2) ** 3
    moved = np.einsum("nk,nki->ni", weight, (end - start)[near])
    return np.asarray(points + moved / weight.sum(axis=1, keepdims=True))
