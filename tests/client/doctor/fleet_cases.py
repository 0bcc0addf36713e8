"""The cases of what concerns grippers of other machines."""

from dataclasses import replace

from tests.client.doctor.case import Case
from tests.client.doctor.known import NOW_S, facts, with_daemon

DAY_S = 86_400.0
REMOTE = {"channel": "can7", "site": "lab", "gripper": "left"}
FAR = replace(with_daemon(hello_remote=REMOTE), is_remote=True, channel="lab.left", interface=None)


FLEET_CASES = [
    Case("protection", facts(), None),
    Case("protection", with_daemon(health_remote=None), None),
    Case(
        "protection",
        with_daemon(health_remote={"insecure": True, "certificate_expires_s": None}),
        "warning",
        "nothing is encrypted",
        advises="etc/zenoh-certificates",
    ),
    Case(
        "protection",
        with_daemon(health_remote={"insecure": False, "certificate_expires_s": NOW_S + 31 * DAY_S}),
        "ok",
        "good for 31 days",
    ),
    Case(
        "protection",
        with_daemon(health_remote={"insecure": False, "certificate_expires_s": NOW_S + 29 * DAY_S}),
        "warning",
        "good for 29 days",
        advises="restart the portal",
    ),
    Case(
        "protection",
        with_daemon(health_remote={"insecure": False, "certificate_expires_s": NOW_S - 1.0}),
        "error",
        "is over",
        advises="restart the portal",
    ),
    # What another machine has, is not looked for on this one.
    Case("daemon", FAR, "ok", "on another machine (there, 'litegripctl -c can7 doctor'"),
    Case(
        "daemon",
        replace(FAR, daemon=None, failure="its gateway is not connected"),
        "error",
        "its gateway is not connected",
        advises="the portal has to run here, with lab.left in [portal]",
    ),
    Case(
        "version",
        replace(FAR, version="9"),
        "warning",
        "the daemon is 1.2.3, this program 9",
        advises="one version on both machines",
    ),
    Case("real-time", FAR, None),
    Case("link", FAR, None),
    Case("bit-rate", FAR, None),
    Case(
        "channel",
        replace(FAR, daemon=with_daemon(hello_remote={**REMOTE, "channel": "can0"}).daemon),
        "ok",
        "is for can0",
    ),
    Case(
        "channel",
        FAR,
        "warning",
        "is for can0, this is can7",
        "litegripctl -c can0 enable && litegripctl -c can0 zero",
        "look at its mount first",
    ),
]
