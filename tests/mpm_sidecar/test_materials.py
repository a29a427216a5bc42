"""The five materials against plain NumPy, closed forms of the test bench, and what any material has to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mpm_sidecar import materials
from mpm_sidecar._ti import kernels, ti
from mpm_sidecar.materials import law, stretch
from physinone_mj.continuum import Elastic, Granular, Newtonian, Plasticine, Viscoplastic, lame

from .taichi_at import taichi_at

Array = NDArray[np.float64]
HENCKY = [Plasticine(), Viscoplastic(), Granular()]
ALL = [Elastic(), *HENCKY, Newtonian()]
SINGLE, DOUBLE = np.float32, np.float64

named = pytest.mark.parametrize("material", ALL, ids=lambda m: type(m).__name__)
solid = pytest.mark.parametrize("material", [Elastic(), *HENCKY], ids=lambda m: type(m).__name__)


@kernels
def _kernel(law: Any, real: Any, state: int, numbers: int) -> Any:
    states = ti.types.ndarray(dtype=ti.types.vector(state, real), ndim=1)
    matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, real), ndim=1)
    given = ti.types.vector(numbers, real)

    def respond(s, grad, tau, dt, k):  # type: ignore[no-untyped-def]
        for p in s:
            s[p], tau[p] = law(s[p], grad[p], dt, k)

    respond.__annotations__ = {"s": states, "grad": matrices, "tau": matrices, "dt": real, "k": given}
    return ti.kernel(respond)


def respond(material: Any, s: Any, grad: Any, dt: float = 1e-4, precision: Any = DOUBLE) -> tuple[Array, Array]:
    """States (n, state) and Kirchhoff stresses (n, 3, 3) [Pa] after a step of Δt ∇v (n, 3, 3)."""
    real = ti.f64 if precision is DOUBLE else ti.f32
    taichi_at(real)
    after, stress = np.array(s, precision, order="C"), np.zeros((len(s), 3, 3), precision)
    numbers = material.parameters()
    kernel = _kernel(law(material, real), real, material.state, len(numbers))
    kernel(after, np.array(grad, precision, order="C"), stress, dt, ti.Vector(numbers, real))
    return after.astype(float), stress.astype(float)


def packed(c: Array, state: int) -> Array:
    out = np.zeros((len(c), state))
    out[:, :6] = c[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return out


def unpacked(s: Array) -> Array:
    return np.asarray(s[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))


def expected(material: Any, c: Array, grad: Array, dt: float) -> tuple[Array, Array]:
    """The same for one particle, from the eigenvectors of b."""
    stretch = np.eye(3) + grad
    b = stretch @ (np.eye(3) + c) @ stretch.T
    squares, axes = np.linalg.eigh(b)
    mu, lam = lame(material.young, material.poisson)
    if isinstance(material, Elastic):
        return b - np.eye(3), mu * (b - np.eye(3)) + lam * math.log(np.prod(squares)) / 2 * np.eye(3)
    strain = np.log(squares) / 2
    volume = strain.sum()
    shape = strain - volume / 3
    size = max(float(np.linalg.norm(shape)), 1e-300)
    if isinstance(material, Granular):
        if volume > 0:
            strain = 0 * strain
        else:
            excess = size + material.cone * (3 * lam + 2 * mu) / (2 * mu) * volume
            strain = strain - max(excess, 0) * shape / size
    else:
        stress = 2 * mu * size
        beyond = max(stress - material.yield_stress, 0.0)
        if isinstance(material, Viscoplastic):
            beyond /= 1 + material.viscosity / (2 * mu * squares.mean() * dt)
        strain = shape * (1 - beyond / stress) + volume / 3
    kept = axes @ np.diag(np.expm1(2 * strain)) @ axes.T
    return kept, axes @ np.diag(2 * mu * strain + lam * strain.sum()) @ axes.T


@solid
@pytest.mark.parametrize("scale", [1e-4, 1e-2, 0.3])
@pytest.mark.parametrize(("precision", "within"), [(SINGLE, 5e-6), (DOUBLE, 2e-9)])
def test_it_is_what_numpy_says(material: Any, scale: float, precision: Any, within: float) -> None:
    """States and stresses at random, twofold and threefold eigenvalues; relative to the greatest element."""
    rng = np.random.default_rng(1)
    n = 200
    turns = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    stretch = np.exp(scale * rng.uniform(-1, 1, (n, 3)))
    stretch[n // 2 :, 1] = stretch[n // 2 :, 0]
    stretch[-n // 4 :, 2] = stretch[-n // 4 :, 0]
    c = np.einsum("nij,nj,nkj->nik", turns, stretch**2 - 1, turns)
    grad = 0.1 * scale * rng.normal(size=(n, 3, 3))
    grad[-n // 8 :] = 0.0
    s, grad = packed(c, material.state).astype(precision), grad.astype(precision)
    after, stress = respond(material, s, grad, precision=precision)
    mu, _ = lame(material.young, material.poisson)
    for p in range(n):
        kept, due = expected(material, unpacked(s.astype(float))[p], grad[p].astype(float), 1e-4)
        most = max(np.abs(c[p]).max(), np.abs(grad[p]).max())
        assert np.abs(unpacked(after)[p] - kept).max() < within * most
        assert np.abs(stress[p] - due).max() < within * max(2 * mu * most, np.abs(due).max())


def sheared(material: Any, rate: float, dt: float, steps: int) -> Array:
    """Stresses (steps, 3, 3) [Pa] in simple shear v = (rate y, 0, 0)."""
    grad = np.zeros((1, 3, 3))
    grad[0, 0, 1] = rate * dt
    s, seen = np.zeros((1, material.state)), []
    for _ in range(steps):
        s, stress = respond(material, s, grad, dt)
        seen.append(stress[0])
    return np.array(seen)


def test_rubber_in_shear_pulls_across_it() -> None:
    """67g: τ_xy = μ γ, τ_xx - τ_yy = μ γ² at any strain."""
    material = Elastic()
    mu, _ = lame(material.young, material.poisson)
    stress = sheared(material, 1.0, 1e-2, 150)
    strain = 1e-2 * np.arange(1, 151)
    assert stress[:, 0, 1] == pytest.approx(mu * strain, rel=1e-12)
    assert stress[:, 0, 0] - stress[:, 1, 1] == pytest.approx(mu * strain**2, rel=1e-10)


def test_plasticine_yields_where_it_says() -> None:
    """68a: in shear at τ_Y/√2, pulled at √(3/2) τ_Y; and what has flowed stays."""
    material = Plasticine()
    assert sheared(material, 1.0, 1e-3, 100)[-1, 0, 1] == pytest.approx(material.yield_stress / math.sqrt(2), rel=1e-3)
    pull = np.diag([1.0, -0.5, -0.5])[None] * 1e-3
    s = np.zeros((1, 7))
    for _ in range(100):
        s, stress = respond(material, s, pull)
    assert stress[0, 0, 0] - stress[0, 1, 1] == pytest.approx(math.sqrt(1.5) * material.yield_stress, rel=1e-6)
    volume = np.linalg.det(np.eye(3) + unpacked(s)[0])
    assert volume == pytest.approx(np.prod(1 + np.diag(pull[0])) ** 200, rel=1e-12)


@pytest.mark.parametrize("rate", [1.0, 20.0, 100.0])
def test_paste_flows_as_binghams(rate: float) -> None:
    """70a: τ = τ_Y/√2 + (η/2) γ̇."""
    material = Viscoplastic(young=1e7, yield_stress=100.0, viscosity=10.0)
    stress = sheared(material, rate, 1e-2 / rate / 100, 100)[-1, 0, 1]
    assert stress == pytest.approx(100 / math.sqrt(2) + 5 * rate, rel=2e-4)


def test_paste_without_viscosity_is_plasticine() -> None:
    """70e."""
    paste, clay = Viscoplastic(viscosity=0.0), Plasticine()
    assert sheared(paste, 1.0, 1e-3, 40) == pytest.approx(sheared(clay, 1.0, 1e-3, 40), rel=1e-13)


@pytest.mark.parametrize("degrees", [20, 30, 40])
@pytest.mark.parametrize("plane", [False, True])
def test_sand_bears_shear_in_proportion_to_its_load(degrees: int, plane: bool) -> None:
    """71a: a layer sheared under a load gives way at tan θ = 2√3 sin φ/(3 - sin φ); with the other cone, in plane
    strain, as Coulomb's sand does where it may not dilate: at sin φ."""
    material = Granular(friction=math.radians(degrees), plane_strain=plane, poisson=0.25)
    mu, lam = lame(material.young, material.poisson)
    press = np.zeros((1, 3, 3))
    press[0, 1, 1] = -1e-4
    s, _ = respond(material, np.zeros((1, 7)), press)
    grad = np.zeros((1, 3, 3))
    grad[0, 0, 1] = 3e-6
    for _ in range(2000):
        s, stress = respond(material, s, grad)
    sine = math.sin(material.friction)
    slope = sine if plane else 2 * math.sqrt(3) * sine / (3 - sine)
    assert -stress[0, 0, 1] / stress[0, 1, 1] == pytest.approx(slope, rel=1e-3)
    assert lam > 0
    assert mu > 0


def test_sand_pulls_at_nothing_and_keeps_its_volume() -> None:
    """Expanded by 2 % and pressed together again, it bears nothing until it is as dense as it was."""
    out, back = np.eye(3)[None] * 0.01, np.eye(3)[None] * -0.001
    for keeps, due in ((True, 0.0), (False, 1.0)):
        material = Granular(keeps_volume=keeps)
        s, stress = respond(material, np.zeros((1, 7)), out)
        assert np.abs(stress).max() == 0.0
        for _ in range(9):
            s, stress = respond(material, s, back)
        assert bool(np.abs(stress).max() > 1.0) == bool(due)
        s, stress = respond(material, s, 2 * back)
        assert stress[0, 0, 0] < 0


def test_a_fluid_has_half_its_viscosity_and_sevenfold_its_bulk() -> None:
    """69: σ = 2 (μ/2) D, K = 7 κ, p = κ (J⁻⁷ - 1)."""
    material = Newtonian(viscosity=40.0, bulk=1e5)
    assert sheared(material, 3.0, 1e-4, 2)[-1, 0, 1] == pytest.approx(20 * 3.0, rel=1e-12)
    rest = np.zeros((1, 3, 3))
    assert -respond(material, np.full((1, 1), -1e-6), rest)[1][0, 0, 0] == pytest.approx(7e5 * 1e-6, rel=1e-5)
    _, stress = respond(material, np.full((1, 1), -0.1), rest)
    assert -stress[0, 0, 0] / 0.9 == pytest.approx(1e5 * (0.9**-7 - 1), rel=1e-12)


def energy(material: Any) -> Callable[[Array], float]:
    """Strain energy density [J/m³] as a function of F (3, 3)."""
    mu, lam = lame(material.young, material.poisson)

    def rubber(f: Array) -> float:
        log = math.log(np.linalg.det(f))
        return float(mu / 2 * (np.trace(f @ f.T) - 3) - mu * log + lam / 2 * log**2)

    def clay(f: Array) -> float:
        strain = np.log(np.linalg.svd(f)[1])
        return float(mu * (strain**2).sum() + lam / 2 * strain.sum() ** 2)

    return rubber if isinstance(material, Elastic) else clay


@pytest.mark.parametrize("material", [Elastic(), Plasticine(yield_stress=1e9)], ids=["Elastic", "Plasticine"])
def test_stress_is_the_derivative_of_the_energy(material: Any) -> None:
    """τ = P Fᵀ, P = ∂ψ/∂F, by central differences."""
    rng = np.random.default_rng(2)
    f = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    stored, h = energy(material), 1e-5
    slope = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = h
            slope[i, j] = (stored(f + step) - stored(f - step)) / (2 * h)
    _, stress = respond(material, packed((f @ f.T - np.eye(3))[None], material.state), np.zeros((1, 3, 3)))
    assert stress[0] == pytest.approx(slope @ f.T, rel=1e-7, abs=1e-7 * np.abs(slope).max())


@named
def test_no_axis_is_better_than_another(material: Any) -> None:
    """Turned state and turned step give the turned stress."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    a, grad = 0.1 * rng.normal(size=(2, 3, 3))
    c = a + a.T + a @ a.T
    fluid = material.state == 1
    s = np.array([[0.01]]) if fluid else packed(c[None], material.state)
    there = s if fluid else packed((turn @ c @ turn.T)[None], material.state)
    _, stress = respond(material, s, grad[None])
    _, turned = respond(material, there, (turn @ grad @ turn.T)[None])
    assert turned[0] == pytest.approx(turn @ stress[0] @ turn.T, rel=1e-9, abs=1e-9 * np.abs(stress).max())


@named
@pytest.mark.parametrize("grad", [-1.5, -0.9, 3.0])
@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
def test_the_extremes_are_finite(material: Any, grad: float, axes: int, precision: Any) -> None:
    """Crushed to a tenth, turned inside out, or blown up fourfold, along one axis or all, twenty times on end."""
    s = np.zeros((1, material.state))
    for _ in range(20):
        s, stress = respond(material, s, np.diag([grad] * axes + [0.0] * (3 - axes))[None], precision=precision)
        assert np.isfinite(s).all()
        assert np.isfinite(stress).all()


@pytest.mark.parametrize(
    "material",
    [Elastic(), Plasticine(yield_stress=1e9), Viscoplastic(yield_stress=1e9), Granular(friction=1.3),
     Newtonian(viscosity=0.0)],
    ids=lambda m: type(m).__name__,
)  # fmt: skip
def test_energy_is_the_work_that_was_done(material: Any) -> None:
    """Along a path that nothing yields on, ∫ τ : ∇v dt is what is stored; and J is the volume that the path made."""
    rng = np.random.default_rng(8)
    rate = rng.uniform(-1, 1, (20, 3, 3)) * 3e-4 - 2e-4 * np.eye(3)
    s, before, work, whole = np.zeros((20, material.state)), np.zeros((20, 3, 3)), np.zeros(20), np.eye(3)
    for _ in range(200):
        s, after = respond(material, s, rate)
        work += np.einsum("nij,nij->n", (before + after) / 2, rate)
        before, whole = after, (np.eye(3) + rate) @ whole
    assert materials.energy(material, s) == pytest.approx(work, rel=2e-3)
    assert stretch(material, s) == pytest.approx(np.linalg.det(whole), rel=1e-3)
    assert materials.energy(material, np.zeros((1, material.state))) == 0.0


@pytest.mark.parametrize("viscosity", [None, 0.0, 30.0])
def test_work_is_stored_or_dissipated(viscosity: float | None) -> None:
    """Along a path on which plasticine, or paste, yields, ∫ τ : ∇v dt is what is stored and what went into flow."""
    material = Plasticine() if viscosity is None else Viscoplastic(viscosity=viscosity)
    rng = np.random.default_rng(8)
    rate = rng.uniform(-1, 1, (20, 3, 3)) * 1e-4
    rate -= np.trace(rate, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    s, before, work = np.zeros((20, 7)), np.zeros((20, 3, 3)), np.zeros(20)
    for _ in range(600):
        s, after = respond(material, s, rate)
        work += np.einsum("nij,nij->n", (before + after) / 2, rate)
        before = after
    spent = materials.dissipated(material, s)
    assert (spent > 0.3 * work).all()
    assert materials.energy(material, s) + spent == pytest.approx(work, rel=1e-2)


def test_sand_remembers_the_volume_that_it_gained() -> None:
    """J of sand that flew apart: it bears nothing, but it is larger."""
    s, _ = respond(Granular(), np.zeros((1, 7)), 0.01 * np.eye(3)[None])
    assert stretch(Granular(), s) == pytest.approx(1.01**3, rel=1e-9)
    assert materials.energy(Granular(), s) == pytest.approx(0.0, abs=1e-9)


def test_what_has_no_law_is_told() -> None:
    """A material of one's own, though it is derived from one that has: its law would be that one's."""

    class Mud(Newtonian):
        pass

    with pytest.raises(TypeError, match=r"^no law for Mud; allowed: Elastic, Plasticine, Viscoplastic, Granular, New"):
        law(Mud(), ti.f32)
