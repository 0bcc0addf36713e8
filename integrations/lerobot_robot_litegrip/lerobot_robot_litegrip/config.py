"""What is set on LeRobot's command lines: `--robot.channel=can0` and so on.

No field here is of type `RobotConfig` or `TeleoperatorConfig`: LeRobot's parser would expand such a
field without end, in every command of everybody who has this package installed. The arm beside a
gripper is a dictionary, which is read when the robot is made.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

MODES = ("stream", "daemon")


@dataclass(kw_only=True)
class GripperSettings:
    """What a follower and a leader have in common."""

    channel: str | None = None
    """The daemon's channel; None is that of LITEGRIP_CHANNEL, else can0."""
    mode: str = "stream"
    """Who moves a follower: "stream", LeRobot's loop; or "daemon", the daemons themselves."""
    torque_nm: float = 1.0
    """How hard jaws press at most where an action does not say so, in N·m; a leader says this."""
    max_age_s: float = 0.03
    """Figures that are older are not taken: newer ones are waited for, half a second at most."""
    disable_torque_on_disconnect: bool = True
    """False: the jaws go on holding at the end."""
    mount: str | None = None
    """How the motor is mounted, "normal" or "reverse": for a calibration of a gripper whose daemon
    does not know it."""
    teleop_port: int | None = None
    """Of mode "daemon": the leader's port, of both; 17448 by default."""

    def check(self) -> None:
        """Raise `ValueError` for what cannot be."""
        if self.mode not in MODES:
            raise ValueError(f"mode is {self.mode!r}, it must be one of {', '.join(MODES)}")
        if not self.max_age_s > 0.0:
            raise ValueError(f"max_age_s is {self.max_age_s}, it must be more than 0")


@dataclass(kw_only=True)
class FollowerSettings(GripperSettings):
    """What a gripper that is commanded has besides."""

    speed_mm_s: float | None = None
    """How fast the jaws follow at most; None is as fast as they may."""
    align_speed_mm_s: float = 50.0
    """How fast they go to where the actions begin."""
    valid_s: float = 0.2
    """How long an action counts, 0.02 to 2 s: after that the jaws hold, also if LeRobot hangs."""
    torque_action: bool = True
    """False for a leader that says nothing of `gripper.torque`."""
    stamps: bool = True
    """Whether `gripper.age_s` and `gripper.stamp_s` are observed."""
    leader_host: str | None = None
    """Of mode "daemon": the leader's machine; 127.0.0.1 for two grippers of this one."""
    reflect: bool = True
    """Of mode "daemon": whether the leader's hand may feel what this gripper grips."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)

    def check(self) -> None:
        """Raise `ValueError` for what cannot be."""
        super().check()
        if self.mode == "daemon" and not self.leader_host:
            raise ValueError(
                'mode "daemon" needs leader_host, 127.0.0.1 for a leader of this machine'
            )


@dataclass(kw_only=True)
class LeaderSettings(GripperSettings):
    """What a gripper that a hand moves has besides."""

    reflect_n: float = 4.0
    """Of mode "daemon": how hard the jaws push back at most, 0 to 10 N; 0 is off."""


def settings_of_arm(arm: dict[str, Any], example: str) -> dict[str, Any]:
    """Return an arm's settings; raises `ValueError` where they do not say what arm it is."""
    if not arm.get("type"):
        raise ValueError(f"arm needs the arm's own settings: '{{type: {example}, port: ...}}'")
    return arm


@RobotConfig.register_subclass("litegrip_follower")
@dataclass(kw_only=True)
class LiteGripFollowerConfig(FollowerSettings, RobotConfig):
    """`--robot.type=litegrip_follower`: the gripper alone."""

    def __post_init__(self) -> None:
        RobotConfig.__post_init__(self)
        self.check()


@RobotConfig.register_subclass("litegrip_with_arm")
@dataclass(kw_only=True)
class LiteGripWithArmConfig(FollowerSettings, RobotConfig):
    """`--robot.type=litegrip_with_arm`: any arm that LeRobot knows, with this gripper."""

    arm: dict[str, Any] = field(default_factory=dict)
    """The arm's own settings, `{type: so101_follower, port: /dev/ttyACM0}`."""

    def __post_init__(self) -> None:
        RobotConfig.__post_init__(self)
        self.check()


@TeleoperatorConfig.register_subclass("litegrip_leader")
@dataclass(kw_only=True)
class LiteGripLeaderConfig(LeaderSettings, TeleoperatorConfig):
    """`--teleop.type=litegrip_leader`: a gripper that a hand moves."""

    def __post_init__(self) -> None:
        self.check()


@TeleoperatorConfig.register_subclass("litegrip_leader_with_arm")
@dataclass(kw_only=True)
class LiteGripLeaderWithArmConfig(LeaderSettings, TeleoperatorConfig):
    """`--teleop.type=litegrip_leader_with_arm`: any arm's leader, with such a gripper."""

    arm: dict[str, Any] = field(default_factory=dict)
    """The leader arm's own settings, `{type: so101_leader, port: /dev/ttyACM1}`."""

    def __post_init__(self) -> None:
        self.check()


@CameraConfig.register_subclass("litegrip_scene")
@dataclass(kw_only=True)
class LiteGripSceneCameraConfig(CameraConfig):
    """`{type: litegrip_scene}`: a camera of the scene that MuJoCo moves."""

    channel: str | None = None
    """The daemon's channel; None is that of LITEGRIP_CHANNEL, else can0."""
    camera: str = "front"
    """Its name in the scene."""
    plain: bool = True
    """Without shadows and smooth edges: a processor draws that in a tenth of the time."""
