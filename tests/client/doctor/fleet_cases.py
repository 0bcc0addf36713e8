"""The cases of what concerns grippers of other machines."""

from dataclasses import replace

from litegrip_client.ctl.doctor.facts import Facts
from tests.client.doctor.case import Case, Cases
from tests.client.doctor.known import NOW_S, with_daemon

REMOTE = {"channel": "can7", "site": "lab", "gripper": "left"}
FAR = replace(with_daemon(hello_remote=REMOTE), is_remote=True, channel="lab.left", interface=None)


def certified(days: float) -> Facts:
    """Return facts with a certificate that is good for so long."""
    expires_s = NOW_S + days * 86_400.0
    return with_daemon(health_remote={"insecure": False, "certificate_expires_s": expires_s})


FLEET_CASES: Cases = {
    "protection": [
        Case(with_daemon(health_remote=None)),
        Case(
            with_daemon(health_remote={"insecure": True, "certificate_expires_s": None}),
            "WARNING nothing is encrypted # etc/zenoh-certificates",
        ),
        Case(certified(31.0), "OK good for 31 days"),
        Case(certified(29.0), "WARNING good for 29 days # restart the portal"),
    ],
    "daemon": [
        Case(FAR, "OK on another machine (there, 'litegripctl -c can7 doctor'"),
        Case(
            replace(FAR, daemon=None, failure="its gateway is not connected"),
            "ERROR its gateway is not connected"
            " # the portal has to run here, with lab.left in [portal]",
        ),
    ],
    "version": [
        Case(
            replace(FAR, version="9"),
            "WARNING the daemon is 1.2.3, this program 9 # one version on both machines",
        ),
    ],
    "channel": [
        Case(
            replace(FAR, daemon=with_daemon(hello_remote={**REMOTE, "channel": "can0"}).daemon),
            "OK is for can0",
        ),
        Case(
            FAR,
            "WARNING is for can0, this is can7"
            " $ litegripctl -c can0 enable && litegripctl -c can0 zero"
            " # look at its mount first",
        ),
    ],
}
