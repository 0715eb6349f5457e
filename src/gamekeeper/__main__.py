"""`python -m gamekeeper` is the command line."""

import sys

if not sys.flags.safe_path and __name__ == "__main__":
    del sys.path[0]  # the current folder, which the command `gamekeeper` doesn't look in either

from gamekeeper.cli import main

if __name__ == "__main__":
    sys.exit(main())
