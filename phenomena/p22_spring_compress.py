"""A spring is compressed by what runs into it or drops on it, and pushes it back."""

from __future__ import annotations

from math import asin, exp, pi, sqrt
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import peaks
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Coil, Part, Scene, free_pose

PLATE = 0.012
"""Thickness of the plate [m]."""

NOSE = 0.075
"""From the glider's centre to the tip of its nose [m]."""

BALL = 0.04
"""Radius of the ball [m]."""

SOLID = 0.3
"""Length of the spring when its windings touch, as a fraction of its free length."""

RIDER = {"horizontal": "glider/glider", "vertical": "ball/ball"}


class SpringCompress(Phenomenon, domain="mechanics"):
    """Spring is compressed."""

    stiffness: Annotated[float, Param("N/m", 20.0, 5000.0, "of the spring")] = 60.0
    length: Annotated[float, Param("m", 0.15, 0.5, "of the spring at rest")] = 0.3
    mass: Annotated[float, Param("kg", 0.05, 5.0, "of what runs into it")] = 0.6
    speed: Annotated[float, Param("m/s", 0.2, 4.0, "of the glider")] = 0.6
    drop: Annotated[float, Param("m", 0.0, 1.0, "height of the ball above the plate")] = 0.1
    damping: Annotated[float, Param("1", 0.0, 0.2, "damping ratio with the body on the plate")] = 0.0
    plate: Annotated[float, Param("kg", 0.005, 0.5, "of the plate")] = 0.03
    way: Annotated[
        Literal["horizontal", "vertical"], Choice("a glider runs into it, or a ball drops on it")
    ] = "horizontal"

    @property
    def together(self) -> float:
        """Mass of body and plate [kg]."""
        return self.mass + self.plate

    @property
    def rate(self) -> float:
        """ω = √(k/M) of body and plate together [rad/s]."""
        return sqrt(self.stiffness / self.together)

    @property
    def travel(self) -> float:
        """By which the spring can be compressed until its windings touch [m]."""
        return (1 - SOLID) * self.length

    @property
    def sag(self) -> float:
        """Of the plate under its own weight [m]."""
        return self.plate * g / self.stiffness if self.way == "vertical" else 0.0

    @property
    def hit(self) -> float:
        """Common speed just after the plastic impact [m/s]: m v/(m + m_p)."""
        before = self.speed if self.way == "horizontal" else sqrt(2 * g * self.drop)
        return before * self.mass / self.together

    @property
    def deepest(self) -> float:
        """Greatest compression [m], without damping: energy from just after the impact."""
        if self.way == "horizontal":
            return self.hit / self.rate
        rest = self.together * g / self.stiffness
        return rest + sqrt((rest - self.sag) ** 2 + (self.hit / self.rate) ** 2)

    def build(self, scene: Scene) -> None:
        """Wall, spring and plate, lying or standing; glider on its track, or ball above."""
        spring = self.spring(scene)
        {"horizontal": self.lying, "vertical": self.standing}[self.way](scene, spring)
        soft = Surface(friction=0.4)
        rider = RIDER[self.way]
        for name, density in ((spring.name("plate"), 1200.0), (spring.name("spring"), 7800.0)):
            scene.material(name, density, soft)
        scene.material(rider, self.mass / self.volume, soft)
        for side in ("left", "right"):
            for stop in ("nut", "stop"):
                name = spring.name(f"{side}_{stop}")
                scene.material(name, 7800.0, Surface())
                scene.touch(spring.name("plate"), name)
        scene.touch(spring.name("plate"), {"horizontal": "glider/nose", "vertical": rider}[self.way])
        if self.way == "horizontal":
            scene.material("glider/nose", self.mass / self.volume, soft)
        times = [1.5 / self.rate, 12 * sqrt(self.plate / self.stiffness)]
        if self.damping:
            times.append(12 * self.plate / (2 * self.damping * self.rate * self.together))
        scene.resolve(time=min(times), length=0.01, duration=self.duration)

    @property
    def volume(self) -> float:
        """Of the glider's block or of the ball [m³]."""
        return 8 * 0.06 * 0.034 * 0.04 if self.way == "horizontal" else 4 / 3 * pi * BALL**3

    @property
    def way_to_go(self) -> float:
        """From the glider's nose to the plate, at the start [m]."""
        return min(1.2 * self.speed, 1.0)

    @property
    def duration(self) -> float:
        """Of the film [s]."""
        if self.way == "vertical":
            return float(np.clip(6 * (sqrt(2 * self.drop / g) + pi / self.rate), 2.0, 8.0))
        return float(np.clip(2 * self.way_to_go / self.speed + pi / self.rate + 0.4, 2.0, 10.0))

    def spring(self, scene: Scene) -> Part:
        """The spring, its guides and its stops, at their lengths."""
        part, rest, solid = scene.add("spring"), self.length, SOLID * self.length
        for side, y in (("left", 0.062), ("right", -0.062)):
            part.geom(f"{side}_rod").fromto = (0, y, 0, rest + PLATE + 0.02, y, 0)
            part.geom(f"{side}_nut").pos[0] = rest + PLATE + 0.007
            part.geom(f"{side}_stop").fromto = (0, y, 0, solid - 0.006, y, 0)
        part.body("plate").pos[0] = rest + PLATE / 2
        part.geom("plate").mass = self.plate
        tendon = part.tendon("spring")
        tendon.stiffness, tendon.springlength = [self.stiffness, 0, 0], [rest, rest]
        tendon.damping = [2 * self.damping * self.rate * self.together, 0, 0]
        scene.start[part.name("plate")] = -self.sag
        turns = 9.0
        scene.coil(Coil(part.name("spring"), part.name("spring"), turns, 0.028, solid / (2 * turns + 2)))
        return part

    def lying(self, scene: Scene, spring: Part) -> None:
        """Along the air track, the wall at its end."""
        glider = scene.add("glider")
        scene.material(glider.name("track"), 2700.0, Surface())
        height = 0.15
        spring.body("spring").pos[2] = height
        wall = spring.geom("wall")
        wall.size[2], wall.pos[2] = (height + 0.07) / 2, (0.07 - height) / 2
        start = self.length + PLATE + self.way_to_go + NOSE
        end = start + 0.25  # the glider comes back no faster than it went
        glider.geom("beam").pos[0], glider.geom("beam").size[0] = end / 2, end / 2
        glider.geom("left_foot").pos[0], glider.geom("right_foot").pos[0] = self.length, end - 0.05
        glider.body("glider").pos[0] = start
        glider.geom("block").mass = self.mass
        glider.geom("nose").pos[0] = -NOSE + 0.02
        scene.speed[glider.name("glider")] = -self.speed

    def standing(self, scene: Scene, spring: Part) -> None:
        """Upright on the floor, the ball above."""
        stand = spring.body("spring")
        stand.pos, stand.quat = (0, 0, 0.04), (sqrt(0.5), 0, -sqrt(0.5), 0)
        ball = scene.add("ball")
        ball.geom("ball").size[0], ball.geom("ball").mass = BALL, self.mass
        top = 0.04 + self.length - self.sag + PLATE
        scene.start[ball.name("free")] = free_pose((0, 0, top + self.drop + BALL))

    @observable("m")
    def compression(self, run: Run) -> NDArray[np.float64]:
        """Of the spring, from its free length."""
        return -run.joint("spring/plate")

    @observable("m/s")
    def velocity(self, run: Run) -> NDArray[np.float64]:
        """Of the body, away from the wall or floor."""
        axis = 0 if self.way == "horizontal" else 2
        return run.velocity(RIDER[self.way])[:, axis]

    @observable("m")
    def drawn_length(self, run: Run) -> NDArray[np.float64]:
        """Of the coil: between the two sites that it is drawn between."""
        ends = []
        for name in ("spring/foot", "spring/head"):
            site = run.model.site(name)
            body = int(site.bodyid[0])
            turn = quaternion_matrix(run.motion.quaternion[:, body])
            ends.append(run.motion.origin[:, body] + turn @ site.pos)
        return np.asarray(np.linalg.norm(ends[1] - ends[0], axis=1))

    def twin(self, run: Run, **changes: float | str) -> tuple[SpringCompress, Run]:
        """The same specimen with some parameters changed, and its run; with a stiffer spring if windings touched."""
        specimen = SpringCompress.make(**(self.values() | changes))
        while specimen.deepest > 0.95 * specimen.travel:
            stiffer = 2 * specimen.stiffness
            if stiffer > 5000:
                raise NotEvaluated(f"the windings touch: {specimen.deepest:.3g} m to go, {specimen.travel:.3g} m free")
            changes["stiffness"] = stiffer
            specimen = SpringCompress.make(**(self.values() | changes))
        return (self, run) if specimen == self else (specimen, run.again(**changes))

    @staticmethod
    def met(run: Run) -> float:
        """When body and plate first meet [s]."""
        for impact in run.impacts:
            if "spring/plate" in (impact.first, impact.second) and not {"nut", "stop"} & {
                n.split("_")[-1] for n in (impact.first, impact.second)
            }:
                return impact.time
        raise NotEvaluated("body and plate do not meet")

    def released(self, run: Run) -> float:
        """When the plate is first back at the nuts [s]."""
        start = self.met(run)
        for impact in run.impacts:
            if impact.time > start + 0.1 / self.rate and "nut" in impact.first + impact.second:
                return impact.time
        raise NotEvaluated("the plate is not back at the end of its way")

    def depth(self, run: Run) -> float:
        """Greatest compression on the first push [m]."""
        start = self.met(run)
        after = run.t > start
        times, depths = peaks(run.t[after], self.compression(run)[after], -run.joint_speed("spring/plate")[after])
        if not len(times):
            raise NotEvaluated("the run ends before the spring is fully compressed")
        return float(depths[0])

    def thrown_back(self, run: Run) -> NDArray[np.float64]:
        """Speed of the glider after it has left the plate, at every sample: at the latest after half a period."""
        speeds = self.velocity(run)[run.t > self.met(run) + 1.02 * pi / self.rate]
        if len(speeds) < 5:
            raise NotEvaluated(f"{len(speeds)} samples after the glider has left; needed: 5")
        return np.asarray(speeds)

    @law("x_max = v' √(M/k), v' = v₀ m/M", source="Landau & Lifshitz, Mechanics, §21 eq. 21.5",
         within=(5e-4, 3e-5, 2e-6))  # fmt: skip
    def compresses_by_its_speed(self, run: Run) -> Measurement:
        """22a: horizontal and undamped; M counts the plate, which the body takes along at once."""
        specimen, one = self.twin(run, way="horizontal", damping=0.0)
        return specimen.depth(one), specimen.hit / specimen.rate

    @law("t = π √(M/k)", source="Landau & Lifshitz, Mechanics, §21 eq. 21.6", within=(2e-4, 1e-5, 1e-6))
    def stays_for_half_a_period(self, run: Run) -> Measurement:
        """22a: from the impact until the plate is back, however fast the glider came."""
        specimen, one = self.twin(run, way="horizontal", damping=0.0)
        return specimen.released(one) - specimen.met(one), pi / specimen.rate

    @law("v_out = v₀ m/M", source="Landau & Lifshitz, Mechanics, §21 eq. 21.5", within=(1e-6, 1e-7, 1e-8))
    def leaves_as_fast_as_it_pushed(self, run: Run) -> Measurement:
        """22a: the glider gets back all that was left after the impact with the plate."""
        specimen, one = self.twin(run, way="horizontal", damping=0.0)
        speeds = specimen.thrown_back(one)
        return speeds, np.full_like(speeds, specimen.hit)

    @law("x_max = M g/k + √((m g/k)² + M v'²/k), v' = m √(2 g h)/M", source="Landau & Lifshitz, Mechanics, §6 (energy)",
         within=(5e-4, 3e-5, 2e-6))  # fmt: skip
    def weight_presses_deeper(self, run: Run) -> Measurement:
        """22b: vertical and undamped; for a plate without mass (m g/k)(1 + √(1 + 2 h k/(m g)))."""
        specimen, one = self.twin(run, way="vertical", damping=0.0, drop=max(self.drop, 0.02))
        own, both = specimen.mass * g / specimen.stiffness, specimen.together * g / specimen.stiffness
        speed = sqrt(2 * g * specimen.drop) * specimen.mass / specimen.together
        return specimen.depth(one), both + sqrt(own**2 + specimen.together * speed**2 / specimen.stiffness)

    @law("v_out/v' = exp(-ζ (π - 2 asin ζ)/√(1 - ζ²))", source="Landau & Lifshitz, Mechanics, §25 eq. 25.3, till ẍ = 0",
         within=(2e-3, 5e-4, 1e-4))  # fmt: skip
    def damping_takes_its_share(self, run: Run) -> Measurement:
        """22c: horizontal; the glider leaves where the plate stops pushing, before the spring is at rest."""
        damping = max(self.damping, 0.05)
        specimen, one = self.twin(run, way="horizontal", damping=damping)
        kept = exp(-damping * (pi - 2 * asin(damping)) / sqrt(1 - damping**2))
        speeds = specimen.thrown_back(one)
        return speeds / specimen.hit, np.full_like(speeds, kept)

    @law("ln(xₙ/xₙ₊₁) = 2π ζ/√(1 - ζ²)", source="Landau & Lifshitz, Mechanics, §25 eq. 25.4", within=(5e-3, 1e-3, 3e-4))
    def swings_shrink_alike(self, run: Run) -> Measurement:
        """22c: a ball laid on the plate without speed stays on it: logarithmic decrement of the depths."""
        damping = max(self.damping, 0.05)
        specimen, one = self.twin(run, way="vertical", damping=damping, drop=0.0)
        rest = specimen.together * g / specimen.stiffness
        depth, rate = specimen.compression(one) - rest, -one.joint_speed("spring/plate")
        heights = peaks(one.t, depth, rate)[1]
        heights = heights[heights > 0.01 * heights[0]] if len(heights) else heights
        if len(heights) < 2:
            raise NotEvaluated(f"{len(heights)} swings recorded; needed: 2")
        return np.log(heights[0] / heights[-1]) / (len(heights) - 1), 2 * pi * damping / sqrt(1 - damping**2)

    @law("L = L₀ - x", source="by definition: the coil ends at the plate, the plate at the body",
         within=(1e-7, 1e-7, 1e-7), limited_by="surfaces that touch may overlap by nanometres")  # fmt: skip
    def coil_is_drawn_as_long_as_it_is(self, run: Run) -> Measurement:
        """22d: length of the coil while the body presses, against where the body is."""
        specimen, one = self.twin(run, way="horizontal")
        start = specimen.met(one)
        pressing = (one.t > start) & (one.t < start + 0.5 * pi / specimen.rate)
        if pressing.sum() < 3:
            raise NotEvaluated(f"{pressing.sum()} samples during the push; needed: 3")
        nose = one.position("glider/glider")[pressing, 0] - NOSE
        return specimen.drawn_length(one)[pressing], nose - PLATE

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        spring = f"a {self.length:.2f} m spring of {self.stiffness:.0f} N/m"
        bottoms = any("stop" in i.first + i.second for i in run.impacts)
        limit = (
            "The windings touch before all its energy is stored, and it is stopped short."
            if bottoms
            else f"The spring shortens by {100 * self.compression(run).max():.1f} cm and takes up the energy of motion."
        )
        if self.way == "vertical":
            return (
                f"A ball of {self.mass:.2g} kg is dropped from {self.drop:.2f} m onto the plate of {spring} that "
                f"stands on the floor. {limit} Then it pushes the ball up again; its weight presses deeper than its "
                f"speed alone would. The ball rises, falls and comes back, each time losing a little to the plate."
            )
        back = abs(self.velocity(run)[-1])
        return (
            f"A glider of {self.mass:.2g} kg comes along an air track at {self.speed:.2f} m/s and runs into the plate "
            f"of {spring} in front of a wall. {limit} For an instant the glider stands still; then the spring gives "
            f"the energy back and throws it back. The push lasts half a period, pi times the root of mass over "
            f"stiffness, and the glider leaves at {back:.2f} m/s."
        )
