"""The cable between machines that are namespaces of this one, as a program of its own.

    cable.py PREFIX SEED NAME...

It makes a network namespace `PREFIX-NAME` for each machine, with one TUN device, and passes IP
packets between them: late, out of order, some not at all, as lines on its standard input say (see
`Cable.obey`). Each line is answered by one. When its input ends it removes the namespaces: whatever
ends the program that started it, none stays behind.
"""

import contextlib
import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NETWORK = "10.203.0"
"""The machines are .1, .2 and so on; no other network has to be left alone in their namespaces."""

TUN = Path("/dev/net/tun")
_NAMES_OF_HOSTS = Path("/etc/netns")
_DEVICE = "eth0"
_PACKET_BYTES = 2048
_BURST = 64
_WAITING_PACKETS = 2000
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_CLONE_NEWNET = 0x40000000
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with a cable, in both directions; by default nothing.

    Each packet is `delay_s` late, and by a random part of `jitter_s` more: so packets overtake one
    another. `loss` is the share that is lost. `cut` loses all, those on their way, too.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    cut: bool = False


SOUND = Fault()


class Cable:
    """Passes packets between the devices of machines.

    A packet meets the fault of all cables (`everywhere`), that of its sender's and that of its
    receiver's: it is lost if any loses it, and delays add up.
    """

    def __init__(self, devices: Mapping[str, int], seed: int) -> None:
        self.everywhere = SOUND
        self.faults = dict.fromkeys(devices, SOUND)
        self._devices = devices
        self._names = {fd: name for name, fd in devices.items()}
        self._receivers = {
            bytes(map(int, at.split("."))): n for n, at in addresses(devices).items()
        }
        self._random = random.Random(seed)
        self._waiting: list[tuple[float, int, str, str, bytes]] = []
        self._carried = self._lost = 0

    def carry(self) -> None:
        """Work until the standard input ends."""
        epoll, rest = select.epoll(), b""
        for fd in (0, *self._names):
            epoll.register(fd, select.EPOLLIN)
        while True:
            for fd, _events in epoll.poll(self._until_next_s()):
                if fd:
                    self._take(fd)
                    continue
                if not (received := os.read(0, 65_536)):
                    return
                *lines, rest = (rest + received).split(b"\n")
                for line in lines:
                    print(json.dumps(self.obey(json.loads(line))), flush=True)
            self._deliver()

    def obey(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Change a fault, and return the time, and how many packets were carried and lost so far.

        `{"machine": NAME or null, "fault": {...}}` sets the fault of a machine's cable, or of all;
        without "fault" nothing changes. It is in force when the answer is there.
        """
        if "fault" in order:
            fault = Fault(**order["fault"])
            if order["machine"] is None:
                self.everywhere = fault
            else:
                self.faults[order["machine"]] = fault
        return {"at_s": time.monotonic(), "carried": self._carried, "lost": self._lost}

    def _until_next_s(self) -> float | None:
        return max(0.0, self._waiting[0][0] - time.monotonic()) if self._waiting else None

    def _take(self, fd: int) -> None:
        """Take what a machine sends, or as much of it as leaves a turn for the others."""
        sender = self._names[fd]
        for _ in range(_BURST):
            try:
                packet = os.read(fd, _PACKET_BYTES)
            except BlockingIOError:
                return
            receiver = self._receivers.get(packet[16:20])
            if packet[0] >> 4 != 4 or receiver is None:
                continue  # not IPv4, or for nobody: a multicast
            self._send(sender, receiver, packet)

    def _send(self, sender: str, receiver: str, packet: bytes) -> None:
        faults = self._between(sender, receiver)
        late_s = 0.0
        for fault in faults:
            if fault.cut or (fault.loss and self._random.random() < fault.loss):
                self._lost += 1
                return
            late_s += fault.delay_s
            if fault.jitter_s:
                late_s += self._random.random() * fault.jitter_s
        self._carried += 1
        if late_s == 0.0 and not self._waiting:
            self._hand_over(receiver, packet)
            return
        row = (time.monotonic() + late_s, self._carried, sender, receiver, packet)
        heapq.heappush(self._waiting, row)

    def _between(self, sender: str, receiver: str) -> Sequence[Fault]:
        return self.everywhere, self.faults[sender], self.faults[receiver]

    def _deliver(self) -> None:
        now_s = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now_s:
            _due_s, _number, sender, receiver, packet = heapq.heappop(self._waiting)
            if any(fault.cut for fault in self._between(sender, receiver)):
                self._carried -= 1
                self._lost += 1
            else:
                self._hand_over(receiver, packet)

    def _hand_over(self, receiver: str, packet: bytes) -> None:
        os.write(self._devices[receiver], packet)


def addresses(names: Sequence[str] | Mapping[str, Any]) -> dict[str, str]:
    """Return the address of each machine."""
    return {name: f"{NETWORK}.{number}" for number, name in enumerate(names, 1)}


@contextlib.contextmanager
def inside(namespace: str) -> Iterator[None]:
    """Let this thread be in a namespace: sockets that it makes there stay there."""
    with Path("/proc/thread-self/ns/net").open("rb") as home:
        with Path(f"/run/netns/{namespace}").open("rb") as there:
            _enter(there.fileno())
        try:
            yield
        finally:
            _enter(home.fileno())


def _enter(namespace_fd: int) -> None:
    # os.setns is there from Python 3.12 on.
    if _libc.setns(namespace_fd, _CLONE_NEWNET) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


@contextlib.contextmanager
def machines(prefix: str, names: Sequence[str]) -> Iterator[dict[str, int]]:
    """Make a namespace for each machine, which knows the others by name; yield their devices."""
    hosts = [f"{at} {name}" for name, at in addresses(names).items()]
    with contextlib.ExitStack() as stack:
        devices = {}
        for name, address in addresses(names).items():
            namespace = f"{prefix}-{name}"
            stack.callback(remove, namespace)
            ip("netns", "add", namespace)
            own = _NAMES_OF_HOSTS / namespace
            own.mkdir(parents=True)
            text = "\n".join(["127.0.0.1 localhost", *hosts, ""])
            (own / "hosts").write_text(text, encoding="ascii")
            with inside(namespace):
                devices[name] = open_device()
            stack.callback(os.close, devices[name])
            ip("-n", namespace, "link", "set", "lo", "up")
            ip("-n", namespace, "address", "add", f"{address}/24", "dev", _DEVICE)
            queue = ("txqueuelen", str(_WAITING_PACKETS))
            ip("-n", namespace, "link", "set", _DEVICE, *queue, "up")
        yield devices


def remove(namespace: str) -> None:
    """Remove a namespace, as far as it is there; what still runs in it keeps it until it ends."""
    if Path(f"/run/netns/{namespace}").exists():
        ip("netns", "delete", namespace)
    shutil.rmtree(_NAMES_OF_HOSTS / namespace, ignore_errors=True)
    with contextlib.suppress(OSError):  # it is another's, too
        _NAMES_OF_HOSTS.rmdir()


def open_device() -> int:
    """Make a TUN device in this thread's namespace; what is routed to it can be read."""
    fd = os.open(TUN, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    request = struct.pack("16sH22x", _DEVICE.encode(), _IFF_TUN | _IFF_NO_PI)
    fcntl.ioctl(fd, _TUNSETIFF, request)
    return fd


def ip(*arguments: str) -> None:
    """Run `ip`; raises `CalledProcessError`."""
    subprocess.run(["ip", *arguments], check=True, stdin=subprocess.DEVNULL)


def main(prefix: str, seed: str, *names: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with who started it, not before
    signal.signal(signal.SIGTERM, lambda *_received: sys.exit(0))
    with machines(prefix, names) as devices:
        print(json.dumps({"addresses": addresses(names)}), flush=True)
        Cable(devices, int(seed)).carry()


if __name__ == "__main__":
    main(*sys.argv[1:])
