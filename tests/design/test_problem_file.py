import dataclasses
import inspect
import math
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

import jaxkin as jk
from jaxkin.design import problem_file, read_problem
from jaxkin.design.optimise import Options

HOME = """
name = "isotropy at home"
[robot]
mechanism = "tlpm"
geometry = { base_radius = 590.0, height = 590.0 }
limits = { l1 = [-100.0, 150.0] }
[vary]
base_radius = { low = 300.0, high = 900.0, scale = "log", start = 500.0 }
a = [20.0, 30.0]
[places.home]
poses = [[0.0, 0.0, 0.0]]
[maximise]
objective = "inverse_condition_number"
place = "home"
norm = "frobenius"
[[require]]
objective = "limit_margin"
place = "home"
names = ["l1_low", "l1_high"]
at_least = 5.0
at_most = 500.0
[optimiser]
starts = 8
"""
BAR = """
[robot]
mechanism = "five-bar"
[vary]
"proximal[0]" = [2.0, 9.0]
rods = { low = 4.0, high = 6.0, sets = ["distal[0]", "distal[1]"] }
"center.x" = [3.0, 6.0]
[places.box]
box = { x = [4.0, 5.0], y = 6.0, n = 3 }
[places.disc]
ball = { center = { x = 4.5, y = 6.0 }, radius = 0.5, n = { x = 3, y = 4 } }
[maximise]
objective = "smallest_singular_value"
place = "box"
mode = [1, 1]
[[require]]
objective = "smallest_singular_value"
place = "disc"
mode = [1, 1]
at_least = 0.05
"""
CUSPS = """
[robot]
mechanism = "rpr3-analytic"
[vary]
c3 = [-0.5, 0.5]
[minimise]
objective = "cusp_distance"
section = { rho1 = [0.0, 4.0, 40], rho2 = 1.0, rho3 = [0.0, 4.0, 40] }
target = { rho1 = 1.5, rho3 = 1.3 }
starts = 16
"""
REACH = """
[robot]
mechanism = "tlpm"
[vary]
height = [500.0, 600.0]
[places.all]
reach = { n = 3, lane = 0 }
[maximise]
objective = "global_conditioning"
place = "all"
"""


@pytest.fixture
def read(tmp_path):
    def call(text):
        path = tmp_path / "problem.toml"
        path.write_text(text, encoding="utf-8")
        return read_problem(path)

    return call


def test_numbers_that_follow_from_others_follow(read):
    asked, options = read(HOME)
    assert options == {"starts": 8}
    assert asked.name == "isotropy at home"
    assert asked.names == ("base_radius", "a")
    assert [str(one) for one in asked.subject_to] == ["limit margin >= 5 mm", "limit margin <= 500 mm"]
    assert asked.subject_to[0].objective is asked.subject_to[1].objective
    values = {"base_radius": 590.0 * math.sqrt(2), "a": 22.0}
    robot, center = asked.made(values)
    assert center is None
    expected = jk.mechanisms.tlpm.create(values["base_radius"], 590.0, a=22.0).with_limits(l1=(-100.0, 150.0))
    assert robot.geometry() == expected.geometry()
    assert float(asked.objective(robot)) == pytest.approx(1.0, abs=1e-14)
    slope = jax.grad(lambda z: asked.design(z)[0].initial_lengths[0])(jnp.asarray(asked.unit(values)))
    assert slope[0] > 0
    assert slope[1] == 0
    assert asked.values(jnp.asarray(asked.start()))["base_radius"] == pytest.approx(500.0)
    assert asked.unit_of("base_radius") == "mm"


def test_the_same_file_is_the_same_request_and_other_geometry_another(read):
    first = read(HOME)[0].request().text
    assert read(HOME)[0].request().text == first
    assert read(HOME.replace("[-100.0, 150.0]", "[-100.0, 160.0]"))[0].request().text != first
    assert read(HOME.replace("height = 590.0 }", "height = 590.0, b = 151.0 }"))[0].request().text != first


def test_numbers_by_name_and_places_that_move(read):
    asked, options = read(BAR)
    assert options == {}
    assert asked.build is None
    robot, center = asked.made({"proximal[0]": 7.0, "rods": 5.5, "center.x": 5.0})
    assert robot.proximal.tolist() == [7.0, 8.0]
    assert robot.distal.tolist() == [5.5, 5.5]
    assert center.tolist() == [5.0, 6.0]
    assert str(asked.objective.place) == "x = 4 .. 5, y = 6"
    assert str(asked.subject_to[0].objective.place) == "ball of radius 0.5 in x, y"
    assert asked.subject_to[0].objective.place.numbers == (3, 4)


def test_sections_and_reaches(read):
    asked, _ = read(CUSPS)
    assert asked.sign == -1
    assert asked.objective.content["target"] == {"rho1": 1.5, "rho3": 1.3}
    assert asked.objective.content["starts"] == 16
    reach, _ = read(REACH)
    assert reach.objective.place.kind == "reach"
    assert reach.objective.place.numbers == (3, 3, 3)


def swap(text, old, new):
    assert old in text
    return text.replace(old, new)


BAD = {
    "syntax": (swap(HOME, 'mechanism = "tlpm"', "mechanism tlpm"), r"is no TOML: .*at line 4, column"),
    "top": (swap(HOME, "[optimiser]", "[optimizer]"), "no key 'optimizer': choose among name, .*mean 'optimiser'"),
    "name": (swap(HOME, 'name = "isotropy at home"', "name = 3"), "name is 3: it must be text"),
    "no robot": ('[vary]\nc3 = [0, 1]\n[maximise]\nobjective = "clearance"', r"\[robot\] is missing"),
    "robot": ("robot = 3", r"robot is 3: it must be a table; write \[robot\]"),
    "robot's key": (swap(HOME, "mechanism =", "mechanisn ="), r"\[robot\] has no key 'mechanisn'.*'mechanism'"),
    "mechanism": (swap(HOME, '"tlpm"', '"tlmp"'), "names the mechanism 'tlmp': .*did you mean 'tlpm'"),
    "geometry": (swap(HOME, "{ base_radius", "{ base_radus"), "no key 'base_radus': .*did you mean 'base_radius'"),
    "size": (swap(HOME, "{ base_radius = 590.0", "{ base_radius = -590.0"), r"\[robot\]: base_radius is -590"),
    "size as text": (swap(HOME, "height = 590.0", 'height = "x"'), r"\[robot\]: height"),
    "limit": (swap(HOME, "{ l1 = [", "{ l4 = ["), "limits of .* no key 'l4': choose among l1, l2, l3"),
    "limits' order": (swap(HOME, "[-100.0, 150.0]", "[150.0, -100.0]"), "l1"),
    "vary": (swap(HOME, "a = [20.0", "aa = [20.0"), "no number 'aa'"),
    "vary's order": (swap(HOME, "[20.0, 30.0]", "[30.0, 20.0]"), "a varies from 30 to 20"),
    "vary's key": (swap(HOME, 'scale = "log"', 'skale = "log"'), r"\[vary\] base_radius has no key 'skale'.*'scale'"),
    "vary's end": (swap(HOME, "low = 300.0, ", ""), r"\[vary\] base_radius has no 'low'"),
    "log": (swap(HOME, "low = 300.0", "low = 0.0"), "on a log scale: both bounds must be positive"),
    "place's key": (swap(HOME, "poses =", "pose ="), r"\[places\.home\] has no key 'pose'.*mean 'poses'"),
    "two places": (swap(REACH, "[maximise]", "poses = [[0, 0, 0]]\n[maximise]"), "has 2 of poses, .* exactly one"),
    "poses' shape": (swap(HOME, "[[0.0, 0.0, 0.0]]", "[[0.0, 0.0]]"), r"\[places\.home\]: .* shape \(k, 3\)"),
    "place is a list": (
        swap(BAR, "[places.box]\n", "[places]\nbox = [1]\n[places.b]\n"),
        r"\[places\.box\] is \[1\]: .* a table",
    ),
    "box's axis": (swap(BAR, "x = [4.0, 5.0]", "z = [4.0, 5.0]"), "box has no key 'z': choose among x, y, n"),
    "box's order": (swap(BAR, "x = [4.0, 5.0]", "x = [5.0, 4.0]"), "x goes from 5 to 4: low must be less"),
    "ball": (swap(BAR, "radius = 0.5, ", ""), "ball has no 'radius'"),
    "radius": (swap(BAR, "radius = 0.5", "radius = -1"), "the radius is -1: it must be a positive number"),
    "reach": (swap(REACH, "lane = 0", "line = 0"), "reach has no key 'line': choose among n, lane"),
    "reach's lane": (swap(REACH, "lane = 0", "lane = 9"), "lane is 9"),
    "both": (HOME + '[minimise]\nobjective = "clearance"\n', r"both \[maximise\] and \[minimise\]"),
    "neither": (swap(HOME, "[maximise]", "[places.more]"), r"neither \[maximise\] nor \[minimise\]"),
    "objective": (swap(HOME, '"limit_margin"', '"limit_margins"'), "number 1 names the objective 'limit_margins'"),
    "no objective": (swap(HOME, 'objective = "limit_margin"\n', ""), "names the objective None: choose among"),
    "keyword": (swap(HOME, "norm =", "nrom ="), r"\[maximise\] has no key 'nrom': .*did you mean 'norm'"),
    "norm": (swap(HOME, '"frobenius"', '"euclid"'), r"\[maximise\]: .*norm is 'euclid'"),
    "place": (swap(HOME, 'place = "home"\nnorm', 'place = "hom"\nnorm'), "names the place 'hom': .*mean 'home'"),
    "no place": (swap(HOME, 'place = "home"\nnorm', "norm"), "inverse_condition_number needs place"),
    "kind": (swap(HOME, 'norm = "frobenius"', 'length = "x"'), r"\[maximise\]: inverse_condition_number got .*kind"),
    "no bound": (swap(BAR, "at_least = 0.05", ""), r"\[\[require\]\] number 1 has no bound: give at_least or at_most"),
    "bound": (swap(BAR, "at_least = 0.05", 'at_least = "x"'), "bound of smallest singular value is 'x'"),
    "bound's key": (swap(BAR, "at_least", "atleast"), "number 1 has no bound"),
    "contradiction": (swap(HOME, "at_most = 500.0", "at_most = 4.0"), "contradict each other"),
    "brackets": (swap(BAR, "[[require]]", "[require]"), r"write \[\[require\]\], with two brackets"),
    "options": (swap(HOME, "starts = 8", "start = 8"), r"\[optimiser\] has no key 'start': .*did you mean 'starts'"),
    "option": (swap(HOME, "starts = 8", "starts = 0"), "starts is 0"),
    "checkpoint": (swap(HOME, "starts = 8", 'checkpoint = "x"'), "no key 'checkpoint'"),
    "section": (swap(CUSPS, "rho2 = 1.0", "rho4 = 1.0"), r"\[minimise\]: .*rho"),
    "section's kind": (swap(CUSPS, "section = {", "section = 3 #"), "section is 3: it must be a table"),
    "target": (swap(CUSPS, "target = { rho1 = 1.5, rho3 = 1.3 }", ""), "cusp_distance needs target"),
    "center": (swap(REACH, "height =", '"center.x" ='), r"center\.x varies, but no prescribed place"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files(read, name):
    text, message = BAD[name]
    with pytest.raises((jk.InputError, jk.GeometryError), match=message) as caught:
        read(text)
    assert re.search(r"problem\.toml(: | is no TOML: )", str(caught.value))
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(jk.InputError, match="cannot be read"):
        read_problem(tmp_path / "none.toml")
    with pytest.raises(jk.InputError, match="cannot be read"):
        read_problem(tmp_path)
    (tmp_path / "other.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(jk.InputError, match="no text in UTF-8"):
        read_problem(tmp_path / "other.toml")


def test_the_page_shows_a_problem_and_names_every_objective(read):
    page = (Path(__file__).parents[2] / "docs" / "problem_files.md").read_text(encoding="utf-8")
    shown = page.split("<!-- problem -->\n```toml\n")[1].split("```")[0]
    asked, options = read(shown)
    assert asked.names == ("base_radius",)
    assert options == {"starts": 4}
    for name, function in problem_file._OBJECTIVES.items():
        (line,) = [line for line in page.splitlines() if line.startswith("|") and f"`{name}`" in line.split("|")[1]]
        arguments = list(inspect.signature(function).parameters)[1:]
        assert set(re.findall(r"`(\w+)`", "|".join(line.split("|")[2:]))) == set(arguments)
    assert all(f"`{key}`" in page for key in (*problem_file._PLACES, *problem_file._BOUNDS))
    assert all(f"`{field.name}`" in page for field in dataclasses.fields(Options))
