import jax.numpy as jnp
import numpy as np
import pytest
from small_problems import BOWL, SUM, cart

import jaxkin as jk
from jaxkin.design import Parameter, Problem

BAR = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
NEAR = jk.design.box(BAR, 2, x=(4.0, 5.0), y=(5.0, 6.0))
FAR = jk.design.box(BAR, 2, x=(4.0, 5.0), y=(6.0, 7.0))


def over(place):
    return jk.design.smallest_singular_value(BAR, place, mode=(1, 1))


BAD = {
    "no such number": ({"vary": {"c": (0, 1)}}, r"no number 'c': choose among a, b"),
    "no such number set": ({"vary": {"c": Parameter(0, 1, sets=("a", "c"))}}, "no number 'c'"),
    "low is high": ({"vary": {"a": (1, 1)}}, r"a varies from 1 to 1: both must be finite and low less than high"),
    "low over high": ({"vary": {"a": (2, 1)}}, "a varies from 2 to 1"),
    "infinite": ({"vary": {"a": (0, np.inf)}}, "a varies from 0 to inf"),
    "one number": ({"vary": {"a": 1.0}}, r"a varies in 1\.0: give \(low, high\)"),
    "text": ({"vary": {"a": ("0", "1")}}, "a varies in"),
    "text as a bound": ({"vary": {"a": Parameter("0", 1)}}, "a has low = '0': it must be a number"),
    "scale": ({"vary": {"a": Parameter(1, 2, scale="sqrt")}}, "a has the scale 'sqrt'"),
    "log from zero": ({"vary": {"a": Parameter(0, 2, scale="log")}}, "a varies from 0 on a log scale"),
    "start outside": ({"vary": {"a": Parameter(0, 2, start=3.0)}}, "a starts at 3, outside 0 to 2"),
    "start as text": ({"vary": {"a": Parameter(0, 2, start="1")}}, "a has start = '1'"),
    "set twice": ({"vary": {"a": (0, 1), "both": Parameter(0, 1, sets=("a", "b"))}}, "a and both both set a"),
    "nothing varies": ({"vary": {}}, "nothing varies"),
    "no objective": ({"minimise": None}, "needs one objective"),
    "two objectives": ({"maximise": SUM}, "needs one objective"),
    "no such objective": ({"minimise": "bowl"}, "needs one objective"),
    "no requirement": ({"subject_to": [SUM]}, r"write objective\.at_least\(value\)"),
    "contradiction": ({"subject_to": [SUM.at_least(2), SUM.at_most(1)]}, "sum >= 2 and sum <= 1 contradict each other"),
    "center": ({"vary": {"center.x": (0, 1)}}, r"center\.x varies, but no prescribed place"),
    "center axis": ({"vary": {"center.z": (0, 1)}}, "no pose axis 'z': choose among x"),
    "build lacks": (
        {"vary": {"a": (0, 1)}, "build": lambda a, c: cart(a)},
        "build cannot make .* of a: .*'c'",
    ),
    "build makes": ({"vary": {"a": (0, 1)}, "build": lambda a: a}, "build makes a ShapeDtypeStruct"),
    "sets and build": (
        {"vary": {"a": Parameter(0, 1, sets=("b",))}, "build": lambda a: cart(a)},
        "a sets b, but it is an argument of build: leave sets out",
    ),
    "batch": ({"robot": jk.mechanisms.rpr3.analytic(jnp.ones(3), 0.0, 1.0)}, "a batch of robots: pass one robot"),
    "no robot": ({"robot": 3}, "jk.design.Problem"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_problems(name):
    change, message = BAD[name]
    with pytest.raises((jk.InputError, jk.GeometryError), match=message):
        Problem(**{"robot": cart(), "vary": {"a": (0.0, 1.0)}, "minimise": BOWL, **change})


def test_bounds_of_an_objective():
    for bad in ("x", None, np.nan, np.inf):
        with pytest.raises(jk.InputError, match="The bound of sum is"):
            SUM.at_least(bad)
    Problem(cart(), {"a": (0.0, 1.0)}, minimise=BOWL, subject_to=[SUM.at_least(1.0), SUM.at_most(1.0)])


def test_entries_and_whole_vectors_are_one_number():
    with pytest.raises(jk.InputError, match=r"proximal and proximal\[1\] both set proximal\[1\]"):
        Problem(BAR, {"proximal": (6.0, 9.0), "proximal[1]": (6.0, 9.0)}, maximise=over(NEAR))


def test_places_that_move_together_have_one_middle():
    vary = {"center.x": (3.0, 6.0)}
    with pytest.raises(jk.InputError, match=r"middles at y = 5\.5 and 6\.5.*vary center\.y too"):
        Problem(BAR, vary, maximise=over(NEAR), subject_to=[over(FAR).at_least(0.1)])
    both = {**vary, "center.y": (5.0, 7.0)}
    Problem(BAR, both, maximise=over(NEAR), subject_to=[over(FAR).at_least(0.1)])
    one = Problem(BAR, vary, maximise=over(NEAR))
    robot, center = one.design(jnp.array([0.5]))
    assert robot.base == BAR.base
    assert np.asarray(center).tolist() == [4.5, 5.5]
    assert one.unit_of("center.x") == "length"


def test_points_of_the_cube_are_values_and_back():
    vary = {"a": Parameter(0.01, 100.0, scale="log"), "both": Parameter(-1.0, 3.0, start=1.0, sets=("b",))}
    one = Problem(cart(), vary, minimise=BOWL)
    values = {name: float(value) for name, value in one.values(jnp.array([0.5, 0.25])).items()}
    assert values == pytest.approx({"a": 1.0, "both": 0.0})
    assert one.unit(values) == pytest.approx([0.5, 0.25])
    assert one.start() == pytest.approx(one.unit({"a": 0.7, "both": 1.0}))
    robot, center = one.made({"a": 2.0, "both": 3.0})
    assert (float(robot.a), float(robot.b), center) == (2.0, 3.0, None)
    assert one.names == ("a", "both")
    assert "minimise bowl" in str(one)


def test_a_start_outside_the_bounds_is_the_middle():
    one = Problem(cart(a=0.7), {"a": Parameter(1.0, 4.0, scale="log"), "b": (5.0, 7.0)}, minimise=BOWL)
    assert one.start() == pytest.approx([0.5, 0.5])


def test_requests_differ_where_numbers_would():
    def text(**change):
        return Problem(**{"robot": cart(), "vary": {"a": (0.0, 1.0)}, "minimise": BOWL, **change}).request().text

    same = text()
    assert text() == same
    changes = [
        {"robot": cart(b=1.0)},
        {"vary": {"a": (0.0, 2.0)}},
        {"vary": {"a": Parameter(0.0, 1.0, start=0.1)}},
        {"minimise": SUM},
        {"minimise": None, "maximise": BOWL},
        {"subject_to": [SUM.at_least(0.0)]},
        {"build": lambda a: cart(a)},
    ]
    assert len({same, *(text(**change) for change in changes)}) == len(changes) + 1
