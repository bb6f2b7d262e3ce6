"""Causes of a departure that are outside the twin, one a file; `CAUSES` are these and the twin's own effects."""

from twin.compare.effects import TABLE, Effect
from twin.compare.structures._declaration import Structure
from twin.compare.structures.cogging import COGGING
from twin.compare.structures.creep import CREEP
from twin.compare.structures.drag import DRAGS
from twin.compare.structures.give import GIVES
from twin.compare.structures.heat import HEAT
from twin.compare.structures.hysteresis import HYSTERESIS
from twin.compare.structures.place import RUBBING
from twin.compare.structures.spring import SPRING
from twin.compare.structures.wave import WAVE

STRUCTURES: dict[str, Structure] = {
    s.name: s for s in (SPRING, HYSTERESIS, CREEP, WAVE, GIVES, HEAT, COGGING, RUBBING, DRAGS)
}
CAUSES: dict[str, Effect] = {**TABLE, **STRUCTURES}
