"""The rows of the methods that read: who is there, the state, the jobs."""

from dataclasses import fields

from litegripd.model.state import GripperState
from litegripd.rpc.method import JOB, Method
from litegripd.rpc.schema import Param

STATE_FIELDS = tuple(field.name for field in fields(GripperState))
MAX_RATE_HZ = 1000.0

READING: tuple[Method, ...] = (
    Method(
        "hello",
        "Tell who is there: versions, channel, motor, limits, stop generation.",
        "The daemon's description.",
        (Param("client", "string", "The program's name, for the log and for other clients."),),
    ),
    Method("rpc.discover", "Describe the methods.", "An OpenRPC document."),
    Method("health", "Tell how the daemon fares.", "A verdict, its reasons, and the figures."),
    Method("state.get", "Tell the gripper's present state.", "The state."),
    Method(
        "state.subscribe",
        "Send the state again and again, as state.sample notifications.",
        "The number of the subscription and the present state.",
        (
            Param(
                "hz",
                "number",
                "Samples a second (default 20), at most the control rate.",
                minimum=0.1,
                maximum=MAX_RATE_HZ,
            ),
            Param("fields", "strings", "Only these fields (default: all).", choices=STATE_FIELDS),
        ),
    ),
    Method(
        "state.unsubscribe",
        "End a subscription of this connection.",
        "The number of the subscription.",
        (Param("subscription", "integer", "Its number.", required=True, minimum=1),),
    ),
    Method("info.get", "Tell what does not change: motor, calibration, configuration.", "Facts."),
    Method("job.list", "List the jobs that are kept, the oldest first.", "The jobs."),
    Method("job.get", "Tell about one job.", "The job.", (JOB,)),
    Method("job.wait", "Wait until a job has ended.", "The job.", (JOB,), waits=True),
)
