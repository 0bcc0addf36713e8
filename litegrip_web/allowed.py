"""Which of the daemon's methods a browser may call: the rest stays with the shell and Python.

`stop` is in neither list: whoever has the token may stop, and it goes by a way of its own.
"""

READ = frozenset(
    {
        "hello",
        "health",
        "state.get",
        "state.subscribe",
        "state.unsubscribe",
        "events.subscribe",
        "events.unsubscribe",
        "clients.list",
        "info.get",
        "job.get",
        "job.list",
        "lease.get",
        "calibration.get",
        "config.get",
        "trajectory.list",
        "trajectory.status",
        "sim.get",
    }
)
"""They change nothing."""

ACT = frozenset(
    {
        "lease.acquire",
        "lease.release",
        "lease.renew",
        "lease.take",
        "stop.clear",
        "motor.enable",
        "motor.disable",
        "motor.clear_fault",
        "motion.open",
        "motion.close",
        "motion.grasp",
        "motion.move",
        "motion.hold",
        "motion.zero_gravity",
        "motion.set_force",
        "job.cancel",
        "calibration.zero",
        "calibration.rescale",
        "calibration.save",
        "trajectory.record_start",
        "trajectory.record_stop",
        "trajectory.play",
        "trajectory.control",
        "sim.object",
        "sim.push",
        "sim.hold",
        "sim.fault",
        "sim.heat",
        "sim.reset",
    }
)
"""They need `--operate`, and then whatever the daemon asks of any client."""

MOVE = frozenset(
    {
        "motor.enable",
        "motion.open",
        "motion.close",
        "motion.grasp",
        "motion.move",
        "motion.set_force",
        "calibration.zero",
        "trajectory.record_start",
        "trajectory.play",
        "trajectory.control",
    }
)
"""Of these, what begins something at the jaws, which nobody expects any more if it comes late. What
holds, lets go or ends is never late."""
