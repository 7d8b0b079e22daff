"""The compiled part of the hardware's shells: the step, and epoch after epoch without Python.

Python is back for whatever asks for it: a report of faults, a log, a bus with guests.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled_with
from rrins.compiled.record import I8, Bool, Floats, Record, Records, Words
from rrins.dbc.contract import Contract
from rrins.dbc.direct import NOTHING, Direct, receive, send
from rrins.dbc.frame import FrameArray
from rrins.host_tools.hardware.memory import Plant
from rrins.host_tools.hardware.step import hardware_step


class Exchange(Record):
    """State that a shell and `run_epochs` share."""

    goes_on: Bool  #: whether epochs may be exchanged without Python
    awaits: Bool  #: whether the firmware has still to answer the last epoch
    epochs: I8  #: that may be exchanged
    every: I8  #: epochs after which Python is due; 0: never
    report_epoch: I8  #: in which Python is to report faults
    count: I8  #: frames of the inbox that the next step takes
    to_send: I8  #: frames in the outbox that Python is to send; `NOTHING`: none
    received: I8  #: frames received
    sent: I8  #: frames sent


@compiled_with(nogil=True)
def run_epochs(
    plants: Records[Plant],
    pieces: Floats,
    contract: Records[Contract],
    inbox: FrameArray,
    outbox: FrameArray,
    exchanges: Records[Exchange],
    directs: Records[Direct],
    words: Words,
) -> None:
    """Run one epoch, or, where it may go on, send, receive and run until something asks for Python.

    Parameters
    ----------
    plants, pieces, contract, inbox, outbox
        As `hardware_step` takes them.
    exchanges : Records[Exchange]
    directs : Records[Direct]
        The firmware's socket.
    words : array, shape (WORDS,)
        Scratch.
    """
    plant, exchange, direct = plants[0], exchanges[0], directs[0]
    exchange.to_send = NOTHING
    exchange.received = 0
    exchange.sent = 0
    while True:
        if exchange.awaits:
            count = receive(direct, words, inbox)
            if count == NOTHING:
                return
            exchange.awaits = False
            exchange.count = count
            exchange.received += count
            if plant.epoch >= exchange.epochs:
                return
        epoch = plant.epoch
        sent = hardware_step(plants, pieces, contract, inbox, exchange.count, outbox)
        if not exchange.goes_on or epoch >= exchange.report_epoch:
            exchange.to_send = sent
            return
        if not send(direct, words, outbox, sent, epoch, epoch * plant.period_ns):
            exchange.to_send = sent
            return
        exchange.awaits = True
        exchange.sent += sent
        if exchange.every > 0 and epoch % exchange.every == 0:
            return
