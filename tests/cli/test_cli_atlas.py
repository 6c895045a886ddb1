import json

import numpy as np
import pytest

import jaxkin as jk

SECTION = ["--section", "rho2=1", "--section", "rho1=0:4:40", "--section", "rho3=0:4:40"]
CUSPS = ["atlas", "rpr3-analytic", "--field", "cusps", "--grid", "c3=0:1:2", "--grid", "d3=0:1:3", *SECTION]
VOLUME = ["atlas", "tlpm", "--field", "volume", "--grid", "base_radius=590:640:2"]


def test_help_imports_nothing_heavy(run_light):
    assert "--section" in run_light("atlas", "--help").stdout


def test_an_atlas_is_data_numbers_and_a_picture(run, tmp_path):
    folder = tmp_path / "atlas"
    code, out, _ = run(*CUSPS, "--out", folder)
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "rpr3-analytic(c2=1, c3=0, d3=1)"
    assert lines[1] == "number_of_cusps over c3 = 0 .. 1 (2), d3 = 0 .. 1 (3): 6 samples"
    assert "  (no value) 33.3333%" in lines
    assert "  computed one design at a time, 2 designs refused" in lines
    assert {p.name for p in folder.iterdir()} == {"atlas.json", "atlas.pdf", "atlas.png", "atlas.zarr"}
    assert jk.open_store(folder / "atlas.zarr").number_of_cusps.values.tolist() == [[-1, 2, 2], [-1, 2, 2]]
    kept = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    code, out, _ = run(*CUSPS, "--out", folder, "--resume", "--json")
    numbers = json.loads(out)
    assert code == 0
    assert numbers["counts"] == {"2": 4}
    assert numbers["refused_designs"] == 2
    assert numbers["first_refusal"].startswith("c3 = 0, d3 = 0: ")
    assert {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()} == kept


def test_the_volume_and_what_it_would_take(run):
    code, out, _ = run(*VOLUME, "--json")
    assert code == 0
    numbers = json.loads(out)
    assert numbers["unit"] == "mm^3"
    assert numbers["axis_units"] == {"base_radius": "mm"}
    assert np.isclose(numbers["max"], 72322565.9305, atol=1e-3)
    code, out, _ = run(*VOLUME, "--dry-run")
    assert code == 0
    assert out.startswith("2 samples")


CANNOT = {
    "no section": (CUSPS[: -len(SECTION)], "none is given: add --section"),
    "part of a section": (CUSPS[:-2], "lacks the joint axis 'rho3': give it as --section AXIS=LOW:HIGH:N"),
    "bad section": ([*CUSPS[:-2], "--section", "rho3=0:4"], "--section rho3 is '0:4': write it as LOW:HIGH:N"),
    "twice": ([*CUSPS, "--section", "rho3=1"], "'rho3' is given by --section twice"),
    "another field's": ([*VOLUME, *SECTION], "--section is given, which belongs to --field cusps"),
    "branch": ([*CUSPS, "--branch", "upper"], "--branch is given, which belongs to --field volume"),
    "joints": ([*CUSPS, "--grid", "rho1=0:1:3"], "'rho1', which is no number of rpr3-analytic's geometry"),
    "no such field": (["atlas", "tlpm", "--field", "x"], "'x' is not one of 'cusps', 'volume'"),
}


@pytest.mark.parametrize("case", CANNOT)
def test_bad_input_is_one_line(run, case):
    arguments, message = CANNOT[case]
    code, _, err = run(*arguments)
    assert code == 2
    assert message in err
    assert len(err.splitlines()) == 1
