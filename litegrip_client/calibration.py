"""The former place of `litegrip_client.values.calibration`, until 0.3."""

from litegrip_client.values.calibration import *  # noqa: F403
