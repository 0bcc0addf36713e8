"""The former place of `litegrip_client.values.trajectory`, until 0.3."""

from litegrip_client.values.trajectory import *  # noqa: F403
