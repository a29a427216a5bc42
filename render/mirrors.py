"""Flat mirrors in pictures: where the eye's image is, what of a picture a mirror covers, how its image is laid in.

What an eye E sees in the mirror through M with unit normal n is what an eye at E' = E - 2 ((E - M)·n) n, behind it,
sees through it. The picture plane of that second eye is the mirror itself, so nothing behind the mirror can get into
it, and its picture fits into the first one by a homography: no handedness to undo, no clipping plane.
Source: Euclid, Catoptrics, prop. 16-19; M. Born & E. Wolf, Principles of Optics, §4.2.1 (the plane mirror); R. Hartley
& A. Zisserman, Multiple View Geometry, §8.1.1 (a plane's homography).

Pure numpy and OpenCV: nothing here draws; :class:`render.raster.Raster` does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]
"""Left, top, width, height [pixel]."""

REFLECTIVITY = (0.90, 0.93, 0.92)
"""Of a mirror, red, green and blue: silver (0.95, rather more of red) seen twice through some millimetres of glass,
which takes away most of the red. Ordinary float glass; judged, not measured."""

ORDERS = 3
"""A mirror in a mirror in a mirror still shows an image; what is seen by more reflections shows the bare mirrors."""

FINENESS = 1.4
"""Pixels of a mirror's image per pixel that it covers, along either side and where the mirror is nearest."""

FEWEST, FEWEST_AGAIN = 4.0, 64.0
"""A mirror that covers less shows nothing; the second figure is for a mirror that is itself seen in one [pixel]."""

GRAZING = 1e-3
"""A mirror is shown to an eye that is farther before its plane than this, in radii of the event sphere."""

COPLANAR = 2e-5
"""Faces whose normals differ by less than this, and which are apart by less than this part of the event sphere's
radius, are one mirror: a fifth of a pixel at most."""


@dataclass(frozen=True)
class Face:
    """A flat mirror: a face of a geom.

    Args:
        geom: id of the geom.
        point: of the face (3,), in the axes of the geom's body [m].
        normal: unit vector outwards (3,), in the same axes.
    """

    geom: int
    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not math.isclose(math.hypot(*self.normal), 1.0, rel_tol=1e-6):
            raise ValueError(f"the normal of a mirror must be a unit vector, got {self.normal}")


@dataclass(frozen=True)
class Mirror:
    """Faces that lie in one plane: a point of it (3,) [m], its unit normal (3,), the geoms' ids."""

    point: Array
    normal: Array
    geoms: tuple[int, ...]

    def before(self, place: Array) -> float:
        """How far a place (3,) is before the mirror [m]."""
        return float((place - self.point) @ self.normal)


def coplanar(faces: Sequence[tuple[int, Array, Array]], radius: float) -> tuple[Mirror, ...]:
    """Mirrors of faces (geom, point, normal), those in one plane together; radius: of the event sphere [m]."""
    found: list[Mirror] = []
    for geom, point, normal in faces:
        for i, mirror in enumerate(found):
            if np.abs(mirror.normal - normal).max() < COPLANAR and abs(mirror.before(point)) < COPLANAR * radius:
                found[i] = replace(mirror, geoms=(*mirror.geoms, geom))
                break
        else:
            found.append(Mirror(point, normal, (geom,)))
    return tuple(found)


@dataclass(frozen=True)
class Eye:
    """A camera whose picture need not lie straight before it.

    Args:
        place: (3,) [m].
        axes: (3, 3), columns right, up and back.
        near: distance of the picture plane; nothing nearer is seen [m].
        left, right, bottom, top: borders of the picture on that plane, along right and up [m].
        size: (W, H) [pixel].
    """

    place: Array
    axes: Array
    near: float
    left: float
    right: float
    bottom: float
    top: float
    size: tuple[int, int]

    def part(self, window: Window) -> Eye:
        """What sees the part of the picture inside a window."""
        left, top, width, height = window
        across, down = self.pixel
        return replace(
            self,
            left=self.left + left * across,
            right=self.left + (left + width) * across,
            bottom=self.top - (top + height) * down,
            top=self.top - top * down,
            size=(width, height),
        )

    def finer(self, times: int) -> Eye:
        """What sees the same with this many pixels in place of one, along either side."""
        return replace(self, size=(self.size[0] * times, self.size[1] * times))

    @property
    def pixel(self) -> tuple[float, float]:
        """Width and height of a pixel on the picture plane [m]."""
        return (self.right - self.left) / self.size[0], (self.top - self.bottom) / self.size[1]

    @cached_property
    def matrix(self) -> Array:
        """(3, 4) from the world's homogeneous coordinates to pixels times depth, and depth [m]."""
        across, down = self.pixel
        inner = np.array(
            [
                [self.near / across, 0, self.left / across],
                [0, -self.near / down, -self.top / down],
                [0, 0, -1],
            ]
        )
        return inner @ np.column_stack([self.axes.T, -self.axes.T @ self.place])

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Pixels (N, 2) and depths (N,) [m] of points (N, 3) [m]."""
        points = np.asarray(points, float)
        seen = points @ self.matrix[:, :3].T + self.matrix[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return seen[:, :2] / seen[:, 2:], seen[:, 2]

    def rays(self, pixels: Array) -> Array:
        """Vectors (N, 3) from the eye through pixels (N, 2), with a depth of one."""
        across, down = self.pixel
        aside = (self.left + pixels[:, :1] * across) / self.near
        above = (self.top - pixels[:, 1:] * down) / self.near
        return np.asarray(np.concatenate([aside, above, np.full_like(aside, -1.0)], axis=1) @ self.axes.T)

    def heights(self, mirror: Mirror, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """How far what is seen at a planar depth (H, W) is before a mirror (H, W) [m]."""
        width, height = self.size
        across, down = self.pixel
        right, up, back = self.axes.T @ mirror.normal
        x = (self.left + (np.arange(width) + 0.5) * across) * (right / self.near) - back
        y = (self.top - (np.arange(height) + 0.5) * down) * (up / self.near)
        slope = x.astype(np.float32)[None] + y.astype(np.float32)[:, None]
        return np.asarray(depth * slope + np.float32(mirror.before(self.place)), dtype=np.float32)

    def window(self, corners: Array) -> Window | None:
        """What of the picture a body with these corners (N, 3) [m] can cover; None if nothing."""
        pixels, depth = self.project(corners)
        if depth.max() <= 0:
            return None
        if depth.min() < 1e-3 * self.near:
            return 0, 0, *self.size
        size = np.array(self.size)
        low = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size).astype(int)
        if (high <= low).any():
            return None
        return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def hull(windows: Sequence[Window]) -> Window | None:
    """The smallest window that holds some others; None if there are none."""
    if not windows:
        return None
    left, top = (min(window[k] for window in windows) for k in (0, 1))
    right, bottom = (max(window[k] + window[k + 2] for window in windows) for k in (0, 1))
    return left, top, right - left, bottom - top


@dataclass(frozen=True)
class Share:
    """How much of each pixel inside a window is a mirror's: weights (H, W) from 0 to 1."""

    window: Window
    weight: NDArray[np.float32]

    @classmethod
    def of(cls, weight: NDArray[np.float32], left: int, top: int, fewest: float) -> Self | None:
        """Of weights (H, W) whose first pixel is that one; None if their sum is less than the fewest [pixel]."""
        if weight.sum() < fewest:
            return None
        rows, columns = np.flatnonzero(weight.any(axis=1)), np.flatnonzero(weight.any(axis=0))
        up, aside = int(rows[0]), int(columns[0])
        cut = np.ascontiguousarray(weight[up : rows[-1] + 1, aside : columns[-1] + 1])
        return cls((left + aside, top + up, cut.shape[1], cut.shape[0]), cut)

    def outline(self) -> Array:
        """Corners (N, 2) [pixel] of the first and the last pixel of every row: their hull holds the mirror."""
        left, top, width, _ = self.window
        filled = self.weight > 0
        rows = np.flatnonzero(filled.any(axis=1))
        first = left + filled[rows].argmax(axis=1)
        last = left + width - filled[rows, ::-1].argmax(axis=1)
        ends = [np.column_stack([x, top + rows + y]) for x in (first, last) for y in (0, 1)]
        return np.concatenate(ends).astype(float)


@dataclass(frozen=True)
class Image:
    """What a mirror shows: the eye that sees it, and (3, 3) from its pixels to those of the picture it belongs in."""

    eye: Eye
    matrix: Array

    @classmethod
    def of(cls, mirror: Mirror, eye: Eye, share: Share, corners: Array, most: tuple[int, int]) -> Self:
        """Of a mirror that covers a share of an eye's picture.

        corners: (N, 3) of what it is a face of [m]; most: greatest width and height of the image [pixel].
        """
        height, normal = mirror.before(eye.place), mirror.normal
        foot = eye.place - height * normal
        rays = eye.rays(share.outline())
        # a ray along the mirror or away from it is on the outer side of a pixel that is partly covered
        slope = np.minimum(rays @ normal, -1e-4 * np.linalg.norm(rays, axis=1))
        there = eye.place - (height / slope)[:, None] * rays
        # seen aslant, the mirror is foreshortened along the line from the foot: that is one side of its picture
        up = there.mean(axis=0) - foot
        up -= (up @ normal) * normal
        if np.linalg.norm(up) < 1e-3 * height:
            up = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        up /= np.linalg.norm(up)
        right = np.cross(normal, up)
        sides = np.column_stack([right, up])
        widest = (corners - foot) @ sides
        on = np.clip((there - foot) @ sides, widest.min(axis=0), widest.max(axis=0))
        plane = eye.matrix @ np.block([[sides, foot[:, None]], [np.array([[0.0, 0.0, 1.0]])]])
        low, high = on.min(axis=0), on.max(axis=0)
        low, high = low - 0.01 * (high - low), high + 0.01 * (high - low)
        size = np.clip(np.ceil(FINENESS * _stretch(plane, on) * (high - low)), 8, most).astype(int)
        image = Eye(
            place=eye.place - 2 * height * normal, axes=np.column_stack([right, up, -normal]), near=height,
            left=float(low[0]), right=float(high[0]), bottom=float(low[1]), top=float(high[1]),
            size=(int(size[0]), int(size[1])),
        )  # fmt: skip
        across, down = image.pixel
        on_plane = np.array([[across, 0, image.left], [0, -down, image.top], [0, 0, 1]])
        return cls(image, plane @ on_plane)

    def lay(self, shown: NDArray[np.uint8], picture: NDArray[np.uint8], share: Share) -> None:
        """Put what the eye shows (h, w, 3) into the picture (H, W, 3), where and as far as the mirror has a share."""
        left, top, width, height = share.window
        # twice as fine, then averaged: what is reduced by up to a factor of two or three does not flicker
        there = np.array([[2, 0, -2 * left], [0, 2, -2 * top], [0, 0, 1]]) @ self.matrix
        half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV counts from the centre of the first pixel
        warped = cv2.warpPerspective(
            shown, np.linalg.inv(half) @ there @ half, (2 * width, 2 * height), flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        image = cv2.resize(warped, (width, height), interpolation=cv2.INTER_AREA) * np.array(REFLECTIVITY, np.float32)
        part = picture[top : top + height, left : left + width]
        bare = part.astype(np.float32)
        whole = share.weight > 0.999
        # a pixel on the rim, or behind a veil, is a mixture, and its part of the bare mirror is to be taken out of it:
        # that of the whole pixels round it, or of all of them
        count = cv2.boxFilter(whole.astype(np.float32), -1, (3, 3), normalize=False)[..., None]
        near = cv2.boxFilter(bare * whole[..., None], -1, (3, 3), normalize=False) / np.maximum(count, 1)
        mean = bare[whole].mean(axis=0) if whole.any() else bare
        mirror = np.where(whole[..., None], bare, np.where(count > 0, near, mean))
        part[:] = np.clip(np.rint(bare + share.weight[..., None] * (image - mirror)), 0, 255).astype(np.uint8)


def _stretch(plane: Array, on: Array) -> Array:
    """Most pixels per metre along either axis of a plane, (2,), at places (N, 2) on it; plane: its homography."""
    seen = np.column_stack([on, np.ones(len(on))]) @ plane.T
    # of p = h/w along an axis: (h' - p w')/w
    pixels = seen[:, :2] / seen[:, 2:]
    return np.array(
        [np.linalg.norm((plane[:2, k] - pixels * plane[2, k]) / seen[:, 2:], axis=1).max() for k in range(2)]
    )
