"""Many phenomena held against their laws: in processes, since MuJoCo's force callback belongs to the process."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from . import __version__
from .terminal import Progress, figure, told

if TYPE_CHECKING:
    from .fidelity import Fidelity

_T = TypeVar("_T")
_R = TypeVar("_R")
_Words = TypeVar("_Words", bound=tuple[Any, ...])

Task: TypeAlias = "tuple[int, dict[str, Any], Fidelity]"
"""Index, parameters that are set, fidelity."""

Judgement: TypeAlias = tuple[list[dict[str, Any]], str | None]
"""(records of the verdicts, None), or ([], the line that says why there are none). A record also has the processor
time that the phenomenon took with all runs of its laws, `seconds`, and how long its scene lasts, `simulated` [s]."""


class ProcessDied(RuntimeError):
    """A process was killed from outside; most often the machine was out of memory."""


def judge(task: Task, progress: Callable[[float], None] | None = None) -> Judgement:
    """Simulate one phenomenon and judge its laws."""
    from .simulate import simulate

    index, parameters, fidelity = task
    begun = time.process_time()
    try:
        run = simulate(index, fidelity=fidelity, progress=progress, **parameters)
        records = [verdict.record() for verdict in run.check()]
        cost = {"seconds": time.process_time() - begun, "simulated": float(run.t[-1])}
        return [record | cost for record in records], None
    except Exception as failure:
        line = told(failure)
        if line is None:
            raise
        return [], line


def judge_all(tasks: Sequence[Task], names: Sequence[str]) -> list[Judgement]:
    """What `judge` says of every task, in order; alone, a task stays in this process."""
    if len(tasks) == 1:
        with Progress(names[0]) as progress:
            return [judge(tasks[0], lambda done: progress(names[0], done))]
    found = dict(spread(judge, tasks, names))
    return [found[n] for n in range(len(tasks))]


def spread(work: Callable[[_T], _R], tasks: Sequence[_T], names: Sequence[str]) -> Iterator[tuple[int, _R]]:
    """(number, result) of every task, as they come: one process per core, each of which does one task after another.

    ProcessDied if one is killed from outside; what the work itself raises passes through.
    """
    if not tasks:
        return
    workers = min(len(tasks), len(os.sched_getaffinity(0)))
    context = multiprocessing.get_context("spawn")
    threads = max(1, len(os.sched_getaffinity(0)) // workers)
    with Progress(names[0]) as progress:
        pool = ProcessPoolExecutor(workers, context, _begin, (threads,))
        try:
            waiting = {pool.submit(work, task): n for n, task in enumerate(tasks)}
            for done, future in enumerate(as_completed(waiting), start=1):
                progress(names[waiting[future]], done / len(tasks))
                yield waiting[future], future.result()
        except BrokenProcessPool:
            raise ProcessDied("a process that was at work was killed, perhaps for want of memory") from None
        except BaseException:
            # the pool would otherwise wait for what nobody wants any more
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def journal(
    work: Callable[[_Words], Any], tasks: Sequence[_Words], name: Callable[[_Words], str], path: Path
) -> dict[_Words, Any]:
    """Results by task, of which those are worked out that a file does not hold yet; each is a line of it as it comes.

    Run again, it goes on where it was stopped. A task is a tuple, and it and its result are JSON values.
    ValueError if the file is not of this version.
    """
    known = read_journal(path)
    new = [task for task in dict.fromkeys(tasks) if task not in known]
    path.parent.mkdir(parents=True, exist_ok=True)
    for n, result in spread(work, new, [name(task) for task in new]):
        known[new[n]] = result
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([__version__, new[n], result], allow_nan=False) + "\n")
    return {task: known[task] for task in tasks}


def read_journal(path: Path) -> dict[Any, Any]:
    """What a file of `journal` holds; a last line that was cut off is taken out of it."""
    if not path.exists():
        return {}
    known: dict[Any, Any] = {}
    lines = path.read_text(encoding="utf-8").split("\n")
    if lines[-1]:
        put_in_place(path, "\n".join([*lines[:-1], ""]))
    for line in lines[:-1]:
        version, task, result = json.loads(line)
        if version != __version__:
            raise ValueError(f"{path}: measured with version {version}; allowed: {__version__}, or another file")
        known[tuple(task)] = result
    return known


def put_in_place(file: Path, text: str) -> None:
    """Write a file whole or not at all: what it held took hours to measure, and the disk may be full."""
    partial = file.with_name(f".{file.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)


def _begin(threads: int) -> None:
    """A process of the pool: Ctrl-C is its parent's, and Taichi has its share of the cores."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", str(threads))


def report(records: Sequence[Mapping[str, Any]], missing: Sequence[str]) -> str:
    """The verdicts as a page of Markdown: measured, expected, error, tolerance, cost, and where each law stops."""
    fidelities = ", ".join(dict.fromkeys(record["fidelity"] for record in records))
    passed = sum(record["passed"] is True for record in records)
    lines = [
        f"# Laws at {fidelities} fidelity",
        "",
        "Generated by `physinone check --report`; not to be edited.",
        "",
        f"{passed} of {len(records)} laws passed. Errors and tolerances are relative, unless they have a unit. The "
        "cost of a phenomenon is the processor time of all the runs that its laws ask for, beside how long its scene "
        "lasts.",
        *(f"\n**{line}**" for line in missing),
    ]
    for (index, label), laws in itertools.groupby(records, lambda record: (record["index"], record["label"])):
        group = list(laws)
        cost = f"{group[0]['seconds']:.1f} s for {group[0]['simulated']:.1f} s"
        lines += ["", f"## {index} {label}", "", f"Cost: {cost}.", ""]
        lines += ["| law | equation | measured | expected | error | tolerance | verdict |", "|---" * 7 + "|"]
        notes = []
        for law in group:
            unit = f" {law['unit']}" if law["unit"] else ""
            equation = law["equation"].replace("|", "\\|")
            error, tolerance = figure(law["error"], ".1e") + unit, figure(law["tolerance"], ".2g") + unit
            lines.append(f"| {law['law'].replace('_', ' ')} | {equation} | {figure(law['measured'], '.8g')} | "
                         f"{figure(law['expected'], '.8g')} | {error} | {tolerance} | {law['verdict']} |")  # fmt: skip
            notes += [f"- {law['law'].replace('_', ' ')}: source: {law['source']}" + (
                f"; limited by: {law['limited_by']}" if law["limited_by"] else ""
            ) + (f"; {law['reason']}" if law["reason"] else "")]  # fmt: skip
        lines += ["", *notes]
    return "\n".join(lines) + "\n"
