import math

import matplotlib

matplotlib.use("Agg")
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from matplotlib.colors import to_hex, to_rgb
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

import jaxkin as jk
from jaxkin.core.bodies import Body
from jaxkin.core.branches import Lane
from jaxkin.mapping._orientation_records import Solid
from jaxkin.mapping._workspace_records import WorkspacePatch, WorkspaceSurfaces
from jaxkin.mechanisms import _tlpm_wrist
from jaxkin.plot import layers, spatial, style

PPPS3 = jk.mechanisms.ppps3.create()
TLPM = jk.mechanisms.tlpm.create()
#: Strokes that reach the base plane.
LONG = jk.mechanisms.tlpm.create(stroke=(-700.0, 500.0))
POSE = np.array([0.1, 0.25, 0.4, 0.3, 0.25, -0.2])
#: Table 1 of Fu and Gao.
P1, P2 = np.array([100.0, 100.0, 100.0]), np.array([100.0, 100.0, -1280.0])


def named(bodies: tuple[Body, ...]) -> dict[str, Body]:
    found = {body.name: body for body in bodies}
    assert len(found) == len(bodies)
    return found


def legend(ax) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def kinds(ax, kind) -> list:
    return [c for c in ax.collections if isinstance(c, kind)]


def solid_axes():
    return plt.figure().add_subplot(projection="3d")


def nothing_is_cut_off(ax) -> None:
    """Square Axes reach over the figure, so that texts are looked at, and not the whole."""
    figure = ax.figure
    figure.canvas.draw()
    texts = [text for panel in figure.axes for text in (panel.title, panel.xaxis.label, panel.yaxis.label)]
    texts += [panel.zaxis.label for panel in figure.axes if panel.name == "3d"] + ax.get_legend().get_texts()
    texts += [figure._suptitle] if figure.get_suptitle() else []
    width, height = figure.bbox.size
    for text in (text for text in texts if text.get_text()):
        box = text.get_window_extent()
        assert min(box.x0, box.y0) >= 0, text
        assert box.x1 <= width, text
        assert box.y1 <= height, text
    # Of the labels of an axis that are drawn, none is on the legend.
    key = ax.get_legend().get_window_extent()
    assert not any(key.overlaps(axis.label.get_window_extent()) for axis in (ax.xaxis, ax.yaxis, ax.zaxis))


def upright_axis_is_legible(ax) -> None:
    """The name of the upright axis is on none of its tick labels, and its line goes through none of them."""
    ax.figure.canvas.draw()
    low, high = ax.get_zlim()
    ticks = [tick for tick in ax.zaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    boxes = [tick.label1.get_window_extent() for tick in ticks if tick.label1.get_text()]
    (x0, y0), (x1, y1) = ax.transData.transform(np.transpose(ax.zaxis.line.get_data()))
    assert len(boxes) >= 2
    for box in boxes:
        assert not box.overlaps(ax.zaxis.label.get_window_extent())
        at = x0 + ((box.y0 + box.y1) / 2 - y0) / (y1 - y0) * (x1 - x0)
        assert at < box.x0 or box.x1 < at


# --- what the robots look like ------------------------------------------------------------------------------


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_legs_of_the_ppps3_have_their_joint_values(mirrored):
    robot = jk.mechanisms.ppps3.create(side=1.3, base_radius=2.5, mirrored=mirrored)
    joints = np.asarray(jk.inverse(robot, POSE).values[0])
    passive = np.asarray(jk.mechanisms.ppps3.passive_joints(robot, POSE))
    parts = named(robot.bodies(POSE))
    # Eq. (3): C1 = (rho1x, rho1y, rho1z), C2 = (-rho2y, rho2x, rho2z), C3 = (rho3y, -rho3x, rho3z).
    for limb, (y, z), x, axis, sign in ((1, joints[:2], passive[0], 1, 1), (2, joints[2:4], passive[1], 0, -1)):
        along = parts[f"rho{limb}y"].points
        assert along[1, axis] - along[0, axis] == pytest.approx(sign * y, abs=1e-12)
        upward = parts[f"rho{limb}z"].points
        np.testing.assert_allclose(upward[1] - upward[0], [0.0, 0.0, z], atol=1e-12)
        reach = parts[f"rho{limb}x"].points
        assert reach[1, 1 - axis] == pytest.approx(x, abs=1e-12)
        np.testing.assert_allclose(reach[1], parts[f"C{limb}"].points[0], atol=1e-12)
    end = parts["C3"].points[0]
    np.testing.assert_allclose(end, [joints[4], -passive[2], joints[5]], atol=1e-12)
    sides = np.linalg.norm(end - parts["platform"].points[:2], axis=1)
    np.testing.assert_allclose(sides, 1.3, rtol=1e-12)
    np.testing.assert_array_equal(parts["A2"].points, [[0.0, 2.5, 0.0]])
    for body in parts.values():
        if body.kind in ("actuated", "passive"):
            assert np.count_nonzero(np.abs(np.diff(body.points, axis=0)) > 1e-12) <= 1


def test_the_limbs_of_the_tlpm_have_their_lengths_and_end_at_its_links():
    joints = np.asarray(jk.inverse(TLPM, P1).values[0])
    parts = named(TLPM.bodies(P1))
    for k in range(3):
        q, tube, rod = (parts[name.format(k + 1)].points for name in ("q{}", "l{}", "limb {} rod"))
        assert np.linalg.norm(q[0] - P1) == pytest.approx(590 * math.sqrt(2) + joints[k], rel=1e-12)
        np.testing.assert_allclose(tube[0], q[0])
        np.testing.assert_allclose(tube[1], rod[0])
        np.testing.assert_allclose(rod[1], parts[f"L{k + 1}2"].points[0], atol=1e-9)
        np.testing.assert_allclose(parts[f"L{k + 1}3"].points[1], parts["platform"].points[k], atol=1e-9)
    assert {body.width for body in parts.values() if body.name.startswith("L")} == {25.0}


def test_a_limb_without_length_is_left_out_and_a_batch_of_poses_is_refused():
    parts = named(LONG.bodies([590.0, 0.0, -590.0]))
    assert "l1" not in parts
    assert "l2" in parts
    with pytest.raises(jk.InputError, match=r"\(2, 3\)"):
        TLPM.bodies(np.zeros((2, 3)))
    with pytest.raises(jk.InputError, match=r"\(5,\)"):
        PPPS3.bodies(np.zeros(5))


# --- assembly modes and single poses ------------------------------------------------------------------------


def test_every_assembly_mode_of_the_ppps3_has_a_panel_with_its_signs():
    panels = jk.plot.mechanism(PPPS3, jk.inverse(PPPS3, POSE).values[0])
    assert [ax.name for ax in panels] == ["3d"] * 4
    # det dF/dpose = -8 sqrt3 cos(theta) R22 R33.
    assert [ax.get_title() for ax in panels] == [
        "1:  $R_{22}$ > 0, $R_{33}$ > 0;  det < 0",
        "2:  $R_{22}$ > 0, $R_{33}$ < 0;  det > 0",
        "3:  $R_{22}$ < 0, $R_{33}$ > 0;  det > 0",
        "4:  $R_{22}$ < 0, $R_{33}$ < 0;  det < 0",
    ]
    ax = panels[0]
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()) == ("$x$ (length)", "$y$ (length)", "$z$ (length)")
    assert legend(ax) == ["actuated joint", "passive joint", "base", "platform, det > 0", "platform, det < 0"]
    (plate,) = kinds(ax, Poly3DCollection)
    assert to_hex(plate.get_facecolor()[0]) == style.OKABE_ITO["green"].lower()
    assert to_hex(plate.get_edgecolor()[0]) == style.SIGN_COLOURS[-1].lower()
    assert {"$A_{1}$", "$C_{3}$"} <= {text.get_text() for text in ax.texts}
    assert "ρ" not in ax.figure.get_suptitle()
    assert ax.figure.get_suptitle().startswith("4 assembly modes at\n$\\rho_{1y}$ = 0.25, ")
    nothing_is_cut_off(ax)


def test_both_assembly_modes_of_the_tlpm():
    panels = jk.plot.mechanism(TLPM, jk.inverse(TLPM, P1).values[0])
    assert [ax.get_title() for ax in panels] == ["1:  upper, $z$ > −$h$;  det > 0", "2:  lower, $z$ < −$h$;  det < 0"]
    assert panels[0].get_zlabel() == "$z$ (mm)"
    # Drawn to one scale, and alike.
    np.testing.assert_allclose(panels[0]._box_aspect, panels[1]._box_aspect)
    sides = [np.ptp(limits) for limits in (panels[0].get_xlim(), panels[0].get_ylim(), panels[0].get_zlim())]
    np.testing.assert_allclose(panels[0]._box_aspect / sides, panels[0]._box_aspect[0] / sides[0])
    # Six links of six faces, platform and base.
    assert sum(len(c._faces) for c in kinds(panels[1], Poly3DCollection)) == 6 * 6 + 2
    assert "links of the wrists [ours]" in legend(panels[0])
    nothing_is_cut_off(panels[0])


def test_modes_over_each_other_in_given_axes():
    ax = solid_axes()
    assert jk.plot.mechanism(TLPM, jk.inverse(TLPM, P1).values[0], ax=ax) is ax
    assert [text.get_text() for text in ax.texts] == ["1", "2"]
    # The base is drawn once.
    plates = [c for c in kinds(ax, Poly3DCollection) if len(c._faces) == 1]
    assert len(plates) == 3
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.mechanism(TLPM, jk.inverse(TLPM, P1).values[0], ax=plt.subplots()[1])


def test_one_mode_on_the_singular_surface_and_no_mode():
    panels = jk.plot.mechanism(LONG, jk.inverse(LONG, [0.0, 0.0, -590.0]).values[0])
    assert [ax.get_title().split("det ")[1] for ax in panels] == ["= 0"]
    assert panels[0].figure.get_suptitle().startswith("One assembly mode at\n")
    with pytest.raises(jk.InputError, match="No real solution"):
        jk.plot.mechanism(TLPM, [-200.0, -200.0, -200.0 + 1e4])


def arrows(ax) -> np.ndarray:
    """Returns the shafts of the arrows that say how the platform moves, ``(n, 3)``."""
    found = [c for c in kinds(ax, Line3DCollection) if to_hex(c.get_color()[0]) == style.SIGN_COLOURS[-1].lower()]
    return np.array([c._segments3d[0][1] - c._segments3d[0][0] for c in found])


def test_the_uncontrolled_motion_of_the_tlpm_is_upright():
    ax = jk.plot.pose(LONG, [150.0, 100.0, -590.0])
    along = arrows(ax)
    assert len(along) == 3
    np.testing.assert_allclose(along[:, :2], 0.0, atol=1e-6 * np.abs(along[:, 2]).max())
    assert legend(ax)[-2:] == ["platform, det = 0", "uncontrolled motion"]
    assert ax.get_title() == "$x$ = 150, $y$ = 100, $z$ = −590"
    nothing_is_cut_off(ax)
    ax = jk.plot.pose(TLPM, [0.0, 0.0, 0.0])
    assert len(arrows(ax)) == 0
    assert legend(ax)[-1] == "platform, det > 0"


def test_the_uncontrolled_motion_of_the_ppps3_keeps_the_actuated_joints():
    pose = np.array([0.1, 0.25, 0.4, math.pi / 2, 0.25, -0.2])
    along = arrows(jk.plot.pose(PPPS3, pose))
    # C1 keeps y and z, C2 and C3 keep x and z; the platform turns about a vertical axis.
    assert len(along) >= 2
    np.testing.assert_allclose(along[:, 2], 0.0, atol=1e-6)
    assert (np.abs(along[:, :2]).max(axis=1) > 1e3 * np.abs(along[:, :2]).min(axis=1)).all()


def test_poses_that_cannot_be_drawn_are_refused():
    with pytest.raises(jk.InputError, match="cannot be reached"):
        jk.plot.pose(TLPM, [0.0, 0.0, 5000.0])
    with pytest.raises(jk.InputError, match="3 finite numbers"):
        jk.plot.pose(TLPM, [0.0, 0.0, math.nan])
    with pytest.raises(jk.InputError, match="bodies"):
        jk.plot.pose(jk.mechanisms.rpr3.reference(), [0.0, 0.0, 0.0])
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.pose(TLPM, [0.0, 0.0, 0.0], ax=plt.subplots()[1])
    ax = solid_axes()
    assert jk.plot.pose(TLPM, [0.0, 0.0, 0.0], ax=ax) is ax


# --- wrists and links ---------------------------------------------------------------------------------------


def yawed(degrees: float):
    half = math.radians(degrees) / 2
    return jk.mechanisms.tlpm.create(orientation=(math.cos(half), 0.0, 0.0, math.sin(half)))


def test_closest_points_of_links_are_joined_and_bear_their_distance():
    ax = jk.plot.interference(TLPM, P1)
    # The smallest distance is that of two links 3.
    clear = {name: float(value) for name, value in _tlpm_wrist.link_clearances(TLPM, P1).items()}
    least = min(clear.values()) + 25 * math.sqrt(2)
    (joined,) = (line for line in ax.lines if line.get_marker() == "o")
    start, end = np.stack(joined.get_data_3d(), axis=1)
    assert np.linalg.norm(end - start) == pytest.approx(least, rel=1e-9)
    assert f"{least:.1f}" in [text.get_text() for text in ax.texts]
    assert ax.get_title().endswith(r"limit $\sqrt{2}\,a$ = 35.4 mm: free  [ours]")
    assert {f"$L_{{{k}{n}}}$" for k in (1, 2, 3) for n in (2, 3)} <= {text.get_text() for text in ax.texts}
    nothing_is_cut_off(ax)


def test_links_below_the_limit_are_told_apart():
    # Free from -60.5 to 47.3 degrees about the vertical.
    ax = jk.plot.interference(yawed(48.0), [0.0, 0.0, 0.0])
    assert "not proven free" in ax.get_title()
    assert legend(ax)[0] == r"$D$ < $\sqrt{2}\,a$: not proven free"
    ax = jk.plot.interference(yawed(47.0), [0.0, 0.0, 0.0])
    assert ": free" in ax.get_title()
    assert len(legend(ax)) == 1
    given = solid_axes()
    assert jk.plot.interference(TLPM, P1, ax=given) is given


def test_wrists_of_a_pose_outside_the_strokes_say_so():
    for draw in (jk.plot.interference, jk.plot.wrist_angles):
        assert "outside" not in draw(TLPM, P1).get_title()
        ax = draw(TLPM, [0.0, 0.0, 900.0])
        assert ax.get_title().startswith("pose outside the strokes\n")
        nothing_is_cut_off(ax)


@pytest.mark.parametrize("elbow", [1, -1])
@pytest.mark.parametrize("limb", [1, 2, 3])
def test_arcs_of_the_wrist_angles_end_on_the_axes(limb, elbow):
    robot = jk.mechanisms.tlpm.create(elbows=(elbow,) * 3)
    ax = jk.plot.wrist_angles(robot, P1, limb)
    ends = np.asarray(_tlpm_wrist.links(robot, P1))
    r1, r2 = ends[limb - 1, 1] - P1, ends[limb + 2, 1] - P1
    arcs = {}
    for line in ax.lines:
        points = np.stack(line.get_data_3d(), axis=1)
        if len(points) == 40:
            arcs.setdefault(line.get_color(), []).append(points)
    (first,), (second,) = arcs[style.OKABE_ITO["blue"]], arcs[style.OKABE_ITO["purple"]]
    np.testing.assert_allclose(unit(first[-1] - P1), unit(r2), atol=1e-9)
    np.testing.assert_allclose(unit(second[-1] - ends[limb + 2, 1]), unit(r1), atol=1e-9)
    # The second angle begins at the platform's centre: here, as it is level, below its middle.
    start = second[0] - ends[limb + 2, 1]
    assert start @ r2 == pytest.approx(0.0, abs=1e-9)
    assert start @ np.array([*(P1 - ends[limb + 2, 1])[:2], 0.0]) > 0
    assert len(arcs[style.OKABE_ITO["vermillion"]]) == 2
    nothing_is_cut_off(ax)


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def test_wrist_angles_of_the_home_pose_are_written_out():
    # 90 degrees each at home for L = h and beta2 = 45 degrees.
    ax = jk.plot.wrist_angles(TLPM, [0.0, 0.0, 0.0], limb=2)
    assert ax.get_title() == r"limb 2 [ours]:  $\theta_{21}$ = 90.0°,  $\theta_{22}$ = 90.0°"
    given = solid_axes()
    assert jk.plot.wrist_angles(TLPM, P1, ax=given) is given
    with pytest.raises(jk.InputError, match="1, 2 or 3"):
        jk.plot.wrist_angles(TLPM, P1, limb=0)
    with pytest.raises(jk.InputError, match="TLPM"):
        jk.plot.wrist_angles(PPPS3, POSE)
    with pytest.raises(jk.InputError, match="three finite"):
        jk.plot.interference(TLPM, [0.0, 0.0])


def test_the_drawing_of_the_limit_is_to_scale():
    ax = jk.plot.clearance_limit(TLPM)
    circles = [patch for patch in ax.patches if isinstance(patch, matplotlib.patches.Circle)]
    apart = np.linalg.norm(np.subtract(circles[0].center, circles[1].center))
    assert apart == pytest.approx(25 * math.sqrt(2))
    assert [circle.radius for circle in circles] == pytest.approx([apart / 2] * 2)
    squares = [patch for patch in ax.patches if isinstance(patch, matplotlib.patches.Rectangle)]
    for square in squares:
        corners = square.get_patch_transform().transform(square.get_path().vertices[:4])
        centre = min((c.center for c in circles), key=lambda c: np.linalg.norm(corners.mean(axis=0) - c))
        np.testing.assert_allclose(np.linalg.norm(corners - centre, axis=1), apart / 2)
    assert any("35.4 mm" in text.get_text() for text in ax.texts)
    given = plt.subplots()[1]
    assert jk.plot.clearance_limit(TLPM, ax=given) is given


# --- workspaces and solids ----------------------------------------------------------------------------------

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
#: The sides of the cube, counterclockwise seen from outside: x = 0, x = 1, y = 0, y = 1, z = 0, z = 1.
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def cube_surfaces(names: tuple[str, ...], branch: str = "upper") -> WorkspaceSurfaces:
    patches = []
    for name, side in zip(names, SIDES, strict=False):
        corners = 100 * CUBE[list(side)]
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
        patches.append(WorkspacePatch(name, corners, faces, 1e4, 0.0, edges, "singular" in name))
    return WorkspaceSurfaces(tuple(patches), branch, 1e6, {}, ("x", "y", "z"), dict.fromkeys("xyz", "mm"))


STROKES = ("l1 = l1_min", "l1 = l1_max", "l2 = l2_min", "l2 = l2_max", "l3 = l3_min", "l3 = l3_max")


def test_faces_of_a_workspace_are_named_and_coloured_by_limit():
    ax = jk.plot.workspace(cube_surfaces(STROKES))
    assert legend(ax)[:2] == [r"$l_{1}$ = $l_{1,\mathrm{min}}$", r"$l_{1}$ = $l_{1,\mathrm{max}}$"]
    assert len(legend(ax)) == 6
    low, high = (np.array(patch.get_facecolor()[:3]) for patch in ax.get_legend().legend_handles[:2])
    assert low.sum() < np.sum(to_rgb(style.OKABE_ITO["sky"])) < high.sum()
    assert ax.get_title() == "upper branch: 1.0000 × 10$^{6}$ mm$^3$"
    assert ax.get_zlabel() == "$z$ (mm)"
    nothing_is_cut_off(ax)


def test_the_singular_piece_of_a_workspace_and_both_branches():
    seven = cube_surfaces((*STROKES[:5], "z = -h, singular"))
    ax = jk.plot.workspace([seven, cube_surfaces(STROKES, "lower")])
    assert "$z$ = −$h$, singular" in legend(ax)
    assert len(legend(ax)) == 7
    assert [line.split(":")[0] for line in ax.get_title().splitlines()] == ["upper branch", "lower branch"]
    given = solid_axes()
    assert jk.plot.workspace(seven, ax=given) is given
    with pytest.raises(jk.InputError, match="no face"):
        jk.plot.workspace(cube_surfaces(()))
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.workspace(seven, ax=plt.subplots()[1])


def test_the_upright_axis_of_a_tall_picture_is_legible():
    both = [jk.workspace_surfaces(TLPM, branch, n=4) for branch in ("upper", "lower")]
    ax = jk.plot.workspace(both)
    assert ax.get_zlim()[0] < -1000
    upright_axis_is_legible(ax)
    nothing_is_cut_off(ax)


def test_hidden_edges_are_found():
    ax = solid_axes()
    spatial.frame(ax, np.array([[0.0, 1.0]] * 3), [jk.Axis(name, "mm") for name in "xyz"], -60.0, 25.0)
    triangles = np.concatenate([CUBE[list(side)][[[0, 1, 2], [0, 2, 3]]] for side in SIDES])
    eye = np.array([0.5, -0.9, 0.4])
    # Seen from (+x, -y, +z), the corner (0, 1, 0) is behind the cube, and so are the middles of its three edges.
    hidden = np.array([[0.0, 1.0, 0.5], [0.5, 1.0, 0.0], [0.0, 0.5, 0.0]])
    shown = np.array([[1.0, 0.0, 0.5], [0.5, 0.0, 0.0], [1.0, 0.5, 1.0], [0.5, 0.0, 1.0], 0.5 + eye])
    assert not layers.visible(ax, hidden, triangles).any()
    assert layers.visible(ax, shown, triangles).all()


def cube_solid(chart: str, axes: tuple[str, str, str], unit: str, scale: float) -> Solid:
    faces = np.concatenate([[[a, b, c], [a, c, d]] for a, b, c, d in SIDES])
    patch = np.repeat([0, 0, 2, 2, 1, 1], 2)
    vertices = scale * (CUBE - 0.5)
    return Solid("R22 > 0, R33 > 0", chart, axes, (unit,) * 3, vertices, faces, ("R22", "R33", "chart"), patch, 0.0)


def test_a_solid_in_a_chart_has_ticks_in_pi_and_named_faces():
    # In the chart Z-X-Y the home aspect is the cube (-pi/2, pi/2)^3.
    ax = jk.plot.solid(cube_solid("zxy", ("alpha", "beta", "gamma"), "rad", math.pi))
    assert legend(ax) == ["$R_{22}$ = 0", "$R_{33}$ = 0", r"end of the chart ($\cos\beta$ = 0)"]
    assert ax.get_title() == (
        "$R_{22}$ > 0, $R_{33}$ > 0  (Z-X-Y Euler angles [ours])\nvolume π$^3$ rad$^3$ in this chart"
    )
    assert (ax.get_xlabel(), ax.get_zlabel()) == (r"$\alpha$ (rad)", r"$\gamma$ (rad)")
    nothing_is_cut_off(ax)
    assert {"−π/2", "0", "π/2"} <= {tick.get_text() for tick in ax.get_xticklabels()}
    assert [layer.get_rasterized() for layer in kinds(ax, Poly3DCollection)] == [True, True]
    # The twelve edges of the cube, each once, in front or behind: here all bound different patches, or two of one.
    outlines = sum(len(lines._segments3d) for lines in kinds(ax, Line3DCollection))
    assert outlines == 12


def test_a_solid_of_joints_and_what_is_refused():
    solid = cube_solid("joints", ("mu2z", "mu3y", "mu3z"), "length", 1.0)
    given = solid_axes()
    assert jk.plot.solid(solid, ax=given) is given
    assert given.get_xlabel() == r"$\mu_{2z}$ (length)"
    assert given.get_title().endswith("volume of the triangles 1 length$^3$")
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.solid(solid, ax=plt.subplots()[1])


# --- singular surfaces --------------------------------------------------------------------------------------


def test_singular_surfaces_of_the_ppps3_and_those_of_its_angles():
    turn = (-math.pi, math.pi, 12)
    box = jk.Grid(x=0.0, y=0.0, z=0.0, phi=turn, theta=(-math.pi / 2, math.pi / 2, 8), sigma=turn)
    found = jk.singular_surfaces(PPPS3, box)
    ax = jk.plot.surfaces(found, robot=PPPS3)
    assert legend(ax) == [
        "$R_{22}$ = 0",
        "$R_{33}$ = 0",
        r"$\cos\theta$ = 0 (angles, not the robot)",
        "$R_{22}$ = $R_{33}$ = 0",
        r"glued: $\phi$ = ±π, $\sigma$ = ±π",
    ]
    # Nothing of the robot's surfaces lies in the faces of the chart.
    near, far, *veils = kinds(ax, Poly3DCollection)
    corners = np.array(near._faces)
    assert not np.all(np.abs(corners[:, :, 1]) == math.pi / 2, axis=1).any()
    assert len(near._faces) == len(far._faces)
    assert len(veils) == 2
    assert {float(veil._faces[0][0][1]) for veil in veils} == {-math.pi / 2, math.pi / 2}
    assert legend(jk.plot.surfaces(found))[:3] == ["$R_{22}$ = 0", "$R_{33}$ = 0", "$R_{22}$ = $R_{33}$ = 0"]


def test_the_singular_plane_of_the_tlpm():
    box = jk.Grid(x=(-500.0, 500.0, 6), y=(-500.0, 500.0, 6), z=(-900.0, 200.0, 6))
    ax = jk.plot.surfaces(jk.singular_surfaces(TLPM, box), robot=TLPM)
    assert legend(ax) == ["$z + h$ = 0"]
    upright_axis_is_legible(ax)
    nothing_is_cut_off(ax)
    upright_axis_is_legible(jk.plot.surfaces(jk.singular_surfaces(TLPM, box), ax=solid_axes()))


# --- maps of categories -------------------------------------------------------------------------------------


def categories(values: np.ndarray, names: str, margin: np.ndarray | None = None) -> xarray.Dataset:
    x, y = np.linspace(-1.0, 1.0, values.shape[0]), np.linspace(0.0, 1.0, values.shape[1])
    attrs = {"flag_values": list(range(len(names.split()))), "flag_meanings": names, "long_name": "limit"}
    coords = {"x": ("x", x, {"units": "mm"}), "y": ("y", y, {"units": "mm"}), "z": 0.5}
    variables = {"binding_limit": (("x", "y"), values.astype(np.int8), attrs | {"not_computed": -1})}
    if margin is not None:
        variables["binding_limit_margin"] = (("x", "y"), margin, {})
    return xarray.Dataset(variables, coords, {"field": "binding_limit"})


def test_categories_have_names_and_only_those_that_occur_are_listed():
    values = np.full((40, 30), 2)
    values[:15] = 0
    values[30:] = -1
    ax = jk.plot.section(categories(values, "l1_low l1_high theta12_low"))
    assert legend(ax) == ["$l_{1}$ low", r"$\theta_{12}$ low", "none"]
    colours = [to_hex(patch.get_facecolor()) for patch in ax.get_legend().legend_handles]
    assert colours[-1] == "#dddddd"
    assert len(set(colours)) == 3
    assert ax.get_title() == "$z$ = 0.5"
    for text in ax.texts:
        x, _ = text.get_position()
        assert text.get_text() == (r"$\theta_{12}$ low" if x > -0.25 else "$l_{1}$ low")
    image = ax.images[0].get_array()
    assert to_hex(image[0, 0]) == colours[0]
    assert to_hex(image[0, -1]) == "#dddddd"
    assert ax.get_aspect() == 1.0


def test_more_categories_than_colours_are_hatched_and_violated_ones_are_pale():
    values = np.repeat(np.arange(9), 6)[:, None] * np.ones((1, 20), int)
    margin = np.broadcast_to(np.linspace(-1.0, 1.0, 20), values.shape)
    ax = jk.plot.section(categories(values, " ".join(f"l{k}_low" for k in range(9)), margin))
    handles = ax.get_legend().legend_handles
    looks = {(to_hex(patch.get_facecolor()), patch.get_hatch()) for patch in handles[:9]}
    assert len(looks) == 9
    assert legend(ax)[-2:] == ["pale: violated", "margin 0"]
    image = ax.images[0].get_array()
    inside, outside = np.array(image[-1, 0]), np.array(image[0, 0])
    np.testing.assert_allclose(inside, to_rgb(handles[0].get_facecolor()))
    np.testing.assert_allclose(outside, inside + 0.6 * (1 - inside))


def test_a_category_over_one_axis_has_its_names_as_ticks():
    data = categories(np.repeat([0, 1], 10)[:, None] * np.ones((1, 2), int), "l1_low l1_high").isel(y=0)
    ax = jk.plot.section(data)
    assert [tick.get_text() for tick in ax.get_yticklabels()] == ["$l_{1}$ low", "$l_{1}$ high"]


def test_categories_over_one_axis_stand_at_equal_distances():
    values = np.repeat([5, 0, 19], 6)[:, None] * np.ones((1, 2), int)
    data = categories(values, " ".join(f"l{k}_low" for k in range(20))).isel(y=0)
    ax = jk.plot.section(data)
    np.testing.assert_array_equal(ax.get_yticks(), [0, 1, 2])
    assert [tick.get_text() for tick in ax.get_yticklabels()] == [f"$l_{{{k}}}$ low" for k in (0, 5, 19)]
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), np.repeat([1, 0, 2], 6))


# --- slices of maps -----------------------------------------------------------------------------------------


def colour_bar(ax):
    """Returns the label beside a picture, which must be within the figure."""
    ax.figure.canvas.draw()
    (label,) = (panel.yaxis.label for panel in ax.figure.axes if panel is not ax)
    box, figure = label.get_window_extent(), ax.figure.bbox
    assert figure.y0 <= box.y0 < box.y1 <= figure.y1
    assert figure.x0 <= box.x0 < box.x1 <= figure.x1
    return label.get_text().replace("\n", " ")


def test_a_slice_of_margins_names_its_limit():
    data = jk.sweep(TLPM, "limit_margins", jk.Grid(x=(-300.0, 300.0, 8), y=(-300.0, 300.0, 9), z=0.0))
    for chosen in (data.sel(limit="theta12_low"), data.sel(limit="theta12_low").limit_margins):
        ax = jk.plot.section(chosen)
        assert ax.get_title() == "$z$ = 0\nlimit: $\\theta_{12}$ low"
        assert colour_bar(ax).startswith("signed distance to each limit, negative outside")
    with pytest.raises(jk.InputError, match=r"limit, x, y.*\.sel\(limit='l1_low'\)\.") as caught:
        jk.plot.section(data)
    assert "branch" not in str(caught.value)
    # Labels are no axis of a picture.
    with pytest.raises(jk.InputError, match=r"\.sel\(limit='l1_low'\)\."):
        jk.plot.section(data.isel(x=0))


def test_a_slice_of_branches_names_branch_and_coordinate_and_has_its_unit():
    coordinate = ["x", "theta"]
    units = {"units": "x: length, theta: rad", "long_name": "poses of the assembly modes"}
    values = np.linspace(0.1, 1.0, 2 * 2 * 5 * 6).reshape(2, 2, 5, 6)
    coords = {"branch": ["R22 > 0", "R22 < 0"], "forward_coordinate": coordinate}
    coords |= {"rho1y": np.linspace(0, 1, 5), "rho2y": np.linspace(0, 1, 6)}
    data = xarray.DataArray(values, coords, list(coords), name="forward_branches", attrs=units)
    ax = jk.plot.section(data.isel(branch=1).sel(forward_coordinate="theta"))
    assert ax.get_title() == r"branch: $R_{22}$ < 0,  forward coordinate: $\theta$"
    assert colour_bar(ax) == "poses of the assembly modes (rad)"
    ax = jk.plot.section(data.isel(branch=1).sel(forward_coordinate="x"))
    assert colour_bar(ax) == "poses of the assembly modes (length)"
    with pytest.raises(jk.InputError, match=r"\.sel\(branch='R22 > 0'\)\.sel\(forward_coordinate='x'\)"):
        jk.plot.section(data)


@pytest.mark.slow
def test_the_binding_limit_of_the_tlpm_over_poses():
    grid = jk.Grid(x=(-500.0, 500.0, 40), y=(-500.0, 500.0, 40), z=0.0)
    data = jk.sweep(TLPM, "binding_limit", grid)
    ax = jk.plot.section(data)
    names = data.binding_limit.attrs["flag_meanings"].split()
    present = [style.words(names[k]) for k in np.unique(data.binding_limit)]
    assert legend(ax)[: len(present)] == present
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$x$ (mm)", "$y$ (mm)")


# --- words and formulas -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("rho1", r"$\rho_{1}$"),
        ("rho1y", r"$\rho_{1y}$"),
        ("R22", "$R_{22}$"),
        ("z + h", "$z + h$"),
        ("cos(theta)", r"$\cos\theta$"),
        ("x", "$x$"),
    ],
)
def test_names_as_formulas(name, formula):
    assert style.symbol(name) == formula


def test_words_with_names():
    assert style.words("rho2x_high") == r"$\rho_{2x}$ high"
    assert style.words("L12-L23") == "$L_{12}$-$L_{23}$"
    assert style.words("no_real_solution") == "no real solution"
    assert style.value("sigma", 2.6e-17) == r"$\sigma$ = 0"


def test_a_mechanism_of_ones_own_is_drawn():
    @jk.mechanism
    class Lift(jk.Mechanism):
        """A platform that one prismatic joint lifts."""

        pose_axes = (jk.Axis("z", "length"),)
        joint_axes = (jk.Axis("q", "length"),)
        size: jnp.ndarray

        def constraints(self, pose, joints):
            return pose - joints

        def inverse_kernel(self, pose):
            zero = jnp.zeros_like(pose[0])
            return (Lane(pose, zero.astype(jnp.int8), (zero + 1).astype(jnp.int8), zero),)

        def bodies(self, pose):
            square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
            top = square + np.array([0.0, 0.0, float(pose[0])])
            return (
                Body("base", square, "base", closed=True),
                Body("q", np.stack([square[0], top[0]]), "actuated", limb=1),
                Body("platform", top, "platform", closed=True),
            )

    robot = Lift(size=jnp.asarray(1.0))
    ax = jk.plot.pose(robot, [0.5])
    assert legend(ax) == ["actuated joint", "base", "platform, det > 0"]
