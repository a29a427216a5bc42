"""Small worlds to draw."""

from importlib import resources

import mujoco
import numpy as np

from render.film import Footage
from render.rig import Sphere


def staged(xml):
    """The model of `xml` on the stage, and ids: 0 for the stage, otherwise the geom's index plus 1."""
    spec = mujoco.MjSpec.from_string(xml)
    stage = mujoco.MjSpec.from_string((resources.files("mjcf_templates") / "stage.xml").read_text(encoding="utf-8"))
    spec.attach(stage, prefix="stage/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    ids = [0 if model.geom(i).name.startswith("stage/") else i + 1 for i in range(model.ngeom)]
    return model, np.array(ids)


BALL = """<mujoco><worldbody>
  <body pos="0 0 0"><freejoint/><geom type="sphere" size=".05" rgba=".84 .27 .22 1"/></body>
</worldbody></mujoco>"""

CROWD = """<mujoco><worldbody>
  <geom name="box" type="box" pos="0 0 .2" size=".2 .2 .2" rgba=".94 .76 .28 1"/>
  <geom name="proxy" type="box" pos=".8 0 .3" size=".2 .2 .3" group="3"/>
  <geom name="beam" type="capsule" fromto="-.8 -.8 .4 -.8 .8 .4" size=".05" rgba="1 0 1 1" group="4"/>
  <site type="sphere" pos="0 .8 .3" size=".2" rgba="0 1 0 1"/>
  <body pos="0 -.6 .15"><freejoint/><geom name="ball" type="sphere" size=".15" rgba=".23 .47 .76 1"/></body>
</worldbody></mujoco>"""

SPRING = """<mujoco><worldbody>
  <site name="top" pos="0 0 1"/>
  <body pos="0 0 .5"><joint type="slide" axis="0 0 1"/><geom type="box" size=".1 .1 .05"/><site name="bob"/></body>
</worldbody>
<tendon><spatial width=".01" rgba="0 1 0 1"><site site="top"/><site site="bob"/></spatial></tendon></mujoco>"""

PENDULUM = """<mujoco><worldbody>
  <geom type="capsule" fromto="0 -.3 1 0 .3 1" size=".02"/>
  <body pos="0 0 1"><joint axis="0 1 0"/>
    <geom name="bob" type="sphere" pos="0 0 -.6" size=".1" rgba=".84 .27 .22 1"/></body>
</worldbody></mujoco>"""


def pendulum(frames=9, size=(64, 64), **changes):
    """A footage without views."""
    model, ids = staged(PENDULUM)
    qpos = 0.6 * np.cos(np.linspace(0, 3, frames))[:, None]
    return Footage(model, qpos, ids, Sphere(np.array([0, 0, 0.6]), 0.6), size=size, **changes)
