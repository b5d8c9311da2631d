"""`python -m pipeline` is `runningfix`."""

import sys

try:
    from pipeline.cli.main import main
except KeyboardInterrupt:  # while it was being loaded
    from pipeline.cli.main import interrupted as main

if __name__ == "__main__":
    sys.exit(main())
