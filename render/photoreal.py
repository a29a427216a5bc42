"""Path-traced colour pictures: the same posed scene, cameras and materials as the rasteriser's, by Mitsuba 3.

Depth and segmentation stay the rasteriser's. Three pictures are made and laid together:

    daylight   what there is, lit by the sun and the sky: paths from the eye;
    caustics   what only particles of light find: from `Lamp`s, and from the sun by way of mirrors and glass;
    overlay    beams and what else is no matter, drawn over it, in mirrors and through glass too: seen, without shadow.

The sum of the first two is denoised, guided by the rasteriser's picture.

Colours of a scene are meant as they are seen, so they are decoded from sRGB before light is calculated and the
picture is encoded at the end. The sky's gradient, palest above the horizon, is the light from everywhere. A lamp of
MuJoCo that casts shadows is a sun of its direction and strength, as wide as the real one; one that casts none is a
filling light, which the sky makes superfluous. Of a material, colour, texture, specular and shininess are read; from a
specular of 0.55 on it is a metal.

Defects: three colours, no spectrum, so glass does not disperse. Caustics are seen directly, not again in a mirror or
through glass, nor in translucent matter; those of the sun take what makes them to be as large as its convex outline,
and all of it in the sun if its middle is. A lamp's opening hides the caustics behind it. Beams light nothing.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from physinone_mj.scene import Conic, Dielectric, Lamp, Mirror
from render import shapes
from render.mirrors import REFLECTIVITY
from render.raster import FAR, HIDDEN, IMMATERIAL, SPOT, Coil, Raster
from render.shapes import Mesh
from render.surface import Layer

Array = NDArray[np.float64]

EXTRA: Final = "pip install 'physinone-mj[photoreal]'"

SUN: Final = (4.6, 4.2, 3.75)
"""Irradiance of the sun for a diffuse light of 1 in MuJoCo; π lets a white surface be seen as white. With the blue of
the sky, it adds up to about 1 and to no colour on level ground."""
SUN_RADIUS: Final = math.radians(0.27)
SUNS: Final = 16
"""Points of the sun's disc that shine: directions, not areas, so that smooth mirrors make no bright specks."""

SKY: Final = 0.9
"""Radiance of the sky where it is seen as white."""
PALE: Final = 0.3
"""How much of the sky's colour is taken away: the zenith would make shadows bluer than cameras show them."""

METAL: Final = 0.55
"""Specular of a material from which it is a metal."""

PASSING: Final = 0.5
"""Part of the light that a translucent surface does not hold back that passes it; the rest is scattered: no light from
the sun is found through a surface that refracts it."""

LONGEST: Final = 16
"""Edges of a path of light, at most."""

OVERLAY_SAMPLES: Final = 16
PATTERN: Final = (6.0, 20.0)
"""Where the floor's pattern begins to fade, and where it is gone, in radii of the event sphere."""

CHORDS: Final = 192
"""Squares across a curved mirror, either way; its normals are exact, its place within 2e-5 of its radius."""

PARTICLES: Final = 0.25
"""Particles of light per path of the scene, for caustics."""

GRAZING: Final = 0.05
"""Cosine below which a mirror is taken to turn its back to the sun."""

SHOULDER: Final = 0.8
"""Linear brightness above which it is pressed together, so that white keeps shades."""


class NoMitsuba(ImportError):
    """The optional library that traces paths is not installed; the message says how to install it."""


def require() -> None:
    """Raise NoMitsuba unless the extra is installed."""
    if importlib.util.find_spec("mitsuba") is None:
        raise NoMitsuba(f"the photoreal renderer needs Mitsuba 3, which is not installed: {EXTRA}")


@dataclass(frozen=True)
class Look:
    """How to trace paths.

    samples: paths per pixel; seed: every picture's noise follows from it and from the number of its view and frame
    mirrors, dielectrics, lamps: of the scene, by names in the model
    """

    samples: int
    seed: tuple[int, ...] = (0,)
    mirrors: tuple[Mirror | Conic, ...] = ()
    dielectrics: tuple[Dielectric, ...] = ()
    lamps: tuple[Lamp, ...] = ()


@dataclass
class _Kept:
    """A shape as it was last made, and where."""

    place: Array
    shapes: dict[str, Any] = field(default_factory=dict)


class Studio:
    """Traces pictures of what a raster draws, at the raster's pose.

    Raises NoMitsuba; KeyError if a name is not in the model; ValueError for geoms that cannot be triangles.
    """

    def __init__(self, raster: Raster, look: Look) -> None:
        require()
        self.raster, self.look = raster, look
        model = raster.model
        self._mi = _mitsuba()
        self._flat: dict[int, list[tuple[Array, Array]]] = {}
        self._silvered: set[int] = set()
        self._conics: dict[int, list[Conic]] = {}
        for mirror in look.mirrors:
            geom = int(model.geom(mirror.geom).id)
            if isinstance(mirror, Conic):
                self._conics.setdefault(geom, []).append(mirror)
            elif mirror.point is None:
                self._silvered.add(geom)
            else:
                self._flat.setdefault(geom, []).append((np.array(mirror.point), np.array(mirror.normal)))
        self._index = {int(model.geom(glass.geom).id): glass.index for glass in look.dielectrics}
        self._lamps = [(int(model.site(lamp.site).id), lamp) for lamp in look.lamps]
        self._materials: dict[Any, Any] = {}
        self._kept: dict[tuple[int, bool], _Kept] = {}

    def colour(self, pose: ArrayLike, number: tuple[int, ...] = ()) -> NDArray[np.uint8]:
        """The (H, W, 3) RGB picture from a camera pose (4, 4); `number`: of the view and frame, for its noise."""
        seeds = np.random.SeedSequence([*self.look.seed, *number]).generate_state(4)
        camera = self._camera(pose)
        light = self._daylight(camera, seeds[:2].tolist()) + self._caustics(camera, int(seeds[2]))
        if denoises():
            light = _denoised(light, self.raster.colour(pose))
        for colours, cover in self._overlay(camera, int(seeds[3])):
            for channel, (*rgb, alpha) in enumerate(colours):
                there = alpha * np.minimum(cover[..., channel, None], 1)
                light = light * (1 - there) + there * decoded(rgb)
        return encoded(light)

    def info(self) -> str:
        """What traces: library, variant, samples per pixel and denoiser."""
        denoiser = "OIDN" if denoises() else "no denoiser"
        return f"Mitsuba {self._mi.__version__} {self._mi.variant()}, {self.look.samples} samples, {denoiser}"

    def _camera(self, pose: ArrayLike) -> Any:
        width, height = self.raster.size
        # Mitsuba's cameras look along z, x to the left
        turned = np.asarray(pose, float) @ np.diag([-1.0, 1.0, -1.0, 1.0])
        return self._mi.load_dict({
            "type": "perspective", "fov_axis": "x", "fov": math.degrees(self.raster.fov), "near_clip": 1e-3,
            "far_clip": 1e4, "to_world": self._mi.ScalarTransform4f(turned), "sampler": {"type": "independent"},
            "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
        })  # fmt: skip

    def matter(self, *, black: bool = False) -> dict[str, Any]:
        """All matter at the raster's pose, for a Mitsuba scene: shapes "geom<i>" and "geom<i>/<part>", "tendon<i>",
        "wire<i>", "layer<i>". `black`: mirrors and glass as they are, all else dark."""
        model, data, found = self.raster.model, self.raster.data, {}
        for geom in range(model.ngeom):
            if model.geom_group[geom] in (HIDDEN, IMMATERIAL) or self._rgba(geom)[3] == 0:
                continue
            place = np.concatenate([data.geom_xpos[geom], data.geom_xmat[geom]])
            kept = self._kept.get((geom, black))
            if kept is None or not np.array_equal(kept.place, place):
                kept = self._kept[geom, black] = _Kept(place, dict(self._geom(geom, black)))
            found.update(kept.shapes)
        for tendon, path in self._ropes():
            colour = self._plain(tuple(model.tendon_rgba[tendon]), 0.1, 0.1, black)
            found[f"tendon{tendon}"] = self._mesh(shapes.tube(path, float(model.tendon_width[tendon])), colour)
        for number, (wire, path) in enumerate(self.raster.wires):
            polish = 0.6 if isinstance(wire, Coil) else 0.1
            found[f"wire{number}"] = self._mesh(
                shapes.tube(path, wire.wire), self._plain(wire.rgba, polish, polish, black)
            )
        for number, layer in enumerate(self.raster.layers):
            if not layer.inside:
                found[f"layer{number}"] = self._mesh(layer.mesh, self._stuff(layer, black))
        return found

    def _stuff(self, layer: Layer, black: bool) -> Any:
        """What a piece of a continuum is made of; what is translucent lets some light in and out again, tinted."""
        if black:
            return self._plain((*layer.rgba[:3], 1.0), 0.0, 0.0, True)
        if (key := (layer.rgba, layer.finish)) not in self._materials:
            finish = layer.finish
            surface: dict[str, Any] = {
                "type": "principled", "base_color": self._paint(layer.rgba, -1), "roughness": finish.roughness,
                "specular": 0.5, "clearcoat": finish.coat, "clearcoat_gloss": 0.95,
                "spec_trans": PASSING * (1 - layer.rgba[3]),
            }  # fmt: skip
            self._materials[key] = self._mi.load_dict(
                {"type": "twosided", "bsdf": surface} if layer.rgba[3] == 1 else surface
            )
        return self._materials[key]

    def _ropes(self, group: int = 0) -> Iterator[tuple[int, Array]]:
        """Tendons of a group that are drawn as they are, and their paths."""
        model, data = self.raster.model, self.raster.data
        for tendon in np.flatnonzero(model.tendon_group == group):
            start, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
            ends = data.wrap_obj.ravel()[start : start + count]
            path = data.wrap_xpos.reshape(-1, 3)[start : start + count]
            for piece in np.split(np.arange(count), np.flatnonzero(ends == -2)):
                points = path[piece[ends[piece] != -2]]
                if len(points) > 1:
                    yield int(tendon), points

    def _geom(self, geom: int, black: bool) -> Iterator[tuple[str, Any]]:
        """The shapes of a geom, by their names: one, or its mirrors and the rest of it."""
        model, data, name = self.raster.model, self.raster.data, f"geom{geom}"
        kind = int(model.geom_type[geom])
        place, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        if kind == mujoco.mjtGeom.mjGEOM_PLANE.value and not model.geom_size[geom, :2].all():
            yield from self._floor(name, geom, black)
            return
        plain, whole = self._material(geom, black), geom in self._silvered
        faced = geom in self._flat or geom in self._conics
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE.value and shapes.texture_of(model, geom) < 0 and not faced:
            transform = np.eye(4)
            transform[:3, :3], transform[:3, 3] = turn * model.geom_size[geom, 0], place
            surface = self._mirror() if whole else plain
            yield name, self._mi.load_dict(
                {"type": "sphere", "to_world": self._mi.ScalarTransform4f(transform), "bsdf": surface}
            )
            return
        mesh = shapes.of_geom(model, geom).placed(place, turn)
        if whole:
            yield name, self._mesh(mesh, self._mirror())
            return
        mirrors, rest = self._faces(geom, mesh)
        for number, face in enumerate(mirrors):
            yield f"{name}/mirror{number}", self._mesh(face, self._mirror())
        if len(rest.triangles):
            yield name, self._mesh(rest, plain)

    def _faces(self, geom: int, mesh: Mesh) -> tuple[list[Mesh], Mesh]:
        """The faces of a placed geom that are mirrors, and the rest."""
        model, data, mirrors = self.raster.model, self.raster.data, []
        rest = np.ones(len(mesh.triangles), bool)
        body = model.geom_bodyid[geom]
        centres, normals = mesh.faces()
        slack = 1e-4 * float(np.ptp(mesh.points, axis=0).max())
        for point, normal in self._flat.get(geom, ()):
            turn = data.xmat[body].reshape(3, 3)
            outward = turn @ normal
            chosen = (normals @ outward > 0.999) & (abs((centres - data.xpos[body] - turn @ point) @ outward) < slack)
            face = mesh.only(chosen)
            # a plane has one normal: MuJoCo rounds edges off by averaging
            mirrors.append(Mesh(face.points, face.triangles, np.broadcast_to(outward, face.points.shape)))
            rest &= ~chosen
        for conic in self._conics.get(geom, ()):
            site = model.site(conic.site).id
            mirrors.append(_silvered(conic).placed(data.site_xpos[site], data.site_xmat[site]))
            rest[:] = False  # the mesh is but a picture of the surface
        return mirrors, mesh.only(rest)

    def _floor(self, name: str, geom: int, black: bool) -> Iterator[tuple[str, Any]]:
        """An infinite plane in rings: far away its pattern, too fine for a few paths per pixel, fades into its mean
        colour, and from half of the farthest distance on that fades into the sky."""
        model, data, sphere = self.raster.model, self.raster.data, self.raster.sphere
        place, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        middle = ((sphere.centre - place) @ turn)[:2]
        texture = shapes.texture_of(model, geom)
        repeat = model.mat_texrepeat[model.geom_matid[geom]] / 2 if texture >= 0 else None
        plain, even = self._material(geom, black), self._material(geom, black, mean=True)
        weight = {"type": "mesh_attribute", "name": "vertex_outer"}
        fading = self._mi.load_dict({"type": "blendbsdf", "weight": weight, "first": plain, "second": even})
        thinning = self._mi.load_dict({"type": "mask", "opacity": {**weight, "name": "vertex_inner"}, "bsdf": even})
        rings = zip((0, *PATTERN, FAR / 2), (*PATTERN, FAR / 2, FAR), (plain, fading, even, thinning), strict=True)
        for number, (inner, outer, surface) in enumerate(rings):
            ring = shapes.ring(inner * sphere.radius, outer * sphere.radius, middle)
            mesh = replace(ring, uv=None if repeat is None else ring.points[:, :2] * repeat).placed(place, turn)
            yield f"{name}/ring{number}", self._mesh(mesh, surface, rim=number in (1, 3))

    def _mesh(self, mesh: Mesh, material: Any, *, rim: bool = False) -> Any:
        """A shape; `rim`: with attributes that tell the outer half of its points from the inner."""
        mi = self._mi
        properties = mi.Properties()
        properties["mesh_bsdf"] = material
        made = mi.Mesh(
            "mesh", len(mesh.points), len(mesh.triangles), has_vertex_normals=True,
            has_vertex_texcoords=mesh.uv is not None, props=properties,
        )  # fmt: skip
        if rim:
            outer = np.repeat(np.array([0, 1], np.float32), len(mesh.points) // 2)
            made.add_attribute("vertex_outer", 1, outer)
            made.add_attribute("vertex_inner", 1, 1 - outer)
        values = mi.traverse(made)
        values["vertex_positions"] = mesh.points.astype(np.float32).ravel()
        values["vertex_normals"] = np.asarray(mesh.normals, np.float32).ravel()
        values["faces"] = mesh.triangles.astype(np.uint32).ravel()
        if mesh.uv is not None:
            values["vertex_texcoords"] = mesh.uv.astype(np.float32).ravel()
        values.update()
        return made

    def _mirror(self) -> Any:
        if "mirror" not in self._materials:
            silver = _conductor(REFLECTIVITY)
            self._materials["mirror"] = self._mi.load_dict(
                {"type": "twosided", "front": silver, "back": _diffuse((0.03, 0.03, 0.03))}
            )
        return self._materials["mirror"]

    def _material(self, geom: int, black: bool, *, mean: bool = False) -> Any:
        """What a geom is made of, where it is no mirror; `mean`: its pattern evened out."""
        model = self.raster.model
        if geom in self._index:
            key: Any = ("glass", self._index[geom])
            if key not in self._materials:
                self._materials[key] = self._mi.load_dict(
                    {"type": "dielectric", "int_ior": self._index[geom], "ext_ior": 1.0}
                )
            return self._materials[key]
        material = int(model.geom_matid[geom])
        # without a material, MuJoCo's own: half as bright as can be, and half as sharp
        specular, shininess = (
            (0.5, 0.5) if material < 0
            else (float(model.mat_specular[material]), float(model.mat_shininess[material]))
        )  # fmt: skip
        rgba = self._rgba(geom)
        texture = shapes.texture_of(model, geom)
        if mean and texture >= 0:
            even = _texels(model, texture).reshape(-1, 3).mean(axis=0) * rgba[:3]
            rgba, texture = (*even.tolist(), rgba[3]), -1
        return self._plain(rgba, specular, shininess, black, texture)

    def _rgba(self, geom: int) -> tuple[float, ...]:
        """Colour of a geom: its own, unless that was left as MuJoCo has it and there is a material's."""
        model, material = self.raster.model, int(self.raster.model.geom_matid[geom])
        own = tuple(model.geom_rgba[geom].tolist())
        return tuple(model.mat_rgba[material].tolist()) if material >= 0 and own == (0.5, 0.5, 0.5, 1.0) else own

    def _plain(
        self, rgba: tuple[float, ...], specular: float, shininess: float, black: bool, texture: int = -1
    ) -> Any:
        key = (rgba, specular, shininess, texture) if not black else ("black", rgba[3])
        if key in self._materials:
            return self._materials[key]
        if black:  # as a mirror that throws nothing back: no light is asked for there
            surface: dict[str, Any] = _conductor((0.0, 0.0, 0.0))
        else:
            # a Phong highlight of exponent n is about as wide as a microfacet one of roughness √(2/(n + 2))
            rough = max((2 / (128 * shininess + 2)) ** 0.25, 0.15)
            surface = {"type": "principled", "base_color": self._paint(rgba, texture), "roughness": rough}
            surface |= {"metallic": 0.85} if specular >= METAL else {"specular": max(specular, 0.02)}
        surface = {"type": "twosided", "bsdf": surface}
        if rgba[3] < 1:
            surface = {"type": "mask", "opacity": rgba[3], "bsdf": surface}
        self._materials[key] = self._mi.load_dict(surface)
        return self._materials[key]

    def _paint(self, rgba: tuple[float, ...], texture: int) -> dict[str, Any]:
        if texture < 0:
            return {"type": "rgb", "value": decoded(rgba[:3]).tolist()}
        pixels = _texels(self.raster.model, texture) * np.array(rgba[:3])
        bitmap = self._mi.Bitmap(decoded(pixels).astype(np.float32))
        return {"type": "bitmap", "bitmap": bitmap, "raw": True}

    def _daylight(self, camera: Any, seeds: list[int]) -> Array:
        """Light (H, W, 3) of sun and sky, each from a half of the paths: asked for one of the two at random, paths
        would be as noisy as a coin."""
        mi, lights = self._mi, [self.sky()]
        suns = self.suns()
        lights += [suns] if suns else []
        matter = self.matter()
        integrator = mi.load_dict({"type": "path", "max_depth": LONGEST, "rr_depth": 6})
        total = np.zeros((*self.raster.size[::-1], 3))
        for light, seed in zip(lights, seeds, strict=False):
            scene = mi.load_dict({"type": "scene", **matter, **light})
            paths = math.ceil(self.look.samples / len(lights))
            total += np.array(mi.render(scene, sensor=camera, integrator=integrator, spp=paths, seed=seed))[..., :3]
        return total

    def sky(self) -> dict[str, Any]:
        """The light from everywhere, for a Mitsuba scene."""
        sky = self._mi.Bitmap((SKY * _sky(self.raster.model)).astype(np.float32))
        return {"sky": {
            "type": "envmap", "bitmap": sky, "to_world": self._mi.ScalarTransform4f().rotate([1, 0, 0], 90)
        }}  # fmt: skip

    def suns(self) -> dict[str, Any]:
        """The lights that cast shadows, for a Mitsuba scene."""
        return {
            f"sun{number}_{point}": {
                "type": "directional", "direction": direction.tolist(),
                "irradiance": {"type": "rgb", "value": (strength / SUNS).tolist()},
            }
            for number, way, strength in _suns(self.raster.model, self.raster.data)
            for point, direction in enumerate(_disc(way))
        }  # fmt: skip

    def _caustics(self, camera: Any, seed: int) -> Any:
        """Light (H, W, 3) that lamps, and the sun by way of mirrors and glass, throw on what can be seen."""
        openings = dict(self._openings())
        if not openings:
            return 0.0
        scene = self._mi.load_dict({"type": "scene", **self.matter(), **openings})
        tracer = self._mi.load_dict({"type": "ptracer", "max_depth": LONGEST, "rr_depth": LONGEST})
        particles = math.ceil(PARTICLES * self.look.samples)
        found = self._mi.render(scene, sensor=camera, integrator=tracer, spp=particles, seed=seed)
        return np.asarray(np.array(found)[..., :3], np.float64)

    def _openings(self) -> Iterator[tuple[str, Any]]:
        """Openings through which parallel light comes in: those of lamps, and for the sun one before each mirror and
        each piece of glass, as large as that looks from there."""
        model, data = self.raster.model, self.raster.data
        for number, way, strength in _suns(model, data):
            for geom in sorted({*self._flat, *self._silvered, *self._conics, *self._index}):
                if model.geom_group[geom] == HIDDEN or self._shaded(geom, -way):
                    continue
                for part, mesh in enumerate(self._specular(geom, way)):
                    window = shapes.outline(mesh, way)
                    light = {"type": "directionalarea", "radiance": {"type": "rgb", "value": strength.tolist()}}
                    yield f"window{number}_{geom}_{part}", self._glowing(window, light)
        for number, (site, lamp) in enumerate(self._lamps):
            transform = np.eye(4)
            transform[:3, :3] = data.site_xmat[site].reshape(3, 3) * (*lamp.half, 1.0)
            transform[:3, 3] = data.site_xpos[site]
            light = (SUN[1] * lamp.strength * decoded(lamp.rgb)).tolist()
            yield f"lamp{number}", {
                "type": "rectangle", "to_world": self._mi.ScalarTransform4f(transform),
                "bsdf": _diffuse((0.0, 0.0, 0.0)),
                "emitter": {"type": "directionalarea", "radiance": {"type": "rgb", "value": light}},
            }  # fmt: skip

    def _shaded(self, geom: int, sunwards: Array) -> bool:
        """Whether something stands between a geom's middle and the sun."""
        model, data = self.raster.model, self.raster.data
        groups = np.ones(6, np.uint8)
        groups[[HIDDEN, IMMATERIAL]] = 0
        body, met = int(model.geom_bodyid[geom]), np.zeros(1, np.int32)
        mujoco.mj_ray(model, data, data.geom_xpos[geom], sunwards, groups, True, body, met)
        return bool(met[0] >= 0)

    def _specular(self, geom: int, way: Array) -> Iterator[Mesh]:
        """The mirrors and the glass of a geom on which light of that direction falls."""
        model, data = self.raster.model, self.raster.data
        mesh = shapes.of_geom(model, geom).placed(data.geom_xpos[geom], data.geom_xmat[geom])
        if geom in self._silvered or geom in self._index:
            yield mesh
            return
        for face in self._faces(geom, mesh)[0]:
            if len(face.triangles) and np.mean(face.normals[face.triangles].reshape(-1, 3) @ way) < -GRAZING:
                yield face

    def _overlay(self, camera: Any, seed: int) -> Iterator[tuple[list[tuple[float, ...]], Array]]:
        """What is no matter, three colours at a time: the colours, and how much of each pixel they cover (H, W, 3)."""
        immaterial = self._immaterial()
        if not immaterial:
            return
        mi, colours = self._mi, list(immaterial)
        integrator = mi.load_dict({"type": "path", "max_depth": LONGEST, "rr_depth": LONGEST})
        matter = self.matter(black=True)
        for first in range(0, len(colours), 3):
            some = colours[first : first + 3]
            glowing = {}
            for channel, rgba in enumerate(some):
                mesh = shapes.together(immaterial[rgba])
                glow = {"type": "area", "radiance": {"type": "rgb", "value": np.eye(3)[channel].tolist()}}
                glowing[f"glow{channel}"] = self._glowing(mesh, glow)
            scene = mi.load_dict({"type": "scene", **matter, **glowing})
            found = mi.render(scene, sensor=camera, integrator=integrator, spp=OVERLAY_SAMPLES, seed=seed)
            yield some, np.asarray(np.array(found)[..., :3], np.float64)

    def _glowing(self, mesh: Mesh, emitter: Mapping[str, Any]) -> Any:
        properties = self._mi.Properties()
        properties["mesh_bsdf"] = self._plain((0.0, 0.0, 0.0, 1.0), 0.0, 0.0, True)
        properties["mesh_emitter"] = self._mi.load_dict(dict(emitter))
        made = self._mi.Mesh("glow", len(mesh.points), len(mesh.triangles), props=properties)
        values = self._mi.traverse(made)
        values["vertex_positions"] = mesh.points.astype(np.float32).ravel()
        values["faces"] = mesh.triangles.astype(np.uint32).ravel()
        values.update()
        return made

    def _immaterial(self) -> dict[tuple[float, ...], list[Mesh]]:
        """Beams, winds, fields: their meshes by colour."""
        model, data = self.raster.model, self.raster.data
        found: dict[tuple[float, ...], list[Mesh]] = {}
        for line in self.raster.lines:
            spot = shapes.ellipsoid(np.full(3, SPOT * line.radius)).placed(line.points[-1], np.eye(3))
            found.setdefault(tuple(line.rgba), []).extend([shapes.tube(line.points, line.radius), spot])
        for geom in np.flatnonzero(model.geom_group == IMMATERIAL).tolist():
            mesh = shapes.of_geom(model, geom).placed(data.geom_xpos[geom], data.geom_xmat[geom])
            if self._rgba(geom)[3] > 0:
                found.setdefault(self._rgba(geom), []).append(mesh)
        for tendon, path in self._ropes(IMMATERIAL):
            mesh = shapes.tube(path, float(model.tendon_width[tendon]))
            found.setdefault(tuple(model.tendon_rgba[tendon].tolist()), []).append(mesh)
        return found


def decoded(seen: ArrayLike) -> Array:
    """Linear light of a colour as it is seen, 0 to 1 (IEC 61966-2-1, sRGB)."""
    value = np.asarray(seen, float)
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4))


def encoded(light: ArrayLike) -> NDArray[np.uint8]:
    """The picture of linear light: its brightest parts pressed together below 1, then sRGB in whole numbers."""
    value = np.maximum(np.asarray(light, float), 0)
    room = 1 - SHOULDER
    value = np.where(value <= SHOULDER, value, 1 - room * np.exp(-(value - SHOULDER) / room))
    seen = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * seen), np.uint8)


def _diffuse(colour: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}


def _conductor(colour: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "type": "conductor", "material": "none", "specular_reflectance": {"type": "rgb", "value": list(colour)}
    }  # fmt: skip


def _silvered(conic: Conic) -> Mesh:
    """The surface of a curved mirror in the axes of its site, with its own normals."""
    half = conic.half_length or min(conic.strip, conic.aperture)
    s, t = np.meshgrid(np.linspace(-1, 1, CHORDS + 1), np.linspace(-1, 1, CHORDS + 1))
    y = half * t
    points, normals = conic.surface(s * (conic.aperture if conic.half_length else np.sqrt(conic.aperture**2 - y**2)), y)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(CHORDS), np.arange(CHORDS), indexing="ij"))
    low, right, up, both = (a * (CHORDS + 1) + b for a, b in ((i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)))
    triangles = np.concatenate([np.stack([low, right, both], 1), np.stack([low, both, up], 1)])
    return Mesh(points.reshape(-1, 3), triangles, normals.reshape(-1, 3))


def _texels(model: Any, texture: int) -> Array:
    """(H, W, 3) of 0 to 1."""
    start, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
    shape = int(model.tex_height[texture]), int(model.tex_width[texture]), channels
    return np.asarray(model.tex_data[start : start + math.prod(shape)].reshape(shape)[..., :3] / 255)


def _sky(model: Any) -> Array:
    """Light (64, 8, 3) from every direction, top row from above: the gradient of the skybox; without one, grey."""
    boxes = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value)
    if not len(boxes):
        return np.full((64, 8, 3), 0.5)
    texels = _texels(model, int(boxes[0]))
    width = texels.shape[1]
    side = texels[: 6 * width].reshape(-1, width, width, 3)[-1][:, width // 2]
    elevation = math.pi * (0.5 - (np.arange(64) + 0.5) / 64)
    row = (1 - np.sqrt(np.maximum(np.sin(elevation), 0))) * (width - 1)  # the sky is palest above the horizon
    light = decoded(side[np.round(row).astype(int)])
    light = (1 - PALE) * light + PALE * light.mean(axis=1, keepdims=True)
    return np.asarray(np.repeat(light[:, None], 8, 1))


def _suns(model: Any, data: Any) -> Iterator[tuple[int, Array, Array]]:
    """Lights that cast shadows: number, direction (3,) and irradiance (3,)."""
    for light in np.flatnonzero(model.light_castshadow & (model.light_active != 0)):
        yield int(light), np.array(data.light_xdir[light]), np.array(SUN) * model.light_diffuse[light]


def _disc(way: Array) -> Array:
    """Directions (SUNS, 3) that fill the sun's disc evenly, in a sunflower's pattern."""
    k = np.arange(SUNS)
    far, angle = SUN_RADIUS * np.sqrt((k + 0.5) / SUNS), k * math.pi * (3 - math.sqrt(5))
    side = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
    side /= np.linalg.norm(side)
    spread = way + np.outer(far * np.cos(angle), side) + np.outer(far * np.sin(angle), np.cross(way, side))
    return np.asarray(spread / np.linalg.norm(spread, axis=1, keepdims=True))


@functools.cache
def denoises() -> bool:
    """Whether Open Image Denoise is there."""
    return importlib.util.find_spec("pyoidn") is not None


def _denoised(light: Array, guide: NDArray[np.uint8]) -> Array:
    """Light (H, W, 3) without its noise. The guide, the rasteriser's picture, tells where edges and patterns are."""
    os.environ.setdefault("OIDN_NUM_THREADS", "1")
    import pyoidn

    albedo = decoded(guide / 255).astype(np.float32)
    clean = pyoidn.denoise(np.ascontiguousarray(light, np.float32), albedo, hdr=True)
    return np.asarray(clean, np.float64)


@functools.cache
def _mitsuba() -> Any:
    """The library, set to compiled kernels where they work, else to the interpreter that works everywhere."""
    import drjit
    import mitsuba

    library: Any = mitsuba
    library.set_variant("llvm_ad_rgb" if _compiles() else "scalar_rgb")
    library.logger().clear_appenders()  # its bars of progress are of one picture each
    drjit.set_thread_count(1)  # each core has a process of its own, and one thread adds up in one order
    return library


@functools.cache
def _compiles() -> bool:
    """Whether kernels can be compiled: some LLVMs end the process on some processors, so another one tries."""
    trial = (
        "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); mi.set_log_level(mi.LogLevel.Error);"
        "mi.render(mi.load_dict(mi.cornell_box()), spp=1).numpy()"
    )
    return subprocess.run([sys.executable, "-c", trial], capture_output=True, check=False).returncode == 0
