"""Basic regions and components: known numbers of the planar robots, and what must hold for every configuration."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanism_zoo import TwoSliders

import jaxkin as jk
from jaxkin.mapping.basic_regions import basic_regions
from jaxkin.mapping.regions import regions

SECTION = jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400))
DOUBTS = (
    "curves that no way settles",
    "joint regions without a cell",
    "joint regions with points that no way joins",
    "components that overlap and differ",
    "regions of both signs",
)


@pytest.fixture(scope="module")
def robot():
    return jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)


@pytest.fixture(scope="module")
def found(robot):
    return basic_regions(robot, SECTION)


def modes_over(robot, joints):
    branches = jk.forward(robot, joints)
    return np.asarray(branches.values)[np.asarray(branches.valid)]


def test_the_analytic_section_has_three_two_and_one_regions_an_aspect(found):
    """Wenger and Chablat 2009: regions with 6, 4 and 2 solutions; three, two and one of them in each of two aspects."""
    assert [found.evidence[name] for name in DOUBTS] == [0] * len(DOUBTS)
    assert sorted(found.modes_per_component) == [2, 2, 4, 4, 6]
    assert [aspect.sign for aspect in found.aspects] == [1, -1]
    assert [aspect.pieces for aspect in found.aspects] == [1, 1]
    for component, modes in zip(found.components, found.modes_per_component, strict=True):
        for aspect in (0, 1):
            own = [k for k in component.regions if found[k].aspect == aspect]
            assert len(own) == modes // 2


def test_components_are_the_joint_regions_here(robot, found):
    """Every arc bounds both aspects, as the two modes that merge have opposite signs: no cells are joined."""
    divided = regions(robot, SECTION)
    names = {k for k, region in enumerate(divided) if region.n_solutions > 0}
    assert [len(component.joint_regions) for component in found.components] == [1] * len(found.components)
    assert {component.joint_regions[0] for component in found.components} == names
    for component, modes in zip(found.components, found.modes_per_component, strict=True):
        assert divided[component.joint_regions[0]].n_solutions == modes
        assert int(jk.forward(robot, component.joints).count) == modes
    inner = {k for k, arc in enumerate(divided.arcs) if arc.curve >= 0}
    assert all(set(aspect.boundary) == inner for aspect in found.aspects)


def test_a_region_holds_its_interior_and_knows_its_neighbours(robot, found):
    for number, region in enumerate(found):
        assert found.region_of(region.interior, region.joints) == number
        assert np.max(np.abs(jk.inverse(robot, region.interior).values[0] - region.joints)) < 1e-12
        det = float(jk.conditioning(robot, region.interior, region.joints).determinant)
        assert np.sign(det) == region.sign == found.aspects[region.aspect].sign
        assert region.sheets == 1
        for other, arc in region.neighbours:
            assert (number, arc) in found[other].neighbours
            assert found[other].aspect == region.aspect
            assert found[other].component != region.component


def test_every_mode_over_random_joints_is_in_a_region_of_its_own(robot, found):
    divided = regions(robot, SECTION)
    rng, seen = np.random.default_rng(5), 0
    for _ in range(40):
        joints = np.array([rng.uniform(0, 2.6), 1.0, rng.uniform(0, 2.6)])
        poses = modes_over(robot, joints)
        numbers = [found.region_of(pose, joints) for pose in poses]
        assert -1 not in numbers
        assert len(set(numbers)) == len(numbers)
        place = divided.region_of(joints)
        assert all(place in found.components[found[k].component].joint_regions for k in numbers)
        seen += len(numbers)
    assert seen > 60


def test_a_pose_off_the_section_or_open_is_in_none(found):
    assert found.region_of([5.0, 5.0, 0.0], [0.5, 1.0, 0.5]) == -1


def test_curves_between_regions_are_characteristic(robot, found):
    """Regular poses, over the joints of a singular pose, between two regions that are neighbours across that arc."""
    assert len(found.curves) > 10
    factors = jax.jit(jax.vmap(lambda x: robot.factors(x)))
    for curve in found.curves[::5]:
        a, b = curve.regions
        assert (b, curve.arc) in found[a].neighbours
        middle = len(curve.poses) // 2
        joints = curve.joints[middle]
        assert np.max(np.abs(jk.inverse(robot, curve.poses[middle]).values[0] - joints)) < 1e-11
        values = factors(modes_over(robot, joints))
        assert min(float(np.min(np.abs(v))) for v in values.values()) < 2e-7


def test_aspects_that_are_given_decide(robot, found):
    class BySign:
        """Aspects told apart by the sign of f1 f2, which is continuous over the seam of phi."""

        def aspect_of(self, pose, joints=None):
            factors = robot.factors(np.asarray(pose))
            return 3 if float(factors["f1"] * factors["f2"]) > 0 else 7

    same = basic_regions(robot, SECTION, aspects=BySign())
    assert {aspect.name for aspect in same.aspects} == {"aspect 3", "aspect 7"}
    assert len(same) == len(found)
    assert sorted(same.modes_per_component) == sorted(found.modes_per_component)


def test_results_print_and_serialise(found):
    assert "18 basic regions of 2 aspects over 5 components" in str(found)
    assert found[found[0].name] is found[0]
    assert '"components"' in found.to_json()


def test_what_is_no_section_or_no_aspects_is_refused(robot):
    with pytest.raises(jk.InputError, match=r"jk\.basic_regions: aspects is a list"):
        basic_regions(robot, SECTION, aspects=[])
    box = jk.Grid(rho1=(0.0, 4.0, 40), rho2=(0.0, 4.0, 40), rho3=(0.0, 4.0, 40))
    with pytest.raises(jk.InputError, match=r"jk\.basic_regions: the section has 3 free joint axes"):
        basic_regions(robot, box)


def test_a_tlpm_has_one_region_an_aspect():
    robot = jk.mechanisms.tlpm.create()
    found = basic_regions(robot, jk.Grid(l1=(-700.0, 300.0, 200), l2=-100.0, l3=(-700.0, 300.0, 200)))
    assert len(found) == len(found.aspects) == 2
    assert found.modes_per_component.tolist() == [2]


@pytest.mark.slow
def test_the_reference_robot_has_as_many_regions_as_modes():
    """Over every joint region with 2k solutions k basic regions an aspect: Zein, Wenger and Chablat 2007's section."""
    robot = jk.mechanisms.rpr3.reference()
    section = jk.Grid(rho1=14.98, rho2=(0.0, 40.0, 400), rho3=(0.0, 40.0, 400))
    found, divided = basic_regions(robot, section), regions(robot, section)
    assert [found.evidence[name] for name in DOUBTS] == [0] * len(DOUBTS)
    solved = [region.n_solutions for region in divided if region.n_solutions > 0]
    assert sorted(found.modes_per_component) == sorted(solved)
    assert len(found) == sum(solved)
    for component in found.components:
        signs = [found[k].sign for k in component.regions]
        assert sum(signs) == 0


@pytest.mark.slow
def test_a_five_bar_has_ten_aspects_of_one_region_each():
    """Ten aspects, counted on a grid in pose space too; each lies over its image one to one."""
    robot = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    turn = (-math.pi, math.pi, 200)
    found = basic_regions(robot, jk.Grid(theta1=turn, theta2=turn))
    assert len(found) == len(found.aspects) == 10
    assert [region.sheets for region in found] == [1] * 10
    labels = sorted((a.sign, a.working_mode) for a in found.aspects)
    assert labels == sorted(pieces_on_a_grid())
    rng = np.random.default_rng(2)
    for _ in range(25):
        joints = rng.uniform(-math.pi, math.pi, 2)
        numbers = [found.region_of(pose, joints) for pose in modes_over(robot, joints)]
        assert len(set(numbers)) == len(numbers)


def pieces_on_a_grid(n=1200):
    """Sign of det A and working mode of every connected piece of the five-bar's poses, by labelling pixels."""
    from scipy import ndimage

    x, y = np.meshgrid(np.linspace(-13.5, 22.5, n), np.linspace(-13.5, 13.5, n), indexing="ij")
    found = []
    for turns in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        elbows, reached, signs = [], np.ones(x.shape, bool), []
        for turn, pivot in zip(turns, (0.0, 9.0), strict=True):
            dx = x - pivot
            away = np.hypot(dx, y)
            cosine = (8.0**2 + away**2 - 5.0**2) / (2 * 8.0 * away)
            reached &= np.abs(cosine) < 1
            angle = np.arctan2(y, dx) + turn * np.arccos(np.clip(cosine, -1, 1))
            elbows.append((pivot + 8 * np.cos(angle), 8 * np.sin(angle)))
            # dF/dtheta = 2 l1 (dx sin(theta) - y cos(theta)), of the sign of theta less the direction of the pose.
            signs.append(turn)
        (ax, ay), (bx, by) = elbows
        det = (x - ax) * (y - by) - (x - bx) * (y - ay)
        for sign in (1, -1):
            labels, _ = ndimage.label(reached & (sign * det > 0))
            sizes = np.bincount(labels.ravel())[1:]
            found += [(sign, tuple(signs))] * int(np.sum(sizes > 200))
    return found


@pytest.mark.slow
def test_two_sliders_have_eight_aspects():
    """Rods 2 and 1.5 reach each other for 0.5 < |u1 - u2| < 3.5; the second stands upright where |u1 - u2|^2 = 1.75.

    The pose above the carriages and the one below have the same joints: both curves of upright rods have one image.
    """
    robot = TwoSliders(first=jnp.asarray(2.0), second=jnp.asarray(1.5))
    found = basic_regions(robot, jk.Grid(u1=(-5.0, 5.0, 100), u2=(-5.0, 5.0, 100)))
    assert [found.evidence[name] for name in DOUBTS] == [0] * len(DOUBTS)
    assert len(found) == len(found.aspects) == 8
    upright = math.sqrt(1.75)
    for region in found:
        apart = np.abs(region.over[:, 0] - region.over[:, 1])
        assert np.all((apart > 0.5) & (apart < 3.5))
        assert np.all(apart < upright + 1e-3) or np.all(apart > upright - 1e-3)
    for aspect in found.aspects:
        assert len(aspect.boundary) == 2


@pytest.mark.slow
def test_a_3_ppps_has_one_region_for_each_pair_of_signs():
    robot = jk.mechanisms.ppps3.create()
    axes = {"rho1y": 0.1, "rho1z": -0.05, "rho2y": 0.5, "rho3y": -0.45}
    found = basic_regions(robot, jk.Grid(**axes, rho2z=(-1.2, 1.2, 200), rho3z=(-1.2, 1.2, 200)))
    assert sorted(aspect.name for aspect in found.aspects) == [
        "R22 < 0, R33 < 0",
        "R22 < 0, R33 > 0",
        "R22 > 0, R33 < 0",
        "R22 > 0, R33 > 0",
    ]
    assert len(found) == 4
    assert found.modes_per_component.tolist() == [4]
