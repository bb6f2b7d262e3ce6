"""Families of scenarios: one file each, and one line in `TABLE`."""

from sysid.bench.scenarios.random_plants import RandomPlants
from sysid.bench.scenarios.real import Real
from sysid.bench.scenarios.stress import Stress
from sysid.bench.scenarios.textbook import Textbook
from sysid.bench.task import Family

TABLE: dict[str, Family] = {family.name: family for family in (RandomPlants(), Real(), Stress(), Textbook())}
