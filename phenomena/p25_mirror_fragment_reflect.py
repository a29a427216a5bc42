"""A mirror that shatters: each shard goes on reflecting, with its own normal."""

from __future__ import annotations

from functools import cached_property
from math import atan2, cos, pi, sin
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from physinone_mj import fracture, optics
from physinone_mj.base import Measurement, NotEvaluated, Param, Phenomenon, law, observable
from physinone_mj.constants import STANDARD_GRAVITY as g
from physinone_mj.contact import Surface
from physinone_mj.fracture import Fracture, box, place, rim, shatter
from physinone_mj.run import Run, quaternion_matrix
from physinone_mj.scene import Bond, Mirror, Scene, free_pose

from .lasers import enter, laser, screen
from .parts import ball

Array = NDArray[np.float64]

GLASS: Final = (0.004, 0.297, 0.396)
"""Half sizes of the mirror [m]: thickness, width, height. It has some millimetres of play in its frame, for putty."""

MIDDLE: Final = 0.6
"""Height of its middle above the floor [m]."""

AWAY: Final = 1.1
"""Laser and screen from the middle of the mirror [m]."""

BACK: Final = -0.8
"""Where the wall behind the mirror is, along x [m]."""

THROWN: Final = 0.9
"""Where the ball starts, before the mirror [m]."""

SURE: Final = 2e-6
STEEP: Final = 20.0
"""A ray that passes an edge within the first [m] may or may not have met it; and where it grazes a face so that a face
nearer by as much is met sooner by the second times that, the face's own round-off is drawn out as much."""


class MirrorFragmentReflect(Phenomenon, domain="optics"):
    """A mirror shatters: the shards scatter the beam that it reflected."""

    incidence: Annotated[float, Param("rad", 10 * pi / 180, 70 * pi / 180, "of the beam, from the normal")] = 0.6
    chunks: Annotated[int, Param("1", 10, 40, "shards that do not break any more")] = 10
    strength: Annotated[float, Param("Pa", 1e6, 1e9, "tension that breaks a bond")] = 1e7
    density: Annotated[float, Param("kg/m³", 2000.0, 4000.0, "glass")] = 2500.0
    mass: Annotated[float, Param("kg", 0.05, 2.0, "ball")] = 0.5
    radius: Annotated[float, Param("m", 0.02, 0.06, "ball")] = 0.045
    speed: Annotated[float, Param("m/s", 2.0, 8.0, "of the ball, towards the mirror")] = 4.0
    aside: Annotated[float, Param("m", -0.2, 0.2, "where the ball hits, beside the beam's spot")] = 0.06
    above: Annotated[float, Param("m", -0.25, 0.25, "where the ball hits, above the beam's spot")] = 0.05
    friction: Annotated[float, Param("1", 0.0, 0.9, "everything against everything")] = 0.4
    restitution: Annotated[float, Param("1", 0.1, 0.8, "everything against everything")] = 0.3
    pattern: Annotated[int, Param("1", 0, 9999, "seed of the cracks")] = 1

    @property
    def hit(self) -> float:
        """When the ball gets to the mirror [s]."""
        return (THROWN - GLASS[0] - self.radius) / self.speed

    @cached_property
    def broken(self) -> Fracture:
        """The glass in shards, smaller where the ball hits; in its own axes: x out of the mirror, z up."""
        focus = (0.0, self.aside, self.above)
        return shatter(box(*GLASS), (self.chunks,), self.pattern, focus=focus, grain=(1.0, 0.0, 0.0))

    @property
    def source(self) -> tuple[Array, Array]:
        """Where the beam starts (3,) [m], and its direction (3,)."""
        way = np.array([-cos(self.incidence), sin(self.incidence), 0.0])
        return np.array([GLASS[0], 0.0, MIDDLE]) - (AWAY - 0.002) * way, way

    def build(self, scene: Scene) -> None:
        """Mirror, laser, screen, a wall behind and a ball on its way."""
        surface = Surface(friction=self.friction, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, surface)
        frame = scene.add("mirror_frame")
        frame.body("frame").pos[2] = MIDDLE
        scene.material(frame.name("frame"), 700.0, surface)
        shards = place(
            scene, "mirror", self.broken, density=self.density, surface=surface, stress=self.strength,
            position=(0.0, 0.0, MIDDLE), colour=(0.82, 0.91, 0.97), polish=1.0,
        )  # fmt: skip
        for shard, chunk in zip(shards, self.broken.chunks, strict=True):
            scene.mirrors.append(Mirror(shard, (GLASS[0] - float(chunk.whole.centre[0]), 0.0, 0.0), (1.0, 0.0, 0.0)))
        for weld, edge in self.putty():
            anchor = np.array(edge.centre) - self.broken.chunks[edge.first].whole.centre
            fracture.bond(scene, weld, frame.name("frame"), shards[edge.first], anchor=anchor)
            scene.bonds.append(Bond(weld, self.strength * edge.area, edge.lever))
        out = np.array([cos(self.incidence), sin(self.incidence)])
        start, way = self.source
        x, y, z = (start - 0.002 * way).tolist()
        laser(scene, (x, y, z), atan2(way[1], way[0]))
        screen(scene, (AWAY * out[0], AWAY * out[1]), (-out[0], -out[1]), (0.13, 0.9), name="screen")
        back = screen(scene, (BACK, 0.0), (1.0, 0.0), (0.9, 1.2), name="back")
        scene.material(back.name("screen"), 700.0, surface)
        ball_density = self.mass / (4 / 3 * pi * self.radius**3)
        thrown = ball(scene, "ball", self.radius, ball_density, surface, (0.84, 0.27, 0.22))
        scene.start[thrown.name("free")] = free_pose((THROWN, self.aside, MIDDLE + self.above))
        scene.speed[thrown.name("free")] = (-self.speed, 0, g * self.hit / 2, 0, 0, 0)
        for body in (thrown.name("ball"), *shards):
            scene.touch(body, "stage/floor")
            scene.touch(body, frame.name("frame"))
            scene.touch(body, back.name("screen"))
        for shard in shards:
            scene.touch(thrown.name("ball"), shard)
        scene.resolve(time=0.8, length=self.radius, duration=max(2.0, self.hit + 1.6))

    def putty(self) -> list[tuple[str, fracture.Interface]]:
        """The bonds between shards and frame: their names, and where they are."""
        sides = (("left", (0.0, -1.0, 0.0), GLASS[1]), ("right", (0.0, 1.0, 0.0), GLASS[1]),
                 ("bottom", (0.0, 0.0, -1.0), GLASS[2]), ("top", (0.0, 0.0, 1.0), GLASS[2]))  # fmt: skip
        return [
            (f"mirror/{name}{edge.first:02d}", edge)
            for name, out, far in sides
            for edge in rim(self.broken, out, far)
        ]

    @property
    def shards(self) -> list[str]:
        """Names of the shards' bodies."""
        return fracture.bodies("mirror", self.broken)

    @observable("m")
    def beam_path(self, run: Run) -> Array:
        """Where the beam starts, is reflected and ends, (T, K, 3); its end again where it has fewer corners."""
        points = optics.trace(run, "laser").points.copy()
        for k in range(1, points.shape[1]):
            ended = np.isnan(points[:, k, 0])
            points[ended, k] = points[ended, k - 1]
        return points

    @observable("1")
    def shard_normals(self, run: Run) -> Array:
        """Normal of the silvered face of every shard, (T, n, 3)."""
        return np.stack([quaternion_matrix(run.quaternion(shard))[:, :, 0] for shard in self.shards], axis=1)

    def image_of_the_laser(self, run: Run) -> Array:
        """Where the laser's mouth is seen in the shard that the beam meets first, (T, 3); NaN if it meets none."""
        start, _ = self.source
        met = self.meets(run)
        found = np.full((len(run), 3), np.nan)
        normals = self.shard_normals(run)
        for k, shard in enumerate(self.shards):
            here = met == run.model.body(shard).id
            normal = normals[here, k]
            centre = self.broken.chunks[k].whole.centre
            face = run.position(shard)[here] + (GLASS[0] - centre[0]) * normal
            found[here] = start - 2 * np.einsum("ti,ti->t", start - face, normal)[:, None] * normal
        return found

    @observable("1")
    def bonds_left(self, run: Run) -> Array:
        """Bonds that still hold, of shards to shards and to the frame."""
        names = fracture.welds("mirror", self.broken) + [name for name, _ in self.putty()]
        return np.asarray(fracture.holding(run, names).sum(axis=1), float)

    @observable("J")
    def energy(self, run: Run) -> Array:
        """Of everything that moves, above the floor."""
        return np.asarray(run.motion.kinetic + run.motion.potential)

    def meets(self, run: Run) -> NDArray[np.int64]:
        """Number of the body that the beam meets first (T,), as the tracer has it; -1 for none."""
        first = optics.trace(run, "laser").geoms[:, 0]
        return np.where(first < 0, -1, run.model.geom_bodyid[first])

    def should_meet(self, run: Run, margin: float = 0.0) -> tuple[NDArray[np.int64], NDArray[np.bool_], Array]:
        """Number of the body that it ought to meet first (T,), whether on a silvered face (T,), how far away (T,) [m].

        From the planes of the shards, the sphere of the ball and the boxes of all that stands; not from meshes.
        margin: by which everything is thicker [m]
        """
        start, way = self.source
        nearest, who = np.full(len(run), run.scene.beams[0].reach), np.full(len(run), -1)
        silvered = np.zeros(len(run), bool)

        def meet(far: Array, body: str, face: NDArray[np.bool_] | bool = False) -> None:
            closer = far < nearest
            nearest[closer] = far[closer]
            who[closer] = run.model.body(body).id
            silvered[closer] = np.broadcast_to(face, closer.shape)[closer]

        for shard, chunk in zip(self.shards, self.broken.chunks, strict=True):
            normals, offsets, _ = fracture.faces(chunk.shape)
            offsets = offsets - normals @ chunk.whole.centre + margin
            turn, centre = quaternion_matrix(run.quaternion(shard)), run.position(shard)
            far, plane = enter(np.einsum("tji,tj->ti", turn, start - centre), way @ turn, normals, offsets)
            meet(far, shard, normals[plane][:, 0] > 0.999)
        for body in ("mirror_frame/frame", "screen/screen", "back/screen"):
            for geom in range(run.model.ngeom):
                if run.model.geom_bodyid[geom] != run.model.body(body).id:
                    continue
                turn = quaternion_matrix(run.model.body(body).quat[None])[0]
                local = turn.T @ (start - run.model.body(body).pos) - run.model.geom_pos[geom]
                axes = np.concatenate([np.eye(3), -np.eye(3)])
                half = np.tile(run.model.geom_size[geom], 2) + margin
                far, _ = enter(local[None], (way @ turn)[None], axes, half)
                meet(np.broadcast_to(far, nearest.shape), body)
        out = start - run.position("ball/ball")
        along, gap = out @ way, (out**2).sum(axis=1) - (self.radius + margin) ** 2
        root = along**2 - gap
        meet(np.where((root > 0) & (along < 0), -along - np.sqrt(np.maximum(root, 0)), np.inf), "ball/ball")
        return who, silvered, nearest

    @law("d' = d - 2 (d·n) n", source="Euclid, Catoptrics, prop. 1; Born & Wolf, Principles of Optics, §3.2.2",
         within=(1e-9, 1e-9, 1e-9), unit="rad", limited_by="round-off: nothing here depends on the step")  # fmt: skip
    def whole_mirror_reflects_at_equal_angles(self, run: Run) -> Measurement:
        """25a: directions of the beam to and from the mirror before the ball gets there."""
        before = run.t < min((i.time for i in run.impacts), default=self.hit)
        rays = optics.trace(run, "laser")
        whole = before & np.isin(self.meets(run), [run.model.body(shard).id for shard in self.shards])
        if not whole.any():
            raise NotEvaluated("the ball is in the beam from the start")
        due = (cos(self.incidence), sin(self.incidence), 0.0)
        return rays.directions(1)[whole], np.tile(due, (int(whole.sum()), 1))

    @law("d' = d - 2 (d·n_k) n_k", source="Euclid, Catoptrics, prop. 1; Born & Wolf, Principles of Optics, §3.2.2",
         within=(1e-9, 1e-9, 1e-9), unit="rad", limited_by="round-off: nothing here depends on the step")  # fmt: skip
    def every_shard_reflects_with_its_own_normal(self, run: Run) -> Measurement:
        """25b: direction of the beam after the first shard that it meets, while that is tilted by 1 mrad or more."""
        rays, normals = optics.trace(run, "laser"), self.shard_normals(run)
        who, silvered = self.certain(run)
        found, due = [], []
        _, way = self.source
        for k, shard in enumerate(self.shards):
            tilted = silvered & (who == run.model.body(shard).id) & (normals[:, k, 0] < cos(1e-3))
            n = normals[tilted, k]
            found.append(rays.directions(1)[tilted])
            due.append(way - 2 * (n @ way)[:, None] * n)
        if not sum(len(part) for part in found):
            raise NotEvaluated("no shard tilts in the beam")
        return np.concatenate(found), np.concatenate(due)

    def certain(self, run: Run) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """What it ought to meet first (T,), -2 where it grazes a face or an edge, and whether silvered (T,)."""
        who, silvered, _ = self.should_meet(run)
        others = [self.should_meet(run, side * SURE) for side in (-1, 1)]
        sure = np.all([(who == w) & (silvered == s) for w, s, _ in others], axis=0)
        sure &= np.abs(others[0][2] - others[1][2]) < 2 * SURE * STEEP
        return np.where(sure, who, -2), silvered & sure

    @law("what is nearest along the ray is met", source="by definition: a ray; Born & Wolf, Principles of Optics, "
         "§3.2.1", within=(1e-6, 1e-6, 1e-6), unit="m", limited_by="meshes are of single precision")  # fmt: skip
    def beam_goes_on_where_no_shard_is(self, run: Run) -> Measurement:
        """25c: way of the beam at every sample, to the shard, frame, ball or wall behind that it ought to meet first;
        NaN if it meets another, or is not thrown back by silver, or by what is none."""
        who, silvered = self.certain(run)
        rays = optics.trace(run, "laser")
        bounced = rays.geoms[:, 1] > optics.NO_RAY if rays.geoms.shape[1] > 1 else np.zeros(len(run), bool)
        right = (self.meets(run) == who) & (bounced == silvered)
        way = np.linalg.norm(rays.points[:, 1] - rays.points[:, 0], axis=1)
        sure = who > -2
        return np.where(right, way, np.nan)[sure], self.should_meet(run)[2][sure]

    @law("Σ A_k = w h", source="by definition: area", within=(1e-3, 1e-3, 1e-3),
         limited_by="shards are set back from each other by ten micrometres")  # fmt: skip
    def shards_cover_the_mirror(self, run: Run) -> Measurement:
        """25d: silvered area of all shards' meshes, and what their masses make of it, against width times height."""
        area = 0.0
        for shard in self.shards:
            mesh = run.model.mesh(int(run.model.geom(shard).dataid[0]))
            points = run.model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]].astype(float)
            corners = points[run.model.mesh_face[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]]
            turn = quaternion_matrix(run.model.geom(shard).quat[None])[0]
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ turn.T / 2
            size = np.linalg.norm(across, axis=1)
            area += size[across[:, 0] > 0.999 * size].sum()
        weighed = sum(run.mass(shard) for shard in self.shards) / (self.density * 2 * GLASS[0])
        return [area, weighed], np.full(2, 4 * GLASS[1] * GLASS[2])

    @law("Σ mᵢ = ρ V", source="by definition: density", within=(1e-12, 1e-12, 1e-12),
         limited_by="round-off: nothing here depends on the step")  # fmt: skip
    def shards_weigh_what_the_mirror_does(self, run: Run) -> Measurement:
        """25e (24a): masses; every shard is there until the end."""
        there = np.isfinite(np.array([run.position(shard)[-1] for shard in self.shards])).all(axis=1)
        mass = np.sum([run.mass(shard) for shard in self.shards] * there)
        return mass, self.density * 8 * GLASS[0] * GLASS[1] * GLASS[2]

    @law("E = E₀ in flight; Ė ≤ 0 after", source="Landau & Lifshitz, Mechanics, §6; rigid bonds store nothing",
         within=(1e-2, 3e-3, 1e-3), limited_by="restitution with friction at the corners of a heap")  # fmt: skip
    def breaking_sets_no_energy_free(self, run: Run) -> Measurement:
        """25e (24b): while the ball flies, in units of its own; then the greatest rise above what it once was."""
        energy = self.energy(run)
        flying = energy[run.t < min((i.time for i in run.impacts), default=run.t[-1])]
        risen = np.maximum(energy - np.minimum.accumulate(energy), 0).max()
        thrown = self.mass * self.speed**2 / 2
        return [*(1 + (flying - energy[0]) / thrown), 1 + risen / energy[0]], np.ones(len(flying) + 1)

    def caption(self, run: Run) -> str:
        """The release's manner: start, motion, law, outcome."""
        met = self.meets(run)
        shards = {run.model.body(shard).id for shard in self.shards}
        missed = np.mean([body not in shards for body in met[run.t > self.hit]])
        broken = len(run.breaks)
        outcome = (
            f"{broken} bonds break; shards tilt and fall, each throws the beam where its own normal says, and for "
            f"{missed:.0%} of the time after the hit there is no shard in the beam: it goes on to what is behind"
            if broken
            else "the glass withstands, and the beam stays where it was"
        )
        return (
            f"A laser shines at a framed mirror, {np.degrees(self.incidence):.0f}° from the normal, and its reflection "
            f"falls on a screen at the same angle. After {self.hit:.2f} s a ball of {self.mass:.2g} kg hits the mirror "
            f"at {self.speed:.1f} m/s: {outcome}."
        )
