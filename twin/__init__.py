"""Digital twin of the QPAL leg: simulate an excitation experiment, and know the truth behind its log.

Names load on first use: what needs no robot, such as identifying a record, loads no MuJoCo. `__init__.pyi` lists them.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
