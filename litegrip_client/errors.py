"""The former place of `litegrip_client.values.errors`, until 0.3."""

from litegrip_client.values.errors import *  # noqa: F403
