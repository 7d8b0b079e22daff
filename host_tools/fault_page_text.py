"""The words of the page `docs/faults.md`, around its tables."""

from __future__ import annotations

AT_S = 23.0
"""When every fault of the tables begins, after power-on: 20 s into navigation."""

HEAD = f"""# Faults

`make docs` writes this page by putting each fault into a direct run and watching it
(`python -m host_tools.fault_table`).

## Putting them in

A scenario puts faults in by tables `[[faults]]` ([keys](scenarios.md)):

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

`rrins inject` puts the same ones into a rehearsal under way:

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
gyro_bias (sensor 2) taken out at epoch 7712 (38.560 s)
$ rrins inject clear
1 fault taken out at epoch 8101 (40.505 s)
```

It waits until the hardware has said that the fault is active, 5 s at most, and ends with status 7
if nobody answers or the fault cannot be. `--json` prints an object; the `faults` of `list` have the
keys of `[[faults]]`. A fault that began live at epoch n and the same one in the scenario with
`at_s` = n / `rate_hz` give the same navigation, bit for bit.

- The same fault again (kind, and what it is put on) takes the place of the one that is active.
- `--remove` and `clear` take out those of the scenario, too, also those that are still to come.
- A live fault lasts 65 s at most, or until it is taken out.
- There is room for 32 faults of the hardware and 127 on the wire.
- Which frames a fault with a probability hits follows from the scenario's seed: the same in every
  way to run it. Live it also depends on the epoch in which it is put in.

The commands are messages of the [contract](bus-contract.md#fault_command), FAULT_COMMAND for the
wire and HARDWARE_FAULT_COMMAND, so any CAN tool can send them; each is answered by a report of what
is active: FAULT_STATUS and HARDWARE_FAULT_STATUS, after two messages for each fault. Reports come
every second while there are faults, too. Neither commands nor reports pass the wire themselves: a
bus that is cut can be mended. A real turntable ignores them.

## On the wire

| kind | what it does | keys |
|---|---|---|
| `drop`, `silence` | frames are lost | |
| `delay` | frames come later | `delay_s` |
| `duplicate` | frames come twice | |
| `reorder` | an epoch's frames come in another order | |
| `corrupt_wire` | a bit error that the controllers' CRC-15 catches | |
| `corrupt` | one that gets past it, for the end-to-end CRC to catch | `bit` |
| `wrong_counter` | a counter that is one ahead, under a right CRC | |
| `stale` | the frame that was sent when the fault began, again and again | |
| `babble` | a node sends the most urgent identifier all the time | `frames_per_epoch` |
| `bus_off` | a node's controller is off the bus | |
| `cut` | nobody hears anybody | |

With the wire's timing modelled (`[bus] bitrate`) `corrupt_wire` costs an error frame and a
repetition, on the ideal wire nothing. `message` and `node` say whose frames; without them it is
all. `probability` is the share of the frames that are hit.

## Of the hardware

| kind | what it does | keys |
|---|---|---|
| `axis_stall` | an axis stands | `axis` |
| `axis_runaway` | it turns, whatever it is told | `axis`, `rate_dps` |
| `encoder_stuck` | its encoder repeats the last angle | `axis` |
| `encoder_offset` | its encoder reads more than the angle | `axis`, `offset_deg` |
| `gyro_stuck`, `accelerometer_stuck` | the last increment again and again | `sensor` |
| `gyro_bias` | a bias on top | `sensor`, `bias_dph` |
| `accelerometer_bias` | | `sensor`, `bias_ug` |
| `gyro_noise` | white noise on top | `sensor`, `angle_random_walk_deg_per_sqrt_h` |
| `accelerometer_noise` | | `sensor`, `white_noise_ug_per_sqrt_hz` |
| `gyro_absent`, `accelerometer_absent` | it says that it is not there | `sensor` |

`sensor` counts from 1; without it, all of the kind fail. With `rrins inject` each key is an option,
such as `--rate-dps`; `delay_s` is `--delay`, and `for_s` is `--for`. A delay becomes whole epochs,
one at least; `rrins inject` says so where that makes a difference.

## What the firmware makes of faults on the wire

Ideal sensors, 60 s of navigation with rotation, the fault from 20 s on; wire modelled at 1 Mbit/s
where it says so, else ideal. *Found after* counts epochs (of 5 ms) from the first one with the
fault to the first in which a counter moved, at either end, the mode changed, or the test of a
[trouble code](diagnostic-table.md#trouble-codes) failed. *Trouble codes* are those confirmed. *Off
by* is the horizontal distance, at the end of the run or of navigation, from where the same run
without the fault is. No wrong value is ever used: what is lost is left out of the fusion, or
bridged for 0.1 s at most by the increments before. The exception is a frame that is repeated: its
counter of 15 steps is right again every 15 epochs.

| injected | wire | found after | counted | trouble codes | longest bridge | ends in | off by |
|---|---|---|---|---|---|---|---|"""

BETWEEN = """
## What the firmware makes of faults of the hardware

As above, on the ideal wire; *turned by* is the largest difference of an angle of the attitude. The
frames are sound, so what is in them is used unless the sensor says that it is absent: a bias, a
noise or a stuck value goes into the navigation. A stuck sensor is found once what it should measure
has changed: here the table turns evenly about the vertical, and the vehicle stands.

| injected | found after | counted | trouble codes | ends in | off by | turned by |
|---|---|---|---|---|---|---|"""
