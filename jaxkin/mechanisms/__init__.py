"""One file a robot: constants, equations, closed forms, source. ``catalogue`` lists them by id."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["rpr3", "rpr3_closed_forms", "ppps3", "ppps3_closed_forms", "tlpm", "five_bar", "catalogue"]
)
