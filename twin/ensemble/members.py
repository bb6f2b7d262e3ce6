"""The experiments of an ensemble: their parameters, their simulation side by side, and the table of their records."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sysid.base import tables
from sysid.base.errors import InputError
from sysid.base.files import json_value
from twin.ensemble.draws import Draws
from twin.experiment import SETTLE, Experiment
from twin.parameters import JOINTS, TABLE, Parameters
from twin.plant import slots
from twin.plant.leg import bench_spec
from twin.plant.stepping import Run, attempt

if TYPE_CHECKING:
    import polars

COMPILED = tuple(row.name for row in TABLE if row.compiled)  # experiments that agree in these share one compiled model
RANGE = ("angle_min_rad", "angle_max_rad")
SIGNALS = ("voltage_V", "angle_rad", "angle_true_rad")


@dataclass(frozen=True)
class Member:
    """An experiment ready for simulation, or a sentence with the reason why not; `row` is the start of its row."""

    row: dict[str, Any]
    experiment: Experiment | None
    run: Run | None
    trouble: str


@dataclass(frozen=True)
class Members:
    """`experiment` once for each of `seeds`, with the parameters from `draws`."""

    experiment: Experiment
    seeds: Sequence[int]
    draws: Draws | None

    def variant(self, number: int) -> Experiment:
        """Experiment `number`."""
        return replace(self.experiment, seed=self.seeds[number], parameters=self.parameters(number)[0])

    def parameters(self, number: int) -> tuple[Parameters, int]:
        """The parameters of experiment `number`, and the number of rejected draws before them."""
        if self.draws is None:
            return self.experiment.p, 0
        draw = self.draws.draw(self.experiment.p, number)
        return draw.parameters, draw.redrawn

    def row(self, number: int) -> tuple[dict[str, Any], Parameters]:
        """The start of the row of experiment `number`: what it was made from; and its parameters."""
        parameters, redrawn = self.parameters(number)
        row: dict[str, Any] = {"number": number, "seed": self.seeds[number], "redrawn": redrawn}
        return row | ({} if self.draws is None else {name: parameters[name] for name in self.draws.names}), parameters

    def names(self, quantities: Sequence[str]) -> list[str]:
        """Columns of these quantities, one set per driven joint if there are several."""
        if self.experiment.joint in JOINTS:
            return list(quantities)
        return [f"{joint}.{name}" for joint in self.experiment.joints for name in quantities]

    def columns(self) -> list[str]:
        """The columns of the table."""
        rows = () if self.draws is None else self.draws.names
        numbers = ("number", "seed", "redrawn", *rows, *self.names(RANGE))
        return [*numbers, "trouble", *self.names(SIGNALS), "meta"]

    def matches_start(self, row: dict[str, Any]) -> bool:
        """Whether a row of a table starts as one of this ensemble: its seed and its drawn values."""
        return all(row[name] == value for name, value in self.row(row["number"])[0].items())

    def matches_log(self, row: dict[str, Any], header: dict[str, Any]) -> bool:
        """Whether the header of a row's log is that of the experiment; a row with trouble has none."""
        if row["trouble"]:
            return True
        meta = json.loads(json.dumps(self.variant(row["number"]).meta(), default=json_value))
        return all(header.get(name) == value for name, value in meta.items() if name != "versions")

    def prepare(self, numbers: range) -> list[Member]:
        """These experiments, ready for simulation; those with equal compiled parameters share one model."""
        models: dict[tuple[float, ...], mujoco.MjModel] = {}
        return [self._prepare(number, models) for number in numbers]

    def _prepare(self, number: int, models: dict[tuple[float, ...], mujoco.MjModel]) -> Member:
        row, parameters = self.row(number)
        try:
            experiment = replace(self.experiment, seed=self.seeds[number], parameters=parameters)
            key = tuple(parameters[name] for name in COMPILED)
            if key not in models:
                models[key] = _model(experiment)
            return Member(row, experiment, experiment.prepare(models[key]), "")
        except InputError as error:  # a valid leg, but not for this excitation
            return Member(row, None, None, str(error))

    def simulate(self, members: Sequence[Member], threads: int) -> tuple[np.ndarray, list[str]]:
        """Records of the boards (members, N, joints, COLUMNS), NaN if there is none, and a sentence that says why."""
        e = self.experiment
        records = np.full((len(members), e.N, len(e.joints), slots.COLUMNS), np.nan)
        trouble = [member.trouble for member in members]
        runs = {i: member.run for i, member in enumerate(members) if member.run is not None}
        if runs:
            records[list(runs)], sentences = attempt(list(runs.values()), e.Ts, SETTLE, threads)
            for i, sentence in zip(runs, sentences, strict=True):
                trouble[i] = sentence
        return records, trouble

    def table(self, members: Sequence[Member], records: np.ndarray, trouble: Sequence[str]) -> "polars.DataFrame":
        """One row per member: its start, the range of its angles, its trouble, its signals and its log's header."""
        import polars

        tables.check_fork()
        rows, signals = [], []
        for member, record, sentence in zip(members, records, trouble, strict=True):
            values, meta = _signals(member, record)
            extremes = zip(self.names(RANGE), (g(y) for y in values[:, 1] for g in (np.min, np.max)), strict=True)
            meta = meta | {"number": member.row["number"], "trouble": sentence}
            rows.append(member.row | dict(extremes) | {"trouble": sentence, "meta": json.dumps(meta)})
            signals.append(values.reshape(-1, values.shape[-1]))
        table = polars.DataFrame(rows, infer_schema_length=None).with_columns(
            polars.Series(name, column) for name, column in zip(self.names(SIGNALS), np.stack(signals, 1), strict=True)
        )
        return table.select(self.columns())


def simulate_part(job: tuple[Members, range]) -> "polars.DataFrame":
    """The table of some experiments of an ensemble, on one thread; runs on a worker."""
    members, numbers = job
    part = members.prepare(numbers)
    return members.table(part, *members.simulate(part, 1))


def _signals(member: Member, record: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Voltage, angle and true angle (joints, 3, N) of a member from its boards' record, and its log's header."""
    if member.experiment is None or member.run is None:
        return np.full((record.shape[1], len(SIGNALS), record.shape[0]), np.nan), {}
    log = member.experiment.record(member.run, record)
    assert log.y_true is not None
    values = np.stack([column.reshape(log.N, -1).T for column in (log.u, log.y, log.y_true)], axis=1)
    return values, dict(log.meta)


def _model(experiment: Experiment) -> mujoco.MjModel:
    """The experiment's bench without textures: they take most of a model's build time and memory."""
    spec = bench_spec(experiment.joint, experiment.p, experiment.without, experiment.realisation)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    return spec.compile()
