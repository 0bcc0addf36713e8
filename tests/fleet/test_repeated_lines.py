"""A router that comes and goes fills no log of a gateway's or a portal's."""

import logging

import pytest

from litegrip_client.values.repeats import EACH, REPEATS, RepeatsHandler


def test_a_router_that_comes_and_goes_is_logged_ever_more_rarely_and_a_stop_each_time(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now_s = 0.0
    handler = RepeatsHandler(clock=lambda: now_s)
    logger = logging.Logger("fleet", logging.INFO)
    logger.addHandler(handler)
    for number in range(2000):
        now_s = number * 5.0
        handler.poll()
        logger.warning("the connection to the router is lost (%s): trying again", "tls/a:7447")
        logger.info("connected to a router (%s)", "tls/a:7447", extra={REPEATS: True})
        logger.warning("cell/can0: stopped (hold)", extra=EACH)
    handler.close()
    lines = capsys.readouterr().err.splitlines()
    assert lines.count("cell/can0: stopped (hold)") == 2000
    others = [line for line in lines if not line.startswith("cell/can0")]
    assert others[:2] == [
        "the connection to the router is lost (tls/a:7447): trying again",
        "connected to a router (tls/a:7447)",
    ]
    assert 8 < len(others) < 20
    lost = [line.partition("(again: ")[2].split()[0] for line in others[2:] if "is lost" in line]
    assert sum(1 if number == "once" else int(number) for number in lost) == 1999
