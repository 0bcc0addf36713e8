"""A bench in a folder: the daemon in virtual time at a real socket, and doubles of the system.

`litegripctl doctor` and the commands that it prints run on it as on a machine. `ip` is a
double that knows one link, and what a kernel lets happen to it; it answers as was recorded.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import litegrip_client
from litegrip_client.core import discovery, sockets
from litegrip_client.ctl.commands.machine import CHECKS
from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.doctor.facts import User
from litegrip_client.ctl.findings import Finding, findings_of
from litegrip_client.socketcan import link as can_link
from litegrip_client.values.atomic_file import Shortage
from litegripd.app.build import motor_figures
from litegripd.app.config import Config
from litegripd.app.status import DaemonFacts
from litegripd.model.motor import BusSettings
from litegripd.model.sentence import with_terms
from tests.app.test_facts import judged
from tests.client.doctor.known import LINKS
from tests.client.fake_daemon import FakeDaemon, Request
from tests.world import Client, World

ROOT = Path(__file__).resolve().parents[2]
SETTLED_S = 1.5
_access = os.access

IP = """#!{python} -IS
import json, sys
words = [word for word in sys.argv[1:] if not word.startswith("-")]
try:
    with open({file!r}) as file:
        link = json.load(file)
except FileNotFoundError:
    sys.exit(f'Device "{{words[2]}}" does not exist.')
if words[:2] == ["link", "show"]:
    sys.exit(print(json.dumps([link])))
name, words = words[2], words[3:]
data, flags = link["linkinfo"].get("info_data", {{}}), link["flags"]
heals = "up" in words or "termination" in words
while words:
    word = words.pop(0)
    if word == "down":
        flags[:] = [flag for flag in flags if flag not in ("UP", "LOWER_UP")]
        data["state"] = "STOPPED"
    elif word == "up":
        flags.append("UP")
    elif word == "txqueuelen":
        link["txqlen"] = int(words.pop(0))
    elif word == "type":
        words.pop(0)
        if words[0] != "termination" and data.get("state") not in ("STOPPED", None):
            sys.exit("RTNETLINK answers: Device or resource busy")
    elif word == "bitrate":
        data["bittiming"] = {{"bitrate": int(words.pop(0)), "sample_point": "0.750"}}
    elif word == "sample-point":
        data["bittiming"]["sample_point"] = f"{{float(words.pop(0)):.3f}}"
    elif word == "termination":
        data["termination"] = int(words.pop(0))
    elif word == "restart-ms":
        data["restart_ms"] = int(words.pop(0))
    elif words and words[0] in ("on", "off"):
        modes = [mode for mode in data.get("ctrlmode", []) if mode != word.upper()]
        data["ctrlmode"] = modes + [word.upper()] * (words.pop(0) == "on")
        if "FD" not in data["ctrlmode"]:
            link["mtu"] = 16
    else:
        sys.exit(f"the double does not know {{word}}")
if heals and "UP" in flags and data:
    if not data.get("bittiming", {{}}).get("bitrate"):
        sys.exit("RTNETLINK answers: Invalid argument")
    data.update(state="ERROR-ACTIVE", berr_counter={{"tx": 0, "rx": 0}})
with open({file!r}, "w") as file:
    json.dump(link, file)
"""
SUDO = '#!/bin/sh\nexec "$@"\n'
CTL = '#!/bin/sh\ncd {root} && exec {python} -m litegrip_client.ctl.main "$@"\n'
LOGGED = '#!/bin/sh\necho "$0 $*" >> {log}\n'


class Bench:
    """One machine with one gripper; `world` is its daemon, `folder` its root directory."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.programs = folder, folder / "bin"
        self.world = World()
        self.bus = BusSettings("socketcan", "can0", 1_000_000)
        self.control: dict[str, Any] = {"fifo_priority": 50, "memory_locked": True}
        self.stroke_mm = 85.0
        self.mount: str | None = None
        self.user = User("alice", 1000, "litegrip")
        self.told: dict[str, Any] = {}
        self.disks: list[Shortage] = []
        """What the daemon tells in place of what it would, by `part.name`."""
        self.is_closed = False
        """Whether this user may not open the daemon's sockets."""
        self._lock = threading.Lock()
        self._clients: dict[int, Client] = {}
        for name in ("bin", "net", "etc", "run/litegripd"):
            (folder / name).mkdir(parents=True)
        self.put("bin/sudo", SUDO)
        self.put("bin/litegripctl", CTL.format(root=ROOT, python=sys.executable))
        self.put("bin/ip", IP.format(python=sys.executable, file=str(folder / "link")))
        for name in ("networkctl", "nmcli", "systemctl"):
            self.put(f"bin/{name}", LOGGED.format(log=folder / "ran"))
        self.driver("peak_usb")
        self.link("healthy")

    def put(self, name: str, content: str = "") -> Path:
        """Write a file below the root; what lies in bin can be run."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
        path.chmod(0o755)
        return path

    def driver(self, name: str | None) -> None:
        """Let `can0` have a driver; None for one that sysfs does not name."""
        shutil.rmtree(self.folder / "net")
        device = self.folder / "net/can0/device"
        device.mkdir(parents=True)
        (self.folder / "net/can0/type").write_text("280\n")
        (self.folder / "net/can0/flags").write_text("0x40081\n")
        (self.folder / "net/can0/tx_queue_len").write_text("10\n")
        (self.folder / "net/can0/ifindex").write_text("3\n")
        if name is not None:
            (device / "driver").symlink_to(f"/sys/bus/usb/drivers/{name}")

    def link(self, recorded: str, **data: Any) -> None:
        """Let `ip` answer as recorded, but for these members of the controller's data."""
        (told,) = json.loads((LINKS / f"{recorded}.json").read_text(encoding="utf-8"))
        told["ifname"] = "can0"
        told["linkinfo"].setdefault("info_data", {}).update(data)
        self.put("link", json.dumps(told))

    def tell(self, **facts: Any) -> None:
        """Let the daemon tell something else: health_bus={...}, hello_version="1"."""
        self.told.update(facts)

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Let doctor and shells find this bench, and nothing of the machine that it is on."""
        found = partial(gather.system, net=self.folder / "net", root=self.folder)
        units = (str(self.folder / "units"),)
        self.put("units/litegripd@.service")
        with contextlib.ExitStack() as stack:
            for module, name, value in (
                (gather, "system", found),
                (gather, "NET", self.folder / "net"),
                (gather, "DIRECTORY", self.folder / "etc/litegripd"),
                (gather, "user", lambda _group: self.user),
                (os, "access", self._may),
                (can_link, "_ADMIN_PATHS", ()),
                (gather, "shortages", lambda _written: self.disks),
                (discovery, "UNIT_DIRECTORIES", units),
                (discovery, "ENABLED_DIRECTORY", str(self.folder / "enabled")),
                (sockets, "SYSTEM_DIRECTORY", str(self.folder / "run/litegripd")),
            ):
                stack.enter_context(patch.object(module, name, value))
            own = {
                "PATH": str(self.programs),
                "XDG_RUNTIME_DIR": str(self.folder / "run/user/1000"),
            }
            stack.enter_context(patch.dict(os.environ, own))
            for name in ("LITEGRIPD_SOCKET", "LITEGRIP_CHANNEL"):
                os.environ.pop(name, None)
            yield

    @contextlib.contextmanager
    def daemon(self) -> Iterator[None]:
        """Let the daemon serve, at its own socket."""
        with FakeDaemon(self.folder / "run/litegripd/can0.sock") as server:
            server.handlers = _Every(self._answer)
            yield

    def doctor(self, *, scans: bool = False, channel: str | None = "can0") -> dict[str, Finding]:
        """Let the daemon come to rest; return what the doctor finds, by check."""
        with self._lock:
            self.world.run(SETTLED_S)
        facts = gather.gather(channel or "can0", None, channel_chosen=channel is not None)
        if scans:
            facts = replace(facts, scan=gather.scan(facts))
        return dict(findings_of(CHECKS, facts))

    def carry_out(self, command: str) -> None:
        """Run what the doctor has printed in a shell; raises if that fails.

        At a terminal `zero` asks if the jaws may move; here `--yes` says so.
        """
        command = command.replace("litegripctl -c can0 zero", "litegripctl -c can0 zero --yes")
        path = f"{self.programs}:/usr/bin:/bin"
        done = subprocess.run(
            ["/bin/sh", "-ec", command],
            env={**os.environ, "PATH": path, "LITEGRIPD_SOCKET": self._socket},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, (command, done.stdout, done.stderr)

    def _may(self, path: str | os.PathLike[str], mode: int) -> bool:
        is_closed = self.is_closed and str(path).endswith(".sock")
        return not is_closed and _access(path, mode)

    @property
    def _socket(self) -> str:
        return str(self.folder / "run/litegripd/can0.sock")

    def shown(self, text: str) -> str:
        """Return a text of the doctor as a machine would show it, without this folder."""
        own = ((str(self.folder), ""), ("-c can0 ", ""), (litegrip_client.__version__, "1.2.3"))
        for found, shown in own:
            text = text.replace(found, shown)
        return text

    def _facts(self) -> DaemonFacts:
        config = Config("can0", self.bus)
        gripper = replace(config.gripper, stroke_mm=self.stroke_mm, mount=self.mount)
        config = replace(config, gripper=gripper)
        return judged(self.world, config=config, figures=self._figures)

    def _figures(self, uptime_s: float, _machine: object) -> Mapping[str, Any]:
        machine, condition = self.world.machine, self.world.condition
        bus = {"state": condition.state, "error": condition.error, "load": 0.1, "send_failures": 0}
        return {
            "uptime_s": uptime_s,
            "control": self.control,
            "bus": bus,
            "motor": motor_figures(machine),
            "teleop": {},
        }

    def _answer(self, request: Request) -> None:
        params = {k: v for k, v in request.params.items() if k not in ("sent_s", "stop_generation")}
        with self._lock:
            peer = id(request._peer)
            client = self._clients.setdefault(peer, self.world.client())
            answer = client.call(request.method, within_s=120.0, **params)
            if "result" in answer and request.method in ("hello", "info.get", "health"):
                part = request.method.partition(".")[0]
                facts = self._facts()
                own = facts.health(self.world.now_s) if part == "health" else getattr(facts, part)()
                told = {
                    name.partition("_")[2]: value
                    for name, value in self.told.items()
                    if name.startswith(f"{part}_")
                }
                answer["result"] = with_terms({**answer["result"], **own, **told})
        request.send({**answer, "id": request.identity})


class _Every(dict[str, Callable[[Request], None]]):
    """Has one handler for all methods."""

    def __init__(self, handler: Callable[[Request], None]) -> None:
        super().__init__()
        self._handler = handler

    def get(self, _method: str, _default: object = None) -> Callable[[Request], None]:
        return self._handler


@contextlib.contextmanager
def bench() -> Iterator[Bench]:
    """Set a bench up, and take it away."""
    with tempfile.TemporaryDirectory(prefix="bench") as folder:
        made = Bench(Path(folder))
        with made.running():
            yield made
