from tests.sdk.conftest import daemon, home, mount, site
from tests.sdk.readme.conftest import gripper

__all__ = ["daemon", "gripper", "home", "mount", "site"]
