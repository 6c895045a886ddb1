from . import catalogue as catalogue
from . import rpr3 as rpr3
