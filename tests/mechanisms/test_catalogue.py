"""The mechanisms by id."""

import pytest

import jaxkin as jk
from jaxkin.mechanisms import catalogue


@pytest.mark.parametrize("name", catalogue.CATALOGUE)
def test_every_entry_makes_its_mechanism(name):
    robot = catalogue.create(name)
    entry = catalogue.CATALOGUE[name]
    assert robot.id == name
    assert entry.title
    assert entry.source
    for key, value in entry.geometry.items():
        assert getattr(robot, key).tolist() == (list(value) if isinstance(value, tuple) else value)


def test_changes_are_applied():
    assert float(catalogue.create("rpr3-analytic", c3=0.25).c3) == 0.25
    assert catalogue.create("five-bar", proximal=(1.0, 2.0), distal=(3.0, 4.0), base=1.0).distal.tolist() == [3.0, 4.0]


def test_unknown_names_are_named():
    with pytest.raises(jk.InputError, match=r"did you mean 'rpr3-analytic'"):
        catalogue.create("rpr3-analytc")
    with pytest.raises(jk.InputError, match=r"'quux'.*rpr3"):
        catalogue.create("quux")
    with pytest.raises(jk.InputError, match=r"no geometry 'c4'.*c2, c3, d3"):
        catalogue.create("rpr3-analytic", c4=1.0)
    with pytest.raises(jk.InputError, match=r"'c3'.*is one number"):
        catalogue.create("rpr3-analytic", c3=(1.0, 2.0))
    with pytest.raises(jk.GeometryError, match="c2=0"):
        catalogue.create("rpr3-analytic", c2=0.0)
