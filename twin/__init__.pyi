from .draws import Draws as Draws
from .ensemble import Ensemble as Ensemble
from .experiment import Experiment as Experiment
from .log import Log as Log
from .parameters import IMPERFECTIONS as IMPERFECTIONS
from .parameters import JOINTS as JOINTS
from .parameters import Parameters as Parameters
from .truth import truth as truth
