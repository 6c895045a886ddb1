import csv
import json
import math

import pytest
from matplotlib.figure import Figure

import jaxkin as jk
from jaxkin.cli import optimise as command
from jaxkin.design import constrained
from jaxkin.design.optimise import METHODS

HOME = """
name = "isotropy at home"
[robot]
mechanism = "tlpm"
[vary]
base_radius = [300.0, 900.0]
[places.home]
poses = [[0.0, 0.0, 0.0]]
[maximise]
objective = "inverse_condition_number"
place = "home"
norm = "frobenius"
[optimiser]
starts = 3
refine = 1
method = "slsqp"
neighbours = 20
"""


def swap(text, old, new):
    assert old in text
    return text.replace(old, new)


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "problem.toml"
    path.write_text(HOME)
    return path


@pytest.fixture(autouse=True)
def _plain_picture(monkeypatch):
    """The picture has tests of its own."""

    def draw(design):
        ax = Figure().subplots()
        ax.plot(list(design.values.values()))
        return ax

    monkeypatch.setattr(jk.plot, "design_history", draw, raising=False)


def test_help_imports_nothing_heavy(run_light):
    assert "--starts" in run_light("optimise", "--help").stdout
    assert command.METHODS == METHODS


def test_a_verified_design_is_printed_and_written(run, problem, tmp_path):
    out = tmp_path / "design"
    code, text, errors = run("optimise", problem, "--out", out)
    assert (code, errors) == (0, "")
    lines = text.splitlines()
    assert lines[0] == "isotropy at home"
    assert lines[2].startswith("inverse condition number, Frobenius: 1 +- ")
    assert "  base_radius = 834.3860018" in text
    assert "verified" in lines
    names = {"optimise.json", "optimise.csv", "optimise.npz", "optimise.png", "optimise.pdf"}
    assert {path.name for path in out.iterdir()} == names
    numbers = json.loads((out / "optimise.json").read_text())
    assert numbers["values"]["base_radius"] / 590.0 == pytest.approx(math.sqrt(2), abs=1e-8)
    assert (numbers["verified"], numbers["stopped"], numbers["sense"]) == (True, False, "maximise")
    assert numbers["request"]["options"]["starts"] == 3
    with open(out / "optimise.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["stage"] for row in rows} == {"refinement"}
    assert float(rows[-1]["base_radius"]) == pytest.approx(numbers["values"]["base_radius"], abs=1e-3)
    kept = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".npz"}
    code, text, _ = run("optimise", problem, "--out", out, "--json")
    assert code == 0
    assert json.loads(text)["values"] == numbers["values"]
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".npz"} == kept
    code, _, errors = run("optimise", problem, "--out", out, "--seed", 1)
    assert code == 2
    assert "options.seed is 0 there and 1 here" in errors
    assert "--force" in errors
    (out / "optimise.json").unlink()
    code, _, errors = run("optimise", problem, "--out", out, "--seed", 1)
    assert code == 2
    assert "choose another folder, or give --force" in errors
    problem.write_text(swap(HOME, "refine = 1", "refine = 0"))
    code, text, _ = run("optimise", problem, "--out", out, "--seed", 1, "--force", "--json")
    assert code == 1
    assert json.loads(text) | {"files": 0} == json.loads((out / "optimise.json").read_text()) | {"files": 0}
    assert json.loads(text)["request"]["options"]["seed"] == 1


def test_options_stand_above_the_file_and_an_unverified_design_ends_with_1(run, problem):
    problem.write_text(swap(HOME, "refine = 1", "refine = 0"))
    code, text, errors = run("optimise", problem, "--starts", 1, "--seed", 2, "--steps", 7, "--json")
    assert code == 1
    assert errors.startswith("jaxkin: the design is not verified: ")
    assert "designs around it are better" in errors
    assert errors.count("\n") == 1
    numbers = json.loads(text)
    assert numbers["verified"] is False
    assert [numbers["request"]["options"][key] for key in ("starts", "seed", "steps")] == [1, 2, 7]


def test_ctrl_c_leaves_the_best_so_far_and_the_same_command_goes_on(run, problem, tmp_path, monkeypatch):
    out = tmp_path / "design"

    def stopping(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(constrained.Hard, "solve", stopping)
        code, _, errors = run("optimise", problem, "--out", out)
    assert code == 130
    told = f"jaxkin: Stopped; the best design so far is in {out}, and the same command goes on there."
    assert errors.strip().endswith(told)
    stopped = json.loads((out / "optimise.json").read_text())
    assert stopped["stopped"] is True
    assert stopped["verified"] is False
    assert 300 <= stopped["values"]["base_radius"] <= 900
    code, _, _ = run("optimise", problem, "--out", out)
    assert code == 0
    assert json.loads((out / "optimise.json").read_text())["stopped"] is False


CANNOT = {
    "no file": (["none.toml"], "none.toml cannot be read"),
    "no TOML": (["bad.toml"], "is no TOML: "),
    "no such key": (["key.toml"], "no key 'robt'"),
    "method": (["problem.toml", "--method", "newton"], "'newton' is not one of"),
    "starts": (["problem.toml", "--starts", "0"], "0 is not in the range"),
    "a file": (["problem.toml", "--out", "problem.toml"], "which is a file"),
    "another's folder": (["problem.toml", "--out", "."], "holds something else"),
}


@pytest.mark.parametrize("name", CANNOT)
def test_what_cannot_be_used_ends_with_2(run, problem, monkeypatch, name):
    arguments, message = CANNOT[name]
    monkeypatch.chdir(problem.parent)
    problem.with_name("bad.toml").write_text("x = = 1")
    problem.with_name("key.toml").write_text("[robt]")
    code, _, errors = run("optimise", *arguments)
    assert code == 2
    assert message in errors
    assert errors.count("\n") == 1
