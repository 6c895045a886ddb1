import csv
import io
import json
import re

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from section_checks import SECTIONS

import jaxkin as jk
from jaxkin.cli.main import main
from jaxkin.core.errors import InputError, PrecisionError
from jaxkin.papers import catalogue, wenger_chablat_2009
from jaxkin.papers import report as reports

NAME = "wenger-chablat-2009"
PICTURES = (
    "figure_2",
    "figure_3",
    "figure_3_c2_1.5_c3_-0.7_d3_0.4",
    "fold",
    "reference_14.98",
    "reference_17",
    "aspects",
    "basic_regions",
    "mode_change",
)
TABLES = ("cusps", "cusp_edges", "families", "equation_8", "solutions", "reference_cusps")


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def report(told):
    robot = jk.mechanisms.rpr3.analytic(1.5, -0.7, 0.4)
    return wenger_chablat_2009.reproduce(robot, tell=told.append)


@pytest.fixture(scope="module")
def files(report):
    contents = report.contents()
    plt.close("all")
    return contents


@pytest.fixture
def run(capsys):

    def call(*arguments):
        with pytest.raises(SystemExit) as caught:
            main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return caught.value.code, out, err

    return call


def table(files, name):
    return list(csv.DictReader(io.StringIO(files[f"{name}.csv"].decode())))


# --- the paper ----------------------------------------------------------------------------------------------


def test_every_check_passes(report):
    assert [check for check in report.checks if not check.passed] == []
    assert report.passed
    assert len(report.checks) > 70
    keys = [check.key for check in report.checks]
    assert len(set(keys)) == len(keys)


def test_every_file_is_made(files):
    expected = {f"{name}.{suffix}" for name in PICTURES for suffix in ("png", "pdf")}
    assert set(files) == expected | {f"{name}.csv" for name in TABLES} | {"report.md", "report.json"}
    for name in PICTURES:
        assert files[f"{name}.png"].startswith(b"\x89PNG")
        assert files[f"{name}.pdf"].startswith(b"%PDF")


def test_the_report_lists_every_equation_and_figure(report, files):
    sources = " ".join(check.source for check in report.checks)
    for place in ("Eqs. (1)-(3)", "Eqs. (4), (5)", "Eq. (6)", "Eq. (7)", "Eq. (8)", "f1", "f2", "Fig. 2", "Fig. 3"):
        assert place in sources, place
    assert {"S", "Q1", "Q2", "Q3", "Q4", "rho1 = 14.98", "rho1 = 17"} <= {check.source for check in report.checks}
    text = files["report.md"].decode()
    assert f"{len(report.checks)} of {len(report.checks)} checks passed" in text
    assert "aspects of the example" in text.split("## Not checked")[0]
    for erratum in report.errata:
        assert f"| {erratum.where} | {erratum.says} |" in text
    for name in PICTURES:
        assert f"]({name}.png)" in text


def test_the_report_can_be_read_by_programs(report, files):
    content = json.loads(files["report.json"])
    assert content["passed"] is True
    assert sum(len(part["checks"]) for part in content["parts"]) == len(report.checks)
    assert content["run_log"]["seconds"] > 0
    known = {check["key"] for part in content["parts"] for check in part["checks"]}
    assert {key for erratum in content["errata"] for key in erratum["checks"]} <= known


def test_each_part_is_told_when_it_is_done(report, told):
    assert len(told) == len(report.parts)
    assert re.match(r"Equations: (\d+) of \1 checks passed", told[0])


def test_tables_hold_the_exact_cusps(files):
    cusps = [[float(row[name]) for name in ("rho1", "rho2", "rho3")] for row in table(files, "cusps")]
    second = (np.sqrt((3 * np.sqrt(3) - 3) / 2), 1, np.sqrt(1 + 3 * np.sqrt(3)))
    np.testing.assert_allclose(cusps, [second, second, (np.sqrt(3), 1, 1), (np.sqrt(3), 1, 1)], rtol=1e-14)
    assert sorted({int(row["cusps"]) for row in table(files, "families")}) == [0, 1, 2, 3]


def test_reference_cusps_are_those_of_the_exact_elimination(files):
    # tests/data: all cusps, from a resultant with rational coefficients and certified balls.
    sections = {section["name"]: section for section in SECTIONS}
    rows = table(files, "reference_cusps")
    for rho1 in (14.98, 17.0):
        exact = sorted(cusp["rho"] for cusp in sections[f"reference, rho1 = {rho1:g}"]["cusps"])
        found = sorted([float(r[n]) for n in ("rho1", "rho2", "rho3")] for r in rows if float(r["rho1"]) == rho1)
        np.testing.assert_allclose(found, exact, rtol=1e-12)


def test_the_errata_are_no_slips_of_ours(report):
    checks = {check.key: check for check in report.checks}
    assert checks["S-printed"].got == "189"
    assert checks["eq8-zero"].got == "-5.5"
    assert checks["cusp-1-truncated"].printed == "(1.04789131, 2.48920718)"


def test_float64_is_asked_for():
    import jax

    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(PrecisionError, match="enable_x64"):
            wenger_chablat_2009.figure_2()
        with pytest.raises(PrecisionError, match="enable_x64"):
            wenger_chablat_2009.reproduce()
    finally:
        jk.enable_x64()


# --- checks and reports -------------------------------------------------------------------------------------


def check(difference, tolerance=1e-12):
    return reports.Check("key", "Eq. (1)", "a sum", "2", "3", difference, tolerance, "a | b")


@pytest.mark.parametrize(("difference", "passed"), [(0.0, True), (1e-12, True), (2e-12, False), (np.nan, False)])
def test_a_check_passes_within_its_tolerance(difference, passed):
    assert check(difference).passed is passed


def test_a_count_must_agree_exactly():
    assert reports.count_check("k", "w", "n", 2, 2).passed
    assert not reports.count_check("k", "w", "n", 2, 3).passed


def tiny(*differences):
    figure = plt.figure(figsize=(1, 1))
    part = reports.Part(
        "Part",
        tuple(check(d) for d in differences),
        {"picture": reports.Picture(figure, "A picture")},
        {"numbers": reports.Table("Numbers", ("a", "b"), [(1, 0.1), ("x|y", None)])},
    )
    return reports.Report("Title", "Source", (part,), (), ("nothing",), {"seed": 1}, {"seconds": 0.0})


def test_one_failing_check_fails_the_report():
    assert tiny(0.0, 0.0).passed
    failing = tiny(0.0, np.inf)
    assert not failing.passed
    assert failing.summary() == "1 of 2 checks passed: SOME FAILED"
    assert "**FAILED**" in failing.markdown()
    assert "FAILED  Eq. (1): a sum" in str(failing.parts[0])
    content = json.loads(failing.json())
    assert content["passed"] is False
    assert content["parts"][0]["checks"][1]["difference"] == "inf"
    plt.close("all")


def test_tables_in_both_formats():
    numbers = reports.Table("Numbers", ("a", "b"), [(1, 0.1), ("x|y", None)])
    assert numbers.csv() == "a,b\n1,0.1\nx|y,\n"
    assert numbers.markdown() == "| a | b |\n| --- | --- |\n| 1 | 0.1 |\n| x\\|y |  |\n"


# --- the command --------------------------------------------------------------------------------------------


def test_without_a_name_it_lists_the_papers(run):
    code, out, _ = run("reproduce")
    assert code == 0
    assert NAME in out
    assert "hal-00412923" in out
    assert NAME in json.loads(run("reproduce", "--json")[1])


def test_an_unknown_paper_is_refused_with_a_hint(run, tmp_path):
    code, _, err = run("reproduce", "wenger-chablat-2008", "--out", tmp_path / "paper")
    assert code == 2
    assert f"did you mean '{NAME}'" in err
    assert not (tmp_path / "paper").exists()
    with pytest.raises(InputError, match="choose one of"):
        catalogue.find("x")


def test_a_folder_is_needed_and_none_is_overwritten(run, tmp_path):
    assert "--out FOLDER" in run("reproduce", NAME)[2]
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    code, _, err = run("reproduce", NAME, "--out", full)
    assert code == 2
    assert "holds something else" in err
    (full / "report.json").write_text("{}")
    code, _, err = run("reproduce", NAME, "--out", full)
    assert code == 2
    assert "--force" in err
    assert (full / "report.json").read_text() == "{}"


def test_bad_geometry_is_refused(run, tmp_path):
    out = tmp_path / "paper"
    assert "no geometry 'c9'" in run("reproduce", NAME, "--out", out, "--set", "c9=1")[2]
    assert "neither c2 nor d3" in run("reproduce", NAME, "--out", out, "--set", "d3=0")[2]
    assert not out.exists()


@pytest.mark.parametrize(("difference", "code"), [(0.0, 0), (1.0, 1)])
def test_the_exit_code_tells_whether_every_check_passed(run, tmp_path, monkeypatch, difference, code):
    given = []

    def reproduce(robot, tell):
        given.append(robot)
        tell("Part: done")
        return tiny(difference)

    monkeypatch.setattr(wenger_chablat_2009, "reproduce", reproduce)
    out = tmp_path / "paper"
    result, text, err = run("reproduce", NAME, "--out", out)
    assert result == code
    assert given == [None]
    assert "Part: done" in err
    assert ("FAILED  Eq. (1): a sum: 3" in text) == bool(code)
    names = {"picture.png", "picture.pdf", "numbers.csv", "report.md", "report.json"}
    assert {path.name for path in out.iterdir()} == names
    result, text, _ = run("reproduce", NAME, "--out", out, "--force", "--json", "--set", "c2=1.5")
    assert result == code
    assert json.loads(text)["passed"] is not bool(code)
    assert float(given[1].c2) == 1.5
    plt.close("all")
