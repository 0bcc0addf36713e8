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
from typing import Any

from tests.process.daemon_process import DEADLINE_S, Client, wait_a_moment

SITE = "lab"
HOST = "127.0.0.1"
CERTIFICATES = Path(__file__).parents[3] / "etc/zenoh-certificates"


def make_certificates(folder: Path, *names: str) -> Path:
    """Make an authority, if there is none, and certificates."""
    command = ["sh", str(CERTIFICATES), str(folder), *names]
    subprocess.run(command, check=True, capture_output=True, timeout=3 * DEADLINE_S)
    return folder


class Part:
    """A running gateway, portal or router; `on` makes its command run on another machine."""

    def __init__(
        self,
        folder: Path,
        kind: str,
        name: str,
        config: str,
        on: Sequence[str] = (),
        **environment: str,
    ) -> None:
        self.kind = kind
        folder.mkdir(exist_ok=True)
        self.log_path = folder / f"{name}.log"
        self.config_path = folder / f"{name}.toml"
        self.config_path.write_text(config, encoding="utf-8")
        self._on = on
        self._environment = {**os.environ, **environment}
        self.process = self._start()

    def _start(self) -> "subprocess.Popen[bytes]":
        command = ["-m", "litegrip_fleet", "--config", str(self.config_path), self.kind]
        with self.log_path.open("wb") as file:
            return subprocess.Popen(
                [*self._on, sys.executable, "-X", "faulthandler", *command],
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
        """Stop it; when this returns, none of its threads does anything any more."""
        self.process.send_signal(signal.SIGSTOP)
        ends_s = time.monotonic() + DEADLINE_S
        while not self._is_stopped():
            assert time.monotonic() < ends_s, f"the {self.kind} does not stop"

    def _is_stopped(self) -> bool:
        tasks = Path(f"/proc/{self.process.pid}/task").iterdir()
        stats = [(task / "stat").read_text(encoding="ascii") for task in tasks]
        return all(stat.rpartition(")")[2].split()[0] == "T" for stat in stats)

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
    """Router, gateways and portals, by name; `short` is where their sockets are.

    `host` is the router's, `on` says by which commands parts run on other machines (by name).
    """

    def __init__(
        self,
        folder: Path,
        short: Path,
        certificates: Path,
        host: str = HOST,
        on: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self.folder = folder
        self.short = short
        self.certificates = certificates
        self.parts: dict[str, Part] = {}
        self.endpoint = ""
        self.grippers: Sequence[str] = ()
        self._host = host
        self._on = on or {}

    @property
    def router(self) -> Part:
        return self.parts["router"]

    @property
    def gateway(self) -> Part:
        return self.parts["gateway"]

    @property
    def portal(self) -> Part:
        return self.parts["portal"]

    def runtime_directory(self, portal: str = "portal") -> Path:
        """Return the XDG_RUNTIME_DIR of clients that are to find a portal's grippers by name."""
        return self.short / portal

    def socket_path(self, gripper: str = "left", portal: str = "portal") -> Path:
        return self.runtime_directory(portal) / "litegripd" / f"{SITE}.{gripper}.sock"

    def network(self, name: str, connect: Sequence[str]) -> str:
        own = self.certificates / name
        return (
            f'[network]\nconnect = {list(connect)}\nca = "{own}/ca.pem"\n'
            f'certificate = "{own}/own.pem"\nkey = "{own}/own.key"\n'
        )

    def start_router(self, users: Mapping[str, str], gateways: Mapping[str, Sequence[str]]) -> None:
        """Start the router at a port that is free; whoever else takes it first is not met here."""
        self.endpoint = f"tls/{self._host}:{_free_port()}"
        lines = [f'listen = ["{self.endpoint}"]', "[router.users]"]
        lines += [f'{user} = "{role}"' for user, role in users.items()]
        lines += ["[router.gateways]"]
        lines += [f"{name} = {[f'{SITE}.{one}' for one in own]}" for name, own in gateways.items()]
        config = self.network(self._host, []) + "[router]\n" + "\n".join(lines) + "\n"
        self._start("router", "router", config)
        self.router.until_says("listening at")

    def start_gateway(
        self,
        sockets: Mapping[str, Path],
        gateway: str = "robot1",
        name: str = "gateway",
        options: str = "",
    ) -> None:
        """Start the gateway of daemons, by their names on the network and their sockets.

        `options` are more lines of its table.
        """
        directory = self.short / "litegripd"
        directory.mkdir(exist_ok=True)
        lines = [f'site = "{SITE}"', options, "[gateway.grippers]"]
        for gripper, path in sockets.items():
            channel = f"{gripper}-{os.getpid()}"
            for ending in (".sock", ".stop.sock"):
                (directory / f"{channel}{ending}").symlink_to(path.with_suffix(ending))
            lines.append(f'{gripper} = "{channel}"')
        config = self.network(gateway, [self.endpoint]) + "[gateway]\n" + "\n".join(lines) + "\n"
        self._start("gateway", name, config, XDG_RUNTIME_DIR=str(self.short))

    def start_portal(
        self, user: str, role: str, grippers: Sequence[str], ttl_s: float, name: str = "portal"
    ) -> None:
        directory = self.socket_path(portal=name).parent
        directory.mkdir(parents=True, exist_ok=True)
        places = [f"{SITE}.{gripper}" for gripper in grippers]
        config = self.network(user, [self.endpoint]) + (
            f'[portal]\nuser = "{user}"\nrole = "{role}"\ngrippers = {places}\n'
            f'ttl_s = {ttl_s}\ndirectory = "{directory}"\n'
        )
        self.grippers = grippers
        self._start("portal", name, config)
        for gripper in grippers:
            stops = self.socket_path(gripper, name).with_suffix(".stop.sock")
            self.parts[name].until_exists(stops)

    def mend(self) -> None:
        """Let all parts run, and wait until each gripper can be reached by the portal."""
        for part in self.parts.values():
            part.thaw()
        for part in self.parts.values():
            if part.process.poll() is not None:
                part.restart()
        for gripper in self.grippers:
            reach(self, gripper).close()

    def _start(self, kind: str, name: str, config: str, **environment: str) -> None:
        on = self._on.get(name, ())
        self.parts[name] = Part(self.folder, kind, name, config, on, **environment)


@contextlib.contextmanager
def started(
    folder: Path,
    certificates: Path,
    host: str = HOST,
    on: Mapping[str, Sequence[str]] | None = None,
) -> Iterator[Fleet]:
    """Let parts be started; whatever still runs at the end has to end as it should."""
    folder.mkdir(exist_ok=True)
    short = Path(tempfile.mkdtemp(prefix="fleet-"))  # a socket's path has 107 bytes at most
    made = Fleet(folder, short, certificates, host, on)
    try:
        yield made
        for part in reversed(made.parts.values()):
            if part.process.poll() is None:
                part.end()
    except BaseException:
        for name, part in made.parts.items():
            print(f"--- {name}\n{part.log}")
        raise
    finally:
        for part in made.parts.values():
            part.kill()
        shutil.rmtree(short)


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
    options: str = "",
) -> Iterator[Fleet]:
    """Run all three; `options` are more lines of the gateway's table."""
    with started(folder, certificates) as made:
        made.start_router(users or {user: role}, {"robot1": list(sockets)})
        made.start_gateway(sockets, options=options)
        made.start_portal(user, role, list(sockets), ttl_s)
        for name in sockets:
            made.gateway.until_says(f"{SITE}.{name}: ")
        yield made


def reach(lab: Fleet, gripper: str = "left", portal: str = "portal") -> Client:
    """Connect by a portal as soon as the daemon answers there."""
    path, ends_s = lab.socket_path(gripper, portal), time.monotonic() + DEADLINE_S
    while True:
        assert time.monotonic() < ends_s, lab.parts[portal].log
        message: dict[str, Any] = {}
        with contextlib.suppress(FileNotFoundError, ConnectionRefusedError):  # none listens yet
            client = Client(path)
            with contextlib.suppress(BrokenPipeError):  # the portal has already said why not
                client.send("hello")
            message = client.read()
            if "result" in message:
                return client
            client.close()
        assert not message or message["error"]["data"]["reason"] == "unreachable", message
        wait_a_moment(lab.parts[portal].process)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind((HOST, 0))
        return int(found.getsockname()[1])
