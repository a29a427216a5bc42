"""Scene folders that are whole or absent, and whose every change is found."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from physinone_mj.base import ParameterError
from physinone_mj.dataset import (
    Job,
    NotAScene,
    Report,
    SceneExists,
    generate,
    read_run,
    reproduce,
    state_digest,
    verify,
)
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.scene import Scene

SECONDS = 13 / 30
INDEX = 10
PARAMETERS: dict[str, float | int | str] = {"height": 0.2, "restitution": 0.2, "count": 2}
"""Balls that come to rest before that."""

FRAMES = round(30 * SECONDS)


def job(*, render: bool = False, seed: int = 0, **parameters: float | int | str) -> Job:
    return Job(INDEX, PARAMETERS | parameters, DRAFT, seed=seed, views=1, size=24, render=render)


@pytest.fixture(scope="module", autouse=True)
def _short() -> Iterator[None]:
    whole = Scene.resolve

    def resolve(self: Scene, *, time: float, length: float, duration: float) -> None:
        whole(self, time=time, length=length, duration=min(duration, SECONDS))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Scene, "resolve", resolve)
        yield


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene without pictures; not to be changed."""
    return generate(job(), tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A scene with pictures, not to be changed, and what was there when an earlier process was killed half-way."""
    out = tmp_path_factory.mktemp("filmed")
    process = program(out, render=True)
    wait_for(process, "rendering", 0.4)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    (left,) = out.iterdir()
    assert left.name.startswith(f".{job(render=True).folder}.partial-")
    before = contents(left)
    # at once, although drawing processes may still be about to notice
    return generate(job(render=True), out), before


def contents(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def copy(folder: Path, to: Path) -> Path:
    return Path(shutil.copytree(folder, to / folder.name))


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = folder / "provenance.json"
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))


def sealed(folder: Path) -> Path:
    """With the checksums that its files have now."""
    found = contents(folder)
    del found["provenance.json"]
    edit(folder, lambda told: told.update(files=found))
    return folder


def told(report: Report) -> str:
    assert not report.ok
    assert all("\n" not in problem for problem in report.problems)
    return "\n".join(report.problems)


# --- generate --------------------------------------------------------------------------------------------------------


def test_a_scene_is_whole(plain: Path, filmed: tuple[Path, dict[str, str]]) -> None:
    for folder in (plain, filmed[0]):
        report = verify(folder)
        assert report.problems == []
        assert {v.verdict for v in report.verdicts} == {"passed"}
        assert report.ok
        assert [path.name for path in folder.parent.iterdir()] == [folder.name], "nothing else stays behind"


def test_an_existing_scene_is_kept_and_force_replaces_it(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    (folder / "caption.txt").write_text("edited\n")
    before = contents(folder)
    with pytest.raises(SceneExists, match=folder.name):
        generate(job(), tmp_path)
    assert contents(folder) == before
    assert generate(job(), tmp_path, force=True) == folder
    assert verify(folder).ok
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


def test_what_cannot_be_finished_leaves_the_old_scene(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    before = contents(folder)

    def stop(stage: str, _done: float) -> None:
        if stage == "sealing":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate(job(), tmp_path, force=True, progress=stop)
    assert contents(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


def test_the_same_job_gives_the_same_bytes(plain: Path, tmp_path: Path) -> None:
    again = generate(job(), tmp_path)
    one, other = contents(plain), contents(again)
    assert {name for name in one if one[name] != other.get(name)} <= {"provenance.json"}
    assert one.keys() == other.keys()
    notes = [json.loads((folder / "provenance.json").read_text()) for folder in (plain, again)]
    assert len({tuple(note.pop("seconds")) for note in notes}) == 1
    assert notes[0] == notes[1]


def test_the_same_job_draws_the_same_pictures(filmed: tuple[Path, dict[str, str]]) -> None:
    folder, before = filmed
    after = contents(folder)
    drawn = [name for name in before if name.startswith("CineCamera")]
    same = [name for name in drawn if before[name] == after[name]]
    assert len(same) > 6
    assert len(drawn) - len(same) <= 4, "those that were being written when the process was killed"


def test_another_seed_moves_the_cameras_only(
    filmed: tuple[Path, dict[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from render import film

    monkeypatch.setattr(film, "shoot", lambda *_, **__: {})
    other = generate(job(render=True, seed=1), tmp_path)
    assert other.name != filmed[0].name
    first, second = contents(filmed[0]), contents(other)
    for name in ("physics.h5", "laws.json", "properties.json", "caption.txt", "scene.xml"):
        assert first[name] == second[name]
    for name in ("blender_CineCamera_0.json", "blender_CineCamera_Moving.json", "cameras.ply"):
        assert first[name] != second[name]
    digests = [json.loads((folder / "provenance.json").read_text())["state_sha256"] for folder in (filmed[0], other)]
    assert digests[0] == digests[1]


def test_the_name_follows_from_everything_in_the_job() -> None:
    jobs = [
        job(), job(seed=1), job(render=True), job(height=0.21), Job(INDEX, PARAMETERS, DRAFT, views=2, size=24),
        Job(INDEX, PARAMETERS, DRAFT, views=1, size=32), Job(INDEX, PARAMETERS, Fidelity("draft", 65, 8, 4)),
        Job(INDEX, PARAMETERS, DRAFT, views=1, size=24, modalities=("rgb",)),
    ]  # fmt: skip
    assert len({j.folder for j in jobs}) == len(jobs)
    assert job().folder == job(height=0.2).folder
    assert job(radius=0.1).folder == job().folder, "what is not set has its nominal value"


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"views": 0}, "views = 0"),
        ({"views": 2.5}, "views = 2.5"),
        ({"size": 5000}, "size = 5000"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": "x"}, "seed = 'x'"),
        ({"modalities": ()}, "modalities"),
        ({"modalities": ("rgb", "sound")}, "sound"),
        ({"parameters": {"height": 99.0}}, "height"),
        ({"parameters": {"hieght": 1.0}}, "did you mean height"),
    ],
)
def test_an_impossible_job_is_refused_before_any_work(given: dict[str, Any], error: str) -> None:
    values: dict[str, Any] = {"index": INDEX, "parameters": {}, "fidelity": DRAFT} | given
    with pytest.raises(ParameterError if "parameters" in given else ValueError, match=error):
        Job(**values)


def test_an_output_below_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "deeper"):
        with pytest.raises(OSError, match="file"):
            generate(job(), out)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# --- processes that end half-way -------------------------------------------------------------------------------------

PROGRAM = """
    import sys
    from pathlib import Path
    from physinone_mj.dataset import Job, generate
    from physinone_mj.fidelity import DRAFT
    from physinone_mj.scene import Scene

    whole = Scene.resolve
    Scene.resolve = lambda self, *, time, length, duration: whole(
        self, time=time, length=length, duration=min(duration, {seconds})
    )
    {setup}
    generate(
        Job({index}, {parameters}, DRAFT, views=1, size=24, render={render}), Path({out!r}), force={force},
        progress=lambda stage, done: print(stage, done, flush=True),
    )
"""


def program(out: Path, *, render: bool = False, force: bool = False, setup: str = "") -> subprocess.Popen[str]:
    text = textwrap.dedent(PROGRAM).format(
        seconds=SECONDS, setup=setup, index=INDEX, parameters=PARAMETERS, out=str(out), render=render, force=force
    )
    return subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(process: subprocess.Popen[str], stage: str, past: float = 0.0) -> None:
    assert process.stdout
    for line in process.stdout:
        name, _, done = line.strip().rpartition(" ")
        if name == stage and float(done) >= past:
            return
    raise AssertionError(process.communicate()[1])


@pytest.mark.parametrize("stage", ["simulating", "sealing"])
def test_killed_half_way(stage: str, plain: Path, tmp_path: Path) -> None:
    """While rendering: see `filmed`."""
    process = program(tmp_path)
    wait_for(process, stage)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(f".{job().folder}.partial-")
    folder = generate(job(), tmp_path)
    assert verify(folder).ok
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


@pytest.mark.parametrize(
    ("number", "stage", "render"),
    [
        (signal.SIGTERM, "rendering", True),
        (signal.SIGTERM, "checking the laws", False),
        (signal.SIGHUP, "simulating", False),
        (signal.SIGINT, "checking the laws", False),
    ],
)
def test_told_to_end_half_way(number: signal.Signals, stage: str, render: bool, tmp_path: Path) -> None:
    process = program(tmp_path, render=render)
    wait_for(process, stage)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == (-number if number == signal.SIGINT else 128 + number)
    assert list(tmp_path.iterdir()) == []


def test_the_work_of_a_live_process_is_left_alone(plain: Path, tmp_path: Path) -> None:
    name = job().folder
    sleeper = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        live = tmp_path / f".{name}.partial-{sleeper.pid}"
        live.mkdir()
        (live / "physics.h5").write_text("half")
        others = tmp_path / ".Other__bg000__ABCDEF_trajectory.partial-1"
        others.mkdir()
        folder = generate(job(), tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {live.name, others.name, folder.name}
        assert (live / "physics.h5").read_text() == "half"
    finally:
        sleeper.communicate(b"\n")
    generate(job(), tmp_path, force=True)
    assert {path.name for path in tmp_path.iterdir()} == {others.name, folder.name}


def test_a_scene_whose_replacement_was_interrupted_comes_back(plain: Path, tmp_path: Path) -> None:
    """Killed between setting the old folder aside and giving the new one its name."""
    folder = copy(plain, tmp_path)
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    folder.rename(tmp_path / f".{folder.name}.replaced-{int(gone.stdout)}")
    with pytest.raises(SceneExists):
        generate(job(), tmp_path)
    assert verify(folder).ok
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


def test_another_process_was_quicker(plain: Path, tmp_path: Path) -> None:
    def meanwhile(stage: str, _done: float) -> None:
        if stage == "sealing":
            copy(plain, tmp_path)

    with pytest.raises(SceneExists):
        generate(job(), tmp_path, progress=meanwhile)
    assert contents(tmp_path / plain.name) == contents(plain)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("room", [100, 3000, 20_000])
def test_no_room_on_the_disk(room: int, tmp_path: Path) -> None:
    """A limit on the size of a file stands for a full disk: the same call fails, with another number."""
    setup = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    process = program(tmp_path, setup=setup)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1, errors
    assert errors.strip().splitlines()[-1].startswith("OSError")
    assert list(tmp_path.iterdir()) == []


# --- verify ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_a_flipped_bit_is_found(plain: Path, tmp_path: Path, seed: int) -> None:
    folder = copy(plain, tmp_path)
    data = bytearray((folder / "physics.h5").read_bytes())
    rng = np.random.default_rng(seed)
    data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    (folder / "physics.h5").write_bytes(data)
    assert "physics.h5: its SHA-256" in told(verify(folder))


def test_a_broken_file_of_physics_is_found_without_checksums(plain: Path, tmp_path: Path) -> None:
    """Whatever bit is flipped, the answer is a report, or the recorded state is the same."""
    folder = copy(plain, tmp_path)
    whole = (folder / "physics.h5").read_bytes()
    rng = np.random.default_rng(7)
    for _ in range(12):
        data = bytearray(whole)
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        (folder / "physics.h5").write_bytes(data)
        report = verify(sealed(folder))
        if report.ok:
            assert state_digest(read_run(folder)[0]) == state_digest(read_run(plain)[0])
    for stump in (b"", whole[:1000], whole[: len(whole) // 2], os.urandom(1000)):
        (folder / "physics.h5").write_bytes(stump)
        assert "physics.h5" in told(verify(sealed(folder)))
        with pytest.raises(NotAScene, match=r"physics\.h5"):
            read_run(folder)


def test_missing_extra_and_truncated_files_are_found(filmed: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    folder = copy(filmed[0], tmp_path)
    image = folder / "CineCamera_0/rgb/0003.jpg"
    image.write_bytes(image.read_bytes()[:-100])
    (folder / "CineCamera_Moving/depth/0005.npz").unlink()
    (folder / "notes.txt").write_text("mine")
    found = told(verify(folder)).splitlines()
    assert found == [
        "CineCamera_Moving/depth/0005.npz: missing",
        "notes.txt: not in provenance.json",
        "CineCamera_0/rgb/0003.jpg: its SHA-256 is not the one in provenance.json",
        f"CineCamera_Moving/depth: {FRAMES - 1} of {FRAMES} frames",
    ]


def test_a_wrong_number_of_frames_is_found_without_checksums(
    filmed: tuple[Path, dict[str, str]], tmp_path: Path
) -> None:
    folder = copy(filmed[0], tmp_path)
    (folder / f"CineCamera_0/seg/{FRAMES - 1:04d}.npz").unlink()
    camera = json.loads((folder / "blender_CineCamera_Moving.json").read_text())
    camera["frames"].pop()
    (folder / "blender_CineCamera_Moving.json").write_text(json.dumps(camera))
    (folder / "static_camera_list.txt").write_text("CineCamera_0\n../../etc\n")
    (folder / "cameras.ply").unlink()
    assert told(verify(sealed(folder))).splitlines() == [
        "cameras.ply: missing",
        "static_camera_list.txt: 2 cameras; expected: CineCamera_0 to _0",
        f"CineCamera_0/seg: {FRAMES - 1} of {FRAMES} frames",
        f"blender_CineCamera_Moving.json: {FRAMES} frames, {FRAMES - 1} of them listed; expected: {FRAMES}",
    ]


def test_edited_laws_are_found(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    laws = json.loads((folder / "laws.json").read_text())
    laws[0]["verdict"] = "failed"
    (folder / "laws.json").write_text(json.dumps(laws))
    assert "laws.json: its SHA-256" in told(verify(folder))
    assert "judged anew: passed" in told(verify(sealed(folder)))


@pytest.mark.parametrize(
    "name",
    [
        "bodies/ball0/position", "bodies/ball1/linear_velocity", "bodies/ball0/quaternion",
        "bodies/ball0/angular_velocity", "energy/kinetic", "energy/potential", "observables/heights",
    ],
)  # fmt: skip
def test_what_does_not_follow_from_the_state_is_found(plain: Path, tmp_path: Path, name: str) -> None:
    folder = copy(plain, tmp_path)
    with h5py.File(folder / "physics.h5", "r+") as file:
        values = file[name][:]
        values[40] += 1e-4
        file[name][:] = values
    assert told(verify(sealed(folder))) == f"physics.h5: {name} does not follow from the recorded state"


def test_an_edited_state_is_found(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    with h5py.File(folder / "physics.h5", "r+") as file:
        values = file["state/qpos"][:]
        values[:, 2] *= 1.001
        file["state/qpos"][:] = values
    assert "the recorded state is not the one" in told(verify(sealed(folder)))
    # and if that checksum and the bodies are made to agree, the laws are broken
    digest = state_digest(read_run(folder)[0])
    edit(folder, lambda found: found.update(state_sha256=digest))
    report = verify(sealed(folder))
    assert "the recorded state is not" not in told(report)
    assert any(v.verdict == "failed" for v in report.verdicts)


def test_units_are_verified(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    with h5py.File(folder / "physics.h5", "r+") as file:
        del file["energy/kinetic"].attrs["unit"]
        file["energy/potential"].attrs["unit"] = "kJ"
        del file["bodies/ball0/quaternion"]
    assert set(told(verify(sealed(folder))).splitlines()) == {
        "physics.h5: energy/kinetic is not in J",
        "physics.h5: energy/potential is not in J",
        "physics.h5: bodies/ball0/quaternion is missing",
    }


def test_edited_annotations_are_found_without_checksums(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    path = folder / f"{folder.name}.json"
    motion = json.loads(path.read_text())
    motion["actors"]["ball0"]["transform_data"][3]["transform"]["location"]["z"] += 0.01
    path.write_text(json.dumps(motion))
    properties = json.loads((folder / "properties.json").read_text())
    properties["1"]["density"] *= 2
    (folder / "properties.json").write_text(json.dumps(properties))
    assert set(told(verify(sealed(folder))).splitlines()) == {
        f"{folder.name}.json: does not follow from the recorded state",
        "properties.json: not what the scene is made of",
    }


@pytest.mark.parametrize(
    "text", ["[]", "{}", "nonsense", '{"sequence_info": 3}', '{"sequence_info": {"total_frames": 1e99}}']
)
def test_garbled_annotations_are_reported(plain: Path, tmp_path: Path, text: str) -> None:
    folder = copy(plain, tmp_path)
    for name in (f"{folder.name}.json", "laws.json", "properties.json", "recorder_stats.json"):
        (folder / name).write_text(text)
    assert f"{folder.name}.json" in told(verify(sealed(folder)))


def test_a_folder_may_be_renamed_and_verified_from_within(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy(plain, tmp_path).rename(tmp_path / "mine")
    monkeypatch.chdir(folder)
    assert verify(folder).ok
    assert verify(Path()).ok


def test_an_edited_job_is_found(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    edit(folder, lambda found: found["job"].update(seed=5))
    assert told(verify(folder)).startswith(f"provenance.json: its job makes {job(seed=5).folder}, but this is")


def test_no_scene(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / "provenance.json")
    for name in ("absent", "file", "empty", "pipe"):
        for ask in (verify, read_run, reproduce):
            with pytest.raises(NotAScene, match="no provenance"):
                ask(tmp_path / name)


BAD: list[tuple[str, Callable[[dict[str, Any]], object], str]] = [
    ("format", lambda p: p.update(format=99), "format = 99; allowed: 1"),
    ("no format", lambda p: p.pop("format"), "format = None"),
    ("no job", lambda p: p.pop("job"), "incomplete"),
    ("a job that is a list", lambda p: p.update(job=[1, 2]), "incomplete"),
    ("half a job", lambda p: p["job"].pop("size"), "incomplete"),
    ("no files", lambda p: p.update(files=None), "incomplete"),
    ("index", lambda p: p["job"].update(index=9999), "no phenomenon 9999"),
    ("an index that is a list", lambda p: p["job"].update(index=[1]), "no phenomenon"),
    ("a parameter out of range", lambda p: p["job"]["parameters"].update(height=1e9), "height = 1000000000.0"),
    ("a parameter that is text", lambda p: p["job"]["parameters"].update(height="tall"), "is not a number"),
    ("an unknown parameter", lambda p: p["job"]["parameters"].update(hight=1), "no parameter 'hight'"),
    ("parameters that are a list", lambda p: p["job"].update(parameters=[1]), "provenance"),
    ("endless steps", lambda p: p["job"]["fidelity"].update(steps=float("inf")), "provenance"),
    ("many steps", lambda p: p["job"]["fidelity"].update(steps=10**15), "R10"),
    ("steps of text", lambda p: p["job"]["fidelity"].update(steps="many"), "provenance"),
    ("an unknown fidelity", lambda p: p["job"].update(fidelity={"quality": 3}), "provenance"),
    ("views", lambda p: p["job"].update(views=10**9), "views = 1000000000"),
    ("modalities", lambda p: p["job"].update(modalities=7), "provenance"),
    ("seed", lambda p: p["job"].update(seed="x"), "seed = 'x'"),
]


@pytest.mark.parametrize(("change", "message"), [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_garbled_provenance(
    plain: Path, tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    folder = tmp_path / plain.name
    folder.mkdir()
    for name in ("provenance.json", "physics.h5"):
        shutil.copy(plain / name, folder)
    edit(folder, change)
    for ask in (read_run, reproduce):
        with pytest.raises(NotAScene, match=message) as caught:
            ask(folder)
        assert "\n" not in str(caught.value)
    try:
        assert message in told(verify(folder))
    except NotAScene as why:
        assert message in str(why)  # noqa: PT017  either will do


@pytest.mark.parametrize(
    "text", ["", "no JSON", "[" * 100_000, "\xff", "3", "null", '{"format": ' + "9" * 10_000 + "}"]
)
def test_provenance_that_is_no_object(tmp_path: Path, text: str) -> None:
    (tmp_path / "provenance.json").write_bytes(text.encode("latin-1"))
    for ask in (verify, read_run, reproduce):
        with pytest.raises(NotAScene, match="provenance") as caught:
            ask(tmp_path)
        assert len(str(caught.value)) < 1000


def test_a_huge_provenance_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "provenance.json").open("wb") as file:
        file.truncate(100 << 20)
    with pytest.raises(NotAScene, match="104857600 bytes"):
        verify(tmp_path)


def test_no_file_outside_the_folder_is_followed(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    outside = tmp_path / "outside_trajectory.json"
    outside.write_bytes((folder / f"{folder.name}.json").read_bytes())
    digest = hashlib.sha256(outside.read_bytes()).hexdigest()
    names = ["../outside_trajectory.json", str(outside), "meshes/../../outside_trajectory.json"]
    edit(folder, lambda found: found["files"].update(dict.fromkeys(names, digest)))
    assert sorted(told(verify(folder)).splitlines()) == sorted(f"{name}: missing" for name in names)
    # nor through a link that stands for a file
    folder = copy(plain, tmp_path / "linked")
    (folder / "properties.json").rename(tmp_path / "properties.json")
    (folder / "properties.json").symlink_to(tmp_path / "properties.json")
    assert "properties.json: missing" in told(verify(folder))


# --- reproduce -------------------------------------------------------------------------------------------------------


def test_reproduced_bit_for_bit(plain: Path) -> None:
    seen: list[float] = []
    report = reproduce(plain, progress=lambda _stage, done: seen.append(done))
    assert report.ok
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_changed_parameter_is_not_reproduced(plain: Path, tmp_path: Path) -> None:
    folder = copy(plain, tmp_path)
    edit(folder, lambda found: found["job"]["parameters"].update(height=0.2000001))
    assert told(reproduce(folder)) == "the states differ from the recorded ones"
    edit(folder, lambda found: found["versions"].update(mujoco="0.1"))
    assert "made with other versions: mujoco 0.1 here" in told(reproduce(folder))


def test_a_run_is_read_as_it_was(plain: Path) -> None:
    run, provenance = read_run(plain)
    assert state_digest(run) == provenance["state_sha256"]
    assert len(run) == FRAMES * run.stride
    assert run.impacts
    assert all(v.passed for v in run.check())


def test_a_beam_that_was_moved_is_found_out(tmp_path: Path) -> None:
    folder = generate(Job(33, {}, DRAFT, views=1, size=24, render=False), tmp_path)
    assert not any("beams" in problem for problem in verify(folder).problems)
    with h5py.File(folder / "physics.h5", "r+") as file:
        file["beams/laser/points"][3, 1, 0] += 1e-3
    assert "beams/laser/points does not follow from the recorded state" in told(verify(sealed(folder)))
