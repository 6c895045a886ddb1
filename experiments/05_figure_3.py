"""Wenger and Chablat 2009, Fig. 3: section rho2 = 1 of the joint space, and the fold over one of its cusps."""

from _common import finish, start

from jaxkin.papers import wenger_chablat_2009


def main() -> None:
    folder = start("05", __doc__)
    finish(folder, wenger_chablat_2009.figure_3())
    finish(folder, wenger_chablat_2009.fold_over_cusp())


if __name__ == "__main__":
    main()
