"""Every law of every phenomenon: it holds, its error shrinks, it can fail. Nothing here knows a phenomenon."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from physinone_mj.base import Law, Param, Verdict
from physinone_mj.fidelity import DRAFT, REFERENCE, STANDARD, Fidelity
from physinone_mj.registry import entries, phenomenon

from .conftest import nominal, tampered

ROUND_OFF = 1e-11
"""Relative error below which a double-precision trajectory of thousands of steps cannot be expected to improve."""

LAWS = [
    pytest.param(entry.index, law, id=f"{entry.index}-{law.name}")
    for entry in entries()
    for law in phenomenon(entry.index).laws().values()
]
each_law = pytest.mark.parametrize(("index", "law"), LAWS)

SHORT = {10, 23, 26, 33, 36, 39, 46, 47}
"""Whose laws take seconds at standard fidelity: those of others the suite holds at draft, the study at all three."""

MATTER = {67, 68, 69, 70, 71}
"""Those whose twins take long at draft, too: the study tells lies about them, the suite those of `tests/phenomena`."""

each_law_but_of_matter = pytest.mark.parametrize(
    ("index", "law"),
    [pytest.param(*one.values, id=one.id, marks=pytest.mark.slow if one.values[0] in MATTER else []) for one in LAWS],
)

each_law_at_standard = pytest.mark.parametrize(
    ("index", "law"),
    [pytest.param(*one.values, id=one.id, marks=[] if one.values[0] in SHORT else pytest.mark.slow) for one in LAWS],
)


def holds(index: int, law: Law, fidelity: Fidelity) -> None:
    run = nominal(index, fidelity)
    verdict = law.judge(run.specimen, run)
    assert verdict.verdict == "passed", verdict


LONGEST = {
    (68, "a_column_stands_if_it_can_bear_its_own_weight"),
    (69, "it_fills_what_it_is_in"),
    (69, "viscosity_sets_the_clock"),
    (70, "a_heap_stops_round"),
    (70, "a_mound_stops_where_it_is_thin_enough"),
    (71, "a_column_runs_out"),
    (71, "a_deposit_is_no_steeper_than_a_slope"),
    (71, "weight_sets_the_clock_and_nothing_else"),
}
"""Laws that take long even at draft: the study holds them at all three."""

each_law_at_draft = pytest.mark.parametrize(
    ("index", "law"),
    [
        pytest.param(index, law, id=one.id, marks=pytest.mark.slow if (index, law.name) in LONGEST else [])
        for one in LAWS
        for index, law in [one.values]
    ],
)


@each_law_at_draft
def test_holds_at_draft(index: int, law: Law) -> None:
    holds(index, law, DRAFT)


@each_law_at_standard
def test_holds_at_standard(index: int, law: Law) -> None:
    holds(index, law, STANDARD)


@pytest.mark.slow
@each_law
def test_holds_at_reference(index: int, law: Law) -> None:
    holds(index, law, REFERENCE)


@each_law_at_standard
def test_error_shrinks(index: int, law: Law) -> None:
    if law.limited_by:
        return  # the defect is declared, printed, and bounded by `within`
    coarse = dataclasses.replace(STANDARD, name="8x coarser", steps=STANDARD.steps // 8)
    errors = [law.error(*law.measure(r.specimen, r))[0] for r in (nominal(index, coarse), nominal(index, STANDARD))]
    floor = ROUND_OFF if law.unit is None else law.within[2]
    assert errors[1] <= max(errors[0] / 4, floor), errors


def claims(specimen: Any, lie: float) -> list[Any]:
    """The specimen with one parameter at a time claimed larger by a factor (or smaller, where the range ends; or not at
    all, where it is too narrow)."""
    claimed = []
    for name, (param, kind) in specimen.declarations().items():
        value = getattr(specimen, name)
        if isinstance(param, Param) and kind is float and value != 0:
            allowed = [other for other in (value * lie, value / lie) if param.low <= other <= param.high]
            claimed += [dataclasses.replace(specimen, **{name: other}) for other in allowed[:1]]
    return claimed


def finds_out(index: int, law: Law, fidelity: Fidelity, lie: float) -> None:
    run = nominal(index, fidelity)
    if law.unit is None:
        lie = max(lie, 1 + 3 * law.within[fidelity.rank])  # what is known to a tenth only rules out what is far off

    def false() -> Iterator[Verdict]:
        """Verdicts that ought not all to be "passed", those that cost least first."""
        for twins in (False, True):
            yield law.judge(run.specimen, tampered(run, clock=lie, twins=twins))
            yield law.judge(run.specimen, tampered(run, growth=lie, twins=twins))
            if not twins:
                yield from (law.judge(claim, run) for claim in claims(run.specimen, lie))

    seen = []
    for verdict in false():
        if verdict.verdict == "failed":
            return
        seen.append((verdict.error, verdict.tolerance))
    pytest.fail(f"nothing false is found out: {seen}")


@each_law_but_of_matter
def test_can_fail_at_draft(index: int, law: Law) -> None:
    """A lie of 3 %, or three times what the law allows, of matter on a grid."""
    finds_out(index, law, DRAFT, 1.03)


@pytest.mark.slow
@each_law
def test_can_fail_at_standard(index: int, law: Law) -> None:
    finds_out(index, law, STANDARD, 1.01)


@each_law
def test_nan_fails(index: int, law: Law) -> None:
    assert not law.error(math.nan, 1.0)[0] <= law.within[0]
    assert not law.error(np.array([1.0, math.nan]), np.array([1.0, 1.0]))[0] <= law.within[0]
