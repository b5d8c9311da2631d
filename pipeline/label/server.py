"""The label page's server: this machine only, no state of its own.

It listens on 127.0.0.1, answers only requests that name it so (a page elsewhere that points a name at this machine is
turned away) and that carry a secret which is in the printed address (another user of this machine knows the port, not
the secret), and changes something only for requests with a header which pages from elsewhere cannot send.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from calibration.foundation.errors import RunningFixError, UsageError
from calibration.foundation.palette import palette
from pipeline.label.session import LabelSession
from pipeline.records import Box

ADDRESS, HEADER, LONGEST_BODY = "127.0.0.1", "X-Runningfix", 1 << 16
PALETTE_HERE = "/* palette */"
PATIENCE_S = 30.0
"""For a request to arrive whole; then its connection ends."""


class LabelServer(ThreadingHTTPServer):
    """The server, and the secret that its requests carry."""

    daemon_threads = True
    token: str

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that goes away early, or never finishes, concerns nobody."""

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{ADDRESS}:{self.server_address[1]}/?token={self.token}"


def page_text() -> str:
    """The label page."""
    page = (resources.files(__package__) / "page.html").read_text(encoding="utf-8")
    return page.replace(PALETTE_HERE, palette())


def label_server(session: LabelSession, *, port: int = 0, page: str | None = None) -> LabelServer:
    """A server of `page` (ours by default) on this machine; `serve_forever` runs it, port 0 takes a free one.

    Raises UsageError where the port is taken.
    """
    shown = (page_text() if page is None else page).encode()

    secret = secrets.token_urlsafe(24)

    class Handler(_Handler):
        work, document, token = session, shown, secret

    try:
        server = LabelServer((ADDRESS, port), Handler)
    except (OSError, OverflowError) as error:
        raise UsageError(
            where="--port", seen=f"{port}: {error}", expected="a free port", advice="leave --port out to take one"
        ) from None
    server.token = secret
    return server


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    work: LabelSession
    document: bytes
    token: str
    protocol_version = "HTTP/1.1"
    timeout = PATIENCE_S

    def do_GET(self) -> None:
        """Page, state, frames, tracks, progress."""
        url = urlsplit(self.path)
        query = {key: values[0] for key, values in parse_qs(url.query).items()}
        if not self._ours(query.get("token", "")):
            self._send(HTTPStatus.FORBIDDEN, b"this page needs the address that runningfix label printed", "text/plain")
        elif url.path == "/":
            self._send(HTTPStatus.OK, self.document, "text/html; charset=utf-8")
        elif url.path == "/frame":
            self._frame(query.get("camera", ""), _whole(query.get("index")))
        else:
            self._answer(lambda: self._look(url.path, query))

    def _frame(self, camera: str, index: int) -> None:
        try:
            picture = self.work.frame_jpeg(camera, index)
        except Exception:  # of a library, about a broken video: this picture is missing, the page goes on
            picture = None
        found = HTTPStatus.NOT_FOUND if picture is None else HTTPStatus.OK
        self._send(found, picture or b"", "image/jpeg", cache="private, max-age=3600")

    def do_POST(self) -> None:
        """Changes, as JSON."""
        length = _whole(self.headers.get("Content-Length"))
        if not self._ours(self.headers.get(HEADER, "")) or not 0 <= length <= LONGEST_BODY:
            self.close_connection = True
            self._send(HTTPStatus.FORBIDDEN, b"not from this page", "text/plain")
            return
        body = self.rfile.read(length)
        self._answer(lambda: self._change(body))

    def _look(self, path: str, query: Mapping[str, str]) -> Any:
        if path == "/state":
            return self.work.state()
        if path == "/tracks":
            return self.work.tracks(query.get("camera", ""))
        if path == "/progress":
            return self.work.progress(_whole(query.get("after")))
        return None

    def _change(self, body: bytes) -> Any:
        try:
            asked = json.loads(body)
            act, target, camera = asked["act"], str(asked.get("target", "")), str(asked.get("camera", ""))
            json.dumps(asked, ensure_ascii=False).encode()  # half a character of JSON's is no text
            if act == "set":
                x, y, width, height = (float(v) for v in asked["box"])
                box = Box(frame=int(asked["frame"]), x=x, y=y, width=width, height=height)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            raise _unreadable() from None
        if act == "set":
            self.work.set_box(target, camera, box)
        elif act == "delete":
            self.work.delete_box(target, camera)
        elif act == "swap":
            self.work.swap(camera, target, str(asked.get("with", "")))
        elif act == "track":
            self.work.start_tracking()
        else:
            raise _unreadable()
        return self.work.state()

    def _answer(self, make: Any) -> None:
        try:
            found = make()
        except RunningFixError as error:
            self._send(HTTPStatus.BAD_REQUEST, json.dumps({"error": str(error)}).encode(), "application/json")
            return
        except Exception as error:  # a fault of ours is said and ends this request only
            words = f"{type(error).__name__}: {error}"
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, json.dumps({"error": words}).encode(), "application/json")
            return
        status = HTTPStatus.NOT_FOUND if found is None else HTTPStatus.OK
        self._send(status, json.dumps(found).encode(), "application/json")

    def _ours(self, token: str) -> bool:
        """Whether a request names this machine and carries the secret."""
        port = self.connection.getsockname()[1]
        named = self.headers.get("Host", "") in (f"{ADDRESS}:{port}", f"localhost:{port}")
        return named and secrets.compare_digest(token.encode(errors="replace"), self.token.encode())

    def _send(self, status: HTTPStatus, body: bytes, kind: str, cache: str = "no-store") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", cache)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Says nothing: the command line speaks."""


def _whole(text: str | None) -> int:
    try:
        return int(text or "")
    except ValueError:
        return -1


def _unreadable() -> UsageError:
    return UsageError(
        where="label page", seen="a request that cannot be read", expected="act, target, camera", advice="reload"
    )
