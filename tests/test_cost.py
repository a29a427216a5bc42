"""What a scene costs: every second is charged once, to what it was spent on, and the clocks leave no trace."""

from __future__ import annotations

import contextlib
import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physinone_mj import contact, cost, dataset, optics, run
from physinone_mj.__main__ import main
from physinone_mj.cost import ELSE, ORDER, RESTING, TWINS, Ledger, apart, compare, measure, toll
from physinone_mj.dataset import Job, state_digest
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.registry import phenomenon
from physinone_mj.simulate import Film, Stepper, simulate

COARSE = Fidelity("coarse", 16, 8, 1)


class Clock:
    """Time passes when it is told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def works(self, seconds: float, *then: Callable[[], None]) -> Callable[..., None]:
        """A function that takes so long, half before and half after what it calls."""

        def work(*_: object) -> None:
            self.now += seconds / 2
            for call in then:
                call()
            self.now += seconds / 2

        return work


def test_a_clock_stands_still_while_another_one_runs() -> None:
    clock = Clock()
    with Ledger(clock=clock) as ledger:
        inner = ledger.clocked(clock.works(2.0), "inner")
        outer = ledger.clocked(clock.works(4.0, inner, clock.works(1.0), inner), "outer")
        clock.works(8.0, outer)()
    assert ledger.spent == {"inner": 4.0, "outer": 5.0, ELSE: 8.0}
    assert ledger.calls == {"inner": 2, "outer": 1}
    assert ledger.total == clock.now == 17.0


def test_what_is_taken_as_a_whole_is_charged_to_one() -> None:
    clock = Clock()
    with Ledger(clock=clock) as ledger:
        inner = ledger.clocked(clock.works(2.0), "inner")
        ledger.clocked(clock.works(4.0, inner), "outer", whole=True)()
        inner()
    assert ledger.spent == {"inner": 2.0, "outer": 6.0, ELSE: 0.0}
    assert ledger.calls == {"inner": 1, "outer": 1}


def test_a_call_may_say_itself_what_it_is_charged_to_and_count_for_many() -> None:
    clock = Clock()
    with Ledger(clock=clock) as ledger:
        work = ledger.clocked(clock.works(2.0), lambda which: f"the {which}")
        work("first")
        ledger.weights = {"the second": 10.0}
        work("second")
        work("first")
    assert ledger.spent == {"the first": 4.0, "the second": 20.0, ELSE: 0.0}
    assert ledger.total == 6.0


def test_a_failure_stops_the_clock_too() -> None:
    clock = Clock()

    def fails() -> None:
        clock.now += 1.0
        raise ArithmeticError

    with Ledger(clock=clock) as ledger:
        for whole in (False, True):
            with pytest.raises(ArithmeticError):
                ledger.clocked(fails, "failing", whole=whole)()
        ledger.clocked(clock.works(3.0), "after")()
    assert ledger.spent == {"failing": 2.0, "after": 3.0, ELSE: 0.0}


def test_what_was_watched_is_as_it_was() -> None:
    class Base:
        def work(self) -> str:
            return "done"

    class Derived(Base):
        pass

    before = Base.work
    with Ledger() as ledger, contextlib.suppress(KeyError):
        ledger.watch(Base, "work", "base")
        ledger.watch(Derived, "work", "derived")
        assert Derived().work() == "done"
        assert Base().work() == "done"
        assert ledger.calls == {"base": 2, "derived": 1}
        raise KeyError
    assert Base.work is before
    assert "work" not in vars(Derived)


def test_the_clock_s_own_time_is_taken_off() -> None:
    clock, count = Clock(), 1000

    def slow() -> float:
        """A clock that takes three seconds to be read, one of them after it has looked."""
        clock.now += 3.0
        return clock.now - 1.0

    with Ledger(toll(slow), slow) as ledger:
        work = ledger.clocked(clock.works(5.0), "work")
        for _ in range(count):
            work()
            clock.now += 7.0
    assert ledger.spent["work"] / count == pytest.approx(5.0, abs=0.05)
    assert ledger.spent[ELSE] / count == pytest.approx(7.0, abs=0.05)


@pytest.fixture(scope="module")
def pendulum() -> dict[str, Any]:
    return measure(Job(46, {}, DRAFT, render=False), turns=1)


def seconds(record: dict[str, Any]) -> dict[str, float]:
    return {stage["stage"]: stage["seconds"] for stage in record["stages"]}


def test_the_parts_are_the_whole(pendulum: dict[str, Any]) -> None:
    parts = seconds(pendulum)
    assert sum(parts.values()) == pytest.approx(pendulum["seconds"], rel=1e-9)
    assert pendulum["seconds"] == pytest.approx(pendulum["clocked"], rel=1e-9), "nothing stands for more than itself"
    assert sum(stage["share"] for stage in pendulum["stages"]) == pytest.approx(1.0)
    assert min(parts.values()) > -1e-3
    assert parts[ELSE] < 0.15 * pendulum["seconds"], parts
    assert list(parts) == [stage for stage in ORDER if stage in parts]
    assert {"compiling it", "smooth motion", "replay", "laws", TWINS, "annotation", "writing"} <= set(parts)
    loops = pendulum["seconds"] / pendulum["simulated"] / pendulum["unit"]
    assert sum(stage["cost"] for stage in pendulum["stages"]) == pytest.approx(loops)


def test_a_motion_takes_as_long_with_clocks_as_without(pendulum: dict[str, Any]) -> None:
    """A neighbour who takes the core away for a moment, once or twice, is forgiven."""

    def off(record: dict[str, Any]) -> float:
        parts = seconds(record)
        simulating = ("building the scene", "compiling it", "starting", "smooth motion", "recording")
        return abs(sum(parts[name] for name in simulating) / record["everything_on"]["seconds"] - 1)

    job = Job(46, {}, DRAFT, render=False)
    assert any(off(record) < 0.5 for record in itertools.chain([pendulum], (measure(job, turns=1) for _ in range(3))))


def test_what_a_pendulum_needs_no_more_than(pendulum: dict[str, Any]) -> None:
    out = {left["what"] for left in pendulum["left_out"]}
    assert {"MuJoCo's contact stage", "MuJoCo's constraint stage", "force callback", "sensors at every step", "OpenGL",
            "following rays of light"} <= out  # fmt: skip
    assert pendulum["problems"] == []
    assert pendulum["everything_on"]["apart"] == {}
    assert pendulum["pictures"] is None
    json.dumps(pendulum, allow_nan=False)


def test_stages_of_a_scene_with_contact_and_effects() -> None:
    collision = measure(Job(3, {}, COARSE, render=False), turns=0)
    assert {"looking for contact", "impacts", "smooth motion", "between the pieces"} <= set(seconds(collision))
    assert "MuJoCo's contact stage" not in {left["what"] for left in collision["left_out"]}
    wind = measure(Job(8, {}, COARSE, render=False), turns=0)
    assert "effects" in seconds(wind)
    assert "force callback" not in {left["what"] for left in wind["left_out"]}
    light = measure(Job(33, {}, COARSE, render=False), turns=0)
    assert "rays of light" in seconds(light)
    assert [record["problems"] for record in (collision, wind, light)] == [[], [], []]
    assert all("everything_on" not in record for record in (collision, wind, light))


def test_nothing_stays_replaced() -> None:
    owners = (Stepper, Film, contact.Solver, run.Run, run, optics, dataset, Path, phenomenon(46))
    before = [dict(vars(owner)) for owner in owners]
    measure(Job(46, {}, COARSE, render=False), turns=0)
    assert [dict(vars(owner)) for owner in owners] == before


def test_pictures_that_are_drawn_stand_for_all() -> None:
    job = Job(46, {}, DRAFT, views=2, size=128)
    record = measure(job, turns=0)
    parts, calls = seconds(record), {stage["stage"]: stage["calls"] for stage in record["stages"]}
    frames = round(record["simulated"] * 30)
    assert record["pictures"] == {"size": 128, "drawn": 16, "stand_for": 3 * frames}
    assert calls["encoding colour"] == calls["encoding depth"] == calls["encoding segmentation"] == 16
    assert calls["drawing what stands still"] == 2, "colour and matter of the one standing camera"
    assert calls["drawing depth and segmentation"] == 16
    assert "drawing what mirrors show" not in calls
    assert record["seconds"] > record["clocked"] > 0
    assert parts["drawing colour"] > 0
    assert record["problems"] == []
    out = {left["what"] for left in record["left_out"]}
    assert "a second picture, of what mirrors show" in out
    assert "OpenGL" not in out


def test_a_scene_that_wastes_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    economies = cost.economies

    def wasteful(stepper: Stepper) -> list[cost.Economy]:
        stepper.model.opt.disableflags = 0
        return economies(stepper)

    monkeypatch.setattr(cost, "economies", wasteful)
    problems = measure(Job(46, {}, COARSE, render=False), turns=0)["problems"]
    assert [line.partition(":")[0] for line in problems] == [
        "MuJoCo's contact stage", "MuJoCo's constraint stage", "sensors at every step",
    ]  # fmt: skip


def test_another_state_is_told_quantity_by_quantity() -> None:
    first, other = (simulate(46, fidelity=COARSE, angle=angle) for angle in (1.0, 1.1))
    assert apart(first, first) == {}
    assert state_digest(first) != state_digest(other)
    assert set(apart(first, other)) == {"qpos", "qvel"}
    assert apart(first, other)["qpos"] >= 0.1


def test_what_sleeps_is_told() -> None:
    record = measure(Job(10, {}, COARSE, render=False), turns=1)
    assert RESTING in {left["what"] for left in record["left_out"]}
    assert record["problems"] == []


def test_the_command(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["cost", "46", "--fidelity", "draft", "--no-render", "--turns", "1", "--set", "length=0.7"]) == 0
    table = capfd.readouterr().out
    for word in ("SimplePendulum at draft", "smooth motion", "left out: MuJoCo's contact stage", "bit for bit"):
        assert word in table
    assert main(["cost", "46", "--fidelity", "draft", "--no-render", "--turns", "0", "--json"]) == 0
    (record,) = json.loads(capfd.readouterr().out)
    assert record["label"] == "SimplePendulum"
    assert main(["cost", "46", "--turns", "-1"]) == 2
    assert capfd.readouterr().err == "physinone: --turns -1; allowed: 0 to 100\n"


def test_a_scene_that_is_refused_does_not_stop_the_next(capfd: pytest.CaptureFixture[str]) -> None:
    command = ["cost", "46", "--fidelity", "draft", "--no-render", "--turns", "0", "--set", "swing=conical", "--set"]
    assert main([*command, "angle=1.5"]) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.startswith("physinone: R12: ")
    assert said.err.count("\n") == 1


def test_compare_takes_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    plain = cost.simulate_specimen

    def noted(*arguments: Any, engine: Any, **options: Any) -> Any:
        taken.append(engine.name)
        return plain(*arguments, engine=engine, **options)

    monkeypatch.setattr(cost, "simulate_specimen", noted)
    both = compare(phenomenon(46).make(), COARSE, turns=2)
    assert taken == ["everything on", "ours", "ours", "everything on"]
    assert both["apart"] == {}
    assert both["ratio"] > 0
