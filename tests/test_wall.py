"""A wall of 105 bricks: it stands, it sleeps, and it costs less than MuJoCo's own steps, under which it sags.

Ten courses in running bond, 0.1 mm between neighbours: ten bricks, then half a brick, nine bricks and half a brick.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from physinone_mj import contact
from physinone_mj.fidelity import DRAFT
from physinone_mj.simulate import Compiled, Stepper
from tests.bench.bench_cost import PLAIN_STEP, Bricks, compiled, plain

Array = NDArray[np.float64]


def heights(qpos: Array) -> Array:
    return np.asarray(qpos.reshape(-1, 7)[:, 2])


def moved(before: Array, after: Array) -> Array:
    return np.asarray(np.linalg.norm((after - before).reshape(-1, 7)[:, :3], axis=1))


def watched(ready: Compiled, duration: float) -> tuple[Array, Array, int, float]:
    """Places at every sample (n, nq), the last velocities, how many bricks sleep, and the processor's seconds."""
    with Stepper(ready) as stepper:
        assert stepper._solver is not None
        stepper.advance()
        seen, begun = [stepper.data.qpos.copy()], time.process_time()
        while stepper.data.time < duration:
            stepper.advance()
            seen.append(stepper.data.qpos.copy())
        spent = time.process_time() - begun
        stepper.inspect()
        return np.array(seen), stepper.data.qvel.copy(), int(np.count_nonzero(stepper._solver._heap)), spent


def test_the_wall_stands_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contact.Solver, "rest", lambda *_: False)
    seen, speed, asleep, _ = watched(compiled(Bricks(), DRAFT), 0.3)
    assert len(seen[0]) == 7 * 105
    assert asleep == 0
    assert np.abs(heights(seen[-1]) - heights(seen[0])).max() < 1e-6
    late = len(seen) // 2
    drift = moved(seen[late], seen[-1]) / (0.3 * (len(seen) - 1 - late) / len(seen))
    assert drift.max() < 1e-7
    assert np.abs(speed).max() < 1e-6


def test_the_wall_stands_asleep_at_half_the_cost_of_plain_steps() -> None:
    """Plain: `mj_step` of the same bricks with MuJoCo's options and contact parameters as they come."""
    ready = compiled(Bricks(), DRAFT)
    seen, speed, asleep, ours = watched(ready, 3.0)
    start = seen[0]
    assert asleep == 105
    assert (speed == 0).all()
    assert moved(start, seen[-1]).max() < 1e-6
    late = len(seen) // 2
    assert (seen[late:] == seen[-1]).all()
    bare = plain(ready)
    data = mujoco.MjData(bare)
    data.qpos[:] = start
    begun = time.process_time()
    for _ in range(round(3.0 / PLAIN_STEP)):
        mujoco.mj_step(bare, data)
    theirs = time.process_time() - begun
    assert (heights(data.qpos) - heights(start)).min() < -1e-3, "plain steps would do"
    assert ours / theirs <= 0.5
