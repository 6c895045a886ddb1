"""Aspects, regions, cusp curves and mode changes against oracles that share no code with the library.

What the oracles know stands in ``tests/data``; ``tests/oracles`` makes it from distance equations, circles and exact
elimination.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from oracles import aspects_scan, five_bar_exact, rpr3_cusp_curves, rpr3_regions
from oracles.five_bar_exact import FiveBar
from oracles.mode_loops import check_path, lengths_along, winding_number
from oracles.rpr3_cusp_edges import analytic_edges

import jaxkin as jk
from jaxkin.mapping.aspects import aspects
from jaxkin.mapping.cusp_curves import cusp_curves
from jaxkin.mapping.mode_change import mode_change
from jaxkin.mapping.regions import regions
from jaxkin.sweep.grid import Grid

TRANSITIONS = json.loads(rpr3_cusp_curves.DATA.read_text())["reference"]
REGIONS = json.loads(rpr3_regions.DATA.read_text())
FIVE_BARS = json.loads(five_bar_exact.DATA.read_text())
ASPECTS = json.loads(aspects_scan.DATA.read_text())


def robot_named(name):
    return {"reference": jk.mechanisms.rpr3.reference, "analytic": lambda: jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)}[
        name
    ]()


# --- regions -------------------------------------------------------------------------------------------------


def same_regions(found, known, error):
    own = sorted((int(region.n_solutions), float(region.area)) for region in found)
    want = sorted((region["count"], region["area"]) for region in known["regions"])
    assert [n for n, _ in own] == [n for n, _ in want]
    assert [area for _, area in own] == pytest.approx([area for _, area in want], abs=error)
    for region in known["regions"]:
        assert found[found.region_of(region["joints"])].n_solutions == region["count"]


def with_joints(known, place):
    return {"regions": [{**region, "joints": place(*region["point"])} for region in known["regions"]]}


def test_regions_of_the_analytic_example():
    section = Grid(rho1=(0.0, 4.0, 200), rho2=1.0, rho3=(0.0, 4.0, 200))
    known = with_joints(REGIONS["analytic 1 0 1, rho2 = 1, [0, 4]^2"], lambda x, y: (x, 1.0, y))
    same_regions(regions(robot_named("analytic"), section), known, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("rho1", [14.98, 17.0])
def test_regions_of_the_reference_robot(rho1):
    section = Grid(rho1=rho1, rho2=(0.0, 40.0, 400), rho3=(0.0, 40.0, 400))
    known = with_joints(REGIONS[f"reference, rho1 = {rho1}, [0, 40]^2"], lambda x, y: (rho1, x, y))
    same_regions(regions(robot_named("reference"), section), known, 1e-8)


# --- cusp curves ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def reference_cusps():
    box = Grid(rho1=(0.01, 200.0, 2), rho2=(0.01, 400.0, 2), rho3=(0.01, 400.0, 2))
    return cusp_curves(robot_named("reference"), box)


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["rho1", "rho2", "rho3"])
def test_transitions_of_the_reference_robot(reference_cusps, axis):
    """None is missing, none is too much: bands of 8.6e-9 (rho1) and of 1.3e-10 (rho3) of a length."""
    found = reference_cusps.transitions(axis)
    # The box ends at rho1 = 200, and cuts curves that go on; rho2 and rho3 then are about 200 too.
    own = [k for k in range(len(found.values)) if found.kinds[k] != "end"]
    known = TRANSITIONS[axis]
    assert [found.kinds[k] for k in own] == [t["kind"] for t in known]
    assert [found.values[k] for k in own] == pytest.approx([t["value"] for t in known], rel=1e-11)
    assert [found.counts[k].tolist() for k in own] == [[t["below"], t["above"]] for t in known]
    for k, t in zip(own, known, strict=True):
        assert found.joints[k] == pytest.approx(t["joints"], rel=1e-9, abs=1e-9)
        assert min(np.abs(np.asarray(pose) - t["pose"]).max() for pose in found.poses[k]) < 1e-8
    assert not found.doubts


@pytest.mark.slow
def test_counts_of_cusps_of_the_reference_robot(reference_cusps):
    for low, high in zip(TRANSITIONS["rho1"], TRANSITIONS["rho1"][1:], strict=False):
        assert reference_cusps.count("rho1", (low["value"] + high["value"]) / 2) == low["above"]


@pytest.mark.slow
def test_cusp_edges_of_the_analytic_example():
    """The joint points of an edge lie on a line in squared lengths, from where they begin to be real."""
    box = Grid(rho1=(0.0, 4.0, 2), rho2=(0.0, 4.0, 2), rho3=(0.0, 4.0, 2))
    found = cusp_curves(robot_named("analytic"), box)
    edges = analytic_edges(1.0, 0.0, 1.0)
    met = set()
    for curve in found:
        squares = np.asarray(curve.joints) ** 2
        gaps = [np.abs(squares[:, :1] - squares - edge.differences).max() for edge in edges]
        best = int(np.argmin(gaps))
        assert gaps[best] < 1e-9
        met.add(best)
        assert squares[:, 0].min() > edges[best].offset ** 2 - 1e-9
    assert met == {0, 1, 2}
    for value in (0.15, 0.18, 1.0, 2.27, 2.3, 3.0):
        assert found.count("rho2", value) == sum(bool(edge.cusps(2, value)) for edge in edges if fits(edge, value))


def fits(edge, rho2):
    return all(max(joints) < 4 for joints, _ in edge.cusps(2, rho2))


# --- aspects -------------------------------------------------------------------------------------------------


def same_five_bar(known):
    robot = jk.mechanisms.five_bar.create(known["base"], tuple(known["cranks"]), tuple(known["rods"]))
    found = aspects(robot)
    own = sorted((tuple(a.working_mode), int(a.sign), float(a.volume)) for a in found)
    want = sorted((tuple(a["mode"]), a["sign"], a["area"]) for a in known["aspects"])
    if found.doubts:
        # A tail narrower than the cells may be cut off; it is said to be in doubt, and holds next to nothing.
        own = [a for a in own if a[2] > 1e-5 * known["sheet"]]
    assert [a[:2] for a in own] == [a[:2] for a in want]
    assert [a[2] for a in own] == pytest.approx([a[2] for a in want], abs=1e-4 * known["sheet"])
    return found


def test_classic_five_bar():
    found = same_five_bar(FIVE_BARS[0])
    assert found.count == 10
    exact = FiveBar(9.0, (8.0, 8.0), (5.0, 5.0))
    rng = np.random.default_rng(4)
    seen = 0
    for x, y in rng.uniform((-4, -11), (13, 11), (60, 2)):
        for mode in five_bar_exact.MODES:
            joints = exact.inverse(x, y, mode)
            if joints is None or (k := found.aspect_of([x, y], joints)) < 0:
                continue
            seen += 1
            assert tuple(found[k].working_mode) == mode
            assert found[k].sign == np.sign(exact.direct(x, y, mode))
    assert seen > 60


@pytest.mark.slow
@pytest.mark.parametrize("known", FIVE_BARS[1:], ids=lambda known: f"{known['base']} {known['cranks']} {known['rods']}")
def test_other_five_bars(known):
    """Also slivers along the workspace's border, of 0.02 % of the sheet."""
    same_five_bar(known)


@pytest.mark.slow
@pytest.mark.parametrize("known", ASPECTS, ids=lambda known: f"{known['robot']} {known['legs']}")
def test_limited_rpr3(known):
    limits = {name: tuple(known["legs"]) for name in ("rho1", "rho2", "rho3")}
    found = aspects(robot_named(known["robot"]).with_limits(**limits))
    assert sorted(a.sign for a in found) == sorted(a["sign"] for a in known["aspects"])
    for sign in (1, -1):
        own = sorted(float(a.volume) for a in found if a.sign == sign)
        want = sorted(a["volume"] for a in known["aspects"] if a["sign"] == sign)
        # The oracle counts 200^3 samples.
        assert own == pytest.approx(want, rel=3e-3)
    # Deepest samples of different pieces lie in different aspects.
    places = [found.aspect_of(a["pose"]) for a in known["aspects"]]
    assert len(set(places)) == len(places)
    assert -1 not in places


# --- mode changes --------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "joints", "pairs"),
    [("analytic", (1.2, 1.0, 1.5), ((0, 4), (1, 2), (1, 5))), ("reference", (14.98, 15.38, 12.0), ((1, 5), (0, 4)))],
)
def test_mode_changes_hold_on_the_dense_path(name, joints, pairs):
    robot, own = robot_named(name), {"analytic": aspects_scan.EXAMPLE, "reference": aspects_scan.REFERENCE}[name]
    branches = jk.forward(robot, joints)
    modes = np.asarray(branches.values)[np.asarray(branches.valid)]
    length = float(robot.characteristic_length())
    for i, j in pairs:
        change = mode_change(robot, joints, modes[i], modes[j], encircle=False)
        assert change.found
        assert change.verified
        report = check_path(own, change.poses, length, 40)
        assert report.constant_sign
        assert report.gap < 1e-9
        assert report.moved > 0.1 * length
        assert report.clearance == pytest.approx(change.clearance, rel=0.02)
        assert change.poses[0] == pytest.approx(modes[i], abs=1e-9)
        turn = (change.poses[-1] - modes[j]) / (1, 1, 2 * math.pi)
        assert turn[:2] == pytest.approx([0, 0], abs=1e-9)
        assert turn[2] == pytest.approx(round(turn[2]), abs=1e-9)
        assert change.joints == pytest.approx(lengths_along(own, change.poses), rel=1e-9)
    if name == "analytic":
        # (A, B) of the closed joint path turns about at least one cusp edge, a point there.
        squares = lengths_along(own, change.poses, 10) ** 2
        turns = [
            winding_number(squares[:, :1] - squares[:, 1:], edge.differences[1:])
            for edge in analytic_edges(1.0, 0.0, 1.0)
        ]
        assert np.abs(np.round(turns)).sum() >= 1


@pytest.mark.slow
def test_no_mode_change_between_signs():
    robot = robot_named("reference")
    branches = jk.forward(robot, (14.98, 15.38, 12.0))
    modes = np.asarray(branches.values)[np.asarray(branches.valid)]
    signs = [np.sign(aspects_scan.REFERENCE.determinant(*pose)) for pose in modes]
    assert sorted(signs) == [-1, -1, -1, 1, 1, 1]
    other = signs.index(-signs[0])
    change = mode_change(robot, (14.98, 15.38, 12.0), modes[0], modes[other], encircle=False)
    assert not change.found
