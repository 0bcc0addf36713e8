"""What the daemon reads from its files at its start: the calibration and the kept configuration.

Without either it runs all the same, and says what is missing.
"""

import logging
from collections.abc import Callable

from litegripd.control.engine import Engine
from litegripd.model.calibration import from_plain
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import MotionConfigError

_log = logging.getLogger(__name__)


def load_at_start(engine: Engine, on_calibration: Callable[[], None]) -> None:
    """Ask for both; `on_calibration` is called when it is known what there is of them."""
    unit = engine.unit
    engine.calibrated.expect()

    def use_calibration(result: ErrandResult) -> None:
        on_calibration()
        if engine.calibrated.is_coming:
            _use_calibration(engine, result)
        else:
            _log.info(
                "a client has loaded a calibration meanwhile; the one at the start is not used"
            )

    wanted = {"channel": unit.channel, "mount": unit.mount, "configured": True}
    engine.errands.append(
        Errand("motion.load", {"channel": unit.channel}, lambda result: _use_config(engine, result))
    )
    engine.errands.append(Errand("calibration.load", wanted, use_calibration))


def _use_calibration(engine: Engine, result: ErrandResult) -> None:
    if result.error is not None or not isinstance(result.value, dict):
        refusal = Refusal("calibration_unreadable", f"no calibration: {result.error}")
        _log.error("%s", refusal.message)
        engine.use_calibration(None, refusal)
        return
    for skipped in result.value["skipped"]:
        _log.warning("calibration passed over: %s", skipped)
    found = result.value["calibration"]
    if found is None:
        channel = engine.unit.channel
        _log.warning("no calibration for channel %s: motions are refused", channel)
        engine.use_calibration(None)
        return
    engine.use_calibration(from_plain(found), file=result.value["path"])


def _use_config(engine: Engine, result: ErrandResult) -> None:
    if result.error is not None or not isinstance(result.value, dict):
        _log.error("the kept motion configuration is not used: %s", result.error)
        return
    kept = result.value["config"]
    if kept is None:
        return
    try:
        engine.config = engine.config.changed(kept, engine.period_s, engine.unit.motor_type)
    except MotionConfigError as error:
        path = result.value["path"]
        _log.error("the kept motion configuration %s is not used: %s", path, error)
        return
    engine.config_is_kept = True
    _log.info("motion configuration: %s", result.value["path"])
