"""18: a cube and a ball in a glass bowl that turns faster and faster."""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin, sqrt
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from phenomena.bowls import (
    HINGE,
    Cube,
    Rolling,
    bowl,
    centre,
    place_ball,
    place_cube,
    polar,
    rolling_state,
    start_ball,
    start_cube,
)
from phenomena.spins import Course, azimuth
from phenomena.turntables import arena
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

BALL: Final = "ball/ball"
CUBE: Final = "cube/block"

LOW_BALL: Final = 0.2
"""Polar angle at which the ball is let go beside a cube [rad]."""

MARGINS: Final = (1e-2, 5e-3, 3e-3)
"""The cube must hold in a bowl speeding up to a spin this much below the critical one, and slip if as much above, at
the three fidelities (of the spin)."""

JERKS: Final = (2e-2, 1e-2, 1e-2)
"""The same for a bowl that starts from rest (of the angular acceleration)."""

SLOW: Final = 0.05
"""Tangential acceleration at which the slip is bracketed, in units of the greatest that friction gives at rest."""

SLIPPED: Final = (3e-3, 1e-3, 5e-4)
"""Change of the cube's polar angle that is no creep, at the three fidelities [rad]."""

START: Final = 0.05
"""When it is decided whether the cube slipped at once [s]."""

FOLLOWED: Final = 1.5
"""How long a rolling ball is followed [s]."""

SMALL: Final = 0.1
SMOOTH: Final = 4e-4
"""Polar angle [rad] and friction of a cube that shows where the bottom loses its hold."""

THROW: Final = (2.6, 0.7)
"""Spin in units of √(g/R_e) and polar angle [rad] of a ball that is thrown over the rim."""


class AccelConcaveSpin(Phenomenon, domain="mechanics"):
    """Objects in a bowl that turns faster and faster: they sit, slip up the wall and leave over the rim."""

    cargo: Annotated[
        Literal["all", "rider", "ball", "cube"],
        Choice("what is in the bowl: cube and ball; one ball turning with it; one let go at rest; the cube"),
    ] = "all"
    radius: Annotated[float, Param("m", 0.15, 0.5, "of the bowl, inside")] = 0.3
    rim: Annotated[float, Param("rad", 1.05, 1.5708, "of the bowl, from the bottom")] = 1.1
    size: Annotated[float, Param("m", 0.01, 0.05, "radius of the ball")] = 0.025
    edge: Annotated[float, Param("1", 0.05, 0.1, "of the cube, in radii of the bowl")] = 0.1
    first: Annotated[float, Param("rad/s", 0.0, 25.0, "spin of the bowl at the start")] = 0.0
    rate: Annotated[float, Param("rad/s²", 0.05, 100.0, "at which it changes")] = 4.0
    top: Annotated[float, Param("rad/s", 0.0, 25.0, "spin that it keeps at last")] = 14.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "of bowl, ball and cube")] = 0.4
    angle: Annotated[float, Param("rad", 0.05, 0.9, "of the cube or a lone ball at the start, from the bottom")] = 0.33
    density: Annotated[float, Param("kg/m³", 300.0, 8000.0, "of ball and cube")] = 1200.0

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen; of two spins the greater is the last, unless they are given."""
        drawn = super().sample(rng, **fixed)
        first, top = sorted((drawn.first, drawn.top))
        return cls.make(**(drawn.values() | {"first": first / 3, "top": top} | fixed))

    @property
    def course(self) -> Course:
        """Of the bowl's spin."""
        return Course(self.first, self.top, self.rate)

    @property
    def reach(self) -> float:
        """R_e: from the bowl's centre to the ball's [m]."""
        return self.radius - self.size

    @property
    def unit(self) -> float:
        """√(g/R_e) of the ball [rad/s]."""
        return sqrt(g / self.reach)

    @property
    def cube(self) -> Cube:
        """On its corners."""
        return Cube(self.radius, self.edge * self.radius / 2)

    def stays(self, spin: float, rate: float) -> float:
        """What friction can give the cube less what it must [m/s²]: it slips where this becomes negative."""
        cube, angle = self.cube, self.angle
        must = hypot(cube.along(angle, spin), cube.dragged(angle, rate))
        return cube.grip(self.friction) * cube.into(angle, spin) - must

    def slip_spin(self, rate: float) -> float:
        """Spin at which the cube slips upwards [rad/s]; NotEvaluated if it slips at rest, or never."""
        if self.cube.tips(self.friction) > 0.98:
            raise NotEvaluated("the cube tips over before it slips")
        if self.stays(0.0, rate) < 0:
            raise NotEvaluated("the cube slips before the bowl turns")
        if self.stays(25.0, rate) > 0:
            raise NotEvaluated("the cube holds at any spin")
        return float(brentq(self.stays, 0.0, 25.0, args=(rate,)))

    @property
    def slips(self) -> float:
        """When the cube slips [s]; 0 if at once, infinite if it does not."""
        rate = self.course.slope if self.course.ramp > 0 else 0.0
        if self.stays(self.first, rate) < 0:
            return 0.0
        try:
            spin = self.slip_spin(rate)
        except NotEvaluated:
            return inf
        return (spin - self.first) / self.rate if self.first <= spin < self.top else inf

    def build(self, scene: Scene) -> None:
        """The bowl in its court, a cube turning with it and a ball that it has to drag round."""
        surface = Surface(friction=self.friction, restitution=0.3)
        arena(scene, self.radius + 0.6, 0.12)
        bowl(scene, self.radius, self.rim, self.course, surface)
        if self.cargo in ("all", "rider", "ball"):
            part = place_ball(scene, "ball", self.size, self.density, surface, (0.93, 0.55, 0.20))
            where = (LOW_BALL if self.cargo == "all" else self.angle, 0.0)
            start_ball(scene, part.name("free"), self.radius, self.size, where, self.first,
                       riding=self.cargo == "rider")  # fmt: skip
        if self.cargo in ("all", "cube"):
            part = place_cube(scene, "cube", self.cube.half, self.density, surface, (0.84, 0.27, 0.22))
            start_cube(scene, part.name("free"), self.radius, self.cube.half, (self.angle, pi), self.first)
        if self.cargo == "all":
            apart = self.reach * sin(LOW_BALL) + self.cube.reach * sin(self.angle)
            needed = self.size + 2 * self.cube.half
            if apart < needed:
                raise Refusal("R1", f"size = {self.size:.4g} m: cube and ball overlap near the bottom; allowed with "
                              f"cargo = all: {max(apart - 2 * self.cube.half, 0.0):.3g} m")  # fmt: skip
            scene.touch(BALL, CUBE)
        late = self.slips if self.slips < inf else min(self.course.ramp, 3.0)
        watched = {"all": min(late + 2.4, 10.0), "cube": min(late + 0.8, 8.0), "rider": 1.0}.get(self.cargo, 2.0)
        fastest = max(self.first, self.top if self.course.ramp < watched else float(self.course.spin(watched)), 1e-3)
        turns = {"cube": 0.75, "rider": 0.8}.get(self.cargo, 3.0)
        scene.resolve(time=min(2.2 / self.unit, turns / fastest), length=self.size,
                      duration=max(watched, 3.0 if self.cargo == "all" else 0.3))  # fmt: skip

    @observable("rad")
    def polar_angles(self, run: Run) -> Array:
        """Of what is in the bowl, from the bottom (T, n)."""
        return np.column_stack([polar(run, body, self.radius) for body in self.bodies(run)])

    @observable("rad")
    def azimuths(self, run: Run) -> Array:
        """Of what is in the bowl, about its axis (T, n)."""
        return np.column_stack([azimuth(run, body) for body in self.bodies(run)])

    @observable("rad/s")
    def bowl_spin(self, run: Run) -> Array:
        """Of the bowl (T,)."""
        return run.joint_speed(HINGE)

    def bodies(self, run: Run) -> list[str]:
        """What is in the bowl."""
        return [body for body in (BALL, CUBE) if body in run.bodies()]

    @law("(g sin θ - Ω² ρ cos θ)² + α² (ρ² + h²/3) = μ'² (g cos θ + Ω² ρ sin θ)²", source="Coulomb's law; Goldstein, "
         "Classical Mechanics, 3rd ed., §4.10; μ' → μ for a small cube: statics on four corners, bowls.Cube.grip; half "
         "edge h: bowls.Cube.dragged",
         within=(1.01e-2, 5.1e-3, 3.1e-3), limited_by="a bracket: it holds below, slips as far above")  # fmt: skip
    def cube_slips_up_at_the_critical_spin(self, run: Run) -> Measurement:
        """18a: in bowls that speed up slowly, a little less and a little more than friction can follow."""
        weight = self.cube.grip(self.friction) * g / (self.cube.reach * sin(self.angle))
        rate = max(SLOW * weight, 0.05)
        spin, margin = self.slip_spin(rate), MARGINS[run.fidelity.rank]
        if not 0.5 < spin < 25.0 / 1.02:
            raise NotEvaluated(f"the critical spin is {spin:.3g} rad/s; the bowl turns with up to 25 rad/s")

        def slips(top: float) -> bool:
            theta = polar(run.again(cargo="cube", first=0.95 * spin, rate=rate, top=top), CUBE, self.radius)
            return bool((theta - theta[0]).max() > SLIPPED[run.fidelity.rank])

        return threshold(slips, spin, spread=margin, resolution=2 * margin), spin

    @law("(g sin θ)² + α² (ρ² + h²/3) = (μ' g cos θ)²", source="Coulomb's law; Goldstein, Classical Mechanics, 3rd "
         "ed., §4.10; a cube of half edge h: bowls.Cube.dragged",
         within=(2.01e-2, 1.01e-2, 1.01e-2), limited_by="a bracket: it holds below, slips as far above")  # fmt: skip
    def too_quick_a_start_leaves_it_behind(self, run: Run) -> Measurement:
        """18a: a bowl that starts from rest takes the cube along up to a certain angular acceleration."""
        cube, angle = self.cube, self.angle
        held = cube.grip(self.friction) * g * cos(angle)
        square = held**2 - (g * sin(angle)) ** 2
        critical = sqrt(max(square, 0.0)) / cube.dragged(angle, 1.0)
        if square < held**2 / 4:
            raise NotEvaluated("its weight alone all but moves the cube, which would slip down, not stay behind")
        if cube.tips(self.friction) > 0.8:
            raise NotEvaluated("the cube all but tips over: the formula is that of a slip along the wall")
        if cube.reach * sin(angle) < sqrt(2) * cube.half:
            raise NotEvaluated("the cube stands on the axis: the formula is that of one beside it")
        if not 1.0 < critical < 95.0:
            raise NotEvaluated(f"the critical angular acceleration is {critical:.3g} rad/s²; allowed: 1 to 95 rad/s²")
        margin = JERKS[run.fidelity.rank]

        def slips(rate: float) -> bool:
            twin = run.again(cargo="cube", first=0.0, rate=rate, top=2 * START * rate)
            some = twin.t < START
            behind = twin.joint(HINGE)[some] - (azimuth(twin, CUBE) - azimuth(twin, CUBE)[0])[some]
            least = 0.05 * (margin * critical) * START**2 / 2
            return bool(np.abs(behind).max() > least)

        return threshold(slips, critical, spread=margin, resolution=2 * margin), critical

    @law("R_e n̈ = F/m + P g - R_e |ṅ|² n, Ω = α t in (1 + 1/k) F/m = P [Ω̇ R ẑ×n + Ω R ẑ×ṅ - r ω×ṅ - g]", unit="rad",
         source="Neimark & Fufaev, Dynamics of Nonholonomic Systems (1972), ch. 1: rolling condition with Euler's laws",
         within=(1e-2, 1e-3, 1e-4))  # fmt: skip
    def ball_rolls_as_the_bowl_drags_it(self, run: Run) -> Measurement:
        """18b: polar angle of a ball that rolls without slipping, over 1.5 s, against the integrated equations."""
        twin = run.again(cargo="ball", friction=0.9, rim=pi / 2)
        some = twin.t <= FOLLOWED
        rolling = Rolling(self.course, self.radius, self.size)
        n, needed = rolling.way(rolling_state(twin, BALL, self.radius, self.size), twin.t[some])
        if needed > 0.88 or n[:, 2].max() > -0.02:
            raise NotEvaluated(f"the ball would need friction of {needed:.2g} and rise to {n[:, 2].max():.2g} R_e")
        return polar(twin, BALL, self.radius)[some], np.arctan2(np.hypot(n[:, 0], n[:, 1]), -n[:, 2])

    @law("v ⊥ x - c where |x - c| = R_e, θ = θ_rim; then ẍ = -g ẑ", source="Galilei, Discorsi (1638), day 4, theorem 1",
         within=(1e-2, 3e-3, 1e-3), limited_by="the step in which the rim is passed")  # fmt: skip
    def leaves_along_the_wall_and_falls(self, run: Run) -> Measurement:
        """18c: a ball thrown over the rim, read backwards along its parabola to where the rim let it go."""
        ratio, angle = THROW
        spin = ratio * self.unit
        if spin > 24.9:
            raise NotEvaluated(f"a spin of {spin:.3g} rad/s would be needed; allowed: up to 25 rad/s")
        twin = run.again(cargo="rider", first=spin, top=spin, angle=angle, rim=min(self.rim, 1.2))
        edge = twin.specimen.rim
        out = polar(twin, BALL, self.radius) > edge
        if not out.any():
            raise NotEvaluated("the ball does not pass the rim")
        start = float(twin.t[int(np.argmax(out)) + 1])
        met = min([i.time for i in twin.impacts if BALL in (i.first, i.second) and i.time > start], default=twin.t[-1])
        air = between(twin.t, start - 1e-9, min(met, start + 0.3))
        x, v = twin.position(BALL)[air] - centre(self.radius), twin.velocity(BALL)[air]
        fall, t = np.array([0.0, 0.0, -g]), (twin.t[air] - twin.t[air][0])[:, None]
        way = x[0] + v[0] * t + fall * t**2 / 2
        # back along the parabola to where it touched the sphere of the ball's centres: there v ⊥ x
        back = brentq(lambda s: (x[0] - v[0] * s + fall * s**2 / 2) @ (v[0] - fall * s), 0.0, 0.1)
        left = x[0] - v[0] * back + fall * back**2 / 2
        far, low = float(np.linalg.norm(left)), float(np.arctan2(np.hypot(left[0], left[1]), -left[2]))
        return [far / self.reach, low / edge, *(1 + (x - way).ravel())], [1.0, 1.0, *np.ones(x.size)]

    @law("Ω² R_e > g", source="Goldstein, Classical Mechanics, 3rd ed., §2 problem 18 (bead on a hoop)",
         within=(1.01e-2, 1.01e-2, 1.01e-2),
         limited_by="a bracket of 1 %; the cube stands 0.1 rad from the bottom")  # fmt: skip
    def bottom_loses_its_hold(self, run: Run) -> Measurement:
        """18d: an almost smooth cube near the bottom, turning with the bowl, goes inwards below this spin and outwards
        above."""
        spin, spread = sqrt(g / self.cube.reach), 1e-2
        if spin * (1 + spread) > 25.0:
            raise NotEvaluated(f"a spin of {spin:.3g} rad/s would be needed; allowed: up to 25 rad/s")

        def outwards(top: float) -> bool:
            twin = run.again(cargo="cube", first=top, top=top, angle=SMALL, friction=SMOOTH, rim=pi / 2)
            theta = polar(twin, CUBE, self.radius)
            moved = theta[np.argmax(np.abs(theta - SMALL))] - SMALL
            return bool(moved > 0) if abs(moved) > 1e-5 else False

        return threshold(outwards, spin, spread=spread, resolution=2 * spread), spin

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        said = [
            f"A glass bowl of {self.radius:.2f} m radius turns about its axis, from {self.first:.1f} to {self.top:.1f} "
            f"rad/s, by {self.rate:.2g} rad/s every second."
        ]
        if CUBE in run.bodies():
            place = f"A red cube sits {np.degrees(self.angle):.0f} degrees up the wall, turning with it"
            gone = polar(run, CUBE, self.radius).max() > self.rim
            if self.slips > run.t[-1]:
                said.append(f"{place}. Friction of {self.friction:.2f} holds it there to the end.")
            else:
                fate = "it leaves over the rim and falls" if gone else "it slips to another place"
                said.append(
                    f"{place}. From {self.slips:.1f} s on friction of {self.friction:.2f} cannot hold it: {fate}."
                )
        if BALL in run.bodies():
            said.append(
                "An orange ball turns with the bowl, driven up the wall by its inertia."
                if self.cargo == "rider"
                else "An orange ball rolls to and fro at the bottom and is dragged round, and its loops widen and turn."
            )
        said.append("What rides farther up needs more of the wall's push to be turned as fast as the glass.")
        return " ".join(said)
