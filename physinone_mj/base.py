"""The vocabulary of a phenomenon: its parameters, observables and laws.

A phenomenon is parameters -> build -> observables -> laws. The class is the declaration, an instance is one specimen.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, TypeAlias, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from .run import Run
    from .scene import Scene

Measurement: TypeAlias = tuple[ArrayLike, ArrayLike]
"""What a law returns: (measured, expected), scalars or arrays of one shape."""


class ParameterError(ValueError):
    """A parameter unknown, not finite or out of range: one line says which, its value and what is allowed."""


class Refusal(ValueError):
    """Parameters that are each in range but make, together, a scene that cannot be simulated faithfully.

    rule: the catalogue's code ("R1" ... "R12"), the message names the value and the nearest allowed one; or "model",
    of which values outside of their declared ranges make no scene.
    """

    def __init__(self, rule: str, message: str) -> None:
        super().__init__(rule, message)
        self.rule = rule

    def __str__(self) -> str:
        return f"{self.args[0]}: {self.args[1]}"


class NotEvaluated(Exception):
    """Raised inside a law that the run cannot decide: outside its validity, or too short a window. Says why."""


@dataclass(frozen=True)
class Param:
    """A number that can be set: its SI unit ("1" if it has none), its closed range and what it is."""

    unit: str
    low: float
    high: float
    about: str

    def check(self, value: Any, kind: type) -> str | None:
        """What is wrong with the value, or None."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        allowed = f"allowed: {self.low:g} to {self.high:g}{unit}"
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            return f"is not a number; {allowed}"
        if kind is int and value != int(value):
            return f"is not a whole number; {allowed}"
        if not math.isfinite(value):
            return f"is not finite; {allowed}"
        return None if self.low <= value <= self.high else f"is out of range; {allowed}"

    def draw(self, rng: np.random.Generator, kind: type) -> float | int:
        """A value from the range: uniform, or log-uniform when it spans more than a factor of thirty."""
        if kind is int:
            return int(rng.integers(int(self.low), int(self.high), endpoint=True))
        if self.low > 0 and self.high > 30 * self.low:
            return float(np.exp(rng.uniform(math.log(self.low), math.log(self.high))))
        return float(rng.uniform(self.low, self.high))


@dataclass(frozen=True)
class Choice:
    """A variant that can be set, one of the annotated `Literal`'s words."""

    about: str
    words: tuple[str, ...] = ()

    unit: ClassVar[str] = ""

    def check(self, value: Any, _kind: type) -> str | None:
        """What is wrong with the value, or None."""
        return None if value in self.words else f"is not a choice; allowed: {', '.join(self.words)}"

    def draw(self, rng: np.random.Generator, _kind: type) -> str:
        """One of the words."""
        return self.words[int(rng.integers(len(self.words)))]


@dataclass(frozen=True)
class Verdict:
    """One law held against one run. `error` and `tolerance` are relative, or absolute in `unit` if that is given."""

    index: int
    label: str
    law: str
    equation: str
    source: str
    fidelity: str
    measured: float
    expected: float
    error: float
    tolerance: float
    unit: str | None
    verdict: Literal["passed", "failed", "not evaluated"]
    reason: str | None = None
    limited_by: str | None = None

    @property
    def passed(self) -> bool | None:
        """True or False; None if the law was not evaluated."""
        return None if self.verdict == "not evaluated" else self.verdict == "passed"

    def record(self) -> dict[str, Any]:
        """The verdict as JSON values; a number that is not finite becomes null."""
        values = dataclasses.asdict(self) | {"passed": self.passed}
        return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}


@dataclass(frozen=True)
class Law:
    """An equation that a run must obey, and how far it may miss.

    within: the largest error at DRAFT, STANDARD and REFERENCE; relative to the largest expected value, or absolute in
        `unit` if one is given
    limited_by: the known defect of the model at which the error stops shrinking, or why it shrinks more slowly than
        the integrator's order: something happens within a step
    """

    name: str
    equation: str
    source: str
    within: tuple[float, float, float]
    unit: str | None
    limited_by: str | None
    measure: Callable[[Any, Run], Measurement]

    def error(self, measured: ArrayLike, expected: ArrayLike) -> tuple[float, float, float]:
        """(error, measured, expected) where the two differ most; a NaN anywhere is a NaN error, which fails."""
        m, e = np.atleast_1d(np.asarray(measured, float)), np.atleast_1d(np.asarray(expected, float))
        m, e = np.broadcast_arrays(m, e)
        gap = np.abs(m - e)
        if self.unit is None:
            scale = np.max(np.abs(e))
            gap = gap / scale if scale > 0 else np.full_like(gap, np.nan)
        worst = int(np.argmax(np.where(np.isnan(gap), np.inf, gap)))
        return float(gap.flat[worst]), float(m.flat[worst]), float(e.flat[worst])

    def judge(self, specimen: Phenomenon, run: Run) -> Verdict:
        """Measure the law on the run. A law that cannot be decided is "not evaluated", never "passed"."""
        asked = run.fidelity.tolerance
        tolerance = self.within[run.fidelity.rank] if asked is None else asked
        error = measured = expected = math.nan
        reason = None
        try:
            error, measured, expected = self.error(*self.measure(specimen, run))
            verdict: Literal["passed", "failed", "not evaluated"] = "passed" if error <= tolerance else "failed"
        except NotEvaluated as why:
            verdict, reason = "not evaluated", str(why)
        return Verdict(
            index=specimen.index, label=specimen.label, law=self.name, equation=self.equation, source=self.source,
            fidelity=run.fidelity.name, measured=measured, expected=expected, error=error, tolerance=tolerance,
            unit=self.unit, verdict=verdict, reason=reason, limited_by=self.limited_by,
        )  # fmt: skip


@dataclass(frozen=True)
class Observable:
    """A quantity recorded in every scene folder: Run -> (T, ...) array, with its SI unit."""

    name: str
    unit: str
    about: str
    measure: Callable[[Any, Run], NDArray[np.float64]]


_F = TypeVar("_F", bound=Callable[..., Any])


def law(
    equation: str,
    *,
    source: str,
    within: tuple[float, float, float],
    unit: str | None = None,
    limited_by: str | None = None,
) -> Callable[[_F], _F]:
    """Declare a method `(self, run) -> (measured, expected)` to be a law; see `Law` for the arguments."""
    if not all(0 < w < math.inf for w in within) or list(within) != sorted(within, reverse=True):
        raise ValueError(f"law {equation!r}: within = {within}; allowed: three tolerances, none larger than the last")

    def mark(method: _F) -> _F:
        entry = Law(method.__name__, equation, source, within, unit, limited_by, method)
        method.__dict__["law"] = entry
        return method

    return mark


def observable(unit: str) -> Callable[[_F], _F]:
    """Declare a method `(self, run) -> (T, ...)` to be recorded, in that SI unit."""

    def mark(method: _F) -> _F:
        about = (method.__doc__ or "").strip()
        method.__dict__["observable"] = Observable(method.__name__, unit, about, method)
        return method

    return mark


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Phenomenon(ABC):
    """One of the 71: subclass it in `phenomena/pNN_name.py` and it is listed, run, tested and documented.

    The label is the class name, the index comes from the file name, the title is the docstring's first line.
    views: how many static cameras watch it, unless told otherwise (15 where matter deforms, as in the release)
    checked: whether its parameters have to be in their ranges
    """

    domain: ClassVar[str]
    views: ClassVar[int] = 12
    checked: ClassVar[bool] = True
    label: ClassVar[str]
    index: ClassVar[int]
    title: ClassVar[str]

    def __init_subclass__(cls, *, domain: str, label: str | None = None) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True)(cls)
        cls.domain = domain
        cls.label = label or cls.__name__
        number = re.match(r"(?:.*\.)?p(\d+)_", cls.__module__)
        cls.index = int(number[1]) if number else 0
        cls.title = (cls.__doc__ or "").strip().partition("\n")[0].rstrip(".")

    def __post_init__(self) -> None:
        for name, (param, kind) in self.declarations().items():
            value = getattr(self, name)
            wrong = param.check(value, kind)
            if wrong:
                raise ParameterError(f"{self.label}: {name} = {value!r} {wrong}")
            object.__setattr__(self, name, kind(value))

    @classmethod
    @functools.cache
    def declarations(cls) -> Mapping[str, tuple[Param | Choice, type]]:
        """Every parameter: what was declared, and the type of its value (float, int or str)."""
        found: dict[str, tuple[Param | Choice, type]] = {}
        for name, hint in typing.get_type_hints(cls, include_extras=True).items():
            for entry in getattr(hint, "__metadata__", ()):
                if isinstance(entry, Param):
                    found[name] = entry, typing.get_args(hint)[0]
                elif isinstance(entry, Choice):
                    words = typing.get_args(typing.get_args(hint)[0])
                    found[name] = dataclasses.replace(entry, words=words), str
        return found

    @classmethod
    def laws(cls) -> dict[str, Law]:
        """Every law, in the order of the file."""
        return {k: v.__dict__["law"] for c in reversed(cls.__mro__) for k, v in vars(c).items() if hasattr(v, "law")}

    @classmethod
    def observables(cls) -> dict[str, Observable]:
        """Every observable, in the order of the file."""
        marked = ((k, v) for c in reversed(cls.__mro__) for k, v in vars(c).items() if hasattr(v, "observable"))
        return {k: v.__dict__["observable"] for k, v in marked}

    @classmethod
    def make(cls, **values: Any) -> Self:
        """A specimen; ParameterError names an unknown parameter, the nearest one, and what there is."""
        known = cls.declarations()
        for name in values:
            if name not in known:
                import difflib

                near = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean {near[0]}? " if near else ""
                raise ParameterError(f"{cls.label}: no parameter {name!r}; {hint}there are: {', '.join(known)}")
        return cls(**values)

    @classmethod
    def outside(cls, **values: Any) -> Self:
        """A specimen whose numbers may lie outside their ranges: to find where the model ends, never for data."""
        specimen = cls.make(**{name: getattr(cls, name, None) for name in values})
        for name, value in values.items():
            param, kind = cls.declarations()[name]
            wrong = None if isinstance(param, Param) else param.check(value, kind)
            if wrong:
                raise ParameterError(f"{cls.label}: {name} = {value!r} {wrong}")
            object.__setattr__(specimen, name, kind(value))
        object.__setattr__(specimen, "checked", False)
        return specimen

    def altered(self, **changes: Any) -> Self:
        """The same specimen with some parameters changed; outside of their ranges if this one may be."""
        return (type(self).make if self.checked else type(self).outside)(**(self.values() | changes))

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen over the full ranges; `fixed` values are kept."""
        drawn = {name: param.draw(rng, kind) for name, (param, kind) in cls.declarations().items()}
        return cls.make(**(drawn | fixed))

    def values(self) -> dict[str, float | int | str]:
        """The specimen's parameters, by name."""
        return {name: getattr(self, name) for name in self.declarations()}

    @abstractmethod
    def build(self, scene: Scene) -> None:
        """Put into the scene what is there; Refusal if these parameters cannot be simulated faithfully."""

    @abstractmethod
    def caption(self, run: Run) -> str:
        """One paragraph: the start, what happens and by which law, and how it ends, with this specimen's numbers."""
