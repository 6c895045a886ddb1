"""The fields of jaxkin, and how they are found by name."""

from jaxkin.core.errors import InputError
from jaxkin.core.words import meant
from jaxkin.sweep._field_limits import binding_limit, limit_margins
from jaxkin.sweep._field_measures import direct_determinant, inverse_condition_number, smallest_singular_value
from jaxkin.sweep._field_record import Field
from jaxkin.sweep._field_solutions import forward_branches, forward_count, forward_frames, inverse_branches

#: The fields that the command line knows, by name.
FIELDS: dict[str, Field] = {
    f.name: f
    for f in (
        forward_count,
        forward_branches,
        forward_frames,
        inverse_branches,
        direct_determinant,
        smallest_singular_value,
        inverse_condition_number,
        limit_margins,
        binding_limit,
    )
}


def by_name(name: str) -> Field:
    """Returns a field of jaxkin by its name.

    Raises:
        InputError: There is none of that name.
    """
    if name in FIELDS:
        return FIELDS[name]
    raise InputError(f"There is no field {name!r}: choose one of {', '.join(FIELDS)}{meant(name, FIELDS)}")
