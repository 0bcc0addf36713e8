"""Run `litegripctl` as `python -m litegrip_client.ctl`."""

import sys

from litegrip_client.ctl.main import main

sys.exit(main())
