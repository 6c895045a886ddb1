"""Fields over grids. ``jk.fields`` may be the first that is asked for, before anything has imported it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules={"fields"})
