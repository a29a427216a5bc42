"""What Taichi runs on, or its fork; what is said of a first compilation, and where its threads run."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from mpm_sidecar._ti import NoDevice, compiles, start, ti
from mpm_sidecar.transfer import Body, Solver
from physinone_mj.continuum import Elastic


def test_a_first_compilation_is_known_by_its_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once for each name, precision, number of threads and architecture; always, where nothing is kept."""
    config = SimpleNamespace(
        offline_cache=True, offline_cache_file_path=str(tmp_path / "cache"), default_fp=ti.f32, cpu_max_num_threads=1,
        arch=ti.x64,
    )  # fmt: skip
    monkeypatch.setattr(ti.lang.impl, "current_cfg", lambda: config)
    assert [compiles("Elastic"), compiles("Elastic"), compiles("Granular")] == [True, False, True]
    config.default_fp = ti.f64
    assert [compiles("Elastic"), compiles("Elastic")] == [True, False]
    config.cpu_max_num_threads = 2
    assert [compiles("Elastic"), compiles("Elastic")] == [True, False]
    config.arch = ti.cuda
    assert [compiles("Elastic"), compiles("Elastic")] == [True, False]
    config.offline_cache = False
    assert [compiles("Elastic"), compiles("Elastic")] == [True, True]


SOLVE = """
import sys
import numpy as np
from mpm_sidecar._ti import start, ti
start(False, offline_cache=False)
from mpm_sidecar.collide import Bearer, Obstacle
from mpm_sidecar.transfer import Body, Solver
from physinone_mj.continuum import Granular, Newtonian, Wall
rng, found = np.random.default_rng(0), []
for material in (Granular(), Newtonian(bulk=1e4)):
    body = Body(material, 0.3 * rng.random((2001, 3)) + (0, 0, 0.01), 0.3**3 / 2000, rng.normal(size=(2001, 3)) - 2.0)
    floor = Bearer([Obstacle.wall(Wall((0, 0, 0), (0, 0, 1), friction=0.5))])
    solver = Solver([body], 1 / 32, gravity=(0, 0, -9.8), bearers=[floor])
    solver.advance(0.02)
    found.append(solver.positions())
np.save(sys.argv[1], found)
print(ti.__name__, ti.lang.impl.current_cfg().arch == ti.cuda)
"""


def solved(folder: Path, **settings: str) -> tuple[str, NDArray[np.float64]]:
    """What a process says, under settings of the environment, and where two bodies thrown on the floor got to."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("TI_ARCH", "PHYSINONE_"))}
    environment = clean | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])} | settings
    said = subprocess.run(
        [sys.executable, "-c", SOLVE, str(folder / "found.npy")], env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert said.returncode == 0, said.stderr
    return said.stdout, np.load(folder / "found.npy")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float64]:
    said, found = solved(tmp_path_factory.mktemp("plain"))
    assert said.split()[1] == "False"
    assert np.abs(found[0] - found[1]).max() > 0.01
    return found


@pytest.mark.skipif(importlib.util.find_spec("quadrants") is None, reason="quadrants is not installed")
def test_quadrants_does_the_same(plain: NDArray[np.float64], tmp_path: Path) -> None:
    """Where it is asked for, or alone; to rounding, and without a word of its own."""
    said, found = solved(tmp_path, PHYSINONE_TAICHI="quadrants")
    assert said == "quadrants False\n"
    assert found == pytest.approx(plain, abs=2e-6)


def _gpu() -> bool:
    try:
        return bool(ctypes.CDLL("libcuda.so.1").cuInit(0) == 0)
    except OSError:
        return False


@pytest.mark.skipif(not _gpu(), reason="no NVIDIA GPU")
def test_a_gpu_does_the_same(plain: NDArray[np.float64], tmp_path: Path) -> None:
    """To rounding; and the same bits twice, though in any order."""
    said, found = solved(tmp_path, TI_ARCH="cuda")
    assert said.split()[1] == "True"
    assert found == pytest.approx(plain, abs=1e-5)
    assert np.array_equal(solved(tmp_path, TI_ARCH="cuda")[1], found)


@pytest.mark.skipif(_gpu(), reason="an NVIDIA GPU")
def test_a_gpu_that_there_is_not_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing runs on the CPU instead, neither then nor when it is asked for again; and the CPU is there afterwards."""
    start(True, offline_cache=False)
    monkeypatch.setenv("TI_ARCH", "cuda")
    for _ in range(2):
        with pytest.raises(NoDevice, match=r"^TI_ARCH = 'cuda': no NVIDIA GPU was found; allowed here: cpu$"):
            start(False, offline_cache=False)
    monkeypatch.delenv("TI_ARCH")
    assert start(True, offline_cache=False) == ti.f64 == ti.lang.impl.current_cfg().default_fp


def test_what_nobody_computes_on_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TI_ARCH", "vulkan")
    with pytest.raises(NoDevice, match=r"^TI_ARCH = 'vulkan'; allowed: cpu, x64, arm64, cuda$"):
        start(False)


def test_a_package_that_is_not_there_is_told(tmp_path: Path) -> None:
    """Not another one taken for it."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2]), "PHYSINONE_TAICHI": "gstaichi"}
    command = [sys.executable, "-c", "import mpm_sidecar._ti"]
    said = subprocess.run(command, env=environment, capture_output=True, text=True).stderr.splitlines()[-1]
    assert said.startswith("ImportError: PHYSINONE_TAICHI = 'gstaichi'; allowed: taichi or quadrants, installed: [")


@pytest.mark.parametrize(("arch", "whole"), [("x64", False), ("arm64", False), ("cuda", True)])
def test_a_gpu_adds_up_in_whole_numbers(arch: str, whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its threads come in any order; a CPU need not."""
    config = SimpleNamespace(arch=getattr(ti, arch), cpu_max_num_threads=1, default_fp=ti.f32)
    monkeypatch.setattr(ti.lang.impl, "current_cfg", lambda: config)
    assert (Solver([Body(Elastic(), np.zeros((1, 3)), 1.0)], 0.1)._fixed is not None) == whole


ROUNDED = """
from mpm_sidecar._ti import start, ti

start(False)

@ti.kernel
def rounded(x: ti.f32, y: ti.f32) -> ti.f32:
    return (x + y) - x - y

print(rounded(1.0, 1e-9))
"""


def test_sums_keep_their_order(tmp_path: Path) -> None:
    """1e-9 is lost beside 1, unless sums are put in an order in which nothing is."""
    script = tmp_path / "rounded.py"
    script.write_text(ROUNDED)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2]), "TI_OFFLINE_CACHE": "0"}
    said = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert float(said.split()[-1]) == pytest.approx(-1e-9)


BUSY = """
import json, os, sys
from pathlib import Path
from mpm_sidecar._ti import start, ti

threads = int(sys.argv[1])
start(True)
start(False, cpu_max_num_threads=threads)

@ti.kernel
def work() -> float:
    total = 0.0
    for i in range(1 << 22):
        x = float(i)
        for _ in range(64):
            x = ti.sin(x)
        total += x
    return total

work()
found = []
for task in Path("/proc/self/task").iterdir():
    if int(task.name) != os.getpid():
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        found.append((int(fields[11]), sorted(os.sched_getaffinity(int(task.name)))))
print(json.dumps([cores for _, cores in sorted(found)[-threads:]]))
"""
CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]


@pytest.mark.skipif(len(CORES) < 2, reason="one core is nothing to share")
@pytest.mark.parametrize("threads", [1, len(CORES)])
def test_threads_that_have_all_cores_have_one_each(threads: int, tmp_path: Path) -> None:
    """Those that work: which they are is seen by the time they took."""
    environment = {name: value for name, value in os.environ.items() if name != "TI_CPU_MAX_NUM_THREADS"}
    environment["PYTHONPATH"] = str(Path(__file__).resolve().parents[2])
    script = tmp_path / "busy.py"  # Taichi reads its kernels from files
    script.write_text(BUSY, encoding="utf-8")
    text = subprocess.run(
        [sys.executable, str(script), str(threads)], env=environment, capture_output=True, text=True, check=True
    ).stdout
    found = json.loads(text)
    assert sorted(found) == ([[core] for core in CORES] if threads > 1 else [CORES])
