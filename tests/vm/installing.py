"""Installation by the words of the documentation and of what it has one run."""

from tests.vm.emulated import Emulated
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, Unit, install_units, must

ONE = "ONE"


def installed() -> Emulated:
    """Have a daemon for can0 that runs, and its adapter plugged in; return that."""
    adapter = Emulated(ONE)
    adapter.start()
    if CONFIGURATION.exists():  # by a scene before, which may have left it stopped
        Unit().start()
        return adapter
    must("useradd", "--create-home", "alice")
    CONFIGURATION.parent.mkdir(exist_ok=True)
    CONFIGURATION.write_text(SLOW)
    must("ln", "-s", f"{PROGRAMS}/litegripctl", "/usr/local/bin/")
    install_units("alice", "can0")
    return adapter
