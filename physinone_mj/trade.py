"""What an answer's error is and what it costs, measured: every law of a phenomenon at ever finer settings.

A setting is a `Fidelity`: of the LADDER for what is rigid, of the GRIDS for matter. The nominal specimen climbs all of
it; random ones until no error gets smaller any more. From that comes, for every law and setting, the largest error over
the ranges of the parameters, and the observed order of convergence; `fidelity.cheapest` picks from it by tolerance.

A cost is the processor's time of the scene's own run (not of the laws' twins) for a simulated second, over that of a
loop of fixed work beside it, `calibrate`: so it carries from machine to machine, as far as they are alike.

For study the nominal specimen is also advanced in each other way that the engine offers (`Compiled.alternatives`).
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import statistics
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import mujoco
import numpy as np

from .base import NotEvaluated, ParameterError, Phenomenon, Refusal
from .checks import journal
from .fidelity import DRAFT, SAFETY, Fidelity
from .registry import phenomenon
from .run import Run
from .simulate import OURS, Engine, UnstableScene, build, compile, simulate_specimen
from .terminal import ENDLESS, error_figure, figure

Record: TypeAlias = dict[str, Any]
"""What came of one specimen at one setting, as JSON values: see `climb`."""

BETWEEN: Final = 45, 91
"""Steps of the settings that halve an octave, so that what is picked by tolerance costs little more than it must.
Orders of convergence are those of whole octaves."""
LADDER: Final = tuple(Fidelity(f"{n} steps", n, 8, 4) for n in sorted((32, 64, 128, 256, 512, *BETWEEN)))
GRIDS: Final = tuple(Fidelity(f"{cells} cells", steps, cells, 4) for steps, cells in ((64, 8), (128, 12), (256, 16)))
"""For matter; its cells cost the fourth power."""
SPECIMENS: Final = 8
"""Random ones, unless told otherwise."""
FINEST: Final = 64
"""Steps at which random specimens stop climbing; beyond, their errors are taken to shrink as the nominal one's."""
STUDIED: Final = (64,)
"""Steps at which other engines are tried."""
FLOOR: Final = 1e-11
"""Relative error of round-off: less is not to be had."""
GAIN: Final = 0.7
"""An error that is not smaller than this, over that of half as fine a setting, has stopped shrinking."""
SLOWER: Final = 0.3
"""By which a law's order of convergence may fall short of the integrator's."""
_SHRINKS: Final = 1.2
"""By which an error that converges is less, at least, than that of half as fine a setting: with order 1/4."""
_LOOP: Final = 20_000
_BALLS: Final = """
<mujoco><option integrator="RK4"/><worldbody><body><joint axis="0 1 0"/><geom size=".1" pos="0 0 -1"/>
<body pos="0 0 -1"><joint axis="0 1 0"/><geom size=".1" pos="0 0 -1"/></body></body></worldbody></mujoco>
"""


@functools.cache
def _pendulum() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(_BALLS)
    return model, mujoco.MjData(model)


def calibrate() -> float:
    """Processor time [s] of a fixed work, the unit of cost: 20 000 Runge-Kutta steps of a double pendulum."""
    model, data = _pendulum()
    mujoco.mj_resetData(model, data)
    data.qpos[:] = 1.0, 0.5
    begun = time.process_time()
    mujoco.mj_step(model, data, _LOOP)
    return time.process_time() - begun


def ladder(cls: type[Phenomenon]) -> tuple[Fidelity, ...]:
    """The settings of a phenomenon, from coarse to fine."""
    return GRIDS if build(cls.make()).continua else LADDER


def specimen(cls: type[Phenomenon], seed: int, number: int) -> Phenomenon:
    """Number 0 is the nominal one, the others are drawn over the full ranges; one that is refused is drawn anew."""
    if not number:
        return cls.make()
    for attempt in range(100):
        drawn = cls.sample(np.random.default_rng([seed, cls.index, number, attempt]))
        try:
            compile(drawn, build(drawn), Fidelity("finest", 1 << 20, 32, 4))
        except Refusal as refusal:
            if refusal.rule == "R10":  # too many steps at that fidelity, which nobody asks for
                return drawn
            continue
        return drawn
    raise ValueError(f"{cls.label}: 100 random specimens were refused; seed = {seed}")


def attempt(what: Phenomenon, setting: Fidelity, engine: Engine = OURS) -> Record:
    """One specimen at one setting: how it ended, its cost, and each law's error or the reason why there is none."""
    record: Record = {"steps": setting.steps, "cells": setting.cells, "engine": engine.name, "outcome": "done"}
    unit = calibrate()
    try:
        run = simulate_specimen(what, fidelity=setting, engine=engine)
    except (Refusal, UnstableScene) as why:
        kind = "refused" if isinstance(why, Refusal) else "unstable"
        return record | {"outcome": kind, "why": " ".join(str(why).split())}
    unit = (unit + calibrate()) / 2
    simulated = float(run.t[-1])
    record |= {"seconds": run.seconds, "simulated": simulated, "cost": run.seconds / simulated / unit}
    record |= {"step": run.step, "resolved": run.scene.time / run.step}
    record["state"] = [*run.qpos[len(run) // 4], *run.qpos[len(run) // 2]]
    errors: dict[str, float | None] = {}
    silent: dict[str, str] = {}
    steps: dict[str, float] = {}
    twins = _Twins()
    run = dataclasses.replace(run, _repeats=twins)
    for law in what.laws().values():
        twins.asked.clear()
        try:
            error = law.error(*law.measure(what, run))[0]
        except (NotEvaluated, Refusal, UnstableScene, ParameterError) as why:
            errors[law.name], silent[law.name] = None, " ".join(str(why).split())
        except (ArithmeticError, IndexError, KeyError, ValueError) as why:
            if engine is OURS:
                raise
            # another engine may not record what a law reads: impacts, loads
            errors[law.name], silent[law.name] = None, f"{type(why).__name__}: {why}"
        else:
            errors[law.name] = error if math.isfinite(error) else ENDLESS
            steps[law.name] = max(twins.asked, default=run.step)
    return record | {"errors": errors, "silent": silent, "law_steps": steps}


class _Twins(dict[Any, Run]):
    """The repeats of a run, with the steps of those that are asked for: of a law's twins, not of the scene itself."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[float] = []

    def __getitem__(self, key: Any) -> Run:
        twin = super().__getitem__(key)
        self.asked.append(twin.step)
        return twin


Rung: TypeAlias = "tuple[int, int, int, bool]"
"""Index, seed, number of the specimen, whether other engines are tried."""


def climb(rung: Rung) -> list[Record]:
    """All that is measured of one specimen: its records from coarse to fine, those of other engines last."""
    index, seed, number, study = rung
    cls = phenomenon(index)
    what, settings = specimen(cls, seed, number), ladder(cls)
    attempt(cls.make(), settings[0])  # compilers do their work before anything is timed
    head = {"index": index, "seed": seed, "specimen": number, "values": what.values()}
    records: list[Record] = []
    for setting in settings:
        if number and setting.steps > FINEST and any(record["outcome"] == "done" for record in records):
            break
        records.append(head | attempt(what, setting))
        if number and _stopped(records):
            break
    if study:
        for setting in settings:
            if setting.steps in STUDIED:
                for engine in compile(what, build(what), setting).alternatives:
                    records.append(head | attempt(what, setting, engine))
    return records


def _stopped(records: Sequence[Record]) -> bool:
    """Whether no law's error shrinks any more: twice in a row, or it is that of round-off."""
    whole = (record for record in records if record["outcome"] == "done" and record["steps"] not in BETWEEN)
    apart = {(record["step"], record["cells"]): record["errors"] for record in whole}
    done = list(apart.values())[-3:]
    if len(done) < 2:
        return False
    last = {name: error for name, error in done[-1].items() if error is not None}
    if all(error <= FLOOR for error in last.values()):
        return True
    return len(done) == 3 and all(
        error <= FLOOR or all(
            earlier.get(name) is not None and later.get(name) is not None and later[name] > GAIN * earlier[name]
            for earlier, later in itertools.pairwise(done)
        )
        for name, error in last.items()
    )  # fmt: skip


def measure(rungs: Sequence[Rung], path: Path) -> list[Record]:
    """Climb what has not been climbed yet: a `journal`, at `path`."""
    found = journal(climb, rungs, lambda rung: f"{rung[0]} {phenomenon(rung[0]).label}, specimen {rung[2]}", path)
    return [record for rung in rungs for record in found[rung]]


def order(fineness: Sequence[float], errors: Sequence[float | None]) -> float | None:
    """Observed order of convergence: slope of log error against log fineness (1/step, 1/cell) while the error shrinks.

    Over the longest stretch in which each error is clearly less than the one before and above round-off, without its
    end if that is clearly flatter, nor a beginning that is (steps too long for the limit); None if these are not three
    settings. Where something happens within a step, a release or a rope that goes taut, errors jump about their trend:
    hence all of it.
    """
    apart = dict(zip(fineness, errors, strict=True))
    known = [(n, e) for n, e in sorted(apart.items()) if e is not None and FLOOR < e < ENDLESS]
    best: list[tuple[float, float]] = []
    for start in range(len(known)):
        part = [known[start]]
        for n, e in known[start + 1 :]:
            if not e < part[-1][1] / _SHRINKS:
                break
            part.append((n, e))
        if len(part) > len(best):
            best = part
    if len(best) < 3:
        return None
    n, e = np.log(np.array(best)).T
    slopes = np.diff(e) / np.diff(n)
    if len(n) > 3 and slopes[-1] > 0.85 * slopes[-2]:
        n, e, slopes = n[:-1], e[:-1], slopes[:-1]
    while len(n) > 3 and slopes[0] > 0.85 * slopes[1]:
        n, e, slopes = n[1:], e[1:], slopes[1:]
    return float(-np.polyfit(n, e, 1)[0])


def tabulate(records: Iterable[Record]) -> dict[str, Any]:
    """What is kept of the records, by index: of each setting its cost and every law's largest error over all specimens.

    A specimen that stopped climbing keeps its last errors; those that came to FINEST shrink beyond as the nominal one.
    """
    by_index: dict[int, list[Record]] = defaultdict(list)
    for record in records:
        by_index[record["index"]].append(record)
    return {str(index): _table(index, found) for index, found in sorted(by_index.items())}


def _table(index: int, records: Sequence[Record]) -> dict[str, Any]:
    ours = [r for r in records if r["engine"] == OURS.name]
    numbers = sorted({r["specimen"] for r in ours})
    at = {(r["specimen"], r["steps"]): r for r in ours}
    nominal = [r for r in ours if r["specimen"] == 0]
    laws = list(phenomenon(index).laws())
    settings: list[dict[str, Any]] = []
    latest: dict[int, dict[str, float | None]] = {}
    broken: dict[int, bool] = {}
    share = 1.0
    for setting in ladder(phenomenon(index)):
        base = at.get((0, setting.steps))
        if base is None:
            continue
        own, before = base.get("errors", {}), settings[-1]["nominal"] if settings else {}
        both = [law for law in laws if before.get(law) and own.get(law) is not None]
        smaller = {law: min(1.0, own[law] / before[law]) for law in both}
        for number in numbers:
            record = at.get((number, setting.steps))
            if record is not None:
                broken[number] = record["outcome"] != "done"
                latest[number] = record.get("errors", {})
            elif setting.steps > FINEST and (number, FINEST) in at:
                latest[number] = {law: e and e * smaller.get(law, 1.0) for law, e in latest[number].items()}
        worst = {law: max((x for e in latest.values() if (x := e.get(law)) is not None), default=None) for law in laws}
        costs = [at[number, setting.steps]["cost"] for number in numbers
                 if "cost" in at.get((number, setting.steps), {})]  # fmt: skip
        if setting.steps <= FINEST and costs and "cost" in base:
            share = statistics.median(costs) / base["cost"]  # of the usual specimen's cost in the nominal one's
        settings.append({
            "steps": setting.steps, "cells": setting.cells,
            "cost": share * base["cost"] if "cost" in base else None, "resolved": base.get("resolved"),
            "broken": sum(broken.values()),
            "unstable": sum(r["outcome"] == "unstable" for (_, steps), r in at.items() if steps == setting.steps),
            "specimens": len(numbers), "nominal": {law: own.get(law) for law in laws},
            "laws": worst,
        })  # fmt: skip
    grid = ladder(phenomenon(index)) is GRIDS
    done = [r for r in nominal if r["outcome"] == "done" and r["steps"] not in BETWEEN]
    fineness = [float(r["cells"]) if grid else 1 / r["step"] for r in done]
    orders = {}
    for law in laws:
        twins = [r.get("law_steps", {}).get(law, r["step"]) for r in done]  # what a law judges may not be the scene
        orders[law] = order(fineness if grid else [1 / step for step in twins], [r["errors"][law] for r in done])
    states = np.array([r["state"] for r in done])
    gaps = np.abs(states - states[-1:]).max(axis=1, initial=0.0) / max(np.abs(states).max(initial=0.0), 1e-9)
    path = order(fineness[:-1], gaps[:-1].tolist())
    engines = [
        {"engine": r["engine"], "steps": r["steps"], "cells": r["cells"], "outcome": r["outcome"],
         "cost": r.get("cost"), "errors": r.get("errors", {})}
        for r in records if r["engine"] != OURS.name and r["specimen"] == 0
    ]  # fmt: skip
    made = compile(phenomenon(index).make(), build(phenomenon(index).make()), DRAFT)
    head = {
        "label": phenomenon(index).label, "grid": grid, "path_order": path,
        "integrator_order": None if grid else 2 if made.constrained else 4,
    }  # fmt: skip
    return head | {"settings": settings, "orders": orders, "engines": engines}


def rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A table flat: one row for a law at a setting, as for CSV."""
    return [
        {
            "index": int(index), "label": entry["label"], "law": law, "steps": setting["steps"],
            "cells": setting["cells"], "cost": setting["cost"], "nominal_error": setting["nominal"][law],
            "largest_error": setting["laws"][law], "specimens": setting["specimens"], "broken": setting["broken"],
            "order": entry["orders"][law],
        }
        for index, entry in table.items() for setting in entry["settings"] for law in setting["laws"]
    ]  # fmt: skip


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those (cost, error) that no other one beats in both, in the order of cost."""
    best: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not best or error < best[-1][1]:
            best.append((cost, error))
    return best


def worst(setting: Mapping[str, Any], key: str = "laws") -> float | None:
    """Largest error of any law at a setting; None if none was evaluated or a specimen could not be simulated."""
    errors = [error for error in setting[key].values() if error is not None]
    return None if setting["broken"] or not errors else max(errors)


def plot(entry: Mapping[str, Any], path: Path) -> None:
    """Error against cost of one phenomenon, double logarithmic: each law, the worst of them, other engines, the Pareto
    front. ImportError if matplotlib is missing (`pip install physinone-mj[study]`)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    figure_ = Figure(figsize=(8.0, 5.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure_)
    axes = figure_.subplots()
    settings = [s for s in entry["settings"] if s["cost"] is not None]
    for law in settings[0]["laws"]:
        points = [(s["cost"], max(s["laws"][law], 1e-16)) for s in settings if s["laws"][law] is not None]
        if points:
            slope = entry["orders"][law]
            label = law.replace("_", " ") + (f" (order {slope:.1f})" if slope is not None else "")
            axes.plot(*zip(*points, strict=True), marker=".", linewidth=1, label=label)
    ours = [(s["cost"], w) for s in settings if (w := worst(s)) is not None]
    others = [
        (e["cost"], max(errors), e["engine"]) for e in entry["engines"]
        if e["cost"] and (errors := [x for x in e["errors"].values() if x is not None and 0 < x < ENDLESS])
    ]  # fmt: skip
    marks = itertools.cycle("sD^v<>pX*")
    for name, group in itertools.groupby(sorted(others, key=lambda o: o[2]), key=lambda o: o[2]):
        costs, heights, _ = zip(*group, strict=True)
        axes.scatter(costs, heights, marker=next(marks), s=22, alpha=0.6, label=f"{name} (nominal)")
    best = front([*ours, *((cost, error) for cost, error, _ in others)])
    if best:
        look: dict[str, Any] = {"color": "black", "linewidth": 2.5, "alpha": 0.35}
        axes.step(*zip(*best, strict=True), where="post", label="Pareto front", **look)
    axes.set(xscale="log", yscale="log", xlabel="cost of a simulated second [calibration loops]",
             ylabel="largest error of a law over the parameters' ranges", title=entry["label"])  # fmt: skip
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure_.savefig(path)


def problems(table: Mapping[str, Any]) -> list[str]:
    """What no honest program would show, a line each: steps that do not follow the setting, specimens that break, laws
    that neither converge, as fast as the integrator does, nor are at round-off nor say what limits them."""
    found = []
    for index, entry in table.items():
        name = f"{index} {entry['label']}"
        for s in entry["settings"]:
            if s["resolved"] is not None and s["resolved"] < s["steps"] * (1 - 1e-6):
                found.append(f"{name}: {s['resolved']:.3g} steps of its shortest time; asked for: {s['steps']}")
            if s["unstable"] and s["steps"] >= DRAFT.steps:
                found.append(f"{name}: {s['unstable']} of {s['specimens']} specimens unstable at {s['steps']} steps")
        laws, settings = phenomenon(int(index)).laws(), [s for s in entry["settings"] if s["cost"] is not None]
        least = (entry["integrator_order"] or 0) - SLOWER
        for law, slope in entry["orders"].items():
            errors = [e for s in settings if (e := s["nominal"][law]) is not None]
            floor = laws[law].within[2] if laws[law].unit else 1000 * FLOOR
            if laws[law].limited_by:
                continue
            if slope is None and len(errors) > 2 and errors[-1] > floor:
                found.append(f"{name}: {law} errs by {errors[0]:.2g} at the coarsest setting, by {errors[-1]:.2g} at "
                             f"the finest, and names nothing that limits it")  # fmt: skip
            if slope is not None and slope < least:
                found.append(f"{name}: {law} converges with order {slope:.2g}; the integrator's is "
                             f"{entry['integrator_order']}, and it names nothing that limits it")  # fmt: skip
        named = [s for law, s in entry["orders"].items() if s is not None and laws[law].limited_by]
        slowest = min(least, *named) - SLOWER if named else least  # what limits a law may limit the path as well
        if entry["path_order"] is not None and entry["path_order"] < slowest:
            found.append(f"{name}: positions converge with order {entry['path_order']:.2g}; the integrator's is "
                         f"{entry['integrator_order']}, and no law that converges as slowly names why")  # fmt: skip
    return found


TOLERANCES: Final = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
"""For which the page tells the cheapest setting."""


def _judged(table: Mapping[str, Any]) -> list[str]:
    """What the orders of convergence say, in one paragraph."""
    count = dict.fromkeys(("slow", "ordered", "exact", "limited"), 0)
    for index, entry in table.items():
        if entry["grid"]:
            continue
        for law, slope in entry["orders"].items():
            limited = phenomenon(int(index)).laws()[law].limited_by
            ordered = slope is not None and slope >= entry["integrator_order"] - SLOWER
            count["limited" if limited else "ordered" if ordered else "exact" if slope is None else "slow"] += 1
    if not sum(count.values()):
        return []
    return [
        f"Of {sum(count.values())} laws of bodies and light, {count['limited']} name what limits them (`show`). Of the "
        f"others, {count['exact']} show no order, as they are met to 1e-8 or better, or in their own unit's tolerance; "
        f"{count['ordered']} converge with the integrator's order less {SLOWER} at least, some faster, as what happens "
        f"within a step is met exactly only where it is fine; {count['slow']} more slowly.", "",
    ]  # fmt: skip


def page(table: Mapping[str, Any]) -> str:
    """The table as a page of Markdown."""
    count = max((s["specimens"] for entry in table.values() for s in entry["settings"]), default=0)
    lines = [
        "# Error against cost", "", "Generated by `physinone trade --report`; not to be edited.", "",
        f"Errors are the largest of {count} specimens each, unless another number stands there, the nominal one and "
        "random ones over the full ranges; "
        "relative, or in the law's own unit. A cost is the processor's time for a simulated second, over that of "
        f"{_LOOP} Runge-Kutta steps of a double pendulum beside it.", "",
        f"Random specimens climb to {FINEST} steps at most, or until no error shrinks any more; beyond, theirs are "
        "taken to shrink, and their costs to grow, as those of the nominal specimen were measured to.", "",
        *_judged(table),
        "## The cheapest setting for a tolerance", "",
        "Steps (cells, of matter) and cost; a dash: no setting reaches it, and what the best one reaches stands in the "
        "last column. `physinone run N --tolerance` picks the same.", "",
        "| phenomenon | " + " | ".join(f"{t:.0e}" for t in TOLERANCES) + " | best |",
        "|---" * (len(TOLERANCES) + 2) + "|",
    ]  # fmt: skip
    for index, entry in table.items():
        known = [(s["cost"], w, s) for s in entry["settings"] if (w := worst(s)) is not None]
        cells = []
        for tolerance in TOLERANCES:
            enough = [(cost, s) for cost, error, s in known if SAFETY * error <= tolerance]
            cost, s = min(enough, key=lambda pair: pair[0]) if enough else (None, None)
            cells.append(f"{s['cells' if entry['grid'] else 'steps']}: {cost:.2g}" if s else "-")
        best = min((SAFETY * error for _, error, _ in known), default=None)
        lines.append(f"| {index} {entry['label']} | {' | '.join(cells)} | {error_figure(best)} |")
    for index, entry in table.items():
        settings = entry["settings"]
        lines += ["", f"## {index} {entry['label']}", ""]
        if (own := max((s["specimens"] for s in settings), default=0)) < count:
            lines += [f"Specimens: {own}.", ""]
        heads = [f"{s['steps']}" + (f" ({s['cells']} cells)" if entry["grid"] else "") for s in settings]
        lines += ["| steps | " + " | ".join(heads) + " | order |", "|---" * (len(settings) + 2) + "|"]
        lines.append("| cost | " + " | ".join(figure(s["cost"], ".2g") for s in settings) + " | |")
        if any(s["broken"] for s in settings):
            lines.append("| specimens refused or unstable | " + " | ".join(str(s["broken"]) for s in settings) + " | |")
        for law, slope in entry["orders"].items():
            errors = " | ".join(error_figure(s["laws"][law]) for s in settings)
            lines.append(f"| {law.replace('_', ' ')} | {errors} | {'-' if slope is None else f'{slope:.1f}'} |")
        if entry["path_order"] is not None:
            slope = entry["path_order"]
            lines += ["", f"Positions at a quarter and a half of the time converge with order {slope:.1f}; the "
                      f"integrator's is {entry['integrator_order']}."]  # fmt: skip
        if entry["engines"]:
            ways = len({other["engine"] for other in entry["engines"]})
            lines += ["", f"At {', '.join(map(str, STUDIED))} steps, in {ways} other ways that the engine offers:"]
            lines += ["", "| engine, nominal | steps | cost | largest error | law |", "|---|---|---|---|---|"]
        for other in entry["engines"]:
            errors_ = {law: e for law, e in other["errors"].items() if e is not None}
            law = max(errors_, key=lambda name: errors_[name]) if errors_ else ""
            # an engine that does not record what a law reads, impacts or loads, comes to its end undecided
            ended = "undecided" if other["outcome"] == "done" else other["outcome"]
            found = error_figure(errors_[law]) if errors_ else ended
            cost = "-" if other["cost"] is None else figure(other["cost"], ".2g")
            lines.append(f"| {other['engine']} | {other['steps']} | {cost} | {found} | {law.replace('_', ' ')} |")
    return "\n".join(lines) + "\n"
