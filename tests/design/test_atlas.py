import itertools

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.design import atlas
from jaxkin.mapping import batch
from jaxkin.mechanisms import rpr3_closed_forms as closed_forms

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
HIGH = 8.0
SECTION = jk.Grid(rho1=(0.0, HIGH, 40), rho2=1.0, rho3=(0.0, HIGH, 40))
CUSPS = atlas.number_of_cusps(SECTION)


def closed_count(c2, c3, d3):
    """Cusps of the section by the closed form, those within the ends of its axes."""
    joints = np.asarray(closed_forms.section_cusps(jk.mechanisms.rpr3.analytic(c2, c3, d3), 1, 1.0).joints)
    return int(np.sum(np.all(joints <= HIGH, axis=1)))


@pytest.mark.parametrize(("design", "number"), [((1.0, 0.0, 1.0), 2), ((1.0, 2.0, -1.25), 0), ((1.5, -0.7, 0.4), 1)])
def test_known_numbers_of_cusps(design, number):
    c2, c3, d3 = design
    result = jk.sweep(ROBOT, CUSPS, jk.Grid(c2=c2, c3=c3, d3=(d3, d3 + 1e-3, 2)))
    assert result.number_of_cusps.values.tolist() == [number, number]
    assert closed_count(*design) == number


def test_the_atlas_of_cusps_is_that_of_the_closed_form():
    result = jk.sweep(ROBOT, CUSPS, jk.Grid(c3=(-1.6, 1.9, 6), d3=(0.0, 1.3, 4)))
    counts = [
        -1 if d3 == 0 else closed_count(1.0, c3, d3) for c3, d3 in itertools.product(result.c3.values, result.d3.values)
    ]
    assert result.number_of_cusps.values.ravel().tolist() == counts
    assert len(set(counts)) >= 4
    assert result.number_of_cusps.dtype == np.int8
    assert not result.number_of_cusps_doubtful.any()
    assert result.attrs["refused_designs"] == 6
    assert result.attrs["first_refusal"].startswith("c3 = -1.6, d3 = 0: ")
    pytest.importorskip("matplotlib").use("Agg")
    ax = jk.plot.section(result)
    assert ax.get_title() == r"section $\rho_{2}$ = 1"
    assert ax.get_xlabel() == "$c_{3}$ (length)"
    assert ax.get_legend().get_title().get_text() == "number of cusps"
    assert len({tuple(patch.get_facecolor()) for patch in ax.get_legend().get_patches()}) == len(set(counts))


def test_no_kernel_is_made_anew_for_a_design():
    jk.sweep(ROBOT, CUSPS, jk.Grid(c3=(0.0, 0.1, 2)))
    before = batch._block._cache_size()
    jk.sweep(ROBOT, CUSPS, jk.Grid(c3=(0.2, 0.3, 2)))
    assert batch._block._cache_size() == before


def test_designs_that_do_not_reach_the_section_are_refused_not_lost():
    far = atlas.number_of_cusps(jk.Grid(rho1=(0.1, 0.2, 9), rho2=5.0, rho3=(0.1, 0.2, 9)))
    result = jk.sweep(ROBOT, far, jk.Grid(c2=(1.0, 2.0, 2)))
    assert result.number_of_cusps.values.tolist() == [-1, -1]
    assert result.attrs["refused_designs"] == 2
    assert "no pose reaches the section" in result.attrs["first_refusal"]


def test_stores_of_different_sections_are_not_mixed(tmp_path):
    grid = jk.Grid(c3=(0.0, 0.1, 2))
    first = jk.sweep(ROBOT, CUSPS, grid, store=tmp_path / "atlas.zarr")
    again = jk.sweep(ROBOT, atlas.number_of_cusps(SECTION), grid, store=tmp_path / "atlas.zarr")
    assert again.attrs["run_log"] == first.attrs["run_log"]
    other = atlas.number_of_cusps(jk.Grid(rho1=(0.0, HIGH, 40), rho2=2.0, rho3=(0.0, HIGH, 40)))
    with pytest.raises(jk.StoreError, match=r"field\.version is .*rho2=1\.0.*there and .*rho2=2\.0.* here"):
        jk.sweep(ROBOT, other, grid, store=tmp_path / "atlas.zarr")


def test_bad_sections_are_told_before_anything_is_computed():
    grid = jk.Grid(c3=(0.0, 1.0, 2))
    with pytest.raises(jk.InputError, match=r"jaxkin\.Grid with two free joint axes"):
        atlas.number_of_cusps("rho2=1")
    with pytest.raises(jk.InputError, match="lacks the joint axis 'rho3'"):
        jk.sweep(ROBOT, atlas.number_of_cusps(jk.Grid(rho1=(0.0, 4.0, 9), rho2=1.0)), grid)
    with pytest.raises(jk.InputError, match="needs exactly two"):
        jk.sweep(ROBOT, atlas.number_of_cusps(jk.Grid(rho1=(0.0, 4.0, 9), rho2=1.0, rho3=1.0)), grid)


def test_the_volume_over_geometries_is_that_of_each_design():
    robot = jk.mechanisms.tlpm.create(590.0, 590.0, (-200.0, 200.0))
    start = float(robot.initial_lengths[0])
    grid = jk.Grid(base_radius=(590.0, 640.0, 2), initial_lengths=(start, start + 20.0, 2))
    result = jk.sweep(robot, atlas.workspace_volume(), grid)
    assert result.workspace_volume.attrs["units"] == "mm^3"
    assert float(result.workspace_volume[0, 0]) == pytest.approx(72322565.9305, abs=1e-3)
    for k, n in np.ndindex(2, 2):
        lengths = jnp.full(3, result.initial_lengths.values[n])
        made = robot.replace(base_radius=jnp.asarray(result.base_radius.values[k]), initial_lengths=lengths)
        assert float(result.workspace_volume[k, n]) == pytest.approx(float(jk.workspace_volume(made).volume), rel=1e-12)
    assert float(result.workspace_volume_error.max()) < 1.0


def test_volumes_of_degenerate_designs_are_missing():
    robot = jk.mechanisms.tlpm.create()
    result = jk.sweep(robot, atlas.workspace_volume(), jk.Grid(l1_low=(-200.0, 300.0, 2)))
    assert np.isnan(result.workspace_volume.values).tolist() == [False, True]
    with pytest.raises(jk.InputError, match="no workspace of this kind"):
        jk.sweep(ROBOT, atlas.workspace_volume(), jk.Grid(c3=(0.0, 1.0, 2)))
    with pytest.raises(jk.InputError, match="no branch 'uper'"):
        jk.sweep(robot, atlas.workspace_volume("uper"), jk.Grid(height=(500.0, 600.0, 2)))
