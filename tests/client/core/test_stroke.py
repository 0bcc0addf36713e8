"""How far the jaws open, as a program says it: kept, sent, shown again; and what is rescaled."""

import copy
import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from litegrip_client import (
    CalibrationData,
    CommandError,
    GripperConfig,
    LiteGrip,
    ParameterError,
)
from litegrip_client.values.calibration import CALIBRATION_KEYS
from litegrip_client.values.errors import from_error_object
from litegrip_client.values.voices import in_python, in_shell
from litegripd.control.admission import stroke_refusal
from litegripd.model.gripper import GripperId
from litegripd.model.sentence import sentence, with_terms
from litegripd.rpc.jsonrpc import error_object
from tests.client.fake_daemon import CALIBRATION, CONTENT, HELLO, ZERO
from tests.client.rig import Bench, Heard, Kind, Threads
from tests.geometry import (
    STROKE_MM,
)

MARKS = {"closed_rad": 0.104334, "open_rad": -1.513123}


@pytest.fixture(autouse=True)
def _measuring(daemon: Heard) -> None:
    daemon.instead["calibration.zero"] = ZERO
    daemon.instead["calibration.rescale"] = CALIBRATION
    answers = {"begin": {"job": 8}, "closed": MARKS, "open": MARKS, "finish": ZERO, "cancel": {}}
    daemon.instead["calibration.manual"] = lambda request: answers[request.params["step"]]


def sent(daemon: Heard) -> float | None:
    """Return the stroke of the last request."""
    return daemon.requests[-1].params.get("stroke_mm")


def by_hand(gripper: LiteGrip, *, stroke_mm: float | None = None) -> None:
    with gripper.manual_calibration() as manual:
        manual.finish(stroke_mm=stroke_mm)


MEASURES: dict[str, Callable[..., object]] = {
    "zero": lambda gripper, **more: gripper.zero(**more),
    "calibrate": lambda gripper, **more: gripper.calibrate(**more),
    "by_hand": by_hand,
    "rescale": lambda gripper, **more: gripper.rescale_calibration(**more),
}
all_measures = pytest.mark.parametrize("measure", MEASURES.values(), ids=MEASURES)


@all_measures
def test_an_assigned_stroke_is_what_calibrations_use(
    daemon: Heard, gripper: LiteGrip, measure: Any
) -> None:
    measure(gripper)
    assert sent(daemon) is None  # the daemon's then
    _ = gripper.config
    measure(gripper)
    assert sent(daemon) is None
    gripper.config.max_stroke_mm = STROKE_MM  # also if it is the daemon's already
    measure(gripper)
    assert sent(daemon) == STROKE_MM
    gripper.config.max_stroke_mm = 84
    measure(gripper)
    assert sent(daemon) == 84.0


@all_measures
def test_an_argument_counts_more(daemon: Heard, gripper: LiteGrip, measure: Any) -> None:
    gripper.config.max_stroke_mm = 84.0
    measure(gripper, stroke_mm=86)
    assert sent(daemon) == 86.0
    assert gripper.config.max_stroke_mm == 84.0
    with pytest.raises(ParameterError, match="stroke_mm is 'wide', it must be a number"):
        measure(gripper, stroke_mm="wide")


def test_it_is_read_back_and_belongs_to_its_object(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    assert gripper.config.max_stroke_mm == STROKE_MM
    config = gripper.config
    config.max_stroke_mm = 84.0
    assert (config.max_stroke_mm, gripper.config.max_stroke_mm) == (84.0, 84.0)
    gripper.disconnect()
    gripper.connect()
    assert gripper.config.max_stroke_mm == 84.0
    with kind.gripper() as other:
        assert other.config.max_stroke_mm == STROKE_MM
        other.zero()
        assert sent(daemon) is None


def test_without_an_assignment_it_is_what_the_daemon_has(daemon: Heard, kind: Kind) -> None:
    configured: dict[str, Any] = {**HELLO["gripper"], "stroke_mm": 87.0}  # type: ignore[dict-item]
    daemon.instead["info.get"] = {**HELLO, "gripper": configured}
    with kind.gripper() as gripper:
        assert gripper.config.max_stroke_mm == 87.0


def test_nothing_else_of_the_daemons_can_be_set(gripper: LiteGrip) -> None:
    for name in ("kp", "work_stroke_mm", "nm_to_n", "rad_to_mm", "own"):
        with pytest.raises(CommandError, match=rf"config\.{name} cannot be set"):
            setattr(gripper.config, name, 5.0)


@pytest.mark.parametrize("value", ["wide", None, float("nan"), float("inf"), True])
def test_what_is_no_stroke_is_rejected_and_the_former_one_stays(
    gripper: LiteGrip, value: Any
) -> None:
    gripper.config.max_stroke_mm = 84.0
    for config in (gripper.config, GripperConfig()):
        with pytest.raises(ParameterError, match="max_stroke_mm is"):
            config.max_stroke_mm = value
    assert gripper.config.max_stroke_mm == 84.0


def filled(**values: float) -> GripperConfig:
    config = GripperConfig()
    for name, value in values.items():
        setattr(config, name, value)
    return config


@pytest.mark.parametrize(
    ("config", "stroke_mm"),
    [
        (GripperConfig(), None),
        (GripperConfig(max_stroke_mm=85.0), 85.0),
        (filled(max_stroke_mm=85.0), 85.0),
        (replace(filled(max_stroke_mm=84.0), can_id=8), 84.0),
        (copy.copy(GripperConfig()), None),
        (replace(GripperConfig(), can_id=8), None),
    ],
)
def test_a_config_object_says_it_too(
    daemon: Heard, kind: Kind, config: GripperConfig, stroke_mm: float | None
) -> None:
    config = copy.copy(config)  # which this changes
    with kind.gripper(config=config) as gripper:
        gripper.zero()
        assert sent(daemon) == stroke_mm
        assert gripper.config.max_stroke_mm == (stroke_mm or STROKE_MM)
        config.max_stroke_mm = 83.0
        gripper.zero()
        assert sent(daemon) == 83.0
        gripper.config.max_stroke_mm = 82.0
        assert config.max_stroke_mm == 82.0


def test_two_configs_that_were_copied_are_two() -> None:
    one = filled(max_stroke_mm=84.0)
    other = copy.copy(one)
    other.max_stroke_mm = 86.0
    assert (one.max_stroke_mm, other.max_stroke_mm) == (84.0, 86.0)


def test_the_vendors_guided_calibration_takes_it_from_the_config(
    daemon: Heard, site: Bench
) -> None:
    with Threads(site).gripper() as gripper:
        gripper.calibrate_guided()
        assert sent(daemon) is None
        gripper.config.max_stroke_mm = 84.0
        gripper.calibrate_guided()
        assert sent(daemon) == 84.0


def test_rescaling_is_never_after_a_stop_and_says_what_is_in_use(
    daemon: Heard, gripper: LiteGrip, caplog: pytest.LogCaptureFixture
) -> None:
    data = gripper.rescale_calibration(84.5)
    assert daemon.requests[-1].params == {
        "stroke_mm": 84.5,
        "sent_s": daemon.requests[-1].params["sent_s"],
        "stop_generation": daemon.state.stop_generation,
    }
    assert data == CalibrationData.from_content(CONTENT)
    assert not caplog.records
    doubtful = {**CALIBRATION, "scale_warning": "it has 90 mm/rad: use calibration.rescale"}
    daemon.instead["calibration.rescale"] = doubtful
    gripper.rescale_calibration()
    text = "it has 90 mm/rad: use calibration.rescale"  # an older daemon's, which marks no names
    assert caplog.record_tuples == [("litegrip_client", logging.WARNING, text)]


def test_loading_logs_that_the_millimetres_are_wrong_and_whatever_else_is_doubtful(
    daemon: Heard, gripper: LiteGrip, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    answer = {**CALIBRATION, "loaded": True, "factory": False, "skipped": []}
    daemon.instead["calibration.load"] = {**answer, "scale_warning": "1.40 times too large"}
    assert gripper.load_calibration()
    marked = sentence("it has can_id 0x07: measure again ({calibration.zero})")
    warnings = [marked, "and another (calibration.zero)"]
    daemon.instead["calibration.load"] = with_terms({**answer, "warnings": warnings})
    assert gripper.load_template("normal")
    assert [record.getMessage() for record in caplog.records] == [
        "1.40 times too large",
        f"it has can_id 0x07: measure again ({kind.awaits}gripper.zero())",
        "and another (calibration.zero)",
    ]


# What a calibration has


def test_the_work_stroke_is_a_key_of_a_calibration(daemon: Heard, gripper: LiteGrip) -> None:
    assert {"work_stroke_mm", "nm_to_n"} <= set(CALIBRATION_KEYS)
    answer = {**CALIBRATION, "loaded": True, "factory": False, "skipped": []}
    daemon.instead["calibration.load"] = answer
    data = CalibrationData.from_content({**CONTENT, "work_stroke_mm": 70.0, "nm_to_n": 16.4})
    gripper.use_calibration(data)
    content = daemon.requests[-1].params["content"]
    assert (content["work_stroke_mm"], content["nm_to_n"]) == (70.0, 16.4)
    gripper.use_calibration(CalibrationData())
    assert "work_stroke_mm" not in daemon.requests[-1].params["content"]


def test_a_key_of_the_configuration_keeps_its_name() -> None:
    refused = stroke_refusal(130.0, GripperId())
    assert refused is not None
    wire = refused.message
    assert wire.endswith(
        "set stroke_mm = 130 in [gripper] of /etc/litegripd/can0.toml, or of the file that the"
        " daemon was given"
    )
    for method in ("calibration.zero", "calibration.manual", "calibration.rescale"):
        error = error_object(refused)
        assert from_error_object(error, method, in_python).message == wire
        told = from_error_object(error, method, in_shell).message
        assert told == wire.replace("stroke_mm is", "--stroke-mm is")
