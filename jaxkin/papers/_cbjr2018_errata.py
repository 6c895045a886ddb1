"""What is wrong or incomplete in Chablat, Baron, Jha and Rolland 2018, each with the checks that show it."""

from jaxkin.papers.report import Erratum

_ONE_SOURCE = "All four of (12), (14) and (15) take C2x for +rho2y, which (3), (8) and (21) have as -rho2y"

ERRATA = (
    Erratum(
        "Eq. (2)",
        "origins A_i of the legs",
        "they are in no equation: C_i of (3) is measured from O. They only say from where a passive joint is counted",
        "joints with other A_i",
        ("eq2",),
    ),
    Erratum(
        "Eq. (4)",
        "V2 = (-sqrt3/2, 1/2, 0), V3 = (-sqrt3/2, -1/2, 0)",
        "V2 and V3 exchanged, for all of (8)-(11) and (16)-(24). As printed it is the mirrored robot, with the same "
        "singularities",
        "corners by (5) against the legs' ends (3): W2 is off by a column of R",
        ("eq3-5", "eq4-printed", "eq4-mirrored"),
    ),
    Erratum(
        "Eq. (12)",
        "mu1x = rho1x - rho2y",
        "mu1x = rho1x + rho2y",
        f"legs' ends in the moved frame. {_ONE_SOURCE}",
        ("eq12-15", "eq12-mu1x"),
    ),
    Erratum(
        "Eq. (14)",
        "mu3x = rho3x + rho2y, mu3y = rho3y - rho2y",
        "mu3x = rho3x + rho1y, mu3y = rho3y + rho2y",
        "legs' ends in the moved frame",
        ("eq12-15", "eq14-mu3x", "eq14-mu3y"),
    ),
    Erratum(
        "Eq. (15)",
        "x' = x - rho2y",
        "x' = x + rho2y",
        "(16), which is off by 4 rho2y as printed",
        ("eq15-x", "eq16-printed", "eq16-19"),
    ),
    Erratum(
        "Eq. (25)",
        "x",
        "x', so that x = x' - rho2y, y = rho1y, z = rho1z",
        "poses of this package",
        ("eq25",),
    ),
    Erratum(
        "Eqs. (25), (28) and text",
        "four direct kinematic solutions for any joint values",
        "four where a = R33^2 and b = R22^2 are both positive, two or one on the boundary, none elsewhere, and a "
        "self-motion where R32 = +-1. Where both are negative (25) is real, and there is no pose",
        "counts; candidates at such joints",
        ("poses", "no-pose", "no-pose-real-x", "no-pose-example", "boundary", "self-motion"),
    ),
    Erratum(
        "Eq. (27)",
        "sigma1 = +-arccos((mu3y - 2x)/...), beside theta1",
        "with theta2; for |theta| <= pi/2 the numerator is 2x' - mu3y",
        "its argument is -R11/|cos(theta)|; theta1 with the printed sigma1 gives no solution",
        ("eq27", "candidates-4"),
    ),
    Erratum(
        "Eqs. (26)-(28)",
        "rho and x",
        "mu2z, mu3y, mu3z for the rho of (28), and x' for x in all three",
        "arguments against entries of R",
        ("eq26", "eq27", "eq28"),
    ),
    Erratum(
        "text after (28)",
        "theta is kept in pi/2 <= theta <= pi; of 16 solutions four solve the constraints",
        "of these only two do, for two of the four poses: both signs of theta are needed. With them, +-sigma1 and four "
        "phi there are 32, of which four, one for each pose; of all 128 there are eight, two triples for each pose",
        "all candidates tried in (16)-(19)",
        ("candidates-0", "candidates-1", "candidates-2", "candidates-3"),
    ),
    Erratum(
        "Eqs. (26)-(28)",
        "nothing on accuracy",
        "at home all three arguments of arccos are 1: 8 of 16 digits are lost there, derivatives do not exist, and a "
        "rounding can lose the pose. This package takes R22 and R33 by square roots and the rest by division",
        "errors and derivatives around home",
        ("home-printed", "home-here", "home-gradient", "home-gradient-here"),
    ),
    Erratum(
        "Eq. (29)",
        "three surfaces, among them cos(theta) = 0",
        "correct as a set of angles. One of its two cos(theta) belongs to the angles: the robot's condition is R22 R33 "
        "= 0, and cos(theta) = 0 implies R33 = 0",
        "velocities without angles; rotations with cos(theta) = 0",
        ("eq29", "eq29-factors", "eq29-twist", "eq29-gimbal"),
    ),
    Erratum(
        "section 4, bullet 2",
        "along phi the range is from -pi to pi; alpha",
        "along sigma, reached at phi = +-pi/2 only; alpha is sigma",
        "largest |sigma| at each phi: pi/2 + |phi|",
        ("range-sigma", "range-sigma-phi"),
    ),
    Erratum(
        "section 4, bullet 3",
        "at phi = -pi/2, sigma < 0 has 0 <= theta <= pi/2",
        "that is the second rectangle at phi = +pi/2; at phi = -pi/2 theta and sigma have the same sign",
        "signs of R22 at phi = +-pi/2",
        ("rectangles+1", "rectangles-1", "rectangle-printed"),
    ),
    Erratum(
        "section 4, saddle points",
        "two, where sigma = 0 and theta = 0",
        "correct, at phi = +-pi/2; the boundary has six more, at (+-pi/2, 0, +-pi) and (0, 0, +-pi/2)",
        "local forms",
        ("saddles", "saddles-form"),
    ),
)
