"""What bounces against programs that only look like it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from phenomena.p67_elastic_bounce import ElasticFall
from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import Scene
from physinone_mj.simulate import build, simulate_specimen

from .verdicts import failed, judge_random


def seen(cls: type[ElasticFall] = ElasticFall, **values: Any) -> Run:
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


class Indifferent(ElasticFall, domain="fluids"):
    """As stiff as ever, whatever is asked for."""

    def build(self, scene: Scene) -> None:
        dataclasses.replace(self, young=5e4).laboratory(scene)


def swinging(run: Run, decay: float) -> Run:
    """The column as an animation: it sags and swings at its own pitch, and loses a part of its swing in each."""
    own, bar = run.specimen, run.clouds["bar"]
    sag = own.density * own.weight * own.length**2 / (3 * own.modulus)
    phase = run.t / own.pitch
    height = own.length / 2 - sag * (1 - (1 - decay) ** phase * np.cos(2 * np.pi * phase))
    centre = np.column_stack([np.zeros((len(run), 2)), height])
    return dataclasses.replace(run, clouds={"bar": dataclasses.replace(bar, centre=centre)})


def test_stiffness_without_effect_is_found_out() -> None:
    """67f: the catalogue's (b). About 3 s."""
    assert "a_bar_touches_for_as_long_as_sound_takes_there_and_back" in failed(
        seen(Indifferent, setup="bar", young=2e5)
    )


def test_a_bar_that_is_caught_is_found_out() -> None:
    """67d: a fifth of its speed is lost on the floor, the time there is right. About 3 s."""
    run = seen(setup="bar")
    bar = run.clouds["bar"]
    lowest = int(np.argmin(bar.centre[:, 2]))
    centre = bar.centre.copy()
    centre[lowest:] = centre[lowest] + 0.8 * (centre[lowest:] - centre[lowest])
    broken = failed(dataclasses.replace(run, clouds={"bar": dataclasses.replace(bar, centre=centre)}))
    assert "a_bar_jumps_up_as_fast_as_it_came" in broken
    assert "a_bar_touches_for_as_long_as_sound_takes_there_and_back" not in broken


def test_a_column_that_only_stops_swinging_is_found_out() -> None:
    """67c: the catalogue's (c), a twentieth of the swing lost in each; without it the animation passes. About 4 s."""
    column = seen(setup="column")
    names = ["a_column_swings_at_its_own_pitch", "a_column_sags_under_its_weight", "a_column_goes_on_swinging"]
    ideal, damped = (failed(swinging(column, decay)) for decay in (0.0, 0.05))
    assert [name in ideal for name in names] == [False, False, False]
    assert [name in damped for name in names] == [False, False, True]


def test_a_rigid_bar_that_is_only_drawn_squashed_is_found_out() -> None:
    """67a: the catalogue's (a): it turns round at once, and its momentum says so. About 3 s."""
    run = seen(setup="bar")
    bar = run.clouds["bar"]
    turn = len(run) // 3
    momentum = np.abs(bar.momentum[:1]) * np.where(np.arange(len(run)) < turn, -1.0, 1.0)[:, None]
    rigid = dataclasses.replace(run, clouds={"bar": dataclasses.replace(bar, momentum=momentum)})
    assert "a_bar_touches_for_as_long_as_sound_takes_there_and_back" in failed(rigid)


@pytest.mark.parametrize(
    ("values", "rule"),
    [({"young": 1e4, "drop": 1.0}, "R9"), ({"young": 1.3e4, "density": 3000.0}, "R9")],
)
def test_what_would_be_turned_inside_out_is_refused(values: dict[str, float], rule: str) -> None:
    with pytest.raises(Refusal, match="allowed") as told:
        build(ElasticFall.make(**values))
    assert told.value.rule == rule


@pytest.mark.slow
def test_the_softest_that_is_allowed_stays_finite() -> None:
    """ρ g h/E = 0.29, nearly incompressible, tipped and spinning."""
    run = seen(young=1e4, poisson=0.45, drop=0.17, size=0.12, lean=0.6, spin=8.0)
    cloud = run.clouds["matter"]
    assert np.isfinite(cloud.kinetic).all()
    assert cloud.stretch[-1].min() > 0.3
    assert "energy_only_goes_away" not in failed(run)


@pytest.mark.slow
def test_random_specimens() -> None:
    decided = judge_random(ElasticFall, count=6)
    assert all(decided.values()), decided
