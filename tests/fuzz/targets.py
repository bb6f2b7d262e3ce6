"""What is fuzzed, and its share of the cases."""

from fuzz.journals import Journals
from fuzz.logs import Logs
from fuzz.models import Models
from fuzz.parameters import ParameterFiles
from fuzz.sessions import Sessions

TARGETS = {each.name: each for each in (Logs, Models, Journals, ParameterFiles, Sessions)}
SHARES = {"logs": 40, "models": 10, "journals": 15, "parameters": 20, "sessions": 15}
