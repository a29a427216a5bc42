"""23: a weight hangs on springs, is pulled down and let go."""

from __future__ import annotations

from math import cos, inf, log, pi, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from phenomena.stands import DRY, gallows, hook
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.measure import peaks, period
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Coil, Part, Scene

Array = NDArray[np.float64]

ALUMINIUM = 2700.0
"""Density of the weight [kg/m³]."""

LINK = 1 / 50
"""Mass of a disc between two springs, as a fraction of the weight's."""

SOLID = 0.3
"""Length of a spring whose windings touch, as a fraction of its free length. Springs are wound open, so that down to
there they push as they pull."""

EYE = 0.032
"""From the top of the weight to where the springs end [m]."""

APART = 0.07
"""Between springs side by side [m]."""

FARTHEST = 0.85
"""Greatest sag under the weight [m]: with more, fewer than five swings fit into ten seconds."""

DEEPEST = 2.2
"""Greatest distance that the weight may go below the hook [m]: more does not fit into a room."""

WEIGHT = "weight/weight"


class SpringStretch(Phenomenon, domain="mechanics"):
    """Spring is stretched: the stiffer the spring and the lighter the weight, the quicker the swing."""

    stiffness: Annotated[float, Param("N/m", 5.0, 1000.0, "of the first spring")] = 25.0
    length: Annotated[float, Param("m", 0.2, 0.5, "of each spring at rest")] = 0.25
    mass: Annotated[float, Param("kg", 0.05, 3.0, "of the weight")] = 0.5
    amplitude: Annotated[float, Param("m", 0.02, 0.2, "by which the weight is pulled down before it is let go")] = 0.12
    damping: Annotated[float, Param("1", 0.0, 0.1, "damping ratio, by friction within the springs")] = 0.0
    springs: Annotated[int, Param("1", 2, 4, "their number, where there are several")] = 3
    ratio: Annotated[float, Param("1", 0.6, 1.6, "stiffness of each spring over that of the one before")] = 1.3
    angle: Annotated[float, Param("rad", 0.05, 0.5, "release from the vertical, where it swings too")] = 0.15
    hung: Annotated[
        Literal["one", "series", "parallel", "swinging"],
        Choice("one spring; several in a row; several side by side; one that also swings like a pendulum"),
    ] = "one"

    @property
    def stiffnesses(self) -> Array:
        """Of the springs [N/m], from the hook down or from left to right."""
        number = self.springs if self.hung in ("series", "parallel") else 1
        return np.asarray(self.stiffness * self.ratio ** np.arange(number))

    @property
    def below(self) -> Array:
        """Masses [kg] at the lower ends of the springs in series: the discs' and, last, the weight's."""
        links = len(self.stiffnesses) - 1 if self.hung == "series" else 0
        return np.array([*[LINK * self.mass] * links, self.mass])

    def modes(self) -> tuple[Array, Array]:
        """ω² [1/s²] of the upright oscillations, slowest first, and their shapes (column by column)."""
        k = self.stiffnesses if self.hung == "series" else np.array([self.stiffnesses.sum()])
        matrix = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
        squares, shapes = eigh(matrix, np.diag(self.below))
        return squares, shapes / shapes[-1]

    @property
    def rate(self) -> float:
        """ω of the slowest upright oscillation without damping [rad/s]."""
        return sqrt(float(self.modes()[0][0]))

    @property
    def sags(self) -> Array:
        """By which the lower ends of the springs lie deeper than at rest, when all hangs still [m]."""
        if self.hung != "series":
            return np.array([self.mass * g / self.stiffnesses.sum()])
        carried = np.cumsum(self.below[::-1])[::-1]
        return np.asarray(np.cumsum(carried * g / self.stiffnesses))

    @property
    def reach(self) -> float:
        """From the hook to the eye of the weight, springs at rest [m]."""
        return self.length * (len(self.stiffnesses) if self.hung == "series" else 1)

    @property
    def excess(self) -> float:
        """Energy above rest with which a swinging weight is let go [J]: ½ k A² + m g R (1 - cos φ)."""
        start = self.reach + self.sags[-1] + self.amplitude + self.arm
        return float(self.stiffness * self.amplitude**2 / 2 + self.mass * g * start * (1 - cos(self.angle)))

    @property
    def size(self) -> float:
        """Radius and half height of the weight [m]."""
        return float((self.mass / (ALUMINIUM * 2 * pi)) ** (1 / 3))

    @property
    def arm(self) -> float:
        """From the weight's eye down to its centre [m]."""
        return self.size + EYE

    def build(self, scene: Scene) -> None:
        """A gallows, the springs, the weight pulled down."""
        self.refuse()
        k, row = self.stiffnesses, self.hung == "parallel"
        height = self.reach + self.sags[-1] + self.amplitude + self.arm + self.size + 0.1
        half = 0.03 + (APART * (len(k) - 1) / 2 if row else 0.0)
        gallows(scene, height + 0.045, half + self.size + 0.17)
        top, weight = hook(scene, height, half_width=half), self.weight(scene, height, half)
        self.links(scene, height)
        across = (np.arange(len(k)) - (len(k) - 1) / 2) * APART if row else np.zeros(len(k))
        for i, stiffness in enumerate(k):
            chained = self.hung == "series"
            start = f"link{i - 1}/middle" if chained and i else self.site(top, "hook", across[i], i)
            end = f"link{i}/middle" if chained and i < len(k) - 1 else self.site(weight, "eye", across[i], i)
            tendon = scene.spec.add_tendon(name=f"spring{i}", rgba=(0, 0, 0, 0))
            tendon.stiffness, tendon.springlength = [float(stiffness), 0, 0], [self.length, self.length]
            # proportional damping: every oscillation of the whole keeps its shape
            tendon.damping = [2 * self.damping * float(stiffness) / self.rate, 0, 0]
            tendon.wrap_site(start)
            tendon.wrap_site(end)
            owner = f"link{i - 1}/link" if chained and i else top.name("hook")
            turns = 11.0
            scene.coil(Coil(tendon.name, owner, turns, 0.021, SOLID * self.length / (2 * turns + 2)))
        fastest = sqrt(float(self.modes()[0][-1]))
        damped = [12 / (2 * self.damping / self.rate * fastest**2)] if self.damping else []
        swings = 2 * pi / self.rate
        scene.resolve(time=min(1.5 / self.rate, 12 / fastest, *damped), length=self.size,
                      duration=float(np.clip(9 * swings, 4.0, 10.0)))  # fmt: skip

    def refuse(self) -> None:
        """What does not fit into a room, and windings that would touch."""
        sag = float(self.sags[-1])
        if sag > FARTHEST:
            raise Refusal("R12", f"{self.label}: a sag of {sag:.3g} m under {self.mass:.3g} kg; allowed: {FARTHEST} m, "
                          f"here a stiffness of {self.stiffness * sag / FARTHEST:.3g} N/m")  # fmt: skip
        deepest = self.reach + sag + self.amplitude + self.arm
        if deepest > DEEPEST:
            raise Refusal("R12", f"{self.label}: the weight hangs {deepest:.3g} m deep; allowed: {DEEPEST} m, here "
                          f"length = {self.length - (deepest - DEEPEST) / self.reach * self.length:.3g} m")  # fmt: skip
        room = sag + (1 - SOLID) * self.reach
        if self.hung == "series":
            shape, free = self.modes()[1][:, 0], (1 - SOLID) * self.length
            rises = np.diff(shape, prepend=0.0)
            room = float(np.min((np.diff(self.sags, prepend=0.0) + free) / rises))
        rise = self.amplitude
        if self.hung == "swinging":
            rise = sqrt(2 * self.excess / self.stiffness)
            highest = 0.5 * self.mass * g * (self.reach + sag + self.arm)
            if self.excess > highest:
                raise Refusal("R12", f"{self.label}: {self.excess:.3g} J would throw the weight up to the hook; "
                              f"allowed: {highest:.3g} J, with a smaller amplitude, stiffness or angle")  # fmt: skip
        if rise > 0.95 * room:
            raise Refusal("R12", f"{self.label}: the weight rises by {rise:.3g} m and the windings touch after "
                          f"{room:.3g} m; allowed: {0.95 * room:.3g} m")  # fmt: skip

    def weight(self, scene: Scene, height: float, half: float) -> Part:
        """The weight, its bar as wide as the springs need, at its start."""
        part, size = scene.add("weight"), self.size
        part.body("weight").pos[2] = height - self.reach - self.arm
        part.geom("weight").size[:2], part.geom("weight").mass = (size, size), self.mass
        part.geom("band").size[0], part.geom("band").size[1] = 1.006 * size, 0.2 * size
        part.geom("neck").fromto = (0, 0, size, 0, 0, size + EYE - 0.01)
        part.geom("bar").pos[2], part.geom("bar").size[1] = size + EYE - 0.006, max(half - 0.01, 0.02)
        part.site("eye").pos[2] = size + EYE
        if self.hung == "swinging":
            part.joint("swing").pos[2] = self.arm + self.reach
            scene.start[part.name("swing")] = self.angle
        else:
            scene.spec.delete(part.joint("swing"))
        scene.start[part.name("stretch")] = -self.sags[-1] - self.amplitude
        scene.material(part.name("weight"), ALUMINIUM, DRY)
        return part

    def links(self, scene: Scene, height: float) -> None:
        """Discs between springs in series, where the slowest oscillation has them when the weight is let go."""
        shape = self.modes()[1][:, 0]
        for i, mass in enumerate(self.below[:-1]):
            part = scene.add("link", f"link{i}")
            part.body("link").pos[2] = height - self.length * (i + 1)
            part.geom("disc").mass = mass
            scene.start[part.name("link")] = -self.sags[i] - self.amplitude * shape[i]
            scene.material(part.name("link"), mass / (pi * 0.026**2 * 0.008), DRY)

    @staticmethod
    def site(part: Part, name: str, y: float, i: int) -> str:
        """A site beside the part's own (that itself, if y = 0); its name."""
        own = part.site(name)
        if y == 0:
            return str(own.name)
        body = part.body({"hook": "hook", "eye": "weight"}[name])
        return str(body.add_site(name=f"{own.name}{i}", pos=(0, y, own.pos[2]), size=(0.003, 0.003, 0.003)).name)

    @observable("m")
    def elongation(self, run: Run) -> Array:
        """Of the springs all together, beyond their free length: from hook to eye."""
        turn = quaternion_matrix(run.quaternion(WEIGHT))
        eye = run.position(WEIGHT) + turn @ np.array([0, 0, self.arm])
        return np.asarray(np.linalg.norm(eye - run.motion.origin[:, run.model.body("hook/hook").id], axis=1)
                          - self.reach)  # fmt: skip

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the weight (T, 3)."""
        return run.velocity(WEIGHT)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Of weight and springs, above rest: kinetic, elastic, and of height; discs between springs are not counted."""
        stretch, height = self.elongation(run), run.position(WEIGHT)[:, 2]
        still = run.motion.origin[0, run.model.body("hook/hook").id, 2] - self.reach - self.sags[-1] - self.arm
        spring = self.mass * g * (stretch**2 / self.sags[-1] - self.sags[-1]) / 2
        return np.asarray(run.kinetic(WEIGHT) + spring + self.mass * g * (height - still))

    def twin(self, run: Run, **changes: float | str) -> tuple[SpringStretch, Run]:
        """The same specimen with some parameters changed, and its run; this one if nothing changes."""
        specimen = SpringStretch.make(**(self.values() | changes))
        if specimen == self:
            return self, run
        try:
            return specimen, run.again(**changes)
        except Refusal as refusal:
            raise NotEvaluated(f"the twin that this law needs is refused: {refusal}") from None

    def upright(self, run: Run) -> tuple[SpringStretch, Run]:
        """This specimen, or a twin on one spring, which does not swing, without damping."""
        return self.twin(run, hung="one" if self.hung == "swinging" else self.hung, damping=0.0)

    def seen(self, run: Run) -> slice:
        """Of the samples, those before friction has made the swings 10⁻⁴ of the first: the rest drowns in round-off."""
        end = np.searchsorted(run.t * self.damping * self.rate, log(1e4))
        return slice(int(end))

    def swing_time(self, run: Run) -> float:
        """Mean period of the upright oscillation [s], over five at least; infinite if it stays away."""
        seen = self.seen(run)
        rising = run.velocity(WEIGHT)[seen, 2]
        try:
            return period(run.t[seen], self.sags[-1] - self.elongation(run)[seen], rising, least=5)
        except NotEvaluated:
            if run.t[-1] < 5.5 * 2 * pi / self.rate:
                raise
            return inf

    @law("Δℓ = Σ mᵢ g/kᵢ (in series), m g/Σ kᵢ (side by side)", source="Hooke, De Potentia Restitutiva (1678)",
         within=(1e-6, 1e-8, 1e-9))  # fmt: skip
    def hangs_lower_by_its_weight_over_the_stiffness(self, run: Run) -> Measurement:
        """23a: the middle between greatest and least elongation; in series each spring carries all that is below."""
        specimen, one = self.upright(run)
        stretch, falling = specimen.elongation(one), -one.velocity(WEIGHT)[:, 2]
        deep, shallow = peaks(one.t, stretch, falling)[1], -peaks(one.t, -stretch, -falling)[1]
        if len(deep) < 3 or len(shallow) < 3:
            return stretch.mean(), specimen.sags[-1]  # it does not swing: then it hangs where it hangs
        return (deep.mean() + shallow.mean()) / 2, specimen.sags[-1]

    @law("T = 2π √(m/k)/√(1 - ζ²), at any amplitude", source="Landau & Lifshitz, Mechanics, §25 eq. 25.3",
         within=(1e-6, 1e-8, 1e-9))  # fmt: skip
    def period_knows_mass_and_stiffness_only(self, run: Run) -> Measurement:
        """23b: here, with half (or twice) the amplitude, and with another mass."""
        specimen, one = self.twin(run, hung="one")
        pairs = [(specimen, one)]
        other = 2 * self.amplitude if self.amplitude < 0.04 else self.amplitude / 2
        lighter = self.mass / 2 if self.mass >= 0.1 else 2 * self.mass
        pairs.append(self.twin(run, hung="one", amplitude=other))
        pairs.append(self.twin(run, hung="one", amplitude=other, mass=lighter))
        measured = [s.swing_time(r) for s, r in pairs]
        return measured, [2 * pi * sqrt(s.mass / s.stiffness) / sqrt(1 - s.damping**2) for s, _ in pairs]

    @law("ln(xₙ/xₙ₊₁) = π c/(m ω_d) = 2π ζ/√(1 - ζ²)", source="Landau & Lifshitz, Mechanics, §25 eq. 25.4",
         within=(1e-4, 1e-6, 1e-8))  # fmt: skip
    def swings_shrink_alike(self, run: Run) -> Measurement:
        """23c: logarithmic decrement of the swings (of a twin with a damping ratio of 0.02, if this one has less)."""
        specimen, one = self.twin(run, hung="one", damping=max(self.damping, 0.02))
        seen = specimen.seen(one)
        falling = -one.velocity(WEIGHT)[seen, 2]
        heights = peaks(one.t[seen], specimen.elongation(one)[seen] - specimen.sags[-1], falling)[1]
        if len(heights) < 3:
            raise NotEvaluated(f"{len(heights)} swings recorded; needed: 3")
        decrement = log(heights[0] / heights[-1]) / (len(heights) - 1)
        return decrement, 2 * pi * specimen.damping / sqrt(1 - specimen.damping**2)

    @law("ω² m = 1/Σ(1/kᵢ) (in series, discs counted), Σ kᵢ (side by side)", within=(1e-6, 1e-8, 1e-9),
         source="Landau & Lifshitz, Mechanics, §23 eq. 23.8")  # fmt: skip
    def in_a_row_they_soften_and_abreast_they_stiffen(self, run: Run) -> Measurement:
        """23d: stiffness from the period of both; in series ω² is the least root of |K - ω² M| = 0."""
        found, expected = [], []
        for hung in ("series", "parallel"):
            try:
                specimen, one = self.twin(run, hung=hung, damping=0.0)
            except NotEvaluated:
                continue
            found.append(self.mass * (2 * pi / specimen.swing_time(one)) ** 2)
            expected.append(self.mass * specimen.slowest() if hung == "series" else specimen.stiffnesses.sum())
        if not found:
            raise NotEvaluated("both the springs in series and those side by side are refused")
        return found, expected

    def slowest(self) -> float:
        """ω² [1/s²] of springs in series with discs between them, from the bottom up.

        Force and place are followed from the weight (which moves by 1) to the hook, which must not move; independent
        of `modes`. A continued fraction: each spring adds its compliance, each disc its inertia.
        """
        square = 1 / (self.mass * np.sum(1 / self.stiffnesses))

        def at_the_hook(square: float) -> float:
            place, force = 1.0, 0.0
            for mass, stiffness in zip(self.below[::-1], self.stiffnesses[::-1], strict=True):
                force += mass * square * place
                place -= force / stiffness
            return place

        for _ in range(50):  # secant steps: the root is simple and the start is good
            step = 1e-6 * square
            slope = (at_the_hook(square + step) - at_the_hook(square - step)) / (2 * step)
            change = at_the_hook(square) / slope
            square -= change
            if abs(change) < 1e-15 * square:
                break
        return float(square)

    @law("½ m v² + ½ k x² + m g z = const.", source="Landau & Lifshitz, Mechanics, §6 (energy)",
         within=(1e-5, 1e-8, 1e-10))  # fmt: skip
    def swing_and_stretch_share_their_energy(self, run: Run) -> Measurement:
        """23e: of a weight that both bobs and swings, above rest, over that of the start."""
        changes: dict[str, float | str] = {"hung": "swinging", "damping": 0.0}
        if self.hung != "swinging":
            gentle = 0.5 * sqrt(self.mass * g / self.stiffness * self.length)
            changes["amplitude"] = min(self.amplitude, max(0.02, gentle))
        specimen, one = self.twin(run, **changes)
        energy = specimen.energy(one)
        return energy / specimen.excess, np.ones(len(one))

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        number = len(self.stiffnesses)
        springs = {
            "one": f"a spring of {self.stiffness:.3g} N/m",
            "swinging": f"a spring of {self.stiffness:.3g} N/m",
            "series": f"{number} springs in a row, the first of {self.stiffness:.3g} N/m",
            "parallel": f"{number} springs side by side, the first of {self.stiffness:.3g} N/m",
        }[self.hung]
        aside = f" and {np.degrees(self.angle):.0f} degrees aside" if self.hung == "swinging" else ""
        stretch = self.elongation(run)
        ends = (
            f"Friction within the spring makes every swing smaller by the same factor; in the end it moves by no more "
            f"than {100 * np.abs(stretch - self.sags[-1])[-run.stride * 30 :].max():.1f} cm."
            if self.damping
            else "Nothing is lost, so it comes back as far every time."
        )
        motion = (
            "bobs up and down while it swings, and the two exchange energy"
            if self.hung == "swinging"
            else f"bobs up and down once in {2 * pi / self.rate:.2f} s, however far it was pulled"
        )
        return (
            f"A red weight of {self.mass:.2g} kg hangs from a wooden frame on {springs}, which it stretches by "
            f"{100 * self.sags[-1]:.1f} cm. It is pulled {100 * self.amplitude:.0f} cm farther down{aside} and let go. "
            f"The spring pulls it back in proportion to its stretch, so that it {motion}. {ends}"
        )
