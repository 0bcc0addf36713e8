"""The pump process: moves frames between the daemon's socket and an adapter that can block.

Three threads, for each of which waiting is allowed: one reads the adapter, one writes to it, and
the first reads the daemon's socket and ends the process, blocked threads and all, with it.
"""

import errno
import fcntl
import json
import logging
import os
import socket
import struct
import sys
import threading
import time
from queue import SimpleQueue
from typing import NoReturn

import can

from litegripd.io.can.bus import condition_of, describe, open_bus, to_frame, to_message
from litegripd.io.can.pumped import pack_frames, pack_lateness, unpack_send_request
from litegripd.io.can.slcan import SlcanBus, holders
from litegripd.io.helper.child import inherited_socket, next_packet, use_all_cpus
from litegripd.model.motor import BusSettings, CanFrame

_READ_TIMEOUT_S = 0.05
_QUEUED_AT_MOST = 4  # packets; what comes while the adapter is blocked is dropped
_LONGEST_TEXT = 4000
_LOOK_EVERY_S = 10.0
_TELL_EVERY_S = 1.0
_CORRUPT_AT_MOST = 50  # in a row; an adapter that gives nothing else is opened again


def _channel() -> str:
    return str(json.loads(sys.argv[1])[1])


def _device(channel: str) -> str:
    """Return the device file of a channel: python-can takes a baud rate after it."""
    return channel.partition("@")[0]


def _others() -> str:
    """Return a sentence on other programs that have the adapter's port open, or nothing."""
    device = _device(_channel())
    others = ", ".join(holders(device)) if device.startswith("/") else ""
    return others and f"another program has {device} open, too, and takes a part of it: {others}"


def _report(peer: socket.socket, packet: bytes) -> None:
    """Send something to the daemon; without a daemon, end the process from any thread."""
    try:
        peer.send(packet)
    except OSError:
        os._exit(0)


def _fail(peer: socket.socket, error: Exception, doing: str) -> NoReturn:
    """Report to the daemon why the pump ends, and end it from any thread."""
    others = _others()
    text = f"{doing}: {describe(error)}{'; ' if others else ''}{others}"[:_LONGEST_TEXT]
    condition = condition_of(error, text, _channel())
    _report(peer, b"x" + json.dumps([condition.state, condition.error]).encode())
    os._exit(1)


def _is_damage(error: BaseException) -> bool:
    """Return True if an error comes from what was read, and not from the adapter itself.

    python-can wraps most errors of its interfaces, damaged bytes included, in one class of its own.
    """
    while (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    return isinstance(error, ValueError | LookupError | ArithmeticError | struct.error)


def _read_lines(bus: SlcanBus, peer: socket.socket) -> None:
    """Read an SLCAN adapter until it fails, or turns out to be none."""
    lines, ignored, others, told, looked_s = bus.lines, 0, "", "", float("-inf")
    while True:
        try:
            frames = bus.read()
        except Exception as error:  # noqa: BLE001 - a serial port may raise anything
            _fail(peer, error, "reading")
        if frames:
            _report(peer, b"f" + pack_frames(frames))
        now_s = time.monotonic()
        is_damaged, doubt = lines.ignored > ignored, lines.doubt(now_s)
        if is_damaged:
            _report(peer, b"i%d" % (lines.ignored - ignored))
            ignored = lines.ignored
        if (is_damaged or doubt) and now_s - looked_s >= _LOOK_EVERY_S:
            looked_s, others = now_s, _others()
        doubt = "; ".join(filter(None, (doubt, others)))
        if doubt != told:
            _report(peer, b"?" + doubt.encode())
            told = doubt
        verdict = lines.verdict(now_s)
        if verdict is not None:
            _fail(peer, can.CanOperationError(verdict), "reading")


def _read(bus: can.BusABC, peer: socket.socket) -> None:
    """Read another adapter by python-can until it fails."""
    corrupt = 0
    while True:
        try:
            message = bus.recv(_READ_TIMEOUT_S)
        except Exception as error:  # noqa: BLE001 - an interface may raise anything
            if not _is_damage(error):
                _fail(peer, error, "reading")
            corrupt += 1
            if corrupt > _CORRUPT_AT_MOST:
                _fail(peer, error, "reading: nothing but corrupt frames")
            _report(peer, b"i1")
            continue
        corrupt = 0
        if message is not None:
            frame = to_frame(message)
            _report(peer, b"i1" if frame is None else b"f" + pack_frames((frame,)))


def _write(
    bus: can.BusABC, peer: socket.socket, requests: "SimpleQueue[bytes]", lifetime_s: float
) -> None:
    """Send the frames of each request; drop and report those that are too late, or have no room.

    After a dropped frame, the others of its request are dropped, too. A request waits for the
    adapter as long as it takes earlier ones, and else for this process: both are reported apart.
    """
    free_s = worst_s = told_s = 0.0
    while True:
        frames, deadline_s = unpack_send_request(requests.get())
        now_s = time.monotonic()
        worst_s = max(worst_s, now_s - max(deadline_s - lifetime_s, free_s))
        is_late = now_s > deadline_s
        if is_late or now_s - told_s >= _TELL_EVERY_S:
            _report(peer, pack_lateness(worst_s))
            worst_s, told_s = 0.0, now_s
        is_ours = is_late and free_s <= deadline_s
        for number, frame in enumerate(frames):
            if time.monotonic() > deadline_s or not _send(bus, peer, frame):
                _report(peer, (b"w%d" if is_ours else b"d%d") % (len(frames) - number))
                break
        free_s = time.monotonic()


def _send(bus: can.BusABC, peer: socket.socket, frame: CanFrame) -> bool:
    """Send a frame; False where the adapter's queue is full, which is transient unless it lasts."""
    try:
        bus.send(to_message(frame))
    except Exception as error:  # noqa: BLE001 - an interface may raise anything
        if condition_of(error, "", _channel()).state == "bus_stalled":
            return False
        _fail(peer, error, "sending")
    return True


def _lock_device(channel: str) -> None:
    """Lock the adapter's device until this process ends; raises `OSError` if another has it.

    So no two daemons command one motor, whatever paths lead to its adapter. This comes before
    python-can opens the device, which already resets it.
    """
    if not channel.startswith("/"):
        return
    device = _device(channel)
    try:
        descriptor = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return  # python-can will fail as well, and says why in the words of its driver
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        text = f"{device} is busy: another daemon has it, and one motor has one owner"
        raise OSError(errno.EBUSY, text) from None


def _rise(priority: int) -> bool:
    """Ask for real-time priority, for the threads to come as well; return True if granted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    return True


def main() -> None:
    """Open the adapter given as JSON in the first argument and pump until the daemon is gone."""
    interface, channel, bitrate, options, lifetime_s, priority = json.loads(sys.argv[1])
    if interface == "slcan":
        options.setdefault("timeout", _READ_TIMEOUT_S)  # else its reader wakes 1000 times a second
        options.setdefault("sleep_after_open", 0)  # python-can waits 2 s by default
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it raises what it logs; that is reported
    use_all_cpus()
    peer = inherited_socket()
    bus: can.BusABC
    try:
        _lock_device(channel)
        if interface == "slcan":
            bus = SlcanBus(channel, bitrate=bitrate, **options)
        else:
            bus = open_bus(BusSettings(interface, channel, bitrate, options))
    except Exception as error:  # noqa: BLE001 - an interface may raise anything; it is reported to the daemon
        _fail(peer, error, "cannot be opened")
    _report(peer, b"o")
    if priority > 0 and not _rise(priority):
        _report(peer, b"r")
    requests: SimpleQueue[bytes] = SimpleQueue()
    read = _read_lines if isinstance(bus, SlcanBus) else _read
    threading.Thread(target=read, args=(bus, peer), daemon=True).start()
    threading.Thread(target=_write, args=(bus, peer, requests, lifetime_s), daemon=True).start()
    while packet := next_packet(peer):
        if requests.qsize() < _QUEUED_AT_MOST:
            requests.put(packet)
        else:
            _report(peer, b"d%d" % len(unpack_send_request(packet)[0]))
    os._exit(0)  # a writer that is blocked in the adapter cannot be joined


if __name__ == "__main__":
    main()
