"""How many instructions it takes to import the client, and to start a command of `litegripctl`.

python -m bench.timing.startup [FOLDER of the client, default: of these sources]

Instructions are counted by valgrind in the user's space, so that nothing else on the machine
matters. The interpreter starts without the site's packages (-S), as those of some load much, but
with `site` and what it needs, as every interpreter does. A daemon of
`tests.client.fake_daemon` answers the commands.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.client.fake_daemon import FakeDaemon

ROOT = Path(__file__).parents[2]
IMPORTS = (
    "import json, socket",
    "import litegrip_client",
    "from litegrip_client import LiteGrip",
    "from litegrip_client import LiteGrip; LiteGrip()",
)
COMMANDS = (["stop"], ["state"], ["state", "--json"], ["stop", "--why", "a hand"], ["clients"])
_CTL = "import sys; from litegrip_client.ctl.main import main; sys.exit(main(sys.argv[1:]))"


def instructions(folder: Path, code: str, *arguments: str) -> int:
    """Return how many instructions the code takes in an interpreter of its own."""
    command = [sys.executable, "-S", "-c", f"import site; {code}", *arguments]
    environment = {"PYTHONPATH": sys.argv[1] if len(sys.argv) > 1 else str(ROOT)}
    environment |= {"PYTHONPYCACHEPREFIX": str(folder / "cache")}
    environment |= {"LITEGRIPD_SOCKET": str(folder / "can0.sock"), "PYTHONHASHSEED": "0"}
    environment["PATH"] = os.environ["PATH"]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)  # compiles
    counter = ["valgrind", "--tool=cachegrind", "--cache-sim=no"]
    counter.append("--cachegrind-out-file=/dev/null")
    done = subprocess.run(
        [*counter, *command], env=environment, check=True, capture_output=True, text=True
    )
    found = re.search(r"I +refs: +([\d,]+)", done.stderr)
    if found is None:
        raise RuntimeError(done.stderr)
    return int(found[1].replace(",", ""))


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name, FakeDaemon(Path(name, "can0.sock")) as daemon:
        folder = Path(name)
        latched = {"level": "hold", "generation": 4}
        daemon.handlers["stop"] = lambda _: latched
        daemon.handlers["clients.list"] = lambda _: {"clients": []}
        with FakeDaemon(folder / "can0.stop.sock") as stops:
            stops.handlers["stop"] = lambda _: latched
            _report(folder)


def _report(folder: Path) -> None:
    bare = instructions(folder, "pass")
    with_argparse = instructions(folder, "import argparse")
    print(f"a bare interpreter: {bare / 1e6:.1f} million, with argparse {with_argparse / 1e6:.1f}")
    needed = 0
    for code in IMPORTS:
        own = instructions(folder, code) - bare
        needed = needed or own
        print(f"{own / 1e6:7.1f} million, {own / needed:5.2f} x json and socket: {code}")
    for words in COMMANDS:
        whole = instructions(folder, _CTL, *words)
        print(
            f"{whole / 1e6:7.1f} million, {whole / bare:5.2f} x the interpreter,"
            f" {whole / with_argparse:5.2f} x with argparse: litegripctl {' '.join(words)}"
        )


if __name__ == "__main__":
    main()
