"""`runningfix label`: boxes drawn in a web page of this machine."""

from __future__ import annotations

import webbrowser
from argparse import Namespace

from pipeline.cli.console import Console
from pipeline.label import LabelSession, label_server


def run(arguments: Namespace, console: Console) -> int:
    """Serves the page until it is interrupted."""
    session = LabelSession(arguments.flight, arguments.output)
    server = label_server(session, port=arguments.port)
    address = server.address
    before = arguments.flight.read_bytes()
    console.say(f"label page at {address} (this machine only); end with Ctrl-C")
    if not arguments.no_browser:
        webbrowser.open(address)
    try:
        server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()
        session.close()
    changed = arguments.flight.read_bytes() != before
    files = [str(arguments.flight)] if changed else []
    summary = {"status": "done", "command": "label", "address": address, "warnings": [], "files": files}
    console.result(summary, f"{arguments.flight} {'changed' if changed else 'unchanged'}")
    return 0
