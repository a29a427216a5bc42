"""What the tests of single phenomena share: verdicts by name, and random specimens judged."""

from __future__ import annotations

import numpy as np

from physinone_mj.base import Phenomenon, Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen


def verdicts(run: Run) -> dict[str, str]:
    """ "passed", "failed" or "not evaluated" of every law, by its name."""
    return {v.law: v.verdict for v in run.check()}


def failed(run: Run) -> set[str]:
    """Names of the laws that the run breaks."""
    return {law for law, verdict in verdicts(run).items() if verdict == "failed"}


def judge_random(cls: type[Phenomenon], count: int = 12, seed: int = 0) -> dict[str, int]:
    """Simulate random specimens at DRAFT; none may fail a law. Returns how often each law was decided."""
    rng = np.random.default_rng(seed)
    decided = dict.fromkeys(cls.laws(), 0)
    for _ in range(count):
        specimen = cls.sample(rng)
        try:
            run = simulate_specimen(specimen, fidelity=DRAFT)
        except Refusal as refusal:
            assert "allowed" in str(refusal), refusal  # noqa: PT017  (a refusal is an answer, not an accident)
            continue
        for v in run.check():
            assert v.verdict != "failed", (specimen, v)
            decided[v.law] += v.verdict == "passed"
    return decided
