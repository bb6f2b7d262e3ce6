"""Blocks of a recipe by name, for one channel or for several."""

from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block, StaticBlock
from sysid.blocks import Channels, TransferFunction, TransferMatrix, static

Map = str | StaticBlock
Order = int | Sequence[Sequence[int]]


def maps(kind: Map | Sequence[Map], role: str, channels: int) -> Block:
    """One static map, or one for each of several channels; a sequence names one for each channel."""
    if channels == 1 and isinstance(kind, (str, StaticBlock)):
        return static(kind, role)
    kinds = [kind] * channels if isinstance(kind, (str, StaticBlock)) else list(kind)
    if len(kinds) != channels:
        raise InputError(f"{len(kinds)} {role} maps for {channels} channel(s); give one name, or one for each channel")
    return Channels(maps=tuple(static(k, role) for k in kinds), role=role)


def filters(nb: Order, nf: Order, nk: Order, nu: int, ny: int, role: str = "linear") -> Block:
    """B/F, or an ny x nu matrix of them; each order is one number for all or rows [output][input]."""
    if nu < 1 or ny < 1:
        raise InputError(f"nu and ny are {nu} and {ny}; give at least 1 of each")
    if (nu, ny) == (1, 1) and all(isinstance(k, (int, np.integer)) for k in (nb, nf, nk)):
        return TransferFunction(nb, nf, nk, role=role)  # type: ignore[arg-type]
    tables = []
    for name, order in (("nb", nb), ("nf", nf), ("nk", nk)):
        table = np.broadcast_to(np.asarray(order), (ny, nu)) if np.ndim(order) == 0 else np.asarray(order)
        if table.shape != (ny, nu) or table.dtype.kind not in "iu":
            raise InputError(f"{name} is {order!r}; give one integer or {ny} rows of {nu}, [output][input]")
        tables.append(table)
    B, F, K = tables
    rows = [tuple(TransferFunction(int(B[j, i]), int(F[j, i]), int(K[j, i])) for i in range(nu)) for j in range(ny)]
    return TransferMatrix(entries=tuple(rows), role=role)
