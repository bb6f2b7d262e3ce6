"""Sentences of the command line with the page's controls in place of its options."""

import re

CONTROLS = {  # by option, the label of the page's control
    "input": "input",
    "output": "output",
    "time": "time",
    "ts": "sampling time",
    "range": "from and to",
    "missing": "missing samples",
    "resample": "new sampling time",
    "filter": "high-pass and low-pass",
    "detrend": "offsets",
    "zero": "offsets",
    "validation": "records that judge the model",
    "structure": "structure",
    "starts": "starts",
    "seed": "seed",
    "split": "estimation part",
    "seconds": "seconds of the search",
    "fix": "held at",
    "bound": "bounds",
    "from": "start from",
    "horizon": "samples ahead",
}
_OPTION = re.compile(r"--([a-z][a-z-]*)\b")


def words_of_page(sentence: str, names: dict[str, str] | None = None) -> str:
    """The sentence with the name that a file has on the page, and the control for each option that has one."""
    for path, name in (names or {}).items():
        sentence = sentence.replace(path, name)
    sentence = re.sub(r"--structure auto\b", "'Search for a structure'", sentence)
    return _OPTION.sub(lambda found: f"'{CONTROLS[found[1]]}'" if found[1] in CONTROLS else found[0], sentence)
