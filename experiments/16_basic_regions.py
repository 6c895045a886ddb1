"""Characteristic surfaces of the analytic 3-RPR; over rho2 = 1 its characteristic curves and basic regions."""

import math

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("16", __doc__)
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    box = jk.Grid(x=(-2.5, 2.5, 32), y=(-2.5, 2.5, 32), phi=(-math.pi, math.pi, 32))
    surfaces = jk.characteristic_surfaces(robot, box)
    print(surfaces)
    save(jk.plot.characteristic(surfaces)[0].figure, folder, "rpr3_characteristic_surfaces")

    section = jk.Grid(rho1=(0.0, 4.0, 100), rho2=1.0, rho3=(0.0, 4.0, 100))
    curves = jk.characteristic_curves(robot, section)
    print(curves)
    save(jk.plot.characteristic(curves)[0].figure, folder, "rpr3_characteristic_curves")

    regions = jk.basic_regions(robot, section)
    print(regions)
    for domain in regions.uniqueness_domains():
        print(f"  uniqueness domain {domain.name}: basic regions {', '.join(map(str, domain.regions))}")
    save(jk.plot.basic_regions(regions)[0, 0].figure, folder, "rpr3_basic_regions")


if __name__ == "__main__":
    main()
