"""What stepping through `simulate.Stepper` costs beside a bare `mj_step` loop on the same model: `python -m` this.

Both advance the same number of steps of the same model in the same run, taking turns; the ratio is the median over the
turns, so that a busy machine slows both alike; times are the processor's. Targets: 1.05 without effects, 2 with wind on
ten free bodies.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import mujoco

from physinone_mj.base import Phenomenon
from physinone_mj.contact import Surface
from physinone_mj.effects import Box, Magnet, Magnets, Wind
from physinone_mj.fidelity import STANDARD
from physinone_mj.registry import phenomenon
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import Stepper, build
from physinone_mj.simulate import compile as compile_scene

TURNS, SAMPLES = 11, 480


class TenInTheWind(Phenomenon, domain="mechanics"):
    """Ten free balls in one wind."""

    def build(self, scene: Scene) -> None:
        balls = [scene.add("ball", f"ball{i}") for i in range(10)]
        for i, ball in enumerate(balls):
            scene.start[ball.name("free")] = free_pose((0.1 * i, 0.0, 0.5))
        box = Box((-1.0, 0.0, 0.5), (1.0, 0.0, 0.0), 50.0, 10.0, 1000.0)
        scene.effects.append(Wind(box, 1.0, tuple(ball.name("ball") for ball in balls)))
        scene.resolve(time=0.2, length=0.1, duration=2.0)

    def caption(self, run: Run) -> str:
        return ""


class FiveMagnets(TenInTheWind, domain="magnetism"):
    """Five free magnets: forty pairs of poles."""

    def build(self, scene: Scene) -> None:
        names = []
        for i in range(5):
            ball = scene.add("ball", f"ball{i}")
            scene.start[ball.name("free")] = free_pose((0.4 * i, 0.0, 0.5))
            names.append([ball.body("ball").add_site(name=ball.name(pole), pos=(x, 0, 0)).name
                          for pole, x in (("north", 0.03), ("south", -0.03))])  # fmt: skip
        scene.effects.append(Magnets(tuple(Magnet(n, s, 1e-3) for n, s in names), 0.01))
        scene.resolve(time=0.2, length=0.1, duration=2.0)


class BlockAndBall(TenInTheWind, domain="mechanics"):
    """A ball that rolls and a block that slides to rest on the floor."""

    def build(self, scene: Scene) -> None:
        ball, block = scene.add("ball"), scene.add("ball", "block")
        shape = block.geom("ball")
        shape.type, shape.size = mujoco.mjtGeom.mjGEOM_BOX, (0.05, 0.05, 0.05)
        scene.material("stage/floor", 2000.0, Surface(friction=0.4))
        for part, y in ((ball, 0.0), (block, 0.5)):
            scene.material(part.name("ball"), 1000.0, Surface(friction=0.4))
            scene.touch(part.name("ball"), "stage/floor")
            scene.start[part.name("free")] = free_pose((0.0, y, 0.05))
            scene.speed[part.name("free")] = (2.0, 0, 0, 0, 0, 0)
        scene.resolve(time=0.2, length=0.1, duration=2.0)


def turns(specimen: Phenomenon) -> tuple[float, float, float]:
    """Medians: (stepper / loop of mj_step, stepper / one mj_step of many steps, microseconds per step of the loop)."""
    compiled = compile_scene(specimen, build(specimen), STANDARD)
    model, count = compiled.model, SAMPLES * compiled.steps

    def loop(data: Any) -> None:
        for _ in range(count):
            mujoco.mj_step(model, data)

    def clocked(run: Callable[[], None]) -> float:
        begun = time.thread_time()
        run()
        return time.thread_time() - begun

    def stepped(stepper: Stepper) -> None:
        for i in range(SAMPLES):
            stepper.advance()
            if i % compiled.stride == 0:
                stepper.inspect()

    over_loop, over_batch, each = [], [], []
    for turn in range(TURNS + 1):
        bare, batch = (Stepper(compiled).data for _ in range(2))
        with Stepper(compiled) as stepper:
            ours = clocked(lambda stepper=stepper: stepped(stepper))  # type: ignore[misc]
        plain = clocked(lambda data=bare: loop(data))  # type: ignore[misc]
        together = clocked(lambda data=batch: mujoco.mj_step(model, data, nstep=count))  # type: ignore[misc]
        if turn:  # the first turn compiles
            over_loop.append(ours / plain)
            over_batch.append(ours / together)
            each.append(plain / count)
    return statistics.median(over_loop), statistics.median(over_batch), 1e6 * statistics.median(each)


def main() -> None:
    """Print the table."""
    rows: list[tuple[str, Phenomenon, str]] = [
        ("pendulum", phenomenon(46).make(), "<= 1.05"),
        ("10 free bodies, wind", TenInTheWind.make(), "<= 2"),
        ("5 free magnets", FiveMagnets.make(), ""),
        ("ball and block, contact", BlockAndBall.make(), ""),
    ]
    print(f"{'scene':26}{'x mj_step loop':>16}{'x mj_step(nstep)':>18}{'target':>10}{'mj_step [us]':>14}")
    for name, specimen, target in rows:
        loop, batch, each = turns(specimen)
        print(f"{name:26}{loop:16.2f}{batch:18.2f}{target:>10}{each:14.1f}")


if __name__ == "__main__":
    main()
