"""Serve one page to browsers on this machine until Ctrl-C."""

from __future__ import annotations

import signal
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from aerobat_pin.errors import OutputError, until_signal

LOCALHOST = "127.0.0.1"
MOST_OPEN = 64  # connections: a further one closes the oldest, so that idle ones do not use up what a process may open
WAKE_PERIOD = 0.5  # [s] after which it is seen at the latest that a signal came
WAITING = 512  # connections that can wait to be accepted; further ones would be delayed by seconds


class _Server(ThreadingHTTPServer):
    daemon_threads, block_on_close, request_queue_size, timeout = True, False, WAITING, WAKE_PERIOD

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._open: deque[socket.socket] = deque()

    def process_request(self, request: Any, client_address: Any) -> None:
        self._open.append(request)
        if len(self._open) > MOST_OPEN:
            with suppress(OSError):  # it is closed already
                self._open.popleft().shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a browser may leave in the middle of the page."""


def serve(page: str, announce: Callable[[str], None], port: int = 0) -> None:
    """Serve a page until Ctrl-C, to requests from this machine that name it: a foreign site's name may lead here too.

    Args:
        page: HTML of the page.
        announce: called with the address as soon as the page can be opened.
        port: port of this machine; 0 takes a free one. OutputError if it is taken, or not free for this user.
    """
    content = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def setup(self) -> None:
            super().setup()
            # A client that has left ends this thread, and not the program, which SIGPIPE would.
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGPIPE])

        def do_GET(self) -> None:
            asked = [value for name, value in self.headers.items() if name.strip().lower() == "host"]
            if len(asked) != 1 or asked[0] not in hosts:
                self.send_error(403, "this page is served at its own address only")
                return
            if self.path != "/":
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: Any) -> None:
            """Print nothing."""

    try:
        ready = _Server((LOCALHOST, port), Handler)
    except OSError as error:
        raise OutputError(f"play: --port {port}: {error.strerror}; another port, or none, was expected") from error
    with ready as server:
        hosts = [f"{name}:{server.server_address[1]}" for name in (LOCALHOST, "localhost")]
        announce(f"http://{hosts[0]}/")
        until_signal(server.handle_request)
