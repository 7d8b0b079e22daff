"""The definition of a data identifier."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from rrins.firmware_py.diagnostics.access import ANYWHERE, Access
from rrins.firmware_py.diagnostics.codecs import Field as _Field
from rrins.firmware_py.diagnostics.codecs import Layout, Values


@dataclass(frozen=True)
class DataIdentifier:
    """A data identifier (DID)."""

    number: int
    name: str
    text: str
    fields: tuple[_Field, ...]
    read: Access = ANYWHERE
    write: Access | None = None  #: None when it cannot be written
    #: None without input-output control; the control state has the same fields
    control: Access | None = None

    @cached_property
    def layout(self) -> Layout:
        """Encodes and decodes the values."""
        return Layout(self.fields)

    def encode(self, values: Values) -> bytes:
        """Return the data record of values by field."""
        return self.layout.encode(values)

    def decode(self, data: bytes) -> Values:
        """Return the values in a data record, by field."""
        return self.layout.decode(data)
