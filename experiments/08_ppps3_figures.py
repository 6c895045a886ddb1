"""Chablat, Baron, Jha and Rolland 2018: counterparts of Figs. 1 to 3, the home aspect, and its joints."""

from _common import finish, start

from jaxkin.papers import chablat_baron_jha_rolland_2018 as paper


def main() -> None:
    folder = start("08", __doc__)
    for part in (paper.figure_1, paper.figure_2, paper.figure_3, paper.orientation):
        finish(folder, part())


if __name__ == "__main__":
    main()
