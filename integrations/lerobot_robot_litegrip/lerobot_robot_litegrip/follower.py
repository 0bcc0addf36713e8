"""Robots: the gripper that follows actions, alone or as the hand of any arm."""

from __future__ import annotations

from typing import Any

import draccus
from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig, make_robot_from_config

from lerobot_robot_litegrip.config import (
    FollowerSettings,
    LiteGripFollowerConfig,
    LiteGripWithArmConfig,
    settings_of_arm,
)
from lerobot_robot_litegrip.device import BesideArm, GripperDevice, without_gripper
from lerobot_robot_litegrip.mapping import (
    AGE,
    OBSERVED,
    PERCENT,
    POS,
    STAMP,
    TORQUE,
    observation_of,
    target_of,
)
from lerobot_robot_litegrip.watched import WatchedGripper
from litegrip_client import SetpointStream, TeleopNotReady

_ALIGNED = 0.1
"""Jaws within this share of the travel of their target follow as fast as they may."""
_FOLLOWS_WITHIN_S = 15.0
_LOOK_EACH = 20
"""States between two looks at how teleoperation goes."""


class Follower(WatchedGripper):
    """A gripper that follows: the targets of a program, or the leader that its daemon hears."""

    def __init__(self, settings: FollowerSettings) -> None:
        super().__init__(settings)
        self._follows = settings
        speed_mm_s, align_mm_s = settings.speed_mm_s, settings.align_speed_mm_s
        self._fast: SetpointStream = self._gripper.stream(settings.valid_s, speed_mm_s=speed_mm_s)
        self._slow: SetpointStream = self._gripper.stream(settings.valid_s, speed_mm_s=align_mm_s)
        self._is_aligned = False

    def start(self) -> None:
        """Enable, and in mode "daemon" wait until the jaws are where the leader's are.

        A daemon that follows already goes on: then nothing is enabled here, nor disabled at the
        end. Raises `TeleopNotReady` with how far it has come to its leader.
        """
        if self._follows.mode == "daemon":
            if not self.teleoperates("slave"):
                self.enable()
                self._gripper.teleop_start(
                    "slave",
                    host=self._follows.leader_host,
                    port=self._follows.teleop_port,
                    reflect=self._follows.reflect,
                )
            self._wait_until_it_follows()
        else:
            self.enable()
        self.begin()

    def _wait_until_it_follows(self) -> None:
        state = self.latest.state
        ends_s = state.monotonic_s + _FOLLOWS_WITHIN_S
        status = self._gripper.teleop_status()
        while not (status["active"] and status["ready"]):
            if state.monotonic_s > ends_s or not status["active"]:
                raise TeleopNotReady(
                    f"{self.name} does not follow: {status['phase']}, {status['link_state']}"
                    + (f", {status['link_error']}" if status["link_error"] else ""),
                    reason="teleop_not_ready",
                )
            for _ in range(_LOOK_EACH):
                state = self.latest.wait_newer()
            status = self._gripper.teleop_status()

    def observe(self) -> dict[str, float]:
        """Return the newest figures. Raises `StaleFiguresError` and `ConnectError`."""
        state, _, age_s = self.fresh()
        observed = observation_of(state, self.travel, self.zero_s) | {AGE: age_s}
        if not self._follows.stamps:
            del observed[AGE], observed[STAMP]
        return observed

    def follow(self, action: dict[str, Any]) -> dict[str, float]:
        """Send an action on, clipped, and return it so; in mode "daemon" only look at it.

        The jaws come from afar at `align_speed_mm_s`, also after a pause: a policy that hung, or
        a data set that begins elsewhere, throws them nowhere. Raises `ParameterError` for an
        action that is none, and what motions raise.
        """
        openness, torque_nm = target_of(action, self._follows.torque_nm)
        if self._follows.mode == "daemon":
            self.refuse_end_of_teleoperation()
        else:
            state = self.refuse_stop()
            if state.job is None:
                self._is_aligned = False
            if state.openness is not None and abs(openness - state.openness) <= _ALIGNED:
                self._is_aligned = True
            stream = self._fast if self._is_aligned else self._slow
            stream.set_target(openness=openness, torque_nm=torque_nm)
        sent = {POS: PERCENT * openness, TORQUE: torque_nm}
        return {name: sent[name] for name in self.action_features}

    @property
    def action_features(self) -> dict[str, type]:
        """What an action has. LeRobot 0.6 cannot replay one of a single figure."""
        return dict.fromkeys((POS, TORQUE) if self._follows.torque_action else (POS,), float)

    @property
    def observation_features(self) -> dict[str, type]:
        """What an observation has, but for images."""
        stamps = (AGE, STAMP) if self._follows.stamps else ()
        return dict.fromkeys((*OBSERVED, *stamps), float)


class LiteGripFollower(GripperDevice, Robot):
    """`--robot.type=litegrip_follower`."""

    config_class: type[RobotConfig] = LiteGripFollowerConfig
    name = "litegrip_follower"

    def __init__(self, config: LiteGripFollowerConfig | LiteGripWithArmConfig) -> None:
        super().__init__(config)
        self.config = config
        self.gripper: Follower = Follower(config)
        self.cameras = make_cameras_from_configs(config.cameras)

    @property
    def observation_features(self) -> dict[str, Any]:
        """The figures, and the images."""
        images = {name: (one.height, one.width, 3) for name, one in self.config.cameras.items()}
        return {**self.gripper.observation_features, **images}

    @property
    def is_connected(self) -> bool:
        """True if the gripper and all cameras can be asked."""
        return super().is_connected and all(
            self.cameras[name].is_connected for name in self.config.cameras
        )

    def prepare(self) -> None:
        """Connect the cameras: they may take seconds, and the motor is disabled yet."""
        for name in self.config.cameras:
            self.cameras[name].connect()

    def get_observation(self) -> dict[str, Any]:
        """Return figures that are fresh, and the cameras' newest images."""
        figures = self.gripper.observe()
        images = {name: self.cameras[name].read_latest() for name in self.config.cameras}
        return {**figures, **images}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send an action to the jaws; return what was sent."""
        return dict(self.gripper.follow(action))

    def disconnect(self) -> None:
        """Disconnect the gripper, then the cameras."""
        try:
            super().disconnect()
        finally:
            for name in self.config.cameras:
                if self.cameras[name].is_connected:
                    self.cameras[name].disconnect()


class LiteGripWithArm(BesideArm, LiteGripFollower):
    """`--robot.type=litegrip_with_arm`: what the arm says of a gripper of its own is left out."""

    config_class = LiteGripWithArmConfig
    name = "litegrip_with_arm"

    def __init__(self, config: LiteGripWithArmConfig) -> None:
        super().__init__(config)
        arm = settings_of_arm(config.arm, "so101_follower")
        self.arm: Robot = make_robot_from_config(draccus.decode(RobotConfig, arm))
        self.cameras = {**getattr(self.arm, "cameras", {}), **self.cameras}

    @property
    def observation_features(self) -> dict[str, Any]:
        """The arm's and the gripper's."""
        return {**without_gripper(self.arm.observation_features), **super().observation_features}

    def get_observation(self) -> dict[str, Any]:
        """Return the arm's observation and the gripper's."""
        return {**without_gripper(self.arm.get_observation()), **super().get_observation()}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send the gripper its part, then the arm: a gripper that is stopped moves no arm."""
        sent = super().send_action(action)
        return {**without_gripper(self.arm.send_action(without_gripper(action))), **sent}
