"""Figures: draws results, computes nothing. Every function takes ``ax=None`` and returns the Axes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "maps": ["section"],
        "modes": ["mechanism"],
        "poses": ["pose"],
        "surfaces": ["surfaces"],
        "folds": ["folds"],
        "solids": ["solid"],
        "workspaces": ["workspace"],
        "clearances": ["clearance_limit", "interference"],
        "wrists": ["wrist_angles"],
    },
)
