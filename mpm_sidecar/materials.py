"""The five special materials: from the motion of a step to stress, as functions that the solver's kernels close over.

All five are isotropic: of the deformation gradient F only b = F Fᵀ matters. The state is c = b - I, six numbers that
are zero at rest, so that single precision keeps small strains; no F, no rotation, no singular value decomposition.
With g = Δt ∇v,

    b' = (I + g) b (I + g)ᵀ,      c' = c + m + mᵀ + m gᵀ,  m = g + g c

The Hencky strain ε = ½ log b and whatever follows from it share their axes with c. With the eigenvalues e₀ ≥ e₁ ≥ e₂ of
c in closed form, a function of c is its Newton interpolation polynomial

    f(c) = f(e₀) I + f[e₀,e₁] (c - e₀ I) + f[e₀,e₁,e₂] (c - e₀ I)(c - e₁ I)

with divided differences that do not cancel: log1p(z)/z and expm1(y)/y are series near zero.

Literals are of Taichi's default precision: it has to be that of the law (`default_fp`).

Symbols: J = √det b; τ = J T the Kirchhoff stress [Pa]; ê = ε - tr(ε)/3 I; ‖·‖ Frobenius; μ, λ Lamé's constants [Pa].
Source: the supplement of PhysInOne (CVPR 2026), eq. 2-12, with its slips put right; each material says which.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from physinone_mj.continuum import Elastic, Granular, Material, Newtonian, Plasticine, Viscoplastic

from ._ti import kernels, ti

Array = NDArray[np.float64]

Law: TypeAlias = Any
"""ti.func (state, Δt ∇v (3, 3), Δt [s], parameters) -> (state', Kirchhoff stress (3, 3) [Pa])."""

SMALL: Final = 0.25
"""|z| up to which log1p(z)/z and expm1(z)/z are series, in double precision."""
ARC: Final = (
    -0.0012624911, 0.0066700901, -0.0170881256, 0.0308918810, -0.0501743046, 0.0889789874, -0.2145988016, 1.5707963050,
)  # fmt: skip
"""arccos(x)/√(1 - x), the last term first."""


def _odd(terms: int) -> list[float]:
    """1/(2 k + 1), of atanh(w)/w in w², the last first."""
    return [1 / (2 * k + 1) for k in range(terms - 1, -1, -1)]


def _rising(terms: int) -> list[float]:
    """1/(k + 1)!, of expm1(y)/y, the last first."""
    return [1 / math.factorial(k + 1) for k in range(terms - 1, -1, -1)]


@kernels
def _single() -> Any:
    """log1p(z), that over z, expm1(y)/y, exp(y) and (cos, sin)(arccos(x)/3) of single precision, without a branch or a
    call: so the compiler works on eight particles at once."""
    cosine = [(-1) ** k / math.factorial(2 * k) for k in range(5, -1, -1)]
    sine = [(-1) ** k / math.factorial(2 * k + 1) for k in range(5, -1, -1)]

    @ti.func
    def logarithm(z):
        """1 + z = 2ⁿ (1 + t), 1/√2 < 1 + t < √2: n, log1p(t)/t, and log1p(z)."""
        bits = ti.bit_cast(1 + z, ti.i32)
        n = (bits - 0x3F3504F3) >> 23
        t = ti.select(n == 0, z, ti.bit_cast(bits - (n << 23), ti.f32) - 1)
        over = 1 / (2 + t)
        w = t * over
        s = ti.cast(0.0, ti.f32)
        for term in ti.static(_odd(6)):
            s = s * (w * w) + term
        return n, 2 * s * over, ti.cast(n, ti.f32) * ti.static(math.log(2)) + 2 * s * w

    @ti.func
    def log1p(z):
        _, _, log = logarithm(z)
        return log

    @ti.func
    def log1p_over(z):
        n, near, log = logarithm(z)
        return ti.select(n == 0, near, log / z)

    @ti.func
    def parts(y):
        """n, 2ⁿ, r, expm1(r)/r of exp(y) = 2ⁿ exp(r), |r| < log √2."""
        n = ti.cast(y * ti.static(1 / math.log(2)) + 256.5, ti.i32) - 256
        r = y - ti.cast(n, ti.f32) * ti.static(math.log(2))
        rest = ti.cast(0.0, ti.f32)
        for term in ti.static(_rising(8)):
            rest = rest * r + term
        return n, ti.bit_cast((n + 127) << 23, ti.f32), r, rest

    @ti.func
    def exp(y):
        _, power, r, rest = parts(y)
        return power + power * r * rest

    @ti.func
    def expm1_over(y):
        n, power, r, rest = parts(y)
        return ti.select(n == 0, rest, (power * r * rest + (power - 1)) / y)

    @ti.func
    def third(x):
        """Source: M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions (1964), 4.4.46."""
        size = ti.abs(x)
        arc = ti.cast(0.0, ti.f32)
        for term in ti.static(ARC):
            arc = arc * size + term
        arc *= ti.sqrt(1 - size)
        turn = ti.select(x < 0, ti.static(math.pi) - arc, arc) / 3
        c, s = ti.cast(0.0, ti.f32), ti.cast(0.0, ti.f32)
        for term in ti.static(cosine):
            c = c * (turn * turn) + term
        for term in ti.static(sine):
            s = s * (turn * turn) + term
        return c, s * turn

    return SimpleNamespace(log1p=log1p, log1p_over=log1p_over, expm1_over=expm1_over, exp=exp, third=third)


@kernels
def _double() -> Any:
    """The same of double precision."""

    @ti.func
    def log1p_over(z):
        y = ti.cast(0.0, ti.f64)
        if ti.abs(z) < SMALL:
            w = z / (2 + z)
            s = ti.cast(0.0, ti.f64)
            for term in ti.static(_odd(10)):
                s = s * (w * w) + term
            y = 2 * s / (2 + z)
        else:
            y = ti.log(1 + z) / z
        return y

    @ti.func
    def log1p(z):
        return z * log1p_over(z)

    @ti.func
    def exp(y):
        return ti.exp(y)

    @ti.func
    def expm1_over(y):
        z = ti.cast(0.0, ti.f64)
        if ti.abs(y) < SMALL:
            for term in ti.static(_rising(12)):
                z = z * y + term
        else:
            z = (ti.exp(y) - 1) / y
        return z

    @ti.func
    def third(x):
        turn = ti.acos(x) / 3
        return ti.cos(turn), ti.sin(turn)

    return SimpleNamespace(log1p=log1p, log1p_over=log1p_over, expm1_over=expm1_over, exp=exp, third=third)


@kernels
def functions(real: Any) -> Any:
    """What the laws share, at a precision: symmetric matrices, logarithms, eigenvalues."""
    of_number = _single() if real == ti.f32 else _double()
    log1p, log1p_over, expm1_over, exp = of_number.log1p, of_number.log1p_over, of_number.expm1_over, of_number.exp

    @ti.func
    def unpack(s):
        return ti.Matrix([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])

    @ti.func
    def pack(c):
        return ti.Vector([c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2]])

    @ti.func
    def push(c, grad):
        """c after a step in which x moves to (I + grad) x."""
        m = grad + grad @ c
        return c + m + m.transpose() + m @ grad.transpose()

    @ti.func
    def excess(c):
        """det(I + c) - 1."""
        minors = (
            c[0, 0] * c[1, 1] - c[0, 1] ** 2 + c[0, 0] * c[2, 2] - c[0, 2] ** 2 + c[1, 1] * c[2, 2] - c[1, 2] ** 2
        )
        return c.trace() + minors + c.determinant()

    @ti.func
    def eigenvalues(c):
        """The three of a symmetric matrix, greatest first, by the cubic's cosines.

        Source: O. K. Smith, Commun. ACM 4 (1961) 168. Near a double root two of them are known to the root of
        the precision only; an interpolation polynomial does not mind.
        """
        mean = c.trace() / 3
        d = c - mean * ti.Matrix.identity(real, 3)
        p2 = (d[0, 0] ** 2 + d[1, 1] ** 2 + d[2, 2] ** 2 + 2 * (d[0, 1] ** 2 + d[0, 2] ** 2 + d[1, 2] ** 2)) / 6
        p = ti.sqrt(ti.max(p2, ti.static(1e-36 if real == ti.f32 else 1e-290)))
        d *= 1 / p
        x, y = of_number.third(ti.min(ti.max(d.determinant() / 2, -1.0), 1.0))
        return ti.Vector([
            mean + 2 * p * x,
            mean + p * (ti.static(math.sqrt(3)) * y - x),
            mean - p * (ti.static(math.sqrt(3)) * y + x),
        ])

    @ti.func
    def logs(e):
        """y = log1p(e) at the three eigenvalues, and y[e₀,e₁], y[e₁,e₂]."""
        y = ti.Vector([log1p(e[i]) for i in ti.static(range(3))])
        near = log1p_over((e[1] - e[0]) / (1 + e[0])) / (1 + e[0])
        far = log1p_over((e[2] - e[1]) / (1 + e[1])) / (1 + e[1])
        return y, near, far

    @ti.func
    def of(c, e, value, near, far):
        """The Newton interpolation polynomial of a function of c: f(e₀), f[e₀,e₁], f[e₁,e₂] -> f(c).

        Where all three are one, the difference of the slopes is rounding, and so is what it is multiplied by.
        """
        apart = e[0] - e[2]
        bend = ti.cast(0.0, real)
        if apart > ti.static(1e-12 if real == ti.f32 else 1e-100):
            bend = (near - far) / apart
        first = c
        other = c
        for i in ti.static(range(3)):
            first[i, i] -= e[0]
            other[i, i] -= e[1]
        result = near * first + bend * (first @ other)
        for i in ti.static(range(3)):
            result[i, i] += value
        return result

    return SimpleNamespace(
        unpack=unpack, pack=pack, push=push, excess=excess, log1p=log1p, log1p_over=log1p_over, expm1_over=expm1_over,
        exp=exp, eigenvalues=eigenvalues, logs=logs, of=of,
    )  # fmt: skip


@kernels
def _elastic(real: Any) -> Law:
    """τ = μ (b - I) + λ ln J I."""
    shared = functions(real)

    @ti.func
    def respond(s, grad, _dt, k):
        c = shared.push(shared.unpack(s), grad)
        excess = ti.max(shared.excess(c), -0.9999)
        tau = k[0] * c
        pressure = 0.5 * k[1] * shared.log1p(excess)
        for i in ti.static(range(3)):
            tau[i, i] += pressure
        return shared.pack(c), tau

    return respond


Flow: TypeAlias = Any
"""ti.func (‖ê‖, tr ε, b̄ = tr b/3, seventh of the state, dt, parameters) -> (factor of ê, tr ε', seventh')."""


@kernels
def _hencky(real: Any, flow: Flow) -> Law:
    """St. Venant-Kirchhoff elasticity in Hencky strain, τ = 2 μ ε + λ tr ε I, and a rule of flow.

    The seventh number of the state is what has gone: of what yields, the work of flow ∫ 2 μ ê : dε_p, by volume at rest
    [J/m³]; of sand, the logarithm of the volume that it has gained without stress.
    """
    shared = functions(real)

    @ti.func
    def respond(s, grad, dt, k):
        c = shared.push(shared.unpack(s), grad)
        e = shared.eigenvalues(c)
        for i in ti.static(range(3)):
            e[i] = ti.max(e[i], -0.9975)
        y, near, far = shared.logs(e)
        trace = 0.5 * (y[0] + y[1] + y[2])
        deviator = 0.5 * y - trace / 3
        size = ti.sqrt(deviator[0] ** 2 + deviator[1] ** 2 + deviator[2] ** 2)
        shrink, after, gone = flow(size, trace, 1 + (e[0] + e[1] + e[2]) / 3, s[6], dt, k)
        # ε' = shrink ε + shift I, along the axes of c
        shift = (after - shrink * trace) / 3
        tau = shared.of(c, e, k[0] * shrink * y[0], k[0] * shrink * near, k[0] * shrink * far)
        for i in ti.static(range(3)):
            tau[i, i] += 2 * k[0] * shift + k[1] * after
        if shrink != 1.0 or after != trace:
            z = shrink * y + 2 * shift
            rise = shared.exp(z[0]) * shared.expm1_over(z[1] - z[0]) * shrink * near
            fall = shared.exp(z[1]) * shared.expm1_over(z[2] - z[1]) * shrink * far
            c = shared.of(c, e, z[0] * shared.expm1_over(z[0]), rise, fall)
        return ti.Vector([c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2], gone]), tau

    return respond


@kernels
def _plasticine(real: Any) -> Law:
    """‖ê‖ is kept at or below τ_Y/2μ."""

    @ti.func
    def flow(size, trace, _mean, spent, _dt, k):
        shrink = ti.cast(1.0, real)
        if 2 * k[0] * size > k[2]:
            shrink = k[2] / (2 * k[0] * size)
        return shrink, trace, spent + 2 * k[0] * size * size * shrink * (1 - shrink)

    return _hencky(real, flow)


@kernels
def _viscoplastic(real: Any) -> Law:
    """ŝ = s - (s - τ_Y)/(1 + η/(2 μ̂ Δt))."""

    @ti.func
    def flow(size, trace, mean, spent, dt, k):
        shrink, stress = ti.cast(1.0, real), 2 * k[0] * size
        if stress > k[2]:
            shrink = 1 - (1 - k[2] / stress) / (1 + k[3] / (2 * k[0] * mean * dt))
        return shrink, trace, spent + 2 * k[0] * size * size * shrink * (1 - shrink)

    return _hencky(real, flow)


@kernels
def _granular(real: Any) -> Law:
    """‖ê‖ is kept at or below -α (3 λ + 2 μ)/2μ tr ε, and tr ε at or below what was gained."""

    @ti.func
    def flow(size, trace, _mean, gained, _dt, k):
        whole = trace + gained
        after = ti.min(whole, 0.0)
        shrink = ti.cast(1.0, real)
        if size > -k[2] * after:
            shrink = -k[2] * after / size
        return shrink, after, k[3] * ti.max(whole, 0.0)

    return _hencky(real, flow)


@kernels
def _newtonian(real: Any) -> Law:
    """τ = ½ μ J (∇v + ∇vᵀ) + κ (J - J⁻⁶) I, where J - J⁻⁶ = (J - 1)(1 + J⁻¹ + ... + J⁻⁶) does not cancel."""

    @ti.func
    def respond(s, grad, dt, k):
        j = ti.max(s[0] + (1 + s[0]) * grad.trace(), -0.95)
        volume = 1 + j
        tau = (0.5 * k[0] / dt * volume) * (grad + grad.transpose())
        inverse, powers = 1 / volume, ti.cast(1.0, real)
        for _ in ti.static(range(6)):
            powers = powers * inverse + 1
        for i in ti.static(range(3)):
            tau[i, i] += k[1] * j * powers
        return ti.Vector([j]), tau

    return respond


_LAWS: Final[dict[type, Any]] = {
    Elastic: _elastic, Plasticine: _plasticine, Viscoplastic: _viscoplastic, Granular: _granular, Newtonian: _newtonian,
}  # fmt: skip


def law(material: Material, real: Any) -> Law:
    """The law of a material at a precision (ti.f32 or ti.f64); TypeError if it has none."""
    if type(material) not in _LAWS:
        raise TypeError(f"no law for {type(material).__name__}; allowed: {', '.join(m.__name__ for m in _LAWS)}")
    return _LAWS[type(material)](real)


def stretch(material: Material, states: Array) -> Array:
    """J (n,): how many times its volume at rest a particle of these states (n, state) has."""
    s = np.asarray(states, float)
    if isinstance(material, Newtonian):
        return 1 + s[:, 0]
    gained = s[:, 6] if isinstance(material, Granular) else 0.0
    return np.asarray(np.sqrt(np.prod(1 + _eigenvalues(s), axis=1)) * np.exp(gained))


def dissipated(material: Material, states: Array) -> Array:
    """Work of flow of particles of these states (n, state), by volume at rest (n,) [J/m³]; zero of what does not yield,
    and of sand, which does not keep it."""
    if isinstance(material, Plasticine | Viscoplastic):
        return np.asarray(states, float)[:, 6]
    return np.zeros(len(states))


def energy(material: Material, states: Array) -> Array:
    """Elastic energy of particles of these states (n, state), by volume at rest (n,) [J/m³].

    ½ μ (tr b - 3) - μ ln J + ½ λ ln² J, μ ‖ε‖² + ½ λ tr² ε, or κ (J + J⁻⁶/6 - 7/6) of a fluid: what its law's
    stress, or the elastic part of that, is the derivative of.
    """
    s = np.asarray(states, float)
    if isinstance(material, Newtonian):
        j = 1 + s[:, 0]
        return np.asarray(material.bulk * (s[:, 0] + (j**-6 - 1) / 6))
    mu, lam = material.parameters()[:2]
    e = _eigenvalues(s)
    log = np.log1p(e).sum(axis=1)
    if isinstance(material, Elastic):
        return np.asarray(0.5 * mu * (e.sum(axis=1) - log) + 0.125 * lam * log**2)
    return np.asarray(0.25 * mu * (np.log1p(e) ** 2).sum(axis=1) + 0.125 * lam * log**2)


def _eigenvalues(s: Array) -> Array:
    """Of c (n, 3), by the cubic's cosines; above -1."""
    mean = (s[:, 0] + s[:, 3] + s[:, 5]) / 3
    a, b, c, p, q, r = s[:, 0] - mean, s[:, 3] - mean, s[:, 5] - mean, s[:, 1], s[:, 2], s[:, 4]
    size = np.sqrt((a * a + b * b + c * c + 2 * (p * p + q * q + r * r)) / 6)
    cube = a * (b * c - r * r) - p * (p * c - r * q) + q * (p * r - b * q)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(size > 0, cube / (2 * size**3), 0.0)
    turn = np.arccos(np.clip(ratio, -1, 1)) / 3
    angles = turn[:, None] + np.array([0.0, -2.0, 2.0]) * (math.pi / 3)
    return np.asarray(np.maximum(mean[:, None] + 2 * size[:, None] * np.cos(angles), -1 + 1e-9))
