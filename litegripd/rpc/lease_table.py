"""The rows of the methods on the lease: who may move the gripper."""

from dataclasses import replace

from litegripd.rpc.answers import Granted, LeaseNumber, LeaseView, Released, Taken
from litegripd.rpc.method import LEASE, Method
from litegripd.rpc.schema import Param

_PURPOSE = Param("purpose", "string", "What for; shown to everybody whom the lease refuses.")
_TTL = Param(
    "ttl_s",
    "number",
    "It is lost when its holder sends no request for so long (default: no limit).",
    minimum=0.1,
    maximum=86_400,
)
_ON_LOST = Param(
    "on_lost",
    "string",
    "What the jaws do when it is lost: keep the present hold, its force included (hold, the"
    " default), go slack (relax), or be disabled (disable).",
    choices=("hold", "relax", "disable"),
)
_GRANTED = "The token (lease), its number, and the state."

LEASE_METHODS: tuple[Method, ...] = (
    Method(
        "lease.get",
        "Tell who has the lease, and how many wait.",
        "owner (or null), waiting.",
        LeaseView,
    ),
    Method(
        "lease.acquire",
        "Have the gripper for this connection alone, until lease.release or the connection's end.",
        _GRANTED,
        Granted,
        (
            _PURPOSE,
            _TTL,
            _ON_LOST,
            Param(
                "wait_s",
                "number",
                "How long to wait for it where it is not free, first come, first served (default"
                " 0).",
                minimum=0,
                maximum=86_400,
            ),
        ),
        role="operator",
        waits=True,
    ),
    Method(
        "lease.release",
        "Give the lease back, if it is the present one; a running motion goes on.",
        "released.",
        Released,
        (LEASE,),
        role="operator",
    ),
    Method(
        "lease.renew",
        "Let the time to live begin anew, as every request of the holder does.",
        "The number of the lease.",
        LeaseNumber,
        (LEASE,),
        role="operator",
        needs_lease=False,
    ),
    Method(
        "lease.resume",
        "Get the lease of this token again after a lost connection, if nobody has had it since.",
        _GRANTED,
        Granted,
        (replace(LEASE, required=True),),
        role="operator",
    ),
    Method(
        "lease.take",
        "Take the lease from whoever has it: of the same user, or as admin. A motion that runs"
        " ends, a detached one, too. The loser is told, and moves nothing by its connection until"
        " it asks for the lease again.",
        "As of lease.acquire; from whom it was taken (taken_from, as the owner of lease.get, or"
        " null), the motion that has ended by it (ended_job, or null), and what the jaws do (jaws;"
        " null where the taker's own motion, or disabling, goes on).",
        Taken,
        (
            Param("why", "string", "The reason, told to the loser and to the log.", required=True),
            Param(
                "jaws",
                "string",
                "What the jaws do now, whatever the loser wished: keep the present hold, its force"
                " included (hold, the default), go slack (relax), or be disabled (disable).",
                choices=("hold", "relax", "disable"),
            ),
            _PURPOSE,
            _TTL,
            _ON_LOST,
        ),
        role="operator",
        stop_voids=True,
    ),
)
