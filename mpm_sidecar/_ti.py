"""The only import of Taichi; its maintained fork, quadrants, takes its place where it has no wheel."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import importlib.util
import io
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # what a command prints may be read by a program
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
        before = _tasks()
        # Taichi's own data-flow analysis takes as long as all else in compiling; LLVM's does the same. And where sums
        # may be put in another order, each of a node's four numbers gets one of its own, and no four go together
        with contextlib.redirect_stdout(io.StringIO()):
            ti.init(
                arch=ti.cpu, default_fp=real, log_level=ti.ERROR, cfg_optimization=False, fast_math=False, **options
            )
        _settle(sorted(_tasks() - before))
        for forget in _made:
            forget()
        _running[:] = [real]
    return real


def _tasks() -> set[int]:
    """Threads of this process, where the system tells."""
    folder = Path("/proc/self/task")
    return {int(task.name) for task in folder.iterdir()} if folder.is_dir() else set()


def _settle(made: Sequence[int]) -> None:
    """Give each of Taichi's working threads, which it makes last, a core of its own, if there are as many.

    Every launch wakes them all, and while the thread that waits for them still has its core, Linux puts two on one
    other: of two on two cores it was seen to get a fifth out of the second, and four fifths like this.
    """
    if not hasattr(os, "sched_setaffinity"):
        return
    cores, threads = sorted(os.sched_getaffinity(0)), ti.lang.impl.current_cfg().cpu_max_num_threads
    if 1 < threads == len(cores) and threads <= len(made):
        for task, core in zip(made[-threads:], cores, strict=True):
            with contextlib.suppress(OSError):  # a container may not allow it
                os.sched_setaffinity(task, {core})


def compiles(name: str) -> bool:
    """Whether kernels of a name (a material's, say) are not in Taichi's cache, as far as is known; said once.

    The cache tells nobody, so that a mark is left beside it, which stands for this version of the sidecar and of Taichi
    and for the precision that was started. Defect: a mark is left also by a run that breaks off before Taichi writes
    its cache, at the end of the process.
    """
    config = ti.lang.impl.current_cfg()
    if not config.offline_cache:
        return True
    sources = hashlib.sha256(f"{ti.__version__} {config.default_fp} {config.cpu_max_num_threads} {name}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        sources.update(path.read_bytes())
    mark = Path(config.offline_cache_file_path) / f"physinone-{sources.hexdigest()[:16]}"
    new = not mark.exists()
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.touch()
    return new
