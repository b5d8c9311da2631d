"""The command: `runningfix`, or `python -m runningfix`."""

import sys

from pipeline.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
