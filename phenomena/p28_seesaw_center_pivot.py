"""28: a seesaw in balance, and what a third weight, laid or dropped on it, does to that."""

from __future__ import annotations

from math import atan, inf, sin, sqrt
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipk

from phenomena.parts import Rider, Seesaw
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import between, fit, peaks, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

HINGE: Final = "seesaw/hinge"
TILTED: Final = 0.1745
"""Tilt at which a tilted seesaw is let go, 10° [rad]; less where the ground is nearer."""

ROUGH: Final = 0.9
HUNG: Final = 0.25
"""Height of the axle over the plank's middle with which a seesaw of any loads hangs, and does not stand, on it [m]."""

MARGIN: Final = 5e-5
"""A heavy load this much nearer to the axle must rise, this much farther out must sink (of its arm)."""

WATCHED: Final = 3.0
"""How long balance is watched [s]."""


class SeesawCenterPivot(Phenomenon, domain="mechanics"):
    """Objects on a balanced seesaw: equal moments keep it level until a third weight is laid or dropped on it."""

    event: Annotated[
        Literal["dropped", "added", "tilted", "balance"],
        Choice("a third weight falls on the plank, lies on it; or the seesaw is let go tilted, or level"),
    ] = "dropped"
    length: Annotated[float, Param("m", 0.8, 3.0, "plank")] = 2.4
    plank_mass: Annotated[float, Param("kg", 0.5, 5.0, "plank")] = 2.0
    height: Annotated[float, Param("1", 0.2, 0.4, "of the level plank over the ground, in half lengths of it")] = 0.3
    pivot: Annotated[float, Param("m", -0.05, 0.3, "height of the axle over the middle of the plank")] = -0.02
    heavy: Annotated[float, Param("kg", 1.0, 10.0, "heavier load")] = 4.0
    ratio: Annotated[float, Param("1", 1.0, 100.0, "heavier load over lighter, and lighter's arm over heavier's")] = 2.0
    arm: Annotated[float, Param("1", 0.3, 0.9, "of the lighter load, in half lengths of the plank")] = 0.8
    shift: Annotated[float, Param("m", -0.05, 0.05, "of the heavier load, outwards from where it balances")] = 0.0
    weight: Annotated[float, Param("kg", 0.05, 10.0, "third weight, at the end of the heavier load's side")] = 3.0
    drop: Annotated[float, Param("m", 0.1, 1.5, "way it falls")] = 1.2
    density: Annotated[float, Param("kg/m³", 600.0, 21300.0, "loads and weight")] = 700.0
    friction: Annotated[float, Param("1", 0.0, 0.9, "of all surfaces")] = 0.6

    @classmethod
    def sample(cls, rng: np.random.Generator, **fixed: Any) -> Self:
        """A random specimen; in balance unless a shift is given."""
        return super().sample(rng, **({"shift": 0.0} | fixed))

    @property
    def seesaw(self) -> Seesaw:
        """The plank on its axle."""
        return Seesaw(self.length, self.plank_mass, self.height * self.length / 2, self.pivot)

    @property
    def light_arm(self) -> float:
        """Of the lighter load [m]."""
        return self.arm * self.length / 2

    @property
    def heavy_arm(self) -> float:
        """Of the heavier load in balance, m₂ = m₁ d₁/d₂ [m]."""
        return self.light_arm / self.ratio

    @property
    def loads(self) -> list[Rider]:
        """The lighter load, on the side of +x, and the heavier one."""
        cube = self.seesaw.cube
        light = cube(self.heavy / self.ratio, self.density, self.light_arm)
        return [light, cube(self.heavy, self.density, -self.heavy_arm - self.shift)]

    @property
    def third(self) -> Rider:
        """The third weight where it lies or lands."""
        half = self.seesaw.cube(self.weight, self.density, 0.0).half
        return self.seesaw.cube(self.weight, self.density, half + 0.02 - self.length / 2)

    @property
    def riders(self) -> list[Rider]:
        """What lies on the plank from the start."""
        return [*self.loads, self.third] if self.event == "added" else self.loads

    @property
    def tilt(self) -> float:
        """At the start [rad]."""
        return min(TILTED, self.seesaw.lying(-1) / 2) if self.event == "tilted" else 0.0

    def build(self, scene: Scene) -> None:
        """The seesaw, two loads on it, and a third weight on or over the end of the heavier one's side."""
        self._check_room()
        self.seesaw.lying(1)
        surface = Surface(friction=self.friction)
        scene.material("stage/floor", 2400.0, Surface(friction=self.friction, restitution=0.4))
        self.seesaw.place(scene, self.tilt, surface)
        parts = [
            self.seesaw.lay(scene, name, load, self.tilt, surface, colour)
            for name, load, colour in zip(
                ("light", "heavy"), self.loads, ((0.94, 0.76, 0.28), (0.17, 0.58, 0.62)), strict=True
            )
        ]
        if self.event in ("dropped", "added"):
            above = self.drop if self.event == "dropped" else 0.0
            parts.append(self.seesaw.lay(scene, "third", self.third, 0.0, surface, (0.84, 0.27, 0.22), above=above))
        scene.touch(*(part.name("block") for part in parts))
        watch = {"dropped": 5.0, "balance": 2.0 if self.shift else WATCHED + 0.1}.get(self.event, 3.0)
        scene.resolve(time=0.8 * sqrt(self.length / g), length=min(r.half for r in self.riders), duration=watch)

    def _check_room(self) -> None:
        light, heavy = self.loads
        half = self.length / 2
        if light.x + light.half > half:
            raise Refusal("R1", f"arm = {self.arm:.4g}: the lighter load stands out over the end of the plank; "
                          f"allowed: {1 - light.half / half:.4g}")  # fmt: skip
        gap = light.x - light.half - heavy.x - heavy.half
        if gap < 0:
            raise Refusal("R1", f"arm = {self.arm:.4g}: the loads overlap by {-gap:.3g} m; "
                          f"allowed: {self.arm - gap / (1 + 1 / self.ratio) / half:.4g} or more")  # fmt: skip
        gap = heavy.x - heavy.half - self.third.x - self.third.half
        if gap < 0:
            raise Refusal("R1", f"arm = {self.arm:.4g}: no room for the third weight beside the heavier load; "
                          f"allowed: {self.arm + gap * self.ratio / half:.4g}")  # fmt: skip

    @observable("rad")
    def tilting(self, run: Run) -> Array:
        """Tilt of the plank, positive with the lighter load up (T,)."""
        return run.joint(HINGE)

    @observable("rad/s")
    def turning(self, run: Run) -> Array:
        """Angular velocity of the plank (T,)."""
        return run.joint_speed(HINGE)

    @observable("m")
    def heights(self, run: Run) -> Array:
        """Of the centres of the lighter and the heavier load over the ground (T, 2)."""
        return np.column_stack([run.position(f"{name}/block")[:, 2] for name in ("light", "heavy")])

    @observable("m/s")
    def climbing(self, run: Run) -> Array:
        """Upward velocities of the lighter and the heavier load (T, 2)."""
        return np.column_stack([run.velocity(f"{name}/block")[:, 2] for name in ("light", "heavy")])

    def staged(self, run: Run, **changes: Any) -> tuple[SeesawCenterPivot, Run]:
        """The specimen with these changes, in balance otherwise, and its run: this one, or a twin."""
        there = self.make(**(self.values() | {"shift": 0.0} | changes))
        return there, run if there == self else run.again(**({"shift": 0.0} | changes))

    def rough(self, run: Run, **changes: Any) -> tuple[SeesawCenterPivot, Run]:
        """As `staged`, with friction enough to hold what lies on the plank, if this specimen has less."""
        there = self.make(**(self.values() | {"shift": 0.0} | changes))
        if there.seesaw.holds(there.tilt, 0.0, there.riders, 0.8 * self.friction):
            return self.staged(run, **changes)
        return self.staged(run, **changes, friction=ROUGH)

    def start(self, run: Run, longest: float) -> Array:
        """Tilt of the samples in the first `longest` seconds, less where a load slips or something strikes."""
        first = min([i.time for i in run.impacts], default=inf)
        tilt, rate = self.seesaw.swing(self.tilt, self.riders, run.t[run.t <= longest])
        held = self.seesaw.holds(tilt, rate, self.riders, self.friction)
        count = len(held) if held.all() else int(np.argmin(held))
        mask = run.t[:count] < first
        if mask.sum() < 12:
            raise NotEvaluated(f"loads are held for {mask.sum()} samples; needed: 12")
        return run.joint(HINGE)[:count][mask]

    def release(self, run: Run) -> float:
        """Angular acceleration at the start, by a fit of even powers over the first moments [rad/s²]."""
        tilt = self.start(run, 0.22 * sqrt(self.length / g))
        return float(2 * fit(run.t[: len(tilt)] ** 2, tilt, 3)[1])

    @law("m₁ d₁ = m₂ d₂ ⇒ θ = 0", source="Archimedes, On the Equilibrium of Planes I, propositions 6 and 7",
         within=(1e-4, 1e-4, 1e-4), limited_by="the width of the bracket")  # fmt: skip
    def equal_moments_balance(self, run: Run) -> Measurement:
        """28a: arm at which the heavier load neither rises nor sinks, over d₂ = m₁ d₁/m₂; and, there, the tilt [rad]
        for three seconds."""
        true: SeesawCenterPivot = run.specimen

        def sinks(arm: float) -> bool:
            _, twin = self.staged(run, event="balance", shift=arm - true.heavy_arm)
            return bool(twin.joint(HINGE)[-1] > 0)

        found = threshold(sinks, self.heavy_arm, spread=MARGIN, resolution=2.1 * MARGIN)
        _, level = self.staged(run, event="balance")
        still = between(level.t, -1.0, WATCHED)
        return [found / self.heavy_arm, np.abs(level.joint(HINGE)[still]).max()], [1.0, 0.0]

    @law("I θ̈ = -g [Σ mᵢ xᵢ cos θ - Σ mᵢ zᵢ sin θ] = -∂V/∂θ", within=(1e-4, 1e-5, 1e-6),
         source="Landau & Lifshitz, Mechanics, §34 eq. 34.3; Goldstein, Classical Mechanics, §1.2")  # fmt: skip
    def heights_count_at_a_tilt(self, run: Run) -> Measurement:
        """28a: acceleration of the seesaw let go at 10°, its loads in balance when level (a twin)."""
        there, twin = self.rough(run, event="tilted")
        return there.release(twin), there.seesaw.acceleration(there.tilt, there.riders)

    @law("θ̈ = δm g d/I", source="Landau & Lifshitz, Mechanics, §34 eq. 34.3", within=(1e-4, 1e-5, 1e-6))
    def a_third_weight_tips_it(self, run: Run) -> Measurement:
        """28b: acceleration from level with the third weight lying on the plank (a twin)."""
        there, twin = self.rough(run, event="added")
        inertia, _, _ = there.seesaw.moments(there.riders)
        return there.release(twin), -there.weight * g * there.third.x / inertia

    def hung(self, run: Run) -> tuple[SeesawCenterPivot, Run]:
        """A twin that hangs on its axle, with a third weight that tilts it by 0.05 rad at most."""
        changes = {"event": "added", "pivot": HUNG, "friction": ROUGH}
        there = self.make(**(self.values() | changes | {"weight": 0.05, "shift": 0.0}))
        try:
            there.seesaw.lying(1)
        except Refusal as why:
            raise NotEvaluated(f"hung on a higher axle: {why}") from None
        _, _, out = there.seesaw.moments(there.riders)
        weight = min(self.weight, max(0.05 * -out / (self.length / 2), 0.05))
        there, twin = self.staged(run, **changes, weight=weight)
        _, along, out = there.seesaw.moments(there.riders)
        low = sin(2 * atan(abs(along / out)))
        if low > 0.95 * self.height:
            raise NotEvaluated(f"an end of the plank swings down to the ground, {low / self.height:.2g} times as deep")
        return there, twin

    @law("T = 4 √(I/(M g h)) K(sin² θ₀/2), tan θ₀ = δm d/(M h)", within=(1e-4, 1e-5, 1e-6),
         source="Landau & Lifshitz, Mechanics, §11 problem 1; §32 problem 3 (compound pendulum)")  # fmt: skip
    def a_hanging_seesaw_swings(self, run: Run) -> Measurement:
        """28c: period, from the first turning point, of a twin whose centre of mass is h below the axle."""
        there, twin = self.hung(run)
        when, _ = peaks(twin.t, twin.joint(HINGE), twin.joint_speed(HINGE))
        if not len(when):
            raise NotEvaluated("no turning point within the run")
        inertia, along, out = there.seesaw.moments(there.riders)
        return 2 * when[0], 4 * sqrt(inertia / (g * np.hypot(along, out))) * ellipk(np.sin(atan(along / out) / 2) ** 2)

    @law("tan θ = δm d/(M h)", source="Landau & Lifshitz, Mechanics, §34 eq. 34.3, with no torque in equilibrium",
         within=(1e-4, 1e-5, 1e-6))  # fmt: skip
    def a_hanging_seesaw_comes_to_a_tilt(self, run: Run) -> Measurement:
        """28c: tangent of the tilt midway between the turning points, from level up and back (the same twin)."""
        there, twin = self.hung(run)
        tilt = twin.joint(HINGE)
        _, highest = peaks(twin.t, tilt, twin.joint_speed(HINGE))
        if not len(highest):
            raise NotEvaluated("no turning point within the run")
        _, _, out = there.seesaw.moments(there.riders)
        return np.tan((tilt[0] + highest[0]) / 2), there.weight * there.third.x / out

    @law("ω = m √(2 g H) d/(I + m d² + m₂ d₂²), v₂ = ω d₂", source="Routh, Dynamics of a System of Rigid "
         "Bodies I, §§169-171: plastic impact", within=(3e-3, 2e-3, 1e-3),
         limited_by="the loads may begin to slip at once: the velocity is read over the first 50 ms")  # fmt: skip
    def a_dropped_weight_launches_the_other_load(self, run: Run) -> Measurement:
        """28d: angular velocity of the plank and upward velocity of the lighter load right after the third weight has
        landed. The heavier load is left behind; inertias include those of extended loads."""
        there, twin = self.staged(run, event="dropped")
        speed, light, third = sqrt(2 * g * self.drop), there.loads[0], there.third
        inertia, _, _ = there.seesaw.moments([light, third])
        omega = -third.mass * speed * third.x / inertia
        there.check_landing(omega, speed)
        when = next((i.time for i in twin.impacts if "third/block" in (i.first, i.second)), None)
        if when is None:
            raise NotEvaluated("the third weight has not landed")
        # the plank leaves the heavier load, which falls after it
        caught = when + 2 * omega * (there.heavy_arm - there.loads[1].half) / g
        later = min([caught, *(i.time for i in twin.impacts if i.time > when + 1e-9)])
        after = between(twin.t, when, min(when + 0.05, later - 1e-3), least=6)
        t = twin.t[after]
        rates = np.column_stack([twin.joint_speed(HINGE), twin.velocity("light/block")[:, 2] / light.x])[after]
        path = fit(t, rates, 3)
        lag = when - t[0]
        return path[0] + path[1] * lag + path[2] * lag**2 + path[3] * lag**3, [omega, omega]

    def check_landing(self, omega: float, speed: float) -> None:
        """NotEvaluated if the impact leaves something else than plank, third weight and lighter load turning as one."""
        light, heavy = self.loads
        if heavy.x + heavy.half > 0:
            raise NotEvaluated("the heavier load stands across the axle")
        for body, push in ((light, omega * light.x), (self.third, speed + omega * self.third.x)):
            drag, turn = omega * abs(body.z), body.inertia / body.mass * omega + omega * abs(body.z) * body.half
            if drag > self.friction * push or turn > body.half * push:
                raise NotEvaluated("a load slips or turns over when the third weight lands")

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        light = self.heavy / self.ratio
        start = (
            f"A seesaw {self.length:.1f} m long carries a teal block of {self.heavy:.2g} kg and a yellow one of "
            f"{light:.2g} kg, {self.ratio:.3g} times as far from the axle: equal moments, so that it is in balance."
        )
        highest = float(run.position("light/block")[:, 2].max() - run.position("light/block")[0, 2])
        most = np.degrees(np.abs(run.joint(HINGE)).max())
        return start + {
            "dropped": f" After {sqrt(2 * self.drop / g):.1f} s a red weight of {self.weight:.2g} kg lands on the "
            f"teal block's end. Its momentum turns the plank, and the yellow block is thrown {highest:.2f} m upwards.",
            "added": f" But a red weight of {self.weight:.2g} kg lies at the teal block's end: the plank tips towards "
            f"it, ever faster, by up to {most:.0f} degrees, lifting the yellow block by {highest:.2f} m.",
            "tilted": f" Let go at a tilt of {np.degrees(self.tilt):.0f} degrees it is not: the centre of mass is "
            f"{'below' if self.seesaw.moments(self.loads)[2] < 0 else 'above'} the axle, and the plank turns "
            f"{'back towards the level' if self.seesaw.moments(self.loads)[2] < 0 else 'on until its end is down'}.",
            "balance": f" Let go level it stays level: in {run.t[-1]:.0f} s it turns by less than "
            f"{max(most, 0.01):.2g} degrees, although nothing but the axle holds the plank and the blocks only lie "
            "on it.",
        }[self.event]  # fmt: skip
