"""The former place of `litegrip_client.core.discovery`, until 0.3."""

from litegrip_client.core.discovery import *  # noqa: F403
from litegrip_client.core.sockets import *  # noqa: F403
