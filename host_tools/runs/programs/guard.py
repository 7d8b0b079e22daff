"""Ends a user's program when the process that started it is gone, however it went.

A process of its own, with the standard library alone: ``python -I -S guard.py PID GRACE_S``. Its
standard input is a pipe that the starting process holds open: its end is the end of that process.
Then all of the program's session gets SIGTERM and, `GRACE_S` seconds later, SIGKILL.
"""

import contextlib
import os
import signal
import sys
import time

_LOOK_S = 0.1


def is_gone(session: int) -> bool:
    """Return whether no process of a session is left."""
    try:
        os.killpg(session, 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        pass
    return False


def end(session: int, grace_s: float) -> None:
    """Have a session end; kill it if it does not heed that within `grace_s` seconds."""
    os.killpg(session, signal.SIGTERM)
    os.killpg(session, signal.SIGCONT)
    deadline = time.monotonic() + grace_s
    while time.monotonic() < deadline and not is_gone(session):
        time.sleep(_LOOK_S)
    os.killpg(session, signal.SIGKILL)


def main() -> None:
    """Wait for the end of standard input, and end the session."""
    session, grace_s = int(sys.argv[1]), float(sys.argv[2])
    while os.read(0, 1):
        pass
    # It may have ended by itself, or run as somebody else.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        end(session, grace_s)


if __name__ == "__main__":
    main()
