"""Words for units of time in the names of columns, in the languages that logs are written in."""

import re

_SINGULAR = {  # these also count something else (`time_of_day`, a second run): a unit only as a whole name
    "s": "s second sekunde seconde segundo secondo",
    "min": "min minute minuto",
    "h": "h hour hr std stunde heure hora ora ore",
    "day": "d day tag jour dia día giorno giorni",
    "ms": "millisecond millisekunde milliseconde milisegundo millisecondo",
    "us": "microsecond mikrosekunde microseconde microsegundo microsecondo",
    "ns": "nanosecond nanosekunde nanoseconde nanosegundo nanosecondo",
}
_PLURAL = {
    "s": "sec secs seconds sekunden sek secondes segundos secondi",
    "min": "mins minutes minuten minutos minuti",
    "h": "hours hrs stunden heures horas",
    "day": "days tage jours dias días",
    "ms": "ms msec msecs millis millisec millisecs milliseconds millisekunden millisecondes milisegundos millisecondi",
    "us": "us µs μs usec usecs micros microsec microsecs microseconds mikrosekunden microsecondes microsegundos "
    "microsecondi",
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanoseconds nanosekunden nanosecondes nanosegundos nanosecondi",
}
ANYWHERE = {word: unit for unit, words in _PLURAL.items() for word in words.split()}
ALONE = {word: unit for unit, words in _SINGULAR.items() for word in words.split()}
WORDS = ANYWHERE | ALONE
UNSURE = ("d", "h")  # a height, a host's or a device's clock as often as days and hours
_TIME = "t|time|timestamp|stamp|clock|elapsed|uptime|duration|zeit|laufzeit|temps|tiempo|tempo"
_NAMED = re.compile(rf"(?:(?:{_TIME})(?:[\W_]*|[\W_]+in[\W_]+))?(?P<unit>{'|'.join(sorted(WORDS, key=len)[::-1])})")
# hhmmss: a time of day written as one number.
DIGITS = re.compile(r"(?:[yj]{2,4}m{2}[dt]{2})?(?:h{2}m{2}(?:s{1,2})?|hms)")


def as_whole(name: str) -> str:
    """The word that a name is but for a word for time before it: `Stunden`, `t_min`, `tms`; nothing for others."""
    found = _NAMED.fullmatch(name.strip().lower())
    return found["unit"] if found else ""
