"""`python -m twin.cli` is `qpal`."""

import sys

from twin.cli import main

sys.exit(main())
