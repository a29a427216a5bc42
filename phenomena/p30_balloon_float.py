"""A balloon let go: it rises as fast as the air lets it, and leans against the ceiling with all its lift."""

from __future__ import annotations

from math import cos, exp, pi, sin, sqrt, tan
from typing import Annotated, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import Buoyancy
from physinone_mj.measure import between, fit, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Coil, Scene

from .balloons import RUBBER, Balloon, rise

Array = NDArray[np.float64]

BODY: Final = "balloon/balloon"

START: Final = 0.25
"""Lowest point of the balloon before it is let go, above the floor [m]."""

RAMP: Final = 1.3
"""Length of an inclined ceiling beyond the point over the start [m]."""

HOVERING: Final = 0.05
"""Lift, in weights, below which a balloon neither rises nor sinks to speak of."""

STEADY: Final = 1e-10
"""Part of its reading that a scale may still have to go when it is read."""

MARGIN: Final = 9e-4
"""Half width of the bracket round the radius of no lift, as a fraction."""


class BalloonFloat(Phenomenon, domain="mechanics"):
    """Free balloon floats to ceiling: the faster it rises, the more the air resists, until lift and drag balance."""

    radius: Annotated[float, Param("m", 0.08, 0.3, "balloon")] = 0.15
    gas: Annotated[float, Param("kg/m³", 0.09, 1.1, "density of the gas: hydrogen 0.09, helium 0.18")] = 0.18
    skin: Annotated[float, Param("kg", 0.002, 0.015, "mass of the skin")] = 0.011
    air: Annotated[float, Param("kg/m³", 0.8, 2.5, "density around it: mountains 0.8, carbon dioxide 1.8")] = 1.225
    drag: Annotated[float, Param("1", 0.2, 0.8, "drag coefficient")] = 0.47
    height: Annotated[float, Param("m", 2.0, 3.0, "of the ceiling over the start")] = 2.4
    tilt: Annotated[float, Param("rad", 0.1, 0.5, "of the ceiling, where it is inclined")] = 0.3
    ceiling: Annotated[
        Literal["level", "inclined", "scale"], Choice("a level or an inclined roof, or the disc of a spring scale")
    ] = "level"

    @property
    def balloon(self) -> Balloon:
        """What rises."""
        return Balloon(self.radius, self.skin, self.gas, self.drag, self.air)

    @property
    def rolling(self) -> float:
        """What turning adds to the inertia of the rolling balloon [kg]: I/r²."""
        return self.balloon.spin_inertia / self.radius**2

    @property
    def way(self) -> float:
        """From the start to the ceiling [m]."""
        return self.height - START - self.radius - self.radius / (cos(self.tilt) if self.ceiling == "inclined" else 1.0)

    @property
    def hovers(self) -> bool:
        """Whether it hardly rises."""
        return abs(self.balloon.lift) < HOVERING * self.balloon.mass * g

    def build(self, scene: Scene) -> None:
        """A balloon in its cup, under a glass roof on posts."""
        balloon, r = self.balloon, self.radius
        if balloon.lift < 0 and not self.hovers:
            least = (self.skin / (4 / 3 * pi * (self.air - self.gas))) ** (1 / 3) if self.air > self.gas else np.inf
            raise Refusal("R12", f"radius = {r:.3g} m: {1e3 * balloon.mass:.3g} g in air of {self.air:.3g} kg/m³ sinks "
                          f"(lift {balloon.lift:.2g} N); allowed here: {least:.3g} m or more")  # fmt: skip
        rising = balloon.time_to(self.way)
        if self.ceiling == "inclined" and not self.hovers:
            rising += balloon.time_to(RAMP, sin(self.tilt), self.rolling)
        if rising > 8.0 and not self.hovers:
            raise Refusal("R12", f"radius = {r:.3g} m: lift of {balloon.lift:.2g} N takes {rising:.3g} s; allowed: "
                          f"8 s: a larger balloon, or lighter skin and gas")  # fmt: skip
        part, buoyant = balloon.put(scene, "balloon", (0.0, 0.0, START + r), (0.84, 0.27, 0.22))
        scene.effects.append(Buoyancy((buoyant,), self.air))
        cup = scene.add("cup")
        tube, top = 0.42 * r, r - sqrt(r**2 - (0.42 * r) ** 2)
        cup.body("cup").pos[2] = START
        cup.geom("tube").size[:2], cup.geom("tube").pos[2] = (tube, (START + top) / 2), (top - START) / 2
        cup.geom("hollow").size[0], cup.geom("hollow").pos[2] = 0.9 * tube, top
        cup.geom("foot").size[0], cup.geom("foot").pos[2] = 0.8 * r, 0.01 - START
        for matter in ("cup", "seat"):
            scene.material(cup.name(matter), 900.0, RUBBER)
        scene.touch(part.name("skin"), cup.name("seat"))
        self._roof(scene)
        quick, settling = balloon.pace(), 1.0
        if self.hovers:
            scene.resolve(time=sqrt(self.height / g), length=r, duration=2.0)
            return
        if self.ceiling == "scale":
            self._scale(scene)
            quick, settling = quick / 2, 1.0 + 2 * quick
        # bounces end within twice the time to terminal speed, or so
        scene.resolve(time=quick, length=r, duration=min(max(rising + 2 * balloon.pace() + settling, 4.0), 10.0))

    def _roof(self, scene: Scene) -> None:
        """Level over the cup, or rising along x to a board that stops the balloon."""
        inclined, r = self.ceiling == "inclined", self.radius
        part = scene.add("canopy")
        roof = part.body("roof")
        low, high, wide = (-0.2 - r, RAMP + r, 0.2 + r) if inclined else (-0.3 - r, 0.3 + r, 0.3 + r)
        turn = self.tilt if inclined else 0.0
        above = 0.3 if self.ceiling == "scale" else 0.0
        roof.pos, roof.quat = (0, 0, self.height + above), (cos(turn / 2), 0, -sin(turn / 2), 0)
        middle, half = (low + high) / 2, (high - low) / 2
        for name in ("sheet", "glass", "ridge"):
            part.geom(name).pos[0], part.geom(name).size[0] = middle, half
        for name in ("sheet", "glass"):
            part.geom(name).size[1] = wide
        for name, y in (("left", -wide - 0.02), ("right", wide + 0.02)):
            part.geom(name).pos[:2], part.geom(name).size[0] = (middle, y), half + 0.04
        board = 1.2 * r if inclined else 0.0
        for name, x, deep in (("low", low - 0.02, 0.0), ("stop", high + 0.02, board)):
            geom = part.geom(name)
            geom.pos[0], geom.pos[2], geom.size[1:] = x, 0.02 - deep / 2, (wide, 0.02 + deep / 2)
        for i, (s, y) in enumerate(((low, -wide), (low, wide), (high, -wide), (high, wide))):
            x, side = s * cos(turn), y + (0.02 if y > 0 else -0.02)
            part.geom(f"post{i}").fromto = (x, side, 0, x, side, self.height + above + s * sin(turn))
        for matter in ("roof", "posts", "sheet", "stop"):
            scene.material(part.name(matter), 700.0, RUBBER)
        if self.ceiling != "scale":
            scene.touch("balloon/skin", part.name("sheet"))
        if inclined:
            scene.touch("balloon/skin", part.name("stop"))

    def _scale(self, scene: Scene) -> None:
        """A spring scale through the roof, tared: it reads nothing under the weight of its disc."""
        mass, stiffness, damping = self.balloon.spring
        part = scene.add("dynamometer")
        part.body("housing").pos[2] = self.height
        part.geom("plate").mass, part.geom("plate").size[0] = mass, 0.16
        press = part.joint("press")
        press.stiffness, press.damping, press.springref = [stiffness, 0, 0], [damping, 0, 0], mass * g / stiffness
        for matter, density in (("housing", 7800.0), ("disc", mass / (pi * 0.16**2 * 0.012)), ("plate", 100.0)):
            scene.material(part.name(matter), density, RUBBER)
        scene.touch("balloon/skin", part.name("plate"))
        scene.coil(Coil(part.name("coil"), part.name("housing"), turns=9, radius=0.02, wire=0.0025))

    @observable("m")
    def altitude(self, run: Run) -> Array:
        """Of the balloon's centre above its start."""
        return np.asarray(run.position(BODY)[:, 2] - START - self.radius)

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the balloon's centre (T, 3)."""
        return run.velocity(BODY)

    @observable("N")
    def contact_force(self, run: Run) -> Array:
        """What cup, ceiling and stop press on the balloon with (T, 3), from its change of velocity: what lift and drag
        do not explain. Over a bounce, the mean of the samples around it."""
        v = run.velocity(BODY)
        explained = (
            np.array([0, 0, self.balloon.lift]) - self.balloon.resistance * np.linalg.norm(v, axis=1, keepdims=True) * v
        )
        return np.asarray(self.balloon.inertia * np.gradient(v, run.t, axis=0) - explained)

    def arrival(self, run: Run) -> float:
        """When it meets the ceiling, or the record ends [s]."""
        return min((i.time for i in run.impacts), default=float(run.t[-1]))

    def beside(self, run: Run, **changes: float | str) -> Run:
        """A twin; NotEvaluated if it is refused."""
        try:
            return run.again(**changes)
        except Refusal as why:
            raise NotEvaluated(f"the twin that the law needs is refused ({why})") from None

    def under(self, run: Run, ceiling: str) -> Run:
        """The run, if it has such a ceiling, or a twin that has."""
        if self.hovers:
            raise NotEvaluated("a balloon without lift comes to no ceiling")
        return run if self.ceiling == ceiling else self.beside(run, ceiling=ceiling)

    def flight(self, run: Run) -> tuple[NDArray[np.bool_], Array, Array]:
        """Samples of the rise, their times and heights; NotEvaluated if it is too short to tell v_t from B/m_e."""
        end = self.arrival(run)
        if self.hovers or end < 0.5 * self.balloon.pace():
            raise NotEvaluated(f"{end:.2g} s of rise; needed: {0.5 * self.balloon.pace():.2g} s, half of the time "
                               "in which it comes to its final speed")  # fmt: skip
        mask = between(run.t, 0.0, end, least=20)
        return mask, run.t[mask], self.altitude(run)[mask]

    @law("v_t = √(2 B/(ρ C A)), τ = m_e v_t/B", source="Landau & Lifshitz, Fluid Mechanics, §45 and §11 problem 1",
         within=(2e-5, 2e-6, 2e-7))  # fmt: skip
    def lift_and_drag_come_to_balance(self, run: Run) -> Measurement:
        """30a: final speed and time constant, from the fit of v_t τ ln cosh(t/τ) to the recorded heights."""
        _, t, z = self.flight(run)
        speed, pace = rise(t, z)
        return [speed / self.balloon.terminal(), pace / self.balloon.pace()], [1.0, 1.0]

    @law(
        "z = v_t τ ln cosh(t/τ), v = v_t tanh(t/τ)",
        source="Landau & Lifshitz, Fluid Mechanics, §45 and §11 problem 1",
        within=(5e-6, 5e-7, 5e-8),
    )
    def rises_ever_less_faster(self, run: Run) -> Measurement:
        """30a: height and speed at every instant of the rise, in units of v_t τ and v_t."""
        mask, t, z = self.flight(run)
        speed, u = self.balloon.terminal(), t / self.balloon.pace()
        found = [z / (speed * self.balloon.pace()), self.velocity(run)[mask, 2] / speed]
        return found, [u + np.log1p(np.exp(-2 * u)) - np.log(2), np.tanh(u)]

    @law("N = B", source="Archimedes, On Floating Bodies I, prop. 6", within=(1e-8, 1e-9, 1e-10))
    def leans_against_the_ceiling_with_all_its_lift(self, run: Run) -> Measurement:
        """30b: what a spring scale reads that stands in for the ceiling, k Δx, once the balloon rests under it."""
        one = self.under(run, "scale")
        press, speed = one.joint("dynamometer/press"), one.joint_speed("dynamometer/press")
        late = between(one.t, one.t[-1] - 0.3, np.inf)
        _, stiffness, damping = self.balloon.spring
        away = np.abs(speed[late]).max() * damping / stiffness  # that it still has to go, as slow as it is
        if not away <= STEADY * press[late].min():
            raise NotEvaluated(f"the scale has {away:.2g} m to go; needed: {STEADY:g} of what it reads")
        return stiffness * press[late].mean(), self.balloon.lift

    @law("4 π r³ (ρ - ρ_gas)/3 = m_skin", source="Archimedes, On Floating Bodies I, prop. 5-7",
         within=(1e-3, 1e-3, 1e-3), limited_by="the width of the bracket")  # fmt: skip
    def floats_from_a_certain_size_on(self, run: Run) -> Measurement:
        """30c: the radius at which skin and gas weigh as much as the air: a smaller one stays, a larger one goes."""
        critical = (self.skin / (4 / 3 * pi * max(self.air - self.gas, 1e-9))) ** (1 / 3)
        sizes = cast(Param, self.declarations()["radius"][0])
        if not sizes.low <= critical * (1 - MARGIN) < critical * (1 + MARGIN) <= sizes.high:
            raise NotEvaluated(f"the radius of no lift, {critical:.3g} m, is out of range")

        def goes(radius: float) -> bool:
            twin = run.again(radius=radius)
            return bool(cast(BalloonFloat, twin.specimen).altitude(twin)[-1] > 1e-5)

        return threshold(goes, critical, spread=MARGIN, resolution=2 * MARGIN), critical

    @law("(B + m g)/(B' + m g) = ρ/ρ'", source="Archimedes, On Floating Bodies I, prop. 6", within=(2e-4, 2e-5, 2e-6))
    def lift_is_the_weight_of_the_air_displaced(self, run: Run) -> Measurement:
        """30d: beside a twin in air twice (or about half) as dense; B = m_e z̈ at the start."""
        range_ = cast(Param, self.declarations()["air"][0])
        other = 2 * self.air if 2 * self.air <= range_.high else max(self.air / 2, range_.low)
        twin = self.beside(run, air=other)
        displaced = []
        for one in (run, twin):
            specimen = cast(BalloonFloat, one.specimen)
            balloon = specimen.balloon
            if specimen.hovers:
                raise NotEvaluated(f"in air of {specimen.air:.3g} kg/m³ it hardly rises")
            early = between(one.t, 0.0, min(0.5 * balloon.pace(), specimen.arrival(one)), least=10)
            # z/t² is an even function of time
            start = 2 * fit(one.t[early] ** 2, specimen.altitude(one)[early] / one.t[early] ** 2, 3)
            t2 = one.t[early][0] ** 2
            first = float(start[0] - start[1] * t2 + start[2] * t2**2 - start[3] * t2**3)
            displaced.append(balloon.inertia * first + balloon.mass * g)
        return displaced[0] / displaced[1], self.air / other

    @law("(m_e + I/r²) v̇ = B sin α - ½ ρ C A v²", source="Landau & Lifshitz, Mechanics, §38; Fluid Mechanics, §45",
         within=(5e-4, 5e-5, 5e-6))  # fmt: skip
    def rolls_up_an_inclined_ceiling(self, run: Run) -> Measurement:
        """30b, inclined: speed along the ceiling once the bounces are over and it rolls, to the stop at the top."""
        one = self.under(run, "inclined")
        specimen = cast(BalloonFloat, one.specimen)
        alpha, balloon = self.tilt, self.balloon
        if tan(alpha) * self.rolling / (balloon.inertia + self.rolling) > 0.99 * RUBBER.friction:
            raise NotEvaluated("so steep a ceiling makes the balloon slip")
        stopped = min((i.time for i in one.impacts if "canopy/stop" in (i.first, i.second)), default=one.t[-1])
        hits = [i.time for i in one.impacts if i.time < stopped]
        if not hits:
            raise NotEvaluated("the record ends before the balloon reaches the ceiling")
        up = specimen.velocity(one) @ [cos(alpha), 0.0, sin(alpha)]
        slip = np.abs(up - self.radius * one.spin(BODY)[:, 1] * -1)
        inside = (one.t > hits[-1] + 0.01) & (one.t < stopped)
        rolls = inside & (slip < 1e-6 * balloon.terminal())
        if rolls.sum() < 20:
            raise NotEvaluated(f"{rolls.sum()} samples of rolling before the stop; needed: 20")
        first = int(np.argmax(rolls))
        t = one.t[first:][inside[first:]] - one.t[first]
        speed, pace = balloon.terminal(sin(alpha)), balloon.pace(sin(alpha), self.rolling)
        ahead = up[first] / speed
        # from the speed with which it starts to roll, below the final one or above
        expected = speed * (np.tanh(t / pace) + ahead) / (1 + ahead * np.tanh(t / pace))
        return up[first:][inside[first:]], expected

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        balloon = self.balloon
        lead = (
            f"A balloon of {200 * self.radius:.0f} cm, {1e3 * balloon.mass:.1f} g of skin and gas, is let go from its "
            f"cup in air of {self.air:.2f} kg/m³, of which it displaces {1e3 * self.air * balloon.volume:.1f} g."
        )
        if self.hovers:
            return f"{lead} That is so nearly its own weight that it hangs in the air almost still: a lift of " \
                   f"{1e3 * balloon.lift:.2f} mN moves it by {100 * self.altitude(run)[-1]:.0f} cm in " \
                   f"{run.t[-1]:.0f} s, whatever the ceiling above it may be made of."  # fmt: skip
        reached = balloon.terminal() * sqrt(1 - exp(-2 * self.way / (balloon.terminal() * balloon.pace())))
        ends = {
            "level": f"bounces a little, and rests there, pressed on by its lift of {balloon.lift:.3f} N.",
            "inclined": "bounces a little, and rolls up the slope of the glass to the board at its top.",
            "scale": f"lifts the disc until the scale reads the whole of its lift, {balloon.lift:.3f} N.",
        }
        met = f"After {self.arrival(run):.1f} s it meets the {'scale' if self.ceiling == 'scale' else 'glass roof'} at "
        return (
            f"{lead} It rises ever less faster, as drag grows with the square of its speed towards the lift at "
            f"{balloon.terminal():.2f} m/s. {met}{reached:.2f} m/s, {ends[self.ceiling]}"
        )
