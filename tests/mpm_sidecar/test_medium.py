"""Matter and bodies in one scene: what one side loses the other gains, and a lump on a seesaw tips it by its moment."""

from __future__ import annotations

import math
from typing import Annotated, Any

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from mpm_sidecar import medium
from mpm_sidecar.collide import Bearer, Obstacle
from mpm_sidecar.transfer import Body
from physinone_mj.base import Param, Phenomenon, Refusal
from physinone_mj.constants import STANDARD_GRAVITY
from physinone_mj.contact import Surface
from physinone_mj.continuum import Box, Continuum, Elastic, Granular, Inlet, Meeting, Newtonian, Piece, Wall
from physinone_mj.fidelity import DRAFT
from physinone_mj.run import Run
from physinone_mj.scene import IMMATERIAL, Scene, free_pose
from physinone_mj.simulate import Engine, Stepper, UnstableScene, build, compile, simulate

WOOD = Surface(0.5, 0.1)


class _Test(Phenomenon, domain="mechanics"):
    """Something to be tried"""

    def caption(self, run: Run) -> str:
        return ""


class LumpOnASeesaw(_Test, domain="mechanics"):
    """A lump of jelly sticks to a plank whose axle has a spring"""

    arm: Annotated[float, Param("m", 0.0, 1.0, "axle to lump")] = 0.3
    stiffness: Annotated[float, Param("N m/rad", 1.0, 1e3, "of the axle")] = 40.0
    half: Annotated[float, Param("m", 0.01, 0.2, "of the lump")] = 0.06

    def build(self, scene: Scene) -> None:
        part = scene.add("seesaw")
        part.geom("board").size[:] = (0.5, 0.15, 0.02)
        part.geom("board").mass = 0.5
        hinge = part.joint("hinge")
        hinge.stiffness[0], hinge.damping[0] = self.stiffness, 4.0
        for name in ("left_tip", "right_tip", "near_cheek", "far_cheek", "near_pin", "far_pin"):
            scene.spec.delete(part.geom(name))
        scene.material(part.name("plank"), 600.0, WOOD)
        scene.material(part.name("fulcrum"), 600.0, WOOD)
        lump = Piece("lump", Elastic(young=1e5), Box((self.half,) * 3), (self.arm, 0.0, 0.39 + self.half + 0.002))
        scene.continua.append(Continuum([lump], [Meeting("seesaw/plank", "stick")]))
        scene.resolve(time=0.2, length=2 * self.half, duration=1.2)


def test_a_lump_tips_a_seesaw_by_its_moment() -> None:
    """k θ = m g (d cos θ + h sin θ): the angle at which the spring of the axle bears the lump, here 7 degrees."""
    run = simulate(LumpOnASeesaw, fidelity=DRAFT)
    specimen, angle = run.specimen, run.joint("seesaw/hinge")
    weight = STANDARD_GRAVITY * run.clouds["lump"].mass[-1]
    height, over = 0.04 + specimen.half, run.model.body("seesaw/plank").mass[0] * STANDARD_GRAVITY * 0.02
    expected = brentq(
        lambda q: specimen.stiffness * q - weight * (specimen.arm * math.cos(q) + height * math.sin(q))
        - over * math.sin(q), 0, 1,
    )  # fmt: skip
    settled = -angle[run.t > 0.9].mean() * np.sign(-angle[-1])
    assert np.ptp(angle[run.t > 0.9]) < 0.02 * expected
    assert settled == pytest.approx(expected, rel=0.02)
    centre = run.clouds["lump"].centre[run.t > 0.9].mean(axis=0)
    assert weight * centre[0] + over * math.sin(settled) == pytest.approx(specimen.stiffness * settled, rel=5e-3)


class LumpAgainstABall(_Test, domain="mechanics"):
    """A lump of jelly flies into a ball, both free, far from everything"""

    mass: Annotated[float, Param("kg", 1e-3, 1e3, "of the ball")] = 0.05
    fluid: Annotated[int, Param("1", 0, 1, "whether the lump is a fluid")] = 0

    def build(self, scene: Scene) -> None:
        scene.gravity = 0.0
        part = scene.add("ball")
        part.geom("ball").size[0], part.geom("ball").mass = 0.06, self.mass
        scene.start[part.name("free")] = free_pose((0.25, 0.03, 1.0))
        scene.material(part.name("ball"), 600.0, WOOD)
        material = Newtonian(viscosity=20.0, bulk=1e4) if self.fluid else Elastic(young=2e4)
        lump = Piece("lump", material, Box((0.06,) * 3), (0.0, 0.0, 1.0), velocity=(2.0, 0.0, 0.0))
        scene.continua.append(Continuum([lump], [Meeting("ball/ball", "separate", 0.3)]))
        scene.resolve(time=0.1, length=0.12, duration=0.2)


@pytest.mark.parametrize("mass", [1e-3, 0.05, 100.0])
@pytest.mark.parametrize("fluid", [0, 1])
def test_momentum_of_both_sides(mass: float, fluid: int) -> None:
    """Matter and a body of MuJoCo's: the whole momentum, at every step, to round-off of double precision."""
    compiled = compile(
        specimen := LumpAgainstABall(mass=mass, fluid=fluid), build(specimen),
        type(DRAFT)("fine", steps=64, cells=8, samples=1), Engine(double=True),
    )  # fmt: skip
    with Stepper(compiled) as stepper:
        (medium,) = stepper.media
        start = medium.solver.momentum()
        for _ in range(24):
            stepper.advance()
            body = mass * stepper.data.qvel[:3]
            assert medium.solver.momentum() + body == pytest.approx(start, abs=1e-13 * start[0])
        assert body[0] > 0.01 * min(start[0], 2 * mass)


def test_bodies_are_met_where_they_are() -> None:
    """A ball that flies on by itself: after every step the obstacle is where the ball is, to round-off."""
    specimen = LumpAgainstABall(mass=1.0)
    scene = build(specimen)
    scene.speed["ball/free"] = (3.0, 1.0, 0.5, 0.0, 0.0, 0.0)
    with Stepper(compile(specimen, scene, DRAFT)) as stepper:
        (bearer,) = stepper.media[0].bearers
        for _ in range(4):
            stepper.advance()
            assert bearer.pivot == pytest.approx(stepper.data.qpos[:3], abs=1e-9)
            assert bearer.obstacles[0].centre == pytest.approx(stepper.data.qpos[:3], abs=1e-9)


def _still(continuum: Continuum, duration: float = 0.2) -> type[Phenomenon]:
    class Still(_Test, domain="mechanics"):
        """Matter alone"""

        def build(self, scene: Scene) -> None:
            scene.continua.append(continuum)
            scene.resolve(time=0.1, length=0.1, duration=duration)

    return Still


def cube(material: Any = None, height: float = 0.05, **more: Any) -> Piece:
    return Piece("cube", material or Elastic(), Box((0.05,) * 3), (0.0, 0.0, height), **more)


FLOOR = Meeting("stage/floor", "separate", 0.5)


def test_the_floor_feels_the_weight() -> None:
    """What the floor was given, and what the matter lost, is m g t."""
    run = simulate(_still(Continuum([cube(Elastic(young=1e5), 0.07)], [FLOOR])), fidelity=DRAFT)
    cloud = run.clouds["cube"]
    given = run.pushed["stage/floor"][:, 2] + cloud.momentum[:, 2]
    assert given == pytest.approx(-STANDARD_GRAVITY * cloud.mass * run.t, abs=1e-4)
    assert cloud.mass == pytest.approx(np.full(len(run), 1.0), rel=1e-9)


def test_what_falls_freely_falls_exactly() -> None:
    """z = z₀ - g t²/2 and v = -g t at every sample, whatever the step (single precision)."""
    run = simulate(_still(Continuum([cube(height=0.5)], [FLOOR])), fidelity=DRAFT)
    cloud, g = run.clouds["cube"], STANDARD_GRAVITY
    assert cloud.centre[:, 2] == pytest.approx(cloud.centre[0, 2] - 0.5 * g * run.t**2, abs=2e-6)
    assert cloud.momentum[:, 2] == pytest.approx(-g * run.t, abs=2e-5)
    assert cloud.kinetic == pytest.approx(0.5 * (g * run.t) ** 2, rel=4e-5, abs=2e-5)


def test_the_same_seed_gives_the_same_bits() -> None:
    """And another seed puts the particles elsewhere."""
    scene = _still(Continuum([cube(Granular(), 0.051)], [FLOOR]), duration=0.07)
    one, two, other = (simulate(scene, fidelity=DRAFT, seed=seed).clouds["cube"] for seed in (3, 3, 4))
    assert one.position.tobytes() == two.position.tobytes()
    assert one.centre.tobytes() == two.centre.tobytes()
    assert one.position.tobytes() != other.position.tobytes()


@pytest.mark.parametrize("lasts", [0.1, 4.0])
def test_a_jet_is_full_all_along(lasts: float) -> None:
    """Of every piece as long as the jet is wide, the moment of area is a full circle's, and the middle its middle."""
    radius, speed, spacing = 0.03, 1.5, 0.004
    jet = Inlet("honey", (0.3, 0.0, 0.4), (0.0, 0.0, -speed), radius, stop=lasts)
    points = np.zeros((1, 3))
    body = Body(Newtonian(), points, spacing**3)
    pouring = medium._pouring(jet, ["honey"], [body], 10.0, np.random.default_rng(0))
    assert len(pouring.times) == pytest.approx(math.pi * radius**2 * speed * lasts / spacing**3, abs=1)
    piece = np.floor(pouring.times * speed / (2 * radius)).astype(int)
    full = piece < math.floor(lasts * speed / (2 * radius))
    away = pouring.points - jet.position
    assert np.abs(away[:, 2]).max() < 1e-12
    for k in np.unique(piece[full]):
        part = away[piece == k]
        assert (part**2).sum(axis=1).mean() == pytest.approx(radius**2 / 2, rel=0.02)
        assert np.abs(part.mean(axis=0)).max() < 0.02 * radius


def test_an_inlet_pours_what_it_says() -> None:
    """π r² v t ρ, from when it opens until it closes."""
    jet = Inlet("cube", (0.3, 0.0, 0.4), (0.0, 0.0, -1.5), 0.03, start=0.05, stop=0.15)
    run = simulate(_still(Continuum([cube(Newtonian())], [FLOOR], inlets=[jet])), fidelity=DRAFT)
    cloud = run.clouds["cube"]
    rate = 1000.0 * math.pi * 0.03**2 * 1.5
    expected = 1.0 + rate * np.clip(run.t - 0.05, 0.0, 0.1)
    assert cloud.mass == pytest.approx(expected, abs=0.02 * rate * 0.1)
    assert cloud.present[-1] > cloud.present[0]
    poured = cloud.position[-1, cloud.present[0] : cloud.present[-1]]
    assert (np.hypot(poured[:, 0] - 0.3, poured[:, 1]) < 0.04).all()


def poured(position: Any, velocity: Any, radius: float = 0.03) -> Continuum:
    return Continuum([cube(Newtonian())], [FLOOR], inlets=[Inlet("cube", position, velocity, radius)])


@pytest.mark.parametrize(
    ("continuum", "told"),
    [
        (Continuum([cube(height=0.03)], [FLOOR]), "R1: 'cube' lies 0.01"),
        (
            Continuum([cube(height=0.5)], walls=[Wall((0.03, 0, 0), (-1, 0, 0))]),
            r"R1: 'cube' lies 0\.01\d* m deep in a wall at the start; allowed: 0\.00\d m$",
        ),
        (Continuum([cube(Elastic(young=2000.0))], [FLOOR]), "R9: 'cube': its own weight squashes it by 0.4"),
        (Continuum([cube(Newtonian(bulk=1e3))], [FLOOR]), "R9: 'cube': its own weight squashes it by 0.1"),
        (Continuum([cube(Granular(young=1e5))], [FLOOR]), "R9: 'cube': its own weight squashes it by 0.01"),
        (Continuum([cube(Elastic(young=1e12))], [FLOOR]), "R10: .* particle updates"),
        (Continuum([cube(velocity=(3e5, 0.0, 0.0))], [FLOOR]), "R10: .* particle updates .* and 3e\\+05 m/s"),
        (poured((0.3, 0.0, 0.4), (0.0, 0.0, -1.5), 0.01), "R7: a jet of 'cube' is 0.02 m wide, 1.6 cells"),
        (poured((0.3, 0.0, -0.05), (0.0, 0.0, 1.5)), "R1: a jet of 'cube' lies 0.05 m deep in stage/floor"),
        (poured((0.3, 0.0, 0.01), (0.0, 1.5, 0.0)), "R1: a jet of 'cube' lies 0.0199 m deep in stage/floor"),
    ],
)
def test_what_cannot_be_computed_is_refused(continuum: Continuum, told: str) -> None:
    """Before the first step, with the number and what is allowed."""
    with pytest.raises(Refusal, match=told):
        simulate(_still(continuum), fidelity=DRAFT)


HILL = """<mujoco><asset><hfield name="hill" nrow="2" ncol="2" size="1 1 1 1"/></asset>
<worldbody><geom name="hill" type="hfield" hfield="hill"/></worldbody></mujoco>"""


def _bare(continuum: Continuum, words: str = "<mujoco/>") -> medium.Medium:
    """A continuum in a model of MuJoCo's own words."""
    model = mujoco.MjModel.from_xml_string(words)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return medium.Medium(continuum, model, data, cell=0.0125, gravity=STANDARD_GRAVITY, duration=0.1)


def test_what_has_no_distances_is_refused() -> None:
    """Of MuJoCo's shapes, a field of heights."""
    with pytest.raises(Refusal, match=r"R7: hill: matter cannot meet a geom of type mjGEOM_HFIELD; allowed: plane, "
                                      r"sphere, capsule, ellipsoid, cylinder, box, mesh$"):  # fmt: skip
        _bare(Continuum([cube(height=2.0)], [Meeting("hill")]), HILL)


def test_a_first_run_says_that_it_compiles(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A line for each material that is not in the cache, however many pieces are of it, and not among the results."""
    asked: list[str] = []
    monkeypatch.setattr(medium, "compiles", lambda name: asked.append(name) or name != "Granular")
    others = [
        Piece(name, material, Box((0.05,) * 3), (x, 0.0, 0.5))
        for name, material, x in (("jelly", Elastic(), 0.2), ("sand", Granular(), 0.4), ("honey", Newtonian(), 0.6))
    ]
    _bare(Continuum([cube(height=0.5), *others]))
    assert asked == ["Elastic", "Granular", "Newtonian"]
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == "".join(
        f"compiling the kernels for {name} (once on this machine)\n" for name in ("Elastic", "Newtonian")
    )


def test_a_jet_is_counted_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Millions of particles that would be refused afterwards took minutes."""
    monkeypatch.setattr(medium, "_pouring", lambda *_: pytest.fail("made"))
    with pytest.raises(Refusal, match=r"R10: 'cube' takes 2\.3.e\+07 particles, with what is poured"):
        simulate(_still(poured((0.5, 0.0, 1.0), (0.0, 0.0, -100.0), 0.3)), fidelity=DRAFT)


def test_the_greatest_speed_is_foreseen() -> None:
    """√(v² + 2 g h) to the first plane below, of the highest of it or a jet; without one, v + g t; or what is met."""
    body = Body(Elastic(), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 3.0]]), 1e-6, (3.0, 0.0, 4.0))
    jet = Inlet("lump", (0.0, 0.0, 5.0), (0.0, 0.0, -7.0), 0.1)
    slope = math.sqrt(0.5)
    floor, deeper, sheer, slide = (
        Bearer([Obstacle.wall(Wall(point, normal))])
        for point, normal in (((0, 0, 0.5), (0, 0, 1)), ((0, 0, -2), (0, 0, 1)), ((0, 0, 2.9), (1, 0, 0)),
                              ((0, 0, 2.5), (slope, 0, slope)))
    )  # fmt: skip
    down = np.array([0.0, 0.0, -10.0])

    def found(*met: Bearer, inlets: Any = (), gravity: Any = down, lasts: float = 9.0) -> float:
        return medium._quickest([body], inlets, met, gravity, lasts)

    assert found(floor) == pytest.approx(math.sqrt(25 + 2 * 10 * 2.5))
    assert found(deeper, floor, sheer) == pytest.approx(math.sqrt(25 + 2 * 10 * 2.5))
    assert found(deeper, slide) == pytest.approx(math.sqrt(25 + 2 * 10 * 0.5))
    assert found(sheer) == pytest.approx(5 + 90)
    assert found(floor, lasts=0.1) == pytest.approx(5 + 1)
    assert found(floor, inlets=[jet]) == pytest.approx(math.sqrt(49 + 2 * 10 * 4.5))
    assert found(floor, gravity=0 * down) == pytest.approx(5.0)
    fast = Bearer([Obstacle("ball", (0.1,))], velocity=np.array([0.0, 60.0, 0.0]))
    assert found(floor, fast) == pytest.approx(60.0)


def test_what_runs_away_ends_the_run() -> None:
    """As an unstable scene, at once."""
    specimen = _still(Continuum([cube()], [FLOOR])).make()
    with Stepper(compile(specimen, build(specimen), DRAFT)) as stepper:
        solver = stepper.media[0].solver
        solver._clouds[0].records[:, 4] = solver._fastest = 1e7
        with pytest.raises(UnstableScene, match=r"steps in .* at 1e\+07 m/s"):
            stepper.advance()


def test_a_body_that_matter_cannot_meet_is_told() -> None:
    """It has nothing solid."""

    class Ghost(_Test, domain="mechanics"):
        """Matter over a body that is only drawn"""

        def build(self, scene: Scene) -> None:
            ghost = scene.spec.worldbody.add_body(name="ghost")
            ghost.add_geom(size=[0.1, 0.0, 0.0], group=IMMATERIAL, contype=0, conaffinity=0)
            scene.continua.append(Continuum([cube()], [Meeting("ghost")]))
            scene.resolve(time=0.1, length=0.1, duration=0.1)

    with pytest.raises(ValueError, match="the body 'ghost' has no geom of a group below"):
        simulate(Ghost, fidelity=DRAFT)


@pytest.mark.parametrize(
    ("continuum", "told"),
    [
        (Continuum(), "pieces \\[\\] of a continuum"),
        (Continuum([cube(), cube()]), "each of its own name"),
        (Continuum([cube()], [Meeting("nobody")]), "no body or geom 'nobody'"),
        (Continuum([cube()], [FLOOR, FLOOR]), "meetings with .* allowed: one with each"),
        (Continuum([cube()], inlets=[Inlet("tea", (0, 0, 1), (0, 0, -1), 0.1)]), "piece = 'tea' of an inlet"),
    ],
)
def test_a_wrong_declaration_is_told(continuum: Continuum, told: str) -> None:
    with pytest.raises((ValueError, KeyError), match=told):
        simulate(_still(continuum), fidelity=DRAFT)


def test_matter_meets_a_mesh() -> None:
    """A lump comes to rest on a wedge of a mesh, above it, and not on the ball that goes around it."""

    class OnAWedge(_Test, domain="mechanics"):
        """A lump on the flat top of a mesh"""

        def build(self, scene: Scene) -> None:
            part = scene.add("seesaw")
            scene.material(part.name("plank"), 600.0, WOOD)
            scene.material(part.name("fulcrum"), 600.0, WOOD)
            lump = Piece("cube", Elastic(), Box((0.05,) * 3), (0.0, -0.205, 0.41))
            scene.continua.append(Continuum([lump], [Meeting("seesaw/near", "stick")]))
            scene.spec.mesh("seesaw/wedge").scale[:] = (0.25, 0.2, 0.35)
            scene.resolve(time=0.1, length=0.1, duration=0.4)

    run = simulate(OnAWedge, fidelity=DRAFT)
    assert run.clouds["cube"].low[-1, 2] < 0.362  # its sides sag beside the narrow top
    assert run.clouds["cube"].centre[-1, 2] == pytest.approx(0.4, abs=0.015)


def test_driven_bodies_do_not_yield() -> None:
    """A plank that a motor turns does not feel what lies on it, and the matter goes with it."""
    from physinone_mj.scene import Motor

    class Driven(LumpOnASeesaw, domain="mechanics"):
        """A lump on a plank that a motor turns"""

        def build(self, scene: Scene) -> None:
            super().build(scene)
            scene.duration = 0.4
            scene.motors.append(Motor("seesaw/hinge", ((0.0, 0.5),)))

    run = simulate(Driven, fidelity=DRAFT)
    hinge = run.joint("seesaw/hinge")
    assert np.diff(hinge)[1:] == pytest.approx(0.5 * np.diff(run.t)[1:], abs=1e-9)
    turning, angle = run.clouds["lump"].centre[-1], hinge[-1]
    x, z = 0.3 * math.cos(angle) - 0.1 * math.sin(angle), 0.35 + 0.3 * math.sin(angle) + 0.1 * math.cos(angle)
    assert turning[[0, 2]] == pytest.approx([x, z], abs=0.02)
    for cls, yields in ((Driven, False), (LumpOnASeesaw, True)):
        specimen = cls.make()
        bearers = Stepper(compile(specimen, build(specimen), DRAFT)).media[0].bearers
        assert any(bearer.yields is not None for bearer in bearers) is yields
