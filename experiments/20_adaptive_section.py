"""An adaptive sweep of the section rho2 = 1 of the analytic 3-RPR: its cells, its areas and what was proved."""

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("20", __doc__)
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, 513), rho2=1.0, rho3=(0.0, 4.0, 513))
    cells = jk.sweep(robot, "forward_count", grid, adaptive=True)
    print(cells)
    print(cells.measure())
    save(jk.plot.cells(cells).get_figure(root=True), folder, "rpr3_adaptive_section")


if __name__ == "__main__":
    main()
