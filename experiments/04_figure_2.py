"""Wenger and Chablat 2009, Fig. 2: the singular surfaces of the analytic 3-RPR in its workspace."""

from _common import finish, start

from jaxkin.papers import wenger_chablat_2009


def main() -> None:
    folder = start("04", __doc__)
    finish(folder, wenger_chablat_2009.figure_2())


if __name__ == "__main__":
    main()
