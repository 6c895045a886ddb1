"""Fields: what can be mapped over a grid. A field is a record; ``sweep`` is the only loop."""

from jaxkin.sweep._field_catalogue import FIELDS, by_name
from jaxkin.sweep._field_limits import binding_limit, limit_margins
from jaxkin.sweep._field_measures import direct_determinant, inverse_condition_number, smallest_singular_value
from jaxkin.sweep._field_own import from_function
from jaxkin.sweep._field_record import Coordinates, Field, Variable
from jaxkin.sweep._field_solutions import forward_branches, forward_count, forward_frames, inverse_branches

__all__ = [
    "FIELDS",
    "Coordinates",
    "Field",
    "Variable",
    "binding_limit",
    "by_name",
    "direct_determinant",
    "forward_branches",
    "forward_count",
    "forward_frames",
    "from_function",
    "inverse_branches",
    "inverse_condition_number",
    "limit_margins",
    "smallest_singular_value",
]
