"""The doctor on machines that are ill: each illness is named, with the line that cures it."""

import importlib.metadata
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from physinone_mj import doctor
from physinone_mj.doctor import INSTALL_GRAPHICS, Driver, Finding

HOME = Path(doctor.__file__).resolve().parents[1]
H200 = "NVIDIA H200 (driver 550.54.15, 143771 MiB)"
MESA = Path("/usr/share/glvnd/egl_vendor.d/50_mesa.json")


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in (*doctor.RENDERER_VARIABLES, "__EGL_VENDOR_LIBRARY_FILENAMES", "NVIDIA_VISIBLE_DEVICES"):
        monkeypatch.delenv(variable, raising=False)


def program(folder: Path, name: str, body: str) -> Path:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


def named(findings: list[Finding], name: str) -> Finding:
    return next(finding for finding in findings if finding.name == name)


def test_every_problem_has_a_fix(tmp_path: Path) -> None:
    findings = doctor.examine(tmp_path / "not" / "yet")
    assert len({finding.name for finding in findings}) == len(findings)
    for finding in findings:
        assert finding.ok or finding.fix, finding
        assert "\n" not in finding.value + finding.fix


def test_importing_the_doctor_imports_nothing_heavy() -> None:
    code = (
        "import sys, physinone_mj; before = set(sys.modules); import physinone_mj.doctor;"
        "print(*{name.partition('.')[0] for name in set(sys.modules) - before})"
    )
    loaded = subprocess.run([sys.executable, "-c", code], cwd=HOME, check=True, capture_output=True, text=True).stdout
    assert set(loaded.split()) <= set(sys.stdlib_module_names) | {"physinone_mj"}


def test_missing_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent/driver.json")
    context = named(doctor.graphics(), "OpenGL context")
    assert not context.ok
    assert context.fix == INSTALL_GRAPHICS
    variable = named(doctor.environment(), "__EGL_VENDOR_LIBRARY_FILENAMES")
    assert not variable.ok
    assert variable.fix == "unset __EGL_VENDOR_LIBRARY_FILENAMES"


def test_missing_library() -> None:
    finding = doctor.libraries(Driver(missing=["libEGL.so.1"]))
    assert finding == Finding("GL libraries", False, "missing: libEGL.so.1", INSTALL_GRAPHICS)


def test_missing_library_is_seen(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(doctor, "LIBRARIES", ("libEGL_of_nobody.so.1",))
    monkeypatch.setattr(doctor, "egl_devices", list)
    monkeypatch.setitem(sys.modules, "render.egl", None)
    with pytest.raises(ImportError):
        doctor.probe()
    assert json.loads(capsys.readouterr().out.splitlines()[0]) == {"missing": ["libEGL_of_nobody.so.1"]}


def test_packages_are_asked_for_only_when_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ill, well = Finding("OpenGL context", False, "", INSTALL_GRAPHICS), Finding("OpenGL context", True, "")
    program(tmp_path, "dpkg-query", "echo 'libegl1 installed'; echo 'libgl1 config-files'; exit 1")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(doctor, "graphics", lambda: [ill])
    assert doctor.missing_packages() == [name for name in doctor.GRAPHICS if name != "libegl1"]
    monkeypatch.setattr(doctor, "graphics", lambda: [well])
    assert doctor.missing_packages() == []


def test_packages_that_are_there_are_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path, "dpkg-query", "\n".join(f"echo '{name} installed'" for name in doctor.GRAPHICS))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(doctor, "graphics", lambda: [Finding("OpenGL context", False, "other", "other")])
    assert doctor.missing_packages() == []


@pytest.mark.skipif(not MESA.exists(), reason="Mesa's EGL driver is not installed")
def test_software_is_recognised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(MESA))
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "true")
    context = named(doctor.graphics(), "OpenGL context")
    assert context.ok
    assert "software" in context.value


def test_software_beside_an_idle_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    renderer = "llvmpipe (LLVM 15.0.6, 256 bits)"
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"ID": "ubuntu"})
    driver = Driver(renderer=renderer, software=True, devices=[None])
    assert doctor.context(driver, []) == Finding("OpenGL context", True, f"{renderer}: software, on the CPU")
    assert doctor.context(driver, [H200]).fix == "sudo apt-get install -y libnvidia-gl-550"
    assert doctor.gpu(driver, [H200]).fix == "sudo apt-get install -y libnvidia-gl-550"
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"ID": "debian"})
    assert doctor.context(driver, [H200]).fix == "sudo apt-get install -y libegl-nvidia0"
    monkeypatch.setenv("NVIDIA_VISIBLE_DEVICES", "all")
    assert "NVIDIA_DRIVER_CAPABILITIES=all" in doctor.context(driver, [H200]).fix


def test_gpu_that_draws() -> None:
    driver = Driver(renderer="NVIDIA H200/PCIe/SSE2", devices=[None, 0])
    assert doctor.context(driver, [H200]) == Finding("OpenGL context", True, "NVIDIA H200/PCIe/SSE2")
    assert doctor.gpu(driver, [H200]) == Finding("GPU", True, f"{H200}; CUDA 0 is EGL device 1")


def test_gpus_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path, "nvidia-smi", "echo 'NVIDIA H200, 550.54.15, 143771 MiB'")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert doctor.nvidia_gpus() == [H200]
    program(tmp_path, "nvidia-smi", "echo 'Failed to initialize NVML'; exit 18")
    assert doctor.nvidia_gpus() == []


def test_driver_that_crashes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    crash = program(tmp_path, "python", """echo '{"missing": []}'; kill -SEGV $$""")
    monkeypatch.setattr(sys, "executable", str(crash))
    context = named(doctor.graphics(), "OpenGL context")
    assert context == Finding("OpenGL context", False, "the graphics driver crashed with SIGSEGV", INSTALL_GRAPHICS)


def test_driver_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", str(program(tmp_path, "python", "exec sleep 60")))
    monkeypatch.setattr(doctor, "PROBE_SECONDS", 0.1)
    context = named(doctor.graphics(), "OpenGL context")
    assert not context.ok
    assert "silent" in context.value


@pytest.mark.parametrize(("variable", "value"), [("MUJOCO_GL", "osmesa"), ("PYOPENGL_PLATFORM", "glx")])
def test_variable_in_the_way(variable: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, value)
    assert named(doctor.environment(), variable).fix == f"unset {variable}"
    assert doctor.context(Driver(error="no context"), []).fix == f"unset {variable}"
    monkeypatch.setenv(variable, "egl")
    assert all(finding.ok for finding in doctor.environment())


def test_device_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Driver(devices=[None, 4])
    for chosen in ("1", "4"):
        monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", chosen)
        assert doctor.device_choice(driver) == []
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "3")
    (finding,) = doctor.device_choice(driver)
    assert not finding.ok
    assert finding.fix == "unset MUJOCO_EGL_DEVICE_ID"


def packages_seen_by(code: str, folder: Path, **environment: str) -> Finding:
    code += "; import json; from physinone_mj import doctor; print(json.dumps([vars(f) for f in doctor.packages()]))"
    said = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(HOME), **environment},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    findings = [Finding(**entry) for entry in json.loads(said)]
    assert all(finding.ok for finding in findings if finding.name != "package render")
    return named(findings, "package render")


@pytest.fixture
def shadow(tmp_path: Path) -> Path:
    """A folder with a package `render` of somebody else."""
    folder = tmp_path / "elsewhere"
    (folder / "render").mkdir(parents=True)
    (folder / "render" / "__init__.py").touch()
    return folder


def test_our_packages_are_ours(tmp_path: Path) -> None:
    finding = packages_seen_by("pass", tmp_path)
    assert finding == Finding("package render", True, str(HOME / "render"))


def test_shadow_in_pythonpath(tmp_path: Path, shadow: Path) -> None:
    finding = packages_seen_by("pass", tmp_path, PYTHONPATH=f"{shadow}{os.pathsep}{HOME}")
    assert finding == Finding(
        "package render", False, f"{shadow / 'render'} hides {HOME / 'render'}", "unset PYTHONPATH"
    )


def test_shadow_in_a_folder(tmp_path: Path, shadow: Path) -> None:
    finding = packages_seen_by(f"import sys; sys.path.insert(0, {str(shadow)!r})", tmp_path)
    assert not finding.ok
    assert finding.fix == f"mv {shadow / 'render'} {shadow / 'render'}_other"


def test_shadow_of_a_distribution(tmp_path: Path, shadow: Path) -> None:
    metadata = shadow / "other_renderer-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: other-renderer\nVersion: 1.0\n")
    (metadata / "top_level.txt").write_text("render\n")
    finding = packages_seen_by(f"import sys; sys.path.insert(0, {str(shadow)!r})", tmp_path)
    assert not finding.ok
    assert finding.fix == "pip uninstall -y other-renderer"


def test_versions_are_numbers() -> None:
    assert doctor.release("4.10.0rc1") == (4, 10)
    assert doctor.release("5.0.0.93") > doctor.release("5.0")
    assert doctor.release("4") == doctor.release("4.0.0")


def test_dependency_out_of_range(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.metadata, "version", {"mujoco": "3.17.0"}.__getitem__)
    finding = doctor.dependency("mujoco<5,>=4.0")
    assert finding == Finding("mujoco", False, "3.17.0, needs >=4.0", "pip install 'mujoco<5,>=4.0'")
    monkeypatch.setattr(importlib.metadata, "version", {"mujoco": "5.0.0"}.__getitem__)
    assert not doctor.dependency("mujoco<5,>=4.0").ok


def test_dependency_missing() -> None:
    finding = doctor.dependency("no-distribution-of-this-name>=1.2")
    assert finding.value == "missing"
    assert finding.fix == "pip install 'no-distribution-of-this-name>=1.2'"


@pytest.mark.parametrize(("version", "advice"), [("4.0.0", True), ("4.0.1", False)])
def test_known_bug(version: str, advice: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.metadata, "version", {"mujoco": version}.__getitem__)
    finding = doctor.dependency("mujoco<5,>=4.0")
    assert finding.ok
    assert bool(finding.fix) == advice


def test_every_declared_clause_is_understood() -> None:
    for requirement in importlib.metadata.requires(doctor.DISTRIBUTION) or []:
        if "extra ==" not in requirement:
            assert re.fullmatch(r"[\w.-]+((>=|<)[\d.]+,?)+", requirement), requirement


def test_disk_that_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.disk(tmp_path / "not" / "yet").ok
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=2**29))
    finding = doctor.disk(tmp_path / "not" / "yet")
    assert not finding.ok
    assert finding.value == f"0.5 GiB free at {tmp_path}"
    assert "-o " in finding.fix


def test_disk_that_is_read_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert doctor.disk(tmp_path).value == f"{tmp_path} is not writable"
