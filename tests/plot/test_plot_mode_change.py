import matplotlib

matplotlib.use("Agg")
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import jaxkin as jk

ROBOT = jk.mechanisms.rpr3.reference()
JOINTS = np.array([14.98, 15.38, 12.0])


@pytest.fixture(scope="module")
def found() -> jk.ModeChange:
    modes = jk.forward(ROBOT, JOINTS)
    # Both poses have det dF/dpose > 0; the box holds both.
    grid = jk.Grid(x=(-20.0, 5.0, 20), y=(-18.0, 12.0, 20), phi=(-0.8, 1.0, 20))
    result = jk.mode_change(ROBOT, JOINTS, modes.values[1], modes.values[2], grid)
    assert result.found
    return result


def path_of(ax) -> np.ndarray:
    """Returns the path in a panel: the widest line."""
    line = max(ax.lines, key=lambda line: (line.get_linewidth(), len(np.atleast_2d(line.get_xdata()).T)))
    return np.array(line.get_data_3d()).T if ax.name == "3d" else line.get_xydata()


def test_mechanisms_workspace_joint_space_and_clearance_stand_side_by_side(found):
    panels = jk.plot.mode_change(found, ROBOT)
    assert [ax.name for ax in panels] == ["rectilinear"] * 5 + ["3d", "3d", "rectilinear"]
    assert [ax.get_title() for ax in panels[:5]] == ["1: start", "2", "3", "4", "5: goal"]
    np.testing.assert_array_equal(path_of(panels[5]), found.poses)
    np.testing.assert_array_equal(path_of(panels[6]), found.joints)
    np.testing.assert_array_equal(path_of(panels[7])[:, 1], found.clearances)
    assert panels[5].get_zlabel() == r"$\phi$ (rad)"
    assert panels[6].get_xlabel() == r"$\rho_{1}$ (length)"
    assert f"{found.clearance:.3g}" in panels[0].figure.get_suptitle()


def test_the_mechanism_is_drawn_at_start_and_goal_in_one_picture_frame(found):
    panels = jk.plot.mode_change(found, ROBOT)
    for ax, pose in ((panels[0], found.poses[0]), (panels[4], found.poses[-1])):
        _, platform = ROBOT.outline(pose)
        drawn = [line.get_xydata() for line in ax.lines]
        assert any(points.shape == platform.shape and np.allclose(points, platform) for points in drawn)
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in panels[:5]}) == 1


def test_a_loop_has_one_mark_where_it_starts_and_ends(found):
    panels = jk.plot.mode_change(found)
    assert len(panels) == 3
    assert [text.get_text() for text in panels[0].texts] == ["1", "2", "3", "4", "5"]
    assert "1, 5" in [text.get_text() for text in panels[1].texts]


def cusp_curves(found) -> jk.CuspCurves:
    """Returns two cusp curves of no robot, the first one closed."""
    turn = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([10 + 3 * np.cos(turn), 9 + 3 * np.sin(turn), 10 + 0 * turn], axis=1)
    line = np.stack([0 * turn + 12, turn + 5, 30 - turn], axis=1)
    parts = tuple(
        jk.CuspCurve(
            name=f"cusp curve {k + 1}",
            joints=joints,
            poses=np.zeros((40, 3)),
            closed=k == 0,
            residual=0.0,
            ends=("", ""),
            label="",
            critical=np.zeros(0, int),
        )
        for k, joints in enumerate((ring, line))
    )
    return jk.CuspCurves(parts, {"section": {}}, found.pose_names, found.joint_names, found.units)


def test_cusp_curves_are_behind_the_loop_and_in_the_picture(found):
    curves = cusp_curves(found)
    panels = jk.plot.mode_change(replace(found, encircled=("cusp curve 1",)), curves=curves)
    shown = [np.array(line.get_data_3d()).T for line in panels[1].lines]
    assert all(any(np.array_equal(c.joints, line[: len(c.joints)]) for line in shown) for c in curves)
    # Names are those of another box than the one in which the record looked: none is called encircled.
    assert [text.get_text() for text in panels[1].get_legend().get_texts()] == ["cusp curves"]
    low, high = panels[1].get_zlim()
    assert low <= found.joints[:, 2].min()
    assert high >= 30.0


def test_a_section_that_the_loop_leaves_is_refused(found):
    section = {"rho1": 14.98, "rho2": [5.0, 30.0, 6], "rho3": [5.0, 30.0, 6]}
    names = (found.pose_names, found.joint_names, found.units)
    curves = jk.SingularCurves((), jk.Crossings(*np.zeros((3, 0, 3))), {"section": section}, *names)
    with pytest.raises(jk.InputError, match="leaves the section rho1"):
        jk.plot.mode_change(found, curves=curves)


def test_what_was_not_found_is_refused_with_its_reason(found):
    missing = replace(found, found=False, reason="det B = 0 lies between")
    with pytest.raises(jk.InputError, match="det B = 0 lies between"):
        jk.plot.mode_change(missing)
    with pytest.raises(jk.InputError, match="det B = 0 lies between"):
        jk.plot.animate_mode_change(missing, "never.gif")


def test_two_poses_without_a_path_are_drawn_with_the_reason():
    modes = jk.forward(ROBOT, JOINTS)
    apart = jk.mode_change(ROBOT, JOINTS, modes.values[0], modes.values[1])
    assert not apart.found
    panels = jk.plot.mode_change(apart, ROBOT)
    assert [ax.get_title() for ax in panels] == ["start", "goal"]
    assert "not in the same aspect" in panels[0].figure.get_suptitle().replace("\n", " ")
    for ax, pose in zip(panels, (modes.values[0], modes.values[1]), strict=True):
        _, platform = ROBOT.outline(pose)
        assert any(
            np.allclose(line.get_xydata()[: len(platform)], platform) for line in ax.lines if len(line.get_xdata()) == 4
        )


def test_the_moving_picture_runs_from_start_to_goal(found, tmp_path):
    path = jk.plot.animate_mode_change(found, tmp_path / "change.gif", ROBOT, frames=4, seconds=1.0)
    with Image.open(path) as picture:
        assert (picture.n_frames, picture.info["duration"]) == (4, 250)
        frames = []
        for k in range(4):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB")).astype(int))
    assert all(np.abs(a - b).max() > 50 for a, b in zip(frames[1:], frames[:-1], strict=True))
    assert [p.name for p in tmp_path.iterdir()] == ["change.gif"]
    assert not plt.get_fignums()


def test_a_file_that_is_there_is_not_replaced_unawares(found, tmp_path):
    path = tmp_path / "change.gif"
    path.write_bytes(b"kept")
    with pytest.raises(jk.StoreError, match="overwrite=True"):
        jk.plot.animate_mode_change(found, path)
    assert path.read_bytes() == b"kept"
    jk.plot.animate_mode_change(found, path, frames=2, overwrite=True)
    assert path.read_bytes()[:4] == b"GIF8"


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("change.png", {}, "must be one of"),
        ("change.gif", {"frames": 1}, "at least 2 frames"),
        ("change.gif", {"seconds": 0.0}, "positive"),
    ],
)
def test_other_files_and_numbers_are_refused(found, tmp_path, name, options, message):
    with pytest.raises(jk.InputError, match=message):
        jk.plot.animate_mode_change(found, tmp_path / name, **options)


def test_a_missing_folder_and_a_missing_ffmpeg_are_told(found, tmp_path, monkeypatch):
    with pytest.raises(jk.StoreError, match="no folder"):
        jk.plot.animate_mode_change(found, tmp_path / "none" / "change.gif")
    monkeypatch.setattr("matplotlib.animation.writers.is_available", lambda name: False)
    with pytest.raises(jk.InputError, match="ffmpeg"):
        jk.plot.animate_mode_change(found, tmp_path / "change.mp4")
