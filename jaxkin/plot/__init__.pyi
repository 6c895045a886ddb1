from .maps import section as section
from .modes import mechanism as mechanism
