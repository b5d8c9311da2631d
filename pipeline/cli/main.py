"""Entry point of the `runningfix` command."""

from __future__ import annotations

import importlib
import signal
import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial

from pipeline.cli.parser import build_parser

BAD_USAGE = 2
OWN_MODULES = (
    "batch",
    "board",
    "boresight",
    "calibrate",
    "camera",
    "check",
    "demo",
    "detect",
    "doctor",
    "experiment",
    "export",
    "inspect",
    "label",
    "landmarks",
    "match",
    "new",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code (design: 0 done, 1 a fault of the program, 2 usage, 3 input,
    4 tracking, 5 geometry, 6 writing, 7 ran but is not to be used, 130 interrupted).
    """
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        parser = build_parser()
        arguments = parser.parse_args(given)
    except SystemExit as ended:  # --help; mistakes are raised by the parser
        return int(ended.code or 0)
    except (Exception, KeyboardInterrupt) as error:
        return _refused(given, error)
    if arguments.version:
        from importlib.metadata import version

        print(f"runningfix {version('runningfix')}")  # noqa: T201
        return 0
    if arguments.command is None:
        parser.print_help(sys.stderr)
        return BAD_USAGE
    return run(arguments, given, whole_process=argv is None)


def interrupted(argv: Sequence[str] | None = None) -> int:
    """`main` for a command that was interrupted before it was there: said like every interrupt."""
    return _refused(list(sys.argv[1:] if argv is None else argv), KeyboardInterrupt())


def _refused(given: list[str], error: BaseException) -> int:
    """A command line that is none, or that nobody waits for any more."""
    from pipeline.cli.console import Console
    from pipeline.cli.door import mend_streams, through_door

    def fail() -> int:
        raise error

    mend_streams()
    return through_door(given[0] if given else "", fail, Console(as_json="--json" in given))


def run(arguments: Namespace, given: Sequence[str] = (), *, whole_process: bool = False) -> int:
    """The command's action, with whatever goes wrong turned into one message and an exit code.

    `whole_process` says that the process does nothing else, so that its start is the command's.
    """
    from pipeline.cli.console import Console, process_age_s
    from pipeline.cli.door import check_address_space, check_arguments, mend_streams, through_door

    mend_streams()
    if whole_process:
        signal.signal(signal.SIGTERM, _interrupt)  # a scheduler's or a container's end is an interrupt like the user's
    age_s = process_age_s() if whole_process else 0.0
    console = Console(quiet=arguments.quiet, verbose=arguments.verbose, as_json=arguments.json, age_s=age_s)

    def act() -> int:
        check_arguments(list(given))
        check_address_space()
        module = arguments.command if arguments.command in OWN_MODULES else "flights"
        action = partial(importlib.import_module(f"{__package__}.{module}").run, arguments, console)
        code: int = action()
        return code

    return through_door(arguments.command, act, console)


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
