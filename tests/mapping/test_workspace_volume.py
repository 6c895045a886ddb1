"""The volume of the stroke workspace: against other integrals, limit cases, laws, derivatives, refusals."""

import itertools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Limits
from jaxkin.mapping.workspace import workspace_volume
from jaxkin.mechanisms import rpr3, tlpm

THIRDS = np.array([0.0, 2 * math.pi / 3, -2 * math.pi / 3])
HOME = 590 * math.sqrt(2)
VOLUME_W1 = 72_322_565.930


class SquaredLengths:
    """The volume as an integral over s_i = |p - q_i|^2, dV = ds / (8 det(q2 - q1, q3 - q1) w): other coordinates.

    The square of the height is w^2 = s1 - |k + M s|^2, so that the integral over s1 is a difference of two arcsines;
    the other two are done by Gauss-Legendre between the places where the arcsines reach +-pi/2, roots of quadratics.
    """

    def __init__(self, centres, low, high):
        a, b = centres[1] - centres[0], centres[2] - centres[0]
        inverse = np.linalg.inv(np.stack([a, b]))
        self.m = inverse @ np.array([[1.0, -1.0, 0.0], [1.0, 0.0, -1.0]]) / 2
        self.k = inverse @ np.array([a @ a, b @ b]) / 2
        self.det = abs(a[0] * b[1] - a[1] * b[0])
        self.low, self.high = np.asarray(low, float) ** 2, np.asarray(high, float) ** 2
        self.a2 = self.m[:, 0] @ self.m[:, 0]

    def square(self, s1, s2, s3):
        away = self.k[:, None] + self.m @ np.stack(np.broadcast_arrays(s1, s2, s3))
        return s1 - np.sum(away**2, axis=0)

    def discriminant(self, s2, s3):
        rest = self.k[:, None] + self.m[:, 1:] @ np.stack(np.broadcast_arrays(s2, s3))
        slope = 1 - 2 * self.m[:, 0] @ rest
        return slope**2 - 4 * self.a2 * np.sum(rest**2, axis=0), slope

    def inner(self, s2, s3):
        disc, slope = self.discriminant(s2, s3)
        size = np.sqrt(np.maximum(disc, 1e-300))
        ends = [np.arcsin(np.clip((2 * self.a2 * s - slope) / size, -1, 1)) for s in (self.low[0], self.high[0])]
        return np.where(disc > 0, ends[1] - ends[0], 0.0) / math.sqrt(self.a2)

    def _functions(self):
        yield lambda s2, s3: self.square(self.low[0], s2, s3)
        yield lambda s2, s3: self.square(self.high[0], s2, s3)
        yield lambda s2, s3: self.discriminant(s2, s3)[0]

    def _roots(self, function, low, high):
        """Real roots of a quadratic between two values, and its stationary values' roots."""
        t = np.array([-1.0, 0.0, 1.0])
        middle, half = (low + high) / 2, (high - low) / 2
        f = np.concatenate([function(np.array([middle + half * x])) for x in t])
        coefficients = [(f[0] + f[2]) / 2 - f[1], (f[2] - f[0]) / 2, f[1]]
        roots = np.roots(coefficients)
        roots = roots[np.abs(roots.imag) < 1e-12].real
        return middle + half * roots[np.abs(roots) < 1]

    def _along_s3(self, s2, n):
        breaks = np.concatenate(
            [self._roots(lambda s3, f=f: f(s2, s3), self.low[2], self.high[2]) for f in self._functions()]
        )
        return _gauss(lambda s3: self.inner(s2, s3), self.low[2], self.high[2], breaks, n)

    def _tangent(self, function):
        """Roots in s2 of the discriminant, in s3, of a quadratic: there two of its zeros meet."""
        x = np.array([-1.0, 0.0, 1.0])
        middle, half = (self.low[2] + self.high[2]) / 2, (self.high[2] - self.low[2]) / 2

        def discriminant(s2):
            f = [function(s2, middle + half * t) for t in x]
            return ((f[2] - f[0]) / 2) ** 2 - 4 * ((f[0] + f[2]) / 2 - f[1]) * f[1]

        return self._roots(discriminant, self.low[1], self.high[1])

    def volume(self, n):
        breaks = [self._tangent(f) for f in self._functions()]
        for f in self._functions():
            breaks += [
                self._roots(lambda s2, f=f, s3=s3: f(s2, s3), self.low[1], self.high[1])
                for s3 in (self.low[2], self.high[2])
            ]
        total = _gauss(
            lambda values: np.array([self._along_s3(s2, n) for s2 in values]),
            self.low[1],
            self.high[1],
            np.concatenate(breaks),
            n,
        )
        return total / (8 * self.det)


def _gauss(function, low, high, breaks, n):
    x, weights = np.polynomial.legendre.leggauss(n)
    t = (x + 1) / 2
    ends = np.unique(np.concatenate([[low], breaks, [high]]))
    total = 0.0
    for a, b in itertools.pairwise(ends):
        total += (
            (b - a)
            * np.sum(function(a + (b - a) * np.sin(math.pi * t / 2) ** 2) * np.sin(math.pi * t) * weights)
            * math.pi
            / 4
        )
    return total


def shells_of(robot):
    shells, plane = robot.reach_spheres()
    return tuple(np.asarray(a) for a in shells), float(plane)


def oracle(robot, n=24):
    return SquaredLengths(*shells_of(robot)[0]).volume(n)


def smooth_integral(robot, n=40):
    """Gauss-Legendre in all three squared lengths, where no corner of the strokes' cube is below the plane."""
    (centres, low, high), _ = shells_of(robot)
    reference = SquaredLengths(centres, low, high)
    x, weights = np.polynomial.legendre.leggauss(n)
    middle, half = (reference.low + reference.high) / 2, (reference.high - reference.low) / 2
    s = np.stack(np.meshgrid(*(middle[k] + half[k] * x for k in range(3)), indexing="ij")).reshape(3, -1)
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).reshape(-1) * np.prod(half)
    return float(np.sum(weight / np.sqrt(reference.square(*s))) / (8 * reference.det))


def random_design(seed, reach):
    rng = np.random.default_rng(seed)
    low = -reach * rng.uniform(0.6, 1.0, 3)
    high = reach * rng.uniform(0.6, 1.0, 3)
    return tlpm.create(
        base_radius=rng.uniform(400, 800),
        height=rng.uniform(400, 800),
        stroke=(low, high),
        initial_lengths=HOME + rng.uniform(-50, 50, 3),
        limb_angles=THIRDS + rng.uniform(-0.25, 0.25, 3),
    )


def test_known_volume():
    found = workspace_volume(tlpm.create())
    # Gauss-Legendre in the squared lengths with 40 and 60 points a side agrees to 1e-14.
    assert float(found.volume) == pytest.approx(VOLUME_W1, abs=1e-3)
    assert float(found.volume) == pytest.approx(smooth_integral(tlpm.create()), rel=1e-13)
    assert 0 < float(found.error) < 1e-4
    assert not bool(found.touches)
    assert float(found.flat) == 0


@pytest.mark.parametrize("stroke", [(-200.0, 200.0), (-120.0, 30.0), (50.0, 60.0), (-1.0, 1.0), (-200.0, 0.0)])
def test_smooth_workspaces(stroke):
    robot = tlpm.create(stroke=stroke)
    found = workspace_volume(robot)
    assert float(found.volume) == pytest.approx(smooth_integral(robot), rel=2e-13)
    assert abs(float(found.volume) - smooth_integral(robot)) <= float(found.error) + 1e-13 * float(found.volume)


@pytest.mark.parametrize("half", [1e-3, 1e-5])
def test_tiny_strokes_lose_no_more_than_their_own_rounding(half):
    robot = tlpm.create(stroke=(-half, half))
    found = workspace_volume(robot)
    exact = 8 * half**3 / float(np.linalg.det(np.asarray(tlpm.stroke_jacobian(robot, jnp.zeros(3)))))
    assert float(found.volume) == pytest.approx(exact, rel=1e-14 * HOME / half + 10 * (half / HOME) ** 2)
    assert abs(float(found.volume) - exact) <= float(found.error) + 10 * exact * (half / HOME) ** 2


@pytest.mark.parametrize(
    "stroke",
    [
        (-400.0, 400.0),
        (-300.0, 300.0),
        (-600.0, 0.0),
        (-245.0, 0.0),
        (-830.0, 2000.0),
        (-200.0, 5000.0),
        (-800.0, -200.0),
    ],
)
def test_touching_workspaces(stroke):
    robot = tlpm.create(stroke=stroke)
    found = workspace_volume(robot)
    assert bool(found.touches)
    assert float(found.flat) > 0
    exact = oracle(robot, 48)
    assert exact == pytest.approx(oracle(robot, 32), rel=1e-9)
    assert float(found.volume) == pytest.approx(exact, rel=1e-9)
    assert float(found.error) <= 1e-9 * exact


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_designs(seed):
    robot = random_design(seed, 150.0 if seed % 3 else 450.0)
    found = workspace_volume(robot)
    assert float(found.volume) == pytest.approx(oracle(robot), rel=1e-9)
    assert float(found.error) <= 1e-8 * float(found.volume)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 200))
def test_many_random_designs(seed):
    robot = random_design(seed, 100.0 * (1 + seed % 7))
    found = workspace_volume(robot)
    exact, finer = oracle(robot), oracle(robot, 40)
    assert abs(float(found.volume) - finer) <= 1e-9 * finer + 2 * abs(finer - exact)


def test_shells_almost_closed_give_the_three_balls():
    """Inner spheres of almost no radius take nothing: three half balls intersect, here by sampling heights."""
    almost = tlpm.create(stroke=(-HOME + 1e-6, 0.0))
    w = (np.arange(4000) + 0.5) / 4000 * HOME
    x = np.linspace(-HOME, 2 * HOME, 3001)
    # Two coarse sums against the value: an area per height from columns in y.
    (centres, _, high), _ = shells_of(almost)
    areas = []
    for height in w[50::100]:
        disc = high**2 - height**2
        chord = np.sqrt(np.maximum(disc[:, None] - (x - centres[:, :1]) ** 2, 0.0))
        top, bottom = (centres[:, 1:] + chord).min(axis=0), (centres[:, 1:] - chord).max(axis=0)
        inside = np.all((x - centres[:, :1]) ** 2 < disc[:, None], axis=0)
        areas.append(np.sum(np.where(inside, np.maximum(top - bottom, 0.0), 0.0)) * (x[1] - x[0]))
    rough = np.sum(areas) * HOME / 40
    assert float(workspace_volume(almost).volume) == pytest.approx(rough, rel=2e-2)
    assert float(workspace_volume(almost).volume) == pytest.approx(oracle(almost), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("stroke", [(-200.0, 200.0), (-400.0, 400.0)])
def test_by_throwing_points(stroke):
    robot = tlpm.create(stroke=stroke)
    (centres, low, high), _ = shells_of(robot)
    rng = np.random.default_rng(5)
    box_low = np.append((centres - high[:, None]).max(axis=0), 0.0)
    box_high = np.append((centres + high[:, None]).min(axis=0), high.min())
    points = box_low + rng.random((400_000, 3)) * (box_high - box_low)
    distance = np.sqrt(np.sum((points[:, None, :2] - centres) ** 2, axis=-1) + points[:, 2:] ** 2)
    share = np.mean(np.all((distance > low) & (distance < high), axis=1))
    box = np.prod(box_high - box_low)
    deviation = box * math.sqrt(share * (1 - share) / len(points))
    assert abs(float(workspace_volume(robot).volume) - share * box) < 4 * deviation


def test_strokes_that_reach_nothing():
    # Limbs of 300 mm do not meet over a circle of 590 mm.
    found = workspace_volume(tlpm.create(stroke=(-634.0, -534.0)))
    assert float(found.volume) == 0
    assert not bool(found.touches)
    p = parameters(tlpm.create(stroke=(-634.0, -534.0)))
    np.testing.assert_array_equal(gradient(p), 0.0)


def test_one_point_of_contact():
    """Longest limbs equal to the base's radius meet in one point of the plane; a little longer, in a small volume."""
    shortest = 590.0 - 400.0
    point = tlpm.create(stroke=(shortest - HOME, 590.0 - HOME))
    assert float(workspace_volume(point).volume) < 1e-3
    volumes = [
        float(workspace_volume(tlpm.create(stroke=(shortest - HOME, 590.0 - HOME + d))).volume) for d in (0.1, 0.01)
    ]
    # Three balls meet over a triangle of sides ~ d and height ~ sqrt(d): the volume grows as d^(5/2).
    assert math.log10(volumes[0] / volumes[1]) == pytest.approx(2.5, abs=0.01)


def test_branches_have_equal_volumes():
    for stroke in ((-200.0, 200.0), (-400.0, 400.0)):
        upper, lower = (workspace_volume(tlpm.create(stroke=stroke), branch) for branch in ("upper", "lower"))
        assert float(upper.volume) == float(lower.volume)
        assert lower.branch == "lower"


def test_laws_of_scale_and_of_parts():
    one, two = tlpm.create(stroke=(-300.0, 300.0)), tlpm.create(1180.0, 1180.0, (-600.0, 600.0))
    assert float(workspace_volume(two).volume) == pytest.approx(8 * float(workspace_volume(one).volume), rel=1e-11)
    # The cube of strokes, cut in eight.
    parts = 0.0
    for k in range(8):
        sides = [(-300.0, 40.0) if k >> m & 1 else (40.0, 300.0) for m in range(3)]
        parts += float(workspace_volume(tlpm.create(stroke=tuple(zip(*sides, strict=True)))).volume)
    assert parts == pytest.approx(float(workspace_volume(one).volume), rel=1e-10)


def parameters(robot):
    return np.concatenate(
        [
            np.ravel(x)
            for x in (
                robot.base_radius,
                robot.height,
                robot.limits.low,
                robot.limits.high,
                robot.initial_lengths,
                robot.limb_angles,
            )
        ]
    )


def volume_of(p):
    robot = tlpm.create(p[0], p[1], jnp.stack([p[2:5], p[5:8]]), p[8:11], limb_angles=p[11:14])
    return workspace_volume(robot).volume


UNITS = np.array([590.0] * 11 + [1.0] * 3)
value, gradient = jax.jit(jax.vmap(volume_of)), jax.jit(jax.grad(volume_of))


def differences(function, p, units, step):
    """Central differences with Richardson's extrapolation, per parameter, times its unit."""
    moves = np.concatenate([h * np.diag(units) for h in (step, -step, step / 2, -step / 2)])
    a, b, c, d = np.asarray(function(p + moves)).reshape(4, -1)
    coarse, fine = (a - b) / (2 * step), (c - d) / step
    return fine + (fine - coarse) / 3


@pytest.mark.parametrize(
    "robot",
    [
        tlpm.create(),
        tlpm.create(stroke=(-400.0, 400.0)),
        tlpm.create(stroke=(-300.0, 300.0)),
        *(random_design(seed, reach) for seed, reach in ((1, 150.0), (2, 450.0), (3, 300.0))),
    ],
)
def test_derivatives_against_differences(robot):
    p = parameters(robot)
    slopes = differences(value, p, UNITS, 2e-4)
    np.testing.assert_allclose(np.asarray(gradient(p)) * UNITS, slopes, atol=1e-6 * np.max(np.abs(slopes)))


@pytest.mark.slow
def test_areas_of_faces_are_derivatives_of_the_volume():
    for stroke in ((-200.0, 200.0), (-400.0, 390.0)):
        robot = tlpm.create(stroke=stroke)
        slope = np.asarray(gradient(parameters(robot)))[2:8].reshape(2, 3).T
        np.testing.assert_allclose(slope * [-1.0, 1.0], workspace_volume(robot).areas, rtol=1e-7)


def test_default_initial_lengths_carry_the_derivative():
    def volume(p):
        return workspace_volume(tlpm.create(p[0], p[1], p[2:])).volume

    slope = jax.jit(jax.grad(volume))
    for stroke in (200.0, 400.0):
        p = np.array([590.0, 590.0, -stroke, stroke])
        expected = differences(jax.jit(jax.vmap(volume)), p, np.full(4, 590.0), 2e-4)
        np.testing.assert_allclose(np.asarray(slope(p)) * 590, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_jit_vmap_and_a_map_of_designs():
    radii = jnp.linspace(400.0, 900.0, 5)
    many = jax.jit(jax.vmap(lambda radius: workspace_volume(tlpm.create(radius, 590.0, (-200.0, 200.0)))))(radii)
    single = [float(workspace_volume(tlpm.create(float(r), 590.0, (-200.0, 200.0))).volume) for r in radii]
    np.testing.assert_allclose(many.volume, single, rtol=1e-12)
    assert many.touches.shape == (5,)
    assert "shape (5,)" in str(many)


def test_bad_limits_inside_jit_give_nan():
    value = jax.jit(lambda low: workspace_volume(tlpm.create(stroke=jnp.stack([low, 100.0]))).volume)
    assert math.isnan(float(value(200.0)))
    assert math.isnan(float(value(-900.0)))
    assert float(value(-100.0)) > 0


def test_text_and_json():
    found = workspace_volume(tlpm.create(stroke=(-400.0, 400.0)), "lower")
    assert "mm^3" in str(found)
    assert "meets the singular plane" in str(found)
    assert len(str(found).splitlines()) <= 4
    content = json.loads(found.to_json())
    assert content["volume"] == float(found.volume)
    assert content["request"]["branch"] == "lower"
    assert content["request"]["geometry"]["base_radius"] == 590


def test_refusals():
    robot = tlpm.create()
    with pytest.raises(InputError, match="did you mean 'upper'"):
        workspace_volume(robot, "uper")
    with pytest.raises(InputError, match="reach_spheres"):
        workspace_volume(rpr3.reference())
    with pytest.raises(InputError, match="as its mechanism"):
        workspace_volume(590.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"jax\.vmap"):
        workspace_volume(jax.vmap(lambda r: tlpm.create(r))(jnp.array([500.0, 600.0])))
    bad = {
        "empty; give limits of l2": Limits(jnp.array([-1.0, 5.0, -1.0]), jnp.array([1.0, 4.0, 1.0])),
        "raise the lower limit of l3": Limits(jnp.array([-1.0, -1.0, -900.0]), jnp.ones(3)),
        "finite limits of l1": Limits(-jnp.ones(3), jnp.array([jnp.inf, 1.0, 1.0])),
    }
    for text, limits in bad.items():
        with pytest.raises(GeometryError, match=text):
            workspace_volume(robot.replace(limits=limits))
    with pytest.raises(GeometryError, match="degenerate"):
        workspace_volume(robot.replace(limb_angles=jnp.zeros(3)))
