"""19: what stands, rolls and floats on a turntable that turns evenly."""

from __future__ import annotations

from math import hypot, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.parts import ball
from phenomena.spins import Course, across, distance, drift, plan
from phenomena.turntables import HINGE, TOP, arena, block, carry, turntable
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import accelerations, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

WIDE: Final = 0.035
"""Half width of a block, and radius of the ball [m]."""

PUCK: Final = 0.045
THICK: Final = 0.012
"""Radius and half thickness of the puck [m]."""

RIM: Final = 0.09
"""From the outer block's centre to the edge of the disc [m]."""

BEHIND: Final = 0.10
"""From the outer block's circle to the inner one's [m]."""

HEIGHT: Final = 0.16
"""Of the disc's upper side over the ground [m]."""

WATCHED: Final = 5.0
"""How long the scene is watched [s]."""

HELD: Final = 4.0
"""How long a block alone on the disc is watched [s]."""

MARGIN: Final = 1e-3
"""A block must stay at a spin this much below the critical one, and leave at one this much above (of the spin)."""

GONE: Final = 1e-3
"""A block has left its place when it is this much farther out, of its distance from the axis."""

BALL_SHARE: Final = 2 / 7
"""Of the disc's spin, at which a solid ball goes round: β/(1 + β) with β = 2/5."""


class UniformSurfaceSpin(Phenomenon, domain="mechanics"):
    """Objects on an evenly turning plane: blocks ride along, a ball rolls in circles, a smooth puck stays behind."""

    cargo: Annotated[Literal["all", "block", "ball", "puck"], Choice("what is on the disc")] = "all"
    turning: Annotated[Literal["left", "right"], Choice("which way the disc turns, seen from above")] = "left"
    spin: Annotated[float, Param("rad/s", 0.5, 8.0, "of the disc")] = 2.5
    radius: Annotated[float, Param("m", 0.05, 1.0, "circle of the (outer) block")] = 0.55
    friction: Annotated[float, Param("1", 0.0, 0.9, "between blocks or ball and the disc")] = 0.6
    tall: Annotated[float, Param("1", 0.3, 3.0, "height of a block over its width")] = 0.6
    ball_speed: Annotated[float, Param("m/s", 0.0, 0.5, "of the ball at the start, rolling")] = 0.09
    puck_speed: Annotated[float, Param("m/s", 0.0, 0.1, "of the puck, straight on")] = 0.04
    density: Annotated[float, Param("kg/m³", 300.0, 8000.0, "of blocks, ball and puck")] = 1200.0

    @property
    def omega(self) -> float:
        """Angular velocity of the disc, positive to the left [rad/s]."""
        return self.spin if self.turning == "left" else -self.spin

    @property
    def grip(self) -> float:
        """Greatest acceleration that the disc can give a block, in units of g: slipping or toppling ends it."""
        return min(self.friction, 1 / self.tall)

    @property
    def loop(self) -> float:
        """Radius of the ball's circle [m]."""
        return self.ball_speed / (BALL_SHARE * self.spin)

    @property
    def inside(self) -> float:
        """Radius of what the two blocks leave free [m]."""
        return self.radius - BEHIND - 1.5 * WIDE

    @property
    def disc(self) -> float:
        """Radius of the disc [m]."""
        least = {"ball": min(self.loop + 0.2, 1.0), "puck": 0.3}.get(self.cargo, 0.0)
        return max(self.radius + RIM, least)

    @property
    def ball_centre(self) -> Array:
        """Of the ball's circle (2,) [m]."""
        return np.array([WIDE + self.loop - self.inside if self.cargo == "all" else -0.1, 0.0])

    @property
    def ball_start(self) -> Array:
        """Place from which the ball rolls off towards +y (2,) [m]."""
        return np.asarray(self.ball_centre + np.array([np.sign(self.omega) * self.loop, 0.0]))

    @property
    def puck_start(self) -> Array:
        """Place from which the puck slides off towards +y (2,) [m]."""
        back = self.puck_speed * WATCHED / 2
        if self.cargo == "puck":
            return np.array([0.4 * self.disc, -min(back, 0.7 * self.disc)])
        return np.array([sqrt(max((self.inside - PUCK) ** 2 - back**2, 0.0)), -back])

    def build(self, scene: Scene) -> None:
        """The turntable in its court, and what it carries."""
        if self.cargo == "all":
            self._check_room()
        smooth = Surface(friction=0.0, restitution=0.2)
        # all the grip is the riders': the disc is polished, so that a polished puck feels none
        rubber = Surface(friction=2 * self.friction, restitution=0.2)
        arena(scene, self.disc + 0.25, HEIGHT)
        turntable(scene, self.disc, HEIGHT, Course(self.omega, self.omega), smooth)
        half = (WIDE, WIDE, self.tall * WIDE)
        places: list[tuple[str, float, float, tuple[float, float, float]]] = []
        if self.cargo in ("all", "block"):
            places.append(("outer", self.radius, 0.6, (0.84, 0.27, 0.22)))
        if self.cargo == "all":
            places.append(("inner", self.radius - BEHIND, 3.4, (0.94, 0.76, 0.28)))
        for name, r, azimuth, colour in places:
            part = block(scene, name, half, self.density, rubber, colour)
            carry(scene, part.name("free"), r, azimuth, HEIGHT + half[2], self.omega)
        if len(places) > 1:
            scene.touch("outer/block", "inner/block")
        if self.cargo in ("all", "ball"):
            self._place_ball(scene, rubber)
        if self.cargo in ("all", "puck"):
            self._place_puck(scene, smooth)
        watched = HELD if self.cargo == "block" else WATCHED
        scene.resolve(time=min(0.4, 1 / self.spin), length=WIDE, duration=watched)

    def _check_room(self) -> None:
        least = BEHIND + 1.5 * WIDE + PUCK + WIDE + 0.01
        if self.radius < least:
            raise Refusal("R1", f"radius = {self.radius:.4g} m: no room for ball and puck within the blocks' circles; "
                          f"allowed with cargo = all: {least:.4g} m or more")  # fmt: skip
        room = self.puck_start[0] - PUCK - 0.02 + self.inside - 2 * WIDE
        if room < 0:
            raise Refusal("R1", f"puck_speed = {self.puck_speed:.4g} m/s: the puck's way does not fit within the "
                          f"blocks' circles; allowed: {2 * (self.radius - least) / WATCHED:.3g} m/s")  # fmt: skip
        if 2 * self.loop > room:
            allowed = BALL_SHARE * self.spin * room / 2
            raise Refusal("R1", f"ball_speed = {self.ball_speed:.4g} m/s: the ball's circle, {self.loop:.3g} m in "
                          f"radius, does not fit beside the puck; allowed: {allowed:.3g} m/s")  # fmt: skip

    def _place_ball(self, scene: Scene, surface: Surface) -> None:
        part = ball(scene, "ball", WIDE, self.density, surface, (0.93, 0.55, 0.20))
        x, v = self.ball_start, np.array([0.0, self.ball_speed])
        scene.start[part.name("free")] = free_pose((*x, HEIGHT + WIDE))
        # it rolls from the start: v - ω r at its foot is the disc's velocity
        spin = across(v - self.omega * across(x)) / WIDE
        scene.speed[part.name("free")] = (*v, 0.0, *spin, 0.0)
        for other in (TOP, "stage/floor", "court/rails"):
            scene.touch(part.name("ball"), other)

    def _place_puck(self, scene: Scene, surface: Surface) -> None:
        part = scene.add("puck")
        geom, mark = part.geom("puck"), part.geom("mark")
        geom.size[:2], geom.mass = (PUCK, THICK), self.density * 2 * np.pi * PUCK**2 * THICK
        mark.size[0], mark.pos[2] = 0.8 * PUCK, THICK
        scene.material(part.name("puck"), self.density, surface)
        scene.start[part.name("free")] = free_pose((*self.puck_start, HEIGHT + THICK))
        scene.speed[part.name("free")] = (0.0, self.puck_speed, 0.0, 0.0, 0.0, 0.0)
        for other in (TOP, "stage/floor", "court/rails"):
            scene.touch(part.name("puck"), other)

    def bodies(self) -> list[str]:
        """What is on the disc."""
        there = {"block": ["outer/block"], "ball": ["ball/ball"], "puck": ["puck/puck"]}
        return there.get(self.cargo, ["outer/block", "inner/block", "ball/ball", "puck/puck"])

    @observable("m")
    def places(self, run: Run) -> Array:
        """Centres of the bodies seen from above, from the axis, in the room (T, n, 2)."""
        return np.stack([plan(run, body) for body in self.bodies()], axis=1)

    @observable("m")
    def places_on_the_disc(self, run: Run) -> Array:
        """The same in axes that turn with the disc (T, n, 2)."""
        turned = run.joint(HINGE)[:, None, None]
        x = self.places(run)
        return np.asarray(np.cos(turned) * x - np.sin(turned) * across(x))

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """Horizontal velocities of the centres relative to the disc beneath them (T, n, 2)."""
        return np.stack([drift(run, body, HINGE) for body in self.bodies()], axis=1)

    def critical(self) -> float:
        """Greatest spin with which the outer block stays [rad/s]; NotEvaluated if it cannot be set."""
        low, high = (self.declarations()["spin"][0].low, self.declarations()["spin"][0].high)  # type: ignore[union-attr]
        spin = sqrt(self.grip * g / self.radius)
        if not low < spin * (1 - MARGIN) < spin * (1 + MARGIN) < high:
            raise NotEvaluated(f"the critical spin is {spin:.3g} rad/s; the disc turns with {low:g} to {high:g} rad/s")
        return spin

    @law("Ω² r = g min(μ, b/h)", source="Goldstein, Classical Mechanics, 3rd ed., §4.10 with Coulomb's law",
         within=(1.1e-3, 1.1e-3, 1.1e-3), limited_by="a bracket: it stays at -0.1 %, goes at +0.1 %")  # fmt: skip
    def block_stays_up_to_the_critical_spin(self, run: Run) -> Measurement:
        """19a: friction must give Ω² r; a block taller than wide (h > b/μ) topples before it slips."""
        spin = self.critical()

        def goes(spin: float) -> bool:
            r = distance(run.again(cargo="block", spin=spin), "outer/block")
            return bool(r.max() > (1 + GONE) * r[0])

        return threshold(goes, spin, spread=MARGIN, resolution=2 * MARGIN), spin

    @law("r = const for Ω² r < g min(μ, b/h)", source="Coulomb, Théorie des machines simples (1785): static friction",
         within=(1e-4, 3e-6, 3e-7))  # fmt: skip
    def riding_block_does_not_creep(self, run: Run) -> Measurement:
        """19a: distance from the axis over 4 s, at 0.999 of the critical spin."""
        twin = run.again(cargo="block", spin=self.critical() * (1 - MARGIN))
        r = distance(twin, "outer/block")
        return r / r[0], np.ones(len(r))

    @law("x = c + R(2 Ω t/7) (x₀ - c), c = x₀ + ẑ × v₀/(2 Ω/7)", within=(1e-4, 1e-5, 1e-6),
         source="K. Weckesser, Am. J. Phys. 65 (1997) 736; E. Milne, Vectorial Mechanics (1948), §267")  # fmt: skip
    def ball_rolls_in_circles(self, run: Run) -> Measurement:
        """19b: round a fixed point in the room, at two sevenths of the disc's spin, not with the disc."""
        if self.cargo not in ("all", "ball"):
            raise NotEvaluated("no ball is on the disc")
        rate = BALL_SHARE * self.omega
        if self.friction * g <= self.ball_speed * abs(rate):
            raise NotEvaluated("the ball slips")
        on = distance(run, "ball/ball") < self.disc - 1e-3
        on = np.logical_and.accumulate(on)
        if on.sum() < 4:
            raise NotEvaluated(f"{on.sum()} samples of the ball on a disc of {self.disc:.2g} m; needed: 4")
        start, turned = self.ball_start, rate * run.t[on]
        centre = start + across(np.array([0.0, self.ball_speed])) / rate
        arm = start - centre
        circle = np.outer(np.cos(turned), arm) + np.outer(np.sin(turned), across(arm))
        return plan(run, "ball/ball")[on], centre + circle

    @law("x = x₀ + v₀ t", source="Newton, Principia (1687), law I", within=(1e-9, 1e-10, 1e-10))
    def smooth_puck_ignores_the_disc(self, run: Run) -> Measurement:
        """19c: without friction it keeps its velocity in the room, and does not turn."""
        if self.cargo not in ("all", "puck"):
            raise NotEvaluated("no puck is on the disc")
        on = np.logical_and.accumulate(distance(run, "puck/puck") < self.disc)
        expected = self.puck_start + np.outer(run.t[on], (0.0, self.puck_speed))
        turned = run.spin("puck/puck")[on, 2] * run.t[-1]
        return np.column_stack([plan(run, "puck/puck")[on], turned]), np.column_stack([expected, 0 * turned])

    @law("F = -m Ω² r", source="Huygens, De vi centrifuga (1703); Feynman, Lectures I, §9-6",
         within=(3e-3, 2e-4, 2e-5))  # fmt: skip
    def friction_turns_the_riding_block(self, run: Run) -> Measurement:
        """19d: the force on the riding block, from its motion as recorded: towards the axis and nowhere else."""
        holds = self.cargo in ("all", "block") and self.spin**2 * self.radius < 0.99 * self.grip * g
        twin = run if holds else run.again(cargo="block", spin=self.critical() * 0.9)
        spin = twin.specimen.spin
        x, v = plan(twin, "outer/block"), twin.velocity("outer/block")[:, :2]
        mass = twin.mass("outer/block")
        force = np.column_stack([accelerations(twin.t, x[:, k], v[:, k]) for k in (0, 1)]) * mass
        inwards = -x[2:-2] / self.radius
        along = np.sum(force * inwards, axis=1), np.sum(force * across(inwards), axis=1)
        expected = mass * spin**2 * self.radius
        return np.column_stack(along), np.column_stack([np.full(len(force), expected), np.zeros(len(force))])

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        said = [f"A disc turns evenly to the {self.turning} at {self.spin:.1f} rad/s."]
        if self.cargo in ("all", "block"):
            need = self.spin**2 * self.radius / g
            stays = "ride round" if need < self.grip else "fly off, the outer one first,"
            if self.cargo == "block":
                stays = "rides round" if need < self.grip else "flies off,"
            who = "A red and a yellow block" if self.cargo == "all" else "A red block"
            said.append(f"{who}, up to {self.radius:.2f} m from its axis, {stays} because friction of "
                        f"{self.friction:.2f} must hold {need:.2f} times the weight.")  # fmt: skip
        if self.cargo in ("all", "ball"):
            said.append(f"An orange ball, rolling, does not go with the disc but round a circle of {self.loop:.2f} m "
                        "at two sevenths of its spin.")  # fmt: skip
        if self.cargo in ("all", "puck"):
            said.append("A blue puck without friction slides straight on as though the disc stood still.")
        end = hypot(*plan(run, self.bodies()[0])[-1])
        said.append(f"After {run.t[-1]:.0f} s the {'red block' if len(said) > 1 and 'red' in said[1] else 'first'} is "
                    f"{end:.2f} m from the axis.")  # fmt: skip
        return " ".join(said)
