"""What a motion of litegripctl shows while it runs."""

from typing import Any

from litegrip_client.ctl.render import progress
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, FakeDaemon, Request

GRASP: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "object_held",
    "reached": False,
    "stalled": True,
    "target_rad": 0.05,
    "force_n": 20.0,
    "cycles": 0,
    "width_mm": 48.2,
    "held_s": 0.0,
    "state": {**STATE, "opening_mm": 48.2, "is_grasped": True, "force_set_n": 20.0},
}


def test_progress_without_an_end_has_no_bar() -> None:
    data = {"phase": "hold", "step": 3, "total_steps": 0, "opening_mm": 48.2, "torque_nm": 2.0}
    assert progress(data) == " 48.20 mm  +2.00 N·m  hold"
    assert progress({"phase": "probe_open\x1b"}) == "-- mm  -- N·m  probe open?"


def test_a_grasp_on_a_terminal_shows_how_far_it_is(daemon: FakeDaemon) -> None:
    def grasp(request: Request) -> Any:
        request.progress(5)
        return GRASP

    daemon.handlers["motion.grasp"] = grasp
    terminal = Terminal("--socket", daemon.path, "grasp")
    terminal.expect(f"\r[{'#' * 12}{'.' * 12}]  12.50 mm  +0.30 N·m  travel\x1b[K")
    code, shown = terminal.end()
    let_go = f"let go with: litegripctl --socket {daemon.path} release"
    text = f"grasp: object held, 48.2 mm wide, holding 20.0 N; {let_go}\n"
    assert (code, shown) == (0, f"\r\x1b[K{text}")
