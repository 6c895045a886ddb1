import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import five_bar
from jaxkin.plot import style

ROBOT = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
JOINTS = np.array([1.2, 1.9])


@pytest.fixture(scope="module")
def modes() -> jk.Branches:
    return jk.forward(ROBOT, JOINTS)


def test_links_have_their_lengths_and_meet_in_the_joints(modes):
    pose = np.asarray(modes.values)[0]
    bodies = {body.name: body for body in ROBOT.linkage(pose, JOINTS)}
    lengths = {name: np.linalg.norm(np.diff(body.points, axis=0)) for name, body in bodies.items() if name[0] == "l"}
    assert lengths == pytest.approx({"l1": 8.0, "l2": 8.0, "l3": 5.0, "l4": 5.0}, abs=1e-9)
    for k in (1, 2):
        np.testing.assert_array_equal(bodies[f"l{k}"].points, [bodies[f"A{k}"].points[0], bodies[f"C{k}"].points[0]])
        np.testing.assert_array_equal(bodies[f"l{k + 2}"].points, [bodies[f"C{k}"].points[0], pose])
    np.testing.assert_array_equal(bodies["base"].points, [[0.0, 0.0], [9.0, 0.0]])
    assert bodies["P"].kind == "platform"


def test_every_assembly_mode_has_a_panel_with_its_point_coloured_by_the_sign(modes):
    panels = jk.plot.mechanism(ROBOT, JOINTS, modes)
    poses = np.asarray(modes.values)[np.asarray(modes.valid)]
    assert len(panels) == len(poses) == 2
    colours = set()
    for ax, pose in zip(panels, poses, strict=True):
        determinant = float(jk.conditioning(ROBOT, pose, JOINTS).determinant)
        (tip,) = (line for line in ax.lines if line.get_markersize() == 7)
        np.testing.assert_allclose(tip.get_xydata(), pose[None])
        assert tip.get_color() == style.SIGN_COLOURS[int(np.sign(determinant))]
        assert ("det > 0" if determinant > 0 else "det < 0") in ax.get_title()
        assert style.number(pose[0]) in ax.get_title()
        colours.add(tip.get_color())
        assert {text.get_text() for text in ax.texts} == {"$A_{1}$", "$A_{2}$", "$C_{1}$", "$C_{2}$", "$P$"}
        assert ax.get_aspect() == 1.0
    assert len(colours) == 2
    assert panels[0].figure.get_suptitle().startswith("2 assembly modes at")


def test_letters_are_inside_the_panel(modes):
    panels = jk.plot.mechanism(ROBOT, JOINTS, modes)
    panels[0].figure.canvas.draw()
    for ax in panels:
        frame = ax.get_window_extent()
        for text in ax.texts:
            box = text.get_window_extent()
            assert frame.x0 <= box.x0
            assert box.x1 <= frame.x1
            assert frame.y0 <= box.y0
            assert box.y1 <= frame.y1


def test_all_modes_over_each_other_have_numbers_beside_their_points(modes):
    _, ax = plt.subplots()
    assert jk.plot.mechanism(ROBOT, JOINTS, modes, ax=ax) is ax
    places = {text.get_text(): text.xy for text in ax.texts}
    poses = np.asarray(modes.values)[np.asarray(modes.valid)]
    assert set(places) == {"1", "2"}
    for number, pose in enumerate(poses, 1):
        np.testing.assert_allclose(places[str(number)], pose)


def test_what_can_not_be_drawn_is_told_both_ways_out():
    with pytest.raises(jk.InputError, match=r"outline\(pose\).*linkage\(pose, joints\)"):
        jk.plot.mechanism(object(), JOINTS)  # type: ignore[arg-type]
