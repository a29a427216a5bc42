"""What holds, drives, bends and breaks bodies, each against a closed form or an equation integrated elsewhere.

Scenes are bare: only the bodies and joints that the one thing under test needs. Lengths in metres, masses in kilograms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from physinone_mj import contact
from physinone_mj.base import Phenomenon
from physinone_mj.contact import Surface
from physinone_mj.fidelity import DRAFT, STANDARD, Fidelity
from physinone_mj.fracture import bond as weld
from physinone_mj.run import Run
from physinone_mj.scene import Bond, Bowl, Motor, Scene, free_pose
from physinone_mj.simulate import Compiled, Stepper
from physinone_mj.simulate import compile as compile_scene

Array = NDArray[np.float64]
g = 9.80665

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
SPHERE, BOX, CYLINDER = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER


class Bare(Phenomenon, domain="mechanics"):
    """Whatever the test puts into the scene."""

    def build(self, scene: Scene) -> None:
        raise AssertionError("built in the test")

    def caption(self, run: Run) -> str:
        return ""


def scene(*, gravity: float = g, duration: float = 1.0) -> Scene:
    """Nothing but the floor; 64, 128 and 256 steps make 1, 2 and 4 steps of a sample of 1/240 s."""
    empty = Scene(gravity=gravity)
    empty.resolve(time=0.267, length=0.1, duration=duration)
    return empty


def compiled(what: Scene, fidelity: Fidelity = DRAFT) -> Compiled:
    return compile_scene(Bare(), what, fidelity)


def run(what: Scene, fidelity: Fidelity = DRAFT) -> Run:
    """Its whole duration."""
    ready = compiled(what, fidelity)
    states = []
    with Stepper(ready) as stepper:
        for i in range(ready.samples):
            if i:
                stepper.advance()
            states.append((stepper.data.time, stepper.data.qpos.copy(), stepper.data.qvel.copy(), stepper.worked))
        stepper.inspect()
    t, qpos, qvel, worked = (np.array(x) for x in zip(*states, strict=True))

    def again(**_: Any) -> Run:
        raise AssertionError

    return Run(
        specimen=ready.specimen, fidelity=fidelity, seed=0, scene=what, model=ready.model, t=t, qpos=qpos, qvel=qvel,
        stride=ready.stride, impacts=tuple(stepper.impacts), breaks=tuple(stepper.breaks), step=ready.step,
        seconds=0.0, worked=worked, again_with=again,
    )  # fmt: skip


def body(what: Scene, name: str, place: ArrayLike = (0, 0, 0), *, on: str | None = None) -> Any:
    parent = what.spec.worldbody if on is None else what.spec.body(on)
    return parent.add_body(name=name, pos=place)


def shape(bearer: Any, kind: Any, size: ArrayLike, mass: float, **more: Any) -> None:
    """A geom of the body's name."""
    padded = [*np.ravel(size), 0.0, 0.0][:3]
    bearer.add_geom(name=bearer.name, type=kind, size=padded, mass=mass, contype=0, conaffinity=0, **more)


def free(what: Scene, name: str, kind: Any, size: ArrayLike, mass: float, place: ArrayLike, velocity: ArrayLike = (),
         surface: Surface | None = None, spin: ArrayLike = (0, 0, 0)) -> Any:  # fmt: skip
    """A free body of one geom."""
    made = body(what, name)
    made.add_freejoint(name=f"{name}/free")
    shape(made, kind, size, mass)
    what.start[f"{name}/free"] = free_pose(place)
    if len(np.ravel(velocity)):
        what.speed[f"{name}/free"] = (*np.ravel(velocity), *np.ravel(spin))
    if surface is not None:
        what.material(name, 1000.0, surface)
    return made


def jointed(what: Scene, name: str, kind: Any, axis: ArrayLike, mass: float, inertia: float = 1.0,
            place: ArrayLike = (0, 0, 0), **joint: Any) -> Any:  # fmt: skip
    """A body of no shape on a hinge or slide of the same name, its centre of mass in its origin."""
    made = body(what, name, place)
    made.add_joint(name=name, type=kind, axis=axis, **joint)
    made.mass, made.inertia, made.explicitinertial = mass, [inertia] * 3, True
    return made


def torque(what: Scene, joint: str, value: float, gear: float = 1.0) -> None:
    """A constant torque or force by an MJCF motor."""
    actuator = what.spec.add_actuator(name=f"{joint}/motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.gear[0] = gear
    what.control[f"{joint}/motor"] = value


@dataclass(frozen=True)
class Force:
    """A constant force on a body [N], as an effect."""

    body: str
    force: tuple[float, float, float]

    def bind(self, model: Any) -> Callable[[Any], None]:
        number = model.body(self.body).id

        def push(data: Any) -> None:
            data.xfrc_applied[number, :3] += self.force

        return push

    def potential(self, model: Any, data: Any) -> float:
        return 0.0


# Motors


def test_a_motor_keeps_its_course_at_the_end_of_every_step() -> None:
    course = ((0.0, 0.0), (0.3, 2.0), (0.55, -1.0), (0.8, -1.0))
    what = scene()
    jointed(what, "wheel", HINGE, (0, 0, 1), 1.0, 0.3)
    what.motors.append(Motor("wheel", course))
    ready = compiled(what)
    times, speeds = np.array(course).T
    area = np.concatenate([[0.0], np.cumsum(np.diff(times) * (speeds[1:] + speeds[:-1]) / 2)])
    with Stepper(ready) as stepper:
        data = stepper.data
        while data.time < 1.0:
            stepper._step()
            now = min(data.time, 0.8)
            speed = np.interp(now, times, speeds)
            assert data.qvel[0] == pytest.approx(speed, abs=1e-12)
            i = np.searchsorted(times, now, side="right") - 1
            angle = area[i] + (now - times[i]) * (speeds[i] + speed) / 2 + (data.time - now) * speed
            assert data.qpos[0] == pytest.approx(angle, abs=20 * ready.step**2)  # the knots lie within steps


def test_a_weak_motor_turns_with_its_greatest_torque_until_it_is_fast_enough() -> None:
    what = scene()
    jointed(what, "wheel", HINGE, (0, 0, 1), 1.0, 0.3)
    what.motors.append(Motor("wheel", ((0.0, 2.0),), force=1.5))
    seen = run(what)
    expected = np.minimum(1.5 / 0.3 * seen.t, 2.0)
    assert np.abs(seen.joint_speed("wheel") - expected).max() < 1e-11
    late = seen.t > 0.45
    assert np.ptp(seen.joint("wheel")[late] - 2.0 * seen.t[late]) < 1e-12


@pytest.mark.parametrize("force", [math.inf, 4.0])
def test_the_work_of_a_motor_is_what_it_turns_into(force: float) -> None:
    """½ I ω² of a wheel that it speeds up, all of which it takes back as it stops it; so does one that is too weak."""
    inertia, fast = 2.0, 3.0
    what = scene(duration=4.5)
    jointed(what, "wheel", HINGE, (0, 0, 1), 1.0, inertia)
    what.motors.append(Motor("wheel", ((0.0, 0.0), (1.0, fast), (2.5, fast), (2.6, 0.0)), force=force))
    seen = run(what)
    speed = seen.joint_speed("wheel")
    assert seen.worked == pytest.approx(0.5 * inertia * speed**2, abs=1e-9)
    assert seen.worked.max() == pytest.approx(0.5 * inertia * fast**2, rel=1e-9)
    assert seen.worked[-1] == pytest.approx(0.0, abs=1e-9)


def test_the_work_of_a_motor_lifts() -> None:
    """m g l (1 - cos θ) of a pendulum, which it takes back as that sinks on the other side."""
    length, mass, slow = 0.5, 2.0, 1.0
    what = scene(duration=5.0)
    arm = jointed(what, "arm", HINGE, (0, -1, 0), mass, 1e-3)
    arm.ipos = (0, 0, -length)
    what.speed["arm"] = slow
    what.motors.append(Motor("arm", ((0.0, slow),)))
    seen = run(what)
    lifted = mass * g * length * (1 - np.cos(seen.joint("arm")))
    assert np.ptp(lifted) == pytest.approx(2 * mass * g * length, rel=1e-3)
    assert seen.worked == pytest.approx(lifted, abs=1e-4 * lifted.max())


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_weak_motor_stalls_against_a_load(share: float) -> None:
    """It lifts a pendulum slowly: past the angle where its torque bears the weight only the speed carries on."""
    length, mass, slow = 0.5, 2.0, 1.0
    what = scene(duration=1.8)
    arm = jointed(what, "arm", HINGE, (0, -1, 0), mass, 1e-3)
    arm.ipos = (0, 0, -length)
    what.speed["arm"] = slow
    weight = mass * g * length
    what.motors.append(Motor("arm", ((0.0, slow),), force=share * weight))
    seen = run(what)
    balance, inertia = math.asin(share), mass * length**2 + 1e-3

    def left(angle: float) -> float:
        """Kinetic energy beyond the balance, where the whole torque pushes."""
        return 0.5 * inertia * slow**2 + share * weight * (angle - balance) + weight * (
            math.cos(angle) - math.cos(balance)
        )  # fmt: skip

    angles = np.linspace(balance, balance + 0.7, 20001)
    highest = angles[np.argmax(np.array([left(a) for a in angles]) < 0)]
    assert seen.joint("arm").max() == pytest.approx(highest, abs=1e-4)
    rising = seen.t * slow < 0.98 * balance
    assert np.abs(seen.joint_speed("arm")[rising] - slow).max() < 1e-11


@pytest.mark.parametrize("force", [math.inf, 3.0])
def test_only_a_motor_that_prescribes_stands_up_to_a_blow(force: float) -> None:
    what = scene(gravity=0.0, duration=0.6)
    paddle = body(what, "paddle")
    paddle.add_joint(name="paddle", type=SLIDE, axis=(1, 0, 0))
    shape(paddle, BOX, (0.02, 0.1, 0.1), 2.0)
    what.material("paddle", 1000.0, Surface(restitution=0.5))
    free(what, "ball", SPHERE, 0.05, 0.5, (0.27, 0, 0), surface=Surface(restitution=0.5))
    what.touch("paddle", "ball")
    what.speed["paddle"] = 1.0
    what.motors.append(Motor("paddle", ((0.0, 1.0),), force=force))
    seen = run(what)
    blow = 1.5 * 1.0 / (1 / 0.5 + (0.0 if force == math.inf else 1 / 2.0))
    assert len(seen.impacts) == 1
    assert seen.impacts[0].time == pytest.approx(0.2, abs=1e-8)
    assert abs(seen.impacts[0].impulse[0]) == pytest.approx(blow, rel=1e-9)
    assert seen.velocity("ball")[-1, 0] == pytest.approx(blow / 0.5, rel=1e-9)
    after = seen.t > seen.impacts[0].time
    dip = 0.0 if force == math.inf else blow / 2.0
    expected = np.minimum(1.0, 1.0 - dip + force / 2.0 * (seen.t[after] - 0.2)) if dip else np.ones(after.sum())
    assert np.abs(seen.joint_speed("paddle")[after] - expected).max() < 1e-7


def test_a_motor_that_is_off_lets_go() -> None:
    off = 0.4321
    what = scene()
    jointed(what, "wheel", HINGE, (0, 0, 1), 1.0, 0.3)
    torque(what, "wheel", -0.6)
    what.speed["wheel"] = 2.0
    what.motors.append(Motor("wheel", ((0.0, 2.0),), off=off))
    seen = run(what)
    since = np.maximum(seen.t - off, 0.0)
    assert np.abs(seen.joint_speed("wheel") - (2.0 - 2.0 * since)).max() < 1e-10
    assert np.abs(seen.joint("wheel") - (2.0 * seen.t - since**2)).max() < 1e-10


def test_an_mjcf_motor_pushes_with_its_control() -> None:
    what = scene()
    jointed(what, "cart", SLIDE, (1, 0, 0), 4.0)
    torque(what, "cart", 3.0, gear=2.0)
    seen = run(what)
    assert np.abs(seen.joint("cart") - 0.5 * 6.0 / 4.0 * seen.t**2).max() < 1e-12


# Friction and limits of joints and tendons


@pytest.mark.parametrize("fidelity", [DRAFT, STANDARD], ids=lambda f: f.name)
def test_friction_in_a_joint_is_coulombs(fidelity: Fidelity) -> None:
    mass, friction, speed = 2.0, 3.0, 1.234
    what = scene(duration=1.2)
    jointed(what, "cart", SLIDE, (1, 0, 0), mass, frictionloss=friction)
    what.speed["cart"] = speed
    seen = run(what, fidelity)
    until = np.minimum(seen.t, speed * mass / friction)
    slows = seen.t < speed * mass / friction - seen.step
    expected = speed * until - 0.5 * friction / mass * until**2
    assert np.abs(seen.joint("cart") - expected)[slows].max() < 1e-12
    assert np.abs(seen.joint("cart") - expected).max() < 0.5 * friction / mass * seen.step**2
    assert np.ptp(seen.joint("cart")[seen.t > speed * mass / friction + seen.step]) < 1e-12


@pytest.mark.parametrize("load", [-2.999, 2.999, 3.5])
def test_friction_in_a_joint_holds_up_to_its_greatest(load: float) -> None:
    what = scene()
    jointed(what, "cart", SLIDE, (1, 0, 0), 2.0, frictionloss=3.0)
    torque(what, "cart", load)
    seen = run(what)
    beyond = math.copysign(max(abs(load) - 3.0, 0.0), load)
    assert np.abs(seen.joint("cart") - 0.5 * beyond / 2.0 * seen.t**2).max() < 1e-11


def test_a_limit_of_a_joint_is_an_inelastic_stop() -> None:
    """Thrown up against a stop, falling from it, coming to rest on the other."""
    what = scene(duration=1.0)
    jointed(what, "lift", SLIDE, (0, 0, 1), 2.0, limited=True, range=(-0.1, 0.3))
    what.speed["lift"] = 3.0
    seen = run(what)
    up = (3.0 - math.sqrt(9.0 - 2 * g * 0.3)) / g
    down = up + math.sqrt(2 * 0.4 / g)
    z, t = seen.joint("lift"), seen.t
    pieces = [(t < up, 3.0 * t - g * t**2 / 2), ((t > up) & (t < down), 0.3 - g * (t - up) ** 2 / 2),
              (t > down, np.full(len(t), -0.1))]  # fmt: skip
    for when, expected in pieces:
        assert when.sum() > 10
        assert np.abs(z - expected)[when].max() < 2e-8
    assert np.abs(seen.joint_speed("lift")[t > down]).max() < 1e-8


def string(what: Scene, length: float, place: ArrayLike, velocity: ArrayLike) -> None:
    """A ball of no size worth mentioning on a string from the origin."""
    free(what, "bob", SPHERE, 1e-3, 0.5, place, velocity).add_site(name="end")
    what.spec.worldbody.add_site(name="nail")
    cord = what.spec.add_tendon(name="string", limited=True, range=(0.0, length))
    cord.wrap_site("nail")
    cord.wrap_site("end")


def swing(length: float, angle: float, speed: float, t: Array) -> Array:
    """Angle of a pendulum by an integrator that shares nothing with ours."""
    return np.asarray(solve_ivp(lambda _, y: [y[1], -g / length * math.sin(y[0])], (0, t[-1]), [angle, speed],
                     method="DOP853", t_eval=t, rtol=1e-12, atol=1e-12).y[0])  # fmt: skip


def test_a_taut_string_keeps_its_length() -> None:
    length, angle = 0.8, 1.2
    stretch, off, gained = [], [], []
    for steps in (64, 128):
        what = scene(duration=2.0)
        string(what, length, (length * math.sin(angle), 0, -length * math.cos(angle)), (0, 0, 0))
        seen = run(what, Fidelity("test", steps, 8, 4))
        at = seen.position("bob")
        stretch.append(np.abs(np.linalg.norm(at, axis=1) - length).max())
        off.append(np.abs(np.arctan2(at[:, 0], -at[:, 2]) - swing(length, angle, 0.0, seen.t)).max())
        energy = seen.motion.kinetic + seen.motion.potential
        gained.append((energy - np.minimum.accumulate(energy)).max() / seen.motion.kinetic.max())
    for error, most in ((stretch, 1e-4), (off, 1e-3), (gained, 5e-4)):
        assert error[0] < most
        assert error[0] / error[1] > 3.4


def test_a_slack_string_is_not_there_until_it_is_taut() -> None:
    """Thrown inwards: a parabola, to the instant when the length is reached; what is along the string is then lost."""
    length = 0.8
    place, velocity = np.array([0.5, 0, -0.2]), np.array([-1.0, 0.7, 2.0])
    what = scene(duration=1.0)
    string(what, length, place, velocity)
    seen = run(what)
    down = np.array([0, 0, -g])

    def path(t: Any) -> Array:
        return np.asarray(place + np.multiply.outer(t, velocity) + np.multiply.outer(np.square(t), down / 2))

    fine = np.linspace(0, 1, 1_000_001)
    taut = fine[np.argmax(np.linalg.norm(path(fine), axis=1) > length)]
    slack = seen.t < taut - 1e-6
    assert 10 < slack.sum() < len(slack) - 10
    assert np.abs(seen.position("bob") - path(seen.t))[slack].max() < 1e-12
    with_string, pull = velocity + taut * down, path(taut) / length
    kept = with_string - pull * (pull @ with_string)
    first = np.argmin(slack)
    after = seen.t[first] - taut
    assert np.abs(seen.velocity("bob")[first] - kept).max() < 15 * after + 1e-5  # as far as an acceleration takes it
    assert abs(seen.velocity("bob")[first] @ pull) < 15 * after
    assert np.linalg.norm(seen.position("bob"), axis=1).max() < length + 1e-4
    energy = seen.motion.kinetic + seen.motion.potential
    assert energy[first] == pytest.approx(energy[0] - 0.25 * (pull @ with_string) ** 2, rel=1e-4)
    assert (energy - np.minimum.accumulate(energy)).max() < 2e-4 * seen.motion.kinetic.max()


# Equalities


def test_a_pendulum_by_equality_is_of_fourth_order() -> None:
    """A free rod held at its end by `connect`, against the equation of a physical pendulum."""
    half, mass, angle = 0.4, 1.0, 1.0
    inertia = mass / 3 * (half**2 + 0.02**2)
    off, gaps = [], []
    for steps in (64, 128, 256):
        what = scene(duration=2.0)
        rod = free(what, "rod", BOX, (0.02, 0.02, half), mass, (0, 0, 0))
        rod.add_site(name="top", pos=(0, 0, half))
        what.spec.worldbody.add_site(name="nail")
        turn = (math.cos(angle / 2), 0, -math.sin(angle / 2), 0)
        what.start["rod/free"] = free_pose((half * math.sin(angle), 0, -half * math.cos(angle)), turn)
        what.connect("pin", "nail", "top")
        seen = run(what, Fidelity("test", steps, 8, 4))
        at = seen.position("rod")
        reduced = (inertia + mass * half**2) / (mass * half)
        off.append(np.abs(np.arctan2(at[:, 0], -at[:, 2]) - swing(reduced, angle, 0.0, seen.t)).max())
        gaps.append(np.abs(np.linalg.norm(at, axis=1) - half).max())
    assert off[0] < 1e-7
    assert max(gaps) < 1e-13
    assert 14 < off[0] / off[1] < 18
    assert off[1] / off[2] > 12


def test_welded_bodies_take_a_blow_as_one() -> None:
    """A dumbbell of two welded balls is struck off its centre."""
    what = scene(gravity=0.0, duration=0.5)
    bouncy = Surface(restitution=0.6)
    free(what, "near", SPHERE, 0.05, 1.0, (0, 0.2, 0), surface=bouncy)
    free(what, "far", SPHERE, 0.05, 3.0, (0, -0.2, 0), surface=bouncy)
    free(what, "ball", SPHERE, 0.05, 0.5, (-0.2, 0.2, 0), (2.0, 0, 0), bouncy)
    for name, y in (("near", 0.2), ("far", -0.2)):
        what.spec.body(name).pos = (0, y, 0)
    weld(what, "rod", "near", "far")
    what.touch("ball", "near")
    seen = run(what)
    mass, centre = 4.0, (0.2 - 3 * 0.2) / 4
    inertia = 0.4 * 0.05**2 * mass + (0.2 - centre) ** 2 + 3 * (0.2 + centre) ** 2
    blow = 1.6 * 2.0 / (1 / 0.5 + 1 / mass + (0.2 - centre) ** 2 / inertia)
    assert abs(seen.impacts[0].impulse[0]) == pytest.approx(blow, rel=1e-9)
    first = np.argmax(seen.t > seen.impacts[0].time)
    together = (seen.momentum("near") + seen.momentum("far"))[first:]
    assert np.abs(together - [blow, 0, 0]).max() < 1e-10
    for name in ("near", "far"):
        assert np.abs(seen.spin(name)[first:] - [0, 0, -blow * (0.2 - centre) / inertia]).max() < 5e-4
    turning = seen.angular_momentum("near") + seen.angular_momentum("far") + seen.angular_momentum("ball")
    assert np.abs(turning - turning[0]).max() < 1e-5
    apart = np.linalg.norm(seen.position("near") - seen.position("far"), axis=1)
    assert np.abs(apart - 0.4).max() < 1e-4


def test_geared_wheels_share_a_torque() -> None:
    what = scene()
    jointed(what, "small", HINGE, (0, 0, 1), 1.0, 0.2)
    jointed(what, "large", HINGE, (0, 0, 1), 1.0, 0.9)
    gears = what.spec.add_equality(name="teeth", name1="small", name2="large")
    gears.type, gears.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    gears.data[:5] = (0, -2.5, 0, 0, 0)
    torque(what, "large", 1.7)
    seen = run(what)
    rate = 1.7 / (0.9 + 2.5**2 * 0.2)
    assert np.abs(seen.joint("large") - 0.5 * rate * seen.t**2).max() < 1e-11
    assert np.abs(seen.joint("small") + 2.5 * seen.joint("large")).max() < 1e-11


@pytest.mark.parametrize("holder", ["string", "pin"])
def test_a_cut_comes_at_its_own_instant(holder: str) -> None:
    when = 0.41234567
    what = scene()
    string(what, 0.5, (0, 0, -0.5), (0, 0, 0))
    if holder == "pin":
        what.spec.delete(what.spec.tendon("string"))
        what.spec.worldbody.add_site(name="hook", pos=(0, 0, -0.5))
        what.connect("pin", "hook", "end")
    what.cuts[holder] = when
    seen = run(what)
    fall = np.maximum(seen.t - when, 0.0)
    assert np.abs(seen.position("bob") - np.multiply.outer([0, 0, 1.0], -0.5 - g * fall**2 / 2).T).max() < 1e-8


def test_a_cut_string_lets_go_along_the_tangent() -> None:
    """Without gravity, out of a circle."""
    when, length, rate = 0.41234567, 0.5, 3.0
    what = scene(gravity=0.0)
    string(what, length, (length, 0, 0), (0, rate * length, 0))
    what.cuts["string"] = when
    seen = run(what)
    after = seen.t > when
    path = seen.velocity("bob")[after]
    assert np.ptp(path, axis=0).max() < 1e-12
    angle = rate * when
    straight = length * np.array([math.cos(angle), math.sin(angle), 0]) + np.multiply.outer(
        seen.t[after] - when, rate * length * np.array([-math.sin(angle), math.cos(angle), 0])
    )
    assert np.abs(seen.position("bob")[after] - straight).max() < 2e-4


# Bowls


def bowl(what: Scene, radius: float, *, rim: float = 0.0, friction: float = 0.0, spin: float = 0.0) -> None:
    """A cup whose sphere has its centre in the origin; it turns if `spin` [rad/s]."""
    cup = body(what, "cup")
    if spin:
        cup.add_joint(name="cup", type=HINGE, axis=(0, 0, 1))
        what.motors.append(Motor("cup", ((0.0, spin),)))
        what.speed["cup"] = spin
    shape(cup, SPHERE, 0.02, 1.0, pos=(0, 0, -radius))
    cup.add_site(name="centre")
    what.material("cup", 1000.0, Surface(friction=friction))
    what.bowls.append(Bowl("cup", "centre", radius, rim))


@pytest.mark.parametrize(("friction", "stretch"), [(0.0, 1.0), (2.0, math.sqrt(7 / 5))], ids=["sliding", "rolling"])
def test_a_ball_in_a_bowl_swings_as_a_pendulum(friction: float, stretch: float) -> None:
    radius, small, angle = 0.5, 0.06, 0.9
    period = 4 * stretch * math.sqrt((radius - small) / g) * float(ellipk(math.sin(angle / 2) ** 2))
    what = scene(duration=1.1 * period)
    bowl(what, radius, friction=friction)
    reach = radius - small
    start = (reach * math.sin(angle), 0, -reach * math.cos(angle))
    free(what, "ball", SPHERE, small, 0.3, start, surface=Surface(friction=friction))
    what.touch("cup", "ball")
    seen = run(what)
    x, speed, t = seen.position("ball")[:, 0], seen.velocity("ball")[:, 0], seen.t
    back = np.flatnonzero((speed[:-1] > 0) & (speed[1:] <= 0) & (x[1:] > 0))
    assert len(back) == 1
    i = back[0]
    turned = t[i] + (t[i + 1] - t[i]) * speed[i] / (speed[i] - speed[i + 1])
    assert turned == pytest.approx(period, rel=1e-4)
    assert np.abs(np.linalg.norm(seen.position("ball"), axis=1) - reach).max() < 1e-4


def test_a_smooth_bowl_may_spin_as_it_likes() -> None:
    paths = []
    for spin in (0.0, 12.0):
        what = scene(duration=0.5)
        bowl(what, 0.5, spin=spin)
        place = 0.44 * np.array([math.sin(0.9), 0, -math.cos(0.9)])
        free(what, "ball", SPHERE, 0.06, 0.3, place, (0, 0.8, 0), Surface())
        what.touch("cup", "ball")
        seen = run(what)
        paths.append(seen.position("ball"))
        assert np.abs(seen.spin("ball")).max() < 1e-12
        around = seen.angular_momentum("ball")[:, 2]
        assert np.abs(around - around[0]).max() < 1e-12
    assert np.abs(paths[0] - paths[1]).max() < 1e-10


def steepest(radius: float, half: float, friction: float) -> float:
    """Where a cube in a bowl begins to slip, all four corners at once, turning about the centre of the sphere.

    Forces along and across the cube and moments about the centre, of normal forces N± at the corners (±a, ±a, -h) and
    friction μ N against the slip:  N₊ + N₋ = A, N₊ - N₋ = B,
        μ h A/ρ - a B/R = m g sin α,  h A/R + μ a B/ρ = m g cos α,  μ ρ A = m g d sin α,
    with h² = R² - 2a², d = h - a (of the centre of mass), ρ² = R² - a² (of the corners from the axis).
    """
    h = math.sqrt(radius**2 - 2 * half**2)
    d, rho = h - half, math.sqrt(radius**2 - half**2)
    return math.atan(1 / (h * d / (friction * rho * radius) + friction * radius / rho * (h * d / rho**2 - 1)))


@pytest.mark.parametrize("friction", [0.3, 0.7])
@pytest.mark.parametrize("excess", [0.98, 1.02])
def test_a_cube_in_a_bowl_holds_up_to_the_angle_of_friction(friction: float, excess: float) -> None:
    radius, half = 0.5, 0.05
    angle = excess * steepest(radius, half, friction)
    what = scene(duration=0.4)
    bowl(what, radius, friction=friction)
    d = math.sqrt(radius**2 - 2 * half**2) - half
    free(what, "cube", BOX, (half,) * 3, 0.4, (0, 0, 0), surface=Surface(friction=friction))
    turn = (math.cos(angle / 2), 0, -math.sin(angle / 2), 0)
    what.start["cube/free"] = free_pose((d * math.sin(angle), 0, -d * math.cos(angle)), turn)
    what.touch("cup", "cube")
    seen = run(what)
    gone = np.linalg.norm(seen.position("cube") - seen.position("cube")[0], axis=1)
    if excess < 1:
        assert gone.max() < 1e-8
    else:
        assert gone[-1] > 1e-3


@pytest.mark.parametrize("rim", [0.0, -0.2])
def test_a_ball_leaves_the_bowl_over_its_rim(rim: float) -> None:
    """Shot up a smooth wall: pendulum to the rim, parabola beyond.

    When it passes the rim is known to half a step, in which it turns by v h/2.
    """
    radius, small, shot = 0.5, 0.06, 4.5
    reach = radius - small
    what = scene(duration=0.62)
    bowl(what, radius, rim=rim)
    free(what, "ball", SPHERE, small, 0.3, (0, 0, -reach), (shot, 0, 0), Surface())
    what.touch("cup", "ball")
    seen = run(what)
    below = -rim / radius  # cosine of the angle at which it leaves
    speed = math.sqrt(shot**2 - 2 * g * reach * (1 - below))
    turn = speed * 0.6 * seen.step / reach
    angles = math.acos(below) + np.array([-turn, 0, turn])
    tops = -reach * np.cos(angles) + (shot**2 - 2 * g * reach * (1 - np.cos(angles))) * np.sin(angles) ** 2 / (2 * g)
    z = seen.position("ball")[:, 2]
    highest = int(np.argmax(z))
    assert tops.min() - 1e-3 < z[highest] < tops.max() + 1e-3
    assert tops.min() > 0.05
    flying = (z > 0.05) & (np.arange(len(z)) >= highest)
    assert flying.sum() > 5
    assert np.ptp(seen.velocity("ball")[flying, 0]) < 1e-12
    assert seen.velocity("ball")[highest, 0] == pytest.approx(speed * below, abs=1.1 * speed * turn)


# Riders and forces that depend on velocity


def riding(rate: float) -> tuple[Run, Array]:
    """A block on a turning table, and its distance from the axis."""
    what = scene(duration=1.0)
    rough = Surface(friction=0.8)
    table = body(what, "table")
    table.add_joint(name="table", type=HINGE, axis=(0, 0, 1))
    shape(table, CYLINDER, (0.5, 0.02), 2.0)
    what.material("table", 1000.0, rough)
    free(what, "block", BOX, (0.04, 0.03, 0.02), 0.2, (0.3, 0, 0.04), (0, rate * 0.3, 0), rough, (0, 0, rate))
    what.touch("table", "block")
    what.motors.append(Motor("table", ((0.0, rate),)))
    what.speed["table"] = rate
    seen = run(what)
    return seen, np.linalg.norm(seen.position("block")[:, :2], axis=1)


def test_who_rides_a_turntable_keeps_the_radius() -> None:
    seen, radius = riding(3.0)
    assert np.abs(radius - 0.3).max() < 3e-5
    angle = np.unwrap(np.arctan2(*seen.position("block")[:, 1::-1].T))
    assert np.abs(angle - 3.0 * seen.t).max() < 1e-3


def test_it_is_the_turning_of_the_rows_that_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the rider drifts outwards by ω² h/2 of its radius in a second."""
    monkeypatch.setattr(contact._Before, "drift", lambda *_: None)
    seen, radius = riding(3.0)
    assert radius[-1] / 0.3 - 1 == pytest.approx(3.0**2 * seen.step / 2, rel=0.05)


def engaged(what: Scene) -> None:
    """A slide with friction: a constraint that is always there and has nothing to do with the rest."""
    jointed(what, "elsewhere", SLIDE, (1, 0, 0), 1.0, place=(5, 0, 0), frictionloss=1.0)


def test_damping_is_of_second_order_beside_a_constraint() -> None:
    """A slide with viscous damping, far from a joint that friction holds: x = v m/c (1 - exp(-c t/m))."""
    off = []
    for steps in (64, 128, 256):
        what = scene(duration=1.0)
        engaged(what)
        jointed(what, "cart", SLIDE, (1, 0, 0), 2.0).joints[0].damping[0] = 6.0
        what.speed["cart"] = 1.5
        seen = run(what, Fidelity("test", steps, 8, 4))
        off.append(np.abs(seen.joint("cart") - 1.5 / 3 * (1 - np.exp(-3 * seen.t))).max())
    assert off[0] < 2e-5
    assert 3.6 < off[0] / off[1] < 4.4
    assert 3.6 < off[1] / off[2] < 4.4


def test_tumbling_is_of_second_order_beside_a_constraint() -> None:
    """A free box about its middle axis, against Euler's equations integrated elsewhere (world spin and attitude)."""
    half, start = np.array([0.1, 0.06, 0.03]), np.array([0.1, 5.0, 0.2])
    moments = 0.5 / 3 * (np.sum(half**2) - half**2)

    def euler(_: float, w: Array) -> Array:
        return np.asarray(np.cross(moments * w, w) / moments)

    off = []
    for steps in (128, 256):
        what = scene(gravity=0.0, duration=1.0)
        engaged(what)
        free(what, "box", BOX, half, 0.5, (0, 0, 1), (0, 0, 0), spin=start)
        seen = run(what, Fidelity("test", steps, 8, 4))
        spin = seen.joint_speed("box/free")[:, 3:]
        there = solve_ivp(euler, (0, seen.t[-1]), start, method="DOP853", t_eval=seen.t, rtol=1e-12, atol=1e-12).y.T
        off.append(np.abs(spin - there).max())
    assert off[0] < 1e-2
    assert 3.4 < off[0] / off[1] < 4.6


# Bonds


def hung(strength: float, *, arm: float = 0.0, lever: float = 0.1, pull: float = 0.0, duration: float = 0.2) -> Run:
    """A ball of 2 kg welded under a bracket, sideways of it by `arm`, pulled down by an effect."""
    what = scene(duration=duration)
    body(what, "bracket", (0, 0, 1))
    free(what, "ball", SPHERE, 0.05, 2.0, (arm, 0, 0.9))
    what.spec.body("ball").pos = (arm, 0, 0.9)
    weld(what, "glue", "bracket", "ball", anchor=(-arm, 0, 0))
    what.bonds.append(Bond("glue", strength, lever))
    if pull:
        what.effects.append(Force("ball", (0, 0, -pull)))
    return run(what)


@pytest.mark.parametrize(("arm", "pull"), [(0.0, 0.0), (0.0, 30.0), (0.15, 0.0)])
def test_a_bond_bears_its_strength_and_no_more(arm: float, pull: float) -> None:
    """|F| + |M|/lever of what hangs there, to a millionth."""
    load = (2.0 * g + pull) * (1 + arm / 0.1)
    holds = hung(load * (1 + 1e-6), arm=arm, pull=pull)
    assert holds.breaks == ()
    assert np.abs(holds.position("ball") - holds.position("ball")[0]).max() < 1e-9
    goes = hung(load * (1 - 1e-6), arm=arm, pull=pull)
    assert [b.weld for b in goes.breaks] == ["glue"]
    assert goes.breaks[0].load == pytest.approx(load, rel=1e-7)
    fall = goes.t - goes.breaks[0].time
    late = fall > 2 * goes.step
    accelerated = np.polyfit(fall[late], goes.velocity("ball")[late, 2], 1)[0]
    assert accelerated == pytest.approx(-g - pull / 2.0, rel=1e-9)


def test_a_bond_of_infinite_strength_never_breaks() -> None:
    held = hung(math.inf, arm=0.15, pull=1e5)
    assert held.breaks == ()
    assert np.abs(held.position("ball") - held.position("ball")[0]).max() < 1e-6


def test_what_is_bonded_is_not_asked_whether_it_meets() -> None:
    """Of overlapping meshes whose margin was -1000 km MuJoCo reported, every fourth time, that as their distance."""
    what = scene(gravity=0.0)
    rng = np.random.default_rng(0)
    for name, x in (("near", 0.0), ("far", 0.2)):
        points = rng.normal(size=(12, 3))
        points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
        what.spec.add_mesh(name=name, uservert=points.ravel())
        made = body(what, name, (x, 0, 0))
        made.add_freejoint(name=f"{name}/free")
        made.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=1.0, contype=0, conaffinity=0)
        what.material(name, 1000.0, Surface())
        what.start[f"{name}/free"] = free_pose((x, 0, 0))
    weld(what, "rod", "near", "far")
    what.bonds.append(Bond("rod", math.inf, 0.1))
    what.touch("near", "far")
    with Stepper(compiled(what)) as stepper:
        data, solver = stepper.data, stepper._solver
        assert solver is not None
        for _ in range(50):
            data.qpos[7:10] = data.qpos[:3] + rng.uniform(-0.05, 0.05, 3)
            data.qpos[3:7], data.qpos[10:14] = rng.normal(size=(2, 4))
            solver.begin(data, 0.004, g)
            solver.place(data)
            assert data.ncon == 0


def dumbbell(strength: float, *, rate: float = 0.0, speed: float = 0.0, touch: bool = False) -> Run:
    """Two welded balls of 1 and 3 kg along x, without gravity; they spin, or a third ball of 0.5 kg strikes the near
    one from behind at a speed."""
    what = scene(gravity=0.0, duration=0.4)
    bouncy = Surface(restitution=0.6)
    centre = 0.15
    for name, mass, x in (("near", 1.0, 0.0), ("far", 3.0, 0.2)):
        free(what, name, SPHERE, 0.05, mass, (x, 0, 0), (0.3, rate * (x - centre), 0.1) if rate else (), bouncy,
             (0, 0, rate))  # fmt: skip
        what.spec.body(name).pos = (x, 0, 0)
    weld(what, "rod", "near", "far")
    what.bonds.append(Bond("rod", strength, 0.1))
    if speed:
        free(what, "ball", SPHERE, 0.05, 0.5, (-0.2, 0, 0), (speed, 0, 0), bouncy)
        what.touch("ball", "near")
    if touch:
        what.touch("near", "far")
    return run(what)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_breaking_changes_no_momentum(share: float) -> None:
    """What spins pulls with m ω² r; the break lets the balls go, each along its tangent."""
    rate = 6.0
    seen = dumbbell(share * 1.0 * rate**2 * 0.15, rate=rate)
    momentum = seen.momentum("near") + seen.momentum("far")
    assert np.abs(momentum - [1.2, 0, 0.4]).max() < 1e-12
    assert len(seen.breaks) == (share < 1)
    spin = seen.angular_momentum("near") + seen.angular_momentum("far")
    energy = seen.kinetic("near") + seen.kinetic("far")
    if share < 1:
        assert seen.breaks[0].load == pytest.approx(rate**2 * 0.15, rel=2e-3)
        assert np.abs(spin - spin[0]).max() < 1e-8  # held for one step, see below
        assert np.abs(energy - energy[0]).max() < 2e-4
        after = seen.t > seen.breaks[0].time + seen.step
        assert np.ptp(spin[after], axis=0).max() < 1e-12
        assert np.ptp(energy[after]) < 1e-12
    else:
        assert np.abs(spin - spin[0]).max() < 1e-4
        assert np.abs(energy - energy[0]).max() < 2e-3


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_blow_breaks_a_bond(share: float) -> None:
    """The far ball's share of the impulse passes through the bond, in a millisecond; broken, it stays behind."""
    speed = 2.0
    blow = 1.6 * speed / (1 / 0.5 + 1 / 4.0)
    load = blow * 3.0 / 4.0 / contact.CONTACT_TIME
    seen = dumbbell(share * load, speed=speed)
    after = seen.t > 0.051
    assert len(seen.breaks) == (share < 1)
    assert len(seen.impacts) == 1, "one blow, though it was solved twice"
    if share < 1:
        alone = 1.6 * speed / (1 / 0.5 + 1 / 1.0)
        assert seen.breaks[0].load == pytest.approx(load, rel=1e-9)
        assert seen.breaks[0].time == pytest.approx(0.05, abs=1e-8)
        expected = {"ball": speed - alone / 0.5, "near": alone / 1.0, "far": 0.0}
    else:
        expected = {"ball": speed - blow / 0.5, "near": blow / 4.0, "far": blow / 4.0}
    for name, v in expected.items():
        assert np.abs(seen.velocity(name)[after] - [v, 0, 0]).max() < 1e-9


@pytest.mark.parametrize("strength", [1e-3, 300.0, 1e9])
@pytest.mark.parametrize("speed", [0.5, 2.0, 10.0])
def test_the_same_instant_solved_again_creates_no_energy(strength: float, speed: float) -> None:
    seen = dumbbell(strength, speed=speed, touch=True)
    energy = np.sum([seen.kinetic(name) for name in ("near", "far", "ball")], axis=0)
    assert len(seen.breaks) == (strength < 0.75 * 0.5 * 1.6 * speed * 8 / 9 / contact.CONTACT_TIME)
    assert np.diff(energy).max() < 1e-12 * energy[0]
    momentum = np.sum([seen.momentum(name) for name in ("near", "far", "ball")], axis=0)
    assert np.abs(momentum - [0.5 * speed, 0, 0]).max() < 1e-12 * speed


# Spins


@pytest.mark.parametrize("rate", [30.0, 300.0, 3000.0])
@pytest.mark.parametrize("slides", [True, False])
def test_a_fast_splinter_keeps_its_energy(rate: float, slides: bool) -> None:
    """A box that tumbles about its middle axis, at 240 steps a second, beside another that slides, or flies, too."""
    what, rough = scene(duration=0.5), Surface(friction=0.5)
    what.material("stage/floor", 1000.0, rough)
    free(what, "box", BOX, [0.05] * 3, 1.0, (0, 0, 0.05 if slides else 5), (3, 0, 0), rough)
    free(what, "splinter", BOX, (0.01, 0.02, 0.05), 0.1, (2, 0, 5), (0, 0, 0), None, (0.1 * rate, rate, 0.02 * rate))
    what.touch("stage/floor", "box")
    seen = run(what)
    spin, inertia = seen.qvel[:, -3:], seen.model.body("splinter").inertia
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, seen.model.body("splinter").iquat)
    spin = spin @ axes.reshape(3, 3)
    energy, angular = spin**2 @ inertia / 2, np.linalg.norm(spin * inertia, axis=1)
    assert np.ptp(spin[:, 0]) > rate / 10 or rate > 1000, "it does not tumble"
    within = 1e-10 if slides else 2e-2
    assert np.abs(energy / energy[0] - 1).max() < within
    assert np.abs(angular / angular[0] - 1).max() < within


# Crowds


def wall(friction: float, *, speed: float = 6.0, duration: float = 0.5) -> Run:
    """Four columns of four cubes on the floor, and a ball of five cubes' mass thrown at them."""
    what = scene(duration=duration)
    surface = Surface(friction=friction, restitution=0.2)
    what.material("stage/floor", 1000.0, surface)
    names = ["stage/floor"]
    for row in range(4):
        for column in range(4):
            names.append(f"b{row}{column}")
            place = (0.1001 * column, 0, 0.05 + 0.1 * row)
            free(what, names[-1], BOX, (0.05, 0.05, 0.05), 0.7, place, surface=surface)
    free(what, "ball", SPHERE, 0.09, 3.5, (0.16, -0.3, 0.23), (0, speed, 0.2), surface)
    what.touch(*names, "ball")
    return run(what)


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_a_wall_struck_by_a_ball_gains_no_energy(friction: float) -> None:
    seen = wall(friction)
    energy = seen.motion.kinetic + seen.motion.potential
    assert len(seen.impacts) > 10
    assert np.abs(seen.position("b21")[-1] - seen.position("b21")[0]).max() > 0.1
    assert (energy - np.minimum.accumulate(energy)).max() < 1e-3 * energy[0]
    assert energy[-1] < 0.95 * energy[0]
    if not friction:
        level = np.sum([seen.momentum(name)[:, :2] for name in seen.bodies()], axis=0)
        assert np.abs(level - [0, 3.5 * 6.0]).max() < 1e-10


# Sleep


def stack(*, thrown: bool = False, push: float = 0.0, tendon: bool = False, duration: float = 0.6) -> Scene:
    """Three boxes on each other, and perhaps a ball that arrives after 0.4 s."""
    what = scene(duration=duration)
    surface = Surface(friction=0.5, restitution=0.2)
    what.material("stage/floor", 1000.0, surface)
    names = ["stage/floor", "low", "middle", "top"]
    for i, name in enumerate(names[1:]):
        free(what, name, BOX, (0.06, 0.06, 0.04), 0.5, (0, 0, 0.04 + 0.08 * i), surface=surface)
    if thrown:
        names.append("ball")
        free(what, "ball", SPHERE, 0.05, 0.4, (-0.06 - 0.05 - 4.0 * 0.4, 0.01, 0.14), (4.0, 0, 0.4 * g / 2), surface)
    if push:
        what.effects.append(Force("top", (push, 0, 0)))
    if tendon:
        jointed(what, "cart", SLIDE, (1, 0, 0), 1.0, place=(5, 0, 0))
        what.spec.add_tendon(name="thread").wrap_joint("cart", 1.0)
    what.touch(*names)
    return what


def asleep(what: Scene) -> Array:
    """For every sample of its duration, how many bodies sleep."""
    ready = compiled(what)
    counts = []
    with Stepper(ready) as stepper:
        assert stepper._solver is not None
        for _ in range(ready.samples - 1):
            stepper.advance()
            counts.append(np.count_nonzero(stepper._solver._heap))
    return np.array(counts)


def test_what_rests_sleeps_and_keeps_its_place_to_the_bit() -> None:
    counts = asleep(stack(duration=0.3))
    assert counts[-1] == 3
    first = int(np.argmax(counts == 3)) + 1
    assert first < 40
    seen = run(stack(duration=0.3))
    assert (seen.qpos[first:] == seen.qpos[first]).all()
    assert (seen.qvel[first:] == 0).all()
    assert np.abs(seen.qpos[first] - seen.qpos[0]).max() < 1e-8


def test_balls_beside_each_other_sleep() -> None:
    what = scene(duration=0.3)
    what.material("stage/floor", 1000.0, Surface(friction=0.5))
    for i in range(3):
        free(what, f"ball{i}", SPHERE, 0.05, 0.5, (0.2 * i, 0, 0.05), surface=Surface(friction=0.5))
    what.touch("stage/floor", "ball0", "ball1", "ball2")
    assert (asleep(what)[20:] == 3).all()


def test_what_sleeps_wakes_before_it_is_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """And then moves as if it had never slept."""
    counts = asleep(stack(thrown=True))
    rested = run(stack(thrown=True))
    monkeypatch.setattr(contact.Solver, "rest", lambda *_: False)
    awake = run(stack(thrown=True))
    hit = next(i.time for i in awake.impacts if "ball" in (i.first, i.second))
    assert hit == pytest.approx(0.4, abs=1e-3)
    before = rested.t[1:] < hit - 2 * rested.step
    assert counts[before].max() == 3
    assert counts[np.argmax(rested.t[1:] > hit)] == 0
    until = rested.t < hit
    assert np.abs(rested.qpos - awake.qpos)[until].max() < 1e-6
    assert [(i.first, i.second) for i in rested.impacts] == [(i.first, i.second) for i in awake.impacts]
    times = [np.array([i.time for i in seen.impacts]) for seen in (rested, awake)]
    assert np.abs(times[0] - times[1]).max() < 1e-4
    assert np.abs(rested.qpos - awake.qpos).max() < 1e-3


@pytest.mark.parametrize("why", ["push", "tendon"])
def test_what_may_yet_be_moved_never_sleeps(why: str) -> None:
    counts = asleep(stack(push=0.1) if why == "push" else stack(tendon=True))
    assert counts.max() == 0
