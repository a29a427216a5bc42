"""What exact contact costs beside MuJoCo's own steps, per simulated second: `python -m` this.

One row per scene, one column per way to step it; all ways of a scene take turns in one run, and every figure is the
median over the turns of its time over that of the plain step in the same turn, so that a busy machine slows all alike;
times are the processor's. A dash: it makes no sense there.

plain       `mj_step`, step 2 ms, Euler, contact parameters and solver options as MuJoCo has them by default: 1
ours        `simulate.Stepper` at DRAFT, at the step that the scene asks for (64 per `resolve(time=...)`)
no contact  plain, contact switched off: what a scene where nothing touches may do
RK4         plain, Runge-Kutta
stiff       plain, elliptic cone, solref two steps, solimp 0.9999: the best that parameters alone do
sleep       plain, MuJoCo's sleeping islands: what rests costs little, and rests where it has sagged to
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from typing import Annotated, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from physinone_mj.base import Param, Phenomenon
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT, Fidelity
from physinone_mj.registry import phenomenon
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import Compiled, Stepper, build
from physinone_mj.simulate import compile as compile_scene

PLAIN_STEP: Final = 0.002
"""MuJoCo's default [s]."""

TURNS: Final = 5
GAP: Final = 1e-4
ROUGH: Final = Surface(friction=0.6)


def loose(scene: Scene, kind: str, name: str, size: ArrayLike, place: ArrayLike, turn: ArrayLike = (1, 0, 0, 0),
          velocity: ArrayLike = (0, 0, 0, 0, 0, 0)) -> str:  # fmt: skip
    """One free ball or brick; the name of its body."""
    part = scene.add("ball" if kind == "ball" else "brick", name)
    geom = part.geom(kind)
    geom.size[:], geom.mass = np.broadcast_to(size, 3), 0.5
    scene.start[part.name("free")] = free_pose(place, turn)
    scene.speed[part.name("free")] = velocity
    scene.material(part.name(kind), 700.0, ROUGH)
    return part.name(kind)


class Bench(Phenomenon, domain="mechanics"):
    """Bodies of one kind over the floor."""

    def build(self, scene: Scene) -> None:
        scene.material("stage/floor", 2000.0, ROUGH)
        scene.resolve(time=0.2, length=0.05, duration=4.0)

    def caption(self, run: Run) -> str:
        return ""


class Flying(Bench, domain="mechanics"):
    """One free body that meets nothing."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        loose(scene, "block", "b0", 0.05, (0, 0, 1), velocity=(1, 0, 5, 1, 2, 3))


class Eight(Bench, domain="mechanics"):
    """Up to eight balls or blocks, at rest or thrown at each other."""

    kind: Annotated[int, Param("1", 0, 1, "balls or blocks")] = 0
    count: Annotated[int, Param("1", 1, 8, "how many")] = 8
    thrown: Annotated[int, Param("1", 0, 1, "at rest or thrown")] = 0

    def build(self, scene: Scene) -> None:
        super().build(scene)
        rng = np.random.default_rng(2)
        names = ["stage/floor"]
        for i in range(self.count):
            place = np.array([0.25 * (i % 2), 0.25 * (i // 2 % 2), 0.05])
            turn, velocity = np.array([1.0, 0, 0, 0]), np.zeros(6)
            if self.thrown:
                place[2] += 0.2 + 0.25 * (i // 4)
                turn = rng.normal(size=4)
                velocity[:3] = 4 * (np.array([0.125, 0.125, 0.3]) - place)
                velocity[3:] = rng.normal(size=3) * 5
            else:
                place[0] += 0.5 * (i // 4)
            turn /= np.linalg.norm(turn)
            kind = "block" if self.kind else "ball"
            names.append(loose(scene, kind, f"b{i}", 0.05, place, turn, velocity))
        scene.touch(*names)


class Bricks(Bench, domain="mechanics"):
    """Ten courses of running bond: 105 bricks, the odd courses with half a brick at either end."""

    def build(self, scene: Scene) -> None:
        super().build(scene)
        half = np.array([0.1, 0.05, 0.04])
        names = ["stage/floor"]
        pitch = 2 * half[0] + GAP
        for row in range(10):
            widths = [0.5, *[1.0] * 9, 0.5] if row % 2 else [1.0] * 10
            left = -5 * pitch
            for column, width in enumerate(widths):
                room = width * pitch
                place = (left + room / 2, 0.0, half[2] * (2 * row + 1))
                size = half - [(2 * half[0] + GAP - room) / 2, 0, 0] if width < 1 else half
                names.append(loose(scene, "block", f"row{row}_{column}", size, place))
                left += room
        scene.touch(*names)
        scene.resolve(time=2 * math.sqrt(2 * half[2] / scene.gravity), length=half[2], duration=3.0)


def compiled(specimen: Phenomenon, fidelity: Fidelity) -> Compiled:
    """The specimen ready to be stepped."""
    return compile_scene(specimen, build(specimen), fidelity)


def plain(ready: Compiled) -> Any:
    """A model of the same bodies with MuJoCo's own options and contact parameters, apart from gravity."""
    spec = ready.scene.spec.copy()
    spec.option = mujoco.MjSpec().option
    spec.option.gravity = (0.0, 0.0, -ready.scene.gravity)
    bare = mujoco.MjSpec()
    default = bare.add_pair(name="default", geomname1="a", geomname2="b")
    for pair in spec.pairs:
        pair.solref, pair.solimp = default.solref, default.solimp
        pair.solreffriction = default.solreffriction
    model = spec.compile()
    assert model.opt.timestep == PLAIN_STEP
    return model


def no_contact(model: Any) -> None:
    """Nothing touches."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT


def runge_kutta(model: Any) -> None:
    """Four evaluations in a step."""
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4


def stiff(model: Any) -> None:
    """As stiff as MuJoCo's parameters go."""
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.pair_solimp[:] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    model.pair_solref[:] = (2 * PLAIN_STEP, 1.0)


def sleeping(model: Any) -> None:
    """What rests is not computed."""
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP


WAYS: Final[dict[str, Callable[[Any], None]]] = {
    "plain": lambda model: None, "no contact": no_contact, "RK4": runge_kutta, "stiff": stiff, "sleep": sleeping,
}  # fmt: skip


def spent(run: Callable[[], None]) -> float:
    """Seconds of the processor."""
    begun = time.thread_time()
    run()
    return time.thread_time() - begun


def costs(specimen: Phenomenon, duration: float, ways: tuple[str, ...], turns: int) -> tuple[dict[str, float], float]:
    """Medians over the turns: (time of each way over that of the plain step; milliseconds of the plain step per
    simulated second)."""
    ready = compiled(specimen, DRAFT)
    with Stepper(ready) as first:
        start, speed = first.data.qpos.copy(), first.data.qvel.copy()
        first.advance()  # numba compiles
    models = {}
    for way in ways:
        models[way] = plain(ready)
        WAYS[way](models[way])

    def ours() -> None:
        with Stepper(ready) as stepper:
            while stepper.data.time < duration:
                stepper.advance()

    def theirs(model: Any) -> None:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start, speed
        for _ in range(round(duration / PLAIN_STEP)):
            mujoco.mj_step(model, data)

    ratios: dict[str, list[float]] = {way: [] for way in ("ours", *ways)}
    base = []
    for _ in range(turns):
        times = {way: spent(lambda model=model: theirs(model)) for way, model in models.items()}  # type: ignore[misc]
        times["ours"] = spent(ours)
        base.append(times["plain"])
        for way, value in times.items():
            ratios[way].append(value / times["plain"])
    return {way: statistics.median(values) for way, values in ratios.items()}, statistics.median(base) / duration * 1e3


def main() -> None:
    """Print the table."""
    free, touching = ("plain", "no contact", "RK4"), ("plain", "no contact", "RK4", "stiff", "sleep")
    moving = ("plain", "no contact", "RK4", "stiff")
    rows: list[tuple[str, Phenomenon, float, tuple[str, ...], int]] = [
        ("free body", Flying.make(), 4.0, free, TURNS),
        ("resting box", Eight.make(kind=1, count=1), 4.0, touching, TURNS),
        ("pendulum", phenomenon(46).make(), 4.0, free, TURNS),
        ("8 spheres on a plane", Eight.make(kind=0), 4.0, touching, TURNS),
        ("8 boxes resting", Eight.make(kind=1), 4.0, touching, TURNS),
        ("8 boxes tumbling", Eight.make(kind=1, thrown=1), 1.0, moving, TURNS),
        ("105 bricks at rest", Bricks.make(), 3.0, ("plain", "stiff", "sleep"), 3),
    ]
    columns = ("plain", "ours", "no contact", "RK4", "stiff", "sleep")
    print(f"{'per simulated second':24}" + "".join(f"{c:>12}" for c in columns) + f"{'plain [ms/s]':>14}")
    for name, specimen, duration, ways, turns in rows:
        ratio, plain_cost = costs(specimen, duration, ways, turns)
        cells = (f"{ratio[c]:12.2f}" if c in ratio else f"{'-':>12}" for c in columns)
        print(f"{name:24}" + "".join(cells) + f"{plain_cost:14.1f}", flush=True)


if __name__ == "__main__":
    main()
