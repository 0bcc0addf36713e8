"""Runs router, gateway and portal as processes of their own, with certificates of their own."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tests.process.daemon_process import DEADLINE_S, wait_a_moment

SITE = "lab"
HOST = "127.0.0.1"
CERTIFICATES = Path(__file__).parents[3] / "etc/zenoh-certificates"


def make_certificates(folder: Path, *names: str) -> Path:
    """Make an authority, if there is none, and certificates."""
    command = ["sh", str(CERTIFICATES), str(folder), *names]
    subprocess.run(command, check=True, capture_output=True, timeout=DEADLINE_S)
    return folder


class Part:
    """A running gateway, portal or router."""

    def __init__(self, folder: Path, kind: str, config: str, **environment: str) -> None:
        self.kind = kind
        folder.mkdir(exist_ok=True)
        self.log_path = folder / f"{kind}.log"
        self.config_path = folder / f"{kind}.toml"
        self.config_path.write_text(config, encoding="utf-8")
        self._environment = {**os.environ, **environment}
        self.process = self._start()

    def _start(self) -> "subprocess.Popen[bytes]":
        command = ["-m", "litegrip_fleet", "--config", str(self.config_path), self.kind]
        with self.log_path.open("wb") as file:
            return subprocess.Popen(
                [sys.executable, "-X", "faulthandler", *command],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                env=self._environment,
            )

    @property
    def log(self) -> str:
        return self.log_path.read_text(encoding="utf-8")

    def until_says(self, text: str) -> None:
        """Wait until the log has a text."""
        ends_s = time.monotonic() + DEADLINE_S
        while text not in self.log:
            assert self.process.poll() is None, f"the {self.kind} has ended: {self.log}"
            assert time.monotonic() < ends_s, f"the {self.kind} does not say {text!r}: {self.log}"
            wait_a_moment(self.process)

    def until_exists(self, path: Path) -> None:
        ends_s = time.monotonic() + DEADLINE_S
        while not path.exists():
            assert self.process.poll() is None, f"the {self.kind} has ended: {self.log}"
            assert time.monotonic() < ends_s, f"there is no {path}: {self.log}"
            wait_a_moment(self.process)

    def restart(self) -> None:
        """Kill it, and start another one."""
        self.kill()
        self.process = self._start()

    def freeze(self) -> None:
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        self.process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """End it as an operator would."""
        self.process.send_signal(signal.SIGTERM)
        try:
            code = self.process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self.process.send_signal(signal.SIGABRT)  # it then says where it hangs
            code = self.process.wait(DEADLINE_S)
        assert code == 0, f"{self.kind}: {self.log}"

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


class Fleet:
    """Router, gateway and portal; `short` is where their sockets are."""

    def __init__(self, folder: Path, short: Path, certificates: Path) -> None:
        self.folder = folder
        self.short = short
        self.certificates = certificates
        self.parts: dict[str, Part] = {}
        self.endpoint = ""

    @property
    def router(self) -> Part:
        return self.parts["router"]

    @property
    def gateway(self) -> Part:
        return self.parts["gateway"]

    @property
    def portal(self) -> Part:
        return self.parts["portal"]

    def socket_path(self, gripper: str = "left") -> Path:
        return self.short / "portal" / f"{SITE}.{gripper}.sock"

    def network(self, name: str, connect: Sequence[str]) -> str:
        own = self.certificates / name
        return (
            f'[network]\nconnect = {list(connect)}\nca = "{own}/ca.pem"\n'
            f'certificate = "{own}/own.pem"\nkey = "{own}/own.key"\n'
        )

    def start_router(self, users: Mapping[str, str], grippers: Sequence[str]) -> None:
        """Start the router at a port that is free; whoever else takes it first is not met here."""
        self.endpoint = f"tls/{HOST}:{_free_port()}"
        lines = [f'listen = ["{self.endpoint}"]', "[router.users]"]
        lines += [f'{user} = "{role}"' for user, role in users.items()]
        lines += ["[router.gateways]", f"robot1 = {[f'{SITE}.{name}' for name in grippers]}"]
        config = self.network(HOST, []) + "[router]\n" + "\n".join(lines) + "\n"
        self.parts["router"] = Part(self.folder, "router", config)
        self.router.until_says("listening at")

    def start_gateway(self, sockets: Mapping[str, Path]) -> None:
        """Start the gateway of daemons, by their names on the network and their sockets."""
        directory = self.short / "litegripd"
        directory.mkdir(exist_ok=True)
        lines = [f'site = "{SITE}"', "[gateway.grippers]"]
        for name, path in sockets.items():
            channel = f"{name}-{os.getpid()}"
            for ending in (".sock", ".stop.sock"):
                (directory / f"{channel}{ending}").symlink_to(path.with_suffix(ending))
            lines.append(f'{name} = "{channel}"')
        config = self.network("robot1", [self.endpoint]) + "[gateway]\n" + "\n".join(lines) + "\n"
        self.parts["gateway"] = Part(
            self.folder, "gateway", config, XDG_RUNTIME_DIR=str(self.short)
        )

    def start_portal(self, user: str, role: str, grippers: Sequence[str], ttl_s: float) -> None:
        directory = self.short / "portal"
        directory.mkdir(exist_ok=True)
        places = [f"{SITE}.{name}" for name in grippers]
        config = self.network(user, [self.endpoint]) + (
            f'[portal]\nuser = "{user}"\nrole = "{role}"\ngrippers = {places}\n'
            f'ttl_s = {ttl_s}\ndirectory = "{directory}"\n'
        )
        self.parts["portal"] = Part(self.folder, "portal", config)
        for name in grippers:
            self.portal.until_exists(self.socket_path(name).with_suffix(".stop.sock"))


@contextlib.contextmanager
def fleet(
    folder: Path,
    certificates: Path,
    sockets: Mapping[str, Path],
    *,
    user: str = "op1",
    role: str = "operator",
    users: Mapping[str, str] | None = None,
    ttl_s: float = 5.0,
) -> Iterator[Fleet]:
    """Run all three; whatever still runs at the end has to end as it should."""
    folder.mkdir(exist_ok=True)
    short = Path(tempfile.mkdtemp(prefix="fleet-"))  # a socket's path has 107 bytes at most
    made = Fleet(folder, short, certificates)
    try:
        made.start_router(users or {user: role}, list(sockets))
        made.start_gateway(sockets)
        made.start_portal(user, role, list(sockets), ttl_s)
        for name in sockets:
            made.gateway.until_says(f"{SITE}.{name}: ")
        yield made
        for kind in ("portal", "gateway", "router"):
            if made.parts[kind].process.poll() is None:
                made.parts[kind].end()
    except BaseException:
        for part in made.parts.values():
            print(f"--- {part.kind}\n{part.log}")
        raise
    finally:
        for part in made.parts.values():
            part.kill()
        shutil.rmtree(short)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind((HOST, 0))
        return int(found.getsockname()[1])
