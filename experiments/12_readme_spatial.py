"""The README's figures of the spatial robots: home aspect of the 3-PPPS, workspace of the TLPM."""

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("12", __doc__)
    solid = jk.aspect_solid(jk.mechanisms.ppps3.create(), n=24)
    save(jk.plot.solid(solid).get_figure(), folder, "ppps3_home_aspect")
    tlpm = jk.mechanisms.tlpm.create()
    branches = [jk.workspace_surfaces(tlpm, branch) for branch in ("upper", "lower")]
    save(jk.plot.workspace(branches).get_figure(), folder, "tlpm_workspace")


if __name__ == "__main__":
    main()
