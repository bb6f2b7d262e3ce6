"""Every public name of sysid and where it is defined: `sysid/__init__.py` reads this, and so do type checkers.

A room is a folder of the house; its own `__init__.py` says what is in it. Rooms that no call needs by name, such as
`sysid.workflow`, are reached in the same way and not listed.
"""

from . import (
    bench as bench,
    blocks as blocks,
    data as data,
    diagnosis as diagnosis,
    excitations as excitations,
    export as export,
    joint as joint,
    linear as linear,
    plots as plots,
    structures as structures,
    systems as systems,
    uncertainty as uncertainty,
)
from .base.errors import InputError as InputError
from .channels.guess import guess as guess
from .channels.mapping import Channel as Channel, ChannelMap as ChannelMap
from .channels.reading import read_signals as read_signals
from .data.record import IOData as IOData
from .diagnosis.advice import advise as advise
from .diagnosis.delays import delay as delay
from .diagnosis.residuals import residual_tests as residual_tests
from .estimation.fit_from import fit_from as fit_from
from .estimation.objective import Objective as Objective
from .estimation.result import Fit as Fit
from .joint.posterior import fit_joint as fit_joint
from .joint.values import joint_values as joint_values
from .model.chain import Chain as Chain
from .fitting import fit as fit
from .fitting import load as load
from .fitting import save as save
from .nlarx.fit import fit_nlarx as fit_nlarx
from .nlarx.result import NlarxFit as NlarxFit
from .selection.select import select as select
from .solver.iterate import Options as Options
from .uncertainty.information import information as information
from .uncertainty.spectrum import spectrum as spectrum
from .validation.compare import compare as compare, cross_validate as cross_validate
from .workflow.record import read as read
