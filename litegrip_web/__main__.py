"""Runs `litegripd-web` as a module: python -m litegrip_web."""

import sys

from litegrip_web.main import main

if __name__ == "__main__":
    sys.exit(main())
