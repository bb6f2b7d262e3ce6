"""Validation: several fits on the same validation data, and cross-validation of one structure over blocks."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.criteria import Criteria
from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.base.handlers import Shown, handler
from sysid.base.quantities import display_quantity
from sysid.data.record import IOData
from sysid.model.chain import Chain

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One fit on the record. The free run uses u and only the first output samples, which are not scored.

    rmse in the unit of y. `one_step` is the one-step fit [%] of models that predict (ARX, ARMAX, BJ, nonlinear ARX),
    None for others: never compare it with a free run. `criteria` belong to the estimation record, d counts parameters
    after the gauge.
    """

    rank: int
    label: str
    structure: str
    fit: float
    rmse: float
    one_step: float | None
    criteria: Criteria
    converged: bool
    stop: str
    seconds: float


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Rows from the best free run to the worst, over `scored` samples after the first `n_init` of each experiment."""

    rows: tuple[Row, ...]
    n_init: int
    scored: int
    y_name: str
    y_unit: str

    def as_dict(self) -> dict[str, Any]:
        """All values, ready for JSON."""
        rows = [{**asdict(r), "criteria": r.criteria.as_dict()} for r in self.rows]
        return json_value({**asdict(self), "rows": rows})

    @property
    def numbered(self) -> str:
        """What the numbers of the labels are; nothing where each model has a name of its own."""
        if all(r.label == r.structure or not r.label.startswith(f"{r.structure} (") for r in self.rows):
            return ""
        return 'the number in brackets is the place of the model in the call; name them with labels=("first", ...)'

    def plot(self) -> "Figure":
        """A figure of the free-run fits as bars, best on top."""
        figure: Figure = handler(self).plot(self)
        return figure

    def __str__(self) -> str:
        q = display_quantity("RMSE", self.y_unit)
        head = ("", "model", "free run %", q.label, "one step %", "d", *self.rows[0].criteria.brief(), "s", "search")
        table = [head, *(_cells(r, q.factor) for r in self.rows)]
        widths = [max(len(row[i]) for row in table) for i in range(len(head))]
        lines = []
        for row in table:
            cells = [
                c.ljust(w) if i in (1, len(row) - 1) else c.rjust(w)
                for i, (c, w) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(cells).rstrip())
        explanation = [self.numbered] if self.numbered else []
        return "\n".join([*lines, f"{self.scored} samples scored, {self.n_init} not", *explanation])


@checked
def compare(data: IOData, *fits: Any, labels: Sequence[str] | None = None) -> Comparison:
    """Free-run scores of fits on one record, best first; all on the same samples.

    All fits leave out the same number of first samples, the largest that one needs. A run that diverges ranks last, at
    -inf. labels: names in the order of the fits; by default their structures, with their place in the call in brackets
    where two are equal.
    """
    if not fits:
        raise InputError("nothing to compare; give at least one fit")
    for f in fits:
        if not hasattr(f, "fit_percent"):
            raise InputError(f"fits has {short_text(f)}; give fits, as sysid.fit or sysid.load returns them")
    if labels is None:
        labels = _numbered_names([f.model.structure for f in fits])
    labels = tuple(labels)
    if len(labels) != len(fits) or len(set(labels)) != len(labels):
        raise InputError(f"labels are {list(labels)} for {len(fits)} fits; give each fit a different name")
    n = max(f.n_init for f in fits)
    counts = _scored_samples(data, n)
    rows = [_row(label, f, data, n, counts) for label, f in zip(labels, fits, strict=True)]
    rows.sort(key=lambda r: (-r.fit, r.criteria.d))
    ranked = tuple(Row(**{**vars(r), "rank": k}) for k, r in enumerate(rows, 1))
    return Comparison(ranked, n, int(counts.sum()), data.y_name, data.y_unit)


@dataclass(frozen=True)
class CrossValidation:
    """Free-run fit [%] and RMSE [y] on every block left out, and of each refit on its own estimation samples."""

    fits: tuple[float, ...]
    rmses: tuple[float, ...]
    estimation: tuple[float, ...]
    blocks: tuple[tuple[int, int], ...]
    converged: tuple[bool, ...]

    @property
    def rmse(self) -> float:
        """Over all blocks together [y]."""
        n = np.array([b - a for a, b in self.blocks], dtype=float)
        return float(np.sqrt(np.sum(n * np.array(self.rmses) ** 2) / n.sum()))

    @property
    def mean(self) -> float:
        """Mean fit [%] over the blocks."""
        return float(np.mean(self.fits))

    @property
    def std(self) -> float:
        """Standard deviation of the fit [%] from block to block."""
        return float(np.std(self.fits, ddof=1))

    def as_dict(self) -> dict[str, Any]:
        """All values, ready for JSON."""
        return json_value({**asdict(self), "mean": self.mean, "std": self.std, "rmse": self.rmse})


@checked
def cross_validate(
    model: Chain, data: IOData, folds: int = 5, n_init: int | None = None, **options: Any
) -> CrossValidation:
    """Refit on all but one contiguous block, free run on that block; once for each of `folds` blocks.

    The parts before and after the block are separate experiments, so the samples of each part are consecutive. The
    first n_init samples of the block give the initial state and are not scored. `options` go to `sysid.fit`. Remove
    means from the whole record beforehand, or not at all.
    """
    from sysid.fitting import fit

    if len(data.lengths) > 1:
        raise InputError(f"the record has {len(data.lengths)} experiments; cross-validate one of data.experiments")
    if folds < 2 or data.N // folds < 4:
        raise InputError(f"{folds} folds of {data.N} samples; give 2 folds or more, of at least 4 samples each")
    edges = np.linspace(0, data.N, folds + 1).round().astype(int)
    blocks = [(int(a), int(b)) for a, b in pairwise(edges)]
    results = []
    for a, b in blocks:
        rest = [data.select(i, j) for i, j in ((0, a), (b, data.N)) if j - i >= 2]
        estimation, left_out = IOData.merge(*rest), data.select(a, b)
        refit = fit(model, estimation, **options)
        n = min(refit.n_init, left_out.N // 2) if n_init is None else n_init
        counts = _scored_samples(left_out, n)
        rmse = _rmse((left_out.y[:, 0] - refit.simulate(left_out, n))[counts])
        results.append((refit.fit_percent(left_out, n), rmse, refit.fit_percent(estimation), refit.stop.converged))
    fits, rmses, estimation_fits, converged = zip(*results, strict=True)
    return CrossValidation(fits, rmses, estimation_fits, tuple(blocks), converged)


def _row(label: str, fit: Any, data: IOData, n: int, counts: np.ndarray) -> Row:
    yhat = fit.simulate(data, n)
    one_step = fit.prediction_percent(data, n) if fit.predicts else None
    return Row(
        rank=0,
        label=label,
        structure=fit.model.structure,
        fit=fit.fit_percent(data, n),
        rmse=_rmse((data.y[:, 0] - yhat)[counts]),
        one_step=one_step,
        criteria=fit.criteria,
        converged=fit.stop.converged,
        stop=fit.stop.reason,
        seconds=fit.seconds,
    )


def _scored_samples(data: IOData, n: int) -> np.ndarray:
    """True (N,) for measured samples after the first n of each experiment."""
    if min(data.lengths) < n + 2:
        raise InputError(
            f"an experiment has {min(data.lengths)} samples and {n} of them give the initial state; give a longer one"
        )
    after_start = np.concatenate([np.arange(k) >= n for k in data.lengths])
    return after_start & data.observed[:, 0]


def _rmse(e: np.ndarray) -> float:
    return float(np.sqrt(np.mean(e**2))) if np.all(np.isfinite(e)) else np.inf


def _numbered_names(names: list[str]) -> list[str]:
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({k})" if names.count(name) > 1 else name for k, name in enumerate(names, 1)]


def _cells(r: Row, factor: float) -> tuple[str, ...]:
    one_step = "-" if r.one_step is None else f"{r.one_step:.2f}"
    end = "converged" if r.converged else "not converged"
    numbers = (
        f"{r.fit:.2f}",
        f"{r.rmse * factor:.4g}",
        one_step,
        str(r.criteria.d),
        *r.criteria.brief().values(),
    )
    return (str(r.rank), r.label, *numbers, f"{r.seconds:.2f}", end)
