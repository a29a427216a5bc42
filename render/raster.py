"""Pictures of one posed MuJoCo model: colour, planar depth, segmentation, from any camera pose.

Classic MuJoCo rendering with two contexts. Colour is multisampled and shadowed. Depth and segmentation come together
from one pass without multisampling: read from a multisampled pass, depth is off by 2 mm in the median and by more than
5 cm along edges, where samples of two surfaces are mixed.

Geom groups: 3 is never drawn (collision proxies); 4 is drawn in colour alone (beams, wind, field arrows: what is not
matter); all others are matter. Sites are never drawn.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise
from types import TracebackType
from typing import Self

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from render.egl import Context
from render.encode import SKY
from render.rig import FOV, Sphere

HIDDEN, IMMATERIAL = 3, 4
LAST_ID = 254
NEAR, FAR = 0.02, 60.0
"""Clipping planes in radii of the event sphere; the reversed 32-bit depth buffer resolves 1e-6 of the distance."""

SHADOW_REACH = 2.5
"""Half the width of the shadow map, in radii of the event sphere."""

FACETS = 150_000
"""Triangles that all round primitives together may take; decides how finely each is tessellated."""

SEGMENTS_PER_TURN = 14

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

    def wind(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 3) [m] of the wire's axis when the spring hangs between `start` (3,) and `end` (3,) [m]."""
        span = end - start
        along = span / max(float(np.linalg.norm(span)), 1e-9)
        side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        side /= np.linalg.norm(side)
        return np.asarray(start + self.helix @ np.stack([side, np.cross(along, side), span]), dtype=np.float64)


class Raster:
    """Draws one model; owns a copy of it, its pose, and two OpenGL contexts' worth of buffers.

    Args:
        model: compiled model; it is copied, never changed.
        size: (W, H) [pixel].
        ids: (ngeom,) segmentation id of each geom, 0 to 254; 0 is the background, which still has depth.
        sphere: event sphere; lights, shadows and clipping planes are set relative to it.
        fov: horizontal field of view [rad].
        tendon_ids: (ntendon,) segmentation ids; a tendon without one is drawn in colour alone. None is all 0.
        coils: springs drawn in place of their tendons.
        samples: multisamples of the colour picture; 0 is none.
        shadow: width of the shadow map [texel]; 0 is no shadows.

    Raises:
        NoGL: there is no driver.
        ValueError: ids of the wrong shape or range, or a coil on a tendon that does not exist or has no two end sites.
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
        coils: Collection[Coil] = (),
        samples: int = 4,
        shadow: int = 2048,
    ) -> None:
        self.size, self.fov, self.sphere, self.coils = size, fov, sphere, tuple(coils)
        self._ids = _checked(ids, model.ngeom, "ids")
        self._tendon_ids = _checked(
            np.zeros(model.ntendon, int) if tendon_ids is None else tendon_ids, model.ntendon, "tendon_ids"
        )
        self._model = copy.copy(model)
        self._ends = [_end_sites(model, coil.tendon) for coil in self.coils]
        self._model.tendon_group[:] = np.where(self._tendon_ids > 0, 0, IMMATERIAL)
        self._model.tendon_group[[coil.tendon for coil in self.coils]] = HIDDEN
        # a floor shadows nothing above it, and as a caster it speckles itself
        casts_none = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE.value) | (model.geom_group == IMMATERIAL)
        self._model.geom_castshadow[casts_none] = 0
        self._groups = self._model.geom_group.copy()
        self._data = mujoco.MjData(self._model)
        self._wires: list[tuple[Coil, NDArray[np.float64]]] = []

        segments = sum(len(coil.helix) for coil in self.coils)
        self._set_scales(segments)
        self._context = Context()
        self._colour = self._buffers(samples, shadow)
        self._matter = self._buffers(0, 0)
        room = model.ngeom + segments + 64 * model.ntendon + 1000
        self._colour_scene, self._matter_scene = (mujoco.MjvScene(self._model, maxgeom=room) for _ in range(2))
        flags = self._matter_scene.flags
        flags[:] = 0
        for flag in (
            mujoco.mjtRndFlag.mjRND_SEGMENT,
            mujoco.mjtRndFlag.mjRND_IDCOLOR,
            mujoco.mjtRndFlag.mjRND_CULL_FACE,
        ):
            flags[flag] = 1
        self._colour_options, self._matter_options = _options(HIDDEN), _options(HIDDEN, IMMATERIAL)
        self._eye = mujoco.MjvCamera()
        self._eye.type = mujoco.mjtCamera.mjCAMERA_USER
        self._rect = mujoco.MjrRect(0, 0, *size)
        self._lut: NDArray[np.uint8] | None = None
        self.pose(self._data.qpos)

    def pose(self, qpos: ArrayLike, mocap_pos: ArrayLike | None = None, mocap_quat: ArrayLike | None = None) -> None:
        """Move the model: `qpos` (nq,), and where it has mocap bodies `mocap_pos` (nmocap, 3) and `mocap_quat`."""
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
        self._lut = None

    def colour(self, pose: ArrayLike) -> NDArray[np.uint8]:
        """The (H, W, 3) RGB picture from a camera pose (4, 4)."""
        scene, buffers = self._colour_scene, self._colour
        self._render(pose, scene, buffers, self._colour_options)
        pixels = np.empty((self.size[1], self.size[0], 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, buffers)
        return np.asarray(cv2.flip(pixels, 0), dtype=np.uint8)

    def depth_and_segmentation(self, pose: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Planar depth (H, W) [m], SKY where nothing is hit, and ids (H, W), from a camera pose (4, 4)."""
        scene, buffers = self._matter_scene, self._matter
        self._render(pose, scene, buffers, self._matter_options)
        if self._lut is None:
            self._lut = self._ids_by_colour(scene)
        pixels = np.empty((self.size[1], self.size[0], 3), np.uint8)
        z = np.empty((self.size[1], self.size[0]), np.float32)
        mujoco.mjr_readPixels(pixels, z, self._rect, buffers)
        shown = cv2.flip(pixels, 0)
        if len(self._lut) <= 256:
            table = np.zeros(256, np.uint8)
            table[: len(self._lut)] = self._lut
            seg = cv2.LUT(cv2.extractChannel(shown, 0), table)
        else:
            seg = self._lut[shown.astype(np.uint32) @ np.array([1, 1 << 8, 1 << 16], np.uint32)]
        z = np.asarray(cv2.flip(z, 0), dtype=np.float32)
        return self._metres(z), np.asarray(seg, dtype=np.uint8)

    def show_only(self, ids: Collection[int] | None) -> None:
        """Hide all geoms whose id is not in `ids`, in every later picture; None shows all again."""
        self._model.geom_group[:] = self._groups
        if ids is not None:
            self._model.geom_group[~np.isin(self._ids, list(ids))] = HIDDEN
        self._lut = None

    def info(self) -> dict[str, str | bool]:
        """What draws: see :meth:`render.egl.Context.info`."""
        return self._context.info()

    def close(self) -> None:
        """Free the buffers and the OpenGL context."""
        self._context.make_current()
        self._colour.free()
        self._matter.free()
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
        model.vis.global_.offwidth, model.vis.global_.offheight = self.size
        round_geoms = int(np.isin(model.geom_type, ROUND).sum()) + segments
        slices = int(np.clip(math.sqrt(FACETS / max(round_geoms, 1)), 12, 64))
        model.vis.quality.numslices, model.vis.quality.numstacks = slices, slices // 2

    def _buffers(self, samples: int, shadow: int) -> mujoco.MjrContext:
        self._model.vis.quality.offsamples, self._model.vis.quality.shadowsize = samples, shadow
        buffers = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        buffers.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        return buffers

    def _render(
        self, pose: ArrayLike, scene: mujoco.MjvScene, buffers: mujoco.MjrContext, options: mujoco.MjvOption
    ) -> None:
        matrix = np.asarray(pose, dtype=np.float64)
        radius = self.sphere.radius
        near, half = NEAR * radius, NEAR * radius * math.tan(self.fov / 2)
        for eye in scene.camera:
            eye.pos, eye.forward, eye.up = matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1]
            eye.frustum_near, eye.frustum_far = near, FAR * radius
            eye.frustum_center, eye.frustum_width = 0, half
            eye.frustum_top = half * self.size[1] / self.size[0]
            eye.frustum_bottom = -eye.frustum_top
            eye.orthographic = 0
        # after the camera: infinite planes and the head light follow it
        mujoco.mjv_updateScene(
            self._model, self._data, options, None, self._eye, mujoco.mjtCatBit.mjCAT_ALL.value, scene
        )
        for coil, wire in self._wires:
            _draw_wire(scene, coil, wire)
        self._context.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
        mujoco.mjr_render(self._rect, scene, buffers)

    def _ids_by_colour(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Table from the colour of the identity pass, one more than the scene's geom index, to segmentation id."""
        table = np.zeros(scene.ngeom + 1, np.uint8)
        known = {mujoco.mjtObj.mjOBJ_GEOM.value: self._ids, mujoco.mjtObj.mjOBJ_TENDON.value: self._tendon_ids}
        coil_ids = iter([coil.segmentation for coil, wire in self._wires for _ in wire[1:]])
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype in known:
                table[geom.segid + 1] = known[geom.objtype][geom.objid]
            elif geom.category == mujoco.mjtCatBit.mjCAT_DECOR and geom.objtype == mujoco.mjtObj.mjOBJ_UNKNOWN:
                table[geom.segid + 1] = next(coil_ids)
        return table

    def _metres(self, z: NDArray[np.float32]) -> NDArray[np.float32]:
        """Planar depth of a reversed depth buffer, 1 at the near plane and 0 at the far one."""
        near, far = np.float32(NEAR * self.sphere.radius), np.float32(FAR * self.sphere.radius)
        empty = z <= 0
        z *= far - near
        z += near
        np.divide(near * far, z, out=z)
        z[empty] = SKY
        return z


def _checked(ids: ArrayLike, count: int, name: str) -> NDArray[np.uint8]:
    values = np.asarray(ids)
    if values.shape != (count,) or values.dtype.kind not in "iu":
        raise ValueError(f"{name} must be ({count},) integers, got {values.shape} {values.dtype}")
    if count and not (values.min() >= 0 and values.max() <= LAST_ID):
        raise ValueError(f"{name} must lie in 0 to {LAST_ID}, got {values.min()} to {values.max()}")
    return values.astype(np.uint8)


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


def _draw_wire(scene: mujoco.MjvScene, coil: Coil, wire: NDArray[np.float64]) -> None:
    shape, colour = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(coil.rgba, np.float32)
    for start, end in pairwise(wire):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, shape, np.zeros(3), np.zeros(3), np.zeros(9), colour)
        mujoco.mjv_connector(geom, shape, coil.wire, start, end)
        geom.category, geom.objtype, geom.objid = mujoco.mjtCatBit.mjCAT_DECOR, mujoco.mjtObj.mjOBJ_UNKNOWN, -1
        geom.specular, geom.shininess = 0.6, 0.6
        geom.segid = scene.ngeom
        scene.ngeom += 1
