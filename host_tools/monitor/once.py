"""The state of a bus without a screen: a table for pipes, JSON for scripts."""

from __future__ import annotations

from typing import Any

from host_tools.monitor.banner import banner, notices
from host_tools.monitor.listing import Row, rows_of
from host_tools.monitor.state import BusState, MessageState
from host_tools.monitor.table import table_head, table_lines
from host_tools.monitor.troubles import troubles_of
from host_tools.monitor.vitals import vitals_of

WIDTH = 160
"""Columns of the table where there is no screen."""


def table_of(bus: str, state: BusState, needle: str = "", order: str = "id") -> list[str]:
    """Return the head, the troubles one by one, and the table of messages, as lines."""
    vitals = vitals_of(state)
    troubles = troubles_of(state, vitals)
    rows = rows_of(state, needle, order)
    head = banner(bus, state, vitals, troubles, WIDTH).plain.splitlines()
    if troubles:
        head[-1:] = [f"TROUBLES {len(troubles)}", *(f"  {trouble}" for trouble in troubles)]
    lines = [
        *notices(state, is_frozen=False),
        *head,
        "",
        table_head(rows, WIDTH, order).plain,
        *(line.plain for line in table_lines(state, rows, range(len(rows)), None, WIDTH)),
    ]
    return [line.rstrip() for line in lines]


def as_dict(bus: str, state: BusState, needle: str = "", order: str = "id") -> dict[str, Any]:
    """Return the state as JSON takes it; times are bus time, and rates by it, except `quiet_s`."""
    vitals = vitals_of(state)
    return {
        "bus": bus,
        "time_s": state.time_s,
        "watched_s": state.watched_s,
        "quiet_s": state.times.quiet_s,
        "speed": state.times.speed,
        "ended": state.times.ended,
        "gaps": state.times.gaps,
        "frames": state.frames,
        "error_frames": state.error_frames,
        "rate_hz": state.rate_hz,
        "load": state.load,
        "peak_load": state.peak_load,
        **vitals.as_dict(),
        "troubles": troubles_of(state, vitals),
        "messages": [_message(state, row) for row in rows_of(state, needle, order)],
    }


def _message(state: BusState, row: Row) -> dict[str, Any]:
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
