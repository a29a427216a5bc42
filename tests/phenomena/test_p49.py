"""Walls that stand, towers that lean, blocks that topple; and the programs that only look like it."""

from __future__ import annotations

import dataclasses
from math import atan

import numpy as np
import pytest

from phenomena.p49_block_wall_collapse import BlockWallCollapse
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import simulate, simulate_specimen

from .verdicts import failed, judge_random

SMALL = {"rows": 3, "columns": 3}


def breaks(run: Run, law: str) -> bool:
    return run.specimen.laws()[law].judge(run.specimen, run).verdict == "failed"


@pytest.fixture(scope="module")
def hit() -> Run:
    return simulate(49, fidelity=DRAFT, **SMALL)


def test_the_ball_brings_the_wall_down(hit: Run) -> None:
    assert hit.specimen.fallen(hit)[-1] > 0.2
    ball = hit.kinetic("ball/ball")  # it may go on turning on the spot: nothing drills into the floor
    assert (hit.motion.kinetic - ball)[-1] < 1e-3 * hit.motion.kinetic[0]
    speed = np.linalg.norm(hit.velocity("ball/ball"), axis=1)
    assert speed[-1] < 0.1 * speed[0]


@pytest.mark.slow
def test_every_law_holds_on_a_small_wall(hit: Run) -> None:
    assert not failed(hit)


def test_a_collapse_that_was_recorded_before_keeps_no_momentum(hit: Run) -> None:
    """Lazy failure (a): a pre-baked collapse, which does not know what the ball brings."""
    other = simulate(49, fidelity=DRAFT, **SMALL, speed=4.0, friction=0.0)

    def again(**changes: object) -> Run:
        return other if changes.get("friction") == 0.0 else hit.again(**changes)

    baked = dataclasses.replace(hit, again_with=again, _repeats={})
    assert breaks(baked, "slippery_ground_takes_no_momentum")


def test_above_a_block_that_is_pulled_out_the_others_fall() -> None:
    """Lazy failure (b): blocks asleep until a trigger. Nothing strikes the column; it has only lost its foot."""
    run = simulate(49, fidelity=DRAFT, **SMALL, trigger="pull", bond="stacked", speed=6.0, friction=0.3)
    sunk = run.position("row2_0/block")[:, 2]
    assert sunk[0] - sunk[-1] > 0.9 * run.specimen.size
    assert run.specimen.moved(run)[-1, -1] < 1e-6  # the column at the other end stays


def test_a_creeping_stack_breaks_its_law(hit: Run) -> None:
    """Lazy failure (c)."""
    calm = hit.again(layout="wall", trigger="none")
    qpos = calm.qpos.copy()
    qpos[:, 0] += 2e-6 * calm.t  # two micrometres a second
    creeping = dataclasses.replace(calm, qpos=qpos, _repeats={})
    assert breaks(creeping, "a_wall_stands")


def test_energy_from_nowhere_is_noticed(hit: Run) -> None:
    qvel = hit.qvel.copy()
    qvel[len(qvel) // 2 :] *= 1.5
    qvel[-1] += 1.0
    assert breaks(dataclasses.replace(hit, qvel=qvel, _repeats={}), "energy_only_falls")


@pytest.mark.parametrize(("slenderness", "factor", "stays"), [(2.0, 0.98, True), (2.0, 1.02, False)])
def test_other_blocks_topple_at_their_own_angle(slenderness: float, factor: float, stays: bool) -> None:
    tilt = factor * atan(1 / slenderness)
    run = simulate(49, fidelity=DRAFT, layout="slope", slenderness=slenderness, friction=0.9, tilt=tilt)
    assert (run.specimen.upright(run, "row0_0/block") > 0.5) == stays


def test_a_tower_one_millimetre_out_of_line_stands() -> None:
    widest = BlockWallCollapse.make(rows=6).widest
    run = simulate(49, fidelity=DRAFT, layout="tower", rows=6, overhang=0.97 * widest)
    assert run.specimen.moved(run).max() < 1e-6


def test_weight_does_not_decide_whether_a_tower_stands() -> None:
    widest = BlockWallCollapse.make(rows=4).widest
    for density in (100.0, 21300.0):
        run = simulate(49, fidelity=DRAFT, layout="tower", rows=4, overhang=1.02 * widest, density=density)
        assert run.specimen.fallen(run)[-1] > 0


def test_refusals_name_what_is_allowed() -> None:
    with pytest.raises(Refusal, match="allowed: 2"):
        BlockWallCollapse.make(layout="block", slenderness=1.0).build(Scene())


def test_random_specimens() -> None:
    rng = np.random.default_rng(1)
    for _ in range(2):
        specimen = BlockWallCollapse.sample(rng, rows=3, columns=3)
        assert not breaks(simulate_specimen(specimen, fidelity=DRAFT), "energy_only_falls")


@pytest.mark.slow
def test_more_random_specimens() -> None:
    assert judge_random(BlockWallCollapse, 8)["energy_only_falls"]


@pytest.mark.slow
def test_a_hundred_heavy_blocks_and_a_fast_ball() -> None:
    specimen = BlockWallCollapse.make(rows=10, columns=10, density=21300.0, speed=6.0, size=0.08)
    run = simulate_specimen(specimen, fidelity=DRAFT)
    assert np.isfinite(run.qpos).all()
    assert not breaks(run, "energy_only_falls")
