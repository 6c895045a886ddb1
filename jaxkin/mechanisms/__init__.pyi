from . import catalogue as catalogue
from . import five_bar as five_bar
from . import ppps3 as ppps3
from . import ppps3_closed_forms as ppps3_closed_forms
from . import rpr3 as rpr3
from . import rpr3_closed_forms as rpr3_closed_forms
from . import tlpm as tlpm
