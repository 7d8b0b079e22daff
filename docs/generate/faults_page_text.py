"""The text of the page `docs/faults.md` around its tables."""

from __future__ import annotations

from collections.abc import Sequence

from rrins.host_tools.hardware.fault_kinds import HardwareFault, Parameter
from rrins.host_tools.wire.fault_kinds import FaultKind

AT_S = 23.0
"""Start of every fault in the tables, after power-on: 20 s into navigation."""


def _number(value: float) -> str:
    return f"{value:g}".replace("e+0", "e")


def kinds_table(kinds: Sequence[FaultKind | HardwareFault]) -> str:
    """Return the table of the kinds; those that only differ in their part share a row."""
    rows: dict[tuple[str, str, Parameter | None], list[str]] = {}
    for kind in kinds:
        target = kind.target if isinstance(kind, HardwareFault) else None
        key = "" if target is None else f"`{target.key}`"
        rows.setdefault((kind.effect, key, kind.parameter), []).append(f"`{kind.word}`")
    lines = ["| kind | effect | keys | default | allowed |", "|---|---|---|---|---|"]
    for (effect, target_key, parameter), names in rows.items():
        default = allowed = ""
        keys = [target_key] if target_key else []
        if parameter is not None:
            keys.append(f"`{parameter.key}`")
            unit = "" if parameter.is_whole else f" {parameter.unit}"
            default = (
                "random" if parameter.default is None else f"{_number(parameter.default)}{unit}"
            )
            allowed = f"{_number(parameter.minimum)} to {_number(parameter.maximum)}"
        lines.append(
            f"| {', '.join(names)} | {effect} | {', '.join(keys)} | {default} | {allowed} |"
        )
    return "\n".join(lines)


HEAD = f"""# Faults

`make docs` writes this page by injecting each fault into a direct run and observing the result
(`python -m generate.faults_page`).

## Injecting faults

A scenario injects faults with `[[faults]]` tables ([keys](scenarios.md)):

```toml
[[faults]]
kind = "drop"          # without message or node: all frames
message = "SENSOR_3"
at_s = {AT_S:.0f}             # since power-on
for_s = 5

[[faults]]
kind = "gyro_bias"     # without sensor: all gyros
sensor = 2
bias_dph = 10
at_s = {AT_S:.0f}
```

`rrins inject` injects the same faults into a running rehearsal:

```console
$ rrins inject gyro_bias --sensor 2 --bias-dph 10
gyro_bias (sensor 2, bias_dph 10) since epoch 5181 (25.905 s)
$ rrins inject drop --message SENSOR_3 --for 5
drop (message SENSOR_3) since epoch 6222 (31.110 s), for 5 s
$ rrins inject list
2 faults active at epoch 6907 (34.535 s); 686 frames affected on the wire so far
  gyro_bias (sensor 2, bias_dph 10)  since epoch 5181 (25.905 s)
  drop (message SENSOR_3)            since epoch 6222 (31.110 s), for 5 s
$ rrins inject gyro_bias --sensor 2 --remove
gyro_bias (sensor 2) removed at epoch 7712 (38.560 s)
$ rrins inject clear
1 fault removed at epoch 8101 (40.505 s)
```

The command waits up to 5 s for the hardware to report the fault as active, and ends with status 7
if there is no answer or the fault is impossible. `--json` prints an object; the `faults` of `list`
have the keys of `[[faults]]`. A fault that begins live at epoch n gives bit-identical navigation to
the same fault in the scenario with `at_s` = n / `rate_hz`.

- Injecting the same fault again (same kind and target) replaces the active one.
- `--remove` and `clear` also remove faults of the scenario, even those that have not begun yet.
- A live fault lasts at most 65 s, or until it is removed.
- At most 32 faults of the hardware and 127 on the wire can be active.
- The scenario's seed determines which frames a fault with a probability affects, identically in
  every way of running. Live, this also depends on the epoch in which the fault is injected.

The commands are messages of the [contract](bus-contract.md#fault_command): FAULT_COMMAND for the
wire and HARDWARE_FAULT_COMMAND for the hardware. Any CAN tool can therefore send them. The hardware
answers each command with a report of the active faults: two messages for each fault, a third if it
is intermittent, then FAULT_STATUS or HARDWARE_FAULT_STATUS. It also sends a report every second
while any fault is active. Commands and reports bypass the modelled wire, so a bus that is cut can
be restored. A real turntable ignores them.

## On the wire

{kinds_table(tuple(FaultKind))}

If the wire's timing is modelled (`[bus] bitrate`), `corrupt_wire` causes an error frame and a
retransmission; on the ideal wire it has no effect. `message` and `node` select the affected frames,
by default all. `probability` is the share of these frames that is affected.

`power_off` is a power cycle of the navigation computer, or a brown-out: for `for_s` it is gone, and
then it begins anew ([what it does](firmware.md#power)). In a rehearsal the firmware, ours or [your
own](own-firmware.md), is killed by SIGKILL and started again. Where a scenario has this fault, our
firmware is followed by its frames alone, as yours is, because its own log would end: the summary
lacks what only it reports, such as `navigation_sha256`. `rrins inject` cuts it in benches and
of a program of your own; of our firmware in a rehearsal only where the scenario cuts it, too. With
`rrins hardware` alone nobody switches the firmware: only its frames are lost.

## Of the hardware

{kinds_table(sorted(HardwareFault, key=lambda kind: kind.part))}

Faults of the odometer and of GNSS need an `[odometer]` or a `[gnss]` in the scenario. `direction`
is `"east"` (the default), `"north"` or `"up"`; faults in several directions add up. `sensor` counts
from 1; without it, all sensors of the kind fail. With `period_s`, a fault of the hardware is
intermittent: present in the first part of each period, whose share is `duty` (0.5).
With `rrins inject` each key is an option, such as `--rate-dps`; `delay_s` is `--delay`, `period_s`
is `--period`, and `for_s` is `--for`. A delay is rounded to whole epochs, at least one; `rrins
inject` reports this if it makes a difference.

## Frames of somebody else

Whatever else is attached to the embedded bus of a rehearsal cannot send for the two sides: such
frames are [refused, named and counted](bus.md#what-others-may-do-beside-the-two-sides), and a flood
waits. `--foreign-senders` lets the frames through. Then, and on any other interface, the firmware
[tells two senders of one message apart](firmware.md#two-senders-of-one-message):

| on the bus | the firmware uses | trouble code |
|---|---|---|
| a second SENSOR_1, of the epoch, with other contents | neither | `sensor_1_two_senders` |
| a second SENSOR_1 with counters of its own | that of the epoch | `sensor_1_two_senders` |
| a second SENSOR_1, the same | the first | `sensor_1_counter` |
| SYNC of another epoch beside the right one | the right one | `sync_two_senders` |

## Response of the firmware to faults on the wire

Conditions: ideal sensors, 60 s of navigation with rotation, the fault from 20 s on, and the wire
modelled at 1 Mbit/s or ideal, as shown. *Detected after* counts epochs (of 5 ms) from the first one
with the fault to the first in which a counter changed on either side, the mode changed, or the test
of a [trouble code](diagnostic-table.md#trouble-codes) failed. *Trouble codes* are those confirmed.
*Position error* is the horizontal distance from the same run without the fault, at the end of the
run or of navigation. No wrong value is ever used: lost data are left out of the fusion, or bridged
for at most 0.1 s with the previous increments. The exception is a repeated frame: its counter,
which has 15 values, is correct again every 15 epochs.

| injected | wire | detected after | counters | trouble codes \
| longest bridge | final mode | position error |
|---|---|---|---|---|---|---|---|"""

BETWEEN = """
## Response of the firmware to faults of the hardware

Conditions as above, on the ideal wire; *attitude error* is the largest difference of an attitude
angle. The frames are valid, so their contents are used unless the sensor is flagged as absent: a
bias, noise or a stuck value enters the navigation. A stuck sensor is detected once the value that
it should measure has changed; here the table turns evenly about the vertical, and the vehicle is at
rest.

| injected | detected after | counters | trouble codes | final mode \
| position error | attitude error |
|---|---|---|---|---|---|---|"""
