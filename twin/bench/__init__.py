"""Families of benchmark scenarios on the leg: one file each, and one line in `TABLE`; see `sysid.bench`."""

from sysid.bench.task import Family
from twin.bench.joints import Joints
from twin.bench.legs import Legs
from twin.bench.mismatch import Mismatch

TABLE: dict[str, Family] = {family.name: family for family in (Joints(), Legs(), Mismatch())}
