"""Batches of frames to and from a socket, in compiled code.

A side on the embedded bus need not ask Python for every epoch: its compiled shell exchanges
datagrams with the other one's socket, and the host passes them on to one more end, such as a
recorder. What else may come, a guest or a word of the host, is left to Python. A datagram is a
header of four 64-bit words, as `rrins.host_tools.bus.datagram` lays it out, and two words for each
frame.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from rrins.compiled.compilation import IS_DISABLED, Foreign, compiled
from rrins.compiled.record import I8, U8, Integers, Record, Words
from rrins.dbc.frame import FrameArray

AVAILABLE = not IS_DISABLED
"""Whether code is compiled, and so can call the kernel."""

WORDS = 8193
"""Room for the longest datagram, and for a byte that gives away a longer one."""

NOTHING = -1
"""Value that `receive` returns when Python has to handle it."""

TIME_WORD = 3
"""The word of a header with the time of the batch, ns."""

_HEADER_WORDS = 4
_CLOSES_EPOCH = np.uint64(1 << 40)
_COUNT_BIT = np.uint64(48)
_LENGTH_BIT = np.uint64(32)
_LOW = np.uint64(0xFFFF_FFFF)
_LONGEST = np.uint64(8)

_PATIENCE_MS = 200
"""After which Python may look for a signal that came just before the wait."""

_POLLIN = 1
_EVENTS_BIT, _REVENTS_BIT = 32, 48  # of struct pollfd, as one word
_MSG_DONTWAIT, _MSG_NOSIGNAL = 0x40, 0x4000

_poll = Foreign("poll", "int32", ("uintp", "uint64", "int32"))
_recv = Foreign("recv", "intp", ("int32", "uintp", "uintp", "int32"))
_send = Foreign("send", "intp", ("int32", "uintp", "uintp", "int32"))


class Direct(Record):
    """The other side's socket, and what a datagram to it says."""

    fd: I8
    door: I8  #: descriptor that is readable while the host of the bus has something to do; or -1
    listener: I8  #: socket of an end that gets the batches of both sides from here; or -1
    opening: U8  #: first word of the header of a batch without frames that closes an epoch
    own: U8  #: second word of a datagram sent: the node number
    other: U8  #: the same of a datagram received
    time_ns: I8  #: of the last batch sent
    batches: I8  #: sent
    left_over: I8  #: bytes of a datagram that was received and is not such a batch; 0: none
    polled: Annotated[Words, 3]  #: scratch


@compiled
def send(
    direct: Direct, words: Words, frames: FrameArray, count: int, epoch: int, time_ns: int
) -> bool:
    """Send the first `count` frames, which close an epoch; return False if nobody took them.

    Parameters
    ----------
    direct : Direct
    words : array, shape (WORDS,)
        Scratch.
    frames : FrameArray
    count, epoch, time_ns : int
    """
    words[0] = direct.opening | np.uint64(count) << _COUNT_BIT
    words[1] = direct.own
    words[2] = np.uint64(epoch)
    words[3] = np.uint64(time_ns)
    for k in range(count):
        frame, at = frames[k], _HEADER_WORDS + 2 * k
        words[at] = np.uint64(frame.can_id) | np.uint64(frame.length) << _LENGTH_BIT
        words[at + 1] = frame["data"]
    size = 8 * (_HEADER_WORDS + 2 * count)
    is_heard = direct.listener >= 0
    if is_heard and not _put(direct.listener, words, size):
        return False
    if not _put(direct.fd, words, size) and not is_heard:  # else the answer will not come
        return False
    direct.time_ns = time_ns
    direct.batches += 1
    return True


@compiled
def _put(fd: int, words: Words, size: int) -> bool:
    """Send a datagram; return whether the socket took it."""
    return bool(_send(fd, words.ctypes.data, size, _MSG_DONTWAIT | _MSG_NOSIGNAL) == size)


@compiled
def receive(direct: Direct, words: Words, frames: FrameArray) -> int:
    """Wait for a batch that closes an epoch; return the number of its frames, or `NOTHING`.

    With `NOTHING` Python is to receive next, and to begin with what is left over.

    Parameters
    ----------
    direct : Direct
    words : array, shape (WORDS,)
        Holds what is left over.
    frames : FrameArray
        Takes the frames.
    """
    polled = direct.polled
    polled[0] = np.uint64(direct.fd) | np.uint64(_POLLIN << _EVENTS_BIT)
    polled[1] = np.uint64(direct.door & 0xFFFF_FFFF) | np.uint64(_POLLIN << _EVENTS_BIT)
    polled[2] = np.uint64(direct.listener & 0xFFFF_FFFF) | np.uint64(_POLLIN << _EVENTS_BIT)
    if _poll(polled.ctypes.data, len(polled), _PATIENCE_MS) < 1:
        return NOTHING
    if (polled[1] | polled[2]) >> _REVENTS_BIT != 0:
        return NOTHING
    size = _recv(direct.fd, words.ctypes.data, words.size * 8 - 7, _MSG_DONTWAIT)
    if size <= 0:
        return NOTHING
    direct.left_over = size
    count = _frames_in(size)
    if words[0] != direct.opening | np.uint64(count) << _COUNT_BIT or words[1] != direct.other:
        return NOTHING
    count = _unpack(direct, words, frames, count)
    if count != NOTHING and direct.listener >= 0 and not _put(direct.listener, words, size):
        direct.left_over = size
        return NOTHING
    return count


@compiled
def take(direct: Direct, words: Words, frames: FrameArray) -> int:
    """Take a batch of any sender that is there already; return as `receive` does.

    Its time is `words[TIME_WORD]`.
    """
    size = _recv(direct.fd, words.ctypes.data, words.size * 8 - 7, _MSG_DONTWAIT)
    if size <= 0:
        return NOTHING
    direct.left_over = size
    count = _frames_in(size)
    if words[0] | _CLOSES_EPOCH != direct.opening | np.uint64(count) << _COUNT_BIT:
        return NOTHING
    if words[1] > _LOW:
        return NOTHING
    return _unpack(direct, words, frames, count)


@compiled
def take_many(direct: Direct, words: Words, frames: FrameArray, heads: Integers) -> int:
    """Take the batches that are there already, one behind the other; return how many.

    Parameters
    ----------
    direct : Direct
    words : array, shape (WORDS,)
        Holds what is left over, if it is not for `take`.
    frames : FrameArray
        Takes the frames of all.
    heads : array of int, shape (n, 4)
        Takes the number of frames, the time in ns, the sender, and whether it closes an epoch, of
        each batch.
    """
    times_ns = words.view(np.int64)
    first = 0
    for k in range(len(heads)):
        count = take(direct, words, frames[first:])
        if count == NOTHING:
            return k
        head = heads[k]
        head[0], head[1], head[2] = count, times_ns[TIME_WORD], np.int64(words[1])
        head[3] = (words[0] & _CLOSES_EPOCH) != 0
        first += count
    return len(heads)


@compiled
def _frames_in(size: int) -> int:
    """Return how many frames a datagram of a size has, 0 to 65535."""
    return max(0, (size // 8 - _HEADER_WORDS) // 2)


@compiled
def _unpack(direct: Direct, words: Words, frames: FrameArray, count: int) -> int:
    """Take the frames of a datagram of `direct.left_over` bytes; return as `receive` does."""
    if direct.left_over != 8 * (_HEADER_WORDS + 2 * count) or count > len(frames):
        return NOTHING
    for k in range(count):
        frame, at = frames[k], _HEADER_WORDS + 2 * k
        length = words[at] >> _LENGTH_BIT & np.uint64(0xFF)
        if length > _LONGEST:
            return NOTHING
        frame.can_id = words[at] & _LOW
        frame.length = length
        frame["data"] = words[at + 1]
    direct.left_over = 0
    return count
