"""What a test sees of a bus: it lets time pass and looks at the frames."""

from __future__ import annotations

from host_tools.testing.errors import BenchError
from host_tools.testing.expectation import Expectation, Where, in_words
from host_tools.testing.recording import Contract, FrameRing, Messages, Values
from host_tools.testing.worlds import World

_STATUS, _FAULTS = "FIRMWARE_STATUS", "FIRMWARE_FAULTS"
_NO_COUNTERS = ("crc", "alive_counter", "time_s", "crc_holds")


class Watcher:
    """Eyes on a world.

    Parameters
    ----------
    world : World
    ring : FrameRing
        What the world hands its frames to.
    """

    def __init__(self, world: World, ring: FrameRing) -> None:
        self._world = world
        self._ring = ring
        self._contract = Contract()
        self._told = ""  # why the world has ended, as a call of the test has said

    @property
    def time_s(self) -> float:
        """Simulated time since power-on."""
        return self._world.now_ns / 1e9

    def advance(self, seconds: float) -> None:
        """Let simulated time pass: that many epochs (rounded), or in real time that long.

        Raises
        ------
        BenchError
            When a process has died or the scenario is over.
        """
        until_ns = self._world.now_ns + round(seconds * 1e9)
        while self._pump(until_ns):
            pass

    def _pump(self, until_ns: int) -> bool:
        try:
            return self._world.pump(until_ns)
        except BenchError as error:
            self._told = str(error)
            raise

    def expect(self, message: str, within: float, where: Where = None, at_least: int = 1) -> Values:
        """Let time pass until a frame has been sent, by whomever; return its values.

        Frames from now on count; in real time, those since the last call of the bench. A frame with
        a wrong CRC does not count, unless `where` asks for ``crc_holds``.

        Parameters
        ----------
        message : str
            Name in the DBC.
        within : float
            Seconds of simulated time.
        where : dict or callable, optional
            Values wanted by signal name (a value, or a callable that takes it), or a callable that
            takes all values of a frame.
        at_least : int
            Frames that have to come.

        Returns
        -------
        dict
            Values of the last of them: signals by name, `time_s`, `crc_holds`.

        Raises
        ------
        AssertionError
            When they did not come; says what came instead.
        BenchError
            For names that the DBC has not, a process that has died, a scenario that is over.
        """
        __tracebackhide__ = True
        wanted = Expectation(self._contract, message, where)
        start_ns = self._world.now_ns
        first = seen = self._ring.total
        hits: list[Values] = []
        until_ns = start_ns + round(within * 1e9)
        while self._pump(until_ns):
            hits += wanted.hits(self._ring, seen)
            seen = self._ring.total
            if len(hits) >= at_least:
                return hits[at_least - 1]
        came = self._contract.can_id(message)
        count = len(self._ring.find(came, first)[0])
        number = "" if at_least == 1 else f" {at_least} times ({len(hits)} came)"
        raise AssertionError(
            f"no {wanted}{number} within {within:g} s, by {self.time_s:.3f} s\n"
            f"  {count} {message} came meanwhile; {self._last_words(message)}\n"
            f"{self._state_words()}"
        )

    def expect_not(self, message: str, within: float, where: Where = None) -> None:
        """Let time pass and see to it that no such frame is sent; see `expect`.

        Raises
        ------
        AssertionError
            As soon as one was sent.
        """
        __tracebackhide__ = True
        wanted = Expectation(self._contract, message, where)
        start_s = self.time_s
        seen = self._ring.total
        until_ns = self._world.now_ns + round(within * 1e9)
        while self._pump(until_ns):
            hits = wanted.hits(self._ring, seen)
            seen = self._ring.total
            if hits:
                raise AssertionError(
                    f"{wanted} came {hits[0]['time_s'] - start_s:.3f} s after {start_s:.3f} s, "
                    f"unwanted for {within:g} s\n  {in_words(hits[0])}\n{self._state_words()}"
                )

    def messages(self, message: str) -> Messages:
        """Return all frames of a message so far, oldest first, as far as they are remembered."""
        self._world.catch_up()
        return Messages(self._contract, message, *self._ring.find(self._contract.can_id(message)))

    def last(self, message: str) -> Values | None:
        """Return the values of the last sound frame of a message; None when there was none."""
        every = self.messages(message)
        return next((values for values in reversed(every) if values["crc_holds"]), None)

    @property
    def mode(self) -> str:
        """Mode of the firmware, as it last said; empty before that."""
        return str((self.last(_STATUS) or {}).get("mode", ""))

    @property
    def fault_counters(self) -> dict[str, int]:
        """What the firmware has counted, as it last said: crc_errors, missing_frames, ….

        Empty before it has said so.
        """
        values = self.last(_FAULTS) or {}
        return {name: int(value) for name, value in values.items() if name not in _NO_COUNTERS}

    @property
    def frames_sha256(self) -> str:
        """Digest over the frames that are remembered, with their times and senders."""
        return self._ring.sha256()

    @property
    def frames(self) -> int:
        """Frames on the bus so far."""
        return self._ring.total

    def _last_words(self, message: str) -> str:
        last = self.last(message)
        return "there was none before" if last is None else f"the last one ever: {in_words(last)}"

    def _state_words(self) -> str:
        status, counters = self.last(_STATUS), self.fault_counters
        if status is None:
            return "  the firmware has not said its mode yet"
        listed = ", ".join(f"{name} {value}" for name, value in counters.items())
        return (
            f"  mode {status['mode']}, fault {status['fault']} at {status['time_s']:.3f} s\n"
            f"  fault counters: {listed}"
        )
