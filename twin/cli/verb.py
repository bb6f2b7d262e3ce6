"""A verb of the command line: what every verb looks at in its options before it begins."""

import os
import re
from collections.abc import Iterable
from typing import Any

from typer.core import TyperCommand

from sysid.base.errors import InputError

_HOME = re.compile(r"~(/|$)")  # a shell leaves it after an equals sign: --out=~/runs
_PLACE = re.compile(r"[\[{]?(FILE|DIR|LOG|MODEL|TABLE|BASE)\b")  # how a file or a folder is called in the help


class Verb(TyperCommand):
    """A verb that refuses a file or a folder without a name, and a text that no system takes."""

    def invoke(self, ctx: Any) -> Any:
        for parameter in self.get_params(ctx):
            if _given(ctx, parameter.name):
                _check(parameter, _texts(ctx.params.get(parameter.name)))
        return super().invoke(ctx)


def _given(ctx: Any, name: str) -> bool:
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _texts(value: Any) -> list[str]:
    each: Iterable[Any] = value if isinstance(value, (list, tuple)) else (value,)
    return [str(text) for text in each if text is not None]


def _check(parameter: Any, texts: list[str]) -> None:
    metavar, option = str(parameter.metavar or parameter.name), parameter.param_type_name == "option"
    called, remedy = (parameter.opts[0], f"give {metavar}, or leave it out") if option else (metavar, "give its name")
    for text in texts:
        if "\0" in text:
            raise InputError(f"{called} has a character of code 0; give a text without it")
        if _PLACE.match(metavar) and not text.strip():
            raise InputError(f"{called} is {text!r}, which names no file or folder; {remedy}")
        if option and _PLACE.match(metavar) and _HOME.match(text) and not os.path.lexists(text):
            home = os.path.expanduser(text)
            raise InputError(
                f"{called} is {text!r}, and the shell has not put your home folder in place of ~; give {home!r}, or "
                "./~ where a folder has this name"
            )
