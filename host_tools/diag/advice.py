"""Negative responses in words: what the navigation computer refused, why, and what to do."""

from __future__ import annotations

from udsoncan.Response import Response

from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.responses import MEANINGS, Code
from rrins.host_tools.errors import NegativeResponseError

_WHAT_TO_DO = {
    Code.SECURITY_ACCESS_DENIED: "unlock with --security",
    Code.INVALID_KEY: "give the secret with --secret-file",
    Code.EXCEEDED_NUMBER_OF_ATTEMPTS: (
        f"wait {access.ATTEMPT_DELAY_MS // 1000} s and give the secret with --secret-file"
    ),
    Code.REQUIRED_TIME_DELAY_NOT_EXPIRED: f"wait {access.ATTEMPT_DELAY_MS // 1000} s",
    Code.BUSY_REPEAT_REQUEST: "try again",
    Code.GENERAL_PROGRAMMING_FAILURE: "nothing was changed",
    Code.SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION: "the session was lost; try again",
    Code.SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION: "the session was lost; try again",
}


def name_of(code: int) -> str:
    """Return the name of a negative response code as in ISO 14229-1."""
    name = Response.Code.get_name(code) or "unknown"
    return name[0].lower() + name[1:]


def code_words(code: int) -> str:
    """Return a negative response code with its name and its meaning here."""
    known = Code(code) if code in list(Code) else None
    meaning = f": {MEANINGS[known]}" if known is not None else ""
    return f"{name_of(code)} (0x{code:02X}){meaning}"


def refusal(what: str, code: int, advice: str = "") -> NegativeResponseError:
    """Return the error for a negative response.

    Parameters
    ----------
    what : str
        The request.
    code : int
    advice : str
        What to do about it, if more specific than the advice for the code.
    """
    known = Code(code) if code in list(Code) else None
    advice = advice or (_WHAT_TO_DO.get(known, "") if known is not None else "")
    return NegativeResponseError(
        f"{what}: {code_words(code)}" + (f"; {advice}" if advice else ""), code
    )
