"""`python -m heli_twin`."""

import sys

from heli_twin.cli import main

sys.exit(main())
