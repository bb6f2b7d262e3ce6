"""What is fuzzed, and how many cases a full run has."""

from fuzz.binaries import Binaries
from fuzz.journals import Journals
from fuzz.logs import Logs
from fuzz.models import Models
from fuzz.parameters import ParameterFiles
from fuzz.sessions import Sessions

TARGETS = {each.name: each for each in (Logs, Binaries, Models, Journals, ParameterFiles, Sessions)}
SIZES = dict(zip(TARGETS, (35_000, 15_000, 10_000, 13_000, 15_000, 12_000), strict=True))
