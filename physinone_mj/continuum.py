"""Matter that deforms and flows: materials, shapes, pieces of it, and what they meet. Declarations only.

The five special materials of PhysInOne (CVPR 2026), each with its parameters in SI; their laws are in
`mpm_sidecar.materials`, the particles in `mpm_sidecar`. `Scene.continua` holds a `Continuum`; how finely it is computed
(`Fidelity.cells` to the scene's shortest length) is not said here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Grip: TypeAlias = Literal["stick", "slip", "separate"]


def lame(young: float, poisson: float) -> tuple[float, float]:
    """(μ, λ) [Pa] of Young's modulus [Pa] and Poisson's ratio."""
    return young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))


def _allow(what: Any, **ranges: tuple[float, float]) -> None:
    """ValueError unless each of the numbers named is finite and in its range."""
    for name, (low, high) in ranges.items():
        value = getattr(what, name)
        if not low <= value <= high or not math.isfinite(value):
            raise ValueError(f"{type(what).__name__}: {name} = {value}; allowed: {low:g} to {high:g}")


def _finite(what: Any, name: str) -> None:
    """ValueError unless the vector of that name is three finite numbers."""
    value = getattr(what, name)
    if np.shape(value) != (3,) or not np.isfinite(value).all():
        raise ValueError(f"{type(what).__name__}: {name} = {value}; allowed: three finite numbers")


class Material(Protocol):
    """A material: its density and the numbers of its law.

    state: how many numbers a particle's state has; look: how pictures show it
    """

    state: ClassVar[int]
    look: ClassVar[str]

    @property
    def density(self) -> float:
        """ρ [kg/m³]."""
        ...

    def parameters(self) -> tuple[float, ...]:
        """The numbers that the law is called with, four at most."""
        ...

    def stiffness(self, stretch: float = 1.0, /) -> float:
        """Modulus of a plane wave of pressure [Pa] at J, volume over that at rest, by which only a fluid's changes."""
        ...

    def thickness(self) -> float:
        """Dynamic viscosity, where it flows [Pa s]."""
        ...


@dataclass(frozen=True)
class _Solid:
    """What is elastic first of all: young [Pa], poisson, density [kg/m³]."""

    young: float = 1e5
    poisson: float = 0.3
    density: float = 1000.0
    state: ClassVar[int] = 6
    look: ClassVar[str] = "rubber"

    def __post_init__(self) -> None:
        _allow(self, young=(1.0, 1e12), poisson=(0.0, 0.49), density=(1e-3, 1e5))

    def parameters(self) -> tuple[float, ...]:
        """μ, λ [Pa]."""
        return lame(self.young, self.poisson)

    def stiffness(self, _stretch: float = 1.0, /) -> float:
        """P-wave modulus λ + 2 μ [Pa]."""
        mu, lam = self.parameters()[:2]
        return lam + 2 * mu

    def thickness(self) -> float:
        """Of no viscosity [Pa s]."""
        return 0.0


@dataclass(frozen=True)
class Elastic(_Solid):
    """Neo-Hookean: τ = μ (b - I) + λ ln J I (PhysInOne supplement, eq. 2; J T there).

    young [Pa], poisson, density [kg/m³]. In simple shear γ: τ_xy = μ γ, τ_xx - τ_yy = μ γ².
    Defect: compressed to nothing it resists only as a logarithm; J below 1/100 is taken as 1/100.
    """


@dataclass(frozen=True)
class Plasticine(_Solid):
    """Von Mises plasticity (PhysInOne supplement, eq. 3-6): ‖ê‖ is kept at or below τ_Y/2μ.

    young [Pa], poisson, density [kg/m³], yield_stress τ_Y [Pa]. Shear strength τ_Y/√2, uniaxial √(3/2) τ_Y.
    Slip put right: ê is the deviator of the Hencky strain, not a normalised one.
    """

    yield_stress: float = 1e3
    state: ClassVar[int] = 7
    look: ClassVar[str] = "clay"

    def __post_init__(self) -> None:
        super().__post_init__()
        _allow(self, yield_stress=(0.0, 1e12))

    def parameters(self) -> tuple[float, ...]:
        """μ, λ, τ_Y [Pa]."""
        return *super().parameters(), self.yield_stress


@dataclass(frozen=True)
class Viscoplastic(_Solid):
    """A fluid with a yield stress (PhysInOne supplement, eq. 8-9).

    young [Pa], poisson, density [kg/m³], yield_stress τ_Y [Pa], viscosity η [Pa s]. In steady shear
    τ = τ_Y/√2 + (η/2) γ̇ (Bingham); η = 0 is plasticine.
    Slips put right: s = 2μ ‖ê‖ is a stress, ŝ = s - (s - τ_Y)/(1 + η/(2 μ̂ Δt)), μ̂ = μ tr b/3. Some public codes
    take √(2/3) τ_Y for the threshold: theirs times √(3/2) is ours.
    """

    yield_stress: float = 1e3
    viscosity: float = 10.0
    state: ClassVar[int] = 7
    look: ClassVar[str] = "paste"

    def __post_init__(self) -> None:
        super().__post_init__()
        _allow(self, yield_stress=(0.0, 1e12), viscosity=(0.0, 1e9))

    def parameters(self) -> tuple[float, ...]:
        """μ, λ, τ_Y [Pa], η [Pa s]."""
        return *super().parameters(), self.yield_stress, self.viscosity

    def thickness(self) -> float:
        """η/2 [Pa s]."""
        return self.viscosity / 2


@dataclass(frozen=True)
class Granular(_Solid):
    """Sand (PhysInOne supplement, eq. 10-12): Drucker & Prager's cone without cohesion or dilation.

    young [Pa], poisson, density [kg/m³], friction φ [rad]; plane_strain: α = (√2/3) sin φ, Coulomb's in plane strain,
    instead of the printed √(2/3) 2 sin φ/(3 - sin φ), which is that of triaxial compression and makes slopes fail at
    tan θ = 2√3 sin φ/(3 - sin φ), not tan φ. keeps_volume: what it gains in volume while it is free of stress it loses
    again when it is compressed, before it bears anything (A. P. Tampubolon et al., ACM Trans. Graph. 36 (2017) 105,
    §5).
    """

    young: float = 1e6
    density: float = 1600.0
    friction: float = math.pi / 6
    plane_strain: bool = False
    keeps_volume: bool = True
    state: ClassVar[int] = 7
    look: ClassVar[str] = "sand"

    def __post_init__(self) -> None:
        super().__post_init__()
        _allow(self, friction=(0.0, math.radians(80)))

    @property
    def cone(self) -> float:
        """α."""
        sine = math.sin(self.friction)
        return math.sqrt(2) / 3 * sine if self.plane_strain else math.sqrt(2 / 3) * 2 * sine / (3 - sine)

    def parameters(self) -> tuple[float, ...]:
        """μ, λ [Pa], α (3 λ + 2 μ)/2μ, 1 if the volume is kept."""
        mu, lam = super().parameters()
        return mu, lam, self.cone * (3 * lam + 2 * mu) / (2 * mu), float(self.keeps_volume)


@dataclass(frozen=True)
class Newtonian:
    """A viscous, slightly compressible fluid: τ = ½ μ J (∇v + ∇vᵀ) + κ (J - J⁻⁶) I (PhysInOne supplement, eq. 7).

    viscosity μ [Pa s], of which the dynamic viscosity is the half; bulk κ [Pa], of which the bulk modulus is sevenfold:
    c = √(7 κ/ρ); density [kg/m³]. The state is J - 1.
    Slip put right: the printed form lacks the I and the J.
    Defect: J below 1/20 is taken as 1/20.
    """

    viscosity: float = 50.0
    bulk: float = 1e5
    density: float = 1000.0
    state: ClassVar[int] = 1
    look: ClassVar[str] = "honey"

    def __post_init__(self) -> None:
        _allow(self, viscosity=(0.0, 1e9), bulk=(1.0, 1e12), density=(1e-3, 1e5))

    def parameters(self) -> tuple[float, ...]:
        """μ [Pa s], κ [Pa]."""
        return self.viscosity, self.bulk

    def stiffness(self, stretch: float = 1.0, /) -> float:
        """dτ/d ln J = κ (J + 6 J⁻⁶), at rest 7 κ [Pa]."""
        return self.bulk * (stretch + 6 * stretch**-6)

    def thickness(self) -> float:
        """μ/2 [Pa s]."""
        return self.viscosity / 2


class _Positive:
    def __post_init__(self) -> None:
        for entry in fields(self):  # type: ignore[arg-type]
            value = getattr(self, entry.name)
            if not isinstance(value, (str, Path)) and not (np.all(np.asarray(value) > 0) and np.isfinite(value).all()):
                raise ValueError(f"{type(self).__name__}: {entry.name} = {value} m; allowed: positive and finite")


@dataclass(frozen=True)
class Box(_Positive):
    """half: of its sides [m]."""

    half: Vector


@dataclass(frozen=True)
class Ball(_Positive):
    """radius [m]."""

    radius: float


@dataclass(frozen=True)
class Cylinder(_Positive):
    """Upright. radius; half: of its height [m]."""

    radius: float
    half: float


@dataclass(frozen=True)
class Torus(_Positive):
    """Lying. ring: radius of the middle of its tube; tube: radius of that [m]."""

    ring: float
    tube: float


@dataclass(frozen=True)
class Letters(_Positive):
    """A word standing on the plane y = 0, read along x from -y. height of a capital, depth along y [m]."""

    text: str
    height: float
    depth: float


@dataclass(frozen=True)
class Model(_Positive):
    """A closed mesh from a file, scaled so that its longest side is of a size [m], about the middle of its box."""

    path: Path
    size: float


Shape: TypeAlias = Box | Ball | Cylinder | Torus | Letters | Model


@dataclass(frozen=True)
class Piece:
    """A piece of matter as it is at the start; its shape's middle at a position [m], turned (w first).

    velocity [m/s]; spin: angular velocity about its centre of mass, world axes [rad/s]
    """

    name: str
    material: Material
    shape: Shape
    position: Vector
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    spin: Vector = (0.0, 0.0, 0.0)
    rgba: tuple[float, float, float, float] = (0.8, 0.3, 0.25, 1.0)

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "spin"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} = {getattr(self, name)} of {self.name!r}; allowed: finite numbers")
        if not math.isclose(math.hypot(*self.quaternion), 1.0, rel_tol=1e-9):
            raise ValueError(f"quaternion = {self.quaternion} of {self.name!r}; allowed: of length 1")


@dataclass(frozen=True)
class Meeting:
    """How matter meets a body of the scene (all its geoms, or one geom by name), which feels it in return.

    grip: "stick": it moves with the surface; "slip": it neither leaves nor enters, but slides; "separate": it does not
    enter, and slides by Coulomb's friction while it is pressed on
    Source: A. Stomakhin et al., ACM Trans. Graph. 32 (2013) 102, §8.
    """

    with_: str
    grip: Grip = "separate"
    friction: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.friction < math.inf:
            raise ValueError(f"friction = {self.friction} against {self.with_!r}; allowed: 0 or more")


@dataclass(frozen=True)
class Wall:
    """A fixed half space that nobody sees: what lies at n·(x - point) <= 0 is in it. grip, friction: of a meeting."""

    point: Vector
    normal: Vector
    grip: Grip = "separate"
    friction: float = 0.0

    def __post_init__(self) -> None:
        _finite(self, "point")
        if not math.isclose(math.hypot(*self.normal), 1.0, rel_tol=1e-9) or not 0 <= self.friction < math.inf:
            raise ValueError(f"normal = {self.normal}, friction = {self.friction} of a wall; allowed: a unit vector, "
                             f"0 or more")  # fmt: skip


@dataclass(frozen=True)
class Inlet:
    """Where matter of a piece's material pours in: a round jet of a radius [m] from a place, with a velocity [m/s].

    piece: to which it is added; start, stop: when [s]
    """

    piece: str
    position: Vector
    velocity: Vector
    radius: float
    start: float = 0.0
    stop: float = math.inf

    def __post_init__(self) -> None:
        _finite(self, "position")
        if not 0 < self.radius < math.inf or not 0 < math.hypot(*self.velocity) < math.inf:
            raise ValueError(f"radius = {self.radius} m, velocity = {self.velocity} of an inlet; allowed: positive")
        if not 0 <= self.start < self.stop:
            raise ValueError(f"start = {self.start} s, stop = {self.stop} s of an inlet; allowed: 0 <= start < stop")


@dataclass
class Continuum:
    """All the matter of a scene, on one grid; bodies that share a node of it stick together.

    gravity: (3,) [m/s²] instead of the scene's (a tilted one makes a slope of a level floor)
    ramp: how long gravity takes to grow from nothing [s], as sin²; 0: it is there from the start
    period: length after which the world repeats itself along x, y, z [m]; infinite: never
    """

    pieces: list[Piece] = field(default_factory=list)
    meetings: list[Meeting] = field(default_factory=list)
    walls: list[Wall] = field(default_factory=list)
    inlets: list[Inlet] = field(default_factory=list)
    gravity: Vector | None = None
    ramp: float = 0.0
    period: Vector = (math.inf, math.inf, math.inf)

    def __post_init__(self) -> None:
        if self.gravity is not None:
            _finite(self, "gravity")
        if not 0 <= self.ramp < math.inf:
            raise ValueError(f"ramp = {self.ramp} s of a continuum; allowed: 0 or more, finite")
        if not all(length > 0 for length in self.period):
            raise ValueError(f"period = {self.period} m of a continuum; allowed: positive, or infinite")
