"""Random specimens over the full ranges: each is simulated, or refused with its reason before it starts."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.registry import entries, phenomenon
from physinone_mj.simulate import OVERSAMPLING, Stepper, build, compile, simulate_specimen

each = pytest.mark.parametrize("index", [e.index for e in entries()])
MATTER = {67, 68, 69, 70, 71}
"""Minutes each: the suite sees how their specimens begin, the study how they end."""


def draw(index: int, count: int, seed: int) -> Counter[str]:
    """How many specimens were simulated, and how many refused by which rule."""
    outcome: Counter[str] = Counter()
    for k in range(count):
        specimen = phenomenon(index).sample(np.random.default_rng([seed, index, k]))
        try:
            run = simulate_specimen(specimen, fidelity=DRAFT)
        except Refusal as refusal:
            assert "allowed" in str(refusal), refusal  # noqa: PT017  (a refusal is an answer, not an accident)
            outcome[refusal.rule] += 1
            continue
        assert np.isfinite(run.qpos).all()
        assert np.isfinite(run.qvel).all()
        outcome["simulated"] += 1
    return outcome


@pytest.mark.parametrize(
    "index", [pytest.param(e.index, marks=pytest.mark.slow if e.index in MATTER else []) for e in entries()]
)
def test_a_random_specimen(index: int) -> None:
    draw(index, 1, seed=0)


@pytest.mark.parametrize("index", sorted(MATTER))
def test_two_random_specimens_of_matter_begin(index: int) -> None:
    """A frame of each."""
    for k in range(2):
        specimen = phenomenon(index).sample(np.random.default_rng([0, index, k]))
        try:
            with Stepper(compile(specimen, build(specimen), DRAFT)) as stepper:
                for _ in range(OVERSAMPLING):
                    stepper.advance()
                stepper.inspect()
                seen = [x for medium in stepper.media for piece in medium.particles() for x in piece]
                assert all(np.isfinite(x).all() for x in seen)
        except Refusal as refusal:
            assert "allowed" in str(refusal), refusal  # noqa: PT017


@pytest.mark.slow
@each
def test_two_hundred_random_specimens(index: int) -> None:
    outcome = draw(index, 200, seed=7)
    assert outcome["simulated"] >= 100, outcome
