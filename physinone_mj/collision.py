"""Where surfaces touch: MuJoCo's collision stage, what it gets wrong and what it does not know.

A `Solver` of `contact` asks a `Collider` for the contacts of a moment. They are MuJoCo's, but for

    cylinders that all but stand on a plane, which are held upright while MuJoCo looks (`_stand`);
    polyhedra, of which it leaves the deepest contact out or takes faces that do not meet (`Polyhedra`);
    boxes on the end of a cylinder, whose contacts are found here (`_End`);
    the inside of bowls, for which MuJoCo has no shape (`_Cup`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .contact import Surface
    from .scene import Bowl

Array = NDArray[np.float64]

_DISABLE = mujoco.mjtDisableBit

IMPEDANCE: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""MuJoCo's solimp at its stiffest; what softness is left is taken out by `contact`."""

_NEVER: Final = -1e6
"""Margin of a pair with a plane that is not looked at [m]."""

_NOWHERE: Final = 1e6
"""Gap of a contact that does not count any more [m]."""

_LEVEL: Final = 0.95
"""Cosine of the tilt up to which a box lies on the end of a cylinder."""

_FLAT: Final = 1e-4
"""Tilt beyond which it is known where along the rim it touches [rad]."""

_FLUSH: Final = 1e-8
"""Tilt of a cylinder on a plane up to which it stands upright [rad]. MuJoCo 4.0 (`mjraw_PlaneCylinder`) looks for the
lowest point of the rim along a difference that cancels: its direction is off by about 1e-16 over the tilt, so that at
1e-15 it sees the rim centimetres away, or not at all."""

_LOOKING: Final = 1000
"""Iterations in which MuJoCo may find how near two convex surfaces are. It makes both larger by half of how far it
looks, and the depth of what is then round takes many: its own 35 were 2 mm off for splinters of 3 cm that are looked at
from 30 cm away; from 5 m away it needs 1000."""

_MOST: Final = 4
"""Contacts that MuJoCo leaves of two polyhedra: those that span the largest area, whether the deepest is one of them or
not. Looked at from far enough, two that all but lie on each other were seen to sink in by 4 mm on a corner left out."""

_SAME: Final = 1e-6
"""A contact that is deeper by less is one of those [m]; MuJoCo finds depths to about 3e-7 (`ccd_tolerance`)."""

_ASIDE: Final = 1e-3
_ALIKE: Final = 0.9995
"""Contacts that are too deep by more than this part of the smaller's radius belong to another two faces, and so do
those whose normal is turned by more than a cosine of this."""

_NEAR: Final = 0.02
"""Gap, over the smaller's radius, below which that is looked into."""

_POLYHEDRA: Final = [int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")) for kind in ("CYLINDER", "BOX", "MESH")]
"""What such contacts are of, but for two boxes, whose are all there."""


@njit(cache=True)
def _stand(pairs: NDArray[np.int32], turn: Array) -> int:
    """Turn the axes of cylinders that all but stand on a plane wholly upright; returns of how many."""
    stood = 0
    for plane, cylinder in pairs:
        tilt = along = 0.0
        for k in range(3):
            a, b = 3 * ((k + 1) % 3) + 2, 3 * ((k + 2) % 3) + 2
            tilt += (turn[plane, a] * turn[cylinder, b] - turn[plane, b] * turn[cylinder, a]) ** 2
            along += turn[plane, 3 * k + 2] * turn[cylinder, 3 * k + 2]
        if 0.0 < tilt < _FLUSH**2:
            for k in range(3):
                turn[cylinder, 3 * k + 2] = turn[plane, 3 * k + 2] * np.sign(along)
            stood += 1
    return stood


def _pairs_of(model: Any, first: Any, second: Any) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Numbers (n,) and geoms (n, 2) of the pairs of two types of geoms, the lower type first, that may touch."""
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2]).reshape(-1, 2)
    pairs = np.take_along_axis(pairs, np.argsort(model.geom_type[pairs], axis=1), axis=1)
    numbers = np.flatnonzero((model.geom_type[pairs] == (int(first), int(second))).all(axis=1))
    return numbers, np.asarray(pairs[numbers])


def on_planes(model: Any) -> NDArray[np.int32]:
    """The pairs (n, 2) of a plane and a cylinder among those that may touch."""
    return _pairs_of(model, mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_CYLINDER)[1]


def collide(model: Any, data: Any, upright: NDArray[np.int32], polyhedra: Polyhedra) -> None:
    """MuJoCo's collision stage, in which those of the cylinders `on_planes` that all but stand do stand, and what it
    says of polyhedra is mended."""
    turns = data.geom_xmat.copy()
    stood = _stand(upright, data.geom_xmat)
    mujoco.mj_collision(model, data)
    if polyhedra:
        polyhedra.mend(data)
    if stood:
        data.geom_xmat[:] = turns


def _unseen(model: Any) -> Array:
    """Margins (npair,) with which pairs are not looked at [m]: minus the sum of the radii. MuJoCo squares what is left
    between two centres, and then does not look closer (of two meshes looked at with a margin of -1e6 it reports every
    fourth time an overlap of as much)."""
    radii = model.geom_rbound[np.column_stack([model.pair_geom1, model.pair_geom2])].reshape(-1, 2)
    return np.where(radii.all(axis=1), -radii.sum(axis=1), _NEVER)


class Polyhedra:
    """Pairs of polyhedra of a model, of which MuJoCo makes one contact by its search for the shortest way apart
    (`mjc_Convex`), and from that several where two faces are all but parallel (`mjDSBL_MULTICCD`), with two defects:
    the deepest need not be one of them (`_MOST`); and the faces it takes may be others than those that meet, as where
    two plates lie on each other with an edge: then the way apart is along the plates instead of across.

    Where either may be so, the one contact is looked for again, and added or put in place of the others.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        pairs = np.column_stack([model.pair_geom1, model.pair_geom2]).reshape(-1, 2)
        types = model.geom_type[pairs]
        boxes = (types == int(mujoco.mjtGeom.mjGEOM_BOX)).all(axis=1)
        numbers = np.flatnonzero(np.isin(types, _POLYHEDRA).all(axis=1) & ~boxes)
        self._number = np.full((model.ngeom, model.ngeom), -1, np.int32)
        for first, second in ((0, 1), (1, 0)):
            self._number[pairs[numbers, first], pairs[numbers, second]] = numbers
        self._size = model.geom_rbound[pairs].min(axis=1, initial=np.inf)
        self._away = _unseen(model)
        self._scratch = mujoco.MjData(model) if len(numbers) else None

    def __bool__(self) -> bool:
        return self._scratch is not None

    def mend(self, data: Any) -> None:
        """Set right what `mj_collision` has found."""
        found, model, scratch = data.contact, self._model, self._scratch
        assert scratch is not None
        first, last, pair = _doubtful(found.geom, found.dist, self._number, self._size)
        if not len(pair):
            return
        scratch.geom_xpos[:], scratch.geom_xmat[:] = data.geom_xpos, data.geom_xmat
        margin, gap, flags = model.pair_margin.copy(), model.pair_gap.copy(), model.opt.disableflags
        model.pair_margin[:], model.pair_gap[:] = self._away, 0.0
        model.pair_margin[pair], model.pair_gap[pair] = margin[pair], gap[pair]
        model.opt.disableflags = flags | _DISABLE.mjDSBL_MULTICCD
        mujoco.mj_collision(model, scratch)
        model.pair_margin[:], model.pair_gap[:], model.opt.disableflags = margin, gap, flags
        one = scratch.contact
        numbers = self._number[one.geom[:, 0], one.geom[:, 1]].tolist()
        depth, place, frame = one.dist.copy(), one.pos.copy(), one.frame.copy()
        for i, j, number in zip(first.tolist(), last.tolist(), pair.tolist(), strict=True):
            if number not in numbers:
                continue
            k, deepest = numbers.index(number), float(found.dist[i:j].min())
            if depth[k] < deepest - _SAME:
                here = slice(k, k + 1)
                _fill(model, data, _like(found[i]), depth[here], place[here], frame[here], margin[number])
                found = data.contact
            elif depth[k] > deepest + _ASIDE * self._size[number] or found.frame[i, :3] @ frame[k, :3] < _ALIKE:
                found.dist[i], found.pos[i], found.frame[i] = depth[k], place[k], frame[k]
                found.exclude[i] = int(depth[k] >= margin[number])
                found.dist[i + 1 : j], found.exclude[i + 1 : j] = _NOWHERE, 1


@njit(cache=True)
def _doubtful(
    geom: NDArray[np.int32], dist: Array, number: NDArray[np.int32], size: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of polyhedra whose contacts may be wrong: the first of these, the last + 1 and the number of the pair."""
    runs = np.empty((3, len(geom)), np.int64)
    first = found = 0
    for i in range(1, len(geom) + 1):
        if i == len(geom) or geom[i, 0] != geom[first, 0] or geom[i, 1] != geom[first, 1]:
            pair = number[geom[first, 0], geom[first, 1]]
            if pair >= 0 and (i - first == _MOST or dist[first:i].min() < _NEAR * size[pair]):
                runs[0, found], runs[1, found], runs[2, found] = first, i, pair
                found += 1
            first = i
    return runs[0, :found], runs[1, :found], runs[2, :found]


class Collider:
    """The contacts of one model: MuJoCo's, set right and completed.

    pairs: the surface of each of the model's predefined contact pairs, in order; cups: (bowl, geom that may lie in it,
    their surface)
    """

    def __init__(self, model: Any, pairs: Sequence[Surface], cups: Sequence[tuple[Bowl, int, Surface]]) -> None:
        self._model = model
        model.opt.ccd_iterations = _LOOKING
        self._upright = on_planes(model)
        self._polyhedra = Polyhedra(model)
        numbers, lying = _pairs_of(model, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX)
        self._ends = [(i, _End(model, geoms, pairs[i])) for i, geoms in zip(numbers, lying, strict=True)]
        self._cups = [_Cup(model, *cup) for cup in cups]
        self._unseen = _unseen(model)

    def bend(self, data: Any) -> float:
        """Centripetal acceleration that bowls give what slides along them [m/s²]: no more than that is no impact."""
        return max((cup.bend(self._model, data) for cup in self._cups), default=0.0)

    def reach(self, margin: float, ahead: float, unseen: NDArray[np.bool_]) -> None:
        """Contacts nearer than `margin` [m] have rows, those nearer than `margin` + `ahead` are found; none of pairs
        that are `unseen` (npair,)."""
        self._model.pair_margin[:] = np.where(unseen, self._unseen, margin)
        self._model.pair_gap[:] = np.where(unseen, 0.0, ahead)
        for cup in self._cups:
            cup.margin, cup.ahead = margin, ahead

    def place(self, data: Any) -> None:
        """Everything that follows from the positions: poses, contacts, rows."""
        model, option = self._model, self._model.opt
        if not (len(self._upright) or self._polyhedra or self._ends or self._cups):
            mujoco.mj_fwdPosition(model, data)
            return
        flags = option.disableflags
        option.disableflags = flags | _DISABLE.mjDSBL_CONTACT | _DISABLE.mjDSBL_CONSTRAINT
        mujoco.mj_fwdPosition(model, data)
        option.disableflags = flags
        margin, gap = model.pair_margin.copy(), model.pair_gap.copy()
        lying = []
        for i, end in self._ends:
            reach = margin[i] + gap[i]
            if reach > 0.0 and (found := end.find(data, reach)) is not None:
                lying.append((end, found, margin[i]))
                model.pair_margin[i], model.pair_gap[i] = self._unseen[i], 0.0
        collide(model, data, self._upright, self._polyhedra)
        model.pair_margin[:], model.pair_gap[:] = margin, gap
        for end, found, room in lying:
            end.add(model, data, found, room)
        for cup in self._cups:
            cup.add(model, data)
        mujoco.mj_makeConstraint(model, data)
        # of contacts too far away for a row MuJoCo gives the last one the number 0, which is another's
        data.contact.efc_address[data.contact.exclude != 0] = -1


def _blank(geom: int, other: int, surface: Surface) -> Any:
    """A contact of two geoms, to be filled in with where and how."""
    contact = mujoco.MjContact()
    contact.dim = 3 if surface.static_friction > 0 else 1
    contact.friction = (1.0, 1.0, 0.0, 0.0, 0.0)
    contact.solref, contact.solreffriction = (0.02, 1.0), (0.0, 0.0)
    contact.solimp = IMPEDANCE
    contact.geom = contact.geom1, contact.geom2 = geom, other
    return contact


def _like(other: Any) -> Any:
    """A contact of the same geoms, to be filled in with where and how."""
    contact = mujoco.MjContact()
    for field in ("dim", "friction", "solref", "solreffriction", "solimp", "geom", "geom1", "geom2"):
        setattr(contact, field, getattr(other, field))
    return contact


def _fill(model: Any, data: Any, contact: Any, gaps: Array, places: Array, frames: Array, margin: float) -> None:
    """Add contacts to those that MuJoCo has found: gaps (n,), places (n, 3), frames (n, 9)."""
    for i in range(len(gaps)):
        contact.dist, contact.pos, contact.frame = gaps[i], places[i], frames[i]
        contact.includemargin, contact.exclude = margin, int(gaps[i] >= margin)
        if mujoco.mj_addContact(model, data, contact):
            raise MemoryError("no room for the contacts of a bowl or rim")


class _End:
    """The end of a cylinder on which a box lies. MuJoCo 4.0 is not asked about such a pair. Of two faces it finds the
    corners of the one above the other, so that a box that juts out over the rim sinks until it tilts; and it gives all
    of them the normal of the box's face: for the box's own corners that is wrong by its tilt, and on an end that turns
    away below, at many metres per second, it lets them in."""

    def __init__(self, model: Any, geoms: NDArray[np.int32], surface: Surface) -> None:
        self._disc, self._block = (int(geom) for geom in geoms)
        self._radius, self._half = (float(size) for size in model.geom_size[self._disc, :2])
        self._size = model.geom_size[self._block].copy()
        self._contact = _blank(self._disc, self._block, surface)

    def find(self, data: Any, reach: float) -> tuple[Array, Array, Array] | None:
        """Gaps, places and frames nearer than `reach` of the box that lies on the end or above it; None if it does
        not."""
        lies, gaps, places, frames = _on_end(
            data.geom_xmat[self._disc], data.geom_xpos[self._disc], self._radius, self._half,
            data.geom_xmat[self._block], data.geom_xpos[self._block], self._size, reach,
        )  # fmt: skip
        return (gaps, places, frames) if lies else None

    def add(self, model: Any, data: Any, found: tuple[Array, Array, Array], margin: float) -> None:
        """Add what `find` has found to the contacts."""
        _fill(model, data, self._contact, *found, margin)


@njit(cache=True)
def _on_end(
    disc: Array, centre: Array, radius: float, half: float, turn: Array, place: Array, size: Array, reach: float
) -> tuple[bool, Array, Array, Array]:
    """Whether a box's lowest face lies on a cylinder's end; gaps (n,), places (n, 3) and frames (n, 9): its corners
    above the end (the normal is the end's axis), where its edges cross the rim (across both) and on the rim between
    (the face's normal).
    """
    gaps, places, frames = np.empty(20), np.empty((20, 3)), np.empty((20, 9))
    nothing = False, gaps[:0], places[:0], frames[:0]
    out, normal, face, end, axis = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        out[k] = place[k] - centre[k]
    side = np.sign(out[0] * disc[2] + out[1] * disc[5] + out[2] * disc[8])
    # the box's axis that is most upright on the end, and the other two
    best, along = 0, 0.0
    for j in range(3):
        c = side * (disc[2] * turn[j] + disc[5] * turn[3 + j] + disc[8] * turn[6 + j])
        if abs(c) > abs(along):
            best, along = j, c
    if abs(along) < _LEVEL:
        return nothing
    u, w = (best + 1) % 3, (best + 2) % 3
    for k in range(3):
        axis[k] = side * disc[3 * k + 2]
        normal[k] = np.sign(along) * turn[3 * k + best]
        face[k] = place[k] - normal[k] * size[best]
        end[k] = centre[k] + half * axis[k]
    # in the box's axes u and w the rim is (a + r cos φ + s sin φ), for each of the two; it is highest on the face at φ*
    a, r, s = np.zeros(2), np.zeros(2), np.zeros(2)
    for i, j in ((0, u), (1, w)):
        for k in range(3):
            a[i] += (end[k] - face[k]) * turn[3 * k + j]
            r[i] += radius * disc[3 * k] * turn[3 * k + j]
            s[i] += radius * disc[3 * k + 1] * turn[3 * k + j]
    rise = np.zeros(2)
    for i in range(2):
        for k in range(3):
            rise[i] += disc[3 * k + i] * normal[k]
    tilt, steepest = rise[0] ** 2 + rise[1] ** 2, np.arctan2(rise[1], rise[0])
    found = 0
    for corner in range(4):
        height = aside = 0.0
        for k in range(3):
            out[k] = face[k] - end[k]
            out[k] += (size[u] if corner % 2 else -size[u]) * turn[3 * k + u]
            out[k] += (size[w] if corner // 2 else -size[w]) * turn[3 * k + w]
            height += out[k] * axis[k]
            aside += out[k] ** 2
        if aside - height**2 <= radius**2:
            gaps[found] = height
            for k in range(3):
                places[found, k], frames[found, k] = end[k] + out[k] - axis[k] * height / 2, axis[k]
            found += 1
    phis, edges, count = np.empty(8), np.empty(8, np.int64), 0  # where the rim crosses the edges along which axis
    for i, j in ((0, u), (1, w)):
        far, start = np.hypot(r[i], s[i]), np.arctan2(s[i], r[i])
        for sign in (-1.0, 1.0):
            cosine = (sign * size[j] - a[i]) / far if far > 0.0 else 2.0
            if abs(cosine) < 1.0:
                for way in (-1.0, 1.0):
                    phi = (start + way * np.arccos(cosine)) % (2 * np.pi)
                    other, q = 1 - i, (w, u)[i]
                    if abs(a[other] + r[other] * np.cos(phi) + s[other] * np.sin(phi)) <= size[q]:
                        phis[count], edges[count] = phi, q
                        count += 1
    if not found + count:
        return nothing
    order = np.argsort(phis[:count])
    for c in range(2 * count):
        phi = phis[order[c % count]]
        if c >= count:
            width = (phis[order[(c + 1) % count]] - phi) % (2 * np.pi)
            middle = width / 2
            if not (abs(a[0] + r[0] * np.cos(phi + middle) + s[0] * np.sin(phi + middle)) <= size[u]
                    and abs(a[1] + r[1] * np.cos(phi + middle) + s[1] * np.sin(phi + middle)) <= size[w]):  # fmt: skip
                continue
            highest = (steepest - phi) % (2 * np.pi)
            if highest < width:  # of what lies flat, rounding would choose where
                middle += (highest - middle) * tilt / (tilt + _FLAT**2)
            phi += middle
        cos, sin = np.cos(phi), np.sin(phi)
        height = 0.0
        for k in range(3):
            out[k] = end[k] + radius * (disc[3 * k] * cos + disc[3 * k + 1] * sin)
            height += (face[k] - out[k]) * normal[k]
            frames[found, k] = normal[k]
        if c < count:
            e = edges[order[c]]
            square = upward = share = 0.0
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                across = turn[3 * i + e] * (disc[3 * j + 1] * cos - disc[3 * j] * sin)
                across -= turn[3 * j + e] * (disc[3 * i + 1] * cos - disc[3 * i] * sin)
                frames[found, k] = across
                square += across**2
                upward += across * axis[k]
            for k in range(3):  # along the rim there is no such direction
                frames[found, k] = frames[found, k] * np.sign(upward) / np.sqrt(square) if square > 0.01 else axis[k]
                share += frames[found, k] * normal[k]
            height *= share
        gaps[found] = height
        for k in range(3):
            places[found, k] = out[k] + frames[found, k] * height / 2
        found += 1
    # how deep the box is in the side of the cylinder: if less than in its end, it does not lie there
    beside = np.hypot(max(abs(a[0]) - size[u], 0.0), max(abs(a[1]) - size[w], 0.0))
    if gaps[:found].min() < min(beside - radius, 0.0):
        return nothing
    near = 0
    for c in range(found):
        if gaps[c] < reach:
            gaps[near], places[near] = gaps[c], places[c]
            n = frames[c, :3].copy()
            upward = turn[u] * n[0] + turn[3 + u] * n[1] + turn[6 + u] * n[2]
            square = 1.0 - upward**2
            for k in range(3):
                frames[near, k], frames[near, 3 + k] = n[k], (turn[3 * k + u] - upward * n[k]) / np.sqrt(square)
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                frames[near, 6 + k] = n[i] * frames[near, 3 + j] - n[j] * frames[near, 3 + i]
            near += 1
    return True, gaps[:near], places[:near], frames[:near]


class _Cup:
    """A bowl and one geom that may lie in it."""

    def __init__(self, model: Any, bowl: Bowl, geom: int, surface: Surface) -> None:
        self._bowl, self._geom, self._other = bowl, model.geom(bowl.geom).id, geom
        self._site = model.site(bowl.site).id
        self._sphere = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
        size = model.geom_size[geom]
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        self._points = np.zeros((1, 3)) if self._sphere else signs * size
        self._radius = float(size[0]) if self._sphere else 0.0
        self._deepest = float(size[0] if self._sphere else size.min())
        self._contact = _blank(self._geom, self._other, surface)
        self.margin = self.ahead = 0.0

    def bend(self, model: Any, data: Any) -> float:
        """Centripetal acceleration that the wall gives what slides along it [m/s²]."""
        velocity = data.cvel[model.geom_bodyid[self._other], 3:]
        return float(velocity @ velocity) / self._bowl.radius

    def add(self, model: Any, data: Any) -> None:
        """Add the contacts of this moment."""
        found = _in_cup(
            self._points, self._radius, data.geom_xmat[self._other], data.geom_xpos[self._other],
            data.site_xpos[self._site], data.site_xmat[self._site], self._bowl.radius, self._bowl.rim,
            self.margin + self.ahead, self._deepest,
        )  # fmt: skip
        _fill(model, data, self._contact, *found, self.margin)


@njit(cache=True)
def _in_cup(
    points: Array, ball: float, turn: Array, place: Array, centre: Array, axes: Array, radius: float, rim: float,
    reach: float, deepest: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Gaps (n,), places (n, 3) and frames (n, 9) of what is nearer to the inside of a sphere than `reach`.

    deepest: what lies farther out than that is outside the bowl, where there is no surface
    """
    gaps, places, frames = np.empty(len(points)), np.empty((len(points), 3)), np.empty((len(points), 9))
    found = 0
    out, normal, aside = np.empty(3), np.empty(3), np.empty(3)
    for point in points:
        for k in range(3):
            out[k] = place[k] - centre[k]
            for j in range(3):
                out[k] += turn[3 * k + j] * point[j]
        far = np.sqrt(np.sum(out**2))
        gap = radius - far - ball
        up = (out[0] * axes[2] + out[1] * axes[5] + out[2] * axes[8]) / far if far > 0.0 else 0.0
        if gap >= reach or gap < -deepest or up * radius > rim:
            continue
        normal[:] = -out / far
        # tangents that turn with the normal alone, so that they are the same from step to step
        upright = abs(up) < 0.99
        ax, ay, az = (axes[2], axes[5], axes[8]) if upright else (1.0, 0.0, 0.0)
        aside[0] = ay * normal[2] - az * normal[1]
        aside[1] = az * normal[0] - ax * normal[2]
        aside[2] = ax * normal[1] - ay * normal[0]
        aside /= np.sqrt(np.sum(aside**2))
        gaps[found] = gap
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            places[found, k] = centre[k] - normal[k] * (radius - gap / 2)
            frames[found, k], frames[found, 3 + k] = normal[k], aside[k]
            frames[found, 6 + k] = normal[a] * aside[b] - normal[b] * aside[a]
        found += 1
    return gaps[:found], places[:found], frames[:found]
