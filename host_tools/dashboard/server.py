"""The server: the page, its socket, nothing else."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Final
from urllib.parse import parse_qs

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rrins.host_tools.dashboard.browsers import Browser
from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.feed import Feed
from rrins.host_tools.dashboard.guarding import HEADERS, Guard, shown
from rrins.host_tools.dashboard.guides import guide, guide_names
from rrins.host_tools.dashboard.page_files import page_files
from rrins.host_tools.dashboard.page_orders import LONGEST, parse_order
from rrins.host_tools.dashboard.patience import FewLines, PatientProtocol

SOCKET: Final = "/feed"
GUIDES: Final = "/guides/"
MOST_BROWSERS: Final = 32
KEPT: Final = 8
"""Places among them for pages with the token, where there is one."""

MOST_WRONG: Final = 20
"""Wrong messages after which a browser is let go."""

_PATIENCE_S: Final = 30.0  # with a browser that takes nothing
_SWITCH_S: Final = 0.0005
_POLICY, _TRY_LATER, _GOING = 1008, 1013, 1001

_FEW: Final = FewLines()
_log: Final = logging.getLogger("rrins.dashboard")


def application(feed: Feed, guard: Guard) -> ASGIApp:
    """Return the server's application."""
    pages = _pages(feed, guard)

    async def serve_one(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" and scope["path"] == SOCKET:
            await _browse(WebSocket(scope, receive, send), send, feed, guard)
        else:
            await pages(scope, receive, send)

    return serve_one


def _pages(feed: Feed, guard: Guard) -> Starlette:
    """Return the application that serves the files, and runs the feed."""
    files = page_files()

    async def page(request: Request) -> Response:
        path = request.scope["path"]
        why = guard.refuses_host(request.headers.get("host"))
        if why is not None:
            _log.warning("%s refused: %s", shown(path), why)
            return Response("not here\n", 421, HEADERS)
        if path.startswith(GUIDES) and path.removeprefix(GUIDES) in guide_names():
            page = guide(path.removeprefix(GUIDES))
            return Response(page, headers=HEADERS, media_type="text/html")
        file = files.get(path)
        if file is None:
            _log.warning("%s refused: there is no such file", shown(path))
            return Response("there is no such file\n", 404, HEADERS)
        headers = HEADERS | {"Content-Type": file.kind, "Vary": "Accept-Encoding"}
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(file.packed, headers=headers | {"Content-Encoding": "gzip"})
        return Response(file.content, headers=headers)

    @contextlib.asynccontextmanager
    async def feeding(app: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(feed.run())
        task.add_done_callback(_tell_failure)
        try:
            yield
        finally:
            task.cancel()

    return Starlette(routes=[Route("/{path:path}", page)], lifespan=feeding)


def _tell_failure(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and task.exception() is not None:
        _log.error("the feed has failed", exc_info=task.exception())


async def _browse(websocket: WebSocket, send: Send, feed: Feed, guard: Guard) -> None:
    host = websocket.headers.get("host")
    why = guard.refuses_host(host) or guard.refuses_origin(websocket.headers.get("origin"), host)
    token = parse_qs(websocket.url.query).get("token", [None])[0]
    browser = Browser(guard.may_control(token))
    places = MOST_BROWSERS if browser.may_control else MOST_BROWSERS - KEPT
    if why is None and feed.browsers >= places:
        why = f"{places} browsers look on already"
    if why is not None:
        _log.warning("socket refused: %s", why)
        await websocket.close(_POLICY)
        return
    if not browser.may_control and feed.may_control:
        _log.warning("a page without the token may only look on")
    await websocket.accept()
    feed.enter(browser)
    sending = asyncio.create_task(_send(websocket, send, browser))
    try:
        await _receive(websocket, browser, feed)
    finally:
        feed.leave(browser)
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending


async def _send(websocket: WebSocket, send: Send, browser: Browser) -> None:
    """Send what is put into a browser's queue; let it go when it takes nothing for long.

    `send` is the server's own: it is called some thirty times a second for each browser, and the
    layers of Starlette between add nothing to it.
    """
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        while not browser.is_stuck:
            message = await browser.next_message()
            kind = "bytes" if isinstance(message, bytes) else "text"
            try:
                async with asyncio.timeout(_PATIENCE_S):
                    await send({"type": "websocket.send", kind: message})
            except TimeoutError:
                _log.warning("a browser took nothing for %g s and is let go", _PATIENCE_S)
                break
        await websocket.close(_TRY_LATER)


async def _receive(websocket: WebSocket, browser: Browser, feed: Feed) -> None:
    """Take a browser's orders until it leaves, or has sent too much that is none."""
    wrong = 0
    orders: set[asyncio.Task[None]] = set()
    try:
        while wrong < MOST_WRONG:
            received = await websocket.receive()
            if received["type"] == "websocket.disconnect":
                return
            try:
                text = received.get("text")
                if text is None:
                    raise DashboardError("bytes, where an order is JSON")
                order = parse_order(text)
            except DashboardError as error:
                wrong += 1
                _log.warning("a message refused: %s", shown(error))
                continue
            task = asyncio.create_task(feed.carry_out(browser, order))
            orders.add(task)
            task.add_done_callback(orders.discard)
            if len(orders) > MOST_WRONG:
                _log.warning("a browser gave too many orders at once and is let go")
                break
        if websocket.application_state is not WebSocketState.DISCONNECTED:
            with contextlib.suppress(RuntimeError):
                await websocket.close(_POLICY)
    except WebSocketDisconnect:
        return


def bound(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Raises
    ------
    DashboardError
        When the address cannot be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        raise DashboardError(
            f"--host {host} --port {port}: cannot be had: {error.strerror or error}; "
            "name another --port"
        ) from error
    return listening


def url_of(listening: socket.socket, guard: Guard) -> str:
    """Return the address of the page; the token stands where browsers do not send it."""
    host, port = listening.getsockname()[:2]
    host = f"[{host}]" if ":" in host else host
    token = "" if guard.token is None else f"#{guard.token}"
    return f"http://{host}:{port}/{token}"


class _Server(uvicorn.Server):
    """A server that leaves signals to the command."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the signals alone."""
        yield


def serve(
    feed: Feed, guard: Guard, listening: socket.socket, on_serving: Callable[[], None]
) -> None:
    """Serve until SIGINT or SIGTERM, which are the end that is meant for it."""
    server = _server(feed, guard)

    def stop() -> None:
        server.should_exit = True

    async def run() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stop)
        on_serving()
        await server.serve(sockets=[listening])

    with _quick_switches():
        asyncio.run(run())


@contextlib.contextmanager
def serving(feed: Feed, guard: Guard, listening: socket.socket) -> Iterator[None]:
    """Serve in a thread until the block ends."""
    server = _server(feed, guard)
    thread = threading.Thread(
        target=lambda: asyncio.run(server.serve(sockets=[listening])),
        name="dashboard",
        daemon=True,
    )
    with _quick_switches():
        thread.start()
        try:
            yield
        finally:
            server.should_exit = True
            thread.join()


@contextlib.contextmanager
def _quick_switches() -> Iterator[None]:
    """Let threads take turns more often: frames are received while the same interpreter serves."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def _server(feed: Feed, guard: Guard) -> _Server:
    for log in (_log, logging.getLogger("uvicorn.error")):
        log.addFilter(_FEW)
    config = uvicorn.Config(
        application(feed, guard),
        http=PatientProtocol,
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        ws="websockets-sansio",
        ws_max_size=LONGEST,
        ws_per_message_deflate=False,
        ws_max_queue=8,
        timeout_graceful_shutdown=1,
        lifespan="on",
    )
    return _Server(config)
