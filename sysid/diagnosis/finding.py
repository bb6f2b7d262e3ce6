"""One finding on a record: what was found, what to do, and the call or command that does it."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sysid.data.record import IOData

LEVEL = 0.01  # false-alarm rate of each statistical test


@dataclass(frozen=True)
class Advice:
    """One finding: `severity` is 'fine', 'note' or 'warning', `value` the number behind the sentence.

    `interval` holds the value with 99 % confidence, where it is an estimate that has one. `action` says what to do.
    `call` does it in Python, for the record `data`; `command` are the verb of `qpal` and its options that do it.
    """

    topic: str
    sentence: str
    value: float
    action: str
    severity: str
    interval: tuple[float, float] | None = None
    call: str = ""
    command: tuple[str, ...] = ()

    def __str__(self) -> str:
        todo = ": ".join(part for part in (self.action, self.call) if part)
        return f"{self.sentence}; {todo}" if todo else self.sentence

    def of_file(self, path: str, options: Sequence[str] = ()) -> "Advice":
        """The same about the file at `path`, which `options` of the command line read: `action` ends in the command.

        Where only Python does it, `action` ends in the call.
        """
        remedy = f"in Python, {self.call}" if self.call else ""
        if self.command:
            verb, *verb_options = self.command
            remedy = shlex.join(["qpal", verb, path, *options, *verb_options])
        return replace(self, action=": ".join(part for part in (self.action, remedy) if part), call="", command=())


def channel(data: IOData, role: str, k: int) -> str:
    """Name of input ("u") or output ("y") k of the record, with its number where there are several."""
    name = data.u_name if role == "u" else data.y_name
    many = (data.u if role == "u" else data.y).shape[1] > 1
    return f"{name}{k + 1}" if many else name


def aprbs(data: IOData, i: int) -> str:
    """The call that makes an input of this record's range, length and sampling time with many levels."""
    low, high, length = float(data.u[:, i].min()), float(data.u[:, i].max()), data.N * data.Ts
    size, holds = (high - low) / 2.0 or 1.0, (length / 200.0, length / 20.0)
    settings = f"{size:.4g}, {holds[0]:.3g}, {holds[1]:.3g}, offset={(low + high) / 2.0:.4g}"
    return f"sysid.excitations.Aprbs({settings}).generate({data.N}, {data.Ts:.6g}, np.random.default_rng(0))"
