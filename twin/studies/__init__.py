"""Studies on the twin, as finished numbers: the paper's protocol, the part beyond it, ablation."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
