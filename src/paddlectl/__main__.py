"""`python -m paddlectl` is the command `paddlectl`."""

import sys

from paddlectl.cli.app import main

sys.exit(main())
