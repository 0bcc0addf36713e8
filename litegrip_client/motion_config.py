"""The former place of `litegrip_client.values.motion_config`, until 0.3."""

from litegrip_client.values.motion_config import *  # noqa: F403
