"""Writes `docs/bus-contract.md` from the DBC: ``python -m generate.contract_page``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from cantools.database import Message, Signal

from rrins.dbc.codec import Codec, load
from rrins.host_tools.conformance.requirements import (
    OTHERS,
    RECEIVED,
    RECEIVED_TEXTS,
    SENT,
    SENT_TEXTS,
    matrix,
)
from rrins.host_tools.conformance.suite import LONG

_HEAD = """# The bus contract

`make docs` writes this page from [`dbc/rrins.dbc`](../dbc/rrins.dbc); the DBC is authoritative.

All frames are classic CAN frames with 11-bit identifiers; a lower identifier has higher priority.
All payloads have eight bytes; the byte order is little-endian (Intel). Cycle times are given for
200 Hz; messages sent every epoch follow the sampling rate of the scenario.

**Protection.** Every message except the diagnostic ones follows AUTOSAR E2E profile 1, variant 1A:
byte 0 is a CRC-8 (polynomial 0x1D, start value and final XOR 0x00) over the low and the high byte
of the message's data ID and bytes 1 to 7; the low nibble of byte 1 is a counter from 0 to 14. The
DBC's attribute `E2ECounter` says what it counts: `Epoch` is the epoch modulo 15, which ties a frame
to its epoch, sent in each or not; `Transmissions` are those of the message. A frame with a wrong
CRC or counter only increments a fault counter.

**When.** The DBC's attribute `GenMsgSendType` is `Cyclic`, `IfActive` for what is sent in cycles
while the navigation, or the estimator, runs, or `Event`.

**Increments.** The sensors' frames hold increments along the sensors' input axes. [Fusing the
sensors yourself](conventions.md#fusing-the-sensors-yourself) says how they become vectors.

**Diagnostics.** The messages `DIAG_…` carry ISO-TP (ISO 15765-2), which has its own control bytes
and sequence numbers, so no E2E profile; see [diagnostics](diagnostics.md). They have no cycle time.
"""


def _sections(codec: Codec) -> Iterator[str]:
    yield _HEAD
    yield "| identifier | message | from | to | cycle | |"
    yield "|---|---|---|---|---|---|"
    messages = sorted(codec.database.messages, key=lambda message: message.frame_id)
    for message in messages:
        anchor = "sensor_1" if message.name.startswith("SENSOR_") else message.name.lower()
        yield (
            f"| 0x{message.frame_id:03X} | [{message.name}](#{anchor}) "
            f"| {', '.join(message.senders)} | {', '.join(sorted(message.receivers))} "
            f"| {f'{message.cycle_time} ms' if message.cycle_time else ''} | {message.comment} |"
        )
    for message in messages:
        if message.name.startswith("SENSOR_") and message.name != "SENSOR_1":
            continue  # the same signals
        yield from _message(codec, message)


def _message(codec: Codec, message: Message) -> Iterator[str]:
    row = codec.messages[codec.message_index(message.name)]
    yield f"\n## {message.name}\n"
    data_id = int(row["data_id"])
    protection = f"E2E data ID 0x{data_id:04X}" if data_id else "no end-to-end protection"
    counts = ", counts epochs" if codec.counts_epochs(message.name) else ""
    yield f"Identifier 0x{message.frame_id:03X}, {protection}{counts}."
    if message.name == "SENSOR_1":
        yield "SENSOR_2 to SENSOR_16 have the same signals; a RIMU sends one per sensor group."
    yield ""
    yield "| signal | bits | unit | scale | range | |"
    yield "|---|---|---|---|---|---|"
    for signal in message.signals:
        yield _signal(signal)


def _signal(signal: Signal) -> str:
    last = signal.start + signal.length - 1
    sign = " signed" if signal.is_signed else ""
    comment = signal.comment or ""
    if signal.choices:
        names = ", ".join(f"{raw} {name}" for raw, name in sorted(signal.choices.items()))
        comment += f" {names}."
    return (
        f"| `{signal.name}` | {signal.start}-{last}{sign} | {signal.unit or ''} "
        f"| {signal.scale!r} | {signal.minimum:.10g} … {signal.maximum:.10g} | {comment} |"
    )


_REQUIREMENTS = """
## Requirements

The demands on a navigation computer, by number, and the [checks](own-firmware.md#conformance) of
`rrins conform` that try them. `rrins conform --matrix --json` has all of them one by one. A message
has a number for each demand: `RX-041-3` is the third of the message 0x041, which the computer
receives, `TX-120-1` the first of 0x120, which it sends. A message that is not fitted has none to
meet.
"""


def _named(checks: Iterable[str]) -> str:
    """Return the names of checks; those of the same kind as one."""
    names = ("navigation-…" if name.startswith("navigation-") else name for name in checks)
    return ", ".join(dict.fromkeys(names))


def _requirements() -> Iterator[str]:
    yield _REQUIREMENTS
    yield "| number | requirement | checks |"
    yield "|---|---|---|"
    rows = {row["requirement"]: row for row in matrix(LONG)}
    for number, text, where in OTHERS:
        yield f"| {number} | [{text}]({where}) | {_named(rows[number]['checks'])} |"
    codec = load()
    for letters, names, texts in (("RX", RECEIVED, RECEIVED_TEXTS), ("TX", SENT, SENT_TEXTS)):
        for k, text in enumerate(texts, 1):
            checks = [
                check
                for name in names
                for check in rows[f"{letters}-{codec.frame_id(name):03X}-{k}"]["checks"]
            ]
            numbers = f"{letters}-…-{k}"
            yield f"| {numbers} | {text} | {_named(checks)} |"
    for letters, names in (("RX", RECEIVED), ("TX", SENT)):
        listed = ", ".join(f"{name} 0x{codec.frame_id(name):03X}" for name in names)
        yield f"\n{letters}: {listed}."


def page() -> str:
    """Return the page as Markdown."""
    return "\n".join((*_sections(load()), *_requirements())) + "\n"


if __name__ == "__main__":
    print(page(), end="")
