"""Sections rho1 = 14.98 and rho1 = 17 of the field's reference 3-RPR, with six cusps each.

Zein, Wenger and Chablat (2007) found them; geometry of Innocenti and Parenti-Castelli (1998).
"""

from _common import finish, start

from jaxkin.papers import wenger_chablat_2009


def main() -> None:
    folder = start("07", __doc__)
    finish(folder, wenger_chablat_2009.reference_geometry())


if __name__ == "__main__":
    main()
