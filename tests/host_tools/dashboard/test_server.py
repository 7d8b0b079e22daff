"""The server as others reach it: what it serves, to whom, and what it refuses."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import socket
import struct
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
import uvicorn
from uvicorn.server import ServerState
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rrins.host_tools.dashboard import patience
from rrins.host_tools.dashboard.log_source import LogSource
from rrins.host_tools.dashboard.page_orders import Order
from rrins.host_tools.dashboard.patience import AT_ONCE
from rrins.host_tools.dashboard.quantities import NAMES
from rrins.host_tools.dashboard.server import KEPT, MOST_BROWSERS

pytestmark = pytest.mark.slow


def address(served):
    parts = urlsplit(served.url)
    return parts.hostname, parts.port


def get(served, path, **headers):
    connection = http.client.HTTPConnection(*address(served), timeout=120.0)
    connection.putrequest("GET", path, "Host" in headers, skip_accept_encoding=True)
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def feed(served, origin=None, query="", **options):
    host, port = address(served)
    return connect(
        f"ws://{host}:{port}/feed{query}",
        origin=origin or f"http://{host}:{port}",
        max_size=None,
        compression=None,
        **options,
    )


def answer_to(client, **order):
    """Give an order; return its answer."""
    client.send(json.dumps({"id": 5, **order}))
    while True:
        message = client.recv(timeout=120.0)
        if isinstance(message, str) and json.loads(message).get("id") == 5:
            return json.loads(message)


def send_until_closed(client, messages):
    for message in messages:
        client.send(message)
    while True:
        client.recv(timeout=120.0)


def rows(client, count):
    """Return numbers and times of the next rows."""
    found = []
    while len(found) < count:
        message = client.recv(timeout=120)
        if isinstance(message, bytes) and message[0] == 1:
            found.append(struct.unpack_from("<4xId", message))
    return found


def seek(client, time_s):
    """Go to a time; return the answer once there is a row of that time, which may come first."""
    client.send(json.dumps({"id": 5, "order": "seek", "time_s": time_s}))
    answer, at_s = None, -1.0
    while answer is None or abs(at_s - time_s) > 0.006:
        message = client.recv(timeout=120)
        if isinstance(message, str):
            answer = json.loads(message) if json.loads(message).get("id") == 5 else answer
        elif message[0] == 1:
            _, at_s = struct.unpack_from("<4xId", message)
    return answer


def state(client):
    """Return the next state of the bus."""
    while True:
        message = client.recv(timeout=120.0)
        if isinstance(message, str) and '"kind":"state"' in message[:20]:
            return json.loads(message)


def said(served, words, times=1):
    """Wait for a line of the log, or several."""
    until = time.monotonic() + 120.0
    while time.monotonic() < until:
        lines = [line for line in served.said if words in line]
        if len(lines) >= times:
            return lines
        time.sleep(0.02)
    raise AssertionError(f"{words!r} was never said: {served.said[-5:]}")


@pytest.fixture(scope="module")
def playing(serving, recording):
    with serving(recording) as served:
        yield served


def test_what_the_page_needs_is_served_packed_and_guarded(playing):
    answer, body = get(playing, "/")
    assert answer.status == 200
    assert b"RRINS" in body
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    plain, _ = get(playing, "/main.js")
    packed, body = get(playing, "/main.js", Accept_Encoding="gzip")
    assert plain.headers["Content-Encoding"] is None
    assert packed.headers["Content-Encoding"] == "gzip"
    assert body[:2] == b"\x1f\x8b"


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../etc/passwd",
        "/..%2f..%2f..%2fetc/passwd",
        "/%2e%2e/%2e%2e/server.py",
        "/carried/../../server.py",
        "/carried//three.core.min.js",
        "//etc/passwd",
        "/carried/LICENSE.three%00.js",
        "/server.py",
        "/index.html%00",
        "/feed",
        "/main.js?x=/etc/passwd%0d%0aInjected:%20yes",
    ],
)
def test_tricks_with_paths_find_nothing(playing, path):
    answer, body = get(playing, path)
    if path.startswith("/main.js?"):
        assert answer.status == 200
    else:
        assert answer.status == 404
        assert body == b"there is no such file\n"
    assert "Injected" not in answer.headers


def test_a_name_that_others_let_point_here_is_refused(playing):
    answer, body = get(playing, "/", Host="evil.example:80")
    assert (answer.status, body) == (421, b"not here\n")
    assert said(playing, "evil.example") == ["rrins: '/' refused: Host 'evil.example:80'"]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_the_socket_is_refused_to_pages_of_others(playing, origin):
    with pytest.raises(InvalidStatus, match="403"):
        feed(playing, origin)
    said(playing, f"socket refused: Origin '{origin}'")


@pytest.mark.parametrize("sent", ["", "GET / HTTP/1.1\r\nHost:"])
def test_a_request_that_does_not_become_whole_is_closed(monkeypatch, sent):
    monkeypatch.setattr(patience, "INCOMPLETE_S", 0.1)

    async def run():
        config, served = uvicorn.Config("none:none", log_config=None), ServerState()
        config.loaded, config.loaded_app = True, None  # no request ever gets there
        server = await asyncio.get_running_loop().create_server(
            lambda: patience.PatientProtocol(config, served, {}), "127.0.0.1", 0
        )
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        writer.write(sent.encode())
        octets = await reader.read()  # until it is closed
        writer.close()
        server.close()
        return octets

    assert asyncio.run(run()) == b""


def test_ten_thousand_messages_that_are_no_orders(playing):
    wrong = ["", "{", "[]", '{"id": 1}', "\x00" * 100, "x" * 4000, '{"id":1,"order":"' + "a" * 99]
    for _ in range(20):
        messages = [wrong[k % len(wrong)] if k % 9 else b"\xff\xfe" for k in range(500)]
        with feed(playing) as client, pytest.raises(ConnectionClosed):
            send_until_closed(client, messages)
    lines = said(playing, "a message refused")
    assert len(lines) <= AT_ONCE + 200  # a burst, then one a second
    assert not any("Traceback" in line for line in playing.said)
    with feed(playing) as client:
        assert answer_to(client, order="pause")["is_done"]
        assert answer_to(client, order="play")["is_done"]


def test_a_message_that_is_too_long_ends_the_connection(playing):
    with feed(playing) as client, pytest.raises(ConnectionClosed):
        send_until_closed(client, ["x" * 1_000_000])
    assert get(playing, "/")[0].status == 200


def test_an_order_that_is_not_for_a_recording_is_refused(playing):
    with feed(playing) as client:
        answer = answer_to(client, order="inject", fault={"kind": "cut"})
    assert answer["is_done"] is False
    assert answer["text"] == "inject: not for this source"


def test_elsewhere_only_a_page_with_the_token_gives_orders(serving, recording):
    with serving(recording, "--host", "0.0.0.0") as served:
        token = urlsplit(served.url).fragment
        served.url = served.url.replace("0.0.0.0", "127.0.0.1")
        for query in ("", "?token=wrong"):
            with feed(served, query=query) as client:
                hello = json.loads(client.recv(timeout=120.0))
                assert (hello["may_control"], hello["orders"]) == (False, [])
                answer = answer_to(client, order="pause")
                assert (answer["is_done"], answer["text"]) == (False, "this page may only look on")
        assert len(said(served, "order pause refused", times=2)) == 2
        with feed(served, query=f"?token={token}") as client:
            assert answer_to(client, order="pause")["is_done"]
        assert not any(token in line for line in served.said[1:])
        with contextlib.ExitStack() as stack:  # those without fill what they may have
            for _ in range(MOST_BROWSERS - KEPT):
                json.loads(stack.enter_context(feed(served)).recv(timeout=120.0))
            with pytest.raises(InvalidStatus, match="403"):
                feed(served)
            with feed(served, query=f"?token={token}") as client:
                assert answer_to(client, order="play")["is_done"]


def test_a_playback_goes_where_it_is_told(playing):
    with feed(playing) as client:
        hello = json.loads(client.recv(timeout=120.0))
        assert hello["last_s"] == pytest.approx(62, abs=0.5)
        assert answer_to(client, order="pause")["is_done"]
        for wanted_s in (50.0, 12.0, 30.5):
            assert seek(client, wanted_s)["text"] == f"at {wanted_s:.2f} s"
            errors = {label: count for _, label, _, _, count, *_ in state(client)["messages"]}
            assert errors["SYNC"] == 0  # each frame was counted once
        assert answer_to(client, order="speed", speed=5)["is_done"]


def test_a_recording_opens_as_it_begins_and_shows_what_is_recent_where_it_is_sought(recording):
    with contextlib.closing(LogSource(recording, clock=lambda: 0.0)) as source:
        view = source.view
        told = view.told(view.state(has_histories=True))
        assert set(told["sensors"]["gyros"]) == {"sound"}
        assert told["troubles"] == []
        assert max(age for *_, age, _, _, _ in told["messages"]) < 0.1
        source.carry_out(Order(id=1, order="seek", time_s=50))
        view.look()
        assert np.isfinite(view.row[NAMES.index("error_east_m")])
        source.carry_out(Order(id=2, order="seek", time_s=0))
        view.look()
        assert np.isnan(view.row[NAMES.index("error_east_m")])


def test_a_browser_that_stops_reading_holds_nobody(rehearsal):
    host, port = address(rehearsal)
    stuck = socket.create_connection((host, port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stuck.sendall(
        f"GET /feed HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: http://{host}:{port}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    with stuck, feed(rehearsal) as one, feed(rehearsal) as other:
        sequences = [sequence for sequence, _ in rows(one, 60)]
        assert sequences == sorted(set(sequences))
        rows(other, 60)


def test_without_its_packages_the_command_says_which(monkeypatch):
    from click.testing import CliRunner

    from rrins.host_tools.cli.main import rrins
    from rrins.host_tools.dashboard import opening

    monkeypatch.setattr(opening, "_NEEDED", ("starlette", "no_such_package"))
    done = CliRunner().invoke(rrins, ["dashboard"])
    assert done.exit_code == 1
    assert "the dashboard needs more packages: pip install no_such_package\n" in done.output


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["no_such_scenario"], 3, "no_such_scenario"),
        (["nothing.blf"], 6, "nothing.blf"),
        (["--channel", "nowhere"], 4, "bus rrins:nowhere: not running"),
        (["--host", "203.0.113.1", "--port", "1"], 1, "--host 203.0.113.1 --port 1: cannot be had"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(start, arguments, status, says):
    running = start("dashboard", "--port", "0", *arguments)
    assert running.finish()[0] == status
    (line,) = [line for line in running.said if line.startswith("rrins: ")]
    assert says in line
