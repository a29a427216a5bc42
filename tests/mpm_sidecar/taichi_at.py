"""Taichi, started at a precision; its literals are of that, so both cannot be had at once."""

from __future__ import annotations

from typing import Any

from mpm_sidecar._ti import start, ti


def taichi_at(real: Any) -> None:
    """Start Taichi, unless it is running at this precision already."""
    start(real == ti.f64, offline_cache=False)
