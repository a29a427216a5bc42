"""Impacts and dry friction against an oracle that shares nothing with the code under test.

The oracle is nonsmooth contact dynamics in plain numpy: block Gauss-Seidel over the contacts, each solved exactly for
Signorini's condition, Newton's restitution and Coulomb's cone (M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999)
235). For one contact between spheres it is Routh's closed formula.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from physinone_mj import contact
from physinone_mj.base import Choice, Param, Phenomenon
from physinone_mj.collision import IMPEDANCE
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT, REFERENCE, STANDARD, Fidelity
from physinone_mj.run import Impact, Run
from physinone_mj.scene import Scene, free_pose
from physinone_mj.simulate import Stepper, build, simulate_specimen
from physinone_mj.simulate import compile as compile_scene

Array = NDArray[np.float64]
g = 9.80665


# The oracle


@dataclass
class Body:
    """A rigid body in world axes; mass 0 means that it cannot move."""

    mass: float
    inertia: Array
    place: Array
    velocity: Array
    spin: Array

    def at(self, point: Array) -> Array:
        """Velocity of a material point."""
        return self.velocity + np.cross(self.spin, point - self.place)

    def push(self, point: Array, impulse: Array) -> None:
        if self.mass:
            self.velocity = self.velocity + impulse / self.mass
            self.spin = self.spin + np.linalg.solve(self.inertia, np.cross(point - self.place, impulse))

    def compliance(self, point: Array) -> Array:
        """Velocity of a point per impulse on it, (3, 3)."""
        if not self.mass:
            return np.zeros((3, 3))
        x, y, z = point - self.place
        arm = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.asarray(np.eye(3) / self.mass - arm @ np.linalg.solve(self.inertia, arm))


@dataclass
class Touch:
    """A contact; the normal points from the first body to the second."""

    first: int
    second: int
    point: Array
    normal: Array
    friction: float
    restitution: float


def axes(normal: Array) -> Array:
    """Normal and two tangents, as rows."""
    aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    aside /= np.linalg.norm(aside)
    return np.array([normal, aside, np.cross(normal, aside)])


def one_contact(w: Array, free: Array, mu: float) -> Array:
    """Impulse p (normal first) with u = w p + free obeying Signorini and Coulomb, by cases."""
    if free[0] >= 0:
        return np.zeros(3)
    stick = -np.linalg.solve(w, free)
    if stick[0] >= 0 and math.hypot(stick[1], stick[2]) <= mu * stick[0] * (1 + 1e-14):
        return np.asarray(stick)

    def slide(angle: float) -> tuple[Array, Array]:
        along = np.array([0.0, math.cos(angle), math.sin(angle)])
        direction = np.array([1.0, 0, 0]) - mu * along  # friction against the slip `along`
        p = direction * (-free[0] / (w[0] @ direction))
        return p, w @ p + free

    def turn(angle: float) -> float:
        _, u = slide(angle)
        return float(u[2] * math.cos(angle) - u[1] * math.sin(angle))

    grid = np.linspace(0, 2 * math.pi, 73) + 0.01
    values = [turn(a) for a in grid]
    found = []
    for a, b, fa, fb in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
        if fa * fb <= 0:
            angle = brentq(turn, a, b, xtol=1e-15)
            p, u = slide(angle)
            if u[1] * math.cos(angle) + u[2] * math.sin(angle) >= 0 and p[0] >= 0:
                found.append(p)
    assert len(found) == 1, found
    return np.asarray(found[0])


def gauss_seidel(bodies: list[Body], touches: list[Touch], sweeps: int = 20000) -> None:
    """Resolve one instant: the bodies' velocities become those after it."""
    frames = [axes(t.normal) for t in touches]
    seen = list(zip(touches, frames, strict=True))
    before = [f @ (bodies[t.second].at(t.point) - bodies[t.first].at(t.point)) for t, f in seen]
    response = [f @ (bodies[t.first].compliance(t.point) + bodies[t.second].compliance(t.point)) @ f.T for t, f in seen]
    impulses = [np.zeros(3) for _ in touches]
    speed = max(float(np.abs(b).max()) for b in before)
    for _ in range(sweeps):
        moved = 0.0
        for i, (t, f) in enumerate(seen):
            now = f @ (bodies[t.second].at(t.point) - bodies[t.first].at(t.point))
            free = now - response[i] @ impulses[i]
            free[0] += t.restitution * min(before[i][0], 0.0)
            change = one_contact(response[i], free, t.friction) - impulses[i]
            impulses[i] = impulses[i] + change
            bodies[t.second].push(t.point, change @ f)
            bodies[t.first].push(t.point, -change @ f)
            moved = max(moved, float(np.abs(response[i] @ change).max()))
        if moved < 1e-14 * speed:
            return
    raise AssertionError(f"the oracle did not settle: {moved}")


# The code under test, at one instant


def struck(
    geoms: Sequence[tuple[str, Array, float, Array, Array, Array, Array]],
    pairs: Sequence[tuple[int, int, Surface]],
) -> tuple[Any, Any, contact.Solver]:
    """Model, data and solver of free bodies (shape, size, mass, place, quaternion, velocity, world spin); body -1 is
    the floor z = 0."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=0, conaffinity=0)
    for i, (shape, size, mass, place, quaternion, _, _) in enumerate(geoms):
        body = spec.worldbody.add_body(name=f"b{i}", pos=place, quat=quaternion)
        body.add_freejoint()
        kind = {"sphere": mujoco.mjtGeom.mjGEOM_SPHERE, "box": mujoco.mjtGeom.mjGEOM_BOX}[shape]
        body.add_geom(name=f"g{i}", type=kind, size=size, mass=mass, contype=0, conaffinity=0)
    for a, b, surface in pairs:
        pair = spec.add_pair(name=f"{a} {b}", geomname1="floor" if a < 0 else f"g{a}", geomname2=f"g{b}")
        pair.condim = 3 if surface.static_friction > 0 else 1
        pair.friction = [max(surface.static_friction, mujoco.mjMINMU)] * 2 + [0, 0, 0]
    model = spec.compile()
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.tolerance = 1e-15
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    model.pair_solimp[:] = IMPEDANCE
    data = mujoco.MjData(model)
    for i, (_, _, _, _, quaternion, velocity, spin) in enumerate(geoms):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, quaternion)
        data.qvel[6 * i : 6 * i + 6] = [*velocity, *(turn.reshape(3, 3).T @ spin)]
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    named = {f"{a} {b}": surface for a, b, surface in pairs}
    solver = contact.Solver(model, [named[model.pair(i).name] for i in range(model.npair)])
    return model, data, solver


def after_impact(geoms: Any, pairs: Any) -> tuple[Array, Array, list[Impact]]:
    """Velocities and world spins (n, 3) after the impacts of this instant, and their report."""
    model, data, solver = struck(geoms, pairs)
    solver.begin(data, 1e-9, g)
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    solver.look(data, 1e-9)
    solver.impact(data)
    report = solver.impacts
    v = data.qvel.reshape(-1, 6)
    spins = [data.xmat[i + 1].reshape(3, 3) @ v[i, 3:] for i in range(len(v))]
    return v[:, :3].copy(), np.array(spins), report


def sphere(radius: float, mass: float, place: Any, velocity: Any, spin: Any) -> tuple[Any, ...]:
    upright = np.array([1.0, 0, 0, 0])
    return "sphere", np.array([radius, 0, 0]), mass, np.array(place), upright, np.array(velocity), np.array(spin)


def ball(radius: float, mass: float, place: Any, velocity: Any, spin: Any) -> Body:
    return Body(mass, 0.4 * mass * radius**2 * np.eye(3), np.array(place), np.array(velocity), np.array(spin))


def floor() -> Body:
    return Body(0.0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))


def routh(radius: float, e: float, mu: float, velocity: Array, spin: Array) -> tuple[Array, Array]:
    """A sphere on the floor, in closed form: E. J. Routh, Dynamics of a System of Rigid Bodies I, §§ 186-187."""
    slip = velocity[:2] + np.array([-spin[1], spin[0]]) * radius
    size = np.linalg.norm(slip)
    change = min(mu * (1 + e) * abs(velocity[2]) * 3.5, size)
    kick = -change / 3.5 * slip / size if size > 0 else np.zeros(2)  # of the centre
    return (
        np.array([*(velocity[:2] + kick), -e * velocity[2]]),
        spin + 2.5 / radius * np.array([kick[1], -kick[0], 0.0]),
    )


def unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


# Impacts


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 75.0, 85.0, 89.0])
def test_sphere_on_floor(degrees: float) -> None:
    rng = np.random.default_rng(int(degrees))
    for _ in range(60):
        e, mu, radius = rng.uniform(0, 1), rng.choice([0.0, rng.uniform(0, 0.9), 0.9]), rng.uniform(0.03, 0.15)
        speed, heading, mass = rng.uniform(0.5, 20), rng.uniform(0, 2 * math.pi), 10 ** rng.uniform(-3, 3)
        spin = unit(rng) * rng.choice([0.0, 10.0, 100.0])
        flat, down = speed * math.sin(math.radians(degrees)), speed * math.cos(math.radians(degrees))
        velocity = np.array([flat * math.cos(heading), flat * math.sin(heading), -down])
        v, w, report = after_impact([sphere(radius, mass, (0, 0, radius), velocity, spin)], [(-1, 0, Surface(mu, e))])
        expected = routh(radius, e, mu, velocity, spin)
        assert np.abs(v[0] - expected[0]).max() < 1e-11 * speed + 1e-12
        assert np.abs(w[0] - expected[1]).max() * radius < 1e-11 * speed + 1e-12
        assert report[0].approach == pytest.approx(down, rel=1e-12)
        assert np.array(report[0].impulse) == pytest.approx(mass * (v[0] - velocity), abs=1e-9 * mass * speed)


@pytest.mark.parametrize("ratio", [1e-4, 1e-2, 1.0, 1e2, 1e4])
def test_sphere_on_sphere(ratio: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(30):
        e, mu = rng.uniform(0, 1), rng.uniform(0, 0.9)
        radii, masses = rng.uniform(0.03, 0.15, 2), (1.0, ratio)
        line = unit(rng)
        places = np.array([0, 0, 5.0]), np.array([0, 0, 5.0]) + line * radii.sum()
        velocities, spins = rng.normal(size=(2, 3)) * 3, rng.normal(size=(2, 3)) * 20
        if (velocities[1] - velocities[0]) @ line > 0:
            velocities = velocities[::-1]
        bodies = [ball(*x) for x in zip(radii, masses, places, velocities, spins, strict=True)]
        v, w, _ = after_impact(
            [sphere(*x) for x in zip(radii, masses, places, velocities, spins, strict=True)], [(0, 1, Surface(mu, e))]
        )
        gauss_seidel(bodies, [Touch(0, 1, places[0] + line * radii[0], line, mu, e)])
        for i in (0, 1):
            assert np.abs(v[i] - bodies[i].velocity).max() < 1e-9
            assert np.abs(w[i] - bodies[i].spin).max() * radii[i] < 1e-9
        momentum = masses[0] * (v[0] - velocities[0]) + masses[1] * (v[1] - velocities[1])
        assert np.abs(momentum).max() < 1e-11 * min(masses) * 10
        before = (velocities[1] - velocities[0]) @ line
        assert (v[1] - v[0]) @ line == pytest.approx(-e * before, abs=1e-10)


def box_inertia(half: Array, mass: float) -> Array:
    return np.diag(mass / 3 * (np.sum(half**2) - half**2))


def energy(mass: float, inertia: Array, v: Array, w: Array) -> float:
    return float(0.5 * mass * v @ v + 0.5 * w @ inertia @ w)


def test_box_on_its_corner() -> None:
    """As the oracle says, with half of the restitution or none where with all of it energy would be created."""
    dulled = {1.0: 0, 0.5: 0, 0.0: 0}
    rng = np.random.default_rng(3)
    for _ in range(600):
        e, mu, mass = (
            rng.choice([0.0, rng.uniform(0, 1)]),
            rng.choice([0.0, 0.9, rng.uniform(0, 0.9)]),
            10 ** rng.uniform(-2, 2),
        )
        half = rng.uniform(0.03, 0.2, 3)
        quaternion = rng.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, quaternion)
        turn = turn.reshape(3, 3)
        corner = -np.sign(turn[2]) * half
        arm = turn @ corner
        place = np.array([0, 0, -arm[2]])
        velocity, spin = rng.normal(size=3) * 2 - [0, 0, 3], rng.normal(size=3) * 5
        inertia = turn @ box_inertia(half, mass) @ turn.T
        thrown = Body(mass, inertia, place, velocity, spin)
        if thrown.at(place + arm)[2] > -0.01:
            continue
        before = energy(mass, inertia, velocity, spin)
        v, w, _ = after_impact([("box", half, mass, place, quaternion, velocity, spin)], [(-1, 0, Surface(mu, e))])
        for part in dulled:
            body = replace(thrown)
            gauss_seidel([floor(), body], [Touch(0, 1, place + arm, np.array([0, 0, 1.0]), mu, part * e)])
            if energy(mass, inertia, body.velocity, body.spin) < before * (1 + contact.CREATED):
                break
        dulled[part] += 1
        assert np.abs(v[0] - body.velocity).max() < 1e-9, (e, mu)
        assert np.abs(w[0] - body.spin).max() * half.max() < 1e-9, (e, mu)
        assert energy(mass, inertia, v[0], w[0]) < before * (1 + (contact.CREATED if mu * e else 1e-12))
    assert dulled[0.5]


@pytest.mark.parametrize(("depth", "left"), [(1e-5, False), (5e-3, True)])
def test_overlaps_are_taken_back_unless_that_creates_energy(depth: float, left: bool) -> None:
    """A ball a little in the floor is lifted out by a tenth of it in a step; one deep in it is not shot up."""
    dt = 2e-3
    sunk = sphere(0.05, 1.0, (0, 0, 0.05 - depth), (0, 0, 0), (0, 0, 0))
    _, data, solver = struck([sunk], [(-1, 0, Surface(0.5, 0.0))])
    solver.begin(data, dt, g)
    assert solver.slide(data, dt)
    assert solver.eased[contact.OVERLAPPING] == left
    risen = data.qvel[2] * dt / 2  # from the middle of the step to its end
    assert risen == pytest.approx(0.0 if left else contact.PUSH_OUT * depth, abs=1e-12)


def misses(bodies: list[Body], after: list[Body], touches: list[Touch], impulses: list[Array]) -> float:
    """By how much velocities [m/s] and impulses break Signorini's condition, Newton's or Coulomb's law."""
    worst = 0.0
    for t, impulse in zip(touches, impulses, strict=True):
        frame = axes(t.normal)
        was, now = (frame @ (b[t.second].at(t.point) - b[t.first].at(t.point)) for b in (bodies, after))
        p = frame @ impulse
        left = now[0] + t.restitution * min(was[0], 0.0)
        slip = math.hypot(now[1], now[2])
        push = abs(p).sum() + 1e-300
        lag = now[1:] @ p[1:] / push + t.friction * p[0] * slip / push  # maximal dissipation
        cone = math.hypot(p[1], p[2]) - t.friction * p[0]
        worst = max(worst, -left, abs(left * p[0]) / push, -p[0] / push, cone / push, abs(lag))
    return worst


def test_a_cylinder_stands_on_a_plane_at_any_tilt() -> None:
    """MuJoCo 4.0 alone sees the rim centimetres away, or not at all, at a tilt of 1e-15."""
    half, radius = 0.02, 0.05
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom name="plane" type="plane" size="1 1 1" quat="0.9 0.2 0.1 0.3"/>
        <body name="puck"><freejoint/><geom name="puck" type="cylinder" size="{radius} {half}" mass="1"/></body>
        </worldbody><contact><pair geom1="plane" geom2="puck" margin="1e-4" gap="1e-2"/></contact></mujoco>"""
    )
    data, rng = mujoco.MjData(model), np.random.default_rng(11)
    solver = contact.Solver(model, [Surface()])
    level, turn, place = model.geom("plane").quat, np.empty(4), np.empty(3)
    mujoco.mju_rotVecQuat(place, np.array([0, 0, half - 1e-6]), level)
    worst = 0.0
    for tilt in 10 ** rng.uniform(-17, -6, 400):
        way, spin = rng.uniform(0, 2 * math.pi), rng.uniform(-1, 1)
        lean = np.array([1, tilt / 2 * math.cos(way), tilt / 2 * math.sin(way), spin])
        mujoco.mju_mulQuat(turn, level, lean / np.linalg.norm(lean))
        data.qpos[:] = *place, *turn
        solver.place(data)
        assert data.ncon >= 3
        worst = max(worst, np.abs(data.contact.dist[:3] + 1e-6).max() - radius * tilt)
    assert worst < 1e-7 * radius  # what is left is MuJoCo's own, just above the tilt at which it is set right


DISC = """<mujoco><worldbody><body name="disc"><joint axis="0 0 1"/>
    <geom name="disc" type="cylinder" size="0.5 0.01" mass="1" euler="0 0 20"/></body>
    <body name="box"><freejoint/><geom name="box" type="box" size="0.04 0.06 0.05" mass="1"/></body>
    </worldbody><contact><pair geom1="disc" geom2="box" margin="1e-4" gap="1e-3"/></contact></mujoco>"""


def test_a_box_juts_out_over_the_rim_of_a_disc() -> None:
    """It touches with the corners above the disc, and with the rim where its sides cross it and midway between."""
    model = mujoco.MjModel.from_xml_string(DISC)
    data, solver = mujoco.MjData(model), contact.Solver(model, [Surface()])
    for way in np.linspace(0, 6, 7):
        out, along = np.array([math.cos(way), math.sin(way)]), np.array([-math.sin(way), math.cos(way)])
        data.qpos[1:] = *(0.49 * out), 0.06 - 1e-6, math.cos(way / 2), 0, 0, math.sin(way / 2)
        solver.place(data)
        assert np.allclose(data.contact.dist, -1e-6, atol=1e-12)
        assert np.allclose(data.contact.frame.reshape(-1, 3, 3)[:, 0], [0, 0, 1])
        assert np.allclose(np.linalg.det(data.contact.frame.reshape(-1, 3, 3)), 1)
        assert np.allclose(data.contact.pos[:, 2], 0.01 - 5e-7, rtol=0, atol=1e-12)
        assert (data.contact.geom == [model.geom("disc").id, model.geom("box").id]).all()
        crossed = math.sqrt(0.5**2 - 0.06**2)
        expected = [(0.45, -0.06), (0.45, 0.06), (crossed, -0.06), (crossed, 0.06), (0.5, 0.0)]
        found = np.round([(x @ out, x @ along) for x in data.contact.pos[:, :2]], 9)
        assert np.allclose(sorted(map(tuple, found)), sorted(expected), atol=1e-8)


def test_a_box_on_a_disc_away_from_its_rim() -> None:
    model = mujoco.MjModel.from_xml_string(DISC)
    data, solver = mujoco.MjData(model), contact.Solver(model, [Surface()])
    data.qpos[1:] = 0.3, 0, 0.06 + 1e-5, 1, 0, 0, 0
    solver.place(data)
    corners = [(0.3 + x, y) for x in (-0.04, 0.04) for y in (-0.06, 0.06)]
    assert np.allclose(sorted(map(tuple, data.contact.pos[:, :2])), sorted(corners), atol=1e-12)
    assert np.allclose(data.contact.dist, 1e-5, atol=1e-12)
    data.qpos[1:4] = 0.3, 0, 0.0612  # out of reach
    solver.place(data)
    assert data.ncon == 0
    data.qpos[1:4] = 0.54 - 1e-6, 0, 0.055  # in the side: a millimetre, or five of its end
    solver.place(data)
    assert data.ncon
    assert np.allclose(data.contact.frame[:, :3], [1, 0, 0], atol=1e-3)
    assert data.contact.dist.min() == pytest.approx(-1e-6, rel=0.01)


def test_gaps_of_a_box_on_a_turning_disc_close_as_fast_as_its_contacts_say() -> None:
    """Where a corner bears on the end, an edge on the rim or the face on it: each has a normal of its own."""
    model = mujoco.MjModel.from_xml_string(DISC)
    data, solver, rng = mujoco.MjData(model), contact.Solver(model, [Surface()]), np.random.default_rng(3)
    dt, most = 1e-7, 0
    for tilt in (0.0, 1e-3, 5e-3, 0.02):
        for _ in range(5):
            way, radius = rng.uniform(0, 2 * math.pi), rng.uniform(0.47, 0.49)
            lean, turn = np.empty(4), np.array([math.cos(way / 2), 0, 0, math.sin(way / 2)])
            lean_to = way + rng.uniform(-0.05, 0.05)  # outwards, so that it is the rim on which the face rolls
            mujoco.mju_axisAngle2Quat(lean, np.array([-math.sin(lean_to), math.cos(lean_to), 0]), tilt)
            mujoco.mju_mulQuat(data.qpos[4:], lean, turn)
            data.qpos[:4] = 0, radius * math.cos(way), radius * math.sin(way), 0.06
            data.qvel[:] = 12, *rng.uniform(-5, 5, 2), 0, 0, 0, rng.uniform(-12, 12)
            solver.place(data)
            mujoco.mj_fwdVelocity(model, data)
            rates = []
            for c in data.contact:
                there = [np.zeros((3, model.nv)) for _ in range(2)]
                for jacobian, geom in zip(there, c.geom, strict=True):
                    mujoco.mj_jac(model, data, jacobian, None, c.pos, model.geom_bodyid[geom])
                rates.append(c.frame[:3] @ ((there[1] - there[0]) @ data.qvel))
            before = data.contact.dist.copy()
            mujoco.mj_integratePos(model, data.qpos, data.qvel, dt)
            solver.place(data)
            assert np.allclose((data.contact.dist - before) / dt, rates, rtol=0, atol=2e-4)
            most = max(most, len(before))
    assert most == 5


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.9])
def test_box_flat_on_the_floor(mu: float) -> None:
    """Four contacts: which corner holds and which slips is not always unique, that each obeys the laws is required."""
    rng = np.random.default_rng(5)
    upright = np.array([1.0, 0, 0, 0])
    same = 0
    for _ in range(6):
        e, mass, half = rng.uniform(0, 0.9), 10 ** rng.uniform(-2, 2), rng.uniform(0.05, 0.2, 3)
        velocity, spin = rng.normal(size=3) - [0, 0, 2], rng.normal(size=3) * [0.1, 0.1, 1.0]
        place = np.array([0, 0, half[2]])
        inertia = box_inertia(half, mass)
        bodies = [floor(), Body(mass, inertia, place, velocity, spin)]
        corners = [place + half * [x, y, -1] for x in (-1, 1) for y in (-1, 1)]
        if max(bodies[1].at(c)[2] for c in corners) > -0.01:
            continue
        v, w, report = after_impact([("box", half, mass, place, upright, velocity, spin)], [(-1, 0, Surface(mu, e))])
        assert len(report) == 4
        touches = [Touch(0, 1, np.array(i.position), np.array([0, 0, 1.0]), mu, e) for i in report]
        after = [floor(), Body(mass, inertia, place, v[0], w[0])]
        assert misses(bodies, after, touches, [np.array(i.impulse) for i in report]) < 1e-9
        total = sum(np.array(i.impulse) for i in report)
        assert np.abs(mass * (v[0] - velocity) - total).max() < 1e-9 * mass
        gauss_seidel(bodies, touches)
        same += np.abs(v[0] - bodies[1].velocity).max() < 1e-8
    assert same >= 1


def test_ball_strikes_a_ball_that_lies_on_the_floor() -> None:
    """Two contacts at once: from above, at a slant, onto a ball at rest."""
    rng = np.random.default_rng(11)
    for _ in range(20):
        e, mu, rough = rng.uniform(0, 0.9), rng.uniform(0, 0.9), rng.uniform(0, 0.9)
        radii, masses = rng.uniform(0.05, 0.15, 2), 10 ** rng.uniform(-1, 1, 2)
        slant = rng.uniform(0, 1.2)
        line = np.array([math.sin(slant), 0, -math.cos(slant)])
        low = np.array([0, 0, radii[1]])
        places = low - line * radii.sum(), low
        velocities = np.array([line * 3 + rng.normal(size=3) * 0.5, np.zeros(3)])
        spins = np.array([rng.normal(size=3) * 20, np.zeros(3)])
        v, w, _ = after_impact(
            [sphere(*x) for x in zip(radii, masses, places, velocities, spins, strict=True)],
            [(0, 1, Surface(mu, e)), (-1, 1, Surface(rough, e))],
        )
        bodies = [*(ball(*x) for x in zip(radii, masses, places, velocities, spins, strict=True)), floor()]
        gauss_seidel(bodies, [
            Touch(0, 1, places[0] + line * radii[0], line, mu, e),
            Touch(2, 1, np.zeros(3), np.array([0, 0, 1.0]), rough, e),
        ])  # fmt: skip
        for i in (0, 1):
            assert np.abs(v[i] - bodies[i].velocity).max() < 1e-8, (e, mu, rough, slant)
            assert np.abs(w[i] - bodies[i].spin).max() < 1e-6, (e, mu, rough, slant)


# Motion


@dataclass(frozen=True)
class Pull:
    """A constant force on the body "block/block"."""

    force: tuple[float, float, float]

    def bind(self, model: Any) -> Callable[[Any], None]:
        body = model.body("block/block").id

        def push(data: Any) -> None:
            data.xfrc_applied[body, :3] += self.force

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


class Resting(Phenomenon, domain="mechanics"):
    """A block of 1 kg on the floor, pulled or thrown."""

    friction: Annotated[float, Param("1", 0.0, 2.0, "kinetic")] = 0.4
    static: Annotated[float, Param("1", 0.0, 2.0, "static")] = 0.5
    pull: Annotated[float, Param("N", 0.0, 100.0, "sideways")] = 0.0
    speed: Annotated[float, Param("m/s", 0.0, 10.0, "at the start")] = 0.0
    duration: Annotated[float, Param("s", 0.1, 20.0, "watched")] = 2.0

    def build(self, scene: Scene) -> None:
        part = scene.add("block")
        part.geom("block").mass = 1.0
        scene.start[part.name("free")] = free_pose((0, 0, 0.04))
        scene.speed[part.name("free")] = (self.speed, 0, 0, 0, 0, 0)
        rough = Surface(friction=self.friction, static=self.static)
        scene.material("stage/floor", 2400.0, rough)
        scene.material(part.name("block"), 700.0, rough)
        scene.touch(part.name("block"), "stage/floor")
        scene.effects.append(Pull((self.pull, 0.0, 0.0)))
        scene.resolve(time=0.2, length=0.04, duration=self.duration)

    def caption(self, run: Run) -> str:
        return ""


def pulled(fidelity: Fidelity = DRAFT, **values: float) -> tuple[Run, Array]:
    run = simulate_specimen(Resting(**values), fidelity=fidelity)
    return run, run.position("block/block")


@pytest.mark.parametrize("fraction", [0.5, 0.89, 0.95, 0.99, 0.9999])
def test_static_friction_holds_without_creep(fraction: float) -> None:
    _, x = pulled(pull=fraction * 0.5 * g, duration=10.0)
    assert np.abs(x - x[0]).max() < 1e-9


@pytest.mark.parametrize("excess", [1.001, 1.1, 3.0])
def test_kinetic_friction_rules_once_it_slips(excess: float) -> None:
    run, x = pulled(pull=excess * 0.5 * g, duration=2.0)
    speed = run.velocity("block/block")[:, 0]
    late = speed > 2 * contact.CREEP
    assert late.sum() > 100
    slope = np.polyfit(run.t[late], speed[late], 1)[0]
    assert slope == pytest.approx((excess * 0.5 - 0.4) * g, rel=1e-6)
    assert np.ptp(x[:, 2]) < 1e-9


@pytest.mark.parametrize("mu", [0.0, 0.2, 0.9])
@pytest.mark.parametrize("fidelity", [DRAFT, STANDARD], ids=lambda f: f.name)
def test_a_thrown_block_does_not_hop(mu: float, fidelity: Fidelity) -> None:
    run, x = pulled(fidelity, friction=mu, static=mu, speed=3.0, duration=1.0)
    assert np.abs(x[:, 2] - 0.04).max() < 1e-9
    if mu:
        slides = run.t < 0.9 * 3.0 / (mu * g)
        slope = np.polyfit(run.t[slides], run.velocity("block/block")[slides, 0], 1)[0]
        assert slope == pytest.approx(-mu * g, rel=1e-9)
    else:
        assert np.abs(run.velocity("block/block")[:, 0] - 3.0).max() < 1e-12


class Heap(Phenomenon, domain="mechanics"):
    """Balls or boxes thrown about over the floor."""

    kind: Annotated[Literal["ball", "block"], Choice("what is thrown")] = "ball"
    count: Annotated[int, Param("1", 1, 10, "how many")] = 4
    friction: Annotated[float, Param("1", 0.0, 0.9, "of all")] = 0.5
    restitution: Annotated[float, Param("1", 0.0, 1.0, "of all")] = 0.5
    seed: Annotated[int, Param("1", 0, 1000, "places and speeds")] = 0
    ground: Annotated[int, Param("1", 0, 1, "whether the floor is felt")] = 1
    duration: Annotated[float, Param("s", 0.1, 20.0, "watched")] = 1.5

    def build(self, scene: Scene) -> None:
        rng = np.random.default_rng(self.seed)
        surface = Surface(friction=self.friction, restitution=self.restitution)
        scene.material("stage/floor", 2400.0, surface)
        names = ["stage/floor"] if self.ground else []
        for i in range(self.count):
            part = scene.add(self.kind, f"b{i}")
            geom = part.geom(self.kind)
            geom.size[:] = rng.uniform(0.04, 0.08, 3)
            geom.mass = 10 ** rng.uniform(-1, 1)
            turn = rng.normal(size=4)
            place = np.array([0.25 * (i % 2), 0.25 * (i // 2 % 2), 0.25 + 0.25 * (i // 4)]) + rng.normal(size=3) * 0.01
            scene.start[part.name("free")] = free_pose(place, turn / np.linalg.norm(turn))
            inwards = np.array([0.125, 0.125, 0.25]) - place
            scene.speed[part.name("free")] = (*(inwards * 8 + rng.normal(size=3)), *(rng.normal(size=3) * 5))
            scene.material(part.name(self.kind), 1000.0, surface)
            names.append(part.name(self.kind))
        scene.touch(*names)
        scene.resolve(time=0.1, length=0.04, duration=self.duration)

    def caption(self, run: Run) -> str:
        return ""


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("kind", "friction", "restitution"),
    [("ball", 0.9, 0.8), ("ball", 0.3, 0.3), ("block", 0.6, 0.0), ("block", 0.0, 0.6), ("block", 0.6, 0.6)],
)
def test_energy_never_grows(kind: str, friction: float, restitution: float, seed: int) -> None:
    """Newton's law with friction can create energy where a corner strikes (T. R. Kane 1984); see `contact.CREATED`."""
    heap = Heap.make(kind=kind, friction=friction, restitution=restitution, seed=seed, count=4, duration=1.0)
    run = simulate_specimen(heap, fidelity=DRAFT)
    energy = run.motion.kinetic + run.motion.potential
    assert len(run.impacts) > 4
    assert np.diff(energy).max() < 1e-5 * energy[0]  # what the taking back of penetrations costs
    assert energy[-1] < energy[0]
    for body in run.bodies():
        if body.startswith("b"):
            assert run.position(body)[:, 2].min() > 0.03


@pytest.mark.parametrize("kind", ["ball", "block"])
def test_momentum_is_conserved_in_the_air(kind: str) -> None:
    run = simulate_specimen(Heap.make(kind=kind, ground=0, seed=3, count=8, duration=0.5), fidelity=DRAFT)
    assert len(run.impacts) >= 3
    bodies = [b for b in run.bodies() if b.startswith("b")]
    momentum = sum(run.momentum(b) for b in bodies)
    mass = sum(run.mass(b) for b in bodies)
    momentum[:, 2] += mass * g * run.t
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * mass
    spin = sum(run.angular_momentum(b) for b in bodies)
    # about the centre of mass, where gravity has no torque
    centre = sum(run.mass(b) * run.position(b) for b in bodies) / mass
    spin = spin - np.cross(centre, sum(run.momentum(b) for b in bodies))
    assert np.abs(spin - spin[0]).max() < 1e-8 * np.abs(spin).max()


def test_a_lively_ball_comes_to_rest() -> None:
    run = simulate_specimen(Heap(count=1, restitution=0.8, friction=0.0, duration=8.0), fidelity=STANDARD)
    radius = run.model.geom("b0/ball").size[0]
    assert len(run.impacts) < 100
    assert np.abs(run.position("b0/ball")[-50:, 2] - radius).max() < 2e-9
    assert np.abs(run.velocity("b0/ball")[-50:, 2]).max() < 1e-9


class Bullet(Phenomenon, domain="mechanics"):
    """A small ball against a thin wall."""

    speed: Annotated[float, Param("m/s", 1.0, 500.0, "towards the wall")] = 100.0
    distance: Annotated[float, Param("m", 0.1, 10.0, "to the wall")] = 1.0

    def build(self, scene: Scene) -> None:
        ball, wall = scene.add("ball"), scene.add("block")
        ball.geom("ball").size[0], ball.geom("ball").mass = 0.0025, 1e-3
        wall.geom("block").size[:] = 0.005, 1.0, 1.0
        wall.geom("block").mass = 10.0
        scene.start[wall.name("free")] = free_pose((0, 0, 5.0))
        scene.start[ball.name("free")] = free_pose((-self.distance - 0.0075, 0.3, 5.2))
        scene.speed[ball.name("free")] = (self.speed, 0, 0, 0, 0, 0)
        for name in (ball.name("ball"), wall.name("block")):
            scene.material(name, 1000.0, Surface(restitution=0.5))
        scene.touch(ball.name("ball"), wall.name("block"))
        scene.resolve(time=0.1, length=0.005, duration=0.2)

    def caption(self, run: Run) -> str:
        return ""


@pytest.mark.parametrize(
    ("stubborn", "eased"),
    [
        (lambda how: how["bounce"] == 0, {contact.INELASTIC}),
        (lambda how: how["dilate"], {contact.CONVEX}),
        (lambda how: True, set()),
    ],
)
def test_what_cannot_be_solved_is_eased_and_counted(
    stubborn: Callable[[dict[str, Any]], bool], eased: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    settle = contact.Solver._settle
    monkeypatch.setattr(contact.Solver, "_settle", lambda *a, **how: bool(stubborn(how) and settle(*a, **how)))
    run = simulate_specimen(Bullet(distance=0.5), fidelity=DRAFT)
    assert run.eased.keys() == eased
    after = np.searchsorted(run.t, run.impacts[0].time) + 1
    apart = (run.velocity("block/block") - run.velocity("ball/ball"))[after, 0]
    assert apart == pytest.approx(0.0 if eased else 50.0, abs=0.05)


@pytest.mark.parametrize("fidelity", [Fidelity("coarse", 8, 8, 4), DRAFT, STANDARD], ids=lambda f: f.name)
@pytest.mark.parametrize("distance", [0.5, 0.731, 1.0])
def test_a_bullet_never_tunnels(fidelity: Fidelity, distance: float) -> None:
    run = simulate_specimen(Bullet(distance=distance), fidelity=fidelity)
    assert run.impacts[0].time == pytest.approx(distance / 100.0, rel=1e-7)
    assert run.impacts[0].approach == pytest.approx(100.0, rel=1e-9)
    assert (run.position("ball/ball")[:, 0] < run.position("block/block")[:, 0]).all()
    assert run.velocity("ball/ball")[-1, 0] < 0


class Tower(Phenomenon, domain="mechanics"):
    """Boxes one upon the other, each `ratio` times as heavy as the one below, the top one nudged."""

    count: Annotated[int, Param("1", 1, 10, "boxes")] = 3
    ratio: Annotated[float, Param("1", 1e-4, 1e4, "of masses")] = 1.0
    nudge: Annotated[float, Param("m/s", 0.0, 3.0, "of the top box")] = 0.0

    def build(self, scene: Scene) -> None:
        surface = Surface(friction=0.5, restitution=0.1)
        scene.material("stage/floor", 2400.0, surface)
        below = "stage/floor"
        for i in range(self.count):
            part = scene.add("block", f"b{i}")
            part.geom("block").size[:], part.geom("block").mass = (0.1, 0.1, 0.05), self.ratio**i
            scene.start[part.name("free")] = free_pose((0.01 * (-1) ** i, 0, 0.05 + 0.1 * i))
            scene.material(part.name("block"), 1000.0, surface)
            scene.touch(below, part.name("block"))
            below = part.name("block")
        scene.speed[f"b{self.count - 1}/free"] = (self.nudge, 0, 0, 0, 0, 0)
        scene.resolve(time=0.2, length=0.05, duration=1.0)

    def caption(self, run: Run) -> str:
        return ""


@pytest.mark.parametrize("ratio", [1e-4, 1e-2, 1e2, 1e4])
def test_light_bears_heavy(ratio: float) -> None:
    run = simulate_specimen(Tower(count=2, ratio=ratio), fidelity=DRAFT)
    for i in (0, 1):
        at = run.position(f"b{i}/block")
        assert np.abs(at - at[0]).max() < 1e-7


def test_sparse_and_dense_agree() -> None:
    """Newton's solver in both forms (MuJoCo issue 3767: a wrong sparse factor)."""
    ends = []
    for form in (mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_SPARSE):
        specimen = Tower(count=5, nudge=1.0)
        compiled = compile_scene(specimen, build(specimen), DRAFT)
        compiled.model.opt.jacobian = form
        with Stepper(compiled) as stepper:
            for _ in range(compiled.samples // 2):
                stepper.advance()
            ends.append(np.concatenate([stepper.data.qpos, stepper.data.qvel]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-8
    assert np.abs(ends[0][0::13]).max() > 0


def test_impacts_are_seen_at_any_step() -> None:
    """Also where gravity moves nothing by a nanometre within a step."""
    fine = Fidelity("fine", 40 * REFERENCE.steps, 8, 4)
    specimen = Bullet(distance=0.1)
    compiled = compile_scene(specimen, build(specimen), fine)
    with Stepper(compiled) as stepper:
        for _ in range(2):
            stepper.advance()
    assert stepper.impacts[0].time == pytest.approx(1e-3, rel=1e-6)


class TwoFloors(Phenomenon, domain="mechanics"):
    """Two blocks on one floor, each with a surface of its own; the later one is declared first."""

    def build(self, scene: Scene) -> None:
        scene.material("stage/floor", 2400.0, Surface())
        for name, y in (("slow", 0.0), ("fast", 0.5)):
            part = scene.add("block", name)
            scene.start[part.name("free")] = free_pose((0, y, 0.04))
            scene.speed[part.name("free")] = (2.0, 0, 0, 0, 0, 0)
            scene.material(part.name("block"), 700.0, Surface(friction=0.8 if name == "slow" else 0.2))
        scene.touch("fast/block", "stage/floor")
        scene.touch("slow/block", "stage/floor")
        scene.resolve(time=0.2, length=0.04, duration=0.4)

    def caption(self, run: Run) -> str:
        return ""


def test_every_pair_keeps_its_own_surface() -> None:
    run = simulate_specimen(TwoFloors(), fidelity=DRAFT)
    for name, mu in (("slow", 0.4), ("fast", 0.1)):
        speed = run.velocity(f"{name}/block")[:, 0]
        assert np.polyfit(run.t, speed, 1)[0] == pytest.approx(-mu * g, rel=1e-9)


@pytest.mark.parametrize("friction", [0.5, 0.9])
def test_tumbling_boxes_settle(friction: float) -> None:
    """Faces that come to rest on several corners at once, turning and slipping."""
    for seed in (10, 20):
        heap = Heap.make(kind="block", count=5, friction=friction, restitution=0.0, seed=seed, duration=1.2)
        run = simulate_specimen(heap, fidelity=DRAFT)
        assert np.isfinite(run.qpos).all()
