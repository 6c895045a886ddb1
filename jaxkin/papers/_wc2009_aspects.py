"""What Wenger and Chablat 2009 say of aspects, basic regions and mode changes (text after Figs. 2 and 3)."""

import math

import jax
import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._samples import SEED
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture

#: Random joint values at which the modes of each aspect are counted, and further geometries whose aspects are counted.
_JOINTS, _GEOMETRIES = 4000, ((1.5, -0.7, 0.4), (1.0, 2.0, -1.25))
#: Joint values with six assembly modes.
_SIX = np.array([1.2, 1.0, 1.5])


def aspects_and_changes() -> Part:
    """Counts aspects and the modes in each, joins modes without a singularity, and draws both."""
    robot = rpr3.analytic(*printed.EXAMPLE)
    found = jk.aspects(robot, _box(3.0))
    checks = [count_check("aspects", "text after Fig. 2", "aspects of the example", 2, found.count)]
    for geometry in _GEOMETRIES:
        what = "aspects of c2 = {:g}, c3 = {:g}, d3 = {:g}".format(*geometry)
        member = jk.aspects(rpr3.analytic(*geometry), _box(3.0 * max(map(abs, geometry))))
        checks.append(count_check(f"aspects-{geometry[0]}", "conclusions", what, 2, member.count))
    checks += _modes_in_aspects(robot)
    change, more = _changes(robot)
    checks += more
    basic = jk.basic_regions(robot, jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400)))
    checks += _basic(robot, basic)
    pictures = {
        "aspects": Picture.of(
            jk.plot.aspects(found), "The two aspects of the example, in slices of the workspace [not in the paper]"
        ),
        "basic_regions": Picture.of(
            jk.plot.basic_regions(basic), "Basic regions and components over the section of Fig. 3 [not in the paper]"
        ),
        "mode_change": Picture.of(
            jk.plot.mode_change(change, robot), "A change of assembly mode that meets no singularity [not in the paper]"
        ),
    }
    return Part("Aspects and changes of assembly mode", tuple(checks), pictures)


def _box(reach: float) -> jk.Grid:
    return jk.Grid(x=(-reach, reach, 64), y=(-reach, reach, 64), phi=(-math.pi, math.pi, 64))


def _modes_in_aspects(robot: rpr3.AnalyticRPR3) -> list[Check]:
    """Holds that half of the modes lie in each aspect: the sign of det dF/dpose tells the two aspects apart."""
    joints = np.random.default_rng(SEED).uniform(0.1, 3.0, (_JOINTS, 3))
    modes = jax.vmap(jk.forward, in_axes=(None, 0))(robot, joints)
    values, valid = np.asarray(modes.values), np.asarray(modes.valid & (modes.multiplicity == 1))
    safe = np.where(valid[..., None], values, 1.0)
    measured = jax.vmap(jax.vmap(jk.conditioning, in_axes=(None, 0, None)), in_axes=(None, 0, 0))(robot, safe, joints)
    signs = np.where(valid, np.sign(np.asarray(measured.determinant)), 0)
    sides = np.stack([(signs > 0).sum(axis=1), (signs < 0).sum(axis=1)], axis=1)
    some = sides.sum(axis=1) > 0
    uneven = int(np.sum(sides[:, 0] != sides[:, 1]))
    what = f"joint values of {int(some.sum())} random ones where one aspect holds more modes than the other"
    note = "so three, two or one mode an aspect, where the paper says two in one of them"
    return [count_check("aspects-modes", "text after Fig. 2", what, 0, uneven, note)]


def _changes(robot: rpr3.AnalyticRPR3) -> tuple[jk.ModeChange, list[Check]]:
    """Joins every two of six modes that have one sign of det dF/dpose."""
    modes = np.asarray(jk.forward(robot, _SIX).values)
    sign = [float(jk.conditioning(robot, pose, _SIX).determinant) > 0 for pose in modes]
    pairs = [(a, b) for a in range(6) for b in range(a) if sign[a] == sign[b]]
    found = [jk.mode_change(robot, _SIX, modes[a], modes[b], encircle=False) for a, b in pairs]
    good = sum(change.found and change.verified for change in found)
    what = "pairs of modes of one aspect joined by a path that tracking verified, at rho = (1.2, 1, 1.5)"
    least = min((change.clearance for change in found if change.found), default=math.nan)
    note = f"smallest singular value on the way at least {least:.2g}"
    checks = [count_check("aspects-changes", "text after Fig. 2, conclusions", what, len(pairs), good, note)]
    across = next((a, b) for a in range(6) for b in range(a) if sign[a] != sign[b])
    apart = jk.mode_change(robot, _SIX, modes[across[0]], modes[across[1]])
    what = "paths found between modes of different aspects"
    checks.append(count_check("aspects-apart", "text after Fig. 2", what, 0, int(apart.found)))
    return max(found, key=lambda change: change.clearance if change.found else -1.0), checks


def _basic(robot: rpr3.AnalyticRPR3, basic: jk.BasicRegions) -> list[Check]:
    """Holds that every basic component with n modes lies under n / 2 basic regions of each aspect."""
    wrong = 0
    for component in basic.components:
        modes = int(jk.forward(robot, component.joints).count)
        sides = [sum(basic[k].sheets for k in component.regions if basic[k].sign == sign) for sign in (1, -1)]
        wrong += any(2 * side not in (0, modes) for side in sides)
    what = f"of {len(basic.components)} basic components, those with n modes not under n / 2 basic regions of an aspect"
    return [count_check("aspects-basic", "text after Fig. 3", what, 0, wrong)]
