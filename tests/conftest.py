"""Settings for every test."""

from __future__ import annotations

import signal

from hypothesis import settings

# The first example of a property may compile code.
settings.register_profile("rrins", deadline=None)
settings.load_profile("rrins")

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
