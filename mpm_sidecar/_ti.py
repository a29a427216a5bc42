"""The only import of Taichi; its maintained fork, quadrants, takes its place where it has no wheel."""

from __future__ import annotations

import functools
import importlib
import importlib.util
from collections.abc import Callable
from typing import Any, TypeVar

_name = next((name for name in ("taichi", "quadrants") if importlib.util.find_spec(name)), "taichi")
ti: Any = importlib.import_module(_name)

_Made = TypeVar("_Made", bound=Callable[..., Any])
_made: list[Callable[[], None]] = []
_running: list[Any] = []


def kernels(make: _Made) -> _Made:
    """Remember what makes kernels (or functions that they close over), until Taichi is started anew."""
    kept = functools.cache(make)
    _made.append(kept.cache_clear)
    return kept  # type: ignore[return-value]


def start(double: bool, **options: Any) -> Any:
    """Start Taichi on the CPU at a precision, unless it runs there already; ti.f32 or ti.f64.

    Its literals are of that precision, so that both cannot be had at once.
    """
    real = ti.f64 if double else ti.f32
    if _running != [real]:
        ti.init(arch=ti.cpu, default_fp=real, log_level=ti.ERROR, **options)
        for forget in _made:
            forget()
        _running[:] = [real]
    return real
