"""The records of one identification as they were read, and what a setting is fitted to: two parts of one record."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError, unknown
from sysid.channels.one_record import COLUMNS, as_one
from sysid.data.preparation import Preparation
from sysid.data.record import IOData
from sysid.data.trends import with_offsets
from sysid.diagnosis.advice import Advice, advise
from sysid.formats import read_table
from sysid.selection.table import SECONDS
from sysid.solver.searches import TABLE as SEARCHES
from sysid.workflow.evaluation import check_parts, moves_in_one_part
from sysid.workflow.plan import Plan, check_same_channels, merge_records, prepare_record
from sysid.workflow.record import Record, with_places, without_wraps
from sysid.workflow.servo import with_servo, with_turn
from sysid.workflow.setting import Setting, in_unit_of


@dataclass(frozen=True)
class Auto:
    """A search over structures instead of one setting; `journal` keeps finished candidates if the run is stopped.

    `seconds` is its budget. `scheduler` is the address of a Dask scheduler whose workers judge the candidates; local
    processes do if None.
    """

    search: str = "auto"
    starts: int = 5
    seed: int = 0
    journal: Path | None = None
    scheduler: str | None = None
    seconds: float = SECONDS

    def __post_init__(self) -> None:
        if not self.seconds > 0:
            raise InputError(f"--seconds is {self.seconds:g}; give a positive number of seconds")
        if self.search not in SEARCHES:
            raise unknown("search", self.search, SEARCHES)


@dataclass(frozen=True)
class Sources:
    """The records as they were read, and what is done to each."""

    records: list[Record]
    validation: list[Record]
    preparation: Preparation

    def prepared(self, setting: Setting | Auto, split: float | None, detrend: str, diagnose: bool = True) -> "Prepared":
        """What a setting is fitted to, and the findings on it where they are wanted."""
        records, validation_records = list(self.records), list(self.validation)
        with named(records[0].path):
            if isinstance(setting, Setting):
                recipe, records[0] = in_unit_of(records[0], setting.recipe)
                recipe, records[0] = with_servo(recipe, [*records, *validation_records])
                records[0] = with_turn(recipe, records[0])
                setting = replace(setting, recipe=recipe)
            if isinstance(setting, Setting) and setting.recipe.moves:
                records, validation_records = ([with_places(r) for r in rs] for rs in (records, validation_records))
            absolute = isinstance(setting, Auto) or bool(setting.recipe.zero)
            record = merge_prepared(records, absolute, self.preparation)
            validation = None
            if validation_records:
                validation = merge_prepared(validation_records, absolute, self.preparation)
                check_same_channels(record, validation)
                validation = replace(validation, data=replace(validation.data, Ts=record.data.Ts))
            plan = _split(
                Plan(self.preparation, 0.5 if split is None else split, detrend, validation), record, split, setting
            )
            estimation, validation_part = plan.parts(record.data)
            start = setting.held.start if isinstance(setting, Setting) else None
            if start is not None and detrend == "none":
                zero = start.u_offset, start.y_offset
                estimation = with_offsets(estimation, *zero)
                validation_part = estimation if plan.whole else with_offsets(validation_part, *zero)
            check_parts(estimation, validation_part)
            findings = advise(record.data) if diagnose else ()
        return Prepared(setting, record, plan, (estimation, validation_part), findings)


@dataclass(frozen=True)
class Prepared:
    """A setting in the units of its record, the record, and its two parts for fit and validation."""

    setting: Any  # as was given, a Setting or an Auto
    record: Record
    plan: Plan
    parts: tuple[IOData, IOData]
    findings: tuple[Advice, ...]


def _split(plan: Plan, record: Record, split: float | None, setting: Setting | Auto) -> Plan:
    """The plan, or that of the whole record where no half of it can validate the other."""
    if plan.validation is not None or not moves_in_one_part(*plan.parts(record.data)):
        return plan
    if split is not None:
        raise InputError(
            f"with --split {split:g} the input moves in one of the two parts alone; choose another split, or "
            "leave --split out: where the halves are so too, as in a step test, all is used for the fit"
        )
    if isinstance(setting, Auto):
        raise InputError(
            "the input moves in one half of the record alone, and a structure search fits each half and judges "
            "it by the other; name a structure, such as --structure output_error, or record again"
        )
    return replace(plan, whole=True)


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Every InputError names the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def merge_prepared(records: Sequence[Record], absolute: bool, preparation: Preparation) -> Record:
    """The records as they are fitted, as the experiments of one."""
    if absolute:  # a structure of absolute angles
        records = [without_wraps(record) for record in records]
    return merge_records([prepare_record(record, preparation) for record in records], absolute)


def records_of(paths: Sequence[str | os.PathLike[str]], read: Callable[..., Record]) -> list[Record]:
    """The record of each file, or that of all where each holds one signal of it."""
    if len(paths) < 2:
        return [read(path) for path in paths]
    first = read_table(paths[0])
    if len(first.names) > COLUMNS:  # one after the other: long records have no room beside each other
        return [read(first), *(read(path) for path in paths[1:])]
    tables = [first, *(read_table(path) for path in paths[1:])]
    if (table := as_one(tables)) is not None:
        return [replace(read(table), beside=tuple(Path(path) for path in paths[1:]))]
    return [read(table) for table in tables]
