"""The rows of the methods that read: who is there, the state, the events, the jobs."""

from dataclasses import fields

from litegripd.model.jobs import Job
from litegripd.model.state import GripperState
from litegripd.rpc.answers import (
    ClientList,
    Discovered,
    EventsSubscribed,
    Greeting,
    JobList,
    StateSubscribed,
    SubscriptionNumber,
)
from litegripd.rpc.events import EVENT_KINDS
from litegripd.rpc.facts import Figures, Hello, Info, Judged
from litegripd.rpc.method import JOB, Method
from litegripd.rpc.reports import StateView
from litegripd.rpc.schema import Param, Shape
from litegripd.rpc.subscriptions import MAX_BATCH

STATE_FIELDS = tuple(field.name for field in fields(GripperState))
MAX_RATE_HZ = 1000.0

_SUBSCRIPTION = Param("subscription", "integer", "Its number.", required=True, minimum=1)

READING: tuple[Method, ...] = (
    Method(
        "hello",
        "Tell who is there: versions, channel, motor, limits, stop generation.",
        "The daemon's description, the number of this connection (client), where stops are taken"
        " before everything else (stop_socket; null where there is no such socket), and the time"
        " by the daemon's CLOCK_MONOTONIC (monotonic_s), by which a client of another machine knows"
        " that its own clock is no use for sent_s.",
        Shape("Hello", (Hello, Greeting)),
        (Param("client", "string", "The program's name, for the log and for other clients."),),
    ),
    Method("rpc.discover", "Describe the methods.", "An OpenRPC document.", Discovered),
    Method(
        "health",
        "Tell how the daemon fares.",
        "A verdict, its reasons, and the figures.",
        Shape("Health", (Judged, Shape("Figures", (Figures,), partial=True))),
    ),
    Method("state.get", "Tell the gripper's present state.", "The state.", StateView),
    Method(
        "state.subscribe",
        "Send the state again and again, as state.sample or state.batch notifications.",
        "The number of the subscription and the present state, with all its fields.",
        StateSubscribed,
        (
            Param(
                "hz",
                "number",
                "Samples a second (default 20), at most the control rate.",
                minimum=0.1,
                maximum=MAX_RATE_HZ,
            ),
            Param("fields", "strings", "Only these fields (default: all).", choices=STATE_FIELDS),
            Param(
                "batch",
                "integer",
                "So many samples in one notification (default 1). With more than one, fields must"
                " be named: each sample is a row of their values.",
                minimum=1,
                maximum=MAX_BATCH,
            ),
        ),
    ),
    Method(
        "state.unsubscribe",
        "End a subscription of this connection to the state.",
        "The number of the subscription.",
        SubscriptionNumber,
        (_SUBSCRIPTION,),
    ),
    Method(
        "events.subscribe",
        "Tell what happens from now on, as event notifications; none is ever left out.",
        "The number of the subscription, the present state, and the last 32 events of these kinds.",
        EventsSubscribed,
        (
            Param(
                "kinds",
                "strings",
                "Only these kinds (default: all but refused, which tells of other clients' requests"
                " that were refused).",
                choices=EVENT_KINDS,
            ),
        ),
    ),
    Method(
        "events.unsubscribe",
        "End a subscription of this connection to events.",
        "The number of the subscription.",
        SubscriptionNumber,
        (_SUBSCRIPTION,),
    ),
    Method(
        "clients.list",
        "Tell who is connected.",
        "clients: of each its number (client), pid, uid, program, role, connected_s, what is"
        " counted of it (requests, refused, bytes_in, bytes_out, dropped samples,"
        " worst_latency_ms), its subscriptions, its requests that wait (waiting), and is_me.",
        ClientList,
    ),
    Method(
        "info.get",
        "Tell what does not change: motor, calibration, configuration.",
        "Facts: what hello tells, the motor's registers, motor_warnings, the calibration's file,"
        " channel and date (saved_s, Unix time; nominal: a template's figures, measured on no"
        " gripper), motion, configuration.",
        Info,
    ),
    Method("job.list", "List the jobs that are kept, the oldest first.", "The jobs.", JobList),
    Method("job.get", "Tell about one job.", "The job.", Job, (JOB,)),
    Method("job.wait", "Wait until a job has ended.", "The job.", Job, (JOB,), waits=True),
)
