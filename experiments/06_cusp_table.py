"""Wenger and Chablat 2009: cusps at rho2 = 1, cusp edges, sections with 0 to 3 cusps, and the roots of Eq. (8)."""

from _common import finish, start

from jaxkin.papers import wenger_chablat_2009


def main() -> None:
    folder = start("06", __doc__)
    finish(folder, wenger_chablat_2009.cusp_tables())
    finish(folder, wenger_chablat_2009.cusp_equation())


if __name__ == "__main__":
    main()
