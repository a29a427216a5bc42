"""The stress run: what is sound is called so, and every way of being broken is noticed."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
import pytest

from physinone_mj import __version__, checks, fidelity, registry, stress
from physinone_mj.__main__ import main, write_tables
from physinone_mj.base import Choice, NotEvaluated, Param, ParameterError, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT, STANDARD, Fidelity
from physinone_mj.registry import phenomenon
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import Stepper, simulate_specimen

from .conftest import nominal

RADIUS = 0.05


class Bounce(Phenomenon, domain="mechanics"):
    """A ball falls and bounces."""

    height: Annotated[float, Param("m", 0.5, 2.0, "lowest point above the floor")] = 1.0
    restitution: Annotated[float, Param("1", 0.0, 0.9, "ball against floor")] = 0.5
    mass: Annotated[float, Param("kg", 0.1, 5.0, "ball")] = 0.5
    count: Annotated[int, Param("1", 1, 2, "balls")] = 1
    floor: Annotated[Literal["there", "absent"], Choice("what the ball falls on")] = "there"

    def build(self, scene: Scene) -> None:
        if self.height > 10:
            raise Refusal("R12", f"height = {self.height} m; allowed: 10 m")
        surface = Surface(restitution=self.restitution)
        scene.material("stage/floor", 1000.0, surface)
        for i in range(self.count):
            ball = scene.add("ball", f"ball{i}")
            ball.geom("ball").size[0], ball.geom("ball").mass = RADIUS, self.mass
            scene.start[ball.name("free")] = free_pose((0, i, self.height + RADIUS))
            scene.material(ball.name("ball"), self.mass / (4 / 3 * pi * RADIUS**3), surface)
            if self.floor == "there":
                scene.touch(ball.name("ball"), "stage/floor")
        scene.resolve(time=0.1, length=RADIUS, duration=0.8)

    def fallen(self, run: Run) -> tuple[Any, Any]:
        """Until it lands at the latest: how far, and how far it should be."""
        mask = run.t < math.sqrt(2 * self.height / g)
        return self.height + RADIUS - run.position("ball0/ball")[mask, 2], g * run.t[mask] ** 2 / 2

    @observable("m")
    def path(self, run: Run) -> Any:
        """Of the first ball."""
        return run.position("ball0/ball")

    @law("s = g t²/2", source="a test", within=(1e-6, 1e-6, 1e-6))
    def falls_with_g(self, run: Run) -> tuple[Any, Any]:
        return self.fallen(run)

    def caption(self, run: Run) -> str:
        return "A ball falls."


def other(**methods: Any) -> type[Bounce]:
    """A phenomenon like `Bounce` that differs in some methods or parameters."""
    kinds = methods.pop("__annotations__", {})
    space = {"__module__": __name__, "__doc__": "Another ball falls.", "__annotations__": kinds, **methods}
    made: type[Bounce] = type(Bounce)("Other", (Bounce,), space, domain="mechanics")
    return made


def examined(what: Phenomenon, **options: Any) -> dict[str, Any]:
    """The record, which has to be JSON."""
    record = stress.examine(what, DRAFT, **options)
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    return record


def wrong(record: dict[str, Any]) -> list[str]:
    assert record["outcome"] == "broken", record
    return [one["what"] for one in record["wrong"]]


@pytest.fixture
def handled(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Run], Run]], dict[str, Any]]:
    """Examine a nominal specimen whose run somebody has had his hands on."""

    def record(hands: Callable[[Run], Run]) -> dict[str, Any]:
        monkeypatch.setattr(stress, "simulate_specimen", lambda *a, **k: hands(simulate_specimen(*a, **k)))
        return examined(Bounce())

    return record


def test_what_is_sound() -> None:
    record = examined(Bounce())
    assert record["outcome"] == "sound", record
    assert record["inside"]
    assert record["wrong"] == []
    assert record["laws"].keys() == {"falls_with_g"}
    assert record["energy"] < 1e-6
    assert record["overlap"] < 1e-6


def test_a_clamp_on_velocity_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Stepper.advance

    def advance(stepper: Stepper) -> None:
        honest(stepper)
        np.clip(stepper.data.qvel, -2.0, 2.0, out=stepper.data.qvel)

    monkeypatch.setattr(Stepper, "advance", advance)
    assert wrong(examined(Bounce())) == ["falls_with_g"]


def test_energy_from_nowhere_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Stepper.advance

    def advance(stepper: Stepper) -> None:
        honest(stepper)
        stepper.data.qvel *= 1.001

    monkeypatch.setattr(Stepper, "advance", advance)

    def decides_nothing(self: Any, run: Run) -> Any:
        raise NotEvaluated("not asked")

    lawless = other(falls_with_g=law("?", source="a test", within=(1.0, 1.0, 1.0))(decides_nothing))
    assert wrong(examined(lawless())) == ["energy"]


@dataclass(frozen=True)
class Fit:
    """Not a number, from a time on."""

    after: float

    def bind(self, model: Any) -> Callable[[Any], None]:
        body = model.body("ball0/ball").id

        def push(data: Any) -> None:
            data.xfrc_applied[body, 0] += math.nan if data.time > self.after else 0.0

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


def has_fits(self: Any, scene: Scene) -> None:
    Bounce.build(self, scene)
    scene.effects.append(Fit(0.3))
    scene.speed["ball0/free"] = (1.0, 0, 0, 0, 0, 0)


def test_what_breaks_says_so() -> None:
    record = examined(other(build=has_fits)(floor="absent"))
    assert record["outcome"] == "unstable"
    assert "broke at t = 0.3" in record["line"]


@pytest.mark.parametrize("inspected", [True, False])
def test_a_silent_reset_is_noticed(inspected: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = sys.modules[Stepper.__module__]  # the package has a function of that name
    honest = engine.compile

    def compile(*arguments: Any) -> Any:
        compiled = honest(*arguments)
        compiled.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        return compiled

    monkeypatch.setattr(engine, "compile", compile)
    if not inspected:
        monkeypatch.setattr(Stepper, "inspect", lambda self: None)
    record = examined(other(build=has_fits)(floor="absent"))
    if inspected:
        assert record["outcome"] == "unstable"
        assert "clock stands" in record["line"]
    else:
        (what,) = wrong(record)
        assert what.startswith("ball0/ball jumps at t = 0.3")


def test_what_is_not_finite_is_noticed(handled: Any) -> None:
    def hands(run: Run) -> Run:
        qvel = run.qvel.copy()
        qvel[-1, 0] = math.inf
        return dataclasses.replace(run, qvel=qvel)

    assert wrong(handled(hands)) == ["numbers that are not finite"]


def test_a_clock_that_stands_is_noticed(handled: Any) -> None:
    assert "time does not go on" in wrong(handled(lambda run: dataclasses.replace(run, t=np.minimum(run.t, 0.7))))


def test_a_run_that_is_cut_off_is_noticed(handled: Any) -> None:
    def hands(run: Run) -> Run:
        half = len(run) // 2
        return dataclasses.replace(run, t=run.t[:half], qpos=run.qpos[:half], qvel=run.qvel[:half])

    assert wrong(handled(hands)) == ["the end is missing"]


def test_an_overlap_is_noticed(handled: Any) -> None:
    def hands(run: Run) -> Run:
        qpos = run.qpos.copy()
        qpos[:, 2] -= 0.2
        return dataclasses.replace(run, qpos=qpos)

    found = wrong(handled(hands))
    assert any(what.startswith("overlap of ") and "ball0/ball" in what for what in found), found


class Puck(Phenomenon, domain="mechanics"):
    """A disc stands on the floor."""

    def build(self, scene: Scene) -> None:
        scene.material("stage/floor", 1000.0, Surface(friction=0.3))
        puck = scene.add("puck", "puck")
        puck.geom("puck").size[:2], puck.geom("puck").mass = (0.05, 0.02), 0.5
        scene.start[puck.name("free")] = free_pose((0, 0, 0.02))
        scene.material(puck.name("puck"), 1000.0, Surface(friction=0.3))
        scene.touch(puck.name("puck"), "stage/floor")
        scene.resolve(time=0.1, length=0.02, duration=0.1)

    def caption(self, run: Run) -> str:
        return "A puck stands."


def test_overlaps_of_a_disc_that_stands_are_seen() -> None:
    """MuJoCo 4.0 alone is wrong about a sixth of them."""
    run = simulate_specimen(Puck(), fidelity=DRAFT)
    assert stress.deepest(run)[0][0] < 1e-6
    first = dataclasses.replace(run, t=run.t[:1], qpos=run.qpos[:1].copy(), qvel=run.qvel[:1])
    first.qpos[0, 2] -= 0.01
    rng = np.random.default_rng(1)
    for tilt in 10 ** rng.uniform(-17, -8, 60):
        way, turn = rng.uniform(0, 2 * pi), rng.uniform(-1, 1)
        lean = np.array([1, tilt / 2 * math.cos(way), tilt / 2 * math.sin(way), turn])
        first.qpos[0, 3:] = lean / np.linalg.norm(lean)
        deep, whose = stress.deepest(first)[0]
        assert deep == pytest.approx(0.01 / math.hypot(0.05, 0.02), rel=1e-3)
        assert whose == "stage/floor and puck/puck"


def test_a_crash_says_where() -> None:
    def stumbles(self: Any, run: Run) -> Any:
        return [][0]

    record = examined(other(caption=stumbles)())
    assert record["outcome"] == "crashed"
    assert record["line"].startswith("caption: IndexError: list index out of range")
    record = examined(other(path=observable("m")(stumbles))())
    assert record["line"].startswith("observable stumbles: IndexError")
    first = other(falls_with_g=law("s = g t²/2", source="a test", within=(1.0, 1.0, 1.0))(stumbles))
    assert examined(first())["line"].startswith("law stumbles: IndexError")


@pytest.mark.parametrize(
    "failure",
    [ZeroDivisionError("division by zero"), ValueError("math domain error"), KeyError("ball7"), TypeError("complex")],
    ids=lambda failure: type(failure).__name__,
)
def test_what_makes_no_scene_is_refused_beyond_the_ranges(failure: Exception) -> None:
    def build(self: Any, scene: Scene) -> None:
        raise failure

    cls = other(build=build)
    assert examined(cls())["outcome"] == "crashed"
    record = examined(cls.outside(mass=100.0))
    assert (record["outcome"], record["rule"], record["inside"]) == ("refused", "model", False)
    assert record["line"].startswith("model: Other: values outside of their ranges make no scene: ")


def test_a_law_that_finds_nothing_to_speak_of_beyond_the_ranges_declines() -> None:
    def stumbles(self: Any, run: Run) -> Any:
        return [][0]

    for what in ({"caption": stumbles}, {"path": observable("m")(stumbles)}):
        assert examined(other(**what).outside(mass=100.0))["rule"] == "model"
        assert examined(other(**what)())["outcome"] == "crashed"


@pytest.mark.parametrize("failure", [RuntimeError("lost"), MemoryError("no room"), np.linalg.LinAlgError("singular")])
def test_what_stops_the_simulation_is_a_crash_wherever_it_is(
    failure: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: Any, **__: Any) -> Any:
        raise failure

    monkeypatch.setattr(stress, "simulate_specimen", stop)
    assert examined(Bounce.outside(mass=100.0))["outcome"] == examined(Bounce())["outcome"] == "crashed"


def test_what_the_compiler_declines_is_refused() -> None:
    assert examined(Bounce.outside(mass=-1.0))["rule"] == "model"


@pytest.mark.parametrize(
    "why", [NotEvaluated("too short"), ParameterError("out of range"), Refusal("R3", "no")], ids=lambda why: str(why)
)
def test_what_cannot_be_decided_is_no_failure(why: Exception) -> None:
    def asks(self: Any, run: Run) -> Any:
        raise why

    record = examined(other(falls_with_g=law("?", source="a test", within=(1.0, 1.0, 1.0))(asks))())
    assert record["outcome"] == "sound"
    assert record["laws"] == {}
    assert list(record["silent"]) == ["asks"]


def test_laboratories_of_matter_are_left_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    """A law that asks for another run is judged of a scene without matter, and of one with matter not."""
    asked: list[dict[str, Any]] = []
    again = Run.again

    def counted(self: Run, **changes: Any) -> Run:
        asked.append(changes)
        return again(self, **changes)

    def twice(self: Any, run: Run) -> Any:
        return run.again(mass=1.0).t[-1], run.t[-1]

    monkeypatch.setattr(Run, "again", counted)
    twin = law("t = t", source="a test", within=(1.0, 1.0, 1.0))
    assert "twice" in examined(other(falls_with_g=twin(twice))())["laws"]
    matter = phenomenon(67).make(drop=0.1)
    record = stress.examine(matter, Fidelity("coarse", 8, 6, 1))
    assert record["laws"]
    assert set(record["laws"]) | set(record["silent"]) == set(matter.laws())
    labs = {name: why for name, why in record["silent"].items() if why.startswith("asks for a run with setup = ")}
    assert 0 < len(labs) <= len(asked) - 1
    entry = next(iter(stress.tabulate({("specimen", 67, "draft", ""): record}).values()))
    assert set(labs) <= set(entry["undecided"])
    assert "Decided by none of these runs: " + next(iter(labs)).replace("_", " ") in stress.page({"67": entry})


def test_the_page_tells_what_was_tried_at_another_fidelity() -> None:
    kept = fidelity.measured("stability")
    table = {index: dict(kept[index]) for index in ("1", "2", "46")}
    table["46"]["fidelity"] = "draft"
    text = stress.page(table)
    assert "at standard fidelity, unless another stands there" in text
    assert text.count("Specimens at ") == 1
    assert "## 46 SimplePendulum\n\nSpecimens at draft fidelity.\n" in text


def test_nobody_waits_for_ever() -> None:
    record = examined(Bounce(), limit=0.005)
    assert record["outcome"] == "unfinished"
    assert "0.005 s" in record["line"]


@pytest.mark.parametrize(("index", "giver"), [(16, "motor"), (41, "motor"), (43, "drive"), (8, "wind")])
def test_what_is_given_is_not_gained(index: int, giver: str) -> None:
    """Nothing is gained but what motors, drives and winds give; who forgets one of them sees energy from nowhere, and
    so does who looks at a motion that grows by itself while they work."""
    run = nominal(index, DRAFT)
    taken, doubt = stress.given(run)
    assert np.ptp(taken) > 0.3 * run.motion.kinetic.max()
    assert stress.gained(run) < 1e-3
    other = copy.copy(run.scene)
    if giver == "drive":
        other.control = {}
    if giver == "wind":
        other.effects = []
    worked = np.zeros(len(run)) if giver == "motor" else run.worked
    assert stress.gained(dataclasses.replace(run, scene=other, worked=worked)) > 10 * stress.ENERGY[0]
    faster = dataclasses.replace(run, qvel=run.qvel * (1 + 0.1 * run.t / run.t[-1])[:, None])
    assert stress.gained(faster) > stress.ENERGY[0]
    assert doubt < 5e-3 * np.ptp(taken)


@pytest.mark.parametrize("sizes", [(2,) * 12, (2, 2, 3, 5, 2), (7, 2, 4, 3, 1, 2), (6, 5)])
def test_every_two_levels_meet(sizes: tuple[int, ...]) -> None:
    rows = stress.covering(sizes, seed=1)
    for (i, m), (j, n) in itertools.combinations(enumerate(sizes), 2):
        assert {(row[i], row[j]) for row in rows} == set(itertools.product(range(m), range(n)))
    assert all(0 <= k < m for row in rows for k, m in zip(row, sizes, strict=True))
    largest, next_ = sorted(sizes)[:-3:-1]
    assert len(rows) <= max(2 * largest * next_, 14)
    assert rows == stress.covering(sizes, seed=1)


def test_few_corners_are_all_tried() -> None:
    assert sorted(stress.covering((2, 2, 2, 2), seed=0)) == list(itertools.product(range(2), repeat=4))


@pytest.mark.parametrize("index", [10, 46, 33])
def test_the_box(index: int) -> None:
    cls = phenomenon(index)
    found = stress.box(cls, seed=3, latin=6)
    assert found == stress.box(cls, seed=3, latin=6)
    assert found[0] == cls.make()
    assert all(what.checked for what in found)
    assert len(set(found)) == len(found)
    declared = {name: param for name, (param, _) in cls.declarations().items()}
    ends = {name: (p.words if isinstance(p, Choice) else (p.low, p.high)) for name, p in declared.items()}
    for first, second in itertools.combinations(ends, 2):
        met = {(getattr(what, first), getattr(what, second)) for what in found}
        assert set(itertools.product(ends[first], ends[second])) <= met
    for name, values in ends.items():
        assert all(dataclasses.replace(cls.make(), **{name: value}) in found for value in values)
    for name, (param, kind) in cls.declarations().items():
        if isinstance(param, Param) and kind is float:  # one of the six in each sixth of the range
            values = [getattr(what, name) for what in found[-6:]]
            wide = param.low > 0 and param.high > 30 * param.low
            place = [math.log(v / param.low) / math.log(param.high / param.low) if wide else
                     (v - param.low) / (param.high - param.low) for v in values]  # fmt: skip
            assert sorted(int(6 * u) for u in place) == list(range(6))


def test_laboratories_are_not_in_the_box() -> None:
    assert {what.values()["setup"] for what in stress.box(phenomenon(67), seed=0, latin=4)} == {"drop"}
    assert {what.values()["setup"] for what in stress.box(phenomenon(71), seed=0, latin=4)} == {"drop", "pour"}


@pytest.mark.parametrize(
    ("name", "side", "trusted", "ended"),
    [
        ("height", "high", 8.0, "refused R12"),
        ("height", "low", 0.5 / 64, "holds as far as it was pushed"),
        ("restitution", "low", 0.0, "the model itself refuses"),
        ("count", "low", 1, "the model itself refuses"),
    ],
)
def test_the_frontier(name: str, side: Any, trusted: float, ended: str) -> None:
    found = stress.frontier(Bounce, name, side, DRAFT)
    assert (found["trusted"], found["ended"]) == (trusted, ended)
    assert [record["inside"] for record in found["records"]] == [True] + [False] * (len(found["records"]) - 1)


def test_a_range_that_promises_too_much_is_searched_inwards() -> None:
    def build(self: Any, scene: Scene) -> None:
        if self.height > 1.3:
            raise Refusal("R12", "height; allowed: 1.3 m")
        Bounce.build(self, scene)

    cls = other(build=build)
    found = stress.frontier(cls, "height", "high", DRAFT)
    assert (found["trusted"], found["ended"]) == (1.25, "refused R12")
    with pytest.raises(ValueError, match=r"frontier of Other\.floor; allowed: a number's"):
        stress.frontier(cls, "floor", "high", DRAFT)


def test_a_parameter_that_nothing_depends_on_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stress, "_CONTEXTS", 2)
    idle = Annotated[float, Param("m", 1.0, 2.0, "of nothing")]
    assert stress.unused(other(__annotations__={"idle": idle}, idle=1.5)) == ["idle"]

    def known(self: Any, run: Run) -> Any:
        return self.idle, self.idle

    of_a_law = law("x = x", source="a test", within=(1.0, 1.0, 1.0))(known)
    assert stress.unused(other(__annotations__={"idle": idle}, idle=1.5, known=of_a_law)) == []


def test_a_parameter_that_is_only_refused_is_noticed() -> None:
    """What a refusal names is not yet in the scene."""

    def build(self: Any, scene: Scene) -> None:
        if self.idle > 1.9:
            raise Refusal("R12", f"idle = {self.idle}; allowed: 1.9 or less")
        Bounce.build(self, scene)

    idle = Annotated[float, Param("1", 1.0, 2.0, "does nothing")]
    assert stress.unused(other(__annotations__={"idle": idle}, idle=1.5, build=build)) == ["idle"]


def test_the_shipped_table_is_of_these_ranges() -> None:
    table = fidelity.measured("stability")
    assert [int(index) for index in table] == [entry.index for entry in registry.entries()]
    assert stress.problems(table) == []
    for index, entry in table.items():
        declared = phenomenon(int(index)).declarations()
        numbers = {name: (p.unit, p.low, p.high) for name, (p, _) in declared.items() if isinstance(p, Param)}
        assert {name: (p["unit"], p["low"], p["high"]) for name, p in entry["parameters"].items()} == numbers
        assert entry["worst"] is None or entry["worst"][0] in phenomenon(int(index)).laws()
        assert entry["outcomes"]["sound"] > 0


@pytest.mark.parametrize(
    ("index", "values", "rule"),
    [(20, {"blocks": 8}, "R12"), (34, {"mirrors": 0}, "R12"), (50, {"sticks": 0}, "model"), (49, {"rows": 0}, "model")],
)
def test_where_there_is_no_such_scene_it_is_refused(index: int, values: dict[str, int], rule: str) -> None:
    record = examined(stress.specimen(phenomenon(index), values))
    assert (record["outcome"], record["rule"]) == ("refused", rule), record["line"]


@pytest.mark.parametrize("index", [10, 22, 46])
def test_every_parameter_is_used(index: int) -> None:
    """Those of 22 only in some of its variants."""
    cls = phenomenon(index)
    assert stress.described(cls.make()) == stress.described(cls.make())
    assert stress.unused(cls) == []


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> list[stress.Task]:
    """`Bounce` is phenomenon 0, and tasks are done in this process; those that are."""
    entry = registry.Entry(0, "Bounce", "A ball falls and bounces", "mechanics", __name__)
    monkeypatch.setattr(registry, "entries", lambda: (entry,))
    done: list[stress.Task] = []

    def spread(work: Any, tasks: Sequence[Any], _names: Sequence[str]) -> Iterator[tuple[int, Any]]:
        for n, task in enumerate(tasks):
            done.append(task)
            yield n, work(task)

    monkeypatch.setattr(checks, "spread", spread)
    return done


def test_a_run_goes_on_where_it_was_stopped(listed: list[stress.Task], tmp_path: Path) -> None:
    path = tmp_path / "sub" / "records.jsonl"
    todo = stress.tasks(0, seed=0, latin=0, fidelity="draft", frontiers=[])[:4]
    found = stress.measure(todo, path)
    assert list(found) == todo == listed
    lines = path.read_text().split("\n")
    path.write_text("\n".join(lines[:2]) + "\n" + lines[2][:50])
    listed.clear()
    again = stress.measure(todo, path)
    assert listed == todo[2:]
    assert [record["values"] for record in again.values()] == [record["values"] for record in found.values()]
    listed.clear()
    assert stress.measure(todo, path) == again
    assert listed == []
    path.write_text(path.read_text().replace(f'["{__version__}"', '["9"'))
    with pytest.raises(ValueError, match=r"records\.jsonl: measured with version 9; allowed: "):
        stress.measure(todo, path)


def test_the_command(
    listed: list[stress.Task], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stress, "PUSHES", 3)
    monkeypatch.setattr(stress, "_CONTEXTS", 2)
    records, report, table = (tmp_path / name for name in ("records.jsonl", "stability.md", "stability.json"))
    common = ["stress", "0", "--fidelity", "draft", "--latin", "2", "--records", str(records)]
    earlier = {"46": fidelity.measured("stability")["46"]}
    old = {"low": 0.25, "low_ended": "broken", "high": 3.0, "high_ended": "broken"}
    height = {"unit": "m", "low": 0.5, "high": 2.0, "trusted": {"reference": old, "standard": old, "draft": old}}
    other = {"parameters": {"height": height, "mass": height, "gone": height}, "wrong": ["to be replaced"]}
    table.write_text(json.dumps(earlier | {"0": other}), encoding="utf-8")
    assert main([*common, "--report", str(report), "--table", str(table), "--json"]) == 0
    said = json.loads(capfd.readouterr().out)
    kept = json.loads(table.read_text(encoding="utf-8"))
    assert kept == said | earlier
    assert list(kept) == ["0", "46"]
    entry = said["0"]
    assert entry["outcomes"]["sound"] == entry["specimens"] == len([t for t in listed if t[0] == "specimen"])
    assert entry["wrong"] == []
    assert entry["eased"] == {}
    assert set(entry["parameters"]["mass"]["trusted"]) == {"draft"}, "another range was pushed at the others"
    trusted = entry["parameters"]["height"]["trusted"]
    assert list(trusted) == ["draft", "standard", "reference"]
    assert trusted["standard"] == trusted["reference"] == old
    assert trusted["draft"] == {
        "low": 0.5 / 8, "low_ended": "holds as far as it was pushed", "high": 8.0, "high_ended": "refused R12",
    }  # fmt: skip
    text = report.read_text(encoding="utf-8")
    assert "| height | m | 0.5 to 2 | draft | 0.0625 to 8 | holds as far as it was pushed | refused R12 |" in text
    assert "## 46 SimplePendulum" in text
    monkeypatch.setattr(fidelity, "measured", lambda what: said)
    assert main(["show", "0", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)["parameters"]
    assert [p.get("trusted") for p in shown if p["name"] in ("height", "floor")] == [trusted, None]
    assert main(["show", "0"]) == 0
    out = capfd.readouterr().out
    assert "trusted at draft" in out
    assert "0.0625 to 8" in out


def test_a_range_that_is_refuted_is_exit_code_1(
    listed: list[stress.Task], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Bounce, "caption", lambda self, run: [][int(self.mass)])
    monkeypatch.setattr(stress, "CASES", (stress.Case("too high", 0, {"height": 20.0}, "R1"),))
    options = ["--fidelity", "draft", "--latin", "0", "--frontier", "none", "--records", str(tmp_path / "records")]
    assert main(["stress", "0", *options]) == 1
    said = capfd.readouterr()
    assert "physinone: 0 Bounce: crashed at draft, nominal: caption: IndexError" in said.err
    assert "0 Bounce: case 'too high', expected R1: refused at draft, height=20.0: R12: height" in said.err
    assert "crashed" in said.out


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("999",), "999"),
        (("46", "--latin", "-1"), "--latin -1"),
        (("46", "--seed", "-1"), "--seed -1"),
        (("46", "--fidelity", "fine"), "'fine'"),
        (("46", "--frontier", "fine"), "'fine'"),
        (("46", "--report", "/absent/page.md"), "--report /absent/page.md"),
        (("46", "--table", "/absent/table.json"), "--table /absent/table.json"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], part: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["stress", *arguments]) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert part in said.err


@pytest.mark.parametrize("content", ["{", "[]", '{"pendulum": {}}', '{"46": 0}'])
def test_what_is_no_table_is_not_replaced(content: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.json"
    table.write_text(content, encoding="utf-8")
    assert main(["stress", "46", "--table", str(table), "--records", str(tmp_path / "records")]) == 2
    assert f"--table {table}: not a table by index" in capfd.readouterr().err
    assert table.read_text(encoding="utf-8") == content
    assert not (tmp_path / "records").exists()


def test_no_room_on_the_disk_leaves_the_table_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = tmp_path / "table.json"
    table.write_text("{}", encoding="utf-8")

    def half(path: Path, text: str, **_: Any) -> int:
        path.write_bytes(text.encode()[: len(text) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", half)
    with pytest.raises(OSError, match="No space left"):
        write_tables({}, {"46": {}}, lambda _: "", table, None)
    assert table.read_text(encoding="utf-8") == "{}"
    assert list(tmp_path.iterdir()) == [table]


def test_nothing_is_shown_of_what_was_not_measured(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(fidelity, "measured", lambda what: {})
    assert main(["show", "46"]) == 0
    assert "trusted" not in capfd.readouterr().out


CHEAP = {
    "a million to one in mass, colliding", "a million to one in mass, jointed", "a pendulum of 1 mm",
    "poles within each other's core", "a damper faster than the step",
    "restitution of more than 1", "a grazing beam",
}  # fmt: skip


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=[] if case.name in CHEAP else pytest.mark.slow) for case in stress.CASES],
)
def test_set_ups_made_to_break_it(case: stress.Case) -> None:
    record = examined(stress.specimen(phenomenon(case.index), case.values))
    assert record.get("rule", record["outcome"]) == case.expected, record


def test_every_cheap_case_is_there() -> None:
    assert {case.name for case in stress.CASES} >= CHEAP
    assert len({(case.index, case.name) for case in stress.CASES}) == len(stress.CASES)
    assert STANDARD.rank < len(stress.ENERGY)
