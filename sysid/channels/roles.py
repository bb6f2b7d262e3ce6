"""Which columns are the input and the output: by name, by unit, then by the numbers alone."""

import shlex
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.base.quantities import SHARE
from sysid.channels.column import Column, misspelt_number, words
from sysid.channels.complaints import brief, list_names
from sysid.channels.conversion import convert
from sysid.data.hexadecimal import columns_of_words
from sysid.data.table import Table

FREQUENCY = words("frequency freq frequenz f hz")  # rises evenly in a chirp, and is no clock
COUNTERS = words("index idx sample samples k n i row seq sequence frame counter count id")
INPUT = words("u voltage volts volt pwm duty cmd command commanded input in control ctrl")
REFERENCE = words("reference ref goal setpoint target desired des cmd command commanded")
OUTPUT = words("y angle pos position adc pot potentiometer theta q encoder enc output out winkel")
# The output of a controller is the input of what it moves: controller_output beside sensor_input.
CONTROLLER = words("controller control ctrl pid mpc regler actuator drive driver amplifier dac")
SENSOR = words("sensor adc daq measurement feedback")
NEVER = words("true error err std sigma var residual enable enabled flag state status")
AUXILIARY = words(
    "speed velocity vel omega rate acceleration acc accel temp temperature load current torque supply vin vbat battery "
    "vcc vdd power effort gyro"
)
SPEED = words("speed velocity vel omega rpm drehzahl")  # an output where no other column can be one
# Of a file of two columns these say which is which; among more columns they may mean something else.
WEAK_INPUT = words(
    "inputs uin excitation excite stimulus drive actuator actuation torque force current load power effort cmds "
    "commands eingang spannung stellwert sollwert pump pumpe valve ventil heater heizung fan"
)
WEAK_OUTPUT = words(
    "outputs yout uout response measured measurement meas sensor reading speed velocity vel omega rate acceleration "
    "acc accel gyro temp temperature displacement ausgang messwert istwert lage drehzahl angles positions "
    "level height fuellstand pressure druck"
)
SWITCH = words("enable enabled armed disable disabled")  # a column that is 0 while the drive is off, with no words
DIRECTION = words("dir direction richtung")  # of an H-bridge, whose duty has no sign
SIGNALS_OF_LOG = ("voltage_V", "angle_rad")  # input and output of the logs that this program writes
PLAIN_VOLTS = {"voltage", "volt", "volts"}  # of which quantity, another word says: pot_voltage
STRONG = {"input": {"u", "input"}, "output": {"y", "output"}}
MANY = 6  # names in a sentence
TOGETHER = "act together: "  # the options for all of several inputs follow
NONE_LEFT = "is left for the "  # a role, and behind the semicolon what a log needs that has it
_INPUT_UNITS = ("V", "1", SHARE)
_OF_SUPPLIES = ("", "V", "A", "W")
_SAME_ORDER = np.sqrt(10.0)  # within which two ranges are of one order

Columns = Mapping[str, Column]
Roles = dict[str, Column | None]  # the column of the input and of the output


def choose_signals(table: Table, columns: Columns, why: list[str], unclear: list[str]) -> Roles:
    """Input and output among the `columns` that are not the clock; None where it is unclear."""
    if set(SIGNALS_OF_LOG) <= set(columns):
        u, y = (columns[name] for name in SIGNALS_OF_LOG)
        why.append(f"read column {u.name!r} as the input and {y.name!r} as the output: a log of this program")
        return {"input": u, "output": y}
    count, doubts = len(why), len(unclear)
    roles = {role: _choose_column(role, columns, why, unclear) for role in ("input", "output")}
    inputs = _inputs_of_one(columns) if None in roles.values() and len(unclear) == doubts else []
    if inputs:
        del why[count:]
        unclear.append(_which_input(inputs, columns))
        return {"input": None, "output": None}
    if len(table.names) == 2 and len(columns) == 2:
        first, second = columns.values()
        exchanged = roles["input"] is second or roles["output"] is first
        if not unclear and roles["input"] is roles["output"] is None:
            exchanged = _is_exchanged(first, second, unclear)
        if not unclear and (roles["input"] is None or roles["input"] is not roles["output"]):
            u, y = (second, first) if exchanged else (first, second)
            why[count:] = [f"read column {u.name!r} as the input and {y.name!r} as the output"]
            return {"input": u, "output": y}
    if unclear:
        return roles
    for role, partner in (("input", "output"), ("output", "input")):
        if roles[role] is None and roles[partner] is not None:
            roles[role] = _only_other_column(role, roles[partner], columns, why)
    return roles


def choose_other(roles: Roles, columns: Columns, why: list[str]) -> None:
    """Puts the column of the other role beside one that is given, where its name or its unit says so beyond doubt."""
    missing = [role for role in ("input", "output") if roles.get(role) is None]
    rest = {name: c for name, c in columns.items() if not any(c is each for each in roles.values())}
    said, doubts = list[str](), list[str]()
    column = _choose_column(missing[0], rest, said, doubts) if len(missing) == 1 else None
    if column is not None and not doubts and not column.constant:
        roles[missing[0]] = column
        why += said


def _is_exchanged(first: Column, second: Column, unclear: list[str]) -> bool:
    """Whether two columns whose names are no usual ones stand as output, input; what is a toss-up is unclear."""
    inputs, outputs = ([c.header.has(words) for c in (first, second)] for words in (WEAK_INPUT, WEAK_OUTPUT))
    votes = (outputs[0] - inputs[0]) - (outputs[1] - inputs[1])
    # A column without a name of its own is called 1, 2, or M:1, M:2 of a matrix M.
    numbered = all(column.name.rpartition(":")[2].isdigit() for column in (first, second))
    if votes == 0 and numbered and second.held and not first.held:
        unclear.append(
            f"column {second.name!r} stays in most rows, as an input does, and {first.name!r} moves, as an output "
            f"does; name them with --input {second.name} --output {first.name}, or the other way round"
        )
    if votes == 0 and not numbered:
        unclear.append(
            f"the names {first.name!r} and {second.name!r} do not say which is the input; name one with --input and "
            "one with --output"
        )
    return votes > 0


def _candidates(columns: Columns, role: str) -> list[Column]:
    """Columns whose names say the role; without one, columns whose units say it."""
    moving = [column for column in columns.values() if not column.constant] or list(columns.values())
    by_name = [column for column in moving if role_by_name(column) == role]
    strong = [c for c in by_name if c.header.words <= STRONG[role] and c.header.words]
    if len(strong) == 1 and not any(column.header.has(REFERENCE) for column in by_name):
        return strong
    if by_name:
        return by_name
    if role == "input" and (inputs := _inputs_of_one(columns)):
        return inputs
    units = _INPUT_UNITS if role == "input" else ("rad",)
    return [column for column in moving if role_by_name(column) == "" and _is_in(column, units)]


def _is_in(column: Column, units: Sequence[str]) -> bool:
    return bool(column.header.unit) and convert(column.header.unit).unit in units


def _inputs_of_one(columns: Columns) -> list[Column]:
    """Two or more columns that may all be inputs of the only other one that moves; none where others may be its too.

    Such a column says so by its name or its unit, or stays in most rows, as an input does and an answer does not.
    """
    moving = [
        c for c in columns.values() if not c.constant and not c.header.has(SWITCH | NEVER) and not is_direction(c)
    ]
    inputs = [column for column in moving if _may_be_input(column)]
    rest = [c for c in moving if not any(c is each for each in inputs) and not is_counter(c)]
    answers = [c for c in rest if role_by_name(c) != "none"] or rest
    return inputs if len(inputs) > 1 and len(answers) == 1 else []


def _may_be_input(column: Column) -> bool:
    """Whether name, unit or numbers let a column pass for an input, and its name does not say otherwise."""
    role, header = role_by_name(column), column.header
    if role in ("input", "output"):
        return role == "input"
    if header.has(WEAK_INPUT) and not header.has(WEAK_OUTPUT):
        return role == "" or (role == "none" and column.held)
    return role == "" and not header.has(WEAK_OUTPUT) and (column.held or _is_in(column, _INPUT_UNITS))


def is_counter(column: Column) -> bool:
    """Whether the name of a column says that it numbers samples."""
    return bool(column.header.words) and column.header.words <= COUNTERS


def role_by_name(column: Column) -> str:
    """What the words of the name say: input, output, both, none of them, or nothing."""
    header = column.header
    if header.has(NEVER) or header.base.lower() in COUNTERS:
        return "none"
    is_input = header.has(INPUT | REFERENCE)
    is_output = header.has(OUTPUT) and not (header.words & OUTPUT == {"q"} and "Q" in header.base)
    if (is_output and header.has(CONTROLLER)) or (is_input and header.has(SENSOR)):
        return "both"
    if header.has(REFERENCE):
        return "input"
    if is_input and is_output:
        return "output" if header.words & INPUT <= PLAIN_VOLTS else "both"
    if header.has(AUXILIARY) and not header.has(STRONG["input"] | STRONG["output"]):
        return "none"
    return "input" if is_input else "output" if is_output else ""


def _choose_column(role: str, columns: Columns, why: list[str], unclear: list[str]) -> Column | None:
    """The only candidate for a role; None if there is none or several. Adds to the sentences `why` or `unclear`."""
    candidates = _candidates(columns, role)
    ambiguous = [column for column in columns.values() if role_by_name(column) == "both"]
    if ambiguous:
        unclear.append(
            f"the name {ambiguous[0].name!r} fits an input and an output; name the columns with --input and --output"
        )
        return None
    if role == "input" and len(candidates) > 1:
        supplies = [c for c in candidates if _is_supply(c, candidates)]
        if supplies and len(supplies) < len(candidates):
            names = " and ".join(repr(column.name) for column in supplies)
            both = example(candidates, columns)
            why.append(
                f"{names} barely varies, so it is taken for a supply and not for the input"
                f"{f'; if it is an input too: {both}' if both else ''}"
            )
            candidates = [column for column in candidates if column not in supplies]
    if len(candidates) > 1:
        names = ", ".join(repr(column.name) for column in candidates[:MANY])
        alone = f"columns {names} may each be the {role}; name one with --{role}"
        unclear.append(_which_input(candidates, columns) if role == "input" else alone)
        return None
    if not candidates:
        return None
    column = candidates[0]
    evidence = "name" if role_by_name(column) == role else "unit"
    servo_note = ", a reference (the record of a servo)" if role == "input" and column.header.has(REFERENCE) else ""
    why.append(f"column {column.name!r} is the {role}{servo_note}: its {evidence} says so")
    return column


def _which_input(inputs: Sequence[Column], columns: Columns) -> str:
    names, several = ", ".join(repr(column.name) for column in inputs[:MANY]), example(inputs, columns)
    together = f", or of inputs that {TOGETHER}{several}" if several else ""
    return f"columns {names} may each be the input; name one with --input{together}"


def _is_supply(column: Column, candidates: Sequence[Column]) -> bool:
    """Whether a column feeds what another one steers: it varies little beside its mean, has the unit of a voltage, a
    current or a power, or none, and varies less, by an order, than an input in the same unit does.
    """
    unit = convert(column.header.unit).unit if column.header.unit else ""
    if not column.nearly_constant or column.header.has(REFERENCE) or unit not in _OF_SUPPLIES:
        return False
    alike = [c for c in candidates if c is not column and c.header.unit == column.header.unit and not c.nearly_constant]
    return all(_SAME_ORDER * np.ptp(column.finite) < np.ptp(c.finite) for c in alike if unit)


def example(inputs: Sequence[Column], columns: Columns) -> str:
    """The options that name several `inputs` and the output beside them; empty where they need a mapping file.

    The output is the only other column that moves and that no name rules out, or that alone is left.
    """
    names = [column.name for column in inputs]
    rest = [c for c in columns.values() if not any(c is each for each in inputs) and not c.constant]
    rest = [c for c in rest if not c.header.has(SWITCH | NEVER) and not is_counter(c)]
    by_name = [c.name for c in rest if role_by_name(c) == "output"]
    outputs = by_name if len(by_name) == 1 else [c.name for c in rest if role_by_name(c) in ("", "output")]
    outputs = outputs or [c.name for c in rest]
    if len(names) < 2 or len(outputs) != 1 or any("," in name for name in (*names, *outputs)):
        return ""
    return f"--input {shlex.quote(','.join(names))} --output {shlex.quote(outputs[0])}"


def named_together(sentences: Sequence[str]) -> tuple[list[str], str]:
    """Inputs and output in the options of the sentence that says which inputs may act together; none without it."""
    for options in (text.partition(TOGETHER)[2] for text in sentences if TOGETHER in text):
        _, inputs, _, output = shlex.split(options)
        return inputs.split(","), output
    return [], ""


def _only_other_column(role: str, partner: Column | None, columns: Columns, why: list[str]) -> Column | None:
    """The only column beside `partner` that moves, if its name does not speak against the role."""
    moving_columns = [
        c
        for c in columns.values()
        if c is not partner and not c.constant and not c.header.has(SWITCH) and not is_direction(c)
    ]
    if len(moving_columns) != 1:
        return None
    header = moving_columns[0].header
    responses = SPEED | WEAK_OUTPUT if len(columns) == 2 else SPEED  # a temperature beside a heater and no third column
    response = role == "output" and header.has(responses) and not header.has(NEVER)
    if not response and role_by_name(moving_columns[0]) not in ("", role):
        return None
    why.append(f"column {moving_columns[0].name!r} is the {role}: it is the only other one")
    return moving_columns[0]


def is_direction(column: Column) -> bool:
    """Whether a column of two values says by its name which way a drive turns."""
    return column.header.has(DIRECTION) and len(np.unique(column.finite)) == 2


def note_on_direction(column: Column | None, columns: Columns) -> list[str]:
    """What is said of an input that is never negative beside a column that says which way it drives."""
    ways = [c.name for c in columns.values() if c is not column and is_direction(c) and np.min(c.finite) in (0.0, -1.0)]
    if column is None or not ways or column.constant or np.min(column.finite) < 0:
        return []
    return [
        f"column {column.name!r} is never negative, and {ways[0]!r} may say which way it drives: if so, set direction"
        f' = "{brief(ways[0])}" in [[input]] of a mapping, which turns it round where that is 0 or below'
    ]


def note_on_left_out(roles: Roles, columns: Columns) -> list[str]:
    """What is said of columns in the unit of a guessed input, moving as much as it, that have no role."""
    u, y = roles["input"], roles["output"]
    if u is None or y is None or not u.header.unit or u.header.unit == y.header.unit:
        return []
    left = [
        c
        for c in columns.values()
        if c is not u and c.header.unit == u.header.unit and not c.constant and role_by_name(c) in ("", "input")
    ]
    left = [c for c in left if np.ptp(u.finite) <= _SAME_ORDER * np.ptp(c.finite)]
    both = example([u, *left], {c.name: c for c in (u, y, *left)})
    if not both:
        return []
    return [f"{list_names([c.name for c in left])} left out, in the unit of the input; if inputs too: {both}"]


def doubts_of_roles(table: Table, roles: Roles, columns: Columns, signals: Columns) -> list[str]:
    """The sentence about the roles that are left open, none if none is: choices, or that there is nothing to choose.

    `columns` are all that hold numbers; `signals` are those that do not show time. Naming one that never moves leads
    nowhere, so the sentence asks for a column only where enough of them move.
    """
    missing = [role for role in ("input", "output") if roles[role] is None]
    if not missing:
        return []
    for role, column in roles.items():
        if column is not None and column.constant:
            value = f"{column.finite[0]:g}" if len(column.finite) else "empty"
            return [
                f"the {role} {column.name!r} is {value} in all {len(column.values)} samples; choose a column that moves"
            ]
    if sentence := misspelt_number(table, columns):
        return [sentence]
    free = [column for column in signals.values() if not any(column is each for each in roles.values())]
    frozen = [column for column in free if column.constant]
    inventory = f"found {len(table.names)} column{'s' if len(table.names) > 1 else ''} ({list_names(table.names)})"
    frozen_note = f"; {' and '.join(c.name for c in frozen)} never {'changes' if len(frozen) == 1 else 'change'}"
    frozen_note = frozen_note if frozen else ""
    clocks = [name for name in columns if name not in signals]
    clock = f", of which {' and '.join(clocks)} show{'s' if len(clocks) == 1 else ''} time" if clocks else ""
    if len(free) - len(frozen) >= len(missing):
        options = " and one with ".join(f"--{role}" for role in missing)
        shown = clock if len(clocks) > 1 else ""
        inputs = [c for c in _candidates({c.name: c for c in free}, "input") if not c.constant]
        if options_of_all := example(inputs, {c.name: c for c in signals.values()}) if roles["input"] is None else "":
            question = f"which are inputs, which is the output? For example, of inputs that {TOGETHER}"
            return [f"{inventory}{shown}{frozen_note}; {question}{options_of_all}"]
        return [f"{inventory}{shown}{frozen_note}; name one with {options}, or in the mapping file of --map"]
    left_open = " and the ".join(missing)
    omissions = "".join(f"; {note}" for note in table.notes if note.startswith("left out what"))
    if frozen:
        remedy = "choose columns that move, or record again while it moves"
        if len(frozen) == 1 and len(missing) == 1:
            remedy = f"record again while the {missing[0]} moves, or give a log that has it"
        return [f"{inventory}{clock}{frozen_note}, and no column that moves {NONE_LEFT}{left_open}; {remedy}"]
    if words := [name for name in columns_of_words(table) if name not in columns]:
        return [
            f"{inventory}{clock}; hexadecimal words without 0x are in {list_names(words)}: set base = 16 for each in a "
            "mapping (qpal info FILE --write-map MAP.toml writes one)"
        ]
    option = "--input or --output" if len(missing) == 2 else f"--{missing[0]}"
    other = f"; if {clocks[0]} is no time, name it with {option}" if len(clocks) == 1 else ""
    if clocks and len(missing) == 1 and len(signals) == 1:
        other = f", or all files where each holds one signal of a record (qpal identify FILE1 FILE2){other}"
    return [
        f"{inventory}{clock}{omissions}: no column {NONE_LEFT}{left_open}; give a log that has an input and an "
        f"output, recorded together{other}"
    ]
