"""Writes the kinds of fault into `dbc/rrins.dbc`: ``python -m generate.fault_numbers``.

The number of a kind is its place in `FaultKind` or `HardwareFault`, from 1.
"""

from __future__ import annotations

import re
from pathlib import Path

from rrins.host_tools.hardware.fault_kinds import HardwareFault, NumberedKind
from rrins.host_tools.wire.fault_kinds import FaultKind

DBC = Path(__file__).parents[2] / "dbc" / "rrins.dbc"


def _values(kinds: type[NumberedKind]) -> str:
    entries = [f'{int(kind)} "{kind.name}"' for kind in reversed(kinds)]
    return " ".join([*entries, '0 "NONE" ;'])


def _keys() -> str:
    """Return the keys of all parameters, which end in their units, with their kinds."""
    kinds_of: dict[str, list[str]] = {}
    for kind in HardwareFault:
        if kind.parameter is not None:
            kinds_of.setdefault(kind.parameter.key, []).append(kind.name)
    return ", ".join(f"{key} ({', '.join(kinds)})" for key, kinds in kinds_of.items())


def with_kinds(text: str) -> str:
    """Return the DBC with the value tables and the keys of the present kinds."""
    for table, messages, kinds in (
        ("FaultKind", "FAULT_COMMAND|FAULT_ACTIVE", FaultKind),
        ("HardwareFaultKind", "HARDWARE_FAULT_COMMAND|HARDWARE_FAULT_ACTIVE", HardwareFault),
    ):
        numbers = "|".join(re.findall(rf"^BO_ (\d+) (?:{messages}):", text, re.MULTILINE))
        head = rf"^(VAL_TABLE_ {table}|VAL_ (?:{numbers}) kind) .*$"
        text = re.sub(head, rf"\g<1> {_values(kinds)}", text, flags=re.MULTILINE)
    return re.sub(
        r"(its unit is that of the kind's key: ).*?(; unused)", rf"\g<1>{_keys()}\g<2>", text
    )


if __name__ == "__main__":
    DBC.write_bytes(with_kinds(DBC.read_bytes().decode("cp1252")).encode("cp1252"))
