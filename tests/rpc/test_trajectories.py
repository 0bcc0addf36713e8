"""Trajectories on the wire: pieces, uploads and their bounds, names, and whose they are."""

import base64
import json
from typing import Any

import pytest

from litegrip_client.values.terms import methods_in
from litegrip_client.values.trajectory_format import MAX_BYTES, MAX_GRIP_BYTES
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES
from litegripd.rpc.sessions import Peer
from litegripd.trajectories.file_methods import MOST_BYTES, MOST_PER_CONNECTION, MOST_PIECES
from litegripd.trajectories.store import Limits
from tests.trajectories import PIECE_BYTES, fetched, lgt, pieces, sampled, send, swing, uploaded
from tests.world import Client, World, enabled_world

SHORT = lgt(sampled(swing(), 1.0))
LONG = lgt(sampled(swing(), 10.0))


def connected() -> tuple[World, Client]:
    world = World().start()
    return world, world.client()


def numbered(number: int) -> list[tuple[float, float]]:
    """Trajectories that differ."""
    return [(0.0, 0.5), (1.0 + number, 0.5)]


def test_a_file_goes_there_and_back_in_pieces() -> None:
    _, client = connected()
    answer = send(client, LONG, name="pick")
    assert (answer["complete"], answer["received"], answer["name"]) == (True, len(LONG), "pick")
    assert answer["samples"] == 1001
    assert answer["duration_s"] == pytest.approx(10.0)
    assert fetched(client, name="pick") == LONG
    assert fetched(client, name="pick", length=100 * 40) == LONG
    assert fetched(client, name="pick", format="csv").startswith(b"t_s,openness")


def test_a_full_piece_fits_into_a_line() -> None:
    _, client = connected()
    piece = pieces(LONG, name="ü" * 64)[0]
    request = {"jsonrpc": "2.0", "id": 10**9, "method": "trajectory.put", "params": piece}
    assert len(base64.b64decode(piece["data"])) == PIECE_BYTES
    assert len(json.dumps(request)) < MAX_LINE_BYTES
    assert client.result("trajectory.put", **piece) == {"received": PIECE_BYTES, "complete": False}


def test_until_the_last_piece_there_is_nothing() -> None:
    _, client = connected()
    client.result("trajectory.put", **pieces(LONG, name="pick")[0])
    assert client.refusal("trajectory.get", name="pick") == "unknown_trajectory"
    assert client.result("trajectory.list")["trajectories"] == []
    client.result("trajectory.put", **pieces(LONG)[0])
    assert client.refusal("trajectory.get", name="tmp/upload-2") == "unknown_trajectory"


def test_an_upload_is_its_connections_and_goes_with_it() -> None:
    world, client = connected()
    name = uploaded(client, numbered(0))
    assert fetched(client, name=name) == lgt(numbered(0))
    other = world.client()
    assert other.refusal("trajectory.get", name=name) == "unknown_trajectory"
    assert other.refusal("trajectory.delete", name=name) == "unknown_trajectory"
    world.enabled()
    assert other.refusal("trajectory.play", name=name) == "unknown_trajectory"
    client.leave()
    world.run(0.05)
    reason = world.disk.do_plainly("trajectory.open", name=name)
    assert reason["refused"]["reason"] == "unknown_trajectory"


def test_a_deleted_upload_is_gone() -> None:
    _, client = connected()
    name = uploaded(client, numbered(0))
    assert client.result("trajectory.delete", name=name) == {"name": name, "deleted": True}
    assert client.refusal("trajectory.get", name=name) == "unknown_trajectory"
    assert client.refusal("trajectory.delete", name=name) == "unknown_trajectory"


def test_a_connection_has_so_many_uploads_and_no_more() -> None:
    world, client = connected()
    names = [uploaded(client, numbered(number)) for number in range(MOST_PER_CONNECTION)]
    assert len(set(names)) == MOST_PER_CONNECTION
    one_more = pieces(lgt(numbered(99)))[0]
    error = client.call("trajectory.put", **one_more)["error"]
    assert methods_in(error["data"], "message") == {"trajectory.delete"}
    assert error["data"] == {
        "reason": "too_many_requests",
        "retryable": True,
        "limit": MOST_PER_CONNECTION,
        "terms": error["data"]["terms"],
    }
    world.client().result("trajectory.put", **one_more)
    client.result("trajectory.delete", name=names[0])
    client.result("trajectory.put", **one_more)


def test_a_name_without_room_is_refused_at_once_and_holds_no_upload() -> None:
    world = World().start()
    world.disk.limit(Limits(1, len(SHORT)))
    client = world.client()
    for _ in range(2 * MOST_PER_CONNECTION):
        error = client.call("trajectory.put", **pieces(LONG, name="pick")[0])["error"]
        assert methods_in(error["data"], "message") == {"trajectory.delete"}
        assert error["data"] == {
            "terms": error["data"]["terms"],
            "reason": "trajectories_full",
            "retryable": False,
            "requested": len(LONG),
            "usage": client.result("trajectory.list")["usage"],
        }
    send(client, SHORT, name="pick")
    assert client.refusal("trajectory.put", **pieces(SHORT, name="q")[0]) == "trajectories_full"
    send(world.client(uid=1001), SHORT, name="q")
    client.result("trajectory.delete", name="pick")
    send(client, SHORT, name="r")


def test_with_a_name_they_are_not_counted() -> None:
    _, client = connected()
    for number in range(2 * MOST_PER_CONNECTION):
        send(client, lgt(numbered(number)), name=f"number {number}")
    assert len(client.result("trajectory.list")["trajectories"]) == 2 * MOST_PER_CONNECTION


def test_all_together_have_so_many_bytes_and_no_more() -> None:
    """By what is announced: nobody can fill the helper's memory."""
    world = World().start()
    began = 0
    for _ in range(20):
        client = world.client()
        for number in range(MOST_PER_CONNECTION):
            piece = {**pieces(LONG)[0], "total": MAX_BYTES, "sha256": f"{number:064x}"}
            answer = client.call("trajectory.put", **piece)
            began += "result" in answer
            if "error" in answer:
                assert answer["error"]["data"]["limit"] == MOST_BYTES
    assert began == MOST_BYTES // MAX_BYTES
    client.leave()


def test_what_was_refused_is_not_counted() -> None:
    _, client = connected()
    for number in range(3 * MOST_PER_CONNECTION):
        bad = lgt([(0.0, 2.0 + number)])
        reason = client.refusal("trajectory.put", **pieces(bad)[0])
        assert reason == "trajectory_unreadable"
    assert uploaded(client, numbered(0))


def test_pieces_may_follow_each_other_without_waiting_but_not_without_end() -> None:
    world, client = connected()
    parts = pieces(lgt(sampled(swing(), 20.0)))
    assert len(parts) > MOST_PIECES
    numbers = [client.send("trajectory.put", **part) for part in parts[:MOST_PIECES]]
    assert client.refusal("trajectory.put", **parts[MOST_PIECES]) == "too_many_requests"
    world.run_until(lambda: all(client.has_answer(number) for number in numbers))
    received = [client.answers[number]["result"]["received"] for number in numbers]
    assert received == [PIECE_BYTES * (number + 1) for number in range(MOST_PIECES)]
    for part in parts[MOST_PIECES:]:
        last = client.result("trajectory.put", **part)
    assert last["complete"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"sha256": "0" * 63}, "invalid_params"),
        ({"sha256": "x" * 64}, "invalid_params"),
        ({"sha256": "0" * 64}, "trajectory_unreadable"),
        ({"offset": 40}, "invalid_params"),
        ({"offset": -1}, "invalid_params"),
        ({"total": 0}, "invalid_params"),
        ({"total": MAX_BYTES + MAX_GRIP_BYTES + 1}, "invalid_params"),
        ({"grip_bytes": MAX_GRIP_BYTES + 1}, "invalid_params"),
        ({"total": 100}, "out_of_limits"),
        ({"data": "%%%"}, "out_of_limits"),
        ({"data": ""}, "out_of_limits"),
        ({"data": "A" * 10_925}, "invalid_params"),
        ({"name": "../x"}, "invalid_params"),
        ({"name": ".x"}, "invalid_params"),
        ({"name": ""}, "invalid_params"),
        ({"name": "x" * 65}, "invalid_params"),
        ({"name": "a/b"}, "invalid_params"),
    ],
)
def test_a_wrong_piece_is_refused_and_a_right_one_goes_then(
    changes: dict[str, Any], reason: str
) -> None:
    _, client = connected()
    assert client.refusal("trajectory.put", **{**pieces(SHORT)[0], **changes}) == reason
    assert send(client, SHORT, name="pick")["complete"]


def test_a_sum_may_be_in_capitals() -> None:
    _, client = connected()
    piece = pieces(SHORT, name="pick")[0]
    assert client.result("trajectory.put", **{**piece, "sha256": piece["sha256"].upper()})


def test_another_total_in_the_middle_is_refused() -> None:
    _, client = connected()
    first, second, *_ = pieces(LONG)
    client.result("trajectory.put", **first)
    assert client.refusal("trajectory.put", **{**second, "total": 99_999}) == "invalid_params"
    client.result("trajectory.put", **second)


@pytest.mark.parametrize("method", ["trajectory.get", "trajectory.play", "trajectory.delete"])
@pytest.mark.parametrize(
    "meant", [{}, {"name": "a", "upload": 1}, {"upload": 1, "recording": 1}, {"upload": "1"}]
)
def test_one_name_is_meant(method: str, meant: dict[str, Any]) -> None:
    client = World().enabled()
    assert client.refusal(method, **meant) == "invalid_params"


def test_a_client_of_0_1_0_calls_what_it_sent_and_recorded_by_numbers() -> None:
    world, client = enabled_world()
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.5)
    recorded = client.result("trajectory.record_stop")
    whole = fetched(client, recording=recorded["recording"])
    assert whole == fetched(client, name=recorded["name"])
    sent = send(client, lgt(numbered(0)))
    assert fetched(client, upload=sent["upload"]) == lgt(numbered(0))
    assert client.result("trajectory.play", upload=sent["upload"])["outcome"] == "completed"
    assert client.result("trajectory.play", recording=recorded["recording"])["ok"]
    assert client.result("trajectory.delete", upload=sent["upload"])["deleted"]
    assert client.refusal("trajectory.get", upload=sent["upload"]) == "unknown_trajectory"


def test_a_recording_is_its_connections_and_goes_with_it() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.5)
    name = client.result("trajectory.record_stop")["name"]
    assert other.refusal("trajectory.get", name=name) == "unknown_trajectory"
    assert fetched(client, name=name)
    client.leave()
    world.run(0.05)
    reason = world.disk.do_plainly("trajectory.open", name=name)
    assert reason["refused"]["reason"] == "unknown_trajectory"


def test_loop_and_repeat_do_not_go_together() -> None:
    client = World().enabled()
    name = uploaded(client, numbered(0))
    answer = client.call("trajectory.play", name=name, loop=True, repeat=2)
    assert answer["error"]["data"]["parameter"] == "repeat"


def test_an_observer_reads_but_neither_writes_nor_records() -> None:
    world, client = connected()
    send(client, SHORT, name="pick")
    session = world.service.opened(Peer(300, 2000, 2000, "watcher"), world.now_s)
    session.role = "observer"
    watcher = Client(world, session)
    assert fetched(watcher, name="pick") == SHORT
    assert watcher.result("trajectory.status")["active"] is False
    assert len(watcher.result("trajectory.list")["trajectories"]) == 1
    for method, params in (
        ("trajectory.put", pieces(SHORT)[0]),
        ("trajectory.delete", {"name": "pick"}),
        ("trajectory.record_start", {"zero_gravity": False}),
        ("trajectory.record_stop", {}),
        ("trajectory.play", {"name": "pick"}),
        ("trajectory.control", {"action": "pause"}),
    ):
        assert watcher.refusal(method, **params) == "not_permitted"


def test_a_disk_that_fails_leaves_nothing_half() -> None:
    world, client = connected()
    send(client, SHORT, name="pick")
    world.disk.error = "no space left on the device"
    assert client.refusal("trajectory.put", **pieces(LONG, name="pick")[0]) == "not_saved"
    assert client.refusal("trajectory.delete", name="pick") == "not_saved"
    world.disk.error = None
    assert fetched(client, name="pick") == SHORT
    assert send(client, LONG, name="pick")["complete"]
    assert fetched(client, name="pick") == LONG


def test_an_answer_for_a_client_that_is_gone_harms_nobody() -> None:
    world, client = connected()
    client.send("trajectory.put", **pieces(SHORT)[0])
    client.send("trajectory.list")
    client.leave()
    world.run(0.1)
    other = world.client()
    assert other.result("trajectory.list")["trajectories"] == []
