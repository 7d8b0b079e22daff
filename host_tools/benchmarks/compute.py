"""Measurements within one process: the steps, the codec, and python-can's own buses."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable

import can
import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Records
from rrins.dbc.codec import SignalLayout, decode, encode, load
from rrins.dbc.e2e import MessageLayout, crc_holds
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.benchmarks.timed_epochs import timed_epochs, timer_overhead_ns
from rrins.host_tools.bus.port import message_of_frame
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

_SENSOR = "SENSOR_1"
_UP = 7  # frames of an epoch of four sensor groups: SYNC, the groups, two axes
_REPETITIONS = 5
_MULTICAST_GROUP, _MULTICAST_PORT = "239.74.163.61", 43_161
_LOSS_WAIT_S = 0.05
_SILENCE_S = 0.2

Figures = dict[str, float]


def steps(scenario: Scenario, samples: int) -> tuple[JsonObject, FrameArray]:
    """Measure both steps over `samples` epochs, while navigating with the table turning.

    Each step is called from Python, as its shell does; the two feed each other.

    Returns
    -------
    dict
        `median` and `p99` µs of a call of each side, without the timer's overhead.
    array of dtype `rrins.dbc.frame.Frame`
        The frames of sensor group 1 in the same epochs.
    """
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario))
    sensor_id = load().frame_id(_SENSOR)
    rates = hardware.plant["axis"]["rate"]
    frames = frame_array(samples)
    took_ns = np.zeros((2, samples), dtype=np.int64)
    taken = 0
    for timed in timed_epochs(firmware, hardware, scenario.epochs, time.perf_counter_ns):
        if firmware.mode == Mode.NAVIGATION_ROTATING and rates.any():
            sent = hardware.outbox[: timed.up]
            frames[taken] = sent[sent["can_id"] == sensor_id][0]
            took_ns[:, taken] = timed.firmware_ns, timed.hardware_ns
            taken += 1
            if taken == samples:
                break
    assert taken == samples, "the scenario does not turn for so many epochs"
    spread_us = np.percentile(took_ns - timer_overhead_ns(), (50, 99), axis=1).T / 1000
    ours, theirs = ({"median": float(a), "p99": float(b)} for a, b in spread_us)
    return {"firmware_step_us": ours, "hardware_step_us": theirs}, frames


@compiled
def _decode_frames(frames: FrameArray, signals: Records[SignalLayout], values: Floats) -> None:
    for k in range(len(frames)):
        for s in range(len(signals)):
            values[k, s] = decode(frames[k].data, signals[s])


@compiled
def _encode_frames(values: Floats, signals: Records[SignalLayout], frames: FrameArray) -> None:
    for k in range(len(frames)):
        word = np.uint64(0)
        for s in range(len(signals)):
            word = encode(word, signals[s], values[k, s])
        frames[k].data = word


@compiled
def _sound_frames(frames: FrameArray, messages: Records[MessageLayout]) -> int:
    sound = 0
    for k in range(len(frames)):
        sound += crc_holds(frames[k], messages[0])
    return sound


def _us_per_frame(work: Callable[[], object], frames: int) -> float:
    """Return the median time of `work` over several repetitions after one warm-up."""
    work()
    took_ns = []
    for _ in range(_REPETITIONS):
        start_ns = time.perf_counter_ns()
        work()
        took_ns.append(time.perf_counter_ns() - start_ns)
    return statistics.median(took_ns) / 1000 / frames


def codec(frames: FrameArray) -> JsonObject:
    """Return the compiled codec's µs per frame: decoding, encoding, and the CRC check."""
    contract = load()
    names = [s.name for s in contract.database.get_message_by_name(_SENSOR).signals]
    signals = contract.signals[[contract.signal_index(_SENSOR, name) for name in names]]
    index = contract.message_index(_SENSOR)
    messages = contract.messages[index : index + 1]
    values = np.zeros((len(frames), len(signals)))
    copy = frames.copy()
    figures = {
        "decode": _us_per_frame(lambda: _decode_frames(frames, signals, values), len(frames)),
        "encode": _us_per_frame(lambda: _encode_frames(values, signals, copy), len(frames)),
    }
    crc = _us_per_frame(lambda: _sound_frames(frames, messages), len(frames))
    assert np.array_equal(copy, frames), "decoded values do not encode to the same frames"
    assert _sound_frames(frames, messages) == len(frames), "a frame has a wrong CRC"
    return {"codec_us_per_frame": figures, "crc_us_per_frame": crc}


def cantools(frames: FrameArray) -> Figures:
    """Return cantools' µs per frame for `decode` and `encode`, with default options."""
    message = load().database.get_message_by_name(_SENSOR)
    payloads = [int(word).to_bytes(8, "little") for word in frames["data"]]
    values = [message.decode(payload) for payload in payloads]
    return {
        "decode": _us_per_frame(lambda: [message.decode(p) for p in payloads], len(payloads)),
        "encode": _us_per_frame(lambda: [message.encode(v) for v in values], len(values)),
    }


def python_can(interface: str, frames: FrameArray) -> tuple[Figures | None, str | None]:
    """Measure a python-can bus between two bus objects in this process.

    Returns
    -------
    dict or None
        `us_per_frame`, to send and receive a frame if an epoch's frames are sent and then
        received; `lost_share` of frames if one thread sends without pause while another receives.
    str or None
        Why the bus is unavailable here.
    """
    try:
        with _open(interface) as sender, _open(interface) as receiver:
            messages = [message_of_frame(frame) for frame in frames]
            if not _arrives(sender, receiver, messages[0]):
                return None, "no frame arrives"
            took_us = _us_per_frame(lambda: _exchange(sender, receiver, messages), len(messages))
            lost_share = _lost_share(sender, receiver, messages)
            return {"us_per_frame": took_us, "lost_share": lost_share}, None
    except (can.CanError, OSError, ImportError) as error:
        return None, " ".join(str(error).split())


def _open(interface: str) -> can.BusABC:
    if interface == "udp_multicast":  # stays on this machine
        return can.Bus(_MULTICAST_GROUP, interface, port=_MULTICAST_PORT, hop_limit=0)
    return can.Bus("bench", interface)


def _arrives(sender: can.BusABC, receiver: can.BusABC, message: can.Message) -> bool:
    sender.send(message)
    return receiver.recv(_SILENCE_S) is not None


def _exchange(sender: can.BusABC, receiver: can.BusABC, messages: list[can.Message]) -> None:
    for first in range(0, len(messages), _UP):
        epoch = messages[first : first + _UP]
        for message in epoch:
            sender.send(message)
        for _ in epoch:
            if receiver.recv(_LOSS_WAIT_S) is None:
                break


def _lost_share(sender: can.BusABC, receiver: can.BusABC, messages: list[can.Message]) -> float:
    def send() -> None:
        for message in messages:
            sender.send(message)

    thread = threading.Thread(target=send)
    thread.start()
    received = 0
    while receiver.recv(_SILENCE_S) is not None:
        received += 1
    thread.join()
    return 1 - received / len(messages)
