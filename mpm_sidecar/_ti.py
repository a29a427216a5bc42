"""The only import of Taichi, or of its maintained fork, quadrants, where that alone is installed or is asked for.

Settings by the environment: PHYSINONE_TAICHI, which of the two; TI_ARCH and whatever else Taichi itself reads, which
quadrants is told, too.
"""

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
from typing import Any, Final, TypeVar

_NAMES: Final = ("taichi", "quadrants")
_ARCHITECTURES: Final = ("cpu", "x64", "arm64", "cuda")


class NoDevice(RuntimeError):
    """What was to compute is not there: the message says what was asked for and what is allowed."""


def _module() -> Any:
    """What is asked for, or else the first that is installed; ImportError if there is none."""
    there = [name for name in _NAMES if importlib.util.find_spec(name)]
    name = os.environ.get("PHYSINONE_TAICHI") or (there or _NAMES)[0]
    if name not in there:
        raise ImportError(f"PHYSINONE_TAICHI = {name!r}; allowed: {' or '.join(_NAMES)}, installed: {there}")
    for each in _NAMES:  # what a command prints may be read by a program
        os.environ.setdefault(f"ENABLE_{each.upper()}_HEADER_PRINT", "0")
    if name == "quadrants":
        for setting, value in [*os.environ.items()]:
            if setting.startswith("TI_"):
                os.environ.setdefault(setting.replace("TI_", "QD_", 1), value)
    return importlib.import_module(name)


ti: Any = _module()

_Made = TypeVar("_Made", bound=Callable[..., Any])
_made: list[Callable[[], None]] = []
_running: list[Any] = []


def kernels(make: _Made) -> _Made:
    """Remember what makes kernels (or functions that they close over), until Taichi is started anew."""
    kept = functools.cache(make)
    _made.append(kept.cache_clear)
    return kept  # type: ignore[return-value]


def start(double: bool, arch: str = "cpu", **options: Any) -> Any:
    """Start Taichi at a precision, unless it runs there already; ti.f32 or ti.f64.

    Its literals are of that precision, so that both cannot be had at once.

    Args:
        double: in double precision.
        arch: "cpu" or "cuda", unless the environment's TI_ARCH says another.
        options: of `ti.init`.

    Raises:
        NoDevice: an architecture that there is not, or not on this machine.
    """
    arch = os.environ.get("TI_ARCH", arch)
    if arch not in _ARCHITECTURES:
        raise NoDevice(f"TI_ARCH = {arch!r}; allowed: {', '.join(_ARCHITECTURES)}")
    real = ti.f64 if double else ti.f32
    if _running != [real, arch]:
        _running.clear()
        before = _tasks()
        # Taichi's own data-flow analysis takes as long as all else in compiling; LLVM's does the same. And where sums
        # may be put in another order, each of a node's four numbers gets one of its own, and no four go together
        with contextlib.redirect_stdout(io.StringIO()):
            ti.init(
                arch=getattr(ti, arch), default_fp=real, log_level=ti.ERROR, cfg_optimization=False, fast_math=False,
                **options,
            )  # fmt: skip
        for forget in _made:
            forget()
        if arch == "cuda" and ti.lang.impl.current_cfg().arch != ti.cuda:
            raise NoDevice(f"TI_ARCH = {arch!r}: no NVIDIA GPU was found; allowed here: cpu")
        if arch != "cuda":
            _settle(sorted(_tasks() - before))
        _running[:] = [real, arch]
    return real


def version() -> str:
    """What computes and on what: such as "taichi 1.7.4 on x64"."""
    return f"{ti.__name__} {'.'.join(map(str, ti.__version__))} on {ti.lang.impl.current_cfg().arch.name}"


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
    and for how that was started. Defect: a mark is left also by a run that breaks off before Taichi writes its cache,
    at the end of the process.
    """
    config = ti.lang.impl.current_cfg()
    if not config.offline_cache:
        return True
    started = f"{ti.__version__} {config.arch} {config.default_fp} {config.cpu_max_num_threads}"
    sources = hashlib.sha256(f"{started} {name}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        sources.update(path.read_bytes())
    mark = Path(config.offline_cache_file_path) / f"physinone-{sources.hexdigest()[:16]}"
    new = not mark.exists()
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.touch()
    return new
