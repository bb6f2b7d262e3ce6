"""Families of benchmark scenarios on the leg, and one line each in `TABLE`; see `sysid.bench`."""

from sysid.bench.task import Family
from twin.bench.families import Joints, Legs, Mismatch

TABLE: dict[str, Family] = {family.name: family for family in (Joints(), Legs(), Mismatch())}
