"""Serve one page to browsers on this machine until Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from aerobat_pin.files import raising

LOCALHOST = "127.0.0.1"


def serve(page: str, announce: Callable[[str], None]) -> None:
    """Serve a page on a free port until Ctrl-C; only browsers on this machine can open it.

    Args:
        page: HTML of the page.
        announce: called with the address as soon as the page can be opened.
    """
    content = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path not in ("/", "/favicon.ico"):
                self.send_error(404)
                return
            body = content if self.path == "/" else b""
            self.send_response(200 if body else 204)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:
            """Print nothing."""

    with ThreadingHTTPServer((LOCALHOST, 0), Handler) as server:
        server.daemon_threads, server.block_on_close = True, False
        announce(f"http://{LOCALHOST}:{server.server_address[1]}/")
        with suppress(KeyboardInterrupt), raising():
            server.serve_forever()
