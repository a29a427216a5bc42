"""Random specimens over the full ranges: each is simulated, or refused with its reason before it starts."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from physinone_mj.base import Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.registry import entries, phenomenon
from physinone_mj.simulate import simulate_specimen

each = pytest.mark.parametrize("index", [e.index for e in entries()])


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


@each
def test_two_random_specimens(index: int) -> None:
    draw(index, 2, seed=0)


@pytest.mark.slow
@each
def test_two_hundred_random_specimens(index: int) -> None:
    outcome = draw(index, 200, seed=7)
    assert outcome["simulated"] >= 100, outcome
