"""The papers that the command line knows; imports a paper's file only when it is reproduced."""

from dataclasses import dataclass

from jaxkin.core.errors import InputError
from jaxkin.core.words import meant


@dataclass(frozen=True)
class Paper:
    """A paper that is reproduced.

    Attributes:
        title: Its title.
        source: Authors, year, place, and where to find it.
        module: File with the function ``reproduce``.
        mechanism: Mechanism of the catalogue whose geometry may be changed.
    """

    title: str
    source: str
    module: str
    mechanism: str


PAPERS: dict[str, Paper] = {
    "wenger-chablat-2009": Paper(
        title="Kinematic analysis of a class of analytic planar 3-RPR parallel manipulators",
        source="Wenger, P. and Chablat, D., Computational Kinematics, 2009, hal-00412923",
        module="jaxkin.papers.wenger_chablat_2009",
        mechanism="rpr3-analytic",
    ),
    "chablat-baron-jha-rolland-2018": Paper(
        title="The 3-PPPS parallel robot with U-shape base, a 6-DOF parallel robot with simple kinematics",
        source="Chablat, D., Baron, L., Jha, R. and Rolland, L., Advances in Robot Kinematics, 2018, hal-01782286",
        module="jaxkin.papers.chablat_baron_jha_rolland_2018",
        mechanism="ppps3",
    ),
    "fu-gao-tlpm": Paper(
        title="Kinematic performances of a novel TLPM parallel robot",
        source="Fu, J. and Gao, F.; the text at hand has neither place nor year, its latest references are of 2015",
        module="jaxkin.papers.fu_gao_tlpm",
        mechanism="tlpm",
    ),
}


def find(name: str) -> Paper:
    """Returns a paper by name.

    Raises:
        InputError: It is unknown.
    """
    if name not in PAPERS:
        raise InputError(f"There is no paper {name!r}: choose one of {', '.join(PAPERS)}{meant(name, PAPERS)}")
    return PAPERS[name]
