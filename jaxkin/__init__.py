"""Differentiable kinematics and workspace maps of parallel robots.

Everything public is here and loaded when first used, so that the command line starts without JAX.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0.dev0"
