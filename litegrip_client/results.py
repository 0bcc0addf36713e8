"""The former place of `litegrip_client.values.results`, until 0.3."""

from litegrip_client.values.results import *  # noqa: F403
