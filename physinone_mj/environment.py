"""A phenomenon as a dm_control environment: the model, the stepper and the bytes of `simulate`, a frame at a time."""

from __future__ import annotations

import contextlib
import os
from collections import OrderedDict
from collections.abc import Iterator
from typing import Any, NoReturn

import mujoco
import numpy as np

from .base import Phenomenon
from .fidelity import STANDARD, Fidelity
from .registry import phenomenon
from .simulate import Compiled, Stepper, build, compile


@contextlib.contextmanager
def _windowless() -> Iterator[None]:
    # dm_control chooses its renderer when it is imported, and tries windows first: on a machine without any, it warns
    undecided = "MUJOCO_GL" not in os.environ
    if undecided:
        os.environ["MUJOCO_GL"] = "disable"
    try:
        yield
    finally:
        if undecided:
            del os.environ["MUJOCO_GL"]


with _windowless():
    from dm_control.mujoco import engine, wrapper
    from dm_control.mujoco.wrapper.mjbindings import sizes
    from dm_control.rl import control


def accept_mujoco(tables: dict[str, dict[str, Any]]) -> list[str]:
    """Strike from dm_control's size tables the arrays that this MuJoCo no longer has; returns their names.

    dm_control 1.0.50 lists those of MuJoCo 3.17 and fails on 4.0, where the flex vertices' lengths are gone. With
    versions that match, nothing is struck.
    """
    struck = []
    for struct, there in (("mjmodel", mujoco.MjModel), ("mjdata", mujoco.MjData)):
        for name in [name for name in tables.get(struct, {}) if not hasattr(there, name)]:
            del tables[struct][name]
            struck.append(name)
    return struck


accept_mujoco(getattr(sizes, "array_sizes", {}))


class Physics(engine.Physics):  # type: ignore[misc]
    """dm_control's view of a scene that our own stepper advances; one step is one recorded sample.

    `render` needs MUJOCO_GL=egl in the environment before the first `load`: without it no OpenGL is opened.
    """

    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        super().__init__(wrapper.MjData(wrapper.MjModel(compiled.model)))
        self.reset()

    def reset(self, keyframe_id: int | None = None) -> None:
        """Back to the scene's start, exactly; ValueError for a keyframe, of which scenes have none."""
        if keyframe_id is not None:
            raise ValueError(f"keyframe_id = {keyframe_id}; allowed: None, a scene starts in one way")
        mujoco.mj_resetData(self.model.ptr, self.data.ptr)
        self._stepper = Stepper(self.compiled, data=self.data.ptr)

    def after_reset(self) -> None:
        """Positions and velocities of everything, from the state; forces are the stepper's."""
        mujoco.mj_fwdPosition(self.model.ptr, self.data.ptr)
        mujoco.mj_fwdVelocity(self.model.ptr, self.data.ptr)

    def step(self, nstep: int = 1) -> None:
        """Advance by `nstep` recorded samples; UnstableScene if anything broke."""
        with self._stepper as stepper:
            for _ in range(nstep):
                stepper.advance()
            stepper.inspect()
            self.after_reset()

    def timestep(self) -> float:
        """Time between recorded samples [s]; the stepper's own steps are finer."""
        return self.compiled.steps * self.compiled.step

    def copy(self, share_model: bool = False) -> NoReturn:
        """Not to be had: contacts and media remember more than MjData holds."""
        raise NotImplementedError(f"{self.compiled.specimen.label}: a scene under way cannot be copied; load it twice")

    def __getstate__(self) -> NoReturn:
        self.copy()


class Watch(control.Task):  # type: ignore[misc]
    """Nothing to achieve: the scene goes its way, actuators (if it has any) do as told, and the video's last frame ends
    the episode."""

    def __init__(self, compiled: Compiled) -> None:
        self._end = (compiled.samples - compiled.stride) * compiled.steps * compiled.step
        self._own = np.zeros(compiled.model.nu)
        for name, value in compiled.scene.control.items():
            self._own[compiled.model.actuator(name).id] = value

    def initialize_episode(self, physics: Physics) -> None:
        """The scene starts as it was built: `Physics.reset` has done it."""

    def before_step(self, action: Any, physics: Physics) -> None:
        """Hand the action to the actuators, on top of what the scene itself asks of them."""
        physics.set_control(self._own + action)

    def action_spec(self, physics: Physics) -> Any:
        """One number per actuator, added to the scene's own; shape (0,) for a scene that has none."""
        return engine.action_spec(physics)

    def get_observation(self, physics: Physics) -> OrderedDict[str, Any]:
        """What can be seen, SI.

        time: (); position: (nq,) and velocity: (nv,) of the joints; bodies: (n, 3) centres of mass, as `Run.bodies`
        """
        return OrderedDict(
            time=np.array(physics.time()),
            position=physics.data.qpos.copy(),
            velocity=physics.data.qvel.copy(),
            bodies=physics.data.xipos[1:].copy(),
        )

    def get_reward(self, physics: Physics) -> float:  # noqa: ARG002
        """None is given: 0."""
        return 0.0

    def get_termination(self, physics: Physics) -> float | None:
        """1.0 (the world goes on, the watching ends) at the last frame."""
        return 1.0 if physics.time() > self._end - physics.timestep() / 2 else None


def load(
    which: int | str | type[Phenomenon], *, fidelity: Fidelity = STANDARD, seed: int = 0, **parameters: Any
) -> control.Environment:
    """The environment of a phenomenon, by index, label or class: a `dm_env.Environment`, one video frame per step.

    The arguments are those of `simulate`, and so are the states, to the bit.
    Raises LookupError (unknown index or label), ParameterError and Refusal.
    """
    del seed
    cls = which if isinstance(which, type) else phenomenon(which)
    specimen = cls.make(**parameters)
    compiled = compile(specimen, build(specimen), fidelity)
    return control.Environment(Physics(compiled), Watch(compiled), n_sub_steps=compiled.stride)
