"""What the command line says and how: one line for an error, tables, JSON, how far a long command is."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Self

if TYPE_CHECKING:
    from rich.console import RenderableType

EXPECTED: Final = {
    "mpm_sidecar._ti.NoDevice",
    "physinone_mj.base.ParameterError",
    "physinone_mj.checks.ProcessDied",
    "physinone_mj.dataset.NotAScene",
    "physinone_mj.registry.UnknownPhenomenon",
    "render.egl.NoGL",
    "render.film.WorkerFailed",
    "render.photoreal.NoMitsuba",
}
"""Errors that are answers, told in one line; by name, since what is not needed is not imported."""

OF_ONE_SCENE: Final = {
    "physinone_mj.base.Refusal",
    "physinone_mj.dataset.SceneExists",
    "physinone_mj.simulate.UnstableScene",
    "render.rig.NoClearView",
}
"""Those that say nothing about the next scene."""

COLOURS: Final = {"passed": "green", "failed": "bold red", "not evaluated": "yellow"}
PLAIN_WIDTH: Final = 160
LINE_EVERY: Final = 5.0
"""Seconds between two lines of progress where there is no terminal."""


class BadInput(ValueError):
    """Something typed cannot be: the message says what, its value and what is allowed."""


def names(failure: BaseException) -> set[str]:
    """The full names of its class and of those it derives from."""
    return {f"{kind.__module__}.{kind.__qualname__}" for kind in type(failure).__mro__}


def told(failure: BaseException) -> str | None:
    """The line for an expected failure; None for one that is a defect of the program."""
    if isinstance(failure, BadInput) or names(failure) & (EXPECTED | OF_ONE_SCENE):
        line = str(failure)
    elif isinstance(failure, OSError):
        line = f"{failure.filename}: {failure.strerror}" if failure.filename and failure.strerror else str(failure)
    elif isinstance(failure, ImportError):
        line = f"{failure}; `physinone doctor` says what is missing"
    elif hasattr(failure, "format_message") and hasattr(failure, "exit_code"):
        line = f"{failure.format_message()} (physinone --help)"  # the command line itself was wrong
    else:
        return None
    return " ".join(line.split())


def complain(line: str) -> None:
    """One line on standard error."""
    print(f"physinone: {line}", file=sys.stderr, flush=True)


class Progress:
    """How far a long command is: a bar on a terminal, a line every few seconds elsewhere; always on standard error."""

    def __init__(self, stage: str) -> None:
        self._stage, self._begun = stage, time.monotonic()
        self._last = self._begun
        self._bar: Any = None

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
            self._bar = Bar(*columns, console=Console(stderr=True, markup=False, highlight=False), transient=True)
            self._bar.add_task(self._stage, total=None)
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def __call__(self, stage: str, fraction: float) -> None:
        """Now at this stage, with that fraction of the whole command done."""
        now = time.monotonic()
        if self._bar:
            self._bar.update(self._bar.task_ids[0], description=stage, total=1.0, completed=fraction)
        elif now - self._last >= LINE_EVERY:
            self._last = now
            left = (now - self._begun) * (1 - fraction) / fraction if fraction > 0 else float("nan")
            remaining = f", {left:.0f} s left" if left == left else ""
            print(f"{stage}: {fraction:.0%}{remaining}", file=sys.stderr, flush=True)


def say(*things: RenderableType) -> None:
    """Print to standard output: as wide as the terminal, or wide enough for a table where there is none."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else PLAIN_WIDTH
    Console(width=width, markup=False, highlight=False, emoji=False).print(*things, sep="\n")


def say_json(values: Any) -> None:
    """Print one JSON value to standard output."""
    print(json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False))


def table(*columns: str, right: Sequence[str] = ()) -> Any:
    """An empty table; the columns named in `right` hold numbers."""
    from rich import box
    from rich.table import Table

    empty = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        empty.add_column(column, justify="right" if column in right else "left", overflow="fold")
    return empty


def say_laws(laws: Sequence[Mapping[str, Any]]) -> None:
    """Verdicts, as `Verdict.record` gives them: measured, expected, and the reason where it takes words."""
    from rich.text import Text

    numbers = ("measured", "expected", "error", "tolerance")
    rows = table("phenomenon", "law", *numbers, "verdict", right=numbers)
    notes = []
    for law in laws:
        unit = f" {law['unit']}" if law["unit"] else ""
        decided = law["verdict"] != "not evaluated"
        seen = [figure(law["measured"], ".9g"), figure(law["expected"], ".9g"), figure(law["error"], ".1e") + unit]
        verdict = Text(law["verdict"], style=COLOURS[law["verdict"]])
        rows.add_row(f"{law['index']} {law['label']}", law["law"], *(seen if decided else ["", "", ""]),
                     figure(law["tolerance"], ".1e") + unit, verdict)  # fmt: skip
        why = [law["reason"]] if law["reason"] else []
        why += [f"limited by: {law['limited_by']}"] if law["limited_by"] else []
        notes += [f"{law['index']} {law['law']}: {reason}" for reason in why]
    counts = [f"{sum(law['verdict'] == kind for law in laws)} {kind}" for kind in COLOURS]
    say(rows, *notes, f"{len(laws)} laws: {', '.join(counts)}")


def figure(value: float | None, form: str) -> str:
    """A number, or nan where a record has none."""
    return "nan" if value is None else format(value, form)


ENDLESS: Final = 1e300
"""An error that has no end, as records have it: JSON knows no infinity, and it is worse than any tolerance."""


def error_figure(value: float | None) -> str:
    """An error in a table: a dash where there is none."""
    return "-" if value is None else "∞" if value >= ENDLESS else f"{value:.1e}"


def say_trade(table_: Mapping[str, Any]) -> None:
    """Error against cost, as `trade.tabulate` gives it: one block for each phenomenon."""
    for index, entry in table_.items():
        settings = entry["settings"]
        heads = [f"{s['steps']} steps" + (f", {s['cells']} cells" if entry["grid"] else "") for s in settings]
        rows = table("largest error", *heads, "order", right=[*heads, "order"])
        rows.add_row("cost", *(figure(s["cost"], ".2g") for s in settings), "")
        for law, slope in entry["orders"].items():
            errors = (error_figure(s["laws"][law]) for s in settings)
            rows.add_row(law, *errors, "-" if slope is None else f"{slope:.1f}")
        say(f"{index} {entry['label']}", rows)


def span(trusted: Mapping[str, Any]) -> str:
    """A range that was found to be trustworthy; a question mark for an end on whose side no value is."""
    ends = (trusted.get(side) for side in ("low", "high"))
    return " to ".join("?" if end is None else f"{end:.3g}" for end in ends)


def say_stress(table_: Mapping[str, Any]) -> None:
    """How the specimens of every phenomenon ended, as `stress.tabulate` gives it, and the law nearest to failing."""
    outcomes = list(dict.fromkeys(outcome for entry in table_.values() for outcome in entry["outcomes"]))
    numbers = ["specimens", *outcomes, "over its tolerance"]
    rows = table("phenomenon", *numbers[:-1], "worst law", numbers[-1], right=numbers)
    for index, entry in table_.items():
        law, ratio = entry["worst"] or ("", None)
        counts = (str(entry["outcomes"][outcome]) for outcome in outcomes)
        over = "" if ratio is None else f"{ratio:.2g}"
        rows.add_row(f"{index} {entry['label']}", str(entry["specimens"]), *counts, law, over)
    say(rows)


def say_cost(record: Mapping[str, Any]) -> None:
    """What a scene costs, as `cost.measure` gives it: by stage, what was left out, what it costs with everything on."""
    numbers = ("calls", "seconds", "share", "loops")
    rows = table("stage", *numbers, right=numbers)
    for stage in record["stages"]:
        rows.add_row(stage["stage"], f"{stage['calls']}", f"{stage['seconds']:.4f}", f"{stage['share']:.1%}",
                     f"{stage['cost']:.3g}")  # fmt: skip
    total, unit, simulated = (record[key] for key in ("seconds", "unit", "simulated"))
    rows.add_row("all", "", f"{total:.4f}", "100.0%", f"{total / simulated / unit:.3g}")
    notes = [f"seconds of the processor; loops of {unit:.3g} s for each of the {simulated:.3g} s simulated"]
    if drawn := record["pictures"]:
        notes.append(f"{drawn['drawn']} pictures, of {drawn['size']} pixels, stand for {drawn['stand_for']}")
    notes += [f"left out: {left['what']} ({left['why']})" for left in record["left_out"]]
    if both := record.get("everything_on"):
        off = ", ".join(f"{name} by up to {value:.2g}" for name, value in both["apart"].items())
        notes.append(f"the motion alone: {both['seconds']:.4f} s; with everything on {both['with_everything']:.4f} s, "
                     f"{both['ratio']:.3f} times as much; "
                     + (f"its state is off: {off}" if off else "its state is the same, bit for bit"))  # fmt: skip
    say(f"{record['index']} {record['label']} at {record['fidelity']['name']}", rows, *notes)
    for problem in record["problems"]:
        complain(problem)
