"""What every phenomenon declares, and that it is found."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from physinone_mj import annotate
from physinone_mj.base import Choice, Param, Refusal
from physinone_mj.continuum import Piece
from physinone_mj.fidelity import DRAFT, REFERENCE
from physinone_mj.registry import UnknownPhenomenon, entries, find, phenomenon
from physinone_mj.simulate import build, compile

from .conftest import nominal

each = pytest.mark.parametrize("index", [e.index for e in entries()])

TABLE = """
MovingHitsFixed MovingHitsStationary MovingHitsMoving WindGravityBalance WindPushStationary WindPushSameDir
WindPushOppDir WindDeflectMotion ObliqueProjectile VerticalFall RollDownSlope RollUpSlope MagnetAttract
MagnetRepel UniformPanelSpin AccelPanelSpin UniformConcaveSpin AccelConcaveSpin UniformSurfaceSpin
AccelSurfaceSpin FrictionStop SpringCompress SpringStretch ImpactFracture MirrorFragmentReflect ElasticCouple
SpringboardRebound SeesawCenterPivot SeesawOffsetPivot BalloonFloat BalloonTether BalloonLift FixedPlanarRedirect
FixedArrayRedirect FixedConcaveRedirect FixedConvexRedirect DynMirrorRedirect LaserBlock MirrorReflect CartMove
RotTurnableInertia RotBoardInertia LinCarryInertia CatapultLaunch ChainSuspend SimplePendulum DoublePendulum
CrankPush BlockWallCollapse StickSupportFail FloatOnLiquid DropInLiquid MovingObjDriveLiquid
LiquidCarryMovingObj LiquidHitFixedObj LiquidTransfer LiquidMultiTransfers LiquidThroughGrid LiquidAcrossUneven
LiquidRise LiquidAlongContours JetLiquid LiquidTension LiquidRefraction StickyToObjects StickyFromObjects
ElasticFall PlasticineFall NewtonianFluidFall NonNewtonianFluidFall GranularFall
"""
"""The released dataset's 71 labels, in the order of the paper's Table 8."""

LABELS = TABLE.split()


@each
def test_label_is_the_release_s(index: int) -> None:
    assert find(index).label == phenomenon(index).label == LABELS[index - 1]
    assert phenomenon(LABELS[index - 1]) is phenomenon(index)


@each
def test_what_is_read_is_what_is_run(index: int) -> None:
    entry, cls = find(index), phenomenon(index)
    assert (entry.index, entry.title, entry.domain) == (cls.index, cls.title, cls.domain)
    assert entry.title


@each
def test_every_other_engine_that_is_offered_can_be_had(index: int) -> None:
    specimen = phenomenon(index).make()
    matter = bool(build(specimen).continua)
    for fidelity in (DRAFT, REFERENCE) if matter else (DRAFT,):
        offered = compile(specimen, build(specimen), fidelity).alternatives
        assert len({engine.name for engine in offered}) == len(offered)
        for engine in offered:
            made = compile(specimen, build(specimen), fidelity, engine)
            assert made.alternatives == offered
            assert made.double is (matter and fidelity is DRAFT)
        assert offered or not matter


@each
def test_as_many_cameras_as_the_release_s(index: int) -> None:
    """Twelve that stand still, fifteen where matter deforms; `plan_views` adds the one that moves."""
    assert phenomenon(index).views == (15 if 67 <= index <= 71 else 12)


@each
def test_nominal_values_lie_inside_their_ranges(index: int) -> None:
    cls = phenomenon(index)
    specimen = cls.make()
    for name, (param, kind) in cls.declarations().items():
        assert param.about
        if isinstance(param, Param):
            assert param.low < param.high
            assert param.low <= getattr(specimen, name) <= param.high
            assert isinstance(getattr(specimen, name), kind)
        else:
            assert isinstance(param, Choice)
            assert getattr(specimen, name) in param.words


@each
def test_laws_and_observables_say_where_they_come_from(index: int) -> None:
    cls = phenomenon(index)
    assert cls.laws()
    assert cls.observables()
    for law in cls.laws().values():
        assert law.equation
        cited = any(c.isdigit() for c in law.source) or law.source.startswith("by definition: ")
        assert cited, f"{law.name}: source without a section or equation number"
    for seen in cls.observables().values():
        assert seen.unit
        assert seen.about


@each
def test_observables_are_recorded_over_time(index: int) -> None:
    run = nominal(index, DRAFT)
    for seen in run.specimen.observables().values():
        values = np.asarray(seen.measure(run.specimen, run))
        assert len(values) == len(run), seen.name
        told = "NaN" in seen.about  # that, and when, it is missing
        assert np.isfinite(values).any() if told else np.isfinite(values).all(), seen.name


@each
def test_every_object_says_what_it_is_made_of(index: int) -> None:
    run = nominal(index, DRAFT)
    things = annotate.things(run)
    assert [t.id for t in things] == list(range(1, len(things) + 1))
    for thing in things:
        made = thing.matter.material if isinstance(thing.matter, Piece) else thing.matter
        assert 0.09 <= made.density <= 22600.0, thing  # from hydrogen, in balloons, to osmium
    stage = [i for i in range(run.model.ngeom) if run.model.geom(i).name.startswith("stage/")]
    assert not annotate.geom_ids(run)[stage].any()


@each
def test_every_object_has_a_mesh(index: int) -> None:
    """Which a scene folder holds."""
    run = nominal(index, DRAFT)
    for thing in annotate.things(run):
        mesh = annotate.mesh(run, thing)
        assert np.isfinite(mesh.vertices).all()
        if len(mesh.vertices) and thing.body:
            assert 0 < np.ptp(mesh.vertices, axis=0).max() < 1e3, thing.name


@each
def test_moving_bodies_have_their_frame_at_the_centre_of_mass(index: int) -> None:
    model = nominal(index, DRAFT).model
    moving = np.flatnonzero(model.body_weldid != 0)
    assert np.abs(model.body_ipos[moving]).max(initial=0.0) < 1e-9


@each
def test_motion_takes_place_above_the_floor_and_within_reach(index: int) -> None:
    run = nominal(index, DRAFT)
    moving = np.flatnonzero(run.model.body_weldid != 0)
    places = [run.motion.position[:, moving].reshape(-1, 3)]
    places += [corner for cloud in run.clouds.values() for corner in (cloud.low, cloud.high)]
    everywhere = np.concatenate(places)
    assert everywhere[:, 2].min() > (-0.2 * run.cell if run.clouds else 0.0)
    assert np.ptp(everywhere, axis=0).max() < 15


@each
def test_caption_reads_like_the_release_s(index: int) -> None:
    run = nominal(index, DRAFT)
    caption = run.specimen.caption(run)
    assert 40 <= len(caption.split()) <= 110
    assert "\n" not in caption
    assert caption.endswith(".")


@each
def test_the_scene_is_between_two_and_fifteen_seconds(index: int) -> None:
    scene = build(phenomenon(index).make())
    assert 2 <= scene.duration <= 15
    assert scene.fps == (60 if 33 <= index <= 38 else 30)  # the release's laser scenes


@each
def test_same_seed_same_bytes(index: int) -> None:
    run = nominal(index, DRAFT)
    again = run.again()
    for name in ("t", "qpos", "qvel"):
        assert getattr(run, name).tobytes() == getattr(again, name).tobytes()
    assert bool(run.clouds) == (67 <= index <= 71)
    for name, cloud in run.clouds.items():
        assert cloud.position.tobytes() == again.clouds[name].position.tobytes()


@each
def test_recorded_eight_times_a_frame_whatever_the_fidelity(index: int) -> None:
    specimen = phenomenon(index).make()
    finer = dataclasses.replace(REFERENCE, name="finer", steps=DRAFT.steps * 2)
    coarse, fine = (compile(specimen, build(specimen), fidelity) for fidelity in (DRAFT, finer))
    assert coarse.stride >= 8
    assert (coarse.samples, coarse.stride) == (fine.samples, fine.stride)
    assert coarse.step >= fine.step
    run = nominal(index, DRAFT)
    assert len(run) == coarse.samples
    assert np.allclose(np.diff(run.t), 1 / (run.scene.fps * run.stride), rtol=1e-9)


def test_unknown_index_names_those_there_are() -> None:
    with pytest.raises(UnknownPhenomenon, match=r"no phenomenon 99; there are: .*46"):
        find(99)


def test_unknown_label_names_the_nearest() -> None:
    with pytest.raises(UnknownPhenomenon, match="did you mean SimplePendulum"):
        find("simplependulm")


def test_interactable_objects_have_all_four_kinds_of_constraint() -> None:
    """Linear and angular limits and motors, as the source document names them; each binds or drives a scene."""
    shown: dict[str, set[int]] = {}
    for index in (15, 40, 44):
        specimen = phenomenon(index).make()
        scene = build(specimen)
        model = compile(specimen, scene, DRAFT).model
        kinds = {int(mujoco.mjtJoint.mjJNT_SLIDE): "linear", int(mujoco.mjtJoint.mjJNT_HINGE): "angular"}
        limits = [kinds[int(model.jnt_type[j])] + " limit" for j in range(model.njnt) if model.jnt_limited[j]]
        motors = [kinds[int(model.joint(motor.joint).type[0])] + " motor" for motor in scene.motors]
        for kind in limits + motors:
            shown.setdefault(kind, set()).add(index)
    assert shown["angular motor"] >= {15}
    assert shown["linear motor"] >= {40}
    assert shown["linear limit"] >= {40}
    assert shown["angular limit"] >= {44}


NEEDS_ANOTHER = {(15, "near", "wedge"), (24, "event", "hang"), (38, "blocker", "block")}


@pytest.mark.parametrize("index", [e.index for e in entries()])
def test_every_kind_can_be_had_by_its_name(index: int) -> None:
    """With everything else as it is, none is refused but those that need another setting, which they name."""
    cls = phenomenon(index)
    for name, (declared, _) in cls.declarations().items():
        for word in declared.words if isinstance(declared, Choice) else ():
            made = cls.make(**{name: word})
            if (index, name, word) in NEEDS_ANOTHER:
                with pytest.raises(Refusal, match="allowed"):
                    build(made)
            else:
                compile(made, build(made), DRAFT)


def test_the_readme_lists_what_there_is() -> None:
    """Every phenomenon by index, label and number of laws, and the sums of both."""
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    laws = {entry.index: len(phenomenon(entry.index).laws()) for entry in entries()}
    rows = re.findall(r"^\| (\d+) \| (\w+) \| .+ \| (\d+) \|$", readme, re.MULTILINE)
    assert {(int(index), label, int(count)) for index, label, count in rows} == {
        (entry.index, entry.label, laws[entry.index]) for entry in entries()
    }
    assert f"The {len(laws)} phenomena" in readme
    assert f"{sum(laws.values())} laws" in readme
