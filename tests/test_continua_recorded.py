"""Matter in scene folders: recorded, verified, reproduced bit for bit, and found out when somebody edits it."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from phenomena.p67_elastic_bounce import ElasticFall
from physinone_mj.base import Verdict
from physinone_mj.continuum import Box, Elastic, Piece, Plasticine
from physinone_mj.dataset import Job, _versions, generate, reproduce, verify
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from tests.conftest import nominal


@pytest.fixture(autouse=True)
def _no_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Laws of matter ask for runs of their own; they are judged elsewhere."""
    judged: list[Verdict] = []
    monkeypatch.setattr(Run, "check", lambda _run: judged)


def made(folder: Path, *, particles: bool = True) -> Path:
    job = Job(67, {"setup": "bar"}, DRAFT, seed=5, render=False, particles=particles)
    return generate(job, folder)


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Run, "check", lambda _run: [])
        return made(tmp_path_factory.mktemp("matter"))


def resealed(folder: Path) -> Path:
    """The folder, whose checksum of physics.h5 is that of what is there now."""
    from physinone_mj.dataset import _digest

    path = folder / "provenance.json"
    told = json.loads(path.read_text())
    told["files"]["physics.h5"] = _digest(folder / "physics.h5")
    path.write_text(json.dumps(told))
    return folder


def test_it_is_whole_and_happens_again(bar: Path) -> None:
    """verify finds nothing wrong, and reproduce gets the same sums to the last bit."""
    assert verify(bar).problems == []
    assert reproduce(bar).problems == []


def test_what_is_recorded(bar: Path) -> None:
    """Sums at every sample, particles at every frame, each frame a chunk, with units; the material's numbers."""
    with h5py.File(bar / "physics.h5") as file:
        samples, stride = len(file["time"]), int(file.attrs["samples_per_frame"])
        (piece,) = file["continua"].values()
        position = piece["position"]
        assert position.shape[0] == len(range(0, samples, stride))
        assert position.chunks == (1, *position.shape[1:])
        assert position.compression == "gzip"
        assert position.dtype == np.float32
        assert piece["centre"].shape == (samples, 3)
        assert all(entry.attrs["unit"] for entry in piece.values())
        assert piece["mass"][0] == pytest.approx(float(piece["bulk"][()]) * position.shape[1] * 1000.0, rel=1e-9)
    (told,) = json.loads((bar / "properties.json").read_text()).values()
    assert told["material"] == "Elastic"
    modulus = Elastic(young=told["young"], poisson=told["poisson"]).stiffness()
    step = 0.3 * told["cell"] / math.sqrt(modulus / told["density"])
    assert told["numerical_viscosity"] == pytest.approx(0.007 * told["density"] * told["cell"] ** 2 / step, rel=1e-9)


def test_what_computed_matter_is_recorded(bar: Path) -> None:
    """And named, if it is another that does not find the same states; a scene without matter knows nothing of it."""
    from mpm_sidecar._ti import ti

    told = json.loads((bar / "provenance.json").read_text())
    name, number, on, arch = told["versions"]["matter"].split()
    assert (name, on) == (ti.__name__, "on")
    assert number == importlib.metadata.version(name)
    assert arch in ("x64", "arm64")
    assert "matter" not in _versions(nominal(46, DRAFT))


def test_another_that_computed_matter_is_named(bar: Path, tmp_path: Path) -> None:
    """Where the states are not what they were."""
    copy = shutil.copytree(bar, tmp_path / bar.name)
    told = json.loads((copy / "provenance.json").read_text())
    told["versions"]["matter"], told["state_sha256"] = "taichi 0.1 on abacus", "0" * 64
    (copy / "provenance.json").write_text(json.dumps(told))
    (line,) = reproduce(copy).problems
    assert "other versions: matter taichi 0.1 on abacus here " in line


@pytest.mark.parametrize("key", ["centre", "momentum", "position", "velocity"])
def test_what_was_edited_is_found_out(bar: Path, tmp_path: Path, key: str) -> None:
    """Sums that are not those of the particles, though the checksum fits."""
    copy = tmp_path / bar.name
    copy.mkdir()
    for path in bar.rglob("*"):
        if path.is_file():
            (copy / path.relative_to(bar)).parent.mkdir(parents=True, exist_ok=True)
            (copy / path.relative_to(bar)).write_bytes(path.read_bytes())
    with h5py.File(copy / "physics.h5", "r+") as file:
        (piece,) = file["continua"].values()
        piece[key][...] = piece[key][...] + 0.01
    problems = verify(resealed(copy)).problems
    assert any("is not that of its particles" in line for line in problems), problems


def test_without_particles(tmp_path: Path) -> None:
    """They are left out when nobody wants them; the rest is verified as ever."""
    folder = made(tmp_path, particles=False)
    with h5py.File(folder / "physics.h5") as file:
        (piece,) = file["continua"].values()
        assert "position" not in piece
        assert "centre" in piece
    assert verify(folder).problems == []


@pytest.mark.parametrize("grids", [1, 2])
def test_two_materials_in_one_scene(grids: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar of rubber and a lump of clay beside it hit one floor, on one grid or each on its own: each is recorded by
    its name and told by its law, the floor got what both lost; it verifies, and happens again to the last bit."""
    alone = ElasticFall.build

    def both(self: ElasticFall, scene: Scene) -> None:
        alone(self, scene)
        (continuum,) = scene.continua
        (bar,) = continuum.pieces
        half = self.size / 4
        clay = Piece("clay", Plasticine(young=5e4, yield_stress=500.0), Box((half, half, half)),
                     (self.size, 0.0, 1.2 * half), velocity=bar.velocity)  # fmt: skip
        if grids == 1:
            continuum.pieces.append(clay)
        else:
            scene.continua.append(dataclasses.replace(continuum, pieces=[clay]))

    monkeypatch.setattr(ElasticFall, "build", both)
    folder = made(tmp_path)
    told = json.loads((folder / "properties.json").read_text())
    assert {number: (piece["name"], piece["material"]) for number, piece in told.items()} == {
        "1": ("bar", "Elastic"), "2": ("clay", "Plasticine"),
    }  # fmt: skip
    assert verify(folder).problems == []
    assert reproduce(folder).problems == []
    with h5py.File(folder / "physics.h5") as file:
        bar, clay = file["continua/bar"], file["continua/clay"]
        assert clay["mass"][0] == pytest.approx(1000.0 * 0.1**3, rel=1e-9)
        assert bar["mass"][0] == pytest.approx(1000.0 * 0.1**2 * 0.4, rel=1e-9)
        assert bar["dissipated"][-1] == 0.0
        assert clay["dissipated"][-1] > 0.1 * clay["kinetic"][0]
        assert list(file["pushed"]) == ["0"]
        whole = bar["momentum"][:] + clay["momentum"][:] + file["pushed/0"][:, :3]
        assert whole == pytest.approx(np.tile(whole[0], (len(whole), 1)), abs=1e-3 * abs(whole[0, 2]))
        assert file["pushed/0"][-1, 2] < 0.9 * whole[0, 2]


def test_pieces_of_one_name_cannot_be_recorded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """On one grid or on two."""
    alone = ElasticFall.build

    def twice(self: ElasticFall, scene: Scene) -> None:
        alone(self, scene)
        scene.continua.append(scene.continua[0])

    monkeypatch.setattr(ElasticFall, "build", twice)
    with pytest.raises(ValueError, match=r"pieces \['bar', 'bar'\] of a scene; allowed: each of its own name"):
        made(tmp_path)
