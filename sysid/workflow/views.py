"""An evaluation of several inputs and outputs as figures of one input and one output show it."""

from dataclasses import replace

from sysid.channels.signals import Signals
from sysid.data.record import IOData
from sysid.workflow.evaluation import Evaluation


def named(e: Evaluation, signals: Signals) -> Evaluation:
    """The evaluation of several channels with the names and units of the file."""
    if not e.outputs:
        return e
    names = [_distinct([s.name for s in found], [s.column for s in found]) for found in (signals.input, signals.output)]
    outputs = zip(e.outputs, names[1], signals.output, strict=True)
    return replace(
        e,
        inputs=tuple((name, s.unit) for name, s in zip(names[0], signals.input, strict=True)),
        outputs=tuple(replace(output, name=name, unit=s.unit) for output, name, s in outputs),
    )


def _distinct(names: list[str], columns: list[str]) -> list[str]:
    """The names, or the columns where two names are one."""
    return names if len(set(names)) == len(names) else columns


def views(e: Evaluation, section: str) -> list[tuple[str, str, Evaluation]]:
    """What the figures of a section show of several channels: a mark for the name, words, and one input and output.

    "Data" has every channel, "Model output" and "Residual tests" every output, "Model" the evaluation as it is.
    """
    if not e.outputs or section == "Model":
        return [("", "", e)]
    ny = len(e.outputs)
    count = max(e.estimation.u.shape[1], ny) if section == "Data" else ny
    return [_view(e, k, section) for k in range(count)]


def _view(e: Evaluation, k: int, section: str) -> tuple[str, str, Evaluation]:
    i, j = min(k, e.estimation.u.shape[1] - 1), min(k, len(e.outputs) - 1)
    own = e.outputs[j]
    estimation, validation = (
        one_channel(data, i, j, e.inputs[i], (own.name, own.unit)) for data in (e.estimation, e.validation)
    )
    shown = replace(
        e,
        estimation=estimation,
        validation=validation,
        estimation_output=e.estimation_output.reshape(e.estimation.N, -1)[:, j],
        validation_output=e.validation_output.reshape(e.validation.N, -1)[:, j],
        estimation_fit=own.estimation_fit,
        validation_fit=own.validation_fit,
        tests=own.tests,
        outputs=(),
    )
    words = f"{e.inputs[i][0]} and {own.name}: " if section == "Data" else f"{own.name}: "
    return f"-{k + 1}", words, shown


def one_channel(data: IOData, i: int, j: int, u: tuple[str, str], y: tuple[str, str]) -> IOData:
    """One input and one output of a record, with their names and units."""
    return replace(
        data,
        u=data.u[:, i],
        y=data.y[:, j],
        u_name=u[0],
        y_name=y[0],
        u_unit=u[1],
        y_unit=y[1],
        u_offset=data.u_offset[i],
        y_offset=data.y_offset[j],
        missing=None if data.missing is None else data.missing[:, j],
    )
