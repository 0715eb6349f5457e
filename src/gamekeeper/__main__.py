"""`python -m gamekeeper` is the command line."""

import sys

from gamekeeper.cli import main

if __name__ == "__main__":
    sys.exit(main())
