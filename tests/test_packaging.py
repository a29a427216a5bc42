"""What is delivered: the wheel holds the packages and nothing else, and works where nothing else is installed."""

import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

HOME = Path(__file__).resolve().parents[1]
PACKAGES = ("physinone_mj", "phenomena", "mjcf_templates", "mpm_sidecar", "render")
TYPED = ("physinone_mj", "phenomena", "mpm_sidecar", "render")


def python(executable: Path | str, *arguments: str | Path, folder: Path = HOME) -> str:
    done = subprocess.run([executable, *arguments], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    python(sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", folder)
    (built,) = folder.glob("*.whl")
    return built


def test_wheel_holds_the_packages_and_nothing_else(wheel: Path) -> None:
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    source = {path for package in PACKAGES for path in (HOME / package).rglob("*") if path.suffix in (".py", ".xml")}
    expected = {path.relative_to(HOME).as_posix() for path in source} | {f"{package}/py.typed" for package in TYPED}
    assert expected <= names
    assert {name.partition("/")[0] for name in names} == set(PACKAGES)
    assert not any(part.startswith(("test", "__pycache__")) for name in names for part in Path(name).parts)


def test_wheel_holds_the_templates(wheel: Path) -> None:
    assert any(Path(name).match("mjcf_templates/*.xml") for name in zipfile.ZipFile(wheel).namelist())


def test_wheel_carries_its_licence_and_command(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    names = [name for name in archive.namelist() if ".dist-info/" in name]
    (entry_points,) = (name for name in names if name.endswith("entry_points.txt"))
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "physinone = physinone_mj.__main__:main" in archive.read(entry_points).decode()


def test_import_loads_no_engine() -> None:
    loaded = python(sys.executable, "-c", "import sys, physinone_mj; print(*sys.modules, sep='\\n')").split()
    assert "physinone_mj" in loaded
    engines = ("taichi", "OpenGL", "moderngl", "phenomena", "mpm_sidecar", "render")
    assert [name for name in loaded if name.partition(".")[0] in engines] == []


@pytest.mark.slow
def test_wheel_works_alone(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "alone", with_pip=True)
    bin_folder = tmp_path / "alone" / "bin"
    python(bin_folder / "python", "-m", "pip", "install", "--quiet", wheel, folder=tmp_path)
    assert "46" in python(bin_folder / "physinone", "list", folder=tmp_path)
    location = python(bin_folder / "python", "-c", "import render; print(render.__file__)", folder=tmp_path)
    assert location.startswith(str(tmp_path))
