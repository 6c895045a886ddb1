"""From coarse to fine: cells are halved until the grid's resolution, and further where the count is in doubt."""

import numpy as np

from jaxkin.mapping._aspect_joins import (
    Contacts,
    Owners,
    codes_at,
    join_by_lines,
    lines_hold,
    owners_of,
    shares_of,
    unrolled,
)
from jaxkin.mapping._aspect_sheets import Doubt, Sheet, halve, judge, share, total_volumes
from jaxkin.mapping._aspect_wall_walks import join_along_walls
from jaxkin.mapping._aspect_walls import FLAT, OUTSIDE, UNDECIDED, critical_points
from jaxkin.mapping.batch import in_blocks

#: Levels beyond the grid's that doubtful cells are halved, and how many cells at most.
EXTRA, _CELLS = 6, 40_000
#: Starts of searches for critical points.
_STARTS = 512
#: A wall is zero at a critical point where it is so small against its size over the box.
_ZERO = 1e-10


def refine(sheet: Sheet) -> Owners:
    """Judges and halves cells down to the last level of the box, counts on the last three, and follows doubts further.

    Returns:
        Whose the undecided leaves are.
    """
    contacts, owners = _down_to_the_grid(sheet)
    hidden = _hidden(sheet, owners)
    for _ in range(EXTRA):
        doubtful = _widened(sheet, np.concatenate([contacts.cells, hidden, _unowned(sheet, owners)]))
        if len(doubtful) == 0 or len(doubtful) > _CELLS:
            break
        halve(sheet, doubtful)
        judge(sheet)
        contacts, owners = _counted(sheet)
        hidden = np.zeros(0, int)
    _settle(sheet, contacts)
    _note_unowned(sheet, owners)
    return owners


def _down_to_the_grid(sheet: Sheet) -> tuple[Contacts, Owners]:
    for level in range(sheet.box.levels):
        judge(sheet)
        undecided = np.flatnonzero(sheet.tree.levels[-1].status == UNDECIDED)
        if len(undecided) == 0:
            return _full(sheet)
        if level >= sheet.box.levels - 2:
            _full(sheet)
        halve(sheet, undecided)
        if level:
            # Only the last levels are asked for neighbours again.
            sheet.tree.levels[-3].neighbours = np.zeros((2 * sheet.tree.dimension, 0), np.int32)
    judge(sheet)
    return _full(sheet)


def _full(sheet: Sheet) -> tuple[Contacts, Owners]:
    """Counts a level below which there are no cells yet, and adds up its volumes."""
    found = _counted(sheet)
    sheet.totals.append(total_volumes(sheet))
    return found


def _counted(sheet: Sheet) -> tuple[Contacts, Owners]:
    """Shares out, joins and counts the last level."""
    level = len(sheet.tree.levels) - 1
    share(sheet, level)
    owners = owners_of(sheet, min(level, sheet.box.levels))
    contacts, joined = join_by_lines(sheet, owners)
    sheet.joined += joined
    sheet.walked += join_along_walls(sheet, owners)
    sheet.counts.append(sheet.components.count)
    return contacts, owners


def _unowned(sheet: Sheet, owners: Owners) -> np.ndarray:
    """Returns undecided leaves with a share that no component owns."""
    return owners.cells[np.any((shares_of(sheet, owners.cells) > 0) & (owners.anchor < 0), axis=1)]


def _widened(sheet: Sheet, cells: np.ndarray) -> np.ndarray:
    """Returns the undecided cells of the last level among some and their undecided neighbours, as places."""
    last = sheet.tree.levels[-1]
    places = np.unique(cells[cells >= last.offset]).astype(int) - last.offset
    behind = last.neighbours[:, places].ravel()
    near = behind[behind >= last.offset] - last.offset
    both = np.union1d(places, near).astype(int)
    return both[last.status[both] == UNDECIDED]


def _hidden(sheet: Sheet, owners: Owners) -> np.ndarray:
    """Returns cells with an extremum of a singular wall of a sign that no component beside it has."""
    level = len(sheet.tree.levels) - 1
    last = sheet.tree.levels[-1]
    places = owners.cells[owners.cells >= last.offset] - last.offset
    flat = places[sheet.kinds[-1][places] == FLAT]
    if len(flat) == 0:
        return np.zeros(0, int)
    flat = flat[np.unique(np.linspace(0, len(flat) - 1, _STARTS).astype(int))]
    width = sheet.box.width(level)
    centres = sheet.box.low + (last.index[flat] + 0.5) * width
    found = []
    for wall in range(sheet.walls.n_singular):
        points, values, slopes, extreme = _critical(sheet, centres, wall, width)
        inside = np.all(np.abs(points - centres) <= width, axis=1)
        good = inside & extreme & (np.abs(values) > _size(sheet, wall)) & (slopes <= 1e-6 * np.abs(values))
        cells = sheet.locate(points[good])
        codes = codes_at(sheet, points[good])
        use = (cells >= 0) & (codes != OUTSIDE)
        cells, codes = cells[use], codes[use]
        undecided = sheet.tree.gathered("status", cells) == UNDECIDED
        cells, codes = cells[undecided], codes[undecided]
        found.append(cells[owners.anchor[owners.rows(cells), codes] < 0])
    return np.unique(np.concatenate(found))


def _critical(sheet: Sheet, starts: np.ndarray, wall: int, width: np.ndarray) -> tuple[np.ndarray, ...]:
    def kernel(points: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, ...]:
        return critical_points(sheet.walls, sheet.data, points, which, width)  # type: ignore[return-value]

    return in_blocks(kernel, starts, np.full(len(starts), wall), block=_STARTS)


def _size(sheet: Sheet, wall: int) -> float:
    """Returns below which value a wall is zero."""
    assert sheet.scale is not None
    return _ZERO * float(sheet.scale[wall])


def _settle(sheet: Sheet, contacts: Contacts) -> None:
    """Decides by critical points whether components that still meet are one, and notes the others as doubts."""
    while len(contacts):
        first, second = (sheet.components.of(sheet.tree, cells) for cells in (contacts.first, contacts.second))
        open_ = np.flatnonzero(first != second)
        if len(open_) == 0:
            return
        pair = np.sort(np.stack([first[open_], second[open_]]), axis=0)
        same = open_[np.all(pair == pair[:, :1], axis=0)]
        middle = sheet.centres(contacts.cells[same])
        if not _by_saddles(sheet, contacts, same, middle):
            cells = int(contacts.first[same[0]]), int(contacts.second[same[0]])
            sheet.doubts.append(Doubt(middle[0], sheet.widths(contacts.cells[same[:1]])[0], cells))
        contacts = contacts.picked(np.setdiff1d(open_, same))


def _by_saddles(sheet: Sheet, contacts: Contacts, same: np.ndarray, middle: np.ndarray) -> bool:
    """True where critical points near all contacts of one pair of components decide between one and two."""
    width = sheet.box.width(sheet.box.levels)
    some = same[:_STARTS]
    settled = np.zeros(len(some), bool)
    kind = "separate"
    for wall in range(sheet.walls.n_singular):
        points, values, slopes, _ = _critical(sheet, middle[:_STARTS], wall, width)
        # A flat crossing is found only to the root of rounding.
        near = np.all(np.abs(points - middle[:_STARTS]) <= 4 * width, axis=1) & np.isfinite(values)
        zero = near & (np.abs(values) <= _size(sheet, wall))
        good = near & (zero | (slopes <= 1e-6 * np.abs(values)))
        sign = np.where((contacts.code[some] >> wall) & 1, -1, 1)
        through = np.flatnonzero(good & ~zero & (np.sign(values) == sign))
        if len(through):
            ends = [
                unrolled(sheet, sheet.centres(cells[some[through]]), points[through])
                for cells in (contacts.first, contacts.second)
            ]
            code = contacts.code[some[through]]
            holds = lines_hold(sheet, ends[0], points[through], code) & lines_hold(
                sheet, points[through], ends[1], code
            )
            if holds.any():
                hit = some[through[np.argmax(holds)]]
                pair = [sheet.components.of(sheet.tree, c[hit : hit + 1]) for c in (contacts.first, contacts.second)]
                sheet.components.unite(*pair)
                sheet.links.append(np.stack([contacts.first[hit : hit + 1], contacts.second[hit : hit + 1]]))
                at = points[through[np.argmax(holds)]]
                sheet.ways[int(contacts.first[hit]), int(contacts.second[hit])] = at[None]
                sheet.saddles["connect"] += 1
                return True
        settled |= good & (zero | (np.sign(values) == -sign))
        kind = "crossing" if zero.any() else kind
    if settled.all() and len(some) == len(same):
        sheet.saddles[kind] += 1
        return True
    return False


def _note_unowned(sheet: Sheet, owners: Owners) -> None:
    """Notes parts of undecided cells that belong to no component: one doubt a cluster would be many; one in all."""
    lost = _unowned(sheet, owners)
    if len(lost):
        sheet.doubts.append(Doubt(sheet.centres(lost[:1])[0], sheet.widths(lost[:1])[0]))
