"""The compiled part of the firmware's shells: the step, and epoch after epoch without Python.

Python is back for whatever asks for it: diagnostics, a task that is due, a bus with guests.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled_with
from rrins.compiled.record import F8, I8, Bool, Record, Records, Words
from rrins.dbc.contract import Contract
from rrins.dbc.direct import NOTHING, Direct, receive, send
from rrins.dbc.frame import FrameArray
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.modes.modes import Mode, navigating
from rrins.firmware_py.core.records.memory import NavigationOutput, Ram
from rrins.firmware_py.core.step import firmware_step


class Exchange(Record):
    """State that a shell and `run_epochs` share."""

    goes_on: Bool  #: whether epochs may be exchanged without Python
    arrivals: I8  #: epochs received in lockstep so far
    clock_error_ppm: F8  #: of the own clock
    every: I8  #: epochs after which Python is due; 0: never
    to_send: I8  #: frames in the outbox that Python is to send; `NOTHING`: none
    rows: I8  #: navigation outputs that were written
    received: I8  #: frames used
    sent: I8  #: frames sent


@compiled_with(nogil=True)
def run_epochs(
    ram: Records[Ram],
    contract: Records[Contract],
    inbox: FrameArray,
    start: int,
    count: int,
    outbox: FrameArray,
    compares: bool | None,
    estimates: bool | None,
    trace: Records[NavigationOutput],
    exchanges: Records[Exchange],
    directs: Records[Direct],
    words: Words,
) -> None:
    """Run an epoch on given frames; then receive, run and send as long as nothing asks for Python.

    Parameters
    ----------
    ram, contract, inbox, start, count, outbox, compares, estimates
        As `firmware_step` takes them; with `NOTHING` as `count` the first epoch is received.
    trace : Records[NavigationOutput]
        Takes the navigation output of each epoch with navigation; one more always finds room.
    exchanges : Records[Exchange]
    directs : Records[Direct]
        The other side's socket.
    words : array, shape (WORDS,)
        Scratch.
    """
    state, exchange, direct = ram[0], exchanges[0], directs[0]
    period_ns = state.parameters.period_ns
    exchange.to_send = NOTHING
    exchange.rows = 0
    exchange.received = 0
    exchange.sent = 0
    while True:
        if count == NOTHING:
            count = receive(direct, words, inbox)
            if count == NOTHING:
                return
            state.clock.sync_arrival_ns = own_clock_ns(
                exchange.arrivals * period_ns, exchange.clock_error_ppm
            )
            state.clock.is_whole = True
            exchange.arrivals += 1
        sent = firmware_step(ram, contract, inbox, start, count, outbox, compares, estimates)
        if navigating(state):
            trace[exchange.rows] = state.navigation
            exchange.rows += 1
        exchange.received += state.consumed - start
        if not exchange.goes_on or state.diagnostics.attention:
            exchange.to_send = sent
            return
        if not send(direct, words, outbox, sent, state.epoch, state.epoch * period_ns):
            exchange.to_send = sent
            return
        exchange.sent += sent
        is_due = exchange.every > 0 and state.epoch % exchange.every == 0
        is_over = state.modes.mode == Mode.SHUTDOWN or exchange.rows == len(trace)
        if is_due or is_over:
            return
        start, count = 0, NOTHING


def exchange_record(clock_error_ppm: float = 0.0, every: int = 0) -> Records[Exchange]:
    """Return the record of a shell that begins."""
    exchange = Exchange.zeros()
    exchange[0].clock_error_ppm = clock_error_ppm
    exchange[0].every = every
    return exchange
