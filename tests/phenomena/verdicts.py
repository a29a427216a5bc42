"""What the tests of single phenomena share: runs at DRAFT, verdicts by name, and random specimens judged."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Set
from typing import Any

import numpy as np

from physinone_mj.base import Phenomenon, Refusal
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.simulate import simulate_specimen


class Verdicts(Mapping[str, str]):
    """ "passed", "failed" or "not evaluated" of every law, by its name; a law is judged when it is asked for."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._laws = run.specimen.laws()
        self._known: dict[str, str] = {}

    def __getitem__(self, law: str) -> str:
        if law not in self._known:
            self._known[law] = self._laws[law].judge(self._run.specimen, self._run).verdict
        return self._known[law]

    def __iter__(self) -> Iterator[str]:
        return iter(self._laws)

    def __len__(self) -> int:
        return len(self._laws)


class Failed(Set[str]):
    """Names of the laws that a run breaks; a law is judged when it is asked for."""

    def __init__(self, verdicts: Verdicts) -> None:
        self._verdicts = verdicts

    @classmethod
    def _from_iterable(cls, names: Iterable[str]) -> Set[str]:  # type: ignore[override]
        return frozenset(names)

    def __contains__(self, law: object) -> bool:
        return self._verdicts[str(law)] == "failed"

    def __ge__(self, names: Set[object]) -> bool:
        return all(name in self for name in names)

    def __iter__(self) -> Iterator[str]:
        return (law for law in self._verdicts if law in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def seen(cls: type[Phenomenon], **values: Any) -> Run:
    """A specimen, simulated at DRAFT."""
    return simulate_specimen(cls.make(**values), fidelity=DRAFT)


def verdicts(run: Run) -> Verdicts:
    """Of every law, by its name."""
    return Verdicts(run)


def failed(run: Run) -> Failed:
    """Names of the laws that the run breaks."""
    return Failed(Verdicts(run))


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
