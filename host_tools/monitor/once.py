"""The state of a bus without a screen: a table for pipes, JSON for scripts."""

from __future__ import annotations

from rrins.host_tools.files import JsonObject
from rrins.host_tools.monitor.banner import banner, notices
from rrins.host_tools.monitor.dialogue import Dialogue
from rrins.host_tools.monitor.estimates import Estimates
from rrins.host_tools.monitor.listing import MessageRow, message_rows
from rrins.host_tools.monitor.redundancy import redundancy_words
from rrins.host_tools.monitor.state import BusState, MessageState
from rrins.host_tools.monitor.table import table_head, table_lines
from rrins.host_tools.monitor.troubles import troubles_of
from rrins.host_tools.monitor.vitals import vitals_of

WIDTH = 1000
"""Columns of the table when there is no screen: enough for all values, nothing is cut."""


def table_of(
    bus: str,
    state: BusState,
    needle: str = "",
    order: str = "id",
    dialogue: Dialogue | None = None,
) -> list[str]:
    """Return the header, all troubles, the table of messages and the diagnosis, as lines."""
    vitals = vitals_of(state)
    troubles = troubles_of(state, vitals)
    rows = message_rows(state, needle, order)
    head = banner(bus, state, vitals, troubles, WIDTH).plain.splitlines()
    if troubles:
        head[-1:] = [f"TROUBLES {len(troubles)}", *(f"  {trouble}" for trouble in troubles)]
    lines = [
        *notices(state, is_frozen=False),
        *head,
        *redundancy_words(vitals.redundancy, vitals.readmission),
        "",
        table_head(rows, WIDTH, order).plain,
        *(line.plain for line in table_lines(state, rows, range(len(rows)), None, WIDTH)),
    ]
    if dialogue is not None and dialogue.spoken:
        lines += ["", "DIAGNOSIS", *(f"  {one.line}" for one in dialogue.spoken)]
    if dialogue is not None and dialogue.measured:
        lines += ["", "MEASURED", *(f"  {line}" for line in dialogue.measured_lines())]
    return [line.rstrip() for line in lines]


def as_dict(
    bus: str,
    state: BusState,
    needle: str = "",
    order: str = "id",
    estimates: Estimates | None = None,
    dialogue: Dialogue | None = None,
) -> JsonObject:
    """Return the state for JSON; times and rates are in bus time, except `quiet_s`.

    `estimates` has noted earlier states, with the estimator's other sources and sensors;
    `dialogue` has followed diagnosis and measured data.
    """
    vitals = vitals_of(state)
    estimates = estimates or Estimates()
    return {
        "bus": bus,
        "time_s": state.time_s,
        "watched_s": state.watched_s,
        "quiet_s": state.times.quiet_s,
        "speed": state.times.speed,
        "ended": state.times.ended,
        "gaps": state.times.gaps,
        "refused_frames": state.times.refused.frames,
        "frames": state.frames,
        "error_frames": state.error_frames,
        "rate_hz": state.rate_hz,
        "load": state.load,
        "peak_load": state.peak_load,
        **vitals.as_dict(),
        "troubles": troubles_of(state, vitals),
        "estimator": estimates.as_dict(state),
        "diagnosis": [] if dialogue is None else [vars(one) for one in dialogue.spoken],
        "measured": {
            one.name: {"value": one.value, "text": one.words, "unit": one.unit}
            for one in ([] if dialogue is None else dialogue.measured)
        },
        "messages": [_message(state, row) for row in message_rows(state, needle, order)],
    }


def _message(state: BusState, row: MessageRow) -> JsonObject:
    message: MessageState = row.message
    signals = {}
    if message.name is not None:
        for name in row.signals:
            signal = state.signal(message.name, name)
            signals[name] = {
                "value": signal.value,
                "text": signal.text,
                "unit": signal.unit,
                "min": signal.low,
                "max": signal.high,
            }
    return {
        "name": message.name,
        "id": message.identifier,
        "is_extended": message.is_extended,
        "is_remote": message.is_remote,
        "count": message.count,
        "rate_hz": message.rate_hz,
        "period_s": message.period_s,
        "age_s": message.age_s,
        "is_silent": message.is_silent,
        "lost": message.lost,
        "out_of_turn": message.out_of_turn,
        "crc_errors": message.crc_errors,
        "data": message.data.hex(),
        "signals": signals,
    }
