"""The coloured regions of Wenger and Chablat 2009, Fig. 3.

Section rho2 = 1 of the joint space of the analytic 3-RPR with c2 = 1, c3 = 0, d3 = 1: number of assembly modes.
The print says "2, 4 or 6"; where there are none it leaves the page white, as here.
"""

import numpy as np
from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("01", __doc__)
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, 2000), rho2=1.0, rho3=(0.0, 4.0, 2000))
    dataset = jk.sweep(robot, jk.fields.forward_count, grid)
    counts = dataset.forward_count.values
    for number in np.unique(counts):
        print(f"{number} solutions: {np.mean(counts == number):.6f} of the samples")
    print(f"undecided in float64: {int(dataset.forward_count_nearly_double.sum())} samples")
    save(jk.plot.section(dataset).figure, folder, "rpr3_analytic_section")


if __name__ == "__main__":
    main()
