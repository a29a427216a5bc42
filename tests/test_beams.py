"""Beams in scene folders: recorded and filmed as they are at that instant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from physinone_mj import optics
from physinone_mj.dataset import Job, generate, verify
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import simulate
from render import film


def test_beams_are_recorded_at_the_pose_of_their_own_instant(tmp_path: Path) -> None:
    """The corner lies on the mirror where that is then, and both pieces meet its normal at the same angle."""
    lit = generate(Job(33, {}, DRAFT, views=1, size=24, render=False), tmp_path)
    with h5py.File(lit / "physics.h5") as file:
        points, geoms = file["beams/laser/points"][:], file["beams/laser/geoms"][:]
        assert file["beams/laser/points"].attrs["unit"] == "m"
        weights, truncated = file["beams/laser/weights"][:], file["beams/laser/truncated"][:]
        glass = file["bodies/mirror/origin"][:]
        quaternion = file["bodies/mirror/quaternion"][:]
    assert len(points) == len(glass)
    assert np.ptp(glass, axis=0).max() > 0.01
    w, x, y, z = quaternion.T
    normal = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    heights = np.einsum("ti,ti->t", points[:, 1] - glass, normal)
    assert np.ptp(heights) < 1e-12
    there, back = (points[:, k + 1] - points[:, k] for k in (0, 1))
    cosines = [np.einsum("ti,ti->t", way, normal) / np.linalg.norm(way, axis=1) for way in (there, back)]
    assert cosines[0] == pytest.approx(-cosines[1], abs=1e-12)
    assert (geoms[:, :2] >= 0).all()
    assert (weights[:, :2] == 1).all()
    assert not truncated.any()
    assert verify(lit).ok


def test_the_film_shows_the_beam_of_its_own_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No frame late: what is drawn is what the rays are at the pose that is drawn."""
    class Seen(Exception):
        pass

    def shoot(footage: film.Footage, *_: Any, **__: Any) -> None:
        run = simulate(33, fidelity=DRAFT)
        due = optics.follow(run.model, run.scene, run.scene.beams[0], footage.qpos)
        assert footage.beams[0].points == pytest.approx(due.points, abs=1e-12, nan_ok=True)
        assert np.ptp(due.points[:, 1], axis=0).max() > 1e-3
        assert len(footage.faces) == 1
        raise Seen

    monkeypatch.setattr(film, "plan_views", lambda *_, **__: ())
    monkeypatch.setattr(film, "shoot", shoot)
    with pytest.raises(Seen):
        generate(Job(33, {}, DRAFT, views=1, size=24, modalities=("rgb",)), tmp_path)
    assert list(tmp_path.iterdir()) == []
