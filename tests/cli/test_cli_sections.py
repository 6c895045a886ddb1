import csv
import json
import math

import pytest

SECTION = ["rpr3-analytic", "--fix", "rho2=1", "--grid", "rho1=0:4:40", "--grid", "rho3=0:4:50"]
LOCI, CUSPS = ["loci", *SECTION], ["cusps", *SECTION]


def snapshot(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("command", ["loci", "cusps"])
def test_help_has_examples_and_imports_nothing_heavy(command, run_light):
    done = run_light(command, "--help")
    assert f"jaxkin {command} rpr3 --fix rho1=14.98" in done.stdout


def test_loci_says_which_robot_curves_crossings_and_evidence(run):
    code, out, _ = run(*LOCI)
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "rpr3-analytic(c2=1, c3=0, d3=1)"
    assert lines[1] == "section rho1 = 0 .. 4 (40), rho2 = 1, rho3 = 0 .. 4 (50)"
    assert lines[2].startswith("2 singular curves over rho1, rho3 (2 closed, 0 virtual)")
    assert sum(line.startswith("  crossing: rho1 = ") for line in lines) == 2
    assert "of these on no traced curve: 0" in out


def test_loci_are_numbers_points_and_a_picture(run, tmp_path):
    folder = tmp_path / "deep" / "loci"
    code, out, _ = run(*LOCI, "--out", folder, "--json")
    assert code == 0
    printed = json.loads(out)
    kept = json.loads((folder / "loci.json").read_text())
    assert printed.pop("files") == {
        kind: str(folder / f"loci.{suffix}")
        for kind, suffix in (("numbers", "json"), ("table", "csv"), ("png", "png"), ("pdf", "pdf"))
    }
    assert printed == kept
    assert kept["request"]["mechanism"] == "rpr3-analytic"
    assert kept["request"]["geometry"]["c2"] == 1.0
    assert {"jax", "seconds", "finished"} <= set(kept["run_log"])
    rows = list(csv.DictReader((folder / "loci.csv").read_text().splitlines()))
    assert list(rows[0]) == ["curve", "label", "virtual", "rho1", "rho2", "rho3", "x", "y", "phi"]
    assert len(rows) == sum(len(curve["joints"]) for curve in kept["curves"])
    assert [int(row["curve"]) for row in rows] == sorted(int(row["curve"]) for row in rows)
    assert {row["virtual"] for row in rows} == {"false"}
    for row in rows[::50]:
        joints = [float(row[name]) for name in ("rho1", "rho2", "rho3")]
        assert math.hypot(float(row["x"]), float(row["y"])) == pytest.approx(joints[0], abs=1e-12)
        assert joints in kept["curves"][int(row["curve"])]["joints"]
    assert (folder / "loci.png").read_bytes()[:4] == b"\x89PNG"
    assert (folder / "loci.pdf").read_bytes()[:4] == b"%PDF"
    assert len(list(folder.iterdir())) == 4


def test_nothing_is_overwritten_unasked(run, tmp_path):
    folder = tmp_path / "loci"
    assert run(*LOCI, "--out", folder)[0] == 0
    before = snapshot(folder)
    assert run(*LOCI, "--out", folder)[0] == 0
    assert snapshot(folder) == before

    (folder / "loci.csv").unlink()
    assert run(*LOCI, "--out", folder)[0] == 0
    assert snapshot(folder) == before

    other = [*LOCI[:3], "rho2=1.5", *LOCI[4:]]
    code, out, err = run(*other, "--out", folder)
    assert code == 2
    assert out == ""
    assert "section.rho2 is 1.0 there and 1.5 here" in err
    assert "--force" in err
    assert snapshot(folder) == before

    (folder / "notes.txt").write_text("mine")
    assert run(*other, "--out", folder, "--force")[0] == 0
    after = snapshot(folder)
    assert after.pop("notes.txt") == b"mine"
    assert set(after) == set(before)
    assert all(after[name] != before[name] for name in after)
    assert json.loads(after["loci.json"])["request"]["section"]["rho2"] == 1.5


def test_a_folder_of_something_else_is_left_alone(run, tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    for command, name in ((LOCI, "loci.json"), (CUSPS, "cusps.json")):
        code, out, err = run(*command, "--out", tmp_path)
        assert (code, out) == (2, "")
        assert "holds something else" in err
        assert "--force" in err
        for place in (tmp_path / "thesis.txt", tmp_path / "thesis.txt" / "deep"):
            code, _, err = run(*command, "--out", place)
            assert code == 2
            assert "choose another folder" in err
        assert snapshot(tmp_path) == {"thesis.txt": b"years of work"}
        for text in ("mine", "{}", "[]", '{"request": 1}'):
            (tmp_path / name).write_text(text)
            code, _, err = run(*command, "--out", tmp_path)
            assert code == 2
            assert "cannot be read as a result" in err
            assert (tmp_path / name).read_text() == text
        (tmp_path / name).unlink()


def test_a_full_disk_costs_nothing_that_existed(run, tmp_path, monkeypatch):
    from pathlib import Path

    folder = tmp_path / "cusps"
    assert run(*CUSPS, "--out", folder)[0] == 0
    before = snapshot(folder)
    write = Path.write_bytes

    def full(path, data):
        if "json" in path.name:
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    code, _, err = run(*CUSPS[:3], "rho2=1.5", *CUSPS[4:], "--out", folder, "--force")
    assert code == 2
    assert "No space left on device" in err
    assert snapshot(folder) == before


def test_closed_forms_are_labelled_and_have_virtual_parts(run, tmp_path):
    folder = tmp_path / "loci"
    code, out, _ = run(*LOCI, "--closed-form", "--out", folder)
    assert code == 0
    assert "S: " in out
    assert "virtual" in out
    rows = list(csv.DictReader((folder / "loci.csv").read_text().splitlines()))
    assert {row["label"] for row in rows} == {"S", "Q1", "Q2", "Q3", "Q4"}
    assert {row["virtual"] for row in rows} == {"true", "false"}
    assert {row["x"] for row in rows if row["virtual"] == "true"} == {""}
    assert "" not in {row["x"] for row in rows if row["virtual"] == "false"}
    code, _, err = run(*LOCI, "--out", folder)
    assert code == 2
    assert "method is 'closed form' there and 'trace' here" in err


def test_cusps_of_the_analytic_robot(run, tmp_path):
    folder = tmp_path / "cusps"
    code, out, _ = run(*CUSPS, "--out", folder, "--json")
    assert code == 0
    printed = json.loads(out)
    printed.pop("files")
    assert printed == json.loads((folder / "cusps.json").read_text())
    assert printed["request"]["geometry"]["d3"] == 1.0
    assert len(printed["cusps"]) == 2
    known = next(cusp for cusp in printed["cusps"] if abs(cusp["joints"][2] - 1) < 0.1)
    assert known["joints"] == pytest.approx([math.sqrt(3), 1, 1], abs=1e-11)
    assert len(known["poses"]) == 2
    assert known["error"] < 1e-11
    assert known["residual"] < 1e-12
    assert [other["kind"] for other in printed["others"]] == ["crossing", "crossing"]
    rows = list(csv.DictReader((folder / "cusps.csv").read_text().splitlines()))
    assert [row["cusp"] for row in rows] == ["0", "0", "1", "1"]
    poses = [pose for cusp in printed["cusps"] for pose in cusp["poses"]]
    assert [[float(row[name]) for name in ("x", "y", "phi")] for row in rows] == poses
    assert float(rows[0]["third_coefficient"]) == printed["cusps"][0]["third_coefficient"]
    assert (folder / "cusps.png").read_bytes()[:4] == b"\x89PNG"
    assert (folder / "cusps.pdf").read_bytes()[:4] == b"%PDF"

    text = run(*CUSPS)[1]
    assert text.startswith("rpr3-analytic(c2=1, c3=0, d3=1)\nsection rho1 = 0 .. 4 (40), rho2 = 1")
    assert "rho1 = 1.7320508075688" in text
    assert text.count("no cusp, crossing:") == 2
    assert "cusp poses on no traced curve: 0" in text


def test_a_geometry_is_set(run):
    code, out, _ = run(*CUSPS, "--set", "c2=1.5", "--json")
    assert code == 0
    assert json.loads(out)["request"]["geometry"]["c2"] == 1.5


def _axes(*free, **fixed):
    fixes = [a for name, value in fixed.items() for a in ("--fix", f"{name}={value}")]
    return ["rpr3-analytic", *fixes, *(a for axis in free for a in ("--grid", axis))]


@pytest.mark.parametrize("command", ["loci", "cusps"])
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (_axes("rho1=0:4:40", rho2=1, rho3=1), ["1 free joint axis", "exactly two"]),
        (_axes("rho1=0:4:40", "rho2=0:4:40", "rho3=0:4:40"), ["3 free joint axes", "exactly two"]),
        (_axes("rho1=0:1:40", "rho3=0:1:40", rho2=100), ["no pose reaches", "rho2 = 100"]),
        (_axes("rho2=0:4:40", "rho3=0:4:40", rho1=0), ["rho1", "zero length"]),
        (_axes("rho2=0:4:40", "rho3=0:4:40", rho1=-1), ["rho1", "outside its limits"]),
        (_axes("rho2=0:4:40", "rho3=0:4:40", rho4=1), ["rho4", "rho1, rho2, rho3"]),
        (_axes("rho2=0:4:40", "rho3=0:4:40"), ["lacks", "rho1"]),
        (_axes("rho2=0:4:40", "x=0:4:40", rho1=1), ["x", "rho1, rho2"]),
        (_axes("rho2=0:4:40", "rho3=0:4", rho1=1), ["rho3", "LOW:HIGH:N"]),
        (_axes("rho2=0:4:40", "rho3=0:4:40", rho1="one"), ["rho1", "one", "number"]),
        ([*SECTION, "--set", "d3=0"], ["d3=0", "zero"]),
        (["rpr4", *SECTION[1:]], ["rpr4", "did you mean"]),
        ([*SECTION, "--field", "x"], ["--field"]),
    ],
)
def test_bad_input_ends_with_one_sentence_and_code_2(command, arguments, words, run, tmp_path):
    code, out, err = run(command, *arguments, "--out", tmp_path / "result")
    assert code == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    for word in words:
        assert word in err
    assert list(tmp_path.iterdir()) == []


def test_closed_forms_of_a_robot_without_any(run, tmp_path):
    general = ["rpr3", "--fix", "rho1=14.98", "--grid", "rho2=0:36:40", "--grid", "rho3=0:36:40"]
    code, out, err = run("loci", *general, "--closed-form", "--out", tmp_path / "result")
    assert (code, out) == (2, "")
    assert "rpr3 has no closed forms" in err
    assert "leave out --closed-form" in err
    assert list(tmp_path.iterdir()) == []
