"""Designs: objectives that can be differentiated, problems, optimisers, proof after the fact, atlases of designs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
