"""Image error against cost: what is finer is nearer to the reference, and what is the same is the same."""

from __future__ import annotations

import numpy as np
import pytest

from physinone_mj import pictures


def test_likeness_of_what_is_alike() -> None:
    rng = np.random.default_rng(0)
    truth = np.repeat(np.repeat(rng.integers(0, 255, (12, 12, 3), np.uint8), 8, axis=0), 8, axis=1)
    assert pictures.likeness(truth, truth) == (np.inf, 1.0)
    last = (np.inf, 1.0)
    for noise in (2, 8, 32):
        seen = np.clip(truth + rng.normal(0, noise, truth.shape), 0, 255).astype(np.uint8)
        psnr, ssim = pictures.likeness(seen, truth)
        assert (psnr, ssim) < last
        assert psnr == pytest.approx(20 * np.log10(255 / np.sqrt(np.mean((seen.astype(float) - truth) ** 2))))
        last = psnr, ssim


def test_finer_is_nearer() -> None:
    """A pendulum's picture: multisamples, shadows and size each bring something; and the finest costs more."""
    found = {r["setting"]: r for r in pictures.measure(46, size=128, paths=())}
    best = found["4 multisamples (default)"]
    for worse in ("no multisamples", "no multisamples, no shadows", "1/4 of the size, enlarged"):
        assert found[worse]["psnr"] < best["psnr"]
        assert found[worse]["ssim"] < best["ssim"]
    assert found["4 multisamples, no shadows"]["psnr"] < best["psnr"]
    assert all(r["cost"] > 0 for r in found.values())


def test_what_the_driver_gives_is_said_and_not_said_twice() -> None:
    """A driver that has but 4 multisamples: 2, 8 and 16 of them are no settings of their own."""
    asked = []

    def drawn(side: int, samples: int = 4, shadow: int | None = None) -> tuple[pictures.Picture, float, int]:
        asked.append((side, samples, shadow))
        return np.zeros((side, side, 3), np.uint8), 1.0, 4 if samples else 0

    settings = [record["setting"] for record in pictures._rasters(drawn, 16)]
    assert settings == [
        "no multisamples, no shadows", "4 multisamples, no shadows", "no multisamples",
        "4 multisamples, coarse shadows", "4 multisamples (default)", "1/2 of the size, enlarged",
        "1/4 of the size, enlarged",
    ]  # fmt: skip
    assert (16, 16, None) in asked


@pytest.mark.parametrize("size", [8, 2048])
def test_sizes_that_cannot_be_compared(size: int) -> None:
    with pytest.raises(ValueError, match=f"size = {size} of compared pictures; allowed: 16 to 1024"):
        pictures.measure(46, size=size, paths=())


@pytest.mark.slow
def test_more_paths_are_nearer() -> None:
    few, many = (r for r in pictures.measure(46, size=48, paths=(1, 16), many=128) if r["renderer"] == "photoreal")
    assert few["psnr"] < many["psnr"]
    assert few["cost"] < many["cost"]
