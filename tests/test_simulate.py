"""Stepping: what is refused before it starts, what breaks loudly, what is switched off, and what is left as it was."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
import pytest

from physinone_mj.base import Choice, Param, ParameterError, Phenomenon, Refusal
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Solver, Surface
from physinone_mj.fidelity import DRAFT, STANDARD, Fidelity
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import Stepper, UnstableScene, build, compile, simulate, simulate_specimen


@dataclass(frozen=True)
class Shove:
    """A force on the ball [N]: constant until a time, then whatever is given."""

    force: float
    after: float = math.inf
    then: float = 0.0

    def bind(self, model: Any) -> Callable[[Any], None]:
        body = model.body("ball/ball").id

        def push(data: Any) -> None:
            data.xfrc_applied[body, 0] += self.force if data.time < self.after else self.then

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


class Toy(Phenomenon, domain="mechanics"):
    """One ball, with trouble of every kind."""

    trouble: Annotated[Literal["none", "nan", "overlap", "ratio", "spring", "damper", "endless", "huge"],
                       Choice("what is wrong")] = "none"  # fmt: skip
    force: Annotated[float, Param("N", -100.0, 100.0, "sideways")] = 0.0

    def build(self, scene: Scene) -> None:
        scene.add("ball")
        height = 1.0 if self.trouble != "overlap" else 0.04
        scene.start["ball/free"] = free_pose((0, 0, height))
        effect = Shove(self.force)
        if self.trouble == "nan":
            effect = Shove(0.0, 0.2, math.nan)
        if self.trouble == "huge":
            effect = Shove(0.0, 0.2, 1e30)
        scene.effects.append(effect)
        scene.material("ball/ball", 1000.0, Surface())
        scene.material("stage/floor", 1000.0, Surface())
        if self.trouble in ("overlap", "ratio"):
            scene.touch("ball/ball", "stage/floor")
        if self.trouble == "ratio":
            scene.add("ball", "other").geom("ball").mass = 0.5 * 1.1e4
            scene.start["other/free"] = free_pose((1, 0, 1))
            scene.material("other/ball", 1000.0, Surface())
            scene.touch("other/ball", "ball/ball")
        if self.trouble in ("spring", "damper"):
            hung = scene.add("pendulum")
            hung.joint("hinge").stiffness = [1e9 if self.trouble == "spring" else 0, 0, 0]
            hung.joint("hinge").damping = [1e6 if self.trouble == "damper" else 0, 0, 0]
        time = 1e-9 if self.trouble == "endless" else 0.1
        scene.resolve(time=time, length=0.05, duration=1.0)

    def caption(self, run: Any) -> str:
        return ""


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("overlap", r"^R1: Toy: .*(ball/ball|stage/floor).* overlap by 0\.01 m at the start; allowed: 5e-06 m$"),
        ("ratio", r"^R3: Toy: mass ratio 1\.1e\+04 of moving bodies; allowed: 10000$"),
        ("spring", r"^R4: Toy: springs of rate \S+ /s at a step of .* s; allowed: .* /s, or a fidelity of \d+ steps$"),
        ("damper", r"^R4: Toy: dampers of rate \S+ /s at a step of .* s; allowed: .* /s, or a fidelity of \d+ steps$"),
        ("endless", r"^R10: \d+ steps; allowed: \d+; shortest time 1e-09 s"),
    ],
)  # fmt: skip
def test_is_refused_before_the_first_step(trouble: str, message: str) -> None:
    with pytest.raises(Refusal, match=message):
        simulate(Toy, trouble=trouble, fidelity=DRAFT)


def test_the_fidelity_that_a_refusal_names_would_do() -> None:
    with pytest.raises(Refusal) as refused:
        simulate(Toy, trouble="damper", fidelity=DRAFT)
    steps = int(str(refused.value).split()[-2])
    toy = Toy(trouble="damper")
    compile(toy, build(toy), Fidelity("named", steps + steps // 100, 1, 1))


@pytest.mark.parametrize("trouble", ["nan", "huge"])
def test_an_unstable_run_says_who_when_and_what(trouble: str) -> None:
    with pytest.raises(UnstableScene, match=rf'Toy\("trouble": "{trouble}".*\) broke at t = 0\.2.* s: ') as broke:
        simulate(Toy, trouble=trouble, fidelity=DRAFT)
    assert 0.2 <= broke.value.time <= 0.2 + 2 / 30
    assert str(pickle.loads(pickle.dumps(broke.value))) == str(broke.value)
    assert mujoco.get_mjcb_passive() is None


def test_the_engine_never_resets_itself() -> None:
    toy = Toy(trouble="huge")
    compiled = compile(toy, build(toy), DRAFT)
    assert compiled.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET


def test_warnings_write_no_log_file(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnstableScene):
        simulate(Toy, trouble="huge", fidelity=DRAFT)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("length", math.nan, "SimplePendulum: length = nan is not finite; allowed: 0.2 to 2 m"),
        ("length", 3.0, "SimplePendulum: length = 3.0 is out of range; allowed: 0.2 to 2 m"),
        ("length", "long", "SimplePendulum: length = 'long' is not a number; allowed: 0.2 to 2 m"),
        ("lenght", 1.0, "SimplePendulum: no parameter 'lenght'; did you mean length?"),
        ("swing", "wild", "SimplePendulum: swing = 'wild' is not a choice; allowed: planar, conical"),
    ],
)
def test_a_wrong_parameter_is_named_with_what_is_allowed(name: str, value: Any, message: str) -> None:
    with pytest.raises(ParameterError) as wrong:
        simulate(46, **{name: value})
    assert str(wrong.value).startswith(message)


def test_nothing_runs_that_the_scene_does_not_need() -> None:
    pendulum = simulate(46, fidelity=DRAFT)
    flags = pendulum.model.opt.disableflags
    assert flags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert flags & mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys; from physinone_mj import *; import physinone_mj; "
         "physinone_mj.simulate(46); print(*[m for m in ('taichi', 'OpenGL', 'cv2', 'render') if m in sys.modules])"],
        capture_output=True, text=True, check=True,
        env={name: value for name, value in os.environ.items() if name != "MUJOCO_GL"},  # as a test of pictures sets it
    )  # fmt: skip
    assert loaded.stdout.strip() == ""


def test_switching_the_economies_off_changes_no_bit() -> None:
    specimen = simulate(46, fidelity=DRAFT).specimen
    compiled = compile(specimen, build(specimen), DRAFT)
    states = []
    for flags in (compiled.model.opt.disableflags, int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)):
        compiled.model.opt.disableflags = flags
        with Stepper(compiled) as stepper:
            for _ in range(400):
                stepper.advance()
            states.append(stepper.data.qpos.tobytes() + stepper.data.qvel.tobytes())
    assert states[0] == states[1]


def test_an_effect_is_evaluated_at_every_stage() -> None:
    """A constant force under Runge-Kutta is exact, but so is one held over the step: count the evaluations as well."""
    calls = []

    @dataclass(frozen=True)
    class Counting(Shove):
        def bind(self, model: Any) -> Callable[[Any], None]:
            push = super().bind(model)

            def counted(data: Any) -> None:
                calls.append(data.time)
                push(data)

            return counted

    class Counted(Toy, domain="mechanics"):
        """One ball, shoved."""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.effects[:] = [Counting(self.force)]

    toy = Counted(force=2.0)
    compiled = compile(toy, build(toy), DRAFT)
    with Stepper(compiled) as stepper:
        stepper.advance()
    assert len(calls) == 4 * compiled.steps
    assert len(set(calls)) == 2 * compiled.steps + 1, "start, middle and end of every step"
    run = simulate_specimen(toy, fidelity=DRAFT)
    assert np.abs(run.position("ball/ball")[:, 0] - 0.5 * (2.0 / 0.5) * run.t**2).max() < 1e-13


def test_gravity_and_boost_change_the_scene() -> None:
    run = simulate(Toy, fidelity=DRAFT)
    half, boosted = run.again(gravity=g / 2), run.again(boost=(1.0, 0.0, 0.0))
    fall = [1.0 - r.position("ball/ball")[-1, 2] for r in (run, half)]
    assert fall[0] == pytest.approx(0.5 * g * run.t[-1] ** 2, rel=1e-12)
    assert fall[1] == pytest.approx(fall[0] / 2, rel=1e-12)
    assert boosted.position("ball/ball")[-1, 0] == pytest.approx(run.t[-1], rel=1e-12)


def test_another_process_makes_the_same_bytes() -> None:
    code = (
        "import hashlib; from physinone_mj.simulate import simulate; from physinone_mj.fidelity import DRAFT; "
        "run = simulate(46, fidelity=DRAFT); print(hashlib.sha256(run.qpos.tobytes() + run.qvel.tobytes()).hexdigest())"
    )
    digests = {subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
               for _ in range(2)}  # fmt: skip
    assert len(digests) == 1


def test_the_clock_of_a_sample_does_not_depend_on_the_steps() -> None:
    assert simulate(46, fidelity=DRAFT).t.tobytes() == simulate(46, fidelity=STANDARD).t.tobytes()


def test_a_zero_resolution_is_a_bug_in_the_phenomenon() -> None:
    with pytest.raises(ValueError, match=r"time = 0; allowed: positive and finite"):
        Scene().resolve(time=0, length=1, duration=1)


def test_impacts_that_lead_nowhere_are_left_to_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heap that is wedged: every impact is tried, none moves anything apart. The step goes on, and nothing sinks."""
    tried: list[float] = []
    monkeypatch.setattr(Solver, "crowd", lambda self, data: True)
    monkeypatch.setattr(Solver, "impact", lambda self, data: tried.append(data.time))
    run = simulate(10, fidelity=DRAFT, count=1)
    ball = run.position("ball0/ball")[:, 2]
    assert set(Counter(tried).values()) == {32}
    assert ball.min() > 0.99 * run.specimen.radius
    monkeypatch.setattr(sys.modules["physinone_mj.simulate"], "_STUCK", 10**6)
    with pytest.raises(UnstableScene, match="impacts within one step"):
        simulate(10, fidelity=DRAFT, count=1)
