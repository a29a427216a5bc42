"""How fast beams are traced, beside MuJoCo's bare rays: `python -m` this.

One row per phenomenon whose scene has a beam, nominal, at DRAFT. A segment is a beam's way from surface to
surface. The bare column casts as many rays by `mj_ray` at the same poses, without mirrors, refraction or a record; both
include the kinematics of every pose and take turns in one run. Times are the processor's, on one core; medians over
the turns.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, Final

import mujoco
import numpy as np

from physinone_mj import optics
from physinone_mj.fidelity import DRAFT
from physinone_mj.registry import entries, phenomenon
from physinone_mj.run import Run
from physinone_mj.simulate import build, simulate

TURNS: Final = 5


def bare(run: Run, beam: Any, counts: list[int]) -> None:
    """As many rays from the beam's mouth as the beam has segments at each pose."""
    model, data, site = run.model, mujoco.MjData(run.model), run.model.site(beam.site).id
    met, normal, groups = np.zeros(1, np.int32), np.zeros(3), np.array([1, 1, 1, 0, 0, 1], np.uint8)
    body = int(model.site_bodyid[site]) or -1
    for pose, count in zip(run.qpos, counts, strict=True):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        way = data.site_xmat[site].reshape(3, 3)[:, 2].copy()
        for _ in range(count):
            mujoco.mj_ray(model, data, data.site_xpos[site], way, groups, True, body, met, normal)


def ours(run: Run) -> None:
    """All beams of the run at every pose, traced anew."""
    for beam in run.scene.beams:
        optics.follow(run.model, run.scene, beam, run.qpos)


def theirs(run: Run) -> None:
    """The same number of bare rays."""
    for beam in run.scene.beams:
        bare(run, beam, (optics.trace(run, beam.name).geoms != optics.NO_RAY).sum(axis=1).tolist())


def spent(work: Callable[[Run], None], run: Run) -> float:
    """Processor time [s]."""
    begun = time.process_time()
    work(run)
    return time.process_time() - begun


def main() -> None:
    """Print one row per phenomenon with a beam."""
    print(f"{'phenomenon':32} {'geoms':>5} {'beams':>5} {'segments':>8} {'1/s':>9} {'of bare':>7}")
    for entry in entries():
        if not build(phenomenon(entry.index)()).beams:
            continue
        run = simulate(entry.index, fidelity=DRAFT)
        total = sum(int((optics.trace(run, b.name).geoms != optics.NO_RAY).sum()) for b in run.scene.beams)
        turns = [(spent(ours, run), spent(theirs, run)) for _ in range(TURNS)]
        ratio = statistics.median(bare_time / time_ for time_, bare_time in turns)
        speed = total / statistics.median(time_ for time_, _ in turns)
        label = f"{entry.index} {entry.label}"
        print(f"{label:32} {run.model.ngeom:5} {len(run.scene.beams):5} {total:8} {speed:9.0f} {ratio:7.2f}")


if __name__ == "__main__":
    main()
