"""Every template is a valid model of its own and leaves the engine's settings alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from importlib import resources
from pathlib import Path

import mujoco
import pytest

TEMPLATES = sorted(p for p in Path(str(resources.files("mjcf_templates"))).glob("*.xml"))
each_template = pytest.mark.parametrize("path", TEMPLATES, ids=lambda p: p.stem)


@each_template
def test_opens_alone(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.ngeom > 0
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert not data.warning.number.any()


@each_template
def test_sets_no_time_step_gravity_or_solver(path: Path) -> None:
    root = ElementTree.parse(path).getroot()
    assert root.find("option") is None
    assert root.find("size") is None
    assert root.find("contact") is None, "who touches whom is the scene's to say"
    assert not [e for e in root.iter() if {"solref", "solimp"} & set(e.attrib)]


@each_template
def test_everything_can_be_overwritten_by_name(path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(path))
    assert all(model.geom(i).name for i in range(model.ngeom))
    assert all(model.joint(i).name for i in range(model.njnt))
    assert all(model.body(i).name for i in range(model.nbody))
    assert not model.geom_contype.any(), "contact is declared, pair by pair"
    assert not model.geom_conaffinity.any()
