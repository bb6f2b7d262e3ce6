"""Identification of block-oriented nonlinear systems: Hammerstein-Wiener and its relatives, checked against truth.

Names load on first use, so that `import sysid` stays light; `__init__.pyi` lists them.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
