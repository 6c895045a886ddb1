"""Fu and Gao: counterparts of Figs. 2 to 7; volume of the workspace, links that come close."""

from _common import finish, start

from jaxkin.papers import fu_gao_tlpm as paper


def main() -> None:
    folder = start("11", __doc__)
    for part in (paper.figure_2, paper.figure_3, paper.figure_4, paper.figures_5_to_7):
        finish(folder, part())


if __name__ == "__main__":
    main()
