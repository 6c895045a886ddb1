"""Undecided cells between components: who owns their parts, and who might meet in them."""

from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from jaxkin.mapping import batch
from jaxkin.mapping._aspect_sheets import BLOCK, Sheet
from jaxkin.mapping._aspect_walls import UNDECIDED, point_codes
from jaxkin.mapping.batch import in_blocks

#: Steps by which components reach into undecided cells, and how far beyond those that show their code at sub-points.
_RINGS, _NEAR = 256, 2
#: Samples of a line that is tested, and lines tested for each pair of components.
_SAMPLES, _LINES = 65, 24
#: Sub-points an axis among which a line through a cell chooses.
_WAYPOINTS = 5


@dataclass(frozen=True, eq=False)
class Owners:
    """What lies next to the undecided leaves of all levels.

    Attributes:
        cells: ``(m,)`` the undecided leaves, ascending.
        anchor: ``(m, n_code)`` a proved cell with that code beside each, or beside its neighbours; -1 for none.
        proved: Row, proved cell beside it, and that cell's code in the row's frame, ``(k,)`` each.
        beside: Two rows side by side, and the bits by which their codes differ, ``(k,)`` each.
    """

    cells: np.ndarray
    anchor: np.ndarray
    proved: tuple[np.ndarray, np.ndarray, np.ndarray]
    beside: tuple[np.ndarray, np.ndarray, np.ndarray]

    def rows(self, cells: np.ndarray) -> np.ndarray:
        """Returns the rows of undecided leaves."""
        return np.searchsorted(self.cells, cells)


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of proved cells of one code and different components that meet at an undecided cell.

    Attributes:
        cells: ``(k,)`` the undecided cell.
        code: ``(k,)`` their code, in that cell's frame.
        first: ``(k,)`` a proved cell.
        second: ``(k,)`` another.
    """

    cells: np.ndarray
    code: np.ndarray
    first: np.ndarray
    second: np.ndarray

    def __len__(self) -> int:
        """Number of contacts."""
        return len(self.cells)

    def picked(self, which: np.ndarray) -> "Contacts":
        """Returns some of them."""
        return Contacts(*(part[which] for part in vars(self).values()))


def owners_of(sheet: Sheet, start: int) -> Owners:
    """Returns the owners of the parts of undecided leaves: first of face neighbours, then of theirs.

    Args:
        sheet: The sheet.
        start: The first level that has undecided leaves; neighbours are known from there on.
    """
    tree = sheet.tree
    status = np.concatenate([level.status for level in tree.levels[start:]])
    offset = tree.levels[start].offset
    leaves = np.flatnonzero(status == UNDECIDED) + offset
    row_of = np.full(len(status), -1, np.int32)
    row_of[leaves - offset] = np.arange(len(leaves), dtype=np.int32)
    proved, beside = [], []
    for number in range(start, len(tree.levels)):
        level = tree.levels[number]
        # Smaller proved cells know larger undecided ones, which do not know them.
        seekers = [np.flatnonzero(level.status == UNDECIDED)]
        seekers += [np.flatnonzero(level.status >= 0)] if number > start else []
        for face, (undecided, places) in product(range(2 * tree.dimension), zip((True, False), seekers, strict=False)):
            one, other, flip = _behind(sheet, number, face, places)
            state = tree.gathered("status", other)
            if not undecided:
                use = state == UNDECIDED
                code = tree.levels[number].status[one[use] - level.offset] ^ flip[use]
                proved.append((row_of[other[use] - offset], one[use], code))
                continue
            use = state >= 0
            proved.append((row_of[one[use] - offset], other[use], state[use] ^ flip[use]))
            # A pair of equal cells is met from both sides, and is kept once.
            use = (state == UNDECIDED) & ((face % 2 == 1) | (other < level.offset))
            beside.append((row_of[one[use] - offset], row_of[other[use] - offset], flip[use]))
    found, near = _columns(proved), _columns(beside)
    return Owners(leaves, _reached(shares_of(sheet, leaves) > 0, found, near), found, near)


def _columns(parts: list[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    one, two, three = (np.concatenate(part) for part in zip(*parts, strict=True))
    return one, two, three


def shares_of(sheet: Sheet, cells: np.ndarray) -> np.ndarray:
    """Returns the shares of each code in undecided leaves, ``(k, n_code)``."""
    of_level, shares = sheet.tree.level_of(cells), np.zeros((len(cells), 1 << sheet.walls.n_singular))
    for level in np.unique(of_level):
        here = of_level == level
        places = cells[here] - sheet.tree.levels[level].offset
        shares[here] = sheet.shares[level][np.searchsorted(sheet.shared_places[level], places)]
    return shares


def _behind(sheet: Sheet, number: int, face: int, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns cells, the cells behind one of their faces, and the bits by which codes differ over it (int8)."""
    level = sheet.tree.levels[number]
    behind = level.neighbours[face, places]
    flip = np.zeros(len(places), np.int8)
    if sheet.flips[face // 2]:
        flip[sheet.tree.wraps(number, face, places)] = sheet.flips[face // 2]
    use = behind >= 0
    return (places[use] + level.offset).astype(np.int32), behind[use], flip[use]


def _reached(wanted: np.ndarray, proved: tuple[np.ndarray, ...], beside: tuple[np.ndarray, ...]) -> np.ndarray:
    """Returns a proved cell for each code of each row, led on from row to row where the code is met or nearly so."""
    anchor = np.full(wanted.shape, -1, np.int32)
    anchor[proved[0], proved[2]] = proved[1]
    if not np.any(wanted & (anchor < 0)):
        return anchor
    one, other, flip = (np.concatenate(part) for part in zip(beside, (beside[1], beside[0], beside[2]), strict=True))
    sides = [(None, 0)] if not flip.any() else [(flip == bits, bits) for bits in np.unique(flip).tolist()]
    sides = [(one, other, bits) if use is None else (one[use], other[use], bits) for use, bits in sides]
    for _ in range(_NEAR):
        grown = wanted.copy()
        for (a, b, bits), code in product(sides, range(wanted.shape[1])):
            grown[a[wanted[:, code ^ bits][b]], code] = True
        wanted = grown
    # Only what lacks an owner is asked again, ring by ring.
    lacking = wanted & (anchor < 0)
    open_ = []
    for (a, b, bits), code in product(sides, range(wanted.shape[1])):
        use = lacking[:, code][a]
        open_.append((a[use], b[use], code, code ^ bits))
    for _ in range(_RINGS):
        open_ = [part for part in (_still_open(anchor, *part) for part in open_) if len(part[0])]
        steps = [(a, anchor[b, theirs], code) for a, b, code, theirs in open_]
        reached = [(a[use], owner[use], code) for a, owner, code in steps for use in [owner >= 0]]
        for a, owner, code in reached:
            anchor[a, code] = owner
        if not any(len(a) for a, _, _ in reached):
            break
    return anchor


def _still_open(anchor: np.ndarray, one: np.ndarray, other: np.ndarray, code: int, theirs: int) -> tuple[Any, ...]:
    """Returns the pairs whose first row lacks an owner."""
    use = anchor[one, code] < 0
    return one[use], other[use], code, theirs


def contacts_of(sheet: Sheet, owners: Owners) -> Contacts:
    """Returns where components of one code meet at undecided leaves."""
    component = sheet.components.of(sheet.tree, owners.anchor)
    rows, cells, code = owners.proved
    use = component[rows, code] != sheet.components.of(sheet.tree, cells)
    found = [(rows[use], code[use], owners.anchor[rows[use], code[use]], cells[use])]
    one, other, flip = owners.beside
    for number in range(owners.anchor.shape[1]):
        mine, theirs = component[one, number], component[other, number ^ flip]
        use = np.flatnonzero((mine >= 0) & (theirs >= 0) & (mine != theirs))
        a, b = one[use], other[use]
        found.append((a, np.full(len(a), number), owners.anchor[a, number], owners.anchor[b, number ^ flip[use]]))
    rows, code, first, second = (np.concatenate(part) for part in zip(*found, strict=True))
    return Contacts(owners.cells[rows], code, first, second)


def shared_codes(sheet: Sheet) -> bool:
    """True where two components hold cells of one code: only then can any of them meet."""
    held: set[tuple[int, int]] = set()
    for number, level in enumerate(sheet.tree.levels):
        proved = np.flatnonzero(level.status >= 0)
        if len(proved):
            pairs = sheet.components.level(number)[proved].astype(np.int64) * 256 + level.status[proved]
            held |= {(int(p) // 256, int(p) % 256) for p in np.unique(pairs)}
    codes = [code for _, code in held]
    return len(set(codes)) < len(codes)


def join_by_lines(sheet: Sheet, owners: Owners) -> tuple[Contacts, int]:
    """Joins components that a line through an undecided cell connects, all walls keeping their signs along it.

    Returns:
        The contacts that remain, and how many components became parts of others.
    """
    none = Contacts(*(np.zeros(0, np.int64) for _ in range(4)))
    if not shared_codes(sheet):
        return none, 0
    contacts = contacts_of(sheet, owners)
    joined = 0
    while len(contacts):
        first, second = (sheet.components.of(sheet.tree, cells) for cells in (contacts.first, contacts.second))
        chosen = _some_of_each(np.minimum(first, second), np.maximum(first, second))
        good, via = _line_holds(sheet, contacts.picked(chosen))
        if not good.any():
            return contacts, joined
        hits = chosen[good]
        ends = zip(contacts.first[hits].tolist(), contacts.second[hits].tolist(), via[good], strict=True)
        sheet.ways.update({(a, b): point[None] for a, b, point in ends if np.isfinite(point[0])})
        before = sheet.components.count
        sheet.components.unite(first[hits], second[hits])
        joined += before - sheet.components.count
        sheet.links.append(np.stack([contacts.first[hits], contacts.second[hits]]))
        first, second = (sheet.components.of(sheet.tree, cells) for cells in (contacts.first, contacts.second))
        contacts = contacts.picked(np.flatnonzero(first != second))
    return contacts, joined


def _some_of_each(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns a few contacts of every pair of components, spread over them."""
    _, group = np.unique(first * (second.max() + 1) + second, return_inverse=True)
    chosen = []
    for number in range(group.max() + 1):
        members = np.flatnonzero(group == number)
        chosen.append(members[np.unique(np.linspace(0, len(members) - 1, _LINES).astype(int))])
    return np.concatenate(chosen)


def _line_holds(sheet: Sheet, contacts: Contacts) -> tuple[np.ndarray, np.ndarray]:
    """True where a line between two proved cells keeps the code, direct or by a sub-point of the cell; NaN or which."""
    width, middle = sheet.widths(contacts.cells), sheet.centres(contacts.cells)
    first, second = (unrolled(sheet, sheet.centres(cells), middle) for cells in (contacts.first, contacts.second))
    direct = lines_hold(sheet, first, second, contacts.code)
    d = width.shape[1]
    steps = (np.arange(_WAYPOINTS) + 0.5) / _WAYPOINTS - 0.5
    offsets = np.stack(np.meshgrid(*[steps] * d, indexing="ij"), axis=-1).reshape(-1, d)
    points = (middle[:, None] + offsets * width[:, None]).reshape(-1, d)
    codes = codes_at(sheet, points).reshape(len(middle), -1)
    held = codes == contacts.code[:, None]
    # The sub-point in the middle of those that have the code.
    centre = np.einsum("ks,sd->kd", held, offsets) / np.maximum(held.sum(axis=1), 1)[:, None]
    gap = np.sum((offsets[None] - centre[:, None]) ** 2, axis=-1) + np.where(held, 0.0, np.inf)
    via = middle + offsets[np.argmin(gap, axis=1)] * width
    bent = lines_hold(sheet, first, via, contacts.code) & lines_hold(sheet, via, second, contacts.code)
    return direct | (held.any(axis=1) & bent), np.where(direct[:, None], np.nan, via)


def unrolled(sheet: Sheet, points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Returns points moved by whole periods next to others."""
    period = np.where(sheet.box.glued, sheet.box.period, 1.0)
    return points - np.where(sheet.box.glued, period * np.round((points - near) / period), 0.0)


def codes_at(sheet: Sheet, points: np.ndarray) -> np.ndarray:
    """Returns the codes of points ``(k, d)``, OUTSIDE where there is none."""
    block = BLOCK if len(points) > batch.BLOCK else batch.BLOCK
    return in_blocks(partial(point_codes, sheet.walls, sheet.data), points, block=block)


def lines_hold(sheet: Sheet, start: np.ndarray, end: np.ndarray, code: np.ndarray) -> np.ndarray:
    """True where the straight line from a point to another keeps a code at all samples, ``(k,)``."""
    t = np.linspace(0.0, 1.0, _SAMPLES)[None, :, None]
    points = (start[:, None] * (1 - t) + end[:, None] * t).reshape(-1, start.shape[1])
    return np.all(codes_at(sheet, points).reshape(len(start), -1) == code[:, None], axis=1)
