"""The SDK's section "Quick start"."""

import contextlib
from pathlib import Path

import pytest

from litegrip_client import EnableResult, LiteGrip
from litegripd.model.motor import CanFrame
from litegripd.motor import codec
from tests.drop_in import Daemon, Site
from tests.geometry import TRAVEL_MM
from tests.sdk.readme import blocks
from tests.sdk.readme.scenes import jaws_are_loose, own_file


def test_the_example_on_an_object(
    site: Site, home: Path, mount: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The object is in the way of close, too, which lets go of it; grasp then takes it."""
    own_file(home, "can0", mount)
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    daemon.gripper.put_object(width_mm=30.0)
    with site.recorded(daemon) as moments:
        blocks.run(blocks.source("quick_start"))
    assert capsys.readouterr().out == "False True 15\n"
    assert max(moment.opening_mm for moment in moments) == pytest.approx(TRAVEL_MM, abs=1.0)
    assert moments[-10].closing_torque_nm == pytest.approx(2.0, abs=0.1)
    assert moments[-10].opening_mm == pytest.approx(30.0, abs=1.5)
    assert not daemon.is_energised


def test_the_example_without_an_object_ends_at_once(
    site: Site, home: Path, mount: str, capsys: pytest.CaptureFixture[str]
) -> None:
    own_file(home, "can0", mount)
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with site.recorded(daemon) as moments:
        blocks.run(blocks.source("quick_start"))
    assert capsys.readouterr().out == "True False 0\n"
    openings = [moment.opening_mm for moment in moments]
    assert max(openings) == pytest.approx(TRAVEL_MM, abs=1.0)
    assert min(openings) == pytest.approx(0.0, abs=1.0)
    assert max(abs(moment.closing_torque_nm) for moment in moments) < 1.9  # never 20 N


@pytest.mark.parametrize(("lost", "retries"), [(0, None), (1, None), (2, None), (3, None), (4, 4)])
def test_enable_retries_until_the_status_frame_says_enabled(
    site: Site, daemon: Daemon, lost: int, retries: int | None
) -> None:
    """What the motor does not hear is no success, however often it is sent."""
    left, succeeds = [lost], lost < 3

    def lose(frame: CanFrame) -> bool:
        is_enable = frame.data == codec.ENABLE
        left[0] -= is_enable
        return is_enable and left[0] >= 0

    daemon.lose_to_motor = lose
    with LiteGrip("can0") as gripper:
        result = gripper.enable(retries=retries)
        assert isinstance(result, EnableResult)
        assert (result.ok, bool(result)) == (succeeds, succeeds)
        assert result.tries == min(lost + 1, retries or 3)
        assert (result.state.error_code, result.state.enabled) == (int(succeeds), succeeds)
        assert daemon.is_energised is succeeds
        assert gripper.enable()
        assert daemon.is_energised
    assert codec.CLEAR_FAULT not in [sent.frame.data for sent in daemon.sent]  # there was none


def test_grasp_closes_until_gripped_and_then_holds_20_n(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    with site.recorded(daemon) as moments:
        result = gripper.grasp(force_n=20.0, hold_s=3.0)
    assert result
    assert (result.reached, result.stalled, result.cycles) == (False, True, 15)
    gripped_s = next(moment.at_s for moment in moments if moment.opening_mm < 30.0)
    assert moments[-1].at_s - gripped_s == pytest.approx(3.0, abs=0.5)
    last_second = [m.closing_torque_nm for m in moments if m.at_s > moments[-1].at_s - 1.0]
    assert last_second == pytest.approx([2.0] * len(last_second), abs=0.1)


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt])
def test_with_disconnects_on_exit_which_disables_the_motor(
    site: Site, daemon: Daemon, error: type[BaseException] | None
) -> None:
    with contextlib.suppress(ValueError, KeyboardInterrupt), LiteGrip("can0") as gripper:
        gripper.enable()
        assert gripper.is_connected
        assert not jaws_are_loose(site, daemon)
        if error is not None:
            raise error
    assert not gripper.is_connected
    assert not daemon.is_energised
    assert jaws_are_loose(site, daemon)


@pytest.mark.parametrize("by", ["argument", "attribute"])
def test_disable_on_disconnect_false_leaves_the_gripper_energised(
    site: Site, daemon: Daemon, by: str
) -> None:
    with LiteGrip("can0", disable_on_disconnect=by != "argument") as gripper:
        gripper.enable()
        gripper.disable_on_disconnect = False
        gripper.close()
    site.run(1.0)
    assert daemon.is_energised
    assert daemon.closing_torque_nm > 0.1
    assert not jaws_are_loose(site, daemon)
