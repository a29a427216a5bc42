"""40: a cart on four wheels, pushed, driven or rolling down a slope."""

from __future__ import annotations

from math import cos, inf, pi, sin
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from phenomena.slope import LANE, plank
from phenomena.stands import DRY
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.measure import acceleration, between, threshold
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Motor, Part, Scene, free_pose

Array = NDArray[np.float64]

WHEELS: Final = {"front_left": (1, 1), "front_right": (1, -1), "rear_left": (-1, 1), "rear_right": (-1, -1)}
"""Where the wheels are: ahead or behind, left or right."""

BASE, TRACK, CHASSIS, LONG = 3.0, 2.2, 0.6, 4.4
"""In radii of the wheels: axles from the middle, wheels from it, its height over the axles, bumpers from it."""

START: Final = 0.3
PUSH: Final = 0.6
"""When the ram or the motor starts, and how long the ram accelerates and the motor drives [s]."""

PLATE: Final = 0.5
"""Mass of the ram [kg]."""

FORCE: Final = 300.0
"""Greatest of the ram [N]."""

RIM: Final = 6.0
"""Speed of the wheels' rims that the motor cannot exceed [m/s]."""

WALL: Final = 1.8
"""Face of the wall from where the cart's front is at the start, or from the foot of the slope [m]."""

WAY: Final = 1.0
"""Of the front wheels down the slope [m]."""

MARGIN: Final = 1e-3
"""Torques this much smaller must roll, this much greater must spin the wheels (of the critical one)."""


class CartMove(Phenomenon, domain="mechanics"):
    """A cart rolls on its wheels, driven by a ram, by its motor or by gravity, and coasts on."""

    drive: Annotated[Literal["pushed", "motor", "slope"], Choice("a ram, a motor for two wheels, a slope")] = "pushed"
    mass: Annotated[float, Param("kg", 0.3, 5.0, "chassis with what it carries")] = 2.0
    wheel: Annotated[float, Param("kg", 0.02, 0.5, "one wheel, a solid disc")] = 0.3
    radius: Annotated[float, Param("m", 0.02, 0.1, "wheels")] = 0.06
    speed: Annotated[float, Param("m/s", 0.3, 2.0, "that the ram gives")] = 1.4
    torque: Annotated[float, Param("N m", 0.01, 20.0, "of the motor on each rear wheel")] = 0.15
    friction: Annotated[float, Param("1", 0.2, 0.9, "between wheels and ground")] = 0.6
    slope: Annotated[float, Param("rad", 0.03, 0.35, "of the plank")] = 0.15
    watch: Annotated[float, Param("s", 1.0, 8.0, "how long it is watched")] = 5.0

    @property
    def total(self) -> float:
        """Mass of the cart [kg]."""
        return self.mass + 4 * self.wheel

    @property
    def inertia(self) -> float:
        """Of one wheel about its axle, ½ m R² [kg m²]."""
        return self.wheel * self.radius**2 / 2

    @property
    def effective(self) -> float:
        """Mass that resists acceleration, M + Σ m + Σ I/R² [kg]."""
        return self.total + 4 * self.inertia / self.radius**2

    @property
    def critical(self) -> float:
        """Torque on each rear wheel at which both begin to spin [N m]; infinite: the front lifts off before.

        The load of the rear axle follows from the balance of moments about the front wheels' contact, b N = g Σ m x +
        a Σ m z + Σ I α; both wheels together hold μ N = 2 τ/R - 2 I α/R.
        """
        r, b = self.radius, 2 * BASE * self.radius
        still = g * (self.mass / 2 + 2 * self.wheel)
        shifted = (self.mass * (1 + CHASSIS) * r + 4 * self.wheel * r + 4 * self.inertia / r) / b
        per_torque = 2 / (r * self.effective)
        need = 2 / r - 2 * self.inertia / r**2 * per_torque - self.friction * shifted * per_torque
        if need <= 0:
            return inf
        torque = self.friction * still / need
        return torque if still + shifted * per_torque * torque < self.total * g else inf

    @property
    def downhill(self) -> float:
        """Acceleration on the slope, g sin α (M + Σ m)/(M + Σ m + Σ I/R²) [m/s²]."""
        return g * sin(self.slope) * self.total / self.effective

    def build(self, scene: Scene) -> None:
        """The cart, what drives it, and a wall at the end of its way."""
        road = Surface(friction=self.friction)
        scene.material("stage/floor", 2400.0, road)
        part = self.place_cart(scene, road)
        ground = ["stage/floor"]
        front = LONG * self.radius
        if self.drive == "slope":
            ground.append(self.place_slope(scene, road))
        elif self.drive == "pushed":
            self.place_ram(scene)
        else:
            for wheel in ("rear_left", "rear_right"):
                course = ((START, 0.0), (START + 1e-6, RIM / self.radius))
                scene.motors.append(Motor(part.name(wheel), course, force=self.torque, off=START + PUSH))
        for wheel in WHEELS:
            for base in ground:
                scene.touch(part.name(wheel), base)
        wall = scene.add("wall")
        wall.body("wall").pos[0] = WALL + (0.0 if self.drive == "slope" else front)
        wall.geom("wall").pos[2] = wall.geom("wall").size[2] = 0.15
        wall.geom("wall").size[1] = 0.5
        wall.body("buttress").pos[0] = wall.body("wall").pos[0] + 0.16
        bare = Surface(restitution=0.4)
        for name in (wall.name("wall"), wall.name("buttress"), part.name("front_bumper"), part.name("rear_bumper")):
            scene.material(name, 2000.0, bare)
        scene.touch(part.name("front_bumper"), wall.name("wall"))
        scene.resolve(time=0.3, length=self.radius, duration=self.watch)

    def place_cart(self, scene: Scene, road: Surface) -> Part:
        """The cart at rest, its middle over the origin or up the slope."""
        part, r = scene.add("cart"), self.radius
        density = self.mass / (8 * 4 * r * 1.7 * r * CHASSIS * r)
        scene.material(part.name("cart"), density, road)
        sizes = {"chassis": (4, 1.7, CHASSIS), "box": (2.2, 1.4, 0.6), "front_bumper": (0.2, 1.4, 0.3),
                 "rear_bumper": (0.2, 1.4, 0.3)}  # fmt: skip
        for name, size in sizes.items():
            part.geom(name).size[:] = np.multiply(size, r)
        part.geom("chassis").mass = self.mass
        part.geom("box").pos[:] = (-0.8 * r, 0, 1.2 * r)
        for end, side in (("front", 1), ("rear", -1)):
            part.geom(f"{end}_bumper").pos[0] = side * (LONG - 0.2) * r
            axle = part.geom(f"{end}_axle")
            x, z = side * BASE * r, -CHASSIS * r
            axle.fromto, axle.size[0] = (x, -2.4 * r, z, x, 2.4 * r, z), 0.16 * r
        for name, (ahead, left) in WHEELS.items():
            part.body(name).pos[:] = (ahead * BASE * r, left * TRACK * r, -CHASSIS * r)
            tread, spoke, cross = (part.geom(name + x) for x in ("", "_spoke", "_cross"))
            tread.size[:2], tread.mass = (r, 0.3 * r), self.wheel
            spoke.size[:], cross.size[:] = (0.84 * r, 0.31 * r, 0.12 * r), (0.12 * r, 0.31 * r, 0.84 * r)
            scene.material(part.name(name), self.wheel / (pi * 0.6 * r**3), road)
        lean, up = (1.0, 0.0, 0.0, 0.0), np.array([0.0, 0.0, (1 + CHASSIS) * r])
        if self.drive == "slope":
            lean = (cos(self.slope / 2), 0.0, sin(self.slope / 2), 0.0)
            along, out = (np.array([cos(self.slope), 0, -sin(self.slope)]),
                          np.array([sin(self.slope), 0, cos(self.slope)]))  # fmt: skip
            up = out * (1 + CHASSIS) * r - along * (WAY + BASE * r)
        scene.start[part.name("free")] = free_pose(up, lean)
        return part

    def place_slope(self, scene: Scene, road: Surface) -> str:
        """A plank on legs, its foot at the origin; returns the name of its surface."""
        r = self.radius
        part = plank(scene, self.slope, WAY + 2 * LONG * r, WAY, (TRACK + 0.8) * r / (2 * LANE))
        for name in ("ramp", "slope"):
            scene.material(part.name(name), 700.0, road)
        return part.name("slope")

    def place_ram(self, scene: Scene) -> None:
        """The linear motor behind the cart, its plate on the rear bumper."""
        part, r = scene.add("ram"), self.radius
        rear, high, stroke = -LONG * r, (1 + CHASSIS) * r, self.speed * (PUSH / 2 + 0.03)
        long = stroke + 0.15
        part.body("cylinder").pos[:] = (rear, 0, high)
        part.body("ram").pos[:] = (rear - 0.01, 0, high)
        part.geom("barrel").fromto, part.geom("barrel").size[0] = (-0.06 - long, 0, 0, -0.05, 0, 0), 0.5 * r
        part.geom("plate").size[1:], part.geom("plate").mass = (1.2 * r, 0.5 * r), PLATE
        part.geom("rod").fromto, part.geom("rod").size[0] = (-long, 0, 0, -0.01, 0, 0), 0.22 * r
        for foot, x in (("front_foot", -0.1), ("rear_foot", -0.02 - long)):
            part.geom(foot).pos[:], part.geom(foot).size[1:] = (x, 0, -high / 2), (0.8 * r, high / 2)
        part.joint("ram").range = (0.0, stroke)
        course = ((START, 0.0), (START + PUSH, self.speed))
        scene.motors.append(Motor(part.name("ram"), course, force=FORCE, off=START + PUSH + 0.1))
        scene.material(part.name("ram"), 7800.0, Surface())
        scene.material(part.name("plate"), 7800.0, Surface())
        scene.material(part.name("cylinder"), 7800.0, DRY)
        scene.material("cart/rear_bumper", 1200.0, Surface())
        scene.touch("cart/rear_bumper", part.name("plate"))

    @observable("m")
    def place(self, run: Run) -> Array:
        """Of the chassis' middle along the way (T,)."""
        return run.position("cart/cart")[:, 0]

    @observable("m/s")
    def velocity(self, run: Run) -> Array:
        """Of the chassis along its own axis (T,)."""
        ahead = quaternion_matrix(run.quaternion("cart/cart"))[:, :, 0]
        return np.asarray(np.einsum("ti,ti->t", run.velocity("cart/cart"), ahead))

    @observable("rad/s")
    def turning(self, run: Run) -> Array:
        """Of the wheels against the chassis, forwards (T, 4): front left and right, rear left and right."""
        return np.column_stack([run.joint_speed(f"cart/{wheel}") for wheel in WHEELS])

    @observable("m/s")
    def slip(self, run: Run) -> Array:
        """ω R - v of every wheel (T, 4)."""
        return np.asarray(self.turning(run) * self.radius - self.velocity(run)[:, None])

    @observable("m")
    def axles(self, run: Run) -> Array:
        """Middles of the wheels in the chassis' axes (T, 4, 3)."""
        axes = quaternion_matrix(run.quaternion("cart/cart"))
        out = [run.position(f"cart/{wheel}") - run.position("cart/cart") for wheel in WHEELS]
        return np.asarray(np.einsum("tik,twi->twk", axes, np.stack(out, axis=1)))

    def alone(self, run: Run, start: float, stop: float = inf) -> NDArray[np.bool_]:
        """Samples after `start` and before anything strikes the cart or its front wheels leave the slope."""
        first = min([i.time for i in run.impacts if i.time > start], default=inf)
        if self.drive == "slope":
            down = run.position("cart/front_left")[:, 2] < self.radius + 1e-4
            first = min(first, float(run.t[np.argmax(down)])) if down.any() else first
        return between(run.t, start, min(first, stop), least=12)

    def staged(self, run: Run, **changes: Any) -> tuple[CartMove, Run]:
        """The specimen with these changes and its run: this one, or a twin."""
        there = self.make(**(self.values() | changes))
        return there, run if there == self else run.again(**changes)

    def driven(self, run: Run) -> tuple[CartMove, Run]:
        """A run with a motor that does not spin the wheels."""
        torque = min(self.torque, 0.9 * self.critical, 20.0)
        return self.staged(run, drive="motor", torque=torque, **({} if self.drive == "motor" else {"watch": 1.0}))

    @law("v = ω R", source="Landau & Lifshitz, Mechanics, §38 eq. 38.1 (rolling without slipping)",
         within=(1e-7, 1e-8, 1e-8))  # fmt: skip
    def every_wheel_rolls(self, run: Run) -> Measurement:
        """40a: ω R of the four wheels against the speed of the chassis, until something strikes it; of too strong a
        motor a twin with less torque."""
        there, twin = self.driven(run) if self.drive == "motor" else (self, run)
        free = there.alone(twin, -1.0)
        return there.turning(twin)[free] * self.radius, there.velocity(twin)[free, None] + np.zeros(4)

    @law("a = g sin α (M + Σ m)/(M + Σ m + Σ I/R²)", source="Landau & Lifshitz, Mechanics, §38; Kleppner & Kolenkow, "
         "An Introduction to Mechanics, 2nd ed., §7.7", within=(1e-7, 1e-8, 1e-8))  # fmt: skip
    def wheels_share_the_slopes_work(self, run: Run) -> Measurement:
        """40b: acceleration along the slope, by a fit until the front wheels reach its foot."""
        there, twin = self.staged(run, drive="slope", **({} if self.drive == "slope" else {"watch": 1.0}))
        free = there.alone(twin, -1.0)
        place = twin.position("cart/cart")
        along = (place - place[0]) @ (cos(there.slope), 0.0, -sin(there.slope))
        return acceleration(twin.t[free], along[free]), self.downhill

    @law("a = (Σ τ/R)/(M + Σ m + Σ I/R²)", source="Kleppner & Kolenkow, An Introduction to Mechanics, 2nd ed., §7.7",
         within=(1e-7, 1e-8, 1e-8))  # fmt: skip
    def motor_drives_the_cart(self, run: Run) -> Measurement:
        """40c: acceleration while the motor drives, by a fit (a twin if this cart has none or spins its wheels)."""
        there, twin = self.driven(run)
        free = there.alone(twin, START, START + PUSH)
        return acceleration(twin.t[free], there.place(twin)[free]), 2 * there.torque / (self.radius * self.effective)

    @law("2 τ/R - 2 I α/R = μ (g Σ m x + a Σ m z + Σ I α)/b", within=(1.1e-3, 1.1e-3, 1.1e-3),
         source="Wong, Theory of Ground Vehicles, 4th ed., §3.2 eqs. 3.1-3.9 (load transfer to the driven axle)",
         limited_by="the width of the bracket")  # fmt: skip
    def wheels_spin_beyond_their_grip(self, run: Run) -> Measurement:
        """40c: torque at which the rear wheels begin to spin, over that of the balance of moments."""
        true: CartMove = run.specimen
        if not 0.01 < true.critical * (1 - MARGIN) < true.critical * (1 + MARGIN) < 20.0:
            raise NotEvaluated(f"critical torque {true.critical:.3g} N m; needed: 0.01 to 20 N m")

        # a fifth of what `MARGIN` too much torque makes wheels without load gain on the ground
        slipping = 0.2 * MARGIN * true.critical * true.radius / true.inertia * PUSH

        def spins(torque: float) -> bool:
            twin = run.again(drive="motor", torque=torque, watch=1.0)
            return bool(np.abs(true.slip(twin)[twin.t < START + PUSH]).max() > slipping)

        return threshold(spins, self.critical, spread=MARGIN, resolution=2.1 * MARGIN) / self.critical, 1.0

    @law("|Δ| = 0", source="by definition: a wheel stays on its axle", unit="R", within=(1e-10, 1e-10, 1e-10))
    def axles_stay_at_their_mounts(self, run: Run) -> Measurement:
        """40d: way of every wheel's middle from its mount, in radii."""
        mounts = np.array([(ahead * BASE, left * TRACK, -CHASSIS) for ahead, left in WHEELS.values()])
        return np.linalg.norm(self.axles(run) / self.radius - mounts, axis=2).max(), 0.0

    @law("v = const", source="Newton, Principia (1687), law I", unit="1/s", within=(1e-8, 1e-9, 1e-9))
    def it_coasts(self, run: Run) -> Measurement:
        """40e: change of the speed a second, relative, from the ram to the wall."""
        there, twin = self.staged(run, drive="pushed", watch=max(self.watch, 2.0))
        free = there.alone(twin, START + PUSH + 0.1)
        v, t = there.velocity(twin)[free], twin.t[free]
        return np.abs(v[-1] / v[0] - 1) / (t[-1] - t[0]), 0.0

    @law("v = v₀, x ≤ s", source="by definition: a motor holds its course until a stop ends it",
         within=(1e-7, 1e-8, 1e-8))  # fmt: skip
    def the_ram_gives_its_speed(self, run: Run) -> Measurement:
        """Speed of the cart when the ram, a linear motor, has met its stop, a linear limit; and the ram's place then,
        in strokes."""
        there, twin = self.staged(run, drive="pushed", watch=max(self.watch, 2.0))
        free = there.alone(twin, START + PUSH + 0.1)
        stroke = self.speed * (PUSH / 2 + 0.03)
        return [there.velocity(twin)[free][0] / self.speed, twin.joint("ram/ram")[free][0] / stroke], [1.0, 1.0]

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        struck = [i for i in run.impacts if "wall" in i.first + i.second]
        cart = f"A red cart of {self.total:.1f} kg stands on four wheels {200 * self.radius:.0f} cm wide. "
        drive = {
            "pushed": f"A ram pushes it up to {self.speed:.1f} m/s, strikes its stop and lets it go; with nothing "
            "to slow it down the cart coasts on evenly. ",
            "motor": f"A motor turns the rear wheels with {self.torque:.2g} N m each"
            + (" - more than their grip bears: they spin" if self.torque > self.critical else "")
            + " and then lets them run freely: the cart speeds up and coasts on. ",
            "slope": f"It rolls down a slope of {np.degrees(self.slope):.0f} degrees, faster and faster, and on over "
            "the floor. ",
        }[self.drive]
        wheels = "Part of the work goes into turning the wheels, which roll without slipping. "
        end = (
            f"After {struck[0].time:.1f} s it strikes a wall at {struck[0].approach:.2f} m/s and rolls back."
            if struck
            else f"After {run.t[-1]:.1f} s it has come {self.place(run)[-1] - self.place(run)[0]:.2f} m."
        )
        return cart + drive + ("" if self.drive == "motor" and self.torque > self.critical else wheels) + end
