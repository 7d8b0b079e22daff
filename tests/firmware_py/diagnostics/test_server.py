"""Sessions and their timing, security, addressing, reset: what a single response does not show."""

from __future__ import annotations

import pytest

from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.diagnostics.access import Session, key_of

WRONG_KEY = "2702" + "00" * 8


class SlowJob:
    def __init__(self, done_at_ns, node):
        self._done_at_ns, self._node = done_at_ns, node
        self.failed = False

    @property
    def done(self):
        return self._node.now_ns >= self._done_at_ns


class SlowStore:
    """A memory that takes some virtual time to write."""

    def __init__(self, node, seconds):
        self._node, self._seconds = node, seconds

    def submit(self, store, image):
        return SlowJob(self._node.now_ns + round(self._seconds * 1e9), self._node)

    def close(self): ...


def use(tool, writer):
    tool.node.parameters._store = object()  # the writer does not look at it
    tool.node.writer = writer


def test_a_session_ends_five_seconds_after_the_last_request(tool):
    tool.step([bytes.fromhex("021003cccccccccc")])
    tool.run(4.9)
    assert tool.server.session == Session.EXTENDED
    tool.functional("3e80")
    tool.run(4.9)
    assert tool.server.session == Session.EXTENDED
    tool.run(0.2)
    assert tool.server.session == Session.DEFAULT
    assert not tool.node.is_awake


def test_what_was_held_for_the_tool_is_given_back_when_it_is_gone(tool):
    tool.step([bytes.fromhex("021003cccccccccc")])
    tool.unlock()
    tool.ask("2f02110300030000")
    tool.ask("2f031103" + "4024" + "00" * 6)
    tool.ask("8502")
    tool.ask("280103")
    monitor, sequencer = tool.state["diagnostics"], tool.state["sequencer"]
    assert (monitor["excluded_gyros"], monitor["held"], sequencer["command"][0]) == (3, True, 2)
    tool.run(5.1)
    assert (monitor["excluded_gyros"], monitor["held"], sequencer["command"][0]) == (0, False, 1)
    assert not tool.server.is_unlocked
    names = {frame["can_id"] for _ in range(200) for frame in tool.bench.step()}
    assert 0x701 in names


@pytest.mark.parametrize("again", ["1003", "1002", "1001"])
def test_every_change_of_the_session_locks(tool, again):
    tool.unlock()
    assert tool.server.is_unlocked
    tool.ask(again)
    assert not tool.server.is_unlocked


def test_a_key_fits_one_seed_only(tool):
    tool.ask("1003")
    first = tool.ask("2701")
    second = tool.ask("2701")
    assert first != second
    assert tool.ask(b"\x27\x02" + key_of(bytes.fromhex(first[4:]))) == "7f2735"
    assert tool.ask(b"\x27\x02" + key_of(bytes.fromhex(second[4:]))) == "7f2724"


@pytest.mark.slow
def test_three_wrong_keys_close_the_door_for_ten_seconds(tool):
    tool.ask("1003")
    for answer in ("7f2735", "7f2735", "7f2736"):
        tool.ask("2701")
        assert tool.ask(WRONG_KEY) == answer
    assert tool.ask("2701") == "7f2737"
    tool.ask("1101")  # neither a reset nor another session helps
    tool.node.restart()
    tool.ask("1003")
    assert tool.ask("2701") == "7f2737"
    tool.run(10.1)
    tool.ask("1003")
    tool.ask("2701")
    assert tool.ask(WRONG_KEY) == "7f2736"  # one more only
    tool.run(10.1)
    tool.unlock()
    assert tool.server.is_unlocked


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("3e00", "7e00"),
        ("3e80", None),
        ("220102", "6201020200"),
        ("22ffff", None),  # 0x31
        ("9b", None),  # 0x11
        ("3e01", None),  # 0x12
        ("1002", None),  # 0x7E
        ("2701", None),  # 0x7F
        ("22", "7f2213"),
        ("1001", "5001003201f4"),
    ],
)
def test_requests_to_everybody(tool, request_, answer):
    frames = tool.functional(request_)
    if answer is None:
        assert frames == []
    else:
        data = bytes.fromhex(answer)
        assert frames == [bytes([len(data)]) + data.ljust(7, b"\xcc")]


def test_a_functional_request_is_a_single_frame(tool):
    assert tool.step([bytes.fromhex("100a220101010201")], 0x7DF) == []
    assert tool.node._transport.is_idle


def test_a_response_that_takes_long_is_announced(tool):
    tool.unlock()
    use(tool, SlowStore(tool.node, 4.5))
    begin_ns = tool.node.now_ns
    heard = []
    tool.step([bytes.fromhex("100b2e10043fe000")])
    frames = tool.step([bytes.fromhex("2100000000000000")])
    for _ in range(1000):
        heard += [((tool.node.now_ns - begin_ns) / 1e9, frame.hex()) for frame in frames]
        frames = tool.step()
    assert [frame for _, frame in heard] == [
        "037f2e78cccccccc",
        "037f2e78cccccccc",
        "036e1004cccccccc",
    ]
    times = [time for time, _ in heard]
    assert times[0] <= 0.05
    assert times[1] - times[0] <= 5.0
    assert times[2] == pytest.approx(4.5, abs=0.02)


def test_what_was_announced_is_answered_even_when_suppressed(tool):
    tool.unlock()
    use(tool, SlowStore(tool.node, 0.1))
    assert tool.server.handle(bytes.fromhex("31810206"), False, tool.node.now_ns) is None
    said = []
    for _ in range(40):
        tool.step()
        said.append(tool.server.poll(tool.node.now_ns))
    assert [one.hex() for one in said if one] == ["7f3178", "7101020602"]


def test_a_request_while_another_is_worked_on(tool):
    tool.unlock()
    use(tool, SlowStore(tool.node, 1.0))
    assert tool.server.handle(bytes.fromhex("2e10043fe0000000000000"), False, 0) is None
    assert tool.server.handle(bytes.fromhex("220102"), False, 0).hex() == "7f2221"
    assert tool.server.handle(bytes.fromhex("3e00"), True, 0) is None


def test_a_memory_that_cannot_be_written_is_said_so(tool):
    class Broken(SlowStore):
        def submit(self, store, image):
            job = super().submit(store, image)
            job.failed = True
            return job

    tool.unlock()
    before = tool.ask("221004")
    use(tool, Broken(tool.node, 0.0))
    assert tool.ask("2e10043fe0000000000000") == "7f2e72"
    assert tool.ask("221004") == before


@pytest.mark.parametrize("kind", ["01", "03"])
def test_a_reset_powers_the_computer_on_anew_after_the_response(tool_at, kind):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    tool.unlock()
    tool.ask("2e10043fe0000000000000")
    frames = tool.step([bytes.fromhex(f"0211{kind}cccccccccc")])
    assert frames == [bytes.fromhex(f"0251{kind}cccccccccc")]
    assert tool.bench.mode == Mode.NAVIGATION_STRAPDOWN
    tool.step()
    assert tool.bench.mode == Mode.SELF_TEST
    assert tool.bench.firmware.epoch == tool.bench.epoch - 1  # taken over from SYNC
    assert tool.server.session == Session.DEFAULT
    assert tool.state["parameters"]["bridge_epochs"] == 100  # 0.5 s, in force now
    tool.bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)


@pytest.mark.parametrize("request_", ["1101", "1103", "1181"])
def test_a_computer_that_navigates_resets_only_when_unlocked(tool_at, request_):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    tool.ask("1003")
    assert tool.ask(request_) == "7f1122"
    assert not tool.node.reset_due
    tool.unlock()
    assert tool.ask(request_) in (f"51{request_[2:]}", None)
    assert tool.server.reset_wanted is not None


def test_the_time_of_the_server_goes_on_over_a_reset(tool):
    before_ns = tool.node.now_ns
    tool.ask("1003")
    tool.ask("1101")
    tool.step([bytes.fromhex("023e80cccccccccc")])
    tool.step()
    tool.step()
    assert before_ns < tool.node.now_ns <= before_ns + 3 * tool.bench.period_ns


def test_stopped_messages_are_not_sent_and_go_on_again(tool_at):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)

    def names():
        sent = [frame for _ in range(200) for frame in tool.bench.step()]
        return {int(frame["can_id"]) for frame in sent}, sent

    everything, _ = names()
    tool.step([bytes.fromhex("021003cccccccccc")])
    tool.step([bytes.fromhex("03280101cccccccc")])
    kept, sent = names()
    assert everything - kept == {0x100, 0x101, 0x120, 0x121, 0x122, 0x123, 0x124}
    assert sent[-1]["can_id"] == 0x21  # it closes the epoch
    tool.step([bytes.fromhex("03280102cccccccc")])
    assert names()[0] == {0x20, 0x21}
    tool.step([bytes.fromhex("03280003cccccccc")])
    assert names()[0] == everything
