"""The extremes: every corner of a phenomenon's declared ranges, what lies beyond them, and set-ups made to break it.

A specimen is sound if its run is finite, its clock goes on, no body jumps, surfaces do not overlap, no energy comes
from nowhere, and every law that the run can decide holds. What is not sound has to say so: it is refused before it
starts (`Refusal`) or broken off (`UnstableScene`). Anything else is a defect, and inside of a declared range that
range's: "broken" (finite, but wrong) or "crashed" (an exception that is no answer).

Four kinds of work, each a `Task` of its own, so that they go to processes and a run that was stopped goes on:

    specimen  one of the box's: corners (a pairwise covering design where there are many), edges, a Latin hypercube
    frontier  one end of one parameter's range, pushed outwards until it ends; the others nominal
    case      a set-up of CASES, with what is expected of it
    unused    whether the scene or a law depends on every parameter at all

Laws of matter mostly ask for laboratories, runs of their own of minutes each: of a scene with matter, what needs one is
left undecided here, and said so (`silent`).
"""

from __future__ import annotations

import contextlib
import copy
import hashlib
import itertools
import json
import math
import signal
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from . import collision
from .base import Choice, NotEvaluated, Param, ParameterError, Phenomenon, Refusal
from .checks import journal
from .effects import Buoyancy, Drag, Magnets
from .fidelity import DRAFT, PRESETS, Fidelity
from .registry import phenomenon
from .run import Run
from .simulate import UnstableScene, build, compile, simulate_specimen
from .terminal import ENDLESS, figure, span

Record: TypeAlias = dict[str, Any]
"""What came of a task, as JSON values."""

Side: TypeAlias = Literal["low", "high"]

ENERGY: Final = (1e-2, 3e-3, 3e-3)
"""By which the energy may rise at DRAFT, STANDARD and REFERENCE, over the scene's (`gained`). No less than 3e-3: that
much Newton's restitution together with friction was seen to create in heaps of boxes (`contact`, defects)."""

OVERLAP: Final = (1e-2, 1e-3, 1e-3)
"""By which two surfaces may overlap at DRAFT, STANDARD and REFERENCE, over the bounding radius of the smaller. Seen at
DRAFT: 1.6e-3 of a hollow ball on a slope, 6e-3 of one in a catapult's tray, which turns by 3 degrees in a step; at
STANDARD 4e-4 of the same."""

CROWDED: Final = (0.2, 0.05, 0.05)
"""The same in a crowd, at DRAFT, STANDARD and REFERENCE. More impacts in a step than the engine takes one by one
(`simulate`), it takes all at once, and what meets in that step overlaps by some of its way. Seen in a wall struck by a
ball: 0.1 at DRAFT, 6e-5 at STANDARD; in a heap of sixty shards 0.02 at both."""

CROWD: Final = 4
"""More impacts than this make a crowd of the `_MEMORY` steps that follow, in which overlaps are taken back."""

HEAP: Final = 32
"""So do more contacts than this: of these the engine takes the first impact for one of many."""

PACE: Final = 2.0
"""A body may be farther than a sample before by no more than this times its greatest speed explains."""

SLACK: Final = 1e-3
"""Below this part of the scene's shortest length neither a way nor a lift is worth speaking of."""

PUSHES: Final = 6
"""Factors of two by which an end is pushed outwards at most, or halvings by which a trusted value is looked for."""

FULL: Final = 16
"""Corners that are all tried; of more, enough for every pair."""

LIMIT: Final = 600.0
"""Processor time that a specimen may take with all the runs of its laws, unless told otherwise [s]."""

BEYOND: Final = 100.0
"""The same while a range is pushed outwards: what takes longer is of no use there [s]."""

_CANDIDATES: Final = 20
_MEMORY: Final = 64
_DRAWS: Final = 200
_CONTEXTS: Final = 20

OUTCOMES: Final = ("sound", "refused", "broken", "unstable", "crashed", "unfinished")
DEFECTS: Final = ("broken", "unstable", "crashed")
"""Outcomes that a declared range rules out."""


@dataclass(frozen=True)
class Case:
    """A set-up made to break a phenomenon. values: what is not nominal, in its range or not; expected: "sound", or the
    rule by which it is refused ("model" if the model itself refuses)."""

    name: str
    index: int
    values: Mapping[str, float | int | str]
    expected: str = "sound"


CASES: Final = (
    Case("a million to one in mass, colliding", 2, {"density": 100.0, "target_density": 1e8}, "R3"),
    Case("a million to one in mass, jointed", 47, {"mass1": 2.0, "mass2": 2e-6}),
    Case("a ball of 1 mm", 10, {"radius": 1e-3}),
    Case("a ball of 100 m", 10, {"radius": 100.0, "count": 1}),
    Case("a pendulum of 1 mm", 46, {"length": 1e-3, "radius": 1e-4, "mass": 1e-4}),
    Case("a pendulum of 100 m", 46, {"length": 100.0, "radius": 10.0, "mass": 1e7}),
    Case("100 m/s at a wall", 1, {"speed": 100.0}),
    Case("100 m/s at a sheet of glass", 25, {"speed": 100.0}),
    Case("a spring of 0.5 MN/m", 22, {"stiffness": 5e5}),
    Case("a damper faster than the step", 46, {"damping": 1e3, "radius": 0.02, "mass": 0.05, "swing": "conical"}, "R4"),
    Case("sixty links under twenty times their weight", 45, {"links": 60, "load": 20.0, "mount": "hook"}),
    Case("poles that all but touch", 13, {"gap": 0.0133, "core": 0.006}),
    Case("poles within each other's core", 13, {"gap": 0.0131, "core": 0.006}, "R5"),
    Case("no friction", 11, {"friction": 0.0}),
    Case("friction of 0.9", 11, {"friction": 0.9, "angle": 0.0524}),
    Case("no restitution", 29, {"restitution": 0.0}),
    Case("restitution of 1", 2, {"restitution": 1.0, "target_restitution": 1.0}),
    Case("restitution of more than 1", 2, {"restitution": 1.5, "target_restitution": 1.5}, "model"),
    Case("a grazing hit", 1, {"incidence": 1.309}),
    Case("a grazing beam", 33, {"incidence": 1.55}, "R12"),
    Case("a thick jet", 69, {"setup": "pour", "viscosity": 200.0}),
    Case("sand poured on a slope", 71, {"setup": "pour", "onto": "slope", "tilt": 0.7}),
    Case("soft rubber from high up", 67, {"young": 1e4, "drop": 1.0, "size": 0.25, "density": 3000.0}, "R9"),
    Case("soft rubber, squeezed by all that is allowed", 67, {"young": 2e4, "drop": 0.41, "size": 0.2, "poisson": 0.2}),
    Case("stiff and light, at the grid's time step", 67, {"young": 1e6, "density": 500.0}),
    Case("a thousandfold stiffer than the grid's time step allows", 67, {"young": 1e12}, "R10"),
)


class TooLong(BaseException):
    """A specimen's processor time is used up. Not an Exception, which somebody on the way might take for a law's."""


@contextlib.contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    """TooLong in the body once the process has worked for so long; outside of the main thread there is no clock."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(*_: object) -> None:
        raise TooLong(f"took more than {seconds:g} s of the processor")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@contextlib.contextmanager
def _noting(where: str) -> Iterator[None]:
    """What goes wrong in the body says where."""
    try:
        yield
    except Exception as why:
        why.add_note(where)
        raise


def _line(why: BaseException) -> str:
    answer = isinstance(why, (Refusal, UnstableScene, TooLong))
    what = str(why) if answer else f"{type(why).__name__}: {why}"
    return " ".join(": ".join([*getattr(why, "__notes__", []), what]).split())


def _declined(why: Exception) -> bool:
    """Whether a model turned down what nobody declared it for: a check of ours, MuJoCo's compiler, or a law or caption
    that finds nothing there to speak of."""
    if any(note.startswith(("law ", "observable ", "caption")) for note in getattr(why, "__notes__", ())):
        return isinstance(why, (ArithmeticError, LookupError, NotEvaluated, ValueError))
    refused = isinstance(why, ValueError) and not isinstance(why, np.linalg.LinAlgError)
    return refused and ("allowed" in str(why) or str(why).startswith("Error"))


def specimen(cls: type[Phenomenon], values: Mapping[str, Any]) -> Phenomenon:
    """The specimen with these values, the others nominal; one that is `checked` only if all are in their ranges."""
    known = cls.declarations()
    inside = all(known[name][0].check(value, known[name][1]) is None for name, value in values.items())
    return (cls.make if inside else cls.outside)(**values)


def examine(what: Phenomenon, fidelity: Fidelity, limit: float = LIMIT) -> Record:
    """Simulate a specimen and look for everything that may be wrong with it.

    outcome: of OUTCOMES, with the `rule` and `line` of what ended it or the list of what is `wrong`; a law that could
    not be decided is in `silent` with its reason. limit: processor time after which it is given up [s]
    """
    begun = time.process_time()
    record: Record = {
        "index": what.index, "label": what.label, "fidelity": fidelity.name,
        "values": what.values(), "inside": what.checked,
    }  # fmt: skip
    try:
        with _no_longer_than(limit):
            run = simulate_specimen(what, fidelity=fidelity)
            if run.scene.continua:
                run = replace(run, again_with=_undecided)
            found = _judged(what, run)
    except Refusal as why:
        found = {"outcome": "refused", "rule": why.rule, "line": str(why)}
    except UnstableScene as why:
        found = {"outcome": "unstable", "line": _line(why)}
    except TooLong as why:
        found = {"outcome": "unfinished", "line": _line(why)}
    except Exception as why:  # whatever it is, it is what is looked for
        refused = not what.checked and _declined(why)
        found = {"outcome": "refused", "rule": "model"} if refused else {"outcome": "crashed"}
        found |= {"line": _line(why)}
    return record | found | {"seconds": time.process_time() - begun}


def _undecided(**changes: Any) -> Run:
    raise NotEvaluated(f"asks for a run with {', '.join(f'{name} = {value}' for name, value in changes.items())}")


def _judged(what: Phenomenon, run: Run) -> Record:
    """What `examine` says of a run that came to its end."""
    wrong = insane(run)
    if wrong:
        return {"outcome": "broken", "wrong": wrong}
    ratios: dict[str, float] = {}
    silent: dict[str, str] = {}
    for law in what.laws().values():
        try:
            with _noting(f"law {law.name}"):
                verdict = law.judge(what, run)
        except (Refusal, ParameterError) as why:  # a twin that it asks for cannot be
            silent[law.name] = _line(why)
            continue
        if verdict.passed is None:
            silent[law.name] = str(verdict.reason)
            continue
        ratios[law.name] = _finite(verdict.error / verdict.tolerance)
        if not verdict.passed:
            wrong.append(_wrong(law.name, verdict.error, verdict.tolerance, verdict.unit))
    for observable in what.observables().values():
        with _noting(f"observable {observable.name}"):
            observable.measure(what, run)
    with _noting("caption"):
        what.caption(run)
    unjudged, energy = "matter has laws of its own" if run.scene.continua else None, None
    if unjudged is None:
        energy, allowed = gained(run), ENERGY[run.fidelity.rank]
        if not energy <= allowed:
            wrong.append(_wrong("energy", energy, allowed))
    overlap, crowded = deepest(run)
    for where, (deep, whose), within in (("", overlap, OVERLAP), (" in a crowd", crowded, CROWDED)):
        if not deep <= within[run.fidelity.rank]:
            wrong.append(_wrong(f"overlap{where} of {whose}", deep, within[run.fidelity.rank]))
    return {
        "outcome": "broken" if wrong else "sound", "wrong": wrong, "laws": ratios, "silent": silent,
        "energy": energy, "unjudged": unjudged,
        "overlap": overlap[0] if run.model.npair else None, "crowded": crowded[0] if run.model.npair else None,
        "eased": dict(run.eased),
    }  # fmt: skip


def _finite(value: float) -> float:
    return float(value) if math.isfinite(value) else ENDLESS


def _wrong(what: str, error: float, tolerance: float, unit: str | None = None) -> Record:
    return {"what": what, "error": _finite(error), "tolerance": tolerance, "unit": unit}


def insane(run: Run) -> list[Record]:
    """What no law needs to tell: the state is not finite, the clock does not go on to the end, a body jumps."""
    sums = [
        getattr(cloud, key)
        for cloud in run.clouds.values()
        for key in ("mass", "centre", "momentum", "turning", "kinetic", "elastic", "dissipated", "volume", "low",
                    "high")
    ]
    lost = sum(int(np.sum(~np.isfinite(values))) for values in (run.t, run.qpos, run.qvel, *sums))
    if lost:
        return [_wrong("numbers that are not finite", lost, 0)]
    step = float(np.diff(run.t).min(initial=math.inf))
    missing = run.scene.duration - 2 / run.scene.fps - float(run.t[-1])
    found = [_wrong("time does not go on", -step, 0, "s")] if not step > 0 or run.t[0] != 0 else []
    found += [_wrong("the end is missing", missing, 0, "s")] if missing > 0 else []
    way = np.linalg.norm(np.diff(run.motion.position, axis=0), axis=2)
    fastest = np.linalg.norm(run.motion.velocity, axis=2).max(axis=0)
    explained = PACE * fastest * np.diff(run.t)[:, None] + SLACK * run.scene.length
    if not found and not (way <= explained).all():
        when, body = np.unravel_index(int(np.argmax(way - explained)), way.shape)
        name = f"{run.model.body(int(body)).name} jumps at t = {run.t[when]:.4g} s"
        found.append(_wrong(name, way[when, body], float(explained[when, body]), "m"))
    return found


def given(run: Run) -> tuple[NDArray[np.float64], float]:
    """Energy (T,) that motors, drives and winds have given so far, less what the winds' own potentials are counted for
    [J]; and by how much the sums over samples may err: what they differ by from those over every other one.

    Motors' work is recorded. What is let go (a cut, a bond that breaks) was held rigidly and stores nothing; springs
    and magnets have potentials, drag only takes.
    """
    model, scene = run.model, run.scene
    winds = [effect for effect in scene.effects if not isinstance(effect, (Buoyancy, Drag, Magnets))]
    if not winds and not any(scene.control.values()):
        return run.worked, 0.0
    pushes, data = [wind.bind(model) for wind in winds], mujoco.MjData(model)
    for name, value in scene.control.items():
        data.ctrl[model.actuator(name).id] = value
    count = len(run)
    drive, force, counted = np.empty((count, model.nv)), np.empty((count, model.nbody, 6)), np.empty(count)
    for i in range(count):
        data.time, data.qpos[:], data.qvel[:] = run.t[i], run.qpos[i], run.qvel[i]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        data.xfrc_applied[:] = 0.0
        for push in pushes:
            push(data)
        drive[i], force[i] = data.qfrc_actuator, data.xfrc_applied
        counted[i] = sum(wind.potential(model, data) for wind in winds)

    def work(every: int) -> NDArray[np.float64]:
        """Of the means of the forces, along the ways between every so many samples."""
        at = slice(None, None, every)
        places, moved = run.qpos[at], np.empty((len(run.qpos[at]) - 1, model.nv))
        for way, here, there in zip(moved, places[:-1], places[1:], strict=True):
            mujoco.mj_differentiatePos(model, way, 1.0, here, there)
        ways = np.diff(run.motion.position[at], axis=0)
        turns = np.diff(run.t[at])[:, None, None] * _middles(run.motion.spin[at])
        done = np.sum(_middles(drive[at]) * moved, axis=1)
        done += np.sum(_middles(force[at]) * np.concatenate([ways, turns], axis=2), axis=(1, 2))
        return np.concatenate([[0.0], np.cumsum(done)])

    fine = work(1)
    return run.worked + fine + counted, float(np.abs(fine[::2] - work(2)).max())


def _middles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(values[1:] + values[:-1]) / 2


def gained(run: Run) -> float:
    """By how much the energy that nothing gives ever rises above what it was before, over the largest that is at play:
    kinetic, the range of the potential, what is given, or a lift of all that moves by a thousandth of the shortest
    length."""
    kinetic, potential = run.motion.kinetic, run.motion.potential
    taken, doubt = given(run)
    own = kinetic + potential - taken
    rise = np.max(own - np.minimum.accumulate(own)) - doubt
    lift = np.sum(run.model.body_mass[run.model.body_weldid != 0]) * run.scene.gravity * SLACK * run.scene.length
    scale = max(float(kinetic.max()), float(np.ptp(potential)), float(np.ptp(taken)), float(lift))
    return float(rise / scale) if rise > 0 else 0.0


def deepest(run: Run) -> tuple[tuple[float, str], tuple[float, str]]:
    """Deepest overlap of two surfaces at the video frames, over the bounding radius of the smaller, and whose it is:
    while impacts come one by one, and in a crowd or heap.

    Of what a bond still holds together nothing overlaps; bowls are not looked into.
    """
    worst = [(0.0, ""), (0.0, "")]
    impacts = np.array([impact.time for impact in run.impacts])
    model = copy.copy(run.model)
    # the solver looks ahead; here only what all but touches is counted
    model.pair_margin[:], model.pair_gap[:] = SLACK * run.scene.length, 0.0
    size = np.where(model.geom_rbound > 0, model.geom_rbound, math.inf)
    data, broken, whole = mujoco.MjData(model), -1, np.arange(model.nbody)
    upright, polyhedra = collision.on_planes(model), collision.Polyhedra(model)
    for i in range(0, len(run), run.stride) if model.npair else ():
        data.qpos[:] = run.qpos[i]
        mujoco.mj_kinematics(model, data)
        collision.collide(model, data, upright, polyhedra)
        if not data.ncon:
            continue
        if run.scene.bonds and (now := sum(b.time <= run.t[i] for b in run.breaks)) != broken:
            broken, whole = now, _wholes(run, {b.weld for b in run.breaks if b.time <= run.t[i]})
        geoms = data.contact.geom
        ends = whole[model.geom_bodyid[geoms]]
        overlap = np.where(ends[:, 0] == ends[:, 1], 0.0, np.maximum(-data.contact.dist, 0.0) / size[geoms].min(axis=1))
        k = int(np.argmax(overlap))
        recent = np.count_nonzero((impacts > run.t[i] - _MEMORY * run.step) & (impacts <= run.t[i]))
        crowd = int(recent > CROWD or data.ncon > HEAP)
        if overlap[k] > worst[crowd][0]:
            worst[crowd] = float(overlap[k]), " and ".join(model.geom(g).name for g in geoms[k])
    return worst[0], worst[1]


def _wholes(run: Run, broken: set[str]) -> NDArray[np.int32]:
    """Of every body the number of the whole that unbroken bonds make it part of."""
    held = [run.model.equality(bond.weld).id for bond in run.scene.bonds if bond.weld not in broken]
    first, second = run.model.eq_obj1id[held], run.model.eq_obj2id[held]
    graph = coo_array((np.ones(len(held)), (first, second)), shape=(run.model.nbody,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def box(cls: type[Phenomenon], seed: int, latin: int) -> list[Phenomenon]:
    """Specimens that try the declared ranges: the nominal one, corners, edges, and `latin` ones in between.

    Of a choice only words that random specimens have: laboratories are the laws' business.
    """
    drawn = [cls.sample(np.random.default_rng(n)).values() for n in range(_DRAWS)]
    nominal = cls.make().values()
    levels: dict[str, list[float | int | str]] = {}
    for name, (param, kind) in cls.declarations().items():
        seen = {values[name] for values in drawn}
        words = [w for w in param.words if w in seen] if isinstance(param, Choice) else [param.low, param.high]
        levels[name] = list(dict.fromkeys(kind(word) for word in words))
    rows = covering([len(found) for found in levels.values()], seed)
    places = [{name: levels[name][k] for name, k in zip(levels, row, strict=True)} for row in rows]
    places += [nominal | {name: level} for name, found in levels.items() for level in found]
    rng = np.random.default_rng([seed, cls.index])
    columns: dict[str, list[float | int | str]] = {}
    for name, (param, kind) in cls.declarations().items():
        parts = (rng.permutation(latin) + rng.random(latin)) / max(latin, 1)
        columns[name] = [
            _within(param, kind, u) if isinstance(param, Param) else levels[name][int(u * len(levels[name]))]
            for u in parts
        ]
    places += [{name: column[i] for name, column in columns.items()} for i in range(latin)]
    return list(dict.fromkeys([cls.make(), *(cls.make(**place) for place in places)]))


def _within(param: Param, kind: type, u: float) -> float | int:
    """The value below which a part u of what `Param.draw` draws lies."""
    if kind is int:
        return int(param.low) + int(u * (int(param.high) - int(param.low) + 1))
    if param.low > 0 and param.high > 30 * param.low:
        return float(min(param.low * (param.high / param.low) ** u, param.high))
    return float(param.low + u * (param.high - param.low))


def covering(sizes: Sequence[int], seed: int) -> list[tuple[int, ...]]:
    """Rows, a level of every factor each, in which every two levels of every two factors meet; all rows there are if
    these are FULL or fewer. Greedy: the best of some random rows, each begun with two levels that have not met."""
    if math.prod(sizes) <= FULL:
        return list(itertools.product(*map(range, sizes)))
    rng = np.random.default_rng(seed)
    missing = {
        ((i, a), (j, b)): None
        for (i, m), (j, n) in itertools.combinations(enumerate(sizes), 2)
        for a in range(m) for b in range(n)
    }  # fmt: skip

    def met(row: Sequence[tuple[int, int]]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        return [pair for pair in itertools.combinations(sorted(row), 2) if pair in missing]

    def candidate() -> list[tuple[int, int]]:
        row = list(list(missing)[int(rng.integers(len(missing)))])
        fixed = {factor for factor, _ in row}
        for factor in rng.permutation([i for i in range(len(sizes)) if i not in fixed]).tolist():
            order = rng.permutation(sizes[factor]).tolist()
            gains = [sum(tuple(sorted((other, (factor, k)))) in missing for other in row) for k in order]
            row.append((factor, order[gains.index(max(gains))]))
        return row

    rows = []
    while missing:
        best = max((candidate() for _ in range(_CANDIDATES)), key=lambda row: len(met(row)))
        rows.append(tuple(level for _, level in sorted(best)))
        for pair in met(best):
            del missing[pair]
    return rows


def frontier(cls: type[Phenomenon], name: str, side: Side, fidelity: Fidelity, limit: float = BEYOND) -> Record:
    """How far one parameter's range can be trusted on one side, the others nominal.

    From its end it is pushed outwards, by factors of two (an end that is not positive, by the range's width, doubled
    every time), up to PUSHES times. If its end itself is not sound, from there halfway towards the nominal value.
    trusted: the last sound value, None if there is none; ended: what was wrong with the next one; records: of all
    """
    param, kind = cls.declarations()[name]
    if not isinstance(param, Param):
        raise ValueError(f"frontier of {cls.label}.{name}; allowed: a number's")
    end, nominal, sign = getattr(param, side), cls.make().values()[name], 1 if side == "high" else -1
    steps = range(1, PUSHES + 1)
    outwards = [end * 2.0 ** (sign * n) if end > 0 else end + sign * (param.high - param.low) * 2.0 ** (n - 1)
                for n in steps]  # fmt: skip
    inwards = [*(nominal + (end - nominal) / 2**n for n in steps), nominal]
    records: list[Record] = []

    def sound(value: float) -> bool:
        records.append(examine(specimen(cls, {name: value}), fidelity, limit))
        return bool(records[-1]["outcome"] == "sound")

    def whole(values: Iterable[float]) -> list[float]:
        """Each once, rounded if it has to be, and none that has been tried."""
        return [v for v in dict.fromkeys(round(v) if kind is int else v for v in values) if v != end]

    trusted: float | None = end
    ended = "holds as far as it was pushed"
    if sound(end):
        for value in whole(outwards):
            if not sound(value):
                ended = ending(records[-1])
                break
            trusted = value
    else:
        ended = ending(records[-1])
        trusted = next((value for value in whole(inwards) if sound(value)), None)
    return {
        "index": cls.index, "label": cls.label, "fidelity": fidelity.name,
        "parameter": name, "side": side, "trusted": trusted, "ended": ended, "records": records,
    }  # fmt: skip


def ending(record: Record) -> str:
    """What ended a specimen, in a word or two."""
    if record["outcome"] == "broken":
        return ", ".join(str(wrong["what"]).replace("_", " ") for wrong in record["wrong"])
    if record["outcome"] == "refused":
        return "the model itself refuses" if record["rule"] == "model" else f"refused {record['rule']}"
    return str(record["outcome"])


def unused(cls: type[Phenomenon]) -> list[str]:
    """Parameters on which neither the scene nor what a law expects depends, whatever the others are.

    Scenes are built, not run: the nominal one, one for every word of every choice, and random ones. What no scene
    knows may still be a law's: that one is judged on runs, at DRAFT.
    """
    nominal = cls.make()
    declared = cls.declarations()
    words = [{name: w} for name, (param, _) in declared.items() if isinstance(param, Choice) for w in param.words]
    contexts = [nominal, *(nominal.altered(**word) for word in words)]
    contexts += [cls.sample(np.random.default_rng(n)) for n in range(_CONTEXTS)]
    left = dict.fromkeys(declared)
    for context in contexts:
        base = described(context) if left else None
        for name in list(left) if base else ():
            if any(described(other) not in (base, None) for other in _others(context, name)):
                del left[name]

    def expected(what: Phenomenon) -> list[float | None] | None:
        try:
            run = simulate_specimen(what, fidelity=DRAFT)
            return [verdict.record()["expected"] for verdict in run.check()]
        except Exception:  # likewise
            return None

    if left:
        known = expected(nominal)
        left = {
            name: None for name in left
            if all(expected(other) in (known, None) for other in _others(nominal, name))
        }  # fmt: skip
    return list(left)


def _others(what: Phenomenon, name: str) -> list[Phenomenon]:
    """The specimen with one parameter at the ends of its range, or another word."""
    param, _ = what.declarations()[name]
    values = param.words if isinstance(param, Choice) else (param.low, param.high)
    return [other for value in values if (other := what.altered(**{name: value})) != what]


def described(what: Phenomenon) -> bytes | None:
    """A digest of all that is in the specimen's scene, but not of how it is resolved; None if there is no such scene:
    a refusal that names a parameter does not yet use it."""
    try:
        scene = build(what)
        model = compile(what, scene, DRAFT).model
    except Exception:  # `examine` tells it of a specimen
        return None
    model.opt.timestep = 1.0
    raw = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, raw)
    with np.printoptions(threshold=10**9, precision=17):
        rest = [repr(getattr(scene, f.name)) for f in fields(scene) if f.name not in ("spec", "time", "length")]
    return hashlib.sha256(raw.tobytes() + "\n".join(rest).encode()).digest()


Task: TypeAlias = tuple[str, int, str, str]
"""Which kind of work, index, fidelity, and with what: the values of a specimen as JSON, parameter and side of a
frontier, the name of a case, or nothing."""


def tasks(index: int, seed: int, latin: int, fidelity: str, frontiers: Sequence[str]) -> list[Task]:
    """All the work on one phenomenon."""
    cls = phenomenon(index)
    numbers = [name for name, (param, _) in cls.declarations().items() if isinstance(param, Param)]
    return [
        *(("specimen", index, fidelity, json.dumps(what.values())) for what in box(cls, seed, latin)),
        *(("case", index, fidelity, case.name) for case in CASES if case.index == index),
        *(("frontier", index, preset, f"{name} {side}")
          for preset in frontiers for name in numbers for side in ("low", "high")),
        ("unused", index, DRAFT.name, ""),
    ]  # fmt: skip


def attempt(task: Task) -> Record:
    """The record of a task."""
    kind, index, preset, what = task
    cls, fidelity = phenomenon(index), Fidelity.named(preset)
    if kind == "specimen":
        return examine(specimen(cls, json.loads(what)), fidelity)
    if kind == "frontier":
        name, _, side = what.partition(" ")
        return frontier(cls, name, "low" if side == "low" else "high", fidelity)
    if kind == "unused":
        return {"index": index, "label": cls.label, "unused": unused(cls)}
    case = next(case for case in CASES if (case.index, case.name) == (index, what))
    return examine(specimen(cls, case.values), fidelity) | {"case": case.name, "expected": case.expected}


def measure(todo: Sequence[Task], path: Path) -> dict[Task, Record]:
    """Do what has not been done yet: a `journal`, at `path`."""
    return journal(attempt, todo, lambda task: f"{task[1]} {phenomenon(task[1]).label}, {task[0]}", path)


def tabulate(found: Mapping[Task, Record]) -> dict[str, Any]:
    """What is kept of the records, by index. `wrong` lists every defect, and is empty if there is none."""
    by_index: dict[int, list[tuple[str, Record]]] = defaultdict(list)
    for (kind, index, _, _), record in found.items():
        by_index[index].append((kind, record))
    return {str(index): _table(phenomenon(index), records) for index, records in sorted(by_index.items())}


def _table(cls: type[Phenomenon], records: Sequence[tuple[str, Record]]) -> dict[str, Any]:
    of_kind: dict[str, list[Record]] = defaultdict(list)
    for kind, record in records:
        of_kind[kind].append(record)
    specimens, cases = of_kind["specimen"], of_kind["case"]
    judged = [r for r in specimens if "laws" in r]
    ratios = [(ratio, law) for r in judged for law, ratio in r["laws"].items()]
    worst = max(ratios, default=None)
    inside = [*specimens, *(r for f in of_kind["frontier"] for r in f["records"])]
    wrong = list(dict.fromkeys(_defect(r) for r in inside if r["inside"] and r["outcome"] in DEFECTS))
    wrong += [_defect(r, f"case {r['case']!r}, expected {r['expected']}: ") for r in cases if not _as_expected(r)]
    wrong += [f"{name} is declared, but nothing depends on it" for r in of_kind["unused"] for name in r["unused"]]
    parameters: dict[str, Any] = {}
    for name, (param, _) in cls.declarations().items():
        if isinstance(param, Param):
            parameters[name] = {"unit": param.unit, "low": param.low, "high": param.high, "trusted": {}}
    for f in of_kind["frontier"]:
        trusted = parameters[f["parameter"]]["trusted"].setdefault(f["fidelity"], {})
        trusted |= {f["side"]: f["trusted"], f"{f['side']}_ended": f["ended"]}
    return {
        "label": cls.label,
        "fidelity": ", ".join(dict.fromkeys(r["fidelity"] for r in specimens)),
        "specimens": len(specimens),
        "outcomes": {outcome: sum(r["outcome"] == outcome for r in specimens) for outcome in OUTCOMES},
        "rules": dict(sorted(Counter(r["rule"] for r in specimens if r["outcome"] == "refused").items())),
        "worst": worst and worst[::-1],
        "silent": (silent := dict(Counter(law for r in judged for law in r["silent"]))),
        "undecided": [law for law, times in silent.items() if times == len(judged)],
        "energy": max((r["energy"] for r in judged if r["energy"] is not None), default=None),
        "unjudged": sorted({r["unjudged"] for r in judged if r["unjudged"]}),
        "overlap": max((r["overlap"] for r in judged if r["overlap"] is not None), default=None),
        "crowded": max((r["crowded"] for r in judged if r["crowded"] is not None), default=None),
        "unfinished": [_defect(r) for r in specimens if r["outcome"] == "unfinished"],
        "eased": dict(sum((Counter(r["eased"]) for r in judged), Counter())),
        "parameters": parameters,
        "cases": [{"name": r["case"], "expected": r["expected"], "found": ending(r)} for r in cases],
        "wrong": wrong,
    }


def joined(before: Mapping[str, Any], table: Mapping[str, Any]) -> dict[str, Any]:
    """The table, with the frontiers that an earlier one has at other fidelities, of ranges that are still the same."""
    found = copy.deepcopy(dict(table))
    for index, entry in found.items():
        earlier = before.get(index, {}).get("parameters", {})
        for name, parameter in entry["parameters"].items():
            known = earlier.get(name, {})
            if all(known.get(key) == parameter[key] for key in ("unit", "low", "high")):
                trusted = known.get("trusted", {}) | parameter["trusted"]
                parameter["trusted"] = {p.name: trusted[p.name] for p in PRESETS if p.name in trusted}
    return found


def _as_expected(record: Record) -> bool:
    return bool(record["expected"] == (record.get("rule") or record["outcome"]))


def _defect(record: Record, before: str = "") -> str:
    """One line: fidelity, what is not nominal, what is wrong."""
    nominal = phenomenon(record["index"]).make().values()
    given = ", ".join(f"{k}={v}" for k, v in record["values"].items() if v != nominal[k]) or "nominal"
    what = record.get("line") or "; ".join(
        f"{wrong['what']}: {wrong['error']:.2g}, allowed {wrong['tolerance']:.2g} {wrong['unit'] or ''}".rstrip()
        for wrong in record.get("wrong", ())
    )
    return f"{before}{record['outcome']} at {record['fidelity']}, {given}" + (f": {what}" if what else "")


def problems(table: Mapping[str, Any]) -> list[str]:
    """A line for every defect: what a declared range promised and does not hold, what a case was not expected to do."""
    return [f"{index} {entry['label']}: {wrong}" for index, entry in table.items() for wrong in entry["wrong"]]


def page(table: Mapping[str, Any]) -> str:
    """The table as a page of Markdown."""
    tried = Counter(entry["fidelity"] for entry in table.values() if entry["fidelity"])
    usual = max(tried, key=lambda name: tried[name], default="no")
    lines = [
        "# Where it can be trusted", "", "Generated by `physinone stress --report`; not to be edited.", "",
        f"Specimens are the corners of the declared ranges (of many, enough for every two ends of every two parameters "
        f"to meet), their edges and a Latin hypercube, at {usual} fidelity, unless another stands there. Refused are "
        "combinations that say so before they start; broken, unstable and crashed ones would be defects. The worst law "
        "is the one with the largest error over its tolerance. Energy: its largest rise over the scene's, less what "
        "motors, drives and winds give; a dash for matter, whose own laws have it. Overlap: of two surfaces, at the "
        "times of pictures, over the smaller's radius; a dash where no two bodies can touch; allowed: "
        f"{OVERLAP[1]:g} (at draft {OVERLAP[0]:g}), and in a crowd, where many impacts come at once, {CROWDED[1]:g} "
        f"({CROWDED[0]:g}).", "",
        "| phenomenon | specimens | " + " | ".join(OUTCOMES) + " | worst law | energy | overlap | in a crowd |",
        "|---" * (len(OUTCOMES) + 6) + "|",
    ]  # fmt: skip
    for index, entry in table.items():
        worst = entry["worst"]
        law = "-" if worst is None else f"{worst[0].replace('_', ' ')}: {worst[1]:.2g}"
        cells = [str(entry["specimens"]), *(str(entry["outcomes"][o]) for o in OUTCOMES), law,
                 *(_small(entry[key]) for key in ("energy", "overlap", "crowded"))]  # fmt: skip
        lines.append(f"| {index} {entry['label']} | {' | '.join(cells)} |")
    cases = [(index, entry["label"], case) for index, entry in table.items() for case in entry["cases"]]
    if cases:
        lines += ["", "## Set-ups made to break it", "", "| set-up | phenomenon | expected | found |", "|---" * 4 + "|"]
        lines += [f"| {case['name']} | {index} {label} | {case['expected']} | {case['found']} |"
                  for index, label, case in cases]  # fmt: skip
    for index, entry in table.items():
        lines += ["", f"## {index} {entry['label']}", ""]
        lines += [f"- **{wrong}**" for wrong in entry["wrong"]] + [""] * bool(entry["wrong"])
        if entry["fidelity"] not in ("", usual):
            lines += [f"Specimens at {entry['fidelity']} fidelity.", ""]
        if entry["rules"]:
            lines += ["Refused: " + ", ".join(f"{count} by {rule}" for rule, count in entry["rules"].items()) + ".", ""]
        if entry.get("undecided"):
            laws = ", ".join(law.replace("_", " ") for law in entry["undecided"])
            lines += [f"Decided by none of these runs: {laws}.", ""]
        lines += [f"- {unfinished}" for unfinished in entry["unfinished"]] + [""] * bool(entry["unfinished"])
        if entry.get("eased"):
            eased = ", ".join(f"{count} {how}" for how, count in entry["eased"].items())
            lines += [f"Contact problems that could not be solved as they were: {eased}.", ""]
        presets = list(dict.fromkeys(preset for p in entry["parameters"].values() for preset in p["trusted"]))
        if not presets:
            continue
        lines += ["| parameter | unit | declared | trusted at | range | what ends it below | above |", "|---" * 7 + "|"]
        for name, p in entry["parameters"].items():
            for preset, trusted in p["trusted"].items():
                lines.append(f"| {name} | {p['unit']} | {p['low']:.3g} to {p['high']:.3g} | {preset} | {span(trusted)} "
                             f"| {trusted.get('low_ended', '')} | {trusted.get('high_ended', '')} |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _small(value: float | None) -> str:
    return "-" if value is None else figure(value, ".1e")
