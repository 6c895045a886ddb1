import csv
import json

import numpy as np
import pytest
import xarray

MAP = ["map", "rpr3-analytic", "--fix", "rho2=1", "--grid", "rho1=0:4:40", "--grid", "rho3=0:4:50"]


def snapshot(folder):
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_help_and_version_do_not_import_jax(run_light):
    for arguments in (["--help"], ["--version"], ["map", "--help"], ["forward", "--help"], ["list"]):
        run_light(*arguments)


def test_list(run):
    code, out, _ = run("list")
    assert code == 0
    assert "rpr3-analytic" in out
    assert "c2=15.91" in out
    assert json.loads(run("list", "--json")[1])["rpr3-analytic"]["geometry"] == {
        "c2": 1.0,
        "c3": 0.0,
        "d3": 1.0,
    }


def test_forward_of_the_reference_geometry(run):
    code, out, _ = run("forward", "rpr3", 14.98, 15.38, 12, "--json")
    assert code == 0
    solutions = json.loads(out)["solutions"]
    assert len(solutions) == 6
    assert {s["status"] for s in solutions} == {"ok"}
    assert solutions[0]["x"] == pytest.approx(-8.7265953318629088, abs=1e-10)
    assert solutions[5]["determinant"] == pytest.approx(313034.17, rel=1e-7)
    assert max(s["residual"] for s in solutions) <= 1e-12
    text = run("forward", "rpr3", 14.98, 15.38, 12)[1]
    assert "6 real solutions" in text
    assert "c2=15.91" in text


def test_inverse_takes_negative_numbers_and_geometry(run):
    code, out, _ = run("inverse", "rpr3-analytic", -1, -0.5, -1.25, "--set", "c2=1.5", "--set", "d3=-2", "--json")
    assert code == 0
    (solution,) = json.loads(out)["solutions"]
    assert solution["rho1"] == pytest.approx(np.hypot(1, 0.5))
    assert solution["phi"] == -1.25


def test_no_solution_is_an_answer(run):
    code, out, _ = run("forward", "rpr3-analytic", 0.25, 1, 3)
    assert code == 0
    assert "0 real solutions" in out
    code, out, _ = run("forward", "rpr3-analytic", "-0.25", 1, 3)
    assert code == 0
    assert "outside the limits" in out


def test_a_table_goes_in_and_out(run, tmp_path):
    table, result = tmp_path / "legs.csv", tmp_path / "poses.csv"
    table.write_text("name,rho3,rho2,rho1\na,12,15.38,14.98\nb,1,1,-1\nc,1,100,1\n")
    code, _, err = run("forward", "rpr3", "--csv", table, "--out", result)
    assert code == 0
    assert "8 rows written" in err
    rows = list(csv.DictReader(result.read_text().splitlines()))
    assert [r["row"] for r in rows] == ["0"] * 6 + ["1", "2"]
    assert [r["status"] for r in rows[6:]] == ["outside_limits", "no_real_solution"]
    assert rows[6]["x"] == ""
    assert float(rows[0]["x"]) == pytest.approx(-8.7265953318629088, abs=1e-10)
    before = result.read_bytes()
    code, _, err = run("forward", "rpr3", "--csv", table, "--out", result)
    assert code == 2
    assert "--force" in err
    assert result.read_bytes() == before
    assert run("forward", "rpr3", "--csv", table, "--out", result, "--force")[0] == 0
    code, _, _ = run("forward", "rpr3", "--csv", table, "--out", tmp_path / "poses.json")
    assert code == 0
    assert len(json.loads((tmp_path / "poses.json").read_text())["solutions"]) == 8


def test_a_bad_row_gets_its_status_and_the_others_their_solutions(run, tmp_path):
    table = tmp_path / "legs.csv"
    table.write_text("rho1,rho2,rho3\n14.98,15.38,12\n14.98,long,12\n14.98,,12\n14.98\n")
    code, out, err = run("forward", "rpr3", "--csv", table)
    assert code == 2
    rows = list(csv.DictReader(out.splitlines()))
    assert [r["status"] for r in rows] == ["ok"] * 6 + ["invalid_input"] * 3
    assert "line 3: rho2 is 'long': it must be a number" in err
    assert "line 4: rho2 is ''" in err


def test_map_is_a_picture_data_and_numbers(run, tmp_path):
    out_folder = tmp_path / "map"
    code, out, _ = run(*MAP, "--out", out_folder, "--json")
    assert code == 0
    numbers = json.loads(out)
    assert numbers["samples"] == 2000
    assert set(numbers["fractions"]) == {"0", "2", "4", "6"}
    assert sum(numbers["fractions"].values()) == pytest.approx(1.0)
    data = xarray.open_zarr(out_folder / "map.zarr", consolidated=False, chunks=None)
    assert float((data.forward_count == 6).mean()) == pytest.approx(numbers["fractions"]["6"])
    assert (out_folder / "map.png").read_bytes()[:4] == b"\x89PNG"
    assert (out_folder / "map.pdf").read_bytes()[:4] == b"%PDF"
    assert json.loads((out_folder / "map.json").read_text())["fractions"] == numbers["fractions"]

    before = snapshot(out_folder)
    code, again, _ = run(*MAP, "--out", out_folder, "--json")
    assert code == 0
    assert json.loads(again)["fractions"] == numbers["fractions"]
    assert snapshot(out_folder) == before

    code, _, err = run(*MAP[:3], "rho2=2", *MAP[4:], "--out", out_folder)
    assert code == 2
    assert "another request" in err
    assert "--force" in err
    assert snapshot(out_folder) == before

    (out_folder / "notes.txt").write_text("mine")
    code, out, _ = run(*MAP[:3], "rho2=2", *MAP[4:], "--out", out_folder, "--force", "--json")
    assert code == 0
    assert json.loads((out_folder / "map.json").read_text())["grid"]["rho2"] == 2.0
    assert (out_folder / "notes.txt").read_text() == "mine"


def test_map_of_a_pose_field_and_without_a_picture(run, tmp_path):
    pose = ["--fix", "phi=0.5", "--grid", "x=-2:2:20", "--grid", "y=-2:2:20"]
    code, out, _ = run("map", "rpr3", "--field", "inverse_condition_number", *pose, "--json")
    assert code == 0
    assert 0 <= json.loads(out)["min"] <= json.loads(out)["max"] <= 1
    cube = [a for k in (1, 2, 3) for a in ("--grid", f"rho{k}=0.1:3:4")]
    code, _, err = run("map", "rpr3-analytic", *cube, "--out", tmp_path / "cube")
    assert code == 0
    assert "no picture" in err
    assert (tmp_path / "cube" / "map.zarr").is_dir()


def test_pictures_and_numbers_never_belong_to_another_request(run, tmp_path):
    # As when a forced replacement is stopped after the data: numbers and pictures are still the old ones.
    out = tmp_path / "map"
    run(*MAP, "--out", out)
    old = snapshot(out)
    other = tmp_path / "other"
    run(*MAP[:3], "rho2=2", *MAP[4:], "--out", other)
    for name in ("map.json", "map.png", "map.pdf"):
        (other / name).write_bytes(old[out / name])
    code, printed, _ = run(*MAP[:3], "rho2=2", *MAP[4:], "--out", other, "--json")
    assert code == 0
    numbers = json.loads((other / "map.json").read_text())
    assert numbers["grid"]["rho2"] == 2.0
    assert numbers["counts"] == json.loads(printed)["counts"]
    assert (other / "map.png").read_bytes() != old[out / "map.png"]


def test_a_damaged_chunk_is_found_and_computed_again(run, tmp_path):
    out = tmp_path / "map"
    run(*MAP, "--out", out)
    chunk = out / "map.zarr" / "forward_count" / "c" / "0" / "0"
    whole = chunk.read_bytes()
    chunk.write_bytes(whole[:20])
    code, printed, _ = run("verify", out)
    assert code == 1
    assert "1 of 1 tile is damaged (0)" in printed
    code, printed, _ = run(*MAP, "--out", out)
    assert code == 0
    assert "computed again: 1" in printed
    assert chunk.read_bytes() == whole
    code, printed, _ = run("verify", out)
    assert code == 0
    assert "its one tile is as it was written" in printed


def test_tables_that_mean_something_else_are_told(run, tmp_path):
    table = tmp_path / "legs.csv"
    for content, word in (
        ("rho1,rho2,rho3\n14,98,15,38,12,0\n", "line 2 has more cells"),
        ("rho1,rho1,rho2,rho3\n1,1,1,1\n", "stands twice"),
        ("rho1;rho2;rho3\n1;1;1\n", "separated by commas"),
        ("rho1,rho2,rho3\n1,1,1\n\n\n1,x,1\n", "line 5: rho2"),
        ("rho1,rho2,rho3\n1_0,1,1\n", "1_0"),
    ):
        table.write_text(content)
        code, _, err = run("forward", "rpr3", "--csv", table)
        assert code == 2, content
        assert word in err
    table.write_text("rho1,rho2,rho3\n1,1,1\n")
    code, _, err = run("forward", "rpr3", "--csv", table, "--out", table, "--force")
    assert code == 2
    assert table.read_text() == "rho1,rho2,rho3\n1,1,1\n"


def test_ctrl_c_says_what_was_kept(run, tmp_path, monkeypatch):
    from jaxkin.core.errors import SweepInterrupted
    from jaxkin.sweep import engine

    def stopped(*_, **__):
        raise SweepInterrupted("Stopped after 3 of 9 samples.", None, 3)

    monkeypatch.setattr(engine, "_run", stopped)
    code, _, err = run(*MAP, "--out", tmp_path / "map")
    assert code == 130
    assert err.strip() == "jaxkin: Stopped after 3 of 9 samples."


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["map", "rpr4", *MAP[2:]], ["rpr4", "rpr3", "did you mean"]),
        ([*MAP, "--field", "forward_counts"], ["forward_counts", "did you mean 'forward_count'"]),
        ([*MAP, "--set", "d3=0"], ["d3=0", "neither c2 nor d3 may be zero"]),
        ([*MAP, "--set", "c2=0"], ["c2=0", "neither c2 nor d3 may be zero"]),
        ([*MAP, "--set", "c2=nan"], ["--set c2", "nan", "finite"]),
        ([*MAP, "--set", "c2=inf"], ["--set c2", "inf", "finite"]),
        ([*MAP, "--set", "c2"], ["--set", "NAME=VALUE"]),
        ([*MAP, "--set", "d9=1"], ["d9", "c2, c3, d3"]),
        ([*MAP, "--fix", "rho3=1"], ["rho3", "--fix and --grid"]),
        ([*MAP, "--fix", "rho2=2"], ["rho2", "twice"]),
        ([*MAP, "--fix", "rho4=2"], ["rho4", "rho1, rho2, rho3"]),
        ([*MAP[:-1], "rho3=0:4"], ["rho3", "LOW:HIGH:N"]),
        ([*MAP[:-1], "rho3=0:4:1"], ["rho3", "n = 1", "at least 2"]),
        ([*MAP[:-1], "rho3=0:4:0"], ["rho3", "n = 0", "at least 2"]),
        ([*MAP[:-1], "rho3=4:0:10"], ["rho3", "swap"]),
        ([*MAP[:-1], "rho3=0:four:10"], ["rho3", "four", "number"]),
        ([*MAP[:-1], "rho3=0:4:1.5"], ["rho3", "1.5", "integer"]),
        (MAP[:-2], ["lacks", "rho3"]),
        (["forward", "rpr3", "1", "2"], ["2 values", "RHO1 RHO2 RHO3"]),
        (["forward", "rpr3", "1", "2", "three"], ["rho3", "three", "number"]),
        (["forward", "rpr3"], ["one point", "--csv"]),
        (["forward", "rpr3", "1", "1", "1", "--bogus"], ["--bogus", "no option"]),
        (["map", "rpr3-analytic", *[a for k in "123" for a in ("--grid", f"rho{k}=0:4:1000000")]], ["1e+18", "fewer"]),
        (["map", "rpr3-analytic", "--fix", "rho2=1", "--grid", "rho1=0:4:900000", "--grid", "rho3=0:4:900000"], ["GB"]),
        (["forward", "rpr3", "--csv", "nowhere.csv"], ["nowhere.csv", "cannot be read"]),
        (["forward", "rpr3", "1", "2", "3", "--out", "result.txt"], ["result.txt", ".csv or .json"]),
        (["forward", "rpr3", "1", "2", "3", "--out", "no/where/r.csv"], ["no/where", "make it first"]),
    ],
)
def test_bad_input_ends_with_one_sentence_and_code_2(arguments, words, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    for word in words:
        assert word in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", ["rho1,rho2\n1,2\n", "", "rho1,rho2,rho3\n"])
def test_a_table_without_a_column_or_rows(content, run, tmp_path):
    table = tmp_path / "legs.csv"
    table.write_text(content)
    code, out, err = run("forward", "rpr3", "--csv", table)
    assert code == 2
    assert out == ""
    assert "missing" in err or "no rows" in err


def test_a_binary_table(run, tmp_path):
    (tmp_path / "legs.csv").write_bytes(b"\xff\xfe\x00\x01")
    code, _, err = run("forward", "rpr3", "--csv", tmp_path / "legs.csv")
    assert code == 2
    assert "cannot be read" in err


def test_an_output_folder_with_other_things_is_left_alone(run, tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    code, _, err = run(*MAP, "--out", tmp_path)
    assert code == 2
    assert "--force" in err
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]
    code, _, err = run(*MAP, "--out", tmp_path / "thesis.txt")
    assert code == 2
    assert "is a file" in err


def test_an_unknown_option_or_command_ends_with_code_2(run):
    for arguments in (["maps"], ["map", "rpr3", "--grids", "x=1:2:3"]):
        code, _, err = run(*arguments)
        assert code == 2
        assert err
