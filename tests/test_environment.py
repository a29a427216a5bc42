"""The environment keeps dm_env's contract for every phenomenon, and shows what `simulate` records, to the bit."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import unittest
from pathlib import Path
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from dm_env.test_utils import EnvironmentTestMixin

from physinone_mj import UnstableScene, environment
from physinone_mj.environment import accept_mujoco, load
from physinone_mj.fidelity import DRAFT
from physinone_mj.registry import entries
from physinone_mj.simulate import Stepper

from .conftest import nominal

HOME = Path(__file__).resolve().parents[1]
FRAMES = 20
USUAL = {1, 6, 13, 18, 24, 31, 43, 46, 47, 48}
"""Phenomena that between them have everything that an environment must carry; the others are left to the study."""

each = pytest.mark.parametrize(
    "index",
    [pytest.param(e.index, id=e.label, marks=[] if e.index in USUAL else pytest.mark.slow) for e in entries()],
)


def contract(index: int) -> type[unittest.TestCase]:
    class Contract(EnvironmentTestMixin, unittest.TestCase):  # type: ignore[misc]
        def make_object_under_test(self) -> dm_env.Environment:
            return load(index, fidelity=DRAFT)

    return Contract


globals().update({f"Test{e.label}": contract(e.index) for e in entries() if e.index in USUAL})


def passive(env: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.zeros(env.action_spec().shape)


def episode(env: Any, frames: int) -> list[dm_env.TimeStep]:
    """Time steps from a reset to the last of the episode, or that many."""
    steps = [env.reset()]
    while not steps[-1].last() and len(steps) < frames:
        steps.append(env.step(passive(env)))
    return steps


def blob(steps: list[dm_env.TimeStep]) -> bytes:
    return b"".join(np.ascontiguousarray(value).tobytes() for step in steps for value in step.observation.values())


@each
def test_shows_what_is_recorded(index: int) -> None:
    run = nominal(index, DRAFT)
    frames = range(0, len(run), run.stride)
    for i, step in zip(frames, episode(load(index, fidelity=DRAFT), FRAMES), strict=False):
        seen = step.observation
        assert seen["time"] == run.t[i]
        assert np.array_equal(seen["position"], run.qpos[i])
        assert np.array_equal(seen["velocity"], run.qvel[i])
        assert np.array_equal(seen["bodies"], np.stack([run.position(name)[i] for name in run.bodies()]))


@each
def test_starts_again_exactly(index: int) -> None:
    env = load(index, fidelity=DRAFT, seed=1)
    first = blob(episode(env, FRAMES))
    assert blob(episode(env, FRAMES)) == first
    assert blob(episode(load(index, fidelity=DRAFT, seed=1), FRAMES)) == first


def test_an_episode_has_the_frames_of_the_video() -> None:
    run, env = nominal(46, DRAFT), load(46, fidelity=DRAFT)
    steps = episode(env, 10_000)
    assert len(steps) == len(range(0, len(run), run.stride))
    assert steps[-1].discount == 1.0
    assert [step.last() for step in steps].count(True) == 1
    assert env.control_timestep() == pytest.approx(1 / run.scene.fps, rel=1e-15)


def test_nothing_to_act_on_and_nothing_to_gain() -> None:
    env = load("SimplePendulum", fidelity=DRAFT, length=0.5)
    assert env.action_spec().shape == (0,)
    env.reset()
    assert env.step(passive(env)).reward == 0.0


def test_parameters_arrive() -> None:
    short, long = (load(46, fidelity=DRAFT, length=x).reset().observation["bodies"][-1, 2] for x in (0.5, 1.5))
    assert short != long


def test_two_at_once_do_not_meddle() -> None:
    alone = blob(episode(load(46, fidelity=DRAFT), 5))
    one, other = load(46, fidelity=DRAFT), load(46, fidelity=DRAFT, length=0.5)
    steps = [one.reset()]
    other.reset()
    for _ in range(4):
        steps.append(one.step(passive(one)))
        other.step(passive(other))
    assert blob(steps) == alone


def test_no_callback_stays_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    env = load(46, fidelity=DRAFT)
    env.reset()
    env.step(passive(env))
    assert mujoco.get_mjcb_passive() is None

    def broken(stepper: Stepper) -> None:
        mujoco.set_mjcb_passive(lambda model, data: None)
        raise UnstableScene(stepper.compiled.specimen, 0.0, "broken")

    monkeypatch.setattr(Stepper, "advance", broken)
    with pytest.raises(UnstableScene, match="SimplePendulum"):
        env.step(passive(env))
    assert mujoco.get_mjcb_passive() is None


def test_a_broken_state_is_not_shown() -> None:
    env = load(46, fidelity=DRAFT)
    env.reset()
    env.physics.data.qvel[0] = np.nan
    with pytest.raises(UnstableScene):
        env.step(passive(env))


def test_what_cannot_be_done_says_so() -> None:
    physics = load(46, fidelity=DRAFT).physics
    with pytest.raises(NotImplementedError, match="load it twice"):
        physics.copy()
    with pytest.raises(NotImplementedError, match="load it twice"):
        pickle.dumps(physics)
    with pytest.raises(ValueError, match="keyframe_id = 0"):
        physics.reset(0)


def test_stale_names_are_struck() -> None:
    tables = {"mjmodel": {"nq": (), "array_of_yesterday": ("nq",)}, "mjdata": {"qpos": ("nq",)}, "other": {"x": ()}}
    assert accept_mujoco(tables) == ["array_of_yesterday"]
    assert tables == {"mjmodel": {"nq": ()}, "mjdata": {"qpos": ("nq",)}, "other": {"x": ()}}
    assert accept_mujoco(tables) == []
    assert accept_mujoco({}) == []


def test_named_indexing_works() -> None:
    physics = load(46, fidelity=DRAFT, angle=0.5).physics
    assert physics.named.data.qpos["pendulum/hinge"] == 0.5
    assert physics.named.model.body_mass["pendulum/bob"] == 0.5


def test_loading_is_quiet_and_opens_no_window() -> None:
    code = (
        "import os; from physinone_mj import environment; from dm_control import _render;"
        "print(_render.BACKEND, os.environ.get('MUJOCO_GL'))"
    )
    plain = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY")}
    done = subprocess.run([sys.executable, "-c", code], cwd=HOME, env=plain, capture_output=True, text=True, check=True)
    assert done.stdout.split()[1] == "None"
    assert done.stdout.split()[0] not in ("glfw", "egl")
    assert done.stderr == ""


def test_public_name() -> None:
    import physinone_mj

    assert physinone_mj.load is environment.load
