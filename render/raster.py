"""Pictures of one posed MuJoCo model: colour, planar depth, segmentation, from any camera pose.

Classic MuJoCo rendering with two contexts. Colour is multisampled and shadowed. Depth and segmentation come together
from one pass without multisampling: read from a multisampled pass, depth is off by 2 mm in the median and by more than
5 cm along edges, where samples of two surfaces are mixed.

A standing camera sees most of its picture stand still: :class:`Still` draws what never moves once, and then only the
window in which something moves or casts a moving shadow.

Flat mirrors show the scene, with its shadows, sky and beams, and other mirrors in it: see :mod:`render.mirrors`. Their
depth and their id are those of the mirror, never of what is seen in it. Round mirrors look like polished metal here.

Geom groups: 3 is never drawn (collision proxies); 4 is drawn in colour alone (beams, wind, field arrows: what is not
matter); all others are matter. Sites are never drawn.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise, product
from types import TracebackType
from typing import Self, TypeAlias

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from render import mirrors
from render.egl import Context
from render.encode import SKY
from render.mirrors import Eye, Face, Image, Mirror, Share, Window
from render.rig import FOV, Sphere, focal, project
from render.surface import Layer

HIDDEN, IMMATERIAL = 3, 4
LAST_ID = 254
NEAR, FAR = 0.02, 60.0
"""Clipping planes in radii of the event sphere; the reversed 32-bit depth buffer resolves 1e-6 of the distance."""

SHADOW_REACH = 2.0
"""Half the width of the shadow map, in radii of the event sphere."""

TEXELS = 2.7
"""Texels of the shadow map per pixel of the picture: edges of shadows are then about as fine as those of things."""

FACETS = 40_000
"""Facets that all round primitives together may take; decides how finely each is tessellated."""

SEGMENTS_PER_TURN = 12
CORD_PIECES = 40

PAD, ALIGN = 8, 8
"""A window is wider than what moves by PAD on each side, for soft shadow edges, and starts at a multiple of ALIGN,
so that a texture is filtered over the same blocks of pixels as in the whole picture [pixel]."""

WORTHWHILE = 0.7
"""A window larger than this fraction of the picture is not worth cutting out."""

SUBPIXELS = 4
"""Along either side of a pixel, to find how much of it is a mirror's; halved where the buffer is too small."""

OPAQUE = 0.995
"""Least opacity of what MuJoCo does not draw as translucent."""

ON_FACE = 2e-4
"""What is seen is on a mirror's face if it is nearer to its plane than this, in radii of the event sphere."""

AMBIENT, FRONTAL = (0.42, 0.42, 0.43), (0.16, 0.16, 0.16)
"""Light from everywhere and from the camera. With the haze, they repeat the `visual` element of stage.xml, which a
template loses when it is attached to a scene."""

HAZE, HAZE_COLOUR = 0.5, (0.86, 0.89, 0.92, 1.0)

ROUND = [
    mujoco.mjtGeom.mjGEOM_SPHERE.value,
    mujoco.mjtGeom.mjGEOM_CAPSULE.value,
    mujoco.mjtGeom.mjGEOM_CYLINDER.value,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID.value,
]


@dataclass(frozen=True)
class Coil:
    """A helical spring drawn in place of a spatial tendon, between its first and its last site.

    Args:
        tendon: id of the tendon.
        turns: number of windings.
        radius: of the helix, to the middle of the wire [m].
        wire: radius of the wire [m].
        rgba: colour, four numbers from 0 to 1.
        segmentation: id, 1 to 254.
    """

    tendon: int
    turns: float
    radius: float
    wire: float
    rgba: tuple[float, float, float, float]
    segmentation: int
    helix: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not (self.turns > 0 and self.radius > 0 and 0 < self.wire < self.radius):
            raise ValueError(f"a coil needs turns > 0 and 0 < wire < radius, got {self}")
        if not 1 <= self.segmentation <= LAST_ID:
            raise ValueError(f"segmentation id of a coil must be 1 to {LAST_ID}, got {self.segmentation}")
        along = np.linspace(0, 1, math.ceil(self.turns * SEGMENTS_PER_TURN) + 1)
        # a twentieth of the length at each end runs in from the axis, where the sites are
        inside = np.clip(np.minimum(along, 1 - along) / 0.05, 0, 1)
        angle = 2 * math.pi * self.turns * along
        rim = self.radius * np.sin(inside * math.pi / 2)
        object.__setattr__(self, "helix", np.stack([rim * np.cos(angle), rim * np.sin(angle), along], axis=1))

    def __len__(self) -> int:
        return len(self.helix)

    def wind(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 3) [m] of the wire's axis when the spring hangs between `start` (3,) and `end` (3,) [m]."""
        span = end - start
        along = span / max(float(np.linalg.norm(span)), 1e-9)
        side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        side /= np.linalg.norm(side)
        return np.asarray(start + self.helix @ np.stack([side, np.cross(along, side), span]), dtype=np.float64)


@dataclass(frozen=True)
class Cord:
    """A rope drawn in place of a spatial tendon, between its first and its last site: straight when it is taut, and
    hanging in a bow of its own length when it is slack. It can not bend sharply: two ends in one place leave a loop.

    Args:
        tendon: id of the tendon.
        length: of the rope when nothing pulls at it [m].
        wire: radius of the rope [m].
        rgba: colour, four numbers from 0 to 1.
        segmentation: id, 1 to 254.
    """

    tendon: int
    length: float
    wire: float
    rgba: tuple[float, float, float, float]
    segmentation: int
    along: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not (self.length > 0 and self.wire > 0):
            raise ValueError(f"a cord needs length > 0 and wire > 0, got {self}")
        if not 1 <= self.segmentation <= LAST_ID:
            raise ValueError(f"segmentation id of a cord must be 1 to {LAST_ID}, got {self.segmentation}")
        object.__setattr__(self, "along", np.linspace(0, 1, CORD_PIECES + 1))

    def __len__(self) -> int:
        return CORD_PIECES + 1

    def wind(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 3) [m] of the rope's axis when it is held at `start` (3,) and `end` (3,) [m]."""
        span = end - start
        line = start + self.along[:, None] * span
        slack = self.length - float(np.linalg.norm(span))
        if slack <= 0:
            return np.asarray(line)
        across = np.array([span[0], span[1], 0.0])
        apart = float(np.linalg.norm(across))
        side = across / apart if apart > 1e-6 else np.array([0.0, 1.0, 0.0])
        bulge = max(min(0.12 * self.length, 0.4 * slack) - apart / 2, 0.0)
        line -= bulge * np.sin(2 * math.pi * self.along)[:, None] * side
        bow = 4 * self.along * (1 - self.along)

        def sagging(depth: float) -> NDArray[np.float64]:
            return np.asarray(line - np.outer(depth * bow, (0, 0, 1)))

        low, high = 0.0, self.length
        for _ in range(40):  # the deeper it hangs, the longer it is
            middle = (low + high) / 2
            long = float(np.linalg.norm(np.diff(sagging(middle), axis=0), axis=1).sum())
            low, high = (middle, high) if long < self.length else (low, middle)
        return sagging(low)


Wire: TypeAlias = Coil | Cord
"""What is drawn in place of a tendon."""


SPOT = 2.5
"""Where a beam ends, a spot this many times as wide as the beam is lit up."""

ROOM_FOR_BEAMS = 4096
"""Pieces of beams that are drawn, at most."""


@dataclass(frozen=True)
class Beam:
    """A ray of light over time: drawn in colour alone, glowing, without a shadow.

    Args:
        points: (T, N, 3) corners of its path at every frame [m]; NaN after its end.
        radius: as it is drawn [m].
        rgba: colour, four numbers from 0 to 1.
    """

    points: NDArray[np.float64]
    radius: float
    rgba: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        if self.points.ndim != 3 or self.points.shape[2] != 3 or not self.radius > 0:
            raise ValueError(f"a beam needs (T, N, 3) points and radius > 0, got {self.points.shape}, {self.radius}")

    def at(self, frame: int) -> Line:
        """What of it is there at a frame."""
        path = self.points[frame]
        return Line(path[np.isfinite(path[:, 0])], self.radius, self.rgba)


@dataclass(frozen=True)
class Line:
    """A beam in one picture: corners (N, 3) [m], radius [m], colour."""

    points: NDArray[np.float64]
    radius: float
    rgba: tuple[float, float, float, float]


ROOM_FOR_LAYERS = 1000
ROOM_FOR_TRIANGLES = 2**24
"""MuJoCo counts the triangles of a slice in single precision."""


def _canvas(triangles: int) -> mujoco.MjModel:
    """A model whose scenes have room for so many triangles, which follow from nothing in it.

    MuJoCo draws deformables from arrays in the scene, corner by corner, in slices; how much they hold is decided by the
    model that the scene is made for. In this one a triangle is there many times over, and is never posed.
    """
    spec = mujoco.MjSpec()
    spec.add_flex(
        name="canvas", dim=2, radius=1e-3, vertbody=["world"] * 3, vert=[0, 0, 0, 1, 0, 0, 0, 1, 0],
        elem=[0, 1, 2] * math.ceil(triangles / 2),
    )  # fmt: skip
    return spec.compile()


class Raster:
    """Draws one model; owns a copy of it, its pose, and two OpenGL contexts' worth of buffers.

    Args:
        model: compiled model; it is copied, never changed.
        size: (W, H) [pixel].
        ids: (ngeom,) segmentation id of each geom, 0 to 254; 0 is the background, which still has depth.
        sphere: event sphere; lights, shadows and clipping planes are set relative to it.
        fov: horizontal field of view [rad].
        tendon_ids: (ntendon,) segmentation ids; a tendon without one is drawn in colour alone. None is all 0.
        coils: springs and ropes drawn in place of their tendons.
        faces: that are flat mirrors; opaque ones, and at most 254 geoms.
        samples: multisamples of the colour picture; 0 is none.
        shadow: width of the shadow map [texel]; 0 is no shadows, None suits the picture: 3072 for one of 1120 pixels.

    Raises:
        NoGL: there is no driver.
        ValueError: ids of the wrong shape or range, a coil on a tendon that does not exist or has no two end sites, or
            a mirror on a geom that does not exist.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        ids: ArrayLike,
        *,
        sphere: Sphere,
        fov: float = FOV,
        tendon_ids: ArrayLike | None = None,
        coils: Collection[Wire] = (),
        faces: Collection[Face] = (),
        samples: int = 4,
        shadow: int | None = None,
    ) -> None:
        self.size, self.fov, self.sphere, self.coils = size, fov, sphere, tuple(coils)
        self._faces = _known(tuple(faces), model.ngeom)
        self._ids = _checked(ids, model.ngeom, "ids")
        self._tendon_ids = _checked(
            np.zeros(model.ntendon, int) if tendon_ids is None else tendon_ids, model.ntendon, "tendon_ids"
        )
        self._model = copy.copy(model)
        self._ends = [_end_sites(model, coil.tendon) for coil in self.coils]
        self._model.tendon_group[:] = np.where(self._tendon_ids > 0, 0, IMMATERIAL)
        self._model.tendon_group[[coil.tendon for coil in self.coils]] = HIDDEN
        self._tendon_groups = self._model.tendon_group.copy()
        # a floor shadows nothing above it, and as a caster it speckles itself
        casts_none = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE.value) | (model.geom_group == IMMATERIAL)
        self._model.geom_castshadow[casts_none] = 0
        materials = {int(model.geom_matid[face.geom]) for face in self._faces} - {-1}
        self._model.mat_reflectance[sorted(materials)] = 0  # MuJoCo's own image: of one mirror, without shadows and sky
        self._groups = self._model.geom_group.copy()
        self._data = mujoco.MjData(self._model)
        self._wires: list[tuple[Wire, NDArray[np.float64]]] = []
        self._lines: tuple[Line, ...] = ()
        self._layers: tuple[Layer, ...] = ()
        self._only: frozenset[int] | None = None
        self._lit = True
        self._hidden_coils: frozenset[int] = frozenset()
        self._moving = moving_geoms(model)
        self._immaterial = IMMATERIAL in model.geom_group or IMMATERIAL in self._model.tendon_group
        self._reach: NDArray[np.float64] | None = None

        segments = sum(len(coil) for coil in self.coils)
        self._set_scales(segments)
        self._context = Context()
        suited = min(math.ceil(TEXELS * max(size) / 128) * 128, 4096)
        self._quality = samples, suited if shadow is None else shadow
        self._room = model.ngeom + segments + 64 * model.ntendon + 1000 + ROOM_FOR_BEAMS + ROOM_FOR_LAYERS
        self._room_for_triangles = 0
        self._make_scenes(self._model)
        self._colour_options, self._matter_options = _options(HIDDEN), _options(HIDDEN, IMMATERIAL)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_USER
        self._lut: NDArray[np.uint8] | None = None
        self._mirrors: tuple[Mirror, ...] = ()
        self.pose(self._data.qpos)

    def pose(
        self,
        qpos: ArrayLike,
        mocap_pos: ArrayLike | None = None,
        mocap_quat: ArrayLike | None = None,
        lines: Collection[Line] = (),
        layers: Collection[Layer] = (),
    ) -> None:
        """Move the model: `qpos` (nq,), where it has mocap bodies `mocap_pos` (nmocap, 3) and `mocap_quat`; `lines`:
        the beams, `layers`: the pieces of continua of this moment."""
        model, data = self._model, self._data
        data.qpos[:] = qpos
        if mocap_pos is not None:
            data.mocap_pos[:] = mocap_pos
        if mocap_quat is not None:
            data.mocap_quat[:] = mocap_quat
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_flex, mujoco.mj_tendon):
            stage(model, data)
        # a directional light is the same from anywhere: from here its shadow map is centred on the event
        sun = model.light_type == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value
        data.light_xpos[sun] = self.sphere.centre - 2 * SHADOW_REACH * self.sphere.radius * data.light_xdir[sun]
        self._wires = [
            (coil, coil.wind(data.site_xpos[first], data.site_xpos[last]))
            for coil, (first, last) in zip(self.coils, self._ends, strict=True)
        ]
        self._lines = tuple(line for line in lines if len(line.points) > 1)
        self._lay(tuple(layer for layer in layers if len(layer.mesh.triangles)))
        places = []
        for face in self._faces:
            body = model.geom_bodyid[face.geom]
            turn = data.xmat[body].reshape(3, 3)
            places.append((face.geom, data.xpos[body] + turn @ face.point, turn @ face.normal))
        self._mirrors = mirrors.coplanar(places, self.sphere.radius)
        self._lut = self._reach = None

    def colour(self, pose: ArrayLike) -> NDArray[np.uint8]:
        """The (H, W, 3) RGB picture from a camera pose (4, 4)."""
        picture = self.without_images(pose)
        self.put_images(picture, pose)
        return picture

    def without_images(self, pose: ArrayLike, window: Window | None = None) -> NDArray[np.uint8]:
        """The picture from a pose (4, 4), or the part of it inside a window, with nothing seen in the mirrors."""
        eye = self._eye(pose, window)
        return self._picture(eye, eye, self._colour)

    def put_images(self, picture: NDArray[np.uint8], pose: ArrayLike) -> None:
        """Let the mirrors of a picture (H, W, 3) without images, from that pose (4, 4), show what is seen in them."""
        eye = self._eye(pose)
        self._put_images(picture, eye, eye, mirrors.ORDERS)

    def depth_and_segmentation(
        self, pose: ArrayLike, window: Window | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Planar depth (H, W) [m], SKY where nothing is hit, and ids (H, W), from a camera pose (4, 4), or a part."""
        eye = self._eye(pose, window)
        self._update(eye, self._matter_scene, self._matter_options)
        if self._lut is None:
            self._lut = self._ids_by_colour(self._matter_scene)
        shown, z = self._render(eye, self._matter_scene, self._matter, deep=True)
        if len(self._lut) <= 256:
            table = np.zeros(256, np.uint8)
            table[: len(self._lut)] = self._lut
            seg = cv2.LUT(cv2.extractChannel(shown, 0), table)
        else:
            seg = self._lut[shown.astype(np.uint32) @ np.array([1, 1 << 8, 1 << 16], np.uint32)]
        return self._metres(z, eye.near), np.asarray(seg, dtype=np.uint8)

    def show_only(self, ids: Collection[int] | None) -> None:
        """Hide all whose segmentation id is not in `ids`, in every later picture; None shows all again."""
        if ids is None:
            self._show(np.ones(len(self._ids), bool), np.ones(len(self._tendon_ids), bool), self.coils)
        else:
            wanted = list(ids)
            coils = [coil for coil in self.coils if coil.segmentation in ids]
            self._show(np.isin(self._ids, wanted), np.isin(self._tendon_ids, wanted), coils)
        self._lit, self._only = ids is None, None if ids is None else frozenset(ids)

    def show_static(self) -> None:
        """Hide all that can move, in every later picture, until `show_only(None)`."""
        self._show(~self._moving, np.zeros(len(self._tendon_ids), bool), ())
        self._lit, self._only = False, frozenset()

    def separable(self) -> bool:
        """Whether what moves changes the picture only where it is and where its shadow can fall.

        Not so with MuJoCo's own mirrors, with shadows of lamps or of moving or grazing lights, with tilted or moving
        planes, and not known of skins and deformables. What a flat mirror shows is left out of this.
        """
        model = self._model
        casting = model.light_castshadow.astype(bool)
        sunlit = (model.light_type == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value) & (
            model.body_weldid[model.light_bodyid] == 0
        )
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE.value
        return bool(
            not model.nflex
            and not model.nskin
            and not model.mat_reflectance.any()
            and np.all(sunlit[casting])
            and np.all(self._data.light_xdir[casting, 2] < -0.2)
            and not np.any(self._moving[plane])
            and np.all(self._data.geom_xmat[plane, 8] > 0.9999)
        )

    def window(self, pose: ArrayLike) -> Window | None:
        """Where the picture from a pose (4, 4) differs from one without what can move; None if nearly everywhere.

        Only of use if :meth:`separable`.
        """
        if self._reach is None:
            self._reach = self._moving_extent()
        pixels, depth = project(self._reach, pose, self.fov, self.size)
        if depth.max(initial=0) <= 0:
            return 0, 0, *np.minimum(ALIGN, self.size).tolist()
        if depth.min() < 2 * NEAR * self.sphere.radius:
            return None
        size = np.array(self.size)
        low = np.clip(pixels.min(axis=0) - PAD, 0, size - 1) // ALIGN * ALIGN
        high = np.minimum(-(-np.clip(pixels.max(axis=0) + PAD, 1, size) // ALIGN) * ALIGN, size)
        left, top, width, height = (int(i) for i in (*low, *np.maximum(high - low, 1)))
        return (left, top, width, height) if width * height < WORTHWHILE * size.prod() else None

    @property
    def model(self) -> mujoco.MjModel:
        """What is drawn: the raster's own copy."""
        return self._model

    @property
    def data(self) -> mujoco.MjData:
        """Its pose."""
        return self._data

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The pieces of continua at this pose."""
        return self._layers

    @property
    def wires(self) -> list[tuple[Wire, NDArray[np.float64]]]:
        """Springs and ropes, and the points (N, 3) [m] of their axes at this pose."""
        return self._wires

    @property
    def lines(self) -> tuple[Line, ...]:
        """The beams of this pose."""
        return self._lines

    def info(self) -> dict[str, str | bool]:
        """What draws: see :meth:`render.egl.Context.info`."""
        return self._context.info()

    def close(self) -> None:
        """Free the buffers and the OpenGL context."""
        self._context.make_current()
        made = vars(self)
        for buffers in (*(made[name] for name in ("_colour", "_matter") if name in made), *made.get("_fine", ())):
            buffers.free()
        self._context.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _set_scales(self, segments: int) -> None:
        """Express the model's visual lengths in radii of the event sphere."""
        model, radius = self._model, self.sphere.radius
        model.stat.center, model.stat.extent = self.sphere.centre, radius
        model.vis.map.znear, model.vis.map.zfar = NEAR, FAR
        model.vis.map.shadowclip, model.vis.map.haze = SHADOW_REACH, HAZE
        model.vis.rgba.haze = HAZE_COLOUR
        head = model.vis.headlight
        head.ambient, head.diffuse, head.specular = AMBIENT, FRONTAL, (0.0, 0.0, 0.0)
        # a piece of thin wire counts for half a geom: else a spring would make its weight a polygon
        round_geoms = int(np.isin(model.geom_type, ROUND).sum()) + segments / 2
        slices = int(np.clip(math.sqrt(FACETS / max(round_geoms, 1)), 12, 64))
        model.vis.quality.numslices, model.vis.quality.numstacks = slices, slices // 2

    def _buffers(self, samples: int, shadow: int, larger: float = 1.0) -> mujoco.MjrContext:
        self._context.make_current()
        visual = self._model.vis
        visual.quality.offsamples, visual.quality.shadowsize = samples, shadow
        visual.global_.offwidth, visual.global_.offheight = (math.ceil(larger * side) for side in self.size)
        buffers = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        buffers.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        return buffers

    def _eye(self, pose: ArrayLike, window: Window | None = None) -> Eye:
        """A camera at a pose (4, 4), or as much of it as sees a window."""
        matrix, near = np.asarray(pose, dtype=np.float64), NEAR * self.sphere.radius
        across, down = np.array(self.size) / 2 * near / focal(self.fov, self.size)
        eye = Eye(matrix[:3, 3], matrix[:3, :3], near, -across, across, -down, down, self.size)
        return eye if window is None else eye.part(window)

    def _update(self, eye: Eye, scene: mujoco.MjvScene, options: mujoco.MjvOption, head: Eye | None = None) -> None:
        """Fill a scene with what an eye sees; head: where the head light is, if elsewhere."""
        for camera in scene.camera:
            camera.pos, camera.forward, camera.up = eye.place, -eye.axes[:, 2], eye.axes[:, 1]
            camera.frustum_near, camera.frustum_far = eye.near, FAR * self.sphere.radius
            camera.frustum_center, camera.frustum_width = (eye.left + eye.right) / 2, (eye.right - eye.left) / 2
            camera.frustum_top, camera.frustum_bottom = eye.top, eye.bottom
            camera.orthographic = 0
        # after the camera: infinite planes and the head light follow it
        mujoco.mjv_updateScene(
            self._model, self._data, options, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene
        )
        if head is not None:
            for light in scene.lights[: scene.nlight]:
                if light.headlight:
                    light.pos, light.dir = head.place, -head.axes[:, 2]
        for coil, wire in self._wires:
            if coil.tendon not in self._hidden_coils:
                _draw_wire(scene, self._slots[id(scene)], coil, wire)
        for first, layer in self._shown():
            _draw_layer(scene, self._slots[id(scene)], first, layer)
        if scene is self._colour_scene:
            self._draw_lines(scene)

    def _shown(self) -> list[tuple[int, Layer]]:
        """Layers that are not hidden, and where their triangles begin."""
        firsts = accumulate((len(layer.mesh.triangles) for layer in self._layers), initial=0)
        both = zip(firsts, self._layers, strict=False)
        return [(first, layer) for first, layer in both if self._only is None or layer.segmentation in self._only]

    def _make_scenes(self, model: mujoco.MjModel) -> None:
        self._colour_scene, self._matter_scene = (mujoco.MjvScene(model, maxgeom=self._room) for _ in range(2))
        flags = self._matter_scene.flags
        flags[:] = 0
        for flag in (
            mujoco.mjtRndFlag.mjRND_SEGMENT,
            mujoco.mjtRndFlag.mjRND_IDCOLOR,
            mujoco.mjtRndFlag.mjRND_CULL_FACE,
        ):
            flags[flag] = 1
        for scene in (self._colour_scene, self._matter_scene):
            scene.flexskinopt = 1  # triangles as they are, neither edges nor points
        self._slots = {id(scene): scene.geoms for scene in (self._colour_scene, self._matter_scene)}

    def _lay(self, layers: tuple[Layer, ...]) -> None:
        """Write the triangles of layers into both scenes."""
        self._layers = layers
        total = sum(len(layer.mesh.triangles) for layer in layers)
        if len(layers) > ROOM_FOR_LAYERS or total > ROOM_FOR_TRIANGLES:
            raise ValueError(f"{len(layers)} layers of matter with {total} triangles; allowed: {ROOM_FOR_LAYERS} with "
                             f"{ROOM_FOR_TRIANGLES}")  # fmt: skip
        if layers and self._model.nflex:
            raise ValueError(f"matter beside {self._model.nflex} deformables of MuJoCo's own; allowed: none")
        if total > self._room_for_triangles:
            self._room_for_triangles = 2 * total
            self._make_scenes(_canvas(self._room_for_triangles))
        first = 0
        for layer in layers:
            corners = layer.mesh.triangles.ravel()
            part = slice(3 * first, 3 * (first + len(corners)))
            points, normals = (values.astype(np.float32)[corners].ravel()
                               for values in (layer.mesh.points, layer.mesh.normals))  # fmt: skip
            for scene in (self._colour_scene, self._matter_scene):
                scene.flexface[part], scene.flexnormal[part] = points, normals
            first += len(corners)

    def _draw_lines(self, scene: mujoco.MjvScene) -> None:
        for line in self._lines if self._lit else ():
            _draw_line(scene, self._slots[id(scene)], line)

    def _render(
        self, eye: Eye, scene: mujoco.MjvScene, buffers: mujoco.MjrContext, *, deep: bool = False
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """What an eye sees of a scene: (H, W, 3), and if asked for what is in the depth buffer (H, W)."""
        width, height = eye.size
        self._context.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
        rect = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rect, scene, buffers)
        pixels, z = np.empty((height, width, 3), np.uint8), np.empty((height, width) if deep else (1, 1), np.float32)
        mujoco.mjr_readPixels(pixels, z if deep else None, rect, buffers)
        return np.asarray(cv2.flip(pixels, 0), dtype=np.uint8), np.asarray(cv2.flip(z, 0), dtype=np.float32)

    def _picture(self, eye: Eye, head: Eye, buffers: mujoco.MjrContext) -> NDArray[np.uint8]:
        self._update(eye, self._colour_scene, self._colour_options, head)
        return self._render(eye, self._colour_scene, buffers)[0]

    @property
    def multisamples(self) -> int:
        """Of the colour picture, as the driver gave them; 0 is none."""
        return int(self._colour.offSamples)

    @cached_property
    def _colour(self) -> mujoco.MjrContext:
        """For colour pictures; made when the first one is asked for."""
        return self._buffers(*self._quality)

    @cached_property
    def _matter(self) -> mujoco.MjrContext:
        """For depth and segmentation, likewise."""
        return self._buffers(0, 0)

    @cached_property
    def _fine(self) -> tuple[mujoco.MjrContext, mujoco.MjrContext]:
        """Larger buffers, for the images in mirrors and for the shares of mirrors in pixels."""
        samples, shadow = self._quality
        return self._buffers(samples, shadow // 2, 1.5), self._buffers(0, 0, 2.0)

    def _put_images(self, picture: NDArray[np.uint8], eye: Eye, head: Eye, orders: int) -> None:
        """Lay into an eye's picture what its mirrors show, by up to so many reflections."""
        least = mirrors.GRAZING * self.sphere.radius
        facing = [mirror for mirror in self._mirrors if mirror.before(eye.place) > least]
        corners = [geom_corners(self._model, self._data, np.array(mirror.geoms)) for mirror in facing]
        window = mirrors.hull([own for ends in corners if (own := eye.window(ends))])
        fewest = mirrors.FEWEST if eye is head else mirrors.FEWEST_AGAIN
        if window is None or window[2] * window[3] < fewest:
            return
        glass, _ = self._fine
        shares = self._shares(eye, window, list(zip(facing, corners, strict=True)), fewest)
        for mirror, ends, share in zip(facing, corners, shares, strict=True):
            if share is None:
                continue
            image = Image.of(mirror, eye, share, ends, (glass.offWidth, glass.offHeight))
            shown = self._picture(image.eye, head, glass)
            if orders > 1:
                self._put_images(shown, image.eye, head, orders - 1)
            image.lay(shown, picture, share)

    def _shares(
        self, eye: Eye, window: Window, facing: list[tuple[Mirror, NDArray[np.float64]]], fewest: float
    ) -> list[Share | None]:
        """How much of each pixel inside a window is each mirror's, seen from its front and not hidden; None for a
        mirror that has fewer pixels than `fewest`. The mirrors come with the corners (N, 3) [m] of their geoms.

        What is translucent takes away as much as it hides, if no two such things are before one another.
        """
        _, buffers = self._fine
        times = SUBPIXELS
        while times > 1 and (window[2] * times > buffers.offWidth or window[3] * times > buffers.offHeight):
            times //= 2
        part = eye.part(window).finer(times)
        scene, slots = self._matter_scene, self._slots[id(self._matter_scene)]
        number = {geom: k + 2 for k, geom in enumerate(sorted({face.geom for face in self._faces}))}
        kind = mujoco.mjtObj.mjOBJ_GEOM.value

        # a picture of numbers: the mirrors' geoms have one each, all others that hide what is behind them have 1
        self._update(part, scene, self._matter_options)
        veiled = bool(self._lines) and self._lit
        for geom in slots[: scene.ngeom]:
            label = number.get(geom.objid, 1) if geom.objtype == kind else 1
            translucent = float(geom.rgba[3]) < OPAQUE
            veiled |= translucent
            geom.segid = -1 if translucent else label - 1
        shown, z = self._render(part, scene, buffers, deep=True)
        labels, depth = cv2.extractChannel(shown, 0), self._metres(z, part.near)

        clear: NDArray[np.float32] = np.ones(depth.shape, np.float32)
        if veiled or self._immaterial:
            self._update(part, scene, self._colour_options)
            self._draw_lines(scene)
            for geom in slots[: scene.ngeom]:
                whole = geom.objtype == kind and geom.objid in number
                layers = 1 if geom.type == mujoco.mjtGeom.mjGEOM_PLANE.value else 2  # MuJoCo draws the far side too
                geom.segid = 254 if whole else round(254 * (1 - min(float(geom.rgba[3]), 1.0)) ** layers)
            clear[:] = cv2.extractChannel(self._render(part, scene, buffers)[0], 0)
            clear -= 1
            clear /= 254
        shares: list[Share | None] = []
        for mirror, corners in facing:
            own = eye.window(corners)
            if own is None:
                shares.append(None)
                continue
            left, top = own[0] - window[0], own[1] - window[1]
            fine = slice(top * times, (top + own[3]) * times), slice(left * times, (left + own[2]) * times)
            weights = np.zeros((256, 1), np.float32)
            weights[[number[geom] for geom in mirror.geoms]] = 1
            height = eye.part(own).finer(times).heights(mirror, depth[fine])
            here = cv2.multiply(cv2.LUT(labels[fine], weights), clear[fine])
            mine = np.where(np.abs(height) < ON_FACE * self.sphere.radius, here, 0)
            weight = cv2.resize(mine, own[2:], interpolation=cv2.INTER_AREA)
            shares.append(Share.of(np.asarray(weight, np.float32), *own[:2], fewest))
        return shares

    def _show(self, geoms: NDArray[np.bool_], tendons: NDArray[np.bool_], coils: Collection[Wire]) -> None:
        self._model.geom_group[:] = np.where(geoms, self._groups, HIDDEN)
        self._model.tendon_group[:] = np.where(tendons, self._tendon_groups, HIDDEN)
        self._hidden_coils = frozenset(coil.tendon for coil in self.coils if coil not in coils)
        self._lut = None

    def _moving_extent(self) -> NDArray[np.float64]:
        """Points (N, 3) [m] whose hull holds all that can move and all its shadows."""
        model, data = self._model, self._data
        seen = self._groups != HIDDEN
        moving = np.flatnonzero(self._moving & seen)
        points = [geom_corners(model, data, moving)]
        for coil, wire in self._wires:
            points += [wire - 2 * coil.wire, wire + 2 * coil.wire]
        for tendon in np.flatnonzero(self._tendon_groups != HIDDEN):
            start = data.ten_wrapadr[tendon]
            path = data.wrap_xpos.reshape(-1, 3)[start : start + data.ten_wrapnum[tendon]]
            width = 2 * model.tendon_width[tendon]
            points += [path - width, path + width]
        for layer in self._layers:
            low, high = layer.mesh.points.min(axis=0), layer.mesh.points.max(axis=0)
            points.append(np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3))
        bodies = np.concatenate(points)
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE.value
        depths = [data.geom_xpos[plane & seen, 2], geom_corners(model, data, np.flatnonzero(seen & ~plane))[:, 2]]
        lowest = np.concatenate(depths).min(initial=np.inf)
        shadows = [
            bodies + np.maximum(bodies[:, 2:] - lowest, 0) / -way[2] * way
            for way in data.light_xdir[model.light_castshadow.astype(bool)]
        ]
        glows = [line.points + side * SPOT * line.radius for line in self._lines for side in (-1, 1)]
        return np.concatenate([bodies, *shadows, *glows])

    def _ids_by_colour(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Table from the colour of the identity pass, one more than the scene's geom index, to segmentation id."""
        table = np.zeros(scene.ngeom + 1, np.uint8)
        known = {mujoco.mjtObj.mjOBJ_GEOM.value: self._ids, mujoco.mjtObj.mjOBJ_TENDON.value: self._tendon_ids}
        for geom in self._slots[id(scene)][: scene.ngeom]:
            if geom.objtype in known:
                table[geom.segid + 1] = known[geom.objtype][geom.objid]
        shown = [(coil, wire) for coil, wire in self._wires if coil.tendon not in self._hidden_coils]
        wires = [coil.segmentation for coil, wire in shown for _ in wire[1:]]
        own = wires + [layer.segmentation for _, layer in self._shown()]
        table[len(table) - len(own) :] = own
        return table

    def _metres(self, z: NDArray[np.float32], nearest: float) -> NDArray[np.float32]:
        """Planar depth of a reversed depth buffer, 1 at the near plane and 0 at the far one."""
        near, far = np.float32(nearest), np.float32(FAR * self.sphere.radius)
        empty = z <= 0
        z *= far - near
        z += near
        np.divide(near * far, z, out=z)
        z[empty] = SKY
        return z


class Free:
    """A camera at `pose` (4, 4) that draws the whole picture."""

    def __init__(self, raster: Raster, pose: ArrayLike) -> None:
        self.raster, self.pose = raster, np.asarray(pose, dtype=np.float64)

    def colour(self) -> NDArray[np.uint8]:
        """See :meth:`Raster.colour`."""
        return self.raster.colour(self.pose)

    def depth_and_segmentation(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """See :meth:`Raster.depth_and_segmentation`."""
        return self.raster.depth_and_segmentation(self.pose)


class Still(Free):
    """A standing camera: the same pictures for less, if the raster is separable.

    What never moves is drawn once; of each picture, only the window in which something moves, and what mirrors show. A
    window is rounded differently from a whole picture, so that single pixels on edges may fall to the other side.
    """

    def colour(self) -> NDArray[np.uint8]:
        """See :meth:`Raster.colour`."""
        window = self.raster.window(self.pose)
        if window is None:
            return super().colour()
        picture = self._colour_plate.copy()
        picture[_inside(window)] = self.raster.without_images(self.pose, window)
        self.raster.put_images(picture, self.pose)
        return picture

    def depth_and_segmentation(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """See :meth:`Raster.depth_and_segmentation`."""
        window = self.raster.window(self.pose)
        if window is None:
            return super().depth_and_segmentation()
        depth, seg = self._matter_plate[0].copy(), self._matter_plate[1].copy()
        depth[_inside(window)], seg[_inside(window)] = self.raster.depth_and_segmentation(self.pose, window)
        return depth, seg

    @cached_property
    def _colour_plate(self) -> NDArray[np.uint8]:
        self.raster.show_static()
        plate = self.raster.without_images(self.pose)
        self.raster.show_only(None)
        return plate

    @cached_property
    def _matter_plate(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        self.raster.show_static()
        plate = self.raster.depth_and_segmentation(self.pose)
        self.raster.show_only(None)
        return plate


def moving_geoms(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms (ngeom,) are on a body that can move: with a joint at or above it, or mocap."""
    mocap = model.body_mocapid[model.body_rootid[model.geom_bodyid]] >= 0
    return np.asarray((model.body_weldid[model.geom_bodyid] != 0) | mocap)


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.float64]:
    """Corners (8 N, 3) [m] of the bounding boxes of some geoms (N,), given as ids, at the data's pose."""
    signs = np.array(list(product((-1, 1), repeat=3)))
    boxes = model.geom_aabb[geoms, None, :3] + signs * model.geom_aabb[geoms, None, 3:]
    turned = np.einsum("gij,gcj->gci", data.geom_xmat[geoms].reshape(-1, 3, 3), boxes)
    return np.asarray((data.geom_xpos[geoms, None] + turned).reshape(-1, 3), dtype=np.float64)


def _inside(window: Window) -> tuple[slice, slice]:
    left, top, width, height = window
    return slice(top, top + height), slice(left, left + width)


def _checked(ids: ArrayLike, count: int, name: str) -> NDArray[np.uint8]:
    values = np.asarray(ids)
    if values.shape != (count,) or values.dtype.kind not in "iu":
        raise ValueError(f"{name} must be ({count},) integers, got {values.shape} {values.dtype}")
    if count and not (values.min() >= 0 and values.max() <= LAST_ID):
        raise ValueError(f"{name} must lie in 0 to {LAST_ID}, got {values.min()} to {values.max()}")
    return values.astype(np.uint8)


def _known(faces: tuple[Face, ...], ngeom: int) -> tuple[Face, ...]:
    for face in faces:
        if not 0 <= face.geom < ngeom:
            raise ValueError(f"a mirror names geom {face.geom}, the model has {ngeom}")
    if len({face.geom for face in faces}) > LAST_ID:
        raise ValueError(f"at most {LAST_ID} geoms can be mirrors, got {len({face.geom for face in faces})}")
    return faces


def _end_sites(model: mujoco.MjModel, tendon: int) -> tuple[int, int]:
    if not 0 <= tendon < model.ntendon:
        raise ValueError(f"a coil names tendon {tendon}, the model has {model.ntendon}")
    start = model.tendon_adr[tendon]
    wraps = slice(start, start + model.tendon_num[tendon])
    sites = model.wrap_objid[wraps][model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_SITE.value]
    if len(sites) < 2:
        raise ValueError(f"a coil needs a spatial tendon with two sites, tendon {tendon} has {len(sites)}")
    return int(sites[0]), int(sites[-1])


def _options(*hidden: int) -> mujoco.MjvOption:
    options = mujoco.MjvOption()
    for groups in (options.geomgroup, options.tendongroup, options.flexgroup, options.skingroup):
        groups[:] = 1
        groups[list(hidden)] = 0
    options.sitegroup[:] = 0
    options.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = 0
    return options


def _draw_wire(scene: mujoco.MjvScene, slots: list[mujoco.MjvGeom], coil: Wire, wire: NDArray[np.float64]) -> None:
    shape, colour = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(coil.rgba, np.float32)
    for start, end in pairwise(wire):
        geom = slots[scene.ngeom]
        mujoco.mjv_initGeom(geom, shape, np.zeros(3), np.zeros(3), np.zeros(9), colour)
        mujoco.mjv_connector(geom, shape, coil.wire, start, end)
        geom.category, geom.objtype, geom.objid = mujoco.mjtCatBit.mjCAT_DECOR, mujoco.mjtObj.mjOBJ_UNKNOWN, -1
        geom.specular, geom.shininess = (0.6, 0.6) if isinstance(coil, Coil) else (0.1, 0.1)
        geom.segid = scene.ngeom
        scene.ngeom += 1


def _draw_layer(scene: mujoco.MjvScene, slots: list[mujoco.MjvGeom], first: int, layer: Layer) -> None:
    geom, colour = slots[scene.ngeom], np.array(layer.rgba, np.float32)
    # of no radius: else the canvas' vertices and edges are drawn too, wherever its memory happens to have them
    part = np.array([0.0, first, len(layer.mesh.triangles)])
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_FLEX, part, np.zeros(3), np.eye(3).ravel(), colour)
    geom.category, geom.objtype = mujoco.mjtCatBit.mjCAT_DYNAMIC, mujoco.mjtObj.mjOBJ_FLEX
    geom.objid = geom.dataid = 0
    geom.matid = -1
    geom.specular, geom.shininess = layer.finish.specular, layer.finish.shininess
    geom.segid = scene.ngeom
    scene.ngeom += 1


def _draw_line(scene: mujoco.MjvScene, slots: list[mujoco.MjvGeom], line: Line) -> None:
    colour, shape, spot = np.array(line.rgba, np.float32), mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
    pieces = list(pairwise(line.points))[: min(ROOM_FOR_BEAMS, len(slots) - scene.ngeom - 1)]
    for start, end in [*pieces, (line.points[-1], None)]:
        geom = slots[scene.ngeom]
        size, place = np.full(3, SPOT * line.radius), np.array(line.points[-1], np.float64)
        mujoco.mjv_initGeom(geom, spot if end is None else shape, size, place, np.eye(3).ravel(), colour)
        if end is not None:
            mujoco.mjv_connector(geom, shape, line.radius, start, end)
        geom.category, geom.objtype, geom.objid = mujoco.mjtCatBit.mjCAT_DECOR, mujoco.mjtObj.mjOBJ_UNKNOWN, -1
        geom.emission, geom.specular = 1.0, 0.0
        geom.segid = scene.ngeom
        scene.ngeom += 1
