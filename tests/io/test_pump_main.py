"""The pump's own loops: what an adapter gives and raises, and what the daemon is told of it."""

import errno
import json
import logging
import socket
import time

import can
import pytest

from litegripd.io.can import pump_main
from litegripd.io.can.pumped import pack_frames, pack_send_request
from litegripd.model.motor import CanFrame
from tests.io.pump_rig import FakeAdapter, Pump, PumpEndsError

FRAME = CanFrame(0x18, bytes(8))
MESSAGE = can.Message(arbitration_id=0x18, data=bytes(8), is_extended_id=False)
RECEIVED = b"f" + pack_frames((FRAME,))
FULL = can.CanOperationError("Transmit buffer full")
ORDER = [CanFrame(0x08, bytes([number])) for number in range(3)]


@pytest.fixture
def pump(monkeypatch: pytest.MonkeyPatch) -> Pump:
    return Pump(monkeypatch)


def condition(packet: bytes) -> tuple[str, str]:
    """Take apart why the pump ended."""
    assert packet[:1] == b"x"
    state, text = json.loads(packet[1:])
    return state, text


@pytest.mark.parametrize("error", [ValueError("no number"), IndexError("too short")])
def test_a_corrupt_line_is_counted_and_the_next_is_read(pump: Pump, error: Exception) -> None:
    pump.read(FakeAdapter([error, None, MESSAGE]))
    assert pump.told == [b"i1", RECEIVED]


def test_nothing_but_corrupt_lines_opens_the_adapter_anew(pump: Pump) -> None:
    most = pump_main._CORRUPT_AT_MOST
    pump.read(FakeAdapter([ValueError("no number")] * (most + 2)))
    assert pump.told[:-1] == [b"i1"] * most
    assert condition(pump.told[-1]) == (
        "down",
        "reading: nothing but corrupt frames: no number",
    )


def test_corrupt_lines_count_in_a_row(pump: Pump) -> None:
    most = pump_main._CORRUPT_AT_MOST
    corrupt = [ValueError("no number")] * most
    pump.read(FakeAdapter([*corrupt, MESSAGE, *corrupt]))
    assert pump.told == [*[b"i1"] * most, RECEIVED, *[b"i1"] * most]


def test_what_is_no_classic_data_frame_is_counted(pump: Pump) -> None:
    error_frame = can.Message(arbitration_id=0x18, is_error_frame=True, is_extended_id=False)
    pump.read(FakeAdapter([error_frame, MESSAGE]))
    assert pump.told == [b"i1", RECEIVED]


@pytest.mark.parametrize(
    ("error", "state"),
    [
        (can.CanOperationError("Could not read from serial device"), "down"),
        (OSError(errno.ENODEV, "No such device"), "adapter_gone"),
    ],
)
def test_what_else_reading_raises_ends_the_pump(pump: Pump, error: Exception, state: str) -> None:
    pump.read(FakeAdapter([error, MESSAGE]))
    assert len(pump.told) == 1
    told, text = condition(pump.told[0])
    assert (told, text.startswith("reading: ")) == (state, True)


def test_orders_are_sent_whole(pump: Pump) -> None:
    adapter = FakeAdapter()
    pump.write(adapter, [ORDER, ORDER[:1]])
    assert adapter.sent == [b"\0", b"\1", b"\2", b"\0"]
    assert pump.told == []


@pytest.mark.parametrize(
    "error",
    [FULL, can.CanOperationError("failed", error_code=errno.ENOBUFS)],
)
def test_a_full_queue_drops_the_rest_of_an_order_and_the_pump_goes_on(
    pump: Pump, error: Exception
) -> None:
    adapter = FakeAdapter(send_errors=[None, error])
    pump.write(adapter, [ORDER, ORDER])
    assert pump.told == [b"d2"]
    assert adapter.sent == [b"\0", b"\0", b"\1", b"\2"]


def test_what_else_sending_raises_ends_the_pump(pump: Pump) -> None:
    adapter = FakeAdapter(send_errors=[can.CanOperationError("Could not write to serial device")])
    pump.write(adapter, [ORDER, ORDER])
    assert adapter.sent == []
    assert [condition(packet) for packet in pump.told] == [
        ("down", "sending: Could not write to serial device")
    ]


@pytest.mark.parametrize(
    ("takes_s", "waits_s", "told"),
    [(0.0, 0.05, b"w1"), (0.05, 0.0, b"d1")],
    ids=["the process itself was late", "the adapter was not free"],
)
def test_what_was_late_is_told_by_who_was_late(
    pump: Pump, monkeypatch: pytest.MonkeyPatch, takes_s: float, waits_s: float, told: bytes
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)

    class Adapter(FakeAdapter):
        def send(self, message: can.Message) -> None:
            nonlocal now_s
            super().send(message)
            now_s += takes_s

    def get() -> bytes:
        nonlocal now_s
        now_s += waits_s * bool(adapter.sent)
        if not requests:
            raise PumpEndsError
        return requests.pop(0)

    adapter = Adapter()
    requests = [pack_send_request(ORDER[:1], 100.0 + at_s) for at_s in (0.01, 0.015)]
    monkeypatch.setattr(pump, "get", get)
    pump.write(adapter, [])
    assert pump.told == [told]
    assert len(adapter.sent) == 1


@pytest.mark.parametrize(("given", "waits_s"), [({}, 0), ({"sleep_after_open": 2}, 2)])
def test_an_slcan_adapter_is_used_at_once_unless_it_is_said_to_reset(
    pump: Pump, monkeypatch: pytest.MonkeyPatch, given: dict[str, float], waits_s: float
) -> None:
    told = []

    def opened(_channel: str, **options: object) -> None:
        told.append(options["sleep_after_open"])
        raise OSError("no adapter")

    ours, theirs = socket.socketpair()
    for name, value in (("SlcanBus", opened), ("inherited_socket", lambda: theirs)):
        monkeypatch.setattr(pump_main, name, value)
    for name in ("use_all_cpus", "_lock_device"):
        monkeypatch.setattr(pump_main, name, lambda *_: None)
    monkeypatch.setattr(logging.getLogger("can"), "setLevel", lambda _level: None)
    arguments = json.dumps(["slcan", "/dev/ttyACM0", 1_000_000, given, 0.1, 0])
    monkeypatch.setattr("sys.argv", ["pump", arguments])
    with ours, theirs, pytest.raises(PumpEndsError):
        pump_main.main()
    assert told == [waits_s]
