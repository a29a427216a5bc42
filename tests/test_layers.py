"""Who may import whom, read from the source of every module: the drawing in the design is a test."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

HOME = Path(__file__).resolve().parents[1]
PACKAGES = ("physinone_mj", "phenomena", "mjcf_templates", "mpm_sidecar", "render")
VOCABULARY = {
    "constants", "fidelity", "base", "scene", "run", "effects", "contact", "collision", "measure", "fracture", "optics",
    "continuum",
}  # fmt: skip
MODULES = sorted(path.relative_to(HOME) for package in PACKAGES for path in (HOME / package).rglob("*.py"))

# What the assembly loads only when a scene needs it.
ENGINES = {"taichi", "OpenGL", "moderngl", "phenomena", "mpm_sidecar", "render"}
FOUNDATION = set(sys.stdlib_module_names) | {"numpy", "scipy", "numba", "mujoco", "manifold3d"}


def imports(tree: ast.Module, module: Path) -> Iterator[tuple[str, bool]]:
    """Every dotted name that the module imports, and whether importing the module is enough to load it."""

    def walk(node: ast.AST, eager: bool) -> Iterator[tuple[str, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from ((alias.name, eager) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                package = ".".join(module.parts[: -child.level]) if child.level else ""
                origin = ".".join(filter(None, (package, child.module)))
                yield from ((f"{origin}.{alias.name}", eager) for alias in child.names)
            else:
                lazy = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) or (
                    isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
                )
                yield from walk(child, eager and not lazy)

    return walk(tree, True)


def offences(source: str, module: Path) -> list[str]:
    """The imports of a module, given by its path from the root, which its layer does not allow."""
    package = module.parts[0]
    is_vocabulary = package == "physinone_mj" and module.stem in VOCABULARY
    is_assembly = package == "physinone_mj" and not is_vocabulary

    def allowed(name: str, eager: bool) -> bool:
        top, _, rest = name.partition(".")
        inner = rest.partition(".")[0]
        if is_assembly:
            return top not in ENGINES or not eager
        if top == "physinone_mj":
            # A name that is not a module is one which the package itself offers.
            is_module = (HOME / "physinone_mj" / f"{inner}.py").exists() or inner in VOCABULARY
            return inner in VOCABULARY or (not is_module and not is_vocabulary)
        if is_vocabulary:
            return top in FOUNDATION
        return top not in PACKAGES or top == package

    return [f"{module}: {name}" for name, eager in imports(ast.parse(source), module) if not allowed(name, eager)]


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_layers(module: Path) -> None:
    assert offences((HOME / module).read_text(encoding="utf-8"), module) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("phenomena/p46_pendulum.py", "import render"),
        ("phenomena/p46_pendulum.py", "def build():\n    from mpm_sidecar.medium import Medium"),
        ("phenomena/p46_pendulum.py", "from physinone_mj import doctor"),
        ("phenomena/p46_pendulum.py", "from physinone_mj.doctor import examine"),
        ("mpm_sidecar/medium.py", "from phenomena import p46_pendulum"),
        ("render/egl.py", "import mpm_sidecar.surface"),
        ("physinone_mj/scene.py", "from physinone_mj.doctor import examine"),
        ("physinone_mj/scene.py", "from .doctor import examine"),
        ("physinone_mj/scene.py", "from physinone_mj import Run"),
        ("physinone_mj/scene.py", "import taichi"),
        ("physinone_mj/scene.py", "def late():\n    import render"),
        ("physinone_mj/simulate.py", "import taichi as ti"),
        ("physinone_mj/simulate.py", "try:\n    from OpenGL import GL\nexcept ImportError:\n    pass"),
        ("physinone_mj/registry.py", "class Registry:\n    import phenomena"),
        ("physinone_mj/__init__.py", "from render.egl import gl_info"),
    ],
)
def test_an_offence_is_seen(module: str, source: str) -> None:
    assert len(offences(source, Path(module))) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("phenomena/p46_pendulum.py", "from physinone_mj import Param\nfrom physinone_mj.scene import Scene"),
        ("phenomena/p46_pendulum.py", "from physinone_mj import constants, effects\nfrom scipy.special import ellipk"),
        ("phenomena/p47_spring.py", "from phenomena.p46_pendulum import bob\nfrom .p46_pendulum import bob"),
        ("mpm_sidecar/medium.py", "import taichi as ti\nfrom mpm_sidecar import materials"),
        ("physinone_mj/scene.py", "import mujoco\nimport numpy as np\nfrom physinone_mj.fidelity import Fidelity"),
        ("physinone_mj/simulate.py", "import scipy\ndef late():\n    import taichi\n    import render.egl"),
        ("physinone_mj/dataset.py", "import typing\nif typing.TYPE_CHECKING:\n    from render.rig import Rig"),
    ],
)
def test_the_design_is_allowed(module: str, source: str) -> None:
    assert offences(source, Path(module)) == []
