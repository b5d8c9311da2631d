"""Entry point of the `runningfix` command."""

from __future__ import annotations

import importlib
import sys
from argparse import Namespace
from collections.abc import Sequence

from calibration.foundation.errors import RunningFixError
from pipeline.cli.parser import build_parser

BAD_USAGE = 2
INTERRUPTED = 130
OWN_MODULES = ("board", "boresight", "calibrate", "camera", "demo", "detect", "experiment", "inspect", "label")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code (design: 0 done, 2 usage, 3 input, 4 tracking, 5 geometry, 6 writing,
    7 ran but did not converge).
    """
    parser = build_parser()
    arguments = parser.parse_args(argv)
    if arguments.version:
        from importlib.metadata import version

        print(f"runningfix {version('runningfix')}")  # noqa: T201
        return 0
    if arguments.command is None:
        parser.print_help(sys.stderr)
        return BAD_USAGE
    return run(arguments)


def run(arguments: Namespace) -> int:
    """The command's action, with every user's mistake turned into one message and an exit code."""
    from pipeline.cli.console import Console

    console = Console(quiet=arguments.quiet, verbose=arguments.verbose, as_json=arguments.json)
    module = arguments.command if arguments.command in OWN_MODULES else "flights"
    try:
        action = importlib.import_module(f"pipeline.cli.{module}")
        code: int = action.run(arguments, console)
    except RunningFixError as error:
        console.error(str(error))
        if arguments.json:
            console.result(failure(arguments.command, error), "")
        return error.exit_code
    except KeyboardInterrupt:
        console.error("interrupted; what is finished is kept, the same command goes on from there")
        return INTERRUPTED
    return code


def failure(command: str, error: RunningFixError) -> dict[str, object]:
    """The machine-readable form of a mistake."""
    return {
        "status": "error",
        "command": command,
        "exit_code": error.exit_code,
        "error": {"where": error.where, "seen": error.seen, "expected": error.expected, "advice": error.advice},
    }


if __name__ == "__main__":
    sys.exit(main())
