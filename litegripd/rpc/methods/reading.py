"""The methods that read: who is there, the state, the events, the jobs. They change nothing."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypedDict

from litegripd.control.controller import Controller
from litegripd.control.snapshot import GripperState
from litegripd.model.errors import Refusal
from litegripd.model.sentence import sentence
from litegripd.model.state import Job
from litegripd.rpc.method import JOB, Answer, Call, Later, Method, Param, Refused, Shape, accepted
from litegripd.rpc.reports import (
    Facts,
    Figures,
    Hello,
    Info,
    Judged,
    NumberedEvent,
    Reporter,
    StateView,
)
from litegripd.rpc.sessions import ROLES, Clients, Role
from litegripd.rpc.subscriptions import (
    EVENT_KINDS,
    MAX_BATCH,
    UNASKED_KINDS,
    SubscriptionNumber,
    Subscriptions,
)

DEFAULT_SAMPLE_HZ = 20.0


class Greeting(TypedDict):
    """What `hello` says of the asking connection; the other members are the daemon's facts."""

    client: int
    role: Role
    monotonic_s: float
    stop_generation: int


Discovered = TypedDict(
    "Discovered",
    {
        "openrpc": str,
        "info": Mapping[str, object],
        "methods": list[Mapping[str, Any]],
        "x-notifications": list[Mapping[str, Any]],
        "components": Mapping[str, Mapping[str, Any]],
    },
)
"""The OpenRPC document."""


class ClientRow(TypedDict):
    """One connection."""

    client: int
    pid: int
    uid: int
    program: str
    role: Role
    connected_s: float
    requests: int
    refused: int
    bytes_in: int
    bytes_out: int
    dropped: int
    worst_latency_ms: float | None
    subscriptions: int
    waiting: int
    is_me: bool


class ClientList(TypedDict):
    """All connections."""

    clients: list[ClientRow]


class JobList(TypedDict):
    """The jobs that are kept."""

    jobs: list[Job]


class StateSubscribed(SubscriptionNumber):
    """A subscription to the state, and what to begin with."""

    state: StateView


class EventsSubscribed(StateSubscribed):
    """A subscription to events, and what to begin with."""

    events: list[NumberedEvent]


STATE_FIELDS = tuple(field.name for field in fields(GripperState))

_SUBSCRIPTION = Param("subscription", "integer", "Its number.", required=True, minimum=1)


class ReadingMethods:
    """Methods on the daemon's facts, the state and the jobs, and the subscriptions of who asks."""

    def __init__(
        self,
        controller: Controller,
        facts: Facts,
        clients: Clients,
        reporter: Reporter,
        subscriptions: Subscriptions,
        *,
        document: bytes,
    ) -> None:
        self._controller = controller
        self._reporter = reporter
        self._facts = facts
        self._clients = clients
        self._subscriptions = subscriptions
        self._document = document

    @Method(
        "hello",
        "Report who is there: versions, channel, motor, limits, stop generation.",
        "The daemon's description, the number of this connection (client), where stops are taken"
        " before everything else (stop_socket; null where there is no such socket), and the time"
        " by the daemon's CLOCK_MONOTONIC (monotonic_s), by which a client of another machine knows"
        " that its own clock is no use for sent_s.",
        Shape("Hello", (Hello, Greeting)),
        (
            Param("client", "string", "The program's name, for the log and for other clients."),
            Param(
                "on_behalf",
                "string",
                "The user of another machine for whom this connection asks from now on; only from"
                " those that the configuration names as gateways, and once.",
                longest=65,
            ),
            Param(
                "role",
                "string",
                "The role that this user has: no higher than the connection's. With on_behalf.",
                choices=ROLES,
            ),
        ),
    )
    def _hello(self, call: Call) -> Answer:
        session, name = call.session, call.params.get("client")
        if "on_behalf" in call.params or "role" in call.params:
            _speak_for_another(call)
        elif session.remote is not None:
            session.speak_for(session.remote, session.role, name)
        elif name is not None:
            session.rename(name)
        generation = self._controller.stop_latch.generation
        own = {"client": session.identity, "role": session.role, "monotonic_s": call.now_s}
        return {**self._facts.hello(), **own, "stop_generation": generation}

    @Method("rpc.discover", "Describe the methods.", "An OpenRPC document.", Discovered)
    def _discover(self, _call: Call) -> bytes:
        return self._document

    @Method(
        "health",
        "Report the daemon's health.",
        "A verdict, its reasons, and the figures.",
        Shape("Health", (Judged, Shape("Figures", (Figures,), partial=True))),
    )
    def _health(self, call: Call) -> Mapping[str, object]:
        return self._facts.health(call.now_s)

    @Method("state.get", "Return the gripper's present state.", "The state.", StateView)
    def _state(self, _call: Call) -> bytes:
        return self._reporter.state_line()

    @Method(
        "state.subscribe",
        "Send the state again and again, as state.sample or state.batch notifications.",
        "The number of the subscription and the present state, with all its fields.",
        StateSubscribed,
        (
            Param(
                "hz",
                "number",
                "Samples a second (default 20), at most the control rate.",
                minimum=0.1,  # the most is not known here: above it, both would be told
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
    )
    def _subscribe_to_state(self, call: Call) -> Answer:
        hz = float(call.params.get("hz", DEFAULT_SAMPLE_HZ))
        names, batch = call.params.get("fields", ()), call.params.get("batch", 1)
        limit_hz = self._reporter.rate_hz
        if hz > limit_hz:
            text = sentence(
                "{state.subscribe}: {.hz} is {hz:g}, it must be at most the control rate,"
                " {limit_hz:g} Hz",
                hz=hz,
                limit_hz=limit_hz,
            )
            data = {"parameter": "hz", "requested": hz, "limit": limit_hz}
            raise Refused(Refusal("invalid_params", text, data))
        _check_fields(names, batch)
        # The state of the answer is the first one. Between two ticks, neither is far: one that is
        # late, or early after that, is still the one that was meant.
        first_s = self._reporter.state().monotonic_s + 1.0 / hz - 0.5 / limit_hz
        number = accepted(self._subscriptions.add_samples(call.session, hz, names, batch, first_s))
        return b'{"subscription":%d,"state":%b}' % (number, self._reporter.state_line())

    @Method(
        "state.unsubscribe",
        "End a subscription of this connection to the state.",
        "The number of the subscription.",
        SubscriptionNumber,
        (_SUBSCRIPTION,),
    )
    def _unsubscribe_from_state(self, call: Call) -> Answer:
        number = call.params["subscription"]
        found = self._subscriptions.remove_samples(number, call.session)
        return _ended(number) if found else _no_subscription(number, "the state")

    @Method(
        "events.subscribe",
        "Report what happens from now on, as event notifications; none is ever left out.",
        "The number of the subscription, the present state, and the last events: 32 of these kinds,"
        " and of each of them the last 4, however many others came since.",
        EventsSubscribed,
        (
            Param(
                "kinds",
                "strings",
                "Only these kinds (default: all but refused, which reports requests of others"
                " that were refused).",
                choices=EVENT_KINDS,
            ),
        ),
    )
    def _subscribe_to_events(self, call: Call) -> Answer:
        kinds = frozenset(call.params.get("kinds", UNASKED_KINDS))
        if not kinds:
            text = sentence("{events.subscribe}: {.kinds} is empty; name some, or leave it out")
            return Refusal("invalid_params", text, {"parameter": "kinds"})
        number = accepted(self._subscriptions.add_events(call.session, kinds))
        latest, state = self._subscriptions.events.latest(kinds), self._reporter.state_line()
        return b'{"subscription":%d,"state":%b,"events":%b}' % (number, state, latest)

    @Method(
        "events.unsubscribe",
        "End a subscription of this connection to events.",
        "The number of the subscription.",
        SubscriptionNumber,
        (_SUBSCRIPTION,),
    )
    def _unsubscribe_from_events(self, call: Call) -> Answer:
        number = call.params["subscription"]
        found = self._subscriptions.remove_events(number, call.session)
        return _ended(number) if found else _no_subscription(number, "events")

    @Method(
        "clients.list",
        "Report who is connected.",
        "clients: of each its number (client), pid, uid, program, role, connected_s, what is"
        " counted of it (requests, refused, bytes_in, bytes_out, dropped samples,"
        " worst_latency_ms), its subscriptions, its requests that wait (waiting), and is_me.",
        ClientList,
    )
    def _list_clients(self, call: Call) -> bytes:
        return self._clients.listing(call.session, call.now_s)

    @Method(
        "info.get",
        "Return what does not change: motor, calibration, configuration.",
        "Facts: what hello returns, the motor's registers, motor_warnings, the calibration's file,"
        " channel and date (saved_s, Unix time; nominal: a template's figures, measured on no"
        " gripper), motion, configuration.",
        Info,
    )
    def _info(self, _call: Call) -> Mapping[str, object]:
        return self._facts.info()

    @Method("job.list", "List the jobs that are kept, the oldest first.", "The jobs.", JobList)
    def _list_jobs(self, _call: Call) -> bytes:
        return b'{"jobs":[%b]}' % b",".join(map(self._reporter.job, self._controller.jobs))

    @Method("job.get", "Return one job.", "The job.", Job, (JOB,))
    def _get_job(self, call: Call) -> bytes:
        return self._reporter.job(self._job(call))

    @Method("job.wait", "Wait until a job has ended.", "The job.", Job, (JOB,), waits=True)
    def _wait_for_job(self, call: Call) -> Later:
        return Later(self._job(call), wants_job=True)

    def _job(self, call: Call) -> Job:
        number = call.params["job"]
        job = self._controller.jobs.get(number)
        if job is None:
            text = sentence(
                "there is no job {number}, or it is no longer kept; {job.list} lists those that"
                " are",
                number=number,
            )
            raise Refused(Refusal("unknown_job", text, {"requested": number}))
        return job


def _speak_for_another(call: Call) -> None:
    """Make a gateway's connection that of a remote user; raises `Refused`."""
    session, params = call.session, call.params
    remote, role = params.get("on_behalf"), params.get("role")
    if remote is None or role is None:
        text = "hello: on_behalf and role belong together"
        raise Refused(Refusal("invalid_params", text, {"parameter": "on_behalf"}))
    if not session.is_gateway:
        text = (
            "hello: on_behalf is for gateways; list this user under gateways in [access] of the"
            " daemon's configuration"
        )
        raise Refused(Refusal("not_permitted", text, {"parameter": "on_behalf"}))
    if session.remote not in (None, remote):
        text = f"hello: this connection is {session.remote}'s; open another one for {remote}"
        raise Refused(Refusal("not_permitted", text, {"parameter": "on_behalf"}))
    if ROLES.index(role) > ROLES.index(session.role):
        text = f"hello: role is {role}, it can be {session.role} at most"
        data = {"parameter": "role", "needs": role, "role": session.role}
        raise Refused(Refusal("not_permitted", text, data))
    session.speak_for(remote, role, params.get("client"))


def _check_fields(names: Sequence[str], batch: int) -> None:
    twice = next((name for name, times in Counter(names).items() if times > 1), None)
    if twice is not None:
        text = sentence(
            "{state.subscribe}: {.fields} has {twice} twice; name each field once", twice=twice
        )
    elif batch > 1 and not names:
        text = sentence(
            "{state.subscribe}: a batch needs {.fields}: its rows have the values in their order,"
            " without names"
        )
    else:
        return
    raise Refused(Refusal("invalid_params", text, {"parameter": "fields"}))


def _ended(number: int) -> SubscriptionNumber:
    return {"subscription": number}


def _no_subscription(number: int, what: str) -> Refusal:
    text = f"this connection has no subscription {number} to {what}"
    return Refusal("invalid_params", text, {"parameter": "subscription"})
