"""Every public name of sysid and where it is defined: `sysid/__init__.py` reads this, and so do type checkers."""

from . import (
    bands as bands,
    bla as bla,
    blocks as blocks,
    closed_form as closed_form,
    curves as curves,
    excitations as excitations,
    export_c as export_c,
    export_python as export_python,
    intervals as intervals,
    linearize as linearize,
    nlarx_linearize as nlarx_linearize,
    plots as plots,
    poles as poles,
    preprocess as preprocess,
    responses as responses,
    searches as searches,
    select as select,
    structures as structures,
    systems as systems,
)
from .advice import Advice as Advice, advise as advise
from .certainty import information as information
from .chain import Chain as Chain
from .data import IOData as IOData
from .dispatch import fit as fit
from .errors import InputError as InputError
from .fitting import Fit as Fit
from .higher_order import higher_order_tests as higher_order_tests
from .iterate import Options as Options
from .joint_growth import grow_joint as grow_joint
from .joint_values import joint_values as joint_values
from .nlarx_estimation import fit_nlarx as fit_nlarx
from .nlarx_fit import NlarxFit as NlarxFit
from .objective import Objective as Objective
from .residuals import residual_tests as residual_tests
from .saving import save as save
from .storage import load as load
from .validation import compare as compare, cross_validate as cross_validate
