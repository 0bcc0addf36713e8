"""Two grippers on two USB adapters: names that stay, a group for each, and a reboot."""


def two_grippers() -> None:
    """Two adapters get their names by their serial numbers."""


def grippers_after_reboot() -> None:
    """After a reboot each has its name."""
