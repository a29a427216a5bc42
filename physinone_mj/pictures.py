"""Image error against cost: what multisamples, shadows, resolution and paths of light bring, and what they take.

One picture of a scene, half way through, from its first camera, at each setting; beside it a reference that is far
finer: for the rasteriser one four times as wide with the finest shadows, averaged down; for traced paths one of many
more. Errors: PSNR [dB] and SSIM (Z. Wang et al., IEEE Trans. Image Process. 13 (2004) 600, with Gaussian weights). A
cost is the processor's time over that of `trade.calibrate`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from .dataset import Job, footage_of
from .fidelity import DRAFT
from .simulate import simulate
from .terminal import figure
from .trade import calibrate

Picture = NDArray[np.uint8]

RASTER: Final[tuple[tuple[str, dict[str, int]], ...]] = (
    (", no shadows", {"samples": 0, "shadow": 0}), (", no shadows", {"shadow": 0}), ("", {"samples": 0}),
    (", coarse shadows", {"shadow": 512}), (" (default)", {}), ("", {"samples": 2}), ("", {"samples": 8}),
    ("", {"samples": 16}),
)  # fmt: skip
"""What is said of them beside their multisamples. A driver may give others than it is asked for, or the same again:
those are left out."""
COARSER: Final = (2, 4)
"""Parts of the size at which it is drawn, too, and enlarged."""
FINER: Final = 4
"""Times the size of the reference."""
FINEST_SHADOWS: Final = 8192
PATHS: Final = (1, 4, 16, 64)
MANY: Final = 512
TURNS: Final = 3


def measure(index: int, *, size: int, paths: Sequence[int] = PATHS, many: int = MANY) -> list[dict[str, Any]]:
    """A record for each setting of the rasteriser, and of traced paths if any are asked for.

    Raises ImportError without scikit-image (`pip install physinone-mj[study]`), NoGL, NoMitsuba, and what simulating
    raises; ValueError if the reference would be wider than 4096 pixels.
    """
    from render import film, photoreal

    if not 16 <= size <= 4096 // FINER:
        raise ValueError(f"size = {size} of compared pictures; allowed: 16 to {4096 // FINER}")
    if paths:
        photoreal.require()
    job = Job(index, {}, DRAFT, size=size, views=1)
    seen = simulate(index, fidelity=DRAFT)
    blank, scene = footage_of(job, seen), seen.scene
    frame = len(blank.qpos) // 2
    pose = film.plan_views(blank, job.rng(1), count=1)[0].at(frame)

    def drawn(side: int, **quality: int) -> tuple[Picture, float, int]:
        with blank.raster((side, side), **quality) as raster:
            blank.put(raster, frame)
            return *clocked(lambda: raster.colour(pose)), raster.multisamples

    def traced(count: int) -> tuple[Picture, float]:
        with blank.raster((size, size)) as raster:
            blank.put(raster, frame)
            light = tuple(scene.mirrors), tuple(scene.dielectrics), tuple(scene.lamps)
            look = photoreal.Look(count, (0, index), *light)
            studio = photoreal.Studio(raster, look)
            return clocked(lambda: studio.colour(pose, (0, frame)), turns=1)

    return [*_rasters(drawn, size), *_paths(traced, paths, many)]


def _rasters(drawn: Callable[..., tuple[Picture, float, int]], size: int) -> Iterator[dict[str, Any]]:
    fine, _, _ = drawn(FINER * size, samples=8, shadow=FINEST_SHADOWS)
    truth = np.asarray(cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA), np.uint8)
    known = set()
    for about, quality in RASTER:
        picture, cost, given = drawn(size, **quality)
        if (given, quality.get("shadow")) not in known:
            known.add((given, quality.get("shadow")))
            yield _record("raster", f"{given or 'no'} multisamples{about}", picture, cost, truth)
    for part in COARSER:
        small, cost, _ = drawn(size // part)
        large = np.asarray(cv2.resize(small, (size, size), interpolation=cv2.INTER_CUBIC), np.uint8)
        yield _record("raster", f"1/{part} of the size, enlarged", large, cost, truth)


def _paths(traced: Callable[[int], tuple[Picture, float]], paths: Sequence[int], many: int) -> Iterator[dict[str, Any]]:
    if paths:
        truth, _ = traced(many)
        for count in paths:
            yield _record("photoreal", f"{count} paths per pixel", *traced(count), truth)


def clocked(draw: Callable[[], Picture], turns: int = TURNS) -> tuple[Picture, float]:
    """The picture, and the median of its costs; the first one, which uploads and compiles, does not count."""
    picture, costs = draw(), []
    for _ in range(turns):
        unit, begun = calibrate(), time.process_time()
        draw()
        costs.append((time.process_time() - begun) / unit)
    return picture, statistics.median(costs)


def likeness(picture: Picture, truth: Picture) -> tuple[float, float]:
    """(PSNR [dB], infinite for the same picture; SSIM) of two (H, W, 3) pictures."""
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    with np.errstate(divide="ignore"):
        psnr = float(peak_signal_noise_ratio(truth, picture, data_range=255))
    how: Mapping[str, Any] = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    return psnr, float(structural_similarity(truth, picture, channel_axis=2, data_range=255, **how))


def _record(renderer: str, setting: str, picture: Picture, cost: float, truth: Picture) -> dict[str, Any]:
    psnr, ssim = likeness(picture, truth)
    return {"renderer": renderer, "setting": setting, "psnr": min(psnr, 200.0), "ssim": ssim, "cost": cost}


def page(label: str, records: Sequence[Mapping[str, Any]]) -> str:
    """The records as a section of Markdown."""
    lines = [f"## Pictures of {label}", "", "| renderer | setting | PSNR [dB] | SSIM | cost |", "|---" * 5 + "|"]
    lines += [
        f"| {r['renderer']} | {r['setting']} | {r['psnr']:.1f} | {r['ssim']:.4f} | {figure(r['cost'], '.2g')} |"
        for r in records
    ]
    return "\n".join(lines) + "\n"
