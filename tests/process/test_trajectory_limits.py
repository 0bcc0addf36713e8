"""The named trajectories of two users, at the limits of the daemon's configuration."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import SIMULATED, DaemonProcess, daemon_for_all
from tests.process.test_whose import ALICE, BOB, CHANNEL, ctl
from tests.trajectories import lgt, sampled, swing

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")

CONFIG = f"{SIMULATED}[trajectories]\nmost_per_user = 2\nmost_mb_per_user = 1\n"


def keep(folder: Path) -> None:
    """Keep three trajectories, as before there were owners, and lay out one short and one large."""
    kept = folder / "trajectories"
    kept.mkdir()
    for number in range(3):
        (kept / f"old {number}.lgt").write_bytes(lgt([(0.0, 0.5)]))
    (folder / "short.lgt").write_bytes(lgt(sampled(swing(), 3.0)))
    (folder / "large.lgt").write_bytes(lgt(sampled(swing(), 270.0)))


@pytest.fixture
def limited() -> Iterator[DaemonProcess]:
    with daemon_for_all(CHANNEL, CONFIG, keep) as running:
        yield running


def test_a_user_at_the_limits_is_refused_and_the_others_are_not(limited: DaemonProcess) -> None:
    folder = limited.socket_path.parent
    short, large = str(folder / "short.lgt"), str(folder / "large.lgt")
    code, _, err = ctl(limited, ALICE, "trajectories", "put", large)
    assert (code, "most_mb_per_user" in err) == (4, True), err
    for name in ("a", "b"):
        code, _, err = ctl(limited, ALICE, "trajectories", "put", short, "--as", name)
        assert code == 0, err
    code, _, err = ctl(limited, ALICE, "trajectories", "put", short, "--as", "c")
    assert code == 4
    assert f"uid {ALICE} has 2 named trajectories, of 2" in err
    assert f"litegripctl --socket {limited.socket_path} trajectories delete" in err
    assert ctl(limited, BOB, "trajectories", "put", short, "--as", "c")[0] == 0
    code, out, _ = ctl(limited, ALICE, "trajectories")
    *rows, room = out.splitlines()
    assert [(row.split()[0], row.split()[-1]) for row in rows[1:]] == [
        ("a", str(ALICE)),
        ("b", str(ALICE)),
        ("c", str(BOB)),
        *(("old", "-"),) * 3,
    ]
    assert room.startswith(f"of uid {ALICE}, who asks: 2 of 2, 0.0 of 1 MB")
    code, _, err = ctl(limited, ALICE, "record", "d", "--seconds", "0.1")
    assert (code, "nothing was recorded" in err) == (4, True), err
    code, _, err = ctl(limited, ALICE, "record", "d/e", "--seconds", "0.1")
    assert (code, "it is a name, not a path" in err, "slack" in err) == (4, True, False), err
    assert ctl(limited, ALICE, "trajectories", "delete", "a")[0] == 0
    assert ctl(limited, ALICE, "trajectories", "put", short, "--as", "d")[0] == 0


def test_a_limit_holds_for_what_was_recorded_too_and_it_stays(limited: DaemonProcess) -> None:
    short = str(limited.socket_path.parent / "short.lgt")
    for name in ("a", "b"):
        assert ctl(limited, 0, "trajectories", "put", short, "--as", name)[0] == 0
    with limited.connect() as client:
        client.enabled()
        client.result("trajectory.record_start", zero_gravity=False)
        client.until(lambda _state: client.result("trajectory.status")["samples"] > 5)
        assert client.refusal("trajectory.record_stop", name="c") == "trajectories_full"
    assert ctl(limited, 0, "trajectories", "keep", "c")[0] == 4
    assert ctl(limited, 0, "trajectories", "delete", "a")[0] == 0
    code, out, err = ctl(limited, 0, "trajectories", "keep", "c")
    assert (code, "kept as c" in out) == (0, True), err
    assert (limited.socket_path.parent / "trajectories" / "c.uid").read_text() == "0\n"
