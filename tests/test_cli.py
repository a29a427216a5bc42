"""The command line: what is asked for is printed, what cannot be is one line on standard error."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
import types
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest

import physinone_mj
from physinone_mj import checks, registry, terminal
from physinone_mj.__main__ import chosen, main, settings
from physinone_mj.base import Law, Phenomenon, Verdict
from physinone_mj.checks import judge, spread
from physinone_mj.fidelity import DRAFT
from physinone_mj.registry import entries, phenomenon

HOME = Path(__file__).resolve().parents[1]
QUICK = ("--fidelity", "draft", "--no-render")

TOY = '''
from math import pi
from typing import Annotated, Literal

from physinone_mj.base import Choice, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.scene import free_pose

class BriefFall(Phenomenon, domain="mechanics"):
    """A ball falls for a fifth of a second."""

    height: Annotated[float, Param("m", 0.5, 2.0, "centre above the floor")] = 1.0
    mass: Annotated[float, Param("kg", 0.1, 5.0, "ball")] = 0.5
    colour: Annotated[Literal["red", "green"], Choice("of the ball")] = "red"

    def build(self, scene):
        ball = scene.add("ball")
        ball.geom("ball").mass = self.mass
        scene.material("ball/ball", self.mass / (4 / 3 * pi * 0.05**3), Surface())
        scene.start["ball/free"] = free_pose((0, 0, self.height))
        scene.resolve(time=0.1, length=0.05, duration=0.2)

    @observable("m")
    def fallen(self, run):
        """How far, from the start."""
        return self.height - run.position("ball/ball")[:, 2]

    @law("s = g t²/2", source="a test", within=(1e-6, 1e-6, 1e-6))
    def falls_with_g(self, run):
        return self.fallen(run), g * run.t**2 / 2

    @law("T(4 m) = T(m)", source="a test", within=(1e-6, 1e-6, 1e-6), limited_by="nothing known")
    def mass_does_not_matter(self, run):
        if self.colour == "green":
            raise NotEvaluated("the ball is green")
        return run.again(mass=2 * self.mass).qpos[-1, 2], run.qpos[-1, 2]

    def caption(self, run):
        return "A ball falls."
'''
INDEX, LABEL, LAWS = 907, "BriefFall", ["falls_with_g", "mass_does_not_matter"]


@pytest.fixture(scope="module", autouse=True)
def toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[type[Phenomenon]]:
    """A phenomenon that is over soon, listed after the real ones."""
    module = types.ModuleType("phenomena.p907_brief_fall")
    real = entries()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, module.__name__, module)
        exec(TOY, module.__dict__)
        one = registry.Entry(INDEX, LABEL, "A ball falls for a fifth of a second", "mechanics", module.__name__)
        patch.setattr(registry, "entries", lambda: (*real, one))
        yield module.BriefFall


@dataclasses.dataclass
class Said:
    code: int
    out: str
    err: str

    def values(self) -> Any:
        return json.loads(self.out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


@pytest.fixture
def physinone(capfd: pytest.CaptureFixture[str]) -> Any:
    def call(*arguments: object) -> Said:
        capfd.readouterr()
        code = main([str(a) for a in arguments])
        out, err = capfd.readouterr()
        return Said(code, out, err)

    return call


def process(*arguments: object, **environment: str) -> Said:
    command = [sys.executable, "-m", "physinone_mj", *map(str, arguments)]
    done = subprocess.run(command, cwd=HOME, env=os.environ | environment, capture_output=True, text=True, check=False)
    return Said(done.returncode, done.stdout, done.stderr)


def refused(said: Said, *parts: str) -> None:
    """Exit code 2 and one line that holds these parts."""
    assert said.code == 2
    assert said.out == ""
    assert said.err.startswith("physinone: ")
    assert said.err.count("\n") == 1, said.err
    for part in parts:
        assert part in said.err


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one scene of the nominal specimen, without pictures."""
    folder = tmp_path_factory.mktemp("scenes")
    assert main(["run", str(INDEX), *QUICK, "-o", str(folder)]) == 0
    return folder


def scene_in(folder: Path) -> Path:
    (scene,) = folder.iterdir()
    return scene


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


# A wrong word and what the line must name: the wrong thing, its value, what is allowed.
WRONG = [
    (("show", "999"), ("999", "46")),
    (("show", "SimplPendulum"), ("'SimplPendulum'", "did you mean SimplePendulum?")),
    (("run", "simplependulum"), ("did you mean SimplePendulum?",)),
    (("check", "999"), ("999",)),
    (("check", "950-990"), ("950-990", "46")),
    (("check", "907", "--set", "height=9"), ("BriefFall: height = 9", "0.5 to 2 m")),
    (("run", "907", "--set", "height=9"), ("BriefFall: height = 9", "0.5 to 2 m")),
    (("run", "907", "--sample", "--set", "height=9"), ("BriefFall: height = 9", "0.5 to 2 m")),
    (("check", "907", "--set", "hieght=1"), ("'hieght'", "did you mean height?")),
    (("check", "907", "--set", "height=nan"), ("height = nan", "not finite", "0.5 to 2 m")),
    (("check", "907", "--set", "height=-inf"), ("height = -inf", "not finite")),
    (("check", "907", "--set", "height=high"), ("height = 'high'", "not a number")),
    (("check", "907", "--set", "height=" + "9" * 400), ("height = inf", "not finite")),
    (("check", "907", "--set", "colour=blue"), ("colour = 'blue'", "red, green")),
    (("check", "907", "--set", "colour=1"), ("colour = '1'", "red, green")),
    (("check", "907", "--set", "height"), ("'height'", "name=value")),
    (("check", "907", "--set", "=1"), ("'=1'", "name=value")),
    (("check", "907", "--fidelity", "fine"), ("'fine'", "draft, standard, reference")),
    (("run", "907", "--fidelity", "fine"), ("'fine'", "draft, standard, reference")),
    (("run", "907", "--views", "0"), ("views = 0", "1 to 64")),
    (("run", "907", "--size", "1"), ("size = 1", "16 to 4096")),
    (("run", "907", "--size", "large"), ("--size", "integer")),
    (("run", "907", "--modalities", "rgb,sound"), ("rgb,sound", "rgb,depth,seg")),
    (("run", "907", "--sample", "--seed", "-1"), ("seed = -1",)),
    (("run", "907", "--bogus"), ("--bogus",)),
    (("run",), ("N",)),
    (("frobnicate",), ("frobnicate",)),
    (("verify", "/nonexistent"), ("/nonexistent",)),
    (("reproduce", "/nonexistent"), ("/nonexistent",)),
]


@pytest.mark.parametrize(("arguments", "parts"), WRONG, ids=[" ".join(a)[:40] for a, _ in WRONG])
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], parts: tuple[str, ...], physinone: Any, tmp_path: Path
) -> None:
    if arguments[0] == "run":
        arguments = (*arguments, "--no-render", "-o", str(tmp_path / "out"))
    refused(physinone(*arguments), *parts)
    assert list(tmp_path.iterdir()) == []


def test_bad_input_in_a_process_of_its_own() -> None:
    refused(process("check", "46", "--set", "length=nan"), "length = nan")


def test_output_that_cannot_be_written(physinone: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "sub"):
        refused(physinone("run", INDEX, *QUICK, "-o", out), str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_scene_that_exists_is_kept(physinone: Any, tmp_path: Path) -> None:
    assert physinone("run", INDEX, *QUICK, "-o", tmp_path).code == 0
    before = contents(tmp_path)
    refused(physinone("run", INDEX, *QUICK, "-o", tmp_path), scene_in(tmp_path).name, "--force")
    assert contents(tmp_path) == before
    assert physinone("run", INDEX, *QUICK, "-o", tmp_path, "--force").code == 0
    after = contents(tmp_path)
    assert set(after) == set(before)
    assert all(after[name][1] != before[name][1] for name in after)


def test_a_scene_that_exists_does_not_keep_others_from_being_made(
    physinone: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    other = registry.Entry(908, "Twin", "", "mechanics", registry.find(INDEX).module)
    there = (*registry.entries(), other)
    monkeypatch.setattr(registry, "entries", lambda: there)
    physinone("run", INDEX, *QUICK, "-o", tmp_path)
    said = physinone("run", INDEX, 908, "--set", "mass=0.5", *QUICK, "-o", tmp_path, "--json")
    assert said.code == 2
    assert "--force" in said.err
    assert [scene["index"] for scene in said.values()] == [908]
    assert len(list(tmp_path.iterdir())) == 2


def test_no_graphics(tmp_path: Path) -> None:
    nowhere = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent/driver.json"}
    said = process("run", "10", "--fidelity", "draft", "--views", 1, "--size", 32, "-o", tmp_path / "out", **nowhere)
    assert said.code == 2
    assert said.out == ""
    (line,) = [line for line in said.err.splitlines() if line.startswith("physinone: ")]
    assert "no headless OpenGL" in line
    assert "apt-get" in line
    assert "Traceback" not in said.err
    assert list(tmp_path.rglob("*.h5")) == []


def test_a_refusal_is_one_line(physinone: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    refuse = physinone_mj.Refusal("R1", "the balls overlap by 0.1 m; allowed: 0 m")

    def build(self: Any, scene: Any) -> None:
        raise refuse

    monkeypatch.setattr(phenomenon(INDEX), "build", build)
    refused(physinone("run", INDEX, *QUICK, "-o", tmp_path), "R1: the balls overlap")
    said = physinone("check", INDEX, "--json")
    assert said.values() == []
    assert said.code == 2
    assert said.err == f"physinone: {refuse}\n"
    assert list(tmp_path.iterdir()) == []


def test_an_unstable_scene_is_one_line(physinone: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from physinone_mj.simulate import Stepper

    def advance(stepper: Stepper) -> None:
        raise physinone_mj.UnstableScene(stepper.compiled.specimen, 0.5, "qvel is not finite")

    monkeypatch.setattr(Stepper, "advance", advance)
    refused(physinone("run", INDEX, *QUICK, "-o", tmp_path), LABEL, "t = 0.5 s", "qvel is not finite")
    assert list(tmp_path.iterdir()) == []


def test_a_defect_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def build(self: Any, scene: Any) -> None:
        raise ValueError("a defect")

    monkeypatch.setattr(phenomenon(INDEX), "build", build)
    with pytest.raises(ValueError, match="a defect"):
        main(["check", str(INDEX)])


@pytest.mark.parametrize("name", sorted(terminal.EXPECTED | terminal.OF_ONE_SCENE))
def test_every_expected_error_exists(name: str) -> None:
    module, _, kind = name.rpartition(".")
    assert issubclass(getattr(importlib.import_module(module), kind), Exception)


def false_law(monkeypatch: pytest.MonkeyPatch) -> str:
    """Let the first law be held to the impossible; its name."""
    honest = Law.judge

    def judge(law: Law, specimen: Any, run: Any) -> Verdict:
        strict = dataclasses.replace(law, within=(-1.0,) * 3) if law.name == LAWS[0] else law
        return honest(strict, specimen, run)

    monkeypatch.setattr(Law, "judge", judge)
    return LAWS[0]


def test_a_failing_law_is_exit_code_1(physinone: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    name = false_law(monkeypatch)
    said = physinone("check", INDEX, "--fidelity", "draft", "--json")
    assert said.code == 1
    assert [law["law"] for law in said.values() if law["passed"] is False] == [name]
    said = physinone("check", INDEX, "--fidelity", "draft")
    assert said.code == 1
    assert "failed" in next(line for line in said.out.splitlines() if name in line)
    assert physinone("run", INDEX, *QUICK, "-o", tmp_path).code == 1


def test_list(physinone: Any) -> None:
    said = physinone("list")
    assert said.code == 0
    assert len(said.out.splitlines()) == len(registry.entries())
    assert " 46  SimplePendulum " in said.out
    told = physinone("list", "--json").values()
    assert [set(entry) for entry in told] == [{"index", "label", "domain", "title"}] * len(registry.entries())
    assert [entry["index"] for entry in told] == [entry.index for entry in registry.entries()]


def test_show(physinone: Any) -> None:
    by_index, by_label = physinone("show", INDEX, "--json"), physinone("show", LABEL, "--json")
    assert by_index == by_label
    assert by_index.values() == {
        "index": INDEX,
        "label": LABEL,
        "domain": "mechanics",
        "title": "A ball falls for a fifth of a second",
        "parameters": [
            {"name": "height", "unit": "m", "nominal": 1.0, "about": "centre above the floor", "low": 0.5, "high": 2.0},
            {"name": "mass", "unit": "kg", "nominal": 0.5, "about": "ball", "low": 0.1, "high": 5.0},
            {"name": "colour", "unit": "", "nominal": "red", "about": "of the ball", "words": ["red", "green"]},
        ],
        "observables": [{"name": "fallen", "unit": "m", "about": "How far, from the start."}],
        "laws": [
            {
                "name": name,
                "equation": equation,
                "source": "a test",
                "within": {"draft": 1e-6, "standard": 1e-6, "reference": 1e-6},
                "unit": None,
                "limited_by": limit,
            }
            for name, equation, limit in zip(
                LAWS, ("s = g t²/2", "T(4 m) = T(m)"), (None, "nothing known"), strict=True
            )
        ],
    }
    text = physinone("show", INDEX).out
    for part in ("height", "0.5", "red, green", "fallen", "s = g t²/2", "1e-06", "nothing known"):
        assert part in text


@pytest.mark.parametrize("entry", entries(), ids=lambda e: e.label)
def test_show_shows_every_phenomenon(entry: Any, physinone: Any) -> None:
    assert physinone("show", entry.index).code == 0
    assert physinone("show", entry.label, "--json").values()["index"] == entry.index


def test_check(physinone: Any) -> None:
    told = physinone("check", INDEX, "--fidelity", "draft", "--set", "height=0.7", "--json")
    assert told.code == 0
    assert told.err == ""
    records = told.values()
    keys = {"index", "label", "law", "equation", "fidelity", "measured", "expected", "error", "tolerance", "passed"}
    assert all(keys <= set(record) for record in records)
    assert [record["law"] for record in records] == LAWS
    assert {record["fidelity"] for record in records} == {"draft"}
    other = physinone("check", INDEX, "--fidelity", "draft", "--json").values()
    assert other[1]["expected"] != records[1]["expected"]
    text = physinone("check", INDEX)
    assert text.code == 0
    assert all(name in text.out for name in LAWS)
    assert "nothing known" in text.out


def test_check_writes_a_report(physinone: Any, tmp_path: Path) -> None:
    page = tmp_path / "laws.md"
    assert physinone("check", INDEX, "--fidelity", "draft", "--report", page).code == 0
    text = page.read_text(encoding="utf-8")
    assert f"{len(LAWS)} of {len(LAWS)} laws passed" in text
    assert all(f"| {name.replace('_', ' ')} |" in text for name in LAWS)
    assert "Cost: " in text
    nowhere = physinone("check", INDEX, "--report", tmp_path / "absent" / "laws.md")
    assert nowhere.code == 2
    assert "absent" in nowhere.err
    assert nowhere.err.count("\n") == 1


def test_check_of_several_keeps_the_order(physinone: Any) -> None:
    several = ["SimplePendulum", "VerticalFall"]
    said = physinone("check", *several, "--fidelity", "draft", "--json")
    assert said.code == 0, said
    assert list(dict.fromkeys(record["label"] for record in said.values())) == several


def test_not_evaluated_is_neither_passed_nor_failed(physinone: Any) -> None:
    said = physinone("check", INDEX, "--set", "colour=green", "--json")
    assert said.code == 0
    law = said.values()[1]
    assert (law["passed"], law["verdict"], law["measured"]) == (None, "not evaluated", None)
    said = physinone("check", INDEX, "--set", "colour=green")
    assert said.code == 0
    assert "1 passed, 0 failed, 1 not evaluated" in said.out
    assert "the ball is green" in said.out


def test_processes_end_with_what_asked_for_them() -> None:
    tasks: list[Any] = [(10, {}, DRAFT), (10, {"height": 1.0}, DRAFT), (10, {"height": 0.5}, DRAFT)]
    judgements = spread(judge, tasks, ["one", "two", "three"])
    _, (records, line) = next(judgements)
    assert line is None
    assert {record["label"] for record in records} == {"VerticalFall"}
    judgements.close()
    assert multiprocessing.active_children() == []


def test_a_process_that_is_killed_is_one_line(physinone: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(*_: Any) -> Any:
        raise BrokenProcessPool("terminated abruptly")

    monkeypatch.setattr(checks.ProcessPoolExecutor, "submit", killed)
    refused(physinone("check", "10", "46"), "was killed")


def test_indices_labels_and_ranges() -> None:
    everything = [entry.index for entry in registry.entries()]
    assert [e.index for e in chosen(["46"])] == [46]
    assert [e.index for e in chosen(["SimplePendulum", "46"])] == [46]
    assert [e.index for e in chosen(["1-999"])] == everything
    assert [e.index for e in chosen(["46 1-999"])] == [46, *(i for i in everything if i != 46)]
    assert [e.index for e in chosen(["46,46", "46"])] == [46]


def test_settings(toy: type[Phenomenon]) -> None:
    told = settings(["height=0.7", "colour=green", " mass = 1e0"], toy)
    assert told == {"height": 0.7, "colour": "green", "mass": 1.0}
    assert isinstance(settings(["mass=2"], toy)["mass"], int)
    assert settings([], toy) == {}


def test_run_says_what_it_made(physinone: Any, tmp_path: Path) -> None:
    said = physinone("run", INDEX, *QUICK, "-o", tmp_path)
    assert said.code == 0
    assert said.out.splitlines()[-1] == str(scene_in(tmp_path))
    assert all(name in said.out for name in LAWS)


def test_run_json(physinone: Any, tmp_path: Path) -> None:
    (scene,) = physinone("run", INDEX, *QUICK, "-o", tmp_path, "--json").values()
    assert set(scene) == {"index", "label", "folder", "laws"}
    assert scene["folder"] == str(scene_in(tmp_path))
    assert [law["law"] for law in scene["laws"]] == LAWS


def test_samples_follow_from_the_seed(physinone: Any, tmp_path: Path) -> None:
    def parameters(name: str, *arguments: object) -> Any:
        out = tmp_path / name
        assert physinone("run", INDEX, *QUICK, "--sample", *arguments, "-o", out).code == 0
        return json.loads((scene_in(out) / "provenance.json").read_text())["job"]["parameters"]

    fixed = ("--set", "height=0.7", "--set", "colour=red")
    one = parameters("one", "--seed", 5, *fixed)
    assert one["height"] == 0.7
    assert one["mass"] != phenomenon(INDEX).make().values()["mass"]
    assert parameters("again", "--seed", 5, *fixed) == one
    assert parameters("other", "--seed", 6, *fixed) != one


def test_verify_and_reproduce(physinone: Any, scenes: Path) -> None:
    scene = scene_in(scenes)
    for command in ("verify", "reproduce"):
        assert physinone(command, scene).code == 0
        told = physinone(command, scene, "--json").values()
        assert set(told) == {"folder", "ok", "problems", "laws"}
        assert told["ok"] is True
        assert told["problems"] == []
    assert [law["law"] for law in physinone("verify", scene, "--json").values()["laws"]] == LAWS


def test_a_damaged_scene_is_exit_code_1(physinone: Any, scenes: Path, tmp_path: Path) -> None:
    scene = tmp_path / scene_in(scenes).name
    shutil.copytree(scene_in(scenes), scene)
    (scene / "caption.txt").write_text("something else\n")
    said = physinone("verify", scene)
    assert said.code == 1
    assert "caption.txt" in said.out
    provenance = json.loads((scene / "provenance.json").read_text())
    provenance["job"]["parameters"]["height"] = 1.1
    (scene / "provenance.json").write_text(json.dumps(provenance))
    said = physinone("reproduce", scene, "--json")
    assert said.code == 1
    assert said.values()["ok"] is False
    assert said.values()["problems"]


def test_doctor(physinone: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from physinone_mj import doctor
    from physinone_mj.doctor import Finding

    findings = [Finding("Python", True, "3.11.7"), Finding("disk", True, "0.5 GiB", "tidy up")]
    monkeypatch.setattr(doctor, "examine", lambda: findings)
    assert physinone("doctor").code == 0
    findings.append(Finding("OpenGL context", False, "none", "sudo apt-get install -y libegl1"))
    said = physinone("doctor")
    assert said.code == 1
    assert "sudo apt-get install -y libegl1" in said.out
    told = physinone("doctor", "--json").values()
    assert told[2] == {"name": "OpenGL context", "ok": False, "value": "none", "fix": "sudo apt-get install -y libegl1"}


def test_help_and_version(physinone: Any) -> None:
    for arguments in ((), ("--help",), ("run", "--help")):
        said = physinone(*arguments)
        assert said.code == 0
        assert "Usage" in said.out
    assert physinone("--version").out == f"physinone {physinone_mj.__version__}\n"


def test_stopped_by_hand(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "physinone_mj", "run", "46", "--no-render", "--fidelity", "reference"]
    started = subprocess.Popen(
        [*command, "-o", str(tmp_path)], cwd=HOME, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with contextlib.closing(started.stdout), contextlib.closing(started.stderr):  # type: ignore[type-var]
        while started.poll() is None and not list(tmp_path.iterdir()):
            time.sleep(0.01)
        started.send_signal(signal.SIGINT)
        out, err = started.communicate()
    assert started.returncode == 130
    assert out == ""
    assert err == "physinone: stopped\n"
    assert list(tmp_path.iterdir()) == []


def test_whoever_reads_may_stop_reading() -> None:
    line = f"{sys.executable} -m physinone_mj show 46 | head -n 1; exit ${{PIPESTATUS[1]}}"
    done = subprocess.run(["bash", "-c", line], cwd=HOME, capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_progress_without_a_terminal(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    monkeypatch.setattr(terminal, "time", types.SimpleNamespace(monotonic=lambda: now[0]))
    with terminal.Progress("46 SimplePendulum") as progress:
        for step in range(101):
            now[0] = step / 5
            progress("simulating", step / 100)
    out, err = capfd.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "simulating: 25%, 15 s left",
        "simulating: 50%, 10 s left",
        "simulating: 75%, 5 s left",
        "simulating: 100%, 0 s left",
    ]


def test_progress_on_a_terminal_leaves_nothing(tmp_path: Path) -> None:
    import pty

    master, slave = pty.openpty()
    command = [sys.executable, "-m", "physinone_mj", "check", "10", "--fidelity", "draft", "--json"]
    with subprocess.Popen(command, cwd=HOME, stdout=subprocess.PIPE, stderr=slave, text=True) as started:
        os.close(slave)
        seen = b""
        with contextlib.suppress(OSError):  # Linux: the terminal's other end is closed
            while block := os.read(master, 4096):
                seen += block
        out = started.communicate()[0]
    os.close(master)
    assert "10 VerticalFall" in seen.decode()
    assert json.loads(out)[0]["index"] == 10


def test_public_names() -> None:
    for name in physinone_mj.__all__:
        assert getattr(physinone_mj, name) is not None
    assert set(physinone_mj.__all__) <= set(dir(physinone_mj))
    with pytest.raises(AttributeError, match="no_such_name"):
        physinone_mj.no_such_name  # noqa: B018


def run_python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], cwd=HOME, capture_output=True, text=True, check=True).stdout


def test_the_module_simulate_does_not_hide_the_function() -> None:
    assert run_python("import physinone_mj.simulate; print(callable(physinone_mj.simulate))").strip() == "True"
    assert run_python("from physinone_mj import simulate; print(simulate.__name__)").strip() == "simulate"


def test_importing_loads_nothing() -> None:
    heavy = "{'numpy', 'mujoco', 'taichi', 'OpenGL', 'dm_control', 'phenomena', 'typer', 'rich'}"
    assert run_python(f"import sys, physinone_mj; print(*{heavy} & set(sys.modules))").strip() == ""


def test_listing_loads_no_engine() -> None:
    code = (
        "import sys; from physinone_mj.__main__ import main; main(['list', '--json']); main(['--help']);"
        "loaded = {name.partition('.')[0] for name in sys.modules};"
        "print('loaded:', *loaded & {'mujoco', 'scipy', 'numba', 'h5py', 'taichi', 'OpenGL', 'dm_control'})"
    )
    assert run_python(code).splitlines()[-1].strip() == "loaded:"
