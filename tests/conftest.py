"""Runs shared by the tests, and runs tampered with."""

from __future__ import annotations

import dataclasses
import functools
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from physinone_mj.fidelity import Fidelity
from physinone_mj.registry import phenomenon
from physinone_mj.run import Cloud, Run
from physinone_mj.simulate import simulate


def pytest_configure() -> None:
    """A shell starts what runs in the background deaf to signals, and a child inherits that: tests send some."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # as many processes as cores run already: Taichi's threads would wait for one another's turns
    os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", "1")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What long.txt names is slow, too; UsageError if it names what there is not, where all are collected."""
    long = set((Path(__file__).parent / "long.txt").read_text().splitlines())
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.slow)
    stale = long - {item.nodeid for item in items}
    if stale and config.args == config.getini("testpaths"):
        raise pytest.UsageError(f"tests/long.txt names tests that there are not: {', '.join(sorted(stale))}")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """All tests of one phenomenon go to one process, one after the other, so that they share its runs; so do those of
    one file that compile Taichi's kernels, or share scene folders."""
    from xdist.scheduler import LoadScopeScheduling

    class ByPhenomenon(LoadScopeScheduling):  # type: ignore[misc, unused-ignore]
        def _split_scope(self, nodeid: str) -> str:
            if "/mpm_sidecar/" in nodeid or "/test_dataset" in nodeid:
                return nodeid.split("::")[0]
            found = re.search(r"test_p(\d\d)\.py|\[(\d+)[-\]]", nodeid)
            return f"phenomenon {int(found[1] or found[2])}" if found else nodeid

    return ByPhenomenon(config, log)


@functools.lru_cache(maxsize=9)
def nominal(index: int, fidelity: Fidelity) -> Run:
    """The nominal specimen's run, simulated once per process and kept while its phenomenon is tested."""
    return simulate(phenomenon(index), fidelity=fidelity)


def tampered(run: Run, *, clock: float = 1.0, growth: float = 1.0, twins: bool = False) -> Run:
    """The run with a clock that is off by a factor, or a motion that grows, in the end, by a factor.

    Both stay consistent motions: velocities are the derivatives of the tampered positions. With `twins`, the runs
    that a law asks for beside this one are tampered with alike.
    """
    model, span = run.model, run.t[-1]
    t = run.t * clock
    qpos, qvel = run.qpos.copy(), run.qvel / clock
    if growth != 1.0:
        moved = np.empty(model.nv)
        for i, when in enumerate(run.t):
            mujoco.mj_differentiatePos(model, moved, 1.0, run.qpos[0], run.qpos[i])
            factor, rate = 1 + (growth - 1) * when / span, (growth - 1) / span
            q = run.qpos[0].copy()
            mujoco.mj_integratePos(model, q, moved * factor, 1.0)
            qpos[i] = q
            qvel[i] = run.qvel[i] * factor + moved * rate
    clouds = {name: _tampered(cloud, run, clock, growth) for name, cloud in run.clouds.items()}
    impacts = tuple(dataclasses.replace(i, time=i.time * clock, approach=i.approach / clock) for i in run.impacts)

    def again(**changes: Any) -> Run:
        twin = run.again(**changes)
        return tampered(twin, clock=clock, growth=growth, twins=True) if twins else twin

    return dataclasses.replace(
        run, t=t, qpos=qpos, qvel=qvel, impacts=impacts, clouds=clouds, again_with=again, _repeats={}
    )


def _tampered(cloud: Cloud, run: Run, clock: float, growth: float) -> Cloud:
    """Matter whose particles, and so its centre, go farther from where they began by a factor that grows to `growth`.

    Angular momentum and stored energy are left as they were.
    """
    when, rate = run.t / run.t[-1], (growth - 1) / run.t[-1]
    factor = 1 + (growth - 1) * when[:, None]
    moved, frames = cloud.centre - cloud.centre[0], slice(None, None, run.stride)
    momentum = (cloud.momentum * factor + cloud.mass[:, None] * moved * rate) / clock
    before = np.sum(cloud.momentum**2, axis=1) / (2 * cloud.mass)
    kinetic = (cloud.kinetic - before) * factor[:, 0] ** 2 / clock**2 + np.sum(momentum**2, axis=1) / (2 * cloud.mass)
    of_frame = factor[frames, None].astype(np.float32)
    first = cloud.position[:1]
    gone = cloud.position - first
    return dataclasses.replace(
        cloud, centre=cloud.centre[0] + moved * factor, momentum=momentum, kinetic=kinetic,
        low=cloud.low[0] + (cloud.low - cloud.low[0]) * factor,
        high=cloud.high[0] + (cloud.high - cloud.high[0]) * factor,
        position=first + gone * of_frame,
        velocity=((cloud.velocity * of_frame + gone * rate) / clock).astype(np.float32),
    )  # fmt: skip


@pytest.fixture(scope="session")
def tamper() -> Callable[..., Run]:
    return tampered
