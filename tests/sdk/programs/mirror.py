"""Mirror the real jaws on a screen: look at the package, hold, let go, hold again."""

import importlib.util
import sys
import time
from pathlib import Path
from types import ModuleType

import litegrip


def loaded_by_path(folder: Path) -> ModuleType:
    """Load the package by its file, as a program does that pins where it comes from."""
    place = folder / "litegrip"
    spec = importlib.util.spec_from_file_location(
        "litegrip", place / "__init__.py", submodule_search_locations=[str(place)]
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    kept = {name: one for name, one in sys.modules.items() if name.partition(".")[0] == "litegrip"}
    for name in kept:
        del sys.modules[name]
    sys.modules["litegrip"] = module
    spec.loader.exec_module(module)
    return module


def main() -> int:
    channel = sys.argv[1]
    for name in ("position_rad", "velocity_rad_s", "torque_nm", "error_code"):
        if not hasattr(litegrip.GripperState, name):
            print("another SDK:", name)
            return 1
    sdk = loaded_by_path(Path(litegrip.__file__).parent.parent)
    module = sys.modules["litegrip.gripper"]
    print("from", Path(module._FACTORY_CALIB).name, sdk.__file__ == litegrip.__file__)
    gripper = sdk.LiteGrip(channel=channel, can_id=8, mst_id=None)
    assert gripper.connect()
    assert gripper.load_calibration(module._FACTORY_CALIB)
    assert gripper.enable()
    first = gripper.get_state()
    while gripper.get_state().timestamp <= first.timestamp:
        time.sleep(0.005)
    config = gripper.config
    held_rad = gripper.get_state().position_rad
    for _ in range(100):
        assert gripper.send_mit_frame(q=held_rad, kp=config.kp, kd=config.kd)
        time.sleep(0.005)
    print("held", abs(gripper.get_position_rad() - held_rad) < 0.02)
    gripper.enter_zero_gravity()
    for _ in range(100):
        assert gripper.send_mit_frame(q=0.0, kp=0.0, kd=0.0)
        time.sleep(0.005)
    gripper.exit_zero_gravity()
    target_rad = gripper.get_position_rad()
    assert gripper.goto_rad(target_rad)
    print("there", abs(gripper.get_position_rad() - target_rad) < 0.02)
    for signature in ({"duration": 1.0}, {"kp": 1.0}):
        try:
            gripper.open(**signature)
        except TypeError:
            continue
        print("an old signature is taken")
    gripper.disable()
    gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
