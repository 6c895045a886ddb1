"""What is wrong or incomplete in Fu and Gao's paper on the TLPM, each with the checks that show it."""

from jaxkin.papers.report import Erratum

_MAYBE_EXTRACTION = "An index or a sign may be a slip of the text made from the print"

ERRATA = (
    Erratum(
        "Eq. (2), then (3)-(6)",
        "l_i0, later L_0",
        "one L_0 = sqrt(L^2 + h^2): the origin is where p is at zero strokes",
        "lengths of this package",
        ("eq2",),
    ),
    Erratum(
        "Eq. (4)",
        "second term L_0 l2, third term L_0 l2^2: the second cancels the fourth, the third is no length",
        "y = sqrt3 l3^2/6L + sqrt3 L_0 l3/3L - sqrt3 l2^2/6L - sqrt3 L_0 l2/3L",
        f"points that gave the strokes. {_MAYBE_EXTRACTION}; the spurious L_0 is not one",
        ("eq3-4", "eq4-printed", "eq4-P1"),
    ),
    Erratum(
        "Eqs. (3)-(6)",
        "at most two real solutions",
        "two, one in the base plane, or none; lengths below zero satisfy (3)-(6) as well, and have no pose",
        "counts, and z of (5) at such lengths",
        ("counts", "negative"),
    ),
    Erratum(
        "Table 1",
        "two poses, without h, L or strokes",
        "h = 590 mm follows, as the poses are mirror images in the base plane; any L fits",
        "both poses from one set of strokes, for two L",
        ("table1-h", "table1-590", "table1-834.386", "eq5-6-mirror"),
    ),
    Erratum(
        "Eqs. (7), (8)",
        "J_dir dx/dt = J_inv dl/dt with rows (q_i - p)/|q_i - p| and J_inv = 1; dx/dt named joint rates, dl/dt "
        "velocities",
        "J_inv = -1, or rows (p - q_i)/|p - q_i|; dx/dt is the velocity of p, and dl/dt has the rates of the joints",
        "strokes differentiated: off by a factor of -1",
        ("eq7", "eq7-printed", "eq10"),
    ),
    Erratum(
        "Eq. (9)",
        "dl/dt = J^-1 J_dir dx/dt, J = J_inv J_dir",
        "dl/dt = J_inv^-1 J_dir dx/dt, and J = J_inv^-1 J_dir; as it stands it says dl/dt = dx/dt",
        f"both evaluated. {_MAYBE_EXTRACTION}",
        ("eq9", "eq9-printed"),
    ),
    Erratum(
        "Eq. (11)",
        "fractions over u_i, which (12) has as squared lengths",
        "over sqrt(u_i)",
        "its determinant, which is (12) only after it is multiplied by the three lengths",
        ("eq11",),
    ),
    Erratum(
        "Eq. (12)",
        "det(J_dir)",
        "correct for the printed rows; det(dl/dp) is the opposite, positive above the base plane",
        "this package's Jacobian",
        ("eq12", "eq12-sign"),
    ),
    Erratum(
        "text after (12)",
        "det(J_dir) tends to 0 for p to q_i",
        "it tends to -(sqrt3/2) cos(gamma), gamma the angle between the way of approach and the z axis; at q_i itself "
        "it is undefined. The only singular surface is z = -h",
        "(12) close to each q_i",
        ("limit", "eq12-plane", "eq12-zero"),
    ),
    Erratum(
        "Eqs. (16)-(18)",
        "R_i0 = [x y z] with the tangent y of (15)",
        "y = z x x: the tangent is perpendicular to z only if p is in the limb's vertical plane, so that R_i0 as "
        "printed is no rotation",
        "y . z = -t_i . p/|q_i - p|, and the error that it makes in (23)",
        ("eq18-printed", "eq18", "eq23-printed"),
    ),
    Erratum(
        "matrix under (19)",
        "-s1 s2 in row 2, column 3",
        "+s1 s2",
        f"the product Rz(theta1) Ry(theta2). {_MAYBE_EXTRACTION}",
        ("eq19-matrix",),
    ),
    Erratum(
        "Eqs. (19), (21), (22)",
        "R_i1 not defined; two angles for a general rotation",
        "a third angle is needed, the active psi_i: R_i1 = Rz(psi_i) Rx(pi/2), then Rz(theta_i1) Ry(pi/2 - theta_i2) "
        "[ours]. With R_i1 = 1, (22) is psi_i + pi/2, and no angle of R1",
        "the chain closes; (22) and (23) beside this package's angles",
        ("eq19-closure", "eq19-two-angles", "eq22", "eq23"),
    ),
    Erratum(
        "Eq. (20)",
        "v_i",
        "for the platform's orientation 1 and eta_i2 = eta_i1; else v_i = Q Rz(eta_i2) Ry(beta2) Rx(pi/2) [ours]",
        "its second column is the R2 axis",
        ("eq20", "eq20-here"),
    ),
    Erratum(
        "text before (21), and (21)",
        "(25) and (26); R_i1 on the left",
        "(19) and (20); R_i2 on the left, and in (22) and (23)",
        "the paper has no (25)",
    ),
    Erratum(
        "Eq. (23)",
        "theta_i2",
        "-theta_i2 for angles that turn right-handed; for the other elbow atan2(-M31, -M33), half a turn further "
        "[ours]",
        "this package's angles, which close the chain",
        ("eq23", "eq23-elbow"),
    ),
    Erratum(
        "conditions for distances",
        "D > sqrt(a)",
        "D > sqrt2 a: sqrt(a) is no length. It is sufficient, and not necessary",
        f"two squares of side a at every roll. {_MAYBE_EXTRACTION}",
        ("distance",),
    ),
    Erratum(
        "condition for D_23i",
        "i = 1, 2, 3",
        "six pairs: L_i2 and L_j3 are not exchangeable",
        "pairs of links of different limbs",
        ("pairs",),
    ),
)
