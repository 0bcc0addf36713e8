import pytest

from examples import aio_watch
from litegrip_client import ConnectError
from tests.client.aio_helpers import run
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import event, sample


def test_the_example_prints_states_and_events_until_the_daemon_ends(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    def watch_states(request: Request) -> None:
        request.reply({"subscription": 5, "state": STATE})
        sample(request, 1, state={**STATE, "mode": "moving", "opening_mm": None, "stale": True})

    def watch_events(request: Request) -> None:
        daemon.wait_for("state.subscribe")
        recent = [event(None, 40, "stop")]
        request.reply({"subscription": 5, "state": STATE, "events": recent})
        event(request, 41)
        daemon.hang_up()

    daemon.handlers["state.subscribe"] = watch_states
    daemon.handlers["events.subscribe"] = watch_events
    with pytest.raises(ConnectError, match="ended the connection"):
        run(aio_watch.main(["--socket", daemon.path]))
    assert sorted(capsys.readouterr().out.splitlines()) == [
        "before stop: the job ended",
        "event job_ended: the job ended",
        "state      - mm  moving STALE",
        "state   35.2 mm  holding",
    ]
