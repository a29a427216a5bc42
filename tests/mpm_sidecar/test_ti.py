"""What is said of a first compilation."""

from __future__ import annotations

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
