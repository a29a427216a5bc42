"""What is said of a first compilation, and where Taichi's threads run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from mpm_sidecar._ti import compiles, ti


def test_a_first_compilation_is_known_by_its_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once for each name, precision and number of threads; always, where nothing is kept."""
    config = SimpleNamespace(
        offline_cache=True, offline_cache_file_path=str(tmp_path / "cache"), default_fp=ti.f32, cpu_max_num_threads=1
    )
    monkeypatch.setattr(ti.lang.impl, "current_cfg", lambda: config)
    assert [compiles("Elastic"), compiles("Elastic"), compiles("Granular")] == [True, False, True]
    config.default_fp = ti.f64
    assert [compiles("Elastic"), compiles("Elastic")] == [True, False]
    config.cpu_max_num_threads = 2
    assert [compiles("Elastic"), compiles("Elastic")] == [True, False]
    config.offline_cache = False
    assert [compiles("Elastic"), compiles("Elastic")] == [True, True]


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
