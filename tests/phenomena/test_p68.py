"""What is flattened and stays flat against programs that only look like it."""

from __future__ import annotations

import dataclasses
from math import sqrt

import numpy as np
import pytest

from phenomena.p68_plasticine_deform import PlasticineFall
from physinone_mj.base import Refusal
from physinone_mj.continuum import Elastic, Plasticine
from physinone_mj.fidelity import DRAFT
from physinone_mj.scene import Scene
from physinone_mj.simulate import build

from ..conftest import nominal
from .verdicts import failed, judge_random, seen

LAYER = "a_layer_clings_to_a_slope_if_it_is_thin"
WORK = "weight_works_on_flow"
STAYS = "it_stays_as_it_is"
ROD = "a_rod_is_shortened_as_by_taylor_s_impact"


class Weaker(PlasticineFall, domain="fluids"):
    """τ_Y taken for √(3/2) of the norm's threshold, as some codes do."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for continuum in scene.continua:
            for i, piece in enumerate(continuum.pieces):
                given = piece.material
                assert isinstance(given, Plasticine)
                weak = dataclasses.replace(given, yield_stress=sqrt(2 / 3) * given.yield_stress)
                continuum.pieces[i] = dataclasses.replace(piece, material=weak)


class Springy(PlasticineFall, domain="fluids"):
    """Rubber."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        for continuum in scene.continua:
            for i, piece in enumerate(continuum.pieces):
                rubber = Elastic(piece.material.young, self.poisson, self.density)  # type: ignore[attr-defined]
                continuum.pieces[i] = dataclasses.replace(piece, material=rubber)


def test_a_missing_factor_is_found_out() -> None:
    """68g: √2 and √1.5, the catalogue's (c). About 8 s."""
    broken = failed(seen(Weaker, setup="thick layer"))
    assert LAYER in broken


def test_rubber_is_found_out() -> None:
    """68c: it is as long again afterwards. About 5 s."""
    assert ROD in failed(seen(Springy, setup="rod"))


def test_what_regains_its_shape_is_found_out() -> None:
    """68f, first half: the catalogue's (a), a damped elastic lump, would rise again: by a tenth of what it lost, long
    before the last second; and what creeps on in that is found out, too. With the nominal run."""
    run = nominal(68, DRAFT)
    cloud = run.clouds["matter"]
    high = cloud.high - cloud.low[:, 2:]
    assert high[-1, 2] < 0.8 * high[0, 2]
    assert cloud.kinetic[-1] < 1e-3 * cloud.kinetic.max()
    assert STAYS not in failed(run)
    lowest = int(np.argmin(high[:, 2]))
    again = np.clip((run.t - run.t[lowest]) / 0.3, 0.0, 1.0) * 0.1 * (high[0, 2] - high[lowest, 2])
    creep = 2e-2 * high[0, 2] * run.t / run.t[-1]
    for rise in (again, -creep):
        tampered = dataclasses.replace(cloud, high=cloud.high + np.outer(rise, (0, 0, 1)))
        assert STAYS in failed(dataclasses.replace(run, clouds={"matter": tampered}))


@pytest.mark.slow
def test_rubber_does_not_stay_flat() -> None:
    broken = failed(seen(Springy))
    assert STAYS in broken
    assert "it_hardly_jumps" in broken


def test_work_that_goes_nowhere_is_found_out() -> None:
    """68f, second half: a tenth of what the flow takes is left out, as where something damps it. About 12 s."""
    run = seen(PlasticineFall, setup="tall column")
    assert WORK not in failed(run)
    bar = run.clouds["bar"]
    damped = dataclasses.replace(run, clouds={"bar": dataclasses.replace(bar, dissipated=0.9 * bar.dissipated)})
    assert WORK in failed(damped)


def test_what_is_springy_may_jump() -> None:
    """68e: a lump whose yield stress is a fifteenth of its modulus does, and was judged. With the nominal run."""
    made, hardly = nominal(68, DRAFT), PlasticineFall.laws()["it_hardly_jumps"]
    assert hardly.judge(PlasticineFall.make(yield_stress=1e4), made).passed is None
    assert hardly.judge(PlasticineFall.make(), made).passed


@pytest.mark.slow
def test_the_stronger_the_higher_it_stays() -> None:
    """68: the catalogue's (b)."""
    heights = [
        seen(PlasticineFall, yield_stress=strength).clouds["matter"].high[-1, 2] for strength in (800.0, 2500.0, 8000.0)
    ]
    assert heights[0] < 0.8 * heights[1] < 0.7 * heights[2]


@pytest.mark.parametrize(
    ("values", "rule"), [({"young": 1e4, "drop": 0.5}, "R9"), ({"young": 4e4, "yield_stress": 1e4}, "R12")]
)
def test_what_is_no_plasticine_is_refused(values: dict[str, float], rule: str) -> None:
    with pytest.raises(Refusal, match="allowed") as told:
        build(PlasticineFall.make(**values))
    assert told.value.rule == rule


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(PlasticineFall, count=5)
    assert all(decided.values()), decided
