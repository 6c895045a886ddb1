"""Chablat, Baron, Jha and Rolland 2018: all equations, the candidates of (25) to (28), and numbers of operations."""

from _common import finish, start

from jaxkin.papers import chablat_baron_jha_rolland_2018 as paper


def main() -> None:
    folder = start("09", __doc__)
    for part in (paper.equations, paper.direct_kinematics, paper.costs):
        finish(folder, part())


if __name__ == "__main__":
    main()
