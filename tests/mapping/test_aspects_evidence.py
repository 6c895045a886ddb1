"""Aspects against dense scans that share nothing with them, at two resolutions, and under a clearance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

import jaxkin as jk
from jaxkin.kinematics.singularity import raw_conditioning
from jaxkin.mapping.aspects import aspects
from jaxkin.mechanisms import five_bar, rpr3


def _labelled(mask: np.ndarray) -> tuple[np.ndarray, int]:
    labels, count = ndimage.label(mask)  # type: ignore[misc]
    return labels, count


def scanned(base, proximal, distal, mode, n):
    """Returns the areas of the pieces of a five-bar's sheet, ascending, by labels of a dense array (four-neighbours).

    det A has the sign of the cross product of the rods; cranks by the law of cosines.
    """
    x, y = np.meshgrid(np.linspace(-6, 15, n), np.linspace(-13.5, 13.5, n), indexing="ij")
    rods, inside = [], np.ones(x.shape, bool)
    for pivot, long, short, sign in zip((0.0, base), proximal, distal, mode, strict=True):
        dx, r = x - pivot, np.hypot(x - pivot, y)
        cosine = (r**2 + long**2 - short**2) / (2 * long * np.maximum(r, 1e-9))
        inside &= np.abs(cosine) < 1
        angle = np.arctan2(y, dx) + sign * np.arccos(np.clip(cosine, -1, 1))
        rods.append((dx - long * np.cos(angle), y - long * np.sin(angle)))
    cross = rods[0][0] * rods[1][1] - rods[0][1] * rods[1][0]
    cell, areas = 21 * 27 / (n - 1) ** 2, []
    for sign in (1, -1):
        labels, count = _labelled(inside & (sign * cross > 0))
        areas += (ndimage.sum_labels(np.ones(x.shape), labels, np.arange(1, count + 1)) * cell).tolist()
    return np.sort(areas)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "proximal", "distal"),
    [(9.0, (8.0, 8.0), (5.0, 5.0)), (9.0, (7.0, 6.0), (5.0, 6.5)), (5.0, (4.0, 5.0), (6.0, 5.0))],
)
def test_pieces_of_five_bars_are_those_of_dense_scans(base, proximal, distal):
    robot = five_bar.create(base, proximal, distal)
    grid = jk.Grid(x=(-6.0, 15.0, 512), y=(-13.5, 13.5, 512))
    found = aspects(robot, grid)
    for mode in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        coarse, fine = (scanned(base, proximal, distal, mode, n) for n in (1000, 2000))
        # Pieces of a few samples come and go with the resolution.
        coarse, fine = (areas[areas > 0.02] for areas in (coarse, fine))
        assert len(coarse) == len(fine)
        own = np.sort([aspect.volume for aspect in found if aspect.working_mode == mode])
        own = own[own > 0.02]
        assert len(own) == len(fine), (mode, own, fine)
        assert np.allclose(own, fine, rtol=2e-2)


@pytest.mark.slow
def test_a_clearance_takes_away_what_is_nearly_singular():
    robot = rpr3.analytic(1.0, 0.0, 1.0)
    grid = jk.Grid(x=(-2.0, 2.0, 48), y=(-2.0, 2.0, 48), phi=(-np.pi, np.pi, 48))
    found = aspects(robot, grid, clearance=0.3)
    assert found.evidence["regularity of cells"] == "sampled"
    assert all(aspect.clearance > 0.3 for aspect in found)
    poses = np.random.default_rng(0).uniform([-2, -2, -np.pi], [2, 2, np.pi], (40_000, 3))

    def one(pose):
        return raw_conditioning(robot, pose, jk.inverse(robot, pose).values[0]).smallest_singular_value

    clear = np.asarray(jax.jit(jax.vmap(one))(jnp.asarray(poses))) > 0.3
    box = 16 * 2 * np.pi
    assert abs(found.volume.sum() - clear.mean() * box) < 5 * box * np.sqrt(0.25 / 40_000)
    for pose in poses[clear][:50]:
        k = found.aspect_of(pose)
        assert k == -1 or found[k].volume > 0
