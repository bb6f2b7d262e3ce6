"""The record of a fit: what it was fitted to is at hand while it lives, and is not written with it."""

from typing import Self

from sysid.base.errors import InputError
from sysid.data.record import IOData


class Remembered:
    """A result that may know the record that it comes from."""

    @property
    def record(self) -> IOData | None:
        """The record of the fit; None for one that was read from a file."""
        return self.__dict__.get("_record")

    def remember(self, data: IOData) -> Self:
        """The same result, which knows its record from now on; raises InputError for anything but a record."""
        if not isinstance(data, IOData):
            raise InputError(f"data is a {type(data).__name__}; give the record of the fit, an IOData")
        self.__dict__["_record"] = data
        return self

    def record_or(self, data: IOData | None) -> IOData:
        """`data`, or the record of the fit where that is None; raises InputError if there is none."""
        found = self.record if data is None else data
        if found is None:
            raise InputError(
                "this fit was read from a file and has no record; give one as data=, for example fit.plot(data) or "
                "fit.report(path, data=data)"
            )
        return found
