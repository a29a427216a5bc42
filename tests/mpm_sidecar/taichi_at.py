"""Taichi, started at a precision; its literals are of that, so both cannot be had at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpm_sidecar import transfer
from mpm_sidecar._ti import ti

_now: list[Any] = []
KERNELS: list[Callable[[], None]] = [
    transfer._particle_kernels.cache_clear, transfer._grid_kernels.cache_clear, transfer._wall_kernel.cache_clear,
]  # fmt: skip
"""What forgets kernels that a start makes invalid."""


def taichi_at(real: Any) -> None:
    """Start Taichi, unless it is running at this precision already."""
    if _now != [real]:
        ti.init(arch=ti.cpu, log_level=ti.ERROR, offline_cache=False, default_fp=real)
        for forget in KERNELS:
            forget()
        _now[:] = [real]
