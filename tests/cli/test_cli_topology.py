"""``jaxkin aspects``, ``regions``, ``path`` and ``analyse``."""

import csv
import json
import math

import pytest

SECTION = ["--fix", "rho2=1", "--grid", "rho1=0:4:100", "--grid", "rho3=0:4:100"]
TURN = f"{-math.pi}:{math.pi}"
POSES = ["--grid", "x=-3:3:32", "--grid", "y=-3:3:32", "--grid", f"phi={TURN}:32"]


@pytest.mark.parametrize("command", ["aspects", "regions", "path", "analyse"])
def test_help_has_examples_and_imports_nothing_heavy(command, run_light):
    done = run_light(command, "--help")
    assert f"jaxkin {command} rpr3" in done.stdout


def test_aspects_are_counted_and_written(run, tmp_path):
    folder = tmp_path / "aspects"
    code, out, _ = run("aspects", "rpr3-analytic", *POSES, "--out", folder)
    assert code == 0
    assert out.splitlines()[0] == "rpr3-analytic(c2=1, c3=0, d3=1)"
    rows = list(csv.DictReader((folder / "aspects.csv").read_text().splitlines()))
    assert len(rows) == 2  # Wenger and Chablat 2009: two aspects for every member of the family.
    assert {float(row["sign"]) for row in rows} == {-1.0, 1.0}
    for row in rows:
        assert math.hypot(float(row["x"]), float(row["y"])) == pytest.approx(float(row["rho1"]), abs=1e-12)
    assert (folder / "aspects.png").read_bytes()[:4] == b"\x89PNG"
    code, out, _ = run("aspects", "rpr3-analytic", *POSES, "--json")
    assert code == 0
    assert json.loads(out)["request"] == json.loads((folder / "aspects.json").read_text())["request"]


def test_regions_sum_to_the_section(run, tmp_path):
    folder = tmp_path / "regions"
    code, out, _ = run("regions", "rpr3-analytic", *SECTION, "--out", folder)
    assert code == 0
    assert "section rho1 = 0 .. 4 (100), rho2 = 1, rho3 = 0 .. 4 (100)" in out
    rows = list(csv.DictReader((folder / "regions.csv").read_text().splitlines()))
    assert {int(row["solutions"]) for row in rows} == {0, 2, 4, 6}
    assert math.fsum(float(row["area"]) for row in rows) == pytest.approx(16.0, abs=1e-9)


def test_a_path_between_modes_is_found_and_written(run, tmp_path):
    folder = tmp_path / "path"
    joints = ["14.98", "15.38", "12"]
    code, _, _ = run("path", "rpr3", *joints, "--from", "5", "--to", "1", "--out", folder, "--json")
    assert code == 0
    kept = json.loads((folder / "path.json").read_text())
    assert kept["found"] is True
    rows = list(csv.DictReader((folder / "path.csv").read_text().splitlines()))
    assert min(float(row["clearance"]) for row in rows) > 0
    for row in (rows[0], rows[-1]):
        assert [float(row[f"rho{k}"]) for k in (1, 2, 3)] == pytest.approx([14.98, 15.38, 12.0], abs=1e-9)


def test_modes_of_opposite_sign_are_in_different_aspects(run):
    code, out, _ = run("path", "rpr3", "14.98", "15.38", "12", "--from", "0", "--to", "1")
    assert code == 0
    assert "not in the same aspect" in out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["path", "rpr3", "14.98", "15.38", "12", "--from", "9", "--to", "1"], "--from is 9"),
        (["path", "rpr3", "14.98", "15.38", "--from", "0", "--to", "1"], "Got 2 values"),
        (["path", "rpr3", "14.98", "15.38", "12", "--from", "5", "--to", "1", "--animate"], "--out FOLDER"),
        (["regions", "rpr3-analytic", "--fix", "rho2=1", "--fix", "rho3=1", "--grid", "rho1=0:4:100"], "free"),
        (["aspects", "rpr3-analytic", "--grid", "x=-3:3:32"], "lacks the pose axis 'y'"),
        (["aspects", "rpr3-analytc"], "did you mean 'rpr3-analytic'"),
        (["analyse", "rpr3-analytic"], "--out FOLDER"),
        (["analyse", "rpr3-analytic", "--fix", "w=1", "--out", "nowhere"], "no axis 'w'"),
        (["analyse", "rpr3-analytic", "--joints", "1:2", "--out", "nowhere"], "rho1:rho2:rho3"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, arguments, complaint):
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert complaint in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.slow
def test_an_analysis_is_a_folder_with_a_report(run, tmp_path):
    folder = tmp_path / "analysis"
    places = [*POSES, *SECTION]
    code, out, err = run("analyse", "rpr3-analytic", *places, "--out", folder)
    assert code == 0, err
    report = (folder / "report.md").read_text()
    assert "Not answered" not in report
    content = json.loads((folder / "report.json").read_text())
    for chapter in content["chapters"]:
        for name in (*chapter["figures"], *chapter["tables"]):
            assert any((folder / f"{name}.{suffix}").exists() for suffix in ("png", "csv"))
        for name in chapter["data"]:
            json.loads((folder / name).read_text())
    assert "Changes of assembly mode" in out
    code, _, err = run("analyse", "rpr3-analytic", *places, "--out", folder)
    assert code == 2
    assert "holds a report already" in err
