"""The only import of Taichi; its maintained fork, quadrants, takes its place where it has no wheel."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

_name = next((name for name in ("taichi", "quadrants") if importlib.util.find_spec(name)), "taichi")
ti: Any = importlib.import_module(_name)
