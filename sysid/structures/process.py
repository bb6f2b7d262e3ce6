"""Process: gain, time constants or a pair of poles, zero, integrator and delay, in seconds."""

from dataclasses import dataclass, replace
from itertools import product
from types import SimpleNamespace
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.blocks import Process
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.model.recipes import OFFSETS, Recipe, choice, offset_of_input, with_offset

_POLES = {"P0": (0, False), "P1": (1, False), "P2": (2, False), "P3": (3, False), "P2U": (0, True)}


def _kinds() -> dict[str, Process]:
    """The block of each kind by its name; a zero needs two poles, and there is at least one."""
    kinds = {}
    for poles, delay, integrator, zero in product(_POLES, *(("", letter) for letter in "DIZ")):
        lags, pair = _POLES[poles]
        if lags + 2 * pair + len(integrator) > len(zero):
            name = f"{poles[:2]}{delay}{integrator}{zero}{poles[2:]}"
            kinds[name] = Process(lags, pair, bool(zero), bool(integrator), bool(delay), role="plant")
    return kinds


KINDS = _kinds()


def _key(block: Any) -> tuple[Any, ...]:
    return block.lags, block.pair, block.zero, block.integrator, block.delayed


def _kind(name: str) -> Process:
    """The block of a kind whose letters may stand in any order."""
    for known, block in KINDS.items():
        if sorted(name.upper()) == sorted(known) and name.upper().startswith("P"):
            return block
    raise InputError(
        f"unknown kind of process {name!r}; write P and the number of time constants, 0 to 3, then any of D (delay), I "
        "(integrator; P0 needs it), Z (zero; it needs two poles) and U (P2: a pair of poles), such as P1D or P2DZU"
    )


@checked
def process(kind: str = "P1D", offset: str = "free", **limits: Any) -> Chain:
    """y = K (1 + Tz s) exp(-Td s) / ((1 + T1 s)(1 + T2 s)(1 + T3 s) s) u + offset, in seconds.

    kind: "P", the number of time constants (0 to 3), then letters: D for a delay Td, which need be no whole number of
    samples, I for an integrator, Z for a zero, U for a pair of poles wn, zeta, real or complex, in place of T1 and T2;
    such as "P1D" or "P2DZU". The input is held between its samples. `offset` is "free" for an offset of the output,
    with an integrator of the input, which it integrates; "each" for one of every experiment; else "none". `limits` are
    the `fixed` and `bounds` of the chain, by parameter: plant.K [unit of y per unit of u], plant.T1 [s]. A fit takes
    the sampling time of its record.
    """
    block = _kind(kind)
    if not block.integrator:
        return Chain(with_offset([block], 1, offset), structure="process", **limits)
    return Chain((*offset_of_input(offset), block), structure="process", **limits)


@checked
@dataclass(frozen=True)
class ProcessModel(Recipe):
    """Settings of `process`."""

    name: ClassVar[str] = "process"
    searched: ClassVar[bool] = True
    rungs: ClassVar[tuple[dict[str, Any], ...]] = tuple({"kind": kind} for kind in ("P1D", "P2D", "P2DU", "P1DI"))
    kind: str = choice("P1D", "P, number of lags, then D delay, I integrator, Z zero, U pair of poles", [*KINDS])
    offset: str = choice("free", "offset of the output, or of the input before an integrator", OFFSETS)

    def model(self) -> Chain:
        return process(self.kind, self.offset)

    def model_of(self, data: IOData) -> Chain:
        return self.model().sampled(data.Ts)

    def neighbours(self) -> tuple[Recipe, ...]:
        """One time constant more or less, a pair for one or two, and each of delay, integrator and zero or none."""
        b = self._block
        changes: list[dict[str, Any]] = [{"lags": n, "pair": False} for n in (1, 2)] if b.pair else []
        changes += [] if b.pair else [{"lags": b.lags + 1}, {"lags": b.lags - 1}]
        changes += [{"lags": 0, "pair": True}] if b.lags in (1, 2) else []
        changes += [{name: not getattr(b, name)} for name in ("integrator", "delayed", "zero")]
        return self._with(changes)

    def integrating(self) -> tuple["ProcessModel", ...]:
        """With an integrator in place of the slowest time constant, or beside all; without the delay, and with it."""
        b = self._block
        fewer: dict[str, Any] = {"lags": 1, "pair": False} if b.pair else {"lags": b.lags - 1}
        delays = (False, True) if b.delayed else (False,)
        changes = [{**lags, "integrator": True, "delayed": d} for lags in (fewer, {}) for d in delays]
        return () if b.integrator else self._with(changes)

    def parts(self, Ts: float) -> dict[str, tuple[float, tuple[Recipe, ...]]]:
        b = self._block
        fewer = self._with([{"lags": lags} for lags in range(b.lags)])
        without = {"Td": self._with([{"delayed": False}]), "Tz": self._with([{"zero": False}])}
        without |= dict.fromkeys(("T1", "T2", "T3"), fewer)
        slots = (slot for slot in b.sampled(Ts).slots() if without.get(slot.name))
        return {slot.words: (max(slot.lower, 0.0), without[slot.name]) for slot in slots}

    @property
    def swings(self) -> bool:
        return self._block.pair

    @property
    def _block(self) -> Process:
        return _kind(self.kind)

    def _with(self, changes: list[dict[str, Any]]) -> tuple["ProcessModel", ...]:
        """The same with a change of the block, of those changes that give a kind."""
        names = {_key(block): name for name, block in KINDS.items()}
        keys = [_key(SimpleNamespace(**{**vars(self._block), **change})) for change in changes]
        return tuple(replace(self, kind=names[key]) for key in keys if key in names)

    def __str__(self) -> str:
        return f"{self.name} {self.kind}"

    @property
    def short(self) -> str:
        return str(self)

    def in_words(self, fit: Any = None) -> str:
        return f"Process ({self.kind})"
