"""Options that verbs share, options whose text is parsed, and what every verb looks at before it begins."""

import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from sysid.base.errors import InputError
from sysid.formats import TABLE as FORMATS

if TYPE_CHECKING:
    from sysid.channels.mapping import Range as TimeRange
    from sysid.model.recipes import Option
    from twin.log import Log
    from twin.parameters import Parameters

Out = Annotated[
    str | None,
    typer.Option(
        "--out", metavar="DIR", help="where to write, over files of the same name; runs/<stamp>-<verb> if not given"
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print only the summary, as JSON")]
Params = Annotated[
    str | None,
    typer.Option("--params", metavar="FILE", help="file of parameters to change (.toml or .json); see qpal info"),
]


def number(metavar: str, help: str) -> Any:
    """An option that takes a number."""
    return typer.Option(parser=_parse_number, metavar=metavar, help=help)


def whole_number(metavar: str, help: str) -> Any:
    """An option that takes a whole number."""
    return typer.Option(parser=_parse_whole, metavar=metavar, help=help)


def name(help: str, choices: Iterable[str]) -> Any:
    """An option that takes a name of a table; the owner of the table checks the name."""
    return typer.Option(metavar="NAME", help=f"{help}: {', '.join(choices)}")


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"found {text!r}, give a number") from None


def _parse_whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"found {text!r}, give a whole number") from None


# What a verb that reads a record takes: the file and its columns.
RecordFile = Annotated[str, typer.Argument(metavar="FILE", help=f"a table: {', '.join(FORMATS)}")]
RecordFiles = Annotated[
    list[str], typer.Argument(metavar="FILE...", help=f"tables ({', '.join(FORMATS)}); each is one experiment")
]
Input = Annotated[
    str | None, typer.Option("--input", metavar="COL", help="column of the input; a,b where a model has two")
]
Output = Annotated[
    str | None, typer.Option("--output", metavar="COL", help="column of the output; a,b where a model has two")
]
Model = Annotated[
    str | None, typer.Option("--model", metavar="FILE", help="MJCF of a robot, whose joints are meant, not the leg's")
]
Actuator = Annotated[
    str, typer.Option("--actuator", metavar="A,B", help="with --model: actuators whose joints are logged")
]
Ts = Annotated[float | None, number("S", "sampling time in seconds")]
Time = Annotated[str | None, typer.Option("--time", metavar="COL", help="time column, instead of --ts")]
TimeUnit = Annotated[
    str | None, typer.Option("--time-unit", metavar="UNIT", help="unit of --time if it names none: s, ms, us, ns, day")
]
Map = Annotated[
    str | None, typer.Option("--map", metavar="FILE.toml", help="mapping from columns to channels; see qpal info FILE")
]
Range = Annotated[
    str | None, typer.Option("--range", metavar="A:B", help="part of the record, in seconds after its first sample")
]

Budget = Annotated[
    float | None, number("S", "budget of the search, which then ends with the best so far; none if not given")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do it, for example tcp://host:8786"
    ),
]


def orders(text: str, names: "dict[str, Option]", example: str) -> dict[str, int]:
    """Orders by name from '2,3,1'; `names` holds what each is, in the order in which they are given."""
    parts = [part.strip() for part in text.split(",")]
    meanings = ", ".join(f"{name} ({option.help})" for name, option in names.items())
    advice = f"give {len(names)} whole numbers: {meanings}, for example {example}"
    if len(parts) != len(names):
        raise InputError(f"--orders is {text!r} with {len(parts)} part(s); {advice}")
    try:
        values = dict(zip(names, map(int, parts), strict=True))
    except ValueError:
        raise InputError(f"--orders is {text!r}, which are not all whole numbers; {advice}") from None
    for name, value in values.items():
        if not (least := names[name].least) <= value <= 100:
            raise InputError(f"--orders is {text!r} with {name} {value}; give {name} from {least} to 100")
    return values


def given(values: Mapping[str, str | None]) -> list[str]:
    """The words of a command that gives these options, without those that have no value."""
    return [word for name, value in values.items() if value for word in (name, value)]


def of_robot(model: str, actuator: str, input: str | None, output: str | None, map: str | None) -> list[str]:
    """The words of a command about a robot, beside its logs."""
    return given({"--model": model, "--actuator": actuator, "--input": input, "--output": output, "--map": map})


def check_sides(model: str | None, of_robot: Mapping[str, str | None], of_leg: Mapping[str, str | None]) -> None:
    """Raises InputError for options that belong to the leg where a robot is meant, and the other way round."""
    for name, value in (of_robot if model is None else of_leg).items():
        if value and model is None:
            raise InputError(f"{name} belongs to a robot's MJCF: give it with --model, or leave {name} out")
        if value:
            raise InputError(f"{name} belongs to the leg, and --model is {model}; leave one of the two out")


def names(text: str) -> tuple[str, ...]:
    """Names from 'a,b'; none from an empty text."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def settings(text: str) -> dict[str, float | str]:
    """Values by name from 'amplitude=6,grid=odd', converted to numbers if possible."""
    values: dict[str, float | str] = {}
    for part in names(text):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not (name and equals and value):
            raise InputError(f"--set has {part!r}; give name=value, several separated by commas")
        if name in values:
            raise InputError(f"--set names {name} twice; give it once")
        try:
            number = float(value)
            values[name] = int(number) if number.is_integer() and value.lstrip("+-").isdigit() else number
        except ValueError:
            values[name] = value
    return values


def budget(seconds: float | None) -> float:
    """The seconds that a search may take; infinite where none are given."""
    if seconds is None:
        return math.inf
    if not 0.0 < seconds < math.inf:
        raise InputError(f"--seconds is {seconds:g}; give a positive number, or leave it out")
    return seconds


def seed(value: int) -> int:
    """A seed that NumPy takes."""
    if value < 0:
        raise InputError(f"--seed is {value}; give a whole number of at least 0")
    return value


def time_range(text: str | None) -> "TimeRange":
    """The part of a record that --range names; all of it if it is not given."""
    from sysid.channels.mapping import Range
    from sysid.channels.reading import parse_range

    return Range() if text is None else parse_range(text)


def band(text: str | None) -> "tuple[float | None, float | None]":
    """The band (low, high) [Hz] that --filter names; (None, None) if it is not given."""
    if text is None:
        return None, None
    low, high = _pair("--filter", text, "LOW:HIGH in Hz, such as 0.1:5, or :5 for a low-pass, 0.1: for a high-pass")
    for end in (low, high):
        if end is not None and not 0 < end < math.inf:
            raise InputError(f"--filter is {text!r}; give frequencies above 0 Hz")
    return low, high


def fixed_parameters(texts: Iterable[str]) -> tuple[tuple[str, float | None], ...]:
    """Names and values from 'role.name=value'; None where no value is given, for that of the start."""
    values: dict[str, float | None] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        _check_new("--fix", name, values)
        try:
            number = float(value) if equals else None
        except ValueError:
            number = math.nan
        if not name or (number is not None and not math.isfinite(number)):
            raise InputError(f"--fix is {text!r}; give role.name=VALUE, such as linear.f1=-0.9, or role with --from")
        values[name] = number
    return tuple(values.items())


def parameter_bounds(texts: Iterable[str]) -> tuple[tuple[str, tuple[float, float]], ...]:
    """Names and bounds from 'role.name=LOW:HIGH'; an end that is left out is infinite."""
    values: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, ends = (part.strip() for part in text.partition("="))
        _check_new("--bound", name, values)
        form = "role.name=LOW:HIGH, such as linear.f1=-1:-0.5 or linear.b0=0:"
        low, high = _pair("--bound", ends, form, text)
        if not name:
            raise InputError(f"--bound is {text!r}; give {form}")
        values[name] = (-math.inf if low is None else low, math.inf if high is None else high)
    return tuple(values.items())


def _check_new(option: str, name: str, names: Iterable[str]) -> None:
    if name in names:
        raise InputError(f"{option} names {name} twice; give it once")


def _pair(option: str, text: str, form: str, full_text: str | None = None) -> tuple[float | None, float | None]:
    """Two numbers around a colon, of which one may be left out."""
    first, mark, last = text.partition(":")
    try:
        low, high = (float(part) if part.strip() else None for part in (first, last))
    except ValueError:
        mark = ""
    if not mark or (low is None and high is None) or any(math.isnan(end) for end in (low, high) if end is not None):
        raise InputError(f"{option} is {(text if full_text is None else full_text)!r}; give {form}")
    return low, high


def parameters(file: str | None) -> "Parameters | None":
    """The twin's parameters from the file of --params; None if no file is given."""
    if file is None:
        return None
    from twin.parameter_file import check_together, read

    values = read(file)
    check_together(values, file)
    return values


def second_log(path: str, map: str | None) -> "Log":
    """A log beside another one that `map` reads; the mapping is not for a log that this program wrote."""
    from sysid.formats import read_table
    from twin.log import Log

    return Log.load(path, None if map is None or "joint" in read_table(path).meta else map)


_HOME = re.compile(r"~(/|$)")  # a shell leaves it after an equals sign: --out=~/runs
_PLACE = re.compile(r"[\[{]?(FILE|DIR|LOG|MODEL|TABLE|BASE)\b")  # how a file or a folder is called in the help


ALL = "--help-all"


def shows(*names: str, more: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> Callable[..., Any]:
    """Decorator of a verb whose help shows the options `names`, and those that `more` gives for the values given, as it
    describes them; --help-all shows all."""

    def mark(verb: Any) -> Any:
        verb.shown, verb.more = names, more
        return verb

    return mark


class Verb(TyperCommand):
    """A verb that refuses an option given twice, a file or a folder without a name, and a text that no system takes."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        names = getattr(self.callback, "shown", ())
        shows_all = bool(names) and ALL in args
        args = ["--help"] if shows_all else args
        given, _, order = self.make_parser(ctx).parse_args(list(args))  # a value for each time that it was given
        if names and not shows_all:
            ctx.meta[ALL] = dict.fromkeys((*names, "help")) | self.callback.more(given)  # type: ignore[union-attr]
        for parameter in order:
            once = parameter.param_type_name == "option" and not (
                parameter.multiple or getattr(parameter, "is_flag", False)
            )
            if once and order.count(parameter) > 1:
                raise InputError(
                    f"{parameter.opts[0]} is given {order.count(parameter)} times; give it once, with commas between "
                    "several values"
                )
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        params, shown = self.params, ctx.meta.get(ALL)
        if shown is None:
            return super().format_options(ctx, formatter)
        try:
            self.params = [copy(p) for p in params if p.param_type_name == "argument" or p.name in shown]
            for p in self.params:
                if own := shown.get(p.name):
                    p.help, p.metavar = own.help, own.metavar  # type: ignore[attr-defined]
            super().format_options(ctx, formatter)
        finally:
            self.params = params
        formatter.write_paragraph()
        formatter.write_text(
            f"--structure NAME --help shows the options of a structure too, {ALL} all {len(params)} of this verb."
        )

    def invoke(self, ctx: Any) -> Any:
        for parameter in self.get_params(ctx):
            if _given(ctx, parameter.name):
                _check(parameter, _texts(ctx.params.get(parameter.name)))
        return super().invoke(ctx)


def _given(ctx: Any, name: str) -> bool:
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _texts(value: Any) -> list[str]:
    items: Iterable[Any] = value if isinstance(value, (list, tuple)) else (value,)
    return [str(text) for text in items if text is not None]


def _check(parameter: Any, texts: list[str]) -> None:
    """Raises InputError for a text of `parameter` that no file system takes, or that names nothing."""
    metavar, option = str(parameter.metavar or parameter.name), parameter.param_type_name == "option"
    label, remedy = (parameter.opts[0], f"give {metavar}, or leave it out") if option else (metavar, "give its name")
    for text in texts:
        if "\0" in text:
            raise InputError(f"{label} has a character of code 0; give a text without it")
        if _PLACE.match(metavar) and not text.strip():
            raise InputError(f"{label} is {text!r}, which names no file or folder; {remedy}")
        if option and _PLACE.match(metavar) and _HOME.match(text) and not os.path.lexists(text):
            home = os.path.expanduser(text)
            raise InputError(
                f"{label} is {text!r}, and the shell has not put your home folder in place of ~; give {home!r}, or "
                "./~ where a folder has this name"
            )
