"""What is there: templates put together by name, how they touch, what acts on them and how they start.

A scene says what; a `Fidelity` says how finely; nothing here knows a time step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Protocol, TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .constants import STANDARD_GRAVITY
from .contact import Surface
from .continuum import Continuum

Push: TypeAlias = Callable[[Any], None]
"""Adds a force to `data.xfrc_applied`, as a function of the current state alone; called at every force evaluation."""

IMMATERIAL = 4
"""Geom group of what can be seen but is not matter (beams, winds, fields): never in depth or segmentation."""


OPTICAL = 5
"""Geom group of what is seen, and matter, but passed by rays: the picture of a curved mirror, whose exact surface they
meet instead, and panes so thin that they turn no beam."""


class Effect(Protocol):
    """A force that MuJoCo lacks. Bodies are named as in the scene ("ball/ball")."""

    def bind(self, model: Any) -> Push:
        """Look the names up, once; KeyError names what is missing. The push may keep arrays, never state."""
        ...

    def potential(self, model: Any, data: Any) -> float:
        """Potential energy [J] at the current state; 0 for a force that has none."""
        ...


@dataclass(frozen=True)
class Coil:
    """A helical spring, drawn between the end sites of a spatial tendon: lengths in metres."""

    tendon: str
    body: str
    turns: float
    radius: float
    wire: float
    rgba: tuple[float, float, float, float] = (0.62, 0.64, 0.68, 1.0)


@dataclass(frozen=True)
class Motor:
    """A motor on a hinge or a slide: it holds the joint's speed to a course, with no more than its greatest force.

    course: (time [s], speed [rad/s or m/s]) in order of time; linear between, constant before and after
    force: greatest torque or force [N m or N]; infinite: the motion is prescribed, whatever stands in its way
    off: when it is switched off, after which the joint runs freely [s]
    """

    joint: str
    course: tuple[tuple[float, float], ...]
    force: float = math.inf
    off: float = math.inf

    def __post_init__(self) -> None:
        times = [time for time, _ in self.course]
        if not times or times != sorted(set(times)) or not np.isfinite(self.course).all():
            raise ValueError(f"course = {self.course} of a motor; allowed: (time, speed) in order of time")
        if not self.force > 0:
            raise ValueError(f"force = {self.force} of a motor; allowed: positive")

    def speed(self, time: float) -> float:
        """Speed that it holds at a time [rad/s or m/s]."""
        times, speeds = zip(*self.course, strict=True)
        return float(np.interp(time, times, speeds))


@dataclass(frozen=True)
class Bond:
    """A weld between two bodies that breaks: when |F| + |M|/lever exceeds its strength.

    weld: name of the MJCF equality; strength [N]; lever: arm at which a moment counts as a force [m].
    An impact's impulse J counts as a force J/`contact.CONTACT_TIME`.
    """

    weld: str
    strength: float
    lever: float

    def __post_init__(self) -> None:
        if not self.strength > 0 or not self.lever > 0:
            raise ValueError(f"strength = {self.strength} N, lever = {self.lever} m of a bond; allowed: positive")


@dataclass(frozen=True)
class Bowl:
    """The inside of a spherical cup, as a surface that spheres and boxes touch exactly.

    geom: what is seen of it (its surface's friction rules); site: the centre of the sphere, its z axis the cup's;
    radius of the inside [m]; rim: height of the rim's plane above the centre, along that axis [m]
    Source: two spheres, one inside the other; a box touches with its corners.
    Defect: the rim is a line of no thickness that nothing touches, and the outside is not there.
    """

    geom: str
    site: str
    radius: float
    rim: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.radius < math.inf or not abs(self.rim) < self.radius:
            raise ValueError(f"radius = {self.radius} m, rim = {self.rim} m of a bowl; allowed: |rim| < radius")


@dataclass(frozen=True)
class Mirror:
    """A face of a body that throws light back; its other faces swallow it.

    geom: whose face it is; point, normal: a point of the face and its direction outwards, in the axes of the geom's
    body [m]. Without them all of a round geom's surface is a mirror.
    """

    geom: str
    point: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if (self.point is None) != (self.normal is None):
            raise ValueError(f"a mirror on {self.geom!r} with a point or a normal alone; allowed: both or neither")
        if self.normal is not None and not math.isclose(math.hypot(*self.normal), 1.0, rel_tol=1e-9):
            raise ValueError(f"normal = {self.normal} of the mirror on {self.geom!r}; allowed: a unit vector")


@dataclass(frozen=True)
class Conic:
    """A curved mirror: z = c ρ² / (1 + √(1 - (1 + K) c² ρ²)), c = 1/R, in the axes of a site, silvered towards +z.

    geom: what shows it, a mesh of group `OPTICAL`, which rays pass: they meet the surface itself
    site: its vertex, the z axis its optical axis; radius: R of curvature there, positive concave (the centre at z = R),
    negative convex [m]; aperture: greatest ρ [m]
    conic: K, 0 a sphere, -1 a paraboloid, between them an ellipsoid
    half_length: 0 for a surface of revolution, ρ² = x² + y²; else of a trough along y, ρ = |x| [m]
    strip: of a surface of revolution, only what has |y| < strip is there [m]
    Source: D. Malacara, Optical Shop Testing, appendix A.
    Defect: of no thickness; its back swallows light where the silver is.
    """

    geom: str
    site: str
    radius: float
    aperture: float
    conic: float = 0.0
    half_length: float = 0.0
    strip: float = math.inf

    def __post_init__(self) -> None:
        what = f"of the mirror {self.geom!r}; allowed:"
        if not 0 < abs(self.radius) < math.inf or not math.isfinite(self.conic):
            raise ValueError(f"radius = {self.radius} m, conic = {self.conic} {what} finite, and a radius but 0")
        widest = abs(self.radius) / math.sqrt(1 + self.conic) if self.conic > -1 else math.inf
        if not 0 < self.aperture < widest:
            raise ValueError(f"aperture = {self.aperture} m {what} more than 0, less than {widest:.6g} m")
        if not 0 <= self.half_length < math.inf:
            raise ValueError(f"half_length = {self.half_length} m {what} 0 or more, and finite")
        if not self.strip > 0:
            raise ValueError(f"strip = {self.strip} m {what} more than 0")

    def surface(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points (..., 3) [m] over places x, y (...) [m] in its site's axes, and unit normals (..., 3) towards z."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        c, flat, bent = 1 / self.radius, 1 + self.conic, 0.0 if self.half_length else 1.0
        square = x**2 + bent * y**2
        z = c * square / (1 + np.sqrt(1 - flat * c**2 * square))
        normals = np.stack([-c * x, -c * bent * y, 1 - c * flat * z], axis=-1)
        return np.stack([x, y, z], axis=-1), normals / np.linalg.norm(normals, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Dielectric:
    """What is transparent: rays pass the surface of a geom by Snell's law. index: of refraction, against air's 1.

    The geom is a sphere, ellipsoid, box, cylinder or capsule.
    """

    geom: str
    index: float

    def __post_init__(self) -> None:
        if not 1 <= self.index < 10:
            raise ValueError(f"index = {self.index} of the dielectric {self.geom!r}; allowed: 1 to 10")


@dataclass(frozen=True)
class Beam:
    """A ray of laser light from a site along the site's z axis; `optics` follows it, and it is seen but not matter.

    reach: where it ends if it meets nothing [m]; bounces: most reflections and refractions, after which it is cut off
    and says so
    radius: as it is drawn [m]
    """

    name: str
    site: str
    reach: float = 10.0
    bounces: int = 40
    radius: float = 0.004
    rgba: tuple[float, float, float, float] = (1.0, 0.12, 0.10, 0.85)

    def __post_init__(self) -> None:
        if not 0 < self.reach < math.inf or not 0 < self.radius < math.inf:
            raise ValueError(f"reach = {self.reach} m, radius = {self.radius} m of a beam; allowed: positive, finite")
        if not 0 <= self.bounces <= 1000:
            raise ValueError(f"bounces = {self.bounces} of a beam; allowed: 0 to 1000")


@dataclass(frozen=True)
class Lamp:
    """Parallel light through a rectangular opening at a site, along its z axis: what mirrors and glass make of it is
    seen in path-traced pictures, and nowhere else.

    half: of the opening, along the site's x and y [m]; strength: irradiance across the light, in the sun's of a scene
    Defect: the rasteriser does not show it; no ray, law or measurement knows it.
    """

    site: str
    half: tuple[float, float]
    strength: float = 1.0
    rgb: tuple[float, float, float] = (1.0, 0.95, 0.85)

    def __post_init__(self) -> None:
        if not all(0 < value < math.inf for value in (*self.half, self.strength)):
            raise ValueError(f"half = {self.half} m, strength = {self.strength} of a lamp; allowed: positive, finite")


@dataclass(frozen=True)
class Matter:
    """What an object is made of, as the released dataset labels it: density [kg/m³] and surface."""

    density: float
    surface: Surface


class Part:
    """A template inside a scene; its elements by their names in the template, to be overwritten."""

    def __init__(self, spec: Any, prefix: str) -> None:
        self._spec = spec
        self._prefix = prefix

    def name(self, element: str) -> str:
        """The element's name in the scene."""
        return self._prefix + element

    def _find(self, kind: str, element: str) -> Any:
        found = getattr(self._spec, kind)(self.name(element))
        if found is None:
            raise KeyError(f"template {self._prefix.rstrip('/')!r} has no {kind} {element!r}")
        return found

    def body(self, element: str) -> Any:
        """The MjsBody of that name; KeyError if the template has none."""
        return self._find("body", element)

    def geom(self, element: str) -> Any:
        """The MjsGeom of that name; KeyError if the template has none."""
        return self._find("geom", element)

    def joint(self, element: str) -> Any:
        """The MjsJoint of that name; KeyError if the template has none."""
        return self._find("joint", element)

    def site(self, element: str) -> Any:
        """The MjsSite of that name; KeyError if the template has none."""
        return self._find("site", element)

    def tendon(self, element: str) -> Any:
        """The MjsTendon of that name; KeyError if the template has none."""
        return self._find("tendon", element)


@dataclass
class Scene:
    """What a phenomenon builds: an MJCF specification, contacts, effects and the initial state.

    gravity: downwards [m/s²]
    fps: frames per second of the video (30; 60 for laser scenes, as in the release)
    control: of MJCF actuators, by name, constant (a `<motor>`'s force or torque [N or N m])
    cuts: when an MJCF equality (a holder, a glue) or a tendon's limit (a string) ceases to hold, by its name [s]
    """

    gravity: float = STANDARD_GRAVITY
    fps: int = 30
    spec: Any = field(default_factory=mujoco.MjSpec)
    effects: list[Effect] = field(default_factory=list)
    continua: list[Continuum] = field(default_factory=list)
    coils: list[Coil] = field(default_factory=list)
    cords: dict[str, str] = field(default_factory=dict)
    start: dict[str, ArrayLike] = field(default_factory=dict)
    speed: dict[str, ArrayLike] = field(default_factory=dict)
    matter: dict[str, Matter] = field(default_factory=dict)
    touching: list[tuple[str, str]] = field(default_factory=list)
    motors: list[Motor] = field(default_factory=list)
    bonds: list[Bond] = field(default_factory=list)
    bowls: list[Bowl] = field(default_factory=list)
    mirrors: list[Mirror | Conic] = field(default_factory=list)
    dielectrics: list[Dielectric] = field(default_factory=list)
    beams: list[Beam] = field(default_factory=list)
    lamps: list[Lamp] = field(default_factory=list)
    control: dict[str, float] = field(default_factory=dict)
    cuts: dict[str, float] = field(default_factory=dict)
    time: float = math.inf
    length: float = math.inf
    duration: float = 0.0

    def __post_init__(self) -> None:
        self.add("stage")
        self.spec.visual = _template("stage").visual  # attaching leaves a template's visual settings behind

    def add(self, template: str, name: str | None = None, *, on: str | None = None) -> Part:
        """Put `mjcf_templates/<template>.xml` into the world, or `on` a body; its names get the prefix `<name>/`.

        The name is the template's unless given (to have it twice). FileNotFoundError if there is no such template.
        """
        prefix = (name or template) + "/"
        bearer = self.spec.worldbody if on is None else self.spec.body(on)
        if bearer is None:
            raise KeyError(f"no body {on!r} in the scene")
        self.spec.attach(_template(template), prefix=prefix, frame=bearer.add_frame())
        return Part(self.spec, prefix)

    def connect(self, name: str, first: str, second: str) -> None:
        """Hold two sites together, as a ball joint does: an equality of that name, which `cuts` may end."""
        for site in (first, second):
            if self.spec.site(site) is None:
                raise KeyError(f"no site {site!r} in the scene")
        equality = self.spec.add_equality(name=name, name1=first, name2=second)
        equality.type, equality.objtype = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE

    def material(self, body: str, density: float, surface: Surface) -> None:
        """Say what a body is made of; its surface rules the contacts of all its geoms."""
        self.matter[body] = Matter(density, surface)

    def touch(self, *bodies: str) -> None:
        """Let every two of these bodies collide. Nothing else does: a contact nobody declared does not exist."""
        self.touching += [(a, b) for i, a in enumerate(bodies) for b in bodies[i + 1 :]]

    def coil(self, coil: Coil) -> None:
        """Draw a tendon as a helical spring."""
        self.coils.append(coil)

    def cord(self, tendon: str, body: str) -> None:
        """Show a spatial tendon as a rope that belongs to a body, with the tendon's colour and width (its radius).

        Shorter than the upper end of its `springlength` or `range`, it hangs slack; else it is straight.
        """
        self.cords[tendon] = body

    def resolve(self, *, time: float, length: float, duration: float) -> None:
        """State the shortest time [s] and length [m] that matter and how long to watch [s].

        Called again (composed scenes), the shortest and the longest win.
        """
        for name, value in (("time", time), ("length", length), ("duration", duration)):
            if not 0 < value < math.inf:
                raise ValueError(f"Scene.resolve: {name} = {value}; allowed: positive and finite")
        self.time, self.length = min(self.time, time), min(self.length, length)
        self.duration = max(self.duration, duration)


def _template(name: str) -> Any:
    path = resources.files("mjcf_templates") / f"{name}.xml"
    return mujoco.MjSpec.from_string(path.read_text(encoding="utf-8"))


def free_pose(position: ArrayLike, quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """`Scene.start` of a free joint: position [m] and orientation (w first) as one (7,) array."""
    return np.concatenate([np.asarray(position, float), np.asarray(quaternion, float)])
