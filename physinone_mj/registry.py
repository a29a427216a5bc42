"""The phenomena there are: found by file name, no list to edit."""

from __future__ import annotations

import ast
import difflib
import functools
import importlib
import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .base import Phenomenon


@dataclass(frozen=True)
class Entry:
    """What can be said of a phenomenon without importing it."""

    index: int
    label: str
    title: str
    domain: str
    module: str


class UnknownPhenomenon(LookupError):
    """An index or label that no file in `phenomena` carries; the message names the nearest there is."""


@functools.cache
def entries() -> tuple[Entry, ...]:
    """Every phenomenon, by index. Files are read, not run, so that listing stays quick.

    ImportError if another distribution's package `phenomena` hides ours.
    """
    package = importlib.util.find_spec("phenomena")
    ours = Path(__file__).resolve().parent.parent / "phenomena"
    found = Path(package.origin).resolve().parent if package and package.origin else None
    if found != ours:
        raise ImportError(f"package 'phenomena' resolves to {found}, not to physinone_mj's own {ours}: another "
                          "distribution's package of that name hides it; uninstall that one")  # fmt: skip
    return tuple(sorted((_read(path) for path in ours.glob("p*_*.py")), key=lambda e: e.index))


# a module may be long; what it is called is said in its first lines, as far as its class's docstring
_HEADER = re.compile(r'^class \w+\([^)]*\bdomain\b[^)]*\):\s+(?:"""|\'\'\')[^\n]*', re.MULTILINE)


def _read(path: Path) -> Entry:
    number = re.match(r"p(\d+)_", path.name)
    assert number
    text = path.read_text(encoding="utf-8")
    header = _HEADER.search(text)
    if header:
        text = header[0].rstrip("\"'") + '"""'
    for node in ast.parse(text).body:
        if isinstance(node, ast.ClassDef) and any(k.arg == "domain" for k in node.keywords):
            given = {k.arg: ast.literal_eval(k.value) for k in node.keywords}
            title = (ast.get_docstring(node) or "").partition("\n")[0].rstrip(".")
            label = given.get("label") or node.name
            return Entry(int(number[1]), label, title, given["domain"], f"phenomena.{path.stem}")
    raise ImportError(f"{path.name} defines no Phenomenon")


def find(which: int | str) -> Entry:
    """The entry of an index (46 or "46") or a label; UnknownPhenomenon with the nearest otherwise."""
    known = entries()
    for entry in known:
        if str(which) in (str(entry.index), entry.label):
            return entry
    if str(which).lstrip("-").isdigit():
        there = ", ".join(str(e.index) for e in known)
        raise UnknownPhenomenon(f"no phenomenon {which}; there are: {there}")
    folded = {e.label.lower(): e.label for e in known}
    near = difflib.get_close_matches(str(which).lower(), folded, n=1, cutoff=0.4)
    hint = f"did you mean {folded[near[0]]}?" if near else "`physinone list` names them"
    raise UnknownPhenomenon(f"no phenomenon {which!r}; {hint}")


def phenomenon(which: int | str) -> type[Phenomenon]:
    """The class of a phenomenon, by index or label; UnknownPhenomenon names the nearest there is."""
    from .base import Phenomenon

    entry = find(which)
    module: ModuleType = importlib.import_module(entry.module)
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, Phenomenon) and value.__module__ == entry.module:
            return value
    raise ImportError(f"{entry.module} defines no Phenomenon")
