from litegrip import (
    CommError,
    ErrorCode,
    HardwareError,
    LiteGrip,
    LiteGripError,
    NotInitializedError,
    describe_error,
)

with LiteGrip("can0") as gripper:
    try:
        gripper.open()
    except NotInitializedError:
        print("not enabled")
        gripper.enable()
    try:
        gripper.goto(9999)
    except ValueError as error:
        print("value:", type(error).__name__)
    try:
        gripper.close()
    except CommError as error:
        print("bus:", error)
    except HardwareError as error:
        print("fault:", ErrorCode(error.error_code).name, describe_error(error.error_code))
        print("cleared", gripper.clear_fault(), gripper.get_error() == ErrorCode.ENABLED)
    except LiteGripError as error:
        print("other:", error)
