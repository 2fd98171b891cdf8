"""`python -m entrack`."""

import sys

from entrack.cli.app import main

sys.exit(main())
