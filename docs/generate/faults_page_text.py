"""The text of the page `docs/faults.md` around its tables."""

from __future__ import annotations

AT_S = 23.0
"""Start of every fault in the tables, after power-on: 20 s into navigation."""

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

| kind | effect | keys |
|---|---|---|
| `drop`, `silence` | frames are lost | |
| `delay` | frames arrive late | `delay_s` |
| `duplicate` | frames arrive twice; each further `duplicate` adds one copy | |
| `reorder` | an epoch's frames arrive in a different order | |
| `corrupt_wire` | a bit error that the controllers' CRC-15 detects | |
| `corrupt` | a bit error that only the end-to-end CRC detects | `bit` |
| `wrong_counter` | a counter that is one too high, with a correct CRC | |
| `stale` | the frame that was sent when the fault began is repeated | |
| `babble` | a node keeps sending the identifier of the highest priority | `frames_per_epoch` |
| `bus_off` | a node's controller is bus-off | |
| `cut` | no node receives any frame | |

If the wire's timing is modelled (`[bus] bitrate`), `corrupt_wire` causes an error frame and a
retransmission; on the ideal wire it has no effect. `message` and `node` select the affected frames,
by default all. `probability` is the share of these frames that is affected.

## Of the hardware

| kind | effect | keys |
|---|---|---|
| `axis_stall` | an axis stops | `axis` |
| `axis_runaway` | an axis turns, whatever the command | `axis`, `rate_dps` |
| `encoder_stuck` | the encoder repeats the last angle | `axis` |
| `encoder_offset` | the encoder reads too high | `axis`, `offset_deg` |
| `encoder_slip` | the encoder misses a share of each turn | `axis`, `slip_percent` |
| `gyro_stuck`, `accelerometer_stuck` | the sensor repeats the last increment | `sensor` |
| `gyro_bias` | additional bias | `sensor`, `bias_dph` |
| `accelerometer_bias` | additional bias | `sensor`, `bias_ug` |
| `gyro_noise` | additional white noise | `sensor`, `angle_random_walk_deg_per_sqrt_h` |
| `accelerometer_noise` | additional white noise | `sensor`, `white_noise_ug_per_sqrt_hz` |
| `gyro_ramp` | a bias that grows from zero | `sensor`, `bias_dph_per_min` |
| `accelerometer_ramp` | a bias that grows from zero | `sensor`, `bias_ug_per_min` |
| `gyro_scale`, `accelerometer_scale` | error of the scale factor | `sensor`, `scale_ppm` |
| `…_shift_u`, `…_shift_v` of either | the mount turns, by δu or δv | `sensor`, `shift_arcsec` |
| `gyro_dead`, `accelerometer_dead` | the sensor reads zero | `sensor` |
| `gyro_full_scale`, `accelerometer_full_scale` | the end of the range, flagged | `sensor` |
| `gyro_absent`, `accelerometer_absent` | the sensor is flagged as absent | `sensor` |
| `odometer_slip` | the wheel turns more than the vehicle moves | `slip_percent` |
| `odometer_lock` | the wheel stands, whatever the vehicle does | |
| `odometer_lost` | the odometer does not count, and says so | |
| `gnss_jump` | positions are off | `direction`, `jump_m` |
| `gnss_pull` | positions are led away, and velocities with them | `direction`, `pull_mps` |
| `gnss_lost` | the receiver has no fix | |

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
