"""Fu and Gao: all equations, Table 1 with strokes, and the angles of the wrist."""

from _common import finish, start

from jaxkin.papers import fu_gao_tlpm as paper


def main() -> None:
    folder = start("10", __doc__)
    for part in (paper.equations, paper.wrist):
        finish(folder, part())


if __name__ == "__main__":
    main()
