"""Sessions and the lock of the computer as ODX describes them: state charts and conditions."""

from __future__ import annotations

from collections.abc import Iterator

from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import OdxDocFragment, OdxLinkId
from odxtools.preconditionstateref import PreConditionStateRef
from odxtools.state import State
from odxtools.statechart import StateChart
from odxtools.statetransition import StateTransition
from odxtools.statetransitionref import StateTransitionRef

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session
from rrins.host_tools.diag.exchanges import Exchange

_SESSION, _LOCK = "session", "lock"
_LOCKED, _UNLOCKED = "locked", "unlocked"
_LOCK_MOVES = ((_LOCKED, _UNLOCKED), (_UNLOCKED, _LOCKED))
_Moves = tuple[tuple[str, str], ...]


def _moves() -> _Moves:
    """Return from which session to which DiagnosticSessionControl leads."""
    service = table.service(0x10)
    return tuple(
        (before.name.lower(), after.name.lower())
        for after in Session
        for before in Session
        if service.only_in.get(after, service.access).allows_in(before)
    )


def charts(place: tuple[OdxDocFragment]) -> NamedItemList[StateChart]:
    """Return the charts of the sessions and of the lock."""
    sessions = [session.name.lower() for session in Session]
    return NamedItemList(
        [
            _chart(place, _SESSION, "SESSION", sessions, _moves()),
            _chart(place, _LOCK, "SECURITY", [_LOCKED, _UNLOCKED], _LOCK_MOVES),
        ]
    )


def _chart(
    place: tuple[OdxDocFragment], name: str, semantic: str, states: list[str], moves: _Moves
) -> StateChart:
    return StateChart(
        odx_id=OdxLinkId(f"CHART.{name}", place),
        short_name=name,
        semantic=semantic,
        start_state_snref=states[0],
        states=NamedItemList(
            [State(odx_id=OdxLinkId(_state(name, one), place), short_name=one) for one in states]
        ),
        state_transitions=[
            StateTransition(
                odx_id=OdxLinkId(_transition(name, move), place),
                short_name=f"{move[0]}_to_{move[1]}",
                source_snref=move[0],
                target_snref=move[1],
            )
            for move in moves
        ],
    )


def _state(chart: str, name: str) -> str:
    return f"STATE.{chart}.{name}"


def _transition(chart: str, move: tuple[str, str]) -> str:
    return f"TRANSITION.{chart}.{move[0]}_to_{move[1]}"


def conditions(place: tuple[OdxDocFragment], exchange: Exchange) -> list[PreConditionStateRef]:
    """Return the states in which a request is allowed."""
    states = [_state(_SESSION, one.name.lower()) for one in sorted(exchange.access.sessions)]
    if exchange.access.secured:
        states.append(_state(_LOCK, _UNLOCKED))
    return [PreConditionStateRef(ref_id=state, ref_docs=place) for state in states]


def transitions(place: tuple[OdxDocFragment], exchange: Exchange) -> list[StateTransitionRef]:
    """Return the transitions that a positive response means."""
    return [StateTransitionRef(ref_id=one, ref_docs=place) for one in _transitions_of(exchange)]


def _transitions_of(exchange: Exchange) -> Iterator[str]:
    if exchange.unlocks:
        yield _transition(_LOCK, _LOCK_MOVES[0])
    if exchange.enters is not None:
        for move in _moves():
            if move[1] == exchange.enters.name.lower():
                yield _transition(_SESSION, move)
        yield _transition(_LOCK, _LOCK_MOVES[1])
