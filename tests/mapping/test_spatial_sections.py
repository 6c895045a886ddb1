"""Singular curves over sections of the joint spaces of the spatial robots, against their closed forms."""

import numpy as np
import pytest

import jaxkin as jk


@pytest.fixture(scope="module")
def section():
    robot = jk.mechanisms.ppps3.create()
    axes = {"rho1y": 0.0, "rho1z": 0.0, "rho2y": 0.5, "rho3y": -0.2}
    grid = jk.Grid(**axes, rho2z=(-1.2, 1.2, 200), rho3z=(-1.2, 1.2, 200))
    return robot, jk.singular_curves(robot, grid)


def factors_squared(joints):
    """R33^2 and R22^2 from the joints."""
    m2, p, m3 = np.asarray(jk.mechanisms.ppps3.reduced_joints(joints)).T
    return 1 - 4 / 3 * (m2**2 - m2 * m3 + m3**2), 1 - (m2 - m3) ** 2 - p**2


@pytest.mark.slow
def test_every_curve_of_the_3_ppps_lies_on_its_conic(section):
    _, curves = section
    assert sorted(curve.label for curve in curves) == ["R22", "R22", "R33", "R33"]
    for curve in curves:
        a, b = factors_squared(curve.joints)
        assert np.max(np.abs(a if curve.label == "R33" else b)) < 1e-14
        assert curve.closed
        assert curve.residual < 1e-12
        assert np.all(np.abs(curve.poses[:, 4]) <= np.pi / 2)


@pytest.mark.slow
def test_the_curves_of_the_3_ppps_cover_both_conics_where_poses_are_real(section):
    """On R33 = 0 the section has the ellipse's part with b >= 0, on R22 = 0 two segments m2 - m3 = +-sqrt(1 - p^2)."""
    _, curves = section
    p = 0.3
    for label in ("R33", "R22"):
        points = np.concatenate([curve.joints[:, [3, 5]] for curve in curves if curve.label == label])
        if label == "R33":
            # With d = m2 - m3 and s = m2 + m3 the ellipse is d^2 + s^2 / 3 = 1.
            t = np.linspace(-np.pi, np.pi, 721)
            d, s = np.cos(t), np.sqrt(3) * np.sin(t)
            wanted = np.stack([(s + d) / 2, (s - d) / 2], axis=1)
            wanted = wanted[1 - d**2 - p**2 >= 0]
        else:
            d = np.sqrt(1 - p**2)
            reach = np.sqrt(3 * (1 - d**2))
            s = np.linspace(-reach, reach, 201)
            wanted = np.concatenate([np.stack([(s + e) / 2, (s - e) / 2], axis=1) for e in (d, -d)])
        gap = np.min(np.linalg.norm(wanted[:, None] - points[None], axis=2), axis=1)
        assert np.max(gap) < 0.03


@pytest.mark.slow
def test_the_two_factors_cross_at_four_joint_points(section):
    _, curves = section
    a, b = factors_squared(curves.crossings.joints)
    assert len(curves.crossings.joints) == 4
    assert np.max(np.abs(a)) < 1e-14
    assert np.max(np.abs(b)) < 1e-14
    # (m2 - m3)^2 = 1 - p^2, (m2 + m3)^2 = 3 p^2.
    expected = {(round((s * 3**0.5 * 0.3 + d) / 2, 9), round((s * 3**0.5 * 0.3 - d) / 2, 9))
                for s in (1, -1) for d in (0.91**0.5, -(0.91**0.5))}  # fmt: skip
    assert {(round(float(q[3]), 9), round(float(q[5]), 9)) for q in curves.crossings.joints} == expected


@pytest.mark.slow
def test_no_configuration_is_listed_twice(section):
    """Every pose has two Euler triples; each curve is listed by one of them."""
    robot, curves = section
    for k, curve in enumerate(curves):
        middle = curve.poses[len(curve.poses) // 2]
        rotation = jk.mechanisms.ppps3.position_and_rotation(middle)[1]
        for other in curves[k + 1 :]:
            frames = np.array([jk.mechanisms.ppps3.position_and_rotation(pose)[1] for pose in other.poses[::8]])
            x = np.abs(other.poses[::8, 0] - middle[0])
            assert np.min(np.max(np.abs(frames - np.asarray(rotation)), axis=(1, 2)) + x) > 1e-3
    del robot


def test_a_section_in_gimbal_lock_is_refused_with_a_remedy():
    robot = jk.mechanisms.ppps3.create()
    grid = jk.Grid(rho1y=0.0, rho1z=0.0, rho2y=0.5, rho3y=-0.5, rho2z=(-1.2, 1.2, 200), rho3z=(-1.2, 1.2, 200))
    with pytest.raises(jk.InputError, match=r"gimbal lock.*by 1e-3"):
        jk.singular_curves(robot, grid)


@pytest.mark.slow
def test_the_tlpm_is_singular_over_a_section_where_z_is_minus_h():
    robot = jk.mechanisms.tlpm.create(stroke=(-700, 400))
    grid = jk.Grid(l1=(-700.0, 300.0, 200), l2=-100.0, l3=(-700.0, 300.0, 200))
    curves = jk.singular_curves(robot, grid)
    (curve,) = curves
    assert curve.label == "z + h"
    assert np.max(np.abs(curve.poses[:, 2] + 590)) < 1e-6
    assert curve.ends == ("l1 = 300", "l3 = 300")
    assert len(jk.cusps(robot, grid).joints) == 0
