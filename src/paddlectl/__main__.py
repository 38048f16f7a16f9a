"""`python -m paddlectl` is the command `paddlectl`."""

import sys

from paddlectl.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
