"""43: a tray carries blocks: pushed off, they ride along or are left behind; stopped, they go on."""

from __future__ import annotations

from math import inf, sqrt
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, threshold
from physinone_mj.run import Run
from physinone_mj.scene import Scene, free_pose

Array = NDArray[np.float64]

TRAY: Final = "tray/tray"
TOP: Final = 0.3
"""Height of the bed [m]."""

ROOM: Final = 0.08
"""Free bed in front of and behind all that can slide [m]."""

MARGIN: Final = 5e-4
"""A thrust this much less than critical must keep the load where it is, this much more must not (of the thrust)."""

HEAVIEST: Final = 200.0
"""Load over the mass of the tray. Eight hundred times as heavy, blocks that topple press a tray into the stop by a
hundredth of its size."""

LONG: Final = 1.5
STEADY: Final = 0.9
"""Slope of friction, in the load's width over its height, up to which it slides and does not topple."""

COLOURS: Final = ((0.17, 0.58, 0.62), (0.84, 0.27, 0.22), (0.30, 0.62, 0.42), (0.50, 0.38, 0.68))


class LinCarryInertia(Phenomenon, domain="mechanics"):
    """One object carries another: friction takes a load along, and no more than friction stops it."""

    thrust: Annotated[float, Param("m/s²", 0.5, 10.0, "force on the tray, over the mass of tray and load")] = 1.2
    friction: Annotated[float, Param("1", 0.0, 0.9, "between load and tray")] = 0.25
    way: Annotated[float, Param("m", 0.3, LONG, "of the tray to the stop")] = 1.2
    tray_mass: Annotated[float, Param("kg", 0.05, 10.0, "tray")] = 4.0
    mass: Annotated[float, Param("kg", 0.05, 10.0, "each block")] = 3.0
    stack: Annotated[int, Param("1", 1, 4, "blocks on one another")] = 1
    slender: Annotated[float, Param("1", 0.5, 3.0, "height of a block over its width")] = 1.6
    density: Annotated[float, Param("kg/m³", 600.0, 21300.0, "blocks")] = 700.0

    @property
    def width(self) -> float:
        """Of a block [m]."""
        return float((self.mass / (self.density * self.slender)) ** (1 / 3))

    @property
    def load(self) -> float:
        """Mass of all blocks [kg]."""
        return self.stack * self.mass

    @property
    def force(self) -> float:
        """On the tray [N]."""
        return self.thrust * (self.tray_mass + self.load)

    @property
    def sticks(self) -> bool:
        """Whether friction can give the load the tray's acceleration."""
        return self.thrust <= self.friction * g

    @property
    def slides_upright(self) -> bool:
        """Whether a load that slides does not topple."""
        return self.friction * self.slender * self.stack < STEADY

    @property
    def accelerations(self) -> tuple[float, float]:
        """Of tray and load until the stop [m/s²]."""
        if self.sticks:
            return self.thrust, self.thrust
        return (self.force - self.friction * self.load * g) / self.tray_mass, self.friction * g

    @property
    def slips(self) -> tuple[float, float]:
        """Ways that the load slips back on the tray until the stop, and forward after it [m]."""
        tray, load = self.accelerations
        onward = self.way * load / tray * load / (self.friction * g) if self.friction > 0 else 0.0
        return self.way * (1 - load / tray), onward

    def build(self, scene: Scene) -> None:
        """A tray on a rail, blocks on it, and a stop at the rail's end."""
        back, onward = self.slips
        bed = back + self.width + onward + 2 * ROOM
        if self.width > 0.3:
            least = self.mass / (self.slender * 0.3**3)
            raise Refusal("R1", f"blocks {self.width:.3g} m wide do not go on the tray; "
                          f"allowed: a density of {least:.4g} kg/m³ or more")  # fmt: skip
        if self.stack * self.mass > HEAVIEST * self.tray_mass:
            raise Refusal("R3", f"a load of {self.stack * self.mass:.3g} kg on a tray of {self.tray_mass:.3g} kg; "
                          f"allowed: {HEAVIEST:g} times the tray's mass")  # fmt: skip
        self._place_tray(scene, bed)
        rough = Surface(friction=self.friction)
        for body in ("tray/bed", TRAY, "tray/track", "tray/nose", "tray/stop", "tray/rail"):
            scene.material(body, 700.0, rough)
        scene.material("stage/floor", 2400.0, Surface(friction=self.friction, restitution=0.4))
        half = self.width / 2
        bodies = []
        for i in range(self.stack):
            part = scene.add("block", f"block{i + 1}")
            geom = part.geom("block")
            geom.size[:], geom.mass, geom.rgba = (half, half, self.slender * half), self.mass, (*COLOURS[i], 1.0)
            place = -self.way / 2 - bed / 2 + ROOM + back + half, 0.0, TOP + (2 * i + 1) * self.slender * half
            scene.start[part.name("free")] = free_pose(place)
            scene.material(part.name("block"), self.density, rough)
            bodies.append(part.name("block"))
            for other in ("tray/bed", "tray/stop", "tray/rail", "stage/floor"):
                scene.touch(bodies[-1], other)
        scene.touch(*bodies)
        scene.touch("tray/nose", "tray/stop")
        scene.control["tray/drive"] = self.force
        tray, load = self.accelerations
        run = sqrt(2 * self.way / tray)
        slide = load * run / (self.friction * g) if self.friction > 0 else 0.0
        scene.resolve(time=2.5 * sqrt(self.width / g), length=half, duration=max(2.0, min(run + slide + 0.7, 6.0)))

    def _place_tray(self, scene: Scene, bed: float) -> None:
        part = scene.add("tray")
        start, nose = -self.way / 2, 0.035
        body = part.body("tray")
        body.pos[0] = start
        part.geom("bed").size[0], part.geom("bed").mass = bed / 2, self.tray_mass
        part.geom("nose").pos[0] = bed / 2
        part.geom("mark").pos[0] = -bed / 2 + ROOM + self.slips[0] + self.width
        for shoe, side in (("rear_shoe", -1), ("front_shoe", 1)):
            part.geom(shoe).pos[0] = side * (bed / 2 - 0.12)
        face = self.way / 2 + bed / 2 + nose
        part.geom("stop").pos[0] = face + 0.06
        low, high = start - bed / 2 - 0.1, face + 0.12
        part.geom("rail").pos[0], part.geom("rail").size[0] = (low + high) / 2, (high - low) / 2
        part.geom("left_foot").pos[0], part.geom("right_foot").pos[0] = low + 0.2, high - 0.35

    @observable("m")
    def slip(self, run: Run) -> Array:
        """Of the lowest block along the tray since the start (T,)."""
        gap = run.position("block1/block")[:, 0] - run.position(TRAY)[:, 0]
        return np.asarray(gap - gap[0])

    @observable("m/s")
    def speeds(self, run: Run) -> Array:
        """Of the tray and the lowest block (T, 2)."""
        return np.column_stack([run.velocity(body)[:, 0] for body in (TRAY, "block1/block")])

    @observable("1")
    def uprightness(self, run: Run) -> Array:
        """Of the lowest block: cosine of its lean (T,)."""
        q = run.quaternion("block1/block")
        return np.asarray(1 - 2 * (q[:, 1] ** 2 + q[:, 2] ** 2))

    def stop_time(self, run: Run) -> float:
        """When the tray meets the stop [s]; infinite if it has not."""
        return min([i.time for i in run.impacts if {i.first, i.second} == {"tray/nose", "tray/stop"}], default=inf)

    def riding(self, run: Run) -> NDArray[np.bool_]:
        """Samples (T,) until the stop."""
        return between(run.t, -1.0, self.stop_time(run), least=8)

    def staged(self, run: Run, **changes: Any) -> tuple[LinCarryInertia, Run]:
        """The specimen with these changes, and its run: this one, or a twin."""
        there = self.make(**(self.values() | changes))
        return there, run if there == self else run.again(**changes)

    def stuck(self, run: Run) -> tuple[LinCarryInertia, Run]:
        """This specimen, or a twin in which friction takes the load along and, at the stop, brakes it upright."""
        if 0 < self.thrust < 0.98 * self.friction * g and self.slides_upright:
            return self, run
        friction = self.friction if self.friction > 0.12 else 0.25
        changes: dict[str, Any] = {"friction": friction, "thrust": 0.5 * friction * g}
        if not self.make(**(self.values() | changes)).slides_upright:
            changes |= {"stack": 1, "slender": 0.5}
        return self.staged(run, **changes)

    def slipping(self, run: Run) -> tuple[LinCarryInertia, Run]:
        """This specimen, or a twin with a greater thrust, in which friction cannot take the load along."""
        if self.thrust > 1.05 * self.friction * g and self.slides_upright:
            return self, run
        changes: dict[str, Any] = {"thrust": min(max(1.5 * self.friction * g, self.thrust), 10.0)}
        if not self.slides_upright:
            changes |= {"stack": 1, "slender": 0.5}
        return self.staged(run, **changes)

    @law("a = μ g", source="Coulomb, Théorie des machines simples (1785); Feynman, Lectures I, §12-2",
         within=(1e-3, 1e-3, 1e-3), limited_by="the width of the bracket")  # fmt: skip
    def the_load_rides_along_up_to_a_thrust(self, run: Run) -> Measurement:
        """43a: thrust over mass up to which the load does not move on the tray by so much as a micrometre."""
        critical = self.friction * g
        if critical * (1 - MARGIN) < 0.5:
            raise NotEvaluated(f"critical thrust {critical:.3g} m/s²; a tray has 0.5 m/s² or more")
        changes: dict[str, Any] = {"way": LONG} if self.slides_upright else {"way": LONG, "stack": 1, "slender": 0.5}

        def slips(thrust: float) -> bool:
            there, twin = self.staged(run, **changes, thrust=thrust)
            return bool(np.abs(there.slip(twin)[there.riding(twin)]).max() > 1e-6)

        return threshold(slips, critical, spread=MARGIN, resolution=2.1 * MARGIN), critical

    @law("a₁ = μ g, a₂ = (F - μ m g)/M", source="Newton, Principia, laws 2 and 3; Coulomb, Théorie des machines "
         "simples (1785)", within=(1e-8, 1e-9, 1e-9))  # fmt: skip
    def a_load_left_behind_gets_what_friction_gives(self, run: Run) -> Measurement:
        """43b: accelerations of block and tray until the stop, where the thrust is too great."""
        there, twin = self.slipping(run)
        riding = there.riding(twin)
        tray, load = there.accelerations
        seen = [acceleration(twin.t[riding], twin.position(body)[riding, 0]) for body in (TRAY, "block1/block")]
        return seen, [tray, load]

    @law("a = F/(M + m)", source="Newton, Principia, law 2", within=(1e-9, 1e-10, 1e-10))
    def what_rides_along_is_one_mass(self, run: Run) -> Measurement:
        """43c: accelerations of block and tray until the stop, where friction suffices."""
        there, twin = self.stuck(run)
        riding = there.riding(twin)
        seen = [acceleration(twin.t[riding], twin.position(body)[riding, 0]) for body in (TRAY, "block1/block")]
        return seen, [there.force / (there.tray_mass + there.load)] * 2

    @law("d = v²/(2 μ g)", source="Galilei, Discorsi, third day; Coulomb, Théorie des machines simples (1785)",
         within=(3e-4, 2e-5, 1e-6))  # fmt: skip
    def stopped_it_slides_on(self, run: Run) -> Measurement:
        """43d: way of the load on the tray after the stop, with v² = 2 F s/(M + m)."""
        there, twin = self.stuck(run)
        if twin.t[-1] < self.stop_time(twin):
            raise NotEvaluated("the tray has not come to the stop")
        return there.slip(twin)[-1], there.thrust * there.way / (there.friction * g)

    @law("a = g b/h, if μ > b/h", source="Goldstein, Classical Mechanics, §1.4: d'Alembert's principle, about the edge",
         within=(1e-3, 1e-3, 1e-3), limited_by="the width of the bracket")  # fmt: skip
    def a_tall_load_topples_first(self, run: Run) -> Measurement:
        """43e: thrust over mass at which a rough block, h high and b wide, tips over its rear edge."""
        slender = self.slender if self.slender > 1.25 else 3.0
        critical = g / slender
        changes: dict[str, Any] = {"stack": 1, "friction": 0.9, "way": LONG}
        if slender != self.slender:
            changes["slender"] = slender

        def topples(thrust: float) -> bool:
            there, twin = self.staged(run, **changes, thrust=thrust)
            return bool(there.uprightness(twin)[there.riding(twin)].min() < 1 - 1e-7)

        return threshold(topples, critical, spread=MARGIN, resolution=2.1 * MARGIN), critical

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        what = "A block" if self.stack == 1 else f"A stack of {self.stack} blocks, each"
        load = f"{what} of {self.mass:.2g} kg stands on a yellow tray of {self.tray_mass:.2g} kg on a rail. "
        push = f"A force of {self.force:.2g} N sets the tray going. "
        fallen = float(self.uprightness(run).min()) < 0.7
        rides = (
            f"Friction takes the load along at {self.thrust:.2g} m/s². "
            if self.sticks
            else f"Friction gives the load no more than {self.friction * g:.2g} m/s², so it is left behind. "
        )
        when, slip = self.stop_time(run), self.slip(run)
        after = abs(slip[-1] - slip[int(np.argmax(run.t >= when)) - 1]) if when < inf else 0.0
        end = (
            f"After {when:.1f} s a stop holds the tray, but not the load, which by its inertia "
            f"{'topples over' if fallen else f'goes on by {after:.2f} m until friction has stopped it'}."
            if when < inf
            else "The tray does not come to the stop in this scene."
        )
        return load + push + rides + end
