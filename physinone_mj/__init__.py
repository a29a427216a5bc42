"""physinone_mj: from the index of a phenomenon to a verified, rendered, annotated scene.

    import physinone_mj as pm

    run = pm.simulate("SimplePendulum", length=0.7)
    run.position("pendulum/bob"), run.check()

Importing this loads nothing else: each name below brings its module when it is first used.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .base import Choice, Param, Phenomenon, Refusal, law, observable
    from .contact import Surface
    from .dataset import generate, reproduce, verify
    from .environment import load
    from .fidelity import DRAFT, REFERENCE, STANDARD, Fidelity
    from .registry import entries as phenomena
    from .registry import phenomenon
    from .run import Run
    from .scene import Scene
    from .simulate import UnstableScene, check, simulate

__version__ = "0.1.0"

__all__ = [
    "DRAFT",
    "REFERENCE",
    "STANDARD",
    "Choice",
    "Fidelity",
    "Param",
    "Phenomenon",
    "Refusal",
    "Run",
    "Scene",
    "Surface",
    "UnstableScene",
    "check",
    "generate",
    "law",
    "load",
    "observable",
    "phenomena",
    "phenomenon",
    "reproduce",
    "simulate",
    "verify",
]

_HOMES = {
    "base": ("Choice", "Param", "Phenomenon", "Refusal", "law", "observable"),
    "contact": ("Surface",),
    "dataset": ("generate", "reproduce", "verify"),
    "environment": ("load",),
    "fidelity": ("DRAFT", "REFERENCE", "STANDARD", "Fidelity"),
    "registry": ("phenomena", "phenomenon"),
    "run": ("Run",),
    "scene": ("Scene",),
    "simulate": ("UnstableScene", "check", "simulate"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for, and keep it."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = importlib.import_module(f".{_HOME_OF[name]}", __name__)
    value = home.entries if name == "phenomena" else getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    def __setattr__(self, name: str, value: object) -> None:
        # importing the module `simulate` would hide the function of that name
        public = isinstance(value, ModuleType) and name in _HOME_OF
        super().__setattr__(name, getattr(value, name) if public else value)


sys.modules[__name__].__class__ = _Package
