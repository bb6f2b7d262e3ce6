"""The line to a bus of servos, spoken by the makers' libraries: who is on it, registers in and out."""

import importlib
import math
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

from sysid.base.errors import InputError
from twin.rig.bus.registers import FAMILIES, Family, Model, Register
from twin.rig.closing import Closing
from twin.rig.link import Lost, open_port

_GONE: tuple[type[Exception], ...] = (OSError, TypeError, IndexError)
with suppress(ImportError):  # not of every system: a port that is gone says so when its input is cleared
    import termios

    _GONE = (*_GONE, termios.error)
ANSWER = 0.02  # [s] that an answer may take beside its bytes: USB adapters keep bytes for up to 16 ms
TRIES = 3  # of what may be said again
BITS = 10  # of a byte on the line


class Clock(Protocol):
    """The time of a run [s]: the machine's, or that of an emulated bus."""

    def now(self) -> float:
        """Since any moment."""

    def wait_until(self, moment: float) -> None:
        """Return at `moment`, at once if it is over."""


class _MachineClock:
    now = staticmethod(time.perf_counter)

    def wait_until(self, moment: float) -> None:
        """Sleeps, and looks at the clock without a pause for the last millisecond."""
        while (left := moment - time.perf_counter()) > 0.0:
            if left > 1.5e-3:
                time.sleep(left - 1e-3)


class Silent(InputError):  # noqa: N818 - reads as what it says
    """No answer came."""


class Garbled(InputError):  # noqa: N818
    """An answer came and its check sum is wrong."""


class Refused(InputError):  # noqa: N818
    """The servo does not take what was written."""


@dataclass(frozen=True)
class State:
    """What a servo says of itself: goal and position [ticks], and as far as it measures them load (share of full
    duty), current [A], voltage [V] and temperature [C], nan if it does not. `error` has the bits of "error". The
    question left at `asked` and the answer was there at `answered` [s]."""

    goal: int
    position: int
    load: float
    current: float
    voltage: float
    temperature: float
    error: int
    asked: float
    answered: float


class Bus(Closing):
    """The servos of a family on `port`, which is held alone; a context manager.

    `line` is an open port in its place, of an emulated bus with its own `clock`. Raises InputError where the family's
    library is missing and where the port does not open, and Lost once it is gone.
    """

    def __init__(
        self, family: Family, port: str, baud: int, line: Any = None, clock: Clock | None = None, answer: float = ANSWER
    ) -> None:
        self.family, self.port, self.baud, self.answer = family, port, baud, answer
        self.clock: Clock = _MachineClock() if clock is None else clock
        self._sdk = library(family)
        self._line = open_port(port, baud) if line is None else line
        self._handler = _port_handler(self._sdk, self)
        self._first: tuple[Any, ...] = ()
        if family.name == "feetech":
            self._packets = self._sdk.sms_sts(self._handler)
        else:
            self._packets, self._first = self._sdk.Protocol2PacketHandler(), (self._handler,)

    def close(self) -> None:
        """The port is free for others."""
        with suppress(OSError):
            self._line.close()

    def model(self, number: int, tries: int = TRIES) -> int:
        """The model number of the servo `number`. Raises Silent or Garbled."""
        result: Exception = Silent("")
        for _ in range(tries):
            try:
                found = self._call("ping", number)
                return int(found[0])
            except Garbled as garbled:
                result = garbled
            except Silent as silent:
                result = result if isinstance(result, Garbled) else silent
        raise result

    def scan(self) -> dict[int, int | None]:
        """The servos on the bus: number to model, None where two answer at once."""
        found: dict[int, int | None] = {}
        if self.family.name == "dynamixel":
            answers, result = self._run(lambda: self._packets.broadcastPing(self._handler))
            found = {int(number): int(each[0]) for number, each in answers.items()}
            if result in (self._sdk.COMM_SUCCESS, self._sdk.COMM_RX_TIMEOUT):
                return dict(sorted(found.items()))
        for number in range(self.family.most_id + 1):
            if number in found:
                continue
            try:
                found[number] = self.model(number, 1)
            except Garbled:
                try:
                    found[number] = self.model(number)
                except Garbled:
                    found[number] = None
            except Silent:
                pass
        return dict(sorted(found.items()))

    def read(self, number: int, register: Register, tries: int = TRIES) -> float:
        """The value of a register in its unit."""
        return register.value(self.bytes_of(number, register.address, register.size, tries))

    def bytes_of(self, number: int, address: int, size: int, tries: int = TRIES) -> bytes:
        """Bytes of the table from `address` on."""
        data, *_ = self._again(tries, "readTxRx", number, address, size)
        if len(data) < size:
            raise Garbled(f"{self.port}: servo {number} answers with {len(data)} of {size} bytes")
        return bytes(data)

    def write(self, number: int, register: Register, value: int, tries: int = TRIES) -> None:
        """Write a register, in its own counts. Raises Refused where the servo does not take it."""
        *_, error = self._again(tries, "writeTxRx", number, register.address, register.size, [*register.data(value)])
        refusal = int(error) & 0x7F if self.family.name == "dynamixel" else 0
        if refusal:
            raise Refused(
                f"{self.port}: servo {number} refuses {value} for register {register.address}: "
                f"{self._packets.getRxPacketError(refusal).removeprefix('[RxPacketError] ') or refusal}"
            )

    def state(self, number: int, model: Model) -> State:
        """What the servo says of itself, by one question."""
        start, size = self.family.state
        asked = self.clock.now()
        data, _, error = self._call("readTxRx", number, start, size)
        answered = self.clock.now()
        if len(data) < size:
            raise Garbled(f"{self.port}: servo {number} answers with {len(data)} of {size} bytes")

        def value(name: str) -> float:
            register = self.family.register(name, model)
            if register is None:
                return math.nan
            place = register.address - start
            return register.value(bytes(data[place : place + register.size]))

        load = value("load")
        load = value("duty") if math.isnan(load) else load
        if self.family.name == "feetech":
            bits = int(value("error")) | int(error)
        else:
            bits = int(self.read(number, self.family.registers["error"])) if int(error) & 0x80 else 0
        return State(
            int(value("goal")),
            int(value("position")),
            load,
            value("current"),
            value("voltage"),
            value("temperature"),
            bits,
            asked,
            answered,
        )

    def _again(self, tries: int, name: str, *values: Any) -> tuple[Any, ...]:
        """The result of a call that may be said again."""
        for left in reversed(range(tries)):
            try:
                return self._call(name, *values)
            except (Silent, Garbled):
                if not left:
                    raise
        raise AssertionError

    def _call(self, name: str, number: int, *values: Any) -> tuple[Any, ...]:
        """The result of a call of the library, without its code."""
        given = self._run(lambda: getattr(self._packets, name)(*self._first, number, *values))
        *before, result, error = given
        if result == self._sdk.COMM_SUCCESS:
            return (*before, result, error)
        if result == self._sdk.COMM_RX_CORRUPT:
            raise Garbled(
                f"{self.port}: servo {number} answers, but garbled; perhaps two servos have this number, or the bus "
                "has another rate: connect one servo alone and give it a number of its own"
            )
        raise Silent(
            f"{self.port}: servo {number} does not answer; check its number, its supply and the bus's rate: qpal rig "
            f"find --bus {self.family.name} --port {self.port} lists who does"
        )

    def _run(self, call: Any) -> Any:
        self._handler.is_using = False  # Ctrl-C within a call leaves it set
        try:
            return call()
        except _GONE as error:
            # The libraries index into answers that are too short for what they say of themselves.
            if isinstance(error, IndexError):
                raise Garbled(f"{self.port}: an answer came that makes no sense") from None
            text = getattr(error, "strerror", None) or error.args[-1]
            raise Lost(f"{self.port}: the connection is lost ({text})") from None

    def seconds(self, size: int) -> float:
        """The time [s] of `size` bytes on the line."""
        return size * BITS / self.baud


def library(family: Family) -> Any:
    """The maker's library. Raises InputError, which names the extra, where it is missing or another one."""
    extra = f"pip install 'qpal[{family.name}]'"
    try:
        found = importlib.import_module(family.library)
    except ImportError:
        raise InputError(f"{family.words} servos need {family.package}, which is not installed: {extra}") from None
    if family.name == "feetech" and not hasattr(found, "sms_sts"):
        raise InputError(
            f"the installed {family.library} is that of another package, of which {family.package} has the same name; "
            f"remove it (pip uninstall feetech-servo-sdk), then {extra}"
        )
    return found


def family_of(name: str) -> Family:
    """A family by name."""
    from sysid.base.errors import unknown

    if name not in FAMILIES:
        raise unknown("bus", name, tuple(FAMILIES))
    return FAMILIES[name]


def _port_handler(sdk: Any, bus: Bus) -> Any:
    """The library's own port, on a line that is open already and with the bus's clock and patience.

    Its own opens a port without holding it alone, reads in a loop without a pause, and waits 34 to 50 ms for what does
    not come.
    """

    class Port(sdk.PortHandler):
        def __init__(self) -> None:
            super().__init__(bus.port)
            self.ser, self.is_open, self.baudrate = bus._line, True, bus.baud
            self.tx_time_per_byte = 1e3 * bus.seconds(1)

        def setPacketTimeout(self, packet_length: int) -> None:
            self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 1e3 * bus.answer)

        def getCurrentTime(self) -> float:
            return 1e3 * bus.clock.now()

    return Port()
