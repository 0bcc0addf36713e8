"""Each remedy of docs/troubleshooting.md was carried out by somebody, or the page says by nobody.

The table from the symptom to the command is `tests/symptoms`' own. Each row of the others has an
entry here, in the page's order: how its first cell begins, and who carries its remedy out. That is
a test of that name, a scene of the virtual machine (`vm:`), a row of that table (`symptom:`), or
None.
"""

import ast
import functools
import itertools
import re
import subprocess
from pathlib import Path

import pytest

from litegrip_client.values.text import text_of as decoded
from litegripd.model.calibration import CalibrationError, parse_calibration
from litegripd.rpc.reports import MAX_PER_SESSION
from tests.control.test_remedies import CASES, do
from tests.docs.test_pages import text_of
from tests.symptoms.page import ENDS
from tests.world import World

ROOT = Path(__file__).resolve().parents[2]
PAGE = text_of("docs/troubleshooting.md")
REMEDIES = "tests/control/test_remedies.py::test_after_the_remedy_the_call_works"
CARRIED = "tests/control/test_carried_out.py::"
HERE = "tests/docs/test_tried.py::"
FILES = f"{HERE}test_a_file_of_another_system_is_read_after_the_command"
SLCAN, GRASP = "tests/io/test_slcan.py::", "tests/control/test_grasp.py::"
REACH, LOST = "tests/io/test_teleop_reach.py::", "tests/control/test_teleop_lost.py::"

TRIED: list[tuple[str, str | None]] = [
    # No daemon can be reached
    ("`can0.sock: missing`", "vm:adapters.doctors_remedies"),
    ("`permission denied: only", "vm:systemd.installation"),
    ("`permission denied: its directory", ("tests/client/test_discovery.py::"
     "test_a_directory_that_refuses_is_what_the_error_names")),
    ("the daemon has another channel", ("tests/client/doctor/test_doctor.py::"
     "test_the_daemon_of_another_channel")),
    ("the daemon says `channel can0 is owned", ("tests/io/test_listener.py::"
     "test_a_closed_claim_frees_the_channel")),
    ("the daemon says `this process may open", ("tests/process/test_few_descriptors.py::"
     "test_with_too_few_it_does_not_start_and_says_what_it_needs")),
    ("the daemon ends with exit code 2", "symptom:configuration"),
    ("the unit ends with `203/EXEC`", None),
    ("`the daemon did not answer", "vm:managed.groups_of_channels"),
    ("`STOP not confirmed by can0`", ("tests/client/test_ctl_stop.py::"
     "test_a_stop_that_is_not_answered_says_first_to_cut_the_power")),
    ("`can0.sock: not a socket", "symptom:daemon"),
    ("`the daemon is about to end`", ("tests/client/core/test_silence.py::"
     "test_who_waits_when_the_daemon_is_ended_is_told_once_what_it_does_and_how_to_go_on")),
    ("`the daemon ended the connection`", ("tests/sdk/test_broken_off.py::"
     "test_it_connects_again")),
    ("`the motor could not be disabled`", ("tests/client/core/test_gripper.py::"
     "test_a_motor_that_cannot_be_disabled_is_told_once")),
    # A gripper at rest
    ("the motor has latched", ("tests/app/test_at_rest.py::"
     "test_a_motor_that_latches_it_again_and_again_is_disabled_all_the_while")),
    ("the motor's power stage", REMEDIES),
    ("the motor does not answer, and nobody", REMEDIES),
    # The jaws do not move
    ("`the motor is not enabled`", REMEDIES),
    ("`no calibration is loaded`", REMEDIES),
    ("`the daemon has just started", ("tests/process/test_slow_start.py::"
     "test_the_first_client_finds_the_calibration_however_slow_the_helper_starts")),
    ("`a stop (...) by ... is latched`", REMEDIES),
    ("`it came ... s after this was sent", ("tests/rpc/test_received.py::"
     "test_what_came_before_a_stop_neither_moves_nor_clears")),
    ("`the set-point is", ("tests/rpc/test_received.py::"
     "test_a_set_point_counts_from_when_it_was_sent_or_else_received")),
    ("`job ..., ... by", REMEDIES),
    ("`... (pid ...) has the gripper", REMEDIES),
    ("`the lease of this connection is lost", REMEDIES),
    ("`may be cleared by", ("tests/rpc/test_losers.py::"
     "test_the_holder_and_an_admin_clear_what_another_has_stopped")),
    ("`job ..., teleop", REMEDIES),
    ("`job ..., record", REMEDIES),
    ("`no replay is running`", ("tests/client/core/test_replay.py::"
     "test_what_needs_a_replay_names_the_call_that_begins_one")),
    ("`requests of this connection", f"{HERE}test_who_reads_its_answers_may_ask_again"),
    ("`requests of uid", ("tests/io/test_helper_requests.py::"
     "test_a_user_who_asks_too_much_is_refused_and_named_for_a_while")),
    ("`named trajectories", ("tests/control/test_record_ends.py::"
     "test_what_has_no_room_under_its_name_is_not_lost")),
    ("`... is an observer", REMEDIES),
    ("`it must be ... to", ("tests/control/test_remedies.py::"
     "test_the_limit_that_a_refusal_names_is_accepted")),
    ("`the motor says that it is at", REMEDIES),
    ("`the motor did not confirm that", ("tests/motor/test_enabling.py::"
     "test_the_next_failure_is_not_told_in_the_words_of_the_last")),
    ("`the motor does not answer`", REMEDIES),
    ("nothing, but the jaws stand", (f"{CARRIED}"
     "test_jaws_that_stand_without_a_word_show_torque_and_go_on_when_they_are_free")),
    # A file that was edited on another system
    ("it is in UTF-16", FILES),
    ("byte 0xFC", FILES),
    ("line 3 has a non-breaking", f"{HERE}test_the_command_shows_the_line_that_has_the_sign"),
    ("it holds nothing but zeros", ("tests/io/test_calibration_files.py::"
     "test_the_previous_calibration_is_named_but_never_used_unasked")),
    ("an `.lgt` file", ("tests/io/test_edited_files.py::"
     "test_a_trajectory_that_was_copied_as_text_says_so")),
    # The motor does not answer
    ("no 24 V", REMEDIES),
    ("plug, wires", (f"{CARRIED}"
     "test_a_plug_that_was_out_answers_when_it_is_in_and_the_bus_shows_it")),
    ("termination", None),
    ("another bit rate of the link", "vm:adapters.wrong_rate_is_named"),
    ("a mode of the link", "vm:adapters.doctors_remedies"),
    ("another id", "symptom:scan"),
    ("another bit rate of the motor", None),
    # The bus is down
    ("`link_down`", "vm:socketcan.link_down_and_up"),
    ("`adapter_gone`", "vm:adapters.adapter_replugged"),
    ("`bus_off`", "vm:adapters.adapter_bus_off"),
    ("`bus_stalled`", "tests/app/test_at_rest.py::test_a_gripper_at_rest_is_no_alarm"),
    ("`down`, \"is busy", ("tests/process/test_hardware.py::"
     "test_a_second_path_to_an_adapter_is_no_second_owner")),
    ("`down`, \"this system", None),
    ("`down`, any other", None),
    ("`it does not speak SLCAN", "symptom:device"),
    ("`it returns what is sent", "symptom:device"),
    ("`the adapter refuses", "symptom:device"),
    ("`nothing has come", f"{SLCAN}test_a_mute_port_is_doubted_until_something_comes"),
    ("`another program has", (f"{SLCAN}"
     "test_another_program_at_the_port_is_named_when_lines_are_damaged")),
    ("`frames waited", ("tests/io/test_pumped_states.py::"
     "test_frames_that_the_pump_itself_was_late_for_are_no_blocked_adapter")),
    ("`nothing but damage", (f"{SLCAN}"
     "test_an_adapter_that_worked_is_opened_again_only_after_seconds_of_damage")),
    ("`Device doesn't support", "vm:adapters.adapter_refuses_restart"),
    ("`Device or resource busy`", "vm:adapters.wrong_bit_rate"),
    ("`RTNETLINK answers: No such", "vm:adapters.type_remedies"),
    # A fault of the motor
    *((f"{code} |", REMEDIES) for code in "89ABCDE"),
    # Ticks are late
    ("no real-time rights", "vm:systemd.with_rights"),
    ("another real-time program", None),
    ("clients that ask too much", None),
    # A grasp is not what it should be
    ("`no_object`, but", f"{CARRIED}test_a_thin_object_is_found_with_a_smaller_margin"),
    ("`object_held`, but", (f"{CARRIED}"
     "test_jaws_that_stick_hold_no_object_once_they_are_free_and_measured")),
    ("`object_lost`", f"{CARRIED}test_what_slips_out_is_held_with_more_force"),
    ("the event `object_moved`", ("tests/control/test_bumps.py::"
     "test_how_far_the_object_moved_is_reported_once")),
    ("the event `released_by_fault`", ("tests/control/test_released_by_fault.py::"
     "test_a_motor_without_power_is_told_the_same_way")),
    ("`litegripctl state`: `squeezing", ("tests/control/test_released_by_fault.py::"
     "test_an_adapter_that_is_unplugged_leaves_what_was_known_with_its_age")),
    ("the event `pressing`", f"{HERE}test_what_presses_is_let_go_by_open"),
    ("the event `swing`", ("tests/control/test_swing.py::"
     "test_a_hold_that_swings_all_the_same_is_calmed_and_told_of")),
    ("no `object_lost`, but", ("tests/control/test_loss_detection.py::"
     "test_a_loss_is_reported_or_said_not_to_be")),
    ("`close` or `move`: `blocked`", f"{HERE}test_what_is_held_by_force_is_let_go_by_release"),
    ("`wrong_width`", f"{GRASP}test_the_wrong_width_is_told_without_letting_go"),
    ("`motor_weak`", (f"{CARRIED}"
     "test_a_weak_motor_is_no_longer_said_to_be_one_once_its_supply_is_right")),
    ("`open` or `close`: `protected`", f"{HERE}test_what_was_in_the_way_is_taken_away"),
    # Teleoperation
    ("`resolving`", f"{REACH}test_a_name_that_does_not_resolve_is_said_to_be_one"),
    ("`connecting`, \"has refused", (f"{REACH}"
     "test_a_port_where_nobody_listens_refuses_until_a_leader_is_there_and_again_after_it")),
    ("`connecting`, \"does not answer", (f"{REACH}"
     "test_a_machine_that_drops_what_comes_does_not_answer_until_it_lets_it_through")),
    ("`bound`, \"no frame comes", f"{REACH}test_a_udp_follower_that_hears_nobody_says_so"),
    ("`bound`, \"frames come", f"{REACH}test_a_udp_follower_that_hears_nobody_says_so"),
    ("a master's `sending`", (f"{REACH}"
     "test_a_udp_leader_says_that_nobody_listens_until_a_follower_is_there")),
    ("`connecting`, \"is no leader's", (f"{REACH}"
     "test_a_port_at_which_something_else_listens_is_no_leaders")),
    ("`connected, no frame yet`", ("tests/process/test_teleop.py::"
     "test_two_daemons_over_zenoh_and_a_leader_that_goes_and_comes_back")),
    ("a `link_error`", ("tests/control/test_teleop_job.py::"
     "test_the_links_state_is_told_once_and_shown")),
    ("a master's `holds until a slave is ready`", ("tests/control/test_teleop_ready.py::"
     "test_a_leader_holds_until_its_follower_is_where_it_is")),
    ("`stale`", (f"{LOST}test_a_cable_that_is_cut_for_ten_seconds_is_no_step_though_the_leader_"
     "went_elsewhere")),
    ("`over_torque`", ("tests/control/test_teleop_guard.py::"
     "test_it_stays_free_until_the_leader_has_reopened_and_then_aligns")),
    ("frames, but the jaws stay", f"{LOST}test_a_second_leader_is_told_and_not_followed"),
    ("refused: `teleop_not_ready`", REMEDIES),
]  # fmt: skip
OPEN = PAGE.partition("## What nobody has carried out yet")[2].partition("\n## ")[0]


def rows() -> list[str]:
    """Return the rows of all tables behind that of the symptoms, without their heads."""
    lines = PAGE.partition(ENDS)[2].splitlines()
    return [
        line.removeprefix("| ")
        for before, line in itertools.pairwise(lines)
        if line.startswith("| ") and before.startswith("| ") and not line.startswith("| ---")
    ]


def part(title: str) -> str:
    """Return a part of the page."""
    return PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]


NAMED = re.findall(r"^\| (`.*?) \|", part("The jaws do not move"), re.MULTILINE) + re.findall(
    r"^\| (`the .*?) \|", part("No daemon can be reached"), re.MULTILINE
)
QUOTED = [words for cell in NAMED for words in re.findall("`(.*?)`", cell)]
"""What the page says that programs say, for a reader who searches for the words of an error."""


@functools.cache
def refusals() -> list[str]:
    """Return what the daemon refuses in the scenes of the remedies."""
    found = []
    for _, cause, (method, params), _, _ in CASES:
        world = World().start()
        client = world.client()
        do(world, client, cause)
        found.append(client.call(method, **params)["error"]["message"])
    return found


@functools.cache
def written() -> str:
    """Return all texts in the code of daemon and client, with "..." for what is filled in."""
    files = (*ROOT.glob("litegripd/**/*.py"), *ROOT.glob("litegrip_client/**/*.py"))
    return "\n".join(
        re.sub(r"\{.*?\}", "...", node.value)
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


@pytest.mark.parametrize("words", QUOTED)
def test_what_the_page_quotes_is_said(words: str) -> None:
    parts = words.split("...")
    pattern = ".+".join(map(re.escape, parts))
    if not any(re.search(pattern, message) for message in refusals()):
        assert [part for part in parts if part.strip() not in written()] == []


def test_each_row_has_an_entry_in_the_pages_order() -> None:
    found = rows()
    for (begins, _), row in zip(TRIED, found, strict=False):
        assert row.startswith(begins), row
    assert len(found) == len(TRIED)


@pytest.mark.parametrize("tried", sorted({by for _, by in TRIED if by is not None}))
def test_who_is_named_is_there(tried: str) -> None:
    kind, _, name = tried.partition(":")
    if kind == "symptom":
        assert f" {name}: " in PAGE.partition(ENDS)[0]
        return
    file, _, function = (
        (f"tests/vm/{name.partition('.')[0]}.py", "", name.partition(".")[2])
        if kind == "vm"
        else tried.partition("::")
    )
    assert f"def {function}(" in (ROOT / file).read_text(encoding="utf-8")


def test_the_page_says_which_nobody_has_carried_out() -> None:
    open_ones = [begins for begins, by in TRIED if by is None]
    told = [line for line in OPEN.splitlines() if line.startswith("- ")]
    assert len(told) == len(open_ones)
    for begins, line in zip(open_ones, told, strict=True):
        assert line.startswith(f"- {begins}"), line


ENCODED = [("UTF-16", "utf-16"), ("LATIN1", "latin-1")]


@pytest.mark.parametrize(("name", "codec"), ENCODED)
def test_a_file_of_another_system_is_read_after_the_command(
    tmp_path: Path, name: str, codec: str
) -> None:
    text = (ROOT / "litegrip_client/data/normal.json").read_text(encoding="utf-8")
    file = tmp_path / "can0.json"
    file.write_bytes(text.rstrip()[:-1].encode(codec) + ', "note": "grün"}'.encode(codec)[
        2 if codec == "utf-16" else 0 :])  # fmt: skip
    with pytest.raises((CalibrationError, ValueError), match="save"):
        parse_calibration(decoded(file.read_bytes()))
    command = re.search(rf"`(iconv -f {name} -t UTF-8 FILE)`", PAGE)
    assert command is not None
    words = command[1].replace("FILE", str(file)).split()
    done = subprocess.run(words, capture_output=True, check=True)
    assert parse_calibration(decoded(done.stdout)).content["note"] == "grün"


def test_the_command_shows_the_line_that_has_the_sign(tmp_path: Path) -> None:
    file = tmp_path / "can0.toml"
    file.write_text("[bus]\n\nchannel =\u00a0“can0”\n", encoding="utf-8")
    command = re.search(r"`(grep -nP '.*' FILE)` shows the lines", PAGE)
    assert command is not None
    done = subprocess.run(
        ["/bin/sh", "-c", command[1].replace("FILE", str(file))],
        env={"LC_ALL": "C.UTF-8", "PATH": "/usr/bin:/bin"}, capture_output=True, check=False,
    )  # fmt: skip
    assert done.stdout.startswith(b"3:")


def test_who_reads_its_answers_may_ask_again() -> None:
    world = World()
    world.enabled().send("motion.open")
    job = world.state.job
    assert job is not None
    client = world.client()
    waiting = [client.send("job.wait", job=job.job) for _ in range(MAX_PER_SESSION)]
    assert client.refusal("job.wait", job=job.job) == "too_many_requests"
    world.run_until(lambda: all(client.has_answer(number) for number in waiting))
    assert "result" in client.call("job.wait", job=job.job)


def test_what_presses_is_let_go_by_open() -> None:
    world = World()
    client = world.enabled()
    client.result("motion.open")
    world.gripper.put_object(width_mm=40.0)
    client.call("motion.move", opening_mm=20.0)
    world.run(3.0)
    assert world.state.pressing_n is not None
    assert world.gripper.clamp_nm > 0.5
    assert client.result("motion.open")["ok"]
    assert world.gripper.clamp_nm == 0.0


def test_what_is_held_by_force_is_let_go_by_release() -> None:
    world = World()
    client = world.enabled()
    client.result("motion.open")
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.grasp", force_n=10.0, hold_s=0.1)["ok"]
    assert client.result("motion.close")["outcome"] == "blocked"
    opening_mm = world.state.opening_mm
    assert opening_mm is not None
    assert client.result("motion.move", opening_mm=opening_mm + 5.0)["ok"]  # litegripctl release
    assert world.gripper.clamp_nm == 0.0
    world.gripper.remove_object()
    assert client.result("motion.close")["ok"]


def test_what_was_in_the_way_is_taken_away() -> None:
    world = World()
    client = world.enabled()
    client.result("motion.open")
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.close")["outcome"] in ("protected", "blocked")
    world.gripper.remove_object()
    assert client.result("motion.close")["ok"]
