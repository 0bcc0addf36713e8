import pytest

from examples import aio_watch
from litegrip_client import ConnectError
from tests.client.rig import Asyncio, Bench, Heard


@pytest.mark.parametrize(("is_calibrated", "opening"), [(True, "60.0"), (False, "   -")])
def test_the_example_prints_states_and_events_until_the_daemon_ends(
    site: Bench,
    tasks: Asyncio,
    capsys: pytest.CaptureFixture[str],
    is_calibrated: bool,
    opening: str,
) -> None:
    daemon = Heard(calibrated=is_calibrated)
    site.add(daemon)
    other = daemon.client()
    other.result("stop", level="relax", why="a hand")
    site.after(0.3, lambda: other.send("stop", level="disable", why="a foot"))
    site.after(0.3, lambda: setattr(daemon, "lose_from_motor", lambda _frame: True))
    site.after(1.3, daemon.hang_up)
    with pytest.raises(ConnectError, match="ended the connection"):
        tasks.run(aio_watch.main(["--socket", "/run/litegripd/can0.sock"]))
    lines = capsys.readouterr().out.splitlines()
    stops = [line.partition(":")[0] for line in lines if "stop:" in line]
    assert stops == ["before stop", "event stop"]
    states = [line for line in lines if line.startswith("state")]
    assert states[0] == f"state   {opening} mm  disabled"
    assert states[-1] == f"state   {opening} mm  offline STALE"
