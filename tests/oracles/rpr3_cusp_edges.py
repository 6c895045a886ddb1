"""The cusp edges of the analytic 3-RPR family in closed form, from its distance equations."""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np


class Edge(NamedTuple):
    """One of the three cusp edges of a robot of the analytic family: a line in the space of squared lengths.

    Attributes:
        phi: The platform's angle along the whole edge, in (-pi, pi].
        differences: (0, A, B): squared lengths r1, r1 - A, r1 - B.
        offset: h, the part of X across the half-angle's direction; the edge is real where r1 > h^2.
    """

    phi: float
    differences: tuple[float, float, float]
    offset: float

    def least(self, axis: int) -> float:
        """Returns the length of leg `axis` at which the edge begins; beyond it every section has this cusp."""
        return math.sqrt(max(self.offset**2 - self.differences[axis - 1], 0.0))

    def cusps(self, axis: int, value: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
        """Returns the joints and the two poses of the section's cusp on this edge; nothing where it is not real."""
        r1 = value**2 + self.differences[axis - 1]
        room = r1 - self.offset**2
        if room <= 0:
            return []
        joints = tuple(math.sqrt(r1 - d) for d in self.differences)
        c, s = math.cos(self.phi / 2), math.sin(self.phi / 2)
        h, p = self.offset, math.sqrt(room)
        return [(joints, (q * c - h * s, q * s + h * c, self.phi)) for q in (p, -p)]


def analytic_edges(c2: float, c3: float, d3: float) -> list[Edge]:
    """Returns the three cusp edges of the analytic family, by angle.

    With psi = phi/2, u = c2 sin psi, v = c3 sin psi - d3 cos psi, h = X . (-sin psi, cos psi), the legs give
    4 u h + 4 u^2 + A = 0 and 4 v h + 4 v^2 + B = 0, where A = r1 - r2 and B = r1 - r3, hence
    f = 4 u v (u - v) + A v - B u = 0. The first harmonic of f is free, the third is -Im(kappa z^3) with z = e^(i psi)
    and kappa = c2 (c3 - i d3)(c2 - c3 + i d3). A triple root has f + f'' = 0, and this is 8 Im(kappa z^3).
    """
    kappa = c2 * complex(c3, -d3) * complex(c2 - c3, d3)
    edges = []
    for k in range(3):
        psi = (math.pi * k - cmath.phase(kappa)) / 3
        s, c = math.sin(psi), math.cos(psi)
        u, v, du, dv = c2 * s, c3 * s - d3 * c, c2 * c, c3 * c + d3 * s
        # f = 0 and f' = 0 are linear in A and B.
        whole = 4 * u * v * (u - v)
        rate = 4 * (du * v + u * dv) * (u - v) + 4 * u * v * (du - dv)
        a, b = np.linalg.solve([[v, -u], [dv, -du]], [-whole, -rate])
        h = -a / (4 * u) - u if abs(u) > abs(v) else -b / (4 * v) - v
        edges.append(Edge(math.remainder(2 * psi, 2 * math.pi), (0.0, float(a), float(b)), float(h)))
    return sorted(edges, key=lambda edge: edge.phi)
