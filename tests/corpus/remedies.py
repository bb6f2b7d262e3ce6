"""What a person does who takes a refusal at its word: options, entries of a mapping, a corrected cell or row."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from corpus._log import TS, Log
from sysid.base.errors import InputError
from sysid.workflow.record import read_record

# Sentences that ask for another file or another recording: nothing that is done to this one helps.
ANOTHER = (
    "record again|record it again|give a log that|save it again|write it again|save it as|save input and output|"
    "save plain arrays|save the lines of each form|give a file with|give a text table|unknown file suffix|"
    "has 1 sample|keep the lines of one form|give one sample a line|choose a column that moves|"
    "give the column in a sensible unit|split it there into two|parted by|give a list of samples|"
    "give every sample the same|never rises|give every row the same number|write all numbers with a decimal point|"
    "correct its quotes|write the numbers with a decimal point|name two of one length|give one number a cell"
)
MOST = 60  # remedies one after the other: no file of the corpus has more bad cells
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".log")  # which a person edits; a program writes the others again


@dataclass(frozen=True)
class Try:
    """A log with what was changed so far: options of the reading, a mapping of ranges and repairs, its text."""

    entry: Log
    options: dict[str, Any] = field(default_factory=dict)
    repair: dict[str, str] = field(default_factory=dict)
    content: bytes = b""
    clocks: tuple[str, ...] = ()  # of u and of y, in a mapping
    experiment: str = ""  # of [range] in a mapping
    words: tuple[str, ...] = ()  # the clock, and columns of hexadecimal words, in a mapping

    def arguments(self, folder: Path) -> tuple[Path, dict[str, Any]]:
        """The file in `folder`, and the arguments that read it."""
        for name, content in {**self.entry.beside, self.entry.file: self.content}.items():
            (folder / name).write_bytes(content)
        options = dict(self.options)
        if self.repair or self.clocks or self.experiment or self.words:
            lines = [f'[range]\nexperiment = "{self.experiment}"'] if self.experiment else []
            lines += ["[repair]", *(f"{name} = {value}" for name, value in self.repair.items())]
            for role, column, clock in zip(("input", "output"), "uy", self.clocks, strict=False):
                lines += [f"[[{role}]]", f'column = "{column}"', f'clock = "{clock}"']
            for role, column in zip(("input", "output"), self.words[1:], strict=False):
                lines += [f"[[{role}]]", f'column = "{column}"', "base = 16"]
            lines += ["[clock]", f'column = "{self.words[0]}"'] if self.words else []
            (folder / "m.toml").write_text("\n".join(lines) + "\n")
            options = {"mapping": folder / "m.toml", **{k: v for k, v in options.items() if k == "range"}}
        return folder / self.entry.file, options


def first(entry: Log) -> Try:
    """The log as it lies there."""
    return Try(entry, dict(entry.options), {}, entry.content)


def followed(attempt: Try, said: str) -> Iterator[Try]:
    """What each remedy of the sentence `said` makes of the attempt."""
    for pattern, act in RULES:
        for match in re.finditer(pattern, said):
            changed = act(attempt, match, said)
            if changed is not None:
                yield changed


def said(attempt: Try, folder: Path) -> str:
    """The refusal, without the folder; nothing for a record."""
    path, options = attempt.arguments(folder)
    try:
        read_record(path, **options)
    except InputError as error:
        return str(error).replace(f"{folder}/", "")
    return ""


def dead_end(attempt: Try, sentence: str, folder: Path, before: frozenset[tuple[str, bytes]] = frozenset()) -> str:
    """Where the remedies of a refusal end without a record, each followed in turn; nothing if all lead to one."""
    before |= {(sentence, attempt.content)}
    tries = list(followed(attempt, sentence))
    by_program = Path(attempt.entry.file).suffix not in TEXTS
    if not tries and not by_program and not re.search(ANOTHER, sentence):
        return f"no remedy in: {sentence}"
    for changed in tries:
        following = said(changed, folder)
        if following and ((following, changed.content) in before or len(before) > MOST):
            return f"comes back: {following}"
        if following and (end := dead_end(changed, following, folder, before)):
            return end
    return ""


def _option(attempt: Try, **options: Any) -> Try:
    return replace(attempt, options=attempt.options | options)


def _place(said: str) -> tuple[int, str]:
    """The row in a sentence, from 0, and what was found there."""
    row, found = (
        re.search(r"(?:row|entry|element) (\d+)", said),
        re.search(r"(?:found|has) (?:'((?:[^']|'(?=\w))*)'|\"([^\"]*)\")", said),
    )
    text = (found[1] or found[2] or "") if found else ""
    return (int(row[1]) - 1 if row else -1), text.replace("\\u202f", "\u202f")


def _edit(attempt: Try, said: str, new: str | None) -> Try | None:
    """The file with another cell in the row of the sentence, or without the row where `new` is None."""
    row, found = _place(said)
    if Path(attempt.entry.file).suffix not in TEXTS:
        return None  # a program wrote it, and writes it again
    try:
        lines = attempt.content.decode("utf-8-sig").splitlines(keepends=True)
    except UnicodeDecodeError:
        return None
    if not 0 <= row < len(lines):
        return None
    if new is None:
        lines[row] = ""
    elif found and found.removesuffix("...") in lines[row]:
        if found.endswith("..."):
            lines[row] = re.sub(re.escape(found[:-3]) + r"[^,;\t\n]*", new, lines[row])
        else:
            lines[row] = lines[row].replace(found, new, 1)
    else:
        return None
    return replace(attempt, content="".join(lines).encode())


def _column(attempt: Try, match: re.Match[str], said: str) -> Try | None:
    """Another column of those that the sentence names, or the rig's own."""
    named = re.search(
        r"(?:columns?|names|choose one of|found \d+ columns?) \(?((?:'[^']+'(?:, | and )?)+|[^;)]+)\)?", said
    )
    names = re.findall(r"'([^']+)'", named[1]) if named and "'" in named[1] else named[1].split(", ") if named else []
    names = [
        name
        for name in names
        if name not in attempt.options.values() and not re.search(rf"which .*\b{name} .*show", said)
    ]
    roles = re.findall(r"--(input|output)", match[0])
    if len(names) < len(roles):
        return None
    return _option(attempt, **dict(zip(roles, names[-len(roles) :], strict=True)))


def _repair(**entries: str) -> Callable[[Try, re.Match[str], str], Try]:
    return lambda attempt, match, said: replace(attempt, repair=attempt.repair | entries)


def _timed(attempt: Try) -> Try:
    """With the sampling time in place of a clock."""
    kept = {name: value for name, value in attempt.options.items() if name not in ("time", "time_unit")}
    return replace(attempt, options=kept | {"Ts": TS}, repair={})


def _without(attempt: Try, name: str) -> Try:
    return replace(attempt, options={k: v for k, v in attempt.options.items() if k != name})


def _named(said: str) -> str:
    found = re.search(r"'([^']+)'", said)
    return found[1] if found else ""


def _range(text: str) -> Any:
    from sysid.channels.reading import parse_range

    return parse_range(text)


def _sorted(attempt: Try) -> Try:
    """With the rows in the order of the clock in their first cell."""
    lines = attempt.content.splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if line[:1].isdigit())
    rows = sorted(lines[first:], key=lambda line: float(line.split(b",")[0]))
    return replace(attempt, content=b"".join(lines[:first] + rows))


def _renamed(attempt: Try, said: str) -> Try:
    """With another name for the first of two columns of one."""
    name = _named(said).encode()
    line = next(line for line in attempt.content.splitlines() if name in line)
    changed = re.sub(rb"(?<!\w)" + re.escape(name) + rb"(?!\w)", b"other%d" % len(line), line, count=1)
    return replace(attempt, content=attempt.content.replace(line, changed, 1))


def _known(attempt: Try, match: re.Match[str], said: str) -> Try | None:
    """With a column of the file in place of one that is not there."""
    names = attempt.content.decode().splitlines()[0].split(",")
    places = {"input": -2, "output": -1}
    roles = [role for role in places if attempt.options.get(role) == match[1]]
    return _option(attempt, **{role: names[places[role]] for role in roles}) if roles else None


def _own_clocks(attempt: Try, match: re.Match[str], said: str) -> Try | None:
    """With the two columns of the sentence as the clocks of input and output."""
    names = re.findall(r"'([^']+)'", said)
    return replace(attempt, clocks=tuple(names[:2])) if "do not agree" in said else None


RULES: tuple[tuple[str, Callable[[Try, re.Match[str], str], Try | None]], ...] = (
    (
        r"of which (.+) shows time; hexadecimal words without 0x are in ([^:]+): set base = 16",
        lambda attempt, match, _: replace(attempt, words=(match[1], *match[2].split(", "))),
    ),
    (r"with --ts\b|--ts SECONDS", lambda a, m, s: None if "Ts" in a.options else _timed(a)),
    (r"--ts is [^;]*; (?:leave one|give)", lambda a, m, s: _without(a, "Ts") if "leave" in m[0] else _option(a, Ts=TS)),
    (r"--time '([^']+)' --time-unit", lambda a, m, s: _option(a, time=m[1], time_unit="s")),
    (r"name (?:one|the clock) with --time\b", lambda a, m, s: _option(a, time=_named(s))),
    (r"with --time '([^']+)'(?! --time-unit)", lambda a, m, s: _option(a, time=m[1])),
    (r"(?:name|choose) [^;]*--(?:input|output)(?: and one with --output)?", _column),
    (r"--range (\S+\d) or", lambda a, m, s: _option(a, range=_range(m[1]))),
    (r"--range (?:\S+ or )?([\d.:e+]+\d)(?:[;,]|$)", lambda a, m, s: _option(a, range=_range(m[1]))),
    (r"longest_gap and most_lost", _repair(longest_gap="1000000", most_lost="1.0")),
    (r'experiment = "([^"]+)" under', lambda a, m, s: replace(a, experiment=m[1])),
    (r'backward = "drop"', _repair(backward='"drop"')),
    (r"remove the row|remove (?:it )?or (?:fill|correct)", lambda a, m, s: _edit(a, s, None)),
    (r"correct the cell: write (-?[\d.,e+]+)", lambda a, m, s: _edit(a, s, m[1])),
    (r"thousands marks, (-?[\d.,]+) if that", lambda a, m, s: _edit(a, s, m[1])),
    (r"correct the cell(?!:)|correct them", lambda a, m, s: None if "holds dates" in s else _edit(a, s, "1.5")),
    (r"empty the cell", lambda a, m, s: replace(_edit(a, s, "") or a, options=a.options | {"missing": "keep"})),
    (r"sort the rows by it and leave --ts out", lambda a, m, s: _without(_sorted(a), "Ts")),
    (r"(?<!sort the rows by it and )leave --ts out", lambda a, m, s: _without(a, "Ts")),
    (r"clock of \[\[input\]\] and of \[\[output\]\]", _own_clocks),
    (r"leave unit and period", lambda a, m, s: _without(a, "time_unit")),
    (
        r"inputs that act together: --input (\S+) --output (\S+)$",
        lambda a, m, s: _option(a, input=m[1].split(",")[0], output=m[2]),
    ),
    (r"rename one of them", lambda a, m, s: _renamed(a, s)),
    (r"write numbers alone", lambda a, m, s: _edit(a, s, re.match(r"[-\d.,]+", _place(s)[1])[0])),
    (r"unknown column '([^']+)'; choose one of", _known),
    (r"column '(\w+)' is given as input and as output; name two", lambda a, m, s: _option(a, input="u", output="y")),
)
