"""Figures: draws results, computes nothing. Every function draws into new Axes or the caller's, and returns them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "maps": ["section"],
        "cells": ["cells"],
        "modes": ["mechanism"],
        "poses": ["pose"],
        "surfaces": ["surfaces"],
        "folds": ["folds"],
        "solids": ["solid"],
        "workspaces": ["workspace"],
        "clearances": ["clearance_limit", "interference"],
        "wrists": ["wrist_angles"],
        "aspects": ["aspects"],
        "regions": ["regions"],
        "cusp_curves": ["cusp_curves"],
        "characteristic": ["characteristic"],
        "basic_regions": ["basic_regions"],
        "mode_change": ["mode_change"],
        "animation": ["animate_mode_change"],
        "designs": ["design_comparison", "design_history", "design_map"],
    },
)
