"""Installation by the words of the documentation and of what it has one run."""

from tests.vm.emulated import Emulated
from tests.vm.guest import check
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, Unit, must, typed

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


def install_units(user: str, *channels: str) -> None:
    """Run it for these channels, and then what it prints, word for word."""
    options = [option for channel in channels for option in ("--can", channel)]
    out = must(f"{PROGRAMS}/litegripctl", "install-units", *options)
    print(out, flush=True)
    following = out.partition("next, as root:\n")[2].splitlines()
    for line in following:
        if line.startswith("note: "):
            continue
        status, said = typed(line.strip().replace("USER", user))
        check(f"typed as printed: {line.strip()}", status == 0, said)
