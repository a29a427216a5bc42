"""16: a pillar that speeds up or slows down: its paddles strike harder and harder, or seats rise from it."""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from phenomena.pillars import AXLE, SEATS, WIDEST, NearPillar, angular_momentum, first_impact
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Refusal, law
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.measure import around, between
from physinone_mj.run import Run
from physinone_mj.scene import Motor, Scene

Array = NDArray[np.float64]

TOP: Final = 8.0
"""Angular velocity at which the motor stops to accelerate [rad/s]; slowing down it stops at rest."""

LEAST: Final = 0.2
"""Slowest acceleration that makes a difference [rad/s²]."""

SLOWEST: Final = 0.5
"""From which there is something to slow down [rad/s]."""


class AccelPanelSpin(NearPillar, domain="mechanics"):
    """Objects near an acceleratingly rotating pillar: paddles strike ever harder, seats of a carousel rise."""

    near: Annotated[Literal["balls", "seats"], Choice("what is near: balls on the floor, or seats on hangers")] = (
        "seats"
    )
    drive: Annotated[
        Literal["prescribed", "torque"], Choice("a motor holds Ω₀ + α t, or a constant torque turns a free axle")
    ] = "prescribed"
    initial: Annotated[float, Param("rad/s", 0.0, 6.0, "first angular velocity")] = 0.5
    alpha: Annotated[float, Param("rad/s²", -6.0, 6.0, "acceleration until 8 rad/s, or rest, is reached")] = 1.0
    torque: Annotated[float, Param("N m", 0.1, 2.0, "constant torque, in the sense of the acceleration")] = 1.0

    @property
    def ends(self) -> tuple[float, float]:
        """When the motor stops to accelerate [s], and at which speed [rad/s]."""
        last = TOP if self.alpha > 0 else 0.0
        return (last - self.initial) / self.alpha, last

    def omega(self, t: ArrayLike) -> Array:
        """Angular velocity that a motor is to give the pillar [rad/s]."""
        return np.asarray(self.initial + self.alpha * np.minimum(t, self.ends[0]))

    def phase(self, t: ArrayLike) -> Array:
        """Angle that it is to have turned by [rad]."""
        stop, last = self.ends
        ramp = np.minimum(t, stop)
        return np.asarray(self.initial * ramp + self.alpha * ramp**2 / 2 + last * (np.asarray(t) - ramp))

    def when(self, angle: float) -> float:
        """Time at which it has turned by an angle [s]; infinite if it never does."""
        stop, last = self.ends
        whole = float(self.phase(stop))
        if angle > whole:
            return stop + (angle - whole) / last if last else inf
        return 2 * angle / (self.initial + sqrt(max(self.initial**2 + 2 * self.alpha * angle, 0.0)))

    @property
    def pull(self) -> float:
        """Torque on a free axle, with its sign [N m]."""
        return self.torque if self.alpha > 0 else -self.torque

    @property
    def tilt(self) -> float:
        """First angle of the seats, that of steady rotation [rad]."""
        return self.carousel.steady(self.initial)

    @property
    def watch(self) -> float:
        """How long the scene lasts [s]."""
        if self.drive == "torque":
            inertia = self.inertia + float(self.carousel.inertia(self.tilt))
            return min(max((TOP - self.initial) * inertia / self.torque, 3.0), 6.0)
        if self.near == "seats":
            return 6.0
        last = self.when(self.turns[1])
        return min(max(5.0, last + 2.0), 10.0) if last < inf else 5.0

    @property
    def fastest(self) -> float:
        """Highest angular velocity in a scene [rad/s]."""
        if self.drive == "torque":
            inertia = self.inertia + (float(self.carousel.inertia(0.0)) if self.near == "seats" else 0.0)
            return self.initial + self.torque * self.watch / inertia
        return max(self.initial, float(self.omega(self.watch)))

    def build(self, scene: Scene) -> None:
        """A pillar on a motor, or under a torque, and what is near it."""
        if abs(self.alpha) < LEAST:
            raise Refusal("R12", f"alpha = {self.alpha:.4g} rad/s² is no acceleration to speak of; "
                          f"allowed: {LEAST if self.alpha >= 0 else -LEAST:g} rad/s²")  # fmt: skip
        if self.alpha < 0 and self.initial < SLOWEST:
            raise Refusal("R12", f"initial = {self.initial:.4g} rad/s leaves nothing to slow down; "
                          f"allowed: {SLOWEST:g} rad/s")  # fmt: skip
        if self.near == "seats":
            self.seats(scene, self.tilt)
            time = min(sqrt(self.hanger / g), 1.5 / self.fastest)
        else:
            self.balls(scene)
            soonest = self.when(self.turns[0])
            time = self.strike_time(float(self.omega(soonest)) if soonest < inf else self.initial)
        scene.speed[AXLE] = self.initial
        if self.drive == "prescribed":
            stop, last = self.ends
            scene.motors.append(Motor(AXLE, ((0.0, self.initial), (stop, last)) if stop > 0 else ((0.0, last),)))
        else:
            scene.control["pillar/drive"] = self.pull
        scene.resolve(time=time, length=self.arm if self.near == "seats" else self.radius, duration=self.watch)

    def staged(self, run: Run, **changes: Any) -> tuple[AccelPanelSpin, Run]:
        """The specimen with these changes, and its run: this one, or a twin."""
        there = self.make(**(self.values() | changes))
        return there, run if there == self else run.again(**changes)

    def swinging(self, run: Run) -> NDArray[np.bool_]:
        """Mask (T,) of the samples before a seat comes to one of its stops."""
        theta = run.joint("pillar/hang0")
        stopped = (theta > WIDEST - 0.01) | (theta < self.carousel.inward + 0.01)
        return between(run.t, -1.0, run.t[int(np.argmax(stopped))] if stopped.any() else inf, least=12)

    @law("θ̈ = Ω(t)² (a/ℓ + sin θ) cos θ - (g/ℓ) sin θ - c θ̇/(m ℓ²), of a ball: (1 + ⅖ r²/ℓ²) θ̈",
         source="Landau & Lifshitz, Mechanics, §39 eq. 39.9; §32 (inertia of a ball)", unit="rad",
         within=(3e-4, 3e-5, 3e-6))  # fmt: skip
    def seats_rise_and_overshoot(self, run: Run) -> Measurement:
        """16a: angle of all seats at every sample, against the equation's solution (a twin, if need be)."""
        there, twin = self.staged(run, near="seats", drive="prescribed")
        carousel, part = there.carousel, there.swinging(twin)
        found = solve_ivp(
            lambda t, y: (y[1], float(carousel.swing(y[0], y[1], there.omega(t)))), (0.0, float(twin.t[part][-1])),
            (there.tilt, 0.0), method="DOP853", t_eval=twin.t[part], rtol=1e-10, atol=1e-11,
        )  # fmt: skip
        seen = np.array([twin.joint(f"pillar/hang{k}")[part] for k in range(SEATS)])
        return seen, np.tile(found.y[0], (SEATS, 1))

    @law("Ω = Ω₀ + α t, φ = Ω₀ t + ½ α t²", source="Galilei, Discorsi (1638), third day, theorems I-II",
         within=(2e-4, 2e-5, 1e-6))  # fmt: skip
    def speed_grows_evenly(self, run: Run) -> Measurement:
        """16b: angular velocity and angle turned by at every sample, until the motor stops to accelerate and after."""
        there, twin = self.staged(run, drive="prescribed")
        omega, phase = there.omega(twin.t), there.phase(twin.t)
        return (
            [twin.joint_speed(AXLE) / omega.max(), twin.joint(AXLE) / phase.max()],
            [omega / omega.max(), phase / phase.max()],
        )

    @law("(I + Σ m r²) Ω̇ + d/dt(Σ m r²) Ω = τ: L = L₀ + τ t", within=(1e-10, 1e-10, 1e-10),
         source="Landau & Lifshitz, Mechanics, §34 eq. 34.3")  # fmt: skip
    def torque_becomes_angular_momentum(self, run: Run) -> Measurement:
        """16c: of a freely turning pillar and its seats together, at every sample (a twin, if need be)."""
        there, twin = self.staged(run, near="seats", drive="torque")
        start = (self.inertia + float(self.carousel.inertia(self.tilt))) * self.initial
        return angular_momentum(twin), start + there.pull * twin.t

    @law("(I + Σ m r(θ)²) Ω = L₀ + τ t, with θ(t) of the seats", within=(1e-6, 1e-7, 1e-8),
         source="Landau & Lifshitz, Mechanics, §34 eq. 34.3; §39 eq. 39.9")  # fmt: skip
    def seats_that_rise_hold_the_pillar_back(self, run: Run) -> Measurement:
        """16c: angular velocity of the free pillar, against the solution of both equations together (the same run)."""
        there, twin = self.staged(run, near="seats", drive="torque")
        part = there.swinging(twin)
        _, omega = there.carousel.spun(self.inertia, there.pull, there.tilt, self.initial, twin.t[part])
        return twin.joint_speed(AXLE)[part], omega

    @law("v' = (1+e) Ω(t) r_c at Ω₀ t + ½ α t² = φ - asin((d + r)/R)", within=(1e-7, 1e-7, 1e-7),
         source="Newton, Principia, Axioms, corollaries 3 and 6", limited_by="the instant of an impact is located to a "
         "nanometre")  # fmt: skip
    def paddles_strike_harder_and_harder(self, run: Run) -> Measurement:
        """16d: when the balls are struck, and their speeds then (the second's, if nothing has struck it before)."""
        there, twin, whole = self.hits(run)
        times, speeds, due, expected = [], [], [], []
        for k in range(whole):
            hit = first_impact(twin, f"ball{k}/ball")
            times.append(hit)
            speeds.append(float(np.linalg.norm(around(twin, f"ball{k}/ball", hit)[1])))
            due.append(there.when(there.turns[k]))
            expected.append((1 + self.restitution) * float(there.omega(due[-1])) * there.lever)
        scale = np.repeat([due[0], expected[0]], whole)
        return np.array([*times, *speeds]) / scale, np.array([*due, *expected]) / scale

    def hits(self, run: Run) -> tuple[AccelPanelSpin, Run, int]:
        """A run in which a driven paddle strikes balls at rest, speeding up if it would stop before it comes to them;
        how many of the two are struck with nothing else having touched them before."""
        up = {} if self.when(self.turns[0]) < 10.0 else {"alpha": -self.alpha}
        there = self.make(**(self.values() | up))
        slowest = float(there.omega(there.when(there.turns[0])))
        smooth = {} if self.clear((1 + self.restitution) * slowest * self.lever) else {"floor_friction": 0.0}
        there, twin = self.staged(run, near="balls", drive="prescribed", **up, **smooth)
        due = [there.when(turn) for turn in there.turns]
        whole = 0
        for k in range(2):
            gentle = due[k] > twin.t[-1] - 0.05 or there.too_gentle(twin, float(there.omega(due[k])) * self.lever)
            if gentle or first_impact(twin, f"ball{k}/ball") < due[k] - 1e-3:
                break
            whole += 1
        if not whole:
            raise NotEvaluated("no ball at rest is struck, or so gently that it counts as struck without rebound")
        return there, twin, whole

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        end = float(run.joint_speed(AXLE)[-1])
        kind = "speeds up" if self.alpha > 0 else "slows down"
        how = (
            f"under a constant torque of {self.torque:.2g} N m" if self.drive == "torque"
            else f"by {abs(self.alpha):.1f} rad/s every second"
        )  # fmt: skip
        turns = f"A striped pillar that turns at {self.initial:.1f} rad/s {kind} {how}"
        if self.near == "seats":
            theta = np.degrees(run.joint("pillar/hang0"))
            return (
                f"{turns}. Four seats hang from its arms on hangers of {self.hanger:.2f} m, at first at {theta[0]:.0f} "
                f"degrees from the vertical. The seats follow the pillar's speed, but, being inert, late and with "
                f"swings beyond it: they reach {theta.max():.0f} degrees, and after {run.t[-1]:.0f} s, with the pillar "
                f"at {end:.1f} rad/s, they are at {theta[-1]:.0f} degrees."
            )
        hits = len(self.strikes(run))
        return (
            f"{turns}, with {self.paddles} paddle{'s' if self.paddles > 1 else ''} of {self.paddle:.2f} m, over a "
            f"floor on which a red and a blue ball of {self.mass:.2g} kg lie in reach. A paddle knocks each away at "
            f"(1+e) times the speed it has itself by then, so that one is struck harder than the other: {hits} strikes "
            f"in {run.t[-1]:.0f} s. The pillar ends at {end:.1f} rad/s."
        )
