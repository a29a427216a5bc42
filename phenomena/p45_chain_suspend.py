"""45: a chain between two hooks, or hanging from one, and the lantern it bears."""

from __future__ import annotations

import functools
from math import asin, cos, hypot, pi, sin, sqrt
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import root

from phenomena.stands import DRY, gallows
from physinone_mj.base import Choice, Measurement, NotEvaluated, Param, Phenomenon, Refusal, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.effects import Drag
from physinone_mj.measure import accelerations, period
from physinone_mj.run import Run
from physinone_mj.scene import Scene

Array = NDArray[np.float64]

IRON: Final = 7800.0
GLASS: Final = 2500.0
STEM: Final = 0.03
"""From the lantern's globe to the joint it hangs from [m]."""

SETTLED: Final = 2e-5
"""Speed of everything below which the chain has settled [m/s]."""

THICKEST: Final = 6.0
"""Drag by mass, at most [1/s]."""

TAUT: Final = 0.85
"""Largest push with which both halves of a chain between hooks stay taut as it swings, over asin(span), at which one of
them bears nothing. Beyond, the slack half comes taut with a jerk, and a chain that cannot stretch bears any force then:
at 0.98 a chain of 60 links without drag gains a twentieth of its energy, with more it breaks up."""

THICK: Final = 4.0
"""Drag by mass under which it does so softly [1/s]: lanterns of 20 chains' mass were tried; 2 /s was too little."""

TINY: Final = 0.004
"""Swing of the lowest link of a twin whose oscillation is small [rad]."""


class ChainSuspend(Phenomenon, domain="mechanics"):
    """A chain hangs and bears a lantern: released aside it swings, settles and takes the shape of its weights."""

    mount: Annotated[Literal["hooks", "hook"], Choice("both ends on hooks, or one, a lantern at the other")] = "hooks"
    links: Annotated[int, Param("1", 8, 60, "links of the chain")] = 14
    pitch: Annotated[float, Param("m", 0.02, 0.06, "length of a link from joint to joint")] = 0.06
    mass: Annotated[float, Param("kg", 0.005, 0.1, "one link")] = 0.03
    span: Annotated[float, Param("1", 0.3, 0.95, "between the hooks, in lengths of the chain")] = 0.7
    load: Annotated[float, Param("1", 0.0, 20.0, "lantern over chain, by mass; below 0.01 there is none")] = 0.6
    push: Annotated[float, Param("rad", 0.0, 0.5, "from the vertical of the pull that holds it until the start")] = 0.5
    damping: Annotated[float, Param("1/s", 0.0, THICKEST, "drag of the air and the joints, by mass")] = 4.0

    @property
    def length(self) -> float:
        """Of the chain [m]."""
        return self.links * self.pitch

    @property
    def globe(self) -> float:
        """Mass of the lantern [kg]; 0: there is none."""
        return self.load * self.links * self.mass if self.load >= 0.01 else 0.0

    @property
    def radius(self) -> float:
        """Of the lantern's globe, of solid glass [m]."""
        return float((3 * self.globe / (4 * pi * GLASS)) ** (1 / 3))

    @property
    def bearer(self) -> int:
        """Number of links before the joint from which the lantern hangs."""
        return self.links // 2 if self.mount == "hooks" else self.links

    @property
    def gap(self) -> float:
        """Between the hooks [m]."""
        return self.span * self.length

    @property
    def hang(self) -> float:
        """From the joint that bears the lantern to its middle [m]."""
        return self.radius + STEM

    @property
    def height(self) -> float:
        """Of the hooks over the ground [m]."""
        deepest = self.length if self.mount == "hook" else float(self.rest(0.0)[1][:, 1].max())
        return 0.2 + float(deepest) + (self.hang + self.radius if self.globe else 0.0)

    def rest(self, push: float) -> tuple[Array, Array]:
        """Statics of the links one by one, gravity turned by `push`: tension at the left hook (2,), along and down [N],
        and joints (N + 1, 2) from it, along and down [m].

        A link that is pulled by T at its left end and by T - m g at its right one lies along T - m g/2.
        """
        return _statics(self, push)

    def modes(self) -> tuple[float, Array]:
        """Slowest small swing of the hanging chain: ω [rad/s] and its angles, of the links and the lantern, lowest 1.

        K q = ω² M q with M = Bᵀ m B + I, horizontal displacements x = B q.
        """
        count, a = self.links, self.pitch
        reach = np.tril(np.full((count, count), a), -1) + np.eye(count) * a / 2
        inertia = np.full(count, self.mass * a**2 / 12)
        masses, below = np.full(count, self.mass), self.mass * (count - 0.5 - np.arange(count)) + self.globe
        stiffness = g * a * below
        if self.globe:
            reach = np.block([[reach, np.zeros((count, 1))], [np.full((1, count), a), np.full((1, 1), self.hang)]])
            inertia = np.append(inertia, 2 / 5 * self.globe * self.radius**2)
            masses, stiffness = np.append(masses, self.globe), np.append(stiffness, self.globe * g * self.hang)
        squares, shapes = eigh(np.diag(stiffness), reach.T @ (masses[:, None] * reach) + np.diag(inertia))
        return sqrt(squares[0]), shapes[:, 0] / shapes[-1, 0]

    @property
    def fastest(self) -> float:
        """Bound of the frequencies: that of links turning against each other under the greatest tension [1/s]."""
        tension = hypot(*self.rest(0.0)[0]) if self.mount == "hooks" else (self.links * self.mass + self.globe) * g
        return 2 * sqrt(3 * tension / (self.pitch * self.mass))

    @property
    def calming(self) -> float:
        """Drag under which it settles fastest, nearly, without a jerk [1/s]."""
        return min(max(2 * sqrt(g / self.length), THICK if self._slackens else 0.0), THICKEST)

    @property
    def _taut(self) -> float:
        """Largest push with which both halves stay taut as it swings, if it hangs between hooks [rad]."""
        return TAUT * asin(min(self.span, 1.0))

    @property
    def _slackens(self) -> bool:
        return self.push > self._taut

    def build(self, scene: Scene) -> None:
        """A gallows with hooks, the chain link by link, and the lantern."""
        hooked = self.mount == "hooks"
        if hooked and self._slackens and self.damping < THICK:
            raise Refusal("R12", f"push = {self.push:.3g} rad, damping = {self.damping:.3g} /s: half of the chain goes "
                          f"slack and comes taut with a jerk; allowed: a push of {self._taut:.3g} rad or less, or a "
                          f"damping of {THICK:g} /s or more")  # fmt: skip
        left = -self.gap / 2 if hooked else 0.0
        side = self.gap / 2 if hooked else 0.6 * self.length
        frame = gallows(scene, self.height + 0.05, side + self.radius + 0.2)
        frame.body("frame").quat[:] = (sqrt(0.5), 0.0, 0.0, sqrt(0.5))
        for name, x in [("hook", left), ("right_hook", -left)][: 2 if hooked else 1]:
            hook = scene.add("hook", name)
            hook.body("hook").pos[:] = (x, 0.0, self.height)
            hook.geom("bar").size[:], hook.geom("bar").pos[2] = (0.008, 0.012, 0.005), 0.005
            scene.material(hook.name("hook"), IRON, DRY)
        angles = self._angles()
        before = 0.0
        for i in range(self.links):
            self._link(scene, i, left)
            scene.start[f"link{i}/hinge"] = angles[i] - before
            before = angles[i]
        if hooked:
            scene.connect("clasp", f"link{self.links - 1}/end", "right_hook/hook")
        if self.globe:
            bearing = scene.add("lantern", on=f"link{self.bearer - 1}/link")
            self._light(scene, bearing)
            # the lantern's frame is upright in the link's when the link points along +x
            scene.start["lantern/hinge"] = angles[-1] - angles[self.bearer - 1]
        self._slow_down(scene)
        swing = 2 * pi / self.modes()[0] if not hooked else 0.0
        watched = min(max(8.0, 12 * sqrt(self.length / g), 2.85 * swing), 10.0)
        scene.resolve(time=(60 if hooked else 90) / self.fastest, length=self.pitch, duration=watched)

    def _angles(self) -> Array:
        """Of the links from +x at the start, then that of the lantern from its place under a level link."""
        if self.mount == "hook":
            shape = self.push * self.modes()[1]
            return np.append(shape[: self.links] - pi / 2, shape[-1])
        along, down = np.diff(self.rest(self.push)[1], axis=0).T
        return np.append(np.arctan2(-down, along), self.push)

    def _link(self, scene: Scene, i: int, left: float) -> None:
        part = scene.add("chain_link", f"link{i}", on=f"link{i - 1}/link" if i else None)
        half = self.pitch / 2
        wire, wide = min(self.pitch / 10, 0.005), 0.27 * self.pitch
        body = part.body("link")
        body.pos[:] = (2 * half, 0.0, 0.0) if i else (left + half, 0.0, self.height)
        body.mass, moment = self.mass, self.mass * self.pitch**2 / 12
        body.inertia[:] = (moment / 4, moment, moment)
        part.joint("hinge").pos[0], part.site("end").pos[0] = -half, half
        # links that turn against each other about their middles feel no drag, but the friction of their joints
        part.joint("hinge").damping[0] = self.damping * moment / 4
        for name, y in (("near", -wide), ("far", wide)):
            beside = (y, 0.0) if i % 2 else (0.0, y)
            part.geom(name).fromto = (-half / 2, *beside, half / 2, *beside)
            for end, x in (("head", half), ("tail", -half)):
                part.geom(f"{name}_{end}").fromto = (x / 2, *beside, 1.1 * x, 0.0, 0.0)
                part.geom(f"{name}_{end}").size[0] = wire
            part.geom(name).size[0] = wire
        scene.material(part.name("link"), IRON, DRY)

    def _light(self, scene: Scene, part: Any) -> None:
        body, globe = part.body("lantern"), part.geom("globe")
        body.pos[:] = (self.pitch / 2, 0.0, -self.hang)
        part.joint("hinge").pos[2] = self.hang
        globe.size[0], globe.mass = self.radius, self.globe
        part.body("cap").pos[2] = self.hang
        part.geom("cap").pos[2], part.geom("cap").size[0] = 0.92 * self.radius - self.hang, 0.55 * self.radius
        part.geom("cap").size[1] = 0.2 * self.radius
        part.geom("stem").fromto = (0, 0, self.radius - self.hang, 0, 0, 0)
        scene.material(part.name("cap"), IRON, DRY)
        scene.material(part.name("lantern"), GLASS, DRY)

    def _slow_down(self, scene: Scene) -> None:
        if self.damping:
            names = tuple(f"link{i}/link" for i in range(self.links))
            scene.effects.append(Drag(self.damping * self.mass, names))
            if self.globe:  # half of it at the cap, so that the lantern does not turn for ever
                scene.effects.append(Drag(self.damping * self.globe / 2, ("lantern/lantern", "lantern/cap")))

    def joints(self, run: Run) -> Array:
        """Places (T, N + 1, 2), along and down from the left hook, of the ends of the links [m], each link followed to
        its own end; the first joint is the hook itself."""
        middle, along = self._middles(run)
        ends = middle + self.pitch / 2 * along
        return np.concatenate([np.zeros((len(run), 1, 2)), ends], axis=1)

    def _middles(self, run: Run) -> tuple[Array, Array]:
        """Of the links: middles (T, N, 2) from the left hook and directions (T, N, 2), along and down."""
        hook = np.array([-self.gap / 2 if self.mount == "hooks" else 0.0, 0.0, self.height])
        middle = np.stack([run.position(f"link{i}/link") - hook for i in range(self.links)], axis=1)
        turn = np.stack([run.quaternion(f"link{i}/link") for i in range(self.links)], axis=1)
        angle = -2 * np.arctan2(turn[..., 2], turn[..., 0])
        return middle[..., ::2] * (1, -1), np.stack([np.cos(angle), -np.sin(angle)], axis=-1)

    @observable("m")
    def shape(self, run: Run) -> Array:
        """Joints of the chain from the left hook, along and down (T, N + 1, 2)."""
        return self.joints(run)

    @observable("m")
    def sag(self, run: Run) -> Array:
        """Of the lowest joint under the hooks (T,)."""
        return np.asarray(self.joints(run)[..., 1].max(axis=1))

    @observable("m")
    def joint_gap(self, run: Run) -> Array:
        """Widest gap between the end of one link and the beginning of the next, or the hooks (T,)."""
        middle, along = self._middles(run)
        starts, ends = middle - self.pitch / 2 * along, middle + self.pitch / 2 * along
        gaps = [starts[:, 0], starts[:, 1:] - ends[:, :-1]]
        if self.mount == "hooks":
            gaps.append(ends[:, -1] - (self.gap, 0.0))
        joined = np.concatenate([x.reshape(len(run), -1, 2) for x in gaps], axis=1)
        return np.asarray(np.linalg.norm(joined, axis=2).max(axis=1))

    @observable("N")
    def end_forces(self, run: Run) -> Array:
        """Pull on the left hook, along and up (T, 2), by Newton's law for all that moves (hook), or by the balance of
        moments of what hangs left and right of the middle joint (hooks; true when at rest)."""
        if self.mount == "hooks":
            return self._pulls(self.joints(run))[:, :2]
        return np.asarray(self._below(run)[:, 0])

    def _pulls(self, joints: Array) -> Array:
        """(H, V left, V right) by statics of joints (T, N + 1, 2): moments about the joint that bears the lantern."""
        k, weight = self.links // 2, self.mass * g
        middles = (joints[:, 1:] + joints[:, :-1]) / 2
        pulls = np.empty((len(joints), 3))
        for i, (points, centres) in enumerate(zip(joints, middles, strict=True)):
            node, right = points[k], points[-1]
            moments = [weight * (node[0] - centres[:k, 0]).sum(), weight * (centres[k:, 0] - node[0]).sum()]
            rows = [[-node[1], node[0], 0], [right[1] - node[1], 0, right[0] - node[0]], [0, 1, 1]]
            pulls[i] = np.linalg.solve(rows, [*moments, self.links * weight + self.globe * g])
        return pulls

    def _below(self, run: Run) -> Array:
        """Force at the upper joint of every link, along and up, by Newton's law for all below (T - 4, N, 2)."""
        names = [f"link{i}/link" for i in range(self.links)] + (["lantern/lantern"] if self.globe else [])
        forces = []
        for name in names:
            r, v = run.position(name)[:, ::2], run.velocity(name)[:, ::2]
            a = np.stack([accelerations(run.t, r[:, j], v[:, j]) for j in range(2)], axis=1)
            if name == "lantern/lantern":  # half of its drag is at the cap
                v = (v + run.velocity("lantern/cap")[:, ::2]) / 2
            forces.append(run.mass(name) * (a + self.damping * v[2:-2] + (0.0, g)))
        total = np.cumsum(np.stack(forces, axis=1)[:, ::-1], axis=1)[:, ::-1][:, : self.links]
        return np.concatenate([total[:1], total[:1], total, total[-1:], total[-1:]])

    def settled(self, run: Run, **changes: Any) -> Run:
        """The run, if at the end nothing moves any more, or a damped twin that does not; else NotEvaluated."""
        changes = {k: v for k, v in changes.items() if v != getattr(run.specimen, k)}
        fastest = SETTLED
        calm = run.specimen.damping >= THICK or not self._slackens or changes.get("mount", self.mount) == "hook"
        for damping in dict.fromkeys((*((run.specimen.damping,) if calm else ()), self.calming)):
            given = changes if damping == run.specimen.damping else changes | {"damping": damping}
            twin = run.again(**given) if given else run
            last = twin.t > twin.t[-1] - 0.5
            moving = [name for name in twin.bodies() if name.endswith(("/link", "/lantern", "/cap"))]
            fastest = max(float(np.linalg.norm(twin.velocity(name)[last], axis=1).max()) for name in moving)
            if fastest < SETTLED:
                return twin
        raise NotEvaluated(f"it still moves at {fastest:.2g} m/s; needed: less than {SETTLED:g} m/s")

    @law("tan θᵢ = (V - (i + ½) m g)/H", source="Routh, A Treatise on Analytical Statics I, 2nd ed., §§130-132 (heavy "
         "rods hinged together) and §443 (the catenary)", within=(1e-4, 5e-5, 5e-5),
         limited_by="what is left of the motion when it counts as settled")  # fmt: skip
    def links_lie_along_their_pull(self, run: Run) -> Measurement:
        """45a: depths of all joints below the hooks, settled, against the statics of the links one by one."""
        twin = self.settled(run, mount="hooks")
        _, expected = self.make(**(self.values() | {"mount": "hooks"})).rest(0.0)
        return twin.specimen.joints(twin)[-1, :, 1], expected[:, 1]

    @law("T = √(H² + V²)", source="Routh, A Treatise on Analytical Statics I, 2nd ed., §443", within=(1e-4, 5e-5, 5e-5),
         limited_by="what is left of the motion when it counts as settled")  # fmt: skip
    def hooks_are_pulled_by_weight_and_sag(self, run: Run) -> Measurement:
        """45b: pulls on both hooks, from the settled shape by the balance of moments, against the same statics."""
        twin = self.settled(run, mount="hooks")
        along, left, right = twin.specimen._pulls(twin.specimen.joints(twin)[-1:])[0]
        start = self.make(**(self.values() | {"mount": "hooks"})).rest(0.0)[0]
        weight = (self.links * self.mass + self.globe) * g
        return [hypot(along, left), hypot(along, right)], [hypot(*start), hypot(start[0], weight - start[1])]

    @law("Tⱼ = (M + m_below) g", source="Newton, Principia, law III and corollary II; Routh, A Treatise on Analytical "
         "Statics I, 2nd ed., §443", within=(1e-4, 5e-5, 5e-5),
         limited_by="what is left of the motion when it counts as settled")  # fmt: skip
    def every_joint_bears_what_hangs_below(self, run: Run) -> Measurement:
        """45b: upward force at every joint of the chain hanging from one hook, by Newton's law, settled."""
        twin = self.settled(run, mount="hook")
        below = self.mass * (self.links - np.arange(self.links)) + twin.specimen.globe
        return twin.specimen._below(twin)[-8:, :, 1].mean(axis=0), below * g

    @law("det(K - ω² M) = 0, nearly ω = (j₀₁/2) √(g/L)", source="D. Bernoulli, Comm. Acad. Petrop. 6 (1738) 108; Lamb, "
         "Higher Mechanics, 2nd ed., §94", within=(2e-5, 5e-6, 5e-6),
         limited_by="amplitude 4 mrad: small swings are isochronous to its square")  # fmt: skip
    def a_hanging_chain_swings(self, run: Run) -> Measurement:
        """45c: frequency of the slowest swing of the chain alone, hanging from one hook (a twin without drag)."""
        twin = run.again(mount="hook", load=0.0, damping=0.0, push=TINY)
        hinges = [f"link{i}/hinge" for i in range(self.links)]
        angle = np.sum([twin.joint(hinge) for hinge in hinges], axis=0) + pi / 2
        rate = np.sum([twin.joint_speed(hinge) for hinge in hinges], axis=0)
        return 2 * pi / period(twin.t, angle, rate, least=2), twin.specimen.modes()[0]

    @law("|Δ| = 0", source="by definition: what is joined stays together", unit="pitches", within=(1e-2, 1e-3, 1e-4))
    def joints_stay_closed(self, run: Run) -> Measurement:
        """45d: widest gap of any joint over the length of a link, at any time."""
        return self.joint_gap(run).max() / self.pitch, 0.0

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        weight = self.links * self.mass
        chain = f"A chain of {self.links} links, {self.length:.2f} m long and {weight:.2g} kg heavy, "
        bears = f"bears a lantern of {self.globe:.2g} kg" if self.globe else "bears nothing but itself"
        moved = "Let go aside, it swings to and fro" if self.push > 0.01 else "It is let go"
        if self.mount == "hook":
            return (
                f"{chain}hangs from a hook and {bears}. {moved}, {2 * pi / self.modes()[0]:.2f} s a time, while the "
                f"air slows it down. Every joint bears the weight of all that hangs below it: the topmost "
                f"{(weight + self.globe) * g:.1f} N, the lowest {(self.mass + self.globe) * g:.1f} N."
            )
        pull, _ = self.rest(0.0)
        return (
            f"{chain}hangs between two hooks {self.gap:.2f} m apart and {bears}. {moved} and settles. Every link then "
            f"lies along the pull that it passes on, so that the chain sags by {self.sag(run)[-1]:.2f} m in the "
            f"middle, steepest at the hooks, each of which it pulls with {hypot(*pull):.1f} N."
        )


@functools.lru_cache(maxsize=16)
def _statics(one: ChainSuspend, push: float) -> tuple[Array, Array]:
    weight, half = one.mass * g, one.globe * g
    pull = np.array([sin(push), cos(push)])
    order = np.arange(one.links)
    hung = (order + 0.5) * weight + np.where(order >= one.bearer, half, 0.0)

    def joints(tension: Array) -> Array:
        along = tension - hung[:, None] * pull
        along = one.pitch * along / np.linalg.norm(along, axis=1)[:, None]
        return np.concatenate([np.zeros((1, 2)), np.cumsum(along, axis=0)])

    def miss(tension: Array) -> Array:
        return np.asarray(joints(tension * total)[-1] - (one.gap, 0.0))

    total = one.links * weight + half
    flat = total / 2 * one.span / sqrt(1 - one.span**2)
    guess = np.array([flat + total / 2 * sin(push), total / 2 * cos(push)])
    found = root(miss, guess / total, tol=1e-14)
    return found.x * total, joints(found.x * total)
