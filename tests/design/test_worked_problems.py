"""Designs whose answers are known."""

import math

import numpy as np
import pytest

import jaxkin as jk
from jaxkin.design import atlas
from jaxkin.mechanisms import rpr3_closed_forms


def tlpm(base_radius):
    return jk.mechanisms.tlpm.create(base_radius, 590.0)


def test_the_tlpm_is_isotropic_at_home_where_the_radius_is_the_height_times_the_root_of_two():
    robot = tlpm(590.0)
    measure = jk.design.inverse_condition_number(robot, jk.design.poses(robot, [0.0, 0.0, 0.0]), norm="frobenius")
    problem = jk.design.Problem(robot, {"base_radius": (300.0, 1500.0)}, maximise=measure, build=tlpm)
    design = jk.design.optimise(problem, starts=4, steps=40, refine=1, neighbours=20)
    assert design.verified
    assert design.values["base_radius"] / 590.0 == pytest.approx(math.sqrt(2), abs=1e-8)
    assert design.objective.value == pytest.approx(1.0, abs=1e-12)
    # The initial lengths follow from the radius.
    np.testing.assert_allclose(design.robot.initial_lengths, math.sqrt(3) * 590.0, rtol=1e-8)


def closed_cusps(robot):
    joints = np.asarray(rpr3_closed_forms.section_cusps(robot, 1, 1.0).joints)
    return joints[np.isfinite(joints[:, 0])][:, [0, 2]]


@pytest.mark.slow
def test_a_cusp_comes_to_a_wanted_place():
    place = closed_cusps(jk.mechanisms.rpr3.analytic(1.0, 1.2, 1.0))[0]
    begin = jk.mechanisms.rpr3.analytic(1.0, 0.2, 0.6)
    section = jk.Grid(rho1=(0.0, 4.0, 60), rho2=1.0, rho3=(0.0, 4.0, 60))
    target = {"rho1": place[0], "rho3": place[1]}
    distance = jk.design.cusp_distance(begin, section, target)
    vary = {"c3": (-0.5, 2.0), "d3": (0.3, 1.8)}
    problem = jk.design.Problem(begin, vary, minimise=distance)
    design = jk.design.optimise(problem, starts=8, steps=60, refine=1, neighbours=20)
    assert design.verified
    assert design.objective.value == pytest.approx(0.0, abs=1e-8)
    assert np.min(np.linalg.norm(closed_cusps(design.robot) - place, axis=1)) < 1e-8


def test_an_objective_is_a_field_over_geometries():
    robot = jk.mechanisms.five_bar.create(1.0, (2.0, 2.0), (3.0, 3.0))
    place = jk.design.box(robot, 3, x=(-0.5, 1.5), y=(2.0, 3.0))
    measure = jk.design.inverse_condition_number(robot, place, mode=(-1, 1))
    middle = np.array([0.6, 2.5])
    field = atlas.smoothed_objective(measure, middle)
    result = jk.sweep(robot, field, jk.Grid(proximal=(1.8, 2.2, 2), distal=(-1.0, 3.0, 2)))
    values = result.inverse_condition_number
    assert values.attrs["units"] == "1"
    for k, proximal in enumerate(result.proximal.values):
        made = jk.mechanisms.five_bar.create(1.0, (proximal, proximal), (3.0, 3.0))
        assert float(values[k, 1]) == pytest.approx(float(measure(made, middle)), rel=1e-12)
    assert atlas.smoothed_objective(measure).version != field.version
    with pytest.raises(jk.InputError, match=r"an objective of jaxkin\.design"):
        atlas.smoothed_objective("conditioning")  # type: ignore[arg-type]
