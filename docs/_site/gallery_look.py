"""The look of figures in the gallery is that of the library's own."""

import matplotlib as mpl

from sysid.base.looks import RC


def apply(gallery_conf: dict, fname: str) -> None:
    mpl.rcParams.update(RC)
