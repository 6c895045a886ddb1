from .folds import folds as folds
from .maps import section as section
from .modes import mechanism as mechanism
from .surfaces import surfaces as surfaces
