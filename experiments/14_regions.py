"""Regions by number of assembly modes: section rho2 = 1 of the analytic 3-RPR, rho1 = 14.98 of the reference one."""

import csv

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("14", __doc__)
    analytic = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    section = jk.Grid(rho1=(0.0, 4.0, 200), rho2=1.0, rho3=(0.0, 4.0, 200))
    # With closed forms the curves have names.
    named = jk.singular_curves(analytic, section, method="closed form")
    reference = jk.mechanisms.rpr3.reference()
    other = jk.Grid(rho1=14.98, rho2=(0.0, 40.0, 200), rho3=(0.0, 40.0, 200))
    for name, robot, where, curves in (
        ("rpr3_analytic_regions", analytic, section, named),
        ("rpr3_reference_regions", reference, other, None),
    ):
        found = jk.regions(robot, where)
        assert isinstance(found, jk.Regions)
        print(found)
        with open(folder / f"{name}.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["region", "solutions", "area", "error", *found.joint_names])
            for region in found:
                row = [region.area, region.error, *region.interior]
                writer.writerow([region.name, region.n_solutions, *(f"{float(value):.12g}" for value in row)])
        print(folder / f"{name}.csv")
        save(jk.plot.regions(found, cusps=jk.cusps(robot, where), curves=curves).figure, folder, name)


if __name__ == "__main__":
    main()
