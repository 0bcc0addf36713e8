"""The checks, in the order in which causes come before what follows from them."""

from __future__ import annotations

from litegrip_client.doctor import daemon_checks, gripper_checks, link_checks
from litegrip_client.doctor.findings import Check

CHECKS: tuple[Check, ...] = (
    Check("configuration", daemon_checks.configuration),
    Check("iproute2", link_checks.tool),
    Check("link", link_checks.link),
    Check("device", link_checks.device),
    Check("adapter", link_checks.adapter),
    Check("bit-rate", link_checks.bit_rate),
    Check("sample-point", link_checks.sample_point),
    Check("restart", link_checks.restart),
    Check("queue", link_checks.queue),
    Check("bus-state", link_checks.bus_state),
    Check("bus-errors", link_checks.errors),
    Check("daemon", daemon_checks.daemon),
    Check("version", daemon_checks.version),
    Check("sockets", daemon_checks.sockets),
    Check("group", daemon_checks.group),
    Check("real-time", daemon_checks.real_time),
    Check("bus", gripper_checks.bus),
    Check("motor", gripper_checks.motor),
    Check("other-master", gripper_checks.other_master),
    Check("control-mode", gripper_checks.control_mode),
    Check("can-br", gripper_checks.bit_rate_code),
    Check("ids", gripper_checks.ids),
    Check("watchdog", gripper_checks.watchdog),
    Check("ranges", gripper_checks.ranges),
    Check("calibration", gripper_checks.calibration),
    Check("position", gripper_checks.position),
    Check("channel", gripper_checks.calibration_channel),
    Check("health", daemon_checks.health),
)
