"""Uniqueness domains: one pose over every joint value, connected, maximal, all enumerated."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.mapping._uniqueness import maximal_unions
from jaxkin.mapping.basic_regions import basic_regions


@pytest.fixture(scope="module")
def robot():
    return jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)


@pytest.fixture(scope="module")
def found(robot):
    return basic_regions(robot, jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400)))


def connected(nodes, neighbours):
    reached, waiting = set(), [next(iter(nodes))]
    while waiting:
        node = waiting.pop()
        reached.add(node)
        waiting += [n for n in neighbours[node] if n in nodes and n not in reached]
    return reached == set(nodes)


def test_forward_kinematics_is_injective_on_every_domain(robot, found):
    """At most one mode over a joint value lies in a uniqueness domain, and each mode lies in one domain at least."""
    domains, rng, seen = found.uniqueness_domains(), np.random.default_rng(11), 0
    for _ in range(50):
        joints = np.array([rng.uniform(0.2, 2.4), 1.0, rng.uniform(0.2, 2.4)])
        branches = jk.forward(robot, joints)
        poses = np.asarray(branches.values)[np.asarray(branches.valid)]
        numbers = [found.region_of(pose, joints) for pose in poses]
        for domain in domains:
            assert sum(number in domain.regions for number in numbers) <= 1
        for number in numbers:
            assert any(number in domain.regions for domain in domains)
            seen += 1
    assert seen > 80


def test_domains_are_connected_maximal_and_of_one_aspect(found):
    domains = found.uniqueness_domains()
    assert domains.complete
    assert "10 uniqueness domains" in str(domains)
    neighbours = [{k for k, _ in region.neighbours} for region in found]
    for domain in domains:
        inside = set(domain.regions)
        assert connected(inside, neighbours)
        assert {found[k].aspect for k in inside} == {domain.aspect}
        cells = [cell for k in inside for cell in found.components[found[k].component].cells]
        assert len(set(cells)) == len(cells)
        assert sorted(domain.components) == sorted(found[k].component for k in inside)
        for other in set.union(*(neighbours[k] for k in inside)) - inside:
            assert set(found.components[found[other].component].cells) & set(cells)
    assert len({domain.regions for domain in domains}) == len(domains)


def test_domains_are_not_unique(found):
    """A basic region may be joined with this or that region over one component."""
    domains = found.uniqueness_domains()
    assert any(set(a.regions) & set(b.regions) for a, b in itertools.combinations(domains, 2))


def test_both_aspects_have_domains_of_the_same_make(found):
    """The analytic family's poses p and -p have one set of joints and opposite signs."""
    made = [sorted(tuple(sorted(d.components)) for d in found.uniqueness_domains() if d.aspect == k) for k in (0, 1)]
    assert made[0] == made[1]


def test_the_curves_of_a_domain_lie_between_its_regions(robot, found):
    """Regular poses whose joints, moved to either side, lead into one of the two regions."""
    for domain in found.uniqueness_domains()[::3]:
        assert len(domain.curves) >= len(domain) - 1
        own = [curve for curve in found.curves if set(curve.regions) <= set(domain.regions)]
        for curve in own[::3]:
            k = len(curve.poses) // 2
            joints, pose = curve.joints[k], curve.poses[k]
            tangent = curve.joints[k + 1] - curve.joints[k - 1]
            across = np.array([-tangent[2], 0.0, tangent[0]]) / np.hypot(tangent[0], tangent[2])
            sides = set()
            for sign in (1.0, -1.0):
                there = joints + sign * 2e-3 * across
                modes = np.asarray(jk.forward(robot, there).values)
                gaps = np.abs(modes - pose)
                gaps[:, 2] = np.minimum(gaps[:, 2], 2 * np.pi - gaps[:, 2])
                nearest = modes[np.nanargmin(np.max(gaps, axis=1))]
                sides.add(found.region_of(nearest, there))
            assert sides == set(curve.regions)


def test_a_cap_still_gives_maximal_domains(found):
    some = found.uniqueness_domains(most=1)
    assert not some.complete
    every = {domain.regions for domain in found.uniqueness_domains()}
    assert {domain.regions for domain in some} <= every
    assert {k for domain in some for k in domain.regions} == set(range(len(found)))


def test_the_aspects_of_a_tlpm_are_uniqueness_domains():
    robot = jk.mechanisms.tlpm.create()
    found = basic_regions(robot, jk.Grid(l1=(-700.0, 300.0, 200), l2=-100.0, l3=(-700.0, 300.0, 200)))
    assert [domain.regions for domain in found.uniqueness_domains()] == [(0,), (1,)]


@st.composite
def graphs(draw):
    n = draw(st.integers(1, 7))
    pairs = list(itertools.combinations(range(n), 2))
    kinds = draw(st.lists(st.sampled_from(["none", "edge", "clash", "both"]), min_size=len(pairs), max_size=len(pairs)))
    neighbours, clashes = [set() for _ in range(n)], [set() for _ in range(n)]
    for (a, b), kind in zip(pairs, kinds, strict=True):
        for sets, names in ((neighbours, ("edge", "both")), (clashes, ("clash", "both"))):
            if kind in names:
                sets[a].add(b)
                sets[b].add(a)
    return neighbours, clashes, draw(st.sets(st.integers(0, n - 1), max_size=2))


@given(graphs())
def test_the_enumeration_agrees_with_all_subsets(graph):
    """Every subset of up to seven nodes is looked at: the connected ones without clash that no other one contains."""
    neighbours, clashes, excluded = graph
    nodes = [k for k in range(len(neighbours)) if k not in excluded]
    good = [
        set(some)
        for size in range(1, len(nodes) + 1)
        for some in itertools.combinations(nodes, size)
        if connected(some, neighbours) and not any(clashes[a] & set(some) for a in some)
    ]
    largest = sorted(tuple(sorted(some)) for some in good if not any(some < other for other in good))
    assert maximal_unions(neighbours, clashes, excluded, 10**6) == (largest, True)
