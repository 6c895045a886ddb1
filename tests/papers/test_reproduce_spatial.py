import csv
import io
import itertools
import json
import math

import matplotlib

matplotlib.use("Agg")
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from flint import arb
from oracles import ppps3_exact, tlpm_exact

import jaxkin as jk
from jaxkin.cli.main import main
from jaxkin.core.errors import PrecisionError
from jaxkin.mechanisms import ppps3, tlpm
from jaxkin.papers import _cbjr2018_costs as costs
from jaxkin.papers import _cbjr2018_equations as ppps3_equations
from jaxkin.papers import _cbjr2018_errata, _fg_errata, catalogue, chablat_baron_jha_rolland_2018, fu_gao_tlpm
from jaxkin.papers import _cbjr2018_print as ppps3_print
from jaxkin.papers import _cbjr2018_route as route
from jaxkin.papers import _fg_equations as tlpm_equations
from jaxkin.papers import _fg_figures as tlpm_figures
from jaxkin.papers import _fg_print as tlpm_print
from jaxkin.papers import _fg_wrist as tlpm_wrist

PPPS3, TLPM = "chablat-baron-jha-rolland-2018", "fu-gao-tlpm"
HALF_ROOT3 = math.sqrt(3) / 2


def failed(part):
    return {check.key for check in part.checks if not check.passed}


def rows(table):
    return [dict(zip(table.header, row, strict=True)) for row in table.rows]


# --- the formulas of the 3-PPPS paper, on answers known by other means ----------------------------------------


def test_joints_at_home_by_hand():
    joints = ppps3_print.inverse((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(joints, (0, 0, HALF_ROOT3, 0, -HALF_ROOT3, 0), atol=1e-16)
    assert ppps3_print.abscissa((0.0, 0.0, 0.0), -1.0) == pytest.approx(HALF_ROOT3)
    assert ppps3_print.singular((0.0, 0.0, 0.0)) == -1


def test_the_printed_way_finds_the_exact_poses():
    # tests/oracles: distance geometry with certified arithmetic, without rotations.
    for mu in route._random_variables(np.random.default_rng(3), 6):
        joints = (0.1, -0.2, 0.3, -0.2 + mu[0], mu[1] - 0.3, -0.2 + mu[2])
        exact = [np.array(pose.floats()[1]) for pose in ppps3_exact.forward(joints)]
        every, solved = route._tried(np.array([ppps3_print.variables(joints, corrected=True)]))
        triples = np.concatenate([every[key][..., 0][solved[key][:, 0]] for key in every])
        found = [np.array(ppps3_print.rotation(tuple(t[:3]))) for t in triples]
        assert len(exact) == 4
        assert len(found) == 8
        for pose in exact:
            assert sum(np.max(np.abs(turn - pose)) < 1e-9 for turn in found) == 2


def test_the_platform_of_eq_4_is_the_mirrored_one():
    pose = (0.3, -0.2, 0.5, 0.4, 0.3, -0.6)
    for platform, mirrored in ((ppps3_print.PLATFORM, False), (ppps3_print.PRINTED_PLATFORM, True)):
        joints = ppps3_exact.inverse(pose, ppps3_exact.Platform(mirrored=mirrored))
        active, passive = ([float(v.mid()) for v in part] for part in joints)
        corners = ppps3_print.corners(pose[:3], pose[3:], platform)
        np.testing.assert_allclose(corners, ppps3_print.legs_ends(tuple(active), tuple(passive)), atol=1e-14)


def test_exact_counts_where_the_root_of_25_is_real_and_no_pose_is():
    for mu in ((1.0, 1.0, -1.0), (1.25, 0.5, -0.5), (-1.0, 0.75, 1.0)):
        joints = (0.0, 0.0, 0.0, mu[0], mu[1], mu[2])
        assert np.isfinite(ppps3_print.abscissa(mu, 1.0))
        assert ppps3_exact.count(joints).count == 0


def test_every_combination_is_among_the_candidates():
    every = ppps3_print.candidates((0.2, -0.3, 0.1))
    assert set(every) == set(itertools.product(("theta1", "theta2"), ("sigma1", "sigma2"), (1, -1)))
    triples = np.concatenate(list(every.values()))
    assert triples.shape == (128, 4)
    assert len({tuple(np.round(t, 12)) for t in triples.tolist()}) == 128
    assert {float(np.sign(t)) for t in triples[:, 1]} == {1.0, -1.0}


# --- numbers of operations ------------------------------------------------------------------------------------


def count(function, number):
    return tuple(costs.operations(function, tuple(jnp.zeros(number)))[kind] for kind in costs._COLUMNS)


def test_operations_of_functions_counted_by_hand():
    assert count(lambda x, y: jnp.sin(x) * y + jnp.sin(x) * y, 2) == (1, 0, 1, 1)
    assert count(lambda x: (x * x, jnp.sqrt(x), x / 3 - 1), 1) == (0, 1, 2, 1)
    # What nobody asks for, or is known without the arguments, costs nothing.
    assert count(lambda x, y: (jnp.cos(y), x * (2.0 * jnp.sqrt(jnp.asarray(3.0))))[1], 2) == (0, 0, 1, 0)
    assert count(lambda x: jnp.where(x > 0, -x, jnp.abs(x)), 1) == (0, 0, 0, 0)


def test_calls_within_calls_are_counted_once():
    inner = jax.jit(lambda x: jnp.cos(x) * x)
    assert count(lambda x: inner(x) + inner(x), 1) == (1, 0, 1, 1)


def test_a_division_for_the_compiler_is_not_counted():
    from jaxkin.numerics.fusion import materialise

    assert count(lambda x: materialise(jnp.sin(x))[0] * x, 1) == (1, 0, 1, 0)


# --- the formulas of the TLPM paper -----------------------------------------------------------------------------


def test_position_by_hand():
    # L = 300, h = 400, L_0 = 500: at zero strokes p = 0 and its image; at l2 = 6 the second terms of (4) cancel.
    x, y, up, down = tlpm_print.position(300.0, 400.0, 500.0, (0.0, 0.0, 0.0), corrected=True)
    assert (x, y, up, down) == (0, 0, 0, -800)
    wrong = tlpm_print.position(300.0, 400.0, 500.0, (0.0, 6.0, 0.0), corrected=False)[1]
    assert wrong == pytest.approx(-math.sqrt(3) * 500 * 36 / 1800)
    right = tlpm_print.position(300.0, 400.0, 500.0, (0.0, 6.0, 0.0), corrected=True)[1]
    assert right == pytest.approx((500**2 - 506**2) / (2 * math.sqrt(3) * 300))


def test_positions_and_determinants_are_the_exact_ones():
    machine, rng = tlpm_exact.Machine(590, 590), np.random.default_rng(4)
    for point in rng.uniform(-300, 300, (10, 3)):
        strokes = [float(v.mid()) for v in tlpm_exact.strokes(machine, tuple(point))]
        found = tlpm_print.position(590.0, 590.0, math.hypot(590, 590), tuple(strokes), corrected=True)
        np.testing.assert_allclose(found[:3], point, atol=1e-9)
        exact = tlpm_exact.determinant(machine, tuple(point))
        assert float(tlpm_print.determinant(590.0, 590.0, point)) == pytest.approx(float(exact.mid()), rel=1e-13)


def test_the_angle_of_eq_23_is_the_exact_one_with_a_proper_frame_only():
    machine, point = tlpm_exact.Machine(590, 590), (150.0, -120.0, 80.0)
    exact = [float(limb.theta2.mid()) for limb in tlpm_exact.wrist(machine, point, (1, 0, 0, 0))]
    frames = [tlpm_print.limb_frames(590.0, 590.0, np.array(point), corrected=c) for c in (True, False)]
    right, wrong = (tlpm_print.angles(tlpm_print.remaining(frame))[1] for frame in frames)
    np.testing.assert_allclose(-right, exact, atol=1e-13)
    assert np.max(np.abs(np.degrees(-wrong - exact))) > 3


def test_turns_are_right_handed():
    for axis in range(3):
        exact = ppps3_exact.turn(axis, arb(0.7))
        found = tlpm_print.turn(axis, 0.7)
        np.testing.assert_allclose(found, [[float(v.mid()) for v in row] for row in exact.tolist()], atol=1e-15)


# --- what is checked, and that the checks would see a slip --------------------------------------------------------


@pytest.mark.parametrize(
    "part",
    [ppps3_equations.equations, route.direct_kinematics, costs.costs, tlpm_equations.equations, tlpm_wrist.wrist],
)
def test_every_check_of_the_equations_passes(part):
    assert failed(part()) == set()


def slipped(module, name, slip):
    """Returns a function of a module with something wrong in its result."""
    original = getattr(module, name)
    return lambda *a, **k: slip(original(*a, **k))


@pytest.mark.parametrize(
    ("name", "slip", "keys"),
    [
        ("rotation", lambda r: [r[0], r[1], [-v for v in r[2]]], {"eq1", "eq3-5", "eq16-entries"}),
        ("inverse", lambda q: (*q[:3], -q[3], *q[4:]), {"eq20-24"}),
        ("constraints", lambda f: [*f[:5], f[5] + 1e-9], {"eq6-11", "eq6-11-off"}),
        ("legs_ends", lambda c: [c[0], (-c[1][0], *c[1][1:]), c[2]], {"eq3-5", "eq12-15", "eq4-mirrored"}),
        ("legs_ends", lambda c: [c[0], c[1], (c[2][0], -c[2][1], c[2][2])], {"eq3-5", "eq12-15"}),
        ("variables", lambda mu: (mu[0], -mu[1], mu[2]), {"eq16-19", "eq14-mu3y"}),
        ("singular", lambda v: -v, {"eq29", "eq29-factors"}),
        ("reduced_constraints", lambda f: [2 * f[0], *f[1:]], {"eq16-printed"}),
    ],
)
def test_a_slip_in_the_ppps3_equations_is_seen(monkeypatch, name, slip, keys):
    monkeypatch.setattr(ppps3_print, name, slipped(ppps3_print, name, slip))
    assert keys <= failed(ppps3_equations.equations())


@pytest.mark.parametrize(
    ("name", "slip", "keys"),
    [
        ("abscissa", lambda x: -x, {"eq25", "candidates-0"}),
        ("reduced_constraints", lambda f: [f[0], -f[1], f[2], f[3] + 0.1], {"candidates-0", "candidates-1"}),
        ("first_angles", lambda a: (a[0], a[1] / 2, a[2]), {"candidates-0", "home-printed"}),
    ],
)
def test_a_slip_in_the_printed_way_is_seen(monkeypatch, name, slip, keys):
    monkeypatch.setattr(ppps3_print, name, slipped(ppps3_print, name, slip))
    assert keys <= failed(route.direct_kinematics())


def test_wrong_numbers_of_operations_are_seen(monkeypatch):
    monkeypatch.setattr(ppps3_print, "INVERSE_COST", (7, 1, 16, 13))
    assert {"cost-inverse-trigonometric", "cost-inverse-products", "cost-inverse-sums"} <= failed(costs.costs())


@pytest.mark.parametrize(
    ("name", "slip", "keys"),
    [
        ("base_points", lambda q: q * [1.0, -1.0, 1.0], {"eq1", "eq2", "eq7"}),
        ("position", lambda p: (p[0], p[1] * (1 + 1e-9), *p[2:]), {"eq3-6", "eq3-4"}),
        ("determinant", lambda d: d * (1 + 1e-9), {"eq12", "eq12-sign", "eq11", "eq12-P1"}),
        ("directions", lambda r: -r, {"eq7", "eq7-printed", "eq9"}),
    ],
)
def test_a_slip_in_the_tlpm_equations_is_seen(monkeypatch, name, slip, keys):
    monkeypatch.setattr(tlpm_print, name, slipped(tlpm_print, name, slip))
    assert keys <= failed(tlpm_equations.equations())


@pytest.mark.parametrize(
    ("name", "slip", "keys"),
    [
        ("limb_frames", lambda r: r[..., [1, 0, 2]], {"eq22", "eq19-closure", "eq18-printed"}),
        ("wrist", lambda w: w * [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0]], {"eq19-matrix"}),
        ("platform_frames", lambda v: v[..., [1, 0, 2]], {"eq20", "eq20-here", "eq23"}),
        ("angles", lambda a: (a[0], -a[1]), {"eq23"}),
    ],
)
def test_a_slip_in_the_wrist_is_seen(monkeypatch, name, slip, keys):
    monkeypatch.setattr(tlpm_print, name, slipped(tlpm_print, name, slip))
    assert keys <= failed(tlpm_wrist.wrist())


def test_table_1_and_the_wrist_in_numbers():
    table = tlpm_equations.equations().tables["table_1"]
    strokes = np.array([[row[k] for k in ("l1", "l2", "l3")] for row in rows(table)], float)
    expected = [(17.787689, 60.605061, 168.305874), (-9.278356, 41.677681, 169.836009)]
    np.testing.assert_allclose(strokes, expected, atol=5.1e-7)
    # Angles at P1 by certified arithmetic.
    limbs = tlpm_exact.wrist(tlpm_exact.Machine(590, 590), (100, 100, 100), (1, 0, 0, 0))
    found = [row for row in rows(tlpm_wrist.wrist().tables["wrist_angles"]) if row["pose"] == "P1"]
    for limb, row in zip(limbs, found, strict=True):
        for name, angle in (("theta_i1", limb.theta1), ("theta_i2", limb.theta2), ("psi_i", limb.psi)):
            assert row[name] == pytest.approx(math.degrees(float(angle.mid())), abs=1e-11)


def test_the_volume_of_the_workspace():
    # By Gauss and Legendre's rule in the space of strokes, to all digits given.
    check = tlpm_figures._integrated(tlpm.create(), 72_322_565.930, "w", "")
    assert check.passed
    assert check.printed == "72322565.930"
    assert not tlpm_figures._integrated(tlpm.create(), 72_322_566.93, "w", "").passed


# --- catalogue and errata -------------------------------------------------------------------------------------------


def test_the_papers_are_listed_and_their_robots_exist():
    from jaxkin.mechanisms.catalogue import create

    for name, kind in ((PPPS3, ppps3.PPPS3), (TLPM, tlpm.TLPM)):
        entry = catalogue.find(name)
        assert isinstance(create(entry.mechanism), kind)
    assert "neither place nor year" in catalogue.find(TLPM).source


def test_errata_say_all_four_things():
    for errata in (_cbjr2018_errata.ERRATA, _fg_errata.ERRATA):
        assert len(errata) >= 15
        for erratum in errata:
            assert erratum.where
            assert erratum.says
            assert erratum.right
            assert erratum.how
    # Only what has no number in it stands without a check.
    assert [e.where for e in _cbjr2018_errata.ERRATA + _fg_errata.ERRATA if not e.checks] == [
        "text before (21), and (21)"
    ]


def test_float64_is_asked_for():
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(PrecisionError, match="enable_x64"):
            chablat_baron_jha_rolland_2018.reproduce()
        with pytest.raises(PrecisionError, match="enable_x64"):
            fu_gao_tlpm.reproduce()
    finally:
        jk.enable_x64()


# --- whole reproductions ----------------------------------------------------------------------------------------------

PICTURES = {
    PPPS3: ("figure_1", "figure_1_modes", "figure_2", "figure_3", "figure_3_slices", "zxy", "joints"),
    TLPM: ("figure_2", "figure_3", "figure_4", "figure_4_corner", "figure_5", "figure_6", "figure_7"),
}
OTHERS = {
    PPPS3: ("figure_1_side_2_5", "figure_1_side_2_5_modes"),
    TLPM: ("figure_2_L_834_386_h_590", "figure_3_L_834_386_h_590"),
}
TABLES = {
    PPPS3: ("candidates", "near_home", "costs", "aspects"),
    TLPM: ("table_1", "wrist_angles", "workspace", "workspace_L_834_386_h_590", "yaw"),
}
PLACES = {
    PPPS3: (
        *(f"Eq. ({n})" for n in (1, 2, 4, 12, 13, 14, 15, 25, 26, 27, 28, 29)),
        *(f"Eqs. ({n})" for n in ("3)-(5", "6)-(11", "16)-(19", "20)-(24")),
        *(f"section 4, bullet {n}" for n in (1, 2, 3)),
        "text after (24)",
        "text after (28)",
        "Fig. 1",
        "Fig. 2",
        "Fig. 3",
    ),
    TLPM: (
        *(f"Eq. ({n})" for n in (1, 2, 9, 10, 11, 12, 15, 19, 20, 22, 23)),
        *(f"Eqs. ({n})" for n in ("3), (4", "5), (6", "7), (8", "13), (14", "16)-(18")),
        "Eqs. (21)-(23) [ours]",
        "Table 1",
        "text after (12)",
        "D > sqrt(a)",
        "Fig. 2",
        "Fig. 3",
        "Fig. 4",
        "Fig. 6 [ours]",
    ),
}


@pytest.fixture(scope="module", params=[PPPS3, TLPM])
def reproduction(request):
    module = {PPPS3: chablat_baron_jha_rolland_2018, TLPM: fu_gao_tlpm}[request.param]
    robot = {PPPS3: lambda: ppps3.create(side=2.5), TLPM: lambda: tlpm.create(base_radius=834.386)}[request.param]()
    told = []
    report = module.reproduce(robot, tell=told.append)
    files = report.contents()
    plt.close("all")
    return request.param, report, files, told


@pytest.mark.slow
def test_a_whole_reproduction_passes(reproduction):
    name, report, _, told = reproduction
    assert [check for check in report.checks if not check.passed] == []
    assert len(report.checks) > 60
    keys = [check.key for check in report.checks]
    assert len(set(keys)) == len(keys)
    assert {key for erratum in report.errata for key in erratum.checks} <= set(keys)
    assert len(told) == len(report.parts)
    assert set(PLACES[name]) <= {check.source for check in report.checks}


@pytest.mark.slow
def test_a_whole_reproduction_makes_every_file(reproduction):
    name, report, files, _ = reproduction
    pictures = PICTURES[name] + OTHERS[name]
    expected = {f"{picture}.{suffix}" for picture in pictures for suffix in ("png", "pdf")}
    assert set(files) == expected | {f"{table}.csv" for table in TABLES[name]} | {"report.md", "report.json"}
    text = files["report.md"].decode()
    for erratum in report.errata:
        assert erratum.where in text
    for picture in pictures:
        assert f"]({picture}.png)" in text
        assert files[f"{picture}.png"].startswith(b"\x89PNG")
    captions = [picture.caption for part in report.parts for picture in part.pictures.values()]
    assert all("After Fig." in caption or "[ours]" in caption or "after the text" in caption for caption in captions)
    assert "reproduces" not in text.lower()
    assert "were not at hand" in text.split("## Not checked")[1]
    assert json.loads(files["report.json"])["passed"] is True


@pytest.mark.slow
def test_tables_of_the_aspects_and_of_the_workspace(reproduction):
    name, _, files, _ = reproduction
    if name == PPPS3:
        aspects = list(csv.DictReader(io.StringIO(files["aspects.csv"].decode())))
        np.testing.assert_allclose([float(row["share of rotations"]) for row in aspects], 0.25, atol=1e-9)
        np.testing.assert_allclose([float(row["volume (rad^3)"]) for row in aspects], math.pi**3, atol=1e-7)
    else:
        faces = list(csv.DictReader(io.StringIO(files["workspace.csv"].decode())))
        areas = {row["face"]: float(row["area"]) for row in faces}
        assert len(areas) == 6
        # The three limbs are alike.
        for end in ("min", "max"):
            assert np.ptp([areas[f"l{k} = l{k}_{end}"] for k in (1, 2, 3)]) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("name", "change"), [(PPPS3, "side=2.5"), (TLPM, "base_radius=834.386")])
def test_the_command_writes_the_report(capsys, tmp_path, name, change):
    out = tmp_path / "paper"
    with pytest.raises(SystemExit) as caught:
        main(["reproduce", name, "--out", str(out), "--set", change])
    text, told = capsys.readouterr()
    assert caught.value.code == 0
    assert "checks passed" in text
    assert "checks passed" in told
    assert (out / "report.md").exists()
    plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize(
    "geometry",
    [
        {"stroke": np.array([50.0, 120.0])},  # without p = 0
        {"base_radius": 300.0, "height": 900.0},
        {"height": 200.0, "initial_lengths": 700.0},  # reaches the base plane
    ],
)
def test_figures_of_other_robots(geometry):
    robot = tlpm.create(**geometry)
    for part in (tlpm_figures.figure_2(robot), tlpm_figures.figure_3(robot)):
        assert failed(part) == set()
    plt.close("all")
