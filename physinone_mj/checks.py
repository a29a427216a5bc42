"""Many phenomena held against their laws: in processes, since MuJoCo's force callback belongs to the process."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any, TypeAlias

from .terminal import Progress, told

if TYPE_CHECKING:
    from .fidelity import Fidelity

Task: TypeAlias = "tuple[int, dict[str, Any], Fidelity]"
"""Index, parameters that are set, fidelity."""

Judgement: TypeAlias = tuple[list[dict[str, Any]], str | None]
"""(records of the verdicts, None), or ([], the line that says why there are none)."""


class ProcessDied(RuntimeError):
    """A process was killed from outside; most often the machine was out of memory."""


def judge(task: Task, progress: Callable[[float], None] | None = None) -> Judgement:
    """Simulate one phenomenon and judge its laws."""
    from .simulate import simulate

    index, parameters, fidelity = task
    try:
        run = simulate(index, fidelity=fidelity, progress=progress, **parameters)
        return [verdict.record() for verdict in run.check()], None
    except Exception as failure:
        line = told(failure)
        if line is None:
            raise
        return [], line


def judge_all(tasks: Sequence[Task], names: Sequence[str]) -> Iterator[Judgement]:
    """What `judge` says of every task, in order, one process per core; alone, a task stays in this process."""
    with Progress(names[0]) as progress:
        if len(tasks) == 1:
            yield judge(tasks[0], lambda done: progress(names[0], done))
            return
        workers = min(len(tasks), len(os.sched_getaffinity(0)))
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))
        try:
            for n, (name, result) in enumerate(zip(names, pool.map(judge, tasks), strict=True), start=1):
                progress(name, n / len(tasks))
                yield result
        except BrokenProcessPool:
            raise ProcessDied("a process that checked laws was killed, perhaps for want of memory") from None
        except BaseException:
            # the pool would otherwise wait for what nobody wants any more
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
