"""Every public name of twin and where it is defined: `twin/__init__.py` reads this, and so do type checkers."""

from . import (
    compare as compare,
    design as design,
    hardware as hardware,
    imperfections as imperfections,
    parameter_file as parameter_file,
    pendulum as pendulum,
    plant as plant,
    robot as robot,
    signatures as signatures,
    studies as studies,
    view as view,
)
from .compare.comparison import Comparison as Comparison
from .ensemble.draws import Draws as Draws
from .ensemble.ensemble import Ensemble as Ensemble
from .experiment import Experiment as Experiment
from .follow import Follower as Follower
from .log import Log as Log
from .imperfections import IMPERFECTIONS as IMPERFECTIONS
from .parameters import JOINTS as JOINTS, Parameters as Parameters
from .truth import truth as truth
