"""Balloons that lift a basket together: as many as it takes, pulling on it along their threads."""

from __future__ import annotations

from math import asin, ceil, cos, expm1, floor, pi, sin, sqrt
from typing import Annotated, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import AIR_DENSITY
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.effects import Buoyancy
from physinone_mj.measure import threshold
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Scene, free_pose

from .balloons import KNOT, Balloon, rise, tie

Array = NDArray[np.float64]

COLOURS: Final = (
    (0.84, 0.27, 0.22), (0.94, 0.76, 0.28), (0.23, 0.47, 0.76), (0.30, 0.62, 0.42), (0.86, 0.48, 0.58),
    (0.93, 0.55, 0.20), (0.50, 0.38, 0.68), (0.17, 0.58, 0.62),
)  # fmt: skip

SMOOTH: Final = Surface(restitution=0.3)
"""Of the balloons among each other: they glide."""

ROOM: Final = 1.03
"""Distance of neighbouring balloons at the start, in diameters."""

BASKET: Final = (0.09, 0.07, 0.06)
"""Half edges of the basket [m]."""

HANDLE: Final = 0.19
"""Top of its handle above its centre [m]."""

BOARD: Final = 0.01
"""Half thickness of the raft [m]."""

GROUND: Final = Surface(friction=0.5, restitution=0.1)
"""Of floor, basket and raft."""

CLIMB: Final = 2.5
"""How far the load is followed upwards [m]."""

MARGIN: Final = 9e-4
"""Half width of the bracket round the load that is just lifted, as a fraction."""


class BalloonLift(Phenomenon, domain="mechanics"):
    """Multiple balloons lifting: a basket leaves the ground as soon as their lifts together exceed its weight."""

    count: Annotated[int, Param("1", 2, 12, "balloons")] = 7
    radius: Annotated[float, Param("m", 0.12, 0.18, "of each")] = 0.15
    gas: Annotated[float, Param("kg/m³", 0.09, 0.4, "density of the gas: hydrogen 0.09, helium 0.18")] = 0.18
    skin: Annotated[float, Param("kg", 0.003, 0.006, "mass of each skin")] = 0.004
    drag: Annotated[float, Param("1", 0.2, 0.8, "drag coefficient")] = 0.47
    payload: Annotated[float, Param("kg", 0.01, 0.31, "mass of what is lifted")] = 0.0535
    length: Annotated[float, Param("m", 0.5, 1.2, "of every thread")] = 0.8
    slack: Annotated[float, Param("1", 0.0, 0.4, "part of every thread that hangs loose at the start")] = 0.35
    threads: Annotated[
        Literal["bunch", "parallel"], Choice("tied to the handle of a basket, or round the edge of a raft")
    ] = "bunch"

    @property
    def balloon(self) -> Balloon:
        """Each of them."""
        return Balloon(self.radius, self.skin, self.gas, self.drag, AIR_DENSITY)

    @property
    def spare(self) -> float:
        """Σ B - W [N]: what accelerates upwards, negative if the load stays."""
        return self.count * self.balloon.lift - self.payload * g

    @property
    def inertia(self) -> float:
        """Of everything [kg], the air that moves along included."""
        return self.count * self.balloon.inertia + self.payload

    @property
    def speed(self) -> float:
        """Final speed of the rise [m/s]: the balloons' drag balances what is to spare."""
        return sqrt(max(self.spare, 0.0) / (self.count * self.balloon.resistance))

    @property
    def pace(self) -> float:
        """Time in which it comes to that speed [s]."""
        return self.inertia * self.speed / self.spare

    @property
    def edge(self) -> float:
        """Radius of the ring of parallel threads [m]."""
        return ROOM * self.radius / sin(pi / self.count)

    @property
    def load(self) -> str:
        """Name of the body that is lifted."""
        return "basket/basket" if self.threads == "bunch" else "raft/raft"

    def eye(self, i: int) -> str:
        """Name of the site that a balloon's thread is tied to."""
        return "basket/eye" if self.threads == "bunch" else f"raft/eye{i}"

    def balloons(self) -> list[str]:
        """Names of their bodies."""
        return [f"balloon{i}/balloon" for i in range(self.count)]

    def directions(self) -> Array:
        """From the handle to the balloons (count, 3): rings about the vertical, as close as they have room."""
        reach = (1 - self.slack) * self.length + KNOT * self.radius
        step = 2 * asin(ROOM * self.radius / reach)
        if self.count < 6:
            rings = [(asin(ROOM * self.radius / (reach * sin(pi / self.count))), self.count)]
        else:
            rings, left, ring = [(0.0, 1)], self.count - 1, 1
            while left:
                # centres a diameter apart, in a straight line, round the ring
                fits = floor(pi / asin(min(sin(step / 2) / sin(min(ring * step, pi / 2)), 1.0)) + 1e-9)
                rings.append((ring * step, min(fits, left)))
                left, ring = left - min(fits, left), ring + 1
        widest = rings[-1][0]
        if widest > 1.5:
            raise Refusal("R12", f"slack = {self.slack:.3g} leaves {self.count} balloons of {self.radius:.3g} m no "
                          f"room above the basket; allowed: less of it, longer threads, or fewer")  # fmt: skip
        found = []
        for n, (polar, number) in enumerate(rings):
            for k in range(number):
                azimuth = 2 * pi * k / number + 0.3 * n
                found.append((sin(polar) * cos(azimuth), sin(polar) * sin(azimuth), cos(polar)))
        return np.array(found)

    def build(self, scene: Scene) -> None:
        """A load on the ground, and over it balloons on slack threads."""
        balloon = self.balloon
        if balloon.lift < 0.2 * balloon.mass * g:
            raise Refusal("R12", f"radius = {self.radius:.3g} m: a lift of {balloon.lift:.2g} N each; allowed: a fifth "
                          f"of their weight, {0.2 * balloon.mass * g:.2g} N, or more")  # fmt: skip
        scene.material("stage/floor", 2400.0, GROUND)
        eyes, up = self._basket(scene) if self.threads == "bunch" else self._raft(scene)
        floats = []
        for i in range(self.count):
            reach = (1 - self.slack) * self.length + KNOT * self.radius
            half = np.arccos(up[i, 2]) / 2
            axis = np.array([-up[i, 1], up[i, 0], 0.0])
            axis /= np.linalg.norm(axis) or 1.0
            place, name = eyes[i] + reach * up[i], f"balloon{i}"
            part, one = balloon.put(scene, name, place, COLOURS[i % len(COLOURS)], [cos(half), *(sin(half) * axis)])
            scene.material(part.name("skin"), balloon.mass / balloon.volume, SMOOTH)
            tie(scene, f"thread{i}", part.name("knot"), self.eye(i), self.length, part.name("balloon"))
            floats.append(one)
        scene.effects.append(Buoyancy(tuple(floats), AIR_DENSITY))
        scene.touch(*(f"balloon{i}/skin" for i in range(self.count)))
        slow = sqrt(balloon.inertia * self.length / balloon.lift)
        scene.resolve(time=min(slow, 5 / self.jerk()), length=self.radius, duration=self.watch())

    def _basket(self, scene: Scene) -> tuple[Array, Array]:
        """The eyes (count, 3) [m] and the directions of the threads (count, 3)."""
        part = scene.add("basket")
        a, b, c = BASKET
        body = part.body("basket")
        body.mass = self.payload
        body.inertia = [self.payload / 3 * s for s in (b**2 + c**2, a**2 + c**2, a**2 + b**2)]
        scene.spec.body(self.load).add_site(name=part.name("eye"), pos=(0, 0, HANDLE), size=[0.003] * 3)
        scene.start[part.name("free")] = free_pose((0, 0, c))
        for matter in ("basket", "block"):
            scene.material(part.name(matter), self.payload / (8 * a * b * c), GROUND)
        scene.touch(part.name("block"), "stage/floor")
        return np.tile((0.0, 0.0, c + HANDLE), (self.count, 1)), self.directions()

    def _raft(self, scene: Scene) -> tuple[Array, Array]:
        """The eyes (count, 3) [m] and the directions of the threads (count, 3)."""
        part = scene.add("raft")
        wide = self.edge + 0.03
        part.geom("board").size[0], part.geom("top").size[0] = wide, 0.94 * wide
        body = part.body("raft")
        body.mass, across = self.payload, self.payload * (wide**2 / 4 + BOARD**2 / 3)
        body.inertia = [across, across, self.payload * wide**2 / 2]
        angles = 2 * pi * np.arange(self.count) / self.count
        eyes = np.column_stack([self.edge * np.cos(angles), self.edge * np.sin(angles), np.full(self.count, BOARD)])
        for i, place in enumerate(eyes):
            scene.spec.body(self.load).add_site(name=part.name(f"eye{i}"), pos=place, size=[0.003] * 3)
        scene.start[part.name("free")] = free_pose((0, 0, BOARD))
        for matter in ("raft", "board"):
            scene.material(part.name(matter), self.payload / (2 * pi * wide**2 * BOARD), GROUND)
        scene.touch(part.name("board"), "stage/floor")
        return eyes + np.array([0, 0, BOARD]), np.tile((0.0, 0.0, 1.0), (self.count, 1))

    def jerk(self) -> float:
        """Angular velocity that a thread may give a balloon when it becomes taut [rad/s]: see `BalloonTether.jerk`."""
        balloon = self.balloon
        scale = balloon.terminal() * balloon.pace()
        arrival = balloon.terminal() * sqrt(-expm1(-2 * self.slack * self.length / scale))
        return arrival / (2 * sqrt(balloon.spin_inertia / balloon.inertia)) + 1e-9

    def watch(self) -> float:
        """How long [s]: until the load is high up, or plainly stays."""
        if abs(self.spare) < 0.01 * self.payload * g:
            return 1.2
        if self.spare < 0:
            return 4.0 if self.threads == "bunch" else 2.0
        # z = v τ ln cosh(t/τ)
        ratio = CLIMB / (self.speed * self.pace)
        climbing = self.pace * (np.arccosh(np.exp(ratio)) if ratio < 300 else ratio + np.log(2))
        return float(np.clip(climbing + self.balloon.time_to(self.slack * self.length), 2.0, 8.0))

    @observable("m")
    def height(self, run: Run) -> Array:
        """Of the load above its start."""
        z = run.position(self.load)[:, 2]
        return np.asarray(z - z[0])

    @observable("N")
    def tension(self, run: Run) -> Array:
        """Sum of what the threads pull the load with (T, 3), off the ground: M (dv/dt + g), g a vector upwards."""
        return np.asarray(self.payload * (np.gradient(run.velocity(self.load), run.t, axis=0) + np.array([0, 0, g])))

    @observable("m")
    def spans(self, run: Run) -> Array:
        """Distance of the ends of every thread (T, count); its length when it is taut."""
        load = run.position(self.load)
        found = []
        for i, body in enumerate(self.balloons()):
            turn, carried = quaternion_matrix(run.quaternion(body)), quaternion_matrix(run.quaternion(self.load))
            knot = run.position(body) - KNOT * self.radius * turn[:, :, 2]
            found.append(np.linalg.norm(knot - load - carried @ run.model.site(self.eye(i)).pos, axis=1))
        return np.column_stack(found)

    def beside(self, run: Run, **changes: float | str) -> Run:
        """A twin on parallel threads, taut from the start, unless said otherwise; NotEvaluated if there is none."""
        for name, value in changes.items():
            range_ = self.declarations()[name][0]
            if isinstance(range_, Param) and not range_.low <= float(value) <= range_.high:
                raise NotEvaluated(f"the twin that the law needs, {name} = {value:.4g}, is out of range")
        wanted = {"threads": "parallel", "slack": 0.0} | changes
        if all(getattr(self, name) == value for name, value in wanted.items()):
            return run
        try:
            return run.again(**wanted)
        except Refusal as why:
            raise NotEvaluated(f"the twin that the law needs is refused ({why})") from None

    def lifted(self, run: Run) -> bool:
        """Whether the load is off the ground in the end."""
        return bool(cast(BalloonLift, run.specimen).height(run)[-1] > 1e-4)

    def lighter(self) -> float:
        """The payload, or one of two thirds of the lift if it is too heavy to be lifted [kg]."""
        able = self.count * self.balloon.lift / g
        return self.payload if self.payload < 0.9 * able else 2 / 3 * able

    @law("W = Σ B", source="Archimedes, On Floating Bodies I, prop. 6", within=(1e-3, 1e-3, 1e-3),
         limited_by="the width of the bracket")  # fmt: skip
    def lifts_what_weighs_less_than_all_lift(self, run: Run) -> Measurement:
        """32a: the greatest load that is lifted: a little lighter goes, a little heavier stays."""
        critical = self.count * self.balloon.lift / g
        found = threshold(lambda m: not self.lifted(self.beside(run, payload=m)), critical, spread=MARGIN,
                          resolution=2 * MARGIN)  # fmt: skip
        return found, critical

    @law("N = ⌈W/B⌉", source="Archimedes, On Floating Bodies I, prop. 6", within=(1e-9, 1e-9, 1e-9))
    def takes_a_certain_number(self, run: Run) -> Measurement:
        """32a: the least number of balloons that lifts the load, one fewer does not."""
        needed = ceil(self.payload * g / self.balloon.lift)
        fewer = self.lifted(self.beside(run, count=needed - 1))
        return needed if self.lifted(self.beside(run, count=needed)) and not fewer else np.nan, needed

    @law("a = (Σ B - W)/(M + Σ m_e)", source="Newton, Principia, law 2; Landau & Lifshitz, Fluid Mechanics, §11",
         within=(5e-4, 5e-5, 5e-6))  # fmt: skip
    def starts_with_what_is_to_spare(self, run: Run) -> Measurement:
        """32b: v_t/τ of the rise of a twin on parallel threads."""
        twin, speed, pace = self.ascent(run)
        return speed / pace, twin.spare / twin.inertia

    @law("v_t = √(2 (Σ B - W)/(ρ Σ C A))", source="Landau & Lifshitz, Fluid Mechanics, §45", within=(1e-4, 1e-5, 1e-6))
    def ends_with_the_speed_of_balance(self, run: Run) -> Measurement:
        """32c: v_t of the rise of a twin on parallel threads."""
        twin, speed, _ = self.ascent(run)
        return speed, twin.speed

    def ascent(self, run: Run) -> tuple[BalloonLift, float, float]:
        """A twin on parallel threads; its final speed [m/s] and time constant [s], from the heights of its load."""
        one = self.beside(run, payload=self.lighter())
        twin = cast(BalloonLift, one.specimen)
        if one.t[-1] < 0.5 * twin.pace:
            raise NotEvaluated(f"{one.t[-1]:.2g} s of rise; needed: {0.5 * twin.pace:.2g} s")
        return twin, *rise(one.t[1:], twin.height(one)[1:])

    @law("Σ ∫ Tᵢ dt = M Δv + M g Δt", source="Newton, Principia, laws 2 and 3", within=(5e-3, 2e-3, 1e-3),
         limited_by="drag is integrated over recorded samples, between which balloons bounce")  # fmt: skip
    def threads_carry_the_load(self, run: Run) -> Measurement:
        """32d: what the threads gave the basket of momentum and against its weight, over what the balloons, by lift,
        drag and inertia, have given up; a vector, in units of the weight, once the basket is off the ground."""
        one = self.beside(run, threads="bunch", slack=self.slack, payload=self.lighter())
        same = cast(BalloonLift, one.specimen)
        aloft = np.nonzero(same.height(one) < 1e-3)[0][-1] + 1
        if len(one) - aloft < 40:
            raise NotEvaluated(f"{len(one) - aloft} samples off the ground; needed: 40")
        t, balloon, upwards = one.t[aloft:], self.balloon, np.array([0.0, 0.0, 1.0])
        gained = same.payload * (one.velocity(same.load)[aloft:] - one.velocity(same.load)[aloft])
        weight = same.payload * g
        measured = gained + weight * np.outer(t - t[0], upwards)
        given = np.zeros_like(measured)
        for body in same.balloons():
            v = one.velocity(body)[aloft:]
            force = balloon.lift * upwards - balloon.resistance * np.linalg.norm(v, axis=1, keepdims=True) * v
            middle = (force[1:] + force[:-1]) / 2 * np.diff(t)[:, None]
            given[1:] += np.cumsum(middle, axis=0)
            given -= balloon.inertia * (v - v[0])
        return measured / (weight * (t[-1] - t[0])), given / (weight * (t[-1] - t[0]))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        lift = self.balloon.lift
        what = "the handle of a basket" if self.threads == "bunch" else "the edge of a round board"
        start = (
            f"{self.count} balloons, each with a lift of {1e3 * lift:.0f} mN, are tied to {what} of "
            f"{1e3 * self.payload:.0f} g by threads {self.length:.2f} m long, {self.slack:.0%} of them slack."
        )
        needed = ceil(self.payload * g / lift)
        how = "They rise, jostle, and draw the threads taut." if self.threads == "bunch" else "They rise side by side."
        if self.spare > 0:
            ends = (
                f"As {needed} would be enough for its weight, the load leaves the ground with {1e3 * self.spare:.0f} "
                f"mN to spare, rises towards a speed of {self.speed:.2f} m/s, at which the air resists as much, and "
                f"is {self.height(run)[-1]:.1f} m up after {run.t[-1]:.0f} s."
            )
        else:
            hop = float(self.height(run).max())
            tugged = f"is tugged {100 * hop:.0f} cm up but comes back to the ground"
            ends = (
                f"But {needed} would be needed for a weight of {1e3 * self.payload * g:.0f} mN; so the load "
                f"{'stays on the ground' if hop < 0.01 else tugged}, and the balloons stand above it."
            )
        return f"{start} {how} {ends}"
