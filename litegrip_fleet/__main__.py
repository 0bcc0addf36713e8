"""`python -m litegrip_fleet` is the command `litegripd-fleet`."""

import sys

from litegrip_fleet.main import main

if __name__ == "__main__":
    sys.exit(main())
