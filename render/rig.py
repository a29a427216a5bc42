"""Where cameras stand: event sphere, static views, moving trajectories, projection.

Poses are camera-to-world (4, 4) matrices with OpenGL axes: x right, y up, the camera looks along -z. The world's z is
up and lengths are metres. The intrinsics are those of the PhysInOne release: square pixels, `fx = fy =
W / (2 tan(fov / 2))`, principal point in the middle of the image.

Pixel `i` covers the interval [i, i + 1) of image coordinates, as OpenGL rasterises it, so its centre is at `i + 1/2`
and the principal point at `W / 2` lies between two pixels of an even image. Readers of the release back-project with
`x = (i - W/2) z / fx`, without the half: they are off by half a pixel, 0.6 mm per metre of depth at 1120 pixels.
Pure numpy and scipy: nothing here draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline

Array = NDArray[np.float64]

FOV = 2 * math.atan(0.66)
"""Horizontal field of view of the release [rad]: an 18 mm lens before a 23.76 mm wide film back."""

STATIC_LATITUDE = (math.radians(30), math.radians(60))
"""Elevation of static cameras over the horizon [rad]; PhysInOne supplement, section 5.5.1."""

MOVING_LATITUDE = (math.radians(8), math.radians(45))
"""Elevation of the moving camera [rad]; section 5.5.2 has +-45 degrees, a floor leaves the upper part."""

FIT = 1.05
"""Margin of the fit: the sphere seen is this much larger than the event sphere."""

SEPARATION = math.radians(10)
"""Least angle between two static cameras that were drawn outside their strata [rad]."""


class NoClearView(ValueError):
    """Too few of the candidate poses see the event."""


@dataclass(frozen=True)
class Sphere:
    """The event sphere: centre (3,) [m] and radius [m], holding the whole swept motion."""

    centre: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", np.asarray(self.centre, dtype=np.float64))
        object.__setattr__(self, "radius", float(self.radius))
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all():
            raise ValueError(f"sphere centre must be 3 finite numbers, got {self.centre}")
        if not (0 < self.radius < math.inf):
            raise ValueError(f"sphere radius must be positive and finite, got {self.radius}")


def event_sphere(points: ArrayLike, *, margin: float = 0.05) -> Sphere:
    """A small sphere that holds every point, its radius enlarged by `margin` (a fraction).

    Badoiu and Clarkson's iteration ("Smaller core-sets for balls", SODA 2003, section 3) moves the centre towards the
    farthest point by 1/(k+1); after 400 steps the radius is within 0.5 % of the smallest in practice.

    Args:
        points: (N, 3) positions [m], N >= 1.
        margin: fraction added to the radius; the radius is at least 1 mm.

    Raises:
        ValueError: no points, a wrong shape, or a value that is not finite.
    """
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) == 0 or not np.isfinite(cloud).all():
        raise ValueError(f"event_sphere needs (N, 3) finite points with N >= 1, got shape {cloud.shape}")
    centre = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    for k in range(1, 401):
        away = cloud - centre
        centre = centre + away[np.argmax(np.einsum("ij,ij->i", away, away))] / (k + 1)
    radius = float(np.sqrt(((cloud - centre) ** 2).sum(axis=1).max()))
    return Sphere(centre, max(radius * (1 + margin), 1e-3))


def fit_distance(radius: float, fov: float = FOV, size: tuple[int, int] = (1, 1)) -> float:
    """Least distance [m] from which a sphere of `radius` [m], enlarged by FIT, lies inside an image `size` (W, H)."""
    width, height = size
    half = math.atan(math.tan(fov / 2) * min(1.0, height / width))
    return FIT * radius / math.sin(half)


def look_at(eye: ArrayLike, target: ArrayLike) -> Array:
    """Pose (4, 4) of a camera at `eye` (3,) looking at `target` (3,), its right vector horizontal.

    Raises:
        ValueError: `eye` is `target`, or straight above or below it, where no horizontal right vector is singled out.
    """
    eye, target = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
    back = eye - target
    right = np.array([-back[1], back[0], 0.0])
    if np.linalg.norm(right) < 1e-9 * np.linalg.norm(back) or not np.any(back):
        raise ValueError(f"no camera at {eye} can look at {target} with a horizontal right vector")
    back = back / np.linalg.norm(back)
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(back, right), back, eye
    return pose


def orbit(sphere: Sphere, azimuth: float, latitude: float, distance: float) -> Array:
    """Pose (4, 4) at `azimuth` and `latitude` [rad] and `distance` [m] from the sphere's centre, looking at it."""
    out = np.array([math.cos(latitude) * math.cos(azimuth), math.cos(latitude) * math.sin(azimuth), math.sin(latitude)])
    return look_at(sphere.centre + distance * out, sphere.centre)


def static_views(
    rng: np.random.Generator,
    sphere: Sphere,
    count: int = 12,
    *,
    clear: Callable[[Array], bool],
    fov: float = FOV,
    size: tuple[int, int] = (1, 1),
    attempts: int = 64,
) -> list[Array]:
    """`count` clear camera poses (4, 4) on the upper hemisphere; PhysInOne supplement, section 5.5.1.

    A Latin hypercube: one camera per azimuth sector and one per latitude band, bands of equal area (uniform in
    sin(latitude)) between 30 and 60 degrees, jittered inside the cell. A pose that `clear` refuses is drawn again,
    first in its cell, then in its sector, then anywhere at least SEPARATION away from the others. All stand at
    the distance that just fits the sphere.

    Args:
        rng: source of all randomness.
        sphere: the event sphere.
        count: number of cameras, at least 1.
        clear: whether the subject is well seen from a pose.
        fov: horizontal field of view [rad].
        size: (W, H); only the ratio matters.
        attempts: poses tried per camera, at least 4.

    Raises:
        NoClearView: no clear pose in `attempts` tries for one of the cameras.
    """
    distance = fit_distance(sphere.radius, fov, size)
    low, high = (math.sin(latitude) for latitude in STATIC_LATITUDE)
    bands = rng.permutation(count)
    start = rng.uniform(0, 2 * math.pi)
    kept: list[tuple[float, float]] = []
    for sector in range(count):
        for attempt in range(attempts):
            turn, rise = (sector + rng.uniform(0.15, 0.85)) / count, (bands[sector] + rng.uniform(0, 1)) / count
            if attempt >= attempts // 4:
                rise = rng.uniform(0, 1)
            if attempt >= attempts // 2:
                turn = rng.uniform(0, 1)
            azimuth, latitude = start + 2 * math.pi * turn, math.asin(low + (high - low) * rise)
            crowded = any(_angle((azimuth, latitude), other) < SEPARATION for other in kept)
            if not (crowded and attempt >= attempts // 2) and clear(orbit(sphere, azimuth, latitude, distance)):
                kept.append((azimuth, latitude))
                break
        else:
            raise NoClearView(
                f"only {len(kept)} of {count} static cameras see the event: camera {sector} had no clear view in "
                f"{attempts} tries"
            )
    return [orbit(sphere, azimuth, latitude, distance) for azimuth, latitude in kept]


def _angle(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Great-circle angle [rad] between two (azimuth, latitude)."""
    cosine = math.sin(a[1]) * math.sin(b[1]) + math.cos(a[1]) * math.cos(b[1]) * math.cos(a[0] - b[0])
    return math.acos(max(-1.0, min(1.0, cosine)))


Path = Callable[[np.random.Generator, Array, tuple[float, float]], Array]
"""(rng, progress (T,) in [0, 1), (low, high) latitude [rad]) -> (T, 3): azimuth, latitude [rad], distance factor."""


def linear_drift(rng: np.random.Generator, progress: Array, latitude: tuple[float, float]) -> Array:
    """Half a turn at even pace while the latitude wanders: 10 to 20 samples, the control points of a cubic B-spline.

    Such a spline stays within the range of its control points and bends without a kink.
    """
    low, high = latitude
    count = int(rng.integers(10, 21))
    way = rng.choice([-1.0, 1.0]) * math.pi
    heights = [rng.uniform(low, high)]
    while len(heights) < count:
        step = rng.uniform(-1, 1) * (high - low) / 4
        inside = low <= heights[-1] + step <= high
        heights.append(heights[-1] + step if inside else heights[-1] - step)
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, count - 2), np.ones(3)])
    wander = BSpline(knots, np.array(heights), 3)(progress)
    return np.stack([rng.uniform(0, 2 * math.pi) + way * progress, wander, np.ones_like(progress)], axis=1)


def sinusoidal(rng: np.random.Generator, progress: Array, latitude: tuple[float, float]) -> Array:
    """From one point to another within half a turn, eased in and out by a cosine; the distance swells half-way."""
    ease = (1 - np.cos(math.pi * progress)) / 2
    span = rng.uniform(math.pi / 3, math.pi) * rng.choice([-1.0, 1.0])
    start, end = rng.uniform(*latitude, size=2)
    swell = rng.uniform(0, 0.25)
    factor = 1 + swell * np.sin(math.pi * progress)
    return np.stack([rng.uniform(0, 2 * math.pi) + span * ease, start + (end - start) * ease, factor], axis=1)


def circular_loop(rng: np.random.Generator, progress: Array, latitude: tuple[float, float]) -> Array:
    """A closed loop around a random centre of the band: 12 samples of an ellipse, joined by a periodic cubic."""
    low, high = latitude
    half = (high - low) / 2 * rng.uniform(0.4, 0.9)
    centre = rng.uniform(low + half, high - half)
    width = rng.uniform(1, 2.5) * half / math.cos(centre)
    breath = rng.uniform(0, 0.12)
    angle = np.linspace(0, 2 * math.pi, 13)
    samples = np.stack([width * np.cos(angle), half * np.sin(angle), breath * (1 - np.cos(angle))], axis=1)
    samples[-1] = samples[0]
    loop = np.asarray(CubicSpline(np.linspace(0, 1, 13), samples, bc_type="periodic")(progress))
    turned = loop[:, 0] * rng.choice([-1.0, 1.0]) + rng.uniform(0, 2 * math.pi)
    return np.stack([turned, np.clip(centre + loop[:, 1], low, high), 1 + np.maximum(loop[:, 2], 0)], axis=1)


STRATEGIES: Mapping[str, Path] = MappingProxyType(
    {"linear drift": linear_drift, "sinusoidal": sinusoidal, "circular loop": circular_loop}
)
"""The three trajectory samplers of the PhysInOne supplement, section 5.5.2."""


def moving_view(
    rng: np.random.Generator,
    sphere: Sphere,
    frames: int,
    *,
    strategy: Path | None = None,
    latitude: tuple[float, float] = MOVING_LATITUDE,
    fov: float = FOV,
    size: tuple[int, int] = (1, 1),
) -> Array:
    """Poses (frames, 4, 4) of a camera that moves smoothly around the sphere, always looking at its centre.

    Args:
        rng: source of all randomness.
        sphere: the event sphere; it stays inside the image.
        frames: number of poses, at least 1.
        strategy: one of STRATEGIES.values(), or drawn with equal chances.
        latitude: (lowest, highest) elevation over the horizon through the sphere's centre [rad]; a positive lowest
            keeps the camera above a floor that the sphere's centre is above.
        fov: horizontal field of view [rad].
        size: (W, H); only the ratio matters.
    """
    path = strategy or list(STRATEGIES.values())[int(rng.integers(len(STRATEGIES)))]
    distance = fit_distance(sphere.radius, fov, size)
    steps = path(rng, np.arange(frames) / max(frames, 1), latitude)
    return np.stack([orbit(sphere, azimuth, height, distance * factor) for azimuth, height, factor in steps])


def focal(fov: float, size: tuple[int, int]) -> float:
    """Focal length [pixel] of a camera of horizontal field `fov` [rad] and image `size` (W, H)."""
    return 0.5 * size[0] / math.tan(fov / 2)


def project(points: ArrayLike, pose: ArrayLike, fov: float, size: tuple[int, int]) -> tuple[Array, Array]:
    """Image coordinates (..., 2) [pixel] and planar depth (...) [m] of world points (..., 3).

    The pixel that a point falls in is the floor of its coordinates. Behind the camera the depth is negative and the
    coordinates mean nothing.
    """
    camera = np.asarray(pose, dtype=np.float64)
    local = (np.asarray(points, dtype=np.float64) - camera[:3, 3]) @ camera[:3, :3]
    depth = -local[..., 2]
    f = focal(fov, size)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.stack([size[0] / 2 + f * local[..., 0] / depth, size[1] / 2 - f * local[..., 1] / depth], axis=-1)
    return pixels, depth


def back_project(depth: ArrayLike, pose: ArrayLike, fov: float) -> Array:
    """World points (H, W, 3) [m] of the pixel centres of a planar depth image (H, W) [m]."""
    z = np.asarray(depth, dtype=np.float64)
    height, width = z.shape
    f = focal(fov, (width, height))
    x = (np.arange(width) + 0.5 - width / 2) / f
    y = (np.arange(height) + 0.5 - height / 2) / f
    local = np.stack([x[None, :] * z, -y[:, None] * z, -z], axis=-1)
    camera = np.asarray(pose, dtype=np.float64)
    return np.asarray(local @ camera[:3, :3].T + camera[:3, 3])
