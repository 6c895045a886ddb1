"""What conditions leave of the stroke workspace: against exact volumes, counting, and limit cases."""

import dataclasses
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Limits, Mechanism
from jaxkin.mapping.workspace import free_volume, workspace_volume
from jaxkin.mechanisms import rpr3, tlpm

HOME = 590 * math.sqrt(2)


@jk.mechanism
class Conditioned(tlpm.TLPM):
    """A TLPM whose conditions besides the strokes have exact volumes.

    Attributes:
        longest: Limbs shorter than these, ``(3,)``, mm.
        plane: ``(4,)`` half space a x + b y + c z > d.
        hole: ``(4,)`` centre and radius of a ball to stay out of.
        slab: Thickness of a horizontal layer to stay out of, around z = 3.
    """

    longest: jax.Array = dataclasses.field(kw_only=True)
    plane: jax.Array = dataclasses.field(kw_only=True)
    hole: jax.Array = dataclasses.field(kw_only=True)
    slab: jax.Array = dataclasses.field(kw_only=True)

    def margins(self, pose, joints):
        margins = Mechanism.margins(self, pose, joints)
        for k in range(3):
            margins[f"shorter{k + 1}"] = self.longest[k] - self.initial_lengths[k] - joints[..., k]
        margins["side"] = pose @ self.plane[:3] - self.plane[3]
        margins["hole"] = jnp.sqrt(jnp.sum((pose - self.hole[:3]) ** 2, axis=-1)) - self.hole[3]
        margins["slab"] = jnp.abs(pose[..., 2] - 3.0) - self.slab / 2
        return margins


def conditioned(stroke=(-200.0, 200.0), longest=(5e3,) * 3, plane=(0.0, 0.0, 0.0, -1.0), hole=(0, 0, 0, -1), slab=-1.0):
    robot = tlpm.create(stroke=stroke)
    fields = {field.name: getattr(robot, field.name) for field in dataclasses.fields(robot)}
    extra = {"longest": longest, "plane": plane, "hole": hole, "slab": slab}
    return Conditioned(**fields, **{name: jnp.asarray(value, float) for name, value in extra.items()})


def agrees(found, exact):
    # The error is a standard error of eight shifts, so it is exceeded now and then, by far hardly ever.
    assert abs(found.volume - exact) <= 4 * found.error
    return True


@pytest.mark.parametrize("branch", ["upper", "lower"])
@pytest.mark.parametrize("stroke", [(-200.0, 200.0), (-400.0, 400.0)])
def test_shorter_limbs_are_another_workspace(stroke, branch):
    """Conditions |p - q_i| < longest_i leave the workspace of shorter strokes, whose volume is known exactly."""
    high = (60.0, 120.0, 5e3)
    found = free_volume(conditioned(stroke, longest=[HOME + x for x in high]), branch)
    limits = [(stroke[0], min(stroke[1], x)) for x in high]
    exact = float(workspace_volume(tlpm.create(stroke=tuple(zip(*limits, strict=True)))).volume)
    assert agrees(found, exact)
    assert found.volume == pytest.approx(exact, rel=4e-3)
    assert found.converged
    assert found.error <= 1e-3 * found.volume
    assert set(found.violated) == {"shorter1", "shorter2"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_half_of_a_symmetric_workspace(seed):
    """The planes through the axis and a limb are mirrors."""
    eta = 2 * math.pi / 3 * (seed % 3)
    plane = (-math.sin(eta), math.cos(eta), 0.0, 0.0)
    found = free_volume(conditioned((-300.0, 300.0), plane=plane), seed=seed)
    assert agrees(found, found.workspace / 2)
    assert found.share == pytest.approx(0.5, abs=4e-3)
    assert found.violated == pytest.approx({"side": 1.0})
    assert found.alone == pytest.approx({"side": 1.0})


def test_a_hole_takes_its_own_volume():
    found = free_volume(conditioned(hole=(10.0, -20.0, 15.0, 90.0)), tolerance=3e-4)
    assert agrees(found, found.workspace - 4 / 3 * math.pi * 90.0**3)
    assert found.volume == pytest.approx(found.workspace - 4 / 3 * math.pi * 90.0**3, rel=1.2e-3)


@pytest.mark.slow
def test_a_layer_thinner_than_the_first_cells():
    robot = conditioned(slab=0.5)
    found = free_volume(robot, tolerance=1e-3)
    # Area of the workspace at that height, as the derivative of the volume with respect to where a floor cuts it off.
    cuts = [free_volume(conditioned(plane=(0, 0, 1.0, 3.0 + d)), tolerance=1e-3).volume for d in (-30.0, 30.0)]
    area = (cuts[0] - cuts[1]) / 60
    assert found.workspace - found.volume == pytest.approx(0.5 * area, rel=0.15)
    assert found.error > abs(found.workspace - found.volume - 0.5 * area) / 2


def test_nothing_and_everything_removed():
    robot = conditioned()
    found = free_volume(robot)
    assert found.volume == float(workspace_volume(robot).volume)
    assert found.violated == {}
    assert found.converged
    assert 0 < found.error < 1e-3 * found.volume
    for everything in ({"plane": (0.0, 0.0, 0.0, 1.0)}, {"hole": (0.0, 0.0, 0.0, 1e4)}):
        found = free_volume(conditioned(**everything))
        assert found.volume == 0
        assert found.share == 0
        assert found.converged


def test_what_is_not_a_number_is_not_free():
    assert free_volume(conditioned(plane=(0.0, 0.0, 0.0, math.nan))).volume == 0


def test_shares_of_the_conditions():
    """Two half spaces that leave a wedge; shares by symmetry."""
    robot = conditioned(longest=(HOME, HOME, HOME))
    found = free_volume(robot)
    assert found.volume == pytest.approx(float(workspace_volume(tlpm.create(stroke=(-200.0, 0.0))).volume), rel=5e-3)
    assert found.violated["shorter1"] == pytest.approx(found.violated["shorter3"], rel=2e-2)
    assert found.alone["shorter1"] == pytest.approx(found.alone["shorter2"], rel=3e-2)
    # Inclusion and exclusion: alone in exactly one, violated counts every one.
    assert sum(found.alone.values()) < 1 < sum(found.violated.values())


def counted(robot, branch, number, seed=3):
    """Free share of the workspace by counting random points in it, and its standard deviation."""
    rng = np.random.default_rng(seed)
    shells, plane = robot.reach_spheres()
    (centres, low, high), sign = (np.asarray(a) for a in shells), 1 if branch == "upper" else -1
    box = rng.uniform([-500, -500, 0], [500, 500, float(high.min())], (number, 3))
    distance = np.sqrt(np.sum((box[:, None, :2] - centres) ** 2, axis=-1) + box[:, 2:] ** 2)
    poses = jnp.asarray(box[np.all((distance > low) & (distance < high), axis=1)] * [1, 1, sign] + [0, 0, float(plane)])
    joints = jax.vmap(lambda pose: jnp.stack(robot.inverse_kernel(tuple(pose))[0].values))(poses)
    free = np.min(np.stack(list(jax.vmap(robot.margins)(poses, joints).values())), axis=0) > 0
    return free.mean(), math.sqrt(free.mean() * (1 - free.mean()) / len(free))


@pytest.mark.slow
def test_against_counting_for_a_tilted_platform():
    angle = 0.35
    robot = tlpm.create(orientation=(math.cos(angle), 0.0, math.sin(angle), 0.0), a=40.0)
    found = free_volume(robot, tolerance=5e-3)
    share, deviation = counted(robot, "upper", 150_000)
    assert 0.01 < share < 0.99
    assert abs(found.share - share) < 4 * deviation + 4 * found.error / found.workspace


@pytest.mark.slow
def test_lower_branch_is_practically_blocked():
    """[ours] The wrist is not mirror symmetric: of the lower branch about 0.1 % are left at the identity, elbows +1."""
    robot = tlpm.create()
    found = free_volume(robot, "lower", tolerance=3e-3)
    share, deviation = counted(robot, "lower", 300_000)
    assert abs(found.share - share) < 4 * deviation + 4 * found.error / found.workspace
    assert 0.0005 < found.share < 0.002
    assert max(found.violated, key=lambda name: found.violated[name]).endswith("_low")
    assert free_volume(robot).share > 0.9


def test_same_seed_same_numbers():
    robot = conditioned(plane=(1.0, 0.3, 0.2, 5.0))
    one, two, other = (free_volume(robot, tolerance=1e-2, seed=seed) for seed in (1, 1, 2))
    assert one.volume == two.volume != other.volume
    assert one.request["seed"] == 1


@pytest.mark.slow
def test_cap_is_told():
    found = free_volume(conditioned(plane=(1.0, 0.0, 0.0, 5.0)), tolerance=1e-6, most_columns=4000)
    assert not found.converged
    assert "NOT reached" in str(found)
    assert found.columns <= 4000


def test_text_and_json():
    found = free_volume(conditioned(plane=(1.0, 0.0, 0.0, 0.0)), tolerance=1e-2)
    assert "% of the upper branch" in str(found)
    assert "side: violated" in str(found)
    content = json.loads(found.to_json())
    assert content["volume"] == found.volume
    assert content["request"]["tolerance"] == 1e-2


def test_refusals():
    robot = tlpm.create()
    with pytest.raises(InputError, match="did you mean"):
        free_volume(robot, "Upper")
    with pytest.raises(InputError, match="tolerance is 0"):
        free_volume(robot, tolerance=0)
    with pytest.raises(InputError, match="most_columns"):
        free_volume(robot, most_columns=0)
    with pytest.raises(InputError, match="reach_spheres"):
        free_volume(rpr3.reference())
    with pytest.raises(InputError, match="cannot be traced"):
        jax.jit(lambda r: free_volume(tlpm.create(r)).volume)(590.0)
    with pytest.raises(GeometryError, match="empty"):
        free_volume(robot.replace(limits=Limits(jnp.ones(3), -jnp.ones(3))))
