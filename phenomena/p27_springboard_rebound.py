"""27: a ball drops on a spring board and is thrown up again."""

from __future__ import annotations

from itertools import pairwise
from math import acos, pi, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from phenomena.parts import ball, sphere_mass
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import crossings, peaks
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Coil, Scene

Array = NDArray[np.float64]

RADIUS = 0.05
"""Of the ball [m]."""

THICK = 0.01
"""Half the thickness of the platform's board [m]; that of the others is in their templates."""

FOOT, LEVEL = 0.03, 0.35
"""Heights of the platform's foot and of the other boards [m]."""

SOLID = 0.3
"""Length of the platform's spring when its windings touch, as a fraction of its free length."""

STEEPEST = 0.35
"""Widest angle by which a board may be bent down [rad]."""

QUICKEST = 5000.0
"""Highest natural frequency of a bending board that is worth following [rad/s]."""

NODES = (1 + np.array([-sqrt(3 / 5), 0.0, sqrt(3 / 5)])) / 2
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
"""Gauss' points and weights on (0, 1): the bending of a board is gathered in hinges there, which is exact for the
deflection of its tip under point loads (its curvature is a polynomial of the first degree)."""

SOFT = Surface(friction=0.4)
"""Of ball and board: a hit is plastic, and what throws the ball up is the spring alone."""

BALL = "ball/ball"


class SpringboardRebound(Phenomenon, domain="mechanics"):
    """Object bounces off a spring board."""

    stiffness: Annotated[float, Param("N/m", 200.0, 2e4, "of the board, at its tip where it has one")] = 800.0
    board: Annotated[float, Param("kg", 0.05, 1.0, "of the board")] = 0.16
    length: Annotated[
        float, Param("m", 0.3, 1.0, "of the hinged or bending board, of the platform's spring half of it")
    ] = 0.7
    mass: Annotated[float, Param("kg", 0.1, 2.0, "of the ball, or of the weight at the tip")] = 0.4
    drop: Annotated[float, Param("m", 0.1, 1.2, "height of the ball above the board")] = 0.5
    offset: Annotated[float, Param("1", 0.3, 0.95, "from the hinge or clamp to where the ball hits, over length")] = 0.8
    damping: Annotated[
        float, Param("1", 0.0, 0.1, "damping ratio of the board alone (where it bends, of its quickest bending)")
    ] = 0.0
    kind: Annotated[
        Literal["platform", "hinged", "bending", "loaded"],
        Choice(
            "a board on an upright spring; one on a sprung hinge; one that bends; a bending one with a weight on it"
        ),
    ] = "platform"

    @property
    def together(self) -> float:
        """Mass of ball and platform [kg]."""
        return self.mass + self.board

    @property
    def rate(self) -> float:
        """ω = √(k/M) of ball and platform together [rad/s]."""
        return sqrt(self.stiffness / self.together)

    @property
    def speed(self) -> float:
        """With which the ball hits the board [m/s]."""
        return sqrt(2 * g * self.drop)

    @property
    def free_length(self) -> float:
        """Of the platform's spring [m]."""
        return self.length / 2

    @property
    def sinking(self) -> tuple[float, float, float]:
        """x_s, A and V₁: where ball and platform rest, amplitude [m], speed at the spring's free length [m/s]."""
        rest, own = -self.together * g / self.stiffness, -self.board * g / self.stiffness
        hit = self.mass * self.speed / self.together
        amplitude = sqrt((own - rest) ** 2 + hit**2 / self.rate**2)
        return rest, amplitude, self.rate * sqrt(max(amplitude**2 - rest**2, 0.0))

    @property
    def radius(self) -> float:
        """From the hinge to where the ball hits [m]."""
        return self.offset * self.length

    @property
    def twist(self) -> float:
        """Stiffness of the hinge [N m/rad]."""
        return self.stiffness * self.length**2

    @property
    def lever_mass(self) -> float:
        """What moves where the ball hits a hinged board [kg]: m + I/r²."""
        return self.mass + self.board * self.length**2 / 3 / self.radius**2

    def build(self, scene: Scene) -> None:
        """Board and ball, or board and weight."""
        {"platform": self.rest, "hinged": self.turn, "bending": self.bend, "loaded": self.bend}[self.kind](scene)

    def drop_ball(self, scene: Scene, x: float, top: float, *boards: str) -> None:
        """The ball above a place [m], free to hit the boards and the floor."""
        part = ball(scene, "ball", RADIUS, self.mass / sphere_mass(RADIUS, 1.0), SOFT, (0.84, 0.27, 0.22))
        scene.start[part.name("free")] = (x, 0, top + self.drop + RADIUS, 1, 0, 0, 0)
        scene.material("stage/floor", 2000.0, SOFT)
        for other in (*boards, "stage/floor"):
            scene.touch(part.name("ball"), other)

    def rest(self, scene: Scene) -> None:
        """The platform, at rest under its own weight."""
        rest, amplitude, _ = self.sinking
        room = 0.95 * (1 - SOLID) * self.free_length
        if amplitude - rest > room:
            raise Refusal("R12", f"{self.label}: the board sinks by {amplitude - rest:.3g} m, windings would touch; "
                          f"allowed: {room:.3g} m, with a stiffness of some "
                          f"{1.2 * self.stiffness * ((amplitude - rest) / room) ** 2:.3g} N/m")  # fmt: skip
        part, sag = scene.add("platform"), self.board * g / self.stiffness
        level = FOOT + self.free_length + THICK
        part.body("board").pos[2], part.geom("board").mass = level, self.board
        for side, y in (("left_rod", 0.13), ("right_rod", -0.13)):
            part.geom(side).fromto = (0, y, FOOT, 0, y, level + 0.6 * self.free_length)
        tendon = part.tendon("spring")
        tendon.stiffness, tendon.springlength = [self.stiffness, 0, 0], [self.free_length] * 2
        tendon.damping = [2 * self.damping * sqrt(self.stiffness * self.board), 0, 0]
        turns = 8.0
        wire = SOLID * self.free_length / (2 * turns + 2)
        scene.coil(Coil(part.name("spring"), part.name("base"), turns, 0.045, wire))
        scene.start[part.name("board")] = -sag
        scene.material(part.name("base"), 2700.0, SOFT)
        scene.material(part.name("board"), self.board / (8 * 0.12 * 0.15 * THICK), SOFT)
        self.drop_ball(scene, 0.0, level - sag + THICK, part.name("board"))
        times = 3 / self.rate, 12 * sqrt(self.board / self.stiffness)
        scene.resolve(time=min(times), length=THICK, duration=self.duration)

    @property
    def duration(self) -> float:
        """Of the film [s]: three bounces or so."""
        return float(np.clip(5.5 * sqrt(2 * self.drop / g) + 6 / self.rate, 2.0, 8.0))

    def turn(self, scene: Scene) -> None:
        """The board on its hinge, level but for its own weight."""
        rate = sqrt(self.twist / self.radius**2 / self.lever_mass)
        down = self.mass * self.speed / self.lever_mass / rate / self.radius
        if down > STEEPEST:
            raise Refusal("R12", f"{self.label}: the board turns down by {down:.3g} rad; allowed: {STEEPEST} rad, here "
                          f"a stiffness of {self.stiffness * (down / STEEPEST) ** 2:.3g} N/m")  # fmt: skip
        part = scene.add("hinged_board")
        board, sag = part.body("board"), self.board * g * self.length / 2 / self.twist
        board.pos = (self.length / 2, 0, LEVEL)
        part.geom("board").size[0], part.geom("board").mass = self.length / 2, self.board
        hinge = part.joint("hinge")
        hinge.pos[0], hinge.stiffness = -self.length / 2, [self.twist, 0, 0]
        alone = self.board * self.length**2 / 3
        hinge.damping = [2 * self.damping * sqrt(self.twist * alone), 0, 0]
        scene.start[part.name("hinge")] = sag
        scene.material(part.name("post"), 700.0, SOFT)
        scene.material(part.name("board"), self.board / (8 * self.length / 2 * 0.12 * 0.008), SOFT)
        self.drop_ball(scene, self.radius, LEVEL + 0.008 - sag * self.radius, part.name("board"))
        scene.resolve(time=min(3 / rate, 12 * sqrt(alone / self.twist)), length=THICK, duration=self.duration)

    @property
    def pieces(self) -> tuple[Array, Array]:
        """Ends of the moving pieces of a bending board (4,) [m from the clamp] and stiffness of its hinges (3,)."""
        bending = self.stiffness * self.length**3 / 3  # E I
        return np.append(NODES, 1.0) * self.length, bending / (WEIGHTS * self.length)

    def frequencies(self) -> Array:
        """Natural frequencies of the bending board without ball or weight (3,) [rad/s]."""
        ends, stiffness = self.pieces
        sizes = np.diff(ends)
        masses = self.board * sizes / self.length
        inertia = np.zeros((3, 3))
        for i, mass in enumerate(masses):
            moves = np.where(np.arange(3) <= i, (ends[i] + ends[i + 1]) / 2 - ends[:3], 0.0)
            turns = (np.arange(3) <= i).astype(float)
            inertia += mass * (np.outer(moves, moves) + sizes[i] ** 2 / 12 * np.outer(turns, turns))
        return np.asarray(np.sqrt(eigh(np.diag(stiffness), inertia, eigvals_only=True)))

    def bend(self, scene: Scene) -> None:
        """The clamped board, straight at first; a ball above it, or a weight on its tip."""
        quickest = float(self.frequencies().max())
        if quickest > QUICKEST:
            raise Refusal("R4", f"{self.label}: a board of {self.board:.3g} kg that bends with {quickest:.3g} rad/s; "
                          f"allowed: {QUICKEST:g} rad/s, here a stiffness of "
                          f"{self.stiffness * (QUICKEST / quickest) ** 2:.3g} N/m or a board of "
                          f"{self.board * (quickest / QUICKEST) ** 2:.3g} kg")  # fmt: skip
        slow = sqrt(self.stiffness / (self.mass + 0.24 * self.board))
        hit = 0.0 if self.kind == "loaded" else self.speed
        down = (sqrt(hit**2 + (g / slow) ** 2) + g / slow) / slow * 1.5 / self.length
        if down > STEEPEST:
            raise Refusal("R12", f"{self.label}: the board bends down by some {down:.3g} rad; allowed: {STEEPEST} rad, "
                          f"here a stiffness of {self.stiffness * (down / STEEPEST) ** 2:.3g} N/m")  # fmt: skip
        part = scene.add("cantilever")
        ends, stiffness = self.pieces
        fixed = part.geom("piece0")
        part.body("piece0").pos[0], fixed.size[0] = (ends[0] - 0.16) / 2, (ends[0] + 0.16) / 2
        density = self.board / (self.length * 0.24 * 0.016)
        before = 0.0
        for i, (start, end) in enumerate(pairwise(ends)):
            name, half, centre = f"piece{i + 1}", (end - start) / 2, (start + end) / 2
            part.body(name).pos[0] = centre - before
            part.geom(name).size[0], part.geom(name).mass = half, self.board * 2 * half / self.length
            hinge = part.joint(f"hinge{i + 1}")
            hinge.pos[0], hinge.stiffness = -half, [float(stiffness[i]), 0, 0]
            hinge.damping = [2 * self.damping / quickest * float(stiffness[i]), 0, 0]
            before = centre
        for body in ("post", "piece0", "piece1", "piece2", "piece3"):
            scene.material(part.name(body), 700.0 if body == "post" else density, SOFT)
        # the quickest bending is hardly excited: it has to be stable, not precise
        time = min(3 / slow, 28 / quickest)
        if self.kind == "loaded":
            weight = part.body("load")
            weight.pos[0] = ends[3] - before
            part.geom("load").mass = self.mass
            scene.material(part.name("load"), self.mass / sphere_mass(0.03, 1.0), SOFT)
            scene.resolve(time=time, length=THICK, duration=float(np.clip(12 * 2 * pi / slow, 2.0, 5.0)))
            return
        scene.spec.delete(part.body("load"))
        self.drop_ball(scene, self.radius, LEVEL + 0.008, *(part.name(f"piece{i}") for i in range(4)))
        scene.resolve(time=time, length=THICK, duration=min(self.duration, 2.0))

    @observable("m")
    def deflection(self, run: Run) -> Array:
        """Of the board, downwards from where its spring is at rest; of the tip, where it has one."""
        if self.kind == "platform":
            return -run.joint("platform/board")
        if self.kind == "hinged":
            return np.asarray(self.length * np.sin(run.joint("hinged_board/hinge")))
        half = (self.pieces[0][3] - self.pieces[0][2]) / 2
        turn = quaternion_matrix(run.quaternion("cantilever/piece3"))
        return np.asarray(LEVEL - (run.position("cantilever/piece3") + turn @ np.array([half, 0, 0]))[:, 2])

    @observable("m")
    def height(self, run: Run) -> Array:
        """Of the ball's lowest point above the board's level at rest; where a weight lies on the board, 0."""
        if self.kind == "loaded":
            return np.zeros(len(run))
        level = FOOT + self.free_length + 2 * THICK if self.kind == "platform" else LEVEL + 0.008
        return np.asarray(run.position(BALL)[:, 2] - RADIUS - level)

    def twin(self, run: Run, **changes: float | str) -> tuple[SpringboardRebound, Run]:
        """The same specimen with some parameters changed, and its run; this one if nothing changes."""
        specimen = SpringboardRebound.make(**(self.values() | changes))
        try:
            return (self, run) if specimen == self else (specimen, run.again(**changes))
        except Refusal as refusal:
            raise NotEvaluated(f"the twin that this law needs is refused: {refusal}") from None

    def plain(self, run: Run, board: float | None = None) -> tuple[SpringboardRebound, Run]:
        """On the platform, without damping: this run or a twin, on a stiffer spring if it would be crushed."""
        stiffness, board = self.stiffness, self.board if board is None else board
        changes: dict[str, float | str] = {"kind": "platform", "damping": 0.0, "board": board}
        specimen = SpringboardRebound.make(**(self.values() | changes))
        while specimen.sinking[1] - specimen.sinking[0] > 0.95 * (1 - SOLID) * specimen.free_length:
            stiffness *= 1.5
            if stiffness > 2e4:
                raise NotEvaluated("no spring of the range bears this ball without its windings touching")
            changes["stiffness"] = stiffness
            specimen = SpringboardRebound.make(**(self.values() | changes))
        if specimen.sinking[2] <= 0:
            raise NotEvaluated("the ball is too heavy to be thrown up")
        return self.twin(run, **changes)

    @staticmethod
    def hit(run: Run) -> float:
        """When the ball first hits the board [s]."""
        for impact in run.impacts:
            if "floor" not in impact.first + impact.second:
                return impact.time
        raise NotEvaluated("the ball does not hit the board")

    def leaves(self, run: Run) -> float:
        """When the board is first back where its spring is at rest, and the ball leaves it [s].

        NaN, which fails any law, if the record has ball and board apart before or together well after.
        """
        start = self.hit(run)
        up, rate = -run.joint("platform/board"), -run.joint_speed("platform/board")
        back = [t for t in crossings(run.t, up, rate, rising=False) if t > start]
        if not back:
            raise NotEvaluated("the run ends before the board is back")
        gap = self.height(run) + self.deflection(run)
        pressed = (run.t > start) & (run.t < back[0])
        after = run.t > back[0] + 0.5 * sqrt(self.board / self.stiffness)
        apart = gap[after][0] if after.any() else 1.0
        return float(back[0]) if np.abs(gap[pressed]).max(initial=0.0) < 1e-6 < apart else float("nan")

    @law("x_s - A, A = √((x₀ - x_s)² + V² M/k), V = m v/M", source="Landau & Lifshitz, Mechanics, §21 eq. 21.8",
         within=(1e-3, 1e-4, 1e-5))  # fmt: skip
    def sinks_as_deep_as_the_energy_goes(self, run: Run) -> Measurement:
        """27a: deepest point of the platform after the first, plastic, hit: x_s = -M g/k, x₀ = -m_p g/k."""
        specimen, one = self.plain(run)
        after = one.t > self.hit(one)
        depths = peaks(one.t[after], specimen.deflection(one)[after], -one.joint_speed("platform/board")[after])[1]
        if not len(depths):
            raise NotEvaluated("the run ends before the board is lowest")
        rest, amplitude, _ = specimen.sinking
        return depths[0], amplitude - rest

    @law("h = V₁²/(2 g), V₁ = √(k/M (A² - x_s²))", source="Landau & Lifshitz, Mechanics, §21 eq. 21.5",
         within=(1e-3, 1e-4, 1e-5))  # fmt: skip
    def is_thrown_up_by_the_spring_alone(self, run: Run) -> Measurement:
        """27b: height of the ball above where it leaves the board, here and with another board."""
        other = self.board / 2 if self.board >= 0.1 else 2 * self.board
        found, expected = [], []
        for specimen, one in (self.plain(run), self.plain(run, board=other)):
            after = one.t > specimen.leaves(one)
            heights = peaks(one.t[after], specimen.height(one)[after], one.velocity(BALL)[after, 2])[1]
            if not len(heights):
                if not after.any():
                    return np.nan, 1.0
                raise NotEvaluated("the run ends before the ball is highest")
            found.append(heights[0])
            expected.append(specimen.sinking[2] ** 2 / (2 * g))
        return found, expected

    @law("t = (φ_up - φ_down)/ω, x = x_s + A cos(ω t + φ)", source="Landau & Lifshitz, Mechanics, §21 eq. 21.6",
         within=(1e-3, 1e-4, 5e-5))  # fmt: skip
    def is_pushed_for_most_of_a_swing(self, run: Run) -> Measurement:
        """27c: time from the hit, at x₀ downwards, to leaving, at 0 upwards."""
        specimen, one = self.plain(run)
        rest, amplitude, _ = specimen.sinking
        own = -specimen.board * g / specimen.stiffness
        down, up = acos((own - rest) / amplitude), 2 * pi - acos(-rest / amplitude)
        return specimen.leaves(one) - specimen.hit(one), (up - down) / specimen.rate

    @law("δ = m g ℓ³/(3 E I)", source="Landau & Lifshitz, Theory of Elasticity, §20", within=(5e-3, 3e-3, 3e-3),
         limited_by="the formula is that of small deflections; these are of some 1 %")  # fmt: skip
    def tip_sinks_by_the_load(self, run: Run) -> Measurement:
        """27d: mean deflection of the tip with this weight on it less that with half of it."""
        mass = min(max(self.mass, 0.25), 0.5)
        firm = mass * g / (0.01 * self.length)
        means = []
        for load in (mass, mass / 2):
            # a heavy board is slow; what it weighs drops out
            specimen, one = self.twin(run, kind="loaded", damping=0.0, stiffness=firm, board=1.0, mass=load)
            smooth = np.sin(pi * one.t / one.t[-1]) ** 4  # a window that no swing of the record gets through
            means.append(smooth @ specimen.deflection(one) / smooth.sum())
        return means[0] - means[1], mass / 2 * g / firm

    @law("t = (φ_up - φ_down)/ω, ω² = k_θ/(m r² + I)", within=(1e-2, 5e-3, 3e-3),
         source="Landau & Lifshitz, Mechanics, §21 eq. 21.6; Goldstein §5.1",
         limited_by="small angles: on a turning board the ball rolls and leaves a little off")  # fmt: skip
    def a_hinge_is_softer_farther_out(self, run: Run) -> Measurement:
        """27e: time of the push, at two distances from the hinge of a board of 1 m: k_eff = k_θ/r²."""
        found, expected = [], []
        for offset in (0.9, 0.6):
            specimen, one = self.twin(
                run, kind="hinged", damping=0.0, drop=0.1, offset=offset, length=1.0, stiffness=max(self.stiffness, 2e3)
            )
            start, angle = specimen.hit(one), one.joint("hinged_board/hinge")
            back = [
                t for t in crossings(one.t, angle, one.joint_speed("hinged_board/hinge"), rising=False) if t > start
            ]
            if not back:
                raise NotEvaluated("the run ends before the board is back")
            found.append(back[0] - start)
            moved, r = specimen.lever_mass, specimen.radius
            rate = sqrt(specimen.twist / r**2 / moved)
            own = -specimen.board * g * specimen.length / 2 / specimen.twist * r
            rest = own - specimen.mass * g * r**2 / specimen.twist
            amplitude = sqrt((own - rest) ** 2 + (specimen.mass * specimen.speed / moved / rate) ** 2)
            expected.append((2 * pi - acos(-rest / amplitude) - acos((own - rest) / amplitude)) / rate)
        return np.array(found) / expected, np.ones(2)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        deepest = 100 * self.deflection(run).max()
        if self.kind == "loaded":
            return (
                f"A springy board of {self.length:.2f} m is clamped at one end and bears a red weight of "
                f"{self.mass:.2g} kg on its tip. It is let go while it is straight. The weight bends it down, "
                f"{deepest:.1f} cm at most, and the bent board pushes back: the tip swings about the depth at which "
                "its force equals the weight, which grows with the third power of the board's length."
            )
        where = {
            "platform": f"a board on an upright spring of {self.stiffness:.0f} N/m",
            "hinged": f"a board that a torsion spring holds level, {self.radius:.2f} m from its hinge",
            "bending": f"a springy board that is clamped at one end, {self.radius:.2f} m from there",
        }[self.kind]
        after = run.t > self.hit(run) + 0.5 / self.rate
        high = self.height(run)[after].max(initial=0.0)
        return (
            f"A red ball of {self.mass:.2g} kg drops from a height of {self.drop:.2f} m on {where}. It takes the board "
            f"along without bouncing; the spring gives way by {deepest:.1f} cm, stores the energy and throws the ball "
            f"up again, {max(high, 0.0):.2f} m high. The heavier the board, the more the hit costs, and the lower the "
            "ball rises; it falls back and is thrown up again."
        )
