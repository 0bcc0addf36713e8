from tests.sdk_compat.conftest import daemon, gripper, home, mount, site

__all__ = ["daemon", "gripper", "home", "mount", "site"]
